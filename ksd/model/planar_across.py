"""Whether a planar state is stable across its plane, from the motions across it alone: three per node.

Motions in the plane and across it are decoupled where the mechanism is its own mirror image: members that coincide in the
plane have the mean height of the mirror, and loads and drives act in it. Then the leafs balance across the plane whatever
the state, and the spatial tangent falls apart into that of the plane and the one assembled here, of nodes that are
displaced along the normal and turned about axes in the plane. `make_across` says where that holds, and only leafs of modes
of strain are taken; elsewhere the spatial tangent is asked.

With A the stiffness of a member across the plane (displacement, two rotations), w and s its levers, n and m its wrench and
B(s) = [1, s_y, -s_x; 0, 1, 0; 0, 0, 1], the blocks of `ksd.model.assembly` are across the plane: bb = B(s)' A B(s) + (n s' +
s n') / 2 - n.s on rotations; aa the same with w, and (-n_y, n_x) coupling displacement and rotations; ba = -B(s)' A B(w)
with (n_y, -n_x) and -n s' + n.s + m/2 [0 1; -1 0]. A member at height h beside the mirror is also stretched and bent in
the plane, by h (phi_y, -phi_x).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ksd.beam.planar_across import TINY, across_scratch, across_values
from ksd.beam.planar_entry import planar_strain_across
from ksd.model.arrays import ROTATION, STRAIN, TRANSLATION, Arrays
from ksd.model.blank import PlanarSystem, blank_planar_system
from ksd.model.pack import Places
from ksd.model.planar_arrays import PlanarMotion
from ksd.model.planar_lift import Lifting
from ksd.numerics.blocks import Blocks, factor_blocks, plan_blocks
from ksd.numerics.held import Kind, address_of, found_at
from ksd.numerics.kernel import compile_late, kernel, late
from ksd.numerics.local import local_matrix, local_vector

LEVEL = 1e-11
"""Distance from the mirror, over the size of the mechanism, that is rounding."""


class Across(NamedTuple):
    """The motions across the plane of planar arrays with p members, t terms and l loads.

    number (p, 4), value (flat) from value_at (p,): as `ksd.beam.planar_across`; times (p,): spatial members each stands for;
    height (p,): mean square of their distance from the mirror [m^2]; start (k,): first unknown of every node; member (p, 4),
    term (t, 4): offsets of blocks aa, bb and coupling, -1 where fixed, last 1 when the coupling is stored as (a, b); load
    (l,): of the diagonal block. matrix, spare, scratch: storage. seen (2,): largest shift [m] and turn [rad] of a node up to
    which the spatial tangent was asked too, -1 before; rest (k, 3).
    Without members where all that does not hold.
    """

    plan: Blocks
    number: np.ndarray
    value_at: np.ndarray
    value: np.ndarray
    times: np.ndarray
    height: np.ndarray
    start: np.ndarray
    member: np.ndarray
    term: np.ndarray
    load: np.ndarray
    matrix: np.ndarray
    spare: np.ndarray
    scratch: np.ndarray
    seen: np.ndarray
    rest: np.ndarray


def _groups(space: Arrays, flat: Arrays, lifting: Lifting) -> list[list[int]]:
    """Spatial members that every planar member stands for: those its first amplitude is copied to."""
    members = space.members
    found: list[list[int]] = [[] for _ in flat.members.kind]
    of = dict(zip(lifting.to.tolist(), lifting.of.tolist(), strict=True))
    for i, number in enumerate(members.number):
        at = of[int(members.inner_at[i] + number[0] + number[1])]
        found[int(np.searchsorted(flat.members.inner_at, at, side="right")) - 1].append(i)
    return found


def _heights(space: Arrays, lifting: Lifting) -> np.ndarray:
    """Coordinates (m, 2) of both ends of every spatial member along the normal [m]."""
    members = space.members
    return lifting.height[members.node] + members.offset @ lifting.axes[:, 2]


def _mirrored(space: Arrays, lifting: Lifting, mirror: float) -> bool:
    """Whether loads and the points of drives and supports lie in the mirror."""
    k, loads, terms = lifting.axes[:, 2], space.loads, space.terms
    levels = [lifting.height[loads.node] + loads.point @ k]
    for t in range(len(terms.kind)):
        if terms.kind[t] == TRANSLATION:
            node = terms.node[t, 1]
            levels.append(lifting.height[[node]] + terms.point[t, 1] @ k)
    return bool(np.abs(np.concatenate(levels) - mirror).max(initial=0.0) <= LEVEL * space.size)


class Mirror(NamedTuple):
    """What is held for compiled code."""

    across: Across


def make_across(space: Arrays, flat: Arrays, lifting: Lifting, rest: PlanarMotion) -> Across:
    """The motions across the plane, or an empty one where they are not decoupled from those in it, or not of leafs alone.

    space, flat: the arrays of a mechanism in space and in its plane; rest: planar.
    """
    return _mirror_image(space, flat, lifting, rest) or _laid_out(flat, [], (), ((), ()), rest)


def _mirror_image(space: Arrays, flat: Arrays, lifting: Lifting, rest: PlanarMotion) -> Across | None:
    members, loads = space.members, space.loads
    if (
        not len(members.kind)
        or np.any(members.kind != STRAIN)
        or len(space.weight)
        or len(space.springs.kind)
    ):
        return None
    if np.any(loads.following == 1) or len(lifting.row) < len(space.terms.start):
        return None
    groups, ends = _groups(space, flat, lifting), _heights(space, lifting)
    mirror = float(ends[groups[0]].mean())
    level = LEVEL * space.size
    values: list[np.ndarray] = []
    numbers, squares, known = [], [], {}
    for group in groups:
        if abs(ends[group].mean() - mirror) > level or np.abs(ends[group, 0] - ends[group, 1]).max() > level:
            return None
        made = []
        for i in group:
            key = int(members.value_at[i]), members.number[i].tobytes()
            if key not in known:
                known[key] = across_values(members.value[members.value_at[i] :], members.number[i])
            made.append(known[key])
        if any(m[0].tobytes() != made[0][0].tobytes() for m in made[1:]):
            return None
        values.append(made[0][0])
        numbers.append(made[0][1])
        squares.append(float(np.square(ends[group, 0] - mirror).mean()))
    if not _mirrored(space, lifting, mirror):
        return None
    return _laid_out(flat, values, numbers, ([len(group) for group in groups], squares), rest)


def _laid_out(
    flat: Arrays,
    values: list[np.ndarray],
    numbers: Sequence[Any],
    counted: tuple[Any, Any],
    rest: PlanarMotion,
) -> Across:
    """Storage and places of blocks; counted: times and height of `Across`."""
    nodes, ends = (len(flat.start), [flat.members.node, flat.terms.node]) if values else (1, [])
    couples = [pair for some in ends for pair in some.tolist()]
    pairs = [(a - 1, b - 1) for a, b in couples if a and b and a != b]
    plan, position, offsets = plan_blocks(np.full(nodes - 1, 3, np.int64), pairs)
    places = Places(offsets, position)
    start = np.full(nodes, -1, np.int64)
    start[1:] = plan.start[position]

    def blocks(ends: np.ndarray) -> np.ndarray:
        found = [[places.diagonal(a), places.diagonal(b), *places.coupling(a, b)] for a, b in ends.tolist()]
        return np.array(found, np.int64).reshape(-1, 4)

    none = np.zeros((0, 2), np.int64)
    of_members, of_terms = (blocks(some) for some in ends or (none, none))
    if values:
        compile_late("planar_strain_across", "stable_across_apart")
    number = np.array(numbers, np.int64).reshape(-1, 4)
    room = max((across_scratch(n) for n in number), default=0)
    return Across(
        plan, number, np.cumsum([0, *map(len, values)])[:-1].astype(np.int64), np.concatenate([*values, np.zeros(1)]),
        np.array(counted[0], float), np.array(counted[1], float), start,
        of_members, of_terms,
        np.array([places.diagonal(int(n)) for n in (flat.loads.node if values else ())], np.int64),
        np.zeros(plan.values), np.zeros(plan.values), np.zeros(room), np.full(2, -1.0), rest.pose.copy(),
    )  # fmt: skip


@kernel
def _with_levers(A, sx, sy, M):
    """M (3, 3) = A B(s)."""
    for r in range(3):
        M[r, 0] = A[r, 0]
        M[r, 1] = A[r, 1] + sy * A[r, 0]
        M[r, 2] = A[r, 2] - sx * A[r, 0]


@kernel
def _add_across(value, block, wx, wy, sx, sy, A, nx, ny, m):
    """Add what a member of stiffness A (3, 3) and wrench (nx, ny, m) has across the plane to its blocks (4,)."""
    M, T = local_matrix(3, 3), local_matrix(3, 3)
    for e in range(2):
        if block[e] >= 0:
            # (A B)' B
            x, y = (wx, wy) if e == 0 else (sx, sy)
            _with_levers(A, x, y, M)
            for r in range(3):
                for c in range(r):
                    M[r, c], M[c, r] = M[c, r], M[r, c]
            _with_levers(M, x, y, T)
            along = nx * x + ny * y
            T[1, 1] += nx * x - along
            T[2, 2] += ny * y - along
            T[1, 2] += 0.5 * (nx * y + ny * x)
            T[2, 1] += 0.5 * (nx * y + ny * x)
            if e == 0:
                T[0, 1] -= ny
                T[1, 0] -= ny
                T[0, 2] += nx
                T[2, 0] += nx
            for r in range(3):
                for c in range(3):
                    value[block[e] + 3 * r + c] += T[r, c]
    if block[2] >= 0:
        # rows b, columns a: B(s)' A B(w)
        _with_levers(A, sx, sy, M)
        for r in range(3):
            for c in range(r):
                M[r, c], M[c, r] = M[c, r], M[r, c]
        _with_levers(M, wx, wy, T)
        along = nx * sx + ny * sy
        for r in range(3):
            for c in range(3):
                T[r, c] = -T[r, c]
        T[0, 1] += ny
        T[0, 2] -= nx
        T[1, 1] += along - nx * sx
        T[2, 2] += along - ny * sy
        T[1, 2] += 0.5 * m - nx * sy
        T[2, 1] -= 0.5 * m + ny * sx
        for r in range(3):
            for c in range(3):
                value[block[2] + (3 * c + r if block[3] == 1 else 3 * r + c)] += T[r, c]


@kernel
def _turned(K, c, s, times, height, stiff, A):
    """A (3, 3) in the axes of the plane: `times` K (3, 3) turned by (c, s), and that of `stiff` in the plane, from its xx,
    xy, yy in the frame of the member, at mean square height."""
    x, y = K[0, 1], K[0, 2]
    A[0, 0] = times * K[0, 0]
    A[0, 1] = A[1, 0] = times * (c * x - s * y)
    A[0, 2] = A[2, 0] = times * (s * x + c * y)
    x, y, z = (
        times * K[1, 1] + height * stiff[3],
        times * K[1, 2] - height * stiff[1],
        times * K[2, 2] + height * stiff[0],
    )
    A[1, 1] = c * c * x - 2.0 * c * s * y + s * s * z
    A[2, 2] = s * s * x + 2.0 * c * s * y + c * c * z
    A[1, 2] = A[2, 1] = c * s * (x - z) + (c * c - s * s) * y


@kernel
def _add_members(across, members, motion, work):
    """All members. Returns (negative pivots of the leafs' own modes, whether all can be told)."""
    K, A = local_matrix(3, 3), local_matrix(3, 3)
    sound, negatives, out = True, 0, local_vector(2)
    for i in range(len(members.kind)):
        pose, inner = work.pose[i], motion.inner[members.inner_at[i] : members.inner_at[i + 1]]
        value = across.value[across.value_at[i] :]
        nz = across.number[i, 0]
        planar_strain_across(
            value.ctypes, across.number[i].ctypes, inner.ctypes, 1.0 / across.times[i], across.scratch.ctypes, K.ctypes,
            out.ctypes, len(value), len(inner), len(across.scratch),
        )  # fmt: skip
        negatives += int(across.times[i] * out[0])
        sound = sound and out[1] == 1.0
        # the stiffness in the plane, see `ksd.beam.planar_strain.recover`
        k = work.store[members.store_at[i] + 4 * nz + 3 :]
        stiff = local_vector(4)
        stiff[0], stiff[1], stiff[2], stiff[3] = k[0], k[1], k[1], k[3]
        c, s = pose[0], pose[1]
        _turned(K, c, s, across.times[i], across.height[i], stiff, A)
        nx, ny = c * inner[nz] - s * inner[nz + 1], s * inner[nz] + c * inner[nz + 1]
        _add_across(
            across.matrix, across.member[i], pose[2], pose[3], pose[4], pose[5], A, nx, ny, inner[nz + 2]
        )
    return negatives, sound


@kernel
def _stable(across, arrays, motion, work, factor):
    """See `stable_across`."""
    across.matrix[:] = 0.0
    inside, sound = _add_members(across, arrays.members, motion, work)
    if not sound:
        return False
    terms, loads, pose, turns = arrays.terms, arrays.loads, motion.pose, work.near
    none = local_matrix(3, 3)
    for r in range(3):
        for c in range(3):
            none[r, c] = 0.0
    for i in range(len(terms.start)):
        for t in range(terms.first[i], terms.first[i + 1]):
            a, b, weight = terms.node[t, 0], terms.node[t, 1], motion.multiplier[i] * terms.coefficient[t]
            ux, uy, m = weight * terms.direction[t, 0], weight * terms.direction[t, 1], 0.0
            qx, qy = terms.point[t, 1, 0], terms.point[t, 1, 1]
            if terms.kind[t] == ROTATION:
                ux, m = 0.0, ux
            ux, uy = turns[2 * a] * ux - turns[2 * a + 1] * uy, turns[2 * a + 1] * ux + turns[2 * a] * uy
            qx, qy = turns[2 * b] * qx - turns[2 * b + 1] * qy, turns[2 * b + 1] * qx + turns[2 * b] * qy
            wx, wy = pose[b, 0] + qx - pose[a, 0], pose[b, 1] + qy - pose[a, 1]
            _add_across(across.matrix, across.term[t], wx, wy, qx, qy, none, ux, uy, m)
    for i in range(len(loads.node)):
        at, n = across.load[i], 2 * loads.node[i]
        if at >= 0:
            px, py = loads.point[i, 0], loads.point[i, 1]
            sx, sy = turns[n] * px - turns[n + 1] * py, turns[n + 1] * px + turns[n] * py
            fx, fy = factor * loads.force[i, 0], factor * loads.force[i, 1]
            across.matrix[at + 4] += sy * fy
            across.matrix[at + 8] += sx * fx
            across.matrix[at + 5] -= 0.5 * (sx * fy + sy * fx)
            across.matrix[at + 7] -= 0.5 * (sx * fy + sy * fx)
    negatives, pivot = factor_blocks(across.plan, across.matrix, across.spare, len(across.plan.size))
    return negatives + inside == 0 and pivot > TINY


_SYSTEM = blank_planar_system()
_KIND = Kind(_SYSTEM)
_ACROSS = Kind(Mirror(_laid_out(_SYSTEM.arrays, [], (), ((), ()), _SYSTEM.motion)))


@late("void(int64, int64, float64, CPointer(float64))")
def stable_across_apart(mirror, address, factor, out):
    """`stable_across` on the `Mirror` and the `PlanarSystem` at these addresses; out (1,): 1 or 0."""
    m, s = found_at(mirror, _ACROSS), found_at(address, _KIND)
    out[0] = 1.0 if _stable(m.across, s.arrays, s.motion, s.work, factor) else 0.0


@kernel(needs=("stable_across_apart",))
def stable_across(across, arrays, motion, work, factor):
    """Whether an equilibrium `motion` of planar arrays, with `work` as its last assembly left it, is a minimum across the
    plane for sure."""
    out = local_vector(1)
    mirror = address_of(Mirror(across), _ACROSS)
    stable_across_apart(
        mirror, address_of(PlanarSystem(arrays, motion, motion.multiplier, work), _KIND), factor, out.ctypes
    )
    return out[0] == 1.0


@kernel
def _reach(across, pose, r):
    """Largest move of a node since rest: shift [m] (r 0) or turn [rad] (r 2)."""
    found = 0.0
    for k in range(len(pose)):
        found = max(found, abs(pose[k, r] - across.rest[k, r]))
        if r == 0:
            found = max(found, abs(pose[k, 1] - across.rest[k, 1]))
    return found


@kernel
def known_across(across, pose):
    """Whether the spatial tangent was asked about a state at least half as far from rest as the poses (k, 3)."""
    first = 0 * len(pose)
    return (
        _reach(across, pose, first) <= 2.0 * across.seen[0]
        and _reach(across, pose, 2 + first) <= 2.0 * across.seen[1]
    )


@kernel
def note_across(across, pose):
    """Remember that it was."""
    first = 0 * len(pose)
    across.seen[0] = max(across.seen[0], _reach(across, pose, first))
    across.seen[1] = max(across.seen[1], _reach(across, pose, 2 + first))
