"""Pictures and ParaView files: made without a display, of what the configuration holds."""

import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex, to_rgba
from PIL import Image
from processes import environment
from readable import assert_readable
from scenes import STEEL, fourbar, single_joint

import ksd
from ksd.errors import SceneError
from ksd.model.compile import compile_scene
from ksd.model.mesh import Mesh
from ksd.solvers.conventional import solve_conventional
from ksd.view import plot_mechanism, write_pvd
from ksd.view.bodies import (
    PAD_HALF_THICKNESS,
    Polygon,
    clamp_pads,
    convex_hull,
    convex_parts,
    edge_lines,
    facing_camera,
    ground_hatches,
    hull_faces,
    mechanism_size,
)
from ksd.view.camera import camera_of
from ksd.view.cost_plot import Mark, plot_cost
from ksd.view.depth_order import back_to_front
from ksd.view.drawing import draw_polygons
from ksd.view.figure import (
    FAINT_COLOR,
    LOAD_COLOR,
    amount_with_unit,
    color_map,
    new_figure,
    parameter_with_unit,
)
from ksd.view.stress_colors import stress_colors

SCENES = Path(ksd.__file__).parent / "scenes"


@pytest.fixture(scope="module")
def bent():
    return solve_conventional(compile_scene(fourbar()), {"top": 0.3})


def texts(figure):
    return [t.get_text() for axes in figure.axes for t in axes.texts]


def boxes(figure):
    """Names and window boxes of all labels, drawn."""
    figure.canvas.draw()
    found = [t for axes in figure.axes for t in axes.texts if t.get_text()]
    return [(t.get_text(), t.get_window_extent()) for t in found]


def test_plane_picture(bent, tmp_path):
    figure = bent.plot(tmp_path / "fourbar.png")
    assert (tmp_path / "fourbar.png").read_bytes().startswith(b"\x89PNG")
    (axes,) = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [mm]", "y [mm]")
    assert axes.get_aspect() == 1.0
    said = texts(figure)
    assert {"ground", "left", "top", "right"} <= set(said)
    assert any("300 mm" in t and " N" in t for t in said)


@pytest.mark.parametrize(
    "scene,value", [(fourbar, {"top": 0.3}), (fourbar, {"top": 0.1}), (single_joint, {"turn": 0.8})]
)
def test_labels_do_not_overlap(scene, value):
    figure = plot_mechanism(solve_conventional(compile_scene(scene()), value))
    for (one, a), (two, b) in combinations(boxes(figure), 2):
        assert not a.overlaps(b), f"'{one}' on '{two}'"
    inside = figure.bbox
    for name, box in boxes(figure):
        assert inside.x0 <= box.x0 and box.x1 <= inside.x1 and inside.y0 <= box.y0 and box.y1 <= inside.y1, (
            name
        )


@pytest.mark.parametrize("name", ["arm", "delta_stage", "rrr_stage"])
def test_labels_of_crowded_mechanisms_are_parted(name):
    """Three drives at one point, links on top of each other: every label whole, and apart from all others."""
    mechanism, targets, _ = ksd.load_scene(SCENES / f"{name}.toml")
    figure = plot_mechanism(solve_conventional(compile_scene(mechanism), targets))
    named = boxes(figure)
    for (one, a), (two, b) in combinations(named, 2):
        assert not a.overlaps(b), f"'{one}' on '{two}'"
    (axes,) = figure.axes
    for label, box in named:
        assert axes.bbox.x0 <= box.x0 and box.x1 <= axes.bbox.x1, label
        assert axes.bbox.y0 <= box.y0 and box.y1 <= axes.bbox.y1, label


@pytest.mark.parametrize("kind", ["svg", "pdf"])
def test_other_formats(bent, tmp_path, kind):
    bent.plot(tmp_path / f"a.{kind}")
    assert (tmp_path / f"a.{kind}").stat().st_size > 1000


def painted(figure):
    """Corners (k, 2) [mm] and colours of all polygons of the bodies, from back to front."""
    (found,) = (c for c in figure.axes[0].collections if c.get_gid() == "bodies")
    return [path.vertices[:-1] for path in found.get_paths()], found.get_facecolors()


