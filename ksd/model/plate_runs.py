"""Plate stiffening of the leaf springs of a scene: which sections clamps keep flat, and what that does to each leaf.

A leaf is clamped to blocks that keep its end sections flat. Curling passes where warping passes (`ksd.model.warping_runs`):
through a block that carries nothing but two straight leaves in one line, and through points of leaves. It is free at a block
that carries one leaf and nothing else.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np

from ksd.model.warping_runs import free_ends, runs_of_leaves
from ksd.scene.leaf import LeafCondition
from ksd.section.along_leaf import element_edges, element_points
from ksd.section.plate import PlateStiffening, Strips, curl_along

Run = tuple[tuple[Any, bool], ...]
"""Leaves of a run in order, each with whether it points along the run."""


def has_width(section: Any) -> bool:
    """Whether a section can curl: wider than thick."""
    return bool(section.width > section.thickness > 0.0)


def is_wide(leaf: Any) -> bool:
    """Whether a leaf has plate stiffening: a section that can curl, of a material with lateral contraction."""
    return leaf.material.nu != 0.0 and has_width(leaf.section)


def plate_conditions(scene: Any) -> dict[str, LeafCondition]:
    """Conditions of the wide leaves of a scene with their plate stiffening, by full name."""
    leaves = scene.leaf_names()
    wide = {name: leaf for name, leaf in leaves.items() if is_wide(leaf)}
    if not wide:
        return {}
    free, conditions = free_ends(scene), {}
    for run in runs_of_leaves(scene, wide):
        (first, starts), (last, ends) = run[0], run[-1]
        held = (first, starts) not in free, (last, not ends) not in free
        members: Run = tuple((_plain(wide[name]), along) for name, along in run)
        try:
            found = _cached_stiffening(members, held)
        except TypeError:
            # a profile or curve of the user may not be hashable
            found = _stiffening(members, held)
        for (name, _), plate in zip(run, found, strict=True):
            conditions[name] = replace(leaves[name].condition or LeafCondition(), plate=plate)
    return conditions


def _plain(leaf: Any) -> Any:
    """The leaf at the origin, without names, end blocks and condition, as equal leaves have equal plate stiffening."""
    return replace(
        leaf, start=(0.0, 0.0, 0.0), end=(np.linalg.norm(np.subtract(leaf.end, leaf.start)), 0.0, 0.0),
        width_axis=(0.0, 0.0, 1.0), name="leaf", start_block="A", end_block="B", condition=None,
        elements=None, orders=None,
    )  # fmt: skip


def _stiffening(run: Run, held: tuple[bool, bool]) -> tuple[PlateStiffening, ...]:
    """Plate stiffening of every leaf of a run; held: whether clamps keep its two outer sections flat."""
    all_edges, inside, strips, length = [np.zeros(1)], [], [], 0.0
    for leaf, along in run:
        cuts = (0.0, *(leaf.profile.breaks if leaf.profile is not None else ()), 1.0)
        parts = [
            a + (b - a) * element_edges((b - a) * leaf.length, leaf.section.width)[1:]
            for a, b in pairwise(cuts)
        ]
        edges = np.concatenate([[0.0], *parts])
        inside.append(edges)
        strip = _strips(leaf, edges)
        if not along:
            edges, strip = 1.0 - edges[::-1], Strips(*(values[::-1, ::-1] for values in strip))
        strips.append(strip)
        all_edges.append(length + leaf.length * edges[1:])
        length += leaf.length
    whole = Strips(*(np.concatenate(parts) for parts in zip(*strips, strict=True)))
    curling, uneven = curl_along(np.concatenate(all_edges), whole, held)
    values = np.array([*curling, uneven.place, *uneven.constant, *uneven.linear])
    found, first = [], 0
    for (_, along), edges in zip(run, inside, strict=True):
        own = values[:, first : first + len(edges) - 1]
        first += len(edges) - 1
        rows = own if along else own[:, ::-1, ::-1]
        curls, unevens = (tuple(part.ravel().tolist()) for part in np.split(rows, [len(curling)]))
        found.append(PlateStiffening(tuple(edges.tolist()), curls, uneven=unevens))
    return tuple(found)


_cached_stiffening = lru_cache(maxsize=512)(_stiffening)


def _strips(leaf: Any, edges: np.ndarray) -> Strips:
    """The leaf at the Gauss points of its elements."""
    s = edges[:-1, None] + np.diff(edges)[:, None] * element_points()[0]
    section = leaf.section if leaf.profile is None else leaf.profile.sections(s.ravel())
    width, thickness, Iz = (
        np.broadcast_to(getattr(section, name), s.size).reshape(s.shape)
        for name in ("width", "thickness", "Iz")
    )
    own = np.zeros(s.size) if leaf.curve is None else leaf.curve.curvatures(s.ravel())[:, 2]
    nu = np.where(width > thickness, leaf.material.nu, 0.0)
    return Strips(width, thickness, nu, leaf.material.E * Iz, own.reshape(s.shape))
