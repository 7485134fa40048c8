"""Signed critical load factors of a loaded state: linearised buckling with all inner unknowns.

(K + mu K') phi = 0. With an added load, K is the exact tangent at the state and K' its derivative along the linear response
to the load, by a central difference over the response of all unknowns, plus the tangent of the load itself. Stresses,
geometry and constraint directions change consistently, so mu times the load is the load to be added, in either direction.
Without an added load all stresses of the state grow together: K is the tangent in the deformed geometry with stresses, drive
forces and loads set to zero, K' the stress stiffness (their difference), and mu = 1 is the state itself. The stresses of
leaves are unknowns in addition to motions and amplitudes: the condensed tangent has poles where a leaf buckles between its
ends, and its derivative underestimates the stiffness.

The tangent is then linear in the stress but for one term, mu^2 K'' phi: stretch and shear of a leaf are measured along its
turned sections, so that an axial force P shears it by P/(GA) per rotation and a column buckles at P (1 + P/(GA) - P/(EA)) =
P_Euler (Haringx 1948; -.05 % at a length of 30 thicknesses, -.4 % at 10, -4.4 % at 3). Factors of the linear problem are
corrected for it one by one, by inverse iteration. Chains, whose stresses follow from their nodes, are without this term; the
stretch of their elements at a factor is its size.

Follower loads, and moments fixed in space, make K and K' unsymmetric. Factors are then the real ones at which the tangent
becomes singular (divergence). A state may flutter before it diverges (Beck's column does, and has no factor), which no
static criterion finds; `ksd.answers.frequencies` does (Bolotin 1963; Ziegler 1968).

The derivative is of first order, valid for small responses. Factors at which the load alone would rotate a link by more than
LINEAR_RANGE, or move it by that fraction of the size, are left out: a fourbar pressed down with its drive released turns by
0.26 rad before the 188 N that chains would give there, and is stable up to 300 N when the load is followed.
`Buckling.linear_up_to` is the factor at that limit; for larger loads, apply the load and solve, or follow it (`ksd.follow`).
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eig
from scipy.sparse import csc_matrix, diags
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs, splu

from ksd.answers.divergence import count_unstable_directions
from ksd.answers.finer_model import finer_state
from ksd.answers.leaf_groups import (
    assemble_blocks,
    inner_unknowns,
    leaf_groups,
)
from ksd.answers.nonconservative import load_tangent
from ksd.answers.printing import PrintableAnswer, describe_motion, format_number, format_table
from ksd.answers.stiffness import node_of, point_motion
from ksd.answers.tangent import (
    MAX_BACKWARD_ERROR,
    Tangent,
    assemble_and_factor,
    assemble_tangent,
    exact_tangent_arrays,
    factor_tangent,
    row_numbers,
)
from ksd.answers.uncondensed import (
    chain_tangent_with_stresses,
    element_stiffnesses,
    leaf_tangents,
    strain_matrix,
    uncondensed_tangents,
)
from ksd.checks import names_of, wrench_of
from ksd.errors import ConvergenceError, SceneError
from ksd.model.arrays import TRANSLATION, State
from ksd.model.compile import Model
from ksd.model.newton import move_nodes

Array = NDArray[np.float64]
MAX_DENSE, MAX_DENSE_FALLBACK = 80, 1000
"""Largest numbers of unknowns for which all eigenvalues are computed: always, and where Arnoldi iteration for the largest
1/mu finds no real ones or the matrices are not symmetric."""
LINEAR_RANGE = 0.1
"""Largest rotation [rad], or displacement relative to the size of the mechanism, of a link for which linear theory is
used."""
MIN_OTHER_SIGN_RATIO = 1e-3
"""Magnitude, relative to the largest 1/mu, below which the largest 1/mu of the other sign is not searched for."""
ENTRY_PERTURBATION = 1e-7
"""Relative perturbation of the entries of unsymmetric matrices, below any mesh error; a 1/mu that it may move to zero is
rejected. A clamped rod does not diverge under a moment, but its matrices have eigenvalues from rounding."""
MAX_MESH_CHANGE = 0.1
"""Relative change by a finer mesh above which a factor of unsymmetric matrices is rejected as an artefact of the mesh: on
every mesh Beck's column has different real factors, but the column has none."""
MESH_ERROR_FACTOR = 0.07
"""Mesh error of a factor, relative to its change by the two highest modes per axis: .03 to .06 in 30 of 32 random mechanisms
with errors above 2e-4, .125 at most."""
MIN_MESH_ERROR = 5e-4
"""Relative mesh error down to which its estimate has been compared with the error."""
SHIFT_OFFSET = 1e-6
"""Relative distance of the shift from a factor in the iteration for its mesh error."""
ROUNDING_CURVATURE = 1e-10
"""Second difference of an entry of the tangent, relative to it, up to which it is rounding."""
MAX_CORRECTIONS = 6
"""Steps of inverse iteration by which a factor of the linear problem is corrected for what is quadratic in the stress."""
SPARE_FACTORS = 2
"""Number of factors corrected besides those that are wanted."""
MIN_LIKENESS = 0.9
"""Cosine between a mode and the same one corrected, below which it is another one."""
MIN_CORRECTION = 1e-9
"""Relative correction of a factor below which the iteration ends."""
ROUNDING_EIGENVALUE = 1e-9
"""Largest 1/mu of a state without stress, from rounding."""


