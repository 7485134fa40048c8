"""`ksd.simulate` from Python, files and the command line, starts from an instant, and steps one after another."""

import json
import re
import warnings

import numpy as np
import pytest
from scenes import STEEL

import ksd
from ksd.cli import main
from ksd.errors import SceneError, SceneFileError
from ksd.units import mm

FILE = """
name = "guide"
plane = "xy"
links = ["stage"]
[material.steel]
E = "200 GPa"
nu = 0.3
density = 7800
[[leaf]]
a = "ground"
b = "stage"
start = [0, 0, 0]
end = [0, "60 mm", 0]
thickness = "0.3 mm"
width = "20 mm"
material = "steel"
[[leaf]]
a = "ground"
b = "stage"
start = ["50 mm", 0, 0]
end = ["50 mm", "60 mm", 0]
thickness = "0.3 mm"
width = "20 mm"
material = "steel"
[[mass]]
link = "stage"
mass = "500 g"
at = ["25 mm", "60 mm", 0]
[[actuate]]
link = "stage"
along = "x"
at = ["25 mm", "60 mm", 0]
name = "push"
[[load]]
link = "stage"
force = ["5 N", 0, 0]
name = "hit"
at = ["25 mm", "60 mm", 0]
[[sensor]]
link = "stage"
along = "x"
at = ["25 mm", "60 mm", 0]
name = "tip"
[simulate]
until = "40 ms"
dt = "1 ms"
[simulate.drives.push]
let_go = true
[[simulate.loads.hit]]
ramp = "10 ms"
[[simulate.loads.hit]]
ramp = "10 ms"
end = -1
delay = "20 ms"
[simulate.base]
along = "x"
acceleration = { half_sine = "2 m/s^2", duration = "8 ms" }
"""
WORDS = {
    "until": 0.04, "dt": 1e-3, "drives": {"push": None},
    "loads": {"hit": ksd.Ramp("10 ms") + ksd.Ramp("10 ms", end=-1, delay="20 ms")},
    "base": ksd.Shake("x", ksd.HalfSine(2.0, duration="8 ms")),
}  # fmt: skip


def guide(**words):
    m = ksd.Mechanism("guide", plane="xy")
    stage = m.link("stage")
    for x in (0.0, 0.05):
        m.leaf(
            m.ground,
            stage,
            start=(x, 0, 0),
            end=(x, 0.06, 0),
            material=STEEL,
            section=ksd.rectangle(0.3 * mm, 20 * mm),
        )
    m.mass(stage, mass=0.5, inertia=(0, 0, 1e-4), at=(0.025, 0.06, 0))
    m.load(stage, force=(1, 0, 0), at=(0.025, 0.06, 0), name="coil")
    m.sensor(stage, along="x", at=(0.025, 0.06, 0), name="tip")
    return m


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "guide.toml"
    path.write_text(FILE)
    return path


def test_a_file_says_what_python_says(file, tmp_path):
    mechanism, _, _ = ksd.load_scene(file)
    found = ksd.simulate(mechanism)
    said, mechanism.simulation = mechanism.simulation, None
    known = ksd.simulate(mechanism, **WORDS)
    assert np.array_equal(found.sensors["tip"], known.sensors["tip"]) and found.steps == 40
    assert np.abs(found.sensors["tip"]).max() > 1e-4
    mechanism.simulation = said
    ksd.save_scene(mechanism, tmp_path / "again.toml")
    again, _, _ = ksd.load_scene(tmp_path / "again.toml")
    assert np.array_equal(ksd.simulate(again).sensors["tip"], known.sensors["tip"])
    assert ksd.simulate(again, until="10 ms").t[-1] == pytest.approx(0.01)
    assert ksd.simulate(again, until="10 ms", accuracy=1e-2).error < 1e-2


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("simulate.drives.push", "simulate.drives.pusch", "there is no drive 'pusch'"),
        ('until = "40 ms"', "", "key 'until' is missing"),
        ('until = "40 ms"', 'until = "40 mm"', "a time is expected"),
        ('dt = "1 ms"', 'dt = "1 ms"\naccuracy = 1e-3', "exclude each other"),
        ('dt = "1 ms"', 'step = "1 ms"', "key 'step' is unknown"),
        ("let_go = true", "let_go = false", "write one of"),
        ("end = -1", "and = -1", "no parameter 'and'"),
        ('ramp = "10 ms"\nend', 'ramp = "10 mm"\nend', "a time is expected"),
        ('along = "x"\nacceleration', 'along = "z"\nacceleration', "out of the plane xy"),
    ],
)
def test_mistakes_in_files(file, old, new, sentence):
    file.write_text(FILE.replace(old, new))
    with pytest.raises(SceneFileError) as caught:
        ksd.load_scene(file)
    assert sentence in str(caught.value) and "[simulate]" in str(caught.value)


