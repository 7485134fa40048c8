"""Motion in time of leaf springs with their mass at their ends."""

import warnings

import numpy as np
import pytest
from scenes import STEEL, fourbar

import ksd
from ksd.solvers.mass_at_ends import with_mass_at_ends
from ksd.solvers.motion_record import missing_energy

FREE = {"drives": {"top": None}, "loads": {"push": ksd.Ramp(0.05)}}


def pushed(payload=2.0):
    """The fourbar of cross flexures with a payload [kg] on its top, which is pushed along x and out of its plane."""
    scene = fourbar()
    scene.mass("top", mass=payload, inertia=(0.01 * payload,) * 3, at=(0, 0.37, 0))
    scene.load("top", force=(50, 0, 10), at=(0, 0.37, 0), name="push")
    return scene


def test_light_leaf_springs_move_their_load_as_with_their_own_inertia():
    """The error falls with the share of their mass; it is there, so that the word does something."""
    off = []
    for payload in (2.0, 20.0):
        light, whole = (
            ksd.simulate(pushed(payload), 0.1, dt=2e-3, mass_at_ends=word, **FREE)["top"].position
            for word in (True, False)
        )
        off.append(np.abs(light - whole).max() / np.ptp(whole, axis=0).max())
    assert 2e-4 < off[0] < 2e-3
    assert off[0] / off[1] == pytest.approx(10.0, rel=0.3)


def test_mass_at_the_ends_keeps_mass_and_centre():
    scene = pushed()
    tip = scene.link("tip")
    blade = {"section": ksd.rectangle(5e-4, 0.01), "material": STEEL, "width_axis": "z"}
    leaf = scene.leaf("top", tip, start=(0.1, 0.4, 0), end=(0.1, 0.5, 0), name="whip", **blade)
    scene.point(leaf, 0.03, name="middle")
    frozen = scene.scene()
    found = with_mass_at_ends(frozen)
    leaves = frozen.leaf_names()
    joints = sum(f.material.density * f.section.A * f.length for name, f in leaves.items() if name != "whip")
    whip = STEEL.density * 5e-6 * 0.1
    # half of two of the four joints stands on ground, which does not move
    assert sum(m.mass for m in found.masses) == pytest.approx(2.0 + 0.75 * joints + whip, rel=1e-12)
    by_link = {n: sum(m.mass for m in found.masses if m.link == n) for n in frozen.links}
    assert by_link["tip"] == pytest.approx(0.35 * whip, rel=1e-12)
    assert by_link["middle"] == pytest.approx(0.5 * whip, rel=1e-12)
    assert by_link["ground"] == 0.0
    own = [m for m in found.masses if m.link in ("tip", "middle")]
    centre = sum(m.mass * np.array(m.at) for m in own) / sum(m.mass for m in own)
    assert centre == pytest.approx([0.1, 0.4 + (0.35 * 0.1 + 0.5 * 0.03) / 0.85, 0.0])
    assert all(leaf.material.density is None for leaf in found.leaf_names().values())


def test_ends_on_internal_blocks_count_on_both_links():
    scene, _, _ = ksd.load_scene("arm")
    frozen = scene.scene()
    own = sum(f.material.density * f.section.A * f.length for f in frozen.leaf_names().values())
    found = with_mass_at_ends(frozen)
    total = sum(m.mass for m in found.masses)
    # the three joints are alike, and half of the first one, by symmetry, is on ground
    assert total == pytest.approx(own * 5 / 6, rel=1e-9)


@pytest.mark.parametrize(
    ("profile", "thickness"),
    [
        (ksd.Taper(thickness=(5e-4, 1e-4), width=(0.01, 0.01)), lambda s: 5e-4 - 4e-4 * s),
        (None, lambda s: 5e-4 + 0.0 * s),
    ],
)
def test_a_tapered_leaf_spring_keeps_its_centre(profile, thickness):
    scene = ksd.Mechanism("blade")
    tip = scene.link("tip")
    base = scene.link("base")
    foot = {"section": ksd.rectangle(1e-3, 0.01), "material": ksd.Material(E=200e9, nu=0.3)}
    scene.leaf("ground", base, start=(-0.01, 0, 0), end=(0, 0, 0), name="foot", **foot)
    blade = {"section": ksd.rectangle(5e-4, 0.01), "material": STEEL, "width_axis": "z", "profile": profile}
    scene.leaf(base, tip, start=(0, 0, 0), end=(0.1, 0, 0), name="blade", **blade)
    own = with_mass_at_ends(scene.scene()).masses
    s = (np.arange(1000) + 0.5) / 1000
    line = STEEL.density * 0.01 * thickness(s) * 0.1 / 1000
    assert sum(m.mass for m in own) == pytest.approx(line.sum(), rel=1e-6)
    assert sum(m.mass * m.at[0] for m in own) == pytest.approx(0.1 * (line @ s), rel=1e-6)


