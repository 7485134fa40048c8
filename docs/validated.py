"""The page of published and independent numbers: each beside ksd's own, asked when the site is built."""

from __future__ import annotations

import runpy
import sys
from functools import cache, partial
from itertools import groupby
from pathlib import Path
from typing import Any

import ksd

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests" / "validation"), str(ROOT / "tests")]

from figures import SAID  # noqa: E402  (beside this file)
from hard_bank import CASES  # noqa: E402
from motion_scenes import CASES as MOTIONS  # noqa: E402
from published_bank import ROWS, Number  # noqa: E402

HEAD = (
    "| what | published or independent | ksd | difference | tolerance | source |\n"
    "|---|---:|---:|---:|---:|---|"
)


def of_examples() -> list[Number]:
    """Numbers that the scripts of `examples/`, run for the gallery, end in, and that have a source of their own."""
    found = []
    for name, answers in runpy.run_path(str(ROOT / "tests" / "test_examples.py"))["NUMBERS"].items():
        own = SAID[name]
        title = (ROOT / "examples" / f"{name}.py").read_text().splitlines()[0].strip('".')
        for answer, (value, within, source) in answers.items():
            said = float(own[answer])
            group = f"Example `{name}`: {title}"
            found.append(Number(group, f"`{answer}`", "SI", value, source, within, lambda said=said: said))
    return found


INDEPENDENT = ("closed form", "planar rod", "exact rod", "exact planar rod", "elliptic integrals")
"""How the sources of hard cases begin that are no finer run of ksd itself."""


def of_hard_cases() -> list[Number]:
    """The hard cases with an answer from elsewhere; straight states of zero displacement left out."""
    found = []
    for case in CASES:
        if case.answer is None or case.path is not None or not case.verified.startswith(INDEPENDENT):
            continue

        @cache
        def own(case: Any = case) -> Any:
            return case.value(ksd.solve(case.build(), case.targets, mesh=case.mesh))

        for k, value in enumerate(case.answer):
            if abs(value) > 0.0:
                what = case.name + (f", number {k + 1}" if len(case.answer) > 1 else "")
                group, ask = "Hard cases", partial(lambda own, k: float(own()[k]), own, k)
                found.append(Number(group, what, "", float(value), case.verified, case.tolerance, ask))
    return found


def line(row: Number) -> str:
    """A row of the table. Raises ValueError where ksd is off by more than the tolerance, as the tests do."""
    unit = f" [{row.unit}]" if row.unit else ""
    head = f"| {row.what}{unit} | {row.value:.10g} |"
    try:
        own = row.ask()
    except ksd.KsdError:
        return f"{head} refused | | {row.within:.0e} | {row.source} |"
    off = abs(own - row.value) / (abs(row.value) or 1.0)
    if not off <= row.within:
        raise ValueError(f"{row.group}: {row.what} is {own}, {row.source} has {row.value}")
    unit = f" [{row.unit}]" if row.unit else ""
    return (
        f"| {row.what}{unit} | {row.value:.10g} | {own:.9g} | {off:.1e} | {row.within:.0e} | {row.source} |"
    )


def of_motions() -> str:
    """A table of motions in time: errors over the step. Raises ValueError where one is too large."""
    rows = []
    for case in MOTIONS.values():
        runs = [case.found(dt) for dt in case.steps]
        largest = runs[2][1]
        errors = [case.errors(found, largest) for found, _ in runs]
        refined = case.errors((4.0 * runs[2][0] - runs[1][0]) / 3.0, largest)
        if refined.max() > case.within:
            raise ValueError(
                f"{case.title}: off by {refined} of the largest values, allowed are {case.within}"
            )
        for k, name in enumerate(case.names):
            over = " | ".join(f"{e[k]:.1e}" for e in (*errors, refined))
            count = sum(values[k] == values[k] for values in case.values.values())
            what = (
                f"{case.title}: {name}, {count} instant{'s' if count > 1 else ''} to {max(case.values):g} s"
            )
            rows.append(f"| {what} | {1e3 * case.steps[0]:g} ms | {over} | {case.within:.0e} |")
    return (
        "## Motion in time\n\nErrors over the step, relative to the largest value, against independent finite elements "
        "extrapolated in step and mesh, most of them confirmed by a second code; *extrapolated* is 4/3 of the last step "
        "less 1/3 of the one before. The values are in `tests/motion_scenes.py`. The leaf springs of the cross flexure "
        "vibrate between their ends, which no step follows for long. The beam in free flight has its rotary inertia on 16 "
        "points; on 33 errors are a third.\n\n"
        "| motion | step | error | half | quarter | extrapolated | tolerance |\n|---|---:|---:|---:|---:|---:|---:|\n"
        + "\n".join(rows)
    )


def write_validated(path: Path) -> None:
    """All numbers in one page of tables, one for each group."""
    rows = [*ROWS, *of_examples(), *of_hard_cases()]
    text = [f"{len(rows)} numbers; ksd's own were computed when this page was made."]
    for group, of_group in groupby(sorted(rows, key=lambda row: row.group), key=lambda row: row.group):
        text += [f"## {group}", HEAD + "\n" + "\n".join(map(line, of_group))]
    text.append(of_motions())
    path.write_text("\n\n".join(text) + "\n")
