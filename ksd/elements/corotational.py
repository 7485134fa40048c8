"""Corotational Timoshenko chain: paper 1, Appendix A, with corrections 2, 3 and 7 of the errata.

A leaf is a chain of n two-node elements between end frame p (origin, identity) and end frame q (position d, orientation
Q); everything is in the frame of end p. Each element has six strains (A.4); its force is D^T S eps (A.18) and its
tangent D^T S D + sum sigma_i d2eps_i in the symmetric chart R <- exp(dphi) R. With mixed integration points (MIP) sigma
of the second term is extrapolated in the previous iteration; otherwise it is S eps. The inner nodes are eliminated by a
6x6 block sweep from p to q, so the cost is linear in n.

Arrays (float64, SI): `value` holds n records of 16 (L0, S1, S2, S3a, S3b, S4a, S4b, T (9, row-major, columns n_x n_y
n_z)) and the undeformed orientation Q0 (9) of end q; `inner` holds n-1 nodes of 12 (position 3, rotation from the
undeformed state 9, row-major), then n x 6 stresses; `number` = [n, 1 for MIP or 0 for plain Newton]; `store` passes
data from `condense` to `recover`. `ksd.elements.corotational_values` makes them. A chain with weight has its lumped
masses after that in `value` and a longer `store`: see `ksd.elements.weight`.

Compiled code raises nothing; status is 0 (fine), 1 (a local angle beyond 60 degrees, short of the 90 degrees where asin
in A.4 folds back), 2 (a pivot vanished or a number is not finite).
"""

from __future__ import annotations

import math

import numpy as np

from ksd.elements.corotational_element import (
    A_AT,
    B_AT,
    C_AT,
    CHAIN_SCRATCH_SIZE,
    ELEMENT_STORE_SIZE,
    L_AT,
    S_AT,
    T_AT,
    U_AT,
    V_AT,
    Z_AT,
    chord,
    eliminate,
    fix_start,
    gradients,
    load_node,
    node_axes,
    node_forces,
    strains,
    stresses,
    tangent,
)
from ksd.elements.strain_values import GRAVITY_BLOCK_SIZE
from ksd.elements.weight import (
    add_inner_weight,
    eliminate_gravity_coupling,
    finish_chain_weight,
    start_chain_weight,
)
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_factors


@kernel(inline="late")
def finish_condensation(s, tail, lam, K):
    """Write lam and K (6, 6) of end q; return the squared norms of the changes of force and moment."""
    for i in range(6):
        tail[S_AT + i] = tail[Z_AT + i]
    for i in range(3):
        force, _, at_q = node_forces(s, tail, i)
        lam[6 + i], lam[9 + i] = force, at_q
    ef = em = 0.0
    for i in range(6):
        lam[i] = tail[C_AT + 8 * i + 6]
        change = lam[i] - tail[C_AT + 8 * i + 7]
        if i < 3:
            ef += change * change
        else:
            em += change * change
        for j in range(i + 1):
            K[i, j] = K[j, i] = 0.5 * (tail[C_AT + 8 * i + j] + tail[C_AT + 8 * j + i])
    return ef, em


@kernel(inline="late")
def end_rotation(value, n, Q, R):
    """Write R (3, 3) = Q Q0^T: rotation of end q from the undeformed state."""
    Q0 = value[16 * n : 16 * n + 9]
    for i in range(3):
        for j in range(3):
            R[i, j] = Q[i, 0] * Q0[3 * j] + Q[i, 1] * Q0[3 * j + 1] + Q[i, 2] * Q0[3 * j + 2]


@kernel(inline="late")
def weight_offsets(n, store):
    """Offsets in the store of a chain of its couplings with gravity and of its gravity block; both its end without
    weight."""
    at = ELEMENT_STORE_SIZE * n + CHAIN_SCRATCH_SIZE
    return at, len(store) - GRAVITY_BLOCK_SIZE if len(store) > at else at


@kernel(inline="late")
def _strains_and_stresses(v, s, tail):
    """Strains, their gradients and stresses of the element between the loaded nodes; returns the status."""
    node_axes(v, tail)
    chord(s, tail)
    status = gradients(v[0], s, tail)
    strains(v[0], s, tail)
    stresses(v, s, tail)
    return status


