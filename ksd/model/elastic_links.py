"""Replacement of elastic links by small rigid links at the attachments, joined by beams or by a matrix.

A link with a section becomes a hub and one beam to every attachment; a link with a matrix becomes two rigid interfaces. The
scene then has ordinary links and leaf springs only.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ksd.errors import SceneError
from ksd.scene.effects import Compliance
from ksd.scene.leaf import Leaf
from ksd.scene.scene import PlacedLeaf

ATTACHMENT_TOLERANCE = 1e-6
"""Distance below which two points are one attachment: relative to that of the farthest attachments of the link, at most
1e-6 m."""
INTERFACE_TOLERANCE = 1e-4
"""Largest distance of an attachment from an interface of a matrix, relative to that of the interfaces; at most 1e-6 m."""


def _attachments(scene: Any, link: str) -> list[tuple[str, int, int, np.ndarray]]:
    """("joints" or "leaves", number in the scene, end 0 or 1, position (3,) [m]) of every attachment of a link."""
    attached = []
    for i, j in enumerate(scene.joints):
        places = (np.asarray(j.origin, float), j.place(j.joint.pose_B))
        attached += [("joints", i, e, places[e]) for e, name in enumerate((j.a, j.b)) if name == link]
    for i, f in enumerate(scene.leaves):
        places = (np.asarray(f.leaf.start, float), np.asarray(f.leaf.end, float))
        attached += [("leaves", i, e, places[e]) for e, name in enumerate((f.a, f.b)) if name == link]
    return attached


def _same_point_distance(places: list[np.ndarray]) -> float:
    """Distance [m] below which two of the attachments (3,) [m] of a link are one: micromechanisms are as small as 1e-6 m."""
    span = max((float(np.linalg.norm(p - places[0])) for p in places), default=0.0)
    return ATTACHMENT_TOLERANCE * min(1.0, span)


def _width_axis(scene: Any, compliance: Compliance) -> np.ndarray:
    """Width direction (3,) of the section of a link: as given, else the axis of the first joint or leaf on it."""
    if compliance.width_axis is not None:
        return np.asarray(compliance.width_axis, float)
    kind, i, _, _ = _attachments(scene, compliance.link)[0]
    if kind == "joints":
        return np.asarray(scene.joints[i].rotation, float)[:, 2]
    return np.asarray(scene.leaves[i].leaf.width_axis, float)


class _SplitLinks:
    """Links, joints and leaves of a scene while the attachments of elastic links are moved to their parts."""

    def __init__(self, scene: Any) -> None:
        self.links = list(scene.links)
        self.joints, self.leaves = list(scene.joints), list(scene.leaves)

    def move(self, kind: str, i: int, end: int, to: str) -> None:
        """Attach one end of a joint or leaf to the link `to`."""
        items = getattr(self, kind)
        items[i] = replace(items[i], **{"ab"[end]: to})

    def add_beam(
        self, compliance: Compliance, ends: tuple[np.ndarray, np.ndarray], axis: np.ndarray, to: str
    ) -> None:
        """Add a beam with the section of the link from its hub to the part `to`; axis (3,): approximate width direction."""
        along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        width = axis - (axis @ along) * along
        if np.linalg.norm(width) < 1e-3:
            raise SceneError(
                f"compliance of link '{compliance.link}': width_axis lies along its beam to {tuple(ends[1].tolist())}; "
                "give a width_axis across it."
            )
        beam = Leaf(
            start=tuple(ends[0].tolist()),
            end=tuple(ends[1].tolist()),
            width_axis=tuple((width / np.linalg.norm(width)).tolist()),
            section=compliance.section,  # type: ignore[arg-type]
            material=compliance.material,  # type: ignore[arg-type]
            start_block=compliance.link,
            end_block=to,
            name=f"{to} beam",
        )
        self.leaves.append(PlacedLeaf(beam.name, compliance.link, to, beam))


def beams_of(scene: Any, compliance: Compliance) -> list[tuple[np.ndarray, np.ndarray]]:
    """Hub and attachment (3,) [m] of every beam that a link with a section is replaced by."""
    places = [p for *_, p in _attachments(scene, compliance.link)]
    hub = np.mean(places, axis=0) if compliance.hub is None else np.asarray(compliance.hub, float)
    ends: list[np.ndarray] = []
    same = _same_point_distance([*places, hub])
    for place in places:
        if all(np.linalg.norm(place - p) > same for p in (*ends, hub)):
            ends.append(place)
    return [(hub, place) for place in ends]


def _split_by_section(scene: Any, split: _SplitLinks, compliance: Compliance) -> None:
    """Divide a link with a section into a hub and beams, written into `split`. Raises SceneError where nothing can bend."""
    axis = _width_axis(scene, compliance)
    beams = beams_of(scene, compliance)
    if not beams:
        raise SceneError(
            f"compliance of link '{compliance.link}': nothing of it can bend, as its only attachment is its hub; give hub=, "
            "the point on which its loads, drives and masses act."
        )
    same = _same_point_distance([p for beam in beams for p in beam])
    for n, (hub, place) in enumerate(beams):
        part = f"{compliance.link}/{n + 1}"
        split.links.append(part)
        split.add_beam(compliance, (hub, place), axis, part)
        for kind, i, end, at in _attachments(scene, compliance.link):
            if np.linalg.norm(at - place) <= same:
                split.move(kind, i, end, part)


def _split_by_matrix(scene: Any, split: _SplitLinks, compliance: Compliance) -> None:
    """Split a link into its two interfaces and move every attachment to the nearer one.

    Raises SceneError for an attachment that is not at an interface.
    """
    points = np.asarray(compliance.matrix.points)  # type: ignore[union-attr]
    largest = min(INTERFACE_TOLERANCE * float(np.linalg.norm(points[1] - points[0])), 1e-6)
    split.links.append(f"{compliance.link}/2")
    for kind, i, end, at in _attachments(scene, compliance.link):
        off = np.linalg.norm(points - at, axis=1)
        if off.min() > largest:
            name = getattr(scene, kind)[i].name
            raise SceneError(
                f"compliance of link '{compliance.link}': '{name}' is attached at {tuple(at.tolist())}, "
                f"{1e3 * off.min():.3g} mm from the nearest interface of its matrix; the interfaces are at "
                f"{compliance.matrix.points}."  # type: ignore[union-attr]
            )
        if off[1] < off[0]:
            split.move(kind, i, end, f"{compliance.link}/2")


def with_elastic_links(scene: Any) -> Any:
    """The scene with elastic links replaced by their parts; those with a matrix stay in `compliances`.

    Raises SceneError where an attachment is not at an interface of its matrix, a beam has no width axis, or a link no beam.
    """
    split = _SplitLinks(scene)
    for compliance in scene.compliances:
        if f"{compliance.link}/2" in scene.links:
            # already replaced
            continue
        # attachments may have moved with the links replaced so far
        now = replace(scene, links=tuple(split.links), joints=tuple(split.joints), leaves=tuple(split.leaves))
        (_split_by_section if compliance.matrix is None else _split_by_matrix)(now, split, compliance)
    with_matrix = []
    for compliance in scene.compliances:
        if compliance.matrix is not None:
            axis = tuple(float(c) for c in _width_axis(scene, compliance))
            with_matrix.append(replace(compliance, width_axis=axis))
    return replace(
        scene,
        links=tuple(split.links),
        joints=tuple(split.joints),
        leaves=tuple(split.leaves),
        compliances=tuple(with_matrix),
    )
