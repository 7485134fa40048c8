"""Compile kernels into the cache, without running them: what other processes do while the first one needs its own.

Run as ``python -m ksd.solve.warm`` by `ksd.numerics.kernel` where the cache is cold; harmless by hand. Every entry is
compiled by the process that comes to it first (`ksd.numerics.cache.turn`), so the order only shares the work out.
"""

from __future__ import annotations

import contextlib
import gc
import math
import os
import sys
import threading
import time
from collections.abc import Callable

import numpy as np

from ksd.bodies.joints import joint_bodies
from ksd.errors import KsdError
from ksd.library import find_record
from ksd.model.compile import Model, compile_scene
from ksd.numerics.held import Held
from ksd.numerics.kernel import compile_now
from ksd.scene import CrossFlexure, Material, Mechanism

Job = Callable[[], None]


def _model() -> Model:
    """The smallest scene that has everything: one joint, one drive."""
    scene = Mechanism("warm")
    tip = scene.link("tip")
    cross = CrossFlexure(
        Material(E=200e9, G=76.9e9), length=0.1, angle=math.pi / 4, thickness=1e-3, widths=(0.04, 0.02)
    )
    placed = scene.join(scene.ground, tip, cross, at=(0, 0, 0), axis="z", toward="x")
    scene.actuate_joint(placed, name="turn")
    return compile_scene(scene)


def planar_jobs(model: Model) -> list[Job]:
    """What planar scenes need."""
    # while this process is at the Newton, the first one compiles the leafs it begins with
    return [
        lambda: compile_now("assemble_apart", "iterate_apart"),
        *every_jobs(model),
        lambda: compile_now("strain_condense", "strain_recover"),
        lambda: compile_now("planar_condense", "planar_recover"),
        *chain_jobs(),
    ]


def every_jobs(model: Model) -> list[Job]:
    """What scenes with joints need in the plane and in space."""
    from ksd.bodies.kinematics import loop_equations
    from ksd.solve.space_steps import read_space, space_set
    from ksd.solve.storage import Storage, look_over

    def loops() -> None:
        bodies, target = joint_bodies(model, find_record), np.zeros(1)
        place, series, W, J = np.zeros((1, 24)), np.zeros((3, 4)), np.zeros((2, 1, 6)), np.zeros((1, 1))
        reach = np.zeros((2, 2), np.int64)
        terms, size, rest = bodies.reduced.terms, bodies.reduced.size, bodies.reduced_rest
        loop_equations.compile_for(
            terms, size, bodies.loops, target, target, rest.x, rest.R, place, series, reach, W, J, target
        )

    def look() -> None:
        look_over.compile_for(Storage(model).held, np.zeros(1), 1.0, 1e-8, 0)

    def motions() -> None:
        read_space.compile_for(Held(space_set(model, joint_bodies(model, find_record))))

    return [loops, look, motions]


def chain_jobs() -> list[Job]:
    """The other leaf model."""
    return [
        lambda: compile_now("chain_near"),
        lambda: compile_now("chain_condense", "chain_recover"),
    ]


def spatial_jobs(model: Model) -> list[Job]:
    """What spatial scenes need, besides the leafs."""
    from ksd.solve.space_steps import space_set, space_steps
    from ksd.solve.storage import Storage, solve_whole

    target, out = np.zeros(1), np.zeros((5, 5))

    def held() -> Held:
        return Held(space_set(model, joint_bodies(model, find_record)))

    def newton() -> None:
        solve_whole.compile_for(Storage(model).held, target, 1.0, 1e-8, 30, 0.3, math.inf)

    return [
        lambda: space_steps.compile_for(held(), target, 1, 0, 0, 1e-8, 0.3, 2e-3, out),
        newton,
    ]


def leave_with(parent: int) -> None:
    """End this process when process `parent` has: nobody waits for the kernels any more."""
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(0)


def main(number: int = 0) -> None:
    """All of it, in an order that differs with `number`; without a record, the solvers alone."""
    threading.Thread(target=leave_with, args=(os.getppid(),), daemon=True).start()
    model = _model()
    # what is there by now stays to the end: the collector of garbage need not walk through it after every entry
    gc.freeze()
    jobs = [*planar_jobs(model), *spatial_jobs(model)]
    first = number * len(jobs) // 3
    for job in jobs[first:] + jobs[:first]:
        with contextlib.suppress(KsdError):
            job()


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:]))
