"""Eigenpairs of a state, from those of a neighbouring one where there is one: Rayleigh quotient iteration, verified.

K x = s M x of arrow shape (`ksd.numerics.arrow`), K positive definite once the constraint rows are met. The vectors of the
neighbour (or random ones) take steps of inverse iteration, then steps with shifts of their own, each followed by the
Rayleigh-Ritz projection on their span, which parts equal eigenvalues (Parlett, The symmetric eigenvalue problem, ch. 4
and 14); their residuals are those asked of Lanczos. The negative pivots of K - s M below the outermost pair wanted must
then count the pairs found and no more, so that none is missed, whatever the neighbour looked like. Where that fails
more, random vectors are tried, and then there is no answer, and Lanczos is asked.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ksd.numerics.arrow import Arrow, arrow_solves, arrow_times, flexibility_roots, row_products
from ksd.numerics.blocks import stiffened
from ksd.properties.krylov import ACCURACY

Array = NDArray[np.float64]
NO_ROWS: NDArray[np.int64] = np.zeros(0, np.int64)
MOST_NODES = 150
"""Unknowns of the nodes up to which their dense elimination is the cheaper way."""
STEPS = 5
"""Steps with shifts at the most; two are usual."""
MANY = 12
"""Vectors taken besides where a first attempt fails: the leafs of a mechanism may all vibrate nearly alike."""
ROUNDS = 6
"""Inverse iterations without a shift from random vectors."""
SPARE = 4
"""Vectors iterated from random ones beyond those kept."""
BELOW = 1e-8
"""Pairs are counted this share below the outermost one wanted."""


class LeafPencil(NamedTuple):
    """Leafs of one make: at (k, 12): unknowns of both nodes, -1 for none; inner (k, N): of b; Z (k, N, N): inverse of their
    part of K; own (k, N, N) and both (k, N, 12): their parts of M."""

    at: NDArray[np.int64]
    inner: NDArray[np.int64]
    Z: Array
    own: Array
    both: Array


class Pencil:
    """K - s M: nodes (n, n) dense, `rows` (c,) of them constraint rows, and leafs."""

    def __init__(
        self, K: Array, M: Array, leafs: Sequence[LeafPencil], rows: NDArray[np.int64] = NO_ROWS
    ) -> None:
        self.nodes, self.leafs = len(K), leafs
        modes, count = max(leaf.inner.shape[1] for leaf in leafs), sum(len(leaf.inner) for leaf in leafs)
        A, C = np.zeros((count, modes, modes)), np.zeros((count, modes, 12))
        at, first = np.empty((count, 12), np.int64), 0
        self.roots, self.places = [], []
        for leaf in leafs:
            k, N = leaf.inner.shape
            R = np.empty((k, N, N))
            flexibility_roots(np.ascontiguousarray(leaf.Z), R, np.empty(N))
            here, turned = slice(first, first + k), R.swapaxes(1, 2)
            A[here, :N, :N] = turned @ leaf.own @ R
            C[here, :N] = turned @ leaf.both
            at[here] = leaf.at
            self.roots.append(R)
            self.places.append(self.nodes + modes * np.arange(first, first + k)[:, None] + np.arange(N))
            first += k
        # the same pairs, and no pivots of rounding where rows hold a node alone
        self.arrow = Arrow(stiffened(K, rows), np.ascontiguousarray(M), A, C, at)
        self.size = self.nodes + count * modes

    def forces(self, f: Array) -> Array:
        """Rows (p, size) from forces (unknowns, p) on the unknowns of the model."""
        found = np.zeros((f.shape[1], self.size))
        found[:, : self.nodes] = f[: self.nodes].T
        for leaf, R, place in zip(self.leafs, self.roots, self.places, strict=True):
            found[:, place] = np.einsum("kij,kip->pkj", R, f[leaf.inner])
        return found

    def vectors(self, X: Array, size: int) -> Array:
        """Unknowns of the model (size, p) from rows (p, ...)."""
        found = np.zeros((size, len(X)))
        found[: self.nodes] = X[:, : self.nodes].T
        for leaf, R, place in zip(self.leafs, self.roots, self.places, strict=True):
            found[leaf.inner] = np.einsum("kij,pkj->kip", R, X[:, place])
        return found

    def times(self, X: Array) -> Array:
        """M x of rows (p, size)."""
        found = np.empty_like(X)
        arrow_times(self.arrow, X, found)
        return found

    def resisted(self, X: Array) -> Array:
        """K x of rows (p, size)."""
        found = X.copy()
        found[:, : self.nodes] = X[:, : self.nodes] @ self.arrow.K
        return found

    def solves(self, shift: Array, F: Array) -> tuple[Array, NDArray[np.int64]]:
        """(K - shift M)^-1 F of right sides (g, q, size), q for each shift, and negative pivots (g,)."""
        found, negatives = F.copy(), np.empty(len(shift), np.int64)
        k, modes = self.arrow.A.shape[:2]
        rows, nodes = (
            np.empty((k, modes, modes + 12 + F.shape[1])),
            np.empty((self.nodes, self.nodes + F.shape[1])),
        )
        arrow_solves(self.arrow, shift, found, rows, nodes, negatives)
        return found, negatives

    def negatives(self, shift: Array) -> NDArray[np.int64]:
        """Negative pivots (g,) of K - shift M."""
        return self.solves(shift, np.zeros((len(shift), 1, self.size)))[1]


class _Found(NamedTuple):
    """Ritz pairs: s (p,), X, M X and K X (p, size), with X K X = 1."""

    s: Array
    X: Array
    MX: Array
    KX: Array


def _ritz(X: Array, MX: Array, KX: Array) -> _Found:
    """Ritz pairs in the span of rows X, which are scaled in place. Raises LinAlgError where K is not positive on it."""
    from scipy.linalg.lapack import dsygvd

    a, b = np.empty((len(X), len(X))), np.empty((len(X), len(X)))
    row_products(X, MX, KX, a, b)
    theta, w, failed = dsygvd(b, a)
    if failed:
        raise np.linalg.LinAlgError("K is not positive on the vectors")
    keep = np.abs(theta) > 1e-12 * np.abs(theta).max()
    w = w[:, keep].T
    return _Found(1.0 / theta[keep], w @ X, w @ MX, w @ KX)


def followed(
    pencil: Pencil,
    forces: Array | None,
    wanted: Callable[[Array], NDArray[np.intp]],
    *,
    most: int,
    rows: int,
    reach: float = 0.0,
) -> tuple[Array, Array, NDArray[np.intp]] | None:
    """Eigenvalues s (k,), rows X (k, size), and the numbers of the pairs `wanted`(s) out of them; the others come along.

    forces: M x (p, size) of approximate vectors; None where none are known: then `most` are iterated from random ones.
    rows: constraint rows, the negative pivots of K. reach: where M has both signs, how many times the smallest eigenvalue
    a side that none was found on is looked through. None where they do not converge, or where the count of pivots tells of
    others.
    """
    for more in (0, MANY):
        with contextlib.suppress(np.linalg.LinAlgError):
            start = _started(pencil, forces, wanted, most=most, more=more, rows=rows)
            found = _refined(pencil, start, wanted)
            if found is None:
                continue
            if _complete(pencil, (found[0], found[2]), rows, reach):
                return found
    return None


def _started(
    pencil: Pencil,
    forces: Array | None,
    wanted: Callable[[Array], NDArray[np.intp]],
    *,
    most: int,
    more: int,
    rows: int,
) -> _Found:
    """Ritz pairs after inverse iteration without a shift, `more` than usual. Raises LinAlgError where K is not positive
    beside its rows."""
    rounds, random = 1 if forces is not None else ROUNDS, more
    if forces is None:
        random, forces = most + more + SPARE, np.zeros((0, pencil.size))
    elif more:
        rounds = ROUNDS // 2
    if random:
        # times M: no motion of what is prescribed
        start = np.random.default_rng(0).normal(size=(min(random, pencil.size), pencil.size))
        forces = np.vstack([forces, pencil.times(start)])
    for _ in range(rounds):
        X, negatives = pencil.solves(np.zeros(1), forces[None])
        if negatives[0] != rows:
            raise np.linalg.LinAlgError("K is not positive")
        found = _ritz(X[0], pencil.times(X[0]), forces)
        forces = found.MX
    outer = np.union1d(np.argsort(np.abs(found.s))[: most + more], wanted(found.s))
    return _Found(*(part[outer] for part in found))


def _refined(
    pencil: Pencil, found: _Found, wanted: Callable[[Array], NDArray[np.intp]]
) -> tuple[Array, Array, NDArray[np.intp]] | None:
    """All eigenvalues and rows after steps with shifts, and the numbers of those wanted, whose residuals are small."""
    left = np.arange(len(found.s))
    for _ in range(STEPS):
        Z = pencil.solves(found.s[left], found.MX[left][:, None])[0][:, 0]
        if not np.isfinite(Z).all():
            return None
        MZ = pencil.times(Z)
        X, MX, KX = found.X.copy(), found.MX.copy(), found.KX.copy()
        X[left], MX[left], KX[left] = Z, MZ, found.MX[left] + found.s[left, None] * MZ
        found = _ritz(X, MX, KX)
        chosen = wanted(found.s)
        # K x anew: that of the steps believes in its factors
        rest = pencil.resisted(found.X[chosen]) - found.s[chosen, None] * found.MX[chosen]
        off = np.einsum("pi,pi->p", rest, pencil.solves(np.zeros(1), rest[None])[0][0])
        # those that are right already stay as they are
        left = chosen[off > ACCURACY**2]
        if not len(left):
            return found.s, found.X, chosen
    return None


def _complete(pencil: Pencil, found: tuple[Array, NDArray[np.intp]], rows: int, reach: float) -> bool:
    """Whether no eigenvalue lies between zero and the outermost chosen ones but those found."""
    s, chosen = found
    if not len(chosen):
        return False
    ends = [(1.0 - BELOW) * e for e in (s[chosen].max(), s[chosen].min())]
    if reach and ends[0] * ends[1] > 0.0:
        # one side has none
        ends = [max(ends, key=abs), -reach * float(np.abs(s).min()) * np.sign(ends[0])]
    elif ends[0] * ends[1] > 0.0:
        ends = [max(ends, key=abs)]
    count = pencil.negatives(np.array(ends)) - rows
    known = [np.sum((s / e > 0.0) & (s / e < 1.0)) for e in ends]
    return bool(np.all(count == known))
