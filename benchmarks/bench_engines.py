"""Other engines on the scenes of the benchmark, where they are installed: an optional extra, `pip install ksd[engines]`.

The planar model of a scene driven along one axis is handed over element by element: leaf springs as chains of equal beams,
links as much stiffer beams between the points that hang on them. OpenSees: corotational
Euler-Bernoulli elements in two dimensions, drive moved in load steps that are halved on failure. Exudyn: geometrically exact
shear-deformable beams of two nodes, linear in their unknowns and integrated at one point, so that their error falls with the
square of their length, in load steps.
"""

from __future__ import annotations

import contextlib
import ctypes
import math
import os
import statistics
import time
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ksd.errors import SceneError
from ksd.model.arrays import TRANSLATION, Members
from ksd.model.compile import compile_scene
from ksd.model.mesh import Mesh
from ksd.model.plane import Plane

LINK_STIFFNESS_FACTORS = (1e3, 1e6)
"""Stiffness of links over that of the stiffest leaf, in stretch and in bending."""
LOAD_STEPS = 20
"""At the start; Exudyn adapts them. Measured cheapest among 1, 2, 5, 10 and 20."""
LINK_SHEAR_FACTOR = 1e3
"""Shear stiffness of links, over their stretch stiffness."""


@dataclass(frozen=True)
class Bar:
    """A straight beam between two points: node numbers, EA [N], EI [N m^2], k GA [N]; inf: stiff in shear."""

    a: int
    b: int
    EA: float
    EI: float
    GA: float = math.inf


@dataclass(frozen=True)
class Frame:
    """A planar frame: points (k, 2) [m], those fixed, bars, and the drive: point, axis 0 or 1, displacement [m]."""

    points: np.ndarray
    fixed: tuple[int, ...]
    bars: tuple[Bar, ...]
    drive: tuple[int, int, float]


@dataclass(frozen=True)
class EngineRow:
    """Result of an engine: thread time [us] of a solve without building, iterations, force error; said: why it has none."""

    engine: str
    elements: int
    us: float
    iterations: int
    force_error: float
    said: str = ""


def frame_of(scene: Any, targets: Mapping[str, float], elements: int) -> Frame:
    """The planar frame of a scene. Raises SceneError for one that is not planar or not driven along one axis."""
    plane = compile_scene(scene, mesh=Mesh("corotational", elements=elements)).plane
    if not isinstance(plane, Plane):
        raise SceneError(f"other engines are given planar scenes; {scene.name}: {plane}")
    arrays, axes = plane.arrays, plane.arrays.active_dofs[:2]
    # the first points are the centres of the nodes, of which ground is the first
    points, fixed, bars = list(plane.rest.x[:, axes]), [0], []
    leaves = _leaves(arrays.members, axes)
    EA, EI = (
        times * max(leaf[k] for leaf in leaves.values()) for k, times in enumerate(LINK_STIFFNESS_FACTORS)
    )

    def add(place: np.ndarray) -> int:
        points.append(place)
        return len(points) - 1

    def hung(node: int, offset: np.ndarray) -> int:
        if np.linalg.norm(offset) < 1e-9 * arrays.size:
            return node
        point = add(points[node] + offset)
        if node == 0:
            fixed.append(point)
        else:
            bars.append(Bar(node, point, EA, EI))
        return point

    for where, stiffness in leaves.items():
        ends = [hung(node, np.array(offset)) for node, offset in where]
        p, q = (points[e] for e in ends)
        between = [add(p + (q - p) * k / elements) for k in range(1, elements)]
        chain = [ends[0], *between, ends[1]]
        bars += [Bar(a, b, *stiffness) for a, b in pairwise(chain)]
    terms = arrays.terms
    if len(terms.kind) != 1 or terms.kind[0] != TRANSLATION or terms.node[0, 0] != 0:
        raise SceneError("other engines are given scenes with one drive along one axis")
    direction = terms.direction[0, axes]
    axis = int(np.argmax(np.abs(direction)))
    sign = float(np.sign(direction[axis]))
    point = hung(int(terms.node[0, 1]), terms.point[0, 1, axes])
    value = sign * next(iter(targets.values()))
    return Frame(np.array(points), tuple(fixed), tuple(bars), (point, axis, value))


