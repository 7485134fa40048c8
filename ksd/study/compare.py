"""`ksd.compare`: one pose by every method, as a table of answers, times and errors."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np

from ksd.answers.printing import progress_bar
from ksd.checks import clear_argument_errors, name_hint, names_of, show, whole_number
from ksd.errors import ConvergenceError, KsdError, SceneError
from ksd.modal.choices import ModalBasis
from ksd.model.compile import Model, compile_scene
from ksd.model.mesh import Mesh
from ksd.scene import Mechanism, Scene
from ksd.solvers.configuration import Configuration
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.method_error import relative_error
from ksd.solvers.solver import Solver, given_values, solve
from ksd.solvers.steps import percent
from ksd.study.arguments import check_solve_options
from ksd.study.questions import EFFORT_SUFFIX
from ksd.study.table import OK, STATUS, Table

MODAL_LEAVES = 30
"""Number of leaf springs above which modal bodies are compared on request only: a call takes many seconds."""
METHODS = (
    "constant", "kinematic", "reduced", "relinearised once", "full", "modal", "conventional", "conventional, Newton",
)  # fmt: skip
"""Names of the methods that are compared; the last one uses plain Newton iterations, as in Appendix B of paper 1."""
REFERENCE_MESH = Mesh(orders=(6, 5, 9), points=14)
"""Leaf model of the reference that errors are relative to."""
WARM_UP_ROUNDS = 2
"""Rounds that are not counted."""
SLOW_CALL, MAX_TOTAL_TIME = 2e4, 1e6
"""Time [us] of a first call above which a method is timed fewer times: at least three, and not longer than MAX_TOTAL_TIME
[us] in total."""
SHORT_CALL, CALLS_IN_A_ROW = 2e3, 5
"""Of calls shorter than SHORT_CALL [us] the mean of CALLS_IN_A_ROW is taken, after one that is not timed: as in a loop over
one mechanism, the cache of the processor is then filled by the method itself. Longer calls fill it in any case."""
POSE_ERRORS = (KsdError, ArithmeticError, np.linalg.LinAlgError)
"""Errors of a method that cannot solve a scene."""


@dataclass(frozen=True)
class ComparedMethod:
    """A method with a leaf model; `solve(estimate)` solves with or without the error estimate of the method."""

    method: str
    leaves: str
    solve: Callable[[bool], Configuration]


@dataclass(frozen=True)
class Reference:
    """The solution that errors are relative to: drive forces by name [N or Nm], positions (links, 3) [m] of the links,
    largest displacement of a link [m], and a description of its leaf model and method."""

    forces: Mapping[str, float]
    positions: np.ndarray
    largest_displacement: float
    description: str


@dataclass(frozen=True)
class MethodResult:
    """Result of one method.

    Median thread times [s]: call_time; steps_time, of the compiled steps alone; estimate_time, of the error estimate.
    factorisations: their number. forces: of the drives; largest_displacement: of a link [m]. force_error,
    displacement_error: relative to the reference. estimated_error: of the method, by its own estimate; reported_error: of
    the answer, mesh included, by its own estimate. failure: why there is no result.
    """

    method: str
    leaves: str
    call_time: float = math.nan
    steps_time: float = math.nan
    estimate_time: float = math.nan
    factorisations: int = 0
    forces: Mapping[str, float] | None = None
    largest_displacement: float = math.nan
    force_error: float = math.nan
    displacement_error: float = math.nan
    estimated_error: float | None = None
    reported_error: float | None = None
    stable: bool = True
    failure: str = ""

    @property
    def error(self) -> float:
        """The larger of the errors of forces and displacements; the latter where there is no force."""
        if math.isnan(self.force_error):
            return self.displacement_error
        return max(self.force_error, self.displacement_error)


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
    number of Appendix A elements per leaf in the rows with such; repeats: number of calls of the median time, in turns with
    the other methods (fewer of slow ones); extrapolate, effects, with_, without: as in `ksd.solve`; progress: show a
    progress bar. Columns: time_us of a call of the prepared solver and steps_us of its compiled steps (thread CPU
    time), estimate_us (of the error estimate of the method, in addition), factorisations, drive forces, moved_mm (largest
    displacement of a link), force_error_percent (of a drive, over the largest force or moment), displacement_error_percent
    (of a link, over moved_mm), error_percent (the larger one; it includes the error of the mesh, as the reference has
    strain-mode leaves of order 6, 5, 9, solved by the conventional method), estimated_error_percent and
    reported_error_percent (estimates of the answer itself, of its method alone and with its mesh). A method that cannot
    solve this scene is a row whose `status` gives the reason. Raises SceneError for invalid arguments, ConvergenceError
    where the reference has no equilibrium.

    >>> pivot = ksd.Mechanism.of_joint(ksd.CrossedPivot(
    ...     ksd.Material(E=200 * GPa, nu=0.3), length=50 * mm, angle=45 * deg,
    ...     thickness=0.3 * mm, width=15 * mm,
    ... ))
    >>> table = ksd.compare(pivot, angle=20 * deg, methods=["full"], repeats=1, progress=False)
    >>> table["method"], table["angle_moment_Nm"].round(4)
    (['full', 'full'], array([0.0961, 0.0962]))
    """
    check_solve_options(mesh=None, relinearisations=0, extrapolate=extrapolate, progress=progress)
    names = METHODS if methods is None else names_of(methods, "methods")
    for name in names:
        if name not in METHODS:
            raise SceneError(f"method {show(name)} is not compared{name_hint(name, METHODS)}")
    element_count, repeats = whole_number(elements, "elements"), whole_number(repeats, "repeats")
    values = given_values(targets, drives)
    effect_options: dict[str, Any] = {"effects": effects, "with_": with_, "without": without}
    reference, model = finest_reference(mechanism, values, extrapolate=extrapolate, **effect_options)
    mesh = _default_mesh(mechanism, values, extrapolate=extrapolate, **effect_options)
    possible = compared_methods(
        model.original_scene,
        values,
        mesh,
        element_count,
        extrapolate=extrapolate,
        effects=model.choice.present,
    )
    chosen = [method for method in possible if method.method in names]
    if methods is None and len(model.original_scene.leaf_names()) > MODAL_LEAVES:
        why = f"not run: modal bodies of more than {MODAL_LEAVES} leaf springs take long; name it in methods to wait for it"
        chosen = [
            m if m.method != "modal" else replace(m, solve=lambda _: raise_not_run(why)) for m in chosen
        ]
    results = measure_methods(chosen, model.original_scene.name, reference, repeats, progress=progress)
    return as_table(model, reference, results)


