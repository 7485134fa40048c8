"""Storage for repeated Newton solves of one model by one thread, in space and in its plane."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np

from ksd.model.arrays import State, Workspace, make_workspace
from ksd.model.compile import Model
from ksd.model.newton import NewtonResult, solve_equilibrium
from ksd.model.plane import Plane


class NewtonStorage:
    """Work arrays of the Newton iteration of one model, in space, in its plane, with contact; not for two threads."""

    def __init__(self, model: Model) -> None:
        self.model, self.work = model, make_workspace(model.arrays)
        self.contact: dict[str, Any] = {}
        """`ksd.solvers.contact_newton.ContactNewton`, "planar" (None where there is none) and "spatial"."""
        self._planar: Workspace | None = None

    def newton(
        self, motion: State, target: np.ndarray, factor: float, rtol: float, max_steps: int,
        max_turn: float, divergence_limit: float,
    ) -> NewtonResult:  # fmt: skip
        """Iterate the state to equilibrium, in place: see `ksd.model.newton.solve_equilibrium`."""
        return solve_equilibrium(
            self.model.arrays, motion, target, factor, self.work, rtol, max_steps, max_turn, divergence_limit
        )  # fmt: skip

    def planar(self, plane: Plane) -> Workspace:
        """Workspace arrays of the model in its plane."""
        if self._planar is None:
            self._planar = make_workspace(plane.arrays)
        return self._planar


MAX_STORAGES = 4
"""Storages that `thread_storage` caches in each thread."""
_cache = threading.local()


def thread_storage(model: Model) -> NewtonStorage:
    """Storage of `model` for this thread, cached for the last few models."""
    recent: dict[int, NewtonStorage] = _cache.__dict__.setdefault("recent", {})
    # a storage references its model, so that its id is not reused while cached
    storage = recent.pop(id(model), None) or NewtonStorage(model)
    recent[id(model)] = storage
    while len(recent) > MAX_STORAGES:
        del recent[next(iter(recent))]
    return storage
