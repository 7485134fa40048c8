"""Corotational chain linearised about its near configuration, given element orientations: paper 1, section 3.

Layouts and statuses are those of `ksd.elements.corotational`.
"""

from __future__ import annotations

import math

from ksd.elements.corotational import condense_elements
from ksd.elements.corotational_element import (
    A_AT,
    ELEMENT_STORE_SIZE,
    L_AT,
    N_AT,
    T_AT,
    U_AT,
    V_AT,
    Z_AT,
    gradients,
    node_axes,
    stresses,
    unstressed_tangent,
)
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_exp, rotation_log_below_150


@kernel(inline="late")
def _set_chord(v, s, tail, H):
    """Write H (3, 3) = exp(near), stored in `s`, and the chord of an undeformed element with this orientation (paper 1,
    3.2)."""
    for i in range(3):
        for j in range(3):
            H[i, j] = s[A_AT + 3 * i + j]
        s[L_AT + i] = H[i, 0] * v[7] + H[i, 1] * v[10] + H[i, 2] * v[13]
    tail[N_AT] = v[0]


@kernel(inline="late")
def _flexible_strains(v, s, tail, H, R, move):
    """Strains e = D times the flexible displacement (3.6) of an element.

    move (12,): node rotations relative to H and the gap L - L0 n_l of the chord; R (3, 3): scratch.
    """
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
    """Inner nodes of the near configuration: undeformed elements chained; the gap at end q is spread linearly over the
    nodes.

    x (3,): end of that chain. Element orientations are stored where block A of each element will be.
    """
    for i in range(3):
        x[i] = 0.0
    for k in range(n):
        rotation_exp(near[3 * k : 3 * k + 3], H)
        v = value[16 * k : 16 * k + 16]
        for i in range(3):
            for j in range(3):
                store[ELEMENT_STORE_SIZE * k + A_AT + 3 * i + j] = H[i, j]
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


@kernel(inline="late")
def _set_element(v, s, tail, mip, sigma, H, R, move):
    """Strains and stresses of an element linearised about its orientation; returns the status. H, R (3, 3), move (12,):
    scratch; mip, sigma: unused."""
    node_axes(v, tail)
    _set_chord(v, s, tail, H)
    status = gradients(v[0], s, tail)
    _flexible_strains(v, s, tail, H, R, move)
    stresses(v, s, tail)
    for i in range(6):
        tail[Z_AT + i] = 0.0
    return status


@kernel
def condense_linearised(value, number, inner, store, near, d, Q, lam, K, A, M):
    """Condensed stiffness linearised in the near configuration (paper 1, section 3).

    `near` (3 (2n-1),): rotation vectors from the undeformed state of the n elements, then of the n-1 inner nodes, frame
    of p. The elements are undeformed at these orientations; the small remainder is linear, force D^T S e, tangent D^T S
    D. Sets the inner nodes and leaves `store` so that `recover` gives the deformed inner state with extrapolated
    stresses. A, M (3, 3) or larger: scratch. Other arguments and returns as `condense`.
    """
    _place_nodes(value, number[0], inner, store, near, d, A, lam)
    negatives, force, moment, is_folded, is_regular = condense_elements(
        _set_element, unstressed_tangent, value, number, inner, store, d, Q, lam, K, A, M
    )
    if is_folded != 0:
        return negatives, math.inf, math.inf, 1
    return negatives, math.sqrt(force), math.sqrt(moment), 0 if is_regular else 2
