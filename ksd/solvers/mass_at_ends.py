"""Leaf springs with their mass at their ends, where their own inertia does not count in a motion.

The ends share the mass so that its centre stays where it is, and have the rotary inertia m L^2/105 of the consistent mass
matrix of a beam (J. S. Archer, Journal of the Structural Division ASCE 89, 1963).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from ksd.answers.frequencies import frequencies
from ksd.errors import KinematicsError, SceneError
from ksd.model.compile import Model
from ksd.model.leaves import line_mass
from ksd.scene.load import PointMass
from ksd.scene.scene import Scene

END_INERTIA = 1 / 105
"""Rotary inertia of an end of a leaf spring, over its mass and squared length: that of the consistent mass matrix."""
LOWEST = 3
"""Number of frequencies looked for, of which the lowest above zero is taken."""
STATIONS = 32
"""Points of the Gauss quadrature of the mass of a piece of a leaf spring."""


def with_mass_at_ends(scene: Scene) -> Scene:
    """The scene with the mass of all leaf springs at their ends and points, as masses of the links.

    An end on an internal block of a joint counts half on both of its links. Raises SceneError for loss factors and for loads
    along leaf springs.
    """
    for load in scene.line_loads:
        raise SceneError(
            f"simulate: line load '{load.name}' acts on the inertia of leaf '{load.leaf}', which mass_at_ends leaves out; "
            "simulate without that, or give loads on links or points"
        )
    for name, leaf in scene.leaf_names().items():
        if leaf.material.loss_factor:
            raise SceneError(
                f"simulate: leaf '{name}' has a loss factor, which mass_at_ends leaves out; simulate without that, or give "
                "dampers"
            )
    moving = (m for m in _masses(scene) if m.mass > 0.0 and m.link != scene.links[0])
    joints = tuple(replace(placed, joint=placed.joint.without_mass()) for placed in scene.joints)
    leaves = tuple(
        replace(placed, leaf=replace(placed.leaf, material=placed.leaf.material.without_mass()))
        for placed in scene.leaves
    )
    return replace(scene, masses=(*scene.masses, *moving), joints=joints, leaves=leaves)


def _masses(scene: Scene) -> Iterator[PointMass]:
    """The masses of the ends of all leaf springs, of pieces between their points."""
    for placed in scene.joints:
        on = {"A": (placed.a,), "B": (placed.b,)}
        axes, origin = np.array(placed.rotation), np.array(placed.origin)
        for leaf in placed.leaves():
            ends = tuple(
                (on.get(block, (placed.a, placed.b)), origin + axes @ np.array(at))
                for block, at in ((leaf.start_block, leaf.start), (leaf.end_block, leaf.end))
            )
            yield from _piece(leaf, 0.0, leaf.length, ends)
    for free in scene.leaves:
        points = sorted((p.s, p.name) for p in scene.points if p.leaf == free.name)
        marks = [(0.0, free.a), *points, (free.leaf.length, free.b)]
        for (s, a), (t, b) in pairwise(marks):
            places = (free.leaf.section_at(x / free.leaf.length)[0] for x in (s, t))
            yield from _piece(free.leaf, s, t, tuple(zip(((a,), (b,)), places, strict=True)))


def _piece(leaf: Any, start: float, end: float, ends: Any) -> Iterator[PointMass]:
    """The masses of a piece of a leaf from arc length start to end [m]; ends: the links of either, and its place."""
    length, (x, weight) = end - start, np.polynomial.legendre.leggauss(STATIONS)
    x = 0.5 + 0.5 * x
    pieces = 0.5 * weight * length * line_mass(leaf, (start + x * length) / leaf.length)
    for (links, place), share in zip(ends, (1.0 - x, x), strict=True):
        J = float(pieces.sum()) / len(links) * END_INERTIA * length**2
        moments = (J, 0.0, 0.0), (0.0, J, 0.0), (0.0, 0.0, J)
        for link in links:
            yield PointMass(link, float(pieces @ share) / len(links), moments, tuple(place.tolist()))


def lowest_frequency_change(model: Model, other: Model, state: Any, freed: Collection[str]) -> float:
    """Relative difference of the lowest frequency of a model from that of another with its mass elsewhere, at a state; 0
    without any."""
    lowest = []
    for one in (model, other):
        try:
            found = frequencies(one, state, count=LOWEST, freed=tuple(freed)).frequency_Hz
        except (SceneError, KinematicsError):
            return 0.0
        lowest.append(float(found[found > 0.0].min(initial=math.inf)))
    return lowest[0] / lowest[1] - 1.0 if math.isfinite(max(lowest)) else 0.0
