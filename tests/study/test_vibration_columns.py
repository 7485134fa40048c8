"""Rms values and settling times as answers of sweeps, batches, gradients and jobs."""

import numpy as np
import pytest
from scenes import STEEL, single_joint

import ksd
from ksd.errors import SceneError
from ksd.units import mm

FLOOR = {"base x": [(1, 1e-3), (200, 1e-3)]}
JOB = """
[job]
scene = "stage.toml"
minimise = "rms_tip_um"
limits = { settling_s = 15 }
damping = 0.01

[job.vary]
mass.1.mass = [0.5, 2]

[job.psd]
"base x" = [["1 Hz", 1e-3], ["0.2 kHz", 1e-3]]
"""


def stage(mass=1.0):
    """A mass on one leaf spring, with a sensor of its motion and one of its acceleration."""
    scene = ksd.Mechanism("stage", plane="xy")
    link = scene.link("stage", mass=mass, inertia=(1e-3, 1e-3, 1e-3), at=(0, 0.06, 0))
    leaf = ksd.rectangle(0.3 * mm, 20 * mm)
    scene.leaf(
        "ground", link, start=(0, 0, 0), end=(0, 0.06, 0), section=leaf, material=STEEL, width_axis="z"
    )
    scene.actuate(link, along="x", at=(0, 0.06, 0), name="push")
    scene.sensor(link, along="x", at=(0, 0.06, 0), name="tip")
    scene.sensor(link, along="x", at=(0, 0.06, 0), kind="acceleration", name="felt")
    return scene


def test_columns_are_the_answers_of_the_pose():
    words = {"questions": "vibration", "psd": FLOOR, "damping": 0.02}
    table = ksd.sweep(stage(), push=[0.0, 1 * mm], progress=False, **words)
    for k, push in enumerate((0.0, 1 * mm)):
        pose = ksd.solve(stage(), push=push)
        expected = pose.random_vibration(FLOOR, freed=["push"], damping=0.02).rms
        found = [table["rms_tip_um"][k] * 1e-6, table["rms_felt_m_per_s2"][k]]
        assert found == pytest.approx(expected, rel=1e-7)
        f1 = pose.frequencies(freed=["push"]).frequency_Hz[0]
        assert table["settling_s"][k] == pytest.approx(np.log(50) / (0.02 * 2 * np.pi * f1), rel=1e-7)


def test_batches_answer_as_sweeps():
    scene = single_joint()
    scene.sensor("tip", about="z", name="turned")
    words = {"questions": "vibration", "psd": {"base x": [(1, 1e-3), (200, 1e-3)]}, "method": "full"}
    batch = ksd.batch(scene, turn=[0.1, 0.2], **words)
    table = ksd.sweep(scene, turn=[0.1, 0.2], progress=False, **words)
    for column in ("settling_s", "rms_turned_mrad"):
        assert batch.answers[column][0] == pytest.approx(np.array(table[column]), rel=1e-5)


def test_a_dashpot_settles():
    """By the quadratic of one mass: a damper of twice the critical leaves a slow decay."""
    scene = stage()
    scene.support("stage", about="z")
    f1 = ksd.solve(scene, push=0.0).frequencies(freed=["push"]).frequency_Hz[0]
    m, w = 1.0, 2 * np.pi * f1
    scene.damper("ground", "stage", along="x", at=(0, 0.06, 0), damping=4 * m * w)
    table = ksd.sweep(scene, push=0.0, questions="vibration", damping=0.05, progress=False)
    slow = 2.05 - np.sqrt(2.05**2 - 1)
    assert table["settling_s"][0] == pytest.approx(np.log(50) / (w * slow), rel=0.01)


def test_slopes_are_those_of_the_answers():
    found = ksd.gradient(stage, {"mass": 1.0}, questions="vibration", psd=FLOOR, push=0.0)
    h = 1e-3
    more, less = (
        ksd.solve(stage(1 + k * h), push=0.0).random_vibration(FLOOR, freed=["push"]).rms[0] for k in (1, -1)
    )
    assert found["rms_tip_um", "mass"][0] == pytest.approx(1e6 * (more - less) / (2 * h), rel=1e-4)


def test_a_job_limits_an_rms_value(tmp_path):
    """The heavier, the longer it rings, and the more it moves."""
    job = ksd.Job(
        stage,
        vary={"mass": (0.5, 2.0)},
        maximise="settling_s",
        limits={"rms_tip_um": 1500.0},
        psd=FLOOR,
        push=0.0,
    )
    best = ksd.optimise(job)
    pose = ksd.solve(stage(**best.design), push=0.0)
    assert 1e6 * pose.random_vibration(FLOOR, freed=["push"]).rms[0] == pytest.approx(1500.0, rel=1e-3)
    ksd.save_scene(stage(), tmp_path / "stage.toml", targets={"push": 0.0})
    file = tmp_path / "job.toml"
    file.write_text(JOB)
    read = ksd.load_job(file).job
    assert read.names == ("rms_tip_um", "settling_s")
    assert (
        dict(read.questions.psd)["base x"] == ((1.0, 1e-3), (200.0, 1e-3)) and read.questions.damping == 0.01
    )


@pytest.mark.parametrize(
    "words, sentence",
    [
        ({"psd": {"base w": [(1, 1e-3), (2, 1e-3)]}}, "psd of 'base w': there is no such input"),
        ({"psd": {"base x": [(1, 1e-3)]}}, "one point is no spectrum"),
        ({"psd": {"push": [(1, 1e-3), (2, 1e-3)]}, "freed": []}, "psd of 'push': this drive is held"),
        ({"damping": 1.0}, "damping = 1.0: a ratio from 0 to below 1"),
    ],
)
def test_wrong_words_are_refused_before_a_solve(words, sentence):
    with pytest.raises(SceneError) as refused:
        ksd.sweep(stage(), push=0.0, questions="vibration", progress=False, **words)
    assert sentence in str(refused.value)


def test_an_rms_limit_needs_a_spectrum():
    with pytest.raises(SceneError, match="psd: rms values need spectra"):
        ksd.Job(stage, vary={"mass": (0.5, 2.0)}, minimise="rms_tip_um", push=0.0)