def _leaves(members: Members, axes: np.ndarray) -> dict[Any, tuple[float, float, float]]:
    """EA, EI and k GA of the chains by (node, offset) of both ends; those that coincide in the plane together."""
    found: dict[Any, tuple[float, float, float]] = {}
    for i in range(len(members.kind)):
        ends = zip(members.node[i].tolist(), np.round(members.offset[i][:, axes], 12).tolist(), strict=True)
        where = tuple((node, tuple(offset)) for node, offset in ends)
        more = found.get(where, (0.0, 0.0, 0.0))
        EA, EI, GA = (a + b for a, b in zip(more, _stiffness(members, i), strict=True))
        found[where] = EA, EI, GA
    return found


def _stiffness(members: Members, i: int) -> tuple[float, float, float]:
    """EA, EI and k GA of chain i, from the stiffness numbers of its first element."""
    length, s1, _, _, _, a, b = members.value[members.value_at[i] : members.value_at[i] + 7]
    EI = float(0.5 * (a + b) * length**3)
    # a = (4 + Phi) s, b = (-2 + Phi) s with s = EI / ((1 + Phi) L^3) and Phi = 12 EI / (k GA L^2)
    phi = EI * 6.0 / ((a - b) * length**3) - 1.0
    return float(s1 * length), EI, float(12.0 * EI / (phi * length**2)) if phi > 1e-12 else math.inf


def _preload_blas() -> None:
    """Load the BLAS library of the Linux wheel of OpenSees, which is in a folder that the loader does not search."""
    found = find_spec("openseespylinux")
    if found is not None and found.origin:
        with contextlib.suppress(OSError):
            ctypes.CDLL(str(Path(found.origin).parent / "lib" / "libblas.so.3"), mode=ctypes.RTLD_GLOBAL)


Solve = tuple[Callable[[], None], Callable[[], tuple[float, int]]]


def opensees(frame: Frame) -> Solve:
    """OpenSees: a function that builds the frame, and one that solves it and returns (drive force [N], iterations)."""
    _preload_blas()
    import openseespy.opensees as ops  # type: ignore[import-not-found]

    return partial(_build, ops, frame), partial(_analyse, ops, frame)


def _build(ops: Any, frame: Frame) -> None:
    """The frame in OpenSees, at rest, its drive in one load pattern."""
    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 3)
    for k, (x, y) in enumerate(frame.points):
        ops.node(k + 1, float(x), float(y))
    loose = set(range(len(frame.points))) - {n for bar in frame.bars for n in (bar.a, bar.b)}
    for k in {*frame.fixed, *loose}:
        ops.fix(k + 1, 1, 1, 1)
    ops.geomTransf("Corotational", 1)
    for k, bar in enumerate(frame.bars):
        ops.element("elasticBeamColumn", k + 1, bar.a + 1, bar.b + 1, bar.EA, 1.0, bar.EI, 1)
    point, axis, value = frame.drive
    ops.timeSeries("Linear", 1)
    ops.pattern("Plain", 1, 1)
    ops.sp(point + 1, axis + 1, value)
    ops.constraints("Transformation")
    ops.numberer("RCM")
    ops.system("UmfPack")
    ops.test("NormDispIncr", 1e-8, 20, 0)
    ops.algorithm("Newton")
    ops.integrator("LoadControl", 1.0)
    ops.analysis("Static", "-noWarnings")
    # load steps that fail are told in the table, not on the screen
    ops.logFile("/dev/null" if os.name == "posix" else "NUL", "-noEcho")


def _analyse(ops: Any, frame: Frame) -> tuple[float, int]:
    """Load steps, halved on failure."""
    done, size, count = 0.0, 1.0, 0
    while done < 1.0 - 1e-12:
        size = min(size, 1.0 - done)
        ops.integrator("LoadControl", size)
        failed = ops.analyze(1)
        count += int(ops.testIter())
        if failed == 0:
            done += size
            continue
        size *= 0.5
        if size < 1e-4:
            return math.nan, count
    ops.reactions()
    point, axis, _ = frame.drive
    return float(ops.nodeReaction(point + 1, axis + 1)), count