@dataclass(frozen=True, repr=False)
class Buckling(PrintableAnswer):
    """Signed critical load factors, smallest magnitude first: as many as requested, and the smallest of either sign.

    factor (k,): multiple of the load that is added (or factor of all stresses) at the loss of stability; negative: against
    its direction. shape (k, nodes, 6): displacement [m] and rotation [rad] of the nodes of `model`, with largest entry 1;
    all zero where a leaf buckles between ends at rest. vector (k, size): all unknowns, inner ones included. motion: the
    state. mesh_error (k,): estimated relative mesh error of every factor; nan for chains of elements. stretch (k,): largest
    stretch of an element of chains at the factor, by about which it is off; 0 for leaf springs, which know it.
    unstable: number of directions in which the state itself is not a minimum. linear_up_to: largest magnitude of a
    factor for which linear theory is used, inf where all stresses grow. beyond: smallest factor that was left out for
    that, inf where there is none. conservative: False where loads follow their link or moments are fixed in space;
    factors and `unstable` are then those of divergence. backward_error: largest residual of (K + mu K') phi relative to
    its terms; at most 1e-6.
    """

    model: Model
    motion: State
    factor: Array
    shape: Array
    vector: Array
    mesh_error: Array
    stretch: Array
    unstable: int
    linear_up_to: float = np.inf
    beyond: float = np.inf
    conservative: bool = True
    backward_error: float = 0.0

    def _line(self) -> str:
        return ", ".join(format_number(m) for m in self.factor) or self.reason

    @property
    def criterion(self) -> str:
        """Definition of a critical load factor of this state, in one sentence."""
        if self.conservative:
            return (
                "at a critical load factor the symmetric tangent is singular: the state stops being a minimum"
            )
        return (
            "loads that follow their link, or moments fixed in space, are not conservative: at a critical load factor the "
            "unsymmetric tangent is singular (divergence); flutter, which may come first, is not found by a static "
            "criterion (ask frequencies)"
        )

    @property
    def reason(self) -> str:
        """Why there is no critical load factor, in one sentence; empty where there is one."""
        if len(self.factor):
            return ""
        if not np.isfinite(self.linear_up_to):
            return "no critical load factor: linear theory has no real one"
        left_out = f" (it would say {format_number(self.beyond)})" if np.isfinite(self.beyond) else ""
        far = f"a link has moved by {LINEAR_RANGE:g} rad or {100 * LINEAR_RANGE:g} % of the size and linear theory ends"
        upto = f"no critical load factor up to {format_number(self.linear_up_to)}, where {far}{left_out}"
        return f"{upto}; put the load on, or follow it (ksd.follow)"

    def __str__(self) -> str:
        between = "leaf springs between ends that stand still"
        rows = [
            (format_number(m), _format_mesh_error(e), describe_motion(self.model, v) or between)
            for m, e, v in zip(self.factor, self.mesh_error, self.shape, strict=True)
        ]
        count = "1 direction" if self.unstable == 1 else f"{self.unstable} directions"
        what = f"is no minimum, in {count}" if self.conservative else f"diverges, in {count}"
        if not self.conservative and self.unstable % 2 == 0:
            # two real eigenvalues of an unsymmetric matrix may, with the masses, become an oscillating pair
            what = "is left; whether slowly (divergence) or in oscillations (flutter) its frequencies tell"
        bad = [f"The state itself {what}"] * bool(self.unstable)
        bad += [self.criterion[:1].upper() + self.criterion[1:]] * (not self.conservative)
        none = [self.reason[:1].upper() + self.reason[1:]] * bool(self.reason)
        stretch = float(self.stretch[0]) if len(self.stretch) else 0.0
        if stretch >= MIN_MESH_ERROR:
            none.append(
                f"Chains of elements leave out what their stretch does to a factor: about "
                f"{format_number(100.0 * stretch, 1)} % of the first, more of higher ones"
            )
        title = "Critical load factors: times the load is added, or stresses grow, all else held; negative: reversed"
        return format_table(("factor", "mesh error", "<link that moves most"), rows, title, *none, *bad)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the shapes in pictures."""
        return tuple(f"buckling_{k + 1}" for k in range(len(self.factor)))

    def caption(self, row: int) -> str:
        """What a shape is called in pictures: its critical load factor."""
        return f"critical load factor {format_number(float(self.factor[row]), 4)}"

    def moved(self, row: int, size: float) -> State:
        """State of `model` displaced by `size` times the shape `row`, to first order, inner unknowns included."""
        state, nodes = self.motion.copy(), self.model.arrays.plan.unknowns
        inner = size * self.vector[row, nodes:]
        for group in leaf_groups(self.model):
            bends = group.inner_index[:, : group.modes]
            state.inner[bends] += inner[bends]
        move_nodes(self.model.arrays, state, size * self.vector[row, :nodes], 1.0)
        return state

    @property
    def positive(self) -> float:
        """Smallest positive factor; inf where there is none within a thousand times the smallest magnitude of all."""
        return float(min((m for m in self.factor if m > 0.0), default=np.inf))

    @property
    def negative(self) -> float:
        """Negative factor of smallest magnitude; -inf where there is none within a thousand times the smallest of all."""
        return float(max((m for m in self.factor if m < 0.0), default=-np.inf))


def _format_mesh_error(error: float) -> str:
    """Format a relative mesh error in per cent."""
    if np.isnan(error):
        return "-"
    return (
        f"under {100.0 * MIN_MESH_ERROR:g} %"
        if error < MIN_MESH_ERROR
        else f"{format_number(100.0 * error, 1)} %"
    )


class _Pencil(NamedTuple):
    """Matrices K, K' and K'' of (K + mu K' + mu^2 K'') phi = 0, scipy CSC.

    curvature: K''; linear_up_to: factor at which the load moves a link by LINEAR_RANGE; stretch: of the element of
    chains with the largest one, at a factor of 1.
    """

    K: Any
    change: Any
    curvature: Any
    linear_up_to: float
    stretch: float = 0.0

    def in_units(self, unit: Array) -> _Pencil:
        """The same with unknowns in units (n,)."""
        scale = diags(unit)
        K, change, curvature = (
            (scale @ part @ scale).tocsc() for part in (self.K, self.change, self.curvature)
        )
        return self._replace(K=K, change=change, curvature=curvature)

    def about(self, mu: float) -> tuple[Any, Any]:
        """Matrices A, B with A + m B = K + m K' + m^2 K'' to first order about m = mu."""
        return self.K - mu**2 * self.curvature, self.change + 2.0 * mu * self.curvature


