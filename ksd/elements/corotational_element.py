"""One corotational Timoshenko element: strains, their derivatives, force and tangent (paper 1, Appendix A).

With corrections 2, 3 and 7 of the errata. Kernels work on two arrays of the chain in `corotational`: `s`, stored per
element, and `tail`, scratch shared by all elements. Loops have constant bounds, so that the compiler unrolls them.
"""

from __future__ import annotations

import math

from ksd.numerics.kernel import kernel

L_AT, U_AT, V_AT, T_AT, A_AT, B_AT = 6, 9, 21, 33, 36, 72
"""Offsets in `s`, after the strains eps (6): chord direction l (3), derivatives of strains 3..6 by the chord L (12) and
by the rotations phi (12), derivative of strain 2 by phi_p (3), block A (6, 6) of node p or its factor, and B (6, 8):
its coupling with node q (columns 0..5), residual (6) and zeros (7)."""

P_AT, Q_AT, X_AT, N_AT, W_AT, F_AT, R_AT, S_AT = 0, 12, 24, 36, 37, 41, 45, 55
"""Offsets in `tail`: nodes p and q (position 3, rotation 9), section axes z_p, z_q, y_p, y_q (12), |L|, sines w (4) and
asin factors (4) of the bending strains, the same and derivatives of the torsion strain (10), stresses sigma (6)."""

M_AT, G_AT, C_AT = 64, 76, 100
"""Offsets after these: products S D (12), sigma-weighted axes and their cross products with l (15), diagonal block of
node q and its residual, with (column 6) and without (7) the elimination of the inner nodes (6, 8)."""

Z_AT = 148
"""Offset of the stresses (6) of the geometric stiffness."""
ELEMENT_STORE_SIZE = 120
"""Length of `s`."""
CHAIN_SCRATCH_SIZE = 154
"""Length of `tail`."""
TINY_PIVOT = 1e-14
"""A pivot below this fraction of its diagonal before elimination counts as zero."""


@kernel(inline="late")
def load_node(tail, inner, k, d, R):
    """Make node q of the previous element node p; node q becomes `inner` node k, or the end d, R if k < 0."""
    for i in range(12):
        tail[P_AT + i] = tail[Q_AT + i]
    for i in range(3):
        tail[Q_AT + i] = inner[12 * k + i] if k >= 0 else d[i]
        for j in range(3 * i, 3 * i + 3):
            tail[Q_AT + 3 + j] = inner[12 * k + 3 + j] if k >= 0 else R[i, j - 3 * i]


@kernel(inline="late")
def fix_start(tail):
    """Load end frame p as a node: at the origin, unrotated, with zero residual carried over."""
    for i in range(12):
        tail[Q_AT + i] = 0.0
    tail[Q_AT + 3] = tail[Q_AT + 7] = tail[Q_AT + 11] = 1.0


@kernel(inline="late")
def node_axes(v, tail):
    """Axes z_p, z_q, y_p, y_q of an element (A.2)."""
    for e in range(2):
        for i in range(3):
            a, b, c = tail[12 * e + 3 + 3 * i], tail[12 * e + 4 + 3 * i], tail[12 * e + 5 + 3 * i]
            tail[X_AT + 3 * e + i] = a * v[9] + b * v[12] + c * v[15]
            tail[X_AT + 6 + 3 * e + i] = a * v[8] + b * v[11] + c * v[14]


@kernel(inline="late")
def chord(s, tail):
    """Write the chord direction l into `s` and |L| [m] into `tail`, from the positions of both nodes (A.5)."""
    x = tail[Q_AT] - tail[P_AT]
    y = tail[Q_AT + 1] - tail[P_AT + 1]
    z = tail[Q_AT + 2] - tail[P_AT + 2]
    n = math.sqrt(x * x + y * y + z * z)
    tail[N_AT] = n
    s[L_AT] = x / n
    s[L_AT + 1] = y / n
    s[L_AT + 2] = z / n


