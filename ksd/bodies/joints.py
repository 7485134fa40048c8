"""The joint bodies of a model: the kinematic loops, the joints apart from each other (substructures), the reduced mechanism.

Everything is frozen arrays; a solve only brings its own `Motion` and `Work`. The database enters here and nowhere
else: records are contracted with the shape of each joint, leaving polynomials in the intended motions. Integers are laid out
once for all models of the same words (`JointLayout`), numbers come for many designs at once.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from ksd.beam.linear import LINEAR_INNER
from ksd.bodies.joint_arrays import FlatArrays, InteriorFunctions, JointKinematics
from ksd.bodies.polynomials import Polynomials
from ksd.bodies.weight import NO_JOINT_WEIGHTS, JointWeights
from ksd.errors import KinematicsError, RecordError, SceneError
from ksd.library import Record
from ksd.model.arrays import COROTATIONAL, LINEAR, Arrays, State
from ksd.model.compile import Model, model_source
from ksd.model.pack import (
    LOAD_FLOATS,
    MEMBER_FLOATS,
    TERM_FLOATS,
    MemberTopology,
    largest_extent,
    topology_arrays,
)
from ksd.model.scene_layout import SceneNumbers
from ksd.model.template import (
    DesignArrays,
    LeafGeometry,
    LeafPacking,
    Template,
    arrays_of_design,
    fields_of_design,
    repeat_fields,
    state_of_design,
)
from ksd.scene.joint import DrawnJoint, joint_leaves, joint_proportions

T = TypeVar("T", JointKinematics, InteriorFunctions)
LOOP_FLOATS = ("anchor", "frame", "length", "pose")
INSIDE_FLOATS = ("block_pose", "coefficient", "near_coefficient")
"""Their fields of numbers, in order."""
ONE, INVERSE, FORCE, MOMENT = 0, 1, 2, 3
"""What functions of the insides are multiplied by: 1, 1/L, EIz/L^2, EIz/L of their leaf."""
REDRAWN = 1e-3
"""Difference of proportions from which a drawn joint is another one; smaller ones the error figure tells."""


@dataclass(frozen=True)
class JointBodies:
    """All joints of a model as bodies: `loops` answers allow, `inside` inside, `substructures` resist.

    reduced: the mechanism of links and condensed joints (its members: one linear body per joint, then free leaf springs).
    near (members of the substructures,): lengths of the near data. full_node (K,): internal blocks in the full model.
    motion_range (motions, 2): trained range, rad or stroke over joint length, as theta; motion_scale (motions,):
    theta to rad or m; motion_names. hung: the weight of the joints. hanging: links on leaves alone, each with the nodes
    that place it (`place_leaf_links`).
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
    """Tree from ground, of the joints that come first: (joint, forward) in order, and the joints left to close loops."""
    joints: dict[int, list[int]] = {}
    for j, pair in enumerate(nodes):
        for node in pair:
            joints.setdefault(node, []).append(j)
    reached, tree, used = {0}, [], set()
    next_ones = list(joints.get(0, ()))
    heapq.heapify(next_ones)
    while next_ones:
        j = heapq.heappop(next_ones)
        a, b = nodes[j]
        if (a in reached) == (b in reached):
            continue
        forward = int(a in reached)
        used.add(j)
        tree.append([j, forward])
        new = b if forward else a
        reached.add(new)
        for other in joints[new]:
            heapq.heappush(next_ones, other)
    return tree, [j for j in range(len(nodes)) if j not in used]


def _leaf_links(
    template: Template, tree: list[list[int]], nodes: list[tuple[int, int]]
) -> tuple[tuple[int, np.ndarray], ...]:
    """Links that hang on leaf springs alone, each with the nodes next to it that are placed before, in order of placing.

    Raises KinematicsError for a link nothing leads to.
    """
    words = template.scene_layout
    reached = {0, *(nodes[j][forward] for j, forward in tree)}
    pairs = [(a, b) for _, a, b, _ in words.parts[len(words.joints) :]]
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
    lost = [link for i, link in enumerate(words.links) if i not in reached]
    if lost:
        raise KinematicsError(
            f"link '{lost[0]}' is not connected to ground by joints or leaves, so the kinematic start cannot place it; "
            "add a joint"
        )
    return tuple(found)


