"""Equations of rest shapes: equilibrium of the deformed mechanism and closure of its undeformed loops, and their solution.

Known is the mechanism as drawn, under load. Unknown are the wrench that every leaf spring transmits at its end (force, and
moment about the origin), the pose of every link in the undeformed configuration, the force of every support and drive, the
factors of the free loads and the values of the free drives. The equations are equilibrium of the links (3 each), undeformed
leaf springs that meet both their links (3 each), the displacement of supports and drives from the undeformed configuration,
and prescribed forces: as many as unknowns. Loads, prescribed forces and drive values grow together from zero, where the
undeformed shape is the drawn one, by arc-length continuation, so that the path may fold.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from ksd.errors import ConvergenceError
from ksd.rest_shapes.rest_leaf import COMPLEX_STEP, DeformedLeaf

Array = NDArray[np.float64]
RESIDUAL_TOLERANCE = 1e-12
"""Scaled residual at which the equations are solved."""
MAX_NEWTON_STEPS = 12
"""Largest number of Newton steps from one point of the path to the next."""
FIRST_STEP, MAX_STEP, MIN_STEP = 0.1, 0.5, 1e-7
"""Step lengths along the path, scaled so that a unit is one load fraction at the start of the path."""
MAX_PATH_STEPS, MAX_LOAD_FRACTION = 200, 10.0
"""Largest number of steps along a path, and largest load fraction up to which it is followed."""
MIN_DIRECTION_COSINE = 0.9
"""Cosine of the angle between successive directions of the path below which a step is halved."""
MAX_CROSSING_STEP = 1e-3
"""Step up to which the path may change its orientation, as it does at a crossing with another path. In a longer step it
has leapt to another one, beyond a fold perhaps."""
SINGULAR_VALUE_TOLERANCE = 1e-10
"""Smallest over largest singular value of the equilibrium equations above which a mechanism is statically determinate."""
MAX_LEAF_TURN = 4.0 * np.pi
"""Rotation of a leaf between the undeformed and the loaded shape beyond which a path is not followed [rad]."""


class Term(NamedTuple):
    """A term of a drive or support in the plane: a displacement of `point` (2,) [m] along `direction` (2,), or a rotation of
    sign `direction` (1,), of a link relative to a base (link indices, 0 is ground)."""

    coefficient: float
    is_rotation: bool
    base: int
    link: int
    direction: Array
    point: Array

    @property
    def wrench(self) -> Array:
        """Force and moment about the origin (3,) on the link per unit of force of the term; minus that acts on the base."""
        if self.is_rotation:
            return self.coefficient * np.array([0.0, 0.0, self.direction[0]])
        moment = self.point[0] * self.direction[1] - self.point[1] * self.direction[0]
        return self.coefficient * np.array([*self.direction, moment])

    def displacement(self, poses: Array) -> Array:
        """Displacement (k,) from the undeformed configuration with link poses (k, links, 3) to the drawn one."""
        base, link = poses[:, self.base], poses[:, self.link]
        if self.is_rotation:
            return np.asarray(self.coefficient * self.direction[0] * (base[:, 2] - link[:, 2]))
        inverse_rotation = np.column_stack([np.zeros((len(base), 2)), -base[:, 2]])
        relative = transform(inverse_rotation, transform(link, self.point) - base[:, :2])
        return np.asarray(self.coefficient * ((self.point - relative) @ self.direction))


def transform(poses: Array, points: Array) -> Array:
    """Points (k, 2), or a single one (2,), moved by link poses (k, 3): displacement and angle."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x, y = points[..., 0], points[..., 1]
    return poses[:, :2] + np.stack([c * x - s * y, s * x + c * y], axis=-1)


class ConstraintRow(NamedTuple):
    """A drive or support; value: its displacement from the undeformed to the drawn configuration [m or rad], None where
    that is unknown."""

    name: str
    terms: tuple[Term, ...]
    value: float | None


class PrescribedForce(NamedTuple):
    """A known force [N or Nm]: of constraint row `row`, or component of the force that leaf `leaf` transmits at its end."""

    row: int | None
    leaf: int | None
    component: int
    value: float


class Offsets(NamedTuple):
    """Where each group of unknowns starts, and the number of unknowns.

    leaf_wrenches (3 per leaf), link_poses (3 per link but ground), row_forces (1 per row), load_factors (1 per free load),
    drive_values (1 per free drive).
    """

    leaf_wrenches: int
    link_poses: int
    row_forces: int
    load_factors: int
    drive_values: int
    end: int


