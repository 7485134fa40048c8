"""Drawings of other programs as scene files: units, mirrored entities, blocks, splines, loose corners, and bad files."""

import math
import subprocess
import sys

import numpy as np
import pytest

import ksd
from ksd.cli import main
from ksd.importing import read_dxf
from ksd.importing.dxf import MAX_LINES
from ksd.units import mm

ezdxf = pytest.importorskip("ezdxf", reason="drawings need ezdxf: pip install 'ksd[cad]'")
STEEL = {"E": 210e9, "nu": 0.3, "density": 7800}


def drawing(units=4, version="R2010"):
    document = ezdxf.new(version, units=units)
    for layer in ("leaf", "link", "pin"):
        document.layers.add(layer)
    return document, document.modelspace()


def on(layer, **more):
    return {"layer": layer, **more}


def box(space, low, high, layer="link"):
    """A closed outline."""
    (x0, y0), (x1, y1) = low, high
    space.add_lwpolyline([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], close=True, dxfattribs=on(layer))


def guide(space, factor=1.0):
    """Two leaf springs of 60 mm on a table, 50 mm apart; factor: of the unit."""
    for x in (0.0, 50.0):
        space.add_line((factor * x, 0), (factor * x, factor * 60), dxfattribs=on("leaf"))
    box(space, (factor * -5, factor * 60), (factor * 55, factor * 70))


def read(document, folder, text=None, **words):
    """The mechanism of a drawing, and the text of its scene file."""
    document.saveas(folder / "drawing.dxf")
    text = read_dxf(folder / "drawing.dxf", **words)
    (folder / "scene.toml").write_text(text)
    return ksd.load_scene(folder / "scene.toml")[0], text


def stiff(mechanism, link="link 1", **drive):
    """Force of a drive of 1 mm along x."""
    mechanism.actuate(link, along="x", at=(0.025, 0.06, 0), name="d", **drive)
    return ksd.solve(mechanism, d=1 * mm).forces["d"]


def expected_guide():
    m = ksd.Mechanism("guide", plane="xy")
    table = m.link("table")
    words = {
        "width_axis": "z",
        "section": ksd.rectangle(0.5 * mm, 10 * mm),
        "material": ksd.Material(**STEEL),
    }
    for x in (0.0, 0.05):
        m.leaf("ground", table, start=(x, 0, 0), end=(x, 0.06, 0), **words)
    return m


@pytest.mark.parametrize(
    ("units", "factor", "words"),
    [(4, 1.0, {}), (1, 1 / 25.4, {}), (6, 1e-3, {}), (0, 1.0, {"unit": "mm"}), (0, 1 / 25.4, {"unit": "in"})],
)
def test_units(units, factor, words, tmp_path):
    document, space = drawing(units)
    guide(space, factor)
    mechanism, text = read(document, tmp_path, **words)
    assert stiff(mechanism) == pytest.approx(stiff(expected_guide(), "table"), rel=1e-9)
    assert "and assumed: " in text and "# The start of 'leaf 1' meets nothing" in text


def test_without_a_unit_it_asks(tmp_path):
    document, space = drawing(0)
    guide(space)
    with pytest.raises(
        ksd.SceneError, match=r"known unit it is drawn \(\$INSUNITS = 0\); say it, such as --unit mm"
    ):
        read(document, tmp_path)
    with pytest.raises(ksd.SceneError, match=r"unit 'furlong'"):
        read(document, tmp_path, unit="furlong")


def test_sizes_of_the_call_and_names_that_are_not_ascii(tmp_path):
    document, space = drawing()
    document.layers.add("Blattfeder ü")
    space.add_line((0, 0), (0, 60), dxfattribs=on("BLATTFEDER Ü"))
    space.add_text("Maß", dxfattribs=on("Beschriftung ß"))
    mechanism, text = read(
        document, tmp_path, layers={"leaf": "Blattfeder ü"}, thickness="0.3 mm", width=0.02, name="Führung"
    )
    (leaf,) = mechanism.scene().leaves
    assert (leaf.leaf.section.thickness, leaf.leaf.section.width) == pytest.approx((0.3e-3, 0.02))
    assert "Not read, layer 'Beschriftung ß': 1 x TEXT" in text and mechanism.name == "Führung"


def arc_beam(space, *, radius=20.0, mirrored=False, at=(0.0, 0.0)):
    """A quarter circle from (20, 0) to (0, 20), in a mirrored coordinate system of its own or not."""
    if mirrored:
        # x of the entity points to the left
        words = on("leaf", extrusion=(0, 0, -1))
        space.add_arc((-at[0], at[1]), radius, 90, 180, dxfattribs=words)
    else:
        space.add_arc(at, radius, 0, 90, dxfattribs=on("leaf"))


