"""Packages of others that only some files need."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from ksd.errors import SceneError


def cad_package(name: str, what: str) -> Any:
    """A package of the extra `cad`, imported. Raises SceneError, saying that `what` needs it, where that is not possible."""
    try:
        return import_module(name)
    except ImportError:
        raise SceneError(f"{what} needs the package {name}: pip install 'ksd[cad]'") from None
    except OSError as reason:
        # gmsh loads libraries of the system
        raise SceneError(
            f"{what} needs the package {name}, which needs a library of the system: {reason}; on Debian: "
            "apt-get install libglu1-mesa libxcursor1 libxinerama1 libxft2"
        ) from None


def live_package(name: str) -> Any:
    """A package of the extra `live`, imported. Raises SceneError where it is not installed."""
    try:
        return import_module(name)
    except ImportError:
        raise SceneError(f"the live page needs the package {name}: pip install 'ksd[live]'") from None