def test_an_equilibrium_in_gravity_stays_where_it_is():
    scene = pushed()
    scene.gravity = (0, -9.81, 0)
    words = {"dt": 1e-3, "mass_at_ends": True, "loads": {"push": 1.0}}
    history = ksd.simulate(scene, 0.02, **words)
    assert np.abs(history["top"].velocity).max() < 1e-8
    # where nothing moves, nothing is said of speeds and energies that are rounding
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        later = ksd.simulate(scene, 0.02, start=history[0.02], **words)
        ksd.simulate(scene, 0.02, start=history[0.02], **(words | {"mass_at_ends": False}))
    assert later["top"].position[-1] == pytest.approx(history["top"].position[0], abs=1e-10)


def test_steps_and_files_know_the_word(tmp_path):
    scene = pushed()
    step = ksd.stepper(scene, longest=2e-3, mass_at_ends=True, **FREE)
    state = step(step.start, {}, 0.02)
    whole = ksd.simulate(scene, 0.02, dt=2e-3, mass_at_ends=True, **FREE)
    assert state.pose.motion.x == pytest.approx(whole[0.02].motion.x, abs=1e-6)
    scene.simulation = ksd.Simulation(until=0.02, dt=2e-3, mass_at_ends=True, **FREE)
    ksd.save_scene(scene, tmp_path / "pushed.toml")
    again, _, _ = ksd.load_scene(tmp_path / "pushed.toml")
    assert ksd.simulate(again)["top"].position == pytest.approx(whole["top"].position, abs=1e-12)


def test_what_it_changes_is_said():
    with pytest.warns(ksd.SceneWarning, match=r"the lowest frequency is [+-][\d.]+ % off at the start"):
        ksd.simulate(pushed(0.05), 2e-3, dt=1e-3, mass_at_ends=True, **FREE)


def test_loss_factors_are_refused():
    lossy = ksd.Material(E=200e9, G=76.9e9, density=7800, loss_factor=0.01)
    cross = ksd.CrossFlexure(lossy, length=0.1, angle=np.pi / 4, thickness=1e-3, widths=(0.04, 0.02))
    with pytest.raises(ksd.SceneError, match="has a loss factor, which mass_at_ends leaves out"):
        ksd.simulate(ksd.Mechanism.of_joint(cross), 0.01, dt=1e-3, mass_at_ends=True, damping_at=5.0)
    with pytest.raises(ksd.SceneError, match="mass_at_ends"):
        ksd.simulate(pushed(), 0.01, dt=1e-3, mass_at_ends="yes")


def test_loads_along_leaf_springs_and_poses_of_another_mechanism_are_refused():
    scene = ksd.Mechanism("strip")
    tip = scene.link("tip", mass=0.1, inertia=(1e-4,) * 3, at=(0.1, 0, 0))
    section = ksd.rectangle(1e-3, 0.01)
    leaf = scene.leaf("ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), section=section, material=STEEL)
    pose = ksd.solve(scene)
    for word in (False, True):
        with pytest.raises(ksd.SceneError, match="start is a pose of another mechanism"):
            ksd.simulate(pushed(), 0.01, dt=1e-3, start=pose, mass_at_ends=word)
    scene.line_load(leaf, force=(0, 1.0, 0), name="snow")
    with pytest.raises(ksd.SceneError, match="line load 'snow' acts on the inertia of leaf"):
        ksd.simulate(scene, 0.01, dt=1e-3, mass_at_ends=True)


def test_energy_is_missing_where_something_moves_beside_much_preload():
    none, ramp = np.zeros(3), np.array([0.0, 0.5, 1.0])
    rest = {"kinetic": none, "gravity": none, "work": none, "damped": none}
    moves = {"strain": 1.0 + 1e-4 * ramp, "lost": -5e-6 * ramp}
    assert "J are missing" in missing_energy(rest | moves, 0.0)[0]
    assert missing_energy(rest | {"strain": 1.0 + 5e-6 * ramp, "lost": -3e-6 * ramp}, 0.0) == []


def test_drawn_joints_keep_their_other_numbers():
    leaf = ksd.Leaf(
        start=(0, 0, 0), end=(0.04, 0, 0), width_axis="z", section=ksd.rectangle(3e-4, 0.01), material=STEEL
    )
    turn = ksd.Motion("turn", "rotation", "z", (-0.2, 0.2))
    blocks = {"A": (0, 0, 0), "B": (0.04, 0, 0)}
    joint = ksd.DrawnJoint("blade", blocks=blocks, leaves=[leaf], motions=[turn], held_by_others=True)
    light = joint.without_mass()
    assert light.leaves()[0].material.density is None
    assert joint.leaves()[0].material.density == STEEL.density
    assert light.leaves()[0].material.E == STEEL.E
    assert light.motions == joint.motions
