"""One linear system of a mechanism: residual and tangent at a state, the Newton step, and taking it."""

from __future__ import annotations

import math

from ksd.beam.weight_entry import turn_pull
from ksd.model.assembly import add_members, recover_member
from ksd.model.blank import System, blank_system
from ksd.model.loading import add_loads, add_terms
from ksd.model.springs import add_springs
from ksd.numerics.blocks import factor_blocks, solve_blocks
from ksd.numerics.held import Kind, address_of, found_at
from ksd.numerics.kernel import kernel, late
from ksd.numerics.local import local_vector
from ksd.numerics.rotations import straighten, turn

SYSTEM = Kind(blank_system())


@kernel
def _add_effects(arrays, motion, factor, work, rtol, noise):
    """Springs and loads. Returns the status."""
    status = 0
    if len(arrays.springs.kind) > 0:
        status = add_springs(arrays, motion.x, motion.R, work, rtol, noise)
    if len(arrays.loads.node) > 0:
        add_loads(arrays, motion.R, work, factor, rtol)
    return status


@late("void(int64, float64, float64, float64, CPointer(float64))")
def add_effects(address, factor, rtol, noise, out):
    """Springs and loads of the `System` at `address`, which few mechanisms have; out (1,): the status."""
    s = found_at(address, SYSTEM)
    out[0] = _add_effects(s.arrays, s.motion, factor, s.work, rtol, noise)


@kernel
def _assemble(address, arrays, motion, target, factor, work, rtol, near, grain):
    """See `assemble`; address: of the `System` these are."""
    work.value[:] = 0.0
    work.rhs[:] = 0.0
    work.scale[:] = 0.0
    reach, keep = arrays.size, arrays.keep
    for k in range(len(arrays.start)):
        for r in range(3):
            reach = max(reach, abs(motion.x[k, r]))
    noise = grain * 2.220446049250313e-16 * reach
    negatives, worst, status = add_members(
        arrays, motion.x, motion.R, motion.inner, work, factor, rtol, noise, near
    )
    if len(arrays.springs.kind) > 0 or len(arrays.loads.node) > 0:
        out = local_vector(1)
        add_effects(address, factor, rtol, noise, out.ctypes)
        status = max(status, int(out[0]))
    gap = add_terms(arrays, motion.x, motion.R, motion.multiplier, target, work, rtol)
    worst = max(worst, gap / (1e-11 * arrays.size + 2e-15 * reach))
    for k in range(len(arrays.start)):
        u = arrays.start[k]
        if u >= 0:
            f, m = 0.0, 0.0
            for r in range(len(keep)):
                if keep[r] < 3:
                    f += work.rhs[u + r] ** 2
                else:
                    m += work.rhs[u + r] ** 2
            worst = max(
                worst, math.sqrt(f) / (work.scale[k, 0] + 1e-300), math.sqrt(m) / (work.scale[k, 1] + 1e-300)
            )
    if not math.isfinite(worst) or status == 2:
        worst, status = math.inf, 2
    return worst, gap, negatives, status


@late("void(int64, float64, float64, int64, float64, CPointer(float64))")
def assemble_apart(address, factor, rtol, near, grain, out):
    """`assemble` on the `System` at `address`; out (4,) is what it returns."""
    s = found_at(address, SYSTEM)
    out[0], out[1], out[2], out[3] = _assemble(
        address, s.arrays, s.motion, s.target, factor, s.work, rtol, near, grain
    )


@kernel
def assemble(arrays, motion, target, factor, work, rtol, near, grain):
    """Residual and tangent at `motion`. Returns (residual over its bound, largest gap [m], negatives, status).

    grain: how many times the rounding of stiffness times position the bounds include (design section 5: 10 eps).
    """
    out = local_vector(4)
    assemble_apart(
        address_of(System(arrays, motion, target, work), SYSTEM), factor, rtol, near, grain, out.ctypes
    )
    return out[0], out[1], int(out[2]), int(out[3])


