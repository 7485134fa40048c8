"""Motion in time against independent dynamic models, frequencies, statics and conservation."""

import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from motion_scenes import (
    CASES,
    bistable_beam,
    carried_guide,
    carried_payload,
    driven_mass,
    guide,
    lobatto,
    motion,
    pivot,
    place,
    reaction_mass,
    rod,
    stage,
    strip,
    wire,
)
from scipy.spatial.transform import Rotation

import ksd
from ksd.section import rectangle
from ksd.solvers.dynamics import error_of_finer

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
import random_motions


@pytest.mark.parametrize("name", CASES)
def test_values_are_those_of_independent_models_with_order_two(name):
    case = CASES[name]
    (coarse, _), (middle, _), (fine, largest) = (case.found(dt) for dt in case.steps)
    refined = (4.0 * fine - middle) / 3.0
    assert case.errors(refined, largest).max() < case.within
    if case.order is not None:
        first, second = (np.linalg.norm((found - refined) / largest) for found in (coarse, middle))
        assert np.log2(first / second) == pytest.approx(2.0, abs=case.order)


@pytest.mark.parametrize("name", ["guide", "fourbar", "wire", "pendulum", "pivot", "rod"])
def test_strokes_and_energies_at_a_millisecond(name):
    case = CASES[name]
    assert case.errors(*case.found(1e-3))[0] < 1e-3
    energy = case.run(1e-3).energy
    assert np.abs(energy.lost).max() < 1e-3 * max(energy.kinetic.max(), np.ptp(energy.strain))


def test_free_flight_keeps_momentum_and_energy():
    history = CASES["flight"].run(5e-3)
    late = history.t > 3.0 - 1e-9
    total = history.energy.kinetic + history.energy.strain
    assert total[late] == pytest.approx(total[-1], rel=1e-4)
    # 10 kg, thrown by 8 N for 2.5 s in all; the nodes are Lobatto points of three pieces
    speed = np.array([history[f"n{k}"].velocity[late, :2] for k in range(16)])
    share = sum(np.pad(lobatto(6)[1], (5 * i, 10 - 5 * i)) for i in range(3)) / 3
    momentum = 10.0 * np.einsum("n,nkc->kc", share, speed)
    assert momentum == pytest.approx(np.tile([20.0, 0.0], (len(momentum), 1)), abs=0.02)


def test_a_released_rod_keeps_its_energy():
    words = {"dt": 1e-3, "loads": {"pull": ksd.Ramp(0.04, end=0.0, start=1.0)}}
    for rho in (1.0, 0.8):
        trace = motion(rod(), 2.0, rho=rho, **words)
        total = trace.energy["kinetic"] + trace.energy["strain"]
        late = total[trace.t > 0.05]
        assert late == pytest.approx(late[0], rel=5e-5)
        assert late[0] == pytest.approx(1.31699, rel=1e-4)


def test_the_width_of_a_strip_turns_as_an_independent_model_says():
    trace = motion(strip(), 0.3, dt=1e-3, start="undeformed")
    node = trace.model.node_names.index("tip")
    slope = [trace.rotation[np.argmin(np.abs(trace.t - t)), node, 1, 2] for t in (0.1, 0.2, 0.3)]
    assert slope == pytest.approx([-0.01244, -0.03539, -0.03745], abs=3e-4)
    # with the payload on the axis the strip stays in its plane, where it is found to
    flat = motion(strip(0.0), 0.3, dt=1e-3, start="undeformed")
    assert np.abs(flat.position[..., 2]).max() == 0.0
    found = [place(flat, "tip", t, (0.25, 0, 0))[:2] + np.array([0.25, 0.0]) for t in (0.1, 0.3)]
    assert np.array(found) == pytest.approx(
        np.array([(0.2448778, -0.0462997), (0.166808, -0.166843)]), abs=1e-5
    )


