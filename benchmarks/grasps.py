"""Random grasps in the plane and in space: balance, complementarity and friction by a check that shares no code with the
solver.

In the plane an object (disc or polygon) is driven along random paths of 12 poses against one or two fingers on random leaf
springs with flat faces or polygons, friction 0 to .8; in space a ball, or a block with four feet, along paths of 6 against
one to four fingers with flat pads, knobs, or the surfaces of their own leaf springs. Contacts open, close, stick, slip and
reverse. At every pose the forces of contacts, leaf springs and drives must balance, forces must be within the cone, and
outlines may not overlap.
Run: python benchmarks/grasps.py [--count N] [--space N]
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


def grasp_in_space(seed: int) -> tuple[ksd.Mechanism, list[dict[str, float]]]:
    """A random scene in space and a random path of its object: a ball, or a block on four feet over one pad."""
    rng = np.random.default_rng(1000 + seed)
    scene, count = ksd.Mechanism("grasp in space"), int(rng.integers(1, 5))
    friction, held = rng.uniform(0, 0.8) if seed % 4 else 0.0, scene.link("object")
    radius, is_block = rng.uniform(6e-3, 12e-3), seed % 3 == 0
    for k in range(1 if is_block else count):
        # fingers around the object, along x, each with its surface towards it
        angle = 2 * np.pi * (k + rng.uniform(-0.1, 0.1)) / count
        out, finger = np.array([0.0, np.cos(angle), np.sin(angle)]), scene.link(f"finger{k}")
        kind = 0 if is_block else int(rng.integers(3))
        gap = rng.uniform(0.4e-3, 1.5e-3)
        section = ksd.rectangle(rng.uniform(0.3e-3, 0.8e-3), 0.01)
        words: dict[str, Any] = {
            "section": section,
            "material": STEEL,
            "width_axis": np.cross((1, 0, 0), out),
        }
        height = (2e-3, 3e-3, 0.5 * section.thickness)[kind]
        base = CENTRE - np.array([0.06, 0, 0]) - (radius + gap + height) * out
        tip = base + np.array([0.09 if kind == 2 else 0.05, 0, 0])
        leaf = scene.leaf("ground", finger, start=base, end=tip, name=f"blade{k}", **words)
        own: Any = leaf
        if kind == 0:
            tilt = out + np.array([0.0 if is_block else rng.uniform(-0.2, 0.2), 0, 0])
            own = scene.surface(
                finger, ksd.shapes.wall(), at=base + np.array([0.06, 0, 0]) + 2e-3 * out, axis=tilt
            )
        elif kind == 1:
            own = scene.surface(finger, ksd.shapes.ball(3e-3), at=base + np.array([0.06, 0, 0]))
        if is_block:
            across = np.cross((1, 0, 0), out)
            for j, (a, b) in enumerate(((-1, -1), (1, -1), (1, 1), (-1, 1))):
                foot = CENTRE + 6e-3 * a * np.array([1.0, 0, 0]) + 6e-3 * b * across - radius * out
                point = scene.surface(held, ksd.shapes.point(), at=foot, name=f"foot{j}")
                scene.contact(own, point, friction=friction, name=f"c{j}")
        else:
            outline = scene.surface(held, ksd.shapes.ball(radius), at=CENTRE, name=f"outline{k}")
            scene.contact(own, outline, friction=friction, name=f"c{k}")
    for along in "xyz":
        scene.actuate(held, along=along, at=CENTRE, name=along)
        scene.support(held, about=along)
    # first against the finger that was made last
    program, place = [], -3e-3 * out
    for _ in range(6):
        place = place + rng.uniform(-1, 1, 3) * (1.5e-3, 4e-3, 4e-3)
        program.append(dict(zip("xyz", place.tolist(), strict=True)))
    return scene, program


def errors(scene: Any, pose: Any) -> tuple[float, float, float, float]:
    """Largest imbalance of force, and of moment over 0.1 m, and of the cone [N]; overlap [m]; and the largest force [N]."""
    interfaces, forces, none = pose.interface_forces().rows, pose.forces, np.zeros(3)
    rows = [(r.link, r.force, r.moment, r.point) for r in interfaces]
    # what acts on a leaf spring: its ends, and contact along it
    rows += [(r.name, -r.force, -r.moment, r.point) for r in interfaces]
    at = pose.displacement("object", CENTRE) + CENTRE
    push = np.array([forces["x"], forces["y"], forces.get("z", 0.0)])
    rows.append(("object", push, np.array([0, 0, forces.get("turn", 0.0)]), at))
    owner = {leaf.name: leaf.name for leaf in scene.leaves} | {s.name: s.link for s in scene.surfaces}
    cone, overlap = 0.0, 0.0
    for name, c in pose.contacts.items():
        contact = next(x for x in scene.contacts if name.split(",")[0] == x.name)
        rows += [(owner[contact.b], c.force, none, c.place), (owner[contact.a], -c.force, none, c.place)]
        cone = max(cone, np.linalg.norm(c.T) - contact.friction * c.N, -c.N, abs(c.N * c.gap) / 1e-2)
        overlap = max(overlap, -c.gap)
    worst = 0.0
    for body in (*scene.links[1:], *(leaf.name for leaf in scene.leaves)):
        F = sum((r[1] for r in rows if r[0] == body), none)
        M = sum((r[2] + np.cross(r[3] - at, r[1]) for r in rows if r[0] == body), none)
        # supports hold rotations of the object in space
        turns = 0.0 if scene.plane is None and body == "object" else np.abs(M).max()
        worst = max(worst, np.abs(F).max(), turns / 0.1)
    return float(worst), float(cone), float(overlap), max(float(np.linalg.norm(r[1])) for r in rows)


def walks(make: Any, count: int) -> dict[str, Any]:
    """Walk `count` scenes, check every pose, and count."""
    poses, whole, stops, worst = 0, 0, [], np.zeros(3)
    for seed in range(count):
        mechanism, program = make(seed)
        try:
            with np.errstate(all="ignore"):
                walk = ksd.walk(mechanism, program, strict=False)
        except ksd.KsdError as error:
            stops.append(f"{seed}: {error}")
            continue
        found = np.array([errors(mechanism.scene(), pose) for pose in walk]).max(axis=0)
        worst = np.maximum(worst, found[:3] / (max(found[3], 1e-6), max(found[3], 1e-6), 1.0))
        poses, whole = poses + len(walk), whole + (len(walk) == len(program))
        stops += [f"{seed}: {walk.stop}"] * bool(walk.stop)
    worst_by_name = dict(
        zip(("balance", "cone and complementarity", "overlap_m"), worst.tolist(), strict=True)
    )
    print(f"{whole} of {count} walked to the end, {poses} poses; worst {worst_by_name}", *stops, sep="\n")
    return {
        "grasps": count,
        "walked to the end": whole,
        "poses": poses,
        "stops": stops,
        "worst": worst_by_name,
    }


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Walk, check, print and write the counts."""

    def more(parser: Any) -> None:
        parser.add_argument("--count", type=int, default=300)
        parser.add_argument("--space", type=int, default=100)

    options = parse_options(__doc__ or "", argv, more)
    counts = (10, 5) if options.quick else (options.count, options.space)
    found: dict[str, Any] = {"machine": machine()}
    print(machine_line(found["machine"]))
    for where, make, count in (("plane", grasp, counts[0]), ("space", grasp_in_space, counts[1])):
        found[where] = walks(make, count)
    write_json(found, options.out / "grasps.json")
    return found


if __name__ == "__main__":
    main()