@dataclass(frozen=True)
class RestEquations:
    """Equations of a mechanism drawn under load, with scaled unknowns y (n,) and a load fraction.

    ends: indices of the links (0 is ground) at start and end of every leaf. known_loads: link and wrench (3,) about the
    origin of every load of known size; free_loads: of every load whose factor is unknown. gravity (2,) [m/s^2].
    length_scale [m], force_scale [N]: scales of the unknowns and residuals.
    """

    leaves: tuple[DeformedLeaf, ...]
    ends: tuple[tuple[int, int], ...]
    link_count: int
    rows: tuple[ConstraintRow, ...]
    known_loads: tuple[tuple[int, Array], ...]
    free_loads: tuple[tuple[int, Array], ...]
    prescribed_forces: tuple[PrescribedForce, ...]
    gravity: Array
    length_scale: float
    force_scale: float

    @property
    def offsets(self) -> Offsets:
        """Where each group of unknowns starts."""
        free_drives = sum(r.value is None for r in self.rows)
        counts = (
            3 * len(self.leaves),
            3 * (self.link_count - 1),
            len(self.rows),
            len(self.free_loads),
            free_drives,
        )
        return Offsets(0, *np.cumsum(counts).tolist())

    @property
    def scales(self) -> Array:
        """Scales (n,) of the unknowns."""
        length, force = self.length_scale, self.force_scale
        wrench = force * np.array([1.0, 1.0, length])
        factors = [
            force / max(float(np.hypot(*w[:2])), abs(float(w[2])) / length, 1e-300)
            for _, w in self.free_loads
        ]
        free_rows = [r for r in self.rows if r.value is None]
        return np.concatenate([
            np.tile(wrench, len(self.leaves)), np.tile([length, length, 1.0], self.link_count - 1),
            [force * (length if r.terms[0].is_rotation else 1.0) for r in self.rows], factors,
            [1.0 if r.terms[0].is_rotation else length for r in free_rows],
        ])  # fmt: skip

    def evaluate(self, y: Array, fraction: float) -> tuple[Array, Array]:
        """Scaled residual (n,) at unknowns y and load fraction, and its derivatives (n, n + 1) by both.

        Derivatives are complex steps, those of the leaf springs are evaluated by the leaf springs.
        """
        n, scale = len(y), self.scales
        z = np.tile(np.append(y * scale, fraction).astype(complex), (n + 2, 1))
        z[1:] += 1j * COMPLEX_STEP * np.diag(np.append(scale, 1.0))
        leaf_values = []
        for k, leaf in enumerate(self.leaves):
            wrench = z[0, 3 * k : 3 * k + 3]
            undeformed, by_wrench = leaf.with_derivatives(wrench.real, fraction * self.gravity)
            by_fraction = leaf.derivatives_by_fraction(wrench.real, self.gravity, fraction)
            wrench_change, fraction_change = z[:, 3 * k : 3 * k + 3] - wrench, z[:, -1:] - fraction
            leaf_values.append([
                np.asarray(value) + wrench_change @ np.atleast_2d(slope).T + fraction_change * np.atleast_1d(more)
                for value, slope, more in zip(undeformed[:3], by_wrench, by_fraction, strict=True)
            ])  # fmt: skip
        F = self._residual(z, leaf_values) / self._residual_scales()
        return F[0].real, F[1:].imag.T / COMPLEX_STEP

    def _residual_scales(self) -> Array:
        """Scales (n,) of the residuals: wrenches on links, gaps at leaf ends, displacements of rows, prescribed forces."""
        length, force = self.length_scale, self.force_scale
        is_rotation = [r.terms[0].is_rotation for r in self.rows]
        return np.concatenate([
            np.tile(force * np.array([1.0, 1.0, length]), self.link_count - 1),
            np.tile([length, length, 1.0], len(self.leaves)),
            np.where(is_rotation, 1.0, length),
            [force * (length if p.row is not None and is_rotation[p.row] else 1.0) for p in self.prescribed_forces],
        ])  # fmt: skip

    def _residual(self, z: Array, leaf_values: Sequence[Sequence[Array]]) -> Array:
        """Residuals (k, n) of k sets of unknowns, the load fraction in the last column (k, n + 1), complex too; leaf_values:
        displacement (k, 2), turn (k, 1) and start wrench (k, 3) of every leaf."""
        at, fraction, count = self.offsets, z[:, -1:], len(z)
        forces = np.zeros((count, self.link_count, 3), complex)
        for k, ((a, b), (_, _, start_wrench)) in enumerate(zip(self.ends, leaf_values, strict=True)):
            forces[:, a] += start_wrench
            forces[:, b] -= z[:, 3 * k : 3 * k + 3]
        for r, row in enumerate(self.rows):
            for t in row.terms:
                forces[:, t.link] += z[:, at.row_forces + r, None] * t.wrench
                forces[:, t.base] -= z[:, at.row_forces + r, None] * t.wrench
        for link, wrench in self.known_loads:
            forces[:, link] += fraction * wrench
        for k, (link, wrench) in enumerate(self.free_loads):
            forces[:, link] += z[:, at.load_factors + k, None] * wrench
        poses = np.zeros((count, self.link_count, 3), complex)
        poses[:, 1:] = z[:, at.link_poses : at.row_forces].reshape(count, -1, 3)
        residuals = [forces[:, 1:].reshape(count, -1)]
        for (a, b), leaf, (displacement, turn, _) in zip(self.ends, self.leaves, leaf_values, strict=True):
            # the undeformed leaf reaches from its start on one link to its end on the other
            residuals += [
                transform(poses[:, a], leaf.start + displacement) - transform(poses[:, b], leaf.end)
            ]
            residuals += [poses[:, a, 2:] + turn - poses[:, b, 2:]]
        free_columns = iter(range(at.drive_values, at.end))
        for row in self.rows:
            row_displacement = sum(t.displacement(poses) for t in row.terms)
            value = fraction[:, 0] * row.value if row.value is not None else z[:, next(free_columns)]
            residuals.append((row_displacement - value)[:, None])
        for p in self.prescribed_forces:
            column = at.row_forces + p.row if p.row is not None else 3 * int(p.leaf or 0) + p.component
            residuals.append(z[:, column, None] - fraction * p.value)
        return np.concatenate(residuals, axis=1)

    @property
    def is_determinate(self) -> bool:
        """Whether equilibrium alone determines all forces, so that no path has to be followed."""
        at = self.offsets
        forces = [*range(at.link_poses), *range(at.row_forces, at.drive_values)]
        equations = [*range(3 * (self.link_count - 1)), *range(at.end - len(self.prescribed_forces), at.end)]
        if len(forces) != len(equations):
            return False
        _, J = self.evaluate(np.zeros(at.end), 1.0)
        sizes = np.linalg.svd(J[np.ix_(equations, forces)], compute_uv=False)
        return bool(sizes[-1] > SINGULAR_VALUE_TOLERANCE * sizes[0])

    def solve(
        self, start: Array, normal: Array | None = None, max_steps: int = MAX_NEWTON_STEPS
    ) -> Array | None:
        """Solution (n + 1,), unknowns and load fraction, by Newton steps in the plane through `start` with this normal.

        Without a normal the load fraction is that of `start`. None where the steps do not converge.
        """
        normal = np.append(np.zeros(len(start) - 1), 1.0) if normal is None else normal
        point, last = start.copy(), np.inf
        for _ in range(max_steps):
            F, J = self.evaluate(point[:-1], float(point[-1]))
            off = float(normal @ (point - start))
            error = max(float(np.abs(F).max()), abs(off))
            if error < RESIDUAL_TOLERANCE or (error < 1e3 * RESIDUAL_TOLERANCE and error >= 0.5 * last):
                return point
            if not np.isfinite(error) or error > 1e6:
                return None
            last = error
            try:
                point = point - np.linalg.solve(np.vstack([J, normal]), np.append(F, off))
            except np.linalg.LinAlgError:
                return None
        return None

    def is_coiled(self, y: Array) -> bool:
        """Whether an undeformed leaf is turned by more than MAX_LEAF_TURN from the drawn one."""
        z = y * self.scales
        turns = [
            leaf.undeformed(z[3 * k : 3 * k + 3][None], self.gravity).turn[0]
            for k, leaf in enumerate(self.leaves)
        ]
        return bool(np.abs(turns).max(initial=0.0) > MAX_LEAF_TURN)


