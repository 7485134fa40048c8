"""Layouts that hold a motion twice: the internal stress of misplaced leaf springs, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

import ksd
from ksd.answers.stress import stress_from_forces
from ksd.errors import SceneError
from ksd.scene import CrossedPivot, CrossFlexure, Material, Motion, ParallelGuide
from ksd.scene.joint import DrawnJoint

STEEL = Material(E=200e9, G=76.9e9)
SIZES = {"length": 0.1, "thickness": 5e-4}


def solved(*joints, value=0.0, tilt=0.0, method="conventional"):
    """Joints 0.2 m apart in y between ground and one link, the first one's motion driven."""
    scene = ksd.Mechanism("layout")
    table = scene.link("table")
    for k, joint in enumerate(joints):
        scene.join(
            scene.ground,
            table,
            joint,
            at=(0, 0.2 * k, 0),
            axis="z",
            toward=(1, tilt * k, 0),
            name=f"joint{k}",
        )
    scene.actuate_joint("joint0", name="drive")
    return ksd.solve(scene, drive=value, method=method)


def guide(count=2, width=0.03):
    """A guide of `count` leaf springs, drawn."""
    leaves = [
        ksd.Leaf(
            start=(0, y, 0), end=(0.1, y, 0), width_axis=(0, 0, 1), section=ksd.rectangle(5e-4, width),
            material=STEEL, name=f"leaf{k}",
        )
        for k, y in enumerate(np.linspace(-0.03, 0.03, count).tolist())
    ]  # fmt: skip
    motion = Motion("stroke", "translation", (0, 1, 0), (-0.02, 0.02), (0.05, 0, 0))
    return DrawnJoint("guide", blocks={"A": (0, 0, 0), "B": (0.1, 0, 0)}, leaves=leaves, motions=[motion])


@pytest.mark.parametrize(
    "joint, within",
    [
        # a leaf holds three motions of five: 6, 9, 6 and 9 holds of five motions
        (CrossedPivot(STEEL, angle=0.8, width=0.03, **SIZES), 1),
        (CrossFlexure(STEEL, angle=0.8, widths=(0.03, 0.015), **SIZES), 4),
        (ParallelGuide(STEEL, width=0.03, spacing=0.06, **SIZES), 1),
        (guide(3), 4),
    ],
    ids=["two crossed leaf springs", "three crossed leaf springs", "guide", "guide of three"],
)
def test_what_is_held_twice_costs_stress(joint, within):
    """The doctor counts it, and a misplaced end of a leaf that takes part is paid for in every such joint."""
    pose = solved(joint)
    assert sum(bool(f.inside) for f in ksd.doctor(pose.model).redundant) == within
    assert pose.internal_stress(offset=1e-5, rotation=1e-4).largest_Pa > 1e6


def test_the_middle_leaf_of_three_misplaced_along():
    """Closed form: E/L offset 2/3, the outer leaf springs in series with it."""
    pose = solved(guide(3), value=0.0)
    found = pose.internal_stress(leaves=("joint0/leaf1",), offset=1e-5)
    expected = STEEL.E * 1e-5 / 0.1 * 2 / 3
    assert found.stress_Pa["joint0/leaf1", "along"] == pytest.approx(expected, rel=1e-3)
    # bent into an S: 6 E (t/2) offset / L^2
    bent = 3 * STEEL.E * 5e-4 * 1e-5 / 0.1**2
    assert found.stress_Pa["joint0/leaf1", "across"] == pytest.approx(bent, rel=1e-3)
    assert found.worst_leaf["joint0/leaf1", "along"] == "joint0/leaf1"
    twice = pose.internal_stress(leaves=("joint0/leaf1",), offset=2e-5)
    assert twice.stress_Pa["joint0/leaf1", "along"] == pytest.approx(2 * expected, rel=1e-3)


def estimated_and_solved(draw, leaf, drive, error):
    """Internal stress by misplacements of a leaf, by (leaf, direction), and that of the change of the state when `draw()`
    is solved with this assembly error of the leaf."""
    forces = []
    for put_in in (False, True):
        scene = draw()
        if put_in:
            scene.fit(leaf, **error)
        pose = ksd.solve(scene, drive=drive, method="conventional", effects="all")
        if not put_in:
            estimated = pose.internal_stress(leaves=(leaf,), offset=1e-7, rotation=1e-6)
        forces.append(pose.section_forces(points=13))
    change = {n: replace(f, values=f.values - forces[0][n].values) for n, f in forces[1].items()}
    return estimated.stress_Pa, stress_from_forces(pose.model, change).largest_Pa


