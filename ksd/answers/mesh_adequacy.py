"""Check whether strain-mode leaves have enough curvature modes for a state.

The share of the strain energy in the highest mode about each axis, and the extrapolated series of the other parity, vanish
in a converged Legendre series.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ksd.model.arrays import STRAIN, State
from ksd.model.compile import Model
from ksd.numerics.kernel import kernel

MIN_ENERGY_SHARE = 1e-6
"""Strain energy of a leaf, relative to the largest of all leaves, up to which it is not checked."""


@kernel(inline="always")
def _amplitude_energy(value, inner, K, state, rest, n, j):
    """Strain energy of amplitude j of n about an axis, without coupling to the others."""
    return 0.5 * value[K + (n + 1) * j] * (inner[state + j] - value[rest + j]) ** 2


@kernel
def _worst_leaf(kind, number, value_at, value, inner_at, length, inner):
    """Return (missed_share, member number, axis, turn_per_point) of `ModeAdequacy` from fields of `Members`.

    The share is 0 where no leaf has energy. The layout of the constants is that of `ksd.elements.strain_values`.
    """
    energy, largest, turn = np.zeros(len(kind)), 0.0, 0.0
    for i in range(len(kind)):
        if kind[i] != STRAIN:
            continue
        K, state = value_at[i] + 1, inner_at[i]
        rest = K + number[i, 0] ** 2 + number[i, 1] ** 2 + number[i, 2] ** 2
        constant = 0.0
        for axis in range(3):
            n = number[i, axis]
            constant += inner[state] ** 2
            for j in range(n):
                moment = 0.0
                for k in range(n):
                    moment += value[K + n * j + k] * (inner[state + k] - value[rest + k])
                energy[i] += 0.5 * moment * (inner[state + j] - value[rest + j])
            K, state, rest = K + n * n, state + n, rest + n
        largest = max(largest, energy[i])
        turn = max(turn, math.sqrt(constant) * length[i] / number[i, 3])
    share, member, about = 0.0, 0, 0
    for i in range(len(kind)):
        if kind[i] != STRAIN or not energy[i] > MIN_ENERGY_SHARE * largest:
            continue
        K, state = value_at[i] + 1, inner_at[i]
        rest = K + number[i, 0] ** 2 + number[i, 1] ** 2 + number[i, 2] ** 2
        for axis in range(3):
            n = number[i, axis]
            second, fourth = (n - 2, n - 4) if n >= 4 else (n - 1, n - 1)
            top = _amplitude_energy(value, inner, K, state, rest, n, n - 1)
            next_top = _amplitude_energy(value, inner, K, state, rest, n, second)
            before = _amplitude_energy(value, inner, K, state, rest, n, fourth)
            # the other parity continues with next_top^2 / before where it decreases, else with next_top; zero where n < 4
            missing = max(top, next_top * min(next_top, before) / max(before, 1e-300))
            if missing > share * energy[i]:
                share, member, about = missing / energy[i], i, axis
            K, state, rest = K + n * n, state + n, rest + n
    return share, member, about, turn


class ModeAdequacy(NamedTuple):
    """Largest share of the bending and torsion energy of a leaf that its modes may miss about an axis.

    The missed energy is estimated by that of the highest mode, or by extrapolation of the series of the other parity (even
    or odd) to the next mode, as every other mode of a guided leaf is zero. member: name of the leaf; axis: 0, 1 or 2;
    turn_per_point: largest rotation of a leaf per quadrature point [rad].
    """

    missed_share: float
    member: str
    axis: int
    turn_per_point: float


def mode_adequacy(model: Model, motion: State) -> ModeAdequacy:
    """Adequacy of the modes and quadrature points of the strain-mode leaves of a state."""
    if not model.strain_leaves:
        return ModeAdequacy(0.0, "", 0, 0.0)
    m = model.arrays.members
    share, member, axis, turn = _worst_leaf(
        m.kind, m.number, m.value_at, m.value, m.inner_at, m.length, motion.inner
    )
    return ModeAdequacy(share, model.member_names[member] if share > 0.0 else "", axis, turn)
