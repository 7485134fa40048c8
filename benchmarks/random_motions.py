"""Random motions in the plane and in space: each ends at `until` or stops with a reason, holds numbers only, and loses no
more energy than it says.

A scene is a chain of up to four bodies on random leaf springs, hinges, second leaf springs back to ground, springs and
dampers, or one with known values; loads jump, ramp and swing, drives move or are let go, the base shakes, bodies start with
speeds; steps of 1e-5 to 1e-1 s. Kinetic energies are compared with those of the bodies' speeds, strain energies with those
of poses where springs have no mass; the work of loads is that of the balance.

    python benchmarks/random_motions.py [number of motions] [first seed]
"""

import sys
import time
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

import ksd

sys.path[:0] = [str(Path(__file__).parent.parent / "tests")]

COUNT, FIRST = 200, 1000
GAINED = 0.01
"""Energy that appears from nowhere, over the largest change of a part of the balance, that is counted."""
Rng = np.random.Generator


def power_of_ten(rng: Rng, low: float, high: float) -> float:
    """A number whose logarithm is uniform."""
    return float(10.0 ** rng.uniform(low, high))


def random_chain(rng: Rng) -> ksd.Mechanism:
    """Random bodies on random leaf springs, with a force that bends the softest of these by up to its length."""
    is_planar = rng.random() < 0.5
    scene = ksd.Mechanism("random", plane="xy" if is_planar else None)
    E = power_of_ten(rng, 9, 11.3)
    density = power_of_ten(rng, 3, 3.9) if rng.random() < 0.7 else None
    loss = 0.02 if density is not None and rng.random() < 0.3 else None
    stuff = ksd.Material(E=E, nu=0.3, density=density, loss_factor=loss)
    before, at, softest = scene.ground, np.zeros(3), np.inf
    words: dict[str, Any]

    def direction() -> Any:
        v = rng.normal(size=3) * (1.0, 1.0, 0.0 if is_planar else 1.0)
        return v / np.linalg.norm(v)

    count = int(rng.integers(1, 5))
    for k in range(count):
        along, L = direction(), power_of_ten(rng, -1.5, -0.5)
        t = L * rng.uniform(0.004, 0.02)
        w = t * rng.uniform(5.0, 30.0)
        end = at + L * along
        centre = end + 0.3 * L * direction()
        J = np.sort(rng.uniform(0.4, 1.0, 3))
        J[2] = min(J[2], 0.95 * (J[0] + J[1]))
        mass = power_of_ten(rng, -2, 0.5)
        link = scene.link(f"l{k}", mass=mass, inertia=tuple(mass * (0.3 * L) ** 2 * J), at=centre)
        if k == 0 and rng.random() < 0.25:
            hinge = scene.pin if is_planar else scene.ball
            hinge(before, link, at=at)
        else:
            side = "z" if is_planar else tuple(np.cross(along, direction()))
            words = {"section": ksd.rectangle(t, w), "material": stuff, "width_axis": side}
            scene.leaf(before, link, start=at, end=end, **words)
            softest = min(softest, E * w * t**3 / 12.0 / L**2)
            if rng.random() < 0.3:
                shift = 0.5 * L * np.cross(along, (0, 0, 1) if is_planar else direction())
                scene.leaf(before, link, start=at + shift, end=end + shift, **words)
        before, at = link, end + (0.2 * L * direction() if rng.random() < 0.5 else 0.0)
    if not np.isfinite(softest) or rng.random() < 0.3:
        L, end = 0.1, at + 0.1 * direction()
        words = {
            "section": ksd.rectangle(5e-4, 1e-2),
            "material": stuff,
            "width_axis": "z" if is_planar else None,
        }
        scene.leaf(before, scene.ground, start=at, end=end, **words)
        softest = min(softest, E * 1e-2 * 5e-4**3 / 12.0 / L**2)
    if rng.random() < 0.3:
        scene.spring(
            scene.ground,
            before,
            start=at + 0.05 * direction(),
            end=at,
            stiffness=softest * rng.uniform(0.1, 10.0) / 0.1,
        )
    if rng.random() < 0.3:
        scene.damper(scene.ground, before, damping=power_of_ten(rng, -2, 1), along=direction(), at=at)
    if rng.random() < 0.5:
        scene.gravity = 9.81 * direction()
    if rng.random() < 0.4:
        scene.actuate(before, along=direction(), at=at, name="push")
    scene.load(before, force=softest * power_of_ten(rng, -2, 0.3) * direction(), at=at, name="random")
    return scene


