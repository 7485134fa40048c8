"""Numbers of sixty scenes by all methods, with all questions and refusals: the same before and after a change of structure.

    python benchmarks/pin.py before.json            write the numbers of this state
    python benchmarks/pin.py before.json after.json  compare two files, to rounding

Times are thread CPU medians: a prepared solve, and a new design (the scene drawn, prepared and solved).
"""

from __future__ import annotations

import json
import statistics
import sys
import warnings
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import ksd
from ksd.numerics.stopwatch import Stopwatch

TESTS = Path(__file__).resolve().parents[1] / "tests"
sys.path[:0] = [str(TESTS), str(TESTS / "validation")]

from hard_bank import CASES  # noqa: E402
from planar_scenes import indexer, slider  # noqa: E402
from random_arms import random_arm  # noqa: E402
from scenes import STEEL, fourbar  # noqa: E402
from scenes import slider as guide_and_wheel  # noqa: E402

METHODS = ("kinematic", "reduced", "full", "conventional", "modal", "constant")
SHIPPED = Path(ksd.__file__).parent / "scenes"
HARD = (
    "fourbar, 250 N", "fourbar, moment 200 Nm", "dead centre, d = 0.34", "10 mrad askew", "turned at random", "1 km away",
    "micrometres", "units along z at 45", "75 degrees at once", "1 elements, 90", "springs of 0.03 mm", "roll-up, 1 turns",
    "PL^2/EI = 5", "coincident", "0.95 of its Euler", "right-angle frame at 0.95", "own weight, 0.97", "a quarter of its",
    "Beck's column, 0.99", "normal to the tip", "guided leaf, 0.6 L", "corner of two", "Sarrus", "a link that nothing",
    "arm of three c", "arm of three infinity", "arm of three universal", "three points", "1 : 100, moved",
    "thick leaf, 1 : 3",
)  # fmt: skip
"""Parts of the names of the hard cases that are taken."""
TOLERANCE = 1e-6
"""Largest change relative to the largest number of an answer; estimates of errors, small differences, change by more."""
SLOW = {
    "frequencies",
    "freed",
    "response",
    "buckling",
    "load buckles",
    "internal stress",
    "left out",
    "verify",
}
"""Questions that are asked at the answers of the conventional method only."""
ESTIMATES = {"estimate", "left out", "verify"}
QUESTIONS: dict[str, Callable[[Any, str], Any]] = {
    "forces": lambda c, _: (c.forces, c.reactions),
    "links": lambda c, _: c.links,
    "motions": lambda c, _: (c.motions, c.unintended),
    "stiffness": lambda c, link: c.stiffness(link).elastic,
    "drive stiffness": lambda c, _: c.drive_stiffness().matrix,
    "frequencies": lambda c, _: c.frequencies().frequency_Hz,
    "freed": lambda c, _: c.frequencies(freed=tuple(c.targets), dense=True).frequency_Hz,
    "response": lambda c, _: c.response((1.0, 30.0), freed=tuple(c.targets)).gain,
    "buckling": lambda c, _: c.buckling(),
    "load buckles": lambda c, link: c.buckling(link, force=(0.0, 0.0, 1.0)),
    "stress": lambda c, _: {n: s.von_mises_Pa for n, s in c.stress().leaves.items()},
    "energy": lambda c, _: c.strain_energy(),
    "internal stress": lambda c, _: c.internal_stress().stress_Pa,
    "interface forces": lambda c, _: c.interface_forces(),
    "link forces": lambda c, _: c.link_forces(),
    "parasitic": lambda c, link: c.parasitic(link),
    "extent": lambda c, _: c.extent(),
    "clearance": lambda c, _: c.clearance().distance,
    "section forces": lambda c, _: c.section_forces(points=5),
    "shape": lambda c, _: c.shape(points=5),
    "verify": lambda c, _: c.verify(),
    "gradient": lambda c, _: c.gradient(lambda pose: pose.forces),
    "estimate": lambda c, _: None if c.error is None else c.error.relative,
    "left out": lambda c, _: c.left_out,
    "trust": lambda c, _: " ".join([str(c.stable), str(c.trusted), c.branch]),
}


