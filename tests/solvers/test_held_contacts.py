"""Stiffness, frequencies and stability with contacts held, against differences of solves and against drives."""

import math

import numpy as np
import pytest

import ksd
from ksd.solvers.contact_solve import solve_with_contact
from ksd.units import mm

STEEL = ksd.Material(E=200e9, nu=0.3, density=7800)
BLADE = ksd.rectangle(0.3 * mm, 10 * mm)
AT = (0.0705, 0.0205, 0)
SQUARE = ksd.shapes.polygon([(-6e-3, -6e-3), (6e-3, -5e-3), (5e-3, 6e-3), (-5e-3, 5e-3)])
PAIRS = {
    "disc on wall": (ksd.shapes.wall(), ksd.shapes.disc(6 * mm)),
    "disc on disc": (ksd.shapes.disc(4 * mm), ksd.shapes.disc(6 * mm)),
    "disc on polygon": (ksd.shapes.disc(4 * mm), SQUARE),
    "disc on ellipse": (ksd.shapes.disc(4 * mm), ksd.shapes.ellipse(8 * mm, 5 * mm)),
    "point on disc": (ksd.shapes.disc(4 * mm), ksd.shapes.point()),
    "ellipse on wall": (ksd.shapes.wall(), ksd.shapes.ellipse(8 * mm, 5 * mm)),
}


def pad(which, friction, push=(0.0, 0.0)):
    """A pad on a parallel guide under an object on a leaf spring, pressed on it by 1.5 N and `push` (2,) [N]."""
    own, other = PAIRS[which]
    scene = ksd.Mechanism("pad", plane="xy")
    link, held = scene.links("pad", "object")
    words = {"section": BLADE, "material": STEEL}
    for i, y in enumerate((0, -20 * mm)):
        scene.leaf("ground", link, start=(0, y, 0), end=(0.06, y, 0), name=f"l{i}", **words)
    scene.leaf("ground", held, start=(AT[0] + 0.05, AT[1], 0), end=AT, name="o", **words)
    a = scene.surface(link, own, at=(0.07, 0.01, 0), axis=(0.1, 0.995, 0) if own.kind == "wall" else None)
    toward = None if other.is_ball else (math.cos(0.3), math.sin(0.3), 0)
    scene.contact(a, scene.surface(held, other, at=AT, toward=toward), friction=friction, name="c")
    scene.load(held, force=(push[0], push[1] - 1.5, 0), at=AT)
    return scene


def compliance_by_differences(pose, which, friction, push, *, size=2e-4):
    """Compliance (2, 2) [m/N] of the object by loads that are larger and smaller by `size` [N]."""
    found = np.zeros((2, 2))
    for c, unit in enumerate(np.eye(2)):
        both = []
        for sign in (1, -1):
            model = ksd.Solver(pad(which, friction, np.asarray(push) + sign * size * unit)).model
            other = solve_with_contact(model, {}, {}, start=pose)
            assert [c.state for c in other.contacts.values()] == [c.state for c in pose.contacts.values()]
            both.append(other.displacement("object", AT)[:2])
        found[:, c] = (both[0] - both[1]) / (2 * size)
    return found


@pytest.mark.parametrize("which", PAIRS)
def test_stiffness_with_frictionless_contacts(which):
    pose = ksd.solve(pad(which, 0.0))
    assert {c.normal[1] > 0.9 for c in pose.contacts.values() if c.state == "closed"} == {
        True
    } and pose.stable
    found = pose.stiffness("object", at=AT).compliance[:2, :2]
    other = compliance_by_differences(pose, which, 0.0, (0.0, 0.0))
    assert np.abs(found - other).max() < 1e-7 * np.abs(other).max()
    # contact stiffens: without it the object gives way more
    assert (
        np.linalg.eigvalsh(found).max()
        < np.linalg.eigvalsh(
            ksd.solve(pad(which, 0.0, (0, 1.6))).stiffness("object", at=AT).compliance[:2, :2]
        ).max()
    )


@pytest.mark.parametrize("which", ["disc on wall", "disc on disc", "disc on polygon", "point on disc"])
def test_stiffness_with_contacts_that_stick_and_roll(which):
    slipping, push = ksd.solve(pad(which, 0.9)), -0.1
    model = ksd.Solver(pad(which, 0.9, (push, 0.0))).model
    pose = solve_with_contact(model, {}, {}, start=slipping)
    assert "stick" in {c.state for c in pose.contacts.values()}
    found = pose.stiffness("object", at=AT).compliance[:2, :2]
    other = compliance_by_differences(pose, which, 0.9, (push, 0.0))
    assert np.abs(found - other).max() < 1e-6 * np.abs(other).max()
    # it gives way less than where the same contact slips, so it rings higher
    assert pose.frequencies(count=1).frequency_Hz[0] > slipping.frequencies(count=1).frequency_Hz[0]


