"""Twist of leaf springs with restrained warping, alone and in runs that warping passes through.

A leaf is clamped to blocks that keep its end sections plane. Where two straight leaves meet on a block that carries nothing
else, the section between them is free to warp: warping and bimoment are continuous there. The torque is linear along such a
run, so this seventh unknown can be eliminated (`ksd.section.warping`): every leaf gets the compliance along it with which it
twists as it does in the run, whose warping is restrained at the two outer ends only.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ksd.section.along_leaf import element_edges
from ksd.section.warping import SLICES_PER_PIECE, Piece, RestrainedTwist, Slice, twist_along, warping_decay

IN_LINE_COSINE = -1.0 + 1e-6
"""Cosine between the outward directions of two leaf ends below which the two leaves lie in one line."""

MEETING_DISTANCE = 1e-5
"""Largest distance of two ends that meet, relative to the length of the shorter leaf."""


class Junction(NamedTuple):
    """Two leaf springs that are clamped to one block in one point.

    one, two: full names of the leaves; block: full name of the link or block; warping_passes: whether warping is continuous
    from one leaf to the other, because they lie in one line, the block carries nothing else and their widths are parallel.
    """

    one: str
    two: str
    block: str
    warping_passes: bool


class _End(NamedTuple):
    """A leaf end on a block: full name of the leaf, the leaf, unit direction (3,) from this end out of the leaf."""

    name: str
    leaf: Any
    outward: np.ndarray


def in_line_junctions(scene: Any) -> list[Junction]:
    """Pairs of leaf springs that are clamped to one block in one point and continue each other in one line."""
    return [
        Junction(a.name, b.name, block, alone and _warping_can_pass(a.leaf, b.leaf))
        for block, a, b, alone in _end_pairs(scene)
        if a.outward @ b.outward < IN_LINE_COSINE
    ]


def folded_junctions(scene: Any) -> list[Junction]:
    """Folds: pairs of leaves clamped in one point, at an angle, to a block that carries nothing else.

    A fold is taken to keep both end sections plane.
    """
    return [
        Junction(a.name, b.name, block, False)
        for block, a, b, alone in _end_pairs(scene)
        if alone and a.outward @ b.outward >= IN_LINE_COSINE
    ]


def _end_pairs(scene: Any) -> Iterator[tuple[str, _End, _End, bool]]:
    """(block, end, end, whether the block carries nothing else) of all leaf ends that share a point of a block."""
    blocks: dict[str, list[tuple[Any, _End]]] = {}
    for block, place, end in _leaf_ends(scene):
        blocks.setdefault(block, []).append((place, end))
    loaded = _loaded_blocks(scene)
    for block, ends in blocks.items():
        alone = len(ends) == 2 and block not in loaded
        places, length = (
            np.array([place for place, _ in ends]),
            np.array([end.leaf.length for _, end in ends]),
        )
        apart = np.linalg.norm(places[:, None] - places, axis=2) / np.minimum.outer(length, length)
        for i, j in np.argwhere(np.triu(apart < MEETING_DISTANCE, 1)).tolist():
            a, b = ends[i][1], ends[j][1]
            if a.name != b.name:
                yield block, a, b, alone


def run_twists(scene: Any) -> dict[str, RestrainedTwist]:
    """How the leaves twist, by full name, that are part of a run or have a varying section; the others do so alone."""
    leaves = scene.leaf_names()
    warping = {name: leaf for name, leaf in leaves.items() if leaf.section.Iw > 0.0}
    found: dict[str, RestrainedTwist] = {}
    for run in runs_of_leaves(scene, warping):
        if len(run) > 1 or leaves[run[0][0]].profile is not None:
            twists = twist_along([_piece(leaves[name], along) for name, along in run])
            for (name, along), twist in zip(run, twists, strict=True):
                found[name] = twist if along else twist.turned()
    return found


def runs_of_leaves(scene: Any, leaves: Mapping[str, Any]) -> list[list[tuple[str, bool]]]:
    """Runs of those leaves between which warping and curling pass: names in order, and whether a leaf points along the run.

    A leaf that meets none of the others is a run of its own.
    """
    groups = {name: {name} for name in leaves}
    for junction in in_line_junctions(scene) if len(leaves) > 1 else ():
        if junction.warping_passes and junction.one in leaves and junction.two in leaves:
            joined = groups[junction.one] | groups[junction.two]
            groups |= dict.fromkeys(joined, joined)
    runs = []
    for group in {id(g): g for g in groups.values()}.values():
        along = np.subtract(leaves[min(group)].end, leaves[min(group)].start)
        order = sorted(group, key=lambda n: float(along @ np.add(leaves[n].start, leaves[n].end)))
        runs.append([(n, bool(along @ np.subtract(leaves[n].end, leaves[n].start) > 0.0)) for n in order])
    return runs


def free_ends(scene: Any) -> set[tuple[str, bool]]:
    """(full name of a leaf, whether it is its start) of the ends on blocks that carry nothing else."""
    on: dict[str, list[tuple[str, bool]]] = {}
    for k, (block, _, end) in enumerate(_leaf_ends(scene)):
        on.setdefault(block, []).append((end.name, k % 2 == 0))
    loaded = _loaded_blocks(scene)
    return {ends[0] for block, ends in on.items() if len(ends) == 1 and block not in loaded}


def clamped_twist(leaf: Any) -> RestrainedTwist:
    """How a single leaf twists whose warping is restrained at both ends."""
    (twist,) = twist_along([_piece(leaf, True)])
    return twist


def half_clamped_torsion_factor(leaf: Any) -> float:
    """Factor on GJ of a single leaf whose warping is restrained at one end and free at the other.

    By symmetry this is the factor of the leaf joined to its mirror image.
    """
    return twist_along([_piece(leaf, True), _piece(leaf, False)])[0].factor


def _piece(leaf: Any, along: bool) -> Piece:
    """The leaf as a piece of a run, from its start to its end, or backwards."""
    m, profile = leaf.material, leaf.profile
    edges = element_edges(leaf.length, leaf.section.width)
    if profile is None:
        slices = [Slice(leaf.length, m.G * leaf.section.J, warping_decay(leaf.section, m.E, m.nu, m.G))]
    else:
        edges = np.unique([*edges, *profile.breaks])
        slices = []
        for a, b in pairwise(
            sorted({*np.linspace(0.0, 1.0, SLICES_PER_PIECE + 1).tolist(), *profile.breaks})
        ):
            q = profile.section(0.5 * (a + b))
            slices.append(Slice((b - a) * leaf.length, m.G * q.J, warping_decay(q, m.E, m.nu, m.G)))
    return Piece(slices, edges) if along else Piece(slices[::-1], 1.0 - edges[::-1])


def _leaf_ends(scene: Any) -> Iterator[tuple[str, Any, _End]]:
    """(block, position, end) of every leaf end, blocks of joints, interfaces A and B included, as "joint/block"."""
    for joint in scene.joints:
        for leaf in joint.leaves():
            for block, place, out in _both_ends(leaf):
                yield f"{joint.name}/{block}", place, _End(f"{joint.name}/{leaf.name}", leaf, out)
    for free in scene.leaves:
        for block, (_, place, out) in zip((free.a, free.b), _both_ends(free.leaf), strict=True):
            yield block, place, _End(free.name, free.leaf, out)


def _both_ends(leaf: Any) -> tuple[tuple[str, Any, np.ndarray], tuple[str, Any, np.ndarray]]:
    """(block, position, outward direction (3,)) of the start and the end of a leaf."""
    e1 = np.subtract(leaf.end, leaf.start) / math.dist(leaf.start, leaf.end)
    return (leaf.start_block, leaf.start, -e1), (leaf.end_block, leaf.end, e1)


def _loaded_blocks(scene: Any) -> set[str]:
    """Names of links and blocks that carry something other than leaf springs: masses, loads, joints, drives ..."""
    names = {"ground", *(m.link for m in scene.masses), *(p.link for p in scene.loads)}
    names |= {name for j in scene.joints for name in (j.a, j.b, f"{j.name}/A", f"{j.name}/B")}
    names |= {name for s in scene.springs for name in (s.a, s.b)}
    names |= {c.link for c in scene.compliances}
    terms = [t for d in (*scene.drives, *scene.supports) for t in d.terms]
    return names | {name for t in terms for name in (t.base, t.link)}


def _warping_can_pass(one: Any, two: Any) -> bool:
    """Whether warping can pass between two leaf springs in one line: both are straight and their widths are parallel."""
    straight = all(leaf.curve is None and leaf.section.Iw > 0.0 for leaf in (one, two))
    across = (
        np.zeros(3)
        if one.width_axis is None or two.width_axis is None
        else np.cross(one.width_axis, two.width_axis)
    )
    return bool(straight and np.abs(across).max() < 1e-9)
