"""A small complementarity problem: contact forces between a few bodies whose compliance is known.

Unknown are the motions z of the bodies, and of every pair its force N and its friction forces T:

    motion    z - e0 - C (w + S z) = 0, w: all contact forces on the bodies at their moved poses
    normal    N >= 0, g + c N >= 0, and one of them is zero:  N - max(0, N - rho (g + c N)) = 0
    friction  T - P(T + rho s) = 0, P: onto |T| <= mu N+, N+ = max(0, N - rho (g + c N)); s: slip since the last equilibrium

e0: motion without contact, C: compliance, c: softness; S: stiffness that was added to bodies that nothing but contacts
holds, so that they have a compliance, and that is taken away here. It is solved by semismooth Newton with backtracking; rows
are lengths, divided by rho, the stiffness of the pair. What gap, slip and wrenches are, `ksd.model.gaps.touch` tells.
"""

from __future__ import annotations

import math

import numpy as np

from ksd.model.gaps import (
    BODIES,
    BODY_COUNT,
    DATA,
    FRICTION,
    FRICTIONS,
    GAP,
    SLIP,
    SOFTNESS,
    WRENCH,
    touch,
)
from ksd.numerics.elimination import solve_small
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotate

MAX_STEPS = 30
"""Steps of semismooth Newton from one start."""
HALVINGS = 10
"""How often a step is halved at most."""
MAX_RISES = 3
"""Steps in a row that may increase the rows."""
MAX_MOVE = 0.5
"""Largest motion of a body in one step, over the size of the mechanism, or in rad."""
TOLERANCE = 1e-13
"""Largest row, over the size of the mechanism, that is zero; a hundred times as much counts where steps no longer help."""
DIFFERENCE = 1e-7
"""Step of differences, over the size of the mechanism, or in rad."""
SWEEPS = 50
"""Sweeps of projected Gauss-Seidel for another start: of 160 random walks of 12 poses, four need it at a pose."""


@kernel
def unknown_count(pairs, motions):
    """Number of unknowns of a problem with so many motions of bodies."""
    count = motions
    for i in range(len(pairs)):
        count += 1 + pairs[i, FRICTIONS]
    return count


@kernel
def move_bodies(first, active, x, R, y, x_moved, R_moved):
    """Poses moved by y, whose motions of body k start at first[k] (-1 for a fixed body)."""
    spin, width = np.zeros(3), len(active)
    for k in range(len(first)):
        x_moved[k], R_moved[k] = x[k], R[k]
        if first[k] >= 0:
            spin[:] = 0.0
            for r in range(width):
                if active[r] < 3:
                    x_moved[k, active[r]] += y[first[k] + r]
                else:
                    spin[active[r] - 3] = y[first[k] + r]
            rotate(spin, R_moved[k])


@kernel
def pair_wrenches(pairs, bodies, first, active, forces, out, w):
    """Add the contact forces (pairs, 3) with the outputs `out` of `touch` to the wrenches w of the bodies, by motion."""
    for i in range(len(pairs)):
        for b in range(pairs[i, BODY_COUNT]):
            k = first[bodies[pairs[i, BODIES] + b]]
            if k >= 0:
                for r in range(len(active)):
                    at = WRENCH + 18 * b + 3 * active[r]
                    for c in range(1 + pairs[i, FRICTIONS]):
                        w[k + r] += out[i, at + c] * forces[i, c]


