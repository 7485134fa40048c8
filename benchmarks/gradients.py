"""Gradients against Richardson re-solves, and what they cost beside a value.

At random designs of ten families and three mechanisms (the README's fourbar with four different joints and 18
parameters, the spatial arm of 90 leaf springs with 6, a stage on two guides): every answer that `ksd.gradient` gives by
every parameter, against whole solves at eight values of it extrapolated to a step of zero; errors relative to the
derivative, not below 1e-3 of answer over parameter. Cost: force and 6x6 compliance by all
parameters, over a value of a new design (prepare, solve, 6x6). Thread CPU time, medians, in turns, kernels compiled
before.
Run: python benchmarks/gradients.py [--quick]
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from bench_scenes import TIP
from common import STEEL, linkage, machine, parse_options, time_in_turns, write_json

import ksd
from ksd.errors import KsdError
from ksd.study.questions import ALL_QUESTIONS
from ksd.units import deg, mm

QUESTIONS = tuple(q for q in ALL_QUESTIONS if q not in ("clearance", "buckling"))
"""Questions of one joint, whose leaf springs share their blocks; critical load factors are checked separately."""
STEP_FACTORS = (1.0, -1.0, 0.5, -0.5, 0.25, -0.25, 0.125, -0.125)
"""Steps of the re-solves, over the largest: two references of sixth order, whose difference is their error."""
MIN_SCALE = 1e-3
"""Errors of derivatives are relative to at least this times answer over parameter."""
MAX_STEP = 2e-3
"""Largest step of the re-solves, over the parameter."""
OPTIMUM = 0.5035665
"""Optimum of the job of `optima`, from the specification."""
TARGET_COSTS = {"fourbar": 3.0, "arm": 1.0}
"""Target of the cost of a gradient, in evaluations."""


def hinge(family: Callable[..., Any]) -> Callable[..., ksd.Mechanism]:
    """A joint turned by "turn", or moved, as a function of its parameters."""

    def design(**parameters: Any) -> ksd.Mechanism:
        if family is ksd.CrossFlexure:
            parameters["widths"] = (parameters.pop("inner"), parameters.pop("outer"))
        joint = family(STEEL, **parameters)
        scene = ksd.Mechanism("hinge")
        tip = scene.link("tip")
        placed = scene.join(scene.ground, tip, joint, at=(0, 0, 0), axis="z", toward="x", name="hinge")
        for n, motion in enumerate(joint.motions):
            scene.actuate_joint(placed, name=f"turn{n}" if n else "turn", motion=motion.name)
        return scene

    return design


LEAF = {"length": 60 * mm, "thickness": 0.4 * mm, "width": 20 * mm}
FAMILIES: dict[str, tuple[Callable[..., ksd.Mechanism], dict[str, float], dict[str, float]]] = {
    "cross flexure": (
        hinge(ksd.CrossFlexure),
        {"length": 70 * mm, "angle": 42 * deg, "thickness": 0.4 * mm, "inner": 30 * mm, "outer": 12 * mm},
        {"turn": 0.3},
    ),
    "crossed pivot": (hinge(ksd.CrossedPivot), {**LEAF, "angle": 42 * deg, "ratio": 0.3}, {"turn": 0.3}),
    "balanced crossed pivot": (
        hinge(ksd.BalancedCrossedPivot),
        {"length": 60 * mm, "thickness": 0.4 * mm, "inner_width": 30 * mm, "outer_width": 12 * mm, "angle": 42 * deg,
         "ratio": 0.4},
        {"turn": 0.3},
    ),
    "cartwheel": (hinge(ksd.Cartwheel), {**LEAF, "angle": 42 * deg}, {"turn": 0.2}),
    "butterfly": (hinge(ksd.Butterfly), {**LEAF, "inner": 20 * mm, "half_angle": 14 * deg}, {"turn": 0.2}),
    "infinity hinge": (hinge(ksd.InfinityHinge), {**LEAF, "reach": 0.42, "strut": 0.3}, {"turn": 0.2}),
    "parallel guide": (hinge(ksd.ParallelGuide), {**LEAF, "spacing": 50 * mm}, {"turn": 5 * mm}),
    "stiffened guide": (hinge(ksd.StiffenedGuide), {**LEAF, "spacing": 50 * mm, "flexible": 0.25}, {"turn": 4 * mm}),
    "arc hinge": (
        hinge(ksd.ArcHinge), {"radius": 30 * mm, "angle": 71 * deg, "thickness": 0.3 * mm, "width": 20 * mm}, {"turn": 0.2}
    ),
    "universal joint": (hinge(ksd.UniversalJoint), {**LEAF, "length": 50 * mm}, {"turn": 0.1, "turn1": 0.1}),
}  # fmt: skip
"""A design of every family, and the pose of its answers."""
SIDES = ("a", "b", "c", "d")


def fourbar(height: float, span: float, **sizes: float) -> ksd.Mechanism:
    """The README's fourbar, each of its four joints with length, thickness and two widths of its own."""
    joints = [
        ksd.CrossFlexure(
            STEEL, length=sizes[f"length_{s}"], angle=45 * deg, thickness=sizes[f"thickness_{s}"],
            widths=(sizes[f"inner_{s}"], sizes[f"outer_{s}"]),
        )
        for s in SIDES
    ]  # fmt: skip
    scene = linkage(joints, height, half=0.5 * span)
    scene.actuate("top", along="x", at=(0, height + 70 * mm, 0), name="top")
    return scene