@pytest.mark.parametrize("rho", [0.5, 0.8, 1.0])
def test_a_jump_of_load_at_the_start_is_of_second_order(rho):
    """In places of the payload, and in the force that holds its carriage."""
    places, forces = [], []
    for dt in (2e-3, 1e-3, 5e-4):
        history = ksd.simulate(carried_payload(), 0.06, dt=dt, rho=rho, loads={"hit": ksd.Step(1.0)})
        at = np.searchsorted(history.t, 0.004 * np.arange(1, 16) - 1e-9)
        places.append(history["payload"].position[at, 1])
        forces.append(history.drives["push"].force[at])
    for found in (places, forces):
        ratio = np.linalg.norm(found[0] - found[1]) / np.linalg.norm(found[1] - found[2])
        assert np.log2(ratio) == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("rho", [0.5, 0.8, 1.0])
def test_drive_forces_of_leaf_springs_with_mass_are_of_second_order_once_steps_follow_their_vibrations(rho):
    """Those that a jump of load excites are up to 5.3 kHz; 8 periods of these."""
    until, forces = 1.5e-3, []
    for n in (192, 384, 768):
        history = ksd.simulate(carried_guide(), until, dt=until / n, rho=rho, loads={"hit": ksd.Step(1.0)})
        forces.append(history.drives["push"].force[:: n // 12][1:])
    ratio = np.linalg.norm(forces[0] - forces[1]) / np.linalg.norm(forces[1] - forces[2])
    assert np.log2(ratio) == pytest.approx(2.0, abs=0.1)


def test_a_jump_does_not_excite_motion_too_fast_for_the_steps():
    """A mass on a stiff and massless rod, pulled at once: the energy of a mass on a spring, for steps of any length."""
    scene = ksd.Mechanism("rod", plane="xy")
    tip = scene.link("tip", mass=1.0, inertia=(1e-4, 1e-4, 1e-4), at=(0.1, 0, 0))
    section, stuff = rectangle(1e-3, 1e-2), ksd.Material(E=2e11, nu=0.3)
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), section=section, material=stuff)
    scene.load(tip, force=(10, 0, 0), at=(0.1, 0, 0), name="pull")
    stiffness = 2e11 * 1e-5 / 0.1
    for steps in (0.3, 3.0, 10.0, 30.0, 100.0, 1e3):
        dt = steps / np.sqrt(stiffness)
        energy = ksd.simulate(scene, 5 * dt, dt=dt, loads={"pull": ksd.Step()}).energy
        assert energy.kinetic.max() < 3.0 * 0.5 * 10.0**2 / stiffness


@pytest.mark.parametrize("rho", [0.5, 0.8, 1.0])
def test_the_force_on_a_driven_mass_is_mass_times_acceleration(rho):
    T, stroke, off = 0.1, 0.1, []
    for n in (40, 80, 160):
        trace = motion(driven_mass(), T, dt=T / n, rho=rho, drives={"push": ksd.Cycloid(stroke, duration=T)})
        wanted = 2.1 * stroke * 2 * np.pi / T**2 * np.sin(2 * np.pi * trace.t / T)
        off.append(np.abs(trace.drive_force[:, 0] - wanted)[1:-1].max() / wanted.max())
    assert off[1] < 3e-3
    assert np.log2(off[1] / off[2]) == pytest.approx(2.0, abs=0.1)


def test_the_force_of_a_trapezoid_of_speed_is_exact_between_its_jumps():
    T, stroke, rise = 0.1, 0.1, 0.02
    words = {"dt": T / 50, "drives": {"push": ksd.Trapezoid(stroke, duration=T, rise=rise)}}
    trace = motion(driven_mass(), T, **words)
    peak = 2.1 * stroke / ((T - rise) * rise)
    wanted = peak * np.where(trace.t <= rise + 1e-9, 1.0, np.where(trace.t > T - rise + 1e-9, -1.0, 0.0))
    assert trace.drive_force[1:, 0] == pytest.approx(wanted[1:], abs=1e-5 * peak)
    assert trace.velocity[25, trace.model.node_names.index("a"), 0] == pytest.approx(stroke / (T - rise))


