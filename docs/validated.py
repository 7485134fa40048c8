"""The page of published and independent numbers: each beside ksd's own, asked when the site is built."""

from __future__ import annotations

import contextlib
import io
import runpy
import sys
from itertools import groupby
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests" / "validation"), str(ROOT / "tests")]

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


def line(row: Number) -> str:
    """A row of the table. Raises ValueError where ksd is off by more than the tolerance, as the tests do."""
    own = row.ask()
    off = abs(own - row.value) / (abs(row.value) or 1.0)
    if not off <= row.within:
        raise ValueError(f"{row.group}: {row.what} is {own}, {row.source} has {row.value}")
    unit = f" [{row.unit}]" if row.unit else ""
    return (
        f"| {row.what}{unit} | {row.value:.10g} | {own:.9g} | {off:.1e} | {row.within:.0e} | {row.source} |"
    )


def write_validated(path: Path) -> None:
    """All numbers in one page of tables, one for each group."""
    rows = [*ROWS, *of_examples()]
    text = [f"{len(rows)} numbers; ksd's own were computed when this page was made."]
    for group, of_group in groupby(sorted(rows, key=lambda row: row.group), key=lambda row: row.group):
        text += [f"## {group}", HEAD + "\n" + "\n".join(map(line, of_group))]
    path.write_text("\n\n".join(text) + "\n")
