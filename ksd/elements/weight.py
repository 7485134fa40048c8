"""Weight of a leaf: its gravity block, and the weight of the inner nodes of chains.

A dead distributed load keeps its direction in space, so in the frame of end p it rotates when that frame does. The
potential of a leaf is V(xi, g): xi the motion of end q relative to end p, g the acceleration of gravity [m/s^2] in
frame p. Its derivatives by xi are the force and stiffness that every member has. Those by g are the gravity block, the
last numbers of the `store` of a leaf with weight (without weight the `store` is shorter):

=====  ======================================================================================
index  meaning
=====  ======================================================================================
0:3    g, set before `condense`
3:6    s = int r dm = -V_g, first moment of mass about end p [kg m], predicted like lam[0:6]
6:9    the same at the present inner state, for the geometric terms
9:27   V_xi,g (6, 3), row-major [kg, kg m]
27:36  V_g,g (3, 3), row-major [kg s^2]
36:39  change of g by the step, set before `recover`
=====  ======================================================================================

The weight itself, mass times g, acts at end p with the moment s x g (`ksd.elements.leaf_loads`). This file: the inner
nodes of Appendix A chains, which carry half the mass of both their elements. The elements' end moments g m L/12
(work-equivalent to cubic deflection) cancel at the inner nodes of a uniform leaf; at both ends they act as the half
masses' levers L/6.
"""

from __future__ import annotations

from ksd.elements.corotational_element import A_AT, B_AT, C_AT, P_AT
from ksd.numerics.kernel import kernel


@kernel(inline="late")
def start_chain_weight(mass, n, gravity, coupling):
    """Initialise the gravity block and the couplings of a chain of n elements, before the first: the lump at end p.

    `mass` (n+7,): lumps p, inner nodes, q [kg], first moments of the lumps p and q in their frames [kg m]; coupling (18
    (n+1),): couplings (6, 3) of the nodes with g.
    """
    for r in range(3):
        gravity[3 + r] = gravity[6 + r] = mass[n + 1 + r]
    for r in range(9, 36):
        gravity[r] = 0.0
    for r in range(18 * (n + 1)):
        coupling[r] = 0.0


@kernel(inline="late")
def add_inner_weight(mass, gravity, tail):
    """Add the weight of an inner node, node p of the element, to the residual carried to it and to its unpredicted
    copy."""
    for r in range(3):
        w = mass * gravity[r]
        tail[C_AT + 8 * r + 6] -= w
        tail[C_AT + 8 * r + 7] -= w
        gravity[3 + r] += mass * tail[P_AT + r]
        gravity[6 + r] += mass * tail[P_AT + r]


@kernel(inline="late")
def eliminate_gravity_coupling(mass, s, gravity, own, carried):
    """Eliminate node p from the couplings with g, as `corotational_element.eliminate` does for the other blocks.

    mass: lump of node p [kg]; own (18,): coupling of node p, completed here and stored for `recover` as L^-1 of it;
    carried (18,): of node q.
    """
    for r in range(3):
        own[4 * r] -= mass
    for j in range(6):
        inverse = s[A_AT + 7 * j]
        for i in range(j + 1, 6):
            for c in range(3):
                own[3 * i + c] -= s[A_AT + 6 * j + i] * own[3 * j + c]
        for c in range(3):
            w = inverse * own[3 * j + c]
            for i in range(6):
                carried[3 * i + c] -= s[B_AT + 8 * j + i] * w
            # s = -V_g, hence the opposite sign of the residual
            gravity[3 + c] += w * s[B_AT + 8 * j + 6]
            for i in range(3):
                gravity[27 + 3 * i + c] -= own[3 * j + i] * w


@kernel(inline="late")
def finish_chain_weight(mass, n, gravity, carried, d, Q, lam, K):
    """Add the lump at end q, pose d (3,), Q (3, 3), to lam (12,), K (6, 6) and the gravity block."""
    m = mass[n]
    g0, g1, g2 = gravity[0], gravity[1], gravity[2]
    h0, h1, h2 = mass[n + 4], mass[n + 5], mass[n + 6]
    for r in range(18):
        gravity[9 + r] = carried[r]
    x = Q[0, 0] * h0 + Q[0, 1] * h1 + Q[0, 2] * h2
    y = Q[1, 0] * h0 + Q[1, 1] * h1 + Q[1, 2] * h2
    z = Q[2, 0] * h0 + Q[2, 1] * h1 + Q[2, 2] * h2
    for c in (0, 6):
        lam[c] -= m * g0
        lam[c + 1] -= m * g1
        lam[c + 2] -= m * g2
        lam[c + 3] -= y * g2 - z * g1
        lam[c + 4] -= z * g0 - x * g2
        lam[c + 5] -= x * g1 - y * g0
        o = 3 + c // 2
        gravity[o] += m * d[0] + x
        gravity[o + 1] += m * d[1] + y
        gravity[o + 2] += m * d[2] + z
    # -(h g' + g h')/2 + (h.g) I on the rotation of q; coupling with g: -m I and -[h]x
    K[3, 3] += y * g1 + z * g2
    K[4, 4] += x * g0 + z * g2
    K[5, 5] += x * g0 + y * g1
    k01, k02, k12 = 0.5 * (x * g1 + y * g0), 0.5 * (x * g2 + z * g0), 0.5 * (y * g2 + z * g1)
    K[3, 4] -= k01
    K[4, 3] -= k01
    K[3, 5] -= k02
    K[5, 3] -= k02
    K[4, 5] -= k12
    K[5, 4] -= k12
    for r in range(3):
        gravity[9 + 4 * r] -= m
    gravity[19] += z
    gravity[20] -= y
    gravity[21] -= z
    gravity[23] += x
    gravity[24] += y
    gravity[25] -= x
