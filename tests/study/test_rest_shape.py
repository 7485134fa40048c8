"""Rest shapes from wanted deformed ones: closed forms, round trips, loops, folds, weight, words and errors.

Reference rows of single leaf springs: integration of k0 = k - M/EI by an independent code, to 1e-7.
"""

import math
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from planar_scenes import FINE, SOFT, indexer, rod, slider

import ksd
from ksd.model.leaves import cut_leaves
from ksd.rest_shapes.rest_leaf import plane_axes
from ksd.rest_shapes.rest_shape import RestShapeProblem

STEEL = ksd.Material(E=200e9, nu=0.3, density=7800.0)


@pytest.fixture
def paper(monkeypatch):
    """The benchmark script of the planar gripper."""
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "benchmarks"))
    return import_module("paper3")


def cantilever(force=(0, 5, 0), *, curve=None, end=(0.1, 0, 0), section=None, plane="xy", **words):
    scene = ksd.Mechanism("cantilever", plane=plane)
    tip = scene.link("tip")
    words = {"section": section or rod(0.08, 0.1), "material": SOFT, **words}
    scene.leaf("ground", tip, start=(0, 0, 0), end=end, curve=curve, name="leaf", **words)
    scene.load(tip, force=force, at=end, name="push")
    return scene


def start_of(leaf):
    """Angle of a leaf at its start, in the plane xy."""
    return math.atan2(*leaf.section_at(0.0)[1][1::-1, 0])


def end_of(leaf):
    return math.atan2(*leaf.section_at(1.0)[1][1::-1, 0])


BEND = 0.1 / 0.08
CHORD = 2 * 0.08 * math.sin(BEND / 2)
ROWS = [
    (None, (0.1, 0, 0), 5, (0.09741194, -0.02060173), -0.3125),
    (ksd.Arc(radius=0.08, angle=BEND),
     (CHORD * math.cos(BEND / 2), CHORD * math.sin(BEND / 2), 0), 6, (0.08597403, 0.04206484),
     1.009254),
]  # fmt: skip


@pytest.mark.parametrize("curve, end, force, place, angle", ROWS)
def test_one_leaf(curve, end, force, place, angle):
    found = ksd.rest_shape(cantilever((0, force, 0), curve=curve, end=end))
    leaf = found.leaves[0].leaf
    assert leaf.end[:2] == pytest.approx(place, abs=1e-8)
    assert (start_of(leaf), end_of(leaf)) == pytest.approx((0.0, angle), abs=1e-6)
    assert leaf.length == pytest.approx(0.1, rel=1e-9)
    assert found.displacement < 1e-10 and found.rotation < 1e-9 and "comes back" in found.checked
    h, v, first, last = found.leaf_forces["leaf"]
    assert (h, v, first, last) == pytest.approx((0, force, force * end[0], 0), abs=1e-9)


def same_leaves(found, scene, rel=1e-7):
    """Leaf springs of a rest shape are those of the scene, to a share of their length."""
    for one, two in zip(found.leaves, scene.scene().leaves, strict=True):
        length = two.leaf.length
        assert one.leaf.length == pytest.approx(length, rel=rel)
        for mine, theirs in ((one.leaf.start, two.leaf.start), (one.leaf.end, two.leaf.end)):
            assert mine == pytest.approx(theirs, abs=rel * length)
        for s in (0.0, 0.35, 1.0):
            mine, theirs = one.leaf.section_at(s), two.leaf.section_at(s)
            assert mine[0] == pytest.approx(theirs[0], abs=rel * length)
            assert mine[1] == pytest.approx(theirs[1], abs=10 * rel)


def round_trip(scene, **drives):
    pose = ksd.solve(scene, drives, mesh=FINE, strict=False)
    found = ksd.rest_shape(scene, pose)
    same_leaves(found, scene)
    assert found.displacement < 1e-8 * pose.model.arrays.size and found.rotation < 1e-8
    assert found.forces == pytest.approx(dict(pose.forces), rel=1e-7, abs=1e-9)
    return found


