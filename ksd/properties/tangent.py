"""The tangent of a model at a state, factored once for all questions, with drives held or freed.

A freed drive keeps its present force (a constant multiplier) and may move: its row and column are taken out
of the matrix and a -1 put on its diagonal. That is exact, leaves the pattern alone, and keeps the count of
negative pivots (one per row) what it was, so stability is judged in the same way.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.checks import names_of
from ksd.errors import KinematicsError, SceneError
from ksd.model.arrays import COROTATIONAL, LINEAR, SOLID, Arrays, FlatArrays, State, Workspace, make_workspace
from ksd.model.compile import Model
from ksd.model.loading import term_slope
from ksd.model.newton import SINGULAR_PIVOT, assemble
from ksd.numerics.blocks import factor_blocks, residual_blocks, solve_blocks, solve_refined_rows
from ksd.numerics.indefinite import equilibration, negative_inertia, solve_scaled
from ksd.properties.cache import cached_per_model
from ksd.properties.nonconservative import skew_tangent
from ksd.properties.state_batch import StateBatch

Array = NDArray[np.float64]
ROW_SHARE_TOLERANCE = 1e-9
"""Share of a load below which what rows do not take of it is rounding."""
MAX_BACKWARD_ERROR = 1e-6
"""Change by the last refinement, over the whole solution, beyond which its digits count as lost."""
CONVERGED_STEP = 1e-9
"""Next Newton step, in rad, sizes of the mechanism, shares of the largest drive force, up to which none is left to take."""


@cached_per_model
def exact_tangent_arrays(model: Model) -> Arrays:
    """Arrays of a model with the stresses of Appendix A chains taken from the state instead of extrapolated, as the exact
    tangent requires."""
    arrays = model.arrays
    if COROTATIONAL not in model.kinds:
        return arrays
    number = arrays.members.number.copy()
    number[arrays.members.kind == COROTATIONAL, 1] = 0
    return arrays._replace(members=arrays.members._replace(number=number))


def row_numbers(model: Model, names: Iterable[str]) -> list[int]:
    """Rows of drives and supports by name; SceneError for a name that is neither."""
    known = (*model.drive_names, *model.support_names)
    names = names_of(names, "freed")
    for name in names:
        if name not in known:
            raise SceneError(
                f"'{name}' cannot be freed: it is neither a drive nor a support; there are "
                f"{', '.join(known) or 'none'}"
            )
    return [known.index(name) for name in names]


def release_rows(arrays: Arrays, value: Array, rows: Iterable[int]) -> None:
    """Take constraint rows out of the stored matrix `value`, in place (see the module docstring)."""
    terms, plan = arrays.terms, arrays.plan
    for row in rows:
        for block in terms.block[terms.first[row] : terms.first[row + 1], :2].ravel():
            if block >= 0:
                value[block : block + 6] = 0.0
        value[plan.diagonal[int(np.searchsorted(plan.start, terms.start[row]))]] = -1.0


def row_gradients(
    arrays: Arrays, motion: State, rows: Iterable[int], *, flat: FlatArrays | None = None
) -> Array:
    """Derivatives (unknowns, len(rows)) of the coordinates of drives and supports with respect to the node motions.

    flat: numbers of the model, where they are not those of `arrays`.
    """
    flat = arrays.flat if flat is None else flat
    terms, rows = arrays.terms, list(rows)
    found = np.zeros((arrays.plan.unknowns, len(rows)))
    slope = np.empty((8, 3))
    for k, row in enumerate(rows):
        for t in range(terms.first[row], terms.first[row + 1]):
            term_slope(flat.ints, flat.floats, motion.x, motion.R, t, slope)
            for e in range(2):
                start = arrays.start[terms.node[t, e]]
                if start >= 0:
                    found[start : start + 6, k] += terms.coefficient[t] * slope[2 * e : 2 * e + 2].ravel()
    return found


_TURNS = np.arange(3, 6)


def remove_row_components(arrays: Arrays, size: Any, gradients: Array, loads: Array) -> tuple[Array, Array]:
    """`loads` (unknowns, k) less what is a combination of the `gradients` (unknowns, r) of held rows, and the combinations
    (r, k). Rows take their part without a motion, so a load that is nothing else is on a held direction: exactly zero.

    arrays: whose unknowns they are; size [m]: of the mechanism. All may have a leading axis over states.
    """
    start, size, unknowns = arrays.start, np.asarray(size), arrays.plan.unknowns
    turns = np.ones((*size.shape, unknowns, 1))
    turns[..., start[start >= 0, None] + _TURNS, 0] = size[..., None, None]
    # rows depend on the motion of few nodes
    own = np.flatnonzero(gradients.any(axis=-1).reshape(-1, unknowns).any(axis=0))
    A, left = (gradients / turns)[..., own, :], loads / turns
    norm = np.sqrt((A * A).sum(axis=-2, keepdims=True))
    norm[norm == 0.0] = 1.0
    A = A / norm
    share = (A.swapaxes(-1, -2) if A.shape[-1] == 1 else np.linalg.pinv(A, rcond=ROW_SHARE_TOLERANCE)) @ left[
        ..., own, :
    ]
    least = ROW_SHARE_TOLERANCE**2 * (left * left).sum(axis=-2, keepdims=True)
    left[..., own, :] -= A @ share
    none = (left * left).sum(axis=-2, keepdims=True) <= least
    return np.where(none, 0.0, left) * turns, share / norm.swapaxes(-1, -2)


def batch_responses(states: StateBatch, loads: Array) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Response (D, k, unknowns) of D states to `loads` (D, k, unknowns), all drives held; where it is one (D,): where
    the tangent is regular and rounding leaves digits, see `Tangent.solve`; and where the state is at a stable equilibrium
    (D,), drives and supports where they are."""
    topology, found, rows = states.topology, np.empty(loads.shape), states.topology.terms.start
    work, (good, stable) = make_workspace(topology), np.zeros((2, len(loads)), bool)
    plan, stored, held = topology.plan.ints, np.empty_like(work.matrix), np.zeros(len(rows))
    step = np.full((len(loads), topology.plan.unknowns), np.inf)
    for d, ((arrays, motion), factor) in enumerate(zip(states.states, states.factor.tolist(), strict=True)):
        if len(work.weight):
            work.weight[:] = arrays.weight
        _, _, inside, status = assemble(arrays, motion, held, factor, work, 1e-8, 0, 10.0)
        stored[:] = work.matrix
        negatives, pivot = factor_blocks(plan, work.matrix, work.scaled_rows, len(topology.plan.size))
        if pivot > SINGULAR_PIVOT:
            good[d] = (
                solve_refined_rows(plan, stored, work.matrix, work.scaled_rows, loads[d], found[d])
                <= MAX_BACKWARD_ERROR
            )
            stable[d] = status == 0 and negatives + inside == len(rows)
            work.rhs[rows] = 0.0
            solve_blocks(plan, work.matrix, work.scaled_rows, work.rhs)
            step[d] = work.rhs
    return found, good, stable & _none_left(states, step)


