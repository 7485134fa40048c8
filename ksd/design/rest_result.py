"""What `ksd.rest_shape` returns: a scene drawn undeformed, what it was made of, and its lines for whoever makes it."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.checks import name_hint, show, whole_number
from ksd.design.rest_leaf import DrawnLeaf, axes_of
from ksd.errors import SceneError
from ksd.files import write_file
from ksd.model.leaves import cut_leaves
from ksd.model.mesh import Mesh
from ksd.properties.printing import PrintableAnswer, format_number, format_table, render_text
from ksd.scene.scene import Scene

Array = NDArray[np.float64]
FINE = Mesh(orders=(3, 2, 12), points=16)
"""Leaf springs of the forward solution by which a rest shape is checked."""
STATIONS = 101
"""Points along a leaf where no other number is asked for."""


def pieces_of(scene: Scene) -> list[tuple[str, str, Any]]:
    """(name, whole leaf, leaf) of every leaf spring, cut at the points on it."""
    wholes = [f.name for f in scene.leaves for _ in range(1 + sum(p.leaf == f.name for p in scene.points))]
    return [(name, whole, leaf) for (name, _, _, leaf), whole in zip(cut_leaves(scene), wholes, strict=True)]


@dataclass(frozen=True, repr=False, kw_only=True)
class RestShape(PrintableAnswer, Scene):
    """A scene, drawn undeformed, that takes a wanted shape under its loads; solve it as any other.

    wanted: the scene as it is wanted; targets: drive values by name [m or rad] that belong to it; forces: of the drives [N
    or Nm]; leaf_forces (4,) by leaf: components in the plane of the force that the part beyond exerts on it at its end [N],
    bending moments at its start and end [Nm]; folds: shares of the loads at which the way from the drawn shape
    turned back; crossings: names of leaf springs that run through each other, or a name twice, at rest. The forward
    solution from here: `checked` says in words how it ended, displacement [m] and rotation [rad] the largest distance of a
    link from where it is wanted, infinite where there is none.
    """

    wanted: Scene = field(compare=False)
    targets: Mapping[str, float] = field(compare=False)
    forces: Mapping[str, float] = field(compare=False)
    leaf_forces: Mapping[str, Array] = field(compare=False)
    folds: tuple[float, ...] = field(default=(), compare=False)
    crossings: tuple[tuple[str, str], ...] = field(default=(), compare=False)
    displacement: float = field(default=np.inf, compare=False)
    rotation: float = field(default=np.inf, compare=False)
    checked: str = field(default="not solved forward", compare=False)

    def _line(self) -> str:
        return f"of '{self.name}', {self.checked}"

    def __str__(self) -> str:
        axes = "xyz" if self.plane is None else [("xyz")[k] for k in axes_of(self.plane).own]
        rows = []
        for placed in self.leaves:
            h, v, first, last = self.leaf_forces[placed.name]
            chord = float(np.linalg.norm(np.subtract(placed.leaf.end, placed.leaf.start)))
            noise = 1e-9 * float(np.abs(self.leaf_forces[placed.name]).max())
            rows.append((
                placed.name, format_number(1e3 * placed.leaf.length, 6), format_number(1e3 * chord, 6),
                *(format_number(float(f), 5, zero=noise) for f in (h, v, first, last)),
            ))  # fmt: skip
        sides = [f"F{a} [N]" for a in axes[:2]]
        columns = ("leaf", "length [mm]", "chord [mm]", *sides, "M start [Nm]", "M end [Nm]")
        drives = [
            f"{n} = {format_number(v, 6)}, {format_number(self.forces[n], 6)} N or Nm"
            for n, v in self.targets.items()
        ]
        said = [f"Rest shape of '{self.name}': {self.checked}."]
        said += [f"Drives: {'; '.join(drives)}."] if drives else []
        said += [
            f"'{a}' runs through itself at rest."
            if a == b
            else f"'{a}' and '{b}' run through each other at rest."
            for a, b in self.crossings
        ]
        return render_text(
            *said,
            format_table(
                columns, rows, "Leaf springs: undeformed, and the forces in them in the wanted shape"
            ),
        )

    def line(self, leaf: str, *, points: int = STATIONS) -> Array:
        """Places (points, 3) [m] along a leaf at rest, evenly from its start to its end. Raises SceneError."""
        known = [f.name for f in self.leaves]
        if leaf not in known:
            raise SceneError(
                f"there is no leaf {show(leaf)}; there are {', '.join(known)}{name_hint(leaf, known)}"
            )
        axes, count = axes_of(str(self.plane)), whole_number(points, "points", least=2)
        drawn = [
            DrawnLeaf(name, ("", ""), piece, axes, np.zeros(2), FINE)
            for name, of, piece in pieces_of(self)
            if of == leaf
        ]
        ends = np.cumsum([0.0, *(piece.long for piece in drawn)])
        found = np.empty((count, 3))
        found[:, axes.normal] = self.leaves[known.index(leaf)].leaf.start[axes.normal]
        for row, s in zip(found, np.linspace(0.0, float(ends[-1]), count), strict=True):
            k = min(int(np.searchsorted(ends, s, side="right")) - 1, len(drawn) - 1)
            row[list(axes.own)] = drawn[k].stations.at(drawn[k].r, np.array([(s - ends[k]) / drawn[k].long]))[
                :, 0
            ]
        return found

    def to_csv(self, path: str | os.PathLike[str], *, points: int = STATIONS) -> Path:
        """Write the lines of all leaf springs at rest: leaf, s_m along it, x_m, y_m, z_m (UTF-8, full precision, one header
        line). Returns the path."""
        text = io.StringIO(newline="")
        writer = csv.writer(text)
        writer.writerow(("leaf", "s_m", "x_m", "y_m", "z_m"))
        for placed in self.leaves:
            line = self.line(placed.name, points=points)
            stations = np.linspace(0.0, placed.leaf.length, len(line))
            writer.writerows(
                (placed.name, s, *p) for s, p in zip(stations.tolist(), line.tolist(), strict=True)
            )
        return write_file(path, text.getvalue(), what="table")


__all__ = ["FINE", "RestShape", "pieces_of"]
