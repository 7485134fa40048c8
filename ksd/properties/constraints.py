"""Leafs, joints, drives and supports as constraints: what they hold stiffly at rest, row by row.

A leaf is as many constraints as its stiffness has large eigenvalues: three for a sheet, one for a slender wire. A joint
counts by the stiffness of its interface B with its insides condensed. A row acts on the small motions of all nodes, six
each: displacement of the reference point, and rotation times the size of the mechanism; rows have length 1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.model.arrays import make_work
from ksd.model.compile import Model, compile_scene
from ksd.model.newton import assemble
from ksd.properties.tangent import exact, stored_matrix
from ksd.scene.contents import PlacedLeaf, Scene
from ksd.scene.drive import GROUND

Array = NDArray[np.float64]
GAP = 10.0
"""Smallest ratio of neighbouring eigenvalues that parts stiff directions from soft ones."""
_LEAF = (
    "stretch",
    "bending across its thickness",
    "shear in its plane",
    "torsion",
    "bending in its plane",
    "bending across its thickness",
)


@dataclass(frozen=True)
class Constraint:
    """One direction that something holds. what: "y-rotation of joint 'B'"; row (6 nodes,); stiffness [N/m] along the
    row (a rotation times the size), inf where it is prescribed; release: how to let it go, in words."""

    what: str
    row: Array
    stiffness: float
    release: str


@dataclass(frozen=True)
class Spring:
    """An elastic connection of nodes a and b: point (3,), axes (3, 3) columns, length [m], and its stiffness (6, 6) for the
    motion of b over a at the point, in its axes, rotations times the length [N/m]."""

    nodes: tuple[int, int]
    point: Array
    axes: Array
    length: float
    K: Array

    def motion(self, places: Array, size: float) -> Array:
        """(6, 6 nodes): its own motion, rotations times its length, from those of all nodes, rotations times `size`."""
        J = np.zeros((6, 6 * len(places)))
        for node, sign in zip(self.nodes, (-1.0, 1.0), strict=True):
            x, y, z = self.point - places[node]
            lever = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
            at = 6 * node
            J[:3, at : at + 3] += sign * self.axes.T
            J[:3, at + 3 : at + 6] += sign * self.axes.T @ lever / size
            J[3:, at + 3 : at + 6] += sign * self.axes.T * (self.length / size)
        return J


def stiffness_at_rest(scene: Scene, point: Array, axes: Array, length: float) -> Array:
    """(6, 6) of the only link of `scene` [N/m]: at `point`, in `axes`, rotations times `length`, all else condensed."""
    model = compile_scene(scene)
    K = rest_matrix(model)
    own = np.arange(6) + int(model.arrays.start[1])
    other = np.setdiff1d(np.arange(len(K)), own)
    if len(other):
        K = K[np.ix_(own, own)] - K[np.ix_(own, other)] @ np.linalg.solve(
            K[np.ix_(other, other)], K[np.ix_(other, own)]
        )
    else:
        K = K[np.ix_(own, own)]
    x, y, z = model.rest.x[1] - point
    T = np.zeros((6, 6))
    # the reference point moves with the point: u + phi x r
    T[:3, :3], T[3:, 3:] = axes, axes / length
    T[:3, 3:] = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]) @ axes / length
    found = T.T @ K @ T
    return 0.5 * (found + found.T)


def rest_matrix(model: Model) -> Array:
    """The tangent (n, n) of a model at rest, without loads, in the order of its unknowns."""
    arrays = exact(model.arrays)
    work = make_work(arrays)
    assemble(arrays, model.rest, np.zeros(len(arrays.terms.start)), 0.0, work, 1e-8, 0, 10.0)
    return stored_matrix(arrays, work.value)


def leaf_spring(leaf: Any, nodes: tuple[int, int]) -> Spring:
    """A leaf as a spring, seen from the middle of its chord."""
    middle = 0.5 * (np.asarray(leaf.start, float) + np.asarray(leaf.end, float))
    alone = Scene("leaf", (GROUND, "end"), leafs=(PlacedLeaf("leaf", GROUND, "end", leaf),))
    return Spring(
        nodes, middle, leaf.axes, leaf.length, stiffness_at_rest(alone, middle, leaf.axes, leaf.length)
    )


def joint_spring(placed: Any, nodes: tuple[int, int]) -> Spring:
    """A placed joint as a spring, seen from the middle between its interfaces."""
    from dataclasses import replace

    axes = np.asarray(placed.rotation, float)
    middle = placed.place(0.5 * np.asarray(placed.joint.pose_B, float))
    alone = Scene("joint", (GROUND, "end"), joints=(replace(placed, a=GROUND, b="end"),))
    length = placed.joint.length
    return Spring(nodes, middle, axes, length, stiffness_at_rest(alone, middle, axes, length))


def held(K: Array, expected: int | None = None) -> list[tuple[int, Array]]:
    """Directions (6,) a spring holds: orthonormal, as near to its axes as they can be, each with the axis' number.

    expected: how many there should be, believed where the stiffness does not contradict it.
    """
    from scipy.linalg import qr

    values, vectors = np.linalg.eigh(K)
    values, vectors = np.maximum(values[::-1], 1e-15 * values[-1]), vectors[:, ::-1]
    ratio = values[:-1] / values[1:]
    count = int(np.argmax(ratio)) + 1 if ratio.max() > GAP else 6
    if expected is not None and 0 < expected < 6 and ratio[expected - 1] > 3.0:
        count = expected
    stiff = vectors[:, :count]
    Q, _, picked = qr(stiff @ stiff.T, pivoting=True)
    return [(int(picked[k]), Q[:, k]) for k in range(count)]


def spring_rows(
    spring: Spring,
    places: Array,
    size: float,
    *,
    owner: str,
    words: Sequence[str],
    expected: int | None = None,
) -> list[Constraint]:
    """The constraints a spring is."""
    J = spring.motion(places, size)
    rows = []
    for axis, along in held(spring.K, expected):
        row = along @ J
        length = float(np.linalg.norm(row))
        if length > 0.0:
            what = f"{words[axis]} of {owner}"
            rows.append(
                Constraint(
                    what,
                    row / length,
                    float(along @ spring.K @ along) * length**2,
                    _release(axis, owner, words),
                )
            )
    return rows


def _release(axis: int, owner: str, words: Sequence[str]) -> str:
    if words is not _LEAF:
        return f"let {owner} go in its {words[axis]}"
    return {
        0: f"fold {owner}: a folded leaf does not hold its length",
        2: f"make {owner} a wire, which frees its bending in the plane too",
        3: f"make {owner} longer or narrower, so that it twists",
        4: f"notch the width of {owner}",
    }.get(axis, f"make {owner} thinner or longer")


def leaf_rows(leafs: Sequence[Any], index: Mapping[str, int], places: Array, size: float) -> list[Constraint]:
    """Constraints of (name, block or link at the start, at the end, leaf)."""
    rows = []
    for name, a, b, leaf in leafs:
        spring = leaf_spring(leaf, (index[a], index[b]))
        rows += spring_rows(spring, places, size, owner=f"leaf '{name}'", words=_LEAF)
    return rows


def joint_rows(placed: Any, spring: Spring, places: Array, size: float) -> list[Constraint]:
    """Constraints of a placed joint: six but for its intended motions."""
    return spring_rows(
        spring, places, size, owner=f"joint '{placed.name}'", words=_words(spring.axes),
        expected=6 - len(placed.joint.motions),
    )  # fmt: skip


def _words(axes: Array) -> tuple[str, ...]:
    """Names of six directions: those of the mechanism where the joint is parallel to it, else its own."""
    names = []
    for column in axes.T:
        k = int(np.argmax(np.abs(column)))
        names.append("xyz"[k] if abs(column[k]) > 1 - 1e-6 else "")
    own = [n or f"own {a}" for n, a in zip(names, "xyz", strict=True)]
    return (*[f"{n}-displacement" for n in own], *[f"{n}-rotation" for n in own])


def prescribed_rows(model: Model, size: float) -> tuple[list[Constraint], list[Constraint]]:
    """Constraints of the supports, and of the drives."""
    K, arrays = rest_matrix(model), model.arrays
    names = (*model.drive_names, *model.support_names)
    scale = np.array([1.0, 1.0, 1.0, 1 / size, 1 / size, 1 / size])
    found = []
    for i, name in enumerate(names):
        row = np.zeros(6 * model.links)
        for node in range(1, model.links):
            at = int(arrays.start[node])
            row[6 * node : 6 * node + 6] = K[arrays.terms.start[i], at : at + 6] * scale
        kind = "drive" if i < len(model.drive_names) else "support"
        length = float(np.linalg.norm(row)) or 1.0
        found.append(Constraint(f"{kind} '{name}'", row / length, np.inf, f"remove {kind} '{name}'"))
    drives = len(model.drive_names)
    return found[drives:], found[:drives]
