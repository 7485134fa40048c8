"""Preload, heat, assembly error and loads that leave the undeformed configuration no minimum: the answer says so, and which
minimum it is."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import STEEL

import ksd
from ksd.section import rectangle
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.undeformed_stability import multiple_minima_note, undeformed_instability

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
    start = replace(between, motion=between.motion._replace(x=bent.x, R=bent.R, inner=bent.inner))
    found = solve_conventional(between.model, {}, start=start)
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
            and not undeformed_instability(found.model)
            and multiple_minima_note(found.model, found.motion, True) == ""
        )


def test_rest_is_unstable_from_the_load_on_where_the_tangent_loses_its_sign():
    """Against the frequencies of the straight state, solved for with the preload: negative on one side only."""
    for stiffness in np.linspace(200.0, 1400.0, 7):
        straight = ksd.solve(column(float(stiffness)), strict=False)
        lowest = straight.frequencies(count=1).frequency_Hz[0]
        assert bool(undeformed_instability(straight.model)) == (lowest < 0.0)


IRON = ksd.Material(E=200e9, G=76.9e9, density=7800, expansion=12e-6)


def guided(cause, share):
    """A leaf along x whose tip can only move along y, pressed by `share` of its critical load, 4 pi^2 EI / (2 L)^2."""
    scene, section = ksd.Mechanism("guided"), rectangle(0.5e-3, 0.02)
    tip = scene.link("tip", at=(L, 0, 0))
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(L, 0, 0), section=section, material=IRON, width_axis=(0, 0, 1), name="leaf",
    )  # fmt: skip
    scene.support(tip, about="z", name="upright")
    if cause != "loads":
        scene.support(tip, along="x", at=(L, 0, 0), name="held")
    strain = share * np.pi**2 * section.Iz / (section.A * L**2)
    if cause == "heat":
        scene.heat(strain / IRON.expansion)
    elif cause == "fit":
        scene.fit("leaf", natural_length=L * (1 + strain))
    else:
        scene.load(tip, force=(-strain * IRON.E * section.A, 0, 0), at=(L, 0, 0))
    return scene


SAID = {
    "heat": "heat makes the undeformed configuration unstable in one direction ('tip' moves along y)",
    "fit": "the assembly error of 'leaf' makes the undeformed configuration unstable in one direction ('tip' moves along y)",
    "loads": "loads make the undeformed configuration unstable in one direction ('tip' moves along y)",
}


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(
    ("cause", "share", "far"), [("heat", 3.5, 1e-3), ("fit", 3.5, 1e-3), ("loads", 1.002, 8e-3)]
)
def test_of_heat_assembly_error_and_loads_too(cause, share, far, side):
    """Led aside by a drive and let go, beyond the critical load; below it nothing is said."""
    scene, words = guided(cause, share), {"mesh": ksd.Mesh(orders=(4, 3, 7), points=9)}
    with pytest.raises(ksd.TrustError, match="several minima are near, and this state is between them"):
        ksd.solve(scene, **words)
    led = guided(cause, share)
    led.actuate("tip", along="y", at=(L, 0, 0), name="aside")
    driven = ksd.solve(led, aside=side * far, method="conventional", **words)
    between = ksd.solve(scene, strict=False, **words)
    x, R, inner, rows, _ = driven.motion
    start = replace(between, motion=between.motion._replace(x=x, R=R, inner=inner, multiplier=rows[1:]))
    found = solve_conventional(between.model, {}, start=start)
    aside = 1e3 * found.links["tip"][0][1]
    said = [w for w in found.warnings if "several minima are near" in w]
    assert found.stable and aside * side > 0.3 * 1e3 * far
    assert said == [
        f"{SAID[cause]}: several minima are near; taken is the one with 'tip' {aside:+.3g} mm along y"
    ]
    assert not [w for w in ksd.solve(guided(cause, 0.95)).warnings if "minima" in w]


def test_what_buckles_within_leaves():
    """Both ends held, a hot leaf bows at four times the load at which it would sway."""
    for share, unstable in ((3.9, False), (4.1, True)):
        scene = guided("heat", share)
        scene.support("tip", along="y", at=(L, 0, 0), name="beside")
        said = " ".join(ksd.solve(scene, strict=False).warnings)
        assert (
            "heat makes the undeformed configuration unstable in one direction (within leaf springs)" in said
        ) == unstable


def test_preload_is_looked_at_without_the_loads_that_hold_it():
    """Pulled twice as hard as its spring pushes the column is straight and stable; without that load it is not."""
    scene = column(1000.0)
    scene.load("tip", force=(20.0, 0, 0), at=(L, 0, 0))
    found = ksd.solve(scene)
    assert found.stable and [rest.count for rest in undeformed_instability(found.model)] == [1]
