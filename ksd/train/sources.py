"""Identity of the code a record was trained with."""

from __future__ import annotations

import hashlib
from pathlib import Path


def source_hash() -> str:
    """Hash (16 hex digits) of the sources training runs."""
    package = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256()
    for part in ("numerics", "section", "beam", "scene", "model", "library", "train"):
        for path in sorted((package / part).rglob("*.py")):
            digest.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]
