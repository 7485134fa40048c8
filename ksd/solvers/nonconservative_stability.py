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

from ksd.answers.divergence import is_divergence
from ksd.answers.frequencies import lowest_squares
from ksd.answers.nonconservative import (
    MAX_DAMPED_SKEW_SHARE,
    REAL_TOLERANCE,
)
from ksd.answers.tangent import assemble_and_factor
from ksd.errors import KinematicsError, SceneError
from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.solvers.steps import Verdict

LOWEST_MODES = 8
"""Number of modes that are checked for flutter."""


def nonconservative_stability(model: Model, motion: State, load_factor: float) -> Verdict:
    """Flutter check of a state under non-conservative loads whose negative pivots show no divergence."""
    follow = model.arrays.loads.following.any() or len(model.arrays.under_pressure)
    loads = "loads follow" if follow else "moments are not conservative"
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
