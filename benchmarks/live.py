"""Cost of an update of the live page in plain solves, part by part, and the memory that it keeps.

    python benchmarks/live.py [--quick] [--memory] [--out FOLDER]

Shipped scenes about the drive values of their files, all numbers that follow the hand on; and a drawing of a planar four-bar
(two pins, two leaf springs) of which a point is dragged. Thread CPU time in one process, prepared solve and update in turns,
medians. --memory: resident memory of a server after 10,000 updates and after 200 tabs opened and closed in Chromium,
relative to that after 500 and after 10, which takes some minutes. Writes live.md and .json.
"""

from __future__ import annotations

import copy
import json
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from common import machine, machine_line, parse_options, write_json

import ksd
from ksd.interactive.hand import Hand
from ksd.interactive.session import Session
from ksd.interactive.tools import drawing_tools
from ksd.scene.toml_file import shipped_scenes
from ksd.units import mm
from ksd.view.sheets import sheets_pose

SCENES = {"guide": 20, "fourbar": 8, "gripper": 7, "delta_stage": 5, "six_joint_arm": 2}
"""Scenes, and the largest wanted ratio of an update to a solve; of the arm with pose and forces alone."""
DRAG_LIMIT = 45
PARTS = ("model", "solve", "shape", "forces", "stress", "stiffness", "error", "sent")


def _sent(asked: Any) -> dict[str, Any]:
    """What the page is sent of a pose."""
    return sheets_pose(asked.pose, asked.shape, asked.stress)


def _medians(rounds: list[dict[str, float]], plain: list[float]) -> dict[str, Any]:
    """Medians of the parts [us] and their multiples of the plain solve."""
    us = {p: 1e6 * statistics.median(r[p] for r in rounds) for p in PARTS if all(p in r for r in rounds)}
    solve = 1e6 * statistics.median(plain)
    total = 1e6 * statistics.median(sum(r.values()) for r in rounds)
    few = sum(us[p] for p in ("model", "solve", "shape", "forces"))
    return {
        "plain_us": solve,
        "parts_us": us,
        "over_solve": total / solve,
        "pose_and_forces_over_solve": few / solve,
    }


def follow(name: str, *, repeats: int) -> dict[str, Any]:
    """An update at every move of the first drive of a shipped scene."""
    mechanism, targets, _ = ksd.load_scene(str(shipped_scenes()[name]))
    session = Session(mechanism, targets)
    try:
        clock = time.thread_time
        solver, drive = ksd.prepare(mechanism), next(iter(targets))
        rounds, plain = [], []
        for k in range(repeats + 5):
            values = targets | {drive: targets[drive] * (1.0 - 0.5 * k / repeats)}
            start = clock()
            solver(values, strict=False)
            plain.append(clock() - start)
            session.sliders[drive].value = values[drive]
            session.cost.clear()
            update = session._update(k + 1, None)
            assert update.asked is not None and not update.refused, update.refused
            start = clock()
            json.dumps(_sent(update.asked))
            rounds.append({**update.times, "sent": clock() - start})
        return _medians(rounds[5:], plain[5:])
    finally:
        session.close()


def drag(*, repeats: int) -> dict[str, Any]:
    """An update at every move of the clamp of a leaf spring, which is a new design."""
    session = Session(None)
    with tempfile.TemporaryDirectory() as folder:
        drawing, _ = drawing_tools(Path(folder) / "fourbar.toml", session)
        hand = Hand(drawing, session)
        for tool, end, start, to in (
            ("leaf", "", (-30, 0), (-30, 20)), ("leaf", "", (30, 0), (30, 20)), ("pin", "", (-30, 20), (-30, 60)),
            ("pin", "link.3", (30, 20), (30, 60)), ("drive", "", (-30, 60), (0, 60)),
        ):  # fmt: skip
            hand.tool, hand.end = tool, end or hand.end
            hand.press((start[0] * mm, start[1] * mm))
            hand.release((to[0] * mm, to[1] * mm))
        drawing.set_drive("drive", 4 * mm, "mm")
    session.settle()
    solver, clock = ksd.prepare(session.scene), time.thread_time
    rounds, plain = [], []
    try:
        for k in range(repeats + 5):
            began = clock()
            solver(drive=4 * mm + k * 1e-6, strict=False)
            plain.append(clock() - began)
            drawing.tables["leaf"][0]["start"] = [f"{-30 - 0.05 * k} mm", 0, 0]
            tables = copy.deepcopy(drawing.tables)
            session.cost.clear()
            update = session._update(k + 1, (tables, drawing.file))
            assert update.asked is not None and not update.refused, update.refused
            began = clock()
            json.dumps(_sent(update.asked))
            rounds.append({**update.times, "sent": clock() - began})
        return _medians(rounds[5:], plain[5:])
    finally:
        session.close()