def test_a_view_in_space(bent):
    """Along the eye nothing is seen, across it everything at its length: the drive's arrow, 300 mm along x."""
    figure = plot_mechanism(bent, view=(-90, 0))
    assert not figure.axes[0].axison
    # without the strokes of ground, whose back is seen: they are below it
    corners = np.concatenate([polygon for polygon in painted(figure)[0] if len(polygon) > 2])
    shape = bent.shape()
    x = 1e3 * np.concatenate([leaf.place[:, 0] for leaf in shape.leaves])
    thick = 1e3 * 2 * PAD_HALF_THICKNESS * mechanism_size(shape)
    assert corners[:, 0].min() == pytest.approx(x.min(), abs=thick)
    assert corners[:, 0].max() == pytest.approx(x.max(), abs=thick)
    # leaf springs have their width along z: the joints are 80 mm wide, plus their pads
    assert 80.0 <= np.ptp(corners[:, 1]) <= 80.0 + thick
    for value in ("xz3", (1, 2, 3), (np.nan, 0.0), 4):
        with pytest.raises(SceneError, match=r'view = .*choose "xy"'):
            plot_mechanism(bent, view=value)


def test_planar_mechanisms_are_seen_onto_their_plane_and_spatial_ones_in_space(bent):
    assert plot_mechanism(bent).axes[0].get_xlabel() == "x [mm]"
    mechanism, targets, _ = ksd.load_scene(SCENES / "arm.toml")
    figure = plot_mechanism(solve_conventional(compile_scene(mechanism), targets))
    assert not figure.axes[0].axison and {"x", "y", "z", "axes: 50 mm"} <= set(texts(figure))


def test_a_nearer_sheet_hides_a_farther_one():
    """Two sheets one behind the other, seen from either side: the nearer is painted last."""
    near, far = (np.array([[0, y, 0], [1, y, 0], [1, y, 1], [0, y, 1.0]]) for y in (-1.0, 1.0))
    for azimuth, last in ((-90, "#ff0000"), (90, "#0000ff")):
        axes = new_figure(2, 2).add_subplot()
        camera = camera_of(None, (azimuth, 0), plane=None)
        draw_polygons(axes, [Polygon(near, "#ff0000"), Polygon(far, "#0000ff")], camera)
        assert to_hex(axes.collections[0].get_facecolors()[-1]) == last


def test_a_link_is_a_body_between_its_joints(bent):
    """Pads at the joints, a slimmer web between them; ground has pads alone and hatches behind them."""
    shape = bent.shape()
    blocks = {b.name: b for b in shape.blocks}
    size = mechanism_size(shape)
    left, ground = (convex_parts(blocks[n], clamp_pads(shape, blocks[n]), size) for n in ("left", "ground"))
    assert len(left) == 3 and len(ground) == 2
    lower, upper, web = left
    assert np.ptp(web, axis=0).max() < np.ptp(np.concatenate([lower, upper]), axis=0).max()
    for points in left:
        faces = [p for p in hull_faces(points, 1e-3, "#ffffff", edge="#000000") if len(p.corners) == 3]
        inside = points.mean(axis=0)
        assert all((p.corners.mean(axis=0) - inside) @ p.normal > 0 for p in faces)
        # closed: every side belongs to two triangles
        sides = {}
        for p in faces:
            for a, b in ((0, 1), (1, 2), (2, 0)):
                key = frozenset(map(tuple, p.corners[[a, b]].round(9)))
                sides[key] = sides.get(key, 0) + 1
        assert set(sides.values()) == {2}
    camera = camera_of(shape, "xy", plane=None)
    for pad in clamp_pads(shape, blocks["ground"]):
        strokes = ground_hatches(pad, size, camera)
        assert len(strokes) > 3 and max(s[:, 1].max() for s in strokes) < 0.0, (
            "behind, where no leaf spring is"
        )


