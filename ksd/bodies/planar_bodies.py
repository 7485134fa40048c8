"""The joint bodies of a model in its plane: three unknowns per link and block, condensed joints of three by three.

Made from the spatial bodies of `ksd.bodies.joints`, whose polynomials and constants are taken over, so both give the same
answer; a reason is returned where the plane has no room for a joint.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ksd.bodies.joints import JointBodies
from ksd.bodies.kinematics import Loops
from ksd.bodies.planar_kinematics import PlanarLoops
from ksd.bodies.weight import Hung
from ksd.model.arrays import LINEAR, Arrays
from ksd.model.planar_arrays import PlanarMotion
from ksd.model.planar_flat import Flat
from ksd.model.planar_lift import inner_copies
from ksd.model.planar_pack import flat_member, pack_flat
from ksd.model.planar_springs import flat_spring
from ksd.model.plane import Plane

SMALL = 1e-6
"""Rotation [rad] or chord (over joint length) out of the plane, at full motion, that counts as none."""
_LOCAL = (np.eye(3), np.diag([1.0, -1.0, -1.0]))
"""Axes i, j, k of the plane in the axes of a joint whose z is k, or -k."""


class PlanarInside(NamedTuple):
    """As `ksd.bodies.bench.Inside`: block_pose (K, 3, M), and targets in the planar inner states and near angles."""

    block_node: np.ndarray
    block_joint: np.ndarray
    block_pose: np.ndarray
    joint: np.ndarray
    target: np.ndarray
    coefficient: np.ndarray
    near_joint: np.ndarray
    near_target: np.ndarray
    near_coefficient: np.ndarray


class PlanarBodies(NamedTuple):
    """Everything the planar five steps read: loops, insides, and the arrays of bench, reduced and full mechanism."""

    loops: PlanarLoops
    inside: PlanarInside
    full_node: np.ndarray
    bench: Arrays
    reduced: Arrays
    full: Arrays
    hung: Hung


class PlanarStart(NamedTuple):
    """What a solve starts from: rest states, and lengths (members of the bench,) of the near data."""

    bench: PlanarMotion
    reduced: PlanarMotion
    full: PlanarMotion
    near: np.ndarray


def _poses(functions: np.ndarray, flip: np.ndarray, reach: np.ndarray) -> np.ndarray | None:
    """(J, 3, M): rotation and chord in the plane of functions (J, 6, M); None when they leave it.

    flip (J,): 1, or -1 for a joint seen from behind; reach (J, M): the largest every monomial becomes.
    """
    out = np.abs(functions[:, [0, 1, 5]] * reach[:, None])
    if out.sum(axis=2).max(initial=0.0) > SMALL:
        return None
    found = functions[:, [2, 3, 4]].copy()
    found[:, [0, 2]] *= flip[:, None, None]
    return found


def monomial_reach(bodies: JointBodies) -> np.ndarray:
    """(J, M): the largest value of every monomial of every joint over its trained motions."""
    loops = bodies.loops
    found = np.zeros((len(loops.node), loops.pose.shape[2]))
    for j in range(len(found)):
        power = loops.power[loops.power_first[j] : loops.power_first[j + 1]]
        most = np.abs(bodies.motion_range[loops.first[j] : loops.first[j + 1]]).max(axis=1)
        found[j, : len(power)] = np.prod(np.append(most, 1.0)[: power.shape[1]] ** power, axis=1)
    return found


def _planar_loops(loops: Loops, pose: np.ndarray, axes: np.ndarray) -> PlanarLoops:
    e1 = loops.frame[:, :, 0] @ axes
    return PlanarLoops(
        loops.node, loops.anchor @ axes[:, :2], np.arctan2(e1[:, 1], e1[:, 0]), loops.length, loops.first,
        loops.tree, loops.closing, loops.power_first, loops.power, pose,
    )  # fmt: skip


def _bench_flats(bodies: JointBodies, flip: np.ndarray) -> tuple[list[Flat], np.ndarray] | str:
    """Every member of the bench in the plane of its joint, and the sense of its e3."""
    members, nodes = bodies.bench.members, len(bodies.bench.start)
    joint_of = np.zeros(nodes, np.int64)
    joint_of[bodies.inside.block_node] = bodies.inside.block_joint
    joint_of[nodes - len(flip) :] = np.arange(len(flip))
    flats, sense = [], np.ones(len(members.kind))
    known: dict[Any, np.ndarray | str] = {}
    for i in range(len(members.kind)):
        axes = _LOCAL[int(flip[joint_of[members.node[i].max()]] < 0)]
        sense[i] = np.sign(members.frame[i, 0, :, 2] @ axes[:, 2])
        flat = flat_member(bodies.bench, i, axes, sense[i], known)
        if isinstance(flat, str):
            return flat
        flats.append(flat)
    return flats, sense


def inner_functions(bodies: JointBodies, copies: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    """(joint, target, coefficient) of the planar inner states: one spatial entry for each, made planar."""
    to, of, factor = copies[:3]
    inside = bodies.inside
    row = dict(zip(inside.target.tolist(), range(len(inside.target)), strict=True))
    chosen = {
        int(p): (row[int(s)], float(f)) for s, p, f in zip(to, of, factor, strict=True) if int(s) in row
    }
    rows = np.array([r for r, _ in chosen.values()], np.int64)
    scale = np.array([1.0 / f for _, f in chosen.values()]).reshape(-1, 1)
    return inside.joint[rows], np.array(list(chosen), np.int64), inside.coefficient[rows] * scale


def near_functions(
    bodies: JointBodies, flat: Arrays, twin: np.ndarray, sense: np.ndarray
) -> tuple[np.ndarray, ...]:
    """(joint, target, coefficient) of the near angles, and their number for every planar member."""
    first = [int(np.flatnonzero(twin == p)[0]) for p in range(len(flat.members.kind))]
    spatial_at = np.concatenate([[0], np.cumsum(bodies.near)])
    lengths = np.array([bodies.near[i] // 3 for i in first], np.int64)
    at = 2 * len(flat.start) + np.concatenate([[0], np.cumsum(lengths)])
    inside, found = bodies.inside, []
    row = dict(zip(inside.near_target.tolist(), range(len(inside.near_target)), strict=True))
    for p, i in enumerate(first):
        for k in range(lengths[p]):
            r = row.get(int(spatial_at[i]) + 3 * k + 2)
            if r is not None:
                found.append((r, int(at[p]) + k, sense[i]))
    rows = np.array([f[0] for f in found], np.int64)
    scale = np.array([f[2] for f in found]).reshape(-1, 1)
    target = np.array([f[1] for f in found], np.int64)
    return inside.near_joint[rows], target, inside.near_coefficient[rows] * scale, lengths


def _reduced_flats(bodies: JointBodies, axes: np.ndarray) -> list[Flat] | str:
    """The condensed joints as planar linear members, then the free leafs."""
    members, flats = bodies.reduced.members, []
    known: dict[Any, np.ndarray | str] = {}
    for i in range(len(members.kind)):
        if members.kind[i] != LINEAR:
            sense = float(np.sign(members.frame[i, 0, :, 2] @ axes[:, 2]))
            flat = flat_member(bodies.reduced, i, axes, sense, known)
            if isinstance(flat, str):
                return flat
            flats.append(flat)
            continue
        e1 = members.frame[i, :, :, 0] @ axes
        flats.append(
            Flat(LINEAR, (int(members.node[i, 0]), int(members.node[i, 1])), members.offset[i] @ axes[:, :2],
                 np.arctan2(e1[:, 1], e1[:, 0]), np.array([float(i)]), np.zeros(2, np.int64),
                 float(members.length[i]), float(members.floor[i]))
        )  # fmt: skip
    return flats


def _springs(bodies: JointBodies, axes: np.ndarray) -> list[Flat] | str:
    """The springs between links in the plane."""
    arrays, rest, flats = bodies.reduced, bodies.reduced_rest.x, []
    for i in range(len(arrays.springs.kind)):
        flat = flat_spring(arrays.springs, i, axes, rest)
        if isinstance(flat, str):
            return flat
        flats.append(flat)
    return flats


def _start_inner(arrays: Arrays, full: PlanarMotion, count: int) -> np.ndarray:
    """Inner states of the reduced mechanism at rest; those of free leafs are the last of the full one."""
    joints = int(arrays.members.inner_at[count])
    inner = np.zeros(int(arrays.members.inner_at[-1]))
    free = len(inner) - joints
    inner[joints:] = full.inner[len(full.inner) - free :] if free else 0.0
    return inner


def _outside(bodies: JointBodies, across: np.ndarray) -> str:
    """Why the joints have no place in the plane, or nothing; across (J, 3): its normal in their axes."""
    if bodies.hanging:
        return "a link hangs on leafs alone"
    if np.abs(across[:, :2]).max(initial=0.0) > 1e-9:
        return "a joint lies across the plane"
    return "a joint has more than one intended motion" if np.any(np.diff(bodies.loops.first) != 1) else ""


def _same_leafs(bench: Arrays, full: Arrays, free: int) -> bool:
    """Whether the members of `full` are those of the bench, in order, and then `free` others."""
    head, mine, theirs = len(bench.members.kind), bench.members.value, full.members.value
    return head + free == len(full.members.kind) and np.array_equal(theirs[: len(mine)], mine)


def planar_bodies(plane: Plane, bodies: JointBodies) -> tuple[PlanarBodies, PlanarStart] | str:
    """The joint `bodies` of a model in its `plane`, or why there are none there."""
    axes, loops, inside = plane.lifting.axes, bodies.loops, bodies.inside
    across = loops.frame.transpose(0, 2, 1) @ axes[:, 2]
    reason = _outside(bodies, across)
    if reason:
        return reason
    flip, reach, owner = np.sign(across[:, 2]), monomial_reach(bodies), inside.block_joint
    pose = _poses(loops.pose, flip, reach)
    blocks = _poses(inside.block_pose, flip[owner], reach[owner])
    made, reduced, springs = _bench_flats(bodies, flip), _reduced_flats(bodies, axes), _springs(bodies, axes)
    if isinstance(made, str) or isinstance(reduced, str) or isinstance(springs, str):
        return next(part for part in (made, reduced, springs) if isinstance(part, str))
    if pose is None or blocks is None:
        return "the intended motion of a joint leaves the plane"
    joints = len(loops.node)
    bench, twin = pack_flat(bodies.bench, made[0], axes=np.eye(3), rows=np.zeros(0, np.int64), last=joints)
    bench, hung = _hung(bodies, bench, twin, axes)
    small, _ = pack_flat(bodies.reduced, reduced, axes=axes, rows=plane.lifting.row, springs=springs)
    if not _same_leafs(bench, plane.arrays, len(reduced) - joints):
        return "leafs of different joints coincide in the plane"
    copies = inner_copies(bodies.bench.members, bench.members, twin, made[1])
    *near, lengths = near_functions(bodies, bench, twin, made[1])
    functions = PlanarInside(inside.block_node, owner, blocks, *inner_functions(bodies, copies), *near)
    links = plane.rest.pose[: len(small.start)].copy()
    rest = PlanarMotion(links, _start_inner(small, plane.rest, joints), np.zeros(len(plane.lifting.row)))
    start = PlanarStart(_bench_rest(bodies, bench, copies, flip), rest, plane.rest, lengths)
    parts = (_planar_loops(loops, pose, axes), functions, bodies.full_node, bench, small, plane.arrays, hung)
    return PlanarBodies(*parts), start


def _hung(bodies: JointBodies, bench: Arrays, twin: np.ndarray, axes: np.ndarray) -> tuple[Arrays, Hung]:
    """The bench with gravity in the plane, and the weight of the joints there; twin (m,): planar member of each."""
    if not len(bench.weight):
        return bench, bodies.hung
    bench.weight[:, 1:] = bodies.bench.weight[0, 1:] @ axes[:, :2]
    first = np.unique(twin, return_index=True)[1]
    size = np.array([len(first), bodies.hung.size[1]])
    return bench, Hung(bodies.hung.owner[first], bodies.hung.load, size)


def _bench_rest(
    bodies: JointBodies, bench: Arrays, copies: tuple[np.ndarray, ...], flip: np.ndarray
) -> PlanarMotion:
    """The bench at rest: interfaces and blocks in the plane of their joint."""
    rest, nodes = bodies.bench_rest, len(bench.start)
    flipped = np.ones(nodes)
    flipped[bodies.inside.block_node] = flip[bodies.inside.block_joint]
    flipped[nodes - len(flip) :] = flip
    pose = np.zeros((nodes, 3))
    pose[:, 0], pose[:, 1] = rest.x[:, 0], flipped * rest.x[:, 1]
    inner = np.zeros(int(bench.members.inner_at[-1]))
    to, of, factor = copies[:3]
    inner[of] = rest.inner[to] / factor
    return PlanarMotion(pose, inner, np.zeros(0))
