"""Sparse symmetric LDL^T over small dense blocks, one block per node or multiplier, with a fixed pattern.

`plan_blocks` orders the blocks once (minimum degree on the block graph; a multiplier waits until one of its
nodes is gone) and lists every update; `factor_blocks` and `solve_blocks` are compiled and allocate nothing.
No pivoting: the order makes every pivot a stiffness (positive when stable) or a compliance (negative), so the
number of negative pivots is the inertia (Sylvester). Tiny pivots are reported, never divided by in silence.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ksd.numerics.kernel import kernel

TINY_PIVOT = 1e-14
"""A pivot below this fraction of its diagonal before elimination counts as zero."""


class Blocks(NamedTuple):
    """A block pattern: `size` (b,) unknowns per block; blocks are numbered in elimination order.

    Values of block (i, j), i >= j, sit row-major at an offset of the flat value array. `row`/`place` list, for
    each eliminated column, its rows below the diagonal and their offsets; `target` the offset of every update.
    """

    size: np.ndarray
    start: np.ndarray
    diagonal: np.ndarray
    first: np.ndarray
    row: np.ndarray
    place: np.ndarray
    first_target: np.ndarray
    target: np.ndarray
    values: int
    unknowns: int


def _elimination_order(neighbours: list[set[int]], size: np.ndarray, waits: np.ndarray) -> list[int]:
    """Minimum degree; block k with waits[k] is eligible once one of its first neighbours is eliminated."""
    graph = [set(n) for n in neighbours]
    left = set(range(len(graph)))
    gone: set[int] = set()
    order: list[int] = []
    while left:
        ready = [k for k in left if not waits[k] or neighbours[k] & gone or not neighbours[k]]
        k = min(ready or left, key=lambda b: (sum(int(size[n]) for n in graph[b]), b))
        for n in graph[k]:
            graph[n] |= graph[k]
            graph[n] -= {n, k}
        left.remove(k)
        gone.add(k)
        order.append(k)
    return order


def plan_blocks(
    size: np.ndarray, pairs: list[tuple[int, int]], *, waits: np.ndarray | None = None, last: int = 0
) -> tuple[Blocks, np.ndarray, dict[tuple[int, int], int]]:
    """Pattern of a symmetric matrix with blocks `size` (b,) coupled by `pairs`.

    Returns the plan, `position` (b,) of each block in elimination order, and the offset of every stored block,
    keyed by (row, column) in that order, row >= column. `waits` marks multipliers; the `last` highest-numbered
    blocks are eliminated last, in their own order (for condensation onto them).
    """
    count = len(size)
    waits = np.zeros(count, bool) if waits is None else np.asarray(waits, bool)
    neighbours: list[set[int]] = [set() for _ in range(count)]
    for a, b in pairs:
        if a != b:
            neighbours[a].add(b)
            neighbours[b].add(a)
    kept = list(range(count - last, count))
    inner = [n - set(kept) for n in neighbours[: count - last]]
    order = _elimination_order(inner, size, waits[: count - last]) + kept
    position = np.empty(count, np.int64)
    position[order] = np.arange(count)
    below: list[set[int]] = [set() for _ in range(count)]
    for a in range(count):
        for b in neighbours[a]:
            i, j = position[a], position[b]
            below[min(i, j)].add(int(max(i, j)))
    for k in range(count):
        rows = sorted(below[k])
        for index, j in enumerate(rows):
            below[j].update(rows[index + 1 :])
    return _lay_out(np.asarray(size, np.int64)[order], below), position, _offsets(size[order], below)


def _offsets(size: np.ndarray, below: list[set[int]]) -> dict[tuple[int, int], int]:
    offsets: dict[tuple[int, int], int] = {}
    at = 0
    for k in range(len(size)):
        for i in [k, *sorted(below[k])]:
            offsets[(i, k)] = at
            at += int(size[i] * size[k])
    return offsets


def _lay_out(size: np.ndarray, below: list[set[int]]) -> Blocks:
    offsets = _offsets(size, below)
    count = len(size)
    first, row, place, first_target, target = [0], [], [], [0], []
    for k in range(count):
        rows = sorted(below[k])
        row += rows
        place += [offsets[(i, k)] for i in rows]
        target += [offsets[(i, j)] for n, j in enumerate(rows) for i in rows[n:]]
        first.append(len(row))
        first_target.append(len(target))
    values = sum(int(size[i] * size[k]) for i, k in offsets)
    first_, row_, place_, first_target_, target_ = (
        np.array(x, np.int64) for x in (first, row, place, first_target, target)
    )
    start = np.concatenate([[0], np.cumsum(size)]).astype(np.int64)
    diagonal = np.array([offsets[(k, k)] for k in range(count)], np.int64)
    return Blocks(size, start, diagonal, first_, row_, place_, first_target_, target_, values, int(start[-1]))


@kernel
def factor_blocks(plan, value, spare, stop):
    """Factor in place, columns 0 .. stop-1; returns (negative pivots, smallest relative pivot).

    A pivot is measured against its diagonal entry as assembled (multipliers, zero there, are left out).

    After it, diagonal blocks hold unit L and D; the blocks below hold A_ik (unscaled), and `spare`, as long as
    `value`, the rows A_ik D_k^-1 needed by the solves; its own diagonal blocks keep the assembled diagonal. Columns
    from `stop` on hold the Schur complement.
    """
    negatives = 0
    worst = 1.0
    for k in range(len(plan.size)):
        at = plan.diagonal[k]
        for j in range(plan.size[k]):
            spare[at + j] = abs(value[at + j * plan.size[k] + j])
    for k in range(stop):
        n = plan.size[k]
        at = plan.diagonal[k]
        # dense LDL^T of the pivot block
        for j in range(n):
            before = spare[at + j]
            for c in range(j):
                value[at + j * n + j] -= value[at + j * n + c] * value[at + j * n + c] * value[at + c * n + c]
            d = value[at + j * n + j]
            if not abs(d) > 0.0:
                return negatives, 0.0
            if before > 0.0:
                worst = min(worst, abs(d) / before)
            if d < 0.0:
                negatives += 1
            for i in range(j + 1, n):
                s = value[at + i * n + j]
                for c in range(j):
                    s -= value[at + i * n + c] * value[at + j * n + c] * value[at + c * n + c]
                value[at + i * n + j] = s / d
        # spare row block: W = A_ik (L D L^T)^-1, row by row
        for e in range(plan.first[k], plan.first[k + 1]):
            m = plan.size[plan.row[e]]
            p = plan.place[e]
            for r in range(m):
                w = p + r * n
                for c in range(n):
                    s = value[w + c]
                    for b in range(c):
                        s -= spare[w + b] * value[at + c * n + b]
                    spare[w + c] = s
                for c in range(n):
                    spare[w + c] /= value[at + c * n + c]
                for c in range(n - 1, -1, -1):
                    s = spare[w + c]
                    for b in range(c + 1, n):
                        s -= spare[w + b] * value[at + b * n + c]
                    spare[w + c] = s
        # A_ij -= A_ik D^-1 A_jk^T for every pair i >= j of this column
        t = plan.first_target[k]
        for f in range(plan.first[k], plan.first[k + 1]):
            mj = plan.size[plan.row[f]]
            pj = plan.place[f]
            for e in range(f, plan.first[k + 1]):
                mi = plan.size[plan.row[e]]
                pi = plan.place[e]
                q = plan.target[t]
                t += 1
                for r in range(mi):
                    for c in range(mj):
                        s = 0.0
                        for b in range(n):
                            s += spare[pi + r * n + b] * value[pj + c * n + b]
                        value[q + r * mj + c] -= s
    return negatives, worst


@kernel
def forward_blocks(plan, spare, x, stop):
    """Forward sweep in place over columns 0 .. stop-1: x_i -= A_ik D_k^-1 x_k."""
    for k in range(stop):
        n = plan.size[k]
        a = plan.start[k]
        for e in range(plan.first[k], plan.first[k + 1]):
            i = plan.start[plan.row[e]]
            p = plan.place[e]
            for r in range(plan.size[plan.row[e]]):
                s = 0.0
                for c in range(n):
                    s += spare[p + r * n + c] * x[a + c]
                x[i + r] -= s


@kernel
def backward_blocks(plan, value, spare, x, stop):
    """Backward sweep in place: x_k = (L D L^T)^-1 x_k - sum_i (A_ik D_k^-1)^T x_i, columns stop-1 .. 0."""
    for k in range(stop - 1, -1, -1):
        n = plan.size[k]
        a = plan.start[k]
        at = plan.diagonal[k]
        for r in range(n):
            for c in range(r):
                x[a + r] -= value[at + r * n + c] * x[a + c]
        for r in range(n):
            x[a + r] /= value[at + r * n + r]
        for r in range(n - 1, -1, -1):
            for c in range(r + 1, n):
                x[a + r] -= value[at + c * n + r] * x[a + c]
        for e in range(plan.first[k], plan.first[k + 1]):
            i = plan.start[plan.row[e]]
            p = plan.place[e]
            for r in range(plan.size[plan.row[e]]):
                for c in range(n):
                    x[a + c] -= spare[p + r * n + c] * x[i + r]


@kernel
def solve_blocks(plan, value, spare, x):
    """Solve in place with a complete factorisation; x (unknowns,) in elimination order."""
    forward_blocks(plan, spare, x, len(plan.size))
    backward_blocks(plan, value, spare, x, len(plan.size))
