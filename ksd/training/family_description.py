"""Description of a joint family besides its record: source of the definition, symmetry, closed-form stiffness."""

from __future__ import annotations

import inspect
from dataclasses import dataclass

import numpy as np

from ksd.library import Record
from ksd.scene import Joint, joint_families
from ksd.training.catalogue import FAMILY_DESIGNS

_PAPER1 = "Dwarshuis, Aarts, Ellenbroek and Brouwer, Mechanism and Machine Theory (2020)"
_MIRRORED = "the other sense of rotation is the mirror image"


@dataclass(frozen=True)
class Origin:
    """Source of a family's definition, the same in a few words for tables, and its symmetry in words."""

    source: str
    short: str
    symmetry: str


FAMILY_ORIGINS: dict[str, Origin] = {
    "cross_flexure": Origin(
        f"{_PAPER1}, section 4.1, table 1",
        "paper 1, 4.1",
        f"about the plane of motion and about the line AB: {_MIRRORED}",
    ),
    "crossed_pivot": Origin(
        "Haringx, Applied Scientific Research A1 (1949): two leaf springs crossing at any ratio of their length",
        "Haringx 1949",
        f"in the plane about the line AB: {_MIRRORED}; two leaf springs in two planes, so none about the plane of motion",
    ),
    "balanced_crossed_pivot": Origin(
        "Haringx, Applied Scientific Research A1 (1949), the second leaf halved and put on both sides of the first",
        "Haringx 1949, in three leaf springs",
        f"about the plane of motion; {_MIRRORED} only where inner and outer leaf springs are equally wide",
    ),
    "cartwheel": Origin(
        "Smith, Flexures: Elements of Elastic Mechanisms (2000), section 5.3",
        "Smith 2000, 5.3",
        f"about the plane of motion, the line AB and the line across it: {_MIRRORED}",
    ),
    "butterfly": Origin(
        "after the butterfly pivot of Henein and others, 10th ESMATS (2003); arrangement our own",
        "Henein 2003, own arrangement",
        "about the plane of motion and the line across AB; none about AB",
    ),
    "infinity_hinge": Origin(
        "DSPE case 'Large range of motion flexure hinge: Infinity flexure'; proportions our own",
        "DSPE case, own proportions",
        "about the plane of motion, and but for the strut about the line AB",
    ),
    "triple_infinity_hinge": Origin(
        f"{_PAPER1}, section 4.4, whose figure 14 is lost; dimensions our own",
        "paper 1, 4.4, own dimensions",
        "about the plane of motion",
    ),
    "parallel_guide": Origin(
        "van Eijk, On the design of plate-spring mechanisms (1985)",
        "van Eijk 1985",
        "about the plane of motion; stroke to the other side is the mirror image, the leaf springs swapped",
    ),
    "stiffened_guide": Origin(
        "van Eijk, On the design of plate-spring mechanisms (1985), leaf springs with a stiffened middle",
        "van Eijk 1985",
        "about the plane of motion; stroke to the other side is the mirror image, the leaf springs swapped",
    ),
    "circular_notch": Origin(
        "Paros and Weisbord, How to design flexure hinges, Machine Design 37 (1965)",
        "Paros and Weisbord 1965",
        f"about the plane of motion and the neck: {_MIRRORED}",
    ),
    "filleted_notch": Origin(
        "Lobontiu, Compliant Mechanisms: Design of Flexure Hinges (2003)",
        "Lobontiu 2003",
        f"about the plane of motion and the neck: {_MIRRORED}",
    ),
    "arc_hinge": Origin(
        "the curved beam of the planar gripper of paper 3, compliance derived anew",
        "paper 3",
        "about the plane of motion; turning in and out differ",
    ),
    "universal": Origin(
        "own: two cross flexures of paper 1 in series, axes perpendicular", "own", "none once both axes turn"
    ),
    "folded_leaf": Origin(
        "van Eijk, On the design of plate-spring mechanisms (1985)",
        "van Eijk 1985",
        "about the plane normal to its fold",
    ),
    "wire_flexure": Origin(
        "textbook: a round rod clamped at both ends", "textbook", "of revolution about its axis"
    ),
}


TYPICAL_RANGES: dict[str, str] = {
    "folded_leaf": "t/L 1/400 to 1/50, w/L 0.2 to 1",
    "wire_flexure": "d/L 1/200 to 1/25",
}
"""Typical ranges of families without a record, hence without trained bounds."""


def count_function_parities(record: Record) -> dict[str, int]:
    """Number of strain-mode functions of a record that are zero, even, odd, or neither in the (first) motion, over all
    shapes."""
    counts = dict.fromkeys(("zero", "even", "odd", "neither"), 0)
    power = record.powers[:, 0]
    functions = record.functions["strain"]
    for table in functions.groups().values():
        for row in table.reshape(-1, len(power)):
            odd, even = np.any(row[power % 2 == 1]), np.any(row[power % 2 == 0])
            counts["neither" if odd and even else "odd" if odd else "even" if even else "zero"] += 1
    return {word: n for word, n in counts.items() if n}


def describe_family(family: str) -> list[tuple[str, str]]:
    """Description of a family, its source, symmetry, and closed-form stiffness with its value: rows (label, text)."""
    kind, rows = joint_families().get(family), []
    if kind is not None:
        rows.append(("is", " ".join((inspect.getdoc(kind) or "").split("\n\n")[0].split())))
    if family in FAMILY_ORIGINS:
        rows += [("source", FAMILY_ORIGINS[family].source), ("symmetry", FAMILY_ORIGINS[family].symmetry)]
    if family in FAMILY_DESIGNS:
        design = FAMILY_DESIGNS[family]
        joint = design.make(**design.shape(np.zeros(len(design.parameters))))
        rows += closed_form(joint)
        if design.numbers:
            rows.append(
                ("trained at", ", ".join(f"{k} {v:.4g}" for k, v in design.numbers.items()) + " (SI)")
            )
    elif kind is not None:
        rows += [("closed form", _formula(kind) or "none")]
        rows += [("typical ranges", TYPICAL_RANGES[family])] if family in TYPICAL_RANGES else []
    return rows


def closed_form(joint: Joint) -> list[tuple[str, str]]:
    """The closed-form stiffness at rest of a joint, in words and its value."""
    if not hasattr(joint, "stiffness_at_rest"):
        return [("closed form", "none")]
    unit = "N/m" if joint.motions and joint.motions[0].kind == "translation" else "Nm/rad"
    shape = ", ".join(f"{k} {v:.4g}" for k, v in joint.shape().items())
    at = f" at {shape}" if shape else ""
    return [("closed form", f"{_formula(type(joint))} Here {joint.stiffness_at_rest():.5g} {unit}{at}")]


def _formula(kind: type[Joint]) -> str:
    """The first paragraph of the docstring of the closed-form stiffness."""
    method = getattr(kind, "stiffness_at_rest", None)
    return " ".join((inspect.getdoc(method) or "").split("\n\n")[0].split()) if method else ""
