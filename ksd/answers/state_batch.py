"""Batches of states of models with the same layout and mesh, which differ in numbers only, evaluated together as arrays.

Examples are the designs of a batch, the poses of a stroke, and the perturbed poses of finite differences. Work that does
not depend on the numbers is done once for all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ksd.answers.finer_model import MAX_STEP, finer_inner_index, finer_mesh
from ksd.model.arrays import MEMBER, Arrays, State, make_workspace
from ksd.model.compile import Model
from ksd.model.mesh import Mesh
from ksd.model.newton import take_step_at_fixed_rows
from ksd.model.pack import floats_with_constants
from ksd.model.scene_layout import split_scene
from ksd.model.template import LeafGeometry, Template, template_of

Array = NDArray[np.float64]
LoadedState = tuple[Model, State, float]
"""A model, a state of it, and the load factor there."""


@dataclass(frozen=True)
class StateBatch:
    """D states of U models.

    model_index (D,): model of each state among models (U,); template: common layout, topology: its integer arrays; floats
    (U, f): numbers of the models as in `Arrays`; motion: with a leading axis over states; load_factor (D,).
    """

    models: tuple[Model, ...]
    model_index: NDArray[np.int64]
    template: Template
    topology: Arrays
    floats: Array
    motion: State
    load_factor: Array

    @property
    def sizes(self) -> Array:
        """Sizes (D,) of the mechanisms [m]."""
        return self.floats[self.model_index, 0]

    @cached_property
    def states(self) -> list[tuple[Arrays, State]]:
        """Arrays and state of each, views of the arrays of the batch."""
        bare = [Arrays(self.topology.ints, own, self.topology) for own in self.floats]
        return [
            (bare[u], State(*own)) for u, *own in zip(self.model_index.tolist(), *self.motion, strict=True)
        ]

    def member_constants(self, members: NDArray[np.int64], size: int) -> Array:
        """First `size` constants (D, k, size) of members (k,) in every state."""
        at = self.topology.ints[MEMBER.value] + self.topology.members.value_at[members]
        return np.take(self.floats, at[:, None] + np.arange(size), axis=1)[self.model_index]

    def on_finer_mesh(self) -> StateBatch | None:
        """Equilibria near the states on a mesh with one more mode per axis in every leaf, see `ksd.answers.finer_model`.

        None where the models have leaf springs with constants of their own and the finer models differ in layout.
        """
        mesh, m = finer_mesh(self.models[0]), self.motion
        if mesh == self.template.mesh:
            return self
        fine = self.template.on_mesh(mesh)
        if fine is None:
            # leaf springs with constants of their own are drawn again with more modes
            drawn = [split_scene(model.scene, mesh) for model in self.models]
            fine = template_of(drawn[0].layout, mesh)
            if any(other.layout != drawn[0].layout for other in drawn):
                return None
            filled = fine(fine.numbers([own.numbers for own in drawn]))
            floats = filled.arrays.floats
        else:
            known = [model.derived["leaves"] for model in self.models]
            leaves = LeafGeometry(
                *(np.concatenate(field) for field in zip(*(k[1] for k in known), strict=True))
            )
            value, _ = fine.packing.values(leaves, np.concatenate([k[2] for k in known]))
            floats = floats_with_constants(self.topology, self.floats, value)
        inner = np.zeros((len(self.model_index), int(fine.topology.members.inner_at[-1])))
        number, wider = (b.members.number.tobytes() for b in (self.topology, fine.topology))
        inner[:, finer_inner_index(number, wider)] = m.inner
        motion = m.copy()._replace(inner=inner)
        finer = replace(self, template=fine, topology=fine.topology, floats=floats, motion=motion)
        work = make_workspace(fine.topology)
        for (arrays, state), load_factor in zip(finer.states, self.load_factor.tolist(), strict=True):
            work.weight[:] = arrays.weight
            take_step_at_fixed_rows(arrays, state, load_factor, work, MAX_STEP)
        return finer


def group_states(states: Sequence[LoadedState]) -> list[tuple[list[int], StateBatch]]:
    """Group the states that can be evaluated together: those with strain-mode leaves only, on one mesh, and the same layout.

    Returns the positions in `states` and the batch of every group; other states are left out.
    """
    groups: dict[int, list[int]] = {}
    for k, (model, _, _) in enumerate(states):
        template = model.derived.get("leaves", (None,))[0]
        if template is not None and not model.bodies and model.arrays.ints is template.topology.ints:
            groups.setdefault(id(template), []).append(k)
    found = []
    for numbers in groups.values():
        different = {id(states[k][0]): states[k][0] for k in numbers}
        position = {key: u for u, key in enumerate(different)}
        model_index = np.array([position[id(states[k][0])] for k in numbers])
        models = tuple(different.values())
        template = models[0].derived["leaves"][0]
        if type(template.mesh) is not Mesh or not models[0].has_strain_leaves_only:
            continue
        motion = State(*(np.array(field) for field in zip(*(states[k][1] for k in numbers), strict=True)))
        floats = np.array([model.arrays.floats for model in models])
        load_factor = np.array([states[k][2] for k in numbers])
        found.append(
            (
                numbers,
                StateBatch(models, model_index, template, template.topology, floats, motion, load_factor),
            )
        )
    return found
