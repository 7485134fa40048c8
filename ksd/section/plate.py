"""How much stiffer than a beam a wide leaf bends: anticlastic curvature and its suppression."""

from __future__ import annotations

import math

from ksd.checks import between, positive


def plate_factor(width: float, thickness: float, curvature: float, nu: float) -> float:
    """Factor on E Iz of a strip bent to `curvature` [1/m]: 1 for a beam, 1/(1 - nu^2) for a wide plate.

    M R / (E I) = [1 - nu^2 (3/(2p) (cosh p - cos p)/(sinh p + sin p) + sinh p sin p / (sinh p + sin p)^2)] / (1 - nu^2)
    with p^2 = sqrt(3 (1 - nu^2)) w^2 |curvature| / t, Searle's parameter times a constant. Source: D. G. Ashwell, The
    anticlastic curvature of rectangular beams and plates, J. Royal Aeronautical Society 54 (1950) 708-715; the strip
    keeps its cross-section free to curl, so the ends of a short leaf, where clamps hold it flat, are not in it. Lengths
    in m, nu Poisson's ratio. Raises SceneError for lengths that are not positive.
    """
    w = positive(width, "width", owner="plate factor", unit="m")
    t = positive(thickness, "thickness", owner="plate factor", unit="m")
    nu = between(nu, "nu", -1.0, 0.500001, owner="plate factor")
    square = math.sqrt(3 * (1 - nu * nu)) * w * w * abs(curvature) / t
    p = math.sqrt(square)
    if p < 0.05:
        # the brackets are 1 - p^4/90 + .., whose digits the closed form loses
        free = 1.0 - square * square / 90.0
    elif p > 300.0:
        free = 1.5 / p
    else:
        both = math.sinh(p) + math.sin(p)
        free = 1.5 / p * (math.cosh(p) - math.cos(p)) / both + math.sinh(p) * math.sin(p) / both**2
    return (1.0 - nu * nu * free) / (1.0 - nu * nu)
