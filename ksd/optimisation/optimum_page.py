"""The HTML page of an optimum: job, design, active constraints, worst pose, search and answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ksd.html import as_html
from ksd.optimisation.job import Job
from ksd.optimisation.local_search import StartResult
from ksd.pages.page_parts import cards, document, escape, figure, format_cell, table
from ksd.study.table import OK

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WORTH_EXPLANATION = (
    "Worth: percent by which the worst target grows per percent that a limit or bound is moved; of targets the share "
    "that each has in the worst, of rules per percent of their range, of a bound at 0 per percent of the range of its "
    "parameter."
)


def optimum_page(
    job: Job,
    name: str,
    numbers: Sequence[tuple[float | str, str]],
    printed: str,
    worst: str,
    worst_pose: Figure | str,
    starts: Sequence[StartResult],
    search: Figure,
    answers: Mapping[str, float],
) -> str:
    """The page as HTML text.

    name: of the mechanism; numbers: the main ones, each with its name; printed: the optimum as text; worst: name of the
    worst target, worst_pose: picture at its pose, or why there is none; starts and search: result of each start and picture
    of all; answers: by name.
    """
    pose = (
        f'<p class="warn">The pose of {escape(worst)} was not solved again: {escape(worst_pose)}</p>'
        if isinstance(worst_pose, str)
        else figure(
            worst_pose,
            f"The optimum at its worst pose, over the undeformed one (grey): {worst} is the worst target.",
        )
    )
    parts = [
        cards([(format_cell(value, 6), what) for value, what in numbers]),
        pose,
        "<h2>The job</h2>", as_html(str(job)), _job(job),
        "<h2>The optimum and what holds it</h2>", as_html(printed), f"<p>{WORTH_EXPLANATION}</p>",
        "<h2>How it was found</h2>", figure(search, "Every design that was tried."), _starts(job, starts),
        "<h2>Answers</h2>", _answers(job, answers),
    ]  # fmt: skip
    return document(name, "optimum report", parts)


def _job(job: Job) -> str:
    """A table of targets, rules, drive values and load cases."""
    rows: list[tuple[str, str]] = []
    for column, a in {a.asked: a for a in job.answers if a.role != "limit"}.items():
        rows.append((a.role, f"{column} over {format_cell(a.scale)}"))
    rows += [("rule", n) for n in job.rule_names]
    for name, values in job.drives.items():
        listing = ", ".join(format_cell(v) for v in values.tolist())
        rows.append(("drive", f"{name}: {listing} (SI)"))
    rows += [("load case", case) for case in job.cases if case]
    return table((("", ""), ("", "")), rows)


def _starts(job: Job, starts: Sequence[StartResult]) -> str:
    """A table of the starts."""
    units = {name: job.unit(name) for name in job.parameters}
    heads: list[tuple[str, str]] = [("start", ""), *((name, unit) for name, (unit, _) in units.items())]
    heads += [("worst target", ""), ("values", ""), ("gradients", ""), ("", "")]
    rows: list[tuple[Any, ...]] = []
    for k, s in enumerate(starts):
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
    return table(heads, rows)


def _answers(job: Job, answers: Mapping[str, float]) -> str:
    """Every target and limit at every pose."""
    heads = [("answer", ""), ("role", ""), ("value", ""), ("least", ""), ("most", "")]
    rows = []
    for a in job.answers:
        ends = [v if np.isfinite(v) else "" for v in (a.low, a.high)]
        rows.append((a.name, a.role, answers[a.name], *ends))
    return table(heads, rows)
