"""Drawings in DXF: the side view of a mechanism with its leaf springs as lines and arcs, and the flat pattern of its sheets.

Millimetres. Side view: what lies along the viewing direction is the z coordinate of an entity, so that leaf springs behind
each other keep their places. Every centre line carries the words of its leaf spring as extended data of the application KSD,
which `ksd.importing.dxf` reads again: a drawing shows neither a material nor which links a leaf spring joins.
"""

from __future__ import annotations

import io
import json
import math
import os
from collections.abc import Iterable
from pathlib import Path
from textwrap import wrap
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from ksd.answers.shape import Shape, mechanism_shape
from ksd.checks import clear_argument_errors, not_negative, positive, show
from ksd.errors import SceneError
from ksd.extras import cad_package
from ksd.files import write_file
from ksd.model.compile import Model, compile_scene
from ksd.scene.curve import Arc
from ksd.scene.hinges import PLANES
from ksd.scene.leaf import Leaf
from ksd.scene.scene import PlacedLeaf, global_leaf
from ksd.scene.toml_writer import leaf_tables
from ksd.section.closed_forms import round_ratio
from ksd.section.section import thickness_and_width

Array = NDArray[np.float64]
MM = 1e3
APPLICATION, PIECE = "KSD", 240
"""Name of the extended data, and the length of the texts it is cut into (DXF allows 255 bytes)."""
LAYERS = {
    "leaf": (5, "centre lines"), "outline": (7, "outlines of leaf springs"), "link": (3, "links; ground is named so"),
    "pin": (1, "pins"), "point": (6, "driven and loaded points"), "sheet": (7, "flat patterns, to be cut"),
    "clamp": (8, "edges of clamps on these"), "hole": (1, "holes in the margins"),
    "text": (8, "names, list of sheets"),
}  # fmt: skip
"""Layers with their colours (of AutoCAD's index) and what is on them."""
VIEWS = {"xy": ((0, 1, 0), (0, 0, 1)), "xz": ((0, 0, 1), (0, -1, 0)), "yz": ((0, 0, 1), (1, 0, 0))}
"""Upward direction and direction to the eye of each view."""
EDGE_ON = 1e-9
"""Largest component of a width axis in the plane of the drawing of a leaf spring that is seen edge-on."""
TEXT_WIDTH = 110
"""Letters in a line of the list of sheets."""
MAX_CHORDS = 4096
"""Largest number of chords of a curve that is drawn as a polyline."""


class _Sheet(NamedTuple):
    """What makes leaf springs equal as sheets: edges (k, 2) [mm: along the developed length, half width], thickness [mm],
    None where it varies, material, remark."""

    edges: tuple[tuple[float, float], ...]
    thickness: float | None
    material: str
    remark: str


@clear_argument_errors
def write_dxf(
    configuration: Any,
    path: str | os.PathLike[str],
    *,
    view: str | None = None,
    margin: float = 0.01,
    hole: float = 0.0,
    tolerance: float = 1e-6,
) -> Path:
    """Write the undeformed mechanism as a drawing (.dxf, mm): side view, flat patterns and list of sheets. Returns the path.

    configuration: a pose or a mechanism; view: "xy", "xz" or "yz", the plane of a planar mechanism, else that in which most
    leaf springs are seen edge-on. margin [m]: length by which a sheet goes on in its clamps; hole [m]: diameter of the holes
    in the margins, none for 0; tolerance [m]: largest distance of a free curve from its polyline. Needs ezdxf. Raises
    SceneError.

    Example: `ksd.export.write_dxf(pose, "gripper.dxf", margin=8e-3, hole=3e-3)`.
    """
    target = Path(path)
    if target.suffix.lower() != ".dxf":
        raise SceneError(f"'{target}': drawings end in .dxf")
    margin = not_negative(margin, "margin", owner="write_dxf", unit="m")
    hole = not_negative(hole, "hole", owner="write_dxf", unit="m")
    tolerance = positive(tolerance, "tolerance", owner="write_dxf", unit="m")
    if hole and hole >= margin:
        raise SceneError(
            f"write_dxf: hole = {hole:g} m does not fit into a margin of {margin:g} m; give a longer margin."
        )
    if view is not None and view not in VIEWS:
        raise SceneError(f'write_dxf: view = {show(view)} must be "xy", "xz" or "yz".')
    ezdxf = cad_package("ezdxf", "DXF")
    given = getattr(configuration, "model", None)
    model = given if isinstance(given, Model) else compile_scene(configuration)
    leaves = scene_leaves_placed(model.original_scene)
    chosen = view or model.original_scene.plane or _clearest_view(leaves)
    drawing = _Drawing(ezdxf, chosen, tolerance)
    drawing.add_side_view(model, leaves)
    drawing.add_sheets(leaves, margin, hole)
    text = io.StringIO()
    drawing.document.write(text)
    return write_file(target, text.getvalue(), what="drawing")


