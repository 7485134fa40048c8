"""What every HTML page of ksd is made of: one file that holds its style and pictures, and needs no network."""

from __future__ import annotations

import base64
import datetime
import html
import math
from collections.abc import Iterable, Sequence
from typing import Any

import ksd
from ksd.properties.printing import format_number
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
    """A page as HTML text: `name` as heading, `kind` of report below it, then parts."""
    title = text(f"{name}: {kind}")
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{title}</title>'
    said = f"{kind[0].upper()}{kind[1:]}, ksd {ksd.__version__}, {datetime.date.today():%d %B %Y}"
    body = "\n".join([f"<h1>{text(name)}</h1>", f'<p class="sub">{said}</p>', *parts])
    top = f'<!doctype html>\n<html lang="en"><head>{head}<style>{STYLE}</style></head>'
    return f"{top}\n<body><main>\n{body}\n</main></body></html>\n"


def cards(said: Iterable[tuple[str, str]]) -> str:
    """Boxes of a number, as HTML, and words below it."""
    boxes = "".join(f'<div class="card"><b>{v}</b><span>{text(w)}</span></div>' for v, w in said)
    return f'<div class="cards">{boxes}</div>'


def text(words: Any) -> str:
    """Words as they are, with nothing that HTML would take for its own."""
    return html.escape(str(words))


def written(value: Any, digits: int = 5) -> str:
    """A number or text for a cell."""
    if isinstance(value, str):
        return text(value)
    if isinstance(value, int):
        return str(value)
    return "&ndash;" if value is None or not math.isfinite(value) else format_number(value, digits, zero=1e-9)


def grid(heads: Iterable[tuple[str, str]], rows: Iterable[Iterable[Any]]) -> str:
    """An HTML table; heads: (words, unit); texts to the left, numbers to the right, heads as the column below them."""
    rows = [list(row) for row in rows]
    words = [any(isinstance(v, str) and v for v in column) for column in zip(*rows, strict=True)] or [
        False
    ] * 64
    top = "".join(
        f"<th{' class=t' if left else ''}>{text(w)}{f'<br><small>{text(u)}</small>' if u else ''}</th>"
        for (w, u), left in zip(heads, words, strict=False)
    )
    body = "".join(
        "<tr>"
        + "".join(f"<td{' class=t' if isinstance(v, str) else ''}>{written(v)}</td>" for v in row)
        + "</tr>"
        for row in rows
    )
    return f'<div class="wide"><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'


def figure(drawn: Any, caption: str) -> str:
    """A matplotlib figure inside the page."""
    coded = base64.b64encode(figure_bytes(drawn, "png", dpi=140)).decode()
    said = text(caption)
    return f'<figure><img alt="{said}" src="data:image/png;base64,{coded}"><figcaption>{said}</figcaption></figure>'
