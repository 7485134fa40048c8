"""Compiled assembly in the plane: members, loads and constraint rows, each with its exact symmetric tangent.

The planar twin of `ksd.model.assembly` and `ksd.model.loading`. With J = [0 -1; 1 0], w the lever from node a to
end q and s the lever from node b to end q, the relative motion of a member is
xi = (dxb - dxa + J s dphi_b - J w dphi_a, dphi_b - dphi_a) and the second derivatives of n.xi, n turning with a,
are [xa, phia] = -J n, [xb, phia] = J n, [phia, phia] = -n.w, [phib, phib] = -n.s, [phib, phia] = n.s.

Kernels are given the groups of arrays they read and no more: passing all of them costs a microsecond per call.
"""

from __future__ import annotations

import math

from ksd.beam.planar_entry import (
    DEFAULT,
    LENGTHS,
    planar_chain_condense,
    planar_chain_near,
    planar_chain_recover,
    planar_strain_condense,
    planar_strain_condense_default,
    planar_strain_recover,
)
from ksd.beam.planar_weight_entry import pull_planar, turn_planar_pull, weigh_planar
from ksd.beam.spring import planar_coil_condense, planar_linear_condense
from ksd.model.arrays import COIL, COROTATIONAL, LINEAR, STRAIN, TRANSLATION
from ksd.numerics.kernel import kernel
from ksd.numerics.local import local_counts, local_matrix, local_vector

TURN = 2.0 * math.pi


@kernel(inline="always")
def planar_pose(node, offset, frame, nodes, turns, pose, end):
    """pose (6,) = cos, sin of frame p, levers w and s (global); end (3,) = pose of end q in frame p.

    node (2,), offset (2, 2), frame (2,) of one member; nodes (k, 3) poses and turns (2k,) cos, sin of all nodes.
    """
    a, b = node[0], node[1]
    ca, sa, cb, sb = turns[2 * a], turns[2 * a + 1], turns[2 * b], turns[2 * b + 1]
    turned = nodes[a, 2] + frame[0]
    c, s = math.cos(turned), math.sin(turned)
    px, py, qx, qy = offset[0, 0], offset[0, 1], offset[1, 0], offset[1, 1]
    sx, sy = cb * qx - sb * qy, sb * qx + cb * qy
    wx, wy = nodes[b, 0] - nodes[a, 0] + sx, nodes[b, 1] - nodes[a, 1] + sy
    dx, dy = wx - ca * px + sa * py, wy - sa * px - ca * py
    pose[0], pose[1], pose[2], pose[3], pose[4], pose[5] = c, s, wx, wy, sx, sy
    end[0], end[1] = c * dx + s * dy, c * dy - s * dx
    end[2] = nodes[b, 2] + frame[1] - turned


@kernel
def _scatter(value, at, k00, k01, k02, k11, k12, k22):
    """Add a symmetric 3 x 3 block."""
    value[at] += k00
    value[at + 1] += k01
    value[at + 2] += k02
    value[at + 3] += k01
    value[at + 4] += k11
    value[at + 5] += k12
    value[at + 6] += k02
    value[at + 7] += k12
    value[at + 8] += k22


@kernel
def _planar_tangent(value, block, pose, lam, K):
    """Add the tangent of one member to its stored blocks aa, bb and coupling, from lam (6,) and K (3, 3)."""
    c, s, wx, wy, sx, sy = pose[0], pose[1], pose[2], pose[3], pose[4], pose[5]
    k01 = K[0, 1]
    a00 = c * c * K[0, 0] - 2.0 * c * s * k01 + s * s * K[1, 1]
    a11 = s * s * K[0, 0] + 2.0 * c * s * k01 + c * c * K[1, 1]
    a01 = c * s * (K[0, 0] - K[1, 1]) + (c * c - s * s) * k01
    a02, a12, a22 = c * K[0, 2] - s * K[1, 2], s * K[0, 2] + c * K[1, 2], K[2, 2]
    # force and moment of a unit turn about node a (q) and about node b (p)
    q0, q1, q2 = a01 * wx - a00 * wy + a02, a11 * wx - a01 * wy + a12, a12 * wx - a02 * wy + a22
    p0, p1, p2 = a01 * sx - a00 * sy + a02, a11 * sx - a01 * sy + a12, a12 * sx - a02 * sy + a22
    nx, ny = c * lam[3] - s * lam[4], s * lam[3] + c * lam[4]
    ns = nx * sx + ny * sy
    if block[0] >= 0:
        turn = q1 * wx - q0 * wy + q2 - nx * wx - ny * wy
        _scatter(value, block[0], a00, a01, q0 + ny, a11, q1 - nx, turn)
    if block[1] >= 0:
        _scatter(value, block[1], a00, a01, p0, a11, p1, p1 * sx - p0 * sy + p2 - ns)
    if block[2] >= 0:
        # rows a, columns b; the transpose when b is the row
        at = block[2]
        far, near = (at + 2, at + 6) if block[3] == 1 else (at + 6, at + 2)
        step = 3 if block[3] == 1 else 1
        value[at] -= a00
        value[at + 1] -= a01
        value[at + 3] -= a01
        value[at + 4] -= a11
        value[far] -= p0
        value[far + step] -= p1
        value[near] -= q0 + ny
        value[near + 4 - step] -= q1 - nx
        value[at + 8] += ns - (q1 * sx - q0 * sy + q2)