@kernel(inline="late")
def gradients(length, s, tail):
    """First derivatives D of the strains (A.11) and asin factors; returns 1 for an angle beyond 60 degrees or nan, else
    0."""
    lx, ly, lz = s[L_AT], s[L_AT + 1], s[L_AT + 2]
    r = 1.0 / tail[N_AT]
    status = 0
    for i in range(4):
        ax, ay, az = tail[X_AT + 3 * i], tail[X_AT + 3 * i + 1], tail[X_AT + 3 * i + 2]
        w = ax * lx + ay * ly + az * lz
        if not w * w <= 0.75:
            status = 1
        f = length / math.sqrt(1.0 - w * w)
        if i == 0 or i == 3:
            f = -f
        tail[W_AT + i] = w
        tail[F_AT + i] = f
        s[U_AT + 3 * i] = f * r * (ax - w * lx)
        s[U_AT + 3 * i + 1] = f * r * (ay - w * ly)
        s[U_AT + 3 * i + 2] = f * r * (az - w * lz)
        s[V_AT + 3 * i] = f * (ay * lz - az * ly)
        s[V_AT + 3 * i + 1] = f * (az * lx - ax * lz)
        s[V_AT + 3 * i + 2] = f * (ax * ly - ay * lx)
    # torsion: z_p . y_q and y_p . z_q
    ax, ay, az = tail[X_AT], tail[X_AT + 1], tail[X_AT + 2]
    ex, ey, ez = tail[X_AT + 3], tail[X_AT + 4], tail[X_AT + 5]
    cx, cy, cz = tail[X_AT + 6], tail[X_AT + 7], tail[X_AT + 8]
    bx, by, bz = tail[X_AT + 9], tail[X_AT + 10], tail[X_AT + 11]
    wa = ax * bx + ay * by + az * bz
    wb = cx * ex + cy * ey + cz * ez
    if not (wa * wa <= 0.75 and wb * wb <= 0.75):
        status = 1
    # folded back: an axis x = y x z of a node points against the chord, or the twist is beyond 90 degrees
    xp = lx * (cy * az - cz * ay) + ly * (cz * ax - cx * az) + lz * (cx * ay - cy * ax)
    xq = lx * (by * ez - bz * ey) + ly * (bz * ex - bx * ez) + lz * (bx * ey - by * ex)
    turn = ax * ex + ay * ey + az * ez + bx * cx + by * cy + bz * cz
    if not (xp >= 0.0 and xq >= 0.0 and turn >= 0.0):
        status = 1
    fa = 0.5 * length / math.sqrt(1.0 - wa * wa)
    fb = -0.5 * length / math.sqrt(1.0 - wb * wb)
    tail[R_AT], tail[R_AT + 1], tail[R_AT + 2], tail[R_AT + 3] = wa, fa, wb, fb
    ux, uy, uz = fa * (ay * bz - az * by), fa * (az * bx - ax * bz), fa * (ax * by - ay * bx)
    vx, vy, vz = fb * (cy * ez - cz * ey), fb * (cz * ex - cx * ez), fb * (cx * ey - cy * ex)
    tail[R_AT + 4], tail[R_AT + 5], tail[R_AT + 6] = ux, uy, uz
    tail[R_AT + 7], tail[R_AT + 8], tail[R_AT + 9] = vx, vy, vz
    s[T_AT], s[T_AT + 1], s[T_AT + 2] = ux + vx, uy + vy, uz + vz
    return status


@kernel(inline="late")
def strains(length, s, tail):
    """Strains eps of A.4 at the current configuration."""
    s[0] = tail[N_AT] - length
    s[1] = 0.5 * length * (math.asin(tail[R_AT]) - math.asin(tail[R_AT + 2]))
    s[2] = -length * math.asin(tail[W_AT])
    s[3] = length * math.asin(tail[W_AT + 1])
    s[4] = length * math.asin(tail[W_AT + 2])
    s[5] = -length * math.asin(tail[W_AT + 3])


@kernel(inline="late")
def stresses(v, s, tail):
    """Stresses sigma = S eps (A.13)."""
    tail[S_AT] = v[1] * s[0]
    tail[S_AT + 1] = v[2] * s[1]
    tail[S_AT + 2] = v[3] * s[2] + v[4] * s[3]
    tail[S_AT + 3] = v[4] * s[2] + v[3] * s[3]
    tail[S_AT + 4] = v[5] * s[4] + v[6] * s[5]
    tail[S_AT + 5] = v[6] * s[4] + v[5] * s[5]


@kernel(inline="late")
def node_forces(s, tail, i):
    """Components i of D^T sigma (A.18): force on q (minus that on p), moment on p, moment on q."""
    s3, s4, s5, s6 = tail[S_AT + 2], tail[S_AT + 3], tail[S_AT + 4], tail[S_AT + 5]
    force = tail[S_AT] * s[L_AT + i] + s3 * s[U_AT + i] + s4 * s[U_AT + 3 + i]
    force += s5 * s[U_AT + 6 + i] + s6 * s[U_AT + 9 + i]
    twist = tail[S_AT + 1] * s[T_AT + i]
    at_p = twist + s3 * s[V_AT + i] + s5 * s[V_AT + 6 + i]
    at_q = -twist + s4 * s[V_AT + 3 + i] + s6 * s[V_AT + 9 + i]
    return force, at_p, at_q


