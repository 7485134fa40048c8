"""`ksd sweep SCENE.toml`: all questions over the stroke, as a table, a file and a picture."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from ksd.cli.commands import DEFAULT_POSES
from ksd.cli.output import (
    check_plot,
    check_table,
    console,
    interrupt_message,
    require_answers,
    write_table,
)
from ksd.cli.respond import damping_value, spectra
from ksd.cli.solve import drive_value, load_with_options, merged_options, point_options, solver_options
from ksd.errors import SceneError
from ksd.study.sweep import sweep


def run(options: argparse.Namespace) -> int:
    """Sweep, print, write; the row of a pose that fails has the reason, and the exit code is then 3."""
    check_plot(options.plot)
    check_table(options.out)
    scene, targets, written = load_with_options(options.scene)
    settings = merged_options(written, options)
    varied = dict(stroke_value(scene, text) for text in options.set)
    if not varied:  # the values of the file are the end of the stroke
        varied = {n: np.linspace(0.0, v, DEFAULT_POSES) for n, v in targets.items()}
    stroke = {n: v for n, v in targets.items() if n not in varied} | varied
    with interrupt_message("interrupted; no table was written", "finished lines", options.resume):
        table = sweep(
            scene, stroke, **solver_options(settings), questions=tuple(options.question) or None, together=not options.set,
            **point_options(written, options), progress=not options.quiet, resume=options.resume,
            psd=spectra(options.psd) or None, damping=damping_value(options.damping),
        )  # fmt: skip
    console().print(str(table), soft_wrap=True)
    write_table(table, options.out)
    if options.plot:
        table.plot(path=options.plot)
    require_answers(table)
    return 0


def stroke_value(scene: Any, text: str) -> tuple[str, Any]:
    """Name and values (SI) from "top=0mm:300mm:31"; a single value stays a number. Raises SceneError."""
    name, equals, words = text.rpartition("=")
    parts = words.split(":")
    if not equals or len(parts) > 3:
        raise SceneError(f"--set {text}: write it as DRIVE=FROM:TO:POSES, for example --set top=0mm:300mm:31")
    ends = [drive_value(scene, f"{name}={part}") for part in parts[:2]]
    if len(ends) == 1:
        return ends[0]
    poses = DEFAULT_POSES if len(parts) == 2 else _pose_count(parts[2], text)
    return ends[0][0], np.linspace(ends[0][1], ends[1][1], poses)


def _pose_count(word: str, text: str) -> int:
    """The number of poses in the argument `text` of --set. Raises SceneError unless it is 2 to 100000."""
    if not word.strip().isdecimal() or not 2 <= int(word) <= 100_000:
        raise SceneError(f"--set {text}: POSES = {word} must be a whole number between 2 and 100000")
    return int(word)
