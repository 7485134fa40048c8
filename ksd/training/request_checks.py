"""Checks of the arguments of the trainer, before any work is done."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np

from ksd.checks import show
from ksd.errors import SceneError
from ksd.library import Mesh
from ksd.scene import DrawnJoint, Joint
from ksd.training.catalogue import FAMILY_DESIGNS
from ksd.training.designs import Design

MIN_STROKE = 1e-5
"""Smallest range of an intended motion [rad or joint lengths] whose functions are told from their wanted errors."""
MAX_MOTIONS = 2
"""Largest number of intended motions of a joint that records and compiled steps support."""


def check_design(design: Design) -> None:
    """Raise SceneError where a name, or the joint that the design draws in the middle of its ranges, is not usable."""
    if not re.fullmatch(r"\w[\w .+-]*", design.family):
        raise SceneError(
            f"joint {show(design.family)} cannot be the name of a record file; "
            "name it with letters, digits, spaces, '_', '-', '+' and '.'."
        )
    if not callable(design.make):
        raise SceneError(f"{design.family}: make = {show(design.make)} must draw the joint at a shape.")
    shape = design.shape(np.zeros(len(design.parameters)))
    joint: Any = design.make(**shape)
    if not isinstance(joint, Joint):
        raise SceneError(
            f"{design.family}: make returned {show(joint)}; it must return a Joint, as drawn at its shape."
        )
    if isinstance(joint, DrawnJoint) and design.family in FAMILY_DESIGNS:
        raise SceneError(
            f"joint '{design.family}' has the name of a family of the catalogue, whose record it would stand in for; "
            "give it another name."
        )
    drawn_shape = joint.shape()
    same_shape = set(drawn_shape) == set(shape) and all(
        math.isclose(drawn_shape[k], v, rel_tol=1e-9, abs_tol=1e-12) for k, v in shape.items()
    )
    if joint.family != design.family or not same_shape:
        raise SceneError(
            f"{design.family}: at {shape} make returned a joint '{joint.family}' of shape {drawn_shape}, under which the "
            "record would not be found; say the same family and shape={...} in the joint."
        )
    for motion in joint.motions:
        unit, sign = (joint.length, "joint lengths") if motion.kind == "translation" else (1.0, "rad")
        reach = max(abs(v) for v in motion.range) / unit
        if reach < MIN_STROKE:
            raise SceneError(
                f"{design.family}: the range of motion '{motion.name}' is {reach:.2g} {sign}, which a record does not tell "
                f"from none; give it at least {MIN_STROKE:g} {sign}."
            )
    if len(joint.motions) > MAX_MOTIONS:
        raise SceneError(
            f"{design.family}: {len(joint.motions)} intended motions ({', '.join(m.name for m in joint.motions)}); a record "
            f"holds {MAX_MOTIONS} at most. Draw it as several joints, or as leaf springs between links "
            "(method='conventional')."
        )


def check_meshes(family: str, meshes: Any) -> tuple[Mesh, ...]:
    """The requested meshes as a tuple. Raises SceneError where one is neither "strain" nor a number of elements."""
    requested = meshes if isinstance(meshes, tuple | list) else ()
    for mesh in requested:
        if mesh != "strain" and (isinstance(mesh, bool) or not isinstance(mesh, int) or mesh < 1):
            requested = ()
    if not requested or len(set(requested)) < len(requested):
        raise SceneError(
            f'{family}: meshes = {show(meshes)} must be different ones of "strain" and numbers of elements per leaf, '
            'for example ("strain", 4).'
        )
    return tuple(requested)
