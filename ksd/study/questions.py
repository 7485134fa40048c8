"""Questions of a sweep, how each is answered at a pose, and the columns of the answers, with their units in the names."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from ksd.answers.extent import clearance, common_extent, leaf_extents, why_no_clearance
from ksd.answers.frequencies import Modes, frequencies
from ksd.answers.parasitic import default_point, parasitic
from ksd.answers.plant import check_damping, make_plant, vibration_inputs
from ksd.answers.state_batch import LoadedState, StateBatch, group_states
from ksd.answers.stiffness import (
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
from ksd.answers.stress import PeakStress, batch_peak_stress
from ksd.checks import (
    boolean,
    direction,
    name_hint,
    names_of,
    show,
    similar_name_hint,
    vector,
    whole_number,
    word,
)
from ksd.errors import ConvergenceError, KsdError, SceneError
from ksd.modal.leaf_bodies import full_model_state
from ksd.solvers.error import refined_configuration
from ksd.solvers.random_vibration import check_spectra, rms_values
from ksd.study.table import label_and_unit
from ksd.study.tracking import SPARE_MODES, IntermediateModes, Tracks, follow_with_bisection

Row = dict[str, Any]
DRIVE_VALUE_UNITS = {"length": ("mm", 1e3), "angle": ("deg", 180 / np.pi), "number": ("SI", 1.0)}
"""Unit of the column of a drive value and the factor to it from SI, by its dimension."""
POINT_QUESTIONS = ("support_stiffness", "parasitic")
"""Questions about a point of a link."""
EFFORT_SUFFIX = {"length": "force_N", "angle": "moment_Nm", "number": "effort_SI"}
"""End of the column name of a drive force or moment, by dimension of the drive."""


@dataclass(frozen=True)
class Questions:
    """Questions and their options.

    names: of KNOWN_QUESTIONS. link, at: point of "support_stiffness" and "parasitic", at (3,) [m] undeformed; that of the
    first drive when None. along (3,): wanted direction of "parasitic", see `parasitic`. freed: drives and supports
    released for "frequencies", all drives when None. modes: number of modes followed in addition to the intended ones.
    points: stations per leaf spring for "stress". errors: each question is also answered at the equilibrium on a finer
    mesh. detailed: also the stress of every leaf spring and all principal stiffnesses. is_default: the caller named no
    questions, so that a state without critical load factors is no failure. psd, damping: of "vibration", spectra by input
    and damping as in `Configuration.random_vibration`.
    """

    names: tuple[str, ...]
    link: str | None = None
    at: tuple[float, float, float] | None = None
    freed: tuple[str, ...] | None = None
    modes: int = 3
    points: int = 25
    errors: bool = False
    detailed: bool = False
    is_default: bool = False
    along: tuple[float, float, float] | None = None
    psd: tuple[tuple[str, tuple[tuple[float, float], ...]], ...] = ()
    damping: Any = None

    @cached_property
    def has_point_question(self) -> bool:
        """Whether a question concerns a point of a link."""
        return not set(POINT_QUESTIONS).isdisjoint(self.names)

    @cached_property
    def batch_part(self) -> Questions:
        """The questions that are answered for many poses at once."""
        return replace(self, names=tuple(q for q in self.names if q in BATCH_QUESTIONS))

    @cached_property
    def single_part(self) -> Questions:
        """The questions that are answered pose by pose."""
        return replace(self, names=tuple(q for q in self.names if q not in BATCH_QUESTIONS))

    def point(self, scene: Any) -> tuple[str, tuple[float, float, float] | None]:
        """Link and point (3,) [m] of POINT_QUESTIONS. Raises SceneError if none is given and the scene has no drive."""
        if self.link is not None:
            return self.link, self.at
        link, point = default_point(scene)
        return link, self.at if self.at is not None else point

    def fingerprint_text(self) -> str:
        """Text of the questions in the fingerprint of a resume file; it must not change, or old files are refused."""
        return (
            f"Asked(questions={self.names!r}, link={self.link!r}, at={self.at!r}, freed={self.freed!r}, "
            f"modes={self.modes!r}, points={self.points!r}, errors={self.errors!r}, every={self.detailed!r}, "
            f"usual={self.is_default!r})"
            + ("" if self.along is None else f", along={self.along!r}")
            + (f", psd={self.psd!r}" if self.psd else "")
            + ("" if self.damping is None else f", damping={self.damping!r}")
        )


def check_questions(questions: Questions, scene: Any) -> None:
    """Raise SceneError where the options name a link, drive or support that the scene does not have."""
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
    inputs = vibration_inputs(scene)
    for name, _ in questions.psd:
        if name not in inputs:
            raise SceneError(f"psd of {show(name)}: there is no such input{name_hint(name, inputs)}")
        if name in rows and questions.freed is not None and name not in questions.freed:
            raise SceneError(
                f"psd of '{name}': this drive is held, and its force moves nothing; name it in freed"
            )


def parse_questions(
    questions: Any,
    link: Any,
    at: Any,
    freed: Any,
    *,
    along: Any = None,
    modes: int = 3,
    errors: bool = False,
    psd: Any = None,
    damping: Any = None,
) -> Questions:
    """Questions from the arguments of a public function; when None ALL_QUESTIONS. Raises SceneError for invalid ones."""
    usual = ALL_QUESTIONS if psd is None else KNOWN_QUESTIONS
    names = usual if questions is None else names_of(questions, "questions")
    for q in names:
        if q not in KNOWN_QUESTIONS:
            raise SceneError(
                f"question {q!r} is not known; ask {', '.join(KNOWN_QUESTIONS)}{similar_name_hint(q, KNOWN_QUESTIONS)}"
            )
    if whole_number(modes, "modes") > 50:
        raise SceneError(f"modes = {modes}: between 1 and 50 modes can be followed")
    point = None if at is None else vector(at, "at", unit="m")
    let_go = None if freed is None else names_of(freed, "freed")
    name = None if link is None else word(getattr(link, "name", link), "link")
    wanted = None if along is None else direction(along, "along")
    spectra = {} if psd is None else check_spectra(psd)
    return Questions(
        names, name, point, let_go, modes, errors=boolean(errors, "errors"), along=wanted,
        psd=tuple((n, tuple(map(tuple, rows.tolist()))) for n, rows in spectra.items()), damping=check_damping(damping),
    )  # fmt: skip


def unanswerable_questions(scene: Any, link: str | None = None) -> dict[str, str]:
    """Questions that a scene cannot answer, with the reason.

    Sweeps and reports leave them out unless the caller names them; link: as in `Questions`.
    """
    reasons: dict[str, str] = {}
    leaves = scene.leaf_names().values()
    if not scene.masses and not any(leaf.material.density for leaf in leaves):
        reasons |= dict.fromkeys(("frequencies", "vibration"), "nothing has mass")
    if not leaves:
        reasons |= dict.fromkeys(("stress", "size"), "there is no leaf spring")
    if why_not := why_no_clearance(scene):
        reasons["clearance"] = why_not
    if not scene.drives and link is None:
        reasons |= dict.fromkeys(POINT_QUESTIONS, "no drive whose point could be asked about: name a link")
    return reasons


def drive_columns(scene: Any) -> dict[str, tuple[str, float]]:
    """Column, such as "top_mm" or "hinge_deg", and factor (column = factor * SI) by drive name."""
    columns = {}
    for drive in scene.drives:
        unit, factor = DRIVE_VALUE_UNITS[drive.dimension]
        columns[drive.name] = f"{drive.name}_{unit}", factor
    return columns


def column_questions(scene: Any, modes: int, freed: Collection[str] | None = None) -> dict[str, str]:
    """Question by column, for all columns that a target or limit of a job can name; freed: drives, all when None."""
    columns: dict[str, str] = {}
    for drive in scene.drives:
        columns[f"{drive.name}_{EFFORT_SUFFIX[drive.dimension]}"] = "force"
        unit = "Nm_per_rad" if drive.terms[0].kind == "rotation" else "N_per_m"
        columns[f"{drive.name}_stiffness_{unit}"] = "drive_stiffness"
    columns |= dict.fromkeys(_stop_columns(scene).values(), "force")
    columns |= {f"{cable.name}_tension_N": "force" for cable in scene.cables}
    columns |= {f"{c.name}_{kind}_N": "force" for c in scene.contacts for kind in ("normal", "friction")}
    for d in (*DIRECTIONS, "worst"):
        columns |= {f"support_{d}_N_per_m": "support_stiffness"} if len(d) != 2 else {}
        columns |= {f"support_{d}_Nm_per_rad": "support_stiffness"} if len(d) != 1 else {}
    count = len(scene.drives) if freed is None else len(freed)
    # as in `mode_names`
    tracked = ["intended"] if count == 1 else [f"intended_{k + 1}" for k in range(count)]
    tracked += [f"parasitic_{k + 1}" for k in range(modes)]
    columns |= {f"{name}_Hz": "frequencies" for name in ("first_parasitic", *tracked)}
    columns |= {"stress_MPa": "stress", "strain_energy_J": "energy", "clearance_mm": "clearance"}
    columns |= {f"distance_{d.name}_mm": "distance" for d in scene.distances}
    columns |= {f"parasitic_{a}_mm": "parasitic" for a in "xyz"} | {f"size_{a}_mm": "size" for a in "xyz"}
    columns |= {f"parasitic_r{a}_mrad": "parasitic" for a in "xyz"}
    columns |= dict.fromkeys(["settling_s", *(c for c, _ in rms_columns(scene))], "vibration")
    return columns | {f"buckling_{sign}": "buckling" for sign in ("positive", "negative")}


@dataclass(frozen=True)
class PreviousPose:
    """What the analysis of a pose continues from.

    tracks: modes at the previous pose. pose: its configuration. solve: returns the configuration at drive values by name
    [m or rad], for poses in between. reference: the same of the equilibria on the finer mesh, for error figures.
    """

    tracks: Tracks | None = None
    pose: Any = None
    solve: Callable[[Row], Any] | None = None
    reference: PreviousPose | None = None


@dataclass(frozen=True)
class PoseAnalysis:
    """A configuration, with the quantities that several questions share; its other attributes are the configuration's."""

    configuration: Any
    previous: PreviousPose = PreviousPose()

    def __getattr__(self, name: str) -> Any:
        return getattr(self.configuration, name)

    @cached_property
    def tangent(self) -> Any:
        """`finer_tangent` with all drives held."""
        return finer_tangent(self.model, self.refinement_start, load_factor=self.load_factor)

    def stiffness_at(self, questions: Questions) -> PointStiffness:
        """Stiffness of the point of the questions, computed once."""
        cached: PointStiffness | None = self.__dict__.get("point_stiffness")
        if cached is None:
            link, at = questions.point(self.model.scene)
            cached = point_stiffness(self.model, self.refinement_start, link, at=at, tangent=self.tangent)
            self.__dict__["point_stiffness"] = cached
        return cached