class RestSolution(NamedTuple):
    """Unknowns y at the full loads, None where there is no solution; folds: load fractions at which the path turned back,
    with no solution the first one, if there is any."""

    y: Array | None
    folds: tuple[float, ...]


def solve_rest_equations(equations: RestEquations, *, beyond_fold: bool) -> RestSolution:
    """The solution on the path from the drawn shape, or, beyond_fold, the one that the path leads to around its fold."""
    start = np.zeros(equations.offsets.end)
    if equations.is_determinate and not beyond_fold:
        full = equations.solve(np.append(start, 1.0), max_steps=60)
        return RestSolution(None if full is None else full[:-1], ())
    if not beyond_fold:
        for point in _path(equations, start, 1.0):
            if point.fold is not None:
                return RestSolution(None, (point.fold,))
            if point.fraction == 1.0:
                return RestSolution(point.y, ())
        return RestSolution(None, ())
    # around the nearer fold, for growing or for reversed loads
    paths = [_path(equations, start, sign) for sign in (1.0, -1.0)]
    folds: list[list[float]] = [[], []]
    for points in zip_longest(*paths):
        for own, point in zip(folds, points, strict=True):
            if point is None:
                continue
            if point.fold is not None:
                own.append(point.fold)
            if point.fraction == 1.0 and own:
                return RestSolution(point.y, tuple(own))
    return RestSolution(None, next((tuple(own[:1]) for own in folds if own), ()))


