"""Random scenes, calls and files by the tens of thousands, and a sample of answers walked again in fine load steps.

    python benchmarks/fuzz.py [--examples 50000] [--sample 200] [--seed 0] [--log FILE.jsonl]

The strategies and rules are those of the tests (`tests/strategies.py`, `tests/fuzzing.py`): every example is answered, or
refused in one sentence; no other error, no warning, no number that is none, nothing that hangs. An answer of the sample
is confirmed when 32 or 128 load steps, loads along with the drives or after them, or the path of the loads by arc length
end in the same minimum. Every finished batch is a line of the log: the run can be interrupted at any moment and goes on
there when started with the same words. The table goes to `benchmarks/results/fuzz.md`.
"""

from __future__ import annotations

import argparse
import collections
import datetime
import json
import platform
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT)]

import fuzzing  # noqa: E402
import strategies  # noqa: E402
from hypothesis import HealthCheck, Phase, given, seed, settings  # noqa: E402
from scenes import single_joint  # noqa: E402

import ksd  # noqa: E402
from ksd.errors import KsdError  # noqa: E402
from ksd.solvers.branch_check import secant_work  # noqa: E402
from ksd.solvers.conventional import solve_conventional, without_loads_arrays  # noqa: E402
from ksd.solvers.load_steps import state_difference  # noqa: E402

BATCH = 250
"""Examples of a batch, which is logged when it is finished."""
EXACT, NEAR = 1e-4, 2e-2
"""Largest difference (of positions over the size, of rotations as they are) of equal states: exact methods, fast ones."""


class Kind(NamedTuple):
    """Examples of one kind: strategy, what is done with one, share of all, whether it answers with loaded states."""

    strategy: Any
    act: Callable[[Any], Any]
    share: float
    loaded: bool = False


def draw_examples(strategy: Any, count: int, number: int) -> list[Any]:
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


def kinds(folder: Path) -> dict[str, Kind]:
    """All kinds by name."""
    joint = single_joint().scene()

    def solved(case: Any) -> Any:
        return fuzzing.solved(*case)

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
        "leaves": Kind(strategies.leaf_scenes(), solved, 0.25, True),
        "leaf springs, heavy loads": Kind(strategies.leaf_scenes(most_load=200.0), solved, 0.02, True),
        "joints": Kind(strategies.joint_scenes(), solved, 0.13, True),
        "joints, heavy loads": Kind(strategies.joint_scenes(most_load=200.0), solved, 0.02, True),
        "fourbars to 4 kN": Kind(strategies.loaded_fourbars(), solved, 0.03, True),
        "broken calls": Kind(strategies.broken_calls(), lambda c: fuzzing.called(*c), 0.25),
        "broken questions": Kind(strategies.broken_questions(), asked, 0.05),
        "files": Kind(strategies.scene_files, lambda c: fuzzing.loaded(c, folder / "scene.toml"), 0.25),
    }


def loads_last(model: Any, targets: dict[str, float], *, steps: int) -> Any:
    """The state where the drives are moved without loads, in load steps, and the loads applied then."""
    return solve_conventional(model, targets, start=without_loads(model, targets, steps), steps=steps)


def without_loads(model: Any, targets: dict[str, float], steps: int) -> Any:
    """The equilibrium without loads, of `model` with them and a load factor of 0."""
    bare = solve_conventional(replace(model, arrays=without_loads_arrays(model.arrays)), targets, steps=steps)
    return replace(bare, model=model, load_factor=0.0)


def by_arc(model: Any, targets: dict[str, float], *, steps: int) -> Any:
    """The state at the end of the path of the loads, followed by arc length; KsdError where it turns before."""
    start = without_loads(model, targets, steps)
    path = ksd.follow(model, targets, control="load", start=start, first=1.0 / steps)
    if path.turnings or not path.ended:
        passed = [f"{t.kind} at {t.factor:.3g}" for t in path.turnings]
        raise KsdError(f"{', '.join(passed) or 'nothing passed'}; {path.stop}")
    return path.states[-1]


def compare_with_fine_path(found: Any, targets: dict[str, float]) -> tuple[str, str]:
    """("same", "") where a fine walk ends in the minimum `found`; else ("elsewhere" or "unsettled", what walks found).

    Elsewhere: fine walks end in another minimum. Unsettled: none of them ends in a minimum.
    """
    said, verdict = [], "unsettled"
    ways: tuple[Callable[..., Any], ...] = (solve_conventional, loads_last, by_arc)
    for steps in (32, 128):
        for way in ways:
            named = f"{way.__name__}, {steps} steps"
            try:
                walk = way(found.model, targets, steps=steps)
            except (KsdError, np.linalg.LinAlgError) as reason:
                said.append(f"{named}: {reason}"[:160])
                continue
            far = state_difference(found.model, walk.motion, found.motion)
            if far < (EXACT if found.error is None else NEAR) and walk.stable:
                return "same", ""
            verdict = "elsewhere" if walk.stable else verdict
            said.append(f"{named}: {far:.2g} away, {'stable' if walk.stable else 'unstable'}, {walk.forces}")
    return verdict, "; ".join(said)


def is_loaded(found: Any) -> bool:
    """Whether loads are not negligible: hypothesis often draws loads of zero, or of 1e-160."""
    model = found.model
    if (
        not len(model.arrays.loads.node)
        or not np.abs(found.motion.x - model.rest.x).max() > 1e-6 * model.arrays.size
    ):
        return False
    driving, loading = secant_work(model, found.motion, model.targets(found.targets))
    return not abs(loading) <= 1e-6 * (abs(driving) + abs(loading))


