"""`ksd.gradient`: how every answer of a sweep changes with the parameters of a design, drives and loads.

Columns and units are those of `ksd.sweep`, parameters SI; the poses beside every pose are those of `ksd.solve.perturbed`.
What a sweep picks at every pose is picked once, at the pose, and followed to both sides: the leaf, station and point of
the largest stress (envelope theorem), and modes by their MAC. Of critical load factors mu it is 1/mu that is
differenced, as mu passes through infinity where there is no stress.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ksd.checks import boolean, clear_argument_errors, name_hint
from ksd.design.arguments import drive_value_arrays
from ksd.design.design_scene import MechanismLike
from ksd.design.questions import (
    ANSWER_FUNCTIONS,
    BATCH_QUESTIONS,
    BATCH_SIZE,
    NOT_ANSWERED,
    POSE_ERRORS,
    PoseAnalysis,
    PreviousPose,
    Questions,
    Row,
    answer_group,
    frequency_row,
    parse_questions,
)
from ksd.design.sweep import make_recipe, sweep_paths
from ksd.design.sweep_path import adequate_solver
from ksd.errors import KinematicsError, SceneError
from ksd.html import join_printed
from ksd.model.mesh import Mesh
from ksd.numerics.rotations import rotation_log
from ksd.properties.printing import PrintableAnswer, format_number, format_table
from ksd.properties.state_batch import StateBatch, group_states
from ksd.properties.stress import batch_stress_at_peaks
from ksd.scene.link import Link
from ksd.solve.configuration import Configuration
from ksd.solve.perturbed import (
    FOURTH_ORDER_STEP,
    RELATIVE_STEP,
    GradientParameter,
    PerturbedEquilibria,
    parameters_of,
)
from ksd.solve.solver import Method

Array = np.ndarray
FOLLOWED = ("stress", "frequencies")
"""Questions of which the pose says what is followed."""
NO_ANSWER = ("error", "_s_mm", "mac", "stable")
"""Parts of the names of columns that are no answers."""
ABSENT = "this pose has no such answer"
KINK = 1e-3
"""Difference of the slopes to both sides, over the slope or the answer by the parameter, from which on it is a kink."""


@dataclass(frozen=True, repr=False)
class Gradient(PrintableAnswer):
    """Derivatives of answers at poses: ``gradient[column, parameter]`` (poses,), in units of the column per SI unit of
    the parameter.

    at_design: parameters by name, SI. values: the answers of the same equilibria (poses,) by column, in columns of
    `ksd.sweep`, and "stress_MPa[leaf]" of every leaf; poses: drive values and load case of each. point: how the point
    asked about moves, displacement [m] and rotation [rad] (poses, 6), by parameter. reasons: why there is no gradient, by
    column and pose; it is nan there. error_slopes: |g(h) - g(2h)| / 3 in the order of `slopes`, or how far the slopes to
    both sides differ where there is a kink; None where they were not asked for. slopes (columns, parameters, poses).
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

    def _at(self, key: Any) -> tuple[int, int]:
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
        """(poses,); SceneError for an unknown column or parameter, KinematicsError where there is none at any pose."""
        found: Array = self.slopes[self._at(key)]
        return found

    @property
    def errors(self) -> Any:
        """Error of every derivative, by the same keys. Raises SceneError where errors=True was not asked for."""
        if self.error_slopes is None:
            raise SceneError(
                "the errors of these gradients were not asked for: ksd.gradient(..., errors=True)"
            )
        return replace(self, slopes=self.error_slopes)

    @property
    def relative(self) -> Gradient:
        """d log answer / d log parameter, by the same keys; nan where an answer is zero."""
        answers = np.array([self.values[c] for c in self.columns])[:, None]
        sizes = np.array([self.at_design[p] for p in self.parameters])[None, :, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            factor = np.where(answers == 0.0, np.nan, sizes / answers)
        errors = None if self.error_slopes is None else self.error_slopes * np.abs(factor)
        return replace(self, slopes=self.slopes * factor, error_slopes=errors)

    def _line(self) -> str:
        return f"{len(self.columns)} answers by {', '.join(self.parameters)} at {len(self.poses)} poses"

    def __str__(self) -> str:
        lines = []
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
            said = f"Gradient per SI unit{' at ' if where else ''}{where}"
            lines.append(format_table(("answer", "value", *self.parameters), rows, said))
        return join_printed(lines)


@clear_argument_errors
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
    freed: str | Iterable[str] | None = None,
    modes: int = 3,
    errors: bool = False,
    method: Method | None = None,
    accuracy: float | None = None,
    mesh: Mesh | None = None,
    extrapolate: bool = False,
    effects: str | Iterable[str] = "auto",
    with_: str | Iterable[str] = (),
    without: str | Iterable[str] = (),
    together: bool = False,
    targets: Mapping[str, ArrayLike] | None = None,
    **drives: ArrayLike,
) -> Gradient:
    """Derivatives of the answers of a sweep by the parameters of a design, exact but for rounding; returns a `Gradient`.

    design: a function of the parameters `at_design` (by name, SI) that returns a mechanism; a mechanism where by names
    drives and loads alone. by: names of parameters, drives, or components of loads ("payload_force_z"); by default all
    numbers of `at_design`, without one all drives. sizes: typical sizes of parameters that are zero. errors:
    differences of fourth order with an error figure for each, at twice the cost. The other words, and drive values [m
    or rad] by name, are those of `ksd.sweep`. Values and derivatives are those of the equilibrium, whatever `method`
    leads there; modes, orders, effects and plate curvatures are held beside it. Modes are numbered at every pose from the
    lowest.

    Raises SceneError for unknown words, a parameter that changes more than numbers, and reduced bodies; KsdError of the
    pose that fails.
    """
    asked = replace(parse_questions(questions, link, at, freed, modes=modes, errors=False), detailed=True)
    recipe = make_recipe(
        asked, method=method, accuracy=accuracy, relinearisations=0, mesh=mesh, extrapolate=extrapolate,
        effects=(("effects", effects), ("with_", with_), ("without", without)),
    )  # fmt: skip
    boolean(errors, "errors")
    values = drive_value_arrays(targets, drives, gradient)
    designs = None if at_design is None else [at_design]
    lines, _ = sweep_paths(
        design, values, designs, loads, together=boolean(together, "together"), call=gradient
    )

    def solved() -> Iterator[SolvedPoses]:
        for line in lines:
            if line.scene is None:
                raise SceneError(line.failure)
            walk = adequate_solver(line, recipe, None)
            case = {"load_case": line.labels["load_case"]} if loads else {}
            yield SolvedPoses(
                line.scene,
                [walk.solve(v) for v in line.drive_values],
                [{**case, **v} for v in line.drive_values],
            )

    made = design if callable(design) else None
    return gradient_at(solved(), asked, made, at_design, by=by, sizes=sizes, errors=errors)


