"""`ksd.gradient`: how every answer of a sweep changes with the parameters of a design, drives and loads.

Columns and units are those of `ksd.sweep`, parameters SI; the poses beside every pose are those of `ksd.solve.perturbed`.
What a sweep picks at every pose is picked once, at the pose, and followed to both sides: the leaf, station and point of
the largest stress (envelope theorem), and modes by their MAC. Of critical load factors mu it is 1/mu that is
differenced, as mu passes through infinity where there is no stress.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ksd.design.lines import Walk, fine_enough
from ksd.design.plan import Drawn, plan_lines
from ksd.design.questions import Asked, Before, Pose, Row, answers, asked_of, frequency_row
from ksd.design.sweep import recipe_of
from ksd.design.tracking import Tracks
from ksd.design.words import drive_rows
from ksd.errors import KinematicsError, SceneError
from ksd.html import joined
from ksd.model.mesh import Mesh
from ksd.numerics.rotations import rotation_log
from ksd.properties.forces import section_forces
from ksd.properties.stress import von_mises_at
from ksd.properties.words import Shown, listed
from ksd.properties.words import number as written
from ksd.scene.links import Link
from ksd.section.checks import nearest, truth
from ksd.solve.configuration import Configuration
from ksd.solve.perturbed import STEP, WIDE, Perturbed, parameters_of
from ksd.solve.solver import Method

Array = np.ndarray
FOLLOWED = ("stress", "frequencies")
"""Questions of which the pose says what is followed."""
NO_ANSWER = ("error", "_s_mm", "mac", "stable")
"""Parts of the names of columns that are no answers."""
KINK = 1e-3
"""Difference of the slopes to both sides, over the slope or the answer by the parameter, from which on it is a kink."""


@dataclass(frozen=True, repr=False)
class Gradient(Shown):
    """Derivatives of answers at poses: ``gradient[column, parameter]`` (poses,), in units of the column per SI unit of
    the parameter.

    values: the answers of the same equilibria (poses,) by column, in columns of `ksd.sweep`, and "stress_MPa[leaf]" of
    every leaf; poses: drive values and load case of each. point: how the point asked about moves, displacement [m] and
    rotation [rad] (poses, 6), by parameter. reasons: why there is no gradient, by column and pose; it is nan there.
    errors: |g(h) - g(2h)| / 3 in the order of `slopes`, or how far the slopes to both sides differ where there is a
    kink; None where they were not asked for. slopes (columns, parameters, poses).
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
                    f"there is no gradient of {what} '{name}'; {what}s are {', '.join(known)}{nearest(str(name), known)}"
                    if what == "column"
                    else f"there is no gradient by '{name}'; parameters are {', '.join(known)}{nearest(str(name), known)}"
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
            where = ", ".join(f"{k} {written(v) if isinstance(v, float) else v}" for k, v in pose.items())
            rows = [
                (c, written(float(self.values[c][n])), *(written(float(v)) for v in self.slopes[i, :, n]))
                for i, c in enumerate(self.columns)
            ]
            lines.append(
                listed(("answer", "value", *self.parameters), rows, f"Gradient per SI unit at {where}")
            )
        return joined(lines)


