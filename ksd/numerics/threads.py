"""One thread of linear algebra while matrices are small.

The matrices of a mechanism have tens to hundreds of rows. Threads of BLAS then cost more than they bring: a sweep of 31
poses takes 2 to 8 times the CPU time with them. They are limited while such a task runs, and set back to what the user has.
Models of many leaf springs keep their threads.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache, wraps
from threading import Lock, local
from typing import Any, ParamSpec, TypeVar

import scipy.linalg  # noqa: F401  (loads the BLAS of scipy, and numpy's)
from threadpoolctl import ThreadpoolController

P = ParamSpec("P")
R = TypeVar("R")
MANY_LEAVES = 300
"""Number of leaf springs from which threads are kept."""

_lock = Lock()
_of_thread = local()
"""`inside`: a task of this Python thread is running."""
_first: list[Any] = []
"""What the first of the tasks that are running has limited, and so what the user has."""


@lru_cache(maxsize=1)
def _controller() -> Any:
    """What limits the threads of the libraries that are loaded: those of numpy and of scipy, which are imported above."""
    return ThreadpoolController()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Context with one thread of BLAS; nested ones do nothing.

    Every Python thread sets the user's number back itself, as a library may ignore other threads that raise it; a task of
    another one that is still running then has more threads than it needs.
    """
    if getattr(_of_thread, "inside", False):
        yield
        return
    with _lock:
        _of_thread.inside = True
        own = _controller().limit(limits=1, user_api="blas")
        limiter = _first[0] if _first else own
        _first.append(limiter)
    try:
        yield
    finally:
        with _lock:
            _of_thread.inside = False
            _first.pop().restore_original_limits()


def small_matrices(function: Callable[P, R]) -> Callable[P, R]:
    """Decorator of a task on a mechanism or a configuration, its first argument: it runs in `one_blas_thread`.

    Not where the mechanism has MANY_LEAVES leaf springs.
    """

    @wraps(function)
    def called(*args: P.args, **kwargs: P.kwargs) -> R:
        if args and _leaf_count(args[0]) >= MANY_LEAVES:
            return function(*args, **kwargs)
        with one_blas_thread():
            return function(*args, **kwargs)

    return called


def _leaf_count(mechanism: Any) -> int:
    """Number of leaf springs of a mechanism, scene, model or configuration; 0 where it is not known."""
    model = getattr(mechanism, "model", mechanism)
    if hasattr(model, "member_names"):
        return len(model.member_names)
    draft = getattr(mechanism, "draft", None)
    scene = draft() if callable(draft) else mechanism
    return len(scene.leaf_names()) if hasattr(scene, "leaf_names") else 0