def scenes() -> dict[str, Callable[[], tuple[Any, Mapping[str, float], dict[str, Any]]]]:
    """Functions that draw a scene: (mechanism, drive values, options of `prepare`), by name."""
    found: dict[str, Any] = {}
    for case in CASES:
        if any(part in case.name for part in HARD) and case.path is None:
            found[case.name] = lambda c=case: (c.build(), c.targets, {"mesh": c.mesh})
    for path in sorted(SHIPPED.glob("*.toml")):
        if "job" not in path.name:
            found[path.stem] = lambda p=path: (*ksd.load_scene(p)[:2], {})
    for seed in range(5):
        found[f"random arm {seed}"] = lambda s=seed: (*random_arm(np.random.default_rng(s), joints=2)[:2], {})
    for name, value in (("fourbar", 0.1), ("fourbar far", 0.3)):
        found[name] = lambda d=value: (fourbar(), {"top": d}, {})
        found[f"{name} in space"] = lambda d=value: (fourbar(), {"top": d}, {"planar": False})
        chains = ksd.Mesh("corotational", elements=4)
        found[f"{name} of chains"] = lambda d=value, m=chains: (fourbar(), {"top": d}, {"mesh": m})
    found["slider-crank"] = lambda: (slider(0.5), {"d": 0.01}, {})
    found["indexer"] = lambda: (indexer(), {"d": 0.001}, {})
    found["guide and wheel"] = lambda: (guide_and_wheel(), {"stroke": 0.004, "turn": 0.1}, {})
    for planar in (True, False):
        for flag in ("springs", "heavy", "everything"):
            name = f"fourbar with {flag}{'' if planar else ' in space'}"
            found[name] = lambda f=flag, p=planar: (furnished(f, planar=p), {"top": 0.1}, {})
    return found


def furnished(flag: str, *, planar: bool) -> Any:
    """The fourbar with springs of every kind, with weight and loads, or with both, an elastic link and an assembly error."""
    scene = fourbar()
    if flag != "heavy":
        scene.spring("ground", "top", start=(0.1, 0.5, 0), end=(0.1, 0.3, 0), stiffness=200.0)
        scene.spring(
            "ground", "left", start=(-0.4, 0.1, 0), end=(-0.2, 0.2, 0), stiffness=90.0, free_length=0.0
        )
        scene.joint_spring("lower left", stiffness=3.0, rest_angle=0.2)
        scene.turn_spring("ground", "right", at=(0.2, 0, 0), axis="z", stiffness=2.0)
    if flag != "springs":
        scene.gravity = (0, -9.81, 0) if planar else (1.0, -9.81, 2.0)
        scene.mass("top", mass=2.0, at=(0, 0.35, 0))
        scene.load(
            "top", force=(3.0, -20.0, 0 if planar else 5.0), at=(0.05, 0.3, 0), following=flag == "everything"
        )
    if flag == "everything":
        scene.compliance("left", section=ksd.rectangle(0.004, 0.03), material=STEEL)
        scene.fit("upper right/inner", shift=(1e-5, 2e-5, 0 if planar else 1e-5))
    return scene


def numbers(answer: Any) -> list[float]:
    """All real numbers in an answer, in order."""
    if isinstance(answer, Mapping):
        return [x for value in answer.values() for x in numbers(value)]
    if isinstance(answer, tuple | list):
        return [x for value in answer for x in numbers(value)]
    if is_dataclass(answer) and not isinstance(answer, ksd.Model):
        return [x for f in fields(answer) for x in numbers(getattr(answer, f.name))]
    if isinstance(answer, np.ndarray | float | np.floating) and np.isrealobj(answer):
        return [float(x) for x in np.ravel(np.asarray(answer, float))]
    return []


