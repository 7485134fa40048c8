"""Leafs that meet end to end, and the runs of them through which warping passes.

A leaf is clamped to blocks that hold its ends plane. Where two pieces of one leaf meet on a block that carries nothing
else, nothing holds the section between them: its warping and bimoment are continuous. The torque is the same in both, so
that this seventh unknown can be eliminated in closed form: the run twists like one leaf of the whole length, restrained
at its outer ends alone (Vlasov 1961; acceptance A gives the factor).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np


class Meeting(NamedTuple):
    """Two leafs, by full name, that run on in one line; block: the link or block, by full name, they meet on; passes:
    whether it carries nothing else and both have one uniform section, so that warping passes."""

    one: str
    two: str
    block: str
    passes: bool


class _End(NamedTuple):
    """A leaf end on a block: full name of the leaf, the leaf, direction (3,) out of it."""

    name: str
    leaf: Any
    out: np.ndarray


def meetings(scene: Any) -> list[Meeting]:
    """All pairs of leafs that are clamped to one block in one point and run on in one line."""
    blocks: dict[str, dict[tuple[float, ...], list[_End]]] = {}
    for block, place, end in _ends(scene):
        # beyond 1e-6 m they are apart
        key = tuple(round(float(c), 6) + 0.0 for c in place)
        blocks.setdefault(block, {}).setdefault(key, []).append(end)
    busy = _busy(scene)
    found = []
    for block, places in blocks.items():
        count = sum(map(len, places.values()))
        for here in places.values():
            for k, a in enumerate(here):
                for b in here[k + 1 :]:
                    if a.out @ b.out < -1.0 + 1e-6 and a.name != b.name:
                        free = count == 2 and block not in busy and _alike(a.leaf, b.leaf)
                        found.append(Meeting(a.name, b.name, block, free))
    return found


def free_runs(scene: Any) -> dict[str, float]:
    """Length [m] of the run through which the warping of a leaf passes, for leafs, by full name, that are part of one."""
    leafs = scene.leaf_names()
    groups: list[set[str]] = []
    for meeting in meetings(scene):
        if meeting.passes:
            pair = {meeting.one, meeting.two}
            touched = [g for g in groups if g & pair]
            groups = [g for g in groups if not g & pair] + [pair.union(*touched)]
    return {name: sum(leafs[n].length for n in sorted(group)) for group in groups for name in group}


def _ends(scene: Any) -> Iterator[tuple[str, Any, _End]]:
    """(block, place, end) of every leaf end; blocks inside joints by full name, their interfaces as the joint's own."""
    for joint in scene.joints:
        for leaf in joint.leafs():
            for block, place, out in _both(leaf):
                yield f"{joint.name}/{block}", place, _End(f"{joint.name}/{leaf.name}", leaf, out)
    for free in scene.leafs:
        for block, (_, place, out) in zip((free.a, free.b), _both(free.leaf), strict=True):
            yield block, place, _End(free.name, free.leaf, out)


def _both(leaf: Any) -> tuple[tuple[str, Any, np.ndarray], tuple[str, Any, np.ndarray]]:
    e1 = np.subtract(leaf.end, leaf.start) / math.dist(leaf.start, leaf.end)
    return (leaf.start_block, leaf.start, -e1), (leaf.end_block, leaf.end, e1)


def _busy(scene: Any) -> set[str]:
    """Links and blocks that are bodies: something else than leafs is said of them."""
    found = {"ground", *(m.link for m in scene.masses), *(p.link for p in scene.loads)}
    found |= {name for j in scene.joints for name in (j.a, j.b, f"{j.name}/A", f"{j.name}/B")}
    found |= {name for s in scene.springs for name in (s.a, s.b)}
    found |= {c.link for c in scene.compliances}
    terms = [t for d in (*scene.drives, *scene.supports) for t in d.terms]
    return found | {name for t in terms for name in (t.base, t.link)}


def _alike(one: Any, two: Any) -> bool:
    """Whether two leafs are pieces of one: the same uniform, straight strip."""
    plain = all(leaf.profile is None and leaf.curve is None for leaf in (one, two))
    across = (
        np.zeros(3)
        if one.width_axis is None or two.width_axis is None
        else np.cross(one.width_axis, two.width_axis)
    )
    same = one.section == two.section and one.material == two.material
    return bool(plain and same and np.abs(across).max() < 1e-9)
