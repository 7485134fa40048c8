"""Whether the curvature modes of strain-mode leaves are enough for a state.

Looked at: the share of the strain energy in the highest mode of every axis, and where the series of the other parity goes; a
Legendre series that has converged has next to nothing there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ksd.model.arrays import STRAIN, Motion
from ksd.model.compile import Model
from ksd.numerics.kernel import kernel
from ksd.properties.kept import per_model

IDLE = 1e-6
"""Energy of a leaf, over the largest of any, below which it hardly takes part and does not decide."""
ROUNDING = 1e-13
"""Entry of a stiffness matrix, over the diagonal ones beside it, that is a zero with rounding."""
Array = NDArray[np.float64]


class _Tables(NamedTuple):
    """Strain-mode leaves, flat: member (m,) of each; place, rest (n,) of all amplitudes in the inner state, and their
    values at rest; one, two, stiff (p,): pairs of amplitudes about one axis with their entry of K where it is not zero,
    those of leaf i from start[i] to start[i + 1]; own (n,): diagonal of K; last, second, fourth (m, 3): amplitudes from the
    highest mode of an axis down, the highest itself where an axis has fewer than four; constant (m, 3): the lowest; gap
    (m,): length per quadrature point."""

    member: NDArray[np.int64]
    place: NDArray[np.int64]
    rest: Array
    one: NDArray[np.int64]
    two: NDArray[np.int64]
    stiff: Array
    start: NDArray[np.int64]
    own: Array
    last: NDArray[np.int64]
    second: NDArray[np.int64]
    fourth: NDArray[np.int64]
    constant: NDArray[np.int64]
    gap: Array


@per_model
def _tables(model: Model) -> _Tables:
    """See `_Tables`; the layout of the values is that of `ksd.beam.strain_values`."""
    members = model.arrays.members
    strain = np.flatnonzero(members.kind == STRAIN)
    key = np.concatenate([members.value_at[:, None], members.number], axis=1)[strain]
    different, which = np.unique(key, axis=0, return_inverse=True)
    which = which.ravel()
    groups = [_group(members.value[at:], orders) for at, *orders, _ in different.tolist()]
    sizes = np.array([(len(g.own), len(g.stiff)) for g in groups], np.int64).reshape(-1, 2)[which]
    (count, first), (pairs, start) = ((int(n.sum()), np.cumsum(n) - n) for n in sizes.T)
    place, ends = np.zeros(count, np.int64), np.zeros((len(strain), 4, 3), np.int64)
    rest, own, stiff = np.zeros(count), np.zeros(count), np.zeros(pairs)
    one, two = np.zeros(pairs, np.int64), np.zeros(pairs, np.int64)
    for k, g in enumerate(groups):
        mine = np.flatnonzero(which == k)
        amplitude = first[mine, None] + np.arange(len(g.own))
        pair = start[mine, None] + np.arange(len(g.stiff))
        place[amplitude] = members.inner_at[strain[mine], None] + np.arange(len(g.own))
        rest[amplitude], own[amplitude], stiff[pair] = g.rest, g.own, g.stiff
        one[pair], two[pair] = first[mine, None] + g.one, first[mine, None] + g.two
        ends[mine] = first[mine, None, None] + g.ends
    last, second, fourth, lowest = (np.ascontiguousarray(ends[:, e]) for e in range(4))
    return _Tables(
        strain, place, rest, one, two, stiff, np.append(start, pairs), own, last, second, fourth, lowest,
        members.length[strain] / members.number[strain, 3],
    )  # fmt: skip


class _Group(NamedTuple):
    """Leaves of one set of constants: rest (N,) amplitudes, half the diagonal `own` (N,) of K, its pairs one, two (p,) with
    half their entry; ends (4, 3): highest amplitude, second, fourth from above, lowest of every axis."""

    rest: Array
    own: Array
    one: NDArray[np.int64]
    two: NDArray[np.int64]
    stiff: Array
    ends: NDArray[np.int64]


def _group(value: Array, orders: list[int]) -> _Group:
    """Of constants as `ksd.beam.strain_values` lays them out."""
    at, first = 1, 0
    one, two, stiff, own = [], [], [], []
    ends = np.zeros((4, 3), np.int64)
    for axis, n in enumerate(orders):
        K = value[at : at + n * n].reshape(n, n)
        scale = np.sqrt(np.abs(np.diagonal(K)))
        rows, columns = np.nonzero(np.abs(K) > ROUNDING * scale[:, None] * scale)
        one.append(first + rows)
        two.append(first + columns)
        stiff.append(0.5 * K[rows, columns])
        own.append(0.5 * np.diagonal(K))
        down = (n - 1, n - 2, n - 4, 0) if n >= 4 else (n - 1, n - 1, n - 1, 0)
        ends[:, axis] = first + np.array(down)
        at, first = at + n * n, first + n
    return _Group(
        value[at : at + first], np.concatenate(own), np.concatenate(one), np.concatenate(two),
        np.concatenate(stiff), ends,
    )  # fmt: skip


@kernel
def _energy(t, inner, i):
    """Energy of leaf i."""
    total = 0.0
    for p in range(t.start[i], t.start[i + 1]):
        x, y = t.one[p], t.two[p]
        total += t.stiff[p] * (inner[t.place[x]] - t.rest[x]) * (inner[t.place[y]] - t.rest[y])
    return total


@kernel
def _worst(t, inner):
    """(share, leaf, axis, turned) of `Look`; share 0 where no leaf has any."""
    leaves, most, turned = len(t.member), 0.0, 0.0
    for i in range(leaves):
        most = max(most, _energy(t, inner, i))
        bend = 0.0
        for axis in range(3):
            bend += inner[t.place[t.constant[i, axis]]] ** 2
        turned = max(turned, math.sqrt(bend) * t.gap[i])
    share, leaf, about = 0.0, 0, 0
    for i in range(leaves):
        total = _energy(t, inner, i)
        if not total > IDLE * most:
            continue
        for axis in range(3):
            x, y, z = t.last[i, axis], t.second[i, axis], t.fourth[i, axis]
            top = t.own[x] * (inner[t.place[x]] - t.rest[x]) ** 2
            near = t.own[y] * (inner[t.place[y]] - t.rest[y]) ** 2
            far = t.own[z] * (inner[t.place[z]] - t.rest[z]) ** 2
            # near (near / far) where the series falls, near where it does not; nothing where there is no fourth
            missing = max(top, near * min(near, far) / max(far, 1e-300))
            if missing > share * total:
                share, leaf, about = missing / total, i, axis
    return share, leaf, about, turned


class Look(NamedTuple):
    """Largest share of a leaf's bending and torsion energy that its modes may miss about an axis, member name, axis 0, 1, 2.

    Missed is what the highest mode has, or what the series of the other parity, even or odd, would give the next: a guided
    leaf has nothing in every other mode. turned: largest turn of a leaf per quadrature point [rad].
    """

    share: float
    member: str
    axis: int
    turned: float


_NOTHING = Look(0.0, "", 0, 0.0)


def look_at_modes(model: Model, motion: Motion) -> Look:
    """What the strain-mode leaves of a state say of their modes and points."""
    tables = _tables(model)
    members = tables.member
    if not len(members):
        return _NOTHING
    share, leaf, axis, turned = _worst(tables, motion.inner)
    return Look(share, model.member_names[members[leaf]] if share > 0.0 else "", axis, turned)
