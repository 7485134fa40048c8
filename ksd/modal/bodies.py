"""Leafs of a model as modal bodies: the same nodes, links, drives and loads, with chains replaced by reduced bodies.

`resist` of such a body is its compiled kernel (`ksd.beam.modal`), `inside` its nodes (`inside`), and it allows what
its end frames do: bodies share interface nodes, so a mechanism of them needs no multipliers of its own, and any member
that is not replaced (a strain-mode leaf, a condensed KSD joint) works next to them.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ksd.beam.corotational_values import sizes as chain_sizes
from ksd.beam.modal import modal_sizes
from ksd.beam.modal_jets import JET, boundary_jets
from ksd.errors import SceneError
from ksd.modal.basis import LeafBasis, LeafShape, chain_records, make_basis, rest_basis
from ksd.modal.choices import ModalBasis
from ksd.model.arrays import COROTATIONAL, MODAL, Arrays, Members, Motion
from ksd.model.compile import Model
from ksd.model.mesh import Mesh

ALIKE = 10
"""Decimals of positions over length, and of rotations, to which leafs of one shape share their basis."""


@dataclass(frozen=True)
class ModalMesh(Mesh):
    """Chains of which leafs are reduced, all by `choices`, or, where some leafs only, by what stands in `named`."""

    choices: ModalBasis = field(default_factory=ModalBasis)
    named: tuple[tuple[ModalBasis, tuple[str, ...]], ...] = ()

    def __str__(self) -> str:
        if not self.named:
            return f"modal bodies: {self.choices}"
        said = "; ".join(f"{', '.join(names)}: {choices}" for choices, names in self.named)
        return f"modal bodies ({said}) beside {super().__str__()}"


@dataclass(frozen=True, repr=False)
class ModalModel(Model):
    """A model with modal bodies; `full` is the model they reduce, bodies[i] the basis of member i (None if not one)."""

    full: Any = None
    bodies: tuple[LeafBasis | None, ...] = ()

    @property
    def reduced(self) -> tuple[str, ...]:
        """Names of the leafs that are modal bodies."""
        return tuple(n for n, b in zip(self.member_names, self.bodies, strict=True) if b is not None)

    @property
    def unknowns_per_body(self) -> int:
        """The largest number of independent coordinates of a body."""
        return max((b.rank for b in self.bodies if b is not None), default=0)


def member_pose(members: Members, i: int, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Position d (3,) and orientation Q (3, 3) of end q of member i in the frame of its end p."""
    a, b = members.node[i]
    offset, frame = members.offset[i], members.frame[i]
    axes = motion.R[a] @ frame[0]
    d = motion.x[b] + motion.R[b] @ offset[1] - motion.x[a] - motion.R[a] @ offset[0]
    return axes.T @ d, axes.T @ motion.R[b] @ frame[1]


def chain_shape(arrays: Arrays, i: int, motion: Motion) -> LeafShape:
    """Nodes of the chain that is member i, at `motion`, in the frame of its end p."""
    members = arrays.members
    n = int(members.number[i, 0])
    value = members.value[members.value_at[i] : members.value_at[i] + 16 * n + 9]
    nodes = motion.inner[members.inner_at[i] : members.inner_at[i] + 12 * (n - 1)].reshape(-1, 12)
    d, Q = member_pose(members, i, motion)
    x = np.vstack([np.zeros(3), nodes[:, :3], d])
    R = np.concatenate(
        [np.eye(3)[None], nodes[:, 3:].reshape(-1, 3, 3), (Q @ value[16 * n :].reshape(3, 3).T)[None]]
    )
    return LeafShape(chain_records(value, n), x, R)


def with_modal_bodies(
    model: Model,
    choices: ModalBasis | Mapping[str, ModalBasis],
    *,
    about: Motion | None = None,
    only: Collection[str] | None = None,
    at_rest: Collection[str] = (),
) -> ModalModel:
    """`model`, in which the leafs to reduce are chains, with these as modal bodies.

    choices: of all, or by name of the leaf, the others staying what they are. about: state of `model` to expand the
    bases at (a trained configuration: the tangent basis); rest when None. only: names of the leafs to reduce (all when
    None). at_rest: names of those expanded at rest all the same. Raises SceneError for unknown names and for leafs that
    are not chains or whose tangent is singular.
    """
    chosen = _chosen(model, choices, only)
    bodies: list[LeafBasis | None] = []
    alike: dict[tuple, LeafBasis] = {}
    for i, name in enumerate(model.member_names):
        place = None if name in at_rest else about
        bodies.append(_body(model, i, chosen[i], place, alike) if i in chosen else None)
    arrays, inner = replaced(model.arrays, model.rest.inner, bodies)
    mesh = _described(model, chosen)
    rest = model.rest._replace(inner=inner)
    kept = {k: getattr(model, k) for k in Model.__dataclass_fields__}
    return ModalModel(
        **{**kept, "arrays": arrays, "rest": rest, "mesh": mesh}, full=model, bodies=tuple(bodies)
    )


