"""Modal bodies beside condensed joints and leafs as they are: which leafs, and the mechanism of all of them together.

A joint none of whose leafs is named is condensed, as in step 2 of the KSD method, into one linear body between its
links; every other leaf is a member of its own, modal where it is named, as the mesh makes it otherwise.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ksd.errors import SceneError
from ksd.modal.bodies import member_pose
from ksd.modal.choices import ModalBasis
from ksd.model.arrays import LINEAR, MODAL, SOLID, Arrays, Motion
from ksd.model.compile import Model, compile_given, constraint_rows, external_loads, marked
from ksd.model.drawing import elastic_parts
from ksd.model.mesh import Mesh, MixedMesh
from ksd.model.pack import Assembly, Member, pack
from ksd.section.checks import show

LINEAR_INNER = 54
"""Inner numbers of a condensed joint: its pose, force and stiffness."""


def named_leafs(model: Model, basis: Mapping[str, Any]) -> dict[str, ModalBasis]:
    """The basis of every leaf of `model` that is named: by a joint or flexible constraint, by "joint/leaf", or itself.

    Raises SceneError for a name that is none of these, and for what is no basis.
    """
    found = {}
    if not basis:
        raise SceneError("basis = {}: name at least one joint or leaf, or give one ksd.ModalBasis for all")
    for name, choices in basis.items():
        if not isinstance(choices, ModalBasis):
            raise SceneError(f"basis[{show(name)}] = {show(choices)}: give a ksd.ModalBasis")
        own = [n for n in model.member_names if n == name or n.startswith(f"{name}/")]
        if not own:
            joints = [p.name for p in model.scene.joints]
            known = ", ".join((*joints, *model.member_names))
            raise SceneError(f"basis: there is no joint or leaf {show(name)}; there are: {known}")
        found.update(dict.fromkeys(own, choices))
    return found


def meshed(model: Model, elements: int | None = None) -> Model:
    """`model` with its leafs as chains of so many elements, or as they are; none of them cut into nodes."""
    mesh = replace(model.mesh, nodal=False)
    if elements is not None:
        mesh = replace(mesh, leaf="corotational", elements=elements)
    if mesh == model.mesh:
        return model
    return marked(compile_given(model.scene, mesh), model.said, model.choice)


def with_chains(model: Model, leafs: Mapping[str, ModalBasis]) -> Model:
    """`model` with `leafs` as chains of the elements their basis asks for, the others as they are."""
    others = []
    for count in sorted({b.elements for b in leafs.values()}):
        mesh = replace(model.mesh, leaf="corotational", elements=count)
        others.append((mesh, tuple(n for n, b in leafs.items() if b.elements == count)))
    words = {k: getattr(model.mesh, k) for k in Mesh.__dataclass_fields__}
    made = compile_given(model.scene, MixedMesh(**words, others=tuple(others)))
    return marked(made, model.said, model.choice)


def standing(
    full: Model, leafs: Mapping[str, ModalBasis], placed: Mapping[int, tuple[Model, Motion]]
) -> Motion:
    """The state of `full` with nodes and leafs where they are in models of chains alone, by elements per leaf."""
    state = full.rest.copy()
    for count, (chains, motion) in placed.items():
        state.x[:], state.R[:] = motion.x, motion.R
        mine, theirs = full.arrays.members.inner_at, chains.arrays.members.inner_at
        for i, name in enumerate(full.member_names):
            if name in leafs and leafs[name].elements == count:
                state.inner[mine[i] : mine[i + 1]] = motion.inner[theirs[i] : theirs[i + 1]]
    return state


@dataclass(frozen=True)
class Mixture:
    """The mechanism of condensed joints and of the members of `modal`, with modal bodies or solids, that are not in one.

    arrays, rest: its nodes are the links and the blocks of joints not condensed, node k being `nodes[k]` of `modal`.
    joint (m,): the condensed joint a member stands for, else -1; member (m,): the member of `modal` it is, else -1.
    """

    modal: Any
    arrays: Arrays
    rest: Motion
    nodes: np.ndarray
    joint: np.ndarray
    member: np.ndarray

    @property
    def bodies(self) -> list[int]:
        """Members of `arrays` that are modal bodies or reduced solids."""
        return np.flatnonzero(np.isin(self.arrays.members.kind, (MODAL, SOLID))).tolist()

    def own(self, motion: Motion, m: int) -> np.ndarray:
        """Inner state of member m in a state of `arrays`, a view."""
        at = self.arrays.members.inner_at
        return motion.inner[at[m] : at[m + 1]]

    def theirs(self, motion: Motion, m: int) -> np.ndarray:
        """Inner state of member m in a state of `modal`, a view."""
        at, i = self.modal.arrays.members.inner_at, self.member[m]
        return motion.inner[at[i] : at[i + 1]]


def condensed_joints(model: Model, leafs: Collection[str]) -> list[bool]:
    """Whether each joint has none of `leafs` inside."""
    return [not any(n in leafs for n in model.member_names[s]) for s in model.joint_members]


def mixture(modal: Any, linear: Arrays) -> Mixture:
    """The mechanism of both; modal: with modal bodies or with reduced solids; linear: that of all joints condensed, whose
    first members are taken over."""
    kept = condensed_joints(modal, modal.reduced)
    blocks = {f"{p.name}/" for p, k in zip(modal.scene.joints, kept, strict=True) if k}
    nodes = [
        k for k, name in enumerate(modal.node_names)
        if k < modal.links or not any(name.startswith(b) for b in blocks)
    ]  # fmt: skip
    place = {k: n for n, k in enumerate(nodes)}
    members: list[Member] = []
    joint: list[int] = []
    which: list[int] = []

    def add(made: Member, of_joint: int, of_member: int) -> None:
        members.append(made)
        joint.append(of_joint)
        which.append(of_member)

    for j, own in enumerate(modal.joint_members):
        if kept[j]:
            add(_linear(linear, j, modal.scene.joints[j].name), j, -1)
            continue
        for i in range(own.start, own.stop):
            add(_member(modal, i, place), -1, i)
    first = modal.joint_members[-1].stop if modal.joint_members else 0
    for i in range(first, len(modal.member_names)):
        add(_member(modal, i, place), -1, i)
    scene, places = modal.scene, modal.rest.x[nodes]
    rows, _, _ = constraint_rows(scene, places)
    parts = Assembly(places, members, rows, external_loads(scene, places), elastic_parts(scene, places))
    return Mixture(modal, *pack(parts), np.array(nodes), np.array(joint), np.array(which))


def _linear(linear: Arrays, j: int, name: str) -> Member:
    """Condensed joint j as a member between its links."""
    m = linear.members
    return Member(
        name, LINEAR, (int(m.node[j, 0]), int(m.node[j, 1])), m.offset[j], m.frame[j], np.zeros(0),
        np.zeros(1, np.int64), np.zeros(LINEAR_INNER), 0, float(m.length[j]), float(m.floor[j]),
    )  # fmt: skip


def _member(model: Model, i: int, place: Mapping[int, int]) -> Member:
    """Member i of a model as it is, between the nodes that `place` gives."""
    m = model.arrays.members
    later = m.value_at[m.value_at > m.value_at[i]]
    stop = int(later.min()) if len(later) else len(m.value)
    return Member(
        model.member_names[i], int(m.kind[i]), (place[int(m.node[i, 0])], place[int(m.node[i, 1])]), m.offset[i],
        m.frame[i], m.value[m.value_at[i] : stop], m.number[i],
        model.rest.inner[m.inner_at[i] : m.inner_at[i + 1]], int(m.store_at[i + 1] - m.store_at[i]),
        float(m.length[i]), float(m.floor[i]),
    )  # fmt: skip


class Settling:
    """One modal body with both ends held: its inner coordinates at a given pose of its end q, before anything moves.

    A Newton step of a whole mechanism from inner coordinates of rest and ends turned by tens of degrees is lost at once: the
    directors between the ends are far from unit length, and that energy is membrane energy.
    """

    def __init__(self, mix: Mixture, m: int) -> None:
        i = int(mix.member[m])
        made = _member(mix.modal, i, dict.fromkeys(range(len(mix.modal.node_names)), 0))
        made = replace(made, offset=np.zeros((2, 3)), frame=np.tile(np.eye(3), (2, 1, 1)))
        self.member, self.at_rest = i, made.inner
        self.arrays, self.rest = pack(Assembly(np.zeros((1, 3)), [made]))
        self.start = member_pose(mix.modal.arrays.members, i, mix.modal.rest)

    def hold(self, d: np.ndarray, Q: np.ndarray) -> None:
        """Put end q at d (3,) m, Q (3, 3) in the frame of end p."""
        self.arrays.members.offset[0, 1] = d
        self.arrays.members.frame[0, 1] = Q

    def between(self, share: float, d: np.ndarray, Q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The pose at a share of the way from rest, along an arc."""
        from scipy.spatial.transform import Rotation

        d0, Q0 = self.start
        turn = Rotation.from_matrix(Q @ Q0.T).as_rotvec()
        chord = (1 - share) * d0 + share * Rotation.from_rotvec(-0.5 * turn).apply(d)
        return Rotation.from_rotvec(0.5 * share * turn).apply(chord), Rotation.from_rotvec(
            share * turn
        ).as_matrix() @ Q0


__all__ = [
    "Mixture",
    "Settling",
    "condensed_joints",
    "meshed",
    "mixture",
    "named_leafs",
    "standing",
    "with_chains",
]