@kernel(inline="late")
def tangent(v, s, tail, first):
    """Element tangent and force; node p is added to the block carried in C, which gives A and B, and node q replaces C.

    With w = a . l: d2w/dLdL = -(Pa l^T + l (Pa)^T + w P)/|L|^2, d2w/dL dphi = -P [a]x/|L|, P = I - l l^T,
    d2w/dphi2 = (a l^T + l a^T)/2 - w I; with w = a . b, a on p, b on q: d2w/dphi_p dphi_q = w I - b a^T.
    The term w dw dw^T/(1 - w^2)^1.5 of asin joins D^T S D: it only changes the diagonal of S.
    first: whether it is the first element, whose node p is fixed. Returns the squared force and moment residual of node p.
    """
    lx, ly, lz = s[L_AT], s[L_AT + 1], s[L_AT + 2]
    sigma = tail[Z_AT : Z_AT + 6]
    r = 1.0 / tail[N_AT]
    # S with the asin terms, and the products S D of the bending strains
    h3, h4 = sigma[2] * tail[F_AT], sigma[3] * tail[F_AT + 1]
    h5, h6 = sigma[4] * tail[F_AT + 2], sigma[5] * tail[F_AT + 3]
    w3, w4, w5, w6 = tail[W_AT], tail[W_AT + 1], tail[W_AT + 2], tail[W_AT + 3]
    k33 = v[3] + sigma[2] * w3 / (tail[F_AT] * (1.0 - w3 * w3))
    k44 = v[3] + sigma[3] * w4 / (tail[F_AT + 1] * (1.0 - w4 * w4))
    k55 = v[5] + sigma[4] * w5 / (tail[F_AT + 2] * (1.0 - w5 * w5))
    k66 = v[5] + sigma[5] * w6 / (tail[F_AT + 3] * (1.0 - w6 * w6))
    for i in range(3):
        u3, u4, u5, u6 = s[U_AT + i], s[U_AT + 3 + i], s[U_AT + 6 + i], s[U_AT + 9 + i]
        tail[M_AT + i] = k33 * u3 + v[4] * u4
        tail[M_AT + 3 + i] = v[4] * u3 + k44 * u4
        tail[M_AT + 6 + i] = k55 * u5 + v[6] * u6
        tail[M_AT + 9 + i] = v[6] * u5 + k66 * u6
        # sums of sigma-weighted axes on p and on q
        tail[G_AT + i] = h3 * tail[X_AT + i] + h5 * tail[X_AT + 6 + i]
        tail[G_AT + 3 + i] = h4 * tail[X_AT + 3 + i] + h6 * tail[X_AT + 9 + i]
    px, py, pz = tail[G_AT], tail[G_AT + 1], tail[G_AT + 2]
    qx, qy, qz = tail[G_AT + 3], tail[G_AT + 4], tail[G_AT + 5]
    wp, wq = px * lx + py * ly + pz * lz, qx * lx + qy * ly + qz * lz
    tail[G_AT + 6], tail[G_AT + 7], tail[G_AT + 8] = py * lz - pz * ly, pz * lx - px * lz, px * ly - py * lx
    tail[G_AT + 9], tail[G_AT + 10], tail[G_AT + 11] = qy * lz - qz * ly, qz * lx - qx * lz, qx * ly - qy * lx
    for i in range(3):
        tail[G_AT + 12 + i] = r * r * (tail[G_AT + i] + tail[G_AT + 3 + i] - (wp + wq) * s[L_AT + i])
    # torsion: asin terms and weights of the second derivatives
    wa, fa, wb, fb = tail[R_AT], tail[R_AT + 1], tail[R_AT + 2], tail[R_AT + 3]
    ka = sigma[1] * wa / (fa * (1.0 - wa * wa))
    kb = sigma[1] * wb / (fb * (1.0 - wb * wb))
    ga, gb = sigma[1] * fa, sigma[1] * fb
    normal = sigma[0] * r - r * r * (wp + wq)
    axial = v[1] - normal
    twist = ga * wa + gb * wb
    for i in range(3):
        l, t, g = s[L_AT + i], v[2] * s[T_AT + i], tail[G_AT + 12 + i]
        ta, tb = ka * tail[R_AT + 4 + i], kb * tail[R_AT + 7 + i]
        m3, m4, m5, m6 = tail[M_AT + i], tail[M_AT + 3 + i], tail[M_AT + 6 + i], tail[M_AT + 9 + i]
        v3, v4, v5, v6 = s[V_AT + i], s[V_AT + 3 + i], s[V_AT + 6 + i], s[V_AT + 9 + i]
        p, q = 0.5 * tail[G_AT + i], 0.5 * tail[G_AT + 3 + i]
        zp, zq, yp, yq = tail[X_AT + i], tail[X_AT + 3 + i], tail[X_AT + 6 + i], tail[X_AT + 9 + i]
        for j in range(3):
            lj = s[L_AT + j]
            u3, u4, u5, u6 = s[U_AT + j], s[U_AT + 3 + j], s[U_AT + 6 + j], s[U_AT + 9 + j]
            x3, x4, x5, x6 = s[V_AT + j], s[V_AT + 3 + j], s[V_AT + 6 + j], s[V_AT + 9 + j]
            zpj, zqj, ypj, yqj = tail[X_AT + j], tail[X_AT + 3 + j], tail[X_AT + 6 + j], tail[X_AT + 9 + j]
            ll = axial * l * lj + m3 * u3 + m4 * u4 + m5 * u5 + m6 * u6 - g * lj - l * tail[G_AT + 12 + j]
            lp = m3 * x3 + m5 * x5 - r * l * tail[G_AT + 6 + j]
            lq = m4 * x4 + m6 * x6 - r * l * tail[G_AT + 9 + j]
            pp = k33 * v3 * x3 + k55 * v5 * x5 + p * lj + 0.5 * l * tail[G_AT + j]
            qq = k44 * v4 * x4 + k66 * v6 * x6 + q * lj + 0.5 * l * tail[G_AT + 3 + j]
            pq = v[4] * v3 * x4 + v[6] * v5 * x6 - ga * yq * zpj - gb * zq * ypj
            rank = t * s[T_AT + j] + ta * tail[R_AT + 4 + j] + tb * tail[R_AT + 7 + j]
            both = rank + 0.5 * (ga * (zp * yqj + yq * zpj) + gb * (yp * zqj + zq * ypj))
            pp += both
            qq += both
            pq -= rank
            if i == j:
                ll += normal
                pp -= wp + twist
                qq -= wq + twist
                pq += twist
            elif j == (i + 1) % 3:
                # -[a]x, entry (i, i+1) = a_(i+2)
                lp += r * tail[G_AT + (i + 2) % 3]
                lq += r * tail[G_AT + 3 + (i + 2) % 3]
            else:
                lp -= r * tail[G_AT + (i + 1) % 3]
                lq -= r * tail[G_AT + 3 + (i + 1) % 3]
            if not first:
                s[A_AT + 6 * i + j] = tail[C_AT + 8 * i + j] + ll
                s[A_AT + 6 * i + 3 + j] = tail[C_AT + 8 * i + 3 + j] - lp
                s[A_AT + 6 * i + 21 + j] = tail[C_AT + 8 * i + 27 + j] + pp
                s[B_AT + 8 * i + j] = -ll
                s[B_AT + 8 * i + 3 + j] = -lq
                s[B_AT + 8 * j + 24 + i] = lp
                s[B_AT + 8 * i + 27 + j] = pq
            tail[C_AT + 8 * i + j] = ll
            tail[C_AT + 8 * i + 3 + j] = lq
            tail[C_AT + 8 * j + 24 + i] = lq
            tail[C_AT + 8 * i + 27 + j] = qq
    return _carry_forces(s, tail, first)


