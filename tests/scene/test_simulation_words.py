"""What a motion in time may be asked for, and every sentence about what it may not."""

import itertools
import math
import tomllib

import numpy as np
import pytest
from scenes import STEEL
from test_json_schema import SCHEMA, fits
from test_toml import GOOD

import ksd
from ksd.checks import clear_argument_errors
from ksd.errors import SceneError
from ksd.scene.functions_of_time import as_function_of_time
from ksd.scene.simulation import Simulation, simulation_of_table, table_of_simulation
from ksd.units import mm


@clear_argument_errors
def checked_simulation(scene, **words):
    """The words of a motion, and what is said about them."""
    simulation = Simulation(**words)
    return simulation, simulation.check(scene)


def guide(material=STEEL, mass=0.5, plane="xy"):
    m = ksd.Mechanism("guide", plane=plane)
    stage = m.link("stage")
    for x in (0.0, 0.05):
        m.leaf(
            m.ground, stage, start=(x, 0, 0), end=(x, 0.06, 0), material=material,
            section=ksd.rectangle(0.3 * mm, 20 * mm),
        )  # fmt: skip
    if mass:
        m.mass(stage, mass=mass, at=(0.025, 0.06, 0))
    m.actuate(stage, along="x", at=(0.025, 0.06, 0), name="push")
    m.load(stage, force=(0, -1, 0), at=(0, 0.06, 0), name="weight")
    m.sensor(stage, along="x", at=(0.05, 0.06, 0), name="tip")
    return m


LOSSY = ksd.Material(E=STEEL.E, G=STEEL.G, density=STEEL.density, loss_factor=0.02, name="steel")


COUNT = itertools.count()


class Pose:
    targets = {"push": 2e-3}  # noqa: RUF012


