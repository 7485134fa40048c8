"""More than half a turn: counted along the path of a solve, and asked for where a solve would have to guess."""

import copy
import math
import pickle

import numpy as np
import pytest
from scenes import STEEL

import ksd
from ksd.answers.tangent import stored_matrix
from ksd.answers.uncondensed import _with_relaxed_springs
from ksd.model import compile as compiled
from ksd.model.arrays import State, make_workspace
from ksd.model.newton import assemble, move_nodes
from ksd.model.turns import counted_rotation, node_rotations
from ksd.units import deg


def pinned(plane="xy", *, axis="z", rest_angle=0.0, drive=True, k=0.01):
    """A link on a pin with a torsion spring to ground."""
    scene = ksd.Mechanism("crank", plane=plane)
    crank = scene.link("crank")
    scene.pin(scene.ground, crank, at=(0, 0, 0), **({} if plane else {"axis": axis}))
    scene.turn_spring(scene.ground, crank, at=(0, 0, 0), axis=axis, stiffness=k, rest_angle=rest_angle)
    if drive:
        scene.actuate(crank, about=axis, name="turn")
    return scene


def test_a_spring_between_links_that_part_by_more_than_half_a_turn():
    """200 degrees between the links: the moment had the sign of -160."""
    scene = ksd.Mechanism("two cranks", plane="xy")
    for name in scene.links("one", "other"):
        scene.pin(scene.ground, name, at=(0, 0, 0))
        scene.actuate(name, about="z", name=f"{name.name} turn")
    scene.turn_spring("one", "other", at=(0, 0, 0), axis="z", stiffness=0.01, rest_angle=-420 * deg)
    pose = ksd.solve(scene, {"one turn": -100 * deg, "other turn": 100 * deg})
    moment = 0.01 * 620 * deg
    assert pose.trusted and not pose.warnings
    assert list(pose.forces.values()) == pytest.approx([-moment, moment], rel=1e-12)
    assert sum(pose.strain_energy().values()) == pytest.approx(0.5 * moment * 620 * deg, rel=1e-12)
    forces = pose.interface_forces()
    assert max(np.abs(f.moment[2]) for f in forces.rows if "spring" in f.name) == pytest.approx(
        moment, rel=1e-12
    )
    # the same moments from poses alone
    needed = ksd.required_loads(scene, {n: pose.links[n] for n in ("one", "other")}, method="constant")
    assert needed.forces == pytest.approx(dict(pose.forces), rel=1e-9)
    assert (
        len(needed.warnings) == 1
        and "as turned by 200 deg" in needed.warnings[0]
        and "-160 deg" in needed.warnings[0]
    )


@pytest.mark.parametrize("axis", ["z", (1.0, 2.0, -2.0)])
def test_a_drive_turns_on_where_its_path_is_followed(axis):
    scene, unit = pinned(None, axis=axis, rest_angle=400 * deg), np.array([0, 0, 1.0])
    if axis != "z":
        unit = np.array(axis) / 3.0
    with pytest.raises(
        ksd.SceneError, match="'turn' = 270 deg: a single solve that starts at rest would have to guess"
    ):
        ksd.solve(scene, turn=270 * deg)
    angles = np.array([0, 90, 180, 270, 360, 200, 20, -160, -340]) * deg
    for method in (None, "conventional"):
        table = ksd.sweep(scene, turn=angles, method=method, questions=("force",), progress=False)
        assert set(table["status"]) == {"ok"} and set(table["warnings"]) == {""}
        assert table["turn_moment_Nm"] == pytest.approx(0.01 * (angles - 400 * deg), abs=1e-14)
    path = ksd.follow(scene, control="drives", turn=540 * deg)
    assert path.ended
    pose = pickle.loads(pickle.dumps(path.states[-1]))
    assert pose.rotation("crank") == pytest.approx(540 * deg * unit, abs=1e-9)
    onward = ksd.solve(scene, start=pose, turn=700 * deg)
    assert onward.trusted and onward.forces["turn"] == pytest.approx(0.01 * 300 * deg, rel=1e-12)
    assert onward.rotation("crank") == pytest.approx(700 * deg * unit, abs=1e-9)
    with pytest.raises(ksd.SceneError, match=r"starts at 700 deg would have to guess"):
        ksd.solve(scene, start=onward, turn=900 * deg)


def test_a_row_too_far_from_the_one_before_says_so():
    table = ksd.sweep(pinned(), turn=np.array([0, 170, 400]) * deg, questions=("force",), progress=False)
    assert table["status"][:2] == ["ok", "ok"] and "starts at 170 deg" in table["status"][2]


