"""The kernel decorator: compiled by numba on first call, and cached on disk (`ksd.numerics.cache`)."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numba

from ksd.numerics.cache import FOLDER, compiled_before

if FOLDER is not None:
    numba.config.CACHE_DIR = str(FOLDER)  # type: ignore[attr-defined]
    if not compiled_before() and not numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
        print("ksd: compiling its kernels for this machine (once; about a minute) ...", file=sys.stderr)


def kernel(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Compile `function` with numba on first call: cached on disk, releasing the interpreter lock.

    Division by zero gives inf or nan as in numpy (`error_model="numpy"`); results are checked for being
    finite where they matter, so no exception machinery is compiled in. With NUMBA_DISABLE_JIT=1 it stays as it is.
    """
    settings: dict[str, Any] = {"cache": FOLDER is not None, "nogil": True, "error_model": "numpy", **options}
    decorate = numba.njit(**settings)
    return decorate if function is None else decorate(function)