@pytest.mark.parametrize("turn", [0.0, 0.3])
@pytest.mark.parametrize(
    "direction, assembly_error",
    [
        ("along", {"shift": (1e-7, 0, 0)}),
        ("across", {"shift": (0, 1e-7, 0)}),
        ("sideways", {"shift": (0, 0, 1e-7)}),
        ("yaw", {"turn": (0, 1e-6, 0)}),
        ("tilt", {"turn": (0, 0, 1e-6)}),
    ],
)
def test_against_an_assembly_error_in_the_scene(direction, assembly_error, turn):
    """Three crossed leaves, one of them put in beside its place: the change of the state solved for is the one told."""
    joint = CrossFlexure(STEEL, angle=0.8, widths=(0.03, 0.015), **SIZES)

    def draw():
        scene = ksd.Mechanism("assembly_error")
        table = scene.link("table")
        scene.join(scene.ground, table, joint, at=(0, 0, 0), axis="z", toward="x", name="joint0")
        scene.actuate_joint("joint0", name="drive")
        return scene

    estimated, expected = estimated_and_solved(draw, "joint0/outer_low", turn, assembly_error)
    assert estimated["joint0/outer_low", direction] == pytest.approx(expected, rel=2e-2)


def test_chains_tell_what_strain_modes_do():
    """Appendix A elements, stepped by a part of the misplacement, against the linear response of strain-mode leaves."""
    joint = CrossFlexure(STEEL, angle=0.8, widths=(0.03, 0.015), **SIZES)
    scene = ksd.Mechanism("both")
    table = scene.link("table")
    scene.join(scene.ground, table, joint, at=(0, 0, 0), axis="z", toward="x", name="joint0")
    scene.actuate_joint("joint0", name="drive")
    strain, chains = (
        ksd.prepare(scene, mesh=mesh)(drive=0.3, method="conventional").internal_stress(
            leaves=["joint0/inner"]
        )
        for mesh in (ksd.Mesh(), ksd.Mesh("corotational", elements=16))
    )
    assert chains.stress_Pa == pytest.approx(strain.stress_Pa, rel=0.02)
    assert chains.worst == strain.worst


def test_misplacing_costs_little_where_nothing_is_held_twice():
    """One cantilever leaf driven at its end is strained by no misplacement but that of what is driven."""
    one, two = guide(2), guide(3)
    along = [
        solved(g).internal_stress(leaves=("joint0/leaf0",)).stress_Pa["joint0/leaf0", "along"]
        for g in (one, two)
    ]
    assert along[0] < 0.05 * along[1]


def test_misaligned_guides_yield_in_the_full_model():
    one = ParallelGuide(STEEL, width=0.03, spacing=0.06, **SIZES)
    straight, bent = (solved(one, one, tilt=t, value=0.005, method="full") for t in (0.0, 2e-3))
    assert any("misaligned" in w for w in bent.warnings) and not straight.warnings
    # 2e-3 rad times 5 mm of stroke is 10 um that the two guides, four leaf springs, have to yield
    extra = bent.stress().largest_Pa - straight.stress().largest_Pa
    assert extra > 1e6 and bent.stable


def test_wrong_words():
    pose = solved(guide(2))
    with pytest.raises(SceneError, match="leaf 'low' is not part"):
        pose.internal_stress(leaves=("low",))
    with pytest.raises(SceneError, match="must be positive"):
        pose.internal_stress(offset=0.0)


@pytest.mark.parametrize("direction", ["along", "across", "tilt"])
def test_a_misplaced_end_of_a_curved_leaf(direction):
    """In the axes at that end, which the arc turns by 1 rad from those at the start, in which an assembly error is given."""
    word, size = ("turn", 1e-6) if direction == "tilt" else ("shift", 1e-7)
    c, n = np.cos(1.0), np.sin(1.0)
    error = size * np.array({"along": (c, n, 0), "across": (-n, c, 0), "tilt": (0, 0, 1)}[direction])

    def draw():
        scene = ksd.Mechanism("arcs", plane="xy")
        table = scene.link("table")
        for name, y in (("low", 0.0), ("high", 0.05)):
            scene.leaf(
                scene.ground, table, start=(0, y, 0), end=(0.1, y, 0), section=ksd.rectangle(5e-4, 0.02), material=STEEL,
                curve=ksd.Arc(radius=0.05 / np.sin(0.5), angle=1.0), name=name,
            )  # fmt: skip
        scene.actuate(table, along="y", at=(0.1, 0, 0), name="drive")
        return scene

    estimated, expected = estimated_and_solved(draw, "high", 0.0, {word: error})
    assert estimated["high", direction] == pytest.approx(expected, rel=1e-2)