@pytest.mark.parametrize("view", ["3d", (-60, 60), (170, 40), (150, 10), (-20, -30), (-100, 20)])
def test_ground_is_hatched_along_a_side_of_what_is_clamped(view):
    """In space too: the outer leaf springs of a cross flexure reach further than the inner one, so its block is no
    rectangle, and a line parallel to its length stood apart from it."""
    joint = ksd.CrossFlexure(
        ksd.Material(E=200e9, nu=0.3), length=0.1, angle=np.pi / 4, thickness=5e-4, widths=(0.02, 0.02), gap=0.01
    )  # fmt: skip
    scene = ksd.Mechanism("cross flexure")
    placed = scene.join("ground", scene.link("arm"), joint, at=(0, 0, 0), axis="z", toward="x", name="hinge")
    scene.actuate_joint(placed, name="turn")
    shape = ksd.solve(scene, turn=0.3).shape()
    (ground,) = (b for b in shape.blocks if b.name == "ground")
    (pad,) = clamp_pads(shape, ground)
    size, camera = mechanism_size(shape), camera_of(shape, view, plane=None)
    line, *strokes = ground_hatches(pad, size, camera)
    back = np.array([-1.0, 0.0, 0.0])
    middle = pad.corners.mean(axis=0)
    out = np.cross(line[1] - line[0], back)
    out *= np.sign((line[0] - middle) @ out) / np.linalg.norm(out)
    seen = back @ camera.toward > 0.4
    # strokes behind a back that is seen would lie on it
    way = out if seen else back
    ends = [np.linalg.norm(pad.corners + PAD_HALF_THICKNESS * size * way - end, axis=1).min() for end in line]
    assert max(ends) < 1e-12, "from corner to corner"
    assert ((pad.corners - line[0]) @ out).max() < 1e-12, "at its rim"
    assert out @ (-camera.up if seen else camera.toward) > 0, "below it, or on the side of the eye"
    assert len(strokes) > 3 and all((end - start) @ way > 0 for start, end in strokes)


def test_drives_and_loads_are_arrows_of_a_readable_length():
    """A drive of 1 % of the size, or of nothing, is as long as can be seen; a force ends where it acts."""
    scene = fourbar()
    scene.load("left", force=(0.0, -7.0, 0.0), at=(-0.2, 0.2, 0.0), name="weight")
    scene.load("top", moment=(0.0, 0.0, 0.2), name="twist")
    scene.mass("right", mass=2.0, at=(0.2, 0.2, 0.0))
    scene.spring("ground", "top", start=(0, 0, 0), end=(0, 0.37, 0), stiffness=100.0, free_length=0.3)
    for value in (0.0, 0.004):
        pose = ksd.solve(scene, {"top": value}, method="conventional")
        figure = plot_mechanism(pose)
        (axes,) = figure.axes
        said = texts(figure)
        assert {"weight: 7 N", "twist: 0.2 Nm", "2 kg"} <= set(said)
        arrows = [t for t in axes.texts if getattr(t, "arrow_patch", None)]
        lengths = [np.hypot(*np.subtract(t.xy, t.xyann)) for t in arrows]
        size = 1e3 * mechanism_size(pose.shape())
        straight = [n for n in lengths if n > 0.05 * size]
        assert len(straight) == 2 and min(straight) >= 0.1 * size - 1e-9
        assert any(line.get_gid() == "spring" for line in axes.lines)
        (force,) = (load for load in pose.shape().loads if load.kind == "force")
        assert any(np.allclose(t.xy, 1e3 * force.place[:2]) for t in arrows)


def test_a_link_reaches_its_loads_masses_and_springs():
    """Nothing acts in the air: the body of a link holds every point at which something acts on it."""
    scene = single_joint()
    scene.load("tip", force=(0, -1.0, 0), at=(0.3, 0.0, 0.0))
    scene.mass("tip", mass=0.2, at=(0.2, 0.1, 0.0))
    scene.spring("ground", "tip", start=(-0.1, 0, 0), end=(0.15, -0.1, 0), stiffness=10.0)
    pose = ksd.solve(scene, turn=0.3)
    shape = pose.shape()
    size = mechanism_size(shape)
    blocks = {b.name: b for b in shape.blocks}
    hold = {
        name: np.concatenate(convex_parts(blocks[name], clamp_pads(shape, blocks[name]), size))
        for name in ("tip",)
    }
    acting = [load.place for load in shape.loads] + [shape.springs[0].ends[1]]
    assert len(acting) == 3
    for place in acting:
        assert np.linalg.norm(hold["tip"] - place, axis=1).min() < 1e-12
    moved = np.add(pose.displacement("tip", (0.3, 0, 0)), (0.3, 0, 0))
    assert shape.loads[0].place == pytest.approx(moved, abs=1e-12)
    outline = np.concatenate(painted(plot_mechanism(pose))[0])
    for place in acting:
        away = outline - 1e3 * place[:2]
        assert np.linalg.norm(away, axis=1).min() < 3e3 * PAD_HALF_THICKNESS * size


