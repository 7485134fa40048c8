"""The kernel decorator: compiled by numba on first call, and cached on disk (`ksd.numerics.cache`)."""

from __future__ import annotations

import gc
import logging
from collections.abc import Callable
from multiprocessing import current_process
from typing import Any, Literal

import numba

from ksd.numerics.cache import CACHE_FOLDER, compiled_before

COMPILES_KERNELS: bool = not compiled_before() and not numba.config.DISABLE_JIT  # type: ignore[attr-defined]
"""Whether this process began with an empty cache."""
HAS_SPARE_CORE: bool = numba.config.NUMBA_NUM_THREADS > 1  # type: ignore[attr-defined]
"""Whether a second process may compile beside it."""

if CACHE_FOLDER is not None:
    numba.config.CACHE_DIR = str(CACHE_FOLDER)  # type: ignore[attr-defined]
    if COMPILES_KERNELS:
        # a process started by another has its name already while it imports, and that one has said so
        if current_process().name == "MainProcess":
            logging.getLogger("ksd").warning(
                "ksd: compiling its kernels for this machine (once; about half a minute) ..."
            )
        # what a compiler makes stays: to look through it for garbage every 700 objects takes a tenth of the time
        _first, *_others = gc.get_threshold()
        gc.set_threshold(_first and max(100_000, _first), *_others)


def kernel(
    function: Callable[..., Any] | None = None, *, inline: Literal["never", "always", "late"] = "never"
) -> Any:
    """Compile `function` with numba on first call: cached on disk, releasing the interpreter lock.

    inline: "always" puts its body into its callers, which saves compiling it once more where they are few; "late" does so
    when they are turned into machine code. Numba counts the users of every array handed on, which took a third of an
    assembly; LLVM drops that in a kernel in which no call of another one is left, that makes no array and raises nothing,
    and whose arrays live until its end rather than between two of its loops or in one of two branches, with one return.
    Unpack at most three names in a line: of more Python makes a tuple, which is compiled too.
    Division by zero gives inf or nan as in numpy (`error_model="numpy"`); results are checked for being
    finite where they matter, so no exception machinery is compiled in. A product and a sum may be rounded once instead
    of twice (`fastmath={"contract"}`), by which a leaf in space takes a tenth less: last digits differ between processors
    with and without that instruction. With NUMBA_DISABLE_JIT=1 it stays as it is.
    """
    early: Literal["never", "always"] = "always" if inline == "always" else "never"
    decorate = numba.njit(
        cache=CACHE_FOLDER is not None, nogil=True, error_model="numpy", fastmath={"contract"}, inline=early,
        forceinline=inline == "late",
    )  # fmt: skip
    return decorate if function is None else decorate(function)
