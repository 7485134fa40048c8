"""Motion in time: cost of a step against a static solve of the same scene, with the inertia of leaf springs and with their
mass at their ends, in arms of 3 to 100 joints, and of the shipped arm.

Steps are those of a trace, without what is said about it; times are of one thread, medians of five. What is compared is
measured in turns, and ratios are medians of those of the turns.
python benchmarks/motion.py
"""

import statistics
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np

import ksd

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

REPEATS, STEPS = 5, 60
UNTIL = 0.2
"""End [s] of the motions whose places are compared."""


def stepper(scene, dt, freed=(), spatial=False, mass_at_ends=False, **words):
    """A function that takes steps of `dt` and returns the thread time [s] and the Newton iterations of one."""
    from ksd.scene.simulation import Simulation
    from ksd.solvers.mass_at_ends import with_mass_at_ends
    from ksd.solvers.motion import Motion
    from ksd.solvers.moving_model import moving_model
    from ksd.solvers.time_steps import generalised_alpha

    frozen = with_mass_at_ends(scene.scene()) if mass_at_ends else scene.scene()
    model, step = ksd.compile_scene(frozen), generalised_alpha(dt, 0.8)
    moving = moving_model(model, freed, spatial=spatial)
    motion = Motion(
        moving, Simulation(until=1.0, dt=dt, **words), model.rest, dict.fromkeys(model.drive_names, 0.0)
    )
    motion.take(step, STEPS)

    def take():
        start = time.thread_time()
        taken, _ = motion.take(step, STEPS)
        return (time.thread_time() - start) / len(taken.t), float(taken.scalars[:, 7].mean())

    return take


def solver(scene, freed=(), spatial=False):
    """A function that returns the thread time [s] of a static kernel solve from a near state in which the loads differ by
    1 %."""
    from ksd.model.arrays import make_workspace
    from ksd.model.newton import solve_equilibrium
    from ksd.solvers.moving_model import moving_model

    moving = moving_model(ksd.compile_scene(scene.scene()), freed, spatial=spatial)
    plane, model = moving.plane, moving.model
    arrays, rest = (model.arrays, model.rest) if plane is None else (plane.arrays, model.rest)
    state, work, target = rest.copy(), make_workspace(arrays), np.zeros(len(rest.multiplier))
    for factor in np.linspace(0.1, 1.0, 10):
        solve_equilibrium(arrays, state, target, factor, work, 1e-8, 20, 1.0, np.inf)

    def solve():
        start = time.thread_time()
        for k in range(200):
            solve_equilibrium(arrays, state, target, 1.0 + 0.01 * (k % 2), work, 1e-8, 20, 1.0, np.inf)
        return (time.thread_time() - start) / 200

    return solve


def places_off(scene, link, until, words):
    """Largest difference of places of a link with the mass of leaf springs at their ends, over its stroke."""
    words = {"dt": 1e-3, "start": "undeformed", **words}
    own, other = (ksd.simulate(scene, until, mass_at_ends=m, **words)[link].position for m in (False, True))
    return np.abs(other - own).max() / np.abs(own - own[0]).max()


