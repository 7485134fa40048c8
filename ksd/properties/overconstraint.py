"""Overconstrained layouts: how often the leafs hold the same motion twice, and the internal stress that costs.

Counting: a leaf holds three motions of its end (along e1, along its width e3, about e2 across its middle surface), a wire
of equal width and thickness only the one along it, drives and supports one each. The self-stresses are what the
equilibrium of the blocks leaves free: count = holds - rank (Maxwell; Blanding, Exact Constraint, 1999, for the rule).

Internal stress: an end that is clamped a little beside its place strains a leaf that is held twice over; the change of
the state is the linear response of the exact tangent to that misplacement, at any pose.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.errors import SceneError
from ksd.model.arrays import STRAIN, Motion
from ksd.model.compile import Model
from ksd.model.loading import term_value
from ksd.properties.alike import Flexible, alike_leafs, flexible_leafs, inner_unknowns
from ksd.properties.shape import members_of_leafs, scene_leafs
from ksd.properties.stress import stress
from ksd.properties.tangent import Tangent, factored_tangent

Array = NDArray[np.float64]
DIRECTIONS = ("along", "across", "sideways", "twist", "tilt", "yaw")
"""Misplacement of a leaf's end in its own axes: along e1, e2 (thickness), e3 (width); about e1, e3 and e2."""
RANK = 1e-9


@dataclass(frozen=True)
class Overconstraint:
    """count: how many motions are held twice; freedoms: how many are held by nothing (leafs bend in them); states
    (count, holds): independent self-stresses, largest entry 1; holds: what each entry is, (leaf, drive or support; word)."""

    count: int
    freedoms: int
    states: Array
    holds: tuple[tuple[str, str], ...]

    @property
    def leafs(self) -> tuple[str, ...]:
        """Leafs that take part in a self-stress."""
        used = np.abs(self.states).max(axis=0, initial=0.0) > 1e-6
        return tuple(dict.fromkeys(name for (name, _), u in zip(self.holds, used, strict=True) if u))

    def __str__(self) -> str:
        if not self.count:
            return "exactly constrained: no motion is held twice, so misplacements cause no internal stress"
        times = "once" if self.count == 1 else f"{self.count} times"
        return f"overconstrained {times}, through {', '.join(self.leafs)}"


def overconstraint(model: Model) -> Overconstraint:
    """Count what holds the blocks of `model` at rest, drives and supports included; see the module docstring."""
    rows, names = [], []
    leafs = scene_leafs(model)
    for name, members in members_of_leafs(model).items():
        for word, row in _holds(model, leafs[name], members):
            rows.append(row)
            names.append((name, word))
    for k, row in enumerate(_drive_rows(model)):
        rows.append(row)
        names.append(((*model.drive_names, *model.support_names)[k], "held"))
    blocks = sorted(
        {
            int(n)
            for m in members_of_leafs(model).values()
            for i in (m[0], m[-1])
            for n in model.arrays.members.node[i]
        }
    )
    free = [b for b in blocks if model.arrays.start[b] >= 0]
    J = np.array(rows).reshape(len(rows), -1, 6)[:, free].reshape(len(rows), -1)
    u, s, _ = np.linalg.svd(J)
    rank = int(np.sum(s > RANK * s.max(initial=1.0)))
    states = u[:, rank:].T
    states = states / np.maximum(np.abs(states).max(axis=1, keepdims=True), 1e-300)
    return Overconstraint(len(rows) - rank, J.shape[1] - rank, states, tuple(names))


def _holds(model: Model, leaf: Any, members: list[int]) -> Iterable[tuple[str, Array]]:
    """(word, row (nodes * 6,)): the relative motions of both blocks a leaf holds; rotations count times its length."""
    at, rest = model.arrays.members, model.rest
    first, last = members[0], members[-1]
    a, b = int(at.node[first, 0]), int(at.node[last, 1])
    start = rest.x[a] + rest.R[a] @ at.offset[first, 0]
    end = rest.x[b] + rest.R[b] @ at.offset[last, 1]
    e1 = (end - start) / np.linalg.norm(end - start)
    e3 = (rest.R[a] @ at.frame[first, 0])[:, 2]
    e3 = e3 - (e3 @ e1) * e1
    e3 /= np.linalg.norm(e3)
    middle, q = 0.5 * (start + end), leaf.section
    wire = q.Iy < 4 * q.Iz and q.Iz < 4 * q.Iy
    kinds = [("along", e1, False)]
    if not wire:
        kinds += [("sideways", e3, False), ("yaw", np.cross(e3, e1), True)]
    for word, axis, turns in kinds:
        row = np.zeros((len(rest.x), 6))
        for node, sign in ((a, -1.0), (b, 1.0)):
            if turns:
                row[node, 3:] += sign * np.linalg.norm(end - start) * axis
            else:
                row[node, :3] += sign * axis
                row[node, 3:] += sign * np.cross(middle - rest.x[node], axis)
        yield word, row.ravel()


def _drive_rows(model: Model) -> Iterable[Array]:
    """Row (nodes * 6,) of every drive and support at rest."""
    terms = model.arrays.terms
    gradient, scratch = np.empty(12), np.empty((12, 12))
    for i in range(len(terms.start)):
        row = np.zeros((len(model.rest.x), 6))
        for t in range(terms.first[i], terms.first[i + 1]):
            term_value(terms, model.rest.x, model.rest.R, t, gradient, scratch, 0.0)
            for e in range(2):
                row[terms.node[t, e]] += terms.coefficient[t] * gradient[6 * e : 6 * e + 6]
        yield row.ravel()


