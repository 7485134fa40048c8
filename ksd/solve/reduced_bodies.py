"""Mechanisms with reduced bodies: modal leaves and solids beside leaf springs in full and condensed joints.

By load steps they are members like every other. Where records place the joints, steps 1 and 2 of the KSD method lead to the
start: everything is placed, joints none of whose leaf springs is reduced or asked for in full are condensed, and the inner
coordinates of the bodies settle with their ends held there. Step 3 is the equilibrium of links, condensed joints and all
other members, step 4 the recovery of the condensed joints.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ksd.bodies.joints import joint_bodies
from ksd.bodies.partly_condensed import condense_some_joints, single_member
from ksd.checks import show
from ksd.errors import ConvergenceError, KinematicsError, RangeError, RecordError, SceneError
from ksd.modal.choices import ModalBasis
from ksd.modal.leaf_basis import LeafBasis
from ksd.modal.leaf_bodies import full_model_state, with_chains, with_modal_bodies
from ksd.modal.solid_basis import SolidBasis, with_solids
from ksd.model.arrays import Arrays, State, make_workspace
from ksd.model.compile import Model
from ksd.model.newton import assemble, solve_equilibrium
from ksd.model.reduced_bodies import inner_state, relative_end_pose, transfer_state
from ksd.numerics.blocks import factor_blocks
from ksd.numerics.stopwatch import Stopwatch
from ksd.solve.configuration import Configuration
from ksd.solve.conventional import solve_in_either_order
from ksd.solve.five_step_solver import FiveStepSolver
from ksd.solve.five_steps import (
    assemble_full_state,
    condense_joint_bodies,
    read_answer_motions,
    recover_substructures,
)
from ksd.solve.full_bodies import error_indicator
from ksd.solve.joint_motions import stored_joint_motions
from ksd.solve.load_steps import LoadPath, take_load_steps
from ksd.solve.steps import MAX_TURN_PER_STEP, RTOL, Step, Stop
from ksd.solve.validity import most_bent_body, validity

SUCCESSFUL = 0.05
"""Estimated relative error beyond which a basis is no longer successful."""
MOST_SETTLING = 40
PARTS = (1, 2, 4, 8, 16)
"""Equal parts in which drives and loads are put on together, until one of these ways arrives."""
SMALLEST = 1 / 128
"""Smallest part of the loads put on at a time, drives in place."""
WAYS_THERE = (1, 2, 4, 8, 16)
"""Equal steps from rest in which the ends of a body are turned until its inner coordinates follow."""

WITHOUT_RECORDS = (RecordError, RangeError, KinematicsError, SceneError)
"""Why records cannot place a mechanism; load steps from rest need none."""


def named_bases(model: Model, basis: object) -> dict[str, ModalBasis | SolidBasis]:
    """The basis of every leaf of `model` that is to be reduced: one `ksd.ModalBasis` for all (the default for None), or by
    name of a leaf, of a joint for all its leaf springs, or of a flexible constraint.

    Raises SceneError for a name that is none of these, and for what is no basis.
    """
    if basis is None or isinstance(basis, ModalBasis):
        return dict.fromkeys(model.member_names, ModalBasis() if basis is None else basis)
    if not isinstance(basis, Mapping):
        raise SceneError(f"basis = {show(basis)}: give a ksd.ModalBasis, or several by joint or leaf")
    if not basis:
        raise SceneError("basis = {}: name at least one joint or leaf, or give one ksd.ModalBasis for all")
    if has_solids(basis) and any(isinstance(body, ModalBasis) for body in basis.values()):
        # the error of their meshes would not be known
        raise SceneError(
            "basis: solids beside modal leaves are not possible; name the solids alone, other leaf springs stay as they are"
        )
    found = {}
    for name, body in basis.items():
        if not isinstance(body, ModalBasis | SolidBasis):
            raise SceneError(
                f"basis[{show(name)}] = {show(body)}: give a ksd.ModalBasis, or what "
                "ksd.modal.solid_basis.reduce_solid returns"
            )
        own = [n for n in model.member_names if n == name or n.startswith(f"{name}/")]
        if len(own) > 1 and isinstance(body, SolidBasis):
            raise SceneError(
                f"basis[{show(name)}]: a solid stands for one leaf; name one of {', '.join(own)}"
            )
        if not own:
            known = ", ".join((*(p.name for p in model.scene.joints), *model.member_names))
            raise SceneError(f"basis: there is no joint or leaf {show(name)}; there are: {known}")
        found.update(dict.fromkeys(own, body))
    return found


def has_solids(basis: object) -> bool:
    """Whether a basis by name names reduced solids."""
    return isinstance(basis, Mapping) and any(isinstance(b, SolidBasis) for b in basis.values())


class ReducedBodies:
    """A mechanism with reduced bodies, prepared for repeated solves.

    basis: see `named_bases`; condensing: whether joints without reduced leaves are condensed by their records. Raises what
    `named_bases`, `with_modal_bodies` and `with_solids` do; where joints are condensed, or a basis is expanded about their
    trained configuration, what `ksd.bodies.joints.joint_bodies` does, and SceneError for leaf springs with weight.
    """

    def __init__(
        self, model: Model, basis: object, *, condensing: bool, records: Any, extrapolate: bool
    ) -> None:
        model = with_chains(model, {})
        bases = named_bases(model, basis)
        self.modal = {n: b for n, b in bases.items() if isinstance(b, ModalBasis)}
        solids = {n: b for n, b in bases.items() if isinstance(b, SolidBasis)}
        full = with_chains(model, self.modal) if self.modal else model
        self.full = with_solids(full, solids) if solids else full
        joints = [model.member_names[own] for own in model.joint_members]
        condensed = [condensing and not any(n in bases for n in own) for own in joints]
        within = {n for own in joints for n in own}
        trained = {n for n, b in self.modal.items() if b.expansion == "trained"} & within
        self.placed: _Placed | None = None
        self.needs_records = any(condensed) or bool(trained)
        if not condensing and not trained:
            return
        with contextlib.suppress(*() if self.needs_records else WITHOUT_RECORDS):
            steps = _steps(model, records, extrapolate)
            self.placed = _Placed(steps, self.full, self.modal, condensed, trained)

    @cached_property
    def at_rest(self) -> Model:
        """The mechanism with all bodies, expanded at the undeformed state."""
        return with_modal_bodies(self.full, self.modal) if self.modal else self.full

    def __call__(self, values: Mapping[str, float], *, relinearisations: int = 0) -> Configuration:
        """Solve at drive values by name [m or rad]. relinearisations: rounds in which joints are condensed anew.

        Raises RangeError, and ConvergenceError where the reduced equilibrium is not found, which says "basis no longer
        successful".
        """
        if self.placed is not None and self.needs_records:
            return self.placed(values, relinearisations)
        if self.placed is not None:
            # a few iterations from there, tens of them from rest
            with contextlib.suppress(ConvergenceError, RangeError):
                return self.placed(values, 0)
        return solve_by_steps(self.at_rest, values)


def _steps(model: Model, records: Any, extrapolate: bool) -> FiveStepSolver:
    """The KSD steps of a model whose leaf springs are in full. Raises SceneError for leaf springs with weight."""
    if len(model.arrays.weight):
        raise SceneError(
            "leaves with weight beside modal bodies are not possible: compile without='gravity', or use another method"
        )
    return FiveStepSolver(
        model, joint_bodies(model, records, extrapolate=extrapolate), extrapolate=extrapolate
    )


class _Placed:
    """A mechanism of reduced bodies and condensed joints, placed by the joints' records.

    steps: the KSD steps of its leaves in full; full: modal leaves are chains, solids stay; modal: their bases; condensed:
    which joints are; trained: leaf springs whose basis is expanded where the records put them.
    """

    def __init__(
        self,
        steps: FiveStepSolver,
        full: Model,
        modal: Mapping[str, ModalBasis],
        condensed: Sequence[bool],
        trained: set[str],
    ) -> None:
        self.steps, self.full, self.modal = steps, full, modal
        self.condensed, self.trained = condensed, trained
        self.model, self.storage = steps.model, steps.storage
        self.once = not any(condensed) and not trained

    @cached_property
    def at_rest(self) -> _Prepared:
        """Bodies and storage, all expanded at rest."""
        return self._made(None)

    @cached_property
    def _untrained(self) -> Model:
        """Trained leaves by a basis expanded at rest, which finds the state to expand at; chains are lost on the way."""
        plain = {n: ModalBasis(elements=self.modal[n].elements) for n in self.trained}
        return with_modal_bodies(self.full, plain)

    def _ready(self) -> _Prepared:
        """Bodies and storage at the present place: made once, unless a basis is expanded there."""
        if not self.trained:
            return self.at_rest
        state = transfer_state(self.model, self.storage.full_state, self._untrained)
        settle_bodies(self._untrained, state)
        return self._made(full_model_state(self._untrained, state)[1])

    def _made(self, about: State | None) -> _Prepared:
        """Bodies and storage, trained ones expanded at a state of `full`, with those of smaller bases where one is large."""
        parts = self.storage.bodies.reduced, self.condensed
        words: dict[str, Any] = {"about": about, "at_rest": set(self.modal) - self.trained}
        smaller = None
        if any(b.large for b in self.modal.values()):
            fewer = {n: b.smaller if b.large else b for n, b in self.modal.items()}
            smaller = _Prepared(with_modal_bodies(self.full, fewer, **words), *parts)
        model = with_modal_bodies(self.full, self.modal, **words) if self.modal else self.full
        return _Prepared(model, *parts, smaller)

    def __call__(self, values: Mapping[str, float], relinearisations: int) -> Configuration:
        """Solve at drive values by name [m or rad]. Raises ConvergenceError, RangeError."""
        target, links = self.model.targets(values), self.model.links
        placed, clock = self._place(values, 1.0), Stopwatch()
        ready = self._ready()
        steps = [*placed.steps, Step("modal bases", 0, clock(), 0.0, Stop.CONVERGED)]
        motion, more = self._equilibrium(ready, values)
        steps += more
        for n in range(relinearisations + 1):
            if n > 0:
                condense_joint_bodies(self.storage, 0)
                self._condense(ready, motion)
                step, _ = ready.loaded(motion, target, 1.0, smallest=1.0)
                if step.stop is not Stop.CONVERGED:
                    raise ConvergenceError(
                        f"in relinearisation step {n} {step.stop.sentence}: the loads bend the joints too far from their "
                        "intended motion to condense them there; take fewer relinearisations, or use method='full'"
                    )
                steps.append(step)
            self.storage.reduced_state.x[:], self.storage.reduced_state.R[:] = (
                motion.x[:links],
                motion.R[:links],
            )
            clock()
            shift, _ = recover_substructures(self.storage)
            steps.append(Step("4 recovery", 0, clock(), shift, Stop.CONVERGED))
        return self._answer(ready, motion, values, steps, placed.notes)

    def _place(self, values: Mapping[str, float], share: float) -> Configuration:
        """Steps 1 and 2 at a share of the drive values, whose result is in storage."""
        part = {name: float(share * value) for name, value in values.items()}
        return self.steps(
            part, self.model.targets(part), method="kinematic", relinearisations=0, estimate=False
        )

    def _equilibrium(self, ready: _Prepared, values: Mapping[str, float]) -> tuple[State, list[Step]]:
        """Step 3 from where steps 1 and 2 put everything, along the drives and loads where the whole of them fails; of large
        bases next to the state of smaller ones. Raises ConvergenceError."""
        target, failed = self.model.targets(values), None
        if ready.smaller is not None:
            near, steps = self._equilibrium(ready.smaller, values)
            motion = ready.like(ready.smaller, near)
            step, reached = ready.loaded(motion, target, 1.0, smallest=SMALLEST)
            if step.stop is Stop.CONVERGED:
                return motion, [*steps[:-1], step]
            failed = step, reached
        for parts in () if failed else PARTS[: 1 if self.once else None]:
            for k in range(1, parts + 1):
                if parts > 1:
                    self._place(values, k / parts)
                if k == 1:
                    motion, settling = self._start(ready)
                    steps = [settling]
                self._condense(ready, motion)
                smallest = SMALLEST if parts == 1 and not self.once else 1.0
                step, reached = ready.loaded(motion, k / parts * target, k / parts, smallest=smallest)
                steps.append(step)
                if step.stop is not Stop.CONVERGED:
                    failed = failed or (step, reached)
                    break
            else:
                return motion, steps
        assert failed is not None
        step, reached = failed
        where = "beside condensed joints" if any(self.condensed) else "where the joints' records put it"
        raise ConvergenceError(
            f"basis no longer successful: {where}, at {100 * reached:.3g} % of the loads, {step.stop.sentence}; name all "
            "joints, take expansion='trained', or use method='full'",
            reached=reached,
        )

    def _start(self, ready: _Prepared) -> tuple[State, Step]:
        """Where steps 1 and 2 put everything, the bodies settled there."""
        clock, mix, model = Stopwatch(), ready.mix, ready.model
        state = transfer_state(self.model, self.storage.full_state, model)
        count = settle_bodies(model, state)
        motion = mix.rest.copy()
        motion.x[:], motion.R[:] = state.x[mix.nodes], state.R[mix.nodes]
        for m in np.flatnonzero(mix.member >= 0).tolist():
            mix.inner(motion, m)[:] = inner_state(model, state, int(mix.member[m]))
        return motion, Step("bodies settled", count, clock(), 0.0, Stop.CONVERGED, "ends held")

    def _condense(self, ready: _Prepared, motion: State) -> None:
        """The condensed joints of step 2 into `motion`."""
        every = self.storage.reduced_state.inner
        for m in np.flatnonzero(ready.mix.joint >= 0).tolist():
            own = ready.mix.inner(motion, m)
            own[:] = every[len(own) * ready.mix.joint[m] :][: len(own)]

    def _answer(
        self,
        ready: _Prepared,
        motion: State,
        values: Mapping[str, float],
        steps: list[Step],
        notes: tuple[str, ...],
    ) -> Configuration:
        """The state of all leaf springs, and what the joints' records say of it."""
        b, mix, model = self.storage, ready.mix, ready.model
        assemble_full_state(b)
        state = transfer_state(self.model, b.full_state, model)
        state.x[mix.nodes], state.R[mix.nodes] = motion.x, motion.R
        state.multiplier[:] = motion.multiplier
        for m in np.flatnonzero(mix.member >= 0).tolist():
            inner_state(model, state, int(mix.member[m]))[:] = mix.inner(motion, m)
        # condensed joints cannot buckle, their leaf springs can
        work, plan = make_workspace(model.arrays), model.arrays.plan
        _, _, own, _ = assemble(model.arrays, state, model.targets(values), 1.0, work, RTOL, 0, 10.0)
        negatives, _ = factor_blocks(plan.ints, work.matrix, work.scaled_rows, len(plan.size))
        read_answer_motions(b)
        expected = len(model.drive_names) + len(model.support_names)
        return Configuration(
            model, state, "modal", dict(values), tuple(steps), negatives=int(negatives + own),
            expected_negatives=expected, joint_motions=stored_joint_motions(b), notes=notes,
            joints_near_intended=bool(b.checks[1]),
        )  # fmt: skip


