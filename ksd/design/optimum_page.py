"""The HTML page of an optimum: job, design, active constraints, worst pose, search and answers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ksd.design.page_parts import cards, document, escape, figure, format_cell, table
from ksd.design.table import OK
from ksd.errors import KsdError
from ksd.view.optimum_plot import plot_optimum

if TYPE_CHECKING:
    from ksd.design.optimum import Optimum

NO_GRADIENT_TEXT = "What holds it is not known: there is no gradient at this design"


def optimum_page(optimum: Optimum) -> str:
    """The page as HTML text."""
    name = str(getattr(optimum.mechanism, "name", "") or "mechanism")
    parts = [
        cards(_cards(optimum)),
        *_worst_pose(optimum),
        "<h2>The job</h2>", _job(optimum),
        "<h2>The optimum</h2>", *_design(optimum),
        "<h2>What holds it</h2>", *_held(optimum),
        "<h2>How it was found</h2>", *_search(optimum),
        "<h2>Answers</h2>", _answers(optimum),
    ]  # fmt: skip
    return document(name, "optimum report", parts)


def _cards(optimum: Optimum) -> list[tuple[str, str]]:
    """The main numbers, each with its name."""
    starts = f"{optimum.agreed} of {len(optimum.starts)}"
    return [
        (format_cell(optimum.job.merit_sign * optimum.merit, 6), optimum.job.merit_name),
        (starts, "starts end here"),
        (f"{optimum.evaluations} + {optimum.gradients}", "values and gradients"),
        (f"{format_cell(optimum.seconds, 3)} s", "CPU time"),
    ]


def _worst_pose(optimum: Optimum) -> list[str]:
    """A picture of the optimum at the pose of its worst target, or why there is none."""
    try:
        picture = optimum.pose().plot(color="stress")
    except KsdError as why:
        return [
            f'<p class="warn">The pose of {escape(optimum.worst)} was not solved again: {escape(why)}</p>'
        ]
    caption = (
        f"The optimum at its worst pose, over the undeformed one (grey): {optimum.worst} is the worst target."
    )
    return [figure(picture, caption)]


def _job(optimum: Optimum) -> str:
    """A table of targets, limits, rules, drive values and load cases."""
    job = optimum.job
    rows: list[tuple[str, str]] = []
    for column, a in {a.column.split("[")[0]: a for a in job.answers if a.role != "limit"}.items():
        rows.append((a.role, f"{column} over {format_cell(a.scale)}"))
    for column, (low, high) in job.limits.items():
        ends = [f"at least {format_cell(low)}"] * bool(np.isfinite(low))
        ends += [f"at most {format_cell(high)}"] * bool(np.isfinite(high))
        rows.append(("limit", " ".join([column, *ends])))
    rows += [("rule", n) for n in job.rule_names]
    for name, values in job.drives.items():
        listing = ", ".join(format_cell(v) for v in values.tolist())
        rows.append(("drive", f"{name}: {listing} (SI)"))
    rows += [("load case", case) for case in job.cases if case]
    return table((("", ""), ("", "")), rows)


def _design(optimum: Optimum) -> list[str]:
    """A table of the parameters with their bounds."""
    job = optimum.job
    heads = [("parameter", ""), ("value", "SI"), ("least", "SI"), ("most", "SI"), ("", "")]
    rows = []
    for (name, value), (low, high) in zip(optimum.design.items(), job.bounds.tolist(), strict=True):
        reasons = "; ".join(
            job.bound_reasons[name, s] for s in ("least", "most") if (name, s) in job.bound_reasons
        )
        rows.append((name, *(f"{v:.6g}" for v in (value, low, high)), reasons))
    return [table(heads, rows)]


def _held(optimum: Optimum) -> list[str]:
    """Tables of the active constraints and of the margins of a robust optimum, and warnings."""
    if not optimum.held:
        return [f"<p>{NO_GRADIENT_TEXT}</p>"]
    heads = [("held by", ""), ("value", "in units of its name"), ("worth", "% per %")]
    rows = [(n, optimum.answers.get(n), worth) for n, worth in optimum.held.items()]
    explanation = (
        "Worth: percent by which the worst target grows per percent that a limit or bound is moved; of targets the share "
        "that each has in the worst, of rules per percent of their range."
    )
    parts = [table(heads, rows), f"<p>{explanation}</p>"]
    if optimum.robust:
        heads = [("answer", ""), ("margin", "in units of its name"), ("value", "in units of its name")]
        margins = [(n, by, optimum.answers[n]) for n, by in optimum.margins.items() if n in optimum.held]
        title = f"Margins for {optimum.robust:g} standard deviations"
        parts += [f"<h3>{title}</h3>", table(heads, margins)]
    if optimum.flat:
        direction = ", ".join(f"{escape(n)} {100 * v:+.3g} %" for n, v in optimum.flat.items())
        parts.append(f'<p class="warn">Flat: nothing that holds it changes along {direction}.</p>')
    return [
        *parts,
        *(f'<p class="warn">{escape(warning)}.</p>' for warning in filter(None, [optimum.few_modes])),
    ]


def _search(optimum: Optimum) -> list[str]:
    """A picture of the convergence, and a table of the starts."""
    heads: list[tuple[str, str]] = [("start", ""), *((n, "SI") for n in optimum.job.parameters)]
    heads += [("worst target", ""), ("values", ""), ("gradients", ""), ("", "")]
    rows: list[tuple[Any, ...]] = []
    for k, s in enumerate(optimum.starts):
        reason = "" if s.status == OK else s.status
        rows.append(
            (f"{k + 1}", *(f"{v:.4g}" for v in s.start.values()), s.merit, s.values, s.gradients, reason)
        )
    return [figure(plot_optimum(optimum), "Every design that was tried."), table(heads, rows)]


def _answers(optimum: Optimum) -> str:
    """Every target and limit at every pose."""
    heads = [("answer", ""), ("role", ""), ("value", ""), ("least", ""), ("most", "")]
    rows = []
    for a in optimum.job.answers:
        ends = [v if np.isfinite(v) else "" for v in (a.low, a.high)]
        rows.append((a.name, a.role, optimum.answers[a.name], *ends))
    return table(heads, rows)
