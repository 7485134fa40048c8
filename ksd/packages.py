"""Packages that share their name with a function: `ksd.solve` and `ksd.train` can be called, whoever imported them first."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from importlib import import_module
from types import ModuleType
from typing import Any


class _CallablePackage(ModuleType):
    """Once imported, a package hides the function of its name in `ksd`; calling the one calls the other."""

    _home: str

    def _function(self) -> Callable[..., Any]:
        found: Callable[..., Any] = getattr(import_module(self._home), self.__name__.rpartition(".")[2])
        return found

    @property
    def __signature__(self) -> inspect.Signature:
        return inspect.signature(self._function())

    def __call__(self, *args: Any, **options: Any) -> Any:
        return self._function()(*args, **options)


def make_callable(package: str, home: str) -> None:
    """Let `package` ("ksd.solve") be called as the function of its name in the module `home`, imported on use."""
    module = sys.modules[package]
    module.__class__ = _CallablePackage
    module.__dict__["_home"] = home
