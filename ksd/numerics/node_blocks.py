"""The factorisation of `ksd.numerics.blocks` where every block is a node with six unknowns, four rows at a time.

The joint bench is that: no multipliers, and 15 inner blocks in every hinge of 30 leafs. Equilibria have multipliers among
their nodes and keep the general one. A mixture of both was measured in them: `full` of the three-joint arm takes a tenth
less, a mechanism on all element nodes, the papers' conventional program, three tenths less.
"""

from __future__ import annotations

from ksd.numerics.kernel import kernel
from ksd.numerics.lanes import load4, pick4, put4, store4


@kernel
def _pivots(value, spare, at, worst):
    """Dense L D L^T of the block (6, 6) at `at`, D as inverses into spare[at + 6 ..]; spare[at ..]: the diagonal before.

    Returns (negative pivots, smallest relative pivot so far), 0 for the last where a pivot vanished.
    """
    negatives = 0
    for j in range(6):
        row = at + 6 * j
        d = value[row + j]
        for c in range(j):
            d -= value[row + c] * value[row + c] * value[at + 7 * c]
        value[row + j] = d
        if not abs(d) > 0.0:
            return negatives, 0.0
        if spare[at + j] > 0.0:
            worst = min(worst, abs(d) / spare[at + j])
        if d < 0.0:
            negatives += 1
        inverse = 1.0 / d
        spare[at + 6 + j] = inverse
        for i in range(j + 1, 6):
            s = value[at + 6 * i + j]
            for c in range(j):
                s -= value[at + 6 * i + c] * value[row + c] * value[at + 7 * c]
            value[at + 6 * i + j] = s * inverse
    return negatives, worst


@kernel
def _divide(value, spare, at, p):
    """spare <- A (L D L^T)^-1 for the block A (6, 6) at p, factors at `at`: four rows at a time, two of them twice."""
    l10, l20, l21 = value[at + 6], value[at + 12], value[at + 13]
    l30, l31, l32 = value[at + 18], value[at + 19], value[at + 20]
    l40, l41, l42, l43 = value[at + 24], value[at + 25], value[at + 26], value[at + 27]
    l50, l51, l52, l53, l54 = value[at + 30], value[at + 31], value[at + 32], value[at + 33], value[at + 34]
    d0, d1, d2 = spare[at + 6], spare[at + 7], spare[at + 8]
    d3, d4, d5 = spare[at + 9], spare[at + 10], spare[at + 11]
    for w in range(p, p + 24, 12):
        y0 = pick4(value, w, 6)
        y1 = pick4(value, w + 1, 6) - l10 * y0
        y2 = pick4(value, w + 2, 6) - l20 * y0 - l21 * y1
        y3 = pick4(value, w + 3, 6) - l30 * y0 - l31 * y1 - l32 * y2
        y4 = pick4(value, w + 4, 6) - l40 * y0 - l41 * y1 - l42 * y2 - l43 * y3
        y5 = pick4(value, w + 5, 6) - l50 * y0 - l51 * y1 - l52 * y2 - l53 * y3 - l54 * y4
        y5 = d5 * y5
        y4 = d4 * y4 - l54 * y5
        y3 = d3 * y3 - l53 * y5 - l43 * y4
        y2 = d2 * y2 - l52 * y5 - l42 * y4 - l32 * y3
        y1 = d1 * y1 - l51 * y5 - l41 * y4 - l31 * y3 - l21 * y2
        y0 = d0 * y0 - l50 * y5 - l40 * y4 - l30 * y3 - l20 * y2 - l10 * y1
        put4(spare, w, 6, y0)
        put4(spare, w + 1, 6, y1)
        put4(spare, w + 2, 6, y2)
        put4(spare, w + 3, 6, y3)
        put4(spare, w + 4, 6, y4)
        put4(spare, w + 5, 6, y5)


@kernel
def _update(plan, value, spare, k):
    """A_ij -= A_ik D^-1 A_jk^T for every pair i >= j of column k: rows of six as two fours that overlap."""
    t, last = plan.first_target[k], plan.first[k + 1]
    for f in range(plan.first[k], last):
        p = plan.place[f]
        a0, a1, a2 = pick4(value, p, 6), pick4(value, p + 1, 6), pick4(value, p + 2, 6)
        a3, a4, a5 = pick4(value, p + 3, 6), pick4(value, p + 4, 6), pick4(value, p + 5, 6)
        p += 12
        b0, b1, b2 = pick4(value, p, 6), pick4(value, p + 1, 6), pick4(value, p + 2, 6)
        b3, b4, b5 = pick4(value, p + 3, 6), pick4(value, p + 4, 6), pick4(value, p + 5, 6)
        for e in range(f, last):
            w, q = plan.place[e], plan.target[t]
            t += 1
            for _ in range(6):
                w0, w1, w2 = spare[w], spare[w + 1], spare[w + 2]
                w3, w4, w5 = spare[w + 3], spare[w + 4], spare[w + 5]
                left, right = load4(value, q), load4(value, q + 2)
                left = left - w0 * a0 - w1 * a1 - w2 * a2 - w3 * a3 - w4 * a4 - w5 * a5
                right = right - w0 * b0 - w1 * b1 - w2 * b2 - w3 * b3 - w4 * b4 - w5 * b5
                store4(value, q, left)
                store4(value, q + 2, right)
                w += 6
                q += 6


@kernel
def factor_node_blocks(plan, value, spare, stop):
    """As `ksd.numerics.blocks.factor_blocks`, which see, for a plan of nodes alone; returns the same."""
    negatives, worst = 0, 1.0
    for k in range(stop):
        at = plan.diagonal[k]
        for j in range(6):
            spare[at + j] = abs(value[at + 7 * j])
    for k in range(stop):
        back, worst = _pivots(value, spare, plan.diagonal[k], worst)
        negatives += back
        if worst == 0.0:
            return negatives, worst
        for e in range(plan.first[k], plan.first[k + 1]):
            _divide(value, spare, plan.diagonal[k], plan.place[e])
        _update(plan, value, spare, k)
    return negatives, worst
