"""Build the joint bodies of a model once: the kinematic loops, the bench of apart joints, the reduced mechanism.

Everything is frozen arrays; a solve only brings its own `Motion` and `Work`. The database enters here and nowhere
else: records are contracted with the shape of each joint, leaving polynomials in the intended motions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ksd.beam.linear import LINEAR_INNER
from ksd.bodies.bench import Inside
from ksd.bodies.kinematics import Loops
from ksd.bodies.weight import NOTHING_HUNG, Hung
from ksd.errors import KinematicsError, RecordError, SceneError
from ksd.model.arrays import COROTATIONAL, LINEAR, Arrays, Motion
from ksd.model.compile import (
    Model,
    constraint_rows,
    elastic_parts,
    external_loads,
    joint_members_of,
    pulls,
    reference_points,
)
from ksd.model.leafs import leaf_member
from ksd.model.pack import Assembly, Member, Push, pack
from ksd.scene.joint import leafs_of


@dataclass(frozen=True)
class JointBodies:
    """All joints of a model as bodies: `loops` answers allow, `inside` inside, `bench` resist.

    reduced: the mechanism of links and condensed joints (its members: one linear body per joint, then free leafs).
    near (members of the bench,): lengths of the near data. full_node (K,): internal blocks in the full model.
    motion_range (motions, 2): trained range, rad or stroke over joint length, as theta; motion_scale (motions,):
    theta to rad or m; motion_names. hung: the weight of the joints. hanging: links on leafs alone, each with the nodes
    that place it (`hang_links`).
    """

    loops: Loops
    inside: Inside
    bench: Arrays
    bench_rest: Motion
    reduced: Arrays
    reduced_rest: Motion
    near: np.ndarray
    full_node: np.ndarray
    motion_range: np.ndarray
    motion_scale: np.ndarray
    motion_names: tuple[str, ...]
    hung: Hung
    hanging: tuple[tuple[int, np.ndarray], ...] = ()


def _spanning_tree(nodes: np.ndarray) -> tuple[list[list[int]], list[int]]:
    """Breadth-first tree from ground: (joint, forward) in order, and the joints left to close loops."""
    reached, tree, used = {0}, [], set()
    while True:
        found = [
            (j, int(a in reached))
            for j, (a, b) in enumerate(nodes)
            if j not in used and (a in reached) != (b in reached)
        ]
        if not found:
            break
        j, forward = found[0]
        used.add(j)
        tree.append([j, forward])
        reached.add(int(nodes[j][1] if forward else nodes[j][0]))
    return tree, [j for j in range(len(nodes)) if j not in used]


def _hanging(model: Model, tree: list[list[int]], nodes: np.ndarray) -> tuple[tuple[int, np.ndarray], ...]:
    """Links that hang on leafs alone, each with the nodes next to it that are placed before, in order of placing.

    Raises KinematicsError for a link nothing leads to.
    """
    scene = model.scene
    index = {link: i for i, link in enumerate(scene.links)}
    reached = {0, *(int(nodes[j][forward]) for j, forward in tree)}
    pairs = [(index[f.a], index[f.b]) for f in scene.leafs]
    found = []
    while True:
        near: dict[int, list[int]] = {}
        for a, b in (*pairs, *((b, a) for a, b in pairs)):
            if a in reached and b not in reached and a not in near.setdefault(b, []):
                near[b].append(a)
        if not near:
            break
        # the one with most neighbours placed is placed best
        link = max(near, key=lambda k: (len(near[k]), -k))
        reached.add(link)
        found.append((link, np.array(near[link], np.int64)))
    lost = [link for link in scene.links if index[link] not in reached]
    if lost:
        raise KinematicsError(
            f"link '{lost[0]}' is not connected to ground by joints or leafs, so the kinematic start cannot place it; "
            "add a joint"
        )
    return tuple(found)


def hang_links(bodies: JointBodies, motion: Motion) -> None:
    """Place links that hang on leafs alone where their neighbours, moved as one body each, would have them in the mean."""
    rest = bodies.reduced_rest
    for link, near in bodies.hanging:
        turned = motion.R[near].sum(axis=0)
        moved = np.einsum("kij,kj->ki", motion.R[near], rest.x[link] - rest.x[near])
        motion.x[link] = (motion.x[near] + moved).mean(axis=0)
        # the rotation nearest to the mean of the neighbours' rotations
        u, _, v = np.linalg.svd(turned)
        motion.R[link] = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v


def _pad(functions: list[np.ndarray], size: int) -> np.ndarray:
    """Stack coefficient arrays (.., M) with zeros up to `size` monomials."""
    if not functions:
        return np.zeros(0)
    padded = np.zeros((len(functions), *functions[0].shape[:-1], size))
    for row, f in zip(padded, functions, strict=True):
        row[..., : f.shape[-1]] = f
    return padded


def _tip(placed: Any) -> np.ndarray:
    """Interface B of a placed joint at rest (3,), global."""
    return np.asarray(placed.origin) + np.asarray(placed.rotation) @ np.asarray(placed.joint.pose_B)


def build_loops(model: Model, contracted: list[Any]) -> Loops:
    """The kinematics of all joints, from their contracted records."""
    scene = model.scene
    index = {link: i for i, link in enumerate(scene.links)}
    places = reference_points(scene)
    nodes = np.array([[index[j.a], index[j.b]] for j in scene.joints], np.int64).reshape(-1, 2)
    tree, closing = _spanning_tree(nodes)
    anchor = [
        [np.asarray(j.origin) - places[a], _tip(j) - places[b]]
        for j, (a, b) in zip(scene.joints, nodes, strict=True)
    ]
    size = max((c.powers.shape[0] for c in contracted), default=1)
    power = [np.pad(c.powers, [(0, 0), (0, 2 - c.powers.shape[1])]) for c in contracted]
    return Loops(
        node=nodes,
        anchor=np.array(anchor, float).reshape(-1, 2, 3),
        frame=np.array([j.rotation for j in scene.joints], float).reshape(-1, 3, 3),
        length=np.array([j.joint.length for j in scene.joints], float),
        first=np.cumsum([0] + [len(j.joint.motions) for j in scene.joints]).astype(np.int64),
        tree=np.array(tree, np.int64).reshape(-1, 2),
        closing=np.array(closing, np.int64),
        power_first=np.cumsum([0] + [len(p) for p in power]).astype(np.int64),
        power=np.concatenate([*power, np.zeros((0, 2))]).astype(np.int64),
        pose=_pad([c.interface for c in contracted], size).reshape(-1, 6, size),
    )


class _Bench:
    """Collects the apart joints: nodes (ground, internal blocks, then all Bs), members, and database functions."""

    def __init__(self, model: Model, size: int) -> None:
        self.model, self.size = model, size
        self.places: list[np.ndarray] = [np.zeros(3)]
        self.members: list[Member] = []
        self.block: list[tuple[int, int, np.ndarray]] = []
        self.inner: list[tuple[int, int, np.ndarray]] = []
        self.near: list[tuple[int, int, np.ndarray]] = []
        self.near_length: list[int] = []
        self.full_node: list[int] = []

    def add(self, j: int, placed: Any, functions: Any, node_B: int) -> None:
        joint = placed.joint
        nodes = {"A": 0, "B": node_B}
        inner_blocks = [b for b in joint.blocks() if b not in nodes]
        places = dict(joint.blocks())
        for k, block in enumerate(inner_blocks):
            nodes[block] = len(self.places)
            self.block.append((nodes[block], j, functions.blocks[k]))
            self.full_node.append(self.model.node_names.index(f"{placed.name}/{block}"))
            self.places.append(np.asarray(places[block], float))
        table = np.zeros((node_B + 1, 3))
        for block, node in nodes.items():
            table[node] = joint.pose_B if block == "B" else (0.0 if block == "A" else places[block])
        first = len(self.members)
        heavy = pulls(self.model.scene)
        self.members += joint_members_of(placed, self.model.mesh, nodes, table, None, heavy=heavy)
        for n, leaf in enumerate(leafs_of(joint)):
            self._functions(j, self.members[first + n], leaf, functions, n)

    def _functions(self, j: int, member: Member, leaf: Any, functions: Any, n: int) -> None:
        at = sum(len(m.inner) for m in self.members[: self.members.index(member)])
        if member.kind == COROTATIONAL:
            base = sum(self.near_length)
            rotations = functions.rotations[n]
            self.near += [
                (j, base + 3 * i + r, rotations[i, r]) for i in range(len(rotations)) for r in range(3)
            ]
            self.near_length.append(3 * len(rotations))
            return
        self.near_length.append(0)
        bending = leaf.material.E * leaf.section.Iz
        theirs, mine, given, wanted = functions.orders, member.number[:3], 0, 0
        for axis in range(3):
            for k in range(min(theirs[axis], mine[axis])):
                self.inner.append((j, at + wanted + k, functions.amplitudes[n, given + k] / member.length))
            given, wanted = given + theirs[axis], wanted + int(mine[axis])
        for r in range(6):
            scale = bending / member.length ** (2 if r < 3 else 1)
            self.inner.append((j, at + wanted + r, functions.wrench[n, r] * scale))


def _flat(found: list[tuple[int, int, np.ndarray]], size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    kept = [f for f in found if np.any(f[2])]
    joint = np.array([f[0] for f in kept], np.int64)
    target = np.array([f[1] for f in kept], np.int64)
    return joint, target, _pad([f[2] for f in kept], size).reshape(-1, size)


def build_bench(model: Model, contracted: list[Any]) -> tuple[Arrays, Motion, Inside, np.ndarray, np.ndarray]:
    """The bench of all joints: arrays, rest state, database functions, near lengths, full-model nodes of the blocks."""
    joints = model.scene.joints
    size = max((c.powers.shape[0] for c in contracted), default=1)
    blocks = sum(len([b for b in j.joint.blocks() if b not in ("A", "B")]) for j in joints)
    bench = _Bench(model, size)
    for j, (placed, functions) in enumerate(zip(joints, contracted, strict=True)):
        bench.add(j, placed, functions, 1 + blocks + j)
    places = np.array([*bench.places, *[np.asarray(j.joint.pose_B, float) for j in joints]]).reshape(-1, 3)
    # as given; turned into the axes of every joint before it is condensed
    gravity = model.scene.gravity
    arrays, rest = pack(Assembly(places, bench.members, last=len(joints), gravity=gravity))
    joint, target, coefficient = _flat(bench.inner, size)
    near_joint, near_target, near_coefficient = _flat(bench.near, size)
    inside = Inside(
        np.array([b[0] for b in bench.block], np.int64),
        np.array([b[1] for b in bench.block], np.int64),
        _pad([b[2] for b in bench.block], size).reshape(-1, 6, size),
        joint, target, coefficient, near_joint, near_target, near_coefficient,
    )  # fmt: skip
    return arrays, rest, inside, np.array(bench.near_length, np.int64), np.array(bench.full_node, np.int64)


def build_reduced(model: Model) -> tuple[Arrays, Motion, Hung]:
    """The reduced mechanism: links are the nodes, every joint one linear body and its weight a load, free leafs as they
    are."""
    scene = model.scene
    places = reference_points(scene)
    index = {link: i for i, link in enumerate(scene.links)}
    members: list[Member] = []
    for placed in scene.joints:
        a, b = index[placed.a], index[placed.b]
        floor = max(model.arrays.members.floor[model.joint_members[len(members)]], default=1.0)
        members.append(
            Member(placed.name, LINEAR, (a, b), np.array([np.asarray(placed.origin) - places[a], _tip(placed) - places[b]]),
                   np.array([placed.rotation] * 2), np.zeros(0), np.zeros(1, np.int64), np.zeros(LINEAR_INNER), 0,
                   placed.joint.length, float(floor))
        )  # fmt: skip
    for leaf in scene.leafs:
        a, b = index[leaf.a], index[leaf.b]
        ends: dict[str, Any] = {"nodes": (a, b), "places": (places[a], places[b])}
        members.append(leaf_member(leaf.leaf, model.mesh, name=leaf.name, heavy=pulls(scene), **ends))
    rows, _, _ = constraint_rows(scene, places)
    springs = elastic_parts(scene, places)
    pushes, hung = _hung(model, external_loads(scene, places), index)
    return *pack(Assembly(places, members, rows, pushes, springs, gravity=scene.gravity)), hung


def _hung(model: Model, pushes: list[Push], index: dict[str, int]) -> tuple[list[Push], Hung]:
    """The loads with those that stand for the weight of the joints, at points that step 2 sets, and which they are."""
    weight, joints = model.arrays.weight, model.scene.joints
    leafs = [len(leafs_of(placed.joint)) for placed in joints]
    if not len(weight) or not any(weight[s, 0].any() for s in model.joint_members):
        return pushes, NOTHING_HUNG
    load = np.full(len(joints), -1)
    for j, (placed, own) in enumerate(zip(joints, model.joint_members, strict=True)):
        mass = weight[own, 0].sum()
        if index[placed.a] > 0 and mass > 0.0:
            load[j] = len(pushes)
            force = mass * np.asarray(model.scene.gravity, float)
            pushes = [*pushes, Push(index[placed.a], np.zeros(3), force, np.zeros(3))]
    return pushes, Hung(np.repeat(np.arange(len(joints)), leafs), load, np.array([sum(leafs), len(joints)]))


def _contracted(joint: Any, record: Any, mesh: str | int, extrapolate: bool) -> Any:
    """The record at the shape of a joint; RecordError for a chain it cannot stand for, and for another joint's record."""
    leafs = leafs_of(joint)
    inner = [name for name in joint.blocks() if name not in ("A", "B")]
    counts = [(len(leafs), len(record.leafs), "leafs"), (len(inner), len(record.blocks), "internal blocks")]
    counts.append((len(joint.motions), len(record.motions), "motions"))
    for here, there, what in counts:
        if here != there:
            raise RecordError(
                f"the record of {joint.family} is of a joint with {there} {what}, this one has {here}; give your joint a "
                "family name of its own and train it with ksd.train(joint)"
            )
    plain = all(leaf.profile is None and leaf.curve is None for leaf in leafs)
    if mesh not in record.functions and not plain:
        known = ", ".join(str(n) for n in record.functions)
        raise RecordError(
            f"the record of {joint.family} has no chains of {mesh} elements, and its leafs are not straight and uniform, "
            f"so none can be derived; use one of its meshes ({known}) or train it with meshes=(..., {mesh})"
        )
    return record.contract(joint.shape(), mesh, extrapolate=extrapolate)


