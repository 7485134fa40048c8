"""Count freedoms before solving: what the loops leave free, and whether drives and supports hold exactly that."""

from __future__ import annotations

import contextlib
from typing import NamedTuple

import numpy as np

from ksd.bodies.joint_poses import joint_poses
from ksd.bodies.joints import JointBodies
from ksd.bodies.kinematics import loop_equations
from ksd.errors import KinematicsError
from ksd.model.compile import Model

RANK = 1e-4
"""Singular values below this fraction of the largest count as zero: what the fitted functions, and their independence of
thickness and material, make of the redundant equations of an overconstrained mechanism. Measured: two equal guides, or
two of different families at four times the trained thickness, 5.6e-6; two pivots of different families on one axis 5e-9;
planar loops below 1e-16. The smallest that is a real constraint in the shipped scenes is 4e-2 (the delta stage)."""
LOOSE = 0.03
"""The same for what holds only because joints are not aligned: a millirad between two guides makes 7e-4."""
_AXES = ("x", "y", "z")


def _jacobian(bodies: JointBodies, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Loop and row Jacobian J (E, motions) at theta, and the twists of all nodes W (nodes, motions, 6)."""
    arrays, loops = bodies.reduced, bodies.kinematics
    rows = 6 * len(loops.closing) + len(arrays.terms.start)
    motions = len(theta)
    J, residual = np.zeros((rows, motions)), np.zeros(rows)
    W = np.zeros((len(arrays.start), motions, 6))
    place, series = np.zeros((len(loops.node), 24)), np.zeros((3, loops.pose.shape[2]))
    target, reach = np.zeros(len(arrays.terms.start)), np.zeros((2, len(arrays.start)), np.int64)
    x, R = bodies.reduced_rest.x.copy(), bodies.reduced_rest.R.copy()
    joint_poses(*loops.flat, theta, place, series)
    frames, slope = np.zeros((4, 4, 3)), np.zeros((8, 3))
    loop_equations(
        *arrays.flat[:2], *loops.flat, target, x, R, place, reach, W, J, residual, frames, slope
    )  # fmt: skip
    return J, W


def _null_space(J: np.ndarray) -> np.ndarray:
    """Columns spanning the null space of J (E, q): what it does to them is below RANK of its largest."""
    return _null_spaces(J, RANK)[0]


def _null_spaces(J: np.ndarray, *ranks: float) -> list[np.ndarray]:
    """Of every one of `ranks`, columns spanning what J (E, q) takes below it of its largest."""
    rows, motions = J.shape
    if rows == 0 or motions == 1:
        # of one motion the only singular value is the largest
        return [np.eye(motions)[:, int(rows > 0 and J.any()) :]] * len(ranks)
    _, values, vt = np.linalg.svd(J, full_matrices=rows < motions)
    s = values.tolist()
    return [vt[sum(value > rank * max(s[0], 1e-300) for value in s) :].T for rank in ranks]


def describe_motion(model: Model, twist: np.ndarray) -> str:
    """Words for the motion (links, 6) that moves most: which link, turning or sliding, about which axis."""
    size = model.arrays.size
    amount = np.linalg.norm(twist[:, :3], axis=1) + size * np.linalg.norm(twist[:, 3:], axis=1)
    link = int(np.argmax(amount))
    turn = size * np.abs(twist[link, 3:])
    slide = np.abs(twist[link, :3])
    name = model.node_names[link]
    if turn.max() >= 0.5 * slide.max():
        return f"link '{name}' can turn about {_AXES[int(np.argmax(turn))]}"
    return f"link '{name}' can slide along {_AXES[int(np.argmax(slide))]}"


class MotionCompatibility(NamedTuple):
    """How well intended motions alone fit together.

    off: how far the joints of closed loops contradict each other for lack of alignment, over the largest of their
    equations (about rad); 0 where they are aligned. yielding: drives and supports that no intended motion can meet. In
    both cases step 1 finds the best compromise, and the leaf springs take up the rest from step 3 on.
    """

    misalignment: float = 0.0
    unmet_drives: tuple[str, ...] = ()

    @property
    def is_exact(self) -> bool:
        """Whether intended motions alone close every loop and meet every drive."""
        return not self.misalignment and not self.unmet_drives


def check_mobility(model: Model, bodies: JointBodies) -> MotionCompatibility:
    """How loops, drives and supports fit together; KinematicsError, saying which, where drives and supports do not hold
    every freedom exactly once.

    Judged at rest; a drive that has no effect at rest only because the pose is singular (dead centre) is named so. A
    mechanism that misalignment locks is judged as if it were aligned.
    """
    theta = np.zeros(len(bodies.motion_names))
    J, W = _jacobian(bodies, theta)
    loops = 6 * len(bodies.kinematics.closing)
    free, loose = _null_spaces(J[:loops], RANK, LOOSE)
    try:
        fit = MotionCompatibility(0.0, _unmet_drives(model, J, W, loops, free))
    except KinematicsError:
        if loose.shape[1] == free.shape[1]:
            raise
        return MotionCompatibility(_misalignment(J[:loops]), _unmet_drives(model, J, W, loops, loose))
    if fit.unmet_drives and loose.shape[1] > free.shape[1]:
        with contextlib.suppress(KinematicsError):
            other = MotionCompatibility(_misalignment(J[:loops]), _unmet_drives(model, J, W, loops, loose))
            fit = other if len(other.unmet_drives) < len(fit.unmet_drives) else fit
    return fit


def _misalignment(J: np.ndarray) -> float:
    """Largest contradiction of the loops (E, q) that is small enough to be misalignment, over their largest entry."""
    s = np.linalg.svd(J, compute_uv=False)
    return float(s[s < LOOSE * s[0]].max() / s[0])


def _unmet_drives(
    model: Model, J: np.ndarray, W: np.ndarray, loops: int, free: np.ndarray
) -> tuple[str, ...]:
    """Drives and supports that move nothing, where the others hold the freedoms `free` (q, f) exactly once."""
    held = J[loops:] @ free
    names = (*model.drive_names, *model.support_names)
    scale = RANK * np.abs(J).max(initial=1e-300)
    idle = [all(abs(moved) < scale for moved in row) for row in held.tolist()]
    left = _null_space(held) if free.shape[1] else free
    if any(idle) and (left.shape[1] or not free.shape[1]):
        name = names[idle.index(True)]
        raise KinematicsError(
            f"drive '{name}' moves nothing: no intended motion of the joints changes it at rest; drive another "
            "component, or start from a pose that is not a dead centre"
        )
    if left.shape[1]:
        twist = np.einsum("kqr,q->kr", W, free @ left[:, 0])
        raise KinematicsError(
            f"the mechanism is kinematically indeterminate: {describe_motion(model, twist)} although every drive is "
            f"held ({free.shape[1]} freedoms, {len(names)} drives and supports); add a drive or a support"
        )
    if len(names) - sum(idle) > free.shape[1]:
        rest = [k for k, none in enumerate(idle) if not none]
        pair = _dependent(held[rest], tuple(names[k] for k in rest))
        raise KinematicsError(
            f"drives {pair} act on the same freedom: the joints leave {free.shape[1]}, the scene prescribes "
            f"{len(rest)}; remove one of them or use method='conventional'"
        )
    return tuple(n for n, none in zip(names, idle, strict=True) if none)


def _dependent(rows: np.ndarray, names: tuple[str, ...]) -> str:
    """Names of the rows that take part in the strongest linear dependence."""
    _, _, vt = np.linalg.svd(rows.T)
    weight = np.abs(vt[-1])
    found = [n for n, w in zip(names, weight, strict=True) if w > 0.1 * weight.max()]
    return " and ".join(f"'{n}'" for n in found)
