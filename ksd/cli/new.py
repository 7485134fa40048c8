"""`ksd new NAME`: a commented scene file to start from, and the schema by which editors complete it."""

from __future__ import annotations

import argparse
from importlib.resources import files
from pathlib import Path

from ksd.cli.output import console
from ksd.cli.schema import schema_text
from ksd.errors import SceneError
from ksd.files import write_file
from ksd.scene.toml_writer import quoted
from ksd.section.checks import nearest, word

SCHEMA = "ksd.schema.json"
"""Name of the schema beside the scene."""


def run(options: argparse.Namespace) -> int:
    """Write the file. Raises SceneError where there is one already, or for a scene to start from that does not exist."""
    # jobs of `ksd optimise` are no scenes
    found = {Path(f.name).stem: f for f in (files("ksd") / "scenes").iterdir() if f.name.endswith(".toml")}
    shipped = {name: file for name, file in found.items() if not name.endswith("_job")}
    if options.like not in shipped:
        raise SceneError(f"--like {options.like}: there is no such scene{nearest(options.like, shipped)}")
    file = Path(options.name)
    file = file if file.suffix == ".toml" else file.with_name(f"{file.name}.toml")
    name, schema = word(file.stem, "NAME", owner="ksd new"), file.with_name(SCHEMA)
    if file.exists():
        raise SceneError(f"{file} is there already and is not overwritten; give another name, or remove it")
    text = shipped[options.like].read_text(encoding="utf-8")
    write_file(file, started(text, options.like, name), what="scene file")
    screen = console()
    if not schema.exists():
        write_file(schema, schema_text(), what="schema")
        screen.print(f"{schema}: for editors that complete and check TOML", soft_wrap=True)
    screen.print(f"{file}: a scene like {options.like}; now `ksd solve {file}`", soft_wrap=True)
    return 0


def started(text: str, like: str, name: str) -> str:
    """The shipped scene `like` under another name, its comments too, with the line by which editors find the schema."""
    text = text.replace(f'\nname = "{like}"\n', f"\nname = {quoted(name)}\n", 1)
    lines = [s.replace(f"{like}.", f"{name}.") if s.startswith("#") else s for s in text.splitlines()]
    return "\n".join([f"#:schema ./{SCHEMA}", *lines]) + "\n"
