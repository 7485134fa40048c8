"""Sparse symmetric LDL^T factorisation of small dense blocks, one per node or constraint row, with a fixed pattern.

`plan_blocks` orders the blocks once (minimum degree on the block graph, every constraint row after its nodes) and lists all
updates; `factor_blocks` and `solve_blocks` are compiled and allocate nothing.

There is no pivoting. Instead of [K J'; J 0] the matrix [K + J' s J, J'; J 0] is factored, where s is the stiffness of the
unknowns that row J acts on (augmented Lagrangian; Golub and Greif 2003). This is a congruence, so the number of negative
pivots is unchanged (Sylvester). The solution is unchanged too, except for s g on the multiplier of a row with right-hand
side g. Every pivot of a node is then a stiffness (positive when stable), and that of a row a compliance (negative). Without
it a node with dependent rows would leave a pivot of pure rounding, and a node fixed by rows only would have no pivot at all.
Tiny pivots are reported.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import lru_cache
from heapq import heapify, heappop, heappush
from itertools import combinations, pairwise
from typing import Any, NamedTuple

import numpy as np

from ksd.numerics.kernel import kernel

TINY_PIVOT = 1e-14
"""A pivot below this fraction of its diagonal before elimination counts as zero."""
MAX_REFINEMENTS, REFINEMENT_TOLERANCE = 3, 1e-10
"""Largest number of iterative refinements, and relative size of a refinement after which no further one is made."""
MIN_DIAGONAL_SHARE = 1e-2
"""Lower bound of a diagonal entry of a node in the stiffness of a row, relative to the largest one of the same component."""


VALUES, UNKNOWNS, BLOCKS, ROWS = range(4)
SIZE, START, DIAGONAL, FIRST, ROW, PLACE, FIRST_TARGET, TARGET = range(4, 12)
ROW_BLOCK, FIRST_NODE, NODE, LEVER, FIRST_PAIR, PAIR, END = range(12, 19)
"""Positions in `Blocks.ints` of the counts, of the starts of the arrays of the plan, and of the end of the last one."""


class Blocks(NamedTuple):
    """A block pattern; blocks are numbered in elimination order.

    size, start, diagonal (b,): unknowns of each block, the first of them, and the offset of the diagonal block. The values
    of block (i, j), i >= j, are stored row-major at an offset of the flat value array. Column k has the blocks
    row[first[k]:] below the diagonal, at the offsets `place`, and its elimination updates the blocks at the offsets
    target[first_target[k]:]. Constraint row i is block rows[i], of one unknown; the blocks of its nodes are
    node[first_node[i]:] in elimination order, its coefficients are at the offsets `lever`, and pair[first_pair[i]:] are the
    offsets of the blocks of all pairs of its nodes. values, unknowns: counts; the last values, one per row, belong to no
    block. ints: the whole plan in one array for the kernels, of which the arrays are views.
    """

    size: np.ndarray
    start: np.ndarray
    diagonal: np.ndarray
    first: np.ndarray
    row: np.ndarray
    place: np.ndarray
    first_target: np.ndarray
    target: np.ndarray
    rows: np.ndarray
    first_node: np.ndarray
    node: np.ndarray
    lever: np.ndarray
    first_pair: np.ndarray
    pair: np.ndarray
    values: int
    unknowns: int
    ints: np.ndarray


def unflatten_blocks(ints: np.ndarray) -> Blocks:
    """The plan at the beginning of an array of integers, as views."""
    places = ints[SIZE : END + 1].tolist()
    views = [ints[a:b] for a, b in pairwise(places)]
    parts: Any = (*views, int(ints[VALUES]), int(ints[UNKNOWNS]), ints[: places[-1]])
    return Blocks(*parts)


def _elimination_order(neighbours: list[set[int]], size: list[int], waits: list[bool]) -> list[int]:
    """Minimum degree order; block k with waits[k] is eligible once all its original neighbours are eliminated."""
    graph = [set(n) for n in neighbours]
    left = [len(n) if wait else 0 for n, wait in zip(neighbours, waits, strict=True)]
    degree = [sum(size[n] for n in found) for found in graph]
    # outdated entries stay in the heap and are skipped
    heap = [(degree[k], k) for k in range(len(graph)) if not left[k]]
    heapify(heap)
    is_eliminated = [False] * len(graph)
    order: list[int] = []
    while heap:
        known, k = heappop(heap)
        if is_eliminated[k] or known != degree[k]:
            continue
        is_eliminated[k] = True
        order.append(k)
        for n in graph[k]:
            graph[n] |= graph[k]
            graph[n] -= {n, k}
            degree[n] = sum(size[m] for m in graph[n])
            if not left[n]:
                heappush(heap, (degree[n], n))
        for n in neighbours[k]:
            if waits[n]:
                left[n] -= 1
                if not left[n] and not is_eliminated[n]:
                    heappush(heap, (degree[n], n))
    return order


Plan = tuple[Blocks, np.ndarray, dict[tuple[int, int], int]]


def plan_blocks(
    size: np.ndarray, pairs: Iterable[tuple[int, int]], *, waits: np.ndarray | None = None, last: int = 0
) -> Plan:
    """Pattern of a symmetric matrix with blocks of `size` (b,) unknowns coupled by `pairs`, cached.

    Returns the plan, the position (b,) of each block in the elimination order, and the offset of every stored block, keyed
    by (row, column) in that order, row >= column. waits (b,): True for constraint rows; the `last` blocks are eliminated
    last, in their own order (for condensation onto them), and then there are no rows.
    """
    sizes = tuple(np.asarray(size).tolist())
    waiting = (False,) * len(sizes) if waits is None else tuple(np.asarray(waits, bool).tolist())
    return _plan_blocks(sizes, tuple(pairs), waiting, last)


@lru_cache(maxsize=128)
def _plan_blocks(
    size: tuple[int, ...], pairs: tuple[tuple[int, int], ...], waits: tuple[bool, ...], last: int
) -> Plan:
    """`plan_blocks` of hashable arguments."""
    count = len(size)
    neighbours: list[set[int]] = [set() for _ in range(count)]
    for a, b in pairs:
        if a != b:
            neighbours[a].add(b)
            neighbours[b].add(a)
    nodes_of_row = {i: sorted(neighbours[i]) for i, wait in enumerate(waits) if wait}
    for nodes in nodes_of_row.values():
        # the term J' s J couples all nodes of a row
        for a, b in combinations(nodes, 2):
            neighbours[a].add(b)
            neighbours[b].add(a)
    kept = list(range(count - last, count))
    inner = [{n for n in found if n < count - last} for found in neighbours[: count - last]]
    order = _elimination_order(inner, list(size), list(waits[: count - last])) + kept
    where = np.empty(count, np.int64)
    where[order] = np.arange(count)
    position = where.tolist()
    below: list[set[int]] = [set() for _ in range(count)]
    for a in range(count):
        for b in neighbours[a]:
            i, j = position[a], position[b]
            below[min(i, j)].add(max(i, j))
    for k in range(count):
        rows = sorted(below[k])
        for index, j in enumerate(rows):
            below[j].update(rows[index + 1 :])
    ordered = {position[i]: sorted(position[n] for n in nodes) for i, nodes in nodes_of_row.items()}
    sizes = np.array(size, np.int64)[order]
    offsets = _offsets(sizes.tolist(), below)
    return _lay_out(sizes, below, ordered, offsets), where, offsets


def _offsets(size: list[int], below: list[set[int]]) -> dict[tuple[int, int], int]:
    """Offset of every stored block by (row, column); below: rows of the blocks under the diagonal of each column."""
    offsets: dict[tuple[int, int], int] = {}
    at = 0
    for k in range(len(size)):
        for i in [k, *sorted(below[k])]:
            offsets[(i, k)] = at
            at += size[i] * size[k]
    return offsets


def _lay_out(
    size: np.ndarray,
    below: list[set[int]],
    nodes_of_row: dict[int, list[int]],
    offsets: dict[tuple[int, int], int],
) -> Blocks:
    """The plan of blocks in elimination order; below, offsets: see `_offsets`; nodes_of_row: of every constraint row."""
    count = len(size)
    first, row, place, first_target, target = [0], [], [], [0], []
    for k in range(count):
        rows = sorted(below[k])
        row += rows
        place += [offsets[(i, k)] for i in rows]
        target += [offsets[(i, j)] for n, j in enumerate(rows) for i in rows[n:]]
        first.append(len(row))
        first_target.append(len(target))
    first_node, node, lever, first_pair, pair = [0], [], [], [0], []
    for i, nodes in nodes_of_row.items():
        node += nodes
        lever += [offsets[(i, k)] for k in nodes]
        pair += [offsets[(a, b)] for n, a in enumerate(nodes) for b in nodes[: n + 1]]
        first_node.append(len(node))
        first_pair.append(len(pair))
    values = sum(int(size[i] * size[k]) for i, k in offsets) + len(nodes_of_row)
    start = np.concatenate([[0], np.cumsum(size)]).astype(np.int64)
    diagonal = np.array([offsets[(k, k)] for k in range(count)], np.int64)
    parts: tuple[Any, ...] = (
        size, start, diagonal, first, row, place, first_target, target, list(nodes_of_row), first_node, node, lever,
        first_pair, pair,
    )  # fmt: skip
    places = END + 1 + np.cumsum([0, *(len(part) for part in parts)])
    head = [values, start[-1], count, len(nodes_of_row), *places]
    return unflatten_blocks(np.concatenate([np.asarray(part, np.int64) for part in (head, *parts)]))


@kernel
def _add_row_stiffness(plan, value, scaled):
    """Add J' s J of all constraint rows J to the matrix; 1/s of every row, 0 for a released row, is stored at the end of
    `scaled`.

    1/s is the compliance of the diagonal entries that the row acts on.
    """
    size, diagonal, blocks = plan[SIZE], plan[DIAGONAL], plan[BLOCKS]
    node, levers = plan[NODE], plan[LEVER]
    for i in range(plan[ROWS]):
        begin, end = plan[plan[FIRST_NODE] + i], plan[plan[FIRST_NODE] + i + 1]
        compliance = 0.0
        for e in range(begin, end):
            k = plan[node + e]
            n = plan[size + k]
            for c in range(n):
                lever = value[plan[levers + e] + c]
                if lever != 0.0:
                    own, most = abs(value[plan[diagonal + k] + c * (n + 1)]), 0.0
                    for b in range(blocks):
                        if plan[size + b] == n:
                            most = max(most, abs(value[plan[diagonal + b] + c * (n + 1)]))
                    # doubled, because under load the entry may be negative and must not cancel
                    own = 2.0 * max(own, MIN_DIAGONAL_SHARE * most)
                    compliance += lever * lever / (own if own > 0.0 else 1.0)
        scaled[plan[VALUES] - plan[ROWS] + i] = compliance
    for i in range(plan[ROWS]):
        begin, end = plan[plan[FIRST_NODE] + i], plan[plan[FIRST_NODE] + i + 1]
        compliance, pair = scaled[plan[VALUES] - plan[ROWS] + i], plan[PAIR] + plan[plan[FIRST_PAIR] + i]
        for e in range(begin, end):
            for f in range(begin, e + 1):
                n, at = plan[size + plan[node + f]], plan[pair]
                if compliance > 0.0:
                    for r in range(plan[size + plan[node + e]]):
                        s = value[plan[levers + e] + r] / compliance
                        for c in range(n):
                            value[at + r * n + c] += s * value[plan[levers + f] + c]
                pair += 1


@kernel(inline="always")
def _solve_row(value, scaled, w, at, n):
    """Multiply the row value[w : w + n] by (L D L^T)^-1 of the factored pivot block at value[at], into scaled[w:]."""
    for c in range(n):
        s = value[w + c]
        for b in range(c):
            s -= scaled[w + b] * value[at + c * n + b]
        scaled[w + c] = s
    for c in range(n - 1, -1, -1):
        s = scaled[w + c] / value[at + c * n + c]
        for b in range(c + 1, n):
            s -= scaled[w + b] * value[at + b * n + c]
        scaled[w + c] = s


@kernel(inline="always")
def _update_block(value, scaled, i, j, q, rows, columns, n):
    """Subtract W_ik A_jk^T from the block (rows, columns) at value[q], with W at scaled[i] and A at value[j], n columns
    each."""
    for r in range(rows):
        for c in range(columns):
            s = 0.0
            for b in range(n):
                s += scaled[i + r * n + b] * value[j + c * n + b]
            value[q + r * columns + c] -= s


@kernel
def factor_blocks(plan, value, scaled, stop):
    """Factor columns 0 .. stop-1 in place and return (negative pivots, smallest relative pivot); plan: `Blocks.ints`.

    A pivot is relative to its diagonal entry before elimination, that of a constraint row to its compliance 1/s (released
    rows are left out). Afterwards the diagonal blocks hold unit L and D, the blocks below them A_ik (unscaled), and the
    columns from `stop` on the Schur complement. `scaled`, as long as `value`, holds the rows A_ik D_k^-1 for the solves, and
    in its diagonal blocks the reference values of the pivots.
    """
    size, diagonal, first, row, place = plan[SIZE], plan[DIAGONAL], plan[FIRST], plan[ROW], plan[PLACE]
    negatives = 0
    worst = 1.0
    _add_row_stiffness(plan, value, scaled)
    for k in range(plan[BLOCKS]):
        n, at = plan[size + k], plan[diagonal + k]
        for j in range(n):
            scaled[at + j] = abs(value[at + j * n + j])
    for i in range(plan[ROWS]):
        scaled[plan[diagonal + plan[plan[ROW_BLOCK] + i]]] = scaled[plan[VALUES] - plan[ROWS] + i]
    for k in range(stop):
        n, at = plan[size + k], plan[diagonal + k]
        # dense LDL^T of the pivot block
        for j in range(n):
            before, d = scaled[at + j], value[at + j * n + j]
            for c in range(j):
                l = value[at + j * n + c]
                d -= l * l * value[at + c * n + c]
            value[at + j * n + j] = d
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
        begin, end = plan[first + k], plan[first + k + 1]
        # scaled row block: W = A_ik (L D L^T)^-1, row by row
        for e in range(begin, end):
            for r in range(plan[size + plan[row + e]]):
                w = plan[place + e] + r * n
                # a literal size for blocks of spatial nodes halves the time
                if n == 6:
                    _solve_row(value, scaled, w, at, 6)
                else:
                    _solve_row(value, scaled, w, at, n)
        # A_ij -= A_ik D^-1 A_jk^T for every pair i >= j of this column
        t = plan[TARGET] + plan[plan[FIRST_TARGET] + k]
        for f in range(begin, end):
            mj, pj = plan[size + plan[row + f]], plan[place + f]
            for e in range(f, end):
                pi, q = plan[place + e], plan[t]
                t += 1
                mi = plan[size + plan[row + e]]
                if n == 6 and mi == 6 and mj == 6:
                    _update_block(value, scaled, pi, pj, q, 6, 6, 6)
                else:
                    _update_block(value, scaled, pi, pj, q, mi, mj, n)
    return negatives, worst


@kernel
def forward_blocks(plan, scaled, x, stop):
    """Forward sweep in place over columns 0 .. stop-1: x_i -= A_ik D_k^-1 x_k."""
    size, start, first, row, place = plan[SIZE], plan[START], plan[FIRST], plan[ROW], plan[PLACE]
    for k in range(stop):
        n, a = plan[size + k], plan[start + k]
        for e in range(plan[first + k], plan[first + k + 1]):
            i, p = plan[row + e], plan[place + e]
            for r in range(plan[size + i]):
                s = 0.0
                for c in range(n):
                    s += scaled[p + r * n + c] * x[a + c]
                x[plan[start + i] + r] -= s


@kernel
def backward_blocks(plan, value, scaled, x, stop):
    """Backward sweep in place: x_k = (L D L^T)^-1 x_k - sum_i (A_ik D_k^-1)^T x_i, columns stop-1 .. 0."""
    size, start, first, row, place = plan[SIZE], plan[START], plan[FIRST], plan[ROW], plan[PLACE]
    for k in range(stop - 1, -1, -1):
        n, a, at = plan[size + k], plan[start + k], plan[plan[DIAGONAL] + k]
        for r in range(n):
            s = x[a + r]
            for c in range(r):
                s -= value[at + r * n + c] * x[a + c]
            x[a + r] = s
        for r in range(n - 1, -1, -1):
            s = x[a + r] / value[at + r * n + r]
            for c in range(r + 1, n):
                s -= value[at + c * n + r] * x[a + c]
            x[a + r] = s
        for e in range(plan[first + k], plan[first + k + 1]):
            i, p = plan[row + e], plan[place + e]
            for r in range(plan[size + i]):
                s = x[plan[start + i] + r]
                for c in range(n):
                    x[a + c] -= scaled[p + r * n + c] * s


@kernel
def solve_blocks(plan, value, scaled, x):
    """Solve in place with a complete factorisation; x (unknowns,) in elimination order."""
    tail = plan[VALUES] - plan[ROWS]
    for i in range(plan[ROWS]):
        scaled[tail + i] = x[plan[plan[START] + plan[plan[ROW_BLOCK] + i]]]
    forward_blocks(plan, scaled, x, plan[BLOCKS])
    backward_blocks(plan, value, scaled, x, plan[BLOCKS])
    for i in range(plan[ROWS]):
        k = plan[plan[ROW_BLOCK] + i]
        compliance = scaled[plan[plan[DIAGONAL] + k]]
        if compliance > 0.0:
            x[plan[plan[START] + k]] += scaled[tail + i] / compliance


@kernel
def _less_product(high, low, a, b):
    """high + low - a b as a sum (high, low) in twice the working precision (Dekker 1971; sum by Knuth)."""
    p, t, u = a * b, 134217729.0 * a, 134217729.0 * b
    ah, bh = t - (t - a), u - (u - b)
    al, bl = a - ah, b - bh
    off = ((ah * bh - p) + ah * bl + al * bh) + al * bl
    s = high - p
    v = s - high
    return s, low + ((high - (s - v)) - (p + v)) - off


@kernel
def residual_blocks(plan, value, b, x, rest, low):
    """Residual b - A x in twice the working precision, into `rest`; value: the matrix, not factored; low: scratch; all
    vectors (unknowns,)."""
    size, start, first, row, place = plan[SIZE], plan[START], plan[FIRST], plan[ROW], plan[PLACE]
    # not rest[:] = b, whose check of shapes takes two seconds to compile
    for i in range(len(b)):
        rest[i], low[i] = b[i], 0.0
    for k in range(plan[BLOCKS]):
        n, a = plan[size + k], plan[start + k]
        for r in range(n):
            for c in range(n):
                entry = value[plan[plan[DIAGONAL] + k] + r * n + c]
                rest[a + r], low[a + r] = _less_product(rest[a + r], low[a + r], entry, x[a + c])
        for e in range(plan[first + k], plan[first + k + 1]):
            i, p = plan[start + plan[row + e]], plan[place + e]
            for r in range(plan[size + plan[row + e]]):
                for c in range(n):
                    entry = value[p + r * n + c]
                    rest[i + r], low[i + r] = _less_product(rest[i + r], low[i + r], entry, x[a + c])
                    rest[a + c], low[a + c] = _less_product(rest[a + c], low[a + c], entry, x[i + r])
    for i in range(len(rest)):
        rest[i] += low[i]


@kernel
def solve_refined(plan, matrix, value, scaled, b, x, change, low):
    """Solve A x = b with iterative refinement.

    matrix: A, not factored; value, scaled: A, factored; b, x, change, low (unknowns,), low: scratch. Returns the norm of the
    last refinement `change` over that of x, both weighted by the diagonal of A: an estimate of the error before that
    refinement, and a bound of the error after it.
    """
    for i in range(len(b)):
        x[i] = b[i]
    solve_blocks(plan, value, scaled, x)
    error = 0.0
    for _ in range(MAX_REFINEMENTS):
        residual_blocks(plan, matrix, b, x, change, low)
        solve_blocks(plan, value, scaled, change)
        change_norm, norm = 0.0, 0.0
        for k in range(plan[BLOCKS]):
            a = plan[plan[START] + k]
            for c in range(plan[plan[SIZE] + k]):
                weight = scaled[plan[plan[DIAGONAL] + k] + c]
                x[a + c] += change[a + c]
                change_norm += weight * change[a + c] ** 2
                norm += weight * x[a + c] ** 2
        error = math.sqrt(change_norm / norm) if norm > 0.0 else 0.0
        if error <= REFINEMENT_TOLERANCE:
            break
    return error


@kernel
def solve_refined_rows(plan, matrix, value, scaled, loads, solution):
    """`solve_refined` for every row of loads (k, unknowns), into solution (k, unknowns); returns the largest error."""
    change, low, worst = np.empty(loads.shape[1]), np.empty(loads.shape[1]), 0.0
    for i in range(len(loads)):
        worst = max(worst, solve_refined(plan, matrix, value, scaled, loads[i], solution[i], change, low))
    return worst