def test_links_of_pins_alone_and_ground_below_a_pin():
    """A link that only pins hold is drawn, and ground is hatched where a pin stands on it."""
    scene = ksd.Mechanism("crank and slide", plane="xy")
    crank, slide = scene.links("crank", "slide")
    rod = scene.link("rod")
    section, steel = ksd.rectangle(5e-4, 0.01), ksd.Material(E=200e9, nu=0.3)
    scene.pin(scene.ground, crank, at=(0, 0, 0))
    scene.pin(crank, rod, at=(0, 0.03, 0))
    scene.leaf(rod, slide, start=(0, 0.03, 0), end=(0.1, 0, 0), section=section, material=steel)
    end = scene.link("end")
    scene.pin(slide, end, at=(0.1, 0, 0))
    scene.slider(end, along="x", at=(0.1, 0, 0))
    scene.actuate(crank, about="z", name="turn")
    scene.actuate(slide, about="z", name="tilt")
    pose = ksd.solve(scene, turn=0.2, tilt=0.1)
    shape = pose.shape()
    blocks, size = {b.name: b for b in shape.blocks}, mechanism_size(shape)
    (alone,) = convex_parts(blocks["end"], clamp_pads(shape, blocks["end"]), size)
    assert alone == pytest.approx(np.tile(shape.hinges[-1].place, (len(alone), 1)), abs=1e-12)
    camera = camera_of(shape, "xy", plane=None)
    (pad,) = clamp_pads(shape, blocks["ground"])
    strokes = np.concatenate(ground_hatches(pad, size, camera))
    assert strokes[:, 1].max() < 0 and abs(strokes[:, 0]).max() < 0.1 * size
    for view in ("xy", "3d"):
        assert_readable(plot_mechanism(pose, view=view))


def test_wires_are_as_thick_as_they_are_from_every_side():
    scene = ksd.Mechanism("wire")
    steel = ksd.Material(E=200e9, nu=0.3)
    scene.wire("ground", scene.link("tip"), start=(0, 0, 0), end=(0, 0, 0.1), diameter=2e-3, material=steel)
    scene.load("tip", force=(1e-3, 0, 0), at=(0, 0, 0.1))
    pose = ksd.solve(scene)
    for azimuth in (-90, -45, 0, 60):
        camera = camera_of(None, (azimuth, 0), plane=None)
        leaf = facing_camera(pose.shape().leaves[0], camera)
        low, high = (camera.flat(edge) for edge in edge_lines(leaf.place, leaf.axes, leaf.width))
        assert np.linalg.norm(high - low, axis=1) == pytest.approx(2.0, rel=1e-9)
        assert np.einsum("kij,kil->kjl", leaf.axes, leaf.axes) == pytest.approx(
            np.tile(np.eye(3), (len(low), 1, 1))
        )


def test_moments_stand_at_their_link_and_are_seen_from_the_side():
    """Said without a place, a moment stands at the link; seen along its plane it is an arrow with two heads along it."""
    scene = single_joint()
    scene.load("tip", moment=(0, 0, 0.5), name="twist")
    pose = ksd.solve(scene, turn=0.2)
    shape = pose.shape()
    (tip,) = (b for b in shape.blocks if b.name == "tip")
    (twist,) = shape.loads
    assert (twist.place >= tip.place.min(axis=0) - 1e-9).all() and (
        twist.place <= tip.place.max(axis=0) + 1e-9
    ).all()
    for view, rings in (("xy", 1), ("xz", 0)):
        (axes,) = plot_mechanism(pose, view=view, labels=False).axes
        arrows = [t for t in axes.texts if t.arrow_patch.get_edgecolor() == to_rgba(LOAD_COLOR)]
        ways = [np.subtract(t.xy, t.xyann) for t in arrows]
        assert len(ways) == (0 if rings else 2)
        assert all(abs(way[0]) < 1e-6 * abs(way[1]) for way in ways)
        heads = [p.get_xy()[:3] for p in axes.patches if p.get_facecolor() == to_rgba(LOAD_COLOR)]
        assert len(heads) == rings
        for outer, tip, inner in heads:
            # goes on from the end of the ring, the way the moment turns
            (ring,) = (line for line in axes.lines if to_rgba(line.get_color()) == to_rgba(LOAD_COLOR))
            end, centre = 0.5 * (outer + inner), 1e3 * np.array(twist.place[:2])
            assert ring.get_xydata()[-1] == pytest.approx(end)
            (x, y), (u, v) = end - centre, tip - end
            assert x * v - y * u == pytest.approx(np.hypot(x, y) * np.hypot(u, v)) and x * v > y * u


