"""All spatial arrays of many designs at once: what `ksd.model.compile` and `ksd.bodies.joints` make of one.

Arrays are named by where they stand in the storage of the five steps (`ksd.solve.space_steps.SpaceSet`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ksd.bodies.joints import JointBodies
from ksd.design.refill.drawing import Numbers, blocks_of
from ksd.design.refill.polynomials import Polynomials
from ksd.design.refill.scales import Table, element_counts, floors, inner_table, scales, value_table
from ksd.model.arrays import STRAIN
from ksd.model.compile import Model
from ksd.model.pack import spread
from ksd.scene.joint import leafs_of

Filled = dict[str, np.ndarray]


@dataclass(frozen=True)
class Topology:
    """Who hangs on whom in a model of joints: numbers of different joints u, leafs f, points p, nodes.

    joint (J,): u of every placed joint; ends (J, 2): its links; attached: per link the (joint, end) that hang on it; block
    (B, 2): placed joint and point of every internal node. member (m, 2): placed joint and leaf; node (m, 2): its full
    nodes; clamp (F, 2): row in the table of (0, tips, points) of both ends of a leaf; span: members of placed joints.
    """

    joint: np.ndarray
    ends: np.ndarray
    attached: list[list[tuple[int, int]]]
    block: np.ndarray
    member: np.ndarray
    node: np.ndarray
    clamp: np.ndarray
    span: list[slice]
    term_node: np.ndarray
    load_node: np.ndarray
    load_kept: np.ndarray


def topology(model: Model, joints: Sequence[Any]) -> Topology:
    """The topology of `model`, whose different joints are `joints`."""
    scene, index = model.scene, {link: i for i, link in enumerate(model.scene.links)}
    number = {id(j): u for u, j in enumerate(joints)}
    points = {key: p for p, key in enumerate(blocks_of(joints))}
    leaf_first = np.cumsum([0] + [len(leafs_of(j)) for j in joints])
    attached: list[list[tuple[int, int]]] = [[] for _ in scene.links]
    block, member = [], []
    for j, placed in enumerate(scene.joints):
        u = number[id(placed.joint)]
        attached[index[placed.a]].append((j, 0))
        attached[index[placed.b]].append((j, 1))
        block += [(j, points[u, name]) for name in placed.joint.blocks() if name not in ("A", "B")]
        member += [(j, int(leaf_first[u]) + n) for n in range(len(leafs_of(placed.joint)))]
    clamp = []
    for u, joint in enumerate(joints):
        rows = {"A": 0, "B": 1 + u} | {n: 1 + len(joints) + p for (v, n), p in points.items() if v == u}
        clamp += [(rows[leaf.start_block], rows[leaf.end_block]) for leaf in leafs_of(joint)]
    terms = [(index[t.base], index[t.link]) for d in (*scene.drives, *scene.supports) for t in d.terms]
    loads = np.array([index[load.link] for load in scene.loads], np.int64)
    return Topology(
        np.array([number[id(p.joint)] for p in scene.joints]),
        np.array([(index[p.a], index[p.b]) for p in scene.joints], np.int64), attached,
        np.array(block, np.int64).reshape(-1, 2), np.array(member, np.int64).reshape(-1, 2),
        model.arrays.members.node.copy(), np.array(clamp, np.int64), list(model.joint_members),
        np.array(terms, np.int64).reshape(-1, 2), loads, np.flatnonzero(loads != 0),
    )  # fmt: skip


def leaf_axes(start: np.ndarray, end: np.ndarray, width: np.ndarray) -> np.ndarray:
    """(..., 3, 3): as `ksd.model.leafs.leaf_axes`, for many leafs."""
    along = end - start
    e1 = along / np.linalg.norm(along, axis=-1, keepdims=True)
    e3 = width - np.sum(width * e1, axis=-1, keepdims=True) * e1
    e3 = e3 / np.linalg.norm(e3, axis=-1, keepdims=True)
    return np.stack([e1, np.cross(e3, e1), e3], axis=-1)


def extent(places: np.ndarray, lengths: np.ndarray, offset: np.ndarray, node: np.ndarray) -> np.ndarray:
    """(D,): length scale of mechanisms with nodes (D, k, 3) and members of lengths (D, m); see `ksd.model.pack.spread`."""
    return np.maximum(spread(places, offset, node), lengths.max(axis=1))


class Space:
    """How the spatial arrays of a model come from its numbers; call it with many."""

    def __init__(
        self, model: Model, bodies: JointBodies, joints: Sequence[Any], polynomials: Polynomials, own: Numbers
    ) -> None:
        self.top, self.mesh = topology(model, joints), model.mesh
        every = {"full": model.arrays, "bench": bodies.bench, "reduced": bodies.reduced}
        self.ends = {name: arrays.members.node for name, arrays in every.items()}
        top, leafs = self.top, [leaf for joint in joints for leaf in leafs_of(joint)]
        self.counts = element_counts(leafs, model.mesh)
        scale = scales(own.leaf, model.mesh, self.counts)[0]
        full, bench = model.arrays.members, bodies.bench.members
        self.values = {
            "full": value_table(full, top.member[:, 1], scale),
            "bench": value_table(bench, top.member[:, 1], scale),
        }
        self.inners = {
            "full": inner_table(full, top.member[:, 1], model.rest.inner, scale),
            "bench": inner_table(bench, top.member[:, 1], bodies.bench_rest.inner, scale),
        }
        self._functions(bodies, polynomials)
        self.coefficients = self._kept(bodies.inside, scale)

    def _functions(self, bodies: JointBodies, polynomials: Polynomials) -> None:
        """Which polynomials go where, in the order of `ksd.bodies.joints`."""
        top, members = self.top, bodies.bench.members
        self.pose = np.array([polynomials.pose(u) for u in top.joint])
        own = np.bincount(top.block[:, 0], minlength=len(top.joint))
        blocks = [polynomials.block(u, k) for u, n in zip(top.joint, own, strict=True) for k in range(n)]
        self.block = np.array(blocks, np.int64).reshape(-1, 6)
        inner, near = [], []
        for i, (j, f) in enumerate(top.member):
            u, n = int(top.joint[j]), i - top.span[j].start
            if members.kind[i] == STRAIN:
                wanted = members.number[i, :3].tolist()
                inner += [(row, f, kind) for row, kind in polynomials.inner(u, n, wanted)]
            else:
                near += [(row, f, kind) for row, kind in polynomials.near(u, n)]
        self._every = [np.array(found, np.int64).reshape(-1, 3).T for found in (inner, near)]

    def _kept(self, inside: Any, scale: np.ndarray) -> dict[str, tuple[Table, np.ndarray, np.ndarray]]:
        """By name: table of scales, rows of those functions that are not zero, and of those that are."""
        found = {}
        for name, (row, leaf, kind), have in zip(
            ("coefficient", "near_coefficient"),
            self._every,
            (inside.coefficient, inside.near_coefficient),
            strict=True,
        ):
            found[name] = (Table(np.ones(len(row)), leaf, kind), row, have)
        return found

    def keep(self, stack: np.ndarray, scale: np.ndarray) -> bool:
        """Sort the functions of the insides into zero and not zero, as they are in the design the model was made of."""
        kept = {}
        for name, (table, row, have) in self.coefficients.items():
            there = np.any(stack[0, row] != 0.0, axis=1)
            if there.sum() != len(have):
                return False
            some = Table(table.unit[there], table.leaf[there], table.kind[there])
            kept[name] = (some, row[there], row[~there])
        self.coefficients = kept
        return True

    def __call__(self, n: Numbers, stack: np.ndarray) -> tuple[Filled, np.ndarray]:
        """The arrays by their place in the storage, each with D first; and whether a design fits them (D,)."""
        top = self.top
        scale = scales(n.leaf, self.mesh, self.counts)
        tips = n.origin + _turned(n.rotation, n.tip[:, top.joint])
        links = self._links(n, tips)
        points = n.origin[:, top.block[:, 0]] + _turned(
            n.rotation[:, top.block[:, 0]], n.point[:, top.block[:, 1]]
        )
        nodes = np.concatenate([links, points], axis=1)
        length = n.leaf[:, top.member[:, 1], 9]
        found: Filled = {"rest.full.x": nodes, **self._members(n, nodes, scale)}
        found["bodies.full.size"] = extent(
            nodes, length, found["bodies.full.members.offset"], self.ends["full"]
        )
        found |= self._bench(n, length, scale)
        found |= self._reduced(n, links, tips, found["bodies.full.members.floor"])
        found |= _rows(n, links, top)
        found |= {
            "bodies.loops.anchor": found["bodies.reduced.members.offset"],
            "bodies.loops.frame": n.rotation,
            "bodies.loops.length": n.length[:, top.joint],
            "bodies.loops.pose": stack[:, self.pose],
            "bodies.inside.block_pose": stack[:, self.block],
        }
        fits = np.ones(len(nodes), bool)
        for name, (table, row, zero) in self.coefficients.items():
            found[f"bodies.inside.{name}"] = stack[:, row] * table(scale)[:, :, None]
            fits &= ~np.any(stack[:, zero] != 0.0, axis=(1, 2))
        return found, fits

    def _links(self, n: Numbers, tips: np.ndarray) -> np.ndarray:
        """Reference points of the links, see `ksd.model.compile.reference_points`."""
        links = np.zeros((len(tips), len(self.top.attached), 3))
        for k, hung in enumerate(self.top.attached):
            if k > 0 and hung:
                links[:, k] = np.mean([(n.origin, tips)[end][:, j] for j, end in hung], axis=0)
        return links

    def _members(self, n: Numbers, nodes: np.ndarray, scale: np.ndarray) -> Filled:
        """The leafs of the full model."""
        j, f = self.top.member.T
        leaf, R, at = n.leaf[:, f], n.rotation[:, j], n.origin[:, j]
        start, end = at + _turned(R, leaf[..., :3]), at + _turned(R, leaf[..., 3:6])
        axes = leaf_axes(start, end, _turned(R, leaf[..., 6:9]))
        tip = start + leaf[..., 9:10] * axes[..., 0]
        offset = np.stack(
            [start - nodes[:, self.top.node[:, 0]], tip - nodes[:, self.top.node[:, 1]]], axis=2
        )
        return {
            "bodies.full.members.offset": offset,
            "bodies.full.members.frame": np.stack([axes, axes], axis=2),
            "bodies.full.members.value": self.values["full"](scale),
            "bodies.full.members.length": leaf[..., 9],
            "bodies.full.members.floor": floors(leaf),
            "rest.full.inner": self.inners["full"](scale),
        }

    def _bench(self, n: Numbers, length: np.ndarray, scale: np.ndarray) -> Filled:
        """The leafs of the joints apart."""
        top, f = self.top, self.top.member[:, 1]
        axes = leaf_axes(n.leaf[..., :3], n.leaf[..., 3:6], n.leaf[..., 6:9])
        table = np.concatenate([np.zeros((len(length), 1, 3)), n.tip, n.point], axis=1)
        tip = n.leaf[..., :3] + n.leaf[..., 9:10] * axes[..., 0]
        offset = np.stack(
            [n.leaf[..., :3] - table[:, top.clamp[:, 0]], tip - table[:, top.clamp[:, 1]]], axis=2
        )
        x = np.concatenate(
            [np.zeros((len(length), 1, 3)), n.point[:, top.block[:, 1]], n.tip[:, top.joint]], axis=1
        )
        return {
            "bodies.bench.members.offset": offset[:, f],
            "bodies.bench.members.frame": np.stack([axes, axes], axis=2)[:, f],
            "bodies.bench.members.value": self.values["bench"](scale),
            "bodies.bench.members.length": length,
            "bodies.bench.members.floor": floors(n.leaf)[:, f],
            "bodies.bench.size": extent(x, length, offset[:, f], self.ends["bench"]),
            "rest.bench.x": x,
            "rest.bench.inner": self.inners["bench"](scale),
        }

    def _reduced(self, n: Numbers, links: np.ndarray, tips: np.ndarray, floor: np.ndarray) -> Filled:
        """The condensed joints between links."""
        top, length = self.top, n.length[:, self.top.joint]
        offset = np.stack([n.origin - links[:, top.ends[:, 0]], tips - links[:, top.ends[:, 1]]], axis=2)
        return {
            "bodies.reduced.members.offset": offset,
            "bodies.reduced.members.frame": np.stack([n.rotation, n.rotation], axis=2),
            "bodies.reduced.members.length": length,
            "bodies.reduced.members.floor": np.stack([floor[:, s].max(axis=1) for s in top.span], axis=1),
            "bodies.reduced.size": extent(links, length, offset, self.ends["reduced"]),
            "rest.reduced.x": links,
        }


def _rows(n: Numbers, links: np.ndarray, top: Topology) -> Filled:
    """Drives, supports and loads, of the full and of the reduced mechanism."""
    at, kept = n.terms[..., 4:7], top.load_kept
    point = np.stack([at - links[:, top.term_node[:, 0]], at - links[:, top.term_node[:, 1]]], axis=2)
    loads = n.loads[:, kept]
    found = {
        "terms.coefficient": n.terms[..., 0],
        "terms.direction": n.terms[..., 1:4],
        "terms.point": point,
        "loads.point": loads[..., :3] - links[:, top.load_node[kept]],
        "loads.force": loads[..., 3:6],
        "loads.moment": loads[..., 6:9],
    }
    return {f"bodies.{which}.{name}": a for which in ("full", "reduced") for name, a in found.items()}


def _turned(R: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(..., 3): vectors v turned by R (..., 3, 3)."""
    return np.asarray((R @ v[..., None])[..., 0])