def try_examples(kind: Kind, count: int, number: int, picked: int) -> dict[str, Any]:
    """What became of `count` examples of one kind; `picked` of their loaded answers are walked again."""
    counts: collections.Counter[str] = collections.Counter()
    bad, loaded, begin = [], [], time.monotonic()
    for example in draw_examples(kind.strategy, count, number):
        try:
            answer = kind.act(example)
        except Exception as error:
            counts["broken"] += 1
            bad.append(f"{type(error).__name__}: {error} from {example!r}"[:600])
            continue
        counts["answered" if answer else "refused"] += 1
        if isinstance(answer, ksd.Configuration) and is_loaded(answer):
            loaded.append((answer, example[1]))
    spent, doubtful = round(time.monotonic() - begin, 1), []
    chosen = loaded[:: max(1, len(loaded) // max(picked, 1))][:picked]
    for answer, targets in chosen:
        verdict, said = compare_with_fine_path(answer, targets)
        counts[verdict] += 1
        if verdict != "same":
            doubtful.append(f"{verdict}: {answer!r} at {targets}: {said}")
    return {**counts, "seconds": spent, "bad": bad, "doubtful": doubtful}


def plan(examples: int, sample: int, number: int, every: dict[str, Kind]) -> Iterator[dict[str, Any]]:
    """Every batch: kind, count, seed, and how many of its answers are walked again; the kinds take turns."""
    solving = sum(int(k.share * examples) for k in every.values() if k.loaded)
    left = {name: int(kind.share * examples) for name, kind in every.items()}
    turn, owed = 0, 0.0
    while any(left.values()):
        for k, (name, kind) in enumerate(every.items()):
            count = min(BATCH, left[name])
            left[name] -= count
            owed += sample * count / solving if kind.loaded else 0.0
            picked = round(owed) if kind.loaded else 0
            owed -= picked
            if count:
                at = 1_000_003 * number + 1_009 * turn + k
                yield {"kind": name, "count": count, "seed": at, "picked": picked}
        turn += 1


def run(asked: argparse.Namespace, log: Path) -> list[dict[str, Any]]:
    """All batches, those the log already holds read from there."""
    done = {}
    if log.exists():
        lines = [json.loads(line) for line in log.read_text().splitlines() if line.endswith("}")]
        done = {json.dumps(line["batch"]): line for line in lines}
    found = []
    with tempfile.TemporaryDirectory() as name, log.open("a") as out:
        every = kinds(Path(name))
        for batch in plan(asked.examples, asked.sample, asked.seed, every):
            line = done.get(json.dumps(batch))
            if line is None:
                became = try_examples(every[batch["kind"]], batch["count"], batch["seed"], batch["picked"])
                line = {"batch": batch, **became}
                out.write(json.dumps(line) + "\n")
                out.flush()
                print(
                    *line["bad"], *line["doubtful"], sep="\n", end="\n" * bool(line["bad"] + line["doubtful"])
                )
            found.append(line)
    return found


def table(lines: list[dict[str, Any]], asked: argparse.Namespace) -> str:
    """The result as Markdown."""
    columns = ("answered", "refused", "broken", "same", "elsewhere", "unsettled")
    rows: dict[str, collections.Counter[str]] = {}
    for line in lines:
        row = rows.setdefault(line["batch"]["kind"], collections.Counter())
        row.update({c: line.get(c, 0) for c in columns} | {"examples": line["batch"]["count"]})
    rows["all"] = sum(rows.values(), collections.Counter())
    said = [
        f"# {rows['all']['examples']} random scenes, calls and files",
        f"By `python benchmarks/fuzz.py --examples {asked.examples} --sample {asked.sample} --seed {asked.seed}`, "
        f"{datetime.date.today()}, ksd {ksd.__version__}, Python {platform.python_version()}, numpy {np.__version__}, "
        f"{sum(line['seconds'] for line in lines) / 60:.0f} minutes of solving.",
        "answered: with nothing that is no number, and no warning; refused: in one sentence; broken: anything else. Of "
        "answers that loads bend, drawn evenly, same: a fine walk ends in the same minimum; elsewhere: in another one; "
        "unsettled: no fine walk ends in a minimum.",
        "\n".join(
            ["| kind | examples | " + " | ".join(columns) + " |", "|---" + "|---:" * 7 + "|"]
            + [f"| {k} | {r['examples']} | " + " | ".join(str(r[c]) for c in columns) + " |" for k, r in rows.items()]
        ),
        *(f"- {line['batch']['kind']}: {t}" for line in lines for t in line["bad"] + line["doubtful"]),
    ]  # fmt: skip
    return "\n\n".join(said) + "\n"


def main() -> int:
    """Returns how many examples broke a rule, and answers no fine walk confirmed."""
    words = argparse.ArgumentParser()
    words.add_argument("--examples", type=int, default=50_000)
    words.add_argument("--sample", type=int, default=200)
    words.add_argument("--seed", type=int, default=0)
    words.add_argument("--log", type=Path, default=None)
    words.add_argument("--out", type=Path, default=ROOT / "benchmarks" / "results" / "fuzz.md")
    asked = words.parse_args()
    log = asked.log or asked.out.with_suffix(".jsonl")
    lines = run(asked, log)
    asked.out.write_text(table(lines, asked))
    print(table(lines, asked))
    return sum(len(line["bad"]) + len(line["doubtful"]) for line in lines)


if __name__ == "__main__":
    sys.exit(main())
