"""Weight of the leaves: exact tangent, closed forms, a heavy elastica, rigid motion, and no cost where there is none."""

import copy

import numpy as np
import pytest
from scenes import STEEL, cross_flexure, fourbar, single_joint
from scipy.integrate import solve_bvp
from scipy.spatial.transform import Rotation

import ksd
from ksd.answers.tangent import stored_matrix
from ksd.model.arrays import make_workspace
from ksd.model.compile import compile_scene
from ksd.model.mesh import Mesh
from ksd.model.newton import assemble, take_step
from ksd.solvers.conventional import solve_conventional
from ksd.units import mm

MESHES = {
    "modes": Mesh(),
    "chain": Mesh("corotational", elements=3, mip=False),
    "nodal": Mesh("corotational", elements=3, mip=False, nodal=True),
}
L, T, B = 0.1, 0.1 * mm, 10 * mm
THIN = ksd.rectangle(T, B)
EI, MASS = STEEL.E * THIN.Iz, STEEL.density * THIN.A
STILL = np.eye(3)
TURN = Rotation.from_rotvec([0.4, -0.9, 0.7]).as_matrix()


def blade(gravity, *, turn=STILL, **leaf):
    """A leaf from ground to a free link, along x and turned by `turn`, gravity with it."""
    scene = ksd.Mechanism("blade")
    tip = scene.link("tip")
    words = {"section": THIN, "material": STEEL, "name": "blade", **leaf}
    end, width = turn @ words.pop("end", (L, 0, 0)), turn @ [0, 0, 1.0]
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=tuple(end), width_axis=tuple(width), **words)
    scene.gravity = None if gravity is None else tuple(turn @ np.array(gravity))
    return scene


def tip_of(scene, mesh=None, **options):
    found = solve_conventional(compile_scene(scene, mesh=mesh), {}, **options)
    return found.links["tip"][0], found


def two_blades(gravity):
    """Ground, leaf, block, leaf, block: the second leaf's frame p turns with the first block."""
    scene = ksd.Mechanism("two")
    one, two = scene.links("one", "two")
    words = {"section": ksd.rectangle(0.3 * mm, B), "material": STEEL}
    taper = ksd.Taper(thickness=(0.3 * mm, 0.2 * mm), width=(B, 0.5 * B))
    scene.leaf(scene.ground, one, start=(0, 0, 0), end=(L, 0, 0), width_axis=(0, 0, 1), **words)
    scene.leaf(
        one,
        two,
        start=(L, 0.01, 0),
        end=(L, 0.01 + L, 0.02),
        width_axis=(0, -0.2, 1.0),
        profile=taper,
        **words,
    )
    scene.gravity = gravity
    return scene


def settled(model, motion, relinearisations=10):
    """Residual (n,) and matrix with the inner states iterated to rest at fixed nodes."""
    arrays, work, none = model.arrays, make_workspace(model.arrays), np.zeros(0)
    for _ in range(relinearisations):
        assemble(arrays, motion, none, 1.0, work, 1e-8, 0, 10.0)
        take_step(arrays, motion, np.zeros(arrays.plan.unknowns), work, 1.0)
    assemble(arrays, motion, none, 1.0, work, 1e-8, 0, 10.0)
    return work.rhs.copy(), stored_matrix(arrays, work.matrix)


def moved(model, motion, step):
    new = motion.copy()
    for node, u in enumerate(model.arrays.start):
        if u >= 0:
            new.x[node] += step[u : u + 3]
            new.R[node] = Rotation.from_rotvec(step[u + 3 : u + 6]).as_matrix() @ new.R[node]
    return new


