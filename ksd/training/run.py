"""Training from start to finish: sample shapes until the fit is good enough, check it on fresh shapes, write the
record."""

from __future__ import annotations

import datetime
import itertools
import math
import os
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

import numpy as np

from ksd.checks import clear_argument_errors, warn_user
from ksd.errors import ConvergenceError, RecordError, SceneError
from ksd.library import Evidence, Functions, Mesh, Record, Residual, Stroke, read_record, write_record
from ksd.library.functions import Array, legendre_products, monomials
from ksd.library.record_files import RECORD_SUFFIX
from ksd.model.leaves import leaf_orders
from ksd.model.mesh import Mesh as LeafMesh
from ksd.scene import DrawnJoint, Joint
from ksd.training.catalogue import design_of
from ksd.training.designs import Design, irrelevant_changes
from ksd.training.fit import REFUSED_MISS, TOLERANCE, Fit, fit_functions, missed_errors
from ksd.training.jobs import Job, Jobs
from ksd.training.probes import check_probes, probes_of
from ksd.training.request_checks import check_design, check_meshes
from ksd.training.sampling import Samples, SamplingPlan, chebyshev_line, even_line
from ksd.training.softness import check_soft, listed_values
from ksd.version import __version__

MODE_ORDERS = (4, 3, 5)
"""Least numbers of curvature modes of a leaf: torsion, strong and weak bending."""
GRID_POINTS = {1: 25, 2: 11}
"""Grid points per motion, by number of motions."""
CORNER_POINTS = 9
"""Points per motion of the checks at the corners of the shapes."""
RELEVANT_CHANGE = 1e-4
"""Change of a pose [rad, joint lengths] above which train warns of a parameter that a record leaves out."""
WARNED_MISS = 10.0
"""Errors on fresh shapes over the wanted ones of TOLERANCE, above which train warns."""
FIRST_ROUND_SHAPES, FRESH_SHAPES = 16, 8
"""Shapes of the first round (doubled from round to round), and shapes reserved for the check."""


@clear_argument_errors
def train(
    family_or_joint: str | Joint | Design,
    *,
    shapes: Mapping[str, tuple[float, float]] | None = None,
    meshes: tuple[Mesh, ...] | None = None,
    out: str | os.PathLike[str] | None = None,
    executor: Executor | None = None,
    resume: bool = True,
    progress: bool = True,
    trained: str | None = None,
    most_shapes: int = 512,
    tolerance: Mapping[str, float] | None = None,
) -> Record:
    """Train a joint family (by name or `Design`) or one joint as drawn, write its record and return it.

    family_or_joint: name of a family of the catalogue, a joint, or a `Design`; progress: whether to show a progress
    bar. shapes: ranges {parameter: (low, high)} SI in place of those of the family. meshes: "strain" and numbers of
    Appendix A elements per leaf; those of the design when None. out: folder or .h5 file; $KSD_DATABASE or ./database
    when None; records elsewhere are found only where KSD_DATABASE names their folder. executor: any
    `concurrent.futures` executor; two processes when None. resume: use the shapes that an interrupted run has finished
    (stored next to the record in a .partial folder, also on Ctrl-C). trained: date written into the record, ISO, today
    when None; the same inputs give the same bytes. most_shapes: limit of the adaptive sampling. tolerance: wanted
    errors by group, see TOLERANCE.

    Raises SceneError for unknown names and for joints that cannot be represented (see `ksd.training.sampling`; also
    where the functions miss the wanted errors by more than REFUSED_MISS times), RecordError when the record cannot be
    written. Warns (UserWarning) when the wanted errors are missed.

    >>> from concurrent.futures import ThreadPoolExecutor
    >>> record = ksd.train(
    ...     "circular_notch", shapes={"slenderness": (0.05, 0.06)}, meshes=(1,),
    ...     out="notch.h5", executor=ThreadPoolExecutor(1), progress=False,
    ... )
    >>> record.family, record.parameters[0].high
    ('circular_notch', 0.06)
    """
    design = design_of(family_or_joint, shapes)
    check_design(design)
    requested_meshes = design.meshes if meshes is None else check_meshes(design.family, meshes)
    target = record_path(design.family, out)
    folder = target.with_name(f".{target.stem}.partial")
    title = f"train {design.family}"
    with Jobs(folder, executor=executor, resume=resume, progress=progress, title=title) as jobs:
        tolerances = {group: design.tolerance_factor * value for group, value in TOLERANCE.items()} | dict(
            tolerance or {}
        )
        record = _sample_and_fit(design, requested_meshes, jobs, tolerances, most_shapes)
    date = trained or datetime.date.today().isoformat()
    record = replace(record, trained=date, history=(f"{date}: {record.history[0]}",))
    write_record(record, target)
    jobs.forget()
    return record


