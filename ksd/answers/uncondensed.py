"""Tangents with all inner unknowns, and the same without stresses, of which critical loads and material damping are made.

The stresses of leaf springs and chains are unknowns in addition to motions and amplitudes: condensed, the tangent has poles.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_diag, bmat, coo_matrix, csc_matrix

from ksd.answers.leaf_groups import (
    EndFrames,
    LeafGroup,
    assemble_blocks,
    elastic_stiffness,
    end_frames,
    end_jacobians,
    group_parts,
    inner_unknowns,
    leaf_groups,
    load_tangents,
)
from ksd.answers.nonconservative import skew_tangent
from ksd.answers.tangent import release_rows, stored_matrix
from ksd.elements.ends import geometric_tangent
from ksd.model.arrays import State, make_workspace
from ksd.model.compile import Model
from ksd.model.newton import assemble, assemble_nodes
from ksd.model.springs import relax_spring

Array = NDArray[np.float64]


def uncondensed_tangents(
    model: Model, motion: State, *, rows: Iterable[int] = (), load_factor: float = 1.0
) -> tuple[Any, Any]:
    """Uncondensed tangent, and the same with all stresses, drive forces and loads set to zero, both scipy CSC.

    Unknowns: nodes and multipliers in plan order, then amplitudes and end wrench (a, lam) of every leaf spring. Symmetric,
    except for loads that are not conservative. rows: constraint rows that are released. Chains must have all nodes in the
    model (no inner nodes); the results are then the node tangents.
    """
    arrays, skew = model.arrays, skew_tangent(model.arrays, motion, load_factor)
    if model.strain_leaves:
        stressed = _node_tangent(model, motion, rows, load_factor)
        unstressed = _node_tangent(_with_relaxed_springs(model, motion), _without_forces(motion), rows, 0.0)
    else:
        stressed = _chain_tangent(model, motion, rows, load_factor)
        unstressed = _unstressed_chains(model, motion, rows)
    stressed = stressed if skew is None else stressed + skew
    if not model.strain_leaves:
        return csc_matrix(stressed), csc_matrix(unstressed)
    nodes = arrays.plan.unknowns
    every = np.arange(nodes)
    unknowns_of, blocks = [every[None]], [(stressed[None], unstressed[None])]
    for group, unknowns in zip(leaf_groups(model), inner_unknowns(model), strict=True):
        unknowns_of.append(np.hstack([unknowns[:, :12], nodes + group.inner_index]))
        blocks.append(leaf_tangents(model, motion, group, load_factor))
    size = nodes + int(arrays.members.inner_at[-1])
    # modes of pressure follow from the amplitudes
    left = np.setdiff1d(np.arange(nodes, size), np.concatenate([u[:, 12:].ravel() for u in unknowns_of[1:]]))
    unknowns_of.append(left[:, None])
    blocks.append((np.ones((len(left), 1, 1)),) * 2)
    with_stress, without = (assemble_blocks(unknowns_of, [b[k] for b in blocks], size) for k in range(2))
    return with_stress.tocsc(), without.tocsc()


def _node_tangent(model: Model, motion: State, rows: Iterable[int], load_factor: float) -> Array:
    """Tangent (unknowns, unknowns) of constraint rows, loads and springs, with `rows` released."""
    arrays = model.arrays
    work = make_workspace(arrays)
    assemble_nodes(arrays, motion, load_factor, work)
    release_rows(arrays, work.matrix, rows)
    return stored_matrix(arrays, work.matrix)


def _with_relaxed_springs(model: Model, motion: State) -> Model:
    """The model with springs and elastic links that carry no force at `motion`."""
    if not len(model.arrays.springs.kind):
        return model
    arrays = model.arrays.copy()
    for i in range(len(arrays.springs.kind)):
        relax_spring(arrays, motion, i)
    return replace(model, arrays=arrays)


def _wrench_tangents(motion: State, group: LeafGroup, ends: EndFrames) -> Array:
    """Geometric tangents (k, 12, 12) of the end wrenches of a group, which turn with the nodes."""
    found = np.zeros((len(group.members), 12, 12))
    wrench = motion.inner[group.inner_index[:, group.modes :]].reshape(-1, 2, 3) @ ends.frame.swapaxes(1, 2)
    for k in range(len(found)):
        geometric_tangent(np.array([*wrench[k], ends.reach[k], ends.arms[k, 1]]), found[k])
    return found


def _without_forces(motion: State) -> State:
    """The state with zero drive and support forces."""
    return motion._replace(multiplier=np.zeros_like(motion.multiplier))


def leaf_tangents(model: Model, motion: State, group: LeafGroup, load_factor: float) -> tuple[Array, Array]:
    """Tangents (k, 18 + N, 18 + N) of leaf springs in (motions of both nodes, a, lam), with and without stress."""
    parts, ends = group_parts(model, motion, group, load_factor), end_frames(model, motion, group.members)
    N = group.modes
    unstressed = np.zeros((len(group.members), 18 + N, 18 + N))
    unstressed[:, 12 : 12 + N, 12 : 12 + N] = elastic_stiffness(group)
    # shear and stretch along turned sections: J depends on the force, too
    relaxed = motion._replace(inner=motion.inner.copy())
    relaxed.inner[group.inner_index[:, N:]] = 0.0
    unstressed[:, 12 + N :, 12 : 12 + N] = -group_parts(model, relaxed, group, 0.0).J
    unstressed[:, 12 + N : 15 + N, 12 + N : 15 + N] = -parts.S
    unstressed[:, 12 + N :, :12] = end_jacobians(ends)[1]
    stressed = unstressed.copy()
    stressed[:, 12 + N :, 12 : 12 + N] = -parts.J
    stressed[:, 12 : 12 + N, 12 : 12 + N] = parts.W
    stressed[:, :12, :12] = _wrench_tangents(motion, group, ends)
    for block in (stressed, unstressed):
        block[:, :12, 12:] = block[:, 12:, :12].swapaxes(1, 2)
        block[:, 12 : 12 + N, 12 + N :] = block[:, 12 + N :, 12 : 12 + N].swapaxes(1, 2)
    return stressed + load_tangents(model, motion, group, load_factor), unstressed


def _chain_tangent(model: Model, motion: State, rows: Iterable[int], load_factor: float) -> Array:
    """Node tangent (n, n) of a model of chains without inner nodes, with constraint `rows` released."""
    arrays = model.arrays
    work = make_workspace(arrays)
    assemble(arrays, motion, np.zeros(len(arrays.terms.start)), load_factor, work)
    release_rows(arrays, work.matrix, rows)
    return stored_matrix(arrays, work.matrix)


def _unstressed_chains(model: Model, motion: State, rows: Iterable[int]) -> Array:
    """Tangent of chains in the same geometry, with stresses, drive forces and loads set to zero."""
    members, state = model.arrays.members, _without_forces(motion.copy())
    for i in range(len(members.kind)):
        state.inner[members.inner_at[i + 1] - 6 : members.inner_at[i + 1]] = 0.0
    # with mixed integration points the geometric stiffness follows the stored stresses, which are now zero
    number = members.number.copy()
    number[:, 1] = 1
    model = _with_relaxed_springs(model, motion)
    model = replace(model, arrays=model.arrays.replace(members=members._replace(number=number)))
    return _chain_tangent(model, state, rows, 0.0)


def chain_tangent_with_stresses(model: Model, motion: State, K: Any) -> Any:
    """Tangent [K - B^T S B, B^T; B, -S^-1], scipy CSC, from the node tangent K (n, n) of chains without inner nodes.

    The stresses of all elements are unknowns in addition to the motions of the nodes; their elimination gives K. Its
    derivative is accurate, as the stiff directions of an element turn with it, whereas the derivative of B^T S B changes
    only one of the two factors at a time and underestimates the stiffness: a fourbar at mid-stroke would buckle under a
    quarter of its load.
    """
    S, B = element_stiffnesses(model), strain_matrix(model, motion, K.shape[0])
    stiffness = B.T @ block_diag(S, format="csr") @ B
    return bmat([[K - stiffness, B.T], [B, -block_diag(np.linalg.inv(S))]], format="csc")


def strain_matrix(model: Model, motion: State, size: int) -> Any:
    """Strains of all elements of chains, six each, per unknown of the model (`size`); scipy CSR."""
    first = model.arrays.start[model.arrays.members.node]
    columns = np.repeat(first[..., None] + np.arange(6), 6, axis=0).reshape(-1, 12)
    own = np.repeat(np.repeat(first >= 0, 6, axis=1), 6, axis=0)
    at = np.nonzero(own)[0], columns[own]
    return coo_matrix((strain_rates(model, motion).reshape(-1, 12)[own], at), shape=(len(own), size)).tocsr()


def element_stiffnesses(model: Model) -> Array:
    """Stiffness S (m, 6, 6) of every element: sigma = S eps (A.13)."""
    members = model.arrays.members
    numbers = np.stack([members.value[at + 1 : at + 7] for at in members.value_at[: len(members.kind)]])
    S = np.zeros((len(numbers), 6, 6))
    S[:, 0, 0], S[:, 1, 1] = numbers[:, 0], numbers[:, 1]
    for k, own, both in ((2, 2, 3), (4, 4, 5)):
        S[:, k, k] = S[:, k + 1, k + 1] = numbers[:, own]
        S[:, k, k + 1] = S[:, k + 1, k] = numbers[:, both]
    return S


def strain_rates(model: Model, motion: State) -> Array:
    """Strains B (m, 6, 12) of every element per motion of its two nodes.

    As the end wrench is B^T sigma, the rows are obtained from unit stresses.
    """
    members = model.arrays.members
    number = members.number.copy()
    # geometric forces from the stored unit stresses, not from those of the state
    number[:, 1] = 1
    arrays = replace(model, arrays=model.arrays.replace(members=members._replace(number=number))).arrays
    work, target, state = make_workspace(arrays), np.zeros(len(arrays.terms.start)), motion.copy()
    D = np.empty((len(number), 6, 6))
    for k in range(6):
        state.inner[:] = 0.0
        state.inner[members.inner_at[:-1] + k] = 1.0
        assemble(arrays, state, target, 0.0, work)
        D[:, k] = work.lam[: len(number), 6:]
    relative = end_jacobians(end_frames(model, motion, np.arange(len(number))))[1]
    rates: Array = D @ relative
    return rates
