"""What a notebook shows of an answer: what `print` says, its tables as tables of the page."""

from __future__ import annotations

import html
from collections.abc import Iterable
from typing import Any

CELL = "padding:.15em .8em .15em 0;vertical-align:top;text-align:"
HEAD = "border-bottom:1px solid;white-space:nowrap;"
LINE = "margin:.2em 0;white-space:pre-wrap"


class Printed(str):
    """A text that remembers the tables it was printed from; `parts`: tables of rich, rows of texts, and lines."""

    parts: tuple[Any, ...]

    def __new__(cls, text: str, parts: Iterable[Any]) -> Printed:
        """The text `str` says, and what it is made of."""
        made = super().__new__(cls, text)
        made.parts = tuple(parts)
        return made


class InNotebooks:
    """Mixed into what prints as tables: notebooks show the same numbers as tables of the page."""

    def _repr_html_(self) -> str:
        return as_html(type(self).__str__(self))


def joined(parts: Iterable[str]) -> Printed:
    """Texts below each other."""
    parts = list(parts)
    return Printed("\n".join(parts), parts)


def as_html(said: str) -> str:
    """A text, or the tables it was printed from, for a page."""
    parts = said.parts if isinstance(said, Printed) else (said,)
    return f'<div style="font-size:90%">{"".join(map(_part, parts))}</div>'


def _part(part: Any) -> str:
    if hasattr(part, "columns"):
        heads = [_text(column.header) for column in part.columns]
        title = f'<p style="{LINE}">{_text(part.title)}</p>' if part.title else ""
        rows = zip(*(column.cells for column in part.columns), strict=True)
        return title + table(rows, heads, [column.justify == "right" for column in part.columns])
    if isinstance(part, Printed):
        return "".join(map(_part, part.parts))
    if isinstance(part, list):
        return table(part)
    return f'<p style="{LINE}">{_text(part)}</p>'


def table(rows: Iterable[Iterable[Any]], heads: Iterable[str] = (), right: Iterable[bool] = ()) -> str:
    """Rows of cells as a table; heads above, escaped already; numbers to the right where told so."""
    sides = ["right" if r else "left" for r in right]
    top = _row("th", heads, sides, HEAD)
    body = "".join(_row("td", map(_text, row), sides, "") for row in rows)
    style = "border-collapse:collapse;font-variant-numeric:tabular-nums;margin:.3em 0"
    return f'<table style="{style}">{f"<thead>{top}</thead>" if heads else ""}<tbody>{body}</tbody></table>'


def _row(tag: str, cells: Iterable[str], sides: list[str], style: str) -> str:
    said = [
        f'<{tag} style="{style}{CELL}{sides[k] if k < len(sides) else "left"}">{cell}</{tag}>'
        for k, cell in enumerate(cells)
    ]
    return f"<tr>{''.join(said)}</tr>"


def _text(words: Any) -> str:
    """Words, or a text of rich, escaped."""
    return html.escape(str(getattr(words, "plain", words))).replace("\n", "<br>")
