"""Result of `ksd.rest_shape`: the undeformed scene, with forces, checks, and the lines of its leaf springs."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.answers.printing import PrintableAnswer, format_number, format_table, render_text
from ksd.checks import name_hint, show, whole_number
from ksd.errors import SceneError
from ksd.files import write_csv
from ksd.model.leaves import cut_leaves
from ksd.model.mesh import Mesh
from ksd.rest_shapes.rest_leaf import DeformedLeaf, plane_axes
from ksd.scene.scene import Scene

Array = NDArray[np.float64]
CHECK_MESH = Mesh(orders=(3, 2, 12), points=16)
"""Mesh of the forward solution by which a rest shape is checked."""
DEFAULT_POINTS = 101
"""Points along a leaf spring by default."""


def leaf_pieces(scene: Scene) -> list[tuple[str, str, Any]]:
    """(name, name of the whole leaf, leaf) of every piece of the leaf springs, which are cut at the points on them."""
    wholes = [f.name for f in scene.leaves for _ in range(1 + sum(p.leaf == f.name for p in scene.points))]
    return [(name, whole, leaf) for (name, _, _, leaf), whole in zip(cut_leaves(scene), wholes, strict=True)]


@dataclass(frozen=True, repr=False, kw_only=True)
class RestShape(PrintableAnswer, Scene):
    """An undeformed scene that takes a wanted shape under its loads; solve it like any other scene.

    wanted: the scene in the wanted shape; targets: its drive values by name [m or rad]; forces: of the drives [N or Nm];
    leaf_forces (4,) by leaf: components in the plane of the force that the part beyond exerts on the leaf at its end [N],
    bending moments at its start and end [Nm]; folds: load fractions at which the path from the drawn shape turned back;
    crossings: pairs of leaf springs that overlap undeformed, a name twice where one overlaps itself. checked: result of the
    forward solution in words; displacement [m], rotation [rad]: its largest distance of a link from the wanted pose,
    infinite without a forward solution.

    >>> spring = ksd.Mechanism("spring", plane="xy")
    >>> leaf = spring.leaf(
    ...     "ground", spring.link("tip"), start=(0, 0, 0), end=(80 * mm, 0, 0),
    ...     section=ksd.rectangle(0.5 * mm, 10 * mm), material=ksd.Material(E=200 * GPa, nu=0.3),
    ... )
    >>> load = spring.load("tip", force=(0, -2, 0), at=(80 * mm, 0, 0))
    >>> print(ksd.rest_shape(spring).checked)
    solved forward it comes back to the wanted shape within 0 mm and 0 rad
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
        axes = "xyz" if self.plane is None else [("xyz")[k] for k in plane_axes(self.plane).in_plane]
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
        lines = [f"Rest shape of '{self.name}': {self.checked}."]
        lines += [f"Drives: {'; '.join(drives)}."] if drives else []
        lines += [
            f"'{a}' runs through itself at rest."
            if a == b
            else f"'{a}' and '{b}' run through each other at rest."
            for a, b in self.crossings
        ]
        return render_text(
            *lines,
            format_table(
                columns, rows, "Leaf springs: undeformed, and the forces in them in the wanted shape"
            ),
        )

    def line(self, leaf: str, *, points: int = DEFAULT_POINTS) -> Array:
        """Positions (points, 3) [m] along an undeformed leaf, evenly from its start to its end. Raises SceneError."""
        names = [f.name for f in self.leaves]
        if leaf not in names:
            raise SceneError(
                f"there is no leaf {show(leaf)}; there are {', '.join(names)}{name_hint(leaf, names)}"
            )
        axes, count = plane_axes(str(self.plane)), whole_number(points, "points", least=2)
        pieces = [
            DeformedLeaf(name, ("", ""), piece, axes, np.zeros(2), CHECK_MESH)
            for name, whole, piece in leaf_pieces(self)
            if whole == leaf
        ]
        ends = np.cumsum([0.0, *(piece.length for piece in pieces)])
        positions = np.empty((count, 3))
        positions[:, axes.normal] = self.leaves[names.index(leaf)].leaf.start[axes.normal]
        for position, s in zip(positions, np.linspace(0.0, float(ends[-1]), count), strict=True):
            k = min(int(np.searchsorted(ends, s, side="right")) - 1, len(pieces) - 1)
            u = np.array([(s - ends[k]) / pieces[k].length])
            position[list(axes.in_plane)] = pieces[k].stations.evaluate(pieces[k].r, u)[:, 0]
        return positions

    def to_csv(self, path: str | os.PathLike[str], *, points: int = DEFAULT_POINTS) -> Path:
        """Write the lines of all undeformed leaf springs: leaf, s_m along it, x_m, y_m, z_m (UTF-8, full precision, one
        header line). Returns the path."""
        rows = []
        for placed in self.leaves:
            line = self.line(placed.name, points=points)
            stations = np.linspace(0.0, placed.leaf.length, len(line))
            rows += [(placed.name, s, *p) for s, p in zip(stations.tolist(), line.tolist(), strict=True)]
        return write_csv(path, ("leaf", "s_m", "x_m", "y_m", "z_m"), rows)
