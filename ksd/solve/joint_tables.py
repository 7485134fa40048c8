"""Condensed joints tabulated over their stroke: a second level of reduction, with its own error figure.

Step 2 gives the wrench and the stiffness of a joint at any intended motion; both are smooth in it. They are computed
once on a grid and interpolated by cubic splines; the error is measured half-way between all grid points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ksd.bodies.joint_poses import joint_poses
from ksd.errors import SceneError
from ksd.solve.five_steps import LINEAR_SIZE, FiveStepsStorage, condense_joint_bodies, set_linearisation_point
from ksd.solve.pose_batch import NUMBERS_PER_JOINT

INITIAL_PIECES, MAX_PIECES = 32, 2048
"""Pieces tried first, and most."""
INTERPOLATION_TOLERANCE = 1e-6
"""Interpolation error below which there are pieces enough."""
_UPPER = np.triu_indices(6)


@dataclass(frozen=True)
class JointTables:
    """Tables of the joints of one design.

    cubic (T, pieces, 4, 27): coefficients, rising powers, of wrench (6) and stiffness (21, upper triangle) within a
    piece; which (J,): table of every joint; limits (q, 2): trained ranges they cover. error: largest interpolation
    error, of a stiffness relative to the geometric mean of its diagonal, of a wrench relative to its largest value.
    """

    cubic: np.ndarray
    which: np.ndarray
    limits: np.ndarray
    error: float

    def __str__(self) -> str:
        count, pieces = self.cubic.shape[:2]
        return f"{count} table{'s' * (count > 1)} of {pieces} pieces, interpolation error {self.error:.1e}"


def _sampled(b: FiveStepsStorage, shares: np.ndarray) -> np.ndarray:
    """(N, J, 27): all joints at `shares` (N,) of their trained ranges."""
    low, high = b.bodies.motion_range.T
    joints = len(b.bodies.kinematics.node)
    found = np.empty((len(shares), joints, 42))
    for n, share in enumerate(shares):
        b.theta[:] = low + share * (high - low)
        joint_poses(*b.bodies.kinematics.flat, b.theta, b.place, b.series)
        set_linearisation_point(b)
        if condense_joint_bodies(b, 1) != 0:
            raise SceneError(
                "tabulated = True: a joint cannot be condensed over its whole trained range; leave it out"
            )
        found[n] = b.reduced.inner[: LINEAR_SIZE * joints].reshape(joints, LINEAR_SIZE)[:, 12:]
    matrix = found[:, :, 6:].reshape(*found.shape[:2], 6, 6)
    return np.concatenate([found[:, :, :6], matrix[:, :, _UPPER[0], _UPPER[1]]], axis=2)


def _error(exact: np.ndarray, near: np.ndarray) -> float:
    """Largest difference of two (N, J, 27), each number relative to what it counts by."""
    diagonal = exact[:, :, 6 + np.flatnonzero(_UPPER[0] == _UPPER[1])]
    scale = np.sqrt(np.abs(diagonal[:, :, _UPPER[0]] * diagonal[:, :, _UPPER[1]]))
    stiffness = np.abs(near - exact)[:, :, 6:] / np.maximum(scale, 1e-300)
    most = np.abs(exact[:, :, :6]).max(axis=0)
    parts = [most[:, :3].max(axis=1), most[:, 3:].max(axis=1)]
    size = np.maximum(np.repeat(np.array(parts).T, 3, axis=1), 1e-300)
    wrench = np.abs(near - exact)[:, :, :6] / size
    return float(max(stiffness.max(initial=0.0), wrench.max(initial=0.0)))


def joint_tables(b: FiveStepsStorage) -> JointTables:
    """Tables of all joints of a design, refined until the interpolation error is below ACCURACY or pieces run out.

    Raises SceneError for joints of more than one intended motion, and for leaf springs with weight.
    """
    from scipy.interpolate import CubicSpline

    loops = b.bodies.kinematics
    if np.any(np.diff(loops.first) != 1):
        raise SceneError(
            "tabulated = True: only joints of one intended motion can be tabulated; leave it out"
        )
    if len(b.bodies.joint_weights.owner):
        raise SceneError(
            "tabulated = True: joints whose leaves have weight depend on how they stand, not on the stroke alone; leave it "
            "out, or compile without='gravity'"
        )
    pieces = INITIAL_PIECES
    grid = np.linspace(0.0, 1.0, pieces + 1)
    values = _sampled(b, grid)
    while True:
        halves = grid[:-1] + 0.5 / pieces
        between = _sampled(b, halves)
        spline = CubicSpline(grid, values, axis=0)
        error = _error(between, spline(halves))
        if error <= INTERPOLATION_TOLERANCE or pieces >= MAX_PIECES:
            break
        merged = np.empty((2 * pieces + 1, *values.shape[1:]))
        merged[::2], merged[1::2] = values, between
        pieces *= 2
        grid, values = np.linspace(0.0, 1.0, pieces + 1), merged
    # within a piece the variable runs from 0 to 1
    power = (1.0 / pieces) ** np.arange(4)
    cubic = np.moveaxis(spline.c[::-1] * power[:, None, None, None], (2, 1, 0, 3), (0, 1, 2, 3))
    keys = [cubic[j].tobytes() for j in range(len(loops.node))]
    distinct = list(dict.fromkeys(keys))
    first = [keys.index(k) for k in distinct]
    assert cubic.shape[-1] == NUMBERS_PER_JOINT
    which = np.array([distinct.index(k) for k in keys], np.int64)
    return JointTables(np.ascontiguousarray(cubic[first]), which, b.bodies.motion_range, error)
