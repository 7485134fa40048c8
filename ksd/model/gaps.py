"""Compiled gaps between bodies that may touch, at given poses: what `ksd.model.complementarity` knows of geometry.

A pair has a gap g >= 0, and a force N >= 0 that opens it: N times the derivative of g by the motions of its bodies acts on
them. `touch` writes both, exactly at the poses given, so that contact forces need no tangent of their own.
"""

from __future__ import annotations

import math

import numpy as np

from ksd.model.loading import twist
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import nearest_turn, rotation_factors

LIMIT, CABLE, BALL, OVAL = range(4)
"""Kinds of pairs: an end stop on a sum of drive terms, a cable through points of bodies, a ball and any shape, and an
ellipsoid over a wall or strip."""
KIND, DATA, PARTS, BODIES, BODY_COUNT, FRICTIONS = range(6)
"""Columns of the table of pairs: kind, start of its numbers, number of its parts, start and number of its bodies, and its
number of friction forces."""
FRICTION, SOFTNESS, OFFSET, FIRST = range(4)
"""Numbers of every pair: coefficient of friction, softness [m/N], offset of the gap, and where its own numbers begin."""
GAP, SHIFT, SLIP, PLACE, NORMAL, SLIDE, WRENCH = 0, 1, 3, 5, 8, 11, 14
"""Positions in the output of `touch`: gap [m], where on a strip along and across it (2,) [m], slip (2,) [m] since the last
equilibrium, place (3,) [m], normal (3,), first direction of friction (3,), and wrenches (bodies, 6, 3) of unit forces on
every body."""
TERM_SIZE, POINT_SIZE, SURFACE = 14, 4, 18
"""Numbers of a term: coefficient, whether it is a rotation, base, link, direction, points on both, counted angle [rad]; of a
point: body and point in its axes; of a surface without corners."""
ROUNDED, WALL, POLYGON, ELLIPSOID, STRIP = range(5)
"""Shapes: a box rounded by a ball, so also a ball, a capsule or a box; the half space below z = 0; a polygon in x and y; an
ellipsoid, or an ellipse where its last semi-axis is 0; the surface y > 0 of a leaf spring around a section of it."""
SHAPE, SIZES, COUNT, CORNERS = 12, 13, 17, 18
"""Numbers of a surface after its centre (3,) and axes (3, 3) in the axes of its body: shape, four sizes (radius and half
sizes of the box, or semi-axes; of a strip half thickness, its change along the strip, and half width), number of corners,
and these (n, 2), of a strip its curvature (3,) [1/m] in its axes and where it begins and ends from the section [m]."""
STRIP_STEPS = 30
"""Newton steps to the place on a strip."""


@kernel
def touch(pair, data, bodies, x, R, x_before, R_before, out):
    """Write gap, slip and unit wrenches of a pair into `out`, see GAP to WRENCH.

    pair: its row of the table; bodies: numbers of the bodies of all pairs; x (k, 3), R (k, 3, 3): poses of all bodies, and
    those at the last equilibrium.
    """
    out[:] = 0.0
    at, own = pair[DATA] + FIRST, bodies[pair[BODIES] : pair[BODIES] + pair[BODY_COUNT]]
    if pair[KIND] == LIMIT:
        _limit(pair, data, at, own, x, R, out)
    elif pair[KIND] >= BALL:
        _surfaces(pair, data, at, own, x, R, x_before, R_before, out)
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


@kernel
def _frame(data, at, x, R, centre, axes):
    """Centre (3,) [m] and axes (3, 3), columns, of the surface whose numbers begin at `at`, in space."""
    for r in range(3):
        centre[r] = x[r]
        for c in range(3):
            centre[r] += R[r, c] * data[at + c]
            axes[r, c] = 0.0
            for k in range(3):
                axes[r, c] += R[r, k] * data[at + 3 + 3 * k + c]


