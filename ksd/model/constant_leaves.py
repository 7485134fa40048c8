"""Leaf springs as bodies of constant stiffness: the constant-matrix flexure of planar grippers (paper 3, partial balance).

A leaf becomes the linear body of `ksd.elements.linear` with its stiffness K in the undeformed configuration: in the
frame of its end p, the wrench is K (d - d0, rotation vector of Q Q0^T). It is the gradient of an energy, so its wrenches
balance and its tangent is symmetric. Finite end poses are exact; the change of stiffness by the deformation is left out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ksd.elements.linear import LINEAR_INNER
from ksd.errors import ConvergenceError, SceneError
from ksd.model.arrays import Arrays, State, Workspace, make_workspace
from ksd.model.compile import Model, compile_as_is
from ksd.model.leaves import cut_leaves, whole_leaf_name
from ksd.model.mesh import Mesh
from ksd.model.newton import assemble, take_step
from ksd.model.reduced_bodies import LinearBody, inner_state, relative_end_pose, transfer_state, with_bodies
from ksd.numerics.rotations import rotation_exp, rotation_log
from ksd.scene.drive import GROUND
from ksd.scene.scene import PlacedLeaf, Scene

MAX_NEWTON_STEPS = 40
"""Largest number of Newton steps inside the leaf springs at fixed end poses."""
INNER_STEP_TOLERANCE = 1e-9
"""Relative change of the inner state by a Newton step below which it has converged."""
ROUNDING_TOLERANCE = 1e-14
"""Force below which changes are rounding, relative to that of a leaf spring stretched by the size of the mechanism."""
PART_COUNTS = (1, 4, 16, 64)
"""Numbers of parts in which the nodes are moved to their end poses, one after the other until one succeeds."""


@dataclass(frozen=True)
class ConstantLeaf(LinearBody):
    """A leaf of constant stiffness.

    stiffness (6, 6): of its end q in the frame of its end p; end_position (3,) [m]: of the undeformed end q in that frame.
    """

    stiffness: np.ndarray
    end_position: np.ndarray

    def __str__(self) -> str:
        return "constant stiffness, that of the undeformed leaf"


def is_constant(model: Model) -> bool:
    """Whether leaf springs of the model have constant stiffness."""
    return any(isinstance(body, ConstantLeaf) for body in model.bodies.values())


def rest_stiffness(leaf: Any, mesh: Mesh) -> np.ndarray:
    """Condensed stiffness (6, 6) of end q of an undeformed leaf, in the frame of its end p.

    Raises SceneError where the leaf is stressed in the undeformed configuration.
    """
    alone = Scene("leaf", (GROUND, "end"), leaves=(PlacedLeaf("leaf", GROUND, "end", leaf),))
    model = compile_as_is(alone, mesh)
    arrays, work = model.arrays, make_workspace(model.arrays)
    assemble(arrays, model.rest, np.zeros(0), 0.0, work)
    K = work.matrix[arrays.plan.diagonal[0] :][:36].reshape(6, 6)
    if np.abs(work.rhs[:6]).max() > 1e-9 * np.abs(K).max() * leaf.length:
        raise SceneError(
            f"method = 'constant': leaf '{leaf.name}' is under stress at rest (mechanism.fit or heat); use another method"
        )
    frame = np.kron(np.eye(2), arrays.members.frame[0, 0])
    stiffness = frame.T @ K @ frame
    return 0.5 * (stiffness + stiffness.T)


def with_constant_leaves(model: Model) -> Model:
    """The model with constant stiffness of every leaf; `model` becomes its `full`.

    Raises SceneError for leaf springs that have weight or are stressed in the undeformed configuration, and for models with
    reduced bodies.
    """
    for load in model.scene.loads_along:
        raise SceneError(
            f"'{load.name}': method = 'constant' knows no loads along leaf springs; use another method"
        )
    if model.bodies or len(model.arrays.weight):
        what = (
            "reduced bodies" if model.bodies else "leaf springs with weight (without='gravity' leaves it out)"
        )
        raise SceneError(f"method = 'constant' knows no {what}; use another method")
    leaves = {f"{j.name}/{leaf.name}": leaf for j in model.scene.joints for leaf in j.leaves()}
    leaves |= {name: leaf for name, _, _, leaf in cut_leaves(model.scene)}
    wholes = model.scene.leaf_names()
    if model.mesh.nodal:
        raise SceneError("method = 'constant' takes leaf springs whole; leave nodal out")
    stiffness: dict[tuple[int, bytes], np.ndarray] = {}
    bodies = {}
    for i, name in enumerate(model.member_names):
        d, Q = relative_end_pose(model.arrays.members, i, model.rest)
        # members with equal constants and end poses have equal stiffness
        key = int(model.arrays.members.value_at[i]), np.round([*d, *Q.ravel()], 12).tobytes()
        if key not in stiffness:
            stiffness[key] = rest_stiffness(leaves[name], model.mesh.for_leaf(whole_leaf_name(name, wholes)))
        bodies[name] = ConstantLeaf(stiffness[key], d)
    reduced = with_bodies(model, bodies)
    for i, body in enumerate(bodies.values()):
        inner = inner_state(reduced.arrays.members, i, reduced.rest)
        inner[:3], inner[3:12], inner[18:LINEAR_INNER] = (
            body.end_position,
            np.eye(3).ravel(),
            body.stiffness.ravel(),
        )
    return replace(reduced, full=model)


def equilibrate_bent_leaves(model: Model, state: State) -> State:
    """The state of the full model at the node poses of a state with constant leaves, with equilibrium inside every leaf.

    The nodes are moved from the undeformed configuration in `PART_COUNTS` parts. Raises ConvergenceError where the leaf
    springs cannot be equilibrated.
    """
    full = model.full
    assert full is not None
    arrays, end = full.arrays, transfer_state(model, state, full)
    stiffest = max(float(np.abs(body.stiffness[:3, :3]).max()) for body in model.bodies.values())
    rounding, rotations = ROUNDING_TOLERANCE * arrays.size * stiffest, np.empty((len(end.x), 3))
    for R, vector in zip(end.R, rotations, strict=True):
        rotation_log(R, vector)
    for parts in PART_COUNTS:
        bent, work = full.rest.copy(), make_workspace(arrays)
        bent.multiplier[:] = end.multiplier
        for k in range(1, parts + 1):
            bent.x[:] = full.rest.x + (k / parts) * (end.x - full.rest.x)
            for R, vector in zip(bent.R, rotations, strict=True):
                rotation_exp((k / parts) * vector, R)
            if not _equilibrate_inside(arrays, bent, work, rounding):
                break
        else:
            bent.R[:], bent.angle[:] = end.R, end.angle
            return bent
    raise ConvergenceError(
        "the leaf springs cannot follow the poses of method 'constant', which is too far off; ask for less, or use another "
        "method"
    )


def _equilibrate_inside(arrays: Arrays, state: State, work: Workspace, rounding: float) -> bool:
    """Take Newton steps inside the leaf springs at fixed nodes, in place, and return whether they converged.

    rounding [N]: changes of the inner state below it count as rounding.
    """
    no_step, target = np.zeros(arrays.plan.unknowns), np.zeros(len(arrays.terms.start))
    for _ in range(MAX_NEWTON_STEPS):
        before = state.inner.copy()
        assemble(arrays, state, target, 0.0, work)
        take_step(arrays, state, no_step, work, 1.0)
        change = np.abs(state.inner - before).max(initial=0.0)
        if not np.isfinite(change):
            return False
        if change <= max(INNER_STEP_TOLERANCE * np.abs(state.inner).max(initial=0.0), rounding):
            return True
    return False
