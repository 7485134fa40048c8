"""What `sheets.js` draws: leaf springs as sheets, blocks as bodies, marks; and the numbers that move them.

The geometry of a model is sent once as JSON: corners of bodies at rest, kinds and names of marks, numbers of stations. Every
pose then is arrays of 32-bit floats in base 64: corners of all sheets, a 3 x 4 matrix per body, point and vector per mark.
"""

from __future__ import annotations

import base64
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from ksd.answers.shape import Shape
from ksd.scene.scene import Scene
from ksd.units import MPa, mm
from ksd.view.bodies import (
    PAD_HALF_THICKNESS,
    block_colors,
    clamp_pads,
    convex_parts,
    mechanism_size,
    thickened,
)
from ksd.view.drawable import Drawable
from ksd.view.figure import (
    DRIVE_COLOR,
    FAINT_COLOR,
    GROUND_COLOR,
    LEAF_COLOR,
    LOAD_COLOR,
    SENSOR_COLOR,
    color_map,
)

Array = NDArray[np.float64]
ROUND_CORNERS = 8
"""Corners of the cross-section of wires."""
COLORS = 32
"""Number of colours on the scale of stress."""
MARK_LENGTH = 0.16
"""Length of arrows relative to the size of the mechanism."""
COLOR_OF = {"drive": DRIVE_COLOR, "load": LOAD_COLOR, "hinge": GROUND_COLOR, "spring": FAINT_COLOR, "sensor": SENSOR_COLOR,
            "distance": FAINT_COLOR, "mass": GROUND_COLOR}  # fmt: skip


def _profile(is_round: bool) -> Array:
    """Corners (c, 2) of a cross-section, in half thicknesses along e2 and half widths along e3, anticlockwise."""
    if not is_round:
        return np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    angle = 2 * np.pi * np.arange(ROUND_CORNERS) / ROUND_CORNERS
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def sheet_corners(shape: Shape, *, rest: bool = False) -> Array:
    """Corners (n, 3) [m] of all leaf springs: leaf by leaf, station by station, those of its cross-section."""
    if not shape.leaves:
        return np.zeros((0, 3))
    place = np.concatenate([leaf.rest if rest else leaf.place for leaf in shape.leaves])
    axes = np.concatenate([leaf.rest_axes if rest else leaf.axes for leaf in shape.leaves])
    half = 0.5 * np.concatenate([np.stack([leaf.thickness, leaf.width], axis=1) for leaf in shape.leaves])
    if not any(leaf.is_round for leaf in shape.leaves):
        local = half[:, None] * _profile(False)
        corners: Array = (place[:, None] + local @ axes[:, :, 1:].transpose(0, 2, 1)).reshape(-1, 3)
        return corners
    parts, at = [], 0
    for leaf in shape.leaves:
        here = slice(at, at + len(leaf.s))
        local = half[here, None] * _profile(leaf.is_round)
        parts.append((place[here, None] + local @ axes[here, :, 1:].transpose(0, 2, 1)).reshape(-1, 3))
        at += len(leaf.s)
    return np.concatenate(parts)


def _marks(shape: Shape, size: float, scene: Scene) -> list[tuple[str, str, str, Array, Array]]:
    """Kind of figure, group for its colour, name, point (3,) [m] and vector (3,) [m] of every mark."""
    long = MARK_LENGTH * size
    forces = [float(np.linalg.norm(m.value)) for m in shape.loads if m.kind == "force"]
    moments = [float(np.linalg.norm(m.value)) for m in shape.loads if m.kind == "moment"]
    largest = {"force": max(forces, default=1.0), "moment": max(moments, default=1.0)}
    marks = []
    for d in shape.driven:
        marks.append(
            ("arrow" if d.kind == "translation" else "turn", "drive", d.name, d.place, long * d.direction)
        )
    for load in shape.loads:
        if load.kind == "mass":
            marks.append(("ball", "mass", "", load.place, 0.12 * long * np.array([1.0, 0.0, 0.0])))
            continue
        vector = long * load.value / largest[load.kind]
        marks.append(("arrow" if load.kind == "force" else "turn", "load", load.name, load.place, vector))
    for line in shape.line_loads:
        most = float(np.linalg.norm(line.value, axis=1).max()) or 1.0
        arrows = zip(line.place, 0.5 * long * line.value / most, strict=True)
        figure = "arrow" if line.kind == "force" else "turn"
        marks += [(figure, "load", line.name, place, vector) for place, vector in arrows]
    for h in shape.hinges:
        figure = {"pin": "pin", "slider": "box", "ball": "ball", "cylindrical": "pin"}[h.kind]
        marks.append((figure, "hinge", h.name, h.place, 0.2 * long * h.axis))
    for spring in shape.springs:
        if len(spring.ends) == 2:
            marks.append(("coil", "spring", spring.name, spring.ends[0], spring.ends[1] - spring.ends[0]))
        else:
            marks.append(
                ("turn", "spring", spring.name, spring.ends[0], 0.5 * long * np.array([0.0, 0.0, 1.0]))
            )
    for d2 in shape.distances:
        marks.append(("line", "distance", d2.name, d2.ends[0], d2.ends[1] - d2.ends[0]))
    for cable in shape.cables:
        for a, b in zip(cable.points, cable.points[1:], strict=False):
            marks.append(("line", "distance", cable.name, a, b - a))
    for surface in shape.surfaces:
        for a, b in pairwise(surface.outline):
            marks.append(("line", "hinge", surface.name, a, b - a))
    for stop in shape.stops:
        marks.append(("arrow", "hinge", stop.name, stop.place, 0.4 * long * stop.direction))
    for sensor in shape.sensors:
        figure = "turn" if sensor.turns else "arrow"
        marks.append((figure, "sensor", sensor.name, sensor.place, 0.6 * long * sensor.direction))
    return marks


