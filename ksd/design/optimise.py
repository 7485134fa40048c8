"""`ksd.optimise`: the design of a `ksd.Job` whose worst answer is best, by exact gradients, without derivatives, or by
evolution.

Epigraph form: the largest t with t <= log(answer / scale) for every target at every pose, limits and rules as constraints,
in logarithms of parameters and answers. Minimax kinks are harmless as constraints and fatal in a penalty. SLSQP (Kraft
1988, `scipy.optimize`) needs about ten values and gradients; several starts tell whether there is one optimum. Where a
design fails the step is halved from the last one that did not: no number is invented.
"""

from __future__ import annotations

import importlib
import os
import time
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize, nnls

from ksd.design.job import Job, Log
from ksd.design.sweep import SweepInterrupted
from ksd.design.table import OK, Table
from ksd.errors import ConvergenceError, KsdError, SceneError
from ksd.properties.words import Shown, listed
from ksd.properties.words import number as written
from ksd.section.checks import show, similar, whole

Array = np.ndarray
METHODS = ("gradient", "cobyla", "cma")
TOLERANCE = 1e-6
"""Change of the logarithm of the worst answer, and of limits exceeded, at which it stops."""
MOST = {"gradient": 100, "cobyla": 2000, "cma": 1000}
"""Iterations, or generations, of every method."""
PATIENCE = 4
"""Gradients without a design better by that at which SLSQP is ended: where targets and limits leave a direction open, its
line searches go on for ever smaller steps."""
BINDING = 1e-5
"""Margin, in logarithms, up to which a target or limit holds an optimum back."""
ROUNDS, SHORTEST = 40, 1e-7
"""How often it goes on where designs fail, and the step below which it does not."""
LINEAR = 0.1
"""Share of its limit below which an answer counts as it is, not by its logarithm."""
FREE = 10.0
"""Margin of an answer that is infinite: nothing moves, nothing buckles."""
PENALTY = 10.0
"""Of what is beyond its limit, in logarithms, in the fitness of a design."""
FLAT = 1e-5
"""Singular value of what holds an optimum, over the largest, below which a direction of parameters may be flat."""
TRIED = 1e-2
"""Step along such a direction at which it is looked whether anything changes."""


class _Failed(Exception):
    """A design at scaled parameters y that has no answers."""

    def __init__(self, y: Array, reason: str) -> None:
        super().__init__(reason)
        self.y = y


class _Stalled(Exception):
    """No better design for a while."""


class _Side(NamedTuple):
    """One side of an answer: its number among the answers, the sign and the reference of its margin, and whether it is a
    target."""

    answer: int
    sign: float
    reference: float
    target: bool


def _logs(r: Array) -> tuple[Array, Array]:
    """log r, below LINEAR continued by its tangent, and its derivative."""
    far = np.maximum(r, LINEAR)
    return np.log(far) + np.minimum(r - LINEAR, 0.0) / LINEAR, 1.0 / far