def arm(
    length: float = 60 * mm, thickness: float = 0.45 * mm, forward: float = 150 * mm, up: float = 50 * mm,
    reach: float = 180 * mm, rise: float = 180 * mm,
) -> ksd.Mechanism:  # fmt: skip
    """The spatial arm the package brings: size of its hinges and where the second and third are."""
    joint = ksd.TripleInfinityHinge(STEEL, thickness=thickness, length=length)
    scene = ksd.Mechanism("arm")
    first, second, third = scene.links("first", "second", "third")
    for a, b, at, axis, toward, name in (
        (scene.ground, first, (0, 0, 0), "z", "x", "base"),
        (first, second, (forward, 0, up), "y", (1, 0, 1), "shoulder"),
        (second, third, (forward + reach, 0, up + rise), "y", (1, 0, -1), "elbow"),
    ):
        scene.actuate_joint(scene.join(a, b, joint, at=at, axis=axis, toward=toward, name=name), name=name)
    return scene


def stage(length: float, thickness: float, width: float, spacing: float, distance: float) -> ksd.Mechanism:
    """A stage that two guides in series carry along x and y, under a payload."""
    guide = ksd.ParallelGuide(STEEL, length=length, thickness=thickness, width=width, spacing=spacing)
    scene = ksd.Mechanism("stage")
    carriage, table = scene.links("carriage", "table")
    scene.actuate_joint(
        scene.join(scene.ground, carriage, guide, at=(0, 0, 0), axis="z", toward="x", name="first"),
        name="first",
    )
    scene.actuate_joint(
        scene.join(carriage, table, guide, at=(distance, 0, 0), axis="z", toward="y", name="second"),
        name="second",
    )
    scene.load(table, force=(0, 0, -2.0), at=(distance, length, 0), name="payload")
    return scene


OF_JOINT = {"length": 100 * mm, "thickness": 1 * mm, "inner": 40 * mm, "outer": 20 * mm}
MECHANISMS: dict[str, tuple[Callable[..., ksd.Mechanism], dict[str, float], dict[str, Any], str, Any]] = {
    "fourbar": (
        fourbar,
        {"height": 0.3, "span": 0.4} | {f"{n}_{s}": v for s in SIDES for n, v in OF_JOINT.items()},
        {"top": 200 * mm}, "top", (0.0, 0.3, 0.0),
    ),
    "arm": (
        arm,
        {"length": 60 * mm, "thickness": 0.45 * mm, "forward": 150 * mm, "up": 50 * mm, "reach": 180 * mm, "rise": 180 * mm},
        dict.fromkeys(("base", "shoulder", "elbow"), 20 * deg), "third", TIP,
    ),
    "stage": (
        stage,
        {"length": 80 * mm, "thickness": 0.4 * mm, "width": 25 * mm, "spacing": 60 * mm, "distance": 120 * mm},
        {"first": 4 * mm, "second": 3 * mm}, "table", None,
    ),
}  # fmt: skip


def random_design(
    at_design: Mapping[str, float], rng: np.random.Generator, by: float = 0.08
) -> dict[str, float]:
    """A random design near the nominal one."""
    return {n: v * rng.uniform(1 - by, 1 + by) for n, v in at_design.items()}