def exudyn(frame: Frame) -> Solve:
    """Exudyn: a function that builds the frame, and one that solves it and returns (drive force [N], iterations)."""
    held: dict[str, Any] = {}
    return partial(_build_exudyn, frame, held), partial(_analyse_exudyn, held)


def _build_exudyn(frame: Frame, held: dict[str, Any]) -> None:
    import exudyn as exu  # type: ignore[import-not-found]
    from exudyn import itemInterface as items

    held.clear()
    held["system"] = exu.SystemContainer()
    mbs = held["model"] = held["system"].AddSystem()
    nodes = [
        mbs.AddNode(items.NodeRigidBody2D(referenceCoordinates=[float(x), float(y), 0.0]))
        for x, y in frame.points
    ]
    for bar in frame.bars:
        length = float(np.linalg.norm(frame.points[bar.b] - frame.points[bar.a]))
        shear = bar.GA if math.isfinite(bar.GA) else LINK_SHEAR_FACTOR * bar.EA
        mbs.AddObject(
            items.ObjectBeamGeometricallyExact2D(
                nodeNumbers=[nodes[bar.a], nodes[bar.b]], length=length, massPerLength=1.0,
                crossSectionInertia=1e-6, axialStiffness=bar.EA, bendingStiffness=bar.EI, shearStiffness=shear,
                includeReferenceRotations=False,
            )
        )  # fmt: skip
    ground = mbs.AddMarker(
        items.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(items.NodePointGround()), coordinate=0)
    )

    def held_at(node: int, coordinate: int, **more: Any) -> Any:
        marker = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=nodes[node], coordinate=coordinate))
        return mbs.AddObject(items.CoordinateConstraint(markerNumbers=[ground, marker], **more))

    loose = set(range(len(frame.points))) - {n for bar in frame.bars for n in (bar.a, bar.b)}
    for node in {*frame.fixed, *loose}:
        for coordinate in range(3):
            held_at(node, coordinate)
    point, axis, value = frame.drive
    held["drive"] = held_at(point, axis, offset=0.0, offsetUserFunction=lambda _mbs, t, _i, _o: t * value)
    mbs.Assemble()


def _analyse_exudyn(held: dict[str, Any]) -> tuple[float, int]:
    import exudyn as exu

    settings = exu.SimulationSettings()
    settings.staticSolver.numberOfLoadSteps = LOAD_STEPS
    settings.staticSolver.verboseMode = 0
    settings.solution.file.write = False
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    solver: Any = exu.MainSolverStatic()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        reached = solver.SolveSystem(held["model"], settings)
    count = int(solver.it.newtonStepsCount)
    if not reached:
        return math.nan, count
    return float(held["model"].GetObjectOutput(held["drive"], exu.OutputVariableType.Force)), count


ENGINES = {"OpenSees": ("openseespy", opensees), "Exudyn": ("exudyn", exudyn)}
"""Engines by name: the package each needs, and its function."""


def measure_engines(
    scene: Any, targets: Mapping[str, float], force: float, *, elements: tuple[int, ...], repeats: int = 5
) -> list[EngineRow]:
    """Results of every engine; force: the exact one [N]. Engines that are not installed have a row that says so."""
    rows = []
    for engine, (package, _) in ENGINES.items():
        try:
            if find_spec(package) is None:
                raise ImportError(f"{package} is not installed")
            rows += [_row(engine, n, frame_of(scene, targets, n), force, repeats) for n in elements]
        except (ImportError, RuntimeError, SceneError) as reason:
            rows.append(EngineRow(engine, 0, math.nan, 0, math.nan, f"skipped: {reason}"))
    return rows


def _row(engine: str, elements: int, frame: Frame, force: float, repeats: int) -> EngineRow:
    build, solve = ENGINES[engine][1](frame)
    spent, found, count = [], math.nan, 0
    for _ in range(repeats):
        build()
        begin = time.thread_time_ns()
        found, count = solve()
        spent.append(1e-3 * (time.thread_time_ns() - begin))
    said = "" if math.isfinite(found) else "did not converge"
    error = abs(abs(found) / abs(force) - 1.0)
    return EngineRow(engine, elements, statistics.median(spent), count, error, said)
