"""Contact of surfaces with friction: forces of exact rods by shooting, balance, identities, and what is refused."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial import cKDTree

import ksd
from ksd.model.gaps import SLIP
from ksd.units import mm

STEEL = ksd.Material(E=200e9, nu=0.3)


def finger_and_wall(friction):
    """A leaf spring .1 m x .5 x 10 mm along x whose tip is under a level wall, driven along x and y."""
    scene = ksd.Mechanism("finger", plane="xy")
    tip, wall = scene.links("tip", "wall")
    section = ksd.rectangle(0.5 * mm, 10 * mm)
    scene.leaf("ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), section=section, material=STEEL)
    for along in "xy":
        scene.actuate(wall, along=along, at=(0.1, 0, 0), name=along)
    scene.support(wall, about="z")
    a = scene.surface(tip, ksd.shapes.point(), at=(0.1, 0, 0))
    b = scene.surface(wall, ksd.shapes.wall(), at=(0.1, 0, 0), axis="-y")
    scene.contact(a, b, friction=friction, name="c")
    return scene


def passive_gripper(friction):
    """A plastic finger with a wedge of 25 degrees at its end, and a disc of 8.9 mm that moves along it (Lan, 6.4, Ex. I)."""
    L, tip, width, thickness = 0.057, (0.076, 0.0016, 0), 0.0095, 0.0032
    # neither stretch nor shear
    EI = 2.6e9 * width * thickness**3 / 12
    stuff, area = ksd.Material(E=1e9, nu=0.3), 1e7 * EI / L**2 / 1e9
    section = ksd.numbers(A=area, J=EI / 1e9, Iy=EI / 1e9, Iz=EI / 1e9, width=width, thickness=thickness)
    scene = ksd.Mechanism("passive gripper", plane="xy")
    jaw, held = scene.links("jaw", "object")
    scene.leaf("ground", jaw, start=(0, 0, 0), end=(L, 0, 0), section=section, material=stuff)
    scene.actuate(held, along="x", at=(0.079, 0.0105, 0), name="x")
    scene.support(held, along="y", at=(0.079, 0.0105, 0))
    scene.support(held, about="z")
    beta = math.radians(25)
    flank = scene.surface(jaw, ksd.shapes.wall(), at=tip, axis=(math.sin(beta), math.cos(beta), 0))
    outline = scene.surface(held, ksd.shapes.disc(8.9e-3), at=(0.079, 0.0105, 0))
    scene.contact(flank, outline, friction=friction, name="c")
    return scene


# forces and place in the acceptance table, without friction by two independent codes
@pytest.mark.parametrize(
    ("friction", "force", "place"),
    [(0.0, (2.634660, 4.280069), 0.712298), (0.5, (7.472536, 4.699575), 0.707366)],
)
def test_the_passive_gripper_of_the_thesis(friction, force, place):
    pose = ksd.solve(passive_gripper(friction), x=0.06781 - 0.079)
    found, tip = pose.contacts["c"], np.array((0.076, 0.0016, 0))
    assert found.force[:2] == pytest.approx(force, rel=1e-5)
    along = np.linalg.norm(found.place - tip - pose.displacement("jaw", tip))
    assert along / (0.019 / math.cos(math.radians(25))) == pytest.approx(place, abs=1e-6)
    assert pose.steps[0].iterations <= 5 and pose.stable


def jaw(friction, *, swapped=False, mirror=1.0, shape=None):
    """A jaw on a parallel guide, whose flat face is under a driven disc of 15 mm."""
    scene = ksd.Mechanism("jaw", plane="xy")
    face_link, held = scene.links("jaw", "object")
    for y in (0.0, -20 * mm):
        section = ksd.rectangle(0.3 * mm, 10 * mm)
        scene.leaf(
            "ground",
            face_link,
            start=(0, mirror * y, 0),
            end=(0.06, mirror * y, 0),
            section=section,
            material=STEEL,
        )
    for along in "xy":
        scene.actuate(held, along=along, at=(0.07, mirror * 0.02, 0), name=along)
    scene.support(held, about="z")
    face = scene.surface(face_link, ksd.shapes.wall(), at=(0.07, mirror * 5 * mm, 0), axis=(0, mirror, 0))
    disc = scene.surface(held, shape or ksd.shapes.disc(15 * mm), at=(0.07, mirror * 0.02, 0))
    scene.contact(*((disc, face) if swapped else (face, disc)), friction=friction, name="c")
    return scene


# forces on the wall; 2x in the acceptance table, with the stretch and shear of this section
@pytest.mark.parametrize(("friction", "N", "Fx"), [(0.0, 1.303942, 0.0), (0.3, 1.408079, -0.422424)])
def test_the_tip_of_a_finger_under_a_wall_that_moves_down(friction, N, Fx):
    pose = ksd.solve(finger_and_wall(friction), x=0.0, y=-20 * mm)
    found = pose.contacts["c"]
    assert pytest.approx(N, rel=2e-4 if not friction else 1e-5) == found.N
    assert found.force[0] == pytest.approx(Fx, rel=1e-4, abs=1e-12)
    assert found.force[1] == pytest.approx(found.N, rel=1e-12)
    assert found.state == ("slip" if friction else "closed")
    assert pose.steps[0].iterations <= 7


def test_the_tip_sticks_and_slips_back():
    """The wall goes down 20 mm, so that the tip slides out, then along -x: it sticks for 9.2086 um, then slides in."""
    scene = finger_and_wall(0.3)
    program = [{"x": 0.0, "y": -20 * mm}, {"x": -4e-6}, {"x": -9.15e-6}, {"x": -9.27e-6}, {"x": -40e-6}]
    for steps in (1, 2):
        walk = ksd.walk(scene, program, steps=steps)
        c = [walk[k].contacts["c"] for k in range(steps - 1, len(walk), steps)]
        assert [p.state for p in c] == ["slip", "stick", "stick", "slip", "slip"]
        # friction is linear in the travel while it sticks, and slips where it is that of the other sense
        T = [p.T[0] for p in c]
        slope = (T[2] - T[1]) / -5.15e-6
        travel = (-0.3 * c[2].N - T[2]) / slope - 9.15e-6
        assert travel == pytest.approx(-9.2086e-6, rel=1e-3)
        assert pytest.approx(1.213938, rel=1e-3) == c[4].N
        assert c[4].force[0] == pytest.approx(0.3 * c[4].N, rel=1e-9)


def test_a_jaw_on_a_guide_under_a_disc():
    pose = ksd.solve(jaw(0.0), x=0.0, y=-4 * mm)
    assert pytest.approx(2.003209, rel=1e-5) == pose.contacts["c"].N
    assert pose.rotation("jaw")[2] == pytest.approx(-1.63454e-4, rel=1e-5)
    assert pose.steps[0].iterations <= 5
    # to the place of the table from either side; limits of a disc between two such jaws are twice these forces
    for x, N, Fx in ((-1 * mm, 2.051408, -0.615048), (1 * mm, 1.957111, 0.587417)):
        found = ksd.walk(jaw(0.3), [{"x": x, "y": -4 * mm}, {"x": 0.0}], steps=2)[-1].contacts["c"]
        assert (found.N, found.force[0]) == pytest.approx((N, Fx), rel=1e-5)
        assert found.state == "slip" and found.reserve == pytest.approx(0.0, abs=1e-12)


def test_the_answer_depends_neither_on_the_order_of_surfaces_nor_on_a_mirror():
    found = []
    for words in ({}, {"swapped": True}, {"mirror": -1.0}):
        y = words.get("mirror", 1.0) * -4 * mm
        walk = ksd.walk(jaw(0.3, **words), [{"x": 0.0, "y": y}, {"x": 0.5 * mm}])
        c = [p.contacts["c"] for p in walk]
        found.append(
            [
                v
                for p in c
                for v in (p.N, abs(p.T[0]), p.force[0] * (-1 if words.get("swapped") else 1), p.gap)
            ]
        )
    assert np.abs(np.array(found) - found[0]).max() < 1e-9


def test_without_friction_a_walk_returns_and_with_it_takes_work():
    loop = [{"x": 0.0, "y": -4 * mm}, {"x": 1 * mm}, {"y": -3 * mm}, {"x": 0.0}, {"y": -4 * mm}]
    for friction in (0.0, 0.3):
        walk = ksd.walk(jaw(friction), loop, steps=8)
        at = np.array([[v["x"], v["y"]] for v in walk.values[7:]])
        force = walk.along(lambda p: [p.forces["x"], p.forces["y"]])[7:]
        energy = walk.along(lambda p: sum(p.strain_energy().values()))[7:]
        work = float((0.5 * (force[1:] + force[:-1]) * np.diff(at, axis=0)).sum())
        if friction:
            # the same by forces and slip at the ends of steps, both with an error of the first order
            slip = sum(float(p.touched.forces[0, 1] * p.touched.out[0, SLIP]) for p in walk.poses[8:])
            assert work > 1e-3 and work == pytest.approx(slip, rel=1e-2)
        else:
            assert abs(work) < 1e-7 * energy.max() and abs(energy[-1] - energy[0]) < 1e-9 * energy.max()
            assert np.abs(walk[-1].motion.x - walk[7].motion.x).max() < 1e-12


def test_slip_of_smaller_steps_is_the_same():
    program = [{"x": 0.0, "y": -4 * mm}, {"x": 0.5 * mm}, {"x": -0.5 * mm}]
    coarse, fine = (ksd.walk(jaw(0.3), program, steps=n)[-1].contacts["c"] for n in (2, 4))
    assert coarse.force == pytest.approx(fine.force, rel=1e-3, abs=1e-9)


def test_a_polygon_on_a_face_rests_on_its_corners():
    """A square pressed on the face of the jaw: both lower corners may push; their resultant balances the jaw."""
    side = 5 * mm
    square = ksd.shapes.polygon([(-side, -15 * mm), (side, -15 * mm), (side, side), (-side, side)])
    pose = ksd.solve(jaw(0.0, shape=square), x=0.0, y=-2 * mm)
    corners = [c for c in pose.contacts.values() if c.N > 0.0]
    assert 1 <= len(corners) <= 2 and all(c.gap > -1e-11 for c in pose.contacts.values())
    rows = [r for r in pose.interface_forces().rows if r.link == "jaw"]
    force = sum(r.force for r in rows) - sum(c.force for c in corners)
    moment = sum(r.moment + np.cross(r.point, r.force) for r in rows) - sum(
        np.cross(c.place, c.force) for c in corners
    )
    assert np.abs(force).max() < 1e-8 and np.abs(moment).max() < 1e-9


def distance_of_points(one, other):
    return cKDTree(one).query(other)[0].min()


SHAPES = {
    "discs": (ksd.shapes.disc(4 * mm), ksd.shapes.disc(6 * mm)),
    "polygon": (
        ksd.shapes.disc(4 * mm),
        ksd.shapes.polygon([(-6e-3, -6e-3), (6e-3, -5e-3), (5e-3, 6e-3), (-5e-3, 5e-3)]),
    ),
    "ellipse": (ksd.shapes.disc(4 * mm), ksd.shapes.ellipse(8 * mm, 5 * mm)),
    "polygons": (
        ksd.shapes.polygon([(-5e-3, -2e-3), (5e-3, -2e-3), (0.0, 5e-3)]),
        ksd.shapes.polygon([(-6e-3, -6e-3), (6e-3, -5e-3), (5e-3, 6e-3), (-5e-3, 5e-3)]),
    ),
    "ellipse on a wall": (ksd.shapes.wall(), ksd.shapes.ellipse(8 * mm, 5 * mm)),
}


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_shapes_touch_where_their_outlines_meet_and_balance(name, friction):
    """No function of the solver: outlines as drawn come as near as a closed contact says; balance, cone, direction."""
    own, other = SHAPES[name]
    scene = ksd.Mechanism("pad", plane="xy")
    pad, held = scene.links("pad", "object")
    for i, y in enumerate((0.0, -20 * mm)):
        section = ksd.rectangle(0.3 * mm, 10 * mm)
        scene.leaf(
            "ground", pad, start=(0, y, 0), end=(0.06, y, 0), section=section, material=STEEL, name=f"l{i}"
        )
    for along in "xy":
        scene.actuate(held, along=along, at=(0.072, 0.03, 0), name=along)
    scene.support(held, about="z")
    axis = (0.1, 0.995, 0) if own.kind == "wall" else None
    a = scene.surface(pad, own, at=(0.07, 0.01, 0), axis=axis)
    b = scene.surface(held, other, at=(0.072, 0.03, 0), toward=(math.cos(0.3), math.sin(0.3), 0))
    scene.contact(a, b, friction=friction, name="c")
    walk = ksd.walk(
        scene, [{"x": 0.0, "y": (-17 if own.kind == "wall" else -14) * mm}, {"x": 0.2 * mm}], steps=2
    )
    for pose in walk:
        closed = [c for c in pose.contacts.values() if c.N > 0.0]
        if not closed:
            continue
        rows = [r for r in pose.interface_forces().rows if r.link == "pad"]
        force = sum(r.force for r in rows) - sum(c.force for c in closed)
        moment = sum(r.moment + np.cross(r.point, r.force) for r in rows) - sum(
            np.cross(c.place, c.force) for c in closed
        )
        largest = max(c.N for c in closed)
        assert np.abs(force).max() < 1e-8 * largest and np.abs(moment).max() < 1e-9 * largest
        for c in closed:
            assert abs(c.gap) < 1e-11 and np.linalg.norm(c.T) <= friction * c.N * (1 + 1e-9)
            assert abs(c.force @ c.normal - c.N) < 1e-12 + 1e-9 * c.N
        outlines = [s.outline for s in pose.shape().surfaces]
        if own.kind != "wall":
            dense = [np.concatenate([np.linspace(p, q, 60) for p, q in pairwise(o)]) for o in outlines]
            assert distance_of_points(dense[0], dense[1]) < 0.1 * mm
    assert closed


def test_open_contacts_change_no_digit():
    scene = jaw(0.3)
    pose = ksd.solve(scene, x=0.0, y=1 * mm)
    assert pose.contacts["c"].state == "open" and pose.contacts["c"].gap == pytest.approx(1 * mm)
    assert (pose.motion.x[1] == pose.model.rest.x[1]).all()


def test_words_are_written_read_drawn_listed_and_known_to_the_doctor(tmp_path):
    scene = jaw(0.3)
    lever = scene.link("lever")
    scene.leaf(
        "ground",
        lever,
        start=(0, 0.1, 0),
        end=(0.05, 0.1, 0),
        section=ksd.rectangle(1e-3, 1e-2),
        material=STEEL,
    )
    scene.surface(lever, ksd.shapes.ellipse(5e-3, 2e-3), at=(0.05, 0.1, 0), toward=(0.6, 0.8, 0), name="oval")
    scene.surface(lever, ksd.shapes.polygon([(0, 0), (1e-3, 0), (0, 1e-3)]), at=(0.05, 0.1, 0), name="wedge")
    tip = scene.surface(lever, ksd.shapes.point(), at=(0.05, 0.09, 0), name="tip")
    scene.contact(tip, "object.surface", softness=1e-5)
    ksd.save_scene(scene, tmp_path / "s.toml")
    again, _, _ = ksd.load_scene(tmp_path / "s.toml")
    assert again.scene() == scene.scene()
    assert "surface" in str(scene) and "friction 0.3" in str(scene)
    assert "contact 'c' of 'jaw.surface' and 'object.surface', friction 0.3" in str(ksd.doctor(scene))
    pose = ksd.solve(scene, x=0.0, y=-1 * mm)
    assert "surface" in {line.get_gid() for line in pose.plot().axes[0].lines}
    assert "slip" in str(pose.contacts) or "stick" in str(pose.contacts)
    text = (tmp_path / "s.toml").read_text().replace('shape = "disc"\nradius = 0.015', 'shape = "disc"')
    (tmp_path / "s.toml").write_text(text)
    with pytest.raises(ksd.SceneError, match="a disc needs radius, and none is given"):
        ksd.load_scene(tmp_path / "s.toml")


def scene_with_surfaces():
    scene = jaw(0.0)
    scene.surface("jaw", ksd.shapes.disc(1 * mm), at=(0.05, 0, 0), name="knob")
    scene.surface("object", ksd.shapes.ellipse(1 * mm, 2 * mm), at=(0.07, 0.02, 0), name="oval")
    return scene


CASES = [
    (lambda s: s.contact("jaw.surface", "knob"), "both surfaces are on link 'jaw'"),
    (lambda s: s.contact("jaw.surface", "object.surface", friction=-0.1), "friction = -0.1"),
    (lambda s: s.contact("nose", "object.surface"), "there is no surface 'nose'"),
    (
        lambda s: s.contact("oval", s.surface("jaw", ksd.shapes.ellipse(1e-3, 1e-3), at=(0, 0, 0))),
        "are not known to touch",
    ),
    (
        lambda s: s.surface("jaw", ksd.circle(1e-3), at=(0, 0, 0)),
        r"is no shape to touch; give one of ksd.shapes.disc",
    ),
    (lambda s: s.surface("jaw", ksd.shapes.disc(1e-3)), "'at' is missing"),
    (lambda s: s.surface("jaw", ksd.shapes.wall(), at=(0, 0, 0)), "'axis' is missing"),
    (lambda s: s.surface("jaw", ksd.shapes.wall(), at=(0, 0, 0), axis="z"), "leaves the plane xy"),
    (lambda s: s.surface("jaw", ksd.shapes.ball(1e-3), at=(0, 0, 0)), "a ball in the plane xy"),
    (lambda s: ksd.shapes.disc(0), "radius = 0"),
    (lambda s: ksd.shapes.polygon([(0, 0), (0, 1), (1, 1)]), "go clockwise, so it is inside out"),
    (lambda s: ksd.shapes.polygon([(0, 0), (1, 0), (0.5, 0.1), (1, 1), (0, 1)]), "no convex polygon"),
    (lambda s: ksd.shapes.polygon([(0, 0), (1, 0), (2, 0)]), "enclose no area"),
    (lambda s: ksd.shapes.polygon(3), "at least three corners"),
    (lambda s: ksd.walk(s, []), "give values by name for every waypoint"),
    (
        lambda s: ksd.Mechanism("m").surface("ground", ksd.shapes.disc(1), at=(0, 0, 0)),
        "a disc lives in a plane",
    ),
]


@pytest.mark.parametrize(("state", "message"), CASES)
def test_wrong_words_are_refused_in_one_sentence(state, message):
    with pytest.raises(ksd.SceneError, match=message):
        state(scene_with_surfaces())


@pytest.mark.parametrize(
    ("at", "message"),
    [((0.07, 0.019, 0), "overlap at rest by 1 mm"), ((0.07, 0.03, 1e-3), "different heights")],
)
def test_surfaces_that_overlap_or_miss_the_plane_are_refused(at, message):
    scene = jaw(0.0)
    scene.surface("object", ksd.shapes.disc(15 * mm), at=at, name="other")
    scene.surface("jaw", ksd.shapes.disc(1 * mm), at=(0.07, 0, 0), name="knob")
    scene.contact("knob" if at[2] else "jaw.surface", "other")
    with pytest.raises(ksd.SceneError, match=message):
        ksd.solve(scene, x=0.0, y=0.0)


def test_a_walk_that_stops_says_how_far_it_got():
    scene = jaw(0.0)
    scene.stop("object", along="y", at=(0.07, 0.02, 0), low=-1 * mm)
    with np.errstate(all="ignore"), pytest.raises(ksd.ConvergenceError, match="pose 2 of 2 was not reached"):
        ksd.walk(scene, [{"x": 0.0, "y": -0.5 * mm}, {"y": -3 * mm}])


@pytest.mark.parametrize("force", [0.0, 1.0])
def test_an_object_that_nothing_holds_is_named(force):
    scene = ksd.Mechanism("loose", plane="xy")
    tip, held = scene.links("tip", "object")
    scene.leaf(
        "ground", tip, start=(0, 0, 0), end=(0.06, 0, 0), section=ksd.rectangle(3e-4, 0.01), material=STEEL
    )
    face = scene.surface(tip, ksd.shapes.wall(), at=(0.06, 5 * mm, 0), axis="y")
    scene.contact(face, scene.surface(held, ksd.shapes.disc(10 * mm), at=(0.06, 15 * mm, 0)), friction=0.3)
    scene.load(held, force=(0, force, 0), at=(0.06, 15 * mm, 0))
    with pytest.raises(
        ksd.SceneError, match="link 'object' is held by nothing here: no contact on it is closed"
    ):
        ksd.solve(scene)


def test_remarks_on_large_friction_and_on_a_pair_that_never_meets():
    scene = jaw(4.0)
    scene.surface("jaw", ksd.shapes.disc(1 * mm), at=(0.03, 0, 0), name="knob")
    scene.contact("knob", "object.surface", name="far")
    walk = ksd.walk(scene, [{"x": 0.0, "y": -1 * mm}, {"y": -2 * mm}])
    assert str(walk).startswith("2 poses; never touched: far\n")
    said = "contact 'c': friction = 4 is that of no dry surfaces"
    assert said in str(ksd.doctor(scene)) and sum(said in w for w in walk[-1].warnings) == 1


@pytest.mark.parametrize("push", [-3.0, -12.0])
def test_surfaces_do_not_pass_through_one_another(push):
    """A load that would carry an object round the disc below: it rests on it, or the snap is refused."""
    scene, at = ksd.Mechanism("discs", plane="xy"), (0.0705, 0.0205, 0)
    pad, held = scene.links("pad", "object")
    blade = {"section": ksd.rectangle(0.3 * mm, 10 * mm), "material": STEEL}
    for y in (0.0, -20 * mm):
        scene.leaf("ground", pad, start=(0, y, 0), end=(0.06, y, 0), **blade)
    scene.leaf("ground", held, start=(0.1205, 0.0205, 0), end=at, **blade)
    scene.surface(pad, ksd.shapes.disc(4 * mm), at=(0.07, 0.01, 0), name="low")
    scene.surface(held, ksd.shapes.disc(6 * mm), at=at, name="high")
    scene.contact("low", "high", name="c")
    scene.load(held, force=(0, push, 0), at=at)
    if push == -12.0:
        with pytest.raises(ksd.ConvergenceError, match="with contact"):
            ksd.solve(scene)
    else:
        found = ksd.solve(scene).contacts["c"]
        assert found.N > 2.0 and found.normal[1] > 0.5
