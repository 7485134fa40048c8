"""Corotational Timoshenko chain: paper 1, Appendix A, with corrections 2, 3 and 7 of the errata.

A leaf is a chain of n two-node elements between end frame p (origin, identity) and end frame q (position d,
orientation Q); everything is in the frame of end p. Each element has six strains (A.4); its force is
D^T S eps (A.18) and its tangent D^T S D + sum sigma_i d2eps_i in the symmetric chart R <- exp(dphi) R. With
mixed integration points (MIP) sigma of the second term is extrapolated in the previous iteration; otherwise it
is S eps. The inner nodes are eliminated by a 6x6 block sweep from p to q, so the cost is linear in n.

Arrays (float64, SI): `value` holds n records of 16 (L0, S1, S2, S3a, S3b, S4a, S4b, T (9, row-major, columns
n_x n_y n_z)) and the undeformed orientation Q0 (9) of end q; `inner` holds n-1 nodes of 12 (position 3,
rotation from the undeformed state 9, row-major), then n x 6 stresses; `number` = [n, 1 for MIP or 0 for plain
Newton]; `store` is scratch kept from `condense` to `recover`. `corotational_values` makes them.

Compiled code raises nothing; status is 0 (fine), 1 (a local angle beyond 60 degrees, short of the 90 degrees
where asin in A.4 folds back), 2 (a pivot vanished or a number is not finite).
"""

from __future__ import annotations

import math

import numpy as np

from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_exp, rotation_log

RECORD = 16
"""Numbers per element in `value`."""
NODE = 12
"""Numbers per inner node in `inner`."""
KEPT = 120
"""Numbers kept per element in `store`: eps 6, D 30, factor 36, coupling and residual 6 x 8."""
TAIL = 148
"""Scratch after them: nodes p and q, axes, sines, torsion, stresses, products S D, next diagonal block."""
TINY_PIVOT = 1e-14
"""A pivot below this fraction of its diagonal before elimination counts as zero."""

# Offsets in the record of one element: l, deps/dL and deps/dphi of strains 3..6, deps2/dphi_p, A, B
_L, _U, _V, _T, _A, _B = 6, 9, 21, 33, 36, 72
# Offsets in the tail: node p, node q, axes, |L|, sines, factors, torsion, stress, products, normals, next C
_P, _Q, _X, _N, _W, _F, _R, _S, _M, _G, _C = 0, 12, 24, 36, 37, 41, 45, 55, 64, 76, 100


@kernel
def _load_node(tail, inner, k, d, R):
    """Node q of the previous element becomes node p; node k of `inner` (the end frame d, R if k < 0) node q."""
    for i in range(12):
        tail[_P + i] = tail[_Q + i]
    if k >= 0:
        node = inner[12 * k : 12 * k + 12]
        for i in range(12):
            tail[_Q + i] = node[i]
    else:
        for i in range(3):
            tail[_Q + i] = d[i]
            for j in range(3):
                tail[_Q + 3 + 3 * i + j] = R[i, j]


@kernel
def _fix_start(tail):
    """End frame p as a node: at the origin, unrotated; residual carried from it is zero."""
    for i in range(12):
        tail[_Q + i] = 0.0
    tail[_Q + 3] = tail[_Q + 7] = tail[_Q + 11] = 1.0


@kernel
def _node_axes(v, tail):
    """Axes z_p, z_q, y_p, y_q of an element (A.2)."""
    for e in range(2):
        for i in range(3):
            a, b, c = tail[12 * e + 3 + 3 * i], tail[12 * e + 4 + 3 * i], tail[12 * e + 5 + 3 * i]
            tail[_X + 3 * e + i] = a * v[9] + b * v[12] + c * v[15]
            tail[_X + 6 + 3 * e + i] = a * v[8] + b * v[11] + c * v[14]


