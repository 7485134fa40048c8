"""Compiled gaps between bodies that may touch, at given poses: what `ksd.model.complementarity` knows of geometry.

A pair has a gap g >= 0, and a force N >= 0 that opens it: N times the derivative of g by the motions of its bodies acts on
them. `touch` writes both, exactly at the poses given, so that contact forces need no tangent of their own.
"""

from __future__ import annotations

import math

import numpy as np

from ksd.model.loading import twist
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import nearest_turn

LIMIT, CABLE = 0, 1
"""Kinds of pairs: an end stop on a sum of drive terms, and a cable through points of bodies."""
KIND, DATA, PARTS, BODIES, BODY_COUNT, FRICTIONS, PLACES = range(7)
"""Columns of the table of pairs: kind, start of its numbers, number of its parts, start and number of its bodies, and its
numbers of friction forces and of unknown places."""
FRICTION, SOFTNESS, OFFSET, FIRST = range(4)
"""Numbers of every pair: coefficient of friction, softness [m/N], offset of the gap, and where its own numbers begin."""
GAP, TANGENCY, SLIP, PLACE, NORMAL, SLIDE, WRENCH = 0, 1, 3, 5, 8, 11, 14
"""Positions in the output of `touch`: gap [m], distance from tangency (2,), slip (2,) [m] since the last equilibrium,
place (3,) [m], normal (3,), first direction of friction (3,), and wrenches (bodies, 6, 3) of unit forces on every body."""
TERM_SIZE, POINT_SIZE = 14, 4
"""Numbers of a term: coefficient, whether it is a rotation, base, link, direction, points on both, counted angle [rad]; of a
point: body and point in its axes."""


@kernel
def touch(pair, data, bodies, x, R, x_before, R_before, shift, out):
    """Write gap, slip and unit wrenches of a pair into `out`, see GAP to WRENCH.

    pair: its row of the table; bodies: numbers of the bodies of all pairs; x (k, 3), R (k, 3, 3): poses of all bodies, and
    those at the last equilibrium; shift (2,) [m]: of the place on a body where that is unknown.
    """
    out[:] = 0.0
    at, own = pair[DATA] + FIRST, bodies[pair[BODIES] : pair[BODIES] + pair[BODY_COUNT]]
    if pair[KIND] == LIMIT:
        _limit(pair, data, at, own, x, R, out)
    else:
        _cable(pair, data, at, own, x, R, out)
    out[GAP] += data[pair[DATA] + OFFSET]


@kernel
def _limit(pair, data, at, own, x, R, out):
    """An end stop: minus the sum of its terms, which have the sign of the stop in their coefficients."""
    u, arm, q, slope, rel = np.empty(3), np.empty(3), np.empty(3), np.empty((4, 3)), np.empty((3, 3))
    for _ in range(pair[PARTS]):
        a, b = int(data[at + 2]), int(data[at + 3])
        i, j = own[a], own[b]
        for r in range(3):
            u[r], arm[r], slope[2, r] = 0.0, 0.0, x[j, r] - x[i, r]
            base = 0.0
            for c in range(3):
                u[r] += R[i, r, c] * data[at + 4 + c]
                base += R[i, r, c] * data[at + 7 + c]
                arm[r] += R[j, r, c] * data[at + 10 + c]
            slope[2, r] += arm[r]
            slope[3, r] = slope[2, r] - base
        if data[at + 1] == 0.0:
            value = u[0] * slope[3, 0] + u[1] * slope[3, 1] + u[2] * slope[3, 2]
        else:
            value, _ = twist(R[i], R[j], u, q, slope[1], rel)
            value = nearest_turn(value, data[at + 13])
        out[GAP] -= data[at] * value
        for r in range(3):
            k, m = (r + 1) % 3, (r + 2) % 3
            if data[at + 1] == 0.0:
                moment = arm[k] * u[m] - arm[m] * u[k]
                back = u[k] * slope[2, m] - u[m] * slope[2, k]
                out[WRENCH + 18 * b + 3 * r] -= data[at] * u[r]
                out[WRENCH + 18 * a + 3 * r] += data[at] * u[r]
            else:
                moment = slope[1, r]
                back = -moment
            out[WRENCH + 18 * b + 9 + 3 * r] -= data[at] * moment
            out[WRENCH + 18 * a + 9 + 3 * r] -= data[at] * back
        at += TERM_SIZE


@kernel
def _cable(pair, data, at, own, x, R, out):
    """A cable: minus its length through all points; its force is the tension."""
    last, point, arm = np.zeros(3), np.zeros(3), np.zeros((2, 3))
    for p in range(pair[PARTS]):
        b = int(data[at])
        i = own[b]
        for r in range(3):
            arm[0, r], arm[1, r] = arm[1, r], 0.0
            for c in range(3):
                arm[1, r] += R[i, r, c] * data[at + 1 + c]
            last[r], point[r] = point[r], x[i, r] + arm[1, r]
        if p > 0:
            span = math.sqrt(
                (point[0] - last[0]) ** 2 + (point[1] - last[1]) ** 2 + (point[2] - last[2]) ** 2
            )
            out[GAP] -= span
            a, span = int(data[at - POINT_SIZE]), max(span, 1e-300)
            for r in range(3):
                k, m = (r + 1) % 3, (r + 2) % 3
                u, uk, um = (
                    (point[r] - last[r]) / span,
                    (point[k] - last[k]) / span,
                    (point[m] - last[m]) / span,
                )
                out[WRENCH + 18 * b + 3 * r] -= u
                out[WRENCH + 18 * a + 3 * r] += u
                out[WRENCH + 18 * b + 9 + 3 * r] -= arm[1, k] * um - arm[1, m] * uk
                out[WRENCH + 18 * a + 9 + 3 * r] += arm[0, k] * um - arm[0, m] * uk
        at += POINT_SIZE
