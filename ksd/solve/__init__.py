"""Solvers are functions: model and drive values in, `Configuration` out.

`ksd.solve(...)` is the function `ksd.solve.choose.solve`, whether or not this package has been imported before.
"""

import sys
from types import ModuleType
from typing import Any


class _Callable(ModuleType):
    """The package hides the function of its name once imported, so calling the one calls the other."""

    def __call__(self, *args: Any, **options: Any) -> Any:
        from ksd.solve.choose import solve

        return solve(*args, **options)


sys.modules[__name__].__class__ = _Callable
