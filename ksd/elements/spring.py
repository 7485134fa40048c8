"""A coil spring between two points; interface as `ksd.elements.linear`.

Energy of a coil spring: k (l - l0)^2 / 2 with l the distance of its ends. Force on end q along u = d / l:
n = k (l - l0) u, tangent dn/dd = k u u^T + k (1 - l0/l) (I - u u^T); with l0 = 0 simply n = k d.
"""

from __future__ import annotations

import math

from ksd.numerics.kernel import kernel


@kernel
def coil_condense(value, d, lam, K):
    """Write lam (12,), K (6, 6) of value = (k [N/m], l0 [m]) at d (3,) [m], end q in frame p; return 2 where l = 0 <
    l0, else 0."""
    k, free_length = value[0], value[1]
    l = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    K[:, :] = 0.0
    lam[:] = 0.0
    if free_length > 0.0 and not l > 1e-9 * free_length:
        return 2
    across = k if free_length == 0.0 else k * (1.0 - free_length / l)
    along = 0.0 if free_length == 0.0 else k * free_length / (l * l * l)
    for i in range(3):
        lam[i] = across * d[i]
        lam[6 + i] = lam[i]
        K[i, i] = across
        for j in range(3):
            K[i, j] += along * d[i] * d[j]
    return 0
