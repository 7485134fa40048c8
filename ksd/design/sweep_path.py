"""Lines of a sweep: one design, one load case, one path of the drives, walked pose by pose by one process."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from ksd.design.questions import (
    NOT_ANSWERED,
    POSE_ERRORS,
    PoseAnalysis,
    PreviousPose,
    Questions,
    answer_batch,
    answer_questions,
    drive_columns,
)
from ksd.design.table import OK, STATUS
from ksd.errors import ConvergenceError, SceneError
from ksd.model.mesh import DEFAULT_MESH, Mesh
from ksd.model.orders import raise_order
from ksd.properties.mesh_adequacy import mode_adequacy
from ksd.solve.configuration import Configuration
from ksd.solve.conventional import solve_conventional
from ksd.solve.plate_stiffening import solve_with_plate_factors
from ksd.solve.pose_batch import STATUS_MESSAGES, UNSTABLE
from ksd.solve.solver import DEFAULT_ACCURACY, MAX_RISES, Method, Solver
from ksd.solve.verdict import with_mesh_check

Row = dict[str, Any]
DrivePaths = list[tuple[dict[str, float], ...]]
"""Drive values by name [m or rad] of the poses of every path."""
CHUNK = 32
"""Poses of a line that are solved before they are asked."""


@dataclass(frozen=True)
class Recipe:
    """How every pose is solved and what it is asked; see `ksd.sweep`. judged: rows say whether it is stable, by which method
    it was found, and what is warned of, and modes keep their names along a line; without, a pose that is not stable has no
    answers, and its modes have the names of `Modes.names`."""

    questions: Questions
    method: Method | None = None
    accuracy: float | None = None
    relinearisations: int = 0
    mesh: Mesh | None = None
    extrapolate: bool = False
    effects: tuple[tuple[str, Any], ...] = ()
    with_verdict: bool = True


@dataclass(frozen=True)
class SweepPath:
    """number: place in the sweep; labels: design parameters and load case; scene: None where the design could not be
    built, `failure` says why; poses: drive values by name [m or rad], in the order they are walked. like: a design that
    could be built, whose drives name the columns of this one."""

    number: int
    labels: Mapping[str, Any]
    scene: Any
    drive_values: tuple[Mapping[str, float], ...]
    failure: str = ""
    reference_scene: Any = None


def drive_paths(arrays: Mapping[str, np.ndarray], *, together: bool) -> DrivePaths:
    """Paths through drive values: the drive named last moves along a path; together: all arrays move in step."""
    moving = [n for n, v in arrays.items() if len(v) > 1]
    if not together:
        outer, last = moving[:-1], moving[-1:]
    else:
        outer, last = [], moving
        if len({len(arrays[n]) for n in moving}) > 1:
            sizes = ", ".join(f"{n}: {len(arrays[n])}" for n in moving)
            raise SceneError(f"together=True needs as many values for every drive, not {sizes}")
    fixed = {n: float(v[0]) for n, v in arrays.items() if n not in moving}
    steps = [
        dict(zip(last, row, strict=True)) for row in zip(*(arrays[n].tolist() for n in last), strict=True)
    ]
    found: DrivePaths = []
    for combination in product(*(arrays[n].tolist() for n in outer)):
        held = dict(zip(outer, combination, strict=True))
        found.append(tuple({n: {**fixed, **held, **s}[n] for n in arrays} for s in steps or [{}]))
    return found


def unanswered_rows(path: SweepPath, reason: str, *, first: int = 0) -> list[Row]:
    """Rows that say why there are no numbers, from pose `first` on."""
    return [_labels(path, values) | {STATUS: reason} for values in path.drive_values[first:]]


def _labels(path: SweepPath, values: Mapping[str, float]) -> Row:
    """Labels of a row: those of its line, and drive values in the units of their columns."""
    scene = path.reference_scene if path.scene is None else path.scene
    known = {} if scene is None else drive_columns(scene)
    row: Row = dict(path.labels)
    for name, value in values.items():
        column, factor = known.get(name, (name, 1.0))
        row[column] = factor * value
    return row


class PathSolver:
    """Solves the poses of a line one after another; conventional poses start from the one before."""

    def __init__(self, solver: Solver, recipe: Recipe) -> None:
        self.solver, self.recipe = solver, recipe
        self.before: Configuration | None = None
        # of the poses that say whether the mesh is fine enough, which come again
        self.known: dict[frozenset[tuple[str, float]], Configuration] = {}

    def pose(self, values: Mapping[str, float]) -> Configuration:
        """The configuration at drive values; errors as in `ksd.solve`."""
        r = self.recipe
        if r.method == "conventional":
            self.before = self._continued(values)
            return self.before
        return self.known.get(frozenset(values.items())) or self.solver(
            values, method=r.method, accuracy=r.accuracy, relinearisations=r.relinearisations, strict=False
        )

    def go_on_from(self, pose: Configuration | None) -> None:
        """What comes next starts from this pose, or from rest."""
        if self.recipe.method == "conventional":
            self.before = pose

    def aside(self, values: Mapping[str, float]) -> Configuration:
        """A pose beside the line, which goes on from where it was."""
        kept = self.before
        try:
            return self.pose(values)
        finally:
            self.before = kept

    def _continued(self, values: Mapping[str, float]) -> Configuration:
        """From the pose before; from rest where that fails."""

        def walked(solver: Solver) -> Configuration:
            if self.before is not None:
                try:
                    return solve_conventional(solver.model, values, start=self.before, planar=solver.in_plane)
                except ConvergenceError:
                    self.before = None
            return solve_conventional(solver.model, values, planar=solver.in_plane)

        accuracy = self.recipe.accuracy or DEFAULT_ACCURACY
        return with_mesh_check(solve_with_plate_factors(self.solver, walked, 0.1 * accuracy)[0], accuracy)


def adequate_solver(path: SweepPath, recipe: Recipe, solver: Solver | None) -> PathSolver:
    """A walk with the solver given, or a new one; without a mesh asked for, its curvature modes raised until they are enough
    at the farthest pose of the line and at the nearest, as `ksd.solve` does. Errors of `Solver`; a pose that fails says so
    when walked."""
    words = {"extrapolate": recipe.extrapolate, **dict(recipe.effects)}
    solver = solver or Solver(path.scene, mesh=recipe.mesh, **words)
    walk, rises = PathSolver(solver, recipe), MAX_RISES if recipe.mesh is None else 0
    farthest, nearest = (
        end(path.drive_values, key=lambda pose: sum(v * v for v in pose.values())) for end in (max, min)
    )
    for values in (farthest,) if nearest is farthest else (farthest, nearest):
        while rises:
            try:
                found = walk.aside(values)
            except POSE_ERRORS:
                break
            walk.known[frozenset(values.items())] = found
            share, _, axis, _ = mode_adequacy(found.model, found.motion)
            if share <= (recipe.accuracy or DEFAULT_ACCURACY):
                break
            walk = PathSolver(
                Solver(path.scene, mesh=raise_order(walk.solver.model.mesh, axis), **words), recipe
            )
            rises -= 1
    return walk


def adequate_mesh(paths: Iterable[SweepPath], recipe: Recipe) -> Mesh:
    """The usual mesh with the curvature modes that are enough at the farthest poses of all lines; those that fail say so
    when walked."""
    found = [DEFAULT_MESH]
    for path in (path for path in paths if path.scene is not None):
        with suppress(*POSE_ERRORS):
            found.append(adequate_solver(path, recipe, None).solver.model.mesh)
    nx, ny, nz = (max(mesh.orders[axis] for mesh in found) for axis in range(3))
    return replace(DEFAULT_MESH, orders=(nx, ny, nz), points=max(mesh.points for mesh in found))


def run_path(
    path: SweepPath,
    recipe: Recipe,
    solver: Solver | None,
    rows: list[Row],
    poses: list[Configuration] | None = None,
) -> Solver | None:
    """Walk a line, appending a row per pose to `rows` and what was found to `poses`, if given; returns the solver for a next
    line of the same scene."""
    if path.scene is None:
        rows.extend(unanswered_rows(path, path.failure))
        return None
    try:
        walk = adequate_solver(path, recipe, solver)
    except POSE_ERRORS as reason:
        rows.extend(unanswered_rows(path, error_sentence(reason)))
        return None
    before = PreviousPose(between=walk.aside)
    for first in range(0, len(path.drive_values), CHUNK):
        found = [_walked(walk, values) for values in path.drive_values[first : first + CHUNK]]
        good, last = [pose for pose in found if not isinstance(pose, str)], walk.before
        if poses is not None:
            poses += good
        # an error figure is asked question by question
        known = iter(
            [NOT_ANSWERED] * len(good) if recipe.questions.errors else answer_batch(good, recipe.questions)
        )
        for values, pose in zip(path.drive_values[first:], found, strict=False):
            row = _labels(path, values)
            if isinstance(pose, str):
                rows.append(row | {STATUS: pose})
                continue
            if not recipe.with_verdict and pose.negatives != pose.expected_negatives:
                rows.append(row | {STATUS: STATUS_MESSAGES[UNSTABLE]})
                continue
            walk.go_on_from(pose)
            own = PoseAnalysis(pose, before if recipe.with_verdict else PreviousPose())
            told, before, troubles = answer_questions(own, recipe.questions, next(known).rows)
            row |= told
            if recipe.with_verdict:
                row |= {
                    "stable": float(pose.stable),
                    "method": pose.method,
                    "warnings": "; ".join(pose.warnings),
                }
            rows.append(
                row
                | {
                    STATUS: "; ".join(f"{name}: {error_sentence(why)}" for name, why in troubles.items())
                    or OK
                }
            )
        walk.go_on_from(last)
    return walk.solver


def _walked(walk: PathSolver, values: Mapping[str, float]) -> Configuration | str:
    """The pose at drive values, or why there is none."""
    try:
        return walk.pose(values)
    except POSE_ERRORS as reason:
        return error_sentence(reason)


def run_paths(paths: tuple[SweepPath, ...], recipe: Recipe) -> list[list[Row]]:
    """Rows of every line of a block; what a worker process is asked to do."""
    found: list[list[Row]] = []
    solver, scene = None, None
    for path in paths:
        rows: list[Row] = []
        solver = run_path(path, recipe, solver if path.scene is scene else None, rows)
        scene = path.scene
        found.append(rows)
    return found


def error_sentence(reason: Exception) -> str:
    """One sentence for a table."""
    text = " ".join(str(reason).split()) or type(reason).__name__
    reached = getattr(reason, "reached", None)
    if isinstance(reason, ConvergenceError) and reached and math.isfinite(reached) and "%" not in text:
        text += f" (reached {100 * reached:.3g} % of the motion)"
    return text
