"""From the arrays of a spatial model to those of the same model in its plane.

Members that coincide in the plane (the outer leafs of a cross flexure) become one of added stiffness. Constants are
taken from the spatial ones, so whatever they describe (taper, curvature in the plane) is kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from ksd.beam import planar_corotational as chain
from ksd.beam.strain_values import masses_beyond
from ksd.model.arrays import ROTATION, STRAIN, Arrays, Loads, Members, Terms
from ksd.model.pack import Places
from ksd.model.planar_flat import Flat
from ksd.model.planar_lift import Lifting, inner_copies
from ksd.model.planar_springs import pack_springs
from ksd.numerics.blocks import plan_blocks


def _test_functions(
    basis: np.ndarray, psi: np.ndarray, weight: np.ndarray, integral: np.ndarray
) -> np.ndarray:
    """Test functions (ng + 1, n) at the points and, last, at the end, see `ksd.beam.planar_strain`.

    Those of polynomial modes are the psi themselves, which hold no rounding of the division by weights.
    """
    end = basis @ weight
    found = end - (basis * weight @ integral).T * (weight.sum() / weight)[:, None]
    found = np.vstack([found, end])
    return psi if np.abs(found - psi).max() < 1e-10 * weight.sum() else found


def strain_in_plane(value: np.ndarray, number: np.ndarray, sense: float, *, heavy: bool) -> np.ndarray | str:
    """Constants of `ksd.beam.planar_strain` from those of `ksd.beam.strain`, or why there are none."""
    nx, ny, nz, ng = (int(n) for n in number[:4])
    total, first = nx + ny + nz, nx + ny
    sizes = [1, nx * nx, ny * ny, nz * nz, total, ng, ng * ng, total * ng, 3 * ng, (ng + 1) * total]
    pairs = (ny * nz + nz * nx + nx * ny) * (ng + 1)
    ends = np.cumsum([0, *sizes, pairs])
    parts = [value[a:b] for a, b in pairwise(ends)]
    mass = masses_beyond(value, number) if heavy else value[:0]
    length, start = float(parts[0][0]), parts[4]
    if np.any(start[:first] != 0.0):
        return "is curved or twisted out of the plane at rest"
    weight, integral = length * parts[5], parts[6].reshape(ng, ng)
    basis = parts[7].reshape(total, ng)[first:]
    slack, gap = parts[8].reshape(ng, 3), parts[9].reshape(total, ng + 1)[first:].T
    # psi at the points and, last, at the end
    psi = length * np.cumsum(gap, axis=0)
    test = _test_functions(basis, psi, weight, integral)
    stiffness = parts[3]
    # the modes of a profile are shaped like its compliance, so the first one tells the rigidity
    bending = stiffness[0] / (weight @ basis[0]) / basis[0]
    table = np.column_stack([weight, slack[:, 0], slack[:, 1], psi[:-1], bending, basis.T, test[:-1]])
    flat = [[length], stiffness, sense * start[first:], table.ravel(), psi[-1], test[-1], mass]
    return np.concatenate(flat)


def chain_in_plane(value: np.ndarray, number: np.ndarray, sense: float, *, heavy: bool) -> np.ndarray | str:
    """Constants of `ksd.beam.planar_corotational` from those of `ksd.beam.corotational`, or why there are none."""
    n = int(number[0])
    record = value[: 16 * n].reshape(n, 16)
    turned = np.concatenate([record[:, 7:], value[16 * n : 16 * n + 9][None]])
    if np.abs(turned[:, [2, 5, 6, 7]]).max() > 1e-12:
        return "is curved or twisted out of the plane at rest"
    angle = sense * np.unwrap(np.arctan2(turned[:, 3], turned[:, 0]))
    flat = [np.column_stack([record[:, [0, 1, 5, 6]], angle[:n]]).ravel(), angle[n:]]
    if heavy:
        lumps = value[16 * n + 9 : 17 * n + 16]
        levers = lumps[n + 1 :].reshape(2, 3)[:, :2] * [1.0, sense]
        flat += [lumps[: n + 1], levers.ravel()]
    return np.concatenate(flat)


def stiffer(flat: Flat, times: int) -> np.ndarray:
    """Constants of `times` equal members side by side."""
    value, count = flat.value.copy(), int(flat.number[0])
    if times == 1:
        return value
    if flat.kind != STRAIN:
        end = chain.RECORD * count
        value[:end].reshape(count, chain.RECORD)[:, 1:4] *= times
        value[end + 1 :] *= times
        return value
    value[1 : 1 + count * count] *= times
    first, points, width = 1 + count * count + count, int(flat.number[1]), 3 * count + 4
    table = value[first : first + points * width].reshape(points, width)
    table[:, 1:3] /= times
    table[:, 3 + count] *= times
    # the mass beyond the points, of a leaf with weight
    value[first + points * width + 2 * count :] *= times
    return value


def flat_member(
    arrays: Arrays, i: int, axes: np.ndarray, sense: float, known: dict[Any, np.ndarray | str]
) -> Flat | str:
    """Member i of a spatial model in the plane `axes` (columns i, j, k), its e3 being sense * k; or why not. known: planar
    constants of the members before, by what they were made of."""
    members = arrays.members
    number, value = members.number[i], members.value[members.value_at[i] :]
    heavy = len(arrays.weight) > 0 and bool(arrays.weight[i, 0] > 0.0)
    strain = members.kind[i] == STRAIN
    of = int(members.value_at[i]), bool(strain), number.tobytes(), sense, heavy
    if of not in known:
        known[of] = (strain_in_plane if strain else chain_in_plane)(value, number, sense, heavy=heavy)
    made, settings = known[of], number[2:4] if strain else number[:2]
    if isinstance(made, str):
        return made
    e1 = members.frame[i, :, :, 0] @ axes
    return Flat(
        kind=int(members.kind[i]),
        node=(int(members.node[i, 0]), int(members.node[i, 1])),
        offset=members.offset[i] @ axes[:, :2],
        frame=np.arctan2(e1[:, 1], e1[:, 0]),
        value=made,
        number=settings,
        length=float(members.length[i]),
        floor=float(members.floor[i]),
        heavy=heavy,
    )


def _merge(flats: list[Flat], size: float) -> tuple[list[int], list[int]]:
    """(first member of every group, group of every member)."""
    groups: dict[tuple, int] = {}
    first: list[int] = []
    twin: list[int] = []
    for i, flat in enumerate(flats):
        key = flat.key(size)
        if key not in groups:
            groups[key] = len(first)
            first.append(i)
        twin.append(groups[key])
    return first, twin


def _pack_members(flats: list[Flat], times: np.ndarray, places: Places) -> Members:
    """Arrays of the planar members; `times` (p,) spatial members each."""
    values = [stiffer(f, int(n)) for f, n in zip(flats, times, strict=True)]
    number = np.zeros((len(flats), 4), np.int64)
    number[:, :2] = [f.number for f in flats]
    sizes = np.array([f.sizes() for f in flats], np.int64)
    block = [
        [places.diagonal(f.node[0]), places.diagonal(f.node[1]), *places.coupling(*f.node)] for f in flats
    ]
    return Members(
        kind=np.array([f.kind for f in flats], np.int64),
        node=np.array([f.node for f in flats], np.int64),
        offset=np.array([f.offset for f in flats]),
        frame=np.array([f.frame for f in flats]),
        number=number,
        value_at=np.cumsum([0, *[len(v) for v in values[:-1]]]).astype(np.int64),
        value=np.concatenate(values),
        inner_at=np.concatenate([[0], np.cumsum(sizes[:, 0])]),
        store_at=np.concatenate([[0], np.cumsum(sizes[:, 1])]),
        length=np.array([f.length for f in flats]),
        floor=np.array([f.floor * n for f, n in zip(flats, times, strict=True)]),
        block=np.array(block, np.int64),
    )


def _pack_rows(terms: Terms, rows: np.ndarray, axes: np.ndarray, places: Places, start: np.ndarray) -> Terms:
    """The constraint rows `rows` (c,) of a spatial model, in the plane; start (c,): unknowns of their multipliers."""
    nodes = len(places.position) - len(rows) + 1
    first, keep, block, flip = [0], [], [], []
    for i, row in enumerate(rows):
        for t in range(terms.first[row], terms.first[row + 1]):
            a, b = (int(n) for n in terms.node[t])
            ends = [-1 if n == 0 else places.pair(nodes - 1 + i, n - 1)[0] for n in (a, b)]
            offset, turned = places.coupling(a, b)
            block.append([*ends, places.diagonal(a), places.diagonal(b), offset])
            flip.append(turned)
            keep.append(t)
        first.append(len(keep))
    kind = terms.kind[keep]
    along = terms.direction[keep] @ axes
    # a rotation keeps only its sense about k
    direction = np.where(
        (kind == ROTATION)[:, None], np.column_stack([along[:, 2], 0 * along[:, 2]]), along[:, :2]
    )
    return Terms(
        first=np.array(first, np.int64),
        start=start,
        coefficient=terms.coefficient[keep],
        kind=kind,
        node=terms.node[keep].reshape(-1, 2),
        direction=direction.reshape(-1, 2),
        point=(terms.point[keep] @ axes[:, :2]).reshape(-1, 2, 2),
        block=np.array(block, np.int64).reshape(-1, 5),
        flip=np.array(flip, np.int64),
    )


def _pack_loads(loads: Loads, axes: np.ndarray, places: Places) -> Loads:
    return Loads(
        node=loads.node.copy(),
        point=loads.point @ axes[:, :2],
        force=loads.force @ axes[:, :2],
        moment=loads.moment @ axes[:, 2],
        following=loads.following.copy(),
        # a moment across the plane turns nothing but the angle it works on
        skew=loads.following.copy(),
        block=np.array([places.diagonal(int(n)) for n in loads.node], np.int64),
    )


def _pairs(arrays: Arrays, rows: np.ndarray) -> list[tuple[int, int]]:
    """Coupled blocks: block b of node k is k - 1, constraint i is nodes - 1 + i; ground has none."""
    nodes, terms = len(arrays.start), arrays.terms
    ends = np.concatenate([arrays.members.node, arrays.springs.node])
    found = [(int(a) - 1, int(b) - 1) for a, b in ends]
    for i, row in enumerate(rows):
        for a, b in terms.node[terms.first[row] : terms.first[row + 1]]:
            found += [(int(k) - 1, nodes - 1 + i) for k in (a, b)] + [(int(a) - 1, int(b) - 1)]
    return [pair for pair in found if min(pair) >= 0]


def pack_flat(
    arrays: Arrays,
    flats: list[Flat],
    *,
    axes: np.ndarray,
    rows: np.ndarray,
    springs: Sequence[Flat] = (),
    last: int = 0,
) -> tuple[Arrays, np.ndarray]:
    """Planar arrays of the members `flats`, and the planar member that stands for each of them, (m,).

    arrays: the spatial ones, for nodes, rows and loads; axes (3, 3): columns i, j, k; rows (c,): constraint rows that
    act in the plane; last: nodes eliminated last, see `plan_blocks`.
    """
    nodes = len(arrays.start)
    size = np.array([3] * (nodes - 1) + [1] * len(rows), np.int64)
    waits = np.arange(len(size)) >= nodes - 1
    plan, position, offsets = plan_blocks(size, _pairs(arrays, rows), waits=waits, last=last)
    places = Places(offsets, position)
    start = np.full(nodes, -1, np.int64)
    start[1:] = plan.start[position[: nodes - 1]]
    first, twin = _merge(flats, arrays.size)
    times = np.bincount(twin)
    members = _pack_members([flats[i] for i in first], times, places)
    terms = _pack_rows(arrays.terms, rows, axes, places, plan.start[position[nodes - 1 :]])
    loads = _pack_loads(arrays.loads, axes, places)
    weight = np.zeros((0, 3))
    if len(arrays.weight):
        weight = np.column_stack([times * arrays.weight[first, 0], arrays.weight[first, 1:] @ axes[:, :2]])
    made = Arrays(plan, start, members, terms, loads, arrays.size, pack_springs(springs, places), 0, weight)
    return made, np.array(twin)


def flatten(
    arrays: Arrays,
    flats: list[Flat],
    sense: np.ndarray,
    *,
    axes: np.ndarray,
    rows: np.ndarray,
    rest: np.ndarray,
    springs: Sequence[Flat] = (),
) -> tuple[Arrays, Lifting]:
    """Planar arrays and how they stand in space.

    flats: every member in the plane, e3 = sense (m,) times k; axes (3, 3): columns i, j, k; rows (c,): constraint rows
    that act in the plane; rest (k, 3): positions at rest [m]; springs: in the plane, as the members.
    """
    made, twin = pack_flat(arrays, flats, axes=axes, rows=rows, springs=springs)
    to, of, factor, *turns = inner_copies(arrays.members, made.members, twin, sense)
    return made, Lifting(axes, rest @ axes[:, 2], to, of, factor, turns[0], turns[1], turns[2], rows)
