"""Models of all scenes with one layout: integers are made once, floats for many designs at once.

Every float array of `Arrays` and of the undeformed state has a leading axis over D designs here; a single design is D = 1.
`Arrays.design` and `state_of_design` take out one design.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ksd.elements import corotational_values as chains
from ksd.elements.strain_values import strain_sizes, strain_value_count, strain_values
from ksd.model.arrays import ALIGNMENT, LOAD_NUMBERS, STRAIN, Arrays, Members, State, angle_count, write
from ksd.model.leaves import leaf_axes
from ksd.model.mesh import Mesh
from ksd.model.pack import MemberTopology, largest_extent, topology_arrays
from ksd.model.scene_layout import (
    GEOMETRY_NUMBERS,
    LEAF_NUMBERS,
    SPRING_NUMBERS,
    LeafLayout,
    SceneLayout,
    SceneNumbers,
    number_slices,
)

Array = np.ndarray
SCALES = 19
"""Count of the scales of a leaf: 1, L; L GJ, L EIy, L EIz, 1/EA, 1/(ky GA), 1/(kz GA), L rho A of a strain-mode leaf;
length l, the six stiffness numbers, rho A l and rho A l^2 of an element of a chain; 1/L."""


class UnitConstants(NamedTuple):
    """Constants of a leaf with unit scales; entry i of a leaf is value[i] times its scale number scale[i]."""

    value: Array
    scale: Array


@lru_cache(maxsize=256)
def _unit_constants(kind: int, number: tuple[int, ...], heavy: bool) -> UnitConstants:
    """Constants of a straight uniform leaf with unit scales."""
    if kind == STRAIN:
        orders, points = number[:3], number[3]
        ones = np.ones(3)
        value, settings = strain_values(
            length=1.0, rigidity=ones, compliance=ones, orders=(orders[0], orders[1], orders[2]), points=points,
            line_mass=None,
        )  # fmt: skip
        total = sum(orders)
        scale = np.zeros(len(value), np.int64)
        scale[0] = 1
        squares = [n * n for n in orders]
        scale[1 : 1 + sum(squares)] = np.repeat([2, 3, 4], squares)
        soft = 1 + sum(squares) + total + points * (1 + points + total)
        scale[soft : soft + 3 * points] = np.tile([5, 6, 7], points)
        if heavy:
            ready, _ = strain_values(
                length=1.0, rigidity=ones, compliance=ones, orders=(orders[0], orders[1], orders[2]),
                points=points, line_mass=np.ones(points),
            )  # fmt: skip
            more = len(ready) - strain_value_count(settings)
            value, scale = ready, np.append(scale, np.full(more, 8))
        return UnitConstants(value, scale)
    n = number[0]
    value = np.concatenate([np.tile(np.append(np.ones(7), np.eye(3)), n), np.eye(3).ravel()])
    scale = np.concatenate([np.tile(np.append(np.arange(9, 16), np.zeros(9)), n), np.zeros(9)])
    if heavy:
        half = np.append(np.full(n, 0.5), 0.0) + np.append(0.0, np.full(n, 0.5))
        lever = np.array([1.0, 0.0, 0.0]) / 12
        value = np.concatenate([value, half, lever, -lever])
        scale = np.concatenate([scale, np.full(n + 1, 16), np.full(6, 17)])
    return UnitConstants(value, scale.astype(np.int64))


def _sizes(leaf: LeafLayout) -> tuple[int, int, int]:
    """Counts of the constants, inner coordinates and stored numbers of a leaf."""
    number = np.array([*leaf.number, 0, 0, 0], np.int64)
    if leaf.kind == STRAIN:
        inner, store = strain_sizes(number, has_weight=leaf.has_weight)
        constants = strain_value_count(number, has_weight=leaf.has_weight)
    else:
        constants, inner, store = chains.sizes(leaf.number[0], has_weight=leaf.has_weight)
    return (*leaf.explicit, store) if leaf.explicit else (constants, inner, store)


class LeafGeometry(NamedTuple):
    """Geometry and scales of the F distinct leaves of D designs, in the axes of their parts.

    ends (D, F, 2, 3) [m], frame (D, F, 2, 3, 3): ends and their axes; scale (D, F, SCALES); mass (D, F) [kg];
    stiffness_scale (D, F): EA/L [N/m]; length (D, F) [m].
    """

    ends: Array
    frame: Array
    scale: Array
    mass: Array
    stiffness_scale: Array
    length: Array


class LeafPacking:
    """How the constants and inner states of members follow from the numbers of leaves.

    layouts: of the F distinct leaves; leaf (m,): leaf of each member, from member `start` on.
    """

    def __init__(self, layouts: Sequence[LeafLayout], leaf: Array, members: Members, start: int = 0) -> None:
        at, scale = [], []
        done = set()
        explicit: list[tuple[Array, Array]] = []
        first = np.cumsum([0] + [w.explicit_count for w in layouts])
        rest, inner_at, inner_scale = np.zeros(int(members.inner_at[-1])), [], []
        explicit_inner: list[tuple[Array, Array]] = []
        self.value = np.zeros(len(members.value))
        for i, f in enumerate(leaf.tolist(), start=start):
            w, to, own = layouts[f], int(members.value_at[i]), int(members.inner_at[i])
            is_new, explicit_at = to not in done, int(first[f]) + GEOMETRY_NUMBERS
            done.add(to)
            if w.explicit is not None:
                explicit_inner.append(
                    (own + np.arange(w.explicit[1]), explicit_at + np.arange(w.explicit[1]))
                )
                if is_new:
                    explicit.append(
                        (
                            to + np.arange(w.explicit[0]),
                            explicit_at + w.explicit[1] + np.arange(w.explicit[0]),
                        )
                    )
                continue
            if w.amplitudes:
                amplitudes = explicit_at + np.arange(sum(w.amplitudes))
                axes = zip(np.cumsum([0, *w.number[:2]]), w.amplitudes, strict=True)
                bent = np.concatenate([k + np.arange(n) for k, n in axes])
                explicit_inner.append((own + bent, amplitudes))
                if is_new:
                    explicit.append((to + 1 + sum(n * n for n in w.number[:3]) + bent, amplitudes))
            if w.kind != STRAIN:
                n = w.number[0]
                nodes = own + chains.NODE_RECORD_SIZE * np.arange(n - 1)
                for c in (3, 7, 11):
                    rest[nodes + c] = 1.0
                rest[nodes] = np.arange(1, n)
                inner_at.append(nodes)
                inner_scale.append(np.full(n - 1, f * SCALES + 9))
            if not is_new:
                continue
            unit = _unit_constants(w.kind, w.number, w.has_weight)
            self.value[to : to + len(unit.value)] = unit.value
            varies = np.flatnonzero(unit.scale)
            at.append(to + varies)
            scale.append(f * SCALES + unit.scale[varies])
        self.at, self.scale = _joined(at), _joined(scale)
        self.inner, self.inner_at, self.inner_scale = rest, _joined(inner_at), _joined(inner_scale)
        self.explicit = _joined([a for a, _ in explicit]), _joined([b for _, b in explicit])
        self.explicit_inner = _joined([a for a, _ in explicit_inner]), _joined([b for _, b in explicit_inner])

    def values(self, leaves: LeafGeometry, explicit: Array) -> tuple[Array, Array]:
        """Constants (D, v) and undeformed inner states (D, s) of D designs; explicit: `SceneNumbers.explicit`."""
        count = len(leaves.scale)
        scale = leaves.scale.reshape(count, -1)
        value, inner = (fixed[None].repeat(count, axis=0) for fixed in (self.value, self.inner))
        value[:, self.at] *= scale[:, self.scale]
        if len(self.inner_at):
            inner[:, self.inner_at] *= scale[:, self.inner_scale]
        if len(self.explicit_inner[0]):
            value[:, self.explicit[0]] = explicit[:, self.explicit[1]]
            inner[:, self.explicit_inner[0]] = explicit[:, self.explicit_inner[1]]
        return value, inner


def _joined(parts: list[Array]) -> Array:
    """Arrays of indices joined; empty without any."""
    return np.concatenate([np.zeros(0, np.int64), *parts])


class DesignArrays(NamedTuple):
    """Models of D designs.

    arrays, rest: with a leading axis over designs in every float; leaves: their geometry; points (D, P, 2, 3) [m]: points A
    and B of all parts, global.
    """

    arrays: Arrays
    rest: State
    leaves: LeafGeometry
    points: Array


class Template:
    """What all models with one layout and mesh have in common; called with the numbers of D designs it packs them."""

    def __init__(self, layout: SceneLayout, mesh: Mesh) -> None:
        self.scene_layout, self.mesh = layout, mesh
        self.leaf_layouts = [leaf for part in layout.distinct_parts for leaf in part.leaves]
        self._name_nodes()
        self.member_topologies = self._list_members()
        self.spring_topologies = [
            MemberTopology(kind, nodes, (0,), values, 0, 0, i)
            for i, (_, kind, nodes, values) in enumerate(layout.springs)
        ]
        self.topology = topology_arrays(
            len(self.node_names), self.member_topologies, layout.rows, layout.loads, self.spring_topologies
        )
        self.packing = LeafPacking(self.leaf_layouts, self.member_leaf, self.topology.members)
        self.leaf_has_weight = np.array([w.has_weight for w in self.leaf_layouts], bool)
        self.elements = np.array([float(w.number[0]) for w in self.leaf_layouts])
        self.identity = np.tile(np.eye(3), (len(self.node_names), 1, 1))
        self.explicit_leaves = [f for f, w in enumerate(self.leaf_layouts) if w.explicit_count]
        pushed = [f for f, w in enumerate(self.leaf_layouts) if w.load_modes]
        # every free leaf is a part of its own, so a leaf with loads is one member
        self.pushed = np.array([self.member_leaf.tolist().index(f) for f in pushed], int)
        if pushed or (layout.has_gravity and self.leaf_has_weight.any()):
            self.topology = self.topology.replace(weight=np.zeros((len(self.member_leaf), LOAD_NUMBERS)))
        self._attach()
        terms, loads = self.topology.terms, self.topology.loads
        self.term_nodes, self.load_nodes = terms.node, loads.node
        self.is_point = terms.kind != ALIGNMENT
        sizes = [SPRING_NUMBERS + s[3] for s in layout.springs]
        self.spring_first = np.cumsum([0, *sizes])
        # set by ksd.joints.joints
        self.joint_layout: Any = None
        self._slices = number_slices(layout)
        self._on_mesh: dict[Mesh, Template | None] = {}

    def _name_nodes(self) -> None:
        """Number and name the nodes: links, then the blocks of every part."""
        layout = self.scene_layout
        names, block_part, block_point = list(layout.links), [], []
        first = np.cumsum([0] + [len(p.blocks) for p in layout.distinct_parts]).tolist()
        self.node_of: list[dict[str, int]] = []
        for p, (before, a, b, u) in enumerate(layout.parts):
            nodes = {"A": a, "B": b}
            for k, block in enumerate(layout.distinct_parts[u].blocks):
                nodes[block] = len(names)
                names.append(before + block)
                block_part.append(p)
                block_point.append(first[u] + k)
            self.node_of.append(nodes)
        self.node_names = tuple(names)
        self.block_part, self.block_point = np.array(block_part, int), np.array(block_point, int)
        self.distinct_of_part = np.array([p[3] for p in layout.parts], int)

    def _list_members(self) -> list[MemberTopology]:
        """Topologies of the members, the leaves of every part in turn; sets what is known of them, `member_names` to
        `member_part`."""
        layout = self.scene_layout
        topologies: list[MemberTopology] = []
        names, leaf, part, slices = [], [], [], []
        first = np.cumsum([0] + [len(p.leaves) for p in layout.distinct_parts]).tolist()
        sizes = [_sizes(w) for w in self.leaf_layouts]
        for p, (before, _, _, u) in enumerate(layout.parts):
            nodes, start = self.node_of[p], len(topologies)
            for n, w in enumerate(layout.distinct_parts[u].leaves):
                f = first[u] + n
                constants, inner, store = sizes[f]
                pair = nodes[w.ends[0]], nodes[w.ends[1]]
                topologies.append(MemberTopology(w.kind, pair, w.number, constants, inner, store, w.group))
                names.append(before + w.name)
                leaf.append(f)
                part.append(p)
            slices.append(slice(start, len(topologies)))
        self.member_names = tuple(names)
        self.joint_members = tuple(slices[: len(layout.joints)])
        self.member_leaf, self.member_part = np.array(leaf, int), np.array(part, int)
        return topologies

    def _attach(self) -> None:
        """List the points of parts attached to each link; their mean is its reference point, that of ground the origin."""
        links = [
            (link, 2 * p + e)
            for p, (_, *ends, _) in enumerate(self.scene_layout.parts)
            for e, link in enumerate(ends)
        ]
        links = sorted(pair for pair in links if pair[0] > 0)
        self.attached = np.array([point for _, point in links], int)
        self.attached_link, self.attached_first, count = np.unique(
            np.array([link for link, _ in links], int), return_index=True, return_counts=True
        )
        self.attached_count = count[:, None].astype(float)

    def __call__(self, n: SceneNumbers) -> DesignArrays:
        """Pack the models of D designs."""
        leaves = self.leaves(n)
        count, links = len(n.leaf), len(self.scene_layout.links)
        points = n.origin[:, :, None] + n.interfaces[:, self.distinct_of_part] @ n.rotation.swapaxes(2, 3)
        places = np.zeros((count, len(self.node_names), 3))
        if len(self.attached):
            flat = points.reshape(count, -1, 3)[:, self.attached]
            places[:, self.attached_link] = (
                np.add.reduceat(flat, self.attached_first, axis=1) / self.attached_count
            )
        if len(self.block_part):
            own = n.rotation[:, self.block_part] @ n.point[:, self.block_point, :, None]
            places[:, links:] = n.origin[:, self.block_part] + own[..., 0]
        topology, R = self.topology, n.rotation[:, self.member_part]
        ends = n.origin[:, self.member_part, None] + leaves.ends[:, self.member_leaf] @ R.swapaxes(2, 3)
        value, inner = self.packing.values(leaves, n.explicit)
        length = leaves.length[:, self.member_leaf]
        arrays = topology.designs(count)
        write(
            arrays.members, offset=ends - places[:, topology.members.node],
            frame=R[:, :, None] @ leaves.frame[:, self.member_leaf], value=value, length=length,
            stiffness_scale=leaves.stiffness_scale[:, self.member_leaf],
        )  # fmt: skip
        at = n.terms[..., 4:7]
        write(
            arrays.terms,
            coefficient=n.terms[..., 0],
            direction=n.terms[..., 1:4],
            point=at[:, :, None] - self.is_point[:, None, None] * places[:, self.term_nodes],
        )
        write(
            arrays.loads,
            point=n.loads[..., :3] - places[:, self.load_nodes],
            force=n.loads[..., 3:6],
            moment=n.loads[..., 6:9],
        )
        if len(self.member_leaf):
            size = np.maximum(largest_extent(places, ends), length.max(axis=1))
        else:
            # without leaf springs: the extent of the points of constraint rows, loads and springs
            named = np.concatenate([at[:, self.is_point], n.loads[..., :3], *self._spring_ends(n)], axis=1)
            size = (named.max(axis=1, initial=-np.inf) - named.min(axis=1, initial=np.inf)).max(axis=1)
            size[~(size > 0.0)] = 1.0
        arrays.floats[:, 0] = size
        self._fill_springs(arrays.springs, n, places)
        if len(topology.weight):
            arrays.weight[..., 0], arrays.weight[..., 1:4] = (
                leaves.mass[:, self.member_leaf],
                n.gravity[:, None],
            )
            arrays.weight[:, self.pushed, 4:] = n.pushes
        rotations = self.identity[None].repeat(count, axis=0)
        multipliers, angles = (
            np.zeros((count, n)) for n in (len(topology.terms.start), angle_count(topology))
        )
        rest = State(places, rotations, inner, multipliers, angles)
        return DesignArrays(arrays, rest, leaves, points)

    def leaves(self, n: SceneNumbers) -> LeafGeometry:
        """Geometry and scales of all distinct leaves."""
        leaf = n.leaf
        start, width, L = leaf[..., :3], leaf[..., 6:9], leaf[..., 9]
        E, G, A, J, Iy, Iz, ky, kz, density = (leaf[..., k] for k in range(10, LEAF_NUMBERS))
        axes = leaf_axes(start, leaf[..., 3:6], width)
        ends, frame = np.empty((*L.shape, 2, 3)), axes[:, :, None].repeat(2, axis=2)
        ends[:, :, 0], ends[:, :, 1] = start, start + L[..., None] * axes[..., 0]
        soft = 1.0 / (E * A)
        shear = [1.0 / (ky * G * A), 1.0 / (kz * G * A)] if self.mesh.shear else [0.0 * A, 0.0 * A]
        stiff = G * J, E * Iy, E * Iz
        line = density * A
        scale = np.zeros((*L.shape, SCALES))
        scale[..., 0], scale[..., 1], scale[..., 18] = 1.0, L, 1.0 / L
        for k, value in enumerate((L * stiff[0], L * stiff[1], L * stiff[2], soft, *shear, L * line)):
            scale[..., 2 + k] = value
        if self.mesh.leaf != "strain" or hasattr(self.mesh, "others"):
            self._set_chain_scales(scale, L, soft, shear, stiff, line)
        mass = self.leaf_has_weight * (L * line)
        self._set_explicit_geometry(n, ends, frame, mass)
        return LeafGeometry(ends, frame, scale, mass, 1.0 / (soft * L), L)

    def _set_chain_scales(
        self, scale: Array, L: Array, soft: Array, shear: list[Array], stiff: tuple[Array, ...], line: Array
    ) -> None:
        """Set the scales of chains, in place; see `ksd.elements.corotational_values.stiffness_numbers`."""
        h = L / self.elements
        phi_y, phi_z = 12 * stiff[2] * shear[0] / h**2, 12 * stiff[1] * shear[1] / h**2
        s3, s4 = stiff[1] / ((1 + phi_z) * h**3), stiff[2] / ((1 + phi_y) * h**3)
        scales = (
            h, 1.0 / (soft * h), stiff[0] / h**3, s3 * (4 + phi_z), s3 * (-2 + phi_z), s4 * (4 + phi_y),
            s4 * (-2 + phi_y), line * h, line * h**2,
        )  # fmt: skip
        for k, value in enumerate(scales):
            scale[..., 9 + k] = value

    def _set_explicit_geometry(self, n: SceneNumbers, ends: Array, frame: Array, mass: Array) -> None:
        """Set ends, frames and mass of the leaves that have them as explicit numbers, in place."""
        at = 0
        for f in self.explicit_leaves:
            ends[:, f] = n.explicit[:, at : at + 6].reshape(-1, 2, 3)
            frame[:, f] = n.explicit[:, at + 6 : at + 24].reshape(-1, 2, 3, 3)
            mass[:, f] = n.explicit[:, at + 24]
            at += self.leaf_layouts[f].explicit_count

    def _spring_ends(self, n: SceneNumbers) -> list[Array]:
        """Ends (D, 2, 3) [m] of every spring."""
        return [n.springs[:, a : a + 6].reshape(-1, 2, 3) for a in self.spring_first[:-1]]

    def _fill_springs(self, springs: Members, n: SceneNumbers, places: Array) -> None:
        """Write the floats of the springs of D designs."""
        for i, (a, b) in enumerate(pairwise(self.spring_first)):
            fixed, at = n.springs[:, a : a + SPRING_NUMBERS], springs.value_at[i]
            springs.offset[:, i] = fixed[:, :6].reshape(-1, 2, 3) - places[:, springs.node[i]]
            springs.frame[:, i] = fixed[:, 6:24].reshape(-1, 2, 3, 3)
            springs.length[:, i], springs.stiffness_scale[:, i] = fixed[:, 24], fixed[:, 25]
            springs.value[:, at : at + b - a - SPRING_NUMBERS] = n.springs[:, a + SPRING_NUMBERS : b]

    def on_mesh(self, mesh: Mesh) -> Template | None:
        """The template of the same leaves with the curvature modes of `mesh`.

        None for chains and mixed meshes, and where constants of leaves are explicit numbers.
        """
        if mesh not in self._on_mesh:
            only_modes_differ = type(mesh) is Mesh and mesh == replace(
                self.mesh, orders=mesh.orders, points=mesh.points
            )
            layout = self._remeshed(mesh) if self.is_uniform and only_modes_differ else None
            self._on_mesh[mesh] = None if layout is None else template_of(layout, mesh)
        return self._on_mesh[mesh]

    def _remeshed(self, mesh: Mesh) -> SceneLayout:
        """The layout with the orders of `mesh` for all leaves without their own orders."""

        def number(leaf: LeafLayout) -> tuple[int, ...]:
            if leaf.amplitudes:
                # same points, so that the undeformed shape is the same to the last digit
                now = zip(leaf.number, mesh.orders, self.mesh.orders, strict=False)
                orders = tuple(n + new - old for n, new, old in now)
                return (*orders, max(leaf.number[3], max(orders) + 1), 0)
            orders = mesh.orders if leaf.number[:3] == tuple(self.mesh.orders) else leaf.number[:3]
            return (*orders, max(mesh.points, max(orders) + 1), 0)

        parts = (
            part._replace(leaves=tuple(leaf._replace(number=number(leaf)) for leaf in part.leaves))
            for part in self.scene_layout.distinct_parts
        )
        return self.scene_layout._replace(distinct_parts=tuple(parts))

    @cached_property
    def is_uniform(self) -> bool:
        """Whether all leaves are strain-mode leaves of one mesh and none has explicit constants."""
        return type(self.mesh) is Mesh and all(
            w.kind == STRAIN and w.explicit is None for w in self.leaf_layouts
        )

    @cached_property
    def spring_names(self) -> tuple[str, ...]:
        """Names of the springs."""
        return tuple(s[0] for s in self.scene_layout.springs)

    def numbers(self, rows: Sequence[Sequence[float]]) -> SceneNumbers:
        """The numbers of D designs from their flat numbers, one row each."""
        flat = np.array(rows, float).reshape(len(rows), -1)
        return SceneNumbers(*(flat[:, at].reshape(len(rows), *shape) for at, shape in self._slices))


def fields_of_design(part: Any, names: Sequence[str], d: int) -> Any:
    """A named tuple of arrays with design d of the fields `names`, which have a leading axis over designs."""
    return part._replace(**{name: np.ascontiguousarray(getattr(part, name)[d]) for name in names})


def state_of_design(state: State, d: int) -> State:
    """State of design d of a state with a leading axis over designs."""
    return State(*(np.ascontiguousarray(field[d]) for field in state))


@lru_cache(maxsize=64)
def template_of(layout: SceneLayout, mesh: Mesh) -> Template:
    """The template of a layout and mesh, cached."""
    return Template(layout, mesh)
