"""`ksd new NAME`: a commented scene file to start from, made from a shipped one or from a file of another program, and the
schema by which editors complete it."""

from __future__ import annotations

import argparse
from pathlib import Path

from ksd.checks import name_hint, word
from ksd.cli.output import console
from ksd.cli.schema import schema_text
from ksd.errors import SceneError
from ksd.files import write_file
from ksd.importing import read_dxf, read_spacar
from ksd.scene.toml_file import shipped_scenes
from ksd.scene.toml_writer import toml_string

SCHEMA, JOB_SCHEMA = "ksd.schema.json", "ksd.job.schema.json"
"""Names of the schema beside a scene and beside a job."""
DRAWING_WORDS = ("layers", "unit", "join", "thickness", "width")
"""Options for what a drawing does not say."""


def run(options: argparse.Namespace) -> int:
    """Write the file. Raises SceneError where there is one already, or for what it cannot be made from."""
    source = options.from_
    if options.name is None and source is None:
        raise SceneError("ksd new: give the NAME of the mechanism, or --from FILE")
    like = options.like or "pivot"
    shipped = shipped_scenes()
    if source is None and like not in shipped:
        raise SceneError(f"--like {like}: there is no such scene{name_hint(like, shipped)}")
    if source is not None and options.like is not None:
        raise SceneError("--like and --from exclude each other: a scene starts from one of them")
    file = Path(options.name or Path(source).with_suffix(".toml").name)
    file = file if file.suffix == ".toml" else file.with_name(f"{file.name}.toml")
    is_job = source is None and like.endswith("_job")
    name, schema = word(file.stem, "NAME", owner="ksd new"), file.with_name(JOB_SCHEMA if is_job else SCHEMA)
    if file.exists():
        raise SceneError(f"{file} is there already and is not overwritten; give another name, or remove it")
    if source is None:
        text = adapted_scene(shipped[like].read_text(encoding="utf-8"), like, name)
        made = f"like {like}"
    else:
        text = f"#:schema ./{SCHEMA}\n{_read(source, name, options)}"
        made = f"from {source}"
    write_file(file, text, what="scene file")
    screen = console()
    if not schema.exists():
        write_file(schema, schema_text(jobs=is_job), what="schema")
        screen.print(f"{schema}: for editors that complete and check TOML", soft_wrap=True)
    kind, command = ("job", "optimise") if is_job else ("scene", "doctor" if source else "solve")
    screen.print(f"{file}: a {kind} {made}; now `ksd {command} {file}`", soft_wrap=True)
    return 0


def _read(source: str, name: str, options: argparse.Namespace) -> str:
    """The text of a scene from a drawing or a SPACAR file. Raises SceneError."""
    kind = Path(source).suffix.lower()
    if kind not in (".dxf", ".mat"):
        raise SceneError(f"--from {source}: a drawing (.dxf) or input of SPACAR Light (.mat) can be read")
    words = {key: value for key in DRAWING_WORDS if (value := getattr(options, key)) is not None}
    if kind == ".mat":
        if words:
            raise SceneError(f"--{next(iter(words))} is for drawings, and {source} is none")
        return read_spacar(source, name=name)
    if "layers" in words:
        pairs = [part.partition("=") for part in words["layers"].split(",")]
        words["layers"] = {key.strip(): layer.strip() for key, _, layer in pairs}
    return read_dxf(source, name=name, **words)


def adapted_scene(text: str, like: str, name: str) -> str:
    """The text of the shipped scene `like` renamed, also in its comments, with the schema line for editors."""
    # a job is named like its scene
    text = text.replace(f'\nname = "{like.removesuffix("_job")}"\n', f"\nname = {toml_string(name)}\n", 1)
    schema = JOB_SCHEMA if like.endswith("_job") else SCHEMA
    lines = [s.replace(f"{like}.", f"{name}.") if s.startswith("#") else s for s in text.splitlines()]
    return "\n".join([f"#:schema ./{schema}", *lines]) + "\n"