class Search:
    """A job in scaled parameters y (P,): margins (m,) of all sides of answers, then of rules, and their slopes (m, P).

    y: logarithms of parameters whose bounds are positive, others over their range. Margins of targets are log(answer /
    scale), of limits the logarithm of how far they are from being reached; not negative where they are met.
    """

    def __init__(self, job: Job, log: Log, by: str) -> None:
        self.job, self.log, self.by = job, log, by
        low, high = job.bounds.T
        self.positive = low > 0.0
        self.size = np.where(self.positive, 1.0, high - low)
        self.bounds = np.column_stack([self.scaled(low), self.scaled(high)])
        self.sides = _sides(job)
        self.targets = np.array([s.target for s in self.sides] + [False] * len(job.rule_names))
        self.good: Array | None = None
        self.best = -np.inf, np.zeros(len(low))
        self.asked: dict[bytes, Array] = {}
        self.sloped: dict[bytes, Array] = {}

    def scaled(self, x: Array) -> Array:
        """y of x."""
        return np.where(self.positive, np.log(np.where(self.positive, x, 1.0)), x / self.size)

    def x(self, y: Array) -> Array:
        """x of y, within the bounds."""
        found = np.where(self.positive, np.exp(np.where(self.positive, y, 0.0)), y * self.size)
        return np.clip(found, *self.job.bounds.T)

    def margins_of(self, values: Array, rules: Array) -> Array:
        """Margins from answers and rules."""
        return np.concatenate([self._of_answers(values)[0], rules / self.rule_sizes])

    def _of_answers(self, values: Array) -> tuple[Array, Array]:
        """Margins of all sides, and their derivatives by the answers."""
        v = values[[s.answer for s in self.sides]]
        sign, reference = np.array([s.sign for s in self.sides]), np.array([s.reference for s in self.sides])
        whole_ = np.isfinite(v)
        size = np.where(reference == 0.0, 1.0, reference)
        ratio = np.where(whole_, v, 1.0) / size
        value, slope = _logs(ratio)
        value, slope = np.where(reference == 0.0, ratio, value), np.where(reference == 0.0, 1.0, slope)
        free = np.where(sign * np.sign(v) * np.sign(size) > 0.0, FREE, -FREE)
        return np.where(whole_, sign * value, free), np.where(whole_, sign * slope / size, 0.0)

    @cached_property
    def rule_sizes(self) -> Array:
        """What rules (R,) are measured by: the largest size of each at the ends and in the middle of the bounds."""
        places = (*self.job.bounds.T, self.job.bounds.mean(axis=1))
        found = np.nan_to_num(np.max([np.abs(self.job.rule_values(x)) for x in places], axis=0))
        return np.where(found > 0.0, found, 1.0)

    def margins(self, y: Array) -> Array:
        """Margins (m,) at y. Raises _Failed where the design has no answers."""
        key = y.tobytes()
        if key not in self.asked:
            x = self.x(y)
            values, status = self.log.batch(x, by=self.by)
            if status[0] != OK or np.isnan(values[0]).any():
                raise _Failed(y, self._why(values[0], status[0]))
            self.asked[key] = self.margins_of(values[0], self.job.rule_values(x))
        self.good = y.copy()
        margins = self.asked[key]
        if self.fitness(margins) > self.best[0]:
            self.best = self.fitness(margins), y.copy()
        return margins

    def _why(self, values: Array, status: str) -> str:
        if status != OK:
            return status
        return f"there is no {self.job.names[int(np.argmax(np.isnan(values)))]}"

    def slopes(self, y: Array) -> Array:
        """Slopes (m, P) at y, rules by central differences. Raises _Failed."""
        key = y.tobytes()
        if key not in self.sloped:
            x = self.x(y)
            try:
                values, slopes = self.log.slopes(x, by=self.by)
            except KsdError as reason:
                raise _Failed(y, str(reason)) from reason
            inner = np.where(self.positive, x, self.size)
            _, outer = self._of_answers(values)
            rows = outer[:, None] * slopes[[s.answer for s in self.sides]] * inner
            bad = np.isnan(rows).any(axis=1)
            if bad.any():
                name = self.job.names[self.sides[int(np.argmax(bad))].answer]
                raise _Failed(y, f"there is no gradient of {name}")
            self.sloped[key] = np.vstack([rows, self._rule_slopes(y)])
        return self.sloped[key]

    def _rule_slopes(self, y: Array) -> Array:
        """Slopes (R, P) of the rules."""
        h, found = 1e-6, np.zeros((len(self.job.rule_names), len(y)))
        for i in range(len(y) if len(found) else 0):
            step = h * (np.arange(len(y)) == i)
            # a parameter at its bound is stepped to one side
            ends = [np.clip(y + s * step, *self.bounds.T) for s in (1, -1)]
            plus, minus = (self.job.rule_values(self.x(e)) for e in ends)
            found[:, i] = (plus - minus) / (ends[0][i] - ends[1][i]) / self.rule_sizes
        return found

    def level(self, margins: Array) -> float:
        """The least margin of the targets: the t that a design reaches."""
        return float(margins[self.targets].min())

    def fitness(self, margins: Array) -> float:
        """The level less PENALTY times what limits and rules are exceeded by."""
        return self.level(margins) - PENALTY * float(np.maximum(-margins[~self.targets], 0.0).sum())

    def met(self, margins: Array, by: float = BINDING) -> bool:
        """Whether limits and rules are met."""
        return bool((margins[~self.targets] >= -by).all())


