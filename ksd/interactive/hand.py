"""The mouse on a drawing: tools turn pressing, moving and letting go into actions; points snap to others and to a grid."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from ksd.errors import SceneError
from ksd.interactive.drawing import LIBRARY, LOAD_SCALE, NEW_LINK, Drawing, Handle, Point
from ksd.interactive.session import Session
from ksd.scene.drive import GROUND
from ksd.scene.hinges import PLANES
from ksd.units import deg, mm

TOOLS = {
    "move": "drag points, middles of leaf springs, tips of loads, driven links; click to select",
    "leaf": "press at its start, let go at its end",
    "joint": "press at interface A, let go at B",
    "pin": "press on the first link, let go where the pin is; or click",
    "slider": "press on the link, let go in its direction",
    "support": "press on a link, let go in the direction that is held; click: its rotation",
    "drive": "press on a link, let go in the direction that is driven; click: its rotation",
    "load": "press on a link, let go at the tip of the arrow",
    "spring": "press at its start on a link, let go at its end",
    "distance": "press at its start on a link, let go at its end",
}
"""Tools of the tool bar, and what to do with the mouse."""


class Hand:
    """The mouse of one viewer on the drawing of a session.

    tool: a key of TOOLS; start, end: links that a new part joins where none is under the mouse; grid [m]; within [m]: how
    near points attract. line: what is being drawn, from and to [m].
    """

    def __init__(self, drawing: Drawing, session: Session) -> None:
        self.drawing, self.session = drawing, session
        self.tool, self.family, self.start, self.end = "move", next(iter(LIBRARY)), GROUND, NEW_LINK
        self.grid, self.within = 5 * mm, 3 * mm
        self.line: tuple[Point, Point] | None = None
        self._held: Callable[[Point, bool], None] | None = None
        self._from: Handle | None = None
        self._pressed: Point = (0.0, 0.0)
        self._drive: tuple[str, float, Point] | None = None
        self._driven: float | None = None

    def snapped(self, at: Point, *, straight_from: Point | None = None, but: Handle | None = None) -> Point:
        """The point meant by a place: another point near by, or the next on the grid; on a multiple of 45 degrees."""
        if straight_from is not None:
            away = at[0] - straight_from[0], at[1] - straight_from[1]
            angle = round(math.atan2(away[1], away[0]) / (math.pi / 4)) * math.pi / 4
            long = away[0] * math.cos(angle) + away[1] * math.sin(angle)
            at = straight_from[0] + long * math.cos(angle), straight_from[1] + long * math.sin(angle)
        elif but is None and (near := self.drawing.near(at, self.within)) is not None:
            return near.at
        if self.grid:
            at = self.grid * round(at[0] / self.grid), self.grid * round(at[1] / self.grid)
        return at

    def press(self, at: Point, name: str = "", *, shift: bool = False) -> None:
        """The button goes down at a place [m]; name: of what is under the mouse."""
        self._pressed, self._from = at, self.drawing.near(at, self.within)
        self.line = self._held = self._drive = self._driven = None
        if self.tool != "move":
            self.line = self.snapped(at), self.snapped(at)
            return
        kind, _, key = name.rpartition("/")
        if kind == "drive":
            self._take_drive(key, at)
            return
        self.drawing.selected = kind or (f"{self._from.kind}/{self._from.row}" if self._from else "")
        self.drawing.begin()
        if key == "middle":
            row = int(kind.partition("/")[2])
            self._held = lambda to, _: self.drawing.bend(row, to)
        elif key == "tip":
            self._held = lambda to, _: self._move_tip(int(kind.partition("/")[2]), to)
        elif self._from is not None and self._from.key != "far end":
            self._held = self._move_point

    def move(self, at: Point, *, shift: bool = False) -> None:
        """The mouse moves with the button down."""
        if self.line is not None:
            self.line = self.line[0], self.snapped(at, straight_from=self.line[0] if shift else None)
        elif self._drive is not None:
            self._move_drive(at)
        elif self._held is not None:
            self._held(at, shift)

    def release(self, at: Point, *, shift: bool = False) -> None:
        """The button comes up: the action is done, at this place, also where the page had no time to tell the last move."""
        if at != self._pressed:
            self.move(at, shift=shift)
        line, drive, self._drive, self._held = self.line, self._drive, None, None
        self.line = None
        if line is not None:
            end = self.snapped(at, straight_from=line[0] if shift else None)
            self._draw(line[0], end)
        elif drive is not None:
            if self._driven is not None:
                self.drawing.set_drive(drive[0], self._driven, self.session.sliders[drive[0]].unit)
        else:
            self.drawing.end()

    def cancel(self) -> None:
        """Give up what was begun."""
        self.line = self._held = None
        if self._drive is not None:
            self.session.wish(self._drive[0], self._drive[1])
            self._drive = None
        self.drawing.cancel()

    # what the move tool holds

    def _move_point(self, to: Point, alone: bool) -> None:
        assert self._from is not None
        handle = next((h for h in self.drawing.handles() if h.name == self._from.name), None)
        if handle is None:
            return
        at = self.snapped(to, but=handle)
        if at != handle.at:
            self.drawing.move(handle, at, alone=alone)

    def _move_tip(self, row: int, to: Point) -> None:
        table = self.drawing.tables["load"][row]
        start = self.drawing.point(table["at"])
        table["force"] = self.drawing.force(start, self.snapped(to, but=self._from))
        self.drawing.tell()

    def _take_drive(self, name: str, at: Point) -> None:
        if name not in self.session.sliders:
            raise SceneError(f"drive '{name}' has no slider yet: what is drawn does not solve.")
        self._drive = name, self.session.sliders[name].value, at

    def _move_drive(self, at: Point) -> None:
        """The drive follows the mouse: along its direction, or about its point."""
        assert self._drive is not None
        name, value, start = self._drive
        drive = next(d for d in self.session.scene.drives if d.name == name)
        term, (i, j) = drive.terms[0], self.drawing.axes
        if term.kind == "translation":
            by = (at[0] - start[0]) * term.direction[i] + (at[1] - start[1]) * term.direction[j]
        else:
            pivot = self._pivot(term)
            by = math.atan2(at[1] - pivot[1], at[0] - pivot[0]) - math.atan2(
                start[1] - pivot[1], start[0] - pivot[0]
            )
            by = (by + math.pi) % (2 * math.pi) - math.pi
            # about an axis into the picture the angle grows clockwise
            by *= term.direction[PLANES[self.drawing.plane]] * (-1.0 if self.drawing.plane == "xz" else 1.0)
        value += by / term.coefficient
        # to what a hand can mean: a small part of how near points attract, hundredths of a degree
        step = 10.0 ** math.floor(math.log10(self.within / 20)) if term.kind == "translation" else 0.01 * deg
        self._driven = round(value / step) * step
        self.session.wish(name, self._driven)

    def _pivot(self, term: Any) -> Point:
        """The place about which a driven rotation is dragged: its point, else the middle of where its link is held."""
        i, j = self.drawing.axes
        if any(term.point):
            return term.point[i], term.point[j]
        places = [h.at for h in self.drawing.handles() if term.base in h.links or term.link in h.links]
        return (
            (sum(p[0] for p in places) / len(places), sum(p[1] for p in places) / len(places))
            if places
            else (0.0, 0.0)
        )

    # what the other tools draw

    def _draw(self, start: Point, end: Point) -> None:
        drawing, clicked = self.drawing, math.dist(start, end) < 1e-9
        first = self._from.links[-1] if self._from is not None else ""
        near = drawing.near(end, self.within) if not clicked else None
        last = near.links[-1] if near is not None else ""
        with drawing.action():
            if self.tool in ("leaf", "joint", "spring", "distance"):
                if clicked:
                    raise SceneError(f"{self.tool}: {TOOLS[self.tool]}.")
                a = drawing.link(first or self.start)
                b = drawing.link(last if last and last != a else self.end, a)
                if self.tool == "leaf":
                    drawing.add_leaf(a, b, start, end)
                elif self.tool == "joint":
                    drawing.add_joint(self.family, a, b, start, end)
                else:
                    ends = {"a": a, "b": b, "start": drawing.in_space(start), "end": drawing.in_space(end)}
                    drawing.add(
                        self.tool, **ends, **({"stiffness": "1 N/mm"} if self.tool == "spring" else {})
                    )
            elif self.tool == "pin":
                a = drawing.link(first or self.start)
                other = last if last and last != a else ""
                if clicked and self._from is not None and len(self._from.links) > 1:
                    raise SceneError("pin: two links have a pin here already.")
                b = drawing.link(other or self.end, a)
                drawing.add("pin", a=a, b=b, at=drawing.in_space(end))
            else:
                self._draw_on_link(first, start, end, clicked)

    def _draw_on_link(self, link: str, start: Point, end: Point, clicked: bool) -> None:
        """A slider, support, drive or load on one link."""
        drawing, tool = self.drawing, self.tool
        if not link or link == GROUND:
            chosen = self.end if self.end not in (NEW_LINK, GROUND) else self.start
            if chosen in (NEW_LINK, GROUND):
                raise SceneError(f"{tool}: press on a point of a link that moves; {TOOLS[tool]}.")
            link = chosen
        kind = {"drive": "actuate"}.get(tool, tool)
        at = drawing.in_space(start)
        if tool == "load":
            if clicked:
                raise SceneError(f"load: {TOOLS['load']}; 10 mm of arrow are {1e3 * LOAD_SCALE / 100:g} N.")
            drawing.add(kind, link=link, force=drawing.force(start, end), at=at)
        elif tool == "slider":
            if clicked:
                raise SceneError(f"slider: {TOOLS['slider']}.")
            drawing.add(kind, link=link, along=drawing.direction(start, end), at=at)
        elif clicked:
            value = {"value": "0 deg"} if kind == "actuate" else {}
            drawing.add(kind, link=link, about="xyz"[PLANES[drawing.plane]], **value)
        else:
            value = {"value": "0 mm"} if kind == "actuate" else {}
            drawing.add(kind, link=link, along=drawing.direction(start, end), at=at, **value)
