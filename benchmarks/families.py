"""The joint families: what each is, how good its record is, and a picture of it at rest and deformed.

    python benchmarks/families.py [--quick] [--out FOLDER]

For every family, at random shapes inside its trained ranges and random motions (ends included): largest error of the
reduced drive force against the joint's own element model, and of the record's interface functions over the joint
length. Writes families.md, families.json and families.png.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from common import machine, options, write_json

import ksd
from ksd.library import find_record
from ksd.library.files import shipped_folder
from ksd.scene import Joint
from ksd.solve.conventional import conventional
from ksd.train.catalogue import ENTRIES
from ksd.train.designs import design_of
from ksd.view.figure import new_figure
from ksd.view.flat import plot_mechanism


def alone(joint: Joint) -> ksd.Mechanism:
    """The joint between ground and a link, every intended motion driven."""
    scene = ksd.Mechanism(joint.family)
    tip = scene.link("B")
    placed = scene.join(scene.ground, tip, joint, at=(0, 0, 0), axis="z", toward="x", name="joint")
    for motion in joint.motions:
        scene.actuate_joint(placed, name=motion.name, motion=motion.name)
    return scene


def drawn(name: str, rng: np.random.Generator | None) -> Joint:
    """The joint at a random shape of its trained range, or in the middle of it."""
    design = design_of(name)
    count = len(design.parameters)
    return design.make(**design.shape(np.zeros(count) if rng is None else rng.uniform(-1, 1, count)))


def measured(name: str, *, shapes: int) -> dict[str, float]:
    """Largest errors over random shapes, four motions each."""
    rng = np.random.default_rng(11)
    force, place = 0.0, 0.0
    for _ in range(shapes if ENTRIES[name].parameters else 1):
        joint = drawn(name, rng)
        solve = ksd.prepare(alone(joint))
        count = len(joint.motions)
        for share in (np.ones(count), -np.ones(count), *rng.uniform(-1, 1, (2, count))):
            values = {m.name: float(s * m.range[1]) for m, s in zip(joint.motions, share, strict=True)}
            exact = conventional(solve.model, values)
            reduced = solve(values, method="reduced", estimate=False)
            shape = solve(values, method="kinematic", estimate=False)
            size = max(abs(f) for f in exact.forces.values())
            force = max(force, max(abs(reduced.forces[n] - exact.forces[n]) for n in values) / size)
            place = max(place, float(np.abs(shape.motion.x - exact.motion.x).max()) / joint.length)
    return {"force_error": force, "interface_error": place}


def _range(low: float, high: float, *, angle: bool) -> str:
    scale = 180 / math.pi if angle else 1.0
    return f"{scale * low:.4g} to {scale * high:.4g}" + ("°" if angle else "")


def facts(name: str) -> dict[str, Any]:
    """What the record says of itself, in words."""
    joint, record = drawn(name, None), find_record(name)
    motions = [
        f"{m.name} {_range(m.low, m.high, angle=True)}"
        if m.kind == "rotation"
        else f"{m.name} {_range(m.low, m.high, angle=False)} L"
        for m in record.motions
    ]
    shapes = [f"{p.name} {_range(p.low, p.high, angle=p.name.endswith('angle'))}" for p in record.parameters]
    closed = hasattr(joint, "stiffness_at_rest")
    return {
        "leafs": len(joint.leafs()),
        "motions": ", ".join(motions),
        "shape": ", ".join(shapes) or "fixed",
        "closed_form": "yes" if closed else "-",
        "record_kB": round((shipped_folder() / f"{name}.h5").stat().st_size / 1000),
        "fresh_interface": record.worst("strain"),
    }


def table(found: dict[str, dict[str, Any]]) -> str:
    """Markdown, one row per family."""
    lines = [
        "| family | leafs | intended motions | shape parameters | closed-form stiffness | record [kB] | "
        "reduced force error | interface error / L |",
        "|---" * 8 + "|",
    ]
    for name, row in found.items():
        lines.append(
            f"| {name} | {row['leafs']} | {row['motions']} | {row['shape']} | {row['closed_form']} | {row['record_kB']} | "
            f"{row['force_error']:.1e} | {row['interface_error']:.1e} |"
        )
    return "\n".join(lines) + "\n"


def gallery(names: Sequence[str]) -> Any:
    """All families, at rest and at 0.8 of their first motion."""
    columns = 4
    rows = -(-len(names) // columns)
    figure = new_figure(3.2 * columns, 2.9 * rows)
    axes = figure.subplots(rows, columns, squeeze=False)
    for place, name in zip(axes.flat, names, strict=False):
        joint = drawn(name, None)
        values = {m.name: 0.8 * m.range[1] * (i == 0) for i, m in enumerate(joint.motions)}
        state = ksd.prepare(alone(joint))(values, method="full")
        plot_mechanism(state, plane="xy", axes=place, labels=False, title=name.replace("_", " "))
        place.set_axis_off()
    for place in axes.flat[len(names) :]:
        place.set_axis_off()
    return figure


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Measure, print the table, draw the gallery; returns every number."""
    chosen = options(__doc__, argv)
    names = tuple(ENTRIES)
    found = {name: facts(name) | measured(name, shapes=2 if chosen.quick else 10) for name in names}
    text = table(found)
    print(text)
    (chosen.out / "families.md").write_text(text)
    gallery(names).savefig(chosen.out / "families.png")
    everything = {"machine": machine(), "families": found}
    write_json(everything, chosen.out / "families.json")
    return everything


if __name__ == "__main__":
    main()
