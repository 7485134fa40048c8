"""The same state on a model that shows what statics condenses: what mass and buckling stand on.

Chains of Appendix A elements get all their nodes in the open. Strain-mode leafs get one more mode per axis,
with zero amplitude: curvatures of a vibrating leaf have a shape no static load gives it (clamped leaf, second
frequency: 2 % off with five modes, 0.04 % with six; buckling loads gain as much).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ksd.model.arrays import COROTATIONAL, STRAIN, Motion
from ksd.model.compile import Model, compile_scene
from ksd.properties.kept import per_model

MOST = 12
"""Modes per axis the mesh allows."""


@per_model
def finer(model: Model) -> Model:
    """The model with chain nodes in the open and one more mode per axis in strain-mode leafs."""
    mesh, kind = model.mesh, model.arrays.members.kind
    if np.any(kind == COROTATIONAL) and not mesh.nodal:
        return compile_scene(model.scene, mesh=replace(mesh, nodal=True))
    if np.any(kind == STRAIN) and max(mesh.orders) < MOST:
        nx, ny, nz = mesh.orders
        more = (nx + 1, ny + 1, nz + 1)
        return compile_scene(
            model.scene, mesh=replace(mesh, orders=more, points=max(mesh.points, nz + 2) + 1)
        )
    return model


def unfolded(model: Model, motion: Motion) -> tuple[Model, Motion]:
    """The finer model and the same state on it: same nodes, forces and stresses; new amplitudes are zero."""
    fine = finer(model)
    if fine is model:
        return model, motion
    if fine.mesh.nodal:
        return fine, _open_chains(model, motion, fine)
    return fine, Motion(motion.x, motion.R, _padded(model, motion, fine), motion.multiplier)


def _padded(model: Model, motion: Motion, fine: Model) -> np.ndarray:
    """Inner states with zeros for the new modes of every axis."""
    old, new = model.arrays.members, fine.arrays.members
    inner = fine.rest.inner.copy()
    for i in range(len(old.kind)):
        read, write = int(old.inner_at[i]), int(new.inner_at[i])
        for axis in range(3):
            n = int(old.number[i, axis])
            inner[write : write + n] = motion.inner[read : read + n]
            read, write = read + n, write + int(new.number[i, axis])
        inner[write : write + 6] = motion.inner[read : read + 6]
    return inner


def _open_chains(model: Model, motion: Motion, fine: Model) -> Motion:
    """State of the nodal model from the inner nodes and stresses of the chains."""
    members = model.arrays.members
    state = fine.rest.copy()
    index = {name: k for k, name in enumerate(fine.node_names)}
    member = {name: i for i, name in enumerate(fine.member_names)}
    for k, name in enumerate(model.node_names):
        state.x[index[name]], state.R[index[name]] = motion.x[k], motion.R[k]
    state.multiplier[:] = motion.multiplier
    for i, name in enumerate(model.member_names):
        inner = motion.inner[members.inner_at[i] : members.inner_at[i + 1]]
        nodes = int(members.number[i, 0]) - 1
        _open_chain(model, motion, i, inner, [index[f"{name}.{k + 1}"] for k in range(nodes)], state)
        for k, stress in enumerate(inner[12 * nodes :].reshape(-1, 6)):
            at = fine.arrays.members.inner_at[member[f"{name}.{k + 1}"]]
            state.inner[at : at + 6] = stress
    return state


def _open_chain(model: Model, motion: Motion, i: int, inner: np.ndarray, nodes: list, state: Motion) -> None:
    """Write the inner nodes of chain `i` into `state`: r in frame p, R from the undeformed state in frame
    p."""
    members = model.arrays.members
    a = members.node[i, 0]
    rest = members.frame[i, 0]
    frame = motion.R[a] @ rest
    start = motion.x[a] + motion.R[a] @ members.offset[i, 0]
    for k, node in enumerate(nodes):
        record = inner[12 * k : 12 * k + 12]
        state.x[node] = start + frame @ record[:3]
        state.R[node] = frame @ record[3:].reshape(3, 3) @ rest.T