def random_motion(rng: Rng) -> tuple[ksd.Mechanism, dict[str, Any]]:
    """A random scene, and words of a random motion of it."""
    from motion_scenes import four_hinges, guide, pendulum, pivot, rod, strip, wire

    if rng.random() < 0.3:
        scene = [guide, pivot, wire, pendulum, strip, rod, four_hinges][rng.integers(7)]()
        name = scene.scene().links[-1]
        force = rng.normal(size=3) * power_of_ten(rng, -2, 2) * (1.0, 1.0, 0.0 if scene.plane else 1.0)
        scene.load(name, force=force, at=(0.1, 0, 0), name="random")
    else:
        scene = random_chain(rng)
    dt = power_of_ten(rng, -5, -1)
    until = dt * float(rng.integers(3, 80))
    words: dict[str, Any] = {"dt": dt, "until": until, "rho": float(rng.choice([0.0, 0.5, 0.8, 1.0]))}
    delay = float(rng.uniform()) * until
    knots = (0.0, 0.0), (delay + dt, 1.0), (until + 2 * dt, -1.0)
    pulls = (
        ksd.Step(1.0), ksd.Step(1.0, delay=delay), ksd.Step(0.0, start=1.0), ksd.Ramp(until), ksd.TimeTable(knots),
        ksd.HalfSine(1.0, duration=delay + dt), ksd.Sine(1.0, frequency_Hz=rng.uniform(0.5, 10.0) / until),
    )  # fmt: skip
    words["loads"] = {"random": pulls[rng.integers(len(pulls))]}
    words["start"] = "undeformed" if rng.random() < 0.7 else "equilibrium"
    drives = [d.name for d in scene.scene().drives]
    if drives:
        stroke = float(rng.uniform(-0.02, 0.02))
        ways = (
            None,
            None,
            ksd.Cycloid(stroke, duration=until),
            ksd.Trapezoid(stroke, duration=until),
            ksd.Ramp(until, end=stroke),
        )
        words["drives"] = {drives[0]: ways[rng.integers(len(ways))]}
    axis = (1, 0, 0) if scene.plane else tuple(rng.normal(size=3))
    if rng.random() < 0.2:
        words["base"] = ksd.Shake(axis, ksd.HalfSine(power_of_ten(rng, 0, 2), duration=max(delay, dt)))
    if rng.random() < 0.2 and scene.scene().masses:
        turn = rng.normal(size=3) * (0.0, 0.0, 1.0) if scene.plane else rng.normal(size=3)
        words["speeds"] = {scene.scene().masses[-1].link: (*(0.3 * np.asarray(axis)), *turn)}
    if any(leaf.material.loss_factor for leaf in scene.scene().leaf_names().values()):
        words["damping_at"] = power_of_ten(rng, 0, 2)
    return scene, words


