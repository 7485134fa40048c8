"""Restrained torsion of straight runs of different pieces that cannot warp at their two outer ends.

Vlasov's equation for the rate of twist g(s) under a torque T: T = GJ g - (EG g')', GJ and the warping stiffness EG [N m^4]
those of the piece. Warping g and bimoment -EG g' are continuous where pieces meet, g = 0 at the clamps. A uniform piece has
a closed solution for a torque that is linear along it, so the only unknowns are the rates of twist where pieces meet, the
seventh unknowns: one tridiagonal system per run. Source: V. Z. Vlasov, Thin-walled elastic beams (1961), ch. V.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ksd.section.along_leaf import ELEMENT_POINTS, AlongLeaf, Array, element_points
from ksd.section.closed_forms import is_rectangle
from ksd.section.section import Section

SLICES_PER_PIECE = 128
"""Number of uniform slices that approximate a piece of varying section."""
POWERS = 1.0, 30.0
"""Bounds of the power of `_local_rate`: near 1 for long leaf springs, 6 for the shortest, more in runs of unlike pieces.
Once one of them is met, a linear torque has its own work only roughly."""


class Slice(NamedTuple):
    """A uniform piece: length [m], stiffness GJ [N m^2] without restraint, decay sqrt(GJ/EG) [1/m] of warping along it."""

    length: float
    stiffness: float
    decay: float


class Piece(NamedTuple):
    """A leaf of a run: its slices, and the edges of the elements of its `RestrainedTwist`, from its start to its end."""

    slices: Sequence[Slice]
    edges: Array


@dataclass(frozen=True)
class RestrainedTwist(AlongLeaf):
    """Twist along a leaf whose warping is restrained, or a part of one: its rate over that with GJ times `factor`.

    factor: on GJ of the whole leaf under a constant torque. The rate is local to a section, and equivalent for torques that
    are linear along the run, as far as `POWERS` allow.
    """

    factor: float = 1.0

    def compliance(self, s: Array) -> Array:
        """Values (k,) at fractions s (k,) of the length."""
        return np.asarray(self.rows(s)[0])


def warping_decay(section: Section, E: float, nu: float, G: float) -> float:
    """Decay of warping sqrt(GJ/EG) [1/m]; for a rectangle that of a thin one, sqrt(24/(1 + nu))/w, as in the published
    factor."""
    if is_rectangle(section):
        return math.sqrt(24.0 / (1.0 + nu)) / max(section.width, section.thickness)
    return math.sqrt(G * section.J / (E * section.Iw))


def twist_along(run: Sequence[Piece]) -> list[RestrainedTwist]:
    """`RestrainedTwist` of every piece of a run. Lengths, stiffnesses and decays must be positive; they are not checked."""
    length, stiff, decay = np.array([s for piece in run for s in piece.slices]).T
    cuts = np.cumsum([0, *(len(piece.slices) for piece in run)])
    ends = np.concatenate([[0.0], np.cumsum(length)])
    # a torque that is constant along the run, and one that is linear
    torques = np.stack([np.ones(len(ends)), 2.0 * ends / ends[-1] - 1.0], axis=1)
    rates = _rates_at_ends(length, stiff, decay, torques)
    # without restraint, at the start and the end of every slice
    free, free_end = torques[:-1] / stiff[:, None], torques[1:] / stiff[:, None]
    layers = np.tanh(0.5 * decay * length) / decay * (rates[:-1] + rates[1:] - free - free_end)[:, 0]
    twists = [float((length / stiff + layers)[a:b].sum()) for a, b in pairwise(cuts)]
    points, weights, slices = [], [], []
    for piece, (a, b) in zip(run, pairwise(cuts), strict=True):
        parts = np.diff(piece.edges)[:, None]
        size = ends[b] - ends[a]
        points.append(ends[a] + size * (piece.edges[:-1, None] + parts * element_points()[0]).ravel())
        weights.append(size * (parts * element_points()[1]).ravel())
        slices.append(np.clip(np.searchsorted(ends, points[-1], side="right") - 1, a, b - 1))
    at, weight, k = (np.concatenate(each) for each in (points, weights, slices))
    x = 2.0 * at / ends[-1] - 1.0
    near, far = _layer(decay[k], ends[k + 1] - at, length[k]), _layer(decay[k], at - ends[k], length[k])
    rate, linear = (
        free[k] + (free_end[k] - free[k]) * ((at - ends[k]) / length[k])[:, None]
        + near[:, None] * (rates[k] - free[k]) + far[:, None] * (rates[k + 1] - free_end[k])
    ).T  # fmt: skip
    rate = _local_rate(x, weight, stiff[k], rate, linear)
    found, first = [], 0
    for piece, twist, (a, b) in zip(run, twists, pairwise(cuts), strict=True):
        own_points = slice(first, first := first + ELEMENT_POINTS * (len(piece.edges) - 1))
        factor = float((length / stiff)[a:b].sum()) / twist
        values = factor * stiff[k[own_points]] * rate[own_points]
        values *= twist / (weight[own_points] @ rate[own_points])
        found.append(RestrainedTwist(tuple(piece.edges.tolist()), tuple(values.tolist()), factor=factor))
    return found


def _rates_at_ends(length: Array, stiff: Array, decay: Array, torques: Array) -> Array:
    """Rates of twist (n+1, 2) [1/m] at the ends of n slices under torques (n+1, 2), linear in each; 0 at the clamps."""
    rates = np.zeros(torques.shape)
    if len(length) > 1:
        from scipy.linalg import solveh_banded

        # bimoments at the ends of a slice: K (g - T/GJ) with K = GJ/k [coth, -1/sinh], and T'/k^2
        x = decay * length
        own, next_ = stiff / decay / np.tanh(x), -stiff / decay / np.sinh(np.minimum(x, 700.0))
        near, far = torques[:-1] / stiff[:, None], torques[1:] / stiff[:, None]
        slope = (far - near) * (stiff / decay**2 / length)[:, None]
        at_start = own[:, None] * near + next_[:, None] * far + slope
        at_end = next_[:, None] * near + own[:, None] * far - slope
        band = np.zeros((2, len(rates)))
        band[1, 0] = band[1, -1] = 1.0
        band[1, 1:-1], band[0, 2:-1] = own[:-1] + own[1:], next_[1:-1]
        rates[1:-1] = at_end[:-1] + at_start[1:]
        rates = solveh_banded(band, rates)
    return rates


def _layer(decay: Array, away: Array, length: Array) -> Array:
    """sinh(k away) / sinh(k length) of slices, away: from the end where it is 0."""
    fall = np.exp(decay * (away - length))
    return np.asarray(fall * np.expm1(-2.0 * decay * away) / np.expm1(-2.0 * decay * length))


def _local_rate(x: Array, weight: Array, stiff: Array, rate: Array, linear: Array) -> Array:
    """Rate of twist, local to a section, with which a linear torque has its own work: a power of the share GJ `rate` of a
    constant torque, which vanishes at clamps.

    x: the linear torque; linear: the rate that it gives.
    """
    from scipy.optimize import brentq

    middle, share = weight @ (x * rate) / (weight @ rate), np.clip(stiff * rate, 0.0, None)
    work = weight @ (x * (linear - middle * rate)) / (weight @ rate)

    def lacking(power: float) -> float:
        local = weight * share**power / stiff
        return float(local @ (x - middle) ** 2 / local.sum() - work)

    low, high = POWERS
    inside = lacking(low) > 0.0 > lacking(high)
    power = brentq(lacking, low, high) if inside else high if lacking(high) >= 0.0 else low
    return np.asarray(share**power / stiff)
