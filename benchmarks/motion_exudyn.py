"""Motion in time beside Exudyn (1.13, ANCF cables, generalised alpha, modified Newton, sparse) at equal error.

The parallel guide and the fourbar of cross flexures of acceptance. Each program takes the coarsest mesh and step that follow
the payload within 1e-3 of its largest displacement, of a history with steps of 1/3200. CPU times of one thread for the first
second of motion, the start of `ksd.simulate` included and the building of Exudyn's model not, and for the next; medians of
five in turns. pip install exudyn; python benchmarks/motion_exudyn.py
"""

import sys
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np

import ksd

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

ERROR, REPEATS = 1e-3, 5
STEPS = (16e-3, 8e-3, 4e-3, 2e-3, 1e-3)
ELEMENTS = (4, 5, 6, 8, 12, 16)
"""Of a leaf spring, in Exudyn."""
TOLERANCE = 1e-6
"""Of its Newton iterations; with the usual 1e-8 it does not converge for these leaf springs."""


def exudyn(scene: Any, node: int, force: Any, ramp: float) -> Any:
    """A function of elements, step and end that returns displacements of a node over time, and its CPU time [s].

    ramp [s]: in which the force (2,) rises by half a cosine.
    """
    import exudyn as exu  # type: ignore[import-not-found]
    from exudyn import itemInterface as items

    from ksd.answers.mass import member_leaves
    from ksd.model.leaves import mass_density
    from ksd.solvers.moving_model import rigid_bodies

    model = ksd.compile_scene(scene.scene())
    owner, members, rest = member_leaves(model), model.arrays.members, model.rest

    def push(_mbs: Any, t: float, vector: Any) -> Any:
        share = 0.5 - 0.5 * np.cos(np.pi * min(t / ramp, 1.0))
        return [share * v for v in vector]

    def run(elements: int, dt: float, until: float) -> Any:
        system = exu.SystemContainer()
        mbs = system.AddSystem()
        carried: dict[int, Any] = {}
        body, centre = {0: mbs.AddObject(items.ObjectGround())}, {0: np.zeros(2)}
        for k, (mass, at, J) in rigid_bodies(model).items():
            centre[k] = (rest.x[k] + at)[:2]
            own = mbs.AddNode(items.NodeRigidBody2D(referenceCoordinates=[*centre[k].tolist(), 0.0]))
            words: Any = {"physicsMass": mass, "physicsInertia": float(J[2, 2])}
            body[k] = mbs.AddObject(items.ObjectRigidBody2D(nodeNumber=own, **words))
            carried[k] = own
        for i, (a, b) in enumerate(members.node.tolist()):
            leaf, ends = owner[i][0], []
            for e, k in enumerate((a, b)):
                ends.append((rest.x[k] + rest.R[k] @ members.offset[i, e])[:2])
            step = (ends[1] - ends[0]) / elements
            along = step / np.linalg.norm(step)
            nodes = [
                mbs.AddNode(
                    items.NodePoint2DSlope1(
                        referenceCoordinates=[*(ends[0] + k * step).tolist(), *along.tolist()]
                    )
                )
                for k in range(elements + 1)
            ]
            section, stuff = leaf.section, leaf.material
            words = {
                "physicsLength": float(np.linalg.norm(step)),
                "physicsMassPerLength": mass_density(leaf) * section.A,
                "physicsBendingStiffness": stuff.E * min(section.Iy, section.Iz),
                "physicsAxialStiffness": stuff.E * section.A,
            }
            cables = [
                mbs.AddObject(items.Cable2D(nodeNumbers=[nodes[k], nodes[k + 1]], **words))
                for k in range(elements)
            ]
            turned = np.array([[along[0], -along[1], 0], [along[1], along[0], 0], [0, 0, 1.0]])
            for k, end, cable, s in (
                (a, ends[0], cables[0], 0.0),
                (b, ends[1], cables[-1], words["physicsLength"]),
            ):
                markers = [
                    mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=n, localPosition=place))
                    for n, place in ((body[k], [*(end - centre[k]).tolist(), 0]), (cable, [s, 0, 0]))
                ]
                held: Any = {"constrainedAxes": [1, 1, 0, 0, 0, 1], "rotationMarker0": turned}
                mbs.AddObject(items.GenericJoint(markerNumbers=markers, **held))
        marker = mbs.AddMarker(items.MarkerNodePosition(nodeNumber=carried[node]))
        ramped: Any = {"loadVectorUserFunction": push}
        mbs.AddLoad(items.Force(markerNumber=marker, loadVector=[*force, 0], **ramped))
        kind = exu.OutputVariableType.Displacement
        sensor = mbs.AddSensor(
            items.SensorNode(
                nodeNumber=carried[node], storeInternal=True, writeToFile=False, outputVariableType=kind
            )
        )
        mbs.Assemble()
        settings: Any = exu.SimulationSettings()
        settings.linearSolverType = exu.LinearSolverType.EigenSparse
        settings.solutionSettings.writeSolutionToFile = False
        settings.solutionSettings.sensorsWritePeriod = dt
        ways = settings.timeIntegration
        ways.numberOfSteps, ways.endTime = round(until / dt), until
        ways.generalizedAlpha.spectralRadius = 0.8
        ways.generalizedAlpha.useIndex2Constraints = ways.generalizedAlpha.useNewmark = True
        ways.newton.useModifiedNewton, ways.newton.relativeTolerance = True, TOLERANCE
        begin = time.thread_time()
        mbs.SolveDynamic(settings)
        spent = time.thread_time() - begin
        data = np.asarray(mbs.GetSensorStoredData(sensor))
        return data[:, 0], data[:, 1:3], spent

    return run


