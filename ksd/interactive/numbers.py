"""The numbers beside a live picture, in parts: those that follow the hand, and those that come when it rests.

Every part is a function of an `Asked` that returns rows: what, the number in words, and whether that is good news. Parts
follow in their order as long as all of them together fit the time between two pictures.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.answers.derived import cached_per_model
from ksd.answers.printing import ROUNDING, format_number
from ksd.answers.shape import Shape
from ksd.checks import Vector
from ksd.errors import KsdError, reason_text
from ksd.model.compile import Model
from ksd.scene.drive import GROUND
from ksd.solvers.configuration import Configuration
from ksd.solvers.report import verdict_lines
from ksd.units import MPa, mm
from ksd.view.sheets import station_stress

Row = tuple[str, str, bool]
"""What it is, the number with its unit or a sentence, and whether it is good news."""
BETWEEN_PICTURES = 1 / 30
"""Time of an update [s] in which the following parts must fit."""
MODES = 3
"""Number of frequencies and of critical load factors that are asked for."""


@dataclass
class Asked:
    """A pose with its shape, and the link and point (3,) [m] at rest whose stiffness is asked for.

    stress: largest von Mises stress [Pa] over the section at the stations of every leaf of `shape`, one after another, once
    the part "stress" has been asked. found: modes and buckling shapes, once they have been.
    """

    pose: Configuration
    shape: Shape
    link: str | None = None
    at: Vector | None = None
    stress: NDArray[np.float64] | None = None
    found: dict[str, Any] = field(default_factory=dict)


def watched(pose: Configuration, link: str | None = None) -> tuple[str | None, Vector | None]:
    """Link and point (3,) [m] whose stiffness is asked for: that of a drive on `link`, by default of the first drive."""
    drives = [t for d in pose.model.scene.drives for t in d.terms if link in (None, t.link)]
    if drives and (drives[0].kind == "translation" or any(drives[0].point)):
        return drives[0].link, drives[0].point
    if drives or link:
        return (drives[0].link if drives else link), None
    links = [n for n in pose.model.scene.links if n != GROUND]
    return (links[-1], None) if links else (None, None)


def forces(asked: Asked) -> list[Row]:
    """Drive forces, reactions, distances and stability."""
    pose, scene = asked.pose, asked.pose.model.scene
    units = {d.name: "N" if d.dimension == "length" else "Nm" for d in scene.drives}
    rows = [
        (f"{'force' if units[n] == 'N' else 'moment'} of {n}", f"{format_number(v, 6)} {units[n]}", True)
        for n, v in pose.reported_forces.items()
    ]
    rows += [
        (f"distance {d.name}", f"{format_number(pose.distance(d.name) / mm, 6)} mm", True)
        for d in scene.distances
    ]
    return [*rows, ("state", "stable" if pose.stable else "NOT STABLE", pose.stable)]


def stress(asked: Asked) -> list[Row]:
    """Largest von Mises stress at the stations that are drawn, and its share of the yield stress."""
    asked.stress, largest = station_stress(asked.pose, asked.shape)
    if not largest:
        return []
    leaf_name = max(largest, key=largest.__getitem__)
    rows = [
        (
            "largest stress",
            f"{format_number(largest[leaf_name] / MPa, zero=ROUNDING)} MPa in {leaf_name}",
            True,
        )
    ]
    shares = {n: largest[n] / limit for n, limit in _yield_stresses(asked.pose.model).items() if n in largest}
    if shares:
        worst = max(shares, key=shares.__getitem__)
        text = f"{format_number(100 * shares[worst], 3, zero=ROUNDING)} % in {worst}"
        rows.append(("share of yield stress", text, shares[worst] <= 1.0))
    return rows


@cached_per_model
def _yield_stresses(model: Model) -> dict[str, float]:
    """Yield stress [Pa] of the leaf springs whose material has one."""
    leaves = model.scene.leaf_names()
    return {n: leaf.material.yield_stress for n, leaf in leaves.items() if leaf.material.yield_stress}


def stiffness(asked: Asked) -> list[Row]:
    """Stiffness of the point asked for, each direction with the others free."""
    if asked.link is None:
        return []
    found = asked.pose.stiffness(asked.link, at=asked.at).supports
    rows: list[Row] = []
    for names, unit, factor in (("xyz", "N/mm", 1e-3), (("rx", "ry", "rz"), "Nm/rad", 1.0)):
        each = {name: found[name] for name in names}
        text = ", ".join(
            f"{n} {format_number(factor * k) if np.isfinite(k) else 'held'}" for n, k in each.items()
        )
        rows.append((f"stiffness [{unit}]", text, True))
    return rows


def error(asked: Asked) -> list[Row]:
    """The estimated error."""
    return [("estimated error", "not known" if asked.pose.error is None else str(asked.pose.error), True)]


def trust(asked: Asked) -> list[Row]:
    """The verdicts in sentences, what effects that the scene does not mention would change, and warnings."""
    rows = [("", line, good) for line, good in verdict_lines(asked.pose.as_dict())]
    return [*rows, *(("warning", w, False) for w in asked.pose.warnings)]


def frequencies(asked: Asked) -> list[Row]:
    """The lowest frequencies with the drives held."""
    modes = asked.found["frequencies"] = asked.pose.frequencies(count=MODES)
    numbers = ", ".join(format_number(float(f), 5) for f in modes.frequency_Hz)
    return [("frequencies, drives held", f"{numbers} Hz" if numbers else "none", True)]


def buckling(asked: Asked) -> list[Row]:
    """The smallest critical load factors."""
    found = asked.found["buckling"] = asked.pose.buckling(count=MODES)
    return [
        (
            "critical load factors",
            ", ".join(format_number(float(f)) for f in found.factor) or found.reason,
            True,
        )
    ]


def verify(asked: Asked) -> list[Row]:
    """The independent check by exact rods."""
    return [("checked by exact rods", asked.pose.verify()._line(), True)]


FOLLOWING: dict[str, Callable[[Asked], list[Row]]] = {
    "forces": forces, "stress": stress, "stiffness": stiffness, "error": error,
}  # fmt: skip
RESTING: dict[str, Callable[[Asked], list[Row]]] = {
    "trust": trust, "frequencies": frequencies, "buckling": buckling, "verify": verify,
}  # fmt: skip
PARTS = FOLLOWING | RESTING


def ask(part: str, asked: Asked) -> list[Row]:
    """The rows of a part; where it has no answer, one row with the reason."""
    try:
        return PARTS[part](asked)
    except KsdError as reason:
        # a question that has no answer here is no bad news
        return [(part, str(reason), True)]
    except Exception as reason:
        return [(part, sentence_of(reason), False)]


def sentence_of(reason: BaseException) -> str:
    """What went wrong, in a sentence; of an error that is none of ours, its kind too."""
    return (
        reason_text(reason)
        if isinstance(reason, KsdError)
        else f"{type(reason).__name__}: {reason_text(reason)}"
    )


def parts_in_time(cost: dict[str, float], base: float) -> tuple[str, ...]:
    """The following parts that fit between two pictures after `base` [s], by what each has cost [s]; forces always."""
    kept, total = [], base
    for part in FOLLOWING:
        total += cost.get(part, 0.0)
        if part != "forces" and total > BETWEEN_PICTURES:
            break
        kept.append(part)
    return tuple(kept)