def test_turns_are_counted_beside_reduced_bodies_and_from_a_start():
    """Where another part is a modal body, or of constant stiffness, too, and on from a pose that has turned."""
    scene = pinned(None, rest_angle=-200 * deg)
    tip = scene.link("tip")
    section = ksd.rectangle(5e-4, 0.01)
    scene.leaf("ground", tip, start=(0.1, 0, 0), end=(0.2, 0, 0), section=section, material=STEEL)
    scene.load(tip, force=(0, 0.5, 0), at=(0.2, 0, 0))
    pose = ksd.solve(scene, turn=160 * deg, method="modal", basis=ksd.ModalBasis())
    assert pose.forces["turn"] == pytest.approx(0.01 * 360 * deg, rel=1e-9)
    with pytest.raises(ksd.SceneError, match="load steps of reduced bodies begin at rest"):
        ksd.solve(scene, turn=330 * deg, method="modal", basis=ksd.ModalBasis(), start=pose)
    for method in ("conventional", "constant"):
        before = ksd.solve(scene, turn=160 * deg, method=method)
        pose = ksd.solve(scene, turn=330 * deg, start=before, method=method)
        assert pose.forces["turn"] == pytest.approx(0.01 * 530 * deg, rel=1e-9)


def test_a_start_is_a_pose_of_the_mechanism():
    pose = ksd.solve(pinned(), turn=0.1)
    other = pinned(drive=False)
    with pytest.raises(
        ksd.SceneError, match=r"this pose of 'crank' by conventional, .* is not one of 'crank'"
    ):
        ksd.solve(other, start=pose)
    with pytest.raises(ksd.SceneError, match="not one of 'crank'"):
        ksd.follow(other, start=pose)
    with pytest.raises(ksd.SceneError, match=r"start = 0\.3: give a pose"):
        ksd.solve(pinned(), start=0.3, turn=0.1)


def test_a_moment_turns_by_several_turns_in_one_solve():
    """The one step of Newton turns too far to be sure of its way: smaller ones confirm it."""
    scene = pinned(drive=False, rest_angle=-90 * deg)
    scene.load("crank", moment=(0, 0, 0.01 * 800 * deg))
    pose = ksd.solve(scene)
    assert pose.trusted and "smaller steps: a load step turned a torsion spring" in pose.steps[-1].note
    assert pose.rotation("crank")[2] == pytest.approx(710 * deg, rel=1e-12)


def test_drives_of_a_point_lead_a_crank_round():
    """Its angle is none of the drive values, and they come back to where they were."""
    scene, r, k = pinned(drive=False, k=0.7), 0.1, 0.7
    block = scene.link("block")
    scene.slider(block, relative_to="crank", at=(r, 0, 0), along="x")
    for axis in "xy":
        scene.actuate(block, along=axis, at=(r, 0, 0), name=axis)
    angles = np.linspace(0.0, 700.0, 36) * deg
    x, y = r * np.cos(angles) - r, r * np.sin(angles)
    table = ksd.sweep(scene, x=x, y=y, together=True, questions=("force",), progress=False)
    assert set(table["status"]) == {"ok"}
    assert table["y_force_N"] == pytest.approx(k * angles / r * np.cos(angles), abs=1e-9)
    assert table["x_force_N"] == pytest.approx(-k * angles / r * np.sin(angles), abs=1e-9)


def test_a_pin_in_space_carries_a_moment_at_any_angle():
    """A force along the axis of the pin on the arm of a crank; held rotations were mixed at large angles."""
    for angle in (40 * deg, 130 * deg, 180 * deg):
        scene = pinned(None)
        scene.load("crank", force=(0, 0, 2.0), at=(0.3, 0, 0))
        pose = ksd.solve(scene, turn=angle)
        arm = 0.3 * np.array([math.cos(angle), math.sin(angle), 0.0])
        hinge = next(
            f for f in pose.interface_forces().rows if f.name == "ground-crank" and f.link == "crank"
        )
        assert hinge.force == pytest.approx([0, 0, -2.0], abs=1e-9)
        assert hinge.moment == pytest.approx(-np.cross(arm, [0, 0, 2.0]), abs=1e-9)


