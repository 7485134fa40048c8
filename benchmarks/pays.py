"""Where a record of a joint pays: joints 1 to 12 in series, 2 to 24 leaf springs in each, 1 to 10,000 poses.

Straight guides drawn with so many parallel leaf springs are trained and put in series, their axes y and z in turns, each
driven, a force at the end. Prepared solves by every method, thread CPU medians in turns; a training counts all its
processes. The table says what a pose takes and from how many poses a record of one's own pays, its training included; the
picture shows error over time of all methods for one small and one large mechanism.
Run: python benchmarks/pays.py [--quick]
"""

from __future__ import annotations

import math
import os
import tempfile
import warnings
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from resource import RUSAGE_CHILDREN, RUSAGE_SELF, getrusage
from typing import Any

import numpy as np
from common import (
    STEEL,
    cross_flexure,
    figure_grid,
    fourbar,
    label_axes,
    machine,
    machine_line,
    parse_options,
    save_picture,
    time_in_turns,
    write_json,
)

import ksd
from ksd.errors import KsdError
from ksd.solvers.method_error import relative_error
from ksd.study.compare import REFERENCE_MESH
from ksd.units import mm
from ksd.view.figure import LINE_COLORS

JOINTS, LEAVES = (1, 3, 6, 12), (2, 4, 8, 16, 24)
POSES = (1, 100, 10_000)
METHODS: tuple[Any, ...] = ("kinematic", "reduced", "full", "conventional")
MARKERS = "osD^vP"
SLIDE = 4 * mm
"""Motion of every guide [m]."""


def drawn_guide(leaves: int) -> ksd.DrawnJoint:
    """A straight guide drawn with so many parallel leaf springs: overconstrained from three on."""
    made = [
        ksd.Leaf(
            start=(0, y, 0), end=(100 * mm, y, 0), width_axis=(0, 0, 1), section=ksd.rectangle(0.5 * mm, 20 * mm),
            material=STEEL, name=f"leaf {k}",
        )
        for k, y in enumerate(np.linspace(-30 * mm, 30 * mm, leaves))
    ]  # fmt: skip
    return ksd.DrawnJoint(
        f"guide of {leaves}",
        blocks={"A": (0, 0, 0), "B": (100 * mm, 0, 0)},
        leaves=made,
        motions=[ksd.Motion("slide", "translation", (0, 1, 0), (-12 * mm, 12 * mm))],
    )


def open_arm(joints: Sequence[Any], *, turn: float) -> tuple[ksd.Mechanism, dict[str, float]]:
    """Joints in series along x, their axes z and y in turns, each driven by `turn` [rad or m], a force at the end."""
    scene, x, targets = ksd.Mechanism("arm"), 0.0, {}
    before: Any = scene.ground
    for k, joint in enumerate(joints):
        link = scene.link(f"link {k}")
        placed = scene.join(
            before, link, joint, at=(x, 0, 0), axis="zy"[k % 2], toward="x", name=f"joint {k}"
        )
        before, x = link, x + float(joint.pose_B[0]) + 50 * mm
        for motion in joint.motions:
            name = f"{k} {motion.name}"
            scene.actuate_joint(placed, name=name, motion=motion.name)
            targets[name] = turn
    scene.load(before, force=(0.0, 0.5, -0.5), at=(x, 0, 0))
    return scene, targets


def platform(joint: Any, *, legs: int, share: float) -> tuple[ksd.Mechanism, dict[str, float]]:
    """A platform on `legs` equal parallel legs along y with a joint at either end, driven along x, under a force."""
    high, wide, scene = 4.0 * joint.length, 3.0 * joint.length, ksd.Mechanism("platform")
    top = scene.link("top")
    for k in range(legs):
        leg = scene.link(f"leg {k}")
        scene.join(scene.ground, leg, joint, at=(k * wide, 0, 0), axis="z", toward="y", name=f"foot {k}")
        scene.join(leg, top, joint, at=(k * wide, high, 0), axis="z", toward="y", name=f"head {k}")
    scene.actuate(top, along="x", at=(0, high, 0), name="drive")
    scene.load(top, force=(0.0, -1.0, 0.2), at=(0, high, 0))
    return scene, {"drive": 0.7 * share * high}


def cpu_seconds() -> float:
    """CPU time [s] of this process and of those it has ended."""
    return sum(u.ru_utime + u.ru_stime for u in map(getrusage, (RUSAGE_SELF, RUSAGE_CHILDREN)))


def train(leaves: Sequence[int], folder: str) -> dict[int, float]:
    """Train the guides into a folder, from which records are read from then on; CPU seconds of each."""
    spent = {}
    for n in leaves:
        begin = cpu_seconds()
        with warnings.catch_warnings():
            # guides of many leaf springs are fitted to 5e-4 instead of 2e-4
            warnings.simplefilter("ignore")
            ksd.train(drawn_guide(n), out=folder, meshes=("strain",), progress=False)
        spent[n] = cpu_seconds() - begin
    os.environ["KSD_DATABASE"] = folder
    return spent


def measured(joints: int, leaves: int, *, repeats: int) -> dict[str, Any]:
    """Times [us] of prepared solves of so many guides in series, and what the joints' bodies take once more [us]."""
    scene, targets = open_arm([drawn_guide(leaves)] * joints, turn=SLIDE)
    solver = ksd.prepare(scene)
    begin = cpu_seconds()
    solver.five_steps  # noqa: B018
    prepared = 1e6 * (cpu_seconds() - begin)
    cases = {m: partial(solver, targets, method=m) for m in METHODS}
    cases |= {"reduced alone": partial(solver, targets, method="reduced", estimate=False)}
    cases |= {"chosen": partial(solver, targets)}
    times = {n: t.median for n, t in time_in_turns(cases, repeats=repeats, warm=5).items()}
    told = solver(targets, method="reduced").method_error
    assert told is not None
    return {"joints": joints, "leaves": leaves, "us": times, "prepare_us": prepared, "told": told.relative}


