"""Scenes, timing and results files shared by the benchmark scripts.

All times are thread CPU times of this process. Compared cases are timed in turns, so that other load of the machine affects
all of them alike; the first rounds (compilation, caches) are not counted.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import json
import math
import random
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from bench_scenes import EPS_MAX_VALUES, STEEL

import ksd
from ksd.cli.bench import machine_facts
from ksd.files import write_file
from ksd.model.mesh import Mesh
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.storage import NewtonStorage
from ksd.units import deg, mm
from ksd.view.figure import new_figure, plain_axes

RESULTS = Path(__file__).resolve().parent / "results"
STROKE = 0.3
"""Largest displacement d [m] of the fourbar's top link."""
READINGS = {1: "H between joint centres", 2: "H is the side link"}
"""The two interpretations of Fig. 9 of paper 1, which is lost."""


def cross_flexure(**changes: Any) -> ksd.CrossFlexure:
    """The joint of paper 1, Table 1, with changes."""
    sizes = {"length": 100 * mm, "angle": 45 * deg, "thickness": 1 * mm, "widths": (40 * mm, 20 * mm)}
    return ksd.CrossFlexure(**{"material": STEEL, **sizes, **changes})


def bending_stiffness(joint: ksd.CrossFlexure) -> float:
    """E I_sum / L [Nm/rad], the linear stiffness of a cross flexure (paper 1, eqs. 4.3 and 4.4; errata 1)."""
    inner, outer = joint.widths
    return joint.material.E * (inner + 2 * outer) * joint.thickness**3 / 12 / joint.length


def hinge(joint: ksd.CrossFlexure | None = None, *, force: float = 0.0) -> ksd.Mechanism:
    """One joint from ground to the link 'tip', driven by its angle 'turn'; `force` [N] on node B along z."""
    joint = joint or cross_flexure()
    scene = ksd.Mechanism("cross flexure")
    tip = scene.link("tip")
    placed = scene.join(scene.ground, tip, joint, at=(0, 0, 0), axis="z", toward="x", name="hinge")
    scene.actuate_joint(placed, name="turn")
    if force:
        scene.load(tip, force=(0, 0, force), at=joint.pose_B)
    return scene


def height(reading: int) -> float:
    """Height [m] between the lower and the upper joint centres of the fourbar."""
    return STROKE if reading == 1 else STROKE + cross_flexure().length_AB


def fourbar(reading: int = 1, *, moment: float = 0.0) -> ksd.Mechanism:
    """The fourbar of paper 1, section 4.3, with a `moment` [Nm] about z on the top link.

    Driven in x at the centre of the top link, at the level of the upper interfaces B.
    """
    joint, high = cross_flexure(), height(reading)
    scene = linkage([joint] * 4, high)
    scene.actuate("top", along="x", at=(0, high + joint.length_AB, 0))
    if moment:
        scene.load("top", moment=(0, 0, moment))
    return scene


def linkage(
    joints: Sequence[ksd.Joint], high: float, *, half: float = 0.2, low: float = 0.0
) -> ksd.Mechanism:
    """Four joints that carry the link 'top' on the links 'left' and 'right', not driven.

    joints: lower left, upper left, upper right, lower right, at -`half` and `half` along x; the lower ones at `low` along
    y, the upper ones `high` above them [m].
    """
    scene = ksd.Mechanism("fourbar")
    left, top, right = scene.links("left", "top", "right")
    places = (
        (scene.ground, left, (-half, low, 0), "lower left"), (left, top, (-half, low + high, 0), "upper left"),
        (right, top, (half, low + high, 0), "upper right"), (scene.ground, right, (half, low, 0), "lower right"),
    )  # fmt: skip
    for joint, (a, b, at, name) in zip(joints, places, strict=True):
        scene.join(a, b, joint, at=at, axis="z", toward="y", name=name)
    return scene


def element_mesh(n: int, *, mip: bool = True, nodal: bool = False) -> Mesh:
    """`n` Appendix A elements per leaf."""
    return Mesh("corotational", elements=n, mip=mip, nodal=nodal)


