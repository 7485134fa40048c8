"""Whether the curvature modes of strain-mode leaves are enough for a state.

Looked at: the share of the strain energy in the highest mode of every axis, and where the series of the other parity goes; a
Legendre series that has converged has next to nothing there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ksd.model.arrays import STRAIN, State
from ksd.model.compile import Model
from ksd.numerics.kernel import kernel

MIN_ENERGY_SHARE = 1e-6
"""Energy of a leaf, over the largest of any, below which it hardly takes part and does not decide."""


@kernel(inline="always")
def _alone(value, inner, K, state, rest, n, j):
    """Energy of amplitude j of the n about an axis."""
    return 0.5 * value[K + (n + 1) * j] * (inner[state + j] - value[rest + j]) ** 2


@kernel
def _worst(kind, number, value_at, value, inner_at, length, inner):
    """(share, member, axis, turned) of `Look`, of fields of `Members`; share 0 where no leaf has any.

    The layout of the constants is that of `ksd.beam.strain_values`.
    """
    energy, most, turned = np.zeros(len(kind)), 0.0, 0.0
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
        most = max(most, energy[i])
        turned = max(turned, math.sqrt(constant) * length[i] / number[i, 3])
    share, member, about = 0.0, 0, 0
    for i in range(len(kind)):
        if kind[i] != STRAIN or not energy[i] > MIN_ENERGY_SHARE * most:
            continue
        K, state = value_at[i] + 1, inner_at[i]
        rest = K + number[i, 0] ** 2 + number[i, 1] ** 2 + number[i, 2] ** 2
        for axis in range(3):
            n = number[i, axis]
            second, fourth = (n - 2, n - 4) if n >= 4 else (n - 1, n - 1)
            top = _alone(value, inner, K, state, rest, n, n - 1)
            near = _alone(value, inner, K, state, rest, n, second)
            far = _alone(value, inner, K, state, rest, n, fourth)
            # near (near / far) where the series falls, near where it does not; nothing where there is no fourth
            missing = max(top, near * min(near, far) / max(far, 1e-300))
            if missing > share * energy[i]:
                share, member, about = missing / energy[i], i, axis
            K, state, rest = K + n * n, state + n, rest + n
    return share, member, about, turned


class ModeAdequacy(NamedTuple):
    """Largest share of a leaf's bending and torsion energy that its modes may miss about an axis, member name, axis 0, 1, 2.

    Missed is what the highest mode has, or what the series of the other parity, even or odd, would give the next: a guided
    leaf has nothing in every other mode. turned: largest turn of a leaf per quadrature point [rad].
    """

    missed_share: float
    member: str
    axis: int
    turn_per_point: float


def mode_adequacy(model: Model, motion: State) -> ModeAdequacy:
    """What the strain-mode leaves of a state say of their modes and points."""
    if STRAIN not in model.kinds:
        return ModeAdequacy(0.0, "", 0, 0.0)
    m = model.arrays.members
    share, member, axis, turned = _worst(
        m.kind, m.number, m.value_at, m.value, m.inner_at, m.length, motion.inner
    )
    return ModeAdequacy(share, model.member_names[member] if share > 0.0 else "", axis, turned)