def gradient_errors(
    design: Callable[..., Any],
    at_design: Mapping[str, float],
    drives: Mapping[str, Any],
    words: Mapping[str, Any],
) -> dict[str, list[float]]:
    """(error of the gradient, its figure, error of the re-solves) of every answer, the largest over the parameters."""
    found = ksd.gradient(design, at_design, errors=True, method="conventional", **words, **drives)
    worst: dict[str, list[float]] = {}
    for name, value in at_design.items():
        rows = [
            next(iter(
                ksd.sweep(
                    design, designs=[{**at_design, name: value * (1 + MAX_STEP * s)}], method="conventional",
                    progress=False, **words, **drives,
                ).rows()
            ))
            for s in STEP_FACTORS
        ]  # fmt: skip
        for column in found.columns:
            here = float(found.values[column][0])
            if column not in rows[0] or (column, 0) in found.reasons or abs(here) < 1e-9:
                continue
            q = [float(row[column]) for row in rows]
            d = [(q[2 * k] - q[2 * k + 1]) / (2 * MAX_STEP * STEP_FACTORS[2 * k] * value) for k in range(4)]
            four = [(4 * fine - coarse) / 3 for coarse, fine in pairwise(d)]
            six = [(16 * fine - coarse) / 15 for coarse, fine in pairwise(four)]
            # what the others of its unit are beside it says what is rounding
            like = [
                abs(found.values[c][0])
                for c in found.columns
                if c.split("_")[0] == column.split("_")[0] == "parasitic"
            ]
            size = max(abs(six[0]), MIN_SCALE * max(abs(here), *like, 0.0) / value)
            off = abs(float(found[column, name][0]) - six[0]) / size
            figure, own = float(found.errors[column, name][0]) / size, abs(six[1] - six[0]) / size
            if not worst.get(column) or off > worst[column][0]:
                worst[column] = [off, figure, own]
    return worst


def accuracy(*, designs: int, heavy: int, names: Sequence[str]) -> list[dict[str, Any]]:
    """Errors of every answer at random designs of families and mechanisms."""
    rows = []
    cases: dict[str, tuple[Any, ...]] = {n: (*FAMILIES[n], {}) for n in FAMILIES} | {
        n: (make, at, drives, {"link": link, "at": point})
        for n, (make, at, drives, link, point) in MECHANISMS.items()
    }
    for name in names:
        make, usual, drives, words = cases[name]
        rng = np.random.default_rng(7)
        worst: dict[str, list[float]] = {}
        failed: list[str] = []
        count = heavy if name in MECHANISMS else designs
        questions = QUESTIONS if name != "arm" else tuple(q for q in QUESTIONS if q != "frequencies")
        for _ in range(count):
            at_design = random_design(usual, rng)
            try:
                found = gradient_errors(make, at_design, drives, {"questions": questions, **words})
            except KsdError as reason:
                failed.append(str(reason))
                continue
            for column, own in found.items():
                if column not in worst or own[0] > worst[column][0]:
                    worst[column] = own
        bad = {c: v for c, v in worst.items() if v[0] > 1e-6 + 10 * v[2]}
        most = max(worst, key=lambda c: worst[c][0]) if worst else ""
        print(
            f"{name:24} {count} designs, {len(worst)} answers: largest error {worst[most][0]:.1e} ({most}), re-solves "
            f"{worst[most][2]:.1e}; beyond 1e-6 + 10 x that: {len(bad)} {' '.join(bad)} {'; '.join(failed)[:200]}",
            flush=True,
        )
        rows.append({"what": name, "designs": count, "errors": worst, "failed": failed})
    return rows


