"""Storage of one thread for repeated solves of one model, in space and in its plane, held for compiled code.

A compiled call on held storage costs 2 us whatever the number of arrays; unpacking them at every call costs 20.
"""

from __future__ import annotations

import threading
from typing import Any, NamedTuple

import numpy as np

from ksd.model.arrays import Arrays, Motion, Work, make_work
from ksd.model.blank import System
from ksd.model.compile import Model
from ksd.model.plane import Plane
from ksd.model.system import SYSTEM, assemble
from ksd.model.turning import turn_step, turning
from ksd.numerics.blocks import factor_blocks, solve_blocks
from ksd.numerics.held import Held, address_of, part
from ksd.numerics.kernel import kernel
from ksd.solve.newton import GRAIN, iterate

Newton = tuple[int, int, float, int, float]
"""Reason, steps taken, residual over its bound, negative pivots, smallest relative pivot: see `ksd.solve.newton.iterate`."""


class Whole(NamedTuple):
    """A mechanism, its state, and storage."""

    arrays: Arrays
    motion: Motion
    work: Work


@kernel(needs=("iterate_apart",))
def solve_whole(held, target, factor, rtol, most, cap, blow_up):
    """`ksd.solve.newton.iterate` on the held state."""
    return iterate(
        part(held, "arrays"), part(held, "motion"), target, factor, part(held, "work"), rtol, most, cap, blow_up
    )  # fmt: skip


@kernel
def look_over(held, target, factor, rtol, step):
    """Residual and inertia of the held state; step: 1 leaves one Newton step of it in its storage to be looked at, 2 to be
    taken.

    Returns (residual over its bound, negative pivots, status).
    """
    arrays, work = part(held, "arrays"), part(held, "work")
    near = 0 * step
    if step < 2:
        near -= 1
    worst, _, inside, status = assemble(arrays, part(held, "motion"), target, factor, work, rtol, near, GRAIN)
    negatives, _ = factor_blocks(arrays.plan, work.value, work.spare, len(arrays.plan.size))
    if step > 0:
        for i in range(len(work.rhs)):
            work.rhs[i] = -work.rhs[i]
        solve_blocks(arrays.plan, work.value, work.spare, work.rhs)
        if turning(arrays.loads, arrays.start) > 0:
            turn_step(address_of(System(arrays, part(held, "motion"), target, work), SYSTEM), factor)
    return worst, negatives + inside, status


class Storage:
    """State and storage of one model, in space and in its plane. Not for two threads at once.

    motion, work: made here unless given.
    """

    def __init__(self, model: Model, motion: Motion | None = None, work: Work | None = None) -> None:
        self.model = model
        self.motion = model.rest.copy() if motion is None else motion
        self.work = make_work(model.arrays) if work is None else work
        self.held = Held(Whole(model.arrays, self.motion, self.work))
        self._planar: Held | None = None

    def newton(self, target: np.ndarray, *ways: Any) -> Newton:
        """Equilibrium from the held state, in place: ways = (load factor, rtol, most, cap, blow_up)."""
        found: Newton = solve_whole(self.held, target, *ways)
        return found

    def look(
        self, target: np.ndarray, rtol: float, factor: float = 1.0, *, step: int = 0
    ) -> tuple[float, int, int]:
        """Residual over its bound, negative pivots and status of the held state; step: 1 leaves a Newton step in `work`, 2
        one that can be taken."""
        found: tuple[float, int, int] = look_over(self.held, target, factor, rtol, step)
        return found

    def planar_newton(self, plane: Plane, target: np.ndarray, *ways: Any) -> Newton:
        """As `newton`, with the unknowns of the `plane` of the model alone."""
        if self._planar is None:
            self._planar = Held(Whole(plane.arrays, self.motion, make_work(plane.arrays)))
        found: Newton = solve_whole(self._planar, target, *ways)
        return found


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
