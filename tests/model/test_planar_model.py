"""The planar model: exact tangent, what it refuses and why, half the unknowns, the spatial one masked."""

import numpy as np
import pytest
from scenes import STEEL, cross_flexure, dense, fourbar, single_joint

import ksd
from ksd.model.arrays import make_workspace
from ksd.model.compile import compile_scene
from ksd.model.mesh import Mesh
from ksd.model.newton import assemble, move_nodes, take_step
from ksd.model.plane import Plane
from ksd.solvers.conventional import solve_conventional
from ksd.units import deg, mm

MESHES = {
    "strain": None,
    "chain": Mesh("corotational", elements=3, mip=False),
    "nodal": Mesh("corotational", elements=2, mip=False, nodal=True),
}


WEIGHTS = {"light": None, "heavy": (600.0, -1200.0, 0.0)}


def loaded_fourbar(weight="light"):
    """Fourbar with dead and following loads, a drive of two terms seen from a moving link, and a rotation drive."""
    scene = fourbar()
    scene.load("top", force=(30.0, -80.0, 0.0), moment=(0, 0, 2.0), at=(0.05, 0.4, 0.0))
    scene.load("left", force=(-20.0, 15.0, 0.0), at=(-0.25, 0.2, 0.0), following=True)
    seen = scene.displacement("right", (0.6, 0.8, 0), at=(0.2, 0.3, 0), relative_to="top")
    scene.actuate(terms=[seen, 0.3 * scene.rotation("left", "z")], name="mixed")
    scene.gravity = WEIGHTS[weight]
    return scene


def guide(*, axis=(0, 0, 1), along=(1, 0, 0), spread=0.0):
    """Parallel guide of two leaf springs along `along`; spread: distance [m] of the second leaf along the width `axis`."""
    scene = ksd.Mechanism("guide")
    stage = scene.link("stage")
    e1, e3 = np.array(along, float), np.array(axis, float)
    e2 = np.cross(e3, e1)
    section = ksd.rectangle(0.5 * mm, 30 * mm)
    for side in (-1, 1):
        start = side * 40 * mm * e2 + (side > 0) * spread * e3
        scene.leaf(
            scene.ground, stage, start=start, end=start + 100 * mm * e1, section=section, material=STEEL,
            width_axis=side * e3,
        )  # fmt: skip
    scene.actuate(stage, along=e2, at=100 * mm * e1, name="stroke")
    return scene


def moved(model, arrays, state, step):
    """The state with nodes and multipliers moved by `step` (n,) of the unknowns of `arrays`; inner states as they are."""
    new = state.copy()
    move_nodes(arrays, new, step, 1.0)
    return new


def settled(arrays, state, target):
    """Residual (n,) and matrix with the inner states iterated to rest at fixed nodes."""
    work = make_workspace(arrays)
    for _ in range(8):
        assemble(arrays, state, target, 1.0, work, 1e-8, 0, 10.0)
        take_step(arrays, state, np.zeros(arrays.plan.unknowns), work, 1.0)
    assemble(arrays, state, target, 1.0, work, 1e-8, 0, 10.0)
    return work.rhs.copy(), dense(arrays, work)


@pytest.mark.parametrize("weight", WEIGHTS)
@pytest.mark.parametrize("mesh", MESHES)
def test_tangent_is_the_derivative_of_the_residual(mesh, weight, rng):
    scene = loaded_fourbar(weight)
    model = compile_scene(scene, mesh=MESHES[mesh])
    # of its own: integers are shared by models of the same words
    arrays = model.plane.arrays.replace()
    # a following load has an unsymmetric tangent, whose symmetric half is what is added
    arrays.loads.following[:] = 0
    target = np.zeros(2)
    size = np.where(np.isin(np.arange(arrays.plan.unknowns), arrays.terms.start), 50.0, 4e-4)
    state = moved(model, arrays, model.rest, rng.normal(size=len(size)) * size)
    _, K = settled(arrays, state, target)
    assert np.allclose(K, K.T, atol=1e-9 * np.abs(K).max())
    for _ in range(6):
        way = rng.normal(size=len(size)) * size
        ends = [settled(arrays, moved(model, arrays, state, s * 1e-5 * way), target)[0] for s in (1, -1)]
        difference = (ends[0] - ends[1]) / 2e-5
        assert np.abs(difference - K @ way).max() < 1e-7 * np.abs(difference).max()


def test_unknowns_are_half():
    for model in (compile_scene(fourbar()), compile_scene(fourbar(), mesh=MESHES["nodal"])):
        plane = model.plane
        rows = len(model.drive_names)
        assert plane.arrays.plan.unknowns - rows == (model.arrays.plan.unknowns - rows) // 2
    assert model.plane is model.plane


