"""Method `modal`: equilibrium of a mechanism whose leafs are modal bodies (paper 2, section 4), with an error figure.

Bodies share interface nodes, which is eq. 11 with its multipliers eliminated; drives and supports keep theirs. Loads
and drives are stepped and Newton iterated by the solver of everything else. The error indicator takes corrector
steps of the full model from the recovered nodes and looks how far they lead.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ksd.errors import ConvergenceError, KinematicsError, RangeError, RecordError, SceneError
from ksd.modal.bodies import ModalModel, with_modal_bodies
from ksd.modal.choices import ModalBasis
from ksd.modal.mixed import condensed_joints, meshed, named_leafs, standing, with_chains
from ksd.model.arrays import Motion, make_work
from ksd.model.compile import Model
from ksd.numerics.stopwatch import Stopwatch
from ksd.section.checks import show
from ksd.solve.configuration import Configuration
from ksd.solve.conventional import conventional
from ksd.solve.driving import CAP, RTOL
from ksd.solve.mixed import MixedSolver, Near
from ksd.solve.newton import iterate
from ksd.solve.steps import Step
from ksd.solve.stops import Stop
from ksd.solve.validity import CORRECTORS, bent, indicator, validity

SUCCESSFUL = 0.05
"""Estimated relative error beyond which a basis is no longer successful."""


class ModalSolver:
    """A mechanism of modal bodies, prepared for repeated solves.

    full: the model, its leafs to reduce as chains; basis: of all leafs, or by leaf; near: the state of `full` to expand
    trained bases at, for given drive values; placing: starts where the joints' records put everything, None without them.
    """

    def __init__(
        self,
        full: Model,
        basis: ModalBasis | Mapping[str, ModalBasis],
        near: Near,
        placing: MixedSolver | None = None,
    ) -> None:
        self.full, self.basis, self.near, self.placing = full, basis, near, placing
        self._at_rest: ModalModel | None = None

    @property
    def at_rest(self) -> ModalModel:
        """The bodies expanded at the undeformed state, made on first use."""
        if self._at_rest is None:
            self._at_rest = with_modal_bodies(self.full, self.basis)
        return self._at_rest

    def __call__(self, targets: Mapping[str, float]) -> Configuration:
        """Solve at drive values by name [m or rad].

        Raises ConvergenceError where the reduced equilibrium is not found, which says "basis no longer successful".
        """
        still = expanded_at_rest(self.full, self.basis)
        if len(still) < len(leafs_by_name(self.full, self.basis)):
            about = self.near(targets)
            return replace(
                tangent_solve(self.full, self.basis, targets, about, at_rest=still), method="modal"
            )
        if self.placing is not None:
            # a few iterations from there, tens of them from rest
            with contextlib.suppress(ConvergenceError, RangeError):
                return self.placing(targets, patient=False)
        try:
            found = conventional(self.at_rest, targets, planar=False)
        except ConvergenceError as reason:
            raise ConvergenceError(
                f"basis no longer successful: {reason}; ask for less, raise internal or order, take "
                "expansion='trained', or use another method",
                reached=reason.reached,
                result=reason.result,
            ) from reason
        return replace(found, method="modal")


def leafs_by_name(full: Model, basis: ModalBasis | Mapping[str, ModalBasis]) -> Mapping[str, ModalBasis]:
    """The basis of every leaf that is reduced."""
    return basis if isinstance(basis, Mapping) else dict.fromkeys(full.member_names, basis)


def expanded_at_rest(full: Model, basis: ModalBasis | Mapping[str, ModalBasis]) -> set[str]:
    """Leafs expanded at rest: by choice, or because no record places a free leaf."""
    free = full.member_names[full.joint_members[-1].stop if full.joint_members else 0 :]
    return {n for n, b in leafs_by_name(full, basis).items() if b.expansion == "rest" or n in free}


def by_modal_bodies(
    solver: Any, targets: Mapping[str, float], *, estimate: bool = True, passes: int = 0
) -> Configuration:
    """Method `modal` of a `ksd.solve.solver.Solver`; for a trained expansion the chains stand as its steps 1 and 2
    place them. With a basis by name, joints none of whose leafs are named are condensed as in `reduced`."""
    if solver.modal is None:
        solver.modal = _prepared(solver)
    bodies = solver.modal
    found = bodies(targets, passes=passes) if isinstance(bodies, MixedSolver) else bodies(targets)
    return judged(found) if estimate else found


def _prepared(solver: Any) -> ModalSolver | MixedSolver:
    """What solves with the basis of `solver`. Raises SceneError for what is no basis, and what `MixedSolver` does."""
    model, basis = solver.model, ModalBasis() if solver.basis is None else solver.basis
    words = {"records": solver.records, "extrapolate": solver.extrapolate}
    if isinstance(basis, Mapping):
        leafs = named_leafs(model, basis)
        model = meshed(model)
        full = with_chains(model, leafs)
    elif isinstance(basis, ModalBasis):
        leafs = dict.fromkeys(model.member_names, basis)
        full = meshed(model, basis.elements)
    else:
        raise SceneError(f"basis = {show(basis)}: give a ksd.ModalBasis, or several by joint or leaf")
    counts = {b.elements for b in leafs.values() if b.expansion == "trained"}
    chains = {n: type(solver)(meshed(model, n), **words) for n in counts}

    def near(values: Mapping[str, float]) -> Motion:
        placed = {
            n: s(values, method="kinematic", estimate=False, strict=False).motion for n, s in chains.items()
        }
        return standing(full, leafs, {n: (chains[n].model, m) for n, m in placed.items()})

    if any(condensed_joints(full, leafs)):
        return MixedSolver(model, full, leafs, near=near, **words)
    placing = None
    with contextlib.suppress(RecordError, RangeError, KinematicsError, SceneError):
        placing = MixedSolver(meshed(model), full, leafs, near=near, **words)
    return ModalSolver(full, basis if isinstance(basis, ModalBasis) else leafs, near, placing)


def tangent_solve(
    full: Model,
    basis: ModalBasis | Mapping[str, ModalBasis],
    targets: Mapping[str, float],
    about: Motion,
    *,
    at_rest: Collection[str] = (),
) -> Configuration:
    """Equilibrium of bodies expanded at the state `about` of the full model, from there in one go; at_rest: leafs
    expanded at rest."""
    clock = Stopwatch()
    model = with_modal_bodies(full, basis, about=about, at_rest=at_rest)
    made = clock()
    motion = model.rest.copy()
    motion.x[:], motion.R[:] = about.x, about.R
    clock = Stopwatch()
    reason, count, residual, negatives, _ = iterate(
        model.arrays, motion, model.targets(targets), 1.0, make_work(model.arrays), RTOL, 40, CAP, math.inf
    )
    spent = clock()
    steps = (
        Step("tangent bases", 0, made, 0.0, Stop.CONVERGED, f"{len(model.bodies)} bodies"),
        Step("modal equilibrium", count, spent, residual, Stop(reason)),
    )
    expected = len(model.drive_names) + len(model.support_names)
    found = Configuration(
        model, motion, "modal", dict(targets), steps, negatives=negatives, expected=expected
    )
    if Stop(reason) is not Stop.CONVERGED:
        raise ConvergenceError(
            f"basis no longer successful: from the trained configuration {Stop(reason).sentence}; use method='full'",
            result=found,
        )
    return found


def judged(found: Configuration) -> Configuration:
    """The configuration with its error estimate, and a doubt where the basis was no longer successful."""
    model = found.model
    assert isinstance(model, ModalModel)
    estimate, step = indicator(model, found.motion, model.targets(found.targets))
    name, stroke, turn = bent(model, found.motion)
    last = found.steps[-1]
    # the last step is the one that says whether it converged
    steps = (*found.steps[:-1], step, last)
    doubts = found.doubts
    if not estimate.relative <= SUCCESSFUL:
        said = f"{100 * estimate.relative:.2g} %" if math.isfinite(estimate.relative) else "beyond measure"
        body = model.bodies[model.member_names.index(name)]
        assert body is not None
        good = f" ({validity(model, leaf=name).sentence})" if body.choices.expansion == "rest" else ""
        joints = "take passes=1 or name the condensed joints too, or " if last.name.startswith("4") else ""
        doubts = (
            *doubts,
            f"basis no longer successful: its estimated error is {said}, with leaf '{name}' at a stroke of "
            f"{stroke:.2g} L and bent {np.rad2deg(turn):.3g} degrees from its chord{good}; {joints}use ksd.ModalBasis() "
            "with coordinates='director', frame='chord', more internal modes, or expansion='trained'",
        )
    return replace(found, method_error=estimate, steps=steps, doubts=doubts)


__all__ = [
    "CORRECTORS",
    "SUCCESSFUL",
    "ModalSolver",
    "bent",
    "by_modal_bodies",
    "indicator",
    "judged",
    "tangent_solve",
]
