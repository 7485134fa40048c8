"""`ksd.Job`: the targets, limits and rules of a design as numbers for any optimiser.

Targets and limits are columns of `ksd.sweep` at every pose and load case, of which the worst counts. Stresses are answers
for every leaf, sizes too, and the worst support stiffness is with all principal ones, because the worst of several has
kinks; sizes are over all poses together. Values and derivatives are of the same equilibria on the same mesh. Designs are
solved in batches (`ksd.study.batch_solver`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, update_wrapper
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ksd.answers.plant import Damping
from ksd.answers.printing import PrintableAnswer, format_number
from ksd.checks import (
    MAX_MAGNITUDE,
    ClearArgumentErrors,
    boolean,
    name_hint,
    number,
    show,
    whole_checks_enabled,
    without_whole_checks,
)
from ksd.errors import DESIGN_ERRORS, KsdError, RecordError, SceneError, reason_text
from ksd.joints.record_match import check_proportions
from ksd.library import find_record
from ksd.model.compile import compile_scene
from ksd.model.mesh import DEFAULT_MESH, Mesh
from ksd.optimisation.bounds import (
    PROBE_FRACTION,
    TrainedBounds,
    TrainedRange,
    bound_units,
    first_buildable,
    joints_between,
    parse_bounds,
    trained_bounds,
)
from ksd.optimisation.goals import SIGNED_QUESTIONS, SIZE_ENDS, Answer, parse_goals
from ksd.scene import Mechanism, Scene
from ksd.scene.link import Link
from ksd.scene.load import Load
from ksd.scene.obstacle import has_contacts
from ksd.solvers.configuration import Configuration
from ksd.solvers.perturbed import RELATIVE_STEP
from ksd.solvers.random_vibration import Spectrum
from ksd.solvers.steps import DEFAULT_ACCURACY
from ksd.solvers.verdict import with_mesh_check
from ksd.study.arguments import (
    check_design_parameters,
    check_drives,
    check_executor,
    check_solve_options,
    drive_value_arrays,
)
from ksd.study.batch_solver import BatchSolver, run_in_blocks, scene_factories
from ksd.study.design_scene import add_loads, build_scene, load_cases, scene_or_reason
from ksd.study.gradient import SolvedPoses, gradient_at
from ksd.study.prepared_design import DesignResult, status_sentence
from ksd.study.questions import (
    Questions,
    Row,
    check_questions,
    column_questions,
    drive_columns,
    parse_questions,
)
from ksd.study.resume import record_hashes
from ksd.study.sweep_path import DrivePaths, Recipe, SweepPath, adequate_mesh, drive_paths, run_path
from ksd.study.table import OK

Array = np.ndarray
SPARE_SCENES = 8
"""Scenes cached in addition to those of a gradient."""
MAX_RANDOM_TRIALS = 4096
"""Random designs at which rules are evaluated before they count as never met."""
MAX_FAILED_RULES = 50
"""Random designs at which a rule may fail before one at which all rules have values."""
MAX_SKIPPED_DESIGNS = 100
"""Random designs that cannot be built and are passed over; after so many, the search itself says why."""
Targets = str | Sequence[str] | Mapping[str, float]
Rule = Callable[[Mapping[str, float]], float]


class DesignAnswers(NamedTuple):
    """Answers of D designs: values (D, answers), nan where there is none, and status (D,): "ok" or why there are none."""

    values: Array
    status: tuple[str, ...]


class _SolvedDesign(NamedTuple):
    """Rows of all poses of a design under one load case, status ("ok" or the first failure), and poses where requested."""

    rows: list[Row]
    status: str
    poses: list[Configuration]


class _CachedSceneFunction:
    """A function of parameters that caches its last scenes, as rules, answers and slopes need the same ones.

    Pickling drops the cache.
    """

    def __init__(self, function: Callable[..., Any], maxsize: int) -> None:
        self.function, self.maxsize = function, maxsize
        self.cached = lru_cache(maxsize)(self._build)
        # without the attributes of a callable object
        update_wrapper(self, function, updated=())

    def __reduce__(self) -> Any:
        return _CachedSceneFunction, (self.function, self.maxsize)

    def __call__(self, **parameters: Any) -> Any:
        return self.cached(whole_checks_enabled(), tuple(parameters.items()))

    def _build(self, _: bool, given: tuple[tuple[str, Any], ...]) -> Any:
        result = self.function(**dict(given))
        return result.scene() if isinstance(result, Mechanism) else result


@dataclass(frozen=True)
class _LoadedSceneFunction:
    """A function of parameters whose scenes have the loads of a load case added; it can be pickled."""

    function: Any
    loads: tuple[Any, ...]

    def __call__(self, **parameters: Any) -> Scene:
        scene, failure = add_loads(build_scene(self.function, parameters), self.loads)
        if scene is None:
            raise SceneError(failure)
        return scene


@dataclass(frozen=True, init=False, repr=False, eq=False)
class Job(PrintableAnswer, metaclass=ClearArgumentErrors):
    """Parameters to vary, targets to maximise or minimise, and limits; see `ksd.optimise`.

    function: of the parameters, returns a mechanism. vary: least and most of every parameter, SI, or text with the unit in
    which it is printed, ("0.2 mm", "1 mm"). maximise or minimise:
    one column of `ksd.sweep`, or several with the scale that divides each; the worst of them over its scale, over all
    poses and load cases, is the merit; where forces, moments or parasitic motion are minimised, it is their absolute
    value. limits: the most by column, or (least, most), None for neither, in units of the column; a job with limits
    alone suffices for `ksd.tolerance`; "size_mm" takes the most along x, y and z. rules: functions of the parameters by
    name that must not be negative; they are evaluated before a design is solved. link, at, along, freed, modes, psd,
    damping, loads, together: as in `ksd.sweep`, and so the drive values [m or rad]; but modes are numbered at every pose
    from the lowest. method: "full", "reduced", or "conventional", which needs no trained ranges; for the others these are
    bounds. When None it is "full" where every joint has a record that matches it for all parameters, else
    "conventional". mesh: when None the default, with as many curvature modes as suffice in the middle of the bounds;
    where they are too few at an optimum, it prints a warning. extrapolate: as in `ksd.solve`; targets: drive values as
    a mapping. All answers are those of the equilibrium, independent of the method, so that slopes are theirs. A design
    that is not stable at a pose has no answers.

    Raises SceneError for everything that is wrong before a solve.

    >>> steel = ksd.Material(E=200 * GPa, nu=0.3)
    >>> def pivot(thickness):
    ...     return ksd.Mechanism.of_joint(ksd.CrossedPivot(
    ...         steel, length=50 * mm, angle=45 * deg, thickness=thickness, width=15 * mm
    ...     ))
    >>> job = ksd.Job(
    ...     pivot, angle=20 * deg, vary={"thickness": (0.2 * mm, 0.5 * mm)},
    ...     maximise="support_worst_N_per_m", limits={"stress_MPa": 600},
    ... )
    >>> job.vary, job.limits
    ({'thickness': (0.0002, 0.0005)}, {'stress_MPa': (-inf, 600.0)})
    """

    function: Callable[..., Any]
    # `function` with a cache of scenes
    build: _CachedSceneFunction
    vary: Mapping[str, tuple[float, float]]
    # in which parameters are printed, with their factors
    units: Mapping[str, tuple[str, float]]
    answers: tuple[Answer, ...]
    rules: tuple[Rule, ...]
    # (P, 2), SI, within trained ranges
    bounds: Array
    # why a bound is tighter than given, by parameter and side ("least" or "most")
    bound_reasons: Mapping[tuple[str, str], str]
    # as given, for jobs with other limits
    arguments: Mapping[str, Any]
    # trained ranges that depend on several parameters; they are rules
    coupled_ranges: tuple[TrainedRange, ...]
    questions: Questions
    loads: Any
    # additional loads by load case
    cases: Mapping[str, tuple[Load, ...]]
    drives: Mapping[str, Array]
    paths: DrivePaths
    method: Literal["full", "reduced", "conventional"]
    extrapolate: bool
    # why the method is another one than the default
    method_note: str
    # whether answers of which the absolute value is minimised have their signs, which optimisers need
    is_signed: bool
    # the design solved last, as bytes, and its poses, which its slopes need
    last_solved: tuple[bytes, list[SolvedPoses]] | None

    def __init__(
        self,
        function: Callable[..., Any],
        *,
        vary: Mapping[str, tuple[float | str, float | str]],
        maximise: Targets = (),
        minimise: Targets = (),
        limits: Mapping[str, Any] | None = None,
        rules: Sequence[Rule] = (),
        loads: Mapping[str, Sequence[Mapping[str, Any]]] | None = None,
        link: Link | str | None = None,
        at: ArrayLike | None = None,
        along: ArrayLike | str | None = None,
        freed: str | Sequence[str] | None = None,
        modes: int = 3,
        psd: Mapping[str, Spectrum] | None = None,
        damping: Damping | None = None,
        method: Literal["full", "reduced", "conventional"] | None = None,
        mesh: Mesh | None = None,
        extrapolate: bool = False,
        together: bool = False,
        targets: Mapping[str, ArrayLike] | None = None,
        **drives: ArrayLike,
    ) -> None:
        self.__dict__["arguments"] = {
            "vary": vary, "maximise": maximise, "minimise": minimise, "limits": limits, "rules": rules, "loads": loads,
            "link": link, "at": at, "along": along, "freed": freed, "modes": modes, "psd": psd, "damping": damping,
            "method": method, "mesh": mesh, "extrapolate": extrapolate, "together": together, "targets": targets, **drives,
        }  # fmt: skip
        methods = ("full", "reduced", "conventional")
        check_solve_options(
            mesh=mesh, relinearisations=0, method=method, methods=methods, extrapolate=extrapolate
        )
        if not callable(function):
            raise SceneError("a job needs a function of the parameters it varies that returns a mechanism")
        values = drive_value_arrays(targets, drives, Job)
        if not values:
            raise SceneError("a job needs drive values, for example turn=[0, 0.3]")
        given_bounds = parse_bounds(vary)
        check_design_parameters(function, [given_bounds], "vary")
        self.__dict__.update(
            function=function, build=_CachedSceneFunction(function, 2 * len(given_bounds) + SPARE_SCENES),
            vary=given_bounds, units=bound_units(vary),
            loads=loads, extrapolate=extrapolate, last_solved=None, method_note="", is_signed=False,
            drives=values, cases=load_cases(loads), rules=_check_rules(rules),
            paths=drive_paths(values, together=boolean(together, "together")),
            **({} if mesh is None else {"mesh": mesh}),
        )  # fmt: skip
        scene = self._example_scene
        check_drives(scene, tuple(values), Job)
        self.__dict__["method"] = method or self._default_method(scene, mesh or DEFAULT_MESH)
        for case_loads in self.cases.values():
            failure = add_loads(scene, case_loads)[1]
            if failure:
                raise SceneError(failure)
        released = parse_questions((), link, at, freed, modes=modes).freed
        known = column_questions(scene, modes, released)
        goals = parse_goals(maximise, minimise, limits, known)
        names = tuple(dict.fromkeys(known[goal.column] for goal in goals))
        questions = replace(
            parse_questions(names, link, at, freed, along=along, modes=modes, psd=psd, damping=damping),
            detailed=True,
        )
        if psd is None and any(goal.column.startswith("rms_") for goal in goals):
            raise SceneError("psd: rms values need spectra, psd = {'base y': [(1, 1e-3), (200, 1e-3)]}")
        check_questions(questions, scene)
        signed = {column for column, question in known.items() if question in SIGNED_QUESTIONS}
        self.__dict__.update(questions=questions, answers=self._answers_at_poses(goals, scene, signed))
        within = TrainedBounds(np.array(list(given_bounds.values())), {}, ())
        if self.method != "conventional" and not self.extrapolate:
            within = trained_bounds(self.build, given_bounds, scene)
        self.__dict__.update(
            bounds=within.bounds, bound_reasons=within.reasons, coupled_ranges=within.coupled
        )
        # raises where no design is within bounds and rules
        self.random(1)

    def __getstate__(self) -> dict[str, Any]:
        return {k: v for k, v in self.__dict__.items() if k not in ("_solvers", "_example_scene")} | {
            "last_solved": None
        }

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the varied parameters."""
        return tuple(self.vary)

    def unit(self, parameter: str) -> tuple[str, float]:
        """The unit in which a parameter is printed, and its factor to SI."""
        return self.units.get(parameter, ("SI", 1.0))

    def in_units(self, parameter: str, value: float, *, digits: int = 5) -> str:
        """A value of a parameter with its unit, a plain number in SI where the job has none for it."""
        unit, factor = self.unit(parameter)
        return f"{value / factor:.{digits}g}" + (f" {unit}" if parameter in self.units else "")

    def design_text(self, x: ArrayLike) -> str:
        """The parameters x (P,) of a design as text."""
        return ", ".join(f"{n} {self.in_units(n, v)}" for n, v in self.design_at(x).items())

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the answers."""
        return tuple(a.name for a in self.answers)

    @property
    def steps(self) -> list[dict[str, float]]:
        """Drive values by name [m or rad] of the poses, which are the same for every load case."""
        return [step for path in self.paths for step in path]

    @cached_property
    def poses(self) -> tuple[tuple[str, Mapping[str, float]], ...]:
        """Load case and drive values by name of every pose."""
        return tuple((case, step) for case in self.cases for step in self.steps)

    @cached_property
    def mesh(self) -> Mesh:
        """The mesh of all designs: as given, or with as many curvature modes as suffice in the middle of the bounds."""
        scenes = (add_loads(self._example_scene, case_loads)[0] for case_loads in self.cases.values())
        recipe = Recipe(self.questions, method=self.method, extrapolate=self.extrapolate)
        return adequate_mesh(
            (SweepPath(k, {}, scene, tuple(self.steps)) for k, scene in enumerate(scenes)), recipe
        )

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        """Least and most by column, infinite where there is none."""
        limits: dict[str, tuple[float, float]] = {}
        for a in (a for a in self.answers if a.role == "limit"):
            low, high = limits.get(a.asked, (-np.inf, np.inf))
            limits[a.asked] = max(low, a.low), min(high, a.high)
        return limits

    def _line(self) -> str:
        goals = {a.asked: a.role for a in self.answers if a.role != "limit"}
        targets = ", ".join(f"{role} {column}" for column, role in goals.items()) or "limits alone"
        poses = "one pose" if len(self.poses) == 1 else f"{len(self.poses)} poses"
        return f"{targets} by {', '.join(self.parameters)} at {poses}"

    def __str__(self) -> str:
        lines = [f"Job: {self._line()}"]
        for name, (low, high) in zip(self.vary, self.bounds.tolist(), strict=True):
            reasons = "".join(
                f", {self.bound_reasons[name, s]}"
                for s in ("least", "most")
                if (name, s) in self.bound_reasons
            )
            unit, factor = self.unit(name)
            ends = " to ".join(format_number(v / factor) for v in (low, high))
            lines.append(f"  {name}: {ends}{f' {unit}' if name in self.units else ''}{reasons}")
        for column, (low, high) in self.limits.items():
            least, most = (f"{side} {format_number(v)}" for side, v in (("at least", low), ("at most", high)))
            lines.append(
                f"  {column} {' and '.join(t for t, v in ((least, low), (most, high)) if np.isfinite(v))}"
            )
        return "\n".join([*lines, *filter(None, [self.method_note])])

    def _answers_at_poses(self, goals: list[Answer], scene: Scene, signed: set[str]) -> tuple[Answer, ...]:
        """Answers of every goal at every pose, those of sizes over all poses together.

        signed: columns of which the absolute value is minimised. A limit of such a column has a name of its own.
        """
        answers, labels = list[Answer](), self._pose_labels(scene)
        leaves = list(scene.leaf_names())
        for goal in goals:
            if goal.is_size:
                answers += [replace(part, name=part.column) for part in goal.smooth_parts(leaves)]
                continue
            is_absolute = goal.role == "minimise" and goal.column in signed
            absolute_names = {a.name for a in answers if a.is_absolute}
            for k, label in enumerate(labels):
                for part in goal.smooth_parts(leaves):
                    name = f"{part.column}{label}"
                    name += " with its sign" if name in absolute_names else ""
                    answers.append(replace(part, name=name, pose=k, is_absolute=is_absolute))
        return tuple(answers)

    def _pose_labels(self, scene: Scene) -> list[str]:
        """Load case and drive values of every pose as text, with enough digits to be different; empty for a single pose."""
        if len(self.poses) == 1:
            return [""]
        units = drive_columns(scene)
        moving = [n for n, v in self.drives.items() if len(v) > 1 or len(self.steps) == 1]
        labels: list[str] = []
        for form in (format_number, "{:.6g}".format, "{:.9g}".format, "{:.12g}".format, repr):
            labels = []
            for case, step in self.poses:
                values = [
                    f"{n} {form(units[n][1] * step[n])} {units[n][0].rsplit('_', 1)[1]}" for n in moving
                ]
                labels.append(f" at {', '.join([*([case] if case else []), *values])}")
            if len(set(labels)) == len(labels):
                break
        return labels

    def _default_method(self, scene: Scene, mesh: Mesh) -> Literal["full", "conventional"]:
        """ "full" where links are rigid, nothing touches and all joints match their records at two designs, else
        "conventional"."""
        if not scene.joints or scene.compliances or has_contacts(scene):
            return "conventional"
        other_joints = joints_between(self.build, self.vary, np.full(len(self.vary), PROBE_FRACTION))
        try:
            for joint in (*(placed.joint for placed in scene.joints), *other_joints):
                check_proportions(joint, find_record(joint.family))
        except RecordError:
            return "conventional"
        return "full"

    # ---- designs ---------------------------------------------------------------------------------------------------------

    def design_at(self, x: ArrayLike) -> dict[str, float]:
        """Parameters by name of x (P,). Raises SceneError for what is no design."""
        try:
            values = np.asarray(x, float)
        except (TypeError, ValueError):
            values = np.array(np.nan)
        if values.shape != (len(self.vary),):
            raise SceneError(
                f"design {show(x)}: a design of this job is {len(self.vary)} numbers: {', '.join(self.parameters)}"
            )
        return dict(zip(self.vary, values.tolist(), strict=True))

    def point(self, start: Mapping[str, float] | ArrayLike | None) -> Array:
        """x (P,) of a design by name or in order; the middle of the bounds when None. Raises SceneError outside them."""
        if start is None:
            return self.random(1)[0]
        if isinstance(start, Mapping):
            for name in (*start, *self.vary):
                if name not in self.vary:
                    raise SceneError(f"start: '{name}' is not varied{name_hint(name, self.parameters)}")
                if name not in start:
                    raise SceneError(f"start: parameter '{name}' has no value")
            start = [number(start[n], f"start: {n}") for n in self.vary]
        x = np.array(list(self.design_at(start).values()))
        for name, value, (low, high) in zip(self.vary, x.tolist(), self.bounds.tolist(), strict=True):
            # a bound may be given with fewer digits
            if not low - 1e-9 * abs(low) <= value <= high + 1e-9 * abs(high):
                raise SceneError(
                    f"start: {name} = {format_number(value)} lies outside {format_number(low)} to {format_number(high)}"
                )
        return np.clip(x, *self.bounds.T)

    def conventionally(self, reason: str) -> Job | None:
        """The same job by the conventional method, with a note of the reason; None where the method was given."""
        if self.method == "conventional" or self.arguments["method"] is not None:
            return None
        said = (
            f"Solved by the conventional method, as the start is beyond what the joint records hold: {reason}"
        )
        job = Job(self.function, **{**self.arguments, "method": "conventional"})
        return job._changed(answers=self.answers, is_signed=self.is_signed, method_note=said)

    def with_signs(self, is_signed: bool = True) -> Job:
        """The same job whose answers have their signs also where their absolute values are minimised, or not."""
        return self._changed(is_signed=is_signed)

    def as_told(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Answers by name without the signs of those whose absolute values are minimised; other entries unchanged."""
        absolute = {a.name for a in self.answers if a.is_absolute}
        return {n: abs(v) if n in absolute else v for n, v in values.items()}

    def on_finer_mesh(self) -> Job:
        """The same job by the conventional method on the reference mesh for errors, see `Mesh.refined`."""
        return self._changed(method="conventional", mesh=self.mesh.refined())

    def random(self, count: int, *, seed: int = 0) -> Array:
        """Designs (count, P) within bounds and rules, as far as they can be built; the first is in the middle if possible.

        Parameters with positive bounds are uniform in their logarithms. Raises SceneError where too few of
        the designs that are tried meet all rules.
        """
        rng, designs = np.random.default_rng(seed), []
        positive = (self.bounds > 0.0).all(axis=1)
        ends = self.bounds.copy()
        ends[positive] = np.log(ends[positive])
        largest, span = np.full(len(self.rule_names), -np.inf), np.diff(ends)[:, 0]
        skipped, failures = 0, list[SceneError]()
        for k in range(MAX_RANDOM_TRIALS + 50 * count):
            fractions = np.full(len(ends), 0.5) if k == 0 and seed == 0 else rng.uniform(size=len(ends))
            scaled = ends[:, 0] + fractions * span
            x = np.clip(np.where(positive, np.exp(np.where(positive, scaled, 0.0)), scaled), *self.bounds.T)
            try:
                values = self.rule_values(x, shapes=False)
            except SceneError as reason:
                failures.append(reason)
                if len(failures) == k + 1 == MAX_FAILED_RULES:
                    raise failures[0] from None
                continue
            if (values >= 0.0).all() and self.coupled_ranges:
                # evaluated last, as building a scene costs more than most rules
                values = self.rule_values(x)
            largest[: len(values)] = np.fmax(largest[: len(values)], values)
            if (values >= 0.0).all():
                if skipped < MAX_SKIPPED_DESIGNS and not self._can_be_built(x):
                    skipped += 1
                    continue
                designs.append(x)
            if len(designs) == count:
                return np.array(designs)
        if failures and np.isneginf(largest).all():
            raise failures[0]
        ranges = largest[len(self.rules) :]
        # not evaluated where no design meets the rules before them, and not to blame
        ranges[np.isneginf(ranges)] = 0.0
        if self.coupled_ranges and (ranges <= -1.0).all():
            try:
                build_scene(self.build, self.design_at(x))
            except SceneError as reason:
                raise SceneError(
                    f"no design within the bounds and rules could be built; the last one: {reason}"
                ) from reason
        never = [n for n, v in zip(self.rule_names, largest, strict=True) if v < 0.0]
        subject = f"rule {never[0]} is met" if never else "all rules are met together"
        raise SceneError(f"{subject} by none of {MAX_RANDOM_TRIALS} designs within the bounds")

    def _can_be_built(self, x: Array) -> bool:
        try:
            build_scene(self.build, self.design_at(x))
        except SceneError:
            return False
        return True

    @property
    def rule_names(self) -> tuple[str, ...]:
        """Names of the rules, and of trained ranges that depend on several parameters."""
        names = (_rule_name(k, rule) for k, rule in enumerate(self.rules))
        return (*names, *(r.text for r in self.coupled_ranges))

    def rule_values(self, x: ArrayLike, *, shapes: bool = True) -> Array:
        """Values (R,) of the rules at a design, not negative where they are met.

        shapes=False leaves out the trained ranges, which need a scene. Raises SceneError for a rule that gives no number.
        """
        parameters, values = self.design_at(x), []
        for k, rule in enumerate(self.rules):
            try:
                value = rule(dict(parameters))
                if isinstance(value, bool | np.bool_):
                    raise ValueError(
                        f"it is {value}; in place of a < b give b - a, not negative where it is met"
                    )
                values.append(float(value))
            except DESIGN_ERRORS as reason:
                text = reason_text(reason)
                if isinstance(reason, KeyError) and reason.args and reason.args[0] not in parameters:
                    text = f"no parameter {reason}{name_hint(reason.args[0], self.parameters)}"
                raise SceneError(f"rule {_rule_name(k, rule)} gives no number: {text}") from None
        if self.coupled_ranges and shapes:
            values += self._range_margins(parameters)
        return np.array(values)

    def _range_margins(self, parameters: Mapping[str, float]) -> list[float]:
        """Margins of a design to the trained ranges that depend on several parameters."""
        try:
            shapes = [placed.joint.shape() for placed in build_scene(self.build, parameters).joints]
        except SceneError:
            shapes = []
        return [r.margin(shapes) for r in self.coupled_ranges]

    def range_slopes(self, x: ArrayLike) -> Array:
        """Slopes (ranges, P) of the last rules, the trained ranges, from the same scenes as `slopes`."""
        parameters, slopes = self.design_at(x), np.zeros((len(self.coupled_ranges), len(self.vary)))
        for i, (name, value) in enumerate(parameters.items() if self.coupled_ranges else ()):
            h = RELATIVE_STEP * self._step_sizes.get(name, abs(value))
            with without_whole_checks():
                plus, minus = (self._range_margins({**parameters, name: value + s}) for s in (h, -h))
            slopes[:, i] = (np.array(plus) - minus) / (2 * h)
        return slopes

    @property
    def _step_sizes(self) -> dict[str, float]:
        """Ranges of the parameters that can be zero, to which their steps are relative; others' are to their values."""
        pairs = zip(self.vary, self.bounds.tolist(), strict=True)
        return {name: high - low for name, (low, high) in pairs if low <= 0.0}

    # ---- answers ---------------------------------------------------------------------------------------------------------

    def values(self, x: ArrayLike) -> Array:
        """Answers (answers,) of a design, in the units of their columns; nan where there is none, for which `batch` has the
        reason."""
        return self.batch(np.asarray(x, float)[None]).values[0]

    def batch(self, X: ArrayLike, *, executor: Executor | None = None) -> DesignAnswers:
        """Answers of designs X (D, P) at all poses and load cases; executor: gets blocks of designs."""
        check_executor(executor)
        X = np.atleast_2d(np.asarray(X, float))
        answers, solved = self._solve_batch(X, executor)
        self.__dict__["last_solved"] = (X[0].tobytes(), solved) if solved else None
        return answers

    def _solve_batch(
        self, X: Array, executor: Executor | None = None
    ) -> tuple[DesignAnswers, list[SolvedPoses]]:
        """Answers of designs X (D, P), and the solved poses of a single design that has all answers."""
        designs = [self.design_at(x) for x in X]
        rows: list[list[Row]] = [[] for _ in designs]
        status: list[str] = [OK] * len(designs)
        steps = self.steps
        solved: list[SolvedPoses] = []
        for case_loads in self.cases.values():
            function = _LoadedSceneFunction(self.build, case_loads)
            for d, design in enumerate(self._solve_case(function, designs, steps, executor)):
                rows[d] += design.rows
                if status[d] == OK:
                    status[d] = self._other_leaves(design.rows) if design.status == OK else design.status
                if design.poses:
                    solved.append(SolvedPoses(design.poses[0].model.original_scene, design.poses, steps))
        answers = DesignAnswers(np.array([self._answers_from(own) for own in rows]), tuple(status))
        has_all_answers = status == [OK] and len(solved) == len(self.cases)
        return answers, solved if has_all_answers else []

    def _other_leaves(self, rows: Sequence[Row]) -> str:
        """Why a design with these rows has other leaf springs than the job asks about; "ok" where it has the same."""
        own = {c.partition("[")[2][:-1] for c in rows[0] if c.startswith(("stress_MPa[", "size_x_mm["))}
        if not own or own == self._leaves:
            return OK
        name = min(self._leaves ^ own)
        return (
            f"it has {'no' if name in self._leaves else 'an additional'} leaf spring '{name}': the stress and size of every "
            "leaf spring count, so all designs of the job need the same ones"
        )

    def _solve_case(
        self, function: Any, designs: list[dict[str, float]], steps: list[Any], executor: Executor | None
    ) -> list[_SolvedDesign]:
        """Every design under one load case; poses are returned for a single design."""
        keep_poses = len(designs) == 1 and executor is None
        if self.method == "conventional":
            # a pose without answers is a design without: the checks of the others would be for nothing
            recipe = Recipe(
                self.questions,
                method="conventional",
                mesh=self.mesh,
                with_verdict=False,
                ends_at_failure=True,
            )
            if executor is not None:
                return run_in_blocks(
                    executor, designs, 1, _solve_conventionally, function, recipe, self.paths
                )
            return _solve_conventionally(function, recipe, self.paths, designs, keep_poses=keep_poses)
        solver = self._solvers[keep_poses]
        if executor is not None:
            results = solver.solve_in(executor, function, designs)
        else:
            results = solver.solve(scene_factories(function, designs), 1)
        return [_solved_design(result, len(steps)) for result in results]

    @cached_property
    def _solvers(self) -> dict[bool, BatchSolver]:
        """Solvers of designs by whether they keep the poses."""
        values = {n: np.array([step[n] for step in self.steps]) for n in self.drives}
        options = {"method": self.method, "questions": self.questions, "equilibrate": True}
        return {
            keep: BatchSolver(values, {**options, "keep_configurations": keep}, self.mesh, self.extrapolate)
            for keep in (False, True)
        }

    def _answers_from(self, rows: list[Row]) -> Array:
        """Answers (answers,) from the rows of all poses."""
        values = np.empty(len(self.answers))
        for k, a in enumerate(self.answers):
            if a.pose is None:
                (highest, m), (lowest, n) = self._size_ends(a.column, rows)
                values[k] = rows[m].get(highest, np.nan) - rows[n].get(lowest, np.nan)
            else:
                row = rows[a.pose]
                value = row.get(a.column, np.nan)
                value = abs(value) if a.is_absolute and not self.is_signed else value
                values[k] = a.value_if_nan if a.column in row and np.isnan(value) else value
        return values

    def _size_ends(self, size: str, rows: Sequence[Row]) -> list[tuple[str, int]]:
        """Column and pose of the highest and the lowest end that make a size over all poses, so that its slopes are those of
        these ends; size: column, with the name of the leaf spring at one end or without."""
        axis, found = size.split("_")[1], []
        leaf, _, of = size.partition("[")[2][:-1].rpartition(" ")
        for end, sign in zip(SIZE_ENDS, (1.0, -1.0), strict=True):
            columns = [f"{end}_{axis}_mm[{name}]" for name in ([leaf] if end == of else sorted(self._leaves))]
            places = sign * np.array([[row.get(c, np.nan) for row in rows] for c in columns])
            k, pose = np.unravel_index(places.argmax(), places.shape)
            found.append((columns[k], int(pose)))
        return found

    def jacobian(self, x: ArrayLike) -> Array:
        """Derivatives (answers, P) of the answers by the parameters, as by `ksd.gradient`; raises what `slopes` raises."""
        return self.slopes(x)[1]

    def slopes(self, x: ArrayLike) -> tuple[Array, Array]:
        """Answers (answers,) and their derivatives (answers, P), of the same equilibria as `values`.

        Raises KsdError where the design has no answers or no gradient.
        """
        x, last = np.asarray(x, float), self.last_solved
        if last is not None and last[0] == x.tobytes():
            solved = last[1]
        else:
            answers, solved = self._solve_batch(x[None])
            if not solved:
                raise KsdError(f"no gradient: {answers.status[0]}")
        gradient = gradient_at(solved, self.questions, self.build, self.design_at(x), sizes=self._step_sizes)
        index = {c: i for i, c in enumerate(gradient.columns)}
        rows = [{c: float(gradient.values[c][n]) for c in index} for n in range(len(self.poses))]
        slopes = np.full((len(self.answers), len(self.vary)), np.nan)
        for k, a in enumerate(self.answers):
            if a.pose is None:
                (highest, m), (lowest, n) = self._size_ends(a.column, rows)
                slopes[k] = gradient.slopes[index[highest], :, m] - gradient.slopes[index[lowest], :, n]
            elif a.column in index:
                slopes[k] = gradient.slopes[index[a.column], :, a.pose]
                slopes[k] *= np.sign(rows[a.pose][a.column]) if a.is_absolute and not self.is_signed else 1.0
        values = self._answers_from(rows)
        slopes[np.isinf(values)] = 0.0
        return values, slopes

    def few_modes(self, x: ArrayLike) -> str:
        """Warning that the mesh has too few curvature modes for the leaf springs of a design; empty where they suffice."""
        poses = [pose for case in self._solve_batch(np.asarray(x, float)[None])[1] for pose in case.poses]
        worst = max(poses, key=lambda pose: pose.mesh_adequacy.missed_share, default=None)
        if worst is None:
            return ""
        return "".join(with_mesh_check(worst, DEFAULT_ACCURACY).notes[len(worst.notes) :])

    def merit(self, values: ArrayLike) -> float:
        """The worst finite target over its scale, larger is better; nan for a job that has limits alone.

        Where targets are minimised, it is minus the largest of them over its scale. An infinite target never is the worst:
        nothing moves that it asks for, or nothing buckles.
        """
        pairs = zip(self.answers, np.asarray(values, float), strict=True)
        merits = np.array([a.merit(v) for a, v in pairs if a.role != "limit"])
        finite = merits[~np.isinf(merits)]
        return float(np.min(finite if len(finite) else np.append(merits, np.nan)[:1]))

    def merit_spoken(self, *merits: float, digits: int = 3) -> str:
        """The worst target as text, at one design or as a range of two: over its scale, or with its column where there is
        only one and no scale."""
        name = self.merit_name
        values = " to ".join(format_number(self.merit_sign * m, digits) for m in merits)
        if name.endswith("scale"):
            return f"worst target {values} of its scale"
        return f"{name} {values}"

    @property
    def merit_sign(self) -> float:
        """-1 where targets are minimised, so that `merit` is minus the worst of them; else 1."""
        return -1.0 if any(a.role == "minimise" for a in self.answers) else 1.0

    @property
    def merit_name(self) -> str:
        """Name of the quantity `merit` times its sign."""
        goals = [a for a in self.answers if a.role != "limit"]
        if any(a.scale != 1.0 for a in goals):
            return "worst target over its scale"
        columns = {a.asked for a in goals}
        if len(columns) > 1:
            return "worst target"
        return f"worst {columns.pop()}"

    def scene_at(self, design: Mapping[str, float], case: str) -> Scene:
        """The scene of a design with the loads of a case of `poses`. Raises SceneError where it cannot be built."""
        return _LoadedSceneFunction(self.build, self.cases[case])(**design)

    @cached_property
    def _leaves(self) -> frozenset[str]:
        """Names of the leaf springs."""
        return frozenset(self._example_scene.leaf_names())

    @cached_property
    def _example_scene(self) -> Scene:
        """The scene in the middle of the bounds, or of another design within them."""
        return first_buildable(lambda **parameters: build_scene(self.build, parameters), self.vary)

    def far_drives(self) -> tuple[str, ...]:
        """A sentence for every drive value that was probably meant in another unit."""
        model = compile_scene(self._example_scene, mesh=self.mesh, one_sided=True)
        return tuple(dict.fromkeys(hint for _, values in self.poses for hint in model.far_drives(values)))

    def margins(self, values: ArrayLike) -> Array:
        """Distance (sides,) of `values` (answers,) to every side of every limit, over the limit (not divided where it is
        0); negative where a limit is violated."""
        pairs = zip(self.answers, np.asarray(values, float), strict=True)
        return np.array([margin for a, v in pairs for margin in a.margins(v)])

    def moved(self, by: Array, at: Array | None = None) -> Job:
        """The same job with limits moved in by `by` (answers,), in the units of their columns.

        Where values `at` (answers,) are given, targets, and limits of the sign of these values, move by the share by / |at|
        in logarithms.
        """
        at = np.full(len(by), np.nan) if at is None else at
        pairs = zip(self.answers, by.tolist(), at.tolist(), strict=True)
        return self._changed(answers=tuple(a.moved(*own) for a, *own in pairs))

    def limited(self, column: str, high: float) -> Job:
        """The same job with a column limited from above, by `high` or by a smaller limit that it has. Raises SceneError for
        an unknown column."""
        is_limit = [a.role == "limit" and a.asked == column and np.isfinite(a.high) for a in self.answers]
        if any(is_limit):
            pairs = zip(self.answers, is_limit, strict=True)
            return self._changed(
                answers=tuple(replace(a, high=min(a.high, high)) if own else a for a, own in pairs)
            )
        low = self.limits.get(column, (-np.inf, np.inf))[0]
        ends = (low if np.isfinite(low) else None, min(high, MAX_MAGNITUDE))
        limits = {**(self.arguments["limits"] or {}), column: ends}
        job = Job(self.function, **{**self.arguments, "method": self.method, "limits": limits})
        return job._changed(
            is_signed=self.is_signed,
            method_note=self.method_note,
            arguments={**self.arguments, "limits": limits},
        )

    def beyond_ranges(self) -> Job:
        """The same job, which also solves designs outside the trained ranges; its answers within them are the same."""
        return self._changed(extrapolate=True)

    def _changed(self, **fields: Any) -> Job:
        """The same job with other fields, without the solvers and the last design of this one."""
        job = copy(self)
        job.__dict__.update(fields)
        return job

    def fingerprint(self) -> str:
        """Text of all that answers depend on except the parameters: options, the scenes of two designs, joint records."""
        scenes, failures = [], []
        for x in self.random(2):
            try:
                scenes.append(build_scene(self.build, self.design_at(x)))
            except SceneError as reason:
                failures.append(str(reason))
        contents = (
            self.method, self.mesh, self.extrapolate, self.poses, self.loads, self.names,
            [a.is_absolute and not self.is_signed for a in self.answers], [scene.fingerprint() for scene in scenes],
            record_hashes(scenes, self.method), failures,
        )  # fmt: skip
        return f"{self.parameters} ({self.questions.fingerprint_text()}, {repr(contents)[1:]}"


