"""Scenes of the benchmark, and the methods and leaf models that are compared on each.

Cross flexures are those of Dwarshuis et al. (2020), Table 1. The fourbar of the paper has two interpretations, as the figure
with its dimensions is lost: H = 0.3 m is the distance of the joint centres, or the length of the rigid side link. The arm
has three 3x-infinity joints about z, y, y and links of our own choice (`ksd/scenes/arm.toml`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib.resources import as_file, files
from typing import Any

import numpy as np

from ksd.errors import ConvergenceError, KsdError
from ksd.modal.choices import ModalBasis
from ksd.model.compile import compile_scene
from ksd.model.mesh import Mesh
from ksd.scene import CrossFlexure, Material, Mechanism
from ksd.scene.families.guide import ParallelGuide
from ksd.scene.toml_file import load_scene
from ksd.solvers.configuration import Configuration
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.solver import Method, Solver
from ksd.solvers.storage import NewtonStorage
from ksd.study.compare import raise_not_run
from ksd.units import GPa, deg, mm

Targets = dict[str, float]
STEEL = Material(E=200 * GPa, G=76.9 * GPa, density=7800)
FOURBAR_STROKE = 300 * mm


@dataclass(frozen=True)
class Case:
    """A scene at one pose; `build` returns the mechanism and its drive values [m or rad].

    link, at (3,) [m, undeformed]: point whose support stiffness is compared. elements: numbers of Appendix A elements per
    leaf that are tried; baseline: those also solved by plain Newton on all element nodes, which is slow; quick: the one of
    `--quick`. no_modal: why modal bodies are left out, empty where they are not. extrapolate: joints may leave their trained
    range, by the little that a coarse mesh needs.
    """

    name: str
    build: Callable[[], tuple[Mechanism, Targets]]
    link: str
    at: tuple[float, float, float]
    elements: tuple[int, ...] = (1, 2, 3, 4, 5, 6, 7, 8)
    baseline: tuple[int, ...] = (1, 2, 3, 4, 5, 6)
    quick: int = 5
    extrapolate: bool = False
    no_modal: str = ""


def cross_flexure() -> CrossFlexure:
    """The cross flexure of the fourbar."""
    return CrossFlexure(STEEL, length=100 * mm, angle=45 * deg, thickness=1 * mm, widths=(40 * mm, 20 * mm))


def hinge() -> tuple[Mechanism, Targets]:
    """One cross flexure turned by 45 degrees."""
    scene = Mechanism("cross flexure")
    tip = scene.link("tip")
    scene.actuate_joint(
        scene.join(scene.ground, tip, cross_flexure(), at=(0, 0, 0), axis="z", toward="x"), name="turn"
    )
    return scene, {"turn": 45 * deg}


def fourbar(height: float) -> tuple[Mechanism, Targets]:
    """Four cross flexures, joint centres `height` [m] apart along y, the top link moved by 0.3 m."""
    joint, scene = cross_flexure(), Mechanism("fourbar")
    left, top, right = scene.links("left", "top", "right")
    scene.join(scene.ground, left, joint, at=(-0.2, 0, 0), axis="z", toward="y")
    scene.join(left, top, joint, at=(-0.2, height, 0), axis="z", toward="y")
    scene.join(right, top, joint, at=(0.2, height, 0), axis="z", toward="y")
    scene.join(scene.ground, right, joint, at=(0.2, 0, 0), axis="z", toward="y")
    scene.actuate(top, along="x", at=(0, height + joint.length_AB, 0))
    return scene, {"top": FOURBAR_STROKE}


def guide() -> tuple[Mechanism, Targets]:
    """A parallel leaf-spring guide moved by 20 mm."""
    joint = ParallelGuide(STEEL, length=100 * mm, thickness=0.5 * mm, width=30 * mm, spacing=60 * mm)
    scene = Mechanism("parallel guide")
    shuttle = scene.link("shuttle")
    placed = scene.join(scene.ground, shuttle, joint, at=(0, 0, 0), axis="z", toward="x")
    scene.actuate_joint(placed, name="stroke")
    return scene, {"stroke": 20 * mm}


def chain(joints: int) -> tuple[Mechanism, Targets]:
    """Cross flexures in series, every joint turned by 20 degrees, alternately left and right."""
    joint, scene = cross_flexure(), Mechanism(f"chain of {joints} joints")
    base, targets = scene.ground, {}
    for k in range(joints):
        link = scene.link(f"link {k + 1}")
        placed = scene.join(base, link, joint, at=(0.2 * k, 0, 0), axis="z", toward="x")
        scene.actuate_joint(placed, name=f"turn {k + 1}")
        targets[f"turn {k + 1}"] = (20 * deg) * (-1) ** k
        base = link
    return scene, targets


def _packaged_scene(name: str) -> tuple[Mechanism, Targets]:
    """A scene file of the package."""
    with as_file(files("ksd") / "scenes" / f"{name}.toml") as path:
        scene, targets, _ = load_scene(path)
    return scene, dict(targets)


TIP = (0.51, 0.0, 0.05)
"""End of the third link of the arm, undeformed [m]."""


def arm_by_joints() -> tuple[Mechanism, Targets]:
    """The arm of the package, every joint driven to 45 degrees."""
    return _packaged_scene("arm_joints")


def arm_by_location() -> tuple[Mechanism, Targets]:
    """The arm of `arm_by_joints`, its end driven along x, y, z to where 45 degrees in every joint move it."""
    by_joints, angles = arm_by_joints()
    pose = solve_conventional(compile_scene(by_joints), angles)
    displacement = pose.displacement("third", TIP)
    return _packaged_scene("arm")[0], {a: float(v) for a, v in zip("xyz", displacement, strict=True)}


def six_joint_arm() -> tuple[Mechanism, Targets]:
    """The arm of six 3x-infinity joints of the package, the pose of its last link driven."""
    return _packaged_scene("six_joint_arm")


def random_stage() -> tuple[Mechanism, Targets]:
    """A stage on three legs of three cross flexures each, placed at random (two closed loops), moved in x, y and angle."""
    rng = np.random.default_rng(7)
    joint = CrossFlexure(STEEL, length=40 * mm, angle=45 * deg, thickness=0.3 * mm, widths=(12 * mm, 6 * mm))
    scene = Mechanism("random stage")
    stage = scene.link("stage")
    for k in range(3):
        turn = (90 + 120 * k + rng.uniform(-15, 15)) * deg
        inner, outer = 0.08 + rng.uniform(-0.01, 0.01), 0.2 + rng.uniform(-0.02, 0.02)
        bend = rng.uniform(40, 70) * deg
        radial = np.array([math.cos(turn), math.sin(turn), 0.0])
        tangential = np.array([-math.sin(turn), math.cos(turn), 0.0])
        elbow = 0.5 * (inner + outer) * radial + 0.5 * (outer - inner) * math.tan(bend) * tangential
        lower, upper = scene.links(f"lower {k + 1}", f"upper {k + 1}")
        links = (scene.ground, lower, upper, stage)
        for n, at in enumerate((outer * radial, elbow, inner * radial)):
            words: dict[str, Any] = {"axis": "z", "toward": tuple(-radial), "name": f"joint {k + 1}.{n + 1}"}
            scene.join(links[n], links[n + 1], joint, at=tuple(at), **words)
    for along in "xy":
        scene.actuate(stage, along=along, at=(0, 0, 0), name=f"stage {along}")
    scene.actuate(stage, about="z", name="stage turn")
    return scene, {"stage x": 8 * mm, "stage y": -6 * mm, "stage turn": 5 * deg}


FOURBAR_TOP = FOURBAR_STROKE + cross_flexure().length_AB
MODAL_TOO_SLOW = "not run: one call with bodies for so many leaf springs takes half a minute"

SUITE: tuple[Case, ...] = (
    Case("cross flexure, 45 degrees", hinge, "tip", cross_flexure().pose_B),
    Case("fourbar, reading 1, d = 0.3 m", lambda: fourbar(FOURBAR_STROKE), "top", (0.0, FOURBAR_TOP, 0.0)),
    Case(
        "fourbar, reading 2, d = 0.3 m", lambda: fourbar(FOURBAR_TOP), "top",
        (0.0, FOURBAR_TOP + cross_flexure().length_AB, 0.0),
    ),
    Case("parallel guide, 20 mm", guide, "shuttle", (0.1, 0.0, 0.0)),
    Case(
        "three-joint arm by joints, 45 degrees", arm_by_joints, "third", TIP, baseline=(1, 5), quick=1, extrapolate=True,
        no_modal=MODAL_TOO_SLOW,
    ),
    Case(
        "three-joint arm by location, 45 degrees", arm_by_location, "third", TIP, baseline=(1, 5), quick=1,
        extrapolate=True, no_modal=MODAL_TOO_SLOW,
    ),
    Case(
        "six-joint arm", six_joint_arm, "sixth", (0.85, 0.0, 0.15), baseline=(), quick=1, extrapolate=True,
        no_modal=MODAL_TOO_SLOW,
    ),
    Case("random closed-loop stage", random_stage, "stage", (0.0, 0.0, 0.0), baseline=(2, 5), quick=2),
    Case("chain of 3 joints, 20 degrees", lambda: chain(3), "link 3", (0.6, 0.0, 0.0), baseline=(), quick=2),
    Case(
        "chain of 100 joints, 20 degrees", lambda: chain(100), "link 100", (20.0, 0.0, 0.0), elements=(1, 2, 4, 8),
        baseline=(), quick=2, no_modal=MODAL_TOO_SLOW,
    ),
)  # fmt: skip
"""All scenes of `bench.py`."""


EPS_MAX_VALUES = (1e4, 1e5, 3e5, 1e6, 3e6, 1e7, 3e7, 1e8, 3e8, 1e9, math.inf)
"""Residual thresholds tried for plain Newton; the paper does not print its own."""
ORDERS = (((3, 2, 4), 5), ((4, 2, 5), 6), ((4, 3, 6), 7), ((5, 3, 6), 8))
"""Strain-mode leaves compared: curvature modes about x, y, z, and points."""


@dataclass(frozen=True)
class Variant:
    """A method with a leaf model: its label, its size (elements per leaf, or number of curvature modes), and the call."""

    method: str
    leaves: str
    size: int
    solve: Callable[[], Configuration]
    note: str = ""


def leaf_label(mesh: Mesh) -> str:
    """Label of a leaf model."""
    if mesh.leaf == "strain":
        return f"strain {','.join(map(str, mesh.orders))}"
    return f"{mesh.elements} element{'s' * (mesh.elements > 1)}"


def leaf_meshes(case: Case, *, quick: bool) -> list[Mesh]:
    """Leaf models compared on a case; `quick`: one of each kind."""
    strain = [Mesh(orders=o, points=p) for o, p in (ORDERS[2:3] if quick else ORDERS)]
    elements = (case.quick,) if quick else case.elements
    return strain + [Mesh("corotational", elements=n) for n in elements]


def five_step_variants(
    scene: Any, targets: Mapping[str, float], mesh: Mesh, *, extrapolate: bool
) -> list[Variant]:
    """Every method of one prepared solver; "kinematic" and "reduced" without their error estimates."""
    solver = Solver(scene, mesh=mesh, extrapolate=extrapolate, planar=False)
    leaves, size = leaf_label(mesh), sum(mesh.orders) if mesh.leaf == "strain" else mesh.elements

    def variant(name: str, method: Method, *, relinearisations: int = 0, estimate: bool = True) -> Variant:
        options: dict[str, Any] = {"relinearisations": relinearisations, "estimate": estimate}
        return Variant(name, leaves, size, lambda: solver(targets, method=method, **options))

    def conventional(planar: bool) -> Configuration:
        return solve_conventional(solver.model, targets, planar=planar, storage=solver.storage)

    variants = [variant("kinematic", "kinematic", estimate=False)]
    for relinearisations in range(3):
        name = ("reduced", "reduced, 1 step", "reduced, 2 steps")[relinearisations]
        variants.append(variant(name, "reduced", relinearisations=relinearisations, estimate=False))
    variants += [variant("full", "full"), Variant("conventional", leaves, size, lambda: conventional(False))]
    if _is_planar(solver, targets):
        variants.append(Variant("conventional, planar", leaves, size, lambda: conventional(True)))
    return variants


def _is_planar(solver: Solver, targets: Mapping[str, float]) -> bool:
    """Whether the scene can be solved in its plane."""
    try:
        solve_conventional(solver.model, targets, planar=True, storage=solver.storage)
    except KsdError:
        return False
    return True


BASELINES = {
    "plain Newton": (False, True),
    "MIP on all nodes": (True, True),
    "MIP, best eps_max": (True, False),
}
"""Conventional methods that the others are compared with: (mixed integration points, unknowns of all element nodes). The
program of the papers has the unknowns of all nodes; condensed leaf springs are the fastest known to us."""


def baseline_variant(scene: Any, targets: Mapping[str, float], elements: int, *, name: str) -> Variant:
    """The conventional method of paper 1, Appendix B, as one of BASELINES, in space, with the best eps_max.

    The best eps_max needs the fewest factorisations among those that lead to the solution of the smallest one. Raises
    ConvergenceError where none converges.
    """
    mip, nodal = BASELINES[name]
    model = compile_scene(scene, mesh=Mesh("corotational", elements=elements, mip=mip, nodal=nodal))
    storage = NewtonStorage(model)

    def solve(eps_max: float) -> Configuration:
        return solve_conventional(
            model,
            targets,
            eps_max=eps_max,
            max_iterations=60,
            max_turn=math.inf,
            planar=False,
            storage=storage,
        )

    counts: dict[float, int] = {}
    first: np.ndarray | None = None
    for eps_max in EPS_MAX_VALUES:
        try:
            pose = solve(eps_max)
        except ConvergenceError:
            continue
        forces = np.array(list(pose.forces.values()))
        first = forces if first is None else first
        if np.allclose(forces, first, rtol=1e-6, atol=1e-6 * float(np.abs(first).max())):
            counts[eps_max] = pose.iterations
    if not counts:
        raise ConvergenceError("it converged for no eps_max")
    best = min(counts, key=lambda e: counts[e])
    leaves = leaf_label(Mesh("corotational", elements=elements))
    return Variant(name, leaves, elements, lambda: solve(best), f"eps_max {best:g}")


def modal_variant(scene: Any, targets: Mapping[str, float], basis: Any, *, extrapolate: bool) -> Variant:
    """Leaf springs as bodies of modes and modal derivatives (paper 2), with bases computed beforehand."""
    solver = Solver(scene, extrapolate=extrapolate, basis=basis)
    label = "modal, as printed" if basis.coordinates == "angle" else f"modal, order {basis.order}"
    return Variant(
        "modal", label, basis.order, lambda: solver(targets, method="modal", estimate=False, strict=False)
    )


def case_variants(case: Case, *, quick: bool) -> Iterator[Variant]:
    """All methods with all leaf models for a case of the suite; `quick`: one mesh of each leaf model."""
    scene, targets = case.build()
    for mesh in leaf_meshes(case, quick=quick):
        yield from five_step_variants(scene, targets, mesh, extrapolate=case.extrapolate)
    printed = ModalBasis(coordinates="angle", frame="node", internal=0)
    for basis in (ModalBasis(),) if quick else (ModalBasis(), ModalBasis(order=3), printed):
        if case.no_modal:
            yield Variant("modal", "modal", basis.order, lambda: raise_not_run(case.no_modal))
            break
        yield modal_variant(scene, targets, basis, extrapolate=case.extrapolate)
    for n in case.baseline:
        for name in BASELINES if not quick or n == case.quick else ():
            try:
                yield baseline_variant(scene, targets, n, name=name)
            except KsdError:
                continue