def memory(*, updates: int = 10_000, tabs: int = 200) -> dict[str, float]:
    """Ratios of resident memory after many updates, and after many tabs, to that after few."""
    mechanism, targets, _ = ksd.load_scene(str(shipped_scenes()["fourbar"]))
    session, kept = Session(mechanism, targets), dict[str, float]()
    for k in range(updates):
        session.wish("top", 0.1 + 1e-5 * k)
        session.settle()
        if k == min(500, updates // 2):
            kept["few_updates_MB"] = _resident("self")
    kept["many_updates_MB"] = _resident("self")
    session.close()
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "fourbar.toml"
        file.write_text(shipped_scenes()["fourbar"].read_text())
        command = [sys.executable, "-m", "ksd", "live", str(file), "--no-browser", "--port", "0"]
        server = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        assert server.stderr is not None
        said = (line.split() for line in server.stderr)
        address = next(word for line in said for word in line if word.startswith("http")).rstrip(";")
        time.sleep(3)
        with sync_playwright() as started:
            flags = [
                "--no-sandbox",
                "--use-gl=angle",
                "--use-angle=swiftshader",
                "--enable-unsafe-swiftshader",
            ]
            browser = started.chromium.launch(executable_path=shutil.which("chromium"), args=flags)
            for k in range(tabs):
                page = browser.new_page(viewport={"width": 400, "height": 300})
                page.goto(address)
                page.wait_for_function("window.ksdUpdates > 0")
                page.close()
                if k + 1 in (10, tabs):
                    # what a closed tab held is given back after the time to reconnect
                    time.sleep(8)
                    kept["few_tabs_MB" if k + 1 == 10 else "many_tabs_MB"] = _resident(str(server.pid))
            browser.close()
        server.kill()
        server.wait()
    kept["updates_ratio"] = kept["many_updates_MB"] / kept["few_updates_MB"]
    kept["tabs_ratio"] = kept["many_tabs_MB"] / kept["few_tabs_MB"]
    return kept


def _resident(process: str) -> float:
    """Resident memory [MB] of a process."""
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    return pages * 4096 / 1e6


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Print and store times and ratios of all scenes."""
    given = list(sys.argv[1:] if argv is None else argv)
    with_memory = "--memory" in given
    chosen = parse_options(__doc__, [word for word in given if word != "--memory"])
    repeats = 5 if chosen.quick else 100
    scenes = list(SCENES)[: 3 if chosen.quick else None]
    found: dict[str, Any] = {
        "machine": machine(), "scenes": {n: follow(n, repeats=repeats) for n in scenes}, "drag": drag(repeats=repeats),
    }  # fmt: skip
    rows = []
    for name in (*scenes, "drag of a clamp"):
        limit, c = (SCENES[name], found["scenes"][name]) if name in SCENES else (DRAG_LIMIT, found["drag"])
        each = " | ".join(f"{c['parts_us'].get(p, 0.0) / c['plain_us']:.2f}" for p in PARTS)
        few, everything = c["pose_and_forces_over_solve"], c["over_solve"]
        rows.append(f"| {name} | {c['plain_us']:.0f} | {each} | {few:.1f} | {everything:.1f} | {limit} |")
    head = f"| scene | solve [µs] | {' | '.join(PARTS)} | pose and forces | all | wanted |"
    text = f"Measured on {machine_line(found['machine'])}. Multiples of the prepared solve.\n\n{head}\n"
    text += "\n".join(["| --- " + "| ---: " * (len(PARTS) + 4) + "|", *rows, ""])
    text += "\nOf the six-joint arm what is wanted is for pose and forces; its other numbers come when the hand rests.\n"
    if with_memory:
        kept = found["memory"] = memory()
        text += (
            "\nResident memory: "
            + ", ".join(f"{k.replace('_', ' ')} {v:.3g}" for k, v in kept.items())
            + "\n"
        )
    (chosen.out / "live.md").write_text(text)
    write_json(found, chosen.out / "live.json")
    print(text)
    return found


if __name__ == "__main__":
    main()
