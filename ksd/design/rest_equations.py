"""Equations of rest shapes: equilibrium as drawn, and loops that close at rest, with the path of their solution.

Known is the drawn, loaded mechanism; unknown are what every leaf hands on (force and moment about the origin), the pose of
every link at rest, the force of every support and drive, and the size of what is free. Links in equilibrium (3 equations
each), leaf springs that meet both links at rest (3 each), supports and drives that have moved from rest by what is said,
forces that are said: as many equations as unknowns. Loads, said forces and drive values are raised together from nothing,
where the rest shape is the drawn one, along the arc of the path, so that it may fold.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from ksd.design.rest_leaf import STEP, DrawnLeaf
from ksd.errors import ConvergenceError

Array = NDArray[np.float64]
CLOSED = 1e-12
"""Residual, over forces and sizes of the mechanism, at which it counts as solved."""
NEWTON = 12
"""Most Newton steps from one point of the path to the next."""
FIRST, LONGEST, SHORTEST = 0.1, 0.5, 1e-7
"""Steps along the path, over its initial rate: the first, the longest and the shortest."""
STEPS, SHARES = 200, 10.0
"""Most steps along a path, and the share of the loads up to which it is followed."""
BENDS = 0.9
"""Cosine of the angle between the directions of two steps, below which they are too long."""
DETERMINATE = 1e-10
"""Smallest singular value of the equilibrium of determinate mechanisms, over the largest."""
COILED = 4.0 * np.pi
"""Turn of a leaf between rest and load beyond which a path is followed no further [rad]."""


class Term(NamedTuple):
    """A term of a drive or support in the plane: a displacement of `point` along `way` (2,), or a rotation, of link seen
    from base (numbers, 0 is ground); sign: of the rotation."""

    coefficient: float
    turns: bool
    base: int
    link: int
    way: Array
    point: Array

    @property
    def wrench(self) -> Array:
        """Force and moment about the origin (3,) that a unit of it exerts on the link; minus that on the base."""
        if self.turns:
            return self.coefficient * np.array([0.0, 0.0, self.way[0]])
        moment = self.point[0] * self.way[1] - self.point[1] * self.way[0]
        return self.coefficient * np.array([*self.way, moment])

    def moved(self, poses: Array) -> Array:
        """How far (k,) it moves from rest, at poses (k, links, 3), to what is drawn."""
        base, link = poses[:, self.base], poses[:, self.link]
        if self.turns:
            return np.asarray(self.coefficient * self.way[0] * (base[:, 2] - link[:, 2]))
        back = np.column_stack([np.zeros((len(base), 2)), -base[:, 2]])
        seen = placed(back, placed(link, self.point) - base[:, :2])
        return np.asarray(self.coefficient * ((self.point - seen) @ self.way))


def placed(poses: Array, points: Array) -> Array:
    """Points (k, 2), or one, of links with poses (k, 3)."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x, y = points[..., 0], points[..., 1]
    return poses[:, :2] + np.stack([c * x - s * y, s * x + c * y], axis=-1)


class Row(NamedTuple):
    """A drive or support; value: how far it has moved from rest as drawn [m or rad], None where that is free."""

    name: str
    terms: tuple[Term, ...]
    value: float | None


class Said(NamedTuple):
    """A force that is said: of row `row`, or component of what leaf `leaf` hands on at its end; size [N or Nm]."""

    row: int | None
    leaf: int | None
    component: int
    size: float