@pytest.mark.parametrize("mesh", MESHES)
def test_tangent_is_the_derivative_of_the_residual(mesh, rng):
    gravity = (600.0, -1200.0, 900.0)
    scene = blade(gravity) if mesh == "nodal" else two_blades(gravity)
    model, bare = compile_scene(scene, mesh=MESHES[mesh]), compile_scene(light(scene), mesh=MESHES[mesh])
    n = model.arrays.plan.unknowns
    size = np.tile([1e-4] * 3 + [5e-3] * 3, n // 6)
    step = rng.normal(size=n) * size
    motion = moved(model, model.rest, step)
    K = chart(model, *settled(model, motion))
    without = chart(bare, *settled(bare, moved(bare, bare.rest, step)))
    moments = np.arange(n) % 6 > 2
    for _ in range(6):
        way = rng.normal(size=n) * size
        ends = [settled(model, moved(model, motion, s * 2e-4 * way))[0] for s in (1, -1)]
        difference = (ends[0] - ends[1]) / 4e-4
        for rows in (moments, ~moments):
            bound = 2e-6 * np.abs(difference[rows]).max()
            assert np.abs(difference - K @ way)[rows].max() < bound
            # a tangent that leaves the weight out fails by far; element nodes only feel it through their stresses
            assert mesh == "nodal" or np.abs((without - K) @ way)[rows].max() > 20 * bound


def chart(model, residual, K):
    """The derivative of the residual: its moments are spatial, the tangent that of the symmetric chart."""
    assert np.allclose(K, K.T, rtol=0, atol=1e-9 * np.abs(K).max())
    found = K.copy()
    for u in (int(s) for s in model.arrays.start if s >= 0):
        found[u + 3 : u + 6, u + 3 : u + 6] -= 0.5 * np.cross(np.eye(3), residual[u + 3 : u + 6])
    return found


def light(scene):
    """The same scene without gravity."""
    bare = copy.deepcopy(scene)
    bare.gravity = None
    return bare


@pytest.mark.parametrize("planar", [True, False], ids=["plane", "space"])
@pytest.mark.parametrize("mesh", MESHES)
def test_small_deflection_of_a_cantilever(mesh, planar):
    """w L^4/8 EI and the slope w L^3/6 EI; Timoshenko shear adds w L^2/(2 ky G A), here 1e-6 of it."""
    w = MASS * 1e-3
    u, found = tip_of(blade((0, -1e-3, 0)), MESHES[mesh], planar=planar)
    assert u[1] == pytest.approx(-w * L**4 / (8 * EI), rel=1e-5)
    assert found.rotation("tip")[2] == pytest.approx(-w * L**3 / (6 * EI), rel=1e-5)


@pytest.mark.parametrize("mesh", MESHES)
def test_hanging_and_lying_along_its_own_length(mesh):
    """Axial elongation w L^2/2 EA."""
    u, _ = tip_of(blade((9.81, 0, 0)), MESHES[mesh], planar=False)
    assert u[0] == pytest.approx(MASS * 9.81 * L**2 / (2 * STEEL.E * THIN.A), rel=1e-6)


def heavy_elastica(load):
    """Tip (x, y)/L and angle of an inextensible cantilever with w L^3/EI = load: theta'' = -load (1 - s) cos theta."""

    def rod(s, y):
        return np.array([y[1], load * (1 - s) * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])])

    def ends(a, b):
        return np.array([a[0], b[1], a[2], a[3]])

    s = np.linspace(0, 1, 40)
    start = np.array([-np.minimum(1.4, 3 * s), np.zeros(40), s, -s])
    found = solve_bvp(rod, ends, s, start, tol=1e-10, max_nodes=20000)
    assert found.success
    return found.y[2, -1], found.y[3, -1], found.y[0, -1]


@pytest.mark.parametrize("planar", [True, False], ids=["plane", "space"])
def test_heavy_elastica(planar):
    """A blade that hangs almost straight down under its own weight, w L^3/EI = 20."""
    x, y, angle = heavy_elastica(20.0)
    assert y < -0.7
    gravity = (0, -20 * EI / (MASS * L**3), 0)
    u, found = tip_of(blade(gravity), Mesh(orders=(4, 3, 10), points=12), planar=planar, steps=4)
    assert (u[0] / L + 1, u[1] / L) == pytest.approx((x, y), abs=2e-6)
    assert found.rotation("tip")[2] == pytest.approx(angle, abs=1e-5)
    coarse, _ = tip_of(blade(gravity), planar=planar, steps=4)
    assert np.abs(coarse - u).max() < 2e-3 * L