@kernel(inline="late")
def _set_element(v, s, tail, mip, sigma, H, R, move):
    """Strains and stresses of the element between the loaded nodes, and the stresses of its geometric stiffness: sigma (6,)
    for MIP, else its own. Returns the status; H, R, move: unused."""
    status = _strains_and_stresses(v, s, tail)
    for i in range(6):
        tail[Z_AT + i] = sigma[i] if mip != 0 else tail[S_AT + i]
    return status


@kernel(inline="always")
def condense_elements(set_element, add_tangent, value, number, inner, store, d, Q, lam, K, H, R):
    """Condense a chain from p to q, see `condense`; set_element: kernel for the strains and stresses of an element, with
    scratch H, R (3, 3) or larger and lam; add_tangent: kernel for its force and tangent.

    Returns (negative pivots, squared force and moment errors, largest status of an element, whether it is regular).
    """
    n = number[0]
    tail = store[ELEMENT_STORE_SIZE * n : ELEMENT_STORE_SIZE * n + CHAIN_SCRATCH_SIZE]
    # K holds the rotation of end q until the last element is done
    end_rotation(value, n, Q, K)
    fix_start(tail)
    coupling_at, gravity_at = weight_offsets(n, store)
    mass, gravity, coupling = value[16 * n + 9 :], store[gravity_at:], store[coupling_at:gravity_at]
    if len(gravity) > 0:
        start_chain_weight(mass, n, gravity, coupling)
    negatives, angle, singular = 0, 0, False
    force = moment = 0.0
    for k in range(n):
        v = value[16 * k : 16 * k + 16]
        s = store[ELEMENT_STORE_SIZE * k : ELEMENT_STORE_SIZE * k + ELEMENT_STORE_SIZE]
        load_node(tail, inner, k if k < n - 1 else -1, d, K)
        # a large angle is allowed during the iteration; only a converged state with one is refused
        angle = max(angle, set_element(v, s, tail, number[1], inner[12 * (n - 1) + 6 * k :], H, R, lam))
        if k > 0 and len(gravity) > 0:
            add_inner_weight(mass[k], gravity, tail)
        rf, rm = add_tangent(v, s, tail, k == 0)
        if k > 0:
            force, moment = max(force, rf), max(moment, rm)
            element_negatives = eliminate(s, tail)
            singular = singular or element_negatives < 0
            negatives += element_negatives
            if len(gravity) > 0:
                eliminate_gravity_coupling(
                    mass[k], s, gravity, coupling[18 * k : 18 * k + 18], coupling[18 * k + 18 : 18 * k + 36]
                )
        if k == n - 1:
            ef, em = finish_condensation(s, tail, lam, K)
            force, moment = max(force, ef), max(moment, em)
            if len(gravity) > 0:
                finish_chain_weight(mass, n, gravity, coupling[18 * n : 18 * n + 18], d, Q, lam, K)
    is_regular = not singular and math.isfinite(force + moment + lam[0] + K[0, 0])
    return negatives, force, moment, angle, is_regular


@kernel
def condense(value, number, inner, store, d, Q, lam, K):
    """Force and moment on end q at d (3,) [m], orientation Q (3, 3), and their tangent K (6, 6), frame of p.

    lam (12,): 0..5 force [N] and moment [Nm] with the linear prediction of the inner nodes; 6..11 those of the stresses
    the geometric stiffness is built from, for the geometric terms of a moving end p. Returns (negative pivots, force
    error [N], moment error [Nm], status); the errors are the change of lam by the inner residual, or the largest inner
    residual if larger. Source: paper 1, (A.4)-(A.19), and errata 3 for the second derivatives.
    """
    negatives, force, moment, angle, is_regular = condense_elements(
        _set_element, tangent, value, number, inner, store, d, Q, lam, K, K, K
    )
    return negatives, math.sqrt(force), math.sqrt(moment), angle if is_regular else 2


@kernel(inline="late")
def _rotate_node(node, x, y, z):
    """Rotate a node record: R <- exp([x y z]x) R (Rodrigues)."""
    f, g = rotation_factors(x * x + y * y + z * z)
    for j in range(3):
        a, b, c = node[3 + j], node[6 + j], node[9 + j]
        u, v, w = y * c - z * b, z * a - x * c, x * b - y * a
        node[3 + j] = a + f * u + g * (y * w - z * v)
        node[6 + j] = b + f * v + g * (z * u - x * w)
        node[9 + j] = c + f * w + g * (x * v - y * u)


