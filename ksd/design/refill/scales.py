"""How the constants of straight uniform leafs depend on length and section: a unit table times a few scales.

Every constant of a leaf is a fixed number times one of KINDS scales of that leaf; the fixed numbers are read off one leaf
that was made the usual way.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from ksd.beam.corotational_values import NODE, stiffness_numbers
from ksd.beam.corotational_values import RECORD as SPACE
from ksd.model.arrays import LINEAR, STRAIN, Members
from ksd.model.mesh import Mesh

ONE, LENGTH = 0, 1
KINDS = 12
"""Strain-mode leaf: 1, L, L GJ, L EIy, L EIz, EIz, 1/EA, 1/(ky GA), 1/(kz GA), 1/L, EIz/L^2, EIz/L. Chain: 1, length and the
six stiffness numbers of an element; the last three as before."""
SOFT = (6, 7, 8)
INVERSE, FORCE, MOMENT = 9, 10, 11


def scales(leaf: np.ndarray, mesh: Mesh, counts: np.ndarray) -> np.ndarray:
    """(D, F, KINDS) of leafs (D, F, LEAF); counts (F,): elements of chains."""
    L, E, G, A, J, Iy, Iz, ky, kz = np.moveaxis(leaf[:, :, 9:], 2, 0)
    bend = E * Iz
    last = [1.0 / L, bend / L**2, bend / L]
    if mesh.leaf == "strain":
        shear = [1.0 / (ky * G * A), 1.0 / (kz * G * A)]
        soft = [1.0 / (E * A), *(s if mesh.shear else 0.0 * s for s in shear)]
        first = [np.ones_like(L), L, L * (G * J), L * (E * Iy), L * bend, bend, *soft]
    else:
        free = 1.0 if mesh.shear else np.inf
        section = SimpleNamespace(E=E, G=G, A=A, J=J, Iy=Iy, Iz=Iz, ky=free * ky, kz=free * kz)
        first = [np.ones_like(L), L / counts, *stiffness_numbers(section, L / counts), 0.0 * L]
    return np.stack([*first, *last], axis=2)


def floors(leaf: np.ndarray) -> np.ndarray:
    """(D, F): EA/L [N/m], as `ksd.model.leafs.leaf_member` has it."""
    L, E, A = leaf[:, :, 9], leaf[:, :, 10], leaf[:, :, 12]
    return 1.0 / (1.0 / (E * A) * L)


@dataclass(frozen=True)
class Table:
    """A flat array of constants: unit (V,) times scale kind (V,) of leaf (V,)."""

    unit: np.ndarray
    leaf: np.ndarray
    kind: np.ndarray

    def __call__(self, scale: np.ndarray) -> np.ndarray:
        """(D, V) for scales (D, F, KINDS)."""
        return np.ascontiguousarray(self.unit * scale[:, self.leaf, self.kind])


def _space_kinds(value: np.ndarray, number: np.ndarray, kind: int) -> np.ndarray:
    """Which scale every constant of a spatial member goes with."""
    if kind != STRAIN:
        count = int(number[0])
        return np.array((([LENGTH, 2, 3, 4, 5, 6, 7] + [ONE] * (SPACE - 7)) * count + [ONE] * 9), np.int64)
    nx, ny, nz, ng = (int(n) for n in number)
    N = nx + ny + nz
    before = N + ng + ng * ng + N * ng
    parts = [LENGTH] + [2] * nx * nx + [3] * ny * ny + [4] * nz * nz + [ONE] * before + [*SOFT] * ng
    return np.array(parts + [ONE] * (len(value) - len(parts)), np.int64)


def value_table(members: Members, leafs: np.ndarray, scale: np.ndarray) -> Table:
    """The constants of packed `members`; leafs (m,): leaf of each, scale (F, KINDS): of the leafs they were made of."""
    unit, leaf = members.value.copy(), np.zeros(len(members.value), np.int64)
    kinds = np.zeros(len(members.value), np.int64)
    ends = np.append(np.unique(members.value_at), len(unit) - 1)
    for i, at in enumerate(members.value_at):
        if members.kind[i] == LINEAR:
            continue
        end = int(ends[np.searchsorted(ends, at) + 1])
        own, number = members.value[at:end], members.number[i]
        kinds[at:end] = _space_kinds(own, number, members.kind[i])
        leaf[at:end] = leafs[i]
        over = scale[leafs[i], kinds[at:end]]
        soft = np.isin(kinds[at:end], SOFT) & (members.kind[i] == STRAIN)
        unit[at:end] = np.divide(own, over, out=np.ones(len(own)), where=~soft)
    return Table(unit, leaf, kinds)


def inner_table(members: Members, leafs: np.ndarray, inner: np.ndarray, scale: np.ndarray) -> Table:
    """Inner states at rest: nodes of chains lie along their leaf, all else is fixed."""
    unit, leaf = inner.copy(), np.zeros(len(inner), np.int64)
    kinds = np.zeros(len(inner), np.int64)
    for i in range(len(members.kind)):
        if members.kind[i] in (STRAIN, LINEAR):
            continue
        at = members.inner_at[i] + NODE * np.arange(int(members.number[i, 0]) - 1)
        kinds[at], leaf[at] = LENGTH, leafs[i]
        unit[at] = inner[at] / scale[leafs[i], LENGTH]
    return Table(unit, leaf, kinds)


def element_counts(leafs: list[Any], mesh: Mesh) -> np.ndarray:
    """(F,): elements of every leaf as a chain."""
    return np.array([float(leaf.elements or mesh.elements) for leaf in leafs])