@pytest.mark.parametrize("dt", [1e-6, 1e-3, 1.0])
@pytest.mark.parametrize("make", [pivot, wire], ids=["pivot", "wire"])
def test_an_equilibrium_stays_where_it_is(make, dt):
    trace = motion(make(), 20 * dt, dt=dt)
    assert trace.at_end
    assert np.abs(trace.position - trace.position[0]).max() < 1e-10
    assert np.abs(trace.rotation - trace.rotation[0]).max() < 1e-9


def test_a_slow_ramp_is_statics():
    scene = guide()
    trace = motion(scene, 40.0, dt=0.4, loads={"push": ksd.Ramp(40.0)})
    still = ksd.solve(scene, method="conventional")
    node = still.model.node_names.index("stage")
    assert trace.position[-1, node] == pytest.approx(still.motion.x[node], abs=1e-6)


def test_a_small_release_rings_at_the_frequency_and_decays_by_the_loss_factor():
    frequency, eta = 8.64181, 0.02
    scene = guide(loss_factor=eta)
    scene.load("stage", force=(0, 0.02, 0), at=(0.1, 0, 0), name="small")
    words = {"loads": {"push": 0.0, "small": ksd.Step(0.0, start=1.0)}, "damping_at": frequency}
    periods = 6
    trace = motion(scene, periods / frequency, dt=1.0 / frequency / 400, **words)
    y = trace.position[:, trace.model.node_names.index("stage"), 1]
    y = y - trace.model.rest.x[trace.model.node_names.index("stage"), 1]
    cross = np.flatnonzero((y[:-1] > 0) & (y[1:] <= 0))
    t = trace.t[cross] + np.diff(trace.t)[cross] * y[cross] / (y[cross] - y[cross + 1])
    zeta = 0.5 * eta
    assert (len(t) - 1) / (t[-1] - t[0]) == pytest.approx(frequency * np.sqrt(1 - zeta**2), rel=1e-4)
    # the envelope, from the energy at the crossings
    energy = trace.energy["kinetic"][cross]
    decay = np.log(energy[0] / energy[-1]) / (2.0 * 2.0 * np.pi * (len(t) - 1))
    assert decay == pytest.approx(zeta / np.sqrt(1 - zeta**2), rel=1e-3)
    assert trace.energy["damped"][-1] == pytest.approx(
        trace.energy["strain"][0] - trace.energy["kinetic"][-1] - trace.energy["strain"][-1], rel=1e-2
    )


@pytest.mark.parametrize("gravity", [-9.81, 9.81], ids=["standing", "hanging"])
def test_weight_changes_the_damping_of_a_guide(gravity):
    """The material resists bending only, weight takes or gives stiffness: 1.5 and .75 times half the loss factor."""
    scene, eta = stage(gravity, loss_factor=0.02), 0.02
    modes = ksd.solve(scene).frequencies(count=1)
    f, zeta = float(modes.frequency_Hz[0]), float(modes.damping[0])
    assert abs(zeta / (0.5 * eta) - 1.0) > 0.24
    words = {"loads": {"hold": ksd.Step(0.0, start=1.0)}, "damping_at": f}
    history = ksd.simulate(scene, 4.0 / f, dt=1.0 / f / 400, **words)
    y = history.sensors["tip"]
    down = np.flatnonzero((y[:-1] > 0) & (y[1:] <= 0))
    energy = history.energy.kinetic[down]
    decay = np.log(energy[0] / energy[-1]) / (4.0 * np.pi * (len(down) - 1))
    assert decay == pytest.approx(zeta / np.sqrt(1 - zeta**2), rel=1e-3)


