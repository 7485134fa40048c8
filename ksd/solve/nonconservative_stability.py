"""Stability under non-conservative loads (follower loads, moments in space), which negative pivots alone do not decide.

A state under such loads loses stability in one of two ways (Bolotin, Nonconservative Problems of the Theory of Elastic
Stability, 1963). Divergence is a slow departure: a real negative eigenvalue of the tangent A = K + S, K its symmetric and S
its skew part, on the motions that drives and supports leave free. Flutter is a growing oscillation: a pair of complex
eigenvalues of A x = omega^2 M x, which `ksd.properties.frequencies` computes where something has mass.

Where K is positive definite, all eigenvalues have positive real parts for any S, so nothing diverges. With rho the largest
|x* S x| / x* K x, the eigenvalues of A x = omega^2 M x lie within the angle rho of the real axis, so that a mode grows by no
more than rho omega / 2, which a damping ratio of rho / 2 suppresses.
"""

from __future__ import annotations

import numpy as np

from ksd.errors import KinematicsError, SceneError
from ksd.model.arrays import State, make_workspace
from ksd.model.compile import Model
from ksd.model.newton import assemble
from ksd.properties.frequencies import frequencies
from ksd.properties.nonconservative import MAX_DAMPED_SKEW_SHARE, count_negative_eigenvalues, skew_tangent
from ksd.properties.tangent import assemble_and_factor, exact_tangent_arrays, stored_matrix
from ksd.solve.steps import Verdict


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
        modes = frequencies(model, motion, count=8, load_factor=load_factor)
    except SceneError:
        return Verdict(True, f"{stable}; {loads} and nothing has mass, so flutter was not checked")
    worst = int(np.argmax(modes.growth_per_s))
    if modes.growth_per_s[worst] > 0.0:
        if modes.omega_squared[worst] < 0.0:
            return Verdict(False, f"UNSTABLE: it diverges by {modes.growth_per_s[worst]:.3g} per second")
        growth = f"{modes.frequency_Hz[worst]:.3g} Hz, growing by {modes.growth_per_s[worst]:.3g} per second"
        return Verdict(False, f"UNSTABLE: FLUTTER, as {loads}, at {growth} (without damping)")
    return Verdict(True, f"{stable}, and no mode of its masses flutters (without damping; {loads})")


def count_unstable_directions(model: Model, motion: State, factor: float, negatives: int) -> int:
    """Negative pivots of a state, or, where loads are not conservative and the symmetric part of the tangent is not positive
    definite, the number of real negative eigenvalues that takes their place (`count_negative_eigenvalues`).

    factor: load factor; negatives: negative pivots of the symmetric part.
    """
    if model.conservative or negatives == len(model.arrays.terms.start):
        return negatives
    arrays = exact_tangent_arrays(model)
    work = make_workspace(arrays)
    _, _, member_negatives, _ = assemble(arrays, motion, np.zeros(len(arrays.terms.start)), factor, work)
    skew = skew_tangent(arrays, motion, factor)
    assert skew is not None
    return count_negative_eigenvalues(arrays, stored_matrix(arrays, work.matrix), skew) + int(
        member_negatives
    )
