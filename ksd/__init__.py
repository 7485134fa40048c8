"""ksd: reduced-order finite elements for flexure joints and compliant mechanisms.

``import ksd`` is light: the compiled solvers load on their first use. SI units inside; `ksd.units` outside.
Examples in docstrings begin after ``import numpy as np``, ``import ksd`` and ``from ksd.units import GPa, deg, mm``.
"""

from __future__ import annotations

from difflib import get_close_matches
from importlib import import_module
from typing import TYPE_CHECKING, Any

from ksd import errors, units
from ksd.errors import (
    ConvergenceError,
    KinematicsError,
    KsdError,
    RangeError,
    RecordError,
    ResumeError,
    SceneError,
    SceneFileError,
    SceneWarning,
    TrustError,
    UnknownNameError,
    UnknownWordError,
)
from ksd.version import __version__ as __version__

_HOMES = {
    "ksd.scene": (
        "Arc", "ArcHinge", "BalancedCrossedPivot", "Butterfly", "Cartwheel", "CircularNotch", "CircularNotchHinge",
        "CrossFlexure", "CrossedPivot", "DrawnJoint", "FilletedNotch", "FilletedNotchHinge", "FoldedLeaf",
        "FreeCurve", "InfinityHinge", "Joint", "Leaf", "Material", "Mechanism", "Motion", "ParallelGuide", "Scene",
        "StiffenedGuide", "StiffenedMiddle", "Taper", "TripleInfinityHinge", "UniversalJoint", "Varying",
        "WireFlexure", "joint_families", "wire",
    ),
    "ksd.section": ("Section", "circle", "numbers", "polygon", "rectangle", "tube"),
    "ksd.scene.effects": ("LinkMatrix",),
    "ksd.scene.link_matrix": ("link_matrix",),
    "ksd.scene.functions_of_time": ("Cycloid", "HalfSine", "Ramp", "Sine", "Step", "TimeTable", "Trapezoid"),
    "ksd.scene.simulation": ("Event", "Shake", "Simulation"),
    "ksd.scene.toml_file": ("load_scene", "save_scene"),
    "ksd.model.mesh": ("Mesh",),
    "ksd.modal.choices": ("ModalBasis",),
    "ksd.model.compile": ("Model", "compile_scene"),
    "ksd.solvers.solver": ("Solver", "prepare", "solve"),
    "ksd.solvers.configuration": ("Configuration",),
    "ksd.solvers.path": ("Path", "follow"),
    "ksd.solvers.pull_out": ("pull_out",),
    "ksd.solvers.walk": ("Walk", "walk"),
    "ksd.solvers.required_loads": ("RequiredLoads", "required_loads"),
    "ksd.answers.doctor": ("doctor",),
    "ksd.interactive.live": ("live",),
    "ksd.training": ("train",),
    "ksd.training.designs": ("Design",),
    "ksd.study.history": ("History",),
    "ksd.study.simulate": ("simulate",),
    "ksd.study.stepper": ("MovingState", "Stepper", "stepper"),
    "ksd.study": ("Batch", "SweepInterrupted", "Table", "batch", "frequency_curve", "state_space", "sweep"),
    "ksd.study.compare": ("compare",),
    "ksd.study.gradient": ("Gradient", "gradient"),
    "ksd.optimisation.job": ("Job",),
    "ksd.optimisation.job_file": ("JobFile", "load_job"),
    "ksd.optimisation.optimise": ("optimise",),
    "ksd.optimisation.optimum": ("Optimum",),
    "ksd.optimisation.pareto": ("Choice", "Front", "choose", "pareto"),
    "ksd.rest_shapes.rest_result": ("RestShape",),
    "ksd.rest_shapes.rest_shape": ("rest_shape",),
    "ksd.optimisation.tolerance": ("Tolerance", "tolerance"),
    "ksd.library": ("Parameter", "Record", "find_record", "read_result"),
}  # fmt: skip
_HOME = {name: home for home, names in _HOMES.items() for name in names}
__all__ = [
    "Arc", "ArcHinge", "BalancedCrossedPivot", "Batch", "Butterfly", "Cartwheel", "Choice", "CircularNotch",
    "CircularNotchHinge", "Configuration", "ConvergenceError", "CrossFlexure", "CrossedPivot", "Cycloid", "Design",
    "DrawnJoint", "Event", "FilletedNotch", "FilletedNotchHinge", "FoldedLeaf", "FreeCurve", "Front", "Gradient",
    "HalfSine", "History", "InfinityHinge", "Job", "JobFile", "Joint", "KinematicsError", "KsdError", "Leaf",
    "LinkMatrix", "Material", "Mechanism", "Mesh", "ModalBasis", "Model", "Motion", "MovingState", "Optimum",
    "ParallelGuide", "Parameter", "Path", "Ramp", "RangeError", "Record", "RecordError", "RequiredLoads", "RestShape",
    "ResumeError", "Scene", "SceneError", "SceneFileError", "SceneWarning", "Section", "Shake", "Simulation", "Sine",
    "Solver", "Step", "Stepper", "StiffenedGuide", "StiffenedMiddle", "SweepInterrupted", "Table", "Taper", "TimeTable",
    "Tolerance", "Trapezoid", "TripleInfinityHinge", "TrustError", "UniversalJoint", "UnknownNameError",
    "UnknownWordError", "Varying", "Walk", "WireFlexure", "batch", "choose", "circle", "compare", "compile_scene", "doctor",
    "errors", "find_record", "follow", "frequency_curve", "gradient", "joint_families", "link_matrix", "live",
    "load_job", "load_scene", "numbers", "optimise", "pareto", "polygon", "prepare", "pull_out", "read_result", "rectangle",
    "required_loads", "rest_shape", "save_scene", "simulate", "solve", "state_space", "stepper", "sweep",
    "tolerance", "train", "tube", "units", "walk", "wire",
]  # fmt: skip

