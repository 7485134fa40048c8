"""The labelled table a sweep returns: a row per pose, units in the column names, failures as rows that say why."""

from __future__ import annotations

import csv
import io
import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich import box
from rich.table import Table as Grid
from rich.text import Text

from ksd.errors import RecordError, SceneError
from ksd.files import write_file
from ksd.library.tables import read_columns, write_columns
from ksd.properties.words import number, printed
from ksd.view import plot_stroke, save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STATUS = "status"
"""The column that says "ok", or why a row has no numbers."""
OK = "ok"


@dataclass(frozen=True, repr=False)
class Table:
    """Rows of a sweep.

    columns: values (rows,) by column name; numbers are floats (nan where a row failed), texts are str. labels: the
    columns that say where a row belongs: design parameters, load case, drives; moving: the drives that change along a
    stroke. name: of the mechanism. facts: how
    the rows were made, as text.
    """

    columns: Mapping[str, tuple[Any, ...]]
    labels: tuple[str, ...]
    moving: tuple[str, ...] = ()
    name: str = "sweep"
    facts: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of_rows(
        cls,
        rows: Sequence[Mapping[str, Any]],
        labels: Sequence[str],
        *,
        moving: tuple[str, ...] = (),
        name: str = "sweep",
        facts: Mapping[str, str] | None = None,
    ) -> Table:
        """A table of rows that need not have the same keys; numbers missing are nan, texts empty."""
        names = list(dict.fromkeys([*labels, *(key for row in rows for key in row)]))
        names = [n for n in names if n != STATUS] + [STATUS]
        blank: dict[str, Any] = {}
        for n in names:
            known = [row[n] for row in rows if n in row]
            blank[n] = "" if any(isinstance(v, str) for v in known) else math.nan
        columns = {n: tuple(row.get(n, blank[n]) for row in rows) for n in names}
        return cls(columns, tuple(labels), moving, name, facts or {})

    def __len__(self) -> int:
        return len(self.columns[STATUS])

    def __getitem__(self, name: str) -> Any:
        """One column: a float array (rows,), or a list of texts. SceneError names the columns there are."""
        if name not in self.columns:
            raise SceneError(f"there is no column '{name}'; there are {', '.join(self.columns)}")
        values = self.columns[name]
        return list(values) if any(isinstance(v, str) for v in values) else np.array(values, float)

    def __repr__(self) -> str:
        bad = len(self.failures)
        return f"<Table of '{self.name}': {len(self)} rows, {len(self.columns)} columns, {bad} failed>"

    def __str__(self) -> str:
        return printed(self._short(), width=120)

    def _short(self) -> Any:
        """The first eight columns and the status, as printed."""
        shown = [n for n in self.columns if n not in ("method", STATUS)][:8]
        grid = Grid(box=box.SIMPLE_HEAD, pad_edge=False, title=repr(self).strip("<>"), title_justify="left")
        for n in [*shown, STATUS]:
            words, unit = spoken_column(n)
            grid.add_column(Text(f"{words}\n[{unit}]" if unit else words), overflow="fold", justify="right")
        for row in self.rows():
            said = [v if isinstance(v, str) else number(v, 5, zero=1e-9) for v in (row[n] for n in shown)]
            grid.add_row(*(Text(s) for s in (*said, row[STATUS])))
        return grid

    def rows(self) -> Iterator[dict[str, Any]]:
        """Every row by column name."""
        for values in zip(*self.columns.values(), strict=True):
            yield dict(zip(self.columns, values, strict=True))

    @property
    def failures(self) -> list[dict[str, Any]]:
        """Labels and status of the rows without full answers."""
        keep = (*self.labels, STATUS)
        return [{k: row[k] for k in keep} for row in self.rows() if row[STATUS] != OK]

    def where(self, **labels: float | str) -> Table:
        """The rows whose label columns have these values (numbers to 1e-9)."""
        kept = [row for row in self.rows() if all(_same(row[k], v) for k, v in labels.items())]
        return Table.of_rows(kept, self.labels, moving=self.moving, name=self.name, facts=self.facts)

    def plot(
        self,
        *questions: str,
        path: str | os.PathLike[str] | None = None,
        over: str | None = None,
        wide: int = 3,
    ) -> Figure:
        """Matplotlib figure of the answers over the stroke, written to `path` (.png, .pdf, .svg ...) if given.

        questions: which, all that the table holds when none is named. over: label column of the horizontal axis, the
        one with most values when None. wide: panels side by side. Raises SceneError for a question the table has no
        answer to.
        """
        figure = plot_stroke(self, questions, over=over, wide=wide)
        return figure if path is None else save_figure(figure, path)

    def to_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write comma-separated values (UTF-8, full precision, one header line). Returns the path."""
        text = io.StringIO(newline="")
        writer = csv.writer(text)
        writer.writerow(self.columns)
        writer.writerows(zip(*self.columns.values(), strict=True))
        return write_file(path, text.getvalue(), what="table")

    def to_hdf5(self, path: str | os.PathLike[str]) -> Path:
        """Write one dataset per column, facts as attributes (HDF5, sealed: see `from_hdf5`). Returns the path."""
        about = {**self.facts, "name": self.name, "labels": ", ".join(self.labels)}
        about["moving"] = ", ".join(self.moving)
        return write_columns({n: self[n] for n in self.columns}, Path(path), about=about)

    @classmethod
    def from_hdf5(cls, path: str | os.PathLike[str]) -> Table:
        """The table `to_hdf5` wrote. RecordError for a file that is missing, foreign, cut or altered in any bit."""
        columns, facts = read_columns(path)
        name, labels, moving = (facts.pop(k, "") for k in ("name", "labels", "moving"))
        split = [tuple(n for n in said.split(", ") if n) for said in (labels, moving)]
        plain = {n: tuple(v if isinstance(v, list) else v.tolist()) for n, v in columns.items()}
        if {*split[0], *split[1], STATUS} - set(plain) or not isinstance(columns[STATUS], list):
            raise RecordError(f"{path} holds columns, but no table of a sweep; make it again.")
        return cls(plain, split[0], moving=split[1], name=name, facts=facts)

    def to_mat(self, path: str | os.PathLike[str]) -> Path:
        """Write a MATLAB struct `sweep` with a field (rows, 1) per column; field names are the column names with
        what MATLAB does not allow replaced by "_". Returns the path."""
        fields: dict[str, Any] = {}
        for n in self.columns:
            values = self[n]
            fields[matlab_name(n, fields)] = (
                np.array(values, dtype=object)[:, None] if isinstance(values, list) else values[:, None]
            )
        return write_mat(path, {"sweep": fields, "labels": np.array(self.labels, object)})

    def to_xarray(self) -> Any:
        """An xarray Dataset with dimension `row` and the labels as coordinates. SceneError without xarray."""
        try:
            import xarray
        except ImportError as error:
            raise SceneError(
                "xarray is not installed; install it with `pip install xarray`, or use to_csv, to_hdf5 or to_mat"
            ) from error
        named = {n: ("row", np.array(self[n])) for n in self.columns}
        marks = {n: named.pop(n) for n in self.labels}
        return xarray.Dataset(named, coords=marks, attrs={"name": self.name, **self.facts})


_UNITS = (
    "N_per_m", "Nm_per_rad", "N_per_rad", "percent", "mrad", "MPa", "deg", "mm", "Nm", "Hz", "SI", "N", "J",
)  # fmt: skip


def spoken_column(name: str) -> tuple[str, str]:
    """Words and unit of a column: "support_y_N_per_m" is ("support y", "N/m"); no unit is ""."""
    for unit in _UNITS:
        if name.endswith(f"_{unit}"):
            said = "%" if unit == "percent" else unit.replace("_per_", "/")
            return name.removesuffix(f"_{unit}").replace("_", " "), said
    return name.replace("_", " "), ""


def matlab_name(name: str, taken: Mapping[str, Any]) -> str:
    """A MATLAB variable name (63 characters at most) for `name` that is not among `taken`."""
    plain = re.sub(r"\W", "_", name, flags=re.ASCII)
    plain = (plain if plain[:1].isalpha() else f"c_{plain}")[:60]
    found, n = plain, 2
    while found in taken:
        found, n = f"{plain}_{n}", n + 1
    return found


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, str) or isinstance(b, str):
        return bool(a == b)
    return math.isclose(a, float(b), rel_tol=1e-9, abs_tol=1e-12)


def write_mat(path: str | os.PathLike[str], values: Mapping[str, Any]) -> Path:
    """Write arrays and structs for MATLAB, whole or not at all. Returns the path. SceneError where it cannot be
    written."""
    from scipy.io import savemat

    content = io.BytesIO()
    savemat(content, dict(values), long_field_names=True)
    return write_file(path, content.getvalue(), what="MATLAB file")