@kernel
def _chord(s, tail):
    """Chord direction l and length from the positions of both nodes (A.5)."""
    x = tail[_Q] - tail[_P]
    y = tail[_Q + 1] - tail[_P + 1]
    z = tail[_Q + 2] - tail[_P + 2]
    n = math.sqrt(x * x + y * y + z * z)
    tail[_N] = n
    s[_L] = x / n
    s[_L + 1] = y / n
    s[_L + 2] = z / n


@kernel
def _gradients(length, s, tail):
    """First derivatives D of the strains (A.11), sign and asin factors; returns 1 beyond 60 degrees, 2 if nan."""
    lx, ly, lz = s[_L], s[_L + 1], s[_L + 2]
    r = 1.0 / tail[_N]
    status = 0
    for i in range(4):
        ax, ay, az = tail[_X + 3 * i], tail[_X + 3 * i + 1], tail[_X + 3 * i + 2]
        w = ax * lx + ay * ly + az * lz
        if not w * w <= 0.75:
            status = 1 if w * w > 0.75 else 2
        f = length / math.sqrt(1.0 - w * w)
        if i == 0 or i == 3:
            f = -f
        tail[_W + i] = w
        tail[_F + i] = f
        s[_U + 3 * i] = f * r * (ax - w * lx)
        s[_U + 3 * i + 1] = f * r * (ay - w * ly)
        s[_U + 3 * i + 2] = f * r * (az - w * lz)
        s[_V + 3 * i] = f * (ay * lz - az * ly)
        s[_V + 3 * i + 1] = f * (az * lx - ax * lz)
        s[_V + 3 * i + 2] = f * (ax * ly - ay * lx)
    # torsion: z_p . y_q and y_p . z_q
    ax, ay, az = tail[_X], tail[_X + 1], tail[_X + 2]
    ex, ey, ez = tail[_X + 3], tail[_X + 4], tail[_X + 5]
    cx, cy, cz = tail[_X + 6], tail[_X + 7], tail[_X + 8]
    bx, by, bz = tail[_X + 9], tail[_X + 10], tail[_X + 11]
    wa = ax * bx + ay * by + az * bz
    wb = cx * ex + cy * ey + cz * ez
    if not (wa * wa <= 0.75 and wb * wb <= 0.75):
        status = max(status, 1)
    # the folded side: an axis x = y x z of a node against the chord, or a twist past 90 degrees
    xp = lx * (cy * az - cz * ay) + ly * (cz * ax - cx * az) + lz * (cx * ay - cy * ax)
    xq = lx * (by * ez - bz * ey) + ly * (bz * ex - bx * ez) + lz * (bx * ey - by * ex)
    turn = ax * ex + ay * ey + az * ez + bx * cx + by * cy + bz * cz
    if xp <= 0.0 or xq <= 0.0 or turn <= 0.0:
        status = max(status, 1)
    fa = 0.5 * length / math.sqrt(1.0 - wa * wa)
    fb = -0.5 * length / math.sqrt(1.0 - wb * wb)
    tail[_R], tail[_R + 1], tail[_R + 2], tail[_R + 3] = wa, fa, wb, fb
    ux, uy, uz = fa * (ay * bz - az * by), fa * (az * bx - ax * bz), fa * (ax * by - ay * bx)
    vx, vy, vz = fb * (cy * ez - cz * ey), fb * (cz * ex - cx * ez), fb * (cx * ey - cy * ex)
    tail[_R + 4], tail[_R + 5], tail[_R + 6] = ux, uy, uz
    tail[_R + 7], tail[_R + 8], tail[_R + 9] = vx, vy, vz
    s[_T], s[_T + 1], s[_T + 2] = ux + vx, uy + vy, uz + vz
    return status


@kernel
def _strains(length, s, tail):
    """Strains eps of A.4 at the present configuration."""
    s[0] = tail[_N] - length
    s[1] = 0.5 * length * (math.asin(tail[_R]) - math.asin(tail[_R + 2]))
    s[2] = -length * math.asin(tail[_W])
    s[3] = length * math.asin(tail[_W + 1])
    s[4] = length * math.asin(tail[_W + 2])
    s[5] = -length * math.asin(tail[_W + 3])


