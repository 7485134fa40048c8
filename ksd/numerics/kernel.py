"""The decorator of kernels: they are compiled by numba on first call and cached on disk (`ksd.numerics.cache`)."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numba

from ksd.numerics.cache import compiled_before, kernel_folder

HAS_SPARE_CORE: bool = numba.config.NUMBA_NUM_THREADS > 1  # type: ignore[attr-defined]
"""Whether there is a second core, on which another process can compile at the same time."""


def has_to_compile(module: str, kernel: str) -> bool:
    """Whether a kernel of a module ("ksd.model.newton") is in no cache, and will be compiled."""
    return not (numba.config.DISABLE_JIT or compiled_before(module, kernel))  # type: ignore[attr-defined]


def announce_compiling(module: str, kernel: str, what: str) -> None:
    """Say that kernels are compiled, `what`, unless the last of them, of a module, was before."""
    if has_to_compile(module, kernel):
        logging.getLogger("ksd").warning(f"ksd: compiling {what} ...")


def kernel(
    function: Callable[..., Any] | None = None, *, inline: Literal["never", "always", "late"] = "never"
) -> Any:
    """Compile `function` with numba on first call, cached on disk and without the interpreter lock.

    inline: "always" inserts the body into the callers at the level of Python, which saves compile time where they are few;
    "late" inlines it when machine code is made. Numba counts the references of every array that is handed to another kernel,
    which took a third of an assembly. LLVM removes the counting in a kernel without calls of other kernels that allocates no
    array, raises nothing, has one return, and uses every array until its end, not only in one branch or between two loops.
    Unpack at most three names in a line, as for more Python makes a tuple, which is compiled too.

    Division by zero gives inf or nan as in numpy (`error_model="numpy"`); results are checked to be finite where they
    matter, so no exception handling is compiled. A product and a sum may be rounded once instead of twice
    (`fastmath={"contract"}`), which saves a tenth of the time of a spatial leaf; the last digits differ between processors
    with and without that instruction. With NUMBA_DISABLE_JIT=1 the function is left as it is.
    """
    if function is None:
        return partial(kernel, inline=inline)
    folder = kernel_folder(Path(function.__code__.co_filename))
    if folder is not None:
        # read by numba when the kernel is defined
        numba.config.CACHE_DIR = str(folder)  # type: ignore[attr-defined]
    python_inline: Literal["never", "always"] = "always" if inline == "always" else "never"
    return numba.njit(
        cache=folder is not None, nogil=True, error_model="numpy", fastmath={"contract"}, inline=python_inline,
        forceinline=inline == "late",
    )(function)  # fmt: skip