def test_a_carriage_stays_between_two_stages_that_move_against_each_other():
    scene, push = reaction_mass(), ksd.Ramp(0.02)
    both = ksd.simulate(scene, 0.1, dt=1e-3, loads={"push above": push, "push below": push})
    assert np.ptp(both["carriage"].position[:, 0]) < 1e-9 * np.ptp(both["above"].position[:, 0])
    assert both["above"].displacement[:, 0] == pytest.approx(-both["below"].displacement[:, 0], abs=1e-9)
    # pushed alone, all of it gains the impulse; leaf springs, 11 g in all, move with the mean of both ends
    one = ksd.simulate(scene, 0.1, dt=1e-3, loads={"push above": push, "push below": 0.0})
    speeds = {n: one[n].velocity[-1, 0] for n in ("carriage", "above", "below")}
    leaf = 2 * 7800 * 0.06 * 3e-4 * 0.02
    momentum = sum(
        m * speeds[n]
        for n, m in (("carriage", 2.0 + leaf), ("above", 0.5 + leaf / 2), ("below", 0.5 + leaf / 2))
    )
    assert momentum == pytest.approx(5.0 * (0.1 - 0.01), rel=1e-4)


def test_the_intermediate_body_of_folded_beams_is_free():
    """A stage hangs by two beams from a body that hangs by two beams from ground: two masses on two springs, pushed at
    once."""
    scene, L, masses = ksd.Mechanism("folded", plane="xy"), 0.06, np.array([0.1, 0.3])
    words = {"section": rectangle(3e-4, 0.02), "material": ksd.Material(E=200e9, nu=0.3)}
    names = ("intermediate", "stage")
    middle, stage = (
        scene.link(n, mass=m, inertia=(1e-3, 1e-3, 1e-3), at=(0, y, 0))
        for n, m, y in zip(names, masses, (L, 0), strict=True)
    )
    for x in (-0.05, 0.05):
        scene.leaf("ground", middle, start=(x, 0, 0), end=(x, L, 0), **words)
        scene.leaf(middle, stage, start=(0.6 * x, L, 0), end=(0.6 * x, 0, 0), **words)
    scene.load(stage, force=(0.1, 0, 0), at=(0, 0, 0), name="push")
    history = ksd.simulate(scene, 0.6, dt=5e-4, loads={"push": ksd.Step()})
    k = 2.0 * 12.0 * 200e9 * 0.02 * 3e-4**3 / 12.0 / L**3
    w2, modes = np.linalg.eigh(np.array([[2 * k, -k], [-k, k]]) / np.sqrt(np.outer(masses, masses)))
    share = modes[1] * 0.1 / np.sqrt(masses[1]) / w2
    swing = share * (1.0 - np.cos(np.sqrt(w2) * history.t[:, None]))
    known = swing @ (modes / np.sqrt(masses)[:, None]).T
    for n, own in zip(names, known.T, strict=True):
        assert history[n].displacement[:, 0] == pytest.approx(own, abs=5e-3 * np.abs(own).max())


def test_a_bistable_beam_snaps_in_time():
    """Pushed slowly beyond the force at which it snaps, it comes to rest on the other branch of equilibria."""
    scene = bistable_beam()
    path = ksd.follow(scene, until=0.78, first=0.01)
    place = np.array([state.displacement("shuttle")[1] for state in path.states])
    history = ksd.simulate(scene, 0.8, dt=1e-3, loads={"push": ksd.Ramp(0.4, end=0.75)})
    pushed = ksd.Ramp(0.4, end=0.75)(history.t)
    y = history.sensors["place"]
    # it stands on the first branch, a little late, up to the limit point, and far from it soon after
    limit = int(np.argmax(np.diff(path.factor) < 0.0)) + 1
    before = pushed < 0.9 * path.limits[0]
    assert y[before] == pytest.approx(np.interp(pushed[before], path.factor[:limit], place[:limit]), abs=1e-4)
    snapped = y < 1.2 * place.min() / 2
    assert not snapped[pushed <= path.limits[0]].any() and snapped[-300:].all()
    far = (place < 0.8 * place.min()) & (path.factor > 0.7)
    assert y[-1] == pytest.approx(np.interp(0.75, path.factor[far], place[far]), rel=1e-3)


