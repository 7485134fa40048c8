"""Distributed loads of a member on its two nodes, with their tangent; compiled for models that have any.

The distributed loads of a member are D = 3 components f of load modes in frame p (`ksd.elements.weight`): the weight, mode
0; of a leaf with line loads two more, a force per length at its start and the change of it to its end; and of a leaf under
pressure PRESSURE_MODES more (`ksd.elements.pressure`). Mode k is the force c_k f_k in all. Dead ones are given in global
axes, so in frame p they turn against it; those of pressure follow from the shape of the leaf, df = b + H u. The rows
(`loads`) of a member are mass, gravity (3) [m/s^2], line load at its start and its change (3 each) [N/m], and pressure [Pa].

With the potential V(xi, f), u the motions of both nodes, xi = J u that of end q relative to end p, and P_k = c_k o + s_k
the first moment of mode k about node a (o: lever from the node to end p, s = -V_f), the following is added to the terms of
every member:

residual of node a: the force -sum c_k f_k and the moment -sum P_k x f_k; tangent: the derivatives of these, with
ds = -V_f,xi xi - V_f,f df, J^T V_xi,f df/du, and half of the cross product matrix of that moment (the second derivative of
an energy along exp(phi) R; `ksd.model.follower_correction`). Under pressure it is not symmetric: its symmetric part is
added, its skew part is kept in the store, for the correction of the step.
"""

from __future__ import annotations

import numpy as np

from ksd.elements.inertia import inertia_places
from ksd.elements.pressure import GIVEN_MODES, skew_at
from ksd.numerics.kernel import kernel


@kernel
def set_member_loads(number, is_planar, pose, loads, factor, state, store):
    """Write the load modes into the gravity block of a member, in its frame p: the given `loads` (11,) times `factor`, and
    those of pressure from its inner state."""
    modes = max(number[5], 1)
    D = 3 * modes
    o = len(store) - D * (10 + D)
    for k in range(min(modes, GIVEN_MODES)):
        x, y, z = factor * loads[1 + 3 * k], factor * loads[2 + 3 * k], factor * loads[3 + 3 * k]
        for r in range(3):
            store[o + 3 * k + r] = pose[r] * x + pose[3 + r] * y + pose[6 + r] * z
    if modes > GIVEN_MODES:
        wrench, _ = inertia_places(number, is_planar)
        for e in range(3 * GIVEN_MODES, D):
            store[o + e] = state[wrench + 6 + e - 3 * GIVEN_MODES]
        at = skew_at(store, modes)
        store[at - 2], store[at - 1] = factor, loads[10]


@kernel
def move_member_loads(number, is_planar, pose, move, xi, state, scale, store):
    """Write the change of the load modes in frame p into the gravity block, for `recover`, when the nodes move by move (12,)
    and end q by xi (6,) relative to end p; the modes of pressure in the inner state take `scale` times theirs."""
    modes = max(number[5], 1)
    D = 3 * modes
    o = len(store) - D * (10 + D)
    change = o + 9 * D + D * D
    x = pose[0] * move[3] + pose[3] * move[4] + pose[6] * move[5]
    y = pose[1] * move[3] + pose[4] * move[4] + pose[7] * move[5]
    z = pose[2] * move[3] + pose[5] * move[4] + pose[8] * move[5]
    for k in range(min(modes, GIVEN_MODES)):
        f0, f1, f2, at = store[o + 3 * k], store[o + 3 * k + 1], store[o + 3 * k + 2], change + 3 * k
        store[at], store[at + 1], store[at + 2] = f1 * z - f2 * y, f2 * x - f0 * z, f0 * y - f1 * x
    if modes > GIVEN_MODES:
        wrench, _ = inertia_places(number, is_planar)
        given, rows = 3 * GIVEN_MODES, skew_at(store, modes) + 144
        for e in range(D - given):
            row = rows + (8 + given) * e
            s = store[row]
            for r in range(6):
                s += store[row + 2 + r] * xi[r]
            for r in range(given):
                s += store[row + 8 + r] * store[change + r]
            store[change + given + e] = s
            state[wrench + 6 + e] += scale * s


