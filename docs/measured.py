"""The page "measured": what every benchmark found, its tables as it wrote them or else made of its stored numbers."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"
RESULTS = BENCHMARKS / "results"
README = BENCHMARKS.parent / "README.md"
CURVE = 12
"""Numbers in a row beyond which they are a curve, which the picture shows."""
HEAD = """# Measured

What a user pays, and what for. Times are thread CPU times unless said otherwise.

## A pose

{readme}

{train}

## Everything else

| what | where |
|---|---|
{rows}

```{{toctree}}
:hidden:

{names}
```
"""


def write_measured(folder: Path) -> None:
    """A page for every benchmark with stored results, and their index."""
    folder.mkdir(exist_ok=True)
    shows = dict(re.findall(r"^\| `(\w+)\.py` \| (.*) \|$", (BENCHMARKS / "README.md").read_text(), re.M))
    names = sorted({path.stem for path in (*RESULTS.glob("*.md"), *RESULTS.glob("*.json"))})
    for name in names:
        (folder / f"{name}.md").write_text(page(name, shows.get(name, ""), folder))
    table = README.read_text().partition("<!-- measured:begin -->\n")[2].partition("\n\n")[0]
    table = table.replace("the fourbar above", "the fourbar of *Getting started*")
    rows = "\n".join(f"| {shows.get(name, 'parts of others')} | [{name}]({name}.md) |" for name in names)
    # the sentences of the README, which name files of benchmarks/results
    train = README.read_text().partition("**When to train.** ")[2].partition("\n\n")[0]
    train = train.replace("benchmarks/results/", "")
    (folder / "index.md").write_text(
        HEAD.format(readme=table, train=train, rows=rows, names="\n".join(names))
    )


def page(name: str, shows: str, folder: Path) -> str:
    """The page of one benchmark: what it shows, when and where it ran, its pictures (copied to `folder`) and tables."""
    written, numbers = RESULTS / f"{name}.md", RESULTS / f"{name}.json"
    text = written.read_text() if written.exists() else ""
    found = json.loads(numbers.read_text()) if numbers.exists() else {}
    machine = found.pop("machine", None)
    title, rest = "# " + re.sub(r"_|(?<=r)(?=\d)", " ", name).capitalize(), text
    if text.startswith("# "):
        title, _, rest = text.partition("\n")
    lines = [title, "", f"By `benchmarks/{name}.py`: {shows}." if shows else "", ""]
    if machine and machine["date"] not in text:
        versions = ", ".join(
            f"{package} {machine[package]}" for package in ("ksd", "python", "numpy", "numba")
        )
        lines += [
            f"{machine['date']}, {machine['processor']}, load average {machine['load_average']}, {versions}.",
            "",
        ]
    own = re.compile(r"fig\d+_.*" if name == "paper1" else rf"{name}(_fig\d+)?")
    for picture in sorted(path for path in RESULTS.glob("*.png") if own.fullmatch(path.stem)):
        shutil.copy(picture, folder)
        lines += [f"![{picture.stem.replace('_', ' ')}]({picture.name})", ""]
    lines += (
        [rest if text.startswith("# ") else re.sub("^###", "##", text, flags=re.M)] if text else tables(found)
    )
    return "\n".join(lines) + "\n"


def tables(found: Any, title: str = "") -> list[str]:
    """Tables of nested numbers: rows of their own, what stands side by side, and what is single."""
    rows = named_rows(found)
    if rows:
        return [f"## {title}", "", *table(rows)] if title else table(rows)
    apart = {k: v for k, v in found.items() if isinstance(v, Mapping | list) and (named_rows(v) or nested(v))}
    own = dict(flat({k: v for k, v in found.items() if k not in apart}))
    lines = [f"## {title}", ""] if title and own else []
    several = {k: v for k, v in own.items() if isinstance(v, list)}
    if several and len(several) == len(own) and len({*map(len, several.values())}) == 1:
        columns = zip(*several.values(), strict=True)
        lines += table([("", dict(zip(several, column, strict=True))) for column in columns])
    elif own:
        lines += ["| | |", "|---|---:|", *(f"| {spoken(k)} | {cell(k, v)} |" for k, v in own.items()), ""]
    for key, value in apart.items():
        lines += tables(
            value, title if key == "rows" else f"{title}: {spoken(key)}" if title else spoken(key)
        )
    return lines


def nested(value: Any) -> bool:
    """Whether a table holds tables."""
    return isinstance(value, Mapping) and any(named_rows(inner) for inner in value.values())


def nests(value: list[Any]) -> bool:
    """Whether a list holds lists."""
    return any(isinstance(inner, list | Mapping) for inner in value)


def named_rows(found: Any) -> list[tuple[str, dict[str, Any]]]:
    """Rows with their names: of a list of tables, or of tables by name with the same keys; none of anything else."""
    if isinstance(found, list) and found and all(isinstance(row, Mapping) for row in found):
        return [("", dict(flat(row))) for row in found]
    rows = list(found.values()) if isinstance(found, Mapping) else []
    if len(rows) > 1 and all(isinstance(row, Mapping) for row in rows):
        made = [(str(key), dict(flat(row))) for key, row in found.items()]
        return made if made[0][1] and all(set(row) & set(made[0][1]) for _, row in made) else []
    return []


def flat(found: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """(path, value) of what is single or a short list; curves and lists of lists are left out."""
    for key, value in found.items():
        path = f"{before}, {key}" if before else key
        if isinstance(value, Mapping):
            yield from flat(value, path)
        elif not isinstance(value, list) or (len(value) <= CURVE and not nests(value)):
            yield path, value


def table(rows: Sequence[tuple[str, Mapping[str, Any]]]) -> list[str]:
    """A table with a line per row, or per column where these are more; what labels the rows comes first."""
    columns = list(dict.fromkeys(key for _, row in rows for key in row))
    told = [key for key in columns if any(row.get(key) is not None for _, row in rows)]
    # labels first
    told.sort(key=lambda key: not isinstance(rows[0][1].get(key), str))
    named = any(name for name, _ in rows)
    cells = [[""] * named + [spoken(key) for key in told]]
    cells += [[spoken(name)] * named + [cell(key, row.get(key)) for key in told] for name, row in rows]
    if len(cells[0]) > len(cells):
        cells = [list(line) for line in zip(*cells, strict=True)]
    first, *rest = (f"| {' | '.join(line)} |" for line in cells)
    return [first, "|---" + "|---:" * (len(cells[0]) - 1) + "|", *rest, ""]


def spoken(key: str) -> str:
    """A key in words."""
    return key.replace("_per_", "/").replace("_", " ")


def cell(key: str, value: Any) -> str:
    """A value as a table shows it."""
    if isinstance(value, list):
        return "; ".join(cell(key, inner) for inner in value)
    if isinstance(value, bool):
        return ("met" if value else "MISSED") if key.endswith("met") else ("yes" if value else "no")
    if value is None:
        return ""
    return f"{value:.4g}" if isinstance(value, float) else str(value).replace("|", r"\|")
