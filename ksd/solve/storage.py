"""Storage of one thread for repeated solves of one model, in space and in its plane."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np

from ksd.model.arrays import Motion, Work, make_work
from ksd.model.compile import Model
from ksd.model.newton import Newton, iterate, look
from ksd.model.plane import Plane


class Storage:
    """State and storage of one model, in space and in its plane. Not for two threads at once.

    motion, work: made here unless given.
    """

    def __init__(self, model: Model, motion: Motion | None = None, work: Work | None = None) -> None:
        self.model = model
        self.motion = model.rest.copy() if motion is None else motion
        self.work = make_work(model.arrays) if work is None else work
        self._planar: Work | None = None

    def newton(self, target: np.ndarray, *ways: Any) -> Newton:
        """Equilibrium from the state, in place: ways = (load factor, rtol, most, cap, blow_up)."""
        factor, *rest = ways
        return iterate(self.model.arrays, self.motion, target, factor, self.work, *rest)

    def look(self, target: np.ndarray, rtol: float, factor: float = 1.0) -> tuple[float, int, int]:
        """Residual over its bound, negative pivots and status of the state; the Newton step is left in `work`."""
        return look(self.model.arrays, self.motion, target, factor, self.work, rtol)

    def planar_newton(self, plane: Plane, target: np.ndarray, *ways: Any) -> Newton:
        """As `newton`, with the unknowns of the `plane` of the model alone."""
        if self._planar is None:
            self._planar = make_work(plane.arrays)
        factor, *rest = ways
        return iterate(plane.arrays, self.motion, target, factor, self._planar, *rest)


KEPT = 4
"""Storages that `storage_of` keeps in each thread."""
_kept = threading.local()


def storage_of(model: Model) -> Storage:
    """Storage of `model` for this thread, that of the last call where the model is one of the last few."""
    recent: dict[int, Storage] = _kept.__dict__.setdefault("recent", {})
    # a storage holds its model, so the number is not given to another meanwhile
    found = recent.pop(id(model), None) or Storage(model)
    recent[id(model)] = found
    while len(recent) > KEPT:
        del recent[next(iter(recent))]
    return found