@kernel
def add_planar_members(members, start, nodes, inners, work, factor, rtol, noise, near):
    """All members, their weight times `factor`, into work.value and work.rhs.

    Returns (negatives, worst inner residual over its bound, status).
    near: 1 linearises chains about the element orientations in work.near from work.near_at on (paper 1, section 3).
    """
    kind, node, number, block = members.kind, members.node, members.number, members.block
    value_at, inner_at, store_at = members.value_at, members.inner_at, members.store_at
    values, stores, scale, rhs = members.value, work.store, work.scale, work.rhs
    lams, poses, matrix, turns = work.lam, work.pose, work.value, work.near
    offset, frame, lengths, floors = members.offset, members.frame, members.length, members.floor
    negatives, worst, status, weight = 0, 0.0, 0, work.weight
    K, end, out, size = local_matrix(3, 3), local_vector(3), local_vector(4), local_counts(4)
    for i in range(len(kind)):
        pose, lam = poses[i], lams[i]
        planar_pose(node[i], offset[i], frame[i], nodes, turns, pose, end)
        value, inner = values[value_at[i] :], inners[inner_at[i] : inner_at[i + 1]]
        store = stores[store_at[i] : store_at[i + 1]]
        size[0], size[1], size[2] = len(value), len(inner), len(store)
        V, N, S, W = value.ctypes, number[i].ctypes, inner.ctypes, store.ctypes
        heavy = len(weight) > 0 and weight[i, 0] > 0.0
        if heavy:
            pull_planar(pose.ctypes, weight[i].ctypes, factor, W, len(store))
        if kind[i] == STRAIN:
            if number[i, 0] == DEFAULT[0] and number[i, 1] == DEFAULT[1] and len(store) == LENGTHS[1]:
                planar_strain_condense_default(
                    V, N, S, W, end.ctypes, lam.ctypes, K.ctypes, out.ctypes, size.ctypes
                )
            else:
                planar_strain_condense(V, N, S, W, end.ctypes, lam.ctypes, K.ctypes, out.ctypes, size.ctypes)
        elif kind[i] == LINEAR:
            planar_linear_condense(inner, end, lam, K)
            out[:] = 0.0
        elif near == 1:
            rotations = turns[work.near_at[i] : work.near_at[i + 1]]
            size[3] = len(rotations)
            O = rotations.ctypes
            planar_chain_near(V, N, S, W, O, end.ctypes, lam.ctypes, K.ctypes, out.ctypes, size.ctypes)
        else:
            planar_chain_condense(V, N, S, W, end.ctypes, lam.ctypes, K.ctypes, out.ctypes, size.ctypes)
        dn, dm = out[1], out[2]
        negatives += int(out[0])
        status = max(status, int(out[3]))
        _planar_tangent(matrix, block[i], pose, lam, K)
        n, m = math.sqrt(lam[0] ** 2 + lam[1] ** 2), abs(lam[2])
        L, floor = lengths[i], noise * floors[i]
        tiny = 1e-300
        worst = max(
            worst, dn / (rtol * (n + m / L) + floor + tiny), dm / (rtol * (n * L + m) + floor * L + tiny)
        )
        nx, ny = pose[0] * lam[0] - pose[1] * lam[1], pose[1] * lam[0] + pose[0] * lam[1]
        if heavy:
            B, k, u = block[i].ctypes, node[i, 0], start[node[i, 0]]
            weigh_planar(matrix.ctypes, B, pose.ctypes, end.ctypes, W, len(store), weight[i, 0], out.ctypes)
            scale[k, 0] += rtol * math.sqrt(out[0] ** 2 + out[1] ** 2)
            scale[k, 1] += rtol * abs(out[2])
            if u >= 0:
                for r in range(3):
                    rhs[u + r] += out[r]
        for e in range(2):
            k, sign = node[i, e], 2.0 * e - 1.0
            moment = pose[2 + 2 * e] * ny - pose[3 + 2 * e] * nx + lam[2]
            scale[k, 0] += rtol * (n + m / L) + floor
            scale[k, 1] += rtol * (max(abs(moment), m) + n * L) + floor * L
            u = start[k]
            if u >= 0:
                rhs[u] += sign * nx
                rhs[u + 1] += sign * ny
                rhs[u + 2] += sign * moment
    return negatives, worst, status