def test_doctor_tells_of_a_motion(file):
    file.write_text(FILE.replace("let_go = true", 'sine = "1 mm"\nfrequency_Hz = "5 Hz"'))
    assert "simulate: drive 'push': its speed jumps at t = 0 s" in str(ksd.doctor(ksd.load_scene(file)[0]))


def test_command_line(file, tmp_path, capsys):
    out = [str(tmp_path / name) for name in ("a.csv", "a.png", "a.json")]
    words = ["--set", "until=20ms", "--out", out[0], "--plot", out[1], "--json", out[2], "--quiet"]
    assert main(["simulate", str(file), *words]) == 0
    assert "20 steps to t = 0.02 s" in capsys.readouterr().out
    numbers = json.loads((tmp_path / "a.json").read_text())
    assert numbers["steps"] == 20 and len(numbers["columns"]["tip_mm"]) == 21 and numbers["error"] is None
    assert all((tmp_path / name).exists() for name in ("a.csv", "a.png"))
    for wrong, sentence in (
        (["--set", "until=soon"], "a time is expected"),
        (["--set", "untl=1s"], "there is no drive 'untl'"),
        (["--set", "loads=3"], "write [simulate.loads] in the file"),
        (["--out", "a.txt"], "the ending must be one of .csv"),
    ):
        assert main(["simulate", str(file), *wrong]) == 2
        assert sentence in re.sub(r"\s+", " ", capsys.readouterr().err)


def test_wrong_words():
    with pytest.raises(SceneError, match="until is missing"):
        ksd.simulate(guide())
    with pytest.raises(SceneError, match="is no mechanism"):
        ksd.simulate(3, 1.0)
    with pytest.raises(SceneError, match=r"give a pose that ksd\.solve returned"):
        ksd.simulate(guide(), 1.0, start=3)
    with pytest.raises(SceneError, match="no option 'untill'"):
        ksd.simulate(guide(), untill=1.0)
    with pytest.raises(SceneError, match=r"give ksd\.Simulation"):
        guide().simulation = {"until": 1.0}


def test_what_is_wrong_with_an_event_is_said_before_damping_at_is_asked_for():
    m = ksd.Mechanism("lossy", plane="xy")
    tip, tape = (
        m.link("tip", mass=0.1, at=(0.1, 0, 0)),
        ksd.Material(E=200e9, nu=0.3, density=7800, loss_factor=0.1),
    )
    m.leaf(m.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), section=ksd.rectangle(5e-4, 1e-2), material=tape)
    m.sensor(tip, along="y", at=(0.1, 0, 0), kind="velocity", name="speed")
    with pytest.raises(SceneError, match="an event is a place, not a velocity"):
        ksd.simulate(m, 1.0, stop=ksd.Event("speed", above=1.0))
    with pytest.raises(SceneError, match="say damping_at="):
        ksd.simulate(m, 1.0)


def test_a_long_step_is_warned_of():
    with pytest.warns(ksd.SceneWarning, match="more than a tenth of the longest free period"):
        ksd.simulate(guide(), 0.1, dt=0.02, loads={"coil": ksd.Ramp("50 ms")})


def test_a_motion_goes_on_from_an_instant():
    whole = ksd.simulate(guide(), 0.06, dt=2.5e-4, loads={"coil": ksd.Step(5.0)})
    rest = ksd.simulate(guide(), 0.03, dt=2.5e-4, loads={"coil": 5.0}, start=whole[0.03])
    one, other = whole.sensors["tip"][-1], rest.sensors["tip"][-1]
    assert other == pytest.approx(one, abs=1e-4 * np.abs(whole.sensors["tip"]).max())


def test_a_motion_of_a_link_off_its_centre_goes_on_from_an_instant():
    m = ksd.Mechanism("arm", plane="xy")
    arm, tip = m.link("arm", mass=1.0, inertia=(1e-3, 1e-3, 1e-3), at=(0.1, 0.05, 0)), m.link("tip")
    m.pin(m.ground, arm, at=(0, 0, 0))
    m.leaf(arm, tip, start=(0.1, 0, 0), end=(0.15, 0, 0), section=ksd.rectangle(1e-3, 1e-2), material=STEEL)
    m.gravity, words = (0, -9.81, 0), {"dt": 2e-4, "start": "undeformed"}
    with warnings.catch_warnings():
        warnings.simplefilter("error", ksd.SceneWarning)
        whole = ksd.simulate(m, 0.2, **words)
        rest = ksd.simulate(m, 0.1, **words | {"start": whole[0.1]})
    place = whole["arm"].position
    assert rest["arm"].position[-1] == pytest.approx(place[-1], abs=1e-4 * np.ptp(place, axis=0).max())


