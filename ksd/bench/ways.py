"""The ways to a configuration that are compared: methods, leaf models, and the conventional baseline."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ksd.errors import ConvergenceError, KsdError
from ksd.model.compile import compile_scene
from ksd.model.leafs import Mesh
from ksd.solve.configuration import Configuration
from ksd.solve.conventional import conventional
from ksd.solve.solver import Solver
from ksd.solve.storage import Storage

EPS_MAX = (1e4, 1e5, 3e5, 1e6, 3e6, 1e7, 3e7, 1e8, 3e8, 1e9, math.inf)
"""Thresholds tried for plain Newton; the paper does not print its own."""
ORDERS = (((3, 2, 4), 5), ((4, 2, 5), 6), ((4, 3, 6), 7), ((5, 3, 6), 8))
"""Strain-mode leafs compared: curvature modes about x, y, z, and points."""
FINEST = Mesh(orders=(6, 5, 9), points=14)
"""The leaf model errors are counted from."""


@dataclass(frozen=True)
class Way:
    """One way: method, leaf model in words, its size (elements per leaf, or curvature modes), and the call."""

    method: str
    leafs: str
    size: int
    solve: Callable[[], Configuration]
    note: str = ""


def five_step_ways(
    scene: Any, targets: Mapping[str, float], mesh: Mesh, *, extrapolate: bool = False
) -> list[Way]:
    """Every method of one prepared solver; the fast ones without their error estimate."""
    solver = Solver(scene, mesh=mesh, extrapolate=extrapolate, planar=False)
    strain = mesh.leaf == "strain"
    leafs = (
        f"strain {','.join(map(str, mesh.orders))}"
        if strain
        else f"{mesh.elements} element{'s' * (mesh.elements > 1)}"
    )
    size = sum(mesh.orders) if strain else mesh.elements

    def way(name: str, method: str, of: Solver = solver, **more: Any) -> Way:
        return Way(name, leafs, size, lambda: of(targets, method=method, **more))

    def in_space(planar: bool) -> Configuration:
        return conventional(solver.model, targets, planar=planar, storage=solver.storage)

    found = [way("kinematic", "kinematic", estimate=False)]
    for passes in range(3):
        name = ("reduced", "reduced, 1 pass", "reduced, 2 passes")[passes]
        found.append(way(name, "reduced", passes=passes, estimate=False))
    found += [way("full", "full"), Way("conventional", leafs, size, lambda: in_space(False))]
    if _is_planar(solver, targets):
        flat = Solver(solver.model, extrapolate=extrapolate)
        found.append(way("reduced, planar", "reduced", flat, estimate=False))
        found.append(way("reduced, 1 pass, planar", "reduced", flat, passes=1, estimate=False))
        found.append(way("reduced, 2 passes, planar", "reduced", flat, passes=2, estimate=False))
        found.append(way("full, planar", "full", flat))
        found.append(Way("conventional, planar", leafs, size, lambda: in_space(True)))
    return found


def _is_planar(solver: Solver, targets: Mapping[str, float]) -> bool:
    """Whether the conventional solver finds that the scene stays in its plane."""
    try:
        conventional(solver.model, targets, planar=True, storage=solver.storage)
    except KsdError:
        return False
    return True


BASELINES = {
    "plain Newton": (False, True),
    "MIP on all nodes": (True, True),
    "MIP, best eps_max": (True, False),
}
"""Conventional methods compared with, as (mixed integration points, on all element nodes). The papers' own program is on all
nodes; on condensed leafs is the best we know."""


def baseline(scene: Any, targets: Mapping[str, float], elements: int, *, name: str = "plain Newton") -> Way:
    """The conventional method of paper 1, Appendix B, in one of its BASELINES: in space, its steps by the best eps_max.

    Best: fewest matrix solves among those that end where the smallest eps_max does. Raises ConvergenceError.
    """
    mip, nodal = BASELINES[name]
    model = compile_scene(scene, mesh=Mesh("corotational", elements=elements, mip=mip, nodal=nodal))
    storage = Storage(model)

    def solve(eps_max: float) -> Configuration:
        return conventional(
            model, targets, eps_max=eps_max, most=60, cap=math.inf, planar=False, storage=storage
        )

    counts: dict[float, int] = {}
    first: np.ndarray | None = None
    for eps_max in EPS_MAX:
        try:
            found = solve(eps_max)
        except ConvergenceError:
            continue
        forces = np.array(list(found.forces.values()))
        first = forces if first is None else first
        if np.allclose(forces, first, rtol=1e-6, atol=1e-6 * float(np.abs(first).max())):
            counts[eps_max] = found.iterations
    if not counts:
        raise ConvergenceError("it converged for no eps_max")
    best = min(counts, key=lambda e: counts[e])
    leafs = f"{elements} element{'s' * (elements > 1)}"
    return Way(name, leafs, elements, lambda: solve(best), f"eps_max {best:g}")


def modal_way(scene: Any, targets: Mapping[str, float], basis: Any, *, extrapolate: bool = False) -> Way:
    """Leafs as bodies of modes and modal derivatives (paper 2), the bases made once."""
    solver = Solver(scene, extrapolate=extrapolate, basis=basis)
    label = "modal, as printed" if basis.coordinates == "angle" else f"modal, order {basis.order}"
    return Way(
        "modal", label, basis.order, lambda: solver(targets, method="modal", estimate=False, strict=False)
    )


def _not_run(why: str) -> Configuration:
    raise ConvergenceError(why)


def ways_of(case: Any, *, quick: bool) -> Iterator[Way]:
    """All ways to a case of the suite; `quick` takes one mesh of each leaf model."""
    scene, targets = case.build()
    orders = ORDERS[2:3] if quick else ORDERS
    meshes = [Mesh(orders=o, points=p) for o, p in orders]
    elements = (case.quick,) if quick else case.elements
    meshes += [Mesh("corotational", elements=n) for n in elements]
    for mesh in meshes:
        yield from five_step_ways(scene, targets, mesh, extrapolate=case.extrapolate)
    from ksd.modal.choices import ModalBasis

    printed = ModalBasis(coordinates="angle", frame="node", internal=0)
    for basis in (ModalBasis(),) if quick else (ModalBasis(), ModalBasis(order=3), printed):
        if case.no_modal:
            yield Way("modal", "modal", basis.order, lambda: _not_run(case.no_modal))
            break
        yield modal_way(scene, targets, basis, extrapolate=case.extrapolate)
    for n in case.baseline:
        for name in BASELINES if not quick or n in elements else ():
            try:
                yield baseline(scene, targets, n, name=name)
            except KsdError:
                continue
