"""Storage of one thread for repeated solves of one model, in space and in its plane."""

from __future__ import annotations

import threading

import numpy as np

from ksd.model.arrays import State, Workspace, make_workspace
from ksd.model.compile import Model
from ksd.model.newton import NewtonResult, check_residual, solve_equilibrium
from ksd.model.plane import Plane


class NewtonStorage:
    """What the Newton of one model writes into, in space and in its plane. Not for two threads at once."""

    def __init__(self, model: Model) -> None:
        self.model, self.work = model, make_workspace(model.arrays)
        self._planar: Workspace | None = None

    def newton(
        self, motion: State, target: np.ndarray, factor: float, rtol: float, most: int, cap: float, blow_up: float
    ) -> NewtonResult:  # fmt: skip
        """Equilibrium from the state, in place: see `ksd.model.newton.solve_equilibrium`."""
        return solve_equilibrium(
            self.model.arrays, motion, target, factor, self.work, rtol, most, cap, blow_up
        )

    def look(
        self, motion: State, target: np.ndarray, rtol: float, factor: float = 1.0
    ) -> tuple[float, int, int]:
        """Residual over its bound, negative pivots and status of the state; the Newton step is left in `work`."""
        return check_residual(self.model.arrays, motion, target, factor, self.work, rtol)

    def planar(self, plane: Plane) -> Workspace:
        """Storage of the model in its plane."""
        if self._planar is None:
            self._planar = make_workspace(plane.arrays)
        return self._planar


MAX_STORAGES = 4
"""Storages that `thread_storage` keeps in each thread."""
_kept = threading.local()


def thread_storage(model: Model) -> NewtonStorage:
    """Storage of `model` for this thread, that of the last call where the model is one of the last few."""
    recent: dict[int, NewtonStorage] = _kept.__dict__.setdefault("recent", {})
    # a storage holds its model, so the number is not given to another meanwhile
    found = recent.pop(id(model), None) or NewtonStorage(model)
    recent[id(model)] = found
    while len(recent) > MAX_STORAGES:
        del recent[next(iter(recent))]
    return found