@kernel
def _stresses(v, s, tail):
    """Stresses sigma = S eps (A.13)."""
    tail[_S] = v[1] * s[0]
    tail[_S + 1] = v[2] * s[1]
    tail[_S + 2] = v[3] * s[2] + v[4] * s[3]
    tail[_S + 3] = v[4] * s[2] + v[3] * s[3]
    tail[_S + 4] = v[5] * s[4] + v[6] * s[5]
    tail[_S + 5] = v[6] * s[4] + v[5] * s[5]


@kernel
def _node_forces(s, tail, i):
    """Components i of D^T sigma (A.18): force on q (minus that on p), moment on p, moment on q."""
    s3, s4, s5, s6 = tail[_S + 2], tail[_S + 3], tail[_S + 4], tail[_S + 5]
    force = tail[_S] * s[_L + i] + s3 * s[_U + i] + s4 * s[_U + 3 + i] + s5 * s[_U + 6 + i] + s6 * s[_U + 9 + i]
    twist = tail[_S + 1] * s[_T + i]
    at_p = twist + s3 * s[_V + i] + s5 * s[_V + 6 + i]
    at_q = -twist + s4 * s[_V + 3 + i] + s6 * s[_V + 9 + i]
    return force, at_p, at_q


@kernel
def _tangent(v, sigma, s, tail, first):
    """Element tangent and force; node p is added to the block carried in C, giving A and B; node q refills C.

    With w = a . l: d2w/dLdL = -(Pa l^T + l (Pa)^T + w P)/|L|^2, d2w/dL dphi = -P [a]x/|L|, P = I - l l^T,
    d2w/dphi2 = (a l^T + l a^T)/2 - w I; with w = a . b, a on p, b on q: d2w/dphi_p dphi_q = w I - b a^T.
    The term w dw dw^T/(1 - w^2)^1.5 of asin joins D^T S D: it only changes the diagonal of S.
    Returns the largest squared force and moment residual of node p.
    """
    lx, ly, lz = s[_L], s[_L + 1], s[_L + 2]
    r = 1.0 / tail[_N]
    # S with the asin terms, and the products S D of the bending strains
    h3, h4 = sigma[2] * tail[_F], sigma[3] * tail[_F + 1]
    h5, h6 = sigma[4] * tail[_F + 2], sigma[5] * tail[_F + 3]
    w3, w4, w5, w6 = tail[_W], tail[_W + 1], tail[_W + 2], tail[_W + 3]
    k33 = v[3] + sigma[2] * w3 / (tail[_F] * (1.0 - w3 * w3))
    k44 = v[3] + sigma[3] * w4 / (tail[_F + 1] * (1.0 - w4 * w4))
    k55 = v[5] + sigma[4] * w5 / (tail[_F + 2] * (1.0 - w5 * w5))
    k66 = v[5] + sigma[5] * w6 / (tail[_F + 3] * (1.0 - w6 * w6))
    for i in range(3):
        u3, u4, u5, u6 = s[_U + i], s[_U + 3 + i], s[_U + 6 + i], s[_U + 9 + i]
        tail[_M + i] = k33 * u3 + v[4] * u4
        tail[_M + 3 + i] = v[4] * u3 + k44 * u4
        tail[_M + 6 + i] = k55 * u5 + v[6] * u6
        tail[_M + 9 + i] = v[6] * u5 + k66 * u6
        # sums of sigma-weighted axes on p and on q
        tail[_G + i] = h3 * tail[_X + i] + h5 * tail[_X + 6 + i]
        tail[_G + 3 + i] = h4 * tail[_X + 3 + i] + h6 * tail[_X + 9 + i]
    px, py, pz = tail[_G], tail[_G + 1], tail[_G + 2]
    qx, qy, qz = tail[_G + 3], tail[_G + 4], tail[_G + 5]
    wp, wq = px * lx + py * ly + pz * lz, qx * lx + qy * ly + qz * lz
    tail[_G + 6], tail[_G + 7], tail[_G + 8] = py * lz - pz * ly, pz * lx - px * lz, px * ly - py * lx
    tail[_G + 9], tail[_G + 10], tail[_G + 11] = qy * lz - qz * ly, qz * lx - qx * lz, qx * ly - qy * lx
    for i in range(3):
        tail[_G + 12 + i] = r * r * (tail[_G + i] + tail[_G + 3 + i] - (wp + wq) * s[_L + i])
    # torsion: asin terms and weights of the second derivatives
    wa, fa, wb, fb = tail[_R], tail[_R + 1], tail[_R + 2], tail[_R + 3]
    ka = sigma[1] * wa / (fa * (1.0 - wa * wa))
    kb = sigma[1] * wb / (fb * (1.0 - wb * wb))
    ga, gb = sigma[1] * fa, sigma[1] * fb
    normal = sigma[0] * r - r * r * (wp + wq)
    axial = v[1] - normal
    twist = ga * wa + gb * wb
    worst_force = worst_moment = 0.0
    for i in range(3):
        l, t, g = s[_L + i], v[2] * s[_T + i], tail[_G + 12 + i]
        ta, tb = ka * tail[_R + 4 + i], kb * tail[_R + 7 + i]
        m3, m4, m5, m6 = tail[_M + i], tail[_M + 3 + i], tail[_M + 6 + i], tail[_M + 9 + i]
        v3, v4, v5, v6 = s[_V + i], s[_V + 3 + i], s[_V + 6 + i], s[_V + 9 + i]
        p, q = 0.5 * tail[_G + i], 0.5 * tail[_G + 3 + i]
        zp, zq, yp, yq = tail[_X + i], tail[_X + 3 + i], tail[_X + 6 + i], tail[_X + 9 + i]
        for j in range(3):
            lj = s[_L + j]
            u3, u4, u5, u6 = s[_U + j], s[_U + 3 + j], s[_U + 6 + j], s[_U + 9 + j]
            x3, x4, x5, x6 = s[_V + j], s[_V + 3 + j], s[_V + 6 + j], s[_V + 9 + j]
            zpj, zqj, ypj, yqj = tail[_X + j], tail[_X + 3 + j], tail[_X + 6 + j], tail[_X + 9 + j]
            ll = axial * l * lj + m3 * u3 + m4 * u4 + m5 * u5 + m6 * u6 - g * lj - l * tail[_G + 12 + j]
            lp = m3 * x3 + m5 * x5 - r * l * tail[_G + 6 + j]
            lq = m4 * x4 + m6 * x6 - r * l * tail[_G + 9 + j]
            pp = k33 * v3 * x3 + k55 * v5 * x5 + p * lj + 0.5 * l * tail[_G + j]
            qq = k44 * v4 * x4 + k66 * v6 * x6 + q * lj + 0.5 * l * tail[_G + 3 + j]
            pq = v[4] * v3 * x4 + v[6] * v5 * x6 - ga * yq * zpj - gb * zq * ypj
            rank = t * s[_T + j] + ta * tail[_R + 4 + j] + tb * tail[_R + 7 + j]
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
                lp += r * tail[_G + (i + 2) % 3]
                lq += r * tail[_G + 3 + (i + 2) % 3]
            else:
                lp -= r * tail[_G + (i + 1) % 3]
                lq -= r * tail[_G + 3 + (i + 1) % 3]
            if not first:
                s[_A + 6 * i + j] = tail[_C + 8 * i + j] + ll
                s[_A + 6 * i + 3 + j] = tail[_C + 8 * i + 3 + j] - lp
                s[_A + 6 * i + 21 + j] = tail[_C + 8 * i + 27 + j] + pp
                s[_B + 8 * i + j] = -ll
                s[_B + 8 * i + 3 + j] = -lq
                s[_B + 8 * j + 24 + i] = lp
                s[_B + 8 * i + 27 + j] = pq
            tail[_C + 8 * i + j] = ll
            tail[_C + 8 * i + 3 + j] = lq
            tail[_C + 8 * j + 24 + i] = lq
            tail[_C + 8 * i + 27 + j] = qq
    for i in range(3):
        force, at_p, at_q = _node_forces(s, tail, i)
        if not first:
            s[_B + 8 * i + 6] = tail[_C + 8 * i + 6] - force
            s[_B + 8 * i + 30] = tail[_C + 8 * i + 30] + at_p
            s[_B + 8 * i + 7] = s[_B + 8 * i + 31] = 0.0
            worst_force += (tail[_C + 8 * i + 7] - force) ** 2
            worst_moment += (tail[_C + 8 * i + 31] + at_p) ** 2
        tail[_C + 8 * i + 6] = tail[_C + 8 * i + 7] = force
        tail[_C + 8 * i + 30] = tail[_C + 8 * i + 31] = at_q
    return worst_force, worst_moment