@kernel(inline="late")
def unstressed_tangent(v, s, tail, first):
    """`tangent` without stresses in the geometric stiffness: D^T S D only (A.11, A.13).

    The force is still that of the stresses in `tail`.
    """
    for i in range(3):
        l, t = v[1] * s[L_AT + i], v[2] * s[T_AT + i]
        u3, u4, u5, u6 = s[U_AT + i], s[U_AT + 3 + i], s[U_AT + 6 + i], s[U_AT + 9 + i]
        m3, m4, m5, m6 = (
            v[3] * u3 + v[4] * u4,
            v[4] * u3 + v[3] * u4,
            v[5] * u5 + v[6] * u6,
            v[6] * u5 + v[5] * u6,
        )
        v3, v4, v5, v6 = s[V_AT + i], s[V_AT + 3 + i], s[V_AT + 6 + i], s[V_AT + 9 + i]
        for j in range(3):
            x3, x4, x5, x6 = s[V_AT + j], s[V_AT + 3 + j], s[V_AT + 6 + j], s[V_AT + 9 + j]
            ll = l * s[L_AT + j] + m3 * s[U_AT + j] + m4 * s[U_AT + 3 + j]
            ll += m5 * s[U_AT + 6 + j] + m6 * s[U_AT + 9 + j]
            lp, lq = m3 * x3 + m5 * x5, m4 * x4 + m6 * x6
            rank = t * s[T_AT + j]
            if not first:
                s[A_AT + 6 * i + j] = tail[C_AT + 8 * i + j] + ll
                s[A_AT + 6 * i + 3 + j] = tail[C_AT + 8 * i + 3 + j] - lp
                s[A_AT + 6 * i + 21 + j] = (
                    tail[C_AT + 8 * i + 27 + j] + v[3] * v3 * x3 + v[5] * v5 * x5 + rank
                )
                s[B_AT + 8 * i + j] = -ll
                s[B_AT + 8 * i + 3 + j] = -lq
                s[B_AT + 8 * j + 24 + i] = lp
                s[B_AT + 8 * i + 27 + j] = v[4] * v3 * x4 + v[6] * v5 * x6 - rank
            tail[C_AT + 8 * i + j] = ll
            tail[C_AT + 8 * i + 3 + j] = lq
            tail[C_AT + 8 * j + 24 + i] = lq
            tail[C_AT + 8 * i + 27 + j] = v[3] * v4 * x4 + v[5] * v6 * x6 + rank
    return _carry_forces(s, tail, first)


