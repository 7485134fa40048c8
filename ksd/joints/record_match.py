"""Checks that a trained record is of the joint it is used for."""

from __future__ import annotations

from typing import Any

from ksd.errors import RecordError
from ksd.library import Record
from ksd.scene.joint import DrawnJoint, joint_leaves, joint_proportions

PROPORTION_TOLERANCE = 1e-3
"""Difference of proportions from which a drawn joint is another one; the error estimate covers smaller differences."""


def check_record(joint: Any, record: Record, mesh: str | int) -> None:
    """Raise RecordError for a record of another joint, or a mesh of chains that the record does not hold and cannot
    derive."""
    leaves = joint_leaves(joint)
    inner = [name for name in joint.blocks() if name not in ("A", "B")]
    counts = [
        (len(leaves), len(record.leaves), "leaf springs"),
        (len(inner), len(record.blocks), "internal blocks"),
        (len(joint.motions), len(record.motions), "motions"),
    ]
    for drawn, recorded, what in counts:
        if drawn != recorded:
            raise RecordError(
                f"the record of {joint.family} is of a joint with {recorded} {what}, this one has {drawn}; give your joint "
                "a family name of its own and train it with ksd.train(joint)"
            )
    check_proportions(joint, record)
    if mesh in record.functions or all(leaf.profile is None and leaf.curve is None for leaf in leaves):
        return
    known = ", ".join(str(n) for n in record.functions)
    raise RecordError(
        f"the record of {joint.family} has no chains of {mesh} elements, and its leaves are not straight and uniform, "
        f"so none can be derived; use one of its meshes ({known}) or train it with meshes=(..., {mesh})"
    )


def check_proportions(joint: Any, record: Record) -> None:
    """Raise RecordError for a joint drawn in other proportions than the joint of its record."""
    for what, own in joint_proportions(joint).items() if isinstance(joint, DrawnJoint) else ():
        theirs = record.design.get(what, own)
        if abs(own - theirs) > PROPORTION_TOLERANCE * max(1.0, abs(own)):
            raise RecordError(
                f"the record of {joint.family} is of a joint drawn in other proportions ({what}: {theirs:.6g} there, "
                f"{own:.6g} here, lengths over that of the joint); give your joint a family name of its own and train it "
                "with ksd.train(joint), or give method='conventional'"
            )