def faults_of(scene: ksd.Mechanism, words: dict[str, Any], history: ksd.History) -> list[str]:
    """What is wrong with a motion, in words."""
    trace, energy, found = history.trace, history.energy, []
    parts = {
        n: getattr(trace, n) for n in ("t", "x", "velocity", "acceleration", "drive_force", "drive_value")
    }
    parts |= {
        f"{n} energy": getattr(energy, n) for n in ("kinetic", "strain", "gravity", "work", "damped", "lost")
    }
    found += [f"{n} is not finite" for n, p in parts.items() if not np.isfinite(p).all()]
    if found:
        return found
    if not (trace.at_end or trace.stop):
        found.append("it ended early without a reason")
    if trace.at_end and abs(trace.t[-1] - words["until"]) > 1e-9 * words["until"]:
        found.append(f"it ended at {trace.t[-1]:g} s, not at {words['until']:g} s")
    if (np.diff(trace.t) <= 0.0).any():
        found.append("instants do not rise")
    level = max(float(np.ptp(getattr(energy, n))) for n in ("kinetic", "strain", "gravity", "work", "damped"))
    level = max(level, float(energy.kinetic.max()), float(np.abs(energy.strain).max()), 1e-12)
    # of the bodies alone, from places and speeds of their centres
    kinetic = np.zeros(len(trace.t))
    for mass in scene.scene().masses:
        if mass.link == "ground":
            continue
        v = history[mass.link].at(mass.at).velocity
        R = history[mass.link].rotation
        spin = np.einsum("kji,kj->ki", R, v[:, 3:])
        kinetic += 0.5 * mass.mass * (v[:, :3] ** 2).sum(1) + 0.5 * np.einsum(
            "ki,ij,kj->k", spin, np.asarray(mass.inertia), spin
        )
    is_massless = all(not leaf.material.density for leaf in scene.scene().leaf_names().values())
    off = energy.kinetic - kinetic
    # rates of orientation matrices that are no rotation cost a little
    if (off < -1e-3 * level).any() or (is_massless and (np.abs(off) > 1e-3 * level).any()):
        found.append(f"kinetic energy is off by {np.abs(off).max() / level:.1e}")
    for k in {len(trace.t) // 2, len(trace.t) - 1}:
        pose = history[float(trace.t[k])]
        own = sum(pose.strain_energy().values())
        # waves along leaf springs with mass are no part of a pose
        if is_massless and abs(own - energy.strain[k]) > 1e-6 * level:
            found.append(
                f"strain energy at {trace.t[k]:g} s is off by {abs(own - energy.strain[k]) / level:.1e}"
            )
    lost = float(np.abs(energy.lost).max())
    said = any("missing in the balance" in n or "came from nothing" in n for n in history.notes)
    if lost > 0.011 * level and not said:
        found.append(f"{lost / level:.2g} of the energy are lost and not said")
    return found


def run(seed: int) -> tuple[str, list[str], dict[str, Any]]:
    """How the motion of a seed ended ("end", "stop", "refused"), what is wrong with it, and facts on it."""
    scene, words = random_motion(np.random.default_rng(seed))
    until = words.pop("until")
    facts: dict[str, Any] = {"plane": scene.plane, "dt": words["dt"]}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ksd.SceneWarning)
        warnings.simplefilter("error", RuntimeWarning)
        try:
            history = ksd.simulate(scene, until, **words)
        except ksd.KsdError as error:
            return "refused", [], facts | {"reason": str(error)}
        except Exception as error:
            return "broken", [f"{type(error).__name__}: {error}"], facts
        try:
            faults = faults_of(scene, words | {"until": until}, history)
        except Exception as error:
            faults = [f"judging: {type(error).__name__}: {error}"]
    e = history.energy
    most = max(float(np.ptp(getattr(e, n))) for n in ("kinetic", "strain", "gravity", "work", "damped"))
    most = max(most, float(e.kinetic.max()), 1e-300)
    facts |= {"reason": history.stop, "halved": history.trace.halved, "gained": -float(e.lost.min()) / most}
    return ("end" if history.stop is None else "stop"), faults, facts


def main() -> None:
    """A line for every motion that did not end, and a table."""
    numbers = [int(a) for a in sys.argv[1:]]
    count, first = (*numbers, *(COUNT, FIRST)[len(numbers) :])
    ends: Counter[tuple[str, str]] = Counter()
    faulty, halved, gained, begin = 0, 0, [], time.process_time()
    for seed in range(first, first + count):
        end, faults, facts = run(seed)
        ends["plane" if facts["plane"] else "space", end] += 1
        halved += bool(facts.get("halved"))
        if facts.get("gained", 0.0) > GAINED:
            gained.append(seed)
        faulty += bool(faults)
        if end != "end" or faults:
            where = f"seed {seed}, {facts['plane'] or 'space'}, dt {facts['dt']:.1e} s"
            print(f"{where}: {end}; {facts.get('reason')}; {', '.join(faults)}", flush=True)
    print("\n| | ended | stopped with a reason | refused before it began | raised |\n|---|---|---|---|---|")
    for space in ("plane", "space"):
        print(
            f"| {space} |", " | ".join(str(ends[space, e]) for e in ("end", "stop", "refused", "broken")), "|"
        )
    print(
        f"\n{count} motions from seed {first} in {time.process_time() - begin:.0f} s; with faults {faulty}; steps halved in "
        f"{halved}; more than {100 * GAINED:g} % of the energy gained, and said, in {len(gained)}: {gained}"
    )


if __name__ == "__main__":
    main()
