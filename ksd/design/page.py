"""The report: one HTML page that holds everything, pictures included, and needs no network.

Sections: the scene, what was simulated and left out, the pose, the stroke in pictures and numbers, how the solve converged
and how far other methods and a finer mesh are from it.
"""

from __future__ import annotations

import base64
import datetime
import html
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import ksd
from ksd.design.table import OK, STATUS, Table, spoken_column
from ksd.errors import KsdError
from ksd.solve.answer import as_dict
from ksd.solve.report import number, verdict_lines
from ksd.view.figure import picture

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


BUCKLING = ("buckling_positive", "buckling_negative")
FACTORS = (
    "Critical load factors: by what factor all stresses of a pose grow, at its geometry and with its drives held, when it "
    "buckles; negative ones with all stresses reversed."
)
WIDE = 10
"""Columns of numbers that fit on the page."""


@dataclass(frozen=True)
class Compared:
    """One other way to the same pose: its name, drive force, first parasitic frequency [Hz], stress [MPa]; nan where
    it has none; `failed` says why there are no numbers."""

    name: str
    force: float = math.nan
    frequency: float = math.nan
    stress: float = math.nan
    failed: str = ""


def page(pose: Any, table: Table, compared: Sequence[Compared]) -> str:
    """The report as HTML text: `pose` a Configuration, `table` its stroke, compared[0] the pose itself."""
    scene, facts = pose.model.scene, as_dict(pose)
    parts = [
        f"<h1>{_text(scene.name)}</h1>",
        f'<p class="sub">Flexure mechanism report, ksd {ksd.__version__}, {datetime.date.today():%d %B %Y}</p>',
        *(f'<p class="warn">{_text(w)}</p>' for w in _warnings(pose, facts, table)),
        _cards(pose, table),
        _figure(pose.plot(color="stress"), "The mechanism at the pose below, over the undeformed one (grey)."),
        "<h2>The scene</h2>", *_scene(scene),
        "<h2>What was simulated, and what was left out</h2>", *_model(pose.model),
        "<h2>The pose</h2>", *_pose(facts), *_interfaces(pose),
        "<h2>Over the stroke</h2>", *_stroke(table),
        "<h2>Convergence and error</h2>", *_error(pose, facts, compared),
    ]  # fmt: skip
    title = _text(f"{scene.name}: flexure mechanism report")
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{title}</title>'
    body = "\n".join(parts)
    top = f'<!doctype html>\n<html lang="en"><head>{head}<style>{STYLE}</style></head>'
    return f"{top}\n<body><main>\n{body}\n</main></body></html>\n"


def _text(words: Any) -> str:
    return html.escape(str(words))


def _number(value: Any, digits: int = 5) -> str:
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, int):
        return str(value)
    return "&ndash;" if value is None or not math.isfinite(value) else number(value, digits, zero=1e-9)


def grid(heads: Iterable[tuple[str, str]], rows: Iterable[Iterable[Any]]) -> str:
    """An HTML table; heads: (words, unit); texts to the left, numbers to the right, heads as the column below them."""
    rows = [list(row) for row in rows]
    words = [any(isinstance(v, str) and v for v in column) for column in zip(*rows, strict=True)] or [
        False
    ] * 64
    top = "".join(
        f"<th{' class=t' if left else ''}>{_text(w)}{f'<br><small>{_text(u)}</small>' if u else ''}</th>"
        for (w, u), left in zip(heads, words, strict=False)
    )
    body = "".join(
        "<tr>"
        + "".join(f"<td{' class=t' if isinstance(v, str) else ''}>{_number(v)}</td>" for v in row)
        + "</tr>"
        for row in rows
    )
    return f'<div class="wide"><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'


def _figure(figure: Any, caption: str) -> str:
    coded = base64.b64encode(picture(figure, "png", dpi=140)).decode()
    said = _text(caption)
    return f'<figure><img alt="{said}" src="data:image/png;base64,{coded}"><figcaption>{said}</figcaption></figure>'


def _warnings(pose: Any, facts: dict[str, Any], table: Table) -> list[str]:
    found = [*facts["warnings"]]
    trusted = facts["trust"]["trusted"]
    if pose.stable and not trusted["yes"]:
        found.append(f"{trusted['sentence'][0].upper()}{trusted['sentence'][1:]}.")
    if not pose.stable:
        found.append(f"The state is not a minimum of energy. {facts['stability']}")
    if table.failures:
        found.append(
            f"{len(table.failures)} of {len(table)} poses of the stroke have no full answer; see the table."
        )
    return found


