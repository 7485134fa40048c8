"""Parts of the HTML pages of ksd: a page is one file with its style and pictures, and needs no network."""

from __future__ import annotations

import base64
import datetime
import html
import math
from collections.abc import Iterable, Sequence
from typing import Any

from ksd.answers.printing import format_number
from ksd.version import __version__
from ksd.view.figure import figure_bytes

STYLE = """
body{font:15px/1.5 system-ui,"Segoe UI",Helvetica,Arial,sans-serif;color:#1f2430;margin:0;background:#f4f5f8}
main{max-width:68rem;margin:0 auto;background:#fff;padding:2.5rem 3rem}
h1{font-size:1.9rem;margin:0} h2{font-size:1.2rem;margin:2.4rem 0 .6rem;border-bottom:2px solid #c2410c;padding-bottom:.2rem}
h3{font-size:1rem;margin:1.4rem 0 .4rem} p.sub{color:#5a6375;margin:.2rem 0 1rem}
figure{margin:1rem 0} img{max-width:100%;height:auto;display:block} figcaption{color:#5a6375;font-size:.85rem}
table{border-collapse:collapse;font-size:.86rem;font-variant-numeric:tabular-nums;margin:.4rem 0}
th{text-align:right;font-weight:600;border-bottom:1px solid #9aa3b2;padding:.25rem .7rem;vertical-align:bottom}
th small{font-weight:400;color:#5a6375} td{text-align:right;padding:.18rem .7rem;border-bottom:1px solid #eceff4}
th:first-child,td:first-child,th.t,td.t{text-align:left} .wide{overflow-x:auto}
.cards{display:flex;flex-wrap:wrap;gap:.8rem;margin:1rem 0}
.card{border:1px solid #dfe3ea;border-radius:.4rem;padding:.5rem .9rem;min-width:8.5rem}
.card b{display:block;font-size:1.25rem} .card span{color:#5a6375;font-size:.8rem}
.warn{background:#fff4e5;border-left:4px solid #c2410c;padding:.5rem .9rem;margin:.5rem 0}
@media print{body{background:#fff}main{padding:0;max-width:none}h2{break-after:avoid}figure,table{break-inside:avoid}}
"""


def document(name: str, kind: str, parts: Sequence[str]) -> str:
    """A whole page as HTML text; name: the heading; kind: kind of report, below the heading; parts: HTML texts."""
    title = escape(f"{name}: {kind}")
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{title}</title>'
    subtitle = f"{kind[0].upper()}{kind[1:]}, ksd {__version__}, {datetime.date.today():%d %B %Y}"
    body = "\n".join([f"<h1>{escape(name)}</h1>", f'<p class="sub">{subtitle}</p>', *parts])
    top = f'<!doctype html>\n<html lang="en"><head>{head}<style>{STYLE}</style></head>'
    return f"{top}\n<body><main>\n{body}\n</main></body></html>\n"


def cards(numbers: Iterable[tuple[str, str]]) -> str:
    """Boxes with a number, already HTML, and a caption below it."""
    boxes = "".join(f'<div class="card"><b>{v}</b><span>{escape(c)}</span></div>' for v, c in numbers)
    return f'<div class="cards">{boxes}</div>'


def escape(value: Any) -> str:
    """The text of a value with the special characters of HTML escaped."""
    return html.escape(str(value))


def format_cell(value: Any, digits: int = 5) -> str:
    """A number or text as the content of a table cell; a dash for None and for numbers that are not finite."""
    if isinstance(value, str):
        return escape(value)
    if isinstance(value, int):
        return str(value)
    return "&ndash;" if value is None or not math.isfinite(value) else format_number(value, digits, zero=1e-9)


def table(heads: Iterable[tuple[str, str]], rows: Iterable[Iterable[Any]]) -> str:
    """An HTML table; heads: (title, unit) of each column.

    Texts are aligned to the left, numbers to the right, and heads as their column.
    """
    rows = [list(row) for row in rows]
    is_text = [any(isinstance(v, str) and v for v in column) for column in zip(*rows, strict=True)] or [
        False
    ] * 64
    top = "".join(
        f"<th{' class=t' if left else ''}>{escape(t)}{f'<br><small>{escape(u)}</small>' if u else ''}</th>"
        for (t, u), left in zip(heads, is_text, strict=False)
    )
    body = "".join(
        "<tr>"
        + "".join(f"<td{' class=t' if isinstance(v, str) else ''}>{format_cell(v)}</td>" for v in row)
        + "</tr>"
        for row in rows
    )
    return f'<div class="wide"><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'


def figure(plot: Any, caption: str) -> str:
    """A matplotlib figure as a picture inside the page."""
    encoded = base64.b64encode(figure_bytes(plot, "png", dpi=140)).decode()
    alt = escape(caption)
    return f'<figure><img alt="{alt}" src="data:image/png;base64,{encoded}"><figcaption>{alt}</figcaption></figure>'