@pytest.mark.parametrize("seed", range(10))
def test_round_trip_of_random_mechanisms(paper, seed):
    """Ten mechanisms of sections B and G, loads at random: the pose gives back what it came from, and that the pose."""
    rng = np.random.default_rng(seed)
    kind = seed % 4
    if kind == 0:
        force = (*rng.uniform(-12, 12, 2), 0)
        round_trip(cantilever(force))
    elif kind == 1:
        scene = slider(rng.uniform(0.6, 1.6))
        scene.load("one", force=(*rng.uniform(-2, 2, 2), 0), at=(0.1, 0, 0))
        round_trip(scene, d=rng.uniform(-5e-3, 15e-3))
    elif kind == 2:
        scene = indexer()
        scene.load("C", moment=(0, 0, rng.uniform(-0.05, 0.05)))
        round_trip(scene, d=rng.uniform(-2e-3, 1e-3))
    else:
        round_trip(paper.gripper(rng.uniform(-4e-3, 4e-3), tuple(rng.uniform(-0.04, 0.04, 2))))


ANGLES = (
    Polynomial([1.5673, -5.7463, 11.3610, -11.0858, 4.8763]),
    Polynomial([-2.0609, -3.0966, 3.2937, 0.7269, -0.4298]),
)


def fourbar(push=1.0):
    """Thesis, section 5.4, example 3, drawn as it is wanted, with this force along x at J2."""
    x, w = np.polynomial.legendre.leggauss(40)
    u = 0.5 * (x + 1)
    scene = ksd.Mechanism("four-bar", plane="xy")
    links = ["ground", *scene.links("J2", "J3"), "ground"]
    place, places = np.zeros(3), []
    for k, (psi, length) in enumerate(((ANGLES[0], 0.2), (Polynomial([0.0233]), 0.1932), (ANGLES[1], 0.2))):
        end = place + length * np.array([0.5 * w @ np.cos(psi(u)), 0.5 * w @ np.sin(psi(u)), 0])
        slope = psi.deriv()
        curve = ksd.FreeCurve(length, lambda s, slope=slope, length=length: (0, 0, slope(s) / length))
        scene.leaf(links[k], links[k + 1], start=place, end=end, curve=curve, section=rod(0.08, 0.2), material=SOFT,
                   name=f"L{k + 1}")  # fmt: skip
        place = end
        places.append(end)
    scene.load("J2", force=(push, 0, 0), at=places[0], name="push")
    return scene


def test_inverse_four_bar():
    """Two rest shapes at h3 = -5 N, with the forces that the data of the thesis lead to: the closed chain integrated at rest
    by scipy's DOP853 at 1e-13, its three internal forces by Newton's method, independent of ksd."""
    found = ksd.rest_shape(fourbar(), free="push", forces={"L3": {"x": -5.0}})
    assert found.loads[0].force[0] == pytest.approx(35.9039999673, rel=1e-6)
    assert found.leaf_forces["L3"][0] == pytest.approx(-5.0, rel=1e-12)
    assert found.folds == () and found.crossings == () and found.displacement < 1e-9
    other = ksd.rest_shape(fourbar(), free="push", forces={"L3": {"x": -5.0}}, beyond_fold=True)
    assert other.loads[0].force[0] == pytest.approx(-31.3244634, rel=1e-6)
    assert other.folds == pytest.approx((-0.6015,), rel=1e-3)
    # another equilibrium is nearer to its rest; held where it is wanted it needs nothing more
    assert "in equilibrium in the wanted shape" in other.checked and other.displacement > 1e-3
    assert ("L2", "L3") in other.crossings
    assert "'L2' and 'L3' run through each other at rest" in " ".join(str(other).split())


