"""The constraint doctor: counts known from Gruebler's formula, words, releases, and solving all the same."""

import re

import numpy as np
import pytest
from hard_scenes import askew, cantilever, guide
from scenes import STEEL, fourbar, single_joint

import ksd
from ksd.answers.rest_constraints import leaf_spring, stiff_directions
from ksd.cli import main

SHEET = {"section": ksd.rectangle(0.5e-3, 0.03), "material": STEEL, "width_axis": "z"}


def counts(found):
    return found.freedoms, found.held, len(found.free), sum(not f.inside for f in found.redundant)


def test_a_sheet_holds_three_directions_and_a_wire_one():
    """Blanding: a sheet is three constraints in its plane, a wire one along itself."""
    sheet = ksd.Leaf(start=(0, 0, 0), end=(0.1, 0.02, 0), **SHEET)
    spring = leaf_spring(sheet, (0, 1))
    assert sorted(axis for axis, _ in stiff_directions(spring.K)) == [0, 2, 4]
    # 12 EI / L^3, EA / L and GJ / L^3 about the middle of a leaf
    L = sheet.length
    assert spring.K[0, 0] == pytest.approx(STEEL.E * 1.5e-5 / L, rel=1e-6)
    assert spring.K[5, 5] == pytest.approx(STEEL.E * sheet.section.Iz / L**3, rel=1e-6)
    wire = ksd.wire(diameter=1e-3, material=STEEL, start=(0, 0, 0), end=(0, 0.1, 0))
    assert [axis for axis, _ in stiff_directions(leaf_spring(wire, (0, 1)).K)] == [0]


@pytest.mark.parametrize("turn", [False, True])
def test_the_planar_fourbar_has_three_too_many(turn, rng):
    """Gruebler in space: 6 * 3 - 4 * 5 = -2 where the plane has 1, so three constraints redundant."""
    if not turn:
        found = ksd.doctor(fourbar())
        assert found.constraints == 20 and found.independent == 17
    else:
        from hard_scenes import frame

        T = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        found = ksd.doctor(frame(turn=T * np.sign(np.linalg.det(T)), unit=1e-6))
    assert counts(found) == (1, 1, 0, 3)
    inside = [f for f in found.redundant if f.inside]
    # three leaf springs of three constraints for five directions
    assert len(inside) == 4 and len(inside[0].inside) == 4
    assert not found.exact and not any(f.nearly for f in found.redundant)


def test_releasing_what_conflicts_makes_it_exact():
    """The parallel guide: one sheet is to lose its bending in the plane; as two wires along and across nothing conflicts."""
    found = ksd.doctor(guide())
    (redundant,) = found.redundant
    assert redundant.what == "bending in its plane of leaf 'leaf.2'"
    assert redundant.others == ("bending in its plane of leaf 'leaf'",)
    assert redundant.release == "notch the width of leaf 'leaf.2'"
    scene = ksd.Mechanism("released")
    shuttle = scene.link("shuttle")
    scene.leaf(scene.ground, shuttle, start=(0, -0.03, 0), end=(0.1, -0.03, 0), **SHEET)
    for name, start in (("along", (0, 0.03, 0)), ("across", (0.1, 0.03, -0.1))):
        wire = {"section": ksd.circle(0.5e-3), "material": STEEL, "width_axis": "y"}
        scene.leaf(scene.ground, shuttle, start=start, end=(0.1, 0.03, 0), name=name, **wire)
    scene.actuate(shuttle, along="y", at=(0.1, 0, 0), name="stroke")
    released = ksd.doctor(scene)
    assert counts(released) == (1, 1, 0, 0) and released.exact
    assert "exactly constrained" in str(released)


def test_what_is_free_is_said_with_its_stiffness():
    found = ksd.doctor(cantilever())
    assert counts(found) == (3, 0, 3, 0)
    EI = STEEL.E * ksd.rectangle(0.5e-3, 0.02).Iz
    slide = next(f for f in found.free if "slide along y" in f.sentence)
    assert slide.stiffness == pytest.approx(12 * EI / 0.1**3, rel=1e-3)
    assert "link 'tip' can slide along y: only leaf springs that bend hold it" in slide.sentence
    loose = ksd.Mechanism("loose")
    first, _ = loose.links("first", "top")
    loose.leaf(loose.ground, first, start=(0, 0, 0), end=(0.1, 0, 0), **SHEET)
    said = [f.sentence for f in ksd.doctor(loose).free]
    assert "link 'top' can slide along x: no leaf spring or support holds it" in said
    assert sum("no leaf spring or support holds it" in s for s in said) == 6


