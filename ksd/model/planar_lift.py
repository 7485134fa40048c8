"""A planar state set in space, and a spatial one seen in its plane.

A member whose e3 is -k sees the plane from behind: its y coordinates, angles and moments change sign. The inner
states are linear copies of each other, number by number, but for the rotations of chain nodes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ksd.beam.corotational_values import NODE
from ksd.model.arrays import STRAIN, Members
from ksd.numerics.kernel import kernel


class Lifting(NamedTuple):
    """How a planar state stands in space.

    axes (3, 3): columns i, j, k; height (k,): coordinate of every node along k [m]. Spatial inner[to] = factor *
    planar inner[of], all (n,); chain node rotations (r,): matrix from turn_to on, angle sense * inner[turn_of]. row
    (c,): the constraint rows that act in the plane; the others are met by staying in it.
    """

    axes: np.ndarray
    height: np.ndarray
    to: np.ndarray
    of: np.ndarray
    factor: np.ndarray
    turn_to: np.ndarray
    turn_of: np.ndarray
    sense: np.ndarray
    row: np.ndarray


def inner_copies(
    members: Members, flat: Members, twin: np.ndarray, sense: np.ndarray
) -> tuple[np.ndarray, ...]:
    """(to, of, factor, turn_to, turn_of, sense) of `Lifting`.

    For every spatial member: twin (m,), the planar member that stands for it; sense (m,), 1 when its e3 is k and -1
    when it is -k. Forces are shared equally among the members one planar member stands for.
    """
    share = 1.0 / np.bincount(twin)[twin]
    copies: list[tuple[int, int, float]] = []
    turns: list[tuple[int, int, float]] = []
    for i, (p, s) in enumerate(zip(twin, sense, strict=True)):
        to, of, count = int(members.inner_at[i]), int(flat.inner_at[p]), int(flat.number[p, 0])
        if members.kind[i] == STRAIN:
            to += int(members.number[i, 0] + members.number[i, 1])
            copies += [(to + k, of + k, s) for k in range(count)]
            # force and moment on end q: n_x, n_y, m_z of six
            force = zip((0, 1, 5), (1.0, s, s), strict=True)
            copies += [(to + count + k, of + count + n, f * share[i]) for n, (k, f) in enumerate(force)]
            continue
        for k in range(count - 1):
            copies += [(to + NODE * k, of + 3 * k, 1.0), (to + NODE * k + 1, of + 3 * k + 1, s)]
            turns.append((to + NODE * k + 3, of + 3 * k + 2, s))
        to, of = to + NODE * (count - 1), of + 3 * (count - 1)
        # elongation and both bending strains among the six of Appendix A
        for n, (k, f) in enumerate(zip((0, 4, 5), (1.0, s, s), strict=True)):
            copies += [(to + 6 * e + k, of + 3 * e + n, f * share[i]) for e in range(count)]
    found: list[np.ndarray] = []
    for table in (copies, turns):
        columns = np.array(table, float).reshape(-1, 3).T
        found += [columns[0].astype(np.int64), columns[1].astype(np.int64), columns[2].copy()]
    return tuple(found)


@kernel
def lift_nodes(axes, height, pose, x, R):
    """Write positions x (k, 3) and rotations R (k, 3, 3) of the planar poses (k, 3)."""
    for k in range(len(pose)):
        px, py, c, s = pose[k, 0], pose[k, 1], math.cos(pose[k, 2]), math.sin(pose[k, 2])
        for r in range(3):
            i, j, n = axes[r, 0], axes[r, 1], axes[r, 2]
            x[k, r] = i * px + j * py + n * height[k]
            for q in range(3):
                u, v = axes[q, 0], axes[q, 1]
                R[k, r, q] = c * (i * u + j * v) + s * (j * u - i * v) + n * axes[q, 2]


@kernel
def spatial_shift(axes, x, y):
    """Largest component in space of a displacement (x, y) in the plane `axes` (3, 3)."""
    found = 0.0
    for r in range(3):
        found = max(found, abs(axes[r, 0] * x + axes[r, 1] * y))
    return found


@kernel
def lift_inner(to, of, factor, turn_to, turn_of, sense, flat, inner):
    """Write the spatial inner states from the planar ones `flat`; out of the plane everything is zero."""
    inner[:] = 0.0
    for i in range(len(to)):
        inner[to[i]] = factor[i] * flat[of[i]]
    for i in range(len(turn_to)):
        turn, at = sense[i] * flat[turn_of[i]], turn_to[i]
        c, s = math.cos(turn), math.sin(turn)
        inner[at], inner[at + 1], inner[at + 3], inner[at + 4], inner[at + 8] = c, -s, s, c, 1.0