class PlainNewton:
    """The conventional method of paper 1, Appendix B, with the eps_max best for it at the given drive values.

    Plain Newton on all element nodes (`nodal`) or on the condensed chains, or with mixed integration points (`mip`);
    a step is given up when the residual exceeds eps_max, and halved; in space as in the paper, or in the plane
    (`planar`). Every converged state is accepted, as in the paper. eps_max is chosen once, from EPS_MAX_VALUES, by the
    number of factorisations among those that end in the state found with the smallest. `scene` may be a compiled
    model, which is then solved as it is. Raises ConvergenceError when none converges.
    """

    def __init__(
        self,
        scene: Any,
        n: int,
        targets: Mapping[str, float],
        *,
        nodal: bool = True,
        planar: bool = False,
        mip: bool = False,
    ) -> None:
        self.planar = planar
        compiled = isinstance(scene, ksd.Model)
        self.model = (
            scene if compiled else ksd.compile_scene(scene, mesh=element_mesh(n, mip=mip, nodal=nodal))
        )
        self.targets, self.storage = dict(targets), NewtonStorage(self.model)
        self.tried: dict[float, int | None] = {}
        first: np.ndarray | None = None
        for eps_max in EPS_MAX_VALUES:
            try:
                found = self(eps_max)
            except ksd.ConvergenceError:
                self.tried[eps_max] = None
                continue
            forces = np.array(list(found.forces.values()))
            first = forces if first is None else first
            same = np.allclose(forces, first, rtol=1e-6, atol=1e-9)
            self.tried[eps_max] = found.iterations if same else None
        if first is None:
            raise ksd.ConvergenceError("plain Newton converged for no eps_max", reached=0.0)
        right = {e: k for e, k in self.tried.items() if k is not None}
        self.eps_max = min(right, key=lambda e: right[e])

    def __call__(
        self, eps_max: float | None = None, targets: Mapping[str, float] | None = None
    ) -> ksd.Configuration:
        """Solve from rest; limits of iterations and turns leave the decisions to eps_max, as in the paper."""
        limit = self.eps_max if eps_max is None else eps_max
        # a finite limit also switches off the load steps that confirm a doubtful branch, which the paper does not have
        return solve_conventional(
            self.model,
            self.targets if targets is None else targets,
            eps_max=min(limit, 1e300),
            max_iterations=60,
            max_turn=math.inf,
            planar=self.planar,
            storage=self.storage,
        )


@dataclass(frozen=True)
class Times:
    """Median of the interleaved repeats [us], their quartiles, and how many there were."""

    median: float
    low: float
    high: float
    repeats: int

    def numbers(self) -> dict[str, Any]:
        """For JSON."""
        return {"median_us": self.median, "quartiles_us": [self.low, self.high], "repeats": self.repeats}


def summarise_times(spent: Sequence[float]) -> Times:
    """Median, quartiles and number of times [us]."""
    low, _, high = statistics.quantiles(spent, n=4) if len(spent) > 1 else (spent[0],) * 3
    return Times(statistics.median(spent), low, high, len(spent))


def thread_us(call: Callable[[], Any]) -> float:
    """Thread CPU time [us] of one call."""
    begin = time.thread_time_ns()
    call()
    return 1e-3 * (time.thread_time_ns() - begin)


def times_in_turns(
    cases: Mapping[str, Callable[[], Any]], *, repeats: int, warm: int = 2
) -> dict[str, list[float]]:
    """Thread times [us] of every case, measured in turns: each case once a round, `warm` rounds not counted.

    The order changes from round to round, since a case takes less after one that has left the same code in the caches.
    """
    spent: dict[str, list[float]] = {name: [] for name in cases}
    order, shuffled = list(cases), random.Random(1)
    for n in range(warm + repeats):
        for name in order:
            took = thread_us(cases[name])
            if n >= warm:
                spent[name].append(took)
        shuffled.shuffle(order)
    return spent


