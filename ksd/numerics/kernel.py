"""The kernel decorator: compiled by numba, cached on disk (`ksd.numerics.cache`), and the C entry points between kernels."""

from __future__ import annotations

import contextlib
import gc
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

from ksd.numerics.cache import ALONE, FOLDER, compiled_before, say, take, turn


def _prepare() -> None:
    import numba

    if FOLDER is None:
        return
    numba.config.CACHE_DIR = str(FOLDER)  # type: ignore[attr-defined]
    if compiled_before() or os.environ.get(ALONE):
        return
    say("compiling its kernels for this machine (once; about a minute)")
    _start_beside()


def _start_beside() -> None:
    """On a cold cache, processes on the other cores that compile what this one will need later."""
    assert FOLDER is not None
    others = min((os.cpu_count() or 1) - 1, 3)
    # one process of many that start together may do this
    if others < 1 or not take("compiling"):
        return
    # this package and no other one in the working folder, as a checkout has: numba asks where the sources are
    package = Path(os.path.abspath(__file__)).parents[2]
    for number in range(others):
        subprocess.Popen(
            [sys.executable, "-m", "ksd.solve.warm", str(number)],
            cwd=package,
            env={**os.environ, ALONE: "1", "KSD_CACHE_DIR": os.path.abspath(FOLDER.parent)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            stdin=subprocess.DEVNULL,
        )


_prepare()


class Kernel:
    """A compiled function: for Python to call, cached on disk, and for other kernels (see `ksd.numerics.within`).

    needs: late entry points it calls whatever the model.
    """

    def __init__(
        self, function: Callable[..., Any], settings: dict[str, Any], needs: tuple[str, ...]
    ) -> None:
        self.py_func, self.targetoptions, self.needs = function, settings, needs
        self.__name__, self.__doc__, self.__module__ = (
            function.__name__,
            function.__doc__,
            function.__module__,
        )
        self.within = _within(function, settings)
        self._call = self._first_call

    @cached_property
    def outside(self) -> Any:
        """What Python calls."""
        import numba

        from ksd.numerics.within import Outside

        # Python calls need no second wrapper, for C
        settings = {**self.targetoptions, "no_cfunc_wrapper": True}
        return numba.njit(pipeline_class=Outside, **settings)(self.py_func)

    def __call__(self, *arguments: Any) -> Any:
        return self._call(*arguments)

    def _first_call(self, *arguments: Any) -> Any:
        self.compile_for(*arguments)
        compile_late(*self.needs)
        self._call = self.outside
        return self.outside(*arguments)

    def compile_for(self, *arguments: Any) -> None:
        """Compile, into the cache, for arguments like these, without running."""
        import numba

        with turn(f"{self.__module__}.{self.__name__}"), _keeping():
            self.outside.compile(tuple(numba.typeof(a) for a in arguments))


def _within(function: Callable[..., Any], settings: dict[str, Any]) -> Any:
    from ksd.numerics.within import answers_as, within

    if not _KNOWN:
        answers_as(Kernel)
        _KNOWN.append(Kernel)
    return within(function, settings)


_KNOWN: list[type] = []


def kernel(function: Callable[..., Any] | None = None, *, needs: tuple[str, ...] = (), **options: Any) -> Any:
    """Compile `function` with numba on first call: cached on disk, releasing the interpreter lock.

    Division by zero gives inf or nan as in numpy (`error_model="numpy"`); results are checked for being
    finite where they matter, so no exception machinery is compiled in. needs: names of `late` entry points it calls.
    """
    settings: dict[str, Any] = {"cache": FOLDER is not None, "nogil": True, "error_model": "numpy", **options}

    def decorate(inner: Callable[..., Any]) -> Any:
        return Kernel(inner, settings, needs)

    return decorate if function is None else decorate(function)


_LATE: dict[str, tuple[Any, str, Any]] = {}
"""Entry points compiled when first needed: Python function, signature, and the cell its address goes to."""


def late(signature: str) -> Any:
    """Compile a kernel behind a C pointer of its own, by `compile_late`, so that its callers do not contain it.

    Numba links every callee into every caller and optimises it again there; the big leaf kernels have many callers,
    and few models need all of them. `signature` in numba's words, C types only, e.g. "void(CPointer(float64), int64)".
    Compiled code calls through a cell that holds the address; a call before `compile_late` ends the process.
    """
    import llvmlite.binding
    import numpy as np
    from numba.core.sigutils import normalize_signature

    def decorate(inner: Callable[..., Any]) -> Any:
        name, cell = inner.__name__, np.full(1, _abort(), np.int64)
        llvmlite.binding.add_symbol(f"ksd_cell_{name}", cell.ctypes.data)
        _LATE[name] = (inner, signature, cell)
        return _call_through(f"ksd_cell_{name}", normalize_signature(signature)[0])

    return decorate


def _abort() -> int:
    """Address of the C library's abort()."""
    import ctypes

    library = ctypes.cdll.msvcrt if os.name == "nt" else ctypes.CDLL(None)
    return int(ctypes.cast(library.abort, ctypes.c_void_p).value or 0)


def _call_through(symbol: str, arguments: Any) -> Any:
    """A call of type void(arguments) of the function whose address is in the cell `symbol`."""
    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic

    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        kind = ir.FunctionType(ir.VoidType(), [context.get_value_type(a) for a in arguments])
        cell = builder.module.globals.get(symbol) or ir.GlobalVariable(builder.module, ir.IntType(64), symbol)
        builder.call(builder.inttoptr(builder.load(cell), kind.as_pointer()), values)
        return context.get_dummy_value()

    # numba reads the number of arguments off the function
    names = ", ".join(f"a{k}" for k in range(len(arguments)))
    made: dict[str, Any] = {"__name__": __name__, "answer": (types.void(*arguments), generate)}
    exec(f"def call(typing_context, {names}):\n    return answer", made)
    return intrinsic(made["call"])


def compile_late(*names: str) -> None:
    """Make the late entry points of these names ready to be called; a process that only compiles leaves them alone."""
    if not os.environ.get(ALONE):
        compile_now(*names)


def compile_now(*names: str) -> None:
    """Compile (or load from the cache) the late entry points of these names, once per process."""
    from numba import cfunc

    from ksd.numerics.within import Outside

    for name in names:
        inner, signature, cell = _LATE[name]
        if name not in _READY:
            with turn(name), _keeping():
                compiled = cfunc(
                    signature, cache=FOLDER is not None, pipeline_class=Outside, error_model="numpy"
                )(inner)
            cell[0] = compiled.address
            _ALIVE.append(compiled)
            _READY.add(name)


@contextlib.contextmanager
def _keeping() -> Iterator[None]:
    """Without the collection of garbage, of which compiling makes little and which costs it a fifteenth of its time.

    What compiling leaves behind lives as long as the process: the collector is not to walk through it afterwards either.
    """
    collects, begin, known = gc.isenabled(), time.thread_time_ns(), readied_ns()
    gc.disable()
    try:
        yield
    finally:
        if time.thread_time_ns() - begin > COMPILED:
            gc.freeze()
        if collects:
            gc.enable()
        # what was counted within is part of this
        _SPENT.ns = known + time.thread_time_ns() - begin


COMPILED = 100_000_000
"""CPU time [ns] above which a kernel was compiled, not loaded from the cache."""


def readied_ns() -> int:
    """CPU time [ns] that this thread spent on compiling kernels and loading them from the cache: no part of a solve."""
    return getattr(_SPENT, "ns", 0)


_SPENT = threading.local()


_READY: set[str] = set()


def external(symbol: str, signature: str) -> Any:
    """A function of the C library for compiled code to call; `signature` in numba's words, C types only."""
    from numba import types
    from numba.core.sigutils import normalize_signature

    arguments, result = normalize_signature(signature)
    return types.ExternalFunction(symbol, result(*arguments))


def __getattr__(name: str) -> Any:
    # numba's array view of a C pointer, under the one roof numba is allowed in
    if name == "carray":
        from numba import carray

        return carray
    raise AttributeError(name)


_ALIVE: list[Any] = []
"""Compiled C entry points must outlive every caller."""