def _bending_force(model: Model) -> float:
    """Force [N] that bends the leaf springs of a model by its size; 1 without leaf springs."""
    bending = [leaf.material.E * leaf.section.Iz for leaf in model.scene.leaf_names().values()]
    return float(np.exp(np.mean(np.log(bending)))) / model.arrays.size**2 if bending else 1.0


def _natural_units(model: Model, size: int) -> Array:
    """Units (size,) of the unknowns of a pencil: the size of the mechanism, and the force that bends its leaf springs by it.

    In these units a mechanism and the same one in micrometres have the same matrices, and the same rounding.
    """
    arrays = model.arrays
    length, nodes, force = arrays.size, arrays.plan.unknowns, _bending_force(model)
    unit = np.ones(size)
    unit[arrays.start[arrays.start >= 0, None] + np.arange(3)] = length
    first = arrays.terms.first[:-1]
    unit[arrays.terms.start] = force * np.where(arrays.terms.kind[first] == TRANSLATION, 1.0, length)
    for group in leaf_groups(model):
        unit[nodes + group.inner_index[:, : group.modes]] = 1.0 / length
        unit[nodes + group.inner_index[:, group.modes :]] = force * np.repeat([1.0, length], 3)
    if not leaf_groups(model):
        # stresses of chains are forces
        unit[nodes:] = force
    return unit


