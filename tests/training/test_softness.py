"""Why the intended motion must be softer than the rest by the margin it must: what real joints have."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

import ksd
from ksd.errors import SceneError
from ksd.scene import DrawnJoint, Material, Motion
from ksd.scene.families.universal import UniversalJoint
from ksd.training.catalogue import FAMILY_DESIGNS, design_of
from ksd.training.designs import soften_leaves
from ksd.training.run import _corner_joints
from ksd.training.sampling import SamplingPlan, even_line, sample_joint
from ksd.training.softness import (
    FREEDOM_FALL,
    MAX_STIFFNESS_RATIO,
    SOFTENING_FACTOR,
    check_soft,
    intended_stiffnesses,
    rest_stiffness,
    softest_other,
    undeclared_freedom,
)

SINGLE = {"circular_notch": 0.87, "filleted_notch": 0.76, "arc_hinge": 0.66}


def share(joint):
    stiffness = rest_stiffness(joint)
    return max(intended_stiffnesses(joint, stiffness)) / softest_other(joint, stiffness)


def leaf(nu, width, *, held=True):
    """A single leaf of 100 mm, 1 mm thick, as a hinge; what else it leaves free is held by the mechanism around it."""
    blocks = {"A": (0, 0, 0), "B": (0.1, 0, 0)}
    one = ksd.Leaf(
        start=blocks["A"], end=blocks["B"], width_axis=(0, 0, 1), section=ksd.rectangle(1e-3, width),
        material=Material(E=200e9, nu=nu), name="only",
    )  # fmt: skip
    return DrawnJoint(
        "leaf", blocks=blocks, leaves=[one], motions=[Motion("angle", "rotation", (0, 0, 1), (-0.5, 0.5))],
        held_by_others=held,
    )  # fmt: skip


@pytest.mark.parametrize("name", list(FAMILY_DESIGNS))
def test_every_family_at_every_corner_of_its_shapes(name):
    most = max(share(joint) for joint in _corner_joints(design_of(name)))
    assert most < SINGLE.get(name, 0.03) < MAX_STIFFNESS_RATIO


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
def test_a_single_leaf_against_its_torsion(nu):
    """Wide: EI over GJ is (1 + nu)/2, raised a little by the finite width; below the margin from three to one on."""
    assert share(leaf(nu, 1.0)) == pytest.approx(0.5 * (1 + nu), rel=2e-3)
    assert share(leaf(nu, 3e-3)) < MAX_STIFFNESS_RATIO
    check_soft(leaf(nu, 3e-3))


def test_at_one_two_motions_change_places():
    """A bar as wide as thick has no soft motion of its own; wider than thick the other way, the wrong one is declared."""
    for width, least in ((1e-3, 1.0), (0.3e-3, 3.0)):
        assert share(leaf(0.3, width)) > least
        with pytest.raises(SceneError, match="'angle' is not the soft one: its stiffness"):
            check_soft(leaf(0.3, width))


def test_a_shape_at_the_end_of_its_range_is_named(tmp_path):
    """Soft in the middle of its range, not at its end."""

    def drawn(*, width):
        made = leaf(0.3, width)
        return DrawnJoint(
            "strip", blocks=made.blocks(), leaves=made.leaves(), motions=made.motions, shape={"width": width},
            held_by_others=True,
        )  # fmt: skip

    design = ksd.Design("strip", (ksd.library.Parameter("width", 0.5e-3, 10e-3),), drawn)
    assert share(drawn(width=5e-3)) < MAX_STIFFNESS_RATIO
    with pytest.raises(SceneError, match=r"not the soft one in the shape width = 0.0005"):
        ksd.train(design, out=tmp_path, progress=False)


@pytest.mark.parametrize("name", [name for name in FAMILY_DESIGNS if name not in SINGLE])
def test_every_family_of_several_leaves_has_the_freedoms_it_declares(name):
    """Softened to a quarter, freedoms fall to a quarter and constraints stay: there is nothing in between."""
    for joint in _corner_joints(design_of(name)):
        whole, soft = rest_stiffness(joint), rest_stiffness(soften_leaves(joint, SOFTENING_FACTOR))
        falls = np.sort(eigh(whole, soft, eigvals_only=True))[::-1]
        count = len(joint.motions)
        assert falls[:count].min() > 3.75 > FREEDOM_FALL > 1.02 > falls[count:].max()
        assert undeclared_freedom(joint, whole, soft) is None


def universal(keep, *, scale=1.0):
    """The two-axis universal joint with one axis declared; the leaf springs of the other `scale` times as thick."""
    whole = UniversalJoint(Material(E=200e9, G=76.9e9), length=0.1, thickness=5e-4, width=0.04)
    leaves = [
        replace(
            leaf,
            section=ksd.rectangle(
                (scale if leaf.name.startswith("second") else 1.0) * 5e-4, leaf.section.width
            ),
        )
        for leaf in whole.leaves()
    ]
    return DrawnJoint(
        "cardan", blocks=whole.blocks(), leaves=leaves, motions=[m for m in whole.motions if m.name in keep],
        length=whole.length,
    )  # fmt: skip


@pytest.mark.parametrize("keep, axis", [("about_z", "y"), ("about_y", "z")])
def test_a_second_soft_freedom_that_is_not_declared_is_refused(keep, axis, tmp_path):
    said = rf"another motion free that is not declared: a rotation about {axis} through \(.*\) m of .* Nm/rad, .* times"
    with pytest.raises(SceneError, match=said):
        ksd.train(universal([keep]), out=tmp_path, progress=False)
    check_soft(universal(["about_z", "about_y"]))


def test_how_much_stiffer_the_second_freedom_is_told():
    """Leaf springs n times as thick are n^3 times as stiff; from ten times on they are no freedom any more."""

    def second(scale):
        joint = universal(["about_z"], scale=scale)
        return undeclared_freedom(
            joint, rest_stiffness(joint), rest_stiffness(soften_leaves(joint, SOFTENING_FACTOR))
        )

    for scale in (2, 4):
        assert second(scale).ratio == pytest.approx(scale**3, rel=0.15)
    assert second(11) is None


def test_two_pivots_in_series_shift_aside(tmp_path):
    """Their second freedom is no rotation about another axis but a shift across the line of pivots."""
    one = ksd.CrossFlexure(
        Material(E=200e9, G=76.9e9), length=0.05, angle=math.radians(45), thickness=5e-4, widths=(0.02, 0.01)
    )
    first = [replace(leaf, end_block="middle", name=f"{leaf.name}_1") for leaf in one.leaves()]
    second = [
        replace(
            leaf, start_block="middle", name=f"{leaf.name}_2",
            start=(leaf.start[0] + 0.1, *leaf.start[1:]), end=(leaf.end[0] + 0.1, *leaf.end[1:]),
        )
        for leaf in one.leaves()
    ]  # fmt: skip
    end = (0.1 + one.pose_B[0], 0.0, 0.0)
    words = {"blocks": {"A": (0, 0, 0), "middle": one.pose_B, "B": end}, "leaves": first + second}
    turn = Motion("angle", "rotation", (0, 0, 1), (-0.5, 0.5))
    shift = Motion("shift", "translation", (0, 1, 0), (-0.01, 0.01))
    with pytest.raises(SceneError, match="not declared: a translation along y of"):
        check_soft(DrawnJoint("series", **words, motions=[turn]))
    check_soft(DrawnJoint("series", **words, motions=[turn, shift]))
    check_soft(DrawnJoint("series", **words, motions=[turn], held_by_others=True))


def test_a_single_leaf_says_what_else_it_leaves_free():
    with pytest.raises(
        SceneError, match=r"a rotation about x through .* 1\.52 times .* say held_by_others=True"
    ):
        check_soft(leaf(0.3, 0.05, held=False))


def test_wires_are_soft_both_ways():
    """Three wires side by side hold a plate along them and leave it free across: three freedoms, of which one is said."""
    wires = [
        ksd.Leaf(
            start=(0, y, z), end=(0.05, y, z), width_axis=(0, 0, 1), section=ksd.circle(1e-3),
            material=Material(E=200e9, nu=0.3), name=f"wire {k}",
        )
        for k, (y, z) in enumerate(((0.02, 0.0), (-0.01, 0.017), (-0.01, -0.017)))
    ]  # fmt: skip
    across = [
        Motion(axis, "translation", v, (-1e-3, 1e-3)) for axis, v in (("y", (0, 1, 0)), ("z", (0, 0, 1)))
    ]
    turn = Motion("turn", "rotation", (1, 0, 0), (-0.05, 0.05))
    words = {"blocks": {"A": (0, 0, 0), "B": (0.05, 0, 0)}, "leaves": wires}
    for said, left in (([*across], "a rotation about x"), ([across[0], turn], "a translation along z")):
        with pytest.raises(SceneError, match=f"not declared: {left}"):
            check_soft(DrawnJoint("wires", **words, motions=said))
    check_soft(DrawnJoint("wires", **words, motions=[*across, turn]))


def test_a_motion_that_turns_soft_on_the_way_is_refused():
    """The butterfly of little half angle and much inner leaf at 40 degrees: inside its range of 30 it stays 1.5 times."""
    joint = design_of("butterfly").make(inner_ratio=0.6, half_angle=math.radians(8))
    reach = math.radians(40)
    wide = DrawnJoint(
        "wide", blocks=joint.blocks(), leaves=joint.leaves(), length=joint.length,
        motions=[replace(joint.motions[0], range=(-reach, reach))],
    )  # fmt: skip
    plan = SamplingPlan(
        (even_line(-1, 1, 9),), ("strain",), (4, 3, 5), check_whole_stroke=True, refuse_collisions=False
    )
    with pytest.raises(
        SceneError, match=r"at angle = -0.6981 a rotation about .* is as soft as the intended motion"
    ):
        sample_joint(wide, plan)
