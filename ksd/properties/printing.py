"""Answers in print: numbers to significant digits, plain tables, and what a mode does in words.

Every answer has two ways to be shown: its table by ``print``, and one line where a list, a notebook or a debugger shows it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ksd.checks import name_hint, show
from ksd.errors import UnknownNameError
from ksd.html import InNotebooks, Printed
from ksd.model.compile import Model

T = TypeVar("T")
Array = NDArray[np.float64]
TABLE_WIDTH = 100
"""Columns all tables fit in."""
AXES = "xyz"
ROTATION_LEVER = 0.25
"""Lever, over the size of the mechanism, at which the turn of a link is compared with its way."""
MIN_AXIS_COSINE = 0.97
"""Share of one axis in a direction from which on that axis names it."""


def format_number(value: float | None, digits: int = 4, *, zero: float = 0.0) -> str:
    """`value` to significant digits, without an exponent where readable; up to `zero` it is noise: 0."""
    if value is None:
        return "-"
    if abs(value) <= zero:
        return "0"
    if not math.isfinite(value):
        return f"{value}"
    if not 1e-3 <= abs(value) < 1e6:
        return f"{value:.{min(digits, 3) - 1}e}"
    places = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:.{places}f}"


def format_signed_percent(percent: float) -> str:
    """A change with its sign, in two digits, or without an exponent where it is large."""
    return f"{percent:+.2g}" if abs(percent) < 99.5 else f"{percent:+.0f}"


def empty_table(*columns: str) -> Any:
    """An empty table: the first column is text, the others are numbers on the right unless marked by '<'."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    grid = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for i, column in enumerate(columns):
        left = i == 0 or column.startswith("<")
        # as text, or rich would take a unit in brackets for markup
        grid.add_column(Text(column.removeprefix("<")), justify="left" if left else "right", overflow="fold")
    return grid


def render_text(*parts: Any, width: int = TABLE_WIDTH) -> Printed:
    """Rich renderables and plain text as text of so many columns, which notebooks show as the tables it is of."""
    from rich.console import Console

    # in a notebook rich would show it there and then, beside the value of the cell
    console = Console(
        width=width, highlight=False, markup=False, emoji=False, color_system=None, force_jupyter=False
    )
    with console.capture() as text:
        for part in parts:
            console.print(part)
    return Printed("\n".join(line.rstrip() for line in text.get().splitlines()), parts)


class _NoBar:
    """A progress bar that nobody sees: rich takes as long for one as a job for a design, and some versions print a line."""

    def __enter__(self) -> _NoBar:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def __getattr__(self, name: str) -> Callable[..., None]:
        return lambda *_, **__: None


def progress_bar(shown: bool) -> Any:
    """A rich progress bar on stderr, with the count and the time left; what it is called is no markup."""
    if not shown:
        return _NoBar()
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    title = TextColumn("{task.description}", markup=False)
    columns = (title, BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    # rich warns in notebooks that cannot show it
    shown = shown and not (console.is_jupyter and find_spec("ipywidgets") is None)
    return Progress(*columns, console=console, disable=not shown, transient=True)


def format_table(columns: Sequence[str], rows: Sequence[Sequence[str]], *said: str) -> str:
    """Lines `said`, then a table of texts."""
    from rich.text import Text

    grid = empty_table(*columns)
    for row in rows:
        grid.add_row(*(Text(cell) for cell in row))
    return render_text(*said, grid)


def released_text(freed: Sequence[str]) -> str:
    """Which drives and supports are let go, in words."""
    return f"freed: {', '.join(freed)}" if freed else "drives and supports held"


def axis_in_words(direction: Array) -> str:
    """The axis a direction (3,) is along, or its components where it is oblique."""
    size = float(np.linalg.norm(direction))
    unit = direction / size if size > 0.0 else direction
    largest = int(np.argmax(np.abs(unit)))
    if abs(unit[largest]) >= MIN_AXIS_COSINE:
        return AXES[largest]
    # a mode has no sense: its largest component is shown positive
    return "(" + ", ".join(f"{v:.2f}" for v in np.round(unit * np.sign(unit[largest]), 2) + 0.0) + ")"


def node_travel(model: Model, shape: Array) -> Array:
    """(..., nodes) [m]: how far every node moves in fields, shape (..., nodes, 6) [m, rad], rotations counted by LEVER."""
    turn = np.linalg.norm(shape[..., 3:], axis=-1) * ROTATION_LEVER * model.arrays.size
    return np.asarray(np.maximum(turn, np.linalg.norm(shape[..., :3], axis=-1)))


def describe_node_motion(model: Model, shape: Array) -> str:
    """What a node does most, shape (6,) [m, rad]; nothing where it does not move."""
    turn, shift = np.linalg.norm(shape[3:]) * ROTATION_LEVER * model.arrays.size, np.linalg.norm(shape[:3])
    if max(turn, shift) == 0.0:
        return ""
    return (
        f"turns about {axis_in_words(shape[3:])}"
        if turn > shift
        else f"moves along {axis_in_words(shape[:3])}"
    )


def describe_motion(model: Model, shape: Array) -> str:
    """What a displacement field, shape (nodes, 6) [m, rad], does most: the link or block that moves farthest; nothing where
    no link moves."""
    node = int(np.argmax(node_travel(model, shape)))
    does = describe_node_motion(model, shape[node])
    return does and f"'{model.node_names[node]}' {does}"


class NamedAnswers(dict[str, T]):
    """Answers by name; a name there is not raises UnknownNameError with those there are. what: they are, in a word."""

    what = "answer"

    def __init__(self, answers: Mapping[str, T], what: str) -> None:
        super().__init__(answers)
        self.what = what

    def __missing__(self, name: object) -> T:
        raise UnknownNameError(
            f"there is no {self.what} {show(name)}{name_hint(name, self)}", kind=self.what, name=str(name)
        )


class NamedAnswerTable(InNotebooks, NamedAnswers[T]):
    """Answers by name, a mapping that prints as a table: one row per name, made by `row` of the answer."""

    def __init__(
        self, answers: Mapping[str, T], said: str, columns: Sequence[str], row: Callable[[T], Sequence[str]]
    ) -> None:
        super().__init__(answers, columns[0])
        self._said, self._columns, self._row = said, columns, row

    def __repr__(self) -> str:
        names = ", ".join(f"'{name}'" for name in list(self)[:4])
        return f"<{self._said}: of {names}{' ...' * (len(self) > 4)}>"

    def __str__(self) -> str:
        return format_table(
            self._columns, [(name, *self._row(answer)) for name, answer in self.items()], self._said
        )


class PrintableAnswer(InNotebooks):
    """Mixed into answers: one line of `_line` and, in angle brackets, the name of the class where lists show them."""

    def _line(self) -> str:
        raise NotImplementedError

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self._line()}>"
