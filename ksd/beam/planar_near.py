"""A planar chain linearised about known element orientations: paper 1, section 3, restricted to a plane.

The planar twin of `ksd.beam.corotational.near_condense`: elements lie undeformed at their orientations, the gap at end
q is spread linearly over the inner nodes, the small rest is linear: force D^T S e, tangent D^T S D. `store` is left as
`ksd.beam.planar_corotational.condense` leaves it, so that its `recover` gives the deformed inner state.
"""

from __future__ import annotations

import math

from ksd.beam.planar_corotational import (
    KEPT,
    RECORD,
    TURN,
    eliminate_weight,
    finish_weight,
    ready_weight,
)
from ksd.numerics.kernel import kernel
from ksd.numerics.local import local_matrix, local_vector


@kernel
def _place(value, n, inner, near, pose):
    """Inner nodes (x, y, rotation): undeformed elements chained at `near`, the gap at end q spread linearly."""
    x = y = 0.0
    for k in range(n):
        angle = value[RECORD * k + 4] + near[k]
        x += value[RECORD * k] * math.cos(angle)
        y += value[RECORD * k] * math.sin(angle)
        if k < n - 1:
            inner[3 * k], inner[3 * k + 1], inner[3 * k + 2] = x, y, near[n + k]
    for k in range(n - 1):
        inner[3 * k] += (pose[0] - x) * (k + 1) / n
        inner[3 * k + 1] += (pose[1] - y) * (k + 1) / n


@kernel
def _element(v, s, angle, p, q, S, force):
    """Small strains about chord `angle` (into s), force (2,) on q and both moments, tangent S (5,) of element `v`.

    p, q (3,): poses of its nodes, angles from the undeformed state. S = k00, k01, k11 of the force, then its coupling
    with either turn (two numbers).
    """
    L = v[0]
    lx, ly = math.cos(angle), math.sin(angle)
    u0, u1 = q[0] - p[0] - L * lx, q[1] - p[1] - L * ly
    turn = lx * u1 - ly * u0
    base = angle - v[4]
    tp, tq = p[2] - base, q[2] - base
    tp -= TURN * round(tp / TURN)
    tq -= TURN * round(tq / TURN)
    s[0], s[1], s[2] = lx * u0 + ly * u1, turn - L * tp, L * tq - turn
    s[3], s[4], s[5] = lx, ly, L
    a, b = v[2], v[3]
    n1, n5, n6 = v[1] * s[0], a * s[1] + b * s[2], b * s[1] + a * s[2]
    mm, t = 2.0 * (a - b), -L * (a - b)
    S[0], S[1], S[2] = v[1] * lx * lx + mm * ly * ly, (v[1] - mm) * lx * ly, v[1] * ly * ly + mm * lx * lx
    S[3], S[4] = -t * ly, t * lx
    force[0], force[1] = n1 * lx - (n5 - n6) * ly, n1 * ly + (n5 - n6) * lx
    force[2], force[3] = L * n5, L * n6


