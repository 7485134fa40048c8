"""Why the intended motion must be softer than the rest by the margin it must: what real joints have."""

import pytest

import ksd
from ksd.errors import SceneError
from ksd.scene import DrawnJoint, Material, Motion
from ksd.train.catalogue import ENTRIES
from ksd.train.designs import design_of
from ksd.train.run import _corners
from ksd.train.softness import MARGIN, check_soft, softness

SINGLE = {"circular_notch": 0.87, "filleted_notch": 0.76, "arc_hinge": 0.66}


def share(joint):
    return max(own / left for _, own, left in softness(joint))


def leaf(nu, width):
    """A single leaf of 100 mm, 1 mm thick, as a hinge."""
    blocks = {"A": (0, 0, 0), "B": (0.1, 0, 0)}
    one = ksd.Leaf(
        start=blocks["A"], end=blocks["B"], width_axis=(0, 0, 1), section=ksd.rectangle(1e-3, width),
        material=Material(E=200e9, nu=nu), name="only",
    )  # fmt: skip
    return DrawnJoint(
        "leaf", blocks=blocks, leafs=[one], motions=[Motion("angle", "rotation", (0, 0, 1), (-0.5, 0.5))]
    )


@pytest.mark.parametrize("name", list(ENTRIES))
def test_every_family_at_every_corner_of_its_shapes(name):
    most = max(share(joint) for joint in _corners(design_of(name)))
    assert most < SINGLE.get(name, 0.03) < MARGIN


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
def test_a_single_leaf_against_its_torsion(nu):
    """Wide: EI over GJ is (1 + nu)/2, raised a little by the finite width; below the margin from three to one on."""
    assert share(leaf(nu, 1.0)) == pytest.approx(0.5 * (1 + nu), rel=2e-3)
    assert share(leaf(nu, 3e-3)) < MARGIN
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
            "strip", blocks=made.blocks(), leafs=made.leafs(), motions=made.motions, shape={"width": width}
        )

    design = ksd.train.Design("strip", (ksd.library.Parameter("width", 0.5e-3, 10e-3),), drawn)
    assert share(drawn(width=5e-3)) < MARGIN
    with pytest.raises(SceneError, match=r"not the soft one in the shape width = 0.0005"):
        ksd.train(design, out=tmp_path, progress=False)
