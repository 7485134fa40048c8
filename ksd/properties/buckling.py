"""Linearised buckling about a loaded state, with sign, all inner unknowns kept.

(K + mu K') phi = 0. With a load, K is the exact tangent at the state and K' its derivative along the linear
response to the load (central difference of the exact tangent over the response of all unknowns): stresses,
geometry and constraint directions change as they really do, so mu times the load is the load to be added, in
either direction. Without one, all stresses of the state grow together: K is the tangent with stresses, drive
forces and loads set to zero in the deformed geometry, K' the exact stress stiffness (their difference), and
mu = 1 is the state itself. Strain-mode leafs enter with amplitudes and end wrenches as unknowns, in which the
tangent is linear in the stress; the condensed 6x6 would have poles where a leaf buckles between its ends. Chains under
a load enter with their stresses where the state has any (`ksd.properties.chain_tangent`).

The derivative is that of the first order: it says what happens while the response moves little. Factors by which the
load alone would have turned a link by more than FAR, or moved it by that share of the size, are left out, whatever their
value: a fourbar pressed down with its drive let go swings by 0.26 rad before the 188 N that chains would give there, and is
stable up to 300 N when it is followed (strain-mode leafs find no real factor there, and no more do finer chains agree
with coarser ones). `Buckling.reach` tells how far that is; beyond it, put the load on and look, or follow it (`ksd.follow`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.errors import ConvergenceError, SceneError
from ksd.model.arrays import STRAIN, Motion, make_work
from ksd.model.compile import Model
from ksd.model.system import assemble, move_nodes
from ksd.properties.alike import (
    Alike,
    alike_leafs,
    alike_parts,
    end_frames,
    end_levers,
    inner_unknowns,
    weighed,
)
from ksd.properties.chain_tangent import with_stresses
from ksd.properties.opened import Opened
from ksd.properties.stiffness import node_of, point_motion
from ksd.properties.stress_stiffness import (
    corners,
    node_terms,
    outer_of_both_signs,
    own_stress,
    refuse_stressless,
    relaxed,
)
from ksd.properties.tangent import LOST, Tangent, exact, free_rows, row_numbers, stored_matrix
from ksd.properties.words import Shown, listed, movement, number

Array = NDArray[np.float64]
DENSE, MOST_DENSE = 250, 1000
"""Unknowns up to which all eigenvalues are computed; above, the largest ones by Arnoldi iteration, and up to the second
number all of them where that finds none."""
FAR = 0.1
"""Rotation [rad], or displacement over the size of the mechanism, of a link beyond which linear theory is not asked."""


@dataclass(frozen=True, repr=False)
class Buckling(Shown):
    """Critical load factors, signed, smallest magnitude first: as many as were asked for, and the smallest of either sign.

    factor (k,): how many times the load is to be added (or all stresses multiplied) to the loss of stability; negative:
    against its direction. shape (k, nodes, 6): displacement [m] and rotation [rad] of the nodes of `model`, largest
    entry of each mode 1; all zero where a leaf buckles between ends that stand still. vector (k, size): all
    unknowns, inner ones included. unstable: directions in which the state itself is no minimum. reach: factors up to
    this size are looked for; a larger load would move a link too far for linear theory. inf where all stresses grow.
    beyond: the smallest factor left out for that, inf where there is none.
    """

    model: Model
    factor: Array
    shape: Array
    vector: Array
    unstable: int
    reach: float = np.inf
    beyond: float = np.inf

    def _line(self) -> str:
        return ", ".join(number(m) for m in self.factor) or self.reason

    @property
    def reason(self) -> str:
        """Why there is no critical load factor, in one sentence; nothing where there is one."""
        if len(self.factor):
            return ""
        if not np.isfinite(self.reach):
            return "no critical load factor: linear theory has no real one"
        left = f" (it would say {number(self.beyond)})" if np.isfinite(self.beyond) else ""
        far = f"a link has moved by {FAR:g} rad or {100 * FAR:g} % of the size and linear theory ends"
        upto = f"no critical load factor up to {number(self.reach)}, where {far}{left}"
        return f"{upto}; put the load on, or follow it (ksd.follow)"

    def __str__(self) -> str:
        between = "leafs between ends that stand still"
        rows = [
            (number(m), movement(self.model, v) or between)
            for m, v in zip(self.factor, self.shape, strict=True)
        ]
        bad = [f"The state itself is no minimum, in {self.unstable} directions"] * bool(self.unstable)
        none = [self.reason[:1].upper() + self.reason[1:]] * bool(self.reason)
        said = "Critical load factors: times the load is added, or stresses grow, all else held; negative: reversed"
        return listed(("factor", "<link that moves most"), rows, said, *none, *bad)

    @property
    def positive(self) -> float:
        """Smallest positive factor; inf when there is none within a thousand times the smallest of all."""
        return float(min((m for m in self.factor if m > 0.0), default=np.inf))

    @property
    def negative(self) -> float:
        """Smallest negative factor, in magnitude; -inf when there is none within a thousand times the smallest."""
        return float(max((m for m in self.factor if m < 0.0), default=-np.inf))


def full_tangent(
    model: Model, motion: Motion, *, rows: Iterable[int] = (), load_factor: float = 1.0
) -> Array:
    """Uncondensed symmetric tangent: node unknowns and multipliers in plan order, then (a, lam) of every
    leaf.

    `rows`: constraint rows taken out. Chains must be unfolded (no inner nodes); then it is the node tangent.
    """
    arrays = model.arrays
    members = arrays.members
    if not np.any(members.kind == STRAIN):
        work = make_work(arrays)
        assemble(arrays, motion, np.zeros(len(arrays.terms.start)), load_factor, work, 1e-8, 0, 10.0)
        free_rows(arrays, work.value, rows)
        return stored_matrix(arrays, work.value)
    nodes = arrays.plan.unknowns
    size = nodes + int(members.inner_at[-1])
    # one row and column more for what hangs on a fixed node
    K = np.zeros((size + 1, size + 1))
    K[:nodes, :nodes] = node_terms(model, motion, rows, load_factor)
    for group, unknowns in zip(alike_leafs(model), inner_unknowns(model), strict=True):
        at = np.where(unknowns[:, :12] < 0, size, unknowns[:, :12])
        at = np.hstack([at, nodes + group.places])
        np.add.at(K, (at[:, :, None], at[:, None, :]), _leaf_tangents(model, motion, group, load_factor))
    return K[:size, :size]


def _leaf_tangents(model: Model, motion: Motion, group: Alike, load_factor: float) -> Array:
    """Tangents (k, 18 + N, 18 + N) of leafs in (motions of both nodes, a, lam)."""
    parts, ends = alike_parts(model, motion, group, load_factor), end_frames(model, motion, group.members)
    N = group.modes
    relative = end_levers(ends)[1]
    block = np.zeros((len(group.members), 18 + N, 18 + N))
    block[:, :12, :12] = corners(motion, group, ends)
    block[:, 12 : 12 + N, 12 : 12 + N] = parts.W
    block[:, 12 + N :, 12 : 12 + N] = -parts.J
    block[:, 12 : 12 + N, 12 + N :] = -parts.J.swapaxes(1, 2)
    block[:, 12 + N : 15 + N, 12 + N : 15 + N] = -parts.S
    block[:, 12 + N :, :12] = relative
    weight = weighed(model, motion, group, load_factor)
    if weight is not None:
        turn, pull = weight.turn, weight.pull
        block[:, 12 : 12 + N, :12] -= pull.eta.swapaxes(1, 2) @ turn
        block[:, 12 + N : 15 + N, :12] -= pull.B @ turn
        block[:, :12, :12] += weight.corner - turn.swapaxes(1, 2) @ pull.D @ turn
    block[:, :12, 12:] = block[:, 12:, :12].swapaxes(1, 2)
    return block


def _response(tangent: Tangent, loads: Array, load_factor: float) -> tuple[Array, Array]:
    """Linear response of the node unknowns (n,) and of all inner states (flat) to nodal `loads` (n,)."""
    model, motion = tangent.model, tangent.motion
    members = model.arrays.members
    nodes = tangent.solve(loads[:, None])[:, 0]
    inner = np.zeros(len(motion.inner))
    for group in alike_leafs(model):
        parts = alike_parts(model, motion, group, load_factor)
        F = parts.J @ np.linalg.solve(parts.W, parts.J.swapaxes(1, 2))
        F[:, :3, :3] += parts.S
        starts = model.arrays.start[members.node[group.members]]
        moves = np.where(starts[..., None] < 0, 0.0, nodes[np.maximum(starts, 0)[..., None] + np.arange(6)])
        moves = moves.reshape(-1, 12, 1)
        xi = end_levers(end_frames(model, motion, group.members))[1] @ moves
        pushed = np.zeros((len(moves), group.modes, 1))
        weight = weighed(model, motion, group, load_factor)
        if weight is not None:
            turned = weight.turn @ moves
            pushed = weight.pull.eta.swapaxes(1, 2) @ turned
            xi[:, :3] -= weight.pull.B @ turned
            xi -= parts.J @ np.linalg.solve(parts.W, pushed)
        wrench = np.linalg.solve(F, xi)
        bent = np.linalg.solve(parts.W, parts.J.swapaxes(1, 2) @ wrench + pushed)
        inner[group.places] = np.concatenate([bent, wrench], axis=1)[..., 0]
    return nodes, inner


def _moved(model: Model, motion: Motion, response: tuple[Array, Array], size: float) -> Motion:
    """The state after `size` times the response."""
    state = motion.copy()
    state.inner[:] += size * response[1]
    move_nodes(model.arrays, state, response[0], size)
    return state


def _derivative(
    tangent: Tangent, loads: Array, at_state: Callable[[Motion], Array], load_factor: float
) -> tuple[Array, float]:
    """K': derivative of the tangent `at_state` along the response to `loads`, and how many times these move a link FAR."""
    model, motion = tangent.model, tangent.motion
    response = _response(tangent, loads, load_factor)
    free = model.arrays.start[model.arrays.start >= 0]
    reach = max(
        max(
            np.abs(response[0][u : u + 3]).max() / model.arrays.size, np.abs(response[0][u + 3 : u + 6]).max()
        )
        for u in free
    )
    size = 1e-5 / max(reach, 1e-300)

    def tangent_at(step: float) -> Array:
        return at_state(_moved(model, motion, response, step))

    links = response[0][np.add.outer([u for u in model.arrays.start[: model.links] if u >= 0], np.arange(6))]
    links[:, :3] /= model.arrays.size
    far = float(np.abs(links).max(initial=0.0))
    return (tangent_at(size) - tangent_at(-size)) / (2 * size), FAR / max(far, 1e-300)