def test_forces_to_the_eye_are_points():
    """A circle with a dot for the tip, with a cross for the feathers; an arrow from every other side."""
    scene = single_joint()
    scene.load("tip", force=(0, 0, 2.0), at=(0.2, 0, 0), name="lift")
    scene.load("tip", force=(0, 0, -2.0), at=(0.3, 0, 0), name="push")
    pose = ksd.solve(scene, turn=0.2)
    for view, drawn in (("xy", {"o": 2, ".": 1, "x": 1}), ("xz", {}), ("3d", {})):
        (axes,) = plot_mechanism(pose, view=view).axes
        marks = [line.get_marker() for line in axes.lines if to_rgba(line.get_color()) == to_rgba(LOAD_COLOR)]
        assert {mark: marks.count(mark) for mark in marks} == drawn
        arrows = [
            t for t in axes.texts if t.arrow_patch and t.arrow_patch.get_edgecolor() == to_rgba(LOAD_COLOR)
        ]
        assert len(arrows) == (0 if drawn else 2)


def test_axes_in_space_stand_beside_what_is_drawn():
    """Where no corner is empty they have room of their own."""
    mechanism, targets, _ = ksd.load_scene(SCENES / "arm.toml")
    pose = ksd.solve(mechanism, targets)
    for view in ((-60, 24), (180, 60)):
        (axes,) = plot_mechanism(pose, view=view).axes
        corners = np.concatenate(painted(axes.figure)[0])
        arrows = [
            t
            for t in axes.texts
            if getattr(t, "arrow_patch", None) and t.arrow_patch.get_edgecolor() == to_rgba(FAINT_COLOR)
        ]
        places = np.array([place for t in arrows for place in (t.xy, t.xyann)])
        low, high = places.min(axis=0), places.max(axis=0)
        assert len(arrows) > 1 and not ((corners > low) & (corners < high)).all(axis=1).any()


def warm_guide(warmer):
    """A guide held at rest, its upper leaf warmer [K]."""
    steel = ksd.Material(E=200e9, nu=0.3, expansion=12e-6)
    joint = ksd.ParallelGuide(steel, length=0.08, thickness=4e-4, width=0.02, spacing=0.06)
    scene = ksd.Mechanism("guide")
    stage = scene.link("stage")
    placed = scene.join(scene.ground, stage, joint, at=(0, 0, 0), axis="z", toward="x", name="guide")
    scene.actuate_joint(placed, name="d")
    scene.heat(warmer, leaves=["guide/high"])
    return ksd.solve(scene, d=0.0)


def test_forces_of_rounding_read_as_zero_and_small_true_ones_do_not():
    """A spatial arm at rest; a guide tilted by a warm leaf: its force is of second order, a ten-thousandth of those in its
    leaf springs, and true."""
    mechanism, targets, _ = ksd.load_scene(SCENES / "arm.toml")
    rest = ksd.solve(mechanism, dict.fromkeys(targets, 0.0))
    assert 0.0 < max(map(abs, rest.forces.values())) < 1e-12
    assert {f"{name}: 0 mm, 0 N" for name in targets} <= set(texts(rest.plot())) and "x 0, " in repr(rest)
    once, twice = (warm_guide(warmer) for warmer in (5.0, 10.0))
    assert twice.forces["d"] / once.forces["d"] == pytest.approx(4.0, rel=1e-3)
    assert 0.0 < once.forces["d"] < 1e-3 * max(abs(f.start[0]) for f in once.section_forces().values())
    assert any(text.startswith("d: 0 mm, 0.09598 ") for text in texts(once.plot()))


def test_a_force_against_the_arrow_of_its_drive_is_labelled(bent):
    """A load of 900 N along the drive would carry the link past 300 mm: the drive holds it back."""
    assert "top: 300 mm, 521.2 N" in texts(bent.plot())
    scene = fourbar()
    scene.load("top", force=(900.0, 0.0, 0.0), at=(0.0, 0.37, 0.0))
    held = solve_conventional(compile_scene(scene), {"top": 0.3})
    assert any(
        t.startswith("top: 300 mm, -378") and t.endswith(" N against the arrow") for t in texts(held.plot())
    )
    back = solve_conventional(compile_scene(fourbar()), {"top": -0.1})
    assert back.forces["top"] < 0.0 and not any("against" in t for t in texts(back.plot()))


