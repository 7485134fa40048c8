"""Paths beside bifurcations that an imperfection has taken apart: none is left for another one that passes closely."""

from functools import cache

import numpy as np
import pytest
from scenes import STEEL, fourbar

import ksd
import ksd.solvers.arc_length as arc
from ksd.solvers.arc_length import _another_path_crosses


def arch(side, *, push=40.0):
    """A shallow arch of two leaf springs that meet in a block, pushed down in its middle and by `side` [N] beside."""
    scene = ksd.Mechanism("arch", plane="xy")
    top = scene.link("top")
    for start, end in (((0, 0, 0), (0.1, 0.012, 0)), ((0.22, 0, 0), (0.12, 0.012, 0))):
        scene.leaf("ground", top, start=start, end=end, section=ksd.rectangle(0.5e-3, 10e-3), material=STEEL,
                   width_axis=(0, 0, 1))  # fmt: skip
    scene.load(top, force=(side, -push, 0), at=(0.11, 0.012, 0))
    return scene


@cache
def perfect():
    """The path of the arch that nothing pushes aside."""
    return ksd.follow(arch(0.0))


def sunk(path):
    return path.states[-1].displacement("top")[1]


@pytest.mark.parametrize("side", [1e-2, 0.05, 0.5, 1.0, 4.0])
def test_an_arch_pushed_beside_its_middle_snaps_through(side):
    """The path of the arch turns sharply where that of the symmetric one has bifurcations; it went over to the symmetric one
    and back, and round until its steps were used."""
    paths = [ksd.follow(arch(side), first=first) for first in (0.02, 0.005)]
    for path in paths:
        assert path.ended, path.stop
        assert path.limits == pytest.approx(paths[0].limits, rel=2e-3)
        # the arch hangs: what pushed it aside hardly matters
        assert sunk(path) == pytest.approx(sunk(perfect()), rel=2e-4)
    # every state is one step from the last
    for one, other in zip(paths[0].states, paths[0].states[1:], strict=False):
        assert np.abs(other.motion.x - one.motion.x).max() < 2 * arc.MAX_ARC * one.model.arrays.size


def test_less_is_carried_the_further_aside_an_arch_is_pushed():
    """The asymmetric bifurcation's law of two thirds (Koiter, On the stability of elastic equilibrium, 1945): load lost over
    imperfection^(2/3) does not change."""
    critical = ksd.follow(arch(0.0), until=0.3).bifurcations[0].factor
    sides = np.array([0.02, 0.05, 0.1])
    lost = np.array([critical - ksd.follow(arch(s), most=1000).limits[0] for s in sides])
    # the force aside grows with the load factor
    law = lost / (sides * (critical - lost)) ** (2 / 3)
    assert np.ptp(law) < 0.03 * law.mean()


def test_both_bifurcations_of_one_step_are_found():
    """A limit point and a bifurcation in a step left the latter out: how many there were hung on the first step."""
    found = [
        [b.factor for b in ksd.follow(arch(0.0), first=first).bifurcations] for first in (0.02, 0.01, 0.001)
    ]
    for other in found[1:]:
        assert other == pytest.approx(found[0], abs=2e-3)


@pytest.mark.parametrize("ratio", [1.002, 1.05])
def test_two_bifurcations_that_one_step_passes_are_both_located(ratio):
    """A column buckles about either axis of its nearly square section: the loads have the ratio of the sides squared."""
    length, side, E = 0.1, 1e-3, 200e9
    scene = ksd.Mechanism("column")
    tip, section = scene.link("tip"), ksd.rectangle(side, ratio * side)
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=(length, 0, 0), section=section,
               material=ksd.Material(E=E, nu=0.3), width_axis="z")  # fmt: skip
    euler = np.pi**2 * E * section.Iz / (2 * length) ** 2
    scene.load(tip, force=(-euler, 0, 0), at=(length, 0, 0))
    path = ksd.follow(scene, until=1.6, first=0.3)
    assert [t.kind for t in path.turnings] == ["bifurcation"] * 2
    # the compression by the load, and shear, change the factors
    assert [t.factor for t in path.turnings] == pytest.approx([1.0, ratio**2], abs=2e-4)