@kernel
def _surfaces(pair, data, at, own, x, R, x_before, R_before, out):
    """Two surfaces: a ball and any shape, or an ellipsoid over a wall or strip; the normal goes from the first to the
    second."""
    i, j, b = own[0], own[1], at + 3 + SURFACE
    first, second, axes, other = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    local, outward, n = np.empty(3), np.empty(3), np.empty(3)
    _frame(data, at + 3, x[i], R[i], first, axes)
    _frame(data, b, x[j], R[j], second, other)
    if data[b + SHAPE] == STRIP:
        out[GAP] += _strip(data, at + 3, first, axes, b, second, other, n, out)
    elif pair[KIND] == BALL:
        for r in range(3):
            local[r] = 0.0
            for c in range(3):
                local[r] += other[c, r] * (first[c] - second[c])
        radius = data[at + 3 + SIZES]
        out[GAP] += distance(data, b, local, outward) - radius
        for r in range(3):
            n[r] = 0.0
            for c in range(3):
                n[r] -= other[r, c] * outward[c]
        for r in range(3):
            first[r] += radius * n[r]
    else:
        for r in range(3):
            n[r] = -other[r, 2]
        _support(data, at + 3, first, axes, n, first)
        for r in range(3):
            out[GAP] -= n[r] * (first[r] - second[r])
    _contact(i, j, 0, 1, first, n, data, at, x, R, x_before, R_before, out)


@kernel
def _support(data, at, centre, axes, direction, found):
    """The point (3,) of an ellipsoid that is furthest along a direction (3,), into `found`."""
    size, local = 0.0, np.empty(3)
    for c in range(3):
        along = axes[0, c] * direction[0] + axes[1, c] * direction[1] + axes[2, c] * direction[2]
        local[c] = data[at + SIZES + c] ** 2 * along
        size += (data[at + SIZES + c] * along) ** 2
    size = math.sqrt(size)
    for r in range(3):
        found[r] = centre[r] + (axes[r, 0] * local[0] + axes[r, 1] * local[1] + axes[r, 2] * local[2]) / size


@kernel
def _arc(kappa, s, r, E):
    """Place r (3,) and axes E (3, 3) at the arc length s of a line of constant curvature kappa (3,), whose axes at 0 are the
    identity."""
    t2 = s * s * (kappa[0] ** 2 + kappa[1] ** 2 + kappa[2] ** 2)
    a, b = rotation_factors(t2)
    c = (1.0 - a) / t2 if t2 > 0.01 else 1.0 / 6.0 - t2 * (1.0 / 120.0 - t2 * (1.0 / 5040.0 - t2 / 362880.0))
    once, twice = np.zeros((3, 3)), np.zeros((3, 3))
    for i in range(3):
        k, m = (i + 1) % 3, (i + 2) % 3
        once[m, k], once[k, m] = s * kappa[i], -s * kappa[i]
        for j in range(3):
            twice[i, j] = s * s * kappa[i] * kappa[j] - (t2 if i == j else 0.0)
    for i in range(3):
        for j in range(3):
            E[i, j] = (1.0 if i == j else 0.0) + a * once[i, j] + b * twice[i, j]
        r[i] = s * ((1.0 if i == 0 else 0.0) + b * once[i, 0] + c * twice[i, 0])


@kernel
def _osculating_ball(data, at, centre, axes, direction, found):
    """Radius [m] of the ball that fits a ball or ellipse where it is furthest along a direction (3,); its centre into
    `found`."""
    if int(data[at + SHAPE]) != ELLIPSOID:
        found[:] = centre
        return data[at + SIZES]
    _support(data, at, centre, axes, direction, found)
    square = 0.0
    for c in range(2):
        along = axes[0, c] * direction[0] + axes[1, c] * direction[1] + axes[2, c] * direction[2]
        square += (data[at + SIZES + c] * along) ** 2
    radius = (data[at + SIZES] * data[at + SIZES + 1]) ** 2 / (square * math.sqrt(square))
    for r in range(3):
        found[r] -= radius * direction[r]
    return radius


