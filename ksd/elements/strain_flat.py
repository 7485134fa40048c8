"""Tangent of a strain-mode leaf that is bent in its plane only: weak bending is not coupled with torsion and strong
bending.

Out-of-plane motions have rotation vectors in the plane, here complex numbers x + i y: the product e3 x (..) is i (..),
the curvature of torsion is real, that of strong bending imaginary. The moments of an interval are (0, 0, p), (0, 0, s),
(0, 0, q), its rotation is p about e3, and of J and G, see `ksd.elements.magnus`, the three columns of torsion suffice:
those of strong bending are i times as large.
"""

from __future__ import annotations

from ksd.elements.magnus import INVERSE_360
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import tangent_factors


@kernel(inline="late")
def is_flat(number, inner, n):
    """Whether a leaf is bent in its plane only, exactly; inner, n (ng, 3): as in `ksd.elements.strain`."""
    out_of_plane, N = number[0] + number[1], number[0] + number[1] + number[2]
    flat = inner[N + 3] == 0.0 and inner[N + 4] == 0.0
    for i in range(out_of_plane):
        flat = flat and inner[i] == 0.0
    for h in range(number[3]):
        flat = flat and n[h, 2] == 0.0
    return flat


@kernel(inline="late")
def flat_tangent(value, number, inner, modes, weight, moment, J, G, psi, n, v, slope, W, Y, X, Z):
    """Add W (lower) and the residual in Y of `ksd.elements.strain.strain_tangent`, without the leaf's own stiffness.

    W and Y must be zero before. modes, weight: offsets of the moments over the intervals and of the weights in value.
    Going back from end q: M, the moment about e3 carried by an interval, and X, its derivative by the amplitudes, at
    end q as given.
    """
    nx, out_of_plane, N, ng = number[0], number[0] + number[1], number[0] + number[1] + number[2], number[3]
    length, M = value[0], inner[N + 5]
    for h in range(ng, -1, -1):
        at = modes + 3 * N * h
        if h < ng:
            w = length * value[weight + h]
            k0, k1 = w * n[h, 0], w * n[h, 1]
            M += v[h, 0] * k1 - v[h, 1] * k0
            for i in range(out_of_plane):
                X[0, i] -= slope[h, 2, i] * k1
                X[1, i] += slope[h, 2, i] * k0
            for i in range(out_of_plane, N):
                X[2, i] += slope[h, 0, i] * k1 - slope[h, 1, i] * k0
        for i in range(out_of_plane, N):
            p = length * value[at + i]
            Y[i, 6] -= p * M
            for j in range(out_of_plane, i + 1):
                W[i, j] -= p * X[2, j]
        p, s, q, u = moment[h, 2], moment[h, 5], moment[h, 8], M * INVERSE_360
        # second derivative by the moments, Hermitian: c p M conj(j) j, and that of u.turn
        jp, gp = complex(J[h, 0, 0], J[h, 1, 0]), complex(G[h, 0, 0], -G[h, 1, 0])
        js, gs = complex(J[h, 0, 3], J[h, 1, 3]), complex(G[h, 0, 3], -G[h, 1, 3])
        jq, gq = complex(J[h, 0, 6], J[h, 1, 6]), complex(G[h, 0, 6], -G[h, 1, 6])
        _, c, _, _ = tangent_factors(p * p)
        c *= p * M
        pp = c * (jp.real * jp.real + jp.imag * jp.imag) - 2.0 * u * q
        ss = c * (js.real * js.real + js.imag * js.imag) - 3.0 * u * p
        qq = c * (jq.real * jq.real + jq.imag * jq.imag)
        ps = c * jp.conjugate() * js + complex(1.5 * u * s, -(30.0 + 0.5 * p * p) * u)
        pq = c * jp.conjugate() * jq + u * p
        sq = c * js.conjugate() * jq - complex(0.0, u)
        sp, qp, qs = ps.conjugate(), pq.conjugate(), sq.conjugate()
        for i in range(out_of_plane):
            p, s, q = length * value[at + i], length * value[at + N + i], length * value[at + 2 * N + i]
            # with the rotation at the middle of the interval
            x = complex(
                X[0, i] - 0.5 * M * (psi[h, 1, i] + psi[h + 1, 1, i]),
                X[1, i] + 0.5 * M * (psi[h, 0, i] + psi[h + 1, 0, i]),
            )
            zp, zs, zq = pp * p + ps * s + pq * q, sp * p + ss * s + sq * q, qp * p + qs * s + qq * q
            axis = 0 if i < nx else 1
            if axis == 1:
                zp, zs, zq = 1j * zp, 1j * zs, 1j * zq
            zp, zs, zq = zp + gp * x, zs + gs * x, zq + gq * x
            Z[i, 0], Z[i, 3], Z[i, 6] = zp.real, zs.real, zq.real
            Z[i, 1], Z[i, 4], Z[i, 7] = zp.imag, zs.imag, zq.imag
            for j in range(i + 1):
                W[i, j] -= p * Z[j, axis] + s * Z[j, 3 + axis] + q * Z[j, 6 + axis]
