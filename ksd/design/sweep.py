"""`ksd.sweep`: all questions over drive values, load cases and designs, on any executor, into one table."""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ksd.checks import boolean, clear_argument_errors
from ksd.design.arguments import check_drives, check_executor, check_solve_options, drive_value_arrays
from ksd.design.design_scene import (
    DesignsLike,
    MechanismLike,
    add_loads,
    design_parameters,
    load_cases,
    scene_or_reason,
)
from ksd.design.questions import (
    ALL_QUESTIONS,
    Questions,
    check_questions,
    parse_questions,
    unanswerable_questions,
)
from ksd.design.resume import ResumeFile, record_hashes
from ksd.design.sweep_path import Recipe, SweepPath, drive_paths, run_path, run_paths, unanswered_rows
from ksd.design.table import Table
from ksd.errors import KsdError
from ksd.model.mesh import Mesh
from ksd.numerics.processes import process_pool, spawn_context
from ksd.properties.printing import progress_bar
from ksd.scene.link import Link
from ksd.solve.solver import METHODS, Method

PER_PROCESS = 4
"""Blocks handed to each worker, so that none idles long at the end."""
PER_BLOCK = 100
"""Poses of a block at most, as far as its lines are no longer: what is done of a block is lost when it is interrupted."""
WORTH = 200
"""Poses below which starting processes costs more than it saves."""


class SweepInterrupted(KeyboardInterrupt):
    """Ctrl-C during a sweep: `table` holds all rows done; the others say that they were not reached."""

    def __init__(self, said: str, table: Table, resume: Any = None) -> None:
        again = "" if resume is None else f"; call again with resume='{resume}' to go on"
        super().__init__(f"interrupted: {said} in .table of this exception{again}")
        self.table = table


@clear_argument_errors
def sweep(
    mechanism: MechanismLike,
    targets: Mapping[str, ArrayLike] | None = None,
    *,
    designs: DesignsLike | None = None,
    loads: Mapping[str, Sequence[Mapping[str, Any]]] | None = None,
    questions: str | Iterable[str] | None = None,
    link: Link | str | None = None,
    at: ArrayLike | None = None,
    freed: str | Iterable[str] | None = None,
    modes: int = 3,
    errors: bool = False,
    method: Method | None = None,
    accuracy: float | None = None,
    relinearisations: int = 0,
    mesh: Mesh | None = None,
    extrapolate: bool = False,
    effects: str | Iterable[str] = "auto",
    with_: str | Iterable[str] = (),
    without: str | Iterable[str] = (),
    together: bool = False,
    executor: Executor | None = None,
    progress: bool = True,
    resume: str | os.PathLike[str] | None = None,
    **drives: ArrayLike,
) -> Table:
    """Answer `questions` at every pose of every design under every load case; returns a `Table`.

    mechanism: Mechanism, Scene, or a function of the parameters in `designs` that returns one. Drive values [m or rad] by
    name, numbers or arrays: ``top=np.linspace(0, 0.3, 31)``. All combinations are walked, the array named last along the
    stroke (conventional poses start from the one before; modes keep the names of the first pose); together=True moves all
    arrays in step. designs: {"thickness": [...], ...} for all combinations, or a list of such mappings. loads: cases by
    name, each a list of dict(link=, force=, moment=, at=) added to the scene's own. questions: of "force",
    "drive_stiffness", "support_stiffness", "frequencies", "stress", "parasitic", "energy", "buckling", "size", "clearance",
    "distance" (those of `Mechanism.distance`); when None all that the mechanism has an answer to, as `ksd report` shows.
    link, at: the point asked about, link and point of the first drive when None (`Configuration.stiffness` takes the
    reference point of the link). freed: drives let go for frequencies (all when None), modes: how many are followed besides
    the intended, more where modes cross. errors: a column per question with the error of its answers, that of method and
    mesh, at several times the cost. executor: any concurrent.futures.Executor; without one, this process or, for many poses,
    a pool of processes. method, accuracy, mesh, relinearisations, extrapolate, effects, with_, without: as in `ksd.solve`.
    targets: drive values as a mapping. resume: a file that keeps finished lines; give it again to go on. progress: whether a
    bar tells how far it is. A pose that fails is a row whose `status` says why.

    Raises SceneError for what is wrong before any solve; SweepInterrupted (a KeyboardInterrupt with `.table`) on Ctrl-C.
    """
    recipe = make_recipe(
        parse_questions(ALL_QUESTIONS if questions is None else questions, link, at, freed, modes=modes, errors=errors),
        method=method, accuracy=accuracy, relinearisations=relinearisations, mesh=mesh, extrapolate=extrapolate,
        effects=(("effects", effects), ("with_", with_), ("without", without)),
    )  # fmt: skip
    check_executor(executor)
    boolean(together, "together")
    boolean(progress, "progress")
    values = drive_value_arrays(targets, drives, sweep)
    paths, name = sweep_paths(mechanism, values, designs, loads, together=together, call=sweep)
    drawn = next((path.scene for path in paths if path.scene is not None), None)
    if drawn is not None:
        check_questions(recipe.questions, drawn)
    missing = (
        unanswerable_questions(drawn, recipe.questions.link)
        if questions is None and drawn is not None
        else {}
    )
    possible = tuple(q for q in recipe.questions.names if q not in missing)
    recipe = replace(
        recipe, questions=replace(recipe.questions, names=possible, is_default=questions is None)
    )
    kept = ResumeFile(resume, lambda: fingerprint(paths, recipe))
    table = _collected(paths, recipe, kept, name, how=(executor, progress))
    said = ", ".join(f"{question} ({reason})" for question, reason in missing.items())
    return replace(table, facts={**table.facts, "left_out": said}) if said else table


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
    digest = hashlib.sha256(f"{recipe!r} {records}".encode())
    for path in paths:
        scene = path.failure if path.scene is None else path.scene.fingerprint()
        digest.update(f"{path.number} {dict(path.labels)} {scene} {path.drive_values}".encode())
    return digest.hexdigest()


