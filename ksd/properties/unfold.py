"""The same state on a model that shows what statics condenses: what stiffness, mass and buckling stand on.

Chains of Appendix A elements get all their nodes in the open. Strain-mode leafs get one more mode per axis: a
load that was not there, or an inertia, bends a leaf in shapes the state itself does not need. The amplitudes
of the new modes follow from equilibrium inside every leaf at the present end poses; nodes do not move.
Measured gain, orders (4, 3, 5): cross flexure at 60 degrees, kz 1.9e-4 to 4e-6; parallel guide at 40
thicknesses, kx 3.3e-4 to 2e-6; clamped leaf, second frequency 2e-2 to 2e-4, buckling load 5e-2 (second) to
1e-3.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ksd.errors import SceneError
from ksd.model.arrays import COROTATIONAL, STRAIN, Motion, make_work
from ksd.model.compile import Model, compile_given
from ksd.model.system import assemble, take_step
from ksd.properties.kept import per_model
from ksd.properties.shape import scene_leafs

MOST = 12
"""Modes per axis the mesh allows."""
PASSES = 1
"""Newton steps inside the leafs; a second one changes kx of the guide at 40 thicknesses by 2e-7."""


@per_model
def finer(model: Model) -> Model:
    """The model with chain nodes in the open and one more mode per axis in strain-mode leafs."""
    mesh, kind = model.mesh, model.arrays.members.kind
    if np.any(kind == COROTATIONAL) and not mesh.nodal:
        for name, leaf in scene_leafs(model).items():
            if leaf.curve is not None or leaf.profile is not None:
                raise SceneError(
                    f"leaf '{name}' is curved or has a profile: its frequencies and buckling are answered by "
                    "strain-mode leafs (leaf='strain') only, not by chains of elements"
                )
        return compile_given(model.scene, replace(mesh, nodal=True))
    if np.any(kind == STRAIN) and max(mesh.orders) < MOST:
        nx, ny, nz = mesh.orders
        more = (nx + 1, ny + 1, nz + 1)
        return compile_given(model.scene, replace(mesh, orders=more, points=max(mesh.points, nz + 2) + 1))
    return model


def unfolded(model: Model, motion: Motion, *, load_factor: float = 1.0) -> tuple[Model, Motion]:
    """The finer model and the same state on it: same nodes, forces and stresses; new amplitudes are zero."""
    fine = finer(model)
    if fine is model:
        return model, motion
    if fine.mesh.nodal:
        return fine, _open_chains(model, motion, fine)
    state = Motion(motion.x.copy(), motion.R.copy(), _padded(model, motion, fine), motion.multiplier.copy())
    _settle(fine, state, load_factor)
    return fine, state


def _settle(model: Model, motion: Motion, load_factor: float) -> None:
    """Equilibrium inside every leaf at the present end poses, by Newton on all of them together, in place."""
    arrays = model.arrays
    work = make_work(arrays)
    still, target = np.zeros(arrays.plan.unknowns), np.zeros(len(arrays.terms.start))
    for _ in range(PASSES):
        assemble(arrays, motion, target, load_factor, work, 1e-8, 0, 10.0)
        take_step(arrays, motion, still, work, 1.0)


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
