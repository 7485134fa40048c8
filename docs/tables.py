"""Pages of the site made from the package and from results of the benchmarks, so that no number is typed by hand."""

from __future__ import annotations

from pathlib import Path


def write_tables(folder: Path) -> None:
    """Write the pages of `folder` that are made when the site is built."""
    folder.mkdir(exist_ok=True)
