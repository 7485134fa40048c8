"""The kinematics of the joints of a model and the functions of their insides, as Python holds them and as kernels read them.

Kernels take two arrays in place of many, as with `ksd.model.arrays.FlatArrays`: entry c of row i of a field F of w columns
is loops[loops[F] + w i + c] where it is a whole number, shapes[loops[F] + w i + c] otherwise.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from ksd.model.arrays import join_fields


class FlatArrays(NamedTuple):
    """See `ksd.model.arrays.join_fields`. Of `JointKinematics` kernels call them `loops` and `shapes`, of
    `InteriorFunctions` `inside` and `functions`."""

    ints: np.ndarray
    floats: np.ndarray


class JointKinematicsFields(NamedTuple):
    """Kinematics of J joints between nodes (0 ground, links 1..), all polynomials already for this design.

    node (J, 2); anchor (J, 2, 3): interface points A, B at rest from the nodes' reference points [m]; frame
    (J, 3, 3): joint axes at rest; length (J,); first (J+1,): motions of joint j are theta[first[j]:first[j+1]];
    tree (T, 2): joint, and 1 when it leads from A to B; closing (C,): joints closing loops; power_first (J+1,),
    power (P, 2): exponents, rising; pose (J, 6, M): rotation vector and chord of interface B by monomial.
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
    """`JointKinematicsFields`, also as kernels read them."""

    @cached_property
    def flat(self) -> FlatArrays:
        """All fields, of one design."""
        counts = len(self.node), len(self.tree), len(self.closing), self.pose.shape[2]
        return FlatArrays(*join_fields(counts, (), self))


JOINTS, BRANCHES, CLOSINGS, MONOMIALS = range(4)
JOINT_NODE, ANCHOR, AXES, JOINT_LENGTH, FIRST, TREE, CLOSING, POWER_FIRST, POWER, POSE = range(4, 14)
"""Where, in the ints of `JointKinematics`, counts stand: of joints, of those in the tree and of those that close loops, of
monomials at the most; and the places of fields."""


class InteriorFunctionsFields(NamedTuple):
    """Database functions of the insides of J joints, flattened; polynomials in the motions of their joint.

    block_node (K,), block_joint (K,): substructure node and joint of every internal block; block_pose (K, 6, M): rotation
    vector and chord by monomial. joint (F,), target (F,), coefficient (F, M): entry `target` of the inner states (amplitudes
    1/m, wrenches N and Nm). near_joint, near_target, near_coefficient: the same for work.linearisation (rotation vectors).
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
    """`InteriorFunctionsFields`, also as kernels read them."""

    @cached_property
    def flat(self) -> FlatArrays:
        """All fields, of one design."""
        counts = len(self.block_node), len(self.joint), len(self.near_joint)
        return FlatArrays(*join_fields(counts, (), self))


INNER_BLOCKS, FUNCTIONS, NEAR_FUNCTIONS = range(3)
BLOCK_NODE, BLOCK_JOINT, BLOCK_POSE, OWNER, TARGET, COEFFICIENT = range(3, 9)
NEAR_OWNER, NEAR_TARGET, NEAR_COEFFICIENT = range(9, 12)
"""The same in the ints of `InteriorFunctions`: counts of internal blocks, of functions and of those of near data."""
