"""Time saved by solving in the plane: fourbar of paper 1 from straight to d = 0.3 m, three unknowns per node against six.

Thread CPU time, medians of interleaved runs. "whole call": `solve_conventional` with residual and inertia in space.
"equilibrium": the compiled Newton alone.
Run: python benchmarks/planar.py
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from common import STROKE, fourbar, time_in_turns

import ksd
from ksd.model.arrays import State, make_workspace
from ksd.model.compile import compile_scene
from ksd.model.mesh import Mesh
from ksd.model.newton import NewtonResult, solve_equilibrium
from ksd.model.plane import Plane
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.load_steps import LoadPath, take_load_steps
from ksd.solvers.storage import NewtonStorage

MESHES = {
    "strain-mode leaves": Mesh(),
    "5 elements, condensed": Mesh("corotational", elements=5),
    "5 elements, nodal": Mesh("corotational", elements=5, nodal=True),
}


def equilibria(model: ksd.Model, plane: Plane) -> tuple[Callable[[], object], Callable[[], object]]:
    """The Newton solves alone: (spatial, planar)."""
    target, zero = model.targets({"top": STROKE}), model.targets({"top": 0.0})
    storage = NewtonStorage(model)
    way, work = LoadPath(zero, target), make_workspace(plane.arrays)

    def spatial() -> object:
        return take_load_steps(model.rest.copy(), storage.newton, way, begin=model.rest)

    def in_plane(motion: State, values: np.ndarray, factor: float, *bounds: Any) -> NewtonResult:
        return solve_equilibrium(plane.arrays, motion, values, factor, work, *bounds)

    def planar() -> object:
        return take_load_steps(model.rest.copy(), in_plane, way, begin=model.rest)

    return spatial, planar


def main(rounds: int = 200) -> None:
    """Print spatial and planar times, their ratios, and the unknowns."""
    print(
        f"{'':24s}{'unknowns':>12s}{'whole call, us':>22s}{'ratio':>7s}{'equilibrium, us':>22s}{'ratio':>7s}"
    )
    for name, mesh in MESHES.items():
        model = compile_scene(fourbar(), mesh=mesh)
        plane = model.plane
        assert isinstance(plane, Plane)
        room = NewtonStorage(model)
        whole = [
            lambda m=model, r=room, p=p: solve_conventional(m, {"top": STROKE}, planar=p, storage=r)
            for p in (False, True)
        ]
        calls = {str(k): call for k, call in enumerate([*whole, *equilibria(model, plane)])}
        times = [found.median for found in time_in_turns(calls, repeats=rounds).values()]
        line = f"{name:24s}{model.arrays.plan.unknowns:>6d} ->{plane.arrays.plan.unknowns:>3d}"
        for spatial, planar in (times[:2], times[2:]):
            line += f"{spatial:>11.0f} ->{planar:>7.0f}{spatial / planar:>8.2f}"
        print(line)
    print("ratio: how many times the plane is faster")


if __name__ == "__main__":
    main()
