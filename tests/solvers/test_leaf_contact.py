"""Contact along leaf springs: forces and places of exact rods, identities, small motions, and what is refused."""

import math

import numpy as np
import pytest

import ksd
from ksd.model.gaps import SHIFT
from ksd.solvers.contact_solve import solve_with_contact
from ksd.solvers.leaf_contact import (
    _compiled_at,
    curvatures,
    cut_at,
    cut_places,
    cut_state,
    node_poses,
    places_of,
    strips,
)
from ksd.solvers.touching import cut_model
from ksd.units import mm

STEEL = ksd.Material(E=200e9, nu=0.3, density=7800)
STRIP = ksd.rectangle(0.5 * mm, 10 * mm)
DISC, POINT = ksd.shapes.disc(20 * mm), ksd.shapes.point()


def stiff_section():
    """The section of STRIP without stretch and shear, with E = 1 GPa."""
    EI = 200e9 * STRIP.Iz
    A, I = 1e8 * EI / 0.1**2 / 1e9, EI / 1e9
    return ksd.numbers(A=A, J=I, Iy=I, Iz=I, width=10 * mm, thickness=0.5 * mm)


def finger(shape, x=60 * mm, *, friction=0.0, mirror=1.0, section=None, swapped=False, touches=True):
    """A leaf spring of 100 mm along x under a driven shape that just touches its surface at x."""
    scene = ksd.Mechanism("finger", plane="xy")
    tip, held = scene.links("tip", "object")
    material = STEEL if section is None else ksd.Material(E=1e9, nu=0.3)
    scene.leaf(
        "ground",
        tip,
        start=(0, 0, 0),
        end=(0.1, 0, 0),
        section=section or STRIP,
        material=material,
        name="leaf",
    )
    at = (x, mirror * (0.25 * mm + shape.sizes[-1]), 0)
    for along in "xy":
        scene.actuate(held, along=along, at=at, name=along)
    scene.support(held, about="z")
    pair = "leaf", scene.surface(held, shape, at=at)
    if touches:
        scene.contact(*(pair[::-1] if swapped else pair), friction=friction, name="c")
    return scene


def cut_place(pose, leaf="leaf"):
    """Arc length [m] at which a leaf is cut."""
    return next(p.s for p in pose.model.scene.points if p.leaf == leaf)


def place(pose):
    """Arc length [m] at which a leaf is touched: from where it is cut along its strip."""
    return cut_place(pose) + pose.touched.out[0, SHIFT]


# acceptance table, rods without stretch and shear, twice independent
@pytest.mark.parametrize(
    ("shape", "down", "N", "force", "s"),
    [
        (DISC, 10 * mm, 3.384897, (0.847660, 3.277041), 0.05587895),
        (DISC, 20 * mm, 7.306871, (3.523839, 6.401009), 0.05379770),
        (POINT, 10 * mm, 2.787426, (0.683857, 2.702237), 0.06093228),
    ],
)
def test_a_disc_and_a_corner_pressed_on_a_finger(shape, down, N, force, s):
    pose = ksd.solve(finger(shape, section=stiff_section()), x=0.0, y=-down)
    found = pose.contacts["c"]
    assert pytest.approx(N, rel=2e-6) == found.N and found.force[:2] == pytest.approx(force, rel=2e-6)
    assert place(pose) == pytest.approx(s, abs=2e-8) and pose.stable
    # the node of the cut is none of the user's links
    assert list(pose.links) == ["ground", "tip", "object"] and "3 links" not in str(pose.model)
    assert found.state == "closed" and abs(found.gap) < 1e-12


@pytest.mark.parametrize(
    ("shape", "from_x", "down", "N", "force", "s"),
    [
        (DISC, -1 * mm, 10 * mm, 3.327108, (-0.134675, 3.470991), 0.05588673),
        (DISC, 1 * mm, 10 * mm, 3.445462, (1.864964, 3.075960), 0.05587076),
        (POINT, -1 * mm, 15 * mm, 3.896557, (0.306057, 4.056596), 0.06212513),
    ],
)
def test_sliding_along_a_finger(shape, from_x, down, N, force, s):
    scene = finger(shape, friction=0.3, section=stiff_section())
    pose = ksd.walk(scene, [{"x": from_x, "y": -down}, {"x": 0.0}])[-1]
    found = pose.contacts["c"]
    assert found.state == "slip" and pytest.approx(N, rel=2e-6) == found.N
    assert found.force[:2] == pytest.approx(force, rel=3e-6, abs=3e-6) and place(pose) == pytest.approx(
        s, abs=2e-8
    )


