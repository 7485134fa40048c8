"""Whether optima are optima: random jobs by every method, each end against designs around it.

Jobs of all joint families and of drawn leaf springs at sizes from 1/30 to 3, with one to six parameters, one to four poses,
random targets, limits, scales and rules. Every optimum is compared with `--near` designs near it, all with `--far` designs
within the bounds; its limits are checked by the conventional method. Written: how many are proven (status "optimum"), how
many of these have a better neighbour by more than .1 %, how many exceed a limit, how often each method finds the best of
all. Worths of limits, and of the bound worth most, are compared with optima where it is moved by half a percent, at every
fourth job; trust-constr, COBYLA and evolution are tried at every tenth. Where a design costs more than `COSTLY`, a quarter
of the random ones must do, and the other methods wait for the next job; where it costs more than `--cost`, the job is left
for a longer run. Each job is added to optima.jsonl when it is done, and not computed again: the run may be stopped and
continued. Then: jobs of kinds that once ended beside their optimum, in several units; fronts of six of the jobs; values and
CPU time per optimum for 1 to 20 parameters.
Run: python benchmarks/optima.py [--quick] [--jobs N] [--first SEED] [--near N] [--far N] [--minutes M] [--cost S]
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from common import STEEL, machine, parse_options, write_json

import ksd
from ksd.errors import KsdError
from ksd.optimisation.design_log import DesignLog
from ksd.optimisation.optimality import relative_gain
from ksd.optimisation.scaled_problem import ScaledProblem
from ksd.training.catalogue import FAMILY_DESIGNS, design_of
from ksd.units import mm

SAME_MERIT = 1e-3
"""Relative difference of merits that does not count."""
MET = 1e-6
"""Relative excess of a limit in another solve that does not count."""
DRAWN = ("guide", "chain", "pivot")
EVERY = 10
"""Jobs of which one is tried by the other methods."""
COSTLY = 0.05
"""CPU time [s] of a design above which fewer of them judge an optimum."""

FRONTS = 6
"""Number of fronts."""


class FamilyDesign:
    """A joint of a family by factors on its sizes and by its shape parameters, at a scale; its link carries a mass."""

    def __init__(self, family: str, scale: float, mass: float) -> None:
        self.family, self.scale, self.mass = family, scale, mass

    def joint(self, values: Mapping[str, float]) -> Any:
        """The joint of a design."""
        design = design_of(self.family)
        shapes = design.shape(np.zeros(len(design.parameters)))
        joint = design.make(**{n: values.get(n, v) for n, v in shapes.items()})
        sizes: dict[str, Any] = {}
        for key, kind in joint.quantities.items():
            value = getattr(joint, key, None)
            if kind == "length" and value is not None:
                factor = self.scale * values.get(f"{key}_factor", 1.0)
                sizes[key] = tuple(factor * v for v in value) if isinstance(value, tuple) else factor * value
        if isinstance(joint, ksd.CrossFlexure):
            sizes.pop("gap", None)
        return replace(joint, **sizes)  # type: ignore[type-var]

    def __call__(self, **values: float) -> ksd.Mechanism:
        joint = self.joint(values)
        scene = ksd.Mechanism(self.family)
        tip = scene.link("tip")
        placed = scene.join(scene.ground, tip, joint, at=(0, 0, 0), axis="z", toward="x", name="joint")
        size = self.scale * 0.1
        mass = self.mass * self.scale**3
        scene.mass(tip, mass=mass, at=(size, 0.1 * size, 0), inertia=(0.1 * mass * size**2,) * 3)
        for motion in joint.motions:
            scene.actuate_joint(placed, name=motion.name, motion=motion.name)
        return scene

    def parameters(self) -> dict[str, tuple[float, float]]:
        """Bounds of all parameters that can be varied."""
        design = design_of(self.family)
        joint = design.make(**design.shape(np.zeros(len(design.parameters))))
        sizes = [k for k, kind in joint.quantities.items() if kind == "length" and getattr(joint, k, None)]
        bounds = {
            f"{k}_factor": (0.7, 1.4)
            for k in sizes
            if k not in ("gap", "spacing", "inner", "radius", "minimum")
        }
        for p in design.parameters:
            low, high = p.low, p.high
            # a little within the trained range
            ends = (low**0.95 * high**0.05, low**0.05 * high**0.95) if p.scale == "log" else (
                0.95 * low + 0.05 * high, 0.05 * low + 0.95 * high)  # fmt: skip
            bounds[p.name] = ends
        return bounds

    def drives(self) -> dict[str, float]:
        """Largest drive value."""
        joint = self.joint({})
        return {m.name: m.range[1] * (1.0 if m.kind == "rotation" else self.scale) for m in joint.motions}


class DrawnDesign:
    """Drawn leaf springs: a guide of two, a chain of pieces, or two that cross."""

    def __init__(self, kind: str, scale: float, mass: float) -> None:
        self.family, self.scale, self.mass = kind, scale, mass

    def parameters(self) -> dict[str, tuple[float, float]]:
        s = self.scale
        if self.family == "chain":
            return {f"t{k}": (0.2 * mm * s, 0.9 * mm * s) for k in range(4)} | {
                "width": (6 * mm * s, 25 * mm * s),
                "length": (60 * mm * s, 110 * mm * s),
            }
        common = {
            "length": (50 * mm * s, 90 * mm * s),
            "thickness": (0.2 * mm * s, 0.7 * mm * s),
            "width": (8 * mm * s, 25 * mm * s),
        }
        if self.family == "guide":
            return common | {
                "spacing": (20 * mm * s, 80 * mm * s),
                "second": (0.2 * mm * s, 0.7 * mm * s),
                "lean": (-5 * mm * s, 5 * mm * s),
            }
        return common | {"angle": (0.55, 1.02), "second": (0.2 * mm * s, 0.7 * mm * s), "offset": (-0.2, 0.2)}

    def drives(self) -> dict[str, float]:
        return {"drive": 0.3 if self.family == "pivot" else 6 * mm * self.scale}

    def __call__(self, **values: float) -> ksd.Mechanism:
        v = {n: 0.5 * (a + b) for n, (a, b) in self.parameters().items()} | values
        scene = ksd.Mechanism(self.family)
        stage = scene.link("stage")

        def leaf(start: Any, end: Any, thickness: float, a: Any = "ground", b: Any = stage) -> None:
            scene.leaf(
                a, b, start=start, end=end, section=ksd.rectangle(thickness, v["width"]), material=STEEL
            )

        L = v["length"]
        if self.family == "guide":
            leaf((0, 0, 0), (L, 0, 0), v["thickness"])
            leaf((0, v["spacing"], 0), (L, v["spacing"] + v["lean"], 0), v["second"])
            at = (L, 0.5 * v["spacing"], 0)
            scene.actuate(stage, along="y", at=at, name="drive")
        elif self.family == "chain":
            links = ["ground", *(scene.link(f"block{k}") for k in range(3)), stage]
            for k in range(4):
                leaf((k * L / 4, 0, 0), ((k + 1) * L / 4, 0, 0), v[f"t{k}"], links[k], links[k + 1])
            at = (L, 0, 0)
            scene.actuate(stage, along="y", at=at, name="drive")
        else:
            c, s = L * np.cos(v["angle"]), L * np.sin(v["angle"])
            gap = v["width"]
            leaf((0, 0, 0), (s, c, 0), v["thickness"])
            leaf((0, c * (1 + v["offset"]), gap), (s, c * v["offset"], gap), v["second"])
            at = (s, 0.5 * c, 0)
            scene.actuate(stage, about="z", name="drive")
        m = self.mass * self.scale**3
        size = 0.1 * self.scale
        scene.mass(stage, mass=m, at=at, inertia=(0.1 * m * size**2,) * 3)
        return scene


TARGETS = (
    ("maximise", "support_worst_N_per_m"), ("maximise", "support_worst_Nm_per_rad"), ("maximise", "support_x_N_per_m"),
    ("maximise", "support_z_N_per_m"), ("maximise", "support_rx_Nm_per_rad"), ("maximise", "intended_Hz"),
    ("maximise", "first_parasitic_Hz"), ("maximise", "parasitic_2_Hz"), ("minimise", "stress_MPa"),
    ("minimise", "strain_energy_J"), ("minimise", "effort"), ("minimise", "drive_stiffness"),
    ("maximise", "drive_stiffness"), ("minimise", "parasitic_x_mm"), ("minimise", "parasitic_rz_mrad"),
    ("minimise", "parasitic_y_mm"), ("maximise", "buckling_positive"), ("maximise", "two"),
)  # fmt: skip
LIMITS = (
    "stress_MPa", "effort", "drive_stiffness", "support_worst_N_per_m", "support_z_N_per_m", "intended_Hz",
    "first_parasitic_Hz", "strain_energy_J", "size",
)  # fmt: skip


def random_job(seed: int) -> ksd.Job:
    """A random job; raises RuntimeError where none of 50 trials has answers."""
    rng = np.random.default_rng(seed)
    for _ in range(50):
        try:
            job = _trial(rng)
        except KsdError:
            continue
        if job is not None:
            return job
    raise RuntimeError("no job")


def _trial(rng: np.random.Generator) -> ksd.Job | None:
    names = (*FAMILY_DESIGNS, *DRAWN, *DRAWN)
    name = names[rng.integers(len(names))]
    scale = float(10 ** rng.uniform(-1.5, 0.5)) if rng.random() < 0.5 else 1.0
    design: Any = (DrawnDesign if name in DRAWN else FamilyDesign)(
        name, scale, float(10 ** rng.uniform(-2, 0))
    )
    bounds = design.parameters()
    count = min(len(bounds), int(rng.integers(1, 7)))
    vary = {n: bounds[n] for n in sorted(rng.choice(sorted(bounds), count, replace=False))}
    poses = int(rng.integers(1, 5))
    drives = {
        n: v * rng.uniform(0.2, 0.8) * np.linspace(0, 1, poses) if poses > 1 else [v * rng.uniform(0.1, 0.8)]
        for n, v in design.drives().items()
    }
    first = next(iter(drives))
    is_rotation = name not in ("guide", "chain") and "guide" not in name
    effort, stiffness = (
        (f"{first}_moment_Nm", f"{first}_stiffness_Nm_per_rad")
        if is_rotation
        else (f"{first}_force_N", f"{first}_stiffness_N_per_m")
    )

    def column(word: str) -> str:
        return {"effort": effort, "drive_stiffness": stiffness}.get(word, word)

    role, target = TARGETS[rng.integers(len(TARGETS))]
    if target == "buckling_positive" and poses > 1:
        # a gradient by six parameters at four poses takes seconds
        drives, poses = {n: v[-1:] for n, v in drives.items()}, 1
    words: dict[str, Any] = {"vary": vary, **({} if len(drives) == 1 else {"together": True}), **drives}
    if rng.random() < 0.3:
        words["method"] = "conventional"
    if rng.random() < 0.3:
        words["freed"] = first
    goals: Any = column(target)
    # sizes of the answers decide scales and limits
    wanted = {
        column(w)
        for w in (
            "stress_MPa",
            "effort",
            "drive_stiffness",
            "support_worst_N_per_m",
            "support_worst_Nm_per_rad",
            "support_z_N_per_m",
            "intended_Hz" if len(drives) == 1 else "intended_1_Hz",
            "first_parasitic_Hz",
            "strain_energy_J",
        )
    }
    if len(drives) > 1 and goals == "intended_Hz":
        goals = "intended_1_Hz"
    probe = ksd.Job(
        design, **words, limits=dict.fromkeys(sorted(wanted), 1e15) | {"size_mm": (1e9, None, None)}, rules=[]
    )
    X = probe.random(5, seed=int(rng.integers(1, 1000)))
    values, status = probe.batch(X)
    good = [k for k, s in enumerate(status) if s == "ok"]
    if len(good) < 2:
        return None
    a = X[good[0]]

    def value(c: str, k: int) -> float:
        own = [
            abs(v)
            for v, an in zip(values[k], probe.answers, strict=True)
            if an.column.split("[")[0] == c and np.isfinite(v)
        ]
        return (float(min(own)) if "support" in c or "Hz" in c else float(max(own))) if own else float("nan")

    if target == "two":
        goals = {c: value(c, good[0]) for c in ("support_worst_N_per_m", "first_parasitic_Hz")}
        if not all(np.isfinite(v) and v > 0 for v in goals.values()):
            return None
    limits: dict[str, Any] = {}
    for word in rng.choice(LIMITS, int(rng.integers(1, 4)), replace=False):
        c = column(str(word))
        c = "intended_1_Hz" if c == "intended_Hz" and len(drives) > 1 else c
        if c in ((goals,) if isinstance(goals, str) else goals):
            continue
        if c == "size":
            extent = [
                v for v, an in zip(values[good[0]], probe.answers, strict=True) if an.column == "size_x_mm"
            ]
            limits["size_mm"] = (extent[0] * float(rng.uniform(0.95, 1.2)), None, None)
            continue
        v = value(c, good[0]) * float(
            np.exp(rng.uniform(-0.1, 0.4) * (-1 if "support" in c or "Hz" in c else 1))
        )
        if not np.isfinite(v) or v == 0:
            continue
        low = "support" in c or "Hz" in c
        limits[c] = (v, None) if low else (-v, v) if c == effort else (None, v)
    rules = []
    if len(vary) > 1 and rng.random() < 0.4:
        p, q = list(vary)[:2]
        ap, aq = float(a[0]), float(a[1])
        rules.append(lambda d: 1.05 - 0.5 * d[p] / ap - 0.5 * d[q] / aq)
    scale_of = float(10 ** rng.uniform(-3, 3)) if rng.random() < 0.3 and isinstance(goals, str) else None
    if scale_of is not None:
        goals = {goals: scale_of}
    if not limits and rng.random() < 0.7:
        limits = {"stress_MPa": value("stress_MPa", good[0])}
    return ksd.Job(design, **words, **{role: goals}, limits=limits, rules=rules)


class Chain:
    """A chain of ten leaf springs between blocks by their thicknesses and widths; moved at its end."""

    def __init__(self, count: int) -> None:
        names = [f"t{k}" for k in range(10)] + [f"w{k}" for k in range(10)]
        self.vary = {n: (0.2 * mm, 0.8 * mm) if n[0] == "t" else (8 * mm, 24 * mm) for n in names[:count]}

    def __call__(self, **values: float) -> ksd.Mechanism:
        scene = ksd.Mechanism("chain of ten")
        links: list[Any] = ["ground", *(scene.link(f"block{k}") for k in range(10))]
        for k in range(10):
            section = ksd.rectangle(values.get(f"t{k}", 0.4 * mm), values.get(f"w{k}", 15 * mm))
            ends = ((12 * k * mm, 0, 0), (12 * (k + 1) * mm, 0, 0))
            scene.leaf(links[k], links[k + 1], start=ends[0], end=ends[1], section=section, material=STEEL)
        scene.actuate(links[-1], along="y", at=(120 * mm, 0, 0), name="drive")
        return scene

    def job(self) -> ksd.Job:
        """As stiff at its end as stress and force allow, at three poses."""
        return ksd.Job(
            self, vary=self.vary, maximise="support_worst_N_per_m", limits={"stress_MPa": 400, "drive_force_N": 3},
            drive=np.array([0.0, 3.0, 6.0]) * mm,
        )  # fmt: skip


def springs(
    length: float, thickness: float, size: float, material: ksd.Material = STEEL, width: float = 15 * mm
) -> ksd.Mechanism:
    """Two parallel leaf springs, driven along y at the stage; size: of width and spacing."""
    scene = ksd.Mechanism("springs")
    stage = scene.link("stage")
    section = ksd.rectangle(thickness, width * size)
    for y in (0, 30 * mm * size):
        scene.leaf("ground", stage, start=(0, y, 0), end=(length, y, 0), section=section, material=material)
    scene.actuate(stage, along="y", at=(length, 15 * mm * size, 0), name="drive")
    return scene


def crossed(angle: float, thickness: float, size: float) -> ksd.Mechanism:
    """A crossed pivot with a mass on its arm."""
    scene = ksd.Mechanism("crossed")
    arm = scene.link("arm")
    L = 60 * mm * size
    joint = ksd.CrossedPivot(STEEL, length=L, angle=angle, thickness=thickness, width=20 * mm * size)
    placed = scene.join(scene.ground, arm, joint, at=(0, 0, 0), axis="z", toward="x", name="hinge")
    scene.mass(arm, mass=0.3 * size**3, at=(L, 0, 0), inertia=(1e-4 * size**5,) * 3)
    scene.actuate_joint(placed, name="turn")
    return scene


def example(kind: str, size: float, load: float, unit: float) -> ksd.Job:
    """A job of which an answer or rule is infinite, small, or ranges over orders.

    size: of the mechanism; load: factor of limit or stroke; unit: of the target, the rule and the thickness.
    """
    t = mm * size / unit
    if kind == "infinite":
        return ksd.Job(
            lambda thickness: springs(60 * mm * size, thickness * unit, size), vary={"thickness": (0.2 * t, 0.5 * t)},
            maximise={"support_worst_N_per_m": unit}, limits={"stress_MPa": 1e5}, drive=load * mm * size,
        )  # fmt: skip
    if kind == "frequency":
        return ksd.Job(
            lambda angle, thickness: crossed(angle, thickness * unit, size), maximise={"intended_Hz": unit},
            vary={"angle": (0.55, 1.02), "thickness": (0.2 * t, 0.9 * t)}, limits={"stress_MPa": 223 * load},
            turn=[0, 0.12, 0.25],
        )  # fmt: skip
    if kind == "small":
        silicon = ksd.Material(E=160e9, nu=0.22, density=2330)
        return ksd.Job(
            lambda length, thickness: springs(length * unit, thickness * unit, size, silicon),
            vary={"length": (50 * t, 90 * t), "thickness": (0.2 * t, 0.5 * t)}, minimise={"strain_energy_J": unit},
            limits={"support_z_N_per_m": (3e4 * size * load, None)}, drive=load * mm * size,
        )  # fmt: skip

    def euler_margin(p: Mapping[str, float]) -> float:
        inertia = 10 * mm * size * (p["thickness"] * unit) ** 3 / 12
        return unit * (np.pi**2 * STEEL.E * inertia / (0.2 * size) ** 2 - 0.05 * load * size**2)

    return ksd.Job(
        lambda thickness: springs(100 * mm * size, thickness * unit, size, width=10 * mm),
        vary={"thickness": (0.02 * t, 2 * t)}, minimise={"drive_force_N": unit}, rules=[euler_margin], drive=mm * size,
    )  # fmt: skip


def examples() -> list[dict[str, Any]]:
    """Jobs that once ended beside their optimum, at six sizes, limits and units each: the end of one start against those of
    four and designs near it, and the largest relative difference of the design in units of 1e-6 and 1e6."""
    rows = []
    for kind in ("infinite", "frequency", "small", "rule"):
        for size, load in ((1.0, 1.0), (0.005, 0.7), (0.05, 1.3), (0.3, 1.57), (4.0, 0.9), (20.0, 1.1)):
            job = example(kind, size, load, 1.0)
            best = ksd.optimise(job)
            top = ksd.optimise(job, starts=4).merit
            near = float(np.nanmax(designs_around(job, best, 50, 0)[0], initial=-np.inf))
            off = 0.0
            for unit in (1e-6, 1e6):
                other = ksd.optimise(example(kind, size, load, unit)).design
                off = max(
                    off,
                    *(abs(other[n] * (1 if n == "angle" else unit) / v - 1) for n, v in best.design.items()),
                )
            rows.append({
                "kind": kind, "size": size, "load": load, "status": best.status, "merit": best.merit,
                "of four starts": relative_gain(top, best.merit), "near": relative_gain(near, best.merit), "unit": off,
            })  # fmt: skip
            print(rows[-1], flush=True)
    return rows


def fronts(seeds: Iterable[int]) -> list[dict[str, Any]]:
    """Fronts of random jobs against a limit of theirs: points proven, and by how much four starts at a point are better."""
    rows: list[dict[str, Any]] = []
    for seed in seeds:
        if len(rows) == FRONTS:
            break
        job = random_job(seed)
        against = next(
            (c for c, (_, high) in job.limits.items() if np.isfinite(high) and "size" not in c), None
        )
        if against is None:
            continue
        high = job.limits[against][1]
        front = ksd.pareto(job, against=against, points=4, span=(high / 2, high))
        gains = []
        for limit, merit in zip(front.limits.tolist(), front.merits.tolist(), strict=True):
            try:
                gains.append(
                    relative_gain(ksd.optimise(job.limited(against, limit), starts=4, seed=9).merit, merit)
                )
            except KsdError:
                gains.append(np.nan)
        rows.append(
            {"seed": seed, "against": against, "proven": front.proven, "status": front.status, "gains": gains}
        )
        print(rows[-1], flush=True)
    return rows


def costs() -> list[dict[str, Any]]:
    """Values, gradients and CPU time per optimum, and value with gradient over a value, by number of parameters."""
    rows = []
    for count in (1, 4, 10, 20):
        job = Chain(count).job()
        X = job.random(4, seed=1)
        job.slopes(X[0])
        begin = time.process_time()
        for x in X:
            job.values(x)
        value = (time.process_time() - begin) / len(X)
        begin = time.process_time()
        for x in X * 0.999:
            job.values(x)
            job.slopes(x)
        both = (time.process_time() - begin) / len(X)
        begin = time.process_time()
        best = ksd.optimise(job)
        rows.append({
            "parameters": count, "values": best.evaluations, "gradients": best.gradients, "designs": len(best.table),
            "CPU_s": time.process_time() - begin, "status": best.status, "merit": best.merit,
            "value_and_gradient_over_value": both / value,
        })  # fmt: skip
        print(rows[-1], flush=True)
    return rows


def designs_around(
    job: ksd.Job, best: ksd.Optimum | None, near: int, far: int
) -> tuple[np.ndarray, np.ndarray]:
    """Merits of random designs (nan where a limit is not met): near an optimum, and within the bounds."""
    rng = np.random.default_rng(1)
    search = ScaledProblem(job, DesignLog(job), "")
    groups = [list(job.random(far, seed=5)) if far else []]
    if best is not None:
        y = search.scaled(np.array(list(best.design.values())))
        steps = 10 ** rng.uniform(-3, -1.5, (near, 1)) * rng.uniform(-1, 1, (near, len(y)))
        groups.insert(0, [search.unscaled(p) for p in y + steps])
    found = []
    for X in groups:
        merits = np.full(len(X), np.nan)
        if X:
            for k, (x, v, status) in enumerate(zip(X, *job.batch(X), strict=True)):
                good = status == "ok" and not np.isnan(v).any() and (job.margins(v) >= 0).all()
                if good and (job.rule_values(x) >= 0).all() and np.isfinite(job.merit(v)):
                    merits[k] = job.merit(v)
        found.append(merits)
    return (found[0], found[-1]) if best is not None else (np.array([]), found[-1])


def single_merit(job: ksd.Job, design: Mapping[str, float]) -> tuple[float, float]:
    """Merit and least margin to a limit of a design, each pose solved by itself on the reference mesh of a job."""
    fresh = ksd.Job(job.function, **{**job.arguments, "method": "conventional", "mesh": job.mesh})
    (values,), (status,) = fresh.batch(list(design.values()))
    if status != "ok":
        return np.nan, np.nan
    return fresh.merit(values), float(np.min(fresh.margins(values), initial=np.inf))


def _column(name: str) -> str:
    """The limit or parameter that the name of something active is about."""
    column = name.split(" at ")[0].split("[")[0]
    return "size_mm" if column.startswith("size_") else column


def compare_worths(job: ksd.Job, best: ksd.Optimum) -> list[dict[str, Any]]:
    """Worths of all limits that hold an optimum, and of the bound worth most, against optima with it moved by half a
    percent either way."""
    worth: dict[tuple[str, str], float] = {}
    bounds: dict[tuple[str, str], float] = {}
    for name, w in best.held.items():
        column = _column(name)
        if column in (job.arguments["limits"] or {}):
            worth[column, ""] = worth.get((column, ""), 0.0) + w
        elif name.endswith((" at its least", " at its most")) and column in job.vary:
            bounds[column, name.rsplit(" ", 1)[1]] = w
    if bounds:
        most = max(bounds, key=lambda own: bounds[own])
        worth[most] = bounds[most]
    found = []
    for (column, side), w in worth.items():
        merits = []
        for factor in (1.005, 0.995):
            words = {**job.arguments, "mesh": job.mesh}
            if side:
                end = int(side == "most")
                ends = list(job.vary[column])
                if not ends[end]:
                    break
                ends[end] *= factor if (ends[end] > 0.0) == bool(end) else 1 / factor
                words["vary"] = {**job.vary, column: tuple(ends)}
            else:
                v = words["limits"][column]
                is_low = isinstance(v, tuple) and v[1] is None and v[0] is not None and column != "size_mm"
                scale = 1 / factor if is_low else factor
                moved = (
                    tuple(None if e is None else e * scale for e in v) if isinstance(v, tuple) else v * scale
                )
                words["limits"] = {**words["limits"], column: moved}
            start = {n: float(np.clip(v, *words["vary"][n])) for n, v in best.design.items()}
            try:
                merits.append(ksd.optimise(ksd.Job(job.function, **words), start=start).merit)
            except KsdError as reason:
                print("  worth of", column, side, "not compared:", str(reason)[:100])
                break
        if len(merits) < 2:
            continue
        one_sided = [np.log(m / best.merit) / np.log(f) for m, f in zip(merits, (1.005, 0.995), strict=True)]
        own = float(np.log(merits[0] / merits[1]) / np.log(1.005 / 0.995))
        own, *one_sided = (float(v) * (-1 if best.merit < 0 else 1) for v in (own, *one_sided))
        is_kink = any(_column(k) == column for k in best.proof.kinks)
        found.append({
            "limit": " ".join((column, side)).strip(), "worth": w, "re-optimised": own, "one-sided": one_sided,
            "off": abs(own - w) / max(abs(own), 1e-3), "kink": is_kink,
        })  # fmt: skip
    return found


WAYS: dict[str, dict[str, Any]] = {
    "gradient": {},
    "gradient, 4 starts": {"starts": 4},
    "trust-constr": {"method": "trust-constr"},
    "cobyla": {"method": "cobyla"},
    "cma": {"method": "cma"},
}


def one_job(seed: int, near: int, far: int, most: float, *, others: bool) -> dict[str, Any]:
    """Every way on one random job, each optimum against designs near it, and the best of all against random ones.

    most: CPU time [s] of a design above which the job is left; others: whether methods other than the default are tried, if
    the job is not costly.
    """
    try:
        job = random_job(seed)
    except RuntimeError:
        return {"seed": seed}
    begin = time.process_time()
    merits, count = designs_around(job, None, 0, far // 4)[1], far // 4
    cost = (time.process_time() - begin) / count
    if cost > most:
        return {"seed": seed, "left": f"a design takes {cost:.2g} s"}
    if cost > COSTLY:
        near, others = near // 2, False
    else:
        merits, count = designs_around(job, None, 0, far)[1], far
    row: dict[str, Any] = {
        "seed": seed, "family": getattr(job.function, "family", ""), "parameters": len(job.vary),
        "poses": len(job.poses), "job": job._line(), "random": float(np.nanmax(merits, initial=-np.inf)),
        "random designs": count, "near designs": near, "ways": {},
    }  # fmt: skip
    scratch = tempfile.TemporaryDirectory()
    for way, words in list(WAYS.items())[: None if others else 2]:
        if "gradient" in way:
            # the first of four starts is the only one of the way before
            words = {**words, "resume": Path(scratch.name) / "designs.jsonl"}
        begin = time.process_time()
        try:
            best = ksd.optimise(job, **words)
        except KsdError as reason:
            spent = time.process_time() - begin
            row["ways"][way] = {"status": "failed", "why": str(reason)[:200], "CPU_s": spent}
            continue
        spent = time.process_time() - begin
        if way == "gradient, 4 starts":
            spent += row["ways"]["gradient"]["CPU_s"]
        same = [r for r in row["ways"].values() if r.get("design") == best.design]
        around = [same[0]["near_merit"]] if same else designs_around(job, best, near, 0)[0]
        merit, margin = single_merit(best.job, best.design)
        near_merit = float(np.nanmax(around, initial=-np.inf))
        row["ways"][way] = {
            "status": best.status, "merit": best.merit, "values": best.evaluations, "gradients": best.gradients,
            "designs": len(best.table), "CPU_s": spent, "remainder": best.proof.remainder, "design": best.design,
            "near": relative_gain(near_merit, best.merit), "near_merit": near_merit, "held": dict(best.held),
            "single_difference": relative_gain(merit, best.merit), "single_margin": margin,
        }  # fmt: skip
        if way == "gradient" and not seed % 4:
            row["worths"] = compare_worths(job, best)
    scratch.cleanup()
    return row


def summary(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Shares by way: proven, missed without a word, violated, the best found; values and CPU time per optimum."""
    table = {}
    for way in WAYS:
        tried = [r for r in rows if way in r.get("ways", {})]
        pairs = [(r, r["ways"][way]) for r in tried if np.isfinite(r["random"])
                 or any(np.isfinite(w.get("merit", np.nan)) for w in r["ways"].values())]  # fmt: skip
        good = [(r, w) for r, w in pairs if w["status"] != "failed"]
        if not good:
            continue
        found = 0
        for r, w in good:
            top = max([v["merit"] for v in r["ways"].values() if "merit" in v] + [r["random"]])
            found += relative_gain(top, w["merit"]) <= SAME_MERIT
        table[way] = {
            "jobs": len(pairs), "failed": len(pairs) - len(good),
            "optimum": sum(w["status"] == "optimum" for _, w in good),
            "no better neighbour": sum(w["status"].startswith("no better") for _, w in good),
            "stopped": sum(w["status"] == "stopped" for _, w in good),
            "missed near, untold": sum(w["near"] > SAME_MERIT and w["status"] == "optimum" for _, w in good),
            "violated": sum(w["single_margin"] < -MET for _, w in good),
            "best of all": found, "values": float(np.mean([w["values"] for _, w in good])),
            "CPU_s": float(np.mean([w["CPU_s"] for _, w in good])),
        }  # fmt: skip
    worths = [w for r in rows for w in r.get("worths", ())]
    table["worths"] = {
        "compared": len(worths), "within 5 %": sum(w["off"] <= 0.05 for w in worths),
        "named as kinks": sum(w["off"] > 0.05 and w["kink"] for w in worths),
    }  # fmt: skip
    return table


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Run, print, write; returns what was found."""

    def more(parser: Any) -> None:
        for name, default in (("jobs", 200), ("first", 0), ("near", 30), ("far", 100), ("minutes", 600)):
            parser.add_argument(f"--{name}", type=int, default=default)
        parser.add_argument("--cost", type=float, default=np.inf)

    asked = parse_options(__doc__, argv, more)
    first, count, near, far = (
        (6, 1, 4, 4) if asked.quick else (asked.first, asked.jobs, asked.near, asked.far)
    )
    end, file = time.monotonic() + 60 * asked.minutes, asked.out / "optima.jsonl"
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.is_file() else []
    done = {row["seed"] for row in rows}
    # jobs since the other methods were tried
    waited = EVERY
    for seed in range(first, first + count):
        waited += 1
        if seed in done or time.monotonic() > end:
            continue
        others = waited > EVERY and not asked.quick
        row = one_job(seed, near, far, asked.cost, others=others)
        if "left" in row:
            print(seed, row["left"], flush=True)
            continue
        waited = 0 if len(row.get("ways", {})) > 2 else waited
        rows.append(row)
        with file.open("a") as stream:
            stream.write(json.dumps(row) + "\n")
        said = {
            w: f"{r['status']} {r.get('merit', np.nan):.6g} near {r.get('near', np.nan):+.1e}"
            for w, r in row.get("ways", {}).items()
        }
        print(
            seed,
            row.get("family"),
            row.get("job", "")[:50],
            said,
            [f"{w['limit']} {w['worth']:.3g} {w['re-optimised']:.3g}" for w in row.get("worths", ())],
            flush=True,
        )
    found: dict[str, Any] = {
        "machine": machine(),
        "summary": summary(rows),
        "examples": [] if asked.quick else examples(),
        "fronts": [] if asked.quick else fronts(r["seed"] for r in rows if r.get("family")),
        "cost": [] if asked.quick else costs(),
        "jobs": rows,
    }
    for way, shares in found["summary"].items():
        print(way, shares)
    write_json(found, asked.out / "optima.json")
    return found


if __name__ == "__main__":
    main()