def test_no_rest_shape_beyond_the_fold():
    with pytest.raises(
        ksd.ConvergenceError, match=r"beyond a fold at 60\.1. % .*'L3' along x: 3\.00.* N.*less than that"
    ):
        ksd.rest_shape(fourbar(), free="push", forces={"L3": {"x": 5.0}})
    # the most over forces at J2, each with its own rest shape; 3.0077008 by the closed chain, see above
    known = [
        ksd.rest_shape(fourbar(push), check=False).leaf_forces["L3"][0] for push in (-26.0, -26.4, -26.8)
    ]
    top = np.polyfit((-1, 0, 1), known, 2)
    assert top[2] - top[1] ** 2 / (4 * top[0]) == pytest.approx(3.0077008, abs=5e-5)
    with pytest.raises(ksd.ConvergenceError, match=r"around the fold at 60\.1. % .* no other rest shape"):
        ksd.rest_shape(fourbar(), free="push", forces={"L3": {"x": 5.0}}, beyond_fold=True)
    with pytest.raises(
        ksd.ConvergenceError, match=r"no second rest shape .* does not fold; leave beyond_fold out"
    ):
        ksd.rest_shape(cantilever(), beyond_fold=True)


@pytest.mark.parametrize("force", [200.0, 400.0, 1000.0])
def test_a_long_step_does_not_leap_over_the_fold(force):
    """A square frame pushed at a corner folds at 172.61 N, however large the load that is asked for; steps of 90 N led to
    another path beyond it at 400 N, and to a fold of that one, 489 N, at 1000 N."""
    scene = ksd.Mechanism("frame", plane="xy")
    corners = np.array([(0, 0, 0), (0, 0.1, 0), (0.1, 0.1, 0), (0.1, 0, 0)])
    links = ["ground", *scene.links("a", "b"), "ground"]
    for k in range(3):
        scene.leaf(links[k], links[k + 1], start=corners[k], end=corners[k + 1], section=rod(0.08, 0.1),
                   material=SOFT)  # fmt: skip
    scene.load("a", force=(force, 0, 0), at=corners[1], name="push")
    with pytest.raises(ksd.ConvergenceError, match=r"beyond a fold at .* % .*'push' 172\.6\d+ N"):
        ksd.rest_shape(scene, check=False)


@pytest.mark.parametrize("share", [0.95, 0.99, 0.998, 0.9999])
def test_what_the_fold_allows_has_two_rest_shapes(share):
    """Up to the number that the fold is told at, the next solution and the other one, which meet there."""
    force = share * 3.00766
    first, other = (
        ksd.rest_shape(fourbar(), free="push", forces={"L3": {"x": force}}, beyond_fold=beyond, check=False)
        for beyond in (False, True)
    )
    assert first.folds == () and other.folds == pytest.approx((1 / share,), rel=1e-4)
    one, two = (found.loads[0].force[0] for found in (first, other))
    assert one > -26.4 > two
    assert (one - two) / math.sqrt(1 - 1 / other.folds[0]) == pytest.approx(23.4, rel=0.03)
    assert all(found.leaf_forces["L3"][0] == pytest.approx(force, rel=1e-10) for found in (first, other))


def test_the_shape_of_one_load_under_another():
    """A shape found under one load, wanted under another: it is taken there, and the leaf is no longer straight."""
    pose = ksd.solve(cantilever((0, 8, 0)), mesh=FINE)
    found = ksd.rest_shape(cantilever((3, 2, 0)), pose)
    again = ksd.solve(found, mesh=FINE)
    place = again.motion.x[1] + again.motion.R[1] @ (
        np.array(found.leaves[0].leaf.end) - again.model.rest.x[1]
    )
    assert place == pytest.approx(np.array((0.1, 0, 0)) + pose.displacement("tip"), abs=1e-10)
    assert abs(found.leaves[0].leaf.end[1]) > 1e-3


def test_wanted_poses_of_links(paper):
    """A crank wanted at 15 degrees under a force on the jaw and no torque, other links where the arcs lead them."""
    found = ksd.rest_shape(paper.gripper(0.0, (-0.05, 0.02)), {"crank": ((0, 0, 0), 0.2, (0, 0, 0))})
    assert found.displacement < 1e-9
    pose = ksd.solve(found, mesh=FINE)
    start = {f.name: f.leaf for f in found.wanted.leaves}["arc 0"]
    arrived = pose.shape().leaves[0]
    assert arrived.place[-1] == pytest.approx(np.array(start.end), abs=1e-8)