@kernel
def add_member_loads(value, number, is_planar, pose, store, mass, T, force):
    """Add the distributed loads of a condensed member of `mass` [kg] to its tangent T (12, 12) and forces (12,) on both
    nodes: the terms of the module docstring. Returns (largest change to come of the force of a mode of pressure, largest
    such force [N])."""
    modes = max(number[5], 1)
    D, given = 3 * modes, 3 * min(modes, GIVEN_MODES)
    block = store[len(store) - D * (10 + D) :]
    # columns of u that change the modes: the rotation of node a, or, under pressure, all
    first, last = 3, 6
    if modes > GIVEN_MODES:
        first, last = 0, 12
    J, Df, dS, dW = np.zeros((6, 12)), np.zeros((D, 12)), np.empty((D, 12)), np.empty((6, 12))
    f, now, lever = np.empty(3), np.empty(3), np.empty(3)
    P, O, h = np.empty(3), np.empty(3), np.zeros(3)
    for i in range(3):
        lever[i] = pose[9 + i] - pose[15 + i]
        j, k = (i + 1) % 3, (i + 2) % 3
        for r in range(3):
            J[r, 6 + i], J[r, i] = pose[3 * i + r], -pose[3 * i + r]
            J[3 + r, 9 + i], J[3 + r, 3 + i] = pose[3 * i + r], -pose[3 * i + r]
            # e_i x s, and -e_i x w
            J[r, 9 + i] = pose[3 * k + r] * pose[12 + j] - pose[3 * j + r] * pose[12 + k]
            J[r, 3 + i] = pose[3 * j + r] * pose[9 + k] - pose[3 * k + r] * pose[9 + j]
        for m in range(min(modes, GIVEN_MODES)):
            f0, f1, f2 = block[3 * m], block[3 * m + 1], block[3 * m + 2]
            x, y, z = pose[3 * i], pose[3 * i + 1], pose[3 * i + 2]
            Df[3 * m, 3 + i], Df[3 * m + 1, 3 + i], Df[3 * m + 2, 3 + i] = (
                f1 * z - f2 * y,
                f2 * x - f0 * z,
                f0 * y - f1 * x,
            )
    rows = skew_at(store, modes) + 144
    for e in range(D - given):
        row = rows + (8 + given) * e
        for c in range(12):
            s = 0.0
            for r in range(6):
                s += store[row + 2 + r] * J[r, c]
            for r in range(given):
                s += store[row + 8 + r] * Df[r, c]
            Df[given + e, c] = s
    for c in range(12):
        for r in range(6):
            s = 0.0
            for e in range(D):
                s += block[3 * D + D * r + e] * Df[e, c]
            dW[r, c] = s
        for e in range(D):
            s = 0.0
            for r in range(6):
                s -= block[3 * D + D * r + e] * J[r, c]
            for l in range(D):
                s -= block[9 * D + D * e + l] * Df[l, c]
            dS[e, c] = s
    for c in range(first, last):
        for a in range(12):
            s = 0.0
            for r in range(6):
                s += J[r, a] * dW[r, c]
            T[a, c] += s
    change, heavy = 0.0, 0.0
    _, c_at = inertia_places(number, is_planar)
    for m in range(modes):
        total = mass
        if number[5] > 0:
            total = value[c_at + m]
        follows = 3 * m >= given
        for r in range(3):
            f[r], now[r], P[r], O[r] = 0.0, 0.0, total * lever[r], total * lever[r]
            for e in range(3):
                own = pose[3 * r + e]
                b = store[rows + (8 + given) * (3 * m + e - given)] if follows else 0.0
                f[r] += own * block[3 * m + e]
                now[r] += own * (block[3 * m + e] + b)
                P[r] += own * block[D + 3 * m + e]
                O[r] += own * block[2 * D + 3 * m + e]
        if follows:
            for r in range(3):
                change, heavy = max(change, abs(total * (now[r] - f[r]))), max(heavy, abs(total * now[r]))
        for r in range(3):
            j, k = (r + 1) % 3, (r + 2) % 3
            force[r] -= total * now[r]
            force[3 + r] -= P[j] * now[k] - P[k] * now[j]
            h[r] -= O[j] * f[k] - O[k] * f[j]
        for c in range(12):
            # changes of f and O by u, global
            df0, df1, df2, dO0, dO1, dO2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for e in range(3):
                df, dO = Df[3 * m + e, c], dS[3 * m + e, c]
                df0, df1, df2 = df0 + pose[e] * df, df1 + pose[3 + e] * df, df2 + pose[6 + e] * df
                dO0, dO1, dO2 = dO0 + pose[e] * dO, dO1 + pose[3 + e] * dO, dO2 + pose[6 + e] * dO
            if c == 3:
                df1, df2, dO1, dO2 = df1 - f[2], df2 + f[1], dO1 - O[2], dO2 + O[1]
            elif c == 4:
                df0, df2, dO0, dO2 = df0 + f[2], df2 - f[0], dO0 + O[2], dO2 - O[0]
            elif c == 5:
                df0, df1, dO0, dO1 = df0 - f[1], df1 + f[0], dO0 - O[1], dO1 + O[0]
            T[0, c] -= total * df0
            T[1, c] -= total * df1
            T[2, c] -= total * df2
            T[3, c] -= dO1 * f[2] - dO2 * f[1] + O[1] * df2 - O[2] * df1
            T[4, c] -= dO2 * f[0] - dO0 * f[2] + O[2] * df0 - O[0] * df2
            T[5, c] -= dO0 * f[1] - dO1 * f[0] + O[0] * df1 - O[1] * df0
    for r in range(3):
        j, k = (r + 1) % 3, (r + 2) % 3
        T[3 + k, 3 + j] += 0.5 * h[r]
        T[3 + j, 3 + k] -= 0.5 * h[r]
    if modes > GIVEN_MODES:
        at = skew_at(store, modes)
        for a in range(12):
            for c in range(a + 1):
                s, t = 0.5 * (T[a, c] + T[c, a]), 0.5 * (T[a, c] - T[c, a])
                T[a, c], T[c, a] = s, s
                store[at + 12 * a + c], store[at + 12 * c + a] = t, -t
    return change, heavy
