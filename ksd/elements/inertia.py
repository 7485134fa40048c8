"""Inertia in a time step: of leaf springs, as a distributed force in Legendre modes, and of rigid bodies; compiled.

A time step is a static problem in which every mass is held by a spring to a known place, q'' = c0 (q - q^)
(`ksd.solvers.time_steps`). A leaf of mass mu per length has the distributed force mu sum f_k P_k(s), with polynomials P_k
that are orthogonal under mu. The unknown accelerations f_k, global, are gravity less q_k'', where q_k = int mu P_k r ds /
N_k are the places that are kept, N_k = int mu P_k^2 ds. The leaf adds to its functional (`ksd.elements.planar_leaf`)

    V(xi, Rp^T f) - sum f_k.(c_k x_p - N_k q^_k) - sum N_k |f_k|^2 / (2 c0),    c_k = int mu P_k ds

with gravity in q^_0. In space, couple modes hold the width axis, e = rho_w e3 with the radius of gyration rho_w across the
width, in the same way, which is a leaf whose mass lies on two lines. The f_k are eliminated here, after the leaf itself.

Constants of such a leaf, at the end: Q_k (points, modes) = int_s^L mu P_k ds [kg], or mu rho_w P_k [kg] of a couple mode;
c_k and N_k [kg]. Inner state after the wrench: f (3 modes), q^ (3 modes), and with material damping tau c1 and the known
amplitudes. The store has before the gravity block the eliminated equations of f: (B, G) and the factors of their matrix.

Bodies keep the nine entries of R as places: P = tr(J)/2 I - J has the energy c0/2 tr((R - R^) P (R - R^)^T), whose moment is
the axial vector of A - A^T, A = c0 R P R^^T, and tangent tr(A) I - (A + A^T)/2.
"""

from __future__ import annotations

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


def inertia_tables(
    points: np.ndarray,
    weight: np.ndarray,
    integral: np.ndarray,
    line_mass: np.ndarray,
    radius: np.ndarray,
    counts: tuple[int, int],
) -> np.ndarray:
    """Constants of the inertia of a leaf, flat: Q (points, modes), c (modes,) and N (modes,), see the module docstring.

    points, weight (g,): places from 0 to 1 and lengths [m] of the quadrature; integral (g, g): those of the integrals from 0
    to every point; line_mass (g,) [kg/m]; radius (g,) [m]: of gyration across the width; counts: of force and couple modes.
    """
    basis = orthogonal_modes(points, weight * line_mass, max(counts))
    heavy = line_mass[:, None] * basis
    N, c = (weight[:, None] * heavy * basis).sum(axis=0), weight @ heavy
    forces, couples = (heavy[:, :n] for n in counts)
    Q = np.hstack([weight @ forces - integral @ forces, radius[:, None] * couples])
    ends = [
        np.concatenate([own[: counts[0]], (own if own is N else 0.0 * own)[: counts[1]]]) for own in (c, N)
    ]
    return np.concatenate([Q.ravel(), *ends])


def orthogonal_modes(points: np.ndarray, weight: np.ndarray, count: int) -> np.ndarray:
    """Polynomials (g, count) that are orthogonal under `weight` (g,) at `points` (g,) from 0 to 1, from those of
    Legendre."""
    legendre = np.polynomial.legendre.legvander(2.0 * points - 1.0, count - 1)
    basis = np.zeros_like(legendre)
    for k, column in enumerate(legendre.T):
        # twice against rounding
        for _ in range(2):
            for other in basis.T[:k]:
                column = column - other * ((weight * other) @ column) / ((weight * other) @ other)
        basis[:, k] = column
    return basis


@kernel
def set_inertia_forces(number, is_planar, pose, state, store):
    """Write the force modes into the gravity block of a leaf, in its frame p."""
    modes = number[5] + number[6]
    f, _ = inertia_places(number, is_planar)
    f, o = f + 6, len(store) - 3 * modes * (10 + 3 * modes)
    for k in range(modes):
        for r in range(3):
            store[o + 3 * k + r] = (
                pose[r] * state[f + 3 * k]
                + pose[3 + r] * state[f + 3 * k + 1]
                + pose[6 + r] * state[f + 3 * k + 2]
            )