def scene_leaves_placed(scene: Any) -> list[PlacedLeaf]:
    """All leaf springs of a scene in global axes, those of joints with blocks inside as "joint/block"."""
    placed = []
    for j in scene.joints:
        links = {block: f"{j.name}/{block}" for block in j.joint.blocks()} | {"A": j.a, "B": j.b}
        placed += [global_leaf(j, leaf, links) for leaf in j.leaves()]
    return placed + list(scene.leaves)


def _axes_of(view: str) -> Array:
    """Rows right, up and to the eye (3, 3) of a view."""
    up, eye = np.array(VIEWS[view], float)
    return np.array([np.cross(up, eye), up, eye])


def _is_plane_curve(leaf: Leaf) -> bool:
    """Whether a leaf stays in the plane normal to its width axis."""
    return leaf.curve is None or not np.any(leaf.curve.curvatures(np.linspace(0.0, 1.0, 17))[:, :2])


def _is_edge_on(leaf: Leaf, axes: Array) -> bool:
    """Whether a leaf is seen from its edge in a view: its width is along the eye (a straight round one may lie anyhow)."""
    e1, _, e3 = leaf.axes.T
    if round_ratio(leaf.section) is not None and leaf.curve is None:
        return abs(axes[2] @ e1) < EDGE_ON
    return bool(np.abs(axes[:2] @ e3).max() < EDGE_ON) and _is_plane_curve(leaf)


def _clearest_view(leaves: Iterable[PlacedLeaf]) -> str:
    """The view in which most leaf springs are seen edge-on; the first of equal ones."""
    return max(PLANES, key=lambda view: sum(_is_edge_on(p.leaf, _axes_of(view)) for p in leaves))


def _bulge(angle: float) -> float:
    """The bulge of a polyline's segment that turns by `angle` [rad]."""
    return math.tan(0.25 * angle)