def _force(pose: Any, questions: Questions) -> Row:
    """Force or moment of every drive, with error columns where the method has an error estimate."""
    row, has_error = Row(), pose.method_error is not None
    for i, (drive, force) in enumerate(zip(pose.model.scene.drives, pose.forces.values(), strict=True)):
        effort = EFFORT_SUFFIX[drive.dimension]
        row[f"{drive.name}_{effort}"] = force
        if has_error:
            row[f"{drive.name}_error_{effort.rsplit('_', 1)[1]}"] = float(pose.error.force[i])
    if has_error:
        row["error_percent"] = 100.0 * float(pose.error.relative)
    return row


def contact_row(pose: Any) -> Row:
    """Force of every end stop, tension of every cable, normal and friction force of every contact; none without them."""
    stops, found = _stop_columns(pose.model.original_scene), Row()
    found |= {stops[name]: part.force for name, part in pose.stops.items()}
    found |= {f"{name}_tension_N": part.force for name, part in pose.cables.items()}
    for name, part in pose.contacts.items():
        found |= {f"{name}_normal_N": part.N, f"{name}_friction_N": float(np.linalg.norm(part.T))}
    return found


def _stop_columns(scene: Any) -> dict[str, str]:
    """Column of the force of every limit of an end stop, such as "end.high_force_N", by the name of the limit."""
    return {name: f"{name}_{EFFORT_SUFFIX[stop.dimension]}" for stop in scene.stops for name in stop.limits}