@kernel
def _eliminate(s, tail):
    """Eliminate node p: A = L D L^T, B <- L^-1 B, C -= B^T D^-1 B (column 6 is the residual, 7 is left as is).

    Leaves 1/D on the diagonal and L^T above it; returns the number of negative pivots, -1 if one vanished.
    """
    negatives = 0
    for j in range(6):
        pivot = s[_A + 7 * j]
        if not abs(pivot) > 0.0:
            return -1
        if pivot < 0.0:
            negatives += 1
        inverse = 1.0 / pivot
        for i in range(j + 1, 6):
            f = s[_A + 6 * j + i] * inverse
            before = abs(s[_A + 7 * i])
            for c in range(i, 6):
                s[_A + 6 * i + c] -= f * s[_A + 6 * j + c]
            if not abs(s[_A + 7 * i]) > TINY_PIVOT * before:
                return -1
            for c in range(8):
                s[_B + 8 * i + c] -= f * s[_B + 8 * j + c]
        for i in range(6):
            f = s[_B + 8 * j + i] * inverse
            for c in range(8):
                tail[_C + 8 * i + c] -= f * s[_B + 8 * j + c]
        for i in range(j + 1, 6):
            s[_A + 6 * j + i] *= inverse
        s[_A + 7 * j] = inverse
    return negatives


