"""Internal stress of overconstrained layouts: what it costs when a leaf is clamped a little beside its place.

A leaf that is held twice over (see `ksd.properties.doctor`) cannot give way to a misplaced end, and is strained by it;
one that is held once moves along. The change of the state is the linear response of the exact tangent, at any pose.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.errors import SceneError
from ksd.model.arrays import STRAIN, Motion
from ksd.model.compile import Model
from ksd.properties.alike import Flexible, alike_leafs, flexible_leafs, inner_unknowns
from ksd.properties.section_forces import section_forces
from ksd.properties.shape import members_of_leafs
from ksd.properties.stress import stress_of
from ksd.properties.tangent import Tangent, factored_tangent

Array = NDArray[np.float64]
DIRECTIONS = ("along", "across", "sideways", "twist", "tilt", "yaw")
"""Misplacement of a leaf's end in its own axes: along e1, e2 (thickness), e3 (width); about e1, e3 and e2."""


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
    flexible = flexible_leafs(model, motion, load_factor=load_factor)
    told: dict[str, Any] = {"points": points, "load_factor": load_factor}
    before = section_forces(model, motion, **told)
    found: dict[tuple[str, str], float] = {}
    where: dict[tuple[str, str], str] = {}
    for name in asked:
        for k, direction in enumerate(DIRECTIONS):
            misplaced = np.zeros(6)
            misplaced[(0, 1, 2, 3, 5, 4)[k]] = offset if k < 3 else rotation
            after = section_forces(model, _change(tangent, flexible, names[name][0], misplaced), **told)
            extra = stress_of(
                model, {n: replace(f, values=f.values - before[n].values) for n, f in after.items()}
            )
            found[name, direction], where[name, direction] = extra.largest_Pa, extra.where[0]
    return Misplaced(offset, rotation, found, where)


def _change(tangent: Tangent, flexible: list[Flexible], member: int, misplaced: Array) -> Motion:
    """The leafs after the linear response to end q of `member` moved (6,) in its axes; nodes stay where they were."""
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
    for group, leaf, at, xi, K in moved:
        total = xi + (leaf.relative @ nodes[at][..., None])[..., 0]
        bent, wrench = (leaf.P @ total[..., None])[..., 0], (K @ total[..., None])[..., 0]
        state.inner[group.places] += np.hstack([bent, wrench])
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
