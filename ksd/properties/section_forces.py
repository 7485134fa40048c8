"""Section forces of every leaf: N, Vy, Vz [N], T, My, Mz [Nm] along the leaf.

Positive on the section whose outward normal points along the leaf, in the axes of the deformed section. For
both leaf models they follow from the leaf's end wrench (n, m) by equilibrium: force n and moment m + (r(L)
- r(s)) x n, turned into the section. The other ways are worse where stress is largest. In a strain-mode
leaf the curvature series times the rigidity is right in the mean, not at the ends (7e-4 of the moment off
in a cross flexure turned by 45 degrees). In a chain the strains of Appendix A give bending moments, but as
shear only their difference over an element whose two ends have different axes, which under twist mixes weak
and strong bending.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ksd.model.arrays import Motion, Work, make_work
from ksd.model.compile import Model
from ksd.properties.alike import Alike, alike_leafs
from ksd.properties.shape import (
    Ends,
    chain_axes,
    chain_nodes,
    crossed,
    member_ends,
    member_parts,
    members_of_leafs,
    strain_curves,
)

Array = NDArray[np.float64]
COMPONENTS = ("N", "Vy", "Vz", "T", "My", "Mz")
"""Columns of `SectionForces.values`; the first three in N, the others in Nm."""
POINTS = 25


@dataclass(frozen=True)
class SectionForces:
    """Section forces of one leaf: stations s (k,) [m] from its start, values (k, 6), columns COMPONENTS.

    Stations of a chain are its nodes.
    """

    name: str
    s: Array
    values: Array

    @property
    def start(self) -> Array:
        """Values (6,) at the start of the leaf."""
        return self.values[0]

    @property
    def end(self) -> Array:
        """Values (6,) at the end of the leaf."""
        return self.values[-1]


def section_forces(model: Model, motion: Motion, *, points: int = POINTS) -> dict[str, SectionForces]:
    """Section forces of all leafs by full name; `points` stations in a strain-mode leaf."""
    parts: dict[int, tuple[Array, Array]] = {}
    for group in alike_leafs(model):
        parts |= zip(group.members.tolist(), _strain_forces(group, motion, points), strict=True)
    found, work = {}, make_work(model.arrays)
    for name, members in members_of_leafs(model).items():
        at, stations, values = 0.0, [], []
        for i in members:
            s, forces = parts[i] if i in parts else _chain_forces(model, motion, i, work)
            stations.append(at + s)
            values.append(forces)
            at += s[-1]
        found[name] = SectionForces(name, np.concatenate(stations), np.concatenate(values))
    return found


def _strain_forces(group: Alike, motion: Motion, points: int) -> list[tuple[Array, Array]]:
    """Stations (k,) and section forces (k, 6) of every leaf of a group."""
    inner = motion.inner[group.places]
    s, r, R = strain_curves(group.value, group.number, inner, points)
    n, m = inner[:, None, group.modes : group.modes + 3], inner[:, None, group.modes + 3 :]
    return list(zip(s, _along(r, R, n, m), strict=True))


def _chain_forces(model: Model, motion: Motion, i: int, work: Work) -> tuple[Array, Array]:
    """Stations (k,) and section forces (k, 6) of a chain, at its nodes."""
    value, number, inner = member_parts(model, motion, i)
    ends = member_ends(model, motion, i)
    lengths = value[: 16 * int(number[0])].reshape(-1, 16)[:, 0]
    r, turned = chain_nodes(value, number, inner, ends)
    wrench = _chain_wrench(model, motion, i, ends, work)
    forces = _along(r[None], (turned @ chain_axes(value, number))[None], wrench[None, :3], wrench[None, 3:])
    return np.concatenate([[0.0], np.cumsum(lengths)]), forces[0]


def _along(r: Array, R: Array, n: Array, m: Array) -> Array:
    """Section forces (leafs, k, 6) from positions and axes along leafs, and the wrench n, m (leafs, 1, 3) on end q."""
    moment = m + crossed(r[:, -1:] - r, n)
    forces = np.broadcast_to(n, r.shape)
    found: Array = np.concatenate([forces, moment], axis=2).reshape(*r.shape[:2], 2, 3) @ R
    return found.reshape(*r.shape[:2], 6)


def _chain_wrench(model: Model, motion: Motion, i: int, ends: Ends, work: Work) -> Array:
    """Force and moment (6,) on end q of a chain, in frame p, inner residual condensed out."""
    from ksd.model.assembly import condense_member

    members, stiffness = model.arrays.members, np.empty((6, 6))
    condense_member(members, motion.inner, work, i, ends.d, np.ascontiguousarray(ends.Q), stiffness, 0)
    return work.lam[i, :6]