def arm_of_an_arc(document, folder):
    space = document.modelspace()
    box(space, (-8, 18), (0, 28))
    mechanism, _ = read(document, folder)
    mechanism.actuate("link 1", about="z", name="d")
    mechanism.load("link 1", force=(0.2, 0.1, 0), at=(0, 0.02, 0))
    pose = ksd.solve(mechanism, d=0.1)
    return pose.forces["d"], mechanism.scene().leaves[0].leaf


@pytest.mark.parametrize(
    "how", ["arc", "mirrored", "bulge", "old polyline", "mirrored polyline", "block", "mirrored block"]
)
def test_the_same_arc_in_every_way(how, tmp_path):
    document, space = drawing()
    bulge = math.tan(math.radians(90) / 4)
    if how in ("arc", "mirrored"):
        arc_beam(space, mirrored=how == "mirrored")
    elif how == "bulge":
        space.add_lwpolyline([(20, 0, bulge), (0, 20, 0)], format="xyb", dxfattribs=on("leaf"))
    elif how == "old polyline":
        space.add_polyline2d([(20, 0, bulge), (0, 20, 0)], format="xyb", dxfattribs=on("leaf"))
    elif how == "mirrored polyline":
        words = on("leaf", extrusion=(0, 0, -1))
        space.add_lwpolyline([(-20, 0, -bulge), (0, 20, 0)], format="xyb", dxfattribs=words)
    else:
        block = document.blocks.new("part")
        inner = document.blocks.new("inner")
        inner.add_arc((100, 0), 10, 0, 90, dxfattribs=on("0"))
        block.add_blockref("inner", (0, 0), dxfattribs=on("0"))
        if how == "block":
            scale, place = (2, 2, 1), (-200, 0)
        else:
            # mirrored at x and turned by a quarter
            scale, place = (-2, 2, 1), (0, -200)
        turn = 0 if how == "block" else -90
        words = on("leaf", xscale=scale[0], yscale=scale[1], rotation=turn)
        space.add_blockref("part", place, dxfattribs=words)
    force, leaf = arm_of_an_arc(document, tmp_path)
    m = ksd.Mechanism("arc", plane="xy")
    arm = m.link("arm")
    curve = ksd.Arc(radius=0.02, angle=math.pi / 2)
    words = {
        "section": ksd.rectangle(0.5 * mm, 10 * mm),
        "material": ksd.Material(**STEEL),
        "width_axis": "z",
    }
    m.leaf("ground", arm, start=(0.02, 0, 0), end=(0, 0.02, 0), curve=curve, **words)
    m.actuate(arm, about="z", name="d")
    m.load(arm, force=(0.2, 0.1, 0), at=(0, 0.02, 0))
    assert force == pytest.approx(ksd.solve(m, d=0.1).forces["d"], rel=1e-9)
    assert leaf.curve.radius == pytest.approx(0.02)


def test_a_spline_and_an_ellipse(tmp_path):
    """Through points of the arc: the force is that of the arc, as far as the splines are that curve."""
    angles = np.linspace(0, math.pi / 2, 15)
    forces = {}
    for how in ("arc", "spline", "ellipse"):
        document, space = drawing()
        if how == "spline":
            points = np.stack([20 * np.cos(angles), 20 * np.sin(angles)], axis=1)
            space.add_cad_spline_control_frame(points, tangents=None, dxfattribs=on("leaf"))
        elif how == "ellipse":
            space.add_ellipse((0, 0), (20, 0), 0.99999, 0, math.pi / 2, dxfattribs=on("leaf"))
        else:
            arc_beam(space)
        forces[how], _ = arm_of_an_arc(document, tmp_path)
    assert forces["spline"] == pytest.approx(forces["arc"], rel=5e-3)
    assert forces["ellipse"] == pytest.approx(forces["arc"], rel=1e-3)


