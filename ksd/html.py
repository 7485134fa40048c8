"""HTML of printed answers for notebooks: the text of `print`, with tables as HTML tables."""

from __future__ import annotations

import html
from collections.abc import Iterable
from typing import Any

CELL_STYLE = "padding:.15em .8em .15em 0;vertical-align:top;text-align:"
HEAD_STYLE = "border-bottom:1px solid;white-space:nowrap;"
LINE_STYLE = "margin:.2em 0;white-space:pre-wrap"


class PrintedText(str):
    """A printed text with the parts it was made from; `parts`: tables of rich, rows of texts, and lines."""

    parts: tuple[Any, ...]

    def __new__(cls, text: str, parts: Iterable[Any]) -> PrintedText:
        """The text and its parts."""
        made = super().__new__(cls, text)
        made.parts = tuple(parts)
        return made


class NotebookTables:
    """Mixin for classes that print as tables: notebooks show the same numbers as HTML tables."""

    def _repr_html_(self) -> str:
        return as_html(type(self).__str__(self))


def join_printed(parts: Iterable[str]) -> PrintedText:
    """Parts joined by line breaks."""
    parts = list(parts)
    return PrintedText("\n".join(parts), parts)


def as_html(text: str) -> str:
    """HTML of a text or of the tables it was printed from."""
    parts = text.parts if isinstance(text, PrintedText) else (text,)
    return f'<div style="font-size:90%">{"".join(map(_part_html, parts))}</div>'


def _part_html(part: Any) -> str:
    if hasattr(part, "columns"):
        heads = [_escaped(column.header) for column in part.columns]
        title = f'<p style="{LINE_STYLE}">{_escaped(part.title)}</p>' if part.title else ""
        rows = zip(*(column.cells for column in part.columns), strict=True)
        return title + html_table(rows, heads, [column.justify == "right" for column in part.columns])
    if isinstance(part, PrintedText):
        return "".join(map(_part_html, part.parts))
    if isinstance(part, list):
        return html_table(part)
    return f'<p style="{LINE_STYLE}">{_escaped(part)}</p>'


def html_table(rows: Iterable[Iterable[Any]], heads: Iterable[str] = (), right: Iterable[bool] = ()) -> str:
    """HTML table of rows of cells. heads: column titles, already escaped; right: whether each column is aligned right."""
    sides = ["right" if r else "left" for r in right]
    top = _row_html("th", heads, sides, HEAD_STYLE)
    body = "".join(_row_html("td", map(_escaped, row), sides, "") for row in rows)
    style = "border-collapse:collapse;font-variant-numeric:tabular-nums;margin:.3em 0"
    return f'<table style="{style}">{f"<thead>{top}</thead>" if heads else ""}<tbody>{body}</tbody></table>'


def _row_html(tag: str, cells: Iterable[str], sides: list[str], style: str) -> str:
    written = [
        f'<{tag} style="{style}{CELL_STYLE}{sides[k] if k < len(sides) else "left"}">{cell}</{tag}>'
        for k, cell in enumerate(cells)
    ]
    return f"<tr>{''.join(written)}</tr>"


def _escaped(words: Any) -> str:
    """Escaped HTML of a text or of a text of rich."""
    return html.escape(str(getattr(words, "plain", words))).replace("\n", "<br>")