@dataclass(frozen=True)
class Equations:
    """A mechanism as drawn under load: leaf springs with the numbers of their links (0 is ground), rows; pushes: link and
    wrench (3,) of every load whose size is known; free: of every load whose size is open; gravity (2,); size [m], force [N]:
    by which unknowns are scaled."""

    leaves: tuple[DrawnLeaf, ...]
    ends: tuple[tuple[int, int], ...]
    links: int
    rows: tuple[Row, ...]
    pushes: tuple[tuple[int, Array], ...]
    free: tuple[tuple[int, Array], ...]
    said: tuple[Said, ...]
    gravity: Array
    size: float
    force: float

    @property
    def starts(self) -> list[int]:
        """Where wrenches of leaves, poses of links, forces of rows, free loads and free drives begin among the unknowns, and
        where they end."""
        drives = sum(r.value is None for r in self.rows)
        counts = (3 * len(self.leaves), 3 * (self.links - 1), len(self.rows), len(self.free), drives)
        return [0, *np.cumsum(counts).tolist()]

    @property
    def unknowns(self) -> Array:
        """Scales (n,) of the unknowns."""
        wrench = self.force * np.array([1.0, 1.0, self.size])
        pushes = [
            self.force / max(float(np.hypot(*w[:2])), abs(float(w[2])) / self.size, 1e-300)
            for _, w in self.free
        ]
        open_rows = [r for r in self.rows if r.value is None]
        return np.concatenate([
            np.tile(wrench, len(self.leaves)), np.tile([self.size, self.size, 1.0], self.links - 1),
            [self.force * (self.size if r.terms[0].turns else 1.0) for r in self.rows], pushes,
            [1.0 if r.terms[0].turns else self.size for r in open_rows],
        ])  # fmt: skip

    def evaluate(self, y: Array, share: float) -> tuple[Array, Array]:
        """Scaled residual (n,) at scaled unknowns y with that share of loads, said forces and values, and its tangent
        (n, n + 1) by both: complex steps, but for the leaf springs, which bring their own."""
        n, scale = len(y), self.unknowns
        z = np.tile(np.append(y * scale, share).astype(complex), (n + 2, 1))
        z[1:] += 1j * STEP * np.diag(np.append(scale, 1.0))
        rested = []
        for k, leaf in enumerate(self.leaves):
            own, slopes = leaf.slopes(z[0, 3 * k : 3 * k + 3].real, share * self.gravity)
            by_share = leaf.by_weight(z[0, 3 * k : 3 * k + 3].real, self.gravity, share)
            moved = [z[:, 3 * k : 3 * k + 3] - z[0, 3 * k : 3 * k + 3], z[:, -1:] - share]
            rested.append([
                np.asarray(value) + moved[0] @ np.atleast_2d(slope).T + moved[1] * np.atleast_1d(more)
                for value, slope, more in zip(own[:3], slopes, by_share, strict=True)
            ])  # fmt: skip
        F = self._residual(z, rested) / self._sizes()
        return F[0].real, F[1:].imag.T / STEP

    def _sizes(self) -> Array:
        """What residuals (n,) are measured by: wrenches, gaps and turns, motions of rows, forces."""
        turns = [r.terms[0].turns for r in self.rows]
        return np.concatenate([
            np.tile(self.force * np.array([1.0, 1.0, self.size]), self.links - 1),
            np.tile([self.size, self.size, 1.0], len(self.leaves)),
            np.where(turns, 1.0, self.size),
            [self.force * (self.size if s.row is not None and turns[s.row] else 1.0) for s in self.said],
        ])  # fmt: skip

    def _residual(self, z: Array, rested: Sequence[Sequence[Array]]) -> Array:
        """Residuals (k, n) of k unknowns with the share behind them (k, n + 1), complex too; rested: displacement (k, 2),
        turn (k, 1) and wrench at the start (k, 3) of every leaf."""
        at, share, count = self.starts, z[:, -1:], len(z)
        forces = np.zeros((count, self.links, 3), complex)
        for k, ((a, b), (_, _, start)) in enumerate(zip(self.ends, rested, strict=True)):
            forces[:, a] += start
            forces[:, b] -= z[:, 3 * k : 3 * k + 3]
        for r, row in enumerate(self.rows):
            for t in row.terms:
                forces[:, t.link] += z[:, at[2] + r, None] * t.wrench
                forces[:, t.base] -= z[:, at[2] + r, None] * t.wrench
        for link, wrench in self.pushes:
            forces[:, link] += share * wrench
        for k, (link, wrench) in enumerate(self.free):
            forces[:, link] += z[:, at[3] + k, None] * wrench
        poses = np.zeros((count, self.links, 3), complex)
        poses[:, 1:] = z[:, at[1] : at[2]].reshape(count, -1, 3)
        found = [forces[:, 1:].reshape(count, -1)]
        for (a, b), leaf, (way, turn, _) in zip(self.ends, self.leaves, rested, strict=True):
            # from its start on one link at rest, a leaf comes to its end on the other
            found += [placed(poses[:, a], leaf.first + way) - placed(poses[:, b], leaf.last)]
            found += [poses[:, a, 2:] + turn - poses[:, b, 2:]]
        opened = iter(range(at[4], at[5]))
        for row in self.rows:
            moved = sum(t.moved(poses) for t in row.terms)
            value = share[:, 0] * row.value if row.value is not None else z[:, next(opened)]
            found.append((moved - value)[:, None])
        for said in self.said:
            column = at[2] + said.row if said.row is not None else 3 * int(said.leaf or 0) + said.component
            found.append(z[:, column, None] - share * said.size)
        return np.concatenate(found, axis=1)

    @property
    def determinate(self) -> bool:
        """Whether equilibrium alone gives all forces, so that nothing has to be followed."""
        at = self.starts
        forces = [*range(at[1]), *range(at[2], at[4])]
        equations = [*range(3 * (self.links - 1)), *range(at[-1] - len(self.said), at[-1])]
        if len(forces) != len(equations):
            return False
        _, J = self.evaluate(np.zeros(at[-1]), 1.0)
        sizes = np.linalg.svd(J[np.ix_(equations, forces)], compute_uv=False)
        return bool(sizes[-1] > DETERMINATE * sizes[0])

    def newton(self, start: Array, normal: Array | None = None, most: int = NEWTON) -> Array | None:
        """The solution (n + 1,), share last, in the plane through `start` across `normal`, at the share of `start` without
        one; None where there is none."""
        normal = np.append(np.zeros(len(start) - 1), 1.0) if normal is None else normal
        point, last = start.copy(), np.inf
        for _ in range(most):
            F, J = self.evaluate(point[:-1], float(point[-1]))
            off = float(normal @ (point - start))
            miss = max(float(np.abs(F).max()), abs(off))
            if miss < CLOSED or (miss < 1e3 * CLOSED and miss >= 0.5 * last):
                return point
            if not np.isfinite(miss) or miss > 1e6:
                return None
            last = miss
            try:
                point = point - np.linalg.solve(np.vstack([J, normal]), np.append(F, off))
            except np.linalg.LinAlgError:
                return None
        return None

    def coiled(self, y: Array) -> bool:
        """Whether a leaf at rest is turned by more than twice around from what is drawn."""
        z = y * self.unknowns
        turns = [
            leaf.rest(z[3 * k : 3 * k + 3][None], self.gravity).turn[0] for k, leaf in enumerate(self.leaves)
        ]
        return bool(np.abs(turns).max(initial=0.0) > COILED)