def test_a_dashpot_takes_its_share():
    scene = guide()
    scene.damper(scene.ground, "stage", damping=2.0, along="y", at=(0.1, 0, 0))
    words = {"loads": {"push": ksd.Step(0.0, start=0.01)}}
    lost = []
    for dt in (1e-3, 5e-4):
        trace = motion(scene, 0.3, dt=dt, **words)
        rate = trace.velocity[:, trace.model.node_names.index("stage"), 1]
        taken = np.sum(0.5 * (2.0 * rate[1:] ** 2 + 2.0 * rate[:-1] ** 2) * np.diff(trace.t))
        assert trace.energy["damped"][-1] == pytest.approx(taken, rel=1e-6)
        lost.append(abs(trace.energy["lost"][-1]))
    start = trace.energy["strain"][0]
    assert trace.energy["damped"][-1] > 0.3 * start
    assert lost[1] < 0.3 * lost[0] < 1e-3 * start


def test_a_shaken_base_is_a_moving_one():
    def on_a_carriage():
        joint = ksd.ParallelGuide(
            ksd.Material(E=200e9, nu=0.3, density=7800),
            length=0.1,
            thickness=0.5e-3,
            width=0.03,
            spacing=0.06,
        )
        scene = ksd.Mechanism("carried", plane="xy")
        base = scene.link("base", mass=3.0, inertia=(0.1, 0.1, 0.1), at=(0, 0, 0))
        stage = scene.link("stage", mass=0.5, inertia=(4e-4, 4e-4, 4e-4), at=(0.1, 0, 0))
        scene.join(base, stage, joint, at=(0, 0, 0), axis="z", toward="x")
        scene.actuate(base, along="y", at=(0, 0, 0), name="shake")
        scene.support(base, along="x", at=(0, 0, 0))
        scene.support(base, about="z")
        return scene

    T, stroke = 0.05, 0.01
    moved, off = ksd.Cycloid(stroke, duration=T), []
    for n in (25, 50):
        carried = motion(on_a_carriage(), T, dt=T / n, drives={"shake": moved})
        shaken = motion(
            guide(), T, dt=T / n, loads={"push": 0.0},
            base=ksd.Shake(along="y", acceleration=lambda t: stroke * 2 * np.pi / T**2 * np.sin(2 * np.pi * t / T)),
        )  # fmt: skip
        names = carried.model.node_names
        relative = carried.position[:, names.index("stage"), 1] - carried.position[:, names.index("base"), 1]
        own = shaken.position[:, shaken.model.node_names.index("stage"), 1]
        off.append(np.abs((relative - relative[0]) - (own - own[0])).max())
    assert off[1] < 2e-3 * stroke
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.1)


