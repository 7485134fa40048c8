"""Stiffness and compliance of a configuration: of points of links, of drives, and between drives and points.

All are derivatives of the equilibrium at the present state, from the factored tangent of the model (geometric terms of leaf
springs, loads and drives included). Held drives and supports do not move; released ones keep their present force. A held
drive about a fixed axis carries a moment whose derivative (twist of the relative rotation about that axis) is part of the
tangent. Strain-mode leaves have one mode per axis more than in the state, after one Newton step (`finer_tangent`). SI units:
translations in m, rotations in rad (spatial, right-handed, about the axes requested).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space

from ksd.answers.finer_model import finer_state
from ksd.answers.nonconservative import cross_matrix
from ksd.answers.printing import PrintableAnswer, format_number, format_table, released_text
from ksd.answers.state_batch import StateBatch
from ksd.answers.tangent import (
    Tangent,
    assemble_and_factor,
    batch_responses,
    remove_row_components,
    row_gradients,
)
from ksd.checks import names_of
from ksd.errors import KinematicsError, SceneError
from ksd.model.arrays import TRANSLATION, State
from ksd.model.compile import Model

Array = NDArray[np.float64]
DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")
"""Rows and columns of all (6, 6) matrices here: three translations, three rotations."""
UNITS, COMPLIANCE_UNITS = ("N/m",) * 3 + ("Nm/rad",) * 3, ("m/N",) * 3 + ("rad/Nm",) * 3
"""Units of a stiffness and of a compliance in each direction."""
_UNSYMMETRIC = (
    "Loads that follow their link, pressure, or moments fixed in space are not conservative: the matrix is not "
    "symmetric"
)
MIN_RELATIVE_COMPLIANCE = 1e-13
"""Compliance, relative to the largest (rotations times the size of the model), below which it counts as zero."""
MIN_RELATIVE_FREE = 1e-9
"""Motion of a point in a motion without stiffness, relative to that of the links, below which it counts as none."""
MIN_COMPLIANCE = 1e-25
"""Compliance [m/N] below which it counts as zero: rounding of a point that is held in all directions."""


@dataclass(frozen=True, repr=False)
class PointStiffness(PrintableAnswer):
    """Compliance of one point of a link, and every stiffness that follows from it.

    elastic (6, 6): motion of the point (m, rad) per unit force and moment (N, Nm) on it by deformation, rows and columns
    as in DIRECTIONS, in `axes` (3, 3; columns, global) at the deformed position `point` (3,) [m]. free (6, m): its motions
    that nothing resists with the drives and supports named in `freed` released. size [m]: length by which rotations are
    compared with translations. conservative: False where loads follow their link or moments are fixed in space, so that
    their work depends on the path: the matrices are then not symmetric; rows of `compliance` are motions, rows of `matrix`
    loads. backward_error: see `ksd.answers.tangent.Tangent.solve_with_error`; at most 1e-6.
    """

    link: str
    point: Array
    axes: Array
    elastic: Array
    freed: tuple[str, ...]
    size: float
    conservative: bool = True
    backward_error: float = 0.0
    free: Array = field(default_factory=lambda: np.zeros((6, 0)))

    @property
    def compliance(self) -> Array:
        """Motion (6, 6) of the point per unit load, see `elastic`; infinite where a load moves it without resistance."""
        unbounded = self.free @ self.free.T
        return np.where(unbounded == 0.0, self.elastic, np.copysign(np.inf, unbounded))

    def _line(self) -> str:
        rows = (f"{d} {format_number(k)}" for d, k in self.supports.items())
        return f"'{self.link}', {', '.join(rows)} [N/m, Nm/rad], {released_text(self.freed)}"

    def __str__(self) -> str:
        rows = []
        for d, unit, compliance_unit in zip(DIRECTIONS, UNITS, COMPLIANCE_UNITS, strict=True):
            k = self.support(d)
            values = (f"{k:.5g}", unit, f"{1.0 / k:.4e}" if k else "unbounded", compliance_unit)
            if not np.isfinite(k):
                values = ("held", "", "0", compliance_unit)
            rows.append((d, *values, self._most_coupled(d)))
        at = ", ".join(f"{1e3 * v:.6g}" for v in np.round(self.point, 12))
        return format_table(
            ("direction", "stiffness", "<", "compliance", "<", "<most coupled with"),
            rows,
            f"Stiffness of link '{self.link}' at ({at}) mm, each direction with the others free; "
            + released_text(self.freed),
            *[_UNSYMMETRIC] * (not self.conservative),
            *[f"Stiffness 0: nothing resists this motion with {', '.join(self.freed)} freed"]
            * bool(self.free.size),
        )

    def _most_coupled(self, direction: str) -> str:
        """Direction most coupled with `direction`, with C_ij / sqrt(C_ii C_jj); empty where none is."""
        C, i = self._scaled(), _direction_index(direction)
        threshold = _zero_threshold(C)
        if C[i, i] < threshold or self.free[i].any():
            return ""
        own = np.diagonal(C)
        share = np.abs(C[:, i]) / np.sqrt(C[i, i] * np.maximum(own, 1e-300))
        share[(own < threshold) | (np.arange(6) == i)] = 0.0
        other = int(np.argmax(share))
        return f"{DIRECTIONS[other]} ({share[other]:.2f})" if share[other] > 1e-6 else ""

    def matrix(self, directions: Sequence[str] = DIRECTIONS) -> Array:
        """Stiffness (k, k) [N/m, N/rad, Nm/rad] in `directions`, the others free.

        Raises KinematicsError where held drives or supports leave no compliance in one of them: release those or omit the
        direction.
        """
        pick = [_direction_index(d) for d in directions]
        scale = np.where(np.array(pick) < 3, 1.0, self.size)
        part = self.elastic[np.ix_(pick, pick)] * np.outer(scale, scale)
        # loads that do no work on free motions; the others meet no resistance
        balanced = loads_at_rest(self.free[pick] * scale[:, None])
        moves, values, loads = np.linalg.svd(balanced.T @ part @ balanced)
        moves, loads = balanced @ moves, loads @ balanced.T
        if values.min(initial=np.inf) < _zero_threshold(self._scaled()):
            worst = np.argmax(np.abs(moves[:, -1]))
            raise KinematicsError(
                f"link '{self.link}' cannot move along {directions[int(worst)]} while the drives and supports "
                "are held, so its stiffness there is infinite; leave this direction out, or free what holds it"
            )
        return np.asarray((loads.T / values) @ moves.T * np.outer(scale, scale))

    def support(self, direction: str, *, held: Sequence[str] = ()) -> float:
        """Stiffness [N/m or Nm/rad] in one direction, all others free except `held`.

        It is a unit force divided by its displacement; inf where held drives and supports leave no compliance, 0 where
        released ones leave nothing that resists.
        """
        C, i = self._scaled(), _direction_index(direction)
        fixed = [_direction_index(d) for d in held if d != direction]
        unit = self.size**2 if i >= 3 else 1.0
        # the unit load, and reactions of what is held, do no work on free motions
        load, free = np.eye(6)[i], self._scaled_free()
        reaction = np.eye(6)[:, fixed]
        if free[i].any():
            load = load - reaction @ (np.linalg.pinv(free[fixed].T) @ free[i])
            if np.abs(load @ free).max() > MIN_RELATIVE_FREE * np.abs(free).max():
                return 0.0
        reaction = reaction @ loads_at_rest(free[fixed])
        value = load @ C @ load
        if reaction.size:
            held_part = np.linalg.pinv(reaction.T @ C @ reaction, rcond=MIN_RELATIVE_COMPLIANCE)
            value -= load @ C @ reaction @ held_part @ (reaction.T @ C @ load)
        return float("inf") if abs(value) < _zero_threshold(C) else float(unit / value)

    @property
    def supports(self) -> dict[str, float]:
        """`support` in all six directions: x, y, z [N/m], rx, ry, rz [Nm/rad]."""
        found = support_stiffness(self.elastic, self.size)
        return dict(zip(DIRECTIONS, np.where(self.free.any(axis=1), 0.0, found).tolist(), strict=True))

    @property
    def principal(self) -> Array:
        """Principal stiffnesses (2, 3), ascending: translational [N/m] and rotational [Nm/rad], the other directions free.

        They are the reciprocal eigenvalues of the translational and of the rotational compliance, those of directions that
        are not stable negative; inf where held, 0 where nothing resists.
        """
        if not self.free.size:
            return principal_stiffness(self.elastic, self.size)
        free, C = self._scaled_free(), self._scaled()
        found = np.zeros((2, 3))
        for row, part, unit in ((0, slice(3), 1.0), (1, slice(3, 6), self.size**2)):
            balanced = loads_at_rest(free[part])
            values = np.linalg.eigvalsh(balanced.T @ C[part, part] @ balanced)[::-1]
            is_held = np.abs(values) <= _zero_threshold(C)
            found[row, 3 - len(values) :] = np.where(is_held, np.inf, unit / np.where(is_held, 1.0, values))
        return np.sort(found, axis=1)

    @property
    def worst(self) -> tuple[float, float]:
        """Smallest translational stiffness [N/m] and smallest rotational stiffness [Nm/rad]; inf where all are held."""
        translational, rotational = self.principal[:, 0].tolist()
        return translational, rotational

    def _scaled(self) -> Array:
        """Compliance by deformation with rotations times the size, all in m/N."""
        return _scaled(self.elastic, self.size)

    def _scaled_free(self) -> Array:
        """Free motions (6, m) with rotations times the size."""
        return np.asarray(self.free * np.repeat([1.0, self.size], 3)[:, None])


def loads_at_rest(free: Array) -> Array:
    """Orthonormal loads (n, k) that do no work on motions free (n, m)."""
    # scipy 1.10 has no null space of an empty matrix
    return np.asarray(null_space(free.T)) if free.size else np.eye(len(free))


def _scaled(compliance: Array, size: Any) -> Array:
    """Compliance (..., 6, 6) with rotations times the size (...), all in m/N."""
    scale = np.ones((*np.shape(size), 6))
    scale[..., 3:] = np.asarray(size)[..., None]
    scaled: Array = compliance * scale[..., None] * scale[..., None, :]
    return scaled


def _zero_threshold(C: Array) -> Any:
    """Compliance (...) [m/N] below which entries of scaled compliances (..., 6, 6) count as zero."""
    return np.maximum(MIN_RELATIVE_COMPLIANCE * np.abs(C).max(axis=(-2, -1)), MIN_COMPLIANCE)


def support_stiffness(compliance: Array, size: Any) -> Array:
    """`PointStiffness.support` (..., 6) for compliances (..., 6, 6) of mechanisms of size (...)."""
    C = _scaled(compliance, size)
    diagonal = np.diagonal(C, axis1=-2, axis2=-1)
    held = np.abs(diagonal) < _zero_threshold(C)[..., None]
    unit = np.repeat(np.stack([np.ones(np.shape(size)), np.asarray(size) ** 2], axis=-1), 3, axis=-1)
    return np.where(held, np.inf, unit / np.where(held, 1.0, diagonal))


def principal_stiffness(compliance: Array, size: Any, reference: NDArray[np.int64] | None = None) -> Array:
    """`PointStiffness.principal` (..., 2, 3) for compliances (..., 6, 6) of mechanisms of size (...).

    reference (D,): of D states next to each other, of which each has the stiffness along the principal axes of another, in
    the order there: for finite differences, as the principal ones in their own order have kinks where two are equal.
    """
    C = _scaled(compliance, size)
    threshold = _zero_threshold(C)
    C = 0.5 * (C + C.swapaxes(-1, -2))
    blocks = np.stack([C[..., :3, :3], C[..., 3:, 3:]], axis=-3)
    values, axes = np.linalg.eigh(blocks)
    if reference is not None:
        axes = axes[reference]
        values = (axes * (blocks @ axes)).sum(axis=-2)
    is_free = np.abs(values) > threshold[..., None, None]
    unit = np.stack([np.ones(np.shape(size)), np.asarray(size) ** 2], axis=-1)[..., None]
    stiffness = np.where(is_free, unit / np.where(is_free, values, 1.0), np.inf)
    order = np.argsort(stiffness if reference is None else stiffness[reference], axis=-1)
    return np.take_along_axis(stiffness, order, axis=-1)


def _direction_index(direction: str) -> int:
    """Index of a direction in DIRECTIONS; raises SceneError for an unknown one."""
    if direction not in DIRECTIONS:
        raise SceneError(f"direction {direction!r} is not known; give one of {', '.join(DIRECTIONS)}")
    return DIRECTIONS.index(direction)


def node_of(model: Model, link: Any) -> int:
    """Node number of a link or internal block, given as an object with a name or by name; raises SceneError."""
    name = getattr(link, "name", link)
    if name not in model.node_names[1:]:
        raise SceneError(
            f"link '{name}' is not part of this mechanism; its links and blocks are "
            f"{', '.join(model.listed_names[1:])}"
        )
    return model.node_names.index(name)


def _axis_columns(axes: Any, R: Array) -> Array:
    """Axes (3, 3) as columns: "global", "link" (R, turning with the link), or given; raises SceneError."""
    if isinstance(axes, str):
        if axes not in ("global", "link"):
            raise SceneError(f"axes = {axes!r}: give 'global', 'link', or three orthonormal columns (3, 3)")
        return np.eye(3) if axes == "global" else R.copy()
    found = np.asarray(axes, float)
    if found.shape != (3, 3) or not np.allclose(found.T @ found, np.eye(3), atol=1e-9):
        raise SceneError(f"axes = {axes!r}: a (3, 3) matrix of orthonormal columns is needed")
    return found


def point_motion(model: Model, motion: State, node: int, at: Any) -> tuple[Array, Array]:
    """Position (3,) of the point of a node that is at `at` (3,) at rest, and its Jacobian (6, 6), see `point_jacobian`."""
    lever = motion.R[node] @ arm_at_rest(model, node, at)
    return motion.x[node] + lever, point_jacobian(lever)


def arm_at_rest(model: Model, node: int, at: Any) -> Array:
    """Vector (3,) [m] at rest from a node to the point `at` (3,); zero where `at` is None. Raises SceneError."""
    if at is None:
        return np.zeros(3)
    point = np.asarray(at, float)
    if point.shape != (3,) or not all(map(math.isfinite, point.tolist())):
        raise SceneError(f"at = {at!r}: three finite coordinates [m] of a point at rest are needed")
    return np.asarray(point - model.rest.x[node])


def point_jacobian(lever: Array) -> Array:
    """Jacobian B (..., 6, 6): motion of a point at `lever` (..., 3) from its node = B times motion of the node."""
    B = np.zeros((*lever.shape[:-1], 6, 6))
    B[...] = np.eye(6)
    B[..., :3, 3:] = -cross_matrix(lever)
    return B


class BatchStiffness(NamedTuple):
    """Results of `point_stiffness` and `drive_stiffness` for D states.

    compliance (D, 6, 6): of a point, global axes; drives (D, d, d): stiffness between the drives; None where not requested.
    valid (D,): there is a result; other states must be evaluated one by one. stable (D,): the Newton step to the finer mesh
    led to a stable equilibrium.
    """

    compliance: Array | None
    drives: Array | None
    valid: NDArray[np.bool_]
    stable: NDArray[np.bool_]


def batch_stiffness(
    states: StateBatch, link: Any = None, *, at: Sequence[Any] = (), drives: bool = False
) -> BatchStiffness:
    """Compliance of a point of `link`, and stiffness of the drives, in every state, with all drives and supports held.

    link: none where None; at (U,): the point at rest in each of the models; drives: whether their stiffness is computed.
    Raises SceneError as `point_stiffness`.
    """
    fine, model = states.on_finer_mesh(), states.models[0]
    if fine is None:
        return BatchStiffness(None, None, *np.zeros((2, len(states.model_index)), bool))
    topology, x = fine.topology, fine.motion.x
    rows, count, unknowns = range(len(topology.terms.start)), len(model.drive_names), topology.plan.unknowns
    loads = np.zeros((len(x), 6 * (link is not None) + count * drives, unknowns))
    if link is not None:
        node = node_of(model, link)
        start = int(topology.start[node])
        arms = np.array(
            [arm_at_rest(own, node, point) for own, point in zip(states.models, at, strict=False)]
        )
        lever = fine.motion.R[:, node] @ arms[states.model_index, :, None]
        loads[:, :6, start : start + 6] = point_jacobian(lever[..., 0])
        if rows:
            held = [row_gradients(arrays, motion, rows) for arrays, motion in fine.states]
            left, _ = remove_row_components(
                topology, states.sizes, np.stack(held), loads[:, :6].swapaxes(1, 2)
            )
            loads[:, :6] = left.swapaxes(1, 2)
    first = loads.shape[1] - count * drives
    if drives:
        loads[:, first:, topology.terms.start[:count]] = np.eye(count)
    response, valid, stable = batch_responses(fine, loads)
    if not topology.conservative:
        # not conservative: the tangent has a skew part, which is left out here
        valid[:] = False
    C = matrix = None
    if link is not None:
        C = loads[:, :6] @ response[:, :6].swapaxes(1, 2)
        C = 0.5 * (C + C.swapaxes(1, 2))
    if drives:
        matrix = -response[:, first:, topology.terms.start[:count]]
        matrix = 0.5 * (matrix + matrix.swapaxes(1, 2))
    return BatchStiffness(C, matrix, valid, stable)


def finer_tangent(
    model: Model, motion: State, *, freed: Iterable[str] = (), load_factor: float = 1.0
) -> Tangent:
    """Factored tangent of a state, with one more mode per axis where all members are strain-mode leaves.

    See `ksd.answers.finer_model`; models with chains stay as they are. Motions that only the drives and supports in
    `freed` hold are its `free`.
    """
    if model.has_strain_leaves_only:
        model, motion = finer_state(model, motion, load_factor=load_factor)
    return assemble_and_factor(model, motion, freed=freed, load_factor=load_factor, free_motions=True)


def point_stiffness(
    model: Model,
    motion: State,
    link: Any,
    *,
    at: Any = None,
    axes: Any = "global",
    freed: Iterable[str] = (),
    load_factor: float = 1.0,
    tangent: Tangent | None = None,
) -> PointStiffness:
    """Compliance and stiffness of the point that moves rigidly with `link` and is at `at` (3,) [m] at rest.

    at: the reference point of the link where None. axes: "global", "link" (turning with it), or orthonormal columns (3, 3).
    freed: names of drives and supports released at their present force. tangent: result of `finer_tangent`, to save its
    computation. Raises SceneError for unknown names, KinematicsError where a motion has no stiffness.
    """
    node, freed = node_of(model, link), names_of(freed, "freed")
    found = tangent or finer_tangent(model, motion, freed=freed, load_factor=load_factor)
    # at the state of the tangent, so that the compliance along held drives is zero to the last digit
    point, B = point_motion(model, found.motion, node, at)
    columns = _axis_columns(axes, motion.R[node])
    turn = np.zeros((6, 6))
    turn[:3, :3] = turn[3:, 3:] = columns
    loads = np.zeros((found.arrays.plan.unknowns, 6))
    here = found.unknowns(node)
    loads[here] = B.T @ turn
    rows = [i for i, n in enumerate((*model.drive_names, *model.support_names)) if n not in found.freed]
    # components that held rows carry are removed first: in the response they would leave rounding
    gradients = row_gradients(found.model.arrays, found.motion, rows)
    loads = remove_row_components(found.arrays, found.arrays.size, gradients, loads)[0]
    response, error = found.solve_with_error(loads)
    C, free = loads.T @ response, np.zeros((6, 0))
    if found.free.size:
        free = turn.T @ B @ found.free[here]
        travel = np.linalg.norm(found.free * found.lengths()[:, None], axis=0)
        is_rounding = (
            np.abs(free) * np.repeat([1.0, model.arrays.size], 3)[:, None] < MIN_RELATIVE_FREE * travel
        )
        free = np.where(is_rounding, 0.0, free / travel)
    return PointStiffness(
        model.node_names[node],
        point,
        columns,
        _symmetrised(C, found),
        freed,
        model.arrays.size,
        found.skew is None,
        error,
        free[:, free.any(axis=0)],
    )


def _symmetrised(C: Array, tangent: Tangent) -> Array:
    """Symmetric part of C (k, k) where its tangent is symmetric, which removes rounding; else C."""
    return 0.5 * (C + C.T) if tangent.skew is None else C


@dataclass(frozen=True, repr=False)
class DriveStiffness(PrintableAnswer):
    """Stiffness between drives.

    matrix (d, d): force of drive i [N or Nm] per motion of drive j [m or rad], the others held; names: of the drives; units:
    of the diagonal. conservative, backward_error: see `PointStiffness`.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    matrix: Array
    conservative: bool = True
    backward_error: float = 0.0

    def _line(self) -> str:
        return ", ".join(
            f"{n} {format_number(self[n])} {u}" for n, u in zip(self.names, self.units, strict=True)
        )

    def __str__(self) -> str:
        rows = [
            (n, u, *(format_number(k, 5) for k in row))
            for n, u, row in zip(self.names, self.units, self.matrix, strict=True)
        ]
        title = "Stiffness of the drives: force or moment of a row's drive per motion of a column's, the others held"
        return format_table(
            ("drive", "<", *self.names), rows, title, *[_UNSYMMETRIC] * (not self.conservative)
        )

    def __getitem__(self, name: str) -> float:
        """Stiffness of one drive, the others held [N/m for a translation, Nm/rad for a rotation]."""
        if name not in self.names:
            raise SceneError(
                f"drive '{name}' is not held here; the held drives are {', '.join(self.names) or 'none'}"
            )
        i = self.names.index(name)
        return float(self.matrix[i, i])


