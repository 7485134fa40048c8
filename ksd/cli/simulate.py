"""`ksd simulate SCENE.toml`: the motion of a scene in time, as a table, files, a plot and a film."""

from __future__ import annotations

import argparse
from typing import Any

from ksd.cli.output import check_json, check_plot, check_table, show, write_table
from ksd.cli.solve import drive_value, number_or_text
from ksd.errors import SceneError
from ksd.files import check_target
from ksd.library.result_files import json_object
from ksd.scene.toml_file import load_scene
from ksd.scene.toml_schema import SIMULATE
from ksd.study.history import History
from ksd.study.simulate import simulate


def run(options: argparse.Namespace) -> int:
    """Simulate, print, write. Errors as in `ksd.load_scene` and `ksd.simulate`."""
    check_json(options.json)
    check_plot(options.plot)
    check_table(options.out)
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
    write_table(history, options.out)
    if options.plot:
        history.plot(path=options.plot)
    if options.film:
        history.animate(options.film)
    show(options.json, lambda: _numbers(history), str(history))
    return 0


def _numbers(history: History) -> dict[str, Any]:
    """A history for JSON."""
    facts = {"steps": history.steps, "error": history.error, "stop": history.stop, "notes": history.notes}
    columns = history.table().columns
    return json_object(facts) | {"columns": {n: list(v) for n, v in columns.items() if n != "status"}}


def _word(name: str, value: str) -> Any:
    """A word of [simulate] from --set NAME=VALUE. Raises SceneError."""
    if name in ("drives", "loads", "base", "speeds", "stop"):
        raise SceneError(f"--set {name}: write [simulate.{name}] in the file")
    plain = number_or_text(value)
    return int(plain) if isinstance(plain, float) and plain.is_integer() and name == "every" else plain
