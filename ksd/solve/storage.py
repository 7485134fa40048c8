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
from ksd.model.planar_across import Mirror, make_across
from ksd.model.planar_arrays import PlanarMotion, make_planar_work
from ksd.model.planar_lift import Lifting, lift_inner, lift_nodes
from ksd.model.plane import Plane, plane_of
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


class WholeFlat(NamedTuple):
    """The same in the plane, and its state of rest."""

    arrays: Arrays
    motion: PlanarMotion
    work: Work
    rest: PlanarMotion


class Lift(NamedTuple):
    """A planar state and the spatial one it is set into; off (J, 3) and lifted (J, 6): what is left of the motions of
    joints, the latter as displacement and rotation vector in their axes; sense (J,): -1 where z of a joint is against the
    normal of the plane."""

    lifting: Lifting
    flat: PlanarMotion
    motion: Motion
    off: np.ndarray
    sense: np.ndarray
    lifted: np.ndarray


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


@kernel
def lift_whole(held):
    """Write the held spatial state of the planar one."""
    lifting, flat, motion = part(held, "lifting"), part(held, "flat"), part(held, "motion")
    lift_nodes(lifting.axes, lifting.height, flat.pose, motion.x, motion.R)
    lift_inner(
        lifting.to, lifting.of, lifting.factor, lifting.turn_to, lifting.turn_of, lifting.sense, flat.inner, motion.inner
    )  # fmt: skip
    motion.multiplier[:] = 0.0
    for i in range(len(lifting.row)):
        motion.multiplier[lifting.row[i]] = flat.multiplier[i]
    off, sense, lifted = part(held, "off"), part(held, "sense"), part(held, "lifted")
    for j in range(len(off)):
        lifted[j, 0], lifted[j, 1], lifted[j, 5] = off[j, 0], sense[j] * off[j, 1], sense[j] * off[j, 2]


class Storage:
    """State and storage of one model in space, and in its plane where it has one. Not for two threads at once.

    motion, work: made here unless given.
    """

    def __init__(self, model: Model, motion: Motion | None = None, work: Work | None = None) -> None:
        self.model = model
        self.motion = model.rest.copy() if motion is None else motion
        self.work = make_work(model.arrays) if work is None else work
        self.held = Held(Whole(model.arrays, self.motion, self.work))
        self._flat: FlatStorage | None = None

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

    @property
    def flat(self) -> FlatStorage | str:
        """The same in the plane, or why there is none."""
        plane = plane_of(self.model)
        if isinstance(plane, str):
            return plane
        if self._flat is None:
            self._flat = FlatStorage(plane, self.motion)
        return self._flat


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


NO_JOINTS = (np.zeros((0, 3)), np.zeros(0), np.zeros((0, 6)))
"""The joints of `Lift` where those are not asked for."""


class FlatStorage:
    """State and storage of a model in its plane, and the spatial state `motion` it is set into.

    held, lifted_into, across (`ksd.model.planar_across`): for compiled code; mirror: whether the last says anything; planar:
    the module of the planar solver. flat: planar state and storage, made here unless given. joints: (off, sense, lifted) of
    `Lift`.
    """

    def __init__(
        self,
        plane: Plane,
        motion: Motion,
        flat: tuple[PlanarMotion, Work] | None = None,
        joints: tuple[np.ndarray, np.ndarray, np.ndarray] = NO_JOINTS,
    ) -> None:
        self.plane = plane
        self.motion, work = flat or (plane.rest.copy(), make_planar_work(plane.arrays))
        self.lifted = joints[2]
        self.held = Held(WholeFlat(plane.arrays, self.motion, work, plane.rest))
        self.lifted_into = Held(Lift(plane.lifting, self.motion, motion, *joints))
        self.across = Held(Mirror(make_across(plane.space, plane.arrays, plane.lifting, plane.rest)))
        self._sizes = np.zeros(4)
        self.mirror = len(self.across.parts.across.times) > 0
        # here, so that a scene solved in space never compiles the planar kernels
        from ksd.solve import planar

        self.planar: Any = planar

    def newton(self, target: np.ndarray, *ways: Any) -> Newton:
        """As `Storage.newton`, at the rows (r,) that act in the plane."""
        found: Newton = self.planar.solve_flat(self.held, target, *ways)
        return found

    def lift(self) -> None:
        """Write the spatial state, and what is left of the joints' motions."""
        lift_whole(self.lifted_into)

    def look(
        self, whole: Storage, target: np.ndarray, rtol: float, worst: float, negatives: int
    ) -> tuple[float, int, int]:
        """As `Storage.look` on what the planar Newton found, its residual `worst` and `negatives`, set into space before."""
        found: tuple[float, int, int] = self.planar.look_from_plane(
            self.held, whole.held, self.across, target, 1.0, rtol, worst, negatives
        )
        return found

    def step(
        self, target: np.ndarray, links: int, rtol: float, force: np.ndarray
    ) -> tuple[list[float], int, int, int]:
        """The Newton step of the held planar state, not taken: (found, negative pivots, status, sound) of
        `ksd.solve.planar.step_in_plane`; force (r,) is written."""
        sizes = self._sizes
        counted = self.planar.step_in_plane(
            self.held, self.lifted_into, self.across, target, links, rtol, force, sizes
        )
        return sizes.tolist(), *counted

    def note(self) -> None:
        """Space was asked about the held state, and saw what is seen from the plane."""
        self.planar.note_plane(self.held, self.across)
