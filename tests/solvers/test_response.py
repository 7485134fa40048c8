"""Responses about a pose: closed forms of one mass, direct solutions of the dynamic stiffness, reciprocity, balances."""

import numpy as np
import pytest
from scenes import STEEL
from scipy.spatial.transform import Rotation
from uncondensed import uncondensed

import ksd
from ksd.answers.frequencies import frequencies
from ksd.answers.mass import base_load
from ksd.errors import KinematicsError, SceneError
from ksd.units import mm

LOSSY = ksd.Material(E=STEEL.E, G=STEEL.G, density=STEEL.density, loss_factor=0.02)
WEIGHTLESS = ksd.Material(E=STEEL.E, G=STEEL.G)


def guide(
    *, material=LOSSY, held=False, gravity=None, damper=0.0, plane="xy", turn=None, drive=True, height=0.01
):
    """A stage of 1 kg on two leaf springs, driven along x, with sensors on it; held: it moves along x only."""
    turn = np.eye(3) if turn is None else turn
    scene = ksd.Mechanism("guide", plane=plane)
    stage = scene.link("stage")
    at = turn @ (0.025, 0.06, height)
    scene.mass(stage, mass=1.0, inertia=turn @ np.diag([1e-3, 1e-3, 2e-3]) @ turn.T, at=at)
    for x in (0.0, 0.05):
        scene.leaf(
            scene.ground, stage, start=turn @ (x, 0, 0), end=turn @ (x, 0.06, 0), material=material,
            section=ksd.rectangle(0.3 * mm, 20 * mm), width_axis=turn @ (0, 0, 1),
        )  # fmt: skip
    ex, ey, ez = turn.T
    if drive:
        scene.actuate(stage, along=ex, at=at, name="push")
    if held:
        scene.support(stage, along=ey, at=at)
        scene.support(stage, about=ez)
    scene.load(stage, force=1e-9 * ey, at=turn @ (0.0, 0.06, 0), name="knock")
    scene.sensor(stage, along=ex, at=turn @ (0.05, 0.06, 0), name="tip")
    scene.sensor(stage, along=ey, at=turn @ (0.05, 0.06, 0), kind="acceleration", name="shake")
    scene.sensor(stage, about=ez, name="tilt", kind="velocity")
    if damper:
        scene.damper(scene.ground, stage, along=ex, at=turn @ (0, 0.06, 0), damping=damper)
    scene.gravity = gravity
    return scene


@pytest.fixture(scope="module")
def pose():
    return ksd.solve(guide(), push=2 * mm)


def direct(pose, f, force, seen, *, freed=("push",), loss=0.0, dampers=()):
    """Amplitude of `seen` under `force`, both in all unknowns, from (K (1 + i loss) - w^2 M + i w C) x = force."""
    K, M = uncondensed(pose.model, pose.motion, freed)
    w = 2 * np.pi * f
    return seen @ np.linalg.solve(
        K * (1 + 1j * loss) - w**2 * M + 1j * w * sum(dampers, np.zeros_like(K)), force
    )


def gradient(pose, name):
    """The row of a sensor on the stage in all unknowns, by differences of its reading at moved links."""
    sensor = next(s for s in pose.model.scene.sensors if s.name == name)
    start, K = int(pose.model.arrays.start[1]), uncondensed(pose.model, pose.motion)[0]
    row, e = np.zeros(len(K)), np.array(sensor.term.direction)
    if sensor.term.kind == "rotation":
        row[start + 3 : start + 6] = e
    else:
        arm = pose.motion.R[1] @ (np.array(sensor.term.point) - pose.model.rest.x[1])
        row[start : start + 3], row[start + 3 : start + 6] = e, np.cross(arm, e)
    return row


def test_at_no_frequency_it_is_the_static_compliance(pose):
    found = pose.response([1e-4], inputs="push", outputs="push", damping=0.0)
    stiffness = pose.drive_stiffness()["push"]
    assert found.value[0, 0, 0].real == pytest.approx(1 / stiffness, rel=1e-9)
    assert found.plant.static_gain()[0, 0] == pytest.approx(1 / stiffness, rel=1e-12)