@pytest.mark.parametrize(
    ("value", "unit", "said"),
    [(521.23, "N", "521.2 N"), (84600.0, "N", "84.6 kN"), (1.114e-4, "N", "0.1114 mN"), (-2.37e-6, "Nm", "-2.37 µNm"),
     (9.6e-8, "N", "0.096 µN"), (5e4, "kg", "50 t"), (2e-4, "kg", "0.2 g"), (-0.0, "N", "0 N")],
)  # fmt: skip
def test_amounts_have_units_of_their_size(value, unit, said):
    assert amount_with_unit(value, unit).replace("\N{MICRO SIGN}", "µ") == said


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [("length", 0.04, "40 mm"), ("joint.cross.thickness", 4e-4, "0.4 mm"), ("joint.cross.widths[1]", 0.02, "20 mm"),
     ("angle", np.pi / 4, "45°"), ("leaf.radius", 0.01, "10 mm"), ("inner", 0.04, "40 mm"), ("count", 3.0, "3"),
     ("length", 40.0, "40")],
)  # fmt: skip
def test_design_parameters_have_their_unit(name, value, said):
    assert parameter_with_unit(name, value) == said


def test_distances_are_drawn():
    """A cross at both points, a thin line along which it is measured, and the value `pose.distance` has."""
    scene = fourbar()
    scene.distance("left", "right", start=(-0.2, 0.2, 0), end=(0.2, 0.2, 0), name="gap")
    scene.distance("ground", "top", start=(0, 0, 0), end=(0.1, 0.37, 0), along="y", name="rise")
    pose = ksd.solve(scene, top=0.2)
    figure = plot_mechanism(pose)
    said = texts(figure)
    lines = [line for line in figure.axes[0].lines if line.get_gid() == "distance"]
    crosses = [line for line in figure.axes[0].lines if line.get_marker() == "x"]
    assert len(lines) == len(crosses) == 2
    for name, line, ends, asked in zip(("gap", "rise"), lines, crosses, scene.scene().distances, strict=True):
        value = 1e3 * pose.distance(name)
        assert any(text == f"{name}: {value:.4g} mm" for text in said)
        assert np.hypot(*np.diff(line.get_xydata(), axis=0)[0]) == pytest.approx(abs(value), rel=1e-9)
        for place, link, at in zip(
            ends.get_xydata(), (asked.a, asked.b), (asked.start, asked.end), strict=True
        ):
            assert place == pytest.approx(1e3 * (pose.displacement(link, at) + at)[:2], rel=1e-9, abs=1e-9)
    (x, _), (x_end, _) = lines[1].get_xydata()
    assert x == pytest.approx(x_end), "along y of a ground that stays"


def test_what_crosses_is_parted():
    """Two sheets through each other and a body: at every point of the picture the nearest is painted last."""
    one = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    other = one[:, [2, 1, 0]]
    cube = [p for p in hull_faces(np.zeros((1, 3)), 0.4, "#00ff00", edge="#000000") if len(p.corners) == 3]
    camera = camera_of(None, (-60, 24), plane=None)
    polygons = [Polygon(one, "#ff0000"), Polygon(other, "#0000ff"), *cube]
    shown = [p for p in polygons if not p.body or p.normal @ camera.toward > 0]
    rng = np.random.default_rng(3)
    rays = rng.uniform(-1.2, 1.2, (400, 2)) @ np.stack([camera.right, camera.up])

    def hits(polygon, start):
        """Depth at which the ray meets a polygon, None where it passes."""
        a, b, c = polygon.corners[:3]
        normal = np.cross(b - a, c - a)
        if np.linalg.norm(normal) < 1e-12 or abs(normal @ camera.toward) < 1e-9:
            return None
        t = (a - start) @ normal / (normal @ camera.toward)
        place, sides = start + t * camera.toward, np.roll(polygon.corners, -1, axis=0) - polygon.corners
        turns = np.cross(sides, place - polygon.corners) @ normal
        return t if (turns > 1e-9).all() or (turns < -1e-9).all() else None

    pieces = back_to_front(shown, camera.toward, close=1e-6)
    checked = 0
    for start in rays:
        depths = [(d, p.color) for p in shown if (d := hits(p, start)) is not None]
        painted_last = [p.color for p in pieces if hits(p, start) is not None]
        if len({color for _, color in depths}) > 1 and painted_last:
            assert painted_last[-1] == max(depths)[1]
            checked += 1
    assert checked > 50 and len(pieces) > len(shown)