def _cards(pose: Any, table: Table) -> str:
    """The numbers a reader looks for first: at the pose, and the worst over the stroke."""
    said: list[tuple[str, str]] = []
    for name, row in as_dict(pose)["drives"].items():
        effort = next(k for k in row if k.startswith(("force_", "moment_", "effort")) and "error" not in k)
        unit = spoken_column(f"x_{effort}")[1]
        said.append((f"{_number(row[effort])} {unit}", f"{name}: drive {effort.split('_')[0]} at the pose"))
    for column, what, least in (
        ("stress_MPa", "largest stress over the stroke", False),
        ("first_parasitic_Hz", "lowest parasitic frequency", True),
    ):
        values = [v for v in table.columns.get(column, ()) if math.isfinite(v)]
        if values:
            said.append(
                (f"{_number(min(values) if least else max(values), 4)} {spoken_column(column)[1]}", what)
            )
    factors = [v for c in BUCKLING for v in table.columns.get(c, ()) if math.isfinite(v)]
    if factors:
        said.append((_number(min(factors, key=abs), 4), "smallest critical load factor on all stresses"))
    cards = "".join(f'<div class="card"><b>{v}</b><span>{_text(w)}</span></div>' for v, w in said)
    return f'<div class="cards">{cards}</div>'


def _scene(scene: Any) -> list[str]:
    leaves = [
        (j.name, j.joint.family.replace("_", " "), f"{j.a} to {j.b}", 1e3 * j.joint.length)
        for j in scene.joints
    ]
    leaves += [(f.name, "single leaf", f"{f.a} to {f.b}", 1e3 * f.leaf.length) for f in scene.leaves]
    parts = [
        f"<p>Links: {_text(', '.join(scene.links))}.</p>",
        grid((("joint or leaf", ""), ("kind", ""), ("between", ""), ("length", "mm")), leaves),
    ]
    drives = [(d.name, " + ".join(_term(t) for t in d.terms)) for d in scene.drives]
    drives += [(f"{s.name} (held at zero)", " + ".join(_term(t) for t in s.terms)) for s in scene.supports]
    parts.append(grid((("drive or support", ""), ("what it prescribes", "")), drives))
    loads = [(p.name, p.link, _vector(p.force, "N"), _vector(p.moment, "Nm")) for p in scene.loads]
    if scene.gravity is not None:
        loads.append(("gravity", "everything with mass", _vector(scene.gravity, "m/s²"), ""))
    if loads:
        parts.append(grid((("load", ""), ("on", ""), ("force", ""), ("moment", "")), loads))
    if scene.masses:
        masses = [(m.link, m.mass, _vector([1e3 * c for c in m.at], "mm")) for m in scene.masses]
        parts.append(grid((("mass on link", ""), ("mass", "kg"), ("centre", "")), masses))
    return parts


def _term(term: Any) -> str:
    factor = "" if term.coefficient == 1.0 else f"{term.coefficient:g} × "
    along = _vector(term.direction, "")
    said = f"{term.kind} of {term.link} {'along' if term.kind == 'translation' else 'about'} {along}"
    return factor + said + ("" if term.base == "ground" else f" relative to {term.base}")


def _vector(values: Any, unit: str) -> str:
    return f"({', '.join(f'{v:.4g}' for v in values)}) {unit}".strip()


def _model(model: Any) -> list[str]:
    """What the model says of itself, line by line."""
    rows = []
    for line in str(model).splitlines():
        head, colon, rest = line.partition(": ")
        rows.append((head, rest) if colon else ("", line))
    return [grid((("", ""), ("", "")), rows)]


def _pose(facts: dict[str, Any]) -> list[str]:
    parts = [f"<p>Solved by method <b>{_text(facts['method'])}</b>, {_text(facts['leaf_model'])}.</p>"]
    kinds: dict[tuple[str, ...], list[list[Any]]] = {}
    for name, row in facts["drives"].items():
        kinds.setdefault(tuple(row), []).append([name, *row.values()])
    for keys, rows in kinds.items():
        parts.append(grid([("drive", ""), *(spoken_column(k) for k in keys)], rows))
    links = facts["links"]
    heads = [("link", ""), *((f"{a}", "mm") for a in "xyz"), *((f"r{a}", "deg") for a in "xyz")]
    parts.append("<h3>Displacement and rotation of the links</h3>")
    parts.append(grid(heads, [[n, *v["displacement_mm"], *v["rotation_deg"]] for n, v in links.items()]))
    if facts["joints"]:
        heads = [("joint", ""), ("intended motion", "")]
        turned = [
            [
                n,
                ", ".join(
                    f"{k.rsplit('_', 1)[0]} {v:.5g} {k.rsplit('_', 1)[1]}" for k, v in j["intended"].items()
                ),
            ]
            for n, j in facts["joints"].items()
        ]
        parts += ["<h3>Intended motion of the joints</h3>", grid(heads, turned)]
    return parts