def test_an_instant_is_under_the_loads_and_the_base_of_then():
    """Half of a load with a lever, of a line load and of a shaken base, all slow, are statics under half of each."""

    def scene(share):
        m = ksd.Mechanism("arm", plane="xy")
        tip = m.link("tip", mass=0.05, inertia=(1e-5, 1e-5, 1e-5), at=(0.1, 0, 0))
        leaf = m.leaf(
            m.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), material=STEEL, section=ksd.rectangle(4e-4, 1e-2)
        )
        m.load(tip, force=(share * 4.0, 0, 0), at=(0.1, 0.05, 0), name="pull")
        m.line_load(leaf, force=(0, share * 3.0, 0), name="wind")
        m.gravity = (0, share * 20.0, 0)
        return m

    still = ksd.solve(scene(0.5))
    whole, slow = scene(1.0), ksd.Ramp(20.0)
    whole.gravity = None
    words = {"dt": 0.1, "loads": {"pull": slow, "wind": slow}}
    shake = ksd.Shake("y", lambda t: -10.0 * (1.0 - np.cos(np.pi * t / 20.0)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ksd.SceneWarning)
        pose = ksd.simulate(whole, 20.0, base=shake, **words)[10.0]
    assert pose.displacement("tip") == pytest.approx(still.displacement("tip"), rel=1e-4, abs=1e-8)
    own, other = (p.frequencies(count=1).frequency_Hz[0] for p in (pose, still))
    assert own == pytest.approx(other, rel=1e-4)
    forces = [p.section_forces(points=9)["leaf"].values for p in (pose, still)]
    for column in range(6):
        assert forces[0][:, column] == pytest.approx(forces[1][:, column], abs=1e-3 * np.abs(forces[1]).max())


def test_a_drive_that_is_released_is_a_load_that_fades():
    """At a lever, so that the drive acts on the stage as a force along x and a moment."""
    driven, loaded, at = guide(), guide(), (0.025, 0.09, 0)
    driven.actuate("stage", along="x", at=at, name="push")
    pose = ksd.solve(driven, push=3 * mm)
    words = {"dt": 2e-4, "drives": {"push": None}, "start": pose}
    let_go = ksd.simulate(driven, 0.05, release="40 ms", **words)
    loaded.load("stage", force=(pose.forces["push"], 0, 0), at=at, name="hold")
    fades = {"hold": ksd.Ramp("40 ms", start=1.0, end=0.0)}
    known = ksd.simulate(loaded, 0.05, dt=2e-4, loads=fades)
    assert let_go.sensors["tip"] == pytest.approx(known.sensors["tip"], abs=1e-9 * 3 * mm)
    push = let_go.drives["push"].force
    assert push[[0, 100, -1]] == pytest.approx([push[0], push[0] / 2, 0.0]) and push[0] > 1.0
    assert let_go.energy.work == pytest.approx(known.energy.work, abs=1e-9 * np.ptp(known.energy.work))
    assert let_go[0.02].forces["push"] == pytest.approx(push[100])


def test_forces_on_links_at_an_instant_hold_the_inertia_of_leaf_springs():
    m = ksd.Mechanism("carried", plane="xy")
    base, stage = m.link("base", mass=2.0, at=(0, 0, 0)), m.link("stage", mass=0.05, at=(0.025, 0.06, 0))
    m.slider(base, along="x", at=(0, 0, 0))
    m.actuate(base, along="x", at=(0, 0, 0), name="push")
    section = ksd.rectangle(3 * mm, 20 * mm)
    for x in (0.0, 0.05):
        m.leaf(base, stage, start=(x, 0, 0), end=(x, 0.06, 0), material=STEEL, section=section)
    history = ksd.simulate(m, 0.05, dt=2e-4, drives={"push": ksd.Cycloid(5 * mm, duration=0.05)})
    k, pose = 50, history[0.01]
    base_force, stage_force = (
        sum(row.force for row in pose.interface_forces().rows if row.link == n and "leaf" in row.name)
        for n in ("base", "stage")
    )
    a = [history[n].acceleration[k, 0] for n in ("base", "stage")]
    assert history.drives["push"].force[k] + base_force[0] == pytest.approx(2.0 * a[0], rel=1e-4)
    assert stage_force[0] == pytest.approx(0.05 * a[1], rel=1e-3)
    applied = next(r for r in pose.link_forces().rows if (r.of, r.at) == ("applied", "base"))
    assert applied.force[0] == pytest.approx(-base_force[0])
    assert "State: in motion, no equilibrium" in str(pose)


@pytest.mark.parametrize("start", ["equilibrium", "undeformed"])
def test_a_link_that_moves_freely_without_mass_is_named(start):
    m = guide()
    fly = m.link("fly")
    m.slider(fly, relative_to="stage", along="y", at=(0.1, 0.06, 0))
    with pytest.raises(SceneError, match="link 'fly' is free to move along y and has no mass"):
        ksd.simulate(m, 0.01, dt=1e-3, start=start)
    m = guide()
    carriage = m.link("carriage")
    m.slider(carriage, along="x", at=(0, 0, 0))
    m.actuate(carriage, along="x", at=(0, 0, 0), name="push")
    with pytest.raises(SceneError, match="link 'carriage' is free to move along x and has no mass"):
        ksd.simulate(m, 0.01, dt=1e-3, start=start, drives={"push": None})


def pushed(t):
    return 3.0 * np.sin(0.3 * t)


@pytest.fixture(scope="module")
def steps():
    """Readings after steps of 1 ms under forces that jump from step to step, with parts of several lengths."""
    found = {}
    for longest in (1e-3, 5e-4, 2.5e-4):
        step = ksd.stepper(guide(), longest=longest, loads={"coil": 0.0})
        state, read = step.start, []
        for k in range(60):
            state = step(state, {"coil": pushed(k)}, "1 ms")
            read.append(state.sensors["tip"])
        found[longest] = np.array(read)
    return found


def test_steps_converge_with_order_two_though_forces_jump(steps):
    coarse, middle, fine = steps.values()
    ratio = np.abs(coarse - middle).max() / np.abs(middle - fine).max()
    assert 2**1.7 < ratio < 2**2.3
    assert np.abs(middle - fine).max() < 1e-3 * np.abs(fine).max()


def test_steps_are_the_motion_under_the_same_forces(steps):
    forces = [ksd.Step(pushed(k) - pushed(k - 1), delay=k * 1e-3) for k in range(1, 20)]
    whole = ksd.simulate(guide(), 0.02, dt=2.5e-4, loads={"coil": sum(forces, ksd.Step(0.0))})
    assert np.abs(whole.sensors["tip"][4::4] - steps[2.5e-4][:20]).max() < 1e-4 * np.abs(steps[2.5e-4]).max()


def test_a_state_can_be_gone_on_from_again():
    step = ksd.stepper(guide(), longest="1 ms", loads={"coil": 0.0})
    once = step(step.start, {"coil": 1.0}, 3e-3)
    first, other = step(once, {"coil": -1.0}, 2e-3), step(once, {}, 2e-3)
    assert step(once, {"coil": -1.0}, 2e-3).sensors == first.sensors != other.sensors
    assert first.t == pytest.approx(5e-3) and first.history["stage"].velocity.shape == (1, 6)
    assert first.pose.t == first.t and "t = 0.005 s: tip" in repr(first)
    for wrong, sentence in (
        ((once, {"coal": 1.0}, 1e-3), "there is no load 'coal'"),
        ((once, {"coil": "x"}, 1e-3), "is not a number"),
        ((once, 3.0, 1e-3), "factors of loads by name"),
        ((once, {}, -1e-3), "must be positive"),
        ((3, {}, 1e-3), "start from step.start"),
    ):
        with pytest.raises(SceneError, match=sentence):
            step(*wrong)
    with pytest.raises(SceneError, match="is no mechanism"):
        ksd.stepper(3)


def test_section_forces_of_leaf_springs_that_carry_themselves():
    """A bent rod that is let go: its strain energy from its moments, and no moment at its free end."""
    m = ksd.Mechanism("rod", plane="xy")
    tip, size = m.link("tip"), (3.2 * mm, 12.7 * mm)
    m.leaf(m.ground, tip, start=(0, 0, 0), end=(1.11, 0, 0), section=ksd.rectangle(*size), material=STEEL)
    m.load(tip, force=(0, 7.187, 0), at=(1.11, 0, 0), name="pull")
    history = ksd.simulate(m, 0.2, dt="1 ms", loads={"pull": ksd.Ramp("40 ms", start=1, end=0)})
    EI = STEEL.E * size[1] * size[0] ** 3 / 12
    for k in (0, 77, 100, 150):
        pose = history[float(history.t[k])]
        along = pose.section_forces(points=81)["leaf"]
        moment = along.values[:, 4:6]
        energy = np.trapezoid((moment**2).sum(axis=1), along.s) / (2 * EI)
        # at the start accelerations are those of the next instant
        assert energy == pytest.approx(history.energy.strain[k], rel=5e-3 if k else 1e-2)
        assert np.abs(moment[-1]).max() < 1e-6 * np.abs(moment).max()
        bending = np.abs(moment).max() * size[0] / 2 / (size[1] * size[0] ** 3 / 12)
        assert pose.strength.stress_Pa == pytest.approx(bending, rel=1e-2)
