"""Energy-conserving sampling (ECSW) of modal bodies: few elements with weights replace all elements of a leaf.

For bodies whose energy is no polynomial. The weights are nonnegative and reproduce the reduced forces of training
states, so the sampled body still has an energy. What it saves grows with the mesh: the cost of a
sampled body is that of its sample, whatever the number of elements. Farhat et al. 2014 and 2015.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from ksd.elements.modal import ELEMENT_SCRATCH_SIZE
from ksd.elements.modal_nodes import element_values
from ksd.errors import SceneError
from ksd.modal.leaf_basis import LeafBasis
from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.model.reduced_bodies import inner_state, relative_end_pose, with_bodies


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


@dataclass(frozen=True)
class SampledBasis(LeafBasis):
    """A basis whose energy is that of few elements of its leaf; weights (n,) of all of them."""

    weights: np.ndarray | None = None

    def constants(self, weights: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """With the elements of nonzero weight."""
        return super().constants(self.weights)


def element_shares(
    body: LeafBasis, d: np.ndarray, Q: np.ndarray, eta: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Reduced force (nb + m, n) and tangent (nb + m, nb + m, n) of every element of a body at a state.

    Their sums over the elements are gradient and second derivatives of its energy.
    """
    angle, q = body.choices.coordinates == "angle", body.values_per_node
    columns, z = np.hstack([body.boundary, body.inner]), body.values(d, Q, eta)
    store, g, H = np.empty(ELEMENT_SCRATCH_SIZE), np.empty(2 * q), np.empty((2 * q, 2 * q))
    force = np.empty((columns.shape[1], len(body.element_constants)))
    tangent = np.empty((*columns.shape[1:], *force.shape))
    for e, record in enumerate(body.element_constants):
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


def with_samples(model: Model, states: Sequence[State], *, tolerance: float = 1e-4) -> Model:
    """`model` with every body sampled so that its forces and tangents at `states` (of `model`) are kept.

    tolerance: of the norm of all of them, each scaled by its own size. Raises SceneError without states, or where the
    tolerance cannot be met.
    """
    assert model.full is not None
    bodies = {}
    for name, body in model.bodies.items():
        i = model.member_names.index(name)
        if body.second_derivatives is not None:
            raise SceneError(
                f"leaf '{name}' is on a quadratic manifold: only bodies of free derivatives are sampled"
            )
        parts = [
            (*relative_end_pose(model.arrays.members, i, s), inner_state(model.arrays.members, i, s))
            for s in states
        ]
        if not parts:
            raise SceneError("there are no training states: give deformed states of the modal model")
        G = training(body, parts)
        try:
            weights = sampled_weights(G, G.sum(axis=1), tolerance=tolerance)
        except ValueError as reason:
            raise SceneError(f"leaf '{name}' cannot be sampled: {reason}") from reason
        bodies[name] = SampledBasis(**vars(body), weights=weights)
    return replace(with_bodies(model.full, bodies), full=model.full)
