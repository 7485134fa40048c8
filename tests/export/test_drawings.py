"""Drawings (DXF): what is drawn, read by ezdxf; out and in again gives the same forces."""

import math

import numpy as np
import pytest

import ksd
from ksd.cli import main
from ksd.export import write_dxf
from ksd.importing import read_dxf
from ksd.scene.toml_file import shipped_scenes
from ksd.units import deg, mm

ezdxf = pytest.importorskip("ezdxf", reason="drawings need ezdxf: pip install 'ksd[cad]'")
STEEL = ksd.Material(E=200e9, G=77e9, density=7800, name="steel")
SIZES = {
    "CrossFlexure": {"length": 50 * mm, "angle": 45 * deg, "thickness": 0.5 * mm, "widths": (20 * mm, 10 * mm)},
    "CrossedPivot": {"length": 50 * mm, "angle": 45 * deg, "thickness": 0.5 * mm, "width": 10 * mm},
    "BalancedCrossedPivot": {
        "length": 50 * mm, "angle": 45 * deg, "thickness": 0.5 * mm, "inner_width": 20 * mm, "outer_width": 10 * mm,
    },
    "Cartwheel": {"length": 50 * mm, "angle": 45 * deg, "thickness": 0.5 * mm, "width": 10 * mm},
    "Butterfly": {"length": 50 * mm, "inner": 15 * mm, "half_angle": 25 * deg, "thickness": 0.4 * mm, "width": 10 * mm},
    "InfinityHinge": {"length": 50 * mm, "thickness": 0.5 * mm, "width": 10 * mm},
    "TripleInfinityHinge": {"length": 80 * mm},
    "ParallelGuide": {"length": 50 * mm, "thickness": 0.3 * mm, "width": 10 * mm, "spacing": 30 * mm},
    "StiffenedGuide": {"length": 50 * mm, "flexible": 0.3, "thickness": 0.3 * mm, "width": 10 * mm, "spacing": 30 * mm},
    "CircularNotchHinge": {"radius": 5 * mm, "minimum": 0.5 * mm, "width": 10 * mm},
    "FilletedNotchHinge": {"length": 10 * mm, "radius": 2 * mm, "minimum": 0.5 * mm, "width": 10 * mm},
    "ArcHinge": {"radius": 5 * mm, "angle": 200 * deg, "thickness": 0.4 * mm, "width": 6 * mm},
    "UniversalJoint": {"length": 50 * mm, "thickness": 0.5 * mm, "width": 10 * mm},
    "FoldedLeaf": {"length": 50 * mm, "thickness": 0.5 * mm, "width": 10 * mm},
    "WireFlexure": {"length": 50 * mm, "diameter": 1 * mm},
}  # fmt: skip


def drawn(mechanism, folder, **words):
    """The document of a drawing, which ezdxf finds without errors."""
    document = ezdxf.readfile(write_dxf(mechanism, folder / "drawing.dxf", **words))
    audit = document.audit()
    assert not audit.has_errors and not audit.fixes
    return document


def again(folder):
    """The mechanism that is read from the drawing."""
    (folder / "again.toml").write_text(read_dxf(folder / "drawing.dxf"))
    return ksd.load_scene(folder / "again.toml")[0]


@pytest.mark.parametrize("family", SIZES)
def test_one_of_each_family_out_and_in_again(family, tmp_path):
    joint = getattr(ksd, family)(STEEL, **SIZES[family])
    original = ksd.Mechanism(family)
    tip = original.link("tip")
    place = original.join if joint.motions else original.constrain
    kept = place(original.ground, tip, joint, at=(0.01, 0.02, 0), axis="z", toward=(1, 0.3, 0), name="joint")
    end = np.array([0.01, 0.02, 0]) + (kept.turn(joint.pose_B) if hasattr(kept, "turn") else 0.0)
    drawn(original, tmp_path, view="xy")
    forces = []
    for mechanism in (original, again(tmp_path)):
        if joint.motions:
            motion = joint.motions[0]
            axis, value = tuple(kept.turn(motion.axis)), 0.3 * motion.range[1]
            way = {"about": axis} if motion.kind == "rotation" else {"along": axis}
            mechanism.actuate("tip", **way, at=end, name="d")
        else:
            value = 1e-3
            mechanism.actuate("tip", along="y", at=end, name="d")
        mechanism.load("tip", force=(0.1, 0.05, 0), at=end + np.array([0.01, 0.01, 0]))
        forces.append(ksd.solve(mechanism, d=value, method="conventional").forces["d"])
    assert forces[0] and forces[1] == pytest.approx(forces[0], rel=1e-9)


