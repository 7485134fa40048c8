"""`ksd.sweep`: all questions over drive values, load cases and designs, on any executor, into one table."""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor, Future, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ksd.answers.parasitic import wanted_motion
from ksd.answers.plant import Damping
from ksd.answers.printing import progress_bar
from ksd.checks import boolean, clear_argument_errors
from ksd.errors import KsdError
from ksd.model.mesh import Mesh
from ksd.numerics.processes import process_pool, spawn_context
from ksd.numerics.threads import small_matrices
from ksd.scene.link import Link
from ksd.solvers.loading_order import Order, check_order
from ksd.solvers.random_vibration import Spectrum
from ksd.solvers.solver import Method
from ksd.study.arguments import check_drives, check_executor, drive_value_arrays
from ksd.study.design_scene import (
    DesignsLike,
    MechanismLike,
    add_loads,
    design_parameters,
    load_cases,
    scene_or_reason,
)
from ksd.study.questions import (
    check_questions,
    parse_questions,
    unanswerable_questions,
)
from ksd.study.resume import ResumeFile, record_hashes
from ksd.study.sweep_path import (
    Recipe,
    SweepPath,
    drive_paths,
    row_labels,
    run_path,
    run_paths,
    unanswered_rows,
)
from ksd.study.table import STATUS, Table

BLOCKS_PER_WORKER = 4
"""Blocks of paths for each worker, so that none is idle for long at the end."""
MAX_POSES_PER_BLOCK = 100
"""Largest number of poses of a block of several paths: an interruption loses the unfinished blocks."""
MIN_POSES_FOR_PROCESSES = 200
"""Number of poses below which starting processes costs more than it saves."""


class SweepInterrupted(KeyboardInterrupt):
    """Ctrl-C during a sweep: `table` holds all finished rows; the status of the others is that they were not reached.

    >>> guide, _, _ = ksd.load_scene("guide")
    >>> try:
    ...     table = ksd.sweep(guide, table=[2.5 * mm, 5 * mm], questions="force", progress=False)
    ... except ksd.SweepInterrupted as stop:  # Ctrl-C
    ...     table = stop.table
    >>> table["status"]
    ['ok', 'ok']
    """

    def __init__(self, message: str, table: Table, resume: Any = None) -> None:
        again = "" if resume is None else f"; call again with resume='{resume}' to go on"
        super().__init__(f"interrupted: {message} in .table of this exception{again}")
        self.table = table