def test_what_is_understood():
    words = {
        "until": "1 s", "dt": "2 ms", "drives": {"push": ksd.Cycloid("5 mm", duration="50 ms")},
        "loads": {"weight": [(0, 0), (0.1, 1)]}, "base": ksd.Shake("y", ksd.HalfSine("50 m/s^2", duration="11 ms")),
        "speeds": {"stage": (0.1, 0, 0)}, "stop": ksd.Event("push", above="4 mm"), "damping_at": "8.6 Hz",
    }  # fmt: skip
    made, said = checked_simulation(guide(LOSSY).scene(), **words)
    assert made.until == 1.0 and made.dt == 2e-3 and made.accuracy is None and not said
    assert made.shortest == pytest.approx(0.011) and made.speeds["stage"] == (0.1, 0, 0, 0, 0, 0)
    assert made.stop[0].excess(5e-3) == pytest.approx(1e-3) and made.stop[0].excess(0.0) < 0
    assert Simulation(until=1.0).accuracy == 1e-3
    again = simulation_of_table(table_of_simulation(made))
    assert table_of_simulation(again) == table_of_simulation(made) and again.until == made.until
    let_go = simulation_of_table({"until": "1 s", "drives": {"push": {"let_go": True}}})
    assert let_go.drives == {"push": None} and table_of_simulation(let_go)["drives"] == {
        "push": {"let_go": True}
    }


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ({"until": 0.0}, "until = 0.0 s must be positive"),
        ({"until": -1.0}, "must be positive"),
        ({"until": math.nan}, "not finite"),
        ({"until": "soon"}, "a time is expected"),
        ({"until": "3 mm"}, "a time is expected"),
        ({"dt": 2.0}, "dt = 2 s is longer than until = 1 s"),
        ({"dt": 0.0}, "must be positive"),
        ({"dt": 1e-3, "accuracy": 1e-3}, "exclude each other"),
        ({"accuracy": 2.0}, "must lie between"),
        ({"method": "newmark"}, "is unknown"),
        ({"rho": 1.5}, "0 (most damping"),
        ({"drives": [1, 2]}, "must be given by name"),
        ({"drives": {"pull": 0.0}}, "there is no drive 'pull'"),
        ({"loads": {"wait": 1.0}}, "there is no load 'wait'; did you mean"),
        ({"speeds": {"stge": (0, 0, 0)}}, "there is no link 'stge'"),
        ({"speeds": {"ground": (0, 0, 0)}}, "there is no link 'ground'"),
        ({"speeds": {"stage": (0, 0)}}, "three numbers in m/s"),
        ({"stop": "4 mm"}, "give ksd.Event"),
        ({"stop": ksd.Event("pull", above=1.0)}, "there is no drive or sensor 'pull'"),
        ({"base": 3.0}, "give ksd.Shake"),
        ({"base": ksd.Shake("z", ksd.HalfSine(1.0, duration=0.01))}, "out of the plane xy"),
        ({"base": ksd.Shake("y", ksd.HalfSine("1 mm", duration=0.01))}, "of dimension length"),
        ({"start": "rest"}, "'equilibrium' or 'undeformed'"),
        ({"drives": {"push": ksd.Cycloid("5 deg", duration=0.1)}}, "of dimension angle, but must be in m"),
        ({"loads": {"weight": ksd.Cycloid("5 mm", duration=0.1)}}, "must be a plain factor"),
        ({"drives": {"push": ksd.Step(1e-3)}}, "jumps in place at t = 0 s"),
        ({"drives": {"push": ksd.Step(1e-3, delay=0.3)}}, "jumps in place at t = 0.3 s"),
        (
            {"drives": {"push": ksd.Cycloid(1e-3, duration=0.1)}, "start": Pose()},
            "starts at 0 m, but the pose at 0.002 m",
        ),
        ({"drives": {"push": 1e-3}, "start": "undeformed"}, "starts at 0.001 m, but the pose at 0 m"),
        ({"drives": {"push": lambda t: math.log(1.0 - t)}}, "raises ValueError at t = 1 s"),
        ({"damping_at": "8 Hz"}, "no material has a loss factor"),
        ({"damping_at": "-8 Hz"}, "must be positive"),
        ({"every": 0}, "every"),
        ({"release": "20 ms"}, "release is that of drives that are let go"),
        ({"release": -1.0, "drives": {"push": None}}, "release = -1.0 s must be positive"),
        ({"drives": {"push": lambda t: 1e-3 * (t >= 0.3)}}, "jumps in place at t = 0.3 s"),
        (
            {"loads": {"weight": lambda t: t * next(COUNT)}},
            "another value each time it is called with t = 0.5",
        ),
    ],
)
def test_refused(words, sentence):
    with pytest.raises(SceneError) as caught:
        checked_simulation(guide().scene(), **{"until": 1.0, **words})
    assert sentence in str(caught.value) and "\n" not in str(caught.value)


def test_words_about_masses_and_damping():
    with pytest.raises(SceneError, match="nothing has mass: no material has a density"):
        checked_simulation(guide(ksd.Material(E=2e11, nu=0.3), mass=0.0).scene(), until=1.0)
    with pytest.raises(SceneError, match=r"steel has a loss factor of 0.02.*damping_at='8.6 Hz'"):
        checked_simulation(guide(LOSSY).scene(), until=1.0)


@pytest.mark.parametrize("words", [{}, {"above": 1.0, "below": 2.0}])
def test_an_event_has_one_limit(words):
    with pytest.raises(SceneError, match="give one of above= and below="):
        ksd.Event("push", **words)


def test_what_is_said():
    scene = guide().scene()
    table = ksd.TimeTable([(0, 0), (0.1, 1e-3), (0.2, 1e-3)])
    _, said = checked_simulation(scene, until=1.0, drives={"push": table})
    assert [s.split("t = ")[1].split(";")[0] for s in said] == ["0 s", "0.1 s"]
    assert all("its speed jumps" in s for s in said)
    _, said = checked_simulation(scene, until=1.0, drives={"push": ksd.Sine(1e-3, frequency_Hz="5 Hz")})
    assert len(said) == 1 and "jumps at t = 0 s" in said[0]
    _, said = checked_simulation(scene, until=1.0, drives={"push": lambda t: 1e-3 * max(t - 0.3, 0.0)})
    assert len(said) == 1 and "its speed jumps at t = 0.3 s" in said[0]
    _, said = checked_simulation(scene, until=1.0, dt=0.02, loads={"weight": [(0, 0), (0.01, 1)]})
    assert len(said) == 1 and "0.01 s apart, closer than dt = 0.02 s" in said[0]
    assert not checked_simulation(scene, until=1.0, dt=0.01, loads={"weight": [(0, 0), (0.01, 1)]})[1]


