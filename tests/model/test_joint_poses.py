"""Where joints and links are by their records, and what follows from it, against differences and plain algebra."""

import numpy as np
import pytest
from scenes import STEEL, cross_flexure, fourbar, slider
from scipy.spatial.transform import Rotation

import ksd
from ksd.elements.strain_values import GRAVITY_BLOCK_SIZE
from ksd.joints.drive_forces import drive_forces
from ksd.joints.intended_motions import intended_motions
from ksd.joints.joint_arrays import JointKinematics
from ksd.joints.joint_poses import _set_planar_pose, _set_spatial_pose, joint_poses
from ksd.joints.joint_weight import gravity_in_joint_axes, place_joint_weights
from ksd.joints.joints import joint_bodies
from ksd.joints.kinematics import close_loops, loop_equations_at
from ksd.joints.substructures import place_internal_blocks, relative_poses
from ksd.library import find_record
from ksd.numerics.rotations import rotation_log


def places(loops, theta):
    """(J, 24)."""
    place, series = np.zeros((len(loops.node), 24)), np.zeros((3, loops.pose.shape[2]))
    joint_poses(*loops.flat, theta, place, series)
    return place


@pytest.mark.parametrize("theta", [(0.2, 0.1, -0.15), (-0.3, 0.0, 0.2), (0.1, -0.2, 0.0)])
def test_derivatives_of_places_are_their_differences(theta):
    """Of a joint that moves in its plane and one with two motions out of it."""
    scene = ksd.Mechanism("two")
    middle, tip = scene.link("middle"), scene.link("tip")
    scene.join(scene.ground, middle, cross_flexure(), at=(0, 0, 0), axis="z", toward="x")
    universal = ksd.UniversalJoint(STEEL, length=0.1, thickness=5e-4, width=0.04)
    scene.join(middle, tip, universal, at=(0.2, 0, 0), axis="z", toward="x")
    loops = joint_bodies(ksd.compile_scene(scene), find_record).kinematics
    assert loops.first.tolist() == [0, 1, 3]
    theta, step, turn = np.array(theta), 1e-5, np.empty(3)
    found = places(loops, theta)
    for j, k, motion in ((0, 0, 0), (1, 0, 1), (1, 1, 2)):
        away = step * np.eye(3)[motion]
        more, less = places(loops, theta + away)[j], places(loops, theta - away)[j]
        rotation_log(more[:9].reshape(3, 3) @ less[:9].reshape(3, 3).T, turn)
        shift = more[9:12] - less[9:12]
        at = 12 + 6 * k
        assert np.linalg.norm(found[j, at : at + 6]) > 0.1
        assert found[j, at : at + 3] == pytest.approx(shift / (2 * step), abs=1e-10)
        assert found[j, at + 3 : at + 6] == pytest.approx(turn / (2 * step), abs=1e-9)


@pytest.fixture(scope="module")
def loop():
    """One loop and two more links, joints drawn either way, and constraint rows of every kind: the joints of all."""
    scene = ksd.Mechanism("loop")
    scene.links("c", "d", "a", "b")
    universal = ksd.UniversalJoint(STEEL, length=0.1, thickness=5e-4, width=0.04)
    x, y = (0.6, 0.0, 0.8), (0.0, 1.0, 0.0)
    scene.join("d", "b", universal, at=(0.6, 0.3, -0.2), axis="x", toward="y", name="off")
    scene.join(scene.ground, "a", cross_flexure(), at=(0, 0.1, 0), axis="z", toward="x", name="one")
    scene.join("b", scene.ground, cross_flexure(), at=(0.5, 0.1, 0), axis=x, toward=y, name="back")
    scene.join("b", "a", universal, at=(0.2, -0.1, 0.1), axis=y, toward=x, name="closing")
    scene.join("a", "c", universal, at=(0.2, 0.3, 0), axis="z", toward="x", name="on")
    scene.actuate("c", along="y", at=(0.3, 0.2, 0.1), name="global")
    scene.actuate("d", along=x, at=(0.3, 0.4, 0.1), relative_to="c", name="between")
    scene.actuate("c", about="z", relative_to="a", name="turn of a neighbour")
    scene.actuate("a", about=y, relative_to="c", name="of the other neighbour")
    scene.actuate("d", about=x, name="turn")
    scene.actuate("c", about=y, name="turn of the first link")
    near, far = scene.rotation("c", "x", relative_to="a"), scene.displacement("d", "z", at=(0.5, 0, 0))
    scene.actuate(terms=0.5 * near - far, name="sum")
    return joint_bodies(ksd.compile_scene(scene), find_record)