@kernel
def _strip(data, at, first, axes, b, middle, other, n, out):
    """Gap [m] of a ball or ellipse, at `first` with `axes`, and a strip at `middle` with the axes `other`; writes where it
    is on the strip into `out`, the place into `first`, and the normal n (3,) to the strip.

    Around its section the strip is an arc of constant curvature, straight across. It is touched where the line from the
    centre of the ball is normal to it, on an edge where that is beside it, and at an end of the strip where that is beyond.
    """
    kappa, h, slope, half = (
        data[b + CORNERS : b + CORNERS + 3],
        data[b + SIZES],
        data[b + SIZES + 1],
        data[b + SIZES + 2],
    )
    low, high = data[b + CORNERS + 3], data[b + CORNERS + 4]
    r, E, p, v, tangent, up = (
        np.empty(3),
        np.empty((3, 3)),
        np.empty(3),
        np.empty(3),
        np.empty(3),
        np.empty(3),
    )
    ball, down, s, across, radius, F, size = (
        np.empty(3),
        np.empty(3),
        0.0,
        0.0,
        0.0,
        0.0,
        math.sqrt(1.0 + slope * slope),
    )
    for _ in range(STRIP_STEPS):
        _arc(kappa, s, r, E)
        for i in range(3):
            tangent[i], up[i] = E[i, 0] + slope * E[i, 1], (E[i, 1] - slope * E[i, 0]) / size
        for i in range(3):
            down[i] = -(other[i, 0] * up[0] + other[i, 1] * up[1] + other[i, 2] * up[2])
        radius = _osculating_ball(data, at, first, axes, down, ball)
        across = 0.0
        for i in range(3):
            v[i] = -r[i] - (h + slope * s) * E[i, 1]
            for c in range(3):
                v[i] += other[c, i] * (ball[c] - middle[c])
        for i in range(3):
            across += v[i] * E[i, 2]
        across = min(max(across, -half), half)
        F, rate = 0.0, 0.0
        for i in range(3):
            k, m = (i + 1) % 3, (i + 2) % 3
            v[i] -= across * E[i, 2]
            F += v[i] * tangent[i]
            rate += v[i] * (kappa[k] * tangent[m] - kappa[m] * tangent[k])
            side = (h + slope * s) * (kappa[k] * E[m, 1] - kappa[m] * E[k, 1])
            side += across * (kappa[k] * E[m, 2] - kappa[m] * E[k, 2])
            rate -= (tangent[i] + side) * tangent[i]
        new = min(max(s + F / max(-rate, 0.1), low), high)
        if abs(new - s) <= 1e-15 * (high - low):
            break
        s = new
    out[SHIFT], out[SHIFT + 1] = s, across
    for i in range(3):
        p[i] = middle[i]
        for c in range(3):
            p[i] += other[i, c] * (r[c] + (h + slope * s) * E[c, 1] + across * E[c, 2])
    if (s == low and F < 0.0) or (s == high and F > 0.0):
        # beyond an end
        for i in range(3):
            v[i] = 0.0
            for c in range(3):
                v[i] += axes[c, i] * (p[c] - first[c])
        gap = distance(data, at, v, up)
        for i in range(3):
            n[i] = axes[i, 0] * up[0] + axes[i, 1] * up[1] + axes[i, 2] * up[2]
    else:
        gap, beside = 0.0, 0.0
        for i in range(3):
            gap += v[i] * up[i]
            beside += v[i] * E[i, 2]
        if abs(across) == half and beside != 0.0:
            gap = max(gap, 0.0)
            apart = math.sqrt(gap * gap + beside * beside)
            for i in range(3):
                up[i] = (gap * up[i] + beside * E[i, 2]) / apart
            gap = apart
        gap -= radius
        for i in range(3):
            n[i] = -(other[i, 0] * up[0] + other[i, 1] * up[1] + other[i, 2] * up[2])
    first[:] = p
    return gap


@kernel
def _contact(i, j, a, b, place, n, data, ref, x, R, x_before, R_before, out):
    """Write slip, place, directions and wrenches of a contact with the normal n (3,) from body i to body j.

    The forces N, T1, T2 act on body i along -n, t1 and t2, and against them on body j; t1 = n x reference, as in a plane
    with its normal for reference. Slip: how far the point of j went past that of i since the last equilibrium.
    """
    t1, t2 = out[SLIDE : SLIDE + 3], np.empty(3)
    for r in range(3):
        k, m = (r + 1) % 3, (r + 2) % 3
        t1[r] = n[k] * data[ref + m] - n[m] * data[ref + k]
    size = math.sqrt(t1[0] ** 2 + t1[1] ** 2 + t1[2] ** 2)
    for r in range(3):
        t1[r] /= size
        out[PLACE + r], out[NORMAL + r] = place[r], n[r]
    for r in range(3):
        k, m = (r + 1) % 3, (r + 2) % 3
        t2[r] = n[k] * t1[m] - n[m] * t1[k]
    past = np.zeros(3)
    for side in range(2):
        body, sign = (i, 1.0) if side == 0 else (j, -1.0)
        for r in range(3):
            past[r] += sign * x_before[body, r]
            for c in range(3):
                local = 0.0
                for k in range(3):
                    local += R[body, k, c] * (place[k] - x[body, k])
                past[r] += sign * R_before[body, r, c] * local
        own, at = (a, 1.0) if side == 0 else (b, -1.0)
        for r in range(3):
            k, m = (r + 1) % 3, (r + 2) % 3
            yk, ym = place[k] - x[body, k], place[m] - x[body, m]
            start = WRENCH + 18 * own + 3 * r
            out[start], out[start + 1], out[start + 2] = -at * n[r], at * t1[r], at * t2[r]
            out[start + 9] = -at * (yk * n[m] - ym * n[k])
            out[start + 10] = at * (yk * t1[m] - ym * t1[k])
            out[start + 11] = at * (yk * t2[m] - ym * t2[k])
    out[SLIP] = t1[0] * past[0] + t1[1] * past[1] + t1[2] * past[2]
    out[SLIP + 1] = t2[0] * past[0] + t2[1] * past[1] + t2[2] * past[2]