def _check_rules(rules: Any) -> tuple[Rule, ...]:
    """Rules as given, one or several. Raises SceneError."""
    rules = (rules,) if callable(rules) else rules
    if isinstance(rules, str) or not isinstance(rules, Sequence) or not all(callable(r) for r in rules):
        raise SceneError(
            f"rules = {show(rules)}: give functions of the parameters, such as lambda p: 0.07 - p['inner'] - 2 * p['outer']"
        )
    return tuple(rules)


def _rule_name(k: int, rule: Rule) -> str:
    """The name of a rule in quotes; of a lambda its number, from 1."""
    name = getattr(rule, "__name__", "<lambda>")
    return f"{k + 1}" if name == "<lambda>" else f"'{name}'"


def check_job(job: Any, *, target: bool = True) -> None:
    """Raise SceneError for what is no job and, where one is needed, for a job without a target."""
    if not isinstance(job, Job):
        raise SceneError(f"{show(job)} is no job: make one with ksd.Job(...)")
    if target and all(a.role == "limit" for a in job.answers):
        raise SceneError(
            "this job has limits alone, and nothing to make better: give maximise or minimise in ksd.Job(...) or "
            "under [job]"
        )


def _solved_design(result: DesignResult | KsdError, pose_count: int) -> _SolvedDesign:
    """The result of the batch solver for one design."""
    if not isinstance(result, DesignResult):
        return _SolvedDesign([{}] * pose_count, str(result), [])
    failed = np.flatnonzero(result.status)
    if not len(failed):
        return _SolvedDesign(result.rows, OK, result.poses)
    n = int(failed[0])
    reason = result.refused.get(n) or result.reasons.get(n) or status_sentence(int(result.status[n]))
    return _SolvedDesign(result.rows, reason, result.poses)


def _solve_conventionally(
    function: Any,
    recipe: Recipe,
    paths: DrivePaths,
    designs: Sequence[Mapping[str, float]],
    *,
    keep_poses: bool = False,
) -> list[_SolvedDesign]:
    """Designs by the conventional method, each pose started from the one before."""
    solved = []
    for design in designs:
        rows: list[Row] = []
        poses: list[Configuration] = []
        solver, (scene, failure) = None, scene_or_reason(function, design)
        for k, drive_values in enumerate(paths):
            path = SweepPath(k, {}, scene, drive_values, failure)
            solver = run_path(path, recipe, solver, rows, poses if keep_poses else None)
            if rows[-1]["status"] != OK:
                break
        status = next((str(row["status"]) for row in rows if row["status"] != OK), OK)
        missing = sum(map(len, paths)) - len(rows)
        solved.append(_SolvedDesign([*rows, *({} for _ in range(missing))], status, poses))
    return solved
