"""Entities of a drawing (DXF) as strokes: lines, arcs, polylines with bulges and free curves, in the axes of the drawing.

Blocks are opened, mirrored entities (whose own axis points down) turned over.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
APPLICATION = "KSD"
"""Name of the extended data that `ksd.export.dxf` writes."""
FLAT = 1e-9
"""Largest slope out of the plane xy of what lies in it."""


@dataclass
class Stroke:
    """Lines and arcs that follow one another, or the points of a free curve, in the unit of the drawing.

    name: of the entity in messages; points (k, 3); turns (k-1,): angle [rad] about z of every piece, 0 for a line; free:
    whether it is one curve through the points; tangents: angles at its ends; words: extended data.
    """

    name: str
    points: Array
    turns: Array
    closed: bool = False
    free: bool = False
    tangents: tuple[float, float] = (0.0, 0.0)
    words: dict[str, Any] = field(default_factory=dict)


def handle_of(entity: Any) -> str:
    """The handle of an entity, of its original where it is inside a block."""
    made = entity if entity.dxf.handle else (entity.source_of_copy or entity)
    return str(made.dxf.handle or "in a block")


def entities(space: Any, layer: str = "", inside: tuple[str, ...] = ()) -> Iterator[tuple[Any, str]]:
    """All entities and their layers, those of blocks too; layer: that of the block they are in, which those on 0 take;
    inside: names of the blocks around. Raises ValueError for a block in itself, and whatever ezdxf raises."""
    for entity in space:
        own = entity.dxf.get("layer", "0")
        own = layer if own == "0" and layer else own
        if entity.dxftype() != "INSERT":
            yield entity, own
            continue
        name = entity.dxf.get("name", "").casefold()
        if name in inside:
            raise ValueError(f"the block '{entity.dxf.name}' holds itself")
        for row in entity.multi_insert() if entity.mcount > 1 else (entity,):
            yield from entities(row.virtual_entities(), own, (*inside, name))


def words_of(entity: Any) -> dict[str, Any]:
    """The extended data of ksd of an entity; none where they are not as ksd writes them."""
    if not entity.has_xdata(APPLICATION):
        return {}
    try:
        words = json.loads("".join(tag.value for tag in entity.get_xdata(APPLICATION) if tag.code == 1000))
    except ValueError:
        return {}
    return words if isinstance(words, dict) else {}


def to_world(entity: Any, points: Any) -> Array:
    """Points (k, 3) of the coordinate system of an entity in that of the drawing."""
    return np.array([tuple(p) for p in entity.ocs().points_to_wcs([(*p, 0.0)[:3] for p in points])])


def reach_of(stroke: Stroke) -> float:
    """Largest coordinate of a stroke, or radius of an arc of more than half a turn; nan or infinite where one is."""
    with np.errstate(all="ignore"):
        chords = np.linalg.norm(np.diff(stroke.points, axis=0), axis=1)
        radii = 0.5 * chords / np.abs(np.sin(0.5 * stroke.turns))
        return float(
            np.max([np.abs(stroke.points).max(), *np.where(np.abs(stroke.turns) <= math.pi, 0.0, radii)])
        )


def stroke_of(entity: Any, join: float) -> Stroke | None:
    """The stroke of an entity; None for what is no line, or does not lie parallel to the plane xy. Raises whatever ezdxf
    raises for a damaged one."""
    kind, name = entity.dxftype(), f"{entity.dxftype()} {handle_of(entity)}"
    if kind == "LINE":
        return Stroke(name, np.array([tuple(entity.dxf.start), tuple(entity.dxf.end)]), np.zeros(1))
    side = 1.0
    if entity.dxf.hasattr("extrusion"):
        e = entity.dxf.extrusion.normalize()
        if math.hypot(e.x, e.y) > FLAT:
            return None
        side = math.copysign(1.0, e.z)
    if kind in ("ARC", "CIRCLE"):
        angles = [entity.dxf.start_angle, entity.dxf.end_angle] if kind == "ARC" else [0.0, 360.0]
        turn = (angles[1] - angles[0]) % 360.0 or 360.0
        # a whole circle has no chord
        count = 2 if turn > 359.0 else 1
        at = np.radians(angles[0] + turn * np.arange(count + 1) / count)
        c, r = entity.dxf.center, entity.dxf.radius
        points = to_world(entity, [(c.x + r * math.cos(a), c.y + r * math.sin(a), c.z) for a in at])
        return Stroke(
            name, points, np.full(count, side * math.radians(turn) / count), closed=kind == "CIRCLE"
        )
    if kind == "LWPOLYLINE":
        rows = list(entity.get_points("xyb"))
        corners = [(x, y, entity.dxf.elevation) for x, y, _ in rows]
        return _polyline(name, to_world(entity, corners), [side * b for *_, b in rows], bool(entity.closed))
    if kind == "POLYLINE" and (entity.is_2d_polyline or entity.is_3d_polyline):
        vertices = list(entity.vertices)
        points = np.array([tuple(v.dxf.location) for v in vertices]).reshape(-1, 3)
        if entity.is_2d_polyline:
            points = to_world(entity, points)
        return _polyline(
            name, points, [side * v.dxf.get("bulge", 0.0) for v in vertices], bool(entity.is_closed)
        )
    if kind in ("SPLINE", "ELLIPSE"):
        curve = entity.construction_tool()
        if kind == "ELLIPSE":
            params = np.linspace(
                curve.start_param,
                curve.end_param if curve.end_param > curve.start_param else curve.end_param + 2 * math.pi,
                513,
            )
            points = np.array([tuple(p) for p in curve.vertices(params)])
        else:
            points = np.array([tuple(p) for p in curve.points(np.linspace(0.0, curve.max_t, 513))])
        chords = np.diff(points, axis=0)
        step = [points[k] - points[0] for k in (1, 2)], [points[k] - points[-1] for k in (-2, -3)]
        # tangents of second order
        slopes = [4.0 * step[0][0] - step[0][1], -(4.0 * step[1][0] - step[1][1])]
        tangents = tuple(math.atan2(t[1], t[0]) for t in slopes)
        closed = bool(np.linalg.norm(points[0] - points[-1]) <= join)
        return Stroke(name, points, np.zeros(len(chords)), closed, True, (tangents[0], tangents[1]))
    return None


def _polyline(name: str, points: Array, bulges: list[float], closed: bool) -> Stroke | None:
    """The stroke of a polyline with bulges."""
    if len(points) < 2:
        return None
    if closed:
        points = np.concatenate([points, points[:1]])
    turns = 4.0 * np.arctan(np.array(bulges[: len(points) - 1], float))
    return Stroke(name, points, turns, closed)