def test_a_ball_on_a_strip_in_space():
    """Acceptance table: twice independent, with stretch and shear."""
    scene = ksd.Mechanism("strip")
    tip, ball = scene.links("tip", "ball")
    steel, at = ksd.Material(E=200e9, G=200e9 / 2.6), (70 * mm, 20.25 * mm, 2 * mm)
    words = {"section": STRIP, "material": steel, "width_axis": "z", "name": "leaf"}
    scene.leaf("ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), **words)
    for along in "xyz":
        scene.actuate(ball, along=along, at=at, name=along)
        scene.support(ball, about=along)
    scene.contact("leaf", scene.surface(ball, ksd.shapes.ball(20 * mm), at=at), name="c")
    pose = ksd.solve(scene, x=0.0, y=-8 * mm, z=0.0)
    found = pose.contacts["c"]
    assert pytest.approx(1.600778, rel=1e-6) == found.N
    assert found.force == pytest.approx((0.274882, 1.576966, 0.0103925), abs=1e-6)
    assert place(pose) == pytest.approx(0.0670555, abs=1e-7)
    assert pose.touched.out[0, 2] == pytest.approx(1.88116 * mm, abs=1e-8)
    with pytest.raises(ksd.SceneError, match="how its place moves in space is not known"):
        pose.stiffness("ball")
    beside = ksd.solve(scene, x=0.0, y=-4 * mm, z=4 * mm)
    # over the edge its centre line meets the edge
    assert beside.touched.out[0, 2] == 5 * mm and beside.contacts["c"].normal[2] > 0.02


def ellipse_scene(friction):
    """The thick tapered finger of Lan, 6.4, Ex. II, turned against an ellipse from its left."""
    base_thickness, tip_thickness, width, length = 30 * mm, 17 * mm, 25 * mm, 177.8 * mm
    shear = (5 + 5 * 0.4) / (6 + 5 * 0.4)

    def section(s):
        t = base_thickness + s * (tip_thickness - base_thickness)
        # no stretch
        A, k = 1e4 * t * width, 1e-4 * shear
        return ksd.numbers(A=A, J=5e-8, Iy=1e-7, Iz=width * t**3 / 12, ky=k, kz=k, width=width, thickness=t)

    scene, start = ksd.Mechanism("ellipse", plane="xy"), math.radians(175)
    base, tip, held = scene.links("base", "tip", "object")
    scene.leaf(
        base, tip, start=(0, 0, 0), end=(length * math.cos(start), length * math.sin(start), 0), section=section(0.5),
        profile=ksd.Varying(section), material=ksd.Material(E=4.8e6, G=1.71e6), name="leaf",
    )  # fmt: skip
    scene.actuate(base, about="z", name="phi")
    for along in "xy":
        scene.support(base, along=along, at=(0, 0, 0))
    at = (0, 120.65 * mm, 0)
    scene.actuate(held, along="x", at=at, name="x")
    scene.support(held, along="y", at=at)
    scene.support(held, about="z")
    outline = scene.surface(held, ksd.shapes.ellipse(99.06 * mm, 67.31 * mm), at=at, toward=(1, 0, 0))
    scene.contact("leaf", outline, friction=friction, name="c")
    return scene


# own shooting of the inextensible rod with shear, normal to its tapered surface; the thesis has figures only
@pytest.mark.parametrize(
    ("friction", "N", "s"),
    [(0.0, 40.66054, 0.08853318), (0.5, 47.33721, 0.09028437), (-0.5, 34.77059, 0.08729767)],
)
def test_a_tapered_finger_around_an_ellipse(friction, N, s):
    x, turn = 50.8 * mm, math.radians(90 - 175)
    program = [{"phi": turn, "x": x - math.copysign(5 * mm, friction)}] if friction else []
    walk = ksd.walk(ellipse_scene(abs(friction)), [*program, {"phi": turn, "x": x}], steps=2)
    assert pytest.approx(N, rel=3e-6) == walk[-1].contacts["c"].N
    assert place(walk[-1]) == pytest.approx(s, abs=1e-7) and walk[-1].stable


def test_past_the_end_and_back():
    """A disc over the tip: its normal turns over the end of the leaf, and nothing is left of the way."""
    scene = finger(DISC, x=99.9 * mm)
    walk = ksd.walk(
        scene,
        [{"x": 3 * mm, "y": -5 * mm}, {"y": -25 * mm}, {"x": 0.0}, {"x": 3 * mm, "y": -5 * mm}],
        steps=2,
    )
    first, last = walk[1], walk[-1]
    assert first.contacts["c"].N > 0.05 and cut_place(first) == pytest.approx(99.9 * mm, abs=1e-12)
    tip = np.array((0.1, 0)) + first.displacement("tip")[:2]
    centre = np.array((102.9 * mm, 15.25 * mm))
    angle = first.rotation("tip")[2]
    corner = tip + 0.25 * mm * np.array((-math.sin(angle), math.cos(angle)))
    assert math.dist(corner, centre) == pytest.approx(20 * mm, abs=1e-8)
    assert place(walk[5]) < 99 * mm
    assert pytest.approx(first.contacts["c"].N, rel=1e-8) == last.contacts["c"].N


def test_the_answer_depends_neither_on_order_nor_mirror_nor_where_the_leaf_is_split():
    found = []
    for words in ({}, {"swapped": True}, {"mirror": -1.0}, {"point": 0.03}, {"point": 0.08}):
        split = words.pop("point", None)
        scene = finger(DISC, friction=0.3, **words)
        if split:
            scene.point("leaf", split)
        y = -10 * mm * words.get("mirror", 1.0)
        poses = ksd.walk(scene, [{"x": 0.0, "y": y}, {"x": 2 * mm}])
        found.append([v for p in poses for v in (p.contacts["c"].N, np.linalg.norm(p.contacts["c"].T))])
    assert np.abs(np.array(found) - found[0]).max() < 1e-9


def test_slip_of_smaller_steps_is_the_same_and_a_frictionless_walk_returns():
    program = [{"x": 0.0, "y": -10 * mm}, {"x": 3 * mm}, {"x": -3 * mm}]
    coarse, fine = (ksd.walk(finger(DISC, friction=0.3), program, steps=n)[-1].contacts["c"] for n in (2, 4))
    assert coarse.force == pytest.approx(fine.force, rel=1e-3, abs=1e-9)
    first, *_, last = ksd.walk(finger(DISC), [*program, program[0]])
    assert pytest.approx(first.contacts["c"].N, rel=1e-9) == last.contacts["c"].N


def test_open_contact_changes_no_digit():
    scene, alone = (finger(DISC, touches=touches) for touches in (True, False))
    for made in (scene, alone):
        made.load("tip", force=(0, -1.0, 0), at=(0.1, 0, 0))
    pose, plain = (ksd.solve(made, x=0.0, y=1 * mm) for made in (scene, alone))
    assert all((one == other).all() for one, other in zip(pose.motion, plain.motion, strict=True))
    # the gap to the bent leaf, from points along it
    line = pose.shape(points=2001).leaves[0]
    apart = np.linalg.norm(line.place + 0.25 * mm * line.axes[:, :, 1] - (60 * mm, 21.25 * mm, 0), axis=1)
    assert pose.contacts["c"].state == "open"
    assert pose.contacts["c"].gap == pytest.approx(apart.min() - 20 * mm, abs=1e-7)


def test_two_discs_on_both_sides_of_a_leaf_and_a_load_balance():
    scene = ksd.Mechanism("rolls", plane="xy")
    tip, low, high = scene.links("tip", "low", "high")
    scene.leaf("ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), section=STRIP, material=STEEL, name="leaf")
    for name, x, side in ((low, 40 * mm, -1), (high, 60 * mm, 1)):
        at = (x, side * 5.25 * mm, 0)
        scene.actuate(name, along="y", at=at, name=f"{name.name} y")
        scene.support(name, along="x", at=at)
        scene.support(name, about="z")
        scene.contact(
            scene.surface(name, ksd.shapes.disc(5 * mm), at=at), "leaf", friction=0.2, name=name.name
        )
    scene.load(tip, force=(0, 1.0, 0), at=(0.1, 0, 0))
    walk = ksd.walk(scene, [{"low y": 3 * mm, "high y": -2 * mm}], steps=2)
    pose = walk[-1]
    c = pose.contacts
    assert min(c["low"].N, c["high"].N) > 1.0 and all(abs(p.gap) < 1e-11 for p in c.values())
    root = next(r for r in pose.interface_forces().rows if r.link == "ground")
    # contacts push the leaf by minus what they do to the discs
    sign = {
        name: 1.0 if p.force @ (0, 1, 0) * (1 if name == "high" else -1) > 0 else -1.0
        for name, p in c.items()
    }
    forces = [-sign[name] * p.force for name, p in c.items()]
    tip_at = np.array((0.1, 0, 0)) + pose.displacement(tip, (0.1, 0, 0))
    load = np.array((0, 1.0, 0))
    assert np.abs(sum(forces) + load - root.force).max() < 1e-8
    moment = sum(np.cross(p.place, f) for p, f in zip(c.values(), forces, strict=True)) + np.cross(
        tip_at, load
    )
    assert np.abs(moment - root.moment - np.cross(root.point, root.force)).max() < 1e-9


@pytest.mark.parametrize("shape", [ksd.shapes.disc(15 * mm), POINT, ksd.shapes.ellipse(30 * mm, 15 * mm)])
@pytest.mark.parametrize("tip_force", [-1.0, 0.0])
def test_stiffness_in_contact_along_a_leaf(shape, tip_force):
    """Against differences of solves; a leaf under shear moves a little off its own normal, 2e-6 here."""
    at = (60 * mm, 15.25 * mm, 0)

    def scene(push=(0.0, 0.0)):
        made = ksd.Mechanism("finger", plane="xy")
        tip, held = made.links("tip", "object")
        made.leaf("ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), section=STRIP, material=STEEL, name="leaf")
        blade = ksd.rectangle(0.3 * mm, 10 * mm)
        made.leaf("ground", held, start=(10 * mm, at[1], 0), end=at, section=blade, material=STEEL)
        middle = at if shape.sizes[-1] else (60 * mm, 0.25 * mm, 0)
        made.contact("leaf", made.surface(held, shape, at=middle), name="c")
        made.load(held, force=(push[0], push[1] - 2.5, 0), at=at)
        made.load(tip, force=(0, tip_force, 0), at=(0.1, 0, 0))
        return made

    pose, size, columns = ksd.solve(scene()), 2e-4, []
    for unit in np.eye(2):
        moved = [
            solve_with_contact(ksd.Solver(scene(s * size * unit)).model, {}, {}, start=pose).displacement(
                "object", at
            )
            for s in (1, -1)
        ]
        columns.append((moved[0] - moved[1])[:2] / (2 * size))
    found, other = pose.stiffness("object", at=at).compliance[:2, :2], np.array(columns).T
    assert np.abs(found - other).max() < 5e-6 * np.abs(other).max()


def test_words_are_written_read_drawn_listed_and_known_to_the_doctor(tmp_path):
    scene = finger(DISC, friction=0.2)
    ksd.save_scene(scene, tmp_path / "s.toml")
    again, _, _ = ksd.load_scene(tmp_path / "s.toml")
    assert again.scene() == scene.scene() and "leaf and object.surface" in str(scene)
    assert "contact 'c' of 'leaf' and 'object.surface', friction 0.2" in str(ksd.doctor(scene))
    pose = ksd.solve(again, x=0.0, y=-5 * mm)
    assert "surface" in {line.get_gid() for line in pose.plot().axes[0].lines}
    assert "slip" in str(pose.contacts) or "stick" in str(pose.contacts)
    assert pose.strength.stress_Pa > 0.0


CASES = [
    (
        lambda s: s.contact("leaf", "leaf"),
        "contact of two leaf springs, or of one with itself, is not known; ask pose",
    ),
    (
        lambda s: s.contact(
            "leaf", s.surface("object", ksd.shapes.wall(), at=(0, 1, 0), axis="-y", name="w")
        ),
        "a wall and leaf spring 'leaf' are not known to touch",
    ),
    (lambda s: s.contact("leaf.1", "object.surface"), "there is no surface 'leaf.1'"),
]


@pytest.mark.parametrize(("state", "message"), CASES)
def test_wrong_words_are_refused_in_one_sentence(state, message):
    with pytest.raises(ksd.SceneError, match=message):
        state(finger(DISC))


def test_what_does_not_know_contact_along_leaf_springs_refuses_it():
    scene = ksd.Mechanism("wire")
    tip = scene.link("tip")
    scene.wire("ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), diameter=1 * mm, material=STEEL, name="wire")
    ball = scene.surface("ground", ksd.shapes.ball(5 * mm), at=(0.05, 5.5 * mm, 0))
    with pytest.raises(ksd.SceneError, match="'wire' is round and has no side in space"):
        scene.contact("wire", ball)
    with pytest.raises(ksd.SceneError, match="is known on strain-mode leaves only"):
        ksd.solve(finger(DISC), mesh=ksd.Mesh("corotational", elements=4), x=0.0, y=-1 * mm)
    jointed = ksd.Mechanism("jointed")
    joint = ksd.ParallelGuide(STEEL, length=80 * mm, thickness=0.4 * mm, width=25 * mm, spacing=60 * mm)
    jointed.join("ground", jointed.link("stage"), joint, at=(0, 0, 0), axis="z", toward="x", name="guide")
    ball = jointed.surface("ground", ksd.shapes.ball(5 * mm), at=(0.05, 0.1, 0))
    with pytest.raises(
        ksd.SceneError, match="'guide/low' is a leaf spring of a joint, whose record knows no contact"
    ):
        jointed.contact("guide/low", ball)
    inside = finger(ksd.shapes.disc(20 * mm))
    other = inside.surface("object", ksd.shapes.disc(19 * mm), at=(60 * mm, 18 * mm, 0), name="low")
    inside.contact("leaf", other)
    with pytest.raises(ksd.SceneError, match=r"overlap at rest by 1.25 mm"):
        ksd.solve(inside, x=0.0, y=0.0)


def test_a_free_disc_between_two_fingers():
    scene, at = ksd.Mechanism("fingers", plane="xy"), (70 * mm, 15.25 * mm, 0)
    disc = scene.link("disc")
    for y, name in ((0.0, "low"), (30.5 * mm, "high")):
        base, tip = scene.links(f"{name} base", f"{name} tip")
        scene.leaf(base, tip, start=(0, y, 0), end=(0.1, y, 0), section=STRIP, material=STEEL, name=name)
        scene.actuate(base, along="y", at=(0, y, 0), name=f"{name} y")
        scene.support(base, along="x", at=(0, y, 0))
        scene.support(base, about="z")
        outline = scene.surface(disc, ksd.shapes.disc(15 * mm), at=at, name=f"{name} side")
        scene.contact(name, outline, friction=0.3, name=f"{name} grip")
    pose = ksd.walk(scene, [{"low y": 2 * mm, "high y": -2 * mm}], steps=2)[-1]
    assert [c.state for c in pose.contacts.values()] == ["stick", "stick"] and pose.stable
    found = pose.grasp(disc, at=at)
    assert np.abs(found.forces.sum(axis=0)).max() < 1e-10 and found.names == ("low grip", "high grip")
    # by the strips of leaf springs at rest between root and disc, in one line
    c = pose.contacts["low grip"]
    assert pytest.approx(3 * 200e9 * STRIP.Iz / (70 * mm) ** 3 * 2 * mm, rel=0.03) == c.N


def test_a_bow_pressed_in_its_middle_from_inside():
    """By symmetry as where its middle section is driven."""
    made = []
    for touched in (True, False):
        scene, middle = ksd.Mechanism("bow", plane="xy"), (-50 * mm, 50 * mm, 0)
        held, arc = scene.link("held"), ksd.Arc(radius=50 * mm, angle=-math.pi)
        words = {"curve": arc, "section": STRIP, "material": STEEL, "name": "bow"}
        scene.leaf("ground", "ground", start=(0, 0, 0), end=(0, 0.1, 0), **words)
        if touched:
            at = (-39.75 * mm, 50 * mm, 0)
            scene.support(held, along="y", at=at)
            scene.support(held, about="z")
            scene.contact(scene.surface(held, ksd.shapes.disc(10 * mm), at=at), "bow")
        else:
            scene.pin(held, scene.point("bow", 25 * math.pi * mm), at=middle)
            scene.support(held, along="y", at=middle)
            scene.support(held, about="z")
        scene.actuate(held, along="x", at=middle, name="x")
        made.append(scene)
    pressed, driven = ksd.solve(made[0], x=-3 * mm), ksd.solve(made[1], x=-3 * mm, method="conventional")
    # a leaf with both ends on ground has a node there, beside which it is cut, by a thousandth of its length
    assert pressed.contacts["held.surface-bow"].place[1] == pytest.approx(50 * mm, abs=1e-6)
    assert pressed.forces["x"] == pytest.approx(driven.forces["x"], rel=2e-4)


def test_a_disc_that_slides_over_a_point_of_the_leaf():
    forces = []
    for has_point in (True, False):
        scene = finger(DISC, x=55 * mm, friction=0.2)
        if has_point:
            scene.point("leaf", 55 * mm)
        walk = ksd.walk(scene, [{"x": 0.0, "y": -5 * mm}, {"x": 8 * mm}, {"x": 0.0}])
        forces.append([c.force for c in (p.contacts["c"] for p in walk)])
        assert place(walk[1]) > 55 * mm or has_point
    assert np.abs(np.subtract(*forces)).max() < 1e-4


@pytest.mark.parametrize("plane", [None, "xy"])
def test_models_with_moved_cuts_are_those_compiled_there(plane):
    scene = ksd.Mechanism("two on one", plane=plane)
    tip, held = scene.links("tip", "held")
    leaf = scene.leaf(
        "ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), width_axis="z", section=STRIP, material=STEEL
    )
    scene.point(leaf, 45 * mm, name="mark")
    scene.gravity = (0, -9.81, 0)
    for name, x in (("a", 60 * mm), ("b", 30 * mm)):
        shape = DISC if plane else ksd.shapes.ball(20 * mm)
        scene.contact(leaf, scene.surface(held, shape, at=(x, 20.25 * mm, 0), name=f"disc {name}"), name=name)
    scene.support(held, about="z")
    model = cut_model(ksd.compile_scene(scene, one_sided=True))
    places = {"leaf at a": 71 * mm, "leaf at b": 12 * mm}
    moved, compiled = cut_at(model, places), _compiled_at(model, places)
    assert "moved_cuts" in moved.derived and "moved_cuts" not in compiled.derived
    np.testing.assert_array_equal(moved.arrays.ints, compiled.arrays.ints)
    np.testing.assert_allclose(moved.arrays.floats, compiled.arrays.floats, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(moved.rest.x, compiled.rest.x, atol=1e-16)
    assert moved.scene == compiled.scene and moved.node_names == compiled.node_names
    # beyond the point of the leaf spring its pieces are others
    swapped = cut_at(model, places | {"leaf at a": 40 * mm})
    assert "moved_cuts" not in swapped.derived and not np.array_equal(swapped.arrays.ints, model.arrays.ints)


def test_a_leaf_spring_of_two_sections_is_compiled_where_it_is_cut():
    taper = ksd.Mechanism("taper", plane="xy")
    tip, held = taper.links("tip", "held")
    leaf = taper.leaf(
        "ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), section=STRIP, material=STEEL,
        profile=ksd.Taper(thickness=(0.5 * mm, 0.4 * mm), width=(10 * mm, 10 * mm)),
    )  # fmt: skip
    taper.contact(leaf, taper.surface(held, DISC, at=(60 * mm, 21 * mm, 0)), name="c")
    taper.support(held, about="z")
    model = cut_model(ksd.compile_scene(taper, one_sided=True))
    assert "moved_cuts" not in cut_at(model, {"leaf at c": 50 * mm}).derived


def test_a_leaf_spring_cut_elsewhere_keeps_its_shape():
    scene = finger(DISC)
    pose = ksd.solve(scene, x=0.0, y=-10 * mm)
    leaf = strips(pose.model)[0].leaf
    other = cut_at(pose.model, {"leaf at c": 40 * mm})
    there = cut_state(pose.model, pose.motion, other)
    # the old place of contact has the place and section that it had
    s = cut_place(pose)
    (x, R), (now_x, now_R) = (
        node_poses(model, motion, {"leaf at c": s})["leaf at c"]
        for model, motion in ((pose.model, pose.motion), (other, there))
    )
    assert np.abs(x - now_x).max() < 2e-5 and np.abs(R - now_R).max() < 2e-3
    near = np.linspace(0.0, 39 * mm, 9)
    np.testing.assert_allclose(
        curvatures(other, there, leaf, near), curvatures(pose.model, pose.motion, leaf, near), atol=1e-9
    )


def test_restrained_warping_is_compiled_where_the_leaf_is_cut():
    """Its torsion along a piece is no linear number of the place of a cut."""
    scene = ksd.Mechanism("wide strip")
    tip, ball = scene.links("tip", "ball")
    at, wide = (60 * mm, 20.25 * mm, 4 * mm), ksd.rectangle(0.5 * mm, 30 * mm)
    scene.leaf(
        "ground",
        tip,
        start=(0, 0, 0),
        end=(0.1, 0, 0),
        section=wide,
        material=STEEL,
        width_axis="z",
        name="leaf",
    )
    for along in "xyz":
        scene.actuate(ball, along=along, at=at, name=along)
        scene.support(ball, about=along)
    scene.contact("leaf", scene.surface(ball, ksd.shapes.ball(20 * mm), at=at), name="c")
    for words in ({"about": "x"}, {"about": "z"}, {"along": "y", "at": (0.1, 0, 0)}):
        scene.support(tip, **words)
    pose = ksd.solve(scene, x=8 * mm, y=-5 * mm, z=3 * mm, with_="warping")
    compiled = _compiled_at(pose.model, places_of(pose.model))
    assert pose.error.relative < 1e-4
    np.testing.assert_allclose(pose.model.arrays.members.value, compiled.arrays.members.value, rtol=1e-12)


@pytest.mark.parametrize("to", [0.08, 0.02])
def test_the_size_of_a_mechanism_does_not_depend_on_its_longest_piece(to):
    scene = ksd.Mechanism("slanted", plane="xy")
    tip, held = scene.links("tip", "held")
    leaf = scene.leaf("ground", tip, start=(0, 0, 0), end=(0.08, 0.08, 0), section=STRIP, material=STEEL)
    scene.contact(leaf, scene.surface(held, POINT, at=(0.07, 0.0705, 0)), name="c")
    model = cut_model(ksd.compile_scene(scene, one_sided=True))
    moved = cut_at(model, {"leaf at c": to})
    assert "moved_cuts" in moved.derived and moved.arrays.size == model.arrays.size


def two_discs():
    """A leaf spring under two discs of one driven block."""
    scene = ksd.Mechanism("two discs", plane="xy")
    tip, block = scene.links("tip", "block")
    scene.leaf("ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), section=STRIP, material=STEEL, name="leaf")
    for along in "xy":
        scene.actuate(block, along=along, at=(0.06, 0.02, 0), name=along)
    scene.support(block, about="z")
    for name, x, radius in (("a", 60 * mm, 2 * mm), ("b", 80 * mm, 3 * mm)):
        disc = scene.surface(
            block, ksd.shapes.disc(radius), at=(x, radius + 0.25 * mm, 0), name=f"disc {name}"
        )
        scene.contact("leaf", disc, name=name)
    return scene


@pytest.mark.parametrize("end", [0.0, 0.1])
def test_cuts_keep_their_distance_from_each_other_and_from_ends(end):
    model = cut_model(ksd.compile_scene(two_discs(), one_sided=True))
    places = cut_places(model, {"leaf at a": end, "leaf at b": end})
    marks = sorted([0.0, 0.1, *places.values()])
    assert np.diff(marks).min() > 0.0999 * mm and abs(places["leaf at a"] - end) == pytest.approx(0.1 * mm)
    # beside each other in the middle one gives way
    beside = cut_places(model, {"leaf at a": 60 * mm, "leaf at b": 60.01 * mm})
    assert beside["leaf at b"] == pytest.approx(60.1 * mm)


def test_discs_that_leave_the_leaf_over_its_end():
    pose = ksd.solve(two_discs(), x=45 * mm, y=-2 * mm)
    assert not pose.touched.closed and pose.stable
    assert pose.contacts["a"].gap == pytest.approx(3 * mm, rel=1e-3)