def test_ends_that_nearly_meet(tmp_path):
    """Leaf springs .01 mm apart share a link, an outline of lines with such gaps is closed, a circle is two arcs."""
    document, space = drawing()
    space.add_line((0, 0), (0, 30), dxfattribs=on("leaf"))
    space.add_line((0.01, 30), (0, 60), dxfattribs=on("leaf"))
    corners = [(-5, 60.005), (5, 60), (5, 70), (-5, 70)]
    for a, b in zip(corners, [*corners[1:], corners[0]], strict=True):
        space.add_line((a[0] + 0.005, a[1]), (b[0] - 0.005, b[1]), dxfattribs=on("link"))
    mechanism, text = read(document, tmp_path)
    scene = mechanism.scene()
    assert set(scene.links) == {"ground", "link 1", "node 1"}
    assert [(p.a, p.b) for p in scene.leaves] == [("ground", "node 1"), ("node 1", "link 1")]
    with pytest.raises(ksd.SceneError, match="join = -1 m must be positive"):
        read(document, tmp_path, join=-1.0)
    mechanism, text = read(document, tmp_path, join="0.001 mm")
    assert "is no closed outline" in text and text.count("meets nothing") == 4
    with pytest.raises(ksd.SceneError, match=r"gives no scene: .*no chain of joints leads from 'node"):
        space.add_circle((100, 0), 5, dxfattribs=on("leaf"))
        read(document, tmp_path)
    box(space, (104, -1), (110, 1))
    space.add_mtext("ground", dxfattribs=on("link", insert=(108, 0)))
    assert [p.a for p in read(document, tmp_path)[0].scene().leaves] == [
        "ground",
        "node 1",
        "ground",
        "node 2",
    ]


def test_pins_and_what_is_left_out(tmp_path):
    document, space = drawing()
    guide(space)
    box(space, (40, 65), (90, 80))
    space.add_text("lever", dxfattribs=on("link", insert=(70, 75)))
    space.add_circle((50, 67), 2, dxfattribs=on("pin"))
    space.add_circle((150, 67), 2, dxfattribs=on("pin"))
    space.add_line((0, 0), (1e-6, 0), dxfattribs=on("leaf"))
    space.add_line((0, 0, 0), (0, 10, 10), dxfattribs=on("leaf"))
    space.add_lwpolyline([(0, 90), (5, 90), (9, 99)], dxfattribs=on("link"))
    for k in range(12):
        space.add_point((k, k), dxfattribs=on("measures"))
    mechanism, text = read(document, tmp_path)
    scene = mechanism.scene()
    assert [(h.a, h.b) for h in scene.hinges] == [("link 1", "lever")]
    for said in (
        "joins no two links", "shorter than that distance", "Not read, layer 'measures': 12 x POINT (handles",
        "Not read, layer 'leaf': 1 x LINE, not parallel to the plane xy", "no closed outline",
    ):  # fmt: skip
        assert said in text, said


def test_command(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    document, space = drawing(0)
    guide(space)
    for line in space.query("LINE"):
        line.dxf.layer = "flex"
    document.saveas("my guide.dxf")
    words = [
        "--layers",
        "leaf=FLEX",
        "--unit",
        "mm",
        "--thickness",
        "0.3mm",
        "--width",
        "20mm",
        "--join",
        "0.1mm",
    ]
    assert main(["new", "--from", "my guide.dxf", *words]) == 0
    scene = ksd.load_scene("my guide.toml")[0].scene()
    assert [p.leaf.section.width for p in scene.leaves] == [0.02, 0.02]
    assert main(["doctor", "my guide.toml"]) == 0 and "link 1" in capsys.readouterr().out
    assert main(["new", "two", "--from", "my guide.dxf", "--layers", "sheet=FLEX"]) == 2
    assert "'sheet' is no layer that is read" in capsys.readouterr().err


def bad(content, folder, name="bad.dxf"):
    (folder / name).write_bytes(content)
    with pytest.raises(ksd.SceneError) as caught:
        read_dxf(folder / name)
    assert "\n" not in str(caught.value) and name in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    "content", [b"", b"\x00\xff\x13" * 400, b"hello\n", b"  0\nSECTION\n  2\nENTITIES\n  0\nLINE\n"]
)
def test_files_that_are_no_drawings(content, tmp_path):
    assert "cannot be read as DXF" in bad(content, tmp_path)


def test_drawings_that_hold_nothing_to_read(tmp_path):
    assert "is an AutoCAD drawing (DWG); save it as DXF" in bad(b"AC1032\x00\x00", tmp_path)
    document, space = drawing()
    space.add_line((0, 0), (0, 9), dxfattribs=on("centre"))
    document.saveas(tmp_path / "a.dxf")
    said = bad((tmp_path / "a.dxf").read_bytes(), tmp_path)
    assert (
        "no centre lines on layer 'leaf'; it has the layers 0, leaf, link, pin" in said
        and "--layers leaf=CENTRE" in said
    )
    for big in (1e300, 1e12, -math.inf, math.nan):
        document, space = drawing()
        space.add_line((0, 0), (big, 9), dxfattribs=on("leaf"))
        document.saveas(tmp_path / "a.dxf")
        assert "which no mechanism does" in bad((tmp_path / "a.dxf").read_bytes(), tmp_path)
    with pytest.raises(ksd.SceneError, match="does not exist"):
        read_dxf(tmp_path / "none.dxf")
    with pytest.raises(ksd.SceneError, match="Is a directory"):
        read_dxf(tmp_path)


