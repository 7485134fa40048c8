"""The types of a mechanism's arrays, for kernels compiled apart from their callers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ksd.model.arrays import Arrays, Motion, Work, make_work
from ksd.model.pack import Assembly, pack
from ksd.model.planar_arrays import PlanarMotion, make_planar_work
from ksd.model.planar_springs import NO_PLANAR_SPRINGS


class System(NamedTuple):
    """What a compiled solver works on: target (c,), right-hand sides of the rows."""

    arrays: Arrays
    motion: Motion
    target: np.ndarray
    work: Work


class PlanarSystem(NamedTuple):
    """The same in a plane."""

    arrays: Arrays
    motion: PlanarMotion
    target: np.ndarray
    work: Work


def blank_system() -> System:
    """The smallest system there is, with arrays of the types of all."""
    arrays, rest = pack(Assembly(np.zeros((2, 3)), []))
    return System(arrays, rest, np.zeros(0), make_work(arrays))


def blank_planar_system() -> PlanarSystem:
    """The smallest planar system."""
    arrays = blank_system().arrays
    members = arrays.members._replace(offset=np.zeros((0, 2, 2)), frame=np.zeros((0, 2)))
    terms = arrays.terms._replace(direction=np.zeros((0, 2)), point=np.zeros((0, 2, 2)))
    loads = arrays.loads._replace(point=np.zeros((0, 2)), force=np.zeros((0, 2)), moment=np.zeros(0))
    flat = arrays._replace(
        members=members, terms=terms, loads=loads, springs=NO_PLANAR_SPRINGS, weight=np.zeros((0, 3))
    )
    motion = PlanarMotion(np.zeros((2, 3)), np.zeros(0), np.zeros(0))
    return PlanarSystem(flat, motion, np.zeros(0), make_planar_work(flat))
