"""The page "measured": what a pose costs and where a record pays, and where the evidence of everything else is."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"
RESULTS = BENCHMARKS / "results"
README = BENCHMARKS.parent / "README.md"
PAGE = """# Measured

What a user pays, and what for. Times are thread CPU times unless said otherwise.

## A pose

{pose}

{train}

## Where a record pays

![Error over time of all methods, of a small and a large mechanism](pays.png)

{pays}

## Everything else

Every claim has a script in `benchmarks/` of the repository, and what it wrote is in `benchmarks/results/`.

| what | script | results |
|---|---|---|
{rows}
"""


def write_measured(folder: Path) -> None:
    """The page, from the README and from the files in `benchmarks`, as `index.md` of a folder."""
    folder.mkdir(exist_ok=True)
    readme = README.read_text()
    table = readme.partition("<!-- measured:begin -->\n")[2].partition("\n\n")[0]
    train = readme.partition("**When to train.** ")[2].partition("\n\n")[0]
    shutil.copy(RESULTS / "pays.png", folder)
    page = PAGE.format(
        pose=table.replace("the fourbar above", "the fourbar of *Getting started*"),
        train=train.replace("[table](benchmarks/results/pays.md)", "table below"),
        pays=(RESULTS / "pays.md").read_text(),
        rows="\n".join(rows()),
    )
    (folder / "index.md").write_text(page)


def rows() -> list[str]:
    """A line per script: what it shows, its name, and its files of results."""
    shows = re.findall(r"^\| `(\w+)\.py` \| (.*) \|$", (BENCHMARKS / "README.md").read_text(), re.M)
    return [f"| {what} | `{name}.py` | {', '.join(results(name)) or '-'} |" for name, what in shows]


def results(script: str) -> list[str]:
    """Names of the files that a script wrote."""
    own = re.compile(r"paper1|fig\d+_.*" if script == "paper1" else rf"{script}(_fig\d+)?")
    return [f"`{path.name}`" for path in sorted(RESULTS.iterdir()) if own.fullmatch(path.stem)]
