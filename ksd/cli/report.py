"""`ksd report SCENE.toml`: one self-contained HTML page about a scene."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ksd.cli.output import console, interrupt_message, require_answers
from ksd.cli.solve import load_with_options, merged_options, point_options, solve_warm, solver_options
from ksd.errors import KsdError, SceneError
from ksd.files import check_target, write_file
from ksd.pages.report_page import ComparedSolve, report_page
from ksd.solvers.solver import prepare
from ksd.study.questions import ALL_QUESTIONS, unanswerable_questions
from ksd.study.sweep import sweep


def run(options: argparse.Namespace) -> int:
    """Solve, sweep, compare, write. Errors as in `ksd.solve` and `ksd.load_scene`."""
    if not 2 <= options.poses <= 10_000:
        raise SceneError(f"--poses {options.poses}: between 2 and 10000 poses are possible")
    scene, targets, written = load_with_options(options.scene, options.set)
    settings = merged_options(written, options)
    if not any(targets.values()):
        raise SceneError(
            f"{options.scene}: every drive is at 0, and a report goes along a stroke; give a drive a value "
            "(--set DRIVE=VALUE), or ask for this pose alone (ksd solve)"
        )
    target = Path(options.out or Path(options.scene).with_suffix(".html"))
    check_target(target, what="--out")
    # a first solve raises the curvature modes where they are too few, and loads kernels, which the shown times exclude
    mesh = solve_warm(scene, targets, settings).model.mesh
    words = solver_options(settings) | {"mesh": mesh}
    method = {key: words[key] for key in ("method", "accuracy", "relinearisations")}
    solver = prepare(scene, **{k: v for k, v in words.items() if k not in ("method", "relinearisations")})
    pose = solver(targets, **method)
    point = point_options(written, options)
    freed = point.get("freed", pose.model.drive_names)
    share = np.linspace(-1.0 if options.both else 0.0, 1.0, options.poses)
    with interrupt_message("interrupted; no report was written"):
        table = sweep(
            scene, {n: v * share for n, v in targets.items()}, together=True, progress=not options.quiet,
            questions=_answerable_questions(scene, pose), extrapolate=solver.extrapolate,
            effects=solver.model.choice.present, order=solver.order, **method, **point,
        )  # fmt: skip
    compared = [
        _compared_solve(f"{pose.method} (this report)", lambda: pose, freed),
        *_other_methods(solver, targets, pose, freed),
    ]
    write_file(target, report_page(pose, table, compared, freed=freed), what="--out")
    console().print(
        f"{target}: {len(table)} poses, {len(table.failures)} without full answer", soft_wrap=True
    )
    require_answers(table)
    return 0


def _answerable_questions(scene: Any, pose: Any) -> tuple[str, ...]:
    """All questions the scene has an answer to, without buckling where `pose` has none."""
    missing = set(unanswerable_questions(scene))
    try:
        pose.buckling(count=1)
    except KsdError:
        missing.add("buckling")
    return tuple(q for q in ALL_QUESTIONS if q not in missing)


def _compared_solve(name: str, solve: Callable[[], Any], freed: Sequence[str]) -> ComparedSolve:
    """First drive force [N or Nm], first parasitic frequency [Hz] and stress [MPa] of the pose that `solve` returns."""
    try:
        pose = solve()
        force = next(iter(pose.forces.values()), float("nan"))
        return ComparedSolve(name, force, _first_parasitic(pose, freed), 1e-6 * pose.stress().largest_Pa)
    except KsdError as reason:
        return ComparedSolve(name, failure=str(reason))


def _first_parasitic(pose: Any, freed: Sequence[str]) -> float:
    """First parasitic frequency [Hz] with `freed` released; nan without one, for example where nothing has mass."""
    try:
        return float(pose.frequencies(count=2 + len(freed), freed=freed).first_parasitic_Hz)
    except SceneError:
        return float("nan")


def _other_methods(solver: Any, targets: dict[str, float], pose: Any, freed: Sequence[str]) -> list[Any]:
    """The same pose by the other methods, and with a finer mesh."""
    others = [
        _compared_solve(m, partial(solver, targets, method=m, estimate=False), freed)
        for m in ("reduced", "full", "conventional")
        if m != pose.method
    ]
    mesh = solver.model.mesh
    if mesh.leaf == "strain":
        orders = tuple(min(n + 2, 12) for n in mesh.orders)
        fine, label = (
            replace(mesh, orders=orders, points=max(mesh.points, max(orders) + 3)),
            f"orders {orders}",
        )
    else:
        fine = replace(mesh, elements=2 * mesh.elements)
        label = f"{fine.elements} elements per leaf"
    return [
        *others,
        _compared_solve(
            f"conventional, {label}",
            lambda: prepare(solver.model.original_scene, mesh=fine, effects=solver.model.choice.present)(
                targets, method="conventional"
            ),
            freed,
        ),
    ]
