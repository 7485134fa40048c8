"""The table that a sweep returns: a row per pose, units in the column names; the status of a failed row is the reason."""

from __future__ import annotations

import io
import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich import box
from rich.table import Table as Grid
from rich.text import Text

from ksd.answers.printing import TABLE_WIDTH, format_number, render_text
from ksd.checks import clear_argument_errors, name_hint, names_of, show
from ksd.errors import RecordError, SceneError
from ksd.files import write_csv, write_file
from ksd.html import NotebookTables
from ksd.library.result_files import read_columns, write_columns
from ksd.solvers.verdict import NOT_SOLVED, NOT_TRUSTED
from ksd.view import plot_stroke, save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STATUS = "status"
"""Name of the column that holds "ok", or why a row has no numbers."""
OK = "ok"

ROWS_PER_END = 5
"""Rows printed at each end of a long table."""
ROUNDING_TOLERANCE = 1e-9
"""Numbers below this, relative to the largest with the same unit, are rounding."""
LEADING_COLUMNS = (
    r".+_(force_N|moment_Nm|effort_SI)", r"error_percent", r"(?!support_).+_stiffness_Nm?_per_\w+", r"support_worst_.*\w",
    r"intended(_\d+)?_Hz", r"first_parasitic_Hz", r"stress_MPa", r"distance_.+_mm", r"buckling_(positive|negative)",
    r"clearance_mm", r"settling_s", r"rms_.+", r".+_error_percent",
)  # fmt: skip
"""Columns that are printed by default, as regular expressions, in the order in which they are printed."""


