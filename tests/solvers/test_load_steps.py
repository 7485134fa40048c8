"""Load steps that converge onto another branch are caught: walked again in smaller steps, then by arc length."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hard_scenes import bistable
from scenes import STEEL, cross_flexure, fourbar
from scipy.spatial.transform import Rotation

import ksd
from ksd.model.compile import compile_scene
from ksd.solvers import branch_check
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.load_steps import LoadPath


def strut():
    """Two leaves of different thickness that meet at a flat angle, their ridge pushed down: they bow, the thin one more."""
    scene = ksd.Mechanism("strut")
    ridge = scene.link("ridge")
    for name, x, thickness in (("left", -0.1, 1.1e-3), ("right", 0.1, 1.4e-3)):
        scene.leaf(
            scene.ground, ridge, start=(x, 0, 0), end=(0, 0.0265, 0), section=ksd.rectangle(thickness, 0.02),
            material=STEEL, width_axis="z", name=name,
        )  # fmt: skip
    scene.actuate(ridge, along="y", at=(0, 0.0265, 0), name="down")
    return scene, {"down": -0.0139}, ksd.Mesh()


def arm():
    """Three cross flexures in series under a heavy load with a moment, two of them driven."""
    scene, base = ksd.Mechanism("arm"), "ground"
    for k in range(3):
        link = scene.link(f"link {k}")
        scene.join(base, link, cross_flexure(), at=(0.2 * k, 0, 0), axis="z", toward="x", name=f"joint {k}")
        base = link
    scene.actuate_joint("joint 0", name="first")
    scene.actuate_joint("joint 1", name="second")
    scene.load(base, force=(-236.0, -211.4, 0), moment=(0, 0, 0.953), at=(0.6, 0, 0))
    return scene, {"first": -0.252, "second": -1.4716}, ksd.Mesh()


@pytest.mark.parametrize(
    ("made", "said", "jumps"),
    [
        (strut, "repeated in smaller steps: its inertia is not that of a minimum, then by arc length", True),
        (arm, "repeated in smaller steps: loads do much of the work, and a load step took", False),
    ],
)
def test_a_step_onto_another_branch_is_walked_again(made, said, jumps, monkeypatch):
    """The forces are those of 64 steps; of the strut, what converged first is far from them. The arm jumped too, before
    first steps of more than half a turn were cut."""
    scene, targets, mesh = made()
    model = ksd.compile_scene(scene.scene(), mesh=mesh)
    found = solve_conventional(model, targets)
    assert found.trusted and said in found.steps[-1].note
    fine = solve_conventional(model, targets, steps=64)
    assert fine.trusted and found.forces == pytest.approx(fine.forces, rel=1e-6)
    monkeypatch.setattr(branch_check, "confirm_by_smaller_steps", lambda model, first, *_: first)
    jumped = solve_conventional(model, targets)
    last = model.drive_names[-1]
    assert jumped.converged and (abs(jumped.forces[last] / found.forces[last] - 1) > 0.5) == jumps


def test_a_path_that_needs_tiny_steps_is_not_repeated_in_thousands():
    """This snap took 8542 load steps: halved ones were not doubled again, and a doubt was settled by the smallest size."""
    scene, _, rise = bistable(Q=5)
    pose = ksd.solve(scene, push=-1.7 * rise)
    assert pose.trusted and sum(step.iterations for step in pose.steps) < 2000
    # of the two branches that the flaw has taken apart, the one that it picks
    path = ksd.follow(scene, control="drives", push=-1.7 * rise)
    assert pose.forces["push"] == pytest.approx(path.states[-1].forces["push"], rel=1e-5)


def test_a_path_of_many_turns_is_said_by_its_first():
    """A path that wanders off has dozens, some before its start."""
    driven = SimpleNamespace(factorisations=1, _replace=lambda **_: driven)
    turns = [SimpleNamespace(kind="limit", point=SimpleNamespace(f=f)) for f in (0.5, 0.1, -3.0)]
    path = SimpleNamespace(factorisations=3, singular_points=turns, stop_reason=branch_check.END_REACHED)
    *_, doubts = branch_check.confirm_by_arc_length(
        branch_check.LoadStepResult(driven, "", None, ("why",)), lambda: path
    )
    assert doubts == ("why; the path from its start has a limit point at 50 % of the way",)


@pytest.mark.parametrize("pull", ["loads", "weight"])
def test_the_secant_work_becomes_strain_energy(pull):
    """Clapeyron's theorem, at small displacements: half of forces and moments times their motions, of drives and loads."""
    scene = fourbar()
    if pull == "loads":
        scene.load("left", force=(3.0, -2.0, 1.0), moment=(0.2, -0.1, 0.1), at=(-0.1, 0.25, 0.03))
        scene.load("top", force=(-1.0, 0.5, 0.3), at=(0.1, 0.4, 0.02))
    else:
        scene.gravity = (30.0, -9.81, 0.0)
    free = replace(scene.scene(), drives=())
    pose = solve_conventional(compile_scene(free, effects="all"), {})
    driving, loading = branch_check.secant_work(pose.model, pose.motion, np.zeros(0))
    energy = sum(pose.strain_energy().values())
    assert driving == 0.0 < energy
    # of weight, the centre of a leaf moves only about like the mean of its ends
    assert loading == pytest.approx(energy, rel=2e-2 if pull == "loads" else 0.1)
    held = solve_conventional(compile_scene(fourbar()), {"top": 1e-3})
    driving, loading = branch_check.secant_work(held.model, held.motion, np.array([1e-3]))
    assert loading == 0.0 and driving == pytest.approx(sum(held.strain_energy().values()), rel=1e-3)


