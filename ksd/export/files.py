"""Which writer a file gets, by its ending."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ksd.checks import clear_argument_errors
from ksd.errors import SceneError
from ksd.export.calculix import write_deck
from ksd.export.dxf import write_dxf
from ksd.export.solids import SUFFIXES, write_bodies
from ksd.view.vtk import write_vtu

WRITERS: dict[str, Callable[..., Path]] = {
    ".dxf": write_dxf,
    ".vtu": write_vtu,
    ".inp": write_deck,
} | dict.fromkeys(SUFFIXES, write_bodies)
"""The function that writes a configuration, by the ending of the file."""


@clear_argument_errors
def export(
    configuration: Any,
    path: str | os.PathLike[str],
    *,
    deformed: bool | None = None,
    points: int | None = None,
    view: str | None = None,
    margin: float | None = None,
    hole: float | None = None,
    tolerance: float | None = None,
) -> Path:
    """Write a configuration to a file of another program, by the ending of `path`, which it returns.

    .dxf: view, margin [m], hole [m], tolerance [m] as in `write_dxf`; .stl, .3mf, .step: deformed, points as in
    `write_bodies`; .vtu and .inp (CalculiX): none.
    None leaves the default. Raises SceneError, also for a word that the file has not.
    """
    kind = Path(path).suffix.lower()
    if kind not in WRITERS:
        raise SceneError(f"'{path}': files end in {', '.join(WRITERS)}; give one of these.")
    words = {
        "deformed": deformed, "points": points, "view": view, "margin": margin, "hole": hole, "tolerance": tolerance,
    }  # fmt: skip
    given = {key: value for key, value in words.items() if value is not None}
    unknown = [key for key in given if key not in inspect.signature(WRITERS[kind]).parameters]
    if unknown:
        raise SceneError(f"export: {unknown[0]} says nothing of a file {kind}; leave it out.")
    return WRITERS[kind](configuration, path, **given)