@kernel
def add_member_inertia(active, w, c0, value, number, is_planar, xa, pose, state, store, mass, T, force):
    """Add the inertia of a condensed leaf of `mass` [kg] to its tangent T (12, 12) and forces (12,) on both nodes.

    active (w,): the degrees of freedom of nodes that are unknown; xa (3,): place of node a. Returns (negative pivots of the
    force modes less their number, largest change of mass times f_k to come [N], largest mass times f_k [N], status).
    """
    modes, dims = number[5] + number[6], 3
    if w == 3:
        dims -= 1
    turns, D, size = w - dims, 3 * modes, dims * modes
    wrench, c_at = inertia_places(number, is_planar)
    f_at, known_at = wrench + 6, wrench + 6 + D
    block = store[len(store) - D * (10 + D) :]
    solved, width = len(store) - D * (10 + D) - D * (13 + D), 2 * w + 1
    Y = store[solved : solved + size * width].reshape(size, width)
    A = store[solved + 13 * D : solved + 13 * D + size * size].reshape(size, size)
    # over the unknown motions of nodes a and b: X = V_f,xi, then the gradient; F: motions of f when node a turns
    X, F, cols = np.empty((size, 2 * w)), np.zeros((size, 3)), np.empty(2 * w, np.int64)
    m, lever, status = np.empty((6, 3)), np.empty((3, 3)), 0
    for r in range(w):
        cols[r], cols[w + r] = active[r], 6 + active[r]
    for r in range(3):
        lever[0, r], lever[1, r], lever[2, r] = pose[9 + r], pose[12 + r], pose[9 + r] - pose[15 + r]
    for k in range(modes):
        for d in range(dims):
            g = 3 * active[d]
            for half in range(2):
                for r in range(3):
                    m[3 + r, 0] = 0.0
                    for e in range(dims):
                        m[3 + r, 0] += block[3 * D + D * (3 * half + r) + 3 * k + e] * pose[g + e]
                for r in range(3):
                    m[half, r] = pose[3 * r] * m[3, 0] + pose[3 * r + 1] * m[4, 0] + pose[3 * r + 2] * m[5, 0]
            u = dims * k + d
            for e in range(dims):
                X[u, e], X[u, w + e] = -m[0, active[e]], m[0, active[e]]
            for e in range(turns):
                r = active[dims + e] - 3
                i, j = (r + 1) % 3, (r + 2) % 3
                X[u, dims + e] = m[0, i] * lever[0, j] - m[0, j] * lever[0, i] - m[1, r]
                X[u, w + dims + e] = m[0, j] * lever[1, i] - m[0, i] * lever[1, j] + m[1, r]
                f = state[f_at + 3 * k : f_at + 3 * k + 3]
                # f x e_r
                if active[d] == i:
                    F[u, e] = f[j]
                elif active[d] == j:
                    F[u, e] = -f[i]
            for v in range(2 * w):
                Y[u, v] = X[u, v]
        for l in range(k + 1):
            for d in range(dims):
                g = 3 * active[d]
                for e in range(dims):
                    t = 0.0
                    for h in range(dims):
                        t += pose[g + h] * block[9 * D + D * (3 * k + h) + 3 * l + e]
                    m[d, e] = t
            for d in range(dims):
                for e in range(dims):
                    g, t = 3 * active[e], 0.0
                    for h in range(dims):
                        t += m[d, h] * pose[g + h]
                    A[dims * k + d, dims * l + e] = t
                    A[dims * l + e, dims * k + d] = t
    for u in range(size):
        for e in range(turns):
            t = 0.0
            for v in range(size):
                t += A[u, v] * F[v, e]
            Y[u, dims + e] += t
    for e in range(turns):
        row = active[dims + e]
        for v in range(2 * w):
            col, s, t = cols[v], 0.0, 0.0
            for u in range(size):
                s += F[u, e] * Y[u, v]
                t += F[u, e] * X[u, v]
            T[row, col] += s
            T[col, row] += t
    largest, P, O = 0.0, m[0], m[1]
    for k in range(modes):
        c, N = value[c_at + k], value[c_at + modes + k]
        f = state[f_at + 3 * k : f_at + 3 * k + 3]
        largest, Of = max(largest, abs(f[0]) + abs(f[1]) + abs(f[2])), 0.0
        for r in range(3):
            P[r], O[r] = c * lever[2, r], c * lever[2, r]
            for e in range(3):
                P[r] += pose[3 * r + e] * block[D + 3 * k + e]
                O[r] += pose[3 * r + e] * block[2 * D + 3 * k + e]
            Of += O[r] * f[r]
        for r in range(3):
            i, j = (r + 1) % 3, (r + 2) % 3
            force[r] -= c * f[r]
            force[3 + r] -= P[i] * f[j] - P[j] * f[i]
            T[3 + r, 3 + r] += Of
            for e in range(3):
                T[3 + r, 3 + e] -= 0.5 * (O[r] * f[e] + f[r] * O[e])
        for d in range(dims):
            g, u = active[d], dims * k + d
            # the gradient by f_k
            Y[u, 2 * w] = N * state[known_at + 3 * k + g] - c * xa[g] - P[g] - N * f[g] / c0
            A[u, u] -= N / c0
            Y[u, d] -= c
            for e in range(turns):
                r = active[dims + e] - 3
                i, j = (r + 1) % 3, (r + 2) % 3
                # O x e_r
                if g == i:
                    Y[u, dims + e] += O[j]
                elif g == j:
                    Y[u, dims + e] -= O[i]
    # elimination of f
    negatives = -size
    for u in range(size):
        pivot = A[u, u]
        if pivot < 0.0:
            negatives += 1
        if not abs(pivot) > 0.0:
            status = 2
        for v in range(u + 1, size):
            l = A[u, v] / pivot
            for t in range(v, size):
                A[v, t] -= l * A[u, t]
            for t in range(width):
                Y[v, t] -= l * Y[u, t]
    for u in range(size):
        inverse = 1.0 / A[u, u]
        A[u, u] = inverse
        for a in range(2 * w):
            l = inverse * Y[u, a]
            force[cols[a]] -= l * Y[u, 2 * w]
            for b in range(2 * w):
                T[cols[a], cols[b]] -= l * Y[u, b]
    # what is left of the equations of f
    change = 0.0
    for u in range(size - 1, -1, -1):
        t = A[u, u] * Y[u, 2 * w]
        for v in range(u + 1, size):
            t -= A[u, u] * A[u, v] * F[v, 0]
        F[u, 0] = t
        change = max(change, abs(t))
    return negatives, mass * change, mass * largest, status


