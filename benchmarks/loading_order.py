"""Whether the compression of leaf springs shows where the order of loads and drives decides.

    python benchmarks/loading_order.py [--quick] [--out FOLDER]

Random planar mechanisms of four kinds (guides of three unequal leaf springs, two stages in series, a pivot with a heavy arm,
three leaf springs in a row), with weight in a random direction, one drive, a stroke up to .3 of a leaf spring. Each is
solved with drives and loads together, and followed by arc length in both orders. Tabulated: trusted answers whose orders end
apart, or meet a singular point on one way, by the compression over pi^2 EI / L^2 (`ksd.solvers.loading_order.compression`);
and the share of scenes that is followed at several bounds. Prints the table, writes loading_order.json.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from common import machine, parse_options, write_json

import ksd
from ksd.solvers import loading_order
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.load_steps import state_difference

STEEL = ksd.Material(E=200e9, nu=0.3, density=7800)
MESH = ksd.Mesh(orders=(3, 2, 7), points=12)
BOUNDS = (0.5, 0.8, 1.5, 3.0)


def random_scene(rng: np.random.Generator) -> tuple[ksd.Mechanism, float]:
    """A mechanism with one drive "d", and its value [m or rad]."""
    kind, thickness = int(rng.integers(4)), float(rng.choice([0.2e-3, 0.3e-3, 0.5e-3]))
    mass, turn = float(rng.choice([0.01, 0.05, 0.3, 1.0, 3.0])), rng.uniform(0, 2 * math.pi)
    stroke = float(rng.uniform(0.02, 0.3) * 0.08 * rng.choice([-1, 1]))
    m = ksd.Mechanism(("guide", "series", "pivot", "row")[kind])
    m.gravity = (9.81 * math.cos(turn), 9.81 * math.sin(turn), 0)
    words: dict[str, Any] = {
        "section": ksd.rectangle(thickness, 0.02), "material": STEEL, "width_axis": "z",
    }  # fmt: skip
    lines: tuple[tuple[Any, ...], ...]
    along = "x" if rng.random() < 0.7 else "y"

    def body(name: str, weight: float, x: float, y: float) -> ksd.Link:
        return m.link(name, mass=weight, inertia=(1e-4,) * 3, at=(x, y, 0))

    if kind == 0:
        stage = body("stage", mass, 0, 0.1)
        for x, length in zip(
            np.array((-0.03, 0.0, 0.03)) + rng.uniform(-0.01, 0.01, 3), rng.uniform(0.06, 0.1, 3), strict=True
        ):
            m.leaf("ground", stage, start=(x, 0.1 - length, 0), end=(x, 0.1, 0), **words)
        m.actuate(stage, along="x", at=(0, 0.1, 0), name="d")
        return m, stroke
    if kind == 1:
        stage, middle = body("stage", mass, 0, 0.1), body("middle", mass / 5, 0.05, 0.05)
        lines = (
            ("ground", middle, (0, 0), (0, 0.08 * rng.uniform(0.7, 1))), ("ground", middle, (0.04, 0), (0.04, 0.08)),
            (middle, stage, (0.04, 0.08), (0.1, 0.09)), ("ground", stage, (0.12, 0), (0.12, 0.09)),
        )  # fmt: skip
        driven, at, stroke = (middle if rng.random() < 0.5 else stage), (0.04, 0.08, 0), 0.5 * stroke
    elif kind == 2:
        arm = body("arm", mass, rng.uniform(-0.05, 0.05), rng.uniform(-0.2, 0.3))
        m.leaf("ground", arm, start=(-0.03, 0, 0), end=(0.03, 0.06, 0), **words)
        m.leaf("ground", arm, start=(0.03, 0, 0), end=(-0.03, 0.06, 0), **words)
        m.actuate(arm, about="z", name="d")
        return m, 25 * stroke
    else:
        one, two = body("one", mass / 5, 0.05, 0), body("two", mass / 5, 0.1, 0.02)
        lines = (
            ("ground", one, (0, 0), (0.05, 0)), (one, two, (0.06, 0), (0.1, 0.02)),
            (two, "ground", (0.11, 0.02), (0.17, rng.uniform(0, 0.03))),
        )  # fmt: skip
        driven, at, stroke = (one if rng.random() < 0.5 else two), (0.06, 0, 0), 0.3 * stroke
    for a, b, start, end in lines:
        m.leaf(a, b, start=(*start, 0), end=(*end, 0), **words)
    m.actuate(driven, along=along, at=at, name="d")
    return m, stroke


def measure(count: int, seed: int) -> dict[str, Any]:
    """Compression of every trusted answer, and which of them the order decides."""
    rng, compressions, apart, singular = np.random.default_rng(seed), [], [], []
    for _ in range(count):
        scene, stroke = random_scene(rng)
        model = ksd.compile_scene(scene, mesh=MESH)
        try:
            pose = solve_conventional(model, {"d": stroke})
        except ksd.ConvergenceError:
            continue
        if not pose.stable or pose.doubts:
            continue
        pressed = loading_order.compression(model, pose.motion)
        compressions.append(pressed)
        ends = [
            loading_order.follow_in_order(model, model.targets({"d": stroke}), o) for o in ("loads", "drives")
        ]
        if any(path.state is None or path.obstacle for path in ends):
            singular.append(pressed)
        elif max(state_difference(model, pose.motion, path.state) for path in ends if path.state) > 1e-6:
            apart.append(pressed)
    followed = {str(bound): float(np.mean(np.array(compressions) > bound)) for bound in BOUNDS}
    return {
        "answers": len(compressions),
        "apart": sorted(apart),
        "singular": sorted(singular),
        "followed": followed,
    }


def main(arguments: Sequence[str] | None = None) -> dict[str, Any]:
    """Run the comparison; returns what is written."""
    options = parse_options(__doc__ or "", arguments)
    # also compressions below the bound of the solver
    loading_order.MAX_COMPRESSION = 1e-6
    found = {"machine": machine(), **measure(40 if options.quick else 700, 1)}
    print(f"{found['answers']} trusted answers")
    for name, told in (("apart", "orders end apart"), ("singular", "a way meets a singular point")):
        values = found[name]
        print(f"{told}: {len(values)}, at a compression of {values[0] if values else math.nan:.2f} at least")
    print(
        "share followed:",
        ", ".join(f"above {bound}: {share:.0%}" for bound, share in found["followed"].items()),
    )
    write_json(found, options.out / "loading_order.json")
    return found


if __name__ == "__main__":
    main()
