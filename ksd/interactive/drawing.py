"""A scene file that is drawn: its tables as they are now, actions that change them, undo and redo.

It knows no page. Every action is a word of the scene: a table that is added, a point that is moved, a key that is typed.
"""

from __future__ import annotations

import contextlib
import copy
import math
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ksd.checks import unused_name
from ksd.errors import SceneError
from ksd.files import write_file
from ksd.interactive.scene_text import python_text, rewritten
from ksd.scene.drive import GROUND
from ksd.scene.hinges import PLANES
from ksd.scene.scene import Scene
from ksd.scene.toml_file import read_tables, scene_from_tables
from ksd.scene.toml_schema import STATEMENTS
from ksd.scene.toml_table import in_unit_of, quantity
from ksd.units import N, mm

Point = tuple[float, float]
"""Coordinates in the plane [m]."""
POINT_KEYS = ("start", "end", "at")
"""Keys of statements whose value is a point that can be dragged."""
NEW_LINK = "a new link"
LOAD_SCALE = 0.1 * N / mm
"""Force per length of its arrow in the drawing."""
SIZED = {
    "load": (("force", "force", "N"), ("moment", "moment", "Nm")),
    "line_load": (
        ("force", "stiffness", "N/m"),
        ("to", "stiffness", "N/m"),
        ("moment", "moment per length", "Nm/m"),
        ("to_moment", "moment per length", "Nm/m"),
    ),
    "pressure": (("pressure", "stress", "kPa"),),
}
"""Keys of loads that grow with their size, with dimension and unit; a force per length has the units of a stiffness."""
FIRST_TABLES: dict[str, Any] = {
    "plane": "xy", "links": [],
    "material": {"steel": {"E": "200 GPa", "nu": 0.3, "density": "7800 kg/m^3", "yield_stress": "900 MPa"}},
}  # fmt: skip
"""What a drawing from nothing starts with."""
LIBRARY = {
    "cross_flexure": lambda L: {"length": L, "angle": "45 deg", "thickness": L / 100, "widths": [L / 5, L / 10]},
    "arc_hinge": lambda L: {"radius": L / math.sqrt(2), "angle": "270 deg", "thickness": L / 20, "width": L},
    "parallel_guide": lambda L: {"length": L, "spacing": L, "thickness": L / 100, "width": L / 4},
}  # fmt: skip
"""Joints of the library that can be placed, with their first dimensions for a length [m]."""


@dataclass(frozen=True)
class Handle:
    """A point of the drawing: statement, row and key, where it is, and the links it belongs to."""

    kind: str
    row: int
    key: str
    at: Point
    links: tuple[str, ...]

    @property
    def name(self) -> str:
        """Its name in pictures, "leaf/0/start"."""
        return f"{self.kind}/{self.row}/{self.key}"


