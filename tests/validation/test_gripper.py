"""The planar gripper of paper 3 beside the numbers of `published_planar`: constant flexure matrices, tangents, errors."""

import math
from dataclasses import replace
from importlib import import_module, resources
from pathlib import Path

import numpy as np
import pytest
from published_planar import constant, inextensible
from scenes import cross_flexure, single_joint

import ksd
from ksd.answers.tangent import stored_matrix
from ksd.errors import TrustError
from ksd.model.arrays import make_workspace
from ksd.model.constant_leaves import rest_stiffness
from ksd.model.newton import assemble, take_step
from ksd.model.plane import Plane
from ksd.solvers import branch_check, load_steps
from ksd.solvers.arc_length import follow_by_arc_length
from ksd.solvers.steps import percent

FINE = ksd.Mesh(orders=(3, 2, 16), points=20)


@pytest.fixture
def paper(monkeypatch):
    """The benchmark script, which holds the linear balance and the formulas of both."""
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "benchmarks"))
    return import_module("paper3")


def test_partial_balance(paper):
    """The leaf springs of `method="constant"` are the closed form of the paper, inextensible or with stretch and shear."""
    section = inextensible(paper.SECTION)
    found = paper.configuration_answers(paper.solve_constant(5e-3, section=section, linear=False))
    assert found == pytest.approx(constant(), rel=2e-6)
    found = ksd.solve(paper.gripper(4e-3, (-0.05, 0.02)), method="constant", mesh=FINE)
    assert paper.answers(found) == pytest.approx(
        paper.configuration_answers(paper.solve_constant(4e-3, (-0.05, 0.02), linear=False)), rel=1e-8
    )


def test_compliance_of_an_arc(paper):
    """The closed form against the leaf at rest, stretch and shear in, turned from end B to end A; 1/EI alone as printed."""
    leaf = ksd.Leaf(
        start=(0, 0, 0), end=(2 * 4e-3 * math.sin(0.6), 0, 0), width_axis=(0, 0, 1), curve=ksd.Arc(radius=4e-3, angle=1.2),
        section=paper.SECTION, material=paper.PLASTIC,
    )  # fmt: skip
    E, G, section = paper.PLASTIC.E, paper.PLASTIC.G, paper.SECTION
    stretch, shear = E * section.A, section.ky * G * section.A
    K = rest_stiffness(leaf, FINE)[np.ix_([0, 1, 5], [0, 1, 5])]
    turn = np.eye(3)
    turn[:2, :2] = paper.rotation_matrix(1.2)
    assert np.linalg.inv(turn.T @ K @ turn) == pytest.approx(
        leaf.curve.compliance(E * section.Iz, EA=stretch, GA=shear), rel=1e-9, abs=1e-12
    )
    r, a = 4e-3, 1.2
    s, c = math.sin(a), math.cos(a)
    printed = [
        [r**3 * (1.5 * a - 2 * s + s * c / 2), r**3 * (1 - c - s * s / 2), r**2 * (a - s)],
        [r**3 * (1 - c - s * s / 2), r**3 * (a / 2 - s * c / 2), r**2 * (1 - c)],
        [r**2 * (a - s), r**2 * (1 - c), r * a],
    ]
    assert ksd.Arc(radius=r, angle=a).compliance(2.0) == pytest.approx(np.array(printed) / 2.0, rel=1e-12)


@pytest.mark.parametrize("linear", [False, True])
def test_tangents_of_both_balances(paper, linear):
    q = np.random.default_rng(3).uniform(-1, 1, 9) * np.tile([5e-3, 5e-3, 0.4], 3)
    K, force, h = paper.arc_stiffness(), np.array([-0.05, 0.02]), 1e-6
    _, H = paper.residual(q, K, 4e-3, force, linear=linear)
    sides = [
        [paper.residual(q + sign * h * e, K, 4e-3, force, linear=linear)[0] for sign in (1, -1)]
        for e in np.eye(9)
    ]
    differences = np.array([(a - b) / (2 * h) for a, b in sides]).T
    scale = np.sqrt(np.outer(np.abs(np.diag(H)), np.abs(np.diag(H))))
    assert np.abs(H - differences).max() < 1e-7 * np.abs(H).max()
    assert np.abs((H - differences) / scale).max() < 1e-6
    lean = np.abs((H - H.T) / scale).max()
    assert lean > 1e-3 if linear else lean < 1e-14


