"""Whether the curvature modes of strain-mode leaves are enough for a state.

Looked at: the share of the strain energy in the highest mode of every axis, and where the series of the other parity goes; a
Legendre series that has converged has next to nothing there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ksd.model.arrays import STRAIN, Members, Motion
from ksd.model.compile import Model

IDLE = 1e-6
"""Energy of a leaf, over the largest of any, below which it hardly takes part and does not decide."""


def _worst(m: Members, inner: np.ndarray) -> tuple[float, int, int, float]:
    """(share, member, axis, turned) of `Look`; share 0 where no leaf has any.

    Leaves of the same numbers of modes at once. The layout of the constants is that of `ksd.beam.strain_values`.
    """
    count = len(m.kind)
    energy, missing, turned = np.zeros(count), np.zeros((count, 3)), 0.0
    strain = m.kind == STRAIN
    for number in np.unique(m.number[strain], axis=0):
        leaves = np.flatnonzero(strain & (m.number == number).all(axis=1))
        K, state = m.value_at[leaves, None] + 1, m.inner_at[leaves, None]
        rest, constant = K + (number[:3] ** 2).sum(), 0.0
        for axis, n in enumerate(number[:3].tolist()):
            amplitudes = inner[state + np.arange(n)]
            change = amplitudes - m.value[rest + np.arange(n)]
            stiffness = m.value[K + np.arange(n * n)].reshape(-1, n, n)
            energy[leaves] += 0.5 * np.einsum("li,lij,lj->l", change, stiffness, change)
            constant += amplitudes[:, 0] ** 2
            # energy of every amplitude alone: the highest, the one below, and the next one of its parity
            alone = 0.5 * stiffness.diagonal(axis1=1, axis2=2) * change**2
            top, near, far = alone[:, [n - 1, *((n - 2, n - 4) if n >= 4 else (n - 1, n - 1))]].T
            # near (near / far) where the series falls, near where it does not; nothing where there is no fourth
            missing[leaves, axis] = np.maximum(top, near * np.minimum(near, far) / np.maximum(far, 1e-300))
            K, state, rest = K + n * n, state + n, rest + n
        turned = max(turned, float((np.sqrt(constant) * m.length[leaves]).max() / number[3]))
    active = strain & (energy > IDLE * energy.max(initial=0.0))
    if not active.any():
        return 0.0, 0, 0, turned
    share = np.where(active[:, None], missing, 0.0) / np.where(active, energy, 1.0)[:, None]
    member, axis = divmod(int(share.argmax()), 3)
    return float(share[member, axis]), member, axis, turned


class Look(NamedTuple):
    """Largest share of a leaf's bending and torsion energy that its modes may miss about an axis, member name, axis 0, 1, 2.

    Missed is what the highest mode has, or what the series of the other parity, even or odd, would give the next: a guided
    leaf has nothing in every other mode. turned: largest turn of a leaf per quadrature point [rad].
    """

    share: float
    member: str
    axis: int
    turned: float


def look_at_modes(model: Model, motion: Motion) -> Look:
    """What the strain-mode leaves of a state say of their modes and points."""
    if STRAIN not in model.kinds:
        return Look(0.0, "", 0, 0.0)
    share, member, axis, turned = _worst(model.arrays.members, motion.inner)
    return Look(share, model.member_names[member] if share > 0.0 else "", axis, turned)
