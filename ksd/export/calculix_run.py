"""A pose solved again by CalculiX, with solids: forces and displacements beside ours.

`ccx` (Debian: calculix-ccx) must be on the path; nothing else is run.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ksd.checks import clear_argument_errors, whole_number
from ksd.errors import ConvergenceError, SceneError
from ksd.export.calculix import Deck, Mesh, deck_of

Array = NDArray[np.float64]
LONGEST_RUN = 1800.0
"""Seconds after which a run of CalculiX is given up."""


@dataclass(frozen=True)
class Confirmation:
    """A pose by this package and by solids: forces {drive: (ours, solids)} [N or Nm]; displacements {link: (ours, solids)},
    (3,) each [m], and rotations, rotation vectors (3,) each [rad], of links. stroke: the largest displacement [m]; elements:
    number of bricks."""

    forces: Mapping[str, tuple[float, float]]
    displacements: Mapping[str, tuple[Array, Array]]
    rotations: Mapping[str, tuple[Array, Array]]
    stroke: float
    elements: int

    def relative_force(self, drive: str) -> float:
        """Force of the solids over ours, less 1; 0 where ours is 0."""
        ours, solids = self.forces[drive]
        return solids / ours - 1.0 if ours else 0.0

    def distance(self, link: str) -> float:
        """Distance [m] of the positions of a link."""
        ours, solids = self.displacements[link]
        return float(np.linalg.norm(solids - ours))


@clear_argument_errors
def confirm(configuration: Any, *, refine: int = 1, mesh: Mesh | None = None) -> Confirmation:
    """Solve a pose again by CalculiX; mesh: by default by the number of leaf springs; each of its elements is divided into
    `refine` parts along and across.

    Raises SceneError where ccx is not installed or the deck cannot say the scene, ConvergenceError where ccx fails.
    """
    deck = deck_of(configuration, mesh, parts=whole_number(refine, "refine", owner="confirm"))
    moved, held = run(deck)
    model, scene = configuration.unreduced_state[0], configuration.model.scene
    ours = configuration.forces
    forces = {n: (float(ours[n]), o.unit * float(held[o.node] @ o.direction)) for n, o in deck.forces.items()}
    places, turns = {}, {}
    for link in scene.links[1:]:
        ref = deck.references.get(model.scene.links.index(link))
        if ref is not None:
            places[link] = configuration.displacement(link), 1e-3 * moved[ref]
            turns[link] = configuration.rotation(link), moved[ref + 1]
    stroke = max((float(np.linalg.norm(own)) for own, _ in places.values()), default=0.0)
    return Confirmation(forces, places, turns, stroke, sum(map(len, deck.sheets.values())))


def twist_text(configuration: Any) -> str:
    """What twist adds to the torsional stiffness of solids, of the straight sheet in which it adds most; empty below 1e-3.

    Twist stretches the edges: T = G J phi' + E t w^5 phi'^3 / 360 for a thin sheet that is free to shorten (Cullimore, The
    shortening effect, 1949).
    """
    largest, which = 0.0, ""
    leaves = configuration.model.scene.leaf_names()
    for shape in configuration.shape(points=2).leaves:
        leaf = leaves.get(shape.name)
        if leaf is None or leaf.curve is not None or shape.is_round:
            continue
        turn = Rotation.from_matrix(shape.axes[0].T @ shape.axes[-1]).as_rotvec()[0]
        slope = turn / leaf.length * leaf.section.width**2 / leaf.section.thickness
        more = leaf.material.E / leaf.material.G * slope**2 / 120.0
        if more > largest:
            largest, which = more, f"leaf '{shape.name}', twisted by {np.degrees(turn):.2g} degrees"
    if largest < 1e-3:
        return ""
    more_percent = f"{100 * largest:.2g} %"
    return f"twist stretches the edges of sheets: by up to {more_percent} stiffer in torsion ({which})"


def run(deck: Deck) -> tuple[dict[int, Array], dict[int, Array]]:
    """Displacements [mm or rad] and forces [N or Nmm] (3,) of the printed nodes, after the last step. Raises SceneError
    where ccx is not installed, ConvergenceError where it fails."""
    program = shutil.which("ccx")
    if program is None:
        raise SceneError(
            "CalculiX (ccx) is not installed: apt-get install calculix-ccx, or put ccx on the path."
        )
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "deck.inp").write_text(deck.text, encoding="utf-8")
        threads = {**os.environ, "OMP_NUM_THREADS": "1", "CCX_NPROC_EQUATION_SOLVER": "1"}
        try:
            done = subprocess.run(
                [program, "deck"], cwd=folder, capture_output=True, text=True, errors="replace", timeout=LONGEST_RUN,
                check=False, env=threads,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise ConvergenceError(f"CalculiX: not done after {LONGEST_RUN:.0f} s; drive less far.") from None
        results = Path(folder, "deck.dat")
        text = results.read_text() if results.exists() else ""
    # it stops without a word of failure in its exit code, between increments
    if "Job finished" not in done.stdout or "forces (fx,fy,fz)" not in text:
        if done.returncode < 0:
            raise ConvergenceError(
                f"CalculiX was ended from outside (signal {-done.returncode}); run it again."
            )
        reason = next((line.strip() for line in done.stdout.splitlines() if "*ERROR" in line), "")
        raise ConvergenceError(f"CalculiX gave no answer{f' ({reason})' if reason else ''}; drive less far.")
    return _last_block(text, "displacements (vx,vy,vz)"), _last_block(text, "forces (fx,fy,fz)")


def _last_block(text: str, title: str) -> dict[int, Array]:
    """The numbers (3,) by node of the last block of this title in a .dat file."""
    found: dict[int, Array] = {}
    for line in text.rsplit(title, 1)[1].splitlines()[1:]:
        numbers = line.split()
        if numbers and not numbers[0].isdigit():
            break
        if numbers:
            found[int(numbers[0])] = np.array([float(x) for x in numbers[1:4]])
    return found
