"""Compile a scene: links and internal blocks become nodes, leafs become members, drives and supports become rows.

Rigid links and connector blocks are neither elements nor constraints: leaf ends hang on their node by an offset.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from ksd.errors import SceneError
from ksd.model.arrays import ROTATION, TRANSLATION, Arrays, Motion
from ksd.model.effects import Choice, applied, choose
from ksd.model.leafs import Mesh, leaf_member, split_leaf
from ksd.model.pack import Assembly, Member, Push, Row, pack
from ksd.scene.contents import WANTED
from ksd.section.checks import LARGEST, number, show, similar


@dataclass(frozen=True, repr=False)
class Model:
    """What the computer solves: frozen arrays of one scene with one mesh, and its rest state.

    node_names: "ground", links, then "joint/block"; member_names: "joint/leaf", then free leafs. joint_members[j]
    is the slice of members of joint j. drive_names: the first rows; supports follow, held at zero. spring_names: of
    `arrays.springs`. scene: what is simulated, so without the effects left out and with elastic links taken apart;
    said: the scene as it was described. choice: the effects and why, None when the scene was compiled as given.
    """

    scene: Any
    mesh: Mesh
    arrays: Arrays
    rest: Motion
    node_names: tuple[str, ...]
    member_names: tuple[str, ...]
    joint_members: tuple[slice, ...]
    drive_names: tuple[str, ...]
    support_names: tuple[str, ...]
    spring_names: tuple[str, ...] = field(default=())
    said: Any = field(default=None)
    choice: Any = field(default=None)

    @cached_property
    def derived(self) -> dict[Any, Any]:
        """What was computed from this model and nothing else, by what computed it; lives and dies with the model."""
        return {}

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "derived"}

    def __repr__(self) -> str:
        unknowns = self.arrays.plan.unknowns
        return f"<Model of '{self.scene.name}': {len(self.member_names)} members, {unknowns} unknowns, {self.mesh}>"

    def __str__(self) -> str:
        """What is simulated and what is left out, with the reason, in a few lines."""
        from ksd.model.listing import listing

        return "\n".join(f"{head}: {said}" for head, said in listing(self))

    @property
    def links(self) -> int:
        """Number of links, ground included; they are the first nodes."""
        return len(self.scene.links)

    def refuse_turns(self, target: np.ndarray) -> None:
        """SceneError for a drive that is to turn by more than the half turn either way that a pose tells."""
        if not len(target) or np.abs(target).max() <= np.pi:
            return
        terms = self.arrays.terms
        for name, value, first, end in zip(
            self.drive_names, target, terms.first, terms.first[1:], strict=False
        ):
            most = np.pi * float(np.abs(terms.coefficient[first:end]).sum())
            if np.all(terms.kind[first:end] == ROTATION) and abs(value) > most:
                raise SceneError(
                    f"drive '{name}' = {np.rad2deg(value):.6g} deg: a prescribed rotation is read from the pose of its "
                    f"links, which tells it within {np.rad2deg(most):.6g} deg either way; turn further by a moment "
                    "(mechanism.load)"
                )

    def targets(self, values: Mapping[str, float]) -> np.ndarray:
        """Right-hand sides of all rows for drive values by name [m or rad]; SceneError for unknown or missing ones."""
        found = [v for n in self.drive_names if type(v := values.get(n)) is float and abs(v) <= LARGEST]
        if len(values) == len(found) == len(self.drive_names):
            return np.array(found + [0.0] * len(self.support_names))
        for name in values:
            if name not in self.drive_names:
                known = ", ".join(self.drive_names) or "none"
                hint = similar(name, self.drive_names)
                raise SceneError(f"drive '{name}' is not in this mechanism; its drives are: {known}{hint}")
        missing = [n for n in self.drive_names if n not in values]
        if missing:
            raise SceneError(f"drive '{missing[0]}' has no value; give one, for example {missing[0]}=0.0")
        found = [number(values[n], f"drive '{n}'", unit="m or rad") for n in self.drive_names]
        return np.array(found + [0.0] * len(self.support_names))


def reference_points(scene: Any) -> np.ndarray:
    """Reference position (3,) of every link: the mean of what hangs on it; ground at the origin."""
    index = {link: i for i, link in enumerate(scene.links)}
    found: list[list[np.ndarray]] = [[] for _ in scene.links]
    for j in scene.joints:
        found[index[j.a]].append(np.asarray(j.origin))
        found[index[j.b]].append(np.asarray(j.origin) + np.asarray(j.rotation) @ np.asarray(j.joint.pose_B))
    for leaf in scene.leafs:
        found[index[leaf.a]].append(np.asarray(leaf.leaf.start, float))
        found[index[leaf.b]].append(np.asarray(leaf.leaf.end, float))
    places = np.array([np.mean(f, axis=0) if f else np.zeros(3) for f in found])
    places[0] = 0.0
    return places


def pulls(scene: Any) -> bool:
    """Whether the scene has gravity, so that leafs of known density have weight."""
    return scene.gravity is not None and any(scene.gravity)


def joint_members_of(
    placed: Any, mesh: Mesh, nodes: Mapping[str, int], places: np.ndarray, turn: Any, *, heavy: bool = False
) -> list[Member]:
    """Members of one joint whose blocks are `nodes` (by block name), at reference `places` (k, 3)."""
    members = []
    for leaf in placed.leafs():
        pair = (nodes[leaf.start_block], nodes[leaf.end_block])
        name = f"{placed.name}/{leaf.name}"
        members.append(
            leaf_member(
                leaf,
                mesh.of(name),
                name=name,
                nodes=pair,
                places=(places[pair[0]], places[pair[1]]),
                turn=turn,
                heavy=heavy,
            )
        )
    return members


def _nodal_members(
    leaf: Any, mesh: Mesh, name: str, pair: tuple[int, int], found: tuple[list, list, Any, bool]
) -> list[Member]:
    """One member per element, with a new model node at every cut; `found` = (places, node names, turn, heavy)."""
    places, names, turn, heavy = found
    pieces, cuts = split_leaf(leaf, leaf.elements or mesh.elements)
    nodes = [pair[0], *range(len(places), len(places) + len(cuts)), pair[1]]
    origin, rotation = turn if turn is not None else (np.zeros(3), np.eye(3))
    places += [origin + rotation @ cut for cut in cuts]
    names += [f"{name}.{k + 1}" for k in range(len(cuts))]
    return [
        leaf_member(
            piece,
            mesh,
            name=f"{name}.{k + 1}",
            nodes=(a, b),
            places=(places[a], places[b]),
            turn=turn,
            heavy=heavy,
        )
        for k, (piece, (a, b)) in enumerate(zip(pieces, pairwise(nodes), strict=True))
    ]


def _row(terms: Any, index: Mapping[str, int], places: np.ndarray) -> Row:
    """A drive or support: its value is measured from rest, so the rest value of a translation is zero by choice of
    the base point: the base's own point coincides with the driven point at rest."""
    rows = []
    for t in terms:
        a, b = index[t.base], index[t.link]
        point = np.asarray(t.point, float)
        kind = ROTATION if t.kind == "rotation" else TRANSLATION
        rows.append(
            (
                float(t.coefficient),
                kind,
                a,
                b,
                np.asarray(t.direction, float),
                point - places[a],
                point - places[b],
            )
        )
    return Row(tuple(rows))


