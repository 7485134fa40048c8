"""Pins, sliders, mechanisms that live in a plane, and points on leaf springs: words, pictures, errors, files."""

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scenes import STEEL, cross_flexure

import ksd
from ksd.errors import TrustError
from ksd.model.compile import compile_scene

THIN = ksd.rectangle(0.5e-3, 10e-3)


def sliding(plane="xy"):
    """A rigid crank pinned to ground, a flexible rod pinned to it and clamped to a slider."""
    scene = ksd.Mechanism("slider-crank", plane=plane)
    crank, rod, block = scene.links("crank", "rod", "block")
    a, b, c = (
        np.roll(p, {"xy": 0, "yz": 1, "xz": 0}[plane]) for p in ((0, 0, 0), (0.03, 0.04, 0), (0.15, 0, 0))
    )
    if plane == "xz":
        a, b, c = (p[[0, 2, 1]] for p in (a, b, c))
    scene.pin("ground", crank, at=a, name="O")
    scene.pin(crank, rod, at=b, name="A")
    scene.leaf(rod, block, start=b, end=c, section=THIN, material=STEEL, name="rod")
    scene.slider(block, along=plane[0], at=c, name="guide")
    scene.load(block, force=-3 * (c - a) / 0.15, at=c)
    scene.actuate(crank, about={"xy": "z", "xz": "-y", "yz": "x"}[plane], name="turn")
    return scene


def test_three_planes_are_one_mechanism():
    found = [ksd.solve(sliding(plane), turn=0.4) for plane in ("xy", "xz", "yz")]
    assert all(c.trusted for c in found)
    want = found[0].displacement("block")[0]
    assert want < -0.01
    assert [found[1].displacement("block")[0], found[2].displacement("block")[1]] == pytest.approx(
        [want] * 2, rel=1e-9
    )
    moments = [c.forces["turn"] for c in found]
    assert moments == pytest.approx([moments[0]] * 3, rel=1e-9)


def test_forces_of_pins_and_sliders():
    """On every link they balance the rest; the pins of a rigid crank see its moment."""
    found = ksd.solve(sliding(), turn=0.4)
    forces = found.interface_forces()
    assert found.reactions.keys() == {"O.x", "O.y", "A.x", "A.y", "guide.y", "guide.rz"}
    crank = forces.on("crank")
    assert crank[:5] == pytest.approx(np.zeros(5), abs=1e-9)
    assert crank[5] == pytest.approx(-found.forces["turn"], rel=1e-9)
    assert forces.on("block")[0] == pytest.approx(3.0, rel=1e-9)
    assert forces.of("O", "ground").force == pytest.approx(-forces.of("O", "crank").force)
    assert forces.of("guide", "block").force[1] == pytest.approx(found.reactions["guide.y"])
    assert "guide" in str(forces)


def test_what_hinges_and_drives_hold_has_no_stiffness():
    """A crank on a pin whose turn is driven: no direction gives way, and nothing is made of rounding."""
    found = ksd.solve(sliding(), turn=0.4)
    stiff = found.stiffness("crank")
    assert set(stiff.supports.values()) == {math.inf} and stiff.worst == (math.inf, math.inf)
    assert str(stiff).count("held") == 7
    rows = ksd.sweep(sliding(), turn=[0.0, 0.4], questions="support_stiffness", link="crank", progress=False)
    assert all(math.isinf(v) for v in rows["support_worst_N_per_m"])


def test_pins_in_space():
    """The same mechanism without a plane: a pin holds five motions, a slider five, and nothing else is needed."""
    scene = ksd.Mechanism("in space")
    crank, block = scene.links("crank", "block")
    scene.pin("ground", crank, at=(0, 0, 0), axis=(0, 0.6, 0.8), name="O")
    scene.leaf(
        crank, block, start=(0.05, 0, 0), end=(0.15, 0, 0), width_axis="z", section=THIN, material=STEEL
    )
    scene.slider(block, along=(1, 1, 0), at=(0.15, 0, 0))
    names = [s.name for s in scene.scene().supports]
    assert names[:5] == ["O.across", "O.x", "O.along", "O.racross", "O.rx"] and len(names) == 10
    scene.actuate(crank, about=(0, 0.6, 0.8), name="turn")
    found = ksd.solve(scene, turn=0.2)
    assert found.rotation("crank") == pytest.approx([0, 0.12, 0.16], abs=1e-10)
    moved = found.displacement("block", (0.15, 0, 0))
    assert moved[0] == pytest.approx(moved[1], abs=1e-12) and abs(moved[2]) < 1e-12
    assert found.rotation("block") == pytest.approx(np.zeros(3), abs=1e-12)


