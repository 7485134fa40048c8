"""Total error of a result of any method, that of its mesh included.

Every leaf, however it is modelled (curvature modes, a chain of elements, a modal body), becomes a strain-mode leaf with more
modes than the result has (`ksd.model.mesh.Refined`), and Newton steps lead from the state of the result to equilibrium.
Strain-mode leaves converge exponentially, so that the error of the finer leaf is negligible beside the difference. The error
is computed when it is read: the refined model once per model, a few Newton steps per state. The error of any other answer
(`with_error`) is its change at that equilibrium.

Where `solve` itself chose a fast method, for its error in forces and poses, further questions are answered at the
equilibrium next to its state (`equilibrium_near`); where its error is below NEGLIGIBLE_METHOD_ERROR, questions that take
a Newton step to a finer mesh start from the state itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ksd.answers.derived import cached_per_model
from ksd.answers.finer_model import finer_model, pad_amplitudes
from ksd.answers.forces import SectionForces, forces_of_members
from ksd.answers.leaf_groups import (
    LeafGroup,
    elastic_stiffness,
    end_axes,
    end_frames,
    leaf_groups,
    panel_table_slice,
)
from ksd.answers.tangent import exact_tangent_arrays
from ksd.errors import ConvergenceError
from ksd.model.arrays import Arrays, State, Workspace, make_workspace
from ksd.model.compile import Model, compile_as_is
from ksd.model.leaves import whole_leaf_name
from ksd.model.line_moments import without_shortening
from ksd.model.newton import RTOL, check_residual, solve_equilibrium, take_step
from ksd.model.turns import copy_angles
from ksd.solvers.contact_state import Touched
from ksd.solvers.full_bodies import full_equilibrium
from ksd.solvers.method_error import newton_step_error, relative_error
from ksd.solvers.near_contact import equilibrium_in_contact
from ksd.solvers.result import Result, Solved
from ksd.solvers.steps import FAST_METHODS, MAX_TURN_PER_STEP, ErrorEstimate, Stop

MAX_ITERATIONS = 20
"""Newton steps to the equilibrium on the finer mesh, at most; three or four are usual."""
MAX_REFINED_SOLID = 10_000
"""Degrees of freedom up to which solids are solved on a finer mesh: about 4 s in 3D."""
NEGLIGIBLE_METHOD_ERROR = 1e-5
"""Relative error of a fast method that one Newton step removes: it leaves at most 3e-8 of a compliance or frequency
in random arms and closed loops; of an error of 1e-4 it leaves 5e-6."""
MOMENT_STATIONS = 25
"""Stations along a chain at which its moments are evaluated, to start the strain-mode leaf in its place."""


def error_estimate(pose: Result) -> ErrorEstimate | None:
    """Estimated total error: the distance of a result to the equilibrium next to it on a finer mesh.

    None where the error of a fast method was not estimated, and where nothing converged; all inf where no equilibrium is
    found on the finer mesh, or where the corrector steps of the method's own estimate grow. For reduced solids that
    cannot be meshed again the error of the method alone, with nan for `mesh`.
    """
    own = pose.method_error
    if not pose.converged or (own is None and (pose.method in FAST_METHODS or pose.model.solids)):
        return None
    if own is not None and not math.isfinite(own.relative):
        return own
    if pose.model.solids:
        assert own is not None
        can_remesh = all(pose.model.bodies[name].solid.refine for name in pose.model.solids)
        return _error_of_solids(pose, own) if can_remesh else replace(own, mesh=math.nan)
    model, motion = pose.unreduced_state
    target, factor = model.targets(pose.targets), pose.load_factor
    refined_state = _refined_in_contact(pose)[1] if pose.found_in_contact else refined_equilibrium(pose)[1]
    if refined_state is None:
        return _unknown_error(pose)
    found = relative_error(pose.model, pose.motion, refined_state)
    if pose.method not in FAST_METHODS:
        return replace(found, mesh=found.relative)
    own_mesh_state = find_equilibrium(exact_tangent_arrays(model), motion.copy(), target, factor)
    if own_mesh_state is None:
        return replace(found, mesh=math.inf)
    return replace(found, mesh=relative_error(model, own_mesh_state, refined_state).relative)


def _can_refine_solids(model: Model) -> bool:
    """Whether all solids of a model are small enough to be solved with twice the cells along every axis."""
    solids = [model.bodies[name].solid for name in model.solids]
    return all(s.refine and s.dof_count * (4 if s.is_2d else 8) <= MAX_REFINED_SOLID for s in solids)


def _error_of_solids(pose: Result, own: ErrorEstimate) -> ErrorEstimate:
    """Total error with reduced solids; own: the error of their bases, the distance to the full solids on their own mesh.

    The distance to the equilibrium with full solids of twice the cells, and a third of the change by these. Large solids
    are solved with half the cells instead: the error is `own` and a third of that change. Cells of half the size leave a
    third or less of the error of quadratic elements where end faces are rigid (measured 1/3 to 1/4, with few cells 1/2).
    """
    can_refine = _can_refine_solids(pose.model)
    try:
        model, full_state = _full_solid_equilibrium(pose)
        _, remeshed_state = _full_solid_equilibrium(pose, cell_factor=2.0 if can_refine else 0.5)
    except ConvergenceError:
        return _unknown_error(pose)
    change = relative_error(model, full_state, remeshed_state)
    if can_refine:
        own = relative_error(pose.model, pose.motion, remeshed_state)
    mesh = change.relative * (4 / 3 if can_refine else 1 / 3)
    return replace(own.plus(change, 1 / 3), mesh=mesh)


def _unknown_error(pose: Result) -> ErrorEstimate:
    """Error estimate where neither the error nor its part from the mesh is known: all inf."""
    return ErrorEstimate.unknown(len(pose.model.drive_names), mesh=math.inf)


def _full_solid_equilibrium(pose: Result, *, cell_factor: float = 1.0) -> tuple[Model, State]:
    """Model and equilibrium with full solids next to a pose with reduced ones. Raises ConvergenceError.

    cell_factor: factor on the cells along every axis; unless it is 1, leaf springs are on the refined mesh.
    """
    model, motion, load_factor = pose.model, pose.motion, pose.load_factor
    leaves = None
    if cell_factor != 1.0:
        fine = refined_model(model)
        leaves = fine, _initial_state(model, motion, fine, load_factor)
    return full_equilibrium(
        model, motion, model.targets(pose.targets), load_factor, leaves=leaves, cell_factor=cell_factor
    )


def refined_equilibrium(pose: Result) -> tuple[Model, State | None, int]:
    """The model on the refined mesh, the equilibrium on it next to the state of `pose` (None where none is found), and its
    negative pivots."""
    model, motion = pose.unreduced_state
    factor = pose.load_factor
    fine = _refined_at(model, factor)
    state = _initial_state(model, motion, fine, factor)
    stop, negatives = converge(fine.arrays, state, model.targets(pose.targets), factor)
    return fine, state if stop is Stop.CONVERGED else None, negatives


def _refined_in_contact(pose: Result) -> tuple[Model, State | None, Touched | None]:
    """`refined_equilibrium` of a pose found in contact: model, state and contacts."""
    model, motion = pose.unreduced_state
    fine = _refined_at(model, pose.load_factor)
    state = _initial_state(model, motion, fine, pose.load_factor)
    return equilibrium_in_contact(pose, fine, state) or (fine, None, None)


def refined_configuration(pose: Solved) -> Solved:
    """The equilibrium on the refined mesh next to a state; for reduced solids that of the full
    solids, with twice the cells where they are small enough.

    Raises ConvergenceError where Newton steps find none.
    """
    if pose.model.solids:
        cell_factor = 2.0 if _can_refine_solids(pose.model) else 1.0
        model, motion = _full_solid_equilibrium(pose, cell_factor=cell_factor)
        return replace(pose, model=model, motion=motion, method="conventional", method_error=None)
    negatives, touched = pose.negatives, pose.touched
    if pose.found_in_contact:
        fine, state, touched = _refined_in_contact(pose)
    else:
        fine, state, negatives = refined_equilibrium(pose)
    if state is None:
        raise ConvergenceError(
            "the error of this answer is not known: Newton steps find no equilibrium next to it on a finer mesh; ask the "
            "question of method='full' on a finer mesh"
        )
    return replace(
        pose, model=fine, motion=state, negatives=negatives, method="conventional", method_error=None,
        method_was_chosen=False, touched=touched,
    )  # fmt: skip


def equilibrium_near(pose: Result) -> State:
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
    """As `converge`, from the state of a fast method: a first step below NEGLIGIBLE_METHOD_ERROR is the last one, and the
    residual after it is not checked."""
    _, negatives, status = check_residual(model.arrays, state, target, factor, work)
    step_size = newton_step_error(model, state, work.rhs).relative
    if math.isfinite(step_size):
        take_step(model.arrays, state, work.rhs, work, 1.0)
    if step_size <= NEGLIGIBLE_METHOD_ERROR and status == 0:
        return Stop.CONVERGED, negatives
    return converge(model.arrays, state, target, factor, work)


def refinement_step_suffices(pose: Result) -> bool:
    """Whether the Newton step that questions on a finer mesh take (`ksd.answers.finer_model`) leads equally close to the
    equilibrium from the state of a fast method as from the equilibrium next to it."""
    own, model = pose.method_error, pose.model
    return (
        own is not None
        and own.relative <= NEGLIGIBLE_METHOD_ERROR
        and model.has_strain_leaves_only
        and finer_model(model) is not model
    )


def with_error(pose: Solved, question: Callable[[Solved], Any]) -> tuple[Any, Any]:
    """The answer of question(pose) (number, array, or mapping of them) and, in the same shape, its error: the absolute
    change to the answer of `refined_configuration`."""
    answer, refined_answer = question(pose), question(refined_configuration(pose))
    if isinstance(answer, Mapping):
        return answer, {k: _absolute_change(v, refined_answer[k]) for k, v in answer.items()}
    return answer, _absolute_change(answer, refined_answer)


def _absolute_change(one: Any, other: Any) -> Any:
    """Absolute difference of two answers, numbers or arrays."""
    change = np.abs(np.asarray(other, float) - np.asarray(one, float))
    return float(change) if change.ndim == 0 else change


def find_equilibrium(arrays: Arrays, state: State, target: np.ndarray, factor: float) -> State | None:
    """As `converge`: the state at equilibrium, None where none is found."""
    return state if converge(arrays, state, target, factor)[0] is Stop.CONVERGED else None


def converge(
    arrays: Arrays, state: State, target: np.ndarray, factor: float, work: Workspace | None = None
) -> tuple[Stop, int]:
    """Take Newton steps to equilibrium from a state, in place, at drives target (c,) and loads times factor.

    work: workspace, made when None. Returns the stop reason and the negative pivots.
    """
    work = make_workspace(arrays) if work is None else work
    reason, *_, negatives, _ = solve_equilibrium(
        arrays, state, target, factor, work, RTOL, MAX_ITERATIONS, MAX_TURN_PER_STEP, math.inf
    )
    return Stop(reason), int(negatives)


@cached_per_model
def refined_model(model: Model) -> Model:
    """The model with every leaf as a strain-mode leaf of more modes; the nodes are those of `model` without chain nodes."""
    return compile_as_is(model.scene, model.mesh.refined(), model.original_scene, model.choice)


def _refined_at(model: Model, load_factor: float) -> Model:
    """`refined_model`, without what the points of moments along leaf springs shorten these by at a load factor."""
    if not any(line.has_moment for line in model.scene.line_loads):
        return refined_model(model)
    scene = without_shortening(model.scene, load_factor)
    return compile_as_is(scene, model.mesh.refined(), model.original_scene, model.choice)


def _initial_state(model: Model, motion: State, fine: Model, load_factor: float) -> State:
    """The state to start from on the finer model: nodes and multipliers of the coarser one; amplitudes of curvature modes
    those of the coarser one, or from the moments along its chains."""
    state, members, more = fine.rest.copy(), model.arrays.members, fine.arrays.members
    node = {name: k for k, name in enumerate(model.node_names)}
    same = [node[name] for name in fine.node_names]
    state.x[:], state.R[:], state.multiplier[:] = motion.x[same], motion.R[same], motion.multiplier
    copy_angles(model.arrays, motion, fine.arrays, state, of=same)
    index = {name: k for k, name in enumerate(fine.member_names)}
    chains: dict[str, list[int]] = {}
    for i, name in enumerate(model.member_names):
        if i in model.strain_leaves:
            k, inner = index[name], motion.inner[members.inner_at[i] : members.inner_at[i + 1]]
            own = slice(more.inner_at[k], more.inner_at[k + 1])
            pad_amplitudes(members.number[i], inner, more.number[k], state.inner[own])
        elif i in model.chains:
            chains.setdefault(whole_leaf_name(name, index), []).append(i)
    forces = forces_of_members(model, motion, chains, MOMENT_STATIONS, load_factor) if chains else {}
    for group in leaf_groups(fine):
        rows = [r for r, k in enumerate(group.members) if fine.member_names[k] in chains]
        if not rows:
            continue
        which, value, places = group.members[rows], group.value[rows], group.inner_index[rows]
        along = [forces[fine.member_names[k]] for k in which]
        Q = end_axes(fine, state, which, end_frames(fine, state, which))
        wrench = np.array([f.end for f in along]).reshape(-1, 2, 3) @ Q.swapaxes(1, 2)
        state.inner[places[:, : group.modes]] += _amplitudes_from_moments(replace(group, value=value), along)
        state.inner[places[:, group.modes :]] = wrench.reshape(-1, 6)
    return state


def _amplitudes_from_moments(group: LeafGroup, forces: list[SectionForces]) -> np.ndarray:
    """Amplitudes (k, N) of the curvature modes of the leaf springs of a group under given section forces along them."""
    value, N, (*orders, ng) = group.value, group.modes, group.number[:4].tolist()
    # layout of `ksd.elements.strain_values`
    at = panel_table_slice(group.number).start
    weight, integral, basis = np.split(value[:, at : at + ng * (1 + ng + N)], [ng, ng + ng * ng], axis=1)
    s = integral[0].reshape(ng, ng).sum(axis=1)
    moment = np.array([[np.interp(s, f.s / f.s[-1], m) for m in f.values.T[3:]] for f in forces])
    weighted = (basis.reshape(-1, N, ng) * weight[:, None] * np.repeat(moment, orders, axis=1)).sum(axis=2)
    return np.asarray(np.linalg.solve(elastic_stiffness(group), (value[:, :1] * weighted)[..., None])[..., 0])
