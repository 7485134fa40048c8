"""Mobility of a mechanism before it is solved: whether drives and supports prescribe exactly what its loops leave free."""

from __future__ import annotations

import contextlib
from typing import NamedTuple

import numpy as np

from ksd.errors import KinematicsError
from ksd.joints.joints import JointBodies
from ksd.joints.kinematics import loop_equations_at
from ksd.model.compile import Model

RANK_TOLERANCE = 1e-4
"""Singular values below this fraction of the largest count as zero.

Redundant equations of an overconstrained mechanism leave small ones, since the functions are fitted, and taken as
independent of thickness and material. Measured: two equal guides, or two of different families at four times the
trained thickness, 5.6e-6; two pivots of different families on one axis 5e-9; planar loops below 1e-16. The smallest of
a real constraint in the shipped scenes is 4e-2 (the delta stage).
"""
MISALIGNMENT_TOLERANCE = 0.03
"""Singular values below this fraction of the largest may be due to misaligned joints: a millirad between two guides
gives 7e-4."""
_AXES = ("x", "y", "z")


def _jacobian(bodies: JointBodies, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Jacobian J (E, motions) of loops and constraint rows at theta, and the twists W (nodes, motions, 6) of all nodes."""
    arrays, kinematics = bodies.reduced, bodies.kinematics
    (x, R, _, target, angle) = bodies.reduced_rest.copy()
    pose = np.zeros((len(kinematics.node), 24))
    _, J, W = loop_equations_at(*arrays.flat[:2], *kinematics.flat, theta, target, x, R, angle, pose)
    return J, W


def _null_spaces(J: np.ndarray, *tolerances: float) -> list[np.ndarray]:
    """Null spaces of J (E, q) as orthonormal columns, one for every tolerance: singular values below it times the
    largest count as zero."""
    rows, motions = J.shape
    if rows == 0 or motions == 1:
        # with one motion the only singular value is the largest
        return [np.eye(motions)[:, int(rows > 0 and J.any()) :]] * len(tolerances)
    _, values, vt = np.linalg.svd(J, full_matrices=rows < motions)
    s = values.tolist()
    return [vt[sum(value > tolerance * max(s[0], 1e-300) for value in s) :].T for tolerance in tolerances]


def describe_motion(model: Model, twist: np.ndarray) -> str:
    """Description of a motion, twist (links, 6): the link that moves most, and its main rotation or translation."""
    length = model.arrays.size
    amount = np.linalg.norm(twist[:, :3], axis=1) + length * np.linalg.norm(twist[:, 3:], axis=1)
    link = int(np.argmax(amount))
    rotation = length * np.abs(twist[link, 3:])
    translation = np.abs(twist[link, :3])
    name = model.node_names[link]
    if rotation.max() >= 0.5 * translation.max():
        return f"link '{name}' can turn about {_AXES[int(np.argmax(rotation))]}"
    return f"link '{name}' can slide along {_AXES[int(np.argmax(translation))]}"


class MotionCompatibility(NamedTuple):
    """Whether the joints can meet all loops, drives and supports by intended motions alone.

    misalignment: largest singular value of the loop equations that is due to misaligned joints, over the largest of all
    (about rad); 0 where the joints are aligned. unmet_drives: drives and supports that no intended motion can meet. In
    both cases step 1 finds a least-squares compromise, and the leaf springs take up the rest from step 3 on.
    """

    misalignment: float = 0.0
    unmet_drives: tuple[str, ...] = ()

    @property
    def is_exact(self) -> bool:
        """Whether intended motions alone close every loop and meet every drive."""
        return not self.misalignment and not self.unmet_drives


def check_mobility(model: Model, bodies: JointBodies) -> MotionCompatibility:
    """Check that drives and supports prescribe every degree of freedom of the joints exactly once, at rest.

    A drive without effect at rest because the pose is singular (dead centre) is reported as such. A mechanism locked by
    misalignment only is checked as if it were aligned. Raises KinematicsError for an under-constrained or
    overconstrained mechanism, naming the link or the drives, and for elastic links, whose parts no joint connects.
    """
    for compliance in model.original_scene.compliances:
        if not {f"{compliance.link}/{n}" for n in (1, 2)}.isdisjoint(model.scene.links):
            raise KinematicsError(
                f"link '{compliance.link}' is elastic, and the kinematic start moves rigid links only; use "
                "method='conventional'"
            )
    theta = np.zeros(len(bodies.motion_names))
    J, W = _jacobian(bodies, theta)
    loop_rows = 6 * len(bodies.kinematics.closing)
    free, free_if_aligned = _null_spaces(J[:loop_rows], RANK_TOLERANCE, MISALIGNMENT_TOLERANCE)
    try:
        compatibility = MotionCompatibility(0.0, _unmet_drives(model, J, W, loop_rows, free))
    except KinematicsError:
        if free_if_aligned.shape[1] == free.shape[1]:
            raise
        return MotionCompatibility(
            _misalignment(J[:loop_rows]), _unmet_drives(model, J, W, loop_rows, free_if_aligned)
        )
    if compatibility.unmet_drives and free_if_aligned.shape[1] > free.shape[1]:
        with contextlib.suppress(KinematicsError):
            aligned = MotionCompatibility(
                _misalignment(J[:loop_rows]), _unmet_drives(model, J, W, loop_rows, free_if_aligned)
            )
            compatibility = (
                aligned if len(aligned.unmet_drives) < len(compatibility.unmet_drives) else compatibility
            )
    return compatibility


def _misalignment(J: np.ndarray) -> float:
    """Largest singular value of the loop equations (E, q) below MISALIGNMENT_TOLERANCE, over the largest of all."""
    s = np.linalg.svd(J, compute_uv=False)
    return float(s[s < MISALIGNMENT_TOLERANCE * s[0]].max() / s[0])


def _unmet_drives(
    model: Model, J: np.ndarray, W: np.ndarray, loop_rows: int, free: np.ndarray
) -> tuple[str, ...]:
    """Drives and supports that move nothing, where the others prescribe the degrees of freedom `free` (q, f) exactly
    once.

    Raises KinematicsError otherwise.
    """
    constraint = J[loop_rows:] @ free
    names = (*model.drive_names, *model.support_names)
    scale = RANK_TOLERANCE * np.abs(J).max(initial=1e-300)
    is_idle = [all(abs(moved) < scale for moved in row) for row in constraint.tolist()]
    undetermined = _null_spaces(constraint, RANK_TOLERANCE)[0] if free.shape[1] else free
    if any(is_idle) and (undetermined.shape[1] or not free.shape[1]):
        name = names[is_idle.index(True)]
        raise KinematicsError(
            f"drive '{name}' moves nothing: no intended motion of the joints changes it at rest; drive another "
            "component, or start from a pose that is no singular position (dead centre)"
        )
    if undetermined.shape[1]:
        twist = np.einsum("kqr,q->kr", W, free @ undetermined[:, 0])
        raise KinematicsError(
            f"the mechanism is kinematically indeterminate: {describe_motion(model, twist)} although every drive is "
            f"held ({free.shape[1]} freedoms, {len(names)} drives and supports); add a drive or a support"
        )
    if len(names) - sum(is_idle) > free.shape[1]:
        rest = [k for k, none in enumerate(is_idle) if not none]
        pair = _dependent_rows(constraint[rest], tuple(names[k] for k in rest))
        raise KinematicsError(
            f"drives {pair} act on the same freedom: the joints leave {free.shape[1]}, the scene prescribes "
            f"{len(rest)}; remove one of them or use method='conventional'"
        )
    return tuple(n for n, none in zip(names, is_idle, strict=True) if none)


def _dependent_rows(rows: np.ndarray, names: tuple[str, ...]) -> str:
    """Names of the rows that take part in the strongest linear dependence, in words."""
    _, _, vt = np.linalg.svd(rows.T)
    weight = np.abs(vt[-1])
    names_found = [n for n, w in zip(names, weight, strict=True) if w > 0.1 * weight.max()]
    return " and ".join(f"'{n}'" for n in names_found)
