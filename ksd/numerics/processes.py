"""Spawned processes that end with their parent and do not run the script of the user again where that can be avoided.

A spawned process imports the running script as a module, to find what is defined there. A script without the guard `if
__name__ == "__main__":` is then run again in every process, up to the call that starts processes. This is not needed where
all objects sent to the process come from imported modules.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, parent_process
from multiprocessing.context import SpawnContext, SpawnProcess
from pathlib import Path
from typing import Any


class _ProcessWithoutScript(SpawnProcess):
    """A spawned process that does not import the script."""

    def start(self) -> None:
        """Start the process while the script is hidden."""
        with _script_hidden(), _interrupts_ignored():
            super().start()


class _ContextWithoutScript(SpawnContext):
    Process = _ProcessWithoutScript  # type: ignore[assignment]


@contextmanager
def _script_hidden() -> Iterator[None]:
    """Hide the attributes of the main module that `multiprocessing.spawn` passes to a new process."""
    main = sys.modules["__main__"]
    hidden: tuple[str, ...] = ("__spec__", "__file__")
    saved = {name: main.__dict__[name] for name in hidden if name in main.__dict__}
    main.__dict__.pop("__file__", None)
    main.__dict__["__spec__"] = None
    try:
        yield
    finally:
        main.__dict__.update(saved)


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Ignore Ctrl-C, so that a process started now ignores it from its first line on and prints nothing while it imports
    (POSIX).

    It has no effect outside the main thread, where signal handlers cannot be set.
    """
    before = signal.getsignal(signal.SIGINT)
    if before is None or threading.current_thread() is not threading.main_thread():
        yield
        return
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def spawn_context(*sent: Any) -> SpawnContext | None:
    """Context to spawn processes that are sent objects like `sent`.

    None where they cannot be sent: they are not picklable, or defined in a script that is not a file.
    """
    try:
        content = pickle.dumps(sent)
    except (pickle.PicklingError, AttributeError, TypeError):
        return None
    if b"__main__" not in content:
        return _ContextWithoutScript()
    script = getattr(sys.modules["__main__"], "__file__", None)
    return SpawnContext() if script is None or Path(script).is_file() else None


def end_with_parent() -> None:
    """Make this process ignore Ctrl-C, which its parent handles, and end when its parent ends, even if that is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_wait_for_parent, daemon=True).start()


def _wait_for_parent() -> None:
    """End this process when its parent has ended."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def process_pool(context: SpawnContext, workers: int | None = None) -> Iterator[ProcessPoolExecutor]:
    """A pool of `workers` processes, one per core when None.

    On an exception (Ctrl-C) the processes are terminated at once, as the interpreter would wait for their tasks at its exit.
    """
    others = active_children()
    pool = ProcessPoolExecutor(
        workers or os.cpu_count() or 1, mp_context=context, initializer=end_with_parent
    )
    try:
        yield pool
    except BaseException:
        for child in active_children():
            if child not in others:
                child.terminate()
        raise
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