@kernel
def _finish(tail, lam, K, force, moment):
    """Write lam (6,) and K (6, 6) of end q; returns the error norms of force and moment."""
    ef = em = 0.0
    for i in range(6):
        lam[i] = tail[_C + 8 * i + 6]
        change = lam[i] - tail[_C + 8 * i + 7]
        if i < 3:
            ef += change * change
        else:
            em += change * change
        for j in range(i + 1):
            K[i, j] = K[j, i] = 0.5 * (tail[_C + 8 * i + j] + tail[_C + 8 * j + i])
    return math.sqrt(max(ef, force)), math.sqrt(max(em, moment))


@kernel
def _end_rotation(value, n, Q, R):
    """R (3, 3) = Q Q0^T: rotation of end q from the undeformed state."""
    Q0 = value[16 * n : 16 * n + 9]
    for i in range(3):
        for j in range(3):
            R[i, j] = Q[i, 0] * Q0[3 * j] + Q[i, 1] * Q0[3 * j + 1] + Q[i, 2] * Q0[3 * j + 2]


@kernel
def condense(value, number, inner, store, d, Q, lam, K):
    """Force lam (6,) [N, Nm] on end q at d (3,) m, orientation Q (3, 3), and its tangent K (6, 6), frame of p.

    Linear prediction of the inner nodes is included. Returns (negative pivots, force error N, moment error Nm,
    status): the errors are the change of lam by the inner residual, or the largest inner residual if larger.
    Source: paper 1, (A.4)-(A.19), and errata 3 for the second derivatives.
    """
    n = number[0]
    tail = store[KEPT * n : KEPT * n + TAIL]
    R = np.empty((3, 3))
    _end_rotation(value, n, Q, R)
    _fix_start(tail)
    negatives = 0
    force = moment = 0.0
    for k in range(n):
        v = value[16 * k : 16 * k + 16]
        s = store[KEPT * k : KEPT * k + KEPT]
        _load_node(tail, inner, k if k < n - 1 else -1, d, R)
        _node_axes(v, tail)
        _chord(s, tail)
        status = _gradients(v[0], s, tail)
        if status != 0:
            return negatives, math.inf, math.inf, status
        _strains(v[0], s, tail)
        _stresses(v, s, tail)
        if number[1] != 0:
            at = 12 * (n - 1) + 6 * k
            rf, rm = _tangent(v, inner[at : at + 6], s, tail, k == 0)
        else:
            rf, rm = _tangent(v, tail[_S : _S + 6], s, tail, k == 0)
        if k > 0:
            force, moment = max(force, rf), max(moment, rm)
            found = _eliminate(s, tail)
            if found < 0:
                return negatives, math.inf, math.inf, 2
            negatives += found
    ef, em = _finish(tail, lam, K, force, moment)
    return negatives, ef, em, 0 if math.isfinite(ef + em + lam[0] + K[0, 0]) else 2