def _sides(job: Job) -> tuple[_Side, ...]:
    """Sides of all answers: one of a target, one or two of a limit."""
    found = []
    for k, a in enumerate(job.answers):
        if a.role != "limit":
            found.append(_Side(k, 1.0 if a.role == "maximise" else -1.0, a.scale, True))
            continue
        # v <= high is log(high / v) >= 0, of negative numbers log(v / high)
        found += [_Side(k, -1.0 if a.high >= 0.0 else 1.0, a.high, False)] if np.isfinite(a.high) else []
        found += [_Side(k, 1.0 if a.low >= 0.0 else -1.0, a.low, False)] if np.isfinite(a.low) else []
    return tuple(found)


class Ended(NamedTuple):
    """How a start ended: its first and last design, the merit there, values and gradients asked for, and "ok" or why not."""

    start: dict[str, float]
    design: dict[str, float]
    merit: float
    values: int
    gradients: int
    status: str


@dataclass(frozen=True, repr=False, eq=False)
class Optimum(Shown):
    """The best design that was found, and what holds it.

    design: parameters by name, SI; merit: the worst target over its scale; answers: by name; held: what holds it back
    (target, limit, rule, bound), and what it is worth: percent by which the merit grows per percent that a limit or
    bound is moved (of targets the share that each has in the worst, of rules per percent of their range); flat: a
    direction of parameters that changes none of it, by name; starts: how each ended; seconds: of this process's thread.
    """

    job: Job
    method: str
    design: Mapping[str, float]
    merit: float
    answers: Mapping[str, float]
    held: Mapping[str, float]
    flat: Mapping[str, float]
    starts: tuple[Ended, ...]
    table: Table
    seconds: float

    @property
    def mechanism(self) -> Any:
        """The mechanism at the optimum."""
        return self.job.function(**self.design)

    @property
    def evaluations(self) -> int:
        """Values asked for, of all starts."""
        return sum(s.values for s in self.starts)

    @property
    def gradients(self) -> int:
        """Gradients asked for, of all starts."""
        return sum(s.gradients for s in self.starts)

    @property
    def agreed(self) -> int:
        """How many starts ended at this merit, to 1e-5."""
        return sum(
            s.status == OK and abs(s.merit - self.merit) <= 1e-5 * abs(self.merit) for s in self.starts
        )

    def _line(self) -> str:
        said = ", ".join(f"{n} {written(v)}" for n, v in self.design.items())
        return f"worst target {written(self.merit, 7)} of its scale at {said}"

    def __str__(self) -> str:
        bounds = dict(zip(self.job.parameters, self.job.bounds.tolist(), strict=True))
        rows = [(n, written(v, 6), *(written(b) for b in bounds[n])) for n, v in self.design.items()]
        head = (
            f"Optimum by {self.method}: the worst target is {written(self.merit, 7)} of its scale; {self.agreed} of "
            f"{len(self.starts)} starts end here; {self.evaluations} values, {self.gradients} gradients, "
            f"{self.seconds:.2f} s"
        )
        held = [
            (n, written(self.answers[n], 6) if n in self.answers else "", written(w, 4))
            for n, w in self.held.items()
        ]
        parts = [listed(("parameter", "value", "least", "most"), rows, head)]
        parts.append(listed(("held by", "value", "worth [%/%]"), held))
        for name, side in self.job.held_by:
            if f"{name} at its {side}" in self.held:
                parts.append(f"{name}: {self.job.held_by[name, side]}")
        if self.flat:
            said = ", ".join(f"{n} {100 * v:+.3g} %" for n, v in self.flat.items())
            parts.append(f"Flat: nothing that holds it changes along {said}; fix one of these parameters")
        return "\n".join(parts)