def equations(bodies, theta, target=None):
    """Residual, Jacobian, twists of all links, their poses, poses of all joints."""
    x, R, _, _, angle = bodies.reduced_rest.copy()
    pose = np.zeros((len(bodies.kinematics.node), 24))
    target = np.zeros(len(bodies.reduced.terms.start)) if target is None else target
    found = loop_equations_at(
        *bodies.reduced.flat[:2], *bodies.kinematics.flat, theta, target, x, R, angle, pose
    )
    return *found, x, R, pose


def interface(bodies, j, end, x, R):
    """Position and axes of interface A or B of joint j on its link."""
    loops = bodies.kinematics
    node = loops.node[j, end]
    return x[node] + R[node] @ loops.anchor[j, end], R[node] @ loops.frame[j]


def turned(R):
    v = np.empty(3)
    rotation_log(np.ascontiguousarray(R), v)
    return v


def test_links_follow_their_joints(loop, rng):
    """Interfaces B stand where their joints say; where a loop does not close, the residual is the gap."""
    theta = 0.2 * rng.normal(size=8)
    residual, _, _, x, R, pose = equations(loop, theta)
    closing = loop.kinematics.closing.tolist()
    assert len(closing) == 1 and len(loop.kinematics.tree) == 4
    for j, own in enumerate(pose):
        (a, A), (b, B) = (interface(loop, j, end, x, R) for end in range(2))
        gap = np.concatenate([b - a - A @ own[9:12], turned(B @ (A @ own[:9].reshape(3, 3)).T)])
        exact = residual[:6] / ([1.0] * 3 + [loop.reduced.size] * 3) if j in closing else np.zeros(6)
        assert gap == pytest.approx(exact, abs=1e-12)
        assert j not in closing or np.abs(gap).min() > 1e-4


def test_derivatives_of_links_and_equations_are_their_differences(loop, rng):
    """At rest, and where the loop is open: there the rows of its rotation are none of the exact derivative."""
    target = rng.normal(size=7)
    for theta in (np.zeros(8), 0.2 * rng.normal(size=8)):
        residual, J, W, _, R, _ = equations(loop, theta, target)
        rows = np.ones(len(residual), bool)
        rows[3:6] = not theta.any()
        for q in range(8):
            (up, _, _, x1, R1, _), (down, _, _, x2, R2, _) = (
                equations(loop, theta + h * np.eye(8)[q], target) for h in (1e-5, -1e-5)
            )
            assert J[rows, q] == pytest.approx((up - down)[rows] / 2e-5, abs=1e-8)
            for k in range(len(R)):
                shift = np.concatenate([x1[k] - x2[k], turned(R1[k] @ R2[k].T)]) / 2e-5
                assert W[k, q] == pytest.approx(shift, abs=1e-8)
        less = equations(loop, theta)[0] - residual
        # rows of rotations only are multiplied by the length
        scale = np.where([False, False, True, True, True, True, False], loop.reduced.size, 1.0)
        assert less[6:] == pytest.approx(target * scale, abs=1e-12)


def test_loops_are_closed_in_few_steps(rng):
    """And a branch beside them, from afar: every step begins with the Jacobian anew."""
    scene = fourbar()
    far = scene.link("far")
    universal = ksd.UniversalJoint(STEEL, length=0.1, thickness=5e-4, width=0.04)
    scene.join("top", far, universal, at=(0.3, 0.3, 0), axis="z", toward="x", name="first")
    for axis in "yz":
        scene.actuate_joint("first", motion=f"about_{axis}", name=axis)
    bodies = joint_bodies(ksd.compile_scene(scene), find_record)
    rest = bodies.reduced_rest
    for size, most in ((0.0, 5), (0.1, 6)):
        theta, pose = size * rng.normal(size=6), np.zeros((len(bodies.kinematics.node), 24))
        (x, R, _, _, angle), target = rest.copy(), np.array([0.05, 0.2, -0.1])
        reason, iterations, gap = close_loops(
            *bodies.reduced.flat[:2], *bodies.kinematics.flat, theta, target, x, R, angle, pose
        )
        residual = equations(bodies, theta, target)[0]
        assert reason == 0 and iterations <= most
        assert gap == np.abs(residual).max() < 1e-9


