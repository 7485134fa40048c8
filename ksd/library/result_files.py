"""Results on disk: tables in HDF5 and answers in JSON, sealed, so that an altered or cut file is refused.

A table has one dataset per column, units in the names, text as UTF-8, behind the same 512 sealed bytes as a joint record
(an HDF5 user block, which other programs skip). A JSON answer holds the SHA-256 of its own text without that line.
"""

from __future__ import annotations

import hashlib
import io
import json
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
"""First bytes of a table, and the format this version writes and reads."""
MAX_RESULT_BYTES = 1 << 26
"""Bytes of an answer that is read, 64 MiB; as Python objects it takes several times that."""
CHECKSUM_KEY = "sha256"
"""The key of a JSON answer that holds its checksum."""


def write_columns(columns: Mapping[str, Any], path: Path, *, about: Mapping[str, str]) -> Path:
    """Write columns (float arrays or lists of text) to `path`, whole or not at all; `about` becomes attributes."""
    import h5py

    body = io.BytesIO()
    with h5py.File(body, "w", libver=("earliest", "v110"), userblock_size=HEADER_BYTES) as file:
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
    content = body.getvalue()[HEADER_BYTES:]
    return write_file(path, sealed_header(content, FORMAT, SIGNATURE) + content, what="table")


def read_columns(path: str | os.PathLike[str]) -> tuple[dict[str, Any], dict[str, str]]:
    """Columns and attributes as `write_columns` wrote them, in the same order.

    Raises RecordError when the file is missing, foreign, truncated or altered in any bit, or is sealed but no table.
    """

    def read(found: BoundedReader) -> tuple[dict[int, tuple[str, Any]], dict[str, str]]:
        columns = {}
        for made in found.items(found.file).values():
            values = found.numbers(made) if made.dtype.kind == "f" else found.texts(made)
            columns[found.whole(made.attrs, "column")] = found.text(made.attrs, "name"), values
        return columns, {key: found.text(found.file.attrs, key) for key in found.file.attrs}

    content = read_file(path, what="table", error=RecordError)
    if content[:HEADER_BYTES] != sealed_header(content[HEADER_BYTES:], FORMAT, SIGNATURE):
        raise RecordError(f"{path} is damaged or no ksd table (checksum); make it again or restore it.")
    try:
        found, about = read_hdf5(content, read)
        columns = {name: values for _, (name, values) in sorted(found.items())}
        if len({len(values) for values in columns.values()}) > 1 or any(
            np.ndim(v) != 1 for v in columns.values()
        ):
            raise ValueError("its columns are not of one length")
        return columns, about
    except Exception as error:
        # a seal says that nothing was altered since, not that it was right: h5py raises what it likes
        said = " ".join(str(error).split()).rstrip(".") or type(error).__name__
        raise RecordError(f"{path} is sealed but no ksd table ({said}); make it again.") from error


def _json_text(numbers: Mapping[str, Any]) -> str:
    return json.dumps(numbers, indent=1, allow_nan=False) + "\n"


def write_result(numbers: Mapping[str, Any], path: str | os.PathLike[str]) -> Path:
    """Write a JSON object to `path` with its checksum as last entry, whole or not at all. Returns the path.

    Raises SceneError when it cannot be written, or holds what is no JSON, such as numbers that are not finite.
    """
    try:
        seal = hashlib.sha256(_json_text(numbers).encode()).hexdigest()
    except (ValueError, TypeError) as error:
        raise SceneError(
            f"result '{path}' cannot be written: {error}; give finite numbers, texts and lists."
        ) from error
    return write_file(path, _json_text({**numbers, CHECKSUM_KEY: seal}), what="result")


def read_result(path: str | os.PathLike[str]) -> dict[str, Any]:
    """What `--json FILE` of the command line wrote, without its checksum (`ksd.read_result`).

    Raises RecordError when the file is missing, no such answer, truncated or altered in any bit.
    """
    content = read_file(path, what="result", error=RecordError, most=MAX_RESULT_BYTES)
    damaged = f"{path} is damaged or no ksd result (checksum); solve again or restore it."
    try:
        numbers = json.loads(content)
        seal = numbers.pop(CHECKSUM_KEY)
        plain = _json_text(numbers)
    except (ValueError, KeyError, AttributeError, TypeError, RecursionError, MemoryError) as error:
        raise RecordError(damaged) from error
    # the bytes, not only the numbers: written again they must be the same
    same = content == _json_text({**numbers, CHECKSUM_KEY: seal}).encode()
    if not same or seal != hashlib.sha256(plain.encode()).hexdigest():
        raise RecordError(damaged)
    return dict(numbers)