def _drive_response(found: Tangent, rows: Sequence[int]) -> tuple[Array, float]:
    """Response (unknowns, d) to a unit motion of each of the drives `rows`, and its backward error."""
    loads = np.zeros((found.arrays.plan.unknowns, len(rows)))
    loads[found.arrays.terms.start[list(rows)], range(len(rows))] = 1.0
    return found.solve_with_error(loads)


def drive_units(model: Model, rows: Iterable[int]) -> tuple[str, ...]:
    """Units of the stiffness of the drives `rows`."""
    terms = model.arrays.terms
    return tuple("N/m" if terms.kind[terms.first[i]] == TRANSLATION else "Nm/rad" for i in rows)


def drive_stiffness(
    model: Model,
    motion: State,
    *,
    freed: Iterable[str] = (),
    load_factor: float = 1.0,
    tangent: Tangent | None = None,
) -> DriveStiffness:
    """Derivative of the forces of all held drives with respect to their motions; those named in `freed` keep their force."""
    freed = names_of(freed, "freed")
    found = tangent or finer_tangent(model, motion, freed=freed, load_factor=load_factor)
    rows = [i for i, n in enumerate(model.drive_names) if n not in freed]
    terms, units = model.arrays.terms, drive_units(model, rows)
    response, error = _drive_response(found, rows)
    names = tuple(model.drive_names[i] for i in rows)
    return DriveStiffness(
        names, units, _symmetrised(-response[terms.start[rows]], found), found.skew is None, error
    )


def drive_coupling(
    model: Model, motion: State, link: Any, *, at: Any = None, load_factor: float = 1.0
) -> dict[str, Array]:
    """Motion (6,) of a point of `link` [m, rad, global] per unit motion of every drive, by name of the drive.

    Arguments as in `point_stiffness`.
    """
    node = node_of(model, link)
    found = finer_tangent(model, motion, load_factor=load_factor)
    _, B = point_motion(model, found.motion, node, at)
    moved = B @ _drive_response(found, range(len(model.drive_names)))[0][found.unknowns(node)]
    return dict(zip(model.drive_names, moved.T, strict=True))