def _stress_curvature(
    model: Model, motion: State, inner: Array, load_factor: float, *, weight_grows: bool = False
) -> Any:
    """Half the second derivative of the uncondensed tangent along the change of leaf stresses in `inner`; scipy CSC.

    weight_grows: with the stresses, by as much as it is. Exact, as the tangent is quadratic in them.
    """
    groups = leaf_groups(model)
    # the stresses of chains are no unknowns
    size = model.arrays.plan.unknowns + bool(groups) * len(inner)
    stresses = np.zeros_like(inner)
    for group in groups:
        own = group.inner_index[:, group.modes :]
        stresses[own] = inner[own]
    forces = [np.abs(stresses[group.inner_index[:, group.modes :][:, :3]]).max() for group in groups]
    if not any(forces):
        return csc_matrix((size, size))
    # about the stress at which leaf springs buckle, for the sake of the last digits
    step = 10.0 * _bending_force(model) / max(forces)
    unknowns, blocks, nodes = [], [], model.arrays.plan.unknowns
    for group, own in zip(groups, inner_unknowns(model), strict=True):
        here = leaf_tangents(model, motion, group, load_factor)[0]
        total = -2.0 * here
        for h in (step, -step):
            state = motion._replace(inner=motion.inner + h * stresses)
            total += leaf_tangents(model, state, group, load_factor * (1.0 + h * weight_grows))[0]
        # rounding in entries that do not depend on the stress disturbs a dense eigensolution
        total[np.abs(total) <= ROUNDING_CURVATURE * np.abs(here)] = 0.0
        unknowns.append(np.hstack([own[:, :12], nodes + group.inner_index]))
        blocks.append(total / (2.0 * step**2))
    return assemble_blocks(unknowns, blocks, size).tocsc()


def _tangent_derivative(tangent: Tangent, loads: Array, rows: list[int], load_factor: float) -> _Pencil:
    """K, and K' along the linear response to nodal `loads` (n,).

    The unknowns of chains include stresses where the state has any. Without stress node motions suffice and give the
    classical theory without the deflection before buckling (0.1 % of the load of a strip).
    """
    model, motion = tangent.model, tangent.motion
    arrays = model.arrays
    chains = not model.strain_leaves

    def at_state(state: State) -> Any:
        K = uncondensed_tangents(model, state, rows=rows, load_factor=load_factor)[0]
        return chain_tangent_with_stresses(model, state, K) if chains and motion.inner.any() else K

    K, nodes, n = at_state(motion), tangent.solve(loads[:, None])[:, 0], len(loads)
    # the stresses of chains follow from the motions of their nodes
    inner = np.zeros(len(motion.inner)) if chains else splu(K[n:, n:]).solve(-(K[n:, :n] @ nodes))
    starts = arrays.start[arrays.start >= 0]
    moves = np.abs(nodes[np.add.outer(starts, np.arange(6))]) / ([arrays.size] * 3 + [1.0] * 3)
    step = 1e-5 / max(float(moves.max()), 1e-300)
    tangents = []
    for factor in (step, -step):
        state = motion.copy()
        state.inner[:] += factor * inner
        move_nodes(arrays, state, nodes, factor)
        tangents.append(at_state(state))
    links = arrays.start[: model.links]
    largest = float(moves[np.isin(starts, links[links >= 0])].max(initial=0.0))
    change = (tangents[0] - tangents[1]) / (2 * step)
    linear_up_to = LINEAR_RANGE / max(largest, 1e-300)
    if chains:
        return _Pencil(K, change, csc_matrix(K.shape), linear_up_to, _largest_stretch(model, motion, nodes))
    return _Pencil(K, change, _stress_curvature(model, motion, inner, load_factor), linear_up_to)


