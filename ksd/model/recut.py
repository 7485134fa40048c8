"""States of a leaf spring that is cut elsewhere; compiled.

A leaf spring of k pieces is the members first .. first + k - 1 of `Arrays`, all strain-mode leaves, between marks (k+1,) [m]
along it. ints, floats: of `Arrays`; x, R, inner: of a `State`.
"""

from __future__ import annotations

import numpy as np

from ksd.elements.strain_centreline import follow_centreline, strains_at
from ksd.model.arrays import MEMBER, SETTINGS
from ksd.numerics.elimination import solve_small
from ksd.numerics.kernel import kernel

SAMPLES = 12
"""Steps of the integration along a part of a piece."""
EDGE = 1e-12
"""Distance from a cut, over the length of the leaf, up to which a place is at it."""


@kernel
def _piece(ints, floats, inner, i):
    """Constants, settings and inner state of member i."""
    value = ints[MEMBER.value] + ints[ints[MEMBER.value_at] + i]
    number = ints[MEMBER.number] + SETTINGS * i
    first, last = ints[ints[MEMBER.inner_at] + i], ints[ints[MEMBER.inner_at] + i + 1]
    return floats[value:], ints[number : number + SETTINGS], inner[first:last]


@kernel
def bends_at(ints, floats, inner, first, marks, places, kappa):
    """Write the curvature kappa (n, 3) [1/m] about e1, e2, e3 at places (n,) [m] along a leaf spring, the mean of both sides
    at a cut."""
    edge, count, n = EDGE * marks[-1], np.zeros(len(places)), len(places)
    share, bend, soft = np.empty(n), np.empty((n, 3)), np.empty((n, 3))
    kappa[:] = 0.0
    for k in range(len(marks) - 1):
        value, number, own = _piece(ints, floats, inner, first + k)
        for i in range(n):
            share[i] = min(max((places[i] - marks[k]) / (marks[k + 1] - marks[k]), 0.0), 1.0)
        strains_at(value, number, own, share, bend, soft)
        for i in range(n):
            if marks[k] - edge <= places[i] <= marks[k + 1] + edge:
                count[i] += 1.0
                for c in range(3):
                    kappa[i, c] += bend[i, c]
    for i in range(n):
        for c in range(3):
            kappa[i, c] /= count[i]


@kernel
def section_at(ints, floats, x, R, inner, first, marks, s, place, axes):
    """Write place (3,) [m] and axes (3, 3) of the section at s [m] along a leaf spring, from the nearer end of its piece."""
    k = 0
    while k < len(marks) - 2 and s > marks[k + 1]:
        k += 1
    value, number, own = _piece(ints, floats, inner, first + k)
    share, total = (s - marks[k]) / (marks[k + 1] - marks[k]), number[0] + number[1] + number[2]
    ends, frames = np.empty((2, 3)), np.empty((2, 3, 3))
    for e in range(2):
        node = ints[ints[MEMBER.node] + 2 * (first + k) + e]
        offset = ints[MEMBER.offset] + 6 * (first + k) + 3 * e
        frame = ints[MEMBER.frame] + 18 * (first + k) + 9 * e
        for r in range(3):
            ends[e, r] = x[node, r]
            for c in range(3):
                ends[e, r] += R[node, r, c] * floats[offset + c]
                frames[e, r, c] = 0.0
                for d in range(3):
                    frames[e, r, c] += R[node, r, d] * floats[frame + 3 * d + c]
    # in axes of end p, in which the force is known
    local, turned, e = np.zeros(3), np.zeros((3, 3)), 0 if share < 0.5 else 1
    for r in range(3):
        for c in range(3):
            local[r] += frames[0, c, r] * (ends[e, c] - ends[0, c])
            for d in range(3):
                turned[r, c] += frames[0, d, r] * frames[e, d, c]
    follow_centreline(value, number, own, own[total : total + 3], float(e), share, SAMPLES, local, turned)
    for r in range(3):
        place[r] = ends[0, r]
        for c in range(3):
            place[r] += frames[0, r, c] * local[c]
            axes[r, c] = 0.0
            for d in range(3):
                axes[r, c] += frames[0, r, d] * turned[d, c]


@kernel
def recut(
    ints, floats, x, R, inner, first, marks, new_ints, new_floats, new_x, new_R, new_inner, new_first, new_marks
):  # fmt: skip
    """Write the nodes between the pieces of a leaf spring that is cut at new_marks, and the inner states of the pieces:
    modes nearest to the curvature that it has as it is cut at marks. Its end nodes are not written."""
    place, axes = np.empty(3), np.empty((3, 3))
    for k in range(len(new_marks) - 1):
        i = new_first + k
        if k > 0:
            # ends of pieces are their nodes, whose axes are those of space at rest
            section_at(ints, floats, x, R, inner, first, marks, new_marks[k], place, axes)
            node, frame = new_ints[new_ints[MEMBER.node] + 2 * i], new_ints[MEMBER.frame] + 18 * i
            for r in range(3):
                new_x[node, r] = place[r]
                for c in range(3):
                    new_R[node, r, c] = 0.0
                    for d in range(3):
                        new_R[node, r, c] += axes[r, d] * new_floats[frame + 3 * c + d]
        value, number, own = _piece(new_ints, new_floats, new_inner, i)
        begin, length = new_marks[k], new_marks[k + 1] - new_marks[k]
        source = 0
        while source < len(marks) - 2 and begin + 0.5 * length > marks[source + 1]:
            source += 1
        _, _, given = _piece(ints, floats, inner, first + source)
        total, ng = number[0] + number[1] + number[2], number[3]
        own[total:] = given[len(given) + total - len(own) :]
        basis = 1 + number[0] ** 2 + number[1] ** 2 + number[2] ** 2 + total + ng * (1 + ng)
        places, kappa, mode = np.full(ng, begin), np.empty((ng, 3)), 0
        for g in range(ng):
            for j in range(ng):
                places[g] += length * value[basis - ng * (ng - g) + j]
        bends_at(ints, floats, inner, first, marks, places, kappa)
        for axis in range(3):
            n = number[axis]
            normal, fitted = np.zeros((n, n)), np.zeros((n, 1))
            for a in range(n):
                one = basis + (mode + a) * ng
                for g in range(ng):
                    fitted[a, 0] += value[one + g] * kappa[g, axis]
                    for b in range(n):
                        normal[a, b] += value[one + g] * value[basis + (mode + b) * ng + g]
            solve_small(normal, fitted)
            for a in range(n):
                own[mode + a] = fitted[a, 0]
            mode += n
