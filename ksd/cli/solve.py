"""`ksd solve SCENE.toml`: one configuration of a scene, as tables, JSON and a picture."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ksd.checks import name_hint
from ksd.cli.output import STDOUT, check_json, check_plot, console, write_json
from ksd.errors import SceneError, SceneWarning
from ksd.model.mesh import Mesh
from ksd.scene import Scene
from ksd.scene.plausibility import likely_unit
from ksd.scene.toml_file import load_scene
from ksd.scene.toml_table import quantity
from ksd.solve.solver import solve
from ksd.units import DIMENSIONS

OPTIONS = {
    "method": str, "accuracy": float, "elements": int, "relinearisations": int, "extrapolate": bool,
    "effects": str, "with": str, "without": str,
}  # fmt: skip
"""Keys of [options] in a scene file, with their types; the command line wins over them."""
MAX_REPEATED_SOLVE = 20.0
"""A first solve shorter than this [s] is repeated, so that its times exclude the loading of kernels."""


def run(options: argparse.Namespace) -> int:
    """Load, solve, print, write. Errors as in `ksd.solve` and `ksd.load_scene`."""
    check_json(options.json)
    check_plot(options.plot, kinds=(".vtu",))
    scene, targets, written = load_with_options(options.scene, options.set)
    asked = merged_options(written, options)
    result = solve_warm(scene, targets, asked)
    if options.json:
        write_json(result.as_dict(), options.json)
    if options.json != STDOUT:
        screen = console()
        for part in result.tables():
            screen.print(part)
    if options.plot:
        result.view(options.plot) if Path(options.plot).suffix.lower() == ".vtu" else result.plot(
            options.plot
        )
    return 0


def load_with_options(path: str, said: Sequence[str] = ()) -> tuple[Scene, dict[str, float], dict[str, Any]]:
    """The scene of a file, its drive values (SI) with those said on the command line over them, and its [options].

    Raises SceneError for what does not fit, an option of another type too.
    """
    mechanism, targets, written = load_scene(path, option_names=tuple(OPTIONS))
    for key, value in written.items():
        kind = OPTIONS[key]
        # a whole number is a fine accuracy, but true is not a number
        fits = isinstance(value, (int, float) if kind is float else kind)
        if not fits or (isinstance(value, bool) and kind is not bool):
            raise SceneError(f"[options] {key} = {value!r}: {_TYPE_NAMES[kind]} is needed")
    scene = mechanism.scene()
    return scene, targets | dict(drive_value(scene, text) for text in said), written


def merged_options(written: dict[str, Any], options: argparse.Namespace) -> dict[str, Any]:
    """What is asked of the solver, the command line over the file. SceneError for what does not fit together."""
    given = {key: getattr(options, key) for key in OPTIONS}
    asked = {key: written.get(key) if value is None else value for key, value in given.items()}
    if options.accuracy is not None and options.method is None:
        asked["method"] = None
    if asked["method"] is not None and asked["accuracy"] is not None:
        if options.accuracy is not None:
            raise SceneError(
                "--method and --accuracy exclude each other: name a method, or let the accuracy choose one"
            )
        asked["accuracy"] = None
    if asked["relinearisations"] is not None and asked["method"] not in ("reduced", "full"):
        raise SceneError(
            f"relinearisations = {asked['relinearisations']}: only method reduced or full has relinearisation "
            "steps; add --method reduced"
        )
    return asked


_TYPE_NAMES = {str: "text", float: "a number", int: "a whole number", bool: "true or false"}


def effect_options(asked: dict[str, Any]) -> dict[str, Any]:
    """The options of `ksd.prepare` about effects; on the command line their names are separated by commas."""

    def names(text: str | None) -> tuple[str, ...]:
        return tuple(n.strip() for n in (text or "").split(",") if n.strip())

    said = asked.get("effects") or "auto"
    return {
        "effects": said if said in ("auto", "all") else names(said),
        "with_": names(asked.get("with")),
        "without": names(asked.get("without")),
        "accuracy": asked.get("accuracy"),
    }


def drive_value(scene: Any, text: str) -> tuple[str, float]:
    """Name and value (SI) from "top=300mm"; plain numbers are SI. SceneError for unknown drives and units."""
    name, equals, value = (part.strip() for part in text.rpartition("="))
    drives = {d.name: d for d in scene.drives}
    if not equals or not name:
        raise SceneError(f"--set {text}: write it as DRIVE=VALUE, for example --set top=300mm")
    if name not in drives:
        raise SceneError(f"--set {text}: there is no drive '{name}'{name_hint(name, drives)}")
    try:
        plain: float | str = float(value)
    except ValueError:
        plain = value
    dimension = drives[name].dimension
    found = quantity(plain, dimension, f"--set {name}")
    unit = likely_unit(found, dimension, name) if isinstance(plain, float) else ""
    if unit:
        si = next(iter(DIMENSIONS[dimension]))
        warnings.warn(
            f"--set {text} is {found:g} {si}: did you mean --set {name}={value}{unit}? Plain numbers are in SI.",
            SceneWarning,
            stacklevel=2,
        )
    return name, found


def solve_warm(scene: Any, targets: dict[str, float], asked: dict[str, Any]) -> Any:
    """The configuration by `ksd.solve`, repeated if quick, so that its times exclude the loading of kernels."""
    how = {
        "method": asked["method"],
        "relinearisations": asked["relinearisations"] or 0,
        "mesh": chosen_mesh(asked),
    }
    how |= {"extrapolate": bool(asked["extrapolate"]), **effect_options(asked)}
    result = solve(scene, targets, **how)
    return solve(scene, targets, **how) if result.time < MAX_REPEATED_SOLVE else result


def chosen_mesh(asked: dict[str, Any]) -> Any:
    """The mesh of `elements` per leaf; None for strain-mode leaves."""
    count = asked["elements"]
    return None if count is None else Mesh(leaf="corotational", elements=count)