@kernel(inline="late")
def _extrapolate_stresses(v, s, sigma, move, scale):
    """MIP: sigma <- S (eps + scale D dq), dq = `move` (p then q, 12), at the configuration of `condense`."""
    e1, e2 = 0.0, 0.0
    e3, e4, e5, e6 = 0.0, 0.0, 0.0, 0.0
    for i in range(3):
        u = move[6 + i] - move[i]
        p, q = move[3 + i], move[9 + i]
        e1 += s[L_AT + i] * u
        e2 += s[T_AT + i] * (p - q)
        e3 += s[U_AT + i] * u + s[V_AT + i] * p
        e4 += s[U_AT + 3 + i] * u + s[V_AT + 3 + i] * q
        e5 += s[U_AT + 6 + i] * u + s[V_AT + 6 + i] * p
        e6 += s[U_AT + 9 + i] * u + s[V_AT + 9 + i] * q
    e3, e4 = s[2] + scale * e3, s[3] + scale * e4
    e5, e6 = s[4] + scale * e5, s[5] + scale * e6
    sigma[0] = v[1] * (s[0] + scale * e1)
    sigma[1] = v[2] * (s[1] + scale * e2)
    sigma[2] = v[3] * e3 + v[4] * e4
    sigma[3] = v[4] * e3 + v[3] * e4
    sigma[4] = v[5] * e5 + v[6] * e6
    sigma[5] = v[6] * e5 + v[5] * e6


@kernel
def recover(value, number, inner, store, xi, scale):
    """Move the inner nodes after end q moved by xi (6,) (translation [m], rotation [rad]; frame of p).

    The whole update is multiplied by `scale`; xi is the unscaled increment for which the tangent of the last `condense`
    was solved. The stresses of the geometric stiffness are extrapolated, S (eps + scale D dq).
    """
    n = number[0]
    at = ELEMENT_STORE_SIZE * n + CHAIN_SCRATCH_SIZE
    has_weight = len(store) > at
    move, coupling = store[ELEMENT_STORE_SIZE * n : ELEMENT_STORE_SIZE * n + 12], store[at:]
    gravity_change = store[max(at, len(store) - 3) :]
    for i in range(6):
        move[6 + i] = xi[i]
    for k in range(n - 1, -1, -1):
        v = value[16 * k : 16 * k + 16]
        s = store[ELEMENT_STORE_SIZE * k : ELEMENT_STORE_SIZE * k + ELEMENT_STORE_SIZE]
        for i in range(6):
            move[i] = 0.0
        if k > 0:
            for i in range(5, -1, -1):
                b = s[B_AT + 8 * i + 6]
                for j in range(6):
                    b += s[B_AT + 8 * i + j] * move[6 + j]
                if has_weight:
                    for j in range(3):
                        b += coupling[18 * k + 3 * i + j] * gravity_change[j]
                b *= -s[A_AT + 7 * i]
                for j in range(i + 1, 6):
                    b -= s[A_AT + 6 * i + j] * move[j]
                move[i] = b
            node = inner[12 * k - 12 : 12 * k]
            for i in range(3):
                node[i] += scale * move[i]
            _rotate_node(node, scale * move[3], scale * move[4], scale * move[5])
        at = 12 * (n - 1) + 6 * k
        _extrapolate_stresses(v, s, inner[at : at + 6], move, scale)
        for i in range(6):
            move[6 + i] = move[i]


@kernel
def energy(value, number, inner, d, Q):
    """Strain energy [J], sum of eps S eps / 2, with end q at d (3,), Q (3, 3)."""
    n = number[0]
    store = np.empty(ELEMENT_STORE_SIZE + CHAIN_SCRATCH_SIZE)
    s, tail = store[:ELEMENT_STORE_SIZE], store[ELEMENT_STORE_SIZE:]
    R = np.empty((3, 3))
    end_rotation(value, n, Q, R)
    fix_start(tail)
    total = 0.0
    for k in range(n):
        v = value[16 * k : 16 * k + 16]
        load_node(tail, inner, k if k < n - 1 else -1, d, R)
        _strains_and_stresses(v, s, tail)
        for i in range(6):
            total += 0.5 * tail[S_AT + i] * s[i]
    return total