def test_a_free_body_tumbles_as_eulers_equations_say():
    J = np.array([1e-3, 2e-3, 2.8e-3])
    scene = ksd.Mechanism("tumbling")
    body = scene.link("body", mass=1.0, inertia=tuple(J), at=(0, 0, 0))
    fly = scene.link("fly")
    scene.ball(scene.ground, body, at=(0, 0, 0))
    ends = {"start": (0.05, 0, 0), "end": (0.1, 0, 0)}
    scene.leaf(
        body,
        fly,
        **ends,
        section=ksd.rectangle(1e-3, 1e-2),
        material=ksd.Material(E=2e11, nu=0.3),
        width_axis="z",
    )
    w0, until = np.array([0.3, 12.0, 0.2]), 0.5
    w, h = w0.copy(), 1e-4

    def rate(w):
        return (
            np.array([(J[1] - J[2]) * w[1] * w[2], (J[2] - J[0]) * w[2] * w[0], (J[0] - J[1]) * w[0] * w[1]])
            / J
        )

    R = np.eye(3)
    for _ in range(round(until / h)):
        k1 = rate(w)
        k2 = rate(w + 0.5 * h * k1)
        k3 = rate(w + 0.5 * h * k2)
        k4 = rate(w + h * k3)
        middle = w + 0.5 * h * k1
        R = R @ Rotation.from_rotvec(h * middle).as_matrix()
        w = w + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    off = []
    for dt in (2e-2, 1e-2, 5e-3):
        with warnings.catch_warnings():
            # its centre of mass is held, so these speeds contradict nothing
            warnings.simplefilter("error", ksd.SceneWarning)
            trace = motion(scene, until, dt=dt, rho=0.8, start="undeformed", speeds={"body": (0, 0, 0, *w0)})
        assert trace.velocity[0, trace.model.node_names.index("body"), 3:] == pytest.approx(w0, rel=1e-6)
        node = trace.model.node_names.index("body")
        off.append(np.abs(trace.rotation[-1, node] - R).max())
        spin = np.einsum("kij,ki->kj", trace.rotation[:, node], trace.velocity[:, node, 3:])
        momentum = np.einsum("kij,kj->ki", trace.rotation[:, node], spin * J)
        drift = np.abs(momentum - momentum[0]).max() / np.linalg.norm(momentum[0])
    assert np.log2(off[1] / off[2]) == pytest.approx(2.0, abs=0.1)
    assert drift < 1e-3


def test_speeds_that_contradict_a_pin_are_said_by_how_much():
    scene = ksd.Mechanism("rod", plane="xy")
    rod = scene.link("rod", mass=1.0, inertia=(1e-3, 1e-3, 1e-3), at=(0.1, 0, 0))
    scene.pin(scene.ground, rod, at=(0, 0, 0))
    fly = scene.link("fly")
    scene.leaf(
        rod,
        fly,
        start=(0.1, 0, 0),
        end=(0.15, 0, 0),
        section=ksd.rectangle(1e-3, 1e-2),
        material=ksd.Material(E=2e11, nu=0.3, density=7800),
        width_axis="z",
    )
    words = {"dt": 1e-3, "start": "undeformed"}
    with pytest.warns(ksd.SceneWarning, match="speeds of 'rod' contradict what holds it, by 0."):
        motion(scene, 5e-3, speeds={"rod": (0, 0, 0, 0, 0, 2.0)}, **words)
    with warnings.catch_warnings():
        warnings.simplefilter("error", ksd.SceneWarning)
        trace = motion(scene, 5e-3, speeds={"rod": (0, 0.2, 0, 0, 0, 2.0)}, **words)
    node = trace.model.node_names.index("rod")
    assert trace.velocity[0, node, 5] == pytest.approx(2.0, rel=1e-9)


def test_space_and_plane_agree_and_so_do_turned_scenes():
    turn = ksd.Ramp(0.02)
    flat = motion(guide(), 0.05, dt=1e-3, loads={"push": turn})
    axis, toward = np.array([1.0, 2.0, -2.0]) / 3.0, np.array([2.0, 1.0, 2.0]) / 3.0
    side = np.cross(axis, toward)
    Q = np.column_stack([toward, side, axis])
    joint = ksd.ParallelGuide(
        ksd.Material(E=200e9, nu=0.3, density=7800), length=0.1, thickness=0.5e-3, width=0.03, spacing=0.06
    )
    scene = ksd.Mechanism("turned")
    stage = scene.link("stage", mass=0.5, inertia=Q @ np.diag([4e-4] * 3) @ Q.T, at=Q @ (0.1, 0, 0))
    scene.join(scene.ground, stage, joint, at=(0, 0, 0), axis=axis, toward=toward)
    scene.load(stage, force=Q @ (0, 20, 0), at=Q @ (0.1, 0, 0), name="push")
    turned = motion(scene, 0.05, dt=1e-3, loads={"push": turn})
    names = flat.model.node_names.index("stage"), turned.model.node_names.index("stage")
    assert turned.position[:, names[1]] @ Q == pytest.approx(flat.position[:, names[0]], abs=1e-8)


