"""Compiled parts of a Newton iteration with contact: contact forces as loads, compliance of the touched nodes, and the step.

See `ksd.solvers.contact_newton`. Arguments by these names: ints: of `Arrays`, plan: of its `Blocks`; pairs, data, bodies:
tables of `ksd.model.gaps`; nodes (k,): of the bodies; first (k,): first motion of every body, -1 where it is fixed; active:
which of x, y, z, rx, ry, rz move; unknowns (q,): of the motions; block (b,): start of the diagonal block of every moving
body in the matrix; forces (m, 3) [N]; out (m, ...): outputs of `touch`; spring (q,): stiffness that is added to the motions,
zero unless they need one.
"""

from __future__ import annotations

import math

import numpy as np

from ksd.model.complementarity import move_bodies, pair_wrenches, solve_complementarity, unknown_count
from ksd.model.gaps import BODIES, BODY_COUNT, DATA, FRICTION, FRICTIONS, GAP, SOFTNESS, WRENCH, touch
from ksd.model.newton import _largest
from ksd.numerics.blocks import BLOCKS, factor_blocks, solve_blocks
from ksd.numerics.kernel import kernel

WEAK_TANGENT = 1e-9
"""Relative pivot below which the touched nodes get a stiffness."""
HELD = 1e-12
"""Compliance of a motion that supports hold, over the largest one, at most."""
SLIPPING = 1e-9
"""Share of the friction that is left, up to which a contact counts as slipping."""


@kernel
def look_at_gaps(pairs, data, bodies, nodes, x, R, x_before, R_before, out):
    """Evaluate all pairs at the poses of the nodes; returns the smallest gap [m]. x_before, R_before: at the last
    equilibrium, which is this state where they are empty."""
    x_now, R_now, least = x[nodes], R[nodes], math.inf
    x_last, R_last = (x_before, R_before) if len(x_before) > 0 else (x_now, R_now)
    for i in range(len(pairs)):
        touch(pairs[i], data, bodies, x_now, R_now, x_last, R_last, out[i])
        least = min(least, out[i, GAP])
    return least


@kernel
def load_contacts(
    pairs, data, bodies, nodes, first, active, x, R, x_before, R_before, factor, tolerance, forces, out, push, turn
):  # fmt: skip
    """`look_at_gaps`, and write the contact forces over `factor` into the loads push, turn (b, 3).

    Returns whether no pair overlaps and closed ones touch, within `tolerance` [m].
    """
    look_at_gaps(pairs, data, bodies, nodes, x, R, x_before, R_before, out)
    push[:, :], turn[:, :] = 0.0, 0.0
    closed = True
    for i in range(len(pairs)):
        gap = out[i, GAP] + data[pairs[i, DATA] + SOFTNESS] * forces[i, 0]
        if gap < -tolerance or (forces[i, 0] > 0.0 and gap > tolerance):
            closed = False
        for b in range(pairs[i, BODY_COUNT]):
            k = first[bodies[pairs[i, BODIES] + b]]
            if k >= 0:
                k //= len(active)
                for r in range(3):
                    at = WRENCH + 18 * b + 3 * r
                    for c in range(1 + pairs[i, FRICTIONS]):
                        push[k, r] += out[i, at + c] * forces[i, c] / factor
                        turn[k, r] += out[i, at + 9 + c] * forces[i, c] / factor
    return closed


