"""The five-step method of one model, prepared for many configurations.

The steps of `ksd.solvers.five_steps` are taken without checks between them; trained ranges and stability are checked
afterwards. All is in space: links and condensed joints have few unknowns, and in the plane the conventional solver is as
fast.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ksd.answers.divergence import count_unstable_directions
from ksd.answers.mesh_adequacy import mode_adequacy
from ksd.errors import ConvergenceError, KinematicsError
from ksd.joints.joints import JointBodies
from ksd.joints.mobility import MotionCompatibility, check_mobility
from ksd.model.arrays import carries_load
from ksd.model.compile import Model
from ksd.numerics.stopwatch import Stopwatch
from ksd.solvers.branch_check import FEW_ITERATIONS, MANY_ITERATIONS, loads_dominate, slow_step_doubts
from ksd.solvers.configuration import Configuration
from ksd.solvers.five_steps import (
    FiveStepsStorage,
    close_joints,
    kinematic_forces,
    read_answer_motions,
    run_five_steps,
)
from ksd.solvers.joint_motions import stored_joint_motions
from ksd.solvers.joint_range import is_far_off, is_outside
from ksd.solvers.loading_order import compression
from ksd.solvers.method_error import (
    MAX_ONE_STEP_ERROR,
    MAX_ONE_STEP_ERROR_RELINEARISED,
    correct,
    error_to_stored_state,
    full_model_negatives,
)
from ksd.solvers.pose_batch import Judged
from ksd.solvers.steps import Step, Stop, equilibrium_steps
from ksd.solvers.verdict import MAX_HIGHEST_MODE_SHARE, MAX_TURN_PER_POINT, check_trained_range

CLOSURE_TOLERANCE = 2e-3
"""Largest gap of a closed loop over the size of the mechanism: overconstrained joints never fit exactly, which their
elasticity takes up in step 3; a linkage that locks leaves a larger gap."""
LOOSE_CLOSURE_TOLERANCE = 0.03
"""The same where joints are known to be misaligned, or a drive to be met by elasticity alone."""
FIRST_CLOSING_STEP, MIN_CLOSING_STEP = 0.25, 1e-3
"""Fractions of the drive motion: first and smallest step in which loops are closed along the drive."""


class FiveStepSolver:
    """Solves one model by the five-step method; call it with drive values. Not for two threads at once.

    compatibility: how the intended motions of the joints fit together, checked here when None; where they do not fit
    exactly, step 1 may leave a larger gap, which the leaf springs take up. limits (q, 2): motions in which
    it solves. storage: that of a design with the same
    structure, taken over. Raises KinematicsError where drives and supports do not constrain every freedom once.
    """

    def __init__(
        self, model: Model, bodies: JointBodies, *, extrapolate: bool, storage: FiveStepsStorage | None = None,
        compatibility: MotionCompatibility | None = None,
    ) -> None:  # fmt: skip
        self.model, self.extrapolate = model, extrapolate
        self.compatibility = check_mobility(model, bodies) if compatibility is None else compatibility
        self.gap = CLOSURE_TOLERANCE if self.compatibility.is_exact else LOOSE_CLOSURE_TOLERANCE
        self.storage = (
            FiveStepsStorage(model, bodies) if storage is None else storage.for_design(model, bodies)
        )
        self.limits = self.storage.limits[:, :2] + ((-np.inf, np.inf) if extrapolate else 0.0)
        self._expected = len(model.drive_names) + len(model.support_names)

    def __call__(
        self,
        values: Mapping[str, float],
        target: np.ndarray,
        *,
        method: str,
        relinearisations: int,
        estimate: bool,
        accuracy: float | None = None,
        chosen: str = "",
    ) -> Configuration:
        """Solve at drive values by name and their right-hand sides target (c,); options as in `ksd.solve`.

        accuracy: relative error of "reduced" above which the solve goes on as "full"; None where the method was named.
        chosen: see `Step`, empty where it was named.
        Raises RangeError, ConvergenceError, KinematicsError.
        """
        if method == "kinematic" and self.compatibility.unmet_drives:
            raise KinematicsError(
                f"method 'kinematic' knows no force of '{self.compatibility.unmet_drives[0]}': no intended motion of the "
                "joints meets it, elasticity alone does; use method='reduced' or 'full'"
            )
        b = self.storage
        way = target, method, relinearisations, self.gap, self.limits
        steps, negatives = run_five_steps(b, *way)
        if steps[0].stop != 0 or not steps[0].residual < self.gap * b.bodies.reduced.size:
            closing = _close_along_drive(b, target, self.gap, steps[0])
            steps, negatives = run_five_steps(b, *way, closed=True)
            steps.insert(0, closing)
        notes = []
        if is_outside(b.theta, b.limits, 0):
            notes = check_trained_range(b, b.theta, extrapolate=self.extrapolate)
        _require_convergence(steps)
        error = None
        if estimate and method == "reduced":
            enough = MAX_ONE_STEP_ERROR_RELINEARISED if relinearisations else MAX_ONE_STEP_ERROR
            error, more, negatives = correct(b, target, accuracy=min(enough, accuracy or enough))
            steps += more
            if accuracy is not None and len(more) > 1:
                method, error = "full", None
        elif method == "reduced":
            # condensed joints cannot buckle: the inertia is that of the full model at the recovered state
            negatives = full_model_negatives(b, target)
        read_answer_motions(b)
        joint_motions = stored_joint_motions(b)
        if method == "kinematic":
            clock = Stopwatch()
            kinematic_forces(b, target)
            steps[-1] = steps[-1]._replace(time=steps[-1].time + clock())
            negatives = len(target)
        elif steps[-1].stop is Stop.CONVERGED:
            negatives = count_unstable_directions(self.model, b.full_state, 1.0, negatives)
        doubts = slow_step_doubts(equilibrium_steps(steps))
        if chosen:
            steps[-1] = steps[-1]._replace(chosen=chosen)
        found = Configuration(
            self.model, b.full_state.copy(), method, dict(values), tuple(steps), negatives=negatives,
            expected_negatives=self._expected, joint_motions=joint_motions, method_error=error,
            notes=(*notes, *self._assembly_note(steps[0].residual)), doubts=doubts,
            method_was_chosen=bool(chosen) and method == "reduced", joints_near_intended=bool(b.checks[1] == 1),
        )  # fmt: skip
        return self._with_error(found, target) if estimate and method == "kinematic" else found

    def is_evidently_solved(self, target: np.ndarray, pose: Judged) -> bool:
        """Whether a converged pose of a batch, whose state is in the storage, is solved without doubt: a minimum of energy,
        all joints near their intended motion, found in few iterations, its leaf springs resolved by their modes, and
        none under loads so compressed that the loading order may decide.

        Of tabulated joints the state inside is not known, and not checked.
        """
        b, model = self.storage, self.model
        if pose.negatives != self._expected or pose.iterations > MANY_ITERATIONS or not model.conservative:
            return False
        if not pose.steps:
            few = pose.iterations <= FEW_ITERATIONS or not carries_load(model.arrays)
            return few and not is_far_off(b.unintended, b.bodies.kinematics.length, 0)
        if b.checks[1] != 1 or loads_dominate(model, b.full_state, target, pose.iterations):
            return False
        share, _, _, turn = mode_adequacy(model, b.full_state)
        if share > MAX_HIGHEST_MODE_SHARE or turn >= MAX_TURN_PER_POINT:
            return False
        if carries_load(model.arrays) and compression(model, b.full_state):
            return False
        is_full = pose.steps[-1].name.startswith("5")
        return is_full or full_model_negatives(b, target) == self._expected

    def _assembly_note(self, gap: float) -> tuple[str, ...]:
        """The warning about the gap [m] that the leaf springs take up, where intended motions do not fit together."""
        if self.compatibility.is_exact:
            return ()
        reasons = [f"no intended motion meets '{n}'" for n in self.compatibility.unmet_drives]
        if self.compatibility.misalignment > 0:
            off = f"{1e3 * self.compatibility.misalignment:.2g} mrad"
            reasons.insert(0, f"the joints are overconstrained and misaligned by {off}")
        taken_up = f"step 1 left a gap of {1e3 * gap:.2g} mm, which the leaf springs take up by force"
        return (f"{'; '.join(reasons)}: {taken_up}",)

    def _with_error(self, answer: Configuration, target: np.ndarray) -> Configuration:
        """A kinematic result with its error: the distance to the reduced result plus the error estimate of that."""
        reduced = self(answer.targets, target, method="reduced", relinearisations=0, estimate=True)
        assert reduced.method_error is not None
        error = error_to_stored_state(answer.motion, self.storage, reduced.method_error)
        extra = reduced.steps[2:]
        time, iterations = sum(s.time for s in extra), sum(s.iterations for s in extra)
        last = Step(
            "error estimate", iterations, time, extra[-1].residual, extra[-1].stop, "by steps 3 and 4"
        )
        return replace(answer, steps=(*answer.steps, last), method_error=error, negatives=reduced.negatives)


def _close_along_drive(b: FiveStepsStorage, target: np.ndarray, gap: float, tried: Step) -> Step:
    """Step 1 along the drive, in steps that are halved on failure, after it failed in the one step `tried`.

    gap: see `run_five_steps`. Raises ConvergenceError with the fraction of the drive motion reached.
    """
    b.restart()
    clock, done, size = Stopwatch(), 0.0, FIRST_CLOSING_STEP
    iterations, open_gap = tried.iterations, 0.0
    while done < 1.0 and size > MIN_CLOSING_STEP:
        theta, last_closed = b.theta.copy(), b.reduced_state.copy()
        goal = min(1.0, done + size)
        reason, count, open_gap = close_joints(b, goal * target)
        iterations += count
        if reason == 0 and open_gap < gap * b.bodies.reduced.size:
            done = goal
            continue
        b.theta[:] = theta
        b.reduced_state.assign(last_closed)
        size *= 0.5
    if done < 1.0:
        raise ConvergenceError(
            f"the joints cannot reach this pose by their intended motions: the drives got to {100 * done:.3g} % of "
            "the way, where the linkage locks; ask for less, or use method='conventional'",
            reached=done,
        )
    time = tried.time + clock()
    return Step(tried.name, iterations, time, open_gap, Stop.CONVERGED, "in steps along the drive")


def _require_convergence(steps: Sequence[Step]) -> None:
    """Raise ConvergenceError for the first step that did not converge."""
    for k, step in enumerate(steps):
        if step.stop is not Stop.CONVERGED:
            raise ConvergenceError(
                f"step '{step.name}' stopped after {step.iterations} iterations: {step.stop.sentence}; "
                "try method='conventional'",
                reached=0.0,
                result=tuple(steps[: k + 1]),
            )
