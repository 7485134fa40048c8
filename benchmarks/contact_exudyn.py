"""Contact beside Exudyn (1.13, ANCF cables, static solver, penalty contact) at equal error, without friction.

A finger pressed by a circle, the passive gripper and a disc in two jaws, as in acceptance. Both programs have stretch and no
shear. The error is that of the contact force, of ksd's on a mesh of higher orders. Exudyn: every combination of elements,
contact segments, penalty and load steps is run, the fastest of those within 1e-3 and 1e-4 also with modified Newton and the
other order of integration, and the fastest of all is taken; ksd: its usual mesh and its coarsest. CPU times of one thread,
of a prepared solve and of `SolveStatic` of an assembled model; medians of five in turns.
pip install exudyn; python benchmarks/contact_exudyn.py
"""

import math
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import redirect_stdout
from functools import partial
from io import StringIO
from itertools import product
from typing import Any, NamedTuple

import numpy as np

import ksd
from ksd.units import GPa, mm

ERRORS, REPEATS, CANDIDATES = (1e-3, 1e-4), 5, 30
MESHES = {"usual mesh": ksd.Mesh(), "orders 3, 2, 4": ksd.Mesh(orders=(3, 2, 4))}
"""Of ksd's leaf springs; none is coarser than the second."""
FINE = ksd.Mesh(orders=(5, 4, 12), points=20)
TOLERANCE = 1e-7
"""Residual [N] at which Exudyn's Newton iterations end; below, rounding of stretch keeps them from converging."""


class Leaf(NamedTuple):
    """A leaf spring along x: start and end (2,) [m], section [m], modulus [Pa], and number of the jaw at its end or None;
    its start is clamped, and moves along y by `stroke` [m]."""

    start: tuple[float, float]
    end: tuple[float, float]
    thickness: float
    width: float
    E: float
    jaw: int | None
    stroke: float = 0.0


class Case(NamedTuple):
    """A case: ksd's scene, drive values, and its force (2,) [N] in a pose; for Exudyn leaf springs, faces of jaws (two
    points (2,) [m], the outside on the right) and the circle: centre (2,), radius and move (2,) [m]."""

    scene: Any
    values: dict[str, float]
    force: Callable[[Any], Any]
    leaves: tuple[Leaf, ...]
    faces: tuple[tuple[float, ...], ...]
    circle: tuple[tuple[float, float], float, tuple[float, float]]