def test_the_estimated_error_is_the_true_one():
    exact = motion(guide(), 0.12, dt=1.25e-4, loads={"push": ksd.Step(1.0)})
    node = exact.model.node_names.index("stage")
    y = exact.position[:, node, 1]
    for accuracy in (1e-2, 1e-3):
        trace = motion(guide(), 0.12, accuracy=accuracy, loads={"push": ksd.Step(1.0)})
        off = (
            np.abs(trace.position[:, node, 1] - np.interp(trace.t, exact.t, y)).max() / np.abs(y - y[0]).max()
        )
        assert trace.error <= accuracy
        assert 0.5 < trace.error / off < 2.0


def test_the_estimated_error_holds_vibrations_too_fast_for_the_steps():
    case = CASES["pivot"]
    history = ksd.simulate(pivot(), 0.3, accuracy=2e-3, **case.words)
    finer = case.run(0.3 / history.steps / 4)
    own, other = history["tip"].position, finer["tip"].position[::4]
    off = np.linalg.norm(own - other, axis=1).max() / np.linalg.norm(own - own[0], axis=1).max()
    assert 0.5 < history.error / off < 2.0


def test_the_error_of_vibrations_too_fast_for_the_steps_is_their_difference():
    """Of slow ones a third of the difference of runs with h and 2 h is left in the finer, of fast ones all of it."""
    t = (np.arange(400) + 0.5) / 400
    slow, fast = np.cos(2.0 * np.pi * t), np.cos(160.0 * np.pi * t)
    left = error_of_finer(np.column_stack([slow, fast, slow + fast]), t, 4.0)
    assert left == pytest.approx(np.column_stack([slow / 3.0, fast, slow / 3.0 + fast]), abs=1e-4)


def test_a_step_is_found_where_nothing_rings():
    scene = ksd.Mechanism("sled", plane="xy")
    sled = scene.link("sled", mass=2.0, inertia=(1e-3, 1e-3, 1e-3), at=(0, 0, 0))
    scene.slider(sled, along="x", at=(0, 0, 0))
    scene.load(sled, force=(4, 0, 0), at=(0, 0, 0), name="push")
    words = {"accuracy": 1e-3, "loads": {"push": ksd.Ramp(0.1)}, "start": "undeformed"}
    trace = motion(scene, 0.5, **words)
    # the ramp of half a cosine, then a constant acceleration
    end = 0.1**2 * (0.5 - 2 / np.pi**2) + 0.1 * 0.4 + 0.4**2
    assert trace.position[-1, 1, 0] == pytest.approx(end, rel=1e-4)


def test_small_motions_are_those_of_the_response():
    """Five frequencies at once, below and above that of the guide."""
    scene, frequencies = guide(), (2.0, 4.0, 7.0, 11.0, 17.0)
    scene._loads.clear()
    scene.sensor("stage", along="y", at=(0.1, 0, 0), name="tip")
    scene.load("stage", force=(0, 1e-3, 0), at=(0.1, 0, 0), name="sine")
    still = ksd.solve(scene, method="conventional")
    gain = np.abs(still.response(frequencies, inputs="sine", outputs="tip", damping=0.0).value[:, 0, 0])
    sines = sum((ksd.Sine(1.0, frequency_Hz=f) for f in frequencies), ksd.Step(0.0))
    history = ksd.simulate(scene, 2.0, dt=2.5e-4, loads={"sine": sines})
    own = still.frequencies(count=1).frequency_Hz[0]
    columns = [f(2 * np.pi * w * history.t) for w in (*frequencies, own) for f in (np.sin, np.cos)]
    y = history.sensors["tip"]
    found = np.linalg.lstsq(np.column_stack(columns), y - y[0], rcond=None)[0]
    assert np.hypot(found[0:10:2], found[1:10:2]) == pytest.approx(gain, rel=1e-3)