def _none_left(states: StateBatch, step: Array) -> NDArray[np.bool_]:
    """Whether Newton steps (D, unknowns) are none that is left to take (D,), see LEFT."""
    start, rows = states.topology.start, states.topology.terms.start
    moves = step[:, start[start >= 0, None] + np.arange(6)].reshape(len(step), -1, 2, 3)
    moved, turned = np.sqrt((moves * moves).sum(axis=3).max(axis=1, initial=0.0)).T
    pulled = np.abs(step[:, rows]).max(axis=1, initial=0.0)
    most = np.abs(states.motion.multiplier).max(axis=1, initial=0.0)
    return (np.maximum(moved / states.sizes, turned) <= CONVERGED_STEP) & (pulled <= CONVERGED_STEP * most)


@dataclass(frozen=True)
class AssembledTangent:
    """The exact tangent of a model at a state before it is factored: value in the storage of the plan; inside: negative
    pivots met inside the members; skew: see `Tangent`. work: as assembled, the residual in its `rhs`."""

    model: Model
    motion: State
    arrays: Arrays
    value: Array
    inside: int
    skew: tuple[NDArray[np.int64], Array] | None
    work: Workspace

    def matrix(self, freed: Iterable[str] = ()) -> Array:
        """The symmetric matrix (unknowns, unknowns), with the drives and supports in `freed` let go."""
        value = self.value.copy()
        release_rows(self.arrays, value, row_numbers(self.model, freed))
        return stored_matrix(self.arrays, value)


def check_backward_error(error: float) -> None:
    """Raise KinematicsError where the backward error of an answer says that its digits are lost."""
    if not error <= MAX_BACKWARD_ERROR:
        raise KinematicsError(
            f"the tangent is all but singular (a refined solution still changes by {error:.1e} of itself): a motion is left "
            "that hardly anything resists, or the state is at its critical load; hold more drives"
        )


