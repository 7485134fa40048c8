"""A scene with its links in other poses: everything that is fixed in a link moves with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ksd.checks import Vector, as_vector
from ksd.scene.curve import Curve, FreeCurve
from ksd.scene.drive import GROUND, Drive
from ksd.scene.plane_curves import Legendre
from ksd.scene.scene import LeafPoint, PlacedLeaf, Scene


class RigidMove(NamedTuple):
    """Rigid motion of a link in global axes: a point p moves to shift (3,) [m] + rotation (3, 3) p."""

    rotation: np.ndarray
    shift: np.ndarray

    def move_point(self, p: ArrayLike) -> Vector:
        """The new position (3,) [m] of a point p (3,) [m] of the link."""
        return as_vector(self.shift + self.rotation @ np.asarray(p, float))

    def turn_direction(self, e: ArrayLike) -> Vector:
        """The new direction (3,) of a direction e (3,) of the link."""
        return as_vector(self.rotation @ np.asarray(e, float))


IDENTITY_MOVE = RigidMove(np.eye(3), np.zeros(3))


def scene_with_moved_links(
    scene: Scene, moves: Mapping[str, RigidMove], curves: Mapping[str, Sequence[Legendre]]
) -> dict[str, Any]:
    """The fields of a `Scene` by name, with its links moved by `moves` and the leaf springs on new `curves`.

    curves: of every leaf by name, one for each part between the points on it. Ground does not move. Directions of drives
    and supports turn with the link in which they are fixed, points, masses and follower loads with their own link; dead
    loads keep their direction. For scenes with free-form leaf springs, drives, supports, pins, sliders, loads and masses
    only.
    """
    all_moves = {**dict(moves), GROUND: IDENTITY_MOVE}
    hinges = tuple(
        replace(h, at=all_moves[h.b].move_point(h.at), axis=all_moves[h.a].turn_direction(h.axis))
        for h in scene.hinges
    )
    of_hinges = {s.name for h in scene.hinges for s in h.supports(scene.plane)}
    supports = [_move_drive(s, all_moves) for s in scene.supports if s.name not in of_hinges]
    return {
        "name": scene.name,
        "links": scene.links,
        "leaves": tuple(_move_leaf(f, all_moves, join_curves(curves[f.name])) for f in scene.leaves),
        "drives": tuple(_move_drive(d, all_moves) for d in scene.drives),
        "supports": (*supports, *(s for h in hinges for s in h.supports(scene.plane))),
        "loads": tuple(
            replace(
                load,
                at=all_moves[load.link].move_point(load.at),
                force=all_moves[load.link].turn_direction(load.force) if load.following else load.force,
                moment=all_moves[load.link].turn_direction(load.moment) if load.following else load.moment,
            )
            for load in scene.loads
        ),
        "masses": tuple(
            replace(
                m,
                at=all_moves[m.link].move_point(m.at),
                inertia=_rotate_inertia(all_moves[m.link].rotation, m.inertia),
            )
            for m in scene.masses
        ),
        "gravity": scene.gravity,
        "plane": scene.plane,
        "hinges": hinges,
        "points": tuple(_move_point(p, scene, curves[p.leaf]) for p in scene.points),
    }


def _move_leaf(placed: PlacedLeaf, all_moves: Mapping[str, RigidMove], curve: Curve) -> PlacedLeaf:
    """A free-form leaf with its ends on the moved links, of the new curve."""
    leaf, a, b = placed.leaf, all_moves[placed.a], all_moves[placed.b]
    width = None if leaf.width_axis is None else a.turn_direction(leaf.width_axis)
    moved = replace(
        leaf, start=a.move_point(leaf.start), end=b.move_point(leaf.end), width_axis=width, curve=curve
    )
    return replace(placed, leaf=moved)


def _move_point(point: LeafPoint, scene: Scene, curves: Sequence[Legendre]) -> LeafPoint:
    """A point of a leaf at the end of the new curves up to it."""
    count = sum(p.leaf == point.leaf and p.s <= point.s for p in scene.points)
    return replace(point, s=sum(c.length for c in curves[:count]))


def join_curves(curves: Sequence[Legendre]) -> FreeCurve:
    """Several Legendre curves, one after the other, as one curve."""
    ends = np.cumsum([0.0, *(c.length for c in curves)])
    breaks, pieces, length = [], [], float(ends[-1])
    for start, curve in zip(ends[:-1].tolist(), curves, strict=True):
        fractions = [0.0, *curve.breaks] if start else list(curve.breaks)
        breaks += [(start + curve.length * s) / length for s in fractions]
        pieces += [[c * length / curve.length for c in piece] for piece in curve.pieces]
    return FreeCurve.legendre(pieces if breaks else pieces[0], length=length, breaks=breaks)


def _move_drive(drive: Drive, all_moves: Mapping[str, RigidMove]) -> Drive:
    """A drive or support with its directions and points on the moved links."""
    terms = tuple(
        replace(
            t,
            direction=all_moves[t.base].turn_direction(t.direction),
            point=all_moves[t.link].move_point(t.point),
            axis=t.axis and all_moves[t.base].turn_direction(t.axis),
        )
        for t in drive.terms
    )
    return replace(drive, terms=terms)


def _rotate_inertia(R: np.ndarray, inertia: Any) -> Any:
    """R inertia R^T as nested tuples, (3, 3)."""
    return tuple(map(as_vector, R @ np.asarray(inertia) @ R.T))
