"""Section forces of every leaf: N, Vy, Vz [N], T, My, Mz [Nm] along the leaf.

Positive on the section whose outward normal points along the leaf, in the axes of the deformed section. In
a strain-mode leaf they follow from its end wrench (n, m) by equilibrium, n and m + (r(L) - r(s)) x n turned
into the section: the curvature series times the rigidity is their best approximation in the mean, but has
its largest error at the ends, where the stress is largest (7e-4 of the moment in a cross flexure turned by
45 degrees). In a chain they are those of the elements (paper 1, Appendix A), turned from the chord of the
element into the section at its end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ksd.model.arrays import STRAIN, Motion
from ksd.model.compile import Model
from ksd.properties.shape import chain_nodes, member_ends, member_parts, members_of_leafs, strain_curve

Array = NDArray[np.float64]
COMPONENTS = ("N", "Vy", "Vz", "T", "My", "Mz")
"""Columns of `SectionForces.values`; the first three in N, the others in Nm."""
POINTS = 25


@dataclass(frozen=True)
class SectionForces:
    """Section forces of one leaf: stations s (k,) [m] from its start, values (k, 6), columns COMPONENTS.

    Every element of a chain has two stations, its ends, so inner nodes appear twice.
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
    found = {}
    for name, members in members_of_leafs(model).items():
        at, stations, values = 0.0, [], []
        for i in members:
            s, forces = _member_forces(model, motion, i, points)
            stations.append(at + s)
            values.append(forces)
            at += s[-1]
        found[name] = SectionForces(name, np.concatenate(stations), np.concatenate(values))
    return found


def _member_forces(model: Model, motion: Motion, i: int, points: int) -> tuple[Array, Array]:
    """Stations (k,) and section forces (k, 6) of member `i`."""
    value, number, inner = member_parts(model, motion, i)
    ends = member_ends(model, motion, i)
    if model.arrays.members.kind[i] == STRAIN:
        r, R = strain_curve(value, number, inner, points)
        total = int(number[:3].sum())
        n, m = inner[total : total + 3], inner[total + 3 : total + 6]
        moment = m + np.cross(r[-1] - r, n)
        values = np.hstack([np.einsum("kij,i->kj", R, n), np.einsum("kij,ki->kj", R, moment)])
        return np.linspace(0.0, float(value[0]), points), values
    from ksd.beam import corotational

    count = int(number[0])
    out = np.empty((count, 2, 6))
    corotational.section_forces(
        value, number, np.ascontiguousarray(inner), ends.d, np.ascontiguousarray(ends.Q), out
    )
    records = value[: 16 * count].reshape(count, 16)
    _into_sections(out, records[:, 7:].reshape(count, 3, 3), *chain_nodes(value, number, inner, ends))
    lengths = records[:, 0]
    at = np.concatenate([[0.0], np.cumsum(lengths)])
    return np.stack([at[:-1], at[1:]], axis=1).ravel(), out.reshape(-1, 6)


def _into_sections(out: Array, undeformed: Array, x: Array, R: Array) -> None:
    """Turn section forces (n, 2, 6) in place: from the axes at the chord to those of the section there."""
    for k, T in enumerate(undeformed):
        chord = (x[k + 1] - x[k]) / np.linalg.norm(x[k + 1] - x[k])
        for end in range(2):
            section = R[k + end] @ T
            y = section[:, 1] - (section[:, 1] @ chord) * chord
            y /= np.linalg.norm(y)
            turn = section.T @ np.column_stack([chord, y, np.cross(chord, y)])
            out[k, end, :3] = turn @ out[k, end, :3]
            out[k, end, 3:] = turn @ out[k, end, 3:]
