"""The report of a scene as one HTML page with its pictures, which needs no network.

Sections: scene; effects that were simulated or left out; pose; answers over the stroke; convergence, and differences from
other methods and a finer mesh.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ksd.design.page_parts import cards, document, escape, figure, format_cell, table
from ksd.design.table import OK, STATUS, Table, label_and_unit
from ksd.errors import KsdError
from ksd.scene.listing import in_millimetres, vector_text
from ksd.solve.answer import as_dict
from ksd.solve.report import verdict_lines

BUCKLING = ("buckling_positive", "buckling_negative")
LOAD_FACTOR_EXPLANATION = (
    "Critical load factors: by what factor all stresses of a pose grow, at its geometry and with its drives held, when it "
    "buckles; negative ones with all stresses reversed."
)
CHEAPEST_EXPLANATION = (
    "Each pose is solved with the cheapest method and number of relinearisation steps that is accurate enough; where "
    "another one takes over, the estimated error jumps."
)
MAX_COLUMNS = 10
"""Number of columns that fit on the page."""


@dataclass(frozen=True)
class ComparedSolve:
    """The same pose by one method or mesh; quantities that do not exist are nan.

    force: drive force [N] or moment [Nm]; frequency: first parasitic frequency [Hz]; stress: largest stress [MPa]; failure:
    why there are no numbers.
    """

    name: str
    force: float = math.nan
    frequency: float = math.nan
    stress: float = math.nan
    failure: str = ""


def report_page(pose: Any, stroke: Table, compared: Sequence[ComparedSolve]) -> str:
    """The report as HTML text; pose: a Configuration; stroke: answers over its stroke; compared[0]: the pose itself."""
    scene, facts = pose.model.scene, as_dict(pose)
    parts = [
        *(f'<p class="warn">{escape(w)}</p>' for w in _warnings(pose, facts, stroke)),
        _cards(facts, stroke),
        figure(pose.plot(color="stress"), "The mechanism at the pose below, over the undeformed one (grey)."),
        "<h2>The scene</h2>", *_scene(scene),
        "<h2>What was simulated, and what was left out</h2>", *_model(pose.model),
        "<h2>The pose</h2>", *_pose(facts), *_interfaces(pose),
        "<h2>Over the stroke</h2>", *_stroke(stroke),
        "<h2>Convergence and error</h2>", *_error(pose, facts, compared),
    ]  # fmt: skip
    return document(scene.name, "flexure mechanism report", parts)


def _warnings(pose: Any, facts: dict[str, Any], stroke: Table) -> list[str]:
    """Sentences on what limits the trust in the report."""
    trusted = facts["trust"]["trusted"]
    doubts = [trusted["sentence"]] if pose.stable and not trusted["yes"] else []
    warnings = [
        f"{w[0].upper()}{w[1:]}{'' if w.endswith('.') else '.'}" for w in (*facts["warnings"], *doubts)
    ]
    if not pose.stable:
        warnings.append(f"The state is not a minimum of energy. {facts['stability']}")
    if stroke.failures:
        warnings.append(
            f"{len(stroke.failures)} of {len(stroke)} poses of the stroke have no full answer; see the table."
        )
    return warnings


def _cards(facts: dict[str, Any], stroke: Table) -> str:
    """The main numbers: drive forces at the pose, and the worst answers over the stroke."""
    numbers: list[tuple[str, str]] = []
    for name, row in facts["drives"].items():
        effort = next(k for k in row if k.startswith(("force_", "moment_", "effort")) and "error" not in k)
        unit = label_and_unit(f"x_{effort}")[1]
        numbers.append(
            (f"{format_cell(row[effort])} {unit}", f"{name}: drive {effort.split('_')[0]} at the pose")
        )
    for column, caption, worst in (
        ("stress_MPa", "largest stress over the stroke", max),
        ("first_parasitic_Hz", "lowest parasitic frequency", min),
    ):
        values = [v for v in stroke.columns.get(column, ()) if math.isfinite(v)]
        if values:
            numbers.append((f"{format_cell(worst(values), 4)} {label_and_unit(column)[1]}", caption))
    factors = [v for c in BUCKLING for v in stroke.columns.get(c, ()) if math.isfinite(v)]
    if factors:
        numbers.append(
            (format_cell(min(factors, key=abs), 4), "smallest critical load factor on all stresses")
        )
    return cards(numbers)


def _scene(scene: Any) -> list[str]:
    """Tables of joints and leaf springs, drives and supports, loads, and masses."""
    leaves = [
        (j.name, j.joint.family.replace("_", " "), f"{j.a} to {j.b}", 1e3 * j.joint.length)
        for j in scene.joints
    ]
    leaves += [(f.name, "single leaf", f"{f.a} to {f.b}", 1e3 * f.leaf.length) for f in scene.leaves]
    parts = [
        f"<p>Links: {escape(', '.join(scene.links))}.</p>",
        table((("joint or leaf", ""), ("kind", ""), ("between", ""), ("length", "mm")), leaves),
    ]
    drives = [(d.name, " + ".join(_term(t) for t in d.terms)) for d in scene.drives]
    drives += [(f"{s.name} (held at zero)", " + ".join(_term(t) for t in s.terms)) for s in scene.supports]
    parts.append(table((("drive or support", ""), ("what it prescribes", "")), drives))
    loads = [
        (p.name, p.link, f"{vector_text(p.force)} N", f"{vector_text(p.moment)} Nm") for p in scene.loads
    ]
    if scene.gravity is not None:
        loads.append(("gravity", "everything with mass", f"{vector_text(scene.gravity)} m/s²", ""))
    if loads:
        parts.append(table((("load", ""), ("on", ""), ("force", ""), ("moment", "")), loads))
    if scene.masses:
        masses = [(m.link, m.mass, in_millimetres(m.at)) for m in scene.masses]
        parts.append(table((("mass on link", ""), ("mass", "kg"), ("centre", "")), masses))
    return parts


def _term(term: Any) -> str:
    """A term of a drive or support as text."""
    factor = "" if term.coefficient == 1.0 else f"{term.coefficient:g} × "
    along = vector_text(term.direction)
    motion = f"{term.kind} of {term.link} {'along' if term.kind == 'translation' else 'about'} {along}"
    return factor + motion + ("" if term.base == "ground" else f" relative to {term.base}")


def _model(model: Any) -> list[str]:
    """The printed description of the model as a table, a row per line."""
    rows = []
    for line in str(model).splitlines():
        head, colon, rest = line.partition(": ")
        rows.append((head, rest) if colon else ("", line))
    return [table((("", ""), ("", "")), rows)]


def _pose(facts: dict[str, Any]) -> list[str]:
    """Tables of drives, links and intended motions of joints."""
    parts = [f"<p>Solved by method <b>{escape(facts['method'])}</b>, {escape(facts['leaf_model'])}.</p>"]
    kinds: dict[tuple[str, ...], list[list[Any]]] = {}
    for name, row in facts["drives"].items():
        kinds.setdefault(tuple(row), []).append([name, *row.values()])
    for keys, rows in kinds.items():
        parts.append(table([("drive", ""), *(label_and_unit(k) for k in keys)], rows))
    links = facts["links"]
    heads = [("link", ""), *((f"{a}", "mm") for a in "xyz"), *((f"r{a}", "deg") for a in "xyz")]
    parts.append("<h3>Displacement and rotation of the links</h3>")
    parts.append(table(heads, [[n, *v["displacement_mm"], *v["rotation_deg"]] for n, v in links.items()]))
    if facts["joints"]:
        heads = [("joint", ""), ("intended motion", "")]
        motions = [
            [
                n,
                ", ".join(
                    f"{label} {v:.5g} {unit}"
                    for k, v in j["intended"].items()
                    for label, unit in (label_and_unit(k),)
                ),
            ]
            for n, j in facts["joints"].items()
        ]
        parts += ["<h3>Intended motion of the joints</h3>", table(heads, motions)]
    return parts


def _interfaces(pose: Any) -> list[str]:
    """A table of the wrenches that joints, leaf springs and springs exert on links and ground."""
    rows = [(name, link, *wrench) for name, link, wrench in pose.interface_forces().listing]
    heads = [("of", ""), ("on link", ""), *((f"force {a}", "N") for a in "xyz")]
    heads += [(f"moment {a}", "Nm") for a in "xyz"]
    note = "<p>On the link, ground too; moments about the interface where it is now, global axes.</p>"
    return ["<h3>Forces of joints and leaf springs</h3>", table(heads, rows), note]


def _stroke(stroke: Table) -> list[str]:
    """Pictures and tables of the answers over the stroke; wide tables are split by columns."""
    parts = []
    if stroke.columns[STATUS].count(OK) > 1:
        parts.append(
            figure(stroke.plot(wide=2), "Answers over the stroke; a cross marks a pose without full answer.")
        )
    hidden = {
        "warnings", "stable", "stress_leaf", "stress_s_mm", "stress_point", "mac", "first_parasitic_mode",
    }  # fmt: skip
    hidden |= {c for c in stroke.columns if c.startswith("parasitic_") and c.endswith("_Hz")}
    if len({*stroke.columns.get("method", ())} - {""}) < 2:
        hidden.add("method")
    if not stroke.failures:
        hidden.add(STATUS)
    shown = [
        column
        for column, values in stroke.columns.items()
        if column not in hidden and any(not isinstance(v, float) or (math.isfinite(v) and v) for v in values)
    ]
    labels = [c for c in shown if c in stroke.labels]
    answers = [c for c in shown if c not in stroke.labels]
    if any(c in shown for c in BUCKLING):
        parts.append(f"<p>{LOAD_FACTOR_EXPLANATION}</p>")
    if "error_percent" in shown and stroke.facts.get("method") == "cheapest":
        parts.append(f"<p>{CHEAPEST_EXPLANATION}</p>")
    table_count = max(1, math.ceil(len(answers) / max(3, MAX_COLUMNS - len(labels))))
    # all tables have about the same width
    size = max(1, math.ceil(len(answers) / table_count))
    for first in range(0, max(1, len(answers)), size):
        columns = [*labels, *answers[first : first + size]]
        parts.append(table([_head(c) for c in columns], ([row[c] for c in columns] for row in stroke.rows())))
    return parts


def _head(column: str) -> tuple[str, str]:
    """Title and unit of a column."""
    return (column.replace("_", " "), "factor") if column in BUCKLING else label_and_unit(column)


def _error(pose: Any, facts: dict[str, Any], compared: Sequence[ComparedSolve]) -> list[str]:
    """Steps of the solve, verdicts on it, and the same pose by other methods and meshes."""
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
    sentences = [sentence for sentence, _ in verdict_lines(facts)] + _verification(pose)
    verdicts = "".join(f"<li>{escape(sentence)}.</li>" for sentence in sentences)
    first = compared[0]
    rows: list[tuple[Any, ...]] = []
    for c in compared:
        if c.failure:
            rows.append((c.name, "", "", "", "", "", "", c.failure))
        else:
            pairs = ((c.force, first.force), (c.frequency, first.frequency), (c.stress, first.stress))
            rows.append((c.name, *(v for a, b in pairs for v in (a, _difference_percent(a, b))), ""))
    compared_heads = [
        ("way to the pose", ""),
        ("drive force or moment", "N, Nm"),
        ("off by", "%"),
        ("first parasitic", "Hz"),
    ]
    compared_heads += [("off by", "%"), ("largest stress", "MPa"), ("off by", "%"), ("", "")]
    return [
        table(heads, steps), f"<ul>{verdicts}</ul>",
        "<h3>The same pose by other ways</h3>", table(compared_heads, rows),
        "<p>“Off by” is the difference from the first line. More modes or elements per leaf show the error of the mesh, "
        "the other methods that of the method.</p>",
    ]  # fmt: skip


def _verification(pose: Any) -> list[str]:
    """The result of integrating every leaf spring, where the pose can be verified."""
    try:
        return [pose.verify().sentence]
    except KsdError:
        return []


def _difference_percent(value: float, reference: float) -> float:
    """Relative difference [%]; nan without a reference."""
    return 100 * (value / reference - 1) if reference else math.nan