def optimise(
    job: Job,
    *,
    start: Mapping[str, float] | ArrayLike | None = None,
    starts: int = 1,
    method: Literal["gradient", "cobyla", "cma"] = "gradient",
    seed: int = 0,
    executor: Executor | None = None,
    resume: str | os.PathLike[str] | None = None,
    progress: bool = False,
) -> Optimum:
    """The design of a job whose worst target is best under its limits and rules; returns an `Optimum`.

    start: parameters by name or in order, the middle of the bounds when None; starts: how many, the others random by
    `seed`. method: "gradient" (SLSQP with `ksd.gradient`), "cobyla" (no derivatives), "cma" (evolution, then a polish
    by gradients; needs the package cma). executor, resume, progress: as in `ksd.sweep`; with `resume` designs in the
    file are not computed again.

    Raises SceneError for wrong words, ConvergenceError where no start leads to a design that meets the limits; Ctrl-C
    raises SweepInterrupted, with every design evaluated in its `.table`.
    """
    if not isinstance(job, Job):
        raise SceneError(f"{show(job)} is no job: make one with ksd.Job(...)")
    if not isinstance(method, str) or method not in METHODS:
        raise SceneError(
            f"method = {show(method)}: choose one of {', '.join(METHODS)}{similar(method, METHODS)}"
        )
    cma = _cma() if method == "cma" else None
    count = whole(starts, "starts")
    X = [job.point(start), *job.random(count, whole(seed, "seed", least=0) + 1)[: count - 1]]
    log = Log(job, resume=resume, executor=executor, progress=progress)
    began, ends = time.thread_time(), []
    best: tuple[float, Search, Array] | None = None
    try:
        for x in X:
            search = Search(job, log, method)
            way = _evolved if method == "cma" else _descended
            try:
                y = way(search, search.scaled(x), method if cma is None else cma)
                margins = search.margins(y)
                merit = job.merit(log.values(search.x(y)))
                status = OK if search.met(margins) else "the limits are not met"
                if status == OK and (best is None or merit > best[0]):
                    best = merit, search, y
            except _Failed as failed:
                y, merit, status = failed.y, np.nan, str(failed)
            first, last = job.design_at(x), job.design_at(search.x(y))
            ends.append(Ended(first, last, merit, len(search.asked), len(search.sloped), status))
        if best is None:
            raise ConvergenceError(
                f"none of {len(X)} starts led to a design that meets the limits; the first: {ends[0].status}"
            )
        held, flat = _holds(best[1], best[2])
    except KeyboardInterrupt:
        again = "" if log.kept.path is None else f"; call again with resume='{log.kept.path}' to go on"
        raise SweepInterrupted(
            f"interrupted: the designs done are in .table of this exception{again}", log.table()
        ) from None
    merit, search, y = best
    x = search.x(y)
    return Optimum(
        job, method, job.design_at(x), merit, dict(zip(job.names, log.values(x).tolist(), strict=True)), held, flat,
        tuple(ends), log.table(), time.thread_time() - began,
    )  # fmt: skip


def _cma() -> Any:
    """The package cma. Raises SceneError where it is not installed."""
    try:
        return importlib.import_module("cma")
    except ImportError:
        raise SceneError("method = 'cma' needs the package cma: pip install cma") from None


def _descended(search: Search, y: Array, method: str) -> Array:
    """The end of SLSQP or COBYLA from y; where designs fail, within half the step that led there, and twice that again
    where it went well."""
    reach, box = np.inf, search.bounds
    search.margins(y)
    for _ in range(ROUNDS):
        try:
            found = _minimised(search, y, box, method)
        except _Failed as failed:
            assert search.good is not None
            y = search.good
            reach = 0.5 * min(reach, float(np.abs(failed.y - y).max()))
            if reach < SHORTEST:
                break
        else:
            inside = np.abs(found - y).max() < 0.99 * reach
            y, reach = found, 2.0 * reach
            if inside:
                break
        box = np.column_stack(
            [np.maximum(search.bounds[:, 0], y - reach), np.minimum(search.bounds[:, 1], y + reach)]
        )
    return y


def _minimised(search: Search, y: Array, box: Array, method: str) -> Array:
    """The end within a box (P, 2)."""
    targets = search.targets.astype(float)

    def gap(z: Array) -> Array:
        return search.margins(_inside(z[:-1], box)) - targets * z[-1]

    reached, patience = -np.inf, PATIENCE

    def slope(z: Array) -> Array:
        nonlocal reached, patience
        better = search.best[0] > reached + TOLERANCE
        reached, patience = (
            (search.best[0], PATIENCE) if better else (reached, patience - np.isfinite(reached))
        )
        if patience <= 0:
            raise _Stalled
        return np.column_stack([search.slopes(_inside(z[:-1], box)), -targets])

    z = np.append(y, search.level(search.margins(y)))
    down = -np.eye(len(z))[-1]
    common: dict[str, Any] = {"fun": lambda z: -z[-1], "x0": z}
    if method == "gradient":
        try:
            found = minimize(
                **common, method="SLSQP", jac=lambda z: down, bounds=[*box.tolist(), (None, None)],
                constraints={"type": "ineq", "fun": gap, "jac": slope},
                options={"ftol": 1e-3 * TOLERANCE, "maxiter": MOST[method]},
            )  # fmt: skip
        except _Stalled:
            return search.best[1]
    else:

        def within(z: Array) -> Array:
            return np.concatenate([gap(z), z[:-1] - box[:, 0], box[:, 1] - z[:-1]])

        found = minimize(
            **common, method="COBYLA", constraints={"type": "ineq", "fun": within}, tol=1e-8,
            options={"rhobeg": 0.1, "maxiter": MOST[method]},
        )  # fmt: skip
    return _inside(found.x[:-1], box)