@kernel
def distance(data, at, p, outward):
    """Signed distance [m] of a point p (3,) in the axes of a shape from it, and its outward normal there (3,)."""
    kind, size = int(data[at + SHAPE]), at + SIZES
    outward[:] = 0.0
    if kind == WALL:
        outward[2] = 1.0
        return p[2]
    if kind == POLYGON:
        return _polygon_distance(data, at, p, outward)
    if kind == ELLIPSOID:
        return _ellipsoid_distance(data[size : size + 3], p, outward)
    # ball, box or capsule: rounded by its last size about a box of the others
    total, inside = 0.0, -math.inf
    for r in range(3):
        half = data[size + 1 + r]
        q = abs(p[r]) - half
        inside = max(inside, q)
        outward[r] = math.copysign(max(q, 0.0), p[r])
        total += max(q, 0.0) ** 2
    total = math.sqrt(total)
    for r in range(3):
        if total > 0.0:
            outward[r] /= total
        else:
            outward[r] = math.copysign(1.0, p[r]) if abs(p[r]) - data[size + 1 + r] == inside else 0.0
    return (total if total > 0.0 else inside) - data[size]


@kernel
def _polygon_distance(data, at, p, outward):
    """`distance` from a convex polygon, whose corners are anticlockwise."""
    count, most, least = int(data[at + COUNT]), -math.inf, math.inf
    for e in range(count):
        k, m = at + CORNERS + 2 * e, at + CORNERS + 2 * ((e + 1) % count)
        ux, uy = data[m] - data[k], data[m + 1] - data[k + 1]
        long = math.sqrt(ux * ux + uy * uy)
        ux, uy = ux / long, uy / long
        px, py = p[0] - data[k], p[1] - data[k + 1]
        beyond = px * uy - py * ux
        if beyond > most:
            most = beyond
            if most <= 0.0:
                outward[0], outward[1] = uy, -ux
        along = min(max(px * ux + py * uy, 0.0), long)
        dx, dy = px - along * ux, py - along * uy
        apart = math.sqrt(dx * dx + dy * dy)
        if beyond > 0.0 and apart < least:
            least = apart
            outward[0], outward[1] = (uy, -ux) if 0.0 < along < long else (dx / apart, dy / apart)
    return least if most > 0.0 else most


@kernel
def _ellipsoid_distance(semi, p, outward):
    """`distance` from an ellipsoid with these semi-axes (3,), an ellipse where the last is zero, by Newton on a multiplier.

    Its nearest point is y = a^2 p / (a^2 + t), with t the largest root of sum (a p / (a^2 + t))^2 = 1.
    """
    t = -math.inf
    for r in range(3):
        t = max(t, semi[r] * abs(p[r]) - semi[r] ** 2 if semi[r] > 0.0 else -math.inf)
    for _ in range(60):
        value, slope = -1.0, 0.0
        for r in range(3):
            if semi[r] > 0.0:
                share = semi[r] * p[r] / (semi[r] ** 2 + t)
                value += share * share
                slope -= 2.0 * share * share / (semi[r] ** 2 + t)
        step = value / slope
        t -= step
        if abs(step) <= 1e-15 * (abs(t) + semi[0] ** 2):
            break
    size = 0.0
    for r in range(3):
        outward[r] = p[r] / (semi[r] ** 2 + t) if semi[r] > 0.0 else 0.0
        size += outward[r] ** 2
    size = math.sqrt(size)
    for r in range(3):
        outward[r] /= size
    # p - y = t p / (a^2 + t)
    return t * size
