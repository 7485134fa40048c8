"""Forces in a state: along every leaf, and of joints, leaf springs and springs on the links.

Section forces N, Vy, Vz [N], T, My, Mz [Nm] are positive on the section whose outward normal points along the leaf, in the
axes of the deformed section. For both leaf models they follow from the leaf's end wrench (n, m) by equilibrium: force n and
moment m + (r(L) - r(s)) x n, and of a leaf with weight that of what is beyond s, turned into the section. The other ways are
worse where stress is largest. In a strain-mode leaf the curvature series times the rigidity is right in the mean, not at the
ends (7e-4 of the moment off in a cross flexure turned by 45 degrees). In a chain the strains of Appendix A give bending
moments, but as shear only their difference over an element whose two ends have different axes, which under twist mixes weak
and strong bending.

Interface forces are what joints, free leaves and springs exert on the links they are clamped to, ground included. A leaf
passes on the wrench at its ends; those of a joint are summed about its interface. On every link they balance loads, drives,
supports and weight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.errors import SceneError
from ksd.model.arrays import COIL, STRAIN, TORSION, State, Workspace, make_workspace
from ksd.model.compile import Model
from ksd.model.loading import twist
from ksd.model.newton import assemble, assemble_nodes
from ksd.model.poses import member_pose
from ksd.properties.leaf_groups import LeafGroup, chain_groups, leaf_groups, local_gravity
from ksd.properties.printing import NamedAnswerTable, PrintableAnswer, format_number, format_table
from ksd.properties.shape import (
    chain_lines,
    cross_rows,
    leaf_members,
    member_arrays,
    member_ends,
    point_position,
    strain_curves,
)

Array = NDArray[np.float64]
COMPONENTS = ("N", "Vy", "Vz", "T", "My", "Mz")
"""Columns of `SectionForces.values`; the first three in N, the others in Nm."""
DEFAULT_STATIONS = 25


@dataclass(frozen=True, repr=False)
class SectionForces(PrintableAnswer):
    """Section forces of one leaf: stations s (k,) [m] from its start, values (k, 6), columns N, Vy, Vz [N] and T, My, Mz
    [Nm].

    Stations of a chain are its nodes.
    """

    name: str
    s: Array
    values: Array

    def _line(self) -> str:
        most = np.abs(self.values).max(axis=0)
        said = ", ".join(f"{c} {format_number(v, 3)}" for c, v in zip(COMPONENTS, most, strict=True))
        return f"'{self.name}', at most {said} [N, Nm]"

    def __str__(self) -> str:
        rows = [
            (
                format_number(1e3 * s, 4),
                *(format_number(v, 4, zero=1e-9 * float(np.abs(self.values).max())) for v in row),
            )
            for s, row in zip(self.s, self.values, strict=True)
        ]
        return format_table(("s [mm]", *COMPONENTS), rows, f"Section forces [N, Nm] along leaf '{self.name}'")

    @property
    def start(self) -> Array:
        """Values (6,) at the start of the leaf."""
        return self.values[0]

    @property
    def end(self) -> Array:
        """Values (6,) at the end of the leaf."""
        return self.values[-1]


def section_forces(
    model: Model, motion: State, *, points: int = DEFAULT_STATIONS, load_factor: float = 1.0
) -> NamedAnswerTable[SectionForces]:
    """Section forces of all leaves by full name; `points` stations in a strain-mode leaf; their weight times load_factor."""
    found = forces_of_members(model, motion, leaf_members(model), points, load_factor)
    said = "Section forces, the largest along every leaf"
    units = [f"{c} [{'N' if c in COMPONENTS[:3] else 'Nm'}]" for c in COMPONENTS]
    return NamedAnswerTable(found, said, ("leaf", *units), _largest_components)


def forces_of_members(
    model: Model, motion: State, lines: dict[str, list[int]], points: int, load_factor: float
) -> dict[str, SectionForces]:
    """The same along lines of members, by name."""
    parts: dict[int, tuple[Array, Array]] = {}
    wrenches = end_wrenches(model, motion, load_factor=load_factor)
    for group in (*leaf_groups(model), *chain_groups(model)):
        gravity = local_gravity(model, motion, group, load_factor)
        if model.arrays.members.kind[group.members[0]] == STRAIN:
            made = strain_forces(group.value, motion.inner[group.inner_index], group.number, points, gravity)
        else:
            made = _chain_forces(model, motion, group, wrenches, gravity)
        parts |= zip(group.members.tolist(), zip(*made, strict=True), strict=True)
    found = {}
    for name, members in lines.items():
        at, stations, values = 0.0, [], []
        for i in members:
            s, forces = parts[i] if i in parts else _solid_forces(model, motion, i, wrenches)
            stations.append(at + s)
            values.append(forces)
            at += s[-1]
        found[name] = SectionForces(name, np.concatenate(stations), np.concatenate(values))
    return found


def _largest_components(forces: SectionForces) -> list[str]:
    """Largest amounts of the six components, in words."""
    most = np.abs(forces.values).max(axis=0)
    return [format_number(float(v), 4, zero=1e-9 * float(most.max())) for v in most]


def end_wrenches(model: Model, motion: State, *, load_factor: float = 1.0) -> Array:
    """Force and moment (members, 6) [N, Nm] on end q of every member, in the frame of its end p."""
    found = np.empty((len(model.member_names), 6))
    if model.kinds - {STRAIN}:
        # what is left inside is condensed out
        held, work = np.zeros(len(motion.multiplier)), make_workspace(model.arrays)
        assemble(model.arrays, motion, held, load_factor, work, 1e-8, 0, 10.0)
        found[:] = work.lam[: len(found), :6]
    for group in leaf_groups(model):
        found[group.members] = motion.inner[group.inner_index][:, group.modes :]
    return found


def strain_forces(
    value: Array, inner: Array, number: NDArray[np.int64], points: int, gravity: Array | None = None
) -> tuple[Array, Array]:
    """Stations (leaves, k) and section forces (leaves, k, 6) of leaves of one make: constants (leaves, v) and inner states;
    gravity (leaves, 3) in their frames p."""
    s, r, R, *beyond = strain_curves(value, number, inner, points, gravity)
    weight = () if gravity is None else (gravity[:, None], *beyond)
    return s, forces_along(r, R, inner[:, None, int(number[:3].sum()) :], *weight)


def _chain_forces(
    model: Model, motion: State, group: LeafGroup, wrenches: Array, gravity: Array | None
) -> tuple[Array, Array]:
    """Stations (chains, k) and section forces (chains, k, 6) of chains of one number of elements, at their nodes, from the
    wrenches (members, 6) on end q of all members; gravity (chains, 3) in their frames p."""
    _, r, axes = chain_lines(model, motion, group)
    count = int(group.number[0])
    s = np.zeros(r.shape[:2])
    np.cumsum(group.value[:, : 16 * count : 16], axis=1, out=s[:, 1:])
    weight = () if gravity is None else (gravity[:, None], *_chain_masses(group.value, count, r))
    return s, forces_along(r, axes, wrenches[group.members, None], *weight)


def _solid_forces(model: Model, motion: State, i: int, wrenches: Array) -> tuple[Array, Array]:
    """Stations (k,) and section forces (k, 6) along the middle of a reduced solid."""
    ends = member_ends(model, motion, i)
    solid = model.bodies[model.member_names[i]]
    s, r, R = solid.middle_line(ends.d, ends.Q, member_arrays(model, motion, i)[2])
    return s, forces_along(r[None], R[None], wrenches[None, i : i + 1])[0]


def _chain_masses(value: Array, count: int, r: Array) -> tuple[Array, Array]:
    """Mass (chains, k) [kg] beyond every node, and its first moment up to there (chains, k, 3) [kg m]: int M dr."""
    lumps = value[:, 16 * count + 9 : 17 * count + 10]
    mass, first = np.zeros(r.shape[:2]), np.zeros_like(r)
    for k in reversed(range(count)):
        # half of an element is carried by each of its nodes
        mass[:, k] = 2 * lumps[:, k + 1 :].sum(axis=1) - mass[:, k + 1]
    middle = 0.5 * (mass[:, 1:] + mass[:, :-1])[..., None]
    np.cumsum(middle * np.diff(r, axis=1), axis=1, out=first[:, 1:])
    return mass, first


def forces_along(r: Array, R: Array, wrench: Array, *weight: Array) -> Array:
    """Section forces (leaves, k, 6) from positions and axes along leaves, and the wrench (leaves, 1, 6) on end q.

    weight: gravity (leaves, 1, 3), mass beyond every station (leaves, k), and int M dr up to there (leaves, k, 3).
    """
    n = wrench[..., :3]
    moment, forces = wrench[..., 3:] + cross_rows(r[:, -1:] - r, n), np.broadcast_to(n, r.shape)
    if weight:
        gravity, mass, first = weight
        forces = forces + mass[..., None] * gravity
        moment = moment + cross_rows(first[:, -1:] - first, gravity)
    found: Array = np.concatenate([forces, moment], axis=2).reshape(*r.shape[:2], 2, 3) @ R
    return found.reshape(*r.shape[:2], 6)


ROUNDING_TOLERANCE = 1e-9
"""Amounts below this fraction of the largest force are rounding."""
WEIGHTLESS_TOLERANCE = 1e-6
"""Change of the force along a leaf, over the force, up to which it counts as one without weight."""


@dataclass(frozen=True, repr=False)
class InterfaceForce(PrintableAnswer):
    """What one joint, leaf, spring, pin or slider exerts on one link: force (3,) [N], moment (3,) [Nm] about `point` (3,)
    [m], the place of the interface or end now; global axes."""

    name: str
    link: str
    point: Array
    force: Array
    moment: Array

    def _line(self) -> str:
        force, moment = (
            " ".join(
                format_number(float(v), 4, zero=ROUNDING_TOLERANCE * float(np.abs(part).max())) for v in part
            )
            for part in (self.force, self.moment)
        )
        return f"'{self.name}' on '{self.link}': {force} N, {moment} Nm"


@dataclass(frozen=True, repr=False)
class InterfaceForces(PrintableAnswer):
    """All of them, in the order of the scene: joints, free leaf springs, springs, pins and sliders; two rows each.

    size [m]: length by which moments and forces are compared.
    """

    rows: tuple[InterfaceForce, ...]
    size: float

    def _line(self) -> str:
        most = max(self.rows, key=lambda row: float(np.linalg.norm(row.force)))
        return f"{len(self.rows)} interfaces, at most {format_number(float(np.linalg.norm(most.force)))} N, of '{most.name}'"

    @property
    def listing(self) -> list[tuple[str, str, list[float]]]:
        """Name, link, and force and moment (6) of every row, amounts that are rounding as zero."""
        noise = ROUNDING_TOLERANCE * max((float(np.abs(r.force).max()) for r in self.rows), default=0.0)
        bounds = np.repeat([noise, noise * self.size], 3)
        wrenches = (np.concatenate([r.force, r.moment]) for r in self.rows)
        cleaned = (np.where(np.abs(w) > bounds, w, 0.0).tolist() for w in wrenches)
        return [(r.name, r.link, wrench) for r, wrench in zip(self.rows, cleaned, strict=True)]

    def __str__(self) -> str:
        rows = [(name, link, *(format_number(v, 4) for v in wrench)) for name, link, wrench in self.listing]
        columns = (*(f"F{a} [N]" for a in "xyz"), *(f"M{a} [Nm]" for a in "xyz"))
        said = "Interface forces: on the link, moments about the interface, global axes"
        return format_table(("of", "<on link", *columns), rows, said)

    def of(self, name: str, link: str) -> InterfaceForce:
        """What one joint, leaf or spring exerts on one of its links. Raises SceneError for names without a row."""
        for row in self.rows:
            if (row.name, row.link) == (name, link):
                return row
        known = ", ".join(f"'{r.name}' on '{r.link}'" for r in self.rows)
        raise SceneError(f"'{name}' is not clamped to link '{link}'; there are {known}")

    def on(self, link: str, *, about: Any = (0.0, 0.0, 0.0)) -> Array:
        """Sum of all on a link, "ground" too: force [N] and moment [Nm] (6,) about a global point [m]. Raises SceneError
        for a link nothing is clamped to."""
        mine = [r for r in self.rows if r.link == link]
        if not mine:
            known = ", ".join(f"'{name}'" for name in dict.fromkeys(r.link for r in self.rows))
            raise SceneError(f"no joint, leaf or spring is clamped to link '{link}'; there are {known}")
        moments = [r.moment + np.cross(r.point - np.asarray(about, float), r.force) for r in mine]
        return np.concatenate([sum(r.force for r in mine), sum(moments)])


def interface_forces(model: Model, motion: State, *, load_factor: float = 1.0) -> InterfaceForces:
    """What every joint, free leaf, spring, pin and slider of `model` exerts on its links at `motion`, their weight times
    load_factor."""
    ends = leaf_end_forces(model, motion, load_factor)
    rows = []
    for placed in model.scene.joints:
        mine = [e for e in ends if e.name.startswith(f"{placed.name}/")]
        for link, point in ((placed.a, placed.origin), (placed.b, placed.place(placed.joint.pose_B))):
            node = model.node_names.index(link)
            here = point_position(model, motion, node, point)
            theirs = [e for e in mine if e.link == link]
            force = sum((e.force for e in theirs), np.zeros(3))
            moment = sum((e.moment + np.cross(e.point - here, e.force) for e in theirs), np.zeros(3))
            rows.append(InterfaceForce(placed.name, link, here, force, moment))
    names = {placed.name for placed in model.scene.leaves}
    rows += [e for e in ends if e.name in names]
    if model.spring_names:
        assemble_nodes(model.arrays, motion, load_factor, work := make_workspace(model.arrays))
        rows += [
            row for i in range(len(model.spring_names)) for row in _spring_forces(model, motion, i, work)
        ]
    for hinge in model.scene.hinges:
        rows += _hinge_forces(model, motion, hinge)
    return InterfaceForces(tuple(rows), model.arrays.size)


def leaf_end_forces(model: Model, motion: State, load_factor: float) -> list[InterfaceForce]:
    """What every leaf exerts at its start and at its end on the nodes there, two rows each."""
    found, members = [], model.arrays.members
    forces = section_forces(model, motion, load_factor=load_factor)
    wrenches = end_wrenches(model, motion, load_factor=load_factor)
    for name, parts in leaf_members(model).items():
        first, last = member_ends(model, motion, parts[0]), member_ends(model, motion, parts[-1])
        n, m = wrenches[parts[0], :3], wrenches[parts[0], 3:]
        force, moment = n, m + np.cross(first.d, n)
        if np.abs(forces[name].start[:3] - n).max() > WEIGHTLESS_TOLERANCE * np.abs(n).max():
            # a leaf with weight hands it on at its start
            force, moment = forces[name].start[:3], forces[name].start[3:]
        node = model.node_names[members.node[parts[0], 0]]
        found.append(InterfaceForce(name, node, first.start, first.frame @ force, first.frame @ moment))
        n, m = wrenches[parts[-1], :3], wrenches[parts[-1], 3:]
        node, end = model.node_names[members.node[parts[-1], 1]], last.start + last.frame @ last.d
        found.append(InterfaceForce(name, node, end, -(last.frame @ n), -(last.frame @ m)))
    return found


def _hinge_forces(model: Model, motion: State, hinge: Any) -> list[InterfaceForce]:
    """What a pin or slider exerts on its links: the sum of its supports."""
    force, moment = np.zeros(3), np.zeros(3)
    nodes = [model.node_names.index(link) for link in (hinge.a, hinge.b)]
    names, drives = model.support_names, len(model.drive_names)
    for held in hinge.supports(model.scene.plane):
        term = held.terms[0]
        way = motion.R[nodes[0]] @ np.asarray(term.direction)
        share = -float(motion.multiplier[drives + names.index(held.name)]) * way
        if term.kind == "translation":
            force = force + share
        else:
            moment = moment + share
    place = point_position(model, motion, nodes[1], hinge.at)
    return [
        InterfaceForce(hinge.name, hinge.a, place, -force, -moment),
        InterfaceForce(hinge.name, hinge.b, place, force, moment),
    ]


def _spring_forces(model: Model, motion: State, i: int, work: Workspace) -> list[InterfaceForce]:
    """What a spring or elastic link exerts on the nodes at its ends; work: as assembled."""
    springs, R = model.arrays.springs, motion.R
    a, b = springs.node[i].tolist()
    start, end = (motion.x[n] + R[n] @ springs.offset[i, e] for e, n in enumerate((a, b)))
    frame = R[a] @ springs.frame[i, 0]
    n, m = work.lam[len(model.member_names) + i, :6].reshape(2, 3) @ frame.T
    if springs.kind[i] == TORSION:
        # its number is what goes with the angle, whose gradient leaves the axis where the links turn about another
        twist(R[a], R[b], frame[:, 2].copy(), np.zeros(3), slope := np.zeros(3), np.zeros((3, 3)))
        m = float(m @ frame[:, 2]) * slope
    name = model.spring_names[i]
    return [
        InterfaceForce(name, model.node_names[a], start, n, m + np.cross(end - start, n)),
        InterfaceForce(name, model.node_names[b], end, -n, -m),
    ]


def spring_energy(model: Model, motion: State) -> dict[str, float]:
    """Energy [J] of every spring and link with a matrix, by name; empty where the model has none."""
    return {name: energy_of_one_spring(model, motion, i) for i, name in enumerate(model.spring_names)}


def energy_of_one_spring(model: Model, motion: State, i: int) -> float:
    """k (l - l0)^2 / 2, k (angle - rest)^2 / 2, or xi K xi / 2 of spring i."""
    springs = model.arrays.springs
    value, pose, Q = springs.value[springs.value_at[i] :], np.empty(18), np.empty((3, 3))
    offset, frame = springs.offset[i].ravel(), springs.frame[i].ravel()
    member_pose(springs.node[i], 0, offset, 0, frame, 0, motion.x, motion.R, pose, Q)
    d = pose[:9].reshape(3, 3).T @ pose[15:]
    if springs.kind[i] == COIL:
        return 0.5 * float(value[0]) * (math.sqrt(float(d @ d)) - float(value[1])) ** 2
    from scipy.spatial.transform import Rotation

    if springs.kind[i] == TORSION:
        _, _, z, w = Rotation.from_matrix(Q).as_quat()
        angle = 2.0 * math.atan2(z, w)
        # the same branch as the kernel: between -180 and 180 degrees
        angle -= 2.0 * math.pi * round(angle / (2.0 * math.pi))
        return 0.5 * float(value[0]) * (angle - float(value[1])) ** 2
    turned = Rotation.from_matrix(Q @ value[3:12].reshape(3, 3).T).as_rotvec()
    xi = np.concatenate([d - value[:3], turned])
    return float(value[12:18] @ xi + 0.5 * xi @ value[18:54].reshape(6, 6) @ xi)
