"""Section forces against closed forms, against the end wrench, and between the leaf models."""

import numpy as np
import pytest

import ksd
from ksd.answers.centrelines import curvature, member_arrays, member_ends
from ksd.answers.forces import COMPONENTS, section_forces
from ksd.model.compile import compile_scene
from ksd.model.mesh import Mesh
from ksd.solvers.conventional import solve_conventional
from ksd.units import GPa, mm

LENGTH = 0.1
SECTION = ksd.rectangle(0.5 * mm, 20 * mm)
STEEL = ksd.Material(E=200 * GPa, nu=0.3)
STRAIN = Mesh()
CHAIN = Mesh(leaf="corotational", elements=20)
NODAL = Mesh(leaf="corotational", elements=20, nodal=True)


def cantilever(mesh, values, **drives):
    """One leaf along x from ground to link 'tip', driven as said; named drives in `values`."""
    scene = ksd.Mechanism("leaf")
    tip = scene.link("tip")
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=(LENGTH, 0, 0), width_axis="z", section=SECTION,
               material=STEEL, name="blade")  # fmt: skip
    for name, words in drives.items():
        scene.actuate(tip, name=name, **words)
    return solve_conventional(compile_scene(scene, mesh=mesh), values, steps=2)


@pytest.mark.parametrize("mesh", [STRAIN, CHAIN, NODAL], ids=["strain", "chain", "nodal"])
def test_pure_bending_moment_is_constant(mesh):
    turn = 0.9
    c = cantilever(mesh, {"turn": turn}, turn={"about": "z"})
    values = section_forces(c.model, c.motion)["blade"].values
    moment = STEEL.E * SECTION.Iz * turn / LENGTH
    assert values[:, 5] == pytest.approx(moment, rel=1e-9 if mesh is STRAIN else 1e-4)
    assert values[:, :5] == pytest.approx(0.0, abs=1e-6 * moment / LENGTH)
    assert c.forces["turn"] == pytest.approx(moment, rel=1e-4)


@pytest.mark.parametrize("mesh", [STRAIN, CHAIN], ids=["strain", "chain"])
@pytest.mark.parametrize("axis,row,stiffness", [("x", 3, "J"), ("y", 4, "Iy")])
def test_torsion_and_strong_bending(mesh, axis, row, stiffness):
    turn = 1e-3
    c = cantilever(mesh, {"turn": turn}, turn={"about": axis})
    modulus = STEEL.G if stiffness == "J" else STEEL.E
    expected = modulus * getattr(SECTION, stiffness) * turn / LENGTH
    assert section_forces(c.model, c.motion)["blade"].values[:, row] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("mesh", [STRAIN, CHAIN, NODAL], ids=["strain", "chain", "nodal"])
def test_tip_force_gives_shear_and_moment(mesh):
    """A small tip deflection w: V = 3 EI w/L^3 everywhere, M from V L at the clamp to zero at the tip."""
    w = 1e-5
    c = cantilever(mesh, {"push": w}, push={"along": "y", "at": (LENGTH, 0, 0)})
    f = section_forces(c.model, c.motion)["blade"]
    V = 3 * STEEL.E * SECTION.Iz * w / LENGTH**3
    assert f.values[:, 1] == pytest.approx(V, rel=1e-3)
    assert f.values[:, 5] == pytest.approx(V * (LENGTH - f.s), rel=1e-3, abs=1e-3 * V * LENGTH)
    assert c.forces["push"] == pytest.approx(V, rel=1e-3)


def test_pull_is_the_normal_force():
    c = cantilever(STRAIN, {"pull": 1e-6}, pull={"along": "x", "at": (LENGTH, 0, 0)})
    assert section_forces(c.model, c.motion)["blade"].values[:, 0] == pytest.approx(
        STEEL.E * SECTION.A * 1e-6 / LENGTH, rel=1e-6
    )


@pytest.mark.parametrize("mesh", [STRAIN, CHAIN], ids=["strain", "chain"])
def test_ends_balance_the_drives_in_a_large_spatial_deflection(mesh):
    """Forces at both ends are the drives' forces, moments differ by the lever arm (drives act at the tip)."""
    drives = {
        "y": {"along": "y", "at": (LENGTH, 0, 0)},
        "z": {"along": "z", "at": (LENGTH, 0, 0)},
        "turn": {"about": "z"},
    }
    c = cantilever(mesh, {"y": 0.03, "z": 0.002, "turn": 0.5}, **drives)
    f = section_forces(c.model, c.motion)["blade"]
    ends = member_ends(c.model, c.motion, 0)
    # section axes at both ends, global
    start, end = ends.frame, ends.frame @ ends.Q
    push = np.array([0.0, c.forces["y"], c.forces["z"]])
    force_p, force_q = start @ f.start[:3], end @ f.end[:3]
    moment_p, moment_q = start @ f.start[3:], end @ f.end[3:]
    size = np.linalg.norm(push)
    # drawn and solved by different quadratures
    tolerance = 1e-5 if mesh is STRAIN else 1e-9
    assert force_q == pytest.approx(push, abs=tolerance * size)
    assert force_p == pytest.approx(push, abs=tolerance * size)
    arm = ends.frame @ ends.d
    assert moment_p == pytest.approx(moment_q + np.cross(arm, force_q), abs=tolerance * size * LENGTH)
    assert moment_q[2] == pytest.approx(c.forces["turn"], rel=1e-4)


