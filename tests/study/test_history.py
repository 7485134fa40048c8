"""Histories of motions that are known: a strong spring moved slowly through equilibria, and a free body that turns."""

import csv
import math
from dataclasses import replace

import numpy as np
import pytest
from scenes import STEEL
from scipy.spatial.transform import Rotation

import ksd
from ksd.errors import RecordError, SceneError, SceneWarning, UnknownNameError
from ksd.scene.simulation import Shake
from ksd.solvers.trace import Trace, flat_state
from ksd.study.history import ENERGIES, History
from ksd.units import mm

AMPLITUDE, OMEGA = 4e-3, 2 * math.pi * 5.0


def guide():
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
    m.actuate(stage, along="x", at=(0.025, 0.06, 0), name="push")
    m.sensor(stage, along="y", at=(0.05, 0.08, 0), name="tip")
    m.sensor(stage, along="y", at=(0.05, 0.08, 0), kind="velocity", name="speed")
    m.sensor(stage, along="y", at=(0.05, 0.08, 0), kind="acceleration", name="felt")
    m.sensor(stage, along="x", at=(0, 0, 0), kind="acceleration", relative_to="absolute", name="shaken")
    m.sensor(stage, about="z", kind="rotation", name="tilt")
    return m


def energies(t):
    """Made up: they add up to nothing."""
    return {name: (k + 1.0) * np.cos(OMEGA * t) for k, name in enumerate(ENERGIES)}


def through_equilibria(times, **changes):
    """push = A sin(w t), the mechanism in its equilibrium at every instant; rates from differences of equilibria."""
    solver = ksd.prepare(guide())
    value, h = lambda t: AMPLITUDE * math.sin(OMEGA * t), 2e-5

    def nodes(t):
        pose = solver(push=value(t))
        return pose, pose.motion.x, pose.motion.R

    rows = []
    for t in times:
        (pose, x, R), (_, xb, Rb), (_, xa, Ra) = nodes(t), nodes(t - h), nodes(t + h)
        turn = [Rotation.from_matrix(M @ R.transpose(0, 2, 1)).as_rotvec() for M in (Ra, Rb)]
        speed = np.hstack([(xa - xb) / (2 * h), (turn[0] - turn[1]) / (2 * h)])
        rate = np.hstack([(xa - 2 * x + xb) / h**2, (turn[0] + turn[1]) / h**2])
        rows.append((flat_state(pose.motion), x, R, speed, rate, pose.forces["push"]))
    x, position, rotation, velocity, acceleration, force = (
        np.array(part) for part in zip(*rows, strict=True)
    )
    t = np.asarray(times)
    trace = Trace(
        solver.model if hasattr(solver, "model") else pose.model, t, x, position, rotation, velocity, acceleration,
        AMPLITUDE * np.sin(OMEGA * t)[:, None], AMPLITUDE * OMEGA * np.cos(OMEGA * t)[:, None], force[:, None],
        energies(t), 2e-4, len(t) - 1, 0, None, True,
    )  # fmt: skip
    return Trace(**{**vars(trace), **changes})


@pytest.fixture(scope="module")
def trace():
    return through_equilibria(np.linspace(0.0, 0.2, 101))


@pytest.fixture(scope="module")
def history(trace):
    return History(trace)


@pytest.fixture(scope="module")
def slow(trace):
    """The same motion a thousand times slower, without inertia that counts."""
    rates = {"velocity": 1e-3 * trace.velocity, "acceleration": 1e-6 * trace.acceleration}
    return History(replace(trace, t=1e3 * trace.t, drive_rate=1e-3 * trace.drive_rate, **rates))


