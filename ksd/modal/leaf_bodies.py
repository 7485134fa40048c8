"""Leaf springs of a model as modal bodies: the chains they reduce, their bases, and the nodes of these chains at a state.

The kernel of modal bodies is `ksd.elements.modal`; they can be mixed with leaf springs in full and condensed joints.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace

import numpy as np

from ksd.elements.corotational_values import sizes as chain_sizes
from ksd.errors import SceneError
from ksd.modal.choices import ModalBasis
from ksd.modal.leaf_basis import LeafBasis, LeafShape, chain_element_constants, make_basis, undeformed_basis
from ksd.model.arrays import State
from ksd.model.compile import Model, compile_as_is
from ksd.model.constant_leaves import equilibrate_bent_leaves, is_constant
from ksd.model.mesh import Mesh, MixedMesh
from ksd.model.reduced_bodies import inner_state, relative_end_pose, transfer_state, with_bodies

SAME_SHAPE_DECIMALS = 10
"""Decimals of positions over length, and of rotations, up to which leaf springs of equal shape share a basis."""


def with_chains(model: Model, leaves: Mapping[str, ModalBasis]) -> Model:
    """`model` with the `leaves` as chains of as many elements as their basis has, whose inner nodes are condensed."""
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
        options = {k: getattr(mesh, k) for k in Mesh.__dataclass_fields__}
        mesh = MixedMesh(**options, others=tuple(chains.items()))
    return (
        model if mesh == model.mesh else compile_as_is(model.scene, mesh, model.original_scene, model.choice)
    )


def chain_shape(model: Model, i: int, motion: State) -> LeafShape:
    """The shape at `motion` of the chain that is member i of `model`."""
    members = model.arrays.members
    n = int(members.number[i, 0])
    value = members.value[members.value_at[i] : members.value_at[i] + 16 * n + 9]
    nodes = inner_state(model.arrays.members, i, motion)[: 12 * (n - 1)].reshape(-1, 12)
    d, Q = relative_end_pose(members, i, motion)
    x = np.vstack([np.zeros(3), nodes[:, :3], d])
    R = np.concatenate(
        [np.eye(3)[None], nodes[:, 3:].reshape(-1, 3, 3), (Q @ value[16 * n :].reshape(3, 3).T)[None]]
    )
    return LeafShape(chain_element_constants(value, n), x, R)


def with_modal_bodies(
    model: Model,
    choices: ModalBasis | Mapping[str, ModalBasis],
    *,
    about: State | None = None,
    only: Collection[str] | None = None,
    at_rest: Collection[str] = (),
) -> Model:
    """A model with chains of `model` replaced by modal bodies; `model` becomes its `full`.

    choices: of all leaf springs, or by name, the others staying chains. about: state of `model` about which the bases are
    expanded (a trained configuration: the tangent basis); the undeformed state when None. only: names of the leaf springs to
    reduce, all when None. at_rest: names of those expanded about the undeformed state in any case. Raises SceneError for
    unknown names, for leaf springs that are not chains, and for those whose tangent is singular.
    """
    by_name = choices if isinstance(choices, Mapping) else dict.fromkeys(only or model.member_names, choices)
    cache: dict[tuple, LeafBasis] = {}
    bodies = {
        name: _make_body(model, name, by_name[name], None if name in at_rest else about, cache)
        for name in sorted(by_name, key=_member_index(model, by_name))
    }
    return replace(with_bodies(model, bodies), full=model)


def _member_index(model: Model, names: Collection[str]) -> Callable[[str], int]:
    """The function from the name of a leaf spring to its index in the model.

    Raises SceneError for unknown names, and for leaf springs that cannot be reduced.
    """
    index = {name: i for i, name in enumerate(model.member_names)}
    members = model.arrays.members
    for name in names:
        if name not in index:
            raise SceneError(f"there is no leaf '{name}' to reduce; the leaf springs are: {', '.join(index)}")
        i = index[name]
        count = int(members.number[i, 0])
        if i not in model.chains or count < 2:
            raise SceneError(
                f"leaf '{name}' is not a chain of elements: compile with Mesh('corotational', elements=10)"
            )
        if np.diff(members.store_at)[i] > chain_sizes(count).store:
            raise SceneError(
                f"leaf '{name}' carries its own weight, which modal bodies do not know: compile "
                "without='gravity', or use another method"
            )
    return index.__getitem__


def _make_body(
    model: Model, name: str, choices: ModalBasis, about: State | None, cache: dict[tuple, LeafBasis]
) -> LeafBasis:
    """The basis of a leaf about the state `about`, undeformed when None; cache: bases made so far, by rounded shape."""
    shape = chain_shape(model, model.member_names.index(name), model.rest if about is None else about)
    try:
        if about is None:
            return undeformed_basis(shape.element_constants, choices)
        rounded = np.round(np.hstack([shape.x / shape.length, shape.R.reshape(-1, 9)]), SAME_SHAPE_DECIMALS)
        # adding 0.0 turns -0.0 into 0.0
        key = shape.element_constants.tobytes(), (rounded + 0.0).tobytes(), choices
        if key not in cache:
            cache[key] = make_basis(shape, choices)
        return cache[key]
    except ValueError as reason:
        raise SceneError(f"leaf '{name}' has no modal basis: {reason}") from reason


def full_model_state(model: Model, motion: State) -> tuple[Model, State]:
    """The full model and its state: chains at the nodes of modal bodies, leaf springs of constant stiffness bent between
    their end poses; a model without a full one is returned unchanged.

    Stored stresses are zero, which plain Newton does not need.
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
                *relative_end_pose(model.arrays.members, i, motion),
                inner_state(model.arrays.members, i, motion),
            )
            nodes = inner_state(model.full.arrays.members, i, state)[: 12 * (len(x) - 2)]
            nodes[:] = np.hstack([x[1:-1], R[1:-1].reshape(-1, 9)]).ravel()
    return model.full, state
