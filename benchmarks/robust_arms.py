"""Open chains under attack: random arms of all joint families with any drives; prints what was wrong or refused.

    python benchmarks/robust_arms.py [--arms 500] [--targets 25] [--seed 0]

Each arm of one to six joints, driven at all joints, at some, or at its tip, is solved by every method that knows its kind
(the five steps are asked where every joint is driven). Its drive stiffness is put against fourth-order differences of
solves, drive and support stiffness against partial pivoting with refinement in extended precision, frequencies and buckling
multipliers against all eigenvalues in the span of the free motions. Then three joints in series, the first two universal,
at random targets.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT)]

import random_arms as arms  # noqa: E402

import ksd  # noqa: E402
from ksd.errors import KsdError, TrustError  # noqa: E402

METHODS = ("reduced", "full", "conventional")
ERROR_LIMITS = {"differences": 1e-4, "pivoting": 1e-6, "frequencies": 1e-6, "buckling": 1e-6}
"""Errors beyond which an answer counts as wrong."""


def answer_errors(found: ksd.Configuration, tip: str) -> dict[str, Callable[[], float]]:
    """Errors of the answers to each question."""
    return {
        "differences": lambda: arms.stiffness_error(found),
        "pivoting": lambda: max(arms.pivoted_errors(found, tip)),
        "frequencies": lambda: arms.frequency_error(found),
        "buckling": lambda: arms.buckling_error(found),
    }


def check_arms(count: int, seed: int) -> int:
    """Returns how many answers were wrong or refused as singular."""
    worst, tally, buckled = dict.fromkeys(ERROR_LIMITS, 0.0), Counter[str](), 0
    for k in range(seed, seed + count):
        arm = arms.random_arm(np.random.default_rng(k))
        freedoms = sum(len(p.joint.motions) for p in arm.scene.scene().joints)
        determined = len(arm.targets) == freedoms and "tip" not in " ".join(arm.targets)
        for method in METHODS if determined else ("conventional",):
            found = arms.solved(arm.scene, arm.targets, method=method)
            if isinstance(found, TrustError) and arms.no_minimum(found):
                buckled += 1
            elif isinstance(found, KsdError):
                tally[f"{method} refused"] += 1
                print(f"arm {k}: {method}: {found}", flush=True)
        if isinstance(found, KsdError):
            continue
        for name, question in answer_errors(found, arm.tip).items():
            try:
                error = question()
            except (KsdError, np.linalg.LinAlgError) as refusal:
                tally["refused as singular"] += 1
                print(f"arm {k}: {name}: {refusal}", flush=True)
                continue
            worst[name] = max(worst[name], error)
            if not error <= ERROR_LIMITS[name]:
                tally[f"{name} wrong"] += 1
                print(f"arm {k}: {name} off by {error:.1e}", flush=True)
    print(f"{count} arms: {dict(tally) or 'nothing wrong, nothing refused'}")
    print(
        f"rightly refused, driven into a stiff direction until they buckle, counted with pivoting: {buckled}"
    )
    print("largest errors: " + ", ".join(f"{name} {error:.1e}" for name, error in worst.items()))
    return sum(tally.values())


def check_series(count: int, seed: int) -> int:
    """Three joints in series, the first two universal, every axis driven: refusals by any method or mesh."""
    refused = 0
    for third in arms.FAMILIES:
        rng = np.random.default_rng(seed)
        for _ in range(count):
            arm = arms.series(rng, ("universal", "universal", third))
            for mesh in (ksd.Mesh(), ksd.Mesh("corotational", elements=1)):
                for method in METHODS:
                    found = arms.solved(arm.scene, arm.targets, method=method, mesh=mesh)
                    if isinstance(found, KsdError):
                        refused += 1
                        print(f"two universal joints and {third}, {mesh}, {method}: {found}", flush=True)
    print(
        f"two universal joints and one of {len(arms.FAMILIES)} families, {count} targets each: {refused} refused"
    )
    return refused


def main() -> int:
    """Returns the number of wrong or refused answers."""
    words = argparse.ArgumentParser()
    words.add_argument("--arms", type=int, default=500)
    words.add_argument("--targets", type=int, default=25)
    words.add_argument("--seed", type=int, default=0)
    told = words.parse_args()
    return check_arms(told.arms, told.seed) + check_series(told.targets, told.seed)


if __name__ == "__main__":
    sys.exit(main() > 0)