def sheets_geometry(pose: Drawable, shape: Shape) -> dict[str, Any]:
    """What stays as long as the model of a pose does, for JSON; lengths in mm."""
    scene = pose.model.scene
    size, colors = mechanism_size(shape), block_colors(shape)
    bodies = []
    for block in shape.blocks:
        pads = clamp_pads(shape, block, rest=True)
        parts = [
            _hull(points, PAD_HALF_THICKNESS * size)
            for points in convex_parts(block, pads, size)
            if len(points)
        ]
        inside = "/" in block.name
        bodies.append({"name": "" if inside else block.name, "color": colors[block.name], "corners": _packed(*parts),
                       "at": (block.rest.mean(axis=0) / mm).tolist()})  # fmt: skip
    blocks = [points for b in shape.blocks for points in (b.rest, b.place)]
    everything = np.concatenate([sheet_corners(shape, rest=True), sheet_corners(shape), *blocks])
    low, high = everything.min(axis=0) / mm, everything.max(axis=0) / mm
    ramp = color_map()
    return {
        "leaves": [
            {"name": leaf.name, "stations": len(leaf.s), "corners": ROUND_CORNERS if leaf.is_round else 4}
            for leaf in shape.leaves
        ],
        "bodies": bodies,
        "marks": [
            {"figure": f, "color": COLOR_OF[g], "name": n} for f, g, n, _, _ in _marks(shape, size, scene)
        ],
        "rest": _packed(sheet_corners(shape, rest=True) / mm),
        "bounds": [low.tolist(), high.tolist()],
        "plane": scene.plane or "",
        "leafColor": LEAF_COLOR,
        "colors": [[float(c) for c in ramp(k / (COLORS - 1))[:3]] for k in range(COLORS)],
    }


def _hull(points: Array, half: float) -> Array:
    """Corners (3 k, 3) [mm] of the triangles of the convex hull of points, thickened, seen from outside anticlockwise."""
    around = thickened(points, half)
    hull = ConvexHull(around)
    corners = around[hull.simplices]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = (across * hull.equations[:, :3]).sum(axis=1) < 0.0
    corners[inward] = corners[inward, ::-1]
    return corners.reshape(-1, 3) / mm


def sheets_pose(
    pose: Drawable, shape: Shape, stress: Array | None, *, most: float | None = None
) -> dict[str, Any]:
    """What moves with every pose, for JSON.

    stress (stations of all leaf springs) [Pa]: for their colours; most [Pa]: end of their scale, the largest when None.
    """
    scene, size = pose.model.scene, float(pose.model.arrays.size)
    frames = np.empty((len(shape.blocks), 3, 4))
    for k, block in enumerate(shape.blocks):
        frames[k, :, :3], frames[k, :, 3] = block.rotation, block.position / mm
    marks = [np.concatenate([place, vector]) for *_, place, vector in _marks(shape, size, scene)]
    sent = {
        "sheets": _packed(sheet_corners(shape) / mm),
        "frames": _packed(frames),
        "marks": _packed(np.array(marks).reshape(-1, 6) / mm),
    }
    if stress is None:
        return sent
    end = float(stress.max(initial=0.0)) if most is None else most
    return sent | {"stress": _packed(stress / (end or 1.0)), "most": f"{end / MPa:.4g}"}


def station_stress(pose: Drawable, shape: Shape) -> tuple[Array, dict[str, float]]:
    """Largest von Mises stress [Pa] over the section at the stations of all leaf springs, one after another, and the largest
    of each leaf spring by name."""
    if not shape.leaves:
        return np.zeros(0), {}
    found, along, largest = pose.stress(points=len(shape.leaves[0].s)), [], dict[str, float]()
    for leaf in shape.leaves:
        own = found[leaf.name]
        most = own.von_mises_Pa.max(axis=1)
        along.append(most if np.array_equal(own.s, leaf.s) else np.interp(leaf.s, own.s, most))
        largest[leaf.name] = float(most.max())
    return np.concatenate(along), largest


def _packed(*arrays: Array) -> str:
    """Numbers of arrays, one after another, as 32-bit floats in base 64."""
    return base64.b64encode(b"".join(np.ascontiguousarray(a, "<f4").tobytes() for a in arrays)).decode()
