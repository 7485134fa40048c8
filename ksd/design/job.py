"""`ksd.Job`: what a design is to be good at, as numbers that any optimiser takes.

Targets and limits are columns of `ksd.sweep`, at every pose and load case; the worst counts. Stress is answered for every
leaf and the worst support stiffness with all principal ones, as the worst of several has kinks; size for all poses together.
Values and derivatives are of the same equilibria on the same mesh. Designs go through the batch (`ksd.design.batch_solver`).
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
from scipy.optimize import brentq

from ksd.bodies.record_match import check_proportions
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
from ksd.design.arguments import (
    check_design_parameters,
    check_drives,
    check_executor,
    check_solve_options,
    drive_value_arrays,
)
from ksd.design.batch_solver import BatchSolver, run_in_blocks, scene_factories
from ksd.design.design_scene import add_loads, build_scene, load_cases, scene_or_reason
from ksd.design.goals import SIGNED_QUESTIONS, Answer, goals_of
from ksd.design.gradient import SolvedPoses, gradient_at
from ksd.design.prepared_design import DesignResult, status_sentence
from ksd.design.questions import (
    Questions,
    Row,
    check_questions,
    column_questions,
    drive_columns,
    parse_questions,
)
from ksd.design.resume import record_hashes
from ksd.design.sweep_path import DrivePaths, Recipe, SweepPath, adequate_mesh, drive_paths, run_path
from ksd.design.table import OK
from ksd.errors import KsdError, RecordError, SceneError
from ksd.library import find_record
from ksd.model.compile import compile_scene
from ksd.model.effects import mentioned_effects
from ksd.model.mesh import DEFAULT_MESH, Mesh
from ksd.properties.printing import PrintableAnswer, format_number
from ksd.scene import Joint, Mechanism, Scene
from ksd.scene.link import Link
from ksd.scene.load import Load
from ksd.solve.configuration import Configuration
from ksd.solve.five_steps import FULL, REDUCED
from ksd.solve.perturbed import RELATIVE_STEP
from ksd.solve.solver import DEFAULT_ACCURACY
from ksd.solve.verdict import with_mesh_check

Array = np.ndarray
SPARE = 8
"""Scenes kept beyond those of a gradient."""
TRIED = 4096
"""Designs at which rules are tried before they count as never met."""
Targets = str | Sequence[str] | Mapping[str, float]
Rule = Callable[[Mapping[str, float]], float]


class DesignAnswers(NamedTuple):
    """Answers (D, answers) of D designs, nan where there is none, and "ok" or why not (D,)."""

    values: Array
    status: tuple[str, ...]


class _Drawn:
    """A function of parameters that keeps the scenes it drew last: rules, answers and their slopes are asked of the same.
    Known to other processes without them."""

    def __init__(self, function: Callable[..., Any], most: int) -> None:
        self.function, self.most = function, most
        self.kept = lru_cache(most)(self._drawn)
        # attributes of a callable object are its own
        update_wrapper(self, function, updated=())

    def __reduce__(self) -> Any:
        return _Drawn, (self.function, self.most)

    def __call__(self, **parameters: Any) -> Any:
        return self.kept(whole_checks_enabled(), tuple(parameters.items()))

    def _drawn(self, _: bool, given: tuple[tuple[str, Any], ...]) -> Any:
        made = self.function(**dict(given))
        return made.scene() if isinstance(made, Mechanism) else made


@dataclass(frozen=True)
class _Loaded:
    """A function of parameters with loads added to the scene it draws; known to other processes."""

    function: Any
    loads: tuple[Any, ...]

    def __call__(self, **parameters: Any) -> Scene:
        scene, failure = add_loads(build_scene(self.function, parameters), self.loads)
        if scene is None:
            raise SceneError(failure)
        return scene


@dataclass(frozen=True, init=False, repr=False, eq=False)
class Job(PrintableAnswer, metaclass=ClearArgumentErrors):
    """What to vary, what to make large or small, and what limits it; see `ksd.optimise`.

    function: of the parameters, returns a mechanism. vary: least and most of every parameter, SI. maximise or minimise:
    columns of `ksd.sweep`, several with the scale each is measured in: the worst of them over their scales, over all poses
    and load cases, counts; of forces, moments and parasitic motion that are minimised it is their size. limits: the most by
    column, or (least, most), None for neither, in units of the column; without a target they are enough for `ksd.tolerance`;
    "size_mm" takes the most along x, y and z. rules: functions of the parameters by name that must not be negative, told
    before anything is solved. link, at, freed, modes, loads, together: as in `ksd.sweep`, and so the drive values [m or
    rad]; but modes are numbered at every pose from the lowest. method: "full", "reduced", or "conventional", which knows no
    trained ranges; by the others these are bounds; when None "full" where every joint has a record (a joint of one's own: of
    it as all parameters draw it), else "conventional". mesh: when None the usual one, with the curvature modes that are
    enough in the middle of the bounds; that they are few at an optimum is printed with it. extrapolate: as in `ksd.solve`;
    targets: drive values as a mapping. All answers are those of the equilibrium, whichever method leads there, so that
    slopes are theirs. A design that is not stable at a pose has no answers.

    Raises SceneError for everything that is wrong before a solve.
    """

    function: Callable[..., Any]
    drawn: _Drawn
    vary: Mapping[str, tuple[float, float]]
    answers: tuple[Answer, ...]
    rules: tuple[Rule, ...]
    bounds: Array
    held_by: Mapping[tuple[str, str], str]
    words: Mapping[str, Any]
    ranges: tuple[_Range, ...]
    asked: Questions
    loads: Any
    cases: Mapping[str, tuple[Load, ...]]
    drives: Mapping[str, Array]
    paths: DrivePaths
    method: Literal["full", "reduced", "conventional"]
    extrapolate: bool
    last: tuple[bytes, list[SolvedPoses]] | None

    def __init__(
        self,
        function: Callable[..., Any],
        *,
        vary: Mapping[str, tuple[float, float]],
        maximise: Targets = (),
        minimise: Targets = (),
        limits: Mapping[str, Any] | None = None,
        rules: Sequence[Rule] = (),
        loads: Mapping[str, Sequence[Mapping[str, Any]]] | None = None,
        link: Link | str | None = None,
        at: ArrayLike | None = None,
        freed: str | Sequence[str] | None = None,
        modes: int = 3,
        method: Literal["full", "reduced", "conventional"] | None = None,
        mesh: Mesh | None = None,
        extrapolate: bool = False,
        together: bool = False,
        targets: Mapping[str, ArrayLike] | None = None,
        **drives: ArrayLike,
    ) -> None:
        self.__dict__["words"] = {
            "vary": vary, "maximise": maximise, "minimise": minimise, "limits": limits, "rules": rules, "loads": loads,
            "link": link, "at": at, "freed": freed, "modes": modes, "method": method, "mesh": mesh,
            "extrapolate": extrapolate, "together": together, "targets": targets, **drives,
        }  # fmt: skip
        ways = ("full", "reduced", "conventional")
        check_solve_options(
            mesh=mesh, relinearisations=0, method=method, methods=ways, extrapolate=extrapolate
        )
        if not callable(function):
            raise SceneError("a job needs a function of the parameters it varies that returns a mechanism")
        values = drive_value_arrays(targets, drives, Job)
        if not values:
            raise SceneError("a job needs drive values, for example turn=[0, 0.3]")
        given = _given_bounds(vary)
        check_design_parameters(function, [given], "vary")
        self.__dict__.update(
            function=function, drawn=_Drawn(function, 2 * len(given) + SPARE), vary=given, loads=loads,
            extrapolate=extrapolate, last=None, **({} if mesh is None else {"mesh": mesh}),
            drives=values, cases=load_cases(loads), rules=_checked(rules),
            paths=drive_paths(values, together=boolean(together, "together")),
        )  # fmt: skip
        scene = self._first
        check_drives(scene, tuple(values), Job)
        self.__dict__["method"] = method or self._usual_method(scene, mesh or DEFAULT_MESH)
        for extra in self.cases.values():
            if add_loads(scene, extra)[1]:
                raise SceneError(add_loads(scene, extra)[1])
        known = column_questions(scene, modes)
        goals = goals_of(maximise, minimise, limits, known)
        questions = tuple(dict.fromkeys(known[goal.column] for goal in goals))
        asked = replace(parse_questions(questions, link, at, freed, modes=modes), detailed=True)
        check_questions(asked, scene)
        signed = {column for column, question in known.items() if question in SIGNED_QUESTIONS}
        self.__dict__.update(asked=asked, answers=self._listed(goals, scene, signed))
        self.__dict__.update(zip(("bounds", "held_by", "ranges"), self._trained(scene), strict=True))
        self.random(1)

    def __getstate__(self) -> dict[str, Any]:
        return {k: v for k, v in self.__dict__.items() if k not in ("_solvers", "_first")} | {"last": None}

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of what is varied."""
        return tuple(self.vary)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the answers."""
        return tuple(a.name for a in self.answers)

    @property
    def steps(self) -> list[dict[str, float]]:
        """Drive values by name of the poses of every load case."""
        return [step for path in self.paths for step in path]

    @cached_property
    def poses(self) -> tuple[tuple[str, Mapping[str, float]], ...]:
        """Load case and drive values by name of every pose."""
        return tuple((case, step) for case in self.cases for step in self.steps)

    @cached_property
    def mesh(self) -> Mesh:
        """As given, or with the curvature modes that are enough in the middle of the bounds, for all designs."""
        scenes = (add_loads(self._first, extra)[0] for extra in self.cases.values())
        recipe = Recipe(self.asked, method=self.method, extrapolate=self.extrapolate)
        return adequate_mesh(
            (SweepPath(k, {}, scene, tuple(self.steps)) for k, scene in enumerate(scenes)), recipe
        )

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        """Least and most by column, infinite where there is none."""
        found: dict[str, tuple[float, float]] = {}
        for a in (a for a in self.answers if a.role == "limit"):
            low, high = found.get(a.column.split("[")[0], (-np.inf, np.inf))
            found[a.column.split("[")[0]] = max(low, a.low), min(high, a.high)
        return found

    def _line(self) -> str:
        goals = {a.column.split("[")[0]: a.role for a in self.answers if a.role != "limit"}
        said = ", ".join(f"{role} {column}" for column, role in goals.items()) or "limits alone"
        poses = "one pose" if len(self.poses) == 1 else f"{len(self.poses)} poses"
        return f"{said} by {', '.join(self.parameters)} at {poses}"

    def __str__(self) -> str:
        lines = [f"Job: {self._line()}"]
        for name, (low, high) in zip(self.vary, self.bounds.tolist(), strict=True):
            cut = "".join(
                f", {self.held_by[name, s]}" for s in ("least", "most") if (name, s) in self.held_by
            )
            lines.append(f"  {name}: {format_number(low)} to {format_number(high)}{cut}")
        for column, (low, high) in self.limits.items():
            least, most = (f"{side} {format_number(v)}" for side, v in (("at least", low), ("at most", high)))
            lines.append(
                f"  {column} {' and '.join(t for t, v in ((least, low), (most, high)) if np.isfinite(v))}"
            )
        return "\n".join(lines)

    # ---- what is asked ---------------------------------------------------------------------------------------------------

    def _listed(self, goals: list[Answer], scene: Scene, signed: set[str]) -> tuple[Answer, ...]:
        """Every goal at every pose; stress of every leaf; size of all poses together; of `signed` the size. No two names are
        alike: a limit of what is minimised by its size says so."""
        found, labels = [], self._labels(scene)
        leaves = [f"stress_MPa[{name}]" for name in scene.leaf_names()]
        for goal in goals:
            if goal.column.startswith("size_"):
                found.append(goal)
                continue
            amount = goal.role == "minimise" and goal.column in signed
            sizes = {a.name for a in found if a.amount}
            for k, label in enumerate(labels):
                for part in goal.parts(leaves):
                    name = f"{part.column}{label}"
                    name += " with its sign" if name in sizes else ""
                    found.append(replace(part, name=name, pose=k, amount=amount))
        return tuple(found)

    def _labels(self, scene: Scene) -> list[str]:
        """Which pose each is, in words and in as many digits as tell them apart; nothing where there is only one."""
        if len(self.poses) == 1:
            return [""]
        units = drive_columns(scene)
        moving = [n for n, v in self.drives.items() if len(v) > 1 or len(self.steps) == 1]
        found: list[str] = []
        for say in (format_number, "{:.6g}".format, "{:.9g}".format, "{:.12g}".format, repr):
            found = []
            for case, step in self.poses:
                said = [f"{n} {say(units[n][1] * step[n])} {units[n][0].rsplit('_', 1)[1]}" for n in moving]
                found.append(f" at {', '.join([*([case] if case else []), *said])}")
            if len(set(found)) == len(found):
                break
        return found

    def _trained(self, scene: Scene) -> tuple[Array, dict[tuple[str, str], str], tuple[_Range, ...]]:
        """Bounds within the trained ranges of the joints, what cut them, and ranges that hang on several parameters."""
        bounds, others = np.array(list(self.vary.values())), []
        cut: dict[tuple[str, str], str] = {}
        if self.method == "conventional" or self.extrapolate:
            return bounds, cut, ()
        ranges = [
            _Range(k, shape, f"{shape.name} of {placed.joint.family} '{placed.name}'")
            for k, placed in enumerate(scene.joints)
            for shape in find_record(placed.joint.family).parameters
        ]
        # which parameters change which shapes, seen at two places
        by: list[set[int]] = [set() for _ in ranges]
        for base in (0.37, 0.71):
            here = self._shapes_at(np.full(len(bounds), base))
            for i in range(len(bounds)):
                there = self._shapes_at(base + 0.13 * (np.arange(len(bounds)) == i))
                for own, r in zip(by, ranges, strict=True):
                    a, b = r.of(here), r.of(there)
                    own |= {i} if abs(a - b) > 1e-9 * max(abs(a), abs(b)) else set()
        for own, r in zip(by, ranges, strict=True):
            if len(own) != 1:
                others += [r] if own else []
                continue
            i = own.pop()
            name, low, high = self.parameters[i], *self._within(r, i)
            said = f"the trained range {format_number(r.shape.low)} to {format_number(r.shape.high)} of {r.words}"
            if not low < high:
                raise SceneError(
                    f"vary: {name} = {show(self.vary[name])} lies outside {said}; vary it within, or give "
                    "method='conventional' or extrapolate=True"
                )
            for side, end, tighter in (("least", 0, low > bounds[i, 0]), ("most", 1, high < bounds[i, 1])):
                if tighter:
                    bounds[i, end] = (low, high)[end]
                    cut[name, side] = f"{side} by {said}"
        return bounds, cut, tuple(others)

    def _shapes_at(self, place: Array) -> list[Mapping[str, float]]:
        """Shape parameters of every joint at places (P,) in 0..1 of the bounds given; none where it cannot be drawn."""
        return [joint.shape() for joint in self._joints_at(place)]

    def _joints_at(self, place: Array) -> list[Joint]:
        """Every joint at places (P,) in 0..1 of the bounds given; none where it cannot be drawn."""
        try:
            return [p.joint for p in build_scene(self.drawn, _design_between(self.vary, place)).joints]
        except SceneError:
            return []

    def _usual_method(self, scene: Scene, mesh: Mesh) -> Literal["full", "conventional"]:
        """ "full" where links are rigid, plate factors left out and all joints have records, of joints drawn as they are by
        any parameters."""
        if not scene.joints or scene.compliances or "plate" in mentioned_effects(scene, mesh):
            return "conventional"
        elsewhere = self._joints_at(np.full(len(self.vary), 0.37))
        try:
            for joint in (*(placed.joint for placed in scene.joints), *elsewhere):
                check_proportions(joint, find_record(joint.family))
        except RecordError:
            return "conventional"
        return "full"

    def _within(self, own: _Range, i: int) -> tuple[float, float]:
        """Where, between its bounds, parameter i keeps a shape parameter within its range; nothing where it never does."""
        low, high = self.vary[self.parameters[i]]

        def margin(share: float) -> float:
            place = np.full(len(self.vary), 0.37)
            place[i] = share
            # a bound in other digits than the range is within, as records take it
            return own.margin(self._shapes_at(place)) + 5e-10

        good = [s for s in np.linspace(0.0, 1.0, 9).tolist() if margin(s) >= 0.0]
        if not good:
            return high, low
        ends = ((good[0], good[0] - 0.125), (good[-1], good[-1] + 0.125))
        least, most = (brentq(margin, a, b, xtol=1e-15) if 0.0 <= b <= 1.0 else a for a, b in ends)
        return low + least * (high - low), low + most * (high - low)

    # ---- designs ---------------------------------------------------------------------------------------------------------

    def design_at(self, x: ArrayLike) -> dict[str, float]:
        """Parameters by name of x (P,)."""
        found = np.asarray(x, float)
        if found.shape != (len(self.vary),):
            raise SceneError(
                f"a design of this job is {len(self.vary)} numbers: {', '.join(self.parameters)}"
            )
        return dict(zip(self.vary, found.tolist(), strict=True))

    def point(self, start: Mapping[str, float] | ArrayLike | None) -> Array:
        """x (P,) of a design by name or in order, the middle when None. Raises SceneError for one outside the bounds."""
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
            # a bound in other digits is no start outside
            if not low - 1e-9 * abs(low) <= value <= high + 1e-9 * abs(high):
                raise SceneError(
                    f"start: {name} = {format_number(value)} lies outside {format_number(low)} to {format_number(high)}"
                )
        return np.clip(x, *self.bounds.T)

    def random(self, count: int, seed: int = 0) -> Array:
        """Designs (count, P) within bounds and rules, the middle first where it is. Raises SceneError where no rule is
        met."""
        rng, found = np.random.default_rng(seed), []
        positive = (self.bounds > 0.0).all(axis=1)
        ends = self.bounds.copy()
        ends[positive] = np.log(ends[positive])
        least, spread = np.full(len(self.rule_names), -np.inf), np.diff(ends)[:, 0]
        for k in range(TRIED + 50 * count):
            place = np.full(len(ends), 0.5) if k == 0 and seed == 0 else rng.uniform(size=len(ends))
            at = ends[:, 0] + place * spread
            x = np.clip(np.where(positive, np.exp(np.where(positive, at, 0.0)), at), *self.bounds.T)
            value = self.rule_values(x, shapes=False)
            if (value >= 0.0).all() and self.ranges:
                # drawing a scene costs more than most rules
                value = self.rule_values(x)
            least[: len(value)] = np.fmax(least[: len(value)], value)
            if (value >= 0.0).all():
                found.append(x)
            if len(found) == count:
                return np.array(found)
        if self.ranges and (least[len(self.rules) :] <= -1.0).all():
            try:
                build_scene(self.drawn, self.design_at(x))
            except SceneError as why:
                raise SceneError(
                    f"no design within the bounds and rules could be built; the last one: {why}"
                ) from why
        never = [n for n, v in zip(self.rule_names, least, strict=True) if v < 0.0]
        said = f"rule {never[0]} is met" if never else "all rules are met together"
        raise SceneError(f"{said} by none of {TRIED} designs within the bounds")

    @property
    def rule_names(self) -> tuple[str, ...]:
        """Names of the rules, and of trained ranges that hang on several parameters."""
        return (*(_spoken_rule(k, r) for k, r in enumerate(self.rules)), *(r.words for r in self.ranges))

    def rule_values(self, x: ArrayLike, *, shapes: bool = True) -> Array:
        """Rules (R,) at a design: not negative where they are met; without `shapes` those of the parameters alone. Raises
        SceneError for a rule that is no number."""
        parameters, found = self.design_at(x), []
        for k, rule in enumerate(self.rules):
            try:
                value = rule(dict(parameters))
                if isinstance(value, bool | np.bool_):
                    raise ValueError(
                        f"it is {value}; in place of a < b give b - a, not negative where it is met"
                    )
                found.append(float(value))
            except (KeyError, TypeError, ValueError, ArithmeticError) as why:
                missing = isinstance(why, KeyError)
                words = (
                    f"no parameter {why}{name_hint(why.args[0], self.parameters)}" if missing else str(why)
                )
                raise SceneError(f"rule {_spoken_rule(k, rule)} gives no number: {words}") from None
        if self.ranges and shapes:
            found += self._range_margins(parameters)
        return np.array(found)

    def _range_margins(self, parameters: Mapping[str, float]) -> list[float]:
        """How far a design is within the trained ranges that hang on several parameters."""
        try:
            drawn = [placed.joint.shape() for placed in build_scene(self.drawn, parameters).joints]
        except SceneError:
            drawn = []
        return [r.margin(drawn) for r in self.ranges]

    def range_slopes(self, x: ArrayLike) -> Array:
        """Slopes (ranges, P) of the last rules, by the designs that `slopes` draws too."""
        parameters, found = self.design_at(x), np.zeros((len(self.ranges), len(self.vary)))
        for i, (name, value) in enumerate(parameters.items() if self.ranges else ()):
            h = RELATIVE_STEP * (abs(value) or 1.0)
            with without_whole_checks():
                plus, minus = (self._range_margins({**parameters, name: value + s}) for s in (h, -h))
            found[:, i] = (np.array(plus) - minus) / (2 * h)
        return found

    # ---- answers ---------------------------------------------------------------------------------------------------------

    def values(self, x: ArrayLike) -> Array:
        """Answers (answers,) of a design, in the units of their columns; nan where it has none: `batch` says why."""
        return self.batch(np.asarray(x, float)[None]).values[0]

    def batch(self, X: ArrayLike, *, executor: Executor | None = None) -> DesignAnswers:
        """Answers of designs X (D, P), all poses and load cases; an executor gets blocks of designs."""
        check_executor(executor)
        X = np.atleast_2d(np.asarray(X, float))
        judged, solved = self._judged(X, executor)
        self.__dict__["last"] = (X[0].tobytes(), solved) if solved else None
        return judged

    def _judged(self, X: Array, executor: Executor | None = None) -> tuple[DesignAnswers, list[SolvedPoses]]:
        """`batch`, and the poses of a single design that has all answers."""
        designs = [self.design_at(x) for x in X]
        rows: list[list[Row]] = [[] for _ in designs]
        status: list[str] = [OK] * len(designs)
        steps = self.steps
        solved: list[SolvedPoses] = []
        for extra in self.cases.values():
            function = _Loaded(self.drawn, extra)
            for d, (mine, why, poses) in enumerate(self._solved(function, designs, steps, executor)):
                rows[d] += mine
                status[d] = why if status[d] == OK else status[d]
                solved += [SolvedPoses(poses[0].model.said, poses, steps)] if poses else []
        good = status == [OK] and len(solved) == len(self.cases)
        return DesignAnswers(
            np.array([self._of(mine) for mine in rows]), tuple(status)
        ), solved if good else []

    def _solved(
        self, function: Any, designs: list[dict[str, float]], steps: list[Any], executor: Executor | None
    ) -> list[tuple[list[Row], str, list[Configuration]]]:
        """Rows of every design, "ok" or the first reason why not, and of a single one its poses."""
        single = len(designs) == 1 and executor is None
        if self.method == "conventional":
            recipe = Recipe(self.asked, method="conventional", mesh=self.mesh, with_verdict=False)
            if executor is not None:
                return run_in_blocks(executor, designs, 1, _walked_all, function, recipe, self.paths)
            return _walked_all(function, recipe, self.paths, designs, keep=single)
        solver = self._solvers[single]
        if executor is not None:
            found = solver.solve_in(executor, function, designs)
        else:
            found = solver.solve(scene_factories(function, designs), 1)
        return [(*_rows_of(f, len(steps)), f.poses if isinstance(f, DesignResult) else []) for f in found]

    @cached_property
    def _solvers(self) -> dict[bool, BatchSolver]:
        """What solves designs, keeping their poses or not."""
        values = {n: np.array([step[n] for step in self.steps]) for n in self.drives}
        method = FULL if self.method == "full" else REDUCED
        ways = {"method": method, "questions": self.asked, "equilibrate": True}
        return {
            k: BatchSolver(values, {**ways, "keep_configurations": k}, self.mesh, self.extrapolate)
            for k in (False, True)
        }

    def _of(self, rows: list[Row]) -> Array:
        """Answers (answers,) from the rows of all poses."""
        found = np.empty(len(self.answers))
        for k, a in enumerate(self.answers):
            if a.pose is None:
                ends = [
                    [row.get(a.column.replace("size", end), np.nan) for row in rows]
                    for end in ("highest", "lowest")
                ]
                found[k] = np.max(ends[0]) - np.min(ends[1])
            else:
                row = rows[a.pose]
                value = row.get(a.column, np.nan)
                value = abs(value) if a.amount else value
                # an answer that is there but no number: what it stands for
                found[k] = a.infinite if a.column in row and np.isnan(value) else value
        return found

    def jacobian(self, x: ArrayLike) -> Array:
        """Derivatives (answers, P) of the answers by the parameters, see `ksd.gradient`. Raises what it raises."""
        return self.slopes(x)[1]

    def slopes(self, x: ArrayLike) -> tuple[Array, Array]:
        """Answers (answers,) and their derivatives (answers, P), of the equilibria that values are asked of."""
        x, last = np.asarray(x, float), self.last
        if last is not None and last[0] == x.tobytes():
            solved = last[1]
        else:
            judged, solved = self._judged(x[None])
            if not solved:
                raise KsdError(f"no gradient: {judged.status[0]}")
        found = gradient_at(solved, self.asked, self.drawn, self.design_at(x))
        column = {c: i for i, c in enumerate(found.columns)}
        rows = [{c: float(found.values[c][n]) for c in column} for n in range(len(self.poses))]
        slopes = np.zeros((len(self.answers), len(self.vary)))
        for k, a in enumerate(self.answers):
            if a.pose is None:
                high, low = (column[a.column.replace("size", end)] for end in ("highest", "lowest"))
                slopes[k] = found.slopes[high, :, np.argmax(found.values[found.columns[high]])]
                slopes[k] -= found.slopes[low, :, np.argmin(found.values[found.columns[low]])]
            elif a.column in column:
                slopes[k] = found.slopes[column[a.column], :, a.pose]
                slopes[k] *= np.sign(rows[a.pose][a.column]) if a.amount else 1.0
        values = self._of(rows)
        slopes[np.isinf(values)] = 0.0
        return values, slopes

    def few_modes(self, x: ArrayLike) -> str:
        """That the curvature modes of the mesh are few for the leaf springs of a design; nothing where they are enough."""
        poses = [pose for one in self._judged(np.asarray(x, float)[None])[1] for pose in one.poses]
        worst = max(poses, key=lambda pose: pose.mesh_adequacy.missed_share, default=None)
        return (
            ""
            if worst is None
            else "".join(with_mesh_check(worst, DEFAULT_ACCURACY).notes[len(worst.notes) :])
        )

    def merit(self, values: ArrayLike) -> float:
        """The worst target over its scale, larger is better: of what is minimised the largest with a minus; nan of a job
        that has limits alone."""
        pairs = zip(self.answers, np.asarray(values, float), strict=True)
        return float(np.min([a.merit(v) for a, v in pairs if a.role != "limit"] or [np.nan]))

    def merit_spoken(self, *merits: float, digits: int = 3) -> str:
        """The worst target in words, at one design or from one to another: over its scale, or where there is
        but one and no scale, by its column."""
        name = self.merit_name
        said = " to ".join(format_number(self.merit_sign * m, digits) for m in merits)
        if name.endswith("scale"):
            return f"worst target {said} of its scale"
        return f"{name} {said}"

    @property
    def merit_sign(self) -> float:
        """-1 where targets are minimised: `merit` is minus the worst of them."""
        return -1.0 if any(a.role == "minimise" for a in self.answers) else 1.0

    @property
    def merit_name(self) -> str:
        """What `merit` times its sign is, in words."""
        goals = [a for a in self.answers if a.role != "limit"]
        if any(a.scale != 1.0 for a in goals):
            return "worst target over its scale"
        # "support_worst_N_per_m[2]" is one of "support_worst_N_per_m"
        columns = {a.column.split("[")[0] for a in goals}
        if len(columns) > 1:
            return "worst target"
        return f"worst {columns.pop()}"

    def scene_at(self, design: Mapping[str, float], case: str) -> Scene:
        """The scene of a design with the loads of a case of `poses`. SceneError where it cannot be drawn."""
        return _Loaded(self.drawn, self.cases[case])(**design)

    @cached_property
    def _first(self) -> Scene:
        """The scene in the middle of the bounds, or of another design within them."""
        return first_built(lambda **parameters: build_scene(self.drawn, parameters), self.vary)

    def far_drives(self) -> tuple[str, ...]:
        """Drive values that were probably meant in another unit, a sentence each."""
        model = compile_scene(self._first, mesh=self.mesh)
        return tuple(dict.fromkeys(said for _, values in self.poses for said in model.far_drives(values)))

    def margins(self, values: ArrayLike) -> Array:
        """How far every side of every limit is met (sides,) by `values` (answers,), over the limit (by itself where that is
        0); negative where it is not."""
        pairs = zip(self.answers, np.asarray(values, float), strict=True)
        return np.array([margin for a, v in pairs for margin in a.margins(v)])

    def moved(self, by: Array, at: Array | None = None) -> Job:
        """The same job with limits moved in by (answers,), in the units of their columns; where values `at` (answers,) are
        given, limits of their sign, and targets, by that share of them in logarithms."""
        at = np.full(len(by), np.nan) if at is None else at
        found = copy(self)
        found.__dict__["answers"] = tuple(
            a.moved(*own) for a, *own in zip(self.answers, by.tolist(), at.tolist(), strict=True)
        )
        return found

    def limited(self, column: str, high: float) -> Job:
        """The same job with an answer limited from above, by this or by the limit it has. SceneError for an unknown one."""
        own = [
            a.role == "limit" and a.column.split("[")[0] == column and np.isfinite(a.high)
            for a in self.answers
        ]
        if any(own):
            found = copy(self)
            found.__dict__["answers"] = tuple(
                replace(a, high=min(a.high, high)) if mine else a
                for a, mine in zip(self.answers, own, strict=True)
            )
            return found
        low = self.limits.get(column, (-np.inf, np.inf))[0]
        both = (low if np.isfinite(low) else None, min(high, MAX_MAGNITUDE))
        limits = {**(self.words["limits"] or {}), column: both}
        return Job(self.function, **{**self.words, "limits": limits})

    def fingerprint(self) -> str:
        """What answers depend on beside the parameters: the recipe, the scenes of two designs, and joint records."""
        scenes, failed = [], []
        for x in self.random(2):
            try:
                scenes.append(build_scene(self.drawn, self.design_at(x)))
            except SceneError as why:
                failed.append(str(why))
        said = (
            self.asked, self.method, self.mesh, self.extrapolate, self.poses, self.loads, self.names,
            [a.amount for a in self.answers], [scene.fingerprint() for scene in scenes],
            record_hashes(scenes, self.method), failed,
        )  # fmt: skip
        return f"{self.parameters} {said!r}"


@dataclass(frozen=True)
class _Range:
    """Trained range of a shape parameter of joint number `joint`."""

    joint: int
    shape: Any
    words: str

    def of(self, shapes: Sequence[Mapping[str, float]]) -> float:
        """The shape parameter among those of all joints; nan where there is none."""
        known = shapes[self.joint] if self.joint < len(shapes) else {}
        return float(known.get(self.shape.name, np.nan))

    def margin(self, shapes: Sequence[Mapping[str, float]]) -> float:
        """How far it is within its range, 1 in the middle, 0 at its ends."""
        value = self.of(shapes)
        known = np.isfinite(value) and (self.shape.scale != "log" or value > 0.0)
        return 1.0 - abs(self.shape.place(value)) if known else -1.0


def _given_bounds(vary: Any) -> dict[str, tuple[float, float]]:
    if not isinstance(vary, Mapping) or not vary:
        raise SceneError(
            "vary: give least and most of every parameter by name, vary={'thickness': (2e-4, 1e-3)}"
        )
    found = {}
    for name, given in vary.items():
        if isinstance(given, str) or not isinstance(given, Sequence | np.ndarray) or len(given) != 2:
            raise SceneError(f"vary: {name} = {show(given)}: give (least, most)")
        low, high = (number(v, f"vary: {name}") for v in given)
        if not low < high:
            raise SceneError(
                f"vary: {name} = {show(given)} holds no design: the least must be below the most"
            )
        found[str(name)] = (low, high)
    return found


def first_built(make: Callable[..., Any], bounds: Mapping[str, tuple[float, float]]) -> Any:
    """What `make` returns of the parameters in the middle of bounds by name, or elsewhere within them. Raises SceneError
    where it does so nowhere."""
    reason: SceneError | None = None
    middle = np.full(len(bounds), 0.5)
    for place in (middle, *np.random.default_rng(0).uniform(size=(40, len(bounds)))):
        try:
            return make(**_design_between(bounds, place))
        except SceneError as why:
            reason = reason or why
    raise SceneError(f"no design within the bounds could be built; the one in the middle: {reason}")


def _design_between(bounds: Mapping[str, tuple[float, float]], place: Array) -> dict[str, float]:
    """Parameters by name at places (P,) in 0..1 of their bounds."""
    return {
        n: low + share * (high - low)
        for (n, (low, high)), share in zip(bounds.items(), place.tolist(), strict=True)
    }


def _checked(rules: Any) -> tuple[Rule, ...]:
    rules = (rules,) if callable(rules) else rules
    if isinstance(rules, str) or not isinstance(rules, Sequence) or not all(callable(r) for r in rules):
        raise SceneError(
            f"rules = {show(rules)}: give functions of the parameters, such as lambda p: 0.07 - p['inner'] - 2 * p['outer']"
        )
    return tuple(rules)


def _spoken_rule(k: int, rule: Rule) -> str:
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


def _rows_of(found: DesignResult | KsdError, count: int) -> tuple[list[Row], str]:
    """Rows of the poses of a design, and "ok" or the first reason why not."""
    if not isinstance(found, DesignResult):
        return [{}] * count, str(found)
    bad = np.flatnonzero(found.status)
    if not len(bad):
        return found.rows, OK
    n = int(bad[0])
    return found.rows, found.reasons.get(n) or status_sentence(int(found.status[n]))


def _walked_all(
    function: Any, recipe: Recipe, paths: Any, designs: Sequence[Mapping[str, float]], *, keep: bool = False
) -> list[tuple[list[Row], str, list[Configuration]]]:
    """Rows of designs by conventional poses, each from the one before, "ok" or the first reason why not, and where they are
    to be kept the poses."""
    found = []
    for design in designs:
        rows: list[Row] = []
        poses: list[Configuration] = []
        solver, (scene, failure) = None, scene_or_reason(function, design)
        for k, path in enumerate(paths):
            line = SweepPath(k, {}, scene, path, failure)
            solver = run_path(line, recipe, solver, rows, poses if keep else None)
        found.append((rows, next((str(row["status"]) for row in rows if row["status"] != OK), OK), poses))
    return found