def test_conflicting_drives_are_named():
    found = ksd.doctor(guide(twist=True))
    drive = next(f for f in found.redundant if f.what == "drive 'twist'")
    assert "leaf" in drive.sentence and drive.release == "remove drive 'twist'"
    scene = fourbar()
    scene.actuate("left", about="z", name="other")
    assert any(f.what == "drive 'other'" for f in ksd.doctor(scene).redundant)


@pytest.mark.parametrize("tilt", [1e-3, 5e-3])
def test_a_misaligned_joint_nearly_conflicts_and_is_solved_all_the_same(tilt):
    found = ksd.doctor(askew(tilt))
    assert counts(found) == (1, 1, 0, 3)
    assert any(f.nearly for f in found.redundant) and "nearly conflicts with" in str(found)
    straight = ksd.solve(fourbar(), top=0.1).forces["top"]
    assert ksd.solve(askew(tilt), top=0.1).forces["top"] == pytest.approx(straight, rel=0.02)


def test_a_joint_alone_is_exact_and_its_parts_are_listed():
    found = ksd.doctor(single_joint())
    assert found.exact and counts(found) == (1, 1, 0, 0)
    numbers = found.as_dict()
    assert numbers["freedoms"] == 1 and len(numbers["overconstrained"]) == 4
    assert np.all(np.diff(found.singular_values) <= 0)


def test_the_command_and_its_errors(capsys, tmp_path):
    assert main(["doctor", "ksd/scenes/fourbar.toml"]) == 0
    assert "3 redundant constraints" in capsys.readouterr().out
    assert main(["doctor", "ksd/scenes/fourbar.toml", "--json", str(tmp_path / "a.json")]) == 0
    assert (tmp_path / "a.json").stat().st_size > 500
    with pytest.raises(ksd.SceneError, match="not a mechanism"):
        ksd.doctor(3)


def exchanged(thickness, width):
    """A stage on two leaf springs, driven along x."""
    scene = ksd.Mechanism("stage")
    stage = scene.link("stage")
    section, steel = ksd.rectangle(thickness, width), ksd.Material(E=200e9, nu=0.3)
    for x in (0, 0.05):
        scene.leaf(
            "ground", stage, start=(x, 0, 0), end=(x, 0.1, 0), width_axis="z", section=section, material=steel
        )
    scene.actuate(stage, along="x", at=(0, 0.1, 0), name="d")
    return scene


def test_thickness_and_width_exchanged_are_doubted():
    assert not ksd.doctor(exchanged(0.3e-3, 0.02)).unusual
    (said,) = ksd.doctor(exchanged(0.02, 0.3e-3)).unusual[:1]
    assert "thickness 20 mm is more than its width 0.3 mm" in said and "exchanged?" in said
    with pytest.raises(ksd.TrustError, match=r"UNSTABLE.*were the two exchanged\?"):
        ksd.solve(exchanged(0.02, 0.3e-3), d=5e-3)


def test_an_elastic_link_counts_as_rigid():
    """A frame with an elastic link and a drive: the counts are those of the rigid frame."""
    found = []
    for elastic in (False, True):
        scene = exchanged(0.3e-3, 0.02)
        if elastic:
            steel = ksd.Material(E=200e9, nu=0.3)
            scene.compliance("stage", section=ksd.rectangle(5e-3, 10e-3), material=steel, width_axis="z")
        diagnosis = ksd.doctor(scene)
        found.append((diagnosis.freedoms, diagnosis.held, diagnosis.constraints, diagnosis.independent))
        assert ksd.doctor(ksd.compile_scene(scene)).freedoms == diagnosis.freedoms
    assert found[0] == found[1]


