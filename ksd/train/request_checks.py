"""Whether what is asked of the trainer makes sense, before any work."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np

from ksd.checks import show
from ksd.errors import SceneError
from ksd.library import Mesh
from ksd.scene import DrawnJoint, Joint
from ksd.train.catalogue import FAMILY_DESIGNS
from ksd.train.designs import Design

MOST = 2
"""Intended motions of a joint that records and compiled steps take."""


def check_design(design: Design) -> None:
    """Raise SceneError where a name, or the joint that the design draws in the middle of its ranges, cannot be."""
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
    said = joint.shape()
    same = set(said) == set(shape) and all(
        math.isclose(said[k], v, rel_tol=1e-9, abs_tol=1e-12) for k, v in shape.items()
    )
    if joint.family != design.family or not same:
        raise SceneError(
            f"{design.family}: at {shape} make returned a joint '{joint.family}' of shape {said}, under which the record "
            "would not be found; say the same family and shape={...} in the joint."
        )
    if len(joint.motions) > MOST:
        raise SceneError(
            f"{design.family}: {len(joint.motions)} intended motions ({', '.join(m.name for m in joint.motions)}); a record "
            f"holds {MOST} at most. Draw it as several joints, or as leaf springs between links (method='conventional')."
        )


def check_meshes(family: str, meshes: Any) -> tuple[Mesh, ...]:
    """The meshes asked for. Raises SceneError where one is neither "strain" nor a number of elements."""
    found = meshes if isinstance(meshes, tuple | list) else ()
    for mesh in found:
        if mesh != "strain" and (isinstance(mesh, bool) or not isinstance(mesh, int) or mesh < 1):
            found = ()
    if not found or len(set(found)) < len(found):
        raise SceneError(
            f'{family}: meshes = {show(meshes)} must be different ones of "strain" and numbers of elements per leaf, '
            'for example ("strain", 4).'
        )
    return tuple(found)
