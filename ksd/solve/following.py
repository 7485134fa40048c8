"""Stability with following loads, whose tangent is not symmetric: its inertia, the count of negative pivots, says nothing.

A state under such loads is left in one of two ways (Bolotin, Nonconservative Problems of the Theory of Elastic Stability,
1963). Divergence, slowly: a real negative eigenvalue of the tangent A on the motions that drives and supports leave, counted
here with displacements over the size of the mechanism as a measure. Flutter, in growing oscillations: a pair of complex
eigenvalues of A beside the mass, which `ksd.properties.frequencies` finds where something has mass.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ksd.errors import SceneError
from ksd.model.arrays import Arrays, Motion, make_work
from ksd.model.compile import Model
from ksd.model.system import assemble
from ksd.properties.frequencies import frequencies
from ksd.properties.tangent import exact, stored_matrix
from ksd.properties.turning import turning_loads
from ksd.solve.newton import GRAIN

Array = NDArray[np.float64]
REAL = 1e-9
"""Imaginary part of an eigenvalue, over its size, below which it is real."""


def follows(model: Model) -> bool:
    """Whether a load turns with its link."""
    following = model.arrays.loads.following
    return len(following) > 0 and bool(np.any(following == 1))


def keeps_still(model: Model, motion: Motion, load_factor: float) -> tuple[bool, str]:
    """Whether a state that following loads do not leave slowly is not left in growing oscillations either, in words."""
    still = "stable: no slow motion leaves it"
    try:
        modes = frequencies(model, motion, count=8, load_factor=load_factor)
    except SceneError:
        return True, f"{still}; loads follow and nothing has mass, so flutter was not looked at"
    worst = int(np.argmax(modes.growth_per_s))
    if modes.growth_per_s[worst] > 0.0:
        said = f"{modes.frequency_Hz[worst]:.3g} Hz, growing by {modes.growth_per_s[worst]:.3g} per second"
        return False, f"UNSTABLE: FLUTTER under loads that follow, at {said} (without damping)"
    return True, f"{still}, and no mode of its masses flutters (without damping)"


def divergences(arrays: Arrays, K: Array, rest: Array) -> int:
    """Real negative eigenvalues of the tangent K + rest (n, n) on the motions that the constraint rows leave, and one for
    every row, as the inertia of K counts them. K: symmetric, multipliers included; rest: of the following loads."""
    from scipy.linalg import null_space

    rows = arrays.terms.start
    unit = np.ones(len(K))
    for u in (int(s) for s in arrays.start if s >= 0):
        unit[u : u + 3] = arrays.size
    scaled = (K + rest) * np.outer(unit, unit)
    free = np.setdiff1d(np.arange(len(K)), rows)
    A = scaled[np.ix_(free, free)]
    if len(rows):
        C = scaled[np.ix_(rows, free)]
        Z = null_space(C / np.linalg.norm(C, axis=1, keepdims=True))
        A = Z.T @ A @ Z
    values = np.linalg.eigvals(A) if A.size else np.zeros(0)
    negative = (values.real < 0.0) & (np.abs(values.imag) <= REAL * np.abs(values))
    return len(rows) + int(negative.sum())


def counted(model: Model, motion: Motion, factor: float, negatives: int) -> int:
    """The negative pivots of a state, or, where loads follow, what stands for them: see `divergences`."""
    if not follows(model):
        return negatives
    arrays = exact(model.arrays)
    work = make_work(arrays)
    _, _, inside, _ = assemble(
        arrays, motion, np.zeros(len(arrays.terms.start)), factor, work, 1e-8, 0, GRAIN
    )
    rest = turning_loads(arrays, motion, factor)
    assert rest is not None
    return divergences(arrays, stored_matrix(arrays, work.value), rest) + int(inside)