def test_tangent_of_the_model(paper):
    """Symmetric to rounding, and the derivative of the residual, at a bent state of leaf springs of constant stiffness."""
    solver = ksd.prepare(paper.gripper(4e-3, (-0.05, 0.02)))
    pose = solver(method="constant", estimate=False)
    plane = pose.model.plane
    assert isinstance(plane, Plane)
    arrays, nothing = plane.arrays, np.zeros(0)
    rows = np.zeros(len(arrays.terms.start))
    work = make_workspace(arrays)

    def gradient(step):
        state = pose.motion.copy()
        assemble(arrays, state, rows, 1.0, work, 1e-8, 0, 10.0)
        take_step(arrays, state, step, work, 1.0)
        assemble(arrays, state, rows, 1.0, work, 1e-8, 0, 10.0)
        return work.rhs.copy()

    assert nothing.size == 0 and arrays.plan.unknowns == 9
    gradient(np.zeros(9))
    K = stored_matrix(arrays, work.matrix)
    h = 1e-6
    differences = np.array([(gradient(h * e) - gradient(-h * e)) / (2 * h) for e in np.eye(9)]).T
    scale = np.sqrt(np.outer(np.diag(K), np.diag(K)))
    assert np.abs(K - K.T).max() <= 1e-14 * np.abs(K).max()
    assert np.abs((K - differences) / scale).max() < 1e-7


@pytest.mark.parametrize("degrees", [5, 15, -20])
def test_error_of_the_constant_method_is_told(paper, degrees):
    scene = paper.gripper(driven=True)
    exact = ksd.solve(scene, crank=math.radians(degrees), mesh=FINE)
    found = ksd.solve(scene, crank=math.radians(degrees), method="constant")
    true = abs(found.forces["crank"] / exact.forces["crank"] - 1)
    assert found.error.relative == pytest.approx(true, rel=0.1)
    assert found.error.mesh < 1e-6
    # stress is that of the leaf springs as they bend between these poses, which are a little off
    assert found.stress().largest_Pa == pytest.approx(exact.stress().largest_Pa, rel=0.2)
    assert "bodies of constant stiffness" in str(found) and found.trusted


def test_an_error_larger_than_the_answer_is_told():
    """A shallow arch, clamped and guided, pushed down: its stiffness at rest gives ten times the force, and it is said so,
    of the true force; where the state next to it is of another kind, the error is not known."""
    curve = ksd.FreeCurve.legendre([0.0, -0.6], length=0.1)
    end = tuple(curve.line(1.0)[0])
    scene = ksd.Mechanism("arch", plane="xy")
    scene.leaf("ground", scene.link("tip"), start=(0, 0, 0), end=end, curve=curve, section=ksd.rectangle(5e-4, 0.01),
               material=ksd.Material(E=200e9, nu=0.3))  # fmt: skip
    scene.slider("tip", along="y", at=end)
    scene.actuate("tip", along="y", at=end, name="d")
    exact = ksd.solve(scene, d=-1e-3, strict=False)
    found = ksd.solve(scene, d=-1e-3, method="constant", strict=False)
    true = abs(found.forces["d"] / exact.forces["d"] - 1)
    assert true > 0.3 and found.error.relative == pytest.approx(true, rel=1e-2)
    far = ksd.solve(scene, d=-7e-3, method="constant", strict=False)
    assert far.error.relative == math.inf and not far.trust.trusted


