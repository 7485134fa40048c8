"""`ksd effects SCENE.toml`: what every effect changes and costs, as a table and a bar picture."""

from __future__ import annotations

import argparse
import math
from typing import Any

from rich import box
from rich.table import Table

from ksd.answers.printing import format_signed_percent
from ksd.cli.output import STDOUT, check_json, check_plot, console, write_json
from ksd.cli.solve import load_with_options
from ksd.library.result_files import json_object
from ksd.model.chosen_effects import EffectChoice
from ksd.model.description import curved_bar_text, effect_reason
from ksd.study.effect_cost import EffectCost, effect_cost
from ksd.view.effect_cost_plot import plot_effect_cost
from ksd.view.figure import new_figure, save_figure


def run(options: argparse.Namespace) -> int:
    """Load, solve every variant, print, write. Errors as in `ksd.solve` and `ksd.load_scene`."""
    check_json(options.json)
    check_plot(options.plot)
    scene, targets, written = load_with_options(options.scene, options.set)
    accuracy = options.accuracy or written.get("accuracy") or 1e-3
    choice, rows = effect_cost(scene, targets)
    if options.json:
        write_json(as_dict(choice, rows), options.json)
    if options.json != STDOUT:
        _print(scene, choice, rows)
    if options.plot:
        why = {effect.name: effect_reason(effect, scene) for effect in choice.effects}
        _draw(rows, why, accuracy, options.plot)
    return 0


def _print(scene: Any, choice: EffectChoice, rows: list[EffectCost]) -> None:
    """Print a row per effect, and the reason why each effect of the choice is simulated or not."""
    title = f"{scene.name}: every effect switched on and off, the others as chosen"
    keys = list(dict.fromkeys(key for row in rows for key in row.without))
    names = {
        "effect": [row.name for row in rows],
        "chosen": ["with" if row.is_simulated else "without" for row in rows],
    }
    changes = [row.relative_changes() for row in rows]
    answers = {key: [_change(row[key]) if key in row else "-" for row in changes] for key in keys}
    cost = {
        "time [\N{MICRO SIGN}s]": [_range(row, 1e6 * row.times[1], 1e6 * row.times[0]) for row in rows],
        "unknowns": [_range(row, row.unknowns[1], row.unknowns[0]) for row in rows],
    }
    screen = console()
    # cells that do not fit would be cut off: columns go on in a further table
    shown: dict[str, list[str]] = {}
    for head, cells in (answers | cost).items():
        if shown and _table_width(_table("", names, shown | {head: cells})) > screen.width:
            screen.print(_table(title, names, shown))
            shown, title = {}, ""
        shown[head] = cells
    screen.print(_table(title, names, shown))
    for row in rows:
        if row.failure:
            screen.print(f"{row.name}: no numbers, {row.failure}", soft_wrap=True)
    for effect in choice.effects:
        screen.print(
            f"{'with' if effect.present else 'without'} {effect.name}: {effect_reason(effect, scene)}",
            soft_wrap=True,
        )
    curved = curved_bar_text(scene)
    if curved:
        screen.print(f"not modelled: {curved}", soft_wrap=True)


def _table(title: str, names: dict[str, list[str]], columns: dict[str, list[str]]) -> Table:
    """A table of cells by column, names to the left, no cell narrower than its text."""
    table = Table(title=title or None, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    for head, cells in (names | columns).items():
        width = max(map(len, (*head.split(), *cells)), default=0)
        table.add_column(head, justify="left" if head in names else "right", width=width)
    for row in zip(*names.values(), *columns.values(), strict=True):
        table.add_row(*row)
    return table


def _table_width(table: Table) -> int:
    """Characters that a table needs, three between columns."""
    return sum((column.width or 0) + 3 for column in table.columns)


def _range(row: EffectCost, without: float, with_: float) -> str:
    """The cost without and with an effect, as text; "-" where there are no numbers."""
    return "-" if row.failure else f"{without:.0f}\N{EN DASH}{with_:.0f}"


def _change(value: float) -> str:
    """The relative change that adding the effect makes, as text in percent."""
    if not math.isfinite(value):
        return "-"
    return "0" if abs(value) < 1e-9 else f"{format_signed_percent(100 * value)} %"


def _draw(rows: list[EffectCost], why: dict[str, str], accuracy: float, path: str) -> None:
    """Write a picture of the largest relative change and the cost of each effect; why: reason by effect."""
    done = [row for row in rows if not row.failure]
    figure = new_figure(10.0, 1.2 + 0.62 * len(done))
    axes = figure.subplots(1, 2, gridspec_kw={"width_ratios": (3, 2)})
    worst = [
        max((abs(c) for c in r.relative_changes().values() if math.isfinite(c)), default=0.0) for r in done
    ]
    costs = [r.times[0] / r.times[1] - 1.0 for r in done]
    plot_effect_cost(
        tuple(axes), [r.name for r in done], worst, costs,
        kept=[r.is_simulated for r in done], reasons=[why[r.name] for r in done], accuracy=accuracy,
    )  # fmt: skip
    save_figure(figure, path)


def as_dict(choice: EffectChoice, rows: list[EffectCost]) -> dict[str, Any]:
    """The reasons and numbers of all effects for JSON, None for no number; relative_change: by adding the effect."""
    return json_object(
        {
            "effects": {e.name: {"simulated": e.present, "reason": e.reason} for e in choice.effects},
            "effect_cost": {
                r.name: {
                    "simulated": r.is_simulated,
                    "with": r.with_,
                    "without": r.without,
                    "relative_change": r.relative_changes(),
                    "time_with_s": None if r.failure else r.times[0],
                    "time_without_s": None if r.failure else r.times[1],
                    "unknowns_with": r.unknowns[0],
                    "unknowns_without": r.unknowns[1],
                    "failed": r.failure,
                }
                for r in rows
            },
        }
    )