@pytest.mark.parametrize("case", ["straight", "curved", "tapered"])
def test_chains_converge_to_the_modes(case):
    leaf = {}
    if case == "curved":
        a, r = 1.2, 0.08
        leaf = {"curve": ksd.Arc(radius=r, angle=a), "end": (r * np.sin(a), r * (1 - np.cos(a)), 0.0)}
    if case == "tapered":
        leaf = {"profile": ksd.Taper(thickness=(T, 0.6 * T), width=(B, 0.5 * B))}
    gravity = (0, -30.0, 0.5)
    exact, _ = tip_of(blade(gravity, **leaf), Mesh(orders=(4, 3, 8), points=10))
    errors = [
        np.linalg.norm(tip_of(blade(gravity, **leaf), Mesh("corotational", elements=n))[0] - exact) / L
        for n in (8, 16)
    ]
    assert errors[1] < 3e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.25)


@pytest.mark.parametrize("mesh", ["modes", "chain"])
def test_scene_and_gravity_turned_together(mesh):
    gravity = (3.0, -8.0, 2.0)
    plain, one = tip_of(blade(gravity), MESHES[mesh])
    turned, other = tip_of(blade(gravity, turn=TURN), MESHES[mesh])
    assert turned == pytest.approx(TURN @ plain, abs=1e-10 * L)
    assert (
        np.abs(other.motion.inner[-6:] - one.motion.inner[-6:]).max()
        < 1e-7 * np.abs(one.motion.inner[-6:]).max() + 1e-12
    )


@pytest.mark.parametrize("mesh", ["modes", "chain"])
def test_plane_and_space_agree_on_a_mechanism(mesh):
    scene = fourbar()
    scene.gravity = (0, -9.81e3, 0)
    model = compile_scene(scene, mesh=MESHES[mesh])
    one, other = (solve_conventional(model, {"top": 0.1}, planar=p) for p in (True, False))
    assert "planar" in one.steps[0].note
    assert one.forces["top"] == pytest.approx(other.forces["top"], rel=1e-9)
    assert np.abs(one.motion.x - other.motion.x).max() < 1e-10
    scene.gravity = None
    bare = solve_conventional(compile_scene(scene, mesh=MESHES[mesh]), {"top": 0.1})
    assert abs(one.forces["top"] / bare.forces["top"] - 1) > 0.05


def test_gravity_out_of_the_plane_is_named():
    model = compile_scene(blade((0, -1.0, 1.0)))
    assert "the weight of the leaf springs pulls along (0, -1, 1) m/s^2" in model.plane


@pytest.mark.parametrize("mesh", ["modes", "chain"])
def test_weight_that_is_absent_costs_nothing_and_changes_nothing(mesh):
    bare, weightless = fourbar(), fourbar(joint=cross_flexure())
    weightless.gravity = (0, 0, 0)
    one, other = (compile_scene(s, mesh=MESHES[mesh]) for s in (bare, weightless))
    for model in (one, other):
        work = make_workspace(model.arrays)
        assert model.arrays.weight.size == work.weight.size == 0
        assert work.store.size == make_workspace(one.arrays).store.size
    heavy = fourbar()
    heavy.gravity = (0, -9.81, 0)
    assert make_workspace(compile_scene(heavy, mesh=MESHES[mesh]).arrays).store.size > work.store.size
    first, second = (solve_conventional(m, {"top": 0.1}, planar=False) for m in (one, other))
    assert np.array_equal(first.motion.inner, second.motion.inner)
    assert first.forces == second.forces
    material = ksd.Material(E=STEEL.E, G=STEEL.G)
    assert not compile_scene(blade((0, -9.81, 0), material=material), mesh=MESHES[mesh]).arrays.weight.size


@pytest.mark.parametrize("mesh", MESHES)
def test_half_of_a_joint_hangs_on_each_interface(mesh):
    scene = single_joint()
    scene.actuate("tip", along="y", at=(0.05, 0, 0), name="lift")
    scene.gravity = (0, -500.0, 0)
    model = compile_scene(scene, mesh=MESHES[mesh])
    mass = model.arrays.weight[:, 0].sum()
    leaves = cross_flexure().leaves()
    assert mass == pytest.approx(sum(STEEL.density * f.section.A * f.length for f in leaves), rel=1e-12)
    forces = solve_conventional(model, {"turn": 0.0, "lift": 0.0}).forces
    assert abs(forces["lift"]) == pytest.approx(0.5 * mass * 500.0, rel=1e-3)


