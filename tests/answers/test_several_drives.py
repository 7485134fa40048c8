"""Mechanisms with two and three drives: which modes are intended, what is held by drives together, what is commanded."""

import numpy as np
import pytest
import scipy.linalg
from scenes import STEEL
from uncondensed import uncondensed

import ksd
from ksd.cli.report import _first_parasitic
from ksd.units import mm
from ksd.view import animate


def xy_stage():
    """A stage that a guide moves along x over a carriage that another moves along y."""
    scene = ksd.Mechanism("xy stage")
    carriage, stage = scene.links("carriage", "stage")
    guide = ksd.ParallelGuide(STEEL, length=60 * mm, thickness=0.3 * mm, width=20 * mm, spacing=50 * mm)
    scene.join(scene.ground, carriage, guide, at=(0, 0, 0), axis="z", toward="x", name="low")
    scene.join(carriage, stage, guide, at=(0.06, 0, 0), axis="z", toward="y", name="high")
    for link, mass, at in ((carriage, 0.6, (0.06, 0, 0)), (stage, 0.5, (0.06, 0.06, 0))):
        scene.mass(link, mass=mass, inertia=(1e-4, 1e-4, 1e-4), at=at)
    scene.actuate(carriage, along="y", at=(0.06, 0, 0), name="y")
    scene.actuate(stage, along="x", at=(0.06, 0.06, 0), name="x", relative_to=carriage)
    return scene


RADIUS = 0.05


def feet():
    """Where the three folded leaf springs hold the platform: (3, 3), 120 degrees apart."""
    turns = np.deg2rad([90.0, 210.0, 330.0])
    return np.stack([RADIUS * np.cos(turns), RADIUS * np.sin(turns), np.zeros(3)], axis=1)


def platform(drives="three"):
    """A platform that lifts and tilts: three folded leaves with fold lines tangent to it hold x, y and the rotation about z.

    drives: "three" points along z, "terms" for lift and both tilts as sums of them, or none.
    """
    scene = ksd.Mechanism("platform")
    top = scene.link("platform", mass=0.8, inertia=(6e-4, 7e-4, 1.2e-3), at=(0, 0, 0))
    leaf = ksd.FoldedLeaf(STEEL, length=30 * mm, thickness=0.3 * mm, width=15 * mm)
    for k, p in enumerate(feet()):
        out = p / RADIUS
        tangent = np.cross((0, 0, 1.0), out)
        # the fold line along the tangent, so soft along z and radially, stiff along the tangent
        scene.constrain(top, scene.ground, leaf, at=p, axis=tangent, toward=out, name=f"fold {k}")
    z = [scene.displacement(top, "z", at=p) for p in feet()]
    if drives == "three":
        for k, term in enumerate(z):
            scene.actuate(terms=term, name=f"z{k}")
    elif drives == "terms":
        scene.actuate(terms=[t * (1 / 3) for t in z], name="lift")
        scene.actuate(
            terms=[z[0] * (2 / 3 / RADIUS), z[1] * (-1 / 3 / RADIUS), z[2] * (-1 / 3 / RADIUS)], name="tip"
        )
        scene.actuate(terms=[z[2] * (1 / 3**0.5 / RADIUS), z[1] * (-1 / 3**0.5 / RADIUS)], name="tilt")
    return scene


def dense_Hz(pose, count):
    """Frequencies (count,) [Hz] with all drives freed, from the uncondensed matrices and a general eigensolver."""
    K, M = uncondensed(pose.model, pose.motion, pose.model.drive_names)
    values = scipy.linalg.eigvals(np.linalg.solve(K, M)).real
    return 1 / np.sqrt(np.sort(values)[::-1][:count]) / (2 * np.pi)


def freed(pose, count=8):
    return pose.frequencies(count=count, freed=pose.model.drive_names)


POSES = {
    "stage": (xy_stage, {"x": 1e-3, "y": 2e-3}),
    "platform": (platform, {"z0": 1e-3, "z1": 0.0, "z2": -5e-4}),
    "sums": (lambda: platform("terms"), {"lift": 5e-4, "tip": 0.02, "tilt": -0.01}),
}


@pytest.fixture(scope="module", params=POSES)
def pose(request):
    scene, targets = POSES[request.param]
    return ksd.solve(scene(), targets, method=None if request.param == "stage" else "conventional")