@kernel
def near_condense(value, number, inner, store, near, pose, lam, K):
    """Force, moment and stiffness linearised at the orientations near (2n-1,): n elements, then n-1 inner nodes [rad].

    From the undeformed state, frame of p; without geometric stiffness, as in the paper, so lam[3:6] is zero. Returns
    as `ksd.beam.planar_corotational.condense`.
    """
    n = number[0]
    C, A, B = local_matrix(3, 3), local_matrix(3, 3), local_matrix(3, 3)
    S, f, before, r, e = local_vector(5), local_vector(4), local_vector(3), local_vector(3), local_vector(3)
    p, q = local_vector(3), local_vector(3)
    for i in range(3):
        before[i] = r[i] = 0.0
        for j in range(3):
            C[i, j] = 0.0
    _place(value, n, inner, near, pose)
    mass, spread, pull = ready_weight(value, n, store)
    heavy = len(pull) > 0
    negatives, worst_f, worst_m = 0, 0.0, 0.0
    for k in range(n):
        v, s = value[RECORD * k : RECORD * k + RECORD], store[KEPT * k : KEPT * k + KEPT]
        for i in range(3):
            p[i] = inner[3 * k - 3 + i] if k > 0 else 0.0
            q[i] = inner[3 * k + i] if k < n - 1 else pose[i]
        if k == n - 1:
            q[2] -= value[RECORD * n]
        _element(v, s, v[4] + near[k], p, q, S, f)
        own, cross = v[2] * v[0] * v[0], -v[3] * v[0] * v[0]
        if k > 0:
            # node p: block A from both elements, coupling B = K_pq, residual e in the fourth column
            A[0, 0], A[1, 1], A[2, 2] = C[0, 0] + S[0], C[1, 1] + S[2], C[2, 2] + own
            A[1, 0], A[2, 0], A[2, 1] = C[0, 1] + S[1], C[0, 2] - S[3], C[1, 2] - S[4]
            B[0, 0], B[0, 1], B[0, 2] = -S[0], -S[1], -S[3]
            B[1, 0], B[1, 1], B[1, 2] = -S[1], -S[2], -S[4]
            B[2, 0], B[2, 1], B[2, 2] = S[3], S[4], cross
            if heavy:
                for c in range(2):
                    before[c] -= mass[k] * pull[c]
                    r[c] -= mass[k] * pull[c]
                    pull[2 + c] += mass[k] * p[c]
                    pull[4 + c] += mass[k] * p[c]
            e[0], e[1], e[2] = r[0] - f[0], r[1] - f[1], r[2] - f[2]
            raw0, raw1, raw2 = before[0] - f[0], before[1] - f[1], before[2] - f[2]
            worst_f, worst_m = max(worst_f, raw0 * raw0 + raw1 * raw1), max(worst_m, abs(raw2))
            # A = L D L^T, B and e <- L^-1 of themselves
            l10, l20 = A[1, 0] / A[0, 0], A[2, 0] / A[0, 0]
            d1 = A[1, 1] - l10 * A[1, 0]
            w = A[2, 1] - l20 * A[1, 0]
            l21 = w / d1
            d2 = A[2, 2] - l20 * A[2, 0] - l21 * w
            if not (abs(A[0, 0]) > 0.0 and abs(d1) > 0.0 and abs(d2) > 0.0):
                return negatives, math.inf, math.inf, 2
            negatives += (A[0, 0] < 0.0) + (d1 < 0.0) + (d2 < 0.0)
            e[1] -= l10 * e[0]
            e[2] -= l20 * e[0] + l21 * e[1]
            for j in range(3):
                B[1, j] -= l10 * B[0, j]
                B[2, j] -= l20 * B[0, j] + l21 * B[1, j]
            i0, i1, i2 = 1.0 / A[0, 0], 1.0 / d1, 1.0 / d2
            s[6], s[7], s[8], s[9], s[10], s[11] = l10, l20, l21, i0, i1, i2
            for i in range(3):
                for j in range(3):
                    s[12 + 4 * i + j] = B[i, j]
                s[15 + 4 * i] = e[i]
            if heavy:
                spread[6 * k] -= mass[k]
                spread[6 * k + 3] -= mass[k]
                eliminate_weight(s, pull, spread[6 * k : 6 * k + 6], spread[6 * k + 6 : 6 * k + 12])
            for i in range(3):
                r[i] = -(i0 * B[0, i] * e[0] + i1 * B[1, i] * e[1] + i2 * B[2, i] * e[2])
                for j in range(3):
                    C[i, j] = -(i0 * B[0, i] * B[0, j] + i1 * B[1, i] * B[1, j] + i2 * B[2, i] * B[2, j])
        C[0, 0] += S[0]
        C[0, 1] += S[1]
        C[1, 1] += S[2]
        C[0, 2] += S[3]
        C[1, 2] += S[4]
        C[2, 2] += own
        before[0], before[1], before[2] = f[0], f[1], f[3]
        for i in range(3):
            r[i] += before[i]
    for i in range(3):
        lam[i] = r[i]
        lam[3 + i] = 0.0
        for j in range(3):
            K[i, j] = C[min(i, j), max(i, j)]
    if heavy:
        finish_weight(mass, n, pull, spread[6 * n : 6 * n + 6], pose, pose[2], lam, K)
    force = math.sqrt(max(worst_f, (r[0] - before[0]) ** 2 + (r[1] - before[1]) ** 2))
    moment = max(worst_m, abs(r[2] - before[2]))
    return negatives, force, moment, 0 if math.isfinite(force + moment + r[0] + C[0, 0]) else 2
