"""`ksd bench`: every method on the shipped scenes in one run, time beside error, as the tables of `ksd compare`.

Layout of the JSON file: "machine" (date, processor, versions), "times" (what they are), "cases": by name of the scene
"repeats" and "rows", those of its table (`ksd.compare`).
"""

from __future__ import annotations

import argparse
import os
import platform
from datetime import date
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ksd.cli.output import STDOUT, check_json, console, write_json
from ksd.errors import SceneError
from ksd.library.result_files import json_object
from ksd.scene.toml_file import load_scene, shipped_scenes
from ksd.study.compare import compare
from ksd.version import __version__

QUICK_REPEATS, DEFAULT_REPEATS = 3, 9
"""Measurements per method."""


def run(options: argparse.Namespace) -> int:
    """Measure, print, write. Raises SceneError for a WORD no scene holds."""
    check_json(options.json)
    words = options.case or [""]
    scenes = [n for n in sorted(shipped_scenes()) if not n.endswith("_job")]
    chosen = [n for n in scenes if any(w.lower() in n for w in words)]
    if not chosen:
        raise SceneError(
            f"--case {' '.join(words)}: no such scene of the benchmark; there are: {', '.join(scenes)}"
        )
    repeats, quiet = QUICK_REPEATS if options.quick else DEFAULT_REPEATS, options.json == STDOUT
    cases = {}
    for name in chosen:
        mechanism, targets, _ = load_scene(name)
        table = compare(mechanism, targets, repeats=repeats, progress=not quiet)
        cases[name] = {"repeats": repeats, "rows": list(table.rows())}
        if not quiet:
            console().print(str(table), soft_wrap=True)
    if options.json:
        found = {"machine": machine_facts(), "times": "median thread CPU time", "cases": cases}
        write_json(json_object(found), options.json)
    return 0


def machine_facts() -> dict[str, Any]:
    """Date, processor and versions, without anything that identifies the computer."""
    return {
        "date": date.today().isoformat(),
        "processor": _processor(),
        "logical_cores": os.cpu_count(),
        "load_average": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
        "python": platform.python_version(),
        "ksd": __version__,
        **{package: version(package) for package in ("numpy", "numba")},
    }


def _processor() -> str:
    """Name of the processor, that of the machine type where it is unknown."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [s.split(":", 1)[1].strip() for s in lines if s.startswith("model name")]
    return names[0] if names else platform.machine()
