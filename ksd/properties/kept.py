"""Remember what was derived from a model for as long as the model lives: a stroke asks the same of every
state."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable
from functools import wraps
from typing import TypeVar, cast

from ksd.model.arrays import Work, make_work
from ksd.model.compile import Model

_rooms = threading.local()

T = TypeVar("T")


def per_model(function: Callable[[Model], T]) -> Callable[[Model], T]:
    """Call `function(model)` once per model object; models are frozen, so the answer stays right.

    It is kept in the model, or it would keep alive every model that it refers to.
    """

    @wraps(function)
    def ask(model: Model) -> T:
        known = model.derived
        if function not in known:
            answer = function(model)
            # a model that is its own answer does not hold itself, which only the garbage collector would undo
            known[function] = None if answer is model else answer
        found = known[function]
        return cast(T, model if found is None else found)

    return ask


def room_of(model: Model) -> Work:
    """Storage for assembly of `model`, the same at every call in this thread: to be read before anything else is asked."""
    mine: dict[int, tuple[weakref.ref[Model], Work]] = _rooms.__dict__.setdefault("mine", {})
    key, found = id(model), mine.get(id(model))
    if found is None or found[0]() is not model:
        found = mine[key] = weakref.ref(model, lambda _: mine.pop(key, None)), make_work(model.arrays)
    return found[1]
