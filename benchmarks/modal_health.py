"""The error indicator of modal bodies against the true error, on random states of six bodies, a solid among them.

    python benchmarks/modal_health.py [--quick] [--out FOLDER]

Random loads on a cantilever, a tapered leaf, a parallel guide, a pair of crossed leaf springs, the cross flexure
of paper 1 in space and a thick leaf meshed as a solid, with bases from as printed to the default. Counts the states
whose true error (of link positions or drive forces, against the full model solved on its own) is 0.1 to 10 %, and how
many indicators lie within [0.6, 1.4] of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from common import machine, machine_line, parse_options, write_json
from paper2_cases import DEFAULT, EI, PRINTED, STEEL, L, T, W, add_leaves
from reduced_solids import load_face

import ksd
from ksd.modal import ModalBasis, with_modal_bodies
from ksd.modal.solid import block
from ksd.modal.solid_basis import SolidBasis, reduce_solid
from ksd.model.compile import compile_scene
from ksd.model.mesh import Mesh
from ksd.section import rectangle
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.full_bodies import error_indicator
from ksd.solvers.method_error import relative_error

BASES = (PRINTED, replace(PRINTED, internal=1), replace(PRINTED, frame="chord"), replace(DEFAULT, internal=0))
CORRECTORS = (1, 2, 3, 4, None)
"""Corrector steps of the full model; None: as the method takes them, until the indicator settles."""

SEEDS = (7, 8)
"""Seeds of 270 states each; the rule for the convergence of the indicator was chosen on the first."""


def cantilever(scene: ksd.Mechanism, tip: Any) -> float:
    """One leaf."""
    add_leaves(scene, tip, [((0, 0), (L, 0))])
    return 0.8


def tapered(scene: ksd.Mechanism, tip: Any) -> float:
    """A leaf whose thickness decreases towards its end."""
    profile = ksd.Taper(thickness=(T, 0.6 * T), width=(W, W))
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(L, 0, 0), section=rectangle(T, W), material=STEEL, width_axis="z",
        name="tapered", profile=profile,
    )  # fmt: skip
    return 0.5


def guide(scene: ksd.Mechanism, tip: Any) -> float:
    """Two parallel leaf springs."""
    add_leaves(scene, tip, [((0, y), (L, y)) for y in (-0.025, 0.025)])
    return 4.0


def crossed(scene: ksd.Mechanism, tip: Any) -> float:
    """Two leaf springs crossing at 90 degrees."""
    c = L * np.sqrt(0.5)
    add_leaves(scene, tip, [((0, -0.5 * c), (c, 0.5 * c)), ((0, 0.5 * c), (c, -0.5 * c))])
    return 1.2


def hinge(scene: ksd.Mechanism, tip: Any) -> float:
    """The cross flexure of paper 1, thinner, as a joint in space."""
    joint = ksd.CrossFlexure(STEEL, length=L, angle=np.pi / 4, thickness=T, widths=(2 * W, W))
    scene.join(scene.ground, tip, joint, at=(0, 0, 0), axis="z", toward="x")
    return 4.0


BODIES = {"cantilever": cantilever, "tapered leaf": tapered, "parallel guide": guide, "crossed leaf springs": crossed,
          "cross flexure in space": hinge}  # fmt: skip


def state(name: str, rng: np.random.Generator) -> dict[str, Any] | None:
    """One random state: basis, true error, indicators by corrector steps; None where either model found no state."""
    scene = ksd.Mechanism(name)
    tip = scene.link("tip")
    size = BODIES[name](scene, tip) * rng.uniform(0.2, 1.0)
    turn = rng.uniform(-1, 1)
    force = (
        size * EI / L**2 * np.array([0.3 * rng.uniform(-1, 1), np.sign(turn) * rng.uniform(0.2, 1.0), 0.0])
    )
    if name == "cross flexure in space":
        force *= 0.3
        force[2] = 2.0 * rng.uniform(-1, 1)
    moment = 0.5 * size * EI / L * np.array([0.0, 0.0, turn])
    scene.load(tip, force=tuple(force), moment=tuple(moment), at=(L, 0, 0))
    model = compile_scene(scene, mesh=Mesh("corotational", elements=10))
    basis: ModalBasis = BASES[rng.integers(len(BASES))]
    reduced = with_modal_bodies(model, basis)
    try:
        truth = solve_conventional(model, {}, planar=False, steps=4)
        found = solve_conventional(reduced, {}, planar=False, steps=4)
    except ksd.ConvergenceError:
        return None
    if not (truth.stable and found.stable) or truth.doubts or found.doubts:
        return None
    error = relative_error(reduced, found.motion, truth.motion)
    target = reduced.targets({})
    told = {k: error_indicator(reduced, found.motion, target, correctors=k) for k in CORRECTORS}
    ratios = {k: estimate.relative / error.relative for k, (estimate, _) in told.items()}
    taken = told[None][1].iterations
    return {"body": name, "basis": str(basis), "true": error.relative, "ratio": ratios, "taken": taken}


SOLID = "thick leaf, a solid"
NAMES = (*BODIES, SOLID)
THICK = 0.05
"""Thickness of the solid over its length."""
SOLID_BASES: tuple[dict[str, Any], ...] = (
    {"order": 1, "internal": 0},
    {"order": 1},
    {"order": 2, "internal": 0},
    {"order": 1, "internal": 0, "frame": "node"},
    {"order": 2, "internal": 0, "frame": "node"},
)


@lru_cache
def solid_bases() -> tuple[SolidBasis, ...]:
    """The thick leaf in plane stress, reduced in several ways."""
    solid = block(STEEL, L, THICK * L, width=W, cells=(16, 1))
    return tuple(reduce_solid(solid, **words) for words in SOLID_BASES)


def solid_state(rng: np.random.Generator) -> dict[str, Any] | None:
    """`state` of the solid, in a mechanism; the truth is the meshed solid pressed on its own."""
    which = int(rng.integers(len(SOLID_BASES)))
    body, rigid = solid_bases()[which], STEEL.E * W * (THICK * L) ** 3 / 12
    low, high = (0.005, 0.2) if SOLID_BASES[which]["order"] == 1 else (1.0, 3.5)
    size, turn = math.exp(rng.uniform(math.log(low), math.log(high))), rng.uniform(-1, 1)
    across = np.sign(turn) * rng.uniform(0.2, 1.0)
    force = size * rigid / L**2 * np.array([0.3 * rng.uniform(-1, 1), across, 0.0])
    moment = 0.5 * size * rigid / L * np.array([0.0, 0.0, turn])
    scene = ksd.Mechanism(SOLID)
    tip = scene.link("tip")
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(L, 0, 0), section=rectangle(THICK * L, W), material=STEEL,
        width_axis="z", name="solid",
    )  # fmt: skip
    scene.load(tip, force=tuple(force), moment=tuple(moment), at=(L, 0, 0))
    scene.support(tip, along="z", at=(L, 0, 0))
    for axis in "xy":
        scene.support(tip, about=axis)
    try:
        truth = load_face(body.solid, force, moment)
        found = ksd.solve(scene, basis={"solid": body}, strict=False)
    except ksd.ConvergenceError:
        return None
    if not found.stable or found.method_error is None:
        return None
    moved = found.displacement("tip", (L, 0, 0))
    true = float(np.linalg.norm(truth.shift - moved) / np.linalg.norm(moved))
    taken = next(s.iterations for s in found.steps if s.name == "error estimate")
    said = ", ".join(f"{k} {v}" for k, v in SOLID_BASES[which].items())
    ratio = {None: found.method_error.relative / true}
    return {"body": SOLID, "basis": said, "true": true, "ratio": ratio, "taken": taken}


def collect_states(seed: int, wanted: int) -> tuple[list[dict[str, Any]], dict[str, int]]:
    """States with true errors of 0.1 to 10 %, `wanted` of every body, and how many were not found by either model."""
    rng, rows, lost = np.random.default_rng(seed), [], dict.fromkeys(NAMES, 0)
    for name in NAMES:
        mine: list[dict[str, Any]] = []
        for _ in range(12 * wanted):
            if len(mine) == wanted:
                break
            found = solid_state(rng) if name == SOLID else state(name, rng)
            lost[name] += found is None
            if found is not None and 1e-3 <= found["true"] <= 0.1:
                mine.append(found)
        rows += mine
    return rows, lost


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Run, write, return the numbers."""
    chosen = parse_options(__doc__, argv)
    on, rows = machine(), []
    lost = dict.fromkeys(NAMES, 0)
    for seed in SEEDS[: 1 if chosen.quick else None]:
        more, missed = collect_states(seed, 4 if chosen.quick else 45)
        rows += more
        lost = {name: lost[name] + missed[name] for name in NAMES}
    said = [
        "# Error indicator of modal bodies", "", f"{machine_line(on)}.", "",
        f"{len(rows)} random states with true errors of 0.1 to 10 %; share of indicators within [0.6, 1.4] of them, and",
        "the extremes of indicator over true error, by corrector steps of the full model; the method goes",
        "on until the indicator settles, and gives none where it does not. Of solids the method alone is told.", "",
        " | ".join(["| body", "states", *(f"{k} steps" if k else "as the method" for k in CORRECTORS),
                    "steps it takes: median, most", "no state found |"]),
        "|---|---:|" + "---:|" * (len(CORRECTORS) + 2),
    ]  # fmt: skip
    for name in (*NAMES, "all"):
        mine = [r for r in rows if name in (r["body"], "all")]
        cells = []
        for k in CORRECTORS:
            ratio = np.array([r["ratio"][k] for r in mine if k in r["ratio"]])
            share = np.mean((ratio >= 0.6) & (ratio <= 1.4)) if len(ratio) else float("nan")
            cells.append(
                f"{100 * share:.1f} % ({ratio.min():.3g} .. {ratio.max():.3g})" if len(ratio) else "-"
            )
        taken = [r["taken"] for r in mine] or [0]
        cells.append(f"{np.median(taken):.0f}, {max(taken)}")
        said.append(
            f"| {name} | {len(mine)} | " + " | ".join(cells) + f" | {lost.get(name, sum(lost.values()))} |"
        )
    text = "\n".join([*said, ""])
    (chosen.out / "modal_health.md").write_text(text)
    found = {"machine": on, "rows": rows}
    write_json(found, chosen.out / "modal_health.json")
    print(text)
    return found


if __name__ == "__main__":
    main()
