"""C entry points of the weight of a leaf in the plane, as `ksd.beam.weight_entry` has for space.

When frame p turns by dphi, gravity g turns in it by -J g dphi, J = [0 -1; 1 0].
"""

from __future__ import annotations

from ksd.beam.weight import PLANAR_PULL
from ksd.numerics.kernel import late

_P = "CPointer(float64)"
_I = "CPointer(int64)"


@late(f"void({_P}, {_P}, float64, {_P}, int64)")
def pull_planar(pose, weight, factor, store, size):
    """Gravity, weight (3,) = mass and acceleration, times `factor` into the pull of a leaf, in its frame p."""
    x, y, o = factor * weight[1], factor * weight[2], size - PLANAR_PULL
    store[o], store[o + 1] = pose[0] * x + pose[1] * y, pose[0] * y - pose[1] * x


@late(f"void(float64, {_P}, int64)")
def turn_planar_pull(turn, store, size):
    """Change of gravity in frame p when node a turns by `turn` (rad), into the pull, for `recover`."""
    o = size - PLANAR_PULL
    store[o + 16], store[o + 17] = store[o + 1] * turn, -store[o] * turn


@late(f"void({_P}, {_I}, {_P}, {_P}, {_P}, int64, float64, {_P})")
def weigh_planar(value, block, pose, end, store, size, mass, force):
    """Weight of a leaf of `mass` [kg] into the stored blocks `block` (4,) of `value` and force (3,) on node a.

    end (3,): pose of end q in frame p.
    """
    o = size - PLANAR_PULL
    c, s, wx, wy, sx, sy = pose[0], pose[1], pose[2], pose[3], pose[4], pose[5]
    g0, g1 = store[o], store[o + 1]
    gx, gy = c * g0 - s * g1, s * g0 + c * g1
    # mass times the lever from node a to end p
    ox, oy = mass * (wx - c * end[0] + s * end[1]), mass * (wy - s * end[0] - c * end[1])
    px, py = ox + c * store[o + 2] - s * store[o + 3], oy + s * store[o + 2] + c * store[o + 3]
    force[0], force[1], force[2] = -mass * gx, -mass * gy, py * gx - px * gy
    px, py = ox + c * store[o + 4] - s * store[o + 5], oy + s * store[o + 4] + c * store[o + 5]
    # V_xi,g and V_g,g times -J g = (g1, -g0), frame p; then the force global
    f0, f1 = store[o + 6] * g1 - store[o + 7] * g0, store[o + 8] * g1 - store[o + 9] * g0
    m = store[o + 10] * g1 - store[o + 11] * g0
    own = g1 * (store[o + 12] * g1 - store[o + 13] * g0) - g0 * (store[o + 14] * g1 - store[o + 15] * g0)
    fx, fy = c * f0 - s * f1, s * f0 + c * f1
    if block[0] >= 0:
        at = block[0]
        value[at + 2] -= fx
        value[at + 5] -= fy
        value[at + 6] -= fx
        value[at + 7] -= fy
        value[at + 8] += px * gx + py * gy + own + 2.0 * (fx * wy - fy * wx - m)
    if block[2] >= 0:
        # rows a, columns b; the transpose when b is the row
        at = block[2]
        to, step = (6, 1) if block[3] == 1 else (2, 3)
        value[at + to] += fx
        value[at + to + step] += fy
        value[at + 8] += sx * fy - sy * fx + m