def _body(
    model: Model, i: int, choices: ModalBasis, about: Motion | None, alike: dict[tuple, LeafBasis]
) -> LeafBasis:
    """The basis of member i, about the state `about` or at rest; alike: those made so far, by shape to rounding."""
    shape = chain_shape(model.arrays, i, model.rest if about is None else about)
    try:
        if about is None:
            return rest_basis(shape.record, choices)
        places = np.round(np.hstack([shape.x / shape.length, shape.R.reshape(-1, 9)]), ALIKE)
        # -0.0 and 0.0 are alike
        key = shape.record.tobytes(), (places + 0.0).tobytes(), choices
        if key not in alike:
            alike[key] = make_basis(shape, choices)
        return alike[key]
    except ValueError as reason:
        raise SceneError(f"leaf '{model.member_names[i]}' has no modal basis: {reason}") from reason


def _described(model: Model, chosen: Mapping[int, ModalBasis]) -> ModalMesh:
    """The mesh of a model of which some members are reduced, in words a result prints."""
    words = {k: getattr(model.mesh, k) for k in Mesh.__dataclass_fields__}
    different = list(dict.fromkeys(chosen.values()))
    if len(different) == 1 and len(chosen) == len(model.member_names):
        return ModalMesh(**{**words, "elements": different[0].elements}, choices=different[0])
    named = tuple((c, tuple(model.member_names[i] for i in chosen if chosen[i] == c)) for c in different)
    return ModalMesh(**words, choices=different[0] if different else ModalBasis(), named=named)


def _chosen(
    model: Model, choices: ModalBasis | Mapping[str, ModalBasis], only: Collection[str] | None
) -> dict[int, ModalBasis]:
    """The members to reduce, each with its basis."""
    names = model.member_names
    by_name = choices if isinstance(choices, Mapping) else dict.fromkeys(only or names, choices)
    for name in by_name:
        if name not in names:
            raise SceneError(f"there is no leaf '{name}' to reduce; the leafs are: {', '.join(names)}")
    found = {i: by_name[name] for i, name in enumerate(names) if name in by_name}
    for i in found:
        if model.arrays.members.kind[i] != COROTATIONAL or model.arrays.members.number[i, 0] < 2:
            raise SceneError(
                f"leaf '{names[i]}' is not a chain of elements: compile with Mesh('corotational', elements=10)"
            )
        count = int(model.arrays.members.number[i, 0])
        if np.diff(model.arrays.members.store_at)[i] > chain_sizes(count).store:
            raise SceneError(
                f"leaf '{names[i]}' carries its own weight, which modal bodies do not know: compile "
                "without='gravity', or use another method"
            )
    return found


def replaced(
    arrays: Arrays, inner: np.ndarray, bodies: list[LeafBasis | None], weights: dict[int, Any] | None = None
) -> tuple[Arrays, np.ndarray]:
    """Arrays and rest inner states with member i made of bodies[i]; weights: of sampled elements, by member."""
    old = arrays.members
    kind, number, frame = old.kind.copy(), old.number.copy(), old.frame.copy()
    value_at, values, states, stores = old.value_at.copy(), [old.value], [], []
    at, seen = len(old.value), {}
    for i, body in enumerate(bodies):
        states.append(inner[old.inner_at[i] : old.inner_at[i + 1]])
        stores.append(int(old.store_at[i + 1] - old.store_at[i]))
        if body is None:
            continue
        w = (weights or {}).get(i)
        key = (id(body), None if w is None else w.tobytes())
        value, settings = body.constants(w)
        if key not in seen:
            seen[key] = at
            values.append(value)
            at += len(value)
        kind[i], number[i], value_at[i] = MODAL, settings, seen[key]
        # the body knows rotations from rest only
        frame[i, 1] = old.frame[i, 1] @ _rest_end(old, i).T
        size, stores[i] = modal_sizes(int(settings[1]))
        states[i] = np.zeros(size)
    members = old._replace(
        kind=kind, number=number, frame=frame, value_at=value_at, value=np.concatenate([*values, np.zeros(1)]),
        inner_at=np.cumsum([0] + [len(s) for s in states]).astype(np.int64),
        store_at=np.cumsum([0, *stores]).astype(np.int64),
    )  # fmt: skip
    return arrays._replace(members=members), np.concatenate([np.zeros(0), *states])


