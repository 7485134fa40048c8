"""`ksd.gradient`: derivatives of the answers of a sweep by the parameters of a design, drives and loads.

Columns and units are those of `ksd.sweep`, parameters are in SI units; the perturbed equilibria are those of
`ksd.solvers.perturbed`. A quantity that is selected at every pose is selected once, at the unperturbed pose, and tracked at
the perturbed ones: the leaf, station and point of the largest stress (envelope theorem), principal axes of stiffness by
those there, and modes by their MAC. Critical load factors mu are differentiated as 1/mu, because mu passes through infinity
where there is no stress.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import chain, pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ksd.answers.plant import Damping
from ksd.answers.printing import PrintableAnswer, format_number, format_table
from ksd.answers.state_batch import StateBatch, group_states
from ksd.answers.stress import batch_stress_at_peaks
from ksd.checks import boolean, clear_argument_errors, name_hint
from ksd.errors import ConvergenceError, KinematicsError, SceneError, TrustError
from ksd.html import join_printed
from ksd.model.mesh import Mesh
from ksd.numerics.rotations import rotation_log
from ksd.numerics.threads import small_matrices
from ksd.scene.link import Link
from ksd.scene.obstacle import has_contacts
from ksd.solvers.configuration import Configuration
from ksd.solvers.error import refined_configuration
from ksd.solvers.perturbed import (
    FOURTH_ORDER_STEP,
    RELATIVE_STEP,
    GradientParameter,
    PerturbedEquilibria,
    parameters_of,
)
from ksd.solvers.random_vibration import Spectrum
from ksd.solvers.solver import Method
from ksd.study.arguments import drive_value_arrays
from ksd.study.contact_gradient import CONTACT_STEP, ContactEquilibria
from ksd.study.design_scene import MechanismLike
from ksd.study.questions import (
    ANSWER_FUNCTIONS,
    BATCH_QUESTIONS,
    NOT_ANSWERED,
    POSE_ERRORS,
    PoseAnalysis,
    PreviousPose,
    Questions,
    Row,
    answer_group,
    contact_row,
    frequency_row,
    parse_questions,
    second_parasitic_row,
)
from ksd.study.sweep import sweep_paths
from ksd.study.sweep_path import Recipe, adequate_solver

Array = np.ndarray
BATCH_LEAVES = 4096
"""Leaf springs, in all states together, whose stresses are evaluated at once: some 30 MB."""
TRACKED_QUESTIONS = ("stress", "frequencies")
"""Questions whose answers select a point or mode at the unperturbed pose."""
EXCLUDED_COLUMNS = ("mac", "error_percent")
"""Columns that have no derivatives."""
NO_SUCH_ANSWER = "this pose has no such answer"
KINK_TOLERANCE = 1e-3
"""Difference of the one-sided slopes, relative to the slope or to the answer over the parameter, that counts as a kink."""


@dataclass(frozen=True, repr=False)
class Gradient(PrintableAnswer):
    """Derivatives of answers at poses: ``gradient[column, parameter]`` (poses,), in units of the column per SI unit of
    the parameter.

    columns: those of `ksd.sweep`, and "stress_MPa[leaf]" and sizes of every leaf; parameters: names; slopes (columns,
    parameters, poses): the derivatives. at_design: parameters by name, SI; values: answers (poses,) of the same equilibria
    by column; poses: drive values and load case of each. point: derivative of the displacement [m] and rotation [rad]
    (poses, 6) of the point of the questions, by parameter. reasons: why there is no gradient, by column and pose; the slope
    is nan there. error_slopes: in the shape of `slopes`, the change to the derivative on a finer mesh, plus |g(h) - g(2h)| /
    3 or, where there is a kink, the difference of the one-sided slopes; None without errors=True. heading: what the printed
    table holds. refused: by number of the pose, why `ksd.solve` would refuse it (strict=False).

    >>> steel = ksd.Material(E=200 * GPa, nu=0.3)
    >>> def pivot(thickness):
    ...     return ksd.Mechanism.of_joint(ksd.CrossedPivot(
    ...         steel, length=50 * mm, angle=45 * deg, thickness=thickness, width=15 * mm
    ...     ))
    >>> found = ksd.gradient(pivot, {"thickness": 0.3 * mm}, angle=[20 * deg])
    >>> found["angle_moment_Nm", "thickness"].round(0)
    array([961.])
    """

    columns: tuple[str, ...]
    parameters: tuple[str, ...]
    values: Mapping[str, Array]
    slopes: Array
    point: Mapping[str, Array]
    poses: tuple[Mapping[str, Any], ...]
    at_design: Mapping[str, float]
    reasons: Mapping[tuple[str, int], str] = field(default_factory=dict)
    error_slopes: Array | None = None
    heading: str = "Gradient per SI unit"
    refused: Mapping[int, str] = field(default_factory=dict)

    def _indices(self, key: Any) -> tuple[int, int]:
        """Indices of a column and a parameter. Raises as `__getitem__`."""
        if not (isinstance(key, tuple) and len(key) == 2):
            raise SceneError("give a column and a parameter, for example gradient['stress_MPa', 'thickness']")
        for what, name, known in zip(
            ("column", "parameter"), key, (self.columns, self.parameters), strict=True
        ):
            if name not in known:
                raise SceneError(
                    f"there is no gradient of {what} '{name}'; {what}s are {', '.join(known)}{name_hint(str(name), known)}"
                    if what == "column"
                    else f"there is no gradient by '{name}'; parameters are {', '.join(known)}{name_hint(str(name), known)}"
                )
        reasons = [self.reasons.get((key[0], n)) for n in range(len(self.poses))]
        if all(reasons):
            raise KinematicsError(f"no gradient of {key[0]}: {reasons[0]}")
        return self.columns.index(key[0]), self.parameters.index(key[1])

    def __getitem__(self, key: tuple[str, str]) -> Array:
        """Derivative (poses,) of a column by a parameter.

        Raises SceneError for an unknown column or parameter, KinematicsError where there is no gradient at any pose.
        """
        slope: Array = self.slopes[self._indices(key)]
        return slope

    @property
    def errors(self) -> Any:
        """Error of every derivative, by the same keys. Raises SceneError without errors=True."""
        if self.error_slopes is None:
            raise SceneError(
                "the errors of these gradients were not asked for: ksd.gradient(..., errors=True)"
            )
        return replace(self, slopes=self.error_slopes, heading=f"{self.heading}, errors")

    @property
    def relative(self) -> Gradient:
        """d log answer / d log parameter, by the same keys; nan where an answer is zero."""
        answers = np.array([self.values[c] for c in self.columns])[:, None]
        parameters = np.array([self.at_design[p] for p in self.parameters])[None, :, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            factor = np.where(answers == 0.0, np.nan, parameters / answers)
        errors = None if self.error_slopes is None else self.error_slopes * np.abs(factor)
        slopes = self.slopes * factor
        return replace(self, slopes=slopes, error_slopes=errors, heading="Relative gradient [%/%]")

    def _line(self) -> str:
        return f"{len(self.columns)} answers by {', '.join(self.parameters)} at {len(self.poses)} poses"

    def __str__(self) -> str:
        tables = []
        for n, pose in enumerate(self.poses):
            where = ", ".join(
                f"{k} {format_number(v) if isinstance(v, float) else v}" for k, v in pose.items()
            )
            rows = [
                (
                    c,
                    format_number(float(self.values[c][n])),
                    *(format_number(float(v)) for v in self.slopes[i, :, n]),
                )
                for i, c in enumerate(self.columns)
            ]
            title = f"{self.heading}{' at ' if where else ''}{where}"
            tables.append(format_table(("answer", "value", *self.parameters), rows, title))
            if n in self.refused:
                tables.append(self.refused[n])
        return join_printed(tables)


@clear_argument_errors
@small_matrices
def gradient(
    design: MechanismLike,
    at_design: Mapping[str, Any] | None = None,
    *,
    by: str | Iterable[str] | None = None,
    sizes: Mapping[str, float] | None = None,
    loads: Mapping[str, Sequence[Mapping[str, Any]]] | None = None,
    questions: str | Iterable[str] = ("force", "support_stiffness", "stress"),
    link: Link | str | None = None,
    at: ArrayLike | None = None,
    along: ArrayLike | str | None = None,
    freed: str | Iterable[str] | None = None,
    modes: int = 3,
    psd: Mapping[str, Spectrum] | None = None,
    damping: Damping | None = None,
    errors: bool = False,
    method: Method | None = None,
    accuracy: float | None = None,
    mesh: Mesh | None = None,
    extrapolate: bool = False,
    strict: bool = True,
    effects: str | Iterable[str] = "auto",
    with_: str | Iterable[str] = (),
    without: str | Iterable[str] = (),
    together: bool = False,
    targets: Mapping[str, ArrayLike] | None = None,
    **drives: ArrayLike,
) -> Gradient:
    """Derivatives of the answers of a sweep by parameters of a design, drives and loads; returns a `Gradient`.

    They are central differences of equilibria (`ksd.solvers.perturbed`), usually accurate to 1e-7 of an answer.
    design: a function of the parameters `at_design` (by name, SI) that returns a mechanism; a mechanism where only
    derivatives by drives and loads are needed. by: names of parameters, drives, or components of loads ("payload_force_z");
    by default all numbers of `at_design`, without one all drives. sizes: typical sizes of parameters that are zero. errors:
    differences of fourth order with the error of each, that of the mesh included, at several times the cost. The other
    arguments, and drive values [m or rad] by name, are those of `ksd.sweep`. Values and derivatives are those of the
    equilibrium for every `method`; modes, orders and effects are fixed when a parameter is perturbed. Modes are numbered
    at every pose from the lowest. In a scene with stops, cables or contacts every difference is one of solves from rest, of
    fourth order.

    Raises SceneError for unknown names, a parameter that changes more than numbers, and reduced bodies; KsdError of the
    pose that fails; TrustError of a pose that `ksd.solve` would refuse, which strict=False differentiates all the same: then
    `Gradient.refused` has the reason.

    >>> guide, stroke, _ = ksd.load_scene("guide")
    >>> slopes = ksd.gradient(guide, questions="force", **stroke)
    >>> slopes["table_force_N", "table"].round(1)
    array([1021.6])
    """
    selected = replace(
        parse_questions(questions, link, at, freed, along=along, modes=modes, psd=psd, damping=damping),
        detailed=True,
    )
    recipe = Recipe(
        selected, method=method, accuracy=accuracy, relinearisations=0, mesh=mesh, extrapolate=extrapolate, strict=strict,
        effects=(("effects", effects), ("with_", with_), ("without", without)),
    )  # fmt: skip
    boolean(errors, "errors")
    values = drive_value_arrays(targets, drives, gradient)
    designs = None if at_design is None else [at_design]
    paths, _ = sweep_paths(
        design, values, designs, loads, together=boolean(together, "together"), call=gradient
    )

    reasons: list[str] = []

    def solved() -> Iterator[SolvedPoses]:
        for path in paths:
            if path.scene is None:
                raise SceneError(path.failure)
            solver = adequate_solver(path, recipe, None)
            case = {"load_case": path.labels["load_case"]} if loads else {}
            poses = []
            for v in path.drive_values:
                pose, reason = solver.judge(v)
                if reason and strict:
                    raise TrustError(reason, reached=1.0, result=pose)
                reasons.append(reason)
                poses.append(pose)
            yield SolvedPoses(path.scene, poses, [{**case, **v} for v in path.drive_values])

    function = design if callable(design) else None
    found = gradient_at(solved(), selected, function, at_design, by=by, sizes=sizes, errors=errors)
    return replace(found, refused={n: reason for n, reason in enumerate(reasons) if reason})


class SolvedPoses(NamedTuple):
    """Solved poses of a scene, with the labels of each: drive values by name, and load case."""

    scene: Any
    poses: Sequence[Configuration]
    labels: Sequence[Mapping[str, Any]]


@small_matrices
def gradient_at(
    solved: Iterable[SolvedPoses],
    questions: Questions,
    design: Callable[..., Any] | None,
    at_design: Mapping[str, Any] | None,
    *,
    by: str | Iterable[str] | None = None,
    sizes: Mapping[str, float] | None = None,
    errors: bool = False,
) -> Gradient:
    """`gradient` at solved poses; design: the function of the parameters, None for a mechanism."""

    def differences(solved: Iterable[SolvedPoses], names: tuple[str, ...] = questions.names) -> Gradient:
        return _gradient_by_differences(
            solved, replace(questions, names=names), design, at_design, by=by, sizes=sizes, errors=errors
        )

    def on_finer_mesh(scene: Any, pose: Configuration, label: Mapping[str, Any]) -> dict[str, Array]:
        """Derivatives (parameters,) by column, without those of questions that have no answer there."""
        slopes: dict[str, Array] = {}
        with suppress(ConvergenceError):
            refined = SolvedPoses(scene, [refined_configuration(pose)], [label])
            for name in questions.names:
                with suppress(*POSE_ERRORS):
                    fine = differences([refined], (name,))
                    slopes |= dict(zip(fine.columns, fine.slopes[..., 0], strict=True))
        return slopes

    if not errors:
        return differences(solved)
    cases = list(solved)
    found = differences(cases)
    assert found.error_slopes is not None
    error_slopes = found.error_slopes.copy()
    poses = [(case.scene, pose) for case in cases for pose in case.poses]
    for n, (scene, pose) in enumerate(poses):
        fine_slopes = on_finer_mesh(scene, pose, found.poses[n])
        for i, column in enumerate(found.columns):
            error_slopes[i, :, n] += np.abs(fine_slopes.get(column, np.inf) - found.slopes[i, :, n])
    return replace(found, error_slopes=error_slopes)


def _gradient_by_differences(
    solved: Iterable[SolvedPoses],
    questions: Questions,
    design: Callable[..., Any] | None,
    at_design: Mapping[str, Any] | None,
    *,
    by: str | Iterable[str] | None,
    sizes: Mapping[str, float] | None,
    errors: bool,
) -> Gradient:
    """`gradient_at`; the error slopes are those of the differences on the mesh of the poses."""
    cases = list(solved)
    contacts = any(has_contacts(case.scene) for case in cases)
    step = CONTACT_STEP if contacts else FOURTH_ORDER_STEP if errors else RELATIVE_STEP
    offsets = (step, -step, 2 * step, -2 * step) if errors or contacts else (step, -step)
    # of every pose: the pose itself, then those at the offsets of every parameter
    poses: list[list[Configuration]] = []
    labels: list[Mapping[str, Any]] = []
    parameters: tuple[GradientParameter, ...] = ()
    steps: list[list[float]] = []
    for scene, scene_poses, scene_labels in cases:
        parameters = ()
        perturb = ContactEquilibria(offsets) if contacts else PerturbedEquilibria(offsets)
        for pose in scene_poses:
            # between poses of a scene only the values of drives change
            if not parameters or any(p.scene is None for p in parameters):
                parameters = parameters_of(
                    scene, pose.targets, size=pose.model.arrays.size, at_design=at_design, by=by, sizes=sizes,
                    design=design,
                )  # fmt: skip
            unperturbed, perturbed = perturb(pose, parameters)
            poses.append([unperturbed, *chain(*perturbed)])
            steps.append([p.scale * step for p in parameters])
        labels += scene_labels
    held = [[pose.with_contacts_held for pose in own] for own in poses]
    rows = _answer_rows(held, questions, len(offsets))
    if "force" in questions.names:
        for row, pose in zip(chain(*rows), chain(*poses), strict=True):
            row |= contact_row(pose)
    numeric = dict.fromkeys(c for own in rows for c, v in own[0].items() if isinstance(v, float))
    columns = tuple(c for c in numeric if c not in EXCLUDED_COLUMNS)
    names, h = tuple(p.name for p in parameters), np.array(steps)[..., None]
    answers = np.array([[[row.get(c, np.nan) for c in columns] for row in own] for own in rows])
    values = answers[:, :1]
    perturbed_values = answers[:, 1:].reshape(*h.shape[:2], len(offsets), len(columns))
    with np.errstate(divide="ignore", invalid="ignore"):
        slopes, error_slopes = _differences(columns, values, np.moveaxis(perturbed_values, 2, 0), h)
    scene = poses[0][0].model.scene
    point = questions.point(scene) if questions.link is not None or scene.drives else None
    reasons: dict[tuple[str, int], str] = {}
    for n, i in np.argwhere(~np.isfinite(slopes).all(axis=1)).tolist():
        column, value = columns[i], float(values[n, 0, i])
        is_answered = column in rows[n][0]
        reasons[column, n] = (
            _reason(column, value, point[0] if point else "") if is_answered else NO_SUCH_ANSWER
        )
        slopes[n, :, i] = np.nan
    point_slopes = _point_differences(poses, len(offsets), point) / (2 * h)
    return Gradient(
        columns, names, dict(zip(columns, values[:, 0].T, strict=True)), slopes.T,
        dict(zip(names, point_slopes.swapaxes(0, 1), strict=True)), tuple(labels),
        {p.name: p.value for p in parameters}, reasons, None if error_slopes is None else error_slopes.T,
    )  # fmt: skip


def _differences(
    columns: Sequence[str], values: Array, perturbed: Array, h: Array
) -> tuple[Array, Array | None]:
    """Central differences (poses, parameters, columns) of answers; with four offsets of fourth order, with their errors.

    values (poses, 1, columns): at the poses; perturbed (offsets, poses, parameters, columns); h (poses, parameters, 1):
    the steps.
    """
    is_inverse = np.array([c.startswith("buckling") for c in columns], bool)
    # chain rule of critical load factors mu, which are differenced as 1/mu
    outer = np.where(is_inverse, -(values**2), 1.0)
    q, q0 = (np.where(is_inverse, 1.0 / a, a) for a in (perturbed, values))
    slope, errors = (q[0] - q[1]) / (2 * h), None
    if len(q) > 2:
        wide = (q[2] - q[3]) / (4 * h)
        # half the difference of the one-sided slopes: proportional to h unless there is a kink
        bends = (q[0] + q[1] - 2 * q0) / (2 * h), (q[2] + q[3] - 2 * q0) / (4 * h)
        kink = np.abs(2 * bends[0] - bends[1])
        threshold = KINK_TOLERANCE * np.maximum(np.abs(slope), np.abs(q0) * FOURTH_ORDER_STEP / h)
        kink[~(kink > threshold)] = 0.0
        errors = np.abs(outer) * np.maximum(np.abs(slope - wide) / 3, kink)
        slope = slope + (slope - wide) / 3
    return outer * slope, errors


def _reason(column: str, value: float, link: str) -> str:
    """Why an answer has no gradient; link: of the point of the questions."""
    if column.startswith("support") and not np.isfinite(value):
        return (
            f"drives or supports hold link '{link}' there, so it has no stiffness to differentiate; free them, or leave the "
            "direction out"
        )
    if not np.isfinite(value):
        return "the answer is no finite number at this pose"
    return (
        "the answer cannot be followed from this pose: a mode is not found again, or a number is not finite"
    )


def _answer_rows(
    poses: list[list[Configuration]], questions: Questions, offset_count: int
) -> list[list[Row]]:
    """Answers of every pose and of its perturbed poses."""
    count = len(poses[0]) * max(1, len(poses[0][0].model.member_names))
    size = max(1, BATCH_LEAVES // count)
    return [
        row
        for k in range(0, len(poses), size)
        for row in _answer_rows_of_batch(poses[k : k + size], questions, offset_count)
    ]


def _answer_rows_of_batch(
    poses: list[list[Configuration]], questions: Questions, offset_count: int
) -> list[list[Row]]:
    """`_answer_rows` of poses whose states are evaluated in batches where they have the same layout."""
    untracked = replace(questions, names=tuple(q for q in questions.names if q not in TRACKED_QUESTIONS))
    all_poses = list(chain(*poses))
    groups = _groups_of_same_layout(all_poses) if BATCH_QUESTIONS & set(questions.names) else []
    batch_answers = [NOT_ANSWERED] * len(all_poses)
    starts = np.cumsum([0, *(len(own) for own in poses)])
    unperturbed = np.repeat(starts[:-1], np.diff(starts))
    for numbers, states in groups if BATCH_QUESTIONS & set(untracked.names) else []:
        position = {n: k for k, n in enumerate(numbers)}
        at = [position.get(int(unperturbed[n])) for n in numbers]
        reference = None if None in at else np.array(at)
        for n, answer in zip(numbers, answer_group(states, untracked, reference), strict=True):
            batch_answers[n] = answer
    # all rows are made before stresses and frequencies are added
    own_rows = iter(
        [_untracked_row(p, untracked, a.rows) for p, a in zip(all_poses, batch_answers, strict=True)]
    )
    rows = [[next(own_rows) for _ in own] for own in poses]
    if "stress" in questions.names:
        stress_rows = _stress_rows(poses, groups, questions.points)
        for row, stresses in zip(chain(*rows), chain(*stress_rows), strict=True):
            row |= stresses
    if "frequencies" in questions.names:
        for pose_and_perturbed, own in zip(poses, rows, strict=True):
            _add_frequencies(pose_and_perturbed, questions, own, offset_count)
    return rows


def _groups_of_same_layout(poses: Sequence[Configuration]) -> list[tuple[list[int], StateBatch]]:
    """Batches of the states of poses with the same layout, with the indices of the poses."""
    return group_states([(pose.model, pose.motion, pose.load_factor) for pose in poses])


def _untracked_row(pose: Configuration, questions: Questions, known: Mapping[str, Row]) -> Row:
    """Row of one pose; known: rows of questions that are answered already. Raises what a question raises."""
    row, analysis = Row(), PoseAnalysis(pose)
    for name in questions.names:
        try:
            row |= known[name] if name in known else ANSWER_FUNCTIONS[name](analysis, questions)
        except POSE_ERRORS as reason:
            raise type(reason)(f"no gradient of {name}: {reason}") from reason
    return row


def _stress_rows(
    poses: list[list[Configuration]], groups: list[tuple[list[int], StateBatch]], points: int
) -> list[list[Row]]:
    """Rows of the stress of every leaf at the place of its largest stress at the unperturbed pose, and of the leaf that has
    the largest there.

    poses: each with its perturbed ones; groups: batches of all of them; points: stations per leaf.
    """
    all_poses = list(chain(*poses))
    stresses: Mapping[str, Array] | None = None
    starts = np.cumsum([0, *(len(own) for own in poses)])
    if len(groups) == 1 and len(groups[0][0]) == len(all_poses):
        stresses = batch_stress_at_peaks(groups[0][1], np.repeat(starts[:-1], np.diff(starts)), points=points)
    if stresses is None:
        if len(poses) > 1:
            return [row for own in poses for row in _stress_rows([own], _groups_of_same_layout(own), points)]
        leaves = [pose.stress(points=points).leaves for pose in all_poses]
        peaks = {name: int(np.argmax(leaf.von_mises_Pa)) for name, leaf in leaves[0].items()}
        stresses = {n: np.array([own[n].von_mises_Pa.flat[k] for own in leaves]) for n, k in peaks.items()}
    columns = [f"stress_MPa[{name}]" for name in stresses]
    values = 1e-6 * np.array(list(stresses.values())).T
    rows = []
    for first, end in pairwise(starts.tolist()):
        worst = int(values[first].argmax())
        rows.append(
            [
                {"stress_MPa": own[worst]} | dict(zip(columns, own, strict=True))
                for own in values[first:end].tolist()
            ]
        )
    return rows


def _add_frequencies(
    poses: list[Configuration], questions: Questions, rows: list[Row], offset_count: int
) -> None:
    """Add frequencies of the modes of the first pose to the rows of all poses.

    The modes at one offset of a parameter are tracked to the next offset, so that of a mixture of equal frequencies both
    sides are the same mode.
    """
    row, tracks = frequency_row(PoseAnalysis(poses[0]), questions)
    rows[0] |= row
    previous, first_parasitic, second_parasitic = tracks, tracks.first_parasitic, tracks.second_parasitic
    for k, (pose, target_row) in enumerate(zip(poses[1:], rows[1:], strict=True)):
        previous = previous if k % offset_count else tracks
        row, previous = frequency_row(PoseAnalysis(pose, PreviousPose(tracks=previous)), questions)
        row["first_parasitic_Hz"] = (
            np.nan if first_parasitic is None else previous.frequency_Hz(first_parasitic)
        )
        target_row |= row | second_parasitic_row(previous, second_parasitic)


def _point_differences(
    poses: list[list[Configuration]], offset_count: int, point: tuple[str, Any] | None
) -> Array:
    """Displacement [m] and rotation [rad] (poses, parameters, 6) of a point of a link from the second offset to the first.

    point: name of the link and position (3,) [m] in the undeformed configuration, None for its reference point; all nan
    without a point.
    """
    differences = np.full((len(poses), (len(poses[0]) - 1) // offset_count, 6), np.nan)
    if point is not None:
        node = poses[0][0].model.node_names.index(point[0])
        sides = [own[k + side] for own in poses for k in range(1, len(own), offset_count) for side in (0, 1)]
        rest = np.array([pose.model.rest.x[node] for pose in sides])
        x, R = (np.array([getattr(pose.motion, name)[node] for pose in sides]) for name in ("x", "R"))
        s = np.zeros_like(rest) if point[1] is None else np.asarray(point[1], float) - rest
        moved = x - rest + (R @ s[..., None])[..., 0] - s
        differences[..., :3] = (moved[::2] - moved[1::2]).reshape(differences[..., :3].shape)
        rotations = R[::2] @ R[1::2].swapaxes(1, 2)
        for own, rotation in zip(differences.reshape(-1, 6), rotations, strict=True):
            rotation_log(rotation, own[3:])
    return differences