@pytest.mark.parametrize("damper", [0.0, 30.0], ids=("plain", "damped"))
def test_direct_solutions_of_the_dynamic_stiffness(damper):
    """With all modes; no damping but the dashpot, which is far from proportional."""
    pose = ksd.solve(guide(damper=damper), push=2 * mm)
    found = pose.response(
        np.geomspace(0.5, 900, 10), inputs=["push", "knock"], outputs=["tip", "shake", "tilt"], damping=0.0,
        modes=200,
    )  # fmt: skip
    assert not np.isfinite(found.plant.left_out_Hz) and not found.error.any()
    K, _ = uncondensed(pose.model, pose.motion, ("push",))
    start = int(pose.model.arrays.start[1])
    push, dash = np.zeros((2, len(K)))
    arms = [
        pose.motion.R[1] @ (np.array(p) - pose.model.rest.x[1]) for p in ((0.025, 0.06, 0.01), (0, 0.06, 0))
    ]
    for row, arm in zip((push, dash), arms, strict=True):
        row[start], row[start + 3 : start + 6] = 1.0, np.cross(arm, (1, 0, 0))
    knock = np.zeros(len(K))
    knock[start + 1], knock[start + 3 : start + 6] = 1e-9, np.cross(arms[1], (0, 1e-9, 0))
    C = damper * np.outer(dash, dash)
    for k, f in enumerate(found.frequency_Hz):
        for i, force in enumerate((push, knock)):
            for o, (name, order) in enumerate((("tip", 0), ("shake", 2), ("tilt", 1))):
                expected = (2j * np.pi * f) ** order * direct(
                    pose, f, force, gradient(pose, name), dampers=[C]
                )
                assert found.value[k, o, i] == pytest.approx(expected, rel=1e-8)


def test_few_modes_are_within_their_error(pose):
    few = pose.response(
        np.geomspace(0.5, 400, 40), inputs="push", outputs=["push", "tip"], damping=0.0, modes=1
    )
    all_of_them = pose.response(
        few.frequency_Hz, inputs="push", outputs=["push", "tip"], damping=0.0, modes=200
    )
    off = np.abs(few.value - all_of_them.value)[:, 0]
    assert np.all(off <= few.error[:, 0] * (1 + 1e-6) + 1e-9 * few.gain[:, 0]) and off.max() > 0.0


def test_reciprocity_of_forces_and_motions():
    """Displacement here by a force there is that there by a force here."""
    scene = guide(damper=5.0)
    scene.sensor("stage", along="y", at=(0.0, 0.06, 0), name="at the knock")
    pose = ksd.solve(scene, push=2 * mm)
    f = np.geomspace(1, 800, 7)
    there = pose.response(f, inputs="knock", outputs="push").value[:, 0, 0] / 1e-9
    # a drive is freed where it is an output only, too
    here = pose.response(f, inputs="push", outputs="at the knock").value[:, 0, 0]
    assert there == pytest.approx(here, rel=1e-10)


def test_one_mass_on_a_shaken_base_has_the_closed_form():
    pose = ksd.solve(guide(material=WEIGHTLESS, held=True), push=0.0)
    zeta, f1 = 0.03, pose.frequencies(freed=["push"]).frequency_Hz[0]
    r = np.array([1e-3, 0.3, 0.9, 1.0, 1.2, 4.0])
    found = pose.transmissibility("x", r * f1, outputs="tip", damping=zeta, freed=["push"])
    damped = 1 + 2j * zeta * r
    assert found.value[:, 0, 0] == pytest.approx(damped / (damped - r**2), rel=1e-8)
    assert found.units == (("m per m",),)
    # held along x it goes with the base
    still = pose.transmissibility("x", r * f1, outputs="tip")
    assert still.value == pytest.approx(np.ones_like(still.value), rel=1e-12)


def test_white_noise_on_one_mode_has_the_closed_form():
    """rms^2 of the absolute acceleration is pi f S (1 + 4 zeta^2) / (4 zeta)."""
    scene = guide(material=WEIGHTLESS, held=True)
    scene.sensor("stage", along="x", at=(0, 0.06, 0), kind="acceleration", name="felt")
    pose = ksd.solve(scene, push=0.0)
    f1 = pose.frequencies(freed=["push"]).frequency_Hz[0]
    for zeta in (0.001, 0.05):
        psd = {"base x": [(1e-4 * f1, 2.0), (1e6 * f1, 2.0)]}
        found = pose.random_vibration(psd, outputs=["felt", "tip"], damping=zeta, freed=["push"])
        # without damping force above the resonance nothing is left of the base; the closed form has 2 zeta/r there
        expected = np.pi * f1 * 2.0 * (1 + 4 * zeta**2) / (4 * zeta)
        assert found.rms[0] ** 2 == pytest.approx(expected, rel=1e-4)
        assert found.share[:, :].sum(axis=1) == pytest.approx(1.0, abs=1e-9)


