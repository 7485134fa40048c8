"""Remember what was derived from a model for as long as the model lives: a stroke asks the same of every
state."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable
from functools import wraps
from typing import TypeVar

from ksd.model.arrays import Work, make_work
from ksd.model.compile import Model

_rooms = threading.local()

T = TypeVar("T")


def per_model(function: Callable[[Model], T]) -> Callable[[Model], T]:
    """Call `function(model)` once per model object; models are frozen, so the answer stays right."""
    known: dict[int, tuple[weakref.ref[Model], T]] = {}

    @wraps(function)
    def ask(model: Model) -> T:
        found = known.get(id(model))
        if found is not None and found[0]() is model:
            return found[1]
        key = id(model)
        answer = function(model)
        known[key] = (weakref.ref(model, lambda _: known.pop(key, None)), answer)
        return answer

    return ask


def room_of(model: Model) -> Work:
    """Storage for assembly of `model`, the same at every call in this thread: to be read before anything else is asked."""
    mine: dict[int, tuple[weakref.ref[Model], Work]] = _rooms.__dict__.setdefault("mine", {})
    key, found = id(model), mine.get(id(model))
    if found is None or found[0]() is not model:
        found = mine[key] = weakref.ref(model, lambda _: mine.pop(key, None)), make_work(model.arrays)
    return found[1]
