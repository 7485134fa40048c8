"""The drawing as text of SVG, in millimetres: grid, undeformed lines in grey, the deformed mechanism in blue over it.

What can be taken by the mouse has its name in `data-name`: "leaf/0/start", "leaf/0/middle", "load/0/tip", "drive/top".
"""

from __future__ import annotations

import html
import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from ksd.errors import SceneError
from ksd.interactive.drawing import LOAD_SCALE, Drawing, Point
from ksd.interactive.numbers import Asked
from ksd.scene.drive import GROUND
from ksd.scene.scene import Scene
from ksd.units import mm
from ksd.view.bodies import convex_hull
from ksd.view.figure import DRIVE_COLOR, GROUND_COLOR, LINK_COLORS, LOAD_COLOR

Box = tuple[float, float, float, float]
"""Left, top, width and height of what is seen [mm], downwards as SVG has it."""
PIXELS = 900
"""Width of the view for which sizes of text and marks are chosen."""
REST, DEFORMED = "#9aa3b2", "#3b6ea5"
"""Colours of undeformed and deformed leaf springs."""
EMPTY_BOX: Box = (-100.0, -110.0, 200.0, 150.0)


def fitted_box(drawing: Drawing, asked: Asked | None = None) -> Box:
    """The box around all that is drawn, with room for more."""
    drawing.draft  # noqa: B018
    points = [(h.at[0] / mm, -h.at[1] / mm) for h in drawing.handles()]
    if asked is not None:
        i, j = drawing.axes
        points += [
            (p[i] / mm, -p[j] / mm) for leaf in asked.shape.leaves for p in (leaf.place[0], leaf.place[-1])
        ]
    if len(points) < 2:
        return EMPTY_BOX
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    wide = max(1.5 * float(max(high - low)), 1e-3)
    middle = 0.5 * (low + high)
    return float(middle[0] - 0.5 * wide), float(middle[1] - 0.4 * wide), wide, 0.8 * wide


def plane_svg(
    drawing: Drawing, asked: Asked | None, box: Box, *, grid: float, refused: bool, line: tuple[Point, Point] | None = None
) -> str:  # fmt: skip
    """The drawing as the inside of an <svg>; asked: the last pose that solved; line: what is being drawn [m]."""
    return _Picture(drawing, box, grid / mm).all_of(asked, refused, line)


