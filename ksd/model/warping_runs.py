"""Leaf springs that meet end to end, and the runs of them through which warping passes.

A leaf is clamped to blocks that hold its ends plane. Where two straight leaves meet on a block that carries nothing else,
nothing holds the section between them: its warping and bimoment are continuous. The torque is the same in all leaves of such
a run, so that this seventh unknown can be eliminated (`ksd.section.warping`): every leaf gets the factor on GJ with which
it twists as it does in the run, restrained at the outer ends alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ksd.section.closed_forms import clamped_ends_factor
from ksd.section.warping import SLICES_PER_PIECE, Slice, twist_factors, warping_decay

IN_LINE_COSINE = -1.0 + 1e-6
"""Product of the directions out of two leaf springs below which one goes on where the other ends."""


class Junction(NamedTuple):
    """Two leaf springs, by full name, that run on in one line; block: the link or block, by full name, they meet on; passes:
    whether it carries nothing else and the widths of both are parallel, so that warping passes."""

    one: str
    two: str
    block: str
    passes: bool


class _End(NamedTuple):
    """A leaf end on a block: full name of the leaf, the leaf, direction (3,) out of it."""

    name: str
    leaf: Any
    out: np.ndarray


def in_line_junctions(scene: Any) -> list[Junction]:
    """All pairs of leaf springs that are clamped to one block in one point and run on in one line."""
    return [
        Junction(a.name, b.name, block, alone and _pass_on(a.leaf, b.leaf))
        for block, a, b, alone in _pairs(scene)
        if a.out @ b.out < IN_LINE_COSINE
    ]


def folded_junctions(scene: Any) -> list[Junction]:
    """All pairs of leaves that are clamped in one point to a block that carries nothing else, at an angle: a fold, which is
    taken to hold both ends plane."""
    return [
        Junction(a.name, b.name, block, False)
        for block, a, b, alone in _pairs(scene)
        if alone and a.out @ b.out >= IN_LINE_COSINE
    ]


def _pairs(scene: Any) -> Iterator[tuple[str, _End, _End, bool]]:
    """Ends of two leaf springs in one point of a block, and whether it carries nothing else."""
    blocks: dict[str, dict[tuple[float, ...], list[_End]]] = {}
    for block, place, end in _ends(scene):
        # beyond 1e-6 m they are apart
        key = tuple(round(float(c), 6) + 0.0 for c in place)
        blocks.setdefault(block, {}).setdefault(key, []).append(end)
    busy = _busy(scene)
    for block, places in blocks.items():
        alone = sum(map(len, places.values())) == 2 and block not in busy
        for here in places.values():
            for k, a in enumerate(here):
                yield from ((block, a, b, alone) for b in here[k + 1 :] if a.name != b.name)


def run_torsion_factors(scene: Any) -> dict[str, float]:
    """Factor on GJ of leaves, by full name, that are part of a run or whose section varies; others have the closed form of
    `ksd.section.restrained_warping_factor`."""
    leaves = scene.leaf_names()
    groups: list[set[str]] = [{n} for n, leaf in leaves.items() if leaf.profile is not None and _warps(leaf)]
    for meeting in in_line_junctions(scene):
        if meeting.passes:
            pair = {meeting.one, meeting.two}
            touched = [g for g in groups if g & pair]
            groups = [g for g in groups if not g & pair] + [pair.union(*touched)]
    found: dict[str, float] = {}
    for group in groups:
        run = _in_line({n: leaves[n] for n in sorted(group)})
        found |= dict(zip(run, twist_factors(list(run.values())), strict=True))
    return found


def clamped_torsion_factor(leaf: Any) -> float:
    """Factor on GJ of one leaf clamped at both ends, where it cannot warp."""
    slices = _slices(leaf)
    return (
        clamped_ends_factor(slices[0].decay * leaf.length) if len(slices) == 1 else twist_factors([slices])[0]
    )


def half_clamped_torsion_factor(leaf: Any) -> float:
    """Factor on GJ of one leaf that cannot warp at one end and is free to at the other: as if it went on in its mirror."""
    slices = _slices(leaf)
    if len(slices) == 1:
        return clamped_ends_factor(2.0 * slices[0].decay * leaf.length)
    return twist_factors([slices + slices[::-1]])[0]


def _warps(leaf: Any) -> bool:
    return bool(leaf.section.Iw > 0.0)


def _in_line(leaves: dict[str, Any]) -> dict[str, list[Slice]]:
    """The slices of the leaf springs of one run, by name, from one end of it to the other."""
    first = next(iter(leaves.values()))
    along = np.subtract(first.end, first.start)
    order = sorted(leaves, key=lambda n: float(along @ np.add(leaves[n].start, leaves[n].end)))
    ahead = {n: along @ np.subtract(leaves[n].end, leaves[n].start) > 0.0 for n in order}
    return {n: _slices(leaves[n])[:: 1 if ahead[n] else -1] for n in order}


def _slices(leaf: Any) -> list[Slice]:
    """The leaf as uniform slices from start to end."""
    m = leaf.material
    if leaf.profile is None:
        sections, cuts = [leaf.section], [0.0, 1.0]
    else:
        edges = sorted({*np.linspace(0.0, 1.0, SLICES_PER_PIECE + 1).tolist(), *leaf.profile.breaks})
        sections = [leaf.profile.section(0.5 * (a + b)) for a, b in pairwise(edges)]
        cuts = edges
    return [
        Slice((b - a) * leaf.length, m.G * q.J, warping_decay(q, m.E, m.nu, m.G))
        for q, (a, b) in zip(sections, pairwise(cuts), strict=True)
    ]


def _ends(scene: Any) -> Iterator[tuple[str, Any, _End]]:
    """(block, place, end) of every leaf end; blocks inside joints by full name, their interfaces as the joint's own."""
    for joint in scene.joints:
        for leaf in joint.leaves():
            for block, place, out in _both(leaf):
                yield f"{joint.name}/{block}", place, _End(f"{joint.name}/{leaf.name}", leaf, out)
    for free in scene.leaves:
        for block, (_, place, out) in zip((free.a, free.b), _both(free.leaf), strict=True):
            yield block, place, _End(free.name, free.leaf, out)


def _both(leaf: Any) -> tuple[tuple[str, Any, np.ndarray], tuple[str, Any, np.ndarray]]:
    e1 = np.subtract(leaf.end, leaf.start) / math.dist(leaf.start, leaf.end)
    return (leaf.start_block, leaf.start, -e1), (leaf.end_block, leaf.end, e1)


def _busy(scene: Any) -> set[str]:
    """Links and blocks that are bodies: something else than leaf springs is said of them."""
    found = {"ground", *(m.link for m in scene.masses), *(p.link for p in scene.loads)}
    found |= {name for j in scene.joints for name in (j.a, j.b, f"{j.name}/A", f"{j.name}/B")}
    found |= {name for s in scene.springs for name in (s.a, s.b)}
    found |= {c.link for c in scene.compliances}
    terms = [t for d in (*scene.drives, *scene.supports) for t in d.terms]
    return found | {name for t in terms for name in (t.base, t.link)}


def _pass_on(one: Any, two: Any) -> bool:
    """Whether warping can pass between two leaf springs in one line: both straight, widths parallel."""
    straight = all(leaf.curve is None and _warps(leaf) for leaf in (one, two))
    across = (
        np.zeros(3)
        if one.width_axis is None or two.width_axis is None
        else np.cross(one.width_axis, two.width_axis)
    )
    return bool(straight and np.abs(across).max() < 1e-9)