@kernel
def solve_step(arrays, work):
    """Factor work.value and turn work.rhs into the Newton step. Returns (negatives, smallest relative pivot)."""
    negatives, pivot = factor_blocks(arrays.plan, work.value, work.spare, len(arrays.plan.size))
    for i in range(len(work.rhs)):
        work.rhs[i] = -work.rhs[i]
    solve_blocks(arrays.plan, work.value, work.spare, work.rhs)
    return negatives, pivot


@kernel
def _largest(arrays, step, first):
    """Largest norm, over the nodes, of the three components from `first` on, as far as they are unknown."""
    largest, keep = 0.0, arrays.keep
    for k in range(len(arrays.start)):
        u = arrays.start[k]
        if u >= 0:
            s = 0.0
            for r in range(len(keep)):
                if first <= keep[r] < first + 3:
                    s += step[u + r] ** 2
            largest = max(largest, s)
    return math.sqrt(largest)


@kernel
def largest_turn(arrays, step):
    """Largest rotation of any node in `step` (n,), rad."""
    return _largest(arrays, step, 3 + 0 * len(step))


@kernel
def largest_move(arrays, step):
    """Largest displacement of any node in `step` (n,), m."""
    # a variable, not the literal 0, for which numba would compile twice
    return _largest(arrays, step, 0 * len(step))


@kernel
def take_step(arrays, motion, step, work, scale):
    """motion <- motion + scale * step (n,): members first (their frames are the old ones), then nodes, multipliers."""
    members, weight, keep = arrays.members, work.weight, arrays.keep
    xi, move = local_vector(6), local_vector(12)
    for i in range(len(members.kind)):
        pose = work.pose[i]
        for e in range(2):
            u = arrays.start[members.node[i, e]]
            for r in range(6):
                move[6 * e + r] = 0.0
            if u >= 0:
                for r in range(len(keep)):
                    move[6 * e + keep[r]] = step[u + r]
        relative_motion(pose, move, xi)
        if len(weight) > 0 and weight[i, 0] > 0.0:
            kept = work.store[members.store_at[i] : members.store_at[i + 1]]
            turn_pull(pose.ctypes, move.ctypes, kept.ctypes, len(kept))
        recover_member(members, motion.inner, work.store, i, xi, scale)
    move_nodes(arrays, motion, step, scale)


@kernel
def relative_motion(pose, move, xi):
    """xi (6,) in frame p from the motion (12,) of nodes a, b: (dxb - dxa + dphib x s - dphia x w, dphib - dphia)."""
    g = local_vector(6)
    for r in range(3):
        j, k = (r + 1) % 3, (r + 2) % 3
        g[r] = (
            move[6 + r] - move[r]
            + move[9 + j] * pose[12 + k] - move[9 + k] * pose[12 + j]
            - move[3 + j] * pose[9 + k] + move[3 + k] * pose[9 + j]
        )  # fmt: skip
        g[3 + r] = move[9 + r] - move[3 + r]
    for r in range(3):
        xi[r] = pose[r] * g[0] + pose[3 + r] * g[1] + pose[6 + r] * g[2]
        xi[3 + r] = pose[r] * g[3] + pose[3 + r] * g[4] + pose[6 + r] * g[5]


@kernel
def move_nodes(arrays, motion, step, scale):
    """Positions, rotations (R <- exp(dphi) R) and multipliers."""
    v, keep = local_vector(6), arrays.keep
    for r in range(6):
        v[r] = 0.0
    for k in range(len(arrays.start)):
        u = arrays.start[k]
        if u >= 0:
            for r in range(len(keep)):
                v[keep[r]] = scale * step[u + r]
            for r in range(3):
                motion.x[k, r] += v[r]
            turn(v[3:], motion.R[k])
            straighten(motion.R[k])
    for i in range(len(motion.multiplier)):
        if arrays.terms.start[i] >= 0:
            motion.multiplier[i] += scale * step[arrays.terms.start[i]]
