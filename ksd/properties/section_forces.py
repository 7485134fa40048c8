"""Section forces of every leaf: N, Vy, Vz [N], T, My, Mz [Nm] along the leaf.

Positive on the section whose outward normal points along the leaf, in the axes of the deformed section. For
both leaf models they follow from the leaf's end wrench (n, m) by equilibrium: force n and moment m + (r(L)
- r(s)) x n, and of a leaf with weight that of what is beyond s, turned into the section. The other ways are worse where
stress is largest. In a strain-mode
leaf the curvature series times the rigidity is right in the mean, not at the ends (7e-4 of the moment off
in a cross flexure turned by 45 degrees). In a chain the strains of Appendix A give bending moments, but as
shear only their difference over an element whose two ends have different axes, which under twist mixes weak
and strong bending.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ksd.beam.weight import PULL
from ksd.model.arrays import SOLID, Motion, Work, make_work
from ksd.model.assembly import condense_member
from ksd.model.compile import Model
from ksd.properties.alike import Alike, alike_leafs, own_gravity
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
from ksd.properties.words import Named, Shown, listed, number

Array = NDArray[np.float64]
COMPONENTS = ("N", "Vy", "Vz", "T", "My", "Mz")
"""Columns of `SectionForces.values`; the first three in N, the others in Nm."""
POINTS = 25


@dataclass(frozen=True, repr=False)
class SectionForces(Shown):
    """Section forces of one leaf: stations s (k,) [m] from its start, values (k, 6), columns COMPONENTS.

    Stations of a chain are its nodes.
    """

    name: str
    s: Array
    values: Array

    def _line(self) -> str:
        most = np.abs(self.values).max(axis=0)
        said = ", ".join(f"{c} {number(v, 3)}" for c, v in zip(COMPONENTS, most, strict=True))
        return f"'{self.name}', at most {said} [N, Nm]"

    def __str__(self) -> str:
        rows = [
            (number(1e3 * s, 4), *(number(v, 4, zero=1e-9 * float(np.abs(self.values).max())) for v in row))
            for s, row in zip(self.s, self.values, strict=True)
        ]
        return listed(("s [mm]", *COMPONENTS), rows, f"Section forces [N, Nm] along leaf '{self.name}'")

    @property
    def start(self) -> Array:
        """Values (6,) at the start of the leaf."""
        return self.values[0]

    @property
    def end(self) -> Array:
        """Values (6,) at the end of the leaf."""
        return self.values[-1]


def section_forces(
    model: Model, motion: Motion, *, points: int = POINTS, load_factor: float = 1.0
) -> Named[SectionForces]:
    """Section forces of all leafs by full name; `points` stations in a strain-mode leaf; their weight times load_factor."""
    parts: dict[int, tuple[Array, Array]] = {}
    for group in alike_leafs(model):
        gravity = own_gravity(model, motion, group, load_factor)
        parts |= zip(group.members.tolist(), _strain_forces(group, motion, points, gravity), strict=True)
    found, work = {}, make_work(model.arrays) if len(parts) < len(model.arrays.members.kind) else None
    for name, members in members_of_leafs(model).items():
        at, stations, values = 0.0, [], []
        for i in members:
            other = _solid_forces if model.arrays.members.kind[i] == SOLID else _chain_forces
            s, forces = parts[i] if i in parts else other(model, motion, i, (work, load_factor))
            stations.append(at + s)
            values.append(forces)
            at += s[-1]
        found[name] = SectionForces(name, np.concatenate(stations), np.concatenate(values))
    said = "Section forces, the largest along every leaf"
    units = [f"{c} [{'N' if c in COMPONENTS[:3] else 'Nm'}]" for c in COMPONENTS]
    return Named(found, said, ("leaf", *units), _most)


def _most(forces: SectionForces) -> list[str]:
    """Largest amounts of the six components, in words."""
    most = np.abs(forces.values).max(axis=0)
    return [number(float(v), 4, zero=1e-9 * float(most.max())) for v in most]


def end_wrenches(model: Model, motion: Motion, *, load_factor: float = 1.0) -> Array:
    """Force and moment (members, 6) [N, Nm] on end q of every member, in the frame of its end p."""
    members = model.arrays.members
    found, work = np.empty((len(members.kind), 6)), None
    strain = set()
    for group in alike_leafs(model):
        found[group.members] = motion.inner[group.places][:, group.modes :]
        strain |= set(group.members.tolist())
    for i in range(len(found)):
        if i not in strain:
            work = work or make_work(model.arrays)
            found[i] = _chain_wrench(model, motion, i, member_ends(model, motion, i), (work, load_factor))[1]
    return found


def _strain_forces(
    group: Alike, motion: Motion, points: int, gravity: Array | None
) -> list[tuple[Array, Array]]:
    """Stations (k,) and section forces (k, 6) of every leaf of a group; gravity (leafs, 3) in their frames p."""
    inner = motion.inner[group.places]
    s, r, R, *beyond = strain_curves(group.value, group.number, inner, points, gravity)
    weight = () if gravity is None else (gravity[:, None], *beyond)
    return list(zip(s, _along(r, R, inner[:, None, group.modes :], *weight), strict=True))


def _chain_forces(
    model: Model, motion: Motion, i: int, how: tuple[Work | None, float]
) -> tuple[Array, Array]:
    """Stations (k,) and section forces (k, 6) of a chain, at its nodes; how: storage and load factor."""
    value, number, inner = member_parts(model, motion, i)
    ends = member_ends(model, motion, i)
    lengths = value[: 16 * int(number[0])].reshape(-1, 16)[:, 0]
    r, turned = chain_nodes(value, number, inner, ends)
    gravity, wrench = _chain_wrench(model, motion, i, ends, how)
    weight = () if gravity is None else (gravity, *_chain_masses(value, int(number[0]), r))
    forces = _along(r[None], (turned @ chain_axes(value, number))[None], wrench[None, None], *weight)
    return np.concatenate([[0.0], np.cumsum(lengths)]), forces[0]


def _solid_forces(
    model: Model, motion: Motion, i: int, how: tuple[Work | None, float]
) -> tuple[Array, Array]:
    """Stations (k,) and section forces (k, 6) along the middle of a reduced solid."""
    ends = member_ends(model, motion, i)
    solid = model.bodies[model.member_names[i]]
    s, r, R = solid.line(ends.d, ends.Q, member_parts(model, motion, i)[2])
    _, wrench = _chain_wrench(model, motion, i, ends, how)
    return s, _along(r[None], R[None], wrench[None, None])[0]


def _chain_masses(value: Array, count: int, r: Array) -> tuple[Array, Array]:
    """Mass (1, k) [kg] beyond every node of a chain, and its first moment up to there (1, k, 3) [kg m]: int M dr."""
    lumps = value[16 * count + 9 : 17 * count + 10]
    # half of the first element at node 0, so the elements follow one by one
    masses = np.empty(count)
    carried = 0.0
    for k in range(count):
        masses[k] = 2 * (lumps[k] - carried)
        carried = 0.5 * masses[k]
    mass = np.append(np.cumsum(masses[::-1])[::-1], 0.0)
    middle = 0.5 * (mass[1:] + mass[:-1])[:, None]
    first = np.concatenate([np.zeros((1, 3)), np.cumsum(middle * np.diff(r, axis=0), axis=0)])
    return mass[None], first[None]


def _along(r: Array, R: Array, wrench: Array, *weight: Array) -> Array:
    """Section forces (leafs, k, 6) from positions and axes along leafs, and the wrench (leafs, 1, 6) on end q.

    weight: gravity (leafs, 1, 3), mass beyond every station (leafs, k), and int M dr up to there (leafs, k, 3).
    """
    n = wrench[..., :3]
    moment, forces = wrench[..., 3:] + crossed(r[:, -1:] - r, n), np.broadcast_to(n, r.shape)
    if weight:
        gravity, mass, first = weight
        forces = forces + mass[..., None] * gravity
        moment = moment + crossed(first[:, -1:] - first, gravity)
    found: Array = np.concatenate([forces, moment], axis=2).reshape(*r.shape[:2], 2, 3) @ R
    return found.reshape(*r.shape[:2], 6)


def _chain_wrench(
    model: Model, motion: Motion, i: int, ends: Ends, how: tuple[Work | None, float]
) -> tuple[Array | None, Array]:
    """Gravity (3,) on a chain, None without weight, and force and moment (6,) on its end q, inner residual condensed out;
    frame p."""
    members, stiffness, gravity, (work, factor) = model.arrays.members, np.empty((6, 6)), None, how
    assert work is not None
    if len(work.weight) and work.weight[i, 0] > 0.0:
        gravity = factor * (work.weight[i, 1:] @ ends.frame)
        at = int(members.store_at[i + 1]) - PULL
        work.store[at : at + 3] = gravity
    store = work.store[members.store_at[i] : members.store_at[i + 1]]
    state = motion.inner[members.inner_at[i] : members.inner_at[i + 1]]
    condense_member(
        members.kind[i], members.value[members.value_at[i] :], members.number[i], state, store, work.scratch, work.near[:0],
        ends.d, np.ascontiguousarray(ends.Q), work.lam[i], stiffness,
    )  # fmt: skip
    return gravity, work.lam[i, :6]
