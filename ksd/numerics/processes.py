"""Fresh processes that do not run the user's script once more, unless what they are sent is defined in it, and that end
with the one that started them.

A spawned process imports the running script, as a module, to find what is defined there. A script without the guard
`if __name__ == "__main__":` is then run again in every process, as far as the call that asked for processes. Nothing of that
is needed where all that is sent comes from imported modules.
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


class _Apart(SpawnProcess):
    """A spawned process that does not see the script."""

    def start(self) -> None:
        """Start it while the script is hidden."""
        with _script_hidden(), _interrupts_ignored():
            super().start()


class _WithoutScript(SpawnContext):
    Process = _Apart  # type: ignore[assignment]


@contextmanager
def _script_hidden() -> Iterator[None]:
    """What `multiprocessing.spawn` tells a new process of the main module, taken away for the moment."""
    main = sys.modules["__main__"]
    told: tuple[str, ...] = ("__spec__", "__file__")
    kept = {name: main.__dict__[name] for name in told if name in main.__dict__}
    main.__dict__.pop("__file__", None)
    main.__dict__["__spec__"] = None
    try:
        yield
    finally:
        main.__dict__.update(kept)


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """As a new process then does from its first line on: it says nothing of Ctrl-C while it imports (POSIX). A thread beside
    the main one cannot."""
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
    """What to spawn processes with that are sent objects like `sent`; None where they cannot be: not picklable, or defined
    in a script that is no file."""
    try:
        content = pickle.dumps(sent)
    except (pickle.PicklingError, AttributeError, TypeError):
        return None
    if b"__main__" not in content:
        return _WithoutScript()
    script = getattr(sys.modules["__main__"], "__file__", None)
    return SpawnContext() if script is None or Path(script).is_file() else None


def end_with_parent() -> None:
    """Ctrl-C is the business of the process that started this one, and where that one is gone, killed too, this one ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def process_pool(context: SpawnContext) -> Iterator[ProcessPoolExecutor]:
    """A pool with a process per core; they are ended at once where their answers are not waited for (Ctrl-C): at its exit
    the interpreter would wait for what they are at."""
    others = active_children()
    pool = ProcessPoolExecutor(os.cpu_count() or 1, mp_context=context, initializer=end_with_parent)
    try:
        yield pool
    except BaseException:
        for child in active_children():
            if child not in others:
                child.terminate()
        raise
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
