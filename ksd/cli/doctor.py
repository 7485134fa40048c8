"""`ksd doctor SCENE.toml`: what is under-constrained and what is redundant, before anything is solved."""

from __future__ import annotations

import argparse

from ksd.answers.doctor import doctor
from ksd.cli.output import STDOUT, check_json, console, write_json
from ksd.scene.toml_file import load_scene


def run(options: argparse.Namespace) -> int:
    """Print the diagnosis. Raises SceneError for a scene that cannot be read."""
    check_json(options.json)
    mechanism = load_scene(options.scene)[0]
    diagnosis = doctor(mechanism)
    if options.json:
        write_json(diagnosis.as_dict(), options.json)
    if options.json != STDOUT:
        console().print(str(diagnosis), markup=False, soft_wrap=True)
    return 0