@pytest.mark.parametrize("t", [0.0, 0.0371, 0.1, 0.12345, 0.2])
def test_a_pose_at_an_instant_answers_as_the_equilibrium_there(slow, t):
    found, value = slow[1e3 * t], AMPLITUDE * math.sin(OMEGA * t)
    known = ksd.solve(guide(), push=value)
    assert found.targets["push"] == pytest.approx(value, abs=1e-6 * AMPLITUDE)
    assert np.abs(found.motion.x - known.motion.x).max() < 1e-6 * AMPLITUDE
    assert np.abs(found.motion.R - known.motion.R).max() < 1e-7
    largest = max(1e6, *(leaf.largest_Pa for leaf in known.stress().leaves.values()))
    for name, leaf in known.stress().leaves.items():
        assert np.abs(found.stress().leaves[name].von_mises_Pa - leaf.von_mises_Pa).max() < 1e-4 * largest
    assert sum(found.strain_energy().values()) == pytest.approx(
        sum(known.strain_energy().values()), rel=1e-4, abs=1e-12
    )
    freed = {"freed": ["push"]}
    assert found.frequencies(**freed).frequency_Hz[0] == pytest.approx(
        known.frequencies(**freed).frequency_Hz[0], rel=1e-5
    )
    own, other = (p.drive_stiffness().matrix[0, 0] for p in (found, known))
    assert own == pytest.approx(other, rel=1e-4)
    assert ksd.state_space(found).frequency_Hz[0] == pytest.approx(
        ksd.state_space(known).frequency_Hz[0], rel=1e-5
    )
    assert 1e3 * found.velocity[1, 0] == pytest.approx(
        AMPLITUDE * OMEGA * math.cos(OMEGA * t), abs=1e-4 * AMPLITUDE * OMEGA
    )


def test_a_pose_at_an_instant_is_no_equilibrium(history):
    pose = history[0.05]
    assert not pose.converged and not pose.stable and not pose.trusted and pose.t == 0.05
    assert "instant of a motion" in pose.trust.trusted.sentence
    text = str(pose)
    assert "motion at t = 0.05 s" in text and "NOT SOLVED" not in text.splitlines()[0]
    with pytest.raises(ksd.ConvergenceError, match="instant of a motion"):
        pose.verify()


def test_links_drives_and_energies(history, trace):
    stage = history["stage"]
    t = history.t
    assert np.allclose(
        stage.at((0.025, 0.06, 0)).displacement[:, 0], AMPLITUDE * np.sin(OMEGA * t), atol=1e-12
    )
    assert np.array_equal(history.drives["push"].value, trace.drive_value[:, 0])
    assert history.drives["push"].force[10] == pytest.approx(trace.drive_force[10, 0])
    assert np.array_equal(history.energy.lost, trace.energy["lost"]) and len(history) == 101
    for wrong in ("stag", "ground2"):
        with pytest.raises(UnknownNameError, match="there are ground, stage"):
            history[wrong]
    with pytest.raises(UnknownNameError, match="drive"):
        history.drives["pull"]
    for outside in (-1e-3, 0.3):
        with pytest.raises(SceneError, match=r"outside of the motion, 0 to 0.2 s"):
            history[outside]


def test_sensors_read_places_rates_and_accelerations(history):
    read, t = history.sensors, history.t
    inside = slice(2, -2)
    dt = t[1] - t[0]
    rate = (np.roll(read["tip"], -1) - np.roll(read["tip"], 1)) / (2 * dt)
    second = (np.roll(read["tip"], -1) - 2 * read["tip"] + np.roll(read["tip"], 1)) / dt**2
    assert np.abs(read["speed"] - rate)[inside].max() < 5e-3 * np.abs(rate).max()
    assert np.abs(read["felt"] - second)[inside].max() < 2e-2 * np.abs(second).max()
    assert np.allclose(
        read["tilt"], Rotation.from_matrix(history["stage"].rotation).as_rotvec()[:, 2], atol=1e-15
    )


