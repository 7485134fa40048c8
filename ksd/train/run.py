"""Training from start to finish: sample shapes until the fit is good enough, check it on fresh ones, write
the record.
"""

from __future__ import annotations

import datetime
import itertools
import math
import os
import warnings
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

import numpy as np

import ksd
from ksd.checks import clear_argument_errors
from ksd.errors import ConvergenceError, RecordError, SceneError
from ksd.library import Evidence, Functions, Mesh, Record, Residual, Stroke, read_record, write_record
from ksd.library.functions import Array, legendre_products, monomials
from ksd.library.record_files import RECORD_SUFFIX
from ksd.model.leaves import leaf_orders
from ksd.model.mesh import Mesh as LeafMesh
from ksd.scene import DrawnJoint, Joint
from ksd.train.catalogue import design_of
from ksd.train.designs import Design, irrelevant_changes
from ksd.train.fit import Fit, fit_functions
from ksd.train.jobs import Job, Jobs
from ksd.train.probes import check_probes, probes_of
from ksd.train.request_checks import check_design, check_meshes
from ksd.train.sampling import Samples, SamplingPlan, chebyshev_line, even_line
from ksd.train.softness import check_soft

ORDERS = (4, 3, 5)
TOLERANCE = {"interface": 8e-7, "blocks": 8e-7, "rotations": 4e-6, "amplitudes": 8e-6, "wrench": 2e-4}
"""Wanted leave-one-out rms errors; units as in `ksd.library.Residual`."""
POINTS = {1: 25, 2: 11}
"""Points per motion, by number of motions."""
WALKED = 9
"""Points per motion at the corners of the shapes."""
MATTERS = 1e-4
"""Change of a pose [rad, joint lengths] from which a parameter that a record leaves out is told of."""
FIRST, FRESH = 16, 8
"""Shapes of the first round (doubled from round to round), and shapes kept out of the fit."""


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

    family_or_joint: name of a family of the catalogue, a joint, or a `Design`; progress: whether a bar tells how far it is.
    shapes: ranges {parameter: (low, high)} SI in place of those of the family. meshes: "strain" and numbers of
    Appendix A elements per leaf; those of the design when None. out: folder or .h5 file; $KSD_DATABASE or ./database
    when None; elsewhere a record is found where KSD_DATABASE
    names its folder. executor: any `concurrent.futures` executor; two processes of its own when None. resume: use the shapes
    an interrupted run has finished (kept beside the record in a .partial folder, also on Ctrl-C). trained: date
    written into the record, ISO, today when None; same inputs give the same bytes. most_shapes: limit of the adaptive
    sampling. tolerance: wanted errors by group, see TOLERANCE.

    Raises SceneError for unknown names and for joints that cannot be represented (see `ksd.train.sampling`),
    RecordError when the record cannot be written. Warns (UserWarning) when the wanted errors are missed.
    """
    design = design_of(family_or_joint, shapes)
    check_design(design)
    asked = design.meshes if meshes is None else check_meshes(design.family, meshes)
    target = record_path(design.family, out)
    folder = target.with_name(f".{target.stem}.partial")
    title = f"train {design.family}"
    with Jobs(folder, executor=executor, resume=resume, progress=progress, title=title) as jobs:
        wanted = {group: design.loose * value for group, value in TOLERANCE.items()} | dict(tolerance or {})
        record = _trained(design, asked, jobs, wanted, most_shapes)
    date = trained or datetime.date.today().isoformat()
    record = replace(record, trained=date, history=(f"{date}: {record.history[0]}",))
    write_record(record, target)
    jobs.forget()
    return record


def _trained(
    design: Design, meshes: tuple[Mesh, ...], jobs: Jobs, wanted: Mapping[str, float], most: int
) -> Record:
    """Sample, fit, check on fresh shapes and gather evidence; the record lacks only its date."""
    middle = design.joint(np.zeros(len(design.parameters)))
    corners = _corner_joints(design)
    for joint in corners if len(corners) == 1 else (middle, *corners):
        check_soft(joint)
    plan, check = _plans(middle, meshes, _orders(corners))
    evidence = _evidence(design, middle, plan, jobs)
    _walk(corners, plan, jobs)
    _warn_of_others(design, evidence)
    design = replace(design, idle=_idle(design, evidence, wanted))
    places, samples, fit = _rounds(design, plan, jobs, wanted, most)
    _warn_of(design, fit)
    fresh_places = _fresh_places(design)
    fresh = jobs.run([Job(design.joint(p), check) for p in fresh_places])
    sentence = (
        f"trained on {len(places)} shapes, checked on {len(fresh)} fresh ones; total degrees "
        f"{fit.motion_degree} in the motions, {fit.shape_degree} in the shape; leave-one-out errors over "
        f"tolerance {fit.motion_error:.2g} and {fit.shape_error:.2g}."
        + (f" No dependence on {', '.join(design.idle)}." if design.idle else "")
    )
    record = _record(design, middle, plan, fit, samples[0])
    return replace(
        record,
        probes=probes_of(record, fresh_places, check.grid),
        residuals=_residuals(fit, plan, check, (places, samples), (fresh_places, fresh)),
        evidence=evidence,
        samples=(len(places), len(fresh)),
        version=str(getattr(ksd, "__version__", "0")),
        history=(sentence,),
    )


def up_to_date(family_or_joint: str | Joint | Design, *, out: str | os.PathLike[str] | None = None) -> str:
    """How the record that `train` would replace agrees with this code, in words; empty where it has to be trained.

    It has to where there is none that can be read, or one of another joint, of other ranges, meshes or wider errors, or
    where its probe states come out otherwise than told.
    """
    design = design_of(family_or_joint)
    target = record_path(design.family, out)
    if not target.is_file():
        return ""
    corners = _corner_joints(design)
    asked = _skeleton(design, design.joint(np.zeros(len(design.parameters))), _orders(corners))
    try:
        record = read_record(target)
        alike = all(getattr(record, name) == getattr(asked, name) for name in _ASKED)
        fitted = all(r.fit_rms <= design.loose * TOLERANCE[r.group] for r in record.residuals)
        if not (alike and fitted and set(record.functions) == set(design.meshes)):
            return ""
        return check_probes(record, design)
    except (RecordError, SceneError, ConvergenceError):
        return ""


def _warn_of(design: Design, fit: Fit) -> None:
    if not fit.converged:
        warnings.warn(
            f"{design.family}: the functions are fitted no better than {max(fit.motion_error, fit.shape_error):.2g} times "
            "the wanted errors; the residuals in the record tell them. Reduce the range of motion or of the shape, or "
            "raise most_shapes.",
            stacklevel=4,
        )


def _warn_of_others(design: Design, evidence: tuple[Evidence, ...]) -> None:
    """Warn of parameters that matter and are no dimension of the record."""
    for name in design.others:
        most = max(e.interface for e in evidence if e.parameter == name)
        if most > MATTERS:
            warnings.warn(
                f"{design.family}: {name} moves interface B or a block by {most:.2g} (rad or joint lengths), and the record "
                "does not know it; make it one of the parameters.",
                stacklevel=4,
            )


def record_path(family: str, out: str | os.PathLike[str] | None) -> Path:
    """Where the record of `family` goes: into folder or .h5 file `out`, $KSD_DATABASE or ./database when None."""
    folder = Path(out or os.environ.get("KSD_DATABASE") or "database")
    return folder if folder.suffix == RECORD_SUFFIX else folder / f"{family}{RECORD_SUFFIX}"


def _strokes(joint: Joint) -> tuple[Stroke, ...]:
    found = []
    for motion in joint.motions:
        unit = joint.length if motion.kind == "translation" else 1.0
        low, high = (v / unit for v in motion.range)
        found.append(Stroke(motion.name, motion.kind, low, high))
    return tuple(found)


def _corner_joints(design: Design) -> list[DrawnJoint]:
    """The joint at every corner of the shapes. Raises SceneError, naming the shape, where it cannot be drawn."""
    ends = [(-1.0, 1.0) if p.high > p.low else (0.0,) for p in design.parameters]
    found = []
    for places in itertools.product(*ends):
        try:
            found.append(design.joint(np.array(places)))
        except SceneError as error:
            shape = ", ".join(
                f"{name} = {value:.4g}" for name, value in design.shape(np.array(places)).items()
            )
            raise SceneError(
                f"{design.family}: the range of shapes holds one that cannot be drawn, {shape}: {error}"
            ) from None
    return found


def _orders(corners: list[DrawnJoint]) -> tuple[int, int, int]:
    """Curvature modes that serve every leaf at every corner of the shapes; curved leaf springs need more of them."""
    mesh = LeafMesh("strain", orders=ORDERS, points=max(ORDERS) + 2)
    found = [leaf_orders(leaf, mesh)[0] for joint in corners for leaf in joint.leaves()]
    nx, ny, nz = (max(o[axis] for o in found) for axis in range(3))
    return nx, ny, nz


def _plans(
    joint: Joint, meshes: tuple[Mesh, ...], orders: tuple[int, int, int] = ORDERS
) -> tuple[SamplingPlan, SamplingPlan]:
    """How shapes are sampled for the fit, and for the check at other points of the stroke."""
    ranges = [motion.range for motion in joint.motions]
    count = POINTS.get(len(ranges), 7)
    fitted = tuple(chebyshev_line(low, high, count) for low, high in ranges)
    checked = tuple(even_line(low, high, count - 2) for low, high in ranges)
    return SamplingPlan(fitted, meshes, orders), SamplingPlan(checked, meshes, orders)


def _walk(corners: list[DrawnJoint], plan: SamplingPlan, jobs: Jobs) -> None:
    """Take the joint at every corner of the shapes over its whole stroke. Raises SceneError, naming shape and motion, where
    it buckles, leaves its plane or runs into itself: between the corners the sampled shapes are looked at."""
    lines = tuple(even_line(*motion.range, WALKED) for motion in corners[0].motions)
    walk = SamplingPlan(lines, ("strain",), plan.orders, whole=True)
    jobs.run([Job(joint, walk) for joint in corners])


def _ranging(design: Design) -> list[int]:
    """Parameters that have a range."""
    return [i for i, p in enumerate(design.parameters) if p.high > p.low]


def _free(design: Design) -> list[int]:
    """Parameters that have a range and matter."""
    return [i for i in _ranging(design) if design.parameters[i].name not in design.idle]


def _idle(design: Design, evidence: tuple[Evidence, ...], wanted: Mapping[str, float]) -> tuple[str, ...]:
    """Shape parameters whose ends move no function by more than its wanted error: the record leaves them out. The fresh
    shapes vary them all the same."""
    matter = {
        e.parameter
        for e in evidence
        if e.interface > wanted["interface"] or e.rotations > wanted["rotations"]
    }
    return tuple(
        p.name for i, p in enumerate(design.parameters) if i in _ranging(design) and p.name not in matter
    )


def _spread(design: Design, which: list[int], unit: Array) -> Array:
    """Places (k, s) from points (k, len(which)) in [-1, 1]; the other parameters stay in the middle."""
    places = np.zeros((len(unit), len(design.parameters)))
    places[:, which] = unit
    return places


def _shape_places(design: Design, count: int) -> Array:
    """The first `count` shapes: Sobol points gathered toward the ends like Chebyshev points."""
    from scipy.stats import qmc

    free = _free(design)
    if not free:
        return np.zeros((1, len(design.parameters)))
    points = qmc.Sobol(len(free), scramble=False).random(count)
    return _spread(design, free, -np.cos(math.pi * points))


def _fresh_places(design: Design) -> Array:
    ranging = _ranging(design)
    if not ranging:
        return np.zeros((1, len(design.parameters)))
    return _spread(design, ranging, np.random.default_rng(2).uniform(-1, 1, (FRESH, len(ranging))))


def _rounds(
    design: Design, plan: SamplingPlan, jobs: Jobs, wanted: Mapping[str, float], most: int
) -> tuple[Array, list[Samples], Fit]:
    """Double the shapes until the leave-one-out errors are within tolerance."""
    samples: list[Samples] = []
    count = FIRST
    while True:
        places = _shape_places(design, count)
        samples += jobs.run([Job(design.joint(p), plan) for p in places[len(samples) :]])
        free = places[:, _free(design)]
        stacked = np.array([_stack(s) for s in samples])
        fit = fit_functions(stacked, plan.grid, free, tolerance=_row_tolerance(samples[0], wanted))
        if fit.shape_error <= 1.0 or len(places) < count or 2 * count > most:
            return places, samples, _widened(fit, design)
        count *= 2


def _widened(fit: Fit, design: Design) -> Fit:
    """The fit with degree zero for parameters of a single value."""
    m = fit.powers.shape[1] - len(_free(design))
    powers = np.zeros((len(fit.powers), m + len(design.parameters)), np.int64)
    powers[:, :m] = fit.powers[:, :m]
    powers[:, [m + i for i in _free(design)]] = fit.powers[:, m:]
    return replace(fit, powers=powers)


def _stack(samples: Samples) -> Array:
    """(g, rows): all groups of all meshes side by side."""
    return np.concatenate([values.reshape(len(values), -1) for values in samples.values()], axis=1)


def _row_tolerance(samples: Samples, wanted: Mapping[str, float]) -> Array:
    return np.concatenate([np.full(v[0].size, wanted[group]) for (_, group), v in samples.items()])


def _slices(samples: Samples) -> dict[tuple[Mesh, str], slice]:
    found, at = {}, 0
    for key, values in samples.items():
        found[key] = slice(at, at + values[0].size)
        at += values[0].size
    return found


def _predict(fit: Fit, grid: Array, places: Array) -> Array:
    """(k, g, rows): the fit at motions (g, m) over their reach and shapes (k, s)."""
    m = grid.shape[1]
    motion, shape = monomials(fit.powers[:, :m], grid), legendre_products(fit.powers[:, m:], places)
    return np.stack([(motion * row) @ fit.coefficients.T for row in shape])


def _residuals(
    fit: Fit,
    plan: SamplingPlan,
    check: SamplingPlan,
    fitted: tuple[Array, list[Samples]],
    fresh: tuple[Array, list[Samples]],
) -> tuple[Residual, ...]:
    """Errors by mesh and group on the fitted shapes and on fresh ones at other points of the stroke."""
    errors = []
    for used, (places, samples) in ((plan, fitted), (check, fresh)):
        errors.append(_predict(fit, used.grid, places) - np.array([_stack(s) for s in samples]))
    alive = np.any(fit.coefficients != 0.0, axis=1)
    found = []
    for (mesh, group), rows in _slices(fitted[1][0]).items():
        if rows.stop == rows.start:
            continue
        numbers = []
        for error in errors:
            part = error[:, :, rows]
            live = part[:, :, alive[rows]]
            rms = float(np.sqrt(np.mean(live**2))) if live.size else 0.0
            numbers += [float(f"{v:.3g}") for v in (np.abs(part).max(), rms)]
        found.append(Residual(mesh, group, *numbers))
    return tuple(found)


def _evidence(design: Design, middle: DrawnJoint, plan: SamplingPlan, jobs: Jobs) -> tuple[Evidence, ...]:
    """Change of the functions, poses of B, of blocks and leaves, when thickness, width, length, material, another
    parameter or one of the shape changes, from the middle; inf where the changed joint cannot make the motion.
    """
    chains = [mesh for mesh in plan.meshes if isinstance(mesh, int)]
    chain = min(chains, key=lambda n: abs(n - 4)) if chains else None
    seen: tuple[Mesh, ...] = tuple(mesh for mesh in ("strain", chain) if mesh in plan.meshes)
    cases = {**irrelevant_changes(middle), **design.other_joints()}
    for i in _ranging(design):
        for end in (-1.0, 1.0):
            places = np.zeros(len(design.parameters))
            places[i] = end
            p = design.parameters[i]
            cases[p.name, f"{p.value(end):.6g} for {p.value(0.0):.6g}"] = design.joint(places)
    # the joint itself first: what is wrong with it is said of it, not of a changed one
    (base,) = jobs.run([Job(middle, SamplingPlan(plan.lines, seen, plan.orders))])
    # leaf springs twice as wide may overlap: no matter to how they bend
    changed = SamplingPlan(plan.lines, seen, plan.orders, apart=False)
    others = jobs.run([Job(j, changed, tried=True) for j in cases.values()])
    found = []
    for (parameter, words), other in zip(cases, others, strict=True):
        if not other:
            found.append(Evidence(parameter, words, math.inf, math.inf))
            continue
        moved = [np.abs(other[seen[0], group] - base[seen[0], group]) for group in ("interface", "blocks")]
        pose = max(float(d.max(initial=0.0)) for d in moved)
        turns = [np.abs(other[k] - base[k]).max() for k in base if k[1] in ("rotations", "amplitudes")]
        rotations = turns[-1] if turns else 0.0
        found.append(Evidence(parameter, words, float(f"{pose:.3g}"), float(f"{rotations:.3g}")))
    return tuple(found)


def _record(design: Design, joint: DrawnJoint, plan: SamplingPlan, fit: Fit, sample: Samples) -> Record:
    """The record without its evidence."""
    tables: dict[Mesh, dict[str, Array]] = {}
    for (mesh, group), rows in _slices(sample).items():
        shape = sample[mesh, group].shape[1:]
        tables.setdefault(mesh, {})[group] = fit.coefficients[rows].reshape(*shape, len(fit.powers))
    functions = {mesh: Functions(**groups) for mesh, groups in tables.items()}
    return replace(_skeleton(design, joint, plan.orders), powers=fit.powers, functions=functions)


_ASKED = ("family", "motions", "parameters", "leaves", "blocks", "orders", "design")
"""What a record has from its design, before anything is solved."""


def _skeleton(design: Design, joint: DrawnJoint, orders: tuple[int, int, int]) -> Record:
    """The record with nothing but what its design says."""
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
