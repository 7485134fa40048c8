"""Interface forces against the balance of every link, and parasitic motion and pivot shift against closed forms."""

import numpy as np
import pytest
from effect_scenes import free_beam
from scenes import STEEL, cross_flexure, fourbar, single_joint

import ksd
from ksd.errors import SceneError
from ksd.model.compile import compile_scene
from ksd.model.mesh import Mesh
from ksd.model.springs import energy_of_one_spring
from ksd.numerics.rotations import rotation_exp
from ksd.solvers.conventional import solve_conventional
from ksd.units import deg, mm

PUSH, TORQUE, AT = (30.0, -20.0, 5.0), (0.4, -0.2, 1.5), (0.05, 0.4, 0.02)


def loaded():
    """The fourbar with everything that acts on links: a load, weight, a coil spring and two joint springs."""
    scene = fourbar()
    scene.load("top", force=PUSH, moment=TORQUE, at=AT)
    scene.mass("top", mass=2.0, at=(0.1, 0.4, 0))
    scene.gravity = (0, -9.81, 0)
    scene.spring("ground", "top", start=(0, 0, 0.1), end=(0.05, 0.35, 0), stiffness=200, free_length=0.1)
    scene.joint_spring("lower left", stiffness=0.5)
    scene.joint_spring("upper right", stiffness=2.0)
    return scene


@pytest.mark.parametrize(
    "mesh",
    [Mesh(), Mesh("corotational", elements=3), Mesh("corotational", elements=3, nodal=True)],
    ids=["strain", "chain", "nodal"],
)
def test_every_link_is_in_balance(mesh):
    pose = solve_conventional(compile_scene(loaded(), mesh=mesh, effects="all"), {"top": 0.15}, steps=3)
    found = pose.interface_forces()
    scale = np.linalg.norm(found.on("ground")[:3])
    weights = {"left": np.zeros(6), "right": np.zeros(6), "top": np.zeros(6)}
    top = weights["top"]
    shift = {p: np.asarray(p) + pose.displacement("top", p) for p in (AT, (0.1, 0.4, 0))}
    driven = np.array([0, 0.3 + cross_flexure().length_AB, 0])
    here = driven + pose.displacement("top", driven)
    for place, force in (
        (shift[AT], PUSH),
        (shift[(0.1, 0.4, 0)], (0, -2.0 * 9.81, 0)),
        (here, (pose.forces["top"], 0, 0)),
    ):
        top += np.concatenate([force, np.cross(place, force)])
    top[3:] += TORQUE
    for link, given in weights.items():
        # what the leaf springs weigh is in the interface forces
        assert found.on(link) == pytest.approx(-given, abs=1e-5 * scale)


def test_springs_pull_by_the_gradient_of_their_energy():
    """Central differences, of a coil spring, joint springs that are turned out of their plane too, and a link with a
    matrix."""
    scene, points = loaded(), ((-0.2, 0.3 + 0.1 * np.sqrt(0.5), 0), (0.2, 0.3 + 0.1 * np.sqrt(0.5), 0))
    scene.compliance("top", matrix=ksd.LinkMatrix(points, free_beam(points, 1.0)))
    pose = ksd.solve(scene, top=0.1, method="conventional", with_=("compliance", "spatial"))
    model, motion, found, T = pose.model, pose.motion, pose.interface_forces(), np.empty((3, 3))

    def energy(node, point, step):
        rotation_exp(np.array(step[3:]), T)
        x, R = motion.x.copy(), motion.R.copy()
        x[node], R[node] = point + step[:3] + T @ (x[node] - point), T @ R[node]
        return energy_of_one_spring(model.arrays, motion._replace(x=x, R=R), i)

    assert len(model.spring_names) == 4
    for i, name in enumerate(model.spring_names):
        for node in model.arrays.springs.node[i]:
            row = found.of(name, model.node_names[node])
            slope = np.zeros(6)
            for times, weight in ((1.0, 8.0), (-1.0, -8.0), (2.0, -1.0), (-2.0, 1.0)):
                slope += [weight / 12e-4 * energy(node, row.point, times * s) for s in 1e-4 * np.eye(6)]
            assert np.concatenate([row.force, row.moment]) == pytest.approx(
                -slope, abs=1e-7 * np.abs(slope).max()
            )