@dataclass(frozen=True)
class Tangent:
    """Factored tangent: solve with it; unstable: number of directions in which the state is not a minimum; freed: the
    drives and supports let go.

    assembled: the same as `value` before it was factored; every solution is refined with it. skew: the skew part that
    loads add to it which are not conservative: the places (k,) of the unknowns of the loaded nodes and (k, k).
    """

    model: Model
    motion: State
    arrays: Arrays
    assembled: Array
    value: Array
    spare: Array
    unstable: int
    freed: tuple[str, ...] = ()
    skew: tuple[NDArray[np.int64], Array] | None = None

    def solve(self, loads: Array) -> Array:
        """Response (unknowns, k) to `loads` (unknowns, k) in the order of the plan. Raises KinematicsError where rounding
        leaves no digits of it."""
        return self.solve_with_error(loads)[0]

    def solve_with_error(self, loads: Array) -> tuple[Array, float]:
        """The same, and its backward error: the largest share of a solution, in the norm of the diagonal, that its last
        refinement changed: an estimate of its error before that, a bound for what is left."""
        found, error = self._symmetric(loads)
        check_backward_error(error)
        if self.skew is None:
            return found, error
        places, rest = self.skew
        found = self._with_skew(found)
        # refined with the whole matrix
        left = self._residual(loads, found)
        left[places] -= rest @ found[places]
        change = self._with_skew(self._symmetric(left)[0])
        weight = self.weight()[:, None]
        moved, whole = (np.linalg.norm(part * weight, axis=0) for part in (change, found))
        error = max(error, float(np.max(moved / np.maximum(whole, 1e-300), initial=0.0)))
        check_backward_error(error)
        return found + change, error

    def _with_skew(self, found: Array) -> Array:
        """The response with the skew part, from that without (Sherman, Morrison, Woodbury)."""
        assert self.skew is not None
        places, rest = self.skew
        X, small = self._columns
        taken: Array = found - X @ np.linalg.solve(small, rest @ found[places])
        return taken

    def _symmetric(self, loads: Array) -> tuple[Array, float]:
        """Response to loads without the skew part, and its backward error."""
        plan, right = self.arrays.plan, np.ascontiguousarray(loads.T, dtype=float)
        found = np.empty_like(right)
        error = solve_refined_rows(plan.ints, self.assembled, self.value, self.spare, right, found)
        return found.T, float(error)

    def _residual(self, loads: Array, found: Array) -> Array:
        """What the symmetric matrix leaves of loads (unknowns, k)."""
        left, low = np.empty(found.T.shape), np.empty(len(found))
        for b, x, rest in zip(loads.T, found.T, left, strict=True):
            residual_blocks(
                self.arrays.plan.ints,
                self.assembled,
                np.ascontiguousarray(b, float),
                np.ascontiguousarray(x),
                rest,
                low,
            )
        return left.T.copy()

    def weight(self) -> Array:
        """(unknowns,): by which solutions are measured, see `ksd.numerics.blocks.refined_blocks`."""
        plan = self.arrays.plan
        own = [self.spare[at : at + n] for at, n in zip(plan.diagonal, plan.size, strict=True)]
        return np.asarray(np.sqrt(np.concatenate(own)))

    @cached_property
    def _columns(self) -> tuple[Array, Array]:
        assert self.skew is not None
        places, rest = self.skew
        units = np.zeros((self.arrays.plan.unknowns, len(places)))
        units[places, np.arange(len(places))] = 1.0
        X = self._symmetric(units)[0]
        return X, np.eye(len(places)) + rest @ X[places]

    def skew_share(self) -> float:
        """Largest |x* S x| / x* K x over complex x, S the skew and K the symmetric part, which must be positive definite on
        the motions that the rows leave."""
        if self.skew is None:
            return 0.0
        places, rest = self.skew
        return float(np.abs(np.linalg.eigvals(self._columns[0][places] @ rest)).max(initial=0.0))

    def unknowns(self, node: int) -> slice:
        """Where the motion (6,) of a node sits; ground has none."""
        start = int(self.arrays.start[node])
        return slice(start, start + 6)


@dataclass(frozen=True)
class DenseTangent(Tangent):
    """The same of a mechanism with members that resist nothing in some direction, supports alone holding them there."""

    matrix: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def _symmetric(self, loads: Array) -> tuple[Array, float]:
        K, b = self.matrix, np.asarray(loads, float)
        scale = equilibration(K)
        x = solve_scaled(K, b, scale)[0]
        # once more on what is left: what supports hold is to come out as held, not as rounding
        change = solve_scaled(K, b - K @ x, scale)[0]
        moved, whole = (np.linalg.norm(part / scale[:, None], axis=0) for part in (change, x))
        error = float(np.max(moved / np.maximum(whole, 1e-300), initial=0.0))
        return np.asarray(x + change), error

    def _residual(self, loads: Array, found: Array) -> Array:
        return np.asarray(loads - self.matrix @ found)

    def weight(self) -> Array:
        return np.asarray(1.0 / equilibration(self.matrix))


