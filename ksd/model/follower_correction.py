"""Correction of the Newton step for loads that are not conservative: the skew part of their tangent, of low rank.

A follower load, and in space a moment of fixed direction, has the tangent K + E B E'. K is symmetric, as assembled and
factored; E selects the unknowns of the loaded nodes; B is skew, one (w, w) block per load, w = 6 in space and 3 in the
plane, and is left out by `ksd.model.loading`. For a follower load B has [F]x / 2 in force rows and rotation columns and in
rotation rows and force columns, and [M]x / 2 in the rotation block, with M about the node. For a moment M fixed in space B
has -[M]x / 2 in the rotation block. (For all conservative parts the assembly has the second derivatives of the energy along
exp(phi) R. The moment that balances M changes with phi by these minus [M]x / 2; Argyris et al., Comp. Meth. Appl. Mech. Eng.
14, 1978, and 17/18, 1979.) A leaf under pressure couples its two nodes by a skew tangent (12, 12) of its own
(`ksd.elements.leaf_loads`).

By Sherman, Morrison and Woodbury x = y - X (1 + B E'X)^-1 B E'y with y = K^-1 r and X = K^-1 E. This takes w more solves per
load or loaded end, and Newton converges quadratically.
"""

from __future__ import annotations

import numpy as np

from ksd.elements.pressure import GIVEN_MODES, skew_at
from ksd.model.arrays import (
    AT,
    DOFS_PER_NODE,
    LEAF_COUNT,
    LOAD,
    LOADS,
    MEMBER,
    PLANAR,
    SETTINGS,
    STRAIN,
)
from ksd.numerics.blocks import solve_blocks
from ksd.numerics.elimination import solve_small
from ksd.numerics.kernel import kernel


@kernel
def _skew_tangent(ints, floats, i, R, factor, B):
    """Skew tangent B (6, 6) of load i, see the module docstring."""
    node = ints[ints[LOAD.node] + i]
    point, force, moment = ints[LOAD.point] + 3 * i, ints[LOAD.force] + 3 * i, ints[LOAD.moment] + 3 * i
    F, M, s = np.zeros(3), np.zeros(3), np.zeros(3)
    for r in range(3):
        if ints[ints[LOAD.following] + i] == 1:
            for c in range(3):
                F[r] += 0.5 * factor * R[node, r, c] * floats[force + c]
                M[r] += 0.5 * factor * R[node, r, c] * floats[moment + c]
                s[r] += R[node, r, c] * floats[point + c]
        else:
            M[r] = -0.5 * factor * floats[moment + r]
    B[:, :] = 0.0
    for r in range(3):
        j, k = (r + 1) % 3, (r + 2) % 3
        f, m = F[r], M[r] + s[j] * F[k] - s[k] * F[j]
        B[j, 3 + k], B[k, 3 + j] = -f, f
        B[3 + j, k], B[3 + k, j] = -f, f
        B[3 + j, 3 + k], B[3 + k, 3 + j] = -m, m


@kernel
def correct_newton_step(ints, floats, plan, R, matrix, spare, rhs, factor, store):
    """Correct the Newton step in rhs (n,), in place, for the skew tangents of loads; `matrix` is factored.

    store: stored numbers of all members, those under pressure with their skew tangents.
    """
    n, active, width = len(rhs), ints[AT.active_dofs], ints[DOFS_PER_NODE]
    # nodes that can move of what has a skew tangent: its number, the row of B of the node, and its first unknown
    most = ints[LOADS] + 2 * ints[LEAF_COUNT]
    on, end, start, count = np.empty(most, np.int64), np.empty(most, np.int64), np.empty(most, np.int64), 0
    for i in range(ints[LOADS]):
        u = ints[ints[AT.start] + ints[ints[LOAD.node] + i]]
        if ints[ints[LOAD.skew] + i] == 1 and u >= 0:
            on[count], end[count], start[count] = i, 0, u
            count += 1
    loads = count
    for i in range(ints[LEAF_COUNT] if is_static(ints, floats) else 0):
        if is_under_pressure(ints, i):
            for e in range(2):
                u = ints[ints[AT.start] + ints[ints[MEMBER.node] + 2 * i + e]]
                if u >= 0:
                    on[count], end[count], start[count] = i, e, u
                    count += 1
    k = width * count
    if k == 0:
        return
    X, B, G, z = np.empty((k, n)), np.empty((6, 6)), np.empty((k, k)), np.empty((k, 1))
    # X: K^-1 for every unknown of the loaded nodes
    for row in range(k):
        X[row, :] = 0.0
        X[row, start[row // width] + row % width] = 1.0
        solve_blocks(plan, matrix, spare, X[row])
    # G = 1 + B E'X, z = B E'y
    for row in range(k):
        z[row, 0] = 0.0
        for q in range(k):
            G[row, q] = 1.0 if row == q else 0.0
    for own in range(count):
        for other in range(count):
            if on[own] != on[other] or (own < loads) != (other < loads):
                continue
            if own < loads:
                _skew_tangent(ints, floats, on[own], R, factor, B)
            else:
                at = ints[ints[MEMBER.store_at] + on[own] + 1]
                at = skew_at(store[:at], ints[ints[MEMBER.number] + SETTINGS * on[own] + 5])
                for r in range(6):
                    for c in range(6):
                        B[r, c] = store[at + 12 * (6 * end[own] + r) + 6 * end[other] + c]
            u = start[other]
            for r in range(width):
                row = width * own + r
                for c in range(width):
                    b = B[ints[active + r], ints[active + c]]
                    z[row, 0] += b * rhs[u + c]
                    for q in range(k):
                        G[row, q] += b * X[q, u + c]
    solve_small(G, z)
    for q in range(k):
        for c in range(n):
            rhs[c] -= z[q, 0] * X[q, c]


@kernel(inline="always")
def is_static(ints, floats):
    """Whether this is no time step, in which the load modes of leaves are those of inertia."""
    return floats[ints[AT.rates]] == 0.0


@kernel(inline="always")
def is_under_pressure(ints, i):
    """Whether member i is a leaf under pressure, in statics."""
    kind = ints[ints[MEMBER.kind] + i]
    return kind in (STRAIN, PLANAR) and ints[ints[MEMBER.number] + SETTINGS * i + 5] > GIVEN_MODES
