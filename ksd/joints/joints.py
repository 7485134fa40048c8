"""The joint bodies of a model: kinematics of the joints, their substructures, and the reduced mechanism.

All of them are constant arrays; a solve only changes its own `State` and `Workspace`. Records are read here and nowhere
else: they are contracted at the shape of each joint, which leaves polynomials in the intended motions. Integers are set
once for all models of the same template (`JointLayout`), floats for many designs at once.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ksd.elements.linear import LINEAR_INNER
from ksd.errors import KinematicsError, RecordError, SceneError
from ksd.joints.joint_arrays import InteriorFunctions, JointKinematics, functions_of_design
from ksd.joints.joint_weight import NO_JOINT_WEIGHTS, JointWeights
from ksd.joints.polynomials import MotionPolynomials
from ksd.joints.record_match import check_record
from ksd.library import Record
from ksd.model.arrays import (
    COROTATIONAL,
    LINEAR,
    LOAD_NUMBERS,
    Arrays,
    State,
    angle_count,
    copy_floats,
    write,
)
from ksd.model.compile import Model, model_source
from ksd.model.pack import MemberTopology, largest_extent, topology_arrays
from ksd.model.scene_layout import LEAF_E, LEAF_IZ, SceneNumbers
from ksd.model.template import (
    DesignArrays,
    LeafGeometry,
    LeafPacking,
    Template,
    state_of_design,
)
from ksd.model.turns import count_from_links, node_rotations

UNIT_SCALE, INVERSE_LENGTH, FORCE_SCALE, MOMENT_SCALE = 0, 1, 2, 3
"""Scales of the functions of a leaf: 1, 1/L, EIz/L^2, EIz/L."""


@dataclass(frozen=True)
class JointBodies:
    """All joints of a model: `kinematics` of the intended motions, `interior` states, and `substructures` to be
    condensed.

    substructures: the joints without the links between them (`ksd.joints.substructures`). reduced: the mechanism of
    links and condensed joints; its members are one linear body per joint, then the leaf springs outside of joints.
    near_lengths (members of the substructures,): how many numbers each has in the near configuration. full_node (K,):
    internal blocks in the full model. motion_range (motions, 2): trained range, rad or stroke over joint length, as
    theta; motion_scale (motions,): from theta to rad or m. joint_weights: weight of the leaf springs. leaf_links: links
    that only leaf springs hold, each with the nodes its pose follows from (`place_leaf_links`).
    """

    kinematics: JointKinematics
    interior: InteriorFunctions
    substructures: Arrays
    substructure_rest: State
    reduced: Arrays
    reduced_rest: State
    near_lengths: np.ndarray
    full_node: np.ndarray
    motion_range: np.ndarray
    motion_scale: np.ndarray
    motion_names: tuple[str, ...]
    joint_weights: JointWeights
    leaf_links: tuple[tuple[int, np.ndarray], ...] = ()


def _spanning_tree(nodes: list[tuple[int, int]]) -> tuple[list[list[int]], list[int]]:
    """Spanning tree from ground, lowest joint numbers first: its joints [joint, forward] in order, and the other
    joints, which close loops.

    forward: 1 where the joint leads from its A to its B.
    """
    joints: dict[int, list[int]] = {}
    for j, pair in enumerate(nodes):
        for node in pair:
            joints.setdefault(node, []).append(j)
    reached, tree, in_tree = {0}, [], set()
    frontier = list(joints.get(0, ()))
    heapq.heapify(frontier)
    while frontier:
        j = heapq.heappop(frontier)
        a, b = nodes[j]
        if (a in reached) == (b in reached):
            continue
        forward = int(a in reached)
        in_tree.add(j)
        tree.append([j, forward])
        new = b if forward else a
        reached.add(new)
        for other in joints[new]:
            heapq.heappush(frontier, other)
    return tree, [j for j in range(len(nodes)) if j not in in_tree]


def _leaf_links(
    template: Template, tree: list[list[int]], nodes: list[tuple[int, int]]
) -> tuple[tuple[int, np.ndarray], ...]:
    """Links held by leaf springs only, in order of placing, each with its neighbours that are placed before.

    Raises KinematicsError for a link that is not connected to ground.
    """
    scene_layout = template.scene_layout
    placed = {0, *(nodes[j][forward] for j, forward in tree)}
    pairs = [(a, b) for _, a, b, _ in scene_layout.parts[len(scene_layout.joints) :]]
    links = []
    while True:
        placed_neighbours: dict[int, list[int]] = {}
        for a, b in (*pairs, *((b, a) for a, b in pairs)):
            if a in placed and b not in placed and a not in placed_neighbours.setdefault(b, []):
                placed_neighbours[b].append(a)
        if not placed_neighbours:
            break
        # the link with most placed neighbours first
        link = max(placed_neighbours, key=lambda k: (len(placed_neighbours[k]), -k))
        placed.add(link)
        links.append((link, np.array(placed_neighbours[link], np.int64)))
    unconnected = [link for i, link in enumerate(scene_layout.links) if i not in placed]
    if unconnected:
        raise KinematicsError(
            f"link '{unconnected[0]}' is not connected to ground by joints or leaves, so the kinematic start cannot place "
            "it; hinges alone do not: use method='conventional'"
        )
    return tuple(links)


def place_leaf_links(bodies: JointBodies, motion: State) -> None:
    """Place links held by leaf springs only at the mean of where each neighbour, moved as one body with them, would put
    them."""
    rest, arrays = bodies.reduced_rest, bodies.reduced
    counted = node_rotations(arrays, motion)
    for link, neighbours in bodies.leaf_links:
        counted[link] = counted[neighbours].mean(axis=0)
        rotations = motion.R[neighbours].sum(axis=0)
        moved = np.einsum("kij,kj->ki", motion.R[neighbours], rest.x[link] - rest.x[neighbours])
        motion.x[link] = (motion.x[neighbours] + moved).mean(axis=0)
        # rotation nearest to the mean of the neighbours' rotations
        u, _, v = np.linalg.svd(rotations)
        motion.R[link] = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v
    # step 1 has counted the angles between the other links
    pairs = np.concatenate([arrays.terms.node, arrays.springs.node])
    own = np.flatnonzero(np.isin(pairs, [link for link, _ in bodies.leaf_links]).any(axis=1))
    if len(own):
        again = motion._replace(angle=np.zeros(len(motion.angle)))
        count_from_links(arrays, again, counted)
        motion.angle[own] = again.angle[own]


class JointLayout:
    """Integers of the joint bodies of all models of a template, with the records of its distinct joints.

    Call it with the numbers of D designs. Raises KinematicsError where joints and leaf springs do not place every link.
    """

    def __init__(self, template: Template, records: Sequence[Record]) -> None:
        self.template, self.records = template, tuple(records)
        scene_layout, mesh = template.scene_layout, template.mesh
        joints = scene_layout.parts[: len(scene_layout.joints)]
        self.nodes = [(a, b) for _, a, b, _ in joints]
        self.distinct = [u for *_, u in joints]
        trained = "strain" if mesh.leaf == "strain" else mesh.elements
        self.polynomials = [
            MotionPolynomials(record, trained, len(part.leaves))
            for record, part in zip(records, scene_layout.distinct_parts, strict=False)
        ]
        self.first_row = np.cumsum([0] + [p.rows for p in self.polynomials]).tolist()
        self._build_kinematics()
        self._build_substructures()
        self._build_reduced()
        names, ranges, lengths = [], [], []
        for name, u in zip(scene_layout.joints, self.distinct, strict=True):
            motions = scene_layout.distinct_parts[u].motions
            for motion, kind in motions:
                names.append(name if len(motions) == 1 else f"{name}.{motion}")
                lengths.append(u if kind == "translation" else -1)
            ranges.append(records[u].motion_range)
        self.motion_names, self.motion_length = tuple(names), np.array(lengths, int)
        self.motion_range = np.concatenate(ranges).reshape(-1, 2)
        self.first_member = np.array([s.start for s in template.joint_members], int)

    def _build_kinematics(self) -> None:
        """Integers of the kinematics."""
        tree, closing = _spanning_tree(self.nodes)
        power = [self.polynomials[u].powers for u in self.distinct]
        none = np.zeros(0)
        self.kinematics = JointKinematics(
            node=np.array(self.nodes, np.int64).reshape(-1, 2), anchor=none, frame=none, length=none,
            first=np.cumsum([0] + [p.shape[1] for p in power]).astype(np.int64),
            tree=np.array(tree, np.int64).reshape(-1, 2), closing=np.array(closing, np.int64),
            power_first=np.cumsum([0] + [len(p) for p in power]).astype(np.int64),
            power=np.concatenate([np.pad(p, [(0, 0), (0, 2 - p.shape[1])]) for p in power]).astype(np.int64),
            pose=none,
        )  # fmt: skip
        first = np.array([self.first_row[u] for u in self.distinct])
        self.pose_rows = first[:, None] + np.arange(6)
        self.leaf_links = _leaf_links(self.template, tree, self.nodes)

    def _build_substructures(self) -> None:
        """Integers of the substructures; their nodes are ground, the internal blocks, then the interfaces B of all
        joints."""
        template, scene_layout = self.template, self.template.scene_layout
        blocks = sum(len(scene_layout.distinct_parts[u].blocks) for u in self.distinct)
        shapes, joint, rows, full_node = [], [], [], []
        node = 1
        for j, u in enumerate(self.distinct):
            part, nodes = scene_layout.distinct_parts[u], {"A": 0, "B": 1 + blocks + j}
            for k, block in enumerate(part.blocks):
                nodes[block] = node
                node += 1
                joint.append(j)
                rows.append(self.first_row[u] + 6 + 6 * k + np.arange(6))
                full_node.append(template.node_of[j][block])
            first = template.joint_members[j].start
            for n, leaf in enumerate(part.leaves):
                ends = nodes[leaf.ends[0]], nodes[leaf.ends[1]]
                shapes.append(template.member_topologies[first + n]._replace(nodes=ends))
        self.substructures = topology_arrays(1 + blocks + len(self.nodes), shapes, last=len(self.nodes))
        self.leaf = template.member_leaf[: len(shapes)]
        if scene_layout.has_gravity and template.leaf_has_weight[self.leaf].any():
            self.substructures = self.substructures.replace(weight=np.zeros((len(shapes), LOAD_NUMBERS)))
        same = len(shapes) == len(template.member_topologies)
        # without other members the constants are those of the full model
        self.substructure_packed = (
            None if same else LeafPacking(template.leaf_layouts, self.leaf, self.substructures.members)
        )
        self.full_node = np.array(full_node, np.int64)
        self.block_rows = np.array(rows, np.int64).reshape(-1, 6)
        self._build_interior(np.array(joint, np.int64))

    def _build_interior(self, block_joint: np.ndarray) -> None:
        """Tables of the functions that set inner states (`inner_rows`) and near configurations (`near_rows`) of the
        substructures.

        Their five rows: joint, entry that is set, row among all functions, leaf, and kind of scale of every function.
        """
        template, scene_layout = self.template, self.template.scene_layout
        members = self.substructures.members
        functions_of_leaf: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        inner, near = [np.zeros((5, 0), np.int64)], [np.zeros((5, 0), np.int64)]
        near_length = np.zeros(len(self.leaf), np.int64)
        near_at = 0
        for j, u in enumerate(self.distinct):
            first, count = template.joint_members[j].start, len(scene_layout.distinct_parts[u].leaves)
            for i, f in enumerate(self.leaf[first : first + count].tolist(), start=first):
                if f not in functions_of_leaf:
                    functions_of_leaf[f] = self._leaf_functions(
                        u, i - first, int(members.kind[i]), members.number[i].tolist()
                    )
                row, target, scale = functions_of_leaf[f]
                is_chain = members.kind[i] == COROTATIONAL
                at = near_at if is_chain else int(members.inner_at[i])
                functions = np.array([np.full(len(row), j), at + target, row, np.full(len(row), f), scale])
                (near if is_chain else inner).append(functions)
                if is_chain:
                    near_length[i] = 3 * (2 * int(members.number[i, 0]) - 1)
                    near_at += int(near_length[i])
        self.near_lengths = near_length
        self.inner_rows, self.near_rows = np.concatenate(inner, axis=1), np.concatenate(near, axis=1)
        block_node = np.arange(1, 1 + len(block_joint))
        none = np.zeros(0)
        self.interior = InteriorFunctions(
            block_node, block_joint, none, self.inner_rows[0], self.inner_rows[1], none, self.near_rows[0],
            self.near_rows[1], none,
        )  # fmt: skip

    def _leaf_functions(
        self, u: int, n: int, kind: int, number: list[int]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Functions of leaf n of distinct joint u that are not zero, for a member of this kind with these settings.

        Returns their rows among all functions, the entries of its inner state (or near configuration), and their scales,
        UNIT_SCALE .. MOMENT_SCALE.
        """
        functions, part = self.polynomials[u], self.template.scene_layout.distinct_parts[u]
        first, scales = self.first_row[u] + 6 + 6 * len(part.blocks), []
        if kind == COROTATIONAL:
            size = 3 * (2 * number[0] - 1)
            row, target, scales = first + n * size + np.arange(size), np.arange(size), [UNIT_SCALE] * size
        else:
            trained, total = functions.orders, sum(functions.orders)
            rows, targets, row_at, target_at = [], [], 0, 0
            for axis in range(3):
                for k in range(min(trained[axis], number[axis])):
                    rows.append(first + n * total + row_at + k)
                    targets.append(target_at + k)
                    scales.append(INVERSE_LENGTH)
                row_at, target_at = row_at + trained[axis], target_at + number[axis]
            rows += [first + len(part.leaves) * total + 6 * n + r for r in range(6)]
            targets += [target_at + r for r in range(6)]
            scales += [FORCE_SCALE] * 3 + [MOMENT_SCALE] * 3
            row, target = np.array(rows), np.array(targets)
        nonzero = functions.nonzero[row - self.first_row[u]]
        return row[nonzero], target[nonzero], np.array(scales)[nonzero]

    def _build_reduced(self) -> None:
        """Integers of the reduced mechanism: joints as linear bodies, their weight as loads, other leaf springs
        unchanged."""
        template, scene_layout = self.template, self.template.scene_layout
        links, joints = len(scene_layout.links), len(self.nodes)
        linear_bodies = [
            MemberTopology(LINEAR, pair, (0,), 0, LINEAR_INNER, 0, -1 - j)
            for j, pair in enumerate(self.nodes)
        ]
        other_leaves = template.member_topologies[len(self.leaf) :]
        loads = list(scene_layout.loads)
        has_weight = scene_layout.has_gravity and bool(template.leaf_has_weight[self.leaf].any())
        load, in_joints = np.full(joints, -1), len(self.leaf)
        if has_weight:
            for j, own_members in enumerate(template.joint_members):
                a = self.nodes[j][0]
                if a > 0 and template.leaf_has_weight[template.member_leaf[own_members]].any():
                    load[j] = len(loads)
                    loads.append((a, False, False))
        joint_weights = JointWeights(template.member_part[:in_joints].astype(np.int64), load)
        self.joint_weights = joint_weights if has_weight else NO_JOINT_WEIGHTS
        springs = template.spring_topologies
        self.reduced = topology_arrays(
            links, [*linear_bodies, *other_leaves], scene_layout.rows, loads, springs
        )
        if len(template.pushed) or (
            scene_layout.has_gravity and template.leaf_has_weight[template.member_leaf[in_joints:]].any()
        ):
            self.reduced = self.reduced.replace(weight=np.zeros((joints + len(other_leaves), LOAD_NUMBERS)))
        self.reduced_packed = LeafPacking(
            template.leaf_layouts, template.member_leaf[len(self.leaf) :], self.reduced.members, joints
        )

    def _contract(
        self, numbers: SceneNumbers, shapes: Sequence[Sequence[Any]], *, extrapolate: bool
    ) -> np.ndarray:
        """All functions (D, rows, P) of the distinct joints."""
        functions = np.zeros(
            (len(numbers.leaf), self.first_row[-1], max(len(p.powers) for p in self.polynomials))
        )
        for p, at, own_shapes in zip(self.polynomials, self.first_row, shapes, strict=False):
            functions[:, at : at + p.rows, : len(p.powers)] = p(own_shapes, extrapolate=extrapolate)
        return functions

    def _fill_kinematics(
        self, numbers: SceneNumbers, designs: DesignArrays, pose: np.ndarray
    ) -> JointKinematics:
        """The kinematics of D designs; pose (D, J, 6, P): functions of the interfaces."""
        joints = len(self.nodes)
        anchor = designs.points[:, :joints] - designs.rest.x[:, self.kinematics.node]
        return self.kinematics._replace(
            anchor=anchor,
            frame=numbers.rotation[:, :joints],
            length=numbers.length[:, self.distinct],
            pose=pose,
        )

    def _motion_scale(self, numbers: SceneNumbers) -> np.ndarray:
        """Factors (D, motions) from theta to rad or m."""
        return np.where(self.motion_length < 0, 1.0, numbers.length[:, np.maximum(self.motion_length, 0)])

    def __call__(
        self,
        numbers: SceneNumbers,
        designs: DesignArrays,
        shapes: Sequence[Sequence[Any]],
        *,
        extrapolate: bool = False,
    ) -> JointBodies:
        """Joint bodies of D designs, every float with a leading axis over them.

        shapes: shape parameters of all designs, for each of the distinct joints. Raises RangeError, see
        `MotionPolynomials`.
        """
        functions = self._contract(numbers, shapes, extrapolate=extrapolate)
        kinematics = self._fill_kinematics(numbers, designs, functions.take(self.pose_rows, axis=1))
        scale = _scales(numbers, designs.leaves)
        interior = self.interior._replace(
            block_pose=functions.take(self.block_rows, axis=1),
            coefficient=functions.take(self.inner_rows[2], axis=1)
            * scale[:, self.inner_rows[3], self.inner_rows[4], None],
            near_coefficient=functions.take(self.near_rows[2], axis=1),
        )
        substructures, substructure_rest = self._fill_substructures(numbers, designs)
        reduced, reduced_rest = self._fill_reduced(numbers, designs, kinematics)
        return JointBodies(
            kinematics, interior, substructures, substructure_rest, reduced, reduced_rest, self.near_lengths, self.full_node,
            self.motion_range, self._motion_scale(numbers), self.motion_names, self.joint_weights, self.leaf_links,
        )  # fmt: skip

    def _fill_substructures(self, numbers: SceneNumbers, designs: DesignArrays) -> tuple[Arrays, State]:
        """The substructures of D designs and their undeformed state."""
        count, joints, leaf = len(numbers.leaf), len(self.nodes), self.leaf
        nodes, leaves, full = len(self.substructures.start), designs.leaves, designs.arrays.members
        x = np.zeros((count, nodes, 3))
        inside = self.template.block_point[: nodes - 1 - joints]
        x[:, 1 : nodes - joints] = numbers.point[:, inside]
        x[:, nodes - joints :] = numbers.interfaces[:, self.distinct, 1]
        ends, length = leaves.ends[:, leaf], leaves.length[:, leaf]
        if self.substructure_packed is None:
            value, inner = full.value, designs.rest.inner
        else:
            value, inner = self.substructure_packed.values(leaves, numbers.explicit)
        arrays = self.substructures.designs(count)
        write(
            arrays.members, offset=ends - x[:, arrays.members.node], frame=leaves.frame[:, leaf], value=value, length=length,
            stiffness_scale=leaves.stiffness_scale[:, leaf],
        )  # fmt: skip
        arrays.floats[:, 0] = np.maximum(largest_extent(x, ends), length.max(axis=1, initial=0.0))
        # global gravity; rotated into the axes of each joint before it is condensed
        if arrays.weight.size:
            arrays.weight[...] = designs.arrays.weight[:, : len(leaf)]
        rotations, angles = np.tile(np.eye(3), (count, nodes, 1, 1)), np.zeros((count, angle_count(arrays)))
        return arrays, State(x, rotations, inner, np.zeros((count, 0)), angles)

    def _fill_reduced(
        self, numbers: SceneNumbers, designs: DesignArrays, kinematics: JointKinematics
    ) -> tuple[Arrays, State]:
        """The reduced mechanism of D designs and its rest state."""
        count, links, in_joints = len(numbers.leaf), len(self.template.scene_layout.links), len(self.leaf)
        full, arrays = designs.arrays, self.reduced.designs(count)
        members = full.members
        value, inner = self.reduced_packed.values(designs.leaves, numbers.explicit)
        joint_stiffness_scale = np.maximum.reduceat(
            members.stiffness_scale[:, :in_joints], self.first_member, axis=1
        )

        def with_free(own: np.ndarray, free: np.ndarray) -> np.ndarray:
            return np.concatenate([own, free[:, in_joints:]], axis=1)

        x = designs.rest.x[:, :links]
        offset = with_free(kinematics.anchor, members.offset)
        lengths = with_free(kinematics.length, members.length)
        write(
            arrays.members, offset=offset, frame=with_free(np.stack([kinematics.frame] * 2, axis=2), members.frame),
            value=value, length=lengths, stiffness_scale=with_free(joint_stiffness_scale, members.stiffness_scale),
        )  # fmt: skip
        given = full.loads.point.shape[1]
        for name in ("point", "force", "moment"):
            getattr(arrays.loads, name)[:, :given] = getattr(full.loads, name)
        if len(self.joint_weights.owner):
            # the weights of the joints follow; step 2 sets the points where they act
            mass = np.add.reduceat(full.weight[:, :in_joints, 0], self.first_member, axis=1)
            arrays.loads.force[:, given:] = (
                mass[:, self.joint_weights.load >= 0, None] * numbers.gravity[:, None]
            )
        if arrays.weight.size:
            arrays.weight[:, : len(self.nodes), 1:4] = numbers.gravity[:, None]
            arrays.weight[:, len(self.nodes) :] = full.weight[:, in_joints:]
        copy_floats(full.terms, arrays.terms)
        copy_floats(full.springs, arrays.springs)
        extent = largest_extent(x, x[:, arrays.members.node] + offset)
        arrays.floats[:, 0] = np.maximum(extent, lengths.max(axis=1, initial=0.0))
        rotations = np.tile(np.eye(3), (count, links, 1, 1))
        multipliers, angles = (np.zeros((count, n)) for n in (len(arrays.terms.start), angle_count(arrays)))
        return arrays, State(x, rotations, inner, multipliers, angles)