@pytest.mark.parametrize("seed", range(1000, 1010))
def test_random_motions_end_or_say_why(seed):
    """More of them in the benchmark."""
    end, faults, _ = random_motions.run(seed)
    assert end in ("end", "stop") and not faults


def test_an_event_ends_a_motion_where_it_happens():
    scene = guide()
    scene.sensor("stage", along="y", at=(0.1, 0, 0), name="tip")
    words = {"dt": 1e-3, "loads": {"push": ksd.Ramp(0.02)}, "stop": ksd.Event("tip", above="10 mm")}
    trace = motion(scene, 0.08, **words)
    assert trace.at_end
    assert "'tip' above 0.01" in trace.stop
    assert place(trace, "stage", trace.t[-1])[1] == pytest.approx(0.01, abs=1e-7)
    whole = motion(scene, 0.08, dt=1e-3, loads={"push": ksd.Ramp(0.02)})
    y = whole.position[:, whole.model.node_names.index("stage"), 1]
    assert trace.t[-1] == pytest.approx(np.interp(0.01, y - y[0], whole.t), abs=1e-4)


def test_what_does_not_move_is_refused():
    with pytest.raises(ksd.SceneError, match="chain of elements"):
        motion(guide(), 0.01, dt=1e-3, mesh=ksd.Mesh("corotational", elements=3))
    with pytest.raises(ksd.SceneError, match="energy_momentum"):
        motion(guide(), 0.01, dt=1e-3, method="energy_momentum")


def test_a_motion_that_steps_make_unstable_is_said():
    """A wire that swings back through its straight state, without damping by the method, in long steps."""
    with pytest.warns(ksd.SceneWarning, match=r"J came from nothing, .* unstable with steps of this length"):
        trace = motion(wire(), 1.2, dt=0.0142, rho=1.0, start="undeformed")
    fine = motion(wire(), 1.2, dt=2e-3, rho=1.0, start="undeformed")
    assert np.abs(fine.energy["lost"]).max() < 1e-3 * fine.energy["kinetic"].max()
    assert np.isfinite(trace.x).all() and trace.energy["kinetic"].max() > 3.0 * fine.energy["kinetic"].max()


@pytest.mark.parametrize(("dt", "is_said"), [(2e-2, True), (1e-4, False)])
def test_energy_that_is_missing_in_the_balance_is_said(dt, is_said):
    """What dampers took in a motion that tilts as well, which a coarse step does not follow."""
    scene = ksd.Mechanism("guide", plane="xy")
    stage = scene.link("stage", mass=0.4, inertia=(2.5e-4, 1.5e-4, 3e-4), at=(0, 0.07, 0))
    steel = ksd.Material(E=200e9, nu=0.3, density=7800, loss_factor=0.01)
    for x in (-0.03, 0.03):
        section = ksd.rectangle(3e-4, 0.02)
        scene.leaf("ground", stage, start=(x, 0, 0), end=(x, 0.06, 0), section=section, material=steel)
    scene.actuate(stage, along="x", at=(0, 0.03, 0), name="push")
    start = ksd.solve(scene, push=3e-3)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", ksd.SceneWarning)
        history = ksd.simulate(
            scene, 0.1, dt=dt, drives={"push": None}, start=start, damping_at=8.0, progress=False
        )
    notes = [note for note in history.notes if "missing in the balance of energies" in note]
    assert len(notes) == is_said and is_said == any("missing in the balance" in str(w.message) for w in said)
    # amplitude of an oscillator of 7.95 Hz with a damping ratio of half the loss factor
    peaks = np.abs(history.drives["push"].value)[history.t > 0.0314]
    assert is_said or peaks.max() == pytest.approx(3e-3 * np.exp(-0.005 * np.pi), rel=5e-3)