def test_what_cannot_be_held_is_refused():
    slipping = ksd.solve(pad("ellipse on wall", 0.9))
    model = ksd.Solver(pad("ellipse on wall", 0.9, (-0.1, 0.0))).model
    pose = solve_with_contact(model, {}, {}, start=slipping)
    with pytest.raises(ksd.SceneError, match="contact 'c' sticks here, and how an ellipse rolls"):
        pose.stiffness("object")
    scene = pad("disc on wall", 0.0)
    scene.stop("object", along="y", at=AT, low=-1 * mm, softness=1e-4, name="soft")
    with pytest.raises(ksd.SceneError, match="stop 'soft' acts here and is soft"):
        ksd.solve(scene).stiffness("object")


def finger(plane, load=0.01, stop=False):
    """A finger of two leaf springs with a tendon through three guides."""
    scene = ksd.Mechanism("finger", plane=plane)
    middle, tip = scene.links("middle", "tip")
    words = {"section": BLADE, "material": STEEL, "width_axis": (0, 0, 1)}
    scene.leaf("ground", middle, start=(0, 0, 0), end=(0.02, 0, 0), **words)
    scene.leaf(middle, tip, start=(0.04, 0, 0), end=(0.06, 0, 0), **words)
    via = [("ground", (0, 5e-3, 0)), (middle, (0.02, 5e-3, 0)), (middle, (0.04, 5e-3, 0))]
    scene.cable("ground", tip, start=(-0.02, 5e-3, 0), end=(0.06, 5e-3, 0), via=via, name="tendon")
    scene.load(tip, force=(0, load, 0), at=(0.06, 0, 0))
    if stop:
        scene.stop(tip, about="z", high=0.3, name="end")
    return scene


@pytest.mark.parametrize("plane", ["xy", None])
def test_stiffness_of_a_finger_on_its_tendon(plane):
    pose, size = ksd.solve(finger(plane), tendon=4e-3), 1e-3
    others = [
        solve_with_contact(ksd.Solver(finger(plane, 0.01 + s * size)).model, {}, {"tendon": 4e-3}, start=pose)
        for s in (1, -1)
    ]
    moved = [p.displacement("tip", (0.06, 0, 0))[:2] for p in others]
    found = pose.stiffness("tip", at=(0.06, 0, 0)).compliance[:2, 1]
    assert found == pytest.approx((moved[0] - moved[1]) / (2 * size), rel=1e-5)


def test_two_counts_of_unstable_directions_agree():
    """A tendon pulled against a stop bends the finger out: by the small matrix, and by the pivots of the held model."""
    pose = ksd.solve(finger("xy", stop=True), tendon=4e-3, strict=False)
    assert pose.stops["end.high"].force > 0.0 and not pose.stable
    assert pose.negatives - pose.expected_negatives == 1
    assert not (pose.with_contacts_held.frequencies(count=1).frequency_Hz > 0.0).any()


def test_frequencies_at_a_stop_are_those_of_a_drive_that_holds_there():
    scenes = []
    for word in ("stop", "drive"):
        scene = ksd.Mechanism("guide")
        stage = scene.link("stage", mass=0.2, inertia=(1e-4,) * 3, at=(0.1, 0, 0))
        for y in (-0.03, 0.03):
            scene.leaf(
                "ground",
                stage,
                start=(0, y, 0),
                end=(0.1, y, 0),
                width_axis="z",
                section=BLADE,
                material=STEEL,
            )
        scene.load(stage, force=(0, 8, 0), at=(0.1, 0, 0))
        if word == "stop":
            scene.stop(stage, along="y", at=(0.1, 0.01, 0), high=3 * mm, name="end")
        else:
            scene.actuate(stage, along="y", at=(0.1, 0.01, 0), name="d")
        scenes.append(scene)
    pose, driven = ksd.solve(scenes[0]), ksd.solve(scenes[1], d=3 * mm, method="conventional")
    assert pose.frequencies(count=4).frequency_Hz == pytest.approx(
        driven.frequencies(count=4).frequency_Hz, rel=1e-7
    )
    own, other = (p.buckling("stage", at=(0.1, 0, 0), force=(-1, 0, 0)).factor for p in (pose, driven))
    assert own[:2] == pytest.approx(other[:2], rel=1e-6)