def gradient(
    design: Drawn,
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
    leads there; modes, orders, effects and plate curvatures are held beside it.

    Raises SceneError for unknown words, a parameter that changes more than numbers, and reduced bodies; KsdError of the
    pose that fails.
    """
    asked = replace(asked_of(questions, link, at, freed, modes=modes, errors=False), every=True)
    recipe = recipe_of(
        asked, method=method, accuracy=accuracy, relinearisations=0, mesh=mesh, extrapolate=extrapolate,
        effects=(("effects", effects), ("with_", with_), ("without", without)),
    )  # fmt: skip
    truth(errors, "errors")
    values = drive_rows(targets, drives, gradient)
    designs = None if at_design is None else [at_design]
    lines, _ = plan_lines(design, values, designs, loads, together=truth(together, "together"), call=gradient)
    shares = (WIDE, -WIDE, 2 * WIDE, -2 * WIDE) if errors else (STEP, -STEP)
    found: list[_AtPose] = []
    labels: list[Mapping[str, Any]] = []
    at_zero: dict[str, float] = {}
    for line in lines:
        if line.scene is None:
            raise SceneError(line.failure)
        solver = fine_enough(line, recipe, None)
        walk = Walk(solver, recipe)
        perturbed = Perturbed(shares)
        for drives_here in line.poses:
            pose = walk.pose(drives_here)
            parameters = parameters_of(
                line.scene, pose.targets, size=pose.model.arrays.size, at_design=at_design, by=by, sizes=sizes,
                design=design if callable(design) else None,
            )  # fmt: skip
            found.append(_AtPose(perturbed(pose, parameters), asked, [p.size for p in parameters]))
            labels.append({**({"load_case": line.labels["load_case"]} if loads else {}), **drives_here})
            at_zero |= {p.name: p.value for p in parameters}
    return _gathered(found, labels, at_zero)


class _AtPose:
    """Answers at a pose, `values` by column, and their slopes (columns, parameters), `errors` alike."""

    def __init__(
        self, poses: tuple[Configuration, list[list[Configuration]]], asked: Asked, sizes: list[float]
    ) -> None:
        with np.errstate(divide="ignore", invalid="ignore"):
            self._difference(*poses, asked, sizes)

    def _difference(
        self, pose: Configuration, sides: list[list[Configuration]], asked: Asked, sizes: list[float]
    ) -> None:
        """Central differences; with four sides to fourth order, and their errors."""
        follow = _Followed(pose, asked)
        self.columns = tuple(follow.values)
        self.values = np.array([follow.values[c] for c in self.columns])
        self.reasons: dict[str, str] = {}
        inverse = np.array([c.startswith("buckling") for c in self.columns])
        # of critical load factors 1/mu
        outer = np.where(inverse, -(self.values**2), 1.0)
        slopes, errors, moved = [], [], []
        for own, size in zip(sides, sizes, strict=True):
            rows, tracks = [], follow.tracks
            for side in own:
                row, tracks = follow.of(side, tracks)
                rows.append([row.get(c, np.nan) for c in self.columns])
            q, here = (np.where(inverse, 1.0 / a, a) for a in (np.array(rows), self.values))
            h = size * (STEP if len(own) == 2 else WIDE)
            slope = (q[0] - q[1]) / (2 * h)
            if len(own) > 2:
                wide = (q[2] - q[3]) / (4 * h)
                # half the difference of the slopes to both sides: falls with h unless there is a kink
                bends = (q[0] + q[1] - 2 * here) / (2 * h), (q[2] + q[3] - 2 * here) / (4 * h)
                kink = np.abs(2 * bends[0] - bends[1])
                kink[~(kink > KINK * np.maximum(np.abs(slope), np.abs(here) / size))] = 0.0
                errors.append(np.abs(outer) * np.maximum(np.abs(slope - wide) / 3, kink))
                slope = slope + (slope - wide) / 3
            slopes.append(outer * slope)
            moved.append(_motion(own[0], own[1], follow.point) / (2 * h))
        self.slopes = np.array(slopes).T.reshape(len(self.columns), -1)
        self.errors = np.array(errors).T if errors else None
        self.moved = np.array(moved)
        for i, column in enumerate(self.columns):
            if not np.isfinite(self.slopes[i]).all():
                self.reasons[column] = _why(column, float(self.values[i]), follow.link)
                self.slopes[i] = np.nan


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


class _Followed:
    """Answers of a pose, and of those beside it what they are there."""

    def __init__(self, pose: Configuration, asked: Asked) -> None:
        self.asked, self.tracks = asked, None
        self.link, self.point = "", None
        if asked.link is not None or pose.model.scene.drives:
            self.link, point = asked.point(pose.model.scene)
            self.point = self.link, point
        self.plain = replace(asked, questions=tuple(q for q in asked.questions if q not in FOLLOWED))
        row = self._plain(pose)
        if "stress" in asked.questions:
            found = pose.stress(points=asked.points)
            self.marks = {
                name: divmod(int(np.argmax(leaf.von_mises_Pa)), leaf.von_mises_Pa.shape[1])
                for name, leaf in found.leaves.items()
            }
            self.worst = found.where[0]
            row |= self._stress(pose)
        if "frequencies" in asked.questions:
            tracked, self.tracks = frequency_row(Pose(pose), asked)
            row |= tracked
        self.values = {
            c: float(v) for c, v in row.items() if isinstance(v, float) and not any(n in c for n in NO_ANSWER)
        }

    def _plain(self, pose: Configuration) -> Row:
        """Row of the questions that need not be followed; raises what a question raises."""
        row, _, failed = answers(pose, self.plain, Before())
        for name, reason in failed.items():
            raise type(reason)(f"no gradient of {name}: {reason}") from reason
        return row

    def _stress(self, pose: Configuration) -> Row:
        """Stress of every leaf at its mark, and that of the worst."""
        model, motion = pose.unreduced
        forces = section_forces(model, motion, points=self.asked.points, load_factor=pose.load_factor)
        found = von_mises_at(model, forces, self.marks)
        row = {f"stress_MPa[{n}]": 1e-6 * v for n, v in found.items()}
        return {"stress_MPa": row[f"stress_MPa[{self.worst}]"]} | row

    def of(self, side: Configuration, before: Tracks | None) -> tuple[Row, Tracks | None]:
        """Row of a pose beside this one, and the tracks for the next side, so that both sides of a mixture of equal
        frequencies are of one mode."""
        row = self._plain(side)
        if "stress" in self.asked.questions:
            row |= self._stress(side)
        if self.tracks is None:
            return row, None
        found, tracks = frequency_row(Pose(side, Before(tracks=before)), self.asked)
        first = self.tracks.first_parasitic
        found["first_parasitic_Hz"] = np.nan if first is None else tracks.frequency_Hz(first)
        return row | found, tracks


def _motion(plus: Configuration, minus: Configuration, point: Any) -> Array:
    """Displacement and rotation (6,) of the point of a link between two poses beside one another."""
    found = np.full(6, np.nan)
    if point is not None:
        link, at = point
        node = plus.model.node_names.index(link)
        ends = [p.model.rest.x[node] if at is None else np.asarray(at, float) for p in (plus, minus)]
        found[:3] = plus.displacement(link, ends[0]) - minus.displacement(link, ends[1])
        rotation_log(plus.motion.R[node] @ minus.motion.R[node].T, found[3:])
    return found


def _gathered(
    found: list[_AtPose], labels: list[Mapping[str, Any]], at_design: Mapping[str, float]
) -> Gradient:
    """One result of all poses; a column that some poses do not have is nan there."""
    columns = tuple(dict.fromkeys(c for one in found for c in one.columns))
    names = tuple(at_design)
    size = len(columns), len(names), len(found)
    values, slopes = np.full((size[0], size[2]), np.nan), np.full(size, np.nan)
    errors = np.full(size, np.nan) if found[0].errors is not None else None
    reasons: dict[tuple[str, int], str] = {}
    for n, one in enumerate(found):
        rows = [columns.index(c) for c in one.columns]
        values[rows, n], slopes[rows, :, n] = one.values, one.slopes
        if errors is not None and one.errors is not None:
            errors[rows, :, n] = one.errors
        reasons |= {(c, n): why for c, why in one.reasons.items()}
        reasons |= {(c, n): "this pose has no such answer" for c in columns if c not in one.columns}
    point = {p: np.array([one.moved[k] for one in found]) for k, p in enumerate(names)}
    return Gradient(
        columns, names, dict(zip(columns, values, strict=True)), slopes, point, tuple(labels), dict(at_design),
        reasons, errors,
    )  # fmt: skip