def reference_configuration(
    model: Model, targets: Mapping[str, float], *, extrapolate: bool
) -> Configuration:
    """The configuration that errors are relative to: conventional, or full where that does not converge."""
    try:
        return solve_conventional(model, targets)
    except ConvergenceError:
        return Solver(model, extrapolate=extrapolate)(targets, method="full", relinearisations=1)


def finest_reference(
    mechanism: Any, targets: Mapping[str, float], *, extrapolate: bool, **effect_options: Any
) -> tuple[Reference, Model]:
    """The reference with leaves of REFERENCE_MESH, and its model. Raises what `ksd.solve` raises."""
    model = compile_scene(mechanism, mesh=REFERENCE_MESH, **effect_options)
    pose = reference_configuration(model, targets, extrapolate=extrapolate)
    error, orders = _reported_error(pose), ", ".join(map(str, REFERENCE_MESH.orders))
    own = "" if error is None or not error < 1.0 else f" (their own error {percent(error)} %)"
    return reference_from(pose, f"strain-mode leaves of order {orders} by method {pose.method}{own}"), model


def reference_from(pose: Configuration, description: str) -> Reference:
    """A reference from one configuration."""
    positions = pose.motion.x[: len(pose.model.scene.links)]
    return Reference(pose.forces, positions, _largest_displacement(pose, positions), description)


def _largest_displacement(pose: Configuration, positions: np.ndarray) -> float:
    """Largest displacement [m] of the links at positions (links, 3) [m] from the undeformed mechanism of `pose`."""
    return float(np.linalg.norm(positions - pose.model.rest.x[: len(positions)], axis=1).max())


def _default_mesh(mechanism: Any, targets: Mapping[str, float], **options: Any) -> Mesh:
    """The mesh that `ksd.solve` uses for this pose; the default one where it has no answer."""
    try:
        return solve(mechanism, targets, estimate=False, strict=False, **options).model.mesh
    except POSE_ERRORS:
        return Mesh()