def test_leaf_models_agree_in_a_twisted_leaf():
    drives = {"y": {"along": "y", "at": (LENGTH, 0, 0)}, "z": {"along": "z", "at": (LENGTH, 0, 0)}}
    fine = Mesh(leaf="corotational", elements=60)
    one, two = (cantilever(mesh, {"y": 0.02, "z": 0.001}, **drives) for mesh in (STRAIN, fine))
    one, two = (section_forces(c.model, c.motion)["blade"] for c in (one, two))
    for a, b in ((one.start, two.start), (one.end, two.end)):
        assert a[:3] == pytest.approx(b[:3], abs=5e-3 * np.linalg.norm(a[:3]))
        assert a[3:] == pytest.approx(b[3:], abs=5e-3 * np.linalg.norm(one.start[3:]))


def test_end_moments_agree_with_the_curvature():
    """D kappa of the strain-mode leaf, the other way to the moment, agrees where both are good."""
    c = cantilever(STRAIN, {"y": 0.02}, y={"along": "y", "at": (LENGTH, 0, 0)})
    kappa = curvature(*member_arrays(c.model, c.motion, 0), np.array([0.0]))[0, 2]
    moment = section_forces(c.model, c.motion)["blade"].start[5]
    assert STEEL.E * SECTION.Iz * kappa == pytest.approx(moment, rel=1e-3)


def test_components_are_named():
    assert COMPONENTS == ("N", "Vy", "Vz", "T", "My", "Mz")


@pytest.mark.parametrize(
    "profile", [None, ksd.StiffenedMiddle(thickness=0.5e-3, width=0.01, middle=1.5e-3, part=0.4)]
)
def test_few_stations_have_the_forces_of_many(profile):
    """The line between two stations was walked in one step."""
    scene = ksd.Mechanism("strip", plane="xy")
    tip, shaped = scene.link("tip"), {"profile": profile} if profile else {}
    scene.leaf(
        "ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), section=ksd.rectangle(0.5e-3, 0.01),
        material=ksd.Material(E=200e9, G=77e9, density=7800), name="strip", **shaped,
    )  # fmt: skip
    scene.gravity = (0, -9.81, 0)
    scene.actuate(tip, along="y", at=(0.1, 0, 0), name="lift")
    scene.load(tip, force=(40, 0, 0), at=(0.1, 0, 0))
    pose = ksd.solve(scene, lift=0.02)
    many = pose.section_forces(points=101)["strip"]
    scale = np.abs(many.values).max(axis=0) + 1e-9
    for points in (2, 3, 5):
        few = pose.section_forces(points=points)["strip"]
        at = np.searchsorted(many.s, few.s - 1e-9)
        known = np.isclose(many.s[at], few.s)
        assert known[[0, -1]].all()
        assert (np.abs(few.values[known] - many.values[at[known]]) < 5e-3 * scale).all()
        assert len(few.s) == points or profile


@pytest.mark.parametrize("mesh", [STRAIN, CHAIN, NODAL], ids=["strain", "chain", "nodal"])
def test_a_leaf_under_its_own_weight(mesh):
    """V = -m g (1 - s/L), M = -m g L/2 (1 - s/L)^2 of a stiff cantilever."""
    scene = ksd.Mechanism("shelf")
    tip = scene.link("tip")
    heavy = ksd.Material(E=200 * GPa, nu=0.3, density=7800)
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(LENGTH, 0, 0), section=ksd.rectangle(5 * mm, 20 * mm), material=heavy,
        width_axis="z", name="blade",
    )  # fmt: skip
    scene.gravity = (0, -9.81, 0)
    c = solve_conventional(compile_scene(scene, mesh=mesh, effects="all"), {})
    found = section_forces(c.model, c.motion)["blade"]
    left, weight = 1 - found.s / LENGTH, 7800 * 5 * mm * 20 * mm * LENGTH * 9.81
    assert found.values[:, 1] == pytest.approx(-weight * left, abs=1e-4 * weight)
    assert found.values[:, 5] == pytest.approx(-0.5 * weight * LENGTH * left**2, abs=2e-3 * weight * LENGTH)


def test_questions_about_states_in_any_order_give_each_its_own():
    """Curves that are integrated once serve several questions: never those of another state, mesh of stations or load."""
    scene = ksd.Mechanism("leaf")
    tip = scene.link("tip")
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=(LENGTH, 0, 0), width_axis="z", section=SECTION,
               material=STEEL, name="blade")  # fmt: skip
    scene.actuate(tip, name="push", along="y", at=(LENGTH, 0, 0))
    scene.gravity = (0.0, -9.81, 0.0)
    alone = []
    for value in (0.5 * mm, 2 * mm):
        c = solve_conventional(compile_scene(scene), {"push": value})
        alone.append([section_forces(c.model, c.motion, points=p)["blade"].values for p in (9, 25)])
    prepared = ksd.prepare(scene)
    poses = [prepared(push=value) for value in (0.5 * mm, 2 * mm)]
    for k, p, points in ((0, 0, 9), (1, 0, 9), (1, 1, 25), (0, 1, 25), (0, 0, 9)):
        drawn = poses[k].shape(points=points).leaves[0]
        again = poses[k].section_forces(points=points)["blade"]
        assert again.values == pytest.approx(alone[k][p], rel=1e-7, abs=1e-9 * np.abs(alone[k][p]).max())
        assert drawn.place[-1, 1] == pytest.approx((0.5 * mm, 2 * mm)[k], abs=1e-12)
