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
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import parent_process
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnContext, SpawnProcess
from pathlib import Path
from queue import SimpleQueue
from typing import Any, TypeVar

from ksd.errors import KsdError

T = TypeVar("T")


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


class ProcessPool(ThreadPoolExecutor):
    """Threads that hand every task to a process over a pipe of its own; a task whose process ends raises
    BrokenProcessPool.

    The other end of a pipe is open in its process only: when that ends, whatever it was writing, its thread reads the end
    of the pipe. The queue that the processes of a `ProcessPoolExecutor` share has no end, so that half a message in it is
    waited for for ever.
    """

    def __init__(self, context: SpawnContext, workers: int) -> None:
        super().__init__(workers)
        self._workers: list[tuple[SpawnProcess, Connection]] = []
        self._idle: SimpleQueue[Connection] = SimpleQueue()
        for _ in range(workers):
            ours, theirs = context.Pipe()
            with theirs:
                process = context.Process(target=_run_tasks, args=(theirs,), daemon=True)
                process.start()
            self._workers.append((process, ours))
            self._idle.put(ours)

    def submit(self, function: Callable[..., T], /, *arguments: Any) -> Future[T]:  # type: ignore[override]
        """Run function(*arguments) in one of the processes."""
        return super().submit(self._run, function, arguments)

    def _run(self, function: Callable[..., T], arguments: tuple[Any, ...]) -> T:
        pipe = self._idle.get()
        try:
            pipe.send((function, arguments))
            result, error = pipe.recv()
        except (EOFError, OSError) as reason:
            raise BrokenProcessPool("a process ended while it worked on a task") from reason
        finally:
            self._idle.put(pipe)
        if error is not None:
            raise error
        return result  # type: ignore[no-any-return]

    def terminate(self) -> None:
        """End all processes at once; their tasks raise BrokenProcessPool."""
        for process, _ in self._workers:
            process.terminate()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """As any executor; processes end when their tasks are done."""
        super().shutdown(wait, cancel_futures=cancel_futures)
        if wait:
            for process, pipe in self._workers:
                pipe.close()
                process.join()


def _run_tasks(pipe: Connection) -> None:
    """Answer tasks (function, arguments) with (result, None) or (None, error) until the other end is closed."""
    end_with_parent()
    while True:
        try:
            task = pipe.recv_bytes()
        except (EOFError, OSError):
            return
        try:
            function, arguments = pickle.loads(task)
            answer = pickle.dumps((function(*arguments), None))
        except Exception as error:
            if not isinstance(error, KsdError):  # its sentence says it all
                error.add_note(f"in a worker process:\n{traceback.format_exc()}")
            answer = pickle.dumps((None, error))
        pipe.send_bytes(answer)


@contextmanager
def process_pool(context: SpawnContext, workers: int | None = None) -> Iterator[ProcessPool]:
    """A pool of `workers` processes, one per core when None; on an exception (Ctrl-C) they are terminated at once."""
    pool = ProcessPool(context, workers or os.cpu_count() or 1)
    try:
        yield pool
    except BaseException:
        pool.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
