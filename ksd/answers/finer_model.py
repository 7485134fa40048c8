"""A state on a finer model, from which stiffness, frequencies and buckling are computed.

The inner nodes of chains of Appendix A elements become nodes of the model. Strain-mode leaves get one more mode per axis:
an additional load or an inertia bends a leaf in shapes that the state itself does not need. One Newton step with drives and
supports fixed leads to the equilibrium of the finer model. Without that step frequencies near buckling are up to 4 % off
and drive stiffnesses 2 %, for states whose forces are right to 0.2 %; with it 0.6 and 0.2 % in 98 random mechanisms, 2.9 %
(5.5) in one of 45 others.
Errors without and with the additional modes, orders (4, 3, 5): cross flexure at 60 degrees, kz 1.9e-4 and 4e-6; parallel
guide at 40 thicknesses, kx 3.3e-4 and 2e-6; clamped leaf, second frequency 2e-2 and 2e-4. Buckling refines the finer model
once more.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from ksd.answers.centrelines import member_ends, scene_leaves
from ksd.answers.derived import cached_per_model
from ksd.elements.strain_values import strain_sizes
from ksd.errors import SceneError
from ksd.model.arrays import SETTINGS, State, make_workspace
from ksd.model.compile import Model, remesh_model
from ksd.model.leaves import piece_name
from ksd.model.mesh import MAX_ORDER, Mesh, MixedMesh
from ksd.model.newton import take_step_at_fixed_rows
from ksd.model.reduced_bodies import with_bodies
from ksd.model.turns import copy_angles

MAX_STEP = 0.1
"""Limit of the Newton step: rotation [rad], or displacement relative to the size of the mechanism.

Errors of meshes and fast methods are smaller. For a four-bar by method='kinematic', steps of .02 to .05 rad reduce the
error of a drive stiffness from a half to .3 to 2 %.
"""


@cached_per_model
def finer_model(model: Model) -> Model:
    """The model with all nodes of chains as its own and one more mode per axis in strain-mode leaves."""
    if model.chains:
        _check_chains_are_straight(model)
    mesh = finer_mesh(model)
    if mesh == model.mesh:
        return model
    # bodies are not part of the scene
    return with_bodies(remesh_model(model, mesh), model.bodies)


def finer_mesh(model: Model) -> Mesh:
    """Mesh of `finer_model`."""
    return _finer_mesh(model.mesh, bool(model.strain_leaves))


def _check_chains_are_straight(model: Model) -> None:
    """Raise SceneError for curved or profiled leaves meshed as chains, which cannot be divided into single elements."""
    for name, leaf in scene_leaves(model).items():
        mesh = model.mesh.for_leaf(name)
        if (leaf.curve is not None or leaf.profile is not None) and mesh.leaf != "strain" and not mesh.nodal:
            raise SceneError(
                f"leaf '{name}' is curved or has a profile: its frequencies and buckling are answered by "
                "strain-mode leaf springs (no mesh=) only, not by chains of elements"
            )


@lru_cache(maxsize=64)
def _finer_mesh(mesh: Mesh, strain: bool) -> Mesh:
    """`finer_mesh` of every part; strain: the model has strain-mode leaves."""
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
    """The finer model and its equilibrium near the state, with drives and supports fixed."""
    fine = finer_model(model)
    if fine is model:
        return model, motion
    state = _expand_state(model, motion, fine)
    if model.strain_leaves:
        take_step_at_fixed_rows(fine.arrays, state, load_factor, make_workspace(fine.arrays), MAX_STEP)
    return fine, state


def pad_amplitudes(
    number: np.ndarray, inner: np.ndarray, finer_number: np.ndarray, finer: np.ndarray
) -> None:
    """Write the inner state of a strain-mode leaf into that of one with more modes per axis, leaving these unchanged.

    number, finer_number (3,): modes per axis of both.
    """
    read, write = 0, 0
    for axis in range(3):
        n = int(number[axis])
        finer[write : write + n] = inner[read : read + n]
        read, write = read + n, write + int(finer_number[axis])
    # the wrench, and modes of pressure
    finer[write:] = inner[read:]


@lru_cache(maxsize=64)
def finer_inner_index(number: bytes, finer_number: bytes) -> np.ndarray:
    """Positions at which `pad_amplitudes` writes the inner states of all members; settings (m, SETTINGS) of both models."""
    index, first = [], 0
    for coarse, fine in zip(
        np.frombuffer(number, np.int64).reshape(-1, SETTINGS),
        np.frombuffer(finer_number, np.int64).reshape(-1, SETTINGS),
        strict=True,
    ):
        marks, padded = (np.zeros(strain_sizes(number)[0]) for number in (coarse, fine))
        marks[:] = np.arange(1.0, len(marks) + 1.0)
        pad_amplitudes(coarse, marks, fine, padded)
        index.append(first + np.flatnonzero(padded))
        first += len(padded)
    return np.concatenate(index)


def _expand_state(model: Model, motion: State, fine: Model) -> State:
    """State in the unknowns of the finer model: padded amplitudes, and the inner nodes and stresses of chains."""
    members, finer = model.arrays.members, fine.arrays.members
    state = fine.rest.copy()
    if model.member_names == fine.member_names and model.has_strain_leaves_only:
        state.inner[finer_inner_index(members.number.tobytes(), finer.number.tobytes())] = motion.inner
        return motion.copy()._replace(inner=state.inner)
    index = {name: k for k, name in enumerate(fine.node_names)}
    member = {name: i for i, name in enumerate(fine.member_names)}
    for k, name in enumerate(model.node_names):
        state.x[index[name]], state.R[index[name]] = motion.x[k], motion.R[k]
    state.multiplier[:] = motion.multiplier
    copy_angles(model.arrays, motion, fine.arrays, state, nodes=[index[name] for name in model.node_names])
    for i, name in enumerate(model.member_names):
        inner = motion.inner[members.inner_at[i] : members.inner_at[i + 1]]
        if name in member:
            own = state.inner[finer.inner_at[member[name]] : finer.inner_at[member[name] + 1]]
            if i in model.strain_leaves:
                pad_amplitudes(members.number[i], inner, finer.number[member[name]], own)
            else:
                own[:] = inner
            continue
        nodes = int(members.number[i, 0]) - 1
        _expand_chain(model, motion, i, inner, [index[piece_name(name, k)] for k in range(nodes)], state)
        for k, stress in enumerate(inner[12 * nodes :].reshape(-1, 6)):
            at = finer.inner_at[member[piece_name(name, k)]]
            state.inner[at : at + 6] = stress
    return state


def _expand_chain(
    model: Model, motion: State, i: int, inner: np.ndarray, nodes: list[int], state: State
) -> None:
    """Write the inner nodes of chain `i`, with r and R (from the undeformed state) in frame p, into `state`."""
    ends, rest = member_ends(model, motion, i), model.arrays.members.frame[i, 0]
    for k, node in enumerate(nodes):
        r, R = inner[12 * k : 12 * k + 3], inner[12 * k + 3 : 12 * k + 12].reshape(3, 3)
        state.x[node] = ends.start + ends.frame @ r
        state.R[node] = ends.frame @ R @ rest.T
