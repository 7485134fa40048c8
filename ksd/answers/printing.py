"""Printing of answers: formatted numbers, tables, and short descriptions of motions.

``print`` shows an answer as a table; ``repr`` (lists, notebooks, debuggers) shows it in one line.
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
from ksd.html import NotebookTables, PrintedText
from ksd.model.compile import Model

T = TypeVar("T")
Array = NDArray[np.float64]
TABLE_WIDTH = 100
"""Width of all tables [characters]."""
AXES = "xyz"
ROUNDING = 1e-9
"""Percent and MPa up to which strain and stress are printed as 0."""
ROTATION_LEVER = 0.25
"""Lever, relative to the size of the mechanism, by which rotations are compared with displacements."""
MIN_AXIS_COSINE = 0.97
"""Cosine of the angle to an axis above which a direction is named after that axis."""


def format_number(value: float | None, digits: int = 4, *, zero: float = 0.0) -> str:
    """Format `value` to `digits` significant digits; None is "-", and magnitudes up to `zero` are 0."""
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
    """Format a relative change [%] with its sign, to two digits and without an exponent."""
    return f"{percent:+.2g}" if abs(percent) < 99.5 else f"{percent:+.0f}"


def empty_table(*columns: str) -> Any:
    """Empty rich table; all columns but the first are aligned right unless their name starts with '<'."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    grid = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for i, column in enumerate(columns):
        left = i == 0 or column.startswith("<")
        # as Text: rich would read a unit in brackets as markup
        grid.add_column(Text(column.removeprefix("<")), justify="left" if left else "right", overflow="fold")
    return grid


def render_text(*parts: Any) -> PrintedText:
    """Render rich objects and plain text as text of TABLE_WIDTH characters that notebooks show as HTML tables."""
    from rich.console import Console

    # in a notebook rich would otherwise display the table immediately, in addition to the value of the cell
    console = Console(
        width=TABLE_WIDTH, highlight=False, markup=False, emoji=False, color_system=None, force_jupyter=False
    )
    with console.capture() as text:
        for part in parts:
            console.print(part)
    return PrintedText("\n".join(line.rstrip() for line in text.get().splitlines()), parts)


class _NoBar:
    """Progress bar that shows nothing, for speed: rich takes as long for one as a job takes for a design."""

    def __enter__(self) -> _NoBar:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def __getattr__(self, name: str) -> Callable[..., None]:
        return lambda *_, **__: None


def progress_bar(shown: bool) -> Any:
    """Progress bar on stderr with count and remaining time; it shows nothing unless `shown`."""
    if not shown:
        return _NoBar()
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    title = TextColumn("{task.description}", markup=False)
    columns = (title, BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    # rich warns in notebooks without ipywidgets
    disable = console.is_jupyter and find_spec("ipywidgets") is None
    return Progress(*columns, console=console, disable=disable, transient=True)


def format_table(columns: Sequence[str], rows: Sequence[Sequence[str]], *lines: str) -> str:
    """Text of `lines`, followed by a table with these columns (see `empty_table`) and rows."""
    from rich.text import Text

    grid = empty_table(*columns)
    for row in rows:
        grid.add_row(*(Text(cell) for cell in row))
    return render_text(*lines, grid)


def released_text(freed: Sequence[str]) -> str:
    """Text that names the released drives and supports."""
    return f"freed: {', '.join(freed)}" if freed else "drives and supports held"


def axis_in_words(direction: Array) -> str:
    """Name of the axis that a direction (3,) is along, or its components where it is oblique."""
    size = float(np.linalg.norm(direction))
    unit = direction / size if size > 0.0 else direction
    largest = int(np.argmax(np.abs(unit)))
    if abs(unit[largest]) >= MIN_AXIS_COSINE:
        return AXES[largest]
    # the sign of a mode is arbitrary: its largest component is shown positive
    return "(" + ", ".join(f"{v:.2f}" for v in np.round(unit * np.sign(unit[largest]), 2) + 0.0) + ")"


def node_travel(model: Model, shape: Array) -> Array:
    """Magnitude (..., nodes) [m] of the motion of every node in displacement fields `shape` (..., nodes, 6) [m, rad].

    It is the larger of the displacement and the rotation times ROTATION_LEVER times the size of the mechanism.
    """
    turn = np.linalg.norm(shape[..., 3:], axis=-1) * ROTATION_LEVER * model.arrays.size
    return np.asarray(np.maximum(turn, np.linalg.norm(shape[..., :3], axis=-1)))


def describe_node_motion(model: Model, shape: Array) -> str:
    """Describe the dominant motion of a node, shape (6,) [m, rad]; empty where it does not move."""
    turn, shift = np.linalg.norm(shape[3:]) * ROTATION_LEVER * model.arrays.size, np.linalg.norm(shape[:3])
    if max(turn, shift) == 0.0:
        return ""
    return (
        f"turns about {axis_in_words(shape[3:])}"
        if turn > shift
        else f"moves along {axis_in_words(shape[:3])}"
    )


def name_of_node(model: Model, node: int) -> str:
    """Name of a node; of a point made for a moment or contact along a leaf spring, that of the leaf."""
    name = model.node_names[node]
    return next((p.leaf for p in model.scene.points if p.unlisted and p.name == name), name)


def describe_motion(model: Model, shape: Array) -> str:
    """Describe the motion of the link or block that moves most in a displacement field, shape (nodes, 6) [m, rad].

    Empty where no link moves.
    """
    node = int(np.argmax(node_travel(model, shape)))
    motion = describe_node_motion(model, shape[node])
    return motion and f"'{name_of_node(model, node)}' {motion}"


class NamedAnswers(dict[str, T]):
    """Answers by name, a mapping that raises UnknownNameError with the known names for an unknown one.

    kind: noun for an answer in that message.
    """

    kind = "answer"

    def __init__(self, answers: Mapping[str, T], kind: str) -> None:
        super().__init__(answers)
        self.kind = kind

    def __missing__(self, name: object) -> T:
        raise UnknownNameError(
            f"there is no {self.kind} {show(name)}{name_hint(name, self)}", kind=self.kind, name=str(name)
        )


class NamedAnswerTable(NotebookTables, NamedAnswers[T]):
    """Answers by name, a mapping that prints as a table under `title`.

    row: function that returns the cells of the row of an answer, without its name.
    """

    def __init__(
        self, answers: Mapping[str, T], title: str, columns: Sequence[str], row: Callable[[T], Sequence[str]]
    ) -> None:
        super().__init__(answers, columns[0])
        self._title, self._columns, self._row = title, columns, row

    def __repr__(self) -> str:
        names = ", ".join(f"'{name}'" for name in list(self)[:4])
        return f"<{self._title}: of {names}{' ...' * (len(self) > 4)}>"

    def __str__(self) -> str:
        return format_table(
            self._columns, [(name, *self._row(answer)) for name, answer in self.items()], self._title
        )


class PrintableAnswer(NotebookTables):
    """Mixin of answers: ``repr`` is the name of the class and the one-line summary `_line`."""

    def _line(self) -> str:
        """The answer in one line, without the name of its class."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self._line()}>"