def costs(repeats: int, names: Sequence[str]) -> list[dict[str, Any]]:
    """Thread ms of a value (a new design prepared, solved, asked for force and 6x6) and of its gradient by all
    parameters."""
    rng, pools = np.random.default_rng(3), {}
    for name in names:
        usual = MECHANISMS[name][1]
        pools[name] = itertools.cycle([random_design(usual, rng, 0.02) for _ in range(repeats + 3)])

    def value(name: str) -> None:
        make, _, drives, link, point = MECHANISMS[name]
        ksd.prepare(make(**next(pools[name])))(drives).stiffness(link, at=point)

    def gradient(name: str) -> None:
        make, _, drives, link, point = MECHANISMS[name]
        asked = ("force", "support_stiffness")
        ksd.gradient(make, next(pools[name]), questions=asked, link=link, at=point, **drives)

    ways = (("value", value), ("gradient", gradient))
    cases = {f"{name} {what}": partial(call, name) for name in names for what, call in ways}
    found = time_in_turns(cases, repeats=repeats)
    rows = []
    for name in names:
        one, all_of = (found[f"{name} {what}"].median / 1e3 for what in ("value", "gradient"))
        count = len(MECHANISMS[name][1])
        print(
            f"{name}: a value {one:.2f} ms, gradient by {count} parameters with the value {all_of:.2f} ms, "
            f"{all_of / one:.2f} values (wanted {TARGET_COSTS[name]:g})"
        )
        rows.append({"what": name, "parameters": count, "value_ms": one, "gradient_ms": all_of, "values": all_of / one,
                     "wanted_values": TARGET_COSTS[name]})  # fmt: skip
    return rows


def pivot(length: float, angle: float, thickness: float, inner: float, outer: float) -> ksd.Mechanism:
    """A cross flexure about the origin, its turn driven."""
    joint = ksd.CrossFlexure(STEEL, length=length, angle=angle, thickness=thickness, widths=(inner, outer))
    scene = ksd.Mechanism("pivot")
    link, at = scene.link("arm"), (-0.5 * joint.length_AB, 0, 0)
    placed = scene.join(scene.ground, link, joint, at=at, axis="z", toward="x", name="hinge")
    scene.actuate_joint(placed, name="turn")
    return scene


def pivot_job(**words: Any) -> ksd.Job:
    """A cross flexure of five parameters turned by 0, 15 and 30 degrees, as stiff at its worst as stress and moment allow;
    words: further ones of `ksd.Job`."""
    return ksd.Job(
        pivot, turn=np.array([0, 15, 30]) * deg, link="arm", at=(0, 0, 0), **words,
        vary={"length": (40 * mm, 80 * mm), "angle": (31 * deg, 59 * deg), "thickness": (0.2 * mm, 1 * mm),
              "inner": (10 * mm, 60 * mm), "outer": (4 * mm, 30 * mm)},
        maximise={"support_worst_N_per_m": 1e6, "support_worst_Nm_per_rad": 300},
        limits={"stress_MPa": 500, "turn_moment_Nm": (-3, 3)}, rules=[lambda p: 70 * mm - p["inner"] - 2 * p["outer"]],
    )  # fmt: skip


def optima(starts: int, methods: Sequence[Any]) -> list[dict[str, Any]]:
    """`pivot_job` by every method: how good, how many values and gradients, and CPU seconds."""
    job, rows = pivot_job(method="conventional"), []
    for method in methods:
        try:
            best = ksd.optimise(job, starts=starts if method == "gradient" else 1, method=method)
        except KsdError as reason:
            print(f"{method}: {reason}")
            continue
        ends = [{"merit": e.merit, "values": e.values, "gradients": e.gradients} for e in best.starts]
        rows.append(
            {"method": method, "merit": best.merit, "seconds": best.seconds / len(ends), "starts": ends}
        )
        print(
            f"{method}: {best.merit:.7f} (wanted {OPTIMUM}), {best.agreed} of {len(ends)} starts; values "
            f"{max(e['values'] for e in ends)}, gradients {max(e['gradients'] for e in ends)} at most, "
            f"{best.seconds / len(ends):.2f} s each"
        )
    return rows


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Measure, print, write gradients.json; returns what was found."""
    asked = parse_options(__doc__, argv)
    names = ("crossed pivot", "arc hinge") if asked.quick else (*FAMILIES, *MECHANISMS)
    result = {
        "machine": machine(),
        "cost": costs(2 if asked.quick else 25, ("fourbar",) if asked.quick else ("fourbar", "arm")),
        "optima": optima(
            *((1, ("gradient",)) if asked.quick else (5, ("gradient", "trust-constr", "cobyla", "cma")))
        ),
        "accuracy": accuracy(designs=1 if asked.quick else 10, heavy=2, names=names),
    }
    write_json(result, asked.out / "gradients.json")
    return result


if __name__ == "__main__":
    main()
