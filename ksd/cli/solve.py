"""`ksd solve SCENE.toml`: one configuration of a scene, as tables, JSON and a picture."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from ksd.checks import name_hint, warn_user
from ksd.cli.output import check_json, check_plot, show
from ksd.errors import SceneError, SceneWarning
from ksd.model.mesh import Mesh
from ksd.scene import Scene
from ksd.scene.plausibility import likely_unit
from ksd.scene.toml_file import load_scene
from ksd.scene.toml_table import quantity
from ksd.solvers.solver import solve
from ksd.units import DIMENSIONS

OPTIONS = {
    "method": str, "accuracy": float, "elements": int, "relinearisations": int, "extrapolate": bool,
    "effects": str, "with": str, "without": str, "order": str, "side": float,
}  # fmt: skip
"""Keys of [options] in a scene file, with their types; the command line wins over them."""
MAX_REPEATED_SOLVE = 20.0
"""A first solve shorter than this [s] is repeated, so that its times exclude the loading of kernels."""


def run(options: argparse.Namespace) -> int:
    """Load, solve, print, write. Errors as in `ksd.solve` and `ksd.load_scene`."""
    check_json(options.json)
    check_plot(options.plot, kinds=(".vtu",))
    scene, targets, written = load_with_options(options.scene, options.set)
    settings = merged_options(written, options)
    result = solve_warm(scene, targets, settings)
    show(options.json, result.as_dict, *result.tables(), soft_wrap=False)
    if options.plot:
        result.view(options.plot) if Path(options.plot).suffix.lower() == ".vtu" else result.plot(
            options.plot
        )
    return 0


def load_with_options(
    path: str, values: Sequence[str] = ()
) -> tuple[Scene, dict[str, float], dict[str, Any]]:
    """The scene of a file, its drive values (SI) replaced by those of the command line, and its [options], with the words
    of its [report] under "report".

    values: drive values as text, such as "top=300mm". Raises SceneError for these, for an option of a wrong type, and for a
    scene that is incomplete.
    """
    mechanism, targets, written = load_scene(path, option_names=tuple(OPTIONS))
    for key, value in written.items():
        kind = OPTIONS[key]
        # an accuracy may be a whole number, but True is none
        fits = isinstance(value, (int, float) if kind is float else kind)
        if not fits or (isinstance(value, bool) and kind is not bool):
            raise SceneError(f"[options] {key} = {value!r}: {_TYPE_NAMES[kind]} is needed")
    scene = mechanism.scene()
    written = written | {"report": mechanism.report or {}}
    return scene, targets | dict(drive_value(scene, text) for text in values), written


def point_options(written: dict[str, Any], options: argparse.Namespace) -> dict[str, Any]:
    """The words link, at, along and freed of `ksd.sweep`: those of the command line before those of [report] of the file.

    Raises SceneError for texts that say none.
    """
    given = {
        "link": options.link, "at": _three(options.at, "--at", "0,80mm,0", partial(quantity, dimension="length")),
        "along": options.along, "freed": tuple(options.freed) or None,
    }  # fmt: skip
    if options.along is not None and "," in options.along:
        given["along"] = _three(options.along, "--along", "1,1,0", partial(quantity, dimension="number"))
    given = {key: value for key, value in given.items() if value is not None}
    # a place belongs to the link it is said of
    kept = {k: v for k, v in written["report"].items() if k != "at" or "link" not in given}
    return kept | given


def _three(text: str | None, option: str, example: str, read: Callable[..., float]) -> Any:
    """Three numbers of an option, which commas separate, None without it. Raises SceneError."""
    if text is None:
        return None
    parts = [number_or_text(part.strip()) for part in text.split(",")]
    if len(parts) != 3 or "" in parts:
        raise SceneError(f"{option} {text}: write three numbers, such as {option} {example}")
    return tuple(read(part, what=option) for part in parts)


def merged_options(written: dict[str, Any], options: argparse.Namespace) -> dict[str, Any]:
    """Values of OPTIONS, those of the command line before those of the file. Raises SceneError for a contradiction."""
    given = {key: getattr(options, key, None) for key in OPTIONS}
    settings = {key: written.get(key) if value is None else value for key, value in given.items()}
    if settings["side"] and not hasattr(options, "side"):
        raise SceneError(
            f"side = {settings['side']:g}: only ksd solve takes a side of an unstable state; leave it out"
        )
    if options.accuracy is not None and options.method is None:
        settings["method"] = None
    if settings["method"] is not None and settings["accuracy"] is not None:
        if options.accuracy is not None:
            raise SceneError(
                "--method and --accuracy exclude each other: name a method, or let the accuracy choose one"
            )
        settings["accuracy"] = None
    if settings["relinearisations"] is not None and settings["method"] not in ("reduced", "full"):
        raise SceneError(
            f"relinearisations = {settings['relinearisations']}: only method reduced or full has relinearisation "
            "steps; add --method reduced"
        )
    return settings


_TYPE_NAMES = {str: "text", float: "a number", int: "a whole number", bool: "true or false"}


def effect_options(settings: dict[str, Any]) -> dict[str, Any]:
    """The options of `ksd.prepare` about effects; on the command line their names are separated by commas."""

    def names(text: str | None) -> tuple[str, ...]:
        return tuple(n.strip() for n in (text or "").split(",") if n.strip())

    effects = settings.get("effects") or "auto"
    return {
        "effects": effects if effects in ("auto", "all") else names(effects),
        "with_": names(settings.get("with")),
        "without": names(settings.get("without")),
    }


def drive_value(scene: Any, text: str) -> tuple[str, float]:
    """Name and value (SI) of a drive, limit of a stop or cable from "top=300mm"; plain numbers are SI. Raises SceneError for
    unknown names and units."""
    name, equals, value = (part.strip() for part in text.rpartition("="))
    dimensions = {drive.name: drive.dimension for drive in scene.drives}
    # limits of end stops, and what is wound up of a cable
    dimensions |= {limit: s.dimension for s in scene.stops for limit in s.limits}
    dimensions |= {cable.name: "length" for cable in scene.cables}
    if not equals or not name:
        raise SceneError(f"--set {text}: write it as DRIVE=VALUE, for example --set top=300mm")
    if name not in dimensions:
        raise SceneError(f"--set {text}: there is no drive '{name}'{name_hint(name, dimensions)}")
    plain = number_or_text(value)
    dimension = dimensions[name]
    target = quantity(plain, dimension, f"--set {name}")
    unit = likely_unit(target, dimension, name) if isinstance(plain, float) else ""
    if unit:
        si = next(iter(DIMENSIONS[dimension]))
        warn_user(
            f"--set {text} is {target:g} {si}: did you mean --set {name}={value}{unit}? Plain numbers are in SI.",
            SceneWarning,
        )
    return name, target


def number_or_text(value: str) -> float | str:
    """Text that is a number, as that number."""
    try:
        return float(value)
    except ValueError:
        return value


def solver_options(settings: dict[str, Any]) -> dict[str, Any]:
    """The arguments that `ksd.solve` and `ksd.sweep` share; mesh: of `elements` per leaf, None for strain-mode leaves."""
    count = settings["elements"]
    return {
        "method": settings["method"], "accuracy": settings["accuracy"],
        "mesh": None if count is None else Mesh(leaf="corotational", elements=count),
        "relinearisations": settings["relinearisations"] or 0, "extrapolate": bool(settings["extrapolate"]),
        "order": settings["order"] or "loads", **effect_options(settings),
    }  # fmt: skip


def solve_warm(scene: Any, targets: dict[str, float], settings: dict[str, Any]) -> Any:
    """The configuration by `ksd.solve`, repeated if quick, so that its times exclude the loading of kernels."""
    options = solver_options(settings) | {"side": settings["side"] or 0.0}
    result = solve(scene, targets, **options)
    return solve(scene, targets, **options) if result.time < MAX_REPEATED_SOLVE else result
