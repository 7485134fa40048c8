"""One linear system of a mechanism in its plane: residual and tangent, and taking the Newton step.

The planar twin of `ksd.model.system`; factorisation and solve are the same code, with blocks of three.
"""

from __future__ import annotations

import math

from ksd.model.blank import PlanarSystem, blank_planar_system
from ksd.model.planar_assembly import (
    add_planar_loads,
    add_planar_members,
    add_planar_springs,
    add_planar_terms,
)
from ksd.numerics.held import Kind, address_of, found_at
from ksd.numerics.kernel import kernel, late
from ksd.numerics.local import local_vector


@kernel
def _assemble(arrays, motion, target, factor, work, rtol, grain, near):
    """See `assemble_planar`."""
    start, pose, rhs, scale, turns = arrays.start, motion.pose, work.rhs, work.scale, work.near
    work.value[:] = 0.0
    rhs[:] = 0.0
    scale[:] = 0.0
    reach = arrays.size
    for k in range(len(start)):
        reach = max(reach, abs(pose[k, 0]), abs(pose[k, 1]))
        turns[2 * k], turns[2 * k + 1] = math.cos(pose[k, 2]), math.sin(pose[k, 2])
    noise = grain * 2.220446049250313e-16 * reach
    negatives, worst, status = add_planar_members(
        arrays.members, start, pose, motion.inner, work, factor, rtol, noise, near
    )
    if len(arrays.springs.kind) > 0:
        first = len(arrays.members.kind)
        status = max(status, add_planar_springs(arrays.springs, first, start, pose, work, rtol, noise))
    if len(arrays.loads.node) > 0:
        add_planar_loads(arrays.loads, start, work, factor, rtol)
    gap = add_planar_terms(arrays.terms, start, motion, target, work, arrays.size, rtol)
    worst = max(worst, gap / (1e-11 * arrays.size + 2e-15 * reach))
    for k in range(len(start)):
        u = start[k]
        if u >= 0:
            f, m = math.sqrt(rhs[u] ** 2 + rhs[u + 1] ** 2), abs(rhs[u + 2])
            worst = max(worst, f / (scale[k, 0] + 1e-300), m / (scale[k, 1] + 1e-300))
    return math.inf if status == 2 else worst, negatives, status


_KIND = Kind(blank_planar_system())


@late("void(int64, float64, float64, float64, int64, CPointer(float64))")
def assemble_planar_apart(address, factor, rtol, grain, near, out):
    """`assemble_planar` on the `PlanarSystem` at `address`; out (3,) is what it returns."""
    s = found_at(address, _KIND)
    out[0], out[1], out[2] = _assemble(s.arrays, s.motion, s.target, factor, s.work, rtol, grain, near)


@kernel(needs=("assemble_planar_apart",))
def assemble_planar(arrays, motion, target, factor, work, rtol, grain, near):
    """Residual and tangent at `motion`. Returns (residual over its bound, negatives, status).

    grain: how many times the rounding of stiffness times position the bounds include. near: see `add_planar_members`.
    """
    out = local_vector(3)
    at = address_of(PlanarSystem(arrays, motion, target, work), _KIND)
    assemble_planar_apart(at, factor, rtol, grain, near, out.ctypes)
    return out[0], int(out[1]), int(out[2])


@kernel(inline="always")
def planar_size(start, step):
    """Largest displacement [m] and rotation [rad] of any node in `step` (n,)."""
    moved, turned = 0.0, 0.0
    for k in range(len(start)):
        u = start[k]
        if u >= 0:
            moved = max(moved, step[u] ** 2 + step[u + 1] ** 2)
            turned = max(turned, abs(step[u + 2]))
    return math.sqrt(moved), turned


@kernel(inline="always")
def move_planar(start, rows, motion, step, scale):
    """motion <- motion + scale * step (n,), nodes and multipliers; rows (c,): unknowns of the multipliers."""
    for k in range(len(start)):
        u = start[k]
        if u >= 0:
            for r in range(3):
                motion.pose[k, r] += scale * step[u + r]
    for i in range(len(rows)):
        motion.multiplier[i] += scale * step[rows[i]]