class SolvedPoses(NamedTuple):
    """Poses of a scene with their labels: drive values by name, and load case."""

    scene: Any
    poses: Sequence[Configuration]
    labels: Sequence[Mapping[str, Any]]


def gradient_at(
    solved: Iterable[SolvedPoses],
    asked: Questions,
    design: Callable[..., Any] | None,
    at_design: Mapping[str, Any] | None,
    *,
    by: str | Iterable[str] | None = None,
    sizes: Mapping[str, float] | None = None,
    errors: bool = False,
) -> Gradient:
    """`gradient` at poses that are solved; design: None for a mechanism."""
    shares = (
        (FOURTH_ORDER_STEP, -FOURTH_ORDER_STEP, 2 * FOURTH_ORDER_STEP, -2 * FOURTH_ORDER_STEP)
        if errors
        else (RELATIVE_STEP, -RELATIVE_STEP)
    )
    poses: list[list[Configuration]] = []
    labels: list[Mapping[str, Any]] = []
    parameters: tuple[GradientParameter, ...] = ()
    steps: list[list[float]] = []
    for scene, found, said in solved:
        perturbed, parameters = PerturbedEquilibria(shares), ()
        for pose in found:
            # values of drives alone change from pose to pose
            if not parameters or any(p.scene is None for p in parameters):
                parameters = parameters_of(
                    scene, pose.targets, size=pose.model.arrays.size, at_design=at_design, by=by, sizes=sizes,
                    design=design,
                )  # fmt: skip
            here, sides = perturbed(pose, parameters)
            poses.append([here, *chain(*sides)])
            steps.append([p.scale * shares[0] for p in parameters])
        labels += said
    rows = _rows(poses, asked, len(shares))
    numbers = dict.fromkeys(c for own in rows for c, v in own[0].items() if isinstance(v, float))
    columns = tuple(c for c in numbers if not any(n in c for n in NO_ANSWER))
    names, h = tuple(p.name for p in parameters), np.array(steps)[..., None]
    answers = np.array([[[row.get(c, np.nan) for c in columns] for row in own] for own in rows])
    now, q = answers[:, :1], answers[:, 1:].reshape(*h.shape[:2], len(shares), len(columns))
    with np.errstate(divide="ignore", invalid="ignore"):
        slopes, error_slopes = _differences(columns, now, np.moveaxis(q, 2, 0), h)
    scene = poses[0][0].model.scene
    point = asked.point(scene) if asked.link is not None or scene.drives else None
    reasons: dict[tuple[str, int], str] = {}
    for n, i in np.argwhere(~np.isfinite(slopes).all(axis=1)).tolist():
        column, value = columns[i], float(now[n, 0, i])
        there = column in rows[n][0]
        reasons[column, n] = _why(column, value, point[0] if point else "") if there else ABSENT
        slopes[n, :, i] = np.nan
    moved = _moved(poses, len(shares), point) / (2 * h)
    return Gradient(
        columns, names, dict(zip(columns, now[:, 0].T, strict=True)), slopes.T,
        dict(zip(names, moved.swapaxes(0, 1), strict=True)), tuple(labels),
        {p.name: p.value for p in parameters}, reasons, None if error_slopes is None else error_slopes.T,
    )  # fmt: skip


