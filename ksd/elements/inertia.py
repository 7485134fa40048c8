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
amplitudes. The store has before the gravity block the eliminated equations of f, in frame p, the factors of their matrix
and scratch.

Bodies keep the nine entries of R as places: P = tr(J)/2 I - J has the energy c0/2 tr((R - R^) P (R - R^)^T), whose moment is
the axial vector of A - A^T, A = c0 R P R^^T, and tangent tr(A) I - (A + A^T)/2.
"""

from __future__ import annotations

import numpy as np

from ksd.elements.plate_energy import POINT_NUMBERS
from ksd.numerics.kernel import kernel


def inertia_store(D: int) -> int:
    """Numbers that the inertia of D = 3 modes adds to the store of a leaf, without what a load of D modes adds."""
    return D * (13 + D) + 3 * D + 144


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
    at, _ = inertia_places(number, is_planar)
    at, o = at + 6, len(store) - 3 * modes * (10 + 3 * modes)
    for k in range(0, 3 * modes, 3):
        x, y, z = state[at + k], state[at + k + 1], state[at + k + 2]
        for r in range(3):
            store[o + k + r] = pose[r] * x + pose[3 + r] * y + pose[6 + r] * z


@kernel(inline="late")
def _component(axis, x, y, z):
    """Component of the vector (x, y, z)."""
    return x if axis == 0 else y if axis == 1 else z


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
    known_at, width, status = wrench + 6 + D, 2 * w + 1, 0
    # f and its equations in frame p: A their matrix, Y over the unknown motions of nodes a and b, then the gradient
    block = len(store) - D * (10 + D)
    Y = block - D * (13 + D)
    # F: motions of f when node a turns; more: what is added to T; in the store, as a kernel that allocates an array counts
    # the references of all
    A, F, more = Y + 13 * D, Y - 3 * D, Y - 3 * D - 144
    for r in range(4 * w * w):
        store[more + r] = 0.0
    w0, w1, w2, s0, s1, s2 = pose[9], pose[10], pose[11], pose[12], pose[13], pose[14]
    o0, o1, o2 = w0 - pose[15], w1 - pose[16], w2 - pose[17]
    largest = 0.0
    for k in range(modes):
        c, N = value[c_at + k], value[c_at + modes + k]
        f0, f1, f2 = store[block + 3 * k], store[block + 3 * k + 1], store[block + 3 * k + 2]
        largest = max(largest, abs(f0) + abs(f1) + abs(f2))
        # first moments about node a, predicted and now
        at, O0, O1, O2 = block + D + 3 * k, c * o0, c * o1, c * o2
        P0, P1, P2 = O0, O1, O2
        a0, a1, a2 = store[at], store[at + 1], store[at + 2]
        P0 += pose[0] * a0 + pose[1] * a1 + pose[2] * a2
        P1 += pose[3] * a0 + pose[4] * a1 + pose[5] * a2
        P2 += pose[6] * a0 + pose[7] * a1 + pose[8] * a2
        a0, a1, a2 = store[at + D], store[at + D + 1], store[at + D + 2]
        O0 += pose[0] * a0 + pose[1] * a1 + pose[2] * a2
        O1 += pose[3] * a0 + pose[4] * a1 + pose[5] * a2
        O2 += pose[6] * a0 + pose[7] * a1 + pose[8] * a2
        at = known_at + 3 * k
        # the gradient by f_k without f, and f in global axes
        d0 = N * state[at] - c * xa[0] - P0
        d1 = N * state[at + 1] - c * xa[1] - P1
        d2 = N * state[at + 2] - c * xa[2] - P2
        g0 = pose[0] * f0 + pose[1] * f1 + pose[2] * f2
        g1 = pose[3] * f0 + pose[4] * f1 + pose[5] * f2
        g2 = pose[6] * f0 + pose[7] * f1 + pose[8] * f2
        force[0] -= c * g0
        force[1] -= c * g1
        force[2] -= c * g2
        force[3] -= P1 * g2 - P2 * g1
        force[4] -= P2 * g0 - P0 * g2
        force[5] -= P0 * g1 - P1 * g0
        along = O0 * g0 + O1 * g1 + O2 * g2
        T[3, 3] += along - O0 * g0
        T[4, 4] += along - O1 * g1
        T[5, 5] += along - O2 * g2
        t = 0.5 * (O0 * g1 + O1 * g0)
        T[3, 4], T[4, 3] = T[3, 4] - t, T[4, 3] - t
        t = 0.5 * (O0 * g2 + O2 * g0)
        T[3, 5], T[5, 3] = T[3, 5] - t, T[5, 3] - t
        t = 0.5 * (O1 * g2 + O2 * g1)
        T[4, 5], T[5, 4] = T[4, 5] - t, T[5, 4] - t
        for e in range(dims):
            u, p0, p1, p2 = dims * k + e, pose[e], pose[3 + e], pose[6 + e]
            own, y, row = A + size * u, Y + width * u, block + 9 * D + D * (3 * k + e)
            for l in range(modes):
                for d in range(dims):
                    store[own + dims * l + d] = store[row + 3 * l + d]
            # V_f,xi in global axes
            at = block + 3 * D + 3 * k + e
            a0, a1, a2 = store[at], store[at + D], store[at + 2 * D]
            b0, b1, b2 = store[at + 3 * D], store[at + 4 * D], store[at + 5 * D]
            v0 = pose[0] * a0 + pose[1] * a1 + pose[2] * a2
            v1 = pose[3] * a0 + pose[4] * a1 + pose[5] * a2
            v2 = pose[6] * a0 + pose[7] * a1 + pose[8] * a2
            m0 = pose[0] * b0 + pose[1] * b1 + pose[2] * b2
            m1 = pose[3] * b0 + pose[4] * b1 + pose[5] * b2
            m2 = pose[6] * b0 + pose[7] * b1 + pose[8] * b2
            for r in range(dims):
                t = _component(active[r], v0, v1, v2)
                store[y + r], store[y + w + r] = -t, t
            for r in range(dims, w):
                axis = active[r] - 3
                store[y + r] = _component(
                    axis, v1 * w2 - v2 * w1 - m0, v2 * w0 - v0 * w2 - m1, v0 * w1 - v1 * w0 - m2
                )
                store[y + w + r] = _component(
                    axis, v2 * s1 - v1 * s2 + m0, v0 * s2 - v2 * s0 + m1, v1 * s0 - v0 * s1 + m2
                )
            for r in range(dims, w):
                # p.(f x e_r) = e_r.(p x f)
                t = _component(active[r] - 3, p1 * g2 - p2 * g1, p2 * g0 - p0 * g2, p0 * g1 - p1 * g0)
                store[F + 3 * u + r - dims] = t
                for v in range(2 * w):
                    store[more + 2 * w * r + v] += t * store[y + v]
            store[y + 2 * w] = p0 * d0 + p1 * d1 + p2 * d2 - N * store[block + 3 * k + e] / c0
            for r in range(dims):
                store[y + r] -= c * _component(active[r], p0, p1, p2)
            for r in range(dims, w):
                store[y + r] += _component(
                    active[r] - 3, p1 * O2 - p2 * O1, p2 * O0 - p0 * O2, p0 * O1 - p1 * O0
                )
    for u in range(size):
        own, y = A + size * u, Y + width * u
        for r in range(turns):
            t = 0.0
            for v in range(size):
                t += store[own + v] * store[F + 3 * v + r]
            store[y + dims + r] += t
            for e in range(turns):
                store[more + 2 * w * (dims + e) + dims + r] += 0.5 * store[F + 3 * u + e] * t
    for k in range(modes):
        for u in range(dims * k, dims * k + dims):
            store[A + (size + 1) * u] -= value[c_at + modes + k] / c0
    # elimination of f
    negatives = -size
    for u in range(size):
        own, y = A + size * u, Y + width * u
        pivot = store[own + u]
        if pivot < 0.0:
            negatives += 1
        if not abs(pivot) > 0.0:
            status = 2
        for v in range(u + 1, size):
            l, other, z = store[own + v] / pivot, A + size * v, Y + width * v
            for t in range(v, size):
                store[other + t] -= l * store[own + t]
            for t in range(width):
                store[z + t] -= l * store[y + t]
    for u in range(size):
        y, inverse = Y + width * u, 1.0 / store[A + (size + 1) * u]
        store[A + (size + 1) * u] = inverse
        for a in range(2 * w):
            l, row = inverse * store[y + a], more + 2 * w * a
            for b in range(a):
                store[row + b] -= l * store[y + b]
            store[row + a] -= 0.5 * l * store[y + a]
            force[active[a] if a < w else 6 + active[a - w]] -= l * store[y + 2 * w]
    for a in range(2 * w):
        row = active[a] if a < w else 6 + active[a - w]
        for b in range(2 * w):
            col, t = active[b] if b < w else 6 + active[b - w], store[more + 2 * w * a + b]
            T[row, col] += t
            T[col, row] += t
    # what is left of the equations of f
    change = 0.0
    for u in range(size - 1, -1, -1):
        t = store[Y + width * u + 2 * w]
        for v in range(u + 1, size):
            t -= store[A + size * u + v] * store[F + v]
        t *= store[A + (size + 1) * u]
        store[F + u] = t
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
    block, f_at = len(store) - D * (10 + D), f_at + 6
    change, Y, size, width = block + 9 * D + D * D, block - D * (13 + D), dims * modes, 2 * w + 1
    A = Y + 13 * D
    # the step of f in frame p, where the change will be
    for k in range(D):
        store[change + k] = 0.0
    for u in range(size - 1, -1, -1):
        s = -store[Y + width * u + 2 * w]
        for a in range(w):
            row = Y + width * u + a
            s -= store[row] * move[active[a]] + store[row + w] * move[6 + active[a]]
        for v in range(u + 1, size):
            s -= store[A + size * u + v] * store[change + 3 * (v // dims) + v % dims]
        store[change + 3 * (u // dims) + u % dims] = store[A + size * u + u] * s
    x = pose[0] * move[3] + pose[3] * move[4] + pose[6] * move[5]
    y = pose[1] * move[3] + pose[4] * move[4] + pose[7] * move[5]
    z = pose[2] * move[3] + pose[5] * move[4] + pose[8] * move[5]
    for k in range(0, D, 3):
        f0, f1, f2 = store[block + k], store[block + k + 1], store[block + k + 2]
        d0, d1, d2 = store[change + k], store[change + k + 1], store[change + k + 2]
        for r in range(3):
            state[f_at + k + r] += scale * (pose[3 * r] * d0 + pose[3 * r + 1] * d1 + pose[3 * r + 2] * d2)
        store[change + k], store[change + k + 1] = d0 + f1 * z - f2 * y, d1 + f2 * x - f0 * z
        store[change + k + 2] = d2 + f0 * y - f1 * x


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
