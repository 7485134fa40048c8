"""Stiffness and mass of a model in all unknowns, those inside its leaf springs included."""

import numpy as np
import scipy.linalg

from ksd.answers.finer_model import finer_state
from ksd.answers.leaf_groups import leaf_groups
from ksd.answers.mass import assemble_inertia
from ksd.answers.tangent import row_numbers
from ksd.answers.uncondensed import uncondensed_tangents


def uncondensed(model, motion, freed=()):
    """(K, M) in all unknowns: nodes, multipliers, (a, lam) and the bubbles of every leaf; a = P xi + b makes b = a - P
    xi."""
    fine, state = finer_state(model, motion)
    K = uncondensed_tangents(fine, state, rows=row_numbers(fine, freed))[0].toarray()
    mass = assemble_inertia(fine, state)
    members, nodes = fine.arrays.members, fine.arrays.plan.unknowns
    T = np.zeros((mass.size, len(K)))
    T[:nodes, :nodes] = np.eye(nodes)
    for group, leaf in zip(leaf_groups(fine), mass.leaves, strict=True):
        for k, i in enumerate(group.members.tolist()):
            at, first, P = leaf.inner[k], nodes + members.inner_at[i], leaf.P[k]
            T[at, first + np.arange(len(P))] = 1.0
            for e in range(2):
                start = fine.arrays.start[members.node[i, e]]
                if start >= 0:
                    T[at, start : start + 6] -= P @ leaf.relative[k][:, 6 * e : 6 * e + 6]
    own = np.concatenate([at.ravel() for at, _ in mass.bubbles] or [np.zeros(0, int)])
    bubbles = np.zeros((mass.size, len(own)))
    bubbles[own, np.arange(len(own))] = 1.0
    T = np.hstack([T, bubbles])
    K = scipy.linalg.block_diag(K, *(stiff for _, Z in mass.bubbles for stiff in np.linalg.inv(Z)))
    return K, T.T @ mass.matrix.toarray() @ T