def _differences(columns: Sequence[str], now: Array, q: Array, h: Array) -> tuple[Array, Array | None]:
    """Central differences (poses, parameters, columns) of answers q (sides, poses, parameters, columns) beside `now` (poses,
    1, columns), of steps h (poses, parameters, 1); with four sides to fourth order, and their errors."""
    inverse = np.array([c.startswith("buckling") for c in columns], bool)
    # of critical load factors 1/mu
    outer = np.where(inverse, -(now**2), 1.0)
    q, now = (np.where(inverse, 1.0 / a, a) for a in (q, now))
    slope, errors = (q[0] - q[1]) / (2 * h), None
    if len(q) > 2:
        wide = (q[2] - q[3]) / (4 * h)
        # half the difference of the slopes to both sides: falls with h unless there is a kink
        bends = (q[0] + q[1] - 2 * now) / (2 * h), (q[2] + q[3] - 2 * now) / (4 * h)
        kink = np.abs(2 * bends[0] - bends[1])
        kink[~(kink > KINK * np.maximum(np.abs(slope), np.abs(now) * FOURTH_ORDER_STEP / h))] = 0.0
        errors = np.abs(outer) * np.maximum(np.abs(slope - wide) / 3, kink)
        slope = slope + (slope - wide) / 3
    return outer * slope, errors


def _why(column: str, value: float, link: str) -> str:
    """Why there is no gradient."""
    if column.startswith("support") and not np.isfinite(value):
        return (
            f"drives or supports hold link '{link}' there, so it has no stiffness to differentiate; free them, or leave the "
            "direction out"
        )
    if not np.isfinite(value):
        return "the answer is no finite number at this pose"
    return (
        "the answer is lost beside this pose: a mode that is not found again, or a number that is not finite"
    )