def _inside(y: Array, box: Array) -> Array:
    return np.ascontiguousarray(np.clip(y, *box.T))


def _evolved(search: Search, y: Array, cma: Any) -> Array:
    """The best of an evolution from y, polished by gradients; designs that fail are the worst."""
    low, spread = search.bounds[:, 0], np.diff(search.bounds)[:, 0]
    options = {"bounds": [0.0, 1.0], "seed": 1, "verbose": -9, "tolfun": 1e-8, "maxiter": MOST["cma"]}
    es = cma.CMAEvolutionStrategy(np.clip((y - low) / spread, 0.02, 0.98), 0.2, options)
    search.margins(y)
    while not es.stop():
        places = es.ask()
        Y = [np.ascontiguousarray(low + spread * np.clip(p, 0.0, 1.0)) for p in places]
        judged = search.log.batch([search.x(own) for own in Y], by=search.by)
        cost = []
        for own, values, status in zip(Y, *judged, strict=True):
            if status != OK or np.isnan(values).any():
                cost.append(np.inf)
                continue
            margins = search.margins_of(values, search.job.rule_values(search.x(own)))
            search.asked[own.tobytes()] = margins
            cost.append(-search.fitness(margins))
        es.tell(places, [c if np.isfinite(c) else 1e6 for c in cost])
    return _descended(search, _inside(low + spread * es.result.xbest, search.bounds), "gradient")


def _holds(search: Search, y: Array) -> tuple[dict[str, float], dict[str, float]]:
    """What holds an optimum, with its multiplier, and a flat direction."""
    job, margins, slopes = search.job, search.margins(y), search.slopes(y)
    level = search.level(margins)
    names = [job.names[s.answer] for s in search.sides] + [f"rule {n}" for n in job.rule_names]
    close = np.where(search.targets, margins - level, margins) <= 10 * BINDING
    rows = [(names[i], slopes[i], float(search.targets[i])) for i in np.flatnonzero(close)]
    free = len(rows)
    for i, name in enumerate(job.parameters):
        for side, end, sign in (("least", 0, 1.0), ("most", 1, -1.0)):
            if abs(y[i] - search.bounds[i, end]) <= 1e-7:
                rows.append((f"{name} at its {side}", sign * (np.arange(len(y)) == i), 0.0))
    A = np.array([[*row, target] for _, row, target in rows]).T
    worth = nnls(A, np.append(np.zeros(len(y)), 1.0))[0]
    held: dict[str, float] = {}
    for (name, _, _), w in zip(rows, worth.tolist(), strict=True):
        if w > 1e-7:
            held[name] = held.get(name, 0.0) + w
    _, values, ways = np.linalg.svd(A[:-1].T - np.outer(A[-1], A[:-1].T[A[-1] > 0].mean(axis=0)))
    rank = int(np.sum(values > FLAT * values[0])) if len(values) else 0
    if free == 0 or rank >= len(y) or not len(values):
        return held, {}
    return held, _flat(search, y, ways[-1], close)


def _flat(search: Search, y: Array, way: Array, close: Array) -> dict[str, float]:
    """The direction `way` (P,) by name, where a step along it changes nothing that is `close`; else nothing."""
    way = way / np.abs(way).max()
    try:
        ends = [search.margins(_inside(y + s * TRIED * way, search.bounds)) for s in (1.0, -1.0)]
    except _Failed:
        return {}
    here = search.margins(y)
    if max(float(np.abs(end - here)[close].max()) for end in ends) > BINDING * TRIED * 10:
        return {}
    return {n: float(v) for n, v in zip(search.job.parameters, way, strict=True) if abs(v) > 1e-3}
