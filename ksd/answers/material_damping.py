"""Damping by loss factors: the part of a mode's stiffness that is elastic, leaf spring by leaf spring.

A material with loss factor eta resists a rate of strain, so that mode k has the ratio zeta_k = 1/2 sum eta (phi.K phi)/w_k^2
with the elastic stiffness K of each leaf spring, at zero stress. What gravity, stress, springs and loads add to or take from
w_k^2 is not damped: a guide that stands on its leaf springs is damped more than eta/2, one that hangs less.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ksd.answers.leaf_groups import elastic_stiffness, leaf_groups, node_unknowns
from ksd.answers.mass import Inertia, member_leaves
from ksd.answers.uncondensed import element_stiffnesses, strain_rates
from ksd.errors import SceneError
from ksd.model.arrays import State
from ksd.model.compile import Model

Array = NDArray[np.float64]


def member_loss_factors(model: Model) -> Array:
    """Loss factor (members,) of the material of every member; 0 where it has none."""
    leaves = member_leaves(model)
    return np.array([leaves[i][0].material.loss_factor or 0.0 for i in range(len(model.member_names))])


def has_loss_factors(model: Model) -> bool:
    """Whether the material of a leaf spring has a loss factor."""
    return any(leaf.material.loss_factor is not None for leaf in model.scene.leaf_names().values())


def material_stiffness(model: Model, motion: State, mass: Inertia, vectors: Array) -> Array:
    """phi.K phi (members, k) of every leaf spring for vectors (k, size), with its elastic stiffness K at zero stress.

    Raises SceneError for chains beside strain-mode leaf springs.
    """
    found = np.zeros((len(model.member_names), len(vectors)))
    padded = np.vstack([vectors.T, np.zeros((1, len(vectors)))])
    for group, leaf, (own, Z) in zip(leaf_groups(model), mass.leaves, mass.bubbles, strict=True):
        nodes = padded[node_unknowns(model, model.arrays.members.node[group.members])]
        moved = leaf.relative @ nodes
        bent = leaf.P @ moved + padded[leaf.inner]
        found[group.members] = np.einsum("kim,kij,kjm->km", bent, elastic_stiffness(group), bent)
        # stretch and shear: what bending leaves of the motion of the end
        longer = moved[:, :3] - leaf.parts.J[:, :3] @ bent
        for change, stiff in ((longer, np.linalg.pinv(leaf.parts.S)), (padded[own], np.linalg.inv(Z))):
            found[group.members] += np.einsum("kim,kij,kjm->km", change, stiff, change)
    if model.has_strain_leaves_only:
        return found
    if model.strain_leaves:
        raise SceneError("loss factors: some leaf springs are chains of elements; use one leaf model for all")
    strain = strain_rates(model, motion) @ padded[node_unknowns(model, model.arrays.members.node)]
    found[:] = np.einsum("kim,kij,kjm->km", strain, element_stiffnesses(model), strain)
    return found
