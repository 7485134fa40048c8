"""One design, prepared to be solved at batches of poses by the five-step methods, with answers to questions at each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from ksd.answers.stiffness import node_of
from ksd.answers.tangent import row_numbers
from ksd.model.arrays import State, Workspace, make_workspace
from ksd.model.compile import Model
from ksd.solvers.configuration import Configuration
from ksd.solvers.error import converge_fast_state
from ksd.solvers.five_step_solver import FiveStepSolver
from ksd.solvers.joint_tables import joint_tables
from ksd.solvers.pose_batch import (
    REFUSED,
    STATUS_MESSAGES,
    UNANSWERED,
    UNSTABLE,
    Judged,
    PoseArrays,
    solve_poses,
    solve_tabulated_poses,
)
from ksd.solvers.solver import Solver
from ksd.solvers.steps import Step, Stop
from ksd.solvers.verdict import refusal
from ksd.study.questions import (
    POSE_ERRORS,
    PoseAnalysis,
    Questions,
    Row,
    answer_batch,
    answer_questions,
)
from ksd.study.sweep_path import error_sentence

SOLVED = (Step("in a batch", 0, 0.0, 0.0, Stop.CONVERGED),)
"""Solver steps of the configurations in a batch: questions are answered at equilibria only."""
STIFFNESS_QUESTIONS = {"support_stiffness", "drive_stiffness"}
"""Questions answered on the finer mesh, where convergence and stability of the state are checked as well."""
MAX_UNINTENDED_MOTION = 1e-4
"""Unintended motion of joints [rad, or relative to their length] up to which the Newton step to the finer mesh starts from
the reduced state itself, whose error is the square of it."""


class DeferredPose(NamedTuple):
    """Pose n of a design, to be answered together with others; at_equilibrium: its questions are answered at a converged
    equilibrium, not at the reduced state."""

    n: int
    analysis: PoseAnalysis
    at_equilibrium: bool


@dataclass
class DesignResult:
    """Results of one design at N poses, arrays as in `PoseArrays`.

    drives: names of the rows of `force`; joints: names of the columns of `motion` [rad, m]. error: interpolation error of
    tabulated joints, nan without. rows (N): answers by column. reasons: of questions without an answer, by pose.
    refused: why `ksd.solve` would refuse a pose. compliance (N, 6, 6): of the point of the questions, None without
    "support_stiffness". deferred: poses for
    `answer_deferred`. poses: the solved configurations, if they are kept.
    """

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
    refused: dict[int, str] = field(default_factory=dict)
    compliance: np.ndarray | None = None
    deferred: list[DeferredPose] = field(default_factory=list)
    poses: list[Configuration] = field(default_factory=list)

    @property
    def names(self) -> tuple[tuple[str, ...], ...]:
        """Names of links, drives and joints."""
        return self.links, self.drives, self.joints


class PreparedDesign:
    """One design prepared for batches: call it with arrays (N,) of drive values [m or rad] by drive name.

    method: "reduced" when None. tabulated: joints are interpolated in tables over their stroke. keep_configurations: they
    are in `DesignResult.poses`. equilibrate: configurations hold the equilibrium near the answer of the method, which is
    where questions are answered in any case. strict: a pose that `ksd.solve` would refuse without an error estimate has no
    answers. Raises SceneError for invalid questions.
    """

    def __init__(
        self,
        solver: FiveStepSolver,
        *,
        method: Literal["reduced", "full"] | None = None,
        relinearisations: int = 0,
        tabulated: bool = False,
        questions: Questions | None = None,
        keep_configurations: bool = False,
        equilibrate: bool = False,
        strict: bool = True,
    ) -> None:
        self.solver, self.method, self.relinearisations = solver, method or "reduced", relinearisations
        self.keep_configurations, self.equilibrate, self.strict = keep_configurations, equilibrate, strict
        self.questions = questions if questions is not None and questions.names else None
        if self.questions is not None:
            # these raise SceneError for names that are not there, before anything is solved
            model = solver.model
            if self.questions.freed:
                row_numbers(model, self.questions.freed)
            if self.questions.has_point_question:
                node_of(model, self.questions.point(model.scene)[0])
        b = solver.storage
        self.tables = joint_tables(b) if tabulated else None

    def __call__(self, values: Mapping[str, np.ndarray]) -> DesignResult:
        """Solve all poses, each from the undeformed configuration. Raises SceneError for unknown drives."""
        model, b = self.solver.model, self.solver.storage
        model.targets({n: float(v[0]) for n, v in values.items()})
        count, rows = len(next(iter(values.values()))), len(model.drive_names) + len(model.support_names)
        targets, links = np.zeros((count, rows)), len(model.scene.links)
        for k, name in enumerate(model.drive_names):
            targets[:, k] = values[name]
        motion, status = np.zeros((count, len(b.theta))), np.zeros(count, np.int64)
        force, x, R = np.zeros((count, rows)), np.zeros((count, links, 3)), np.zeros((count, links, 3, 3))
        arrays = PoseArrays(force, x, R, motion, status)
        names = (model.scene.links, model.drive_names, b.bodies.motion_names)
        error = self.tables.error if self.tables else np.nan
        result = DesignResult(*names, force, x, R, motion, status, error)
        gap = self.solver.gap

        def judge(pose: Judged) -> int:
            reason = self._refusal(targets[pose.n], pose)
            if reason:
                result.refused[pose.n] = reason
            return REFUSED if reason else 0

        if self.tables is None:
            answer = (
                None if self.questions is None else _QuestionsOfPoses(self, self.questions, targets, result)
            )
            settings = self.method, self.relinearisations, gap, self.solver.limits
            solve_poses(b, targets, *settings, arrays, judge, answer)
        else:
            t = self.tables
            limits = np.column_stack([self.solver.limits, t.limits])
            solve_tabulated_poses(b, t.cubic, t.table, targets, gap, limits, arrays, judge)
            self._judge_tabulated(targets, result)
        result.motion = motion * b.bodies.motion_scale
        return result

    @cached_property
    def _full_solver(self) -> Solver:
        """A solver as `ksd.solve` has, with the same five steps."""
        solver = Solver(self.solver.model, extrapolate=self.solver.extrapolate)
        solver.five_steps = self.solver
        return solver

    def _refusal(self, target: np.ndarray, pose: Judged) -> str:
        """The sentence with which `ksd.solve` would refuse a converged pose, whose state is in the storage; empty where it
        would not."""
        return "" if self.solver.is_evidently_solved(target, pose) else self._full_refusal(target)

    def _judge_tabulated(self, targets: np.ndarray, result: DesignResult) -> None:
        """Judge the insides of joints, which tables do not know: at the largest drive values and at the largest forces, and
        at all poses where one of these is refused."""
        solved = np.flatnonzero(result.status == 0)
        sizes = (np.linalg.norm(values[solved], axis=1) for values in (targets, result.force))
        extremes = {int(solved[size.argmax()]) for size in sizes if len(solved)}
        if any(self._full_refusal(targets[n]) for n in extremes):
            for n in solved.tolist():
                reason = self._full_refusal(targets[n])
                if reason:
                    result.refused[n], result.status[n] = reason, REFUSED

    def _full_refusal(self, target: np.ndarray) -> str:
        """`_refusal` by the five steps and all checks."""
        values = dict(zip(self.solver.model.drive_names, target.tolist(), strict=False))
        try:
            found = self._full_solver(
                values,
                method=self.method,
                relinearisations=self.relinearisations,
                estimate=False,
                strict=False,
            )
            return refusal(found)
        except POSE_ERRORS as reason:
            return error_sentence(reason)


class _QuestionsOfPoses:
    """Answers the questions of each pose, whose state is in the storage of the solver, into a `DesignResult`."""

    def __init__(
        self, design: PreparedDesign, questions: Questions, targets: np.ndarray, result: DesignResult
    ) -> None:
        self.design, self.targets, self.result = design, targets, result
        self.questions = questions.single_part
        self.has_deferred = len(self.questions.names) < len(questions.names)
        self.only_stiffness = STIFFNESS_QUESTIONS.issuperset(questions.names) and not (
            design.keep_configurations or design.equilibrate
        )
        result.rows = [{} for _ in targets]
        if "support_stiffness" in questions.names:
            result.compliance = np.full((len(targets), 6, 6), np.nan)

    def __call__(self, n: int) -> int:
        """Answer the questions of pose n, at the equilibrium near it where the method gives none; returns its status."""
        b, target = self.design.solver.storage, self.targets[n]
        state = equilibrium = b.full_state.copy()
        at_equilibrium = self.design.method != "reduced" or not (
            self.only_stiffness and self._is_near_intended_motion()
        )
        if n in self.result.refused and self.design.strict:
            return 0
        if self.design.method == "reduced" and at_equilibrium:
            status, equilibrium = _equilibrium_near(b.model, state, target, b.full_work)
            if status and not (status == UNSTABLE and n in self.result.refused):
                return status
        shown = equilibrium if self.design.equilibrate else state
        analysis = PoseAnalysis(self._configuration(shown, equilibrium, target))
        answers = answer_questions(analysis, self.questions)
        self.result.rows[n] = answers.row
        if self.design.keep_configurations:
            self.result.poses.append(analysis.configuration)
        if self.has_deferred:
            self.result.deferred.append(DeferredPose(n, analysis, at_equilibrium))
        return _status_of_answers(self.result, n, answers.failures)

    def _is_near_intended_motion(self) -> bool:
        """Whether the unintended motion of all joints is within MAX_UNINTENDED_MOTION."""
        b = self.design.solver.storage
        off = np.abs(b.unintended)
        off[:, :3] /= b.bodies.kinematics.length[:, None]
        return bool(off.max(initial=0.0) <= MAX_UNINTENDED_MOTION)

    def _configuration(self, state: State, equilibrium: State, target: np.ndarray) -> Configuration:
        """Configuration with this state; equilibrium: where questions other than forces and poses are answered."""
        model, reduced = self.design.solver.model, self.design.method == "reduced"
        values = dict(zip(model.drive_names, target.tolist(), strict=False))
        count = len(target)
        pose = Configuration(
            model, state, self.design.method, values, SOLVED, negatives=count,
            expected_negatives=count, method_was_chosen=reduced,
        )  # fmt: skip
        pose.set_equilibrium(equilibrium)
        return pose


def _equilibrium_near(model: Model, state: State, target: np.ndarray, work: Workspace) -> tuple[int, State]:
    """Status and state of the equilibrium near the state of a fast method."""
    equilibrium = state.copy()
    stop, negatives = converge_fast_state(model, equilibrium, target, 1.0, work)
    if stop is not Stop.CONVERGED:
        return int(stop), equilibrium
    return (0 if negatives == len(target) else UNSTABLE), equilibrium


def status_sentence(code: int) -> str:
    """The status of a pose in words."""
    return STATUS_MESSAGES[code] if code in STATUS_MESSAGES else Stop(code).sentence


def _status_of_answers(result: DesignResult, n: int, failures: Mapping[str, Exception]) -> int:
    """Add to `result` why questions of pose n were not answered; returns the status of the pose."""
    if n in result.refused:
        result.refused[n] = "; ".join([result.refused[n], *_failure_sentences(failures)])
        return REFUSED
    if failures:
        earlier = [result.reasons[n]] if n in result.reasons else []
        result.reasons[n] = "; ".join([*earlier, *_failure_sentences(failures)])
    return UNANSWERED if n in result.reasons else 0


def _failure_sentences(failures: Mapping[str, Exception]) -> list[str]:
    """Why questions were not answered."""
    return [f"{question}: {error_sentence(why)}" for question, why in failures.items()]


def answer_deferred(designs: Sequence[DesignResult], questions: Questions) -> None:
    """Answer the questions about stiffness and stress for the deferred poses of several designs, into their results.

    Where the stiffness at a reduced state is not that of a stable equilibrium, the equilibrium near it is solved for and
    the questions are answered there.
    """
    questions = questions.batch_part
    waiting = [(result, deferred) for result in designs for deferred in result.deferred]
    while waiting:
        again = []
        batch_answers = answer_batch([deferred.analysis for _, deferred in waiting], questions)
        for (result, (n, pose, at_equilibrium)), known in zip(waiting, batch_answers, strict=True):
            if not (at_equilibrium or known.stable or n in result.refused):
                model = pose.model
                target, work = model.targets(pose.targets), make_workspace(model.arrays)
                result.status[n], equilibrium = _equilibrium_near(model, pose.motion, target, work)
                pose.configuration.set_equilibrium(equilibrium)
                again += [(result, DeferredPose(n, pose, True))] if result.status[n] == 0 else []
                continue
            answers = answer_questions(pose, questions, known.rows)
            result.rows[n] |= answers.row
            if result.compliance is not None and "support_stiffness" not in answers.failures:
                alone = known.compliance is None
                result.compliance[n] = pose.stiffness_at(questions).compliance if alone else known.compliance
            result.status[n] = _status_of_answers(result, n, answers.failures)
        waiting = again
    for result in designs:
        result.deferred.clear()