def test_absolute_sensors_add_the_base(trace, history):
    shaken = History(trace, Shake("x", ksd.Sine(3.0, frequency_Hz="7 Hz")))
    more = shaken.sensors["shaken"] - history.sensors["shaken"]
    assert np.allclose(more, 3.0 * np.sin(2 * math.pi * 7 * history.t), atol=1e-12)
    assert np.array_equal(shaken.sensors["felt"], history.sensors["felt"])
    # from rest: x'' = a sin(w t) is x = a t/w - a/w^2 sin(w t)
    w = 2 * math.pi * 7
    place, speed, _ = shaken._base_motion
    assert np.allclose(place, 3.0 * (history.t / w - np.sin(w * history.t) / w**2), atol=1e-6 * 3 / w**2)
    assert np.allclose(speed, 3.0 / w * (1 - np.cos(w * history.t)), atol=1e-6 * 3 / w)


def turning(times, *, rate=3.0):
    """Two links in space, turning steadily about z and about their own axes, as rigid bodies do; no equilibrium."""
    m = ksd.Mechanism("turning")
    arm, head = m.links("arm", "head")
    for a, b, x in ((m.ground, arm, 0.0), (arm, head, 0.1)):
        m.leaf(
            a,
            b,
            start=(x, 0, 0),
            end=(x + 0.05, 0, 0),
            material=STEEL,
            section=ksd.rectangle(1 * mm, 10 * mm),
        )
    m.mass(head, mass=1.0, inertia=(1e-3, 1e-3, 1e-3), at=(0.2, 0, 0))
    m.sensor(head, along="x", at=(0.2, 0, 0), relative_to="arm", name="across")
    m.sensor(head, along="x", at=(0.2, 0, 0), relative_to="arm", kind="velocity", name="across speed")
    m.sensor(head, along="x", at=(0.2, 0, 0), relative_to="arm", kind="acceleration", name="across rate")
    m.sensor(head, about="z", name="angle", kind="rotation")
    model = ksd.compile_scene(m.scene())
    t, rows = np.asarray(times), []
    nodes, rest = len(model.rest.x), model.rest.x
    for one in t:
        x, R, v, a = (
            rest.copy(),
            np.tile(np.eye(3), (nodes, 1, 1)),
            np.zeros((nodes, 6)),
            np.zeros((nodes, 6)),
        )
        for node, w in ((1, 2.0), (2, rate)):
            R[node] = Rotation.from_rotvec([0, 0, w * one]).as_matrix()
            x[node] = R[node] @ rest[node]
            v[node] = *np.cross([0, 0, w], x[node]), 0, 0, w
            a[node, :3] = -(w**2) * x[node]
        state = model.rest.copy()
        state.x[:], state.R[:] = x, R
        rows.append((flat_state(state), x, R, v, a))
    parts = [np.array(part) for part in zip(*rows, strict=True)]
    none = np.zeros((len(t), 0))
    return History(
        Trace(model, t, *parts, none, none, none, energies(t), math.nan, len(t) - 1, 3, "a stop", False, massless=("arm",))
    )  # fmt: skip


def test_relative_sensors_and_whole_turns():
    times = np.linspace(0, 3, 61)
    found = turning(times, rate=5.0)
    # a point at radius .2 turns by 3 rad/s relative to the arm
    at = 0.2 * np.array([np.cos(3 * times), -3 * np.sin(3 * times), -9 * np.cos(3 * times)])
    assert np.allclose(found.sensors["across"], at[0] - 0.2, atol=1e-12)
    assert np.allclose(found.sensors["across speed"], at[1], atol=1e-12)
    assert np.allclose(found.sensors["across rate"], at[2], atol=1e-11)
    assert np.allclose(found.sensors["angle"], 5 * times, atol=1e-9)
    between = found[1.013]
    assert np.abs(between.motion.R[2] - Rotation.from_rotvec([0, 0, 5.065]).as_matrix()).max() < 1e-9
    assert np.abs(between.motion.x[2] - between.motion.R[2] @ found.trace.model.rest.x[2]).max() < 1e-5
    assert between.velocity[2, 5] == pytest.approx(5.0, rel=1e-9)


