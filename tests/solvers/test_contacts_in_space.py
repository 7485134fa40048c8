"""Contact in space against exact rods by shooting and finite elements (section F of the acceptance numbers)."""

import numpy as np
import pytest

import ksd

STEEL = ksd.Material(E=200e9, G=200e9 / 2.6)


def pad(shape, at, *, friction=0.0):
    """A leaf spring along x with a rigid plane on its tip, 1 mm above its centreline, under a driven body."""
    scene = ksd.Mechanism("pad")
    tip, body = scene.links("tip", "object")
    section = ksd.rectangle(0.5e-3, 0.01)
    scene.leaf(
        "ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), section=section, material=STEEL, width_axis="z"
    )
    for along in "xyz":
        scene.actuate(body, along=along, at=at, name=along)
        scene.support(body, about=along)
    face = scene.surface(tip, ksd.shapes.wall(), at=(0.1, 1e-3, 0), axis="y")
    scene.contact(face, scene.surface(body, shape, at=at), friction=friction, name="c")
    return scene


VERTEX = 0.1 + 17.667161e-3, 1e-3, 1.468316e-3
"""The lowest vertex of a turned box of 40 x 20 x 30 mm over the tip, which touches the pad."""


@pytest.mark.parametrize(
    ("shape", "at", "down", "N", "force", "place"),
    [
        (ksd.shapes.ball(0.02), (0.1, 0.021, 0), 0.01, 0.661870, (0.0992995, 0.654379, 0), (0.0969994, -0.0087736, 0)),
        (
            ksd.shapes.ball(0.02), (0.1, 0.021, 0.004), 0.01, 0.659604, (0.0986409, 0.652164, 0.00538642),
            (0.0970091, -0.0087744, 0.0038367),
        ),
        (ksd.shapes.point(), VERTEX, 0.008, 0.306426, (0.0305391, 0.304900, 0.00044428), (0.1176672, -0.007, 0.0014683)),
    ],
)  # fmt: skip
def test_a_body_pressed_on_a_pad(shape, at, down, N, force, place):
    pose = ksd.solve(pad(shape, at), x=0.0, y=-down, z=0.0)
    found = pose.contacts["c"]
    assert pytest.approx(N, rel=1e-5) == found.N
    assert found.force == pytest.approx(force, rel=1e-4, abs=1e-7)
    assert found.place == pytest.approx(place, abs=1e-7)
    assert pose.steps[0].iterations <= 5


def test_a_ball_that_slides_over_a_pad_with_friction():
    """Slip is first order in the steps: the transverse force is 1 % off with 10 of them, the others are right."""
    scene = pad(ksd.shapes.ball(0.02), (0.1, 0.021, -0.002), friction=0.3)
    found = ksd.walk(scene, [{"x": 0.0, "y": -0.005, "z": 0.006}], steps=10)[-1].contacts["c"]
    assert found.state == "slip" and pytest.approx(0.321231, rel=1e-4) == found.N
    assert np.linalg.norm(found.T) == pytest.approx(0.3 * found.N, rel=1e-9)
    assert np.linalg.norm(found.force) == pytest.approx(
        np.linalg.norm((0.0204702, 0.320981, -0.0950185)), rel=1e-4
    )
    assert found.force == pytest.approx((0.0204702, 0.320981, -0.0950185), abs=0.012 * 0.0204702 + 1e-5)
    assert found.place == pytest.approx((0.0985019, -0.0039437, 0.0039202), abs=1e-6)
