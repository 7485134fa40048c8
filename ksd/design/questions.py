"""What a sweep asks of every pose, and the columns the answers go into; units are in the column names."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from ksd.checks import boolean, name_hint, names_of, show, similar_name_hint, vector, whole_number, word
from ksd.design.table import label_and_unit
from ksd.design.tracking import SPARE_MODES, IntermediateModes, Tracks, follow_with_bisection
from ksd.errors import ConvergenceError, KsdError, SceneError
from ksd.modal.leaf_bodies import full_model_state
from ksd.properties.extent import clearance, extent, why_no_clearance
from ksd.properties.frequencies import Modes, frequencies
from ksd.properties.parasitic import default_point, parasitic
from ksd.properties.state_batch import LoadedState, StateBatch, group_states
from ksd.properties.stiffness import (
    DIRECTIONS,
    BatchStiffness,
    PointStiffness,
    batch_stiffness,
    drive_stiffness,
    drive_units,
    finer_tangent,
    point_stiffness,
    principal_stiffness,
    support_stiffness,
)
from ksd.properties.stress import PeakStress, batch_peak_stress
from ksd.solve.answer import drive_kind
from ksd.solve.error import refined_configuration

Row = dict[str, Any]
DRIVE_VALUE_UNITS = {"translation": ("mm", 1e3), "rotation": ("deg", 180 / np.pi), "mixed": ("SI", 1.0)}
POINT_QUESTIONS = ("support_stiffness", "parasitic")
"""Questions about a point of a link."""
EFFORT_SUFFIX = {"translation": "force_N", "rotation": "moment_Nm", "mixed": "effort_SI"}


@dataclass(frozen=True)
class Questions:
    """The questions and their options. questions: names in ALL_QUESTIONS; link, at (3,) [m at rest]: the point whose
    support stiffness and parasitic motion are asked, by default where the first drive acts; freed: drives let go for
    the frequencies, all when None; modes: how many to follow besides the intended; points: stations per leaf for stress;
    errors: every question once more of the equilibrium on a finer mesh; every: the stress of every leaf, and
    all principal stiffnesses besides; usual: nothing was said, and a state without critical load factors is no failure."""

    names: tuple[str, ...]
    link: str | None = None
    at: tuple[float, float, float] | None = None
    freed: tuple[str, ...] | None = None
    modes: int = 3
    points: int = 25
    errors: bool = False
    detailed: bool = False
    is_default: bool = False

    @cached_property
    def has_point_question(self) -> bool:
        """Whether there is one about a point of a link."""
        return not set(POINT_QUESTIONS).isdisjoint(self.names)

    @cached_property
    def batch_part(self) -> Questions:
        """Those that many poses are asked together."""
        return replace(self, names=tuple(q for q in self.names if q in BATCH_QUESTIONS))

    @cached_property
    def single_part(self) -> Questions:
        """The others."""
        return replace(self, names=tuple(q for q in self.names if q not in BATCH_QUESTIONS))

    def point(self, scene: Any) -> tuple[str, tuple[float, float, float] | None]:
        """Link and point asked about; SceneError when the scene has no drive to take it from."""
        if self.link is not None:
            return self.link, self.at
        link, point = default_point(scene)
        return link, self.at if self.at is not None else point


def check_questions(questions: Questions, scene: Any) -> None:
    """SceneError where questions speak of a link, drive or support that a scene does not have."""
    blocks = [f"{j.name}/{block}" for j in scene.joints for block in j.joint.blocks() if block not in "AB"]
    links, rows = (*scene.links[1:], *blocks), [d.name for d in (*scene.drives, *scene.supports)]
    for what, names, known in (
        ("link", filter(None, [questions.link]), links),
        ("freed", questions.freed or (), rows),
    ):
        for name in names:
            if name not in known:
                kind = "link" if what == "link" else "drive or support"
                raise SceneError(
                    f"{what} = {show(name)}: there is no such {kind} in '{scene.name}'{name_hint(name, known)}"
                )


def parse_questions(
    questions: Any, link: Any, at: Any, freed: Any, *, modes: int = 3, errors: bool = False
) -> Questions:
    """The questions as words of a call say them; SceneError for words that are wrong."""
    names = names_of(questions, "questions")
    for q in names:
        if q not in ALL_QUESTIONS:
            raise SceneError(
                f"question {q!r} is not known; ask {', '.join(ALL_QUESTIONS)}{similar_name_hint(q, ALL_QUESTIONS)}"
            )
    if whole_number(modes, "modes") > 50:
        raise SceneError(f"modes = {modes}: between 1 and 50 modes can be followed")
    point = None if at is None else vector(at, "at", unit="m")
    let_go = None if freed is None else names_of(freed, "freed")
    name = None if link is None else word(getattr(link, "name", link), "link")
    return Questions(names, name, point, let_go, modes, errors=boolean(errors, "errors"))


def unanswerable_questions(scene: Any, link: str | None = None) -> dict[str, str]:
    """Questions to which a scene has no answer, with the reason: sweeps and reports leave them out unless they are named;
    link: asked about."""
    found: dict[str, str] = {}
    leaves = scene.leaf_names().values()
    if not scene.masses and not any(leaf.material.density for leaf in leaves):
        found["frequencies"] = "nothing has mass"
    if not leaves:
        found |= dict.fromkeys(("stress", "size"), "there is no leaf spring")
    if meet := why_no_clearance(scene):
        found["clearance"] = meet
    if not scene.drives and link is None:
        found |= dict.fromkeys(POINT_QUESTIONS, "no drive whose point could be asked about: name a link")
    return found


def drive_columns(scene: Any) -> dict[str, tuple[str, float]]:
    """Column and factor (column = factor * SI) of every drive: "top_mm", "hinge_deg"."""
    found = {}
    for drive in scene.drives:
        unit, factor = DRIVE_VALUE_UNITS[drive_kind(drive)]
        found[drive.name] = f"{drive.name}_{unit}", factor
    return found


def column_questions(scene: Any, modes: int) -> dict[str, str]:
    """Columns that answers of a scene can be judged by, and the question of each."""
    found: dict[str, str] = {}
    for drive in scene.drives:
        found[f"{drive.name}_{EFFORT_SUFFIX[drive_kind(drive)]}"] = "force"
        unit = "Nm_per_rad" if drive.terms[0].kind == "rotation" else "N_per_m"
        found[f"{drive.name}_stiffness_{unit}"] = "drive_stiffness"
    for d in (*DIRECTIONS, "worst"):
        found |= {f"support_{d}_N_per_m": "support_stiffness"} if len(d) != 2 else {}
        found |= {f"support_{d}_Nm_per_rad": "support_stiffness"} if len(d) != 1 else {}
    tracked = ["intended", *(f"intended_{k + 1}" for k in range(len(scene.drives)))]
    tracked += [f"parasitic_{k + 1}" for k in range(modes)]
    found |= {f"{name}_Hz": "frequencies" for name in ("first_parasitic", *tracked)}
    found |= {"stress_MPa": "stress", "strain_energy_J": "energy", "clearance_mm": "clearance"}
    found |= {f"distance_{d.name}_mm": "distance" for d in scene.distances}
    found |= {f"parasitic_{a}_mm": "parasitic" for a in "xyz"} | {f"size_{a}_mm": "size" for a in "xyz"}
    found |= {f"parasitic_r{a}_mrad": "parasitic" for a in "xyz"}
    return found | {f"buckling_{sign}": "buckling" for sign in ("positive", "negative")}


@dataclass(frozen=True)
class PreviousPose:
    """What the pose before was found to do, for the next one to go on from, and the pose itself. between: solves for a pose
    on the way at drive values by name [m or rad]; truth: the same of the equilibria that error figures come from."""

    tracks: Tracks | None = None
    pose: Any = None
    between: Callable[[Row], Any] | None = None
    truth: PreviousPose | None = None


@dataclass(frozen=True)
class PoseAnalysis:
    """A configuration under question, with what several questions stand on."""

    configuration: Any
    before: PreviousPose = PreviousPose()

    def __getattr__(self, name: str) -> Any:
        return getattr(self.configuration, name)

    @cached_property
    def tangent(self) -> Any:
        """`finer_tangent` with all drives held."""
        return finer_tangent(self.model, self.refinement_start, load_factor=self.load_factor)

    def stiffness_at(self, questions: Questions) -> PointStiffness:
        """Stiffness of the point asked about."""
        known = self.__dict__.get("point")
        if known is None:
            model = self.model
            link, at = questions.point(model.scene)
            known = point_stiffness(model, self.refinement_start, link, at=at, tangent=self.tangent)
            self.__dict__["point"] = known
        found: PointStiffness = known
        return found


def _force(pose: Any, questions: Questions) -> Row:
    row, known = Row(), pose.method_error is not None
    for i, (drive, force) in enumerate(zip(pose.model.scene.drives, pose.forces.values(), strict=True)):
        effort = EFFORT_SUFFIX[drive_kind(drive)]
        row[f"{drive.name}_{effort}"] = force
        if known:
            row[f"{drive.name}_error_{effort.rsplit('_', 1)[1]}"] = float(pose.error.force[i])
    if known:
        row["error_percent"] = 100.0 * float(pose.error.relative)
    return row


SUPPORT_COLUMNS = tuple(f"support_{d}_{'N_per_m' if len(d) == 1 else 'Nm_per_rad'}" for d in DIRECTIONS)
WORST_SUPPORT_COLUMNS = ("support_worst_N_per_m", "support_worst_Nm_per_rad")
"""Columns of the least principal stiffness of a point."""


def _drive_stiffness(pose: Any, questions: Questions) -> Row:
    found = drive_stiffness(pose.model, pose.refinement_start, tangent=pose.tangent)
    return _drives_row(found.names, found.units, np.diagonal(found.matrix))


def _drives_row(names: Sequence[str], units: Sequence[str], stiffness: np.ndarray) -> Row:
    """Row of the stiffness (d,) of every drive."""
    columns = (f"{n}_stiffness_{unit.replace('/', '_per_')}" for n, unit in zip(names, units, strict=True))
    return dict(zip(columns, stiffness.tolist(), strict=True))


def _support_stiffness(pose: Any, questions: Questions) -> Row:
    found = pose.stiffness_at(questions)
    return _supports_row(np.array(list(found.supports.values())), found.principal, questions)


def _supports_row(supports: np.ndarray, principal: np.ndarray, questions: Questions) -> Row:
    """Row of the stiffness (6,) in every direction and the principal ones (2, 3)."""
    return _supports_rows(supports[None], principal[None], questions)[0]


def _supports_rows(supports: np.ndarray, principal: np.ndarray, questions: Questions) -> list[Row]:
    """The same of D states, with a leading axis."""
    names, kept = SUPPORT_COLUMNS, 3 if questions.detailed else 1
    for column in WORST_SUPPORT_COLUMNS:
        names = (*names, column, *others(column)[: kept - 1])
    values = np.concatenate([supports, principal[:, :, :kept].reshape(len(supports), -1)], axis=1)
    values[np.isinf(values)] = np.nan
    return [dict(zip(names, own, strict=True)) for own in values.tolist()]


def others(column: str) -> tuple[str, ...]:
    """Columns of the principal stiffnesses beside the least, which kinks where it meets them; none of other columns."""
    return (f"{column}[2]", f"{column}[3]") if column in WORST_SUPPORT_COLUMNS else ()


def _finite(value: float, most: float = np.inf) -> float:
    """nan for what is infinite, or so large that it is rounding: it would rule every plot and table."""
    return value if abs(value) < most else float("nan")


def _stress(pose: Any, questions: Questions) -> Row:
    found = pose.stress(points=questions.points)
    return stress_row(
        {name: PeakStress(leaf.largest_Pa, *leaf.where) for name, leaf in found.leaves.items()}, questions
    )


def stress_row(found: Mapping[str, PeakStress], questions: Questions) -> Row:
    """Row of the largest stress of every leaf."""
    worst = max(found, key=lambda name: found[name].largest_Pa)
    every = (
        {f"stress_MPa[{n}]": 1e-6 * peak.largest_Pa for n, peak in found.items()}
        if questions.detailed
        else {}
    )
    most, s, point = found[worst]
    return every | {
        "stress_MPa": 1e-6 * most,
        "stress_leaf": worst,
        "stress_s_mm": 1e3 * s,
        "stress_point": point,
    }


def _parasitic(pose: Any, questions: Questions) -> Row:
    """Motion of the point and rotation of its link, less what the drives of this link prescribe along their axes."""
    link, at = questions.point(pose.model.scene)
    found = parasitic(pose.model, pose.motion, link, at=at)
    shift, turn = found.shift, found.turn
    row: Row = {f"parasitic_{a}_mm": 1e3 * float(v) for a, v in zip("xyz", shift, strict=True)}
    return row | {f"parasitic_r{a}_mrad": 1e3 * float(v) for a, v in zip("xyz", turn, strict=True)}


def _energy(pose: Any, questions: Questions) -> Row:
    return {"strain_energy_J": float(sum(pose.strain_energy().values()))}


def _buckling(pose: Any, questions: Questions) -> Row:
    """Factors on all stresses of the state; a state without stress has none."""
    try:
        found = pose.buckling(count=1)
    except SceneError as reason:
        if "no stress" not in str(reason):
            raise
        return {"buckling_positive": float("nan"), "buckling_negative": float("nan")}
    return {
        "buckling_positive": _finite(found.positive, MAX_LOAD_FACTOR),
        "buckling_negative": _finite(found.negative, MAX_LOAD_FACTOR),
    }


def _size(pose: Any, questions: Questions) -> Row:
    """Extent of the leaf springs, and where it begins and ends: over several poses it is the highest end less the lowest."""
    low, high = 1e3 * extent(*pose.unreduced_state)
    row: Row = {}
    for a, begin, end in zip("xyz", low.tolist(), high.tolist(), strict=True):
        row |= {f"size_{a}_mm": end - begin, f"lowest_{a}_mm": begin, f"highest_{a}_mm": end}
    return row


def _distance(pose: Any, questions: Questions) -> Row:
    return {f"distance_{d.name}_mm": 1e3 * pose.distance(d.name) for d in pose.model.scene.distances}


def _clearance(pose: Any, questions: Questions) -> Row:
    found = clearance(*pose.unreduced_state)
    return {"clearance_mm": 1e3 * found.distance, "clearance_leaves": " and ".join(found.leaves)}


ANSWER_FUNCTIONS: dict[str, Callable[[Any, Questions], Row]] = {
    "force": _force,
    "drive_stiffness": _drive_stiffness,
    "support_stiffness": _support_stiffness,
    "stress": _stress,
    "parasitic": _parasitic,
    "energy": _energy,
    "buckling": _buckling,
    "size": _size,
    "clearance": _clearance,
    "distance": _distance,
}
ALL_QUESTIONS = (
    "force", "drive_stiffness", "support_stiffness", "frequencies", "stress", "parasitic", "energy", "buckling", "size",
    "clearance",
    "distance",
)  # fmt: skip
"""All questions. Factors of "buckling" are on all stresses of a state; "size" and "clearance" are of the leaf springs;
"distance" are those that the scene names."""
ROUNDING_TOLERANCE = 1e-9
"""Numbers below this, in the units of the columns, are rounding of a state at rest."""
MAX_LOAD_FACTOR = 1e9
"""Critical load factors beyond this mean that the state carries no stress but rounding."""
BATCH_QUESTIONS = {"support_stiffness", "drive_stiffness", "stress"}
"""Questions that many poses are asked together."""
BATCH_SIZE = 64
"""Poses of which all stresses are held at once."""
POSE_ERRORS: tuple[type[Exception], ...] = (KsdError, ArithmeticError, np.linalg.LinAlgError, RuntimeError)
"""What one pose may raise without ending the sweep: our own errors, and arithmetic gone wrong."""


def _modes(pose: PoseAnalysis, questions: Questions, *, more: int = 0) -> Modes:
    """The modes of a pose, as many as are followed and some to spare."""
    freed = tuple(pose.model.drive_names) if questions.freed is None else questions.freed
    count = questions.modes + len(freed) + SPARE_MODES + more
    pose._of_leaves("frequencies")
    return frequencies(
        *full_model_state(pose.model, pose.refinement_start),
        count=count,
        freed=freed,
        load_factor=pose.load_factor,
    )


def _on_the_way(pose: PoseAnalysis, questions: Questions) -> IntermediateModes | None:
    """Modes at a share of the way from the pose before to this one."""
    first, solve = pose.before.pose, pose.before.between
    if first is None or solve is None:
        return None

    def between(share: float, more: int) -> Modes:
        if share in (0.0, 1.0):
            return _modes(pose if share else PoseAnalysis(first), questions, more=more)
        values = {n: (1.0 - share) * first.targets[n] + share * v for n, v in pose.targets.items()}
        return _modes(PoseAnalysis(solve(values)), questions, more=more)

    return between


def frequency_row(pose: PoseAnalysis, questions: Questions) -> tuple[Row, Tracks]:
    """Frequencies [Hz] of the followed modes, and the tracks for the next pose."""
    before = pose.before.tracks
    modes = _modes(pose, questions)
    tracks = follow_with_bisection(before, modes, questions.modes, _on_the_way(pose, questions))
    row: Row = {f"{n}_Hz": tracks.frequency_Hz(t) for t, n in enumerate(tracks.names) if tracks.rank[t] >= 0}
    first = tracks.first_parasitic
    row["first_parasitic_Hz"] = float("nan") if first is None else tracks.frequency_Hz(first)
    row["first_parasitic_mode"] = "" if first is None else tracks.names[first]
    row["mac"] = min(a for a, k in zip(tracks.mac, tracks.rank, strict=True) if k >= 0)
    return row, tracks


class BatchAnswer(NamedTuple):
    """What was answered of a pose together with others: rows by question; compliance (6, 6) of the point asked about;
    stable: whether its stiffness is that of a stable equilibrium, wherever the Newton step to the finer mesh began."""

    rows: dict[str, Row]
    compliance: np.ndarray | None
    stable: bool = False


NOT_ANSWERED = BatchAnswer({}, None)


def answer_batch(poses: Sequence[Any], questions: Questions) -> list[BatchAnswer]:
    """What of stiffness and stress can be answered of many poses at once; anything that has a `model`, an `equilibrium`
    and a load factor will do. What is missing is asked of the pose alone, which also says why it has no answer."""
    found = [NOT_ANSWERED] * len(poses)
    places: list[int] = []
    every: list[LoadedState] = []
    for k, pose in enumerate(poses if BATCH_QUESTIONS & set(questions.names) else []):
        with suppress(ConvergenceError):
            every.append((pose.model, pose.equilibrium, pose.load_factor))
            places.append(k)
    for first in range(0, len(every), BATCH_SIZE):
        for numbers, states in group_states(every[first : first + BATCH_SIZE]):
            for n, own in zip(numbers, answer_group(states, questions), strict=True):
                found[places[first + n]] = own
    return found


def answer_group(states: StateBatch, questions: Questions) -> list[BatchAnswer]:
    """`answer_batch` of states that are group_states."""
    rows: list[dict[str, Row]] = [{} for _ in states.model_index]
    compliance: Any = None
    stable = np.zeros(len(rows), bool)
    point, drives = ("support_stiffness" in questions.names, "drive_stiffness" in questions.names)
    if point or drives:
        # what is wrong with the point is told where the pose is asked alone
        with suppress(SceneError):
            # by default the point is where the drive of each design acts
            places = [questions.point(model.scene) for model in states.models] if point else [(None, None)]
            stiff = batch_stiffness(states, places[0][0], at=[at for _, at in places], drives=drives)
            compliance, stable = stiff.compliance, stiff.valid & stiff.stable
            _note_stiffness(stiff, states, questions, rows)
    found = batch_peak_stress(states, points=questions.points) if "stress" in questions.names else None
    for row, mine in zip(rows, found or (), strict=False):
        row["stress"] = stress_row(mine, questions)
    return [
        BatchAnswer(row, compliance[n] if "support_stiffness" in row else None, bool(stable[n]))
        for n, row in enumerate(rows)
    ]


def _note_stiffness(
    stiff: BatchStiffness, states: StateBatch, questions: Questions, rows: list[dict[str, Row]]
) -> None:
    """Rows of stiffness, by question, of the states that have an answer."""
    good = np.flatnonzero(stiff.valid).tolist()
    if stiff.compliance is not None:
        supports = support_stiffness(stiff.compliance, states.sizes)
        principal = principal_stiffness(stiff.compliance, states.sizes)
        found = _supports_rows(supports, principal, questions)
        for n in good:
            rows[n]["support_stiffness"] = found[n]
    if stiff.drives is not None:
        names = states.models[0].drive_names
        units = drive_units(states.models[0], range(len(names)))
        for n in good:
            rows[n]["drive_stiffness"] = _drives_row(names, units, np.diagonal(stiff.drives[n]))


def answer_questions(
    pose: PoseAnalysis, questions: Questions, known: Mapping[str, Row] = MappingProxyType({})
) -> tuple[Row, PreviousPose, dict[str, Exception]]:
    """Row of one pose, what the next one goes on from, and why a question could not be answered, by question; known: rows
    of questions that were answered together with those of other poses."""
    row: Row = {}
    failed: dict[str, Exception] = {}
    before, configuration = pose.before, pose.configuration
    tracks = before.tracks
    truth = _truth(configuration, before) if questions.errors else None
    followed = None if truth is None else truth.before.tracks
    for name in questions.names:
        try:
            if name in known:
                found = known[name]
            elif name == "frequencies":
                found, tracks = frequency_row(pose, questions)
            else:
                found = ANSWER_FUNCTIONS[name](pose, questions)
            row |= found
            if truth is not None:
                if name == "frequencies":
                    again, followed = frequency_row(truth, questions)
                else:
                    again = ANSWER_FUNCTIONS[name](truth, questions)
                row[f"{name}_error_percent"] = _error_percent(found, again)
        except POSE_ERRORS as reason:
            if questions.is_default and name == "buckling":
                row |= dict.fromkeys(("buckling_positive", "buckling_negative"), float("nan"))
            else:
                failed[name] = reason
    after = None if truth is None else replace(truth.before, tracks=followed, pose=truth.configuration)
    return row, PreviousPose(tracks, configuration, before.between, after), failed


def _truth(configuration: Any, before: PreviousPose) -> PoseAnalysis:
    """The equilibrium next to a state on a finer mesh, which goes on from that of the pose before."""
    solve = before.between
    between = None if solve is None else lambda values: refined_configuration(solve(values))
    return PoseAnalysis(refined_configuration(configuration), before.truth or PreviousPose(between=between))


def _error_percent(one: Row, other: Row) -> float:
    """Largest change of the numbers of a question [%]: of stiffnesses and frequencies each relative to itself, of others to
    the largest of their unit, as some of them are zero; zero for what is rounding."""
    changes: dict[str, list[float]] = {}
    for column, value in one.items():
        # where the stress is largest may well change ends; the MAC of modes is no answer
        if (
            isinstance(value, float)
            and np.isfinite(value)
            and "error" not in column
            and column not in ("stress_s_mm", "mac")
        ):
            unit = label_and_unit(column)[1]
            own = unit == "Hz" or "/" in unit
            worst = changes.setdefault(column if own else unit, [0.0, 0.0])
            worst[0] = max(worst[0], abs(other.get(column, np.inf) - value))
            worst[1] = max(worst[1], abs(value))
    return 100.0 * max(
        (change / size for change, size in changes.values() if size > ROUNDING_TOLERANCE), default=0.0
    )
