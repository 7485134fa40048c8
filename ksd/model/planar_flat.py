"""One member of a model seen in its plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ksd.beam import planar_corotational as chain
from ksd.beam import planar_strain as strain
from ksd.model.arrays import LINEAR, STRAIN

PLANAR_LINEAR = 15
"""Numbers of a linear body in the plane: end pose, wrench and stiffness, see `ksd.beam.spring`."""
SAME = 11
"""Digits (of the mechanism's size, and of angles) to which coinciding members agree."""


@dataclass(frozen=True)
class Flat:
    """One member in the plane: constants of one leaf, and how many spatial members it stands for."""

    kind: int
    node: tuple[int, int]
    offset: np.ndarray
    frame: np.ndarray
    value: np.ndarray
    number: np.ndarray
    length: float
    floor: float
    heavy: bool = False

    def key(self, size: float) -> tuple:
        """Equal for members that coincide in the plane."""
        places = np.round(self.offset / size, SAME) + 0.0
        angles = np.round(self.frame, SAME) + 0.0
        return (
            self.kind,
            self.node,
            places.tobytes(),
            angles.tobytes(),
            self.value.tobytes(),
            self.number.tobytes(),
        )

    def sizes(self) -> tuple[int, int]:
        """Lengths of inner state and scratch."""
        count = int(self.number[0])
        if self.kind == LINEAR:
            return PLANAR_LINEAR, 0
        if self.kind == STRAIN:
            return strain.sizes(count, heavy=self.heavy)
        return chain.sizes(count, heavy=self.heavy)[1:]