@pytest.mark.parametrize("mesh", ["modes", "chain"])
def test_what_holds_the_ground_carries_all_of_it(mesh):
    """A leaf and a joint on a frame that six supports hold: their forces are m g."""
    scene = ksd.Mechanism("held")
    frame, one, tip = scene.links("frame", "one", "tip")
    taper = ksd.Taper(thickness=(0.8 * mm, 0.4 * mm), width=(B, B))
    words = {"section": ksd.rectangle(0.8 * mm, B), "material": STEEL, "width_axis": (0, 0, 1)}
    scene.leaf(frame, one, start=(0, 0, 0), end=(L, 0, 0), profile=taper, **words)
    scene.join(one, tip, cross_flexure(), at=(L, 0, 0), axis="z", toward="x")
    for axis in "xyz":
        scene.support(frame, along=axis, at=(0, 0, 0), name=axis)
        scene.support(frame, about=axis, name="about " + axis)
    scene.gravity = (30.0, -90.0, 40.0)
    model = compile_scene(scene, mesh=MESHES[mesh])
    found = solve_conventional(model, {}, planar=False)
    # the joint's own leaf springs, and a taper of linear thickness
    mass = STEEL.density * (0.6 * mm * B * L + sum(f.section.A * f.length for f in cross_flexure().leaves()))
    assert model.arrays.weight[:, 0].sum() == pytest.approx(mass, rel=1e-9 if mesh == "modes" else 1e-3)
    held = [found.reactions[axis] for axis in "xyz"]
    assert held == pytest.approx(-model.arrays.weight[:, 0].sum() * np.array(scene.gravity), rel=1e-9)


def test_section_forces_under_weight():
    """Clamp: force w L, moment w L^2/2; tip free; in between as a parabola."""
    w = MASS * 1e-2
    for mesh in MESHES.values():
        _, found = tip_of(blade((0, -1e-2, 0)), mesh)
        f = found.section_forces()["blade"]
        assert f.values[:, 1] == pytest.approx(-w * (L - f.s), abs=1e-6 * w * L)
        assert f.values[:, 5] == pytest.approx(-0.5 * w * (L - f.s) ** 2, abs=2e-6 * w * L**2)
    stress = found.stress().largest_Pa
    assert stress == pytest.approx(6 * 0.5 * w * L**2 / (B * T**2), rel=1e-3)


def test_energy_is_the_work_of_the_weight():
    """Clapeyron: strain energy is half the work of the weight on the linear deflection, w^2 L^5/40 EI."""
    w = MASS * 1e-3
    _, found = tip_of(blade((0, -1e-3, 0)))
    assert sum(found.strain_energy().values()) == pytest.approx(w**2 * L**5 / (40 * EI), rel=1e-5)


def test_standing_column_buckles_under_its_own_weight():
    """Greenhill: w L^3/EI = 7.8373 for a free-standing column."""
    for ratio, unstable in ((0.98, 0), (1.02, 1)):
        gravity = (-ratio * 7.837347 * EI / (MASS * L**3), 0, 0)
        for mesh in (Mesh(), Mesh("corotational", elements=12)):
            found = solve_conventional(
                compile_scene(blade(gravity), mesh=mesh), {}, planar=False, eps_max=1e9
            )
            assert found.negatives - found.expected_negatives == unstable


def test_frequency_of_a_hanging_blade():
    """Stiffer when it hangs, softer when it stands: f^2 changes linearly, to zero at the buckling weight (nearly)."""
    squares = [
        solve_conventional(compile_scene(blade((g, 0, 0))), {}, planar=False)
        .frequencies(count=1)
        .omega_squared[0]
        for g in (-3.0, 0.0, 3.0)
    ]
    assert squares[0] < squares[1] < squares[2]
    assert squares[0] + squares[2] == pytest.approx(2 * squares[1], rel=1e-3)


