"""Mechanisms with reduced solids: how they are solved, and the refusal of what lies beyond their bases.

The error figure is that of `ksd.solve.whole_solids`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, TypeGuard

import numpy as np

from ksd.errors import ConvergenceError, SceneError
from ksd.modal.mixed import condensed_joints
from ksd.modal.solid_basis import SolidModel, with_solids
from ksd.modal.solid_body import SolidBasis
from ksd.modal.solid_solve import SUCCESSFUL
from ksd.model.compile import Model
from ksd.section.checks import show
from ksd.solve.configuration import Configuration
from ksd.solve.conventional import by_load_steps
from ksd.solve.mixed import MixedSolver, Prepared
from ksd.solve.whole_solids import bent, indicator, settled, validity


def holds_solids(basis: object) -> TypeGuard[Mapping[str, SolidBasis]]:
    """Whether a basis by name names reduced solids. Raises SceneError for solids beside modal leafs."""
    if not isinstance(basis, Mapping):
        return False
    solids = [isinstance(b, SolidBasis) for b in basis.values()]
    if any(solids) and not all(solids):
        raise SceneError(
            "basis: solids beside modal leafs are not possible; name the solids alone, other leafs stay as they are"
        )
    return any(solids)


def solid_model(model: Model, basis: Mapping[str, SolidBasis]) -> SolidModel:
    """`model` with the solids of `basis`, by leaf, or by joint where that has one leaf only."""
    named = {}
    for name, body in basis.items():
        own = [n for n in model.member_names if n.startswith(f"{name}/")]
        named[own[0] if len(own) == 1 and name not in model.member_names else name] = body
    return with_solids(model, named)


class SolidMixture(MixedSolver):
    """A mechanism of reduced solids and condensed joints, prepared for repeated solves: steps 1 to 4 with the solids as
    they are and every other joint condensed by its record.

    model: the leafs in full; solids: the same with its solids. Raises what `MixedSolver` does.
    """

    def __init__(self, model: Model, solids: SolidModel, *, records: Any, extrapolate: bool) -> None:
        super().__init__(
            model, solids, {}, near=lambda _: solids.rest, records=records, extrapolate=extrapolate
        )
        self.solids = solids

    def _prepared(self, values: Mapping[str, float]) -> Prepared:
        if self._at_rest is None:
            self._at_rest = Prepared(self.solids, self.steps)
        return self._at_rest


def mixes(model: SolidModel) -> bool:
    """Whether there are joints beside the solids that could be condensed."""
    return any(condensed_joints(model, model.reduced))


def by_solids(
    model: SolidModel,
    targets: Mapping[str, float],
    *,
    method: str | None = None,
    estimate: bool = True,
    passes: int = 0,
    solver: Any = None,
) -> Configuration:
    """Equilibrium of a mechanism with reduced solids at drive values [m or rad], by load steps, with its error figure unless
    estimate=False; by "modal" the joints of `solver` without solids are condensed, with relinearised `passes`.

    Raises ConvergenceError, what `SolidMixture` does, and SceneError for a method that would leave the solids out.
    """
    if method not in (None, "conventional", "modal"):
        raise SceneError(
            f"method = {show(method)}: a mechanism with reduced solids is solved in load steps; give no method, or "
            "'conventional'"
        )
    if method == "modal" and solver is not None and solver.model is not model and mixes(model):
        if solver.mixed is None:
            words = {"records": solver.records, "extrapolate": solver.extrapolate}
            solver.mixed = SolidMixture(solver.model, model, **words)
        found = solver.mixed(targets, passes=passes)
        return judged(found) if estimate else found
    try:
        found = by_load_steps(model, targets, lambda c: c)
    except ConvergenceError as reason:
        loose = reason.reached == 0.0 and any(b.solid.flat for b in model.solids.values())
        hold = (
            "; a solid meshed in 2D resists nothing across its plane: hold that by supports" if loose else ""
        )
        said = f"basis no longer successful, or no equilibrium: {reason}{hold}"
        raise ConvergenceError(said, reached=reason.reached, result=reason.result) from reason
    found = replace(found, method=method or "conventional")
    return judged(found) if estimate else found


def judged(found: Configuration) -> Configuration:
    """The configuration with its error figure, and a doubt where a basis was no longer successful."""
    model = found.model
    assert isinstance(model, SolidModel)
    estimate, step = indicator(model, found.motion, model.targets(found.targets), found.load_factor)
    doubts = found.doubts
    if not estimate.relative <= SUCCESSFUL:
        name, stroke, turn = bent(model, found.motion)
        known = math.isfinite(estimate.relative)
        said = f"{100 * estimate.relative:.2g} %" if known else "beyond measure"
        doubts = (
            *doubts,
            f"basis no longer successful: its estimated error is {said}, with solid '{name}' at a stroke of {stroke:.2g} L "
            f"and its face turned {np.rad2deg(turn):.3g} degrees ({validity(model, solid=name).sentence}); ask for less, or "
            "reduce the solid with more internal modes or order=3",
        )
    steps = (*found.steps[:-1], step, found.steps[-1])
    return replace(found, method_error=estimate, steps=steps, doubts=doubts)


__all__ = [
    "SolidMixture",
    "bent",
    "by_solids",
    "holds_solids",
    "indicator",
    "judged",
    "mixes",
    "settled",
    "solid_model",
    "validity",
]