def test_gripper_out_and_in_again(tmp_path):
    original, targets, _ = ksd.load_scene(shipped_scenes()["gripper"])
    document = drawn(original, tmp_path, hole=3 * mm, margin=8 * mm)
    assert document.header["$INSUNITS"] == 4
    arcs = document.modelspace().query('ARC[layer=="leaf"]')
    assert [arc.dxf.radius for arc in arcs] == pytest.approx([4.0] * 4)
    assert [(arc.dxf.end_angle - arc.dxf.start_angle) % 360 for arc in arcs] == pytest.approx([270.0] * 4)
    # a drive is not named again where its link is
    texts = [text.dxf.text for text in document.modelspace().query('TEXT[layer=="text"]')]
    assert texts.count("crank") == 1
    # the outline of an arc: two arcs 0.4 mm apart, of which the area is exact
    ring = document.modelspace().query('LWPOLYLINE[layer=="outline"]')[0]
    bulges = [row[2] for row in ring.get_points("xyb")]
    assert sorted(bulges) == pytest.approx([-math.tan(67.5 * deg), 0.0, 0.0, math.tan(67.5 * deg)])
    mechanism = again(tmp_path)
    mechanism.actuate("crank", about="z", name="crank")
    same, pose = (ksd.solve(m, targets, method="conventional") for m in (mechanism, original))
    assert same.forces["crank"] == pytest.approx(pose.forces["crank"], rel=1e-9)
    assert mechanism.scene().plane == "xy" and mechanism.scene().links[1:] == ("crank", "jaw", "rocker")


def test_xy_stage_out_and_in_again(tmp_path):
    guide = ksd.ParallelGuide(STEEL, length=60 * mm, thickness=0.3 * mm, width=25 * mm, spacing=50 * mm)
    original = ksd.Mechanism("xy stage")
    middle, table = original.links("middle", "table")
    original.join("ground", middle, guide, at=(-0.04, 0, 0), axis="z", toward="y")
    original.join(middle, table, guide, at=(-0.03, 0.03, 0), axis="z", toward="x")
    drawn(original, tmp_path)
    forces = []
    for mechanism in (original, again(tmp_path)):
        for axis in ("x", "y"):
            mechanism.actuate("table", along=axis, at=(0.03, 0.03, 0), name=axis)
        forces.append(ksd.solve(mechanism, x=5 * mm, y=3 * mm, method="conventional").forces)
    assert min(forces[0].values()) > 1.0 and forces[1] == pytest.approx(dict(forces[0]), rel=1e-9)


def test_flat_patterns_and_list_of_sheets(tmp_path):
    m = ksd.Mechanism("sheets")
    table = m.link("table")
    words = {"width_axis": "z", "material": STEEL}
    for x in (0.0, 0.03):
        m.leaf("ground", table, start=(x, 0, 0), end=(x, 0.05, 0), section=ksd.rectangle(3e-4, 0.02), **words)
    taper = ksd.Taper(thickness=(0.3 * mm, 0.3 * mm), width=(20 * mm, 10 * mm))
    thick = ksd.Taper(thickness=(0.3 * mm, 0.6 * mm), width=(20 * mm, 20 * mm))
    for x, profile in ((0.06, taper), (0.09, thick)):
        own = {"start": (x, 0, 0), "end": (x, 0.05, 0), "section": ksd.rectangle(4e-4, 0.015)}
        m.leaf("ground", table, profile=profile, **own, **words)
    wire = {"section": ksd.circle(1 * mm), "material": STEEL}
    m.leaf("ground", table, start=(0.12, 0, 0), end=(0.12, 0.05, 0), **wire)
    space = drawn(m, tmp_path, margin=8 * mm, hole=3 * mm).modelspace()
    area = {}
    for number, line in enumerate(space.query('LWPOLYLINE[layer=="sheet"]'), 1):
        x, y = np.array(line.get_points("xy")).T
        area[number] = 0.5 * abs(x @ np.roll(y, 1) - y @ np.roll(x, 1))
    assert area == pytest.approx({1: 66 * 20, 2: 50 * 15 + 8 * 20 + 8 * 10, 3: 66 * 20})
    # two in each margin, one where the taper is narrow
    assert len(space.query('CIRCLE[layer=="hole"]')) == 11
    assert len(space.query('LINE[layer=="clamp"]')) == 6
    said = [text.dxf.text for text in space.query("TEXT")]
    assert any(
        t.startswith("sheet 1: 2 of 0.3 mm thick, 50 mm between clamps + 2 x 8 mm, 20 mm wide, steel")
        for t in said
    )
    assert any("sheet 3: 1 of thickness varies" in t for t in said)
    assert any(t.startswith("wire leaf.5: diameter 1 mm, 50 mm long") for t in said)


