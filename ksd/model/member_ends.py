"""End frames of a member or spring at a state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ksd.model.arrays import Members, State

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Ends:
    """End frames of a member: p at start (3,) with axes frame (3, 3), global; q at d (3,) with axes Q (3, 3), in frame p."""

    start: Array
    frame: Array
    d: Array
    Q: Array

    @property
    def end(self) -> Array:
        """Place (3,) of q, global."""
        return np.asarray(self.start + self.frame @ self.d)


def table_ends(members: Members, motion: State, i: int) -> Ends:
    """End frames of row `i` of a table of members or springs at `motion`."""
    a, b = members.node[i]
    frame = motion.R[a] @ members.frame[i, 0]
    start = motion.x[a] + motion.R[a] @ members.offset[i, 0]
    end = motion.x[b] + motion.R[b] @ members.offset[i, 1]
    return Ends(start, frame, frame.T @ (end - start), frame.T @ motion.R[b] @ members.frame[i, 1])
