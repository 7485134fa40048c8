"""Cost of frequency responses: `pose.response` at 1,000 frequencies, in modal solves of the same pose.

    python benchmarks/response.py [--quick] [--out FOLDER]

Shipped scenes at the drive values of their files, a mass on every link, from every drive and a base shaken along x to every
drive. Thread CPU time in one process, modal solve (`pose.frequencies` of as many modes) and response in turns, medians.
Writes response.md and .json.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from common import machine, machine_line, parse_options, time_in_turns, write_json

import ksd
from ksd.answers.plant import DEFAULT_MODES
from ksd.scene.toml_file import shipped_scenes

SCENES = ("guide", "fourbar", "delta_stage")
FREQUENCIES = np.geomspace(0.5, 500.0, 1000)


def cost(name: str, *, repeats: int) -> dict[str, Any]:
    """Time [us] of a modal solve and of a response at FREQUENCIES from the same number of modes, and their ratio."""
    mechanism, targets, _ = ksd.load_scene(str(shipped_scenes()[name]))
    scene = mechanism.scene()
    for link in scene.links[1:]:
        at = next(j.origin for j in scene.joints if link in (j.a, j.b)) if scene.joints else (0.0, 0.0, 0.0)
        mechanism.mass(link, mass=0.2, inertia=(2e-4, 3e-4, 4e-4), at=at)
    pose = ksd.solve(mechanism, targets)
    drives = pose.model.drive_names
    # one more than are kept, as a response needs it for its error
    modal = partial(pose.frequencies, count=DEFAULT_MODES + 1, freed=drives)
    words: dict[str, Any] = {"inputs": [*drives, "base x"], "outputs": drives, "modes": DEFAULT_MODES}
    respond = partial(pose.response, FREQUENCIES, **words)
    times = time_in_turns({"modal": modal, "response": respond}, repeats=repeats)
    modal_us, response_us = (times[key].median for key in ("modal", "response"))
    return {
        "curves": respond().value[0].size, "unknowns": modal().mass.size, "modal_us": modal_us,
        "response_us": response_us, "response_over_modal": response_us / modal_us,
    }  # fmt: skip


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Print and store times and ratios of all scenes."""
    chosen = parse_options(__doc__, argv)
    repeats = 3 if chosen.quick else 30
    found: dict[str, Any] = {
        "machine": machine(),
        "scenes": {n: cost(n, repeats=repeats) for n in SCENES[: 2 if chosen.quick else None]},
    }
    rows = [
        f"| {n} | {c['unknowns']} | {c['curves']} | {1e-3 * c['modal_us']:.1f} | {1e-3 * c['response_us']:.1f} | "
        f"{c['response_over_modal']:.2f} |"
        for n, c in found["scenes"].items()
    ]
    head = (
        "| scene | unknowns | curves | modal solve [ms] | response [ms] | response over modal solve |\n"
        "| --- | ---: | ---: | ---: | ---: | ---: |"
    )
    said = (
        f"1,000 frequencies, {DEFAULT_MODES} modes; less than 2 modal solves are aimed at. Measured on "
        f"{machine_line(found['machine'])}.\n"
    )
    text = "\n".join([said, head, *rows, ""])
    (chosen.out / "response.md").write_text(text)
    write_json(found, chosen.out / "response.json")
    print(text)
    return found


if __name__ == "__main__":
    main()
