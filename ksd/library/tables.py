"""Plain tables in HDF5: one dataset per column, units in the names, text as UTF-8."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ksd.library.files import write_atomically


def write_columns(columns: Mapping[str, Any], path: Path, *, about: Mapping[str, str]) -> Path:
    """Write columns (float arrays or lists of text) to `path`, whole or not at all; `about` becomes attributes."""
    import h5py

    body = io.BytesIO()
    with h5py.File(body, "w", libver=("earliest", "v110")) as file:
        for key, text in about.items():
            file.attrs[key] = text
        for n, (name, values) in enumerate(columns.items()):
            # "/" would make a group
            place = name.replace("/", "|")
            if isinstance(values, list):
                made = file.create_dataset(place, data=values, dtype=h5py.string_dtype())
            else:
                made = file.create_dataset(place, data=np.asarray(values, float), fletcher32=len(values) > 0)
            made.attrs["name"], made.attrs["column"] = name, n
    write_atomically(body.getvalue(), path)
    return path


def read_columns(path: Path) -> tuple[dict[str, Any], dict[str, str]]:
    """Columns and attributes as `write_columns` wrote them, in the same order."""
    import h5py

    found: dict[int, tuple[str, Any]] = {}
    with h5py.File(path, "r") as file:
        about = {key: str(text) for key, text in file.attrs.items()}
        for made in file.values():
            text = h5py.check_string_dtype(made.dtype) is not None
            values = made.asstr()[()].tolist() if text else made[()]
            found[int(made.attrs["column"])] = str(made.attrs["name"]), values
    return {name: values for _, (name, values) in sorted(found.items())}, about
