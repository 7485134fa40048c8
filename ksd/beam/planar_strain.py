"""Planar strain-mode leaf: one body per leaf, its curvature a sum of modes, condensed to its end frames.

The planar twin of `ksd.beam.strain`: end p at the origin, unrotated; end q at pose (x, y, angle). Unknowns
are the amplitudes a (nz,) of kappa = sum a_k B_k(s) [1/m] and lam = (nx, ny, m), force and moment on end q.
In the plane the angle is the integral of kappa, theta = sum a_k psi_k with psi_k(s) = int B_k known
beforehand, so the mixed functional 1/2 a K a - H + lam.(closure) needs one sum over the Gauss points: H = L
sum w h(theta) + m theta(L), h = N + (cN N^2 + cV V^2)/2, N + i V = (nx + i ny) exp(-i theta), whence h' = V
+ (cN - cV) N V and h'' = -N + (cN - cV)(V^2 - N^2). This is the S model of the strain-mode note restricted
to kappa_z; the integration matrix of the spatial form drops out by partial summation, which turns the modes
B_k of its residual into test functions t_k: those are the psi_k for polynomial modes, and differ from them by
the error of quadrature for the modes of a leaf with a profile. With them both forms have the same equilibria.

`value`: L, stiffness (nz, nz) [N m^3], stress-free a0 (nz), then per Gauss point: weight times L, cN =
1/EA, cV = 1/(ky G A), psi (nz), EI, B (nz), t (nz); then psi and t at the end (2 nz); of a leaf with weight
the mass beyond each point [kg]. `number` = [nz, points]. `inner` = (a, lam). With weight, N + i V of a point
is that of n + M g, `store` is longer, and its last numbers are the pull of `ksd.beam.weight`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ksd.beam.planar_strain_fields import TINY_PIVOT, follow_gravity, gather, solve
from ksd.beam.strain_values import DEFAULT_ORDERS, DEFAULT_POINTS
from ksd.beam.weight import PLANAR_PULL
from ksd.numerics.kernel import kernel
from ksd.numerics.local import local_vector

Array = NDArray[np.float64]
TURN = 2.0 * math.pi


@kernel
def condense(value, number, inner, store, pose, lam, K):
    """Force and moment on end q at pose (3,) (m, m, rad) and their tangent K (3, 3), frame of p.

    lam (3,) [N, N, Nm] = lam of the state + K (closure + J W^-1 g); with 6 entries, the last three are the
    state's, which the geometric terms use. Returns (negative pivots of W minus those of F, change of force N,
    change of moment Nm, status): 0 fine, 2 a pivot vanished or a number is not finite. Source: the S model.
    """
    nz = number[0]
    Y, J = store[: 4 * nz], store[4 * nz + 12 : 8 * nz + 12]
    W = store[8 * nz + 12 : 8 * nz + 12 + nz * nz]
    kept = store[4 * nz : 4 * nz + 12]
    light = 8 * nz + 12 + nz * nz
    heavy = len(store) > light
    pull = store[len(store) - PLANAR_PULL if heavy else light :]
    E, sums = store[light : len(store) - len(pull)], kept
    if heavy:
        # X (2 nz), E (2 nz), sums (14)
        sums = E[4 * nz : 4 * nz + 14]
        E = E[2 * nz : 4 * nz]
    gather(value, number, inner, W, J, sums, pull, E)
    if heavy:
        for r in range(6):
            kept[r] = sums[r]
    negatives, status = solve(nz, W, J, Y)
    if status != 0:
        return negatives, math.inf, math.inf, status
    # F = J W^-1 J^T + L sum w R C R^T, gap = closure + J W^-1 g
    f00, f01, f11 = kept[3], kept[4], kept[5]
    f02 = f12 = f22 = 0.0
    x, y, turn = pose[0] - kept[0], pose[1] - kept[1], pose[2] - kept[2]
    turn -= TURN * round(turn / TURN)
    for i in range(nz):
        jx, jy, jt = J[4 * i], J[4 * i + 1], J[4 * i + 2]
        yx, yy, yt, yg = Y[4 * i], Y[4 * i + 1], Y[4 * i + 2], Y[4 * i + 3]
        f00 += jx * yx
        f01 += jx * yy
        f11 += jy * yy
        f02 += jx * yt
        f12 += jy * yt
        f22 += jt * yt
        x += jx * yg
        y += jy * yg
        turn += jt * yg
    # K = F^-1 by LDL^T, the moment first: it is never small
    i2 = 1.0 / f22
    l0, l1 = f02 * i2, f12 * i2
    d0, e = f00 - l0 * f02, f01 - l0 * f12
    i0 = 1.0 / d0
    l2 = e * i0
    d1 = f11 - l1 * f12 - l2 * e
    i1 = 1.0 / d1
    if not (abs(f22) > 0.0 and abs(d0) > TINY_PIVOT * abs(f00) and abs(d1) > TINY_PIVOT * abs(f11)):
        return negatives, math.inf, math.inf, 2
    negatives -= (f22 < 0.0) + (d0 < 0.0) + (d1 < 0.0)
    # columns of the unit lower inverse, order (moment, x, y): rows (1), (-l0, 1), (l0 l2 - l1, -l2, 1)
    u = l0 * l2 - l1
    k00, k01, k11 = i0 + l2 * l2 * i1, -l2 * i1, i1
    k02, k12 = -l0 * i0 - l2 * i1 * u, u * i1
    k22 = i2 + l0 * l0 * i0 + u * u * i1
    K[0, 0], K[0, 1], K[0, 2] = k00, k01, k02
    K[1, 0], K[1, 1], K[1, 2] = k01, k11, k12
    K[2, 0], K[2, 1], K[2, 2] = k02, k12, k22
    kept[0], kept[1], kept[2] = x, y, turn
    kept[3], kept[4], kept[5], kept[6], kept[7], kept[8] = k00, k01, k02, k11, k12, k22
    c0, c1 = k00 * x + k01 * y + k02 * turn, k01 * x + k11 * y + k12 * turn
    c2 = k02 * x + k12 * y + k22 * turn
    lam[0], lam[1], lam[2] = inner[nz] + c0, inner[nz + 1] + c1, inner[nz + 2] + c2
    if len(lam) >= 6:
        lam[3], lam[4], lam[5] = inner[nz], inner[nz + 1], inner[nz + 2]
    if heavy:
        step = local_vector(3)
        step[0], step[1], step[2] = c0, c1, c2
        follow_gravity(nz, W, J, Y, K, sums, step, E, store[light : light + 2 * nz], pull)
    force, moment = math.sqrt(c0 * c0 + c1 * c1), abs(c2)
    return negatives, force, moment, 0 if math.isfinite(force + moment + k00) else 2


@kernel
def recover(value, number, inner, store, xi, scale):
    """dlam = K (xi + gap), da = W^-1 (J^T dlam - g), both times `scale`, after end q moved by xi (3,)."""
    nz = number[0]
    k = store[4 * nz : 4 * nz + 9]
    x, y, turn = xi[0] + k[0], xi[1] + k[1], xi[2] + k[2]
    d0 = k[3] * x + k[4] * y + k[5] * turn
    d1 = k[4] * x + k[6] * y + k[7] * turn
    d2 = k[5] * x + k[7] * y + k[8] * turn
    light = 8 * nz + 12 + nz * nz
    if len(store) > light:
        pull = store[len(store) - PLANAR_PULL :]
        g0, g1 = pull[16], pull[17]
        d0 += pull[6] * g0 + pull[7] * g1
        d1 += pull[8] * g0 + pull[9] * g1
        d2 += pull[10] * g0 + pull[11] * g1
        for i in range(nz):
            inner[i] += scale * (store[light + 2 * i] * g0 + store[light + 2 * i + 1] * g1)
    for i in range(nz):
        Y = store[4 * i : 4 * i + 4]
        inner[i] += scale * (Y[0] * d0 + Y[1] * d1 + Y[2] * d2 - Y[3])
    inner[nz] += scale * d0
    inner[nz + 1] += scale * d1
    inner[nz + 2] += scale * d2


@kernel
def section_forces(value, number, inner, out):
    """Section forces out (points, 3) at the Gauss points: N, V [N], M [Nm], in the axes of the section."""
    nz, points = number[0], number[1]
    for p in range(points):
        at = 1 + nz * nz + nz + p * (3 * nz + 4)
        theta = bend = 0.0
        for i in range(nz):
            theta += inner[i] * value[at + 3 + i]
            bend += (inner[i] - value[1 + nz * nz + i]) * value[at + 4 + nz + i]
        c, s = math.cos(theta), math.sin(theta)
        out[p, 0] = c * inner[nz] + s * inner[nz + 1]
        out[p, 1] = c * inner[nz + 1] - s * inner[nz]
        out[p, 2] = value[at + 3 + nz] * bend


@kernel
def energy(value, number, inner):
    """Strain energy [J]: bending 1/2 (a - a0) K (a - a0), stretch and shear 1/2 L sum w (cN N^2 + cV V^2)."""
    nz, points = number[0], number[1]
    total = 0.0
    for i in range(nz):
        for j in range(nz):
            bend = (inner[i] - value[1 + nz * nz + i]) * (inner[j] - value[1 + nz * nz + j])
            total += 0.5 * value[1 + i * nz + j] * bend
    for p in range(points):
        at = 1 + nz * nz + nz + p * (3 * nz + 4)
        theta = 0.0
        for i in range(nz):
            theta += inner[i] * value[at + 3 + i]
        c, s = math.cos(theta), math.sin(theta)
        N, V = c * inner[nz] + s * inner[nz + 1], c * inner[nz + 1] - s * inner[nz]
        total += 0.5 * value[at] * (value[at + 1] * N * N + value[at + 2] * V * V)
    return total


def sizes(nz: int, *, heavy: bool = False) -> tuple[int, int]:
    """Lengths of `inner` and `store` for nz modes; heavy: with weight."""
    return nz + 3, 8 * nz + 12 + nz * nz + heavy * (4 * nz + 14 + PLANAR_PULL)


def leaf_values(
    *,
    length: float,
    EI: float | Array,
    cN: float | Array,
    cV: float | Array,
    modes: int = DEFAULT_ORDERS[2],
    points: int = DEFAULT_POINTS,
    amplitudes: Array | None = None,
) -> tuple[Array, NDArray[np.int64]]:
    """Constants and settings (value, number) of a leaf with `modes` Legendre curvature modes.

    length [m]; EI [N m^2], cN = 1/EA and cV = 1/(ky G A) [1/N], each a number or one per Gauss point;
    amplitudes (modes,) [1/m] of the stress-free curvature, zero when None.
    Raises ValueError when the points cannot resolve the modes.
    """
    if not 1 <= modes <= points:
        raise ValueError(
            f"A leaf with {modes} curvature modes needs 1 <= modes <= points, got points = {points}."
        )
    x, w = np.polynomial.legendre.leggauss(points)
    basis = np.polynomial.legendre.legvander(x, modes - 1)
    raised = np.polynomial.legendre.legint(np.eye(modes), lbnd=-1, axis=0)
    psi = 0.5 * length * np.polynomial.legendre.legvander(x, modes) @ raised
    bending, stretch, shear = (np.broadcast_to(np.asarray(v, float), points) for v in (EI, cN, cV))
    weight = 0.5 * length * w
    stiffness = basis.T @ (basis * (weight * bending)[:, None])
    table = np.column_stack([weight, stretch, shear, psi, bending, basis, psi])
    start = np.zeros(modes) if amplitudes is None else np.asarray(amplitudes, float)
    end = np.zeros(modes)
    end[0] = length
    parts = [[length], stiffness.ravel(), start, table.ravel(), end, end]
    return np.concatenate(parts), np.array([modes, points], np.int64)


def start_inner(value: Array, number: NDArray[np.int64]) -> Array:
    """The undeformed inner state (nz + 3,): stress-free amplitudes, no wrench."""
    nz = int(number[0])
    return np.concatenate([value[1 + nz * nz : 1 + nz * nz + nz], np.zeros(3)])