def _largest_stretch(model: Model, motion: State, nodes: Array | None) -> float:
    """Largest stretch of an element of chains where the nodes move by `nodes` (n,), or by the own stresses (None)."""
    members = model.arrays.members
    count = len(members.kind)
    if not count:
        return 0.0
    if nodes is None:
        stresses = motion.inner[members.inner_at[1 : count + 1] - 6]
        longer = stresses / element_stiffnesses(model)[:, 0, 0]
    else:
        longer = (strain_matrix(model, motion, len(nodes)) @ nodes)[::6]
    return float(np.abs(longer / members.value[members.value_at[:count]]).max(initial=0.0))


class CriticalFactors(NamedTuple):
    """Real mu of (K + mu K') phi = 0: factor (k,), shape (n, k) of the columns phi; largest_inverse: largest |1/mu|, complex
    ones included; backward_error: largest residual relative to its terms."""

    factor: Array
    shape: Array
    largest_inverse: float
    backward_error: float


def critical_factors(
    K: Any, change: Any, count: int, *, symmetric: bool = True, rounding: float = 0.0
) -> CriticalFactors:
    """Real mu of the `count` smallest magnitudes in (K + mu change) phi = 0, and the smallest of either sign.

    Both matrices are scipy CSC. rounding: largest |1/mu| of a change that is only rounding, for which there are no factors.
    Raises ConvergenceError where they are not found, or where the backward error exceeds MAX_BACKWARD_ERROR.
    """
    size = K.shape[0]
    values, vectors = np.zeros(0), np.zeros((size, 0))
    if not np.any(change.data):
        return CriticalFactors(values, vectors, 0.0, 0.0)
    scale = 1.0 / np.sqrt(abs(K).max(axis=0).toarray().ravel())
    A, B = (csc_matrix(diags(scale) @ part @ diags(scale)) for part in (K, change))
    if size > (MAX_DENSE if symmetric else MAX_DENSE_FALLBACK):
        values, vectors = _arnoldi_pairs(A, B, count)
    if size <= MAX_DENSE_FALLBACK and not np.any(_is_real(values)):
        values, vectors = _dense_pairs(A.toarray(), B.toarray(), symmetric)
    largest = float(np.abs(values).max(initial=0.0))
    if largest <= rounding:
        return CriticalFactors(np.zeros(0), np.zeros((size, 0)), largest, 0.0)
    # a rod that cannot diverge has complex values, and real ones from rounding
    least = 1e-10 if symmetric else MIN_OTHER_SIGN_RATIO
    chosen = np.flatnonzero(_is_real(values) & (np.abs(values) > least * largest))
    chosen = chosen[largest_of_both_signs(values[chosen].real, count)]
    factor, shape = 1.0 / values[chosen].real, vectors[:, chosen].real
    resistance, load = A @ shape, B @ (shape * factor)
    residual, norm = (np.linalg.norm(part, axis=0) for part in (resistance + load, shape))
    terms = np.linalg.norm(A.data) * norm + np.linalg.norm(load, axis=0)
    error = float(np.max(residual / terms, initial=0.0))
    if not error <= MAX_BACKWARD_ERROR:
        raise ConvergenceError(
            "buckling: rounding left no digits of the critical load factors: a motion is left that hardly anything resists; "
            "hold more drives"
        )
    return CriticalFactors(factor, shape * scale[:, None], largest, error)


