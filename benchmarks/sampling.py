"""Energy-conserving sampling (ECSW) of modal bodies: few elements, weighted, stand for all of a leaf.

For bodies whose energy is no polynomial. The weights are nonnegative and reproduce the reduced forces of training
states, so the sampled body still has an energy. What it saves grows with the mesh: the cost of a
sampled body is that of its sample, whatever the number of elements. Farhat et al. 2014 and 2015.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import nnls

from ksd.beam.modal import SCRATCH
from ksd.beam.modal_jets import JET, boundary_jets
from ksd.beam.modal_nodes import element_values
from ksd.errors import SceneError
from ksd.modal.basis import LeafBasis
from ksd.modal.bodies import ModalModel, member_pose, replaced
from ksd.model.arrays import Motion


def sampled_weights(training: np.ndarray, total: np.ndarray, *, tolerance: float = 1e-4) -> np.ndarray:
    """Nonnegative weights (e,) of few elements with training @ weights = total within `tolerance` (ECSW).

    training (s, e): reduced forces of every element in every training state, stacked; total (s,): their sums. Raises
    ValueError when the tolerance cannot be met.
    """
    size = np.linalg.norm(total)
    G, b = training / size, total / size
    chosen: list[int] = []
    weights, rest = np.zeros(G.shape[1]), b
    # greedy growth, nonnegative least squares on the elements chosen so far (Farhat et al. 2015, algorithm 1)
    while np.linalg.norm(rest) > tolerance:
        gain = G.T @ rest
        gain[chosen] = -np.inf
        best = int(np.argmax(gain))
        if len(chosen) == G.shape[1] or not gain[best] > 0.0:
            raise ValueError(
                f"{len(chosen)} of {G.shape[1]} elements leave {np.linalg.norm(rest):.2g} of the forces; the tolerance "
                f"{tolerance:g} cannot be met: raise it"
            )
        chosen.append(best)
        found, _ = nnls(G[:, chosen], b)
        chosen = [c for c, w in zip(chosen, found, strict=True) if w > 0.0] or chosen
        weights[:] = 0.0
        weights[chosen] = nnls(G[:, chosen], b)[0]
        rest = b - G @ weights
    return weights


def element_shares(
    body: LeafBasis, d: np.ndarray, Q: np.ndarray, eta: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Reduced force (nb + m, n) and tangent (nb + m, nb + m, n) of every element of a body at a state.

    Their sums over the elements are gradient and second derivatives of its energy.
    """
    angle, q = body.choices.coordinates == "angle", body.values_per_node
    jets = np.empty((len(body.b0), JET))
    reference = np.concatenate([body.orientation[0], body.orientation[-1]])
    boundary_jets(int(body.choices.frame == "chord"), int(angle), reference, d, Q, jets)
    columns = np.hstack([body.boundary, body.inner])
    z = body.z0 + columns @ np.concatenate([jets[:, 0] - body.b0, eta])
    store, g, H = np.empty(SCRATCH), np.empty(2 * q), np.empty((2 * q, 2 * q))
    force = np.empty((columns.shape[1], len(body.record)))
    tangent = np.empty((*columns.shape[1:], *force.shape))
    for e, record in enumerate(body.record):
        Z = columns[q * e : q * (e + 2)]
        element_values(
            record, store, z[q * e : q * (e + 2)], body.orientation[e : e + 2].ravel(), int(angle), g, H
        )
        force[:, e], tangent[:, :, e] = Z.T @ g, Z.T @ H @ Z
    return force, tangent


def training(body: LeafBasis, states: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> np.ndarray:
    """Rows (.., n) whose sums over the elements the sample must keep: scaled forces and tangents at all states.

    Forces alone leave stiff directions free that no training state loads, and the sampled body collapses into them.
    """
    shares = [element_shares(body, *state) for state in states]
    scale = np.sqrt(np.max([np.abs(np.einsum("iie->i", K)) for _, K in shares], axis=0))
    scale += 1e-9 * scale.max()
    upper = np.triu_indices(len(scale))
    rows = []
    for force, K in shares:
        size = np.abs(force.sum(axis=1) / scale).max()
        if size > 0.0:
            rows.append(force / scale[:, None] / size)
        rows.append((K / np.multiply.outer(scale, scale)[:, :, None])[upper])
    return np.vstack(rows)


def with_samples(model: ModalModel, states: Sequence[Motion], *, tolerance: float = 1e-4) -> ModalModel:
    """`model` with every body sampled so that its forces and tangents at `states` (of `model`) are kept.

    tolerance: of the norm of all of them, each scaled by its own size. Raises SceneError without states, or where the
    tolerance cannot be met.
    """
    weights: dict[int, np.ndarray] = {}
    members = model.arrays.members
    for i, body in enumerate(model.bodies):
        if body is None:
            continue
        if body.tied is not None:
            raise SceneError(
                f"leaf '{model.member_names[i]}' is on a quadratic manifold: only bodies of free derivatives are sampled"
            )
        parts = [
            (*member_pose(members, i, s), s.inner[members.inner_at[i] : members.inner_at[i + 1]])
            for s in states
        ]
        if not parts:
            raise SceneError("there are no training states: give deformed states of the modal model")
        G = training(body, parts)
        try:
            weights[i] = sampled_weights(G, G.sum(axis=1), tolerance=tolerance)
        except ValueError as reason:
            raise SceneError(f"leaf '{model.member_names[i]}' cannot be sampled: {reason}") from reason
    arrays, inner = replaced(model.full.arrays, model.full.rest.inner, list(model.bodies), weights)
    return replace(model, arrays=arrays, rest=model.rest._replace(inner=inner))
