"""Stability under loads that are not conservative, of which no count of pivots tells: loads that follow, moments in space.

A state under such loads is left in one of two ways (Bolotin, Nonconservative Problems of the Theory of Elastic Stability,
1963). Divergence, slowly: a real negative eigenvalue of the tangent A = K + S, K its symmetric and S its skew part, on the
motions that drives and supports leave. Flutter, in growing oscillations: a pair of complex eigenvalues of A beside the mass,
which `ksd.properties.frequencies` finds where something has mass.

Where K is positive definite there, all eigenvalues have positive real parts, whatever S is: nothing diverges. And with rho
the largest |x* S x| / x* K x, those of A x = omega^2 M x are within the angle rho of the real axis, so that a mode grows by
no more than rho omega / 2, which a damping ratio of rho / 2 takes away.
"""

from __future__ import annotations

import numpy as np

from ksd.errors import KinematicsError, SceneError
from ksd.model.arrays import Motion, make_work
from ksd.model.compile import Model
from ksd.model.newton import GRAIN, assemble
from ksd.properties.frequencies import frequencies
from ksd.properties.nonconservative import count_negative_eigenvalues, skew_tangent
from ksd.properties.tangent import assemble_and_factor, exact_tangent_arrays, stored_matrix

MILD = 1e-3
"""Share rho of the skew part up to which flutter is left to damping: half of it, as a ratio, is less than flexures have."""


def keeps_still(model: Model, motion: Motion, load_factor: float) -> tuple[bool, str]:
    """Whether a state that loads which are not conservative do not leave slowly is not left in growing oscillations either,
    in words that name the criterion."""
    loads = "loads follow" if model.arrays.loads.following.any() else "moments are not conservative"
    try:
        tangent = assemble_and_factor(model, motion, load_factor=load_factor)
    except KinematicsError as reason:
        return False, f"NOT CERTAIN: {reason}"
    still = "stable: no slow motion leaves it"
    if tangent.unstable == 0:
        still += " (divergence; the symmetric part of the tangent is positive definite)"
        share = tangent.skew_share()
        if share <= MILD:
            return (
                True,
                f"{still}, and none that oscillates with a damping ratio above {0.5 * share:.1g} ({loads})",
            )
    else:
        still += " (divergence; no real negative eigenvalue of the unsymmetric tangent)"
    try:
        modes = frequencies(model, motion, count=8, load_factor=load_factor)
    except SceneError:
        return True, f"{still}; {loads} and nothing has mass, so flutter was not looked at"
    worst = int(np.argmax(modes.growth_per_s))
    if modes.growth_per_s[worst] > 0.0:
        if modes.omega_squared[worst] < 0.0:
            return False, f"UNSTABLE: it diverges by {modes.growth_per_s[worst]:.3g} per second"
        said = f"{modes.frequency_Hz[worst]:.3g} Hz, growing by {modes.growth_per_s[worst]:.3g} per second"
        return False, f"UNSTABLE: FLUTTER, as {loads}, at {said} (without damping)"
    return True, f"{still}, and no mode of its masses flutters (without damping; {loads})"


def counted(model: Model, motion: Motion, factor: float, negatives: int) -> int:
    """The negative pivots of a state, or, where loads are not conservative and the symmetric part of the tangent is not
    positive definite, what stands for them: see `count_negative_eigenvalues`."""
    if model.conservative or negatives == len(model.arrays.terms.start):
        return negatives
    arrays = exact_tangent_arrays(model)
    work = make_work(arrays)
    _, _, inside, _ = assemble(
        arrays, motion, np.zeros(len(arrays.terms.start)), factor, work, 1e-8, 0, GRAIN
    )
    rest = skew_tangent(arrays, motion, factor)
    assert rest is not None
    return count_negative_eigenvalues(arrays, stored_matrix(arrays, work.value), rest) + int(inside)