def bent(**words):
    scene = ksd.Mechanism("beam", plane="xy")
    tip = scene.link("tip")
    words = {
        "start": (0, 0, 0),
        "end": (0.1, 0, 0),
        "section": THIN,
        "material": STEEL,
        "name": "wire",
        **words,
    }
    scene.leaf("ground", tip, **words)
    return scene


ARC = {"curve": ksd.Arc(radius=0.05, angle=2.0), "end": (0.1 * math.sin(1.0), 0, 0)}
TAPER = {"profile": ksd.Taper(thickness=(0.8e-3, 0.4e-3), width=(10e-3, 5e-3))}
WAVE = {
    "curve": ksd.FreeCurve(0.1, lambda s: (0, 0, 8 * math.pi * math.cos(2 * math.pi * s))),
    "end": (
        0.1 * float(np.mean([math.cos(0.4 * math.sin(2 * math.pi * (k + 0.5) / 64)) for k in range(64)])),
        0,
        0,
    ),
}


@pytest.mark.parametrize("shape", [{}, ARC, TAPER, WAVE], ids=["straight", "arc", "taper", "wave"])
def test_points_change_nothing(shape):
    """A leaf with points on it is the leaf without them: force, stress, energy, frequencies, names."""
    answers = []
    for points in ((), (0.013, 0.05, 0.061)):
        scene = bent(**shape)
        for s in points:
            scene.point("wire", s)
        scene.actuate("tip", along="y", at=shape.get("end", (0.1, 0, 0)), name="d")
        found = ksd.solve(scene, d=0.02, mesh=ksd.Mesh(orders=(3, 2, 14), points=20))
        assert list(found.stress().leaves) == ["wire"] == list(found.strain_energy())
        assert [leaf.name for leaf in found.shape().leaves] == ["wire"]
        low = found.frequencies(count=2)
        answers.append(
            [found.forces["d"], found.strain_energy()["wire"], found.stress().largest_Pa, *low.frequency_Hz]
        )
    assert answers[1][:2] == pytest.approx(answers[0][:2], rel=2e-7)
    # pieces have modes of their own: stress and the second frequency are what more modes give
    assert answers[1][2:] == pytest.approx(answers[0][2:], rel=1e-3)


def test_load_drive_mass_and_question_at_a_point():
    """Small deflections of a cantilever under a force at s: F s^2 (3 L - s)/6EI at the end, F s^3/3EI at s."""
    scene = bent()
    point = scene.point("wire", 0.04, name="there")
    scene.load(point, force=(0, 0.01, 0))
    found = ksd.solve(scene)
    EI = 200e9 * THIN.Iz
    shear = 0.01 * 0.04 / (STEEL.G * THIN.A * THIN.ky)
    at = 0.01 * 0.04**3 / (3 * EI) + shear
    assert found.displacement(point)[1] == pytest.approx(at, rel=1e-5)
    assert found.displacement("tip")[1] == pytest.approx(
        0.01 * 0.04**2 * (0.3 - 0.04) / (6 * EI) + shear, rel=1e-5
    )
    assert found.stiffness(point).supports["y"] == pytest.approx(0.01 / at, rel=1e-4)

    driven = bent()
    driven.point("wire", 0.04, name="there")
    driven.actuate("there", along="y", name="d")
    assert ksd.solve(driven, d=at).forces["d"] == pytest.approx(0.01, rel=1e-5)

    heavy = bent(material=ksd.Material(E=200e9, G=76.9e9, density=1e-3))
    heavy.mass(heavy.point("wire", 0.04), mass=0.1)
    hertz = math.sqrt(0.01 / at / 0.1) / (2 * math.pi)
    assert ksd.solve(heavy).frequencies(count=1).frequency_Hz[0] == pytest.approx(hertz, rel=1e-4)
    heavy.gravity = (0, -9.81, 0)
    assert ksd.solve(heavy).displacement("wire point 1")[1] == pytest.approx(-98.1 * at, rel=2e-3)


