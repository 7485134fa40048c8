"""The storage of one prepared design, and how the numbers of other designs get into it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from ksd.bodies.freedom import check_freedoms
from ksd.design.refill.drawing import Drawing, Numbers, numbers_of
from ksd.design.refill.polynomials import Polynomials
from ksd.design.refill.scales import scales
from ksd.design.refill.space import Filled, Space
from ksd.library import find_record
from ksd.model.arrays import Arrays, flatten
from ksd.solve.five import FiveSteps

SAME = 1e-12
"""Relative difference, to the largest number of an array, below which a refilled array is that of a fresh model."""


@dataclass(frozen=True)
class Ready:
    """Numbers of D designs computed: `space` for the storage; fits (D,): trained shapes and same topology.

    motion_scale (D, q): from intended motions to rad or m.
    """

    space: Filled
    fits: np.ndarray
    motion_scale: np.ndarray


class Refill:
    """Made of one design prepared afresh; `ready` computes the arrays of others, `put` writes one of them."""

    def __init__(self, five: FiveSteps, drawn: Drawing) -> None:
        self.five, self.model, self.joints = five, five.model, drawn.joints
        bodies = five.bench.bodies
        self.own = self.numbers([drawn])
        self.polynomials = Polynomials(
            drawn.joints, [find_record(j.family) for j in drawn.joints], self.model.mesh
        )
        self.works = False
        if not self.polynomials.known or bodies.hanging or self.model.mesh.nodal:
            return
        self.space = Space(self.model, bodies, drawn.joints, self.polynomials, self.own)
        self.space_words = _Words(five.bench.parts)
        self.kinds = np.array(
            [m.kind == "translation" for p in self.model.scene.joints for m in p.joint.motions]
        )
        self.of_motion = np.repeat(
            self.space.top.joint, [len(p.joint.motions) for p in self.model.scene.joints]
        )
        stack, _ = self.polynomials([self.polynomials.shapes(drawn.joints)])
        self.works = self.space.keep(stack, self._scale(self.own)[0]) and self._reproduces(drawn)

    def numbers(self, drawn: Sequence[Drawing]) -> Numbers:
        """The numbers of drawings with the words of this design."""
        return numbers_of(self.model.scene, self.joints, [d.numbers for d in drawn])

    def _scale(self, n: Numbers) -> np.ndarray:
        return scales(n.leaf, self.model.mesh, self.space.counts)

    def _reproduces(self, drawn: Drawing) -> bool:
        """Whether the arrays computed for the design it was made of are those it has."""
        ready = self.ready([drawn])
        return bool(ready.fits[0]) and self.space_words.holds(ready.space)

    def ready(self, drawn: Sequence[Drawing]) -> Ready:
        """Compute the arrays of designs with the words of this one."""
        n = self.numbers(drawn)
        shapes, known = [], np.ones(len(drawn), bool)
        for d, drawing in enumerate(drawn):
            try:
                shapes.append(self.polynomials.shapes(drawing.joints))
            except KeyError:
                shapes.append(self.polynomials.shapes(self.joints))
                known[d] = False
        stack, trained = self.polynomials(shapes)
        filled, fits = self.space(n, stack)
        fits &= known & trained
        scale = np.where(self.kinds, n.length[:, self.of_motion], 1.0)
        return Ready(filled, fits, scale)

    def put(self, ready: Ready, d: int) -> bool:
        """Write design d into the storage. Returns whether its joints fit together in the way of those of the first.
        Raises KinematicsError as a fresh model does."""
        self.space_words.put(ready.space, d)
        size = float(ready.space["bodies.reduced.size"][d])
        parts = self.five.bench.parts
        loose: Any = SimpleNamespace(
            loops=parts.bodies.loops, reduced=parts.bodies.reduced._replace(size=size),
            reduced_rest=parts.rest.reduced, motion_names=self.five.bench.bodies.motion_names,
        )  # fmt: skip
        fit = check_freedoms(self.model, loose)
        return bool(fit.exact == self.five.fit.exact and fit.yielding == self.five.fit.yielding)


class _Words:
    """The arrays of prepared storage, and the length scales of its mechanisms, by their names."""

    def __init__(self, parts: Any) -> None:
        self.arrays: dict[str, np.ndarray] = {}
        self.systems: list[Arrays] = []
        self._collect(parts, "")

    def _collect(self, part: Any, name: str) -> None:
        for field in part._fields:
            inner, path = getattr(part, field), f"{name}.{field}" if name else field
            if isinstance(inner, np.ndarray):
                self.arrays[path] = inner
            elif isinstance(inner, tuple):
                self._collect(inner, path)
        if isinstance(part, Arrays):
            self.systems.append(part)
            self.arrays[f"{name}.size"] = part.flat.floats[:1].reshape(())

    def put(self, filled: Filled, d: int) -> None:
        """Write row d of all."""
        for name, values in filled.items():
            if name in self.arrays:
                self.arrays[name][...] = values[d]
        for system in self.systems:
            # what compiled code reads is a copy
            system.flat.floats[1:] = flatten(system).floats[1:]

    def holds(self, filled: Filled) -> bool:
        """Whether row 0 of all is what is held."""
        for name, values in filled.items():
            if name not in self.arrays:
                continue
            have = self.arrays[name]
            if values[0].shape != have.shape:
                return False
            if np.abs(values[0] - have).max(initial=0.0) > SAME * np.abs(have).max(initial=0.0):
                return False
        return True
