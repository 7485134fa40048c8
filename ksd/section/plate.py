"""Plate stiffening: a wide leaf bends stiffer than a beam, since its anticlastic curvature is suppressed."""

from __future__ import annotations

import math

from ksd.checks import between, positive


def plate_factor(width: float, thickness: float, curvature: float, nu: float) -> float:
    """Factor on E Iz of a strip bent to `curvature` [1/m]: 1 for a beam, 1/(1 - nu^2) for a wide plate.

    M R / (E I) = [1 - nu^2 (3/(2p) (cosh p - cos p)/(sinh p + sin p) + sinh p sin p / (sinh p + sin p)^2)] / (1 - nu^2)
    with p^2 = sqrt(3 (1 - nu^2)) w^2 |curvature| / t, Searle's parameter times a constant. Source: D. G. Ashwell, The
    anticlastic curvature of rectangular beams and plates, J. Royal Aeronautical Society 54 (1950) 708-715. The cross-section
    of the strip is free to curl, so the ends of a short leaf, where clamps hold it flat, are not modelled. Lengths in m, nu
    Poisson's ratio. Raises SceneError for lengths that are not positive.
    """
    w = positive(width, "width", owner="plate factor", unit="m")
    t = positive(thickness, "thickness", owner="plate factor", unit="m")
    nu = between(nu, "nu", -1.0, 0.500001, owner="plate factor")
    square = math.sqrt(3 * (1 - nu * nu)) * w * w * abs(curvature) / t
    p = math.sqrt(square)
    if p < 0.05:
        # series of the inner bracket, without the cancellation of the closed form
        bracket = 1.0 - square * square / 90.0
    elif p > 300.0:
        bracket = 1.5 / p
    else:
        denominator = math.sinh(p) + math.sin(p)
        bracket = (
            1.5 / p * (math.cosh(p) - math.cos(p)) / denominator + math.sinh(p) * math.sin(p) / denominator**2
        )
    return (1.0 - nu * nu * bracket) / (1.0 - nu * nu)