def test_a_point_where_leaf_springs_meet():
    """A leaf clamped on the middle of another, and a spring pinned there."""
    scene = bent()
    middle = scene.point("wire", 0.05)
    side = scene.link("side")
    scene.leaf(middle, side, start=middle.at, end=(0.05, 0.05, 0), section=THIN, material=STEEL)
    scene.pin("ground", side, at=(0.05, 0.05, 0))
    scene.load("tip", force=(0, -5, 0), at=(0.1, 0, 0))
    found = ksd.solve(scene)
    assert found.trusted
    forces = found.section_forces()["wire"]
    side_force = found.interface_forces().of("ground-side", "side").force
    assert forces.end[1] == pytest.approx(-5 * math.cos(found.rotation("tip")[2]), rel=1e-6)
    # the pin takes from the wire what is missing at its root
    assert forces.start[1] == pytest.approx(-5 + side_force[1], rel=1e-6)


def test_chains_take_points_too():
    for nodal in (False, True):
        scene = bent()
        scene.load(scene.point("wire", 0.04, name="there"), force=(0, 0.01, 0))
        mesh = ksd.Mesh("corotational", elements=8, nodal=nodal)
        found = ksd.solve(scene, mesh=mesh)
        assert found.displacement("there")[1] == pytest.approx(
            ksd.solve(scene).displacement("there")[1], rel=1e-4
        )
        assert list(found.stress().leaves) == ["wire"]
        assert found.frequencies(count=1).frequency_Hz[0] == pytest.approx(
            ksd.solve(scene).frequencies(count=1).frequency_Hz[0], rel=1e-3
        )


def test_heat_and_fit_of_a_leaf_with_points():
    stuff = ksd.Material(E=200e9, G=76.9e9, expansion=1e-5)
    answers = []
    for points in ((), (0.02, 0.07)):
        scene = bent(material=stuff)
        for s in points:
            scene.point("wire", s)
        scene.heat(50.0, through=20.0)
        scene.fit("wire", shift=(1e-5, 1e-4, 0), turn=(0, 0, 0.01))
        scene.slider("tip", along="x", at=(0.1, 0, 0))
        found = ksd.solve(scene)
        answers.append([found.displacement("tip")[0], *found.reactions.values()])
    assert answers[1] == pytest.approx(answers[0], rel=1e-6)
    curved = bent(**ARC)
    curved.point("wire", 0.03)
    curved.fit("wire", shift=(0, 1e-5, 0))
    with pytest.raises(ksd.SceneError, match="curved, has an assembly error"):
        compile_scene(curved)


def test_what_is_printed():
    scene = sliding()
    scene.point("rod", 0.05, name="middle")
    said = str(compile_scene(scene))
    for words in (
        "plane: xy",
        "pin 'O' of 'crank' on 'ground'",
        "slider 'guide'",
        "'middle' at s = 50 mm of 'rod'",
    ):
        assert words in said
    lines = str(scene).splitlines()
    assert lines[0].startswith("slider-crank: in the plane xy, links crank")
    assert any(line.split() == ["point", "middle", "rod", "s", "=", "50", "mm"] for line in lines)
    told = ksd.doctor(scene)
    assert (told.freedoms, told.held) == (4, 1)
    assert not any(w in str(told) for w in ("along z", "about x", "in xy"))
    assert told.exact is False and len(told.free) == 3 and not told.redundant


def test_the_plane_is_hinted_at():
    scene = ksd.Mechanism("pinned")
    one, two = scene.links("one", "two")
    words = {"section": THIN, "material": STEEL, "width_axis": "z"}
    scene.leaf("ground", one, start=(0, 0, 0), end=(0.1, 0, 0), **words)
    scene.leaf(two, scene.link("block"), start=(0.1, 0, 0), end=(0.1, 0.1, 0), **words)
    for way in "xy":
        scene.support(two, along=way, at=(0.1, 0, 0), relative_to=one)
        scene.support("block", along=way, at=(0.1, 0.1, 0))
    assert "plane='xy'" in str(ksd.doctor(scene))
    with pytest.raises(TrustError, match="plane='xy'"):
        ksd.solve(scene)