def _mixed(model: Model, state: Motion, rows: list[int], load_factor: float) -> Callable[[Motion], Array]:
    """The tangent in motions and stresses: `full_tangent`, of chains with theirs where `state` has any.

    Free of stress node motions alone are right, and give the classical theory, without the deflection before buckling
    (0.1 % of the load of a strip).
    """
    plain = bool(np.any(model.arrays.members.kind == STRAIN)) or not state.inner.any()

    def at_state(motion: Motion) -> Array:
        K = full_tangent(model, motion, rows=rows, load_factor=load_factor)
        return K if plain else with_stresses(model, motion, K)

    return at_state


def _exact_model(model: Model) -> Model:
    return replace(model, arrays=exact(model.arrays))


def _unstressed(model: Model, motion: Motion, rows: list[int]) -> Array:
    """Tangent of chains in the same geometry with stresses, drive forces and loads set to zero."""
    members = model.arrays.members
    state = motion.copy()
    state.multiplier[:] = 0.0
    for i in range(len(members.kind)):
        state.inner[members.inner_at[i + 1] - 6 : members.inner_at[i + 1]] = 0.0
    # with mixed integration points the geometric stiffness follows the stored stresses, which are now zero
    number = members.number.copy()
    number[:, 1] = 1
    model = relaxed(model, motion)
    model = replace(model, arrays=model.arrays._replace(members=members._replace(number=number)))
    return full_tangent(model, state, rows=rows, load_factor=0.0)


