"""What the links of a mechanism need to stand still at a state, and how drives and supports give it: for
`Solver.required_forces` in a control loop, for `ksd.required_loads` with words around it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ksd.checks import show
from ksd.errors import SceneError
from ksd.model.arrays import State, make_workspace
from ksd.model.compile import Model
from ksd.model.newton import assemble
from ksd.numerics.rotations import rotation_exp
from ksd.scene.hinges import plane_normal

Array = NDArray[np.float64]
BALANCED = 1e-6
"""Share of the largest that a link needs below which what is left over is that of Newton's method."""

ROUNDING = 1e-14


class RequiredForces(NamedTuple):
    """What holds links in wanted poses: forces (drives,) [N or Nm] in the order of the drives, reactions (supports,)
    likewise; unbalanced (links, 6) [N, Nm]: force and moment on every link about its reference point, global axes, that
    neither can give; needed (links, 6): with what they give. Links in the order of the scene, without ground."""

    forces: Array
    reactions: Array
    unbalanced: Array
    needed: Array


class Actuation:
    """A model prepared to be asked for the loads of many states."""

    def __init__(self, model: Model) -> None:
        arrays, scene = model.arrays, model.said or model.scene
        self.model, self.arrays, self.work = model, arrays, make_workspace(arrays)
        self.links, self.drives = model.links, len(model.drive_names)
        # what holds a mechanism in its plane does nothing in it
        self.rows = self.drives + len(scene.supports)
        self.at = arrays.start[1 : model.links, None] + np.arange(6)
        # of places, times the stretching stiffness of the shortest leaf spring
        self.noise = ROUNDING * float(arrays.size * arrays.members.stiffness_scale.max(initial=0.0))
        self.still = np.zeros(len(arrays.terms.start))
        self.share = np.ones((model.links - 1, 6))
        self.share[:, 3:] /= arrays.size
        self.state = model.rest.copy()
        self.state.multiplier[:] = 0.0
        self.normal = None if model.scene.plane is None else np.asarray(plane_normal(model.scene.plane))
        self._places()

    def _places(self) -> None:
        """Where, in the stored matrix, the gradients of the rows stand, and the unknowns of the links that they are of."""
        terms, size = self.arrays.terms, 6 * (self.links - 1)
        place_of = {(int(n), k): 6 * n + k for n in range(self.links - 1) for k in range(6)}
        found: dict[tuple[int, int], int] = {}
        for row in range(self.rows):
            for t in range(int(terms.first[row]), int(terms.first[row + 1])):
                for node, block in zip(terms.node[t].tolist(), terms.block[t, :2].tolist(), strict=True):
                    if block >= 0 and node < self.links:
                        found |= {(place_of[node - 1, k], row): block + k for k in range(6)}
        self.to = np.array([place * self.rows + row for place, row in found], np.int64)
        self.source = np.array(list(found.values()), np.int64)
        self.ways = np.zeros((size, self.rows))

    def __call__(self, state: State) -> RequiredForces:
        """The loads of a state whose multipliers are zero."""
        work = self.work
        assemble(self.arrays, state, self.still, 1.0, work, 1e-8, 0, 10.0)
        needed = work.rhs[self.at]
        scaled = (self.share * needed).ravel()
        forces = np.zeros(self.rows)
        left = scaled
        if self.rows:
            self.ways.ravel()[self.to] = work.matrix[self.source]
            ways = self.share.reshape(-1, 1) * self.ways
            if self.rows == 1:
                forces = ways.T @ scaled / (ways * ways).sum()
            else:
                forces = np.linalg.lstsq(ways, scaled, rcond=1e-10)[0]
            left = scaled - ways @ forces
        left[np.abs(left) <= max(BALANCED * np.abs(scaled).max(initial=0.0), self.noise)] = 0.0
        unbalanced = left.reshape(-1, 6) / self.share
        return RequiredForces(forces[: self.drives], forces[self.drives :], unbalanced, needed)

    def at_poses(self, displacement: ArrayLike, rotation: ArrayLike) -> RequiredForces:
        """The loads of the state with all links in these poses, see `Solver.required_forces`."""
        count, state, inside = self.links - 1, self.state, self.model.node_names[self.links :]
        if inside:
            raise SceneError(
                f"required_forces: '{inside[0]}' is inside a joint and finds its own pose; ask ksd.required_loads(solver, "
                "poses, method='constant')"
            )
        try:
            state.x[1:] = self.model.rest.x[1:] + np.reshape(displacement, (count, 3))
            state.R[1:] = self._matrices(np.asarray(rotation, float), count)
        except (TypeError, ValueError):
            raise SceneError(
                f"required_forces: give displacement ({count}, 3) [m] and rotation ({count}, 3, 3), or rotation vectors "
                f"({count}, 3), or in a plane angles ({count},) [rad], of {', '.join(self.model.scene.links[1:])}; got "
                f"{show(displacement)} and {show(rotation)}"
            ) from None
        return self(state)

    def _matrices(self, said: Array, count: int) -> Any:
        if said.shape == (count, 3, 3):
            return said
        if said.shape == (count,) and self.normal is not None:
            said = said[:, None] * self.normal
        found = np.empty((count, 3, 3))
        for turn, R in zip(said.reshape(count, 3), found, strict=True):
            rotation_exp(turn, R)
        return found