@dataclass(frozen=True, repr=False)
class Table(NotebookTables):
    """Rows of a sweep.

    columns: values (rows,) by column name; numbers are floats (nan where a row failed), texts are str. labels: the
    columns that identify a row: design parameters, load case, drives; moving: those that vary along a stroke. name: of the
    mechanism. facts: how the rows were computed, as text; "about": notes on the columns, "left_out": questions left out and
    why. leading: the columns that are printed, those of `LEADING_COLUMNS` when empty.

    >>> guide, _, _ = ksd.load_scene("guide")
    >>> table = ksd.sweep(guide, table=[2.5 * mm, 5 * mm], questions="force", progress=False)
    >>> table["table_mm"], table["table_force_N"].round(3)
    (array([2.5, 5. ]), array([2.504, 5.036]))
    """

    columns: Mapping[str, tuple[Any, ...]]
    labels: tuple[str, ...]
    moving: tuple[str, ...] = ()
    name: str = "sweep"
    facts: Mapping[str, str] = field(default_factory=dict)
    leading: tuple[str, ...] = ()

    @classmethod
    def of_rows(
        cls,
        rows: Sequence[Mapping[str, Any]],
        labels: Sequence[str],
        *,
        moving: tuple[str, ...] = (),
        name: str = "sweep",
        facts: Mapping[str, str] | None = None,
        leading: tuple[str, ...] = (),
    ) -> Table:
        """A table of rows that need not have the same keys; missing numbers are nan, missing texts empty."""
        names = list(labels)
        for keys in dict.fromkeys(tuple(row) for row in rows):
            for before, key in pairwise(("", *keys)):
                if key not in names:
                    # next to the column it follows, also where only later rows have it
                    names.insert(names.index(before) + 1 if before else len(labels), key)
        names = [n for n in names if n != STATUS] + [STATUS]
        blank: dict[str, Any] = {}
        for n in names:
            known = [row[n] for row in rows if n in row]
            blank[n] = "" if any(isinstance(v, str) for v in known) else math.nan
        columns = {n: tuple(row.get(n, blank[n]) for row in rows) for n in names}
        return cls(columns, tuple(labels), moving, name, facts or {}, leading)

    def __len__(self) -> int:
        return len(self.columns[STATUS])

    def __getitem__(self, name: str) -> Any:
        """One column: a float array (rows,), or a list of texts. Raises SceneError for an unknown column."""
        if name not in self.columns:
            raise SceneError(f"there is no column {show(name)}{name_hint(name, self.columns)}")
        values = self.columns[name]
        return list(values) if any(isinstance(v, str) for v in values) else np.array(values, float)

    def __repr__(self) -> str:
        refused = len(self.refused)
        failed = f"{len(self.failures) - refused} failed{f', {refused} refused' if refused else ''}"
        return f"<Table of '{self.name}': {len(self)} rows, {len(self.columns)} columns, {failed}>"

    def __str__(self) -> str:
        return render_text(*self._excerpt())

    def _excerpt(self) -> Iterator[Any]:
        """What is printed: the main columns of the first and last rows, failures and warnings by row, all column names."""
        yield repr(self).strip("<>")
        for names in self._column_groups():
            yield self._grid(names)
        for k, (reason, rows) in enumerate(self._reasons().items(), 1):
            yield f"({k}) row{'s' * (len(rows) > 1)} {_ranges(rows)}: {reason}"
        warned = [k for k, warning in enumerate(self.columns.get("warnings", ())) if warning]
        if warned:
            yield f"warnings of {len(warned)} rows, the first: {self.columns['warnings'][warned[0]]}"
        unstable = [k for k, stable in enumerate(self.columns.get("stable", ())) if stable == 0.0]
        if unstable:
            yield f"unstable: row{'s' * (len(unstable) > 1)} {_ranges(unstable)}"
        if self.facts.get("about"):
            yield self.facts["about"]
        if self.facts.get("left_out"):
            yield f"not asked: {self.facts['left_out']}"
        yield f"columns: {', '.join(self.columns)}"

    def _printed_columns(self) -> list[str]:
        """Columns printed in addition to the labels: `leading`, or main columns that are not zero in all of several rows."""
        if self.leading:
            return [n for n in self.leading if n in self.columns]
        answers = [n for n in self.columns if n not in (*self.labels, STATUS)]
        main = [n for pattern in LEADING_COLUMNS for n in answers if re.fullmatch(pattern, n)]
        return [
            n for n in main
            if any(isinstance(v, str) or abs(v) > (self._rounding(n) if len(self) > 1 else -1.0) for v in self.columns[n])
        ]  # fmt: skip

    def _column_groups(self) -> list[list[str]]:
        """Printed columns in groups that fit the width of a page, each with the labels."""
        repeated = [*self.labels, *([STATUS] if self.failures else [])]
        room = TABLE_WIDTH - sum(self._width(n) for n in repeated) - 4
        groups: list[list[str]] = [[]]
        for name in self._printed_columns():
            if groups[-1] and sum(map(self._width, [*groups[-1], name])) > room:
                groups.append([])
            groups[-1].append(name)
        return [[*self.labels, *group, *repeated[len(self.labels) :]] for group in groups]

    def _width(self, name: str) -> int:
        """Width of a column in characters."""
        if name == STATUS:
            return 8
        cells = [self._cell(name, k) for k in self._printed_rows() if k is not None]
        return 3 + max(map(len, (*_header(name).splitlines(), *cells)))

    def _printed_rows(self) -> list[int | None]:
        """Rows that are printed: all of few, else the first and last ones, None for those between."""
        count = len(self)
        if count <= 2 * ROWS_PER_END + 2:
            return list(range(count))
        return [*range(ROWS_PER_END), None, *range(count - ROWS_PER_END, count)]

    def _cell(self, name: str, row: int) -> str:
        """A cell as printed: a failed status as its number in brackets, numbers with 5 digits, nan as "-"."""
        value = self.columns[name][row]
        if name == STATUS:
            reasons = list(self._reasons())
            return value if value == OK else f"({reasons.index(value) + 1})"
        if isinstance(value, str):
            return value
        return "-" if math.isnan(value) else format_number(value, 5, zero=self._rounding(name))

    def _rounding(self, name: str) -> float:
        """Size below which the numbers of a column are rounding."""
        return ROUNDING_TOLERANCE * self._largest[_unit_or_name(name)]

    @cached_property
    def _largest(self) -> dict[str, float]:
        """Largest finite number by unit, over all columns with that unit; by name for a column without unit."""
        largest: dict[str, float] = {}
        for name, column in self.columns.items():
            sizes = (abs(v) for v in column if not isinstance(v, str) and math.isfinite(v))
            key = _unit_or_name(name)
            largest[key] = max(largest.get(key, 0.0), max(sizes, default=0.0))
        return largest

    def _reasons(self) -> dict[str, list[int]]:
        """Row numbers by the reason why they have no full answer."""
        reasons: dict[str, list[int]] = {}
        for k, status in enumerate(self.columns[STATUS]):
            if status != OK:
                reasons.setdefault(status, []).append(k)
        return reasons

    def _grid(self, names: Sequence[str]) -> Any:
        """A rich table of the printed rows of these columns."""
        grid = Grid(box=box.SIMPLE_HEAD, pad_edge=False)
        for name in names:
            is_text = any(isinstance(v, str) for v in self.columns[name])
            grid.add_column(Text(_header(name)), justify="left" if is_text else "right", overflow="fold")
        for row in self._printed_rows():
            cells = ["\N{VERTICAL ELLIPSIS}" if row is None else self._cell(name, row) for name in names]
            grid.add_row(*map(Text, cells))
        return grid

    def rows(self) -> Iterator[dict[str, Any]]:
        """Every row by column name."""
        for values in zip(*self.columns.values(), strict=True):
            yield dict(zip(self.columns, values, strict=True))

    @property
    def failures(self) -> list[dict[str, Any]]:
        """Labels and status of the rows without full answers, and of the refused ones."""
        names = (*self.labels, STATUS)
        return [{n: row[n] for n in names} for row in self.rows() if row[STATUS] != OK]

    @property
    def refused(self) -> list[dict[str, Any]]:
        """Those of the `failures` that `ksd.solve` would refuse: an equilibrium was found, but it is not to be trusted."""
        return [row for row in self.failures if row[STATUS].startswith((NOT_SOLVED, NOT_TRUSTED))]

    @clear_argument_errors
    def where(self, **labels: float | str) -> Table:
        """The rows whose columns have these values (numbers within 1e-9), an empty table when there are none.

        Raises SceneError for an unknown column.
        """
        for name in labels:
            if name not in self.columns:
                raise SceneError(f"there is no column {show(name)}{name_hint(name, self.columns)}")
        rows = [
            i for i, row in enumerate(self.rows()) if all(_is_equal(row[k], v) for k, v in labels.items())
        ]
        return replace(self, columns={n: tuple(v[i] for i in rows) for n, v in self.columns.items()})

    def plot(
        self,
        *questions: str,
        path: str | os.PathLike[str] | None = None,
        over: str | None = None,
        wide: int = 2,
    ) -> Figure:
        """Matplotlib figure of the answers over the stroke, written to `path` (.png, .pdf, .svg ...) if given.

        questions: all that the table has answers to when none is named. over: label column of the horizontal axis, the
        one with most values when None. wide: number of panels side by side. Raises SceneError for a question without
        answers in the table.
        """
        figure = plot_stroke(self, names_of(questions, "questions"), over=over, wide=wide)
        return figure if path is None else save_figure(figure, path)

    def to_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write comma-separated values (UTF-8, full precision, one header line). Returns the path."""
        return write_csv(path, self.columns, zip(*self.columns.values(), strict=True))

    def to_hdf5(self, path: str | os.PathLike[str]) -> Path:
        """Write one dataset per column, facts as attributes (HDF5, with a checksum: see `from_hdf5`). Returns the path."""
        about = {**self.facts, "name": self.name, "labels": ", ".join(self.labels)}
        about["moving"], about["leading"] = ", ".join(self.moving), ", ".join(self.leading)
        return write_columns({n: self[n] for n in self.columns}, Path(path), about=about)

    @classmethod
    def from_hdf5(cls, path: str | os.PathLike[str]) -> Table:
        """Read the table that `to_hdf5` wrote. Raises RecordError for a file that is missing, foreign, cut or altered."""
        columns, facts = read_columns(path)
        name, labels, moving, leading = (facts.pop(k, "") for k in ("name", "labels", "moving", "leading"))
        lists = [tuple(n for n in names.split(", ") if n) for names in (labels, moving, leading)]
        values = {n: tuple(v if isinstance(v, list) else v.tolist()) for n, v in columns.items()}
        if {*lists[0], *lists[1], STATUS} - set(values) or not isinstance(columns[STATUS], list):
            raise RecordError(f"{path} holds columns, but no table of a sweep; make it again.")
        return cls(values, lists[0], moving=lists[1], name=name, facts=facts, leading=lists[2])

    def to_mat(self, path: str | os.PathLike[str]) -> Path:
        """Write a MATLAB struct `sweep` with a field (rows, 1) per column. Returns the path.

        Field names are the column names, with "_" for characters that MATLAB does not allow.
        """
        fields: dict[str, Any] = {}
        for n in self.columns:
            values = self[n]
            fields[matlab_name(n, fields)] = (
                np.array(values, dtype=object)[:, None] if isinstance(values, list) else values[:, None]
            )
        return write_mat(path, {"sweep": fields, "labels": np.array(self.labels, object)})

    def to_xarray(self) -> Any:
        """An xarray Dataset with dimension `row` and the labels as coordinates. Raises SceneError without xarray."""
        try:
            import xarray
        except ImportError as error:
            raise SceneError(
                "xarray is not installed; install it with `pip install xarray`, or use to_csv, to_hdf5 or to_mat"
            ) from error
        variables = {n: ("row", np.array(self[n])) for n in self.columns}
        coordinates = {n: variables.pop(n) for n in self.labels}
        return xarray.Dataset(variables, coords=coordinates, attrs={"name": self.name, **self.facts})


_UNITS = (
    "N_per_m", "Nm_per_rad", "N_per_rad", "m_per_s2", "mm_per_s", "rad_per_s2", "mrad_per_s", "percent", "mrad", "MPa",
    "deg", "mm", "Nm", "Hz", "SI", "us", "um", "N", "J", "s",
)  # fmt: skip


def label_and_unit(name: str) -> tuple[str, str]:
    """Label and unit of a column: ("support y", "N/m") of "support_y_N_per_m"; the unit is "" where there is none."""
    for unit in _UNITS:
        if name.endswith(f"_{unit}"):
            symbol = "%" if unit == "percent" else unit.replace("_per_", "/")
            return name.removesuffix(f"_{unit}").replace("_", " "), symbol
    return name.replace("_", " "), ""


def _unit_or_name(name: str) -> str:
    return label_and_unit(name.partition("[")[0])[1] or name


def _header(name: str) -> str:
    """Header of a column: its label, on two lines if it is long, above its unit."""
    label, unit = label_and_unit(name)
    if len(label) > 9 and " " in label:
        spaces = [k for k, c in enumerate(label) if c == " "]
        cut = min(spaces, key=lambda k: max(k, len(label) - k - 1))
        label = f"{label[:cut]}\n{label[cut + 1 :]}"
    return f"{label}\n[{unit}]" if unit else label


def _ranges(rows: Sequence[int]) -> str:
    """Ascending whole numbers as text: "0-4, 7"."""
    runs: list[list[int]] = []
    for row in rows:
        if runs and row == runs[-1][-1] + 1:
            runs[-1].append(row)
        else:
            runs.append([row])
    return ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs)


def matlab_name(name: str, taken: Mapping[str, Any]) -> str:
    """A MATLAB variable name (63 characters at most) for `name` that is not among `taken`."""
    plain = re.sub(r"\W", "_", name, flags=re.ASCII)
    plain = (plain if plain[:1].isalpha() else f"c_{plain}")[:60]
    unique, n = plain, 2
    while unique in taken:
        unique, n = f"{plain}_{n}", n + 1
    return unique


def _is_equal(a: Any, b: Any) -> bool:
    if isinstance(a, str) or isinstance(b, str):
        return bool(a == b)
    return math.isclose(a, float(b), rel_tol=1e-9, abs_tol=1e-12)


def write_mat(path: str | os.PathLike[str], values: Mapping[str, Any]) -> Path:
    """Write arrays and structs as a MATLAB file, whole or not at all. Returns the path. Raises SceneError where it cannot
    be written."""
    from scipy.io import savemat

    content = io.BytesIO()
    savemat(content, dict(values), long_field_names=True)
    return write_file(path, content.getvalue(), what="MATLAB file")