def test_pictures(tmp_path):
    found = ksd.solve(sliding(), turn=0.4)
    shape = found.shape()
    assert [(h.name, h.kind) for h in shape.hinges] == [("O", "pin"), ("A", "pin"), ("guide", "slider")]
    turned = np.array([[math.cos(0.4), -math.sin(0.4)], [math.sin(0.4), math.cos(0.4)]]) @ (0.03, 0.04)
    assert shape.hinges[1].place[:2] == pytest.approx(turned, abs=1e-9)
    crank = next(b for b in shape.blocks if b.name == "crank")
    assert len(crank.place) == 2
    axes = found.plot().axes[0]
    markers = [line.get_marker() for line in axes.lines]
    assert markers.count("s") == 1 and markers.count("o") >= 2
    pin = next(
        line
        for line in axes.lines
        if line.get_marker() == "o" and np.allclose(line.get_xdata(), 1e3 * turned[0])
    )
    assert np.allclose(pin.get_ydata(), 1e3 * turned[1])
    assert ksd.view.plot_mechanism(found, view="3d")
    scene = sliding()
    scene.point("rod", 0.05)
    assert ksd.solve(scene, turn=0.4).plot().axes


def refused(call):
    with pytest.raises(ksd.SceneError) as error:
        call()
    said = str(error.value)
    assert "\n" not in said
    return said


def test_errors_give_the_number_that_works():
    scene = bent()
    point, other = scene.point("wire", 0.02, name="p"), scene.point("wire", 0.06, name="q")
    assert "give at=(0.02, 0.0, 0.0)" in refused(lambda: scene.pin("tip", point, at=(0.1, 0, 0)))
    assert "40 mm" in refused(lambda: scene.pin(point, other))
    for s, end in ((0.12, "tip"), (0.1, "tip"), (0.0, "ground"), (-1, "ground")):
        said = refused(lambda s=s: scene.point("wire", s))
        assert "give 0 < s < 0.1" in said and f"'{end}'" in said
    assert "use it" in refused(lambda: scene.point("wire", 0.02))
    assert '"wire"' in refused(lambda: scene.point("wir", 0.02))
    said = refused(lambda: scene.slider("tip", along=(0, 0, 0), at=(0.1, 0, 0)))
    assert 'no direction; give one, such as along="x".' in said
    assert 'along="x"' in refused(lambda: scene.slider("tip", along="z", at=(0.1, 0, 0)))
    assert "leave axis out" in refused(lambda: scene.pin("ground", "tip", at=(0.1, 0, 0), axis="x"))
    assert "'at' is missing" in refused(lambda: scene.pin("ground", "tip"))
    assert 'plane="xy"' in refused(lambda: ksd.Mechanism("m").pin("ground", "tip", at=(0, 0, 0)))
    assert '"xy", "xz" or "yz"' in refused(lambda: ksd.Mechanism("m", plane="xw"))
    assert "itself" in refused(lambda: scene.pin("tip", "tip", at=(0.1, 0, 0)))
    scene.slider("tip", along="y", at=(0.1, 0, 0), name="guide")
    assert "own name" in refused(lambda: scene.pin("ground", "p", name="guide"))
    # a long arm on a small hinge is fine, millimetres for metres are not
    scene.pin("ground", "tip", at=(2.5, 0, 0), name="arm")
    scene.validate()
    scene = bent()
    scene.pin("ground", "tip", at=(100, 0, 0), name="far")
    said = refused(scene.validate)
    assert "does not meet link 'tip'" in said and "at=(0.1, 0.0, 0.0) if that was in mm" in said
    # so are millimetres that are fewer times the size, where they would be among the rest
    for at in ((4, 0, 0), (4, 3, 0), (1, 15, 0), (15, 0.5, 0)):
        scene = bent()
        scene.pin("ground", "tip", at=at, name="far")
        assert "if that was in mm" in refused(scene.validate)
    scene = bent()
    scene.pin("ground", "tip", at=(0, 1e3, 0), name="far")
    assert "the nearest is at=(0.1, 0.0, 0.0)" in refused(scene.validate)