def test_every_freed_drive_has_its_mode_and_the_next_is_the_first_parasitic(pose):
    modes, drives = freed(pose), len(pose.model.drive_names)
    exact = dense_Hz(pose, drives + 2)
    assert modes.frequency_Hz[: drives + 2] == pytest.approx(exact, rel=1e-6)
    assert modes.intended.tolist() == list(range(drives))
    assert modes.first_parasitic_Hz == pytest.approx(exact[drives], rel=1e-6)
    assert modes.first_parasitic_Hz > 10 * exact[drives - 1]
    assert str(modes).count("intended_") == drives and modes.names[drives] == "parasitic_1"


def test_sweep_report_and_animation_say_the_same(pose, tmp_path, monkeypatch):
    modes, first = freed(pose), len(pose.model.drive_names)
    how = {"method": "conventional", "questions": "frequencies", "progress": False, "together": True}
    row = next(ksd.sweep(pose.model.original_scene, {n: [v] for n, v in pose.targets.items()}, **how).rows())
    assert row["first_parasitic_Hz"] == pytest.approx(modes.first_parasitic_Hz, rel=1e-9)
    assert row["first_parasitic_mode"] == modes.names[first] == "parasitic_1"
    for k in range(first + 2):
        assert row[f"{modes.names[k]}_Hz"] == pytest.approx(modes.frequency_Hz[k], rel=1e-9)
    assert _first_parasitic(pose, pose.model.drive_names) == pytest.approx(modes.first_parasitic_Hz, rel=1e-9)
    said = []
    monkeypatch.setattr(animate, "_write_frames", lambda *a, title, **k: said.append(title))
    for mode in (1, first + 1, "parasitic_1"):
        animate.animate_mode(pose, tmp_path / "m.gif", mode=mode, modes=modes, frames=2)
    assert said[0].startswith("mode 1, intended_1: ") and said[1] == said[2]
    assert said[1].startswith(f"mode {first + 1}, parasitic_1: {modes.first_parasitic_Hz:.4g} Hz")
    with pytest.raises(ksd.SceneError, match="1 to 8"):
        animate.animate_mode(pose, tmp_path / "m.gif", mode=0, modes=modes)


def test_a_drive_that_stays_held_has_no_mode(pose):
    name = pose.model.drive_names[0]
    modes = pose.frequencies(count=5, freed=name)
    assert modes.intended.tolist() == [0] and modes.names[:2] == ("intended", "parasitic_1")
    assert len(pose.frequencies(count=2).intended) == 0


def test_modes_are_named_after_what_has_mass(pose):
    """The folds move farther than the platform and have no mass: no mode below those of the leaf springs is theirs."""
    links = {m.link for m in pose.model.scene.masses}
    assert {said.split("'")[1] for said in freed(pose, 6).movements if "between" not in said} <= links


def test_leaves_at_a_block_without_mass_are_named_as_leaves():
    """A folded leaf between a heavy link and ground: with that link held, the fold is no body and its leaf springs swing."""
    scene = ksd.Mechanism("fold")
    block = scene.link("block", mass=50.0, inertia=(1.0, 1.0, 1.0), at=(0, 0, 0))
    leaf = ksd.FoldedLeaf(STEEL, length=30 * mm, thickness=0.3 * mm, width=15 * mm)
    scene.constrain(scene.ground, block, leaf, at=(0, 0, 0), axis="z", toward="x", name="leaf")
    said = ksd.solve(scene).frequencies(count=9).movements
    assert {w.split("'")[1] for w in said[:6]} == {"block"}
    assert said[6].startswith("the leaf springs at 'leaf/fold', which turns about z")


def test_directions_that_drives_hold_together_are_held(pose):
    link = pose.model.scene.drives[-1].terms[0].link
    found = pose.stiffness(link, at=(0.013, -0.02, 0.03))
    free = pose.stiffness(link, at=(0.013, -0.02, 0.03), freed=pose.model.drive_names)
    held = [d for d, k in found.supports.items() if np.isinf(k)]
    assert held == ([] if link == "stage" else ["z", "rx", "ry"])
    assert not np.isinf(list(free.supports.values())).any()
    for d in held:
        i = list(found.supports).index(d)
        assert not found.compliance[i].any()
    lines = [line.split() for line in str(found).splitlines()]
    assert [w[0] for w in lines if len(w) > 1 and w[1] == "held"] == held
    for d in set(found.supports) - set(held):
        assert 0 < found.supports[d] < 1e9