def main() -> None:
    """A table of both programs."""
    from motion_scenes import HEIGHT, four_hinges, guide

    for kind in (ksd.SceneWarning, DeprecationWarning):
        warnings.simplefilter("ignore", kind)
    cases: tuple[Any, ...] = (
        ("parallel guide", guide(), "stage", (0.1, 0, 0), (0.0, 20.0), 0.02, 0.08, {"loads": {"push": ksd.Ramp(0.02)}}),
        (
            "fourbar", four_hinges(), "top", (0, HEIGHT, 0), (150.0, 0.0), 0.1, 0.4,
            {"loads": {"push": ksd.Ramp(0.1)}, "drives": {"top": None}},
        ),
    )  # fmt: skip
    print("| scene | program | mesh and step | error | first second [s] | ratio | next [s] | ratio |")
    print("|---|---|---|---:|---:|---:|---:|---:|")
    for name, scene, link, at, force, ramp, until, words in cases:
        exact = ksd.simulate(scene, until, dt=until / 3200, **words)
        y = exact[link].at(at).displacement[:, int(np.argmax(np.abs(force)))]

        def error(t: Any, found: Any, y: Any = y, exact: Any = exact) -> float:
            return float(np.abs(found - np.interp(t, exact.t, y)).max() / np.abs(y).max())

        own = exudyn(scene, exact.trace.model.node_names.index(link), force, ramp)
        axis = int(np.argmax(np.abs(force)))
        rows: list[Any] = []

        def ours(
            dt: float, until: float = until, scene=scene, words=words, link=link, at=at, axis=axis
        ) -> Any:  # type: ignore[no-untyped-def]
            begin = time.thread_time()
            found = ksd.simulate(scene, until, dt=dt, **words)
            spent = time.thread_time() - begin
            return found.t, found[link].at(at).displacement[:, axis], spent

        def theirs(elements: int, dt: float, until: float = until, own: Any = own, axis: int = axis) -> Any:
            t, found, spent = own(elements, dt, until)
            return t, found[:, axis], spent

        sides: tuple[tuple[str, Any, Any], ...] = (
            ("ksd", ours, [(dt,) for dt in STEPS]),
            ("exudyn", theirs, [(n, dt) for dt in STEPS for n in ELEMENTS]),
        )
        for program, run, choices in sides:
            best: Any = None
            for choice in choices:
                try:
                    t, found, _ = run(*choice)
                except Exception as reason:
                    if type(reason).__name__ != "SolverError":
                        raise
                    continue
                off = error(t, found)
                # elements times steps
                size = (choice[0] if len(choice) > 1 else 1) / choice[-1]
                if off < ERROR and (best is None or size < best[2]):
                    best = choice, off, size
            mesh = f"{best[0][0]} elements, " if len(best[0]) > 1 else ""
            rows.append((program, run, best[0], f"{mesh}{1e3 * best[0][-1]:g} ms", best[1]))
        # in turns, so that other load meets both
        times = [
            [[run(*choice, end)[2] for end in (1.0, 2.0)] for _, run, choice, _, _ in rows]
            for _ in range(REPEATS)
        ]
        first, both = np.median(times, axis=0).T
        second = both - first
        for k, (program, _, _, said, off) in enumerate(rows):
            shown = " | ".join(f"{t[k]:.3f} | {t[k] / t[0]:.1f}" for t in (first, second))
            print(f"| {name} | {program} | {said} | {off:.1e} | {shown} |", flush=True)


if __name__ == "__main__":
    main()