def column(word, how, size):
    """A strip under a follower force or pressure, with a stop or drive at its tip."""
    scene = ksd.Mechanism("column", plane="xy")
    tip = scene.link("tip", mass=0.1, inertia=(1e-6,) * 3, at=(0.1, 0, 0))
    section = ksd.rectangle(0.5 * mm, 20 * mm)
    scene.leaf("ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), section=section, material=STEEL, name="strip")
    if how == "pressure":
        scene.pressure("strip", size)
    else:
        scene.load(tip, force=(-size, 0.6 * size, 0), at=(0.1, 0, 0), following=True)
    if word == "stop":
        scene.stop(tip, along="y", at=(0.1, 0, 0), high=2 * mm, name="end")
    else:
        scene.actuate(tip, along="y", at=(0.1, 0, 0), name="d")
    return scene


@pytest.mark.parametrize(("how", "size"), [("force", 5), ("force", 40), ("pressure", 2e3), ("pressure", 2e5)])
def test_a_stop_under_loads_that_follow(how, size):
    pose = ksd.solve(column("stop", how, size))
    driven = ksd.solve(column("drive", how, size), d=2 * mm, method="conventional")
    assert pose.stops["end.high"].force == pytest.approx(-driven.forces["d"], rel=1e-9)
    assert np.abs(pose.motion.x - driven.motion.x).max() < 1e-11
    assert pose.stable == driven.stable
    own, other = pose.nonconservative_stability, driven.nonconservative_stability
    assert str(own)[:60] == str(other)[:60]


def test_a_stop_under_a_follower_force_that_makes_it_diverge():
    pose = ksd.solve(column("stop", "force", 110), strict=False)
    assert pose.stops["end.high"].force > 0.0 and not pose.stable
    held = pose.with_contacts_held.frequencies(count=1)
    assert not (held.frequency_Hz > 0.0).any()
    with pytest.raises(ksd.TrustError, match="UNSTABLE"):
        ksd.solve(column("stop", "force", 110))


def gripper(*, driven=False):
    """Two jaws that are driven towards each other, with a disc of 15 mm between them that nothing else holds."""
    scene = ksd.Mechanism("gripper", plane="xy")
    disc = scene.link("disc")
    for k, side in enumerate((-1, 1)):
        jaw, base = scene.links(f"jaw{k}", f"base{k}")
        for y in (20 * mm, 40 * mm):
            start, end = (0, side * y, 0), (0.06, side * y, 0)
            scene.leaf(base, jaw, start=start, end=end, section=BLADE, material=STEEL, name=f"l{k} {y}")
        scene.actuate(base, along="y", at=(0, side * 15 * mm, 0), name=f"y{k}")
        scene.support(base, along="x", at=(0, 0, 0))
        scene.support(base, about="z")
        face = scene.surface(jaw, ksd.shapes.wall(), at=(0.07, side * 15 * mm, 0), axis=(0, -side, 0))
        outline = scene.surface(disc, ksd.shapes.disc(15 * mm), at=(0.07, 0, 0), name=f"outline{k}")
        scene.contact(face, outline, friction=0.3, name=f"c{k}")
    if driven:
        scene.actuate(disc, along="x", at=(0.07, 0, 0), name="x")
    return scene


@pytest.fixture(scope="module")
def held():
    walk = ksd.walk(gripper(), [{"y0": 4 * mm, "y1": -4 * mm}], steps=4)
    assert all(pose.stable for pose in walk)
    return walk[-1]


def test_a_free_disc_is_dragged_along_while_jaws_close_on_it(held):
    """By the acceptance table .156 mm, since parasitic shortening moves the jaws."""
    assert held.displacement("disc", (0.07, 0, 0))[0] == pytest.approx(-0.156e-3, rel=0.02)
    assert [c.state for c in held.contacts.values()] == ["stick", "stick"] and held.stable
    # the disc has no leaf springs, so rounding is its bound
    assert (
        held.steps[-1].residual < 1.0 and "every residual is within its bound" in held.trust.trusted.sentence
    )
    total = sum(c.force for c in held.contacts.values())
    moment = sum(np.cross(c.place, c.force) for c in held.contacts.values())
    assert np.abs(total).max() < 1e-9 and np.abs(moment).max() < 1e-10


def test_grasp_of_a_free_disc(held):
    found = held.grasp("disc", at=(0.07, 0, 0))
    share = max(np.linalg.norm(c.T) / c.N for c in held.contacts.values())
    assert found.needed == share and found.margin == pytest.approx(0.3 / share)
    assert np.abs(found.forces.sum(axis=0)).max() < 1e-9 and "friction" in str(found)
    # rolling between the jaws is softer than along them, by the stiffness of four leaf springs
    assert 900 < found.stiffness.support("y") < 1100
    with pytest.raises(ksd.SceneError, match="no closed contact is on link 'base0'"):
        held.grasp("base0")


def test_what_pulls_a_free_disc_out_and_what_a_driven_one_bears(held):
    """Limits of the table for a free disc, and the force of a drive that moves a disc at the same place."""
    limit = ksd.pull_out(held, "disc", along="x", at=(0.07, 0, 0))
    assert limit == pytest.approx(1.22994, rel=5e-4)
    x = held.displacement("disc", (0.07, 0, 0))[0]
    program = [{"y0": 4 * mm, "y1": -4 * mm, "x": x}, {"x": x + 1e-6}, {"x": x - 2e-6}]
    walk = ksd.walk(gripper(driven=True), program)
    assert walk[1].forces["x"] == pytest.approx(limit, rel=2e-4)
    # against the other limit of the table
    assert walk[2].forces["x"] == pytest.approx(-1.17522, rel=5e-4)
