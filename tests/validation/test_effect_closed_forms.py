"""Effects against closed forms: thermal bow, sag, prestress, assembly error, balancing springs, warping, plates, links."""

import numpy as np
import pytest
from ashwell import plate_factor
from effect_scenes import free_beam
from published_effects import (
    ALPHA,
    INERTIA,
    LONG,
    STEEL,
    THIN,
    A,
    L,
    T,
    W,
    blade,
    held,
    moved,
    strip_by_energy,
)
from scenes import cross_flexure

import ksd
from ksd.model.compile import compile_as_is
from ksd.section import restrained_warping_factor
from ksd.solvers.conventional import solve_conventional

MESHES = {"strain": ksd.Mesh(), "chain": ksd.Mesh("corotational", elements=8)}


@pytest.mark.parametrize("mesh", MESHES)
def test_thermal_growth_and_bow(mesh):
    # a free leaf grows by alpha dT L and bends to the circle of curvature alpha dT_through / t
    scene = blade()
    scene.heat(50.0)
    shift, _ = moved(solve_conventional(ksd.compile_scene(scene, mesh=MESHES[mesh]), {}))
    assert shift == pytest.approx([ALPHA * 50 * L, 0, 0], abs=1e-12)
    scene = blade()
    scene.heat(through=400.0)
    shift, turn = moved(solve_conventional(ksd.compile_scene(scene, mesh=MESHES[mesh]), {}))
    kappa = -ALPHA * 400.0 / T
    circle = [np.sin(kappa * L) / kappa - L, (1 - np.cos(kappa * L)) / kappa, 0]
    # a chain is a polygon whose corners lie on the circle to fourth order
    assert turn == pytest.approx(kappa * L, rel=1e-9)
    assert shift == pytest.approx(circle, rel=1e-8 if mesh == "strain" else 2e-3, abs=1e-12)
    # by 137 degrees at once: what a clamp is off the natural shape is spread over the nodes of a chain
    scene = blade()
    scene.heat(through=1000.0)
    _, turn = moved(solve_conventional(ksd.compile_scene(scene, mesh=MESHES[mesh]), {}))
    assert turn == pytest.approx(2.5 * kappa * L, rel=1e-9)


@pytest.mark.parametrize("mesh", MESHES)
def test_thermal_force_between_clamps(mesh):
    scene = held(blade(), *"xyzabc")
    scene.heat(20.0)
    found = solve_conventional(ksd.compile_scene(scene, mesh=MESHES[mesh]), dict.fromkeys("xyzabc", 0.0))
    # the clamp holds a leaf that wants to grow by E A alpha dT, less the part its own length takes (1 + alpha dT)
    assert found.forces["x"] == pytest.approx(-200e9 * A * ALPHA * 20 / (1 + ALPHA * 20), rel=1e-9)
    scene = held(blade(), *"xyzabc")
    scene.heat(through=30.0)
    found = solve_conventional(ksd.compile_scene(scene, mesh=MESHES[mesh]), dict.fromkeys("xyzabc", 0.0))
    assert found.forces["c"] == pytest.approx(200e9 * INERTIA * ALPHA * 30 / T, rel=1e-5)


def test_sag_under_a_payload_and_its_own_weight_in_any_direction():
    # P l^3/3EI + P l/kGA and, of the weight W of the leaf, W l^3/8EI + W l/2kGA
    for gravity in ((0, -9.81e-3, 0), (0, 0, 9.81e-3), (-9.81e-3, 0, 0)):
        scene = blade()
        scene.mass("tip", mass=1e-4, at=(L, 0, 0))
        scene.gravity = gravity
        found = solve_conventional(ksd.compile_scene(scene), {})
        P, own = 1e-4 * np.array(gravity), STEEL.density * A * L * np.array(gravity)
        G, k = STEEL.G, 5 / 6
        strong = T * W**3 / 12
        soft = [L / (200e9 * A), *(L**3 / (3 * 200e9 * i) + L / (k * G * A) for i in (INERTIA, strong))]
        spread = [L / (400e9 * A), *(L**3 / (8 * 200e9 * i) + L / (2 * k * G * A) for i in (INERTIA, strong))]
        # small: quadratic terms of the sag are below 1e-6
        assert moved(found)[0] == pytest.approx(
            P * soft + own * spread, rel=2e-5, abs=1e-5 * np.abs(moved(found)[0]).max()
        )