class _Picture:
    """Elements of one picture, as they are added."""

    def __init__(self, drawing: Drawing, box: Box, grid: float) -> None:
        self.drawing, self.box, self.grid = drawing, box, grid
        self.unit = box[2] / PIXELS
        self.parts: list[str] = []

    def all_of(self, asked: Asked | None, refused: bool, line: tuple[Point, Point] | None) -> str:
        self._grid()
        scene = self.drawing.draft
        if asked is not None:
            self._deformed(asked, DEFORMED if not refused else "#c3c9d4", dim=refused)
        if scene is not None:
            self._undeformed(scene)
        self._statements()
        self._handles(scene)
        if line is not None:
            self._line([self._at(p) for p in line], LOAD_COLOR, 2.0, dashed=True)
        return "".join(self.parts)

    def _at(self, point: Point) -> Point:
        return point[0] / mm, -point[1] / mm

    def _in_plane(self, points: Any) -> list[Point]:
        i, j = self.drawing.axes
        return [(float(p[i]) / mm, -float(p[j]) / mm) for p in np.atleast_2d(points)]

    def _line(
        self, points: Iterable[Point], color: str, width: float, *, name: str = "", dashed: bool = False, fill: str = "none"
    ) -> None:  # fmt: skip
        text = " ".join(f"{x:.5g},{y:.5g}" for x, y in points)
        more = f' stroke-dasharray="{5 * self.unit:.3g}"' if dashed else ""
        more += f' data-name="{html.escape(name)}" style="cursor:pointer"' if name else ""
        kind = "polygon" if fill != "none" else "polyline"
        self.parts.append(
            f'<{kind} points="{text}" fill="{fill}" stroke="{color}" stroke-width="{width * self.unit:.4g}" '
            f'stroke-linejoin="round" stroke-linecap="round"{more}/>'
        )

    def _dot(self, at: Point, radius: float, color: str, fill: str, name: str = "") -> None:
        more = f' data-name="{html.escape(name)}" style="cursor:grab"' if name else ""
        self.parts.append(
            f'<circle cx="{at[0]:.5g}" cy="{at[1]:.5g}" r="{radius * self.unit:.4g}" fill="{fill}" stroke="{color}" '
            f'stroke-width="{1.5 * self.unit:.4g}"{more}/>'
        )

    def _label(self, at: Point, text: str, color: str) -> None:
        size, shift = 12 * self.unit, 8 * self.unit
        self.parts.append(
            f'<text x="{at[0] + shift:.5g}" y="{at[1] - shift:.5g}" font-size="{size:.4g}" fill="{color}" '
            f'font-family="Roboto,sans-serif" style="pointer-events:none;user-select:none">{html.escape(text)}</text>'
        )

    def _arrow(self, start: Point, end: Point, color: str, width: float, name: str = "") -> None:
        away = end[0] - start[0], end[1] - start[1]
        long = math.hypot(*away)
        if long < 1e-9:
            return
        u, head = (away[0] / long, away[1] / long), min(9 * self.unit, 0.4 * long)
        neck = end[0] - head * u[0], end[1] - head * u[1]
        self._line([start, neck], color, width)
        side = 0.45 * head
        corners = [
            end,
            (neck[0] - side * u[1], neck[1] + side * u[0]),
            (neck[0] + side * u[1], neck[1] - side * u[0]),
        ]
        self._line(corners, color, 1.0, fill=color, name=name)

    def _grid(self) -> None:
        left, top, wide, tall = self.box
        # the view may be taller than the box
        top, tall = top - 0.5 * tall, 2 * tall
        step = self.grid or 10.0
        while wide / step > 60:
            step *= 10
        for k in range(math.ceil(left / step), math.floor((left + wide) / step) + 1):
            self._line(
                [(k * step, top), (k * step, top + tall)], "#c3c9d4" if k % 10 == 0 else "#eef0f4", 1.0
            )
        for k in range(math.ceil(top / step), math.floor((top + tall) / step) + 1):
            self._line(
                [(left, k * step), (left + wide, k * step)], "#c3c9d4" if k % 10 == 0 else "#eef0f4", 1.0
            )

    # the mechanism

    def _undeformed(self, scene: Scene) -> None:
        rows = {t.get("name"): r for k, r, t in self.drawing.rows() if k == "leaf"}
        inside = [(j, leaf) for j in scene.joints for leaf in j.leaves()]
        joints = {t.get("name"): r for k, r, t in self.drawing.rows() if k == "join"}
        for placed in scene.leaves:
            fractions = np.linspace(0, 1, 25) if placed.leaf.curve is not None else (0.0, 1.0)
            points = self._in_plane([placed.leaf.section_at(s)[0] for s in fractions])
            row = rows.get(placed.name)
            chosen = self.drawing.selected == f"leaf/{row}"
            self._line(
                points, LOAD_COLOR if chosen else REST, 2.2 if chosen else 1.6, name=f"leaf/{row}/line"
            )
        for joint, leaf in inside:
            fractions = np.linspace(0, 1, 25) if leaf.curve is not None else (0.0, 1.0)
            points = self._in_plane([joint.place(leaf.section_at(s)[0]) for s in fractions])
            row = joints.get(joint.name)
            chosen = self.drawing.selected == f"join/{row}"
            self._line(
                points, LOAD_COLOR if chosen else REST, 2.2 if chosen else 1.2, name=f"join/{row}/line"
            )

    def _deformed(self, asked: Asked, color: str, *, dim: bool) -> None:
        shape = asked.shape
        links = [b.name for b in shape.blocks if b.name != GROUND and "/" not in b.name]
        for block in shape.blocks:
            if block.name == GROUND or "/" in block.name:
                continue
            points = np.array(self._in_plane(block.place))
            tint = REST if dim else LINK_COLORS[links.index(block.name) % len(LINK_COLORS)]
            if len(points) > 1 and np.ptp(points, axis=0).max() > 1e-9:
                corners = [tuple(p) for p in convex_hull(points).tolist()]
                driver = next(
                    (d.name for d in asked.pose.model.scene.drives if d.terms[0].link == block.name), ""
                )
                name = f"drive/{driver}" if driver else ""
                self._line(corners, tint, 7.0, fill=f"{tint}40", name=name)
            middle = points.mean(axis=0)
            self._label((float(middle[0]), float(middle[1])), block.name, tint)
        for leaf in shape.leaves:
            self._line(self._in_plane(leaf.place), color, 2.6)
        for hinge in shape.hinges:
            self._dot(self._in_plane(hinge.place)[0], 4.5, color, "white")
        long = 34 * self.unit
        for driven in shape.driven:
            at = self._in_plane(driven.place)[0]
            if driven.kind == "translation":
                toward = self._in_plane(driven.direction)[0]
                size = math.hypot(*toward) or 1.0
                end = at[0] + long * toward[0] / size, at[1] + long * toward[1] / size
                self._arrow(at, end, DRIVE_COLOR, 2.4, name=f"drive/{driven.name}")
            self._dot(at, 6.0, DRIVE_COLOR, "#eef0f4", name=f"drive/{driven.name}")
            self._label((at[0], at[1] + 22 * self.unit), driven.name, DRIVE_COLOR)

    def _statements(self) -> None:
        """Loads, supports, springs and distances as they are stated, which need no solve."""
        for kind, row, table in self.drawing.rows():
            chosen = self.drawing.selected == f"{kind}/{row}"
            try:
                if kind == "load" and "force" in table and "at" in table:
                    start = self.drawing.point(table["at"])
                    force = [
                        self.drawing.number(table["force"][k], "force") / LOAD_SCALE
                        for k in self.drawing.axes
                    ]
                    tip = self._at((start[0] + force[0], start[1] + force[1]))
                    self._arrow(
                        self._at(start), tip, LOAD_COLOR, 3.0 if chosen else 2.2, name=f"load/{row}/tip"
                    )
                elif kind in ("spring", "distance"):
                    ends = [self._at(self.drawing.point(table[k])) for k in ("start", "end")]
                    self._line(
                        ends, GROUND_COLOR, 2.2 if chosen else 1.2, name=f"{kind}/{row}/line", dashed=True
                    )
                elif kind in ("support", "actuate", "slider", "pin") and "at" in table:
                    at = self._at(self.drawing.point(table["at"]))
                    mark = {"support": "▲", "actuate": "", "slider": "▭", "pin": ""}[kind]
                    if mark:
                        self._label((at[0] - 14 * self.unit, at[1] + 22 * self.unit), mark, GROUND_COLOR)
                    if chosen:
                        self._dot(at, 9.0, LOAD_COLOR, "none")
            except (SceneError, TypeError, IndexError, KeyError):
                continue

    def _handles(self, scene: Scene | None) -> None:
        for row, table in enumerate(self.drawing.tables.get("leaf", ())):
            placed = (
                next((p for p in scene.leaves if p.name == table.get("name")), None)
                if scene is not None
                else None
            )
            if placed is not None:
                middle = self._in_plane(placed.leaf.section_at(0.5)[0])[0]
                self._dot(middle, 4.0, REST, "#eef0f4", name=f"leaf/{row}/middle")
        for handle in self.drawing.handles():
            ground = handle.links == (GROUND,)
            at = self._at(handle.at)
            if handle.key != "far end":
                self._dot(
                    at,
                    5.0,
                    GROUND_COLOR if ground else REST,
                    GROUND_COLOR if ground else "white",
                    handle.name,
                )
            if ground:
                size = 6 * self.unit
                for k in (-1, 0, 1):
                    foot = at[0] + k * size, at[1] + 1.2 * size
                    self._line([foot, (foot[0] - 0.8 * size, foot[1] + size)], GROUND_COLOR, 1.2)
                self._line(
                    [(at[0] - 1.8 * size, at[1] + 1.2 * size), (at[0] + 1.8 * size, at[1] + 1.2 * size)],
                    GROUND_COLOR,
                    1.6,
                )
