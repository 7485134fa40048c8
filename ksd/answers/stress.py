"""Stress along leaf springs: bending, axial, torsion and shear stress, and von Mises stress at points of the section.

From the section forces of `ksd.answers.forces` by beam theory, in section axes y (thickness) and z (width):
sigma = N/A + My z/Iy - Mz y/Iz. Shear stress of a rectangle: torsion by the exact series at the middle of its faces and
edges, zero at corners (Timoshenko and Goodier, section 109); shear forces by the parabola 3 V / 2 A on the middle lines.
With plate stiffening Mz varies across the width next to clamps (`PlateStiffening.moment_across`).
Circle and tube: T R/J, and V/A times 4/3 (1 + m + m^2) / (1 + m^2) at the neutral axis, m inner over outer diameter
(Timoshenko, Strength of Materials I, section 26). Any other section: bending at the corners of its outline; torsion T t/J
and shear 1.5 V/A, upper bounds for a strip of its thickness, added everywhere. Stress concentrations at clamps and the
stress of restrained warping near them are not part of beam theory. Stress in Pa, s in m.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ksd.answers.centrelines import (
    DEFAULT_STATIONS,
    leaf_members,
    member_arrays,
    member_ends,
    scene_leaves,
    strain_curves,
)
from ksd.answers.forces import SectionForces, forces_along, section_forces, spring_energy, strain_forces
from ksd.answers.leaf_groups import (
    LeafGroup,
    elastic_stiffness,
    leaf_groups,
    local_loads,
    panel_table_slice,
)
from ksd.answers.printing import NamedAnswers, NamedAnswerTable, PrintableAnswer, format_number
from ksd.answers.state_batch import StateBatch
from ksd.elements import corotational
from ksd.elements.strain_uncondensed import load_derivatives, stretch_shear_compliances
from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.scene.profile import Profile
from ksd.section.closed_forms import round_ratio
from ksd.section.plate import PlateStiffening
from ksd.section.section import Section, thickness_and_width

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StressPoints:
    """Points of a section, y, z (p,) [m], with names (p,), and their shear stress per unit force.

    torsion, along_y, along_z (p, 2): (tau_xy, tau_xz) per unit T [1/m^3] and per unit Vy, Vz [1/m^2].
    """

    names: tuple[str, ...]
    y: Array
    z: Array
    torsion: Array
    along_y: Array
    along_z: Array


@dataclass(frozen=True, repr=False)
class LeafStress(PrintableAnswer):
    """Stress of one leaf at k stations s (k,) [m] and p points of its section.

    points (p,): names of the points; y, z (k, p) [m]: their section coordinates. normal_Pa, shear_Pa, von_mises_Pa (k, p).
    bending_Pa, axial_Pa, torsion_Pa, transverse_Pa (k,): parts, largest over the section (axial with sign).
    """

    name: str
    s: Array
    points: tuple[str, ...]
    y: Array
    z: Array
    normal_Pa: Array
    shear_Pa: Array
    von_mises_Pa: Array
    bending_Pa: Array
    axial_Pa: Array
    torsion_Pa: Array
    transverse_Pa: Array

    @property
    def largest_Pa(self) -> float:
        """Largest von Mises stress of the leaf."""
        return float(self.von_mises_Pa.max())

    @property
    def where(self) -> tuple[float, str]:
        """Station s [m] and point of the section of the largest stress."""
        k, p = np.unravel_index(int(np.argmax(self.von_mises_Pa)), self.von_mises_Pa.shape)
        return float(self.s[k]), self.points[int(p)]

    def _line(self) -> str:
        return str(self)

    def __str__(self) -> str:
        s, point = self.where
        return f"{self.name}: {self.largest_Pa / 1e6:.4g} MPa at s = {s * 1e3:.4g} mm, {point}"


CATALAN = 0.915965594177219015
"""Sum of 1 - 1/9 + 1/25 - ..."""


def torsion_factors(ratio: float) -> tuple[float, float]:
    """Shear stress over T t/J at the middle of the wide and of the narrow sides of a rectangle with ratio w/t >= 1.

    1 - (8/pi^2) sum_odd 1/(n^2 cosh(n pi w/2t)) and (8/pi^2) sum_odd (-1)^((n-1)/2) tanh(n pi w/2t)/n^2.
    """
    wide = narrow = 0.0
    # with tanh x = 1 - 2 / (exp(2 x) + 1) both series converge like exp(-x)
    for n in range(1, 26, 2):
        x = 0.5 * n * math.pi * ratio
        if x > 40.0:
            break
        wide += 1.0 / (n**2 * math.cosh(x))
        narrow += (2 - n % 4) * 2.0 / (n**2 * (math.exp(2 * x) + 1.0))
    return 1.0 - 8 / math.pi**2 * wide, 8 / math.pi**2 * (CATALAN - narrow)


def _rectangle_points(q: Any) -> StressPoints:
    """Stress points of a rectangle: corners, middles of the sides, and centre."""
    t, w = thickness_and_width(q)
    y = 0.5 * t * np.array([1, 1, -1, -1, 1, -1, 0, 0, 0])
    z = 0.5 * w * np.array([1, -1, 1, -1, 0, 0, 1, -1, 0])
    names = (
        "corner +y +z",
        "corner +y -z",
        "corner -y +z",
        "corner -y -z",
        "face +y",
        "face -y",
        "edge +z",
        "edge -z",
        "centre",
    )
    wide, narrow = torsion_factors(max(w / t, t / w))
    at_face, at_edge = (wide, narrow) if w >= t else (narrow, wide)
    short = min(t, w)
    torsion, along_y, along_z = np.zeros((9, 2)), np.zeros((9, 2)), np.zeros((9, 2))
    # positive twist moves +y faces towards +z, +z edges towards -y
    torsion[4, 1], torsion[5, 1] = at_face * short / q.J, -at_face * short / q.J
    torsion[6, 0], torsion[7, 0] = -at_edge * short / q.J, at_edge * short / q.J
    along_y[6:, 0] = along_z[[4, 5, 8], 1] = 1.5 / q.A
    return StressPoints(names, y, z, torsion, along_y, along_z)


def _round_points(q: Any, hole: float) -> StressPoints:
    """Stress points of a circle or tube: eight points of the rim, and the centre of a circle; hole: inner over outer
    diameter."""
    r, angle = 0.5 * q.thickness, np.arange(8) * math.pi / 4
    names = (*(f"rim {45 * k} deg" for k in range(8)), *["centre"] * (hole == 0.0))
    y, z = np.zeros((2, len(names)))
    y[:8], z[:8] = r * np.cos(angle), r * np.sin(angle)
    torsion = np.column_stack([-z, y]) / q.J
    along_y, along_z = np.zeros((2, len(names), 2))
    # parabola in the distance from the axis normal to the force
    most = 4 / 3 * (1 + hole + hole**2) / (1 + hole**2) / q.A
    along_y[:, 0], along_z[:, 1] = most * (1 - (y / r) ** 2), most * (1 - (z / r) ** 2)
    return StressPoints(names, y, z, torsion, along_y, along_z)


def _outline_points(q: Any) -> StressPoints:
    """Stress points of an outline: its corners, with upper bounds of the shear stress at each."""
    ring = np.array(q.outline[0])
    count = len(ring)
    names = tuple(f"corner {k + 1}" for k in range(count))
    torsion, along_y, along_z = np.zeros((count, 2)), np.zeros((count, 2)), np.zeros((count, 2))
    torsion[:, 1] = min(q.thickness, q.width) / q.J
    along_y[:, 0] = along_z[:, 1] = 1.5 / q.A
    return StressPoints(names, ring[:, 0], ring[:, 1], torsion, along_y, along_z)


@lru_cache(maxsize=1024)
def stress_points(section: Any) -> StressPoints:
    """Points at which the stress of a section is evaluated; the kind of section follows from its outline and numbers."""
    if section.outline is not None:
        return _outline_points(section)
    ratio = round_ratio(section)
    return _rectangle_points(section) if ratio is None else _round_points(section, ratio)


@lru_cache(maxsize=1024)
def _section_tables(sections: tuple[Any, ...]) -> tuple[Array, ...]:
    """Arrays of the sections along a leaf: y, z (s, p), A, Iy, Iz (s, 1), torsion, along_y, along_z (2, 1, s, p).

    s is 1 for a uniform leaf. The last point of a section with fewer points than others is repeated.
    """
    points = [stress_points(q) for q in sections]
    count = max(len(f.names) for f in points)
    index = [np.minimum(np.arange(count), len(f.names) - 1) for f in points]
    y, z, *shear = (
        np.array([getattr(f, n)[own] for f, own in zip(points, index, strict=True)])
        for n in ("y", "z", "torsion", "along_y", "along_z")
    )
    sizes = (np.array([[getattr(q, n)] for q in sections]) for n in ("A", "Iy", "Iz"))
    return y, z, *sizes, *(np.moveaxis(v, 2, 0)[:, None] for v in shear)


@lru_cache(maxsize=1024)
def _point_names(sections: tuple[Any, ...]) -> tuple[str, ...]:
    """Names of the points of a leaf with these sections; those of one point in sections of several kinds are joined."""
    kinds = list(dict.fromkeys(stress_points(q).names for q in sections))
    return tuple(
        " or ".join(dict.fromkeys(own[min(p, len(own) - 1)] for own in kinds))
        for p in range(max(map(len, kinds)))
    )


def _weaker_section(profile: Profile, s: float) -> Section:
    """Section at fraction s; at a step, that with the smaller section modulus in bending."""
    return min(profile.sides(s), key=lambda q: q.Iz / thickness_and_width(q)[0])


def _sections_along(leaf: Any, s: Array) -> tuple[Any, ...]:
    """Sections of a leaf at stations s [m]; one for a uniform leaf."""
    profile = getattr(leaf, "profile", None)
    if profile is None:
        return (leaf.section,)
    return tuple(_weaker_section(profile, x) for x in (s / s[-1]).tolist())


def signed_stress(forces: list[SectionForces], leaf: Any) -> tuple[Array, Array]:
    """Normal stress (k, s, p) and shear stress (k, 2, s, p) along y and z [Pa] by k section forces of one leaf."""
    stations = _section_tables(_sections_along(leaf, forces[0].s))
    values = np.array([f.values for f in forces])
    uneven = _uneven_moments(values, forces[0].s, leaf, stations[1])
    normal, *_, twist, transverse = _stresses(values, stations, outlined=False, uneven=uneven)
    return normal, np.moveaxis(twist + transverse, 0, 1)


def _leaf_stresses(forces: list[SectionForces], leaf: Any) -> list[LeafStress]:
    """Stress of leaf springs that have the section, or the profile, of `leaf`, and the same stations."""
    s, sections = forces[0].s, _sections_along(leaf, forces[0].s)
    stations = _section_tables(sections)
    outlined = any(q.outline is not None for q in sections)
    values = np.array([f.values for f in forces])
    uneven = _uneven_moments(values, s, leaf, stations[1])
    *parts, bending, axial, twist, transverse = _stresses(values, stations, outlined=outlined, uneven=uneven)
    parts += [np.abs(bending).max(axis=2), axial[..., 0]]
    parts += [_size(shear).max(axis=2) for shear in (twist, transverse)]
    positions = [np.broadcast_to(v, (len(s), v.shape[1])) for v in stations[:2]]
    names = _point_names(sections)
    return [LeafStress(f.name, f.s, names, *positions, *(v[k] for v in parts)) for k, f in enumerate(forces)]


def _plate(leaf: Any) -> PlateStiffening | None:
    """Plate stiffening of a leaf, if it has any."""
    return None if getattr(leaf, "condition", None) is None else leaf.condition.plate


def _uneven_moments(values: Array, s: Array, leaf: Any, z: Array) -> Array | float:
    """What Mz of section forces (leaves, s, 6) has more at points z (s or 1, p) of the section: next to clamps of a leaf
    with plate stiffening, else nothing."""
    plate = _plate(leaf)
    if plate is None:
        return 0.0
    width = max(float(z.max()), 1e-300)
    return plate.moment_across(s / s[-1], np.broadcast_to(z / width, (len(s), z.shape[1])), values[..., 5])


def _stresses(
    values: Array, stations: tuple[Array, ...], *, outlined: bool, uneven: Array | float = 0.0
) -> tuple[Array, ...]:
    """Stress (leaves, s, p) by section forces (leaves, s, 6).

    Returns normal, shear, von Mises and bending stress (leaves, s, p), axial stress (leaves, s, 1), and shear stress of
    torsion and of transverse forces (2, leaves, s, p) along y and z. stations: as of `_section_tables`, with an axis over
    leaves before that over stations where leaves differ; outlined: upper bounds of the shear stress are added; uneven
    (leaves, s, p): added to Mz.
    """
    y, z, A, Iy, Iz, torsion, along_y, along_z = stations
    N, Vy, Vz, T, My, Mz = np.moveaxis(values, 2, 0)[..., None]
    axial = N / A
    bending = My * z / Iy - (Mz + uneven) * y / Iz
    twist, transverse = T * torsion, Vy * along_y + Vz * along_z
    shear = (
        np.abs(twist).sum(axis=0) + np.abs(transverse).sum(axis=0) if outlined else _size(twist + transverse)
    )
    normal = axial + bending
    mises = np.sqrt(normal**2 + 3 * shear**2)
    return normal, shear, mises, bending, axial, twist, transverse


def _size(shear: Array) -> Array:
    """Magnitude of shear stress with components (2, ...); `np.hypot` takes nearly three times as long."""
    y, z = shear
    size: Array = np.sqrt(y * y + z * z)
    return size


class PeakStress(NamedTuple):
    """Largest von Mises stress [Pa] of a leaf, its station s [m] and point of the section."""

    largest_Pa: float
    s: float
    point: str


def _mises_by_section_kind(
    forces: Array, number: NDArray[np.int64], tables: list[_PointTable]
) -> Iterator[tuple[NDArray[np.int64], Array]]:
    """Yield indices of leaf springs whose sections have the same kind and number of points, and their von Mises stress.

    forces (leaves, S, 6): section forces; number (leaves,): section of each in `tables`; stress (n, S, P) [Pa].
    """
    kinds = [(len(table.rows), table.outlined) for table in tables]
    for kind in dict.fromkeys(kinds[n] for n in number.tolist()):
        mine = [n for n, own in enumerate(kinds) if own == kind]
        position = np.full(len(kinds), -1)
        position[mine] = np.arange(len(mine))
        pick = np.flatnonzero(position[number] >= 0)
        rows = np.array([tables[n].rows for n in mine])[position[number[pick]]]
        yield pick, _stresses(forces[pick], _station_arrays(rows), outlined=kind[1])[2]


class _BatchLeaves(NamedTuple):
    """Leaves of a group in all states, one state after the other.

    value (n, v): constants; inner (n, N + 6): inner states; number (n,): section of each leaf in `sections`.
    """

    value: Array
    inner: Array
    number: NDArray[np.int64]
    sections: list[Any]


def _batch_leaves(states: StateBatch, group: LeafGroup, *, profiles: bool = False) -> _BatchLeaves | None:
    """Leaves of a group in all states of a batch.

    None where leaf springs have weight, plate stiffening or points that divide them, or a profile unless `profiles`, and
    where panels differ between states (steps and kinks of profiles at different fractions).
    """
    names = [states.models[0].member_names[i] for i in group.members.tolist()]
    leaves = scene_leaves(states.models[0])
    if group.has_loads or any(n not in leaves or not (profiles or leaves[n].profile is None) for n in names):
        return None
    if any(_plate(leaves[n]) is not None for n in names):
        return None
    value = states.member_constants(group.members, group.value.shape[1])
    panels = panel_table_slice(group.number)
    if not (np.abs(value[..., panels] - group.value[:, panels]) <= 1e-12).all():
        return None
    inner = np.take(states.motion.inner, group.inner_index, axis=1)
    count = len(value) * len(names)
    number, sections = _batch_sections(states, names)
    return _BatchLeaves(value.reshape(count, -1), inner.reshape(count, -1), number.ravel(), sections)


def _profiled_leaves(states: StateBatch, group: LeafGroup) -> list[Any]:
    """Leaf springs of a group in all states, one state after the other; empty where they have no profiles."""
    names = [states.models[0].member_names[i] for i in group.members.tolist()]
    own = [scene_leaves(model) for model in states.models]
    if any(own[0][n].profile is None for n in names):
        return []
    return [own[u][n] for u in states.model_index.tolist() for n in names]


def _batch_sections(states: StateBatch, names: list[str]) -> tuple[NDArray[np.int64], list[Any]]:
    """Number (D, k) of the section of every leaf in every state, and the different sections."""
    sections: list[Any] = []
    known: dict[int, int] = {}
    number = np.empty((len(states.models), len(names)), np.int64)
    for row, model in zip(number, states.models, strict=True):
        leaves = scene_leaves(model)
        for k, name in enumerate(names):
            q = leaves[name].section
            if id(q) not in known:
                known[id(q)] = len(sections)
                sections.append(q)
            row[k] = known[id(q)]
    return number[states.model_index], sections


def batch_peak_stress(
    states: StateBatch, *, points: int = DEFAULT_STATIONS
) -> list[dict[str, PeakStress]] | None:
    """Largest stress of every leaf by full name, for every state.

    None where leaf springs have weight, plate stiffening, a profile or points that divide them, or where panels differ;
    `stress` evaluates such states one by one.
    """
    names = states.models[0].member_names
    found: list[dict[str, Any]] = [dict.fromkeys(names) for _ in states.model_index]
    for group in leaf_groups(states.models[0]):
        leaves = _batch_leaves(states, group)
        if leaves is None:
            return None
        value, inner, number, sections = leaves
        s, forces = strain_forces(value, inner, group.number, points)
        for pick, mises in _mises_by_section_kind(forces, number, [_point_table(q) for q in sections]):
            at = mises.reshape(len(mises), -1).argmax(axis=1)
            for row, j in enumerate(pick.tolist()):
                state, k = divmod(j, len(group.members))
                station, point = divmod(int(at[row]), mises.shape[2])
                found[state][names[group.members[k]]] = PeakStress(
                    float(mises[row, station, point]),
                    float(s[j, station]),
                    stress_points(sections[number[j]]).names[point],
                )
    return found


def batch_stress_at_peaks(
    states: StateBatch, reference: NDArray[np.int64], *, points: int = DEFAULT_STATIONS
) -> dict[str, Array] | None:
    """Von Mises stress (D,) [Pa] of every leaf by full name, at fixed points, for finite differences.

    In state d it is evaluated at the station and point of the section where the stress of the leaf is largest in state
    reference[d] (D,). None where leaf springs have weight, plate stiffening or points that divide them, panels differ,
    or sections of a leaf have different points.
    """
    model = states.models[0]
    stress = np.empty((len(reference), len(model.member_names)))
    for group in leaf_groups(model):
        leaves = _batch_leaves(states, group, profiles=True)
        if leaves is None:
            return None
        value, inner, number, sections = leaves
        s, r, R = strain_curves(value, group.number, inner, points)
        wrench = inner[:, None, group.modes :]
        # leaves of the reference states, and for every leaf the number of its reference among these
        own, of = np.unique(reference, return_inverse=True)
        every = np.arange(len(number)).reshape(len(reference), -1)
        lead, of = every[own].ravel(), every[: len(own)][of].ravel()
        worst, tables = np.empty((2, len(lead)), np.int64), [_point_table(q) for q in sections]
        forces, profiled = forces_along(r[lead], R[lead], wrench[lead]), _profiled_leaves(states, group)
        stresses = _mises_by_section_kind(forces, number[lead], tables)
        if profiled:
            along = (SectionForces("", s[i], own) for i, own in zip(lead.tolist(), forces, strict=True))
            each = (_leaf_stresses([f], profiled[i])[0] for i, f in zip(lead.tolist(), along, strict=True))
            stresses = ((np.array([k]), leaf.von_mises_Pa[None]) for k, leaf in enumerate(each))
        for pick, mises in stresses:
            worst[:, pick] = np.divmod(mises.reshape(len(mises), -1).argmax(axis=1), mises.shape[2])
        station, point = worst[:, of]
        if profiled:
            # the section of every leaf spring at its station
            at = (s[np.arange(len(s)), station] / s[:, -1]).tolist()
            tables = [_point_table(_weaker_section(f.profile, x)) for f, x in zip(profiled, at, strict=True)]
            number = np.arange(len(tables))
        count = np.array([len(table.rows) for table in tables])[number]
        if (count != count[lead][of]).any() or (point >= count).any():
            return None
        # section forces at the station need its distance from the end, so both are evaluated
        index = every.reshape(-1, 1), np.column_stack([station, np.full(len(number), -1)])
        forces = forces_along(r[index], R[index], wrench)[:, :1]
        begin = np.cumsum([0, *(len(table.rows) for table in tables)])
        rows = np.concatenate([table.rows for table in tables])[begin[number] + point][:, None]
        outlined = np.array([table.outlined for table in tables])[number]
        largest = np.empty(len(number))
        for kind in set(outlined.tolist()):
            pick = outlined == kind
            largest[pick] = _stresses(forces[pick], _station_arrays(rows[pick]), outlined=kind)[2].ravel()
        stress[:, group.members] = largest.reshape(every.shape)
    return dict(zip(model.member_names, stress.T, strict=True))


class _PointTable(NamedTuple):
    """Table of the points of a section.

    rows (p, 11): y, z of the points, A, Iy, Iz of the section, and (tau_xy, tau_xz) of torsion, along_y, along_z; outlined:
    the section is defined by its outline.
    """

    rows: Array
    outlined: bool


@lru_cache(maxsize=1024)
def _point_table(section: Any) -> _PointTable:
    """Table of a section."""
    at = stress_points(section)
    rows = np.empty((len(at.y), 11))
    rows[:, 0], rows[:, 1], rows[:, 2:5] = at.y, at.z, (section.A, section.Iy, section.Iz)
    rows[:, 5:7], rows[:, 7:9], rows[:, 9:] = at.torsion, at.along_y, at.along_z
    return _PointTable(rows, section.outline is not None)


def _station_arrays(rows: Array) -> tuple[Array, ...]:
    """`stations` of `_stresses` for uniform leaf springs with rows (n, p, 11) of `_point_table`."""
    columns = np.moveaxis(rows, 2, 0)[:, :, None]
    return *columns[:5], *columns[5:].reshape(3, 2, *columns.shape[1:])


@dataclass(frozen=True, repr=False)
class Stress(PrintableAnswer):
    """Stress of all leaf springs; leaves: by full name, which is also the index: ``stress["guide/low"]``."""

    leaves: dict[str, LeafStress]

    def __getitem__(self, name: str) -> LeafStress:
        return self.leaves[name]

    @property
    def largest_Pa(self) -> float:
        """Largest von Mises stress of the mechanism."""
        return max(leaf.largest_Pa for leaf in self.leaves.values())

    @property
    def where(self) -> tuple[str, float, str]:
        """Leaf, station s [m] and point of the section of the largest stress."""
        worst = max(self.leaves.values(), key=lambda leaf: leaf.largest_Pa)
        return worst.name, *worst.where

    def _line(self) -> str:
        name, s, point = self.where
        return f"at most {self.largest_Pa / 1e6:.4g} MPa, in '{name}' at s = {s * 1e3:.4g} mm, {point}"

    def __str__(self) -> str:
        return "\n".join(str(leaf) for leaf in self.leaves.values())


def stress(
    model: Model, motion: State, *, points: int = DEFAULT_STATIONS, load_factor: float = 1.0
) -> Stress:
    """Stress at `points` stations of every strain-mode leaf, or at the nodes of a chain (in a nodal mesh at both ends of
    every element)."""
    return stress_from_forces(model, section_forces(model, motion, points=points, load_factor=load_factor))


def stress_from_forces(model: Model, section_forces: dict[str, SectionForces]) -> Stress:
    """Stress by section forces of leaf springs (by full name), those of a state or of the change between two states."""
    leaves = scene_leaves(model)
    equal: dict[Any, list[str]] = {}
    for name, forces in section_forces.items():
        leaf = leaves[name]
        # leaves with a profile are evaluated one by one
        kind = (leaf.section, _plate(leaf)) if getattr(leaf, "profile", None) is None else name
        equal.setdefault((kind, forces.s.tobytes()), []).append(name)
    stresses: dict[str, LeafStress] = {}
    for names in equal.values():
        stresses |= zip(
            names, _leaf_stresses([section_forces[n] for n in names], leaves[names[0]]), strict=True
        )
    return Stress(NamedAnswers({name: stresses[name] for name in section_forces}, "leaf"))


def strain_energy(model: Model, motion: State, *, load_factor: float = 1.0) -> NamedAnswerTable[float]:
    """Strain energy [J] of every leaf by full name, and of springs."""
    energies: dict[int, float] = {}
    for group in leaf_groups(model):
        energies |= zip(
            group.members.tolist(), _strain_energies(model, motion, group, load_factor).tolist(), strict=True
        )
    leaves = {
        n: sum(energies[i] if i in energies else _chain_energy(model, motion, i) for i in members)
        for n, members in leaf_members(model).items()
    }
    if model.spring_names:
        leaves |= spring_energy(model, motion)
    title = f"Strain energy: {format_number(sum(leaves.values()), 5)} J in all"
    return NamedAnswerTable(
        leaves, title, ("leaf or spring", "energy [J]"), lambda energy: (format_number(energy, 5),)
    )


def _strain_energies(model: Model, motion: State, group: LeafGroup, load_factor: float) -> Array:
    """Energy (k,) [J] of every leaf of a group: 1/2 (a - a0) K (a - a0) + 1/2 int n(s).(R C R^T n(s))."""
    N, inner = group.modes, motion.inner[group.inner_index]
    rest = 1 + sum(int(n) ** 2 for n in group.number[:3])
    amplitudes = inner[:, :N] - group.value[:, rest : rest + N]
    force = inner[:, N : N + 3]
    compliance = stretch_shear_compliances(group.value, group.number, inner)
    loads = local_loads(model, motion, group, load_factor)
    energy: Array = 0.5 * np.einsum("ki,kij,kj->k", amplitudes, elastic_stiffness(group), amplitudes)
    energy += 0.5 * np.einsum("ki,kij,kj->k", force, compliance, force)
    if loads is not None:
        # n(s) = n + Q(s) f
        derivatives = load_derivatives(group.value, group.number, inner, loads)
        energy += np.einsum("ki,kij,kj->k", force, derivatives.B, loads)
        energy += 0.5 * np.einsum("ki,kij,kj->k", loads, derivatives.D, loads)
    return energy


def _chain_energy(model: Model, motion: State, i: int) -> float:
    """Strain energy [J] of member i: sum of S eps^2/2 of the elements of a chain, or that of a reduced solid."""
    value, number, inner = member_arrays(model, motion, i)
    ends = member_ends(model, motion, i)
    if model.member_names[i] in model.solids:
        return float(model.bodies[model.member_names[i]].energy(ends.d, ends.Q, inner))
    d, Q = np.ascontiguousarray(ends.d), np.ascontiguousarray(ends.Q)
    return float(corotational.energy(value, number, np.ascontiguousarray(inner), d, Q))
