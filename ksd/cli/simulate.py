"""`ksd simulate SCENE.toml`: the motion of a scene in time, as a table, files, a plot and a film."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ksd.cli.output import STDOUT, check_json, check_plot, console, write_json
from ksd.cli.solve import drive_value, number_or_text
from ksd.errors import SceneError
from ksd.files import check_target
from ksd.library.result_files import json_object
from ksd.scene.toml_file import load_scene
from ksd.scene.toml_schema import SIMULATE
from ksd.study.simulate import simulate

WRITERS = {".csv": "to_csv", ".h5": "to_hdf5", ".hdf5": "to_hdf5", ".mat": "to_mat"}
"""Method of `History` that writes the file of --out, by its ending."""


def run(options: argparse.Namespace) -> int:
    """Simulate, print, write. Errors as in `ksd.load_scene` and `ksd.simulate`."""
    check_json(options.json)
    check_plot(options.plot)
    if options.out is not None:
        if Path(options.out).suffix.lower() not in WRITERS:
            raise SceneError(f"--out {options.out}: the ending must be one of {', '.join(WRITERS)}")
        check_target(options.out, what="--out")
    if options.film is not None:
        check_target(options.film, what="--film")
    mechanism, targets, _ = load_scene(options.scene)
    words: dict[str, Any] = {}
    for text in options.set:
        name, equals, value = (part.strip() for part in text.partition("="))
        if name in SIMULATE and equals:
            words[name] = _word(name, value)
        else:
            targets |= [drive_value(mechanism.scene(), text)]
    own = mechanism.simulation
    words["drives"] = {**targets, **({} if own is None else own.drives)}
    history = simulate(mechanism, **words, progress=not options.quiet)
    if options.out:
        getattr(history, WRITERS[Path(options.out).suffix.lower()])(options.out)
    if options.plot:
        history.plot(path=options.plot)
    if options.film:
        history.animate(options.film)
    if options.json:
        columns = history.table().columns
        write_json(
            json_object(
                {"steps": history.steps, "error": history.error, "stop": history.stop, "notes": history.notes}
            )
            | {"columns": {name: list(values) for name, values in columns.items() if name != "status"}},
            options.json,
        )
    if options.json != STDOUT:
        console().print(str(history), markup=False, soft_wrap=True)
    return 0


def _word(name: str, value: str) -> Any:
    """A word of [simulate] from --set NAME=VALUE. Raises SceneError."""
    if name in ("drives", "loads", "base", "speeds", "stop"):
        raise SceneError(f"--set {name}: write [simulate.{name}] in the file")
    plain = number_or_text(value)
    return int(plain) if isinstance(plain, float) and plain.is_integer() and name == "every" else plain