@dataclass(frozen=True)
class Found:
    """A solution y at the whole of the loads; folds: shares at which the path to it turned back."""

    y: Array
    folds: tuple[float, ...]


def solved(equations: Equations, *, beyond_fold: bool) -> Found | float | None:
    """The solution next to the drawn shape; beyond_fold: the one that the other way of the path leads to. The share at which
    the path folds where it does not come to the whole; None where it ends without a fold."""
    start = np.zeros(equations.starts[-1])
    if equations.determinate and not beyond_fold:
        whole = equations.newton(np.append(start, 1.0), most=60)
        return None if whole is None else Found(whole[:-1], ())
    if not beyond_fold:
        for point in _path(equations, start, 1.0):
            if point.fold is not None:
                return point.fold
            if point.share == 1.0:
                return Found(point.y, ())
        return None
    # around the fold that is nearer, on either way
    ways = [_path(equations, start, sign) for sign in (1.0, -1.0)]
    folds: list[list[float]] = [[], []]
    for points in zip_longest(*ways):
        for own, point in zip(folds, points, strict=True):
            if point is None:
                continue
            if point.fold is not None:
                own.append(point.fold)
            if point.share == 1.0 and own:
                return Found(point.y, tuple(own))
    return next((own[0] for own in folds if own), None)


class Point(NamedTuple):
    """A point of a path: scaled unknowns, share of the loads, and the share at which the path turned back before it."""

    y: Array
    share: float
    fold: float | None


def _path(equations: Equations, y: Array, sign: float) -> Iterator[Point]:
    """Points of the path from nothing, also beyond the whole, which itself comes exactly, as share 1."""
    here, step = np.append(y, 0.0), FIRST
    way = _tangent(equations, here, None)
    # one unit of the share counts as much as the largest change of an unknown by it
    scale = np.append(np.full(len(y), abs(way[-1]) / max(float(np.abs(way[:-1]).max()), 1e-12)), 1.0)
    way = sign * np.copysign(1.0, way[-1]) * way / np.linalg.norm(scale * way)
    for _ in range(STEPS):
        new = equations.newton(here + step * way, scale * scale * way)
        cosine = 0.0
        if new is not None:
            ahead = _tangent(equations, new, way)
            ahead = ahead / np.linalg.norm(scale * ahead)
            cosine = float((scale * ahead) @ (scale * way))
        if new is None or abs(cosine) < BENDS:
            step *= 0.5
            if step < SHORTEST:
                return
            continue
        ahead = np.copysign(1.0, cosine) * ahead
        gone, share, there = float(np.linalg.norm(scale * (new - here))), float(here[-1]), float(new[-1])
        fold = None
        if way[-1] * ahead[-1] < 0.0:
            between = CubicHermiteSpline([0.0, 1.0], [share, there], [gone * way[-1], gone * ahead[-1]])
            fold = float(between(between.derivative().roots(extrapolate=False)[0]))
            if min((share - 1.0) * (fold - 1.0), (there - 1.0) * (fold - 1.0)) < 0.0 and step > SHORTEST:
                # the whole lies before the fold, or behind it, in the same step
                step *= 0.5
                continue
        elif (share - 1.0) * (there - 1.0) <= 0.0:
            part = here + (1.0 - share) / (there - share) * (new - here)
            whole = equations.newton(np.append(part[:-1], 1.0))
            if whole is not None:
                yield Point(whole[:-1], 1.0, None)
        if abs(there) > SHARES or equations.coiled(new[:-1]):
            return
        yield Point(new[:-1], there if there != 1.0 else float(np.nextafter(1.0, 0.0)), fold)
        here, way = new, ahead
        step = min(LONGEST, 1.5 * step)


def _tangent(equations: Equations, point: Array, before: Array | None) -> Array:
    """Direction (n + 1,) of the path at a point, the way it is gone."""
    _, J = equations.evaluate(point[:-1], float(point[-1]))
    none = np.zeros(len(J))
    try:
        A = np.vstack([J, np.append(none, 1.0) if before is None else before])
        return np.asarray(np.linalg.solve(A, np.append(none, 1.0)))
    except np.linalg.LinAlgError:
        raise ConvergenceError(
            "rest_shape: the drawn mechanism can move without any force, so that its rest shape is not determined; hold it "
            "by a drive or support."
        ) from None


__all__ = ["Equations", "Found", "Row", "Said", "Term", "solved"]