def test_a_support_and_drives_hold_together():
    """Two points along z by drives, the third by a support: held like by three drives; freeing one lets it go."""
    scene = platform("none")
    z = [scene.displacement("platform", "z", at=p) for p in feet()]
    scene.actuate(terms=z[0], name="one")
    scene.actuate(terms=z[1] - z[2], name="difference")
    scene.support(terms=z[1] + z[2], name="sum")
    found = ksd.solve(scene, one=1e-3, difference=0.0, method="conventional")
    assert [d for d, k in found.stiffness("platform").supports.items() if np.isinf(k)] == ["z", "rx", "ry"]
    for freed_row, held in (("sum", ["ry"]), ("difference", ["z", "rx"])):
        left = found.stiffness("platform", freed=freed_row).supports
        assert [d for d, k in left.items() if np.isinf(k)] == held


def test_a_commanded_tilt_is_not_parasitic(pose):
    link = pose.model.scene.drives[-1].terms[0].link
    found = pose.parasitic(link, at=(0.01, 0.02, 0.0))
    turn, shift = pose.rotation(link), pose.displacement(link, (0.01, 0.02, 0.0))
    if link == "stage":
        assert np.abs(found.shift).max() < 0.1 * np.abs(shift).max() and found.drives == ("y", "x")
        return
    assert np.abs(turn[:2]).max() > 5e-3
    assert found.turn == pytest.approx([0, 0, turn[2]], abs=1e-12)
    assert found.shift == pytest.approx([*shift[:2], 0], abs=1e-12)
    assert found.drives == pose.model.drive_names


def test_a_tilt_that_is_not_commanded_is_parasitic():
    """One point is driven: what the platform tilts by itself is told, with the rotation about z."""
    scene = platform("none")
    scene.actuate("platform", along="z", at=feet()[0], name="z0")
    found = ksd.solve(scene, z0=1e-3, method="conventional")
    left = found.parasitic("platform")
    assert left.turn == pytest.approx(found.rotation("platform")) and np.abs(left.turn[0]) > 1e-3
    assert left.shift[2] == pytest.approx(0, abs=1e-12) and left.drives == ("z0",)


def guided(axis, stroke):
    """Parasitic shift (3,) of one of the two guides of `xy_stage` alone, its stage moved across it by `stroke` [m]."""
    scene = ksd.Mechanism("one guide")
    stage = scene.link("stage")
    guide = ksd.ParallelGuide(STEEL, length=60 * mm, thickness=0.3 * mm, width=20 * mm, spacing=50 * mm)
    scene.join(scene.ground, stage, guide, at=(0, 0, 0), axis="z", toward=axis, name="guide")
    scene.actuate(stage, along="xy".replace(axis, ""), at=(0.01, 0.02, 0))
    return ksd.solve(scene, stage=stroke, method="conventional").parasitic().shift


def test_what_a_drive_commands_of_the_carriage_is_no_parasitic_motion_of_the_stage():
    """Guides in series are each as they are alone, but for turns of a millionth: their shortening is left, no travel."""
    pose = ksd.solve(xy_stage(), x=1e-3, y=2e-3, method="conventional")
    found = pose.parasitic("stage")
    assert found.shift == pytest.approx(guided("x", 2e-3) + guided("y", 1e-3), abs=5e-7)
    assert np.abs(found.shift[:2]).min() > 5e-6 and found.drives == ("y", "x")
    carriage = pose.parasitic("carriage")
    assert carriage.shift == pytest.approx(guided("x", 2e-3), abs=5e-7) and carriage.drives == ("y",)


def turned(angles, *, axes="zz"):
    """An arm of cross flexures in series, each driven by its angle: parasitic shift (3,) of its end."""
    scene, base = ksd.Mechanism("arm"), "ground"
    hinge = ksd.CrossFlexure(
        STEEL, length=50 * mm, angle=np.pi / 4, thickness=0.3 * mm, widths=(20 * mm, 10 * mm)
    )
    for k, axis in enumerate(axes):
        link = scene.link(f"link {k}")
        scene.join(base, link, hinge, at=(0.1 * k, 0, 0), axis=axis, toward="x", name=f"hinge {k}")
        scene.actuate_joint(f"hinge {k}", name=f"turn {k}")
        base = link
    pose = ksd.solve(scene, {f"turn {k}": a for k, a in enumerate(angles)}, method="conventional")
    return pose.parasitic(base, at=(0.25, 0, 0))


