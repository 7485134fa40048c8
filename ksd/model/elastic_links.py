"""Elastic links as what they are made of: small rigid links at the attachments, joined by beams or a matrix.

A link with a section becomes a hub and one beam to every attachment; a link with a matrix becomes its two interfaces.
All that follows (plane, frequencies, pictures) sees ordinary links and leaf springs.
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
"""Distance [m] below which an attachment sits at a place."""


def _attachments(scene: Any, link: str) -> list[tuple[str, int, int, np.ndarray]]:
    """("joints" or "leaf springs", number in the scene, end 0 or 1, place (3,)) of all that is attached to a link."""
    found = []
    for i, j in enumerate(scene.joints):
        places = (np.asarray(j.origin, float), j.place(j.joint.pose_B))
        found += [("joints", i, e, places[e]) for e, name in enumerate((j.a, j.b)) if name == link]
    for i, f in enumerate(scene.leaves):
        places = (np.asarray(f.leaf.start, float), np.asarray(f.leaf.end, float))
        found += [("leaves", i, e, places[e]) for e, name in enumerate((f.a, f.b)) if name == link]
    return found


def _width_axis(scene: Any, said: Compliance) -> np.ndarray:
    """Direction of the width of a link's section: as said, else the axis of the first joint or leaf on it."""
    if said.width_axis is not None:
        return np.asarray(said.width_axis, float)
    kind, i, _, _ = _attachments(scene, said.link)[0]
    if kind == "joints":
        return np.asarray(scene.joints[i].rotation, float)[:, 2]
    return np.asarray(scene.leaves[i].leaf.width_axis, float)


class _Rewritten:
    """A scene while attachments are moved from an elastic link to its parts."""

    def __init__(self, scene: Any) -> None:
        self.links = list(scene.links)
        self.joints, self.leaves = list(scene.joints), list(scene.leaves)

    def move(self, kind: str, i: int, end: int, to: str) -> None:
        """Attach one end of a joint or leaf to the link `to`."""
        items = getattr(self, kind)
        items[i] = replace(items[i], **{"ab"[end]: to})

    def beam(self, said: Compliance, ends: tuple[np.ndarray, np.ndarray], axis: np.ndarray, to: str) -> None:
        """A beam of the link's section from its hub to the part `to`."""
        along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        width = axis - (axis @ along) * along
        if np.linalg.norm(width) < 1e-3:
            raise SceneError(
                f"compliance of link '{said.link}': width_axis lies along its beam to {tuple(ends[1].tolist())}; "
                "give a width_axis across it."
            )
        beam = Leaf(
            start=tuple(ends[0].tolist()),
            end=tuple(ends[1].tolist()),
            width_axis=tuple((width / np.linalg.norm(width)).tolist()),
            section=said.section,  # type: ignore[arg-type]
            material=said.material,  # type: ignore[arg-type]
            start_block=said.link,
            end_block=to,
            name=f"{to} beam",
        )
        self.leaves.append(PlacedLeaf(beam.name, said.link, to, beam))


def beams_of(scene: Any, said: Compliance) -> list[tuple[np.ndarray, np.ndarray]]:
    """Hub and attachment (3,) [m] of every beam of a link with a section."""
    places = [p for *_, p in _attachments(scene, said.link)]
    hub = np.mean(places, axis=0) if said.hub is None else np.asarray(said.hub, float)
    seen: list[np.ndarray] = []
    for place in places:
        if all(np.linalg.norm(place - p) > ATTACHMENT_TOLERANCE for p in (*seen, hub)):
            seen.append(place)
    return [(hub, place) for place in seen]


def _by_section(scene: Any, made: _Rewritten, said: Compliance) -> None:
    axis = _width_axis(scene, said)
    beams = beams_of(scene, said)
    for n, (hub, place) in enumerate(beams):
        part = f"{said.link}/{n + 1}"
        made.links.append(part)
        made.beam(said, (hub, place), axis, part)
        for kind, i, end, at in _attachments(scene, said.link):
            if np.linalg.norm(at - place) <= ATTACHMENT_TOLERANCE:
                made.move(kind, i, end, part)


def _by_matrix(scene: Any, made: _Rewritten, said: Compliance) -> None:
    """Two halves of a link for its two interfaces; what hangs on it goes to the nearer one. Raises SceneError where that is
    not near."""
    points = np.asarray(said.matrix.points)  # type: ignore[union-attr]
    made.links.append(f"{said.link}/2")
    for kind, i, end, at in _attachments(scene, said.link):
        off = np.linalg.norm(points - at, axis=1)
        if off.min() > ATTACHMENT_TOLERANCE:
            name = getattr(scene, kind)[i].name
            raise SceneError(
                f"compliance of link '{said.link}': '{name}' is attached at {tuple(at.tolist())}, {1e3 * off.min():.3g} mm "
                f"from the nearest interface of its matrix; the interfaces are at {said.matrix.points}."  # type: ignore[union-attr]
            )
        if off[1] < off[0]:
            made.move(kind, i, end, f"{said.link}/2")


def with_elastic_links(scene: Any) -> Any:
    """The scene whose elastic links are taken apart; those with a matrix stay in `compliances`.

    Raises SceneError where an attachment is not at an interface of its matrix, or a beam has no width axis.
    """
    made = _Rewritten(scene)
    for said in scene.compliances:
        if f"{said.link}/2" in scene.links:
            # taken apart already
            continue
        # the attachments of what has been rewritten so far
        now = replace(scene, links=tuple(made.links), joints=tuple(made.joints), leaves=tuple(made.leaves))
        (_by_section if said.matrix is None else _by_matrix)(now, made, said)
    kept = []
    for said in scene.compliances:
        if said.matrix is not None:
            axis = tuple(float(c) for c in _width_axis(scene, said))
            kept.append(replace(said, width_axis=axis))
    return replace(
        scene,
        links=tuple(made.links),
        joints=tuple(made.joints),
        leaves=tuple(made.leaves),
        compliances=tuple(kept),
    )
