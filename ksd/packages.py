"""Packages that share their name with a function: `ksd.solve` and `ksd.train` are packages that can be called."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from importlib import import_module
from types import ModuleType
from typing import Any


class _CallablePackage(ModuleType):
    """A package; calling it calls the function of its name, whose signature and docstring it shows.

    A function in its place would hide what is in the package: `import ksd.solve.path as path` would fail.
    """

    _home: str

    def _function(self) -> Callable[..., Any]:
        found: Callable[..., Any] = getattr(import_module(self._home), self.__name__.rpartition(".")[2])
        return found

    @property
    def __signature__(self) -> inspect.Signature:
        return inspect.signature(self._function())

    @property
    def __doc__(self) -> str | None:  # type: ignore[override]
        return self._function().__doc__

    def __call__(self, *args: Any, **options: Any) -> Any:
        return self._function()(*args, **options)

    def __reduce__(self) -> Any:
        # as a function, it can be sent to another process
        return import_module, (self.__name__,)


def make_callable(package: str, home: str) -> None:
    """Let `package` ("ksd.solve") be called as the function of its name in the module `home`, imported on use."""
    module = sys.modules[package]
    module.__class__ = _CallablePackage
    module.__dict__["_home"] = home