def _sample_and_fit(
    design: Design, meshes: tuple[Mesh, ...], jobs: Jobs, tolerances: Mapping[str, float], max_shapes: int
) -> Record:
    """Sample, fit, check on fresh shapes and collect evidence: the record without its date."""
    middle = design.joint(np.zeros(len(design.parameters)))
    corners = _corner_joints(design)
    for joint in corners if len(corners) == 1 else (middle, *corners):
        check_soft(joint)
    plan, check_plan = _sampling_plans(middle, meshes, _common_orders(corners))
    evidence = _evidence(design, middle, plan, jobs)
    _check_corners(corners, plan, jobs)
    _warn_of_relevant_others(design, evidence)
    design = replace(design, idle=_irrelevant_parameters(design, evidence, tolerances, plan, jobs))
    places, samples, fit = _fit_in_rounds(design, plan, jobs, tolerances, max_shapes)
    fresh_places = _fresh_places(design)
    fresh = jobs.run([Job(design.joint(p), check_plan) for p in fresh_places])
    residuals = _residuals(fit, plan, check_plan, (places, samples), (fresh_places, fresh))
    _check_missed_errors(design, fit, residuals)
    sentence = (
        f"trained on {len(places)} shapes, checked on {len(fresh)} fresh ones; total degrees "
        f"{fit.motion_degree} in the motions, {fit.shape_degree} in the shape; leave-one-out errors over "
        f"tolerance {fit.motion_error:.2g} and {fit.shape_error:.2g}."
        + (f" No dependence on {', '.join(design.idle)}." if design.idle else "")
    )
    record = _record(design, middle, plan, fit, samples[0])
    return replace(
        record,
        probes=probes_of(record, fresh_places, check_plan.grid),
        residuals=residuals,
        evidence=evidence,
        samples=(len(places), len(fresh)),
        version=__version__,
        history=(sentence,),
    )


def up_to_date(family_or_joint: str | Joint | Design, *, out: str | os.PathLike[str] | None = None) -> str:
    """Agreement of the record that `train` would replace with this code, in words; empty where it has to be trained.

    It has to be trained where there is no readable record, where the record is of another joint, other ranges, meshes
    or larger errors, or where its probe states differ from the stored values.
    """
    design = design_of(family_or_joint)
    target = record_path(design.family, out)
    if not target.is_file():
        return ""
    corners = _corner_joints(design)
    expected = _empty_record(design, design.joint(np.zeros(len(design.parameters))), _common_orders(corners))
    try:
        record = read_record(target)
        same_design = all(getattr(record, name) == getattr(expected, name) for name in DESIGN_FIELDS)
        within_tolerance = all(
            r.fit_rms <= design.tolerance_factor * TOLERANCE[r.group] for r in record.residuals
        )
        if not (same_design and within_tolerance and set(record.functions) == set(design.meshes)):
            return ""
        return check_probes(record, design)
    except (RecordError, SceneError, ConvergenceError):
        return ""


def _check_missed_errors(design: Design, fit: Fit, residuals: tuple[Residual, ...]) -> None:
    """Warn where the functions miss the wanted errors; raise SceneError where they are far from the joint."""
    fitted, missed = missed_errors(residuals, design.tolerance_factor)
    if missed > REFUSED_MISS:
        raise SceneError(
            f"{design.family}: the functions miss the joint by {missed:.2g} times the wanted errors, so that no record is "
            + (
                "written: over the stroke it is not smooth, as where a leaf spring buckles; reduce its range of motion."
                if fit.motion_error > fit.shape_error and fitted > REFUSED_MISS
                else "written: they do not follow its shape; reduce the range of the shape, or raise most_shapes."
            )
        )
    if not fit.converged or missed > WARNED_MISS:
        missed = max(missed, fit.motion_error, fit.shape_error)
        warn_user(
            f"{design.family}: the functions are fitted no better than {missed:.2g} times the wanted errors; the residuals "
            "in the record tell them. Reduce the range of motion or of the shape, or raise most_shapes.",
            UserWarning,
        )


def _warn_of_relevant_others(design: Design, evidence: tuple[Evidence, ...]) -> None:
    """Warn of further parameters of a design that matter but are not shape parameters of the record."""
    for name in design.others:
        largest = max(e.interface for e in evidence if e.parameter == name)
        if largest > RELEVANT_CHANGE:
            warn_user(
                f"{design.family}: {name} moves interface B or a block by {largest:.2g} (rad or joint lengths), and the "
                "record does not know it; make it one of the parameters.",
                UserWarning,
            )