class _Prepared:
    """A model with its bodies and their mixture with condensed joints, with storage.

    smaller: the same of smaller bases, from whose state a large one starts.
    """

    def __init__(
        self, model: Model, linear: Arrays, condensed: Sequence[bool], smaller: _Prepared | None = None
    ) -> None:
        self.model, self.smaller, self.mix = model, smaller, condense_some_joints(model, linear, condensed)
        self.work = make_workspace(self.mix.arrays)

    def loaded(
        self, motion: State, target: np.ndarray, factor: float, *, smallest: float
    ) -> tuple[Step, float]:
        """Step 3, in place, at drives target (c,) under loads times factor, put on in parts down to `smallest`.

        Returns the part of the loads that was reached, too.
        """
        clock, arrays = Stopwatch(), self.mix.arrays

        def newton(state: State, want: np.ndarray, level: float, *bounds: Any) -> Any:
            return solve_equilibrium(arrays, state, want, level, self.work, *bounds)

        way = LoadPath(target, target, (0.0, factor), smallest_step=1.0)
        driven = take_load_steps(motion, newton, way, pivoting=(arrays, self.work))
        if driven.stop is not Stop.CONVERGED and smallest < 1.0:
            # without loads first: the place records give is no equilibrium of theirs
            reason, count, *_ = newton(motion, target, 0.0, RTOL, 30, MAX_TURN_PER_STEP, math.inf)
            if reason == Stop.CONVERGED:
                way = way._replace(smallest_step=smallest)
                more = take_load_steps(motion, newton, way, pivoting=(arrays, self.work))
                driven = more._replace(
                    factorisations=driven.factorisations + count + more.factorisations,
                    steps_tried=more.steps_tried + 1,
                )
        parts = f"{driven.steps_tried} load steps" if driven.steps_tried > 1 else ""
        step = Step(
            "3 reduced equilibrium", driven.factorisations, clock(), driven.residual, driven.stop, parts
        )
        return step, driven.fraction_reached

    def like(self, other: _Prepared, near: State) -> State:
        """The state of another basis of the same bodies, nodes of leaf springs as near as this one has them."""
        motion = self.mix.rest.copy()
        motion.x[:], motion.R[:], motion.multiplier[:] = near.x, near.R, near.multiplier
        for m, i in enumerate(self.mix.member.tolist()):
            own, theirs = self.mix.inner(motion, m), other.mix.inner(near, m)
            name = self.model.member_names[i] if i >= 0 else ""
            body = self.model.bodies.get(name)
            if isinstance(body, LeafBasis):
                pose = relative_end_pose(self.mix.arrays.members, m, motion)
                own[:] = body.nearest_coordinates(other.model.bodies[name], *pose, theirs)
            else:
                own[:] = theirs
        return motion


