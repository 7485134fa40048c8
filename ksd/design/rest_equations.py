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
from functools import cached_property
from itertools import zip_longest
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ksd.design.rest_leaf import DrawnLeaf, Slopes, rotated
from ksd.errors import ConvergenceError

Array = NDArray[np.float64]
S = np.array([[0.0, -1.0], [1.0, 0.0]])
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
        """Scaled residual (n,) and tangent (n, n) at scaled unknowns y, with that share of loads, said forces and values."""
        scale, at = self.unknowns, self.starts
        z, n = y * scale, at[-1]
        poses = np.vstack([np.zeros(3), z[at[1] : at[2]].reshape(-1, 3)])
        F, J = np.zeros(n), np.zeros((n, n))
        rested = [
            leaf.slopes(z[3 * k : 3 * k + 3], share * self.gravity) for k, leaf in enumerate(self.leaves)
        ]
        self._equilibrium(z, share, rested, (F, J))
        place = 3 * (self.links - 1)
        for k, leaf in enumerate(self.leaves):
            self._closing(k, leaf, rested[k], poses, (F, J), place + 3 * k)
        place += 3 * len(self.leaves)
        for r in range(len(self.rows)):
            self._moved(r, z, poses, (F, J), place + r, share)
        place += len(self.rows)
        for k, said in enumerate(self.said):
            column = at[2] + said.row if said.row is not None else 3 * int(said.leaf or 0) + said.component
            F[place + k], J[place + k, column] = z[column] - share * said.size, 1.0
        size = self._sizes(place)
        return F / size, J * scale / size[:, None]

    def _sizes(self, place: int) -> Array:
        """What residuals (n,) are measured by."""
        size = np.ones(place + len(self.said))
        links = 3 * (self.links - 1)
        size[:links] = np.tile(self.force * np.array([1.0, 1.0, self.size]), self.links - 1)
        closing = links + 3 * len(self.leaves)
        size[links:closing] = np.tile([self.size, self.size, 1.0], len(self.leaves))
        size[closing:place] = [1.0 if r.terms[0].turns else self.size for r in self.rows]
        size[place:] = [
            self.force * (self.size if s.row is not None and self.rows[s.row].terms[0].turns else 1.0)
            for s in self.said
        ]
        return size

    def _equilibrium(
        self, z: Array, share: float, rested: Sequence[Slopes], found: tuple[Array, Array]
    ) -> None:
        """Forces and moments about the origin on every link but ground, as drawn."""
        (F, J), at = found, self.starts

        def add(link: int, wrench: Array, column: int, slope: Array | None) -> None:
            if link:
                own = slice(3 * (link - 1), 3 * link)
                F[own] += wrench
                if slope is not None:
                    J[own, column : column + slope.shape[1]] += slope

        for k, ((a, b), (own_rest, (_, _, slope))) in enumerate(zip(self.ends, rested, strict=True)):
            add(a, own_rest.start, 3 * k, slope)
            add(b, -z[3 * k : 3 * k + 3], 3 * k, -np.eye(3))
        for r, row in enumerate(self.rows):
            force = z[at[2] + r]
            for t in row.terms:
                add(t.link, force * t.wrench, at[2] + r, t.wrench[:, None])
                add(t.base, -force * t.wrench, at[2] + r, -t.wrench[:, None])
        for link, wrench in self.pushes:
            add(link, share * wrench, 0, None)
        for k, (link, wrench) in enumerate(self.free):
            add(link, z[at[3] + k] * wrench, at[3] + k, wrench[:, None])

    def _closing(
        self, k: int, leaf: DrawnLeaf, slopes: Slopes, poses: Array, found: tuple[Array, Array], place: int
    ) -> None:
        """From its start on one link at rest, a leaf comes to its end on the other."""
        (F, J), at, (a, b) = found, self.starts, self.ends[k]
        rested, (way, turn, _) = slopes
        Ra, Rb = rotated(poses[a, 2]), rotated(poses[b, 2])
        own = slice(place, place + 2)
        reach = leaf.first + rested.way
        F[own] = poses[a, :2] + Ra @ reach - poses[b, :2] - Rb @ leaf.last
        F[place + 2] = poses[a, 2] + float(rested.turn) - poses[b, 2]
        J[own, 3 * k : 3 * k + 3] = Ra @ way
        J[place + 2, 3 * k : 3 * k + 3] = turn
        for link, sign, lever in ((a, 1.0, S @ Ra @ reach), (b, -1.0, S @ Rb @ leaf.last)):
            if link:
                column = at[1] + 3 * (link - 1)
                J[own, column : column + 2] += sign * np.eye(2)
                J[own, column + 2] += sign * lever
                J[place + 2, column + 2] += sign

    def _moved(
        self, r: int, z: Array, poses: Array, found: tuple[Array, Array], place: int, share: float
    ) -> None:
        """From rest to what is drawn, a drive or support has moved by its value."""
        (F, J), at, row = found, self.starts, self.rows[r]
        for t in row.terms:
            base, link = (at[1] + 3 * (n - 1) if n else None for n in (t.base, t.link))
            if t.turns:
                size = t.coefficient * t.way[0]
                F[place] -= size * (poses[t.link, 2] - poses[t.base, 2])
                for column, sign in ((link, -1.0), (base, 1.0)):
                    if column is not None:
                        J[place, column + 2] += sign * size
                continue
            RB, RL = rotated(poses[t.base, 2]), rotated(poses[t.link, 2])
            seen = RB.T @ (poses[t.link, :2] + RL @ t.point - poses[t.base, :2])
            along = t.coefficient * t.way
            F[place] += along @ (t.point - seen)
            if link is not None:
                J[place, link : link + 2] -= along @ RB.T
                J[place, link + 2] -= along @ RB.T @ S @ RL @ t.point
            if base is not None:
                J[place, base : base + 2] += along @ RB.T
                J[place, base + 2] += along @ S @ seen
        if row.value is None:
            column = at[4] + sum(other.value is None for other in self.rows[:r])
            F[place] -= z[column]
            J[place, column] -= 1.0
        else:
            F[place] -= share * row.value

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

    def newton(self, y: Array, share: float, most: int = NEWTON) -> Array | None:
        """Solution at a share from y, or None."""
        last = np.inf
        for _ in range(most):
            F, J = self.evaluate(y, share)
            miss = float(np.abs(F).max())
            if miss < CLOSED or (miss < 1e3 * CLOSED and miss >= 0.5 * last):
                return y
            if not np.isfinite(miss) or miss > 1e6:
                return None
            last, y = miss, y - np.linalg.solve(J, F)
        return None

    def slope(self, y: Array, share: float) -> Array:
        """How the residual changes with the share: everywhere alike where leaf springs have no weight."""
        if not self.gravity.any():
            return self._per_share
        h = 1e-4
        return (self.evaluate(y, share + h)[0] - self.evaluate(y, share - h)[0]) / (2.0 * h)

    @cached_property
    def _per_share(self) -> Array:
        y = np.zeros(self.starts[-1])
        return self.evaluate(y, 1.0)[0] - self.evaluate(y, 0.0)[0]

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
        y = equations.newton(start, 1.0, most=60)
        return None if y is None else Found(y, ())
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
    share, step = 0.0, FIRST
    way = _tangent(equations, y, share, None)
    weight = 1.0 / max(float(np.abs(way[:-1]).max() / max(abs(way[-1]), 1e-12)), 1e-12)
    scale = np.append(np.full(len(y), weight), 1.0)
    way = sign * np.copysign(1.0, way[-1]) * way / np.linalg.norm(scale * way)
    for _ in range(STEPS):
        found = _ahead(equations, (y, share), way, step, scale)
        if found is not None:
            new, there = found
            ahead = _tangent(equations, new, there, way)
            ahead = ahead / np.linalg.norm(scale * ahead)
            cosine = float((scale * ahead) @ (scale * way))
            if abs(cosine) < BENDS:
                found = None
        if found is None:
            step *= 0.5
            if step < SHORTEST:
                return
            continue
        ahead = np.copysign(1.0, cosine) * ahead
        gone = float(np.linalg.norm(scale * np.append(new - y, there - share)))
        fold = _turning(share, there, gone * way[-1], gone * ahead[-1]) if way[-1] * ahead[-1] < 0.0 else None
        if (share - 1.0) * (there - 1.0) <= 0.0 and fold is None:
            part = (1.0 - share) / (there - share)
            whole = equations.newton(y + part * (new - y), 1.0)
            if whole is not None:
                yield Point(whole, 1.0, None)
        if abs(there) > SHARES or equations.coiled(new):
            return
        yield Point(new, there if there != 1.0 else float(np.nextafter(1.0, 0.0)), fold)
        y, share, way = new, there, ahead
        step = min(LONGEST, 1.5 * step)


