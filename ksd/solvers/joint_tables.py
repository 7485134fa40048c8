"""Condensed joints tabulated over their stroke: a second level of reduction, with its own error figure.

Wrench and stiffness of a condensed joint are smooth functions of its intended motion. They are computed once on a grid and
interpolated by cubic splines; the error is measured half-way between all grid points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ksd.elements.linear import LINEAR_INNER
from ksd.errors import SceneError
from ksd.joints.joint_poses import joint_poses
from ksd.solvers.five_steps import (
    FiveStepsStorage,
    condense_joint_bodies,
    set_linearisation_point,
)

INITIAL_PIECES, MAX_PIECES = 32, 2048
"""Pieces of the splines at first, and at most."""
INTERPOLATION_TOLERANCE = 1e-6
"""Interpolation error below which the pieces are not halved again."""
_UPPER = np.triu_indices(6)


@dataclass(frozen=True)
class JointTables:
    """Tables of the joints of one design.

    cubic (T, pieces, 4, 27): coefficients, in rising powers, of wrench (6) and stiffness (21, upper triangle) within a
    piece, whose variable runs from 0 to 1; table (J,): number of every joint's table; limits (q, 2): trained ranges that
    they cover. error: largest interpolation error, of a stiffness relative to the geometric mean of its diagonal, of a
    wrench relative to its largest value.
    """

    cubic: np.ndarray
    table: np.ndarray
    limits: np.ndarray
    error: float

    def __str__(self) -> str:
        count, pieces = self.cubic.shape[:2]
        return f"{count} table{'s' * (count > 1)} of {pieces} pieces, interpolation error {self.error:.1e}"


def _sample_joints(b: FiveStepsStorage, shares: np.ndarray) -> np.ndarray:
    """Wrench and stiffness (N, J, 27) of all joints at `shares` (N,), 0 to 1, of their trained ranges."""
    low, high = b.bodies.motion_range.T
    joints = len(b.bodies.kinematics.node)
    condensed = np.empty((len(shares), joints, 42))
    for n, share in enumerate(shares):
        b.theta[:] = low + share * (high - low)
        joint_poses(*b.bodies.kinematics.flat, b.theta, b.joint_pose, b.series)
        set_linearisation_point(b)
        if condense_joint_bodies(b, 1) != 0:
            raise SceneError(
                "tabulated = True: a joint cannot be condensed over its whole trained range; leave it out"
            )
        condensed[n] = b.reduced_state.inner[: LINEAR_INNER * joints].reshape(joints, LINEAR_INNER)[:, 12:]
    matrix = condensed[:, :, 6:].reshape(*condensed.shape[:2], 6, 6)
    return np.concatenate([condensed[:, :, :6], matrix[:, :, _UPPER[0], _UPPER[1]]], axis=2)


def _interpolation_error(exact: np.ndarray, approximate: np.ndarray) -> float:
    """Largest difference of two arrays (N, J, 27), made relative as described in `JointTables`."""
    diagonal = exact[:, :, 6 + np.flatnonzero(_UPPER[0] == _UPPER[1])]
    scale = np.sqrt(np.abs(diagonal[:, :, _UPPER[0]] * diagonal[:, :, _UPPER[1]]))
    stiffness = np.abs(approximate - exact)[:, :, 6:] / np.maximum(scale, 1e-300)
    largest = np.abs(exact[:, :, :6]).max(axis=0)
    parts = [largest[:, :3].max(axis=1), largest[:, 3:].max(axis=1)]
    size = np.maximum(np.repeat(np.array(parts).T, 3, axis=1), 1e-300)
    wrench = np.abs(approximate - exact)[:, :, :6] / size
    return float(max(stiffness.max(initial=0.0), wrench.max(initial=0.0)))


def joint_tables(b: FiveStepsStorage) -> JointTables:
    """Tabulate all joints of a design, halving pieces until the error is within INTERPOLATION_TOLERANCE or pieces run out.

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
    values = _sample_joints(b, grid)
    while True:
        halves = grid[:-1] + 0.5 / pieces
        midpoints = _sample_joints(b, halves)
        spline = CubicSpline(grid, values, axis=0)
        error = _interpolation_error(midpoints, spline(halves))
        if error <= INTERPOLATION_TOLERANCE or pieces >= MAX_PIECES:
            break
        merged = np.empty((2 * pieces + 1, *values.shape[1:]))
        merged[::2], merged[1::2] = values, midpoints
        pieces *= 2
        grid, values = np.linspace(0.0, 1.0, pieces + 1), merged
    # scaled to a variable that runs from 0 to 1 within a piece
    power = (1.0 / pieces) ** np.arange(4)
    cubic = np.moveaxis(spline.c[::-1] * power[:, None, None, None], (2, 1, 0, 3), (0, 1, 2, 3))
    keys = [cubic[j].tobytes() for j in range(len(loops.node))]
    distinct = list(dict.fromkeys(keys))
    first = [keys.index(k) for k in distinct]
    table = np.array([distinct.index(k) for k in keys], np.int64)
    return JointTables(np.ascontiguousarray(cubic[first]), table, b.bodies.motion_range, error)
