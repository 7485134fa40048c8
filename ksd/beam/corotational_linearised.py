"""Corotational chain linearised about given element orientations: the joint bodies of paper 1, section 3.

Layouts and statuses are those of `ksd.beam.corotational`.
"""

from __future__ import annotations

import math

from ksd.beam.corotational import end_rotation, finish, weight_from
from ksd.beam.corotational_element import (
    A_AT,
    KEPT,
    L_AT,
    N_AT,
    T_AT,
    TAIL,
    U_AT,
    V_AT,
    Z_AT,
    eliminate,
    fix_start,
    gradients,
    load_node,
    node_axes,
    stresses,
    unstressed_tangent,
)
from ksd.beam.weight import eliminate_inner, finish_chain, load_inner, start_chain
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_exp, rotation_log_below_150


@kernel(inline="late")
def _direction(v, s, tail, H):
    """H (3, 3) = exp(near), kept in `s`: chord of an undeformed element in the near configuration (paper 1, 3.2)."""
    for i in range(3):
        for j in range(3):
            H[i, j] = s[A_AT + 3 * i + j]
        s[L_AT + i] = H[i, 0] * v[7] + H[i, 1] * v[10] + H[i, 2] * v[13]
    tail[N_AT] = v[0]


@kernel(inline="late")
def _flexible_strains(v, s, tail, H, R, move):
    """e = D times the flexible displacement (3.6), move (12,): node rotations from H, gap L - L0 n_l; R (3, 3): scratch."""
    for e in range(2):
        for i in range(3):
            move[6 * e + i] = tail[12 * e + i]
            for j in range(3):
                b = 12 * e + 3 + 3 * i
                R[i, j] = tail[b] * H[j, 0] + tail[b + 1] * H[j, 1] + tail[b + 2] * H[j, 2]
        rotation_log_below_150(R, move[6 * e + 3 :])
    for i in range(6):
        s[i] = 0.0
    for i in range(3):
        u = move[6 + i] - move[i] - v[0] * s[L_AT + i]
        p, q = move[3 + i], move[9 + i]
        s[0] += s[L_AT + i] * u
        s[1] += s[T_AT + i] * (p - q)
        s[2] += s[U_AT + i] * u + s[V_AT + i] * p
        s[3] += s[U_AT + 3 + i] * u + s[V_AT + 3 + i] * q
        s[4] += s[U_AT + 6 + i] * u + s[V_AT + 6 + i] * p
        s[5] += s[U_AT + 9 + i] * u + s[V_AT + 9 + i] * q


@kernel(inline="late")
def _place_nodes(value, n, inner, store, near, d, H, x):
    """Inner nodes of the near configuration: undeformed elements chained, to x (3,), the gap at q spread linearly.

    Element orientations are kept where the element's block A will be.
    """
    for i in range(3):
        x[i] = 0.0
    for k in range(n):
        rotation_exp(near[3 * k : 3 * k + 3], H)
        v = value[16 * k : 16 * k + 16]
        for i in range(3):
            for j in range(3):
                store[KEPT * k + A_AT + 3 * i + j] = H[i, j]
        for i in range(3):
            x[i] += v[0] * (H[i, 0] * v[7] + H[i, 1] * v[10] + H[i, 2] * v[13])
            if k < n - 1:
                inner[12 * k + i] = x[i]
    for k in range(n - 1):
        rotation_exp(near[3 * (n + k) : 3 * (n + k) + 3], H)
        for i in range(3):
            inner[12 * k + i] += (d[i] - x[i]) * ((k + 1) / n)
            for j in range(3):
                inner[12 * k + 3 + 3 * i + j] = H[i, j]


@kernel
def condense_linearised(value, number, inner, store, near, d, Q, lam, K, A, M):
    """Condensed stiffness linearised in the near configuration (element orientations; paper 1, section 3).

    `near` (3 (2n-1),): rotation vectors from the undeformed state of the n elements, then of the n-1 inner
    nodes, frame of p. The elements are undeformed at these orientations; the small rest is linear, force D^T S e, tangent
    D^T S D. Sets the inner nodes and leaves `store` so that `recover` gives the deformed inner state with extrapolated
    stresses. A, M (3, 3) or more: scratch. Arguments and returns otherwise as `condense`.
    """
    n = number[0]
    tail = store[KEPT * n : KEPT * n + TAIL]
    # wrench and stiffness are scratch until the last element is done
    _place_nodes(value, n, inner, store, near, d, A, lam)
    end_rotation(value, n, Q, K)
    fix_start(tail)
    for i in range(6):
        tail[Z_AT + i] = 0.0
    coupled, pulled = weight_from(n, store)
    mass, pull, spread = value[16 * n + 9 :], store[pulled:], store[coupled:pulled]
    if len(pull) > 0:
        start_chain(mass, n, pull, spread)
    negatives, folded, lost = 0, False, False
    force = moment = 0.0
    for k in range(n):
        v = value[16 * k : 16 * k + 16]
        s = store[KEPT * k : KEPT * k + KEPT]
        load_node(tail, inner, k if k < n - 1 else -1, d, K)
        node_axes(v, tail)
        _direction(v, s, tail, A)
        folded = folded or gradients(v[0], s, tail) != 0
        _flexible_strains(v, s, tail, A, M, lam)
        stresses(v, s, tail)
        if k > 0 and len(pull) > 0:
            load_inner(mass[k], pull, tail)
        rf, rm = unstressed_tangent(v, s, tail, k == 0)
        if k > 0:
            force, moment = max(force, rf), max(moment, rm)
            found = eliminate(s, tail)
            lost = lost or found < 0
            negatives += found
            if len(pull) > 0:
                eliminate_inner(
                    mass[k], s, pull, spread[18 * k : 18 * k + 18], spread[18 * k + 18 : 18 * k + 36]
                )
        if k == n - 1:
            ef, em = finish(s, tail, lam, K)
            force, moment = max(force, ef), max(moment, em)
            if len(pull) > 0:
                finish_chain(mass, n, pull, spread[18 * n : 18 * n + 18], d, Q, lam, K)
    if folded:
        return negatives, math.inf, math.inf, 1
    sound = not lost and math.isfinite(force + moment + lam[0] + K[0, 0])
    return negatives, math.sqrt(force), math.sqrt(moment), 0 if sound else 2
