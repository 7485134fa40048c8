"""The report: one HTML page that holds everything, pictures included, and needs no network.

Sections: the scene, what was simulated and left out, the pose, the stroke in pictures and numbers, how the solve converged
and how far other methods and a finer mesh are from it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ksd.design.page_parts import cards, document, figure, grid, text, written
from ksd.design.table import OK, STATUS, Table, label_and_unit
from ksd.errors import KsdError
from ksd.solve.answer import as_dict
from ksd.solve.report import verdict_lines

BUCKLING = ("buckling_positive", "buckling_negative")
FACTORS = (
    "Critical load factors: by what factor all stresses of a pose grow, at its geometry and with its drives held, when it "
    "buckles; negative ones with all stresses reversed."
)
WIDE = 10
"""Columns of numbers that fit on the page."""


@dataclass(frozen=True)
class ComparedSolve:
    """One other way to the same pose: its name, drive force, first parasitic frequency [Hz], stress [MPa]; nan where
    it has none; `failed` says why there are no numbers."""

    name: str
    force: float = math.nan
    frequency: float = math.nan
    stress: float = math.nan
    failed: str = ""


def report_page(pose: Any, table: Table, compared: Sequence[ComparedSolve]) -> str:
    """The report as HTML text: `pose` a Configuration, `table` its stroke, compared[0] the pose itself."""
    scene, facts = pose.model.scene, as_dict(pose)
    parts = [
        *(f'<p class="warn">{text(w)}</p>' for w in _warnings(pose, facts, table)),
        _cards(pose, table),
        figure(pose.plot(color="stress"), "The mechanism at the pose below, over the undeformed one (grey)."),
        "<h2>The scene</h2>", *_scene(scene),
        "<h2>What was simulated, and what was left out</h2>", *_model(pose.model),
        "<h2>The pose</h2>", *_pose(facts), *_interfaces(pose),
        "<h2>Over the stroke</h2>", *_stroke(table),
        "<h2>Convergence and error</h2>", *_error(pose, facts, compared),
    ]  # fmt: skip
    return document(scene.name, "flexure mechanism report", parts)


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
        unit = label_and_unit(f"x_{effort}")[1]
        said.append((f"{written(row[effort])} {unit}", f"{name}: drive {effort.split('_')[0]} at the pose"))
    for column, what, least in (
        ("stress_MPa", "largest stress over the stroke", False),
        ("first_parasitic_Hz", "lowest parasitic frequency", True),
    ):
        values = [v for v in table.columns.get(column, ()) if math.isfinite(v)]
        if values:
            said.append(
                (f"{written(min(values) if least else max(values), 4)} {label_and_unit(column)[1]}", what)
            )
    factors = [v for c in BUCKLING for v in table.columns.get(c, ()) if math.isfinite(v)]
    if factors:
        said.append((written(min(factors, key=abs), 4), "smallest critical load factor on all stresses"))
    return cards(said)


def _scene(scene: Any) -> list[str]:
    leaves = [
        (j.name, j.joint.family.replace("_", " "), f"{j.a} to {j.b}", 1e3 * j.joint.length)
        for j in scene.joints
    ]
    leaves += [(f.name, "single leaf", f"{f.a} to {f.b}", 1e3 * f.leaf.length) for f in scene.leaves]
    parts = [
        f"<p>Links: {text(', '.join(scene.links))}.</p>",
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
    parts = [f"<p>Solved by method <b>{text(facts['method'])}</b>, {text(facts['leaf_model'])}.</p>"]
    kinds: dict[tuple[str, ...], list[list[Any]]] = {}
    for name, row in facts["drives"].items():
        kinds.setdefault(tuple(row), []).append([name, *row.values()])
    for keys, rows in kinds.items():
        parts.append(grid([("drive", ""), *(label_and_unit(k) for k in keys)], rows))
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
            figure(table.plot(wide=2), "Answers over the stroke; a cross marks a pose without full answer.")
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
    return (column.replace("_", " "), "factor") if column in BUCKLING else label_and_unit(column)


def _error(pose: Any, facts: dict[str, Any], compared: Sequence[ComparedSolve]) -> list[str]:
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
    verdicts = "".join(f"<li>{text(sentence)}.</li>" for sentence in said)
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
