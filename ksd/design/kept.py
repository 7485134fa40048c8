"""Finished lines of a sweep on disk, so that an interrupted one goes on: JSON lines, the first says whose they are.

A line cut off by a crash does not parse or does not match its hash; it and what follows is computed again.
"""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

from ksd.errors import RecordError, SceneError
from ksd.library.files import write_atomically
from ksd.section.checks import show

Rows = list[dict[str, Any]]


class Kept:
    """The file `path` of a sweep with this `fingerprint`; without a path nothing is kept.

    SceneError when the file belongs to another sweep or cannot be written.
    """

    def __init__(self, path: str | os.PathLike[str] | None, fingerprint: str) -> None:
        if path is not None and not isinstance(path, str | os.PathLike):
            raise SceneError(f"resume = {show(path)}: give the name of a file")
        self.path = None if path is None else Path(path)
        self.found: dict[int, Rows] = {}
        if self.path is None:
            return
        if not self.path.parent.is_dir():
            raise SceneError(f"resume = '{self.path}': its folder does not exist; make it first")
        head = json.dumps({"ksd sweep": fingerprint})
        try:
            intact = self._read(head) if self.path.exists() and self.path.stat().st_size else [head]
            # whole or not at all: a kill here must not cost the lines of the runs before
            write_atomically(("\n".join(intact) + "\n").encode(), self.path)
        except (OSError, RecordError) as error:
            raise SceneError(f"resume = '{self.path}' cannot be used: {error}") from error

    def _read(self, head: str) -> list[str]:
        """Lines up to the first damaged one."""
        assert self.path is not None
        lines = self.path.read_bytes().decode("utf-8", errors="replace").splitlines()
        if lines[0] != head:
            raise SceneError(
                f"resume = '{self.path}' belongs to another sweep (other scene, values, questions or method); give "
                "another file name, or delete it to begin anew"
            )
        intact = lines[:1]
        for text in lines[1:]:
            mark, _, body = text.partition(" ")
            if mark != _hash(body):
                break
            entry = json.loads(body)
            self.found[int(entry["line"])] = entry["rows"]
            intact.append(text)
        return intact

    def keep(self, number: int, rows: Rows) -> None:
        """Add a finished line, on disk when this returns."""
        self.found[number] = rows
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
                "and start again"
            ) from error


def _hash(body: str) -> str:
    return hashlib.sha256(body.encode()).hexdigest()[:16]
