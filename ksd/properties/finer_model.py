"""The same state on a model that shows what statics condenses: what stiffness, mass and buckling stand on.

Chains of Appendix A elements get all their nodes in the open. Strain-mode leaves get one more mode per axis: a
load that was not there, or an inertia, bends a leaf in shapes the state itself does not need. A Newton step
leads to the equilibrium there, drives and supports where they are: at nodes that stand still frequencies near
buckling were up to 4 % off, drive stiffnesses 2 %, of states whose forces are right to 0.2 %; now 0.6 and 0.2 %
in 98 random mechanisms, 2.9 % (5.5) in one of 45 others.
Measured gain, orders (4, 3, 5): cross flexure at 60 degrees, kz 1.9e-4 to 4e-6; parallel guide at 40
thicknesses, kx 3.3e-4 to 2e-6; clamped leaf, second frequency 2e-2 to 2e-4. Buckling asks for one more of the finer
model.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from ksd.errors import SceneError
from ksd.model.arrays import COROTATIONAL, STRAIN, State, make_workspace
from ksd.model.compile import Model, remesh_model
from ksd.model.leaves import piece_name
from ksd.model.mesh import MAX_ORDER, Mesh, MixedMesh
from ksd.model.newton import take_step_at_fixed_rows
from ksd.model.reduced_bodies import with_bodies
from ksd.properties.cache import cached_per_model
from ksd.properties.shape import scene_leaves

MAX_STEP = 0.1
"""Rotation [rad], or way over the size of the mechanism, that neither a mesh nor a fast method is off: of a four-bar by
method='kinematic', steps of .02 to .05 rad leave .3 to 2 % of a drive stiffness that is off by half without."""


@cached_per_model
def finer_model(model: Model) -> Model:
    """The model with chain nodes in the open and one more mode per axis in strain-mode leaves."""
    if COROTATIONAL in model.kinds:
        _check_chains_are_straight(model)
    opened = finer_mesh(model)
    if opened == model.mesh:
        return model
    # bodies are no part of the scene
    return with_bodies(remesh_model(model, opened), model.bodies)


def finer_mesh(model: Model) -> Mesh:
    """The mesh of `finer`."""
    return _finer_mesh(model.mesh, STRAIN in model.kinds)


def _check_chains_are_straight(model: Model) -> None:
    """SceneError for a chain that cannot be cut into nodes."""
    for name, leaf in scene_leaves(model).items():
        mesh = model.mesh.of(name)
        if (leaf.curve is not None or leaf.profile is not None) and mesh.leaf != "strain" and not mesh.nodal:
            raise SceneError(
                f"leaf '{name}' is curved or has a profile: its frequencies and buckling are answered by "
                "strain-mode leaf springs (no mesh=) only, not by chains of elements"
            )


@lru_cache(maxsize=64)
def _finer_mesh(mesh: Mesh, strain: bool) -> Mesh:
    """The finer mesh, part by part."""
    if isinstance(mesh, MixedMesh):
        others = tuple((_finer_mesh(other, strain), names) for other, names in mesh.others)
        mesh = replace(mesh, others=others)
    if mesh.leaf != "strain":
        return mesh if mesh.nodal else replace(mesh, nodal=True)
    if not strain or max(mesh.orders) >= MAX_ORDER:
        return mesh
    nx, ny, nz = mesh.orders
    return replace(mesh, orders=(nx + 1, ny + 1, nz + 1), points=max(mesh.points, nz + 2) + 1)


def finer_state(model: Model, motion: State, *, load_factor: float = 1.0) -> tuple[Model, State]:
    """The finer model and the equilibrium there next to the state, drives and supports where they are."""
    fine = finer_model(model)
    if fine is model:
        return model, motion
    state = _expand_state(model, motion, fine)
    if STRAIN in model.kinds:
        take_step_at_fixed_rows(fine.arrays, state, load_factor, make_workspace(fine.arrays), MAX_STEP)
    return fine, state


def pad_amplitudes(number: np.ndarray, inner: np.ndarray, wider: np.ndarray, state: np.ndarray) -> None:
    """The inner state of a strain-mode leaf in one of more modes per axis, zeros for these; numbers (3,) of both."""
    read, write = 0, 0
    for axis in range(3):
        n = int(number[axis])
        state[write : write + n] = inner[read : read + n]
        read, write = read + n, write + int(wider[axis])
    state[write : write + 6] = inner[read : read + 6]


@lru_cache(maxsize=64)
def finer_inner_index(number: bytes, wider: bytes) -> np.ndarray:
    """Where `pad` puts the inner states of all members; settings (m, 4) of both."""
    places, first = [], 0
    for own, theirs in zip(
        np.frombuffer(number, np.int64).reshape(-1, 4),
        np.frombuffer(wider, np.int64).reshape(-1, 4),
        strict=True,
    ):
        marks, at = np.arange(1.0, own[:3].sum() + 7), np.zeros(int(theirs[:3].sum()) + 6)
        pad_amplitudes(own, marks, theirs, at)
        places.append(first + np.flatnonzero(at))
        first += len(at)
    return np.concatenate(places)


def _expand_state(model: Model, motion: State, fine: Model) -> State:
    """State of the finer model: strain-mode leaves with more modes, the inner nodes and stresses of chains in the open."""
    members, more = model.arrays.members, fine.arrays.members
    state = fine.rest.copy()
    if model.member_names == fine.member_names and model.kinds <= {STRAIN}:
        state.inner[finer_inner_index(members.number.tobytes(), more.number.tobytes())] = motion.inner
        return State(motion.x.copy(), motion.R.copy(), state.inner, motion.multiplier.copy())
    index = {name: k for k, name in enumerate(fine.node_names)}
    member = {name: i for i, name in enumerate(fine.member_names)}
    for k, name in enumerate(model.node_names):
        state.x[index[name]], state.R[index[name]] = motion.x[k], motion.R[k]
    state.multiplier[:] = motion.multiplier
    for i, name in enumerate(model.member_names):
        inner = motion.inner[members.inner_at[i] : members.inner_at[i + 1]]
        if name in member:
            own = state.inner[more.inner_at[member[name]] : more.inner_at[member[name] + 1]]
            if members.kind[i] == STRAIN:
                pad_amplitudes(members.number[i], inner, more.number[member[name]], own)
            else:
                own[:] = inner
            continue
        nodes = int(members.number[i, 0]) - 1
        _expand_chain(model, motion, i, inner, [index[piece_name(name, k)] for k in range(nodes)], state)
        for k, stress in enumerate(inner[12 * nodes :].reshape(-1, 6)):
            at = more.inner_at[member[piece_name(name, k)]]
            state.inner[at : at + 6] = stress
    return state


def _expand_chain(model: Model, motion: State, i: int, inner: np.ndarray, nodes: list, state: State) -> None:
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