def test_massless_accelerations_are_warned_of():
    found = turning(np.linspace(0, 1, 11))
    with pytest.warns(SceneWarning, match="link 'arm' has no mass"):
        found["arm"].acceleration  # noqa: B018
    assert found["head"].acceleration.shape == (11, 6)


def test_text(history):
    text = str(history)
    assert "100 steps to t = 0.2 s" in text and "within 0.020 % of the largest stroke" in text
    assert "push force" in text and "kinetic energy" in text
    stopped = str(turning(np.linspace(0, 1, 11)))
    assert (
        "Stopped at t = 1 s: a stop" in stopped
        and "3 times halved" in stopped
        and "largest stroke" not in stopped
    )
    assert repr(history) == "<History: 'guide', 0.2 s in 100 steps>"


def test_the_force_of_a_drive_that_is_let_go_is_not_shown(history):
    guide, _, _ = ksd.load_scene("guide")
    assert "push force" in str(history)
    assert "table force" not in str(ksd.simulate(guide, "2 ms", dt="1 ms", drives={"table": None}))


def test_spectrum_finds_the_frequency(history):
    longer = turning(np.linspace(0, 20, 4001)).spectrum("head y", since=1.0)
    assert longer.peaks[0][0] == pytest.approx(3.0 / (2 * math.pi), abs=2e-3)
    assert longer.peaks[0][1] == pytest.approx(turning([0.0, 1.0]).trace.model.rest.x[2, 0], rel=1e-2)
    with pytest.raises(SceneError, match="leaves 1 instants"):
        history.spectrum("push", since=0.2)
    with pytest.raises(UnknownNameError, match="signal"):
        history.spectrum("pusch")
    assert "Peaks of 'head y'" in str(longer) and "0.47" in str(longer)


def test_files(history, tmp_path):
    rows = list(csv.reader(history.to_csv(tmp_path / "a.csv").open()))
    at = rows[0].index("push_mm")
    assert float(rows[11][at]) == pytest.approx(1e3 * history.drives["push"].value[10], rel=1e-14)
    assert {
        "t_s",
        "push_force_N",
        "tip_mm",
        "speed_mm_per_s",
        "tilt_mrad",
        "stage_x_mm",
        "lost_energy_J",
    } <= {*rows[0]}
    file = history.to_hdf5(tmp_path / "a.h5")
    again = ksd.Table.from_hdf5(file)
    assert np.array_equal(again["stage_rz_mrad"], history.table()["stage_rz_mrad"])
    damaged = bytearray(file.read_bytes())
    damaged[len(damaged) // 2] ^= 1
    file.write_bytes(damaged)
    with pytest.raises(RecordError, match="damaged"):
        ksd.Table.from_hdf5(file)
    assert history.to_mat(tmp_path / "a.mat").stat().st_size > 1000


def test_pictures(history, tmp_path):
    figure = history.plot(path=tmp_path / "a.png")
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "[mm]", "[N]", "[mm/s]", "[m/s2]", "[mrad]", "[J]",
    ] and (tmp_path / "a.png").stat().st_size > 10_000  # fmt: skip
    assert len(history.plot("push", "tip").axes) == 1
    curve = history.phase_plot("push").axes[0].lines[0]
    ellipse = (curve.get_xdata() / 4.0) ** 2 + (curve.get_ydata() / (4.0 * OMEGA)) ** 2
    assert np.allclose(ellipse, 1.0, atol=1e-12)
    history.spectrum("push").plot(tmp_path / "b.svg")
    assert (tmp_path / "b.svg").exists()
    from PIL import Image

    with Image.open(history.animate(tmp_path / "a.gif", slower=2.0, dpi=30)) as film:
        assert film.n_frames == 10 and film.info["duration"] == 40
    with pytest.raises(SceneError, match=r"write it as \.gif"):
        history.animate(tmp_path / "a.mp4")
    page = history.animate(tmp_path / "a.html", slower=2.0).read_text()
    assert f'"{history.t[-1]:.4g} s"' in page