def test_links_held_in_their_plane_need_no_look_in_space(paper):
    """Of constant leaf springs between links that the plane holds one by one nothing can leave it: the same in space."""
    flat, space = (
        ksd.prepare(paper.gripper(4e-3, (-0.05, 0.02)), planar=p)(method="constant") for p in (True, False)
    )
    assert paper.answers(flat) == pytest.approx(paper.answers(space), rel=1e-9)
    assert flat.negatives == space.negatives == flat.expected_negatives and flat.trusted and space.trusted
    # in the packaged scene joints alone hold jaw and rocker: those are looked at
    scene, targets, _ = shipped()
    shown = ksd.solve(scene, targets, method="constant")
    assert shown.negatives == shown.expected_negatives
    assert not load_steps._cannot_leave_plane(ksd.prepare(scene).constant[0])
    assert load_steps._cannot_leave_plane(flat.model)


def shipped():
    with resources.as_file(resources.files("ksd") / "scenes" / "gripper.toml") as file:
        return ksd.load_scene(file)


def test_the_gripper_scene(paper):
    """The packaged scene is the gripper of the script."""
    scene, targets, _ = shipped()
    want = ksd.solve(paper.gripper(driven=True), crank=math.radians(15))
    opening = paper.answers(want)[2]
    assert opening == pytest.approx(-7.647509, rel=1e-5)
    for method, near in (("constant", 5e-3), ("reduced", 1e-3), ("full", 1e-7), ("conventional", 1e-7)):
        found = ksd.solve(scene, targets, method=method)
        assert paper.answers(found)[2] == pytest.approx(opening, rel=near), method


def test_an_arc_hinge_four_ways():
    """One hinge with a record: the constant method is the linear one, the others see its stiffness change."""
    stuff = ksd.Material(E=200e9, nu=0.3)
    scene = single_joint(
        ksd.ArcHinge(stuff, radius=0.02, angle=math.radians(100), thickness=3e-4, width=0.01)
    )
    scene.load("tip", force=(0, 0.2, 0), at=(0.03, 0, 0))
    ways = ("constant", "reduced", "full", "conventional")
    poses = {way: ksd.solve(scene, turn=0.2, method=way) for way in ways}
    exact = poses["conventional"].forces["turn"]
    for way, error in zip(ways, (0.02, 1e-3, 1e-8, 0.0), strict=True):
        off = abs(poses[way].forces["turn"] / exact - 1)
        assert off <= error
        if way in ("constant", "reduced"):
            # at equilibrium, to which `reduced` may lead, none is left but rounding
            assert poses[way].error.relative >= 0.5 * off - 1e-9


def test_required_loads_give_the_loads_back(paper):
    loads = 4e-3, (-0.05, 0.02)
    for method in (None, "constant"):
        pose = ksd.solve(paper.gripper(*loads), method=method, accuracy=None if method else 1e-6)
        need = ksd.required_loads(paper.gripper(), pose.links, method=method)
        at = pose.displacement("jaw", (*paper.JAW, 0)) + np.array([*paper.JAW, 0])
        moment = np.cross(at - need.points["jaw"], (-0.05, 0.02, 0))
        assert need.loads["crank"] == pytest.approx([0, 0, 0, 0, 0, 4e-3], abs=1e-8)
        assert need.loads["jaw"] == pytest.approx([-0.05, 0.02, 0, *moment], abs=1e-8)
        assert need.loads["rocker"] == pytest.approx(np.zeros(6), abs=1e-8)
        assert not need.balanced and "unbalanced" in str(need)
        # of the scene that has them already nothing more is needed
        rest = ksd.required_loads(paper.gripper(*loads), pose.links, method=method).loads
        assert np.abs(list(rest.values())).max() < 1e-8


def test_required_loads_in_space_give_the_drive_force_back():
    """Rotations about several axes: components of the rotation vector were taken for twists about the axes, which stiff leaf
    springs told as forces of several times the drive force."""
    scene = ksd.Mechanism("space")
    body, blade = scene.link("body"), ksd.rectangle(5e-4, 0.01)
    stuff = ksd.Material(E=200e9, nu=0.3)
    scene.leaf(
        "ground", body, start=(0, 0, 0), end=(0.1, 0, 0), section=blade, material=stuff, width_axis="z"
    )
    scene.leaf(
        "ground",
        body,
        start=(0, 0.03, 0.02),
        end=(0.1, 0.03, 0.05),
        section=blade,
        material=stuff,
        width_axis="y",
    )
    scene.actuate(body, along=(1, 2, 3), at=(0.1, 0.05, 0), name="push")
    pose = ksd.solve(scene, push=4e-3)
    assert (np.abs(pose.rotation("body")) > 1e-3).all()
    need = ksd.required_loads(scene, pose.links)
    assert need.balanced and need.forces["push"] == pytest.approx(pose.forces["push"], rel=1e-5)