class PathPoint(NamedTuple):
    """A point of a path: scaled unknowns, load fraction, and the load fraction of a fold since the point before."""

    y: Array
    fraction: float
    fold: float | None


def _path(equations: RestEquations, y: Array, sign: float) -> Iterator[PathPoint]:
    """Points of the path from zero load, with scaled unknowns y, towards load fractions of this sign, also beyond 1.

    The point at the full loads has a load fraction of exactly 1.
    """
    point, step = np.append(y, 0.0), FIRST_STEP
    direction, orientation = _path_tangent(equations, point, None)
    orientation *= sign
    # a unit of the load fraction counts as much as the largest change of an unknown by it
    scale = np.append(
        np.full(len(y), abs(direction[-1]) / max(float(np.abs(direction[:-1]).max()), 1e-12)), 1.0
    )
    direction = sign * np.copysign(1.0, direction[-1]) * direction / np.linalg.norm(scale * direction)
    for _ in range(MAX_PATH_STEPS):
        new = equations.solve(point + step * direction, scale * scale * direction)
        cosine, leapt = 0.0, False
        if new is not None:
            new_direction, new_orientation = _path_tangent(equations, new, direction)
            new_direction = new_direction / np.linalg.norm(scale * new_direction)
            cosine = float((scale * new_direction) @ (scale * direction))
            new_orientation *= np.copysign(1.0, cosine)
            leapt = new_orientation != orientation and step > MAX_CROSSING_STEP
        if new is None or leapt or abs(cosine) < MIN_DIRECTION_COSINE:
            step *= 0.5
            if step < MIN_STEP:
                return
            continue
        new_direction = np.copysign(1.0, cosine) * new_direction
        length = float(np.linalg.norm(scale * (new - point)))
        fraction, new_fraction = float(point[-1]), float(new[-1])
        fold = None
        if direction[-1] * new_direction[-1] < 0.0:
            fractions = CubicHermiteSpline(
                [0.0, 1.0], [fraction, new_fraction], [length * direction[-1], length * new_direction[-1]]
            )
            fold = float(fractions(fractions.derivative().roots(extrapolate=False)[0]))
            beyond = min((fraction - 1.0) * (fold - 1.0), (new_fraction - 1.0) * (fold - 1.0)) < 0.0
            if beyond and step > MIN_STEP:
                # the full loads lie before or behind the fold, in the same step
                step *= 0.5
                continue
        elif (fraction - 1.0) * (new_fraction - 1.0) <= 0.0:
            part = point + (1.0 - fraction) / (new_fraction - fraction) * (new - point)
            full = equations.solve(np.append(part[:-1], 1.0))
            if full is not None:
                yield PathPoint(full[:-1], 1.0, None)
        if abs(new_fraction) > MAX_LOAD_FRACTION or equations.is_coiled(new[:-1]):
            return
        yield PathPoint(
            new[:-1], new_fraction if new_fraction != 1.0 else float(np.nextafter(1.0, 0.0)), fold
        )
        point, direction, orientation = new, new_direction, new_orientation
        step = min(MAX_STEP, 1.5 * step)


def _path_tangent(equations: RestEquations, point: Array, previous: Array | None) -> tuple[Array, float]:
    """Tangent (n + 1,) of the path at a point, in the previous direction; of growing loads without one. Second, its
    orientation, the sign of the determinant of the equations bordered by it. Raises ConvergenceError."""
    _, J = equations.evaluate(point[:-1], float(point[-1]))
    zeros = np.zeros(len(J))
    A = np.vstack([J, np.append(zeros, 1.0) if previous is None else previous])
    try:
        return np.asarray(np.linalg.solve(A, np.append(zeros, 1.0))), float(np.linalg.slogdet(A)[0])
    except np.linalg.LinAlgError:
        raise ConvergenceError(
            "rest_shape: the drawn mechanism can move without any force, so that its rest shape is not determined; hold it "
            "by a drive or support."
        ) from None
