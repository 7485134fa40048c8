"""The five steps of one model, prepared for many configurations.

One compiled call does all steps of a configuration (`ksd.solve.space_steps`); what happens between is looked at
afterwards: the trained ranges and the inertia. All is in space: links and condensed joints are few unknowns, and in the
plane the conventional solver is as fast.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ksd.bodies.freedom import Fit, check_freedoms
from ksd.bodies.joints import JointBodies
from ksd.errors import ConvergenceError, KinematicsError
from ksd.model.compile import Model
from ksd.numerics.stopwatch import Stopwatch
from ksd.solve import pipeline
from ksd.solve.configuration import Configuration
from ksd.solve.estimate import distance, estimate_error
from ksd.solve.following import counted
from ksd.solve.load_steps import WANDERED, wandered
from ksd.solve.space_steps import FULL, KINEMATIC, REDUCED, FiveStepsStorage, SpaceState, space_steps
from ksd.solve.steps import FiveStepRecord, Step, Stop
from ksd.solve.verdict import trained_range

_CODES = {"kinematic": KINEMATIC, "reduced": REDUCED, "full": FULL}


class _Moved(NamedTuple):
    """Intended motions theta (q,), what is left off (J, 6), found (J,), of every joint; intended: all are seen near them."""

    theta: np.ndarray
    off: np.ndarray
    found: np.ndarray
    intended: bool


GAP = 2e-3
"""Largest gap of the closed loops over the size of the mechanism: overconstrained joints never fit exactly, and their
elasticity takes it up in step 3; a linkage that locks leaves more."""
YIELDING = 0.03
"""The same where joints are known not to be aligned, or a drive is known to be met by elasticity alone."""


class FiveSteps:
    """Call with drive values; storage is used again each time, so not from two threads at once.

    fit: how intended motions fit together, looked at when None; where they do not, step 1 leaves a larger gap, which the
    leaf springs take up. Raises KinematicsError where drives and supports do not hold every freedom once.
    """

    def __init__(
        self, model: Model, bodies: JointBodies, *, extrapolate: bool, state: SpaceState | None = None,
        fit: Fit | None = None,
    ) -> None:  # fmt: skip
        self.model, self.extrapolate = model, extrapolate
        self.fit = check_freedoms(model, bodies) if fit is None else fit
        self.gap = GAP if self.fit.exact else YIELDING
        self.storage = FiveStepsStorage(model, bodies, state)
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
            first = _closed(b, target, self.gap)
            record, negatives = space_steps(b, target, code, relinearisations, self.gap, closed=True)
        inside, intended = b.seen.tolist()
        arrived = record[-1][0] == 0
        warnings = [] if arrived and inside else trained_range(b, b.theta, extrapolate=self.extrapolate)
        steps = FiveStepRecord(record, relinearisations, first=first)
        if not arrived or first is not None:
            _insist(steps)
        error = None
        moved = _Moved(b.found.copy(), b.off.copy(), b.known, intended=intended == 1)
        if method == "kinematic":
            clock = Stopwatch()
            pipeline.kinematic_forces(b, target)
            steps.rows[-1][3] += clock()
            return self._kinematic((values, target, steps), moved, warnings, estimate=estimate)
        if estimate and method == "reduced":
            # condensed joints cannot buckle: the inertia is that of the full model at the recovered state
            error, step, negatives = estimate_error(b, target, relinearised=relinearisations > 0)
            steps.more = (step,)
        return self._configuration(
            (dict(values), method, steps), moved, negatives=negatives, error=error, warnings=warnings
        )

    def insist_on_motions(self) -> None:
        """KinematicsError where intended motions alone say nothing of a drive or support."""
        if self.fit.yielding:
            raise KinematicsError(
                f"method 'kinematic' knows no force of '{self.fit.yielding[0]}': no intended motion of the joints meets "
                "it, elasticity alone does; use method='reduced' or 'full'"
            )

    def _said(self, steps: FiveStepRecord) -> tuple[str, ...]:
        """What the leaf springs had to take up, as a warning."""
        if self.fit.exact:
            return ()
        why = [f"the joints are overconstrained and misaligned by {1e3 * self.fit.off:.2g} mrad"] * (
            self.fit.off > 0
        )
        why += [f"no intended motion meets '{n}'" for n in self.fit.yielding]
        said = "; ".join(why)
        return (
            f"{said}: step 1 left a gap of {1e3 * steps[0].residual:.2g} mm, which the leaf springs take up by force",
        )

    def _kinematic(
        self,
        solved: tuple[Mapping[str, float], np.ndarray, FiveStepRecord],
        moved: _Moved,
        warnings: list[str],
        *,
        estimate: bool,
    ) -> Configuration:
        """The kinematic answer; its error is its distance to the reduced one plus the estimate of that."""
        values, target, steps = solved
        b = self.storage
        answer = self._configuration(
            (dict(values), "kinematic", steps),
            moved,
            negatives=len(target),
            error=None,
            warnings=warnings,
        )
        if not estimate:
            return answer
        reduced = self(values, target, method="reduced", relinearisations=0, estimate=True)
        assert reduced.method_error is not None
        error = distance(answer.motion, b, reduced.method_error)
        extra = reduced.steps[2:]
        spent, counted = sum(s.time for s in extra), sum(s.iterations for s in extra)
        last = Step("error estimate", counted, spent, extra[-1].residual, extra[-1].stop, "by steps 3 and 4")
        steps.more = (last,)
        return replace(answer, method_error=error, negatives=reduced.negatives)

    def _configuration(
        self,
        solved: tuple[dict[str, float], str, FiveStepRecord],
        moved: _Moved,
        *,
        negatives: int,
        error: Any,
        warnings: list[str],
    ) -> Configuration:
        b, (values, method, steps) = self.storage, solved
        theta, off, found, intended = moved
        joint_motions = pipeline.read_motions(b.bodies, b.joint_names, theta, off, found, intended=intended)
        if method != "kinematic" and steps.last is Stop.CONVERGED:
            negatives = counted(self.model, b.full, 1.0, negatives)
        doubts = wandered(s for s in steps if s.name[0] in "35") if steps.wandered(WANDERED) else ()
        return Configuration(
            self.model, b.full.copy(), method, values, steps, negatives=negatives, expected=self._expected,
            joint_motions=joint_motions,
            method_error=error, notes=(*warnings, *self._said(steps)), doubts=doubts,
            intended=intended,
        )  # fmt: skip


def _closed(b: FiveStepsStorage, target: np.ndarray, gap: float) -> Step:
    """Step 1, in one go or, failing that, along the drive; ConvergenceError says how far it got. gap: as GAP."""
    b.restart()
    step = pipeline.close(b, target)
    if step.stop is Stop.CONVERGED and step.residual < gap * b.bodies.reduced.size:
        return step
    b.restart()
    done, size, count, spent = 0.0, 0.25, step.iterations, step.time
    while done < 1.0 and size > 1e-3:
        theta, safe = b.theta.copy(), b.reduced.copy()
        goal = min(1.0, done + size)
        step = pipeline.close(b, goal * target)
        count, spent = count + step.iterations, spent + step.time
        if step.stop is Stop.CONVERGED and step.residual < gap * b.bodies.reduced.size:
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
    return Step(step.name, count, spent, step.residual, step.stop, "in steps along the drive")


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
