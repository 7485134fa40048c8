"""Cache of values derived from a model, which all states of a stroke share."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import TypeVar, cast

from ksd.model.compile import Model

T = TypeVar("T")


def cached_per_model(function: Callable[[Model], T]) -> Callable[[Model], T]:
    """Decorator that computes `function(model)` once per model object; models are frozen, so the result stays valid.

    The result is stored in the model: a cache outside it would keep every model alive.
    """

    @wraps(function)
    def cached(model: Model) -> T:
        values = model.derived
        if function not in values:
            value = function(model)
            # None stands for the model itself, to avoid a reference cycle
            values[function] = None if value is model else value
        value = values[function]
        return cast(T, model if value is None else value)

    return cached