def _quadratic_factors(
    pencil: _Pencil, count: int, *, symmetric: bool, rounding: float = 0.0
) -> CriticalFactors:
    """`critical_factors` of a pencil, corrected for its curvature; those that it takes away are left out."""
    # the correction may change the order of those that are nearly equal
    found = critical_factors(
        pencil.K, pencil.change, count + SPARE_FACTORS, symmetric=symmetric, rounding=rounding
    )
    factor, shape, kept = found.factor.copy(), found.shape.copy(), np.ones(len(found.factor), bool)
    for i in range(len(factor)):
        left = right = shape[:, i]
        for _ in range(MAX_CORRECTIONS):
            a, b, c = (left @ (part @ right) for part in (pencil.curvature, pencil.change, pencil.K))
            turning = b * b - 4.0 * a * c
            # the root that is -c/b without curvature
            divisor = b + np.copysign(np.sqrt(max(turning, 0.0)), b)
            kept[i] = turning >= 0.0 and divisor != 0.0
            if not kept[i]:
                break
            last, factor[i] = factor[i], -2.0 * c / divisor
            if abs(factor[i] - last) <= MIN_CORRECTION * abs(last):
                break
            A, B = pencil.about(factor[i])
            inverse = splu((A + factor[i] * (1.0 + SHIFT_OFFSET) * B).tocsc())
            better = inverse.solve(B @ right)
            alike = abs(better @ right) / (np.linalg.norm(better) * np.linalg.norm(right))
            if alike < MIN_LIKENESS:
                # another mode of nearly the same factor: this one is as good as it gets
                break
            right = better / np.abs(better).max()
            left = right if symmetric else inverse.solve(B.T @ left, trans="T")
            left = left / np.abs(left).max()
        shape[:, i] = right
    order = np.flatnonzero(kept)
    order = order[largest_of_both_signs(1.0 / factor[order], count)]
    return CriticalFactors(factor[order], shape[:, order], found.largest_inverse, found.backward_error)


def largest_of_both_signs(values: Array, count: int) -> NDArray[np.intp]:
    """Indices of the `count` values 1/mu of largest magnitude, and of the largest of either sign.

    The latter are at least MIN_OTHER_SIGN_RATIO times the largest of all.
    """
    order = np.argsort(-np.abs(values))
    sizes = np.abs(values[order])
    most = sizes.max(initial=0.0)
    taken = (np.arange(len(order)) < count) & (sizes > 1e-10 * most)
    for sign in (1.0, -1.0):
        side = np.flatnonzero((sign * values[order] > 0.0) & (sizes > MIN_OTHER_SIGN_RATIO * most))
        taken[side[:1]] = True
    return order[taken]


def _dense_pairs(A: Array, B: Array, symmetric: bool) -> tuple[Array, Array]:
    """All 1/mu and vectors; of unsymmetric matrices without real ones that ENTRY_PERTURBATION may move to zero."""
    P = -np.linalg.solve(A, B)
    # entries from rounding disturb the balancing inside eig, and vectors lose half of their digits
    P[np.abs(P) < 1e-18 * np.abs(P).max()] = 0.0
    if symmetric:
        values, vectors = eig(P)
        return values, vectors
    values, left, vectors = eig(P, left=True)
    sensitivity, size = np.abs(np.linalg.solve(A.T, left.conj())), np.abs(vectors)
    change = np.sum(sensitivity * (np.abs(B) @ size + np.abs(values) * (np.abs(A) @ size)), axis=0)
    is_certain = ENTRY_PERTURBATION * change < np.abs(values) * np.abs(np.sum(left.conj() * vectors, axis=0))
    is_certain |= ~_is_real(values)
    return values[is_certain], vectors[:, is_certain]


def _arnoldi_pairs(A: Any, B: Any, count: int) -> tuple[Array, Array]:
    """The largest 1/mu with vectors, and the largest of the other sign where the real ones all have one sign.

    None where the iteration does not converge and all can be computed instead. Raises ConvergenceError where there are too
    many unknowns for that.
    """
    size = A.shape[0]
    try:
        values, vectors = _nearest_factors(A, B, 0.0, min(2 * count + 4, size - 2))
    except ArpackNoConvergence as reason:
        if size <= MAX_DENSE_FALLBACK:
            return np.zeros(0), np.zeros((size, 0))
        raise ConvergenceError(
            f"buckling: the smallest critical load factors of {size} unknowns were not found; give fewer elements per leaf"
        ) from reason
    real = values[_is_real(values)].real
    if not len(real) or real.max() * real.min() < 0.0:
        return 1.0 / values, vectors
    smallest = real[np.argmin(np.abs(real))]
    for ratio in (-20.0, -0.5 / MIN_OTHER_SIGN_RATIO):
        # none is missed: there is no factor nearer to the shift than the one found
        shift, best = ratio * smallest, np.inf * smallest
        with contextlib.suppress(ArpackNoConvergence):
            while True:
                near, shapes = _nearest_factors(A, B, shift, 2)
                k = int(np.argmin(np.abs(near - shift)))
                if (
                    not _is_real(near[k])
                    or near[k].real * smallest > 0.0
                    or abs(near[k]) >= 0.999 * abs(best)
                ):
                    break
                best = near[k].real
                values, vectors = np.append(values, best), np.column_stack([vectors, shapes[:, k]])
                shift = 0.5 * best
        if np.isfinite(best):
            break
    return 1.0 / values, vectors