def test_buckling_multiplier_of_a_standing_column():
    """At 0.4 of Greenhill's weight all stresses, and the weight with them, may grow 2.5 times."""
    gravity = (-0.4 * 7.837347 * EI / (MASS * L**3), 0, 0)
    _, found = tip_of(blade(gravity), planar=False)
    assert found.buckling().positive == pytest.approx(2.5, rel=1e-4)


def test_buckling_load_added_to_the_weight():
    """A load at the tip of the column: what the weight leaves of it, by the interaction of Euler and Greenhill."""
    euler = np.pi**2 * EI / (4 * L**2)
    found = []
    for ratio in (0.0, 0.3, 0.6):
        gravity = (-ratio * 7.837347 * EI / (MASS * L**3), 0, 0) if ratio else None
        _, c = tip_of(blade(gravity), planar=False)
        found.append(c.buckling("tip", force=(-1.0, 0, 0)).positive / euler)
    assert found[0] == pytest.approx(1.0, rel=1e-3)
    # nearly a straight line: w L = 7.837 EI/L^2 takes all of it, and 3.3 % more than linear in between
    assert found[1] == pytest.approx(0.7, abs=0.02)
    assert found[2] == pytest.approx(0.4, abs=0.02)
    assert found[1] > 0.7 and found[2] > 0.4


def heated_bar(kelvin, *, profile=None, natural_length=None):
    """An aluminium bar along x with a massless link at its end, which follows its expansion without force."""
    aluminium = ksd.Material(E=70e9, nu=0.33, density=2700, expansion=24e-6)
    scene = ksd.Mechanism("bar")
    scene.gravity = (0, -9.81, 0)
    end = scene.link("end")
    section = ksd.rectangle(2 * mm, 10 * mm)
    scene.leaf(
        scene.ground, end, start=(0, 0, 0), end=(0.1, 0, 0), section=section, material=aluminium,
        width_axis="z", name="bar", profile=profile,
    )  # fmt: skip
    for axis in "yz":
        scene.support(end, along=axis, at=(0.1, 0, 0))
    for axis in "xyz":
        scene.support(end, about=axis)
    scene.actuate(end, along="x", at=(0.1, 0, 0), name="drive")
    if kelvin:
        scene.heat(kelvin)
    if natural_length:
        scene.fit("bar", natural_length=natural_length)
    return scene


@pytest.mark.parametrize(
    "profile",
    [None, ksd.Taper(thickness=(2 * mm, 3 * mm), width=(10 * mm, 8 * mm))],
    ids=("uniform", "tapered"),
)
@pytest.mark.parametrize("mesh", [None, ksd.Mesh("corotational")], ids=("leaf", "chain"))
def test_heat_adds_no_mass(mesh, profile):
    """The held end carries what it carried cold; frequencies go as length^-1.5, for EI/(m L^3) of equal mass, but for shear,
    of which a longer bar has less."""
    kelvin, longer = 100.0, 1 + 24e-6 * 100
    cold = ksd.solve(heated_bar(0, profile=profile), drive=0.0, mesh=mesh)
    hot = ksd.solve(heated_bar(kelvin, profile=profile), drive=0.1 * (longer - 1), mesh=mesh)
    held = "end.held"
    # tension by the sag differs a little
    assert hot.reactions[held] == pytest.approx(cold.reactions[held], rel=1e-6 if profile else 1e-9)
    if mesh is None:
        ratio = hot.frequencies(count=2).frequency_Hz / cold.frequencies(count=2).frequency_Hz
        assert ratio == pytest.approx(longer**-1.5, rel=5e-5)
        assert hot.verify().reactions[held] == pytest.approx(hot.reactions[held], rel=1e-9)


def test_a_leaf_spring_made_longer_is_heavier():
    made, drawn = (ksd.solve(heated_bar(0, natural_length=length), drive=5e-4) for length in (0.1005, None))
    assert made.reactions["end.held"] == pytest.approx(1.005 * drawn.reactions["end.held"], rel=1e-4)