def test_required_loads_tell_their_error():
    """Against a mesh of many more modes: errors of the mesh, of a mesh that is given, and of constant stiffness."""

    def bent(**how):
        scene = ksd.Mechanism("bent")
        tip = scene.link("tip")
        scene.leaf(
            "ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), section=ksd.rectangle(5e-4, 0.03), width_axis="z",
            material=ksd.Material(E=200e9, nu=0.3),
        )  # fmt: skip
        if how.pop("plate", False):
            scene.consider("plate")
        scene.actuate(tip, along="y", at=(0.1, 0, 0), name="push")
        return ksd.required_loads(scene, {"tip": ((-0.004, 0.02, 0.001), (0.02, 0.01, 0.3))}, **how)

    for how in (
        {},
        {"plate": True},
        {"mesh": ksd.Mesh("corotational", elements=3)},
        {"method": "constant"},
    ):
        found = bent(**how)
        fine = bent(mesh=ksd.Mesh(orders=(9, 8, 14), points=24), plate=how.get("plate", False))
        off = np.abs(found.loads["tip"] - fine.loads["tip"])
        told = found.errors.loads["tip"]
        largest = np.abs(fine.loads["tip"] / [1, 1, 1, 0.1, 0.1, 0.1]).max()
        assert np.all(np.abs(told - off) <= 0.1 * off.max() + 1e-7 * largest), how
        assert found.errors.forces["push"] == pytest.approx(
            abs(found.forces["push"] - fine.forces["push"]), rel=0.1, abs=1e-7 * largest
        )
        assert f"estimated error {percent(found.error)} %" in " ".join(str(found).split())
        assert 1e-9 < found.error <= 1.0

    def nowhere():
        raise ksd.ConvergenceError("no equilibrium there", reached=0.0)

    lost = replace(bent(), refined=nowhere)
    assert lost.error == np.inf and "error not known" in " ".join(str(lost).split())


def test_required_loads_warn_of_strained_leaf_springs():
    """A leaf pulled 3 % longer was answered with its 60 kN and no other word."""
    scene = ksd.Mechanism("pulled")
    tip = scene.link("tip")
    scene.leaf(
        "ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), section=ksd.rectangle(5e-4, 0.02), width_axis="z",
        material=ksd.Material(E=200e9, nu=0.3, yield_stress=1e9),
    )  # fmt: skip
    strained, yields = ksd.required_loads(scene, {"tip": ((0.003, 0, 0), (0, 0, 0))}).warnings
    assert "strained by 3 %" in strained and "the stress in leaf" in yields
    printed = ksd.required_loads(scene, {"tip": ((0.0, 0.003, 0), (0, 0, 0))})
    assert printed.warnings == () and "Warning" not in str(printed)


@pytest.mark.parametrize("posed", [("top",), ("left", "top", "right")])
def test_required_loads_where_links_cannot_be_moved_straight_to_their_poses(posed):
    """Half way along the chord the leaf springs of a fourbar would be pressed until they buckle."""
    joint, scene = cross_flexure(), ksd.Mechanism("fourbar")
    left, top, right = scene.links("left", "top", "right")
    for a, b, x, y in ((scene.ground, left, -0.2, 0), (left, top, -0.2, 0.3), (right, top, 0.2, 0.3),
                       (scene.ground, right, 0.2, 0)):  # fmt: skip
        scene.join(a, b, joint, at=(x, y, 0), axis="z", toward="y")
    scene.actuate(top, along="x", at=(0, 0.4, 0), name="push")
    scene.load(top, force=(0, -3, 1), at=(0, 0.4, 0))
    pose = ksd.solve(scene, push=0.25, method="conventional")
    found = ksd.required_loads(scene, {name: pose.links[name] for name in posed})
    assert found.forces["push"] == pytest.approx(pose.forces["push"], rel=1e-4)
    assert all(np.abs(rest).max() < 1e-3 * abs(pose.forces["push"]) for rest in found.unbalanced.values())