def compared_methods(
    scene: Scene,
    targets: Mapping[str, float],
    mesh: Mesh,
    elements: int,
    *,
    extrapolate: bool = False,
    effects: Any = "auto",
) -> list[ComparedMethod]:
    """All methods for a pose: with strain-mode leaves (`mesh`) and with so many Appendix A elements per leaf."""
    chains = Mesh("corotational", elements=elements)
    nodal = Mesh("corotational", elements=elements, mip=False, nodal=True)

    @cache
    def solver(kind: Mesh, modal: bool = False) -> Solver:
        basis = ModalBasis() if modal else None
        return Solver(scene, mesh=kind, extrapolate=extrapolate, effects=effects, basis=basis)

    def by(method: Any, kind: Mesh = mesh, *, relinearisations: int = 0) -> Callable[[bool], Configuration]:
        modal = method == "modal"
        return lambda estimate: solver(kind, modal=modal)(
            targets, method=method, estimate=estimate, relinearisations=relinearisations
        )

    fine, coarse = "strain-mode", f"{elements} elements"
    return [
        ComparedMethod("constant", fine, by("constant")),
        ComparedMethod("kinematic", fine, by("kinematic")),
        ComparedMethod("reduced", fine, by("reduced")),
        ComparedMethod("relinearised once", fine, by("reduced", relinearisations=1)),
        ComparedMethod("full", fine, by("full")),
        ComparedMethod("modal", fine, by("modal")),
        ComparedMethod("conventional", fine, by("conventional")),
        ComparedMethod("reduced", coarse, by("reduced", chains)),
        ComparedMethod("full", coarse, by("full", chains)),
        ComparedMethod("conventional", coarse, by("conventional", chains)),
        ComparedMethod(
            "conventional, Newton", coarse, lambda _: solve_conventional(solver(nodal).model, targets)
        ),
    ]


def raise_not_run(reason: str) -> Configuration:
    """Raise ConvergenceError with the reason why a variant is not run, in place of its solution."""
    raise ConvergenceError(reason)


def quartiles(times: Sequence[float]) -> tuple[float, float, float]:
    """Lower quartile, median, upper quartile."""
    if len(times) < 2:
        return (times[0],) * 3
    low, median, high = statistics.quantiles(times, n=4, method="inclusive")
    return low, median, high


def round_count(first_call: float, repeats: int) -> int:
    """Number of timed rounds of a method from the time [us] of its first call, which may include compilation."""
    return repeats if first_call <= SLOW_CALL else max(3, min(repeats, int(MAX_TOTAL_TIME / first_call)))


def time_in_turns(
    calls: Mapping[int, Callable[[], Configuration]], rounds: Mapping[int, int]
) -> tuple[dict[int, list[float]], dict[int, list[float]]]:
    """Thread times [us] of the calls and of their steps; call k is timed rounds[k] times after the warm-up."""
    calls_in_a_row = dict.fromkeys(calls, CALLS_IN_A_ROW)
    call_times: dict[int, list[float]] = {k: [] for k in calls}
    step_times: dict[int, list[float]] = {k: [] for k in calls}
    for turn in range(WARM_UP_ROUNDS + max(rounds.values(), default=0)):
        for k, call in calls.items():
            # slow ones need no warm-up
            warm_up = WARM_UP_ROUNDS if rounds[k] > 3 else 0
            if turn >= warm_up + rounds[k]:
                continue
            count = calls_in_a_row[k]
            if turn >= warm_up and count > 1:
                call()
            step_time = 0.0
            begin = time.thread_time_ns()
            for _ in range(count):
                step_time += call().time
            call_time = 1e-3 * (time.thread_time_ns() - begin) / count
            calls_in_a_row[k] = CALLS_IN_A_ROW if call_time < SHORT_CALL else 1
            if turn >= warm_up:
                call_times[k].append(call_time)
                step_times[k].append(1e6 * (step_time / count))
    return call_times, step_times


def measure_methods(
    methods: Sequence[ComparedMethod],
    name: str,
    reference: Reference,
    repeats: int,
    *,
    progress: bool = False,
    report_error: bool = True,
) -> list[MethodResult]:
    """Results of all methods: each is solved with its error estimate, then timed in turns with the others without it.

    report_error: also evaluate `MethodResult.reported_error`.
    """
    results: list[MethodResult | None] = [None] * len(methods)
    poses: dict[int, tuple[Configuration, Configuration]] = {}
    with progress_bar(progress) as bar:
        task = bar.add_task(f"compare {name}", total=len(methods) + 1)
        for k, method in enumerate(methods):
            try:
                # kernels are loaded in the first call
                method.solve(True)
                poses[k] = method.solve(False), method.solve(True)
            except POSE_ERRORS as reason:
                failure = " ".join(str(reason).split()) or type(reason).__name__
                results[k] = MethodResult(method.method, method.leaves, failure=failure)
            bar.advance(task)
        timed = {k: partial(methods[k].solve, False) for k in poses}
        rounds = {k: round_count(1e6 * solved[0].time, repeats) for k, solved in poses.items()}
        calls, steps = time_in_turns(timed, rounds)
        for k, solved in poses.items():
            times = (calls[k], steps[k])
            results[k] = _result(methods[k], solved, times, reference, report_error=report_error)
        bar.advance(task)
    return [result for result in results if result is not None]


