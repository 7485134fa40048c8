"""The order in which loads and drives act, where it decides in which equilibrium a mechanism ends.

Loads and drives are applied together, or the joints are placed by the drives alone: that is fast, and where all equilibria
on the way are regular the end does not depend on the order. It may depend on it where a leaf spring can buckle on the way.
The force that compresses a leaf spring shows that: after buckling it stays near the critical one. Then the mechanism is
followed by arc length in two orders, the loads first and the drives afterwards, as a machine meets them, and the reverse.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ksd.answers.derived import cached_per_model
from ksd.answers.forces import end_wrenches
from ksd.answers.leaf_groups import chain_groups, elastic_stiffness, end_frames, leaf_groups, shape_difference
from ksd.answers.printing import format_number
from ksd.checks import show
from ksd.errors import ConvergenceError, SceneError
from ksd.model.arrays import State, carries_load
from ksd.model.compile import Model, compile_scene
from ksd.numerics.kernel import kernel
from ksd.numerics.stopwatch import Stopwatch
from ksd.solvers.arc_length import END_REACHED, follow_by_arc_length
from ksd.solvers.configuration import Configuration
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.either_side import nearby_minimum
from ksd.solvers.error import equilibrium_near
from ksd.solvers.joint_motions import JointMotionReader
from ksd.solvers.load_steps import LoadPath, state_difference
from ksd.solvers.steps import FAST_METHODS, Step, Stop
from ksd.solvers.storage import NewtonStorage
from ksd.solvers.undeformed_stability import strain_causes
from ksd.solvers.verdict import EQUAL_STATE_TOLERANCE, is_solved

Array = NDArray[np.float64]
Order = Literal["loads", "drives", "together"]
"""What acts first: the loads, the drives, or both in proportion."""
ORDERS: dict[Order, str] = {
    "loads": "loads, then drives",
    "drives": "drives, then loads",
    "together": "drives and loads together",
}
"""Every order in words."""
SNAPS = "where the mechanism snaps or buckles"
STRAIN_STEPS = 12
"""Steps of heat and assembly errors where the mechanism does not go down the energy at once."""
MAX_COMPRESSION = 0.5
"""Compression of a leaf spring over pi^2 EI / L^2 above which both orders are followed; of 677 random mechanisms those whose
orders ended apart had at least 0.79."""


def check_order(order: Order) -> Order:
    """The order itself. Raises SceneError for another word."""
    if order not in ORDERS:
        words = ", ".join(f"'{word}' ({meaning})" for word, meaning in ORDERS.items())
        raise SceneError(f"order = {show(order)}: choose one of {words}")
    return order


@cached_per_model
def _euler_forces(model: Model) -> Array:
    """pi^2 EI / L^2 [N] of the run of leaf springs that each member (m,) belongs to; inf for members that cannot buckle.

    EI: that of uniform bending about the weaker axis. L: of all members of a run, which are joined by nodes that nothing
    else holds.
    """
    members = model.arrays.members
    compliance = np.zeros(len(members.kind))
    for group in leaf_groups(model):
        nx, ny = group.number[:2].tolist()
        flexible = np.linalg.inv(elastic_stiffness(group))
        weakest = np.maximum(flexible[:, nx, nx], flexible[:, nx + ny, nx + ny])
        compliance[group.members] = weakest * members.length[group.members]
    for group in chain_groups(model):
        records = group.value[:, : 16 * int(group.number[0])].reshape(len(group.members), -1, 16)
        cubed = records[..., :1] ** 3
        rigidity = (
            0.5 * cubed * np.stack([records[..., 3] + records[..., 4], records[..., 5] + records[..., 6]], -1)
        )
        mean = (records[..., :1] / rigidity).sum(axis=1) / records[..., :1].sum(axis=1)
        compliance[group.members] = mean.max(axis=1)
    run = _runs(model)
    length = np.bincount(run, members.length)[run]
    weakest = np.zeros(len(length))
    np.maximum.at(weakest, run, compliance)
    with np.errstate(divide="ignore"):
        return np.where(compliance > 0.0, np.pi**2 / (weakest[run] * length**2), np.inf)


def _runs(model: Model) -> NDArray[np.int64]:
    """Number of the run (m,) of every member; members are in one run where the node between them holds nothing else."""
    arrays, node = model.arrays, model.arrays.members.node
    ends = np.bincount(node.ravel(), minlength=len(arrays.start))
    ends[0] = 0
    ends[np.concatenate([arrays.terms.node.ravel(), arrays.springs.node.ravel()])] = 0
    between = np.flatnonzero(ends == 2)
    pairs = [np.flatnonzero((node == k).any(axis=1)) for k in between.tolist()]
    joined = np.array([p for p in pairs if len(p) == 2], np.int64).reshape(-1, 2)
    size = len(node)
    graph = coo_matrix((np.ones(len(joined)), (joined[:, 0], joined[:, 1])), shape=(size, size))
    return connected_components(graph, directed=False)[1].astype(np.int64)


@cached_per_model
def _buckling_bounds(model: Model) -> tuple[NDArray[np.int64], Array]:
    """For every strain-mode leaf spring where the inner state has its force, and the square of the largest force [N^2] of
    which no direction is a compression above `MAX_COMPRESSION`."""
    groups = leaf_groups(model)
    places = [group.inner_index[:, group.modes] for group in groups]
    members = [group.members for group in groups]
    bounds = np.square(MAX_COMPRESSION * _euler_forces(model))
    return np.concatenate([np.zeros(0, np.int64), *places]), bounds[
        np.concatenate([np.zeros(0, np.int64), *members])
    ]


@kernel
def _has_larger_force(inner: Array, place: NDArray[np.int64], bound: Array) -> bool:
    """Whether the square of any force inner[place[i]], inner[place[i] + 1], ... is above bound[i]."""
    for i in range(len(place)):
        at = place[i]
        if inner[at] ** 2 + inner[at + 1] ** 2 + inner[at + 2] ** 2 > bound[i]:
            return True
    return False


def compression(model: Model, motion: State) -> float:
    """Largest compression of a leaf spring along its chord over pi^2 EI / L^2; 0 where it is below `MAX_COMPRESSION`."""
    if not model.chains and not _has_larger_force(motion.inner, *_buckling_bounds(model)):
        return 0.0
    wrenches, euler = end_wrenches(model, motion)[:, :3], _euler_forces(model)
    d = end_frames(model, motion, slice(None)).d
    along = -(wrenches * d).sum(axis=1) / np.linalg.norm(d, axis=1)
    largest = float((along / euler).max())
    return largest if largest > MAX_COMPRESSION else 0.0


@dataclass(frozen=True)
class OrderedPath:
    """Where one order of loads and drives leads.

    state, negatives: the end, None where it was not reached. obstacle: the first limit point or bifurcation on the way, at
    which a machine leaves the path, or why the end was not reached, in words; empty where there is neither.
    factorisations, time [s]: spent on it.
    """

    order: Order
    state: State | None
    negatives: int
    obstacle: str
    factorisations: int
    time: float

    @property
    def is_regular(self) -> bool:
        """Whether the end was reached without a singular point on the way."""
        return self.state is not None and not self.obstacle

    @property
    def words(self) -> str:
        """The order in words."""
        return ORDERS[self.order]


@cached_per_model
def _followed(model: Model) -> dict[tuple[bytes, Order, bool], OrderedPath]:
    """Cache of `follow_in_order`, for the last drive values."""
    return {}


def follow_in_order(model: Model, target: Array, order: Order, *, past_singular: bool = False) -> OrderedPath:
    """Follow a mechanism by arc length from rest to the drives `target` (c,).

    past_singular: through limit points and past bifurcations too; else the first one is the end.
    """
    key, known = (target.tobytes(), order, past_singular), _followed(model)
    if key not in known:
        if any(values != key[0] for values, *_ in known):
            known.clear()
        known[key] = _follow(model, target, order, model.rest, np.inf if past_singular else 1.0)
    return known[key]


def _follow(
    model: Model, target: Array, order: Order, state: State, max_singular_points: float, *, skipped: int = 0
) -> OrderedPath:
    """See `follow_in_order`; from a state that the first `skipped` legs have led to."""
    still, clock = np.zeros_like(target), Stopwatch()
    legs = {
        "loads": (("loads", LoadPath(still, still)), ("drives", LoadPath(still, target, (1.0, 1.0)))),
        "drives": (("drives", LoadPath(still, target, (0.0, 0.0))), ("loads", LoadPath(target, target))),
        "together": (("drives and loads", LoadPath(still, target)),),
    }[order]
    negatives, count, obstacle = 0, 0, ""
    for name, path in legs[skipped:]:
        if not target.any() and name == "drives":
            continue
        try:
            followed = follow_by_arc_length(model, path, state, max_singular_points=max_singular_points)
        except (ConvergenceError, np.linalg.LinAlgError):
            failure = obstacle or f"no equilibrium before the {name}"
            return OrderedPath(order, None, negatives, failure, count, clock())
        count += followed.factorisations
        if followed.singular_points and not obstacle:
            first = followed.singular_points[0]
            obstacle = f"a {first.kind} point at {100 * first.point.f:.3g} % of the {name}"
        if followed.stop_reason != END_REACHED:
            failure = obstacle or f"no end of the {name}: {followed.stop_reason}"
            return OrderedPath(order, None, negatives, failure, count, clock())
        state, negatives = followed.points[-1].motion, followed.newton.count_unstable(followed.points[-1])
    if negatives != len(target):
        obstacle = obstacle or "states that are unstable from the start on"
    return OrderedPath(order, state, negatives, obstacle, count, clock())


def solve_in_order(
    model: Model,
    targets: Mapping[str, float],
    *,
    order: Order = "loads",
    storage: NewtonStorage | None = None,
    planar: bool | Literal["auto"] = "auto",
    joints: JointMotionReader | None = None,
    method: str = "conventional",
) -> Configuration:
    """Solve with drives and loads together; where that fails or cannot be trusted, along the paths of `order` and of the
    other orders.

    storage, planar, joints, method: see `ksd.solvers.conventional.solve_conventional`. Raises ConvergenceError.
    """
    result, failure = None, None
    try:
        result = solve_conventional(
            model, targets, storage=storage, planar=planar, joints=joints, method=method
        )
    except ConvergenceError as reason:
        failure = reason
    if result is not None and is_solved(result):
        return result
    last, target = result or getattr(failure, "result", None), model.targets(targets)
    # drive values in another unit are refused soon
    if (
        isinstance(last, Configuration)
        and last.steps[-1].stop is not Stop.SINGULAR
        and not model.far_drives(targets)
    ):
        values = dict(zip(model.drive_names, target.tolist(), strict=False))
        last = replace(last, targets=values, load_factor=1.0)
        for candidate in _other_ways(model, target, order, last):
            if is_solved(candidate):
                return replace(candidate, method=method, joint_motions=joints)
    if result is None:
        assert failure is not None
        raise failure
    return result


def _other_ways(
    model: Model,
    target: Array,
    order: Order,
    last: Configuration,
) -> Iterator[Configuration]:
    """Where other ways to the same loads and drives end: those without a singular point on them first."""
    passing = []
    for name in _by_preference(order) if carries_load(model.arrays) and target.any() else ("together",):
        path = follow_in_order(model, target, name, past_singular=True)
        if path.is_regular:
            yield _end_of(
                path,
                last,
                f"found by following {path.words}, since one solve with both together found no answer",
            )
        elif path.state is not None:
            passing.append(path)
    for path in passing:
        yield _end_of(path, last, f"found by following {path.words}, past {path.obstacle}, {SNAPS}")
    yield from _braced(model, target, last)


def _braced(model: Model, target: Array, last: Configuration) -> Iterator[Configuration]:
    """Where assembly errors, heat or preload strain the undeformed configuration, as in a bow with its string: the minimum
    of energy that it goes down to, and from there the drives."""
    if not model.conservative or not strain_causes(model)[0]:
        return
    clock = Stopwatch()
    rest = replace(
        last, motion=model.rest, targets=dict.fromkeys(model.drive_names, 0.0), load_factor=1.0, doubts=()
    )
    state, count = _down_the_energy(model, rest)
    if state is None:
        return
    step = Step("equilibrium", count, clock(), 1.0, Stop.CONVERGED, "down the energy from rest")
    note = "found by going down the energy from rest, where loads and what strains leaf springs act, then by the drives"
    found = replace(
        rest, motion=state, negatives=len(target), steps=(*last.steps, step), method="conventional"
    )
    if target.any():
        try:
            driven = solve_conventional(model, last.targets, start=found)
            yield replace(driven, steps=(*found.steps, *driven.steps), notes=(*last.notes, note))
        except ConvergenceError:
            pass
        path = _follow(model, target, "loads", state, np.inf, skipped=1)
        if path.state is None:
            return
        found = _end_of(path, replace(found, targets=last.targets))
        note += f", past {path.obstacle}, {SNAPS}" if path.obstacle else ""
    yield replace(found, notes=(*last.notes, note))


def _down_the_energy(model: Model, rest: Configuration) -> tuple[State | None, int]:
    """The minimum below the undeformed configuration `rest`, at once or with heat and assembly errors in steps, None where
    there is none; and the steps."""
    still, count = np.zeros((len(model.node_names), 6)), 0
    for parts in (1, STRAIN_STEPS):
        state: State | None = model.rest
        for k in range(1, parts + 1):
            if state is not None:
                own = model if k == parts else _strained(model, k / parts)
                state, more = nearby_minimum(own, replace(rest, model=own, motion=state), still)
                count += more
        if state is not None:
            break
    return state, count


def _strained(model: Model, share: float) -> Model:
    """The model with a share of the heat and of the assembly errors."""
    scene = model.original_scene
    leaves = scene.leaf_names()
    heats = (replace(h, temperature=share * h.temperature, through=share * h.through) for h in scene.heats)
    fits = []
    for fit in scene.fits:
        drawn, natural = leaves[fit.leaf].length, fit.natural_length
        fits.append(
            replace(
                fit, natural_length=natural and drawn + share * (natural - drawn),
                shift=share * np.asarray(fit.shift), turn=share * np.asarray(fit.turn),
            )
        )  # fmt: skip
    return compile_scene(replace(scene, heats=tuple(heats), fits=tuple(fits)), mesh=model.mesh)


def _by_preference(order: Order) -> tuple[Order, ...]:
    """All orders, the one asked for first."""
    return order, *(other for other in ORDERS if other != order)


def _end_of(path: OrderedPath, last: Configuration, *notes: str) -> Configuration:
    """The end of a path as a configuration, in place of `last`, which has the same drives."""
    assert path.state is not None
    note = f"{path.words}, by arc length"
    step = Step("equilibrium", path.factorisations, path.time, 1.0, Stop.CONVERGED, note)
    return replace(
        last, motion=path.state.copy(), steps=(*last.steps, step), negatives=path.negatives, doubts=(),
        notes=(*last.notes, *notes), method_error=None, method_was_chosen=False, joints_near_intended=False,
    )  # fmt: skip


def settle_order(found: Configuration, order: Order, joints: JointMotionReader | None) -> Configuration:
    """The result itself, or the state in which loads and drives end in `order`, where the order may decide.

    A note says where the orders end apart; a result of condensed joints, which have one branch, is doubted where it is
    elsewhere. joints: see `ksd.solvers.conventional.solve_conventional`.
    """
    model = found.model
    if not (carries_load(model.arrays) and compression(model, found.motion)):
        return found
    target = model.targets(found.targets)
    if not (target.any() and is_solved(found)):
        return found
    paths = [follow_in_order(model, target, name) for name in _by_preference(order)[:2]]
    end = next((path for path in paths if path.is_regular), None)
    if end is None or end.state is None:
        both = ", and ".join(f"{path.words} meet {path.obstacle}" for path in paths)
        return replace(found, notes=(*found.notes, f"the loading order may decide: {both}, {SNAPS}"))
    notes = [_apart(end, path, model) for path in paths if path is not end]
    if _is_same(found, end.state):
        return replace(found, notes=(*found.notes, *filter(None, notes)))
    if found.method in FAST_METHODS and not found.method_was_chosen:
        doubt = f"{end.words} end in another equilibrium, which method='conventional' finds"
        return replace(found, doubts=(*found.doubts, doubt))
    method = "conventional" if found.method in FAST_METHODS else found.method
    return replace(_end_of(end, found, *filter(None, notes)), method=method, joint_motions=joints)


def _is_same(found: Configuration, state: State) -> bool:
    """Whether a result is the equilibrium `state`, or the approximation of it by a fast method."""
    model, motion = found.model, found.motion
    if found.method in FAST_METHODS:
        try:
            motion = equilibrium_near(found)
        except ConvergenceError:
            return False
    return _difference(model, motion, state) < EQUAL_STATE_TOLERANCE


def _difference(model: Model, one: State, other: State) -> float:
    """`state_difference`, and the largest difference of the shape of a leaf spring: its turn [rad], or place over length."""
    return max(state_difference(model, one, other), shape_difference(model, one.inner, other.inner))


def _apart(end: OrderedPath, other: OrderedPath, model: Model) -> str:
    """A sentence where another order does not end where `end` does; empty where it does."""
    assert end.state is not None
    if other.state is not None and _difference(model, end.state, other.state) < EQUAL_STATE_TOLERANCE:
        return ""
    here = f"the loading order decides: this is where {end.words} end"
    if not other.is_regular or other.state is None:
        return f"{here}; {other.words} meet {other.obstacle}, {SNAPS}"
    ours, theirs = (-state.multiplier[: len(model.drive_names)] for state in (end.state, other.state))
    k = int(np.argmax(np.abs(ours - theirs)))
    one, another = (format_number(float(forces[k]), 6) for forces in (theirs, ours))
    drive = model.scene.drives[k]
    unit = "N" if drive.dimension == "length" else "Nm"
    return (
        f"{here}; {other.words} end in another equilibrium, with {one} instead of {another} {unit} at drive "
        f"'{drive.name}' (order='{other.order}')"
    )
