"""Eigenfrequencies and modes about a deformed, loaded state, all inner unknowns kept (no Guyan condensation).

K x = omega^2 M x with K the exact tangent (constraint rows and geometric terms included) and M the consistent
mass. With M = L L^T the symmetric matrix L^T K^-1 L has the eigenvalues 1/omega^2: K may be a saddle, M may
be singular, and an unstable state shows as a negative one. Below DENSE unknowns everything is dense; above,
block Lanczos on K^-1 M with the factored tangent (`ksd.properties.krylov`; Grimes, Lewis and Simon 1994).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.model.arrays import Motion
from ksd.model.compile import Model
from ksd.model.loading import term_value
from ksd.model.system import move_nodes
from ksd.properties.alike import alike_leafs
from ksd.properties.followed import MOST_NODES, followed
from ksd.properties.krylov import outermost
from ksd.properties.mass import Inertia, inertia
from ksd.properties.opened import Opened
from ksd.properties.tangent import Tangent
from ksd.properties.words import Shown, held, listed, movement, number

Array = NDArray[np.float64]
DENSE = 120
"""Unknowns up to which the dense eigensolution is the faster one."""
MOST_SKEW = 1000
"""The same where modes may grow that are not among the lowest."""
CLOSE = 1.1
"""Ratio to the highest frequency asked for within which those of a pose nearby may come in."""
EMPTY = 1e-13
"""Modes with 1/omega^2 below this fraction of the largest are rounding of the constraints."""


@dataclass(frozen=True, repr=False)
class Modes(Shown):
    """Eigenfrequencies about a state, lowest first, and their shapes.

    frequency_Hz (k,): omega / 2 pi; an unstable mode (omega^2 < 0) has the negative number -sqrt(-omega^2) /
    2 pi and comes first. omega_squared (k,) [1/s^2]. shape (k, nodes, 6): displacement [m] and rotation [rad]
    of every node of `model` for unit modal mass [kg m^2]; vector (k, size): all unknowns, inner ones
    included. drive_motion (k, drives): what every drive's coordinate does in each mode [m or rad]; zero where
    it is held. growth_per_s (k,): rate at which a mode grows by itself: of an unstable one, or, where loads are not
    conservative, of the two that flutter at one frequency, which come first too. freed: names let go. massless:
    materials without a density; their leafs took part without mass. around: omega_squared and vectors with the next
    ones up, as they come, to start from at a pose nearby.
    """

    model: Model
    frequency_Hz: Array
    omega_squared: Array
    shape: Array
    vector: Array
    drive_motion: Array
    growth_per_s: Array
    freed: tuple[str, ...]
    massless: tuple[str, ...]
    mass: Inertia = field(repr=False)
    motion: Motion = field(repr=False)
    around: tuple[Array, Array] = field(repr=False)
    conservative: bool = True

    def __len__(self) -> int:
        return len(self.frequency_Hz)

    def _line(self) -> str:
        first, last = (number(f) for f in self.frequency_Hz[[0, -1]])
        return f"{len(self)} modes, {first} to {last} Hz, {held(self.freed)}" if len(self) else "no modes"

    def __str__(self) -> str:
        kind, rows = self.intended, []
        for k, f in enumerate(self.frequency_Hz):
            said = (
                [self.movements[k]]
                + ["intended"] * (k == kind)
                + ["unstable"] * bool(self.omega_squared[k] < 0.0)
            )
            rows.append((str(k + 1), number(f, 5), ", ".join(said)))
        skew = "Loads that follow their link, or moments fixed in space, are not conservative: from the unsymmetric tangent"
        grows = [f"{skew}; {self._growth()}"] * (not self.conservative)
        bare = [f"Without mass, for want of a density: {', '.join(self.massless)}"] * bool(self.massless)
        return listed(
            ("mode", "[Hz]", "<what moves"), rows, f"Eigenfrequencies, {held(self.freed)}", *grows, *bare
        )

    def _growth(self) -> str:
        """Which modes grow, in words."""
        growing = np.flatnonzero(self.growth_per_s > 0.0)
        if not len(growing):
            return "none of these grows, neither by itself (divergence) nor in oscillations (flutter)"
        named = (f"{k + 1} by {number(self.growth_per_s[k])}" for k in growing)
        return f"modes that grow, per second and without damping: {', '.join(named)}"

    @cached_property
    def movements(self) -> tuple[str, ...]:
        """What every mode does most, in words: a link or block that moves, or, where more than half of the kinetic energy is
        that of leafs between ends that stand still, the leafs that do."""
        still = self._between_ends()
        leafs = np.array(list(self.model.member_names), dtype=object)
        said = []
        for k, shape in enumerate(self.shape):
            if still[:, k].sum() <= 0.5:
                said.append(movement(self.model, shape) or "the leafs")
                continue
            busy = leafs[still[:, k] > 0.25 * still[:, k].max()]
            more = f" and {len(busy) - 2} more" if len(busy) > 2 else ""
            said.append(", ".join(f"'{n}'" for n in busy[:2]) + f"{more} between the ends")
        return tuple(said)

    def _between_ends(self) -> Array:
        """(members, k): share of the kinetic energy in the motion of every leaf between its ends held still."""
        share = np.zeros((len(self.model.member_names), len(self)))
        for group, (places, B) in zip(alike_leafs(self.model), self.mass.stacks, strict=False):
            moving = B[:, :, 12:] @ self.vector.T[places[:, 12:]]
            share[group.members] = (moving**2).sum(axis=1)
        return share

    def assurance(self, other: Modes) -> Array:
        """Mode assurance (k, k') in 0..1 between these modes and `other`, by the mean of both masses.

        For following modes along a stroke: the partner of a mode is the one with the largest number in its
        row.
        """
        one = np.vstack([self._rooted, other.mass.rooted(self.vector.T)])
        two = np.vstack([self.mass.rooted(other.vector.T), other._rooted])
        return np.asarray((one.T @ two) ** 2 / np.outer(np.sum(one**2, axis=0), np.sum(two**2, axis=0)))

    @cached_property
    def _rooted(self) -> Array:
        return self.mass.rooted(self.vector.T)

    def moved(self, number: int, size: float) -> Motion:
        """The state of `model` displaced by `size` times mode `number`, to first order, leafs included."""
        state, x = self.motion.copy(), size * self.vector[number]
        for group, leaf in zip(alike_leafs(self.model), self.mass.leafs, strict=True):
            starts = self.model.arrays.start[self.model.arrays.members.node[group.members]]
            ends = np.where(
                starts[..., None] < 0, 0.0, x[np.maximum(starts, 0)[..., None] + np.arange(6)]
            ).reshape(len(starts), 12, 1)
            bent = x[leaf.inner] + (leaf.P @ (leaf.relative @ ends))[..., 0]
            state.inner[group.places[:, : group.modes]] += bent
        move_nodes(self.model.arrays, state, np.ascontiguousarray(x[: self.model.arrays.plan.unknowns]), 1.0)
        return state

    @property
    def intended(self) -> int | None:
        """Number of the mode that is the intended motion: the one with the largest share in the compliance of
        the freed drives, sum over the modes of (drive motion / omega)^2. None when all drives are held."""
        if not self.freed or not self.drive_motion.size:
            return None
        share = (self.drive_motion**2).max(axis=1) / np.abs(self.omega_squared)
        return int(np.argmax(share)) if share.max() > 0.0 else None

    @property
    def first_parasitic_Hz(self) -> float:
        """Lowest frequency that is not the intended motion's; with all drives held, the lowest of all.

        nan when no other mode was asked for.
        """
        skip = self.intended
        return float(next((f for k, f in enumerate(self.frequency_Hz) if k != skip), np.nan))


def _apply(tangent: Tangent, mass: Inertia, loads: Array) -> Array:
    """K^-1 loads for loads (size, k): node tangent beside the flexibilities of the leafs."""
    n = tangent.arrays.plan.unknowns
    out = np.empty_like(loads)
    out[:n] = tangent.solve(loads[:n])
    for leaf in mass.leafs:
        out[leaf.inner] = leaf.Z @ loads[leaf.inner]
    return out


def _dense(tangent: Tangent, mass: Inertia, count: int) -> tuple[Array, Array]:
    """(1/omega^2, vectors (size, k)) by the dense route; complex where modes flutter."""
    from scipy.linalg import eig, eigh, lapack

    M = mass.dense()
    used = np.flatnonzero(M.diagonal() > 0.0)
    scale = 1.0 / np.sqrt(M.diagonal()[used])
    C, order, rank, _ = lapack.dpstrf(M[np.ix_(used, used)] * np.outer(scale, scale), lower=1)
    L = np.zeros((mass.size, rank))
    L[used[order - 1]] = (np.tril(C)[:, :rank].T / scale[order - 1]).T
    x = _apply(tangent, mass, L)
    A = L.T @ x
    if tangent.turning is not None:
        values, vectors = eig(A)
        kept = np.concatenate([np.flatnonzero(_bad(values)), np.argsort(-np.abs(values))[: 2 * count]])
        kept = np.unique(kept)
        return values[kept], x @ vectors[:, kept]
    values, vectors = _outermost(0.5 * (A + A.T), count, eigh)
    return values, x @ vectors


def _arnoldi(tangent: Tangent, mass: Inertia, count: int) -> tuple[Array, Array]:
    """The same of an unsymmetric tangent by Arnoldi iteration: the largest 1/omega^2."""
    from scipy.sparse.linalg import LinearOperator, eigs

    B = mass.root
    back = B.T.tocsr()
    size = B.shape[0]
    operator = LinearOperator(
        (size, size),
        matvec=lambda y: B @ _apply(tangent, mass, (back @ y.ravel())[:, None])[:, 0],
        dtype=float,
    )
    start = np.random.default_rng(0).normal(size=size)
    values, y = eigs(operator, k=min(2 * count + 4, size - 2), which="LM", v0=start)
    x = back @ y
    return values, _apply(tangent, mass, x.real) + 1j * _apply(tangent, mass, x.imag)


def _bad(values: Array) -> Any:
    """Which 1/omega^2 are those of modes that grow."""
    bound = 1e-9 * np.abs(values).max(initial=0.0)
    return (values.real < -bound) | (np.abs(values.imag) > np.maximum(bound, 1e-6 * np.abs(values)))


def _outermost(A: Array, count: int, eigh: Any) -> tuple[Array, Array]:
    """The `count` largest eigenvalues of A and all clearly negative ones, with vectors."""
    size = len(A)
    values, vectors = eigh(A, subset_by_index=(max(0, size - count), size - 1))
    low, below = eigh(A, subset_by_index=(0, min(size, count) - 1))
    bad = low < -1e-9 * np.abs(np.concatenate([values, low])).max()
    keep = values > 0.0
    return np.concatenate([low[bad], values[keep]]), np.hstack([below[:, bad], vectors[:, keep]])


def _lanczos(tangent: Tangent, mass: Inertia, count: int) -> tuple[Array, Array]:
    """The same by block Lanczos on B K^-1 B^T, which has the eigenvalues 1/omega^2 for M = B^T B."""
    B = mass.root
    back = B.T.tocsr()

    def apply(y: Array) -> Array:
        found: Array = B @ _apply(tangent, mass, back @ y)
        return found

    def wanted(values: Array) -> Any:
        # every unstable direction is a negative value; of the others the largest
        below = np.flatnonzero(values < -1e-9 * np.abs(values).max())[: tangent.unstable]
        return np.concatenate([below, np.argsort(-values)[:count]])

    values, y = outermost(apply, B.shape[0], wanted)
    return values, _apply(tangent, mass, back @ y)


def _lowest(values: Array, vectors: Array, count: int) -> tuple[Array, Array, Array]:
    """omega^2, shapes and growth of the modes 1/omega^2 = values: those that grow first, then the lowest."""
    keep = np.abs(values) > EMPTY * np.abs(values).max(initial=0.0)
    values, vectors = values[keep], vectors[:, keep]
    growing, omega = _bad(values), np.sqrt(1.0 / values + 0j)
    grown = np.where(growing, np.abs(omega.imag), 0.0)
    # of a fluttering pair the square of its frequency, and the real part of its shape
    flutters = growing & (np.abs(values.imag) > 1e-6 * np.abs(values))
    squared = np.where(flutters, omega.real**2, (1.0 / values).real)
    order = np.lexsort((squared, ~growing))[:count]
    return squared[order], vectors[:, order].real, grown[order]


def _followed(
    opened: Opened, near: Modes | None, tangent: Tangent, mass: Inertia, count: int
) -> tuple[Array, Array] | None:
    """The same by inverse iteration, from the modes of a neighbouring state if there are any; None where that is no way,
    or did not find them all."""
    model = opened.model
    if tangent.unstable or tangent.turning is not None or not mass.leafs:
        return None
    if model.arrays.plan.unknowns > MOST_NODES:
        return None
    pencil, forces = mass.pencil(opened.assembled.matrix(tangent.freed)), None
    if near is not None and near.model is model and near.freed == tangent.freed and len(near) >= count:
        squared, vectors = near.around
        # with those that may come in from above
        start = (np.arange(len(squared)) < count + 2) | (squared < CLOSE**2 * squared[count - 1])
        forces = pencil.forces(mass.times(vectors[start].T))
    rows = len(model.arrays.terms.start)
    found = followed(pencil, forces, lambda s: np.argsort(s)[:count], most=count + 2, rows=rows)
    if found is None or len(found[2]) < count:
        return None
    # the others found are above those chosen
    return 1.0 / found[0], pencil.vectors(found[1], mass.size)


def frequencies(
    model: Model,
    motion: Motion,
    *,
    count: int = 6,
    freed: Iterable[str] = (),
    load_factor: float = 1.0,
    dense: bool | None = None,
    near: Modes | None = None,
    opened: Opened | None = None,
) -> Modes:
    """The `count` lowest eigenfrequencies at `motion`, drives and supports held but for those named in
    `freed`.

    Freed drives keep their present force. dense: True or False forces one of the two routes. near: modes of a state
    nearby, with the same drives freed, to start from; opened: this state, opened. Raises SceneError when nothing has
    mass, KinematicsError when nothing resists a motion.
    """
    freed = (freed,) if isinstance(freed, str) else tuple(freed)
    opened = opened or Opened(model, motion, load_factor=load_factor)
    fine, state = opened.model, opened.motion
    mass = inertia(fine, state, load_factor=load_factor, leafs=opened.leafs)
    tangent = opened.tangent(freed)
    found = _followed(opened, near, tangent, mass, count) if dense is None else None
    if found is None:
        # the dense route costs by the unknowns that have mass
        # of an unsymmetric tangent whose symmetric part is not positive definite all are wanted
        most = MOST_SKEW if tangent.turning is not None and tangent.unstable else DENSE
        small = np.unique(mass.root.indices).size <= most if dense is None else dense
        by_iteration = _lanczos if tangent.turning is None else _arnoldi
        found = (_dense if small else by_iteration)(tangent, mass, count)
    return _modes(opened, mass, found, count, freed)


def _modes(
    opened: Opened, mass: Inertia, found: tuple[Array, Array], count: int, freed: tuple[str, ...]
) -> Modes:
    """Modes from 1/omega^2 (k,) and vectors (size, k), in order and of unit modal mass."""
    fine, state, (values, vectors) = opened.model, opened.motion, found
    squared, vectors, grown = _lowest(values, vectors, len(values))
    around, vectors = (squared, vectors.T), vectors[:, :count]
    squared, grown = squared[:count], grown[:count]
    vectors = vectors / np.sqrt(np.sum(mass.rooted(vectors) ** 2, axis=0))
    shape = np.zeros((len(squared), len(fine.node_names), 6))
    for k in range(1, len(fine.node_names)):
        shape[:, k] = vectors[int(fine.arrays.start[k]) :][:6].T
    return Modes(
        model=fine,
        frequency_Hz=np.sign(squared) * np.sqrt(np.abs(squared)) / (2 * np.pi),
        omega_squared=squared,
        shape=shape,
        vector=vectors.T.copy(),
        drive_motion=_drive_motion(fine, state, vectors),
        growth_per_s=grown,
        freed=freed,
        massless=mass.massless,
        mass=mass,
        motion=state,
        around=around,
        conservative=not fine.arrays.loads.skew.any(),
    )


def _drive_motion(model: Model, motion: Motion, vectors: Array) -> Array:
    """Rate (k, drives) of every drive's coordinate in the modes."""
    terms = model.arrays.terms
    out = np.zeros((vectors.shape[1], len(model.drive_names)))
    gradient, scratch = np.empty(12), np.empty((12, 12))
    for row in range(len(model.drive_names)):
        for t in range(terms.first[row], terms.first[row + 1]):
            term_value(terms, motion.x, motion.R, t, gradient, scratch, 0.0)
            for e in range(2):
                start = model.arrays.start[terms.node[t, e]]
                if start >= 0:
                    here = vectors[start : start + 6]
                    out[:, row] += terms.coefficient[t] * gradient[6 * e : 6 * e + 6] @ here
    return out