def settle_bodies(model: Model, state: State) -> int:
    """Find the inner coordinates of all bodies at the poses their ends have in a state, in place; Newton steps taken."""
    members, count = model.arrays.members, 0
    known: dict[tuple[int, bytes], np.ndarray] = {}
    for name in model.bodies:
        i = model.member_names.index(name)
        d, Q = relative_end_pose(members, i, state)
        pose = np.round(np.concatenate([d / model.arrays.size, Q.ravel()]), 10) + 0.0
        key = int(members.value_at[i]), pose.tobytes()
        if key not in known:
            known[key], taken = inner_at(model, i, d, Q)
            count += taken
        inner_state(model, state, i)[:] = known[key]
    return count


def inner_at(model: Model, i: int, d: np.ndarray, Q: np.ndarray) -> tuple[np.ndarray, int]:
    """Inner coordinates of member i with its end q held at d (3,) m, Q (3, 3) in the frame of end p; and Newton steps taken.

    In one go or along the way there; those of rest where none are found: the equilibrium of the mechanism may yet find them.

    A Newton step of a whole mechanism from inner coordinates of rest and ends turned by tens of degrees is lost at once: the
    directors between the ends are far from unit length, and that energy is membrane energy.
    """
    arrays, rest = single_member(model, i)
    work, taken = make_workspace(arrays), 0
    d0, Q0 = relative_end_pose(model.arrays.members, i, model.rest)
    turn = Rotation.from_matrix(Q @ Q0.T).as_rotvec()
    unturned = Rotation.from_rotvec(-0.5 * turn).apply(d)
    for steps in WAYS_THERE:
        motion, reason = rest.copy(), int(Stop.CONVERGED)
        for share in np.linspace(1 / steps, 1, steps):
            # along an arc
            chord = (1 - share) * d0 + share * unturned
            arrays.members.offset[0, 1] = Rotation.from_rotvec(0.5 * share * turn).apply(chord)
            arrays.members.frame[0, 1] = Rotation.from_rotvec(share * turn).as_matrix() @ Q0
            reason, count, *_ = solve_equilibrium(
                arrays, motion, np.zeros(0), 1.0, work, 1e-6, MOST_SETTLING, MAX_TURN_PER_STEP, math.inf
            )
            taken += count
            if reason != Stop.CONVERGED:
                break
        else:
            return motion.inner, taken
    return rest.inner, taken