@pytest.mark.parametrize("plane, turn", [("yz", 1), ("xz", 2)])
def test_planes(plane, turn):
    """The same leaf in other planes."""
    want = ksd.rest_shape(cantilever((2, 5, 0)), check=False).leaves[0].leaf.end
    spin = {"yz": [2, 0, 1], "xz": [1, 2, 0]}[plane]
    force, end = (np.array(v, float)[spin] for v in ((2, 5, 0), (0.1, 0, 0)))
    found = ksd.rest_shape(cantilever(force, end=end, plane=plane))
    assert found.leaves[0].leaf.end == pytest.approx(np.array(want)[spin], abs=1e-12)
    assert found.displacement < 1e-10


@pytest.mark.parametrize(
    "profile", [None, ksd.Taper(thickness=(0.8e-3, 0.4e-3), width=(10e-3, 5e-3))], ids=["uniform", "taper"]
)
def test_weight_stretch_and_shear(profile):
    """A soft strip with a payload under its own weight, drawn level; and a round trip from another pose."""
    scene = cantilever((40, 0, 0), section=ksd.rectangle(0.5e-3, 10e-3), material=STEEL, profile=profile)
    scene.mass("tip", mass=0.05, at=(0.1, 0, 0))
    scene.gravity = (0, -9.81, 0)
    found = ksd.rest_shape(scene)
    leaf = found.leaves[0].leaf
    assert found.displacement < 1e-9 and leaf.end[1] > 1e-3
    weight = leaf.length * 9.81 * 7800 * np.mean([
        (profile.section((k + 0.5) / 500) if profile else leaf.section).A for k in range(500)
    ])  # fmt: skip
    # its own weight hangs on it, the payload at its end; the pull stretches it
    assert found.leaf_forces["leaf"][:2] == pytest.approx((40, -0.05 * 9.81), rel=1e-9)
    assert 1e-6 < 1 - leaf.length / 0.1 < 1e-3
    pose = ksd.solve(found, mesh=FINE)
    assert pose.section_forces()["leaf"].start[1] == pytest.approx(-0.05 * 9.81 - weight, rel=1e-2)
    bent = cantilever((2, 3, 0), section=ksd.rectangle(0.5e-3, 10e-3), material=STEEL, profile=profile)
    bent.gravity = (0, -9.81, 0)
    back = ksd.rest_shape(bent, ksd.solve(bent, mesh=FINE))
    same_leaves(back, bent, rel=1e-6 if profile else 1e-7)


def test_derivatives_of_the_equations_are_differences(rng):
    """Also those by the load fraction, which is a factor of weight too."""
    scene = cantilever((40, 3, 0), section=ksd.rectangle(0.5e-3, 10e-3), material=STEEL)
    scene.mass("tip", mass=0.05, at=(0.1, 0.01, 0))
    scene.gravity = (5, -9.81, 0)
    frozen = scene.scene()
    problem = RestShapeProblem(frozen, cut_leaves(frozen), plane_axes("xy"), {}, (), {}, FINE)
    equations = problem.equations
    y, fraction = 0.3 * rng.normal(size=len(equations.scales)), 0.7
    F, J = equations.evaluate(y, fraction)
    for k in range(len(y) + 1):
        step = 1e-6 * (np.arange(len(y) + 1) == k)
        ahead, behind = (equations.evaluate(y + s * step[:-1], fraction + s * step[-1])[0] for s in (1, -1))
        assert J[:, k] == pytest.approx((ahead - behind) / 2e-6, abs=1e-6 * np.abs(J).max())
    assert np.abs(J[:, -1]).max() > 0.0 and J.shape == (len(F), len(F) + 1)


def test_points_and_following_loads():
    """A load at a point of a leaf, and one that turns with its link; the rest scene keeps both, and returns."""
    scene = cantilever((0, 2, 0))
    point = scene.point("leaf", 0.04, name="there")
    scene.load(point, force=(0, -9, 0), name="down")
    scene.load("tip", force=(0, 3, 0), at=(0.1, 0, 0), following=True, name="with it")
    found = round_trip(scene)
    assert found.points[0].s == pytest.approx(0.04, rel=1e-9)
    drawn = ksd.rest_shape(scene)
    assert drawn.displacement < 1e-10 and drawn.points[0].s == pytest.approx(0.04, rel=1e-6)
    assert drawn.loads[2].force != pytest.approx((0, 3, 0), rel=1e-3)


