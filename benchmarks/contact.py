"""Cost of stops, cables and contacts: prepared solves with closed and open ones over the solve without.

Compared are a guide under a force with an end stop, and jaws under the discs of a driven block, each with the same mechanism
without them. Asked: one closed part at most 2.5 times the solve without, along a leaf 3.5, four at most 6, open ones 2 %
and 2 us more. Batches, per case over prepared solves of it: of 1000 values of friction, 1000 places of the disc, and 1000
poses, with the scenes built, as a loop does that prepares each case, and with the building of scenes taken off, over a
solve by what is prepared already; asked: not slower. Thread time, that of batches of the process, all cases in turns.
Run: python benchmarks/contact.py
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from common import STEEL, machine, machine_line, parse_options, thread_us, write_json

import ksd
from ksd.units import mm

REPEATS = 400
BATCH, ROUNDS = 1000, 5
"""Cases of a batch, and how often it is repeated."""


def guide(word: str = "", *, high: float = 3 * mm, plane: str | None = "xy") -> ksd.Mechanism:
    """A parallel guide under 20 N across, alone or with a stop, or held by a drive."""
    scene = ksd.Mechanism("guide", plane=plane)
    stage = scene.link("stage")
    for i, y in enumerate((-30 * mm, 30 * mm)):
        scene.leaf(
            "ground", stage, start=(0, y, 0), end=(0.1, y, 0), width_axis="z", name=f"l{i}",
            section=ksd.rectangle(0.5 * mm, 20 * mm), material=STEEL,
        )  # fmt: skip
    scene.load(stage, force=(0, 20, 0), at=(0.1, 0, 0))
    if word == "stop":
        scene.stop(stage, along="y", at=(0.1, 0, 0), high=high, name="end")
    if word == "drive":
        scene.actuate(stage, along="y", at=(0.1, 0, 0), name="d")
    return scene


def jaws(count: int, *, friction: float = 0.0, touching: bool = True, shift: float = 0.0) -> ksd.Mechanism:
    """Jaws on parallel guides in a row, and a driven block on a leaf spring with a disc over each, or without discs.

    shift [m]: of the discs along their jaws.
    """
    scene = ksd.Mechanism("jaws", plane="xy")
    block = scene.link("block")
    blade: dict[str, Any] = {"section": ksd.rectangle(0.3 * mm, 10 * mm), "material": STEEL}
    scene.leaf("ground", block, start=(-0.1, 0.05, 0), end=(0, 0.05, 0), name="blade", **blade)
    scene.actuate(block, along="y", at=(0.07, 0.05, 0), name="y")
    for k in range(count):
        x, jaw = 0.1 * k, scene.link(f"jaw{k}")
        for y in (0.0, -20 * mm):
            scene.leaf("ground", jaw, start=(x, y, 0), end=(x + 0.06, y, 0), name=f"l{k} {y}", **blade)
        if touching:
            face = scene.surface(jaw, ksd.shapes.wall(), at=(x + 0.07, 5 * mm, 0), axis="y", name=f"face{k}")
            at = (x + 0.07 + shift, 10 * mm, 0)
            disc = scene.surface(block, ksd.shapes.disc(5 * mm), at=at, name=f"disc{k}")
            scene.contact(face, disc, friction=friction, name=f"c{k}")
    return scene


def finger(*, touching: bool = True) -> ksd.Mechanism:
    """A leaf spring under a driven disc, or alone."""
    scene = ksd.Mechanism("finger", plane="xy")
    tip, held = scene.links("tip", "held")
    blade: dict[str, Any] = {"section": ksd.rectangle(0.5 * mm, 10 * mm), "material": STEEL}
    scene.leaf("ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), name="leaf", **blade)
    scene.leaf("ground", held, start=(0, 0.1, 0), end=(0.06, 0.1, 0), name="other", **blade)
    scene.actuate(held, along="y", at=(0.06, 20.25 * mm, 0), name="y")
    if touching:
        disc = scene.surface(held, ksd.shapes.disc(20 * mm), at=(0.06, 20.25 * mm, 0))
        scene.contact("leaf", disc, name="c")
    return scene


def batches(count: int, rounds: int) -> dict[str, dict[str, float]]:
    """CPU times of a case [us] in batches of `count`, prepared, and in a loop that prepares each; medians of rounds.

    Of the process, since a batch solves in a thread of its own.
    """
    one, down = ksd.prepare(jaws(1, friction=0.3)), -2 * mm
    strokes = np.linspace(down, -1 * mm, count)
    ways: dict[tuple[str, str], Callable[[], Any]] = {
        ("poses", "batch"): lambda: ksd.batch(jaws(1, friction=0.3), y=strokes, threads=1),
        ("poses", "prepared"): lambda: [one(y=y) for y in strokes.tolist()],
    }

    def add(name: str, build: Callable[[float], ksd.Mechanism], values: np.ndarray) -> None:
        designs = [{"value": value} for value in values.tolist()]
        ways[name, "batch"] = lambda: ksd.batch(
            lambda value: build(value), designs=designs, y=down, threads=1
        )
        ways[name, "build"] = lambda: [build(value).scene() for value in values.tolist()]
        ways[name, "prepared"] = lambda: [one(y=down) for _ in designs]
        ways[name, "loop"] = lambda: [ksd.prepare(build(value))(y=down) for value in values.tolist()]

    add("friction values", lambda mu: jaws(1, friction=mu), np.linspace(0.1, 0.6, count))
    add("places of the disc", lambda x: jaws(1, friction=0.3, shift=x), np.linspace(-5 * mm, 5 * mm, count))
    spent: dict[tuple[str, str], list[float]] = {way: [] for way in ways}
    for n in range(rounds):
        for way in sorted(ways, reverse=bool(n % 2)):
            begin = time.process_time()
            ways[way]()
            spent[way].append(1e6 * (time.process_time() - begin) / count)
    found: dict[str, dict[str, float]] = {}
    for (name, kind), times in spent.items():
        found.setdefault(name, {})[kind] = statistics.median(times)
    return found


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Measure, print and write the ratios."""
    options = parse_options(__doc__ or "", argv)
    away, pressed = {"y": 1 * mm}, {"y": -2 * mm}
    cases: dict[str, tuple[Callable[[], Any], Callable[[], Any]]] = {}

    def add(
        name: str, own: ksd.Mechanism, other: ksd.Mechanism, values: Any = None, more: Any = None
    ) -> None:
        one, two = ksd.prepare(own), ksd.prepare(other)
        own_values, other_values = values or {}, (values or {}) | (more or {})
        cases[name] = lambda: one(own_values), lambda: two(other_values)

    add("one closed stop, over the guide without", guide("stop"), guide())
    add("one closed stop, over a drive in its place", guide("stop"), guide("drive"), None, {"d": 3 * mm})
    add("one closed stop in space", guide("stop", plane=None), guide(plane=None))
    add("one closed contact", jaws(1), jaws(1, touching=False), pressed)
    add(
        "one closed contact with friction",
        jaws(1, friction=0.3),
        jaws(1, friction=0.3, touching=False),
        pressed,
    )
    add("four closed contacts", jaws(4), jaws(4, touching=False), pressed)
    add("one closed contact along a leaf", finger(), finger(touching=False), {"y": -2 * mm})
    add("an open stop", guide("stop", high=50 * mm), guide())
    add("four open contacts", jaws(4), jaws(4, touching=False), away)
    rounds = 20 if options.quick else REPEATS
    spent: dict[str, list[tuple[float, float]]] = {name: [] for name in cases}
    with np.errstate(all="ignore"):
        for n in range(rounds + 3):
            for name, both in cases.items():
                took = (
                    (thread_us(both[0]), thread_us(both[1]))
                    if n % 2
                    else tuple(map(thread_us, both[::-1]))[::-1]
                )
                if n >= 3:
                    spent[name].append((took[0], took[1]))
    table = {}
    for name, rows in spent.items():
        own, other = (statistics.median(row[k] for row in rows) for k in (0, 1))
        table[name] = {"with_us": own, "without_us": other, "ratio": own / other, "more_us": own - other}
    case_us = batches(*((20, 1) if options.quick else (BATCH, ROUNDS)))
    found: dict[str, Any] = {"machine": machine(), "table": table, "batch_case_us": case_us}
    write_json(found, options.out / "contact.json")
    print(machine_line(found["machine"]))
    for name, row in table.items():
        print(f"{name:45} ratio {row['ratio']:.2f}, {row['more_us']:+.1f} us of {row['without_us']:.0f}")
    for name, us in case_us.items():
        text = f"{us['batch'] / us['prepared']:.2f} prepared solves"
        if "loop" in us:
            bare = (us["batch"] - us["build"]) / us["prepared"]
            text += f", {bare:.2f} without building scenes, {us['batch'] / us['loop']:.2f} of preparing and solving each"
        print(f"{'a case in batches of ' + name:45} {text}")
    return found


if __name__ == "__main__":
    main()