@pytest.mark.parametrize("weight", WEIGHTS)
@pytest.mark.parametrize("mesh", MESHES)
def test_residual_and_tangent_are_those_of_space_in_the_plane(mesh, weight, rng):
    """Off an equilibrium: what is kept of the spatial residual and matrix."""
    model = compile_scene(loaded_fourbar(weight), mesh=MESHES[mesh])
    plane = model.plane
    found = []
    state = solve_conventional(model, dict.fromkeys(model.drive_names, 2e-3)).motion
    state.x[1:, :2] += 1e-5 * rng.normal(size=(len(state.x) - 1, 2))
    for arrays in (plane.arrays, model.arrays):
        work, target = make_workspace(arrays), np.full(2, 3e-3)
        assemble(arrays, state, target, 1.0, work, 1e-8, 0, 10.0)
        at = np.where(
            arrays.start[1:, None] >= 0, arrays.start[1:, None] + np.arange(len(arrays.active_dofs)), -1
        )
        if len(arrays.active_dofs) == 6:
            at = at[:, plane.arrays.active_dofs]
        at = np.concatenate([at.ravel(), arrays.terms.start])
        found.append((work.rhs[at], dense(arrays, work)[np.ix_(at, at)]))
    assert found[0][0] == pytest.approx(found[1][0], rel=1e-8, abs=1e-10 * np.abs(found[1][0]).max())
    assert found[0][1] == pytest.approx(found[1][1], rel=1e-8, abs=1e-10 * np.abs(found[1][1]).max())


def changed(**change):
    scene = single_joint()
    for name, options in change.items():
        getattr(scene, name)("tip", **options)
    return scene


SAID = {
    "push": (
        changed(load={"force": (0, 0, 1.0), "at": (0, 0, 0)}),
        "load 'tip.load' pushes along (0, 0, 1) N",
    ),
    "turn": (changed(load={"moment": (0.5, 0, 0)}), "load 'tip.load' turns about (0.5, 0, 0) Nm"),
    "drive": (
        changed(actuate={"along": "z", "at": (0, 0, 0), "name": "lift"}),
        "drive 'lift' moves along (0, 0, 1)",
    ),
    "roll": (changed(actuate={"about": "x", "name": "roll"}), "drive 'roll' rotates about (1, 0, 0)"),
    "slant": (
        changed(support={"along": (1, 0, 1), "at": (0, 0, 0), "name": "stop"}),
        "support 'stop' moves along (0.7071, 0, 0.7071)",
    ),
}


@pytest.mark.parametrize("case", SAID)
def test_what_leaves_the_plane_is_named(case):
    scene, words = SAID[case]
    model = compile_scene(scene)
    reason = model.plane
    assert isinstance(reason, str)
    assert words in reason
    assert "out of the plane normal to (0, 0, 1)" in reason
    targets = dict.fromkeys(model.drive_names, 0.0)
    with pytest.raises(ksd.SceneError, match="this mechanism is not planar"):
        solve_conventional(model, targets, planar=True)


def test_a_leaf_across_the_others_is_named():
    scene = guide()
    scene.leaf(
        scene.ground, "stage", start=(0, 0, 0.1), end=(0.1, 0, 0.1), section=ksd.rectangle(1 * mm, 10 * mm),
        material=STEEL, width_axis=(0, 1, 0), name="odd",
    )  # fmt: skip
    assert "the width of leaf 'odd' is along (0, 1, 0)" in compile_scene(scene).plane


def test_supports_that_hold_the_mechanism_in_its_plane_are_left_out():
    scene = single_joint()
    scene.support("tip", along="z", at=(0.05, 0, 0))
    scene.support("tip", about="x", name="no roll")
    model = compile_scene(scene)
    plane = model.plane
    assert isinstance(plane, Plane)
    assert plane.arrays.plan.unknowns == 4
    found = solve_conventional(model, {"turn": 20 * deg}, planar=True)
    assert found.negatives == found.expected_negatives == 3
    assert found.forces["turn"] == pytest.approx(
        solve_conventional(model, {"turn": 20 * deg}, planar=False).forces["turn"]
    )


def test_a_joint_placed_from_behind_is_planar_too():
    scene = ksd.Mechanism("behind")
    tip = scene.link("tip")
    for axis, y in (("z", 0.0), ((0, 0, -1), 0.2)):
        scene.join(scene.ground, tip, cross_flexure(), at=(0, y, 0), axis=axis, toward="x")
    scene.actuate(tip, along="y", at=(0.1, 0.1, 0))
    model = compile_scene(scene)
    one, other = (solve_conventional(model, {"tip": 1 * mm}, planar=p) for p in (True, False))
    assert one.forces["tip"] == pytest.approx(other.forces["tip"], rel=1e-10)
    assert np.abs(one.motion.inner - other.motion.inner).max() < 1e-9 * np.abs(other.motion.inner).max()


@pytest.mark.parametrize("apart", [0.0, 0.01])
def test_a_spring_is_in_the_plane_where_its_ends_are_level(apart):
    """Wherever the reference points of its links are."""
    scene = ksd.Mechanism("beside")
    tip = scene.link("tip", at=(0.1, 0, 0.03))
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), section=ksd.rectangle(0.5 * mm, 10 * mm), material=STEEL,
        width_axis="z",
    )  # fmt: skip
    scene.spring(
        scene.ground,
        tip,
        start=(0.1, -0.1, 0),
        end=(0.1, 0, apart),
        stiffness=10.0,
        free_length=0.1,
        name="coil",
    )
    plane = compile_scene(scene).plane
    if apart:
        assert "spring 'coil' pulls out of the plane, its ends being 10 mm apart" in plane
    else:
        assert isinstance(plane, Plane)