def test_three_sigma_of_the_stress_is_that_of_the_motion():
    """Of one mode, the stress of the static deflection by three times the rms."""
    pose = ksd.solve(guide(material=WEIGHTLESS, held=True), push=0.0)
    found = pose.random_vibration({"base x": [(0.5, 1e-4), (50, 1e-4)]}, outputs="tip", freed=["push"])
    moved = ksd.solve(guide(material=WEIGHTLESS, held=True), push=1e-6 * mm).stress()
    assert found.stress_MPa["leaf"] == pytest.approx(
        1e-6 * moved["leaf"].largest_Pa * 3 * found.rms[0] / 1e-9, rel=1e-5
    )


def test_effective_masses_sum_to_what_moves():
    pose = ksd.solve(guide(material=WEIGHTLESS, plane=None), push=0.0)
    modes = pose.frequencies(count=20, freed=["push"])
    assert modes.effective_mass.sum(axis=0) == pytest.approx([1.0, 1.0, 1.0], rel=1e-9)
    # rotations about the origin: the centre of mass is away from it
    about = np.sum(modes.participation("rz") ** 2)
    assert about == pytest.approx(2e-3 + 0.025**2 + 0.06**2, rel=1e-9)


def test_damping_by_loss_factors_is_that_of_the_elastic_part():
    standing, hanging, plain = (
        ksd.solve(guide(gravity=g), push=0.0).frequencies(freed=["push"], count=3)
        for g in ((0, -9.81, 0), (0, 9.81, 0), None)
    )
    assert plain.damping == pytest.approx(0.01, rel=1e-6)
    assert plain.elastic_share == pytest.approx(1.0, rel=1e-6)
    assert hanging.damping[0] < 0.0099 and standing.damping[0] > 0.0101
    assert standing.damping[0] == pytest.approx(0.01 * standing.elastic_share[0], rel=1e-12)
    # the elastic part is the same in all, to first order
    elastic = [m.elastic_share[0] * m.omega_squared[0] for m in (standing, hanging)]
    assert elastic == pytest.approx([plain.omega_squared[0]] * 2, rel=2e-3)


def test_a_peak_is_as_wide_as_its_damping(pose):
    modes = pose.frequencies(freed=["push"])
    f1, zeta = modes.frequency_Hz[0], modes.damping[0]
    found = pose.response(f1 * np.linspace(0.96, 1.04, 4001), inputs="push", outputs="push")
    assert found.plant.damping_text == "from the loss factors of the materials"
    inside = found.frequency_Hz[found.gain[:, 0, 0] > found.gain[:, 0, 0].max() / np.sqrt(2)]
    assert (inside[-1] - inside[0]) / f1 / 2 == pytest.approx(zeta, rel=2e-3)


def test_a_planar_scene_turned_in_space_answers_the_same():
    """With all modes, up to 5 MHz: by rounding a stiff one has parts of soft ones, which must go."""
    here, *turned = (
        ksd.solve(guide(plane=None if k else "xy", turn=turn, height=0.0), push=1 * mm).response(
            np.geomspace(1, 900, 5), inputs=["push", "knock"], outputs=["tip", "shake", "tilt"], modes=200
        )
        for k, turn in enumerate([None, *Rotation.random(3, random_state=1).as_matrix()])
    )
    for there in turned:
        assert there.value == pytest.approx(here.value, rel=1e-8)
        assert there.plant.modes.backward_error < 1e-12


def test_a_shock_is_the_response_in_time():
    """A long pulse pushes as a static force; a short one kicks as its momentum."""
    pose = ksd.solve(guide(material=WEIGHTLESS, held=True), push=0.0)
    w = 2 * np.pi * pose.frequencies(freed=["push"]).frequency_Hz[0]
    words = {"source": "base x", "outputs": "tip", "damping": 0.0, "freed": ["push"]}
    slow = pose.shock(ksd.HalfSine(amplitude=2.0, duration=60 * 2 * np.pi / w), **words)
    assert slow.largest["tip"] == pytest.approx(2.0 / w**2, rel=0.02)
    fast = pose.shock(ksd.HalfSine(amplitude=2.0, duration=1e-3 * 2 * np.pi / w), **words)
    assert fast.largest["tip"] == pytest.approx(2.0 * 2 / np.pi * 1e-3 * 2 * np.pi / w / w, rel=1e-3)
    # half-sine: an undamped oscillator of the same period reads 2 pi/4 at 1/(2 duration)
    low, high = fast.spectrum[np.searchsorted(fast.spectrum[:, 0], 0.5 / 1e-3 * w / (2 * np.pi)) - 1 :][:2, 1]
    assert min(low, high) <= 2.0 * np.pi / 2 <= max(low, high)
    assert pose.shock([(0, 0), (0.01, 5.0), (0.02, 0)], **words).largest["tip"] > 0.0