def test_the_tangent_of_an_alignment_is_its_derivative(rng):
    scene = ksd.Mechanism("pins")
    a, b = scene.links("a", "b")
    scene.pin(scene.ground, a, at=(0.1, 0, 0), axis=(1, 2, 3))
    scene.pin(a, b, at=(0.3, 0.1, 0), axis=(-1, 0.5, 1))
    model = ksd.compile_scene(scene)
    arrays, motion, work = model.arrays, model.rest.copy(), make_workspace(model.arrays)
    move_nodes(arrays, motion, 0.8 * rng.normal(size=arrays.plan.unknowns), 1.0)
    motion.multiplier[:] = rng.normal(size=len(motion.multiplier))
    zero, size = np.zeros(len(motion.multiplier)), arrays.plan.unknowns
    assemble(arrays, motion, zero, 1.0, work)
    K, found = stored_matrix(arrays, work.matrix), np.zeros((size, size))
    for i in range(size):
        sides = []
        for h in (1e-6, -1e-6):
            near = motion.copy()
            move_nodes(arrays, near, h * np.eye(size)[i], 1.0)
            assemble(arrays, near, zero, 1.0, work)
            sides.append(work.rhs.copy())
        found[:, i] = (sides[0] - sides[1]) / 2e-6
    assert np.abs(0.5 * (found + found.T) - K).max() < 1e-8
    rows = arrays.terms.start
    assert np.abs(found[rows] - K[rows]).max() < 1e-8


def test_a_leaf_spring_is_rolled_up_to_a_ring():
    """M = EI turn / L: the path ended at 180 degrees, where the arc was halved to nothing."""
    scene = ksd.Mechanism("leaf")
    tip, section = scene.link("tip"), ksd.section.rectangle(0.5e-3, 0.02)
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), section=section, material=STEEL, width_axis="z"
    )
    scene.actuate(tip, about="z", name="turn")
    path = ksd.follow(scene, turn=-360 * deg, control="drives")
    end = path.states[-1]
    assert path.ended and end.rotation("tip")[2] == pytest.approx(-2 * math.pi, rel=1e-9)
    assert end.forces["turn"] == pytest.approx(-2 * math.pi * STEEL.E * section.Iz / 0.1, rel=1e-9)
    assert end.displacement("tip", at=(0.1, 0, 0)) == pytest.approx([-0.1, 0, 0], abs=1e-9)


def test_the_vector_of_a_rotation_keeps_its_turns():
    """Near a whole turn the matrix tells the axis of what is left only; the count goes on behind it."""
    R, v = np.eye(3), np.zeros(3)
    counted_rotation(R, np.array([0, 0, 4.0 * math.pi + 0.1]), v)
    assert v == pytest.approx([0, 0, 4.0 * math.pi])
    scene = pinned(None, drive=False)
    model = ksd.compile_scene(scene)
    motion = model.rest.copy()
    moved = np.zeros(model.arrays.plan.unknowns)
    for turn in np.linspace(0.0, 4.0 * math.pi, 41)[1:]:
        moved[5] = math.pi / 10.0
        move_nodes(model.arrays, motion, moved, 1.0)
        counted_rotation(motion.R[1], node_rotations(model.arrays, motion)[1], v)
        assert v == pytest.approx([0, 0, turn], abs=1e-9)


def test_a_relaxed_spring_is_at_rest_where_it_is():
    """Buckling by the stresses of the leaf springs alone takes springs without force, turns included."""
    pose = ksd.follow(pinned(), control="drives", turn=500 * deg).states[-1]
    relaxed = _with_relaxed_springs(pose.model, pose.motion)
    assert relaxed.arrays.springs.value[1] == pytest.approx(500 * deg, rel=1e-9)


def _made(kind, *fields):
    """What protocol 2 of pickle does with a class that says nothing."""
    return kind.__new__(kind, *fields)


def test_a_pose_pickled_by_another_version_is_refused_in_one_sentence(monkeypatch):
    """The first release wrote no layout, and states without counted angles."""
    pose = ksd.solve(pinned(None), turn=0.1)
    sentence = "was pickled by another version of ksd.*solve it again"
    assert pickle.loads(pickle.dumps(pose)).forces == copy.deepcopy(pose).forces == pose.forces
    with monkeypatch.context() as other:
        other.setattr(compiled, "_layout", lambda: "0.0.1 x R inner multiplier")
        later = pickle.dumps(pose)
    with pytest.raises(ksd.RecordError, match=sentence):
        pickle.loads(later)

    class FirstState(tuple):
        def __reduce__(self):
            return _made, (State, *self)

    pose.__dict__["motion"] = pose.model.__dict__["rest"] = FirstState(pose.motion[:4])
    monkeypatch.setattr(
        compiled.Model, "__reduce__", lambda self: (_made, (compiled.Model,), {"rest": self.rest})
    )
    first = pickle.dumps(pose)
    with pytest.raises(ksd.RecordError, match=sentence):
        pickle.loads(first)