def record_path(family: str, out: str | os.PathLike[str] | None) -> Path:
    """Path of the record of `family`: in folder or .h5 file `out`, $KSD_DATABASE or ./database when None."""
    folder = Path(out or os.environ.get("KSD_DATABASE") or "database")
    return folder if folder.suffix == RECORD_SUFFIX else folder / f"{family}{RECORD_SUFFIX}"


def _strokes(joint: Joint) -> tuple[Stroke, ...]:
    """Intended motions of a joint with their ranges in rad or joint lengths."""
    strokes = []
    for motion in joint.motions:
        unit = joint.length if motion.kind == "translation" else 1.0
        low, high = (v / unit for v in motion.range)
        strokes.append(Stroke(motion.name, motion.kind, low, high))
    return tuple(strokes)


def _corner_joints(design: Design) -> list[DrawnJoint]:
    """The joint at every corner of the shapes. Raises SceneError, naming the shape, where it cannot be drawn."""
    ends = [(-1.0, 1.0) if p.high > p.low else (0.0,) for p in design.parameters]
    joints = []
    for places in itertools.product(*ends):
        try:
            joints.append(design.joint(np.array(places)))
        except SceneError as error:
            shape = listed_values(design.shape(np.array(places)))
            raise SceneError(
                f"{design.family}: the range of shapes holds one that cannot be drawn, {shape}: {error}"
            ) from None
    return joints


def _common_orders(corners: list[DrawnJoint]) -> tuple[int, int, int]:
    """Curvature modes sufficient for every leaf at every corner of the shapes; curved leaf springs need more of them."""
    mesh = LeafMesh("strain", orders=MODE_ORDERS, points=max(MODE_ORDERS) + 2)
    orders = [leaf_orders(leaf, mesh)[0] for joint in corners for leaf in joint.leaves()]
    nx, ny, nz = (max(o[axis] for o in orders) for axis in range(3))
    return nx, ny, nz


def _sampling_plans(
    joint: Joint, meshes: tuple[Mesh, ...], orders: tuple[int, int, int]
) -> tuple[SamplingPlan, SamplingPlan]:
    """Plans of the samples for the fit, and of those for the check at other points of the stroke."""
    ranges = [motion.range for motion in joint.motions]
    count = GRID_POINTS[len(ranges)]
    fitted = tuple(chebyshev_line(low, high, count) for low, high in ranges)
    checked = tuple(even_line(low, high, count - 2) for low, high in ranges)
    return SamplingPlan(fitted, meshes, orders), SamplingPlan(checked, meshes, orders)


def _check_corners(corners: list[DrawnJoint], plan: SamplingPlan, jobs: Jobs) -> None:
    """Solve the joint at every corner of the shapes over its whole stroke.

    Raises SceneError, naming shape and motion, where it buckles, leaves its plane or its leaf springs collide; shapes
    between the corners are checked when they are sampled.
    """
    lines = tuple(even_line(*motion.range, CORNER_POINTS) for motion in corners[0].motions)
    whole_stroke = SamplingPlan(lines, ("strain",), plan.orders, check_whole_stroke=True)
    jobs.run([Job(joint, whole_stroke) for joint in corners])


def _varying_parameters(design: Design) -> list[int]:
    """Indices of the parameters with a range."""
    return [i for i, p in enumerate(design.parameters) if p.high > p.low]


def _fitted_parameters(design: Design) -> list[int]:
    """Indices of the parameters that have a range and matter."""
    return [i for i in _varying_parameters(design) if design.parameters[i].name not in design.idle]


def _irrelevant_parameters(
    design: Design,
    evidence: tuple[Evidence, ...],
    tolerances: Mapping[str, float],
    plan: SamplingPlan,
    jobs: Jobs,
) -> tuple[str, ...]:
    """Shape parameters that change no function by more than its wanted error, neither at their ends nor at fresh shapes,
    where they are put in the middle (a parameter can have an effect between ends that equal the middle).

    The record leaves them out; fresh shapes vary them nevertheless.
    """
    relevant = {
        e.parameter
        for e in evidence
        if e.interface > tolerances["interface"] or e.rotations > tolerances["rotations"]
    }
    candidates = [i for i in _varying_parameters(design) if design.parameters[i].name not in relevant]
    if not candidates:
        return ()
    few = SamplingPlan(plan.lines, plan.meshes[:1], plan.orders, refuse_collisions=False)
    fresh = _fresh_places(design)
    base = jobs.run([Job(design.joint(p), few) for p in fresh])
    irrelevant = []
    for i in candidates:
        places = fresh.copy()
        places[:, i] = 0.0
        others = jobs.run([Job(design.joint(p), few) for p in places])
        same = all(
            np.abs(one[key] - other[key]).max(initial=0.0) <= tolerances[key[1]]
            for one, other in zip(base, others, strict=True)
            for key in one
            if key[1] != "wrench"
        )
        if same:
            irrelevant.append(design.parameters[i].name)
    return tuple(irrelevant)


