"""The measured figures as markdown tables, as a picture, and in the README."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from common import READINGS, machine_line, save_picture
from front import Mark, Panel, draw_fronts

from ksd.view.figure import new_figure

BEGIN, END = "<!-- measured:begin -->", "<!-- measured:end -->"
README_ROWS = {
    ("conventional, planar", 0): "`conventional` in the plane, what `ksd.solve` takes here",
    ("kinematic", 0): "`kinematic`",
    (
        "reduced, 1 step",
        0,
    ): "`reduced` with `relinearisations=1` (joints condensed again at the pose found), in space",
    ("full", 0): "`full`, in space",
    ("plain Newton", 5): "the papers' conventional program: plain Newton on all nodes, 5 elements",
}
"""Rows of the table in the README: label by method and elements per leaf."""


def percent(error: float | None) -> str:
    """Two figures of a relative error, in percent."""
    if error is None or not math.isfinite(error):
        return "-"
    if error < 5e-12:
        return "0"
    digits = max(0, 1 - math.floor(math.log10(100 * error)))
    return f"{100 * error:.{digits}f} %" if digits < 7 else f"{100 * error:.1e} %"


def span(times: dict[str, Any], digits: int = 0) -> str:
    """Median and quartiles of a time."""
    low, high = times["quartiles_us"]
    return f"{times['median_us']:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def _table(head: list[str], rows: list[list[str]], *, left: int) -> list[str]:
    marks = ["---" if k < left else "---:" for k in range(len(head))]
    return ["| " + " | ".join(cells) + " |" for cells in (head, marks, *rows)]


def solves_table(rows: list[dict[str, Any]]) -> list[str]:
    """One row per way to the configuration."""
    head = [
        "method",
        "leaves",
        "iterations",
        "steps [µs]",
        "whole call [µs]",
        "force error",
        "rotation error",
    ]
    body = [
        [
            r["method"],
            r["leaves"],
            str(r["iterations"]),
            span(r["steps"]),
            span(r["call"]),
            percent(r["force_error"]),
            percent(r["rotation_error"]),
        ]
        for r in rows
    ]
    return _table(head, body, left=2)


def iterations_table(costs: dict[str, Any]) -> list[str]:
    """One row per system: an iteration and its pieces."""
    head = ["system", "members", "unknowns", "iteration [µs]", "assembly", "factorisation", "solve", "update"]
    pieces = ("assembly", "factorisation", "solve", "update")
    body = [
        [name, str(c["members"]), str(c["unknowns"]), span(c["iteration"], 1)]
        + [f"{c['split_us'][p]:.1f}" for p in pieces]
        for name, c in costs.items()
    ]
    return _table(head, body, left=1)


def claims_table(claims: list[dict[str, Any]]) -> list[str]:
    """Targets met and missed."""
    body = [[c["what"], c["bound"], f"{c['measured']:.3g}", "met" if c["met"] else "MISSED"] for c in claims]
    return _table(["target", "wanted", "measured", ""], body, left=1)


def _why_missed(solves: dict[str, Any]) -> list[str]:
    """Parts of the time of `reduced` and `full`, and of the conventional solver, 5 elements."""
    rows = {r["method"]: r for r in solves["1"]["rows"] if r["elements"] == 5}
    steps = rows["full"]["steps_us"]
    spent = ", ".join(f"{name} {took:.0f}" for name, took in steps.items())
    mip = rows["conventional"]
    return [
        f"Where the ratios end (reading 1, one run, µs): {spent}; around them in Python",
        f"{rows['full']['call']['median_us'] - rows['full']['steps']['median_us']:.0f}. The conventional solver in "
        f"space takes {mip['iterations']} iterations, {mip['steps']['median_us']:.0f} µs in all, on the same condensed",
        "leaves: steps 1, 2 and 4 cost about as much as the iterations they save on joints this small. Joints of many",
        "leaf springs repay them: see the arm of 3x-infinity joints in `bench.json`.",
    ]


def markdown(found: dict[str, Any]) -> str:
    """All tables of speed.md."""
    lines = [
        "# Speed of the fourbar of paper 1",
        "",
        f"Measured by `benchmarks/speed.py` on {machine_line(found['machine'])}.",
        "",
        "Thread CPU time, medians (quartiles), cases in turns in one process. Steps: the compiled work of a",
        "solve; whole call: that and what Python does around it, as the user pays it. Errors against strain-mode",
        "leaf springs of orders (6, 5, 9). Plain Newton: the paper's conventional method (all element nodes, best eps_max",
        "per case); capped: no node turns more than 0.3 rad in one iteration, which the paper's does not do.",
        "Conventional, planar: 3 unknowns per node, as it is solved by itself where a scene stays in its plane.",
        "",
        "## Targets",
        "",
        *claims_table(found["claims"]),
        "",
        *_why_missed(found["solves"]),
        "",
        "## One iteration (d = 0.3 m, reading 1)",
        "",
        *iterations_table(found["iterations"]),
        "",
        "The iteration is timed inside compiled code; its pieces one by one from Python, less a call that does nothing.",
    ]
    for reading, solves in found["solves"].items():
        force, turn = solves["reference"]["force_N"], 1e3 * solves["reference"]["rotation_rad"]
        title = f"## Whole solves, d = 0.3 m, reading {reading} ({READINGS[int(reading)]})"
        said = f"Converged: force {force:.4f} N, rotation of the top link {turn:.4f} mrad."
        lines += ["", title, "", said, "", *solves_table(solves["rows"])]
    if "start_up" in found:
        lines += ["", "## Fresh processes, wall time", "", *_start_up_table(found["start_up"])]
    return "\n".join(lines) + "\n"


def _start_up_table(cases: dict[str, Any]) -> list[str]:
    keys = ("prepared_s", "solved_s", "cpu_s")
    body = [[name, *(f"{c[key]:.2f}" for key in keys)] for name, c in cases.items()]
    return _table(
        ["first solve of a process", "prepared [s]", "solved [s]", "its CPU time [s]"], body, left=1
    )


ARM_ROWS = {"mip_ms": "`conventional`", "full_ms": "`full`", "reduced_ms": "`reduced`"}
"""Rows of the arm in the README: label by the time in arm.json."""


def _arm_rows(arm: dict[str, Any]) -> list[list[str]]:
    """The three-joint arm, whose tip is driven: mean times of a call, and the largest error of `reduced`."""
    poses = list(arm["strain-mode leaves"]["location-case"].values())
    rows = []
    for key, method in ARM_ROWS.items():
        error = max(p["force_error"] for p in poses) if key == "reduced_ms" else 0.0
        mean = 1e3 * sum(p[key] for p in poses) / len(poses)
        rows.append(
            [
                f"arm of three joints, 90 leaf springs, mean of {len(poses)} poses in space: {method}",
                f"{mean:.0f}",
                percent(error),
            ]
        )
    return rows


def readme_table(found: dict[str, Any], arm: dict[str, Any]) -> str:
    """The table of the README: time and error of five methods for the fourbar of its script, where training does not pay,
    and of three for the arm (results of arm.py), where it does."""
    rows = {(r["method"], r["elements"]): r for r in found["solves"]["1"]["rows"]}
    body = [
        [name, f"{rows[key]['call']['median_us']:.0f}", percent(rows[key]["force_error"])]
        for key, name in README_ROWS.items()
    ]
    return "\n".join(
        [
            *_table(
                [
                    "the fourbar above at 300 mm, prepared",
                    "time of a call [µs]",
                    "force error of method and mesh",
                ],
                body + _arm_rows(arm),
                left=1,
            ),
            "",
            *_first_runs(found.get("start_up", {})),
            f"{machine_line(found['machine'])}; thread time, medians;",
            "`python benchmarks/speed.py --readme README.md` renews it. Times without the error estimate; errors against",
            "finer leaves, orders (curvature shapes) (6, 5, 9), so without what the model leaves out (plate stiffening: "
            "6.4 % at this pose);",
            "of the [arm](benchmarks/results/arm.md), driven at its end, on the same ones. "
            "[At equal accuracy](benchmarks/results/bench.md); more: *Measured* in the documentation.",
        ]
    )


def _first_runs(cases: dict[str, Any]) -> list[str]:
    """Sentence about the time of the first runs without compiled kernels on disk, and of a later one, if measured."""
    if not cases:
        return []
    names = ("empty cache", "empty cache, demo", "full, strain-mode")
    first, demo, later = (cases[name]["solved_s"] for name in names)
    return [
        f"A first solve with no kernels on disk takes {first:.0f} s, `ksd demo` {demo:.0f} s, later processes "
        f"{later:.1f} s (wall time)."
    ]


def insert_table(readme: Path, table: str) -> None:
    """Replace the text between the markers of `readme` by `table`. Raises ValueError without the markers."""
    text = readme.read_text()
    if text.count(BEGIN) != 1 or text.count(END) != 1 or text.index(BEGIN) > text.index(END):
        raise ValueError(f"{readme.name} needs the lines '{BEGIN}' and '{END}', once each and in this order")
    head, rest = text.split(BEGIN)
    readme.write_text(f"{head}{BEGIN}\n{table}\n{END}{rest.split(END)[1]}")


def picture(found: dict[str, Any], path: Path) -> None:
    """Error of force and rotation over the time of the compiled steps, a row per reading of the paper."""
    solves = found["solves"]
    figure = new_figure(11.0, 3.9 * len(solves))
    grid = figure.subplots(len(solves), 2, squeeze=False)
    panels = [
        Panel(
            axes, marks_of(solved["rows"], f"{key}_error"),
            f"fourbar at d = 0.3 m, reading {reading}: {READINGS[int(reading)]}", "thread time of the compiled steps", key,
        )
        for row, (reading, solved) in zip(grid, solves.items(), strict=True)
        for axes, key in zip(row, ("force", "rotation"), strict=True)
    ]  # fmt: skip
    draw_fronts(panels)
    save_picture(figure, path)


def marks_of(rows: list[dict[str, Any]], key: str) -> list[Mark]:
    """The rows of `speed.whole_solves` as marks; variants of plain Newton are left to the table."""
    return [
        Mark(r["method"], r["elements"], r["steps"]["median_us"], 100 * r[key])
        for r in rows
        if "estimate" not in r["method"] and not r["method"].startswith("plain Newton,")
    ]