def test_modes_of_base_loads_are_those_of_the_mass(pose):
    """-M r of a base is the weight of everything: with gravity, the load that moves links."""
    modes = frequencies(pose.model, pose.motion, count=3)
    r = np.array([0.0, 1.0, 0, 0, 0, 0])
    load = base_load(modes.mass, modes.model, modes.motion, r)
    start = int(modes.model.arrays.start[1])
    leaves = STEEL.density * 0.3e-3 * 20e-3 * 0.06
    # a consistent mass gives each end half of its leaf spring, along the leaf
    assert load[start + 1] == pytest.approx(1.0 + leaves, rel=1e-3)


@pytest.mark.parametrize(
    "words, sentence",
    [
        ({"frequency_Hz": [1.0, -2.0]}, "frequency_Hz: -2 Hz is not positive"),
        ({"frequency_Hz": "ten"}, "frequency_Hz = 'ten' is not a number"),
        ({"frequency_Hz": [float("nan")]}, "frequency_Hz = nan is not finite"),
        ({"inputs": "pusch"}, "inputs: 'pusch' is unknown; did you mean \"push\""),
        ({"inputs": "base q"}, "a base moves along or about an axis"),
        ({"inputs": "base z"}, "which a base leaves along or about z"),
        ({"outputs": "tipp"}, "outputs: 'tipp' is unknown; did you mean \"tip\""),
        ({"damping": 1.0}, "damping = 1.0: a ratio from 0 to below 1 is needed"),
        ({"damping": [(5.0, 0.01)]}, "Rayleigh damping needs two pairs"),
        ({"damping": [(50.0, 0.01), (60.0, 0.5)]}, "Rayleigh damping is negative"),
        ({"damping": [0.01], "modes": 3}, "1 ratios for 3 modes"),
        ({"damping": "little"}, "give a ratio, ratios, pairs or 'materials'"),
        ({"freed": []}, "drive 'push' is held, and its force moves nothing"),
        ({"freed": ["pusch"]}, "'pusch' cannot be freed"),
    ],
    ids=lambda v: "" if isinstance(v, dict) else v[:30],
)
def test_wrong_words_are_refused(pose, words, sentence):
    with pytest.raises(SceneError, match=None) as refused:
        pose.response(**words)
    assert sentence in str(refused.value)


@pytest.mark.parametrize(
    "psd, sentence",
    [
        ({"base y": [(1, 1e-3)]}, "one point is no spectrum"),
        ({"base y": [(1, -1e-3), (2, 1e-3)]}, "a density of -0.001 is negative"),
        ({"base y": [(2, 1e-3), (1, 1e-3)]}, "must be positive and rise"),
        ({"base w": [(1, 1e-3), (2, 1e-3)]}, "there is no such input"),
        (3.0, "give spectra by input"),
    ],
)
def test_wrong_spectra_are_refused(pose, psd, sentence):
    with pytest.raises(SceneError) as refused:
        pose.random_vibration(psd)
    assert sentence in str(refused.value)


def test_loads_that_follow_their_link_and_names_of_two_things_are_refused():
    """Small ones, of less than a thousandth in the stiffness, change no mode."""
    scene = guide()
    scene.sensor("stage", along="x", at=(0, 0.06, 0), name="push")
    with pytest.raises(SceneError, match="'push' is a sensor and a drive; give the sensor another name"):
        ksd.solve(scene, push=0.0).response([1.0], outputs="push")
    scene = guide()
    scene.load("stage", force=(0, 50.0, 0), at=(0, 0.06, 0), following=True)
    pose = ksd.solve(scene, push=1 * mm)
    for ask in (
        lambda: pose.response([1.0], inputs="push"),
        lambda: pose.random_vibration({"base x": [(1, 1e-3), (9, 1e-3)]}, freed=["push"]),
        lambda: pose.shock([(0, 0), (0.01, 1), (0.02, 0)], source="base x", outputs="tip", freed=["push"]),
        lambda: pose.transmissibility("x", outputs="tip", freed=["push"]),
        lambda: ksd.state_space(pose, inputs="push", outputs="tip"),
    ):
        with pytest.raises(SceneError, match=r"the loads follow their link .* are no basis"):
            ask()


def test_turning_bases_and_unstable_poses_are_refused():
    tilted = ksd.solve(guide(gravity=(0, -9.81, 0)), push=0.0)
    with pytest.raises(SceneError, match="would tilt the weights"):
        tilted.response([1.0], inputs="base rz", outputs="tip")
    heavy = guide(material=WEIGHTLESS)
    heavy.load("stage", force=(0, -2000.0, 0), at=(0.025, 0.06, 0))
    standing = ksd.solve(heavy, push=0.0, strict=False)
    with pytest.raises(KinematicsError, match="unstable"):
        standing.response([1.0], inputs="push")
