"""Leaf springs as bodies of constant stiffness: the constant-matrix flexure of planar grippers (paper 3, partial balance).

A leaf becomes the linear body of `ksd.beam.linear` with its stiffness at rest K: in the frame of its end p, wrench
K (d - d0, rotation vector of Q Q0^T). It is the gradient of an energy, so its wrenches balance and its tangent is symmetric;
end poses are exact, and its insides do not know that they have bent.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ksd.beam.linear import LINEAR_INNER
from ksd.errors import ConvergenceError, SceneError
from ksd.model.arrays import LINEAR, Arrays, State, Workspace, make_workspace
from ksd.model.compile import Model, compile_as_is
from ksd.model.leaves import cut_leaves, whole_leaf_name
from ksd.model.mesh import Mesh
from ksd.model.newton import assemble, take_step
from ksd.model.reduced_bodies import inner_state, relative_end_pose, transfer_state, with_bodies
from ksd.numerics.rotations import rotation_exp, rotation_log
from ksd.scene.drive import GROUND
from ksd.scene.scene import PlacedLeaf, Scene

MAX_NEWTON_STEPS = 40
"""Newton steps inside the leaf springs at held end poses."""
INNER_STEP_TOLERANCE = 1e-9
"""Relative change of the inner state by a step at which it is found."""
ROUNDING_TOLERANCE = 1e-14
"""Forces over those of leaf springs stretched by the size of the mechanism down to which they are rounding."""
PART_COUNTS = (1, 4, 16, 64)
"""In how many parts the nodes are moved there."""


@dataclass(frozen=True)
class ConstantLeaf:
    """A leaf of constant stiffness, K (6, 6) of its end q in the frame of its end p, at rest at d0 (3,)."""

    stiffness: np.ndarray
    place: np.ndarray

    kind = LINEAR

    def constants(self) -> tuple[np.ndarray, np.ndarray]:
        """None: its numbers are its inner state."""
        return np.zeros(0), np.zeros(4, np.int64)

    def __str__(self) -> str:
        return "constant stiffness, that of the undeformed leaf"


def is_constant(model: Model) -> bool:
    """Whether the leaf springs of a model are of constant stiffness."""
    return any(isinstance(body, ConstantLeaf) for body in model.bodies.values())


def rest_stiffness(leaf: Any, mesh: Mesh) -> np.ndarray:
    """Stiffness (6, 6) of the end q of a leaf at rest, in the frame of its end p, its insides condensed.

    Raises SceneError where the leaf is under stress at rest.
    """
    alone = Scene("leaf", (GROUND, "end"), leaves=(PlacedLeaf("leaf", GROUND, "end", leaf),))
    model = compile_as_is(alone, mesh)
    arrays, work = model.arrays, make_workspace(model.arrays)
    assemble(arrays, model.rest, np.zeros(0), 0.0, work, 1e-8, 0, 10.0)
    K = work.matrix[arrays.plan.diagonal[0] :][:36].reshape(6, 6)
    if np.abs(work.rhs[:6]).max() > 1e-9 * np.abs(K).max() * leaf.length:
        raise SceneError(
            f"method = 'constant': leaf '{leaf.name}' is under stress at rest (mechanism.fit or heat); use another method"
        )
    frame = np.kron(np.eye(2), arrays.members.frame[0, 0])
    found = frame.T @ K @ frame
    return 0.5 * (found + found.T)


def with_constant_leaves(model: Model) -> Model:
    """`model`, which becomes its `full`, with every leaf of constant stiffness.

    Raises SceneError for leaf springs with weight or stress at rest, and for models with reduced bodies.
    """
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
    alike: dict[tuple[int, bytes], np.ndarray] = {}
    bodies = {}
    for i, name in enumerate(model.member_names):
        d, Q = relative_end_pose(model.arrays.members, i, model.rest)
        # members with the same constants and ends
        key = int(model.arrays.members.value_at[i]), np.round([*d, *Q.ravel()], 12).tobytes()
        if key not in alike:
            alike[key] = rest_stiffness(leaves[name], model.mesh.of(whole_leaf_name(name, wholes)))
        bodies[name] = ConstantLeaf(alike[key], d)
    made = with_bodies(model, bodies)
    for i, body in enumerate(bodies.values()):
        inner = inner_state(made, made.rest, i)
        inner[:3], inner[3:12], inner[18:LINEAR_INNER] = body.place, np.eye(3).ravel(), body.stiffness.ravel()
    return replace(made, full=model)


def equilibrate_bent_leaves(model: Model, motion: State) -> State:
    """The state of the full model at the end poses of one with constant leaves, equilibrium inside every leaf.

    Nodes are moved there in more and more parts, until the leaf springs follow. Raises ConvergenceError where they do not.
    """
    full = model.full
    assert full is not None
    arrays, end = full.arrays, transfer_state(model, motion, full)
    stiffest = max(float(np.abs(body.stiffness[:3, :3]).max()) for body in model.bodies.values())
    least, turns = ROUNDING_TOLERANCE * arrays.size * stiffest, np.empty((len(end.x), 3))
    for R, turn in zip(end.R, turns, strict=True):
        rotation_log(R, turn)
    for parts in PART_COUNTS:
        state, work = full.rest.copy(), make_workspace(arrays)
        state.multiplier[:] = end.multiplier
        for k in range(1, parts + 1):
            state.x[:] = full.rest.x + (k / parts) * (end.x - full.rest.x)
            for R, turn in zip(state.R, turns, strict=True):
                rotation_exp((k / parts) * turn, R)
            if not _settle_inside(arrays, state, work, least):
                break
        else:
            state.R[:] = end.R
            return state
    raise ConvergenceError(
        "the leaf springs cannot follow the poses of method 'constant', which is too far off; ask for less, or use another "
        "method"
    )


def _settle_inside(arrays: Arrays, state: State, work: Workspace, least: float) -> bool:
    """Newton steps inside the leaf springs at held nodes, in place: whether they found equilibrium; changes down to `least`
    [N] are rounding."""
    still, target = np.zeros(arrays.plan.unknowns), np.zeros(len(arrays.terms.start))
    for _ in range(MAX_NEWTON_STEPS):
        before = state.inner.copy()
        assemble(arrays, state, target, 0.0, work, 1e-8, 0, 10.0)
        take_step(arrays, state, still, work, 1.0)
        change = np.abs(state.inner - before).max(initial=0.0)
        if not np.isfinite(change):
            return False
        if change <= max(INNER_STEP_TOLERANCE * np.abs(state.inner).max(initial=0.0), least):
            return True
    return False
