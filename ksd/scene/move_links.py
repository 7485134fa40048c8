"""A scene drawn anew with its links elsewhere: everything fixed in a link moves with it."""

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
    """Where a link goes: a point p of it to shift (3,) [m] + turn (3, 3) p, global."""

    turn: np.ndarray
    shift: np.ndarray

    def point(self, p: ArrayLike) -> Vector:
        """Where the point p (3,) [m] goes."""
        return as_vector(self.shift + self.turn @ np.asarray(p, float))

    def way(self, e: ArrayLike) -> Vector:
        """Where a direction (3,) of the link turns to."""
        return as_vector(self.turn @ np.asarray(e, float))


IDENTITY_MOVE = RigidMove(np.eye(3), np.zeros(3))


def scene_with_moved_links(
    scene: Scene, moves: Mapping[str, RigidMove], curves: Mapping[str, Sequence[Legendre]]
) -> dict[str, Any]:
    """The words of a `Scene` with the links of `moves` there, ground where it is, and every free leaf spring with new
    curves, one after the other between the points on it.

    Directions of drives and supports turn with the link they are fixed in, points and masses with their own, loads that
    follow with theirs; dead loads keep theirs. For a scene of free leaf springs, drives, supports, pins, sliders, loads and
    masses alone.
    """
    go = {**dict(moves), GROUND: IDENTITY_MOVE}
    hinges = tuple(replace(h, at=go[h.b].point(h.at), axis=go[h.a].way(h.axis)) for h in scene.hinges)
    theirs = {s.name for h in scene.hinges for s in h.supports(scene.plane)}
    own = [_move_drive(s, go) for s in scene.supports if s.name not in theirs]
    return {
        "name": scene.name,
        "links": scene.links,
        "leaves": tuple(_move_leaf(f, go, join_curves(curves[f.name])) for f in scene.leaves),
        "drives": tuple(_move_drive(d, go) for d in scene.drives),
        "supports": (*own, *(s for h in hinges for s in h.supports(scene.plane))),
        "loads": tuple(
            replace(
                load,
                at=go[load.link].point(load.at),
                force=go[load.link].way(load.force) if load.following else load.force,
                moment=go[load.link].way(load.moment) if load.following else load.moment,
            )
            for load in scene.loads
        ),
        "masses": tuple(
            replace(m, at=go[m.link].point(m.at), inertia=_rotate_inertia(go[m.link].turn, m.inertia))
            for m in scene.masses
        ),
        "gravity": scene.gravity,
        "plane": scene.plane,
        "hinges": hinges,
        "points": tuple(_move_point(p, scene, curves[p.leaf]) for p in scene.points),
    }


def _move_leaf(placed: PlacedLeaf, go: Mapping[str, RigidMove], curve: Curve) -> PlacedLeaf:
    leaf, a, b = placed.leaf, go[placed.a], go[placed.b]
    width = None if leaf.width_axis is None else a.way(leaf.width_axis)
    moved = replace(leaf, start=a.point(leaf.start), end=b.point(leaf.end), width_axis=width, curve=curve)
    return replace(placed, leaf=moved)


def _move_point(point: LeafPoint, scene: Scene, curves: Sequence[Legendre]) -> LeafPoint:
    """A point of a leaf at the end of the curve that led to it."""
    before = sum(p.leaf == point.leaf and p.s <= point.s for p in scene.points)
    return replace(point, s=sum(c.length for c in curves[:before]))


def join_curves(curves: Sequence[Legendre]) -> FreeCurve:
    """Curves one after the other as one."""
    ends = np.cumsum([0.0, *(c.length for c in curves)])
    breaks, pieces, length = [], [], float(ends[-1])
    for start, curve in zip(ends[:-1].tolist(), curves, strict=True):
        own = [0.0, *curve.breaks] if start else list(curve.breaks)
        breaks += [(start + curve.length * s) / length for s in own]
        pieces += [[c * length / curve.length for c in piece] for piece in curve.pieces]
    return FreeCurve.legendre(pieces if breaks else pieces[0], length=length, breaks=breaks)


def _move_drive(drive: Drive, go: Mapping[str, RigidMove]) -> Drive:
    terms = tuple(
        replace(t, direction=go[t.base].way(t.direction), point=go[t.link].point(t.point))
        for t in drive.terms
    )
    return replace(drive, terms=terms)


def _rotate_inertia(R: np.ndarray, inertia: Any) -> Any:
    return tuple(map(as_vector, R @ np.asarray(inertia) @ R.T))
