"""`ksd doctor SCENE.toml`: what is under-constrained and what is redundant, before anything is solved."""

from __future__ import annotations

import argparse

from ksd.answers.doctor import doctor
from ksd.cli.output import check_json, show
from ksd.scene.toml_file import load_scene


def run(options: argparse.Namespace) -> int:
    """Print the diagnosis. Raises SceneError for a scene that cannot be read."""
    check_json(options.json)
    mechanism = load_scene(options.scene)[0]
    diagnosis = doctor(mechanism)
    show(options.json, diagnosis.as_dict, str(diagnosis))
    return 0
