"""Result files with checksums: tables in HDF5 and answers in JSON; altered or truncated files are refused.

A table has one dataset per column, units in the column names, text as UTF-8, and the same header of 512 bytes as a record
file (an HDF5 user block, which other programs skip). A JSON answer contains the SHA-256 of its own text without that line.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ksd.errors import RecordError, SceneError
from ksd.files import read_file, write_file
from ksd.hdf5 import BoundedReader, read_hdf5
from ksd.library.record_files import HEADER_BYTES, sealed_header

SIGNATURE, FORMAT = b"ksd table\n", 1
"""First bytes of a table file, and the format that this version writes and reads."""
MAX_RESULT_BYTES = 1 << 26
"""Largest JSON answer that is read [bytes], 64 MiB; as Python objects it takes several times that."""
CHECKSUM_KEY = "sha256"
"""Key of the checksum in a JSON answer."""


def write_columns(columns: Mapping[str, Any], path: Path, *, about: Mapping[str, str]) -> Path:
    """Write columns (float arrays or lists of text) to `path` atomically; `about` becomes attributes. Returns the path."""
    import h5py

    body = io.BytesIO()
    with h5py.File(body, "w", libver=("earliest", "v110"), userblock_size=HEADER_BYTES) as file:
        for key, text in about.items():
            file.attrs[key] = text
        for n, (name, values) in enumerate(columns.items()):
            # "/" would make a group
            dataset_name = name.replace("/", "|")
            if isinstance(values, list):
                dataset = file.create_dataset(dataset_name, data=values, dtype=h5py.string_dtype())
            else:
                array = np.asarray(values, float)
                dataset = file.create_dataset(dataset_name, data=array, fletcher32=len(values) > 0)
            dataset.attrs["name"], dataset.attrs["column"] = name, n
    content = body.getvalue()[HEADER_BYTES:]
    return write_file(path, sealed_header(content, FORMAT, SIGNATURE) + content, what="table")


def read_columns(path: str | os.PathLike[str]) -> tuple[dict[str, Any], dict[str, str]]:
    """Columns and attributes of a file of `write_columns`, in the order in which they were written.

    Raises RecordError when the file is missing, no table, truncated or altered in any bit.
    """

    def read(reader: BoundedReader) -> tuple[dict[int, tuple[str, Any]], dict[str, str]]:
        """(name, values) of the columns by their number, and the attributes of the file."""
        columns = {}
        for dataset in reader.items(reader.file).values():
            values = reader.numbers(dataset) if dataset.dtype.kind == "f" else reader.texts(dataset)
            columns[reader.whole(dataset.attrs, "column")] = reader.text(dataset.attrs, "name"), values
        return columns, {key: reader.text(reader.file.attrs, key) for key in reader.file.attrs}

    content = read_file(path, what="table", error=RecordError)
    if content[:HEADER_BYTES] != sealed_header(content[HEADER_BYTES:], FORMAT, SIGNATURE):
        raise RecordError(f"{path} is damaged or no ksd table (checksum); make it again or restore it.")
    try:
        by_number, about = read_hdf5(content, read)
        columns = {name: values for _, (name, values) in sorted(by_number.items())}
        if len({len(values) for values in columns.values()}) > 1 or any(
            np.ndim(v) != 1 for v in columns.values()
        ):
            raise ValueError("its columns are not of one length")
        return columns, about
    except Exception as error:
        # a correct checksum does not mean that the content is correct: h5py raises any exception
        message = " ".join(str(error).split()).rstrip(".") or type(error).__name__
        raise RecordError(f"{path} is sealed but no ksd table ({message}); make it again.") from error


def _json_text(numbers: Mapping[str, Any]) -> str:
    """The text of a JSON answer. Raises ValueError for numbers that are not finite."""
    return json.dumps(numbers, indent=1, allow_nan=False) + "\n"


def json_object(values: Mapping[str, Any]) -> dict[str, Any]:
    """Numbers, texts and arrays by name, nested as they may be, for strict JSON: None for numbers that are not finite."""
    return {key: _json_value(value) for key, value in values.items()}


def _json_value(value: Any) -> Any:
    if isinstance(value, Mapping):
        return json_object(value)
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, tuple | list):
        return [_json_value(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_result(numbers: Mapping[str, Any], path: str | os.PathLike[str]) -> Path:
    """Write a JSON object to `path` atomically, with its checksum as last entry. Returns the path.

    Raises SceneError when it cannot be written, or is no valid JSON, as with numbers that are not finite.
    """
    try:
        seal = hashlib.sha256(_json_text(numbers).encode()).hexdigest()
    except (ValueError, TypeError) as error:
        raise SceneError(
            f"result '{path}' cannot be written: {error}; give finite numbers, texts and lists."
        ) from error
    return write_file(path, _json_text({**numbers, CHECKSUM_KEY: seal}), what="result")


def read_result(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The content of a file written by `--json FILE` of the command line, without its checksum.

    path: the file. Raises RecordError when it is missing, no such answer, truncated or altered in any bit.

    >>> from ksd.cli import main
    >>> code = main(["doctor", "guide", "--json", "found.json"])
    guide: 1 freedom before driving...
    >>> ksd.read_result("found.json")["freedoms"]
    1
    """
    content = read_file(path, what="result", error=RecordError, most=MAX_RESULT_BYTES)
    damaged = f"{path} is damaged or no ksd result (checksum); solve again or restore it."
    try:
        numbers = json.loads(content)
        seal = numbers.pop(CHECKSUM_KEY)
        unsealed = _json_text(numbers)
    except (ValueError, KeyError, AttributeError, TypeError, RecursionError, MemoryError) as error:
        raise RecordError(damaged) from error
    # the bytes must be equal, not only the numbers
    is_same = content == _json_text({**numbers, CHECKSUM_KEY: seal}).encode()
    if not is_same or seal != hashlib.sha256(unsealed.encode()).hexdigest():
        raise RecordError(damaged)
    return dict(numbers)
