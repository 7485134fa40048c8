"""Answers in print: their table, their one line, and the numbers in both."""

import numpy as np
import pytest
from scenes import STEEL, fourbar

import ksd
from ksd.answers.printing import axis_in_words, describe_motion, format_number


@pytest.fixture(scope="module")
def pose():
    scene = fourbar()
    scene.mass("top", mass=2.0, inertia=(0.01, 0.01, 0.01), at=(0, 0.37, 0))
    return ksd.solve(scene, top=0.1, method="conventional")


def test_frequencies_say_what_moves(pose):
    modes = pose.frequencies(count=4, freed=["top"])
    said = str(modes).splitlines()
    assert said[0] == "Eigenfrequencies, freed: top"
    rows = [line.split(maxsplit=2) for line in said if line[:2].strip().isdigit()]
    assert [float(r[1]) for r in rows] == pytest.approx(modes.frequency_Hz, rel=1e-4)
    assert rows[0][2] == "'top' moves along (0.96, -0.28, 0.00), intended"
    assert len({r[2] for r in rows}) > 1
    assert repr(modes).startswith("<Modes: 4 modes, ") and "\n" not in repr(modes)


def test_a_mode_is_named_by_what_the_centre_of_mass_does():
    """Not by the ends of its leaf springs, 30 mm away, which swing across where it turns."""
    guide = ksd.ParallelGuide(STEEL, length=0.06, thickness=0.4e-3, width=0.01, spacing=0.05)
    scene = ksd.Mechanism("guide")
    carriage = scene.link("carriage", mass=0.3, inertia=(1e-4, 1e-4, 1e-4), at=(0.03, 0, 0))
    scene.join(scene.ground, carriage, guide, at=(0, 0, 0), axis="z", toward="x")
    scene.actuate(carriage, along="y", at=(0.03, 0, 0), name="d")
    pose = ksd.solve(scene, d=3e-3)
    modes, at = pose.frequencies(freed=["d"], count=4), pose.stiffness(carriage, at=(0.03, 0, 0))
    said = {"z": "moves along z", "ry": "turns about y", "rx": "turns about x"}
    by_hand = {d: np.sqrt(at.support(d) / (0.3 if d == "z" else 1e-4)) / (2 * np.pi) for d in said}
    order = sorted(said, key=lambda d: by_hand[d])
    assert modes.movements[1:] == tuple(f"'carriage' {said[d]}" for d in order)
    assert modes.frequency_Hz[1:] == pytest.approx([by_hand[d] for d in order], rel=0.02)


def test_leaves_that_vibrate_between_still_ends_are_named():
    scene = ksd.Mechanism("heavy")
    block = scene.link("block")
    guide = ksd.ParallelGuide(STEEL, length=0.1, thickness=0.2e-3, width=0.03, spacing=0.06)
    scene.join(scene.ground, block, guide, at=(0, 0, 0), axis="z", toward="x", name="guide")
    scene.mass(block, mass=1e3, inertia=(10.0, 10.0, 10.0), at=(0.15, 0.03, 0))
    scene.actuate(block, along="y", at=(0.1, 0, 0), name="stroke")
    modes = ksd.solve(scene, stroke=1e-3).frequencies(count=6)
    between = [m for m in modes.movements if m.endswith("between the ends")]
    assert between and all("'guide/low'" in m or "'guide/high'" in m for m in between)


def test_stiffness_in_print(pose):
    found = pose.stiffness("top", at=(0, 0.3 + 0.1 * np.cos(np.pi / 4), 0))
    said = {
        line.split()[0]: line.split()
        for line in str(found).splitlines()
        if line[:4].strip() in found.supports
    }
    assert set(said) == set(found.supports)
    assert said["x"][1] == "held"
    for d in ("y", "z", "rx", "ry", "rz"):
        assert float(said[d][1]) == pytest.approx(found.supports[d], rel=1e-4)
    assert "'top'" in repr(found) and "x inf" in repr(found)
    drives = pose.drive_stiffness()
    assert format_number(drives["top"], 5) in str(drives) and "N/m" in repr(drives)


@pytest.mark.parametrize(
    "ask",
    [
        lambda p: p.buckling(),
        lambda p: p.stress(),
        lambda p: next(iter(p.section_forces().values())),
        lambda p: p.section_forces(),
        lambda p: p.strain_energy(),
        lambda p: p.interface_forces(),
        lambda p: p.parasitic(),
        lambda p: p.pivot_shift("lower left"),
        lambda p: p.internal_stress(),
        lambda p: p.trust,
        lambda p: ksd.state_space(p),
        lambda p: ksd.batch(p.model.scene, top=np.array([0.0, 0.1])),
        lambda p: ksd.doctor(p.model.scene),
        lambda p: ksd.find_record("cross_flexure"),
        lambda p: ksd.prepare(p.model),
        lambda p: ksd.follow(p.model, {"top": 0.05}, control="drives"),
    ],
)  # fmt: skip
def test_every_answer_is_readable(pose, ask):
    answer = ask(pose)
    assert "array(" not in repr(answer) + str(answer)
    assert len(repr(answer)) < 1000 and "\n" not in repr(answer)
    assert max(map(len, str(answer).splitlines())) <= 300


def test_a_path_prints_its_states_and_turnings():
    scene = fourbar()
    scene.load("top", moment=(0, 0, 250), at=(0, 0.37, 0))
    path = ksd.follow(scene, {"top": 0.3}, first=0.2)
    assert path.limits and str(path).startswith(f"Path of {len(path.states)} equilibria")
    assert f"A limit point at factor {format_number(path.limits[0])}" in str(path)
    assert f"{len(path.states)} states" in repr(path)


def test_words_of_directions_and_numbers():
    assert axis_in_words(np.array([0.0, -2.0, 0.01])) == "y"
    assert axis_in_words(np.array([-1.0, 1.0, 0.0])) == "(0.71, -0.71, 0.00)"
    model = ksd.compile_scene(fourbar())
    assert describe_motion(model, np.zeros((len(model.node_names), 6))) == ""
    assert (
        format_number(float("inf")) == "inf"
        and format_number(None) == "-"
        and format_number(1e-15, zero=1e-12) == "0"
    )


def test_mappings_of_answers_print_their_numbers(pose):
    energy = pose.strain_energy()
    rows = {
        line.rsplit(maxsplit=1)[0]: line.rsplit(maxsplit=1)[1]
        for line in str(energy).splitlines()[4:]
        if line
    }
    assert {n.strip(): float(v) for n, v in rows.items()} == pytest.approx(energy, rel=1e-4)
    assert format_number(sum(energy.values()), 5) in str(energy).splitlines()[0]
    largest = str(pose.section_forces())
    assert "Mz [Nm]" in largest and all(name in largest for name in pose.section_forces())
