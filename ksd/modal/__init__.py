"""Modal derivatives and the other reduced bases (paper 2): leaf springs and solids as reduced bodies in any mechanism."""

from ksd.modal import solid, solid_basis
from ksd.modal.choices import ModalBasis
from ksd.modal.leaf_bodies import with_modal_bodies

__all__ = ["ModalBasis", "solid", "solid_basis", "with_modal_bodies"]
