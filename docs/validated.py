"""The page of published and independent numbers: each beside ksd's own, asked when the site is built."""

from __future__ import annotations

import contextlib
import io
import runpy
import sys
from functools import cache, partial
from itertools import groupby
from pathlib import Path
from typing import Any

import ksd

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests" / "validation"), str(ROOT / "tests")]

from hard_bank import CASES  # noqa: E402
from published_bank import ROWS, Number  # noqa: E402

HEAD = (
    "| what | published or independent | ksd | difference | tolerance | source |\n"
    "|---|---:|---:|---:|---:|---|"
)


def of_examples() -> list[Number]:
    """Numbers that the scripts of `examples/` end in, and that have a source of their own."""
    found = []
    for name, answers in runpy.run_path(str(ROOT / "tests" / "test_examples.py"))["NUMBERS"].items():
        with contextlib.redirect_stdout(io.StringIO()):
            own = runpy.run_path(str(ROOT / "examples" / f"{name}.py"))
        title = own["__doc__"].splitlines()[0].rstrip(".")
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


def write_validated(path: Path) -> None:
    """All numbers in one page of tables, one for each group."""
    rows = [*ROWS, *of_examples(), *of_hard_cases()]
    text = [f"{len(rows)} numbers; ksd's own were computed when this page was made."]
    for group, of_group in groupby(sorted(rows, key=lambda row: row.group), key=lambda row: row.group):
        text += [f"## {group}", HEAD + "\n" + "\n".join(map(line, of_group))]
    path.write_text("\n\n".join(text) + "\n")