def test_points_of_a_leaf_that_shears():
    """Forces at points turn the line against its sections there; rest and pose come back all the same."""
    scene = ksd.Mechanism("soft strip", plane="xy")
    tip = scene.link("tip")
    scene.leaf("ground", tip, start=(0, 0, 0), end=(0.12, 0, 0), section=ksd.rectangle(2e-3, 10e-3),
               material=ksd.Material(E=2e8, nu=0.35), name="strip")  # fmt: skip
    for s, force in ((0.03, 0.9), (0.07, -0.4)):
        scene.load(scene.point("strip", s), force=(0.2, -force, 0))
    scene.load(tip, force=(0, -0.1, 0), at=(0.12, 0, 0))
    round_trip(scene)


def test_what_is_free():
    """A drive of known force: its travel is found; one of known travel: its force. Both are one rest shape."""
    scene = slider(0.8)
    pose = ksd.solve(scene, d=8e-3, mesh=FINE)
    by_value = ksd.rest_shape(scene, pose, check=False)
    by_force = ksd.rest_shape(scene, pose, free="d", forces={"d": pose.forces["d"]}, check=False)
    assert by_force.targets["d"] == pytest.approx(8e-3, rel=1e-7)
    assert by_value.forces["d"] == pytest.approx(pose.forces["d"], rel=1e-7)
    for one, two in zip(by_value.leaves, by_force.leaves, strict=True):
        assert one.leaf.end == pytest.approx(two.leaf.end, abs=1e-9)


def test_a_leaf_that_runs_through_itself():
    """Straight under a moment that at rest curls it twice around."""
    scene = ksd.Mechanism("curl", plane="xy")
    tip = scene.link("tip")
    scene.leaf(
        "ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), section=rod(0.08, 0.1), material=SOFT, name="leaf"
    )
    scene.load(tip, moment=(0, 0, -0.08 * 8.0 / 0.1))
    found = ksd.rest_shape(scene, check=False)
    assert found.crossings == (("leaf", "leaf"),) and "'leaf' runs through itself at rest" in str(found)
    assert ksd.rest_shape(cantilever(), check=False).crossings == ()


def test_a_rest_shape_is_a_scene():
    found = ksd.rest_shape(cantilever())
    assert isinstance(found, ksd.Scene) and isinstance(found.leaves[0].leaf.curve, ksd.FreeCurve)
    assert repr(found).startswith("<RestShape: of 'cantilever', solved forward it comes back")
    text = str(found)
    assert "length [mm]" in text and "M start [Nm]" in text
    leaf, row = (
        found.leaves[0].leaf,
        next(line for line in text.splitlines() if line.startswith(" leaf  ") and "[" not in line),
    )
    sizes = (1e3 * leaf.length, 1e3 * math.dist(leaf.start, leaf.end), *found.leaf_forces["leaf"])
    assert [float(word) for word in row.split()[1:]] == pytest.approx(sizes, rel=1e-4, abs=1e-9)
    assert ksd.solve(found).trusted and ksd.solve(replace(found, name="other")).trusted
    assert "not solved forward" in ksd.rest_shape(cantilever(), check=False).checked


