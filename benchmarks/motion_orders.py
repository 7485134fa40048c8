"""Orders in the step of places and drive forces after a load that jumps at t = 0, for leaf springs with mass.

A guide on a carriage that a drive holds, and the fourbar of cross flexures held by its drive; the load jumps, or rises by a
ramp. Differences of runs with h and h/2 at the same instants, over the largest change, and the orders by the next.
python benchmarks/motion_orders.py
"""

import sys
import warnings
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import ksd

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

INSTANTS = 12


def fourbar():
    """The fourbar with links that have mass, with a force on one of them."""
    from motion_scenes import HEIGHT, four_hinges

    scene = four_hinges()
    scene.load("left", force=(20, 0, 0), at=(-0.2, HEIGHT / 2, 0), name="hit")
    return scene


def orders(runs):
    """Differences (k - 1,) of runs (k, ..) with half the step, and their orders (k - 2,)."""
    size = np.ptp(runs[-1], axis=0).max()
    off = [float(np.linalg.norm(a - b)) / np.sqrt(len(a)) / size for a, b in pairwise(runs)]
    return off, [float(np.log2(a / b)) for a, b in pairwise(off)]


def main():
    """A table for every motion."""
    from motion_scenes import carried_guide

    push = {"push": 0.0}
    cases: tuple[Any, ...] = (
        ("Guide, jump", carried_guide(), "payload", ksd.Step(), {}, 6e-3, range(4, 11)),
        ("Guide, ramp", carried_guide(), "payload", ksd.Ramp(5e-3), {}, 6e-3, range(1, 8)),
        ("Fourbar, jump", fourbar(), "left", ksd.Step(), push, 6e-5, range(1, 6)),
        ("Fourbar, ramp", fourbar(), "left", ksd.Ramp(2e-3), push, 3e-3, range(1, 8)),
    )
    warnings.simplefilter("ignore", ksd.SceneWarning)
    for title, scene, link, load, others, until, powers in cases:
        steps = [INSTANTS * 2**k for k in powers]
        drive = scene.scene().drives[0].name
        print(f"\n{title}, {1e3 * until:g} ms: orders from the steps [us]\n")
        print("| | rho |", " | ".join(f"{1e6 * until / n:.3g}" for n in steps[1:-1]), "| last difference |")
        print("|---|---|" + "---:|" * (len(steps) - 1))
        for rho in (1.0, 0.8, 0.5):
            found: tuple[list[Any], list[Any]] = [], []
            for n in steps:
                words = {"dt": until / n, "rho": rho, "loads": {"hit": load, **others}}
                history, every = ksd.simulate(scene, until, progress=False, **words), n // INSTANTS
                found[0].append(history[link].position[every::every])
                found[1].append(history.drives[drive].force[every::every, None])
            for name, runs in zip(("places", "drive force"), found, strict=True):
                off, order = orders(runs)
                print(f"| {name} | {rho:g} |", " | ".join(f"{o:.2f}" for o in order), f"| {off[-1]:.0e} |")


if __name__ == "__main__":
    main()
