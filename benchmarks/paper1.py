"""Figures 7, 8, 10, 11 and 12 of paper 1 (Dwarshuis et al., 2020), computed by ksd.

    python benchmarks/paper1.py [--quick] [--out FOLDER]

Solves the cross flexure and the fourbar, the latter in both readings of the paper's Fig. 9, with 1 to 6
elements per leaf, d from 0 to 0.3 m; writes the pictures and paper1.json with every number.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
from common import machine, options, write_json
from paper1_cross_flexure import figure_7, figure_8
from paper1_fourbar import figure_10, figure_11, figure_12


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Compute and draw all figures; returns every number."""
    chosen = options(__doc__, argv)
    out, quick = chosen.out, chosen.quick
    figures = {
        "figure_7": lambda: figure_7(out, meshes=(2, 6) if quick else (2, 4, 6)),
        "figure_8": lambda: figure_8(out, forces=(0.0, 4.0)) if quick else figure_8(out),
        "figure_10": lambda: figure_10(out, meshes=(1, 2, 3), steps=3) if quick else figure_10(out),
        "figure_11": lambda: figure_11(out, meshes=(2,), repeats=2) if quick else figure_11(out),
        "figure_12": lambda: (
            figure_12(out, moments=np.array([-360.0, 0.0, 250.0]), repeats=2) if quick else figure_12(out)
        ),
    }
    found: dict[str, Any] = {"machine": machine()}
    for name, draw in figures.items():
        print(f"{name.replace('_', ' ')} ...", file=sys.stderr)
        found[name] = draw()
    write_json(found, out / "paper1.json")
    return found


if __name__ == "__main__":
    main()