def test_the_lines_to_make(tmp_path):
    """Places along a leaf at rest are those of its curve, at points on it too, and go into a file."""
    scene = cantilever((0, 2, 0))
    scene.load(scene.point("leaf", 0.04), force=(0, -9, 0))
    found = ksd.rest_shape(scene, check=False)
    line, leaf = found.line("leaf", points=11), found.leaves[0].leaf
    for s, place in zip(np.linspace(0, 1, 11), line, strict=True):
        assert place == pytest.approx(leaf.section_at(float(s))[0], abs=1e-6)
    assert line[-1] == pytest.approx(leaf.end, abs=1e-10)
    rows = found.to_csv(tmp_path / "leaf.csv", points=11).read_text().splitlines()
    assert rows[0] == "leaf,s_m,x_m,y_m,z_m" and len(rows) == 12
    assert [float(v) for v in rows[-1].split(",")[1:]] == pytest.approx([leaf.length, *line[-1]], rel=1e-12)
    with pytest.raises(ksd.SceneError, match=r"no leaf 'leave'; there are leaf"):
        found.line("leave")
    with pytest.raises(ksd.SceneError, match=r"points"):
        found.line("leaf", points=1)


def heated():
    scene = cantilever(material=ksd.Material(E=1e9, nu=0.3, expansion=1e-5))
    scene.heat(10.0)
    return scene


def askew():
    return cantilever((0, 0, 1))


def falling():
    scene = cantilever()
    scene.gravity = (0, 0, -9.81)
    return scene


@pytest.mark.parametrize(
    "scene, words, message",
    [
        (lambda: cantilever(plane=None, width_axis="z"), {}, r"names no plane.*plane=\"xy\""),
        (askew, {}, r"load 'push' leaves the plane xy"),
        (lambda: cantilever((0, 0, 0)), {"free": "push", "forces": {"leaf": {"y": 1.0}}}, r"free load 'push' is zero"),
        (falling, {}, r"gravity leaves the plane xy"),
        (cantilever, {"wanted": 3}, r"wanted = 3: give a pose"),
        (cantilever, {"free": "pull"}, r"free = 'pull' is neither a load nor a drive; there are push"),
        (cantilever, {"free": "push"}, r"1 loads or drives are free \(push\) and 0 forces are given"),
        (cantilever, {"forces": {"leaf": {"x": 1.0}}}, r"0 loads or drives are free \(none\) and 1 forces"),
        (cantilever, {"free": "push", "forces": {"leaf": {"z": 1.0}}}, r"'leaf' has no component 'z'; give 'x' or 'y'"),
        (cantilever, {"free": "push", "forces": {"left": {"x": 1.0}}}, r"forces: 'left'.*such as \{'leaf': \{'x': -5.0\}\}"),
        (cantilever, {"d": 1.0}, r"there is no drive 'd'; there are none"),
        (lambda: slider(1.0), {}, r"drive 'd' has no value.*d=\.\.\."),
        (lambda: slider(1.0), {"e": 1.0}, r"no drive 'e'; there are d"),
        (cantilever, {"check": 1}, r"check"),
        (cantilever, {"beyond_fold": "yes"}, r"beyond_fold"),
        (lambda: "cantilever", {}, r"is no mechanism"),
        (heated, {}, r"'cantilever' has heat, of which rest shapes are not known"),
        (cantilever, {"wanted": {"tip": ((0.03, 0, 0), 0.0)}}, r"leaf 'leaf' would be 130 mm apart, but it is 100 mm long"),
        (lambda: cantilever(curve=ksd.Arc(radius=0.1, angle=1.5)), {},
         r"spans 0\.136328 m .* but the ends are 0\.1 m apart"),
        (lambda: cantilever(curve=ksd.FreeCurve(0.1, lambda s: (0, 1.0, 0))), {}, r"'leaf' leaves the plane"),
        (lambda: cantilever(width_axis="y"), {}, r"'leaf' has no width normal to the plane"),
    ],
)  # fmt: skip
def test_wrong_words(scene, words, message):
    with pytest.raises(ksd.SceneError, match=message):
        ksd.rest_shape(scene(), **words)


def test_poses_of_other_mechanisms_and_meshes():
    pose = ksd.solve(slider(1.0), d=1e-3)
    with pytest.raises(ksd.SceneError, match=r"pose is one of another mechanism, 'slider'.*'cantilever'"):
        ksd.rest_shape(cantilever(), pose)
    chain = ksd.solve(cantilever(), mesh=ksd.Mesh("corotational", elements=8))
    with pytest.raises(ksd.SceneError, match=r"chains or reduced bodies; solve it without mesh= and basis="):
        ksd.rest_shape(cantilever(), chain)