def test_assembly_error_of_a_clamp():
    # a clamp 10 um too far out stretches the leaf; one turned by 1 mrad bends it
    scene = held(blade(), *"xyzabc")
    scene.fit("blade", shift=(10e-6, 0, 0), turn=(0, 0, 1e-3))
    found = solve_conventional(ksd.compile_scene(scene), dict.fromkeys("xyzabc", 0.0))
    stretched = 200e9 * A * 10e-6 / L
    assert found.forces["x"] == pytest.approx(stretched, rel=2e-3)
    # tension stiffens the end moment: 4EI/L and more
    b = np.sqrt(stretched / (200e9 * INERTIA)) * L
    moment = (
        200e9 * INERTIA / L * b * (b * np.cosh(b) - np.sinh(b)) / (2 - 2 * np.cosh(b) + b * np.sinh(b)) * 1e-3
    )
    assert found.forces["c"] == pytest.approx(moment, rel=5e-3)
    free = blade()
    free.fit("blade", shift=(1e-4, 2e-4, 3e-4), turn=(0, 0, 2e-3))
    shift, turn = moved(solve_conventional(ksd.compile_scene(free), {}))
    # nothing holds the tip: the leaf stays straight, the link sits off
    assert turn == pytest.approx(-2e-3, rel=1e-9)
    assert np.linalg.norm(shift) == pytest.approx(np.linalg.norm([1e-4, 2e-4, 3e-4]), rel=0.01)


def test_a_joint_spring_adds_its_moment():
    scene = ksd.Mechanism("hinge")
    tip = scene.link("tip")
    placed = scene.join("ground", tip, cross_flexure(), at=(0, 0, 0), axis="z", toward="x", name="hinge")
    scene.actuate_joint(placed, name="turn")
    plain = ksd.solve(scene, turn=0.5).forces["turn"]
    scene.joint_spring("hinge", stiffness=4.0, rest_angle=0.2)
    for method in ("conventional", "full", "reduced"):
        found = ksd.solve(scene, turn=0.5, method=method).forces["turn"]
        assert found == pytest.approx(plain + 4.0 * 0.3, rel=1e-4 if method == "reduced" else 1e-9)


def test_energy_stored_is_work_done():
    scene = ksd.Mechanism("hinge")
    tip = scene.link("tip")
    placed = scene.join("ground", tip, cross_flexure(), at=(0, 0, 0), axis="z", toward="x", name="hinge")
    scene.actuate_joint(placed, name="turn")
    scene.joint_spring("hinge", stiffness=4.0, rest_angle=0.2)
    scene.spring("ground", tip, start=(0.1, 0.2, 0.05), end=(0.15, 0, 0), stiffness=700.0, free_length=0.1)
    solver, h = ksd.prepare(scene, with_="spatial"), 1e-4
    lower, here, upper = (solver(turn=0.5 + k * h, method="conventional") for k in (-1, 0, 1))
    gained = sum(upper.strain_energy().values()) - sum(lower.strain_energy().values())
    assert gained / (2 * h) == pytest.approx(here.forces["turn"], rel=1e-6)
    assert "spring 'hinge.spring'" in here.strain_energy()


