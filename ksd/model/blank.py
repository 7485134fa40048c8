"""The types of a mechanism's arrays, for kernels compiled apart from their callers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ksd.model.arrays import Arrays, Motion, Work, make_work
from ksd.model.pack import Assembly, pack


class System(NamedTuple):
    """What a compiled solver works on: target (c,), right-hand sides of the rows."""

    arrays: Arrays
    motion: Motion
    target: np.ndarray
    work: Work


def blank_system() -> System:
    """The smallest system there is, with arrays of the types of all."""
    arrays, rest = pack(Assembly(np.zeros((2, 3)), []))
    return System(arrays, rest, np.zeros(0), make_work(arrays))