def poses_until_it_pays(row: Mapping[str, Any], training: float) -> float:
    """From how many poses `reduced` with a record of one's own takes less than `conventional`; training [s]."""
    saved = row["us"]["conventional"] - row["us"]["reduced"]
    return math.inf if saved <= 0 else (1e6 * training + row["prepare_us"]) / saved


def errors_over_time(
    scene: Any, targets: Mapping[str, float], *, repeats: int
) -> dict[str, dict[str, float]]:
    """Time [us] and error of every method, against finer leaves; methods that do not solve the scene are left out."""
    solver = ksd.prepare(scene)
    fine = ksd.prepare(scene, mesh=REFERENCE_MESH)(targets, method="conventional")
    cases: dict[str, Any] = {}
    ways: dict[str, dict[str, Any]] = {
        "constant": {"method": "constant", "estimate": False}, "kinematic": {"method": "kinematic", "estimate": False},
        "reduced alone": {"method": "reduced", "estimate": False}, "reduced": {"method": "reduced"},
        "full": {"method": "full"}, "conventional": {"method": "conventional"},
    }  # fmt: skip
    for name, words in ways.items():
        try:
            solver(targets, strict=False, **words)
            cases[name] = partial(solver, targets, strict=False, **words)
        except KsdError:
            continue
    times = time_in_turns(cases, repeats=repeats, warm=3)
    found = {}
    for name, case in cases.items():
        pose = case()
        nodes = pose.model.links
        state = pose.motion._replace(x=pose.motion.x[:nodes], R=pose.motion.R[:nodes])
        exact = fine.motion._replace(x=fine.motion.x[:nodes], R=fine.motion.R[:nodes])
        error = relative_error(pose.model, state, exact).relative
        found[name] = {"us": times[name].median, "error": max(error, 1e-9)}
    return found


def large() -> tuple[ksd.Mechanism, dict[str, float]]:
    """The large mechanism of the picture: an arm of nine cross flexures."""
    return open_arm([cross_flexure()] * 9, turn=0.3)


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Measure, print, write; returns what was found."""
    asked = parse_options(__doc__, argv)
    joints, leaves, repeats = ((1, 3), (2, 4), 3) if asked.quick else (JOINTS, LEAVES, 15)
    with tempfile.TemporaryDirectory() as folder:
        before = os.environ.get("KSD_DATABASE")
        try:
            training = train(leaves, folder)
            rows = [measured(j, n, repeats=repeats) for n in leaves for j in joints]
        finally:
            os.environ.pop("KSD_DATABASE") if before is None else os.environ.update(KSD_DATABASE=before)
    for row in rows:
        row["pays_from_poses"] = poses_until_it_pays(row, training[row["leaves"]])
    scenes = {"small: fourbar in the plane": (fourbar(), {"top": 0.2})}
    scenes["large: arm of nine joints"] = large()
    errors = {n: errors_over_time(*s, repeats=repeats) for n, s in scenes.items()}
    found = {"machine": machine(), "training_s": training, "rows": rows, "errors": errors}
    write_json(found, asked.out / "pays.json")
    lines = table(found)
    (asked.out / "pays.md").write_text("\n".join(lines) + "\n")
    print("\n".join(lines))
    picture(found, asked.out / "pays.png")
    return found


def table(found: Mapping[str, Any]) -> list[str]:
    """Times by size as a table in Markdown."""
    lines = [
        "Guides of parallel leaf springs in series, every one driven by 4 mm; prepared solves [us]. `reduced` with its",
        "error, in brackets the ratio of `conventional` to it. The last columns: CPU time with `reduced` and a training of",
        "one's own, over that of `conventional`.", "",
        "| leaf springs in each | joints | conventional | full | reduced | chosen | training [s] | pays from poses | "
        + " | ".join(f"{n:,} poses" for n in POSES) + " |",
        "|" + " ---: |" * (8 + len(POSES)),
    ]  # fmt: skip
    for row in found["rows"]:
        us, spent = row["us"], found["training_s"][row["leaves"]]
        pays = row["pays_from_poses"]
        ratios = [
            (1e6 * spent + row["prepare_us"] + n * us["reduced"]) / (n * us["conventional"]) for n in POSES
        ]
        cells = [
            row["leaves"], row["joints"], f"{us['conventional']:.0f}", f"{us['full']:.0f}",
            f"{us['reduced']:.0f} ({us['conventional'] / us['reduced']:.1f})", f"{us['chosen']:.0f}", f"{spent:.1f}",
            f"{pays:,.0f}" if math.isfinite(pays) else "never", *(f"{r:.2g}" for r in ratios),
        ]  # fmt: skip
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return [*lines, "", f"Measured {machine_line(found['machine'])}; thread time, medians."]


def picture(found: Mapping[str, Any], path: Path) -> None:
    """Error over time of all methods of both mechanisms."""
    scenes = found["errors"]
    figure, (row,) = figure_grid(1, len(scenes), size=(4.6, 3.4), title="What accuracy costs in time")
    for axes, (name, methods) in zip(row, scenes.items(), strict=True):
        for k, (method, point) in enumerate(methods.items()):
            color = LINE_COLORS[k % len(LINE_COLORS)]
            axes.semilogy(point["us"], 100 * point["error"], MARKERS[k], color=color, label=method)
        axes.margins(0.1, 0.15)
        axes.set_xlim(left=0)
        label_axes(axes, x="time of a prepared solve [us]", y="error of force or place [%]", title=name)
    save_picture(figure, path)


if __name__ == "__main__":
    main()
