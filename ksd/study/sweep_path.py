"""Paths of a sweep: one design under one load case, solved at a sequence of drive values by one process.

`run_path` solves the poses of a path in order and answers the questions at each.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from ksd.answers.mesh_adequacy import mode_adequacy
from ksd.checks import boolean
from ksd.errors import ConvergenceError, SceneError
from ksd.model.mesh import DEFAULT_MESH, Mesh
from ksd.model.orders import raise_order
from ksd.model.turns import node_rotations, relative_angles
from ksd.numerics.threads import small_matrices
from ksd.scene.obstacle import has_contacts
from ksd.solvers.configuration import Configuration
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.plate_stiffening import solve_with_secants
from ksd.solvers.solver import MAX_RISES, METHODS, Method, Solver, solve
from ksd.solvers.steps import DEFAULT_ACCURACY
from ksd.solvers.verdict import is_solved, refusal, with_mesh_check
from ksd.study.arguments import check_solve_options
from ksd.study.questions import (
    NOT_ANSWERED,
    POSE_ERRORS,
    PoseAnalysis,
    PreviousPose,
    Questions,
    answer_batch,
    answer_questions,
    contact_row,
    drive_columns,
)
from ksd.study.table import OK, STATUS

FAR_TURN, SAME_TURN = 0.5 * math.pi, 0.1
"""Rotations [rad] between poses of a path beyond which one from rest is compared with one continued, and up to which these
two are the same."""
Row = dict[str, Any]
DrivePaths = list[tuple[dict[str, float], ...]]
"""Drive values by name [m or rad] of the poses of every path."""
CHUNK = 32
"""Poses of a path that are solved before their questions are answered together."""


@dataclass(frozen=True)
class Recipe:
    """How every pose is solved, and the questions about it; see `ksd.sweep`.

    with_verdict: rows hold stability, method and warnings, and modes keep their names along a path; else they are named as
    in `Modes.names`. strict: a pose that `ksd.solve` would refuse has no answers. effects: options of `ksd.prepare` on
    effects and the loading order. ends_at_failure: a path ends at its first pose that is not solved. Raises SceneError for
    invalid options.
    """

    questions: Questions
    method: Method | None = None
    accuracy: float | None = None
    relinearisations: int = 0
    mesh: Mesh | None = None
    extrapolate: bool = False
    effects: tuple[tuple[str, Any], ...] = ()
    with_verdict: bool = True
    strict: bool = True
    ends_at_failure: bool = False

    def __post_init__(self) -> None:
        check_solve_options(
            mesh=self.mesh, relinearisations=self.relinearisations, accuracy=self.accuracy, method=self.method,
            methods=METHODS, extrapolate=self.extrapolate,
        )  # fmt: skip
        boolean(self.strict, "strict")

    def fingerprint_text(self) -> str:
        """Text of the recipe in the fingerprint of a resume file; it must not change, or old files are refused."""
        return (
            f"Recipe(asked={self.questions.fingerprint_text()}, method={self.method!r}, accuracy={self.accuracy!r}, "
            f"relinearisations={self.relinearisations!r}, mesh={self.mesh!r}, extrapolate={self.extrapolate!r}, "
            f"effects={self.effects!r}, judged={self.with_verdict!r}, strict={self.strict!r})"
        )


@dataclass(frozen=True)
class SweepPath:
    """A sequence of poses of one design under one load case.

    number: index in the sweep. labels: design parameters and load case. scene: None where the design could not be built,
    for the reason `failure`. drive_values: by drive name [m or rad], in the order in which they are solved.
    reference_scene: of a design that could be built, whose drives name the columns of this one.
    """

    number: int
    labels: Mapping[str, Any]
    scene: Any
    drive_values: tuple[Mapping[str, float], ...]
    failure: str = ""
    reference_scene: Any = None


def drive_paths(arrays: Mapping[str, np.ndarray], *, together: bool) -> DrivePaths:
    """Paths through all combinations of drive values; the drive named last varies along a path.

    together: the values of all drives vary together instead. Raises SceneError for arrays of different lengths then.
    """
    varied = [n for n, v in arrays.items() if len(v) > 1]
    if not together:
        outer, inner = varied[:-1], varied[-1:]
    else:
        outer, inner = [], varied
        if len({len(arrays[n]) for n in varied}) > 1:
            sizes = ", ".join(f"{n}: {len(arrays[n])}" for n in varied)
            raise SceneError(f"together=True needs as many values for every drive, not {sizes}")
    single = {n: float(v[0]) for n, v in arrays.items() if n not in varied}
    steps = [
        dict(zip(inner, row, strict=True)) for row in zip(*(arrays[n].tolist() for n in inner), strict=True)
    ]
    paths: DrivePaths = []
    for combination in product(*(arrays[n].tolist() for n in outer)):
        fixed = {**single, **dict(zip(outer, combination, strict=True))}
        paths.append(tuple({n: {**fixed, **step}[n] for n in arrays} for step in steps or [{}]))
    return paths


def unanswered_rows(path: SweepPath, reason: str, *, first: int = 0) -> list[Row]:
    """Rows without answers, with the reason as status, from pose `first` on."""
    return [row_labels(path, values) | {STATUS: reason} for values in path.drive_values[first:]]


def row_labels(path: SweepPath, values: Mapping[str, float]) -> Row:
    """Labels of a row: those of its path, and the drive values in the units of their columns."""
    scene = path.reference_scene if path.scene is None else path.scene
    columns = {} if scene is None else drive_columns(scene)
    row: Row = dict(path.labels)
    for name, value in values.items():
        column, factor = columns.get(name, (name, 1.0))
        row[column] = factor * value
    return row


class PathSolver:
    """Solves the poses of a path in order; those of method "conventional" start from the previous one, and so do others
    whose rotations a solve from rest would not count on (`ksd.model.turns`)."""

    def __init__(self, solver: Solver, recipe: Recipe) -> None:
        self.solver, self.recipe = solver, recipe
        self.previous: Configuration | None = None
        # poses at which the mesh was checked, by drive values: the path comes to them again
        self.cache: dict[frozenset[tuple[str, float]], Configuration] = {}

    def solve(self, values: Mapping[str, float]) -> Configuration:
        """The configuration at drive values by name [m or rad]. Raises what `ksd.solve` raises."""
        conventional = self.recipe.method == "conventional" and not has_contacts(
            self.solver.model.original_scene
        )
        self.previous = self._solve_conventional(values) if conventional else self._solve_or_continue(values)
        return self.previous

    def judge(self, values: Mapping[str, float]) -> tuple[Configuration, str]:
        """The configuration at drive values by name [m or rad], and the sentence with which `ksd.solve` would refuse it,
        empty where it would not. Raises what `ksd.solve` raises."""
        r, before, pose = self.recipe, self.previous, self.solve(values)
        reason, model = refusal(pose), self.solver.model
        turned = bool(model.turn_to_guess(model.targets(values)))
        if reason and not turned and r.mesh is None and not pose.mesh_adequacy.missed_share <= self.accuracy:
            # on a coarse mesh a state may falsely seem unstable or on another branch
            pose = solve(
                self.solver.model.original_scene, values, method=r.method, accuracy=r.accuracy, strict=False,
                relinearisations=r.relinearisations, extrapolate=r.extrapolate, **dict(r.effects),
            )  # fmt: skip
            reason = refusal(pose)
            self.continue_from(pose)
        if reason:
            # turns are not counted on from rest
            self.continue_from(before if turned else None)
        return pose, reason

    @property
    def accuracy(self) -> float:
        """The relative accuracy of the recipe."""
        return self.recipe.accuracy or DEFAULT_ACCURACY

    def continue_from(self, pose: Configuration | None) -> None:
        """Continue the path from `pose`, from the undeformed configuration when None, or when it is on another mesh."""
        if pose is not None and pose.motion.inner.shape != self.solver.model.rest.inner.shape:
            pose = None
        self.previous = pose

    def _solve_or_continue(self, values: Mapping[str, float]) -> Configuration:
        """Solve from rest; from the previous pose where a drive has turned too far for that, or where a rotation is far from
        that of the previous pose, and not when continued from there."""
        r, model, before = self.recipe, self.solver.model, self.previous
        target = model.targets(values)

        def solve_from(start: Configuration | None) -> Configuration:
            return self.solver(
                values, method=r.method, accuracy=r.accuracy, relinearisations=r.relinearisations, strict=False,
                start=start,
            )  # fmt: skip

        if before is None:
            return self.cache.get(frozenset(values.items())) or solve_from(None)
        if model.turn_to_guess(target):
            return solve_from(before)
        reachable = not model.turn_to_guess(target, model.targets(before.targets))
        found = self.cache.get(frozenset(values.items())) or solve_from(None)
        if reachable and r.method is None and _turned_apart(before, found) > FAR_TURN:
            with suppress(*POSE_ERRORS):
                continued = solve_from(before)
                return continued if _turned_apart(continued, found) > SAME_TURN else found
        return found

    def solve_detached(self, values: Mapping[str, float]) -> Configuration:
        """As `solve`, but the next pose of the path starts where it would have started."""
        previous = self.previous
        try:
            return self.solve(values)
        finally:
            self.previous = previous

    def _solve_conventional(self, values: Mapping[str, float]) -> Configuration:
        """Solve from the previous pose, or as `ksd.solve` does where that leads to no solved state."""

        def solve_with(solver: Solver) -> Configuration:
            model, before = solver.model, self.previous
            target = model.targets(values)
            turned = bool(model.turn_to_guess(target))
            if before is not None and (
                turned or not model.turn_to_guess(target, model.targets(before.targets))
            ):
                try:
                    found = solve_conventional(model, values, start=before, planar=solver.in_plane)
                    if turned or is_solved(found):
                        return found
                except ConvergenceError:
                    if turned:
                        raise
                self.previous = None
            return solver.by_load_steps(values)

        found, _ = solve_with_secants(self.solver, solve_with, 0.1 * self.accuracy, modal=False)
        return with_mesh_check(found, self.accuracy)


def _turned_apart(one: Configuration, other: Configuration) -> float:
    """Largest difference [rad] of a counted angle or rotation of a link in two states of one mechanism."""
    # the nodes of a leaf spring that contact cuts are the last
    links = min(one.model.links, other.model.links)
    angles = [
        np.append(relative_angles(c.model.arrays, c.motion), node_rotations(c.model.arrays, c.motion)[:links])
        for c in (one, other)
    ]
    return float(np.abs(angles[0] - angles[1]).max(initial=0.0))


def adequate_solver(path: SweepPath, recipe: Recipe, solver: Solver | None) -> PathSolver:
    """A path solver with a fine enough mesh.

    Unless the recipe has a mesh, the curvature modes of the leaf springs are raised until they are enough at the poses with
    the largest and the smallest drive values, as `ksd.solve` does; poses that fail there are left to `PathSolver.solve`.
    solver: of the same scene, used instead of a new one. Raises what `Solver` raises.
    """
    options = {"extrapolate": recipe.extrapolate, **dict(recipe.effects)}
    solver = solver or Solver(path.scene, mesh=recipe.mesh, **options)
    path_solver, rises = PathSolver(solver, recipe), MAX_RISES if recipe.mesh is None else 0
    model = path_solver.solver.model
    from_rest = [v for v in path.drive_values if not model.turn_to_guess(model.targets(v))]
    farthest, nearest = (
        end(from_rest or path.drive_values, key=lambda pose: sum(v * v for v in pose.values()))
        for end in (max, min)
    )
    for values in (farthest,) if nearest is farthest else (farthest, nearest):
        while rises:
            try:
                pose = path_solver.solve_detached(values)
            except POSE_ERRORS:
                break
            path_solver.cache[frozenset(values.items())] = pose
            share, _, axis, _ = mode_adequacy(pose.model, pose.motion)
            if share <= path_solver.accuracy:
                break
            finer = raise_order(path_solver.solver.model.mesh, axis)
            path_solver = PathSolver(Solver(path.scene, mesh=finer, **options), recipe)
            rises -= 1
    return path_solver


def adequate_mesh(paths: Iterable[SweepPath], recipe: Recipe) -> Mesh:
    """`DEFAULT_MESH` with as many curvature modes as all paths need, see `adequate_solver`; paths that fail do not count."""
    meshes = [DEFAULT_MESH]
    for path in (path for path in paths if path.scene is not None):
        with suppress(*POSE_ERRORS):
            meshes.append(adequate_solver(path, recipe, None).solver.model.mesh)
    nx, ny, nz = (max(mesh.orders[axis] for mesh in meshes) for axis in range(3))
    return replace(DEFAULT_MESH, orders=(nx, ny, nz), points=max(mesh.points for mesh in meshes))


def run_path(
    path: SweepPath,
    recipe: Recipe,
    solver: Solver | None,
    rows: list[Row],
    poses: list[Configuration] | None = None,
) -> Solver | None:
    """Solve the poses of a path and answer the questions at each.

    A row per pose up to the end of the path is appended to `rows`, and each configuration to `poses`, if given. The status
    of a pose that `ksd.solve` would refuse is its sentence. solver: one of the same scene. Returns the solver, for the next
    path of that scene; None where there is none.
    """
    if path.scene is None:
        rows.extend(unanswered_rows(path, path.failure))
        return None
    try:
        path_solver = adequate_solver(path, recipe, solver)
    except POSE_ERRORS as reason:
        rows.extend(unanswered_rows(path, error_sentence(reason)))
        return None
    previous = PreviousPose(solve=path_solver.solve_detached)
    for first in range(0, len(path.drive_values), CHUNK):
        results: list[tuple[Configuration, str] | str] = []
        ends = False
        for values in path.drive_values[first : first + CHUNK]:
            result = _pose_or_reason(path_solver, values)
            results.append(result)
            ends = recipe.ends_at_failure and bool(isinstance(result, str) or result[1])
            if ends:
                break
        solved = [r[0] for r in results if not isinstance(r, str) and not (r[1] and recipe.strict)]
        last = path_solver.previous
        if poses is not None:
            poses += solved
        held = [with_contacts_held(pose, recipe.questions) for pose in solved]
        # with error figures, every question is answered by itself
        batch_answers = iter(
            [NOT_ANSWERED] * len(solved)
            if recipe.questions.errors
            else answer_batch([each.pose for each in held], recipe.questions)
        )
        held_poses = iter(held)
        for values, result in zip(path.drive_values[first:], results, strict=False):
            row = row_labels(path, values)
            if isinstance(result, str):
                rows.append(row | {STATUS: result})
                continue
            pose, refused = result
            verdict = {}
            if recipe.with_verdict:
                verdict = {
                    "stable": float(pose.stable), "method": pose.method, "warnings": "; ".join(pose.warnings),
                }  # fmt: skip
            if refused and recipe.strict:
                rows.append(row | verdict | {STATUS: refused})
                continue
            batch_rows = next(batch_answers).rows
            path_solver.continue_from(pose)
            here = next(held_poses)
            analysis = PoseAnalysis(here.pose, previous if recipe.with_verdict else PreviousPose())
            answers = answer_questions(analysis, here.questions, batch_rows)
            previous = answers.previous
            failures = [f"{name}: {error_sentence(why)}" for name, why in answers.failures.items()]
            status = "; ".join(filter(None, [refused, here.why_not, *failures])) or OK
            row |= contact_row(pose) if "force" in here.questions.names else {}
            rows.append(row | answers.row | verdict | {STATUS: status})
        path_solver.continue_from(last)
        if ends:
            break
    return path_solver.solver


class _HeldPose(NamedTuple):
    """A pose with its contacts held, the questions that it answers, and why it does not answer others."""

    pose: Configuration
    questions: Questions
    why_not: str = ""


def with_contacts_held(pose: Configuration, questions: Questions) -> _HeldPose:
    """The pose for all questions, or for that for forces alone where its contacts cannot be held."""
    try:
        return _HeldPose(pose.with_contacts_held, questions)
    except SceneError as reason:
        forces = tuple(name for name in questions.names if name == "force")
        why_not = str(reason) if forces != questions.names else ""
        return _HeldPose(pose, replace(questions, names=forces), why_not)


def _pose_or_reason(path_solver: PathSolver, values: Mapping[str, float]) -> tuple[Configuration, str] | str:
    """`PathSolver.judge` at drive values, or why there is no configuration."""
    try:
        return path_solver.judge(values)
    except POSE_ERRORS as reason:
        return error_sentence(reason)


@small_matrices
def run_paths(paths: tuple[SweepPath, ...], recipe: Recipe) -> list[list[Row]]:
    """Rows of every path of a block: the task of a worker process."""
    rows_by_path: list[list[Row]] = []
    solver, scene = None, None
    for path in paths:
        rows: list[Row] = []
        solver = run_path(path, recipe, solver if path.scene is scene else None, rows)
        scene = path.scene
        rows_by_path.append(rows)
    return rows_by_path


def error_sentence(reason: Exception) -> str:
    """An error as one sentence for a table, with the share of the motion that was reached."""
    text = " ".join(str(reason).split()) or type(reason).__name__
    reached = getattr(reason, "reached", None)
    if isinstance(reason, ConvergenceError) and reached and math.isfinite(reached) and "%" not in text:
        text += f" (reached {100 * reached:.3g} % of the motion)"
    return text
