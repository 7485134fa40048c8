"""Remember what was derived from a model for as long as the model lives: a stroke asks the same of every
state."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import TypeVar, cast

from ksd.model.compile import Model

T = TypeVar("T")


def cached_per_model(function: Callable[[Model], T]) -> Callable[[Model], T]:
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