if TYPE_CHECKING:
    from ksd.answers.doctor import doctor
    from ksd.interactive.live import live
    from ksd.library import Parameter, Record, find_record, read_result
    from ksd.modal.choices import ModalBasis
    from ksd.model.compile import Model, compile_scene
    from ksd.model.mesh import Mesh
    from ksd.optimisation.job import Job
    from ksd.optimisation.job_file import JobFile, load_job
    from ksd.optimisation.optimise import optimise
    from ksd.optimisation.optimum import Optimum
    from ksd.optimisation.pareto import Choice, Front, choose, pareto
    from ksd.optimisation.tolerance import Tolerance, tolerance
    from ksd.rest_shapes.rest_result import RestShape
    from ksd.rest_shapes.rest_shape import rest_shape
    from ksd.scene import (
        Arc,
        ArcHinge,
        BalancedCrossedPivot,
        Butterfly,
        Cartwheel,
        CircularNotch,
        CircularNotchHinge,
        CrossedPivot,
        CrossFlexure,
        DrawnJoint,
        FilletedNotch,
        FilletedNotchHinge,
        FoldedLeaf,
        FreeCurve,
        InfinityHinge,
        Joint,
        Leaf,
        Material,
        Mechanism,
        Motion,
        ParallelGuide,
        Scene,
        StiffenedGuide,
        StiffenedMiddle,
        Taper,
        TripleInfinityHinge,
        UniversalJoint,
        Varying,
        WireFlexure,
        joint_families,
        wire,
    )
    from ksd.scene.effects import LinkMatrix
    from ksd.scene.functions_of_time import Cycloid, HalfSine, Ramp, Sine, Step, TimeTable, Trapezoid
    from ksd.scene.link_matrix import link_matrix
    from ksd.scene.simulation import Event, Shake, Simulation
    from ksd.scene.toml_file import load_scene, save_scene
    from ksd.section import Section, circle, numbers, polygon, rectangle, tube
    from ksd.solvers.configuration import Configuration
    from ksd.solvers.path import Path, follow
    from ksd.solvers.pull_out import pull_out
    from ksd.solvers.required_loads import RequiredLoads, required_loads
    from ksd.solvers.solver import Solver, prepare, solve
    from ksd.solvers.walk import Walk, walk
    from ksd.study import Batch, SweepInterrupted, Table
    from ksd.study.batch import batch
    from ksd.study.compare import compare
    from ksd.study.frequency_curve import frequency_curve
    from ksd.study.gradient import Gradient, gradient
    from ksd.study.history import History
    from ksd.study.simulate import simulate
    from ksd.study.state_space import state_space
    from ksd.study.stepper import MovingState, Stepper, stepper
    from ksd.study.sweep import sweep
    from ksd.training import train
    from ksd.training.designs import Design


_ROOMS = (
    "answers",
    "export",
    "importing",
    "library",
    "modal",
    "optimisation",
    "scene",
    "solvers",
    "study",
    "training",
    "view",
)
"""Packages of this one that can be reached without an import of their own, such as ksd.view.write_pvd."""


def __getattr__(name: str) -> Any:
    if name == "shapes":
        return import_module("ksd.scene.shapes")
    if name in _ROOMS:
        return import_module(f"ksd.{name}")
    if name not in _HOME:
        raise AttributeError(f"ksd has no '{name}'{_meant(name)}")
    value = globals()[name] = getattr(import_module(_HOME[name]), name)
    return value


def _meant(name: str) -> str:
    """What was probably meant by a name there is not."""
    if name in vars(units):
        return f"; did you mean ksd.units.{name}?"
    near = {known.lower(): known for known in __all__}
    close = get_close_matches(name.lower(), near, n=1)
    return f"; did you mean ksd.{near[close[0]]}?" if close else ""


def __dir__() -> list[str]:
    return sorted({*__all__, "__version__", "__doc__"})
