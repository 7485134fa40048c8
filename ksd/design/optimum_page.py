"""The page of an optimum: job, design, what holds it, its worst pose, how it was found, all answers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ksd.design.page_parts import cards, document, figure, grid, text, written
from ksd.design.table import OK
from ksd.errors import KsdError
from ksd.view.optimum import plot_optimum

if TYPE_CHECKING:
    from ksd.design.optimum import Optimum

NOT_KNOWN = "What holds it is not known: there is no gradient at this design"


def optimum_page(optimum: Optimum) -> str:
    """The page as HTML text."""
    name = str(getattr(optimum.mechanism, "name", "") or "mechanism")
    parts = [
        cards(_cards(optimum)),
        *_worst_pose(optimum),
        "<h2>The job</h2>", _job(optimum),
        "<h2>The optimum</h2>", *_design(optimum),
        "<h2>What holds it</h2>", *_held(optimum),
        "<h2>How it was found</h2>", *_found(optimum),
        "<h2>Answers</h2>", _answers(optimum),
    ]  # fmt: skip
    return document(name, "optimum report", parts)


def _cards(optimum: Optimum) -> list[tuple[str, str]]:
    starts = f"{optimum.agreed} of {len(optimum.starts)}"
    return [
        (written(optimum.job.merit_sign * optimum.merit, 6), optimum.job.merit_name),
        (starts, "starts end here"),
        (f"{optimum.evaluations} + {optimum.gradients}", "values and gradients"),
        (f"{written(optimum.seconds, 3)} s", "CPU time"),
    ]


def _worst_pose(optimum: Optimum) -> list[str]:
    """The optimum where its worst target is, or why there is no picture of it."""
    try:
        drawn = optimum.pose().plot(color="stress")
    except KsdError as why:
        return [f'<p class="warn">The pose of {text(optimum.worst)} was not solved again: {text(why)}</p>']
    said = (
        f"The optimum at its worst pose, over the undeformed one (grey): {optimum.worst} is the worst target."
    )
    return [figure(drawn, said)]


def _job(optimum: Optimum) -> str:
    """Targets, limits, rules and poses."""
    job = optimum.job
    rows: list[tuple[str, str]] = []
    for words, a in {a.column.split("[")[0]: a for a in job.answers if a.role != "limit"}.items():
        rows.append((a.role, f"{words} over {written(a.scale)}"))
    for words, (low, high) in job.limits.items():
        ends = [f"at least {written(low)}"] * bool(np.isfinite(low))
        ends += [f"at most {written(high)}"] * bool(np.isfinite(high))
        rows.append(("limit", " ".join([words, *ends])))
    rows += [("rule", n) for n in job.rule_names]
    for name, values in job.drives.items():
        shown = ", ".join(written(v) for v in values.tolist())
        rows.append(("drive", f"{name}: {shown} (SI)"))
    rows += [("load case", case) for case in job.cases if case]
    return grid((("", ""), ("", "")), rows)


def _design(optimum: Optimum) -> list[str]:
    job = optimum.job
    heads = [("parameter", ""), ("value", "SI"), ("least", "SI"), ("most", "SI"), ("", "")]
    rows = []
    for (name, value), (low, high) in zip(optimum.design.items(), job.bounds.tolist(), strict=True):
        cut = "; ".join(job.held_by[name, s] for s in ("least", "most") if (name, s) in job.held_by)
        rows.append((name, *(f"{v:.6g}" for v in (value, low, high)), cut))
    return [grid(heads, rows)]


def _held(optimum: Optimum) -> list[str]:
    if not optimum.held:
        return [f"<p>{NOT_KNOWN}</p>"]
    heads = [("held by", ""), ("value", "in units of its name"), ("worth", "% per %")]
    rows = [(n, optimum.answers.get(n), worth) for n, worth in optimum.held.items()]
    said = (
        "Worth: percent by which the worst target grows per percent that a limit or bound is moved; of targets the share "
        "that each has in the worst, of rules per percent of their range."
    )
    parts = [grid(heads, rows), f"<p>{said}</p>"]
    if optimum.robust:
        heads = [("answer", ""), ("margin", "in units of its name"), ("value", "in units of its name")]
        moved = [(n, by, optimum.answers[n]) for n, by in optimum.margins.items() if n in optimum.held]
        said = f"Margins for {optimum.robust:g} standard deviations"
        parts += [f"<h3>{said}</h3>", grid(heads, moved)]
    if optimum.flat:
        ways = ", ".join(f"{text(n)} {100 * v:+.3g} %" for n, v in optimum.flat.items())
        parts.append(f'<p class="warn">Flat: nothing that holds it changes along {ways}.</p>')
    return [*parts, *(f'<p class="warn">{text(said)}.</p>' for said in filter(None, [optimum.few_modes]))]


def _found(optimum: Optimum) -> list[str]:
    heads: list[tuple[str, str]] = [("start", ""), *((n, "SI") for n in optimum.job.parameters)]
    heads += [("worst target", ""), ("values", ""), ("gradients", ""), ("", "")]
    rows: list[tuple[Any, ...]] = []
    for k, s in enumerate(optimum.starts):
        said = "" if s.status == OK else s.status
        rows.append(
            (f"{k + 1}", *(f"{v:.4g}" for v in s.start.values()), s.merit, s.values, s.gradients, said)
        )
    return [figure(plot_optimum(optimum), "Every design that was tried."), grid(heads, rows)]


def _answers(optimum: Optimum) -> str:
    """Every target and limit at every pose."""
    heads = [("answer", ""), ("role", ""), ("value", ""), ("least", ""), ("most", "")]
    rows = []
    for a in optimum.job.answers:
        ends = [v if np.isfinite(v) else "" for v in (a.low, a.high)]
        rows.append((a.name, a.role, optimum.answers[a.name], *ends))
    return grid(heads, rows)