def _tangent(equations: Equations, y: Array, share: float, before: Array | None) -> Array:
    """Direction (n+1,) of the path at a point, the way it is gone."""
    _, J = equations.evaluate(y, share)
    A = np.column_stack([J, equations.slope(y, share)])
    border = np.append(np.zeros(len(y)), 1.0) if before is None else before
    A = np.vstack([A, border])
    try:
        return np.asarray(np.linalg.solve(A, np.append(np.zeros(len(y)), 1.0)))
    except np.linalg.LinAlgError:
        raise ConvergenceError(
            "rest_shape: the drawn mechanism can move without any force, so that its rest shape is not determined; hold it "
            "by a drive or support."
        ) from None


def _ahead(
    equations: Equations, here: tuple[Array, float], way: Array, step: float, scale: Array
) -> tuple[Array, float] | None:
    """The point of the path that lies a step ahead, or None."""
    point = np.append(*here) + step * way
    start, normal, last = point.copy(), scale * scale * way, np.inf
    for _ in range(NEWTON):
        F, J = equations.evaluate(point[:-1], float(point[-1]))
        off = float(normal @ (point - start))
        miss = max(float(np.abs(F).max()), abs(off))
        if miss < CLOSED or (miss < 1e3 * CLOSED and miss >= 0.5 * last):
            return point[:-1], float(point[-1])
        if not np.isfinite(miss) or miss > 1e3:
            return None
        last = miss
        A = np.vstack([np.column_stack([J, equations.slope(point[:-1], float(point[-1]))]), normal])
        try:
            point = point - np.linalg.solve(A, np.append(F, off))
        except np.linalg.LinAlgError:
            return None
    return None


def _turning(a: float, b: float, rise_a: float, rise_b: float) -> float:
    """The extreme of the cubic from a to b with these rises at its ends."""
    # derivative rise_a (1-t)(1-3t) + 6 (b-a) t (1-t) + rise_b t (3t-2)
    c = 3 * rise_a + 3 * rise_b - 6 * (b - a), -4 * rise_a - 2 * rise_b + 6 * (b - a), rise_a
    inside = [
        float(np.real(t)) for t in np.roots(c) if abs(np.imag(t)) < 1e-9 and -1e-9 < np.real(t) < 1 + 1e-9
    ]
    t = inside[0] if inside else 0.5
    return float(
        a * (1 + 2 * t) * (1 - t) ** 2
        + rise_a * t * (1 - t) ** 2
        + b * t * t * (3 - 2 * t)
        + rise_b * t * t * (t - 1)
    )


__all__ = ["Equations", "Found", "Row", "Said", "Term", "solved"]