def test_a_motion_in_the_plane_is_one_in_space(rng):
    """Two motions at once, into an array that held a pose out of the plane."""
    for motions in (1, 2):
        f, pose = rng.normal(size=(3, 6)), rng.normal(size=(2, 24))
        f[:, [0, 1, 5]] = 0.0
        pose[:, 12 + 6 * motions :] = 0.0
        assert _set_planar_pose(f, 0.7, motions, pose, 0)
        _set_spatial_pose(f, 0.7, motions, pose, 1)
        assert pose[0] == pytest.approx(pose[1], abs=1e-14)
        for k in range(1 + motions):
            for c in (0, 1, 5):
                off = f.copy()
                off[k, c] = 1e-200
                assert not _set_planar_pose(off, 0.7, motions, pose, 0)


def test_intended_motions_are_those_nearest_to_a_pose(loop, rng):
    """Found exactly where joints move as intended only; what else they do is left, and told."""
    theta = 0.2 * rng.normal(size=8)
    _, _, _, x, R, pose = equations(loop, theta)
    loops, joints = loop.kinematics, len(pose)
    relative, series = np.zeros((joints, 12)), np.zeros((3, loops.pose.shape[2]))
    x = x + 1e-4 * rng.normal(size=x.shape)
    R = np.array([Rotation.from_rotvec(1e-3 * rng.normal(size=3)).as_matrix() @ turn for turn in R])
    relative_poses(*loops.flat, x, R, relative)
    for j in range(joints):
        (a, A), (b, B) = (interface(loop, j, end, x, R) for end in range(2))
        assert relative[j, :3] == pytest.approx(A.T @ (b - a), abs=1e-14)
        assert relative[j, 3:] == pytest.approx((A.T @ B).ravel(), abs=1e-14)
    found, left, known = np.zeros(8), np.zeros((joints, 6)), np.zeros(joints, np.int64)
    intended_motions(*loops.flat, relative, found, pose, series, left, known)
    assert known.tolist() == [1] * joints
    exact = places(loops, found)
    for j, (own, given) in enumerate(zip(exact, relative, strict=True)):
        off = turned(given[3:].reshape(3, 3) @ own[:9].reshape(3, 3).T)
        assert left[j] == pytest.approx(np.concatenate([given[:3] - own[9:12], off]), abs=1e-10)
        motions = loops.first[j + 1] - loops.first[j]
        spins = own[12:].reshape(2, 6)[:motions, 3:]
        assert np.abs(spins @ left[j, 3:]).max() < 1e-8 * np.linalg.norm(left[j, 3:])
    exactly = np.column_stack([exact[:, 9:12], exact[:, :9]])
    again = np.zeros(8)
    intended_motions(*loops.flat, exactly, again, pose, series, left, known)
    assert again == pytest.approx(found, abs=1e-12)
    assert left == pytest.approx(0.0, abs=1e-12)