def _smallest(K: Array, change: Array, count: int) -> tuple[Array, Array]:
    """Real mu of smallest magnitude in (K + mu change) phi = 0, and the smallest of either sign, with phi as columns."""
    from scipy import linalg

    scale = 1.0 / np.sqrt(np.abs(K).max(axis=0))
    A, B = K * np.outer(scale, scale), change * np.outer(scale, scale)
    values, vectors = (np.zeros(0), B[:, :0]) if len(K) <= DENSE else _by_arnoldi(A, B, count)
    if len(K) <= MOST_DENSE and not np.any(_real(values)):
        values, vectors = linalg.eig(-np.linalg.solve(A, B))
    largest = np.abs(values).max(initial=0.0)
    found = np.flatnonzero(_real(values) & (np.abs(values) > 1e-10 * largest))
    found = found[outer_of_both_signs(values[found].real, count)]
    multiplier, shape = 1.0 / values[found].real, vectors[:, found].real
    resisted, pushed = A @ shape, B @ (shape * multiplier)
    off, whole = (np.linalg.norm(part, axis=0) for part in (resisted + pushed, shape))
    if np.any(off > LOST * (np.linalg.norm(A) * whole + np.linalg.norm(pushed, axis=0))):
        raise ConvergenceError(
            "buckling: rounding left no digits of the multipliers: a motion is left that hardly anything resists; hold "
            "more drives"
        )
    return multiplier, shape * scale[:, None]