@clear_argument_errors
@small_matrices
def sweep(
    mechanism: MechanismLike,
    targets: Mapping[str, ArrayLike] | None = None,
    *,
    designs: DesignsLike | None = None,
    loads: Mapping[str, Sequence[Mapping[str, Any]]] | None = None,
    questions: str | Iterable[str] | None = None,
    link: Link | str | None = None,
    at: ArrayLike | None = None,
    along: ArrayLike | str | None = None,
    freed: str | Iterable[str] | None = None,
    modes: int = 3,
    errors: bool = False,
    psd: Mapping[str, Spectrum] | None = None,
    damping: Damping | None = None,
    method: Method | None = None,
    accuracy: float | None = None,
    relinearisations: int = 0,
    mesh: Mesh | None = None,
    extrapolate: bool = False,
    strict: bool = True,
    effects: str | Iterable[str] = "auto",
    with_: str | Iterable[str] = (),
    without: str | Iterable[str] = (),
    order: Order = "loads",
    together: bool = False,
    executor: Executor | None = None,
    progress: bool = True,
    resume: str | os.PathLike[str] | None = None,
    **drives: ArrayLike,
) -> Table:
    """Answer `questions` at every pose of every design under every load case; returns a `Table`.

    mechanism: Mechanism, Scene, or a function of the parameters in `designs` that returns one. Drive values [m or rad] by
    name, numbers or arrays: ``top=np.linspace(0, 0.3, 31)``. All combinations are solved, the array named last along the
    stroke (conventional poses start from the previous one; modes keep the names of the first pose); together=True varies all
    arrays together. designs: {"thickness": [...], ...} for all combinations, or a list of such mappings. loads: cases by
    name, each a list of dict(link=, force=, moment=, at=) added to the scene's own. questions: of "force" (those of stops,
    cables and contacts too), "drive_stiffness", "support_stiffness", "frequencies", "stress", "parasitic", "energy",
    "buckling", "size", "clearance", "distance" (those of `Mechanism.distance`), "vibration"; when None all that the
    mechanism has an answer to, as `ksd report` shows. link, at: the point of "support_stiffness" and "parasitic", link and
    point of the first drive when None
    (`Configuration.stiffness` takes the reference point of the link). along: direction of the wanted displacement, which
    alone is removed for "parasitic" then (`Configuration.parasitic`). freed: drives released for frequencies (all when
    None), modes: how many are followed in addition to the intended ones, more where modes cross. errors: a column per
    question with the error of its answers, that of method and mesh, at several times the cost. psd, damping: spectra by
    input and damping of "vibration", as in `Configuration.random_vibration`, whose columns are the rms value of every
    sensor and the settling time in which every mode decays to 2 %. executor: any
    concurrent.futures.Executor; without one, this process or, for many poses, a pool of processes. method, accuracy, mesh,
    relinearisations, extrapolate, effects, with_, without, order: as in `ksd.solve`. targets: drive values as a mapping.
    resume: a file that keeps finished paths; give it again to continue. progress: show a progress bar. A pose that fails, or
    that `ksd.solve` would refuse, is a row without answers whose `status` gives the reason; with strict=False a refused pose
    is answered, and its status still gives the reason.

    Raises SceneError for invalid input before any solve; SweepInterrupted (a KeyboardInterrupt with `.table`) on Ctrl-C.

    >>> guide, _, _ = ksd.load_scene("guide")
    >>> table = ksd.sweep(guide, table=[2.5 * mm, 5 * mm], questions="force", progress=False)
    >>> table["table_force_N"].round(3)
    array([2.504, 5.036])
    """
    recipe = Recipe(
        parse_questions(
            questions, link, at, freed, along=along, modes=modes, errors=errors, psd=psd, damping=damping
        ),
        method=method, accuracy=accuracy, relinearisations=relinearisations, mesh=mesh, extrapolate=extrapolate,
        strict=strict,
        effects=(("effects", effects), ("with_", with_), ("without", without), *_order_option(order)),
    )  # fmt: skip
    check_executor(executor)
    boolean(together, "together")
    boolean(progress, "progress")
    values = drive_value_arrays(targets, drives, sweep)
    paths, name = sweep_paths(mechanism, values, designs, loads, together=together, call=sweep)
    scene = next((path.scene for path in paths if path.scene is not None), None)
    if scene is not None:
        check_questions(recipe.questions, scene)
    left_out = {}
    if questions is None and scene is not None:
        unanswerable = unanswerable_questions(scene, recipe.questions.link)
        left_out = {q: reason for q, reason in unanswerable.items() if q in recipe.questions.names}
    names = tuple(q for q in recipe.questions.names if q not in left_out)
    recipe = replace(recipe, questions=replace(recipe.questions, names=names, is_default=questions is None))
    finished = ResumeFile(resume, lambda: fingerprint(paths, recipe))
    table = _solve_paths(paths, recipe, finished, name, executor, progress)
    facts = {"left_out": ", ".join(f"{question} ({reason})" for question, reason in left_out.items())}
    if recipe.questions.along is not None and "parasitic" in names:
        facts["about"] = f"parasitic motion: in addition to {wanted_motion(recipe.questions.along)}"
    return replace(table, facts={**table.facts, **{k: text for k, text in facts.items() if text}})


def _order_option(order: Order) -> tuple[tuple[str, Any], ...]:
    """The loading order as an option of a solver; none for the usual one, so that files of resumed sweeps stay valid."""
    return () if check_order(order) == "loads" else (("order", order),)


def sweep_paths(
    mechanism: Any, values: Mapping[str, np.ndarray], designs: Any, loads: Any, *, together: bool, call: Any
) -> tuple[list[SweepPath], str]:
    """All paths of a sweep, and the name of the mechanism.

    call: the public function whose parameter names are suggested for a misspelt drive. Raises SceneError.
    """
    drives = drive_paths(values, together=together)
    cases = load_cases(loads)
    paths: list[SweepPath] = []
    name = ""
    for parameters in design_parameters(mechanism, designs):
        scene, failure = scene_or_reason(mechanism, parameters)
        name = name or getattr(scene, "name", "")
        if scene is not None and designs is None:
            check_drives(scene, tuple(values), call)
        for case, extra in cases.items():
            loaded, load_failure = add_loads(scene, extra)
            labels = dict(parameters) | ({} if loads is None else {"load_case": case})
            paths += [
                SweepPath(len(paths) + k, labels, loaded, p, failure or load_failure)
                for k, p in enumerate(drives)
            ]
    reference = next((path.scene for path in paths if path.scene is not None), None)
    return [p if p.scene is not None else replace(p, reference_scene=reference) for p in paths], name


def fingerprint(paths: Sequence[SweepPath], recipe: Recipe) -> str:
    """Hash of everything the rows depend on."""
    records = record_hashes((path.scene for path in paths if path.scene is not None), recipe.method)
    digest = hashlib.sha256(f"{recipe.fingerprint_text()} {records}".encode())
    for path in paths:
        scene = path.failure if path.scene is None else path.scene.fingerprint()
        digest.update(f"{path.number} {dict(path.labels)} {scene} {path.drive_values}".encode())
    return digest.hexdigest()


class _Results(NamedTuple):
    """Where the rows of a sweep go: finished paths, rows by number of unfinished ones, and the function that advances the
    progress bar by so many poses."""

    finished: ResumeFile
    partial: dict[int, list[dict[str, Any]]]
    advance: Callable[[int], None]


