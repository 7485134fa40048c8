"""Sweeps and gradients of mechanisms with stops, cables and contacts: every row is that of `ksd.solve`."""

import numpy as np
import pytest
from scipy.optimize import brentq

import ksd
from ksd.units import GPa, deg, mm

STEEL = ksd.Material(E=200 * GPa, nu=0.3, density=7800)
LENGTH = 60 * mm


def cantilever(E=STEEL.E, thickness=0.3 * mm):
    """A leaf spring along x with its end driven across: the mechanism and the link at its end."""
    scene = ksd.Mechanism("cantilever", plane="xy")
    tip = scene.link("tip")
    section, material = ksd.rectangle(thickness, 10 * mm), ksd.Material(E=E, nu=0.3, density=7800)
    scene.leaf("ground", tip, start=(0, 0, 0), end=(LENGTH, 0, 0), section=section, material=material)
    scene.actuate(tip, along="y", at=(LENGTH, 0, 0), name="push")
    return scene, tip


def blade(*, E=STEEL.E, thickness=0.3 * mm, **stop):
    """A leaf spring with a mass on its end, and what stops the turn of that."""
    scene, tip = cantilever(E, thickness)
    scene.mass(tip, mass=0.1, at=(LENGTH, 0, 0))
    scene.stop(tip, about="z", name="end", **stop)
    return scene


def test_rows_are_those_of_single_solves_with_what_the_stop_holds():
    scene, strokes = blade(high=1 * deg), [0.2 * mm, 1 * mm, 2 * mm]
    asked = ("force", "stress", "support_stiffness", "frequencies", "energy")
    table = ksd.sweep(scene, push=strokes, questions=asked, freed="push", progress=False)
    conventional = ksd.sweep(scene, push=strokes, questions="force", method="conventional", progress=False)
    assert conventional["end.high_moment_Nm"] == pytest.approx(table["end.high_moment_Nm"], rel=1e-9)
    assert set(table["status"]) == {"ok"}
    assert table["end.high_moment_Nm"][0] == 0.0 and (table["end.high_moment_Nm"][1:] > 0.0).all()
    for k, stroke in enumerate(strokes):
        pose = ksd.solve(scene, push=stroke)
        assert table["push_force_N"][k] == pytest.approx(pose.forces["push"], rel=1e-9)
        assert table["end.high_moment_Nm"][k] == pytest.approx(pose.stops["end.high"].force, rel=1e-9)
        assert table["stress_MPa"][k] == pytest.approx(1e-6 * pose.stress().largest_Pa, rel=1e-9)
        assert table["support_x_N_per_m"][k] == pytest.approx(
            pose.stiffness("tip", at=(LENGTH, 0, 0)).supports["x"], rel=1e-6
        )
        assert table["intended_Hz"][k] == pytest.approx(
            pose.frequencies(freed="push").frequency_Hz[0], rel=1e-6
        )
    # a clamped beam, its end free to turn and held: 3 and 12 EI/L^3
    bending = STEEL.E * ksd.rectangle(0.3 * mm, 10 * mm).Iz
    ratio = (table["intended_Hz"][2] / table["intended_Hz"][0]) ** 2
    assert ratio == pytest.approx(4.0, rel=2e-2)
    assert table["push_force_N"][0] == pytest.approx(3 * bending / LENGTH**3 * strokes[0], rel=1e-3)


def test_a_soft_stop_answers_forces_and_says_why_nothing_else():
    scene = blade(high=1 * deg, softness=1e-3)
    table = ksd.sweep(scene, push=[0.2 * mm, 2 * mm], questions=("force", "stress"), progress=False)
    assert table["status"][0] == "ok" and "'end' acts here and is soft" in table["status"][1]
    pose = ksd.solve(scene, push=2 * mm)
    assert table["end.high_moment_Nm"][1] == pytest.approx(pose.stops["end.high"].force, rel=1e-9)
    assert np.isnan(table["stress_MPa"][1])
    assert set(ksd.sweep(scene, push=[2 * mm], questions="force", progress=False)["status"]) == {"ok"}


def finger(*, E=STEEL.E):
    """A leaf spring pulled by a tendon on one side, and with a pad that rubs on a wall on the other."""
    scene, tip = cantilever(E)
    scene.cable("ground", tip, start=(0, 40 * mm, 0), end=(LENGTH, 0, 0), stiffness=1e3, name="tendon")
    pad = scene.surface(tip, ksd.shapes.disc(2 * mm), at=(LENGTH + 10 * mm, 0, 0))
    wall = scene.surface("ground", ksd.shapes.wall(), at=(LENGTH, 8 * mm, 0), axis=(0, -1, 0))
    scene.contact(pad, wall, friction=0.2, name="grip")
    return scene


