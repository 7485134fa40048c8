"""Offline training: the joint's own finite element model, swept over stroke and shape, fitted into a record."""

from ksd.train.designs import Design, known_designs
from ksd.train.run import train

__all__ = ["Design", "known_designs", "train"]