def finger() -> Case:
    """A leaf spring of 100 mm under a circle of 20 mm over x = 60 mm that is moved down by 10 mm."""
    steel, section = ksd.Material(E=200 * GPa, nu=0.3), ksd.rectangle(0.5 * mm, 10 * mm)
    scene, at = ksd.Mechanism("finger", plane="xy"), (60 * mm, 20.25 * mm, 0)
    tip, held = scene.links("tip", "circle")
    scene.leaf("ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), section=section, material=steel, name="leaf")
    for along in "xy":
        scene.actuate(held, along=along, at=at, name=along)
    scene.support(held, about="z")
    scene.contact("leaf", scene.surface(held, ksd.shapes.disc(20 * mm), at=at), name="c")
    leaf = Leaf((0.0, 0.0), (0.1, 0.0), 0.5 * mm, 10 * mm, 200 * GPa, None)
    circle = (at[0], at[1]), 20.25 * mm, (0.0, -10 * mm)
    return Case(scene, {"x": 0.0, "y": -10 * mm}, lambda pose: pose.contacts["c"].force, (leaf,), (), circle)


def gripper() -> Case:
    """The passive gripper: a wedge of 25 degrees on a plastic leaf spring, and a pin of 8.9 mm moved along it."""
    L, thickness, width, E, start = 57 * mm, 3.2 * mm, 9.5 * mm, 2.6 * GPa, (79 * mm, 10.5 * mm, 0)
    tip, beta, x = (76 * mm, 1.6 * mm), math.radians(25), 67.81 * mm
    scene = ksd.Mechanism("passive gripper", plane="xy")
    jaw, pin = scene.links("jaw", "pin")
    section, plastic = ksd.rectangle(thickness, width), ksd.Material(E=E, nu=0.38)
    scene.leaf("ground", jaw, start=(0, 0, 0), end=(L, 0, 0), section=section, material=plastic)
    scene.actuate(pin, along="x", at=start, name="x")
    scene.support(pin, along="y", at=start)
    scene.support(pin, about="z")
    flank = scene.surface(jaw, ksd.shapes.wall(), at=(*tip, 0), axis=(math.sin(beta), math.cos(beta), 0))
    scene.contact(flank, scene.surface(pin, ksd.shapes.disc(8.9 * mm), at=start), name="c")
    leaf = Leaf((0.0, 0.0), (L, 0.0), thickness, width, E, 0)
    face = tip[0], tip[1], tip[0] - 19 * mm, tip[1] + 19 * mm * math.tan(beta)
    circle = (start[0], start[1]), 8.9 * mm, (x - start[0], 0.0)
    return Case(scene, {"x": x - start[0]}, lambda pose: pose.contacts["c"].force, (leaf,), (face,), circle)


def jaws() -> Case:
    """A held disc of 15 mm between two flat jaws on parallel guides, whose bases close by 4 mm each."""
    section, steel = ksd.rectangle(0.3 * mm, 10 * mm), ksd.Material(E=200 * GPa, nu=0.3)
    scene, leaves, faces, values = ksd.Mechanism("jaws", plane="xy"), [], [], {}
    for k, (name, side) in enumerate((("lower", -1), ("upper", 1))):
        base, jaw = scene.links(f"{name} base", name)
        for y in (side * 20 * mm, side * 40 * mm):
            start, end = (0.0, y), (60 * mm, y)
            scene.leaf(base, jaw, start=(*start, 0), end=(*end, 0), section=section, material=steel)
            leaves.append(Leaf(start, end, 0.3 * mm, 10 * mm, 200 * GPa, k, -side * 4 * mm))
        scene.actuate(base, along="y", at=(0, side * 20 * mm, 0), name=name)
        scene.support(base, along="x", at=(0, side * 20 * mm, 0))
        scene.support(base, about="z")
        values[name] = -side * 4 * mm
        pad = scene.surface(jaw, ksd.shapes.wall(), at=(70 * mm, side * 15 * mm, 0), axis=(0, -side, 0))
        disc = scene.surface("ground", ksd.shapes.disc(15 * mm), at=(70 * mm, 0, 0), name=f"{name} side")
        scene.contact(pad, disc, name=f"{name} grip")
        left, right = (50 * mm, side * 15 * mm), (90 * mm, side * 15 * mm)
        faces.append((*right, *left) if side < 0 else (*left, *right))
    circle = (70 * mm, 0.0), 15 * mm, (0.0, 0.0)
    return Case(
        scene, values, lambda pose: pose.contacts["lower grip"].force, tuple(leaves), tuple(faces), circle
    )


class Settings(NamedTuple):
    """Of Exudyn: elements of a leaf spring, contact segments of an element along which it touches, penalty, load steps,
    Newton's method, and order of its integration."""

    elements: int
    segments: int
    penalty: float
    steps: int
    modified: bool
    integration: int
    kind: str = "circle"

    def __str__(self) -> str:
        newton = "modified Newton" if self.modified else "full Newton"
        segments = f"{self.segments} segments each ({self.kind}), " if self.segments else ""
        steps = f"{self.steps} step{'s' * (self.steps > 1)}"
        rest = f"penalty {self.penalty:.0e}, {steps}, {newton}, integration {self.integration}"
        return f"{self.elements} elements, {segments}{rest}"


def first_settings(along_leaf: bool) -> Iterator[Settings]:
    """All elements, segments, penalties and load steps that are tried."""
    if along_leaf:
        for kind, n, segments, penalty, steps in product(
            ("circle", "friction circle"), (6, 8, 10, 12, 14, 16, 20, 24, 32), (1, 2, 4, 8), (1e6, 3e6, 1e7, 3e7, 1e8),
            (1, 2, 3, 4, 6, 8),
        ):  # fmt: skip
            yield Settings(n, segments, penalty, steps, False, 0, kind)
    else:
        for n, penalty, steps in product((1, 2, 3, 4, 6, 8, 12, 16), (1e5, 1e6, 1e7, 1e8, 1e9), (1, 2, 4, 8)):
            yield Settings(n, 0, penalty, steps, False, 0)


def run_settings(
    case: Case, error: Callable[[Any], float]
) -> tuple[list[tuple[float, float, Settings]], int, int]:
    """CPU time [s], error and settings of all runs of Exudyn, their number, and how many failed.

    The fastest within each error are run again with modified Newton and the other order of integration.
    """
    rows: list[tuple[float, float, Settings]] = []
    tried = failed = 0

    def run(all_of_them: Iterable[Settings]) -> None:
        nonlocal tried, failed
        for how in all_of_them:
            tried += 1
            try:
                force, took = exudyn(case, how)
            except Exception as reason:
                if type(reason).__name__ != "SolverError":
                    raise
                failed += 1
                continue
            rows.append((took, error(force), how))

    run(first_settings(not case.faces))
    for limit in ERRORS:
        best = sorted((r for r in rows if r[1] <= limit), key=lambda row: row[0])[:CANDIDATES]
        for modified, integration in ((True, 0), (False, 1), (True, 1)):
            run([row[2]._replace(modified=modified, integration=integration) for row in best])
    return rows, tried, failed


def exudyn(case: Case, how: Settings) -> tuple[Any, float]:
    """Force (2,) [N] on the circle, of the first jaw where there are several, and CPU time [s]; raises where it fails."""
    import exudyn as exu  # type: ignore[import-not-found]
    from exudyn import itemInterface as items

    system = exu.SystemContainer()
    mbs: Any = system.AddSystem()
    matrix: Any = exu.MatrixContainer
    zero = mbs.AddMarker(
        items.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(items.NodePointGround()), coordinate=0)
    )

    def hold(node: int, coordinate: int, move: float = 0.0) -> int:
        """Hold a coordinate of a node, or move it along the load steps."""
        words: Any = {"offsetUserFunction": lambda _m, t, _i, _o: move * t} if move else {}
        marker = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate))
        return int(mbs.AddObject(items.CoordinateConstraint(markerNumbers=[zero, marker], **words)))

    centre, radius, move = case.circle
    node = mbs.AddNode(items.NodeRigidBody2D(referenceCoordinates=[*centre, 0.0]))
    words: Any = {"mass": 1.0, "inertia": 1.0}
    circle = mbs.AddObject(items.ObjectRigidBody2D(nodeNumber=node, **words))
    measured = [hold(node, k, m) for k, m in enumerate((*move, 0.0))][:2]
    round_marker = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=circle, localPosition=[0, 0, 0]))
    bodies = []
    for k, face in enumerate(case.faces):
        own = next(leaf for leaf in case.leaves if leaf.jaw == k)
        body_node = mbs.AddNode(items.NodeRigidBody2D(referenceCoordinates=[*own.end, 0.0]))
        body = mbs.AddObject(items.ObjectRigidBody2D(nodeNumber=body_node, **words))
        bodies.append((body, own.end))
        marker = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=body, localPosition=[0, 0, 0]))
        data = mbs.AddNode(
            items.NodeGenericData(initialCoordinates=[-1.0, 0.1, 0.0], numberOfDataCoordinates=3)
        )
        length = math.dist(face[:2], face[2:])
        segment: Any = [[a - b for a, b in zip(face, (*own.end, *own.end), strict=True)]]
        mbs.AddObject(
            items.ObjectContactCurveCircles(
                markerNumbers=[marker, round_marker], nodeNumber=data, circlesRadii=[radius], segmentsData=matrix(segment),
                polynomialData=matrix(), contactStiffness=how.penalty / length,
            )
        )  # fmt: skip
    roots: list[int] = []
    for leaf in case.leaves:
        step = (np.array(leaf.end) - leaf.start) / how.elements
        size, area = float(np.linalg.norm(step)), leaf.thickness * leaf.width
        along = (step / size).tolist()
        nodes = [
            mbs.AddNode(
                items.NodePoint2DSlope1(referenceCoordinates=[*(leaf.start + k * step).tolist(), *along])
            )
            for k in range(how.elements + 1)
        ]
        stiff: Any = {
            "length": size,
            "massPerLength": 1e-3,
            "bendingStiffness": leaf.E * area * leaf.thickness**2 / 12,
            "axialStiffness": leaf.E * area,
            "useReducedOrderIntegration": how.integration,
        }
        cables = [
            mbs.AddObject(items.Cable2D(nodeNumbers=nodes[k : k + 2], **stiff)) for k in range(how.elements)
        ]
        held = [hold(nodes[0], 0), hold(nodes[0], 1, leaf.stroke), hold(nodes[0], 3)]
        if leaf.jaw == 0 and len(case.faces) > 1:
            roots += held[:2]
        if leaf.jaw is not None:
            body, place = bodies[leaf.jaw]
            lever = [leaf.end[0] - place[0], leaf.end[1] - place[1], 0]
            ends = [
                mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=n, localPosition=at))
                for n, at in ((body, lever), (cables[-1], [size, 0, 0]))
            ]
            mbs.AddObject(items.GenericJoint(markerNumbers=ends, constrainedAxes=[1, 1, 0, 0, 0, 1]))
            continue
        for k, cable in enumerate(cables):
            # contact is looked for where it can be
            if (k + 1) * size < centre[0] - 15 * mm or k * size > centre[0] + 5 * mm:
                continue
            shape = mbs.AddMarker(
                items.MarkerBodyCable2DShape(bodyNumber=cable, numberOfSegments=how.segments)
            )
            touching = {"circle": items.ObjectContactCircleCable2D}.get(
                how.kind, items.ObjectContactFrictionCircleCable2D
            )
            start = [0.1] * how.segments
            start += [-2.0] * how.segments + [0.0] * how.segments if how.kind != "circle" else []
            data = mbs.AddNode(
                items.NodeGenericData(initialCoordinates=start, numberOfDataCoordinates=len(start))
            )
            how_it_touches: Any = {"numberOfContactSegments": how.segments, "contactStiffness": how.penalty}
            mbs.AddObject(
                touching(
                    markerNumbers=[round_marker, shape],
                    nodeNumber=data,
                    circleRadius=radius,
                    **how_it_touches,
                )
            )
    mbs.Assemble()
    settings: Any = exu.SimulationSettings()
    settings.linearSolver.solverType = exu.LinearSolverType.EXUdense
    if how.elements * len(case.leaves) > 12:
        settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.solution.file.write = settings.solution.sensors.active = False
    static = settings.staticSolver
    static.numberOfLoadSteps, static.verboseMode = how.steps, 0
    static.newton.useModifiedNewton = how.modified
    static.newton.absoluteTolerance = TOLERANCE
    static.adaptiveStep = False
    with redirect_stdout(StringIO()):
        begin = time.thread_time()
        mbs.SolveStatic(settings)
        spent = time.thread_time() - begin
    forces = [
        float(np.ravel(mbs.GetObjectOutput(c, exu.OutputVariableType.Force))[0]) for c in (roots or measured)
    ]
    return np.abs(np.reshape(forces, (-1, 2)).sum(axis=0)), spent


