"""Stress of leaf springs in modes, and its root mean square when modes vibrate at random.

A mode moves the ends of a leaf spring, which gives section forces by equilibrium (with those of the pose turned along, so
that stress stiffening is in them), and bends it between its ends, which gives moments by curvature. The von Mises stress is
no linear answer; its mean square is E[s^2 + 3 t^2] = sum_kl Q_kl (s_k s_l + 3 t_k.t_l) with the covariance Q of the modes
(Segalman et al., Estimating the probability distribution of von Mises stress for structures undergoing random excitation,
Journal of Vibration and Acoustics 122, 2000).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ksd.answers.centrelines import curvature, leaf_members, scene_leaves
from ksd.answers.forces import SectionForces, section_forces
from ksd.answers.frequencies import Modes
from ksd.answers.leaf_groups import leaf_groups, node_unknowns
from ksd.answers.stress import signed_stress
from ksd.model.leaves import rigidities
from ksd.model.newton import move_nodes

Array = NDArray[np.float64]
SMALL_TURN = 1e-5
"""Largest rotation [rad], or displacement relative to the size, by which section forces are differentiated."""


@dataclass(frozen=True)
class ModalStress:
    """Stress per unit amplitude of k modes, by name of the leaf spring.

    normal (k, s, p), shear (k, 2, s, p) [Pa] at stations and points of the section.
    """

    normal: dict[str, Array]
    shear: dict[str, Array]

    def rms(self, covariance: Array) -> dict[str, float]:
        """Largest root mean square [Pa] of the von Mises stress in every leaf spring; covariance (k, k) of the modes."""
        found = {}
        for name, normal in self.normal.items():
            shear = self.shear[name]
            squared = np.einsum("kl,ksp,lsp->sp", covariance, normal, normal)
            squared += 3.0 * np.einsum("kl,kcsp,lcsp->sp", covariance, shear, shear)
            found[name] = float(np.sqrt(max(squared.max(), 0.0)))
        return found


def modal_stress(modes: Modes, count: int, *, load_factor: float = 1.0) -> ModalStress:
    """Stress of the first `count` modes."""
    leaves = scene_leaves(modes.model)
    changes = [_section_force_change(modes, k, load_factor) for k in range(count)]
    normal, shear = {}, {}
    for name, leaf in leaves.items():
        forces = [SectionForces(name, *change[name]) for change in changes]
        if forces:
            normal[name], shear[name] = signed_stress(forces, leaf)
    return ModalStress(normal, shear)


def _section_force_change(modes: Modes, k: int, load_factor: float) -> dict[str, tuple[Array, Array]]:
    """Stations (s,) [m] and section forces (s, 6) by leaf spring per unit amplitude of mode k."""
    model, state, x = modes.model, modes.motion, np.append(modes.vector[k], 0.0)
    travel = np.abs(modes.shape[k]).reshape(-1, 2, 3).max(axis=(0, 2)) / (model.arrays.size, 1.0)
    size = SMALL_TURN / max(float(travel.max()), 1e-300)
    sides = []
    for sign in (size, -size):
        moved = state.copy()
        move_nodes(model.arrays, moved, sign * x[: model.arrays.plan.unknowns], 1.0)
        for group, leaf in zip(leaf_groups(model), modes.mass.leaves, strict=True):
            end = (
                leaf.relative @ x[node_unknowns(model, model.arrays.members.node[group.members])][..., None]
            )[..., 0]
            bent = x[leaf.inner] + (leaf.P @ end[..., None])[..., 0]
            moved.inner[group.inner_index[:, : group.modes]] += sign * bent
            moved.inner[group.inner_index[:, group.modes :]] += sign * (leaf.ends @ end[..., None])[..., 0]
        sides.append(section_forces(model, moved, load_factor=load_factor))
    between = _inner_moments(modes, x, sides[0])
    return {
        name: (ahead.s, (ahead.values - sides[1][name].values) / (2.0 * size) + between[name])
        for name, ahead in sides[0].items()
    }


def _inner_moments(modes: Modes, x: Array, along: Mapping[str, SectionForces]) -> dict[str, Array]:
    """Section forces (s, 6) by leaf spring of what a mode bends it between its ends, at the stations of `along`."""
    model, leaves, found = modes.model, scene_leaves(modes.model), {}
    inner: dict[int, tuple[Array, NDArray[np.int64], Array]] = {}
    for group, leaf in zip(leaf_groups(model), modes.mass.leaves, strict=True):
        for i, value, own in zip(group.members.tolist(), group.value, leaf.inner, strict=True):
            inner[i] = value, group.number, np.append(x[own], np.zeros(6))
    for name, members in leaf_members(model).items():
        s = along[name].s
        values, first, total = np.zeros((len(s), 6)), 0, float(s[-1])
        count = len(s) // len(members)
        for i in members:
            if i in inner:
                own, length = s[first : first + count], float(model.arrays.members.length[i])
                at = np.clip((own - own[0]) / length, 0.0, 1.0)
                values[first : first + count, 3:] = curvature(*inner[i][:2], inner[i][2], at)
            first += count
        leaf = leaves[name]
        sections = [
            leaf.section if leaf.profile is None else leaf.profile.section(float(v)) for v in s / total
        ]
        stiff = np.array([rigidities(q, leaf, model.mesh.for_leaf(name))[0] for q in sections])
        values[:, 3:] *= stiff
        found[name] = values
    return found