# source: acceptance numbers, section A: factor on GJ at nu = .3
@pytest.mark.parametrize(("aspect", "factor"), [(1, 1.828058), (3, 1.183652)])
@pytest.mark.parametrize("mesh", [*MESHES.values(), ksd.Mesh("corotational", elements=4, nodal=True)])
def test_restrained_warping_multiplies_the_torsional_stiffness(aspect, factor, mesh):
    def twisted(**words):
        scene = held(blade(width=L / aspect), "a", "b", "c", "y", "z")
        model = ksd.compile_scene(scene, mesh=mesh, **words)
        return solve_conventional(model, dict.fromkeys("bcyz", 0.0) | {"a": 1e-4}).forces["a"]

    assert twisted(with_="warping") / twisted() == pytest.approx(factor, rel=1e-6)
    assert restrained_warping_factor(length=aspect, width=1.0, nu=0.3) == pytest.approx(factor, abs=5e-7)


@pytest.mark.parametrize("searle", [0.3, 3.0, 12.0, 40.0, 200.0])
def test_plate_stiffening_follows_the_strip_of_least_energy(searle):
    width, thickness = 40e-3, 1e-3
    curvature = searle * thickness / width**2
    published = plate_factor(width, thickness, curvature, 0.3)
    assert published == pytest.approx(strip_by_energy(width, thickness, curvature, 0.3, 600), rel=2e-4)
    assert 1.0 < published < 1 / 0.91


def test_plate_stiffening_lies_between_its_limits():
    assert plate_factor(0.04, 1e-3, 0.0, 0.3) == 1.0
    assert plate_factor(0.04, 1e-3, 1e-6, 0.3) == pytest.approx(1.0, abs=1e-12)
    assert plate_factor(4.0, 1e-4, 1e3, 0.3) == pytest.approx(1 / 0.91, rel=1e-3)
    rising = [plate_factor(0.04, 1e-3, k, 0.3) for k in np.geomspace(1e-3, 1e4, 200)]
    # steadily up, but for the published overshoot of less than 0.3 % before the upper limit
    assert rising[0] == pytest.approx(1.0, abs=1e-6) and max(rising) < 1.003 / 0.91
    # series and closed form meet
    p2 = 0.05**2 / np.sqrt(3 * 0.91) * 1e-3 / 0.04**2
    assert plate_factor(0.04, 1e-3, 0.9999 * p2, 0.3) == pytest.approx(
        plate_factor(0.04, 1e-3, 1.0001 * p2, 0.3), abs=1e-9
    )


def test_a_wide_leaf_is_bent_with_the_factor_of_its_own_curvature():
    """Where it is far longer than wide: clamps hold less than a width of it flat."""
    wide = 40e-3
    scene = held(blade(width=wide, length=LONG, thickness=THIN), "c")
    for angle in (1e-2, 0.3, 2.0):
        found = ksd.solve(scene, c=angle, with_="plate", method="conventional")
        moment = 200e9 * (wide * THIN**3 / 12) * angle / LONG
        factor = plate_factor(wide, THIN, angle / LONG, 0.3)
        assert found.forces["c"] == pytest.approx(moment * factor, rel=0.09 * wide / LONG)


@pytest.mark.parametrize("kind", ["npz", "h5"])
def test_a_matrix_from_a_file_is_the_beam_it_was_made_of(tmp_path, kind):
    import h5py

    points = np.array([[0.02, 0, 0], [0.22, 0, 0]])
    # the test's beam is a rod of 3 mm radius; two internal modes that do nothing but exist
    K = np.zeros((14, 14))
    K[:12, :12] = free_beam(points, 1.0)
    for k, stiff in ((12, 3e4), (13, 8e5)):
        K[k, k] = stiff
    file = tmp_path / f"rod.{kind}"
    if kind == "npz":
        np.savez(file, points=points, K=K)
    else:
        with h5py.File(file, "w") as f:
            f["points"], f["K"] = points, K

    def guided(**compliance):
        scene = blade(length=0.02)
        scene.leaf(
            "tip", "ground", start=(0.22, 0, 0), end=(0.24, 0, 0), section=ksd.rectangle(T, W), material=STEEL,
            width_axis=(0, 0, 1), name="far",
        )  # fmt: skip
        scene.load("tip", force=(0, 0.5, 0.3), at=(0.02, 0, 0))
        scene.compliance("tip", **compliance)
        return solve_conventional(ksd.compile_scene(scene, without="shear"), {}).motion.x[1]

    rod = {
        "section": ksd.circle(6e-3),
        "material": ksd.Material(E=200e9, G=200e9 / 2.6),
        "hub": (0.02, 0, 0),
        "width_axis": (0, 0, 1),
    }
    assert guided(matrix=file) == pytest.approx(guided(**rod), rel=1e-4, abs=1e-9)


