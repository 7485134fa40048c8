"""Centre lines of a drawing (DXF) as leaf springs of a scene file.

On layer `leaf` lines, arcs, segments of polylines and splines are leaf springs, edge-on in the plane xy; closed outlines on
`link` are links, named by the text inside (also "ground"), and what ends inside one is clamped to it; circles on `pin` are
pins. Ends that meet outside of outlines are joined by a link without size; an end that meets nothing is clamped to ground.
What a drawing does not show (thickness, width, material) comes from the extended data that `ksd.export.dxf` writes, else
from the words of the call.
"""

from __future__ import annotations

import math
import os
from collections import defaultdict
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ksd.checks import clear_argument_errors, show, unused_name
from ksd.errors import SceneError
from ksd.extras import cad_package
from ksd.files import named_file, read_file
from ksd.importing.dxf_entities import (
    FLAT,
    Stroke,
    entities,
    handle_of,
    reach_of,
    stroke_of,
    to_world,
    words_of,
)
from ksd.importing.scene_text import STEEL, Parts, scene_text
from ksd.scene.toml_table import quantity
from ksd.units import DIMENSIONS

Array = NDArray[np.float64]
UNITS = {1: "in", 2: "ft", 4: "mm", 5: "cm", 6: "m", 13: "um"}
"""Units by $INSUNITS of the header."""
LAYERS = ("leaf", "link", "pin")
OWN_LAYERS = {"outline", "point", "sheet", "clamp", "hole", "text"}
"""Layers of the drawings that ksd writes which hold nothing to be read."""
MAX_LEAVES = 2000
"""Limit of the number of leaf springs, and of closed outlines."""
MAX_LINES = {"leaf": MAX_LEAVES, "link": 20_000, "pin": MAX_LEAVES}
"""Limits of the number of entities on layers that are read."""
MAX_LISTED = 8
"""Number of handles that a comment lists; it says how many there are."""
MAX_ENTITIES = 120_000
"""Limit of the number of entities, those of blocks at every place of them."""
MAX_SIZE = 1e6
"""Largest coordinate [m]."""
CURVE_POINTS = (9, 17, 33, 65)
"""Numbers of points by which a spline is given, until two agree to the distance `join`."""


@dataclass
class _Leaf:
    """A leaf spring: ends (2, 3), links at both, angle [rad] of an arc or 0, points of a free curve, words."""

    name: str
    ends: Array
    turn: float
    curve: dict[str, Any] | None
    words: dict[str, Any]
    links: list[str] = field(default_factory=lambda: ["", ""])


@clear_argument_errors
def read_dxf(
    path: str | os.PathLike[str],
    *,
    name: str | None = None,
    layers: Mapping[str, str] | None = None,
    unit: str | None = None,
    join: str | float = "0.05 mm",
    thickness: str | float = "0.5 mm",
    width: str | float = "10 mm",
) -> str:
    """The text of a scene file, with comments, from the centre lines of a drawing (.dxf).

    name: of the mechanism, that of the file when None; layers: names in the drawing of the layers "leaf", "link" and "pin"
    where they are others; unit: of the drawing ("mm", "in" ...), where its header has none; join: distance within which ends
    meet; thickness, width: of leaf springs of which the drawing does not tell them; all as text with a unit or in m. Needs
    ezdxf. Raises SceneError.

    Example: `text = ksd.importing.read_dxf("pivot.dxf", layers={"leaf": "FLEXURE"}, thickness="0.3 mm")`.
    """
    file = named_file(path, "drawing")
    sizes = {
        key: quantity(value, "length", key)
        for key, value in (("join", join), ("thickness", thickness), ("width", width))
    }
    wrong = next((key for key, value in sizes.items() if not value > 0.0), None)
    if wrong:
        raise SceneError(f"read_dxf: {wrong} = {sizes[wrong]:g} m must be positive.")
    unknown = next((key for key in layers or {} if key not in LAYERS), None)
    if unknown:
        raise SceneError(f"layers: {show(unknown)} is no layer that is read; these are {', '.join(LAYERS)}.")
    reader = _Reader(_document(file), file, {k: k for k in LAYERS} | dict(layers or {}), unit, sizes["join"])
    return reader.scene(name or file.stem, thickness, width)


