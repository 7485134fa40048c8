"""Leaf springs of a model as modal bodies: which chains they reduce, their bases, and the nodes of these chains at a state.

Their kernel is `ksd.beam.modal`; next to them any leaf that is not reduced, and any condensed joint, works as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace

import numpy as np

from ksd.beam.corotational_values import sizes as chain_sizes
from ksd.errors import SceneError
from ksd.modal.choices import ModalBasis
from ksd.modal.leaf_basis import LeafBasis, LeafShape, chain_records, make_basis, undeformed_basis
from ksd.model.arrays import COROTATIONAL, State
from ksd.model.compile import Model, compile_as_is
from ksd.model.constant_leaves import equilibrate_bent_leaves, is_constant
from ksd.model.mesh import Mesh, MixedMesh
from ksd.model.reduced_bodies import inner_state, relative_end_pose, transfer_state, with_bodies

ALIKE = 10
"""Decimals of positions over length, and of rotations, to which leaf springs of one shape share their basis."""


def with_chains(model: Model, leaves: Mapping[str, ModalBasis]) -> Model:
    """`model` with `leaves` as chains of the elements their basis asks for, the others as they are; none cut into nodes."""
    mesh = replace(model.mesh, nodal=False)
    chains = {
        replace(mesh, leaf="corotational", elements=count): tuple(
            n for n, b in leaves.items() if b.elements == count
        )
        for count in sorted({b.elements for b in leaves.values()})
    }
    if len(chains) == 1 and len(leaves) == len(model.member_names):
        (mesh,) = chains
    elif chains:
        words = {k: getattr(mesh, k) for k in Mesh.__dataclass_fields__}
        mesh = MixedMesh(**words, others=tuple(chains.items()))
    return model if mesh == model.mesh else compile_as_is(model.scene, mesh, model.said, model.choice)


def chain_shape(model: Model, i: int, motion: State) -> LeafShape:
    """Nodes of the chain that is member i of `model`, at `motion`, in the frame of its end p."""
    members = model.arrays.members
    n = int(members.number[i, 0])
    value = members.value[members.value_at[i] : members.value_at[i] + 16 * n + 9]
    nodes = inner_state(model, motion, i)[: 12 * (n - 1)].reshape(-1, 12)
    d, Q = relative_end_pose(members, i, motion)
    x = np.vstack([np.zeros(3), nodes[:, :3], d])
    R = np.concatenate(
        [np.eye(3)[None], nodes[:, 3:].reshape(-1, 3, 3), (Q @ value[16 * n :].reshape(3, 3).T)[None]]
    )
    return LeafShape(chain_records(value, n), x, R)


def with_modal_bodies(
    model: Model,
    choices: ModalBasis | Mapping[str, ModalBasis],
    *,
    about: State | None = None,
    only: Collection[str] | None = None,
    at_rest: Collection[str] = (),
) -> Model:
    """`model`, in which the leaves to reduce are chains, with these as modal bodies; `model` itself becomes its `full`.

    choices: of all, or by name of the leaf, the others staying what they are. about: state of `model` to expand the
    bases at (a trained configuration: the tangent basis); rest when None. only: names of the leaves to reduce (all when
    None). at_rest: names of those expanded at rest all the same. Raises SceneError for unknown names and for leaves that
    are not chains or whose tangent is singular.
    """
    by_name = choices if isinstance(choices, Mapping) else dict.fromkeys(only or model.member_names, choices)
    alike: dict[tuple, LeafBasis] = {}
    bodies = {
        name: _body(model, name, by_name[name], None if name in at_rest else about, alike)
        for name in sorted(by_name, key=_order(model, by_name))
    }
    return replace(with_bodies(model, bodies), full=model)


def _order(model: Model, names: Collection[str]) -> Callable[[str], int]:
    """Key that sorts names of leaf springs as the model does.

    Raises SceneError for a name that is none, and for leaf springs that cannot be reduced.
    """
    place = {name: i for i, name in enumerate(model.member_names)}
    members = model.arrays.members
    for name in names:
        if name not in place:
            raise SceneError(f"there is no leaf '{name}' to reduce; the leaf springs are: {', '.join(place)}")
        i = place[name]
        count = int(members.number[i, 0])
        if members.kind[i] != COROTATIONAL or count < 2:
            raise SceneError(
                f"leaf '{name}' is not a chain of elements: compile with Mesh('corotational', elements=10)"
            )
        if np.diff(members.store_at)[i] > chain_sizes(count).store:
            raise SceneError(
                f"leaf '{name}' carries its own weight, which modal bodies do not know: compile "
                "without='gravity', or use another method"
            )
    return place.__getitem__


def _body(
    model: Model, name: str, choices: ModalBasis, about: State | None, alike: dict[tuple, LeafBasis]
) -> LeafBasis:
    """The basis of a leaf, about the state `about` or at rest; alike: those made so far, by shape to rounding."""
    shape = chain_shape(model, model.member_names.index(name), model.rest if about is None else about)
    try:
        if about is None:
            return undeformed_basis(shape.record, choices)
        places = np.round(np.hstack([shape.x / shape.length, shape.R.reshape(-1, 9)]), ALIKE)
        # -0.0 and 0.0 are alike
        key = shape.record.tobytes(), (places + 0.0).tobytes(), choices
        if key not in alike:
            alike[key] = make_basis(shape, choices)
        return alike[key]
    except ValueError as reason:
        raise SceneError(f"leaf '{name}' has no modal basis: {reason}") from reason


def full_model_state(model: Model, motion: State) -> tuple[Model, State]:
    """Model and state with the chains that modal bodies reduce, at the nodes they have, and with leaf springs of constant
    stiffness as they bend at their end poses; a model without such as it is.

    Stresses are zero, which plain Newton does not need.
    """
    if model.full is None:
        return model, motion
    if is_constant(model):
        return model.full, equilibrate_bent_leaves(model, motion)
    state = transfer_state(model, motion, model.full)
    for i, name in enumerate(model.member_names):
        body = model.bodies.get(name)
        if isinstance(body, LeafBasis):
            x, R = body.nodes(
                *relative_end_pose(model.arrays.members, i, motion), inner_state(model, motion, i)
            )
            nodes = inner_state(model.full, state, i)[: 12 * (len(x) - 2)]
            nodes[:] = np.hstack([x[1:-1], R[1:-1].reshape(-1, 9)]).ravel()
    return model.full, state
