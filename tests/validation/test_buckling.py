"""Buckling beside the closed forms of `published_beams`: chains of elements, and what happens at the critical load."""

import numpy as np
import pytest
from hard_scenes import right_angle
from published_beams import CLAMPED, L, euler, strip
from scenes import STEEL

import ksd
from ksd.answers.buckling import buckling
from ksd.model.compile import compile_scene
from ksd.model.mesh import Mesh
from ksd.section import rectangle
from ksd.solvers.conventional import solve_conventional


@pytest.mark.parametrize("n, expected", [(4, 1.2157), (8, 1.0523), (16, 1.0130)])
def test_clamped_column_of_appendix_A_elements(n, expected):
    """The chain converges from above, quadratically, as the mesh is refined."""
    assert euler(CLAMPED, Mesh("corotational", elements=n)) / (4 * np.pi**2) == pytest.approx(
        expected, abs=1e-3
    )


def test_a_loaded_column_loses_its_stability_at_the_multiplier():
    """Negative pivots appear between .99 and 1.01 of the linearised load."""
    model = strip(CLAMPED)
    critical = buckling(model, model.rest, "tip", force=(-1, 0, 0), at=(L, 0, 0)).positive
    counts = []
    for share in (0.99, 1.01):
        scene = ksd.Mechanism("column")
        tip = scene.link("tip")
        scene.leaf(
            scene.ground, tip, start=(0, 0, 0), end=(L, 0, 0), section=rectangle(0.5e-3, 0.02), material=STEEL,
            width_axis=(0, 0, 1), name="leaf",
        )  # fmt: skip
        for kind, axis in CLAMPED:
            scene.support(tip, at=(L, 0, 0), **{kind: axis})
        scene.load(tip, force=(-share * critical, 0, 0), at=(L, 0, 0))
        state = solve_conventional(compile_scene(scene), {})
        counts.append(state.negatives - state.expected_negatives)
    assert counts == [0, 1]


@pytest.mark.parametrize("length", [1e-6, 1e-3, 10.0])
def test_critical_loads_of_a_bent_column_of_any_size(length):
    """Free at its end, of micrometres to metres: Haringx' loads of one and three quarter waves."""
    scene, bent = ksd.Mechanism("column"), rectangle(length / 100, length / 5)
    tip, at = scene.link("tip"), (length, 0, 0)
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=at, section=bent, material=STEEL, width_axis="z")
    load = np.pi**2 / 4 * STEEL.E * bent.Iz / length**2
    scene.load(tip, force=(0, 1e-3 * load, 0), at=at)
    found = ksd.solve(scene).buckling("tip", force=(-load, 0, 0), at=at, count=2)
    expected = [haringx(n * n * load, bent) / load for n in (1, 3)]
    assert found.factor == pytest.approx(expected, rel=5e-6)


def haringx(load, section):
    """Critical load of a column whose critical load without stretch and shear is `load`, P (1 + P/GA - P/EA) = load:
    Haringx, On highly compressible helical springs and rubber rods, Philips Research Reports 3 (1948)."""
    soft = 1 / (section.ky * STEEL.G * section.A) - 1 / (STEEL.E * section.A)
    return (np.sqrt(1 + 4 * load * soft) - 1) / (2 * soft)


@pytest.mark.parametrize("slenderness", [30, 10, 3])
def test_shear_lowers_critical_loads(slenderness):
    """From rest, from half of the load, as a multiple of all stresses, and in the loaded state itself: one load."""
    scene, thick = ksd.Mechanism("column", plane="xy"), rectangle(5e-3, 0.02)
    length = slenderness * thick.thickness
    at, tip = (length, 0, 0), scene.link("tip")
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=at, section=thick, material=STEEL)
    bent = np.pi**2 / 4 * STEEL.E * thick.Iz / length**2
    critical = haringx(bent, thick)
    rest = ksd.solve(scene).buckling("tip", force=(-critical, 0, 0), at=at)
    assert rest.positive == pytest.approx(1.0, rel=1e-7)
    scene.load(tip, force=(-0.5 * critical, 0, 0), at=at)
    half = ksd.solve(scene)
    assert half.buckling("tip", force=(-0.5 * critical, 0, 0), at=at).positive == pytest.approx(1.0, rel=1e-7)
    found = half.buckling().factor
    assert 0.5 * found[0] == pytest.approx(1.0, rel=1e-7)
    assert 0.5 * critical * found[1] == pytest.approx(haringx(9 * bent, thick), rel=1e-6)
    for share, stable in ((1 - 1e-6, True), (1 + 1e-6, False)):
        loaded = ksd.Mechanism("column", plane="xy")
        end = loaded.link("tip")
        loaded.leaf(loaded.ground, end, start=(0, 0, 0), end=at, section=thick, material=STEEL)
        loaded.load(end, force=(-share * critical, 0, 0), at=at)
        state = solve_conventional(compile_scene(loaded), {})
        assert (state.negatives == state.expected_negatives) == stable


def test_chains_say_what_their_stretch_leaves_out():
    """Critical loads of a short column in 12 elements are off by about the stretch there, which the answer says."""
    scene, thick = ksd.Mechanism("column", plane="xy"), rectangle(5e-3, 0.02)
    at, tip = (0.015, 0, 0), scene.link("tip")
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=at, section=thick, material=STEEL)
    critical = haringx(np.pi**2 / 4 * STEEL.E * thick.Iz / 0.015**2, thick)
    chain = ksd.Mesh("corotational", elements=12)
    rest = ksd.solve(scene, mesh=chain).buckling("tip", force=(-critical, 0, 0), at=at, count=1)
    assert abs(rest.factor[0] - 1) == pytest.approx(rest.stretch[0], rel=0.2)
    assert rest.stretch[0] == pytest.approx(critical / (STEEL.E * thick.A), rel=0.05)
    assert "their stretch does to a factor: about 2 % of the first" in " ".join(str(rest).split())
    scene.load(tip, force=(-0.01 * critical, 0, 0), at=at)
    loaded = ksd.solve(scene, mesh=chain).buckling(count=1)
    assert abs(0.01 * loaded.factor[0] - 1) == pytest.approx(loaded.stretch[0], rel=0.2)
    assert not ksd.solve(scene).buckling(count=1).stretch.any()


def test_a_load_that_nothing_feels_has_no_factor():
    """Across a planar frame: what is left of its effect is rounding."""
    scene = right_angle(0.95)
    found = ksd.solve(scene, strict=False).buckling("right", force=(0, 0, 1.0))
    assert not len(found.factor)


def test_dense_and_iterated_factors_of_a_short_wide_guide_agree(monkeypatch):
    """Its matrices have many entries of one size; rounding among them once cost the dense eigensolution its digits."""
    import ksd.answers.buckling as module

    joint = ksd.ParallelGuide(STEEL, length=0.05, thickness=5e-4, width=0.04, spacing=0.06)
    scene = ksd.Mechanism("guide")
    stage = scene.link("stage")
    placed = scene.join(scene.ground, stage, joint, at=(0, 0, 0), axis="z", toward="x")
    scene.actuate_joint(placed, name="push")
    scene.consider("plate")
    pose = ksd.solve(scene, push=5e-3, method="conventional")
    dense = pose.buckling().factor
    monkeypatch.setattr(module, "MAX_DENSE", 0)
    assert pose.buckling().factor == pytest.approx(dense, rel=1e-7)
