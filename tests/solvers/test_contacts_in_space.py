"""Contact in space against exact rods by shooting and finite elements (section F of the acceptance numbers)."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import ksd

STEEL = ksd.Material(E=200e9, G=200e9 / 2.6)


def beam_under_a_body(at):
    """A leaf spring along x whose tip gets a surface, and a driven body: the mechanism and both."""
    scene = ksd.Mechanism("pad")
    tip, body = scene.links("tip", "object")
    section = ksd.rectangle(0.5e-3, 0.01)
    scene.leaf(
        "ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), section=section, material=STEEL, width_axis="z"
    )
    for along in "xyz":
        scene.actuate(body, along=along, at=at, name=along)
        scene.support(body, about=along)
    return scene, tip, body


def pad(shape, at, *, friction=0.0):
    """A leaf spring along x with a rigid plane on its tip, 1 mm above its centreline, under a driven body."""
    scene, tip, body = beam_under_a_body(at)
    face = scene.surface(tip, ksd.shapes.wall(), at=(0.1, 1e-3, 0), axis="y")
    scene.contact(face, scene.surface(body, shape, at=at), friction=friction, name="c")
    return scene


VERTEX = 0.1 + 17.667161e-3, 1e-3, 1.468316e-3
"""The lowest vertex of a turned box of 40 x 20 x 30 mm over the tip, which touches the pad."""


@pytest.mark.parametrize(
    ("shape", "at", "down", "N", "force", "place"),
    [
        (ksd.shapes.ball(0.02), (0.1, 0.021, 0), 0.01, 0.661870, (0.0992995, 0.654379, 0), (0.0969994, -0.0087736, 0)),
        (
            ksd.shapes.ball(0.02), (0.1, 0.021, 0.004), 0.01, 0.659604, (0.0986409, 0.652164, 0.00538642),
            (0.0970091, -0.0087744, 0.0038367),
        ),
        (ksd.shapes.point(), VERTEX, 0.008, 0.306426, (0.0305391, 0.304900, 0.00044428), (0.1176672, -0.007, 0.0014683)),
    ],
)  # fmt: skip
def test_a_body_pressed_on_a_pad(shape, at, down, N, force, place):
    pose = ksd.solve(pad(shape, at), x=0.0, y=-down, z=0.0)
    found = pose.contacts["c"]
    assert pytest.approx(N, rel=1e-5) == found.N
    assert found.force == pytest.approx(force, rel=1e-4, abs=1e-7)
    assert found.place == pytest.approx(place, abs=1e-7)
    assert pose.steps[0].iterations <= 5


def test_a_ball_that_slides_over_a_pad_with_friction():
    """Slip is first order in the steps: the transverse force is 1 % off with 10 of them, the others are right."""
    scene = pad(ksd.shapes.ball(0.02), (0.1, 0.021, -0.002), friction=0.3)
    found = ksd.walk(scene, [{"x": 0.0, "y": -0.005, "z": 0.006}], steps=10)[-1].contacts["c"]
    assert found.state == "slip" and pytest.approx(0.321231, rel=1e-4) == found.N
    assert np.linalg.norm(found.T) == pytest.approx(0.3 * found.N, rel=1e-9)
    assert np.linalg.norm(found.force) == pytest.approx(
        np.linalg.norm((0.0204702, 0.320981, -0.0950185)), rel=1e-4
    )
    assert found.force == pytest.approx((0.0204702, 0.320981, -0.0950185), abs=0.012 * 0.0204702 + 1e-5)
    assert found.place == pytest.approx((0.0985019, -0.0039437, 0.0039202), abs=1e-6)


def pressed(shape, *, axis=None, toward=None, below=None, height=0.021):
    """Contacts of a shape at 21 mm over the tip, pressed down by 10 mm on the pad or a shape in its place."""
    at = (0.1, height, 0.0)
    scene, tip, body = beam_under_a_body(at)
    if below is None:
        face = scene.surface(tip, ksd.shapes.wall(), at=(0.1, 1e-3, 0), axis="y")
    else:
        face = scene.surface(tip, below[0], at=below[1])
    scene.contact(face, scene.surface(body, shape, at=at, axis=axis, toward=toward), name="c")
    return scene, ksd.solve(scene, x=0.0, y=-0.01, z=0.0)


BALL = ksd.shapes.ball(0.02)
ALIKE = {
    "ellipsoid": ({"shape": ksd.shapes.ellipsoid(0.02, 0.02, 0.02)}, BALL),
    "standing capsule": ({"shape": ksd.shapes.capsule(0.01, 0.02), "axis": "y"}, ksd.shapes.ball(0.01)),
    "on a box": ({"shape": BALL, "below": (ksd.shapes.box(0.05, 0.002, 0.02), (0.1, 0, 0))}, BALL),
    "on a capsule": (
        {"shape": ksd.shapes.point(), "below": (ksd.shapes.capsule(0.02, 0.03), (0.1, -0.019, 0))},
        None,
    ),
}


@pytest.mark.parametrize("name", ALIKE)
def test_bodies_push_as_balls_where_they_touch_alike(name):
    words, ball = ALIKE[name]
    height = 0.001 if ball is None else 0.021
    _, pose = pressed(**words, height=height)
    # a point on a capsule across is one on a ball
    other = pressed(ball, height=0.001 + ball.sizes[0])[1] if ball else pressed(
        ksd.shapes.point(), below=(BALL, (0.1, -0.019, 0)), height=height)[1]  # fmt: skip
    found, (same,) = [c for c in pose.contacts.values() if c.N], other.contacts.values()
    assert len(found) == 1 and found[0].force == pytest.approx(same.force, rel=1e-9, abs=1e-12)
    assert found[0].place == pytest.approx(same.place, abs=1e-11)


def test_a_turned_box_stands_on_its_lowest_corner(tmp_path):
    """Row of the table, of which the place of that corner from the centre is known."""
    corner, low = np.array((0.02, -0.01, 0.015)), np.array((17.667161e-3, -20.266116e-3, 1.468316e-3))
    low *= np.linalg.norm(corner) / np.linalg.norm(low)
    turn, _ = Rotation.align_vectors([low], [corner])
    axes, height = turn.as_matrix(), 1e-3 - low[1]
    box = ksd.shapes.box(0.04, 0.02, 0.03)
    scene, pose = pressed(box, axis=axes[:, 2], toward=axes[:, 0], height=height)
    pose = ksd.solve(scene, x=0.0, y=-0.008, z=0.0)
    (found,) = (c for c in pose.contacts.values() if c.N > 0.0)
    assert pytest.approx(0.306426, rel=1e-5) == found.N
    assert found.place == pytest.approx((0.1176672, -0.007, 0.0014683), abs=1e-7)
    assert {line.get_gid() for line in pose.plot().axes[0].lines} >= {"surface"}
    # the same body by its corners, one of them inside
    body = ksd.shapes.polyhedron([*box.tips, (0.0, 0.0, 0.001)])
    other, _ = pressed(body, axis=axes[:, 2], toward=axes[:, 0], height=height)
    same = ksd.solve(other, x=0.0, y=-0.008, z=0.0)
    (again,) = (c for c in same.contacts.values() if c.N > 0.0)
    assert (again.N, *again.place) == pytest.approx((found.N, *found.place), rel=1e-12)
    assert {line.get_gid() for line in same.plot().axes[0].lines} >= {"surface"}
    for name, shape in (
        ("stone", ksd.shapes.polyhedron([(0, 0, 0), (1e-3, 0, 0), (0, 2e-3, 0), (0, 0, 3e-3)])),
        ("egg", ksd.shapes.ellipsoid(1e-3, 2e-3, 3e-3)),
        ("pill", ksd.shapes.capsule(1e-3, 2e-3)),
    ):
        scene.surface("object", shape, at=(0.1, 0.1, 0), name=name)
    ksd.save_scene(scene, tmp_path / "s.toml")
    again, _, _ = ksd.load_scene(tmp_path / "s.toml")
    assert again.scene() == scene.scene()


def test_a_polyhedron_has_a_volume_and_touches_walls_only():
    with pytest.raises(ksd.SceneError, match="at least four points"):
        ksd.shapes.polyhedron([(0, 0, 0), (1, 0, 0), (0, 1, 0)])
    with pytest.raises(ksd.SceneError, match="enclose no volume"):
        ksd.shapes.polyhedron([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)])
    body = ksd.shapes.polyhedron([(0, 0, 0), (1e-3, 0, 0), (0, 2e-3, 0), (0, 0, 3e-3)])
    with pytest.raises(ksd.SceneError, match="a polyhedron touches walls only, and no ball"):
        pressed(BALL, below=(body, (0.1, 0, 0)))
    with pytest.raises(ksd.SceneError, match="no other polyhedron"):
        pressed(body, below=(body, (0.1, 0, 0)))


def test_how_bodies_touch_is_not_known_to_small_motions():
    _, pose = pressed(BALL, below=(ksd.shapes.box(0.05, 0.002, 0.02), (0.1, 0, 0)))
    with pytest.raises(ksd.SceneError, match="a box, capsule or ellipsoid is touched here"):
        pose.stiffness("tip")
    scene = ksd.Mechanism("m")
    one, two = (scene.surface(scene.link(n), ksd.shapes.box(1e-3, 1e-3, 1e-3), at=(0, 0, 0)) for n in "ab")
    with pytest.raises(ksd.SceneError, match="a box and a box are not known to touch"):
        scene.contact(one, two)
    with pytest.raises(ksd.SceneError, match="box: y = -1 m must be positive"):
        ksd.shapes.box(1, -1, 1)