def test_orientation_changes_where_paths_cross_alone():
    """At limit points both the inertia and the rate of the factor change; where one changes alone another path crosses."""
    path = ksd.follow(arch(0.0), until=0.3)
    place = arc.ArcLengthPoint(None, 0.0, 0, 0, None, None, 0)
    up, down = np.array([0.0, 1.0]), np.array([0.0, -1.0])
    more = arc.ArcLengthPoint(None, 0.0, 1, 1, None, None, 0)
    assert not _another_path_crosses(place, up, place, up) and not _another_path_crosses(
        place, up, more, down
    )
    assert _another_path_crosses(place, up, more, up) and _another_path_crosses(place, up, place, down)
    assert [t.kind for t in path.turnings] == ["bifurcation"]


def test_a_path_that_comes_back_to_its_start_stops_there():
    """Paths that pass each other about as closely as can be told: some go over, and went on backwards from the start to
    forces that stretch the leaf springs ten times."""
    back = [p for p in (ksd.follow(arch(side), first=0.005) for side in (0.1, 0.12, 0.14)) if not p.ended]
    assert back
    for path in back:
        assert path.stop.startswith("it came back to its start, over another path that passes closely")
        assert path.factor[-1] > 0.0 and path.states[-1].stable
        assert np.abs(path.factor).max() < 1.0
    # another state without load is no way back
    assert perfect().ended and (np.diff(np.sign(perfect().factor[1:])) != 0).sum() == 2


def test_a_double_bifurcation_is_told():
    """A square column buckles in two directions at once: the determinant keeps its sign."""
    scene = ksd.Mechanism("column")
    tip, at = scene.link("tip"), (0.1, 0, 0)
    scene.leaf(
        "ground",
        tip,
        start=(0, 0, 0),
        end=at,
        section=ksd.rectangle(1e-3, 1e-3),
        material=STEEL,
        width_axis="z",
    )
    scene.load(tip, force=(-20, 0, 0), at=at)
    (only,) = ksd.follow(scene).bifurcations
    # source: Euler's column, clamped and free
    assert 20 * only.factor == pytest.approx(np.pi**2 * STEEL.E * 1e-12 / 12 / (4 * 0.1**2), rel=2e-3)


def test_a_path_does_not_hang_on_its_first_step():
    """A fourbar whose two bifurcations, close to each other, are taken apart: long corrections led over both at once."""
    scene = fourbar()
    scene.load("top", force=(-456.9, 753.7, -982.5), moment=(50.68, -4.94, -30.2), at=(0, 0.37, 0))
    ends = [ksd.follow(scene, {"top": 1e-4}, first=first).states[-1] for first in (0.02, 0.005)]
    assert ends[0].stable and ends[1].stable
    assert ends[0].displacement("top") == pytest.approx(ends[1].displacement("top"), rel=1e-6)


@pytest.mark.parametrize("weight", [9.81, 0.5])
def test_a_leaf_spring_buckles_to_the_side_that_its_weight_bends_it_to(weight):
    """Between its ends, which the arc does not measure: some first steps led to the other side or onto the unstable path."""
    scene = ksd.Mechanism("beam", plane="xy")
    end = scene.link("end")
    material = ksd.Material(E=200e9, nu=0.3, density=7800)
    scene.leaf(
        "ground",
        end,
        start=(0, 0, 0),
        end=(0.1, 0, 0),
        section=ksd.rectangle(0.5e-3, 10e-3),
        material=material,
    )
    scene.gravity = (0, -weight, 0)
    scene.actuate(end, along="x", at=(0.1, 0, 0), name="press")
    scene.support(end, along="y", at=(0.1, 0, 0))
    scene.support(end, about="z")
    for first in (0.5, 0.06, 0.02):
        path = ksd.follow(scene, press=-50e-6, control="drives", first=first)
        assert path.ended and not path.turnings and path.states[-1].stable
        height = path.states[-1].shape().leaves[0].place[:, 1]
        # of the clamped Euler mode, beyond its strain
        rise = 2 / np.pi * np.sqrt(0.1 * (50e-6 - np.pi**2 / 3 * 0.5e-3**2 / 0.1))
        assert height.min() == pytest.approx(-rise, rel=0.02) and height.max() < 1e-9
