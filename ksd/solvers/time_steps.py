"""Time steps, compiled: every step is a static problem with springs to known places (`ksd.elements.inertia`).

Places q are the positions and orientation matrices of the nodes, the modes of the centreline of every leaf, and, for
dashpots and material damping, relative motions and amplitudes. With c0 = (1 - am) / (dt^2 beta (1 - af)), the generalised
alpha method in the form of Arnold and Bruels (2007) is q'' = c0 (q - q^) at the new instant, with

    q^ = q + dt v + dt^2 (1/2 - beta) a + dt^2 beta (af q'' - am a) / (1 - am)
    a_new = ((1 - af) q''_new + af q'' - am a) / (1 - am),    v_new = v + dt ((1 - gamma) a + gamma a_new)

and a dashpot is a spring of stiffness d c1, c1 = gamma / (beta dt), to q~ - v~ / c1, where q~ and v~ are q^ and v_new with
a_new = 0. A history (4, p) has q, v, a and q''. The orientation matrices of bodies have nine entries as places; after every
step their rates are made those of a rotation, with the same angular momentum.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ksd.elements import planar_leaf
from ksd.elements.inertia import inertia_places
from ksd.elements.strain import strain_energy
from ksd.model.arrays import (
    AT,
    BODIES,
    BODY,
    DOFS_PER_NODE,
    LEAF_COUNT,
    LOAD,
    LOADS,
    MEMBER,
    NODES,
    PLANAR,
    ROWS,
    SETTINGS,
    STRAIN,
    TERM,
)
from ksd.model.assembly import allocate_leaf_scratch
from ksd.model.loading import term_slope
from ksd.model.newton import CONVERGED, FULL_STEP, SOLVE, newton_motion
from ksd.model.turns import add_rotations
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import reorthonormalise, rotate, rotation_log

SCALARS = 8
"""Numbers per step: kinetic and strain energy [J], power of dashpots and of material damping [W], first moment of all mass
(3) [kg m], iterations."""


class Step(NamedTuple):
    """Coefficients of a step: `known` (4,) those of q^ and `resisted` (4,), `rate` (4,) those of q~ and v~, by q, v, a, q''.

    am, af, gamma: of the update of a history; dt [s].
    """

    c0: float
    c1: float
    known: tuple[float, float, float, float]
    resisted: tuple[float, float, float, float]
    rate: tuple[float, float, float, float]
    am: float
    af: float
    gamma: float
    dt: float

    @property
    def flat(self) -> np.ndarray:
        """All numbers (18,)."""
        return np.array(
            [self.c0, self.c1, *self.known, *self.resisted, *self.rate, self.am, self.af, self.gamma, self.dt]
        )


def generalised_alpha(dt: float, rho: float) -> Step:
    """The step of generalised alpha with spectral radius rho at infinite frequency."""
    am, af = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
    gamma = 0.5 + af - am
    beta = 0.25 * (gamma + 0.5) ** 2
    free, old = dt**2 * (0.5 - beta), dt**2 * beta / (1.0 - am)
    return Step(
        (1.0 - am) / (dt**2 * beta * (1.0 - af)), gamma / (beta * dt), (1.0, dt, free - am * old, af * old),
        (1.0, dt, free, 0.0), (0.0, 1.0, dt * (1.0 - gamma), 0.0), am, af, gamma, dt,
    )  # fmt: skip


def first_acceleration(h: float) -> Step:
    """A tiny step from places and speeds alone, whose q'' is that at its end; a holds q''' or zero."""
    known = (1.0, h, -(h**3) / 3.0, 0.0)
    return Step(2.0 / h**2, 2.0 / h, known, known, (0.0, 1.0, 0.0, 0.0), 0.0, 0.0, 0.5, h)


def second_acceleration(h: float) -> Step:
    """A small step from places, speeds and q'', exact for a constant q'''."""
    known = (1.0, h, 0.0, h**2 / 3.0)
    return Step(6.0 / h**2, 3.0 / h, known, known, (0.0, 1.0, 0.0, 0.5 * h), 0.0, 0.0, 0.5, h)


def impulse(h: float) -> Step:
    """A tiny step after which (q - q_before) / h are the speeds nearest to v that the constraints allow."""
    known = (1.0, h, 0.0, 0.0)
    return Step(1.0 / h**2, 0.0, known, known, (0.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.5, h)


@kernel
def count_places(ints, tau):
    """Number of places."""
    count = 12 * ints[NODES]
    for i in range(ints[LEAF_COUNT]):
        number = ints[MEMBER.number] + SETTINGS * i
        count += 3 * (ints[number + 5] + ints[number + 6])
        if tau[i] > 0.0:
            count += _modes_of(ints, i)
    for i in range(ints[ROWS]):
        count += ints[ints[TERM.start] + i] < 0
    return count


@kernel
def _modes_of(ints, i):
    """Number of amplitudes of member i."""
    number = ints[MEMBER.number] + SETTINGS * i
    if ints[ints[MEMBER.kind] + i] == PLANAR:
        return ints[number + 3]
    return ints[number] + ints[number + 1] + ints[number + 2]


@kernel
def _write_known(ints, floats, inner, target, tau, gravity, push, step, history, known):
    """Write the known places of a step, known (2, p) = q^ and those of dashpots, into the model; gravity (3,) [m/s^2]; push
    (p,) [m/s^2]: what line loads do to the modes of leaf springs."""
    c0, c1, count = step[0], step[1], history.shape[1]
    for p in range(count):
        for e in range(2):
            s = 0.0
            for k in range(4):
                s += step[2 + 4 * e + k] * history[k, p]
            known[e, p] = s
        s = 0.0
        for k in range(4):
            s += step[10 + k] * history[k, p]
        known[1, p] -= s / c1 if c1 > 0.0 else 0.0
    floats[ints[AT.rates]], floats[ints[AT.rates] + 1] = c0, c1
    at, to = 12 * ints[NODES], ints[AT.known]
    for p in range(at):
        floats[to + p] = known[0, p] + (gravity[p % 12] / c0 if p % 12 < 3 else 0.0)
    active, w = ints[AT.active_dofs], ints[DOFS_PER_NODE]
    for i in range(ints[LEAF_COUNT]):
        number, N = ints[MEMBER.number] + SETTINGS * i, _modes_of(ints, i)
        modes, start = ints[number + 5] + ints[number + 6], ints[ints[MEMBER.inner_at] + i]
        place = start + N + 6 + 3 * modes
        for k in range(modes):
            for r in range(3):
                inner[place + 3 * k + r] = 0.0
            for u in range(w):
                r = ints[active + u]
                if r < 3:
                    shift = push[at + 3 * k + r] + (gravity[r] if k == 0 else 0.0)
                    inner[place + 3 * k + r] = known[0, at + 3 * k + r] + shift / c0
        at += 3 * modes
        if modes > 0 and tau[i] > 0.0:
            inner[place + 3 * modes] = tau[i] * c1
            for k in range(N):
                inner[place + 3 * modes + 1 + k] = known[1, at + k]
            at += N
    for i in range(ints[ROWS]):
        if ints[ints[TERM.start] + i] < 0:
            # the multiplier of a drive that is let go pulls as a weak dashpot from far away
            far, weak = target[i], c1 * floats[ints[TERM.damping] + i]
            target[i] = known[1, at] - (far / weak if weak > 0.0 else 0.0)
            at += 1


@kernel
def _read_places(ints, floats, x, R, inner, angle, tau, gravity, push, step, known, q):
    """Write the places q (p,) after a step; those of leaf modes follow from their forces."""
    c0, at = step[0], 12 * ints[NODES]
    for k in range(ints[NODES]):
        for r in range(3):
            q[12 * k + r] = x[k, r]
            for c in range(3):
                q[12 * k + 3 + 3 * r + c] = R[k, r, c]
    for i in range(ints[LEAF_COUNT]):
        number, N = ints[MEMBER.number] + SETTINGS * i, _modes_of(ints, i)
        modes, start = ints[number + 5] + ints[number + 6], ints[ints[MEMBER.inner_at] + i]
        for k in range(3 * modes):
            shift = push[at + k] + (gravity[k] if k < 3 else 0.0)
            q[at + k] = known[0, at + k] + (shift - inner[start + N + 6 + k]) / c0
        at += 3 * modes
        if modes > 0 and tau[i] > 0.0:
            for k in range(N):
                q[at + k] = inner[start + k]
            at += N
    slope = np.empty((8, 3))
    for i in range(ints[ROWS]):
        if ints[ints[TERM.start] + i] < 0:
            t = ints[ints[TERM.first] + i]
            q[at] = floats[ints[TERM.coefficient] + t] * term_slope(ints, floats, x, R, angle, t, slope)
            at += 1


@kernel
def start_places(ints, floats, x, R, inner, angle, tau, flat, at, q):
    """Write the places q (p,) of a state that was assembled."""
    none = np.zeros(max(3, len(q)))
    _read_places(ints, floats, x, R, inner, angle, tau, none, none, np.ones(1), np.zeros((1, len(q))), q)
    store_at, pose_at, to = at[2], at[4], 12 * ints[NODES]
    # poses (m, 18) are before the last two parts of the workspace
    for i in range(ints[LEAF_COUNT]):
        number, N = ints[MEMBER.number] + SETTINGS * i, _modes_of(ints, i)
        modes, kind = ints[number + 5] + ints[number + 6], ints[ints[MEMBER.kind] + i]
        if modes > 0:
            D, pose = 3 * modes, flat[pose_at + 18 * i : pose_at + 18 * i + 18]
            end = store_at + ints[ints[MEMBER.store_at] + i + 1]
            s = flat[end - D * (10 + D) + 2 * D : end]
            value = floats[ints[MEMBER.value] + ints[ints[MEMBER.value_at] + i] :]
            _, c_at = inertia_places(ints[number : number + SETTINGS], kind == PLANAR)
            a = ints[ints[MEMBER.node] + 2 * i]
            for k in range(modes):
                for r in range(3):
                    place = value[c_at + k] * (x[a, r] + pose[9 + r] - pose[15 + r])
                    for e in range(3):
                        place += pose[3 * r + e] * s[3 * k + e]
                    q[to + 3 * k + r] = place / value[c_at + modes + k]
            to += D
            if tau[i] > 0.0:
                to += N


@kernel
def _update(ints, step, body, history, known, q):
    """Advance the history (4, p) to the new places q (p,)."""
    c0, am, af = step[0], step[14], step[15]
    gamma, dt = step[16], step[17]
    for p in range(len(q)):
        new = c0 * (q[p] - known[0, p])
        a = ((1.0 - af) * new + af * history[3, p] - am * history[2, p]) / (1.0 - am)
        history[1, p] += dt * ((1.0 - gamma) * history[2, p] + gamma * a)
        history[0, p], history[2, p], history[3, p] = q[p], a, new
    v, w = np.empty(9), np.empty(3)
    for k in range(1, ints[NODES]):
        own = 12 * k
        _angular_speed(history, own, body[k], v, w)
        for r in range(3):
            a, b, c = history[0, own + 3 + 3 * r], history[0, own + 4 + 3 * r], history[0, own + 5 + 3 * r]
            # R [w]x
            v[3 * r], v[3 * r + 1], v[3 * r + 2] = (
                b * w[2] - c * w[1],
                c * w[0] - a * w[2],
                a * w[1] - b * w[0],
            )
        for r in range(3):
            for c in range(3):
                rate = history[1, own + 3 + 3 * r + c]
                # the centre of mass keeps its speed
                history[1, own + r] += (rate - v[3 * r + c]) * body[k, 18 + c]
                history[1, own + 3 + 3 * r + c] = v[3 * r + c]


@kernel
def _angular_speed(history, own, body, v, w):
    """Write the angular speed w (3,), in node axes, of the angular momentum of rates of an orientation matrix; v (9,):
    scratch."""
    for i in range(3):
        for j in range(3):
            s = 0.0
            for r in range(3):
                s += history[0, own + 3 + 3 * r + i] * history[1, own + 3 + 3 * r + j]
            v[3 * i + j] = s
    # M = R^T V P less its transpose
    for r in range(3):
        w[r] = 0.0
        for e in range(3):
            j, k, m = (e + 1) % 3, (e + 2) % 3, 0.0
            for l in range(3):
                m += v[3 * k + l] * body[3 * l + j] - v[3 * j + l] * body[3 * l + k]
            w[r] += body[9 + 3 * r + e] * m


@kernel
def _predict(ints, floats, x, R, inner, angle, history, dt, past_x, past_R, past_inner, known_past):
    """Move nodes and amplitudes on as in the last steps; past_x (2, k, 3) and so on: of the last instant and the one before,
    of which `known_past` are known."""
    spin, v, w = np.zeros((ints[NODES], 3)), np.empty(3), np.empty(3)
    M = np.empty((3, 3))
    for k in range(ints[NODES]):
        if ints[ints[AT.start] + k] < 0:
            continue
        for r in range(3):
            if known_past == 2:
                x[k, r] += 2.0 * (x[k, r] - past_x[0, k, r]) - (past_x[0, k, r] - past_x[1, k, r])
            elif known_past == 1:
                x[k, r] += x[k, r] - past_x[0, k, r]
            else:
                x[k, r] += dt * history[1, 12 * k + r]
        if known_past == 0:
            for r in range(3):
                i, j, s = (r + 1) % 3, (r + 2) % 3, 0.0
                for c in range(3):
                    s += (
                        history[1, 12 * k + 3 + 3 * j + c] * R[k, i, c]
                        - history[1, 12 * k + 3 + 3 * i + c] * R[k, j, c]
                    )
                spin[k, r] = 0.5 * dt * s
        else:
            for i in range(3):
                for j in range(3):
                    M[i, j] = (
                        R[k, i, 0] * past_R[0, k, j, 0]
                        + R[k, i, 1] * past_R[0, k, j, 1]
                        + R[k, i, 2] * past_R[0, k, j, 2]
                    )
            rotation_log(M, v)
            w[:] = v
            if known_past == 2:
                for i in range(3):
                    for j in range(3):
                        M[i, j] = (
                            past_R[0, k, i, 0] * past_R[1, k, j, 0]
                            + past_R[0, k, i, 1] * past_R[1, k, j, 1]
                            + past_R[0, k, i, 2] * past_R[1, k, j, 2]
                        )
                rotation_log(M, w)
            for r in range(3):
                spin[k, r] = 2.0 * v[r] - w[r]
    add_rotations(ints, floats, R, angle, spin)
    for k in range(ints[NODES]):
        if ints[ints[AT.start] + k] >= 0:
            rotate(spin[k], R[k])
            reorthonormalise(R[k])
    for i in range(ints[LEAF_COUNT]):
        kind, first = ints[ints[MEMBER.kind] + i], ints[ints[MEMBER.inner_at] + i]
        if kind in (PLANAR, STRAIN):
            for k in range(first, first + _modes_of(ints, i)):
                if known_past == 2:
                    inner[k] += 2.0 * (inner[k] - past_inner[0, k]) - (past_inner[0, k] - past_inner[1, k])
                elif known_past == 1:
                    inner[k] += inner[k] - past_inner[0, k]


@kernel
def _measure(ints, floats, x, R, inner, tau, history, flat, at, leaf, out):
    """Write the numbers `SCALARS` of an instant, without the iterations, into out."""
    out[:] = 0.0
    for i in range(ints[BODIES]):
        k, body = ints[ints[BODY.node] + i], ints[BODY.inertia] + 13 * i
        own, mass = 12 * k, floats[body]
        for r in range(3):
            v, place = history[1, own + r], x[k, r]
            for c in range(3):
                v += history[1, own + 3 + 3 * r + c] * floats[body + 1 + c]
                place += R[k, r, c] * floats[body + 1 + c]
                for e in range(3):
                    out[0] += (
                        0.5
                        * history[1, own + 3 + 3 * r + c]
                        * floats[body + 4 + 3 * c + e]
                        * history[1, own + 3 + 3 * r + e]
                    )
            out[0] += 0.5 * mass * v * v
            out[4 + r] += mass * place
    to, store_at = 12 * ints[NODES], at[2]
    for i in range(ints[LEAF_COUNT]):
        number, kind = ints[MEMBER.number] + SETTINGS * i, ints[ints[MEMBER.kind] + i]
        if kind != PLANAR and kind != STRAIN:
            continue
        modes, N = ints[number + 5] + ints[number + 6], _modes_of(ints, i)
        settings = ints[number : number + SETTINGS]
        value = floats[ints[MEMBER.value] + ints[ints[MEMBER.value_at] + i] :]
        state = inner[ints[ints[MEMBER.inner_at] + i] : ints[ints[MEMBER.inner_at] + i + 1]]
        store = flat[
            store_at + ints[ints[MEMBER.store_at] + i] : store_at + ints[ints[MEMBER.store_at] + i + 1]
        ]
        if kind == PLANAR:
            out[1] += planar_leaf.strain_energy(value, settings, state, store)
        else:
            out[1] += strain_energy(value, settings, state, store, leaf)
        if modes > 0:
            _, c_at = inertia_places(settings, kind == PLANAR)
            for k in range(modes):
                for r in range(3):
                    out[0] += 0.5 * value[c_at + modes + k] * history[1, to + 3 * k + r] ** 2
            for r in range(3):
                out[4 + r] += value[c_at + modes] * history[0, to + r]
            to += 3 * modes
            if tau[i] > 0.0:
                # K is stored in blocks per axis, in the plane that of weak bending alone
                first, last, block = 0, settings[0], 1
                if kind == PLANAR:
                    first, last, block = settings[2], settings[2] + settings[0], 0
                for axis in range(1 if kind == PLANAR else 3):
                    if axis > 0:
                        first, last = last, last + settings[axis]
                    for k in range(first, last):
                        for l in range(first, last):
                            out[3] += tau[i] * history[1, to + k] * value[block] * history[1, to + l]
                            block += 1
                to += N
    for i in range(ints[ROWS]):
        if ints[ints[TERM.start] + i] < 0:
            out[2] += floats[ints[TERM.damping] + i] * history[1, to] ** 2
            to += 1


@kernel
def march(
    ints, floats, x, R, inner, multiplier, angle, flat, at, history, known, q, body, tau, step, past_x, past_R, past_inner,
    known_past, targets, factors, gravities, forces, moments, lines, states, speeds, accelerations, scalars, keep, max_steps,
    rtol,
):  # fmt: skip
    """As many time steps as `targets` (n, c) has rows, from the state x, R, .. with its history (4, p), in place.

    factors (n, l + m): of the loads forces, moments (l, 3), and of the line loads lines (2, m, p), accelerations [m/s^2] and
    forces of the modes of leaf springs; gravities (n, 3) [m/s^2]: at the ends of the steps. keep: 1 where
    the steps are taken, 0 where only q (p,) and `known` of one step are wanted. states (n, s), speeds, accelerations (n, 12
    k) of the nodes and scalars (n, SCALARS + m), with
    the forces of the line loads times places [J] last, are written. Returns (steps taken, reason of `newton` of the last
    one).
    """
    bx, bR, binner = x.copy(), R.copy(), inner.copy()
    bmultiplier, bangle = multiplier.copy(), angle.copy()
    leaf, reason, done = allocate_leaf_scratch(ints), CONVERGED, 0
    target, sizes, push = np.empty(targets.shape[1]), np.zeros(6, np.int64), np.empty(len(q))
    # numbers of an array, as literals would have `newton_motion` compiled once more for each
    tasks = np.array([[FULL_STEP, 0, 1], [SOLVE, 0, max_steps]])
    parts = (x.size, R.size, inner.size, multiplier.size, angle.size)
    for k in range(5):
        sizes[k + 1] = sizes[k] + parts[k]
    while done < len(targets) and reason == CONVERGED:
        target[:] = targets[done]
        for i in range(ints[LOADS]):
            for r in range(3):
                floats[ints[LOAD.force] + 3 * i + r] = factors[done, i] * forces[i, r]
                floats[ints[LOAD.moment] + 3 * i + r] = factors[done, i] * moments[i, r]
        push[:] = 0.0
        for i in range(lines.shape[1]):
            for p in range(len(push)):
                push[p] += factors[done, ints[LOADS] + i] * lines[0, i, p]
        _write_known(ints, floats, inner, target, tau, gravities[done], push, step, history, known)
        bx[:], bR[:], binner[:] = x, R, inner
        bmultiplier[:], bangle[:] = multiplier, angle
        iterations = 0
        for attempt in range(2):
            if attempt == 0:
                _predict(
                    ints,
                    floats,
                    x,
                    R,
                    inner,
                    angle,
                    history,
                    step[17],
                    past_x,
                    past_R,
                    past_inner,
                    known_past,
                )
            # a tiny step may be less than the tolerance of constraints: a full one goes before it
            for task in range(keep, 2):
                reason, n, _, _, _ = newton_motion(
                    ints, floats, x, R, inner, multiplier, angle, target, flat, at, tasks[task, 0], tasks[task, 1],
                    tasks[task, 2], 1.0, rtol, 10.0, 0.5, math.inf,
                )  # fmt: skip
            iterations += n
            if reason == CONVERGED:
                break
            x[:], R[:], inner[:] = bx, bR, binner
            multiplier[:], angle[:] = bmultiplier, bangle
        if reason == CONVERGED:
            _read_places(ints, floats, x, R, inner, angle, tau, gravities[done], push, step, known, q)
            if keep == 1:
                _update(ints, step, body, history, known, q)
                past_x[1], past_R[1], past_inner[1] = past_x[0], past_R[0], past_inner[0]
                past_x[0], past_R[0], past_inner[0] = bx, bR, binner
                known_past = min(known_past + 1, 2)
                row = states[done]
                row[: sizes[1]], row[sizes[1] : sizes[2]] = x.ravel(), R.ravel()
                row[sizes[2] : sizes[3]], row[sizes[3] : sizes[4]] = inner, multiplier
                row[sizes[4] : sizes[5]] = angle
                speeds[done] = history[1, : speeds.shape[1]]
                accelerations[done] = history[3, : speeds.shape[1]]
                _measure(ints, floats, x, R, inner, tau, history, flat, at, leaf, scalars[done])
                scalars[done, 7] = iterations
                for i in range(lines.shape[1]):
                    scalars[done, SCALARS + i] = 0.0
                    for p in range(len(push)):
                        scalars[done, SCALARS + i] += lines[1, i, p] * q[p]
            done += 1
    return done, reason


@kernel
def measure(ints, floats, x, R, inner, tau, history, flat, at, out):
    """Write the numbers `SCALARS` of an instant that was assembled, without the iterations, into out."""
    _measure(ints, floats, x, R, inner, tau, history, flat, at, allocate_leaf_scratch(ints), out)
