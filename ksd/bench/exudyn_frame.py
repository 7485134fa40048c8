"""A planar frame in Exudyn: geometrically exact shear-deformable beams of two nodes, static, in load steps.

The beams are linear in their unknowns and integrated at one point, so their error falls with the square of their length.
"""

from __future__ import annotations

import math
import warnings
from functools import partial
from typing import Any

import numpy as np

LOAD_STEPS = 20
"""At the start; Exudyn adapts them. Measured cheapest among 1, 2, 5, 10 and 20."""
SHEAR = 1e3
"""Shear stiffness of links, over their stretch stiffness."""


def exudyn(frame: Any) -> Any:
    """What builds the frame anew, and what solves it and returns (drive force [N], iterations)."""
    held: dict[str, Any] = {}
    return partial(_build, frame, held), partial(_analyse, held)


def _build(frame: Any, held: dict[str, Any]) -> None:
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
        shear = bar.GA if math.isfinite(bar.GA) else SHEAR * bar.EA
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


def _analyse(held: dict[str, Any]) -> tuple[float, int]:
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