def test_impossible_files_are_refused(bent, tmp_path):
    with pytest.raises(SceneError, match=r"\.png"):
        bent.plot(tmp_path / "a.xyz")
    with pytest.raises(SceneError, match="does not exist"):
        bent.plot(tmp_path / "no" / "a.png")
    with pytest.raises(SceneError, match=r"\.vtu"):
        bent.view(tmp_path / "a.vtk")
    with pytest.raises(SceneError, match="does not exist"):
        bent.view(tmp_path / "no" / "a.vtu")


@pytest.mark.parametrize(
    "mesh", [Mesh(), Mesh(leaf="corotational", elements=3, nodal=True)], ids=["strain", "nodal"]
)
def test_vtu(mesh, tmp_path):
    c = solve_conventional(compile_scene(single_joint(), mesh=mesh), {"turn": 0.5})
    c.view(tmp_path / "joint.vtu")
    root = ElementTree.parse(tmp_path / "joint.vtu").getroot()
    piece = root.find("UnstructuredGrid/Piece")
    arrays = {a.get("Name"): np.array(a.text.split(), float) for a in piece.iter("DataArray")}
    points, cells = int(piece.get("NumberOfPoints")), int(piece.get("NumberOfCells"))
    assert len(arrays["Points"]) == len(arrays["displacement"]) == 3 * points
    assert (
        len(arrays["types"]) == len(arrays["offsets"]) == len(arrays["body"]) == len(arrays["rigid"]) == cells
    )
    assert arrays["offsets"][-1] == len(arrays["connectivity"])
    assert arrays["connectivity"].max() == points - 1
    assert set(arrays["types"]) == {3, 9} and (arrays["rigid"] == (arrays["types"] == 3)).all()
    # ribbons are as wide as the leaves: 40 mm the inner one
    first = arrays["Points"].reshape(-1, 3)
    assert np.ptp(first[:2, 2]) == pytest.approx(0.0, abs=1e-12)
    assert np.abs(first[:, 2]).max() == pytest.approx(0.04, abs=1e-9)


def test_vtu_is_read_by_vtk(bent, tmp_path):
    pyvista = pytest.importorskip("pyvista")
    bent.view(tmp_path / "a.vtu")
    grid = pyvista.read(tmp_path / "a.vtu")
    assert grid.n_cells > 300 and "displacement" in grid.point_data
    assert grid["von_mises_MPa"].max() == pytest.approx(1e-6 * bent.stress().largest_Pa, rel=1e-6)


def test_a_stroke_for_paraview(bent, tmp_path):
    """One file per pose, listed with the drive value as time, which VTK reads back."""
    pyvista = pytest.importorskip("pyvista")
    rest = solve_conventional(bent.model, {"top": 0.1})
    write_pvd([rest, bent], tmp_path / "stroke.pvd")
    reader = pyvista.get_reader(str(tmp_path / "stroke.pvd"))
    assert reader.time_values == pytest.approx([0.1, 0.3])
    reader.set_active_time_value(0.3)
    points = reader.read()[0].points
    assert np.abs(points - pyvista.read(tmp_path / "stroke_1.vtu").points).max() == 0.0
    with pytest.raises(SceneError, match=r"end in \.pvd"):
        write_pvd([bent], tmp_path / "stroke.vtu")
    with pytest.raises(SceneError, match="no configurations"):
        write_pvd([], tmp_path / "stroke.pvd")


def test_leaves_coloured_by_stress(bent, tmp_path):
    """Every piece of a leaf has the colour its stress has on the scale, in both pictures; the scale has its unit."""
    figure = plot_mechanism(bent, color="stress")
    _, bar = figure.axes
    assert bar.get_ylabel() == "von Mises stress [MPa]"
    assert bar.get_ylim() == pytest.approx((0.0, 1e-6 * bent.stress().largest_Pa), rel=1e-3)
    shape, heat = bent.shape(), stress_colors(bent, bent.shape(), "stress")
    for view in ("xy", "3d"):
        drawn = {
            tuple(color.round(6)) for color in painted(plot_mechanism(bent, color="stress", view=view))[1]
        }
        for leaf in shape.leaves:
            mean = 0.5 * (heat.values[leaf.name][1:] + heat.values[leaf.name][:-1])
            assert {tuple(color.round(6)) for color in heat.map(heat.norm(mean))} <= drawn
    # light for little, dark for much
    grey = color_map()(np.linspace(0, 1, 50))[:, :3] @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(grey) < 0).all() and grey[0] < 0.85
    solid = plot_mechanism(bent, color="stress", view="3d")
    assert solid.axes[1].get_ylabel() == "von Mises stress [MPa]"
    with pytest.raises(SceneError, match="color = 'heat': choose 'stress'"):
        plot_mechanism(bent, color="heat")


