"""`ksd optimise JOB.toml`: the best design of a job file, as tables, files, pictures and a page."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ksd.cli.output import (
    check_json,
    check_plot,
    check_table,
    interrupt_message,
    show,
    write_table,
)
from ksd.cli.solve import number_or_text
from ksd.errors import ConvergenceError, SceneError
from ksd.files import check_target, write_file
from ksd.optimisation.job_file import load_job
from ksd.optimisation.optimise import optimise
from ksd.scene.formula import si_value
from ksd.study.table import Table


def run(options: argparse.Namespace) -> int:
    """Load, optimise, print, write. Errors as in `ksd.load_job` and `ksd.optimise`."""
    check_json(options.json)
    check_plot(options.plot)
    for path, what in ((options.report, "--report"), (options.save, "--save")):
        if path is not None:
            check_target(Path(path), what=what)
    check_table(options.out)
    job, words = load_job(options.job, drives=dict(_name_and_value(text, "--set") for text in options.set))
    words |= {k: v for k in ("starts", "method", "robust", "seed") if (v := getattr(options, k)) is not None}
    if options.start:
        given = dict(_name_and_value(text, "--start") for text in options.start)
        words["start"] = {n: si_value(number_or_text(v), f"--start {n}") for n, v in given.items()}
    if not words.get("robust", 0.0):
        # the file may hold the scatter of a robust optimum that is not asked for now
        words = {k: v for k, v in words.items() if k not in ("robust", "spread")}
    with interrupt_message("interrupted; nothing more was written", "the designs done", options.resume):
        try:
            best = optimise(job, **words, resume=options.resume, progress=not options.quiet)
        except ConvergenceError as failed:
            if isinstance(failed.result, Table):
                write_table(failed.result, options.out)
            raise
    show(options.json, best.as_dict, str(best))
    write_table(best.table, options.out)
    if options.plot:
        best.plot(options.plot)
    if options.report:
        best.report(options.report)
    if options.save:
        worst = job.poses[job.answers[job.names.index(best.worst)].pose or 0][1]
        of_file: Any = job.function
        write_file(options.save, of_file.written(best.design, worst), what="scene file")
    return 0


def _name_and_value(text: str, option: str) -> tuple[str, str]:
    """Name and value of NAME=VALUE. SceneError for anything else."""
    name, equals, value = (part.strip() for part in text.rpartition("="))
    if not (name and equals and value):
        raise SceneError(f"{option} {text}: write it as NAME=VALUE, for example {option} {_EXAMPLES[option]}")
    return name, value


_EXAMPLES = {"--set": "turn=0deg:30deg:3", "--start": "joint.cross.thickness=0.4mm"}