@kernel
def _turn(node, x, y, z):
    """Rotation of a node record: R <- exp([x y z]x) R (Rodrigues)."""
    t2 = x * x + y * y + z * z
    if t2 < 1e-8:
        f = 1.0 - t2 / 6.0 * (1.0 - t2 / 20.0)
        g = 0.5 - t2 / 24.0 * (1.0 - t2 / 30.0)
    else:
        t = math.sqrt(t2)
        f = math.sin(t) / t
        h = math.sin(0.5 * t)
        g = 2.0 * h * h / t2
    for j in range(3):
        a, b, c = node[3 + j], node[6 + j], node[9 + j]
        u, v, w = y * c - z * b, z * a - x * c, x * b - y * a
        node[3 + j] = a + f * u + g * (y * w - z * v)
        node[6 + j] = b + f * v + g * (z * u - x * w)
        node[9 + j] = c + f * w + g * (x * v - y * u)


@kernel
def _extrapolate(v, s, sigma, move, scale):
    """MIP: sigma <- S (eps + scale D dq), dq = `move` (p then q, 12), at the configuration of `condense`."""
    e1, e2 = 0.0, 0.0
    e3, e4, e5, e6 = 0.0, 0.0, 0.0, 0.0
    for i in range(3):
        u = move[6 + i] - move[i]
        p, q = move[3 + i], move[9 + i]
        e1 += s[_L + i] * u
        e2 += s[_T + i] * (p - q)
        e3 += s[_U + i] * u + s[_V + i] * p
        e4 += s[_U + 3 + i] * u + s[_V + 3 + i] * q
        e5 += s[_U + 6 + i] * u + s[_V + 6 + i] * p
        e6 += s[_U + 9 + i] * u + s[_V + 9 + i] * q
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
    """Move the inner nodes after end q moved by xi (6,) (translation m, rotation rad; frame of p).

    The whole update is multiplied by `scale`; xi is the unscaled increment the tangent of the last `condense`
    was solved for. The stresses of the geometric stiffness are extrapolated, S (eps + scale D dq).
    """
    n = number[0]
    move = store[KEPT * n : KEPT * n + 12]
    for i in range(6):
        move[6 + i] = xi[i]
    for k in range(n - 1, -1, -1):
        v = value[16 * k : 16 * k + 16]
        s = store[KEPT * k : KEPT * k + KEPT]
        for i in range(6):
            move[i] = 0.0
        if k > 0:
            for i in range(5, -1, -1):
                b = s[_B + 8 * i + 6]
                for j in range(6):
                    b += s[_B + 8 * i + j] * move[6 + j]
                b *= -s[_A + 7 * i]
                for j in range(i + 1, 6):
                    b -= s[_A + 6 * i + j] * move[j]
                move[i] = b
            node = inner[12 * k - 12 : 12 * k]
            for i in range(3):
                node[i] += scale * move[i]
            _turn(node, scale * move[3], scale * move[4], scale * move[5])
        at = 12 * (n - 1) + 6 * k
        _extrapolate(v, s, inner[at : at + 6], move, scale)
        for i in range(6):
            move[6 + i] = move[i]


