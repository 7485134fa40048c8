"""What an answer uses of what its materials bear, and what is said of states that no beam can be in."""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_bvp

import ksd
from ksd.errors import SceneError

SCENES = Path(ksd.__file__).parent / "scenes"
STEEL = {"E": 200e9, "nu": 0.3, "name": "steel"}


def one_leaf(*, length=0.05, thickness=0.02, width=0.01, material=None, held=False):
    """A leaf along x whose end is turned about z, or, held, moved across with its length and direction kept."""
    m = ksd.Mechanism("leaf")
    tip = m.link("tip")
    m.leaf(
        m.ground, tip, start=(0, 0, 0), end=(length, 0, 0), section=ksd.rectangle(thickness, width),
        material=material or ksd.Material(**STEEL), width_axis="z", name="leaf",
    )  # fmt: skip
    if held:
        m.actuate(tip, along="y", at=(length, 0, 0), name="drive")
        m.support(tip, along="x", at=(length, 0, 0))
        m.support(tip, about="z")
    else:
        m.actuate(tip, about="z", name="drive")
    return m


def test_a_thick_leaf_bent_to_16_gpa_is_not_trusted():
    pose = ksd.solve(one_leaf(), {"drive": 0.4})
    # pure bending: strain = angle t / 2 L
    assert pose.strength.strain == pytest.approx(0.4 * 0.02 / 0.1, rel=1e-6)
    assert pose.strength.stress_Pa == pytest.approx(16e9, rel=1e-6)
    assert not pose.trusted and "strained by 8 %" in pose.trust.trusted.sentence
    assert any("2.5 thicknesses" in w for w in pose.warnings)
    said = " ".join(str(pose).split())
    assert "Not to be trusted" in said and "16000" in said and "Warning: leaf 'leaf'" in said
    assert pose.as_dict()["strength"]["largest_strain_percent"] == pytest.approx(8.0, rel=1e-6)


def test_a_slender_leaf_within_its_limits_is_trusted_and_says_its_share():
    steel = ksd.Material(**STEEL, yield_stress=1.0e9, fatigue_limit=0.4e9)
    pose = ksd.solve(one_leaf(length=0.1, thickness=5e-4, width=0.02, material=steel), {"drive": 1.0})
    used = pose.strength
    assert used.strain == pytest.approx(2.5e-3, rel=1e-6) and used.stress_Pa == pytest.approx(5e8, rel=1e-6)
    assert used.yield_share == pytest.approx(0.5, rel=1e-6)
    assert used.fatigue_share == pytest.approx(1.25, rel=1e-6)
    assert pose.trusted and pose.warnings == (
        "the stress in leaf 'leaf' is 1.25 times the fatigue limit of its material",
    )
    said = " ".join(str(pose).split())
    assert "50.0 % of the yield stress" in said and "125 % of the fatigue limit" in said
    found = pose.as_dict()["strength"]
    assert found["yield_percent"] == pytest.approx(50.0, rel=1e-6) and found["yield_leaf"] == "leaf"


def test_a_leaf_beyond_its_yield_stress_is_not_trusted():
    steel = ksd.Material(**STEEL, yield_stress=0.4e9)
    pose = ksd.solve(one_leaf(length=0.1, thickness=5e-4, width=0.02, material=steel), {"drive": 1.0})
    assert not pose.trusted and "1.25 times its yield stress" in pose.trust.strength.sentence


def test_strain_of_torsion_is_half_the_shear_angle():
    m = ksd.Mechanism("shaft")
    tip = m.link("tip")
    material = ksd.Material(**STEEL)
    m.wire(m.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), diameter=2e-3, material=material, name="shaft")
    m.actuate(tip, about="x", name="drive")
    for axis in "yz":
        m.support(tip, along=axis, at=(0.1, 0, 0))
        m.support(tip, about=axis)
    pose = ksd.solve(m, {"drive": 0.2})
    assert pose.strength.strain == pytest.approx(0.5 * 0.2 * 1e-3 / 0.1, rel=1e-3)


def test_a_taut_leaf_says_what_the_law_of_elasticity_matters():
    pose = ksd.solve(one_leaf(length=0.1, thickness=1e-3, width=0.02, held=True), {"drive": 0.01})
    # sqrt(1 + (d/L)^2) - 1 along the leaf, and as much again and more by bending at its ends
    assert 0.01 < pose.strength.strain < 0.05
    assert pose.trusted and any("law of elasticity" in w for w in pose.warnings)
    # with the error told, which is of the mesh and the method alone
    said = " ".join(str(pose).split())
    law = f"{150 * pose.strength.strain:.2g} %"
    share = f"in addition, at this strain the force depends on the law of elasticity by about {law}"
    assert share in said and said.index("Estimated error") < said.index(share)
    small = ksd.solve(one_leaf(length=0.1, thickness=1e-3, width=0.02, held=True), {"drive": 0.001})
    assert "law of elasticity" not in str(small)
    beyond = ksd.solve(one_leaf(length=0.1, thickness=1e-3, width=0.02, held=True), {"drive": 0.04})
    assert not beyond.trusted


