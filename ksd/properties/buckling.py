"""Critical load factors of a loaded state, signed: linearised buckling with all inner unknowns kept.

(K + mu K') phi = 0. With an added load, K is the exact tangent at the state and K' its derivative along the linear response
to the load, by a central difference over the response of all unknowns, plus the tangent of the load itself: stresses,
geometry and constraint directions change as they really do, so mu times the load is the load to be added, in either
direction. Without one, all stresses of the state grow together: K is the tangent with stresses, drive forces and loads set
to zero in the deformed geometry, K' the stress stiffness (their difference), and mu = 1 is the state itself. Leaves enter
with their stresses as unknowns beside motions and amplitudes, in which the tangent is linear in the stress: the condensed
one has poles where a leaf buckles between its ends, and its derivative loses stiffness where none is lost.

Loads that follow their link, and moments fixed in space, make K and K' unsymmetric. Factors are then those at which the
tangent becomes singular (divergence), real ones only; a state may flutter before it diverges (Beck's column does, and has no
factor), which no static criterion finds: `ksd.properties.frequencies` does (Bolotin 1963; Ziegler 1968).

The derivative is that of the first order: it says what happens while the response moves little. Factors by which the
load alone would have turned a link by more than FAR, or moved it by that share of the size, are left out, whatever their
value: a fourbar pressed down with its drive let go swings by 0.26 rad before the 188 N that chains would give there, and is
stable up to 300 N when it is followed. `Buckling.reach` tells how far that is; beyond it, put the load on and look, or
follow it (`ksd.follow`).
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.beam.member_tangent import geometric_tangent
from ksd.checks import names_of, wrench_of
from ksd.errors import ConvergenceError, SceneError
from ksd.model.arrays import COIL, STRAIN, TORSION, State, make_workspace
from ksd.model.compile import Model
from ksd.model.loading import twist
from ksd.model.newton import assemble, assemble_nodes, move_nodes
from ksd.properties.finer_model import finer_state
from ksd.properties.leaf_groups import (
    EndFrames,
    LeafGroup,
    assemble_blocks,
    elastic_stiffness,
    end_frames,
    end_jacobians,
    group_parts,
    inner_unknowns,
    leaf_groups,
    leaf_weight,
)
from ksd.properties.nonconservative import count_negative_eigenvalues, load_tangent, skew_tangent
from ksd.properties.printing import PrintableAnswer, describe_motion, format_number, format_table
from ksd.properties.stiffness import node_of, point_motion
from ksd.properties.tangent import (
    MAX_BACKWARD_ERROR,
    Tangent,
    assemble_and_factor,
    assemble_tangent,
    exact_tangent_arrays,
    factor_tangent,
    release_rows,
    row_numbers,
    stored_matrix,
)

Array = NDArray[np.float64]
MAX_DENSE, MAX_DENSE_FALLBACK = 80, 1000
"""Unknowns up to which all eigenvalues are computed; above, those of largest 1/mu by Arnoldi iteration, and up to the second
number all of them where that finds none, or the matrices are not symmetric."""
LINEAR_RANGE = 0.1
"""Rotation [rad], or displacement over the size of the mechanism, of a link beyond which linear theory is not asked."""
MIN_OTHER_SIGN_RATIO = 1e-3
"""Share of the largest 1/mu below which one of the other sign is not looked for."""
ENTRY_PERTURBATION = 1e-7
"""Relative change of the entries of unsymmetric matrices, less than any mesh leaves out, under which a 1/mu is none of the
state: a clamped rod does not diverge under a moment, and its matrices have values of rounding."""
MAX_MESH_CHANGE = 0.1
"""Relative change by one more mode per axis beyond which a factor of unsymmetric matrices is one of the mesh: Beck's column
has real ones, on every mesh others, where it has none."""
MESH_ERROR_FACTOR = 0.07
"""Mesh error of a factor over what its two highest modes per axis change: .03 to .06 in 30 of 32 random mechanisms, .125 at
most, where the error is more than 2e-4."""
MIN_MESH_ERROR = 5e-4
"""Relative mesh error down to which its figure has been compared with the error."""
SHIFT_OFFSET = 1e-6
"""Relative distance of the shift from a factor in the step that tells its mesh error."""
ROUNDING_EIGENVALUE = 1e-9
"""1/mu below which a state carries no stress but rounding."""


@dataclass(frozen=True, repr=False)
class Buckling(PrintableAnswer):
    """Critical load factors, signed, smallest magnitude first: as many as were asked for, and the smallest of either sign.

    factor (k,): how many times the load is to be added (or all stresses multiplied) to the loss of stability; negative:
    against its direction. shape (k, nodes, 6): displacement [m] and rotation [rad] of the nodes of `model`, largest
    entry of each mode 1; all zero where a leaf buckles between ends that stand still. vector (k, size): all
    unknowns, inner ones included. mesh_error (k,): of every factor, relative, estimated; nan for chains of elements.
    unstable: directions in which the state itself is no minimum. reach: factors up to this size are looked for; a larger
    load would move a link too far for linear theory. inf where all stresses grow. beyond: the smallest factor left out for
    that, inf where there is none. conservative: False where loads follow their link, or moments are fixed in space:
    factors and `unstable` are those of divergence then. backward_error: largest residual of (K + mu K') phi over the
    size of its terms; above 1e-6 there is no answer.
    """

    model: Model
    factor: Array
    shape: Array
    vector: Array
    mesh_error: Array
    unstable: int
    reach: float = np.inf
    beyond: float = np.inf
    conservative: bool = True
    backward_error: float = 0.0

    def _line(self) -> str:
        return ", ".join(format_number(m) for m in self.factor) or self.reason

    @property
    def criterion(self) -> str:
        """What a critical load factor is here, in one sentence."""
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
        """Why there is no critical load factor, in one sentence; nothing where there is one."""
        if len(self.factor):
            return ""
        if not np.isfinite(self.reach):
            return "no critical load factor: linear theory has no real one"
        left = f" (it would say {format_number(self.beyond)})" if np.isfinite(self.beyond) else ""
        far = f"a link has moved by {LINEAR_RANGE:g} rad or {100 * LINEAR_RANGE:g} % of the size and linear theory ends"
        upto = f"no critical load factor up to {format_number(self.reach)}, where {far}{left}"
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
            # of two real eigenvalues of an unsymmetric matrix the masses make a pair that oscillates, or not
            what = "is left; whether slowly (divergence) or in oscillations (flutter) its frequencies tell"
        bad = [f"The state itself {what}"] * bool(self.unstable)
        bad += [self.criterion[:1].upper() + self.criterion[1:]] * (not self.conservative)
        none = [self.reason[:1].upper() + self.reason[1:]] * bool(self.reason)
        said = "Critical load factors: times the load is added, or stresses grow, all else held; negative: reversed"
        return format_table(("factor", "mesh error", "<link that moves most"), rows, said, *none, *bad)

    @property
    def positive(self) -> float:
        """Smallest positive factor; inf when there is none within a thousand times the smallest of all."""
        return float(min((m for m in self.factor if m > 0.0), default=np.inf))

    @property
    def negative(self) -> float:
        """Smallest negative factor, in magnitude; -inf when there is none within a thousand times the smallest."""
        return float(max((m for m in self.factor if m < 0.0), default=-np.inf))


def _format_mesh_error(error: float) -> str:
    """A relative mesh error in print."""
    if np.isnan(error):
        return "-"
    return (
        f"under {100.0 * MIN_MESH_ERROR:g} %"
        if error < MIN_MESH_ERROR
        else f"{format_number(100.0 * error, 1)} %"
    )


def uncondensed_tangents(
    model: Model, motion: State, *, rows: Iterable[int] = (), load_factor: float = 1.0
) -> tuple[Any, Any]:
    """Uncondensed tangent, and that with all stresses, drive forces and loads set to zero, scipy CSC: node unknowns and
    multipliers in plan order, then amplitudes and end wrench (a, lam) of leaf springs.

    Symmetric but for what loads add that are not conservative. `rows`: constraint rows taken out. Chains must be unfolded
    (no inner nodes); then they are the node tangents.
    """
    from scipy.sparse import csc_matrix

    arrays, loads = model.arrays, skew_tangent(model.arrays, motion, load_factor)
    if np.any(arrays.members.kind == STRAIN):
        whole = _node_tangent(model, motion, rows, load_factor)
        still = _node_tangent(_with_relaxed_springs(model, motion), _without_forces(motion), rows, 0.0)
    else:
        whole = _chain_tangent(model, motion, rows, load_factor)
        still = _unstressed_chains(model, motion, rows)
    whole = whole if loads is None else whole + loads
    if not np.any(arrays.members.kind == STRAIN):
        return csc_matrix(whole), csc_matrix(still)
    nodes = arrays.plan.unknowns
    every = np.arange(nodes)
    places, blocks = [every[None]], [(whole[None], still[None])]
    for group, unknowns in zip(leaf_groups(model), inner_unknowns(model), strict=True):
        places.append(np.hstack([unknowns[:, :12], nodes + group.inner_index]))
        blocks.append(_leaf_tangents(model, motion, group, load_factor))
    size = nodes + int(arrays.members.inner_at[-1])
    one, other = (assemble_blocks(places, [b[k] for b in blocks], size) for k in range(2))
    return one.tocsc(), other.tocsc()


def _node_tangent(model: Model, motion: State, rows: Iterable[int], load_factor: float) -> Array:
    """What constraint rows, loads and springs add to the tangent of the nodes (unknowns, unknowns); `rows` are taken out."""
    arrays = model.arrays
    work = make_workspace(arrays)
    assemble_nodes(arrays, motion, load_factor, work)
    release_rows(arrays, work.matrix, rows)
    return stored_matrix(arrays, work.matrix)


def _with_relaxed_springs(model: Model, motion: State) -> Model:
    """The model with springs and elastic links that are free of force at `motion`."""
    springs = model.arrays.springs
    if not len(springs.kind):
        return model
    value = springs.value.copy()
    for i, (a, b) in enumerate(springs.node.tolist()):
        here, R = value[springs.value_at[i] :], motion.R
        frame = R[a] @ springs.frame[i, 0]
        ends = [motion.x[n] + R[n] @ springs.offset[i, e] for e, n in enumerate((a, b))]
        d = frame.T @ (ends[1] - ends[0])
        if springs.kind[i] == COIL:
            here[1] = np.linalg.norm(d)
        elif springs.kind[i] == TORSION:
            here[1], _ = twist(R[a], R[b], frame[:, 2].copy(), np.zeros(3), np.zeros(3), np.zeros((3, 3)))
        else:
            # place and rotation at rest, then the wrench there
            here[:3], here[3:12] = d, (frame.T @ R[b] @ springs.frame[i, 1]).ravel()
            here[12:18] = 0.0
    return replace(model, arrays=model.arrays._replace(springs=springs._replace(value=value)))


def _wrench_tangents(motion: State, group: LeafGroup, ends: EndFrames) -> Array:
    """(k, 12, 12): how the end wrench of every leaf turns with its nodes."""
    found = np.zeros((len(group.members), 12, 12))
    wrench = motion.inner[group.inner_index[:, group.modes :]].reshape(-1, 2, 3) @ ends.frame.swapaxes(1, 2)
    for k in range(len(found)):
        geometric_tangent(np.array([*wrench[k], ends.reach[k], ends.arms[k, 1]]), found[k])
    return found


def _without_forces(motion: State) -> State:
    """The same motions, with drive and support forces of zero."""
    return motion._replace(multiplier=np.zeros_like(motion.multiplier))


def _leaf_tangents(model: Model, motion: State, group: LeafGroup, load_factor: float) -> tuple[Array, Array]:
    """Tangents (k, 18 + N, 18 + N) of leaf springs in (motions of both nodes, a, lam), and those without stress."""
    parts, ends = group_parts(model, motion, group, load_factor), end_frames(model, motion, group.members)
    N = group.modes
    still = np.zeros((len(group.members), 18 + N, 18 + N))
    still[:, 12 : 12 + N, 12 : 12 + N] = elastic_stiffness(group)
    still[:, 12 + N :, 12 : 12 + N] = -parts.J
    still[:, 12 + N : 15 + N, 12 + N : 15 + N] = -parts.S
    still[:, 12 + N :, :12] = end_jacobians(ends)[1]
    whole = still.copy()
    whole[:, 12 : 12 + N, 12 : 12 + N] = parts.W
    whole[:, :12, :12] = _wrench_tangents(motion, group, ends)
    weight = leaf_weight(model, motion, group, load_factor)
    if weight is not None:
        jacobian, derivatives = weight.gravity_jacobian, weight.derivatives
        whole[:, 12 : 12 + N, :12] -= derivatives.eta.swapaxes(1, 2) @ jacobian
        whole[:, 12 + N : 15 + N, :12] -= derivatives.B @ jacobian
        whole[:, :12, :12] += weight.node_tangent - jacobian.swapaxes(1, 2) @ derivatives.D @ jacobian
    for block in (whole, still):
        block[:, :12, 12:] = block[:, 12:, :12].swapaxes(1, 2)
        block[:, 12 : 12 + N, 12 + N :] = block[:, 12 + N :, 12 : 12 + N].swapaxes(1, 2)
    return whole, still


def _chain_tangent(model: Model, motion: State, rows: Iterable[int], load_factor: float) -> Array:
    arrays = model.arrays
    work = make_workspace(arrays)
    assemble(arrays, motion, np.zeros(len(arrays.terms.start)), load_factor, work, 1e-8, 0, 10.0)
    release_rows(arrays, work.matrix, rows)
    return stored_matrix(arrays, work.matrix)


def _unstressed_chains(model: Model, motion: State, rows: Iterable[int]) -> Array:
    """Tangent of chains in the same geometry with stresses, drive forces and loads set to zero."""
    members, state = model.arrays.members, _without_forces(motion.copy())
    for i in range(len(members.kind)):
        state.inner[members.inner_at[i + 1] - 6 : members.inner_at[i + 1]] = 0.0
    # with mixed integration points the geometric stiffness follows the stored stresses, which are now zero
    number = members.number.copy()
    number[:, 1] = 1
    model = _with_relaxed_springs(model, motion)
    model = replace(model, arrays=model.arrays._replace(members=members._replace(number=number)))
    return _chain_tangent(model, state, rows, 0.0)


def chain_tangent_with_stresses(model: Model, motion: State, K: Any) -> Any:
    """[K - B^T S B, B^T; B, -S^-1], scipy CSC, from the node tangent K (n, n) of chains with all their nodes in the open:
    that with the stresses of all elements as unknowns beside the motions of their nodes.

    Elimination of the stresses gives back the node tangent. For small changes of the state it is the better behaved of the
    two: the stiff directions of an element turn with it, and of the product B^T S B a derivative keeps one of the two
    factors only, which takes stiffness away where none is lost: a fourbar at mid-stroke then buckles under a quarter of its
    load.
    """
    from scipy.sparse import block_diag, bmat, coo_matrix

    S, rates = _element_stiffnesses(model), _strain_rates(model, motion)
    first = model.arrays.start[model.arrays.members.node]
    columns = np.repeat(first[..., None] + np.arange(6), 6, axis=0).reshape(-1, 12)
    own = np.repeat(np.repeat(first >= 0, 6, axis=1), 6, axis=0)
    at = np.nonzero(own)[0], columns[own]
    B = coo_matrix((rates.reshape(-1, 12)[own], at), shape=(len(own), K.shape[0])).tocsr()
    resisted = B.T @ block_diag(S, format="csr") @ B
    return bmat([[K - resisted, B.T], [B, -block_diag(np.linalg.inv(S))]], format="csc")


def _element_stiffnesses(model: Model) -> Array:
    """S (m, 6, 6) of every element: sigma = S eps (A.13)."""
    members = model.arrays.members
    numbers = np.stack([members.value[at + 1 : at + 7] for at in members.value_at[: len(members.kind)]])
    S = np.zeros((len(numbers), 6, 6))
    S[:, 0, 0], S[:, 1, 1] = numbers[:, 0], numbers[:, 1]
    for k, own, both in ((2, 2, 3), (4, 4, 5)):
        S[:, k, k] = S[:, k + 1, k + 1] = numbers[:, own]
        S[:, k, k + 1] = S[:, k + 1, k] = numbers[:, both]
    return S


def _strain_rates(model: Model, motion: State) -> Array:
    """B (m, 6, 12): strains of every element per motion of its two nodes. Its end wrench is B^T sigma, so unit stresses
    tell its rows."""
    members = model.arrays.members
    number = members.number.copy()
    # geometric forces from the stresses given, not from those of the state
    number[:, 1] = 1
    arrays = replace(model, arrays=model.arrays._replace(members=members._replace(number=number))).arrays
    work, target, state = make_workspace(arrays), np.zeros(len(arrays.terms.start)), motion.copy()
    D = np.empty((len(number), 6, 6))
    for k in range(6):
        state.inner[:] = 0.0
        state.inner[members.inner_at[:-1] + k] = 1.0
        assemble(arrays, state, target, 0.0, work, 1e-8, 0, 10.0)
        D[:, k] = work.lam[: len(number), 6:]
    relative = end_jacobians(end_frames(model, motion, np.arange(len(number))))[1]
    found: Array = D @ relative
    return found


def _tangent_derivative(
    tangent: Tangent, loads: Array, rows: list[int], load_factor: float
) -> tuple[Any, Any, float]:
    """K, K' along the linear response to nodal `loads` (n,), and how many times these move a link FAR.

    In motions and stresses: of chains with theirs where the state has any. Free of stress their node motions alone are
    right, and give the classical theory, without the deflection before buckling (0.1 % of the load of a strip).
    """
    from scipy.sparse.linalg import splu

    model, motion = tangent.model, tangent.motion
    arrays = model.arrays
    chains = not np.any(arrays.members.kind == STRAIN)

    def at_state(state: State) -> Any:
        K = uncondensed_tangents(model, state, rows=rows, load_factor=load_factor)[0]
        return chain_tangent_with_stresses(model, state, K) if chains and motion.inner.any() else K

    K, nodes, n = at_state(motion), tangent.solve(loads[:, None])[:, 0], len(loads)
    # those of chains follow from the motions of their nodes
    inner = np.zeros(len(motion.inner)) if chains else splu(K[n:, n:]).solve(-(K[n:, :n] @ nodes))
    starts = arrays.start[arrays.start >= 0]
    ways = np.abs(nodes[np.add.outer(starts, np.arange(6))]) / ([arrays.size] * 3 + [1.0] * 3)
    size = 1e-5 / max(float(ways.max()), 1e-300)
    both = []
    for step in (size, -size):
        state = motion.copy()
        state.inner[:] += step * inner
        move_nodes(arrays, state, nodes, step)
        both.append(at_state(state))
    links = arrays.start[: model.links]
    far = float(ways[np.isin(starts, links[links >= 0])].max(initial=0.0))
    return K, (both[0] - both[1]) / (2 * size), LINEAR_RANGE / max(far, 1e-300)


def critical_factors(
    K: Any, change: Any, count: int, *, symmetric: bool = True, rounding: float = 0.0
) -> tuple[Array, Array, float, float]:
    """Real mu of smallest magnitude in (K + mu change) phi = 0, and the smallest of either sign, with phi as columns; the
    largest |1/mu|, complex ones too; the largest residual over the size of its terms. Both matrices in scipy CSC. rounding:
    largest |1/mu| of a change that is nothing else, which has none. Raises ConvergenceError where they are not found, or
    their digits are lost."""
    from scipy.sparse import csc_matrix, diags

    size = K.shape[0]
    values, vectors = np.zeros(0), np.zeros((size, 0))
    if not np.any(change.data):
        return values, vectors, 0.0, 0.0
    scale = 1.0 / np.sqrt(abs(K).max(axis=0).toarray().ravel())
    A, B = (csc_matrix(diags(scale) @ part @ diags(scale)) for part in (K, change))
    if size > (MAX_DENSE if symmetric else MAX_DENSE_FALLBACK):
        values, vectors = _arnoldi_pairs(A, B, count)
    if size <= MAX_DENSE_FALLBACK and not np.any(_is_real(values)):
        values, vectors = _dense_pairs(A.toarray(), B.toarray(), symmetric)
    largest = float(np.abs(values).max(initial=0.0))
    if largest <= rounding:
        return np.zeros(0), np.zeros((size, 0)), largest, 0.0
    # a rod that cannot diverge has complex ones, and real ones of rounding
    least = 1e-10 if symmetric else MIN_OTHER_SIGN_RATIO
    chosen = np.flatnonzero(_is_real(values) & (np.abs(values) > least * largest))
    chosen = chosen[largest_of_both_signs(values[chosen].real, count)]
    factor, shape = 1.0 / values[chosen].real, vectors[:, chosen].real
    resisted, pushed = A @ shape, B @ (shape * factor)
    off, whole = (np.linalg.norm(part, axis=0) for part in (resisted + pushed, shape))
    error = np.max(off / (np.linalg.norm(A.data) * whole + np.linalg.norm(pushed, axis=0)), initial=0.0)
    if not error <= MAX_BACKWARD_ERROR:
        raise ConvergenceError(
            "buckling: rounding left no digits of the critical load factors: a motion is left that hardly anything resists; "
            "hold more drives"
        )
    return factor, shape * scale[:, None], largest, float(error)


def largest_of_both_signs(values: Array, count: int) -> NDArray[np.intp]:
    """Numbers of the `count` largest of values = 1/mu in magnitude, and of the largest of either sign that is no less than
    OTHER times the largest of all."""
    order = np.argsort(-np.abs(values))
    sizes = np.abs(values[order])
    most = sizes.max(initial=0.0)
    taken = (np.arange(len(order)) < count) & (sizes > 1e-10 * most)
    for sign in (1.0, -1.0):
        side = np.flatnonzero((sign * values[order] > 0.0) & (sizes > MIN_OTHER_SIGN_RATIO * most))
        taken[side[:1]] = True
    return order[taken]


def _dense_pairs(A: Array, B: Array, symmetric: bool) -> tuple[Array, Array]:
    """All 1/mu and vectors, of unsymmetric matrices without real ones that entries changed by SENSITIVE may move to zero."""
    from scipy.linalg import eig

    P = -np.linalg.solve(A, B)
    # entries of nothing but rounding mislead the balancing inside eig: vectors then lose half of their digits
    P[np.abs(P) < 1e-18 * np.abs(P).max()] = 0.0
    if symmetric:
        values, vectors = eig(P)
        return values, vectors
    values, left, vectors = eig(P, left=True)
    pushed, size = np.abs(np.linalg.solve(A.T, left.conj())), np.abs(vectors)
    moved = np.sum(pushed * (np.abs(B) @ size + np.abs(values) * (np.abs(A) @ size)), axis=0)
    stays = ENTRY_PERTURBATION * moved < np.abs(values) * np.abs(np.sum(left.conj() * vectors, axis=0))
    stays |= ~_is_real(values)
    return values[stays], vectors[:, stays]


def _arnoldi_pairs(A: Any, B: Any, count: int) -> tuple[Array, Array]:
    """The largest 1/mu, and the largest of the other sign where the real ones are all of one; none where the iteration does
    not converge and all can be computed. Raises ConvergenceError where they are too many for that."""
    from scipy.sparse.linalg import ArpackNoConvergence

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
        # nothing is left out: what is nearest to a shift tells how far there is nothing else
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
    """The `count` mu nearest to a shift, with vectors, of (A + mu B) phi = 0, sparse."""
    from scipy.sparse.linalg import LinearOperator, eigs, splu

    factor, size = splu(A + shift * B), A.shape[0]
    operator = LinearOperator(A.shape, matvec=lambda x: -factor.solve(B @ x), dtype=float)
    start = np.random.default_rng(0).normal(size=size)
    values, vectors = eigs(operator, k=count, which="LM", v0=start, tol=1e-9, maxiter=20 if shift else None)
    return shift + 1.0 / values, vectors


def _is_real(values: Array) -> Any:
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
) -> tuple[Any, Any, float]:
    """K and K' of the state of a tangent, and how many times the load moves a link FAR; load: link, point, force and
    moment, whether it follows; None: all stresses grow."""
    model, state, rows = tangent.model, tangent.motion, row_numbers(tangent.model, tangent.freed)
    whole = replace(model, arrays=exact_tangent_arrays(model))
    if load is None:
        stressed, K = uncondensed_tangents(whole, state, rows=rows, load_factor=load_factor)
        return K, stressed - K, np.inf
    added, own = _added_load(tangent, *load)
    K, change, reach = _tangent_derivative(replace(tangent, model=whole), added, rows, load_factor)
    start = tangent.unknowns(node_of(model, load[0])).start
    return K, change + assemble_blocks([start + np.arange(6)[None]], [own[None]], K.shape[0]), reach


def twice_finer_state(model: Model, motion: State, load_factor: float = 1.0) -> tuple[Model, State]:
    """The model with two more modes per axis, or chain nodes in the open, and the equilibrium there next to the state.

    A leaf spring that buckles between its ends has more waves than one that is bent: with one more mode the least factor of
    one mechanism in thirty is 2 % too high, of the worst 7 %, with two .4 and .7 %.
    """
    for _ in range(2):
        model, motion = finer_state(model, motion, load_factor=load_factor)
    return model, motion


def _mesh_error(model: Model, K: Any, change: Any, factor: Array, vectors: Array) -> Array:
    """Relative mesh error of every factor: a share of its change without the two highest modes per axis of strain-mode
    leaves (one more may be of the other symmetry), by one step of Rayleigh's iteration from its mode without them."""
    from scipy.sparse.linalg import splu

    members = model.arrays.members
    ends = members.inner_at[:-1, None] + np.cumsum(members.number[:, :3], axis=1)
    highest = model.arrays.plan.unknowns + np.concatenate([ends - 1, ends - 2])
    keep = np.setdiff1d(np.arange(K.shape[0]), highest)
    A, B = (part.tocsc()[:, keep][keep] for part in (K, change))
    found = np.empty(len(factor))
    for i, (mu, shape) in enumerate(zip(factor, vectors[keep].T, strict=True)):
        # beside it: where the highest modes take no part the matrix at mu itself is singular
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
    """Critical load factors of a load added to the state at `motion`, or of its own stresses when no link is named.

    link: link (or internal block) the force (3,) [N] and moment (3,) [Nm], global, act on, at the point that is at `at`
    (3,) [m] at rest (reference point when None); fixed in space, or turning with the link where `following`. freed: drives
    and supports let go at their present force; they keep that force, as do the loads of the scene, while the added load
    grows. Factors beyond `reach` are left out. Raises SceneError for unknown names, a load that is zero, or a state without
    stress, ConvergenceError where none were found.
    """
    freed = names_of(freed, "freed")
    fine, state = twice_finer_state(model, motion, load_factor)
    load = None if link is None else (link, at, (force, moment), following)
    assembled = assemble_tangent(fine, state, load_factor=load_factor)
    tangent = factor_tangent(assembled, freed)
    conservative = tangent.skew is None and not following and not np.any(moment)
    K, change, reach = _buckling_matrices(tangent, load, load_factor)
    if conservative:
        change = 0.5 * (change + change.T)
    rounding = ROUNDING_EIGENVALUE if link is None else 0.0
    factor, vectors, largest, error = critical_factors(
        K, change, count, symmetric=conservative, rounding=rounding
    )
    if link is None and largest <= rounding:
        raise SceneError("this state carries no stress, so nothing buckles; name a link and a load")
    mesh_error = np.full(len(factor), np.nan)
    if conservative and STRAIN in fine.kinds:
        mesh_error = _mesh_error(fine, K, change, factor, vectors)
    elif len(factor):
        finer, settled = twice_finer_state(fine, state, load_factor)
        if finer is not fine:
            again = assemble_and_factor(finer, settled, freed=freed, load_factor=load_factor)
            found = critical_factors(
                *_buckling_matrices(again, load, load_factor)[:2], 3 * count, symmetric=False
            )[0]
            mesh_error = np.abs(np.divide.outer(found, factor) - 1.0).min(axis=0, initial=np.inf)
            stays = mesh_error < MAX_MESH_CHANGE
            factor, vectors, mesh_error = factor[stays], vectors[:, stays], mesh_error[stays]
    near = np.abs(factor) <= reach
    beyond = float(min(factor[~near], key=abs, default=np.inf))
    factor, vectors, mesh_error = factor[near], vectors[:, near], mesh_error[near]
    shape = np.zeros((len(factor), len(fine.node_names), 6))
    for k in range(1, len(fine.node_names)):
        shape[:, k] = vectors[tangent.unknowns(k)].T
    shape /= np.maximum(np.abs(shape).max(axis=(1, 2), initial=0.0), 1e-300)[:, None, None]
    unstable = tangent.unstable
    loads = skew_tangent(fine.arrays, state, load_factor)
    if loads is not None and unstable:
        rest = len(fine.arrays.terms.start) - assembled.inner_negatives
        unstable = count_negative_eigenvalues(fine.arrays, assembled.matrix(freed), loads) - rest
    return Buckling(fine, factor, shape, vectors.T, mesh_error, unstable, reach, beyond, conservative, error)