def test_ground_takes_what_is_put_in():
    scene = fourbar()
    scene.load("top", force=PUSH, moment=TORQUE, at=AT)
    pose = ksd.solve(scene, top=0.1, method="full")
    found = pose.interface_forces()
    at = np.asarray(AT) + pose.displacement("top", AT)
    force = np.asarray(PUSH) + np.array([pose.forces["top"], 0, 0])
    about = found.on("ground", about=at)
    assert about[:3] == pytest.approx(force, abs=1e-5 * np.linalg.norm(force))
    one = found.of("lower left", "ground")
    other = found.of("lower left", "left")
    assert one.force == pytest.approx(-other.force, abs=1e-5 * np.linalg.norm(force))
    assert "lower left" in str(found) and "on link" in str(found) and "8 interfaces" in repr(found)
    with pytest.raises(
        SceneError, match="'lower left' is not clamped to link 'top'; there are 'lower left' on"
    ):
        found.of("lower left", "top")
    with pytest.raises(SceneError, match="no joint, leaf or spring is clamped to link 'nowhere'; there are"):
        found.on("nowhere")


def test_a_free_leaf_holds_its_load():
    scene = ksd.Mechanism("leaf")
    tip = scene.link("tip")
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), width_axis="z", material=STEEL,
               section=ksd.rectangle(0.5 * mm, 20 * mm), name="blade")  # fmt: skip
    scene.load(tip, force=(0, 2.0, 0), at=(0.1, 0, 0))
    pose = ksd.solve(scene, method="conventional")
    clamp = pose.interface_forces().of("blade", "ground")
    lever = 0.1 + pose.displacement("tip", (0.1, 0, 0))[0]
    assert clamp.force == pytest.approx([0, 2.0, 0], abs=1e-6)
    assert clamp.moment == pytest.approx([0, 0, 2.0 * lever], abs=1e-7)


def test_pivot_shift_of_a_crossed_pivot():
    """Acceptance D: |9 lambda^2 - 9 lambda + 1| theta^2 L / (15 cos alpha), zero at lambda = .12732."""
    turn, length, angle = 0.05, 0.1, 45 * deg
    for ratio in (0.5, 0.2, 0.12732200375):
        joint = ksd.CrossedPivot(
            STEEL, length=length, angle=angle, thickness=0.05 * mm, width=20 * mm, ratio=ratio
        )
        found = solve_conventional(compile_scene(single_joint(joint)), {"turn": turn}, steps=1).pivot_shift(
            "hinge"
        )
        wanted = abs(9 * ratio**2 - 9 * ratio + 1) * turn**2 * length / (15 * np.cos(angle))
        assert found.pivot == pytest.approx([ratio * length * np.cos(angle), 0, 0], abs=1e-12)
        assert np.linalg.norm(found.shift) == pytest.approx(wanted, abs=2e-3 * turn**2 * length)
        assert found.turn == pytest.approx([0, 0, turn], abs=1e-9)
        assert "Pivot shift: 'hinge'" in str(found)


def test_pivot_shift_is_seen_from_the_joint():
    """Turned, moved and between moving links it is the same; and at a point of one's own."""
    scene = fourbar()
    pose = ksd.solve(scene, top=0.2, method="conventional")
    turned = pose.pivot_shift("upper left")
    alone = ksd.solve(single_joint(), turn=turned.turn[2], method="conventional").pivot_shift("hinge")
    # the joints of the fourbar carry forces, which move them a little more
    assert turned.shift == pytest.approx(alone.shift, abs=3e-4)
    end = ksd.solve(single_joint(), turn=0.3, method="conventional")
    at = cross_flexure().pose_B
    assert end.pivot_shift("hinge", at=at).shift == pytest.approx(end.displacement("tip", at), abs=1e-15)


def test_parasitic_motion_is_what_no_drive_prescribes():
    pose = ksd.solve(fourbar(), top=0.2, method="conventional")
    at = (0, 0.3 + cross_flexure().length_AB, 0)
    found = pose.parasitic()
    whole = pose.displacement("top", at)
    assert found.drives == ("top",) and found.link == "top"
    assert found.shift == pytest.approx([0, whole[1], 0], abs=1e-12)
    assert found.turn == pytest.approx(pose.rotation("top"), abs=1e-15)
    assert pose.parasitic("top", at=at).shift == pytest.approx(found.shift, abs=1e-15)
    # the crank is a leg of the coupler that is driven: its turn is commanded, but for what is not linear in the drive
    left, turned = pose.parasitic("left"), pose.rotation("left")
    assert left.drives == ("top",) and abs(left.turn[2]) < 0.07 * abs(turned[2])
    free = ksd.Mechanism("free")
    tip = free.link("tip")
    free.join(free.ground, tip, cross_flexure(), at=(0, 0, 0), axis="z", toward="x")
    free.load(tip, force=(0, 1.0, 0), at=(0.1, 0, 0))
    alone = ksd.solve(free, method="conventional").parasitic("tip")
    assert alone.drives == () and "no drive moves it" in str(alone)
    with pytest.raises(SceneError, match="link 'nowhere' is not part"):
        pose.parasitic("nowhere")
    with pytest.raises(
        SceneError, match="joint 'nowhere' is not part of this mechanism; its joints are lower left"
    ):
        pose.pivot_shift("nowhere")
