"""Modal derivatives and the other reduced bases (paper 2): leafs as reduced bodies in any mechanism."""

from ksd.modal.bodies import ModalModel, inside, with_modal_bodies
from ksd.modal.choices import ModalBasis

__all__ = ["ModalBasis", "ModalModel", "inside", "with_modal_bodies"]