def test_what_leaves_the_plane_is_refused():
    scene = bent()
    for way in ({"along": "z", "at": (0.1, 0, 0)}, {"about": "y"}):
        assert 'about="z"' in refused(lambda way=way: scene.actuate("tip", **way))
    # it was taken as its part in the plane
    for way in ((0, 1, 1e-3), (0, 1, 0.5)):
        assert "leaves the plane xy" in refused(
            lambda way=way: scene.actuate("tip", along=way, at=(0.1, 0, 0))
        )
        assert "support 'tip.held' leaves" in refused(
            lambda way=way: scene.support("tip", along=way, at=(0.1, 0, 0))
        )
    mixed = scene.displacement("tip", "y", at=(0.1, 0, 0)) + scene.rotation("tip", "x")
    assert "about = (1.0, 0.0, 0.0)" in refused(lambda: scene.actuate(terms=mixed))
    # what the plane holds already may be said
    scene.support("tip", along="z", at=(0.1, 0, 0))
    scene.support("tip", about="x")
    scene = bent()
    scene.plane = None
    scene.actuate("tip", about="y", name="tilt")
    with pytest.raises(ksd.SceneError, match="drive 'tilt' leaves the plane xy"):
        scene.plane = "xy"
    scene = bent()
    words = {"section": THIN, "material": STEEL, "start": (0, 0.1, 0)}
    said = refused(lambda: scene.leaf("ground", "tip", end=(0.1, 0, 1e-3), **words))
    assert "leaves the plane xy: its ends are 1 mm apart along its normal" in said
    for pose in (((0, 0, 1e-3), 0.0), ((0, 0, 0), (0.1, 0, 0))):
        assert "leaves the plane xy" in refused(lambda pose=pose: ksd.required_loads(scene, {"tip": pose}))


def test_no_place_pins_two_points_of_leaves_that_are_apart():
    """They were told to be pinned at one of them, and there at the other."""
    scene = ksd.Mechanism("pair", plane="xy")
    for name, y in (("low", 0.0), ("high", 0.05)):
        scene.leaf("ground", scene.link(f"on {name}"), start=(0, y, 0), end=(0.1, y, 0),
                   section=ksd.rectangle(0.5e-3, 0.01), material=STEEL, name=name)  # fmt: skip
    low, high = scene.point("low", 0.05), scene.point("high", 0.05)
    for at in (None, (0.05, 0.0, 0.0), (0.05, 0.05, 0.0)):
        said = refused(lambda at=at: scene.pin(low, high, at=at))
        assert "50 mm from" in said and "an s at which their leaf springs meet" in said
    said = refused(lambda: scene.pin(low, "on high", at=(0.06, 0.05, 0)))
    assert said.endswith("give at=(0.05, 0.0, 0.0).")
    scene.pin(low, "on high", at=(0.05, 0.0, 0.0))


def test_a_plane_said_last_is_that_of_the_pins_too():
    """They kept holding what the plane holds, and the answer was not certain."""

    def pinned(early):
        scene = ksd.Mechanism("bent", plane="xy" if early else None)
        tip, arm = scene.links("tip", "arm")
        scene.leaf(
            "ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), section=THIN, material=STEEL, width_axis="z"
        )
        # the axis as an array
        scene.pin(tip, arm, at=(0.1, 0, 0), axis=np.array([0.0, 0.0, 1.0]))
        scene.slider(arm, along="x", at=(0.2, 0, 0))
        scene.plane = "xy"
        return scene.scene()

    assert pinned(True).fingerprint() == pinned(False).fingerprint()
    scene = ksd.Mechanism("askew")
    scene.pin("ground", scene.link("arm"), at=(0, 0, 0), axis="x", name="hinge")
    with pytest.raises(ksd.SceneError, match="pin 'hinge': its axis"):
        scene.plane = "xy"
    assert scene.plane is None


def test_a_curve_that_waves_too_often_says_where_points_help():
    """A dozen waves: refused with a distance of points at which it is as exact as with twice as many."""

    def wavy(points):
        curve = ksd.FreeCurve.sine([0.6 / k**2 for k in range(1, 13)], length=0.07)
        end = tuple(curve.line(1.0)[0])
        scene = bent(curve=curve, end=end)
        for k in range(1, points + 1):
            scene.point("wire", 0.07 * k / (points + 1))
        scene.load("tip", force=(0, 0.1, 0), at=end)
        return ksd.solve(scene).displacement("tip")

    said = refused(lambda: wavy(0))
    points = round(70 / float(said.split("every ")[1].split(" mm")[0])) - 1
    assert wavy(points) == pytest.approx(wavy(2 * points + 1), rel=1e-5, abs=1e-9)


MISTAKES = [
    (
        "[0.03, 0.04, 0]\na =",
        "[30, 40, 0]\na =",
        r"line \d+, \[\[pin\]\] 2: pin 'A' does not meet .* if that was in mm",
    ),
    ("along = [1", "along = [0", r"line \d+, \[\[slider\]\] 1.* no direction"),
    ("s = 0.05", 's = "150 mm"', r"line \d+, \[\[point\]\] 1: .* give 0 < s < 0\.126491"),
    ("about = [0, 0, 1]", 'about = "x"', r'line \d+, \[\[actuate\]\] 1: .* about="z"'),
    ('plane = "xy"', 'plane = "xw"', r"line \d+: plane = 'xw' must be"),
]


