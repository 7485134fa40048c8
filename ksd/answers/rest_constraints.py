"""Constraints of the undeformed configuration, for the constraint doctor: rows of the stiff directions of leaf springs and
joints, of supports and of drives.

A leaf is as many constraints as its stiffness has large eigenvalues: three for a sheet, one for a slender wire. A joint
counts by the stiffness of its interface B with its interior condensed. A row acts on the small motions of all nodes, six
each: displacement of the reference point, and rotation times the size of the mechanism. Rows have unit norm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr
from scipy.spatial.transform import Rotation

from ksd.answers.nonconservative import cross_matrix
from ksd.answers.tangent import exact_tangent_arrays, stored_matrix
from ksd.model.arrays import make_workspace
from ksd.model.compile import Model, compile_scene
from ksd.model.leaves import cut_leaves
from ksd.model.newton import assemble
from ksd.scene.drive import GROUND
from ksd.scene.scene import PlacedLeaf, Scene

Array = NDArray[np.float64]
MIN_STIFFNESS_RATIO = 10.0
"""Smallest ratio of consecutive eigenvalues that separates stiff directions from soft ones."""
LEAF_WORDS = (
    "stretch", "bending across its thickness", "shear in its plane", "torsion", "bending in its plane",
    "bending across its thickness",
)  # fmt: skip
"""Names of the six directions of a leaf."""


@dataclass(frozen=True)
class Constraint:
    """A constrained direction.

    what: such as "y-rotation of joint 'B'"; row (6 nodes,): coefficients of the motions of all nodes; stiffness [N/m] along
    the row (rotations times the size), inf where it is prescribed; release: how to release it, in words.
    """

    what: str
    row: Array
    stiffness: float
    release: str


@dataclass(frozen=True)
class ElasticConnection:
    """An elastic connection of two nodes (a, b).

    K (6, 6) [N/m]: stiffness for the motion of b relative to a at `point` (3,) [m], in `axes` (3, 3; columns), rotations
    times `length` [m].
    """

    nodes: tuple[int, int]
    point: Array
    axes: Array
    length: float
    K: Array

    def jacobian(self, positions: Array, size: float) -> Array:
        """Jacobian (6, 6 nodes) of its motion (rotations times its length) with respect to all nodes (rotations times
        `size`)."""
        J = np.zeros((6, 6 * len(positions)))
        for node, sign in zip(self.nodes, (-1.0, 1.0), strict=True):
            lever, at = -cross_matrix(self.point - positions[node]), 6 * node
            J[:3, at : at + 3] += sign * self.axes.T
            J[:3, at + 3 : at + 6] += sign * self.axes.T @ lever / size
            J[3:, at + 3 : at + 6] += sign * self.axes.T * (self.length / size)
        return J

    def moved(self, twist: Array, positions: Array, *, turns_with_chord: bool) -> ElasticConnection:
        """The connection after small motions of all nodes, twist (nodes, 6) [m, rad].

        turns_with_chord: its axes turn with the line between its ends, as those of a leaf; else as its ends on average.
        """
        shift = [twist[n, :3] + np.cross(twist[n, 3:], self.point - positions[n]) for n in self.nodes]
        turn = 0.5 * (twist[self.nodes[0], 3:] + twist[self.nodes[1], 3:])
        if turns_with_chord:
            turn = turn + np.cross(self.axes[:, 0], shift[1] - shift[0]) / self.length
        axes = Rotation.from_rotvec(turn).as_matrix() @ self.axes
        return replace(self, point=self.point + 0.5 * (shift[0] + shift[1]), axes=axes)


def elastic_connections(
    scene: Scene, index: dict[str, int], positions: Array, size: float
) -> tuple[list[ElasticConnection], list[Constraint]]:
    """Elastic connections and constraints of all joints and free leaf springs."""
    springs, rows = [], []
    for placed in scene.joints:
        spring = joint_spring(placed, (index[placed.a], index[placed.b]))
        springs.append(spring)
        rows += joint_rows(placed, spring, positions, size)
    for name, a, b, leaf in cut_leaves(scene):
        spring = leaf_spring(leaf, (index[a], index[b]))
        springs.append(spring)
        rows += spring_rows(spring, positions, size, owner=f"leaf '{name}'", words=LEAF_WORDS)
    return springs, rows


def stiffness_at_rest(scene: Scene, point: Array, axes: Array, length: float) -> Array:
    """Stiffness (6, 6) [N/m] of the only link of `scene` at `point`, in `axes`, rotations times `length`, all else
    condensed."""
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
    T = np.zeros((6, 6))
    # the reference point moves with the point: u + phi x r
    T[:3, :3], T[3:, 3:] = axes, axes / length
    T[:3, 3:] = -cross_matrix(model.rest.x[1] - point) @ axes / length
    stiffness = T.T @ K @ T
    return 0.5 * (stiffness + stiffness.T)


def rest_matrix(model: Model, twist: Array | None = None) -> Array:
    """Tangent (n, n) of an undeformed model without loads, in the order of its unknowns; after small motions of its links,
    twist (links, 6) [m, rad], where these are given."""
    arrays = exact_tangent_arrays(model)
    work, state = make_workspace(arrays), model.rest.copy()
    if twist is not None:
        links = len(twist)
        state.x[:links] += twist[:, :3]
        state.R[:links] = Rotation.from_rotvec(twist[:, 3:]).as_matrix() @ state.R[:links]
    assemble(arrays, state, np.zeros(len(arrays.terms.start)), 0.0, work)
    return stored_matrix(arrays, work.matrix)


def leaf_spring(leaf: Any, nodes: tuple[int, int]) -> ElasticConnection:
    """Elastic connection of a leaf, at the middle of its chord."""
    middle = 0.5 * (np.asarray(leaf.start, float) + np.asarray(leaf.end, float))
    alone = Scene("leaf", (GROUND, "end"), leaves=(PlacedLeaf("leaf", GROUND, "end", leaf),))
    return ElasticConnection(
        nodes, middle, leaf.axes, leaf.length, stiffness_at_rest(alone, middle, leaf.axes, leaf.length)
    )


def joint_spring(placed: Any, nodes: tuple[int, int]) -> ElasticConnection:
    """Elastic connection of a placed joint, at the middle between its interfaces."""
    axes = np.asarray(placed.rotation, float)
    middle = placed.place(0.5 * np.asarray(placed.joint.pose_B, float))
    alone = Scene("joint", (GROUND, "end"), joints=(replace(placed, a=GROUND, b="end"),))
    length = placed.joint.length
    return ElasticConnection(nodes, middle, axes, length, stiffness_at_rest(alone, middle, axes, length))


def stiff_directions(K: Array, expected: int | None = None) -> list[tuple[int, Array]]:
    """Stiff directions (6,) of a connection: orthonormal, as close as possible to its axes, each with the number of the
    axis.

    expected: their number, used where the stiffness does not contradict it.
    """
    values, vectors = np.linalg.eigh(K)
    values, vectors = np.maximum(values[::-1], 1e-15 * values[-1]), vectors[:, ::-1]
    ratio = values[:-1] / values[1:]
    count = int(np.argmax(ratio)) + 1 if ratio.max() > MIN_STIFFNESS_RATIO else 6
    if expected is not None and 0 < expected < 6 and ratio[expected - 1] > 3.0:
        count = expected
    stiff = vectors[:, :count]
    Q, _, picked = qr(stiff @ stiff.T, pivoting=True)
    return [(int(picked[k]), Q[:, k]) for k in range(count)]


def spring_rows(
    spring: ElasticConnection,
    positions: Array,
    size: float,
    *,
    owner: str,
    words: Sequence[str],
    expected: int | None = None,
) -> list[Constraint]:
    """Constraints of an elastic connection; words: names of its six directions, expected: see `stiff_directions`."""
    J = spring.jacobian(positions, size)
    rows = []
    for axis, direction in stiff_directions(spring.K, expected):
        row = direction @ J
        length = float(np.linalg.norm(row))
        if length > 0.0:
            what = f"{words[axis]} of {owner}"
            rows.append(
                Constraint(
                    what,
                    row / length,
                    float(direction @ spring.K @ direction) * length**2,
                    _release_hint(axis, owner, words),
                )
            )
    return rows


def _release_hint(axis: int, owner: str, words: Sequence[str]) -> str:
    """How to release direction `axis` of a leaf or joint."""
    if words is not LEAF_WORDS:
        return f"let {owner} go in its {words[axis]}"
    return {
        0: f"fold {owner}: a folded leaf does not hold its length",
        2: f"make {owner} a wire, which frees its bending in the plane too",
        3: f"make {owner} longer or narrower, so that it twists",
        4: f"notch the width of {owner}",
    }.get(axis, f"make {owner} thinner or longer")


def leaf_rows(
    leaves: Sequence[Any], index: Mapping[str, int], positions: Array, size: float
) -> list[Constraint]:
    """Constraints of leaves, given as (name, block or link at the start, at the end, leaf)."""
    rows = []
    for name, a, b, leaf in leaves:
        spring = leaf_spring(leaf, (index[a], index[b]))
        rows += spring_rows(spring, positions, size, owner=f"leaf '{name}'", words=LEAF_WORDS)
    return rows


def joint_rows(placed: Any, spring: ElasticConnection, positions: Array, size: float) -> list[Constraint]:
    """Constraints of a placed joint: all six directions except its intended motions."""
    return spring_rows(
        spring, positions, size, owner=f"joint '{placed.name}'", words=_direction_names(spring.axes),
        expected=6 - len(placed.joint.motions),
    )  # fmt: skip


def _direction_names(axes: Array) -> tuple[str, ...]:
    """Names of six directions: global ones where the axes of the joint are parallel to these, else its own."""
    names = []
    for column in axes.T:
        k = int(np.argmax(np.abs(column)))
        names.append("xyz"[k] if abs(column[k]) > 1 - 1e-6 else "")
    own = [n or f"own {a}" for n, a in zip(names, "xyz", strict=True)]
    return (*[f"{n}-displacement" for n in own], *[f"{n}-rotation" for n in own])


def prescribed_rows(
    model: Model, size: float, twist: Array | None = None
) -> tuple[list[Constraint], list[Constraint]]:
    """Constraints of the supports, and constraints of the drives; twist: see `rest_matrix`."""
    K, arrays = rest_matrix(model, twist), model.arrays
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