def joint_bodies(model: Model, records: Callable[[str], Any], *, extrapolate: bool = False) -> JointBodies:
    """Bodies of every joint of `model`; `records(family)` returns the trained record.

    Raises SceneError without joints, RangeError for a shape outside the trained range (unless `extrapolate`),
    KinematicsError when joints alone do not place every link.
    """
    if not model.scene.joints:
        raise SceneError(
            "this mechanism has no catalogue joints, so there is nothing to reduce; use method='conventional'"
        )
    mesh = "strain" if model.mesh.leaf == "strain" else model.mesh.elements
    different = {id(placed.joint): placed.joint for placed in model.scene.joints}
    known = {i: _contracted(j, records(j.family), mesh, extrapolate) for i, j in different.items()}
    contracted = [known[id(placed.joint)] for placed in model.scene.joints]
    loops = build_loops(model, contracted)
    bench, bench_rest, inside, near, full_node = build_bench(model, contracted)
    reduced, reduced_rest, hung = build_reduced(model)
    ranges, scales, names = [], [], []
    for placed, functions in zip(model.scene.joints, contracted, strict=True):
        for k, motion in enumerate(placed.joint.motions):
            scales.append(placed.joint.length if motion.kind == "translation" else 1.0)
            ranges.append(functions.motion_range[k])
            names.append(placed.name if len(placed.joint.motions) == 1 else f"{placed.name}.{motion.name}")
    return JointBodies(
        loops, inside, bench, bench_rest, reduced, reduced_rest, near, full_node,
        np.array(ranges, float).reshape(-1, 2), np.array(scales), tuple(names),
        hung, _hanging(model, loops.tree.tolist(), loops.node),
    )  # fmt: skip