@pytest.mark.parametrize("right, wrong, message", MISTAKES)
def test_mistakes_in_files_have_their_line(right, wrong, message, tmp_path):
    scene = sliding()
    scene.point("rod", 0.05, name="middle")
    file = tmp_path / "scene.toml"
    ksd.save_scene(scene, file)
    text = file.read_text()
    assert right in text
    file.write_text(text.replace(right, wrong, 1))
    with pytest.raises(ksd.SceneError, match=message):
        ksd.load_scene(file)


@pytest.mark.parametrize("load", [0.0, -2.0])
def test_a_drive_that_rigid_hinges_lock_is_named(load):
    """The knee of a crank and a slide that do not turn against one another runs on a circle and on a line."""
    scene = ksd.Mechanism("locked", plane="xy")
    crank, slide = scene.links("crank", "slide")
    scene.pin("ground", crank, at=(0, 0, 0))
    scene.pin(crank, slide, at=(0.05, 0.03, 0), name="knee")
    scene.slider(slide, along="x", at=(0.1, 0, 0))
    scene.leaf("ground", crank, start=(0, 0.02, 0), end=(0, 0.06, 0), section=THIN, material=STEEL)
    scene.load(crank, force=(0, load, 0), at=(0.05, 0.03, 0))
    scene.actuate(slide, along="x", at=(0.1, 0, 0), name="push")
    with pytest.raises(
        ksd.ConvergenceError, match=r"drive 'push' conflicts with support .*'knee.x'.* remove drive 'push'"
    ):
        ksd.solve(scene, push=1e-3)


names = st.text("abcdefg", min_size=1, max_size=6)


@st.composite
def planar_mechanisms(draw):
    """Links on a row of leaf springs, with pins, sliders and points wherever they fit."""
    plane = draw(st.sampled_from([None, "xy", "xz", "yz"]))
    scene = ksd.Mechanism(draw(names), plane=plane)
    first, second = (np.eye(3)["xyz".index(c)] for c in plane or "xy")
    count = draw(st.integers(1, 3))
    links = ["ground", *(f"link {k}" for k in range(count))]
    for k in range(count):
        scene.link(links[k + 1])
        scene.leaf(links[k], links[k + 1], start=k * first, end=(k + 1) * first, width_axis=np.cross(first, second),
                   section=THIN, material=STEEL, name=f"leaf {k}")  # fmt: skip
        if draw(st.booleans()):
            name = draw(st.none() | st.just(f"point {k}"))
            point = scene.point(f"leaf {k}", draw(st.floats(0.01, 0.99)), name=name)
            if draw(st.booleans()):
                scene.load(point, force=draw(st.floats(-1, 1)) * second)
            if draw(st.booleans()):
                scene.mass(point, mass=draw(st.floats(0.1, 9)))
            if draw(st.booleans()):
                scene.pin(
                    point, links[k + 1] if draw(st.booleans()) else "ground", axis=None if plane else "z"
                )
        if draw(st.booleans()):
            scene.support(links[k + 1], along=second, at=(k + 1) * first)
        if draw(st.booleans()):
            scene.slider(links[k + 1], along=first + draw(st.floats(-1, 1)) * second, at=(k + 1) * first,
                         relative_to=draw(st.sampled_from([None, links[k]])))  # fmt: skip
    return scene


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_files_round_trip(data, tmp_path_factory):
    made = data.draw(planar_mechanisms())
    try:
        scene = made.scene()
    except ksd.SceneError as error:
        assert "same freedom" in str(error)
        return
    file = tmp_path_factory.getbasetemp() / "planar.toml"
    ksd.save_scene(made, file)
    again, _, _ = ksd.load_scene(file)
    assert again.scene() == scene
    assert again.scene().fingerprint() == scene.fingerprint()