class _Drawing:
    """A document and what is drawn into it; all methods take metres."""

    def __init__(self, ezdxf: Any, view: str, tolerance: float) -> None:
        self.document = ezdxf.new("R2010", units=4)
        self.document.appids.add(APPLICATION)
        for name, (color, text) in LAYERS.items():
            self.document.layers.add(name, color=color).description = text
        self.space = self.document.modelspace()
        self.axes, self.tolerance = _axes_of(view), tolerance
        self.low, self.high = np.full(2, np.inf), np.full(2, -np.inf)

    def seen(self, points: Any) -> Array:
        """Points (k, 3) [m] in the axes of the view [mm]."""
        drawn: Array = MM * np.asarray(points, float) @ self.axes.T
        self.low = np.minimum(self.low, drawn[..., :2].reshape(-1, 2).min(axis=0))
        self.high = np.maximum(self.high, drawn[..., :2].reshape(-1, 2).max(axis=0))
        return drawn

    @property
    def letter(self) -> float:
        """Height of letters [mm]."""
        return 0.015 * max(float((self.high - self.low).max()), 1.0)

    def add_text(self, text: str, at: Any, height: float | None = None) -> None:
        self.space.add_text(
            text, height=height or self.letter, dxfattribs={"layer": "text", "insert": tuple(at[:2])}
        )

    def closed(self, points: Iterable[Any], layer: str, elevation: float = 0.0) -> Any:
        """A closed polyline through (x, y, bulge) [mm]."""
        attributes = {"layer": layer, "elevation": elevation}
        return self.space.add_lwpolyline(points, format="xyb", close=True, dxfattribs=attributes)

    def add_side_view(self, model: Model, leaves: list[PlacedLeaf]) -> None:
        """Centre lines, outlines, links, pins and points."""
        for placed in leaves:
            self.add_leaf(placed)
        shape = mechanism_shape(model, model.rest, load_factor=0.0)
        for block in shape.blocks:
            self.add_block(block, shape)
        for hinge in model.original_scene.hinges:
            at = self.seen(hinge.at)
            if hinge.kind == "pin" and abs(self.axes[2] @ np.asarray(hinge.axis)) > 1.0 - EDGE_ON:
                pin = self.space.add_circle(at, 0.5 * self.letter, dxfattribs={"layer": "pin"})
                _add_words(pin, {"name": hinge.name, "a": hinge.a, "b": hinge.b})
            else:
                self.space.add_point(at, dxfattribs={"layer": "point"})
            self.add_text(hinge.name, at)
        named = [(d.name, d.rest) for d in shape.driven]
        named += [(load.name, load.at) for load in model.original_scene.loads if any(load.force)]
        for name, place in named:
            at = self.seen(place)
            self.space.add_point(at, dxfattribs={"layer": "point"})
            if name not in model.original_scene.links:  # its link has the name already
                self.add_text(name, at)

    def add_leaf(self, placed: PlacedLeaf) -> None:
        """Centre line with its words, and outline."""
        leaf, edge_on = placed.leaf, _is_edge_on(placed.leaf, self.axes)
        words = leaf_tables(placed)
        s = np.linspace(0.0, 1.0, 2) if leaf.curve is None else self.fractions(leaf)
        place, frames = (np.array(part) for part in zip(*map(leaf.section_at, s), strict=True))
        points = self.seen(place)
        turn = 0.0
        if leaf.curve is None:
            line = self.space.add_line(points[0], points[-1], dxfattribs={"layer": "leaf"})
        elif isinstance(leaf.curve, Arc) and edge_on:
            turn = leaf.curve.angle * float(np.sign(self.axes[2] @ leaf.axes[:, 2]))
            line = self.arc(points[0], points[-1], turn)
            if turn < 0.0:
                # an arc of DXF is drawn counterclockwise
                words["reversed"] = True
        elif np.ptp(points[:, 2]) < 1e-9 * np.ptp(points, axis=0).max():
            attributes = {"layer": "leaf", "elevation": points[0, 2]}
            line = self.space.add_lwpolyline(points[:, :2].tolist(), format="xy", dxfattribs=attributes)
        else:
            line = self.space.add_polyline3d(points.tolist(), dxfattribs={"layer": "leaf"})
        # of a straight leaf its own width axis, of a curved one that of its chord
        words["leaf"]["width_axis"] = (self.axes @ leaf.axes[:, 2]).tolist()
        _add_words(line, words)
        size = MM * np.array([thickness_and_width(q) for q in self.sections(leaf, s)])
        which = 0 if edge_on else 1
        half = 0.5 * size[:, which : which + 1] * (frames[:, :, 1 + which] @ self.axes.T)
        sides = np.concatenate([points + half, (points - half)[::-1]])[:, :2]
        bulges = np.zeros(len(sides))
        if turn and leaf.profile is None:
            # two arcs about the same centre
            n = len(s)
            sides = sides[[0, n - 1, n, 2 * n - 1]]
            bulges = np.array([_bulge(turn), 0.0, -_bulge(turn), 0.0])
        self.closed(np.column_stack([sides, bulges]).tolist(), "outline", points[0, 2])

    def fractions(self, leaf: Leaf) -> Array:
        """Fractions (k,) of a curved leaf between which chords miss it by no more than the tolerance."""
        s = np.linspace(0.0, 1.0, MAX_CHORDS + 1)
        curvature = np.linalg.norm(leaf.curve.curvatures(s), axis=1) if leaf.curve is not None else 0.0 * s
        # a chord c of curvature k misses by k c^2 / 8
        density = np.sqrt(np.maximum(curvature, 1e-3 / leaf.length) / (8.0 * self.tolerance)) * leaf.length
        so_far = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))]) / MAX_CHORDS
        count = math.ceil(1.05 * so_far[-1])
        if count > MAX_CHORDS:
            raise SceneError(
                f"leaf '{leaf.name}': a polyline within {self.tolerance:g} m of its curve has more than {MAX_CHORDS} "
                "points; give a larger tolerance."
            )
        return np.interp(np.linspace(0.0, so_far[-1], max(count, 4) + 1), so_far, s)

    def sections(self, leaf: Leaf, s: Array) -> list[Any]:
        """The sections at fractions s."""
        return [leaf.section if leaf.profile is None else leaf.profile.sides(x)[0] for x in s.tolist()]

    def arc(self, start: Array, end: Array, turn: float) -> Any:
        """The arc from `start` to `end` (3,) [mm] that turns by `turn` [rad] about the eye."""
        chord = (end - start)[:2]
        left = np.array([-chord[1], chord[0]])
        centre = 0.5 * (start + end)[:2] + 0.5 * left / math.tan(0.5 * turn)
        angles = [math.degrees(math.atan2(*(p[:2] - centre)[::-1])) for p in (start, end)]
        radius = 0.5 * float(np.linalg.norm(chord)) / abs(math.sin(0.5 * turn))
        return self.space.add_arc(
            (*centre, start[2]),
            radius,
            *(angles if turn > 0.0 else angles[::-1]),
            dxfattribs={"layer": "leaf"},
        )

    def add_block(self, block: Any, shape: Shape) -> None:
        """A rounded outline around the points of a link; of ground around the points of each joint."""
        owners = block.owner if block.name == "ground" else [block.name] * len(block.owner)
        thickness = [shape.leaves[k].thickness.max() for k in block.leaf if k >= 0]
        radius = MM * 2.0 * max(thickness, default=0.0) or self.letter
        points = self.seen(block.rest)
        for owner in dict.fromkeys(owners):
            own = points[[k for k, name in enumerate(owners) if name == owner], :2]
            line = self.closed(_rounded(own, radius), "link")
            _add_words(line, {"link": block.name})
            self.add_text(block.name, own.mean(axis=0))

    def add_sheets(self, leaves: list[PlacedLeaf], margin: float, hole: float) -> None:
        """Flat patterns beside the side view, and the list of sheets under them."""
        found: dict[_Sheet, list[str]] = {}
        wires: list[str] = []
        for placed in leaves:
            leaf = placed.leaf
            if round_ratio(leaf.section) is None:
                found.setdefault(self.sheet(leaf), []).append(placed.name)
            else:
                _, diameter = thickness_and_width(leaf.section)
                wires.append(
                    f"wire {placed.name}: diameter {MM * diameter:.6g} mm, {MM * leaf.length:.6g} mm long between clamps"
                )
        letter, gap = self.letter, MM * margin
        x = self.high[0] + 10.0 * letter + gap
        y = self.high[1]
        lines = []
        for number, (sheet, names) in enumerate(found.items(), 1):
            edges = np.array(sheet.edges)
            length, half = edges[-1, 0], edges[:, 1].max()
            y -= half
            ring = (
                [(-gap, edges[0, 1]), *sheet.edges, (length + gap, edges[-1, 1])]
                if gap
                else list(sheet.edges)
            )
            self.closed(
                [(x + a, y + b, 0) for a, b in ring] + [(x + a, y - b, 0) for a, b in ring[::-1]], "sheet"
            )
            for a, b in (sheet.edges[0], sheet.edges[-1]):
                self.space.add_line((x + a, y - b), (x + a, y + b), dxfattribs={"layer": "clamp"})
            for a, b in ((-0.5 * gap, edges[0, 1]), (length + 0.5 * gap, edges[-1, 1])) if hole else ():
                # two where there is place for a bridge of a hole between them and to the edges
                for place in (-0.5 * b, 0.5 * b) if b > 2.0 * MM * hole else (0.0,):
                    attributes = {"layer": "hole"}
                    self.space.add_circle((x + a, y + place), 0.5 * MM * hole, dxfattribs=attributes)
            self.add_text(f"sheet {number}", (x, y), letter)
            y -= half + 2.0 * letter
            thickness = "thickness varies" if sheet.thickness is None else f"{sheet.thickness:.6g} mm thick"
            lines.append(
                f"sheet {number}: {len(names)} of {thickness}, {length:.6g} mm between clamps"
                f" + 2 x {gap:g} mm, {2.0 * half:.6g} mm wide, {sheet.material}{sheet.remark}: {', '.join(names)}"
            )
        for line in (part for text in lines + wires for part in wrap(text, TEXT_WIDTH)):
            y -= 2.0 * letter
            self.add_text(line, (x, y), letter)

    def sheet(self, leaf: Leaf) -> _Sheet:
        """The developed sheet of a leaf spring."""
        inside = () if leaf.profile is None else tuple(
            side for b in leaf.profile.breaks for side in (b - 1e-9, b + 1e-9)
        )  # fmt: skip
        s = np.array([0.0, 1.0]) if leaf.profile is None else np.unique([*np.linspace(0.0, 1.0, 65), *inside])
        sizes = MM * np.array([thickness_and_width(q) for q in self.sections(leaf, s)])
        varies = np.ptp(sizes[:, 0]) > 1e-9 * sizes[:, 0].max()
        if np.ptp(np.diff(sizes[:, 1]) / np.diff(s)) <= 1e-9 * sizes[:, 1].max():
            s, sizes = s[[0, -1]], sizes[[0, -1]]
        # rounded, so that equal sheets are equal
        edges = np.column_stack([MM * leaf.length * s, 0.5 * sizes[:, 1]]).round(9)
        remark = ""
        if isinstance(leaf.curve, Arc):
            degrees = math.degrees(abs(leaf.curve.angle))
            remark = f", bent to radius {MM * leaf.curve.radius:.6g} mm over {degrees:.6g} degrees"
        elif leaf.curve is not None:
            remark = ", bent to its free curve"
        thickness = None if varies else round(float(sizes[0, 0]), 9)
        material = leaf.material.name or "material without name"
        return _Sheet(tuple(map(tuple, edges.tolist())), thickness, material, remark)