def _collected(
    paths: list[SweepPath], recipe: Recipe, kept: ResumeFile, name: str, *, how: tuple[Executor | None, bool]
) -> Table:
    """The table of all lines, those kept and those computed now."""
    partial: dict[int, list[dict[str, Any]]] = {}
    facts = {"method": recipe.method or "cheapest", "questions": ", ".join(recipe.questions.names)}
    try:
        with _bar(f"sweep {name}", sum(len(path.drive_values) for path in paths), how[1]) as done:
            missing = [path for path in paths if path.number not in kept.entries]
            done(sum(len(rows) for rows in kept.entries.values()))
            _run(missing, recipe, how[0], (kept, partial, done))
    except KeyboardInterrupt:
        table = _table(paths, kept.entries | partial, name, facts)
        raise SweepInterrupted("the rows done are", table, kept.path) from None
    return _table(paths, kept.entries, name, facts)


def make_recipe(questions: Questions, **how: Any) -> Recipe:
    """How the poses of a sweep are solved; raises SceneError."""
    said = {n: how[n] for n in ("mesh", "relinearisations", "accuracy", "method", "extrapolate")}
    check_solve_options(methods=METHODS, **said)
    return Recipe(questions, **how)


def _table(paths: list[SweepPath], found: Mapping[Any, Any], name: str, facts: dict[str, str]) -> Table:
    """Rows in the order of the sweep; poses not reached say so."""
    rows: list[dict[str, Any]] = []
    labels: dict[str, None] = {}
    for path in paths:
        mine = list(found.get(path.number, ()))
        mine += unanswered_rows(path, "not reached: the sweep was interrupted", first=len(mine))
        rows += mine
        labels |= dict.fromkeys(k for k in unanswered_rows(path, "")[0] if k != "status")
    return Table.of_rows(rows, tuple(labels), moving=_moving(paths), name=name, facts=facts)


def _moving(paths: list[SweepPath]) -> tuple[str, ...]:
    """Label columns that change along a line."""
    for path in paths:
        rows = [row for row in unanswered_rows(path, "") if path.scene is not None]
        found = tuple(k for k in (rows[0] if rows else ()) if len({row[k] for row in rows}) > 1)
        if found:
            return found
    return ()


def _run(missing: list[SweepPath], recipe: Recipe, executor: Executor | None, where: Any) -> None:
    """Compute the missing lines, here or elsewhere, keeping each as it is finished."""
    poses = sum(len(path.drive_values) for path in missing)
    if executor is not None:
        _run_on(executor, missing, recipe, where)
        return
    # spawned, not forked: compiled kernels and threads do not survive a fork safely
    context = spawn_context(missing[0], recipe) if len(missing) > 1 and poses >= WORTH else None
    if context is None:
        _run_here(missing, recipe, where)
        return
    with process_pool(context) as pool:
        _run_on(pool, missing, recipe, where)


def _run_here(missing: list[SweepPath], recipe: Recipe, where: Any) -> None:
    kept, partial, done = where
    solver, scene = None, None
    for path in missing:
        rows = partial[path.number] = _Counted(done)
        solver = run_path(path, recipe, solver if path.scene is scene else None, rows)
        scene = path.scene
        kept.add(path.number, list(partial.pop(path.number)))


class _Counted(list[Any]):
    """Rows of a line under way; each one moves the bar."""

    def __init__(self, done: Any) -> None:
        super().__init__()
        self.done = done

    def append(self, row: Any) -> None:
        """Add a row."""
        super().append(row)
        self.done(1)

    def extend(self, rows: Any) -> None:
        """Add several rows."""
        for row in rows:
            self.append(row)


def _run_on(executor: Executor, missing: list[SweepPath], recipe: Recipe, where: Any) -> None:
    kept, _, done = where
    workers = getattr(executor, "_max_workers", None) or os.cpu_count() or 1
    size = math.ceil(len(missing) / (PER_PROCESS * workers))
    size = max(
        1, min(size, PER_BLOCK * len(missing) // max(1, sum(len(path.drive_values) for path in missing)))
    )
    blocks = [tuple(missing[i : i + size]) for i in range(0, len(missing), size)]
    waiting: dict[Future[Any], tuple[SweepPath, ...]] = {
        executor.submit(run_paths, b, recipe): b for b in blocks
    }
    try:
        for future in as_completed(waiting):
            for path, rows in zip(waiting[future], future.result(), strict=True):
                kept.add(path.number, rows)
                done(len(rows))
    except BrokenProcessPool as error:
        raise KsdError(
            "The sweep's processes ended unexpectedly; finished lines are kept if `resume` was given. Call sweep "
            "under `if __name__ == '__main__':`, or give it another executor."
        ) from error
    finally:
        for future in waiting:
            future.cancel()


@contextmanager
def _bar(title: str, total: int, shown: bool) -> Iterator[Any]:
    """A progress bar on stderr with the time left; yields a function that moves it on."""
    with progress_bar(shown) as bar:
        task = bar.add_task(title, total=total)
        yield lambda count: bar.advance(task, count)
