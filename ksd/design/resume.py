"""Finished lines of a sweep, or designs of a job, on disk, so that it goes on: JSON lines, the first says whose they are.

A line cut off by a crash does not parse or does not match its hash; it and what follows is computed again.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from ksd.checks import show
from ksd.errors import RecordError, SceneError
from ksd.files import check_target, read_file, write_file
from ksd.library.record_files import find_record, record_bytes

Rows = list[dict[str, Any]]


class ResumeFile:
    """The file `path` of a sweep, or `what` else, with this `fingerprint`; without a path nothing is kept on disk.

    SceneError when the file belongs to another one or cannot be written.
    """

    def __init__(
        self, path: str | os.PathLike[str] | None, fingerprint: Callable[[], str], *, what: str = "sweep"
    ) -> None:
        if path is not None and not isinstance(path, str | os.PathLike):
            raise SceneError(f"resume = {show(path)}: give the name of a file")
        self.path = None if path is None else Path(path)
        self.what = what
        self.entries: dict[Any, Rows] = {}
        if self.path is None:
            return
        check_target(self.path, what="resume")
        head = json.dumps({f"ksd {what}": fingerprint()})
        intact = self._read(head) if self.path.exists() and self.path.stat().st_size else [head]
        # whole or not at all: a kill here must not cost the lines of the runs before
        write_file(self.path, "\n".join(intact) + "\n", what="resume")

    def _read(self, head: str) -> list[str]:
        """Lines up to the first damaged one."""
        assert self.path is not None
        lines = read_file(self.path, what="resume").decode("utf-8", errors="replace").splitlines()
        if lines[:1] != [head]:
            raise SceneError(
                f"resume = '{self.path}' belongs to another {self.what} (other scene, values, questions, method or joint "
                "records); give another file name, or delete it to begin anew."
            )
        intact = lines[:1]
        for text in lines[1:]:
            mark, _, body = text.partition(" ")
            entry = _entry(body, int if self.what == "sweep" else str) if mark == _hash(body) else None
            if entry is None:
                break
            self.entries[entry["line"]] = entry["rows"]
            intact.append(text)
        return intact

    def add(self, number: int | str, rows: Rows) -> None:
        """Add a finished line, on disk when this returns."""
        self.entries[number] = rows
        if self.path is None:
            return
        body = json.dumps({"line": number, "rows": rows})
        try:
            with open(self.path, "a", encoding="utf-8") as file:
                file.write(f"{_hash(body)} {body}\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise SceneError(
                f"resume = '{self.path}' cannot be written any more: {error.strerror}; what is in it is kept, make room "
                "and start again."
            ) from error


def record_hashes(scenes: Iterable[Any], method: str | None) -> list[str]:
    """What the joint records hold that answers of scenes by this method come from: family and hash of each, or of why there
    is none."""
    found = []
    families = {placed.joint.family for scene in scenes for placed in scene.joints}
    for family in sorted(families if method != "conventional" else ()):
        try:
            said = record_bytes(find_record(family))
        except RecordError as why:
            said = str(why).encode()
        found.append(f"{family} {hashlib.sha256(said).hexdigest()}")
    return found


def _entry(body: str, kind: type) -> dict[str, Any] | None:
    """What `add` wrote under a number or name of this kind; None for anything else."""
    try:
        entry = json.loads(body)
        values = [value for row in entry["rows"] for value in row.values()]
        fits = isinstance(entry["line"], kind) and all(
            isinstance(v, str | int | float | None) for v in values
        )
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return None
    return entry if fits else None


def _hash(body: str) -> str:
    return hashlib.sha256(body.encode()).hexdigest()[:16]
