"""Figures 7, 8, 10, 11 and 12 of paper 1 (Dwarshuis et al., 2020), computed by ksd.

    python benchmarks/paper1.py [--quick] [--out FOLDER]

Solves the cross flexure and the fourbar, the latter in both readings of the paper's Fig. 9, with 1 to 6
elements per leaf, d from 0 to 0.3 m; writes the pictures and paper1.json with every number.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from common import machine, numbers_file, parse_options, save_picture, write_json
from paper1_cross_flexure import draw_7, draw_8, figure_7, figure_8
from paper1_fourbar import draw_10, draw_11, draw_12, figure_10, figure_11, figure_12


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Compute and draw all figures; returns every number."""
    chosen = parse_options(__doc__, argv)
    out, quick = chosen.out, chosen.quick
    figures = {
        "figure_7": lambda: figure_7(meshes=(2, 6) if quick else (2, 4, 6)),
        "figure_8": lambda: figure_8(forces=(0.0, 4.0)) if quick else figure_8(),
        "figure_10": lambda: figure_10(meshes=(1, 2, 3), steps=3) if quick else figure_10(),
        "figure_11": lambda: figure_11(meshes=(2,), repeats=2) if quick else figure_11(),
        "figure_12": lambda: (
            figure_12(n=2, moments=np.array([-360.0, 0.0, 250.0]), repeats=2) if quick else figure_12()
        ),
    }
    found: dict[str, Any] = {"machine": machine()}
    for name, measured in figures.items():
        print(f"{name.replace('_', ' ')} ...", file=sys.stderr)
        found[name] = measured()
    write_json(found, out / "paper1.json")
    for name in PICTURES:
        picture(json.loads((out / "paper1.json").read_text()), out / name)
    return found


PICTURES = {
    "fig07_cross_flexure_moment.png": ("figure_7", draw_7),
    "fig08_cross_flexure_force_across.png": ("figure_8", draw_8),
    "fig10_fourbar_force.png": ("figure_10", draw_10),
    "fig11_fourbar_effort.png": ("figure_11", draw_11),
    "fig12_fourbar_moment.png": ("figure_12", draw_12),
}
"""Pictures: key of their numbers, and the function that draws them."""


def picture(found: dict[str, Any], path: Path) -> None:
    """One of PICTURES, from the numbers of paper1.json."""
    key, draw = PICTURES[path.name]
    save_picture(draw(found[key]), path, numbers=numbers_file(path, "paper1.json"))


if __name__ == "__main__":
    main()
