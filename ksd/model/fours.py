"""Four chains of the joint bench at a time: what `ksd.beam.corotational_near` takes together in step 2.

The numbers of four neighbouring members of the same make stand in `Work.four`, number by number of all four; a four that
is not full is filled with its last member, whose answer is then read once.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ksd.beam.corotational_element import KEPT, TAIL
from ksd.beam.entry import chain_near, chain_recover_four
from ksd.beam.weight_entry import PULL, pull_member
from ksd.model.poses import member_pose
from ksd.model.tangents import member_norms, member_tangent
from ksd.numerics.fours import four_matrix, fours
from ksd.numerics.kernel import carray, kernel, late
from ksd.numerics.lanes import load4, store4, transpose4
from ksd.numerics.local import local_counts, local_matrix, local_vector
from ksd.numerics.views import flat

LANE, PLACE, TAKEN = 0, 1, 2
"""Columns of `Work.four_of`: number of a member among its four, -1 for one that is worked on alone; where what is kept of
its four begins, in fours; 1 while that is what `move_of_four` needs."""
VALUE, NEAR, D, TURN, LAM, STIFFNESS, ERRORS, INNER, STORE, LENGTH, POSE, TANGENT, FORCE, NORMS, END = range(
    15
)
"""Parts of a four; LENGTH is that of the store."""
PARTS = 15
NODES = 156
"""Numbers of a tangent and a force on two nodes."""


def lay_out(members: Any, near: np.ndarray | None, chain: int) -> tuple[np.ndarray, int]:
    """(four_of (m, 3), length of `Work.four`) for members of kind `chain` with element orientations (m,)."""
    count = len(members.kind)
    found = np.zeros((count, 3), np.int64)
    found[:, LANE] = -1
    chains = np.flatnonzero(members.kind == chain) if near is not None else np.zeros(0, np.int64)
    if not len(chains):
        return found, 0
    stores, at = np.diff(members.store_at), np.zeros(PARTS, np.int64)
    # the parts that are not kept stand before all others, once
    longest = chains[np.argmax(members.number[chains, 0])]
    _parts.py_func(members, longest, 0, at)
    end = at[NORMS] + 6
    for i in chains:
        alike = i > 0 and 0 <= found[i - 1, LANE] < 3
        if alike and np.array_equal(members.number[i], members.number[i - 1]) and stores[i] == stores[i - 1]:
            found[i] = found[i - 1, LANE] + 1, found[i - 1, PLACE], 0
        else:
            found[i] = 0, end, 0
            _parts.py_func(members, i, end, at)
            end = at[END]
    # scratch of the last one
    return found, 4 * int(end + TAIL)


@kernel
def _parts(members, i, place, at):
    """Where the parts of the four of member i begin, in fours: what `move_of_four` needs from `place` on, the rest, which
    all fours share, from the start on. Returns whether it has weight.

    The scratch at the end of a store reaches into the next four: there the wrench, then the motion of end q, comes after.
    """
    n = members.number[i, 0]
    inner = members.inner_at[i + 1] - members.inner_at[i]
    store = members.store_at[i + 1] - members.store_at[i]
    heavy = store > KEPT * n + TAIL
    at[NEAR] = 0
    at[D] = 3 * (2 * n - 1)
    at[TURN] = at[D] + 3
    at[STIFFNESS] = at[TURN] + 9
    at[ERRORS] = at[STIFFNESS] + 36
    at[POSE] = at[ERRORS] + 2
    at[TANGENT] = at[POSE] + 18
    at[FORCE] = at[TANGENT] + 144
    at[NORMS] = at[FORCE] + 12
    at[LAM] = place
    at[VALUE] = at[LAM] + 12
    at[INNER] = at[VALUE] + 16 * n + 9 + (n + 7 if heavy else 0)
    at[STORE] = at[INNER] + inner
    at[LENGTH] = store
    at[END] = at[STORE] + (store if heavy else KEPT * n)
    return heavy


@late("void(CPointer(float64), CPointer(int64))")
def tangents_of_four(four, at):
    """Tangent and force on the nodes from pose, wrench and stiffness, all parts of a four, and `member_norms`."""
    a = carray(at, (PARTS,))
    held = carray(four, (4 * a[END],))
    member_tangent(
        fours(held, 4 * a[POSE], 18), fours(held, 4 * a[LAM], 12), four_matrix(held, 4 * a[STIFFNESS], 6, 6),
        four_matrix(held, 4 * a[TANGENT], 12, 12), fours(held, 4 * a[FORCE], 12),
    )  # fmt: skip
    member_norms(fours(held, 4 * a[LAM], 12), fours(held, 4 * a[FORCE], 12), fours(held, 4 * a[NORMS], 6))


@kernel
def _gather(numbers, starts, count, four, part):
    """`count` numbers of each member, from starts (4,) on, into a part."""
    a, b, c, d = starts[0], starts[1], starts[2], starts[3]
    whole = count & -4
    for k in range(0, whole, 4):
        rows = load4(numbers, a + k), load4(numbers, b + k), load4(numbers, c + k), load4(numbers, d + k)
        r0, r1, r2, r3 = transpose4(*rows)
        o = 4 * (part + k)
        store4(four, o, r0)
        store4(four, o + 4, r1)
        store4(four, o + 8, r2)
        store4(four, o + 12, r3)
    for k in range(whole, count):
        for lane in range(4):
            four[4 * (part + k) + lane] = numbers[starts[lane] + k]


@kernel
def _spread_out(four, part, count, numbers, starts):
    """The reverse of `_gather`."""
    a, b, c, d = starts[0], starts[1], starts[2], starts[3]
    whole = count & -4
    for k in range(0, whole, 4):
        o = 4 * (part + k)
        rows = load4(four, o), load4(four, o + 4), load4(four, o + 8), load4(four, o + 12)
        r0, r1, r2, r3 = transpose4(*rows)
        store4(numbers, a + k, r0)
        store4(numbers, b + k, r1)
        store4(numbers, c + k, r2)
        store4(numbers, d + k, r3)
    for k in range(whole, count):
        for lane in range(4):
            numbers[starts[lane] + k] = four[4 * (part + k) + lane]


@kernel
def _starts(at, first, count, starts):
    """starts (4,): at[first ..] of a four of `count` members, the last one as often as it takes."""
    for lane in range(4):
        starts[lane] = at[first + min(lane, count - 1)]


@kernel
def _evenly(first, step, count, starts):
    """The same for numbers that are `step` apart."""
    for lane in range(4):
        starts[lane] = first + step * min(lane, count - 1)


@kernel
def _members_of(four_of, i):
    """How many members the four that begins with member i has."""
    count = 1
    while count < 4 and i + count < len(four_of) and four_of[i + count, LANE] == count:
        count += 1
    return count


@kernel
def _pose_four(members, x, R, work, factor, i, four, at, heavy):
    """Poses of the members from i on, what stands in `four` of them, and their pull."""
    count, Q, starts = _members_of(work.four_of, i), local_matrix(3, 3), local_counts(4)
    for lane in range(4):
        j = i + min(lane, count - 1)
        pose = work.pose[j]
        member_pose(members, x, R, j, pose, Q)
        for c in range(3):
            four[4 * (at[D] + c) + lane] = (
                pose[c] * pose[15] + pose[3 + c] * pose[16] + pose[6 + c] * pose[17]
            )
            for r in range(3):
                four[4 * (at[TURN] + 3 * r + c) + lane] = Q[r, c]
        if heavy:
            kept = work.store[: members.store_at[j + 1]]
            pull_member(pose.ctypes, work.weight[j].ctypes, factor, kept.ctypes, len(kept))
            for c in range(3):
                four[4 * (at[STORE] + at[LENGTH] - PULL + c) + lane] = kept[len(kept) - PULL + c]
    _evenly(18 * i, 18, count, starts)
    _gather(flat(work.pose), starts, 18, four, at[POSE])
    return count


@kernel
def take_four(members, x, R, inner, work, factor, i, found, told):
    """Poses, wrenches and inner states of the members from i on, found (4, 13, 12): their tangents and forces on the nodes.

    told (4,): negative pivots of all, status in the last.
    """
    four = work.four
    at, starts, out = local_counts(PARTS), local_counts(4), local_vector(2)
    heavy = _parts(members, i, work.four_of[i, PLACE], at)
    count = _pose_four(members, x, R, work, factor, i, four, at, heavy)
    _starts(members.value_at, i, count, starts)
    _gather(members.value, starts, at[INNER] - at[VALUE], four, at[VALUE])
    _starts(work.near_at, i, count, starts)
    _gather(work.near, starts, at[D] - at[NEAR], four, at[NEAR])
    chain_near(four.ctypes, members.number[i].ctypes, at.ctypes, out.ctypes)
    told[0], told[3] = out[0], out[1]
    tangents_of_four(four.ctypes, at.ctypes)
    _evenly(12 * i, 12, count, starts)
    _spread_out(four, at[LAM], 12, flat(work.lam), starts)
    _starts(members.inner_at, i, count, starts)
    _spread_out(four, at[INNER], 12 * (members.number[i, 0] - 1), inner, starts)
    _evenly(0, NODES, 4, starts)
    _spread_out(four, at[TANGENT], NODES, flat(found), starts)
    if heavy:
        _starts(members.store_at, i + 1, count, starts)
        for lane in range(4):
            starts[lane] -= PULL
        _spread_out(four, at[STORE] + at[LENGTH] - PULL, PULL, work.store, starts)
    for lane in range(count):
        work.four_of[i + lane, TAKEN] = 1


@kernel
def told_of_four(members, work, i, told, norms):
    """Errors [N], [Nm] of member i, one of a four, into told[1:3], and its `member_norms`."""
    at, lane, four = local_counts(PARTS), work.four_of[i, LANE], work.four
    _parts(members, i, 0, at)
    told[1], told[2] = four[4 * at[ERRORS] + lane], four[4 * at[ERRORS] + 4 + lane]
    for k in range(6):
        norms[k] = four[4 * (at[NORMS] + k) + lane]


@kernel
def move_of_four(members, inner, work, i, xi, scale):
    """Inner update of member i after its end q moved by xi (6,) relative to its end p; with the last one of its four."""
    four = work.four
    at, lane = local_counts(PARTS), work.four_of[i, LANE]
    heavy = _parts(members, i, work.four_of[i, PLACE], at)
    count = _members_of(work.four_of, i - lane)
    last = 4 if lane == count - 1 else lane + 1
    for k in range(lane, last):
        for r in range(6):
            # where the wrenches stood
            four[4 * (at[LAM] + r) + k] = xi[r]
        if heavy:
            for r in range(3):
                four[4 * (at[STORE] + at[LENGTH] - 3 + r) + k] = work.store[members.store_at[i + 1] - 3 + r]
    if last < 4:
        return
    chain_recover_four(four.ctypes, members.number[i].ctypes, at.ctypes, scale)
    starts = local_counts(4)
    _starts(members.inner_at, i - lane, count, starts)
    _spread_out(four, at[INNER], at[STORE] - at[INNER], inner, starts)