def _nearest_factors(A: Any, B: Any, shift: float, count: int) -> tuple[Array, Array]:
    """The `count` mu nearest to a shift of (A + mu B) phi = 0, with vectors; sparse matrices."""
    factor, size = splu(A + shift * B), A.shape[0]
    operator = LinearOperator(A.shape, matvec=lambda x: -factor.solve(B @ x), dtype=float)
    start = np.random.default_rng(0).normal(size=size)
    values, vectors = eigs(operator, k=count, which="LM", v0=start, tol=1e-9, maxiter=20 if shift else None)
    return shift + 1.0 / values, vectors


def _is_real(values: Array) -> Any:
    """Whether values are real up to rounding."""
    return np.abs(values.imag) <= 1e-6 * np.abs(values)


def _added_load(
    tangent: Tangent, link: Any, at: Any, wrench: tuple[Any, Any], following: bool
) -> tuple[Array, Array]:
    """Nodal loads (n,) of a force and a moment on a point of a link, and their tangent (6, 6) in the motion of its node."""
    model, motion = tangent.model, tangent.motion
    node = node_of(model, link)
    load = wrench_of(*wrench, f"buckling load on '{link}'")
    point, B = point_motion(model, motion, node, at)
    loads = np.zeros(model.arrays.plan.unknowns)
    loads[tangent.unknowns(node)] = B.T @ load
    return loads, load_tangent(load[:3], load[3:], point - motion.x[node], following=following)


def _buckling_matrices(
    tangent: Tangent, load: tuple[Any, Any, tuple[Any, Any], bool] | None, load_factor: float
) -> _Pencil:
    """K and K' at the state of a tangent, in natural units.

    load: link, point, (force, moment), and whether they follow the link; None: all stresses grow.
    """
    model, state, rows = tangent.model, tangent.motion, row_numbers(tangent.model, tangent.freed)
    exact = replace(model, arrays=exact_tangent_arrays(model))
    if load is None:
        stressed, K = uncondensed_tangents(exact, state, rows=rows, load_factor=load_factor)
        curvature = _stress_curvature(exact, state, state.inner, load_factor, weight_grows=True)
        stretch = 0.0 if model.strain_leaves else _largest_stretch(exact, state, None)
        return _Pencil(K, stressed - K - curvature, curvature, np.inf, stretch).in_units(
            _natural_units(model, K.shape[0])
        )
    loads, load_tangent_block = _added_load(tangent, *load)
    pencil = _tangent_derivative(replace(tangent, model=exact), loads, rows, load_factor)
    start, size = tangent.unknowns(node_of(model, load[0])).start, pencil.K.shape[0]
    own_change = assemble_blocks([start + np.arange(6)[None]], [load_tangent_block[None]], size)
    return pencil._replace(change=pencil.change + own_change).in_units(_natural_units(model, size))


def twice_finer_state(model: Model, motion: State, load_factor: float = 1.0) -> tuple[Model, State]:
    """The model with two more modes per axis, or all nodes of chains, and its equilibrium near the state.

    A leaf spring that buckles between its ends has more waves than one that is bent: with one more mode the smallest factor
    of one mechanism in thirty is 2 % too high, and 7 % in the worst; with two more modes .4 and .7 %.
    """
    for _ in range(2):
        model, motion = finer_state(model, motion, load_factor=load_factor)
    return model, motion


def _mesh_error(model: Model, pencil: _Pencil, factor: Array, vectors: Array) -> Array:
    """Relative mesh error of every factor, MESH_ERROR_FACTOR times its change without the two highest modes per axis.

    Two modes, as a single one may have the other symmetry. The factor without them is found by one step of Rayleigh quotient
    iteration from its mode.
    """
    members = model.arrays.members
    ends = members.inner_at[:-1, None] + np.cumsum(members.number[:, :3], axis=1)
    highest = model.arrays.plan.unknowns + np.concatenate([ends - 1, ends - 2])
    keep = np.setdiff1d(np.arange(len(vectors)), highest)
    found = np.empty(len(factor))
    for i, (mu, shape) in enumerate(zip(factor, vectors[keep].T, strict=True)):
        A, B = (part.tocsc()[:, keep][keep] for part in pencil.about(mu))
        # the shift differs from mu, at which the matrix is singular where the highest modes do not contribute
        step = splu(A + mu * (1.0 + SHIFT_OFFSET) * B).solve(B @ shape)
        found[i] = -(step @ (A @ step)) / (step @ (B @ step))
    return MESH_ERROR_FACTOR * np.abs(found / factor - 1.0)