def _add_words(entity: Any, words: dict[str, Any]) -> None:
    """Attach words to an entity as extended data, JSON cut into pieces."""
    text = json.dumps(words)
    entity.set_xdata(APPLICATION, [(1000, text[k : k + PIECE]) for k in range(0, len(text), PIECE)])


def _rounded(points: Array, radius: float) -> list[tuple[float, float, float]]:
    """Corners (x, y, bulge) of the convex hull of points (k, 2), moved out by `radius`, its corners rounded."""
    try:
        corners = points[ConvexHull(points).vertices]
    except (QhullError, ValueError):
        # a point, or points on a line
        along = np.linalg.svd(points - points.mean(axis=0)).Vh[0]
        reach = points @ along
        corners = points[[int(reach.argmin()), int(reach.argmax())]]
        if np.ptp(reach) < 1e-6 * radius:
            x, y = corners[0]
            return [(x + radius, y, 1.0), (x - radius, y, 1.0)]
    edges = np.roll(corners, -1, axis=0) - corners
    out = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1)[:, None]
    ring = []
    for k, corner in enumerate(corners):
        before, after = out[k - 1], out[k]
        turn = math.atan2(before[0] * after[1] - before[1] * after[0], before @ after) % (2.0 * math.pi)
        ring.append((*(corner + radius * before), _bulge(turn)))
        ring.append((*(corner + radius * after), 0.0))
    return ring
