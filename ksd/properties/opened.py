"""A state opened for several questions: what frequencies, buckling and stiffness have in common is made once."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property

from ksd.model.arrays import Motion
from ksd.model.compile import Model
from ksd.properties.alike import Flexible, flexible_leafs
from ksd.properties.tangent import Assembled, Tangent, assembled_tangent, factored
from ksd.properties.unfold import unfolded


class Opened:
    """The finer model and state (`ksd.properties.unfold`) of `model` at `motion`, its factored tangents and its leafs.

    The state must not be changed while it is under question.
    """

    def __init__(self, model: Model, motion: Motion, *, load_factor: float = 1.0) -> None:
        self.model, self.motion = unfolded(model, motion, load_factor=load_factor)
        self.load_factor = load_factor
        self._tangents: dict[tuple[str, ...], Tangent] = {}

    @cached_property
    def assembled(self) -> Assembled:
        """The exact tangent before it is factored, drives held."""
        return assembled_tangent(self.model, self.motion, load_factor=self.load_factor)

    def tangent(self, freed: Iterable[str] = ()) -> Tangent:
        """The exact tangent, factored, with the drives and supports named in `freed` let go. Raises as
        `ksd.properties.tangent.factored` does."""
        names = (freed,) if isinstance(freed, str) else tuple(freed)
        if names not in self._tangents:
            self._tangents[names] = factored(self.assembled, names)
        return self._tangents[names]

    @cached_property
    def leafs(self) -> list[Flexible]:
        """The strain-mode leafs by make, under their stresses."""
        return flexible_leafs(self.model, self.motion, load_factor=self.load_factor)