def test_drive_forces_are_those_of_virtual_work(rng):
    """Two joints in a row under any wrenches, loads of every kind: the drives do the work of all the rest, three of them the
    least."""
    scene = ksd.Mechanism("row")
    scene.links("a", "b")
    scene.join(scene.ground, "a", cross_flexure(), at=(0, 0.1, 0), axis=(0.6, 0, 0.8), toward="y")
    scene.join("b", "a", cross_flexure(), at=(0.3, 0.2, 0), axis="z", toward=(0.6, 0.8, 0))
    scene.actuate("b", along="y", at=(0.4, 0.3, 0.1), name="stroke")
    scene.actuate("a", about="z", relative_to="b", name="turn")
    scene.actuate("b", about="x", name="once more")
    scene.load("a", force=(1.0, -2.0, 3.0), at=(0.2, 0.1, -0.1))
    scene.load("b", force=(-1.0, 1.5, 0.5), moment=(0.3, -0.2, 0.1), at=(0.3, 0.1, 0.2), following=True)
    scene.load("b", moment=(0.1, 0.4, -0.3))
    bodies, theta, h = joint_bodies(ksd.compile_scene(scene), find_record), np.array([0.3, -0.2]), 1e-6
    _residual, _, _, x, R, pose = equations(bodies, theta)
    wrench, mu, loads = rng.normal(size=(2, 54)), np.zeros(3), bodies.reduced.loads
    drive_forces(
        *bodies.reduced.flat[:2], *bodies.kinematics.flat, theta, np.zeros(3), x.copy(), R.copy(),
        bodies.reduced_rest.angle.copy(), pose.copy(), wrench.ravel(), mu,
    )  # fmt: skip
    work, rows = np.zeros(2), np.zeros((3, 2))
    for q in range(2):
        (up, _, _, x1, R1, P1), (down, _, _, x2, R2, P2) = (
            equations(bodies, theta + s * np.eye(2)[q]) for s in (h, -h)
        )
        rows[:, q] = (up - down) / (2 * h)
        for j in range(2):
            turn = turned(P1[j, :9].reshape(3, 3) @ P2[j, :9].reshape(3, 3).T)
            work[q] += wrench[j, 12:18] @ np.concatenate([P1[j, 9:12] - P2[j, 9:12], turn]) / (2 * h)
        for n, p, f, m, follows in zip(
            loads.node, loads.point, loads.force, loads.moment, loads.following, strict=True
        ):
            f, m = (R[n] @ f, R[n] @ m) if follows else (f, m)
            moved = (x1 - x2)[n] + (R1[n] - R2[n]) @ p
            work[q] -= (f @ moved + m @ turned(R1[n] @ R2[n].T)) / (2 * h)
    assert mu == pytest.approx(
        -work @ np.linalg.pinv(rows) * [1.0, bodies.reduced.size, bodies.reduced.size], rel=1e-6
    )


def test_drive_forces_that_nothing_determines_are_not_numbers():
    """Two motions, one drive, and no wrench that could tell them apart."""
    scene = ksd.Mechanism("row")
    scene.links("a", "b")
    scene.join(scene.ground, "a", cross_flexure(), at=(0, 0.1, 0), axis="z", toward="y")
    scene.join("a", "b", cross_flexure(), at=(0.3, 0.2, 0), axis="z", toward="x")
    scene.actuate("b", along="y", at=(0.4, 0.3, 0.1), name="stroke")
    bodies, theta, mu = joint_bodies(ksd.compile_scene(scene), find_record), np.zeros(2), np.zeros(1)
    _, _, _, x, R, pose = equations(bodies, theta)
    drive_forces(
        *bodies.reduced.flat[:2], *bodies.kinematics.flat, theta, np.zeros(1), x, R, bodies.reduced_rest.angle.copy(), pose,
        np.zeros(108), mu,
    )  # fmt: skip
    assert np.isnan(mu).all()


def two_motions(turns, shifts):
    """A joint whose rotation vector and chord are linear in its two motions, with the rows of turns and shifts (2, 3)."""
    coefficients = np.zeros((1, 6, 3))
    coefficients[0, :3, 1:], coefficients[0, 3:, 1:] = np.array(turns)[::-1].T, np.array(shifts)[::-1].T
    return JointKinematics(
        node=np.array([[0, 1]]), anchor=np.zeros((1, 2, 3)), frame=np.eye(3)[None], length=np.array([0.5]),
        first=np.array([0, 2]), tree=np.array([[0, 1]]), closing=np.zeros(0, np.int64), power_first=np.array([0, 3]),
        power=np.array([[0, 0], [0, 1], [1, 0]]), pose=coefficients,
    )  # fmt: skip


