"""Inertia in a time step: of leaf springs, as a distributed force in Legendre modes, and of rigid bodies; compiled.

A time step is a static problem in which every mass is held by a spring to a known place, q'' = c0 (q - q^)
(`ksd.solvers.time_steps`). A leaf of mass mu per length has the distributed force mu sum f_k P_k(s), with polynomials P_k
that are orthogonal under mu, and the unknown accelerations f_k, global, are gravity less q_k'', where q_k = int mu P_k r ds / N_k
are the places that are kept, N_k = int mu P_k^2 ds. The leaf adds to its functional (`ksd.elements.planar_leaf`)

    V(xi, Rp^T f) - sum f_k.(c_k x_p - N_k q^_k) - sum N_k |f_k|^2 / (2 c0),    c_k = int mu P_k ds

with gravity in q^_0. In space, couple modes hold the width axis, e = rho_w e3 with the radius of gyration rho_w across the
width, in the same way, which is a leaf whose mass lies on two lines. The f_k are eliminated here, after the leaf itself.

Constants of such a leaf, at the end: Q_k (points, modes) = int_s^L mu P_k ds [kg], or mu rho_w P_k [kg] of a couple mode; c_k;
N_k [kg]. Inner state after the wrench: f (3 modes), q^ (3 modes), and with material damping tau c1 and the known amplitudes.
The store has before the gravity block A^-1 (B, G) (3 modes, 13) of the elimination.

Bodies keep the nine entries of R as places: P = tr(J)/2 I - J has the energy c0/2 tr((R - R^) P (R - R^)^T), whose moment is the
axial vector of A - A^T, A = c0 R P R^^T, and tangent tr(A) I - (A + A^T)/2.
"""

from __future__ import annotations

import math

import numpy as np

from ksd.elements.plate_energy import POINT_NUMBERS
from ksd.numerics.kernel import kernel


@kernel(inline="late")
def inertia_places(number, is_planar):
    """Positions of the wrench in the inner state, and of c_k among the constants, of a leaf with inertia."""
    modes, points = number[5] + number[6], number[3]
    wrench = number[0] + number[1] + number[2]
    at = 1 + wrench + points * (4 + points + wrench) + 3 * wrench * (points + 1)
    at += number[0] ** 2 + number[1] ** 2 + number[2] ** 2 + number[4] * (POINT_NUMBERS + number[2])
    if is_planar:
        nz, points, wrench = number[0], number[1], number[3]
        at = nz * nz + 2 * nz + points * (3 + nz) + number[4] * (POINT_NUMBERS + nz)
    return wrench, at + points * modes


def inertia_tables(points, weight, integral, line_mass, radius, counts):  # type: ignore[no-untyped-def]
    """Constants of the inertia of a leaf, flat: Q (points, modes), c (modes,) and N (modes,), see the module docstring.

    points, weight (g,): places from 0 to 1 and lengths [m] of the quadrature; integral (g, g): lengths of the integrals from
    0 to every point; line_mass (g,) [kg/m]; radius (g,) [m]: of gyration across the width; counts: of force and couple modes.
    """
    legendre = np.polynomial.legendre.legvander(2.0 * points - 1.0, max(counts) - 1)
    basis = np.zeros_like(legendre)
    for k, column in enumerate(legendre.T):
        # orthogonal under the mass, twice against rounding
        for _ in range(2):
            for other in basis.T[:k]:
                column = column - other * ((weight * line_mass * other) @ column) / ((weight * line_mass * other) @ other)
        basis[:, k] = column
    heavy = line_mass[:, None] * basis
    N, c = (weight[:, None] * heavy * basis).sum(axis=0), weight @ heavy
    forces, couples = (heavy[:, :n] for n in counts)
    Q = np.hstack([weight @ forces - integral @ forces, radius[:, None] * couples])
    ends = [np.concatenate([own[: counts[0]], (own if own is N else 0.0 * own)[: counts[1]]]) for own in (c, N)]
    return np.concatenate([Q.ravel(), *ends])


