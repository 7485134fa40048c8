"""Assembly of exact rods (`ksd.elements.rod`) in the position of the leaf springs of a model.

Where integration from one end would suffer from cancellation a rod is cut into parts at stations, which are nodes of the rod
itself. The wrench at the start of every part is unknown, every part has to end at the next station, and the stations are
eliminated along the rod (multiple shooting with a condensed linear chain). Lengths m, forces N, moments Nm, angles rad.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ksd.elements.ends import member_tangent
from ksd.elements.rod import ROD_LOADS, STATE, allocate_rod_scratch, integrate_rod
from ksd.model.arrays import AT, DOFS_PER_NODE, MEMBER
from ksd.model.assembly import scatter
from ksd.numerics.elimination import solve_small
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import reorthonormalise, rotate


class Rods(NamedTuple):
    """k rods in p parts with s integration steps.

    at_part (k+1,), at_step (p+1,): first part of every rod, first step of every part; step (s,), rod (s, 5, ROD): lengths
    and constants of the steps; offset (k, 2, 3), frame (k, 2, 3, 3): ends in the axes of their nodes.
    """

    at_part: np.ndarray
    at_step: np.ndarray
    step: np.ndarray
    rod: np.ndarray
    offset: np.ndarray
    frame: np.ndarray


class RodState(NamedTuple):
    """State of rods.

    loads (k, ROD_LOADS): along the rods, global (`ksd.elements.rod`); position (p, 3), axes (p, 3, 3): stations at the
    start of every part but the first of a rod, global; wrench (p, 6): at the start of every part, in its axes.

    From the last assembly: gap (p, 6): closure gap at the end of every part; wrench_change (p, 6, 7): change of the wrench
    per motion of the end (6 columns), and the one that closes the gap; elimination (p, 6, 13): minus the motion of a station
    per motion of the start of the rod (6 columns) and of the next station (6 columns), and minus its own motion. From the
    last step: closing (p, 6): motion by which every part had to close.
    """

    loads: np.ndarray
    position: np.ndarray
    axes: np.ndarray
    wrench: np.ndarray
    gap: np.ndarray
    wrench_change: np.ndarray
    elimination: np.ndarray
    closing: np.ndarray


@kernel
def _part_pose(a, b, i, j, first, last, x, R, offset, frame, position, axes, pose, Q, d):
    """Write the pose (18,) of part j of rod i, parts first .. last - 1, between nodes a and b as in
    `ksd.elements.ends.member_pose`, where a station is its own node, and orientation Q (3, 3) and position d (3,) [m] of its
    end in the frame of its start. position, axes: of the stations, global."""
    for r in range(3):
        start, lever = 0.0, 0.0
        if j == first:
            for c in range(3):
                start += R[a, r, c] * offset[i, 0, c]
        if j == last - 1:
            for c in range(3):
                lever += R[b, r, c] * offset[i, 1, c]
        base = x[a, r] if j == first else position[j, r]
        end = x[b, r] + lever if j == last - 1 else position[j + 1, r]
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
def _close_part(y, gap, length, wrench_change, A, K, lam):
    """From the integrated part in y: wrench_change (6, 7), and wrench lam (12,) and stiffness K (6, 6) of its end q with
    the gap closed to first order; A (6, 6): scratch."""
    for r in range(6):
        for c in range(6):
            # dimensionless, by the length
            A[r, c] = y[STATE + 9 * c + r] / ((length if r < 3 else 1.0) * (length if c < 3 else 1.0))
            wrench_change[r, c] = 1.0 if r == c else 0.0
        wrench_change[r, 6] = gap[r] / (length if r < 3 else 1.0)
    solve_small(A, wrench_change)
    for r in range(6):
        for c in range(7):
            wrench_change[r, c] /= (length if r < 3 else 1.0) * (length if c < 3 else 1.0)
    for r in range(3):
        lam[r], lam[3 + r] = y[10 + r] + wrench_change[r, 6], y[7 + r]
        for c in range(6):
            lam[3 + r] += y[STATE + 9 * c + 6 + r] * wrench_change[c, 6]
            A[r, c], A[3 + r, c] = wrench_change[r, c], 0.0
            for k in range(6):
                A[3 + r, c] += y[STATE + 9 * k + 6 + r] * wrench_change[k, c]
    for r in range(6):
        lam[6 + r] = lam[r]
        for c in range(6):
            K[r, c] = 0.5 * (A[r, c] + A[c, r])


@kernel
def _weight_force(pose, y, wrench, wrench_change, force):
    """Set the force on the start of a part with loads along it, which differs from that on its end, in force (12,)."""
    n, m, arm = np.zeros(3), np.zeros(3), np.zeros(3)
    for r in range(3):
        arm[r] = pose[9 + r] - pose[15 + r]
        for c in range(3):
            n[r] += pose[3 * r + c] * (wrench[c] + wrench_change[c, 6])
            m[r] += pose[3 * r + c] * (wrench[3 + c] + wrench_change[3 + c, 6])
    for r in range(3):
        j, k = (r + 1) % 3, (r + 2) % 3
        force[r], force[3 + r] = -n[r], -m[r] - arm[j] * n[k] + arm[k] * n[j]


@kernel
def _eliminate_station(E, g, T, force, elimination, A):
    """Append a part with T (12, 12), force (12,) to the rod so far with E (12, 12), g (12,), in place.

    The station between them is eliminated, see `RodState.elimination`; A (6, 6): scratch.
    """
    for r in range(6):
        for c in range(6):
            A[r, c] = E[6 + r, 6 + c] + T[r, c]
            elimination[r, c], elimination[r, 6 + c] = E[6 + r, c], T[r, 6 + c]
        elimination[r, 12] = g[6 + r] + force[r]
    solve_small(A, elimination)
    for r in range(6):
        for c in range(6):
            # coupling and far end, before the block of the near end is overwritten
            A[r, c] = E[r, 6 + c]
            E[6 + r, 6 + c] = T[6 + r, 6 + c]
            for k in range(6):
                E[6 + r, 6 + c] -= T[6 + r, k] * elimination[k, 6 + c]
        g[6 + r] = force[6 + r]
        for k in range(6):
            g[6 + r] -= T[6 + r, k] * elimination[k, 12]
    for r in range(6):
        for c in range(6):
            E[r, 6 + c] = 0.0
            for k in range(6):
                E[r, c] -= A[r, k] * elimination[k, c]
                E[r, 6 + c] -= A[r, k] * elimination[k, 6 + c]
        for k in range(6):
            g[r] -= A[r, k] * elimination[k, 12]
    for r in range(6):
        for c in range(6):
            E[6 + r, c] = E[c, 6 + r]


@kernel
def _add_rods(ints, x, R, at_part, at_step, step, rod, offset, frame, loads, position, axes, wrench, gap,
              wrench_change, elimination, matrix, rhs):  # fmt: skip
    scratch, pose, Q, d, g0 = (
        allocate_rod_scratch(),
        np.empty(18),
        np.empty((3, 3)),
        np.empty(3),
        np.empty(ROD_LOADS),
    )
    K, lam, A, M = np.empty((6, 6)), np.empty(12), np.empty((6, 6)), np.empty((6, 12))
    T, force, E, g = np.empty((12, 12)), np.empty(12), np.empty((12, 12)), np.empty(12)
    for i in range(len(at_part) - 1):
        node = ints[MEMBER.node] + 2 * i
        a, b, first, last = ints[node], ints[node + 1], at_part[i], at_part[i + 1]
        has_loads = False
        for c in range(ROD_LOADS):
            has_loads = has_loads or loads[i, c] != 0.0
        g0[9] = loads[i, 9]
        for j in range(first, last):
            _part_pose(a, b, i, j, first, last, x, R, offset, frame, position, axes, pose, Q, d)
            for c in range(3):
                for k in range(0, 9, 3):
                    g0[k + c] = (
                        pose[c] * loads[i, k] + pose[3 + c] * loads[i, k + 1] + pose[6 + c] * loads[i, k + 2]
                    )
            integrate_rod(at_step[j], at_step[j + 1], step, rod, g0, wrench[j], d, Q, gap[j], scratch)
            length = 0.0
            for s in range(at_step[j], at_step[j + 1]):
                length += step[s]
            _close_part(scratch.y, gap[j], length, wrench_change[j], A, K, lam)
            member_tangent(pose, lam, K, T, force, A, M)
            if has_loads:
                _weight_force(pose, scratch.y, wrench[j], wrench_change[j], force)
            if j == first:
                E[:, :] = T
                g[:] = force
            else:
                _eliminate_station(E, g, T, force, elimination[j], A)
        scatter(
            ints,
            ints[MEMBER.block] + 4 * i,
            E,
            g,
            ints[ints[AT.start] + a],
            ints[ints[AT.start] + b],
            matrix,
            rhs,
        )


@kernel
def _node_motion(ints, step, node, motion):
    """Motion (6,) of a node in a step (unknowns,), into `motion`."""
    u = ints[ints[AT.start] + node]
    motion[:] = 0.0
    if u >= 0:
        for r in range(ints[DOFS_PER_NODE]):
            motion[ints[ints[AT.active_dofs] + r]] = step[u + r]


@kernel
def _move_rods(
    ints, x, R, at_part, offset, frame, position, axes, wrench, gap, wrench_change, elimination, closing, step
):
    """Kernel of `move_rods`."""
    pose, Q, d = np.empty(18), np.empty((3, 3)), np.empty(3)
    start, motion, next_motion, relative = np.empty(6), np.empty(6), np.empty(6), np.empty(3)
    for i in range(len(at_part) - 1):
        node = ints[MEMBER.node] + 2 * i
        a, b, first, last = ints[node], ints[node + 1], at_part[i], at_part[i + 1]
        _node_motion(ints, step, a, start)
        _node_motion(ints, step, b, next_motion)
        for j in range(last - 1, first - 1, -1):
            _part_pose(a, b, i, j, first, last, x, R, offset, frame, position, axes, pose, Q, d)
            for r in range(6):
                motion[r] = start[r]
                if j > first:
                    motion[r] = -elimination[j, r, 12]
                    for c in range(6):
                        motion[r] -= (
                            elimination[j, r, c] * start[c] + elimination[j, r, 6 + c] * next_motion[c]
                        )
            for r in range(3):
                k, l = (r + 1) % 3, (r + 2) % 3
                relative[r] = next_motion[r] - motion[r]
                relative[r] += next_motion[3 + k] * pose[12 + l] - next_motion[3 + l] * pose[12 + k]
                relative[r] -= motion[3 + k] * pose[9 + l] - motion[3 + l] * pose[9 + k]
            for c in range(3):
                closing[j, c], closing[j, 3 + c] = 0.0, 0.0
                for r in range(3):
                    closing[j, c] += pose[3 * r + c] * relative[r]
                    closing[j, 3 + c] += pose[3 * r + c] * (next_motion[3 + r] - motion[3 + r])
            for r in range(6):
                change = wrench_change[j, r, 6]
                for c in range(6):
                    change += wrench_change[j, r, c] * closing[j, c]
                wrench[j, r] += change
            for r in range(6):
                closing[j, r] += gap[j, r]
            if j < last - 1:
                for r in range(3):
                    position[j + 1, r] += next_motion[r]
                rotate(next_motion[3:], axes[j + 1])
                reorthonormalise(axes[j + 1])
            next_motion[:] = motion


def add_rods(ints: np.ndarray, x: np.ndarray, R: np.ndarray, rods: Rods, state: RodState, matrix: np.ndarray,
             rhs: np.ndarray) -> None:  # fmt: skip
    """Add tangent and forces of all rods to a block matrix and a residual, the nodes being at x (n, 3), R (n, 3, 3)."""
    _add_rods(ints, x, R, *rods, *state[:-1], matrix, rhs)


def move_rods(ints: np.ndarray, x: np.ndarray, R: np.ndarray, rods: Rods, state: RodState, step: np.ndarray
              ) -> None:  # fmt: skip
    """Take a Newton step (unknowns,) in the rods, in place, before it is taken at the nodes."""
    _move_rods(ints, x, R, rods.at_part, rods.offset, rods.frame, *state[1:], step)
