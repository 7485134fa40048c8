"""States of models with the same words on the same mesh, which differ in numbers alone: asked together, as arrays.

Such are the designs of a batch, the poses of a stroke, and those beside a pose that gradients are differences of. What a
question prepares is prepared once for all of them, and nothing is made for each state but its answers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ksd.model.arrays import MEMBERS, STRAIN, VALUE, WEIGHT, Arrays, Bare, Flat, Motion
from ksd.model.compile import Model
from ksd.model.mesh import Mesh
from ksd.model.pack import revalued_floats
from ksd.model.template import Leaves, Template
from ksd.properties.unfold import opened_mesh, widened

Array = NDArray[np.float64]
State = tuple[Model, Motion, float]
"""A model, a state of it, and what times its loads act there."""


class Alike(NamedTuple):
    """D states. models: of each; template: what they have in common, topology: its integers; floats (D, f): as in `Flat`;
    motion: with a leading axis over states; factor (D,): of the loads."""

    models: tuple[Model, ...]
    template: Template
    topology: Arrays
    floats: Array
    motion: Motion
    factor: Array

    @property
    def size(self) -> Array:
        """Sizes (D,) of the mechanisms [m]."""
        return self.floats[:, 0]

    def state(self, d: int) -> tuple[Bare, Motion]:
        """Numbers and state d, views of what is here."""
        m, ints = self.motion, self.topology.flat.ints
        flat = Flat(ints, self.floats[d], self.topology.flat.members)
        weight = flat.floats[ints[WEIGHT] :].reshape(-1, 4)
        return Bare(flat, weight), Motion(m.x[d], m.R[d], m.inner[d], m.multiplier[d])

    def pick(self, which: NDArray[np.int64]) -> Alike:
        """Some of the states."""
        return self._replace(
            models=tuple(self.models[d] for d in which.tolist()),
            floats=self.floats[which],
            motion=Motion(*(field[which] for field in self.motion)),
            factor=self.factor[which],
        )

    def constants(self, members: NDArray[np.int64], size: int) -> Array:
        """The first `size` constants (D, k, size) of members (k,)."""
        at = self.topology.flat.ints[MEMBERS + VALUE] + self.topology.members.value_at[members]
        return np.take(self.floats, at[:, None] + np.arange(size), axis=1)

    def different(self) -> tuple[list[int], NDArray[np.int64]]:
        """A state of every different model, and the number (D,) of each state's model among these."""
        ids = [id(model) for model in self.models]
        _, first, which = np.unique(ids, return_index=True, return_inverse=True)
        return first.tolist(), which

    def finer(self) -> Alike | None:
        """The same states with one mode more per axis in every leaf, see `ksd.properties.unfold`; amplitudes of these are
        zero. None where leaf springs bring their constants."""
        mesh, m = opened_mesh(self.models[0]), self.motion
        if mesh == self.template.mesh:
            return self._replace(motion=m.copy())
        fine = self.template.on(mesh)
        if fine is None:
            return None
        first, which = self.different()
        known = [self.models[d].derived["leaves"] for d in first]
        leaves = Leaves(*(np.concatenate(field) for field in zip(*(k[1] for k in known), strict=True)))
        value, _ = fine.packed.values(leaves, np.concatenate([k[2] for k in known]))
        floats = revalued_floats(self.topology.flat.ints, self.floats[first], value)[which]
        inner = np.zeros((len(floats), int(fine.topology.members.inner_at[-1])))
        number, wider = (b.members.number.tobytes() for b in (self.topology, fine.topology))
        inner[:, widened(number, wider)] = m.inner
        motion = Motion(m.x.copy(), m.R.copy(), inner, m.multiplier.copy())
        return self._replace(template=fine, topology=fine.topology, floats=floats, motion=motion)


def alike(states: Sequence[State]) -> list[tuple[list[int], Alike]]:
    """The states that can be asked together, with their numbers in the list: those of strain-mode leaves on one mesh."""
    groups: dict[int, list[int]] = {}
    for k, (model, _, _) in enumerate(states):
        template = model.derived.get("leaves", (None,))[0]
        if (
            template is not None
            and not model.bodies
            and model.arrays.flat.ints is template.topology.flat.ints
        ):
            groups.setdefault(id(template), []).append(k)
    found = []
    for numbers in groups.values():
        models = tuple(states[k][0] for k in numbers)
        template = models[0].derived["leaves"][0]
        if type(template.mesh) is not Mesh or any(leaf.kind != STRAIN for leaf in template.leaf_words):
            continue
        motion = Motion(*(np.stack(field) for field in zip(*(states[k][1] for k in numbers), strict=True)))
        floats = np.stack([model.arrays.flat.floats for model in models])
        factor = np.array([states[k][2] for k in numbers])
        found.append((numbers, Alike(models, template, template.topology, floats, motion, factor)))
    return found