def _expand_places(design: Design, parameters: list[int], unit: Array) -> Array:
    """Places (k, s) from points (k, len(parameters)) in [-1, 1] of some parameters; the others stay in the middle."""
    places = np.zeros((len(unit), len(design.parameters)))
    places[:, parameters] = unit
    return places


def _shape_places(design: Design, count: int) -> Array:
    """Places of the first `count` shapes: Sobol points concentrated towards the ends like Chebyshev points."""
    from scipy.stats import qmc

    fitted = _fitted_parameters(design)
    if not fitted:
        return np.zeros((1, len(design.parameters)))
    points = qmc.Sobol(len(fitted), scramble=False).random(count)
    return _expand_places(design, fitted, -np.cos(math.pi * points))


def _fresh_places(design: Design) -> Array:
    """Places (k, s) in [-1, 1] of the fresh shapes, uniformly distributed."""
    varying = _varying_parameters(design)
    if not varying:
        return np.zeros((1, len(design.parameters)))
    return _expand_places(
        design, varying, np.random.default_rng(2).uniform(-1, 1, (FRESH_SHAPES, len(varying)))
    )


def _fit_in_rounds(
    design: Design, plan: SamplingPlan, jobs: Jobs, tolerances: Mapping[str, float], max_shapes: int
) -> tuple[Array, list[Samples], Fit]:
    """Double the number of shapes until the leave-one-out errors are within tolerance."""
    samples: list[Samples] = []
    count = FIRST_ROUND_SHAPES
    while True:
        places = _shape_places(design, count)
        samples += jobs.run([Job(design.joint(p), plan) for p in places[len(samples) :]])
        fitted_places = places[:, _fitted_parameters(design)]
        stacked = np.array([_stack_groups(s) for s in samples])
        fit = fit_functions(
            stacked, plan.grid, fitted_places, tolerance=_row_tolerances(samples[0], tolerances)
        )
        if fit.shape_error <= 1.0 or len(places) < count or 2 * count > max_shapes:
            return places, samples, _restore_parameters(fit, design)
        count *= 2


def _restore_parameters(fit: Fit, design: Design) -> Fit:
    """The fit with degree zero in the parameters it was made without."""
    m = fit.powers.shape[1] - len(_fitted_parameters(design))
    powers = np.zeros((len(fit.powers), m + len(design.parameters)), np.int64)
    powers[:, :m] = fit.powers[:, :m]
    powers[:, [m + i for i in _fitted_parameters(design)]] = fit.powers[:, m:]
    return replace(fit, powers=powers)


def _stack_groups(samples: Samples) -> Array:
    """All groups of all meshes side by side (g, rows)."""
    return np.concatenate([values.reshape(len(values), -1) for values in samples.values()], axis=1)


def _row_tolerances(samples: Samples, tolerances: Mapping[str, float]) -> Array:
    """Wanted errors (rows,) of the stacked groups."""
    return np.concatenate([np.full(v[0].size, tolerances[group]) for (_, group), v in samples.items()])


def _group_slices(samples: Samples) -> dict[tuple[Mesh, str], slice]:
    """Rows of every group among the stacked groups."""
    slices, at = {}, 0
    for key, values in samples.items():
        slices[key] = slice(at, at + values[0].size)
        at += values[0].size
    return slices


def _predict(fit: Fit, grid: Array, places: Array) -> Array:
    """The fit (k, g, rows) at motions (g, m) over their largest magnitudes and shapes (k, s)."""
    m = grid.shape[1]
    motion, shape = monomials(fit.powers[:, :m], grid), legendre_products(fit.powers[:, m:], places)
    return np.stack([(motion * row) @ fit.coefficients.T for row in shape])