def _interfaces(pose: Any) -> list[str]:
    """What joints, leaf springs and springs exert on links and ground."""
    rows = [(name, link, *wrench) for name, link, wrench in pose.interface_forces().listing]
    heads = [("of", ""), ("on link", ""), *((f"force {a}", "N") for a in "xyz")]
    heads += [(f"moment {a}", "Nm") for a in "xyz"]
    said = "<p>On the link, ground too; moments about the interface where it is now, global axes.</p>"
    return ["<h3>Forces of joints and leaf springs</h3>", grid(heads, rows), said]


def _stroke(table: Table) -> list[str]:
    answered = [k for k, s in enumerate(table.columns[STATUS]) if s == OK]
    parts = []
    if len(answered) > 1:
        parts.append(
            _figure(table.plot(wide=2), "Answers over the stroke; a cross marks a pose without full answer.")
        )
    hide = {
        "method",
        "warnings",
        "stable",
        "stress_leaf",
        "stress_s_mm",
        "stress_point",
        "mac",
        "first_parasitic_mode",
    }
    hide |= {c for c in table.columns if c.startswith("parasitic_") and c.endswith("_Hz")}
    shown = [c for c in table.columns if c not in hide and not (c == STATUS and not table.failures)]
    shown = [
        c
        for c in shown
        if any(not isinstance(v, float) or (math.isfinite(v) and v) for v in table.columns[c])
    ]
    beside = [c for c in shown if c in table.labels]
    others = [c for c in shown if c not in table.labels]
    if any(c in shown for c in BUCKLING):
        parts.append(f"<p>{FACTORS}</p>")
    count = max(1, math.ceil(len(others) / max(3, WIDE - len(beside))))
    # parts of about one width
    size = max(1, math.ceil(len(others) / count))
    for first in range(0, max(1, len(others)), size):
        columns = [*beside, *others[first : first + size]]
        parts.append(grid([_head(c) for c in columns], ([row[c] for c in columns] for row in table.rows())))
    return parts


def _head(column: str) -> tuple[str, str]:
    return (column.replace("_", " "), "factor") if column in BUCKLING else spoken_column(column)


def _error(pose: Any, facts: dict[str, Any], compared: Sequence[Compared]) -> list[str]:
    heads = (
        ("step", ""),
        ("iterations", ""),
        ("time", "µs"),
        ("residual", "of its bound"),
        ("stopped because", ""),
    )
    steps = [
        (s["name"], s["iterations"], s["time_us"], s["residual_over_bound"], s["reason"])
        for s in facts["steps"]
    ]
    said = [sentence for sentence, _ in verdict_lines(facts)] + _verified(pose)
    verdicts = "".join(f"<li>{_text(sentence)}.</li>" for sentence in said)
    first = compared[0]
    rows: list[tuple[Any, ...]] = []
    for c in compared:
        if c.failed:
            rows.append((c.name, "", "", "", "", "", "", c.failed))
        else:
            pairs = ((c.force, first.force), (c.frequency, first.frequency), (c.stress, first.stress))
            rows.append((c.name, *(v for a, b in pairs for v in (a, _off(a, b))), ""))
    names = [
        ("way to the pose", ""),
        ("drive force or moment", "N, Nm"),
        ("off by", "%"),
        ("first parasitic", "Hz"),
    ]
    names += [("off by", "%"), ("largest stress", "MPa"), ("off by", "%"), ("", "")]
    return [
        grid(heads, steps), f"<ul>{verdicts}</ul>",
        "<h3>The same pose by other ways</h3>", grid(names, rows),
        "<p>“Off by” is the difference from the first line. More modes or elements per leaf show the error of the mesh, "
        "the other methods that of the method.</p>",
    ]  # fmt: skip


def _verified(pose: Any) -> list[str]:
    """What integration of every leaf spring says of the pose, where it can be asked."""
    try:
        return [pose.verify().sentence]
    except KsdError:
        return []


def _off(value: float, reference: float) -> float:
    return 100 * (value / reference - 1) if reference else math.nan