SUPPORT_COLUMNS = tuple(f"support_{d}_{'N_per_m' if len(d) == 1 else 'Nm_per_rad'}" for d in DIRECTIONS)
WORST_SUPPORT_COLUMNS = ("support_worst_N_per_m", "support_worst_Nm_per_rad")
"""Columns of the least principal stiffness of a point."""


def _drive_stiffness(pose: Any, questions: Questions) -> Row:
    stiffness = drive_stiffness(pose.model, pose.refinement_start, tangent=pose.tangent)
    return _drive_stiffness_row(stiffness.names, stiffness.units, np.diagonal(stiffness.matrix))


def _drive_stiffness_row(names: Sequence[str], units: Sequence[str], stiffness: np.ndarray) -> Row:
    """Row of the stiffness (d,) of every drive."""
    columns = (f"{n}_stiffness_{unit.replace('/', '_per_')}" for n, unit in zip(names, units, strict=True))
    return dict(zip(columns, stiffness.tolist(), strict=True))


def _support_stiffness(pose: Any, questions: Questions) -> Row:
    stiffness = pose.stiffness_at(questions)
    supports = np.array(list(stiffness.supports.values()))
    return _support_stiffness_rows(supports[None], stiffness.principal[None], questions)[0]


def _support_stiffness_rows(supports: np.ndarray, principal: np.ndarray, questions: Questions) -> list[Row]:
    """Rows of D states: stiffness in every direction (D, 6) and the principal ones (D, 2, 3), ascending."""
    names, count = SUPPORT_COLUMNS, 3 if questions.detailed else 1
    for column in WORST_SUPPORT_COLUMNS:
        names = (*names, column, *columns_above(column)[: count - 1])
    values = np.concatenate([supports, principal[:, :, :count].reshape(len(supports), -1)], axis=1)
    return [dict(zip(names, own, strict=True)) for own in values.tolist()]


