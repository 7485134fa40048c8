"""Planar corotational Timoshenko chain: paper 1, Appendix A, restricted to a plane, with exact angles.

The planar twin of `ksd.beam.corotational`: end p at the origin, unrotated; end q at pose (x, y, angle) in
the frame of p, angle measured from the undeformed leaf's p axis. Three strains per element, in the scaling
of A.4: eps1 = |L| - L0, eps5 = L0 (chord - angle at p), eps6 = L0 (angle at q - chord). The angles come
from atan2 and not from asin, so nothing folds; beyond 60 degrees the element is refused all the same.

Arrays (float64, SI): `value` holds n records (L0, S1, S4a, S4b, undeformed chord angle) and the undeformed
angle of end q; `inner` holds n-1 nodes (x, y, rotation from the undeformed state), then n x 3 stresses for
the geometric stiffness (MIP); `number` = [n, 1 for MIP or 0 for plain Newton]; `store` is kept for
`recover`. A chain with weight has its masses after that in `value` (n+1 lumps [kg], first moments of the end
lumps in their frames 2 + 2 [kg m]) and a longer `store`: couplings of the nodes with gravity (n+1, 3, 2), then
the pull of `ksd.beam.weight`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ksd.beam.corotational_values import SectionNumbers, stiffness_numbers
from ksd.beam.weight import PLANAR_PULL
from ksd.numerics.kernel import kernel

Array = NDArray[np.float64]

RECORD = 5
"""Numbers per element in `value`."""
KEPT = 24
"""Numbers per element in `store`: eps 3, l 2, |L|, L 3, 1/D 3, coupling and residual 3 x 4."""
TURN = 2.0 * math.pi
LIMIT = math.pi / 3.0
TINY_PIVOT = 1e-14


@kernel
def _strains(v, s, move):
    """Strains and chord of one element, `move` = nodes p, q (x, y, angle); returns 1 beyond 60 degrees."""
    x, y = move[3] - move[0], move[4] - move[1]
    n = math.sqrt(x * x + y * y)
    base = v[4] + move[2]
    c, r = math.cos(base), math.sin(base)
    at_p = math.atan2(c * y - r * x, c * x + r * y)
    at_q = at_p + move[2] - move[5]
    at_q -= TURN * round(at_q / TURN)
    s[0], s[1], s[2] = n - v[0], v[0] * at_p, -v[0] * at_q
    s[3], s[4], s[5] = x / n, y / n, n
    if not (abs(at_p) <= LIMIT and abs(at_q) <= LIMIT):
        return 1 if math.isfinite(at_p + at_q) else 2
    return 0


@kernel
def _nodes(value, n, inner, pose, k, move):
    """Poses of both nodes of element k into `move` (6,), end q as rotation from the undeformed state."""
    for i in range(3):
        move[i] = inner[3 * k - 3 + i] if k > 0 else 0.0
        move[3 + i] = inner[3 * k + i] if k < n - 1 else pose[i]
    if k == n - 1:
        move[5] -= value[RECORD * n]


@kernel
def ready_weight(value, n, store):
    """Masses (n+5,), couplings and pull of a chain with weight, made ready; empty arrays for one without."""
    at = KEPT * n + 6
    if len(store) == at:
        return value[:0], store[:0], store[:0]
    mass, pull = value[RECORD * n + 1 : RECORD * n + n + 6], store[len(store) - PLANAR_PULL :]
    for r in range(2):
        pull[2 + r] = pull[4 + r] = mass[n + 1 + r]
    for r in range(6, 16):
        pull[r] = 0.0
    spread = store[at : len(store) - PLANAR_PULL]
    spread[:] = 0.0
    return mass, spread, pull


@kernel
def eliminate_weight(s, pull, own, carried):
    """Eliminate a node from the couplings with gravity, factors and coupling of `s`; see `ksd.beam.weight`."""
    for c in range(2):
        u0 = own[c]
        u1 = own[2 + c] - s[6] * u0
        u2 = own[4 + c] - s[7] * u0 - s[8] * u1
        own[c], own[2 + c], own[4 + c] = u0, u1, u2
        w0, w1, w2 = s[9] * u0, s[10] * u1, s[11] * u2
        for i in range(3):
            carried[2 * i + c] -= s[12 + i] * w0 + s[16 + i] * w1 + s[20 + i] * w2
        pull[2 + c] += s[15] * w0 + s[19] * w1 + s[23] * w2
    for i in range(2):
        for c in range(2):
            for r in range(3):
                pull[12 + 2 * i + c] -= own[2 * r + i] * s[9 + r] * own[2 * r + c]


@kernel
def finish_weight(mass, n, pull, carried, pose, turned, lam, K):
    """The lump at end q, turned by `turned` [rad], into lam, K and the pull."""
    m, g0, g1 = mass[n], pull[0], pull[1]
    c, s = math.cos(turned), math.sin(turned)
    x, y = c * mass[n + 3] - s * mass[n + 4], s * mass[n + 3] + c * mass[n + 4]
    for o in range(0, len(lam), 3):
        lam[o] -= m * g0
        lam[o + 1] -= m * g1
        lam[o + 2] -= x * g1 - y * g0
    K[2, 2] += x * g0 + y * g1
    for r in range(6):
        pull[6 + r] = carried[r]
    for o in (2, 4):
        pull[o] += m * pose[0] + x
        pull[o + 1] += m * pose[1] + y
    # -m I, and the moment -(x g1 - y g0) of a change of g
    pull[6] -= m
    pull[9] -= m
    pull[10] += y
    pull[11] -= x


@kernel
def condense(value, number, inner, store, pose, lam, K):
    """Force and moment on end q at pose (3,) (m, m, rad) and their tangent K (3, 3), frame of p.

    lam (3,): force [N] and moment [Nm] with the linear prediction of the inner nodes; if it has 6 entries,
    the last three are those of the stresses the geometric stiffness is built from. Returns (negative pivots,
    force error N, moment error Nm, status): status 0 fine, 1 a local angle beyond 60 degrees, 2 a pivot
    vanished or a number is not finite.
    Source: paper 1 (A.4)-(A.19) in the plane, with d2|L| = m m^T/|L|, d2chord = -(l m^T + m l^T)/|L|^2.
    """
    n = number[0]
    move = store[KEPT * n : KEPT * n + 6]
    mass, spread, pull = ready_weight(value, n, store)
    heavy = len(pull) > 0
    negatives = angle = 0
    ef = em = 0.0
    # block and residual of node q, raw force of the previous element on it, and MIP force
    c00 = c01 = c02 = c11 = c12 = c22 = r0 = r1 = r2 = f0 = f1 = f2 = g0 = g1 = g2 = 0.0
    for k in range(n):
        v = value[RECORD * k : RECORD * k + RECORD]
        s = store[KEPT * k : KEPT * k + KEPT]
        _nodes(value, n, inner, pose, k, move)
        status = _strains(v, s, move)
        if status == 2:
            return negatives, math.inf, math.inf, 2
        # a large angle may pass during the iteration; only a converged state with one is refused
        angle = max(angle, status)
        L, lx, ly, size = v[0], s[3], s[4], s[5]
        a, b = v[2], v[3]
        n1, n5, n6 = v[1] * s[0], a * s[1] + b * s[2], b * s[1] + a * s[2]
        s1, s5, s6 = n1, n5, n6
        if number[1] != 0:
            at = 3 * (n - 1) + 3 * k
            s1, s5, s6 = inner[at], inner[at + 1], inner[at + 2]
        # tangent: chord l = (lx, ly), normal m = (-ly, lx)
        q = L / size
        mm = 2.0 * q * q * (a - b) + s1 / size
        lm = -q * (s5 - s6) / size
        t = -q * L * (a - b)
        k00 = v[1] * lx * lx + mm * ly * ly - 2.0 * lm * lx * ly
        k11 = v[1] * ly * ly + mm * lx * lx + 2.0 * lm * lx * ly
        k01 = (v[1] - mm) * lx * ly + lm * (lx * lx - ly * ly)
        k02, k12 = -t * ly, t * lx
        own, cross = a * L * L, -b * L * L
        # force on q and both moments
        shear = q * (n5 - n6)
        h0, h1 = n1 * lx - shear * ly, n1 * ly + shear * lx
        if k > 0:
            if heavy:
                x, y = mass[k] * pull[0], mass[k] * pull[1]
                f0, f1, r0, r1 = f0 - x, f1 - y, r0 - x, r1 - y
                for c in range(2):
                    pull[2 + c] += mass[k] * move[c]
                    pull[4 + c] += mass[k] * move[c]
            # node p: block A (from the element before) and coupling B = K_pq, residual in the fourth column
            e0, e1, e2 = f0 - h0, f1 - h1, f2 - L * n5
            ef, em = max(ef, e0 * e0 + e1 * e1), max(em, e2 * e2)
            a00, a01, a02 = c00 + k00, c01 + k01, c02 - k02
            a11, a12, a22 = c11 + k11, c12 - k12, c22 + own
            d0, d1 = r0 - h0, r1 - h1
            d2 = r2 - L * n5
            i0 = 1.0 / a00
            l10, l20 = a01 * i0, a02 * i0
            p1 = a11 - l10 * a01
            i1 = 1.0 / p1
            w = a12 - l10 * a02
            l21 = w * i1
            p2 = a22 - l20 * a02 - l21 * w
            i2 = 1.0 / p2
            tiny = abs(p1) > TINY_PIVOT * abs(a11) and abs(p2) > TINY_PIVOT * abs(a22)
            if not (tiny and abs(a00) > 0.0):
                return negatives, math.inf, math.inf, 2
            negatives += (a00 < 0.0) + (p1 < 0.0) + (p2 < 0.0)
            # B <- L^-1 B
            b00, b01, b02 = -k00, -k01, -k02
            b10, b11, b12 = -k01 - l10 * b00, -k11 - l10 * b01, -k12 - l10 * b02
            d1 -= l10 * d0
            b20 = k02 - l20 * b00 - l21 * b10
            b21 = k12 - l20 * b01 - l21 * b11
            b22 = cross - l20 * b02 - l21 * b12
            d2 -= l20 * d0 + l21 * d1
            s[6], s[7], s[8], s[9], s[10], s[11] = l10, l20, l21, i0, i1, i2
            s[12], s[13], s[14], s[15] = b00, b01, b02, d0
            s[16], s[17], s[18], s[19] = b10, b11, b12, d1
            s[20], s[21], s[22], s[23] = b20, b21, b22, d2
            if heavy:
                spread[6 * k] -= mass[k]
                spread[6 * k + 3] -= mass[k]
                eliminate_weight(s, pull, spread[6 * k : 6 * k + 6], spread[6 * k + 6 : 6 * k + 12])
            # C = K_qq - B^T D^-1 B
            x0, x1, x2 = i0 * b00, i1 * b10, i2 * b20
            y0, y1, y2 = i0 * b01, i1 * b11, i2 * b21
            z0, z1, z2 = i0 * b02, i1 * b12, i2 * b22
            c00 = k00 - (x0 * b00 + x1 * b10 + x2 * b20)
            c01 = k01 - (x0 * b01 + x1 * b11 + x2 * b21)
            c02 = k02 - (x0 * b02 + x1 * b12 + x2 * b22)
            c11 = k11 - (y0 * b01 + y1 * b11 + y2 * b21)
            c12 = k12 - (y0 * b02 + y1 * b12 + y2 * b22)
            c22 = own - (z0 * b02 + z1 * b12 + z2 * b22)
            r0 = h0 - (x0 * d0 + x1 * d1 + x2 * d2)
            r1 = h1 - (y0 * d0 + y1 * d1 + y2 * d2)
            r2 = L * n6 - (z0 * d0 + z1 * d1 + z2 * d2)
        else:
            c00, c01, c02, c11, c12, c22 = k00, k01, k02, k11, k12, own
            r0, r1, r2 = h0, h1, L * n6
        f0, f1, f2 = h0, h1, L * n6
        shear = q * (s5 - s6)
        g0, g1, g2 = s1 * lx - shear * ly, s1 * ly + shear * lx, L * s6
    lam[0], lam[1], lam[2] = r0, r1, r2
    if len(lam) >= 6:
        lam[3], lam[4], lam[5] = g0, g1, g2
    K[0, 0], K[0, 1], K[0, 2] = c00, c01, c02
    K[1, 0], K[1, 1], K[1, 2] = c01, c11, c12
    K[2, 0], K[2, 1], K[2, 2] = c02, c12, c22
    if heavy:
        finish_weight(mass, n, pull, spread[6 * n : 6 * n + 6], pose, pose[2], lam, K)
    ef = math.sqrt(max(ef, (r0 - f0) ** 2 + (r1 - f1) ** 2))
    em = max(math.sqrt(em), abs(r2 - f2))
    return negatives, ef, em, angle if math.isfinite(ef + em + r0 + c00) else 2


@kernel
def recover(value, number, inner, store, xi, scale):
    """Move the inner nodes after end q moved by xi (3,) (m, m, rad); the whole update times `scale`.

    The stresses of the geometric stiffness are extrapolated, S (eps + scale D dq).
    """
    n = number[0]
    q0, q1, q2 = xi[0], xi[1], xi[2]
    heavy = len(store) > KEPT * n + 6
    g0 = g1 = 0.0
    if heavy:
        g0, g1 = store[len(store) - 2], store[len(store) - 1]
    for k in range(n - 1, -1, -1):
        v = value[RECORD * k : RECORD * k + RECORD]
        s = store[KEPT * k : KEPT * k + KEPT]
        p0 = p1 = p2 = 0.0
        if k > 0:
            u0, u1, u2 = s[15], s[19], s[23]
            if heavy:
                own = store[KEPT * n + 6 + 6 * k : KEPT * n + 12 + 6 * k]
                u0 += own[0] * g0 + own[1] * g1
                u1 += own[2] * g0 + own[3] * g1
                u2 += own[4] * g0 + own[5] * g1
            p2 = -s[11] * (s[20] * q0 + s[21] * q1 + s[22] * q2 + u2)
            p1 = -s[10] * (s[16] * q0 + s[17] * q1 + s[18] * q2 + u1) - s[8] * p2
            p0 = -s[9] * (s[12] * q0 + s[13] * q1 + s[14] * q2 + u0) - s[6] * p1 - s[7] * p2
            inner[3 * k - 3] += scale * p0
            inner[3 * k - 2] += scale * p1
            inner[3 * k - 1] += scale * p2
        u0, u1 = q0 - p0, q1 - p1
        turn = (s[3] * u1 - s[4] * u0) / s[5]
        e1 = s[0] + scale * (s[3] * u0 + s[4] * u1)
        e5 = s[1] + scale * v[0] * (turn - p2)
        e6 = s[2] + scale * v[0] * (q2 - turn)
        at = 3 * (n - 1) + 3 * k
        inner[at] = v[1] * e1
        inner[at + 1] = v[2] * e5 + v[3] * e6
        inner[at + 2] = v[3] * e5 + v[2] * e6
        q0, q1, q2 = p0, p1, p2


@kernel
def energy(value, number, inner, pose):
    """Strain energy [J] with end q at pose (3,)."""
    n = number[0]
    s, move = np.empty(6), np.empty(6)
    total = 0.0
    for k in range(n):
        v = value[RECORD * k : RECORD * k + RECORD]
        _nodes(value, n, inner, pose, k, move)
        _strains(v, s, move)
        total += 0.5 * (v[1] * s[0] ** 2 + v[2] * (s[1] ** 2 + s[2] ** 2)) + v[3] * s[1] * s[2]
    return total


@kernel
def section_forces(value, number, inner, pose, out):
    """Section forces out (n, 2, 3): N, Vy [N], Mz [Nm] at ends p and q of each element, chord axes."""
    n = number[0]
    s, move = np.empty(6), np.empty(6)
    for k in range(n):
        v = value[RECORD * k : RECORD * k + RECORD]
        _nodes(value, n, inner, pose, k, move)
        _strains(v, s, move)
        at_p, at_q = v[2] * s[1] + v[3] * s[2], v[3] * s[1] + v[2] * s[2]
        for e in range(2):
            out[k, e, 0] = v[1] * s[0]
            out[k, e, 1] = v[0] / s[5] * (at_p - at_q)
        out[k, 0, 2], out[k, 1, 2] = v[0] * at_p, v[0] * at_q


def sizes(n: int, *, heavy: bool = False) -> tuple[int, int, int]:
    """Lengths of `value`, `inner` and `store` for a chain of n elements; heavy: with weight."""
    more = 6 * (n + 1) + PLANAR_PULL if heavy else 0
    return RECORD * n + 1 + heavy * (n + 5), 3 * (n - 1) + 3 * n, KEPT * n + 6 + more


def chain_values(
    section: SectionNumbers, L: float, n: int, curve: tuple[Array, Array] | None = None
) -> Array:
    """The constants `value` (5 n + 1,) of a chain of n elements bending about the z axis of `section`.

    `curve` gives undeformed positions (n+1, 2) m and angles (n+1,) rad of the nodes of a curved leaf,
    starting at the origin with angle zero; without it the leaf is straight with length `L` m.
    Raises ValueError when n < 1 or a length is not positive.
    """
    if n < 1:
        raise ValueError(f"A leaf needs at least one element, got elements = {n}; use 2 or more for bending.")
    if curve is None:
        curve = np.column_stack([np.linspace(0.0, L, n + 1), np.zeros(n + 1)]), np.zeros(n + 1)
    positions, angles = curve
    value = np.empty(RECORD * n + 1)
    turned = 0.0
    for k in range(n):
        x, y = positions[k + 1] - positions[k]
        length = math.hypot(x, y)
        if not length > 0.0:
            raise ValueError(f"Element {k + 1} of a leaf has length {length} m; it must be positive.")
        s1, _, _, _, s4a, s4b = stiffness_numbers(section, length)
        turned += math.remainder(math.atan2(y, x) - turned, TURN)
        value[RECORD * k : RECORD * (k + 1)] = length, s1, s4a, s4b, turned
    value[RECORD * n] = angles[n]
    return value


def start_inner(value: Array, number: NDArray[np.int64]) -> Array:
    """The undeformed inner state (3 (n-1) + 3 n,): nodes on the undeformed leaf, unrotated, unstressed."""
    n = int(number[0])
    inner = np.zeros(sizes(n)[1])
    x = y = 0.0
    for k in range(n - 1):
        length, angle = value[RECORD * k], value[RECORD * k + 4]
        x, y = x + length * math.cos(angle), y + length * math.sin(angle)
        inner[3 * k : 3 * k + 2] = x, y
    return inner
