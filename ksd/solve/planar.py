"""The conventional solver in the plane: three unknowns per node, the answer lifted to space and checked there.

The compiled Newton is that of `ksd.solve.newton` on planar arrays. A lifted state is accepted when the spatial
residual across the plane is zero to the solver's tolerance; its inertia is that of the spatial tangent, so buckling
out of the plane is seen. Where the mechanism is its own mirror image (`ksd.model.planar_across`) both are seen from the
plane, and space is asked at the first state and at every one twice as far from rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ksd.model.arrays import Motion
from ksd.model.blank import PlanarSystem, blank_planar_system
from ksd.model.planar_across import known_across, note_across, stable_across
from ksd.model.planar_assembly import recover_planar
from ksd.model.planar_lift import spatial_shift
from ksd.model.planar_system import assemble_planar, assemble_planar_apart, move_planar, planar_size
from ksd.model.plane import Plane, refuse_plane
from ksd.model.turning import turn_flat_step, turning
from ksd.numerics.blocks import factor_blocks, solve_blocks
from ksd.numerics.copies import copy_numbers, copy_rows
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
    settled,
)
from ksd.solve.stops import Stop
from ksd.solve.storage import FlatStorage, Newton, Storage, lift_whole, look_over

POLISH = 3
"""Spatial iterations allowed to bring the rounding of a lifted state within the spatial bounds."""


@kernel
def _iterate_planar(address, arrays, motion, factor, work, rtol, most, cap, blow_up):
    """See `iterate_planar`; address: of the same arrays, for assembly, which is compiled apart."""
    plan, start, rhs = arrays.plan, arrays.start, work.rhs
    blocks = len(plan.size)
    negatives, pivot, seen = 0, 1.0, local_vector(3)
    worst, before, moved = math.inf, math.inf, math.inf
    # a variable, not the literal 0, for which numba would compile twice
    near = 0 * most
    turn = turning(arrays.loads, start) > 0
    # at first the bounds have no grain, so that the smallest load gets its step
    for n in range(most + 1):
        assemble_planar_apart(address, factor, rtol, GRAIN if n > 0 else 0.0, near, seen.ctypes)
        worst, inside, status = seen[0], int(seen[1]), int(seen[2])
        if not math.isfinite(worst):
            return NOT_FINITE, n, worst, negatives, pivot
        if settled(worst, before, moved):
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
        before = worst
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
        address, s.arrays, s.motion, factor, s.work, rtol, most, cap, blow_up
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


@kernel
def look_from_plane(flat, whole, mirror, target, factor, rtol, worst, negatives):
    """As `ksd.solve.storage.look_over` on a planar equilibrium that is set into space, its residual `worst` and `negatives`
    as its Newton left them.

    Where a minimum is seen across the plane, and space was asked about a state half as far from rest, that is all.
    """
    across, pose = part(mirror, "across"), part(flat, "motion.pose")
    sound = len(across.times) > 0 and worst <= 1.0 and negatives == len(target)
    if sound:
        sound = stable_across(across, part(flat, "arrays"), part(flat, "motion"), part(flat, "work"), factor)
    if sound and known_across(across, pose):
        return worst, negatives, 0
    residual, found, status = look_over(whole, target, factor, rtol, 0 * negatives)
    if sound and residual <= 1.0 and found == negatives and status == 0:
        note_across(across, pose)
        residual = worst
    return residual, found, status


@kernel
def step_in_plane(flat, lift, mirror, target, links, rtol, force, found):
    """The Newton step of the held planar state, looked at and not taken; it leaves no trace in that.

    force (r,): change of every multiplier; found (4,): largest displacement of a link since rest along an axis, largest
    shift [m] and turn [rad] of one in the step, residual over its bound. Returns (negative pivots, status, 2 where a minimum
    is seen across the plane, so that the step in space has nothing there and its pivots are no more; 1 where space was not
    yet asked about a state so far from rest).
    """
    across, pose = part(mirror, "across"), part(flat, "motion.pose")
    arrays, motion, work = part(flat, "arrays"), part(flat, "motion"), part(flat, "work")
    near = 0 * links
    worst, negatives, status = assemble_planar(arrays, motion, target, 1.0, work, rtol, GRAIN, near)
    sound = 0
    if len(across.times) > 0 and stable_across(across, arrays, motion, work, 1.0):
        sound = 2 if known_across(across, pose) else 1
    inside, _ = factor_blocks(arrays.plan, work.value, work.spare, len(arrays.plan.size))
    rhs, start, row = work.rhs, arrays.start, arrays.terms.start
    for i in range(len(rhs)):
        rhs[i] = -rhs[i]
    solve_blocks(arrays.plan, work.value, work.spare, rhs)
    for i in range(len(row)):
        force[i] = abs(rhs[row[i]])
    rest, axes = part(flat, "rest.pose"), part(lift, "lifting.axes")
    found[0], found[1], found[2], found[3] = 0.0, 0.0, 0.0, worst
    for k in range(1, links):
        u = start[k]
        found[0] = max(found[0], spatial_shift(axes, pose[k, 0] - rest[k, 0], pose[k, 1] - rest[k, 1]))
        found[1] = max(found[1], math.sqrt(rhs[u] ** 2 + rhs[u + 1] ** 2))
        found[2] = max(found[2], abs(rhs[u + 2]))
    return negatives + inside, status, sound


@kernel
def note_plane(flat, mirror):
    """Space was asked about the held planar state, and saw what is seen from the plane."""
    note_across(part(mirror, "across"), part(flat, "motion.pose"))


@kernel
def lift_and_look(flat, lift, whole, mirror, target, factor, rtol, worst, negatives):
    """`look_from_plane` on a planar equilibrium that is set into space here."""
    lift_whole(lift)
    return look_from_plane(flat, whole, mirror, target, factor, rtol, worst, negatives)


@kernel(needs=("iterate_planar_apart",))
def solve_and_look(flat, lift, whole, mirror, fresh, aim, target, factor, rtol, most, cap, blow_up):
    """`solve_flat` at aim (r,), from rest if `fresh` is 1, and, where it converged, the state set into space and looked over
    there at target (c,): one compiled call in place of four. Returns what `iterate_planar` and `look_from_plane` do."""
    if fresh == 1:
        motion, rest, first = part(flat, "motion"), part(flat, "rest"), 0 * most
        copy_rows(motion.pose, rest.pose)
        copy_numbers(motion.inner, first, rest.inner, first)
        copy_numbers(motion.multiplier, first, rest.multiplier, first)
    reason, count, worst, negatives, pivot = solve_flat(flat, aim, factor, rtol, most, cap, blow_up)
    residual, across, status = math.inf, negatives, 2
    if reason == CONVERGED:
        residual, across, status = lift_and_look(
            flat, lift, whole, mirror, target, factor, rtol, worst, negatives
        )
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


def drive_in_plane(
    storage: Storage, flat: FlatStorage, begin: Motion, ways: Mapping[str, Any], fresh: bool
) -> Driven | str:
    """`ksd.solve.driving.drive_to` in the plane `flat` of the model of `storage`, or the reason why that is not possible.

    begin: the spatial state to start from; fresh: it is that of rest; ways: all options of `drive_to`. The motion of
    `storage` ends at the lifted, checked equilibrium. The residual and the negative pivots are those of the spatial model.
    """
    plane = flat.plane
    from_here = plane.rest if fresh else plane.flatten(begin)
    if from_here is None:
        return "the configuration to start from is not in the plane"
    start, target, factors, rtol = ways["start"], ways["target"], ways["factors"], ways["rtol"]
    rows, newton = plane.lifting.row, flat.newton
    high = target[rows]
    if not fresh or ways["steps"] != 1:
        flat.motion.assign(from_here)
    if ways["steps"] == 1:
        how = high, factors[1], rtol, ways["most"], ways["cap"], ways["eps_max"]
        found, newton = _at_once(storage, flat, target, how, fresh=fresh)
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
    storage: Storage, flat: FlatStorage, target: np.ndarray, aim: tuple[Any, ...], *, fresh: bool
) -> tuple[Driven | None, Callable[..., Newton]]:
    """The whole way in one step with the look across the plane, aim: as for `FlatStorage.newton`, fresh: from rest; None
    where that is not all there is to do, and then the Newton that remembers it."""
    reason, count, worst, negatives, pivot, residual, across, status = solve_and_look(
        flat.held, flat.lifted_into, storage.held, flat.across, int(fresh), aim[0], target, *aim[1:]
    )
    if reason == CONVERGED and status == 0 and residual <= 1.0:
        return Driven(Stop.CONVERGED, count, residual, across, 1.0, 1, 0, count), flat.newton
    left = [(reason, count, worst, negatives, pivot)]

    def newton(*aim: Any) -> Newton:
        return left.pop() if left else flat.newton(*aim)

    return None, newton