def constraint_rows(scene: Any, places: np.ndarray) -> tuple[list[Row], tuple[str, ...], tuple[str, ...]]:
    """Rows of all drives, then all supports, with their names."""
    index = {link: i for i, link in enumerate(scene.links)}
    rows = [_row(d.terms, index, places) for d in (*scene.drives, *scene.supports)]
    return rows, tuple(d.name for d in scene.drives), tuple(s.name for s in scene.supports)


def external_loads(scene: Any, places: np.ndarray) -> list[Push]:
    """Forces and moments on links; gravity acts at the centre of every mass the scene names."""
    index = {link: i for i, link in enumerate(scene.links)}
    pushes = []
    for load in scene.loads:
        node = index[load.link]
        pushes.append(
            Push(node, np.asarray(load.at, float) - places[node], np.asarray(load.force, float),
                 np.asarray(load.moment, float), bool(load.following))
        )  # fmt: skip
    if scene.gravity is not None:
        for mass in scene.masses:
            node = index[mass.link]
            weight = mass.mass * np.asarray(scene.gravity, float)
            pushes.append(Push(node, np.asarray(mass.at, float) - places[node], weight, np.zeros(3)))
    return [p for p in pushes if p.node != 0]


class _Parts:
    """Nodes and members of the full model while they are collected."""

    def __init__(self, scene: Any, mesh: Mesh) -> None:
        self.mesh, self.heavy = mesh, pulls(scene)
        self.index = {link: i for i, link in enumerate(scene.links)}
        self.names = list(scene.links)
        self.places = list(reference_points(scene))
        self.members: list[Member] = []

    def add_joint(self, placed: Any) -> slice:
        """Internal blocks as nodes, leafs as members; returns the slice of its members."""
        turn = (np.asarray(placed.origin, float), np.asarray(placed.rotation, float))
        nodes = {"A": self.index[placed.a], "B": self.index[placed.b]}
        for block, point in placed.joint.blocks().items():
            if block not in nodes:
                nodes[block] = len(self.places)
                self.places.append(turn[0] + turn[1] @ np.asarray(point, float))
                self.names.append(f"{placed.name}/{block}")
        first = len(self.members)
        for leaf in placed.leafs():
            pair = (nodes[leaf.start_block], nodes[leaf.end_block])
            self._add(leaf, f"{placed.name}/{leaf.name}", pair, turn)
        return slice(first, len(self.members))

    def add_leaf(self, leaf: Any) -> None:
        """A free leaf between two links, in global coordinates."""
        self._add(leaf.leaf, leaf.name, (self.index[leaf.a], self.index[leaf.b]), None)

    def _add(self, leaf: Any, name: str, pair: tuple[int, int], turn: Any) -> None:
        """The member of a leaf, or those of its elements."""
        mesh = self.mesh.of(name)
        if mesh.nodal:
            found = self.places, self.names, turn, self.heavy
            self.members += _nodal_members(leaf, mesh, name, pair, found)
            return
        ends: dict[str, Any] = {"nodes": pair, "places": (self.places[pair[0]], self.places[pair[1]])}
        self.members.append(leaf_member(leaf, mesh, name=name, turn=turn, heavy=self.heavy, **ends))


