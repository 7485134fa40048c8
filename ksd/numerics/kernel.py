"""The kernel decorator: compiled, cached on disk in a folder keyed by a hash of every kernel's source.

Numba's own cache does not notice a changed callee in another file, so the folder name carries a hash of all
sources of this package that contain kernels; a changed kernel means a new folder and a fresh compilation.
A read-only installation falls back to the user's cache folder, then to a temporary one, then to no cache.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

_PACKAGE = Path(__file__).resolve().parent.parent


def source_hash() -> str:
    """Hash (16 hex digits) of all sources that contain kernels, the numba version and this Python."""
    import numba

    digest = hashlib.sha256(f"{numba.__version__} {sys.version_info[:2]}".encode())
    for path in sorted(_PACKAGE.rglob("*.py")):
        text = path.read_bytes()
        if b"@kernel" in text or b"intrinsic(" in text:
            digest.update(path.relative_to(_PACKAGE).as_posix().encode() + b"\0" + text)
    return digest.hexdigest()[:16]


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".probe-{os.getpid()}"
        probe.touch()
        probe.unlink()
    except OSError:
        return False
    return True


def _candidates() -> list[Path]:
    places = []
    if os.environ.get("KSD_CACHE_DIR"):
        places.append(Path(os.environ["KSD_CACHE_DIR"]))
    home = os.environ.get("XDG_CACHE_HOME") or (Path.home() / ".cache" if os.environ.get("HOME") else None)
    if home:
        places.append(Path(home) / "ksd")
    places.append(Path(tempfile.gettempdir()) / f"ksd-{os.getuid() if hasattr(os, 'getuid') else 'user'}")
    return places


def cache_folder() -> Path | None:
    """The folder kernels are cached in, made if needed; None when nothing is writable."""
    key = source_hash()
    for place in _candidates():
        folder = place / f"kernels-{key}"
        if _writable(folder):
            return folder
    return None


FOLDER: Path | None = cache_folder()


def compiled_before() -> bool:
    """Whether this machine's cache already holds kernels of these sources."""
    return FOLDER is None or any(FOLDER.rglob("*.nbi"))


def _start_second_compiler() -> subprocess.Popen[bytes] | None:
    """On a cold cache, a second process that compiles the other half meanwhile; None where that cannot help."""
    if (os.cpu_count() or 1) < 2 or os.environ.get(ALONE) or FOLDER is None:
        return None
    try:
        # one process of many that start together may do this
        os.close(os.open(FOLDER / "compiling", os.O_CREAT | os.O_EXCL))
    except OSError:
        return None
    return subprocess.Popen(
        [sys.executable, "-m", "ksd.solve.warm"],
        env={**os.environ, ALONE: "1"},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        stdin=subprocess.DEVNULL,
    )


def second_compiler_runs() -> bool:
    """Whether this process found a cold cache and started a second compiler it has not waited for yet."""
    return SECOND is not None


def wait_for_second_compiler(longest: float = 120.0) -> None:
    """Wait until the second compiler, if there is one, has filled the cache; at most `longest` seconds."""
    global SECOND
    if SECOND is not None:
        with contextlib.suppress(subprocess.TimeoutExpired):
            SECOND.wait(timeout=longest)
        SECOND = None


def compile_for(function: Any, *arguments: Any) -> None:
    """Compile a kernel, into the cache, for arguments like these, without running it."""
    import numba

    function.compile(tuple(numba.typeof(a) for a in arguments))


def _prepare() -> subprocess.Popen[bytes] | None:
    import numba

    if FOLDER is None:
        return None
    numba.config.CACHE_DIR = str(FOLDER)  # type: ignore[attr-defined]
    if compiled_before() or os.environ.get(ALONE):
        return None
    print("ksd: compiling its kernels for this machine (once; one to three minutes) ...", file=sys.stderr)
    return _start_second_compiler()


ALONE = "KSD_COMPILE_ALONE"
"""Set in the environment of the second compiler, which must not start a third and runs no kernel."""
SECOND = _prepare()


def kernel(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Compile `function` with numba on first call: cached on disk, releasing the interpreter lock.

    Division by zero gives inf or nan as in numpy (`error_model="numpy"`); results are checked for being
    finite where they matter, so no exception machinery is compiled in.
    """
    import numba

    settings: dict[str, Any] = {"cache": FOLDER is not None, "nogil": True, "error_model": "numpy", **options}

    def decorate(inner: Callable[..., Any]) -> Any:
        return numba.njit(**settings)(inner)

    return decorate if function is None else decorate(function)


def isolated(signature: str) -> Any:
    """Compile a kernel behind a C symbol of its own, so that its callers are not recompiled around it.

    Numba inlines every callee into every caller and optimises it again each time; for the big leaf kernels that
    tripled the cold compile time. `signature` in numba's words, C types only, e.g. "int64(CPointer(float64), int64)".
    Returns what compiled code calls; arrays are passed as ``a.ctypes``.
    """
    import llvmlite.binding
    from numba import cfunc, types

    def decorate(inner: Callable[..., Any]) -> Any:
        symbol = f"ksd_{inner.__name__}"
        if os.environ.get(ALONE):
            # the second compiler only needs a name to link to; it never calls
            from numba.core.sigutils import normalize_signature

            arguments, result = normalize_signature(signature)
            llvmlite.binding.add_symbol(symbol, 1)
            return types.ExternalFunction(symbol, result(*arguments))
        compiled = cfunc(signature, cache=FOLDER is not None, error_model="numpy")(inner)
        llvmlite.binding.add_symbol(symbol, compiled.address)
        _ALIVE.append(compiled)
        return types.ExternalFunction(symbol, compiled._sig)  # type: ignore[attr-defined]

    return decorate


_LATE: dict[str, tuple[Any, str, Any]] = {}
"""Entry points compiled when first needed: Python function, signature, and the cell its address goes to."""


def late(signature: str) -> Any:
    """As `isolated`, but compiled by `compile_late` and not at import: for what few models need.

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
    made: dict[str, Any] = {"answer": (types.void(*arguments), generate)}
    exec(f"def call(typing_context, {names}):\n    return answer", made)
    return intrinsic(made["call"])


def compile_late(*names: str) -> None:
    """Compile (or load from the cache) the late entry points of these names, once per process."""
    from numba import cfunc

    for name in names:
        inner, signature, cell = _LATE[name]
        if name not in _READY:
            compiled = cfunc(signature, cache=FOLDER is not None, error_model="numpy")(inner)
            cell[0] = compiled.address
            _ALIVE.append(compiled)
            _READY.add(name)


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