def test_share_of_the_leaf_whose_material_is_nearest_its_limit():
    weak = ksd.Material(70e9, nu=0.33, name="weak", yield_stress=1e8)
    strong = ksd.Material(200e9, nu=0.3, name="strong", yield_stress=2e9)
    m = ksd.Mechanism("pair")
    tip = m.link("tip")
    for name, y, material in (("low", 0.0, weak), ("high", 0.05, strong)):
        m.leaf(
            m.ground, tip, start=(0, y, 0), end=(0.1, y, 0), section=ksd.rectangle(5e-4, 0.02), material=material,
            width_axis="z", name=name,
        )  # fmt: skip
    m.actuate(tip, along="y", at=(0.1, 0, 0), name="drive")
    pose = ksd.solve(m, {"drive": 2e-3})
    assert pose.strength.stress_leaf == "high" and pose.strength.yield_leaf == "low"
    assert pose.strength.yield_share > pose.strength.stress_Pa / 2e9


@pytest.mark.parametrize("method", ["kinematic", "reduced", "full", "conventional", "modal"])
def test_every_method_says_it(method):
    scene, _, _ = ksd.load_scene(SCENES / "fourbar.toml")
    pose = ksd.solve(scene, {"top": 0.1}, method=method)
    assert 1e-3 < pose.strength.strain < 1e-2 and pose.trust.strength
    assert pose.strength.stress_Pa == pytest.approx(pose.stress().largest_Pa, rel=0.05)


@pytest.mark.parametrize("word", ["yield_stress", "fatigue_limit"])
def test_limits_are_positive(word):
    for bad in (0.0, -1.0, np.nan, "1 GPa"):
        with pytest.raises(SceneError, match=word):
            ksd.Material(**STEEL, **{word: bad})


def test_prepared_solves_do_not_look_at_strain(monkeypatch):
    import ksd.answers.strength as module

    solver = ksd.prepare(one_leaf())
    monkeypatch.setattr(module, "strength", lambda *a, **k: pytest.fail("looked"))
    pose = solver({"drive": 0.4})
    assert pose.forces["drive"] > 0.0


def test_a_taut_leaf_against_an_integrated_rod():
    """Reissner's rod with the same law, by scipy: the leaf has its forces, and says so where its modes are too few.

    A taut leaf bends in layers at its ends, 1/70 and 1/360 of its length here; 12 modes resolve the first to 1e-3.
    """
    for thickness, way, bound in ((3e-3, 0.03, 1e-4), (1e-3, 0.02, 1e-3), (2e-4, 0.03, 0.02)):
        # free to leave its plane, as the thickest of them would
        scene = one_leaf(length=0.1, thickness=thickness, width=0.02, held=True)
        pose = ksd.solve(scene, {"drive": way}, strict=False)
        off = abs(pose.forces["drive"] / rod_force(0.1, thickness, 0.02, way) - 1)
        said = any("modes" in w and "more are not possible" in w for w in pose.warnings)
        assert off < bound and (off < 1e-3 or said)


def rod_force(length, thickness, width, way):
    """Force [N] across on the end of a clamped rod, stretch, shear and curvature linear in force and moment."""
    area = thickness * width
    EA, EI, GA = 200e9 * area, 200e9 * area * thickness**2 / 12, 200e9 / 2.6 * area * 5 / 6

    def slope(s, Y, p):
        c, n, (fx, fy) = np.cos(Y[2]), np.sin(Y[2]), 0.01 * EA * p
        stretch, shear = 1 + (fx * c + fy * n) / EA, (fy * c - fx * n) / GA
        dx, dy = stretch * c - shear * n, stretch * n + shear * c
        return np.vstack([dx, dy, Y[3] / length, -(dx * fy - dy * fx) * length / EI])

    s, found = np.linspace(0, length, 401), None
    for d in np.linspace(0.002, way, 6):
        u = s / length
        start = np.vstack(
            [s, d * (3 * u**2 - 2 * u**3), d / length * 6 * (u - u * u), d / length * (6 - 12 * u)]
        )
        guess = (s, start, np.array([0.01, 0.01])) if found is None else (found.x, found.y, found.p)

        def ends(a, b, p, d=d):
            return np.array([a[0], a[1], a[2], b[0] - length, b[1] - d, b[2]])

        found = solve_bvp(slope, ends, *guess, tol=1e-6, max_nodes=100_000)
        assert found.success
    return 0.01 * EA * found.p[1]


@pytest.mark.parametrize(("ratio", "nu"), [(1.0, 0.0), (1 / 2.6, 0.3), (0.25, 0.5)])
def test_principal_strain_of_a_bent_and_twisted_wire(ratio, nu):
    """Poisson's ratio E/2G - 1, within 0 and 0.5 where the moduli are not those of an isotropic material."""
    m = ksd.Mechanism("shaft")
    tip = m.link("tip")
    material = ksd.Material(E=200e9, G=ratio * 200e9)
    m.wire(m.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), diameter=2e-3, material=material, name="shaft")
    for axis, name in zip("xyz", ("twist", "level", "bend"), strict=True):
        m.actuate(tip, about=axis, name=name)
    pose = ksd.solve(m, twist=0.01, level=0.0, bend=0.01, method="conventional")
    e = g = 0.01 * 1e-3 / 0.1
    wanted = 0.5 * ((1 - nu) * e + np.hypot((1 + nu) * e, g))
    assert pose.strength.strain == pytest.approx(wanted, rel=2e-3)