def compile_given(scene: Any, mesh: Mesh) -> Model:
    """The full model of a frozen scene exactly as it stands, no effect chosen: every leaf a member, every block a node."""
    parts = _Parts(scene, mesh)
    slices = [parts.add_joint(placed) for placed in scene.joints]
    for leaf in scene.leafs:
        parts.add_leaf(leaf)
    places = np.array(parts.places)
    rows, drives, supports = constraint_rows(scene, places)
    springs = elastic_parts(scene, places)
    pushes = external_loads(scene, places)
    arrays, rest = pack(Assembly(places, parts.members, rows, pushes, springs, gravity=scene.gravity))
    names = tuple(m.name for m in parts.members)
    return Model(
        scene, mesh, arrays, rest, tuple(parts.names), names, tuple(slices), drives, supports,
        tuple(s.name for s in springs), scene,
    )  # fmt: skip


def elastic_parts(scene: Any, places: np.ndarray) -> list[Member]:
    """Springs of a scene and its links with a matrix, between links at reference `places`; empty where it has none."""
    links = [c for c in scene.compliances if c.matrix is not None and f"{c.link}/2" in scene.links]
    if not scene.springs and not links:
        return []
    from ksd.model.springs import matrix_member, spring_members

    index = {link: i for i, link in enumerate(scene.links)}
    found = spring_members(scene.springs, index, places)
    for c in links:
        nodes = (index[c.link], index[f"{c.link}/2"])
        found.append(matrix_member(c.link, c.matrix, nodes, places, np.asarray(c.width_axis)))
    return found


def compile_scene(
    scene: Any,
    *,
    mesh: Mesh | None = None,
    effects: str | Iterable[str] = "auto",
    with_: str | Iterable[str] = (),
    without: str | Iterable[str] = (),
) -> Model:
    """The full model of a scene (a Mechanism or its frozen Scene) with the effects it mentions.

    effects: "auto", "all" or the names wanted; with_, without: single effects put on or off, see `ksd.model.effects`.
    Raises SceneError where the scene cannot be compiled (see `Mechanism.validate`) or an effect is unknown.
    """
    scene = scene.scene() if hasattr(scene, "scene") else scene
    if not hasattr(scene, "fingerprint"):
        raise SceneError(f"{show(scene)} is no mechanism; {WANTED}.")
    mesh = Mesh() if mesh is None else mesh
    if not isinstance(mesh, Mesh):
        raise SceneError(
            f"mesh = {show(mesh)}: give a ksd.Mesh, for example ksd.Mesh('corotational', elements=5)."
        )
    return compile_chosen(scene, mesh, choose(scene, mesh, effects=effects, with_=with_, without=without))


def compile_chosen(scene: Any, mesh: Mesh, choice: Choice) -> Model:
    """The model of a frozen scene with the effects of `choice`."""
    return marked(compile_given(*applied(scene, mesh, choice)), scene, choice)


def marked(model: Model, said: Any, choice: Choice | None) -> Model:
    """The model with what it stands for: the scene as described, and the choice of its effects."""
    model = replace(model, said=said, choice=choice)
    if choice is not None and choice["spatial"].present:
        from ksd.model.plane import refuse_plane

        refuse_plane(model, f"six unknowns per node are wanted: {choice['spatial'].reason}")
    return model
