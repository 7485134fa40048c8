"""Designs with stops, cables and contacts in a batch: every pose is solved as a prepared solver does."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ksd.scene import Scene
from ksd.scene.obstacle import same_without_contacts
from ksd.solvers.configuration import Configuration
from ksd.solvers.pose_batch import NOT_SOLVED, REFUSED, UNANSWERED
from ksd.solvers.solver import Method, Solver
from ksd.solvers.touching import touching
from ksd.solvers.verdict import refusal
from ksd.study.prepared_design import DesignResult
from ksd.study.questions import (
    POSE_ERRORS,
    PoseAnalysis,
    Questions,
    answer_questions,
    check_questions,
    contact_row,
)
from ksd.study.sweep_path import error_sentence, with_contacts_held


def solver_of_design(scene: Scene, last: Solver | None, options: Mapping[str, Any]) -> Solver:
    """A solver of a scene: `last` with other stops, cables and contacts, where only these differ from its scene, else a new
    one with these options of `ksd.prepare`. Raises KsdError where it cannot be prepared."""
    if last is not None and same_without_contacts(scene, last.model.original_scene):
        last.exchange_contacts(scene)
        return last
    solver = Solver(scene, **options)
    # raises where surfaces overlap at rest, as the exchange does
    touching(solver.model)
    return solver


def solve_design(
    solver: Solver,
    values: Mapping[str, np.ndarray],
    *,
    method: Method | None = None,
    relinearisations: int = 0,
    questions: Questions | None = None,
    keep_configurations: bool = False,
    equilibrate: bool = False,
    strict: bool = True,
) -> DesignResult:
    """Solve at arrays (N,) of drive values [m or rad] by name, each pose from rest; method, relinearisations: as in
    `ksd.solve`, others as in `PreparedDesign`. Raises SceneError for unknown drives and invalid questions."""
    model, asked = solver.model, questions if questions is not None and questions.names else None
    if asked is not None:
        check_questions(asked, model.original_scene)
    poses = [
        dict(zip(values, row, strict=True))
        for row in zip(*(v.tolist() for v in values.values()), strict=True)
    ]
    model.targets(poses[0])
    count, links, rows = len(poses), len(model.scene.links), len(model.arrays.terms.start)
    joints = solver.joint_motions(model.rest)
    names = () if joints is None else joints.motions
    result = DesignResult(
        model.scene.links, model.drive_names, names, np.zeros((count, rows)), np.zeros((count, links, 3)),
        np.zeros((count, links, 3, 3)), np.zeros((count, len(names))), np.zeros(count, np.int64),
    )  # fmt: skip
    if asked is not None:
        result.rows = [{} for _ in poses]
        if "support_stiffness" in asked.names:
            result.compliance = np.full((count, 6, 6), np.nan)
    for n, given in enumerate(poses):
        try:
            pose = solver(
                given, method=method, relinearisations=relinearisations, estimate=False, strict=False
            )
        except POSE_ERRORS as reason:
            result.refused[n], result.status[n] = error_sentence(reason), NOT_SOLVED
            continue
        refused = refusal(pose)
        if refused:
            result.refused[n], result.status[n] = refused, REFUSED
        at = [pose.model.node_names.index(name) for name in model.node_names]
        x, R = pose.motion.x[at], pose.motion.R[at]
        result.force[n], result.x[n], result.R[n] = -pose.motion.multiplier, x[:links], R[:links]
        if found := solver.joint_motions(pose.motion._replace(x=x, R=R)):
            result.motion[n] = found.theta * found.scale
        if asked is not None and not (refused and strict):
            _answer(result, n, pose, asked)
            result.poses += [pose] if keep_configurations else []
    return result


def _answer(result: DesignResult, n: int, pose: Configuration, questions: Questions) -> None:
    """Answer the questions of pose n into its row, with the contacts held that are closed."""
    held = with_contacts_held(pose, questions)
    analysis = PoseAnalysis(held.pose)
    answers = answer_questions(analysis, held.questions)
    result.rows[n] = (contact_row(pose) if "force" in held.questions.names else {}) | answers.row
    if result.compliance is not None and "support_stiffness" in {*held.questions.names} - {*answers.failures}:
        result.compliance[n] = analysis.stiffness_at(questions).compliance
    failures = [f"{name}: {error_sentence(why)}" for name, why in answers.failures.items()]
    if why_not := "; ".join(filter(None, [result.refused.get(n), held.why_not, *failures])):
        result.reasons[n] = why_not
        result.status[n] = result.status[n] or UNANSWERED