def _residuals(
    fit: Fit,
    plan: SamplingPlan,
    check_plan: SamplingPlan,
    fitted: tuple[Array, list[Samples]],
    fresh: tuple[Array, list[Samples]],
) -> tuple[Residual, ...]:
    """Errors by mesh and group on the fitted shapes and on fresh ones at other points of the stroke."""
    errors = []
    for used_plan, (places, samples) in ((plan, fitted), (check_plan, fresh)):
        errors.append(_predict(fit, used_plan.grid, places) - np.array([_stack_groups(s) for s in samples]))
    nonzero = np.any(fit.coefficients != 0.0, axis=1)
    residuals = []
    for (mesh, group), rows in _group_slices(fitted[1][0]).items():
        if rows.stop == rows.start:
            continue
        numbers = []
        for error in errors:
            part = error[:, :, rows]
            nonzero_part = part[:, :, nonzero[rows]]
            rms = float(np.sqrt(np.mean(nonzero_part**2))) if nonzero_part.size else 0.0
            numbers += [float(f"{v:.3g}") for v in (np.abs(part).max(), rms)]
        residuals.append(Residual(mesh, group, *numbers))
    return tuple(residuals)


def _evidence(design: Design, middle: DrawnJoint, plan: SamplingPlan, jobs: Jobs) -> tuple[Evidence, ...]:
    """Change of the functions when thickness, width, length, material, another parameter or one of the shape changes.

    Measured at poses of B, of blocks and of leaf springs, from the middle of the shapes; inf where the changed joint
    cannot make the motion.
    """
    chains = [mesh for mesh in plan.meshes if isinstance(mesh, int)]
    chain = min(chains, key=lambda n: abs(n - 4)) if chains else None
    compared_meshes: tuple[Mesh, ...] = tuple(mesh for mesh in ("strain", chain) if mesh in plan.meshes)
    cases = {**irrelevant_changes(middle), **design.other_joints()}
    for i in _varying_parameters(design):
        for end in (-1.0, 1.0):
            places = np.zeros(len(design.parameters))
            places[i] = end
            p = design.parameters[i]
            cases[p.name, f"{p.value(end):.6g} for {p.value(0.0):.6g}"] = design.joint(places)
    # the joint itself first, so that errors name it and not a changed joint
    (base,) = jobs.run([Job(middle, SamplingPlan(plan.lines, compared_meshes, plan.orders))])
    # leaf springs twice as wide may overlap, which does not affect their bending
    changed = SamplingPlan(plan.lines, compared_meshes, plan.orders, refuse_collisions=False)
    others = jobs.run([Job(j, changed, may_be_impossible=True) for j in cases.values()])
    first, evidence = compared_meshes[0], []
    for (parameter, words), other in zip(cases, others, strict=True):
        if not other:
            evidence.append(Evidence(parameter, words, math.inf, math.inf))
            continue
        pose_changes = [np.abs(other[first, group] - base[first, group]) for group in ("interface", "blocks")]
        pose = max(float(d.max(initial=0.0)) for d in pose_changes)
        rotation_changes = [
            np.abs(other[k] - base[k]).max() for k in base if k[1] in ("rotations", "amplitudes")
        ]
        evidence.append(
            Evidence(parameter, words, float(f"{pose:.3g}"), float(f"{rotation_changes[-1]:.3g}"))
        )
    return tuple(evidence)


def _record(design: Design, joint: DrawnJoint, plan: SamplingPlan, fit: Fit, sample: Samples) -> Record:
    """The record without its evidence."""
    tables: dict[Mesh, dict[str, Array]] = {}
    for (mesh, group), rows in _group_slices(sample).items():
        shape = sample[mesh, group].shape[1:]
        tables.setdefault(mesh, {})[group] = fit.coefficients[rows].reshape(*shape, len(fit.powers))
    functions = {mesh: Functions(**groups) for mesh, groups in tables.items()}
    return replace(_empty_record(design, joint, plan.orders), powers=fit.powers, functions=functions)


DESIGN_FIELDS = ("family", "motions", "parameters", "leaves", "blocks", "orders", "design")
"""Fields of a record that follow from its design."""


def _empty_record(design: Design, joint: DrawnJoint, orders: tuple[int, int, int]) -> Record:
    """The record with the fields that follow from its design only."""
    return Record(
        family=design.family,
        motions=_strokes(joint),
        parameters=design.parameters,
        leaves=tuple(leaf.name for leaf in joint.leaves()),
        blocks=tuple(name for name in joint.blocks() if name not in ("A", "B")),
        orders=orders,
        powers=np.zeros((0, len(joint.motions) + len(design.parameters)), np.int64),
        functions={},
        design=dict(design.numbers),
    )