def columns_above(column: str) -> tuple[str, ...]:
    """Columns of the principal stiffnesses above the least one, and of the parasitic frequency above the lowest, which have
    kinks where two are equal; () for others."""
    if column in WORST_SUPPORT_COLUMNS:
        return f"{column}[2]", f"{column}[3]"
    return (f"{column}[2]",) if column == "first_parasitic_Hz" else ()


def _stress(pose: Any, questions: Questions) -> Row:
    """Largest von Mises stress, and the leaf spring and the point where it is."""
    leaves = pose.stress(points=questions.points).leaves
    return _stress_row(
        {name: PeakStress(leaf.largest_Pa, *leaf.where) for name, leaf in leaves.items()}, questions
    )


def _stress_row(peaks: Mapping[str, PeakStress], questions: Questions) -> Row:
    """Row of the largest stress, from that of every leaf spring by name."""
    row: Row = {}
    if questions.detailed:
        row |= {f"stress_MPa[{name}]": 1e-6 * peak.largest_Pa for name, peak in peaks.items()}
    worst = max(peaks, key=lambda name: peaks[name].largest_Pa)
    largest, s, point = peaks[worst]
    return row | {
        "stress_MPa": 1e-6 * largest,
        "stress_leaf": worst,
        "stress_s_mm": 1e3 * s,
        "stress_point": point,
    }


def _parasitic(pose: Any, questions: Questions) -> Row:
    """Motion of the point and rotation of its link, less what the drives prescribe, see `Configuration.parasitic`."""
    link, at = questions.point(pose.model.scene)
    motion = parasitic(pose.model, pose.motion, pose.targets, link, at=at, along=questions.along)
    shift, turn = motion.shift, motion.turn
    row: Row = {f"parasitic_{a}_mm": 1e3 * float(v) for a, v in zip("xyz", shift, strict=True)}
    return row | {f"parasitic_r{a}_mrad": 1e3 * float(v) for a, v in zip("xyz", turn, strict=True)}


def _energy(pose: Any, questions: Questions) -> Row:
    return {"strain_energy_J": float(sum(pose.strain_energy().values()))}


def _buckling(pose: Any, questions: Questions) -> Row:
    """Critical load factors, on all stresses of the state; nan for a state without stress."""
    try:
        factors = pose.buckling(count=1)
    except SceneError as reason:
        if "no stress" not in str(reason):
            raise
        return {"buckling_positive": float("nan"), "buckling_negative": float("nan")}
    return {
        "buckling_positive": _finite_load_factor(factors.positive),
        "buckling_negative": _finite_load_factor(factors.negative),
    }


def _finite_load_factor(factor: float) -> float:
    """The factor, or nan where it is infinite or due to rounding: such a number would set the scale of every plot."""
    return factor if abs(factor) < MAX_LOAD_FACTOR else float("nan")


