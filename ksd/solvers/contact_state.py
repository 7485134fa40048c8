"""Stops and cables in a pose: their forces, gaps and states."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ksd.answers.printing import NamedAnswerTable, format_number
from ksd.model.contact_step import SLIPPING
from ksd.model.gaps import DATA, FRICTION, GAP, NORMAL, OFFSET, PLACE, SLIDE
from ksd.solvers.touching import Touching

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Touched:
    """Contact in a pose: the tables of what may touch, the values given by name, forces (m, 3) [N], outputs (m, ...) of
    `ksd.model.gaps.touch`, and places (k, 3) [m] and rotations (k, 3, 3) of the bodies from which slip is measured."""

    what: Touching
    values: Mapping[str, float]
    forces: Array
    out: Array
    before: tuple[Array, Array]
    closed: bool


class OneSidedPart(NamedTuple):
    """An end stop or cable in a pose.

    force: what it pushes or pulls with [N; Nm of a rotation], 0 where it is open; gap: to closing [m or rad], the slack of a
    cable, negative by what a soft one gives way; value: of the limit, or the length [m] of the cable without tension.
    """

    force: float
    gap: float
    value: float


class ContactPoint(NamedTuple):
    """A contact of two surfaces in a pose; vectors are global.

    state: "open", "stick", "slip", or "closed" without friction. gap [m]; place (3,) [m]; normal (3,): from the first
    surface to the second; N [N]: the force that parts them; T (3,) [N]: with which friction drags the first surface; force
    (3,) [N]: on the second surface, that on the first is its reverse; reserve [N]: friction less |T|.
    """

    state: str
    gap: float
    place: Array
    normal: Array
    N: float
    T: Array
    force: Array
    reserve: float


def contact_points(touched: Touched | None) -> NamedAnswerTable[ContactPoint]:
    """All contacts of surfaces by name; those of a polygon with its corners."""
    found: dict[str, ContactPoint] = {}
    for i, part in enumerate(() if touched is None else touched.what.parts):
        if part.kind != "contact":
            continue
        assert touched is not None
        out, (N, T1, T2), row = touched.out[i], touched.forces[i].tolist(), touched.what.pairs[i]
        n, t1 = out[NORMAL : NORMAL + 3], out[SLIDE : SLIDE + 3]
        drag = T1 * t1 + T2 * np.cross(n, t1)
        # the pair may have its surfaces in the other order
        sign = -1.0 if part.swapped else 1.0
        friction = float(touched.what.data[row[DATA] + FRICTION] * N)
        reserve = friction - math.hypot(T1, T2)
        state = (
            "open"
            if N == 0.0
            else "closed"
            if not friction
            else "slip"
            if reserve <= SLIPPING * friction
            else "stick"
        )
        name = ", ".join(filter(None, (part.name, part.end)))
        found[name] = ContactPoint(
            state, float(out[GAP]), out[PLACE : PLACE + 3].copy(), sign * n, N, sign * drag, sign * (N * n - drag), reserve
        )  # fmt: skip

    def cells(c: ContactPoint) -> tuple[str, ...]:
        numbers = (1e3 * c.gap, c.N, float(np.linalg.norm(c.T)), c.reserve)
        place = " ".join(format_number(v, 4, zero=1e-9) for v in 1e3 * c.place)
        return (c.state, *(format_number(v, zero=1e-12) for v in numbers), place)

    columns = ("contact", "<state", "gap [mm]", "N [N]", "|T| [N]", "reserve [N]", "<place [mm]")
    return NamedAnswerTable(found, "contacts", columns, cells)


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
                    float(touched.out[i, GAP]),
                    -offset if part.end == "low" else offset,
                )
    columns = {
        "stop": ("stop", "force [N, Nm]", "gap [mm, mrad]", "limit [mm, mrad]"),
        "cable": ("cable", "tension [N]", "slack [mm]", "length [mm]"),
    }

    def row(part: OneSidedPart) -> tuple[str, ...]:
        return tuple(format_number(v, zero=1e-12) for v in (part.force, 1e3 * part.gap, 1e3 * part.value))

    return NamedAnswerTable(found, f"{kind}s", columns[kind], row)
