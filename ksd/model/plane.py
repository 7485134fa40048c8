"""Whether a model is planar, and the same model with three unknowns per node.

Looked at here: the leafs' width axes, drives and supports, loads. Symmetry about the plane is not asked for; whether
the leafs balance across it is seen when the spatial residual is evaluated at a planar answer (`Plane.imbalance`). A
planar scene is thus checked, never trusted (design section 4).

A planar model is the spatial one with z, rx and ry left out of the numbering (`Arrays.keep`), for a plane across one
of the global axes: same members, same state, same rows; leafs without weight condense in closed form in the angle
(`ksd.beam.planar_leaf`). An oblique plane is solved in space.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ksd.beam.planar_leaf import planar_values, store_size
from ksd.model.arrays import (
    COIL,
    COROTATIONAL,
    LINEAR,
    MODAL,
    PLANAR,
    ROTATION,
    SOLID,
    STRAIN,
    TURN,
    Arrays,
    Members,
    Motion,
    Work,
)
from ksd.model.compile import Model
from ksd.model.pack import Places, coupled, numbering

PARALLEL = 1e-9
"""Sine of the angle below which two directions count as parallel."""
INSIDE, OUTSIDE = (0, 1, 5), (2, 3, 4)
"""Motions in the plane, and across it, of end q in a frame p whose e3 is the normal."""


@dataclass(frozen=True)
class Plane:
    """The plane of a spatial model `space`: across global axis `axis`; rows (r,): constraint rows that act in it."""

    space: Arrays
    rest: Motion
    axis: int
    rows: np.ndarray

    @property
    def normal(self) -> np.ndarray:
        """Unit normal k (3,) of the plane, global axes."""
        return np.eye(3)[self.axis]

    @cached_property
    def arrays(self) -> Arrays:
        """The spatial arrays with three unknowns per node."""
        return _masked(self.space, self.axis, self.rows)

    def holds(self, motion: Motion) -> bool:
        """Whether the nodes of a state are in the plane."""
        k, size = self.normal, self.space.size
        off = np.abs((motion.x - self.rest.x) @ k).max(initial=0.0)
        return bool(off <= 1e-9 * size and np.abs(motion.R @ k - k).max(initial=0.0) <= 1e-9)

    def imbalance(self, work: Work) -> tuple[float, int, float, float]:
        """Residual across the plane in `work`, as assembled in space by `ksd.model.system.assemble` at a planar state.

        Returns (the largest over its bound, the node it acts on, its force [N] along k, its moment [Nm] across k).
        """
        at = self.space.start[1:, None]
        k = self.normal
        force = np.abs(work.rhs[at + np.arange(3)] @ k)
        turn = work.rhs[at + np.arange(3, 6)]
        moment = np.linalg.norm(turn - np.outer(turn @ k, k), axis=1)
        share = np.maximum(force / (work.scale[1:, 0] + 1e-300), moment / (work.scale[1:, 1] + 1e-300))
        worst = int(np.argmax(share))
        return float(share[worst]), worst + 1, float(force[worst]), float(moment[worst])


def _masked(arrays: Arrays, axis: int, rows: np.ndarray) -> Arrays:
    """The arrays with those unknowns of every node that are in the plane across global axis `axis`, and `rows` alone."""
    keep = np.array([*(c for c in range(3) if c != axis), 3 + axis])
    nodes, terms, springs = len(arrays.start), arrays.terms, arrays.springs
    first, node = terms.first.tolist(), terms.node.tolist()
    own = [[(0, *node[t]) for t in range(first[row], first[row + 1])] for row in rows.tolist()]
    ends = [*arrays.members.node.tolist(), *springs.node.tolist()]
    plan, places, start, start_of_rows = numbering(nodes, len(keep), coupled(nodes, ends, own), len(rows))
    row_start = np.full(len(terms.start), -1, np.int64)
    row_start[rows] = start_of_rows
    block, flip = np.full_like(terms.block, -1), np.zeros_like(terms.flip)
    for i, row in enumerate(rows.tolist()):
        for t in range(first[row], first[row + 1]):
            block[t], flip[t] = places.term(nodes - 1 + i, *node[t])
    load_block = np.array([places.diagonal(n) for n in arrays.loads.node.tolist()], np.int64)
    return arrays._replace(
        plan=plan,
        start=start,
        members=_members(arrays, places),
        terms=terms._replace(start=row_start, block=block, flip=flip),
        # a moment along the normal has an energy in the plane
        loads=arrays.loads._replace(block=load_block, skew=arrays.loads.following.copy()),
        springs=springs._replace(block=_blocks(springs.node, places)) if len(springs.kind) else springs,
        keep=keep,
    )


def _blocks(nodes: np.ndarray, places: Places) -> np.ndarray:
    """Stored blocks (m, 4) of members between nodes (m, 2), see `Members`."""
    return np.array([places.member(a, b) for a, b in nodes.tolist()], np.int64).reshape(-1, 4)


def _members(arrays: Arrays, places: Places) -> Members:
    """The members, light strain-mode leafs by their planar kernel."""
    members = arrays.members
    kind, number, value_at = members.kind.copy(), members.number.copy(), members.value_at.copy()
    store, values, known = np.diff(members.store_at), [members.value], {}
    end = len(members.value)
    for i in range(len(kind)):
        if kind[i] != STRAIN or _heavy(arrays, i):
            continue
        of = int(members.value_at[i]), members.number[i].tobytes()
        if of not in known:
            made, settings = planar_values(members.value[members.value_at[i] :], members.number[i])
            known[of] = end, settings
            values.append(made)
            end += len(made)
        value_at[i], number[i] = known[of]
        kind[i], store[i] = PLANAR, store_size(int(number[i, 0]))
    return members._replace(
        kind=kind,
        number=number,
        value_at=value_at,
        value=np.concatenate(values),
        store_at=np.concatenate([[0], np.cumsum(store)]).astype(np.int64),
        block=_blocks(members.node, places),
    )


def _heavy(arrays: Arrays, i: int) -> bool:
    """Whether member i has weight."""
    return len(arrays.weight) > 0 and bool(arrays.weight[i, 0] > 0.0)


def _normal_axis(arrays: Arrays) -> tuple[int, np.ndarray]:
    """The global axis nearest to the width of the first leaf, and that direction (3,), its largest component positive."""
    k = arrays.members.frame[0, 0, :, 2]
    k = k / np.linalg.norm(k)
    axis = int(np.argmax(np.abs(k)))
    return axis, k * np.sign(k[axis])


def _spoken(v: np.ndarray) -> str:
    return f"({', '.join(f'{c + 0.0:.4g}' for c in v)})"


def _leaving_member(model: Model, k: np.ndarray) -> str:
    """Why a member is not in the plane across k, naming the first; empty when all are."""
    members = model.arrays.members
    for i, name in enumerate(model.member_names):
        if members.kind[i] == LINEAR:
            return f"'{name}' is a condensed joint, which has no planar form"
        if members.kind[i] in (MODAL, SOLID):
            return f"'{name}' is a reduced body, which has no planar form"
        for e3 in members.frame[i, :, :, 2]:
            if np.linalg.norm(np.cross(e3, k)) > PARALLEL:
                return f"the width of leaf '{name}' is along {_spoken(e3)}, that of the others along {_spoken(k)}"
        if not _straight_across(members, i):
            return f"leaf '{name}' is curved or twisted out of the plane at rest"
    return ""


def _straight_across(members: Members, i: int) -> bool:
    """Whether member i is neither curved nor twisted out of its plane at rest."""
    value, number = members.value[members.value_at[i] :], members.number[i]
    if members.kind[i] == COROTATIONAL:
        n = int(number[0])
        turned = np.concatenate([value[: 16 * n].reshape(n, 16)[:, 7:], value[16 * n : 16 * n + 9][None]])
        return bool(np.abs(turned[:, [2, 5, 6, 7]]).max() <= 1e-12)
    nx, ny, nz = (int(n) for n in number[:3])
    start = 1 + nx * nx + ny * ny + nz * nz
    return not np.any(value[start : start + nx + ny])


def _leaving_spring(model: Model, k: np.ndarray) -> str:
    """Why a spring is not in the plane across k, naming the first; empty when all are."""
    springs, rest = model.arrays.springs, model.rest.x
    for i, name in enumerate(model.spring_names):
        node, kind = springs.node[i], springs.kind[i]
        if kind == COIL:
            ends = rest[node] + springs.offset[i]
            across = (ends[1] - ends[0]) @ k
            if abs(across) > PARALLEL * springs.length[i]:
                return f"{name} pulls across the plane, its ends being {1e3 * across:.3g} mm apart along the normal"
        elif np.linalg.norm(np.cross(springs.frame[i, :, :, 2], k), axis=1).max() > PARALLEL:
            return f"{name} has its {'axis' if kind == TURN else 'width axis'} in the plane"
        elif kind == LINEAR and _couples(springs.value[springs.value_at[i] :]):
            return f"{name} couples motions in the plane with motions across it"
    return ""


def _couples(value: np.ndarray) -> bool:
    """Whether a linear body, constants as of `ksd.beam.linear`, couples motions in the plane with motions across it."""
    d0, R0, F, K = value[:3], value[3:12].reshape(3, 3), value[12:18], value[18:54].reshape(6, 6)
    leaves = max(
        np.abs(K[np.ix_(INSIDE, OUTSIDE)]).max() / np.abs(K).max(), abs(d0[2]), np.abs(R0[:2, 2]).max()
    )
    return bool(leaves > PARALLEL or np.abs(F[list(OUTSIDE)]).max() > 0.0)


def _planar_rows(model: Model, k: np.ndarray) -> np.ndarray | str:
    """Constraint rows (c,) that act in the plane; supports that only hold the mechanism in it are left out."""
    terms, drives = model.arrays.terms, len(model.drive_names)
    rows = []
    for i, name in enumerate((*model.drive_names, *model.support_names)):
        span = slice(terms.first[i], terms.first[i + 1])
        turning = terms.kind[span] == ROTATION
        along = np.abs(terms.direction[span] @ k)
        across = np.linalg.norm(np.cross(terms.direction[span], k), axis=1)
        inside = np.where(turning, across, along) <= PARALLEL
        outside = np.where(turning, along, across) <= PARALLEL
        if np.all(inside):
            rows.append(i)
        elif i < drives or not np.all(outside):
            what = "rotates about" if turning[np.argmin(inside)] else "moves along"
            direction = terms.direction[span][np.argmin(inside)]
            word = "drive" if i < drives else "support"
            return f"{word} '{name}' {what} {_spoken(direction)}, out of the plane across {_spoken(k)}"
    return np.array(rows, np.int64)


def _load_name(model: Model, i: int) -> str:
    """Name of load i: those on links that move, in the order of the scene, then the weights."""
    names = [f"load '{load.name}'" for load in model.scene.loads if load.link != model.scene.links[0]]
    names += [f"the weight of link '{mass.link}'" for mass in model.scene.masses]
    return names[i] if i < len(names) else f"load {i + 1}"


def _leaving_load(model: Model, k: np.ndarray) -> str:
    """The first load that pushes or turns the mechanism out of the plane, in words; empty when none does."""
    loads = model.arrays.loads
    for i in range(len(loads.node)):
        force, moment = loads.force[i], loads.moment[i]
        if abs(force @ k) > PARALLEL * np.linalg.norm(force):
            return f"{_load_name(model, i)} pushes along {_spoken(force)} N, out of the plane across {_spoken(k)}"
        if np.linalg.norm(np.cross(moment, k)) > PARALLEL * np.linalg.norm(moment):
            return f"{_load_name(model, i)} turns about {_spoken(moment)} Nm, out of the plane across {_spoken(k)}"
    gravity = model.arrays.weight[:1, 1:].ravel()
    if len(gravity) and abs(gravity @ k) > PARALLEL * np.linalg.norm(gravity):
        return f"the weight of the leafs pulls along {_spoken(gravity)} m/s^2, out of the plane across {_spoken(k)}"
    return ""


def _find_plane(model: Model) -> Plane | str:
    """See `plane_of`; this one looks every time."""
    if not len(model.arrays.members.kind):
        return "it has no leafs to show a plane"
    axis, k = _normal_axis(model.arrays)
    rows = _planar_rows(model, k)
    reason = (
        _leaving_member(model, k)
        or (rows if isinstance(rows, str) else "")
        or _leaving_load(model, k)
        or _leaving_spring(model, k)
    )
    if reason:
        return reason
    if np.linalg.norm(np.cross(k, np.eye(3)[axis])) > PARALLEL:
        return f"its plane, across {_spoken(k)}, is across none of the global axes"
    assert not isinstance(rows, str)
    return Plane(model.arrays, model.rest, axis, rows)


def plane_of(model: Model) -> Plane | str:
    """The model in its plane, or the reason (a clause naming leaf, drive, support or load) why it is not planar.

    Planar means: the widths e3 of all leafs parallel to one direction k, drives and supports acting across k (rotations
    about k), forces across k and moments about k. Supports that hold the mechanism in the plane are allowed and left
    out. The answer is remembered for as long as the model lives.
    """
    found: Plane | str | None = model.derived.get("plane")
    if found is None:
        found = model.derived["plane"] = _find_plane(model)
    return found


def refuse_plane(model: Model, reason: str) -> None:
    """Remember that the leafs of `model` do not balance across its plane, so that it is not tried again."""
    model.derived["plane"] = reason
