"""`ksd.compare`: one pose by every method, each answer beside its time and its error, as a table."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from ksd.bench.measure import converged, in_turns, quartiles, rounds_of
from ksd.bench.suite import FINEST, Way, not_run
from ksd.checks import boolean, clear_argument_errors, name_hint, names_of, show, whole_number
from ksd.design.arguments import check_solve_options
from ksd.design.questions import EFFORT_SUFFIX
from ksd.design.table import OK, STATUS, Table
from ksd.errors import KsdError, SceneError
from ksd.modal.choices import ModalBasis
from ksd.model.compile import Model, compile_scene
from ksd.model.mesh import Mesh
from ksd.properties.printing import progress_bar
from ksd.scene import Mechanism, Scene
from ksd.solve.answer import drive_kind
from ksd.solve.configuration import Configuration
from ksd.solve.conventional import solve_conventional
from ksd.solve.solver import Solver, given_values, solve
from ksd.solve.steps import percent

ESTIMATE = "error estimate"
"""Name of the step that is not part of the solve proper."""
MODAL_LEAVES = 30
"""Leaf springs from which modal bodies are compared only where they are named: a call takes many seconds."""
METHODS = (
    "constant", "kinematic", "reduced", "relinearised once", "full", "modal", "conventional", "conventional, Newton",
)  # fmt: skip
"""What is compared, the last one by plain Newton iterations, as in Appendix B of paper 1."""
POSE_ERRORS = (KsdError, ArithmeticError, np.linalg.LinAlgError)
"""What a method may raise that cannot do a scene."""


@dataclass(frozen=True)
class Approach:
    """One way to a pose: `solve(estimate)` with or without the error figure of the method."""

    method: str
    leaves: str
    solve: Callable[[bool], Configuration]


@dataclass(frozen=True)
class Reference:
    """What errors are counted from: forces by drive [N or Nm], positions (links, 3) [m] of the links, how far the farthest
    has come [m], and where all of it comes from, in words."""

    forces: Mapping[str, float]
    places: np.ndarray
    moved: float
    words: str


@dataclass(frozen=True)
class Compared:
    """What one way gave: median thread times [s] of a call, of its steps alone and of the error estimate; factorisations;
    drive forces, how far the farthest link came [m]; relative errors of forces and positions; what the answer itself says
    of its error, by the method alone (estimate) and with its mesh (told). failed: why there is nothing of it."""

    method: str
    leaves: str
    call: float = math.nan
    time: float = math.nan
    check: float = math.nan
    iterations: int = 0
    forces: Mapping[str, float] | None = None
    moved: float = math.nan
    force_error: float = math.nan
    place_error: float = math.nan
    estimate: float | None = None
    told: float | None = None
    stable: bool = True
    failed: str = ""

    @property
    def error(self) -> float:
        """The larger of the errors of forces and positions."""
        return (
            max(self.force_error, self.place_error)
            if self.force_error == self.force_error
            else self.place_error
        )


@clear_argument_errors
def compare(
    mechanism: Mechanism | Scene,
    targets: Mapping[str, float] | None = None,
    *,
    methods: str | Iterable[str] | None = None,
    elements: int = 5,
    repeats: int = 9,
    extrapolate: bool = False,
    effects: str | Iterable[str] = "auto",
    with_: str | Iterable[str] = (),
    without: str | Iterable[str] = (),
    progress: bool = True,
    **drives: float,
) -> Table:
    """One pose of a mechanism by every method: a `ksd.Table` with a row for each, its answer, time and error.

    targets, drives: drive values [m or rad] by name; methods: those of METHODS to compare, all when None; elements:
    Appendix A elements of each leaf in the rows that have such; repeats: calls of which the median time is told, in turns
    with the others (fewer of slow ones); extrapolate, effects, with_, without: as in `ksd.solve`; progress: whether a bar
    tells how far it is. Columns: time_us of a call of the prepared solver and steps_us of its compiled steps (thread CPU
    time), estimate_us (of the method's error figure, on top), factorisations, drive forces, moved_mm (of the farthest
    link), force_error_percent (of each drive, over the largest force or moment), displacement_error_percent (of each
    link, over moved_mm), error_percent (the larger; that of the mesh is in it, as the reference is strain-mode leaves of
    order 6, 5, 9 by the conventional method), estimated_error_percent and told_error_percent (what the answer says of its
    method alone, and with its mesh). A method that cannot do this scene is a row whose `status` says why. Raises
    SceneError for wrong words, ConvergenceError where the reference has no equilibrium there.
    """
    check_solve_options(mesh=None, relinearisations=0, extrapolate=extrapolate, progress=progress)
    wanted = METHODS if methods is None else names_of(methods, "methods")
    for name in wanted:
        if name not in METHODS:
            raise SceneError(f"method {show(name)} is not compared{name_hint(name, METHODS)}")
    count, times = whole_number(elements, "elements"), whole_number(repeats, "repeats")
    values = given_values(targets, drives)
    words: dict[str, Any] = {"effects": effects, "with_": with_, "without": without}
    reference, model = finest(mechanism, values, extrapolate=extrapolate, **words)
    usual = _usual_mesh(mechanism, values, extrapolate=extrapolate, **words)
    found = approaches(
        model.said, values, usual, count, extrapolate=extrapolate, effects=model.choice.present
    )
    chosen = [a for a in found if a.method in wanted]
    if methods is None and len(model.said.leaf_names()) > MODAL_LEAVES:
        why = f"not run: modal bodies of more than {MODAL_LEAVES} leaf springs take long; name it in methods to wait for it"
        chosen = [a if a.method != "modal" else replace(a, solve=lambda _: not_run(why)) for a in chosen]
    return as_table(
        model,
        reference,
        measured(chosen, model.said.name, reference, times, progress=boolean(progress, "progress")),
    )


def finest(mechanism: Any, targets: Mapping[str, float], **how: Any) -> tuple[Reference, Model]:
    """The reference by the finest strain-mode leaves, and its model. Errors of `ksd.solve`."""
    extrapolate = how.pop("extrapolate")
    model = compile_scene(mechanism, mesh=FINEST, **how)
    pose = converged(model, targets, extrapolate=extrapolate)
    told, orders = _told(pose), ", ".join(map(str, FINEST.orders))
    own = "" if told is None or not told < 1.0 else f" (their own error {percent(told)} %)"
    return reference_of(pose, f"strain-mode leaves of order {orders} by method {pose.method}{own}"), model


def reference_of(pose: Configuration, words: str) -> Reference:
    """A reference from one configuration."""
    places = pose.motion.x[: len(pose.model.scene.links)]
    return Reference(pose.forces, places, _moved(pose, places), words)


def _moved(pose: Configuration, places: np.ndarray) -> float:
    return float(np.linalg.norm(places - pose.model.rest.x[: len(places)], axis=1).max())


def _usual_mesh(mechanism: Any, targets: Mapping[str, float], **how: Any) -> Mesh:
    """The strain-mode leaves `ksd.solve` takes for this pose; the default ones where it has no answer."""
    try:
        return solve(mechanism, targets, estimate=False, strict=False, **how).model.mesh
    except POSE_ERRORS:
        return Mesh()


def approaches(
    scene: Scene,
    targets: Mapping[str, float],
    mesh: Mesh,
    elements: int,
    *,
    extrapolate: bool = False,
    effects: Any = "auto",
) -> list[Approach]:
    """All ways to a pose: by strain-mode leaves (`mesh`) and by so many Appendix A elements per leaf."""
    chains = Mesh("corotational", elements=elements)
    nodal = Mesh("corotational", elements=elements, mip=False, nodal=True)

    @cache
    def solver(kind: Mesh, modal: bool = False) -> Solver:
        basis = ModalBasis() if modal else None
        return Solver(scene, mesh=kind, extrapolate=extrapolate, effects=effects, basis=basis)

    def by(method: Any, kind: Mesh = mesh, **how: Any) -> Callable[[bool], Configuration]:
        made = {"modal": method == "modal"}
        return lambda estimate: solver(kind, **made)(targets, method=method, estimate=estimate, **how)

    fine, coarse = "strain-mode", f"{elements} elements"
    return [
        Approach("constant", fine, by("constant")),
        Approach("kinematic", fine, by("kinematic")),
        Approach("reduced", fine, by("reduced")),
        Approach("relinearised once", fine, by("reduced", relinearisations=1)),
        Approach("full", fine, by("full")),
        Approach("modal", fine, by("modal")),
        Approach("conventional", fine, by("conventional")),
        Approach("reduced", coarse, by("reduced", chains)),
        Approach("full", coarse, by("full", chains)),
        Approach("conventional", coarse, by("conventional", chains)),
        Approach("conventional, Newton", coarse, lambda _: solve_conventional(solver(nodal).model, targets)),
    ]


def measured(
    ways: Sequence[Approach],
    name: str,
    reference: Reference,
    repeats: int,
    *,
    progress: bool = False,
    tell: bool = True,
) -> list[Compared]:
    """A row for every way: solved once with its error figure, then timed in turns with the others without it. tell: ask
    for the error with that of the mesh."""
    rows: list[Compared | None] = [None] * len(ways)
    poses: dict[int, list[Configuration]] = {}
    with progress_bar(progress) as bar:
        task = bar.add_task(f"compare {name}", total=len(ways) + 1)
        for k, way in enumerate(ways):
            try:
                # kernels are loaded in the first call
                poses[k] = [way.solve(True) for _ in range(2)]
            except POSE_ERRORS as reason:
                said = " ".join(str(reason).split()) or type(reason).__name__
                rows[k] = Compared(way.method, way.leaves, failed=said)
            bar.advance(task)
        timed = {k: Way(ways[k].method, ways[k].leaves, 0, _without_estimate(ways[k])) for k in poses}
        calls, steps = in_turns(timed, {k: rounds_of(1e6 * c[1].time, repeats) for k, c in poses.items()})
        for k, found in poses.items():
            rows[k] = _row(ways[k], found, (calls[k], steps[k]), reference, tell=tell)
        bar.advance(task)
    return [row for row in rows if row is not None]


def _without_estimate(way: Approach) -> Callable[[], Configuration]:
    return lambda: way.solve(False)


def _row(
    way: Approach,
    poses: Sequence[Configuration],
    times: tuple[list[float], list[float]],
    truth: Reference,
    *,
    tell: bool,
) -> Compared:
    pose = poses[-1]
    places = pose.motion.x[: len(truth.places)]
    checks = [sum(s.time for s in c.steps if s.name == ESTIMATE) for c in poses]
    call, steps = (1e-6 * quartiles(spent)[1] for spent in times)
    off = float(np.linalg.norm(places - truth.places, axis=1).max())
    method_error = None if pose.method_error is None else pose.method_error.relative
    return Compared(
        way.method, way.leaves, call, steps, statistics.median(checks),
        sum(s.iterations for s in pose.steps if s.name != ESTIMATE), pose.forces, _moved(pose, places),
        _force_error(pose, truth.forces), off / truth.moved if truth.moved > 0.0 else math.nan, method_error,
        _told(pose) if tell else None, bool(pose.stable),
    )  # fmt: skip


def _force_error(pose: Configuration, forces: Mapping[str, float]) -> float:
    """Largest error of a drive force or moment over the largest of its kind; nan without drives, or where all are zero."""
    kinds: dict[str, list[str]] = {}
    for drive in pose.model.scene.drives:
        kinds.setdefault(drive_kind(drive), []).append(drive.name)
    worst = math.nan
    for names in kinds.values():
        size = max(abs(forces[n]) for n in names)
        off = max(abs(pose.forces[n] - forces[n]) for n in names)
        if size > 0.0:
            worst = float(np.nanmax([worst, off / size]))
    return worst


def _told(pose: Configuration) -> float | None:
    """The error an answer tells of itself, mesh included; None where it knows none."""
    try:
        return None if pose.error is None else float(pose.error.relative)
    except POSE_ERRORS:
        return None


def as_table(model: Model, reference: Reference, rows: Sequence[Compared]) -> Table:
    """The rows as a table; see `compare` for its columns."""
    efforts = {d.name: f"{d.name}_{EFFORT_SUFFIX[drive_kind(d)]}" for d in model.said.drives}
    facts = {
        "about": "Times: median thread time of a call with all prepared; the error figure of fast methods (estimate_us) "
        "comes on top. Errors: the larger of force and displacement error, mesh included, against "
        f"{reference.words}. Told: what the answer itself says of it.",
        "reference": reference.words,
    }
    answer = tuple(efforts.values())[:3] or ("moved_mm",)
    return Table.of_rows(
        [_columns(row, efforts) for row in rows], ("method", "leaf_springs"), name=model.said.name, facts=facts,
        leading=("time_us", *answer, "error_percent", "told_error_percent"),
    )  # fmt: skip


def _columns(row: Compared, efforts: Mapping[str, str]) -> dict[str, Any]:
    labels = {"method": row.method, "leaf_springs": row.leaves}
    if row.forces is None:
        return labels | {STATUS: row.failed}

    def in_percent(error: float | None) -> float:
        return math.nan if error is None else 100.0 * error

    return labels | {
        "time_us": 1e6 * row.call,
        "steps_us": 1e6 * row.time,
        "estimate_us": 1e6 * row.check,
        "factorisations": float(row.iterations),
        **{column: row.forces[name] for name, column in efforts.items()},
        "moved_mm": 1e3 * row.moved,
        "force_error_percent": in_percent(row.force_error),
        "displacement_error_percent": in_percent(row.place_error),
        "error_percent": in_percent(row.error),
        "estimated_error_percent": in_percent(row.estimate),
        "told_error_percent": in_percent(row.told),
        "stable": float(row.stable),
        STATUS: OK,
    }
