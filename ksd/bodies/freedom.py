"""Count freedoms before solving: what the loops leave free, and whether drives and supports hold exactly that."""

from __future__ import annotations

import numpy as np

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
    arrays, loops = bodies.reduced, bodies.loops
    rows = 6 * len(loops.closing) + len(arrays.terms.start)
    motions = len(theta)
    J, residual = np.zeros((rows, motions)), np.zeros(rows)
    W = np.zeros((len(arrays.start), motions, 6))
    place = np.zeros((len(loops.node), 24))
    target = np.zeros(len(arrays.terms.start))
    loop_equations(arrays, loops, theta, target, bodies.reduced_rest.copy(), place, W, J, residual)
    return J, W


def _null_space(J: np.ndarray, rank: float = RANK) -> np.ndarray:
    """Columns spanning the null space of J (E, q): what it does to them is below `rank` of its largest."""
    if J.shape[0] == 0:
        return np.eye(J.shape[1])
    _, s, vt = np.linalg.svd(J)
    held = int(np.sum(s > rank * max(s[0], 1e-300)))
    return vt[held:].T


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


def freedoms(model: Model, bodies: JointBodies) -> int:
    """How many freedoms the joints leave to the mechanism, at rest."""
    J, _ = _jacobian(bodies, np.zeros(len(bodies.motion_names)))
    return _null_space(J[: 6 * len(bodies.loops.closing)]).shape[1]


def check_freedoms(model: Model, bodies: JointBodies) -> None:
    """Raise KinematicsError where drives and supports do not hold every freedom exactly once, and say which.

    Judged at rest; a drive that has no effect at rest only because the pose is singular (dead centre) is named so.
    """
    theta = np.zeros(len(bodies.motion_names))
    J, W = _jacobian(bodies, theta)
    loops = 6 * len(bodies.loops.closing)
    free = _null_space(J[:loops])
    held = J[loops:] @ free
    names = (*model.drive_names, *model.support_names)
    scale = np.abs(J).max(initial=1e-300)
    for name, row in zip(names, held, strict=True):
        if np.abs(row).max(initial=0.0) < RANK * scale:
            _refuse_misaligned(J[:loops], free.shape[1])
            raise KinematicsError(
                f"drive '{name}' moves nothing: no intended motion of the joints changes it at rest; drive another "
                "component, or start from a pose that is not a dead centre"
            )
    left = free @ _null_space(held) if free.shape[1] else free
    if left.shape[1]:
        twist = np.einsum("kqr,q->kr", W, left[:, 0])
        raise KinematicsError(
            f"the mechanism is kinematically indeterminate: {describe_motion(model, twist)} although every drive is "
            f"held ({free.shape[1]} freedoms, {len(names)} drives and supports); add a drive or a support"
        )
    if len(names) > free.shape[1]:
        _refuse_misaligned(J[:loops], free.shape[1])
        pair = _dependent(held, names)
        raise KinematicsError(
            f"drives {pair} act on the same freedom: the joints leave {free.shape[1]}, the scene prescribes "
            f"{len(names)}; remove one of them or use method='conventional'"
        )


def _refuse_misaligned(J: np.ndarray, free: int) -> None:
    """Raise KinematicsError where closed loops leave fewer freedoms than they would if their joints were aligned; asked
    only of what cannot be solved anyway, as short levers look alike."""
    loose = _null_space(J, LOOSE).shape[1] if len(J) else free
    if loose > free:
        _, s, _ = np.linalg.svd(J)
        off = s[s > RANK * s[0]].min() / s[0]
        raise KinematicsError(
            f"the mechanism is overconstrained and its joints are not aligned: their intended motions contradict each other "
            f"by {off:.1e} rad (or parts of a length), so without elasticity it locks with {free} of {loose} freedoms; "
            "align the joints, or use method='conventional', which lets the leafs yield and reports their stress"
        )


def _dependent(rows: np.ndarray, names: tuple[str, ...]) -> str:
    """Names of the rows that take part in the strongest linear dependence."""
    _, _, vt = np.linalg.svd(rows.T)
    weight = np.abs(vt[-1])
    found = [n for n, w in zip(names, weight, strict=True) if w > 0.1 * weight.max()]
    return " and ".join(f"'{n}'" for n in found)