def test_what_a_commanded_turn_carries_along_is_no_parasitic_motion():
    """The end of an arm moves by tenths of its length; what is left are the pivot shifts of its hinges."""
    angles = (0.5, -0.8)
    found = turned(angles)
    first, second = turned(angles[:1], axes="z").shift, turned(angles[1:], axes="z").shift
    c, s = np.cos(angles[0]), np.sin(angles[0])
    whole = first + np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ second
    assert found.shift == pytest.approx(whole, abs=1e-8) and np.abs(found.turn).max() < 1e-9
    assert 1e-5 < np.abs(whole).max() < 5e-3 and found.drives == ("turn 0", "turn 1")
    across = turned(angles, axes="zy")
    assert np.abs(across.turn).max() < 1e-9 and np.abs(across.shift).max() < 5e-3


def on_legs():
    """The platform on three wires, each from a stage that a guide of its own lifts."""
    scene = platform("none")
    guide = ksd.ParallelGuide(STEEL, length=60 * mm, thickness=0.3 * mm, width=20 * mm, spacing=50 * mm)
    for k, p in enumerate(feet()):
        leg, out, foot = scene.link(f"leg {k}"), p / RADIUS, p - (0, 0, 0.05)
        across = np.cross(-out, (0, 0, 1.0))
        scene.join(
            scene.ground, leg, guide, at=foot + 0.06 * out, axis=across, toward=-out, name=f"guide {k}"
        )
        scene.leaf(leg, "platform", start=foot, end=p, section=ksd.rectangle(0.5 * mm, 0.5 * mm), material=STEEL,
                   width_axis="x", name=f"wire {k}")  # fmt: skip
        scene.actuate(leg, along="z", at=foot, name=f"z{k}")
    return scene


def test_what_drives_in_parallel_legs_command_is_not_parasitic():
    """Lift and both tilts come from three driven legs: a ten thousandth of the tilt is left. The leg that is driven itself
    tells what it does beside its own drive, whatever the other two strain."""
    targets = {"z0": 1e-3, "z1": 0.0, "z2": -5e-4}
    pose = ksd.solve(on_legs(), targets, method="conventional")
    tilt = np.abs(pose.rotation("platform")[:2])
    found = pose.parasitic("platform", at=(0.01, 0.02, 0.0))
    assert found.drives == ("z0", "z1", "z2") and tilt.min() > 5e-3
    assert np.abs(found.turn[:2]).max() < 3e-4 * tilt.max() and np.abs(found.shift).max() < 5e-6
    assert found.turn[2] == pytest.approx(pose.rotation("platform")[2], rel=0.05)
    leg = pose.parasitic("leg 0")
    assert leg.drives == ("z0",) and leg.turn == pytest.approx(pose.rotation("leg 0"), abs=1e-12)


def test_a_side_branch_commands_nothing_of_the_link_beside_it():
    """Two arms on one driven carriage: the turn of the one is none of the other's."""
    scene = ksd.Mechanism("two arms")
    carriage, left, right = scene.links("carriage", "left", "right")
    guide = ksd.ParallelGuide(STEEL, length=60 * mm, thickness=0.3 * mm, width=20 * mm, spacing=50 * mm)
    hinge = ksd.CrossFlexure(
        STEEL, length=50 * mm, angle=np.pi / 4, thickness=0.3 * mm, widths=(20 * mm, 10 * mm)
    )
    scene.join(scene.ground, carriage, guide, at=(0, 0, 0), axis="z", toward="x", name="guide")
    scene.join(carriage, left, hinge, at=(0.06, 0.05, 0), axis="z", toward="y", name="left hinge")
    scene.join(carriage, right, hinge, at=(0.06, -0.05, 0), axis="z", toward="y", name="right hinge")
    scene.actuate(carriage, along="y", at=(0.06, 0, 0), name="y")
    scene.actuate_joint("left hinge", name="turn")
    scene.load(right, moment=(0, 0, 0.01), at=(0.06, -0.1, 0))
    found = ksd.solve(scene, y=1e-3, turn=0.2, method="conventional")
    left_over = found.parasitic("right")
    assert left_over.drives == ("y",)
    assert left_over.turn[2] == pytest.approx(
        found.rotation("right")[2] - found.rotation("carriage")[2], rel=1e-2
    )