@kernel
def touched_compliance(plan, matrix, spare, unknowns, block, active, stiff, size, spring, X, C):
    """Factor the assembled tangent, with a stiffness on the touched nodes where they need one, and write X = K^-1 E (q, n)
    and the compliance C (q, q) of the motions; returns negative pivots and the smallest pivot."""
    count, width = len(unknowns), len(active)
    needs = False
    for k in range(count):
        needs = needs or spring[k] > 0.0
    negatives, pivot = 0, 0.0
    if not needs:
        stored = matrix.copy()
        negatives, pivot = factor_blocks(plan, matrix, spare, plan[BLOCKS])
        if not pivot > WEAK_TANGENT:
            needs = True
            matrix[:] = stored
            for k in range(count):
                spring[k] = stiff * (1.0 if active[k % width] < 3 else size * size)
    if needs:
        for k in range(count):
            matrix[block[k // width] + (width + 1) * (k % width)] += spring[k]
        negatives, pivot = factor_blocks(plan, matrix, spare, plan[BLOCKS])
    X[:, :] = 0.0
    for k in range(count):
        X[k, unknowns[k]] = 1.0
        solve_blocks(plan, matrix, spare, X[k])
    for k in range(count):
        for c in range(count):
            C[k, c] = X[c, unknowns[k]]
    return negatives, pivot


@kernel
def contact_step(
    ints, plan, matrix, spare, rhs, unknowns, block, active, first, pairs, data, bodies, nodes, x, R, x_before, R_before,
    size, stiff, spring, forces, out,
):  # fmt: skip
    """Turn the assembled residual `rhs` into the Newton step, with the contact forces of the small problem.

    Returns whether the tangent is regular, whether the small problem was solved, and the largest rotation [rad] and
    displacement [m] of a node in the step.
    """
    q, m = len(unknowns), len(pairs)
    X, C = np.empty((q, len(rhs))), np.empty((q, q))
    w_before, w, e0 = np.zeros(q), np.zeros(q), np.empty(q)
    pair_wrenches(pairs, bodies, first, active, forces, out, w_before)
    for k in range(len(rhs)):
        rhs[k] = -rhs[k]
    _, pivot = touched_compliance(plan, matrix, spare, unknowns, block, active, stiff, size, spring, X, C)
    regular, solved = pivot > 0.0, False
    if regular:
        solve_blocks(plan, matrix, spare, rhs)
        for k in range(q):
            e0[k] = rhs[unknowns[k]]
            for c in range(q):
                e0[k] -= C[k, c] * w_before[c]
        y, rho = np.zeros(unknown_count(pairs, q)), np.zeros(m)
        _pair_stiffness(pairs, bodies, first, active, C, out, rho)
        u = q
        for i in range(m):
            for c in range(1 + pairs[i, FRICTIONS]):
                y[u + c] = forces[i, c]
            u += 1 + pairs[i, FRICTIONS]
        solved, _, _ = solve_complementarity(
            pairs, data, bodies, first, active, x[nodes], R[nodes], x_before, R_before, e0, C, spring, rho, size, y, out, w
        )  # fmt: skip
        u = q
        for i in range(m):
            forces[i] = 0.0
            gap = out[i, GAP] + data[pairs[i, DATA] + SOFTNESS] * y[u]
            # an open contact has no force, not even one of rounding
            if y[u] - rho[i] * gap > 0.0:
                for c in range(1 + pairs[i, FRICTIONS]):
                    forces[i, c] = y[u + c]
            u += 1 + pairs[i, FRICTIONS]
        for k in range(q):
            more = w[k] + spring[k] * y[k] - w_before[k]
            if more != 0.0:
                for c in range(len(rhs)):
                    rhs[c] += more * X[k, c]
    # no literals, for which numba would compile the function once more
    return regular, solved, _largest(ints, rhs, 3 + 0 * q), _largest(ints, rhs, 0 * q)


@kernel
def _pair_stiffness(pairs, bodies, first, active, C, out, rho):
    """Stiffness rho (m,) of every pair against its forces: 1 over the trace of its compliance."""
    unit, largest = np.empty(len(C)), 0.0
    for i in range(len(pairs)):
        trace = 0.0
        for c in range(1 + pairs[i, FRICTIONS]):
            unit[:] = 0.0
            for b in range(pairs[i, BODY_COUNT]):
                k = first[bodies[pairs[i, BODIES] + b]]
                if k >= 0:
                    for r in range(len(active)):
                        unit[k + r] += out[i, WRENCH + 18 * b + 3 * active[r] + c]
            for k in range(len(C)):
                for q in range(len(C)):
                    trace += unit[k] * C[k, q] * unit[q]
        # negative where the tangent without contact is unstable
        rho[i] = 1.0 / abs(trace) if trace != 0.0 else 0.0
        largest = max(largest, rho[i])
    for i in range(len(pairs)):
        if rho[i] == 0.0:
            rho[i] = largest if largest > 0.0 else 1.0


@kernel
def stability_matrix(
    pairs, data, bodies, nodes, first, active, x, R, x_before, R_before, size, forces, out, spring, C
):  # fmt: skip
    """The matrix (2 q + c,) of motions, of multipliers that tie them to the mechanism, and of c directions held by contacts,
    whose negative eigenvalues tell stability: see `ksd.solvers.contact_newton.ContactNewton.check`; and whether it is stable
    where the tangent without contact forces is. C (q, q): compliance."""
    count, q, width, held = 0, len(C), len(active), np.zeros(len(pairs), np.int64)
    for i in range(len(pairs)):
        friction, drag = data[pairs[i, DATA] + FRICTION] * forces[i, 0], 0.0
        for c in range(pairs[i, FRICTIONS]):
            drag += forces[i, 1 + c] ** 2
        # one that sticks is held along its tangents too
        held[i] = 1 if forces[i, 0] > 0.0 else 0
        if friction > 0.0 and math.sqrt(drag) < (1.0 - SLIPPING) * friction:
            held[i] += pairs[i, FRICTIONS]
        count += held[i]
    small, unit = np.zeros((2 * q + count, 2 * q + count)), np.empty(q)
    # in units in which compliances are of the order of 1, those of held motions, which are rounding, below
    largest = np.full(2, 1e-300)
    for k in range(q):
        kind = 0 if active[k % width] < 3 else 1
        largest[kind] = max(largest[kind], abs(C[k, k]))
    for k in range(q):
        unit[k] = math.sqrt(max(abs(C[k, k]), HELD * largest[0 if active[k % width] < 3 else 1]))
    row = 2 * q
    for i in range(len(pairs)):
        for e in range(held[i]):
            norm = 1e-300
            for b in range(pairs[i, BODY_COUNT]):
                k = first[bodies[pairs[i, BODIES] + b]]
                if k >= 0:
                    for r in range(width):
                        small[row, k + r] += unit[k + r] * out[i, WRENCH + 18 * b + 3 * active[r] + e]
            for k in range(q):
                norm += small[row, k] ** 2
            for k in range(q):
                small[row, k] /= math.sqrt(norm)
                small[k, row] = small[row, k]
            small[row, row] = -data[pairs[i, DATA] + SOFTNESS] / norm if e == 0 else 0.0
            row += 1
    # stiffness of contact forces of constant size: minus the derivative of their wrenches by the motions
    trial, y, w = np.empty_like(out), np.zeros(q), np.empty((2, q))
    x_now, R_now = x[nodes], R[nodes]
    moved, turned = x_now.copy(), R_now.copy()
    for k in range(q):
        h = 1e-6 * (size if active[k % width] < 3 else 1.0)
        for side in range(2):
            y[k] = h if side == 0 else -h
            move_bodies(first, active, x_now, R_now, y, moved, turned)
            for i in range(len(pairs)):
                trial[i] = 0.0
                if forces[i, 0] > 0.0:
                    touch(pairs[i], data, bodies, moved, turned, x_before, R_before, trial[i])
            w[side] = 0.0
            pair_wrenches(pairs, bodies, first, active, forces, trial, w[side])
        y[k] = 0.0
        for r in range(q):
            half = 0.5 * unit[k] * unit[r] * (w[1, r] - w[0, r]) / (2.0 * h)
            small[r, k] += half
            small[k, r] += half
        small[k, k] -= spring[k] * unit[k] ** 2
        small[k, q + k], small[q + k, k] = -1.0, -1.0
        for c in range(q):
            small[q + k, q + c] = -0.5 * (C[k, c] + C[c, k]) / (unit[k] * unit[c])
    # the tangent with contact forces of constant size is positive where that without is, and |C| |G| < 1
    stiffness, compliance = 0.0, 0.0
    for k in range(q):
        for c in range(q):
            stiffness += small[k, c] ** 2
            compliance += small[q + k, q + c] ** 2
    return small, stiffness * compliance < 1.0