def test_following_and_dead_loads_part_with_the_angle():
    dead, follows = (held(blade(), "c") for _ in range(2))
    for scene, turning in ((dead, False), (follows, True)):
        scene.load("tip", force=(0, 2.0, 0), at=(L, 0, 0), following=turning)
    pair = [ksd.solve(s, c=0.5, method="conventional") for s in (dead, follows)]
    assert abs(moved(pair[0])[0][0] - moved(pair[1])[0][0]) > 1e-6
    same = ksd.solve(follows, c=0.5, method="conventional", without="following")
    assert moved(same)[0] == pytest.approx(moved(pair[0])[0], abs=1e-12)
    # the following one is the dead one turned by the half radian of the link
    turned = held(blade(), "c")
    turned.load("tip", force=(-2.0 * np.sin(0.5), 2.0 * np.cos(0.5), 0), at=(L, 0, 0))
    there = ksd.solve(turned, c=0.5, method="conventional")
    assert moved(there)[0] == pytest.approx(moved(pair[1])[0], abs=1e-9)


def test_a_model_compiled_as_given_takes_the_scene_literally():
    scene = blade()
    scene.heat(50.0)
    model = compile_as_is(scene.scene(), ksd.Mesh())
    # heat is applied where effects are chosen
    assert moved(solve_conventional(model, {}))[0] == pytest.approx([0, 0, 0], abs=1e-15)


def test_plate_stiffening_of_very_wide_strips_goes_on_past_the_closed_form():
    """Two free edges, each a layer of its own: what is missing to 1/(1 - nu^2) falls with 1/p."""
    nu, thickness = 0.3, 1e-3
    for p in (50.0, 250.0, 299.9, 300.1, 1000.0, 1e5):
        curvature = p**2 / np.sqrt(3 * (1 - nu**2)) * thickness
        missing = 1 / (1 - nu**2) - plate_factor(1.0, thickness, curvature, nu)
        assert p * missing == pytest.approx(1.5 * nu**2 / (1 - nu**2), rel=1e-6)


@pytest.mark.parametrize("length", [1e-6, 0.1])
def test_an_elastic_link_between_two_leaves_bends_in_mechanisms_of_any_size(length):
    """A cantilever of one section, its middle an elastic link: tip deflection F L^3 / 3EI, also of a micrometre."""
    steel, section = ksd.Material(E=200e9, nu=0.3), ksd.rectangle(length / 100, length / 5)
    scene = ksd.Mechanism("cantilever", plane="xy")
    middle, tip = scene.links("middle", "tip")
    ends = [(share * length, 0, 0) for share in (0.0, 1.0, 1.8, 2.8)]
    scene.leaf(scene.ground, middle, start=ends[0], end=ends[1], section=section, material=steel)
    scene.leaf(middle, tip, start=ends[2], end=ends[3], section=section, material=steel)
    scene.compliance(middle, section=section, material=steel)
    scene.load(tip, force=(0, 1e-4 * steel.E * section.Iz / length**2, 0), at=ends[3])
    moved = ksd.solve(scene).displacement(tip, ends[3])
    assert moved[1] == pytest.approx(1e-4 * 2.8**3 / 3 * length, rel=1e-4)
