"""Leaves that pass through windows of each other: how large the windows have to be, and what no window makes way for."""

import math
from dataclasses import replace

import pytest

import ksd
from ksd.errors import SceneError
from ksd.scene import DrawnJoint, Material
from ksd.training.catalogue import design_of
from ksd.training.sampling import SamplingPlan, _driven_model, _solve_grid, even_line, sample_joint
from ksd.training.stroke_checks import MAX_WINDOW_SHARE, largest_window, window_shares

STEEL = Material(E=200e9, G=76.9e9)


def plan_of(joint, count=5):
    return SamplingPlan(
        tuple(even_line(*m.range, count) for m in joint.motions),
        ("strain",),
        (4, 3, 5),
        check_whole_stroke=True,
    )


def openings(joint):
    plan = plan_of(joint)
    return window_shares(joint, _solve_grid(joint, _driven_model(joint, "strain", plan), plan, "strain"))


def pivot(*, angle=60, ratio=0.5):
    return ksd.CrossedPivot(
        STEEL, length=0.1, angle=math.radians(angle), thickness=5e-4, width=0.04, ratio=ratio
    )


def drawn(joint, *, degrees=30, change=lambda leaf: leaf):
    reach = math.radians(degrees)
    motion = replace(joint.motions[0], range=(-reach, reach))
    leaves = [change(leaf) for leaf in joint.leaves()]
    return DrawnJoint(
        "mine", blocks=joint.blocks(), leaves=leaves, motions=[motion], length=joint.length, windows=True
    )


@pytest.mark.parametrize("angle", [30, 60])
@pytest.mark.parametrize("ratio", [-0.25, 0.0, 0.1, 0.35, 0.5, 1.25])
def test_the_windows_of_crossed_pivots_are_small(angle, ratio):
    """Half the width over the length the crossing wanders; none where the leaves meet in the clamp or on their extension."""
    found = openings(pivot(angle=angle, ratio=ratio))
    assert largest_window(found)[1] < 0.16 < MAX_WINDOW_SHARE
    assert bool(found) == (0.05 < ratio < 0.95)


def test_the_windows_of_the_3x_infinity_hinge_are_small():
    leaf, share, others = largest_window(openings(design_of("triple_infinity_hinge").make()))
    assert leaf.startswith("fold_2") and "bar" in others
    assert 0.1 < share < 0.2 < MAX_WINDOW_SHARE


def test_windows_that_take_much_of_a_leaf_are_refused():
    """Leaf springs that cross at 20 degrees slide far along each other."""
    flat = drawn(pivot(angle=80), degrees=30)
    with pytest.raises(
        SceneError, match=r"windows of leaf 'rising' for 'falling' would take \d\d% of its area over the"
    ):
        sample_joint(flat, plan_of(flat))


def test_leaves_that_meet_at_an_edge_are_refused():
    """Shifted by half a width the falling leaf sticks out of the rising one."""

    def aside(leaf):
        z = 0.02 if leaf.name == "falling" else 0.0
        return replace(leaf, start=(*leaf.start[:2], z), end=(*leaf.end[:2], z))

    shifted = drawn(pivot(), change=aside)
    assert shifted.windows
    with pytest.raises(
        SceneError, match="'rising' and 'falling' run into each other at an edge, where no window"
    ):
        openings(shifted)


def test_leaves_beside_each_other_need_no_window():
    def apart(leaf):
        z = 0.021 if leaf.name == "falling" else -0.021
        return replace(leaf, start=(*leaf.start[:2], z), end=(*leaf.end[:2], z))

    assert openings(drawn(pivot(), change=apart)) == {}