@pytest.mark.parametrize("turning", [True, False])
def test_intended_motions_that_are_much_alike_are_told_apart(turning):
    """With axes of motion a quarter of a radian apart; motions of no effect are unknown, and stay as they were."""
    near = np.array([[0.6, 0.0, 0.8], [0.4, 0.1, 0.9]])
    loops = two_motions(near if turning else 1e-3 * near, 0.1 * near[::-1] if turning else near)
    assert places(loops, np.zeros(2)).shape == (1, 24)
    theta, series = np.array([0.3, -0.4]), np.zeros((3, 3))
    given, pose = places(loops, theta)[0], np.zeros((1, 24))
    relative, found = np.concatenate([given[9:12], given[:9]])[None], np.zeros(2)
    left, known = np.zeros((1, 6)), np.zeros(1, np.int64)
    intended_motions(*loops.flat, relative, found, pose, series, left, known)
    assert known.tolist() == [1]
    assert found == pytest.approx(theta, abs=1e-11)
    for alike in (np.zeros((2, 3)), near[[0, 0]]):
        found = np.array([0.1, 0.2])
        intended_motions(*two_motions(alike, alike).flat, relative, found, pose, series, left, known)
        assert known.tolist() == [0]
        assert found.tolist() == [0.1, 0.2]


def test_blocks_and_weights_of_joints_in_the_mechanism(rng):
    """Internal blocks go along with A, gravity is seen from there, and weight acts at the centre of mass of the leaves."""
    scene = slider(axis=(0.6, 0, 0.8), toward="y")
    scene.gravity = (1.0, -9.81, 2.0)
    bodies = joint_bodies(ksd.compile_scene(scene, with_="gravity"), find_record)
    loops, interior, K = bodies.kinematics, bodies.interior, len(bodies.full_node)
    assert K == 1 and interior.block_joint.tolist() == [1]
    _, _, _, x, R, _ = equations(bodies, np.array([0.2, -0.3]))
    size = len(bodies.substructure_rest.x)
    block_x, block_R = rng.normal(size=(size, 3)), Rotation.random(size, random_state=1).as_matrix()
    full = len(x) + K
    far, axes = np.concatenate([x, np.zeros((K, 3))]), np.concatenate([R, np.zeros((K, 3, 3))])
    nodes = np.arange(len(x), full)
    counted = rng.normal(size=(full, 3))
    place_internal_blocks(*loops.flat, interior.flat.ints, nodes, block_x, block_R, far, axes, counted)
    for k, (j, b) in enumerate(zip(interior.block_joint, interior.block_node, strict=True)):
        a, A = interface(bodies, j, 0, x, R)
        assert far[nodes[k]] == pytest.approx(a + A @ block_x[b], abs=1e-14)
        assert axes[nodes[k]] == pytest.approx(A @ block_R[b] @ loops.frame[j].T, abs=1e-14)
        assert np.all(counted[nodes[k]] == counted[loops.node[j, 0]])
    weights, given = bodies.joint_weights, bodies.substructures.weight
    seen = given.copy()
    gravity_in_joint_axes(weights.owner, loops.node, R, loops.frame, given, seen)
    assert seen[:, 0].tolist() == given[:, 0].tolist()
    for i, j in enumerate(weights.owner):
        assert seen[i, 1:4] == pytest.approx(interface(bodies, j, 0, x, R)[1].T @ given[i, 1:4], abs=1e-13)
    members, m, anchor = bodies.substructures.members, len(weights.owner), rng.normal(size=(2, 2, 3))
    load, point = np.array([1, 0]), np.zeros((2, 3))
    pose, store = rng.normal(size=(m, 18)), rng.normal(size=int(members.store_at[-1]))
    place_joint_weights(
        weights.owner,
        load,
        members.node,
        members.store_at,
        block_x,
        pose,
        store,
        seen,
        anchor,
        loops.frame,
        point,
    )
    for j in range(2):
        total, mass = np.zeros(3), 0.0
        for i in np.flatnonzero((weights.owner == j) & (seen[:, 0] > 0)):
            start = block_x[members.node[i, 0]] + pose[i, 9:12] - pose[i, 15:18]
            first = store[members.store_at[i + 1] - GRAVITY_BLOCK_SIZE + 3 :][:3]
            mass, total = mass + seen[i, 0], total + seen[i, 0] * start + pose[i, :9].reshape(3, 3) @ first
        assert point[load[j]] == pytest.approx(anchor[j, 0] + loops.frame[j] @ total / mass)
    assert (weights.load >= 0).tolist() == [False, True]
    untouched = np.ones((1, 3))
    place_joint_weights(
        weights.owner, np.array([-1, 0]), members.node, members.store_at, block_x, pose, store, seen, anchor,
        loops.frame, untouched,
    )  # fmt: skip
    assert untouched[0].tolist() == point[0].tolist()