def _size(pose: Any, questions: Questions) -> Row:
    """Extent of the leaf springs and its ends: the extent over several poses is the highest end less the lowest."""
    leaves = leaf_extents(*pose.unreduced_state)
    extents = {"": common_extent(leaves)}
    if questions.detailed:
        extents |= {f"[{name}]": ends for name, ends in leaves.items()}
    row: Row = {}
    for name, ends in extents.items():
        for a, lowest, highest in zip("xyz", *(1e3 * ends).tolist(), strict=True):
            row |= {f"size_{a}_mm{name}": highest - lowest}
            row |= {f"lowest_{a}_mm{name}": lowest, f"highest_{a}_mm{name}": highest}
    return row


def _distance(pose: Any, questions: Questions) -> Row:
    return {f"distance_{d.name}_mm": 1e3 * pose.distance(d.name) for d in pose.model.scene.distances}


def _clearance(pose: Any, questions: Questions) -> Row:
    smallest = clearance(*pose.unreduced_state)
    return {"clearance_mm": 1e3 * smallest.distance, "clearance_leaves": " and ".join(smallest.leaves)}


RMS_UNITS = {"m": ("um", 1e6), "rad": ("mrad", 1e3), "m/s": ("mm_per_s", 1e3), "rad/s": ("mrad_per_s", 1e3)} | {
    "m/s^2": ("m_per_s2", 1.0), "rad/s^2": ("rad_per_s2", 1.0),
}  # fmt: skip
"""Unit of the column of an rms value, and the factor to it, by SI unit of the sensor."""


def rms_columns(scene: Any) -> list[tuple[str, float]]:
    """Column, such as "rms_lens_um", and factor (column = factor * SI) of the rms value of every sensor."""
    units = [(s.name, *RMS_UNITS[s.unit]) for s in scene.sensors]
    return [(f"rms_{name}_{unit}", factor) for name, unit, factor in units]


def _vibration(pose: Any, questions: Questions) -> Row:
    """Settling time of the slowest mode, and the rms value of every sensor under the spectra."""
    scene = pose.model.scene
    freed = tuple(pose.model.drive_names) if questions.freed is None else questions.freed
    spectra = {name: np.array(rows) for name, rows in questions.psd}
    seen = tuple(s.name for s in scene.sensors) if spectra else ()
    pose._of_leaves("vibration")
    plant = make_plant(
        *full_model_state(pose.model, pose.refinement_start), inputs=tuple(spectra), outputs=seen,
        damping=questions.damping, freed=freed, load_factor=pose.load_factor,
        up_to_Hz=max((rows[-1, 0] for rows in spectra.values()), default=None),
    )  # fmt: skip
    row: Row = {"settling_s": plant.settling_time()}
    if seen:
        rms = rms_values(plant, spectra).tolist()
        row |= {column: factor * r for (column, factor), r in zip(rms_columns(scene), rms, strict=True)}
    return row


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
    "vibration": _vibration,
}
ALL_QUESTIONS = (
    "force", "drive_stiffness", "support_stiffness", "frequencies", "stress", "parasitic", "energy", "buckling", "size",
    "clearance",
    "distance",
)  # fmt: skip
"""Questions of a sweep that names none.

"size" and "clearance" concern the leaf springs; "distance" covers the distances that the scene names."""
ROUNDING_TOLERANCE = 1e-9
"""Numbers below this, in the units of the columns, are rounding of an undeformed state."""
MAX_LOAD_FACTOR = 1e9
"""Critical load factors beyond this belong to states whose stress is rounding."""
KNOWN_QUESTIONS = (*ALL_QUESTIONS, "vibration")
"""All questions; "vibration" is answered where it is named, or spectra are given."""
BATCH_QUESTIONS = {"support_stiffness", "drive_stiffness", "stress"}
"""Questions that are answered for many poses at once."""
BATCH_SIZE = 64
"""Poses whose stresses are in memory at once."""
POSE_ERRORS: tuple[type[Exception], ...] = (KsdError, ArithmeticError, np.linalg.LinAlgError, RuntimeError)
"""Errors of a single pose that do not end the sweep: those of ksd, and failed arithmetic."""


def _pose_modes(pose: PoseAnalysis, questions: Questions, *, additional: int = 0) -> Modes:
    """Modes of a pose: those followed, some to spare, and so many additional ones."""
    freed = tuple(pose.model.drive_names) if questions.freed is None else questions.freed
    count = questions.modes + len(freed) + SPARE_MODES + additional
    pose._of_leaves("frequencies")
    return frequencies(
        *full_model_state(pose.model, pose.refinement_start),
        count=count,
        freed=freed,
        load_factor=pose.load_factor,
    )


