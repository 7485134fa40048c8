"""The chains of the substructures, linearised about their element orientations, are those of each on its own."""

import numpy as np
import pytest
from scenes import fourbar

import ksd
from ksd.elements.corotational import recover
from ksd.elements.corotational_linearised import condense_linearised
from ksd.elements.ends import member_pose
from ksd.model.newton import assemble, take_step
from ksd.solvers.five_steps import set_linearisation_point
from ksd.units import GPa, deg, mm


def hinge(**more):
    """One joint of three leaf springs, the outer two of them in the same state."""
    scene = ksd.Mechanism("hinge")
    tip = scene.link("tip")
    steel = ksd.Material(E=200 * GPa, G=76.9 * GPa, density=7800)
    joint = ksd.CrossFlexure(
        steel, length=100 * mm, angle=45 * deg, thickness=1 * mm, widths=(40 * mm, 20 * mm)
    )
    placed = scene.join(scene.ground, tip, joint, at=(0, 0, 0), axis="z", toward="x")
    scene.actuate_joint(placed, name="turn")
    for name, value in more.items():
        setattr(scene, name, value)
    return scene


def storage(scene, elements, **drives):
    """Storage of a reduced solve, near its pose."""
    steps = ksd.prepare(scene, mesh=ksd.Mesh("corotational", elements=elements), planar=False)
    steps(method="reduced", estimate=False, **drives)
    return steps.five_steps.storage


@pytest.mark.parametrize(
    ("scene", "elements", "drives"),
    [(hinge, 1, {"turn": 0.4}), (hinge, 3, {"turn": -0.5}), (fourbar, 5, {"top": 0.25})],
)
def test_wrenches_and_inner_nodes_are_those_of_each(scene, elements, drives, rng):
    b = storage(scene(), elements, **drives)
    given, state, work = b.bodies.substructures, b.substructure_state, b.substructure_work
    members = given.members
    state.assign(b.bodies.substructure_rest)
    set_linearisation_point(b)
    assemble(given, state, np.zeros(0), 1.0, work, 1e-8, 1, 10.0)
    alone, kept = [], []
    pose, Q = np.zeros(18), np.zeros((3, 3))
    scratch = np.empty((6, 6)), np.empty((6, 12))
    for i in range(len(members.kind)):
        offset, frame = members.offset[i].ravel(), members.frame[i].ravel()
        member_pose(members.node[i], 0, offset, 0, frame, 0, state.x, state.R, pose, Q)
        d = pose[:9].reshape(3, 3).T @ pose[15:]
        inner = np.zeros(members.inner_at[i + 1] - members.inner_at[i])
        store = np.zeros(members.store_at[i + 1] - members.store_at[i])
        value, number = members.value[members.value_at[i] :], members.number[i]
        lam, K = np.zeros(12), np.zeros((6, 6))
        near = work.linearisation[work.linearisation_at[i] : work.linearisation_at[i + 1]]
        assert condense_linearised(value, number, inner, store, near, d, Q, lam, K, *scratch)[3] == 0
        assert work.lam[i] == pytest.approx(lam, rel=1e-8, abs=1e-9 * np.abs(work.lam).max())
        alone.append((value, number, inner, store))
        kept.append(pose.copy())
    step = 1e-4 * rng.normal(size=given.plan.unknowns)
    take_step(given, state, step, work, 0.5)
    for i, (value, number, inner, store) in enumerate(alone):
        # interface A is ground; the step of end q about it, in frame p
        u = given.start[members.node[i, 1]]
        v = given.start[members.node[i, 0]]
        frame = kept[i][:9].reshape(3, 3)
        at_b = step[u : u + 6] if u >= 0 else np.zeros(6)
        at_a = step[v : v + 6] if v >= 0 else np.zeros(6)
        moved = at_b[:3] - at_a[:3] + np.cross(at_b[3:], kept[i][12:15]) - np.cross(at_a[3:], kept[i][9:12])
        xi = np.concatenate([frame.T @ moved, frame.T @ (at_b[3:] - at_a[3:])])
        recover(value, number, inner, store, xi, 0.5)
        mine = state.inner[members.inner_at[i] : members.inner_at[i + 1]]
        assert mine == pytest.approx(inner, rel=1e-7, abs=1e-8 * np.abs(inner).max(initial=1e-6))


def test_weight_goes_with_them():
    """The reduced answer with weight next to the full one, as without."""
    heavy = hinge(gravity=(0, -9.81, 0))
    mesh = ksd.Mesh("corotational", elements=3)
    full = ksd.solve(heavy, turn=0.3, method="full", mesh=mesh, accuracy=1e-3)
    reduced = ksd.solve(heavy, turn=0.3, method="reduced", mesh=mesh, strict=False, accuracy=1e-3)
    assert reduced.forces["turn"] == pytest.approx(full.forces["turn"], rel=5e-3)