def test_free_motions_of_one_kind_are_told_once():
    """A hexapod on six legs of a foot wire, a slide and a head wire: 30 soft motions in two lines."""
    scene, steel = ksd.Mechanism("hexapod"), ksd.Material(E=200e9, nu=0.3)
    scene.link("top")
    for k in range(6):
        foot, head = (np.deg2rad(120 * (k // 2) + (1 if k % 2 else -1) * angle) for angle in (20, 50))
        a = np.array([0.1 * np.cos(foot), 0.1 * np.sin(foot), 0])
        b = np.array([0.08 * np.cos(head), 0.08 * np.sin(head), 0.1])
        along = (b - a) / np.linalg.norm(b - a)
        lower, upper = scene.links(f"lower {k}", f"upper {k}")
        wire = {"diameter": 1e-3, "material": steel}
        scene.wire("ground", lower, start=a, end=a + 0.01 * along, name=f"foot {k}", **wire)
        scene.wire(upper, "top", start=b - 0.01 * along, end=b, name=f"head {k}", **wire)
        scene.slider(upper, along=along, at=a, relative_to=lower, name=f"slide {k}")
        scene.actuate(upper, along=along, at=a, relative_to=lower, name=f"d{k}")
    diagnosis = ksd.doctor(scene)
    assert len(diagnosis.free) == 30
    lines = [line for line in str(diagnosis).splitlines() if line.startswith("free: ")]
    assert len(lines) == 2
    told = r"can turn(, 18 motions in all| about 3 axes): only leaf springs that bend hold (them|it), with \d+ to"
    assert re.search(told, "".join(lines))


@pytest.mark.parametrize("parts", ["leaves", "joints"])
def test_redundant_constraints_of_one_kind_are_told_once(parts):
    """Eight guides in parallel: a line for each direction that all but a few of them hold too often, with its release."""
    scene = ksd.Mechanism("eight guides")
    stage = scene.link("stage")
    joint = ksd.ParallelGuide(STEEL, length=0.1, thickness=0.3e-3, width=0.02, spacing=0.01)
    for k in range(8):
        x = 0.02 * k
        if parts == "joints":
            scene.join(scene.ground, stage, joint, at=(x, 0, 0), axis="z", toward="y", name=f"g{k}")
        else:
            scene.leaf(scene.ground, stage, start=(x, 0, 0), end=(x, 0.1, 0), section=ksd.rectangle(0.3e-3, 0.02),
                       material=STEEL, width_axis="z", name=f"l{k}")  # fmt: skip
    scene.actuate(stage, along="x", at=(0, 0.1, 0), name="push")
    found = ksd.doctor(scene)
    own = [r for r in found.redundant if not r.inside]
    lines = [line for line in str(found).splitlines() if line.startswith("overconstrained: ")]
    directions = {r.what.split(" of ")[0] for r in own}
    assert len(lines) == len(directions) == {"leaves": 3, "joints": 5}[parts]
    told = [int(re.search(rf"of (\d) {parts}, '", line).group(1)) for line in lines]
    assert sum(told) == len(own) == found.constraints - 5
    assert all(re.search(r"conflicts with .*; to release it, .*each", line) for line in lines)
    assert len(found.as_dict()["overconstrained"]) == len(found.redundant), "one by one for programs"


def test_legs_between_ball_joints_turn_about_their_axes():
    """A hexapod whose six legs are held by a ball joint at each end: six spins, each about the line between these."""
    scene = ksd.Mechanism("hexapod")
    scene.link("top")
    axes = {}
    for k in range(6):
        foot, head = (np.deg2rad(120 * (k // 2) + (1 if k % 2 else -1) * angle) for angle in (20, 50))
        a = np.array([0.1 * np.cos(foot), 0.1 * np.sin(foot), 0])
        b = np.array([0.08 * np.cos(head), 0.08 * np.sin(head), 0.1])
        leg = scene.link(f"leg {k}")
        axes[f"leg {k}"] = (b - a) / np.linalg.norm(b - a)
        scene.ball("ground", leg, at=a, name=f"foot {k}")
        scene.ball(leg, "top", at=b, name=f"head {k}")
    free = ksd.doctor(scene).free
    assert sorted(m.link for m in free) == sorted(axes)
    for motion in free:
        moved = motion.twist[2 + int(motion.link[-1])]
        assert abs(moved[3:] @ axes[motion.link]) == pytest.approx(1.0, abs=1e-9)
        assert motion.stiffness == 0.0 and "can turn about its axis (" in motion.sentence
    lines = [line for line in str(ksd.doctor(scene)).splitlines() if line.startswith("free: ")]
    assert len(lines) == 1 and lines[0].startswith("free: each of the 6 links 'leg 0', 'leg 1'")
    assert lines[0].endswith("can turn about its axis: nothing holds it")


def crank_and_rod(degrees, drive, *, flexures):
    """A crank of 50 mm, drawn at an angle, and a rod of 100 mm to a block that slides along x; in line at 0 degrees."""
    scene, steel = ksd.Mechanism("toggle", plane="xy"), ksd.Material(E=200e9, nu=0.3)
    crank, rod, block = scene.links("crank", "rod", "block")
    t = np.deg2rad(degrees)
    elbow = np.array([0.05 * np.cos(t), 0.05 * np.sin(t), 0])
    end = np.array([elbow[0] + np.sqrt(0.1**2 - elbow[1] ** 2), 0, 0])
    for a, b, at in (("ground", crank, np.zeros(3)), (crank, rod, elbow), (rod, block, end)):
        if not flexures:
            scene.pin(a, b, at=at)
            continue
        for side in (1, -1):
            half = np.array([4e-3, side * 4e-3, 0])
            scene.leaf(
                a, b, start=at - half, end=at + half, section=ksd.rectangle(2e-4, 0.01), material=steel
            )
    if flexures:
        for x in (-0.01, 0.01):
            begin, stop = end + np.array([x, -0.06, 0]), end + np.array([x, 0, 0])
            scene.leaf(
                "ground", block, start=begin, end=stop, section=ksd.rectangle(2e-4, 0.01), material=steel
            )
    else:
        scene.slider(block, at=end, along="x")
    if "block" in drive:
        scene.actuate(block, along="x", at=end, name="push")
    if "crank" in drive:
        scene.actuate(crank, about="z", name="turn")
    return scene


@pytest.mark.parametrize("flexures", [False, True])
def test_a_toggle_is_a_singular_position(flexures):
    """In line, crank and rod move without the block, which holds them off that line; with both driven, drives conflict."""
    for degrees in (0.0, 1e-3, -0.1):
        found = ksd.doctor(crank_and_rod(degrees, "block", flexures=flexures))
        (push,) = (r for r in found.redundant if r.what == "drive 'push'")
        assert push.free == "link 'crank' can turn about z"
        assert push.sentence.startswith("singular position (toggle, dead centre): here drive 'push'")
        assert push.nearly == (degrees != 0.0)
    assert not ksd.doctor(crank_and_rod(20.0, "block", flexures=flexures)).free
    both = ksd.doctor(crank_and_rod(0.0, "block, crank", flexures=flexures)).redundant
    assert [r.free for r in both if r.what.startswith("drive ")] == [""]


def test_a_solve_from_a_toggle_says_singular_position():
    for degrees in (0.0, 1e-3):
        with pytest.raises(ksd.ConvergenceError, match=r"singular position .* link 'crank' can turn about z"):
            ksd.solve(crank_and_rod(degrees, "block", flexures=False), push=1e-3)


def test_conflicts_beside_a_free_motion_are_no_singular_position():
    """A stage where two leaf springs in line meet is driven along them, which is held, also off that line."""
    scene, steel = ksd.Mechanism("string", plane="xy"), ksd.Material(E=200e9, nu=0.3)
    stage = scene.link("stage")
    for side in (-1, 1):
        start, end = (side * 0.1, 0, 0), (0, 0, 0)
        scene.leaf("ground", stage, start=start, end=end, section=ksd.rectangle(2e-4, 0.01), material=steel)
    scene.actuate(stage, along="x", at=(0, 0, 0), name="push")
    found = ksd.doctor(scene)
    assert found.free and any(r.what == "drive 'push'" for r in found.redundant)
    assert "singular" not in str(found)