@kernel
def add_planar_springs(springs, first, start, nodes, work, rtol, noise):
    """All springs into work.value and work.rhs; `first`: the row of work.pose and work.lam of the first one."""
    K, end = local_matrix(3, 3), local_vector(3)
    status = 0
    for i in range(len(springs.kind)):
        pose, lam = work.pose[first + i], work.lam[first + i]
        planar_pose(springs.node[i], springs.offset[i], springs.frame[i], nodes, work.near, pose, end)
        value = springs.value[springs.value_at[i] :]
        if springs.kind[i] == COIL:
            status = max(status, planar_coil_condense(value, end, lam, K))
        else:
            planar_linear_condense(value, end, lam, K)
        _planar_tangent(work.value, springs.block[i], pose, lam, K)
        n, m = math.sqrt(lam[0] ** 2 + lam[1] ** 2), abs(lam[2])
        L, floor = springs.length[i], noise * springs.floor[i]
        nx, ny = pose[0] * lam[0] - pose[1] * lam[1], pose[1] * lam[0] + pose[0] * lam[1]
        for e in range(2):
            k, sign = springs.node[i, e], 2.0 * e - 1.0
            moment = pose[2 + 2 * e] * ny - pose[3 + 2 * e] * nx + lam[2]
            work.scale[k, 0] += rtol * (n + m / L) + floor
            work.scale[k, 1] += rtol * (max(abs(moment), m) + n * L) + floor * L
            u = start[k]
            if u >= 0:
                work.rhs[u] += sign * nx
                work.rhs[u + 1] += sign * ny
                work.rhs[u + 2] += sign * moment
    return status


@kernel(inline="always")
def add_planar_loads(loads, start, work, factor, rtol):
    """External loads, times `factor`; tangents as in `ksd.model.loading.add_loads`."""
    for i in range(len(loads.node)):
        node = loads.node[i]
        u, block = start[node], loads.block[i]
        if u < 0:
            continue
        c, s = work.near[2 * node], work.near[2 * node + 1]
        sx, sy = c * loads.point[i, 0] - s * loads.point[i, 1], s * loads.point[i, 0] + c * loads.point[i, 1]
        fx, fy = factor * loads.force[i, 0], factor * loads.force[i, 1]
        if loads.following[i] == 1:
            fx, fy = c * fx - s * fy, s * fx + c * fy
            # symmetric half of -d(R f)/dphi, rows force, column rotation
            work.value[block + 2] += 0.5 * fy
            work.value[block + 6] += 0.5 * fy
            work.value[block + 5] -= 0.5 * fx
            work.value[block + 7] -= 0.5 * fx
        else:
            work.value[block + 8] += sx * fx + sy * fy
        moment = factor * loads.moment[i] + sx * fy - sy * fx
        work.rhs[u] -= fx
        work.rhs[u + 1] -= fy
        work.rhs[u + 2] -= moment
        work.scale[node, 0] += rtol * math.sqrt(fx * fx + fy * fy)
        work.scale[node, 1] += rtol * abs(moment)


@kernel(inline="always")
def planar_term(kind, node, direction, point, nodes, turns, g):
    """Value of one constraint term; see `ksd.model.loading.term_value`.

    g (10,): gradient on base and node (x, y, angle each), then per unit multiplier the second derivatives
    u (2,) global, u.w and u.s, which couple angles as the n of the module docstring does.
    """
    a, b = node[0], node[1]
    if kind != TRANSLATION:
        sense = direction[0]
        g[:] = 0.0
        g[2], g[5] = -sense, sense
        turn = nodes[b, 2] - nodes[a, 2]
        return sense * (turn - TURN * round(turn / TURN))
    ca, sa, cb, sb = turns[2 * a], turns[2 * a + 1], turns[2 * b], turns[2 * b + 1]
    ux, uy, qx, qy = direction[0], direction[1], point[1, 0], point[1, 1]
    # the base's own point only shifts the value by a constant along u fixed in base
    value = -(ux * point[0, 0] + uy * point[0, 1])
    ux, uy = ca * ux - sa * uy, sa * ux + ca * uy
    qx, qy = cb * qx - sb * qy, sb * qx + cb * qy
    wx, wy = nodes[b, 0] + qx - nodes[a, 0], nodes[b, 1] + qy - nodes[a, 1]
    along = ux * wx + uy * wy
    g[0], g[1], g[2] = -ux, -uy, ux * wy - uy * wx
    g[3], g[4], g[5] = ux, uy, qx * uy - qy * ux
    g[6], g[7], g[8], g[9] = ux, uy, along, ux * qx + uy * qy
    return value + along


