"""A linear body between two end frames: a joint condensed to its interfaces (Craig-Bampton boundary modes).

inner = d0 (3), R0 (9, row-major), F (6), K (36, row-major): reference relative pose of end q in frame p, wrench there,
and stiffness. Paper 1, eq. 2.4, written in the frame of interface A so that it is objective.
"""

from __future__ import annotations

from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import log_tangent, rotation_log

LINEAR_INNER = 54
"""Length of the inner state of a linear body."""


@kernel
def linear_condense(inner, d, Q, lam, K, A, M):
    """Write lam (12,), K (6, 6) at end pose d (3,), Q (3, 3): f = F + K xi, xi = (d - d0, log(Q R0^T)).

    The moment is T^T f_r with T the tangent of the logarithm; K carries its second derivative
    (f x^T + x f^T - 2 f.x I)/12. A (2, 6), M (6, 6) or larger: scratch. Returns as every member: no negative pivots, no
    inner residual, status 0.
    """
    xi, f = A[0], A[1]
    for i in range(3):
        xi[i] = d[i] - inner[i]
        for j in range(3):
            M[i, j] = Q[i, 0] * inner[3 + 3 * j] + Q[i, 1] * inner[4 + 3 * j] + Q[i, 2] * inner[5 + 3 * j]
    rotation_log(M, xi[3:])
    log_tangent(xi[3:], M)
    for i in range(6):
        s = inner[12 + i]
        for j in range(6):
            s += inner[18 + 6 * i + j] * xi[j]
        f[i] = s
    dot = f[3] * xi[3] + f[4] * xi[4] + f[5] * xi[5]
    # columns 3..5 of K in the chart of xi, times T in M[:3, :3]
    for i in range(6):
        a, b, c = inner[21 + 6 * i], inner[22 + 6 * i], inner[23 + 6 * i]
        for j in range(3):
            M[i, 3 + j] = a * M[0, j] + b * M[1, j] + c * M[2, j]
    for i in range(3):
        lam[i] = f[i]
        lam[3 + i] = M[0, i] * f[3] + M[1, i] * f[4] + M[2, i] * f[5]
        for j in range(3):
            K[i, j] = inner[18 + 6 * i + j]
            q = (f[3 + i] * xi[3 + j] + xi[3 + i] * f[3 + j]) / 12.0
            if i == j:
                q -= dot / 6.0
            K[i, 3 + j], K[3 + j, i] = M[i, 3 + j], M[i, 3 + j]
            K[3 + i, 3 + j] = q + M[0, i] * M[3, 3 + j] + M[1, i] * M[4, 3 + j] + M[2, i] * M[5, 3 + j]
    for i in range(6):
        lam[6 + i] = lam[i]
    return 0, 0.0, 0.0, 0
