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

from ksd.errors import RecordError
from ksd.library.files import BLOCK, _seal, write_atomically

SIGNATURE, FORMAT = b"ksd table\n", 1
"""First bytes of a table, and the format this version writes and reads."""
SEAL = "sha256"
"""The key of a JSON answer that holds its checksum."""


def write_columns(columns: Mapping[str, Any], path: Path, *, about: Mapping[str, str]) -> Path:
    """Write columns (float arrays or lists of text) to `path`, whole or not at all; `about` becomes attributes."""
    import h5py

    body = io.BytesIO()
    with h5py.File(body, "w", libver=("earliest", "v110"), userblock_size=BLOCK) as file:
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
    content = body.getvalue()[BLOCK:]
    write_atomically(_seal(content, FORMAT, SIGNATURE) + content, path)
    return path


def read_columns(path: str | os.PathLike[str]) -> tuple[dict[str, Any], dict[str, str]]:
    """Columns and attributes as `write_columns` wrote them, in the same order.

    Raises RecordError when the file is missing, foreign, truncated or altered in any bit.
    """
    import h5py

    content = _content(path, "table")
    if content[:BLOCK] != _seal(content[BLOCK:], FORMAT, SIGNATURE):
        raise RecordError(f"{path} is damaged or no ksd table (checksum); make it again or restore it.")
    found: dict[int, tuple[str, Any]] = {}
    with h5py.File(io.BytesIO(content), "r") as file:
        about = {key: str(text) for key, text in file.attrs.items()}
        for made in file.values():
            text = h5py.check_string_dtype(made.dtype) is not None
            values = made.asstr()[()].tolist() if text else made[()]
            found[int(made.attrs["column"])] = str(made.attrs["name"]), values
    return {name: values for _, (name, values) in sorted(found.items())}, about


def _content(path: str | os.PathLike[str], kind: str) -> bytes:
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise RecordError(
            f"Cannot read {kind} {path}: {error.strerror}; check the name of the file."
        ) from error


def _text(numbers: Mapping[str, Any]) -> str:
    return json.dumps(numbers, indent=1, allow_nan=False) + "\n"


def write_answer(numbers: Mapping[str, Any], path: str | os.PathLike[str]) -> Path:
    """Write a JSON object to `path` with its checksum as last entry, whole or not at all. Returns the path.

    Raises RecordError when it cannot be written, ValueError for numbers that are not finite.
    """
    seal = hashlib.sha256(_text(numbers).encode()).hexdigest()
    write_atomically(_text({**numbers, SEAL: seal}).encode(), Path(path))
    return Path(path)


def read_answer(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The JSON object `write_answer` wrote, without its checksum (`ksd.read_result`).

    Raises RecordError when the file is missing, no such answer, truncated or altered in any bit.
    """
    content = _content(path, "result")
    damaged = f"{path} is damaged or no ksd result (checksum); solve again or restore it."
    try:
        numbers = json.loads(content)
        seal = numbers.pop(SEAL)
        plain = _text(numbers)
    except (ValueError, KeyError, AttributeError, TypeError, RecursionError) as error:
        raise RecordError(damaged) from error
    # the bytes, not only the numbers: written again they must be the same
    same = content == _text({**numbers, SEAL: seal}).encode()
    if not same or seal != hashlib.sha256(plain.encode()).hexdigest():
        raise RecordError(damaged)
    return dict(numbers)