def test_leaves_of_the_same_stress_are_not_dark():
    """A strip bent to an arc has the same stress all along: a colour of the middle of the scale, whose end is beyond it."""
    scene = ksd.Mechanism("strip")
    tip = scene.link("tip")
    scene.leaf("ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), width_axis="z", section=ksd.rectangle(2e-4, 0.01),
               material=ksd.Material(E=200e9, nu=0.3), name="strip")  # fmt: skip
    scene.actuate(tip, about="z", name="turn")
    pose = ksd.solve(scene, turn=0.5)
    heat = stress_colors(pose, pose.shape(), "stress")
    assert heat.values["strip"] == pytest.approx(1e-6 * pose.stress().largest_Pa, rel=1e-6)
    assert np.asarray(heat.norm(heat.values["strip"])) == pytest.approx(2 / 3, rel=1e-6)


def test_a_window_rendered_without_a_display(bent, tmp_path):
    """In a process of its own, which VTK may end where there is no way to render at all."""
    pytest.importorskip("pyvista")
    code = (
        "import sys, ksd; from ksd.scene.toml_file import load_scene;"
        f"m, t, _ = load_scene({str(SCENES / 'fourbar.toml')!r}); ksd.solve(m, t).view(sys.argv[1])"
    )
    words = environment(VTK_DEFAULT_OPENGL_WINDOW="vtkEGLRenderWindow")
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "a.png")], env=words, capture_output=True
    )
    if done.returncode < 0:
        pytest.skip("this machine cannot render without a display")
    assert done.returncode == 0, done.stderr.decode()
    picture = np.asarray(Image.open(tmp_path / "a.png").convert("RGB"), float)
    assert picture.shape == (900, 1200, 3) and np.ptp(picture, axis=2).max() > 100


def test_a_window_without_pyvista_is_a_sentence(bent, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    with pytest.raises(SceneError, match=r"pip install 'ksd\[view\]'"):
        bent.view()


def test_cost_picture_names_every_method():
    """Those beside each other in one label, from the fastest; all apart."""
    marks = [
        Mark("slow", "strain-mode", 1e-3, 1e-6),
        Mark("near", "strain-mode", 1.2e-3, 1e-6),
        Mark("far", "strain-mode", 5e-3, 1e-6),
        Mark("b", "5 elements", 5e-3, 1e-2),
    ]
    figure = new_figure(5, 4)
    plot_cost(figure.add_subplot(), marks)
    assert [t for t in texts(figure) if t] == ["slow; near", "far", "b"]
    for (one, a), (two, b) in combinations(boxes(figure), 2):
        assert not a.overlaps(b), f"'{one}' on '{two}'"


def test_hull():
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0.5], [0.5, 0]])
    assert len(convex_hull(square)) == 4
    line = np.outer(np.linspace(0, 1, 5), [1.0, 0.3])
    assert convex_hull(line) == pytest.approx(line[[0, -1]]) or convex_hull(line) == pytest.approx(
        line[[-1, 0]]
    )
    assert len(convex_hull(np.zeros((3, 2)))) == 2


def test_sensors_and_dampers_are_drawn_with_their_names():
    scene = ksd.Mechanism("guide", plane="xy")
    stage = scene.link("stage")
    for x in (0, 0.05):
        leaf = ksd.rectangle(3e-4, 0.02)
        scene.leaf("ground", stage, start=(x, 0, 0), end=(x, 0.06, 0), section=leaf, material=STEEL)
    scene.actuate(stage, along="x", at=(0, 0.06, 0), name="push")
    scene.sensor(stage, along="y", at=(0.05, 0.06, 0), name="level")
    scene.sensor(stage, about="z", name="tilt")
    scene.damper("ground", stage, along="x", at=(0, 0.06, 0), damping=1.0, name="pot")
    pose = ksd.solve(scene, push=2e-3)
    shown = {sensor.name: sensor for sensor in pose.shape().sensors}
    moved = pose.displacement("stage", (0.05, 0.06, 0))
    assert shown["level"].place == pytest.approx(np.add(moved, (0.05, 0.06, 0)))
    assert shown["tilt"].turns and shown["pot"].damps and not shown["level"].damps
    texts = {text.get_text() for text in pose.plot().axes[0].texts}
    assert {"level", "tilt", "pot"} <= texts
