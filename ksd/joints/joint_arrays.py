"""Arrays of the joints of a model: their kinematics, and the database functions of their internal states.

Kernels take two flat arrays in place of many, as for `ksd.model.arrays.Arrays`: `joint_ints` and `geometry` of a
`JointKinematics`, `interior_ints` and `interior_floats` of an `InteriorFunctions`. Entry c of row i of a field F with w
columns is ints[ints[F] + w i + c] for integers and floats[ints[F] + w i + c] otherwise.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np

from ksd.model.arrays import join_fields
from ksd.model.template import fields_of_design


class FlatFields(NamedTuple):
    """All fields of a tuple in two arrays, see `ksd.model.arrays.join_fields`."""

    ints: np.ndarray
    floats: np.ndarray


class JointKinematicsFields(NamedTuple):
    """Kinematics of J joints between nodes (0 ground, links 1..), all polynomials contracted at the shape of each
    joint.

    node (J, 2): nodes of interfaces A and B; anchor (J, 2, 3): interface points A and B at rest from the reference
    points of their nodes [m]; frame (J, 3, 3): joint axes at rest; length (J,) [m]; first (J+1,): joint j has the
    motions theta[first[j]:first[j+1]]; tree (T, 2): joints of the spanning tree, each with 1 where it leads from A to
    B; closing (C,): joints that close loops; power_first (J+1,), power (P, 2): exponents of the motions, rising; pose
    (J, 6, M): coefficients of the rotation vector and chord of interface B by monomial.
    """

    node: np.ndarray
    anchor: np.ndarray
    frame: np.ndarray
    length: np.ndarray
    first: np.ndarray
    tree: np.ndarray
    closing: np.ndarray
    power_first: np.ndarray
    power: np.ndarray
    pose: np.ndarray


class JointKinematics(JointKinematicsFields):
    """`JointKinematicsFields` with their flat form for kernels."""

    float_names = "anchor", "frame", "length", "pose"

    @cached_property
    def flat(self) -> FlatFields:
        """All fields of a single design in two arrays."""
        counts = len(self.node), len(self.tree), len(self.closing), self.pose.shape[2]
        return FlatFields(*join_fields(counts, self))

    @cached_property
    def joined(self) -> FlatFields:
        """`flat` of D designs: integers of one, floats (D, f)."""
        return _join_designs(self)


JOINT_COUNT, TREE_COUNT, CLOSING_COUNT, MONOMIAL_COUNT = range(4)
"""Indices in the integers of a flat `JointKinematics`: numbers of joints, of tree joints, of loop-closing joints, and
of monomials (the largest over the joints)."""
JOINT_NODE, ANCHOR, JOINT_AXES, JOINT_LENGTH, FIRST_MOTION, TREE, CLOSING, POWER_FIRST, POWER, POSE = range(
    4, 14
)
"""Indices of its fields: the entry is where the field begins."""


class InteriorFunctionsFields(NamedTuple):
    """Database functions of the internal states of J joints: polynomials in the motions of their joint.

    block_node (K,), block_joint (K,): substructure node and joint of every internal block; block_pose (K, 6, M):
    coefficients of its rotation vector and chord by monomial. joint (F,), target (F,), coefficient (F, M): function f
    sets entry target[f] of the inner states (amplitudes [1/m], wrenches [N, Nm]). near_joint, near_target,
    near_coefficient: the same for the element and node rotation vectors of the near configuration
    (`ksd.model.arrays.Workspace.linearisation`).
    """

    block_node: np.ndarray
    block_joint: np.ndarray
    block_pose: np.ndarray
    joint: np.ndarray
    target: np.ndarray
    coefficient: np.ndarray
    near_joint: np.ndarray
    near_target: np.ndarray
    near_coefficient: np.ndarray


class InteriorFunctions(InteriorFunctionsFields):
    """`InteriorFunctionsFields` with their flat form for kernels."""

    float_names = "block_pose", "coefficient", "near_coefficient"

    @cached_property
    def flat(self) -> FlatFields:
        """All fields of a single design in two arrays."""
        counts = len(self.block_node), len(self.joint), len(self.near_joint)
        return FlatFields(*join_fields(counts, self))

    @cached_property
    def joined(self) -> FlatFields:
        """`flat` of D designs: integers of one, floats (D, f)."""
        return _join_designs(self)


INNER_BLOCK_COUNT, FUNCTION_COUNT, NEAR_FUNCTION_COUNT = range(3)
"""Indices in the integers of a flat `InteriorFunctions`: numbers of internal blocks, of functions, and of functions of
the near configuration."""
BLOCK_NODE, BLOCK_JOINT, BLOCK_POSE, FUNCTION_JOINT, FUNCTION_TARGET, FUNCTION_COEFFICIENT = range(3, 9)
NEAR_JOINT, NEAR_TARGET, NEAR_COEFFICIENT = range(9, 12)
"""Indices of its fields, up to here."""


def _join_designs(part: JointKinematics | InteriorFunctions) -> FlatFields:
    """Integers of one design and floats (D, f) of D designs, whose float fields have a leading axis."""
    fields = [getattr(part, name) for name in part.float_names]
    floats = np.concatenate([field.reshape(len(field), -1) for field in fields], axis=1)
    return FlatFields(fields_of_design(part, part.float_names, 0).flat.ints, floats)


Functions = TypeVar("Functions", JointKinematics, InteriorFunctions)


def functions_of_design(part: Functions, d: int) -> Functions:
    """Kinematics or interior functions of design d of several."""
    one_design: Functions = fields_of_design(part, part.float_names, d)
    one_design.flat = FlatFields(part.joined.ints, part.joined.floats[d])
    return one_design
