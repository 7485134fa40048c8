"""Random scenes, calls and files by the tens of thousands, and a sample of answers walked again in fine load steps.

    python benchmarks/fuzz.py [--examples 50000] [--sample 200] [--seed 0] [--out FILE.json]

The strategies and rules are those of the tests (`tests/strategies.py`, `tests/fuzzing.py`): every example is answered, or
refused in one sentence; no other error, no warning, no number that is none, nothing that hangs. Of the sample, an answer
is confirmed when 32 or 128 load steps, loads along with the drives or after them, end in the same minimum.
"""

from __future__ import annotations

import argparse
import collections
import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT)]

import fuzzing  # noqa: E402
import strategies  # noqa: E402
from hypothesis import HealthCheck, Phase, given, seed, settings  # noqa: E402
from scenes import single_joint  # noqa: E402

import ksd  # noqa: E402
from ksd.errors import KsdError  # noqa: E402
from ksd.solve.confirm import difference  # noqa: E402
from ksd.solve.conventional import conventional, loads_last  # noqa: E402

BATCH = 1000
EXACT, NEAR = 1e-4, 2e-2
"""Largest difference (of positions over the size, of rotations as they are) of equal states: exact methods, fast ones."""


def drawn(strategy: Any, count: int, number: int) -> list[Any]:
    """`count` examples of a strategy, others for every seed `number`."""
    found: list[Any] = []

    @seed(number)
    @settings(max_examples=count, deadline=None, database=None, suppress_health_check=list(HealthCheck),
              phases=[Phase.generate])  # fmt: skip
    @given(strategy)
    def collect(example: Any) -> None:
        found.append(example)

    collect()
    return found


def batches(strategy: Any, count: int, number: int) -> Iterator[Any]:
    """The same in batches, so that not all are held at once."""
    for k in range(0, count, BATCH):
        yield from drawn(strategy, min(BATCH, count - k), 1_000_003 * number + k)


def kinds(folder: Path) -> dict[str, tuple[Any, Callable[[Any], Any], float]]:
    """By name: strategy, what is done with an example, share of all examples."""
    joint = single_joint().scene()

    def asked(words: dict[str, Any]) -> Any:
        with fuzzing.strictly():
            try:
                found = ksd.solve(joint, **{"turn": 0.3, **words})
            except KsdError as error:
                fuzzing.is_sentence(error)
                return None
            fuzzing.check_answer(found)
            return found

    return {
        "leafs": (strategies.leaf_scenes(), lambda c: fuzzing.solved(*c), 0.25),
        "leafs, heavy loads": (strategies.leaf_scenes(most_load=200.0), lambda c: fuzzing.solved(*c), 0.02),
        "joints": (strategies.joint_scenes(), lambda c: fuzzing.solved(*c), 0.13),
        "joints, heavy loads": (strategies.joint_scenes(most_load=200.0), lambda c: fuzzing.solved(*c), 0.02),
        "fourbars to 4 kN": (strategies.loaded_fourbars(), lambda c: fuzzing.solved(*c), 0.03),
        "broken calls": (strategies.broken_calls(), lambda c: fuzzing.called(*c), 0.25),
        "broken questions": (strategies.broken_questions(), asked, 0.05),
        "files": (strategies.scene_files, lambda c: fuzzing.loaded(c, folder / "scene.toml"), 0.25),
    }


def confirmed(found: Any, targets: dict[str, float]) -> str:
    """Nothing where fine load steps end in the same minimum, else what they found."""
    said = []
    for way in (conventional, loads_last):
        for steps in (32, 128):
            try:
                walk = way(found.model, targets, steps=steps)
            except KsdError as reason:
                said.append(f"{way.__name__}, {steps} steps: {reason}"[:120])
                continue
            far = difference(found.model, walk.motion, found.motion)
            if far < (EXACT if found.error is None else NEAR) and walk.stable:
                return ""
            said.append(f"{way.__name__}, {steps} steps: {far:.2g} away, {walk.forces}")
    return "; ".join(said)


def main() -> int:
    """Returns how many examples broke a rule, and answers no fine walk confirmed."""
    words = argparse.ArgumentParser()
    words.add_argument("--examples", type=int, default=50_000)
    words.add_argument("--sample", type=int, default=200)
    words.add_argument("--seed", type=int, default=0)
    words.add_argument("--out")
    asked = words.parse_args()
    table, bad, sample = {}, [], []
    with tempfile.TemporaryDirectory() as name:
        for kind, (strategy, act, share) in kinds(Path(name)).items():
            counts, begin = collections.Counter(), time.monotonic()
            for example in batches(strategy, int(share * asked.examples), asked.seed):
                try:
                    answer = act(example)
                except Exception as error:
                    counts["broken"] += 1
                    bad.append(f"{kind}: {type(error).__name__}: {error} from {example!r}"[:600])
                    continue
                counts["answered" if answer else "refused"] += 1
                if isinstance(answer, ksd.Configuration) and len(answer.model.arrays.loads.node):
                    sample.append((kind, answer, example[1]))
            table[kind] = {**counts, "seconds": round(time.monotonic() - begin, 1)}
            print(f"{kind:22}", dict(table[kind]), flush=True)
        step = max(1, len(sample) // max(asked.sample, 1))
        chosen = sample[::step][: asked.sample]
        doubtful = [f"{k}: {a!r}: {said}" for k, a, t in chosen if (said := confirmed(a, t))]
        print(
            f"of {len(chosen)} loaded answers {len(chosen) - len(doubtful)} were confirmed by fine load steps"
        )
    print(*bad, *doubtful, sep="\n")
    if asked.out:
        result = {
            "seed": asked.seed,
            "examples": table,
            "sample": len(chosen),
            "unconfirmed": doubtful,
            "broken": bad,
        }
        Path(asked.out).write_text(json.dumps(result, indent=1) + "\n")
    return len(bad) + len(doubtful)


if __name__ == "__main__":
    sys.exit(main())