def test_required_loads_of_a_state_that_is_not_stable():
    """A leaf spring pressed end to end beyond its buckling load: its straight state holds the pose, and would not stay."""
    scene = ksd.Mechanism("column", plane="xy")
    tip = scene.link("tip")
    scene.leaf("ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), section=ksd.rectangle(5e-4, 0.01),
               material=ksd.Material(E=200e9, nu=0.3))  # fmt: skip
    with pytest.raises(ksd.TrustError, match="poses: what is found there is not to be trusted: UNSTABLE"):
        ksd.required_loads(scene, {"tip": ((-1e-4, 0, 0), 0.0)})
    assert ksd.required_loads(scene, {"tip": ((-1e-5 / 4, 0, 0), 0.0)}).loads["tip"][0] < 0


def test_required_forces_of_a_control_loop(paper):
    """Arrays in and out, by matrices, rotation vectors and angles: what `required_loads` says by names."""
    scene = paper.gripper(driven=True)
    scene.actuate("rocker", about="z", name="second")
    scene.support("jaw", along="y", at=(*paper.JAW, 0), name="rest")
    solver = ksd.prepare(scene)
    for torque in (2e-3, 4e-3):
        pose = ksd.solve(paper.gripper(torque, (-0.05, 0.02)), method="constant")
        shift, turn = (np.array([pose.links[n][k] for n in ("crank", "jaw", "rocker")]) for k in (0, 1))
        need = ksd.required_loads(solver, pose.links, method="constant")
        angles = [pose.rotation(n)[2] for n in ("crank", "jaw", "rocker")]
        for said in (turn, angles, np.outer(angles, (0, 0, 1))):
            found = solver.required_forces(shift, rotation=said)
            assert found.forces == pytest.approx(list(need.forces.values()), rel=1e-9)
            assert found.reactions == pytest.approx([need.reactions["rest"]], rel=1e-9)
            assert found.unbalanced == pytest.approx(np.array(list(need.unbalanced.values())), abs=1e-12)
            assert found.needed[0] == pytest.approx([0, 0, 0, 0, 0, torque], abs=1e-8)
    with pytest.raises(ksd.SceneError, match=r"give displacement \(3, 3\) .* of crank, jaw, rocker"):
        solver.required_forces(shift[:2], rotation=turn)
    inner = ksd.prepare(single_joint(), mesh=ksd.Mesh("corotational", elements=2))
    with pytest.raises(ksd.SceneError, match="give displacement"):
        inner.required_forces(np.zeros((1, 3)), rotation=0.0)


def test_fewer_actuators_than_poses(paper):
    """The crank's drive gives its moment, the force on the jaw is left over; a pose the drive can hold is balanced."""
    scene = paper.gripper(driven=True)
    pose = ksd.solve(paper.gripper(4e-3, (-0.05, 0.02)), method="constant")
    need = ksd.required_loads(scene, pose.links, method="constant")
    assert need.forces["crank"] == pytest.approx(4e-3, rel=1e-6)
    assert need.unbalanced["jaw"][:2] == pytest.approx((-0.05, 0.02), rel=1e-6)
    assert not need.balanced
    driven = ksd.solve(scene, crank=0.3)
    alone = ksd.required_loads(scene, {"crank": driven.links["crank"]})
    assert alone.balanced and alone.forces["crank"] == pytest.approx(driven.forces["crank"], rel=1e-6)
    # a pose by angle and another point
    shift = driven.displacement("crank", (0, 0.03, 0))
    same = ksd.required_loads(scene, {"crank": (shift, 0.3, (0, 0.03, 0))})
    assert same.forces["crank"] == pytest.approx(driven.forces["crank"], rel=1e-6)