def attempt(question: Callable[[], Any]) -> Any:
    """Numbers of an answer, a sentence, or the sentence of a refusal."""
    try:
        answer = question()
    except (ksd.KsdError, ValueError, AttributeError) as reason:
        return f"{type(reason).__name__}: {reason}"
    return answer if isinstance(answer, str) else numbers(answer)


def pinned(draw: Callable[[], Any]) -> dict[str, Any]:
    """Answers and times of one scene, by (method, question)."""
    found: dict[str, Any] = {}
    scene, targets, options = draw()
    try:
        link = _last_link(scene)
    except ksd.KsdError as reason:
        return {"scene": {"refused": f"{type(reason).__name__}: {reason}"}}
    method: Any
    for method in METHODS:
        try:
            solver = ksd.prepare(scene, **options)
            pose = solver(targets, method=method, strict=False)
        except (ksd.KsdError, ValueError) as reason:
            found[method] = {"refused": f"{type(reason).__name__}: {reason}"}
            continue
        found[method] = {
            name: attempt(partial(ask, pose, link))
            for name, ask in QUESTIONS.items()
            if method == "conventional" or name not in SLOW
        }
        found[method]["prepared us"] = _median(partial(solver, targets, method=method, strict=False), 5)
        if method in ("reduced", "full"):
            found[method]["new design us"] = _median(partial(_solve_new, draw, method), 3)
    return found


def _solve_new(draw: Callable[[], Any], method: Any) -> Any:
    scene, targets, options = draw()
    return ksd.prepare(scene, **options)(targets, method=method, strict=False)


def _last_link(scene: Any) -> str:
    return scene.scene().links[-1]


def _median(call: Callable[[], Any], repeats: int) -> float:
    call()
    watch, times = Stopwatch(), []
    for _ in range(repeats):
        watch()
        call()
        times.append(1e6 * watch())
    return statistics.median(times)


def compare(before: Mapping[str, Any], after: Mapping[str, Any]) -> int:
    """Print what differs by more than rounding, and the ratios of times; the number of differences."""
    wrong = 0
    ratios: dict[Any, list[float]] = {}
    for scene, methods in before.items():
        for method, answers in methods.items():
            for question, one in answers.items():
                two = after.get(scene, {}).get(method, {}).get(question)
                if question.endswith(" us"):
                    ratios.setdefault((method, question), []).append(two / one if two else np.nan)
                elif isinstance(one, str) or isinstance(two, str | None) or len(one) != len(two):
                    if one != two:
                        wrong += 1
                        print(f"{scene} | {method} | {question}\n    {_short(one)}\n    {_short(two)}")
                elif one:
                    a, b = np.array(one), np.array(two)
                    same = (a == b) | (np.isnan(a) & np.isnan(b))
                    size = np.abs(a[np.isfinite(a)]).max(initial=0.0)
                    change = np.abs(np.where(same, 0.0, a - b)).max() / (size or 1.0)
                    if not change <= (1e-3 if question in ESTIMATES else TOLERANCE):
                        wrong += 1
                        print(f"{scene} | {method} | {question}: {change:.1e} of {size:.4g}")
    for (method, question), own in sorted(ratios.items()):
        print(f"{method:13} {question:14} median ratio {np.nanmedian(own):.3f} of {len(own)}")
    print(f"{wrong} differences")
    return wrong


def _short(answer: Any) -> str:
    return (
        answer if isinstance(answer, str) else f"{np.size(answer)} numbers" if answer is not None else "none"
    )


def main(paths: list[str]) -> int:
    """Write one file, or compare two."""
    if len(paths) == 2:
        return compare(*(json.loads(Path(p).read_text()) for p in paths)) > 0
    warnings.simplefilter("ignore")
    found = {}
    for name, draw in scenes().items():
        found[name] = pinned(draw)
        Path(paths[0]).write_text(json.dumps(found))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