def _scales(numbers: SceneNumbers, leaves: LeafGeometry) -> np.ndarray:
    """Scales (D, F, 4) of the functions of all leaf springs, see UNIT_SCALE .. MOMENT_SCALE."""
    L, bending = leaves.length, numbers.leaf[..., LEAF_E] * numbers.leaf[..., LEAF_IZ]
    return np.stack([np.ones_like(L), 1.0 / L, bending / L**2, bending / L], axis=2)


def joint_bodies_of_design(layout: JointLayout, bodies: JointBodies, d: int) -> JointBodies:
    """Joint bodies of design d of those that `layout` made."""
    return JointBodies(
        functions_of_design(bodies.kinematics, d), functions_of_design(bodies.interior, d),
        bodies.substructures.design(d), state_of_design(bodies.substructure_rest, d),
        bodies.reduced.design(d), state_of_design(bodies.reduced_rest, d), bodies.near_lengths,
        bodies.full_node, bodies.motion_range, bodies.motion_scale[d], bodies.motion_names, bodies.joint_weights,
        bodies.leaf_links,
    )  # fmt: skip


def joint_layout(template: Template, joints: Sequence[Any], records: Callable[[str], Record]) -> JointLayout:
    """The layout of a template with the records of its distinct joints; the last one is reused while the records are
    the same.

    Raises SceneError without joints, RecordError for a record of another joint and for a nodal mesh, and what
    `JointLayout` raises.
    """
    if template.mesh.nodal:
        raise RecordError(
            "mesh nodal=True makes every element a part of its own, which joints are not condensed from; use "
            "method='conventional', or leave nodal out"
        )
    if not joints:
        raise SceneError(
            "this mechanism has no catalogue joints, so there is nothing to reduce; use method='conventional'"
        )
    mesh = "strain" if template.mesh.leaf == "strain" else template.mesh.elements
    joint_records = [records(joint.family) for joint in joints]
    for joint, record in zip(joints, joint_records, strict=True):
        check_record(joint, record, mesh)
    layout = template.joint_layout
    if layout is None or any(a is not b for a, b in zip(layout.records, joint_records, strict=True)):
        layout = template.joint_layout = JointLayout(template, joint_records)
    return layout


def joint_bodies(model: Model, records: Callable[[str], Record], *, extrapolate: bool = False) -> JointBodies:
    """Bodies of every joint of `model`; `records(family)` returns the trained record.

    Raises SceneError without joints, RangeError for a shape outside the trained range (unless `extrapolate`),
    KinematicsError where joints and leaf springs do not place every link.
    """
    source = model_source(model)
    joints = source.split.joints
    layout, shapes = joint_layout(source.template, joints, records), [[joint.shape()] for joint in joints]
    return joint_bodies_of_design(
        layout, layout(source.numbers, source.design_arrays, shapes, extrapolate=extrapolate), 0
    )
