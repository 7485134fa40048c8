"""Planar solves against spatial ones, the check in space, and falling back to it."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from scenes import STEEL, fourbar, single_joint

import ksd
from ksd.model.compile import compile_scene
from ksd.model.mesh import Mesh
from ksd.solvers.conventional import solve_conventional
from ksd.units import deg, mm

MESHES = {
    "strain": Mesh(),
    "chain": Mesh("corotational", elements=4),
    "plain": Mesh("corotational", elements=3, mip=False),
    "nodal": Mesh("corotational", elements=3, nodal=True),
}
NOTE = "planar, 3 unknowns per node"


def guide(spread=0.0, tilt=None):
    """Parallel guide under a load; spread [m] offsets one leaf out of the plane, tilt (3, 3) turns everything."""
    tilt = np.eye(3) if tilt is None else tilt
    scene = ksd.Mechanism("guide")
    stage = scene.link("stage")
    for y in (-0.04, 0.04):
        z = spread * (y > 0)
        scene.leaf(
            scene.ground, stage, start=tilt @ [0, y, z], end=tilt @ [0.1, y, z], section=ksd.rectangle(0.5 * mm, 30 * mm),
            material=STEEL, width_axis=tilt[:, 2],
        )  # fmt: skip
    scene.actuate(stage, along=tilt[:, 1], at=tilt @ [0.1, 0, 0], name="stroke")
    scene.load(stage, force=tilt @ [-5.0, 0, 0], at=tilt @ [0.1, 0.01, 0])
    return scene


def same(one, other, tolerance=1e-10):
    """Drive forces, positions, rotations, inner states and inertia agree."""
    for name, force in other.forces.items():
        assert one.forces[name] == pytest.approx(force, rel=tolerance)
    for mine, theirs in zip(one.motion, other.motion, strict=True):
        assert np.abs(mine - theirs).max() <= tolerance * np.abs(theirs).max()
    assert one.negatives == other.negatives
    assert NOTE in one.steps[0].note
    assert NOTE not in other.steps[0].note


@pytest.mark.parametrize("mesh", MESHES)
@pytest.mark.parametrize("reading", [1, 2])
def test_fourbar(mesh, reading):
    model = compile_scene(fourbar(reading=reading), mesh=MESHES[mesh])
    last = None
    for d in (0.1, 0.3):
        one, other = (solve_conventional(model, {"top": d}, planar=p) for p in (True, False))
        same(one, other)
        assert one.iterations == other.iterations
        last = one
    # a planar result is an ordinary one: go on from it in space, and in the plane
    on, over = (solve_conventional(model, {"top": 0.2}, start=last, planar=p) for p in (True, False))
    same(on, over)


@pytest.mark.parametrize("mesh", MESHES)
def test_cross_flexure(mesh):
    model = compile_scene(single_joint(), mesh=MESHES[mesh])
    pair = [None, None]
    for angle in (-75, -40, 20, 50, 75):
        pair = [solve_conventional(model, {"turn": angle * deg}, planar=p, steps=2) for p in ("auto", False)]
        same(*pair)


@pytest.mark.parametrize("mesh", ["strain", "chain"])
def test_parallel_guide_in_any_plane(mesh):
    from scipy.spatial.transform import Rotation

    forces = []
    for order in (1, 2, 3):
        # turned from one global plane to the next, and about its normal
        tilt = np.roll(np.eye(3), order, axis=0) @ Rotation.from_rotvec([0, 0, 0.3 * order]).as_matrix()
        model = compile_scene(guide(tilt=tilt), mesh=MESHES[mesh])
        pair = [solve_conventional(model, {"stroke": 15 * mm}, planar=p) for p in (True, False)]
        same(*pair)
        forces.append(pair[0].forces["stroke"])
    oblique = compile_scene(guide(tilt=Rotation.random(random_state=3).as_matrix()), mesh=MESHES[mesh])
    assert "none of the global axes" in oblique.plane
    forces.append(solve_conventional(oblique, {"stroke": 15 * mm}).forces["stroke"])
    assert forces == pytest.approx([forces[0]] * 4, rel=1e-9)


@pytest.mark.parametrize("mesh", ["strain", "chain"])
def test_dead_and_following_loads_and_rows_seen_from_a_link(mesh):
    scene = fourbar()
    scene.load("top", force=(30.0, -40.0, 0.0), moment=(0, 0, 2.0), at=(0.05, 0.4, 0.0))
    scene.load("left", force=(-20.0, 15.0, 0.0), at=(-0.25, 0.2, 0.0), following=True)
    model = compile_scene(scene, mesh=MESHES[mesh])
    same(
        *(solve_conventional(model, {"top": 0.15}, planar=p, max_iterations=60) for p in (True, False)),
        tolerance=1e-8,
    )
    scene = fourbar()
    seen = scene.displacement("right", (0.6, 0.8, 0), at=(0.3, 0.2, 0), relative_to="top")
    scene = fourbar()
    scene.actuate(terms=[seen, 0.3 * scene.rotation("left", "z")], name="mixed")
    model = compile_scene(scene, mesh=MESHES[mesh])
    values = dict.fromkeys(model.drive_names, 1e-5)
    same(*(solve_conventional(model, values, planar=p) for p in (True, False)), tolerance=1e-8)


def test_leaves_that_do_not_balance_across_the_plane_are_solved_in_space():
    model = compile_scene(guide(spread=50 * mm))
    found = solve_conventional(model, {"stroke": 5 * mm})
    assert "spatial: its leaf springs and loads do not balance out of the plane" in found.steps[0].note
    assert found.motion.x == pytest.approx(
        solve_conventional(model, {"stroke": 5 * mm}, planar=False).motion.x
    )
    assert "do not balance" in model.plane
    with pytest.raises(
        ksd.SceneError,
        match=r"not planar: its leaf springs and loads .* 'stage'; use planar = 'auto' or False",
    ):
        solve_conventional(model, {"stroke": 5 * mm}, planar=True)


def test_a_load_that_leaves_the_plane_is_solved_in_space():
    scene = single_joint()
    scene.load("tip", force=(0, 0, 3.0), at=(0.07, 0, 0))
    model = compile_scene(scene)
    found = solve_conventional(model, {"turn": 10 * deg})
    assert "spatial: load 'tip.load' pushes along" in found.steps[0].note
    assert abs(found.displacement("tip", (0.07, 0, 0))[2]) > 1e-9


def test_a_start_out_of_the_plane_is_followed_in_space():
    model = compile_scene(single_joint())
    start = solve_conventional(model, {"turn": 10 * deg})
    start.motion.x[1, 2] += 1e-5
    found = solve_conventional(model, {"turn": 12 * deg}, start=start)
    assert "spatial: the configuration to start from is not in the plane" in found.steps[0].note
    # the model stays planar
    same(solve_conventional(model, {"turn": 12 * deg}), found)


def test_tipping_out_of_the_plane_is_seen():
    """A wide thin strip in its own plane tips over sideways: planar equilibrium, one negative pivot too many."""
    scene = ksd.Mechanism("strip")
    tip = scene.link("tip")
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(0.3, 0, 0), section=ksd.rectangle(20 * mm, 0.5 * mm), material=STEEL,
        width_axis=(0, 0, 1),
    )  # fmt: skip
    scene.actuate(tip, along="y", at=(0.3, 0, 0), name="push")
    model, stable = compile_scene(scene), []
    for push in np.geomspace(1e-6, 2e-2, 12):
        plane, space = (solve_conventional(model, {"push": push}, planar=p) for p in (True, False))
        assert plane.negatives == space.negatives
        stable.append(plane.stable)
    assert stable[0] and not stable[-1]


def test_stopping_says_how_far_it_got():
    model = compile_scene(single_joint(), mesh=Mesh("corotational", elements=1))
    with pytest.raises(ksd.ConvergenceError, match="60 degrees") as one:
        solve_conventional(model, {"turn": 170 * deg})
    with pytest.raises(ksd.ConvergenceError) as other:
        solve_conventional(model, {"turn": 170 * deg}, planar=False)
    assert one.value.reached == pytest.approx(other.value.reached, abs=1e-3)
    assert one.value.result.motion.x == pytest.approx(other.value.result.motion.x, abs=1e-4)


def test_the_option_is_checked():
    with pytest.raises(ksd.SceneError, match="planar = 'yes': choose 'auto', True or False"):
        solve_conventional(compile_scene(single_joint()), {"turn": 0.1}, planar="yes")


def test_the_benchmark_runs(capsys, monkeypatch):
    path = Path(__file__).resolve().parents[2] / "benchmarks" / "planar.py"
    monkeypatch.syspath_prepend(str(path.parent))
    spec = importlib.util.spec_from_file_location("planar_benchmark", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.main(rounds=3)
    assert "times" in capsys.readouterr().out


PROFILES = {
    "taper": ksd.Taper(thickness=(1 * mm, 0.3 * mm), width=(30 * mm, 15 * mm)),
    "notch": ksd.CircularNotch(radius=50 * mm, minimum=0.4 * mm, width=20 * mm),
    "fillet": ksd.FilletedNotch(length=100 * mm, radius=10 * mm, minimum=0.4 * mm, width=20 * mm),
    "stiff middle": ksd.StiffenedMiddle(thickness=0.4 * mm, width=20 * mm, middle=3 * mm, part=0.5),
}


@pytest.mark.parametrize("profile", PROFILES)
def test_leaves_with_a_profile_are_solved_in_the_plane(profile):
    """Two coinciding leaf springs on one side, one on the other; hardly an iteration is left for the check in space."""
    scene = ksd.Mechanism("guide")
    stage, shape = scene.link("stage"), PROFILES[profile]
    for y, z in ((-0.04, 0.03), (-0.04, -0.03), (0.04, 0.0)):
        scene.leaf(
            scene.ground, stage, start=(0, y, z), end=(0.1, y, z), section=shape.section(0.5), profile=shape,
            material=STEEL, width_axis=(0, 0, 1),
        )  # fmt: skip
    scene.actuate(stage, along="y", at=(0.1, 0, 0), name="stroke")
    scene.load(stage, force=(-5.0, 0, 0), at=(0.1, 0.01, 0))
    model = compile_scene(scene)
    one, other = (solve_conventional(model, {"stroke": 2 * mm}, planar=p, rtol=1e-11) for p in (True, False))
    same(one, other, 1e-8)
    assert one.steps[0].iterations <= other.steps[0].iterations + 1
