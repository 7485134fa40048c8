"""Tangent of a model at a state, factored once for several questions, with drives and supports held or released.

A released drive keeps its present force (a constant multiplier) and may move: its row and column are removed from the matrix
and its diagonal is set to -1. This is exact, keeps the sparsity pattern, and keeps the number of negative pivots (one per
row), so the stability check does not change.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lu_factor, lu_solve, qr

from ksd.answers.derived import cached_per_model
from ksd.answers.nonconservative import skew_tangent
from ksd.answers.state_batch import StateBatch
from ksd.checks import names_of
from ksd.errors import KinematicsError, SceneError
from ksd.model.arrays import Arrays, State, Workspace, make_workspace
from ksd.model.compile import Model
from ksd.model.loading import term_slope
from ksd.model.newton import SINGULAR_PIVOT, assemble, assemble_nodes
from ksd.numerics.blocks import factor_blocks, residual_blocks, solve_blocks, solve_refined_rows
from ksd.numerics.indefinite import equilibration, negative_inertia, solve_scaled

Array = NDArray[np.float64]
ROW_SHARE_TOLERANCE = 1e-9
"""Share of a load below which the part that rows do not carry counts as rounding."""
FREE_SHARE = 1e-13
"""Stiffness of released rows, relative to that of the nodes they move, up to which their motion has no stiffness."""
SURE_PIVOT = 1e-9
"""Relative pivot above which no released row needs to be tried for a motion without stiffness."""
MAX_BACKWARD_ERROR = 1e-6
"""Largest accepted change of a solution by its last refinement, relative to the solution."""
INVERSE_ITERATIONS = 20
"""Inverse iterations for the softest motion, of which a tangent all but singular needs two."""
CONVERGED_STEP = 1e-9
"""Largest Newton step of a converged state: rotations [rad], displacements relative to the size of the mechanism, forces
relative to the largest drive force."""


@cached_per_model
def exact_tangent_arrays(model: Model) -> Arrays:
    """Arrays of a model with the stresses of Appendix A chains taken from the state instead of extrapolated, as the exact
    tangent requires."""
    arrays = model.arrays
    if not model.chains:
        return arrays
    number = arrays.members.number.copy()
    number[list(model.chains), 1] = 0
    return arrays.replace(members=arrays.members._replace(number=number))


def row_numbers(model: Model, names: Iterable[str]) -> list[int]:
    """Row numbers of drives and supports by name; raises SceneError for an unknown name."""
    known = (*model.drive_names, *model.support_names)
    names = names_of(names, "freed")
    for name in names:
        if name not in known:
            raise SceneError(
                f"'{name}' cannot be freed: it is neither a drive nor a support; there are "
                f"{', '.join(known) or 'none'}"
            )
    return [known.index(name) for name in names]


def row_values(model: Model, motion: State) -> Array:
    """Values (c,) of the drives and supports at `motion` [m or rad]."""
    work = make_workspace(model.arrays)
    assemble_nodes(model.arrays, motion, 0.0, work)
    return work.rhs[model.arrays.terms.start].copy()


def release_rows(arrays: Arrays, value: Array, rows: Iterable[int]) -> None:
    """Release constraint rows in the stored matrix `value`, in place (see the module docstring)."""
    terms, plan = arrays.terms, arrays.plan
    for row in rows:
        for block in terms.block[terms.first[row] : terms.first[row + 1], :2].ravel():
            if block >= 0:
                value[block : block + 6] = 0.0
        value[plan.diagonal[int(np.searchsorted(plan.start, terms.start[row]))]] = -1.0


def row_gradients(arrays: Arrays, motion: State, rows: Iterable[int]) -> Array:
    """Derivatives (unknowns, len(rows)) of the coordinates of drives and supports with respect to the node motions."""
    terms, rows = arrays.terms, list(rows)
    found = np.zeros((arrays.plan.unknowns, len(rows)))
    slope = np.empty((8, 3))
    for k, row in enumerate(rows):
        for t in range(terms.first[row], terms.first[row + 1]):
            term_slope(*arrays.flat, motion.x, motion.R, motion.angle, t, slope)
            for e in range(2):
                start = arrays.start[terms.node[t, e]]
                if start >= 0:
                    found[start : start + 6, k] += terms.coefficient[t] * slope[2 * e : 2 * e + 2].ravel()
    return found


_ROTATIONS = np.arange(3, 6)
"""Positions of the rotations among the unknowns of a node."""


def remove_row_components(arrays: Arrays, size: Any, gradients: Array, loads: Array) -> tuple[Array, Array]:
    """Remove from `loads` (unknowns, k) their components along the `gradients` (unknowns, r) of held rows.

    Returns the rest, and the coefficients (r, k) of what was removed. Rows carry their part without motion; the rest of a
    load along a held direction is exactly zero.
    arrays: define the order of the unknowns; size [m]: of the mechanism. All may have a leading axis over states.
    """
    start, size, unknowns = arrays.start, np.asarray(size), arrays.plan.unknowns
    scale = np.ones((*size.shape, unknowns, 1))
    scale[..., start[start >= 0, None] + _ROTATIONS, 0] = size[..., None, None]
    # rows depend on the motions of few nodes
    own = np.flatnonzero(gradients.any(axis=-1).reshape(-1, unknowns).any(axis=0))
    A, left = (gradients / scale)[..., own, :], loads / scale
    norm = np.sqrt((A * A).sum(axis=-2, keepdims=True))
    norm[norm == 0.0] = 1.0
    A = A / norm
    inverse = A.swapaxes(-1, -2) if A.shape[-1] == 1 else np.linalg.pinv(A, rcond=ROW_SHARE_TOLERANCE)
    share = inverse @ left[..., own, :]
    least = ROW_SHARE_TOLERANCE**2 * (left * left).sum(axis=-2, keepdims=True)
    left[..., own, :] -= A @ share
    none = (left * left).sum(axis=-2, keepdims=True) <= least
    return np.where(none, 0.0, left) * scale, share / norm.swapaxes(-1, -2)


class BatchResponse(NamedTuple):
    """Linear responses of D states.

    values (D, k, unknowns); valid (D,): the tangent is regular and the backward error acceptable, see `Tangent.solve`;
    stable (D,): the state is at a stable equilibrium with drives and supports fixed.
    """

    values: Array
    valid: NDArray[np.bool_]
    stable: NDArray[np.bool_]


def batch_responses(states: StateBatch, loads: Array) -> BatchResponse:
    """Responses of D states to `loads` (D, k, unknowns), all drives held."""
    topology, values, rows = states.topology, np.empty(loads.shape), states.topology.terms.start
    work, (valid, stable) = make_workspace(topology), np.zeros((2, len(loads)), bool)
    plan, stored, held = topology.plan.ints, np.empty_like(work.matrix), np.zeros(len(rows))
    step = np.full((len(loads), topology.plan.unknowns), np.inf)
    for d, ((arrays, motion), factor) in enumerate(
        zip(states.states, states.load_factor.tolist(), strict=True)
    ):
        if len(work.weight):
            work.weight[:] = arrays.weight
        _, _, inner_negatives, status = assemble(arrays, motion, held, factor, work)
        stored[:] = work.matrix
        negatives, pivot = factor_blocks(plan, work.matrix, work.scaled_rows, len(topology.plan.size))
        if pivot > SINGULAR_PIVOT:
            error = solve_refined_rows(plan, stored, work.matrix, work.scaled_rows, loads[d], values[d])
            valid[d] = error <= MAX_BACKWARD_ERROR
            stable[d] = status == 0 and negatives + inner_negatives == len(rows)
            work.rhs[rows] = 0.0
            solve_blocks(plan, work.matrix, work.scaled_rows, work.rhs)
            step[d] = work.rhs
    return BatchResponse(values, valid, stable & _is_converged(states, step))


def _is_converged(states: StateBatch, step: Array) -> NDArray[np.bool_]:
    """Whether Newton steps (D, unknowns) are below CONVERGED_STEP (D,)."""
    start, rows = states.topology.start, states.topology.terms.start
    moves = step[:, start[start >= 0, None] + np.arange(6)].reshape(len(step), -1, 2, 3)
    moved, turned = np.sqrt((moves * moves).sum(axis=3).max(axis=1, initial=0.0)).T
    force = np.abs(step[:, rows]).max(axis=1, initial=0.0)
    largest = np.abs(states.motion.multiplier).max(axis=1, initial=0.0)
    return (np.maximum(moved / states.sizes, turned) <= CONVERGED_STEP) & (force <= CONVERGED_STEP * largest)


class SkewBlock(NamedTuple):
    """Skew part of the tangent, from loads that are not conservative: positions (k,) of the unknowns of the loaded nodes and
    matrix (k, k) between them."""

    unknowns: NDArray[np.int64]
    matrix: Array


@dataclass(frozen=True)
class AssembledTangent:
    """Exact tangent of a model at a state, not factored.

    value: in the block storage of the plan; inner_negatives: negative pivots inside the members; skew: None where all loads
    are conservative; work: storage of the assembly, with the residual in `rhs`.
    """

    model: Model
    motion: State
    arrays: Arrays
    value: Array
    inner_negatives: int
    skew: SkewBlock | None
    work: Workspace

    def matrix(self, freed: Iterable[str] = ()) -> Array:
        """Symmetric matrix (unknowns, unknowns) with the drives and supports in `freed` released."""
        value = self.value.copy()
        release_rows(self.arrays, value, row_numbers(self.model, freed))
        return stored_matrix(self.arrays, value)


def check_backward_error(error: float) -> None:
    """Raise KinematicsError where the backward error of a solution exceeds MAX_BACKWARD_ERROR."""
    if not error <= MAX_BACKWARD_ERROR:
        raise KinematicsError(
            f"the tangent is all but singular (a refined solution still changes by {error:.1e} of itself): a motion is left "
            "that hardly anything resists, or the state is at its critical load; hold more drives"
        )


@dataclass(frozen=True)
class Tangent:
    """Factored tangent of a model at a state.

    value, spare: factors in block storage; assembled: the matrix before factorisation, with which every solution is refined;
    unstable: number of directions in which the state is not a minimum; freed: names of the released drives and supports;
    skew: skew part, None where all loads are conservative; free (unknowns, m): motions that the released rows leave without
    stiffness. As many of these rows are held in the factors: a response is complete but for an amount of `free`, and an
    equilibrium where the load does no work on them.
    """

    model: Model
    motion: State
    arrays: Arrays
    assembled: Array
    value: Array
    spare: Array
    unstable: int
    freed: tuple[str, ...] = ()
    skew: SkewBlock | None = None
    free: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def solve(self, loads: Array) -> Array:
        """Response (unknowns, k) to `loads` (unknowns, k), in the order of the plan.

        Raises KinematicsError where the backward error exceeds MAX_BACKWARD_ERROR.
        """
        return self.solve_with_error(loads)[0]

    def solve_with_error(self, loads: Array) -> tuple[Array, float]:
        """Response as in `solve`, and its backward error.

        That is the largest relative change of a solution by its last refinement, in the norm of the diagonal: an estimate
        of the error before that refinement and a bound for the error after it.
        """
        found, error = self._symmetric(loads)
        check_backward_error(error)
        if self.skew is None:
            return found, error
        index, skew = self.skew
        found = self._with_skew(found)
        # one refinement with the complete matrix
        residual = self._residual(loads, found)
        residual[index] -= skew @ found[index]
        change = self._with_skew(self._symmetric(residual)[0])
        weight = self.weight()[:, None]
        changed, total = (np.linalg.norm(part * weight, axis=0) for part in (change, found))
        error = max(error, float(np.max(changed / np.maximum(total, 1e-300), initial=0.0)))
        check_backward_error(error)
        return found + change, error

    def _with_skew(self, found: Array) -> Array:
        """Response of the complete matrix from that of its symmetric part (Sherman, Morrison, Woodbury)."""
        assert self.skew is not None
        index, skew = self.skew
        X, small = self.woodbury
        response: Array = found - X @ np.linalg.solve(small, skew @ found[index])
        return response

    def _symmetric(self, loads: Array) -> tuple[Array, float]:
        """Response of the symmetric part to loads (unknowns, k), and its backward error."""
        plan, right = self.arrays.plan, np.ascontiguousarray(loads.T, dtype=float)
        found = np.empty_like(right)
        error = solve_refined_rows(plan.ints, self.assembled, self.value, self.spare, right, found)
        return found.T, float(error)

    def _residual(self, loads: Array, found: Array) -> Array:
        """Residual (unknowns, k) of the symmetric part."""
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
        """Weights (unknowns,) of the norm of solutions, see `ksd.numerics.blocks.solve_refined`."""
        plan = self.arrays.plan
        own = [self.spare[at : at + n] for at, n in zip(plan.diagonal, plan.size, strict=True)]
        return np.asarray(np.sqrt(np.concatenate(own)))

    def softest(self) -> tuple[Array, float]:
        """Vector (unknowns,) of the smallest eigenvalue of the symmetric part, in magnitude and in the metric of its
        diagonal, and that magnitude, by inverse iteration; the largest motion of a node is positive."""
        weight, size = self.weight(), np.inf
        x = np.random.default_rng(0).normal(size=len(weight)) / weight
        for _ in range(INVERSE_ITERATIONS):
            x = self._symmetric((weight**2 * x / np.linalg.norm(weight * x))[:, None])[0][:, 0]
            size = float(np.linalg.norm(weight * x))
        moving = np.zeros_like(x)
        moving[self.arrays.start[self.arrays.start >= 0, None] + np.arange(6)] = 1.0
        return x * np.sign(x[np.argmax(np.abs(x * self.lengths() * moving))]), 1.0 / size

    def lengths(self) -> Array:
        """Factors (unknowns,) that make motions of nodes lengths: the size of the mechanism for rotations, else 1."""
        start, found = self.arrays.start, np.ones(self.arrays.plan.unknowns)
        found[start[start >= 0, None] + _ROTATIONS] = self.arrays.size
        return found

    @cached_property
    def woodbury(self) -> tuple[Array, Array]:
        """Response X (unknowns, k) of the symmetric part to unit loads on the unknowns of the skew part S, and 1 + S X."""
        assert self.skew is not None
        index, skew = self.skew
        units = np.zeros((self.arrays.plan.unknowns, len(index)))
        units[index, np.arange(len(index))] = 1.0
        X = self._symmetric(units)[0]
        return X, np.eye(len(index)) + skew @ X[index]

    def skew_share(self) -> float:
        """Largest |x* S x| / x* K x over complex x, with S the skew and K the symmetric part.

        K must be positive definite on the null space of the constraint rows.
        """
        if self.skew is None:
            return 0.0
        index, skew = self.skew
        return float(np.abs(np.linalg.eigvals(self.woodbury[0][index] @ skew)).max(initial=0.0))

    def unknowns(self, node: int) -> slice:
        """Positions of the motion (6,) of a node among the unknowns; ground has none."""
        start = int(self.arrays.start[node])
        return slice(start, start + 6)


@dataclass(frozen=True)
class DenseTangent(Tangent):
    """Tangent of a mechanism with members without stiffness in some direction, in which only supports hold them.

    matrix (unknowns, unknowns): factored with pivoting.
    """

    matrix: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def _symmetric(self, loads: Array) -> tuple[Array, float]:
        K, b = self.matrix, np.asarray(loads, float)
        scale = equilibration(K)
        x = solve_scaled(K, b, scale)[0]
        # one refinement, so that directions held by supports have no compliance from rounding
        change = solve_scaled(K, b - K @ x, scale)[0]
        changed, total = (np.linalg.norm(part / scale[:, None], axis=0) for part in (change, x))
        error = float(np.max(changed / np.maximum(total, 1e-300), initial=0.0))
        return np.asarray(x + change), error

    def _residual(self, loads: Array, found: Array) -> Array:
        return np.asarray(loads - self.matrix @ found)

    def weight(self) -> Array:
        return np.asarray(1.0 / equilibration(self.matrix))


@dataclass(frozen=True)
class UnsymmetricTangent(Tangent):
    """Tangent of loads that are not conservative whose symmetric part is all but singular, as under an end moment that turns
    a leaf by half a turn: responses are those of the complete `matrix` (unknowns, unknowns)."""

    matrix: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def solve_with_error(self, loads: Array) -> tuple[Array, float]:
        scale = equilibration(self.matrix)
        K, b = self.matrix * np.outer(scale, scale), scale[:, None] * np.asarray(loads, float)
        factors = lu_factor(K)
        x = lu_solve(factors, b)
        change = lu_solve(factors, b - K @ x)
        changed, total = np.linalg.norm(change, axis=0), np.linalg.norm(x, axis=0)
        error = float(np.max(changed / np.maximum(total, 1e-300), initial=0.0))
        check_backward_error(error)
        return np.asarray(scale[:, None] * (x + change)), error


def assemble_tangent(
    model: Model, motion: State, *, load_factor: float = 1.0, target: Array | None = None
) -> AssembledTangent:
    """Assemble the exact tangent at `motion`, drives held.

    target (c,): values of drives and supports, needed only for the residual.
    """
    arrays = exact_tangent_arrays(model)
    work = make_workspace(arrays)
    held = np.zeros(len(arrays.terms.start)) if target is None else target
    _, _, inner_negatives, _ = assemble(arrays, motion, held, load_factor, work)
    skew = skew_block(arrays, motion, load_factor, work)
    return AssembledTangent(model, motion, arrays, work.matrix.copy(), int(inner_negatives), skew, work)


def skew_block(arrays: Arrays, motion: State, load_factor: float, work: Workspace | None) -> SkewBlock | None:
    """Skew part of the tangent assembled in `work` (without one that of loads on links only); None where all loads are
    conservative."""
    skew = skew_tangent(arrays, motion, load_factor, work)
    if skew is None:
        return None
    index = np.flatnonzero(skew.any(axis=1) | skew.any(axis=0))
    return SkewBlock(index, skew[np.ix_(index, index)])


def factor_tangent(
    assembled: AssembledTangent, freed: Iterable[str] = (), *, free_motions: bool = False
) -> Tangent:
    """Factor a copy of a tangent, with the drives and supports named in `freed` released at constant force.

    free_motions: motions that only those hold are returned in `Tangent.free`, not refused. Raises SceneError for an unknown
    name, KinematicsError where a motion has no stiffness.
    """
    freed = names_of(freed, "freed")
    if assembled.model.has_closed_bodies:
        return _factor_dense(assembled, freed)
    rows = row_numbers(assembled.model, freed)
    found, pivot = factor_released(assembled, freed, rows)
    if free_motions and rows and found.skew is None and not pivot > SURE_PIVOT:
        free, stopped = _free_motions(factor_tangent(assembled), rows)
        if stopped:
            found, pivot = factor_released(assembled, freed, [i for i in rows if i not in stopped])
            found = replace(found, free=free)
    if found.skew is not None and not pivot > SURE_PIVOT:
        matrix = assembled.matrix(freed)
        matrix[np.ix_(found.skew.unknowns, found.skew.unknowns)] += found.skew.matrix
        if solve_scaled(matrix, np.zeros((len(matrix), 1)), equilibration(matrix))[1] > SINGULAR_PIVOT:
            fields = {name: getattr(found, name) for name in Tangent.__dataclass_fields__}
            return UnsymmetricTangent(**fields, matrix=matrix)
    if not pivot > SINGULAR_PIVOT:
        raise KinematicsError(
            f"the tangent is singular (relative pivot {pivot:.1e}): a motion is left that nothing resists, or the "
            "state is exactly at its critical load; hold more drives"
        )
    return found


def factor_released(
    assembled: AssembledTangent, freed: tuple[str, ...] = (), rows: Sequence[int] = ()
) -> tuple[Tangent, float]:
    """Tangent with the constraint rows `rows`, named `freed`, released, and its smallest relative pivot."""
    arrays, value = assembled.arrays, assembled.value.copy()
    spare = np.zeros(len(value))
    release_rows(arrays, value, rows)
    stored = value.copy()
    negatives, pivot = factor_blocks(arrays.plan.ints, value, spare, len(arrays.plan.size))
    unstable = int(negatives + assembled.inner_negatives) - len(arrays.terms.start)
    tangent = Tangent(
        assembled.model, assembled.motion, arrays, stored, value, spare, unstable, freed, assembled.skew
    )
    return tangent, float(pivot)


def _free_motions(held: Tangent, rows: list[int]) -> tuple[Array, list[int]]:
    """Motions (unknowns, m) that the constraint rows `rows` alone hold, and m of these rows that stop them.

    A combination of rows whose motion needs no force is such a motion; each moves one of the rows returned by 1.
    """
    plan, at = held.arrays.plan, held.arrays.terms.start[rows]
    units = np.zeros((plan.unknowns, len(rows)))
    units[at, range(len(rows))] = 1.0
    motion = held.solve(units)
    stiffness = -motion[at]
    motion[held.arrays.terms.start] = 0.0
    # of the nodes, without what cancels between them
    own = np.concatenate(
        [held.assembled[d : d + n * n : n + 1] for d, n in zip(plan.diagonal, plan.size, strict=True)]
    )
    scale = np.sqrt(np.abs(own) @ motion**2)
    scale[scale == 0.0] = 1.0
    share, axes = np.linalg.eigh(0.5 * (stiffness + stiffness.T) / np.outer(scale, scale))
    free = axes[:, np.abs(share) <= FREE_SHARE] / scale[:, None]
    if not free.size:
        return motion[:, :0], []
    stopped = np.sort(qr(free.T * scale, mode="r", pivoting=True)[1][: free.shape[1]])
    return motion @ free @ np.linalg.inv(free[stopped]), [rows[i] for i in stopped]


def _factor_dense(assembled: AssembledTangent, freed: tuple[str, ...]) -> Tangent:
    """`factor_tangent` with pivoting: a solid meshed in 2D has zeros on its diagonal, which block pivots do not detect."""
    K, arrays = assembled.matrix(freed), assembled.arrays
    _, condition = solve_scaled(K, np.zeros((len(K), 1)), equilibration(K))
    if not condition > SINGULAR_PIVOT:
        raise KinematicsError(
            f"the tangent is singular (reciprocal condition {condition:.1e}): a motion is left that nothing resists, or the "
            "state is exactly at its critical load; hold more drives, and by supports what a solid meshed in 2D cannot"
        )
    unstable = negative_inertia(K) + assembled.inner_negatives - len(arrays.terms.start)
    return DenseTangent(
        assembled.model, assembled.motion, arrays, assembled.value, assembled.value, assembled.value, unstable,
        freed, assembled.skew, matrix=K,
    )  # fmt: skip


def assemble_and_factor(
    model: Model,
    motion: State,
    *,
    freed: Iterable[str] = (),
    load_factor: float = 1.0,
    free_motions: bool = False,
) -> Tangent:
    """Assemble and factor the exact tangent at `motion`, see `factor_tangent`."""
    freed = names_of(freed, "freed")
    # unknown names are refused before any work is done
    row_numbers(model, freed)
    return factor_tangent(
        assemble_tangent(model, motion, load_factor=load_factor), freed, free_motions=free_motions
    )


def stored_matrix(arrays: Arrays, value: Array) -> Array:
    """Symmetric matrix (unknowns, unknowns) of a block storage `value`."""
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
