"""The report of a scene as one HTML page with its pictures, which needs no network.

Sections: scene; effects that were simulated or left out; pose; its modes and responses; answers over the stroke;
convergence, and differences from other methods and a finer mesh.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ksd.answers.centrelines import scene_leaves
from ksd.errors import KsdError
from ksd.html import as_html
from ksd.pages.page_parts import cards, document, escape, figure, format_cell, table
from ksd.solvers.answer import as_dict
from ksd.study.table import OK, STATUS, Table, label_and_unit
from ksd.view.animate import plot_mode

BUCKLING = ("buckling_positive", "buckling_negative")
LOAD_FACTOR_EXPLANATION = (
    "Critical load factors: by what factor all stresses of a pose grow, at its geometry and with its drives held, when it "
    "buckles; negative ones with all stresses reversed."
)
CHEAPEST_EXPLANATION = (
    "Each pose is solved with the fastest method that is accurate enough; where another one takes over, the estimated error "
    "jumps."
)
MODES, MODE_PICTURES = 6, 3
"""Number of modes in the table, and in pictures."""
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


def report_page(
    pose: Any, stroke: Table, compared: Sequence[ComparedSolve], *, freed: Sequence[str] | None = None
) -> str:
    """The report as HTML text; pose: a Configuration; stroke: answers over its stroke; compared[0]: the pose itself; freed:
    what is let go for its modes, all drives when None."""
    scene, facts = pose.model.scene, as_dict(pose)
    parts = [
        *(f'<p class="warn">{escape(w)}</p>' for w in _warnings(pose, facts, stroke)),
        _cards(pose, facts, stroke),
        figure(pose.plot(color="stress"), "The mechanism at the pose below, over the undeformed one (grey)."),
        "<h2>The scene</h2>", as_html(str(scene)),
        "<h2>What was simulated, and what was left out</h2>", as_html(str(pose.model)),
        "<h2>The pose</h2>", as_html(str(pose)), as_html(str(pose.interface_forces())),
        *_vibrations(pose, pose.model.drive_names if freed is None else freed),
        "<h2>Over the stroke</h2>", *_stroke(stroke),
        "<h2>Convergence and error</h2>", *_error(pose, compared),
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


def _cards(pose: Any, facts: dict[str, Any], stroke: Table) -> str:
    """The worst answer over the stroke to every kind of question, then the largest drive forces."""
    numbers = [] if (share := _yield_share(pose, stroke)) is None else [share]
    for column, caption, worst in (
        ("stress_MPa", "largest stress", max),
        ("first_parasitic_Hz", "lowest parasitic frequency", min),
        ("support_worst_N_per_m", "least support stiffness", min),
        ("support_worst_Nm_per_rad", "least support stiffness in rotation", min),
        ("clearance_mm", "least clearance of leaf springs", min),
    ):
        values = _finite(stroke, column)
        if values:
            numbers.append(
                (f"{format_cell(worst(values), 4)} {label_and_unit(column)[1]}", f"{caption} over the stroke")
            )
    factors = [v for c in BUCKLING for v in _finite(stroke, c)]
    if factors:
        smallest = min(factors, key=abs)
        reversed_too = ", reversed" * (smallest < 0.0)
        numbers.append(
            (
                f"{format_cell(abs(smallest), 3)} times",
                f"all stresses{reversed_too}: the first buckling over the stroke",
            )
        )
    for name, row in facts["drives"].items():
        effort = next(k for k in row if k.startswith(("force_", "moment_", "effort")) and "error" not in k)
        largest = max(abs(v) for v in (*_finite(stroke, f"{name}_{effort}"), row[effort]))
        kind, unit = effort.split("_")[0], label_and_unit(f"x_{effort}")[1]
        numbers.append((f"{format_cell(largest, 4)} {unit}", f"{name}: largest drive {kind} over the stroke"))
    return cards(numbers)


def _finite(stroke: Table, column: str) -> list[float]:
    """The numbers of a column that are finite; none where there is no such column."""
    return [v for v in stroke.columns.get(column, ()) if math.isfinite(v)]


def _yield_share(pose: Any, stroke: Table) -> tuple[str, str] | None:
    """Largest stress over the stroke as a share of the yield stress of its leaf; None where that is not known."""
    limits = {name: leaf.material.yield_stress for name, leaf in scene_leaves(pose.model).items()}
    pairs = zip(stroke.columns.get("stress_MPa", ()), stroke.columns.get("stress_leaf", ()), strict=True)
    shares = [1e6 * v / limits[leaf] for v, leaf in pairs if math.isfinite(v) and limits.get(leaf)]
    return (f"{100 * max(shares):.3g} %", "of the yield stress at most, over the stroke") if shares else None


def _vibrations(pose: Any, drives: Sequence[str]) -> list[str]:
    """Modes with effective masses and pictures of the first, and a Bode plot where there are sensors; () without mass."""
    scene = pose.model.scene
    try:
        modes = pose.frequencies(count=MODES, freed=drives)
    except KsdError:
        return []
    heads = [("mode", ""), ("frequency", "Hz"), ("kind", ""), ("what moves", "")]
    heads += [(f"effective mass {a}", "kg") for a in "xyz"]
    masses = modes.effective_mass.tolist()
    rows = zip(
        range(1, MODES + 1), modes.frequency_Hz.tolist(), modes.names, modes.movements, masses, strict=False
    )
    released = f", with {', '.join(drives)} let go" * bool(drives)
    parts = [
        f"<h2>Vibrations about the pose{escape(released)}</h2>",
        table(heads, ([*row, *mass] for *row, mass in rows)),
        *(
            figure(plot_mode(pose, mode=k + 1, modes=modes), f"Mode {k + 1}, {modes.movements[k]}.")
            for k in range(min(len(modes), MODE_PICTURES))
        ),
    ]
    if scene.sensors:
        inputs = drives or [f"base {a}" for a in scene.plane or "xyz"]
        try:
            response = pose.response(inputs=inputs, freed=drives)
        except KsdError as reason:
            return [*parts, f"<p>{escape(reason)}</p>"]
        sentence = f"Response of the sensors to {', '.join(inputs)}."
        parts += ["<h3>What the sensors see</h3>", as_html(str(response)), figure(response.plot(), sentence)]
    return parts


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


def _error(pose: Any, compared: Sequence[ComparedSolve]) -> list[str]:
    """The verification of the pose, and the same pose by other methods and meshes where these are given."""
    if not compared:
        return _verification(pose)
    first = compared[0]
    rows: list[tuple[Any, ...]] = []
    for c in compared:
        if c.failure:
            rows.append((c.name, "", "", "", "", "", "", c.failure))
        else:
            pairs = ((c.force, first.force), (c.frequency, first.frequency), (c.stress, first.stress))
            rows.append((c.name, *(v for a, b in pairs for v in (a, _difference_percent(a, b))), ""))
    heads = [
        ("way to the pose", ""),
        ("drive force or moment", "N, Nm"),
        ("off by", "%"),
        ("first parasitic", "Hz"),
    ]
    heads += [("off by", "%"), ("largest stress", "MPa"), ("off by", "%"), ("", "")]
    return [
        *_verification(pose), "<h3>The same pose by other ways</h3>", table(heads, rows),
        "<p>“Off by” is the difference from the first line. More modes or elements per leaf show the error of the mesh, "
        "the other methods that of the method.</p>",
    ]  # fmt: skip


def _verification(pose: Any) -> list[str]:
    """The result of integrating every leaf spring, where the pose can be verified."""
    try:
        return [f"<p>{escape(pose.verify().sentence)}.</p>"]
    except KsdError:
        return []


def _difference_percent(value: float, reference: float) -> float:
    """Relative difference [%]; nan without a reference."""
    return 100 * (value / reference - 1) if reference else math.nan
