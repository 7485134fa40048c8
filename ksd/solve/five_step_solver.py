"""The five steps of one model, prepared for many configurations.

One compiled call does all steps of a configuration (`ksd.solve.five_steps`); what happens between is looked at
afterwards: the trained ranges and the inertia. All is in space: links and condensed joints are few unknowns, and in the
plane the conventional solver is as fast.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ksd.bodies.joints import JointBodies
from ksd.bodies.mobility import MotionCompatibility, check_mobility
from ksd.errors import ConvergenceError, KinematicsError
from ksd.model.compile import Model
from ksd.numerics.stopwatch import Stopwatch
from ksd.solve.configuration import Configuration
from ksd.solve.five_steps import (
    FULL,
    KINEMATIC,
    REDUCED,
    FiveStepsStorage,
    close_joints,
    kinematic_forces,
    run_five_steps,
)
from ksd.solve.joint_motions import checked_joint_motions
from ksd.solve.load_steps import MANY_ITERATIONS, slow_step_doubts
from ksd.solve.method_error import error_to_stored_state, estimate_error
from ksd.solve.nonconservative_stability import count_unstable_directions
from ksd.solve.steps import FiveStepRecord, Step, StepRow, Stop
from ksd.solve.verdict import check_trained_range

_CODES = {"kinematic": KINEMATIC, "reduced": REDUCED, "full": FULL}


CLOSURE_TOLERANCE = 2e-3
"""Largest gap of the closed loops over the size of the mechanism: overconstrained joints never fit exactly, and their
elasticity takes it up in step 3; a linkage that locks leaves more."""
LOOSE_CLOSURE_TOLERANCE = 0.03
"""The same where joints are known not to be aligned, or a drive is known to be met by elasticity alone."""


class FiveStepSolver:
    """Call with drive values; storage is used again each time, so not from two threads at once.

    storage: that of a design of the same words, taken over. fit: how intended motions fit together, looked at when None;
    where they do not, step 1 leaves a larger gap, which the leaf springs take up. Raises KinematicsError where drives and
    supports do not hold every freedom once.
    """

    def __init__(
        self, model: Model, bodies: JointBodies, *, extrapolate: bool, storage: FiveStepsStorage | None = None,
        fit: MotionCompatibility | None = None,
    ) -> None:  # fmt: skip
        self.model, self.extrapolate = model, extrapolate
        self.fit = check_mobility(model, bodies) if fit is None else fit
        self.gap = CLOSURE_TOLERANCE if self.fit.is_exact else LOOSE_CLOSURE_TOLERANCE
        self.storage = FiveStepsStorage(model, bodies) if storage is None else storage.of(model, bodies)
        self._expected = len(model.drive_names) + len(model.support_names)

    def __call__(
        self,
        values: Mapping[str, float],
        target: np.ndarray,
        *,
        method: str,
        relinearisations: int,
        estimate: bool,
    ) -> Configuration:
        """Solve at the right-hand sides `target` (c,). Raises RangeError, ConvergenceError, KinematicsError."""
        if method == "kinematic":
            self.require_kinematic_drives()
        b, code = self.storage, _CODES[method]
        rows, negatives = run_five_steps(b, target, code, relinearisations, self.gap)
        closing_step = None
        if rows[0].stop != 0 or not rows[0].residual < self.gap * b.bodies.reduced.size:
            closing_step = _closed_along(b, target, self.gap, rows[0])
            rows, negatives = run_five_steps(b, target, code, relinearisations, self.gap, closed=True)
        inside, near_intended = b.seen.tolist()
        arrived = rows[-1].stop == 0
        notes = [] if arrived and inside else check_trained_range(b, b.theta, extrapolate=self.extrapolate)
        steps = FiveStepRecord(rows, relinearisations, closing_step=closing_step)
        if not arrived or closing_step is not None:
            _insist(steps)
        error = None
        joint_motions = checked_joint_motions(
            b.bodies, b.joint_names, b.found.copy(), b.off.copy(), b.known, near_intended=near_intended == 1
        )
        if method == "kinematic":
            clock = Stopwatch()
            kinematic_forces(b, target)
            last = steps.rows[-1]
            steps.rows[-1] = last._replace(time=last.time + clock())
            negatives = len(target)
        elif estimate and method == "reduced":
            # condensed joints cannot buckle: the inertia is that of the full model at the recovered state
            error, step, negatives = estimate_error(b, target, relinearised=relinearisations > 0)
            steps.later_steps = (step,)
        if method != "kinematic" and steps.last_stop is Stop.CONVERGED:
            negatives = count_unstable_directions(self.model, b.full, 1.0, negatives)
        doubts = (
            slow_step_doubts(s for s in steps if s.name[0] in "35")
            if steps.exceeded_iterations(MANY_ITERATIONS)
            else ()
        )
        found = Configuration(
            self.model, b.full.copy(), method, dict(values), steps, negatives=negatives, expected_negatives=self._expected,
            joint_motions=joint_motions, method_error=error, notes=(*notes, *self._said(steps)), doubts=doubts,
            joints_near_intended=near_intended == 1,
        )  # fmt: skip
        return self._with_error(found, target, steps) if estimate and method == "kinematic" else found

    def require_kinematic_drives(self) -> None:
        """KinematicsError where intended motions alone say nothing of a drive or support."""
        if self.fit.unmet_drives:
            raise KinematicsError(
                f"method 'kinematic' knows no force of '{self.fit.unmet_drives[0]}': no intended motion of the joints meets "
                "it, elasticity alone does; use method='reduced' or 'full'"
            )

    def _said(self, steps: FiveStepRecord) -> tuple[str, ...]:
        """What the leaf springs had to take up, as a warning."""
        if self.fit.is_exact:
            return ()
        why = [f"the joints are overconstrained and misaligned by {1e3 * self.fit.misalignment:.2g} mrad"] * (
            self.fit.misalignment > 0
        )
        why += [f"no intended motion meets '{n}'" for n in self.fit.unmet_drives]
        said = "; ".join(why)
        return (
            f"{said}: step 1 left a gap of {1e3 * steps[0].residual:.2g} mm, which the leaf springs take up by force",
        )

    def _with_error(self, answer: Configuration, target: np.ndarray, steps: FiveStepRecord) -> Configuration:
        """The kinematic answer, whose error is its distance to the reduced one plus the estimate of that."""
        reduced = self(answer.targets, target, method="reduced", relinearisations=0, estimate=True)
        assert reduced.method_error is not None
        error = error_to_stored_state(answer.motion, self.storage, reduced.method_error)
        extra = reduced.steps[2:]
        spent, counted = sum(s.time for s in extra), sum(s.iterations for s in extra)
        last = Step("error estimate", counted, spent, extra[-1].residual, extra[-1].stop, "by steps 3 and 4")
        steps.later_steps = (last,)
        return replace(answer, method_error=error, negatives=reduced.negatives)


def _closed_along(b: FiveStepsStorage, target: np.ndarray, gap: float, tried: StepRow) -> Step:
    """Step 1 along the drive, after the whole of it was `tried`; ConvergenceError says how far it got. gap: as GAP."""
    b.restart()
    clock, done, size, count, left = Stopwatch(), 0.0, 0.25, int(tried.iterations), 0.0
    while done < 1.0 and size > 1e-3:
        theta, safe = b.theta.copy(), b.reduced.copy()
        goal = min(1.0, done + size)
        reason, more, left = close_joints(b, goal * target)
        count += more
        if reason == 0 and left < gap * b.bodies.reduced.size:
            done = goal
            continue
        b.theta[:] = theta
        b.reduced.assign(safe)
        size *= 0.5
    if done < 1.0:
        raise ConvergenceError(
            f"the joints cannot reach this pose by their intended motions: the drives got to {100 * done:.3g} % of "
            "the way, where the linkage locks; ask for less, or use method='conventional'",
            reached=done,
        )
    return Step(
        "1 close loops", count, tried.time + clock(), left, Stop.CONVERGED, "in steps along the drive"
    )


def _insist(steps: FiveStepRecord) -> None:
    """ConvergenceError saying which step stopped and why, unless all converged."""
    for k, step in enumerate(steps):
        if step.stop is not Stop.CONVERGED:
            raise ConvergenceError(
                f"step '{step.name}' stopped after {step.iterations} iterations: {step.stop.sentence}; "
                "try method='conventional'",
                reached=0.0,
                result=steps[: k + 1],
            )