def place_leaf_links(bodies: JointBodies, motion: State) -> None:
    """Place links that hang on leaves alone where their neighbours, moved as one body each, would have them in the mean."""
    rest = bodies.reduced_rest
    for link, near in bodies.leaf_links:
        turned = motion.R[near].sum(axis=0)
        moved = np.einsum("kij,kj->ki", motion.R[near], rest.x[link] - rest.x[near])
        motion.x[link] = (motion.x[near] + moved).mean(axis=0)
        # the rotation nearest to the mean of the neighbours' rotations
        u, _, v = np.linalg.svd(turned)
        motion.R[link] = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v


class JointLayout:
    """Integers of the joint bodies of all models of a template, with the records of its different joints; call it with
    numbers of D designs. Raises KinematicsError when joints alone do not place every link."""

    def __init__(self, template: Template, records: Sequence[Record]) -> None:
        self.template, self.records = template, tuple(records)
        words, mesh = template.scene_layout, template.mesh
        joints = words.parts[: len(words.joints)]
        self.nodes = [(a, b) for _, a, b, _ in joints]
        self.different = [u for *_, u in joints]
        trained = "strain" if mesh.leaf == "strain" else mesh.elements
        self.polynomials = [
            Polynomials(record, trained, len(part.leaves))
            for record, part in zip(records, words.distinct_parts, strict=False)
        ]
        self.rows = np.cumsum([0] + [p.rows for p in self.polynomials]).tolist()
        self._lay_loops()
        self._lay_substructures()
        self._lay_reduced()
        names, ranges, lengths = [], [], []
        for name, u in zip(words.joints, self.different, strict=True):
            motions = words.distinct_parts[u].motions
            for motion, kind in motions:
                names.append(name if len(motions) == 1 else f"{name}.{motion}")
                lengths.append(u if kind == "translation" else -1)
            ranges.append(records[u].motion_range)
        self.motion_names, self.motion_length = tuple(names), np.array(lengths, int)
        self.motion_range = np.concatenate(ranges).reshape(-1, 2)
        self.first_member = np.array([s.start for s in template.joint_members], int)

    def _lay_loops(self) -> None:
        """Integers of the kinematics."""
        tree, closing = _spanning_tree(self.nodes)
        power = [self.polynomials[u].powers for u in self.different]
        none = np.zeros(0)
        self.kinematics = JointKinematics(
            node=np.array(self.nodes, np.int64).reshape(-1, 2), anchor=none, frame=none, length=none,
            first=np.cumsum([0] + [p.shape[1] for p in power]).astype(np.int64),
            tree=np.array(tree, np.int64).reshape(-1, 2), closing=np.array(closing, np.int64),
            power_first=np.cumsum([0] + [len(p) for p in power]).astype(np.int64),
            power=np.concatenate([np.pad(p, [(0, 0), (0, 2 - p.shape[1])]) for p in power]).astype(np.int64),
            pose=none,
        )  # fmt: skip
        first = np.array([self.rows[u] for u in self.different])
        self.pose_rows = first[:, None] + np.arange(6)
        self.leaf_links = _leaf_links(self.template, tree, self.nodes)

    def _lay_substructures(self) -> None:
        """Integers of the joints apart: nodes are ground, internal blocks, then the interfaces B of all joints."""
        template, words = self.template, self.template.scene_layout
        blocks = sum(len(words.distinct_parts[u].blocks) for u in self.different)
        shapes, joint, rows, full_node = [], [], [], []
        node = 1
        for j, u in enumerate(self.different):
            part, nodes = words.distinct_parts[u], {"A": 0, "B": 1 + blocks + j}
            for k, block in enumerate(part.blocks):
                nodes[block] = node
                node += 1
                joint.append(j)
                rows.append(self.rows[u] + 6 + 6 * k + np.arange(6))
                full_node.append(template.node_of[j][block])
            first = template.joint_members[j].start
            for n, leaf in enumerate(part.leaves):
                ends = nodes[leaf.ends[0]], nodes[leaf.ends[1]]
                shapes.append(template.shapes[first + n]._replace(nodes=ends))
        self.substructures = topology_arrays(1 + blocks + len(self.nodes), shapes, last=len(self.nodes))
        self.leaf = template.leaf[: len(shapes)]
        if words.has_gravity and template.heavy[self.leaf].any():
            self.substructures = self.substructures._replace(weight=np.zeros((len(shapes), 4)))
        same = len(shapes) == len(template.shapes)
        # the constants of the full model where it has no other members
        self.substructure_packed = (
            None if same else LeafPacking(template.leaf_layouts, self.leaf, self.substructures.members)
        )
        self.full_node = np.array(full_node, np.int64)
        self.block_rows = np.array(rows, np.int64).reshape(-1, 6)
        self._lay_inside(np.array(joint, np.int64))

    def _lay_inside(self, block_joint: np.ndarray) -> None:
        """Which functions go where in the states of the substructures, and with which scale of which leaf."""
        template, words = self.template, self.template.scene_layout
        members = self.substructures.members
        made: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        inner, near = [np.zeros((5, 0), np.int64)], [np.zeros((5, 0), np.int64)]
        near_length = np.zeros(len(self.leaf), np.int64)
        base = 0
        for j, u in enumerate(self.different):
            first, count = template.joint_members[j].start, len(words.distinct_parts[u].leaves)
            for i, f in enumerate(self.leaf[first : first + count].tolist(), start=first):
                if f not in made:
                    made[f] = self._functions(u, i - first, int(members.kind[i]), members.number[i].tolist())
                row, to, kind = made[f]
                chain = members.kind[i] == COROTATIONAL
                at = base if chain else int(members.inner_at[i])
                found = np.array([np.full(len(row), j), at + to, row, np.full(len(row), f), kind])
                (near if chain else inner).append(found)
                if chain:
                    near_length[i] = 3 * (2 * int(members.number[i, 0]) - 1)
                    base += int(near_length[i])
        self.near_lengths = near_length
        self.inner_rows, self.near_rows = np.concatenate(inner, axis=1), np.concatenate(near, axis=1)
        block_node = np.arange(1, 1 + len(block_joint))
        none = np.zeros(0)
        self.interior = InteriorFunctions(
            block_node, block_joint, none, self.inner_rows[0], self.inner_rows[1], none, self.near_rows[0],
            self.near_rows[1], none,
        )  # fmt: skip

    def _functions(
        self, u: int, n: int, kind: int, number: list[int]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(row, place in its inner state, or near rotations of a chain, scale) of the functions of leaf n of joint u."""
        functions, part = self.polynomials[u], self.template.scene_layout.distinct_parts[u]
        first, scales = self.rows[u] + 6 + 6 * len(part.blocks), []
        if kind == COROTATIONAL:
            size = 3 * (2 * number[0] - 1)
            row, to, scales = first + n * size + np.arange(size), np.arange(size), [ONE] * size
        else:
            theirs, total, rows, places, given, wanted = functions.orders, sum(functions.orders), [], [], 0, 0
            for axis in range(3):
                for k in range(min(theirs[axis], number[axis])):
                    rows.append(first + n * total + given + k)
                    places.append(wanted + k)
                    scales.append(INVERSE)
                given, wanted = given + theirs[axis], wanted + number[axis]
            rows += [first + len(part.leaves) * total + 6 * n + r for r in range(6)]
            places += [wanted + r for r in range(6)]
            scales += [FORCE] * 3 + [MOMENT] * 3
            row, to = np.array(rows), np.array(places)
        there = functions.there[row - self.rows[u]]
        return row[there], to[there], np.array(scales)[there]

    def _lay_reduced(self) -> None:
        """Integers of the reduced mechanism: every joint one linear body and its weight a load, free leaves as they are."""
        template, words = self.template, self.template.scene_layout
        links, joints = len(words.links), len(self.nodes)
        own = [
            MemberTopology(LINEAR, pair, (0,), 0, LINEAR_INNER, 0, -1 - j)
            for j, pair in enumerate(self.nodes)
        ]
        free = template.shapes[len(self.leaf) :]
        loads = list(words.loads)
        weigh = words.has_gravity and bool(template.heavy[self.leaf].any())
        load, held = np.full(joints, -1), len(self.leaf)
        if weigh:
            for j, own_members in enumerate(template.joint_members):
                a = self.nodes[j][0]
                if a > 0 and template.heavy[template.leaf[own_members]].any():
                    load[j] = len(loads)
                    loads.append((a, False, False))
        hung = JointWeights(template.part[:held].astype(np.int64), load)
        self.joint_weights = hung if weigh else NO_JOINT_WEIGHTS
        springs = template.spring_shapes
        self.reduced = topology_arrays(links, [*own, *free], words.rows, loads, springs)
        if words.has_gravity and template.heavy[template.leaf[held:]].any():
            self.reduced = self.reduced._replace(weight=np.zeros((joints + len(free), 4)))
        self.reduced_packed = LeafPacking(
            template.leaf_layouts, template.leaf[len(self.leaf) :], self.reduced.members, joints
        )

    def _stack(self, n: SceneNumbers, shapes: Sequence[Sequence[Any]], *, extrapolate: bool) -> np.ndarray:
        """All functions (D, rows, P) of the different joints."""
        stack = np.zeros((len(n.leaf), self.rows[-1], max(len(p.powers) for p in self.polynomials)))
        for p, at, own in zip(self.polynomials, self.rows, shapes, strict=False):
            stack[:, at : at + p.rows, : len(p.powers)] = p(own, extrapolate=extrapolate)
        return stack

    def _fill_loops(self, n: SceneNumbers, filled: DesignArrays, pose: np.ndarray) -> JointKinematics:
        """The kinematics of D designs; pose (D, J, 6, P): functions of the interfaces."""
        joints = len(self.nodes)
        anchor = filled.points[:, :joints] - filled.rest.x[:, self.kinematics.node]
        return self.kinematics._replace(
            anchor=anchor, frame=n.rotation[:, :joints], length=n.length[:, self.different], pose=pose
        )

    def _motion_scale(self, n: SceneNumbers) -> np.ndarray:
        """(D, motions): theta to rad or m."""
        return np.where(self.motion_length < 0, 1.0, n.length[:, np.maximum(self.motion_length, 0)])

    def __call__(
        self,
        n: SceneNumbers,
        filled: DesignArrays,
        shapes: Sequence[Sequence[Any]],
        *,
        extrapolate: bool = False,
    ) -> JointBodies:
        """Joint bodies of D designs, every float with a leading axis over them; shapes: shape parameters of all designs for
        each of the different joints. Raises RangeError, see `Polynomials`."""
        stack = self._stack(n, shapes, extrapolate=extrapolate)
        loops = self._fill_loops(n, filled, stack.take(self.pose_rows, axis=1))
        scale = _scales(n, filled.leaves)
        inside = self.interior._replace(
            block_pose=stack.take(self.block_rows, axis=1),
            coefficient=stack.take(self.inner_rows[2], axis=1)
            * scale[:, self.inner_rows[3], self.inner_rows[4], None],
            near_coefficient=stack.take(self.near_rows[2], axis=1),
        )
        substructures, substructure_rest = self._fill_substructures(n, filled)
        reduced, reduced_rest = self._fill_reduced(n, filled, loops)
        return JointBodies(
            loops, inside, substructures, substructure_rest, reduced, reduced_rest, self.near_lengths, self.full_node,
            self.motion_range, self._motion_scale(n), self.motion_names, self.joint_weights, self.leaf_links,
        )  # fmt: skip

    def _fill_substructures(self, n: SceneNumbers, filled: DesignArrays) -> tuple[Arrays, State]:
        """The substructures of D designs and their undeformed state."""
        count, joints, leaf = len(n.leaf), len(self.nodes), self.leaf
        nodes, leaves, full = len(self.substructures.start), filled.leaves, filled.arrays.members
        x = np.zeros((count, nodes, 3))
        inside = self.template.block_point[: nodes - 1 - joints]
        x[:, 1 : nodes - joints] = n.point[:, inside]
        x[:, nodes - joints :] = n.ends[:, self.different, 1]
        ends, length = leaves.ends[:, leaf], leaves.length[:, leaf]
        if self.substructure_packed is None:
            value, inner = full.value, filled.rest.inner
        else:
            value, inner = self.substructure_packed.values(leaves, n.given)
        members = self.substructures.members._replace(
            offset=ends - x[:, self.substructures.members.node],
            frame=leaves.frame[:, leaf],
            value=value,
            length=length,
            floor=leaves.floor[:, leaf],
        )
        extent = np.maximum(largest_extent(x, ends), length.max(axis=1, initial=0.0))
        # gravity as given; turned into the axes of every joint before it is condensed
        weight = filled.arrays.weight[:, : len(leaf)]
        topology = self.substructures
        arrays = topology._replace(
            members=members,
            terms=repeat_fields(topology.terms, TERM_FLOATS, count),
            loads=repeat_fields(topology.loads, LOAD_FLOATS, count),
            size=extent,
            springs=repeat_fields(topology.springs, MEMBER_FLOATS, count),
            weight=weight if len(topology.weight) else weight[:, :0],
        )
        return arrays, State(x, np.tile(np.eye(3), (count, nodes, 1, 1)), inner, np.zeros((count, 0)))

    def _fill_reduced(
        self, n: SceneNumbers, filled: DesignArrays, loops: JointKinematics
    ) -> tuple[Arrays, State]:
        """The reduced mechanism of D designs and its rest state."""
        count, links, held = len(n.leaf), len(self.template.scene_layout.links), len(self.leaf)
        full, topology = filled.arrays, self.reduced
        members = full.members
        value, inner = self.reduced_packed.values(filled.leaves, n.given)
        joint_floor = np.maximum.reduceat(members.floor[:, :held], self.first_member, axis=1)

        def joined(own: np.ndarray, free: np.ndarray) -> np.ndarray:
            return np.concatenate([own, free[:, held:]], axis=1)

        x = filled.rest.x[:, :links]
        offset, lengths = joined(loops.anchor, members.offset), joined(loops.length, members.length)
        made = topology.members._replace(
            offset=offset, frame=joined(np.stack([loops.frame] * 2, axis=2), members.frame), value=value,
            length=lengths, floor=joined(joint_floor, members.floor),
        )  # fmt: skip
        loads = full.loads
        if len(self.joint_weights.owner):
            loads = self._hang(n, filled)
        weight = full.weight
        if weight.shape[1]:
            free = weight[:, held:]
            linear = np.zeros((count, len(self.nodes), 4))
            linear[..., 1:] = n.gravity[:, None]
            weight = np.concatenate([linear, free], axis=1) if len(topology.weight) else weight[:, :0]
        arrays = topology._replace(
            members=made,
            terms=topology.terms._replace(
                coefficient=full.terms.coefficient, direction=full.terms.direction, point=full.terms.point
            ),
            loads=topology.loads._replace(point=loads.point, force=loads.force, moment=loads.moment),
            size=np.maximum(largest_extent(x, x[:, made.node] + offset), lengths.max(axis=1, initial=0.0)),
            springs=full.springs,
            weight=weight,
        )  # fmt: skip
        turned = np.tile(np.eye(3), (count, links, 1, 1))
        return arrays, State(x, turned, inner, np.zeros((count, len(topology.terms.start))))

    def _hang(self, n: SceneNumbers, filled: DesignArrays) -> Any:
        """Loads with those that stand for the weight of the joints, at points that step 2 sets."""
        loads, mass = filled.arrays.loads, filled.arrays.weight[:, : len(self.leaf), 0]
        joint_mass = np.add.reduceat(mass, self.first_member, axis=1)[:, self.joint_weights.load >= 0]
        force = joint_mass[..., None] * n.gravity[:, None]
        none = np.zeros_like(force)
        return loads._replace(
            point=np.concatenate([loads.point, none], axis=1),
            force=np.concatenate([loads.force, force], axis=1),
            moment=np.concatenate([loads.moment, none], axis=1),
        )


def _scales(n: SceneNumbers, leaves: LeafGeometry) -> np.ndarray:
    """(D, F, 4): what functions of the insides are multiplied by, see ONE .. MOMENT."""
    L, bending = leaves.length, n.leaf[..., 10] * n.leaf[..., 15]
    return np.stack([np.ones_like(L), 1.0 / L, bending / L**2, bending / L], axis=2)


def joint_bodies_of_design(layout: JointLayout, bodies: JointBodies, d: int) -> JointBodies:
    """Joint bodies of design d of many that were made by `layout`."""
    return JointBodies(
        _of_design(bodies.kinematics, LOOP_FLOATS, d), _of_design(bodies.interior, INSIDE_FLOATS, d),
        arrays_of_design(bodies.substructures, layout.substructures, d), state_of_design(bodies.substructure_rest, d),
        arrays_of_design(bodies.reduced, layout.reduced, d), state_of_design(bodies.reduced_rest, d), bodies.near_lengths,
        bodies.full_node, bodies.motion_range, bodies.motion_scale[d], bodies.motion_names, bodies.joint_weights,
        bodies.leaf_links,
    )  # fmt: skip


def _of_design(part: T, names: Sequence[str], d: int) -> T:
    """JointKinematics, or insides, of design d of many, the numbers that kernels read joined for all designs at once."""
    repeat_fields: Any = part
    found = fields_of_design(repeat_fields, names, d)
    joined = repeat_fields.__dict__.get("joined")
    if joined is None:
        fields = [getattr(repeat_fields, name) for name in names]
        floats = np.concatenate([field.reshape(len(field), -1) for field in fields], axis=1)
        joined = repeat_fields.__dict__["joined"] = found.flat.ints, floats
    found.flat = FlatArrays(joined[0], joined[1][d])
    return found


def _check_record(joint: Any, record: Record, mesh: str | int) -> None:
    """RecordError for a record of another joint, and for a chain it cannot stand for."""
    leaves = joint_leaves(joint)
    inner = [name for name in joint.blocks() if name not in ("A", "B")]
    counts = [
        (len(leaves), len(record.leaves), "leaf springs"),
        (len(inner), len(record.blocks), "internal blocks"),
        (len(joint.motions), len(record.motions), "motions"),
    ]
    for here, there, what in counts:
        if here != there:
            raise RecordError(
                f"the record of {joint.family} is of a joint with {there} {what}, this one has {here}; give your joint a "
                "family name of its own and train it with ksd.train(joint)"
            )
    check_proportions(joint, record)
    if mesh in record.functions or all(leaf.profile is None and leaf.curve is None for leaf in leaves):
        return
    known = ", ".join(str(n) for n in record.functions)
    raise RecordError(
        f"the record of {joint.family} has no chains of {mesh} elements, and its leaves are not straight and uniform, "
        f"so none can be derived; use one of its meshes ({known}) or train it with meshes=(..., {mesh})"
    )


def check_proportions(joint: Any, record: Record) -> None:
    """RecordError for a joint drawn in other proportions than the one its record is of."""
    for what, own in joint_proportions(joint).items() if isinstance(joint, DrawnJoint) else ():
        theirs = record.design.get(what, own)
        if abs(own - theirs) > REDRAWN * max(1.0, abs(own)):
            raise RecordError(
                f"the record of {joint.family} is of a joint drawn in other proportions ({what}: {theirs:.6g} there, "
                f"{own:.6g} here, lengths over that of the joint); give your joint a family name of its own and train it "
                "with ksd.train(joint), or give method='conventional'"
            )


def joint_layout(template: Template, joints: Sequence[Any], records: Callable[[str], Record]) -> JointLayout:
    """The layout of a template with the records of its different joints, that of the last call where they are the same.

    Raises SceneError without joints, RecordError for a record of another joint and for a nodal mesh, and what `JointLayout`
    raises.
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
    found = [records(joint.family) for joint in joints]
    for joint, record in zip(joints, found, strict=True):
        _check_record(joint, record, mesh)
    last = template.joint_layout
    if last is None or any(a is not b for a, b in zip(last.records, found, strict=True)):
        last = template.joint_layout = JointLayout(template, found)
    return last


def joint_bodies(model: Model, records: Callable[[str], Record], *, extrapolate: bool = False) -> JointBodies:
    """Bodies of every joint of `model`; `records(family)` returns the trained record.

    Raises SceneError without joints, RangeError for a shape outside the trained range (unless `extrapolate`),
    KinematicsError when joints alone do not place every link.
    """
    made = model_source(model)
    joints = made.drawing.joints
    layout, shapes = joint_layout(made.template, joints, records), [[joint.shape()] for joint in joints]
    return joint_bodies_of_design(
        layout, layout(made.numbers, made.filled, shapes, extrapolate=extrapolate), 0
    )
