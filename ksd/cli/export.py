"""`ksd export SCENE.toml --to KIND`: a scene as a file of another program."""

from __future__ import annotations

import argparse
from pathlib import Path

from ksd.cli.output import console
from ksd.cli.solve import load_with_options, merged_options, solve_warm
from ksd.errors import SceneError
from ksd.export.dxf import write_dxf
from ksd.export.files import WRITERS, export
from ksd.scene.toml_table import quantity

ONLY_FOR = {
    "view": (".dxf",), "margin": (".dxf",), "hole": (".dxf",), "tolerance": (".dxf",),
    "undeformed": (".stl", ".3mf", ".step", ".stp"),
}  # fmt: skip
"""Endings of the files that an option is for."""


def run(options: argparse.Namespace) -> int:
    """Solve, unless it is drawn undeformed, and write. Errors as in `ksd.solve` and `ksd.load_scene`."""
    named = "inp" if options.to == "calculix" else options.to
    kind = f".{named}" if named else Path(options.out or "").suffix.lower()
    if kind not in WRITERS:
        raise SceneError(
            f"--to {options.to or ''}: say one of calculix, {', '.join(k.removeprefix('.') for k in WRITERS)}"
        )
    target = Path(options.out or Path(options.scene).with_suffix(kind))
    if target.suffix.lower() != kind:
        raise SceneError(f"--out {target}: a file of this kind ends in {kind}")
    for option, kinds in ONLY_FOR.items():
        if getattr(options, option) and kind not in kinds:
            raise SceneError(f"--{option} is not for {kind} files, but for {', '.join(kinds)}")
    scene, targets, written = load_with_options(options.scene, options.set)
    if kind == ".dxf":
        words = {
            k: quantity(v, "length", f"--{k}")
            for k in ("margin", "hole", "tolerance")
            if (v := getattr(options, k)) is not None
        }
        write_dxf(scene, target, view=options.view, **words)
    else:
        pose = solve_warm(scene, targets, merged_options(written, options))
        export(pose, target, deformed=False if options.undeformed else None)
    console().print(f"{target}: written", soft_wrap=True)
    return 0
