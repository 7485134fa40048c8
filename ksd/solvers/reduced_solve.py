"""Mechanisms with reduced bodies: modal leaves and solids beside leaf springs in full and condensed joints.

In load steps from rest reduced bodies are members like all others. Where records place the joints, the solve starts from
steps 1 and 2 of the five-step method: all links are placed, joints without reduced leaf springs are condensed, and the
inner coordinates of the bodies are brought to equilibrium with their ends fixed there. Step 3 is the equilibrium of
links, condensed joints and all other members, step 4 the recovery of the condensed joints.
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

from ksd.answers.printing import format_number
from ksd.checks import show
from ksd.errors import ConvergenceError, KinematicsError, RangeError, RecordError, SceneError
from ksd.joints.joints import joint_bodies
from ksd.joints.partly_condensed import condense_some_joints, single_member
from ksd.modal.choices import ModalBasis
from ksd.modal.leaf_basis import LeafBasis
from ksd.modal.leaf_bodies import full_model_state, with_chains, with_modal_bodies
from ksd.modal.solid_basis import SolidBasis, with_solids
from ksd.model.arrays import Arrays, State, make_workspace
from ksd.model.compile import Model
from ksd.model.newton import RTOL, assemble, solve_equilibrium
from ksd.model.reduced_bodies import inner_state, relative_end_pose, transfer_state
from ksd.model.turns import copy_angles
from ksd.numerics.blocks import factor_blocks
from ksd.numerics.stopwatch import Stopwatch
from ksd.solvers.configuration import Configuration
from ksd.solvers.five_step_solver import FiveStepSolver
from ksd.solvers.five_steps import (
    assemble_full_state,
    condense_joint_bodies,
    read_answer_motions,
    recover_substructures,
)
from ksd.solvers.full_bodies import error_indicator
from ksd.solvers.joint_motions import stored_joint_motions
from ksd.solvers.load_steps import LoadPath, take_load_steps
from ksd.solvers.loading_order import Order, solve_in_order
from ksd.solvers.steps import MAX_TURN_PER_STEP, Step, Stop
from ksd.solvers.validity import most_bent_body, validity

MAX_OUT_OF_PLANE_SHARE = 1e-5
"""Load of a leaf spring out of its plane, over that in it, above which a basis of that plane alone is refused."""
MAX_BASIS_ERROR = 0.05
"""Estimated relative error above which a basis is no longer successful."""
MAX_BODY_ITERATIONS, BODY_TOLERANCE = 40, 1e-6
"""Newton iterations and residual tolerance for the inner coordinates of one body with fixed ends."""
LOAD_PARTS = (1, 2, 4, 8, 16)
"""Numbers of equal parts in which drives and loads are applied together, tried in this order."""
SMALLEST_LOAD_STEP = 1 / 128
"""Smallest step of the loads, with the drives in place."""
TURN_PARTS = (1, 2, 4, 8, 16)
"""Numbers of equal steps in which the ends of a body are turned from rest to their poses, tried in this order."""
PLACEMENT_ERRORS = (RecordError, RangeError, KinematicsError, SceneError)
"""Errors by which records cannot place a mechanism; load steps from rest need no records."""


def named_bases(model: Model, basis: object) -> dict[str, ModalBasis | SolidBasis]:
    """The basis of every leaf of `model` that is to be reduced, by full name of the leaf.

    basis: one `ksd.ModalBasis` for all leaves (the default one when None), or a mapping by name of a leaf, of a joint for
    all its leaf springs, or of a flexible constraint. Raises SceneError for another name, and for what is no basis.
    """
    if basis is None or isinstance(basis, ModalBasis):
        return dict.fromkeys(model.member_names, ModalBasis() if basis is None else basis)
    if not isinstance(basis, Mapping):
        raise SceneError(f"basis = {show(basis)}: give a ksd.ModalBasis, or several by joint or leaf")
    if not basis:
        raise SceneError("basis = {}: name at least one joint or leaf, or give one ksd.ModalBasis for all")
    if has_solids(basis) and any(isinstance(body, ModalBasis) for body in basis.values()):
        # the error of the meshes of both would not be known
        raise SceneError(
            "basis: solids and modal bodies cannot be combined; name the solids alone, other leaf springs stay as they are"
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
    """Whether a mapping of bases has reduced solids."""
    return isinstance(basis, Mapping) and any(isinstance(b, SolidBasis) for b in basis.values())


class ReducedBodySolver:
    """A mechanism with reduced bodies, prepared for repeated solves.

    basis: see `named_bases`; condense_joints: whether joints without reduced leaves are condensed by their records.
    Raises the errors of `named_bases`, `with_modal_bodies` and `with_solids`; where joints are condensed, or a basis is
    expanded about their trained configuration, also those of `joint_bodies`, and SceneError for leaf springs with weight.
    """

    def __init__(
        self, model: Model, basis: object, *, condense_joints: bool, records: Any, extrapolate: bool
    ) -> None:
        model = with_chains(model, {})
        bases = named_bases(model, basis)
        self.modal = {n: b for n, b in bases.items() if isinstance(b, ModalBasis)}
        solids = {n: b for n, b in bases.items() if isinstance(b, SolidBasis)}
        full = with_chains(model, self.modal) if self.modal else model
        self.full = with_solids(full, solids) if solids else full
        joints = [model.member_names[own] for own in model.joint_members]
        condensed = [condense_joints and not any(n in bases for n in own) for own in joints]
        within = {n for own in joints for n in own}
        trained = {n for n, b in self.modal.items() if b.expansion == "trained"} & within
        self.placed: _PlacedByRecords | None = None
        self.needs_records = any(condensed) or bool(trained)
        if not condense_joints and not trained:
            return
        with contextlib.suppress(*() if self.needs_records else PLACEMENT_ERRORS):
            steps = _five_step_solver(model, records, extrapolate)
            self.placed = _PlacedByRecords(steps, self.full, self.modal, condensed, trained)

    @cached_property
    def at_rest(self) -> Model:
        """The model with all bodies, their bases expanded at the undeformed configuration."""
        return with_modal_bodies(self.full, self.modal) if self.modal else self.full

    def __call__(
        self, values: Mapping[str, float], *, relinearisations: int = 0, order: Order = "loads"
    ) -> Configuration:
        """Solve at drive values by name [m or rad]. relinearisations: steps in which the joints are condensed again; order:
        see `ksd.solvers.loading_order`.

        Raises RangeError, and ConvergenceError ("basis no longer successful") where no reduced equilibrium is found.
        """
        if self.placed is not None and self.needs_records:
            return self.placed(values, relinearisations)
        if self.placed is not None:
            # takes a few iterations from there, and tens of them from rest
            with contextlib.suppress(ConvergenceError, RangeError):
                return self.placed(values, 0)
        return solve_bodies_by_load_steps(self.at_rest, values, order)


def _five_step_solver(model: Model, records: Any, extrapolate: bool) -> FiveStepSolver:
    """The five-step solver of a model with leaf springs in full. Raises SceneError for leaf springs with weight."""
    if len(model.arrays.weight):
        raise SceneError(
            "leaf springs with weight cannot be combined with modal bodies: compile without='gravity', or use another method"
        )
    return FiveStepSolver(
        model, joint_bodies(model, records, extrapolate=extrapolate), extrapolate=extrapolate
    )


class _PlacedByRecords:
    """A mechanism of reduced bodies and condensed joints, placed by the joints' records.

    five_steps: solver of the model with leaf springs in full; full: model in which modal leaves are chains, with its solids;
    modal: bases of the modal leaves; condensed: whether each joint is condensed; trained: leaf springs whose basis is
    expanded at the configuration in which the records place them.
    """

    def __init__(
        self,
        five_steps: FiveStepSolver,
        full: Model,
        modal: Mapping[str, ModalBasis],
        condensed: Sequence[bool],
        trained: set[str],
    ) -> None:
        self.five_steps, self.full, self.modal = five_steps, full, modal
        self.condensed, self.trained = condensed, trained
        self.model, self.storage = five_steps.model, five_steps.storage
        # load steps from rest are the alternative where no record is needed
        self.only_one_part = not any(condensed) and not trained

    @cached_property
    def at_rest(self) -> _MixedModel:
        """The mixed model with all bases expanded at rest."""
        return self._mixed_model(None)

    @cached_property
    def _untrained(self) -> Model:
        """The model with trained leaves on a basis expanded at rest, which gives the state at which to expand theirs."""
        plain = {n: ModalBasis(elements=self.modal[n].elements) for n in self.trained}
        return with_modal_bodies(self.full, plain)

    def _present_model(self) -> _MixedModel:
        """The mixed model at the configuration in storage; made once, unless a basis is expanded at that."""
        if not self.trained:
            return self.at_rest
        state = transfer_state(self.model, self.storage.full_state, self._untrained)
        equilibrate_bodies(self._untrained, state)
        return self._mixed_model(full_model_state(self._untrained, state)[1])

    def _mixed_model(self, about: State | None) -> _MixedModel:
        """The mixed model with trained bases expanded at a state of `full`; a large basis gets a smaller one to start
        from."""
        parts = self.storage.bodies.reduced, self.condensed
        expansion: dict[str, Any] = {"about": about, "at_rest": set(self.modal) - self.trained}
        smaller = None
        if any(b.large for b in self.modal.values()):
            bases = {n: b.smaller if b.large else b for n, b in self.modal.items()}
            smaller = _MixedModel(with_modal_bodies(self.full, bases, **expansion), *parts)
        model = with_modal_bodies(self.full, self.modal, **expansion) if self.modal else self.full
        return _MixedModel(model, *parts, smaller)

    def __call__(self, values: Mapping[str, float], relinearisations: int) -> Configuration:
        """Solve at drive values by name [m or rad]. Raises ConvergenceError, RangeError."""
        target, links = self.model.targets(values), self.model.links
        placed, clock = self._place(values, 1.0), Stopwatch()
        mixed = self._present_model()
        steps = [*placed.steps, Step("modal bases", 0, clock(), 0.0, Stop.CONVERGED)]
        motion, step_3 = self._equilibrium(mixed, values)
        steps += step_3
        for n in range(relinearisations + 1):
            if n > 0:
                condense_joint_bodies(self.storage, 0)
                self._copy_condensed_joints(mixed, motion)
                step, _ = mixed.solve(motion, target, 1.0, smallest_step=1.0)
                if step.stop is not Stop.CONVERGED:
                    raise ConvergenceError(
                        f"in relinearisation step {n} {step.stop.sentence}: the loads bend the joints too far from their "
                        "intended motion to condense them there; take fewer relinearisations, or use method='full'"
                    )
                steps.append(step)
            reduced = self.storage.reduced_state
            reduced.x[:], reduced.R[:] = motion.x[:links], motion.R[:links]
            copy_angles(mixed.mix.arrays, motion, self.storage.bodies.reduced, reduced, of=slice(links))
            clock()
            shift, _ = recover_substructures(self.storage)
            steps.append(Step("4 recovery", 0, clock(), shift, Stop.CONVERGED))
        return self._configuration(mixed, motion, values, steps, placed.notes)

    def _place(self, values: Mapping[str, float], share: float) -> Configuration:
        """Take steps 1 and 2 at a share of the drive values; the result is in storage."""
        part = {name: float(share * value) for name, value in values.items()}
        return self.five_steps(
            part, self.model.targets(part), method="kinematic", relinearisations=0, estimate=False
        )

    def _equilibrium(self, mixed: _MixedModel, values: Mapping[str, float]) -> tuple[State, list[Step]]:
        """Step 3 from the result of steps 1 and 2, in parts of drives and loads where the whole of them fails.

        With large bases it starts from the equilibrium with smaller ones. Raises ConvergenceError.
        """
        target, failed = self.model.targets(values), None
        if mixed.smaller is not None:
            start, steps = self._equilibrium(mixed.smaller, values)
            motion = mixed.state_from(mixed.smaller, start)
            step, reached = mixed.solve(motion, target, 1.0, smallest_step=SMALLEST_LOAD_STEP)
            if step.stop is Stop.CONVERGED:
                return motion, [*steps[:-1], step]
            failed = step, reached
        for parts in () if failed else LOAD_PARTS[: 1 if self.only_one_part else None]:
            for k in range(1, parts + 1):
                if parts > 1:
                    self._place(values, k / parts)
                if k == 1:
                    motion, first_step = self._initial_state(mixed)
                    steps = [first_step]
                self._copy_condensed_joints(mixed, motion)
                smallest_step = SMALLEST_LOAD_STEP if parts == 1 and not self.only_one_part else 1.0
                step, reached = mixed.solve(
                    motion, k / parts * target, k / parts, smallest_step=smallest_step
                )
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

    def _initial_state(self, mixed: _MixedModel) -> tuple[State, Step]:
        """The result of steps 1 and 2 as a state of the mixed model, with the bodies in equilibrium between fixed ends."""
        clock, mix, model = Stopwatch(), mixed.mix, mixed.model
        state = transfer_state(self.model, self.storage.full_state, model)
        count = equilibrate_bodies(model, state)
        motion = mix.rest.copy()
        motion.x[:], motion.R[:] = state.x[mix.nodes], state.R[mix.nodes]
        copy_angles(model.arrays, state, mix.arrays, motion, of=mix.nodes)
        for m in np.flatnonzero(mix.member >= 0).tolist():
            own = inner_state(mix.arrays.members, m, motion)
            own[:] = inner_state(model.arrays.members, int(mix.member[m]), state)
        return motion, Step("bodies settled", count, clock(), 0.0, Stop.CONVERGED, "ends held")

    def _copy_condensed_joints(self, mixed: _MixedModel, motion: State) -> None:
        """Copy the condensed joints of step 2 into a state of the mixed model."""
        source = self.storage.reduced_state.inner
        for m in np.flatnonzero(mixed.mix.joint >= 0).tolist():
            own = inner_state(mixed.mix.arrays.members, m, motion)
            own[:] = source[len(own) * mixed.mix.joint[m] :][: len(own)]

    def _configuration(
        self,
        mixed: _MixedModel,
        motion: State,
        values: Mapping[str, float],
        steps: list[Step],
        notes: tuple[str, ...],
    ) -> Configuration:
        """The configuration of the model with all leaf springs, recovered from a state of the mixed model."""
        b, mix, model = self.storage, mixed.mix, mixed.model
        assemble_full_state(b)
        state = transfer_state(self.model, b.full_state, model)
        state.x[mix.nodes], state.R[mix.nodes] = motion.x, motion.R
        copy_angles(mix.arrays, motion, model.arrays, state, nodes=mix.nodes)
        state.multiplier[:] = motion.multiplier
        for m in np.flatnonzero(mix.member >= 0).tolist():
            source = inner_state(mix.arrays.members, m, motion)
            inner_state(model.arrays.members, int(mix.member[m]), state)[:] = source
        # the pivots are those of the model with all leaf springs: condensed joints cannot buckle
        work, plan = make_workspace(model.arrays), model.arrays.plan
        _, _, member_negatives, _ = assemble(model.arrays, state, model.targets(values), 1.0, work)
        negatives, _ = factor_blocks(plan.ints, work.matrix, work.scaled_rows, len(plan.size))
        read_answer_motions(b)
        expected = len(model.drive_names) + len(model.support_names)
        return Configuration(
            model, state, "modal", dict(values), tuple(steps), negatives=int(negatives + member_negatives),
            expected_negatives=expected, joint_motions=stored_joint_motions(b), notes=notes,
            joints_near_intended=bool(b.checks[1]),
        )  # fmt: skip


class _MixedModel:
    """A model with reduced bodies in which some joints are condensed (`mix`), with its workspace.

    linear: arrays of links and condensed joints; condensed: whether each joint is condensed; smaller: the same model with
    smaller bases, from whose equilibrium that of large bases starts.
    """

    def __init__(
        self, model: Model, linear: Arrays, condensed: Sequence[bool], smaller: _MixedModel | None = None
    ) -> None:
        self.model, self.smaller, self.mix = model, smaller, condense_some_joints(model, linear, condensed)
        self.work = make_workspace(self.mix.arrays)

    def solve(
        self, motion: State, target: np.ndarray, factor: float, *, smallest_step: float
    ) -> tuple[Step, float]:
        """Step 3, in place, at drives target (c,) and loads times factor, in load steps down to `smallest_step`.

        Returns the step and the fraction of the loads reached.
        """
        clock, arrays = Stopwatch(), self.mix.arrays

        def newton(state: State, values: np.ndarray, load_factor: float, *settings: Any) -> Any:
            return solve_equilibrium(arrays, state, values, load_factor, self.work, *settings)

        path = LoadPath(target, target, (0.0, factor), smallest_step=1.0)
        record = take_load_steps(motion, newton, path, pivoting=(arrays, self.work))
        if record.stop is not Stop.CONVERGED and smallest_step < 1.0:
            # first to the equilibrium without loads, which the configuration of the records is not
            reason, count, *_ = newton(
                motion, target, 0.0, RTOL, path.max_iterations, MAX_TURN_PER_STEP, math.inf
            )
            if reason == Stop.CONVERGED:
                path = path._replace(smallest_step=smallest_step)
                loaded = take_load_steps(motion, newton, path, pivoting=(arrays, self.work))
                record = loaded._replace(
                    factorisations=record.factorisations + count + loaded.factorisations,
                    steps_tried=loaded.steps_tried + 1,
                )
        note = f"{record.steps_tried} load steps" if record.steps_tried > 1 else ""
        step = Step(
            "3 reduced equilibrium", record.factorisations, clock(), record.residual, record.stop, note
        )
        return step, record.fraction_reached

    def state_from(self, other: _MixedModel, theirs: State) -> State:
        """The state of this model nearest to a state of the same bodies with other bases."""
        motion = self.mix.rest.copy()
        motion.x[:], motion.R[:], motion.multiplier[:] = theirs.x, theirs.R, theirs.multiplier
        motion.angle[:] = theirs.angle
        for m, i in enumerate(self.mix.member.tolist()):
            own_inner = inner_state(self.mix.arrays.members, m, motion)
            their_inner = inner_state(other.mix.arrays.members, m, theirs)
            name = self.model.member_names[i] if i >= 0 else ""
            body = self.model.bodies.get(name)
            if isinstance(body, LeafBasis):
                pose = relative_end_pose(self.mix.arrays.members, m, motion)
                own_inner[:] = body.nearest_coordinates(other.model.bodies[name], *pose, their_inner)
            else:
                own_inner[:] = their_inner
        return motion


def equilibrate_bodies(model: Model, state: State) -> int:
    """Find the inner coordinates of all bodies at the poses that their ends have in a state, in place.

    Returns the number of Newton steps.
    """
    members, count = model.arrays.members, 0
    known: dict[tuple[int, bytes], np.ndarray] = {}
    for name in model.bodies:
        i = model.member_names.index(name)
        d, Q = relative_end_pose(members, i, state)
        pose = np.round(np.concatenate([d / model.arrays.size, Q.ravel()]), 10) + 0.0
        key = int(members.value_at[i]), pose.tobytes()
        if key not in known:
            known[key], steps = inner_equilibrium(model, i, d, Q)
            count += steps
        inner_state(members, i, state)[:] = known[key]
    return count


def inner_equilibrium(model: Model, i: int, d: np.ndarray, Q: np.ndarray) -> tuple[np.ndarray, int]:
    """Inner coordinates of member i with its end q fixed at d (3,) [m], Q (3, 3) in the frame of end p.

    The end is taken there in one step, or in several along an arc. Returns the coordinates, those of rest where none are
    found (the equilibrium of the mechanism may still find them), and the number of Newton steps.

    A Newton step of a whole mechanism from inner coordinates of rest and ends turned by tens of degrees fails at once: the
    directors between the ends are far from unit length, and that energy is membrane energy.
    """
    arrays, rest = single_member(model, i)
    work, taken = make_workspace(arrays), 0
    d0, Q0 = relative_end_pose(model.arrays.members, i, model.rest)
    turn = Rotation.from_matrix(Q @ Q0.T).as_rotvec()
    unturned = Rotation.from_rotvec(-0.5 * turn).apply(d)
    for parts in TURN_PARTS:
        motion, reason = rest.copy(), int(Stop.CONVERGED)
        for share in np.linspace(1 / parts, 1, parts):
            chord = (1 - share) * d0 + share * unturned
            arrays.members.offset[0, 1] = Rotation.from_rotvec(0.5 * share * turn).apply(chord)
            arrays.members.frame[0, 1] = Rotation.from_rotvec(share * turn).as_matrix() @ Q0
            reason, count, *_ = solve_equilibrium(
                arrays,
                motion,
                np.zeros(0),
                1.0,
                work,
                BODY_TOLERANCE,
                MAX_BODY_ITERATIONS,
                MAX_TURN_PER_STEP,
                math.inf,
            )
            taken += count
            if reason != Stop.CONVERGED:
                break
        else:
            return motion.inner, taken
    return rest.inner, taken


def solve_bodies_by_load_steps(model: Model, values: Mapping[str, float], order: Order) -> Configuration:
    """Equilibrium of a model with reduced bodies at drive values by name [m or rad], by load steps in `order`.

    Raises ConvergenceError.
    """
    try:
        return solve_in_order(model, values, order=order)
    except ConvergenceError as reason:
        is_unsupported = reason.reached == 0.0 and any(model.bodies[n].solid.is_2d for n in model.solids)
        flat = (
            "; a solid meshed in 2D resists nothing out of its plane: hold that by supports"
            if is_unsupported
            else ""
        )
        trained = "" if model.full is None else ", take expansion='trained'"
        raise ConvergenceError(
            f"basis no longer successful, or no equilibrium: {reason}{flat}; ask for less, raise internal or order"
            f"{trained}, or use another method",
            reached=reason.reached,
            result=reason.result,
        ) from reason


def with_plane_check(found: Configuration) -> Configuration:
    """The configuration with a note where bases know the plane of their leaf springs alone. Raises SceneError where such a
    leaf spring carries load out of its plane, which it resists up to ten times too stiffly."""
    bodies = [
        n for n, body in found.model.bodies.items() if isinstance(body, LeafBasis) and body.choices.plane
    ]
    if not bodies:
        return found
    forces = found.section_forces(points=2)
    for name in bodies:
        arm = np.array([1.0, 1.0, 1.0, *3 * [1.0 / forces[name].s[-1]]])
        size = np.abs(forces[name].values).max(axis=0) * arm
        out, within = size[[2, 3, 4]].max(), size[[0, 1, 5]].max()
        if out > MAX_OUT_OF_PLANE_SHARE * within:
            raise SceneError(
                f"leaf '{name}' carries load out of its plane, {format_number(float(out))} N (moments over its length), and "
                "its basis ModalBasis(plane=True) knows deformation in that plane alone; give ksd.ModalBasis(plane=False)"
            )
    others = f" and of {len(bodies) - 1} other leaf springs" if len(bodies) > 1 else ""
    note = (
        f"the basis of '{bodies[0]}'{others} knows deformation in its plane alone (plane=True): stiffness, frequencies and "
        "critical load factors out of that plane are far too high"
    )
    return replace(found, notes=(*found.notes, note))


def with_error_indicator(found: Configuration) -> Configuration:
    """The configuration with its error estimate, and a doubt where a basis is no longer successful."""
    model = found.model
    estimate, step = error_indicator(model, found.motion, model.targets(found.targets), found.load_factor)
    # the last step must be the one that states whether the solve converged
    found = replace(found, method_error=estimate, steps=(*found.steps[:-1], step, found.steps[-1]))
    if estimate.relative <= MAX_BASIS_ERROR:
        return found
    name, stroke, turn = most_bent_body(model, found.motion)
    error = f"{100 * estimate.relative:.2g} %" if math.isfinite(estimate.relative) else "beyond measure"
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
    valid = "" if model.bodies[name].trained else f" ({validity(model, leaf=name).sentence})"
    doubt = f"basis no longer successful: its estimated error is {error}, with {where}{valid}; {advice}"
    return replace(found, doubts=(*found.doubts, doubt))
