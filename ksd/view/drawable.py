"""What pictures need of a configuration and of a table of answers, so that nothing here depends on solvers or sweeps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Protocol

from ksd.answers.frequencies import Modes
from ksd.answers.shape import Shape
from ksd.answers.stress import Stress
from ksd.model.compile import Model


class Drawable(Protocol):
    """A deformed configuration as pictures see it; `ksd.Configuration` is one."""

    @property
    def model(self) -> Model:
        """The model of the mechanism."""

    @property
    def method(self) -> str:
        """Name of the method, for the caption."""

    @property
    def targets(self) -> Mapping[str, float]:
        """Drive values [m or rad] by name."""

    @property
    def reported_forces(self) -> Mapping[str, float]:
        """Drive force [N] or moment [Nm] by name."""

    def shape(self, *, points: int = 25) -> Shape:
        """Centrelines of the leaf springs, outlines of the links and driven points."""

    def stress(self, *, points: int = 25) -> Stress:
        """Stress of the leaf springs."""

    def frequencies(self, *, count: int = 6, freed: Sequence[str] = ()) -> Modes:
        """Eigenfrequencies and modes about the configuration."""


class DrawableTable(Protocol):
    """Answers over a stroke as pictures see them; `ksd.Table` is one."""

    @property
    def labels(self) -> Sequence[str]:
        """Columns that tell rows apart: drives, designs, load cases."""

    @property
    def moving(self) -> Sequence[str]:
        """Columns of the drives."""

    @property
    def columns(self) -> Mapping[str, Sequence[Any]]:
        """Values by column."""

    @property
    def failures(self) -> Sequence[Mapping[str, Any]]:
        """Rows of poses without full answers."""

    def rows(self) -> Iterator[Mapping[str, Any]]:
        """Values by column, row by row."""

    def __getitem__(self, column: str) -> Any:
        """Values of a column as an array, or as a list of texts."""
