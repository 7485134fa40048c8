"""Stability under non-conservative loads (follower loads, moments in space), which negative pivots alone do not decide.

A state under such loads loses stability in one of two ways (Bolotin, Nonconservative Problems of the Theory of Elastic
Stability, 1963). Divergence is a slow departure: a real negative eigenvalue of the tangent A = K + S, K its symmetric and S
its skew part, on the motions that drives and supports leave free. Flutter is a growing oscillation: a pair of complex
eigenvalues of A x = omega^2 M x, which `ksd.answers.frequencies` computes where something has mass.

Where K is positive definite, all eigenvalues have positive real parts for any S, so nothing diverges. With rho the largest
|x* S x| / x* K x, the eigenvalues of A x = omega^2 M x lie within the angle rho of the real axis, so that a mode grows by no
more than rho omega / 2, which a damping ratio of rho / 2 suppresses.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ksd.answers.frequencies import lowest_squares
from ksd.answers.nonconservative import (
    MAX_DAMPED_SKEW_SHARE,
    REAL_TOLERANCE,
    Array,
    count_negative_eigenvalues,
    skew_tangent,
)
from ksd.answers.tangent import assemble_and_factor, exact_tangent_arrays, stored_matrix
from ksd.errors import KinematicsError, SceneError
from ksd.model.arrays import LINEAR, SOLID, State, make_workspace
from ksd.model.compile import Model
from ksd.model.newton import assemble
from ksd.solvers.steps import Verdict

LOWEST_MODES = 8
"""Number of modes that are checked for flutter."""
ANY_DENSITY = 1000.0
"""Density [kg/m^3] of leaf springs without one where slow departures are counted."""


def is_divergence(squared: Array) -> NDArray[np.bool_]:
    """Whether modes with the complex omega^2 = squared depart slowly: real and negative."""
    return np.asarray((squared.real < 0.0) & (np.abs(squared.imag) <= REAL_TOLERANCE * np.abs(squared)))


def nonconservative_stability(model: Model, motion: State, load_factor: float) -> Verdict:
    """Flutter check of a state under non-conservative loads whose negative pivots show no divergence."""
    loads = "loads follow" if model.arrays.loads.following.any() else "moments are not conservative"
    try:
        tangent = assemble_and_factor(model, motion, load_factor=load_factor)
    except KinematicsError as reason:
        return Verdict(False, f"NOT CERTAIN: {reason}")
    stable = "stable: no slow motion leaves it"
    if tangent.unstable == 0:
        stable += " (divergence; the symmetric part of the tangent is positive definite)"
        share = tangent.skew_share()
        if share <= MAX_DAMPED_SKEW_SHARE:
            return Verdict(
                True,
                f"{stable}, and none that oscillates with a damping ratio above {0.5 * share:.1g} ({loads})",
            )
    else:
        stable += " (divergence; no real negative eigenvalue of the unsymmetric tangent)"
    try:
        squared = lowest_squares(model, motion, count=LOWEST_MODES, load_factor=load_factor)
    except SceneError:
        return Verdict(True, f"{stable}; {loads} and nothing has mass, so flutter was not checked")
    except KinematicsError as reason:
        return Verdict(False, f"NOT CERTAIN: {reason}")
    diverges = is_divergence(squared)
    if diverges.any():
        rate = np.sqrt(np.abs(squared[diverges]).max())
        return Verdict(False, f"UNSTABLE: it diverges by {rate:.3g} per second")
    # pairs count once; shapes of higher modes are those of the mesh
    omega = np.sqrt(squared[squared.imag >= -REAL_TOLERANCE * np.abs(squared)][:LOWEST_MODES])
    ratio = np.abs(omega.imag) / np.abs(omega)
    worst = int(np.argmax(np.abs(omega.imag) * (ratio > 0.5 * MAX_DAMPED_SKEW_SHARE)))
    if ratio[worst] > 0.5 * MAX_DAMPED_SKEW_SHARE:
        growth = (
            f"{omega[worst].real / (2 * np.pi):.3g} Hz, growing by {abs(omega[worst].imag):.3g} per second"
        )
        return Verdict(
            False,
            f"UNSTABLE: FLUTTER, as {loads}, at {growth} (without damping; a damping ratio of {ratio[worst]:.2g} stops it)",
        )
    return Verdict(
        True,
        f"{stable}, and no mode of its masses flutters (of the {len(omega)} lowest, with a damping ratio above "
        f"{0.5 * MAX_DAMPED_SKEW_SHARE:.1g}; {loads})",
    )


def count_unstable_directions(model: Model, motion: State, factor: float, negatives: int) -> int:
    """Negative pivots of a state, or, where loads are not conservative and the symmetric part of the tangent is not positive
    definite, the number of real negative omega^2 that takes their place.

    With all unknowns and in the metric of the mass this number is that of the leaf springs, not of their points and modes:
    of an unsymmetric tangent only the sign of the determinant is the same in every metric.

    factor: load factor; negatives: negative pivots of the symmetric part.
    """
    if model.conservative or negatives == len(model.arrays.terms.start):
        return negatives
    if model.kinds.isdisjoint((SOLID, LINEAR)):
        try:
            squared = lowest_squares(model, motion, load_factor=factor, without_density=ANY_DENSITY)
            return len(model.arrays.terms.start) + int(is_divergence(squared).sum())
        except (SceneError, KinematicsError):
            # chains that cannot be divided
            pass
    arrays = exact_tangent_arrays(model)
    work = make_workspace(arrays)
    _, _, member_negatives, _ = assemble(arrays, motion, np.zeros(len(arrays.terms.start)), factor, work)
    skew = skew_tangent(arrays, motion, factor)
    assert skew is not None
    return count_negative_eigenvalues(arrays, stored_matrix(arrays, work.matrix), skew) + int(
        member_negatives
    )
