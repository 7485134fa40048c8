"""Mass matrix of a model at a state: consistent mass of its leafs, point masses and inertias of its links.

Unknowns: those of the node tangent (six per node, one per constraint row, in elimination order), then for
every strain-mode leaf the inner coordinates b of `ksd.beam.strain_mass` (a = P xi + b). In these the
stiffness is the node tangent beside the inverse of a small flexibility Z per leaf, so nothing is condensed
away and nothing factored twice. Chains are taken with all their nodes in the open (`ksd.properties.unfold`),
so that they have no inner coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.beam.corotational_values import ElementSection, element_mass, shear_ratios
from ksd.beam.strain_mass import (
    stacked_parts,
    strain_flexibility,
    strain_mass,
    strain_parts,
    strain_stations,
)
from ksd.errors import SceneError
from ksd.model.arrays import STRAIN, Motion
from ksd.model.compile import Model
from ksd.properties.kept import per_model
from ksd.properties.shape import member_ends, member_parts, members_of_leafs, scene_leafs

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Inertia:
    """Mass of a model at a state, as a list of small matrices on known unknowns.

    places, blocks: unknowns (k,) and mass matrix (k, k) of every leaf and massive link; size: number of
    unknowns, inner ones included; inner (m,): first inner unknown of each member, last entry `size`;
    flexible: Z (N, N) of each strain-mode member; follow: P (N, 6) of it; levers: matrix (6, 12) of xi in the
    motion of its two nodes; massless: materials without a density, whose leafs carry no mass.
    """

    places: tuple[NDArray[np.int64], ...]
    blocks: tuple[Array, ...]
    size: int
    inner: NDArray[np.int64]
    flexible: tuple[Array, ...]
    follow: tuple[Array, ...]
    levers: tuple[Array, ...]
    massless: tuple[str, ...]

    def dense(self) -> Array:
        """The mass matrix (size, size)."""
        M = np.zeros((self.size, self.size))
        for at, block in zip(self.places, self.blocks, strict=True):
            M[np.ix_(at, at)] += block
        return M

    @cached_property
    def stacked(self) -> Array | None:
        """All Z (m, N, N) in one array, None where leafs differ in their number of modes."""
        if not self.flexible or any(Z.shape != self.flexible[0].shape for Z in self.flexible):
            return None
        return np.stack(self.flexible)

    def sparse(self) -> Any:
        """The mass matrix as a scipy CSR matrix; made once, not to be changed."""
        return self._sparse

    @cached_property
    def _sparse(self) -> Any:
        from scipy.sparse import coo_matrix

        rows = np.concatenate([np.repeat(at, len(at)) for at in self.places])
        columns = np.concatenate([np.tile(at, len(at)) for at in self.places])
        values = np.concatenate([block.ravel() for block in self.blocks])
        return coo_matrix((values, (rows, columns)), shape=(self.size, self.size)).tocsr()


def cross_matrix(v: Array) -> Array:
    """[v]x (3, 3)."""
    x, y, z = v.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def leaf_line_mass(leaf: Any, s: Array) -> Array:
    """(len(s), 4) at fractions s of its length: mass per length [kg/m], rotary inertia per length about e1,
    e2, e3 [kg m]; zero without a density."""
    density, profile = leaf.material.density or 0.0, getattr(leaf, "profile", None)
    sections = [leaf.section if profile is None else profile.section(float(x)) for x in s]
    return density * np.array([[q.A, q.Iy + q.Iz, q.Iy, q.Iz] for q in sections])


def relative_levers(model: Model, motion: Motion, i: int) -> tuple[Array, Array]:
    """(6, 12) each: motion of end p, and of end q relative to it, in frame p, from the motion of both
    nodes."""
    members = model.arrays.members
    a, b = members.node[i]
    ends = member_ends(model, motion, i)
    p = motion.R[a] @ members.offset[i, 0]
    s = motion.R[b] @ members.offset[i, 1]
    w = ends.start + ends.frame @ ends.d - motion.x[a]
    own, relative = np.zeros((6, 12)), np.zeros((6, 12))
    own[:3, :3] = own[3:, 3:6] = np.eye(3)
    own[:3, 3:6] = -cross_matrix(p)
    relative[:3, 0:3], relative[:3, 6:9] = -np.eye(3), np.eye(3)
    relative[:3, 3:6], relative[:3, 9:12] = cross_matrix(w), -cross_matrix(s)
    relative[3:, 3:6], relative[3:, 9:12] = -np.eye(3), np.eye(3)
    turn = ends.frame.T
    return (turn @ own.reshape(2, 3, 12)).reshape(6, 12), (turn @ relative.reshape(2, 3, 12)).reshape(6, 12)


def _node_unknowns(model: Model, nodes: Any) -> NDArray[np.int64]:
    """Unknowns (6 per node) of nodes; -1 for ground."""
    start = model.arrays.start[np.asarray(nodes)]
    return np.concatenate([np.full(6, -1) if s < 0 else np.arange(s, s + 6) for s in start])


def _chain_element(model: Model, motion: Motion, i: int, leaf: Any, line: Array) -> Array:
    """Mass (12, 12) of one Appendix A element in the motions of its two nodes, in its deformed axes."""
    members = model.arrays.members
    ends = member_ends(model, motion, i)
    value, _, _ = member_parts(model, motion, i)
    T, Q0 = value[7:16].reshape(3, 3), value[16:25].reshape(3, 3)
    length = float(value[0])
    q, stuff = leaf.section, leaf.material
    phi_y, phi_z = shear_ratios(ElementSection(stuff.E, stuff.G, q.A, q.J, q.Iy, q.Iz, q.ky, q.kz), length)
    M = element_mass(
        length, rhoA=line[0], rhoIp=line[1], rhoIy=line[2], rhoIz=line[3], phi_y=phi_y, phi_z=phi_z
    )
    e1 = ends.d / np.linalg.norm(ends.d)
    y = T[:, 1] + ends.Q @ Q0.T @ T[:, 1]
    y -= (y @ e1) * e1
    y /= np.linalg.norm(y)
    turn = np.kron(np.eye(4), (ends.frame @ np.column_stack([e1, y, np.cross(e1, y)])).T)
    levers = np.eye(12)
    for e in range(2):
        arm = motion.R[members.node[i, e]] @ members.offset[i, e]
        levers[6 * e : 6 * e + 3, 6 * e + 3 : 6 * e + 6] = -cross_matrix(arm)
    return levers.T @ turn.T @ M @ turn @ levers


def _link_mass(model: Model, motion: Motion, mass: Any) -> tuple[int, Array]:
    """Node and mass (6, 6) of a point mass at the present position of its link."""
    node = model.scene.links.index(mass.link)
    arm = motion.R[node] @ (np.asarray(mass.at, float) - model.rest.x[node])
    levers = np.eye(6)
    levers[:3, 3:] = -cross_matrix(arm)
    own = np.zeros((6, 6))
    own[:3, :3] = mass.mass * np.eye(3)
    own[3:, 3:] = motion.R[node] @ np.asarray(mass.inertia, float) @ motion.R[node].T
    return node, levers.T @ own @ levers


@per_model
def _leafs_and_lines(model: Model) -> dict[int, tuple[Any, Array]]:
    """The leaf of the scene every member belongs to, and its mass per length at the points of the member."""
    members, leafs = model.arrays.members, scene_leafs(model)
    found = {}
    for name, numbers in members_of_leafs(model).items():
        for k, i in enumerate(numbers):
            if members.kind[i] == STRAIN:
                at = strain_stations(members.value[members.value_at[i] :], members.number[i])
            else:
                at = np.array([(k + 0.5) / len(numbers)])
            found[i] = leafs[name], leaf_line_mass(leafs[name], at)
    return found


def _strain_blocks(model: Model, motion: Motion, lines: dict[int, Array]) -> dict[int, tuple[Array, ...]]:
    """Mass (12 + N, 12 + N) in (motions of both nodes, b), Z, P, and the levers (6, 12) of xi of strain-mode members,
    by member; those of equal orders and points are worked on together."""
    alike: dict[tuple[int, ...], list[int]] = {}
    for i in lines:
        alike.setdefault(tuple(model.arrays.members.number[i].tolist()), []).append(i)
    found: dict[int, tuple[Array, ...]] = {}
    for members in alike.values():
        parts = stacked_parts([strain_parts(*member_parts(model, motion, i)) for i in members])
        P, Z = strain_flexibility(parts)
        M = strain_mass(parts, P, np.stack([lines[i] for i in members]))
        levers = [relative_levers(model, motion, i) for i in members]
        T = np.zeros_like(M)
        T[:, :6, :12], T[:, 6:12, :12] = [own for own, _ in levers], [relative for _, relative in levers]
        T[:, 12:, 12:] = np.eye(Z.shape[-1])
        M = T.swapaxes(-1, -2) @ M @ T
        found |= {i: (M[k], Z[k], P[k], levers[k][1]) for k, i in enumerate(members)}
    return found


def inertia(model: Model, motion: Motion) -> Inertia:
    """Mass of an unfolded model at a state; SceneError when nothing in the scene has mass."""
    members, owner = model.arrays.members, _leafs_and_lines(model)
    places, blocks, flexible, follow, all_levers = [], [], [], [], []
    strains = _strain_blocks(
        model, motion, {i: owner[i][1] for i in np.flatnonzero(members.kind == STRAIN).tolist()}
    )
    at = model.arrays.plan.unknowns
    inner = [at]
    for i in range(len(members.kind)):
        unknowns = _node_unknowns(model, members.node[i])
        if members.kind[i] == STRAIN:
            block, Z, P, relative = strains[i]
            N = len(Z)
            unknowns = np.concatenate([unknowns, np.arange(at, at + N)])
            flexible.append(Z)
            follow.append(P)
            all_levers.append(relative)
            at += N
        else:
            block = _chain_element(model, motion, i, owner[i][0], owner[i][1][0])
        inner.append(at)
        places.append(unknowns)
        blocks.append(block)
    for node, block in (_link_mass(model, motion, mass) for mass in model.scene.masses):
        places.append(_node_unknowns(model, [node]))
        blocks.append(block)
    _refuse_weightless(blocks)
    kept = [p >= 0 for p in places]
    bare = sorted({f.material.name or "unnamed" for f, _ in owner.values() if f.material.density is None})
    return Inertia(
        tuple(p[k] for p, k in zip(places, kept, strict=True)),
        tuple(b[np.ix_(k, k)] for b, k in zip(blocks, kept, strict=True)),
        at,
        np.array(inner),
        tuple(flexible),
        tuple(follow),
        tuple(all_levers),
        tuple(bare),
    )


def _refuse_weightless(blocks: list[Array]) -> None:
    """SceneError when no leaf and no link has mass."""
    if not sum(np.trace(b) for b in blocks) > 0.0:
        raise SceneError(
            "nothing in this scene has mass, so it has no frequencies: give a material its density "
            "[kg/m^3] or a link its mass [kg]"
        )
