"""Random grasps in the plane: balance, complementarity and friction by a check that shares no code with the solver.

An object (disc or polygon) is driven along random paths of 12 poses against one or two fingers on random leaf springs with
flat faces or polygons, friction 0 to .8; contacts open, close, stick, slip and reverse. At every pose the forces of
contacts, leaf springs and drives must balance, forces must be within the cone, and outlines may not overlap.
Run: python benchmarks/grasps.py [--count N]
"""

from __future__ import annotations

from typing import Any

import numpy as np
from common import STEEL, machine, machine_line, parse_options, write_json

import ksd

CENTRE = np.array([0.07, 0.03, 0.0])


def polygon(rng: np.random.Generator, radius: float, count: int) -> Any:
    """A convex polygon of corners on a circle."""
    angle = (np.arange(count) + rng.uniform(-0.3, 0.3, count)) * 2 * np.pi / count
    return ksd.shapes.polygon(np.column_stack([np.cos(angle), np.sin(angle)]) * radius)


def grasp(seed: int) -> tuple[ksd.Mechanism, list[dict[str, float]]]:
    """A random scene and a random path of its object."""
    rng = np.random.default_rng(seed)
    scene = ksd.Mechanism("grasp", plane="xy")
    friction, held = rng.uniform(0, 0.8) if seed % 4 else 0.0, scene.link("object")
    radius = rng.uniform(5e-3, 12e-3)
    shape = polygon(rng, radius, int(rng.integers(3, 7))) if seed % 3 else ksd.shapes.disc(radius)
    for k in range(int(rng.integers(1, 3))):
        side, finger = 2 * k - 1, scene.link(f"finger{k}")
        y = CENTRE[1] + side * (radius + 5e-3)
        blade: dict[str, Any] = {
            "section": ksd.rectangle(rng.uniform(0.2e-3, 0.6e-3), 0.01),
            "material": STEEL,
        }
        for d in (0.0, side * 20e-3)[: int(rng.integers(1, 3))]:
            scene.leaf("ground", finger, start=(0, y + d, 0), end=(0.06, y + d, 0), **blade)
        tilt = rng.uniform(-0.3, 0.3)
        if rng.uniform() < 0.6:
            axis = (np.sin(tilt), -side * np.cos(tilt), 0)
            face = scene.surface(finger, ksd.shapes.wall(), at=(CENTRE[0], y, 0), axis=axis)
        else:
            at = (CENTRE[0] + rng.uniform(-5e-3, 5e-3), y, 0)
            face = scene.surface(finger, polygon(rng, 4e-3, int(rng.integers(3, 6))), at=at)
        outline = scene.surface(held, shape, at=CENTRE, toward=(1, 0, 0), name=f"outline{k}")
        scene.contact(face, outline, friction=friction, name=f"c{k}")
    for along in "xy":
        scene.actuate(held, along=along, at=CENTRE, name=along)
    scene.actuate(held, about="z", name="turn")
    program, place = [], np.zeros(2)
    for _ in range(12):
        place = place + rng.uniform(-1, 1, 2) * (1.5e-3, 3e-3)
        program.append({"x": place[0], "y": place[1], "turn": rng.uniform(-0.15, 0.15)})
    return scene, program


def errors(scene: Any, pose: Any) -> tuple[float, float, float]:
    """Largest imbalance of force and of moment over 0.1 m, and of the cone, over the largest force; and overlap [m]."""
    owner = {s.name: s.link for s in scene.surfaces}
    rows = [(r.link, r.force, r.moment, r.point) for r in pose.interface_forces().rows]
    forces = pose.forces
    at = pose.displacement("object", CENTRE) + CENTRE
    rows.append(("object", np.array([forces["x"], forces["y"], 0.0]), np.array([0, 0, forces["turn"]]), at))
    cone, overlap, none = 0.0, 0.0, np.zeros(3)
    for name, c in pose.contacts.items():
        contact = next(x for x in scene.contacts if name.split(",")[0] == x.name)
        rows += [(owner[contact.b], c.force, none, c.place), (owner[contact.a], -c.force, none, c.place)]
        cone = max(cone, np.linalg.norm(c.T) - contact.friction * c.N, -c.N, abs(c.N * c.gap) / 1e-2)
        overlap = max(overlap, -c.gap)
    largest = max((np.linalg.norm(c.force) for c in pose.contacts.values()), default=0.0)
    largest = max(largest, *(np.linalg.norm(r[1]) for r in rows), 1e-6)
    worst = 0.0
    for link in scene.links[1:]:
        F = sum((r[1] for r in rows if r[0] == link), none)
        M = sum((r[2] + np.cross(r[3] - at, r[1]) for r in rows if r[0] == link), none)
        worst = max(worst, np.abs(F).max() / largest, np.abs(M).max() / 0.1 / largest)
    return float(worst), float(cone / largest), float(overlap)


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Walk, check, print and write the counts."""
    options = parse_options(__doc__ or "", argv, lambda p: p.add_argument("--count", type=int, default=300))
    count = 10 if options.quick else options.count
    poses, whole, stops, worst = 0, 0, [], np.zeros(3)
    for seed in range(count):
        mechanism, program = grasp(seed)
        try:
            with np.errstate(all="ignore"):
                walk = ksd.walk(mechanism, program, strict=False)
        except ksd.KsdError as error:
            stops.append(f"{seed}: {error}")
            continue
        for pose in walk:
            worst = np.maximum(worst, errors(mechanism.scene(), pose))
        poses, whole = poses + len(walk), whole + (len(walk) == len(program))
        stops += [f"{seed}: {walk.stop}"] * bool(walk.stop)
    found: dict[str, Any] = {
        "machine": machine(), "grasps": count, "walked to the end": whole, "poses": poses, "stops": stops,
        "worst": dict(zip(("balance", "cone and complementarity", "overlap_m"), worst.tolist(), strict=True)),
    }  # fmt: skip
    write_json(found, options.out / "grasps.json")
    print(machine_line(found["machine"]))
    print(f"{whole} of {count} walked to the end, {poses} poses; worst {found['worst']}", *stops, sep="\n")
    return found


if __name__ == "__main__":
    main()
