"""Compile the kernels above the leafs into the cache, without running them: what a second process does meanwhile.

On a cold cache the first process compiles the leaf kernels (on import), this one everything that calls them. Run as
``python -m ksd.solve.warm`` by `ksd.numerics.kernel`; harmless by hand.
"""

from __future__ import annotations

import math
import os
import threading
import time

import numpy as np

from ksd.bodies import kinematics, readout
from ksd.bodies.joints import joint_bodies
from ksd.errors import KsdError
from ksd.library import find_record
from ksd.model import system
from ksd.model.arrays import make_work
from ksd.model.compile import Model, compile_scene
from ksd.numerics.held import Held
from ksd.numerics.kernel import compile_for, second_compiler_runs, wait_for_second_compiler
from ksd.scene import CrossFlexure, Material, Mechanism
from ksd.solve.newton import iterate


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


def compile_solvers(model: Model) -> None:
    """Assembly, Newton and its parts, for spatial models."""
    arrays, motion, work = model.arrays, model.rest, make_work(model.arrays)
    target = np.zeros(1)
    compile_for(system.assemble, arrays, motion, target, 1.0, work, 1e-8, 0, 10.0)
    compile_for(iterate, arrays, motion, target, 1.0, work, 1e-8, 30, 0.3, math.inf)
    compile_for(system.solve_step, arrays, work)


def compile_bodies(model: Model) -> None:
    """The five steps in space; needs the record of the cross flexure."""
    from ksd.solve.space_steps import look_over, space_set, space_steps

    bodies = joint_bodies(model, find_record)
    held, target, out = Held(space_set(model, bodies)), np.zeros(1), np.zeros((5, 5))
    reduced, motion, theta, place = bodies.reduced, bodies.reduced_rest, np.zeros(1), np.zeros((1, 24))
    compile_for(
        readout.drive_forces, reduced, bodies.loops, theta, target, motion, place, motion.inner, target
    )
    J, residual, W = np.zeros((1, 1)), np.zeros(1), np.zeros((2, 1, 6))
    compile_for(
        kinematics.loop_equations, reduced, bodies.loops, theta, target, motion, place, W, J, residual
    )
    compile_for(look_over, held, target, 1e-8, 0)
    compile_for(space_steps, held, target, 1, 0, 0, 1e-8, 0.3, 2e-3, out)


def compile_planar(model: Model) -> None:
    """The planar Newton, which the first process takes on while it waits for the second."""
    from ksd.model.planar_arrays import make_planar_work
    from ksd.model.planar_lift import lift_inner, lift_nodes
    from ksd.model.plane import plane_of
    from ksd.solve.planar import iterate_planar

    plane = plane_of(model)
    if isinstance(plane, str):
        return
    work = make_planar_work(plane.arrays)
    compile_for(lift_nodes, *plane.lifting[:2], plane.rest.pose, model.rest.x, model.rest.R)
    compile_for(lift_inner, *plane.lifting[2:8], plane.rest.inner, model.rest.inner)
    compile_for(iterate_planar, plane.arrays, plane.rest, np.zeros(1), 1.0, work, 1e-8, 30, 0.3, math.inf)


def ready() -> None:
    """Return when the cache holds everything; at once unless this process found it cold."""
    if second_compiler_runs():
        compile_planar(_model())
        wait_for_second_compiler()


def leave_with(parent: int) -> None:
    """End this process when process `parent` has: nobody waits for the kernels any more."""
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(0)


def main() -> None:
    """All of it; without a record, the solvers alone."""
    threading.Thread(target=leave_with, args=(os.getppid(),), daemon=True).start()
    model = _model()
    compile_solvers(model)
    try:
        compile_bodies(model)
    except KsdError:
        return


if __name__ == "__main__":
    main()