def _intermediate_modes(pose: PoseAnalysis, questions: Questions) -> IntermediateModes | None:
    """Function that returns the modes between the previous pose and this one; None where poses cannot be solved there."""
    first, solve = pose.previous.pose, pose.previous.solve
    if first is None or solve is None:
        return None

    def modes_at(fraction: float, additional: int) -> Modes:
        if fraction in (0.0, 1.0):
            return _pose_modes(pose if fraction else PoseAnalysis(first), questions, additional=additional)
        values = {n: (1.0 - fraction) * first.targets[n] + fraction * v for n, v in pose.targets.items()}
        return _pose_modes(PoseAnalysis(solve(values)), questions, additional=additional)

    return modes_at


def second_parasitic_row(tracks: Tracks, second: int | None) -> Row:
    """Frequency [Hz] of the track of the second parasitic mode; inf where there is none."""
    (column,) = columns_above("first_parasitic_Hz")
    return {column: np.inf if second is None else tracks.frequency_Hz(second)}


def frequency_row(pose: PoseAnalysis, questions: Questions) -> tuple[Row, Tracks]:
    """Frequencies [Hz] of the followed modes, and the tracks for the next pose."""
    modes = _pose_modes(pose, questions)
    tracks = follow_with_bisection(
        pose.previous.tracks, modes, questions.modes, _intermediate_modes(pose, questions)
    )
    row: Row = {f"{n}_Hz": tracks.frequency_Hz(t) for t, n in enumerate(tracks.names) if tracks.rank[t] >= 0}
    first = tracks.first_parasitic
    row["first_parasitic_Hz"] = float("nan") if first is None else tracks.frequency_Hz(first)
    row["first_parasitic_mode"] = "" if first is None else tracks.names[first]
    if questions.detailed:
        row |= second_parasitic_row(tracks, tracks.second_parasitic)
    if pose.previous.solve is not None:
        # along a path alone; elsewhere modes are numbered at every pose, and followed from none
        row["mac"] = min(a for a, k in zip(tracks.mac, tracks.rank, strict=True) if k >= 0)
    return row, tracks


class BatchAnswer(NamedTuple):
    """Answers of one pose among many.

    rows: by question. compliance (6, 6): of the point of the questions. stable: whether the stiffness is that of a stable
    equilibrium, even if the Newton step to the finer mesh did not start from an equilibrium.
    """

    rows: dict[str, Row]
    compliance: np.ndarray | None
    stable: bool = False


NOT_ANSWERED = BatchAnswer({}, None)


def answer_batch(poses: Sequence[Any], questions: Questions) -> list[BatchAnswer]:
    """Answer the BATCH_QUESTIONS of many poses at once, as far as they can be.

    poses: anything with attributes `model`, `equilibrium` and `load_factor`. A question without an answer here is to be
    answered for the pose alone, which gives the reason where it has none.
    """
    answers = [NOT_ANSWERED] * len(poses)
    indices: list[int] = []
    states: list[LoadedState] = []
    for k, pose in enumerate(poses if BATCH_QUESTIONS & set(questions.names) else []):
        with suppress(ConvergenceError):
            states.append((pose.model, pose.equilibrium, pose.load_factor))
            indices.append(k)
    for first in range(0, len(states), BATCH_SIZE):
        for numbers, group in group_states(states[first : first + BATCH_SIZE]):
            for n, answer in zip(numbers, answer_group(group, questions), strict=True):
                answers[indices[first + n]] = answer
    return answers


def answer_group(
    states: StateBatch, questions: Questions, reference: np.ndarray | None = None
) -> list[BatchAnswer]:
    """`answer_batch` of states of the same layout; reference: as in `principal_stiffness`."""
    rows: list[dict[str, Row]] = [{} for _ in states.model_index]
    compliance: Any = None
    stable = np.zeros(len(rows), bool)
    point, drives = ("support_stiffness" in questions.names, "drive_stiffness" in questions.names)
    if point or drives:
        # an invalid point raises where the pose is answered alone
        with suppress(SceneError):
            # by default the point is where the drive of each design acts
            points = [questions.point(model.scene) for model in states.models] if point else [(None, None)]
            stiff = batch_stiffness(states, points[0][0], at=[at for _, at in points], drives=drives)
            compliance, stable = stiff.compliance, stiff.valid & stiff.stable
            _add_stiffness_rows(rows, stiff, states, questions, reference)
    if "stress" in questions.names:
        for row, peaks in zip(rows, batch_peak_stress(states, points=questions.points) or (), strict=False):
            row["stress"] = _stress_row(peaks, questions)
    return [
        BatchAnswer(row, compliance[n] if "support_stiffness" in row else None, bool(stable[n]))
        for n, row in enumerate(rows)
    ]