def test_cables_and_contacts_have_columns():
    scene = finger()
    table = ksd.sweep(scene, push=[-2 * mm, 2 * mm, 5 * mm], questions="force", progress=False)
    for k, stroke in enumerate((-2 * mm, 2 * mm, 5 * mm)):
        pose = ksd.solve(scene, push=stroke)
        assert table["tendon_tension_N"][k] == pytest.approx(pose.cables["tendon"].force, rel=1e-9)
        grip = pose.contacts["grip"]
        found = [table[f"grip_{kind}_N"][k] for kind in ("normal", "friction")]
        assert found == pytest.approx([grip.N, np.linalg.norm(grip.T)], rel=1e-9, abs=1e-12)
    assert table["tendon_tension_N"][0] > 0.0 == table["tendon_tension_N"][1]


def test_forces_are_proportional_to_the_modulus_and_their_slope_by_a_drive_is_its_stiffness():
    """Under prescribed motions every force of a mechanism of one material is: of stops, of contacts that slip too."""
    found = ksd.gradient(lambda E: blade(E=E, high=1 * deg), {"E": STEEL.E}, questions="force", push=2 * mm)
    for column in ("push_force_N", "end.high_moment_Nm"):
        assert STEEL.E * found[column, "E"] == pytest.approx(found.values[column], rel=1e-6)
    scene = blade(high=1 * deg)
    by_drive = ksd.gradient(scene, questions=("force", "stress"), push=2 * mm)
    pose = ksd.solve(scene, push=2 * mm)
    assert by_drive["push_force_N", "push"] == pytest.approx(pose.drive_stiffness()["push"], rel=1e-6)
    assert by_drive["stress_MPa", "push"][0] > 0.0
    rubbing = ksd.gradient(lambda E: finger(E=E), {"E": STEEL.E}, questions="force", push=5 * mm)
    for column in ("grip_normal_N", "grip_friction_N"):
        assert rubbing.values[column][0] > 0.0
        assert STEEL.E * rubbing[column, "E"] == pytest.approx(rubbing.values[column], rel=1e-5)


def test_a_stop_that_closes_within_the_difference_has_no_gradient():
    scene, touch = blade(high=1 * deg), 0.0
    low, high = 0.2 * mm, 2 * mm
    while high - low > 1e-6 * mm:
        touch = 0.5 * (low + high)
        low, high = (
            (touch, high) if ksd.solve(scene, push=touch).stops["end.high"].force == 0.0 else (low, touch)
        )
    with pytest.raises(ksd.ConvergenceError, match=r"no gradient by 'push': 'end\.high' opens, closes"):
        ksd.gradient(scene, questions="force", push=touch)


def test_a_job_knows_what_a_stop_pushes_with():
    """The moment grows with the cube of the thickness, the stress with the thickness, so that its limit is active."""

    def design(thickness):
        return blade(high=1 * deg, thickness=thickness)

    job = ksd.Job(design, push=2 * mm, vary={"thickness": (0.2 * mm, 0.8 * mm)}, maximise="end.high_moment_Nm",
                  limits={"stress_MPa": 150})  # fmt: skip
    best = ksd.optimise(job, progress=False)
    at = brentq(
        lambda t: 1e-6 * ksd.solve(design(t), push=2 * mm).stress().largest_Pa - 150, 0.2 * mm, 0.8 * mm
    )
    assert best.status == "optimum" and best.design["thickness"] == pytest.approx(at, rel=1e-5)
    assert sum(w for name, w in best.held.items() if name.startswith("stress")) == pytest.approx(
        3.0, rel=0.02
    )


@pytest.mark.parametrize("on_leaf", [False, True])
@pytest.mark.parametrize("order", [1, -1])
def test_modes_are_followed_anew_where_a_contact_opens_or_closes(on_leaf, order):
    """A closed contact has an unknown of its own, and cuts the leaf spring that it is on."""
    scene = ksd.Mechanism("touched", plane="xy")
    tip, block = scene.links("tip", "block")
    words = {"section": ksd.rectangle(0.5 * mm, 10 * mm), "material": STEEL}
    scene.leaf("ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), name="leaf", **words)
    scene.leaf("ground", block, start=(0, 0.1, 0), end=(0.06, 0.1, 0), name="other", **words)
    scene.actuate(block, along="y", at=(0.06, 20.25 * mm, 0), name="y")
    disc = scene.surface(block, ksd.shapes.disc(20 * mm), at=(0.06, 20.25 * mm, 0))
    below = "leaf" if on_leaf else scene.surface(tip, ksd.shapes.disc(5 * mm), at=(0.06, -4.75 * mm, 0))
    scene.contact(below, disc, name="c")
    strokes = [-8 * mm, -4 * mm, 1 * mm, 2 * mm][::order]
    table = ksd.sweep(scene, y=strokes, questions="frequencies", freed="y", progress=False)
    assert set(table["status"]) == {"ok"}
    modes = [ksd.solve(scene, y=y).frequencies(freed="y") for y in strokes]
    assert table["first_parasitic_Hz"] == pytest.approx(
        [m.frequency_Hz[m.first_parasitic] for m in modes], rel=1e-6
    )
    with pytest.raises(ksd.SceneError, match="closed contacts"):
        modes[0].mac(modes[-1])