def costs():
    """A table of steps of 1 ms against static solves."""
    from motion_scenes import HEIGHT, four_hinges, guide, strip

    # statics knows leaf springs that are bent in their plane only, and those in the same state as another
    lifted = four_hinges()
    lifted.load("top", force=(0, 0, 20), at=(0, HEIGHT, 0), name="lift")
    swung: dict[str, Any] = {"loads": {"push": ksd.Ramp(0.1)}, "drives": {"top": None}}
    cases: tuple[Any, ...] = (
        ("parallel guide", guide(), "stage", (), False, {"loads": {"push": ksd.Ramp(0.02)}}),
        ("fourbar", four_hinges(), "top", ("top",), False, swung),
        ("strip in space", strip(), "tip", (), True, {}),
        ("fourbar in space", four_hinges(), "top", ("top",), True, swung),
        ("fourbar in space, pushed out of its plane", lifted, "top", ("top",), True, swung),
    )
    print(
        "| scene | static solve [us] | step [us] | iterations | ratio | with mass at ends [us] | iterations | ratio | "
        f"places off, {1e3 * UNTIL:g} ms |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for name, scene, link, freed, spatial, words in cases:
        still = solver(scene, spatial=spatial)
        kinds = [stepper(scene, 1e-3, freed, spatial, m, **words) for m in (False, True)]
        turns = [(still(), *kinds[0](), *kinds[1]()) for _ in range(REPEATS)]
        solve, step, _, light, _ = (statistics.median(column) for column in zip(*turns, strict=True))
        n, m = (statistics.mean(turn[k] for turn in turns) for k in (2, 4))
        ratios = [statistics.median(turn[k] / turn[0] for turn in turns) for k in (1, 3)]
        off = places_off(scene, link, UNTIL, words)
        print(
            f"| {name} | {1e6 * solve:.0f} | {1e6 * step:.0f} | {n:.2f} | {ratios[0]:.2f} | {1e6 * light:.0f} | {m:.2f} | "
            f"{ratios[1]:.2f} | {off:.1e} |"
        )


def arm(joints):
    """An arm of cross flexures in the plane, with a force across at its end."""
    scene = ksd.Mechanism("arm", plane="xy")
    before, steel = scene.ground, ksd.Material(E=200e9, nu=0.3, density=7800)
    for k in range(joints):
        link = scene.link(f"l{k}", mass=0.05, inertia=(1e-5, 1e-5, 1e-5), at=(0.1 * k + 0.08, 0, 0))
        for y in (-0.02, 0.02):
            start, end, section = (0.1 * k, y, 0), (0.1 * k + 0.04, -y, 0), ksd.rectangle(3e-4, 1e-2)
            scene.leaf(before, link, start=start, end=end, section=section, material=steel)
        before = link
    scene.load(before, force=(0, 0.05, 0), at=(0.1 * joints, 0, 0), name="push")
    return scene


def lengths():
    """A table of the cost of a step for each leaf spring."""
    print("\n| joints | step [us] | iterations | per leaf spring [us] |\n|---:|---:|---:|---:|")
    for joints in (3, 10, 30, 100):
        take = stepper(arm(joints), 1e-3, loads={"push": ksd.Ramp(0.02)})
        times, counts = zip(*(take() for _ in range(REPEATS)), strict=True)
        step, iterations = statistics.median(times), statistics.mean(counts)
        print(f"| {joints} | {1e6 * step:.0f} | {iterations:.2f} | {1e6 * step / joints / 2:.1f} |")


def shipped_arm():
    """The shipped arm of three joints and 90 leaf springs with links of 500 g, let go under a force at its end."""
    scene, _, _ = ksd.load_scene("arm")
    for link, at in zip(
        scene.scene().links[1:], ((0.075, 0, 0), (0.24, 0, 0.14), (0.42, 0, 0.14)), strict=True
    ):
        scene.mass(link, mass=0.5, inertia=(1e-3, 1e-3, 1e-3), at=at)
    scene.load("third", force=(0, 5, 5), at=(0.51, 0, 0.05), name="push")
    return scene.scene()


def ends():
    """A table of the arm and of the fourbar in space by the inertia of leaf springs, and with their mass at their ends."""
    from motion_scenes import HEIGHT, four_hinges

    lifted = four_hinges()
    lifted.load("top", force=(0, 0, 20), at=(0, HEIGHT, 0), name="lift")
    cases: tuple[Any, ...] = (
        ("arm of 90 leaf springs", shipped_arm(), "third", dict.fromkeys("xyz"), 0.02),
        ("fourbar", four_hinges(), "top", {"top": None}, 0.1),
        ("fourbar in space, pushed out of its plane", lifted, "top", {"top": None}, 0.1),
    )
    print(
        "\n| scene | step [us] | with mass at ends [us] | ratio | simulated time / CPU | places off, over the stroke |"
    )
    print("|---|---|---|---|---|---|")
    for name, scene, link, drives, ramp in cases:
        words: dict[str, Any] = {"loads": {"push": ksd.Ramp(ramp)}, "drives": drives, "dt": 1e-3}
        spent: tuple[list[float], list[float]] = [], []
        found: list[Any] = [None, None]
        for n in range(2 * (REPEATS + 1)):
            took = []
            for until in (0.02, 0.1):
                start = time.thread_time()
                found[n % 2] = ksd.simulate(scene, until, mass_at_ends=bool(n % 2), **words)[link].position
                took.append(time.thread_time() - start)
            spent[n % 2].append((took[1] - took[0]) / 80)
        whole, light = (statistics.median(times[1:]) for times in spent)
        off = np.abs(found[1] - found[0]).max() / np.abs(found[0] - found[0][0]).max()
        print(
            f"| {name} | {1e6 * whole:.0f} | {1e6 * light:.0f} | {whole / light:.1f} | {1e-3 / light:.2f} | {off:.1e} |"
        )


if __name__ == "__main__":
    warnings.simplefilter("ignore", ksd.SceneWarning)
    costs()
    lengths()
    ends()
