"""The HTML page of an optimum: job, design, active constraints, worst pose, search and answers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ksd.errors import KsdError
from ksd.html import as_html
from ksd.pages.page_parts import cards, document, escape, figure, format_cell, table
from ksd.study.table import OK
from ksd.view.optimum_plot import plot_optimum

if TYPE_CHECKING:
    from ksd.optimisation.optimum import Optimum

WORTH_EXPLANATION = (
    "Worth: percent by which the worst target grows per percent that a limit or bound is moved; of targets the share "
    "that each has in the worst, of rules per percent of their range, of a bound at 0 per percent of the range of its "
    "parameter."
)


def optimum_page(optimum: Optimum) -> str:
    """The page as HTML text."""
    name = str(getattr(optimum.mechanism, "name", "") or "mechanism")
    parts = [
        cards(_cards(optimum)),
        *_worst_pose(optimum),
        "<h2>The job</h2>", as_html(str(optimum.job)), _job(optimum),
        "<h2>The optimum and what holds it</h2>", as_html(str(optimum)), f"<p>{WORTH_EXPLANATION}</p>",
        "<h2>How it was found</h2>", *_search(optimum),
        "<h2>Answers</h2>", _answers(optimum),
    ]  # fmt: skip
    return document(name, "optimum report", parts)


def _cards(optimum: Optimum) -> list[tuple[str, str]]:
    """The main numbers, each with its name."""
    starts = f"{optimum.agreed} of {len(optimum.starts)}"
    return [
        (format_cell(optimum.job.merit_sign * optimum.merit, 6), optimum.job.merit_name),
        (optimum.status, "status"),
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
    """A table of targets, rules, drive values and load cases."""
    job = optimum.job
    rows: list[tuple[str, str]] = []
    for column, a in {a.column.split("[")[0]: a for a in job.answers if a.role != "limit"}.items():
        rows.append((a.role, f"{column} over {format_cell(a.scale)}"))
    rows += [("rule", n) for n in job.rule_names]
    for name, values in job.drives.items():
        listing = ", ".join(format_cell(v) for v in values.tolist())
        rows.append(("drive", f"{name}: {listing} (SI)"))
    rows += [("load case", case) for case in job.cases if case]
    return table((("", ""), ("", "")), rows)


def _search(optimum: Optimum) -> list[str]:
    """A picture of the convergence, and a table of the starts."""
    units = {name: optimum.job.unit(name) for name in optimum.job.parameters}
    heads: list[tuple[str, str]] = [("start", ""), *((name, unit) for name, (unit, _) in units.items())]
    heads += [("worst target", ""), ("values", ""), ("gradients", ""), ("", "")]
    rows: list[tuple[Any, ...]] = []
    for k, s in enumerate(optimum.starts):
        reason = "" if s.status == OK else s.status
        rows.append(
            (
                f"{k + 1}",
                *(f"{v / units[n][1]:.4g}" for n, v in s.start.items()),
                s.merit,
                s.values,
                s.gradients,
                reason,
            )
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