def _add_stiffness_rows(
    rows: list[dict[str, Row]],
    stiff: BatchStiffness,
    states: StateBatch,
    questions: Questions,
    reference: np.ndarray | None,
) -> None:
    """Add the answers about stiffness to `rows` (by question) of the states that have one."""
    valid = np.flatnonzero(stiff.valid).tolist()
    if stiff.compliance is not None:
        supports = support_stiffness(stiff.compliance, states.sizes)
        principal = principal_stiffness(stiff.compliance, states.sizes, reference)
        support_rows = _support_stiffness_rows(supports, principal, questions)
        for n in valid:
            rows[n]["support_stiffness"] = support_rows[n]
    if stiff.drives is not None:
        names = states.models[0].drive_names
        units = drive_units(states.models[0], range(len(names)))
        for n in valid:
            rows[n]["drive_stiffness"] = _drive_stiffness_row(names, units, np.diagonal(stiff.drives[n]))


class PoseAnswers(NamedTuple):
    """Answers of one pose: the row, what the next pose continues from, and the error of each question that failed."""

    row: Row
    previous: PreviousPose
    failures: dict[str, Exception]


def answer_questions(
    pose: PoseAnalysis, questions: Questions, known: Mapping[str, Row] = MappingProxyType({})
) -> PoseAnswers:
    """Answer the questions at one pose; known: rows by question that `answer_batch` gave."""
    row: Row = {}
    failures: dict[str, Exception] = {}
    previous, configuration = pose.previous, pose.configuration
    tracks = previous.tracks
    reference = _reference_pose(configuration, previous) if questions.errors else None
    reference_tracks = None if reference is None else reference.previous.tracks
    for name in questions.names:
        try:
            if name in known:
                answer = known[name]
            elif name == "frequencies":
                answer, tracks = frequency_row(pose, questions)
            else:
                answer = ANSWER_FUNCTIONS[name](pose, questions)
            row |= answer
            if reference is not None:
                if name == "frequencies":
                    reference_answer, reference_tracks = frequency_row(reference, questions)
                else:
                    reference_answer = ANSWER_FUNCTIONS[name](reference, questions)
                row[f"{name}_error_percent"] = _error_percent(answer, reference_answer)
        except POSE_ERRORS as reason:
            if questions.is_default and name == "buckling":
                row |= dict.fromkeys(("buckling_positive", "buckling_negative"), float("nan"))
            else:
                failures[name] = reason
    next_reference = None
    if reference is not None:
        next_reference = replace(reference.previous, tracks=reference_tracks, pose=reference.configuration)
    return PoseAnswers(row, PreviousPose(tracks, configuration, previous.solve, next_reference), failures)


def _reference_pose(configuration: Any, previous: PreviousPose) -> PoseAnalysis:
    """The equilibrium near a configuration on a finer mesh, which continues from that of the previous pose."""
    solve = previous.solve
    solve_finer = None if solve is None else lambda values: refined_configuration(solve(values))
    return PoseAnalysis(
        refined_configuration(configuration), previous.reference or PreviousPose(solve=solve_finer)
    )


def _error_percent(row: Row, reference: Row) -> float:
    """Largest change of the numbers of a question [%]: stiffnesses and frequencies relative to themselves, others relative
    to the largest number of their unit, as some are zero; 0 where all numbers are rounding."""
    changes: dict[str, list[float]] = {}
    for column, value in row.items():
        # the position of the largest stress may change ends, and the MAC of modes is no answer
        if (
            isinstance(value, float)
            and np.isfinite(value)
            and "error" not in column
            and column not in ("stress_s_mm", "mac")
        ):
            unit = label_and_unit(column)[1]
            by_itself = unit == "Hz" or "/" in unit
            worst = changes.setdefault(column if by_itself else unit, [0.0, 0.0])
            worst[0] = max(worst[0], abs(reference.get(column, np.inf) - value))
            worst[1] = max(worst[1], abs(value))
    return 100.0 * max(
        (change / size for change, size in changes.values() if size > ROUNDING_TOLERANCE), default=0.0
    )