def buckling(
    model: Model,
    motion: State,
    link: Any = None,
    *,
    at: Any = None,
    force: Any = (0.0, 0.0, 0.0),
    moment: Any = (0.0, 0.0, 0.0),
    following: bool = False,
    count: int = 4,
    freed: Iterable[str] = (),
    load_factor: float = 1.0,
) -> Buckling:
    """Critical load factors of a load added to the state at `motion`, or of its own stresses where no link is given.

    link: link (or internal block) on which the force (3,) [N] and moment (3,) [Nm], global, act, at the point that is at
    `at` (3,) [m] at rest (reference point where None). following: they turn with the link, otherwise they are fixed in
    space. freed: drives and supports released at their present force, which they keep, as do the loads of the scene, while
    the added load grows. Factors beyond `Buckling.linear_up_to` are left out. Raises SceneError for unknown names, a zero
    load, or a state without stress, ConvergenceError where factors are not found.
    """
    freed = names_of(freed, "freed")
    fine, state = twice_finer_state(model, motion, load_factor)
    load = None if link is None else (link, at, (force, moment), following)
    assembled = assemble_tangent(fine, state, load_factor=load_factor)
    tangent = factor_tangent(assembled, freed)
    conservative = tangent.skew is None and not following and not np.any(moment)
    pencil = _buckling_matrices(tangent, load, load_factor)
    linear_up_to = pencil.linear_up_to
    if conservative:
        pencil = pencil._replace(change=0.5 * (pencil.change + pencil.change.T))
    rounding = ROUNDING_EIGENVALUE if link is None else 0.0
    factor, vectors, largest, error = _quadratic_factors(
        pencil, count, symmetric=conservative, rounding=rounding
    )
    if link is None and largest <= rounding:
        raise SceneError("this state carries no stress, so nothing buckles; name a link and a load")
    mesh_error = np.full(len(factor), np.nan)
    if conservative and fine.strain_leaves:
        mesh_error = _mesh_error(fine, pencil, factor, vectors)
    elif len(factor):
        finer, finer_motion = twice_finer_state(fine, state, load_factor)
        if finer is not fine:
            again = assemble_and_factor(finer, finer_motion, freed=freed, load_factor=load_factor)
            found = _quadratic_factors(
                _buckling_matrices(again, load, load_factor), 3 * count, symmetric=False
            ).factor
            mesh_error = np.abs(np.divide.outer(found, factor) - 1.0).min(axis=0, initial=np.inf)
            kept = mesh_error < MAX_MESH_CHANGE
            factor, vectors, mesh_error = factor[kept], vectors[:, kept], mesh_error[kept]
    vectors = _natural_units(fine, pencil.K.shape[0])[:, None] * vectors
    within = np.abs(factor) <= linear_up_to
    beyond = float(min(factor[~within], key=abs, default=np.inf))
    factor, vectors, mesh_error = factor[within], vectors[:, within], mesh_error[within]
    stretch = pencil.stretch * np.abs(factor)
    shape = np.zeros((len(factor), len(fine.node_names), 6))
    for k in range(1, len(fine.node_names)):
        shape[:, k] = vectors[tangent.unknowns(k)].T
    shape /= np.maximum(np.abs(shape).max(axis=(1, 2), initial=0.0), 1e-300)[:, None, None]
    rows = len(fine.arrays.terms.start)
    unstable = (
        count_unstable_directions(model, motion, load_factor, tangent.unstable + rows, freed=freed) - rows
    )
    return Buckling(
        fine,
        state,
        factor,
        shape,
        vectors.T,
        mesh_error,
        stretch,
        unstable,
        linear_up_to,
        beyond,
        conservative,
        error,
    )