def _by_arnoldi(A: Array, B: Array, count: int) -> tuple[Array, Array]:
    """The largest 1/mu, and those to the right and left where the real ones are all of one sign; none where the iteration
    does not converge and all can be computed. Raises ConvergenceError where they are too many for that."""
    from scipy.sparse import csc_matrix
    from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs, splu

    factor, sparse = splu(csc_matrix(A)), csc_matrix(B)
    operator = LinearOperator(A.shape, matvec=lambda x: -factor.solve(sparse @ x), dtype=float)
    start = np.random.default_rng(0).normal(size=len(A))
    try:
        values, vectors = eigs(operator, k=min(2 * count + 4, len(A) - 2), which="LM", v0=start, tol=1e-9)
        for sign, end in ((1.0, "LR"), (-1.0, "SR")):
            if not np.any(sign * values[_real(values)].real > 0.0):
                more = eigs(operator, k=2, which=end, v0=start, tol=1e-9)
                values, vectors = (
                    np.concatenate(pair, axis=-1) for pair in zip((values, vectors), more, strict=True)
                )
    except ArpackNoConvergence as reason:
        if len(A) <= MOST_DENSE:
            return np.zeros(0), B[:, :0]
        raise ConvergenceError(
            f"buckling: the smallest critical load factors of {len(A)} unknowns were not found; give fewer elements per leaf"
        ) from reason
    return values, vectors


def _real(values: Array) -> Any:
    return np.abs(values.imag) <= 1e-6 * np.abs(values)


def _loads(tangent: Tangent, link: Any, at: Any, wrench: tuple[Any, Any]) -> Array:
    """Nodal loads (unknowns,) of a force and a moment on a point of a link."""
    model, motion = tangent.model, tangent.motion
    node = node_of(model, link)
    load = np.concatenate([np.asarray(w, float) for w in wrench])
    if load.shape != (6,) or not np.isfinite(load).all() or not load.any():
        raise SceneError(
            f"buckling load on '{link}': give a finite force (3,) or moment (3,) that is not zero"
        )
    loads = np.zeros(model.arrays.plan.unknowns)
    loads[tangent.unknowns(node)] = point_motion(model, motion, node, at)[1].T @ load
    return loads


def _refuse_mixture(model: Model) -> None:
    kinds = set(model.arrays.members.kind.tolist())
    if STRAIN in kinds and len(kinds) > 1:
        raise SceneError(
            "buckling of strain-mode leafs beside chains of elements is not known; give all leafs of the model one mesh"
        )


def buckling(
    model: Model,
    motion: Motion,
    link: Any = None,
    *,
    at: Any = None,
    force: Any = (0.0, 0.0, 0.0),
    moment: Any = (0.0, 0.0, 0.0),
    count: int = 4,
    freed: Iterable[str] = (),
    load_factor: float = 1.0,
    near: Buckling | None = None,
    opened: Opened | None = None,
) -> Buckling:
    """Critical load factors of a dead load added to the state at `motion`, or of its own stresses when no link
    is named.

    link: link (or internal block) the force (3,) [N] and moment (3,) [Nm], global, act on, at the point that
    is at `at` (3,) [m] at rest (reference point when None). freed: drives and supports let go at their
    present force; they keep that force, as do the loads of the scene, while the added load grows. near: factors of
    a state nearby to start from; opened: this state, opened. Factors beyond `reach` are left out. Raises SceneError
    for unknown names, a load that is zero, or a state without stress, ConvergenceError where none were found.
    """
    rows = row_numbers(model, freed)
    _refuse_mixture(model)
    opened = opened or Opened(model, motion, load_factor=load_factor)
    fine, state, tangent, reach = opened.model, opened.motion, opened.tangent(freed), np.inf
    if link is None and np.all(fine.arrays.members.kind == STRAIN):
        start = (near.vector.T,) if near is not None and near.model is fine and len(near.factor) else ()
        factor, vectors = own_stress(opened, rows, count=count, near=start)
    else:
        whole = _exact_model(fine)
        if link is None:
            K = _unstressed(fine, state, rows)
            change = full_tangent(whole, state, rows=rows, load_factor=load_factor) - K
            refuse_stressless(change, K)
        else:
            at_state = _mixed(whole, state, rows, load_factor)
            loads = _loads(tangent, link, at, (force, moment))
            K, (change, reach) = at_state(state), _derivative(tangent, loads, at_state, load_factor)
        factor, vectors = _smallest(K, 0.5 * (change + change.T), count)
    kept = np.abs(factor) <= reach
    beyond = float(min(factor[~kept], key=abs, default=np.inf))
    factor, vectors = factor[kept], vectors[:, kept]
    shape = np.zeros((len(factor), len(fine.node_names), 6))
    for k in range(1, len(fine.node_names)):
        shape[:, k] = vectors[tangent.unknowns(k)].T
    shape /= np.maximum(np.abs(shape).max(axis=(1, 2), initial=0.0), 1e-300)[:, None, None]
    return Buckling(fine, factor, shape, vectors.T, tangent.unstable, reach, beyond)
