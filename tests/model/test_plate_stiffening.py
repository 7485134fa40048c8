"""Plate stiffening of leaf springs with clamped ends, in mechanisms."""

import numpy as np
import pytest
from ashwell import plate_factor

import ksd
from ksd.errors import SceneError
from ksd.units import deg, mm

STEEL = ksd.Material(E=200e9, nu=0.3)


def strip(length, width, thickness, *, nu=0.3, guided=False, points=(), radius=0.0, **words):
    """A leaf along x from ground to the link 'tip', which 'drive' turns, or moves along y without turning (`guided`)."""
    scene = ksd.Mechanism("strip")
    tip = scene.link("tip")
    chord = 2 * radius * np.sin(0.5 * length / radius) if radius else length
    if radius:
        words["curve"] = ksd.Arc(radius=radius, angle=length / radius)
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(chord, 0, 0), section=ksd.rectangle(thickness, width),
        material=ksd.Material(E=200e9, nu=nu), width_axis="z", name="blade", **words,
    )  # fmt: skip
    for s in points:
        scene.point("blade", s)
    if guided:
        scene.actuate(tip, along="y", at=(chord, 0, 0), name="drive")
        scene.support(tip, about="z")
    else:
        scene.actuate(tip, about="z", name="drive")
    return scene


def effort(scene, value, **words):
    return ksd.solve(scene, drive=value, method="conventional", **words).forces["drive"]


def effect(scene, value):
    """Relative change [%] of the drive force by plate stiffening."""
    return 100 * (effort(scene, value, with_="plate") / effort(scene, value) - 1)


SOLIDS = [
    ((60, 20, 0.3), 0.3, False, 0.01 * deg, 2.496),
    ((60, 20, 0.3), 0.3, True, 0.01 * mm, 5.420),
    ((60, 20, 0.3), 0.45, True, 0.01 * mm, 13.06),
    ((50, 40, 0.5), 0.3, False, 0.01 * deg, 5.600),
    ((100, 10, 0.5), 0.3, True, 0.01 * mm, 1.975),
    ((60, 20, 0.3), 0.3, False, 5 * deg, 3.076),
    ((60, 20, 0.3), 0.3, False, 20 * deg, 6.123),
    ((60, 20, 0.3), 0.3, True, 5 * mm, 6.598),
    ((100, 50, 0.5), 0.3, True, 10 * mm, 7.977),
    ((50, 40, 0.5), 0.45, False, 10 * deg, 17.941),
]
"""Size [mm], nu, guided, drive value and effect [%] of solids, from benchmarks/clamped_width.py."""


@pytest.mark.parametrize(("size", "nu", "guided", "value", "solid"), SOLIDS)
def test_a_leaf_is_as_stiff_as_a_solid(size, nu, guided, value, solid):
    """To 5 % of the effect; the meshes of the solids still fall by up to .2 points when doubled."""
    scene = strip(*(1e-3 * s for s in size), nu=nu, guided=guided)
    assert effect(scene, value) == pytest.approx(solid, rel=0.05)


def test_an_arc_curls_as_little_as_its_own_curvature_lets_it():
    """Solids: 6.91 %, and 6.89 % for a flexure of the gripper, whose radius is ten times its thickness."""
    assert effect(strip(0.06, 0.02, 0.3e-3, radius=0.06), 1e-4) == pytest.approx(6.909, rel=0.02)
    assert effect(strip(1.5 * np.pi * 4e-3, 6e-3, 0.4e-3, radius=4e-3), 1 * deg) == pytest.approx(
        6.887, rel=0.02
    )


def test_a_short_piece_has_as_many_modes_as_wanted():
    """The piece beside the clamp has its local moments on one panel, on which 12 points are too few for 16 modes."""
    scene, fine = strip(0.06, 0.02, 0.3e-3, points=(0.6 * mm,)), ksd.Mesh(orders=(4, 3, 16), points=20)
    assert effort(scene, 0.05, with_="plate", mesh=fine) == pytest.approx(
        effort(scene, 0.05, with_="plate", mesh=ksd.Mesh(orders=(4, 3, 11), points=20)), rel=2e-5
    )


def test_nu_0_changes_no_digit():
    for value in (1e-4, 0.5):
        scene = strip(0.06, 0.03, 0.3e-3, nu=0.0)
        assert effort(scene, value, with_="plate") == effort(scene, value)


def test_a_long_leaf_is_ashwells_strip():
    width, thickness = 20e-3, 0.3e-3
    for length in (2.0, 20.0):
        moment = effort(strip(length, width, thickness), 3.0, with_="plate")
        # clamps take less than a width of the leaf
        beam = 200e9 * width * thickness**3 / 12 * 3.0 / length
        assert moment == pytest.approx(
            beam * plate_factor(width, thickness, 3.0 / length, 0.3), rel=0.09 * width / length
        )


@pytest.mark.parametrize("guided", [False, True])
def test_points_clamp_nothing(guided):
    """Uncut, and cut at two places: the same leaf."""
    words = {"guided": guided}
    whole = strip(0.06, 0.02, 0.3e-3, **words)
    cut = strip(0.06, 0.02, 0.3e-3, points=(0.013, 0.041), **words)
    for value in (1e-6,):
        one, other = (effort(s, value, with_="plate", without="shear") for s in (whole, cut))
        assert other == pytest.approx(one, rel=1e-9)


