"""`ksd new NAME`: a commented scene file to start from, and the schema by which editors complete it."""

from __future__ import annotations

import argparse
from pathlib import Path

from ksd.checks import name_hint, word
from ksd.cli.output import console
from ksd.cli.schema import schema_text
from ksd.errors import SceneError
from ksd.files import write_file
from ksd.scene.toml_file import shipped_scenes
from ksd.scene.toml_writer import toml_string

SCHEMA, JOB_SCHEMA = "ksd.schema.json", "ksd.job.schema.json"
"""Names of the schema beside a scene and beside a job."""


def run(options: argparse.Namespace) -> int:
    """Write the file. Raises SceneError where there is one already, or for a scene to start from that does not exist."""
    shipped = shipped_scenes()
    if options.like not in shipped:
        raise SceneError(f"--like {options.like}: there is no such scene{name_hint(options.like, shipped)}")
    file = Path(options.name)
    file = file if file.suffix == ".toml" else file.with_name(f"{file.name}.toml")
    is_job = options.like.endswith("_job")
    name, schema = word(file.stem, "NAME", owner="ksd new"), file.with_name(JOB_SCHEMA if is_job else SCHEMA)
    if file.exists():
        raise SceneError(f"{file} is there already and is not overwritten; give another name, or remove it")
    text = shipped[options.like].read_text(encoding="utf-8")
    write_file(file, adapted_scene(text, options.like, name), what="scene file")
    screen = console()
    if not schema.exists():
        write_file(schema, schema_text(jobs=is_job), what="schema")
        screen.print(f"{schema}: for editors that complete and check TOML", soft_wrap=True)
    kind, command = ("job", "optimise") if is_job else ("scene", "solve")
    screen.print(f"{file}: a {kind} like {options.like}; now `ksd {command} {file}`", soft_wrap=True)
    return 0


def adapted_scene(text: str, like: str, name: str) -> str:
    """The text of the shipped scene `like` renamed, also in its comments, with the schema line for editors."""
    # a job is named like its scene
    text = text.replace(f'\nname = "{like.removesuffix("_job")}"\n', f"\nname = {toml_string(name)}\n", 1)
    schema = JOB_SCHEMA if like.endswith("_job") else SCHEMA
    lines = [s.replace(f"{like}.", f"{name}.") if s.startswith("#") else s for s in text.splitlines()]
    return "\n".join([f"#:schema ./{schema}", *lines]) + "\n"