def _result(
    method: ComparedMethod,
    poses: tuple[Configuration, Configuration],
    times: tuple[list[float], list[float]],
    reference: Reference,
    *,
    report_error: bool,
) -> MethodResult:
    """Result of a method from its configurations without and with the error estimate, whose Newton steps the second takes,
    and its times [us] of calls and of steps."""
    pose, told = poses
    own_steps = {s.name for s in pose.steps}
    positions = pose.motion.x[: len(reference.positions)]
    estimated = None
    if told.method_error is not None:
        taken = relative_error(pose.model, pose.motion, told.motion).relative
        estimated = max(told.method_error.relative, taken)
    call_time, steps_time = (1e-6 * quartiles(own)[1] for own in times)
    difference = float(np.linalg.norm(positions - reference.positions, axis=1).max())
    largest = reference.largest_displacement
    return MethodResult(
        method=method.method,
        leaves=method.leaves,
        call_time=call_time,
        steps_time=steps_time,
        estimate_time=sum(s.time for s in told.steps if s.name not in own_steps),
        factorisations=pose.iterations,
        forces=pose.forces,
        largest_displacement=_largest_displacement(pose, positions),
        force_error=_force_error(pose, reference.forces),
        displacement_error=difference / largest if largest > 0.0 else math.nan,
        estimated_error=estimated,
        reported_error=_reported_error(replace(pose, method_error=told.method_error))
        if report_error
        else None,
        stable=bool(pose.stable),
    )


def _force_error(pose: Configuration, forces: Mapping[str, float]) -> float:
    """Largest error of a drive force or moment over the largest of its kind; nan without drives, or where all are zero."""
    kinds: dict[str, list[str]] = {}
    for drive in pose.model.scene.drives:
        kinds.setdefault(drive.dimension, []).append(drive.name)
    worst = math.nan
    for names in kinds.values():
        largest = max(abs(forces[n]) for n in names)
        difference = max(abs(pose.forces[n] - forces[n]) for n in names)
        if largest > 0.0:
            worst = float(np.nanmax([worst, difference / largest]))
    return worst


def _reported_error(pose: Configuration) -> float | None:
    """The error that an answer estimates of itself, mesh included; None without an estimate."""
    try:
        return None if pose.error is None else float(pose.error.relative)
    except POSE_ERRORS:
        return None


def as_table(model: Model, reference: Reference, results: Sequence[MethodResult]) -> Table:
    """The results as a table; see `compare` for its columns."""
    efforts = {d.name: f"{d.name}_{EFFORT_SUFFIX[d.dimension]}" for d in model.original_scene.drives}
    facts = {
        "about": "Times: median thread time of a call with all prepared; the error figure of fast methods (estimate_us) "
        "comes on top. Errors: the larger of force and displacement error, mesh included, against "
        f"{reference.description}. Reported error: the estimate of the answer itself.",
        "reference": reference.description,
    }
    answer = tuple(efforts.values())[:3] or ("moved_mm",)
    return Table.of_rows(
        [_columns(result, efforts) for result in results], ("method", "leaf_springs"), name=model.original_scene.name,
        facts=facts, leading=("time_us", *answer, "error_percent", "reported_error_percent"),
    )  # fmt: skip


def _columns(result: MethodResult, efforts: Mapping[str, str]) -> dict[str, Any]:
    """Row of the table of `compare`; efforts: column of the force of each drive by name."""
    labels = {"method": result.method, "leaf_springs": result.leaves}
    if result.forces is None:
        return labels | {STATUS: result.failure}

    def in_percent(error: float | None) -> float:
        return math.nan if error is None else 100.0 * error

    return labels | {
        "time_us": 1e6 * result.call_time,
        "steps_us": 1e6 * result.steps_time,
        "estimate_us": 1e6 * result.estimate_time,
        "factorisations": float(result.factorisations),
        **{column: result.forces[name] for name, column in efforts.items()},
        "moved_mm": 1e3 * result.largest_displacement,
        "force_error_percent": in_percent(result.force_error),
        "displacement_error_percent": in_percent(result.displacement_error),
        "error_percent": in_percent(result.error),
        "estimated_error_percent": in_percent(result.estimated_error),
        "reported_error_percent": in_percent(result.reported_error),
        "stable": float(result.stable),
        STATUS: OK,
    }
