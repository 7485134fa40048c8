"""Section forces along leaf springs, and interface forces of joints, leaf springs, springs and hinges on links.

Section forces N, Vy, Vz [N], T, My, Mz [Nm] are positive on the section whose outward normal points along the leaf, in the
axes of the deformed section. For both leaf models they follow from the leaf's end wrench (n, m) by equilibrium: force n and
moment m + (r(L) - r(s)) x n, plus for a leaf with weight or other loads along it those of the loads beyond s, in the axes
of the section. Other methods are less accurate where the stress is largest. In a strain-mode leaf the curvature series
times the rigidity is accurate in the mean, not at the ends (7e-4 of the moment in a cross flexure turned by 45 degrees). In
a chain the strains of Appendix A give bending moments, but shear only as their difference over an element whose two ends
have different axes, which under twist mixes weak and strong bending.

Interface forces are those that joints, free leaves and springs exert on the links they are clamped to, ground included. They
are the wrenches at the ends of leaves; those of a joint are summed about its interface. On every link they balance loads,
drives, supports and weight.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.answers.centrelines import (
    DEFAULT_STATIONS,
    chain_lines,
    cross_rows,
    group_curves,
    leaf_members,
    member_arrays,
    member_ends,
    scene_leaves,
    strain_curves,
)
from ksd.answers.leaf_groups import LeafGroup, chain_groups, end_frames, leaf_groups, local_loads
from ksd.answers.printing import NamedAnswerTable, PrintableAnswer, format_number, format_table
from ksd.answers.shape import point_position
from ksd.errors import SceneError
from ksd.model.arrays import State, Workspace, make_workspace
from ksd.model.compile import Model
from ksd.model.line_moments import missing_moment
from ksd.model.member_ends import table_ends
from ksd.model.newton import assemble, assemble_nodes
from ksd.model.springs import energy_of_one_spring

Array = NDArray[np.float64]
COMPONENTS = ("N", "Vy", "Vz", "T", "My", "Mz")
"""Columns of `SectionForces.values`; the first three in N, the others in Nm."""


@dataclass(frozen=True, repr=False)
class SectionForces(PrintableAnswer):
    """Section forces of one leaf.

    s (k,): stations [m] from its start, of a chain its nodes; values (k, 6): columns N, Vy, Vz [N] and T, My, Mz [Nm].
    """

    name: str
    s: Array
    values: Array

    def _line(self) -> str:
        most = np.abs(self.values).max(axis=0)
        components = ", ".join(f"{c} {format_number(v, 3)}" for c, v in zip(COMPONENTS, most, strict=True))
        return f"'{self.name}', at most {components} [N, Nm]"

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
    """Section forces of all leaves by full name.

    points: stations per strain-mode leaf; load_factor: factor of the loads along them.
    """
    found = forces_of_members(model, motion, leaf_members(model), points, load_factor)
    title = "Section forces, the largest along every leaf"
    units = [f"{c} [{'N' if c in COMPONENTS[:3] else 'Nm'}]" for c in COMPONENTS]
    return NamedAnswerTable(found, title, ("leaf", *units), _largest_components)


def forces_of_members(
    model: Model, motion: State, lines: dict[str, list[int]], points: int, load_factor: float
) -> dict[str, SectionForces]:
    """Section forces along `lines`, sequences of members, by name; other arguments as in `section_forces`."""
    parts: dict[int, tuple[Array, Array]] = {}
    wrenches = end_wrenches(model, motion, load_factor=load_factor)
    for group in (*leaf_groups(model), *chain_groups(model)):
        loads = local_loads(model, motion, group, load_factor)
        if not group.is_chain:
            curves = group_curves(model, motion, group, points, load_factor)
            wrench = motion.inner[group.inner_index[:, group.modes : group.modes + 6]]
            results = _forces_of_curves(curves, wrench, loads)
        else:
            results = _chain_forces(model, motion, group, wrenches, loads)
        parts |= zip(group.members.tolist(), zip(*results, strict=True), strict=True)
    if any(line.has_moment for line in model.scene.line_loads):
        _fill_steps_of_moments(model, motion, parts, points, load_factor)
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


def _fill_steps_of_moments(
    model: Model, motion: State, parts: dict[int, tuple[Array, Array]], points: int, load_factor: float
) -> None:
    """Make the inner moment of leaf springs with moments per length, whose points (`ksd.model.line_moments`) it has steps
    at, continuous in `parts`, stations and section forces by member."""
    leaves, members, axes = scene_leaves(model), leaf_members(model), dict[int, Array]()
    for group in (*leaf_groups(model), *chain_groups(model)):
        if group.is_chain:
            ends, _, R = chain_lines(model, motion, group)
        else:
            ends = end_frames(model, motion, group.members)
            R = group_curves(model, motion, group, points, load_factor)[2]
        axes |= zip(group.members.tolist(), ends.frame[:, None] @ R, strict=True)
    for name in dict.fromkeys(line.leaf for line in model.scene.line_loads if line.has_moment):
        length, at = leaves[name].length, 0.0
        total = sum(parts[i][0][-1] for i in members[name])
        for i in members[name]:
            s, forces = parts[i]
            # heat changes the natural length
            here, middle = ((at + part) * length / total for part in (s, 0.5 * s[-1]))
            missing = load_factor * missing_moment(model.scene, name, length, here, middle)
            forces[:, 3:] += (missing[:, None] @ axes[i])[:, 0]
            at += s[-1]


def _largest_components(forces: SectionForces) -> list[str]:
    """Largest magnitudes of the six components, formatted."""
    most = np.abs(forces.values).max(axis=0)
    return [format_number(float(v), 4, zero=1e-9 * float(most.max())) for v in most]


def end_wrenches(model: Model, motion: State, *, load_factor: float = 1.0) -> Array:
    """Force and moment (members, 6) [N, Nm] on end q of every member, in its frame p."""
    found = np.empty((len(model.member_names), 6))
    if not model.has_strain_leaves_only:
        # the assembly condenses the inner unknowns and stores the end wrenches
        held, work = np.zeros(len(motion.multiplier)), make_workspace(model.arrays)
        assemble(model.arrays, motion, held, load_factor, work)
        found[:] = work.lam[: len(found), :6]
    for group in leaf_groups(model):
        found[group.members] = motion.inner[group.inner_index][:, group.modes :]
    return found


def strain_forces(value: Array, inner: Array, number: NDArray[np.int64], points: int) -> tuple[Array, Array]:
    """Stations (leaves, k) [m], section forces (leaves, k, 6) of strain-mode leaves of one group, without loads along them.

    value (leaves, v), inner: their constants and inner states.
    """
    modes = int(number[:3].sum())
    return _forces_of_curves(strain_curves(value, number, inner, points), inner[:, modes:], None)


def _forces_of_curves(curves: tuple[Array, ...], wrench: Array, loads: Array | None) -> tuple[Array, Array]:
    """`strain_forces` from curves as `strain_curves` gives them and the wrenches (leaves, 6) on ends q."""
    s, r, R, *beyond = curves
    given = () if loads is None else (loads, *beyond)
    return s, forces_along(r, R, wrench[:, None], *given)


def _chain_forces(
    model: Model, motion: State, group: LeafGroup, wrenches: Array, loads: Array | None
) -> tuple[Array, Array]:
    """Stations (chains, k) [m] and section forces (chains, k, 6) at the nodes of the chains of a group.

    wrenches (members, 6): on end q of all members; loads (chains, 3): gravity in their frames p.
    """
    _, r, axes = chain_lines(model, motion, group)
    count = int(group.number[0])
    s = np.zeros(r.shape[:2])
    np.cumsum(group.value[:, : 16 * count : 16], axis=1, out=s[:, 1:])
    given = () if loads is None else (loads, *_chain_masses(group.value, count, r))
    return s, forces_along(r, axes, wrenches[group.members, None], *given)


def _solid_forces(model: Model, motion: State, i: int, wrenches: Array) -> tuple[Array, Array]:
    """Stations (k,) [m] and section forces (k, 6) along the middle line of a reduced solid."""
    ends = member_ends(model, motion, i)
    solid = model.bodies[model.member_names[i]]
    s, r, R = solid.middle_line(ends.d, ends.Q, member_arrays(model, motion, i)[2])
    return s, forces_along(r[None], R[None], wrenches[None, i : i + 1])[0]


def _chain_masses(value: Array, count: int, r: Array) -> tuple[Array, Array]:
    """Mass M (chains, k, 1) [kg] beyond every node, and its first moment int M dr (chains, k, 1, 3) [kg m] up to there."""
    lumps = value[:, 16 * count + 9 : 17 * count + 10]
    mass, first = np.zeros(r.shape[:2]), np.zeros_like(r)
    for k in reversed(range(count)):
        # each node carries half of the mass of an element
        mass[:, k] = 2 * lumps[:, k + 1 :].sum(axis=1) - mass[:, k + 1]
    middle = 0.5 * (mass[:, 1:] + mass[:, :-1])[..., None]
    np.cumsum(middle * np.diff(r, axis=1), axis=1, out=first[:, 1:])
    return mass[..., None], first[:, :, None]


def forces_along(r: Array, R: Array, wrench: Array, *given: Array) -> Array:
    """Section forces (leaves, k, 6) from positions r and axes R along leaves, and the wrench (leaves, 1, 6) on end q.

    given: load modes (leaves, D), their integrals Q beyond every station (leaves, k, modes), and int Q dr up to there
    (leaves, k, modes, 3).
    """
    n = wrench[..., :3]
    moment, forces = wrench[..., 3:] + cross_rows(r[:, -1:] - r, n), np.broadcast_to(n, r.shape)
    if given:
        loads, beyond, first = given
        modes = loads.reshape(len(loads), 1, -1, 3)
        forces = forces + (beyond[..., None] * modes).sum(axis=2)
        moment = moment + np.cross(first[:, -1:] - first, modes).sum(axis=2)
    found: Array = np.concatenate([forces, moment], axis=2).reshape(*r.shape[:2], 2, 3) @ R
    return found.reshape(*r.shape[:2], 6)


ROUNDING_TOLERANCE = 1e-9
"""Magnitude, relative to the largest force, up to which a component counts as rounding."""
WEIGHTLESS_TOLERANCE = 1e-6
"""Relative change of the force along a leaf up to which it counts as a leaf without weight."""


@dataclass(frozen=True, repr=False)
class InterfaceForce(PrintableAnswer):
    """Force (3,) [N] and moment (3,) [Nm] that one joint, leaf, spring, pin or slider exerts on one link.

    point (3,) [m]: deformed position of the interface or end, about which the moment is taken; global axes.
    """

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
    """All interface forces in the order of the scene: joints, free leaf springs, springs, pins and sliders; two rows each.

    size [m]: length by which moments are compared with forces.
    """

    rows: tuple[InterfaceForce, ...]
    size: float

    def _line(self) -> str:
        most = max(self.rows, key=lambda row: float(np.linalg.norm(row.force)))
        return f"{len(self.rows)} interfaces, at most {format_number(float(np.linalg.norm(most.force)))} N, of '{most.name}'"

    @property
    def listing(self) -> list[tuple[str, str, list[float]]]:
        """Name, link, and force and moment (6) of every row, with components that are rounding set to zero."""
        noise = ROUNDING_TOLERANCE * max((float(np.abs(r.force).max()) for r in self.rows), default=0.0)
        bounds = np.repeat([noise, noise * self.size], 3)
        wrenches = (np.concatenate([r.force, r.moment]) for r in self.rows)
        cleaned = (np.where(np.abs(w) > bounds, w, 0.0).tolist() for w in wrenches)
        return [(r.name, r.link, wrench) for r, wrench in zip(self.rows, cleaned, strict=True)]

    def __str__(self) -> str:
        rows = [(name, link, *(format_number(v, 4) for v in wrench)) for name, link, wrench in self.listing]
        columns = (*(f"F{a} [N]" for a in "xyz"), *(f"M{a} [Nm]" for a in "xyz"))
        title = "Interface forces: on the link, moments about the interface, global axes"
        return format_table(("of", "<on link", *columns), rows, title)

    def of(self, name: str, link: str) -> InterfaceForce:
        """Force of one joint, leaf or spring on one of its links; raises SceneError where there is none."""
        for row in self.rows:
            if (row.name, row.link) == (name, link):
                return row
        known = ", ".join(f"'{r.name}' on '{r.link}'" for r in self.rows)
        raise SceneError(f"'{name}' is not clamped to link '{link}'; there are {known}")

    def on(self, link: str, *, about: Any = (0.0, 0.0, 0.0)) -> Array:
        """Sum of all forces [N] and moments [Nm] (6,) on a link, or "ground", about a global point (3,) [m].

        Raises SceneError for a link to which nothing is clamped.
        """
        mine = [r for r in self.rows if r.link == link]
        if not mine:
            known = ", ".join(f"'{name}'" for name in dict.fromkeys(r.link for r in self.rows))
            raise SceneError(f"no joint, leaf or spring is clamped to link '{link}'; there are {known}")
        moments = [r.moment + np.cross(r.point - np.asarray(about, float), r.force) for r in mine]
        return np.concatenate([sum(r.force for r in mine), sum(moments)])


def interface_forces(
    model: Model,
    motion: State,
    *,
    load_factor: float = 1.0,
    sections: Mapping[str, SectionForces] | None = None,
) -> InterfaceForces:
    """Forces of all joints, free leaves, springs, pins and sliders on their links; load_factor: factor of the loads along
    them; sections: section forces of the leaves, of statics when None."""
    ends = leaf_end_forces(model, motion, load_factor, sections)
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


def leaf_end_forces(
    model: Model, motion: State, load_factor: float, sections: Mapping[str, SectionForces] | None
) -> list[InterfaceForce]:
    """Forces of every leaf on the nodes at its start and at its end, two rows per leaf."""
    found, members = [], model.arrays.members
    forces = section_forces(model, motion, load_factor=load_factor) if sections is None else sections
    wrenches = end_wrenches(model, motion, load_factor=load_factor)
    for name, parts in leaf_members(model).items():
        first, last = member_ends(model, motion, parts[0]), member_ends(model, motion, parts[-1])
        n, m = wrenches[parts[0], :3], wrenches[parts[0], 3:]
        force, moment = n, m + np.cross(first.d, n)
        if np.abs(forces[name].start[:3] - n).max() > WEIGHTLESS_TOLERANCE * np.abs(n).max():
            # a leaf with loads along it transmits them at its start
            force, moment = forces[name].start[:3], forces[name].start[3:]
        node = model.node_names[members.node[parts[0], 0]]
        found.append(InterfaceForce(name, node, first.start, first.frame @ force, first.frame @ moment))
        n, m = wrenches[parts[-1], :3], wrenches[parts[-1], 3:]
        node = model.node_names[members.node[parts[-1], 1]]
        found.append(InterfaceForce(name, node, last.end, -(last.frame @ n), -(last.frame @ m)))
    return found


def _hinge_forces(model: Model, motion: State, hinge: Any) -> list[InterfaceForce]:
    """Forces of a pin or slider on its links: the sum of its support forces."""
    force, moment = np.zeros(3), np.zeros(3)
    nodes = [model.node_names.index(link) for link in (hinge.a, hinge.b)]
    names, drives = model.support_names, len(model.drive_names)
    for held in hinge.supports(model.scene.plane):
        term = held.terms[0]
        direction = motion.R[nodes[0]] @ np.asarray(term.direction)
        share = -float(motion.multiplier[drives + names.index(held.name)]) * direction
        if term.kind == "translation":
            force = force + share
        else:
            moment = moment + share
    point = point_position(model, motion, nodes[1], hinge.at)
    return [
        InterfaceForce(hinge.name, hinge.a, point, -force, -moment),
        InterfaceForce(hinge.name, hinge.b, point, force, moment),
    ]


def _spring_forces(model: Model, motion: State, i: int, work: Workspace) -> list[InterfaceForce]:
    """Forces of spring or elastic link `i` on the nodes at its ends, from the assembled `work`."""
    springs, name = model.arrays.springs, model.spring_names[i]
    ends, (a, b) = table_ends(springs, motion, i), springs.node[i].tolist()
    n, m = work.lam[len(model.member_names) + i, :6].reshape(2, 3) @ ends.frame.T
    return [
        InterfaceForce(name, model.node_names[a], ends.start, n, m + np.cross(ends.end - ends.start, n)),
        InterfaceForce(name, model.node_names[b], ends.end, -n, -m),
    ]


def spring_energy(model: Model, motion: State) -> dict[str, float]:
    """Energy [J] of all springs and links with a matrix, by name."""
    return {name: energy_of_one_spring(model.arrays, motion, i) for i, name in enumerate(model.spring_names)}
