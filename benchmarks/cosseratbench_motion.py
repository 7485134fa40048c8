"""ksd in the `pendulum` of cosseratbench (package index, Apache-2.0): a hanging cable that swings in its first mode.

All variations of the modulus of elasticity, with its own metrics, beside its own solvers at their default resolution where
these are installed. pip install "cosseratbench[all]" "mujoco<4"; python benchmarks/cosseratbench_motion.py
"""

import statistics
import sys
import time
import warnings
from importlib import import_module
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

import ksd

PIECES, STEP, REPEATS = 6, 2e-3, 5
RHO = 1.0
"""No damping by the method: the swing must keep its size."""


def cable(rod: Any, gravity: float, push: np.ndarray) -> ksd.Mechanism:
    """A cable that hangs from a pin along -y, with line loads along x between PIECES + 1 values push [N/m]."""
    scene = ksd.Mechanism("cable", plane="xy")
    hub, tip = scene.links("hub", "tip")
    scene.pin(scene.ground, hub, at=(0, 0, 0))
    stuff = ksd.Material(
        E=rod.material.youngs_modulus, G=rod.material.shear_modulus, density=rod.material.density
    )
    leaf = scene.leaf(
        hub,
        tip,
        start=(0, 0, 0),
        end=(0, -rod.length, 0),
        section=ksd.circle(2.0 * rod.radius),
        material=stuff,
    )
    s = np.linspace(0.0, rod.length, PIECES + 1)
    for k in range(PIECES):
        if k:
            scene.point(leaf, s[k], name=f"p{k}")
        ends = {"force": (push[k], 0, 0), "to": (push[k + 1], 0, 0)}
        scene.line_load(leaf, **ends, start=s[k], end=s[k + 1], name=f"q{k}")
    scene.gravity = (0, -gravity, 0)
    return scene


class Ksd:
    """Adapter to cosseratbench: one rod that hangs from a pin in a plane, without contact or loads."""

    name = "ksd"
    capabilities: frozenset[Any] = frozenset()

    def run(self, scenario: Any, *, n_elements: int, n_frames: int) -> Any:
        """The trajectory; raises NotImplementedError for other scenarios."""
        from cosseratbench.scenario import EndCondition
        from cosseratbench.trajectory import Trajectory

        rod, g = scenario.rods[0], -scenario.gravity[2]
        ends = rod.start, rod.end
        if (
            len(scenario.rods) > 1
            or ends != (EndCondition.PINNED, EndCondition.FREE)
            or rod.loads
            or scenario.obstacles
        ):
            raise NotImplementedError("one rod on a pin, without loads and obstacles")
        start = np.asarray(rod.centerline)
        # it is held where it starts by forces in proportion to mass and displacement, as in a mode, and then let go
        along, knots = np.asarray(rod.rest_arc_length), np.linspace(0.0, rod.length, PIECES + 1)
        hats = np.array([np.interp(along, knots, one) for one in np.eye(PIECES + 1)]).T
        aside = np.linalg.lstsq(hats, start[:, 0])[0]
        push, reach = rod.material.density * rod.area * g / rod.length * aside, start[-1, 0]
        for _ in range(2):
            scene = cable(rod, g, push)
            push = push * reach / ksd.solve(scene).displacement("tip", at=(0, -rod.length, 0))[0]
        frames, until = np.linspace(0.0, scenario.duration, n_frames), scenario.duration
        let_go = {f"q{k}": ksd.Step(0.0, start=1.0) for k in range(PIECES)}
        history = ksd.simulate(cable(rod, g, push), until, dt=STEP, rho=RHO, loads=let_go)
        at = np.rint(frames / until * (len(history.t) - 1)).astype(int)
        names = ["hub", *(f"p{k}" for k in range(1, PIECES)), "tip"]
        s = np.linspace(0.0, rod.length, PIECES + 1)
        places = np.array([history[n].at((0, -x, 0)).position[at] for n, x in zip(names, s, strict=True)])
        x, y, z = CubicSpline(s, places)(np.linspace(0.0, rod.length, n_elements + 1)).T
        positions = np.stack([x, z, y], axis=-1)
        normal = np.broadcast_to(np.asarray(rod.normal, float), (n_frames, n_elements, 3))
        return Trajectory(history.t[at], (positions,), (normal,))


def main() -> None:
    """A table of errors and wall times."""
    try:
        from cosseratbench.experiments.pendulum import pendulum
    except ImportError:
        sys.exit("cosseratbench is not installed: pip install 'cosseratbench[all]' 'mujoco<4'")
    solvers: list[Any] = [Ksd()]
    for room, name in (("pyelastica", "PyElasticaSolver"), ("mujoco", "MuJoCoSolver")):
        try:
            solvers.append(getattr(import_module(f"cosseratbench.solvers.{room}"), name)())
        except ImportError:
            print(f"{room} is not installed")
    sizes = {"n_elements": pendulum.n_elements, "n_frames": pendulum.n_frames}
    print("| E [Pa] | solver | period error | amplitude change | wall [s] |\n|---:|---|---:|---:|---:|")
    warnings.simplefilter("ignore", ksd.SceneWarning)
    for E in pendulum.parameters[0].values:
        scenario = pendulum.scenario_for(youngs_modulus=E)
        for solver in solvers:
            times: list[float] = []
            for _ in range(REPEATS + 1 if solver.name == "ksd" else 1):
                begin = time.perf_counter()
                found = solver.run(scenario, **sizes)
                times.append(time.perf_counter() - begin)
            wall = statistics.median(times[1:] or times)
            errors = [metric(scenario, found) for metric in pendulum.metrics.values()]
            print(f"| {E:g} | {solver.name} | {errors[0]:.1e} | {errors[1]:.1e} | {wall:.2f} |", flush=True)


if __name__ == "__main__":
    main()