def front(rows: Iterable[tuple[float, float, str]]) -> list[tuple[float, float, str]]:
    """Those (time, error, name) that none is faster than at no larger error."""
    found: list[tuple[float, float, str]] = []
    for row in sorted(rows):
        if not found or row[1] < found[-1][1]:
            found.append(row)
    return found


def _median(run: Callable[[Any], tuple[Any, float]], setting: Any) -> float:
    """Median of the CPU times [s] of a setting."""
    return float(np.median([run(setting)[1] for _ in range(REPEATS)]))


def main() -> None:
    """Tables of both programs."""
    for kind in (ksd.SceneWarning, DeprecationWarning):
        warnings.simplefilter("ignore", kind)
    fronts, counts = [], []
    print("| case | error | program | setting | its error | time [ms] | ratio |")
    print("|---|---:|---|---|---:|---:|---:|")
    for name, case in (("finger", finger()), ("passive gripper", gripper()), ("disc in two jaws", jaws())):
        words: Any = {"without": "shear"}
        exact = np.abs(case.force(ksd.solve(case.scene, case.values, mesh=FINE, **words))[:2])

        def error(force: Any, exact: Any = exact) -> float:
            return float(np.linalg.norm(np.abs(force[:2]) - exact) / np.linalg.norm(exact))

        ours = {mesh: ksd.prepare(case.scene, mesh=own, **words) for mesh, own in MESHES.items()}

        def run_ours(setting: str, ours: Any = ours, case: Case = case) -> tuple[Any, float]:
            begin = time.thread_time()
            pose = ours[setting](case.values)
            spent = time.thread_time() - begin
            return case.force(pose), spent

        rows: dict[str, list[tuple[float, float, Any]]] = {"ksd": []}
        for setting in ours:
            # the first loads kernels
            force, _ = run_ours(setting)
            rows["ksd"].append((_median(run_ours, setting), error(force), setting))
        rows["exudyn"], tried, failed = run_settings(case, error)
        calls: dict[str, Any] = {"ksd": run_ours, "exudyn": partial(exudyn, case)}
        for limit in ERRORS:
            best: dict[str, tuple[float, float, Any]] = {}
            for program, own_rows in rows.items():
                within = sorted((row for row in own_rows if row[1] <= limit), key=lambda row: row[0])
                # a single time is of chance
                again = [(_median(calls[program], row[2]), row[1], row[2]) for row in within[:6]]
                best |= {program: min(again, key=lambda row: row[0])} if again else {}
            times: dict[str, list[float]] = {program: [] for program in best}
            for _ in range(REPEATS):
                for program, row in best.items():
                    times[program].append(calls[program](row[2])[1])
            fastest = float(np.median(times["ksd"])) if "ksd" in times else math.nan
            for program in rows:
                if program not in best:
                    print(f"| {name} | {limit:.0e} | {program} | none of {tried} | | | |")
                    continue
                spent_ms = 1e3 * float(np.median(times[program]))
                _, off, setting = best[program]
                print(
                    f"| {name} | {limit:.0e} | {program} | {setting} | {off:.1e} | {spent_ms:.2f} | "
                    f"{1e-3 * spent_ms / fastest:.1f} |",
                    flush=True,
                )
        fronts += [
            (name, program, took, off, setting)
            for program, own_rows in rows.items()
            for took, off, setting in front(own_rows)
        ]
        counts.append(f"{name}: {failed} of {tried} settings of Exudyn did not converge")
    print("\n" + "; ".join(counts) + ".")
    print("\n| case | program | time [ms] | error | setting |\n|---|---|---:|---:|---|")
    for name, program, took, off, setting in fronts:
        print(f"| {name} | {program} | {1e3 * took:.2f} | {off:.1e} | {setting} |")


if __name__ == "__main__":
    main()
