"""Solving with stops and cables: without them first, with contact where that leaves one of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ksd.answers.divergence import count_unstable_directions
from ksd.answers.mesh_adequacy import mode_adequacy
from ksd.checks import number, similar_name_hint
from ksd.errors import ConvergenceError, SceneError
from ksd.model.arrays import Arrays, State
from ksd.model.compile import Model
from ksd.model.contact_step import look_at_gaps
from ksd.model.newton import CONVERGED, RTOL, solve_equilibrium
from ksd.model.plane import Plane
from ksd.numerics.stopwatch import Stopwatch
from ksd.scene.obstacle import check_limits
from ksd.solvers.configuration import Configuration
from ksd.solvers.contact_newton import MAX_CUTS, ContactNewton
from ksd.solvers.contact_state import Touched
from ksd.solvers.leaf_contact import cut_at, cut_state, places_of
from ksd.solvers.load_steps import LoadPath, LoadStepRecord, as_step, take_load_steps
from ksd.solvers.steps import MAX_TURN_PER_STEP, Stop
from ksd.solvers.storage import NewtonStorage, thread_storage
from ksd.solvers.touching import Touching, contact_model, cut_model, touching

Array = NDArray[np.float64]
MAX_ONE_STEP_ITERATIONS = 10
"""Newton iterations of a solve that is tried in one load step, at most."""
NO_POSES = np.zeros((0, 3)), np.zeros((0, 3, 3))
"""Poses at the last equilibrium where there is none but this."""


def contact_values(what: Touching, given: Mapping[str, float]) -> Mapping[str, float]:
    """The values of stops and cables, those given before those of the scene. Raises SceneError for an impossible one."""
    if what.values.keys().isdisjoint(given):
        return what.values
    values = dict(what.values) | {
        name: number(given[name], f"'{name}'", unit="m or rad") for name in what.values if name in given
    }
    for part in what.parts:
        if part.kind == "stop":
            check_limits(
                f"stop '{part.name}'", values.get(f"{part.name}.low"), values.get(f"{part.name}.high")
            )
    return values


def split_values(model: Model, given: Mapping[str, float]) -> tuple[Mapping[str, float], Mapping[str, float]]:
    """Drive values, and values of stops and cables. Raises SceneError for an unknown name."""
    what = touching(model)
    for name in given:
        if name not in what.values and name not in model.drive_names:
            known = (*model.drive_names, *what.values)
            hint = similar_name_hint(name, known)
            raise SceneError(
                f"drive '{name}' is not in this mechanism; its drives are: {', '.join(known)}{hint}"
            )
    own = contact_values(what, given)
    if own is what.values:
        return given, own
    return {name: value for name, value in given.items() if name in model.drive_names}, own


def without_contact_forces(
    found: Configuration, values: Mapping[str, float], storage: NewtonStorage
) -> Configuration | None:
    """The result of a solve without stops and cables where none of them acts on it, None elsewhere."""
    if not found.converged:
        return None
    model, motion = found.model, found.motion
    newton = _spatial(model, storage)
    if newton.what.strips:
        model, motion = _nearest_cut(newton, found)
    what = newton.what
    data = newton.rest_data
    if values is not what.values or what.counts_turns:
        data = what.with_values(np.array(list(values.values())))
        what.count_turns(data, model.arrays, motion)
    out, before = np.empty_like(newton.out), NO_POSES
    if look_at_gaps(what.pairs, data, what.bodies, what.nodes, motion.x, motion.R, *before, out) < 0.0:
        return None
    turned = what.turned(what.normals, out)
    if turned is not None and what.overlap_between(
        turned, out, data, newton.poses(model.rest), newton.poses(motion)
    ):
        return None
    # the result is new, and no one else has it
    found.__dict__["touched"] = Touched(what, values, newton.none, out, NO_POSES, closed=False)
    return found


def act_at_once(
    model: Model, drives: Mapping[str, float], values: Mapping[str, float], storage: NewtonStorage
) -> bool:
    """Whether stops, cables or contacts act in the equilibrium that Newton's method finds without them in the plane, from
    rest in one step of few iterations, so that the solve without them need not be judged."""
    plane, newton, target = model.plane, _spatial(model, storage), model.targets(drives)
    what = newton.what
    if not isinstance(plane, Plane) or what.strips or what.counts_turns or model.turn_to_guess(target):
        return False
    motion, work = model.rest.copy(), storage.planar(plane)
    reason, _, _, negatives, _ = solve_equilibrium(
        plane.arrays, motion, target, 1.0, work, RTOL, MAX_ONE_STEP_ITERATIONS, MAX_TURN_PER_STEP, math.inf
    )
    if reason != CONVERGED or negatives != len(plane.rows):
        return False
    data = newton.rest_data
    if values is not what.values:
        data = what.with_values(np.array(list(values.values())))
    poses, out = newton.poses(motion), np.empty_like(newton.out)
    nodes = np.arange(len(what.nodes))
    return bool(look_at_gaps(what.pairs, data, what.bodies, nodes, *poses, *NO_POSES, out) < 0.0)


def _nearest_cut(newton: ContactNewton, found: Configuration) -> tuple[Model, State]:
    """Model and state of a pose with its leaf springs cut where surfaces are nearest to them; `newton` knows them."""
    cut = cut_model(found.model)
    for _ in range(MAX_CUTS):
        motion = cut_state(found.model, found.motion, cut)
        newton.begin(newton.none)
        newton.cut(cut, motion)
        newton.look(motion, NO_POSES, 1.0)
        moved = newton.better_cut(motion)
        if not moved:
            break
        cut = cut_at(cut, moved)
    return cut, motion


def solve_with_contact(
    model: Model,
    drives: Mapping[str, float],
    values: Mapping[str, float],
    *,
    start: Configuration | None = None,
    planar: bool = True,
    smallest_step: float = 1e-4,
    storage: NewtonStorage | None = None,
) -> Configuration:
    """The equilibrium with stops and cables by load steps, from rest or from a pose; see `ksd.solvers.contact_newton`.

    Raises ConvergenceError with how far the path was taken.
    """
    what, clock, cut = touching(model), Stopwatch(), cut_model(model)
    target = np.concatenate([model.targets(drives), list(values.values())])
    rest = np.concatenate([np.zeros(len(model.arrays.terms.start)), list(what.values.values())])
    forces, begin = np.zeros((len(what.parts), 3)), cut.rest
    factors = (0.0, 1.0)
    if start is not None:
        began = contact_values(what, {} if start.touched is None else start.touched.values)
        rest, begin = np.concatenate([model.targets(start.targets), list(began.values())]), start.motion
        if what.strips:
            cut = cut_at(cut, places_of(start.model) or places_of(cut))
            begin = cut_state(start.model, start.motion, cut)
        forces = forces if start.touched is None else start.touched.forces.copy()
        factors = (start.load_factor, 1.0)
    path = LoadPath(rest, target, factors, smallest_step=smallest_step)
    ways, space, unstable = _ways(model, storage, planar), _spatial(model, storage), 0
    for way in ways:
        how, newton = way
        motion = begin.copy()
        newton.begin(forces)
        newton.cut(cut, begin)
        record = take_load_steps(motion, newton.newton, path, begin=begin)
        if record.stop is Stop.CONVERGED:
            space.cut(newton.model, motion, newton.what)
            space.forces, space.data = newton.forces, newton.data
            residual, unstable = space.check(motion, path.target, path.factors[1], newton.before)
            if residual <= max(1.0, 2.0 * record.residual):
                break
    found = _pose(newton, motion, record, unstable, path, drives, values, how, clock())
    if record.stop is not Stop.CONVERGED:
        raise ConvergenceError(
            f"the solver stopped at {100 * record.fraction_reached:.3g} % of the way, with contact: "
            f"{_pulled_too_far(found, values) or record.stop.sentence}",
            reached=record.fraction_reached,
            result=found,
        )
    return found


def _pulled_too_far(found: Configuration, wanted: Mapping[str, float]) -> str:
    """What to say where a tight cable that is shortened stopped the solver, all else open."""
    assert found.touched is not None
    reached, tight = found.touched.values, {n: c for n, c in found.cables.items() if c.force > 0.0}
    wound = [n for n in tight if wanted[n] > reached[n]]
    if not wound or np.count_nonzero(found.touched.forces[:, 0]) > len(tight):
        return ""
    name = wound[0]
    return (
        f"cable '{name}' cannot be shortened by {1e3 * wanted[name]:.4g} mm: at {1e3 * reached[name]:.4g} mm it pulls with "
        f"{tight[name].force:.3g} N, and nothing gives way to make it shorter; shorten it less, or let it stretch "
        "(stiffness=)"
    )


def _ways(model: Model, storage: NewtonStorage | None, planar: bool) -> list[tuple[str, ContactNewton]]:
    """How load steps may be taken, in words, best first."""
    space, known = _spatial(model, storage), (storage or thread_storage(model)).contact
    plane = model.plane if planar else ""
    if not isinstance(plane, Plane):
        return [("spatial", space)]
    if "planar" not in known:
        axis, rows = plane.axis, plane.rows

        def planar_arrays(model: Model) -> Arrays:
            return Plane(model.arrays, model.rest, axis, rows).arrays

        known["planar"] = (
            None
            if _leaves_plane(space.what, model, plane)
            else ContactNewton(space.what, cut_model(model), planar_arrays)
        )
    if known["planar"] is None:
        return [("spatial", space)]
    return [("planar, 3 unknowns per node", known["planar"]), ("spatial", space)]


def exchange_contacts(storage: NewtonStorage, model: Model) -> None:
    """Go over to other stops, cables and contacts of the same mechanism; model: with these."""
    before, storage.model, what = storage.model, model, touching(model)
    known = storage.contact.get("spatial")
    if known is None or what.strips or known.what.strips or not np.array_equal(known.what.nodes, what.nodes):
        storage.contact.clear()
        return
    model.derived["contact"] = replace(contact_model(before, what.nodes), original_scene=model.original_scene)
    known.exchange(what, model)
    planar, plane = storage.contact.get("planar"), model.plane
    if planar is not None and isinstance(plane, Plane) and not _leaves_plane(what, model, plane):
        planar.exchange(what, model)
    else:
        storage.contact.pop("planar", None)


def _spatial(model: Model, storage: NewtonStorage | None) -> ContactNewton:
    """The iteration in space, prepared once."""
    if storage is None or storage.model is not model:
        storage = thread_storage(model)
    if "spatial" not in storage.contact:
        what = touching(model)
        storage.contact["spatial"] = ContactNewton(what, cut_model(model), lambda model: model.arrays.copy())
    found: ContactNewton = storage.contact["spatial"]
    return found


def _pose(
    newton: ContactNewton, motion: State, record: LoadStepRecord, unstable: int, path: LoadPath,
    drives: Mapping[str, float], values: Mapping[str, float], how: str, time: float,
) -> Configuration:  # fmt: skip
    """The result of load steps with contact; its model has the contact forces as loads."""
    model, (reached, factor) = newton.model, path.values_at(record.fraction_reached)
    rows, count = len(model.arrays.terms.start), len(model.drive_names)
    if record.fraction_reached < 1.0:
        drives = dict(zip(model.drive_names, reached[:count].tolist(), strict=True))
        values = dict(zip(values, reached[rows:].tolist(), strict=True))
    loaded, touched = newton.found(values, converged=record.stop is Stop.CONVERGED)
    found = Configuration(
        loaded, motion, "conventional", dict(drives), (as_step(record, f"{how}, with contact", time),),
        negatives=rows + unstable, expected_negatives=rows, load_factor=factor, touched=touched,
    )  # fmt: skip
    # loads change nothing in it
    found.__dict__["mesh_adequacy"] = mode_adequacy(model, motion)
    return found if model.conservative or not found.converged else _with_divergences(found)


def _with_divergences(found: Configuration) -> Configuration:
    """The result under loads that are not conservative, whose unstable directions are counted with contacts held."""
    try:
        held = found.with_contacts_held
    except SceneError:
        # its verdict says that it is not known
        return found
    rows, negatives = held.expected_negatives, found.negatives - found.expected_negatives
    more = len(held.model.arrays.terms.start) - rows
    counted = count_unstable_directions(held.model, held.motion, found.load_factor, rows + more + negatives)
    return replace(found, negatives=counted - more)


def _leaves_plane(what: Touching, model: Model, plane: Plane) -> bool:
    """Whether a stop or cable acts out of the plane."""
    if not (model.original_scene.stops or model.original_scene.cables):
        return False
    k = plane.normal
    for stop in model.original_scene.stops:
        for term in stop.terms:
            off = abs(float(np.dot(term.direction, k)))
            if (off if term.kind == "translation" else 1.0 - off) > 1e-9:
                return True
    heights = [[float(np.dot(at, k)) for _, at in cable.points] for cable in model.original_scene.cables]
    return any(max(h) - min(h) > 1e-9 * model.arrays.size for h in heights)
