"""Planar compliant links of Lan's thesis (2005), beside the numbers of `published_planar` and of the examples."""

import math

import pytest
from planar_scenes import slider

import ksd


@pytest.mark.parametrize(
    "ratio, share, extra", [(0.1, 0.2, 0.00852810), (0.1, 0.6, 0.00620793), (0.2, 0.2, 0.0341186)]
)
def test_shear_of_a_cantilever(ratio, share, extra):
    """Section 2.2: the load that bends a rod without shear by a share of its length, with shear (E/G 3, k = 5/6)."""
    length, I, A = 1.0, 1.0 / 12 * ratio**2, 1.0

    def tip(load, shear):
        k = 5 / 6 if shear else 1e9
        # EA is beyond what would matter; E/G = 3 with kA of the shear area alone
        section = ksd.numbers(
            A=1e9, J=I, Iy=I, Iz=I, ky=k * A / 1e9, kz=k * A / 1e9, width=1.0, thickness=ratio
        )
        scene = ksd.Mechanism("cantilever", plane="xy")
        end = scene.link("tip")
        scene.leaf("ground", end, start=(0, 0, 0), end=(length, 0, 0), section=section,
                   material=ksd.Material(E=1.0, G=1 / 3))  # fmt: skip
        scene.load(end, force=(0, load, 0), at=(length, 0, 0))
        return float(ksd.solve(scene, strict=False).displacement("tip")[1])

    from scipy.optimize import brentq

    load = brentq(lambda p: tip(p * I, False) - share, 0.1, 8.0, xtol=1e-13) * I
    assert tip(load, True) / share - 1 == pytest.approx(extra, rel=1e-4)


@pytest.mark.parametrize("phi, d", [(90, 20e-3), (45, 15e-3)])
def test_a_pin_holds_both_its_links(phi, d):
    found = ksd.solve(slider(math.radians(phi)), d=d)
    one, two = (found.displacement(link, (0.1, 0, 0)) for link in ("one", "two"))
    assert one == pytest.approx(two, abs=1e-12)
