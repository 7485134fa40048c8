"""Docstrings of this package as reStructuredText: plain text in the sources, one line per parameter on the site, and the
pose at the end of an example drawn below it."""

from __future__ import annotations

import contextlib
import doctest
import inspect
import io
import re
from pathlib import Path
from typing import Any

from figures import css_width

START = "import numpy as np\nimport ksd\nfrom ksd.units import GPa, deg, mm\n"
"""What every example begins after."""


def escape(text: str) -> str:
    """Text without the characters reStructuredText would read as markup; what stands in backticks stays."""
    parts = re.split(r"(``[^`]*``|`[^`]*`)", text)
    plain = [re.sub(r"(?<=\w)_(?!\w)|[*|\\]", r"\\\g<0>", part) for part in parts[::2]]
    return "".join(a + b for a, b in zip(plain, [*parts[1::2], ""], strict=True))


def _found(text: str, names: set[str]) -> list[re.Match[str]]:
    """Where a text comes to parameters: "link, at: the point asked about"."""
    words = r"(?:^|(?<=[.;,:] ))(\w+(?:(?:,| or| and|) \w+)*)((?: \[[^\]]*\]| \([^)]*\))*): "
    return [match for match in re.finditer(words, text) if set(re.split(r", | or | and ", match[1])) <= names]


def by_parameter(text: str, names: set[str]) -> list[str]:
    """Lines of a paragraph, a new item of a list wherever it comes to parameters."""
    where = _found(text, names)
    if not where:
        return [escape(text), ""]
    ends = [match.start() for match in where[1:]] + [len(text)]
    lines = [escape(text[: where[0].start()].strip()), ""]
    for match, end in zip(where, ends, strict=True):
        lines.append(
            f"- **{match[1]}**{escape(match[2])}: {escape(text[match.end() : end].strip().rstrip(';'))}"
        )
    return [*lines, ""]


def run_example(example: str) -> dict[str, Any]:
    """The names that an example has made at its end."""
    names: dict[str, Any] = {}
    exec(START, names)
    with contextlib.redirect_stdout(io.StringIO()):
        for part in doctest.DocTestParser().get_examples(example):
            exec(compile(part.source, "example", "single"), names)
    return names


def drawn_pose(path: Path, example: str) -> list[str]:
    """The lines that show the picture of the `pose` an example makes, which is written to `path`."""
    names = run_example(example)
    path.parent.mkdir(parents=True, exist_ok=True)
    names["pose"].plot().savefig(path, dpi=110)
    place = f"/_made/poses/{path.name}"
    return [f".. image:: {place}", "   :alt: the pose of the example", f"   :width: {css_width(path)}", ""]


def as_rst(app: Any, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
    """Put the docstring `lines` of a public name into reStructuredText, in place."""
    try:
        names = set(inspect.signature(found).parameters)
    except (TypeError, ValueError):
        names = set()
    made: list[str] = []
    for paragraph in "\n".join(lines).split("\n\n"):
        if "::" in paragraph or paragraph.startswith(("    ", ">>>")):
            made += [*paragraph.split("\n"), ""]
            if paragraph.startswith(">>>") and ">>> pose = " in paragraph:
                made += drawn_pose(Path(app.srcdir) / "_made" / "poses" / f"{name}.png", paragraph)
            continue
        text, raised, errors = " ".join(paragraph.split()).partition("Raises ")
        made += by_parameter(text.strip(), names) if text.strip() else []
        made += [escape(raised + errors), ""] if raised else []
    lines[:] = made


def readable(
    app: Any, what: str, name: str, found: Any, options: Any, signature: str | None, returned: str | None
) -> tuple[str | None, ...]:
    """A signature that Sphinx can parse: type aliases, which it wraps in unions, by name; defaults made anew as dots."""
    return tuple(
        said and re.sub(r"TypeAliasForwardRef\('(.*?)'\)", r"\1", said).replace("<factory>", "...")
        for said in (signature, returned)
    )
