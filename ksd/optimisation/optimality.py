"""Whether a design is an optimum: multipliers, stationarity, neighbours, kinks, and the same answers on a finer mesh."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog, nnls

from ksd.errors import KsdError, ResumeError
from ksd.optimisation.scaled_problem import ACTIVE_MARGIN, BOUND_MARGIN, DesignFailed, ScaledProblem
from ksd.study.table import OK

Array = np.ndarray
OPTIMUM, NO_BETTER, STOPPED = "optimum", "no better neighbour found", "stopped"
HAS_ANSWERS = "that has answers"
"""End of the names of edges beyond which designs have no answers."""
NEIGHBOURS = "neighbours of the optimum"
"""Label of the designs that are solved around an optimum."""
STATIONARY = 1e-3
"""Gain of the level per step, to first order, below which a design is stationary [%/%]."""
PROBE_STEP = 1e-2
"""Step, in scaled parameters, of the linearised problem that decides about stationarity."""
NEIGHBOUR_STEP = 5e-3
"""Step, in scaled parameters, to the neighbours that are solved."""
MAX_NEIGHBOURS = 6
"""Largest number of neighbours."""
EDGE_NEIGHBOURS = 24
"""Number of neighbours in addition at an edge of what has answers; many of them fail, at no cost."""
BETTER_SHARE = 1e-4
"""Relative gain of the merit from which a neighbour counts as better."""
MESH_SHARE = 1e-3
"""Relative change of merit or limits by a finer mesh from which it is said."""
WORTH_STEP = 5e-3
"""Relative move of a limit over which its worth is checked on the linearised problem."""
WORTH_TOLERANCE = 0.05
"""Relative difference of the worth of a limit moved out and in from which it is a kink."""
RANK_TOLERANCE = 1e-5
"""Singular value of the active constraints, over the largest, below which a direction of parameters may be flat."""
FLAT_STEP = 1e-2
"""Step, in scaled parameters, at which a direction is checked to be flat."""


@dataclass(frozen=True)
class Proof:
    """What shows that a design is an optimum.

    status: "optimum" (stationary, its limits met, no neighbour better), "no better neighbour found" (not shown to be
    stationary, or held by the edge of what has answers) or "stopped" (a neighbour is better, or nothing could be shown).
    remainder: percent by which the merit would still grow per percent of step, to first order; target_share: sum of the
    shares of the targets, 1 at an optimum. neighbours: number of designs solved around it, neighbour_gain: the largest
    relative gain of the merit among those that meet the limits, negative where all are worse. kinks: names of what is
    active and has different worths by the direction in which it is moved. mesh_change: relative change of the merit on a
    finer mesh, mesh_violation: the most by which a limit is exceeded there, in logarithms; nan where it has no answers.
    """

    status: str
    remainder: float = np.nan
    target_share: float = np.nan
    neighbours: int = 0
    neighbour_gain: float = np.nan
    kinks: tuple[str, ...] = ()
    mesh_change: float = np.nan
    mesh_violation: float = np.nan


class Active(NamedTuple):
    """Active targets, limits, rules and bounds: names, slopes (n, P), whether each is a target (n,), indices of the margins
    (beyond their number those of least, then of most bounds), and multipliers (n,) that balance the slopes best, those of
    targets with sum 1."""

    names: list[str]
    slopes: Array
    is_target: Array
    margin: Array
    multipliers: Array


def relative_gain(merit: float, other: float) -> float:
    """By how much a merit is better than another, relative to it."""
    return (merit - other) / (abs(other) or 1.0)


def linear_program(
    problem: ScaledProblem, y: Array, room: Array, ends: Array, *, most_violation: float = 0.0
) -> tuple[Array, float] | None:
    """The step (P,) from y that raises the level most to first order, and the level; None where there is none.

    room (m,): margins without a step; ends (P, 2): of the steps. Limits may be exceeded by most_violation, each at a hundred
    times the level.
    """
    is_target, count = problem.is_target, len(y)
    # unknowns: step, level, largest violation
    found = linprog(
        np.concatenate([np.zeros(count), [-1.0, 100.0]]), b_ub=room,
        A_ub=np.column_stack([-problem.slopes(y), is_target.astype(float), -(~is_target).astype(float)]),
        bounds=[*ends.tolist(), (None, None), (0.0, most_violation)],
    )  # fmt: skip
    return None if found.x is None else (np.asarray(found.x[:count]), float(found.x[count]))


def linear_gain(problem: ScaledProblem, y: Array, radius: float, moved: Array | None = None) -> float:
    """The most by which the level grows within a radius, to first order, without leaving limits farther than at y.

    moved (m + 2P,): amounts by which margins, and then lower and upper bounds, are moved out.
    """
    margins, is_target, count = problem.margins(y), problem.is_target, len(y)
    moved = np.zeros(len(margins) + 2 * count) if moved is None else moved
    room = np.where(is_target, margins - problem.level(margins), np.maximum(margins, 0.0))
    low, high = problem.edges[:, 0] - y, problem.edges[:, 1] - y
    low, high = np.minimum(low, 0.0), np.maximum(high, 0.0)
    low, high = low - moved[len(margins) :][:count], high + moved[len(margins) + count :]
    ends = np.column_stack(
        [np.minimum(np.maximum(low, -radius), high), np.maximum(np.minimum(high, radius), low)]
    )
    found = linear_program(problem, y, room + moved[: len(margins)], ends)
    return np.nan if found is None else found[1]


def remainder(problem: ScaledProblem, y: Array) -> float:
    """Growth of the level per step that is left at y, to first order; 0 at a stationary design. Raises DesignFailed."""
    gain = linear_gain(problem, y, PROBE_STEP) / PROBE_STEP
    return max(gain, 0.0) if np.isfinite(gain) else np.inf


def active_constraints(problem: ScaledProblem, y: Array) -> Active:
    """What is active at y. Raises DesignFailed where there is no gradient."""
    job, margins, slopes = problem.job, problem.margins(y), problem.slopes(y)
    names = [job.names[s.answer] for s in problem.sides] + [f"rule {n}" for n in job.rule_names]
    is_active = np.where(problem.is_target, margins - problem.level(margins), margins) <= ACTIVE_MARGIN
    index = np.flatnonzero(is_active).tolist()
    rows = [(names[i], slopes[i], problem.is_target[i], i) for i in index]
    for i, name in enumerate(job.parameters):
        for side, end, sign in (("least", 0, 1.0), ("most", 1, -1.0)):
            bound, edge = problem.bounds[i, end], problem.edges[i, end]
            if abs(y[i] - edge) <= BOUND_MARGIN:
                at = len(margins) + end * len(y) + i
                label = f"{name} at its {side}" if edge == bound else f"{name} at the {side} {HAS_ANSWERS}"
                rows.append((label, sign * (np.arange(len(y)) == i), False, at))
    own = [n for n, *_ in rows]
    A, is_target = (
        np.array([s for _, s, *_ in rows]).reshape(-1, len(y)),
        np.array([t for *_, t, _ in rows], bool),
    )
    size = max(float(np.abs(A).max(initial=0.0)), 1.0)
    # stationarity: multipliers that balance the slopes, those of targets with sum 1
    system = np.vstack([A.T, is_target.astype(float)[None] * size])
    multipliers = nnls(system, np.append(np.zeros(len(y)), size))[0]
    return Active(own, A, is_target, np.array([i for *_, i in rows], int), multipliers)


def worths(problem: ScaledProblem, y: Array, active: Active) -> dict[str, float]:
    """Worth of what is active by name: percent of the merit per percent of a limit or bound, of rules per percent of their
    range, of bounds of 0 per percent of the range of the parameter; shares of targets."""
    held: dict[str, float] = {}
    count, size = len(problem.is_target), problem.bounds.shape[0]
    for name, w, i in zip(active.names, active.multipliers.tolist(), active.margin.tolist(), strict=True):
        if w <= 1e-7:
            continue
        if i >= count and not problem.is_log[(i - count) % size]:
            end = abs(float(problem.bounds[(i - count) % size, (i - count) // size]))
            w *= end or 1.0
        elif len(problem.sides) <= i < count:
            k = i - len(problem.sides)
            w *= problem.rule_scales[k] / problem.rule_sizes[k]
        held[name] = held.get(name, 0.0) + float(w)
    return held


def kinks(problem: ScaledProblem, y: Array, active: Active) -> tuple[str, ...]:
    """Names of limits, rules and bounds whose worth differs where they are moved out and in, on the linearised problem.

    A limit is moved at all poses and leaf springs together, as its user would move it.
    """
    count, sides, answers = len(problem.is_target), problem.sides, problem.job.answers
    groups: dict[str, Array] = {}
    worth: dict[str, float] = {}
    for name, i, w in zip(active.names, active.margin.tolist(), active.multipliers.tolist(), strict=True):
        own = np.zeros(count + 2 * len(y), bool)
        own[i] = True
        if i < len(sides):
            if problem.is_target[i]:
                continue
            column, sign = answers[sides[i].answer].asked, sides[i].sign
            name = column
            own[: len(sides)] = [
                not s.is_target and s.sign == sign and answers[s.answer].asked == column for s in sides
            ]
        groups[name] = groups.get(name, own) | own
        worth[name] = worth.get(name, 0.0) + w
    radius = 4 * PROBE_STEP
    reference, found = linear_gain(problem, y, radius), []
    for name, own in groups.items():
        moved, w = WORTH_STEP * own, worth[name]
        ends = [
            (linear_gain(problem, y, radius, s * moved) - reference) * s / WORTH_STEP for s in (1.0, -1.0)
        ]
        # nan where no design is left
        size = float(np.abs([w, *ends]).max())
        if np.isnan(size) or (size > 1e-3 and max(abs(e - w) for e in ends) > WORTH_TOLERANCE * size):
            found.append(name)
    return tuple(found)


def neighbours(problem: ScaledProblem, y: Array) -> list[Array]:
    """Designs around y (P,): where there is a gradient, of many random ones those that are best to first order within the
    limits, else some random ones."""
    rng, count = np.random.default_rng(len(y)), len(y)
    steps = np.vstack([np.eye(count), -np.eye(count), rng.uniform(-1.0, 1.0, (32 * count, count))])
    ends = np.clip(y + NEIGHBOUR_STEP * steps, *problem.edges.T)
    ends = ends[np.abs(ends - y).max(axis=1) > 0.1 * NEIGHBOUR_STEP]
    try:
        margins, slopes, is_target = problem.margins(y), problem.slopes(y), problem.is_target
    except DesignFailed:
        order = rng.permutation(len(ends))
    else:
        predicted = margins + (ends - y) @ slopes.T
        violations = np.maximum(-predicted[:, ~is_target], 0.0).max(axis=1, initial=0.0)
        levels = predicted[:, is_target].min(axis=1, initial=np.inf)
        order = np.argsort(10.0 * violations - np.where(np.isfinite(levels), levels, 0.0))
    best = list(ends[order[: min(2 * count, MAX_NEIGHBOURS)]])
    if (problem.edges != problem.bounds).any():
        # an edge of what has answers need not be a bound of one parameter: there may be a way along it
        beyond = rng.uniform(-1.0, 1.0, (EDGE_NEIGHBOURS, count))
        best += list(np.clip(y + NEIGHBOUR_STEP * beyond, *problem.bounds.T))
    return [np.ascontiguousarray(end) for end in best]


def prove(problem: ScaledProblem, y: Array) -> tuple[Proof, Active | None, Array | None]:
    """What shows that y is an optimum, what is active there (None without a gradient), and a better neighbour (P,)."""
    merit = problem.design(y).merit
    around = neighbours(problem, y)
    found = [f for f in problem.designs(around, by=NEIGHBOURS) if f is not None]
    met = [
        f
        for f in found
        if problem.is_feasible(problem.margins_from(f.values, f.rules)) and np.isfinite(f.merit)
    ]
    best = max(met, key=lambda f: f.merit, default=None)
    gain = np.nan if best is None else relative_gain(best.merit, merit)
    better = best.y if best is not None and gain > BETTER_SHARE else None
    try:
        active, left = active_constraints(problem, y), remainder(problem, y)
        bent = kinks(problem, y, active)
    except DesignFailed:
        status = STOPPED if better is not None or not found else NO_BETTER
        return Proof(status, neighbours=len(found), neighbour_gain=gain), None, better
    share = float(active.multipliers[active.is_target].sum())
    # an edge of what has answers is no known bound
    is_known = not any(n.endswith(HAS_ANSWERS) for n in worths(problem, y, active))
    proven = left <= STATIONARY and is_known
    status = STOPPED if better is not None else OPTIMUM if proven else NO_BETTER
    return Proof(status, left, share, len(found), gain, bent), active, better


def on_finer_mesh(problem: ScaledProblem, y: Array, proof: Proof) -> Proof:
    """The proof with changes of merit and limits where the design is solved afresh on a finer mesh."""
    job = problem.job
    try:
        values, status = problem.log.on_finer_mesh(problem.unscaled(y))
    except ResumeError:
        raise
    except KsdError:
        return proof
    if status[0] != OK or np.isnan(values).any():
        return proof
    found = problem.design(y)
    margins = problem.margins_from(values[0], found.rules)
    change = relative_gain(job.merit(values[0]), found.merit)
    return replace(proof, mesh_change=change, mesh_violation=problem.violation(margins))


def flat_direction(problem: ScaledProblem, y: Array, active: Active) -> dict[str, float]:
    """A direction of parameters by name along which nothing that is active changes; empty without one."""
    A, is_target = active.slopes, active.is_target
    if not (active.margin < len(problem.is_target)).any() or not len(A):
        return {}
    mean = A[is_target].mean(axis=0) if is_target.any() else np.zeros(A.shape[1])
    _, values, directions = np.linalg.svd(A - np.outer(is_target, mean))
    if int(np.sum(values > RANK_TOLERANCE * max(values[0], 1e-300))) >= len(y):
        return {}
    direction = directions[-1] / np.abs(directions[-1]).max()
    own = active.margin[active.margin < len(problem.is_target)]
    margins = problem.margins(y)
    for s in (1.0, -1.0):
        try:
            end = problem.margins(
                np.ascontiguousarray(np.clip(y + s * FLAT_STEP * direction, *problem.bounds.T))
            )
        except DesignFailed:
            return {}
        if np.abs(end - margins)[own].max() > 1e-4 * FLAT_STEP:
            return {}
    return {n: float(v) for n, v in zip(problem.job.parameters, direction, strict=True) if abs(v) > 1e-3}
