"""Loads along leaf springs: line loads and pressure, against shooting of rods, weight, closed forms and one another."""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import root
from scipy.spatial.transform import Rotation

import ksd
from ksd.answers.tangent import assemble_tangent
from ksd.model.arrays import make_workspace
from ksd.model.load_rate import distributed_force
from ksd.model.newton import assemble, take_step

E, NU, T, W, L = 200e9, 0.3, 0.5e-3, 10e-3, 0.1
STEEL, STRIP = ksd.Material(E=E, nu=NU), ksd.rectangle(T, W)
EI = E * STRIP.Iz


def cantilever(plane="xy", *, turn=None, material=STEEL, section=STRIP, **words):
    """A strip from ground to a tip, turned in space, and the leaf."""
    R = np.eye(3) if turn is None else turn
    scene = ksd.Mechanism("strip", plane=plane)
    tip = scene.link("tip")
    leaf = scene.leaf(
        "ground", tip, start=(0, 0, 0), end=R @ (L, 0, 0), width_axis=R @ (0, 0, 1), section=section, material=material,
        name="strip", **words,
    )  # fmt: skip
    return scene, leaf


def solved(scene, **words):
    return ksd.solve(scene, method="conventional", estimate=False, **words)


def shot(force, pressure, spans, tip):
    """Position, rotation and root wrench (6,) of the strip as a rod, by shooting: force(s) [N/m], pressure(s) [N/m], cuts of
    the integration, and dead force at the tip."""
    G = E / (2 * (1 + NU))
    stiff = np.array([G * STRIP.J, E * STRIP.Iy, E * STRIP.Iz])
    soft = np.array([1 / (E * STRIP.A), 1 / (STRIP.ky * G * STRIP.A), 1 / (STRIP.kz * G * STRIP.A)])

    def slope(s, y):
        R, n, m = y[3:12].reshape(3, 3), y[12:15], y[15:]
        a, b, c = (R.T @ m) / stiff
        v = R @ (np.array([1.0, 0, 0]) + soft * (R.T @ n))
        turned = R @ np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]])
        return np.concatenate([v, turned.ravel(), -force(s) - pressure(s) * R[:, 1], -np.cross(v, n)])

    def end(wrench):
        y = np.concatenate([np.zeros(3), np.eye(3).ravel(), wrench])
        for part in itertools.pairwise(spans):
            y = solve_ivp(slope, part, y, method="DOP853", rtol=1e-10, atol=1e-11).y[:, -1]
        return y

    def gap(wrench):
        y = end(wrench)
        return np.concatenate([y[12:15] - tip, y[15:] / L])

    found = root(gap, np.concatenate([tip, np.zeros(3)]), tol=1e-12)
    y = end(found.x)
    assert np.abs(gap(found.x)).max() < 1e-9
    return y[:3], y[3:12].reshape(3, 3), found.x


def ramp(first, last):
    return lambda s: np.array(first) * (1 - s / L) + np.array(last) * s / L


def none(s):
    return np.zeros(3)