def solve_by_steps(model: Model, values: Mapping[str, float]) -> Configuration:
    """Equilibrium of a model with reduced bodies at drive values by name [m or rad], by load steps.

    Raises ConvergenceError.
    """
    try:
        return solve_in_either_order(model, values)
    except ConvergenceError as reason:
        loose = reason.reached == 0.0 and any(model.bodies[n].solid.is_2d for n in model.solids)
        flat = (
            "; a solid meshed in 2D resists nothing out of its plane: hold that by supports" if loose else ""
        )
        trained = "" if model.full is None else ", take expansion='trained'"
        raise ConvergenceError(
            f"basis no longer successful, or no equilibrium: {reason}{flat}; ask for less, raise internal or order"
            f"{trained}, or use another method",
            reached=reason.reached,
            result=reason.result,
        ) from reason


def with_error_indicator(found: Configuration) -> Configuration:
    """The configuration with its error estimate, and a doubt where a basis was no longer successful."""
    model = found.model
    estimate, step = error_indicator(model, found.motion, model.targets(found.targets), found.load_factor)
    # the last step is the one that says whether it converged
    found = replace(found, method_error=estimate, steps=(*found.steps[:-1], step, found.steps[-1]))
    if estimate.relative <= SUCCESSFUL:
        return found
    name, stroke, turn = most_bent_body(model, found.motion)
    said = f"{100 * estimate.relative:.2g} %" if math.isfinite(estimate.relative) else "beyond measure"
    if name in model.solids:
        where = (
            f"solid '{name}' at a stroke of {stroke:.2g} L and its face turned {np.rad2deg(turn):.3g} degrees"
        )
        advice = "ask for less, or reduce the solid with more internal modes or order=3"
    else:
        where = f"leaf '{name}' at a stroke of {stroke:.2g} L and bent {np.rad2deg(turn):.3g} degrees from its chord"
        joints = found.steps[-1].name.startswith("4") and len(model.bodies) < len(model.member_names)
        advice = "take relinearisations=1 or name the condensed joints too, or " if joints else ""
        advice += (
            "use ksd.ModalBasis() with coordinates='director', frame='chord', more internal modes, or "
            "expansion='trained'"
        )
    good = "" if model.bodies[name].trained else f" ({validity(model, leaf=name).sentence})"
    doubt = f"basis no longer successful: its estimated error is {said}, with {where}{good}; {advice}"
    return replace(found, doubts=(*found.doubts, doubt))