@kernel
def set_inertia_forces(number, is_planar, pose, state, store):
    """Write the force modes into the gravity block of a leaf, in its frame p."""
    modes = number[5] + number[6]
    f, _ = inertia_places(number, is_planar)
    f, o = f + 6, len(store) - 3 * modes * (10 + 3 * modes)
    for k in range(modes):
        for r in range(3):
            store[o + 3 * k + r] = (
                pose[r] * state[f + 3 * k] + pose[3 + r] * state[f + 3 * k + 1] + pose[6 + r] * state[f + 3 * k + 2]
            )


@kernel(inline="late")
def _rotated(pose, block, at, width, B):
    """Write B (3, 3) = Rp M Rp^T, M in `block` from `at`, with rows `width` apart."""
    for i in range(3):
        a, b, c = pose[3 * i], pose[3 * i + 1], pose[3 * i + 2]
        m0 = a * block[at] + b * block[at + width] + c * block[at + 2 * width]
        m1 = a * block[at + 1] + b * block[at + width + 1] + c * block[at + 2 * width + 1]
        m2 = a * block[at + 2] + b * block[at + width + 2] + c * block[at + 2 * width + 2]
        for j in range(3):
            B[i, j] = m0 * pose[3 * j] + m1 * pose[3 * j + 1] + m2 * pose[3 * j + 2]


