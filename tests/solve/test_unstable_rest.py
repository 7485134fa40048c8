"""Springs preloaded so far that the undeformed configuration is no minimum: the answer says so, and which minimum it is."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import STEEL

import ksd
from ksd.model.arrays import Motion
from ksd.section import rectangle
from ksd.solve.conventional import conventional
from ksd.solve.rest import minimum_taken, unstable_rest

L = 0.1


def column(stiffness, *, squeezed=0.01):
    """A leaf along x whose tip a coil spring in line with it pushes back with stiffness * squeezed [N]."""
    scene = ksd.Mechanism("column")
    tip = scene.link("tip", mass=0.1, inertia=(1e-5, 1e-5, 1e-5), at=(L, 0, 0))
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(L, 0, 0), section=rectangle(0.5e-3, 0.02), material=STEEL,
        width_axis=(0, 0, 1), name="leaf",
    )  # fmt: skip
    scene.spring(
        tip,
        scene.ground,
        start=(L, 0, 0),
        end=(L + 0.2, 0, 0),
        stiffness=stiffness,
        free_length=0.2 + squeezed,
        name="push",
    )
    return scene


@pytest.mark.parametrize("way", [0.03, -0.03])
def test_the_answer_says_which_of_several_minima_it_is(way):
    """Led aside by a drive and let go, the column stays on that side."""
    free, led = column(1000.0), column(1000.0)
    led.actuate("tip", along="y", at=(L, 0, 0), name="aside")
    bent = ksd.solve(led, aside=way, method="conventional").motion
    between = ksd.solve(free, strict=False)
    start = replace(between, motion=Motion(bent.x, bent.R, bent.inner, np.zeros(0)))
    found = conventional(between.model, {}, start=start)
    aside = 1e3 * found.links["tip"][0][1]
    assert found.trusted and aside * way > 0 and abs(aside) > 10
    said = [w for w in found.warnings if "several minima are near" in w]
    assert (
        len(said) == 1
        and "preload of spring 'push' makes the undeformed configuration unstable in one direction" in said[0]
    )
    assert said[0].endswith(
        f"('tip' moves along y): several minima are near; taken is the one with 'tip' {aside:+.3g} mm along y"
    )
    assert "several minima are near" in " ".join(str(found).split())


def test_the_state_between_the_minima_is_refused_and_says_so():
    with pytest.raises(
        ksd.TrustError, match=r"UNSTABLE.*several minima are near, and this state is between them"
    ):
        ksd.solve(column(1000.0))


def test_springs_that_leave_rest_stable_are_not_spoken_of():
    """Below the critical load of the leaf and its spring, without preload, and pulled."""
    for scene in (column(100.0), column(1000.0, squeezed=0.0), column(1000.0, squeezed=-0.01)):
        found = ksd.solve(scene)
        assert (
            found.trusted
            and not unstable_rest(found.model)
            and minimum_taken(found.model, found.motion, True) == ""
        )


def test_rest_is_unstable_from_the_load_on_where_the_tangent_loses_its_sign():
    """Against the frequencies of the straight state, solved for with the preload: negative on one side only."""
    for stiffness in np.linspace(200.0, 1400.0, 7):
        straight = ksd.solve(column(float(stiffness)), strict=False)
        lowest = straight.frequencies(count=1).frequency_Hz[0]
        assert bool(unstable_rest(straight.model)) == (lowest < 0.0)