def _rows(poses: list[list[Configuration]], asked: Questions, sides: int) -> list[list[Row]]:
    """Answers of poses, each with those beside it: what is followed is what it is at the pose."""
    # as many poses at once as leave the stresses of their states in memory
    size = max(1, BATCH_SIZE // len(poses[0]))
    return [
        row for k in range(0, len(poses), size) for row in _rows_together(poses[k : k + size], asked, sides)
    ]


def _rows_together(poses: list[list[Configuration]], asked: Questions, sides: int) -> list[list[Row]]:
    """`_rows` of poses whose states are asked together as far as they are alike."""
    plain = replace(asked, names=tuple(q for q in asked.names if q not in FOLLOWED))
    every = [side for own in poses for side in own]
    groups = _alike(every) if BATCH_QUESTIONS & set(asked.names) else []
    known = [NOT_ANSWERED] * len(every)
    for numbers, states in groups if BATCH_QUESTIONS & set(plain.names) else []:
        for n, together in zip(numbers, answer_group(states, plain), strict=True):
            known[n] = together
    answers = iter([_plain(pose, plain, one.rows) for pose, one in zip(every, known, strict=True)])
    rows = [[next(answers) for _ in own] for own in poses]
    if "stress" in asked.names:
        for row, more in zip(chain(*rows), chain(*_stresses(poses, groups, asked.points)), strict=True):
            row |= more
    if "frequencies" in asked.names:
        for own, told in zip(poses, rows, strict=True):
            _follow_modes(own, asked, told, sides)
    return rows


def _alike(poses: Sequence[Configuration]) -> list[tuple[list[int], StateBatch]]:
    return group_states([(pose.model, pose.motion, pose.load_factor) for pose in poses])


def _plain(pose: Configuration, asked: Questions, known: Mapping[str, Row]) -> Row:
    """Row of the questions that need not be followed; raises what a question raises."""
    row, posed = Row(), PoseAnalysis(pose)
    for name in asked.names:
        try:
            row |= known[name] if name in known else ANSWER_FUNCTIONS[name](posed, asked)
        except POSE_ERRORS as reason:
            raise type(reason)(f"no gradient of {name}: {reason}") from reason
    return row


def _stresses(
    poses: list[list[Configuration]], groups: list[tuple[list[int], StateBatch]], points: int
) -> list[list[Row]]:
    """Of poses and those beside each, `groups` of which are alike: stress of every leaf where it is largest in the first of
    its pose, and that of the leaf that is worst there."""
    every = [side for own in poses for side in own]
    followed: Mapping[str, Array] | None = None
    at = np.cumsum([0, *(len(own) for own in poses)])
    if len(groups) == 1 and len(groups[0][0]) == len(every):
        followed = batch_stress_at_peaks(groups[0][1], np.repeat(at[:-1], np.diff(at)), points=points)
    if followed is None:
        if len(poses) > 1:
            return [row for own in poses for row in _stresses([own], _alike(own), points)]
        found = [side.stress(points=points).leaves for side in every]
        marks = {name: int(np.argmax(leaf.von_mises_Pa)) for name, leaf in found[0].items()}
        followed = {n: np.array([own[n].von_mises_Pa.flat[k] for own in found]) for n, k in marks.items()}
    columns = [f"stress_MPa[{name}]" for name in followed]
    values = 1e-6 * np.array(list(followed.values())).T
    rows = []
    for first, end in pairwise(at.tolist()):
        worst = int(values[first].argmax())
        rows.append(
            [
                {"stress_MPa": own[worst]} | dict(zip(columns, own, strict=True))
                for own in values[first:end].tolist()
            ]
        )
    return rows


def _follow_modes(poses: list[Configuration], asked: Questions, rows: list[Row], sides: int) -> None:
    """Frequencies, added to the rows: of the modes of the first pose. What one side of a parameter finds its modes to be is
    known to the next, so that both sides of a mixture of equal frequencies are of one mode."""
    row, tracks = frequency_row(PoseAnalysis(poses[0]), asked)
    rows[0] |= row
    before, worst = tracks, tracks.first_parasitic
    for k, (pose, to) in enumerate(zip(poses[1:], rows[1:], strict=True)):
        before = before if k % sides else tracks
        row, before = frequency_row(PoseAnalysis(pose, PreviousPose(tracks=before)), asked)
        row["first_parasitic_Hz"] = np.nan if worst is None else before.frequency_Hz(worst)
        to |= row


def _moved(poses: list[list[Configuration]], sides: int, point: tuple[str, Any] | None) -> Array:
    """Displacement and rotation (poses, parameters, 6) of the point of a link from the second of the sides to the first."""
    found = np.full((len(poses), (len(poses[0]) - 1) // sides, 6), np.nan)
    if point is not None:
        node = poses[0][0].model.node_names.index(point[0])
        beside = [own[k + side] for own in poses for k in range(1, len(own), sides) for side in (0, 1)]
        rest = np.array([pose.model.rest.x[node] for pose in beside])
        x, R = (np.array([getattr(pose.motion, of)[node] for pose in beside]) for of in ("x", "R"))
        s = np.zeros_like(rest) if point[1] is None else np.asarray(point[1], float) - rest
        moved = x - rest + (R @ s[..., None])[..., 0] - s
        found[..., :3] = (moved[::2] - moved[1::2]).reshape(found[..., :3].shape)
        for own, turned in zip(found.reshape(-1, 6), R[::2] @ R[1::2].swapaxes(1, 2), strict=True):
            rotation_log(turned, own[3:])
    return found