def _rest_end(members: Members, i: int) -> np.ndarray:
    """Undeformed orientation (3, 3) of end q of the chain that is member i."""
    at = members.value_at[i] + 16 * members.number[i, 0]
    return members.value[at : at + 9].reshape(3, 3)


def boundary_values(body: LeafBasis, d: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """Boundary values b (nb,) of a body with its end q at d (3,) m, Q (3, 3) in the frame of its end p."""
    reference = np.concatenate([body.orientation[0], body.orientation[-1]])
    jets = np.empty((len(body.b0), JET))
    angle = body.choices.coordinates == "angle"
    boundary_jets(int(body.choices.frame == "chord"), int(angle), reference, d, Q, jets)
    return np.asarray(jets[:, 0])


def carried_over(
    smaller: LeafBasis, body: LeafBasis, d: np.ndarray, Q: np.ndarray, eta: np.ndarray
) -> np.ndarray:
    """Inner coordinates of `body` with the nodes nearest to those of another basis of the same leaf, at its eta."""
    b = boundary_values(body, d, Q)
    rest = smaller.nodes(b, eta) - body.nodes(b, np.zeros(body.inner.shape[1]))
    return np.asarray(np.linalg.lstsq(body.inner, rest, rcond=None)[0])


def body_nodes(
    body: LeafBasis, d: np.ndarray, Q: np.ndarray, eta: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n+1, 3) and rotations from rest (n+1, 3, 3) of a body's nodes, in the frame of its end p."""
    from scipy.spatial.transform import Rotation

    z = body.nodes(boundary_values(body, d, Q), eta).reshape(-1, body.values_per_node)
    if body.choices.coordinates == "angle":
        start = body.orientation.reshape(-1, 3, 3).transpose(0, 2, 1)
        R = Rotation.from_rotvec(z[:, 3:]).as_matrix() @ start
    else:
        R = _frames(z[:, 3:6], z[:, 6:])
    return (z[:, :3] - z[0, :3]) @ R[0], np.einsum("ji,kjl->kil", R[0], R)


def _frames(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Gram-Schmidt frames (k, 3, 3) of directors a, b (k, 3)."""
    e1 = a / np.linalg.norm(a, axis=1)[:, None]
    e2 = b - np.einsum("ki,ki->k", b, e1)[:, None] * e1
    e2 /= np.linalg.norm(e2, axis=1)[:, None]
    return np.stack([e1, e2, np.cross(e1, e2)], axis=2)


def inside(model: ModalModel, motion: Motion) -> Motion:
    """The state of the full model at a state of the modal one: all nodes of all bodies, stresses of the chains zero.

    The full model with plain Newton needs no stresses; see `ksd.modal.health`.
    """
    full = model.full
    state = replace_inner(full.rest.copy(), motion)
    old, new = full.arrays.members, model.arrays.members
    for i, body in enumerate(model.bodies):
        mine = motion.inner[new.inner_at[i] : new.inner_at[i + 1]]
        target = state.inner[old.inner_at[i] : old.inner_at[i + 1]]
        if body is None:
            target[:] = mine
            continue
        x, R = body_nodes(body, *member_pose(new, i, motion), mine)
        n = len(body.record)
        target[: 12 * (n - 1)] = np.hstack([x[1:-1], R[1:-1].reshape(-1, 9)]).ravel()
    return state


def replace_inner(state: Motion, motion: Motion) -> Motion:
    """`state` with the poses and multipliers of `motion`."""
    state.x[:], state.R[:], state.multiplier[:] = motion.x, motion.R, motion.multiplier
    return state


__all__ = [
    "ModalMesh",
    "ModalModel",
    "body_nodes",
    "carried_over",
    "chain_shape",
    "inside",
    "member_pose",
    "replace",
    "replaced",
    "with_modal_bodies",
]