def test_values_along_a_path():
    start, target = np.array([0.1, -0.2]), np.array([0.5, 0.4])
    path = LoadPath(start, target, factors=(0.25, 0.75))
    for fraction in (0.0, 0.3, 1.2):
        values, factor = path.values_at(fraction)
        assert values == pytest.approx((1 - fraction) * start + fraction * target)
        assert factor == pytest.approx(0.25 + 0.5 * fraction)
    assert path.values_at(1.0)[0] is target and path.values_at(1.0)[1] == 0.75


def test_work_of_dead_loads_is_force_times_way(rng):
    """Half of it, from the undeformed state, with the weight of each leaf at the mean of its ends."""
    scene = ksd.Mechanism("loaded")
    one, two = scene.links("one", "two")
    ends = {"one": ((0, 0.1, 0), (0.2, 0.1, 0.05)), "two": ((0.3, 0.1, 0), (0.4, -0.1, 0))}
    for name, a, b in (("one", scene.ground, one), ("two", one, two)):
        scene.leaf(
            a, b, start=ends[name][0], end=ends[name][1], section=ksd.rectangle(1e-3, 0.02), material=STEEL,
            width_axis="z" if name == "two" else (0, 1, 0), name=name,
        )  # fmt: skip
    scene.actuate(two, along="y", at=(0.4, 0, 0), name="a")
    scene.actuate(two, along="x", at=(0.4, 0, 0), name="b")
    scene.load(one, force=(1.0, -2.0, 3.0), at=(0.25, 0.2, -0.1))
    scene.load(two, force=(0.5, 1.0, -1.0), moment=(0.3, 0.1, -0.2), at=(0.4, 0.1, 0.1))
    scene.gravity = (2.0, -9.0, 4.0)
    model = compile_scene(scene, with_="gravity")
    motion, turn = model.rest.copy(), {}
    for k, name in enumerate(model.node_names):
        if name != "ground":
            v = 0.5 * rng.normal(size=3)
            turn[name] = Rotation.from_rotvec(v).as_matrix(), model.rest.x[k].copy(), rng.normal(size=3), v
            motion.R[k], motion.x[k] = turn[name][0], model.rest.x[k] + turn[name][2]
    motion.multiplier[:] = (0.7, -0.4)

    def way(link, at):
        if link == "ground":
            return np.zeros(3)
        R, rest, shift, _ = turn[link]
        return shift + (R - np.eye(3)) @ (np.array(at) - rest)

    work = np.dot((1.0, -2.0, 3.0), way("one", (0.25, 0.2, -0.1)))
    work += np.dot((0.5, 1.0, -1.0), way("two", (0.4, 0.1, 0.1))) + np.dot((0.3, 0.1, -0.2), turn["two"][3])
    for name, links in (("one", ("ground", "one")), ("two", ("one", "two"))):
        a, b = np.array(ends[name])
        weight = 7800 * 1e-3 * 0.02 * np.linalg.norm(b - a) * np.array(scene.gravity)
        work += 0.5 * weight @ (way(links[0], a) + way(links[1], b))
    driving, loading = branch_check.secant_work(model, motion, np.array([0.2, 0.3]))
    assert driving == pytest.approx(-0.5 * (0.7 * 0.2 - 0.4 * 0.3))
    assert loading == pytest.approx(0.5 * work)