def test_curling_passes_through_a_block_that_carries_nothing_else():
    def two(loaded):
        scene = ksd.Mechanism("two")
        middle, tip = scene.links("middle", "tip")
        words = {"section": ksd.rectangle(0.3e-3, 0.02), "material": STEEL, "width_axis": "z"}
        scene.leaf("ground", middle, start=(0, 0, 0), end=(0.02, 0, 0), name="one", **words)
        scene.leaf(tip, middle, start=(0.06, 0, 0), end=(0.02, 0, 0), name="two", **words)
        scene.actuate(tip, about="z", name="drive")
        if loaded:
            scene.mass(middle, mass=0.1, at=(0.02, 0, 0))
        return scene

    one = effort(strip(0.06, 0.02, 0.3e-3), 1e-6, with_="plate")
    assert effort(two(loaded=False), 1e-6, with_="plate") == pytest.approx(one, rel=1e-9)
    assert effort(two(loaded=True), 1e-6, with_="plate") > 1.02 * one


def test_stiffness_is_the_slope_of_the_force():
    """The tangent has the change of the plate stiffening with the curvature: against forces at neighbouring values."""
    scene, h, mesh = strip(0.06, 0.02, 0.3e-3, guided=True), 1e-6, ksd.Mesh(orders=(4, 3, 12), points=20)
    pose = ksd.solve(scene, drive=4e-3, with_="plate", method="conventional", mesh=mesh)
    sides = [effort(scene, 4e-3 + s, with_="plate", mesh=mesh) for s in (h, -h)]
    slope = (sides[0] - sides[1]) / (2 * h)
    assert pose.drive_stiffness().matrix[0, 0] == pytest.approx(slope, rel=2e-5)
    # with the present stiffnesses kept it would be less
    assert slope > 1.005 * sides[0] / 4e-3


def test_in_the_plane_and_in_space_a_leaf_is_the_same():
    for words in ({}, {"radius": 0.05}):
        scene = strip(0.06, 0.02, 0.3e-3, **words)
        flat, spatial = (
            ksd.prepare(scene, with_="plate", planar=p)(drive=0.4, method="conventional").forces["drive"]
            for p in (True, False)
        )
        assert spatial == pytest.approx(flat, rel=1e-9)


def test_chains_have_it_at_small_curvature():
    for guided in (False, True):
        scene = strip(0.06, 0.02, 0.3e-3, guided=guided)
        fine = ksd.Mesh("corotational", elements=40)
        chain, plain = (effort(scene, 1e-5, mesh=fine, with_=w) for w in ("plate", ()))
        assert 100 * (chain / plain - 1) == pytest.approx(effect(scene, 1e-5), rel=0.02)


def test_a_taper_has_it_too():
    """A taper of nothing is the uniform leaf."""
    scene = strip(0.06, 0.02, 0.3e-3, profile=ksd.Taper(thickness=(0.3e-3, 0.3e-3), width=(0.02, 0.02)))
    for value in (1e-5, 0.3):
        assert effect(scene, value) == pytest.approx(effect(strip(0.06, 0.02, 0.3e-3), value), rel=5e-3)


def test_rods_confirm_it():
    """`verify` integrates the moments with the law of every section; the sums over the points differ from it a little."""
    for guided, value in ((False, 0.3), (True, 4e-3)):
        scene = strip(0.06, 0.02, 0.3e-3, guided=guided)
        pose = ksd.solve(scene, drive=value, with_="plate", method="conventional")
        assert pose.verify().relative < 2e-4
        small = ksd.solve(scene, drive=1e-3 * value, with_="plate", method="conventional")
        assert small.verify().relative < 1e-6


def test_stress_at_a_clamp_is_uneven_in_every_answer():
    """Against a plate of Argyris elements (tests/section/test_plate.py): 1.21 of the mean in the middle of the width."""
    scene, drive = strip(0.06, 0.02, 0.3e-3), 1e-3
    pose = ksd.solve(scene, drive=drive, with_="plate", method="conventional")
    leaf, moment = pose.stress()["blade"], pose.section_forces()["blade"].values[:, 5]
    mean = 6 * moment / (0.02 * 0.3e-3**2)
    face = leaf.points.index("face +y")
    assert leaf.normal_Pa[0, face] == pytest.approx(-1.21 * mean[0], rel=0.01)
    middle = len(mean) // 2
    assert np.abs(leaf.normal_Pa[middle, :6]) == pytest.approx(np.full(6, abs(mean[middle])), rel=0.01)
    # a sweep asks many states at once
    scene.consider("plate")
    row = ksd.sweep(scene, {"drive": [drive]}, questions="stress")
    assert row["stress_MPa"][0] == pytest.approx(1e-6 * leaf.largest_Pa, rel=1e-9)
    cut = strip(0.06, 0.02, 0.3e-3, points=(0.013, 0.041))
    parts = ksd.solve(cut, drive=drive, with_="plate", method="conventional").stress()["blade"]
    assert parts.normal_Pa[0, face] == pytest.approx(leaf.normal_Pa[0, face], rel=1e-6)


