"""Files that keep finished lines of a sweep, or evaluated designs of a job, so that an interrupted run can continue.

The files are JSON lines; the first one identifies the sweep or job. A line cut off by a crash does not parse or does not
match its hash; it and all lines after it are computed again.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterable
from contextlib import suppress
from copy import copy
from pathlib import Path
from typing import Any

from ksd.checks import show, warn_user
from ksd.errors import RecordError, ResumeError, SceneError, SceneWarning
from ksd.files import check_target, read_file, write_file
from ksd.library.record_files import find_record, record_bytes

Rows = list[dict[str, Any]]


class ResumeFile:
    """Rows of finished entries, kept in memory and, with a path, on disk.

    path: None keeps nothing on disk. fingerprint: identifies the sweep or job. what: "sweep" or "job". entries: rows by
    number of a line (sweep) or by name (job). Raises SceneError where the file belongs to another sweep or job or cannot
    be written.
    """

    def __init__(
        self, path: str | os.PathLike[str] | None, fingerprint: Callable[[], str], *, what: str = "sweep"
    ) -> None:
        if path is not None and not isinstance(path, str | os.PathLike):
            raise SceneError(f"resume = {show(path)}: give the name of a file")
        self.path = None if path is None else Path(path)
        self.what, self._head = what, ""
        self.entries: dict[Any, Rows] = {}
        if self.path is None:
            return
        check_target(self.path, what="resume")
        self._head = json.dumps({f"ksd {what}": fingerprint()})
        intact = self._read() if self.path.exists() and self.path.stat().st_size else [self._head]
        # replaced as a whole: a kill here must not lose the lines of earlier runs
        write_file(self.path, "\n".join(intact) + "\n", what="resume")

    def for_worker(self) -> ResumeFile:
        """The same file for a worker, which adds its entries to it too, where it is on the disk of the worker."""
        own = copy(self)
        own.entries = dict(self.entries)
        own.path = None if self.path is None else self.path.absolute()
        return own

    def read_again(self) -> None:
        """Add the entries that workers have written."""
        if self.path is not None:
            with suppress(SceneError):
                self._read()

    def is_there(self) -> bool:
        """Whether the file on disk is this one."""
        if self.path is None:
            return False
        try:
            with open(self.path, encoding="utf-8") as file:
                return file.readline().rstrip("\n") == self._head
        except (OSError, ValueError):
            return False

    def _read(self) -> list[str]:
        """Lines of the file up to the first damaged one; fills `entries`. Raises SceneError for the file of another run."""
        assert self.path is not None
        lines = read_file(self.path, what="resume").decode("utf-8", errors="replace").splitlines()
        if lines[:1] != [self._head]:
            raise SceneError(
                f"resume = '{self.path}' belongs to another {self.what} (other scene, values, questions, method or joint "
                "records); give another file name, or delete it to begin anew."
            )
        intact, replaced = lines[:1], 0
        for text in lines[1:]:
            digest, _, body = text.partition(" ")
            entry = (
                _parse_entry(body, int if self.what == "sweep" else str) if digest == _hash(body) else None
            )
            if entry is None:
                break
            replaced += self.entries.get(entry["line"], entry["rows"]) != entry["rows"]
            self.entries[entry["line"]] = entry["rows"]
            intact.append(text)
        if replaced:
            warn_user(
                f"resume = '{self.path}' has two lines with different answers for {replaced} of its entries; the later line "
                "is taken",
                SceneWarning,
            )
        return intact

    def add(self, key: int | str, rows: Rows) -> None:
        """Add a finished entry; it is on disk when this returns. Raises ResumeError where it cannot be written."""
        self.entries[key] = rows
        if self.path is None:
            return
        body = json.dumps({"line": key, "rows": rows})
        try:
            # one write, as workers add their lines to the same file
            with open(self.path, "a", encoding="utf-8", buffering=len(body) + 8192) as file:
                file.write(f"{_hash(body)} {body}\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise ResumeError(
                f"resume = '{self.path}' cannot be written any more: {error.strerror}; what is in it is kept, make room "
                "and start again."
            ) from error


def record_hashes(scenes: Iterable[Any], method: str | None) -> list[str]:
    """Family and hash of every joint record that answers of these scenes by a method depend on.

    Where a record cannot be read, the hash is that of the reason; the conventional method depends on no record.
    """
    hashes = []
    families = {placed.joint.family for scene in scenes for placed in scene.joints}
    for family in sorted(families if method != "conventional" else ()):
        try:
            content = record_bytes(find_record(family))
        except RecordError as reason:
            content = str(reason).encode()
        hashes.append(f"{family} {hashlib.sha256(content).hexdigest()}")
    return hashes


def _parse_entry(body: str, kind: type) -> dict[str, Any] | None:
    """An entry written by `ResumeFile.add` whose key is of type `kind`; None for anything else."""
    try:
        entry = json.loads(body)
        values = [value for row in entry["rows"] for value in row.values()]
        valid = isinstance(entry["line"], kind) and all(
            isinstance(v, str | int | float | None) for v in values
        )
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return None
    return entry if valid else None


def _hash(body: str) -> str:
    return hashlib.sha256(body.encode()).hexdigest()[:16]
