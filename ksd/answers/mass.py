"""Mass matrix of a model at a state: consistent mass of its leaf springs, point masses and inertias of its links.

Unknowns: those of the node tangent (six per node, one per constraint row, in elimination order), then for every strain-mode
leaf the inner coordinates b of `ksd.elements.strain_uncondensed` (a = P xi + b), and after all of these its bubbles of
stretch and shear. In these coordinates the stiffness is block diagonal: the node tangent, and the inverses of two small
flexibilities per leaf, so nothing is condensed and nothing factored twice. Chains must have no inner nodes
(`ksd.answers.finer_model`), and then have no inner coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.answers.centrelines import leaf_members, member_arrays, member_ends, scene_leaves
from ksd.answers.derived import cached_per_model
from ksd.answers.leaf_groups import (
    LeafFlexibility,
    assemble_blocks,
    inner_unknowns,
    leaf_flexibilities,
    leaf_groups,
    node_unknowns,
)
from ksd.answers.nonconservative import cross_matrix
from ksd.elements.corotational_values import ElementSection, element_mass, shear_ratios
from ksd.elements.strain_uncondensed import BUBBLES, bubble_flexibility, quadrature_points, strain_mass_root
from ksd.errors import SceneError
from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.model.leaves import mass_density

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Inertia:
    """Mass matrix B^T B of a model at a state; inner unknowns follow those of the nodes.

    stacks: blocks of B, leaves first, each as unknowns (k, n), -1 for none, and rows (k, m, n); size: number of unknowns,
    inner ones included; leaves: strain-mode leaves at this state, by group; bubbles: unknowns (k, n) and flexibilities
    (k, n, n) of their stretch and shear between the ends; massless: materials without density, whose leaves have no mass.
    """

    stacks: tuple[tuple[NDArray[np.int64], Array], ...]
    size: int
    leaves: tuple[LeafFlexibility, ...]
    bubbles: tuple[tuple[NDArray[np.int64], Array], ...]
    massless: tuple[str, ...]

    @cached_property
    def matrix(self) -> Any:
        """Mass matrix (size, size), scipy CSR."""
        blocks = [B.swapaxes(1, 2) @ B for _, B in self.stacks]
        return assemble_blocks([unknowns for unknowns, _ in self.stacks], blocks, self.size)

    def rooted(self, vectors: Array) -> Array:
        """B times vectors (size, k)."""
        padded = np.vstack([vectors, np.zeros((1, vectors.shape[1]))])
        return np.concatenate(
            [(B @ padded[at]).reshape(B.shape[0] * B.shape[1], vectors.shape[1]) for at, B in self.stacks]
        )


def leaf_line_mass(leaf: Any, s: Array) -> Array:
    """Mass per length and rotary inertia per length about e1, e2, e3 (len(s), 4), over the density [m^2, m^4], at fractions
    s of a leaf."""
    profile = leaf.profile
    sections = [leaf.section if profile is None else profile.section(float(x)) for x in s]
    return np.array([[q.A, q.Iy + q.Iz, q.Iy, q.Iz] for q in sections])


def _chain_element(model: Model, motion: State, i: int, leaf: Any, line: Array) -> Array:
    """Mass (12, 12) of one Appendix A element in the motions of its two nodes.

    line (4,): `leaf_line_mass` of the element. The mass matrix is constant in the deformed axes of the element.
    """
    members = model.arrays.members
    ends = member_ends(model, motion, i)
    value, _, _ = member_arrays(model, motion, i)
    T, Q0 = value[7:16].reshape(3, 3), value[16:25].reshape(3, 3)
    length = float(value[0])
    q, material = leaf.section, leaf.material
    phi_y, phi_z = shear_ratios(
        ElementSection(material.E, material.G, q.A, q.J, q.Iy, q.Iz, q.ky, q.kz), length
    )
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


def _point_mass(model: Model, motion: State, mass: Any) -> tuple[int, Array]:
    """Node and mass matrix (6, 6) of a point mass of the scene at the present pose of its link."""
    node = model.scene.links.index(mass.link)
    arm = motion.R[node] @ (np.asarray(mass.at, float) - model.rest.x[node])
    levers = np.eye(6)
    levers[:3, 3:] = -cross_matrix(arm)
    own = np.zeros((6, 6))
    own[:3, :3] = mass.mass * np.eye(3)
    own[3:, 3:] = motion.R[node] @ np.asarray(mass.inertia, float) @ motion.R[node].T
    return node, levers.T @ own @ levers


@cached_per_model
def member_leaves(model: Model) -> dict[int, tuple[Any, Array]]:
    """Leaf of the scene of every member, and its `leaf_line_mass` at the quadrature points of the member."""
    members, leaves = model.arrays.members, scene_leaves(model)
    found = {}
    for name, numbers in leaf_members(model).items():
        # a leaf may be divided at points, and into elements
        ends = np.cumsum([0.0, *members.length[numbers]]) / members.length[numbers].sum()
        for i, (first, last) in zip(numbers, pairwise(ends), strict=True):
            at = np.array([0.5])
            if i in model.strain_leaves:
                at = quadrature_points(members.value[members.value_at[i] :], members.number[i])
            at = first + (last - first) * at
            found[i] = leaves[name], leaf_line_mass(leaves[name], at)
    return found


def _leaf_mass_roots(leaf: LeafFlexibility, line: Array) -> Array:
    """B (k, 6 ng, n) of leaf springs of one group in the coordinates (motions of both nodes, b, bubbles)."""
    root = strain_mass_root(leaf.parts, leaf.P, line)
    return np.concatenate(
        [root[:, :, :6] @ leaf.own + root[:, :, 6:12] @ leaf.relative, root[:, :, 12:]], axis=2
    )


def _square_root(M: Array) -> Array:
    """B (1, n, n) with B^T B = M, for a positive semidefinite M (n, n)."""
    # units differ: in micrometres inertia is less than the rounding of mass
    unit = np.sqrt(np.maximum(np.diagonal(M), 0.0))
    unit[unit == 0.0] = 1.0
    value, vector = np.linalg.eigh(M / np.outer(unit, unit))
    root: Array = (np.sqrt(np.maximum(value, 0.0)) * vector).T[None] * unit
    return root


def stack_nodes(model: Model) -> list[NDArray[np.int64]]:
    """Nodes (k, 2), or (k, 1) of point masses, of every stack of `Inertia`."""
    members = model.arrays.members
    leaves = [members.node[group.members] for group in leaf_groups(model)]
    chains = [members.node[i][None] for i in model.chains]
    masses = [np.array([[model.scene.links.index(m.link)]]) for m in model.scene.masses]
    return [*leaves, *chains, *masses]


def base_load(mass: Inertia, model: Model, motion: State, direction: Array) -> Array:
    """Mass matrix times a unit motion (6,) of everything, ground included: displacement and rotation about the origin.

    Its negative is the load (size,) of a base that is accelerated by it.
    """
    found = np.zeros(mass.size)
    for (places, B), nodes in zip(mass.stacks, stack_nodes(model), strict=True):
        r = np.zeros((len(B), B.shape[2]))
        for e in range(nodes.shape[1]):
            r[:, 6 * e : 6 * e + 3] = direction[:3] + np.cross(direction[3:], motion.x[nodes[:, e]])
            r[:, 6 * e + 3 : 6 * e + 6] = direction[3:]
        load = (B.swapaxes(1, 2) @ (B @ r[..., None]))[..., 0]
        np.add.at(found, places[places >= 0], load[places >= 0])
    return found


def assemble_inertia(
    model: Model,
    motion: State,
    *,
    load_factor: float = 1.0,
    without_density: float = 0.0,
    with_bubbles: bool = True,
) -> Inertia:
    """Mass of a model without inner chain nodes at a state; raises SceneError where nothing in the scene has mass.

    without_density [kg/m^3]: density of leaves whose material has none. with_bubbles: leaf springs stretch and shear between
    their ends, as modes of their own need.
    """
    members, owner = model.arrays.members, member_leaves(model)

    def line_of(i: int) -> Array:
        leaf, line = owner[i]
        return (mass_density(leaf) or without_density) * line

    leaves, stacks, bubbles = tuple(leaf_flexibilities(model, motion, load_factor=load_factor)), [], []
    size = model.arrays.plan.unknowns + sum(leaf.inner.size for leaf in leaves)
    for group, leaf, unknowns in zip(leaf_groups(model), leaves, inner_unknowns(model), strict=True):
        line = np.stack([line_of(i) for i in group.members.tolist()])
        root = _leaf_mass_roots(leaf, line)
        if with_bubbles:
            own = size + np.arange(3 * BUBBLES * len(line)).reshape(len(line), -1)
            size, unknowns = size + own.size, np.hstack([unknowns, own])
            bubbles.append((own, bubble_flexibility(leaf.parts)))
        stacks.append((unknowns, root[:, :, : unknowns.shape[1]]))
    for i in model.chains:
        root = _square_root(_chain_element(model, motion, i, owner[i][0], line_of(i)[0]))
        stacks.append((node_unknowns(model, members.node[i][None]), root))
    for mass in model.scene.masses:
        node, block = _point_mass(model, motion, mass)
        stacks.append((node_unknowns(model, np.array([[node]])), _square_root(block)))
    if not any(np.any(B) for _, B in stacks):
        raise SceneError(
            "nothing in this scene has mass, so it has no frequencies: give a material its density "
            "[kg/m^3] or a link its mass [kg]"
        )
    massless = {f.material.name or "unnamed" for f, _ in owner.values() if f.material.density is None}
    return Inertia(tuple(stacks), size, leaves, tuple(bubbles), tuple(sorted(massless)))


def centre_of_mass(model: Model, link: str) -> Array:
    """Centre (3,) of the masses of a link at rest; its reference point where it has none."""
    masses = [m for m in model.scene.masses if m.link == link and m.mass]
    if not masses:
        return np.asarray(model.rest.x[model.node_names.index(link)])
    return np.average([m.at for m in masses], axis=0, weights=[m.mass for m in masses])
