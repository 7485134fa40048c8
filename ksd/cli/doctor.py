"""`ksd doctor SCENE.toml`: what is free and what is held twice, before anything is solved."""

from __future__ import annotations

import argparse
from typing import Any

from ksd.cli.output import STDOUT, check_json, console, write_json


def add(commands: Any) -> argparse.ArgumentParser:
    """The parser of this command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "doctor",
        help="count freedoms and constraints of a scene",
        description="Say what is left free, what is held twice, and which release would make the mechanism exact.",
    )
    parser.add_argument("scene", metavar="SCENE.toml")
    parser.add_argument(
        "--json", metavar="FILE", help="write counts and sentences; - is stdout, without text"
    )
    return parser


def run(options: argparse.Namespace) -> int:
    """Print the diagnosis. Raises SceneError for a scene that cannot be read."""
    check_json(options.json)
    from ksd.properties.doctor import doctor
    from ksd.scene.toml_file import load_scene

    mechanism = load_scene(options.scene)[0]
    found = doctor(mechanism)
    if options.json:
        write_json(found.as_dict(), options.json)
    if options.json != STDOUT:
        console().print(str(found), markup=False, soft_wrap=True)
    return 0
