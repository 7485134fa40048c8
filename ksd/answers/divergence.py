"""The number of directions in which a state under loads that are not conservative departs slowly (divergence).

With all unknowns and in the metric of the mass this number is that of the leaf springs, not of their points and modes: of an
unsymmetric tangent only the sign of the determinant is the same in every metric.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from ksd.answers.frequencies import lowest_squares
from ksd.answers.nonconservative import REAL_TOLERANCE, Array, count_negative_eigenvalues, skew_tangent
from ksd.answers.tangent import assemble_tangent
from ksd.errors import KinematicsError, SceneError
from ksd.model.arrays import State
from ksd.model.compile import Model

ANY_DENSITY = 1000.0
"""Density [kg/m^3] of leaf springs without one where slow departures are counted."""

MAX_SQUARE_RATIO = 1e9
"""|omega^2| over the lowest one above which it is rounding: near the poles of a leaf bent to a whole turn by 2e12."""


def is_divergence(squared: Array) -> NDArray[np.bool_]:
    """Whether modes with the complex omega^2 = squared depart slowly: real and negative, and no rounding of 1/omega^2."""
    size = np.abs(squared)
    resolved = size <= MAX_SQUARE_RATIO * size.min(initial=np.inf)
    return np.asarray((squared.real < 0.0) & (np.abs(squared.imag) <= REAL_TOLERANCE * size) & resolved)


def count_unstable_directions(
    model: Model, motion: State, factor: float, negatives: int, *, freed: Iterable[str] = ()
) -> int:
    """Negative pivots of a state, or, where loads are not conservative and the symmetric part of the tangent is not positive
    definite, the number of real negative omega^2 that takes their place.

    factor: load factor; negatives: negative pivots of the symmetric part, one per constraint row included; freed: drives and
    supports released.
    """
    rows = len(model.arrays.terms.start)
    if model.conservative or negatives == rows:
        return negatives
    if not model.has_closed_bodies:
        try:
            squared = lowest_squares(
                model, motion, freed=freed, load_factor=factor, without_density=ANY_DENSITY
            )
            return rows + int(is_divergence(squared).sum())
        except (SceneError, KinematicsError):
            # chains that cannot be divided
            pass
    assembled = assemble_tangent(model, motion, load_factor=factor)
    skew = skew_tangent(assembled.arrays, motion, factor, assembled.work)
    assert skew is not None
    return assembled.inner_negatives + count_negative_eigenvalues(
        assembled.arrays, assembled.matrix(freed), skew
    )