def assemble_tangent(
    model: Model, motion: State, *, load_factor: float = 1.0, target: Array | None = None
) -> AssembledTangent:
    """The exact tangent at `motion`, drives held; target (c,): their values, where the residual is of use."""
    arrays = exact_tangent_arrays(model)
    work = make_workspace(arrays)
    held = np.zeros(len(arrays.terms.start)) if target is None else target
    _, _, inside, _ = assemble(arrays, motion, held, load_factor, work, 1e-8, 0, 10.0)
    skew = skew_block(arrays, motion, load_factor)
    return AssembledTangent(model, motion, arrays, work.matrix.copy(), int(inside), skew, work)


def skew_block(arrays: Arrays, motion: State, load_factor: float) -> tuple[NDArray[np.int64], Array] | None:
    """What loads that are not conservative add, see `Tangent.skew`; None without any."""
    rest = skew_tangent(arrays, motion, load_factor)
    if rest is None:
        return None
    places = np.flatnonzero(rest.any(axis=1) | rest.any(axis=0))
    return places, rest[np.ix_(places, places)]


def factor_tangent(assembled: AssembledTangent, freed: Iterable[str] = ()) -> Tangent:
    """Factor a copy of a tangent, with the drives and supports named in `freed` let go at constant force.

    Raises SceneError for an unknown name, KinematicsError where a motion is left that nothing resists.
    """
    freed = names_of(freed, "freed")
    arrays, value = assembled.arrays, assembled.value.copy()
    if not assembled.model.kinds.isdisjoint((SOLID, LINEAR)):
        return _dense(assembled, freed)
    spare = np.zeros(len(value))
    release_rows(arrays, value, row_numbers(assembled.model, freed))
    stored = value.copy()
    negatives, pivot = factor_blocks(arrays.plan.ints, value, spare, len(arrays.plan.size))
    if not pivot > SINGULAR_PIVOT:
        raise KinematicsError(
            f"the tangent is singular (relative pivot {pivot:.1e}): a motion is left that nothing resists, or the "
            "state is exactly at its critical load; hold more drives"
        )
    unstable = int(negatives + assembled.inside) - len(arrays.terms.start)
    return Tangent(
        assembled.model, assembled.motion, arrays, stored, value, spare, unstable, freed, assembled.skew
    )


def _dense(assembled: AssembledTangent, freed: tuple[str, ...]) -> Tangent:
    """`factored` with pivoting: a solid meshed in 2D has zeros on its diagonal, which no bound on pivots sees."""
    K, arrays = assembled.matrix(freed), assembled.arrays
    _, condition = solve_scaled(K, np.zeros((len(K), 1)), equilibration(K))
    if not condition > SINGULAR_PIVOT:
        raise KinematicsError(
            f"the tangent is singular (reciprocal condition {condition:.1e}): a motion is left that nothing resists, or the "
            "state is exactly at its critical load; hold more drives, and by supports what a solid meshed in 2D cannot"
        )
    unstable = negative_inertia(K) + assembled.inside - len(arrays.terms.start)
    return DenseTangent(
        assembled.model, assembled.motion, arrays, assembled.value, assembled.value, assembled.value, unstable,
        freed, assembled.skew, matrix=K,
    )  # fmt: skip


def assemble_and_factor(
    model: Model, motion: State, *, freed: Iterable[str] = (), load_factor: float = 1.0
) -> Tangent:
    """Assemble and factor the exact tangent at `motion` in one go, see `factored`."""
    freed = names_of(freed, "freed")
    # wrong names are told before any work is done
    row_numbers(model, freed)
    return factor_tangent(assemble_tangent(model, motion, load_factor=load_factor), freed)


def stored_matrix(arrays: Arrays, value: Array) -> Array:
    """The symmetric matrix (unknowns, unknowns) held by a block storage `value`."""
    plan = arrays.plan
    full = np.zeros((plan.unknowns, plan.unknowns))
    for k in range(len(plan.size)):
        n, at = int(plan.size[k]), int(plan.start[k])
        full[at : at + n, at : at + n] = value[plan.diagonal[k] :][: n * n].reshape(n, n)
        for e in range(plan.first[k], plan.first[k + 1]):
            i = plan.row[e]
            m, to = int(plan.size[i]), int(plan.start[i])
            block = value[plan.place[e] :][: m * n].reshape(m, n)
            full[to : to + m, at : at + n] = block
            full[at : at + n, to : to + m] = block.T
    return full
