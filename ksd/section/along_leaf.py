"""Values that vary along a leaf, steeply near its clamps, at the Gauss points of elements that are finer at its ends."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Self

import numpy as np
from numpy.polynomial.legendre import leggauss

Array = np.ndarray
ELEMENT_POINTS = 4
"""Gauss points of an element along the leaf."""
FIRST_ELEMENT, ELEMENT_GROWTH, HALF_ELEMENTS = 0.06, 1.4, 8
"""Length of the element at an end over the width, growth from one to the next, and number of elements in half a leaf at
least."""


def element_edges(length: float, width: float) -> Array:
    """Edges (n+1,) of the elements of a strip, in fractions of its length, finer towards its ends."""
    longest, sizes = 0.5 * length / HALF_ELEMENTS, [FIRST_ELEMENT * width]
    while sum(sizes) < 0.5 * length:
        sizes.append(min(ELEMENT_GROWTH * sizes[-1], longest))
    half = np.minimum(sizes, longest) if len(sizes) > HALF_ELEMENTS else np.ones(HALF_ELEMENTS)
    return np.concatenate([[0.0], np.cumsum([*half, *half[::-1]]) / (2.0 * half.sum())])


@lru_cache(maxsize=1)
def element_points() -> tuple[Array, Array]:
    """Gauss points and weights (ELEMENT_POINTS,) of an element, in fractions of it; the weights have the sum 1."""
    x, weight = leggauss(ELEMENT_POINTS)
    return 0.5 * (1.0 + x), 0.5 * weight


@dataclass(frozen=True)
class AlongLeaf:
    """Values along a leaf or a part of one.

    edges (n+1,): of the elements of the whole leaf, in fractions of its length; values (rows n ELEMENT_POINTS,): at their
    Gauss points; part: fractions of the whole leaf between which this leaf is.
    """

    edges: tuple[float, ...]
    values: tuple[float, ...]
    part: tuple[float, float] = (0.0, 1.0)

    def rows(self, s: Array) -> Array:
        """Values (rows, k) at fractions s (k,) of the length."""
        return self.interpolated(self.values, s)

    def interpolated(self, values: tuple[float, ...], s: Array) -> Array:
        """Rows of values at the Gauss points of the elements, at fractions s (k,), by a cubic in every element."""
        start, end = self.part
        u, edges = start + np.asarray(s, float) * (end - start), np.array(self.edges)
        e = np.clip(np.searchsorted(edges, u, side="right") - 1, 0, len(edges) - 2)
        weights = _lagrange((u - edges[e]) / (edges[e + 1] - edges[e]))
        table = np.reshape(values, (-1, len(edges) - 1, ELEMENT_POINTS))
        return np.asarray(np.einsum("kp,ckp->ck", weights, table[:, e]))

    @cached_property
    def breaks(self) -> tuple[float, ...]:
        """Fractions of the length between which the values are smooth, with both ends."""
        start, end = self.part
        inside = ((u - start) / (end - start) for u in self.edges)
        return (0.0, *(s for s in inside if 1e-9 < s < 1.0 - 1e-9), 1.0)

    def mean_rows(self, cuts: Array) -> Array:
        """Mean values (rows, k) between fractions `cuts` (k+1,) of the length."""
        edges = np.unique([*self.breaks, *cuts])
        edges = edges[(edges >= cuts[0]) & (edges <= cuts[-1])]
        x, weight = element_points()
        values = self.rows((edges[:-1, None] + np.diff(edges)[:, None] * x).ravel())
        sums = np.diff(edges) * (values.reshape(len(values), -1, len(x)) @ weight)
        first = np.searchsorted(edges, cuts[:-1])
        return np.asarray(np.add.reduceat(sums, first, axis=1) / np.diff(cuts))

    def turned(self) -> Self:
        """The values from the end of the whole leaf to its start."""
        edges = tuple((1.0 - np.array(self.edges)[::-1]).tolist())
        rows = np.reshape(self.values, (-1, (len(edges) - 1) * ELEMENT_POINTS))
        return replace(self, edges=edges, values=tuple(rows[:, ::-1].ravel().tolist()))

    def of_part(self, first: float, last: float) -> Self:
        """The values of the part between two fractions of the length."""
        start, end = self.part
        inside = (start + first * (end - start), start + last * (end - start))
        return replace(self, part=inside)


def _lagrange(x: Array) -> Array:
    """Lagrange polynomials (k, ELEMENT_POINTS) through the Gauss points of an element, at fractions x (k,) of it."""
    nodes, _ = element_points()
    away = x[:, None] - nodes
    others = [[j for j in range(len(nodes)) if j != i] for i in range(len(nodes))]
    return np.stack(
        [away[:, o].prod(axis=1) / (nodes[i] - nodes[o]).prod() for i, o in enumerate(others)], axis=1
    )
