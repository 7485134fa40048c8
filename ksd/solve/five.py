"""The five steps of one model, prepared for many configurations.

One compiled call does all steps of a configuration (`ksd.solve.space_steps`); what happens between is looked at
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
from ksd.solve.estimate import distance, estimate_error
from ksd.solve.following import counted
from ksd.solve.joint_motions import read_motions
from ksd.solve.load_steps import MANY_ITERATIONS, slow_step_doubts
from ksd.solve.space_steps import (
    FULL,
    KINEMATIC,
    REDUCED,
    FiveStepsStorage,
    close_joints,
    kinematic_forces,
    space_steps,
)
from ksd.solve.steps import FiveStepRecord, Step, Stop
from ksd.solve.verdict import trained_range

_CODES = {"kinematic": KINEMATIC, "reduced": REDUCED, "full": FULL}


GAP = 2e-3
"""Largest gap of the closed loops over the size of the mechanism: overconstrained joints never fit exactly, and their
elasticity takes it up in step 3; a linkage that locks leaves more."""
YIELDING = 0.03
"""The same where joints are known not to be aligned, or a drive is known to be met by elasticity alone."""


class FiveSteps:
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
        self.gap = GAP if self.fit.is_exact else YIELDING
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
            self.insist_on_motions()
        b, code = self.storage, _CODES[method]
        record, negatives = space_steps(b, target, code, relinearisations, self.gap)
        first = None
        if record[0][0] != 0 or not record[0][2] < self.gap * b.bodies.reduced.size:
            first = _closed_along(b, target, self.gap, record[0])
            record, negatives = space_steps(b, target, code, relinearisations, self.gap, closed=True)
        inside, intended = b.seen.tolist()
        arrived = record[-1][0] == 0
        notes = [] if arrived and inside else trained_range(b, b.theta, extrapolate=self.extrapolate)
        steps = FiveStepRecord(record, relinearisations, first=first)
        if not arrived or first is not None:
            _insist(steps)
        error = None
        joint_motions = read_motions(
            b.bodies, b.joint_names, b.found.copy(), b.off.copy(), b.known, intended=intended == 1
        )
        if method == "kinematic":
            clock = Stopwatch()
            kinematic_forces(b, target)
            steps.rows[-1][3] += clock()
            negatives = len(target)
        elif estimate and method == "reduced":
            # condensed joints cannot buckle: the inertia is that of the full model at the recovered state
            error, step, negatives = estimate_error(b, target, relinearised=relinearisations > 0)
            steps.more = (step,)
        if method != "kinematic" and steps.last is Stop.CONVERGED:
            negatives = counted(self.model, b.full, 1.0, negatives)
        doubts = (
            slow_step_doubts(s for s in steps if s.name[0] in "35") if steps.wandered(MANY_ITERATIONS) else ()
        )
        found = Configuration(
            self.model, b.full.copy(), method, dict(values), steps, negatives=negatives, expected=self._expected,
            joint_motions=joint_motions, method_error=error, notes=(*notes, *self._said(steps)), doubts=doubts,
            intended=intended == 1,
        )  # fmt: skip
        return self._with_error(found, target, steps) if estimate and method == "kinematic" else found

    def insist_on_motions(self) -> None:
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
        error = distance(answer.motion, self.storage, reduced.method_error)
        extra = reduced.steps[2:]
        spent, counted = sum(s.time for s in extra), sum(s.iterations for s in extra)
        last = Step("error estimate", counted, spent, extra[-1].residual, extra[-1].stop, "by steps 3 and 4")
        steps.more = (last,)
        return replace(answer, method_error=error, negatives=reduced.negatives)


def _closed_along(b: FiveStepsStorage, target: np.ndarray, gap: float, tried: list[float]) -> Step:
    """Step 1 along the drive, after the whole of it was `tried`; ConvergenceError says how far it got. gap: as GAP."""
    b.restart()
    clock, done, size, count, left = Stopwatch(), 0.0, 0.25, int(tried[1]), 0.0
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
    return Step("1 close loops", count, tried[3] + clock(), left, Stop.CONVERGED, "in steps along the drive")


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