def test_a_free_curve_is_a_polyline_within_its_tolerance(tmp_path):
    curve = ksd.FreeCurve.sine([0.6, 0.2], chord=50 * mm)
    m = ksd.Mechanism("curved")
    tip = m.link("tip")
    leaf = {"start": (0, 0, 0), "end": (0.05, 0, 0), "width_axis": "z", "material": STEEL}
    m.leaf(m.ground, tip, section=ksd.rectangle(0.3 * mm, 10 * mm), curve=curve, **leaf)
    counts = []
    for tolerance in (1e-5, 1e-6):
        document = drawn(m, tmp_path, tolerance=tolerance)
        (line,) = document.modelspace().query('LWPOLYLINE[layer=="leaf"]')
        points = np.array(line.get_points("xy")) / 1e3
        counts.append(len(points))
        s = np.linspace(0.0, 1.0, 501)
        true = np.array([m.scene().leaves[0].leaf.section_at(x)[0][:2] for x in s])
        a, edge = points[:-1], np.diff(points, axis=0)
        t = np.clip(((true[:, None] - a) * edge).sum(2) / (edge * edge).sum(1), 0, 1)
        off = np.linalg.norm(true[:, None] - a - t[..., None] * edge, axis=2).min(axis=1).max()
        assert 0.1 * tolerance < off < 1.05 * tolerance
    assert counts[1] < 4 * counts[0]
    mechanism = again(tmp_path)
    poses = []
    for one in (m, mechanism):
        one.actuate("tip", along="y", at=(0.05, 0, 0), name="d")
        poses.append(ksd.solve(one, d=1e-3).forces["d"])
    assert poses[1] == pytest.approx(poses[0], rel=1e-9)


def test_pins_and_views(tmp_path):
    m = ksd.Mechanism("swing", plane="xz")
    arm = m.link("arm")
    leaf = {"width_axis": "y", "section": ksd.rectangle(0.3 * mm, 10 * mm), "material": STEEL}
    m.leaf(m.ground, arm, start=(0, 0, 0), end=(0, 0, 0.05), **leaf)
    m.pin(m.ground, arm, at=(0.02, 0, 0.05), name="pin")
    m.actuate(arm, about="y", name="d")
    document = drawn(m, tmp_path)
    (line,) = document.modelspace().query('LINE[layer=="leaf"]')
    assert tuple(line.dxf.start) == (0, 0, 0) and tuple(line.dxf.end) == pytest.approx((0, 50, 0))
    (pin,) = document.modelspace().query('CIRCLE[layer=="pin"]')
    assert tuple(pin.dxf.center) == pytest.approx((20, 50, 0))
    read = again(tmp_path).scene()
    assert [(h.a, h.b, h.at) for h in read.hinges] == [("ground", "arm", pytest.approx((0.02, 0.05, 0.0)))]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"path": "a.txt"}, "end in .dxf"),
        ({"view": "top"}, "must be \"xy\", \"xz\" or \"yz\""),
        ({"margin": -1.0}, "margin"),
        ({"hole": 0.02}, "does not fit into a margin"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"size": 1}, "size"),
    ],
)  # fmt: skip
def test_wrong_words(words, said, tmp_path):
    mechanism = ksd.load_scene(shipped_scenes()["guide"])[0]
    with pytest.raises(ksd.SceneError, match=said):
        write_dxf(mechanism, **({"path": tmp_path / "a.dxf"} | words))
    assert not list(tmp_path.iterdir())


def test_command(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    scene = str(shipped_scenes()["guide"])
    assert main(["export", scene, "--to", "dxf", "--out", "a.dxf", "--margin", "5mm", "--hole", "2mm"]) == 0
    assert "a.dxf: written" in capsys.readouterr().out
    assert len(ezdxf.readfile("a.dxf").modelspace().query('CIRCLE[layer=="hole"]')) == 4
    for words, said in (
        (["--to", "dwg"], "--to dwg: say one of calculix, dxf, vtu"),
        (["--to", "dxf", "--out", "a.stl"], "ends in .dxf"),
        (["--to", "stl", "--hole", "2mm"], "--hole is not for .stl files"),
        (["--to", "dxf", "--undeformed"], "--undeformed is not for .dxf files"),
        (["--to", "dxf", "--margin", "5 kg"], "--margin"),
    ):
        assert main(["export", scene, *words]) == 2 and said in capsys.readouterr().err


def test_without_the_package(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "ezdxf", None)
    with pytest.raises(ksd.SceneError, match=r"DXF needs the package ezdxf: pip install 'ksd\[cad\]'"):
        write_dxf(ksd.load_scene(shipped_scenes()["guide"])[0], tmp_path / "a.dxf")
