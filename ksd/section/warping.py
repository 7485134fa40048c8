"""Restrained torsion of straight runs of different pieces that cannot warp at their two outer ends.

Vlasov's equation for the rate of twist g(s) under a torque T: T = GJ g - (EG g')', GJ and the warping stiffness EG [N m^4]
those of the piece. Warping g and bimoment -EG g' are continuous where pieces meet, g = 0 at the clamps. A uniform piece has
a closed solution, so the only unknowns are the rates of twist where pieces meet, the seventh unknowns: one tridiagonal
system per run. Source: V. Z. Vlasov, Thin-walled elastic beams (1961), ch. V.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ksd.section.closed_forms import is_rectangle
from ksd.section.section import Section

SLICES_PER_PIECE = 128
"""Number of uniform slices that approximate a piece of varying section."""


class Slice(NamedTuple):
    """A uniform piece: length [m], stiffness GJ [N m^2] without restraint, decay sqrt(GJ/EG) [1/m] of warping along it."""

    length: float
    stiffness: float
    decay: float


def warping_decay(section: Section, E: float, nu: float, G: float) -> float:
    """Decay of warping sqrt(GJ/EG) [1/m]; for a rectangle that of a thin one, sqrt(24/(1 + nu))/w, as in the published
    factor."""
    if is_rectangle(section):
        return math.sqrt(24.0 / (1.0 + nu)) / max(section.width, section.thickness)
    return math.sqrt(G * section.J / (E * section.Iw))


def twist_factors(run: Sequence[Sequence[Slice]]) -> list[float]:
    """Factor on GJ of every piece of a run, a sequence of slices, with which it twists alone as it does in the run.

    Lengths, stiffnesses and decays must be positive; they are not checked.
    """
    slices = [s for piece in run for s in piece]
    length, stiff, k = np.array(slices).T
    x = k * length
    # bimoments at the ends of a slice: K (g - T/GJ) with K = GJ/k [coth x, -1/sinh x]; half: its row sum over GJ
    half = np.tanh(0.5 * x) / k
    own, next_ = stiff / k / np.tanh(x), -stiff / k / np.sinh(np.minimum(x, 700.0))
    rates = np.zeros(len(slices) + 1)
    if len(slices) > 1:
        from scipy.linalg import solveh_banded

        # the outer rates are 0
        band = np.zeros((2, len(slices) + 1))
        band[1, 0] = band[1, -1] = 1.0
        band[1, 1:-1], band[0, 2:-1] = own[:-1] + own[1:], next_[1:-1]
        rates[1:-1] = half[:-1] + half[1:]
        rates = solveh_banded(band, rates)
    twist = (length / stiff) + (rates[:-1] + rates[1:] - 2.0 / stiff) * half
    cuts = np.cumsum([0, *map(len, run)])
    free = length / stiff
    return [float(free[a:b].sum() / twist[a:b].sum()) for a, b in pairwise(cuts)]
