"""The joint families: the error of every record, and a picture of every family at rest and deformed.

    python benchmarks/families.py [--quick] [--out FOLDER]

For every family, at random shapes inside its trained ranges and random motions (ends included): largest error of the
reduced drive force against the joint's own element model, and of the positions of B and of internal blocks by the record
over the joint length; the force also with 4 Appendix A elements per leaf, and both at other sizes than the trained one:
length, thickness and widths by up to 1.5 each way. Flexible constraints have no motion to train: their closed form is put
against the model at random shapes, beside how much softer they are elsewhere, and how stiff they stay when moved. Writes
families.md, families.json and families.png.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from common import STEEL, machine, parse_options, save_picture, write_json

import ksd
from ksd.library import find_record
from ksd.library.record_files import shipped_folder
from ksd.model.mesh import Mesh
from ksd.scene import Joint
from ksd.solvers.conventional import solve_conventional
from ksd.training.catalogue import FAMILY_DESIGNS, design_of
from ksd.training.family_description import FAMILY_ORIGINS, TYPICAL_RANGES, count_function_parities
from ksd.view import plot_mechanism
from ksd.view.figure import new_figure

MAX_SIZE_FACTOR = 1.5
"""Largest factor on a size that a record does not depend on."""


def random_joint(name: str, rng: np.random.Generator | None) -> Joint:
    """The joint at a random shape of its trained range, or in the middle of it."""
    design = design_of(name)
    count = len(design.parameters)
    return design.make(**design.shape(np.zeros(count) if rng is None else rng.uniform(-1, 1, count)))


def resized_joint(joint: Joint, rng: np.random.Generator) -> Joint:
    """The joint with other sizes, on which its record does not depend: lengths, thickness, widths by a factor each."""
    longer, thicker, wider = np.exp(rng.uniform(-1, 1, 3) * math.log(MAX_SIZE_FACTOR)).tolist()
    # the width of a universal joint over its length is a shape parameter
    across: tuple[str, ...] = ("width", "widths", "inner_width", "outer_width", "gap")
    if isinstance(joint, ksd.UniversalJoint):
        across = ()
    across += ("spacing",) if isinstance(joint, ksd.CrossFlexure) else ()
    words = {}
    for key, kind in joint.quantities.items():
        value = getattr(joint, key, None)
        if kind != "length" or value is None:
            continue
        factor = thicker if key == "thickness" else wider if key in across else longer
        words[key] = tuple(factor * v for v in value) if isinstance(value, tuple) else factor * value
    if isinstance(joint, ksd.CrossFlexure):
        words.pop("gap", None)
    return replace(joint, **words)  # type: ignore[type-var]


def family_errors(name: str, *, shapes: int) -> dict[str, float]:
    """Largest errors over random shapes, four motions each."""
    count = shapes if FAMILY_DESIGNS[name].parameters else 1
    force, place = errors(name, count)
    # the filleted notch is trained with one element alone
    mesh = Mesh("corotational", elements=4 if 4 in FAMILY_DESIGNS[name].meshes else 1)
    sizes = errors(name, shapes, other_sizes=True)
    return {
        "force_error": force,
        "interface_error": place,
        "chain_force_error": errors(name, count, mesh=mesh)[0],
        "sizes_force_error": sizes[0],
        "sizes_interface_error": sizes[1],
    }


def errors(
    name: str, shapes: int, *, mesh: Mesh | None = None, other_sizes: bool = False
) -> tuple[float, float]:
    """Largest errors of the reduced drive force and of positions over random shapes, four motions each."""
    rng = np.random.default_rng(11)
    force, place = 0.0, 0.0
    for _ in range(shapes):
        joint = random_joint(name, rng)
        if other_sizes:
            joint = resized_joint(joint, rng)
        solve = ksd.prepare(ksd.Mechanism.of_joint(joint), mesh=mesh)
        count = len(joint.motions)
        for share in (np.ones(count), -np.ones(count), *rng.uniform(-1, 1, (2, count))):
            values = {m.name: float(s * m.range[1]) for m, s in zip(joint.motions, share, strict=True)}
            exact = solve_conventional(solve.model, values)
            reduced = solve(values, method="reduced", estimate=False)
            shape = solve(values, method="kinematic", estimate=False)
            size = max(abs(f) for f in exact.forces.values())
            force = max(force, max(abs(reduced.forces[n] - exact.forces[n]) for n in values) / size)
            place = max(place, float(np.abs(shape.motion.x - exact.motion.x).max()) / joint.length)
    return force, place


def _range(low: float, high: float, *, angle: bool) -> str:
    scale = 180 / math.pi if angle else 1.0
    return f"{scale * low:.4g} to {scale * high:.4g}" + ("°" if angle else "")


def record_facts(name: str) -> dict[str, Any]:
    """Facts about the record of a family, in words."""
    joint, record = random_joint(name, None), find_record(name)
    motions = [
        f"{m.name} {_range(m.low, m.high, angle=True)}"
        if m.kind == "rotation"
        else f"{m.name} {_range(m.low, m.high, angle=False)} L"
        for m in record.motions
    ]
    shapes = [f"{p.name} {_range(p.low, p.high, angle=p.name.endswith('angle'))}" for p in record.parameters]
    closed = hasattr(joint, "stiffness_at_rest")
    return {
        "leaves": len(joint.leaves()),
        "motions": ", ".join(motions),
        "shape": ", ".join(shapes) or "fixed",
        "closed_form": "yes" if closed else "-",
        "symmetry": ", ".join(f"{n} {word}" for word, n in count_function_parities(record).items()),
        "source": FAMILY_ORIGINS[name].short,
        "record_kB": round((shipped_folder() / f"{name}.h5").stat().st_size / 1000),
        "fresh_interface": record.worst("strain"),
    }


def table(found: dict[str, dict[str, Any]]) -> str:
    """Markdown, one row per family."""
    lines = [
        "# Joint families",
        "",
        "Largest errors over random shapes inside the trained ranges and four motions each, ends included: of the",
        "reduced drive force against the joint's own element model (asked 1e-3), and of the positions of B and all",
        "blocks by the record over the joint length (asked 1e-4); the force also with four Appendix A elements per",
        "leaf, and both at lengths, thicknesses and widths off the trained ones by up to 1.5 each way, which a record",
        "does not know: leaf springs that are thick for their length stretch more, by the square of that ratio. Beyond a",
        "range a solve is refused. What matters to each family, and its errors on fresh shapes group by group, is",
        "printed by `ksd info FAMILY`.",
        "",
        "| family | source | leaf springs | intended motions | shape parameters | closed-form stiffness | its functions | "
        "record [kB] | reduced force error | positions / L | force, 4 elements per leaf | force, other sizes | "
        "positions, other sizes |",
        "|---" * 13 + "|",
    ]
    for name, row in found.items():
        lines.append(
            f"| {name} | {row['source']} | {row['leaves']} | {row['motions']} | {row['shape']} | {row['closed_form']} | "
            f"{row['symmetry']} | {row['record_kB']} | "
            f"{row['force_error']:.1e} | {row['interface_error']:.1e} | {row['chain_force_error']:.1e} | "
            f"{row['sizes_force_error']:.1e} | {row['sizes_interface_error']:.1e} |"
        )
    return "\n".join(lines) + "\n"


CONSTRAINTS: dict[str, tuple[Joint, float]] = {
    "folded leaf": (ksd.FoldedLeaf(STEEL, length=0.05, thickness=3e-4, width=0.02), 0.1),
    "wire": (ksd.WireFlexure(STEEL, length=0.05, diameter=5e-4), 0.15),
}
"""Flexible constraints, and displacement of B across them in the picture, over their length."""


def constrained(joint: Joint, share: float) -> ksd.Configuration:
    """A flexible constraint with B moved along y and kept parallel."""
    scene = ksd.Mechanism(joint.family)
    tip = scene.link("B")
    scene.constrain(scene.ground, tip, joint, at=(0, 0, 0), axis="z", toward="x", name="joint")
    scene.actuate(tip, along="y", at=joint.pose_B, name="across")
    scene.actuate(tip, about="z", name="turn")
    return ksd.solve(scene, across=share * joint.length, turn=0.0, method="conventional")


STIFF_DIRECTION = {"folded leaf": ("z", "along its fold"), "wire": ("x", "along its axis")}
"""The only stiff direction of a flexible constraint."""


def random_constraint(name: str, rng: np.random.Generator) -> ksd.FoldedLeaf | ksd.WireFlexure:
    """A flexible constraint of random size and of a shape within its typical ranges, evenly in the logarithm."""

    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(math.log(low), math.log(high))))

    L = between(0.01, 0.2)
    if name == "wire":
        return ksd.WireFlexure(STEEL, length=L, diameter=L * between(1 / 200, 1 / 25))
    thickness, width = L * between(1 / 400, 1 / 50), L * between(0.2, 1.0)
    return ksd.FoldedLeaf(STEEL, length=L, thickness=thickness, width=width)


def constraint_facts(name: str, *, shapes: int) -> dict[str, Any]:
    """Closed form against the model at random shapes, ends kept parallel; how many times stiffer than along the other two
    axes at least; and what is left of the stiffness when B is moved across by 2 and by 10 % of the length."""
    rng, (axis, along) = np.random.default_rng(11), STIFF_DIRECTION[name]
    family, off, soft, left = "", 0.0, math.inf, {0.02: 1.0, 0.1: 1.0}
    for _ in range(shapes):
        joint = random_constraint(name, rng)
        family, turns = joint.family, ("rx", "ry", "rz")
        found = _stiffness(joint, 0.0)
        k = found.support(axis, held=turns)
        off = max(off, abs(joint.stiffness_at_rest() / k - 1.0))
        soft = min(soft, *(k / found.support(d, held=turns) for d in "xyz" if d != axis))
        for share in left:
            left[share] = min(left[share], _stiffness(joint, share).support(axis, held=turns) / k)
    return {
        "source": FAMILY_ORIGINS[family].short, "holds": along, "shapes": TYPICAL_RANGES[family], "closed_form_error": off,
        "times_stiffer": soft, "left": {f"{100 * share:g} %": value for share, value in left.items()},
    }  # fmt: skip


def _stiffness(joint: Joint, share: float) -> Any:
    """Stiffness of B, drives released, where it was moved across."""
    return constrained(joint, share).stiffness("B", at=joint.pose_B, freed=("across", "turn"))


def constraint_table(found: dict[str, dict[str, Any]]) -> str:
    """Markdown, one row per flexible constraint."""
    lines = [
        "",
        "## Flexible constraints",
        "",
        "They have no intended motion and no record: their leaves are part of every model as they are. Stiffness with",
        "the ends kept parallel, at random shapes: the closed form against the model, the least ratio to the stiffness",
        "along the other two axes, and the least share left of it with B moved across the constraint.",
        "",
        "| constraint | source | is stiff | typical ranges | closed form off | times stiffer, at least | "
        "left at 2 % of L | at 10 % |",
        "|---" * 8 + "|",
    ]
    for name, row in found.items():
        near, far = row["left"].values()
        lines.append(
            f"| {name} | {row['source']} | {row['holds']} | {row['shapes']} | {100 * row['closed_form_error']:.2g} % | "
            f"{row['times_stiffer']:.3g} | {100 * near:.2g} % | {100 * far:.2g} % |"
        )
    return "\n".join(lines) + "\n"


def picture(names: Iterable[str], path: Path) -> None:
    """All families, at rest and at 0.8 of their first motion, and the flexible constraints."""
    columns = 5
    panels: list[tuple[str, ksd.Configuration]] = []
    for name in names:
        joint = random_joint(name, None)
        values = {m.name: 0.8 * m.range[1] * (i == 0) for i, m in enumerate(joint.motions)}
        panels.append(
            (name.replace("_", " "), ksd.prepare(ksd.Mechanism.of_joint(joint))(values, method="full"))
        )
    panels += [(name, constrained(joint, share)) for name, (joint, share) in CONSTRAINTS.items()]
    rows = -(-len(panels) // columns)
    figure = new_figure(2.2 * columns, 2.2 * rows)
    axes = figure.subplots(rows, columns, squeeze=False)
    for place, (title, state) in zip(axes.flat, panels, strict=False):
        # seen onto its plane its leaf springs lie on each other
        view = (-90, 35) if title == "triple infinity hinge" else None
        plot_mechanism(state, axes=place, view=view, labels=False, title=title)
        place.set_anchor("NW")
        place.set_axis_off()
    for place in axes.flat[len(panels) :]:
        place.set_axis_off()
    save_picture(figure, path)


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Measure, print the table, draw the gallery; returns every number."""
    chosen = parse_options(__doc__, argv)
    names = tuple(FAMILY_DESIGNS)
    found = {
        name: record_facts(name) | family_errors(name, shapes=2 if chosen.quick else 10) for name in names
    }
    held = {name: constraint_facts(name, shapes=2 if chosen.quick else 10) for name in CONSTRAINTS}
    text = table(found) + constraint_table(held)
    print(text)
    (chosen.out / "families.md").write_text(text)
    everything = {"machine": machine(), "families": found, "constraints": held}
    write_json(everything, chosen.out / "families.json")
    picture(names, chosen.out / "families.png")
    return everything


if __name__ == "__main__":
    main()