@kernel
def _direction(v, s, tail, near, H):
    """H (3, 3) = exp(near): chord of an undeformed element in the near configuration (paper 1, 3.2)."""
    rotation_exp(near, H)
    for i in range(3):
        s[_L + i] = H[i, 0] * v[7] + H[i, 1] * v[10] + H[i, 2] * v[13]
    tail[_N] = v[0]


@kernel
def _flexible_strains(v, s, tail, H, work):
    """e = D times the flexible displacement (3.6): node rotations from H, gap L - L0 n_l."""
    R, turn = work[:9].reshape(3, 3), work[9:12]
    move = work[12:24]
    for e in range(2):
        for i in range(3):
            move[6 * e + i] = tail[12 * e + i]
            for j in range(3):
                b = 12 * e + 3 + 3 * i
                R[i, j] = tail[b] * H[j, 0] + tail[b + 1] * H[j, 1] + tail[b + 2] * H[j, 2]
        rotation_log(R, turn)
        for i in range(3):
            move[6 * e + 3 + i] = turn[i]
    for i in range(6):
        s[i] = 0.0
    for i in range(3):
        u = move[6 + i] - move[i] - v[0] * s[_L + i]
        p, q = move[3 + i], move[9 + i]
        s[0] += s[_L + i] * u
        s[1] += s[_T + i] * (p - q)
        s[2] += s[_U + i] * u + s[_V + i] * p
        s[3] += s[_U + 3 + i] * u + s[_V + 3 + i] * q
        s[4] += s[_U + 6 + i] * u + s[_V + 6 + i] * p
        s[5] += s[_U + 9 + i] * u + s[_V + 9 + i] * q


@kernel
def _place_nodes(value, n, inner, near, d, work):
    """Inner nodes of the near configuration: chained undeformed elements, closing gap at q spread linearly."""
    H = work[:9].reshape(3, 3)
    x = work[9:12]
    x[:] = 0.0
    for k in range(n):
        rotation_exp(near[3 * k : 3 * k + 3], H)
        v = value[16 * k : 16 * k + 16]
        for i in range(3):
            x[i] += v[0] * (H[i, 0] * v[7] + H[i, 1] * v[10] + H[i, 2] * v[13])
            if k < n - 1:
                inner[12 * k + i] = x[i]
    for k in range(n - 1):
        rotation_exp(near[3 * (n + k) : 3 * (n + k) + 3], H)
        for i in range(3):
            inner[12 * k + i] += (d[i] - x[i]) * (k + 1) / n
            for j in range(3):
                inner[12 * k + 3 + 3 * i + j] = H[i, j]


