"""Identity of the code a record was trained with: a hash of what its numbers come from, and of nothing else.

Counted are the modules that training imports, directly or through others, without those in ASIDE. Comments, docstrings and
blank lines are left out, so that a record stays valid when only words change.
"""

from __future__ import annotations

import ast
import hashlib
import io
import tokenize
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent.parent
START = "train/run.py"
ASIDE = (
    # refuse a joint or look at a state, but give no number to a record
    "properties/", "model/estimates.py", "scene/clearance.py", "scene/rules.py", "solve/arc.py", "solve/confirm.py",
    "solve/path.py", "train/asked.py", "train/checks.py", "train/softness.py",
    # run the jobs, tell of them, or say what went wrong
    "errors.py", "numerics/cache.py", "solve/configuration.py", "train/jobs.py", "train/sources.py",
    # bodies, loads and unknowns that a joint between two blocks does not have
    "beam/linear.py", "beam/modal", "beam/planar", "beam/polynomial.py", "beam/spring.py", "beam/weight",
    "model/planar", "model/springs.py", "model/weight.py", "scene/families/constraints.py",
)  # fmt: skip
"""Beginnings of paths of modules that cannot change a number of a record; what only they import is not counted either."""


REFUSALS = ("scene/clearance.py", "train/checks.py", "train/softness.py")
"""What decides whether a joint can be trained at all: results kept from before these changed are not taken up."""


@lru_cache(maxsize=1)
def source_hash() -> str:
    """Hash (16 hex digits) of the sources that the numbers of a record come from."""
    return _hash(sources())


@lru_cache(maxsize=1)
def result_hash() -> str:
    """Hash of the sources that a kept result of a training run depends on: those of the numbers, and what refuses."""
    return _hash((*sources(), *REFUSALS))


def _hash(paths: tuple[str, ...]) -> str:
    digest = hashlib.sha256()
    for path in paths:
        digest.update(path.encode() + b"\0" + code((PACKAGE / path).read_text()).encode() + b"\0")
    return digest.hexdigest()[:16]


def sources() -> tuple[str, ...]:
    """Paths within the package, sorted, of the modules counted."""
    found: set[str] = set()
    waiting = [START]
    while waiting:
        path = waiting.pop()
        if path not in found and not path.startswith(ASIDE):
            found.add(path)
            waiting += _imported(path)
    return tuple(sorted(found))


def _imported(path: str) -> Iterator[str]:
    """Modules of the package that a module imports when it is imported itself."""
    for node in ast.parse((PACKAGE / path).read_text()).body:
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("ksd."):
            for name in (node.module, *(f"{node.module}.{alias.name}" for alias in node.names)):
                place = "/".join(str(name).split(".")[1:])
                yield from (p for p in (f"{place}.py", f"{place}/__init__.py") if (PACKAGE / p).is_file())


def code(text: str) -> str:
    """Source text without comments, docstrings and blank lines."""
    lines = text.splitlines()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            row, column = token.start
            lines[row - 1] = lines[row - 1][:column]
    for node in ast.walk(ast.parse(text)):
        if (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        ):
            assert node.end_lineno is not None
            lines[node.lineno - 1 : node.end_lineno] = [""] * (node.end_lineno - node.lineno + 1)
    return "\n".join(line.rstrip() for line in lines if line.strip())
