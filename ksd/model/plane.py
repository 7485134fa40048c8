"""Whether a model is planar, and the same model with three unknowns per node.

The width axes of the leaf springs, drives, supports and loads are checked. Symmetry about the plane is not required: whether
the out-of-plane forces balance is checked on every planar answer, by its spatial residual (`Plane.imbalance`; design
section 4).

A planar model is the spatial one with z, rx and ry left out of the numbering (`Arrays.active_dofs`), for a
plane normal to one of the global axes: same members, same state, same rows; strain-mode leaves condense in closed form
in the angle (`ksd.elements.planar_leaf`). An oblique plane is solved in space.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from ksd.elements.planar_leaf import planar_values, store_size
from ksd.elements.plate_energy import POINT_NUMBERS
from ksd.elements.strain_values import load_constants, strain_value_count, strain_values
from ksd.model.arrays import (
    COIL,
    COROTATIONAL,
    LAST,
    LINEAR,
    MODAL,
    PLANAR,
    SOLID,
    STRAIN,
    TORSION,
    TRANSLATION,
    Arrays,
    Members,
    State,
    Terms,
    Workspace,
)
from ksd.model.pack import renumber, replace_constants
from ksd.scene.listing import vector_text
from ksd.scene.scene import Scene

PARALLEL = 1e-9
"""Sine of the angle below which two directions count as parallel."""
IN_PLANE, OUT_OF_PLANE = (0, 1, 5), (2, 3, 4)
"""Components of the motion of end q in and out of the plane, in a frame p whose e3 is the normal."""


@dataclass(frozen=True)
class Plane:
    """The plane of a spatial model.

    space, rest: its arrays and undeformed state; axis: global axis normal to the plane; rows (r,): constraint rows in the
    plane.
    """

    space: Arrays
    rest: State
    axis: int
    rows: np.ndarray

    @property
    def normal(self) -> np.ndarray:
        """Unit normal k (3,) of the plane, global axes."""
        return np.eye(3)[self.axis]

    @cached_property
    def arrays(self) -> Arrays:
        """The spatial arrays with three unknowns per node."""
        return _planar_arrays(self.space, self.axis, self.rows)

    def contains(self, motion: State) -> bool:
        """Whether no node of a state is displaced or rotated out of the plane."""
        k, size = self.normal, self.space.size
        off = np.abs((motion.x - self.rest.x) @ k).max(initial=0.0)
        return bool(off <= 1e-9 * size and np.abs(motion.R @ k - k).max(initial=0.0) <= 1e-9)

    def imbalance(self, work: Workspace) -> tuple[float, int, float, float]:
        """Largest out-of-plane residual in `work`, as assembled in space by `ksd.model.newton.assemble` at a planar state.

        Returns (residual over its bound, its node, its force [N] along the normal, its moment [Nm] about in-plane axes).
        """
        at = self.space.start[1:, None]
        k = self.normal
        force = np.abs(work.rhs[at + np.arange(3)] @ k)
        moments = work.rhs[at + np.arange(3, 6)]
        moment = np.linalg.norm(moments - np.outer(moments @ k, k), axis=1)
        share = np.maximum(force / (work.scale[1:, 0] + 1e-300), moment / (work.scale[1:, 1] + 1e-300))
        worst = int(np.argmax(share))
        return float(share[worst]), worst + 1, float(force[worst]), float(moment[worst])


class _PlanarTopology(NamedTuple):
    """The part of planar arrays that does not depend on floats.

    arrays: with all floats zero; leaves: leaves with the planar kernel, by the start of their spatial constants, whether
    they have weight, and their settings.
    """

    arrays: Arrays
    leaves: list[tuple[int, bool, tuple[int, ...]]]


@lru_cache(maxsize=64)
def _planar_topology(ints: bytes, axis: int, rows: tuple[int, ...], heavy: bytes) -> _PlanarTopology:
    """The integers of `_planar_arrays`; ints: of `Arrays`, heavy: whether each member has weight, as bytes."""
    flat = np.frombuffer(ints, np.int64)
    space = Arrays(flat, np.zeros(int(flat[LAST])))
    active = np.array([*(c for c in range(3) if c != axis), 3 + axis])
    members, leaves = _planar_members(space.members, np.frombuffer(heavy, bool))
    numbered = renumber(space, active, rows)
    topology = space.replace(
        **numbered
        | {
            "members": members._replace(block=numbered["members"].block),
            # a moment about the normal is conservative in the plane
            "loads": numbered["loads"]._replace(skew=space.loads.following.copy()),
        }
    )
    return _PlanarTopology(topology, leaves)


def _planar_arrays(arrays: Arrays, axis: int, rows: np.ndarray) -> Arrays:
    """The arrays with the unknowns in the plane normal to global axis `axis` and with `rows` only.

    Strain-mode leaves have their planar kernel.
    """
    heavy = arrays.load_modes > 0
    topology, leaves = _planar_topology(arrays.ints.tobytes(), axis, tuple(rows.tolist()), heavy.tobytes())
    value = arrays.members.value
    planar_values_of_leaves = [
        _planar_constants(value[at:], weighs, settings) for at, weighs, settings in leaves
    ]
    return replace_constants(arrays, topology, np.concatenate([value, *planar_values_of_leaves]))


def _planar_members(
    members: Members, heavy: np.ndarray
) -> tuple[Members, list[tuple[int, bool, tuple[int, ...]]]]:
    """The integers of the members with strain-mode leaves on their planar kernel, and `_PlanarTopology.leaves`.

    The planar constants follow the spatial ones of all members.
    """
    kind, number, value_at = members.kind.copy(), members.number.copy(), members.value_at.copy()
    store, end, leaves = np.diff(members.store_at), len(members.value), []
    constants = np.column_stack([members.value_at, heavy, members.number])
    for row in np.unique(constants[kind == STRAIN], axis=0):
        at, weighs, *settings = row.tolist()
        own = (members.kind == STRAIN) & np.all(constants == row, axis=1)
        _, _, planar, of, _ = _unit_leaf(tuple(settings))
        kind[own], number[own], value_at[own] = PLANAR, planar, end
        store[own] = store_size(int(planar[0]), modes=max(settings[5], weighs))
        leaves.append((at, bool(weighs), tuple(settings)))
        end += (
            len(of)
            + planar[4] * (POINT_NUMBERS + settings[2])
            + weighs * load_constants(settings[3], settings[5])
        )
    planar_members = members._replace(
        kind=kind,
        number=number,
        value_at=value_at,
        value=np.zeros(end),
        store_at=np.concatenate([[0], np.cumsum(store)]).astype(np.int64),
    )
    return planar_members, leaves


@lru_cache(maxsize=32)
def _unit_leaf(settings: tuple[int, ...]) -> tuple[slice, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """How the planar constants of a uniform leaf follow from its spatial ones.

    Returns the slice of the mode tables among the spatial constants, these tables, the planar settings, and index and factor
    of the spatial constant that gives each planar constant, without those of plate stiffening.
    """
    nx, ny, nz, ng = settings[:4]
    value, _ = strain_values(
        length=1.0, rigidity=np.ones(3), compliance=np.ones(3), orders=(nx, ny, nz), points=ng
    )
    total, first = nx + ny + nz, 1 + nx * nx + ny * ny
    tables = slice(first + nz * nz + total, first + nz * nz + total + ng * (1 + ng + total))
    multiple, planar = planar_values(value, np.array([nx, ny, nz, ng, 0, 0, 0]))
    planar[4:] = settings[4:7]
    of = np.zeros(len(multiple), np.int64)
    # bending stiffness, stress-free amplitudes, and 1/EA and 1/(ky GA) of each point are copied; all other constants are
    # proportional to the length, spatial constant 0
    own = nz * nz + nz
    of[:own] = np.concatenate([first + np.arange(nz * nz), tables.start - nz + np.arange(nz)])
    multiple[:own] = 1.0
    point = own + (3 + nz) * np.arange(ng)
    for c in (0, 1):
        of[point + 1 + c] = tables.stop + 3 * np.arange(ng) + c
    return tables, value[tables], planar, of, multiple


def _planar_constants(value: np.ndarray, weighs: bool, settings: tuple[int, ...]) -> np.ndarray:
    """Planar constants of a leaf from its spatial ones; weighs: whether it has weight."""
    tables, known, _, of, multiple = _unit_leaf(settings)
    if settings[4] or not np.array_equal(value[tables], known):
        return planar_values(value, np.array(settings), has_weight=weighs)[0]
    constants = multiple * value[of]
    number = np.array(settings)
    own = value[strain_value_count(number) : strain_value_count(number, has_weight=weighs)]
    return np.concatenate([constants, own])


def _normal_axis(arrays: Arrays) -> tuple[int, np.ndarray]:
    """The global axis nearest to the width of the first member, and the width (3,) with its largest component positive."""
    k = arrays.members.frame[0, 0, :, 2]
    k = k / math.sqrt(k @ k)
    axis = int(np.abs(k).argmax())
    return axis, k if k[axis] > 0.0 else -k


def _out_of_plane_member(members: Members, inner: np.ndarray, names: Sequence[str], k: np.ndarray) -> str:
    """Why the first member that is not in the plane normal to k (3,) is not; empty when all are.

    inner: the inner states of the members at rest; names: theirs.
    """
    e3, kind = members.frame[..., 2], members.kind
    off = e3 - (e3 @ k)[..., None] * k
    tilt = np.sqrt((off * off).sum(axis=-1))
    outside = tilt.max(axis=1) > PARALLEL
    kinds = set(kind.tolist())
    if not kinds <= {STRAIN, COROTATIONAL}:
        linear = np.flatnonzero(kind == LINEAR)
        outside |= (kind == MODAL) | (kind == SOLID)
        outside[linear] |= np.array([_is_coupled(inner[members.inner_at[i] :]) for i in linear], bool)
    # a leaf with undeformed amplitudes of zero is straight
    all_straight = kinds == {STRAIN} and not inner.any()
    if not all_straight and LINEAR not in kinds and not outside.any():
        # members of one group have the same constants
        group, first = np.unique(members.value_at, return_index=True)
        bent = [at for at, i in zip(group, first, strict=True) if not _is_planar_leaf(members, int(i))]
        outside = np.isin(members.value_at, bent)
    if not outside.any():
        return ""
    i = int(np.argmax(outside))
    name = names[i]
    if members.kind[i] == LINEAR:
        return f"'{name}' couples motions in the plane with motions out of it"
    if members.kind[i] in (MODAL, SOLID):
        return f"'{name}' is a reduced body, which has no planar form"
    for axis, off in zip(e3[i], tilt[i], strict=True):
        if off > PARALLEL:
            return f"the width of leaf '{name}' is along {vector_text(axis)}, that of the others along {vector_text(k)}"
    return f"leaf '{name}' is curved or twisted out of the plane at rest"


def _is_planar_leaf(members: Members, i: int) -> bool:
    """Whether undeformed member i is neither curved nor twisted out of its plane."""
    value, number = members.value[members.value_at[i] :], members.number[i]
    if members.kind[i] == COROTATIONAL:
        n = int(number[0])
        rotations = np.concatenate([value[: 16 * n].reshape(n, 16)[:, 7:], value[16 * n : 16 * n + 9][None]])
        return bool(np.abs(rotations[:, [2, 5, 6, 7]]).max() <= 1e-12)
    nx, ny, nz = (int(n) for n in number[:3])
    start = 1 + nx * nx + ny * ny + nz * nz
    return not np.any(value[start : start + nx + ny])


def _out_of_plane_spring(springs: Members, rest: np.ndarray, names: Sequence[str], k: np.ndarray) -> str:
    """Why the first spring that is not in the plane normal to k (3,) is not; empty when all are.

    rest: places (nodes, 3) [m] of the nodes at rest.
    """
    for i, name in enumerate(names):
        node, kind = springs.node[i], springs.kind[i]
        if kind == COIL:
            ends = rest[node] + springs.offset[i]
            across = (ends[1] - ends[0]) @ k
            if abs(across) > PARALLEL * springs.length[i]:
                return f"{name} pulls out of the plane, its ends being {1e3 * across:.3g} mm apart along the normal"
        elif np.linalg.norm(np.cross(springs.frame[i, :, :, 2], k), axis=1).max() > PARALLEL:
            return f"{name} has its {'axis' if kind == TORSION else 'width axis'} in the plane"
        elif kind == LINEAR and _is_coupled(springs.value[springs.value_at[i] :]):
            return f"{name} couples in-plane with out-of-plane motions"
    return ""


def _is_coupled(value: np.ndarray) -> bool:
    """Whether a linear body with these constants (`ksd.elements.linear`) couples in-plane with out-of-plane motions."""
    d0, R0, F, K = value[:3], value[3:12].reshape(3, 3), value[12:18], value[18:54].reshape(6, 6)
    coupling = max(
        np.abs(K[np.ix_(IN_PLANE, OUT_OF_PLANE)]).max() / np.abs(K).max(), abs(d0[2]), np.abs(R0[:2, 2]).max()
    )
    return bool(coupling > PARALLEL or np.abs(F[list(OUT_OF_PLANE)]).max() > 0.0)


def _planar_rows(
    terms: Terms, drives: Sequence[str], supports: Sequence[str], k: np.ndarray
) -> np.ndarray | str:
    """Constraint rows (r,) that act in the plane normal to k (3,), or why the first other one does not.

    Supports that only hold the mechanism in the plane are left out.
    """
    if not len(terms.start):
        return np.zeros(0, np.int64)
    is_rotation, d = terms.kind != TRANSLATION, terms.direction @ k
    off = terms.direction - d[:, None] * k
    along, across = np.abs(d), np.sqrt((off * off).sum(axis=1))
    inside = np.where(is_rotation, across, along) <= PARALLEL
    first = terms.first[:-1]
    within = np.logical_and.reduceat(inside, first)
    if within.all():
        return within.nonzero()[0]
    outside = np.where(is_rotation, along, across) <= PARALLEL
    leaving = ~within
    # supports that only hold the mechanism in the plane are allowed
    leaving[len(drives) :] &= ~np.logical_and.reduceat(outside, first)[len(drives) :]
    if not leaving.any():
        return within.nonzero()[0]
    i = int(np.argmax(leaving))
    t = first[i] + int(np.argmin(inside[first[i] : terms.first[i + 1]]))
    what = "rotates about" if is_rotation[t] else "moves along"
    word, name = "drive" if i < len(drives) else "support", (*drives, *supports)[i]
    return f"{word} '{name}' {what} {vector_text(terms.direction[t])}, out of the plane normal to {vector_text(k)}"


def _load_name(scene: Scene, i: int) -> str:
    """Name of load i: loads on moving links in the order of the scene, then weights."""
    names = [
        f"{'line ' * (load.link in scene.unlisted)}load '{load.name}'"
        for load in scene.loads
        if load.link != scene.links[0]
    ]
    names += [f"the weight of link '{mass.link}'" for mass in scene.masses]
    return names[i] if i < len(names) else f"load {i + 1}"


def _out_of_plane_load(arrays: Arrays, scene: Scene, k: np.ndarray) -> str:
    """Why the first load that acts out of the plane normal to k (3,) does; empty when none does."""
    loads = arrays.loads
    outside = f"out of the plane normal to {vector_text(k)}"
    for i in range(len(loads.node)):
        force, moment = loads.force[i], loads.moment[i]
        if abs(force @ k) > PARALLEL * np.linalg.norm(force):
            return f"{_load_name(scene, i)} pushes along {vector_text(force)} N, {outside}"
        if np.linalg.norm(np.cross(moment, k)) > PARALLEL * np.linalg.norm(moment):
            return f"{_load_name(scene, i)} turns about {vector_text(moment)} Nm, {outside}"
    gravity = arrays.weight[:1, 1:4].ravel()
    if len(gravity) and abs(gravity @ k) > PARALLEL * np.linalg.norm(gravity):
        return f"the weight of the leaf springs pulls along {vector_text(gravity)} m/s^2, {outside}"
    for line in scene.line_loads:
        for force in (line.force, line.end_force):
            if abs(force @ k) > PARALLEL * np.linalg.norm(force):
                return f"line load '{line.name}' pushes along {vector_text(force)} N/m, {outside}"
    return ""


def find_plane(
    arrays: Arrays, rest: State, scene: Scene, *, members: Sequence[str], springs: Sequence[str], drives: Sequence[str],
    supports: Sequence[str],
) -> Plane | str:  # fmt: skip
    """The plane of a model, or the reason why it is not planar, a clause that names a leaf, drive, support or load.

    A model is planar if the widths e3 of all leaves are parallel to one direction k, translations of drives and supports and
    all forces are normal to k, rotations and moments are about k. Supports that hold the mechanism in the plane are allowed
    and left out. members, springs, drives, supports: their names.
    """
    if not len(arrays.members.kind):
        return "it has no leaf springs to show a plane"
    axis, k = _normal_axis(arrays)
    if reason := _out_of_plane_member(arrays.members, rest.inner, members, k):
        return reason
    rows = _planar_rows(arrays.terms, drives, supports, k)
    if isinstance(rows, str):
        return rows
    if reason := _out_of_plane_load(arrays, scene, k) or _out_of_plane_spring(
        arrays.springs, rest.x, springs, k
    ):
        return reason
    if max(abs(k[axis - 1]), abs(k[axis - 2])) > PARALLEL:
        return f"its plane, normal to {vector_text(k)}, is normal to none of the global axes"
    return Plane(arrays, rest, axis, rows)