def test_what_a_solver_leaves_out_does_not_move_the_other_links():
    """Two leaf springs in a row, their end held where it is at rest: without gravity the mass between them does not sag."""
    scene = ksd.Mechanism("row", plane="xy")
    links = "ground", *scene.links("middle", "end")
    for k in range(2):
        scene.leaf(*links[k : k + 2], start=(0.05 * k, 0, 0), end=(0.05 * k + 0.05, 0, 0),
                   section=ksd.rectangle(5e-4, 1e-2), material=ksd.Material(E=200e9, nu=0.3))  # fmt: skip
    scene.mass("middle", mass=0.2, at=(0.05, 0, 0))
    scene.gravity = (0, -9.81, 0)
    poses = {"end": ((0, 0, 0), 0.0)}
    assert ksd.required_loads(ksd.prepare(scene), poses).loads["end"][1] > 0.5
    need = ksd.required_loads(ksd.prepare(scene, without="gravity"), poses)
    assert need.loads["end"] == pytest.approx(np.zeros(6), abs=1e-9)


def test_actuators_are_shared_by_least_squares():
    """A bar on two leaf springs, wanted 1 mm up and level, by one actuator beside its middle."""
    scene = ksd.Mechanism("bar", plane="xy")
    bar = scene.link("bar")
    for x in (0.0, 0.1):
        scene.leaf("ground", bar, start=(x, 0, 0), end=(x, 0.05, 0), section=ksd.rectangle(5e-4, 1e-2),
                   material=ksd.Material(E=200e9, nu=0.3))  # fmt: skip
    scene.actuate(bar, along="x", at=(0.05, 0.06, 0), name="push")
    wanted = {"bar": ((1e-3, 0, 0), 0.0)}
    need = ksd.required_loads(scene, wanted)
    W, size = need.loads["bar"], need.size
    arm = 0.06 - need.points["bar"][1]
    # fx = F, moment about the reference point -arm F, in moments over the size
    best = (W[0] - arm * W[5] / size**2) / (1 + (arm / size) ** 2)
    assert need.forces["push"] == pytest.approx(best, rel=1e-9)
    assert need.unbalanced["bar"] == pytest.approx(W - np.array([best, 0, 0, 0, 0, -arm * best]), abs=1e-9)


def slider_crank(angle):
    """A crank of 40 mm, drawn at this angle, a rigid rod of 120 mm, and a slider on a leaf spring."""
    A = 0.04 * np.array([math.cos(angle), math.sin(angle), 0])
    B = np.array([A[0] + math.sqrt(0.12**2 - A[1] ** 2), 0, 0])
    scene = ksd.Mechanism("slider-crank", plane="xy")
    crank, rod, slider = scene.links("crank", "rod", "slider")
    scene.pin("ground", crank, at=(0, 0, 0))
    scene.pin(crank, rod, at=A)
    scene.pin(rod, slider, at=B)
    scene.slider(slider, along="x", at=B)
    scene.leaf("ground", slider, start=(B[0], 0.08, 0), end=B, section=ksd.rectangle(5e-4, 0.01),
               material=ksd.Material(E=200e9, nu=0.3))  # fmt: skip
    scene.actuate(slider, along="x", at=B, name="push")
    return scene, 0.16 - B[0]


