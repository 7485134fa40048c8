"""Every leaf of a model as the exact rod that it stands for, in the place of its member: `ksd.beam.rod` in the assembly.

Where integration from one end would lose its digits a rod is cut into parts at stations, which are nodes of its own: each
part begins with a wrench of its own, ends where the next station is, and the stations are eliminated along the rod
(multiple shooting, the linear chain condensed). Lengths m, forces N, moments Nm, angles rad.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ksd.beam.member_tangent import member_tangent
from ksd.beam.rod import STATE, allocate_rod_scratch, integrate_rod
from ksd.model.arrays import ACTIVE_DOFS, BLOCK, DOFS_PER_NODE, MEMBERS, NODE, START
from ksd.model.tangents import scatter
from ksd.numerics.elimination import solve_small
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import reorthonormalise, rotate


class Rods(NamedTuple):
    """k rods in p parts. at_part (k+1,): where the parts of every rod begin; at_step (p+1,): the steps of every part; step
    (s,), rod (s, 5, ROD): lengths and numbers of these; offset (k, 2, 3), frame (k, 2, 3, 3): ends, in the axes of nodes."""

    at_part: np.ndarray
    at_step: np.ndarray
    step: np.ndarray
    rod: np.ndarray
    offset: np.ndarray
    frame: np.ndarray


class RodState(NamedTuple):
    """Where rods are. gravity (k, 3) [m/s^2], global; place (p, 3), axes (p, 3, 3): stations, at the start of every part
    but the first of a rod, global; wrench (p, 6) at the start of every part, in its axes there.

    Of the last assembly: gap (p, 6) at the end of every part; back (p, 6, 7): wrench by motion of the end, and by the gap;
    kept (p, 6, 13): motion of a station by those of the start of the rod and of the next station, and by itself, with the
    sign turned. moved (p, 6): by the last step, what every part had to go to close.
    """

    gravity: np.ndarray
    place: np.ndarray
    axes: np.ndarray
    wrench: np.ndarray
    gap: np.ndarray
    back: np.ndarray
    kept: np.ndarray
    moved: np.ndarray


@kernel
def _part_pose(a, b, i, j, first, last, x, R, offset, frame, place, axes, pose, Q, d):
    """Pose (18,) of part j of rod i as `ksd.model.poses.member_pose` has it, a station being the node itself, relative
    orientation Q (3, 3) and place d (3,) of its end in the frame of its start."""
    for r in range(3):
        start, lever = 0.0, 0.0
        if j == first:
            for c in range(3):
                start += R[a, r, c] * offset[i, 0, c]
        if j == last - 1:
            for c in range(3):
                lever += R[b, r, c] * offset[i, 1, c]
        base = x[a, r] if j == first else place[j, r]
        end = x[b, r] + lever if j == last - 1 else place[j + 1, r]
        pose[9 + r], pose[12 + r], pose[15 + r] = end - base, lever, end - base - start
        for c in range(3):
            if j == first:
                pose[3 * r + c] = 0.0
                for k in range(3):
                    pose[3 * r + c] += R[a, r, k] * frame[i, 0, k, c]
            else:
                pose[3 * r + c] = axes[j, r, c]
    for c in range(3):
        d[c] = pose[c] * pose[15] + pose[3 + c] * pose[16] + pose[6 + c] * pose[17]
        for r in range(3):
            Q[r, c] = 0.0
        for k in range(3):
            t = 0.0
            if j == last - 1:
                for l in range(3):
                    t += R[b, k, l] * frame[i, 1, l, c]
            else:
                t = axes[j + 1, k, c]
            for r in range(3):
                Q[r, c] += pose[3 * k + r] * t


@kernel
def _close(y, gap, length, back, A, K, lam):
    """From the integrated rod in y: back (6, 7), and the wrench lam (12,) and stiffness K (6, 6) of its end q, its gap
    closed to first order; A (6, 6): scratch."""
    for r in range(6):
        for c in range(6):
            # without units: over the length
            A[r, c] = y[STATE + 9 * c + r] / ((length if r < 3 else 1.0) * (length if c < 3 else 1.0))
            back[r, c] = 1.0 if r == c else 0.0
        back[r, 6] = gap[r] / (length if r < 3 else 1.0)
    solve_small(A, back)
    for r in range(6):
        for c in range(7):
            back[r, c] /= (length if r < 3 else 1.0) * (length if c < 3 else 1.0)
    for r in range(3):
        lam[r], lam[3 + r] = y[10 + r] + back[r, 6], y[7 + r]
        for c in range(6):
            lam[3 + r] += y[STATE + 9 * c + 6 + r] * back[c, 6]
            A[r, c], A[3 + r, c] = back[r, c], 0.0
            for k in range(6):
                A[3 + r, c] += y[STATE + 9 * k + 6 + r] * back[k, c]
    for r in range(6):
        lam[6 + r] = lam[r]
        for c in range(6):
            K[r, c] = 0.5 * (A[r, c] + A[c, r])


@kernel
def _weigh(pose, y, wrench, back, force):
    """Force (12,) of a part with weight: what its start bears, which is not what its end does."""
    n, m, arm = np.zeros(3), np.zeros(3), np.zeros(3)
    for r in range(3):
        arm[r] = pose[9 + r] - pose[15 + r]
        for c in range(3):
            n[r] += pose[3 * r + c] * (wrench[c] + back[c, 6])
            m[r] += pose[3 * r + c] * (wrench[3 + c] + back[3 + c, 6])
    for r in range(3):
        j, k = (r + 1) % 3, (r + 2) % 3
        force[r], force[3 + r] = -n[r], -m[r] - arm[j] * n[k] + arm[k] * n[j]


@kernel
def _join(E, g, T, force, kept, A):
    """Part T (12, 12), force (12,) behind the rod so far, E (12, 12) and g (12,), in place: the station between them is
    eliminated, see `RodState.kept`; A (6, 6): scratch."""
    for r in range(6):
        for c in range(6):
            A[r, c] = E[6 + r, 6 + c] + T[r, c]
            kept[r, c], kept[r, 6 + c] = E[6 + r, c], T[r, 6 + c]
        kept[r, 12] = g[6 + r] + force[r]
    solve_small(A, kept)
    for r in range(6):
        for c in range(6):
            # coupling and far end, before the near one is overwritten
            A[r, c] = E[r, 6 + c]
            E[6 + r, 6 + c] = T[6 + r, 6 + c]
            for k in range(6):
                E[6 + r, 6 + c] -= T[6 + r, k] * kept[k, 6 + c]
        g[6 + r] = force[6 + r]
        for k in range(6):
            g[6 + r] -= T[6 + r, k] * kept[k, 12]
    for r in range(6):
        for c in range(6):
            E[r, 6 + c] = 0.0
            for k in range(6):
                E[r, c] -= A[r, k] * kept[k, c]
                E[r, 6 + c] -= A[r, k] * kept[k, 6 + c]
        for k in range(6):
            g[r] -= A[r, k] * kept[k, 12]
    for r in range(6):
        for c in range(6):
            E[6 + r, c] = E[c, 6 + r]


@kernel
def _add_rods(ints, x, R, at_part, at_step, step, rod, offset, frame, gravity, place, axes, wrench, gap, back, kept,
              matrix, rhs):  # fmt: skip
    room, pose, Q, d, g0 = allocate_rod_scratch(), np.empty(18), np.empty((3, 3)), np.empty(3), np.empty(3)
    K, lam, A, M = np.empty((6, 6)), np.empty(12), np.empty((6, 6)), np.empty((6, 12))
    T, force, E, g = np.empty((12, 12)), np.empty(12), np.empty((12, 12)), np.empty(12)
    for i in range(len(at_part) - 1):
        node = ints[MEMBERS + NODE] + 2 * i
        a, b, first, last = ints[node], ints[node + 1], at_part[i], at_part[i + 1]
        heavy = gravity[i, 0] != 0.0 or gravity[i, 1] != 0.0 or gravity[i, 2] != 0.0
        for j in range(first, last):
            _part_pose(a, b, i, j, first, last, x, R, offset, frame, place, axes, pose, Q, d)
            for c in range(3):
                g0[c] = pose[c] * gravity[i, 0] + pose[3 + c] * gravity[i, 1] + pose[6 + c] * gravity[i, 2]
            integrate_rod(at_step[j], at_step[j + 1], step, rod, g0, wrench[j], d, Q, gap[j], room)
            length = 0.0
            for s in range(at_step[j], at_step[j + 1]):
                length += step[s]
            _close(room.y, gap[j], length, back[j], A, K, lam)
            member_tangent(pose, lam, K, T, force, A, M)
            if heavy:
                _weigh(pose, room.y, wrench[j], back[j], force)
            if j == first:
                E[:, :] = T
                g[:] = force
            else:
                _join(E, g, T, force, kept[j], A)
        scatter(
            ints,
            ints[MEMBERS + BLOCK] + 4 * i,
            E,
            g,
            ints[ints[START] + a],
            ints[ints[START] + b],
            matrix,
            rhs,
        )


@kernel
def _of_node(ints, step, node, motion):
    """Motion (6,) of a node in a step."""
    u = ints[ints[START] + node]
    motion[:] = 0.0
    if u >= 0:
        for r in range(ints[DOFS_PER_NODE]):
            motion[ints[ints[ACTIVE_DOFS] + r]] = step[u + r]


@kernel
def _move_rods(ints, x, R, at_part, offset, frame, place, axes, wrench, gap, back, kept, moved, step):
    pose, Q, d = np.empty(18), np.empty((3, 3)), np.empty(3)
    start, here, beyond, way = np.empty(6), np.empty(6), np.empty(6), np.empty(3)
    for i in range(len(at_part) - 1):
        node = ints[MEMBERS + NODE] + 2 * i
        a, b, first, last = ints[node], ints[node + 1], at_part[i], at_part[i + 1]
        _of_node(ints, step, a, start)
        _of_node(ints, step, b, beyond)
        for j in range(last - 1, first - 1, -1):
            _part_pose(a, b, i, j, first, last, x, R, offset, frame, place, axes, pose, Q, d)
            for r in range(6):
                here[r] = start[r]
                if j > first:
                    here[r] = -kept[j, r, 12]
                    for c in range(6):
                        here[r] -= kept[j, r, c] * start[c] + kept[j, r, 6 + c] * beyond[c]
            for r in range(3):
                k, l = (r + 1) % 3, (r + 2) % 3
                way[r] = beyond[r] - here[r]
                way[r] += beyond[3 + k] * pose[12 + l] - beyond[3 + l] * pose[12 + k]
                way[r] -= here[3 + k] * pose[9 + l] - here[3 + l] * pose[9 + k]
            for c in range(3):
                moved[j, c], moved[j, 3 + c] = 0.0, 0.0
                for r in range(3):
                    moved[j, c] += pose[3 * r + c] * way[r]
                    moved[j, 3 + c] += pose[3 * r + c] * (beyond[3 + r] - here[3 + r])
            for r in range(6):
                change = back[j, r, 6]
                for c in range(6):
                    change += back[j, r, c] * moved[j, c]
                wrench[j, r] += change
            for r in range(6):
                moved[j, r] += gap[j, r]
            if j < last - 1:
                for r in range(3):
                    place[j + 1, r] += beyond[r]
                rotate(beyond[3:], axes[j + 1])
                reorthonormalise(axes[j + 1])
            beyond[:] = here


def add_rods(ints: np.ndarray, x: np.ndarray, R: np.ndarray, rods: Rods, state: RodState, matrix: np.ndarray,
             rhs: np.ndarray) -> None:  # fmt: skip
    """Add tangent and forces of all rods to a block matrix and a residual, the nodes being at x (n, 3), R (n, 3, 3)."""
    _add_rods(ints, x, R, *rods, *state[:-1], matrix, rhs)


def move_rods(ints: np.ndarray, x: np.ndarray, R: np.ndarray, rods: Rods, state: RodState, step: np.ndarray
              ) -> None:  # fmt: skip
    """Take a Newton step (unknowns,) in the rods, in place, before the nodes take it."""
    _move_rods(ints, x, R, rods.at_part, rods.offset, rods.frame, *state[1:], step)