def critical_plates(width, length, nu, cells=4):
    """First critical loads over those of a beam, of half a Kirchhoff plate of Argyris elements between two clamps, the far
    one held and free to move sideways."""
    from scipy.linalg import eigh
    from skfem import Basis, BilinearForm, ElementTriArgyris, MeshTri
    from skfem.helpers import dd, ddot, eye, trace

    @BilinearForm
    def energy(u, v, _):
        return ddot((1.0 - nu) * dd(u) + nu * eye(trace(dd(u)), 2), dd(v))

    @BilinearForm
    def shortening(u, v, _):
        return u.grad[0] * v.grad[0]

    along = 0.5 * length * (1.0 - np.cos(np.linspace(0.0, np.pi, 2 * cells + 1)))
    mesh = MeshTri.init_tensor(along, 0.5 * width * np.linspace(0.0, 1.0, cells // 2 + 1))
    basis = Basis(mesh, ElementTriArgyris())
    K, S = (form.assemble(basis).toarray() for form in (energy, shortening))
    near, far, middle = (
        basis.get_dofs(lambda x, i=i, at=at: np.isclose(x[i], at))
        for i, at in ((0, 0.0), (0, length), (1, 0.0))
    )
    fixed = [d.nodal[n] for d in (near, far) for n in ("u", "u_x", "u_y", "u_yy", "u_xy")]
    fixed += [middle.nodal["u_y"], middle.nodal["u_xy"], *(d.facet["u_n"] for d in (near, far, middle))]
    inner = np.setdiff1d(np.arange(basis.N), np.concatenate(fixed))
    sway = np.zeros((basis.N, 1))
    sway[far.nodal["u"]] = 1.0
    loads = []
    for columns in (np.eye(basis.N)[:, inner], np.hstack([np.eye(basis.N)[:, inner], sway])):
        largest = eigh(columns.T @ S @ columns, columns.T @ K @ columns, eigvals_only=True)[-1]
        loads.append(1.0 / largest)
    return np.array(loads) * length**2 / (np.pi**2 * np.array([4.0, 1.0]) * (1.0 - nu**2))


@pytest.mark.parametrize(("length", "width"), [(0.06, 0.02), (0.05, 0.04)])
def test_columns_and_frequencies_are_those_of_plates(length, width):
    """Critical loads of a column that sways to 10 % of the effect; of one that is held at both ends, whose moments are no
    lines, at least 60 % (docs/limits.md). The frequency of a mass on a guide is that of the stiffness with the effect."""
    scene = strip(length, width, 0.1e-3, guided=True)
    scene.mass("tip", mass=1.0, at=(length, 0, 0))
    loads, frequency, stiffness = [], [], []
    for effect in ((), "plate"):
        pose = ksd.solve(scene, drive=1e-7, with_=effect, method="conventional")
        words = {"force": (-1.0, 0.0, 0.0), "at": (length, 0, 0), "count": 1}
        loads.append([pose.buckling("tip", freed=f, **words).positive for f in ((), ("drive",))])
        frequency.append(pose.frequencies(count=1, freed=["drive"]).frequency_Hz[0])
        stiffness.append(pose.forces["drive"])
    held, sways = (np.divide(*loads[::-1]) - 1.0) / (critical_plates(width, length, 0.3) - 1.0)
    assert sways == pytest.approx(1.0, rel=0.1) and 0.6 < held < 1.0
    assert (frequency[1] / frequency[0]) ** 2 == pytest.approx(stiffness[1] / stiffness[0], rel=1e-5)


def test_what_is_left_out_is_what_the_effect_adds():
    scene = strip(0.06, 0.02, 0.3e-3, guided=True)
    pose = ksd.solve(scene, drive=5e-3, method="conventional")
    left_out = pose.left_out["plate"]["force"]
    assert f"plate stiffening (force +{100 * left_out:.2g} %" in str(pose.trust)
    assert 100 * left_out == pytest.approx(effect(scene, 5e-3), rel=1e-6)


@pytest.mark.parametrize(
    "section",
    [ksd.circle(1 * mm), ksd.numbers(A=1e-5, J=1e-12, Iy=1e-10, Iz=1e-12)],
    ids=["round", "numbers"],
)
def test_sections_without_width_are_refused(section):
    scene = ksd.Mechanism("wire")
    tip = scene.link("tip")
    scene.leaf(
        "ground",
        tip,
        start=(0, 0, 0),
        end=(0.1, 0, 0),
        section=section,
        material=STEEL,
        width_axis="z",
        name="wire",
    )
    scene.actuate(tip, about="z", name="drive")
    with pytest.raises(SceneError, match="no leaf spring is wider than thick"):
        ksd.solve(scene, drive=0.1, with_="plate")
    ksd.solve(scene, drive=0.1, effects="all")
    scene.consider("plate")
    with pytest.raises(SceneError, match="no leaf spring is wider than thick"):
        ksd.compile_scene(scene)
    ksd.compile_scene(scene, without="plate")