def _solve_paths(
    paths: list[SweepPath],
    recipe: Recipe,
    finished: ResumeFile,
    name: str,
    executor: Executor | None,
    progress: bool,
) -> Table:
    """The table of all paths; those in `finished` are not solved again. Raises SweepInterrupted."""
    unfinished: dict[int, list[dict[str, Any]]] = {}
    facts = {"method": recipe.method or "cheapest", "questions": ", ".join(recipe.questions.names)}
    try:
        with progress_bar(progress) as bar:
            task = bar.add_task(f"sweep {name}", total=_pose_count(paths))
            advance = partial(bar.advance, task)
            missing = [path for path in paths if path.number not in finished.entries]
            advance(sum(len(rows) for rows in finished.entries.values()))
            _run(missing, recipe, executor, _Results(finished, unfinished, advance))
    except KeyboardInterrupt:
        table = _table(paths, finished.entries | unfinished, name, facts)
        raise SweepInterrupted("the rows done are", table, finished.path) from None
    return _table(paths, finished.entries, name, facts)


def _pose_count(paths: Iterable[SweepPath]) -> int:
    return sum(len(path.drive_values) for path in paths)


def _table(
    paths: list[SweepPath], rows_by_path: Mapping[Any, Any], name: str, facts: dict[str, str]
) -> Table:
    """Rows in the order of the sweep; the status of poses that were not reached says so."""
    rows: list[dict[str, Any]] = []
    labels: dict[str, None] = {}
    for path in paths:
        known = list(rows_by_path.get(path.number, ()))
        rows += known
        rows += unanswered_rows(path, "not reached: the sweep was interrupted", first=len(known))
        labels |= dict.fromkeys(k for k in row_labels(path, path.drive_values[0]) if k != STATUS)
    return Table.of_rows(rows, tuple(labels), moving=_varied_labels(paths), name=name, facts=facts)


def _varied_labels(paths: list[SweepPath]) -> tuple[str, ...]:
    """Label columns that vary along a path."""
    for path in (path for path in paths if path.scene is not None):
        rows = [row_labels(path, values) for values in path.drive_values]
        varied = tuple(k for k in rows[0] if len({row[k] for row in rows}) > 1)
        if varied:
            return varied
    return ()


def _run(paths: list[SweepPath], recipe: Recipe, executor: Executor | None, results: _Results) -> None:
    """Solve paths in an executor, in this process, or, where there are many poses, in a pool of processes."""
    if executor is not None:
        _run_in_executor(executor, paths, recipe, results)
        return
    # spawned, not forked: compiled kernels and threads do not survive a fork safely
    many = len(paths) > 1 and _pose_count(paths) >= MIN_POSES_FOR_PROCESSES
    context = spawn_context(paths[0], recipe) if many else None
    if context is None:
        _run_here(paths, recipe, results)
        return
    with process_pool(context) as pool:
        _run_in_executor(pool, paths, recipe, results)


def _run_here(paths: list[SweepPath], recipe: Recipe, results: _Results) -> None:
    """Solve paths in this process; paths of the same scene that follow each other share their solver."""
    solver, scene = None, None
    for path in paths:
        rows = results.partial[path.number] = _CountedRows(results.advance)
        solver = run_path(path, recipe, solver if path.scene is scene else None, rows)
        scene = path.scene
        results.finished.add(path.number, list(results.partial.pop(path.number)))


class _CountedRows(list[Any]):
    """Rows of an unfinished path; each one added advances the progress bar."""

    def __init__(self, advance: Callable[[int], None]) -> None:
        super().__init__()
        self.advance = advance

    def append(self, row: Any) -> None:
        """Add a row."""
        super().append(row)
        self.advance(1)

    def extend(self, rows: Any) -> None:
        """Add several rows."""
        for row in rows:
            self.append(row)


def _run_in_executor(executor: Executor, paths: list[SweepPath], recipe: Recipe, results: _Results) -> None:
    """Solve paths in blocks in the workers of an executor. Raises KsdError where a worker process dies."""
    workers = getattr(executor, "_max_workers", None) or os.cpu_count() or 1
    size = math.ceil(len(paths) / (BLOCKS_PER_WORKER * workers))
    size = max(1, min(size, MAX_POSES_PER_BLOCK * len(paths) // max(1, _pose_count(paths))))
    blocks = [tuple(paths[i : i + size]) for i in range(0, len(paths), size)]
    futures: dict[Future[Any], tuple[SweepPath, ...]] = {
        executor.submit(run_paths, block, recipe): block for block in blocks
    }
    try:
        for future in as_completed(futures):
            for path, rows in zip(futures[future], future.result(), strict=True):
                results.finished.add(path.number, rows)
                results.advance(len(rows))
    except BrokenProcessPool as error:
        raise KsdError(
            "The sweep's processes ended unexpectedly; finished lines are kept if `resume` was given. Call sweep "
            "under `if __name__ == '__main__':`, or give it another executor."
        ) from error
    finally:
        for future in futures:
            future.cancel()
