"""One design prepared for batches of poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ksd.design.questions import PoseAnalysis, Questions, Row, answer_batch, answer_questions
from ksd.design.sweep_path import error_sentence
from ksd.errors import SceneError
from ksd.model.arrays import State, Workspace, make_workspace
from ksd.model.compile import Model
from ksd.properties.stiffness import node_of
from ksd.properties.tangent import row_numbers
from ksd.solve.configuration import Configuration
from ksd.solve.error import converge_fast_state
from ksd.solve.five_step_solver import FiveStepSolver
from ksd.solve.five_steps import REDUCED
from ksd.solve.joint_tables import joint_tables
from ksd.solve.pose_batch import (
    STATUS_MESSAGES,
    UNANSWERED,
    UNSTABLE,
    PoseArrays,
    solve_poses,
    solve_tabulated_poses,
)
from ksd.solve.steps import Step, Stop

SOLVED = (Step("in a batch", 0, 0.0, 0.0, Stop.CONVERGED),)
"""Steps of a pose that questions are asked of; one without an equilibrium is asked nothing."""
STIFF = {"support_stiffness", "drive_stiffness"}
"""Questions that are answered on the finer mesh, where it is also seen whether the state there is settled and stable."""
MAX_UNINTENDED_MOTION = 1e-4
"""Unintended motion of joints, in rad and over their length, up to which the Newton step to the finer mesh is tried from the
reduced state itself, which is off by the square of it."""


@dataclass
class DesignResult:
    """Numbers of one design; rows (N): answers by column; reasons: why a question has none, by pose; waiting: poses that are
    asked together with those of other designs, see `answer_deferred`, and whether they are settled; poses: those that were
    solved, where they are kept."""

    links: tuple[str, ...]
    drives: tuple[str, ...]
    joints: tuple[str, ...]
    force: np.ndarray
    x: np.ndarray
    R: np.ndarray
    motion: np.ndarray
    status: np.ndarray
    error: float = np.nan
    rows: list[Row] = field(default_factory=list)
    reasons: dict[int, str] = field(default_factory=dict)
    compliance: np.ndarray | None = None
    deferred: list[tuple[int, PoseAnalysis, bool]] = field(default_factory=list)
    poses: list[Configuration] = field(default_factory=list)

    @property
    def names(self) -> tuple[tuple[str, ...], ...]:
        """Of what the numbers are."""
        return self.links, self.drives, self.joints


class PreparedDesign:
    """One design prepared for batches: call it with drive values, arrays of one length by name.

    keep: the configurations too; settled: forces and poses asked for are of the equilibrium next to the answer, too.
    """

    def __init__(
        self,
        five: FiveStepSolver,
        *,
        method: int = REDUCED,
        relinearisations: int = 0,
        tabulated: bool = False,
        questions: Questions | None = None,
        keep_configurations: bool = False,
        equilibrate: bool = False,
    ) -> None:
        if five.model.mesh.plate:
            raise SceneError(
                "plate stiffening depends on how much each leaf is bent, and is not settled pose by pose in batches: use "
                "ksd.sweep, or leave 'plate' out of what the scene considers"
            )
        self.five, self.method, self.relinearisations = five, method, relinearisations
        self.keep_configurations, self.equilibrate = keep_configurations, equilibrate
        self.questions = questions if questions is not None and questions.names else None
        if self.questions is not None:
            # what is wrong with it is told before anything is solved
            model = five.model
            if self.questions.freed:
                row_numbers(model, self.questions.freed)
            if self.questions.has_point_question:
                node_of(model, self.questions.point(model.scene)[0])
        b = five.storage
        self.tables = joint_tables(b) if tabulated else None
        self._limits = b.limits[:, :2] + ((-np.inf, np.inf) if five.extrapolate else 0.0)

    def __call__(self, values: Mapping[str, np.ndarray]) -> DesignResult:
        """All poses, from rest each. Raises SceneError for drives that are not there."""
        model, b = self.five.model, self.five.storage
        model.targets({n: float(v[0]) for n, v in values.items()})
        count, rows = len(next(iter(values.values()))), len(model.drive_names) + len(model.support_names)
        targets, links = np.zeros((count, rows)), len(model.scene.links)
        for k, name in enumerate(model.drive_names):
            targets[:, k] = values[name]
        motion, status = np.zeros((count, len(b.theta))), np.zeros(count, np.int64)
        force, x, R = np.zeros((count, rows)), np.zeros((count, links, 3)), np.zeros((count, links, 3, 3))
        put = PoseArrays(force, x, R, motion, status)
        names = (model.scene.links, model.drive_names, b.bodies.motion_names)
        error = self.tables.error if self.tables else np.nan
        found = DesignResult(*names, force, x, R, motion, status, error)
        ask = None if self.questions is None else _Questions(self, self.questions, targets, found)
        if self.tables is None:
            solve_poses(b, targets, self.method, self.relinearisations, self.five.gap, self._limits, put, ask)
        else:
            t = self.tables
            limits = np.column_stack([self._limits, t.limits])
            solve_tabulated_poses(b, t.cubic, t.which, targets, self.five.gap, limits, put)
        found.motion = motion * b.bodies.motion_scale
        return found


class _Questions:
    """Asks the questions of the states in storage, every pose for itself."""

    def __init__(
        self, design: PreparedDesign, questions: Questions, targets: np.ndarray, found: DesignResult
    ) -> None:
        self.design, self.targets, self.found = design, targets, found
        self.questions, self.has_deferred = (
            questions.single_part,
            len(questions.single_part.names) < len(questions.names),
        )
        self.stiff = STIFF.issuperset(questions.names) and not (
            design.keep_configurations or design.equilibrate
        )
        found.rows = [{} for _ in targets]
        if "support_stiffness" in questions.names:
            found.compliance = np.full((len(targets), 6, 6), np.nan)

    def __call__(self, n: int) -> int:
        """The answers of pose n, of the equilibrium next to it where the method leads to none; returns the status."""
        b, target = self.design.five.storage, self.targets[n]
        motion = answering = b.full.copy()
        equilibrate = self.design.method != REDUCED or not (self.stiff and self._along())
        if self.design.method == REDUCED and equilibrate:
            status, answering = _beside(b.model, motion, target, b.full_work)
            if status:
                return status
        pose = PoseAnalysis(self._posed(answering if self.design.equilibrate else motion, answering, target))
        self.found.rows[n], _, failed = answer_questions(pose, self.questions)
        if self.design.keep_configurations:
            self.found.poses.append(pose.configuration)
        if self.has_deferred:
            self.found.deferred.append((n, pose, equilibrate))
        return _note(self.found, n, failed)

    def _along(self) -> bool:
        """Whether all joints are next to their intended motions."""
        b = self.design.five.storage
        off = np.abs(b.off)
        off[:, :3] /= b.bodies.kinematics.length[:, None]
        return bool(off.max(initial=0.0) <= MAX_UNINTENDED_MOTION)

    def _posed(self, motion: State, answering: State, target: np.ndarray) -> Configuration:
        """The state as a configuration; answering: the state that questions beyond forces and poses are asked of."""
        model, reduced = self.design.five.model, self.design.method == REDUCED
        values = dict(zip(model.drive_names, target.tolist(), strict=False))
        count = len(target)
        pose = Configuration(
            model, motion, "reduced" if reduced else "full", values, SOLVED, negatives=count,
            expected_negatives=count, method_was_chosen=reduced,
        )  # fmt: skip
        pose.__dict__["equilibrium"] = answering
        return pose


def _beside(model: Model, motion: State, target: np.ndarray, work: Workspace) -> tuple[int, State]:
    """Status and state of the equilibrium next to the state of a fast method."""
    state = motion.copy()
    stop, negatives = converge_fast_state(model, state, target, 1.0, work)
    if stop is not Stop.CONVERGED:
        return int(stop), state
    return (0 if negatives == len(target) else UNSTABLE), state


def status_sentence(code: int) -> str:
    """The status of a pose in words."""
    return STATUS_MESSAGES[code] if code in STATUS_MESSAGES else Stop(code).sentence


def _note(found: DesignResult, n: int, failed: Mapping[str, Exception]) -> int:
    """Why questions of pose n were not answered; returns its status."""
    if failed:
        before = [found.reasons[n]] if n in found.reasons else []
        found.reasons[n] = "; ".join([*before, *(f"{q}: {error_sentence(why)}" for q, why in failed.items())])
    return UNANSWERED if n in found.reasons else 0


def answer_deferred(designs: Sequence[DesignResult], questions: Questions) -> None:
    """Stiffness and stress of all poses of several designs."""
    deferred = [(found, *one) for found in designs for one in found.deferred]
    questions = questions.batch_part
    while deferred:
        again = []
        together = answer_batch([pose for *_, pose, _ in deferred], questions)
        for (found, n, pose, equilibrate), known in zip(deferred, together, strict=True):
            if not (equilibrate or known.stable):
                # no Newton step to the finer mesh: once more, of the equilibrium next to it
                model = pose.model
                target, work = model.targets(pose.targets), make_workspace(model.arrays)
                found.status[n], state = _beside(model, pose.motion, target, work)
                pose.configuration.__dict__["equilibrium"] = state
                again += [(found, n, pose, True)] if found.status[n] == 0 else []
                continue
            row, _, failed = answer_questions(pose, questions, known.rows)
            found.rows[n] |= row
            if found.compliance is not None and "support_stiffness" not in failed:
                alone = known.compliance is None
                found.compliance[n] = pose.stiffness_at(questions).compliance if alone else known.compliance
            found.status[n] = _note(found, n, failed)
        deferred = again
    for found in designs:
        found.deferred.clear()