@dataclass(frozen=True)
class Misplaced:
    """What misplacements of leaf ends do: per (leaf, direction) the largest von Mises stress anywhere [Pa] of the change,
    and where: the leaf it is in. offset [m] and rotation [rad] are the misplacements asked about."""

    offset: float
    rotation: float
    stress_Pa: dict[tuple[str, str], float]
    worst_leaf: dict[tuple[str, str], str]

    @property
    def worst(self) -> tuple[str, str]:
        """The (leaf, direction) whose misplacement costs most."""
        return max(self.stress_Pa, key=self.stress_Pa.__getitem__)

    @property
    def largest_Pa(self) -> float:
        """Largest internal stress of any one misplacement."""
        return self.stress_Pa[self.worst]

    def __str__(self) -> str:
        leaf, direction = self.worst
        size = (
            f"{1e6 * self.offset:g} um"
            if DIRECTIONS.index(direction) < 3
            else f"{1e3 * self.rotation:g} mrad"
        )
        return (
            f"worst misplacement: the end of '{leaf}' by {size} ({direction}): {1e-6 * self.largest_Pa:.4g} MPa of internal "
            f"stress in '{self.worst_leaf[self.worst]}'"
        )


def internal_stress(
    model: Model,
    motion: Motion,
    *,
    offset: float = 1e-5,
    rotation: float = 1e-4,
    leafs: Iterable[str] = (),
    load_factor: float = 1.0,
    points: int = 13,
) -> Misplaced:
    """Internal stress when the end of a leaf is clamped beside its place, one leaf and direction at a time.

    offset [m] and rotation [rad] of the end in the leaf's own axes, see DIRECTIONS; leafs: full names, all when empty.
    Linear in both. Raises SceneError for unknown names, sizes that are not positive, or chains of elements.
    """
    names = members_of_leafs(model)
    asked = tuple(leafs) or tuple(names)
    for name in asked:
        if name not in names:
            raise SceneError(f"leaf '{name}' is not part of this mechanism; its leafs are {', '.join(names)}")
    if not (offset > 0 and rotation > 0):
        raise SceneError(f"offset = {offset}, rotation = {rotation}: both misplacements must be positive")
    if np.any(model.arrays.members.kind != STRAIN):
        raise SceneError(
            "internal stress is answered by strain-mode leafs only; compile without chains of elements"
        )
    tangent = factored_tangent(model, motion, load_factor=load_factor)
    flexible = flexible_leafs(model, motion)
    found: dict[tuple[str, str], float] = {}
    where: dict[tuple[str, str], str] = {}
    for name in asked:
        for k, direction in enumerate(DIRECTIONS):
            misplaced = np.zeros(6)
            misplaced[(0, 1, 2, 3, 5, 4)[k]] = offset if k < 3 else rotation
            change = _change(tangent, flexible, names[name][0], misplaced)
            extra = stress(model, change, points=points)
            found[name, direction], where[name, direction] = extra.largest_Pa, extra.where[0]
    return Misplaced(offset, rotation, found, where)


def _change(tangent: Tangent, flexible: list[Flexible], member: int, misplaced: Array) -> Motion:
    """The rest state with the stresses of the change alone: linear response to end q of `member` moved (6,) in its axes."""
    model, motion = tangent.model, tangent.motion
    loads = np.zeros(model.arrays.plan.unknowns + 1)
    moved = []
    for group, leaf, unknowns in zip(alike_leafs(model), flexible, inner_unknowns(model), strict=True):
        # xi in frame p is the misplacement in the axes of q at this state
        xi = np.zeros((len(group.members), 6))
        here = group.members == member
        R = _end_turn(model, motion, member)
        xi[here] = np.concatenate([R @ misplaced[:3], R @ misplaced[3:]])
        K = _condensed(leaf)
        pull = leaf.relative.swapaxes(1, 2) @ (K @ xi[..., None])
        at = np.where(unknowns[:, :12] < 0, len(loads) - 1, unknowns[:, :12])
        np.add.at(loads, at, -pull[..., 0])
        moved.append((group, leaf, at, xi, K))
    response = tangent.solve(loads[:-1, None])[:, 0]
    nodes = np.append(response, 0.0)
    state = motion.copy()
    state.inner[:] = model.rest.inner
    for group, leaf, at, xi, K in moved:
        total = xi + (leaf.relative @ nodes[at][..., None])[..., 0]
        bent, wrench = (leaf.P @ total[..., None])[..., 0], (K @ total[..., None])[..., 0]
        state.inner[group.places] = model.rest.inner[group.places] + np.hstack([bent, wrench])
    return state


def _end_turn(model: Model, motion: Motion, member: int) -> Array:
    """Axes (3, 3) of end q of a member, as columns in frame p."""
    members = model.arrays.members
    a, b = members.node[member]
    one, two = motion.R[a] @ members.frame[member, 0], motion.R[b] @ members.frame[member, 1]
    found: Array = one.T @ two
    return found


def _condensed(leaf: Flexible) -> Array:
    """(k, 6, 6): end wrench per relative motion of the ends."""
    parts = leaf.parts
    F = parts.J @ np.linalg.solve(leaf.stiffness, parts.J.swapaxes(1, 2))
    F[:, :3, :3] += parts.S
    return np.linalg.inv(F)
