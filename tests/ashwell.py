"""Ashwell's bending stiffness of a strip with free edges: the closed form beside the plate stiffening of leaf springs."""

import math

import numpy as np

from ksd.section.plate import free_curl


def plate_factor(width: float, thickness: float, curvature: float, nu: float) -> float:
    """Factor on E Iz of a strip bent to `curvature` [1/m]: 1 for a beam, 1/(1 - nu^2) for a wide plate.

    M R / (E I) = [1 - nu^2 (3/(2p) (cosh p - cos p)/(sinh p + sin p) + sinh p sin p / (sinh p + sin p)^2)] / (1 - nu^2)
    with p^2 = sqrt(3 (1 - nu^2)) w^2 |curvature| / t, Searle's parameter times a constant. The cross-section of the
    strip is free to curl, so the ends of a short leaf, where clamps hold it flat, are not modelled. Lengths in m.
    """
    square = math.sqrt(3 * (1 - nu * nu)) * width**2 * abs(curvature) / thickness
    p = math.sqrt(square)
    if p < 0.05:
        # series of the inner bracket, without the cancellation of the closed form
        bracket = 1.0 - square * square / 90.0
    elif p > 300.0:
        bracket = 1.5 / p
    else:
        edge = math.sinh(p) * math.sin(p) / (math.sinh(p) + math.sin(p)) ** 2
        bracket = 0.75 * float(free_curl(np.array(p))) + edge
    return (1.0 - nu * nu * bracket) / (1.0 - nu * nu)