def time_in_turns(cases: Mapping[str, Callable[[], Any]], *, repeats: int, warm: int = 2) -> dict[str, Times]:
    """`times_in_turns` of every case, summarised."""
    spent = times_in_turns(cases, repeats=repeats, warm=warm)
    return {name: summarise_times(values) for name, values in spent.items()}


def machine() -> dict[str, Any]:
    """Date, processor, load and versions, without anything that identifies the computer."""
    return {**machine_facts(), **{package: version(package) for package in ("scipy", "matplotlib")}}


def machine_line(found: Mapping[str, Any]) -> str:
    """Date, processor, versions, and the load of the machine where other programs ran, in one line."""
    versions = ", ".join(f"{name} {found[name]}" for name in ("ksd", "python", "numpy", "numba"))
    load = (
        f", beside other programs (load average {found['load_average']:g})"
        if found["load_average"] > 2.0
        else ""
    )
    return f"{found['date']}, one thread of {found['processor']}, {versions}{load}"


def json_value(value: Any) -> Any:
    """Plain Python numbers and lists for strict JSON; numbers that are not finite become None."""
    if isinstance(value, Mapping):
        return {str(k): json_value(v) for k, v in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [json_value(v) for v in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


def write_json(found: Mapping[str, Any], path: Path) -> None:
    """Write `found` to `path`, one rounded number per value."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(json_value(found), indent=1) + "\n")


def parse_options(
    text: str, argv: Sequence[str] | None, *more: Callable[[argparse.ArgumentParser], Any]
) -> Any:
    """Parsed options of a script: --quick and --out, which every script has, and those that `more` add."""
    parser = argparse.ArgumentParser(description=text.strip().splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a small subset, in seconds")
    parser.add_argument("--out", type=Path, default=RESULTS, help="where results go (benchmarks/results)")
    for add in more:
        add(parser)
    found = parser.parse_args(argv)
    found.out.mkdir(parents=True, exist_ok=True)
    return found


def numbers_file(picture_path: Path, name: str) -> Path:
    """The file of numbers in the folder of a picture, or the stored one where there is none."""
    beside = picture_path.with_name(name)
    return beside if beside.exists() else RESULTS / name


def save_picture(figure: Any, path: Path, *, numbers: Path | None = None) -> None:
    """Write a picture (.png) that holds name and SHA-256 of the file of its numbers, as its text `Numbers`.

    numbers: by default the file of the same name in its folder, or the stored one.
    """
    numbers = numbers or numbers_file(path, path.with_suffix(".json").name)
    write_file(path, png_with_digest(figure, numbers), what="picture")


def png_with_digest(figure: Any, numbers: Path) -> bytes:
    """Content of a picture (.png) that holds name and SHA-256 of the file of its numbers."""
    digest = hashlib.sha256(numbers.read_bytes()).hexdigest()
    content = io.BytesIO()
    figure.savefig(content, format="png", metadata={"Numbers": f"{numbers.name} {digest}"})
    return content.getvalue()


def figure_grid(rows: int, columns: int, *, size: tuple[float, float], title: str) -> tuple[Any, np.ndarray]:
    """A figure with rows x columns axes, each `size` inches, and its title; needs no display."""
    figure: Any = new_figure(columns * size[0], rows * size[1], dpi=140)
    figure.suptitle(f"{title}\ncomputed by ksd", fontsize=10)
    axes = figure.subplots(rows, columns, squeeze=False)
    for a in axes.flat:
        plain_axes(a)
        a.tick_params(labelsize=8)
    return figure, axes


def label_axes(axes: Any, *, x: str, y: str, title: str = "", legend: bool = True, **where: Any) -> None:
    """Axis labels, a small title and a legend."""
    axes.set_xlabel(x, fontsize=9)
    axes.set_ylabel(y, fontsize=9)
    axes.set_title(title, fontsize=9, loc="left")
    if legend:
        axes.legend(**{"fontsize": 7.5, "frameon": False, **where})