SHOT = {
    "linear": (
        "xy", [("line", {"force": (0, -30, 0), "to": (5, 80, 0)})], ramp((0, -30, 0), (5, 80, 0)), 0.0, (0, L), (0, 0, 0),
    ),
    "partial": (
        "xy", [("line", {"force": (0, -60, 0), "start": 0.03, "end": 0.07})],
        lambda s: np.array([0, -60.0, 0]) * (0.03 <= s <= 0.07), 0.0, (0, 0.03, 0.07, L), (0, 0, 0),
    ),
    "pressure": ("xy", [("pressure", {"pressure": 10e3})], none, 100.0, (0, L), (0, 2.0, 0)),
    "in space": (
        None, [("line", {"force": (3, -60, 40), "to": (0, 0, -100)})], ramp((3, -60, 40), (0, 0, -100)), 0.0, (0, L),
        (0, 0, 0),
    ),
    "both in space": (
        None, [("pressure", {"pressure": 6e3}), ("line", {"force": (0, 0, 30), "start": 0.05})],
        lambda s: np.array([0, 0, 30.0]) * (s >= 0.05), 60.0, (0, 0.05, L), (0, 0.5, 2.0),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", SHOT)
def test_shooting(name):
    plane, loads, force, push, spans, tip = SHOT[name]
    scene, leaf = cantilever(plane)
    for kind, words in loads:
        (scene.line_load if kind == "line" else scene.pressure)(leaf, **words)
    if any(tip):
        scene.load("tip", force=tip, at=(L, 0, 0))
    pose = solved(scene)
    place, R, wrench = shot(force, lambda s: push, spans, np.array(tip, float))
    assert pose.displacement("tip") == pytest.approx(place - (L, 0, 0), abs=2e-7 * L)
    assert pose.links["tip"][1] == pytest.approx(R, abs=4e-7)
    at_root = pose.interface_forces().of("strip", "ground")
    assert at_root.force == pytest.approx(wrench[:3], abs=1e-6 * np.abs(wrench[:3]).max())
    assert at_root.moment == pytest.approx(wrench[3:], abs=1e-6 * np.abs(wrench[3:]).max())
    assert pose.iterations <= 6
    # the last station is the tip, the first the root
    along = pose.section_forces()["strip"]
    assert along.start[:3] == pytest.approx(wrench[:3], abs=1e-6 * np.abs(wrench[:3]).max())
    assert along.end[3:] == pytest.approx(0.0, abs=1e-8)
    assert pose.verify().relative < 1e-6


@pytest.mark.parametrize("plane", ["xy", None])
def test_weight_is_a_line_load(plane):
    pull = np.array([1.0, -9.0, 0.0 if plane else 2.0])
    density = 2.0 / STRIP.A
    heavy, _ = cantilever(plane, material=ksd.Material(E=E, nu=NU, density=density))
    heavy.gravity = pull
    loaded, leaf = cantilever(plane)
    loaded.line_load(leaf, force=2.0 * pull)
    one, other = solved(heavy), solved(loaded)
    assert one.displacement("tip") == pytest.approx(other.displacement("tip"), abs=1e-9 * L)
    both, leaf = cantilever(plane, material=ksd.Material(E=E, nu=NU, density=density))
    both.gravity = 0.25 * pull
    both.line_load(leaf, force=1.5 * pull)
    assert solved(both).displacement("tip") == pytest.approx(one.displacement("tip"), abs=1e-9 * L)
    assert one.strain_energy()["strip"] == pytest.approx(other.strain_energy()["strip"], rel=1e-9)


@pytest.mark.parametrize("plane", ["xy", None])
def test_parts_are_the_whole(plane):
    whole, leaf = cantilever(plane)
    whole.line_load(leaf, force=(0, -20, 0), to=(0, 10, 0))
    whole.pressure(leaf, 4e3)
    parts, leaf = cantilever(plane)
    cuts = (0.0, 0.03, 0.055, L)
    for a, b in itertools.pairwise(cuts):
        ends = [(0, -20 + 30 * s / L, 0) for s in (a, b)]
        parts.line_load(leaf, force=ends[0], to=ends[1], start=a, end=b if b < L else None)
        parts.pressure(leaf, 4e3, start=a, end=b)
    one, other = solved(whole), solved(parts)
    assert one.displacement("tip") == pytest.approx(other.displacement("tip"), abs=1e-7 * L)
    # a point where a part begins, and the other side with the other sign
    again, leaf = cantilever(plane)
    again.point(leaf, 0.03)
    again.line_load(leaf, force=(0, -20, 0), to=(0, 10, 0))
    again.pressure(leaf, -4e3, side="-e2")
    assert solved(again).displacement("tip") == pytest.approx(one.displacement("tip"), abs=1e-7 * L)


@pytest.mark.parametrize("seed", range(3))
def test_root_force_under_pressure(seed):
    """Without stretch it is pressure times the chord, turned by a quarter, for any shape."""
    rng = np.random.default_rng(seed)
    stiff = ksd.numbers(A=1.0, J=STRIP.J, Iy=STRIP.Iy, Iz=STRIP.Iz, width=W, thickness=T)
    scene, leaf = cantilever(section=stiff)
    scene.pressure(leaf, 5e3)
    scene.load("tip", force=(*rng.normal(size=2), 0), moment=(0, 0, 0.05 * rng.normal()), at=(L, 0, 0))
    pose = solved(scene)
    x, y, _ = pose.links["tip"][0] + (L, 0, 0)
    push = 5e3 * W
    tip = np.asarray(scene.scene().loads[0].force)
    expected = tip + push * np.array([-y, x, 0])
    found = pose.interface_forces().of("strip", "ground").force
    assert found == pytest.approx(expected, abs=1e-8 * np.abs(expected).max())


def angled(loads, turn=None, plane=None):
    """Two strips in a row, the second at an angle and curved, with loads along both."""
    R = np.eye(3) if turn is None else turn
    scene = ksd.Mechanism("two", plane=plane)
    for name in ("a", "b"):
        scene.link(name)
    heavy = ksd.Material(E=E, nu=NU, density=7800)
    ends = np.array([(0, 0, 0), (0.1, 0, 0), (0.11, 0.01, 0), (0.2, 0.05, 0)]) @ R.T
    words = {"width_axis": R @ (0, 0, 1), "section": STRIP, "material": heavy}
    arc = ksd.Arc(radius=0.12, angle=2 * math.asin(np.linalg.norm(ends[3] - ends[2]) / 0.24))
    one = scene.leaf("ground", "a", start=ends[0], end=ends[1], name="one", **words)
    two = scene.leaf("a", "b", start=ends[2], end=ends[3], name="two", curve=arc, **words)
    scene.gravity = R @ (1.0, -9.0, 0.0 if plane else 3.0)
    if "dead" in loads:
        scene.line_load(one, force=R @ (20, -30, 0), to=R @ (0, 40, 0 if plane else 20))
        scene.line_load(two, force=R @ (0, 30, 0), start=0.02)
    if "pressure" in loads:
        scene.pressure(one, 3e3)
        scene.pressure(two, 2e3, side="-e2")
    return scene


@pytest.mark.parametrize("loads", ["dead", "dead, pressure"])
def test_tangent(loads):
    """Tangent and derivative by the load factor against differences, at a random state near a bent one."""
    pose, rng = solved(angled(loads)), np.random.default_rng(1)
    model, arrays, state = pose.model, pose.model.arrays, pose.motion.copy()
    n, work, held = arrays.plan.unknowns, make_workspace(arrays), np.zeros(len(arrays.terms.start))
    scale = np.ones(n)
    for u in arrays.start[1:]:
        scale[u : u + 3] = arrays.size

    def residual(motion, factor=1.0):
        for _ in range(12):
            assemble(arrays, motion, held, factor, work)
            take_step(arrays, motion, np.zeros(n), work, 1.0)
        assemble(arrays, motion, held, factor, work, rounding=0.0)
        return work.rhs.copy()

    def moved(step):
        motion = state.copy()
        assemble(arrays, motion, held, 1.0, work)
        take_step(arrays, motion, step, work, 1.0)
        return residual(motion)

    state_step = 1e-3 * rng.normal(size=n) * np.where(scale < 1.0, 1e-3 * scale, 1.0)
    assemble(arrays, state, held, 1.0, work)
    take_step(arrays, state, state_step, work, 1.0)
    r = residual(state)
    assembled = assemble_tangent(model, state)
    K = assembled.matrix()
    if assembled.skew is not None:
        K[np.ix_(*(assembled.skew.unknowns,) * 2)] += assembled.skew.matrix
    assert (assembled.skew is not None) == ("pressure" in loads) != arrays.conservative
    h, found = 1e-6, np.zeros((n, n))
    for j in range(n):
        step = np.zeros(n)
        step[j] = h * scale[j]
        found[:, j] = (moved(step) - moved(-step)) / (2 * step[j])
    for u in arrays.start[1:]:
        # by convention half the rotation of the moment that is left
        a, b, c = 0.5 * r[u + 3 : u + 6]
        found[u + 3 : u + 6, u + 3 : u + 6] += [[0, -c, b], [c, 0, -a], [-b, a, 0]]
    size = np.sqrt(np.abs(np.diag(K)))
    assert np.abs((K - found) / np.outer(size, size)).max() < 1e-6
    residual(state)
    rate = distributed_force(arrays, work)
    found = (residual(state.copy(), 1.002) - residual(state.copy(), 0.998)) / 0.004
    assert np.abs((rate - found) * scale).max() < 1e-6 * np.abs(found * scale).max()


def test_turned_and_in_a_plane():
    flat, space = (
        solved(angled("dead, pressure", plane="xy")),
        solved(angled("dead, pressure", plane="xy"), planar=False),
    )
    assert flat.displacement("b") == pytest.approx(space.displacement("b"), abs=1e-9)
    R = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    one, other = solved(angled("dead, pressure")), solved(angled("dead, pressure", R))
    assert R @ one.displacement("b") == pytest.approx(other.displacement("b"), abs=1e-9)
    assert one.stress().largest_Pa == pytest.approx(other.stress().largest_Pa, rel=1e-7)
    assert one.buckling(count=1).positive == pytest.approx(other.buckling(count=1).positive, rel=1e-5)


def test_small_loads_are_those_of_beam_theory():
    """q L^4 / 8 EI, q L^3 / 6 EI and q L^2 / 2 (Roark's formulas for stress and strain, table 8.1, 2a)."""
    for word in ("line", "pressure"):
        scene, leaf = cantilever(
            section=ksd.numbers(A=1.0, J=STRIP.J, Iy=STRIP.Iy, Iz=STRIP.Iz, width=W, thickness=T)
        )
        q = 1e-3
        scene.line_load(leaf, force=(0, q, 0)) if word == "line" else scene.pressure(leaf, q / W)
        pose = solved(scene)
        assert pose.displacement("tip")[1] == pytest.approx(q * L**4 / (8 * EI), rel=1e-6)
        assert pose.rotation("tip")[2] == pytest.approx(q * L**3 / (6 * EI), rel=1e-6)
        assert pose.stress().largest_Pa == pytest.approx(q * L**2 / 2 * (T / 2) / STRIP.Iz, rel=1e-5)


def test_ring_under_pressure():
    """A ring buckles at 3 EI / R^3 of following pressure (Levy 1884; Timoshenko and Gere, Theory of elastic stability,
    7.3), a quarter of it between planes of symmetry."""
    R = 0.05
    scene = ksd.Mechanism("quarter of a ring", plane="xy")
    ends = {"right": ((R, 0, 0), "x"), "top": ((0, R, 0), "y")}
    for name, (at, along) in ends.items():
        scene.link(name)
        scene.slider(name, along=along, at=at)
    stiff = ksd.numbers(A=1.0, J=STRIP.J, Iy=STRIP.Iy, Iz=STRIP.Iz, width=W, thickness=T)
    leaf = scene.leaf(
        "right", "top", start=ends["right"][0], end=ends["top"][0], width_axis="z", section=stiff, material=STEEL,
        curve=ksd.Arc(radius=R, angle=math.pi / 2), name="ring",
    )  # fmt: skip
    critical = 3 * EI / R**3 / W
    scene.pressure(leaf, 1e-3 * critical)
    pose = solved(scene)
    assert np.abs(pose.displacement("top")).max() < 1e-6 * R
    hoop = pose.section_forces()["ring"].values[:, 0]
    assert hoop == pytest.approx(-1e-3 * critical * W * R, rel=1e-6)
    assert 1e-3 * (1.0 + pose.buckling(count=1).positive) == pytest.approx(1.0, rel=2e-3)


def test_path_by_arc_length_and_in_steps():
    scene, leaf = cantilever()
    scene.pressure(leaf, 30e3)
    scene.line_load(leaf, force=(0, 0, 0), to=(-40, 0, 0))
    pose = solved(scene)
    path = ksd.follow(scene, until=1.0)
    assert path.states[-1].displacement("tip") == pytest.approx(pose.displacement("tip"), abs=1e-8)
    assert pose.stable
    assert pose.error.relative < 1e-4


def test_gradients():
    scene, leaf = cantilever()
    scene.line_load(leaf, force=(0, -20, 0), start=0.04)
    scene.pressure(leaf, 4e3)
    scene.load("tip", force=(0, 1, 0), at=(L, 0, 0))
    names = ("strip.line_load_force_y", "strip.pressure", "tip.load_force_y")
    pose = ksd.solve(scene)
    found = pose.gradient(lambda one: one.displacement("tip")[1], by=names)

    def at(push=0.0, press=0.0):
        other, leaf = cantilever()
        other.line_load(leaf, force=(0, -20 + push, 0), start=0.04)
        other.pressure(leaf, 4e3 + press)
        other.load("tip", force=(0, 1, 0), at=(L, 0, 0))
        return solved(other).displacement("tip")[1]

    assert found[names[0]] == pytest.approx((at(push=0.1) - at(push=-0.1)) / 0.2, rel=1e-5)
    assert found[names[1]] == pytest.approx((at(press=20.0) - at(press=-20.0)) / 40.0, rel=1e-5)


def test_stiffness_is_the_derivative_of_the_answer():
    scene, leaf = cantilever(None)
    scene.pressure(leaf, 8e3)
    scene.load("tip", force=(0, 0.5, 0.3), at=(L, 0, 0))
    pose = solved(scene)
    compliance = pose.stiffness("tip").compliance

    def at(force):
        other, leaf = cantilever(None)
        other.pressure(leaf, 8e3)
        other.load("tip", force=np.array([0, 0.5, 0.3]) + force, at=(L, 0, 0))
        return solved(other).displacement("tip")

    for k, axis in enumerate(np.eye(3)):
        found = (at(1e-3 * axis) - at(-1e-3 * axis)) / 2e-3
        assert compliance[:3, k] == pytest.approx(found, abs=1e-5 * np.abs(compliance[:3, :3]).max())


def test_frequencies_under_pressure():
    """Of one leaf, whose vibration inside is not seen by the pressure, and of four of a quarter, where most of it is."""
    steel, found = ksd.Material(E=E, nu=NU, density=7800.0), []
    for count in (1, 4):
        scene = ksd.Mechanism("strip", plane="xy")
        names = ["ground", *(f"cut {k}" for k in range(1, count)), "tip"]
        for k, (one, other) in enumerate(itertools.pairwise(names)):
            scene.link(other)
            at = [(L * j / count, 0, 0) for j in (k, k + 1)]
            leaf = scene.leaf(one, other, start=at[0], end=at[1], section=STRIP, material=steel)
            scene.pressure(leaf, 8e3)
        pose = solved(scene)
        assert pose.displacement("tip", at=(L, 0, 0))[1] > 0.4 * L
        found.append(pose.frequencies(count=3).frequency_Hz)
    assert found[0] == pytest.approx(found[1], rel=2e-3)
    assert found[0][:2] == pytest.approx(found[1][:2], rel=5e-4)


def test_joints_are_condensed_beside_it():
    guide = ksd.ParallelGuide(STEEL, length=0.06, thickness=0.3e-3, width=10e-3, spacing=0.04)
    scene = ksd.Mechanism("guide")
    stage = scene.link("stage")
    placed = scene.join(scene.ground, stage, guide, at=(0, 0, 0), axis="z", toward="y", name="guide")
    blade = scene.leaf(
        "ground", stage, start=(0.05, 0, 0), end=(0.05, 0.06, 0), width_axis="z", section=STRIP, material=STEEL,
        name="blade",
    )  # fmt: skip
    scene.line_load(blade, force=(-10, 0, 0), start=0.03)
    scene.actuate_joint(placed, name="push")
    full, reduced = (ksd.solve(scene, push=2e-3, method=m, estimate=False) for m in ("conventional", "full"))
    assert reduced.forces["push"] == pytest.approx(full.forces["push"], rel=1e-6)


def test_scene_file(tmp_path):
    scene, leaf = cantilever()
    scene.line_load(leaf, force=(0, -2, 0), to=(0, 1, 0), end=0.06)
    scene.pressure(leaf, 4e3, side="-e2", start=0.02, name="gas")
    ksd.save_scene(scene, tmp_path / "strip.toml")
    read, _, _ = ksd.load_scene(tmp_path / "strip.toml")
    assert read.scene() == scene.scene()
    assert "line load" in str(scene)
    text = (tmp_path / "strip.toml").read_text()
    words = text.replace("force = [0, -2, 0]", 'force = ["0 N/m", "-2 mN/mm", "0 N/m"]')
    words = words.replace("pressure = 4000", 'pressure = "40 mbar"').replace("end = 0.06", 'end = "60 mm"')
    assert words.count("mbar") == words.count("mN/mm") == words.count("60 mm") == 1
    (tmp_path / "words.toml").write_text(words)
    again = ksd.load_scene(tmp_path / "words.toml")[0].scene()
    assert again.line_loads == scene.scene().line_loads
    assert again.pressures[0].pressure == pytest.approx(4e3)


def test_picture_and_doctor():
    scene, leaf = cantilever()
    scene.line_load(leaf, force=(0, -2, 0), end=0.06)
    scene.pressure(leaf, 4e3, name="gas")
    pose = solved(scene)
    arrows = {load.name: load for load in pose.shape().line_loads}
    assert arrows["strip.line_load"].place[-1] == pytest.approx(
        np.array([0.06, 0, 0]), abs=0.02
    )  # fmt: skip
    R = pose.links["tip"][1]
    assert arrows["gas"].value[-1] == pytest.approx(4e3 * W * R[:, 1], rel=1e-9)
    texts = [t.get_text() for t in pose.plot().axes[0].texts]
    assert any("2 N/m" in t for t in texts)
    assert any("4 kPa" in t for t in texts)
    assert ksd.doctor(scene).redundant == ()


def test_motion():
    """A line load is the weight of a leaf of that density, also in time; the work of one that changes is in the balance."""
    heavy, g = ksd.Material(E=E, nu=NU, density=7800), 9.0
    falling, _ = cantilever(material=heavy)
    falling.gravity = (0, -g, 0)
    pushed, leaf = cantilever(material=heavy)
    pushed.line_load(leaf, force=(0, -g * 7800 * STRIP.A, 0))
    words = {"until": 0.02, "dt": 5e-4, "start": "undeformed", "progress": False}
    one, other = ksd.simulate(falling, **words), ksd.simulate(pushed, **words)
    assert other["tip"].position == pytest.approx(one["tip"].position, abs=1e-9)
    assert other.energy.work == pytest.approx(
        -one.energy.gravity, abs=1e-6 * np.abs(one.energy.gravity).max()
    )
    partial, leaf = cantilever(material=heavy)
    partial.line_load(leaf, force=(0, -1.0, 0), start=0.05, name="push")
    history = ksd.simulate(partial, until=0.06, dt=2e-4, loads={"push": ksd.Ramp("40 ms")}, progress=False)
    assert np.abs(history.energy.lost).max() < 2e-3 * history.energy.work.max()
    still = solved(partial).displacement("tip")[1]
    assert history["tip"].position[-1, 1] == pytest.approx(still, rel=0.1)
    halves, leaf = cantilever(material=heavy)
    for k in range(2):
        halves.line_load(leaf, force=(0, -g * 7800 * STRIP.A, 0), start=0.05 * k, end=0.05 * (k + 1))
    # the leaf is divided where they meet
    off = np.abs(ksd.simulate(halves, **words)["tip"].position - one["tip"].position).max()
    assert off < 1e-3 * np.ptp(one["tip"].position[:, 1])


BAD = {
    "beyond": (lambda s, f: s.line_load(f, force=(0, 1, 0), end=0.2), "end = 0.2 m is beyond the end of leaf 'strip'"),
    "starts beyond": (lambda s, f: s.pressure(f, 1.0, start=0.1), "start = 0.1 m is beyond the end of leaf 'strip'"),
    "backward": (lambda s, f: s.line_load(f, force=(0, 1, 0), start=0.05, end=0.02), "give 0 <= start < end"),
    "before": (lambda s, f: s.line_load(f, force=(0, 1, 0), start=-0.01), "give 0 <= start < end"),
    "link": (lambda s, f: s.line_load("tip", force=(0, 1, 0)), "line load: 'tip' is a link"),
    "no leaf": (lambda s, f: s.pressure("stripe", 1.0), "there is no free-form leaf 'stripe'.*strip"),
    "wire": (lambda s, f: s.pressure("wire", 1.0), "'wire' has a round section, which has no face; give a line load"),
    "no width": (lambda s, f: s.pressure("beam", 1.0), "the section of leaf 'beam' has no width"),
    "side": (lambda s, f: s.pressure(f, 1.0, side="left"), "side = 'left': give '\\+e2' or '-e2'"),
    "force": (lambda s, f: s.line_load(f, force=3.0), "force = 3.0 must be three numbers .* in N/m"),
    "no number": (lambda s, f: s.pressure(f, "2 bar"), "pressure = '2 bar' is not a number"),
    "name": (
        lambda s, f: [s.pressure(f, 1.0, name="a"), s.line_load(f, force=(0, 1, 0), name="a")], "the load name 'a' is used",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_input(name):
    scene, leaf = cantilever()
    words = {"material": STEEL, "width_axis": "z"}
    scene.wire("ground", "tip", start=(0, 0.01, 0), end=(L, 0.01, 0), diameter=1e-3, name="wire", **words)
    bare = ksd.numbers(A=1e-6, J=1e-14, Iy=1e-14, Iz=1e-14)
    scene.leaf("ground", "tip", start=(0, 0.02, 0), end=(L, 0.02, 0), section=bare, name="beam", **words)
    call, message = BAD[name]
    with pytest.raises(ksd.SceneError, match=message):
        call(scene, leaf)


def test_refused():
    scene, leaf = cantilever(material=ksd.Material(E=E, nu=NU, density=7800))
    scene.pressure(leaf, 1e3, name="gas")
    with pytest.raises(ksd.SceneError, match="pressure 'gas' has no motion in time"):
        ksd.simulate(scene, until=0.01, progress=False)
    with pytest.raises(
        ksd.SceneError, match="leaf 'strip' is a chain of elements, which takes no load along its length"
    ):
        ksd.solve(scene, mesh=ksd.Mesh("corotational", elements=4))
    for method in ("constant", "modal"):
        with pytest.raises(ksd.SceneError, match="loads along leaf springs; use another method"):
            ksd.solve(scene, method=method)
    with pytest.raises(
        ksd.SceneError, match="has loads along leaf springs, of which rest shapes are not known"
    ):
        ksd.rest_shape(scene)
    with pytest.raises(ksd.SceneError, match="the load 'gas' along leaf 'strip' is not written"):
        solved(scene).export("strip.inp")
    light, leaf = cantilever()
    light.mass("tip", mass=0.01, at=(L, 0, 0))
    light.line_load(leaf, force=(0, 1, 0))
    with pytest.raises(
        ksd.SceneError, match="leaf 'strip' has no mass, so that in time nothing carries the load"
    ):
        ksd.simulate(light, until=0.01, progress=False)
