"""What makes a scene complete: a sentence for every rule broken; `check_scene` raises SceneError for the first."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from typing import Any

from ksd.checks import as_given, name_hint
from ksd.errors import SceneError
from ksd.scene.drive import GROUND, Drive
from ksd.scene.effects import leaf_conditions
from ksd.scene.hinges import PLANES
from ksd.scene.joint import joint_leaves
from ksd.scene.scene import Scene, connected_links


def check_scene(scene: Scene) -> None:
    """Names known and unique, every link attached and tied to ground, no two drives on one freedom.

    Whether the drives determine the motion is a question of ranks, answered by the model.
    """
    for sentence in broken_rules(scene):
        raise SceneError(sentence)


def broken_rules(scene: Scene) -> Iterator[str]:
    """A sentence for every rule that a scene breaks; rules about the whole only where all names are right."""
    if len(scene.links) < 2:
        yield f"mechanism '{scene.name}' has no link; add one with mechanism.link(name)."
    # "hinge/fold" is a block, or a leaf, inside of joint 'hinge'
    slashed = any("/" in name for name in (*scene.links, *(f.name for f in scene.leaves)))
    joints = scene.joints if slashed else ()
    blocks = [f"{j.name}/{block}" for j in joints for block in j.joint.blocks()]
    inside = [f"{j.name}/{leaf.name}" for j in joints for leaf in joint_leaves(j.joint)]
    named = {
        "link": [*scene.links, *blocks],
        "joint or leaf": [*(j.name for j in scene.joints), *(f.name for f in scene.leaves), *inside],
        "drive or support": [d.name for d in (*scene.drives, *scene.supports)],
        "load": [load.name for load in scene.loads],
    }
    wrong = [said for kind, names in named.items() for said in _duplicate_names(kind, names)]
    wrong += _unknown_links(scene)
    yield from wrong
    if wrong or len(scene.links) < 2:
        return
    yield from _unattached_links(scene)
    yield from _duplicate_freedoms(scene)
    yield from _distant_hinges(scene)
    if scene.heats or scene.fits:
        try:
            leaf_conditions(scene.leaf_names(), scene.heats, scene.fits)
        except SceneError as error:
            yield str(error)


def _duplicate_names(kind: str, names: list[str]) -> Iterator[str]:
    for name, count in Counter(names).items() if len(set(names)) < len(names) else ():
        if count > 1:
            yield f"the name '{name}' is used for {count} {kind}s; every {kind} needs its own name."


def _unknown_links(scene: Scene) -> Iterator[str]:
    """Every link that is spoken of exists, and nothing connects a link with itself."""
    spoken: list[tuple[str, str, str]] = []
    for kind, placed in (("joint", scene.joints), ("leaf", scene.leaves)):
        for item in placed:
            if item.a == item.b:
                yield f"{kind} '{item.name}' connects link '{item.a}' with itself; it needs two different links."
            spoken += [(kind, item.name, item.a), (kind, item.name, item.b)]
    for kind, drives in (("drive", scene.drives), ("support", scene.supports)):
        spoken += [(kind, d.name, link) for d in drives for t in d.terms for link in (t.base, t.link)]
    spoken += [("load", load.name, load.link) for load in scene.loads]
    spoken += [("distance", d.name, link) for d in scene.distances for link in (d.a, d.b)]
    spoken += [("spring", s.name, link) for s in scene.springs for link in (s.a, s.b)]
    spoken += [(h.kind, h.name, link) for h in scene.hinges for link in (h.a, h.b)]
    spoken += [("compliance", "", c.link) for c in scene.compliances]
    spoken += [(f"mass {i + 1}", "", mass.link) for i, mass in enumerate(scene.masses)]
    for kind, name, link in spoken:
        if link not in scene.links:
            owner = f"{kind} '{name}'" if name else kind
            yield f"{owner}: link '{link}' does not exist{name_hint(link, scene.links)}"


def _unattached_links(scene: Scene) -> Iterator[str]:
    """Each link carries a joint, leaf, pin or spring, and a chain of joints, leaves or supports leads to ground."""
    hung = {link for part in (*scene.hinges, *scene.springs) for link in (part.a, part.b)}
    next_to = scene.neighbours()
    loose = [link for link, others in next_to.items() if not others and link not in (GROUND, *hung)]
    for link in loose:
        yield (
            f"link '{link}' is attached to nothing; connect it with mechanism.join or mechanism.leaf, or remove it."
        )
    tied = connected_links(scene.neighbours(supports=True) if scene.supports else next_to)
    adrift = [link for link in scene.links if link not in (*tied, *loose)]
    if adrift:
        names = ", ".join(f"'{link}'" for link in adrift)
        yield f"no chain of joints leads from {names} to ground; join one of them to ground."


FAR_RATIO = 200.0
"""How many times the size of everything else a pin may be from what hangs on its link: a thousand is millimetres for m."""
UNIT_SLIP_RATIO = 30.0
"""The same from which it is refused where in millimetres it would be within what its link is attached to."""


def _distant_hinges(scene: Scene) -> Iterator[str]:
    """Pins and sliders are where their links can be, not a thousand times further away."""
    if not scene.hinges:
        return
    hung: dict[str, list[Any]] = {link: [] for link in scene.links}
    for leaf in scene.leaves:
        hung[leaf.a].append(leaf.leaf.start)
        hung[leaf.b].append(leaf.leaf.end)
    for joint in scene.joints:
        hung[joint.a].append(joint.origin)
        hung[joint.b].append(tuple(joint.place(joint.joint.pose_B).tolist()))
    for hinge in scene.hinges:
        others = [place for places in hung.values() for place in places]
        others += [h.at for h in scene.hinges if h is not hinge]
        size = max((math.dist(p, others[0]) for p in others), default=math.inf)
        for link in (hinge.a, hinge.b):
            far = {place: math.dist(place, hinge.at) for place in hung[link]}
            place = min(far, key=lambda p: far[p], default=None)
            if link == GROUND or place is None or far[place] <= UNIT_SLIP_RATIO * size:
                continue
            meant = tuple(1e-3 * x for x in hinge.at)
            slip = min(math.dist(p, meant) for p in others) <= size
            if slip or far[place] > FAR_RATIO * size:
                hint = f"at={meant} if that was in mm" if slip else f"the nearest is at={place}"
                yield (
                    f"{hinge.kind} '{hinge.name}' does not meet link '{link}': at = {hinge.at} is {far[place]:.4g} m from "
                    f"where it is attached, and all else within {size:.4g} m; places are in m, {hint}."
                )


def _duplicate_freedoms(scene: Scene) -> Iterator[str]:
    """No two drives or supports prescribe the very same component."""
    if len(scene.drives) + len(scene.supports) < 2:
        return
    of_links: dict[Any, list[tuple[str, Drive]]] = {}
    for kind, drives in (("drive", scene.drives), ("support", scene.supports)):
        for drive in drives:
            links = frozenset((t.kind, t.base, t.link) for t in drive.terms)
            of_links.setdefault(links, []).append((f"{kind} '{drive.name}'", drive))
    for several in of_links.values():
        seen: dict[tuple[Any, ...], str] = {}
        for spoken, drive in several if len(several) > 1 else ():
            first = seen.setdefault(drive.freedom(), spoken)
            if first != spoken:
                yield f"{first} and {spoken} prescribe the same freedom; remove one of them."


def plane_hint(scene: Scene) -> str:
    """What to say of a scene that looks planar, names no plane, and has links which supports alone tie to ground."""
    across = [as_given(leaf.width_axis) for leaf in scene.leaf_names().values()]
    said = "leaf springs have their width" if across else "pins turn about an axis"
    across += [h.axis for h in scene.hinges if h.kind == "pin"]
    plane = next((p for p, k in PLANES.items() if all(abs(e[k]) > 1.0 - 1e-9 for e in across)), None)
    if scene.plane or plane is None or not across or connected_links(scene.neighbours()) == set(scene.links):
        return ""
    return (
        f"all {said} across the plane {plane}: if the mechanism lives in it, say "
        f"ksd.Mechanism('{scene.name}', plane='{plane}'), which holds every link in it"
    )