def _document(file: Path) -> Any:
    """The drawing of a file. Raises SceneError."""
    ezdxf = cad_package("ezdxf", "DXF")
    content = read_file(file, what="drawing")
    if content[:4] == b"AC10":
        raise SceneError(f"{file.name} is an AutoCAD drawing (DWG); save it as DXF.")
    try:
        document = ezdxf.readfile(file)
    except Exception as reason:
        # ezdxf raises whatever a damaged file makes it raise
        raise SceneError(f"{file.name} cannot be read as DXF: {_said(reason, file)}.") from None
    if b"$INSUNITS" not in content:
        # without one ezdxf takes its own
        document.header["$INSUNITS"] = 0
    return document


def _said(reason: Exception, file: Path) -> str:
    """What another package says of a damaged file, in one line."""
    text = " ".join(str(reason).replace(str(file), file.name).split())
    return text[:150].rstrip(".") or "it is damaged"


class _Reader:
    """What a drawing holds, in its unit."""

    def __init__(
        self, document: Any, file: Path, layers: Mapping[str, str], unit: str | None, join: float
    ) -> None:
        self.file, self.layers = file, layers
        self.unit = unit or UNITS.get(int(document.header.get("$INSUNITS", 0)), "")
        known = DIMENSIONS["length"]
        if self.unit not in known:
            said = f"unit '{unit}'" if unit else f"$INSUNITS = {document.header.get('$INSUNITS', 0)}"
            raise SceneError(
                f"{file.name} does not say in which known unit it is drawn ({said}); say it, such as --unit mm or unit='mm'."
            )
        self.join = join / known[self.unit]
        self.unread: dict[tuple[str, str], list[str]] = defaultdict(list)
        self.notes: list[str] = []
        self.strokes: dict[str, list[Stroke]] = {key: [] for key in LAYERS}
        self.counts = dict.fromkeys(LAYERS, 0)
        self.labels: list[tuple[str, Array]] = []
        self.circles: list[tuple[str, Array, float, dict[str, Any]]] = []
        role = {given.casefold(): key for key, given in layers.items()}
        entity: Any = None
        try:
            for number, (entity, layer) in enumerate(entities(document.modelspace())):
                if number >= MAX_ENTITIES:
                    raise SceneError(
                        f"{file.name} has more than {MAX_ENTITIES:,} entities, those of blocks included; save the centre "
                        "lines and links alone."
                    )
                own = role.get(layer.casefold())
                if own is None:
                    if layer not in OWN_LAYERS:
                        self.leave(entity, layer)
                    continue
                self.read(entity, layer, own)
        except SceneError:
            raise
        except Exception as reason:
            # ezdxf raises whatever a damaged entity makes it raise
            at = f" at or after {entity.dxftype()} {handle_of(entity)}" if entity is not None else ""
            raise SceneError(f"{file.name} cannot be read{at}: {_said(reason, file)}.") from None
        if not self.strokes["leaf"]:
            there = sorted({layer.dxf.name for layer in document.layers} - {"Defpoints"})
            raise SceneError(
                f"{file.name} has no centre lines on layer '{layers['leaf']}'; it has the layers {', '.join(there)[:300]}: "
                "name the one with the centre lines, such as --layers leaf=CENTRE."
            )

    def leave(self, entity: Any, layer: str, why: str = "") -> None:
        """Note an entity that is not read."""
        self.unread[layer, entity.dxftype() + (f", {why}" if why else "")].append(handle_of(entity))

    def read(self, entity: Any, layer: str, role: str) -> None:
        """Add an entity on a layer that is read."""
        kind, words = entity.dxftype(), words_of(entity)
        self.counts[role] += 1
        if self.counts[role] > MAX_LINES[role]:
            what = {"leaf": "leaf springs", "link": "outlines of links", "pin": "pins"}[role]
            raise SceneError(
                f"{self.file.name} has more than {MAX_LINES[role]} lines on layer '{layer}', which are no {what}; put "
                f"the {'centre lines' if role == 'leaf' else what} alone on a layer."
            )
        if role == "link" and kind in ("TEXT", "MTEXT"):
            text = entity.plain_text() if kind == "TEXT" else " ".join(entity.plain_text().split())
            self.labels.append((text.strip(), to_world(entity, [entity.dxf.insert])[0]))
            return
        if kind == "CIRCLE" and role == "pin":
            centre = to_world(entity, [entity.dxf.center])[0]
            self.circles.append((handle_of(entity), centre, float(entity.dxf.radius), words))
            return
        stroke = stroke_of(entity, self.join) if role != "pin" else None
        if stroke is None:
            return self.leave(entity, layer)
        reach = reach_of(stroke)
        if not reach * DIMENSIONS["length"][self.unit] <= MAX_SIZE:
            raise SceneError(
                f"{self.file.name}: {stroke.name} reaches {reach:g} {self.unit}, which no mechanism does; check the unit, "
                "and that the drawing lies near its origin."
            )
        stroke.words = words
        height = np.ptp(stroke.points[:, 2])
        if height > FLAT * np.ptp(stroke.points, axis=0).max() and "leaf" not in words:
            return self.leave(entity, layer, "not parallel to the plane xy")
        self.strokes[role].append(stroke)

    def leaves(self) -> list[_Leaf]:
        """The leaf springs on the layer of centre lines."""
        found: list[_Leaf] = []
        names: set[str] = set()

        def add(preferred: str, *values: Any) -> None:
            if len(found) >= MAX_LEAVES:
                raise SceneError(
                    f"{self.file.name} has more than {MAX_LEAVES} pieces of lines on layer '{self.layers['leaf']}'; draw "
                    "arcs and splines in place of chords."
                )
            name = unused_name(preferred, names) if preferred else _numbered("leaf", names)
            names.add(name)
            found.append(_Leaf(name, *values))

        for stroke in self.strokes["leaf"]:
            own = stroke.words.get("leaf", {})
            ends = stroke.points[[0, -1]]
            if own and (len(stroke.points) == 2 or "curve" in own):
                # a free curve is drawn as a polyline, and told by its words
                flip = bool(stroke.words.get("reversed"))
                turn = float(stroke.turns[0]) if len(stroke.points) == 2 else 0.0
                curve = None if turn else own.get("curve")
                add(own["name"], ends[::-1] if flip else ends, -turn if flip else turn, curve, stroke.words)
            elif stroke.free:
                if stroke.closed:
                    self.notes.append(
                        f"{stroke.name} is a closed curve, which is no leaf spring; it is left out."
                    )
                    continue
                curve = self.spline(stroke)
                add("", ends, 0.0, curve, stroke.words)
            else:
                for a, b, turn in zip(
                    stroke.points[:-1], stroke.points[1:], stroke.turns.tolist(), strict=True
                ):
                    if np.linalg.norm(b - a) > self.join:
                        add("", np.array([a, b]), turn, None, stroke.words)
                    else:
                        self.notes.append(
                            f"A piece of {stroke.name} is shorter than that distance and is left out."
                        )
        return found

    def spline(self, stroke: Stroke) -> dict[str, Any]:
        """The table of a free curve through few points of a stroke that has many."""
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(stroke.points, axis=0), axis=1))])
        tree = {
            key: f"{math.degrees(a):.15g} deg"
            for key, a in zip(("start", "end"), stroke.tangents, strict=True)
        }
        off = math.inf
        for number in CURVE_POINTS:
            at = np.searchsorted(along, np.linspace(0.0, along[-1], number)).clip(0, len(along) - 1)
            at = np.unique(at)
            points = stroke.points[at, :2]
            chords = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
            ends = [(1, np.array([math.cos(a), math.sin(a)])) for a in stroke.tangents]
            through = CubicSpline(chords, points, bc_type=(ends[0], ends[1]))
            near = through(np.linspace(0.0, chords[-1], 40 * number))
            off = float(cKDTree(near).query(stroke.points[:, :2])[0].max())
            if off < self.join:
                break
        self.notes.append(f"{stroke.name} is a free curve through {len(at)} of its points.")
        return {"kind": "spline", "points": [[self.length(v) for v in p] for p in points], **tree}

    def outlines(self) -> _Outlines:
        """Name and corners (k, 2) of every closed outline on the layer of links."""
        rings: list[tuple[str, Array]] = []
        loose: list[Stroke] = []
        for stroke in self.strokes["link"]:
            if stroke.closed or np.linalg.norm(stroke.points[0] - stroke.points[-1]) <= self.join:
                rings.append((str(stroke.words.get("link", "")), _flattened(stroke)))
            else:
                loose.append(stroke)
        rings += self.chained(loose)
        if len(rings) > MAX_LEAVES:
            raise SceneError(
                f"{self.file.name} has {len(rings)} closed outlines on layer '{self.layers['link']}', more than the "
                f"{MAX_LEAVES} that are read; put those of the links alone on a layer."
            )
        unnamed, written = _Outlines((str(k), ring) for k, (_, ring) in enumerate(rings)), dict[str, str]()
        for text, place in self.labels:
            for number, _ in unnamed.around(place[:2], 0.0) if text else ():
                written.setdefault(number, text)
        names: set[str] = set()
        found = _Outlines()
        for k, (name, ring) in enumerate(rings):
            own = name or written.get(str(k), "")
            own = own if own == "ground" else unused_name(own, names) if own else _numbered("link", names)
            names.add(own)
            found.append((own, ring))
        return found

    def chained(self, loose: list[Stroke]) -> list[tuple[str, Array]]:
        """Closed outlines made of strokes whose ends meet."""
        if not loose:
            return []
        ends = np.array([s.points[e, :2] for s in loose for e in (0, -1)])
        meets = _meeting(ends, self.join)
        at = defaultdict(list)
        for k, group in enumerate(meets.tolist()):
            at[group].append(k)
        rings, done, left = list[tuple[str, Array]](), set[int](), list[str]()
        for first in range(len(loose)):
            chain, end = [], 2 * first
            while end // 2 not in done:
                done.add(end // 2)
                line = _flattened(loose[end // 2])
                chain.append(line if end % 2 == 0 else line[::-1])
                others = [k for k in at[int(meets[end ^ 1])] if k // 2 not in done]
                if len(others) != 1:
                    break
                end = others[0]
            if not chain:
                continue
            ring = np.concatenate(chain)
            if np.linalg.norm(ring[0] - ring[-1]) <= self.join and len(ring) > 3:
                rings.append(("", ring))
            else:
                left.append(loose[first].name)
        if left:
            self.notes.append(
                f"What is no closed outline on the layer of links is left out: {_listed(left)}."
            )
        return rings

    def clamp(self, leaves: list[_Leaf], outlines: _Outlines) -> list[str]:
        """Find the links of all ends; returns the names of all links but ground."""
        ends = np.array([leaf.ends[e, :2] for leaf in leaves for e in (0, 1)])
        group = _meeting(ends, self.join)
        link_of: dict[int, str] = {}
        names = dict.fromkeys(name for name, _ in outlines)
        for k, leaf in ((k, leaves[k // 2]) for k in range(len(ends))):
            own = leaf.words.get("leaf", {}).get("ab"[k % 2])
            inside = [(abs(_area(ring)), name) for name, ring in outlines.around(ends[k], self.join)]
            if own or inside:
                link_of[k] = own or min(inside)[1]
                names.setdefault(link_of[k])
            if len({name for _, name in inside}) > 1 and not own:
                self.notes.append(
                    f"An end of '{leaf.name}' lies in several outlines; it is clamped to '{link_of[k]}', the smallest."
                )
        members = defaultdict(list)
        for k, g in enumerate(group.tolist()):
            members[g].append(k)
        for same in members.values():
            named = next((link_of[k] for k in same if k in link_of), None)
            if named is None and len(same) == 1:
                leaf = leaves[same[0] // 2]
                self.notes.append(
                    f"The {('start', 'end')[same[0] % 2]} of '{leaf.name}' meets nothing; it is clamped to ground."
                )
                named = "ground"
            if named is None:
                named = _numbered("node", names)
                names.setdefault(named)
            for k in same:
                leaves[k // 2].links[k % 2] = link_of.get(k, named)
        for leaf in leaves:
            if leaf.links[0] == leaf.links[1]:
                self.notes.append(f"Both ends of '{leaf.name}' are on '{leaf.links[0]}'.")
        used = {link for leaf in leaves for link in leaf.links}
        return [name for name in names if name != "ground" and (name in used or name in dict(outlines))]

    def pins(self, leaves: list[_Leaf], outlines: _Outlines, links: list[str]) -> list[dict[str, Any]]:
        """Tables of the pins: each joins the links whose outlines hold its middle, and those of the leaf springs that end in
        it."""
        found, idle = [], list[str]()
        ends = np.array([leaf.ends[e, :2] for leaf in leaves for e in (0, 1)])
        for handle, centre, radius, words in self.circles:
            near = [name for name, _ in outlines.around(centre[:2], self.join)]
            ending = np.flatnonzero(np.linalg.norm(ends - centre[:2], axis=1) <= radius)
            near += [leaves[k // 2].links[k % 2] for k in ending.tolist()]
            both = [words["a"], words["b"]] if "a" in words else list(dict.fromkeys(near))
            if len(both) == 1 and both[0] != "ground":
                both = ["ground", *both]
            if len(both) < 2:
                idle.append(f"CIRCLE {handle}")
            for other in both[1:]:
                name = {"name": words["name"]} if "name" in words else {}
                found.append(name | {"a": both[0], "b": other, "at": self.point(centre), "axis": "z"})
                links += [link for link in (both[0], other) if link not in (*links, "ground")]
        if idle:
            self.notes.append(f"What joins no two links is no pin, and left out: {_listed(idle)}.")
        return found

    def length(self, value: float) -> Any:
        """A length as a scene file has it."""
        return f"{float(value):.15g} {self.unit}" if value else 0

    def point(self, place: Array) -> list[Any]:
        """A position as a scene file has it."""
        return [self.length(v) for v in place.tolist()]

    def scene(self, name: str, thickness: Any, width: Any) -> str:
        """The text of the scene file."""
        leaves, outlines = self.leaves(), self.outlines()
        if not leaves:
            raise SceneError(f"{self.file.name} has no centre line longer than {self.join:g} {self.unit}.")
        links = self.clamp(leaves, outlines)
        pins = self.pins(leaves, outlines, links)
        parts, assumed = Parts(), False
        tables = []
        for leaf in leaves:
            own = dict(leaf.words.get("leaf", {}))
            table: dict[str, Any] = {"name": leaf.name, "a": leaf.links[0], "b": leaf.links[1]}
            table |= {"start": self.point(leaf.ends[0]), "end": self.point(leaf.ends[1])}
            if own:
                for kind in ("material", "section"):
                    own[kind] = parts.name_of(kind, own[kind], leaf.words[kind][own[kind]])
                table |= {k: v for k, v in own.items() if k not in (*table, "curve")}
            else:
                assumed = True
                table |= {"width_axis": "z", "thickness": thickness, "width": width}
                table["material"] = parts.name_of("material", "steel", STEEL)
            if leaf.turn:
                chord = float(np.linalg.norm(leaf.ends[1] - leaf.ends[0]))
                # towards the thickness axis e2 = e3 x e1 for an eye on the side of e3
                side = -1.0 if own and own["width_axis"][2] < 0.0 else 1.0
                radius = 0.5 * chord / abs(math.sin(0.5 * leaf.turn))
                angle = f"{side * math.degrees(leaf.turn):.15g} deg"
                table["curve"] = {"kind": "arc", "radius": self.length(radius), "angle": angle}
            elif leaf.curve:
                table["curve"] = leaf.curve
            tables.append(table)
        across = [leaf.words["leaf"]["width_axis"] for leaf in leaves if "leaf" in leaf.words]
        heights = np.concatenate([leaf.ends[:, 2] for leaf in leaves])
        flat = np.ptp(heights) <= self.join and all(abs(abs(axis[2]) - 1.0) < 1e-6 for axis in across)
        tree: dict[str, Any] = {"name": name} | ({"plane": "xy"} if flat else {}) | {"links": links}
        tree |= {kind: made for kind, made in parts.tables.items() if made} | {"leaf": tables}
        tree |= {"pin": pins} if pins else {}
        before = {}
        if assumed:
            before["[material.steel]"] = [
                "Not in the drawing, and assumed: the material here, thickness and width of the leaf springs."
            ]
        return scene_text(self.file, tree, self.head(leaves, links, pins), before)

    def head(self, leaves: list[_Leaf], links: list[str], pins: list[dict[str, Any]]) -> list[str]:
        """Comments at the top of the scene file."""
        layer = self.layers
        lines = [
            f"Read from {self.file.name}, drawn in {self.unit}. Leaf springs: {len(leaves)} (layer '{layer['leaf']}'), "
            f"links: {len(links)} ('{layer['link']}', and where ends meet), pins: {len(pins)} ('{layer['pin']}').",
            f"Ends within {self.join:.6g} {self.unit} of each other, or of an outline, are joined.",
            *self.notes,
        ]
        for (where, kind), handles in sorted(self.unread.items()):
            lines.append(f"Not read, layer '{where}': {len(handles)} x {kind} (handles {_listed(handles)})")
        body = next((link for link in links if "/" not in link), links[0] if links else "link")
        return [
            *lines, "", "Nothing is driven yet; for example:", "", "[[actuate]]", f'link = "{body}"', 'about = "z"',
            'value = "5 deg"', "",
        ]  # fmt: skip


def _flattened(stroke: Stroke) -> Array:
    """Points (k, 2) along a stroke, arcs as chords of 3 degrees."""
    found = [stroke.points[:1, :2]]
    for a, b, turn in zip(stroke.points[:-1, :2], stroke.points[1:, :2], stroke.turns.tolist(), strict=True):
        if turn:
            chord = b - a
            centre = 0.5 * (a + b) + 0.5 * np.array([-chord[1], chord[0]]) / math.tan(0.5 * turn)
            angles = np.linspace(0.0, turn, max(2, math.ceil(abs(turn) / math.radians(3.0))) + 1)[1:-1]
            x, y = a - centre
            c, s = np.cos(angles), np.sin(angles)
            found.append(centre + np.stack([c * x - s * y, s * x + c * y], axis=1))
        found.append(b[None])
    return np.concatenate(found)


def _numbered(word: str, names: Collection[str]) -> str:
    """The first of "word 1", "word 2" ... that is not among the names."""
    return next(name for k in count(1) if (name := f"{word} {k}") not in names)


def _listed(names: list[str]) -> str:
    """The first of many names, and how many more there are."""
    more = f" and {len(names) - MAX_LISTED} more" if len(names) > MAX_LISTED else ""
    return ", ".join(names[:MAX_LISTED]) + more


def _meeting(points: Array, distance: float) -> NDArray[np.int64]:
    """Number (k,) of the group of each point (k, 2): those within a distance of one another, also over others."""
    places, at = np.unique(points, axis=0, return_inverse=True)
    pairs = cKDTree(places).query_pairs(distance, output_type="ndarray")
    near = coo_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(len(places), len(places)))
    group: NDArray[np.int64] = connected_components(near, directed=False)[1][at.ravel()]
    return group


def _area(ring: Array) -> float:
    """Area of a closed ring (k, 2), positive counterclockwise."""
    x, y = ring.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


class _Outlines(list[tuple[str, Array]]):
    """Names and corners (k, 2) of closed outlines."""

    @cached_property
    def boxes(self) -> Array:
        """Lowest and highest coordinates (outlines, 2, 2); the list does not change after."""
        return np.array([(ring.min(axis=0), ring.max(axis=0)) for _, ring in self]).reshape(-1, 2, 2)

    def around(self, point: Array, distance: float) -> list[tuple[str, Array]]:
        """The outlines that hold a point (2,), or are within a distance of it."""
        low, high = self.boxes[:, 0] - distance, self.boxes[:, 1] + distance
        near = np.flatnonzero(((low <= point) & (point <= high)).all(axis=1))
        return [self[k] for k in near.tolist() if _holds(self[k][1], point, distance)]


def _holds(ring: Array, point: Array, distance: float) -> bool:
    """Whether a point (2,) is inside a closed ring (k, 2) or within a distance of it."""
    a, b = ring, np.roll(ring, -1, axis=0)
    edge, to = b - a, point - a
    along = np.clip((to * edge).sum(axis=1) / np.maximum((edge * edge).sum(axis=1), 1e-300), 0.0, 1.0)
    if np.linalg.norm(to - along[:, None] * edge, axis=1).min() <= distance:
        return True
    crosses = (a[:, 1] > point[1]) != (b[:, 1] > point[1])
    rise = np.where(crosses, edge[:, 1], 1.0)
    return bool((crosses & (point[0] < a[:, 0] + (point[1] - a[:, 1]) / rise * edge[:, 0])).sum() % 2)