def test_a_mechanism_that_moves_by_itself_is_refused():
    scene = ksd.Mechanism("loose", plane="xy")
    bar, tip = scene.links("bar", "tip")
    scene.pin("ground", bar, at=(0, 0, 0))
    scene.leaf(bar, tip, start=(0, 0, 0), end=(0.1, 0, 0), section=rod(0.08, 0.1), material=SOFT)
    scene.load(tip, force=(1, 0, 0), at=(0.1, 0, 0))
    with pytest.raises(ksd.KsdError, match=r"can move without any force.*hold it by a drive or support"):
        ksd.rest_shape(scene)


@pytest.mark.parametrize("values", [{"d": 2.573e-3, "e": 0.012865}, {"d": 3e-3, "e": -0.01}])
def test_a_leaf_spring_that_snaps_on_the_way_from_rest_is_told(values):
    """Both links are held: the forward solution brings them back, whichever way the slender leaf spring buckles."""
    scene = ksd.Mechanism("pressed", plane="xy")
    body, stuff = scene.link("body"), ksd.Material(E=200e9, G=77e9)
    stiffened = ksd.StiffenedMiddle(thickness=0.74e-3, width=18.5e-3, middle=2.22e-3, part=0.5)
    scene.leaf(
        "ground", body, start=(1e-3, -16e-3, 0), end=(14.5e-3, 65e-3, 0), section=ksd.rectangle(0.74e-3, 18.5e-3),
        material=stuff, profile=stiffened, name="guide",
    )  # fmt: skip
    scene.leaf(
        "ground", body, start=(33e-3, -29.6e-3, 0), end=(68e-3, 45.2e-3, 0), section=ksd.rectangle(0.6e-3, 12e-3),
        material=stuff, name="slender",
    )  # fmt: skip
    push = scene.displacement(body, (-0.7596, 0.6504, 0), at=(0.1, 0.1, 0))
    push += scene.displacement(body, (0.3637, -0.9315, 0), at=(0.1, 0.1, 0), coefficient=0.5)
    scene.actuate(terms=push, name="d")
    scene.actuate(body, about="z", name="e")
    pose = ksd.solve(scene, values, method="conventional")
    found = ksd.rest_shape(scene, pose)
    forward = ksd.solve(found, values, method="conventional", mesh=FINE)
    wanted, reached = (p.section_forces()["slender"].values[-1, 5] for p in (pose, forward))
    assert found.leaf_forces["slender"][3] == pytest.approx(wanted, rel=1e-2)
    if wanted * reached > 0.0:
        assert found.checked.startswith("solved forward it comes back to the wanted shape")
    else:
        assert (
            "links come back" in found.checked
            and "leaf spring 'slender' snaps into another shape" in found.checked
        )


def test_drives_the_other_way_about_and_along():
    scene = ksd.Mechanism("turned", plane="xy")
    tip = scene.link("tip")
    section = ksd.rectangle(5e-4, 0.01)
    scene.leaf("ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), section=section, material=STEEL, name="leaf")
    scene.actuate(tip, about=(0, 0, -1), name="turn")
    scene.actuate(tip, along=(0, -1, 0), at=(0.1, 0, 0), name="lift")
    round_trip(scene, turn=0.2, lift=0.01)


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("force", [1.0, 1e6, 1e9])
def test_loads_that_overflow_are_refused_or_answered_without_warnings_of_numpy(force):
    """Some 400 warnings of overflow left the package."""
    scene = ksd.Mechanism("overloaded", plane="xy")
    tip = scene.link("tip")
    scene.leaf(
        "ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), section=ksd.rectangle(5e-4, 0.02), width_axis="z",
        material=ksd.Material(E=200e9, nu=0.3),
    )  # fmt: skip
    scene.load(tip, force=(0, force, 0), at=(0.1, 0, 0))
    if force < 1e6:
        assert ksd.rest_shape(scene)
    else:
        with pytest.raises(ksd.KsdError, match=r"'overloaded' ends|varies too fast"):
            ksd.rest_shape(scene)