class Drawing:
    """The drawing of `file`, from nothing where it is not there. changed: told after every change.

    tables: as of `tomllib`, lengths as texts with a unit where they are in the file. Raises SceneError for a file that
    cannot be read.
    """

    def __init__(self, file: Path, changed: Callable[[Drawing], None] | None = None) -> None:
        self.file, self.changed = file, changed
        self.saved_text = file.read_text(encoding="utf-8-sig") if file.exists() else ""
        self.tables: dict[str, Any] = (
            read_tables(file) if file.exists() else copy.deepcopy({"name": file.stem} | FIRST_TABLES)
        )
        self._undo: list[dict[str, Any]] = []
        self._redo: list[dict[str, Any]] = []
        self._before: dict[str, Any] | None = None
        self._draft: Scene | None = None
        self.selected: str = ""

    # text

    @property
    def plane(self) -> str:
        """The plane of the drawing: that of the scene, "xy" of one in space."""
        return str(self.tables.get("plane") or "xy") if self.tables.get("plane", "xy") in PLANES else "xy"

    @property
    def axes(self) -> tuple[int, int]:
        """Indices of the global axes to the right and up."""
        normal = PLANES[self.plane]
        first, second = (k for k in range(3) if k != normal)
        return first, second

    @property
    def text(self) -> str:
        """The text of the file with all changes; what has not changed is as it was written."""
        return rewritten(self.saved_text, self.tables)

    @property
    def python(self) -> str:
        """The same as a Python program; why there is none in a comment."""
        try:
            return python_text(self.tables)
        except (SceneError, KeyError, ValueError, TypeError) as reason:
            return f"# {reason}"

    def set_text(self, text: str) -> None:
        """Take the text of a scene file, as typed. Raises SceneError where it is no TOML."""
        try:
            tables = tomllib.loads(text)
        except tomllib.TOMLDecodeError as reason:
            raise SceneError(f"this text is not valid TOML: {reason}.") from None
        with self.action():
            self.tables = tables
        # comments and order of what was typed stay
        self.saved_text = text

    def save(self, file: Path | None = None) -> Path:
        """Write the file. Raises SceneError where that is not possible."""
        target, text = file or self.file, self.text
        write_file(target, text, what="scene file")
        self.file, self.saved_text = target, text
        return target

    @property
    def draft(self) -> Scene | None:
        """The scene as far as it is drawn; the last that could be read where there is a mistake."""
        with contextlib.suppress(SceneError):
            self._draft = scene_from_tables(self.tables, self.file, whole=False)[0].draft()
        return self._draft

    # actions

    def action(self) -> _Action:
        """Context of one action: undone as a whole, and given back where it fails."""
        return _Action(self)

    def begin(self) -> None:
        """Begin an action of many moves."""
        self._before = copy.deepcopy(self.tables)

    def end(self) -> None:
        """End it: one step of undo, if anything has changed."""
        before, self._before = self._before, None
        if before is not None and before != self.tables:
            self._undo.append(before)
            self._redo.clear()
            self.tell()

    def cancel(self) -> None:
        """Give back what was before it began."""
        if self._before is not None:
            self.tables, self._before = self._before, None
            self.tell()

    def tell(self) -> None:
        """Tell of a change."""
        if self.changed is not None:
            self.changed(self)

    def undo(self) -> None:
        """Take back the last action. Raises SceneError where there is none."""
        self._step(self._undo, self._redo, "undo")

    def redo(self) -> None:
        """Do again what was taken back. Raises SceneError where there is nothing."""
        self._step(self._redo, self._undo, "redo")

    def _step(self, source: list[dict[str, Any]], other: list[dict[str, Any]], what: str) -> None:
        if not source:
            raise SceneError(f"there is nothing to {what}.")
        other.append(self.tables)
        self.tables = source.pop()
        self.tell()

    # points

    def number(self, value: Any, dimension: str = "length") -> float:
        """A number [SI] as it stands in the file."""
        return quantity(value, dimension, "value")

    def point(self, value: Any) -> Point:
        """Coordinates in the plane [m] of a point of the file."""
        i, j = self.axes
        return self.number(value[i]), self.number(value[j])

    def in_space(self, at: Point, old: Any = None) -> list[Any]:
        """A point of the file at these coordinates, in the units of the one it replaces."""
        written = list(old) if old is not None else [0, 0, 0]
        for axis, value in zip(self.axes, at, strict=True):
            if old is None or self.number(written[axis]) != value:
                written[axis] = in_unit_of(written[axis], value, "mm")
                if written[axis] == "0 mm":
                    written[axis] = 0
        return written

    def rows(self) -> Iterator[tuple[str, int, dict[str, Any]]]:
        """Statement, row and table of everything that is stated."""
        for kind in STATEMENTS:
            rows = self.tables.get(kind, [])
            for row, table in enumerate(rows if isinstance(rows, list) else []):
                if isinstance(table, dict):
                    yield kind, row, table

    def handles(self) -> list[Handle]:
        """All points that can be dragged."""
        found = []
        for kind, row, table in self.rows():
            for key in POINT_KEYS:
                try:
                    at = self.point(table[key])
                except (KeyError, TypeError, IndexError, SceneError):
                    continue
                found.append(Handle(kind, row, key, at, _links_of(kind, table, key)))
        for placed in self._draft.joints if self._draft is not None else ():
            rows = [r for k, r, t in self.rows() if k == "join" and t.get("name") == placed.name]
            place, (i, j) = placed.place(placed.joint.pose_B), self.axes
            found += [
                Handle("join", r, "far end", (float(place[i]), float(place[j])), (placed.b,)) for r in rows
            ]
        return found

    def near(self, at: Point, within: float) -> Handle | None:
        """The handle nearest to a place, None where there is none within that distance; the latest of those in one place."""
        handles = [h for h in self.handles() if math.dist(h.at, at) <= within]
        return min(reversed(handles), key=lambda h: math.dist(h.at, at), default=None)

    def move(self, handle: Handle, to: Point, *, alone: bool = False) -> None:
        """Move a point, and all that were in the same place with it, unless `alone`."""
        for other in self.handles():
            together = other.name == handle.name or (not alone and math.dist(other.at, handle.at) < 1e-9)
            if together and other.key != "far end":
                table = self.tables[other.kind][other.row]
                table[other.key] = self.in_space(to, table[other.key])
                self._keep_arc(table)
        self.tell()

    def _keep_arc(self, table: dict[str, Any]) -> None:
        """Fit the radius of an arc to its ends, with its angle as it is."""
        curve = table.get("curve")
        if isinstance(curve, dict) and curve.get("kind") == "arc":
            chord = math.dist(*(self._in_si(table[k]) for k in ("start", "end")))
            radius = chord / (2 * abs(math.sin(0.5 * self.number(curve["angle"], "angle"))))
            curve["radius"] = in_unit_of(curve["radius"], radius, "mm")

    def _in_si(self, value: list[Any]) -> list[float]:
        return [self.number(v) for v in value]

    def bend(self, row: int, to: Point) -> None:
        """Make leaf `row` an arc whose middle is nearest to a place; straight where that is on its chord."""
        table = self.tables["leaf"][row]
        start, end = (np.array(self.point(table[k])) for k in ("start", "end"))
        chord = float(np.linalg.norm(end - start))
        side = self._second_axis(table, end - start)
        height = float((np.array(to) - 0.5 * (start + end)) @ side)
        # with the thickness direction to the left of the chord the middle of a positive arc lies to the right
        angle = -4 * math.atan2(2 * height, chord)
        if abs(angle) < math.radians(2):
            table.pop("curve", None)
        else:
            angle = math.radians(round(math.degrees(angle)))
            radius = chord / (2 * abs(math.sin(0.5 * angle)))
            old = table.get("curve", {})
            table["curve"] = {
                "kind": "arc", "radius": in_unit_of(old.get("radius"), radius, "mm"),
                "angle": in_unit_of(old.get("angle"), angle, "deg"),
            }  # fmt: skip
        self.tell()

    def _second_axis(self, table: dict[str, Any], along: np.ndarray) -> np.ndarray:
        """The thickness direction e2 (2,) of a leaf in the plane."""
        width = np.zeros(3)
        normal = PLANES[self.plane]
        given = str(table.get("width_axis", "xyz"[normal]))
        width[normal] = -1.0 if given.startswith("-") else 1.0
        e1 = np.zeros(3)
        e1[list(self.axes)] = along / max(float(np.linalg.norm(along)), 1e-12)
        e2: np.ndarray = np.cross(width, e1)[list(self.axes)]
        return e2

    # words that are added

    def link(self, chosen: str, avoid: str = "") -> str:
        """The name of a link that is chosen; a new one is added to the links."""
        links = self.tables.setdefault("links", [])
        if chosen != NEW_LINK:
            return chosen
        name = unused_name("link", {*links, GROUND, avoid})
        links.append(name)
        return name

    def add(self, kind: str, **words: Any) -> str:
        """Add a statement, with a name of its own where it has none; its name in pictures, "leaf/0"."""
        rows = self.tables.setdefault(kind, [])
        if "name" in STATEMENTS[kind] and "name" not in words:
            label = {"actuate": "drive", "join": "joint"}.get(kind, kind)
            words = {"name": unused_name(label, self._names(kind))} | words
        rows.append(words)
        self.selected = f"{kind}/{len(rows) - 1}"
        return self.selected

    def _names(self, kind: str) -> set[str]:
        groups = (("join", "leaf", "wire", "constrain"), ("actuate", "support"))
        shared = next((g for g in groups if kind in g), (kind,))
        return {str(t.get("name")) for k, _, t in self.rows() if k in shared}

    def add_leaf(self, a: str, b: str, start: Point, end: Point) -> str:
        """A straight leaf spring like the last one."""
        like: dict[str, Any] = next((t for k, _, t in reversed(list(self.rows())) if k == "leaf"), {})
        size = {k: like[k] for k in ("section", "thickness", "width", "material", "width_axis") if k in like}
        if not size:
            materials = self.tables.setdefault("material", copy.deepcopy(FIRST_TABLES["material"]))
            size = {"thickness": "0.5 mm", "width": "10 mm", "material": next(iter(materials), "steel")}
        size.setdefault("width_axis", "xyz"[PLANES[self.plane]])
        return self.add("leaf", a=a, b=b, start=self.in_space(start), end=self.in_space(end), **size)

    def add_joint(self, family: str, a: str, b: str, at: Point, toward: Point) -> str:
        """A joint of the library from interface A at a place to B, at its first dimensions for that length."""
        length = math.dist(at, toward)
        words = LIBRARY[family](length)

        def written(value: Any) -> Any:
            return [written(v) for v in value] if isinstance(value, list) else (
                value if isinstance(value, str) else in_unit_of(None, value, "mm"))  # fmt: skip

        materials = self.tables.setdefault("material", copy.deepcopy(FIRST_TABLES["material"]))
        joints = self.tables.setdefault("joint", {})
        table = {"family": family, "material": next(iter(materials))} | {
            k: written(v) for k, v in words.items()
        }
        label = next((n for n, t in joints.items() if t == table), None) or unused_name(family, set(joints))
        joints[label] = table
        direction = self.in_space((toward[0] - at[0], toward[1] - at[1]))
        along = [self.number(c) / length for c in direction]
        axis = "xyz"[PLANES[self.plane]]
        return self.add(
            "join",
            a=a,
            b=b,
            joint=label,
            at=self.in_space(at),
            axis=axis,
            toward=[round(c, 12) for c in along],
        )

    def direction(self, start: Point, end: Point) -> Any:
        """A direction of the file: "x" or "-y" near an axis, else three numbers."""
        along = np.zeros(3)
        along[list(self.axes)] = np.subtract(end, start)
        along /= max(float(np.linalg.norm(along)), 1e-12)
        k = int(np.argmax(abs(along)))
        return (
            f"{'-' if along[k] < 0 else ''}{'xyz'[k]}"
            if abs(along[k]) > 0.996
            else [round(float(c), 6) for c in along]
        )

    def force(self, start: Point, end: Point) -> list[Any]:
        """A force of the file from its arrow in the drawing."""
        value = [0.0, 0.0, 0.0]
        for axis, a, b in zip(self.axes, start, end, strict=True):
            value[axis] = LOAD_SCALE * (b - a)
        return [in_unit_of(None, v, "N") if v else 0 for v in value]

    # selected things

    def chosen(self) -> tuple[str, int, dict[str, Any]]:
        """Statement, row and table of what is selected. Raises SceneError where nothing is."""
        kind, _, row = self.selected.partition("/")
        rows = self.tables.get(kind, [])
        if not row or int(row) >= len(rows):
            raise SceneError("nothing is selected: click on a part first.")
        return kind, int(row), rows[int(row)]

    def delete(self) -> None:
        """Delete what is selected, and links that nothing mentions any more."""
        kind, row, _ = self.chosen()
        with self.action():
            del self.tables[kind][row]
            if not self.tables[kind]:
                del self.tables[kind]
            used = {
                v for _, _, t in self.rows() for k, v in t.items() if k in ("a", "b", "link", "relative_to")
            }
            used |= {t.get("link") for _, _, own in self.rows() for t in own.get("terms", ())}
            self.tables["links"] = [n for n in self.tables.get("links", ()) if n in used]
            self.selected = ""

    def copy(self, by: Point) -> None:
        """Copy what is selected, shifted."""
        self._repeat(lambda p: (p[0] + by[0], p[1] + by[1]), 1)

    def mirror(self, about: float = 0.0) -> None:
        """A mirror image of what is selected, about the vertical line there [m]."""
        self._repeat(lambda p: (2 * about - p[0], p[1]), -1)

    def _repeat(self, place: Callable[[Point], Point], hand: int) -> None:
        kind, _, table = self.chosen()
        made = copy.deepcopy({k: v for k, v in table.items() if k != "name"})
        for key in POINT_KEYS:
            if key in made:
                made[key] = self.in_space(place(self.point(made[key])), made[key])
        i = self.axes[0]
        for key, dimension in (("toward", ""), ("along", ""), ("force", "force")):
            if hand < 0 and isinstance(made.get(key), list):
                value = made[key][i]
                made[key][i] = (
                    -value if not dimension else in_unit_of(value, -self.number(value, dimension), "N")
                )
            elif hand < 0 and isinstance(made.get(key), str) and made[key].endswith("xyz"[i]):
                made[key] = made[key][1:] if made[key].startswith("-") else f"-{made[key]}"
        if hand < 0 and isinstance(made.get("curve"), dict) and "angle" in made["curve"]:
            angle = made["curve"]["angle"]
            made["curve"]["angle"] = in_unit_of(angle, -self.number(angle, "angle"), "deg")
        with self.action():
            self.add(kind, **made)

    def set_key(self, key: str, typed: str) -> None:
        """Set a key of what is selected from typed text, as in a scene file; quotes may be left out. Empty removes it.

        Raises SceneError for a key that the statement does not have."""
        kind, _, table = self.chosen()
        if (
            key not in table
            and key not in STATEMENTS[kind]
            and key not in ("thickness", "width", "curve", "profile", "value")
        ):
            raise SceneError(f"[[{kind}]] has no key '{key}'.")
        try:
            value = tomllib.loads(f"v = {typed}")["v"]
        except tomllib.TOMLDecodeError:
            value = typed.strip()
        with self.action():
            if value == "":
                table.pop(key, None)
            else:
                table[key] = value

    def set_drive(self, name: str, value: float, unit: str) -> None:
        """Write the value [SI] of a drive, as it was moved by hand; nothing is solved again."""
        for kind, _, table in self.rows():
            if kind == "actuate" and (table.get("name") or table.get("link")) == name:
                before = copy.deepcopy(self.tables)
                written = in_unit_of(table.get("value"), value, unit)
                if table.get("value") != written:
                    table["value"] = written
                    self._undo.append(before)
                    self._redo.clear()

    def set_load(self, name: str, size: float) -> None:
        """Write the size [N, Nm, N/m or Pa] of a load along its direction, see `ksd.interactive.sliders.load_size`."""
        for kind, _, table in self.rows():
            own = table.get("name") or f"{table.get('leaf', table.get('link'))}.{kind}"
            sized = [(key, *unit) for key, *unit in SIZED.get(kind, ()) if key in table]
            if not sized or own != name:
                continue
            values = {
                key: [self.number(v, dimension) for v in _listed(table[key])] for key, dimension, _ in sized
            }
            first = [math.hypot(*v) for v in values.values()]
            known = first[0] or first[-1]
            if kind == "line_load":
                lengths = {key: math.hypot(*v) for key, v in values.items()}
                pairs = (("force", "to"), ("moment", "to_moment"))
                force, moment = (max(lengths.get(key, 0.0) for key in pair) for pair in pairs)
                known = force or moment
            if kind == "pressure":
                (known,) = values["pressure"]
            if not known:
                continue
            with self.action():
                for key, _, unit in sized:
                    written = [
                        in_unit_of(old, v * size / known, unit) if v else old
                        for old, v in zip(_listed(table[key]), values[key], strict=True)
                    ]
                    table[key] = written if isinstance(table[key], list) else written[0]


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


class _Action:
    """Context of one action of a drawing."""

    def __init__(self, drawing: Drawing) -> None:
        self.drawing = drawing

    def __enter__(self) -> None:
        self.drawing.begin()

    def __exit__(self, kind: Any, *_: Any) -> None:
        if kind is None:
            self.drawing.end()
        else:
            self.drawing.cancel()


def _links_of(kind: str, table: dict[str, Any], key: str) -> tuple[str, ...]:
    """Links to which a point of a statement belongs, the last the one that is meant where a new part is attached."""
    a, b, link = (str(table.get(k, "")) for k in ("a", "b", "link"))
    if kind in ("leaf", "wire", "spring", "distance"):
        return (a,) if key == "start" else (b,)
    if kind in ("join", "constrain"):
        return (a,)
    if link:
        return (link,)
    return (a, b)