def test_a_history_that_would_not_fit():
    made = Simulation(until=1.0)
    made.check_memory(1000, numbers=1000)
    with pytest.raises(SceneError, match=r"would take 74.5 GiB .* start=history\[t\]"):
        made.check_memory(10_000_000, numbers=1000)


def test_no_function_of_python_and_no_pose_in_a_file():
    with pytest.raises(SceneError, match="write it as a formula"):
        table_of_simulation(Simulation(until=1.0, loads={"weight": np.sin}))
    with pytest.raises(SceneError, match="cannot be written"):
        table_of_simulation(Simulation(until=1.0, start=Pose()))


MOTION = {
    "until": "1 s", "dt": 1e-3, "drives": {"push": {"cycloid": "5 mm", "duration": "50 ms"}, "lock": {"let_go": True}},
    "loads": {
        "weight": {"table": [["0 s", 0], ["10 ms", 1]], "smooth": True}, "a.b": [{"ramp": 1.0}, {"ramp": 1.0, "delay": 2.0}],
        "c": {"formula": "1 - exp(-t / 5 ms)"}, "d": {"value": 0.5},
    },
    "base": {"along": "y", "acceleration": {"half_sine": "50 m/s^2", "duration": "11 ms"}}, "speeds": {"stage": [0, 1, 0]},
    "stop": [{"of": "push", "above": "4 mm"}], "every": 2, "start": "undeformed", "damping_at": "8 Hz", "release": "20 ms",
}  # fmt: skip


def test_the_schema_for_editors():
    whole = tomllib.loads(GOOD)
    assert fits(whole | {"simulate": MOTION}, SCHEMA)
    made = simulation_of_table(MOTION)
    assert made.every == 2 and table_of_simulation(made)["release"] == pytest.approx(0.02)
    for wrong in (
        {"drive": {}}, {"until": "1 mm"}, {"loads": {"c": {"romp": 1.0}}}, {"loads": {"c": {"ramp": 1.0, "sine": 2.0}}},
        {"drives": {"push": {"let_go": False}}}, {"loads": {"c": {"let_go": True}}}, {"stop": {"above": 1.0}},
        {"base": {"acceleration": {"ramp": 1.0}}}, {"speeds": {"stage": ["1 m/s"]}},
    ):  # fmt: skip
        assert not fits(whole | {"simulate": MOTION | wrong}, SCHEMA), wrong


@pytest.mark.parametrize(
    ("given", "jumps"),
    [
        (lambda t: 0.3 if t < 0.0123 else 1.0, [(0.0123, 0)]),
        (lambda t: t % 0.004, [(0.004, 0), (0.008, 0), (0.012, 0), (0.016, 0), (0.02, 0)]),
        (lambda t: min(t / 0.01, 1.0), [(0.01, 1)]),
        (lambda t: abs(math.sin(400.0 * t)), [(math.pi / 400, 1), (math.pi / 200, 1)]),
        (lambda t: math.sin(3000.0 * t), []),
        (lambda t: 0.5 - 0.5 * math.cos(100.0 * math.pi * min(t, 0.01)), []),
        ("1 - exp(-t / 5 ms)", []),
    ],
)
def test_jumps_of_functions_of_the_user_are_found(given, jumps):
    found = as_function_of_time(given, "load").within(0.02).jumps
    assert [order for _, order in found] == [order for _, order in jumps]
    assert [t for t, _ in found] == pytest.approx([t for t, _ in jumps], abs=1e-7)
