"""A second process that compiles kernels for the first solve on a machine; both processes use one kernel cache.

The first solve spends nearly all its time compiling, one kernel after the other: those of step 1, those that
`ksd.model.newton.newton` calls, `newton` itself, and the rest. The second process compiles those that `newton` calls, the
longest first, and then the rest. A kernel that both processes reach at the same time is compiled twice, with the same
result; one that is missing, because the second process was ended, is compiled as usual.
"""

from __future__ import annotations

import gc
import logging
import sys
from contextlib import suppress
from functools import cache
from multiprocessing import current_process
from pathlib import Path

import numpy as np

from ksd.answers.mesh_adequacy import mode_adequacy
from ksd.elements.ends import member_tangent
from ksd.elements.strain import leaf_fields, strain_condense, strain_recover, strain_tangent
from ksd.errors import KsdError
from ksd.joints.joints import joint_bodies
from ksd.joints.substructures import condense_joints, interface_step
from ksd.library import find_record
from ksd.model.arrays import make_workspace
from ksd.model.compile import compile_scene
from ksd.model.loading import add_loads, add_terms
from ksd.model.newton import move_nodes
from ksd.numerics.blocks import BLOCKS, factor_blocks, solve_blocks
from ksd.numerics.kernel import HAS_SPARE_CORE, has_to_compile
from ksd.numerics.processes import end_with_parent, spawn_context
from ksd.scene.families.cross_flexure import CrossFlexure
from ksd.scene.material import Material
from ksd.scene.mechanism import Mechanism
from ksd.solvers.five_steps import FiveStepsStorage, assemble_full_state
from ksd.solvers.joint_motions import JointMotionReader

COMPILES_KERNELS: bool = has_to_compile(move_nodes.__module__, "newton")
"""Whether this process has to compile the kernels of every solve."""

if COMPILES_KERNELS:
    # in processes started by this package the message has been given by the first one
    if current_process().name == "MainProcess":
        logging.getLogger("ksd").warning(
            "ksd: compiling its kernels for this machine (once; about half a minute) ..."
        )
    # objects of the compiler are not freed; a garbage collection every 700 of them takes 10 % of the time
    _first, *_others = gc.get_threshold()
    gc.set_threshold(_first and max(100_000, _first), *_others)


@cache
def start_precompiling() -> None:
    """Start the second process, once, where the kernel cache was empty and a second core is available.

    It is not started from a child process, nor from a program that embeds Python.
    """
    context, is_python = spawn_context(precompile_kernels), "python" in Path(sys.executable or "").name
    is_main = is_python and current_process().name == "MainProcess"
    if COMPILES_KERNELS and HAS_SPARE_CORE and is_main and context is not None:
        # a daemon ends with this process
        with suppress(OSError):
            context.Process(target=precompile_kernels, daemon=True).start()


def precompile_kernels() -> None:
    """Compile the kernels, by calling each one as `newton` does, for a cross flexure at rest."""
    end_with_parent()
    mechanism = Mechanism("hinge")
    joint = CrossFlexure(
        Material(E=2e11, G=8e10, density=7800.0), length=0.1, angle=0.8, thickness=1e-3, widths=(0.04, 0.02)
    )
    link = mechanism.link("tip")
    mechanism.actuate_joint(mechanism.join(mechanism.ground, link, joint, at=(0, 0, 0), axis="z", toward="x"))
    model = compile_scene(mechanism)
    arrays, motion, work = model.arrays, model.rest.copy(), make_workspace(model.arrays)
    (ints, floats), members, plan = arrays.flat, arrays.members, arrays.plan.ints
    inner, store = motion.inner[: members.inner_at[1]], work.store[: members.store_at[1]]
    value, number, target = members.value, members.number[0], np.zeros(len(motion.multiplier))
    leaf, lam, K, A = leaf_fields(number), np.zeros(12), np.zeros((6, 6)), np.zeros((6, 6))
    strain_tangent(value, number, inner, leaf)
    strain_condense(value, number, inner, store, leaf, np.zeros(3), np.eye(3), lam, K)
    factor_blocks(plan, work.matrix, work.scaled_rows, plan[BLOCKS])
    add_terms(
        ints, floats, motion.x, motion.R, motion.multiplier, motion.angle, target, 1e-8, work.matrix, work.rhs, work.scale
    )  # fmt: skip
    solve_blocks(plan, work.matrix, work.scaled_rows, work.rhs)
    move_nodes(arrays, motion, work.rhs, 1.0)
    strain_recover(value, number, inner, store, np.zeros(6), 1.0, np.zeros(6))
    add_loads(ints, floats, motion.R, 1.0, 1e-8, work.matrix, work.rhs, work.scale)
    member_tangent(work.pose[0], lam, K, np.zeros((12, 12)), np.zeros(12), A, np.zeros((6, 12)))
    # what is needed after `newton`, while the first process compiles that
    JointMotionReader(model, find_record, extrapolate=False)(motion)
    mode_adequacy(model, motion)
    # without a record the five steps are not used
    with suppress(KsdError):
        b = FiveStepsStorage(model, joint_bodies(model, find_record))
        substructures, state, room = b.bodies.substructures, b.substructure_state, b.substructure_work
        condense_joints(substructures, 1, state, room, b.reduced_state.inner)
        interface_step(substructures, b.bodies.kinematics, b.reduced_state, state, room, b.relative_pose)
        assemble_full_state(b)
