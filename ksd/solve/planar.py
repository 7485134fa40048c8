"""The conventional solver in the plane: three unknowns per node, the answer lifted to space and checked there.

The compiled Newton is that of `ksd.solve.newton` on planar arrays. A lifted state is accepted when the spatial
residual across the plane is zero to the solver's tolerance; its inertia is that of the spatial tangent, so buckling
out of the plane is seen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ksd.model.arrays import Motion
from ksd.model.blank import PlanarSystem, blank_planar_system
from ksd.model.planar_assembly import recover_planar
from ksd.model.planar_system import assemble_planar, move_planar, planar_size
from ksd.model.plane import Plane, refuse_plane
from ksd.model.turning import turn_flat_step, turning
from ksd.numerics.blocks import factor_blocks, solve_blocks
from ksd.numerics.held import Kind, address_of, found_at, part
from ksd.numerics.kernel import kernel, late
from ksd.numerics.local import local_vector
from ksd.solve.driving import Driven, drive_to
from ksd.solve.newton import (
    CONVERGED,
    DIVERGED,
    GRAIN,
    LOCAL_ANGLE,
    LOOSE,
    NOT_FINITE,
    SINGULAR,
    TOO_MANY,
)
from ksd.solve.stops import Stop
from ksd.solve.storage import FlatStorage, Newton, Storage, lift_whole, look_over

POLISH = 3
"""Spatial iterations allowed to bring the rounding of a lifted state within the spatial bounds."""


@kernel
def _iterate_planar(address, arrays, motion, target, factor, work, rtol, most, cap, blow_up):
    """See `iterate_planar`; address: of the same arrays."""
    plan, start, rhs = arrays.plan, arrays.start, work.rhs
    blocks = len(plan.size)
    negatives, pivot = 0, 1.0
    worst, moved = math.inf, math.inf
    # a variable, not the literal 0, for which numba would compile twice
    near = 0 * most
    turn = turning(arrays.loads, start) > 0
    # at first the bounds have no grain, so that the smallest load gets its step
    for n in range(most + 1):
        worst, inside, status = assemble_planar(
            arrays, motion, target, factor, work, rtol, GRAIN if n > 0 else 0.0, near
        )
        if not math.isfinite(worst):
            return NOT_FINITE, n, worst, negatives, pivot
        if worst <= 1.0 or (worst <= LOOSE and moved <= 1.0):
            # the inertia belongs to the converged state
            negatives, pivot = factor_blocks(plan, work.value, work.spare, blocks)
            return LOCAL_ANGLE if status == 1 else CONVERGED, n, worst, negatives + inside, pivot
        if n == most:
            break
        if n > 0 and math.isfinite(blow_up):
            s = 0.0
            for i in range(len(rhs)):
                s += rhs[i] * rhs[i]
            if math.sqrt(s) > blow_up:
                return DIVERGED, n, worst, negatives, pivot
        negatives, pivot = factor_blocks(plan, work.value, work.spare, blocks)
        negatives += inside
        for i in range(len(rhs)):
            rhs[i] = -rhs[i]
        solve_blocks(plan, work.value, work.spare, rhs)
        if not pivot > 0.0:
            return SINGULAR, n, worst, negatives, pivot
        if turn:
            turn_flat_step(address, factor)
        shift, largest = planar_size(start, rhs)
        scale = cap / largest if n > 0 and largest > cap else 1.0
        moved = max(largest / 1e-6, shift / (1e-7 * arrays.size))
        recover_planar(arrays.members, start, motion, rhs, work, scale)
        move_planar(start, arrays.terms.start, motion, rhs, scale)
    return TOO_MANY, most, worst, negatives, pivot


_KIND = Kind(blank_planar_system())


@late("void(int64, float64, float64, int64, float64, float64, CPointer(float64))")
def iterate_planar_apart(address, factor, rtol, most, cap, blow_up, out):
    """`iterate_planar` on the `PlanarSystem` at `address`; out (5,) is what it returns."""
    s = found_at(address, _KIND)
    out[0], out[1], out[2], out[3], out[4] = _iterate_planar(
        address, s.arrays, s.motion, s.target, factor, s.work, rtol, most, cap, blow_up
    )


@kernel(needs=("iterate_planar_apart",))
def iterate_planar(arrays, motion, target, factor, work, rtol, most, cap, blow_up):
    """Newton to equilibrium in the plane; arguments, rules and returns are those of `ksd.solve.newton.iterate`."""
    out = local_vector(5)
    at = address_of(PlanarSystem(arrays, motion, target, work), _KIND)
    iterate_planar_apart(at, factor, rtol, most, cap, blow_up, out.ctypes)
    return int(out[0]), int(out[1]), out[2], int(out[3]), out[4]


@kernel(needs=("iterate_planar_apart",))
def solve_flat(held, target, factor, rtol, most, cap, blow_up):
    """`iterate_planar` on the held state."""
    return iterate_planar(
        part(held, "arrays"), part(held, "motion"), target, factor, part(held, "work"), rtol, most, cap, blow_up
    )  # fmt: skip


@kernel(needs=("iterate_planar_apart",))
def solve_and_look(flat, lift, whole, aim, target, factor, rtol, most, cap, blow_up):
    """`solve_flat` at aim (r,) and, where it converged, the state set into space and looked over there at target (c,): one
    compiled call in place of three. Returns what `iterate_planar` and `ksd.solve.storage.look_over` do."""
    reason, count, worst, negatives, pivot = solve_flat(flat, aim, factor, rtol, most, cap, blow_up)
    residual, across, status = math.inf, negatives, 2
    if reason == CONVERGED:
        lift_whole(lift)
        residual, across, status = look_over(whole, target, factor, rtol, 0 * most)
    return reason, count, worst, negatives, pivot, residual, across, status


def _accept(
    storage: Storage, plane: Plane, *, aim: tuple[np.ndarray, float], bound: float, rtol: float
) -> tuple[int, float, int] | str:
    """Spatial check of the lifted state in `storage` at aim = (drive values, load factor).

    Accepted when the residual across the plane is within its bound and the whole one within `bound` times
    its own, as the planar Newton left it. Returns (iterations spent on rounding, residual, negative pivots) or
    a reason.
    """
    model, (target, factor) = storage.model, aim
    residual, negatives, status = storage.look(target, rtol, factor)
    if residual > 1.0:
        share, node, force, moment = plane.imbalance(storage.work)
        if share > 1.0:
            said = (
                f"its leafs and loads do not balance across the plane: {force:.3g} N along its normal and "
                f"{moment:.3g} Nm across it are left on '{model.node_names[node]}'"
            )
            refuse_plane(model, said)
            return said
    if residual <= bound and status == 0:
        return 0, residual, negatives
    reason, count, residual, negatives, _ = storage.newton(target, factor, rtol, POLISH, math.inf, math.inf)
    return (
        (count, residual, negatives) if reason == CONVERGED else "what was found is no equilibrium in space"
    )


def drive_in_plane(storage: Storage, begin: Motion, ways: Mapping[str, Any], fresh: bool) -> Driven | str:
    """`ksd.solve.driving.drive_to` in the plane of the model of `storage`, or the reason why that is not possible.

    begin: the spatial state to start from; fresh: it is that of rest; ways: all options of `drive_to`. The motion of
    `storage` ends at the lifted, checked equilibrium. The residual and the negative pivots are those of the spatial model.
    """
    flat = storage.flat
    if isinstance(flat, str):
        return flat
    plane = flat.plane
    from_here = plane.rest if fresh else plane.flatten(begin)
    if from_here is None:
        return "the configuration to start from is not in the plane"
    flat.motion.assign(from_here)
    start, target, factors, rtol = ways["start"], ways["target"], ways["factors"], ways["rtol"]
    rows, newton = plane.lifting.row, flat.newton
    high = target[rows]
    if ways["steps"] == 1:
        how = high, factors[1], rtol, ways["most"], ways["cap"], ways["eps_max"]
        found, newton = _at_once(storage, flat, target, how)
        if found is not None:
            return found
    ways = {**ways, "start": start[rows], "target": high, "begin": from_here}
    driven = drive_to(flat.motion, newton, **ways)
    flat.lift()
    goal = driven.reached
    aim = start + goal * (target - start), factors[0] + goal * (factors[1] - factors[0])
    bound = max(1.0, 2.0 * driven.residual) if driven.stop is Stop.CONVERGED else LOOSE
    accepted = _accept(storage, plane, aim=aim, bound=bound, rtol=rtol)
    if isinstance(accepted, str):
        return accepted
    if driven.stop is not Stop.CONVERGED:
        return driven
    return driven._replace(solves=driven.solves + accepted[0], residual=accepted[1], negatives=accepted[2])


def _at_once(
    storage: Storage, flat: FlatStorage, target: np.ndarray, aim: tuple[Any, ...]
) -> tuple[Driven | None, Callable[..., Newton]]:
    """The whole way in one step with the look across the plane, aim: as for `FlatStorage.newton`; None where that is not
    all there is to do, and then the Newton that remembers it."""
    *found, residual, across, status = solve_and_look(
        flat.held, flat.lifted_into, storage.held, aim[0], target, *aim[1:]
    )
    reason, count = found[:2]
    if reason == CONVERGED and status == 0 and residual <= 1.0:
        return Driven(Stop.CONVERGED, count, residual, across, 1.0, 1, 0, count), flat.newton
    left = [tuple(found)]

    def newton(*aim: Any) -> Newton:
        return left.pop() if left else flat.newton(*aim)

    return None, newton
