"""Stops and cables in a pose: their forces, gaps and states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ksd.answers.printing import NamedAnswerTable, format_number
from ksd.model.gaps import OFFSET
from ksd.solvers.touching import Touching

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Touched:
    """Contact in a pose: the tables of what may touch, the values given by name, forces (m, 3) [N], and gaps (m,) [m or
    rad]."""

    what: Touching
    values: Mapping[str, float]
    forces: Array
    gaps: Array

    @property
    def closed(self) -> bool:
        """Whether any contact force acts."""
        return bool(self.forces[:, 0].any())


class OneSidedPart(NamedTuple):
    """An end stop or cable in a pose.

    force: what it pushes or pulls with [N; Nm of a rotation], 0 where it is open; gap: to closing [m or rad], the slack of a
    cable, negative by what a soft one gives way; value: of the limit, or the length [m] of the cable without tension.
    """

    force: float
    gap: float
    value: float


def one_sided(touched: Touched | None, kind: str) -> NamedAnswerTable[OneSidedPart]:
    """All parts of a kind by name: stops "end.high", cables "tendon"."""
    found = {}
    if touched is not None:
        data = touched.what.with_values(np.array(list(touched.values.values())))
        for i, part in enumerate(touched.what.parts):
            if part.kind == kind:
                offset = float(data[touched.what.pairs[i, 1] + OFFSET])
                name = ".".join(filter(None, (part.name, part.end)))
                found[name] = OneSidedPart(
                    float(touched.forces[i, 0]),
                    float(touched.gaps[i]),
                    -offset if part.end == "low" else offset,
                )
    columns = {
        "stop": ("stop", "force N, Nm", "gap mm, mrad", "limit mm, mrad"),
        "cable": ("cable", "tension N", "slack mm", "length mm"),
    }

    def row(part: OneSidedPart) -> tuple[str, ...]:
        return tuple(format_number(v, zero=1e-12) for v in (part.force, 1e3 * part.gap, 1e3 * part.value))

    return NamedAnswerTable(found, f"{kind}s", columns[kind], row)
