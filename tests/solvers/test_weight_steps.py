"""Weight of the leaf springs in the five steps, on paths and in error estimates."""

import numpy as np
import pytest
from scenes import STEEL, fourbar, slider

import ksd
from ksd.model.compile import compile_scene
from ksd.solvers.arc_length import residual_rate
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.load_steps import LoadPath
from ksd.solvers.loading_order import follow_in_order

MESHES = {"modes": ksd.Mesh(), "chain": ksd.Mesh("corotational", elements=3)}


def heavy(strength):
    """The fourbar, lying in the plane or leaning out of it, with leaf springs that weigh `strength` times as much."""
    scene = fourbar()
    scene.gravity = tuple(strength * np.array([4.0, -9.0, 2.0]))
    return scene


@pytest.mark.parametrize("mesh", MESHES)
def test_the_five_steps_carry_the_weight(mesh):
    """Gravity 100 times the earth's moves the drive force by a fifth; full agrees with conventional to 1e-8."""
    scene, words = heavy(100.0), {"mesh": MESHES[mesh]}
    exact = solve_conventional(compile_scene(scene, **words), {"top": 0.1}, planar=False)
    bare = solve_conventional(compile_scene(fourbar(), **words), {"top": 0.1}, planar=False)
    change = exact.forces["top"] - bare.forces["top"]
    assert abs(change) > 0.1 * bare.forces["top"]
    found = {
        n: ksd.solve(scene, top=0.1, method=m, estimate=False, **words, **more)
        for n, m, more in (
            ("kinematic", "kinematic", {}),
            ("reduced", "reduced", {}),
            ("passed", "reduced", {"relinearisations": 1}),
            ("full", "full", {}),
        )
    }
    off = {n: abs(c.forces["top"] - exact.forces["top"]) / abs(change) for n, c in found.items()}
    assert off["kinematic"] < 0.3
    assert off["reduced"] < 0.05
    assert off["passed"] < 5e-3
    assert np.abs(found["full"].motion.x - exact.motion.x).max() < 1e-8 * 0.1
    told = ksd.solve(scene, top=0.1, method="reduced", **words)
    assert told.error.relative > 0.0
    assert abs(told.forces["top"] - exact.forces["top"]) < 0.1 * off["reduced"] * abs(change)


@pytest.mark.parametrize("axis", ["z", "-z"])
@pytest.mark.parametrize("mesh", MESHES)
def test_every_step_comes_closer_with_weight(mesh, axis):
    """Internal blocks, a joint seen from behind, a spring; every pass comes closer, the fifth step gets there."""
    scene, targets = slider(axis), {"stroke": 0.01, "turn": 0.15}
    scene.spring("ground", "arm", start=(0, 0.1, 0), end=(0.15, 0.02, 0), stiffness=300.0, free_length=0.1)
    scene.gravity = (60.0, -130.0, 0.0)
    solver = ksd.prepare(scene, mesh=MESHES[mesh])
    exact, far = solver(targets, method="conventional"), []
    for method, relinearisations in (("kinematic", 0), ("reduced", 0), ("reduced", 1), ("full", 0)):
        found = solver(targets, method=method, relinearisations=relinearisations, estimate=False)
        far.append(max(abs(found.forces[n] / exact.forces[n] - 1) for n in targets))
    # the kinematic forces know no springs
    assert far[1] > 10 * far[2] > 10 * far[3] and far[3] < 1e-8
    assert (
        abs(ksd.solve(scene, targets, without="gravity").forces["stroke"] / exact.forces["stroke"] - 1) > 0.1
    )


def test_batches_carry_the_weight_and_tables_refuse_it():
    scene, solver = heavy(100.0), ksd.prepare(heavy(100.0))
    tops = [0.05, 0.1]
    found = ksd.batch(scene, top=tops, threads=2)
    for n, top in enumerate(tops):
        single = solver(top=top, method="reduced", estimate=False)
        assert found.forces["top"][0, n] == pytest.approx(single.forces["top"], rel=1e-9)
    with pytest.raises(ksd.SceneError, match="have weight"):
        ksd.batch(scene, top=tops, tabulated=True)


def test_it_is_there_unless_switched_off_however_small():
    bare, off = (
        ksd.solve(s, top=0.1, method="reduced", **w)
        for s, w in ((fourbar(), {}), (heavy(1.0), {"without": "gravity"}))
    )
    assert bare.forces == off.forces and off.model.arrays.weight.size == 0
    # 0.25 kg of steel against 64 N, and a ten thousandth of its weight
    for strength in (1.0, 1e-4):
        model = ksd.solve(heavy(strength), top=0.1).model
        assert model.choice["gravity"].present and model.arrays.weight.size > 0
        assert "m/s^2 on 12 of 12 leaf springs, those of known density" in model.choice["gravity"].reason


@pytest.mark.parametrize("mesh", MESHES)
def test_derivative_of_the_residual_by_the_load_factor(mesh):
    """What arc length needs of the weight, against finite differences at settled inner states."""
    from ksd.model.arrays import make_workspace
    from ksd.model.newton import assemble, take_step

    model = compile_scene(heavy(100.0), mesh=MESHES[mesh])
    arrays, motion = (
        model.arrays,
        solve_conventional(
            compile_scene(heavy(100.0), mesh=MESHES[mesh]), {"top": 0.1}, planar=False
        ).motion.copy(),
    )
    work, target = make_workspace(arrays), np.array([0.1])

    def residual(factor):
        for _ in range(6):
            assemble(arrays, motion, target, factor, work, 1e-8, 0, 10.0)
            take_step(arrays, motion, np.zeros(arrays.plan.unknowns), work, 1.0)
        assemble(arrays, motion, target, factor, work, 1e-8, 0, 10.0)
        return work.rhs.copy()

    difference = (residual(1.001) - residual(0.999)) / 0.002
    residual(1.0)
    exact = residual_rate(model, motion, LoadPath(target, target), work)
    assert np.abs(difference - exact).max() < 1e-5 * np.abs(difference).max()


def test_weight_put_on_after_the_drives():
    model = compile_scene(heavy(100.0))
    exact = solve_conventional(model, {"top": 0.1}, planar=False)
    for order in ("loads", "drives"):
        last = follow_in_order(model, model.targets({"top": 0.1}), order)
        assert last.is_regular and -last.state.multiplier[0] == pytest.approx(exact.forces["top"], rel=1e-8)


def test_a_path_with_weight_that_grows():
    """A blade that stands and leans: the weight is put on by arc length, to the equilibrium of load steps."""
    section = ksd.rectangle(1e-4, 1e-2)
    scene = ksd.Mechanism("leaning")
    tip = scene.link("tip")
    scene.leaf(
        scene.ground,
        tip,
        start=(0, 0, 0),
        end=(0.1, 0, 0),
        section=section,
        material=STEEL,
        width_axis=(0, 0, 1),
    )
    scene.gravity = (-20.0, 0.5, 0)
    model = compile_scene(scene)
    path = ksd.follow(scene)
    steps = solve_conventional(model, {}, steps=10)
    assert path.ended
    assert np.abs(path.states[-1].motion.x - steps.motion.x).max() < 1e-8