@kernel
def near_condense(value, number, inner, store, near, d, Q, lam, K, geometric):
    """Stiffness linearised in the near configuration (element orientation based, paper 1, section 3), condensed.

    `near` (3 (2n-1),): rotation vectors from the undeformed state of the n elements, then of the n-1 inner
    nodes, frame of p. The elements are undeformed at these orientations; the small rest is linear, force
    D^T S e, tangent D^T S D, plus the second derivatives with stresses S e if geometric = 1. Sets the inner
    nodes and leaves `store` so that `recover` gives the deformed inner state with extrapolated stresses.
    Arguments and returns otherwise as `condense`.
    """
    n = number[0]
    tail = store[KEPT * n : KEPT * n + TAIL]
    R, H = np.empty((3, 3)), np.empty((3, 3))
    work = np.zeros(24)
    rest = np.zeros(6)
    _place_nodes(value, n, inner, near, d, work)
    _end_rotation(value, n, Q, R)
    _fix_start(tail)
    negatives = 0
    force = moment = 0.0
    for k in range(n):
        v = value[16 * k : 16 * k + 16]
        s = store[KEPT * k : KEPT * k + KEPT]
        _load_node(tail, inner, k if k < n - 1 else -1, d, R)
        _node_axes(v, tail)
        _direction(v, s, tail, near[3 * k : 3 * k + 3], H)
        status = _gradients(v[0], s, tail)
        if status != 0:
            return negatives, math.inf, math.inf, status
        _flexible_strains(v, s, tail, H, work)
        _stresses(v, s, tail)
        sigma = tail[_S : _S + 6] if geometric != 0 else rest
        rf, rm = _tangent(v, sigma, s, tail, k == 0)
        if k > 0:
            force, moment = max(force, rf), max(moment, rm)
            found = _eliminate(s, tail)
            if found < 0:
                return negatives, math.inf, math.inf, 2
            negatives += found
    ef, em = _finish(tail, lam, K, force, moment)
    return negatives, ef, em, 0 if math.isfinite(ef + em + lam[0] + K[0, 0]) else 2


@kernel
def energy(value, number, inner, d, Q):
    """Strain energy [J], sum of eps S eps / 2, with end q at d (3,), Q (3, 3)."""
    n = number[0]
    store = np.empty(KEPT + TAIL)
    s, tail = store[:KEPT], store[KEPT:]
    R = np.empty((3, 3))
    _end_rotation(value, n, Q, R)
    _fix_start(tail)
    total = 0.0
    for k in range(n):
        v = value[16 * k : 16 * k + 16]
        _load_node(tail, inner, k if k < n - 1 else -1, d, R)
        _node_axes(v, tail)
        _chord(s, tail)
        _gradients(v[0], s, tail)
        _strains(v[0], s, tail)
        _stresses(v, s, tail)
        for i in range(6):
            total += 0.5 * tail[_S + i] * s[i]
    return total


@kernel
def section_forces(value, number, inner, d, Q, out):
    """Section forces out (n, 2, 6): N, Vy, Vz [N], T, My, Mz [Nm] at ends p and q of each element.

    Element axes: x along the chord, y and z of the nodes; positive on the section whose outward normal is +x.
    The shear forces are those of moment balance over the deformed chord.
    """
    n = number[0]
    store = np.empty(KEPT + TAIL)
    s, tail = store[:KEPT], store[KEPT:]
    R = np.empty((3, 3))
    _end_rotation(value, n, Q, R)
    _fix_start(tail)
    for k in range(n):
        v = value[16 * k : 16 * k + 16]
        _load_node(tail, inner, k if k < n - 1 else -1, d, R)
        _node_axes(v, tail)
        _chord(s, tail)
        _gradients(v[0], s, tail)
        _strains(v[0], s, tail)
        _stresses(v, s, tail)
        ratio = v[0] / tail[_N]
        for e in range(2):
            out[k, e, 0] = tail[_S]
            out[k, e, 1] = ratio * (tail[_S + 4] - tail[_S + 5])
            out[k, e, 2] = ratio * (tail[_S + 3] - tail[_S + 2])
            out[k, e, 3] = v[0] * tail[_S + 1]
            out[k, e, 4] = v[0] * tail[_S + 2 + e]
            out[k, e, 5] = v[0] * tail[_S + 4 + e]
