"""Rules that a whole scene must satisfy, with a message for every broken one."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np

from ksd.checks import as_given, name_hint
from ksd.errors import SceneError
from ksd.scene.drive import GROUND, Drive
from ksd.scene.effects import leaf_conditions
from ksd.scene.hinges import PLANES
from ksd.scene.joint import joint_leaves
from ksd.scene.scene import Scene, connected_links
from ksd.section.closed_forms import round_ratio

INERTIA_TOLERANCE = 1e-6
"""Excess of the largest principal moment of inertia over the sum of the others, relative to it, that is rounding."""


def check_scene(scene: Scene) -> None:
    """Raise SceneError for the first broken rule: names, links connected to ground, drives on different freedoms.

    Whether the drives determine the motion is a question of ranks, which the model checks.
    """
    for message in broken_rules(scene):
        raise SceneError(message)


def broken_rules(scene: Scene) -> Iterator[str]:
    """A message for every rule that a scene breaks; rules other than those about names only when all names are right."""
    if len(scene.links) < 2 and not scene.leaves:
        yield f"mechanism '{scene.name}' has no link; add one with mechanism.link(name)."
    # "hinge/fold" is a block or a leaf inside joint 'hinge'
    has_slash = any("/" in name for name in (*scene.links, *(f.name for f in scene.leaves)))
    joints = scene.joints if has_slash else ()
    blocks = [f"{j.name}/{block}" for j in joints for block in j.joint.blocks()]
    inside = [f"{j.name}/{leaf.name}" for j in joints for leaf in joint_leaves(j.joint)]
    named = {
        "link": [*scene.links, *blocks],
        "joint or leaf": [*(j.name for j in scene.joints), *(f.name for f in scene.leaves), *inside],
        "drive or support": [d.name for d in (*scene.drives, *scene.supports)],
        "load": [*(x.name for x in scene.loads), *(x.name for x in scene.loads_along)],
        "stop, cable or drive": [
            *(s.name for s in scene.stops),
            *(c.name for c in scene.cables),
            *(d.name for d in scene.drives),
        ],
    }
    messages = [message for kind, names in named.items() for message in _duplicate_names(kind, names)]
    messages += _unknown_links(scene)
    yield from messages
    if messages or (len(scene.links) < 2 and not scene.leaves):
        return
    yield from _unattached_links(scene)
    yield from _duplicate_freedoms(scene)
    yield from _distant_hinges(scene)
    yield from _impossible_inertias(scene)
    yield from _closed_stops(scene)
    if scene.heats or scene.fits:
        try:
            leaf_conditions(scene.leaf_names(), scene.heats, scene.fits)
        except SceneError as error:
            yield str(error)


def _duplicate_names(kind: str, names: list[str]) -> Iterator[str]:
    """A message for every name that is used more than once."""
    for name, count in Counter(names).items() if len(set(names)) < len(names) else ():
        if count > 1:
            yield f"the name '{name}' is used for {count} {kind}s; every {kind} needs its own name."


def _unknown_links(scene: Scene) -> Iterator[str]:
    """A message for every part that refers to a link that does not exist, or connects a link with itself."""
    references: list[tuple[str, str, str]] = []
    for kind, placed in (("joint", scene.joints), ("leaf", scene.leaves)):
        for item in placed:
            if item.a == item.b and kind == "joint":
                yield f"{kind} '{item.name}' connects link '{item.a}' with itself; it needs two different links."
            references += [(kind, item.name, item.a), (kind, item.name, item.b)]
    for kind, drives in (("drive", scene.drives), ("support", scene.supports)):
        references += [(kind, d.name, link) for d in drives for t in d.terms for link in (t.base, t.link)]
    references += [("load", load.name, load.link) for load in scene.loads]
    for kind, observed in (("sensor", scene.sensors), ("damper", scene.dampers)):
        references += [
            (kind, part.name, link) for part in observed for link in (part.term.base, part.term.link)
        ]
    references += [
        ("distance", d.name, link)
        for d in scene.distances
        for link in (d.a, d.b, d.turns_with)
        if link is not None
    ]
    references += [("stop", s.name, link) for s in scene.stops for t in s.terms for link in (t.base, t.link)]
    references += [("cable", c.name, link) for c in scene.cables for link, _ in c.points]
    references += [("surface", s.name, s.link) for s in scene.surfaces]
    references += [("spring", s.name, link) for s in scene.springs for link in (s.a, s.b)]
    references += [(h.kind, h.name, link) for h in scene.hinges for link in (h.a, h.b)]
    references += [("compliance", "", c.link) for c in scene.compliances]
    references += [(f"mass {i + 1}", "", mass.link) for i, mass in enumerate(scene.masses)]
    for kind, name, link in references:
        if link not in scene.links:
            owner = f"{kind} '{name}'" if name else kind
            yield f"{owner}: link '{link}' does not exist{name_hint(link, scene.links)}"


def _impossible_inertias(scene: Scene) -> Iterator[str]:
    """A message for every inertia that no rigid body has; in a plane one moment counts, and the others may be left zero."""
    for mass in scene.masses if scene.plane is None else ():
        least, middle, most = np.linalg.eigvalsh(np.array(mass.inertia)).tolist()
        if least + middle < most * (1.0 - INERTIA_TOLERANCE):
            yield (
                f"mass on '{mass.link}': inertia with the principal moments {least:.4g}, {middle:.4g} and {most:.4g} kg m^2 "
                "is that of no body, in which none is more than the sum of the other two; correct it"
            )


def _closed_stops(scene: Scene) -> Iterator[str]:
    """A message for every end stop that the undeformed mechanism is beyond, unless an assembly error may take it there."""
    for stop in scene.stops if not scene.fits else ():
        for name, value in stop.limits.items():
            key = name.rpartition(".")[2]
            if value > 0.0 if key == "low" else value < 0.0:
                unit, size = ("rad", value) if stop.dimension == "angle" else ("mm", 1e3 * value)
                yield (
                    f"stop '{stop.name}' is closed at rest by {abs(size):.4g} {unit}, as {key} = {value:g}; draw it open, "
                    f"and move it when solving: ksd.solve(scene, {{'{name}': {value:g}}})"
                )


def _unattached_links(scene: Scene) -> Iterator[str]:
    """A message for every link without joint, leaf, pin or spring, and for those not connected to ground.

    Joints, leaf springs and supports connect links.
    """
    attached = {link for part in (*scene.hinges, *scene.springs) for link in (part.a, part.b)}
    # what may touch rests on contacts, or on its drives
    touched = {surface.link for surface in scene.surfaces}
    attached |= touched
    neighbours = scene.neighbours()
    unattached = [
        link for link, others in neighbours.items() if not others and link not in (GROUND, *attached)
    ]
    for link in unattached:
        yield (
            f"link '{link}' is attached to nothing; connect it with mechanism.join or mechanism.leaf, or remove it."
        )
    connected = connected_links(scene.neighbours(supports=True) if scene.supports else neighbours)
    unconnected = [link for link in scene.links if link not in (*connected, *unattached, *touched)]
    if unconnected:
        names = ", ".join(f"'{link}'" for link in unconnected)
        yield f"no chain of joints leads from {names} to ground; join one of them to ground."


FAR_RATIO = 200.0
"""Largest distance of a pin from the attachments of its link, over the size of the rest; a ratio of 1000 means mm for m."""
UNIT_SLIP_RATIO = 30.0
"""The same for a pin that would be within the size of the rest if its position was given in mm."""


def _distant_hinges(scene: Scene) -> Iterator[str]:
    """A message for every pin or slider that is much further from its link than the rest of the mechanism is large."""
    if not scene.hinges:
        return
    attachments: dict[str, list[Any]] = {link: [] for link in scene.links}
    for leaf in scene.leaves:
        attachments[leaf.a].append(leaf.leaf.start)
        attachments[leaf.b].append(leaf.leaf.end)
    for joint in scene.joints:
        attachments[joint.a].append(joint.origin)
        attachments[joint.b].append(tuple(joint.place(joint.joint.pose_B).tolist()))
    for hinge in scene.hinges:
        others = [point for points in attachments.values() for point in points]
        others += [h.at for h in scene.hinges if h is not hinge]
        size = max((math.dist(p, others[0]) for p in others), default=math.inf)
        for link in (hinge.a, hinge.b):
            distances = {point: math.dist(point, hinge.at) for point in attachments[link]}
            nearest = min(distances, key=lambda p: distances[p], default=None)
            if link == GROUND or nearest is None or distances[nearest] <= UNIT_SLIP_RATIO * size:
                continue
            in_mm = tuple(1e-3 * x for x in hinge.at)
            is_unit_slip = min(math.dist(p, in_mm) for p in others) <= size
            if is_unit_slip or distances[nearest] > FAR_RATIO * size:
                hint = f"at={in_mm} if that was in mm" if is_unit_slip else f"the nearest is at={nearest}"
                yield (
                    f"{hinge.kind} '{hinge.name}' does not meet link '{link}': at = {hinge.at} is "
                    f"{distances[nearest]:.4g} m from where it is attached, and all else within {size:.4g} m; places are in "
                    f"m, {hint}."
                )


def _duplicate_freedoms(scene: Scene) -> Iterator[str]:
    """A message for every two drives or supports that prescribe the same component."""
    if len(scene.drives) + len(scene.supports) < 2:
        return
    of_links: dict[Any, list[tuple[str, Drive]]] = {}
    for kind, drives in (("drive", scene.drives), ("support", scene.supports)):
        for drive in drives:
            links = frozenset((t.kind, t.base, t.link) for t in drive.terms)
            of_links.setdefault(links, []).append((f"{kind} '{drive.name}'", drive))
    for several in of_links.values():
        seen: dict[tuple[Any, ...], str] = {}
        for label, drive in several if len(several) > 1 else ():
            first = seen.setdefault(drive.freedom(), label)
            if first != label:
                yield f"{first} and {label} prescribe the same freedom; remove one of them."


def plane_hint(scene: Scene) -> str:
    """Hint for a scene that looks planar without a plane, and has links connected to ground by supports alone; else "".

    Round wires have no width; they, gravity and forces must lie in the plane.
    """
    leaves = scene.leaf_names().values()
    round_leaves = [leaf for leaf in leaves if round_ratio(leaf.section) is not None]
    normals = [as_given(leaf.width_axis) for leaf in leaves if leaf not in round_leaves]
    what = "leaf springs have their width" if normals else "pins turn about an axis"
    normals += [h.axis for h in scene.hinges if h.kind == "pin"]
    within = [np.subtract(leaf.end, leaf.start) for leaf in round_leaves] + [x.force for x in scene.loads]
    within += [scene.gravity] * (scene.gravity is not None)
    plane = next(
        (
            p
            for p, k in PLANES.items()
            if all(abs(e[k]) > 1.0 - 1e-9 for e in normals)
            and all(abs(v[k]) <= 1e-9 * np.linalg.norm(v) for v in within)
        ),
        None,
    )
    in_space = any(h.kind in ("ball", "cylindrical") for h in scene.hinges)
    if scene.plane or plane is None or in_space or not (normals or within):
        return ""
    if connected_links(scene.neighbours()) == set(scene.links):
        return ""
    where = f"{what} normal to" if normals else "wires and loads lie in"
    return (
        f"all {where} the plane {plane}: if the mechanism lives in it, say "
        f"ksd.Mechanism('{scene.name}', plane='{plane}'), which holds every link in it"
    )
