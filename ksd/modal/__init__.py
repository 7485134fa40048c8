"""Modal derivatives and the other reduced bases (paper 2): leafs as reduced bodies in any mechanism."""

from importlib import import_module
from typing import Any

from ksd.modal.bodies import ModalModel, inside, with_modal_bodies
from ksd.modal.choices import ModalBasis

__all__ = ["ModalBasis", "ModalModel", "inside", "with_modal_bodies"]


def __getattr__(name: str) -> Any:
    if name in ("solid", "solid_basis"):
        return import_module(f"ksd.modal.{name}")
    raise AttributeError(f"module 'ksd.modal' has no attribute '{name}'")
