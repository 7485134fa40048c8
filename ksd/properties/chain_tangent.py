"""The tangent of chains of Appendix A elements with their stresses as unknowns beside the motions of their nodes.

Elimination of the stresses gives back the node tangent. For small changes of the state it is the better behaved of the two:
the stiff directions of an element turn with it, and of the product B^T S B a derivative keeps one of the two factors only,
which takes stiffness away where none is lost (a fourbar at mid-stroke then buckles under a quarter of its load). Here B
stands alone, as the levers of the strain-mode leaf do in theirs.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ksd.model.arrays import Motion, make_work
from ksd.model.compile import Model
from ksd.model.system import assemble
from ksd.properties.alike import end_frames, end_levers

Array = NDArray[np.float64]


def with_stresses(model: Model, motion: Motion, K: Array) -> Array:
    """[K - B^T S B, B^T; B, -S^-1] from the node tangent K (n, n) of chains with all their nodes in the open."""
    members, n = model.arrays.members, len(K)
    S, B = _stiffnesses(model), _strain_rates(model, motion)
    first = model.arrays.start[members.node]
    at = np.where(first[..., None] < 0, n, first[..., None] + np.arange(6)).reshape(len(S), 12)
    nodes = np.pad(K, (0, 1))
    np.add.at(nodes, (at[:, :, None], at[:, None, :]), -B.swapaxes(1, 2) @ S @ B)
    size = n + 6 * len(S)
    found, own = np.zeros((size + 1, size + 1)), n + np.arange(6 * len(S)).reshape(-1, 6)
    found[:n, :n] = nodes[:n, :n]
    to = np.where(at == n, size, at)
    found[own[:, :, None], to[:, None, :]] = B
    found[to[:, :, None], own[:, None, :]] = B.swapaxes(1, 2)
    found[own[:, :, None], own[:, None, :]] = -np.linalg.inv(S)
    return found[:size, :size]


def _stiffnesses(model: Model) -> Array:
    """S (m, 6, 6) of every element: sigma = S eps (A.13)."""
    members = model.arrays.members
    numbers = np.stack([members.value[at + 1 : at + 7] for at in members.value_at[: len(members.kind)]])
    S = np.zeros((len(numbers), 6, 6))
    S[:, 0, 0], S[:, 1, 1] = numbers[:, 0], numbers[:, 1]
    for k, own, both in ((2, 2, 3), (4, 4, 5)):
        S[:, k, k] = S[:, k + 1, k + 1] = numbers[:, own]
        S[:, k, k + 1] = S[:, k + 1, k] = numbers[:, both]
    return S


def _strain_rates(model: Model, motion: Motion) -> Array:
    """B (m, 6, 12): strains of every element per motion of its two nodes. Its end wrench is B^T sigma, so unit stresses
    tell its rows."""
    members = model.arrays.members
    number = members.number.copy()
    # geometric forces from the stresses given, not from those of the state
    number[:, 1] = 1
    arrays = replace(model, arrays=model.arrays._replace(members=members._replace(number=number))).arrays
    work, target, state = make_work(arrays), np.zeros(len(arrays.terms.start)), motion.copy()
    D = np.empty((len(number), 6, 6))
    for k in range(6):
        state.inner[:] = 0.0
        state.inner[members.inner_at[:-1] + k] = 1.0
        work.value[:] = 0.0
        assemble(arrays, state, target, 0.0, work, 1e-8, 0, 10.0)
        D[:, k] = work.lam[: len(number), 6:]
    relative = end_levers(end_frames(model, motion, np.arange(len(number))))[1]
    found: Array = D @ relative
    return found
