"""Buckling under the state's own stresses, strain-mode leafs: (K0 + mu S) phi = 0 with K0 elastic, S from the stresses.

K0 is the tangent in the deformed geometry with every stress, drive force and load set to zero: positive definite once
the constraint rows are met, whatever the state. With K0^-1 = G G^T the symmetric matrix -G^T S G has the eigenvalues
1/mu, so all multipliers are real. Unknowns as for frequencies: node motions, and for every leaf the inner coordinates b
of `ksd.beam.strain_mass` (a = P xi + b), in which K0 falls apart into the nodes and a flexibility Z per leaf.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.errors import KinematicsError, SceneError
from ksd.model.arrays import COIL, TURN, Motion
from ksd.model.compile import Model
from ksd.model.loading import add_loads, add_terms, twist
from ksd.model.springs import add_springs
from ksd.model.tangents import geometric_tangent
from ksd.properties.alike import (
    Alike,
    EndFrames,
    Flexible,
    Weighed,
    alike_leafs,
    end_frames,
    inner_unknowns,
    unstressed_leafs,
    weighed,
)
from ksd.properties.followed import MOST_NODES, LeafPencil, Pencil, followed
from ksd.properties.kept import room_of
from ksd.properties.krylov import outermost
from ksd.properties.opened import Opened
from ksd.properties.tangent import free_rows, stored_matrix

Array = NDArray[np.float64]


def node_terms(model: Model, motion: Motion, rows: Iterable[int], load_factor: float) -> Array:
    """What constraint rows, loads and springs add to the tangent of the nodes (unknowns, unknowns); `rows` are taken out."""
    arrays = model.arrays
    work = room_of(model)
    for part in (work.value, work.rhs, work.scale):
        part[:] = 0.0
    target = np.zeros(len(arrays.terms.start))
    if len(arrays.springs.kind):
        add_springs(arrays, motion.x, motion.R, work, 1e-8, 0.0)
    add_loads(arrays, motion.R, work, load_factor, 1e-8)
    add_terms(arrays, motion.x, motion.R, motion.multiplier, target, work, 1e-8)
    free_rows(arrays, work.value, rows)
    return stored_matrix(arrays, work.value)


def relaxed(model: Model, motion: Motion) -> Model:
    """The model with springs and elastic links that are free of force at `motion`."""
    springs = model.arrays.springs
    if not len(springs.kind):
        return model
    value = springs.value.copy()
    for i, (a, b) in enumerate(springs.node.tolist()):
        here, R = value[springs.value_at[i] :], motion.R
        frame = R[a] @ springs.frame[i, 0]
        ends = [motion.x[n] + R[n] @ springs.offset[i, e] for e, n in enumerate((a, b))]
        d = frame.T @ (ends[1] - ends[0])
        if springs.kind[i] == COIL:
            here[1] = np.linalg.norm(d)
        elif springs.kind[i] == TURN:
            here[1] = twist(R[a], R[b], frame[:, 2].copy(), np.zeros(12), np.zeros((12, 12)), 0.0)
        else:
            # place and rotation at rest, then the wrench there
            here[:3], here[3:12] = d, (frame.T @ R[b] @ springs.frame[i, 1]).ravel()
            here[12:18] = 0.0
    return replace(model, arrays=model.arrays._replace(springs=springs._replace(value=value)))


def corners(motion: Motion, group: Alike, ends: EndFrames) -> Array:
    """(k, 12, 12): how the end wrench of every leaf turns with its nodes."""
    found = np.zeros((len(group.members), 12, 12))
    wrench = motion.inner[group.places[:, group.modes :]].reshape(-1, 2, 3) @ ends.frame.swapaxes(1, 2)
    for k in range(len(found)):
        geometric_tangent(wrench[k, 0], wrench[k, 1], ends.reach[k], ends.arms[k, 1], found[k])
    return found


def refuse_stressless(change: Array, elastic: Array) -> None:
    """Raise SceneError when there is no stress to multiply: `change` is rounding beside the `elastic` stiffness."""
    if not np.abs(change).max(initial=0.0) > 1e-13 * np.abs(elastic).max(initial=0.0):
        raise SceneError("this state carries no stress, so nothing buckles; name a link and a load")


OTHER = 1e-3
"""Share of the largest 1/mu below which one of the other sign is not looked for."""


@dataclass(frozen=True)
class _Elastic:
    """G (size, reduced) with K0^-1 = G G^T: nodes (n, r) and root of Z (k, N, N) of every group of leafs."""

    nodes: Array
    leafs: list[tuple[NDArray[np.int64], Array]]

    def out(self, y: Array) -> Array:
        """G y."""
        n, at = self.nodes.shape
        x = np.zeros((n + sum(p.size for p, _ in self.leafs), y.shape[1]))
        x[:n] = self.nodes @ y[:at]
        for places, root in self.leafs:
            x[places] = root @ y[at : at + places.size].reshape(*places.shape, -1)
            at += places.size
        return x

    def back(self, x: Array) -> Array:
        """G^T x."""
        inner = [(root.swapaxes(1, 2) @ x[p]).reshape(p.size, -1) for p, root in self.leafs]
        return np.concatenate([self.nodes.T @ x[: len(self.nodes)], *inner])

    @property
    def reduced(self) -> int:
        """Columns of G."""
        return self.nodes.shape[1] + sum(p.size for p, _ in self.leafs)


def _unstressed_nodes(
    model: Model, motion: Motion, leafs: list[Flexible], rows: list[int]
) -> tuple[Array, Array]:
    """Node tangent without stress (n, n), leafs condensed, and the part of constraint rows and springs in it."""
    still = Motion(motion.x, motion.R, motion.inner, np.zeros_like(motion.multiplier))
    terms = node_terms(relaxed(model, motion), still, rows, 0.0)
    K = np.pad(terms, (0, 1))
    for leaf, unknowns in zip(leafs, inner_unknowns(model), strict=True):
        at = unknowns[:, :12]
        np.add.at(
            K, (at[:, :, None], at[:, None, :]), leaf.relative.swapaxes(1, 2) @ leaf.ends @ leaf.relative
        )
    return K[:-1, :-1], terms


def _elastic(model: Model, K: Array, terms: Array, leafs: list[Flexible], rows: list[int]) -> _Elastic:
    """G of the stressless tangent K (n, n). Raises KinematicsError where a motion meets no elastic resistance."""
    held = model.arrays.terms.start
    move = np.setdiff1d(np.arange(len(terms)), held)
    rules = np.delete(terms[np.ix_(held, move)], rows, axis=0)
    free = np.eye(len(move))
    if len(rules):
        _, s, vt = np.linalg.svd(rules)
        free = vt[int(np.sum(s > 1e-12 * s[0])) :].T
    try:
        L = np.linalg.cholesky(free.T @ K[np.ix_(move, move)] @ free)
    except np.linalg.LinAlgError as error:
        raise KinematicsError(
            "a motion is left that nothing but stress resists; hold more drives to ask for buckling"
        ) from error
    nodes = np.zeros((len(terms), free.shape[1]))
    nodes[move] = np.linalg.solve(L, free.T).T
    return _Elastic(nodes, [(leaf.inner, _root(leaf.Z)) for leaf in leafs])


def _root(Z: Array) -> Array:
    """R (k, N, N) with Z = R R^T."""
    value, vector = np.linalg.eigh(Z)
    found: Array = vector * np.sqrt(np.maximum(value, 0.0))[:, None, :]
    return found


def own_stress(
    opened: Opened, rows: list[int], *, count: int, near: tuple[Array, ...] = ()
) -> tuple[Array, Array]:
    """The `count` multipliers mu of smallest magnitude on all stresses of the state, and the smallest of either sign, with
    phi (size, k) in node unknowns and b. rows: constraint rows let go; near: phi of a state nearby to start from. Raises
    SceneError for a state without stress, KinematicsError where nothing but stress resists a motion."""
    model, motion = opened.model, opened.motion
    leafs = unstressed_leafs(model, opened.leafs)
    K, terms = _unstressed_nodes(model, motion, leafs, rows)
    S, pieces = _stresses(opened, leafs, terms, rows)
    # node and leaf unknowns have scales of their own
    sizes = [(S, np.abs(K).max(initial=0.0))]
    sizes += [(p[2], np.abs(leaf.stiffness).max()) for p, leaf in zip(pieces, leafs, strict=True)]
    refuse_stressless(
        np.array([np.abs(change).max(initial=0.0) / scale for change, scale in sizes]), np.ones(1)
    )
    if len(K) <= MOST_NODES:
        each = zip(leafs, pieces, strict=True)
        pencil = Pencil(
            K, -S, [LeafPencil(at, inner, f.Z, -own, -both) for f, (inner, at, own, both) in each],
            model.arrays.terms.start,
        )  # fmt: skip
        forces = pencil.forces(-_stress_forces(S, pieces, near[0])) if near else None
        found = followed(
            pencil, forces, lambda s: outer_of_both_signs(1.0 / s, count),
            most=count + 4, rows=len(model.arrays.terms.start), reach=1.0 / OTHER,
        )  # fmt: skip
        if found is not None:
            s, X, chosen = found
            return s[chosen], pencil.vectors(X[chosen], len(K) + sum(leaf.inner.size for leaf in leafs))
    return _by_lanczos(_elastic(model, K, terms, leafs, rows), S, pieces, count)


def _stresses(
    opened: Opened, leafs: list[Flexible], terms: Array, rows: list[int]
) -> tuple[Array, list[tuple[Any, ...]]]:
    """S: of the nodes (n, n), and of every make of leafs (b, unknowns of its nodes, S of b, S of b with the nodes)."""
    model, motion, load_factor = opened.model, opened.motion, opened.load_factor
    nodes = np.pad(node_terms(model, motion, rows, load_factor) - terms, (0, 1))
    pieces: list[tuple[Any, ...]] = []
    for group, leaf, unknowns in zip(alike_leafs(model), leafs, inner_unknowns(model), strict=True):
        change = leaf.parts.W - leaf.stiffness
        follow = leaf.P @ leaf.relative
        both = change @ follow
        block = (
            corners(motion, group, end_frames(model, motion, group.members)) + follow.swapaxes(1, 2) @ both
        )
        weight = weighed(model, motion, group, load_factor)
        if weight is not None:
            swing, corner = _hanging(leaf, weight, follow)
            both, block = both + swing, block + corner
        at = unknowns[:, :12]
        np.add.at(nodes, (at[:, :, None], at[:, None, :]), block)
        pieces.append((leaf.inner, at, change, both))
    return nodes[:-1, :-1], pieces


def _by_lanczos(G: _Elastic, S: Array, pieces: list[tuple[Any, ...]], count: int) -> tuple[Array, Array]:
    """The same of -G^T S G."""

    def apply(y: Array) -> Array:
        return -G.back(_stress_forces(S, pieces, G.out(y)))

    def wanted(values: Array) -> Any:
        # to rounding, the smaller ones are no stress at all
        return outer_of_both_signs(values, count)

    values, y = outermost(apply, G.reduced, wanted)
    order = np.argsort(-np.abs(values))
    return 1.0 / values[order], G.out(y[:, order])


def _hanging(leaf: Flexible, weight: Weighed, follow: Array) -> tuple[Array, Array]:
    """What weight adds to S, linear in it: coupling (k, N, 12) of b with the nodes, and node blocks (k, 12, 12).

    Gravity turns in frame p: it pushes at the amplitudes, and at the stretch, whose force n is eliminated.
    """
    stiff = np.linalg.solve(leaf.parts.S, weight.pull.B)
    swing: Array = leaf.parts.J[:, :3].swapaxes(1, 2) @ stiff - weight.pull.eta.swapaxes(1, 2)
    swing = swing @ weight.turn
    cross = follow.swapaxes(1, 2) @ swing - leaf.relative[:, :3].swapaxes(1, 2) @ (stiff @ weight.turn)
    return swing, weight.corner + cross + cross.swapaxes(1, 2)


def outer_of_both_signs(values: Array, count: int) -> NDArray[np.intp]:
    """Numbers of the `count` largest of values = 1/mu in magnitude, and of the largest of either sign that is no less than
    OTHER times the largest of all."""
    order = np.argsort(-np.abs(values))
    sizes = np.abs(values[order])
    most = sizes.max(initial=0.0)
    taken = (np.arange(len(order)) < count) & (sizes > 1e-10 * most)
    for sign in (1.0, -1.0):
        side = np.flatnonzero((sign * values[order] > 0.0) & (sizes > OTHER * most))
        taken[side[:1]] = True
    return order[taken]


def _stress_forces(S: Array, pieces: list[tuple[Any, ...]], x: Array) -> Array:
    """S x: nodes, leafs, and what couples them."""
    n = len(S)
    padded = np.vstack([x[:n], np.zeros((1, x.shape[1]))])
    nodes = np.vstack([S @ x[:n], np.zeros((1, x.shape[1]))])
    found = np.zeros_like(x)
    for inner, at, change, both in pieces:
        b = x[inner]
        found[inner] = change @ b + both @ padded[at]
        np.add.at(nodes, at, both.swapaxes(1, 2) @ b)
    found[:n] = nodes[:n]
    return found
