"""The estimated error of a motion against a run with a quarter of its step, on twenty scenes.

Eight scenes of acceptance, and chains of `random_motions.py` that are dropped or pushed at once; a row for each. Ratios of
estimate and error are asked to be .5 to 2; of motions that no step follows for long the history says so. With a first seed:
twenty other chains.
python benchmarks/motion_error.py [first seed]
"""

import sys
import warnings
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from random_motions import random_chain

import ksd

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

ACCURACY = 2e-3
PERIODS = 2.0
"""Of the lowest frequency, in a random scene."""


def true_error(scene: ksd.Mechanism, history: ksd.History, words: dict[str, Any]) -> float:
    """Largest difference of places of links from a run with a quarter of the step, relative to the largest stroke."""
    until = float(history.t[-1])
    finer = ksd.simulate(scene, until, dt=until / history.steps / 4.0, **words)
    off, stroke = 0.0, 0.0
    for link in scene.scene().links[1:]:
        own, other = history[link].position, finer[link].position
        # a run may have ended before the other
        at = np.searchsorted(finer.t, history.t[history.t <= finer.t[-1]] - 1e-9 * until)
        off = max(off, float(np.linalg.norm(own[: len(at)] - other[at], axis=1).max()))
        stroke = max(stroke, float(np.linalg.norm(own - own[0], axis=1).max()))
    return off / stroke


def acceptance() -> Any:
    """Name, scene, end [s] and words of eight motions."""
    from motion_scenes import CASES

    for name in ("guide", "fourbar", "pivot", "wire", "rod", "pendulum", "strip", "slider-crank"):
        case = CASES[name]
        yield name, case.make(), max(case.values), dict(case.words)


def chains(first: int, count: int) -> Any:
    """The same of random chains, from a seed on."""
    seed = first - 1
    while count:
        seed += 1
        scene = random_chain(np.random.default_rng(seed))
        drives = {d.name: None for d in scene.scene().drives}
        words: dict[str, Any] = {"drives": drives, "loads": {"random": ksd.Step(0.1)}, "start": "undeformed"}
        if any(leaf.material.loss_factor for leaf in scene.scene().leaf_names().values()):
            words["damping_at"] = 10.0
        try:
            found = ksd.solve(scene, dict.fromkeys(drives, 0.0), strict=False).frequencies(
                count=1, freed=tuple(drives)
            )
        except ksd.KsdError:
            continue
        lowest = float(found.frequency_Hz[0])
        if lowest <= 0.5:
            continue
        count -= 1
        yield f"random chain {seed}", scene, PERIODS / lowest, words


def main() -> None:
    """A table."""
    print("| scene | steps | estimate | error | ratio | says |\n|---|---:|---:|---:|---:|---|")
    ratios = []
    first = [int(a) for a in sys.argv[1:2]]
    motions = chains(first[0], 20) if first else chain(acceptance(), chains(1, 12))
    for name, scene, until, words in motions:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ksd.SceneWarning)
            history = ksd.simulate(scene, until, accuracy=ACCURACY, **words)
            error = true_error(scene, history, words)
        ratio = history.error / error
        said = "chaotic" if any("chaotic" in note for note in history.notes) else history.stop or ""
        ratios.append(ratio if not said else 1.0)
        print(
            f"| {name} | {history.steps} | {history.error:.1e} | {error:.1e} | {ratio:.2f} | {said} |",
            flush=True,
        )
    good = sum(0.5 < r < 2.0 for r in ratios)
    print(f"\n{good} of {len(ratios)} within .5 and 2, or said to be chaotic")


if __name__ == "__main__":
    main()