@kernel
def _rows(
    pairs, data, bodies, first, active, x, R, x_before, R_before, e0, C, S, rho, size, with_jacobian,
    y, out, moved, turned, F, J, M, w, trial, forces,
):  # fmt: skip
    """Rows F (n,), and their Jacobian J (n, n), at the unknowns y; returns the norm of F. See the module docstring."""
    motions, n, width = len(e0), len(y), len(active)
    move_bodies(first, active, x, R, y, moved, turned)
    w[:] = 0.0
    u = motions
    for i in range(len(pairs)):
        for c in range(3):
            forces[i, c] = y[u + c] if c <= pairs[i, FRICTIONS] else 0.0
        u += 1 + pairs[i, FRICTIONS]
        touch(pairs[i], data, bodies, moved, turned, x_before, R_before, out[i])
    pair_wrenches(pairs, bodies, first, active, forces, out, w)
    if with_jacobian:
        J[:, :] = 0.0
        M[:, :] = 0.0
    u = motions
    for i in range(len(pairs)):
        frictions, own = pairs[i, FRICTIONS], out[i]
        mu, soft = data[pairs[i, DATA] + FRICTION], data[pairs[i, DATA] + SOFTNESS]
        gap = own[GAP] + soft * forces[i, 0]
        push = forces[i, 0] - rho[i] * gap
        # at rest many contacts just touch, and count as closed
        closed, most = push > -TOLERANCE * size * rho[i], mu * max(0.0, push)
        slip, length = np.empty(2), 0.0
        for c in range(frictions):
            slip[c] = forces[i, 1 + c] + rho[i] * own[SLIP + c]
            length += slip[c] * slip[c]
        length = math.sqrt(length)
        sticks = length < most
        F[u] = gap if closed else forces[i, 0] / rho[i]
        for c in range(frictions):
            along = slip[c] / length if length > 0.0 else 0.0
            F[u + 1 + c] = -own[SLIP + c] if sticks else (forces[i, 1 + c] - most * along) / rho[i]
        if with_jacobian:
            # wrenches and normal row by the forces
            for b in range(pairs[i, BODY_COUNT]):
                k = first[bodies[pairs[i, BODIES] + b]]
                if k >= 0:
                    for r in range(width):
                        for c in range(1 + frictions):
                            M[k + r, u + c] += own[WRENCH + 18 * b + 3 * active[r] + c]
            J[u, u] = soft if closed else 1.0 / rho[i]
            for c in range(frictions):
                J[u + 1 + c, u + 1 + c] += 0.0 if sticks else 1.0 / rho[i]
                if not sticks and length > 0.0:
                    along = slip[c] / length
                    if closed:
                        J[u + 1 + c, u] -= mu * along * (1.0 / rho[i] - soft)
                    for d in range(frictions if frictions > 1 else 0):
                        across = ((1.0 if c == d else 0.0) - along * slip[d] / length) * most / length
                        J[u + 1 + c, u + 1 + d] -= across / rho[i]
            # by motions of the bodies, as differences
            for e in range(width * pairs[i, BODY_COUNT]):
                body = bodies[pairs[i, BODIES] + e // width]
                if first[body] < 0:
                    continue
                column, h = first[body] + e % width, DIFFERENCE * (size if active[e % width] < 3 else 1.0)
                y[column] += h
                keep_x, keep_R = moved[body].copy(), turned[body].copy()
                _move_body(first[body], active, x[body], R[body], y, moved[body], turned[body])
                touch(pairs[i], data, bodies, moved, turned, x_before, R_before, trial)
                moved[body], turned[body] = keep_x, keep_R
                y[column] -= h
                for k in range(len(own)):
                    trial[k] = (trial[k] - own[k]) / h
                if closed:
                    J[u, column] += trial[GAP]
                for c in range(frictions):
                    if sticks:
                        J[u + 1 + c, column] -= trial[SLIP + c]
                    elif length > 0.0:
                        along = slip[c] / length
                        if closed:
                            J[u + 1 + c, column] += mu * along * trial[GAP]
                        for d in range(frictions if frictions > 1 else 0):
                            across = ((1.0 if c == d else 0.0) - along * slip[d] / length) * most / length
                            J[u + 1 + c, column] -= across * trial[SLIP + d]
                for b2 in range(pairs[i, BODY_COUNT]):
                    k = first[bodies[pairs[i, BODIES] + b2]]
                    if k >= 0:
                        for r in range(width):
                            at = WRENCH + 18 * b2 + 3 * active[r]
                            for c in range(1 + frictions):
                                M[k + r, column] += trial[at + c] * forces[i, c]
        u += 1 + frictions
    total = 0.0
    for k in range(motions):
        scale = size if active[k % width] >= 3 else 1.0
        F[k] = y[k] - e0[k]
        for q in range(motions):
            F[k] -= C[k, q] * (w[q] + S[q] * y[q])
        F[k] *= scale
        if with_jacobian:
            for c in range(n):
                s = 1.0 if c == k else 0.0
                for q in range(motions):
                    s -= C[k, q] * (M[q, c] + (S[q] if q == c else 0.0))
                J[k, c] = s * scale
    for k in range(n):
        total += F[k] * F[k]
    return math.sqrt(total)


@kernel
def _move_body(at, active, x, R, y, moved, turned):
    """The pose of one body, see `move_bodies`."""
    spin = np.zeros(3)
    moved[:], turned[:, :] = x, R
    for r in range(len(active)):
        if active[r] < 3:
            moved[active[r]] += y[at + r]
        else:
            spin[active[r] - 3] = y[at + r]
    rotate(spin, turned)


@kernel
def _newton_step(J, F, step):
    """step <- -J^-1 F, in the least-squares sense where J is singular, as of redundant contacts."""
    n = len(F)
    A, B = J.copy(), np.empty((n, 1))
    for k in range(n):
        B[k, 0] = -F[k]
    solve_small(A, B)
    rest, norm = 0.0, 0.0
    for k in range(n):
        s = F[k]
        for c in range(n):
            s += J[k, c] * B[c, 0]
        rest += s * s
        norm += F[k] * F[k]
    if not rest <= 1e-12 * norm:
        # regularised normal equations with scaled columns
        scale = np.ones(n)
        for c in range(n):
            s = 0.0
            for k in range(n):
                s += J[k, c] * J[k, c]
            scale[c] = 1.0 / math.sqrt(s) if s > 0.0 else 1.0
        for c in range(n):
            B[c, 0] = 0.0
            for k in range(n):
                B[c, 0] -= scale[c] * J[k, c] * F[k]
            for d in range(n):
                s = 1e-11 if c == d else 0.0
                for k in range(n):
                    s += scale[c] * J[k, c] * J[k, d] * scale[d]
                A[c, d] = s
        solve_small(A, B)
        for c in range(n):
            B[c, 0] *= scale[c]
    for k in range(n):
        step[k] = B[k, 0]


@kernel
def solve_complementarity(
    pairs, data, bodies, first, active, x, R, x_before, R_before, e0, C, S, rho, size, y, out, w
):  # fmt: skip
    """Solve the problem from the unknowns y (n,), in place; returns (whether it is solved, norm of its rows [m], steps).

    pairs (m, 7), data, bodies: as `touch` reads them. first (k,): first motion of every body, -1 where it is fixed; active:
    which of x, y, z, rx, ry, rz move. x, R: poses; x_before, R_before: at the last equilibrium. e0 (q,), C (q, q): see the
    module docstring; S (q,): see there. rho (m,) [N/m]; size [m]: of the mechanism.
    out (m, ...): outputs of `touch` at the solution; w (q,): wrenches.
    """
    n, m, motions = len(y), len(pairs), len(e0)
    F, J, M, step, best = np.empty(n), np.empty((n, n)), np.empty((motions, n)), np.empty(n), np.empty(n)
    moved, turned, trial = np.empty_like(x), np.empty_like(R), np.empty(out.shape[1])
    forces, start = np.zeros((m, 3)), y.copy()
    norm, steps = math.inf, 0
    for attempt in range(3 if m > 1 else 2):
        if attempt > 0:
            y[:] = 0.0
        if attempt == 2:
            _sweep(
                pairs, data, bodies, first, active, x, R, x_before, R_before, e0, C, rho, y, out, moved, turned, w, forces
            )  # fmt: skip
        rises = 0
        for _ in range(MAX_STEPS):
            # comparisons, as literals would have `_rows` compiled once more for each
            norm = _rows(
                pairs, data, bodies, first, active, x, R, x_before, R_before, e0, C, S, rho, size, n > 0,
                y, out, moved, turned, F, J, M, w, trial, forces,
            )  # fmt: skip
            if norm <= TOLERANCE * size:
                return True, norm, steps
            if not math.isfinite(norm):
                break
            _newton_step(J, F, step)
            steps += 1
            least, best_scale, moves = math.inf, 1.0, 0.0
            for k in range(motions):
                moves = max(moves, abs(step[k]) / (1.0 if active[k % len(active)] >= 3 else size))
            scale = MAX_MOVE / moves if moves > MAX_MOVE else 1.0
            best[:] = y
            for _ in range(HALVINGS):
                for k in range(n):
                    y[k] = best[k] + scale * step[k]
                new = _rows(
                    pairs, data, bodies, first, active, x, R, x_before, R_before, e0, C, S, rho, size, n < 0,
                    y, out, moved, turned, F, J, M, w, trial, forces,
                )  # fmt: skip
                if new <= TOLERANCE * size:
                    return True, new, steps
                if new < least:
                    least, best_scale = new, scale
                if new < (1.0 - 0.1 * scale) * norm:
                    break
                scale *= 0.5
            for k in range(n):
                y[k] = best[k] + best_scale * step[k]
            rises = rises + 1 if least > norm else 0
            if not math.isfinite(least) or rises > MAX_RISES:
                break
            if least >= 0.5 * norm and norm <= 100.0 * TOLERANCE * size:
                # rounding: the better of both
                y[:] = best if least >= norm else y
                norm = _rows(
                    pairs, data, bodies, first, active, x, R, x_before, R_before, e0, C, S, rho, size, n < 0,
                    y, out, moved, turned, F, J, M, w, trial, forces,
                )  # fmt: skip
                return True, norm, steps
    y[:] = start
    return False, norm, steps


@kernel
def _sweep(
    pairs, data, bodies, first, active, x, R, x_before, R_before, e0, C, rho, y, out, moved, turned, w, forces
):  # fmt: skip
    """Projected Gauss-Seidel: forces of one pair after the other by its own compliance, as another start for Newton."""
    motions = len(e0)
    y[:motions] = e0
    for _ in range(SWEEPS):
        u = motions
        for i in range(len(pairs)):
            frictions = pairs[i, FRICTIONS]
            move_bodies(first, active, x, R, y, moved, turned)
            touch(pairs[i], data, bodies, moved, turned, x_before, R_before, out[i])
            gap = out[i, GAP] + data[pairs[i, DATA] + SOFTNESS] * y[u]
            y[u] = max(0.0, y[u] - rho[i] * gap)
            most, length = data[pairs[i, DATA] + FRICTION] * y[u], 0.0
            for c in range(frictions):
                y[u + 1 + c] += rho[i] * out[i, SLIP + c]
                length += y[u + 1 + c] ** 2
            length = math.sqrt(length)
            for c in range(frictions):
                y[u + 1 + c] *= most / length if length > most else 1.0
            for c in range(3):
                forces[i, c] = y[u + c] if c <= frictions else 0.0
            w[:] = 0.0
            pair_wrenches(pairs, bodies, first, active, forces, out, w)
            for k in range(motions):
                y[k] = e0[k]
                for q in range(motions):
                    y[k] += C[k, q] * w[q]
            u += 1 + frictions
