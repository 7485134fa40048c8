"""State and storage of a mechanism in its plane: three unknowns per node instead of six.

The arrays are those of `ksd.model.arrays`, two-dimensional: offset (m, 2, 2), frame (m, 2) angle of e1 at both
ends, direction (t, 2) of a translation (for a rotation its sense about k and 0), point (.., 2), force (l, 2),
moment (l,), weight (m, 3). Springs: value of LINEAR (which also stands for TURN) is end0 (3), F (3), K (9). The plane
has axes i, j and normal k; angles are about k. Lengths m, angles rad, forces N, Nm.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ksd.model.arrays import COROTATIONAL, STRAIN, Arrays, Work, turning_room
from ksd.numerics.kernel import compile_late

PLANAR_WEIGHT_ENTRIES = ("pull_planar", "weigh_planar", "turn_planar_pull")
"""Kernels of `ksd.beam.planar_weight_entry` that are compiled only where a model has members with weight."""


class PlanarMotion(NamedTuple):
    """Where a mechanism is: poses (k, 3) = x, y [m], angle [rad]; inner states (flat), multipliers (c,)."""

    pose: np.ndarray
    inner: np.ndarray
    multiplier: np.ndarray

    def copy(self) -> PlanarMotion:
        """An independent copy."""
        return PlanarMotion(*(a.copy() for a in self))

    def assign(self, other: PlanarMotion) -> None:
        """Take over the numbers of `other`, in place."""
        for mine, theirs in zip(self, other, strict=True):
            mine[...] = theirs


def make_planar_work(arrays: Arrays, *, near: np.ndarray | None = None) -> Work:
    """Storage for one thread working on planar `arrays`, as `Work`.

    lam (m, 6): end wrench, then the one the geometric terms use; pose (m, 6): cos, sin of frame p, lever of end q
    about node p, lever about node q; near (2k + ..,): cos, sin of every node, then, in the joint bench, the element
    and node angles of the near configuration, `near` (m,) per member, from near_at (m+1,) on. Compiles the kernels of
    the kinds of members there are.
    """
    from ksd.beam import planar_entry, planar_weight_entry  # noqa: F401, declares the entry points
    from ksd.model import planar_system, turning  # noqa: F401, as above

    members = arrays.members
    kinds = set(members.kind.tolist())
    if STRAIN in kinds:
        default = np.all(members.number[:, :2] == planar_entry.DEFAULT, axis=1)
        default &= np.diff(members.store_at) == planar_entry.LENGTHS[1]
        names = ("planar_strain_condense", "planar_strain_condense_default")
        compile_late(
            "planar_strain_recover", *(names[d] for d in set(default[members.kind == STRAIN].tolist()))
        )
    if COROTATIONAL in kinds:
        compile_late("planar_chain_condense", "planar_chain_recover")
        if near is not None:
            compile_late("planar_chain_near")
    if len(arrays.weight):
        compile_late(*PLANAR_WEIGHT_ENTRIES)
    room = turning_room(arrays, 3)
    if room:
        compile_late("turn_flat_step")
    count = len(members.kind) + len(arrays.springs.kind)
    if count:
        compile_late("assemble_planar_apart")
    at = np.full(len(members.kind) + 1, 2 * len(arrays.start))
    if near is not None:
        at[1:] += np.cumsum(near)
    return Work(
        np.zeros(arrays.plan.values),
        np.zeros(arrays.plan.values),
        np.zeros(arrays.plan.unknowns),
        np.zeros(int(members.store_at[-1])),
        np.zeros((count, 6)),
        np.zeros((count, 6)),
        np.zeros((len(arrays.start), 2)),
        np.zeros(int(at[-1])),
        at,
        np.zeros(room),
        arrays.weight.copy(),
    )
