"""The springs of a spatial model in its plane."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ksd.model.arrays import COIL, LINEAR, TURN, Members
from ksd.model.pack import Places
from ksd.model.planar_flat import Flat

PARALLEL = 1e-9
"""Sine of the angle below which two directions count as parallel."""
INSIDE, OUTSIDE = (0, 1, 5), (2, 3, 4)
"""Motions in the plane, and across it, of end q in a frame p whose e3 is the normal."""


def flat_spring(springs: Members, i: int, axes: np.ndarray, rest: np.ndarray) -> Flat | str:
    """Spring i in the plane `axes` (columns i, j, k), or why it is not in it; rest (k, 3): nodes at rest [m]."""
    k, node, value = axes[:, 2], springs.node[i], springs.value[springs.value_at[i] :]
    kind = int(springs.kind[i])
    e3 = springs.frame[i, :, :, 2]
    if kind == COIL:
        across = (rest[node[1]] + springs.offset[i, 1] - rest[node[0]] - springs.offset[i, 0]) @ k
        if abs(across) > PARALLEL * springs.length[i]:
            return f"pulls across the plane, its ends being {1e3 * across:.3g} mm apart along the normal"
        made, sense = value[:2].copy(), 1.0
    elif np.linalg.norm(np.cross(e3, k), axis=1).max() > PARALLEL:
        return "has its axis in the plane" if kind == TURN else "has its width axis in the plane"
    else:
        sense = float(np.sign(e3[0] @ k))
        made_or_not = _linear(value, kind, sense)
        if isinstance(made_or_not, str):
            return made_or_not
        made = made_or_not
    e1 = springs.frame[i, :, :, 0] @ axes
    return Flat(
        kind=COIL if kind == COIL else LINEAR,
        node=(int(node[0]), int(node[1])),
        offset=springs.offset[i] @ axes[:, :2],
        frame=np.arctan2(e1[:, 1], e1[:, 0]),
        value=made,
        number=np.zeros(1, np.int64),
        length=float(springs.length[i]),
        floor=float(springs.floor[i]),
    )


def _linear(value: np.ndarray, kind: int, sense: float) -> np.ndarray | str:
    """end0 (3), F (3), K (9) in the plane; e3 of frame p is sense times the normal."""
    made = np.zeros(15)
    if kind == TURN:
        made[5], made[14] = -value[0] * sense * value[1], value[0]
        return made
    d0, R0, F, K = value[:3], value[3:12].reshape(3, 3), value[12:18], value[18:54].reshape(6, 6)
    largest = np.abs(K).max()
    leaves = max(np.abs(K[np.ix_(INSIDE, OUTSIDE)]).max() / largest, abs(d0[2]), np.abs(R0[:2, 2]).max())
    if leaves > PARALLEL or np.abs(F[list(OUTSIDE)]).max() > 0.0:
        return "couples motions in the plane with motions across it"
    turn = np.diag([1.0, sense, sense])
    made[:3] = turn @ [d0[0], d0[1], np.arctan2(R0[1, 0], R0[0, 0])]
    made[3:6] = turn @ F[list(INSIDE)]
    made[6:] = (turn @ K[np.ix_(INSIDE, INSIDE)] @ turn).ravel()
    return made


def pack_springs(flats: Sequence[Flat], places: Places) -> Members:
    """Arrays of the springs, packed as members without inner unknowns."""
    if not flats:
        return NO_PLANAR_SPRINGS
    return _packed(flats, places)


def _packed(flats: Sequence[Flat], places: Places) -> Members:
    block = [
        [places.diagonal(f.node[0]), places.diagonal(f.node[1]), *places.coupling(*f.node)] for f in flats
    ]
    number = np.zeros((len(flats), 4), np.int64)
    return Members(
        kind=np.array([f.kind for f in flats], np.int64),
        node=np.array([f.node for f in flats], np.int64).reshape(-1, 2),
        offset=np.array([f.offset for f in flats], float).reshape(-1, 2, 2),
        frame=np.array([f.frame for f in flats], float).reshape(-1, 2),
        number=number,
        value_at=np.cumsum([0, *[len(f.value) for f in flats]])[: len(flats)].astype(np.int64),
        value=np.concatenate([*[f.value for f in flats], np.zeros(1)]),
        inner_at=np.zeros(len(flats) + 1, np.int64),
        store_at=np.zeros(len(flats) + 1, np.int64),
        length=np.array([f.length for f in flats], float),
        floor=np.array([f.floor for f in flats], float),
        block=np.array(block, np.int64).reshape(-1, 4),
    )


NO_PLANAR_SPRINGS = _packed((), Places({}, np.zeros(0, np.int64)))
"""What all planar models without springs share."""
