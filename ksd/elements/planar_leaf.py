"""The strain-mode leaf restricted to its bending plane: `ksd.elements.strain` in closed form in the angle.

End p at the origin, unrotated; end q at d, rotated by Q about e3. Unknowns are the amplitudes a (nz,) of
kappa = sum a_k B_k(s) [1/m] and lam = (nx, ny, m), force and moment on end q. The angle is the integral of kappa,
theta = sum a_k psi_k with known psi_k(s) = int B_k, so the mixed functional 1/2 a K a - H + lam.(closure) needs one sum
over the Gauss points, the same as in space: H = L sum w h(theta) + m theta(L), h = N + (cN N^2 + cV V^2)/2,
N + i V = (nx + i ny) exp(-i theta), hence h' = V + (cN - cV) N V and h'' = -N + (cN - cV)(V^2 - N^2). Source: the S model
of the strain-mode note.

It uses the inner state of the spatial leaf, of which it changes the amplitudes of weak bending and three numbers of the
wrench. `number`: nz, points, index of the first weak-bending amplitude, of the wrench, number of plate points, of force and
of couple modes (`ksd.elements.strain_values.mode_counts`).
`value`: K (nz, nz) [N m^3], stress-free a0 (nz), then per point: weight times L, cN = 1/EA, cV = 1/(ky G A), psi (nz); then
psi at the end; with plate stiffening per point the numbers of `ksd.elements.plate_energy` and the modes (nz); for a leaf
with weight the mass beyond each point [kg], with inertia the tables of `ksd.elements.inertia`. `store`: W^-1 (J, g) (nz, 4),
J and g (nz, 4), W (nz, nz), gap (3), K (6); with weight eta and W^-1 eta (nz, 4) of every mode, and the gravity block of
`ksd.elements.weight`.

With weight the force at a point is n + M g, M the mass beyond it and g gravity in frame p; dH/dg = int M r' ds is the
first moment of the mass about end p, and eta its derivative by the amplitudes. With inertia it is n + sum Q_k f_k, and a
couple e x sum Q_k f_k on the normal e = R e2 adds e.sum Q_k f_k to h.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from ksd.elements.plate_energy import POINT_NUMBERS, plate_point
from ksd.elements.pressure import GIVEN_MODES, PRESSURE_STORE
from ksd.elements.strain_values import mode_counts, strain_value_count
from ksd.numerics.kernel import kernel

TINY_PIVOT = 1e-15
"""A pivot below this fraction of its diagonal before elimination counts as zero."""
FULL_TURN = 2.0 * math.pi


@kernel(inline="late")
def _assemble(value, number, inner, store):
    """Write W (lower) and (J, g) into the store; return position and angle of end q, and the force block of F."""
    nz, points, first, wrench = number[0], number[1], number[2], number[3]
    J, W = 4 * nz, 8 * nz
    nx, ny, moment = inner[wrench], inner[wrench + 1], inner[wrench + 5]
    forces, modes, block_size = mode_counts(number, len(store) > W + nz * nz + 9)
    point_size, gravity_at = 3 + nz, len(store) - block_size
    end = nz * nz + nz + points * point_size
    angle, fx, fy = 0.0, nx, ny
    rate_at = wrench + 6 + 6 * modes
    is_damped = len(inner) > rate_at
    for i in range(nz):
        g = -moment * value[end + i]
        for j in range(nz):
            stiffness = value[i * nz + j]
            store[W + i * nz + j] = stiffness
            g += stiffness * (inner[first + j] - value[nz * nz + j])
            if is_damped:
                store[W + i * nz + j] += inner[rate_at] * stiffness
                g += inner[rate_at] * stiffness * (inner[first + j] - inner[rate_at + 1 + first + j])
        store[J + 4 * i], store[J + 4 * i + 1] = 0.0, 0.0
        store[J + 4 * i + 2], store[J + 4 * i + 3] = value[end + i], g
        angle += inner[first + i] * value[end + i]
    mass_at = end + nz
    if number[4]:
        for _ in range(number[4]):
            _add_plate_point(value, mass_at, nz, first, inner, store)
            mass_at += POINT_NUMBERS + nz
    x, y, xx, xy, yy = 0.0, 0.0, 0.0, 0.0, 0.0
    for p in range(points):
        at = nz * nz + nz + p * point_size
        w, cn, cv = value[at], value[at + 1], value[at + 2]
        theta = 0.0
        for i in range(nz):
            theta += inner[first + i] * value[at + 3 + i]
        c, s = math.cos(theta), math.sin(theta)
        if modes > 0:
            fx, fy = nx, ny
            for k in range(forces):
                mass = value[mass_at + modes * p + k]
                fx, fy = fx + mass * store[gravity_at + 3 * k], fy + mass * store[gravity_at + 3 * k + 1]
        N, V = c * fx + s * fy, c * fy - s * fx
        cn_minus_cv = cn - cv
        # r' = R (1 + cN N, cV V) and R C R^T
        a, b = w * (1.0 + cn * N), w * cv * V
        x += c * a - s * b
        y += s * a + c * b
        xx += w * (cn * c * c + cv * s * s)
        xy += w * cn_minus_cv * c * s
        yy += w * (cn * s * s + cv * c * c)
        # h', h'' and d h'/d(nx, ny)
        slope = w * (V + cn_minus_cv * N * V)
        curve = w * (cn_minus_cv * (V * V - N * N) - N)
        for k in range(forces, modes):
            mass = w * value[mass_at + modes * p + k]
            tx, ty = store[gravity_at + 3 * k], store[gravity_at + 3 * k + 1]
            slope -= mass * (c * tx + s * ty)
            curve += mass * (s * tx - c * ty)
        a, b = w * cn_minus_cv * V, w * (1.0 + cn_minus_cv * N)
        hx, hy = c * a - s * b, s * a + c * b
        for i in range(nz):
            psi = value[at + 3 + i]
            store[J + 4 * i] += hx * psi
            store[J + 4 * i + 1] += hy * psi
            store[J + 4 * i + 3] -= slope * psi
            for j in range(i + 1):
                store[W + i * nz + j] -= curve * psi * value[at + 3 + j]
    return x, y, angle, xx, xy, yy


@kernel
def _add_plate_point(value, at, nz, first, inner, store):
    """Add the energy of curling lost at a point with plate numbers value[at:] to W and g in the store."""
    curvature, bend, basis = 0.0, 0.0, at + POINT_NUMBERS
    for i in range(nz):
        curvature += inner[first + i] * value[basis + i]
        bend += (inner[first + i] - value[nz * nz + i]) * value[basis + i]
    moment, stiffness = plate_point(value, at, curvature, bend)
    for i in range(nz):
        store[4 * nz + 4 * i + 3] += moment * value[basis + i]
        for j in range(nz):
            store[8 * nz + i * nz + j] += stiffness * value[basis + i] * value[basis + j]


@kernel(inline="late")
def _solve(nz, store):
    """Write W^-1 (J, g) into the head of the store, by LDL^T in place of W (lower); return (negative pivots, status)."""
    negatives, status, J, W = 0, 0, 4 * nz, 8 * nz
    for j in range(nz):
        pivot = store[W + j * nz + j]
        before = abs(pivot)
        x, y, turn, g = store[J + 4 * j], store[J + 4 * j + 1], store[J + 4 * j + 2], store[J + 4 * j + 3]
        for c in range(j):
            l = store[W + j * nz + c]
            pivot -= l * l * store[W + c * nz + c]
            x -= l * store[4 * c]
            y -= l * store[4 * c + 1]
            turn -= l * store[4 * c + 2]
            g -= l * store[4 * c + 3]
        store[4 * j], store[4 * j + 1], store[4 * j + 2], store[4 * j + 3] = x, y, turn, g
        if not abs(pivot) > TINY_PIVOT * before:
            status = 2
        store[W + j * nz + j] = pivot
        if pivot < 0.0:
            negatives += 1
        inverse = 1.0 / pivot
        for i in range(j + 1, nz):
            t = store[W + i * nz + j]
            for c in range(j):
                t -= store[W + i * nz + c] * store[W + j * nz + c] * store[W + c * nz + c]
            store[W + i * nz + j] = t * inverse
    for j in range(nz - 1, -1, -1):
        inverse = 1.0 / store[W + j * nz + j]
        x, y, turn, g = (
            inverse * store[4 * j],
            inverse * store[4 * j + 1],
            inverse * store[4 * j + 2],
            inverse * store[4 * j + 3],
        )
        for c in range(j + 1, nz):
            l = store[W + c * nz + j]
            x -= l * store[4 * c]
            y -= l * store[4 * c + 1]
            turn -= l * store[4 * c + 2]
            g -= l * store[4 * c + 3]
        store[4 * j], store[4 * j + 1], store[4 * j + 2], store[4 * j + 3] = x, y, turn, g
    return negatives, status


@kernel
def condense(value, number, inner, store, d, Q, lam, K):
    """Condense one leaf at end pose d (3,) [m], Q (3, 3), as `ksd.elements.strain.strain_condense`; lam (12,) and K (6, 6)
    are zero out of the plane.

    Returns (negative pivots of W minus those of F, |change of n| [N], |change of m| [Nm], status).
    """
    nz, wrench = number[0], number[3]
    gap_at = 8 * nz + nz * nz
    lam[:] = 0.0
    K[:, :] = 0.0
    end0, end1, angle, f00, f01, f11 = _assemble(value, number, inner, store)
    negatives, status = _solve(nz, store)
    # F = J W^-1 J^T + L sum w R C R^T, gap = closure + J W^-1 g
    f02, f12, f22 = 0.0, 0.0, 0.0
    x, y, turn = d[0] - end0, d[1] - end1, math.atan2(Q[1, 0], Q[0, 0]) - angle
    turn -= FULL_TURN * np.rint(turn / FULL_TURN)
    for i in range(nz):
        j = 4 * nz + 4 * i
        jx, jy, jt = store[j], store[j + 1], store[j + 2]
        yx, yy, yt, yg = store[4 * i], store[4 * i + 1], store[4 * i + 2], store[4 * i + 3]
        f00 += jx * yx
        f01 += jx * yy
        f11 += jy * yy
        f02 += jx * yt
        f12 += jy * yt
        f22 += jt * yt
        x += jx * yg
        y += jy * yg
        turn += jt * yg
    # K = F^-1 by LDL^T, the moment first since its pivot is never small
    l0, l1 = f02 / f22, f12 / f22
    d0, e = f00 - l0 * f02, f01 - l0 * f12
    l2 = e / d0
    d1 = f11 - l1 * f12 - l2 * e
    if not (abs(f22) > 0.0 and abs(d0) > TINY_PIVOT * abs(f00) and abs(d1) > TINY_PIVOT * abs(f11)):
        status = 2
    for pivot in (f22, d0, d1):
        if pivot < 0.0:
            negatives -= 1
    # columns of the unit lower inverse, order (moment, x, y): rows (1), (-l0, 1), (l0 l2 - l1, -l2, 1)
    u = l0 * l2 - l1
    k00, k01, k11 = 1.0 / d0 + l2 * l2 / d1, -l2 / d1, 1.0 / d1
    k02, k12 = -l0 / d0 - l2 * u / d1, u / d1
    k22 = 1.0 / f22 + l0 * l0 / d0 + u * u / d1
    K[0, 0], K[0, 1], K[0, 5] = k00, k01, k02
    K[1, 0], K[1, 1], K[1, 5] = k01, k11, k12
    K[5, 0], K[5, 1], K[5, 5] = k02, k12, k22
    store[gap_at], store[gap_at + 1], store[gap_at + 2] = x, y, turn
    store[gap_at + 3], store[gap_at + 4], store[gap_at + 5] = k00, k01, k02
    store[gap_at + 6], store[gap_at + 7], store[gap_at + 8] = k11, k12, k22
    c0, c1 = k00 * x + k01 * y + k02 * turn, k01 * x + k11 * y + k12 * turn
    c2 = k02 * x + k12 * y + k22 * turn
    n0, n1, m = inner[wrench], inner[wrench + 1], inner[wrench + 5]
    lam[6], lam[7], lam[11] = n0, n1, m
    lam[0], lam[1], lam[5] = n0 + c0, n1 + c1, m + c2
    force, moment = math.sqrt(c0 * c0 + c1 * c1), abs(c2)
    if not math.isfinite(force + moment + k00):
        status = 2
    if status == 2:
        force, moment = math.inf, math.inf
    return negatives, force, moment, status


@kernel
def gravity_block(value, number, inner, store, lam):
    """Write the gravity block of a leaf with weight or inertia after `condense`, zero out of the plane; nothing without.

    As `ksd.elements.strain.strain_gravity_block`. With B = int M S, S = R C R^T, and Z = J W^-1 eta + B (force rows):
    V_xi,g = -K Z, V_g,g = Z^T K Z - eta W^-1 eta - int M^2 S. For several modes g has as many pairs of components.
    """
    nz, points, first, wrench = number[0], number[1], number[2], number[3]
    J, W, gap_at = 4 * nz, 8 * nz, 8 * nz + nz * nz
    eta, masses = gap_at + 9, nz * nz + 2 * nz + points * (3 + nz) + number[4] * (POINT_NUMBERS + nz)
    if len(store) == eta:
        return
    forces, modes, block_size = mode_counts(number, True)
    block_at, D, n = len(store) - block_size, 3 * modes, 2 * modes
    # one row per amplitude: eta, then W^-1 eta
    Y = store[eta : eta + 2 * n * nz].reshape(nz, 2 * n)
    Z, G, s = np.zeros((3, n)), np.zeros((n, n)), np.zeros(n)
    Y[:, :] = 0.0
    for p in range(points):
        at, mass_at, theta = nz * nz + nz + p * (3 + nz), masses + modes * p, 0.0
        weight, cn, cv = value[at], value[at + 1], value[at + 2]
        for i in range(nz):
            theta += inner[first + i] * value[at + 3 + i]
        c, sine = math.cos(theta), math.sin(theta)
        fx, fy = inner[wrench], inner[wrench + 1]
        for k in range(forces):
            mass = value[mass_at + k]
            fx, fy = fx + mass * store[block_at + 3 * k], fy + mass * store[block_at + 3 * k + 1]
        N, V, cn_minus_cv = c * fx + sine * fy, c * fy - sine * fx, cn - cv
        xx, xy, yy = cn * c * c + cv * sine * sine, cn_minus_cv * c * sine, cn * sine * sine + cv * c * c
        # r', and its derivative by the angle
        a, b = 1.0 + cn * N, cv * V
        rx, ry = c * a - sine * b, sine * a + c * b
        a, b = cn_minus_cv * V, 1.0 + cn_minus_cv * N
        hx, hy = c * a - sine * b, sine * a + c * b
        for k in range(modes):
            w, u, v = weight * value[mass_at + k], 2 * k, 2 * k + 1
            if k < forces:
                s[u] += w * rx
                s[v] += w * ry
                Z[0, u] += w * xx
                Z[0, v] += w * xy
                Z[1, u] += w * xy
                Z[1, v] += w * yy
                for l in range(k + 1):
                    t = w * value[mass_at + l]
                    G[u, 2 * l] += t * xx
                    G[u, 2 * l + 1] += t * xy
                    G[v, 2 * l] += t * xy
                    G[v, 2 * l + 1] += t * yy
                a, b = w * hx, w * hy
            else:
                s[u] -= w * sine
                s[v] += w * c
                a, b = -w * c, -w * sine
            for i in range(nz):
                psi = value[at + 3 + i]
                Y[i, u] += a * psi
                Y[i, v] += b * psi
    # W^-1 eta, by the factors `condense` leaves
    for i in range(nz):
        for j in range(n):
            Y[i, n + j] = Y[i, j]
        for c in range(i):
            l = store[W + i * nz + c]
            for j in range(n):
                Y[i, n + j] -= l * Y[c, n + j]
    for i in range(nz - 1, -1, -1):
        inverse = 1.0 / store[W + i * nz + i]
        for j in range(n):
            Y[i, n + j] *= inverse
        for c in range(i + 1, nz):
            l = store[W + c * nz + i]
            for j in range(n):
                Y[i, n + j] -= l * Y[c, n + j]
    for r in range(D, block_size):
        store[block_at + r] = 0.0
    for j in range(n):
        store[block_at + 2 * D + 3 * (j // 2) + j % 2] = s[j]
    for i in range(nz):
        g, x, y, turn = store[4 * i + 3], store[J + 4 * i], store[J + 4 * i + 1], store[J + 4 * i + 2]
        for j in range(n):
            t = Y[i, n + j]
            s[j] -= g * Y[i, j]
            Z[0, j] += x * t
            Z[1, j] += y * t
            Z[2, j] += turn * t
        for r in range(n):
            t = Y[i, r]
            for j in range(r + 1):
                G[r, j] += t * Y[i, n + j]
    k00, k01, k02 = store[gap_at + 3], store[gap_at + 4], store[gap_at + 5]
    k11, k12, k22 = store[gap_at + 6], store[gap_at + 7], store[gap_at + 8]
    # x, y, rz among the six of the wrench
    d0, d1, d2 = lam[0] - lam[6], lam[1] - lam[7], lam[5] - lam[11]
    rows, last = block_at + 3 * D, block_at + 9 * D
    for j in range(n):
        to = 3 * (j // 2) + j % 2
        x, y, turn = Z[0, j], Z[1, j], Z[2, j]
        store[block_at + D + to] = s[j] + x * d0 + y * d1 + turn * d2
        a, b, c = (
            k00 * x + k01 * y + k02 * turn,
            k01 * x + k11 * y + k12 * turn,
            k02 * x + k12 * y + k22 * turn,
        )
        store[rows + to], store[rows + D + to] = -a, -b
        store[rows + 5 * D + to] = -c
        for r in range(j, n):
            of = 3 * (r // 2) + r % 2
            t = Z[0, r] * a + Z[1, r] * b + Z[2, r] * c - G[r, j]
            store[last + D * of + to], store[last + D * to + of] = t, t


@kernel
def recover(value, number, inner, store, xi, scale):
    """Add dlam = K (xi + gap) and da = W^-1 (J^T dlam - g), times `scale`, after end q moved by xi (6,) in frame p."""
    nz, first, wrench = number[0], number[2], number[3]
    gap_at = 8 * nz + nz * nz
    _, modes, block_size = mode_counts(number, len(store) > gap_at + 9)
    block_at, D = len(store) - block_size, 3 * modes
    x, y, turn = xi[0] + store[gap_at], xi[1] + store[gap_at + 1], xi[5] + store[gap_at + 2]
    k00, k01, k02 = store[gap_at + 3], store[gap_at + 4], store[gap_at + 5]
    k11, k12, k22 = store[gap_at + 6], store[gap_at + 7], store[gap_at + 8]
    d0, d1, d2 = (
        k00 * x + k01 * y + k02 * turn,
        k01 * x + k11 * y + k12 * turn,
        k02 * x + k12 * y + k22 * turn,
    )
    change, rows = block_at + 9 * D + D * D, block_at + 3 * D
    for k in range(modes):
        # the change of gravity in frame p
        g0, g1, at = store[change + 3 * k], store[change + 3 * k + 1], rows + 3 * k
        d0 += store[at] * g0 + store[at + 1] * g1
        d1 += store[at + D] * g0 + store[at + D + 1] * g1
        d2 += store[at + 5 * D] * g0 + store[at + 5 * D + 1] * g1
    for i in range(nz):
        t = store[4 * i] * d0 + store[4 * i + 1] * d1 + store[4 * i + 2] * d2 - store[4 * i + 3]
        for k in range(modes):
            own = gap_at + 9 + 4 * modes * i + 2 * (modes + k)
            t += store[own] * store[change + 3 * k] + store[own + 1] * store[change + 3 * k + 1]
        inner[first + i] += scale * t
    inner[wrench] += scale * d0
    inner[wrench + 1] += scale * d1
    inner[wrench + 5] += scale * d2


@kernel
def strain_energy(value, number, inner, store):
    """Strain energy [J] of a leaf at a state at which its gravity block was set, without plate stiffening."""
    nz, points, first, wrench = number[0], number[1], number[2], number[3]
    forces, modes, block_size = mode_counts(number, len(store) > 8 * nz + nz * nz + 9)
    energy, block_at = 0.0, len(store) - block_size
    masses = nz * nz + 2 * nz + points * (3 + nz) + number[4] * (POINT_NUMBERS + nz)
    for i in range(nz):
        for j in range(nz):
            a, b = inner[first + i] - value[nz * nz + i], inner[first + j] - value[nz * nz + j]
            energy += 0.5 * a * value[i * nz + j] * b
    for p in range(points):
        at, theta = nz * nz + nz + p * (3 + nz), 0.0
        for i in range(nz):
            theta += inner[first + i] * value[at + 3 + i]
        fx, fy = inner[wrench], inner[wrench + 1]
        for k in range(forces):
            mass = value[masses + modes * p + k]
            fx, fy = fx + mass * store[block_at + 3 * k], fy + mass * store[block_at + 3 * k + 1]
        c, s = math.cos(theta), math.sin(theta)
        N, V = c * fx + s * fy, c * fy - s * fx
        energy += 0.5 * value[at] * (value[at + 1] * N * N + value[at + 2] * V * V)
    return energy


def store_size(nz: int, *, modes: int = 0) -> int:
    """Length of the `store` of a leaf with nz modes of weak bending and so many modes of weight and other distributed
    loads."""
    pressure = (modes > GIVEN_MODES) * PRESSURE_STORE
    return 8 * nz + nz * nz + 9 + 4 * nz * modes + 3 * modes * (10 + 3 * modes) + pressure


def planar_values(
    value: np.ndarray, number: np.ndarray, *, has_weight: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Constants and settings (value, number) from those of the spatial leaf (`ksd.elements.strain_values`), which must be
    undeformed in its plane; has_weight: with weight or other distributed loads."""
    nx, ny, nz, ng = (int(n) for n in number[:4])
    total, first = nx + ny + nz, nx + ny
    sizes = [1, nx * nx, ny * ny, nz * nz, total, ng, ng * ng, total * ng, 3 * ng, 3 * (ng + 1) * total]
    parts = [value[a:b] for a, b in pairwise(np.cumsum([0, *sizes]))]
    length, amplitudes, compliance = float(parts[0][0]), parts[4], parts[8].reshape(ng, 3)
    # psi at the points and, last, at the end
    psi = length * np.cumsum(parts[9].reshape(ng + 1, 3, total)[:, 0, first:], axis=0)
    table = np.column_stack([length * parts[5], compliance[:, 0], compliance[:, 1], psi[:-1]])
    flat = [parts[3], amplitudes[first:], table.ravel(), psi[-1]]
    if number[4]:
        flat.append(value[sum(sizes) :][: int(number[4]) * (POINT_NUMBERS + nz)])
    if has_weight:
        flat.append(value[strain_value_count(number) : strain_value_count(number, has_weight=True)])
    return np.concatenate(flat), np.array([nz, ng, first, total, *number[4:7]], np.int64)
