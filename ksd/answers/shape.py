"""Geometry of a configuration, for pictures: leaf springs, rigid blocks, drives, loads and what else a scene has.

Global axes, SI units.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull

from ksd.answers.centrelines import DEFAULT_STATIONS, centrelines, leaf_members, scene_leaves, solid_line
from ksd.answers.derived import cached_per_model
from ksd.answers.leaf_groups import LeafGroup, chain_groups, leaf_groups
from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.scene.drive import DriveTerm
from ksd.scene.effects import Spring
from ksd.scene.line_load import SIDES, Pressure
from ksd.scene.scene import Scene
from ksd.scene.sensor import Damper, Sensor
from ksd.scene.shapes import ContactShape
from ksd.section.closed_forms import round_ratio
from ksd.section.section import thickness_and_width

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LeafShape:
    """Centreline of one leaf at k stations, undeformed and deformed.

    s (k,): distance from its start along the undeformed leaf [m]. rest, place (k, 3): undeformed and deformed positions [m],
    global. rest_axes, axes (k, 3, 3): section axes e1, e2 (thickness), e3 (width) as columns, global. width, thickness (k,)
    [m]: of the section; of a section without these sizes, from its second moments. is_round: circles or tubes, of which
    both are the diameter and e2, e3 any directions.
    """

    name: str
    s: Array
    rest: Array
    place: Array
    rest_axes: Array
    axes: Array
    width: Array
    thickness: Array
    is_round: bool = False


OUTLINE_POINTS = 49
"""Points of the outline of a disc."""


@dataclass(frozen=True)
class BlockShape:
    """Points of a rigid block (link, ground, or block inside a joint): clamps of leaf springs, points of action of drives,
    loads and springs, positions of masses, and ends of distances.

    rest, place (k, 3): undeformed and deformed positions [m], global; owner (k,): name of what each point belongs to. leaf,
    station (k,): number of the leaf that ends there, -1 where none does, and its station there (0 or -1). rotation (3, 3),
    position (3,) [m]: of the global frame when it is moved with the block: what is at x at rest comes to position +
    rotation @ x.
    """

    name: str
    rest: Array
    place: Array
    rotation: Array
    position: Array
    owner: tuple[str, ...]
    leaf: NDArray[np.int64]
    station: NDArray[np.int64]


@dataclass(frozen=True)
class DrivenPoint:
    """A driven point of kind "translation" or "rotation": its undeformed and deformed position (3,) [m], direction (3,)."""

    name: str
    kind: str
    rest: Array
    place: Array
    direction: Array


@dataclass(frozen=True)
class HingeShape:
    """A "pin", "slider", "ball" or "cylindrical" hinge: its undeformed and deformed position (3,) [m] on its second
    link, and its deformed axis (3,)."""

    name: str
    kind: str
    rest: Array
    place: Array
    axis: Array


@dataclass(frozen=True)
class LoadShape:
    """A load of kind "force" [N], "moment" [Nm] or "mass" [kg]: its point of action (3,) [m] and value (3,), of a mass
    (1,)."""

    name: str
    kind: str
    place: Array
    value: Array


@dataclass(frozen=True)
class LineLoadShape:
    """A load of kind "force" or "moment" along a leaf: points (k, 3) [m] on its centreline, the force [N/m] or moment [Nm/m]
    per length there (k, 3), and its value as text."""

    name: str
    place: Array
    value: Array
    text: str
    kind: str = "force"


@dataclass(frozen=True)
class SpringShape:
    """A coil spring with deformed ends (2, 3) [m], or a torsion spring with one point (1, 3)."""

    name: str
    ends: Array


@dataclass(frozen=True)
class DistanceShape:
    """A distance that the scene defines: its deformed ends (2, 3) [m] and the direction (3,) in which it is measured."""

    name: str
    ends: Array
    direction: Array


@dataclass(frozen=True)
class SensorShape:
    """A sensor, or a damper (`damps`): deformed place (3,) [m], and the direction (3,) along which it acts, or about which
    where it `turns`."""

    name: str
    place: Array
    direction: Array
    turns: bool
    damps: bool


@dataclass(frozen=True)
class CableShape:
    """A cable: its deformed points (n, 3) [m] in order."""

    name: str
    points: Array


@dataclass(frozen=True)
class SurfaceShape:
    """A surface that may touch: its deformed outline (n, 3) [m], closed but for a wall."""

    name: str
    outline: Array


@dataclass(frozen=True)
class StopShape:
    """A limit of an end stop: where the point meets it (3,) [m], and the direction (3,) in which the stop pushes."""

    name: str
    place: Array
    direction: Array


@dataclass(frozen=True)
class Shape:
    """Everything that is drawn of a configuration; leaf springs and blocks in the order of the model."""

    leaves: tuple[LeafShape, ...]
    blocks: tuple[BlockShape, ...]
    driven: tuple[DrivenPoint, ...]
    hinges: tuple[HingeShape, ...] = ()
    loads: tuple[LoadShape, ...] = ()
    springs: tuple[SpringShape, ...] = ()
    distances: tuple[DistanceShape, ...] = ()
    sensors: tuple[SensorShape, ...] = ()
    cables: tuple[CableShape, ...] = ()
    stops: tuple[StopShape, ...] = ()
    surfaces: tuple[SurfaceShape, ...] = ()
    line_loads: tuple[LineLoadShape, ...] = ()


class _LeafAtRest(NamedTuple):
    """What a leaf is at its stations in every configuration: its members, those of their stations that count (the common
    one of two members does once), and fields of its `LeafShape`."""

    members: list[int]
    stations: list[slice]
    fixed: dict[str, Any]


class _Stations(NamedTuple):
    """Members to be drawn together, each a group, positions in it and number of stations, and all leaves at rest."""

    together: list[tuple[LeafGroup, NDArray[np.int64], int]]
    leaves: list[_LeafAtRest]


@cached_per_model
def _stations_by_points(model: Model) -> dict[int, _Stations]:
    """Cache of `_stations`."""
    return {}


def _stations(model: Model, points: int) -> _Stations:
    """Stations of all leaves, of each `points` or a few more, divided among its members."""
    cache = _stations_by_points(model)
    if points not in cache:
        leaves = leaf_members(model)
        count = np.zeros(len(model.member_names), int)
        for members in leaves.values():
            count[members] = max(2, math.ceil((points - 1) / len(members)) + 1)
        together = [
            (group, np.flatnonzero(count[group.members] == n), int(n))
            for group in (*leaf_groups(model), *chain_groups(model))
            for n in np.unique(count[group.members])
        ]
        lines = _member_lines(model, model.rest, together, 0.0)
        cache[points] = _Stations(
            together, [_leaf_at_rest(model, name, parts, lines) for name, parts in leaves.items()]
        )
    return cache[points]


def _member_lines(
    model: Model,
    motion: State,
    together: list[tuple[LeafGroup, NDArray[np.int64], int]],
    load_factor: float,
) -> dict[int, tuple[Array, Array, Array]]:
    """Stations (k,) [m], positions (k, 3) and axes (k, 3, 3), global, along every leaf spring, chain and solid by member."""
    lines = {i: solid_line(model, motion, i) for i, n in enumerate(model.member_names) if n in model.solids}
    for group, which, points in together:
        each = centrelines(model, motion, group, which, points, load_factor)
        lines |= dict(zip(group.members[which].tolist(), zip(*each, strict=True), strict=True))
    return lines


def _leaf_at_rest(
    model: Model, name: str, members: list[int], lines: dict[int, tuple[Array, Array, Array]]
) -> _LeafAtRest:
    """The whole leaf of these members, with their `lines` at rest."""
    leaf = scene_leaves(model)[name]
    own = [slice(int(k > 0), None) for k in range(len(members))]
    at = np.cumsum([0.0] + [lines[i][0][-1] for i in members])
    s = np.concatenate(
        [lines[i][0][part] + at[k] for k, (i, part) in enumerate(zip(members, own, strict=True))]
    )
    rest, rest_axes = (_joined(lines, members, own, c) for c in (1, 2))
    # at a step of the profile the larger side counts
    sections = [
        (leaf.section,) if leaf.profile is None else leaf.profile.sides(x) for x in (s / s[-1]).tolist()
    ]
    thickness, width = np.array(
        [np.max([thickness_and_width(q) for q in sides], axis=0) for sides in sections]
    ).T
    is_round = all(round_ratio(q) is not None for sides in sections for q in sides)
    fixed = {
        "name": name, "s": s, "rest": rest, "rest_axes": rest_axes, "width": width, "thickness": thickness,
        "is_round": is_round,
    }  # fmt: skip
    return _LeafAtRest(members, own, fixed)


def _joined(
    lines: dict[int, tuple[Array, Array, Array]], members: list[int], stations: list[slice], column: int
) -> Array:
    """A column of the lines of the members of a leaf, joined."""
    if len(members) == 1:
        return lines[members[0]][column]
    return np.concatenate([lines[i][column][part] for i, part in zip(members, stations, strict=True)])


def _leaf_shapes(model: Model, motion: State, points: int, load_factor: float) -> Iterator[LeafShape]:
    """Shapes of all leaves, each at `points` stations or a few more."""
    stations = _stations(model, points)
    lines = _member_lines(model, motion, stations.together, load_factor)
    for members, own, fixed in stations.leaves:
        yield LeafShape(place=_joined(lines, members, own, 1), axes=_joined(lines, members, own, 2), **fixed)


class _PosedLinks:
    """The links of a model at a state: where their points are, and how directions turn with them."""

    def __init__(self, model: Model, motion: State) -> None:
        self.model, self.motion = model, motion
        self.index = {link: i for i, link in enumerate(model.scene.links)}

    def at_rest(self, term: DriveTerm) -> Array:
        """The undeformed point (3,) of a drive term; a rotation without a point turns the whole link."""
        if term.kind == "rotation" and not any(term.point):
            return self.model.rest.x[self.index[term.link]]
        return np.asarray(term.point, float)

    def place(self, link: str, at: ArrayLike) -> Array:
        """The deformed position (3,) of the point of a link that is at `at` (3,) at rest."""
        return point_position(self.model, self.motion, self.index[link], at)

    def turned(self, link: str, direction: ArrayLike) -> Array:
        """A direction (3,) that turns with a link."""
        return np.asarray(self.motion.R[self.index[link]] @ np.asarray(direction, float))


def _driven(scene: Scene, links: _PosedLinks) -> Iterator[DrivenPoint]:
    for drive in scene.drives:
        term = drive.terms[0]
        rest, along = links.at_rest(term), links.turned(term.base, term.direction)
        yield DrivenPoint(drive.name, term.kind, rest, links.place(term.link, rest), along)


@cached_per_model
def _block_points(model: Model) -> list[tuple[int, dict[str, Any]]]:
    """Node of every block that has points, and what its `BlockShape` is in every configuration."""
    members, leaves = model.arrays.members, leaf_members(model)
    # of every block: arm, owner, leaf and station of every point
    found: list[list[tuple[Array, str, int, int]]] = [[] for _ in model.node_names]
    for k, (name, parts) in enumerate(leaves.items()):
        for i, end in ((parts[0], 0), (parts[-1], 1)):
            clamped = (members.offset[i, end], name.rsplit("/", 1)[0], k, -end)
            found[int(members.node[i, end])].append(clamped)
    index = {link: i for i, link in enumerate(model.scene.links)}
    for hinge in model.scene.hinges:
        for node in {index[hinge.a], index[hinge.b]} - ({0} if hinge.kind == "slider" else set()):
            found[node].append((np.asarray(hinge.at) - model.rest.x[node], hinge.name, -1, 0))
    for drive in model.scene.drives:
        for term in drive.terms:
            if term.kind == "translation":
                arm = np.asarray(term.point, float) - model.rest.x[index[term.link]]
                found[index[term.link]].append((arm, drive.name, -1, 0))
    for link, at, owner_name in _points_on_links(model):
        # ground is drawn only where something is clamped to it
        if index[link]:
            found[index[link]].append((np.asarray(at, float) - model.rest.x[index[link]], owner_name, -1, 0))
    blocks = []
    for node, name in enumerate(model.node_names):
        if found[node]:
            arms, owner, leaf, station = zip(*found[node], strict=True)
            fixed = {"name": name, "rest": model.rest.x[node] + np.array(arms), "owner": owner}
            blocks.append((node, fixed | {"leaf": np.array(leaf), "station": np.array(station)}))
    return blocks


def _blocks(model: Model, motion: State) -> Iterator[BlockShape]:
    for node, fixed in _block_points(model):
        R, x, x_rest = motion.R[node], motion.x[node], model.rest.x[node]
        place = x + (fixed["rest"] - x_rest) @ R.T
        yield BlockShape(place=place, rotation=R.copy(), position=x - R @ x_rest, **fixed)


def _points_on_links(model: Model) -> Iterator[tuple[str, ArrayLike, str]]:
    """Link, position (3,) [m] at rest and name of loads, masses, sensors, dampers, ends of springs and of distances."""
    scene = model.scene
    for load in scene.loads:
        if np.any(load.force):
            yield load.link, load.at, load.name
    for mass in scene.masses:
        if mass.mass:
            yield mass.link, mass.at, mass.link
    for spring in scene.springs:
        if isinstance(spring, Spring):
            yield spring.a, spring.start, spring.name
            yield spring.b, spring.end, spring.name
    for part in (*scene.sensors, *scene.dampers):
        if part.term.kind == "translation":
            yield part.term.link, part.term.point, part.name
    for distance in scene.distances:
        yield distance.a, distance.start, distance.name
        yield distance.b, distance.end, distance.name
    for cable in model.original_scene.cables:
        for link, at in cable.points:
            yield link, at, cable.name
    for surface in model.original_scene.surfaces:
        yield surface.link, surface.at, surface.name


def _hinges(scene: Scene, links: _PosedLinks) -> Iterator[HingeShape]:
    for hinge in scene.hinges:
        place, axis = links.place(hinge.b, hinge.at), links.turned(hinge.a, hinge.axis)
        yield HingeShape(hinge.name, hinge.kind, np.asarray(hinge.at), place, axis)


def _loads(scene: Scene, links: _PosedLinks, factor: float) -> Iterator[LoadShape]:
    """Forces and moments of the scene times `factor`, and point masses."""
    for load in scene.loads_on_links:
        for kind in ("force", "moment"):
            value = np.asarray(getattr(load, kind))
            if value.any():
                # a moment without a point turns the whole link
                whole = not any(load.force) and not any(load.at)
                at = links.model.rest.x[links.index[load.link]] if whole else load.at
                turned = links.turned(load.link, value) if load.following else value
                yield LoadShape(load.name, kind, links.place(load.link, at), factor * turned)
    for mass in scene.masses:
        yield LoadShape(mass.link, "mass", links.place(mass.link, mass.at), np.array([mass.mass]))


LINE_LOAD_ARROWS = 7
"""Arrows of a load along a leaf."""


def _line_loads(scene: Any, leaves: Sequence[LeafShape], factor: float) -> Iterator[LineLoadShape]:
    """Loads along leaf springs times `factor`, at a few points."""
    shapes = {leaf.name: leaf for leaf in leaves}
    for load in scene.loads_along:
        leaf = shapes[load.leaf]
        s = np.linspace(load.start, leaf.s[-1] if load.end is None else load.end, LINE_LOAD_ARROWS)
        place, side, width = (
            np.array([np.interp(s, leaf.s, column) for column in part.reshape(len(leaf.s), -1).T]).T
            for part in (leaf.place, leaf.axes[:, :, 1], leaf.width)
        )
        if isinstance(load, Pressure):
            value = SIDES[load.side] * load.pressure * width * side
            text = f"{1e-3 * factor * load.pressure:.4g} kPa"
            yield LineLoadShape(load.name, place, factor * value, text)
            continue
        share = np.linspace(0.0, 1.0, LINE_LOAD_ARROWS)[:, None]
        for kind, unit in (("force", "N/m"), ("moment", "Nm/m")):
            if getattr(load, f"has_{kind}"):
                first, last = getattr(load, kind), getattr(load, f"end_{kind}")
                value = (1.0 - share) * np.asarray(first) + share * np.asarray(last)
                ends = [f"{factor * np.linalg.norm(size):.4g}" for size in (first, last)]
                text = f"{' to '.join(dict.fromkeys(ends))} {unit}"
                yield LineLoadShape(load.name, place, factor * value, text, kind)


def _springs(scene: Scene, links: _PosedLinks) -> Iterator[SpringShape]:
    for spring in scene.springs:
        ends = (
            ((spring.a, spring.start), (spring.b, spring.end))
            if isinstance(spring, Spring)
            else ((spring.b, spring.at),)
        )
        yield SpringShape(spring.name, np.array([links.place(*end) for end in ends]))


def _distances(scene: Scene, links: _PosedLinks) -> Iterator[DistanceShape]:
    for distance in scene.distances:
        ends = np.array([links.place(distance.a, distance.start), links.place(distance.b, distance.end)])
        direction = ends[1] - ends[0] if distance.along is None else np.asarray(distance.along)
        if distance.turns_with is not None:
            direction = links.turned(distance.turns_with, direction)
        yield DistanceShape(distance.name, ends, direction / max(float(np.linalg.norm(direction)), 1e-300))


def _sensors(scene: Scene, links: _PosedLinks) -> Iterator[SensorShape]:
    parts: tuple[Sensor | Damper, ...] = (*scene.sensors, *scene.dampers)
    for part in parts:
        term = part.term
        place, direction = (
            links.place(term.link, links.at_rest(term)),
            links.turned(term.base, term.direction),
        )
        yield SensorShape(part.name, place, direction, term.kind == "rotation", isinstance(part, Damper))


def _cables(scene: Scene, links: _PosedLinks) -> Iterator[CableShape]:
    for cable in scene.cables:
        yield CableShape(cable.name, np.array([links.place(*point) for point in cable.points]))


def _stops(scene: Scene, links: _PosedLinks) -> Iterator[StopShape]:
    """Limits of stops of one displacement; others have no place."""
    for stop in scene.stops:
        term = stop.terms[0]
        if len(stop.terms) > 1 or term.kind == "rotation":
            continue
        direction, at_rest = links.turned(term.base, term.direction), links.place(term.base, term.point)
        for name, value in stop.limits.items():
            inward = direction if name.endswith(".low") else -direction
            yield StopShape(name, at_rest + value / term.coefficient * direction, inward)


def _surfaces(scene: Scene, links: _PosedLinks, size: float) -> Iterator[SurfaceShape]:
    """Outlines of surfaces in their x and y, of a wall along its x; size [m]: of the mechanism."""
    turn = np.linspace(0.0, 2.0 * np.pi, OUTLINE_POINTS)
    for s in scene.surfaces:
        at_rest = np.asarray(s.at) + _outline(s.shape, turn, size) @ np.array(s.axes)
        yield SurfaceShape(s.name, np.array([links.place(s.link, p) for p in at_rest]))


def _outline(shape: ContactShape, turn: Array, size: float) -> Array:
    """Points (n, 3) [m] of one line that shows a shape, in its axes; turn (m,) [rad]: of circles; size [m]: of a wall."""
    c, o, flat = np.cos(turn), np.sin(turn), 0.0 * turn
    if shape.kind == "wall":
        return np.array([[-0.2 * size, 0.0, 0.0], [0.2 * size, 0.0, 0.0]])
    if shape.kind == "box":
        # all edges
        return np.array(shape.tips)[[0, 1, 2, 3, 0, 4, 5, 1, 5, 6, 2, 6, 7, 3, 7, 4]]
    if shape.kind == "capsule":
        r, z = shape.sizes[0], shape.sizes[0] * o + 0.5 * shape.sizes[1] * np.sign(o)
        return np.concatenate([np.stack([r * c, flat, z], axis=1), np.stack([r * c, r * o, flat], axis=1)])
    if shape.kind == "polyhedron":
        faces = ConvexHull(np.array(shape.tips)).simplices
        return np.array(shape.tips)[np.concatenate([faces, faces[:, :1]], axis=1).ravel()]
    if shape.points:
        return np.array([*shape.tips, shape.tips[0]])
    a, b, *more = shape.sizes if len(shape.sizes) > 1 else 3 * shape.sizes
    round_z = np.stack([a * c, b * o, flat], axis=1)
    if shape.is_plane:
        return round_z
    return np.concatenate([round_z, np.stack([a * c, flat, more[0] * o], axis=1)])


def point_position(model: Model, motion: State, node: int, at: ArrayLike) -> Array:
    """Deformed position (3,) [m] of the point of a node that is at `at` (3,) [m] at rest."""
    arm = np.asarray(at, float) - model.rest.x[node]
    position: Array = motion.x[node] + motion.R[node] @ arm
    return position


def mechanism_shape(
    model: Model, motion: State, *, points: int = DEFAULT_STATIONS, load_factor: float = 1.0
) -> Shape:
    """Geometry of `model` at `motion`, with at least `points` stations per leaf and loads times load_factor."""
    leaves, links = tuple(_leaf_shapes(model, motion, points, load_factor)), _PosedLinks(model, motion)
    # stops, cables and surfaces are those that the user described
    scene, described = model.scene, model.original_scene
    return Shape(
        leaves,
        tuple(_blocks(model, motion)),
        tuple(_driven(scene, links)),
        tuple(_hinges(scene, links)),
        tuple(_loads(scene, links, load_factor)),
        tuple(_springs(scene, links)),
        tuple(_distances(scene, links)),
        tuple(_sensors(scene, links)),
        tuple(_cables(described, links)),
        tuple(_stops(described, links)),
        tuple(_surfaces(described, links, model.arrays.size)),
        tuple(_line_loads(scene, leaves, load_factor)),
    )
