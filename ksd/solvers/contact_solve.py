"""Solving with stops and cables: without them first, with contact where that leaves one of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ksd.answers.divergence import count_unstable_directions
from ksd.checks import number, similar_name_hint
from ksd.errors import ConvergenceError, SceneError
from ksd.model.arrays import Arrays, State, make_workspace
from ksd.model.compile import Model
from ksd.model.gaps import GAP
from ksd.model.plane import Plane, plane_of
from ksd.numerics.stopwatch import Stopwatch
from ksd.scene.obstacle import check_limits
from ksd.solvers.configuration import Configuration
from ksd.solvers.contact_newton import ContactNewton
from ksd.solvers.contact_state import Touched
from ksd.solvers.load_steps import LoadPath, LoadStepRecord, as_step, take_load_steps
from ksd.solvers.steps import Stop
from ksd.solvers.touching import Touching, contact_model, touching

Array = NDArray[np.float64]


def contact_values(what: Touching, given: Mapping[str, float]) -> dict[str, float]:
    """The values of stops and cables, those given before those of the scene. Raises SceneError for an impossible one."""
    values = dict(what.values) | {
        name: number(given[name], f"'{name}'", unit="m or rad") for name in what.values if name in given
    }
    for part in what.parts:
        if part.kind == "stop":
            check_limits(
                f"stop '{part.name}'", values.get(f"{part.name}.low"), values.get(f"{part.name}.high")
            )
    return values


def split_values(model: Model, given: Mapping[str, float]) -> tuple[dict[str, float], dict[str, float]]:
    """Drive values, and values of stops and cables. Raises SceneError for an unknown name."""
    what = touching(model)
    for name in given:
        if name not in what.values and name not in model.drive_names:
            known = (*model.drive_names, *what.values)
            hint = similar_name_hint(name, known)
            raise SceneError(
                f"drive '{name}' is not in this mechanism; its drives are: {', '.join(known)}{hint}"
            )
    drives = {name: value for name, value in given.items() if name in model.drive_names}
    return drives, contact_values(what, given)


def without_contact_forces(found: Configuration, values: Mapping[str, float]) -> Configuration | None:
    """The result of a solve without stops and cables where none of them acts on it, None elsewhere."""
    if not found.converged:
        return None
    what = touching(found.model)
    newton = ContactNewton(what, contact_model(found.model).arrays, make_workspace(found.model.arrays))
    newton.data = what.with_values(np.array(list(values.values())))
    what.count_turns(newton.data, found.model.arrays, found.motion)
    newton.look(found.motion, newton.poses(found.motion))
    if (newton.out[:, GAP] < 0.0).any():
        return None
    return replace(found, touched=Touched(what, values, np.zeros((len(newton.out), 3)), newton.out))


def solve_with_contact(
    model: Model,
    drives: Mapping[str, float],
    values: Mapping[str, float],
    *,
    start: Configuration | None = None,
    planar: bool = True,
    smallest_step: float = 1e-4,
) -> Configuration:
    """The equilibrium with stops and cables by load steps, from rest or from a pose; see `ksd.solvers.contact_newton`.

    Raises ConvergenceError with how far the path was taken.
    """
    what, clock = touching(model), Stopwatch()
    target = np.concatenate([model.targets(drives), list(values.values())])
    rest = np.concatenate([np.zeros(len(model.arrays.terms.start)), list(what.values.values())])
    forces, begin = np.zeros((len(what.parts), 3)), model.rest
    factors = (0.0, 1.0)
    if start is not None:
        began = contact_values(what, {} if start.touched is None else start.touched.values)
        rest, begin = np.concatenate([model.targets(start.targets), list(began.values())]), start.motion
        forces = forces if start.touched is None else start.touched.forces.copy()
        factors = (start.load_factor, 1.0)
    path = LoadPath(rest, target, factors, smallest_step=smallest_step)
    held = contact_model(model)
    plane = plane_of(model) if planar else "planar = False"
    ways: list[tuple[str, Arrays]] = [("spatial", held.arrays)]
    if isinstance(plane, Plane) and not _leaves_plane(what, model, plane):
        ways.insert(
            0, ("planar, 3 unknowns per node", Plane(held.arrays, model.rest, plane.axis, plane.rows).arrays)
        )
    for how, arrays in ways:
        newton, motion = ContactNewton(what, arrays, make_workspace(arrays)), begin.copy()
        newton.forces = forces.copy()
        record = take_load_steps(motion, newton.newton, path, begin=begin)
        space = newton
        if arrays is not held.arrays and record.stop is Stop.CONVERGED:
            space = ContactNewton(what, held.arrays, make_workspace(held.arrays))
            space.forces, space.data = newton.forces, newton.data
            if space.residual(motion, path.target, path.factors[1], newton.before) > max(
                1.0, 2.0 * record.residual
            ):
                continue
        if record.stop is Stop.CONVERGED or how == ways[-1][0]:
            break
    found = _pose(model, held, space, motion, record, path, drives, values, how, clock())
    if record.stop is not Stop.CONVERGED:
        raise ConvergenceError(
            f"the solver stopped at {100 * record.fraction_reached:.3g} % of the way, with contact: {record.stop.sentence}",
            reached=record.fraction_reached,
            result=found,
        )
    return found


def _pose(
    model: Model, held: Model, newton: ContactNewton, motion: State, record: LoadStepRecord, path: LoadPath,
    drives: Mapping[str, float], values: Mapping[str, float], how: str, time: float,
) -> Configuration:  # fmt: skip
    """The result of load steps with contact; its model has the contact forces as loads."""
    reached, factor = path.values_at(record.fraction_reached)
    rows, count = len(model.arrays.terms.start), len(model.drive_names)
    if record.fraction_reached < 1.0:
        drives = dict(zip(model.drive_names, reached[:count].tolist(), strict=True))
        values = dict(zip(values, reached[rows:].tolist(), strict=True))
    arrays, negatives = held.arrays.copy(), rows
    if record.stop is Stop.CONVERGED:
        negatives = rows + newton.count_unstable(motion, path.target, factor)
        arrays.loads.force[newton.loads] = held.arrays.loads.force[newton.loads]
        arrays.loads.moment[newton.loads] = held.arrays.loads.moment[newton.loads]
    touched = Touched(newton.what, dict(values), newton.forces.copy(), newton.out.copy())
    found = Configuration(
        replace(held, arrays=arrays), motion, "conventional", dict(drives), (as_step(record, f"{how}, with contact", time),),
        negatives=negatives, expected_negatives=rows, load_factor=factor, touched=touched,
    )  # fmt: skip
    return found if model.conservative or not found.converged else _with_divergences(found)


def _with_divergences(found: Configuration) -> Configuration:
    """The result under loads that are not conservative, whose unstable directions are counted with contacts held."""
    try:
        held = found.with_contacts_held
    except SceneError as reason:
        return replace(found, doubts=(*found.doubts, f"whether it is stable is not known: {reason}"))
    rows, negatives = held.expected_negatives, found.negatives - found.expected_negatives
    more = len(held.model.arrays.terms.start) - rows
    counted = count_unstable_directions(held.model, held.motion, found.load_factor, rows + more + negatives)
    return replace(found, negatives=counted - more)


def _leaves_plane(what: Touching, model: Model, plane: Plane) -> bool:
    """Whether a stop or cable acts out of the plane."""
    k = plane.normal
    for stop in model.original_scene.stops:
        for term in stop.terms:
            off = abs(float(np.dot(term.direction, k)))
            if (off if term.kind == "translation" else 1.0 - off) > 1e-9:
                return True
    heights = [[float(np.dot(at, k)) for _, at in cable.points] for cable in model.original_scene.cables]
    return any(max(h) - min(h) > 1e-9 * model.arrays.size for h in heights)
