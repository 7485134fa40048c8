"""What an answer of any method is off the truth, its mesh included.

Every leaf, whatever stands for it (curvature modes, a chain of elements, a modal body), becomes a strain-mode leaf with more
modes than the answer has (`ksd.model.mesh.Refined`), and Newton steps lead from the state of the answer to equilibrium.
Strain-mode leaves converge exponentially, so what such a leaf misses is nothing beside what it finds. Done when the error is
asked for: the model once, a few Newton steps for every state. The error of any other answer (`with_error`) is its change to
the same question asked of that equilibrium.

Where `solve` itself took a fast method, for its error in forces and poses, further questions are asked of the equilibrium
next to its state (`settled`); of the state itself those that take a Newton step to a finer mesh, where its error is below
NEAR.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ksd.errors import ConvergenceError
from ksd.model.arrays import COROTATIONAL, STRAIN, Arrays, State, Workspace, make_workspace
from ksd.model.compile import Model, compile_as_is
from ksd.model.leaves import whole_leaf_name
from ksd.model.newton import check_residual, solve_equilibrium, take_step
from ksd.properties.cache import cached_per_model
from ksd.properties.finer_model import finer_model, pad_amplitudes
from ksd.properties.forces import SectionForces, forces_of_members
from ksd.properties.leaf_groups import (
    LeafGroup,
    elastic_stiffness,
    end_axes,
    end_frames,
    leaf_groups,
    panel_table_slice,
)
from ksd.properties.tangent import exact_tangent_arrays
from ksd.solve.full_bodies import full_equilibrium
from ksd.solve.method_error import newton_step_error, relative_error
from ksd.solve.steps import FAST_METHODS, MAX_TURN_PER_STEP, RTOL, ErrorEstimate, Stop

if TYPE_CHECKING:
    from ksd.solve.configuration import Configuration

MAX_ITERATIONS = 20
"""Newton steps to the equilibrium on the finer mesh; three or four are usual."""
FINE_SOLID = 10_000
"""Degrees of freedom up to which solids are solved on a finer mesh: about 4 s in 3D."""
NEGLIGIBLE_METHOD_ERROR = 1e-5
"""Relative error of a fast method of which a Newton step leaves nothing: 3e-8 of a compliance or frequency at most in random
arms and closed loops; 5e-6 of an error of 1e-4."""
STATIONS = 25
"""Stations along a leaf at which its moments are taken where another leaf model asks for them."""


def error_estimate(pose: Configuration) -> ErrorEstimate | None:
    """The distance of an answer to the equilibrium next to it on a finer mesh.

    None where the method's own error was not estimated, and of what did not converge; without bound where no equilibrium
    is found on the finer mesh, or where corrector steps of the method's own estimate grow. Of reduced solids that
    cannot be meshed again the method's alone, and `mesh` is nan.
    """
    own = pose.method_error
    if not pose.converged or (own is None and (pose.method in FAST_METHODS or pose.model.solids)):
        return None
    if own is not None and not math.isfinite(own.relative):
        return own
    if pose.model.solids:
        assert own is not None
        known = all(pose.model.bodies[name].solid.refine for name in pose.model.solids)
        return _of_solids(pose, own) if known else replace(own, mesh=math.nan)
    model, motion = pose.unreduced_state
    target, factor = model.targets(pose.targets), pose.load_factor
    _, truth, _ = refined_equilibrium(pose)
    if truth is None:
        return _lost(pose)
    found = relative_error(pose.model, pose.motion, truth)
    if pose.method not in FAST_METHODS:
        return replace(found, mesh=found.relative)
    settled = equilibrium(exact_tangent_arrays(model), motion.copy(), target, factor)
    return replace(
        found, mesh=math.inf if settled is None else relative_error(model, settled, truth).relative
    )


def _finer(model: Model) -> bool:
    """Whether all solids of a model are small enough to be solved with twice the cells along every axis."""
    solids = [model.bodies[name].solid for name in model.solids]
    return all(s.refine and s.dof_count * (4 if s.is_2d else 8) <= FINE_SOLID for s in solids)


def _of_solids(pose: Configuration, own: ErrorEstimate) -> ErrorEstimate:
    """The distance to the equilibrium with whole solids on a mesh with twice the cells, and a third of what these change;
    own: the distance to that on their own mesh.

    Of large solids the latter, and a third of what half the cells change: so much or less is left of the error of quadratic
    elements by cells of half the size, where end faces are rigid (measured 1/3 to 1/4, with few cells 1/2).
    """
    finer = _finer(pose.model)
    try:
        model, whole = _whole(pose)
        _, other = _whole(pose, times=2.0 if finer else 0.5)
    except ConvergenceError:
        return _lost(pose)
    change = relative_error(model, whole, other)
    if finer:
        own = relative_error(pose.model, pose.motion, other)
    return ErrorEstimate(
        own.force + change.force / 3,
        own.displacement + change.displacement / 3,
        own.rotation + change.rotation / 3,
        own.relative + change.relative / 3,
        change.relative * (4 / 3 if finer else 1 / 3),
    )


def _lost(pose: Configuration) -> ErrorEstimate:
    """Without bound."""
    return ErrorEstimate(np.full(len(pose.model.drive_names), math.inf), *4 * (math.inf,))


def _whole(pose: Configuration, *, times: float = 1.0) -> tuple[Model, State]:
    """Model and equilibrium with whole solids next to a pose with reduced ones, with so many times their cells along every
    axis, beside leaf springs on a finer mesh then. Raises ConvergenceError."""
    model, motion, factor = pose.model, pose.motion, pose.load_factor
    leaves = None
    if times != 1.0:
        fine = refined(model)
        leaves = fine, _started(model, motion, fine, factor)
    return full_equilibrium(model, motion, model.targets(pose.targets), factor, leaves=leaves, times=times)


def refined_equilibrium(pose: Configuration) -> tuple[Model, State | None, int]:
    """The model on the finer mesh, the equilibrium next to the state of `pose` on it (None where none is found), and its
    negative pivots."""
    model, motion = pose.unreduced_state
    fine, factor = refined(model), pose.load_factor
    state = _started(model, motion, fine, factor)
    stop, negatives = converge(fine.arrays, state, model.targets(pose.targets), factor)
    return fine, state if stop is Stop.CONVERGED else None, negatives


def refined_configuration(pose: Configuration) -> Configuration:
    """The equilibrium next to the state on the finer mesh of `ksd.solve.error.refined`; of reduced solids that of the whole
    solids, with twice the cells where they are small enough.

    Raises ConvergenceError where Newton steps find none.
    """
    if pose.model.solids:
        model, motion = _whole(pose, times=2.0 if _finer(pose.model) else 1.0)
        return replace(pose, model=model, motion=motion, method="conventional", method_error=None)
    fine, state, negatives = refined_equilibrium(pose)
    if state is None:
        raise ConvergenceError(
            "the error of this answer cannot be told: Newton steps find no equilibrium next to it on a finer mesh; ask the "
            "question of method='full' on a finer mesh"
        )
    return replace(
        pose,
        model=fine,
        motion=state,
        negatives=negatives,
        method="conventional",
        method_error=None,
        method_was_chosen=False,
    )


def equilibrium_near(pose: Configuration) -> State:
    """The equilibrium of the full model next to the state of a fast method.

    Raises ConvergenceError where Newton steps from there do not reach one.
    """
    model, motion, target = pose.model, pose.motion.copy(), pose.model.targets(pose.targets)
    stop, _ = converge_fast_state(model, motion, target, pose.load_factor, make_workspace(model.arrays))
    if stop is not Stop.CONVERGED:
        raise ConvergenceError(
            f"no equilibrium found next to the {pose.method} answer ({stop.sentence}); ask the question of "
            "method='full'"
        )
    return motion


def converge_fast_state(
    model: Model, state: State, target: np.ndarray, factor: float, work: Workspace
) -> tuple[Stop, int]:
    """`settle` from the state of a fast method, in place: a first step below NEAR is the last, not looked at again."""
    _, negatives, status = check_residual(model.arrays, state, target, factor, work, RTOL)
    size = newton_step_error(model, state, work.rhs).relative
    if math.isfinite(size):
        take_step(model.arrays, state, work.rhs, work, 1.0)
    if size <= NEGLIGIBLE_METHOD_ERROR and status == 0:
        return Stop.CONVERGED, negatives
    return converge(model.arrays, state, target, factor, work)


def refinement_step_suffices(pose: Configuration) -> bool:
    """Whether the Newton step that questions on a finer mesh take themselves (`ksd.properties.finer_model`) leads from the
    state of a fast method as far as from the equilibrium next to it."""
    own, model = pose.method_error, pose.model
    return (
        own is not None
        and own.relative <= NEGLIGIBLE_METHOD_ERROR
        and model.kinds <= {STRAIN}
        and finer_model(model) is not model
    )


def with_error(pose: Configuration, question: Callable[[Configuration], Any]) -> tuple[Any, Any]:
    """The answer of question(pose) and its error, that of method and mesh: |change| to the answer of `corrected`, in the
    shape of the answer (number, array, or mapping of them)."""
    answer, better = question(pose), question(refined_configuration(pose))
    if isinstance(answer, Mapping):
        return answer, {k: _change(v, better[k]) for k, v in answer.items()}
    return answer, _change(answer, better)


def _change(one: Any, other: Any) -> Any:
    found = np.abs(np.asarray(other, float) - np.asarray(one, float))
    return float(found) if found.ndim == 0 else found


def equilibrium(arrays: Arrays, state: State, target: np.ndarray, factor: float) -> State | None:
    """The equilibrium next to a state, in place, drives at target (c,) and loads times factor; None where none is found."""
    return state if converge(arrays, state, target, factor)[0] is Stop.CONVERGED else None


def converge(
    arrays: Arrays, state: State, target: np.ndarray, factor: float, work: Workspace | None = None
) -> tuple[Stop, int]:
    """Newton steps from `state`, in place, drives at target (c,) and loads times factor: how they ended, and negative
    pivots. work: storage, made when None."""
    work = make_workspace(arrays) if work is None else work
    reason, *_, negatives, _ = solve_equilibrium(
        arrays, state, target, factor, work, RTOL, MAX_ITERATIONS, MAX_TURN_PER_STEP, math.inf
    )
    return Stop(reason), int(negatives)


@cached_per_model
def refined(model: Model) -> Model:
    """The model with every leaf as a strain-mode leaf of more modes; its nodes are those of `model` but for chain nodes."""
    return compile_as_is(model.scene, model.mesh.refined())


def _started(model: Model, motion: State, fine: Model, load_factor: float) -> State:
    """The state on the finer model: same nodes and multipliers; amplitudes taken over, or from the moments along chains."""
    state, members, more = fine.rest.copy(), model.arrays.members, fine.arrays.members
    node = {name: k for k, name in enumerate(model.node_names)}
    same = [node[name] for name in fine.node_names]
    state.x[:], state.R[:], state.multiplier[:] = motion.x[same], motion.R[same], motion.multiplier
    place = {name: k for k, name in enumerate(fine.member_names)}
    chains: dict[str, list[int]] = {}
    for i, name in enumerate(model.member_names):
        if members.kind[i] == STRAIN:
            k, inner = place[name], motion.inner[members.inner_at[i] : members.inner_at[i + 1]]
            pad_amplitudes(members.number[i], inner, more.number[k], state.inner[more.inner_at[k] :])
        elif members.kind[i] == COROTATIONAL:
            chains.setdefault(whole_leaf_name(name, place), []).append(i)
    forces = forces_of_members(model, motion, chains, STATIONS, load_factor) if chains else {}
    for group in leaf_groups(fine):
        rows = [r for r, k in enumerate(group.members) if fine.member_names[k] in chains]
        if not rows:
            continue
        which, value, places = group.members[rows], group.value[rows], group.inner_index[rows]
        along = [forces[fine.member_names[k]] for k in which]
        Q = end_axes(fine, state, which, end_frames(fine, state, which))
        wrench = np.array([f.end for f in along]).reshape(-1, 2, 3) @ Q.swapaxes(1, 2)
        state.inner[places[:, : group.modes]] += _bent(replace(group, value=value), along)
        state.inner[places[:, group.modes :]] = wrench.reshape(-1, 6)
    return state


def _bent(group: LeafGroup, forces: list[SectionForces]) -> np.ndarray:
    """Amplitudes (k, N) that the section forces along the leaf springs of a group call for."""
    value, N, (*orders, ng) = group.value, group.modes, group.number[:4].tolist()
    # as `ksd.beam.strain_values` lays it out
    at = panel_table_slice(group.number).start
    weight, integral, basis = np.split(value[:, at : at + ng * (1 + ng + N)], [ng, ng + ng * ng], axis=1)
    s = integral[0].reshape(ng, ng).sum(axis=1)
    moment = np.array([[np.interp(s, f.s / f.s[-1], m) for m in f.values.T[3:]] for f in forces])
    weighted = (basis.reshape(-1, N, ng) * weight[:, None] * np.repeat(moment, orders, axis=1)).sum(axis=2)
    return np.asarray(np.linalg.solve(elastic_stiffness(group), (value[:, :1] * weighted)[..., None])[..., 0])