def test_without_a_header_it_asks_for_the_unit(tmp_path):
    """ezdxf would read metres."""
    line = b"0\nSECTION\n2\nENTITIES\n0\nLINE\n8\nleaf\n10\n0\n20\n0\n11\n0\n21\n60\n0\nENDSEC\n0\nEOF\n"
    assert "known unit it is drawn ($INSUNITS = 0)" in bad(line, tmp_path)
    assert 'end = [0, "60 mm", 0]' in read_dxf(tmp_path / "bad.dxf", unit="mm")


def loop(document, space):
    block = document.blocks.new("loop")
    for where in (block, space):
        where.add_blockref("loop", (0, 0), dxfattribs=on("leaf"))


DAMAGED = {
    "at or after SPLINE 32": lambda document, space: space.add_spline(dxfattribs=on("leaf")),
    "SPLINE": lambda document, space: space.add_spline([(0, 0), (1, math.nan), (2, 0)], dxfattribs=on("leaf")),
    "the block 'loop' holds itself": loop,
    '"none" does not exist': lambda document, space: space.add_blockref("none", (0, 0)),
    "reaches nan mm": lambda document, space: space.add_lwpolyline(
        [(0, 0, math.nan), (0, 9, 0)], format="xyb", dxfattribs=on("leaf")
    ),
    "reaches 2.25e+09 mm": lambda document, space: space.add_lwpolyline(
        [(0, 0, 1e9), (0, 9, 0)], format="xyb", dxfattribs=on("leaf")
    ),
}  # fmt: skip


@pytest.mark.parametrize("said", DAMAGED)
def test_damaged_entities(said, tmp_path):
    document, space = drawing()
    space.add_line((0, 0), (0, 60), dxfattribs=on("leaf"))
    DAMAGED[said](document, space)
    document.saveas(tmp_path / "a.dxf")
    text = bad((tmp_path / "a.dxf").read_bytes(), tmp_path)
    assert said.replace("32", "") in text or said in text


def test_rows_of_a_block(tmp_path):
    document, space = drawing()
    document.blocks.new("one").add_line((0, 0), (0, 60), dxfattribs=on("0"))
    space.add_blockref("one", (5, 0), dxfattribs=on("leaf", column_count=3, column_spacing=20))
    mechanism, _ = read(document, tmp_path)
    assert sorted(p.leaf.start[0] for p in mechanism.scene().leaves) == pytest.approx([5e-3, 25e-3, 45e-3])


def test_a_binary_and_an_old_drawing(tmp_path):
    for version, kind in (("R2010", "bin"), ("R12", "asc"), ("R2000", "asc")):
        document, space = drawing(4, version)
        space.add_line((0, 0), (0, 60), dxfattribs=on("leaf"))
        document.saveas(tmp_path / "old.dxf", fmt=kind)
        # the oldest version has no unit
        words = {"unit": "mm"} if version == "R12" else {}
        assert 'end = [0, "60 mm", 0]' in read_dxf(tmp_path / "old.dxf", **words)


@pytest.mark.parametrize(
    ("layer", "most", "what"), [("leaf", 2000, "leaf springs"), ("link", 300, "outlines of links")]
)
def test_very_many_entities(layer, most, what, tmp_path, monkeypatch):
    monkeypatch.setitem(MAX_LINES, layer, most)
    lines = "".join(f"0\nLINE\n8\n{layer}\n10\n{k}\n20\n0\n11\n{k}\n21\n9\n" for k in range(most + 1))
    head = "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n"
    said = bad((head + lines + "0\nENDSEC\n0\nEOF\n").encode(), tmp_path)
    assert f"more than {most} lines on layer '{layer}', which are no {what}" in said


def test_a_polyline_of_very_many_pieces(tmp_path):
    document, space = drawing()
    space.add_lwpolyline([(k, k % 2) for k in range(2002)], dxfattribs=on("leaf"))
    with pytest.raises(ksd.SceneError, match="more than 2000 pieces of lines on layer 'leaf'; draw arcs"):
        read(document, tmp_path)


def test_without_the_package(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ezdxf", None)
    with pytest.raises(ksd.SceneError, match=r"DXF needs the package ezdxf: pip install 'ksd\[cad\]'"):
        read_dxf(tmp_path / "a.dxf")


def test_ksd_imports_no_package_of_others():
    code = "import sys, ksd.export, ksd.importing; print([m for m in ('ezdxf', 'gmsh', 'trimesh') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"
