"""Pressure on a face of a leaf: a force per length along its side e2, which turns with the section.

The force per length p w(s) e2(s), w the width, is expanded into the polynomials P_k that are orthogonal under w,
p w sum f_k P_k with f_k = (1/N_k) int w P_k e2 ds, N_k = int w P_k^2 ds: a load mode of the leaf each
(`ksd.elements.leaf_loads`), with f = p f_k among the inner unknowns of the leaf, in frame p. The resultant, mode 0, is
exact, and the work of what is cut off on smooth motions is of second order. The leaf at given f is the leaf with dead
loads; f follows its shape,

    f = p phi(a),    df = c + p Phi da,    c = p phi - f
    da = -W^-1 g + W^-1 J^T dlam + X df,    dlam = K (xi + gap) + V_xi,f df

with X = W^-1 eta^T, solved here for df = b + H (xi, dead modes), which is not symmetric. What is left of all is the leaf as
a member whose tangent has a skew part. Stretch and shear do not turn the load; it acts per length of the undeformed leaf.

The store of a leaf under pressure has before its gravity block: the factor on loads and the pressure; the skew tangent (12,
12); and per component of f a row (b, db/dfactor, its derivatives by xi (6) and by the dead modes (9)). Its constants end
with the table w P_k / N_k times the weights of the points (points, PRESSURE_MODES).
"""

from __future__ import annotations

import math

import numpy as np

from ksd.elements.inertia import inertia_places
from ksd.numerics.elimination import solve_small
from ksd.numerics.kernel import kernel

GIVEN_MODES = 3
"""Load modes of a leaf with line loads: weight, the line load at its start, and the change of it to its end."""
PRESSURE_MODES = 6
"""Load modes of pressure in every direction; what they cut off is below the error of the curvature modes."""
PRESSURE_STORE = 2 + 144 + 3 * PRESSURE_MODES * (8 + 3 * GIVEN_MODES)
"""Numbers that pressure adds to the store of a leaf, without the modes themselves."""


@kernel(inline="always")
def skew_at(store, modes):
    """Position of the skew tangent in the store of a leaf under pressure with so many load modes."""
    D = 3 * modes
    return len(store) - D * (10 + D) - 3 * PRESSURE_MODES * (8 + 3 * GIVEN_MODES) - 144


@kernel
def pressure_in_space(value, number, store, fields, lam):
    """Eliminate the modes of pressure of a spatial leaf, after its gravity block was set; see the module docstring."""
    N, ng, modes = number[0] + number[1] + number[2], number[3], number[5]
    D, last = 3 * modes, 8 * N + 42
    given, psi, R = 3 * GIVEN_MODES, fields.psi, fields.R
    _, c_at = inertia_places(number, False)
    table, change = c_at + modes, np.empty(6)
    # Phi times (W^-1 g, W^-1 J^T, X)
    phi, M, turn = np.zeros(D - given), np.zeros((D - given, 7 + D)), np.empty((3, 7 + D))
    for g in range(ng):
        turn[:, :] = 0.0
        for i in range(N):
            for r in range(3):
                p = psi[g + 1, r, i]
                turn[r, 0] += p * store[8 * i + 6]
                for e in range(6):
                    turn[r, 1 + e] += p * store[8 * i + e]
                for e in range(D):
                    turn[r, 7 + e] += p * store[last + D * i + e]
        for k in range(modes - GIVEN_MODES):
            w = value[table + PRESSURE_MODES * g + k]
            for r in range(3):
                j, l = (r + 1) % 3, (r + 2) % 3
                phi[3 * k + r] += w * R[g + 1, r, 1]
                for e in range(7 + D):
                    M[3 * k + r, e] += w * (turn[j, e] * R[g + 1, l, 1] - turn[l, e] * R[g + 1, j, 1])
    for r in range(6):
        change[r] = lam[r] - lam[6 + r]
    # the step of the moment, less its rotation by half of the closure
    x, y, z = store[7], store[15], store[23]
    change[3] += 0.5 * (lam[10] * z - lam[11] * y)
    change[4] += 0.5 * (lam[11] * x - lam[9] * z)
    change[5] += 0.5 * (lam[9] * y - lam[10] * x)
    K = store[8 * N : 8 * N + 36].reshape(6, 6)
    _eliminate(modes, phi, M, change, K, store, lam)


@kernel
def pressure_in_plane(value, number, inner, store, lam, K):
    """`pressure_in_space` of a planar leaf."""
    nz, points, first, modes = number[0], number[1], number[2], number[5]
    D, X, given = 3 * modes, 8 * nz + nz * nz + 9, 3 * GIVEN_MODES
    _, c_at = inertia_places(number, True)
    table, change = c_at + modes, np.empty(6)
    phi, M, turn = np.zeros(D - given), np.zeros((D - given, 7 + D)), np.empty(7 + D)
    for p in range(points):
        at, theta = nz * nz + nz + p * (3 + nz), 0.0
        turn[:] = 0.0
        for i in range(nz):
            psi = value[at + 3 + i]
            theta += inner[first + i] * psi
            turn[0] += psi * store[4 * i + 3]
            turn[1] += psi * store[4 * i]
            turn[2] += psi * store[4 * i + 1]
            turn[6] += psi * store[4 * i + 2]
            for k in range(modes):
                own = X + 4 * modes * i + 2 * (modes + k)
                turn[7 + 3 * k] += psi * store[own]
                turn[8 + 3 * k] += psi * store[own + 1]
        c, s = math.cos(theta), math.sin(theta)
        for k in range(modes - GIVEN_MODES):
            w = value[table + PRESSURE_MODES * p + k]
            phi[3 * k] -= w * s
            phi[3 * k + 1] += w * c
            for e in range(7 + D):
                M[3 * k, e] -= w * c * turn[e]
                M[3 * k + 1, e] -= w * s * turn[e]
    for r in range(6):
        change[r] = lam[r] - lam[6 + r]
    _eliminate(modes, phi, M, change, K, store, lam)


@kernel
def _eliminate(modes, phi, M, change, K, store, lam):
    """Solve for df and write it into the store; add its part at xi = 0 to the wrench lam and the first moments.

    phi (n,); M (n, 7 + D): Phi times (W^-1 g, W^-1 J^T, X); change (6,): K gap.
    """
    D, given = 3 * modes, 3 * GIVEN_MODES
    n, at = D - given, skew_at(store, modes)
    block = store[len(store) - D * (10 + D) :]
    factor, pressure = store[at - 2], store[at - 1]
    p, A, B = factor * pressure, np.empty((n, n)), np.empty((n, 8 + given))
    for i in range(n):
        s = -M[i, 0]
        for r in range(6):
            s += M[i, 1 + r] * change[r]
        B[i, 0], B[i, 1] = p * (phi[i] + s) - block[given + i], pressure * phi[i]
        for c in range(6):
            t = 0.0
            for r in range(6):
                t += M[i, 1 + r] * K[r, c]
            B[i, 2 + c] = p * t
        for e in range(D):
            t = M[i, 7 + e]
            for r in range(6):
                t += M[i, 1 + r] * block[3 * D + D * r + e]
            if e < given:
                B[i, 8 + e] = p * t
            else:
                A[i, e - given] = -p * t
        A[i, i] += 1.0
    solve_small(A, B)
    for i in range(n):
        row = at + 144 + (8 + given) * i
        for c in range(8 + given):
            store[row + c] = B[i, c]
        for r in range(6):
            lam[r] += block[3 * D + D * r + given + i] * B[i, 0]
        for e in range(D):
            block[D + e] -= block[9 * D + D * e + given + i] * B[i, 0]