@kernel
def add_planar_terms(terms, start, motion, target, work, size, rtol):
    """Constraint rows: gap, gradient, multiplier times curvature. Returns the largest gap [m], angles times `size`."""
    multiplier, nodes = motion.multiplier, motion.pose
    first, row, factor, kind, node = terms.first, terms.start, terms.coefficient, terms.kind, terms.node
    direction, point, block, flip = terms.direction, terms.point, terms.block, terms.flip
    rhs, value, scale, turns = work.rhs, work.value, work.scale, work.near
    g = local_vector(10)
    largest = 0.0
    for i in range(len(row)):
        gap, reach = -target[i], 1.0
        for t in range(first[i], first[i + 1]):
            k = factor[t]
            gap += k * planar_term(kind[t], node[t], direction[t], point[t], nodes, turns, g)
            if kind[t] != TRANSLATION:
                reach = size
            weight = multiplier[i] * k
            ux, uy, arm = weight * g[6], weight * g[7], weight * g[9]
            for e in range(2):
                at, o = node[t, e], 3 * e
                u = start[at]
                if u < 0:
                    continue
                for r in range(3):
                    # the row is stored (multiplier, node) or (node, multiplier): three numbers either way
                    value[block[t, e] + r] += k * g[o + r]
                    rhs[u + r] += weight * g[o + r]
                scale[at, 0] += rtol * abs(weight) * math.sqrt(g[o] ** 2 + g[o + 1] ** 2)
                scale[at, 1] += rtol * abs(weight * g[o + 2])
            if block[t, 2] >= 0:
                _scatter(value, block[t, 2], 0.0, 0.0, uy, 0.0, -ux, -weight * g[8])
            if block[t, 3] >= 0:
                value[block[t, 3] + 8] -= arm
            at = block[t, 4]
            if at >= 0:
                # angle of the base with x, y of the node
                to, step = (6, 1) if flip[t] == 1 else (2, 3)
                value[at + to] -= uy
                value[at + to + step] += ux
                value[at + 8] += arm
        rhs[row[i]] += gap
        largest = max(largest, abs(gap) * reach)
    return largest


@kernel
def recover_planar(members, start, motion, step, work, scale):
    """Inner update of every member for the step (n,); work: as assembled."""
    kind, node, number, values = members.kind, members.node, members.number, members.value
    value_at, inner_at, store_at = members.value_at, members.inner_at, members.store_at
    inners, stores, poses, weight = motion.inner, work.store, work.pose, work.weight
    move, xi, size = local_vector(6), local_vector(3), local_counts(4)
    for i in range(len(kind)):
        pose = poses[i]
        for e in range(2):
            u = start[node[i, e]]
            for r in range(3):
                move[3 * e + r] = step[u + r] if u >= 0 else 0.0
        gx = move[3] - move[0] - pose[5] * move[5] + pose[3] * move[2]
        gy = move[4] - move[1] + pose[4] * move[5] - pose[2] * move[2]
        xi[0], xi[1] = pose[0] * gx + pose[1] * gy, pose[0] * gy - pose[1] * gx
        xi[2] = move[5] - move[2]
        value, inner = values[value_at[i] :], inners[inner_at[i] : inner_at[i + 1]]
        store = stores[store_at[i] : store_at[i + 1]]
        if len(weight) > 0 and weight[i, 0] > 0.0:
            turn_planar_pull(move[2], store.ctypes, len(store))
        size[0], size[1], size[2] = len(value), len(inner), len(store)
        V, N, S, W = value.ctypes, number[i].ctypes, inner.ctypes, store.ctypes
        if kind[i] == STRAIN:
            planar_strain_recover(V, N, S, W, xi.ctypes, scale, size.ctypes)
        elif kind[i] == COROTATIONAL:
            planar_chain_recover(V, N, S, W, xi.ctypes, scale, size.ctypes)