@kernel
def move_inertia_forces(active, w, number, is_planar, pose, move, state, scale, store):
    """Add `scale` times the step of the force modes, when the nodes move by move (12,), and write the change of the forces
    in frame p into the gravity block, for `recover`."""
    modes, dims = number[5] + number[6], 3
    if w == 3:
        dims -= 1
    D = 3 * modes
    f_at, _ = inertia_places(number, is_planar)
    f_at, o = f_at + 6, len(store) - D * (10 + D)
    change, solved, d = o + 9 * D + D * D, o - D * (13 + D), np.empty(3)
    size, width = dims * modes, 2 * w + 1
    Y = store[solved : solved + size * width].reshape(size, width)
    A = store[solved + 13 * D : solved + 13 * D + size * size].reshape(size, size)
    step = np.empty(size)
    for u in range(size - 1, -1, -1):
        s = -Y[u, 2 * w]
        for a in range(w):
            s -= Y[u, a] * move[active[a]] + Y[u, w + a] * move[6 + active[a]]
        for v in range(u + 1, size):
            s -= A[u, v] * step[v]
        step[u] = A[u, u] * s
    for k in range(modes):
        d[:] = 0.0
        f = state[f_at + 3 * k : f_at + 3 * k + 3]
        f0, f1, f2 = f[0], f[1], f[2]
        for u in range(dims):
            d[active[u]] = step[dims * k + u]
            f[active[u]] += scale * step[dims * k + u]
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