def test_a_file_says_the_same_as_python(tmp_path):
    file = tmp_path / "crank.toml"
    file.write_text(
        """
name = "slider-crank"
plane = "xy"
links = ["crank", "rod", "block"]
[material.steel]
E = "200 GPa"
G = "76.9 GPa"
density = 7800
[[leaf]]
a = "rod"
b = "block"
name = "rod"
start = ["30 mm", "40 mm", 0]
end = [0.15, 0, 0]
thickness = "0.5 mm"
width = "10 mm"
material = "steel"
[[pin]]
a = "ground"
b = "crank"
at = [0, 0, 0]
name = "O"
[[pin]]
a = "crank"
b = "rod"
at = ["30 mm", "40 mm", 0]
name = "A"
[[slider]]
link = "block"
along = "x"
at = [0.15, 0, 0]
name = "guide"
[[point]]
leaf = "rod"
s = "50 mm"
name = "middle"
[[load]]
link = "block"
force = [-3, 0, 0]
at = [0.15, 0, 0]
[[actuate]]
link = "crank"
about = "z"
name = "turn"
value = 0.4
"""
    )
    made, targets, _ = ksd.load_scene(file)
    python = sliding()
    python.point("rod", 0.05, name="middle")
    assert made.scene().hinges == python.scene().hinges
    assert made.scene().points == python.scene().points
    want, got = ksd.solve(python, turn=0.4), ksd.solve(made, targets)
    assert got.forces["turn"] == pytest.approx(want.forces["turn"], rel=1e-9)
    assert "middle" in got.links


def test_pins_beside_joints():
    """A crank on a cross flexure, and a rigid coupler pinned to it whose other end slides on a line."""
    scene = ksd.Mechanism("mixed", plane="xy")
    crank, coupler = scene.links("crank", "coupler")
    scene.join("ground", crank, cross_flexure(), at=(0, 0, 0), axis="z", toward="y", name="hinge")
    scene.pin(crank, coupler, at=(0, 0.3, 0), name="P")
    scene.support(coupler, along="y", at=(0.3, 0.3, 0), name="line")
    scene.actuate(crank, about="z", name="turn")
    found = ksd.solve(scene, turn=0.2)
    P = found.displacement("crank", (0, 0.3, 0)) + np.array([0, 0.3, 0])
    end = found.displacement("coupler", (0.3, 0.3, 0)) + np.array([0.3, 0.3, 0])
    assert found.displacement("coupler", (0, 0.3, 0)) == pytest.approx(
        found.displacement("crank", (0, 0.3, 0)), abs=1e-12
    )
    assert end[1] == pytest.approx(0.3, abs=1e-12) and math.dist(P, end) == pytest.approx(0.3, rel=1e-9)
    assert found.forces == pytest.approx(ksd.solve(scene, turn=0.2, planar=False).forces, rel=1e-7)
    told = ksd.doctor(scene)
    assert told.exact and (told.freedoms, told.held) == (1, 1)
    with pytest.raises(ksd.KinematicsError, match="'coupler' is not connected to ground by joints or leaves"):
        ksd.solve(scene, turn=0.2, method="reduced")


def test_designs_with_points_have_gradients_and_sweeps():
    """Points are drawn into the shared integers of designs: gradient against differences, and the table of a sweep."""

    def design(L=0.1, s=0.04):
        scene = bent(end=(L, 0, 0))
        scene.load(scene.point("wire", s, name="there"), force=(0, 0.5, 0))
        scene.actuate("tip", along="y", at=(L, 0, 0), name="d")
        return scene

    found = ksd.gradient(design, {"L": 0.1, "s": 0.04}, d=[0.005])
    for name in ("L", "s"):
        at = {"L": 0.1, "s": 0.04}
        ends = [ksd.solve(design(**(at | {name: at[name] + h})), d=0.005).forces["d"] for h in (1e-5, -1e-5)]
        assert found["d_force_N", name][0] == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-5)
    table = ksd.sweep(design(), d=[0.0, 0.005], link="there", questions=("force", "support_stiffness"))
    assert table["d_force_N"][1] == pytest.approx(ksd.solve(design(), d=0.005).forces["d"], rel=1e-6)


def test_a_leaf_beside_the_plane_through_the_origin_is_in_the_plane():
    scene = ksd.Mechanism("beside", plane="xy")
    tip, words = scene.link("tip"), {"section": THIN, "material": STEEL}
    scene.leaf("ground", tip, start=(0, 0, 0.02), end=(0.1, 0, 0.02), **words)
    with pytest.raises(ksd.SceneError, match="40 mm apart"):
        scene.leaf("ground", tip, start=(0, 0.1, -0.02), end=(0.1, 0.1, 0.02), **words)