def test_poses_beyond_a_dead_centre(monkeypatch):
    """Poses that rods cannot lead to say how far they do, which links stand in line there, and whose pose would do. Paths to
    them are left where they turn."""
    scene, most = slider_crank(0.6)
    walks = []
    monkeypatch.setattr(
        branch_check,
        "follow_by_arc_length",
        lambda *a, **k: walks.append(follow_by_arc_length(*a, **k)) or walks[-1],
    )
    share = f"{100 * most / (most + 1e-4):.3g} % of its way, 9.1"
    with pytest.raises(
        ksd.ConvergenceError,
        match=rf"'slider' is led no further than {share}.* 'crank' and 'rod' are at a dead",
    ):
        ksd.required_loads(scene, {"slider": ((most + 1e-4, 0, 0), 0.0)})
    assert {walk.stop_reason for walk in walks if walk.singular_points} == {"it turns"}
    # the pose of the crank leads through it, and at rest nothing is needed
    through = ksd.required_loads(scene, {"crank": ((0, 0, 0), -1.2, (0, 0, 0))})
    assert through.balanced and through.forces["push"] == pytest.approx(0.0, abs=1e-6)
    with pytest.raises(ksd.ConvergenceError, match=r"no further than 0 % .* dead centre"):
        ksd.required_loads(slider_crank(0.0)[0], {"slider": ((-1e-3, 0, 0), 0.0)})


def test_required_loads_are_as_fine_as_a_solve():
    scene, most = slider_crank(0.6)
    want = ksd.solve(scene, push=0.9 * most, accuracy=1e-6).forces["push"]
    need = ksd.required_loads(scene, {"slider": ((0.9 * most, 0, 0), 0.0)})
    assert need.balanced and need.forces["push"] == pytest.approx(want, rel=2e-5)


@pytest.mark.parametrize("method", [None, "constant"])
@pytest.mark.parametrize(
    "pose, said",
    [
        (((0, 0, 0), 60.0), r"within 3\.1416 rad either way, not 60\.0; -2\.83185 is the same pose"),
        (((0, 0, 0), (0, 0, -3.5)), r"not \(0, 0, -3\.5\); \[.*2\.78319\] is the same pose"),
        (((0, 0, 0), math.nan), r"'crank': .* is not finite"),
        (((math.inf, 0, 0), 0.0), r"'crank': .* is not finite"),
        (((0, 0, 0), 0.0, (0, math.nan, 0)), r"'crank': .* is not finite"),
        (((0, 0, 0), 2 * np.eye(3)), r"'crank': .* is no rotation matrix"),
        (((0, 0, 0), np.diag([-1, 1, 1])), r"'crank': .* is no rotation matrix"),
    ],
)
def test_rotations_that_are_none_are_refused(paper, pose, said, method):
    """They were answered as for another pose, or ended in an error of numpy."""
    poses = dict.fromkeys(("jaw", "rocker"), ((0, 0, 0), 0.0))
    with pytest.raises(ksd.SceneError, match=said):
        ksd.required_loads(paper.gripper(driven=True), {"crank": pose, **poses}, method=method)


def test_wrong_poses_are_refused(paper):
    scene = paper.gripper(driven=True)
    with pytest.raises(ksd.SceneError, match=r"leaf 'arc 0' would be .* apart, but it is 18.85 mm long"):
        ksd.required_loads(scene, {"crank": ((0.03, 0, 0), 0.0)})
    with pytest.raises(ksd.SceneError, match="crank"):
        ksd.required_loads(scene, {"crnk": ((0, 0, 0), 0.0)})
    with pytest.raises(ksd.SceneError, match="must be"):
        ksd.required_loads(scene, {"crank": 0.3})
    with pytest.raises(ksd.SceneError, match="method"):
        ksd.required_loads(scene, {"crank": ((0, 0, 0), 0.0)}, method="full")
    with pytest.raises(ksd.SceneError, match=r"'ground': .* does not move"):
        ksd.required_loads(scene, {"ground": ((0.01, 0, 0), 0.0)})
    heavy = paper.gripper(driven=True)
    heavy.fit("arc 0", shift=(1e-4, 0, 0))
    with pytest.raises(ksd.SceneError, match="under stress at rest"):
        ksd.solve(heavy, crank=0.1, method="constant")
    assert issubclass(TrustError, ksd.KsdError)


def test_the_script(paper, tmp_path):
    found = paper.main(["--quick", "--out", str(tmp_path)])
    assert found["exact"][-1][0] == pytest.approx(0.3458773, rel=1e-5)
    assert found["inverse"]["conventional"]["torque"] == pytest.approx(3.84766e-3, rel=1e-5)
    assert (tmp_path / "paper3.png").stat().st_size > 20_000