@kernel
def add_member_inertia(active, w, c0, value, number, is_planar, xa, pose, state, store, mass, T, force):
    """Add the inertia of a condensed leaf of `mass` [kg] to its tangent T (12, 12) and forces (12,) on both nodes.

    active (w,): the degrees of freedom of nodes that are unknown; xa (3,): place of node a. Returns (negative pivots of the
    force modes less their number, largest change of mass times f_k to come [N], largest mass times f_k [N], status).
    """
    modes = number[5] + number[6]
    D, dims = 3 * modes, w // 2 if w == 6 else w - 1
    wrench, c_at = inertia_places(number, is_planar)
    f_at, known_at = wrench + 6, wrench + 6 + D
    block = store[len(store) - D * (10 + D) :]
    solved = store[len(store) - D * (10 + D) - 13 * D :]
    A, X, Y = np.empty((D, D)), np.empty((D, 12)), np.empty((D, 13))
    B, n, m, O, P = np.empty((3, 3)), np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3)
    status, size = 0, dims * modes
    for k in range(modes):
        _rotated(pose, block, 3 * D + 3 * k, D, n)
        _rotated(pose, block, 6 * D + 3 * k, D, B)
        for c in range(3):
            i = 3 * k + c
            for r in range(3):
                m[r] = B[r, c]
            for r in range(3):
                j, l = (r + 1) % 3, (r + 2) % 3
                X[i, r], X[i, 6 + r] = -n[r, c], n[r, c]
                X[i, 3 + r] = n[j, c] * pose[9 + l] - n[l, c] * pose[9 + j] - m[r]
                X[i, 9 + r] = n[l, c] * pose[12 + j] - n[j, c] * pose[12 + l] + m[r]
            for col in range(12):
                Y[i, col] = X[i, col]
    for k in range(modes):
        for l in range(k + 1):
            _rotated(pose, block, 9 * D + 3 * D * k + 3 * l, D, B)
            for i in range(3):
                for j in range(3):
                    A[3 * k + i, 3 * l + j] = B[i, j]
                    A[3 * l + j, 3 * k + i] = B[i, j]
    # turning node a turns all forces in frame p: Y = X + A [f]x
    for i in range(D):
        for k in range(modes):
            a0, a1, a2 = A[i, 3 * k], A[i, 3 * k + 1], A[i, 3 * k + 2]
            f0, f1, f2 = state[f_at + 3 * k], state[f_at + 3 * k + 1], state[f_at + 3 * k + 2]
            Y[i, 3] += a1 * f2 - a2 * f1
            Y[i, 4] += a2 * f0 - a0 * f2
            Y[i, 5] += a0 * f1 - a1 * f0
    largest = 0.0
    for k in range(modes):
        c, N = value[c_at + k], value[c_at + modes + k]
        f0, f1, f2 = state[f_at + 3 * k], state[f_at + 3 * k + 1], state[f_at + 3 * k + 2]
        largest = max(largest, mass * math.sqrt(f0 * f0 + f1 * f1 + f2 * f2))
        Of = 0.0
        for r in range(3):
            lever = pose[9 + r] - pose[15 + r]
            p, o = 0.0, 0.0
            for e in range(3):
                p += pose[3 * r + e] * block[D + 3 * k + e]
                o += pose[3 * r + e] * block[2 * D + 3 * k + e]
            P[r], O[r] = c * lever + p, c * lever + o
            Of += O[r] * state[f_at + 3 * k + r]
            # the gradient by f_k
            Y[3 * k + r, 12] = (
                N * state[known_at + 3 * k + r] - c * xa[r] - P[r] - N * state[f_at + 3 * k + r] / c0
            )
            A[3 * k + r, 3 * k + r] -= N / c0
        for col in range(12):
            # columns of [f]x' Y, and rows of X' [f]x
            y0, y1, y2 = Y[3 * k, col], Y[3 * k + 1, col], Y[3 * k + 2, col]
            T[3, col] += y1 * f2 - y2 * f1
            T[4, col] += y2 * f0 - y0 * f2
            T[5, col] += y0 * f1 - y1 * f0
            x0, x1, x2 = X[3 * k, col], X[3 * k + 1, col], X[3 * k + 2, col]
            T[col, 3] += x1 * f2 - x2 * f1
            T[col, 4] += x2 * f0 - x0 * f2
            T[col, 5] += x0 * f1 - x1 * f0
        for r in range(3):
            j, l = (r + 1) % 3, (r + 2) % 3
            f, fj, fl = state[f_at + 3 * k + r], state[f_at + 3 * k + j], state[f_at + 3 * k + l]
            force[r] -= c * f
            force[3 + r] -= P[j] * fl - P[l] * fj
            T[3 + r, 3 + r] += Of
            for e in range(3):
                T[3 + r, 3 + e] -= 0.5 * (O[r] * state[f_at + 3 * k + e] + f * O[e])
            Y[3 * k + r, r] -= c
            # + [O]x
            Y[3 * k + r, 3 + j] -= O[l]
            Y[3 * k + r, 3 + l] += O[j]
    # elimination of f in the active directions
    negatives = -size
    for u in range(size):
        i = 3 * (u // dims) + active[u % dims]
        pivot = A[i, i]
        if pivot < 0.0:
            negatives += 1
        if not abs(pivot) > 0.0:
            status = 2
        for v in range(u + 1, size):
            j = 3 * (v // dims) + active[v % dims]
            l = A[i, j] / pivot
            if l != 0.0:
                for t in range(v, size):
                    k = 3 * (t // dims) + active[t % dims]
                    A[j, k] -= l * A[i, k]
                for col in range(13):
                    Y[j, col] -= l * Y[i, col]
    for u in range(size):
        i = 3 * (u // dims) + active[u % dims]
        inverse = 1.0 / A[i, i]
        for a in range(2 * w):
            row = 6 * (a // w) + active[a % w]
            y = inverse * Y[i, row]
            force[row] -= y * Y[i, 12]
            for b in range(2 * w):
                col = 6 * (b // w) + active[b % w]
                T[row, col] -= y * Y[i, col]
    change = 0.0
    for u in range(size - 1, -1, -1):
        i = 3 * (u // dims) + active[u % dims]
        for col in range(13):
            y = Y[i, col]
            for v in range(u + 1, size):
                j = 3 * (v // dims) + active[v % dims]
                y -= A[i, j] * solved[13 * j + col]
            solved[13 * i + col] = y / A[i, i]
        change = max(change, mass * abs(solved[13 * i + 12]))
    return negatives, change, largest, status


@kernel
def move_inertia_forces(active, w, number, is_planar, pose, move, state, scale, store):
    """Add `scale` times the step of the force modes, when the nodes move by move (12,), and write the change of the forces in
    frame p into the gravity block, for `recover`."""
    modes = number[5] + number[6]
    D, dims = 3 * modes, w // 2 if w == 6 else w - 1
    f, _ = inertia_places(number, is_planar)
    f, o = f + 6, len(store) - D * (10 + D)
    change, solved, d = o + 9 * D + D * D, o - 13 * D, np.empty(3)
    for k in range(modes):
        d[:] = 0.0
        for u in range(dims):
            i = 3 * k + active[u]
            s = store[solved + 13 * i + 12]
            for a in range(2 * w):
                col = 6 * (a // w) + active[a % w]
                s += store[solved + 13 * i + col] * move[col]
            d[active[u]] = -s
        f0, f1, f2 = state[f + 3 * k], state[f + 3 * k + 1], state[f + 3 * k + 2]
        for r in range(3):
            state[f + 3 * k + r] += scale * d[r]
        d[0] += f1 * move[5] - f2 * move[4]
        d[1] += f2 * move[3] - f0 * move[5]
        d[2] += f0 * move[4] - f1 * move[3]
        for r in range(3):
            store[change + 3 * k + r] = pose[r] * d[0] + pose[3 + r] * d[1] + pose[6 + r] * d[2]


@kernel
def add_body(body, known, c0, x, R, force, tangent):
    """Inertia of a rigid body on its node: write force (6,) and tangent (6, 6), the derivatives of its energy.

    body (13,): mass, centre (3), P (3, 3) in node axes; known (12,): known place and orientation of the node.
    """
    m, A = body[0] * c0, np.empty((3, 3))
    s, F = np.empty(3), np.empty(3)
    for r in range(3):
        s[r] = R[r, 0] * body[1] + R[r, 1] * body[2] + R[r, 2] * body[3]
        other = known[3 + 3 * r] * body[1] + known[4 + 3 * r] * body[2] + known[5 + 3 * r] * body[3]
        F[r] = m * (x[r] - known[r] + s[r] - other)
        a, b, c = R[r, 0], R[r, 1], R[r, 2]
        p0 = a * body[4] + b * body[7] + c * body[10]
        p1 = a * body[5] + b * body[8] + c * body[11]
        p2 = a * body[6] + b * body[9] + c * body[12]
        for e in range(3):
            A[r, e] = c0 * (p0 * known[3 + 3 * e] + p1 * known[4 + 3 * e] + p2 * known[5 + 3 * e])
    trace = A[0, 0] + A[1, 1] + A[2, 2]
    sF, ss = s[0] * F[0] + s[1] * F[1] + s[2] * F[2], s[0] * s[0] + s[1] * s[1] + s[2] * s[2]
    tangent[:, :] = 0.0
    for r in range(3):
        j, k = (r + 1) % 3, (r + 2) % 3
        force[r], force[3 + r] = F[r], s[j] * F[k] - s[k] * F[j] + A[k, j] - A[j, k]
        tangent[r, r] = m
        # -m [s]x and its transpose
        tangent[r, 3 + j], tangent[r, 3 + k] = m * s[k], -m * s[j]
        tangent[3 + j, r], tangent[3 + k, r] = m * s[k], -m * s[j]
        for e in range(3):
            tangent[3 + r, 3 + e] = (
                0.5 * (s[r] * F[e] + F[r] * s[e]) - m * s[r] * s[e] - 0.5 * (A[r, e] + A[e, r])
            )
        tangent[3 + r, 3 + r] += m * ss - sF + trace
