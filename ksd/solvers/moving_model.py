"""The model of a time step: that of statics with inertia, dashpots, and drives that are let go."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ksd.answers.mass import member_leaves
from ksd.elements.inertia import inertia_store, inertia_tables, orthogonal_modes
from ksd.elements.plate_energy import POINT_NUMBERS
from ksd.elements.strain_uncondensed import quadrature_points
from ksd.elements.strain_values import strain_value_count
from ksd.errors import SceneError
from ksd.model.arrays import (
    COROTATIONAL,
    LINEAR,
    LOAD_NUMBERS,
    MODAL,
    PLANAR,
    ROTATION,
    SOLID,
    TRANSLATION,
    Arrays,
    Bodies,
    State,
    angle_count,
)
from ksd.model.compile import Model, compile_as_is
from ksd.model.leaves import loads_of_pieces, mass_density
from ksd.model.pack import renumber
from ksd.model.plane import Plane

Array = NDArray[np.float64]
HEAVY_LEAVES = 0.2
"""Share of the leaf springs in the moving mass above which they have HEAVY_MODES force modes instead of FORCE_MODES."""
WEAK_DASHPOT = 1e-30
"""Dashpot [N s/m or Nm s] by which the force of a drive that is let go acts on."""
FORCE_MODES, HEAVY_MODES, COUPLE_MODES = 4, 6, 3
"""Modes of the inertia of a leaf: forces, and in space couples about the axes of its width."""


@dataclass(frozen=True)
class MovingModel:
    """A model in motion.

    model: of statics; arrays: of a time step; rest: its undeformed state. rows (c,): whether a row has a multiplier; inner
    (s,): positions of the inner state of statics in that of a time step. body (nodes, 21): of every node tr(J)/2 I - J, the
    inverse of J, and the centre of mass, unit numbers where it has no mass. modes (m, 2): of every member the numbers of
    force and of all modes; tau (m,) [s]: its loss factor over the angular frequency at which that holds.
    leaf_mass (m,) [kg]; plane: of the motion, None in space. lines (2, l, m, modes, 3): accelerations [m/s^2] of the force
    modes of every member by the line loads of the scene, and the forces [N] of these on the modes.
    """

    model: Model
    arrays: Arrays
    rest: State
    rows: NDArray[np.bool_]
    inner: NDArray[np.int64]
    body: Array
    modes: NDArray[np.int64]
    tau: Array
    leaf_mass: Array
    plane: Plane | None
    lines: Array

    def moving_state(self, state: State) -> State:
        """The state of a time step at a state of statics: forces of inertia and known places are zero."""
        inner = self.rest.inner.copy()
        inner[self.inner] = state.inner
        terms, more = len(self.model.arrays.terms.node), len(self.arrays.terms.node)
        angle = np.concatenate([state.angle[:terms], np.zeros(more - terms), state.angle[terms:]])
        multiplier = np.concatenate([state.multiplier, np.zeros(len(self.rows) - len(state.multiplier))])
        multiplier[~self.rows] = 0.0
        return State(state.x.copy(), state.R.copy(), inner, multiplier, angle)

    def static_parts(self) -> NDArray[np.int64]:
        """Positions (n,) of the numbers of a state of statics in the flat state of a time step."""
        terms, more = len(self.model.arrays.terms.node), len(self.arrays.terms.node)
        sizes = [
            self.rest.x.size + self.rest.R.size,
            len(self.rest.inner),
            len(self.rows),
            len(self.rest.angle),
        ]
        at = np.concatenate([[0], np.cumsum(sizes)])
        angle = np.concatenate([np.arange(terms), np.arange(more, sizes[3])])
        rows = np.arange(len(self.model.arrays.terms.start))
        return np.concatenate([np.arange(at[1]), at[1] + self.inner, at[2] + rows, at[3] + angle])


def refuse_what_does_not_move(model: Model) -> None:
    """Raise SceneError for a model with members that have no form in time steps."""
    kinds = {
        COROTATIONAL: "a chain of elements",
        MODAL: "a modal body",
        SOLID: "a reduced solid",
        LINEAR: "a reduced body",
    }
    for load in model.scene.pressures:
        raise SceneError(
            f"pressure '{load.name}' has no motion in time: simulate with a line load in its place, which keeps its "
            "direction"
        )
    for name, kind in zip(model.member_names, model.arrays.members.kind.tolist(), strict=True):
        if kind in kinds:
            raise SceneError(
                f"leaf '{name}' is {kinds[kind]}, which has no motion in time; simulate with the strain-mode mesh, "
                "ksd.Mesh()"
            )


def rigid_bodies(model: Model) -> dict[int, tuple[float, Array, Array]]:
    """Mass [kg], centre of mass (3,) [m] from the reference point of the node, and inertia (3, 3) [kg m^2] about it of every
    moving node that has mass."""
    parts: dict[int, list[tuple[float, Array, Array]]] = {}
    for mass in model.scene.masses:
        node = model.scene.links.index(mass.link)
        if node:
            at = np.asarray(mass.at, float) - model.rest.x[node]
            parts.setdefault(node, []).append((mass.mass, at, np.asarray(mass.inertia, float)))
    found = {}
    for node, own in parts.items():
        total = sum(m for m, _, _ in own)
        centre = np.asarray(sum(m * at for m, at, _ in own)) / total if total > 0.0 else own[0][1]
        inertia = np.zeros((3, 3))
        for m, at, J in own:
            d = at - centre
            inertia += J + m * (d @ d * np.eye(3) - np.outer(d, d))
        found[node] = total, centre, inertia
    return found


def moving_model(
    model: Model,
    freed: Collection[str] = (),
    *,
    damping_at: float | None = None,
    is_released: bool = False,
    spatial: bool = False,
) -> MovingModel:
    """The model of a time step of a static `model`; freed: drives that are let go.

    damping_at [Hz]: frequency at which the materials have their loss factors. is_released: the drives that are let go pull
    on for a while. spatial: six unknowns per node in any case.
    Raises SceneError where something in it cannot move in time, and where nothing has mass.
    """
    refuse_what_does_not_move(model)
    light = model
    if model.scene.gravity is not None or model.scene.line_loads:
        light = compile_as_is(replace(model.scene, gravity=None, line_loads=()), model.mesh)
    found = model.plane
    plane = None if isinstance(found, str) or spatial else found
    arrays, rows = light.arrays, np.arange(len(model.arrays.terms.start))
    if plane is not None:
        arrays, rows = Plane(light.arrays, light.rest, plane.axis, plane.rows).arrays, plane.rows
    names = (*model.drive_names, *model.support_names)
    kept = [int(r) for r in rows if names[r] not in freed]
    arrays = _with_dashpots(model, arrays)
    dashpots = list(range(len(names), len(arrays.terms.start)))
    if is_released:
        released = [names.index(name) for name in freed]
        arrays.terms.damping[released] = WEAK_DASHPOT
        dashpots += [r for r in released if r in rows]
    bodies = rigid_bodies(model)
    arrays = arrays.replace(bodies=_packed_bodies(bodies))
    arrays = arrays.replace(**renumber(arrays, arrays.active_dofs, kept, dashpots))
    arrays, inner, tau, mass, modes = _with_leaf_inertia(model, light, arrays, bodies, damping_at)
    has_row = np.zeros(len(arrays.terms.start), bool)
    has_row[kept] = True
    arrays = arrays.replace(known=np.zeros((len(arrays.start), 12)))
    if not (mass.any() or any(m > 0.0 or J.any() for m, _, J in bodies.values())):
        raise SceneError(
            "nothing in this scene has mass, so nothing moves in time: give a material its density [kg/m^3] or a link its "
            "mass [kg]"
        )
    size = int(arrays.members.inner_at[-1])
    rest = State(
        model.rest.x, model.rest.R, np.zeros(size), np.zeros(len(has_row)), np.zeros(angle_count(arrays))
    )
    return MovingModel(
        model, arrays, rest, has_row, inner, _node_bodies(bodies, len(arrays.start)), modes, tau, mass, plane,
        _line_loads(model, light, modes[:, 0]),
    )  # fmt: skip


def _with_dashpots(model: Model, arrays: Arrays) -> Arrays:
    """A copy of the arrays with a row of one term for every damper of the scene."""
    dampers, links, terms = model.scene.dampers, model.scene.links, arrays.terms
    if not dampers:
        return arrays.copy()
    count, nodes = (
        len(dampers),
        np.array([[links.index(d.term.base), links.index(d.term.link)] for d in dampers]),
    )
    at = np.array([d.term.point for d in dampers])[:, None] - model.rest.x[nodes]
    more = {
        "first": terms.first[-1] + 1 + np.arange(count),
        "start": np.full(count, -1, np.int64),
        "coefficient": np.array([d.term.coefficient for d in dampers]),
        "kind": np.array(
            [TRANSLATION if d.term.kind == "translation" else ROTATION for d in dampers], np.int64
        ),
        "node": nodes.astype(np.int64),
        "direction": np.array([d.term.direction for d in dampers]),
        "point": at,
        "block": np.full((count, 5), -1, np.int64),
        "flip": np.zeros(count, np.int64),
        "damping": np.array([d.damping for d in dampers]),
    }
    return arrays.replace(
        terms=terms._replace(**{n: np.concatenate([getattr(terms, n), own]) for n, own in more.items()})
    )


def _spread(inertia: Array) -> Array:
    """tr(J)/2 I - J of an inertia (3, 3)."""
    return 0.5 * np.trace(inertia) * np.eye(3) - inertia


def _packed_bodies(bodies: Mapping[int, tuple[float, Array, Array]]) -> Bodies:
    """`Bodies` without blocks."""
    rows = [np.concatenate([[m], centre, _spread(J).ravel()]) for m, centre, J in bodies.values()]
    nodes = np.array(list(bodies), np.int64)
    return Bodies(nodes, np.array(rows).reshape(-1, 13), np.full(len(nodes), -1, np.int64))


def _node_bodies(bodies: Mapping[int, tuple[float, Array, Array]], nodes: int) -> Array:
    """`MovingModel.body`."""
    found = np.zeros((nodes, 21))
    found[:, :18] = np.concatenate([0.5 * np.eye(3), np.eye(3)], axis=None)
    for node, (_, centre, J) in bodies.items():
        found[node, 18:] = centre
        if np.linalg.eigvalsh(J)[0] > 0.0:
            found[node, :18] = np.concatenate([_spread(J), np.linalg.inv(J)], axis=None)
    return found


def _with_leaf_inertia(
    model: Model,
    light: Model,
    arrays: Arrays,
    bodies: Mapping[int, tuple[float, Array, Array]],
    damping_at: float | None,
) -> tuple[Arrays, NDArray[np.int64], Array, Array, NDArray[np.int64]]:
    """The arrays with the inertia of leaf springs; returns also `MovingModel.inner`, .tau, .leaf_mass and .modes."""
    members, owner, count = arrays.members, member_leaves(model), len(arrays.members.kind)
    lines, space = {}, light.arrays.members
    mass, tau, modes = np.zeros(count), np.zeros(count), np.zeros((count, 2), np.int64)
    for i in range(count):
        leaf, line = owner[i]
        table = _quadrature(space.value[space.value_at[i] :], space.number[i])
        lines[i] = (mass_density(leaf) or 0.0) * line, table
        mass[i] = table[1] @ lines[i][0][:, 0]
        if damping_at is not None and mass[i] > 0.0:
            tau[i] = (leaf.material.loss_factor or 0.0) / (2.0 * np.pi * damping_at)
    total = mass.sum()
    heavy = total > HEAVY_LEAVES * (total + sum(m for m, _, _ in bodies.values()))
    number, value_at, kind = members.number.copy(), members.value_at.copy(), members.kind
    inner_size, store, inner = [], [], []
    groups: dict[bytes, int] = {}
    values, end, size = [members.value], len(members.value), 0
    for i in range(count):
        is_planar = kind[i] == PLANAR
        counts = HEAVY_MODES if heavy else FORCE_MODES, 0 if is_planar else COUPLE_MODES
        N = int(number[i, 3] if is_planar else number[i, :3].sum())
        D, own = 0, N + 6
        inner.append(size + np.arange(own))
        store.append(int(members.store_at[i + 1] - members.store_at[i]))
        if mass[i] > 0.0:
            D, loaded = 3 * sum(counts), int(number[i, 0] if is_planar else N)
            line, (points, weight, integral) = lines[i]
            old = members.value[members.value_at[i] :][: _leaf_value_count(number[i], is_planar)]
            at = groups.setdefault(old.tobytes() + line.tobytes(), end)
            if at == end:
                radius = np.sqrt(line[:, 2] / line[:, 0])
                new = np.concatenate(
                    [old, inertia_tables(points, weight, integral, line[:, 0], radius, counts)]
                )
                values.append(new)
                end += len(new)
            value_at[i], number[i, 5:7], modes[i] = at, counts, (counts[0], sum(counts))
            own += 2 * D + (1 + N) * (tau[i] > 0.0)
            store[-1] += (4 if is_planar else 3) * loaded * sum(counts) + D * (10 + D) + inertia_store(D)
        inner_size.append(own)
        size += own
    padded = np.concatenate([[0], np.cumsum(inner_size)]).astype(np.int64)
    moved = members._replace(
        number=number, value_at=value_at, value=np.concatenate(values), inner_at=padded,
        store_at=np.concatenate([[0], np.cumsum(store)]).astype(np.int64),
    )  # fmt: skip
    weight_rows = np.zeros((count, LOAD_NUMBERS))
    weight_rows[:, 0] = mass
    positions = np.concatenate([np.zeros(0, np.int64), *inner]).astype(np.int64)
    return arrays.replace(members=moved, weight=weight_rows), positions, tau, mass, modes


def _line_loads(model: Model, light: Model, modes: NDArray[np.int64]) -> Array:
    """`MovingModel.lines`; modes (m,): numbers of force modes."""
    scene, owner, members = model.scene, member_leaves(model), light.arrays.members
    found = np.zeros((2, len(scene.line_loads), len(modes), int(modes.max(initial=0)), 3))
    for j, load in enumerate(scene.line_loads):
        pieces = loads_of_pieces(replace(scene, line_loads=(load,), pressures=()))
        for name, numbers in pieces.items():
            i = model.member_names.index(name)
            leaf, line = owner[i]
            if not modes[i]:
                raise SceneError(
                    f"line load '{load.name}': leaf '{load.leaf}' has no mass, so that in time nothing carries the load; "
                    "give its material a density"
                )
            points, weight, _ = _quadrature(members.value[members.value_at[i] :], members.number[i])
            mass = weight * mass_density(leaf) * line[:, 0]
            P = orthogonal_modes(points, mass, int(modes[i]))
            push = np.asarray(numbers[:3]) + points[:, None] * np.asarray(numbers[3:6])
            force = (weight[:, None] * P).T @ push
            found[0, j, i, : modes[i]] = force / (mass @ P**2)[:, None]
            found[1, j, i, : modes[i]] = force
    return found


def _leaf_value_count(number: NDArray[np.int64], is_planar: bool) -> int:
    """Number of constants of a leaf without weight."""
    if not is_planar:
        return strain_value_count(number)
    nz, points, plate = int(number[0]), int(number[1]), int(number[4])
    return nz * nz + 2 * nz + points * (3 + nz) + plate * (POINT_NUMBERS + nz)


def _quadrature(value: Array, number: NDArray[np.int64]) -> tuple[Array, Array, Array]:
    """Points from 0 to 1, weights [m] and integrals from the start [m] of the quadrature of a leaf."""
    nx, ny, nz, ng = (int(n) for n in number[:4])
    first = 1 + nx * nx + ny * ny + nz * nz + nx + ny + nz
    length, weight = float(value[0]), value[first : first + ng]
    integral = value[first + ng : first + ng + ng * ng].reshape(ng, ng)
    return quadrature_points(value, number), length * weight, length * integral
