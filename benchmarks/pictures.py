"""Draws all stored pictures again from the stored numbers, in seconds; nothing is measured.

    python benchmarks/pictures.py [--out FOLDER]

A picture tells which numbers it shows (`common.save_picture`): the script that measures them draws it too, and a test holds
every stored picture against the numbers beside it. Pictures go to docs/ and benchmarks/results/, or into FOLDER if given.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import bench
import choose
import convergence
import families
import hero
import optimise
import optimisers
import paper1
import paper2
import paper3
import pays
import speed_report
from common import RESULTS, parse_options

DrawPicture = Callable[[dict[str, Any], Path], Any]
PICTURES: dict[str, DrawPicture] = {
    "speed.png": speed_report.picture,
    "bench.png": bench.picture,
    "families.png": lambda found, path: families.picture(found["families"], path),
    "choose.png": choose.picture,
    "convergence.png": convergence.picture,
    "optimise.png": optimise.picture,
    "optimisers.png": optimisers.picture,
    "paper3.png": paper3.picture,
    "pays.png": pays.picture,
    **dict.fromkeys(paper1.PICTURES, paper1.picture),
    **dict.fromkeys(paper2.PICTURES, paper2.picture),
}
"""Function that draws each picture of benchmarks/results from its numbers."""
NUMBERS = dict.fromkeys(paper1.PICTURES, "paper1.json") | dict.fromkeys(paper2.PICTURES, "paper2.json")


def main(argv: Sequence[str] | None = None) -> list[Path]:
    """Draw; returns the files."""
    chosen = parse_options(__doc__, argv)
    here = chosen.out == RESULTS
    top = (hero.DOCS if here else chosen.out) / "hero.png"
    hero.draw(top, RESULTS / "speed.json")
    drawn = [top]
    for name, draw in PICTURES.items():
        numbers = RESULTS / NUMBERS.get(name, Path(name).with_suffix(".json"))
        draw(json.loads(numbers.read_text()), chosen.out / name)
        drawn.append(chosen.out / name)
    for path in drawn:
        print(path.name)
    return drawn


if __name__ == "__main__":
    main()
