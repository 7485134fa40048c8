"""Inverse statics: the forces of drives and supports that hold the links of a mechanism in given poses.

`Solver.required_forces` offers it to control loops, `ksd.required_loads` with names and checks.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ksd.checks import show
from ksd.errors import SceneError
from ksd.model.arrays import State, make_workspace
from ksd.model.compile import Model
from ksd.model.newton import assemble
from ksd.model.turns import count_from_links
from ksd.numerics.rotations import rotation_exp, rotation_log
from ksd.scene.hinges import plane_normal

Array = NDArray[np.float64]
BALANCE_TOLERANCE = 1e-6
"""Unbalanced load over the largest needed load up to which it is an error of Newton's method."""
ROUNDING = 1e-14
"""Rounding error of positions, over the size of the mechanism."""


class RequiredForces(NamedTuple):
    """Loads that hold the links in given poses; links in the order of the scene, without ground.

    forces (drives,), reactions (supports,): of drives and supports [N or Nm], in the order of the scene; needed (links, 6)
    [N, Nm]: force and moment on every link about its reference point, global axes, that hold it; unbalanced (links, 6): the
    part of these that drives and supports cannot give.
    """

    forces: Array
    reactions: Array
    unbalanced: Array
    needed: Array


class Actuation:
    """Inverse statics of one model, prepared for many states."""

    def __init__(self, model: Model) -> None:
        arrays, scene = model.arrays, model.original_scene
        self.model, self.arrays, self.work = model, arrays, make_workspace(arrays)
        self.links, self.drives = model.links, len(model.drive_names)
        # without the rows that hold a mechanism in its plane: they exert nothing in it
        self.rows = self.drives + len(scene.supports)
        self.link_unknowns = arrays.start[1 : model.links, None] + np.arange(6)
        # rounding of positions times the stretching stiffness of the shortest leaf spring
        self.force_rounding = ROUNDING * float(arrays.size * arrays.members.stiffness_scale.max(initial=0.0))
        self.zero_target = np.zeros(len(arrays.terms.start))
        # moments are weighed as forces at the size of the mechanism
        self.weight = np.ones((model.links - 1, 6))
        self.weight[:, 3:] /= arrays.size
        self.state = model.rest.copy()
        self.state.multiplier[:] = 0.0
        self.normal = None if model.scene.plane is None else np.asarray(plane_normal(model.scene.plane))
        self._index_gradients()

    def _index_gradients(self) -> None:
        """Find where the gradients of the rows with respect to the links are stored in the tangent."""
        terms, size = self.arrays.terms, 6 * (self.links - 1)
        source: dict[tuple[int, int], int] = {}
        for row in range(self.rows):
            for t in range(int(terms.first[row]), int(terms.first[row + 1])):
                for node, block in zip(terms.node[t].tolist(), terms.block[t, :2].tolist(), strict=True):
                    if block >= 0 and node < self.links:
                        source |= {(6 * (node - 1) + k, row): block + k for k in range(6)}
        self.gradient_index = np.array([unknown * self.rows + row for unknown, row in source], np.int64)
        self.matrix_index = np.array(list(source.values()), np.int64)
        self.gradients = np.zeros((size, self.rows))

    def __call__(self, state: State) -> RequiredForces:
        """The loads that hold a state whose multipliers are zero."""
        work = self.work
        assemble(self.arrays, state, self.zero_target, 1.0, work)
        needed = work.rhs[self.link_unknowns]
        weighted = (self.weight * needed).ravel()
        forces = np.zeros(self.rows)
        rest = weighted
        if self.rows:
            self.gradients.ravel()[self.gradient_index] = work.matrix[self.matrix_index]
            gradients = self.weight.reshape(-1, 1) * self.gradients
            if self.rows == 1:
                forces = gradients.T @ weighted / (gradients * gradients).sum()
            else:
                forces = np.linalg.lstsq(gradients, weighted, rcond=1e-10)[0]
            rest = weighted - gradients @ forces
        tolerance = max(BALANCE_TOLERANCE * np.abs(weighted).max(initial=0.0), self.force_rounding)
        rest[np.abs(rest) <= tolerance] = 0.0
        unbalanced = rest.reshape(-1, 6) / self.weight
        return RequiredForces(forces[: self.drives], forces[self.drives :], unbalanced, needed)

    def at_poses(self, displacement: ArrayLike, rotation: ArrayLike) -> RequiredForces:
        """The loads that hold all links in given poses, see `Solver.required_forces`."""
        count, state, internal = self.links - 1, self.state, self.model.node_names[self.links :]
        if internal:
            raise SceneError(
                f"required_forces: '{internal[0]}' is inside a joint and finds its own pose; ask ksd.required_loads(solver, "
                "poses, method='constant')"
            )
        try:
            state.x[1:] = self.model.rest.x[1:] + np.reshape(displacement, (count, 3))
            state.R[1:], turned = self._rotations(np.asarray(rotation, float), count)
        except (TypeError, ValueError):
            raise SceneError(
                f"required_forces: give displacement ({count}, 3) [m] and rotation ({count}, 3, 3), or rotation vectors "
                f"({count}, 3), or in a plane angles ({count},) [rad], of {', '.join(self.model.scene.links[1:])}; got "
                f"{show(displacement)} and {show(rotation)}"
            ) from None
        if len(self.arrays.springs.kind):
            count_from_links(self.arrays, state, np.vstack([np.zeros(3), turned]))
        return self(state)

    def _rotations(self, rotation: Array, count: int) -> tuple[Any, Array]:
        """Matrices (count, 3, 3) and vectors (count, 3) [rad] from matrices, vectors or angles in the plane (count,) [rad].

        Vectors and angles may be several turns; matrices tell half a turn at most.
        """
        if rotation.shape == (count, 3, 3):
            vectors = np.empty((count, 3))
            for R, vector in zip(rotation, vectors, strict=True):
                rotation_log(R, vector)
            return rotation, vectors
        if rotation.shape == (count,) and self.normal is not None:
            rotation = rotation[:, None] * self.normal
        matrices, vectors = np.empty((count, 3, 3)), rotation.reshape(count, 3)
        for vector, R in zip(vectors, matrices, strict=True):
            rotation_exp(vector, R)
        return matrices, vectors