@kernel(inline="late")
def _carry_forces(s, tail, first):
    """Write the residual of node p into B and the forces on node q into C.

    first: node p is the fixed end p, without residual. Returns the squares of the force [N^2] and moment [N^2 m^2] by which
    node p is out of balance.
    """
    worst_force = worst_moment = 0.0
    for i in range(3):
        force, at_p, at_q = node_forces(s, tail, i)
        if not first:
            s[B_AT + 8 * i + 6] = tail[C_AT + 8 * i + 6] - force
            s[B_AT + 8 * i + 30] = tail[C_AT + 8 * i + 30] + at_p
            s[B_AT + 8 * i + 7] = s[B_AT + 8 * i + 31] = 0.0
            unbalanced_force, unbalanced_moment = (
                tail[C_AT + 8 * i + 7] - force,
                tail[C_AT + 8 * i + 31] + at_p,
            )
            worst_force += unbalanced_force * unbalanced_force
            worst_moment += unbalanced_moment * unbalanced_moment
        tail[C_AT + 8 * i + 6] = tail[C_AT + 8 * i + 7] = force
        tail[C_AT + 8 * i + 30] = tail[C_AT + 8 * i + 31] = at_q
    return worst_force, worst_moment


@kernel(inline="late")
def eliminate(s, tail):
    """Eliminate node p: A = L D L^T, B <- L^-1 B, C -= B^T D^-1 B, including the residual in column 6.

    Column 7 of B is zero, so that of C stays as it is. Leaves 1/D on the diagonal of A and L^T above it. Returns the number
    of negative pivots, -1 if one vanished.
    """
    negatives = 0
    for j in range(6):
        pivot = s[A_AT + 7 * j]
        if not abs(pivot) > 0.0:
            return -1
        if pivot < 0.0:
            negatives += 1
        inverse = 1.0 / pivot
        for i in range(j + 1, 6):
            f = s[A_AT + 6 * j + i] * inverse
            before = abs(s[A_AT + 7 * i])
            for c in range(i, 6):
                s[A_AT + 6 * i + c] -= f * s[A_AT + 6 * j + c]
            if not abs(s[A_AT + 7 * i]) > TINY_PIVOT * before:
                return -1
            for c in range(8):
                s[B_AT + 8 * i + c] -= f * s[B_AT + 8 * j + c]
        for i in range(6):
            f = s[B_AT + 8 * j + i] * inverse
            for c in range(8):
                tail[C_AT + 8 * i + c] -= f * s[B_AT + 8 * j + c]
        for i in range(j + 1, 6):
            s[A_AT + 6 * j + i] *= inverse
        s[A_AT + 7 * j] = inverse
    return negatives
