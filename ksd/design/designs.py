"""Many designs in threads: the first of a kind is prepared, those like it are refilled into its storage."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from ksd.design.plan import scene_of
from ksd.design.prepared import Prepared
from ksd.design.refill import Drawing, Refill, drawing
from ksd.errors import KsdError
from ksd.model.mesh import Mesh
from ksd.scene import Scene
from ksd.solve.solver import Solver

Maker = Callable[[], Scene]
CHUNK = 64
"""Designs whose numbers are computed together."""
ALIKE = 3
"""Designs of one topology from which on refilling is worth its preparation."""


class Designs:
    """Solves designs at drive values; ways: method, passes, tabulated (`Prepared`), more: words of `Solver`."""

    def __init__(
        self, values: Mapping[str, np.ndarray], ways: Mapping[str, Any], more: Mapping[str, Any]
    ) -> None:
        self.values, self.ways, self.more = values, ways, more
        self.mesh: Mesh = more["mesh"] or Mesh()
        self._own = threading.local()

    def solve(self, makers: Sequence[Maker], threads: int) -> list[Any]:
        """What was found of every design, or the KsdError that stopped it."""
        # the first one alone, so that kernels are compiled once
        found = self._chunk(makers[:1])
        size = max(1, min(CHUNK, -(-len(makers) // (4 * threads))))
        chunks = [makers[k : k + size] for k in range(1, len(makers), size)]
        with ThreadPoolExecutor(threads) as pool:
            for part in pool.map(self._chunk, chunks):
                found += part
        return found

    def solve_in(self, executor: Any, mechanism: Any, designs: Sequence[Mapping[str, Any]]) -> list[Any]:
        """As `solve`, in the workers of a concurrent.futures executor; `mechanism` must be known there by name."""
        workers = int(getattr(executor, "_max_workers", None) or os.cpu_count() or 1)
        size = max(CHUNK, -(-len(designs) // (2 * workers)))
        parts = [designs[k : k + size] for k in range(0, len(designs), size)]
        said = (mechanism, self.values, self.ways, self.more)
        waiting = [executor.submit(_elsewhere, said, list(part)) for part in parts]
        return [found for job in waiting for found in job.result()]

    def _chunk(self, makers: Sequence[Maker]) -> list[Any]:
        """Some designs in one thread: those alike by refilling, the others one by one."""
        scenes: list[Any] = []
        for maker in makers:
            try:
                scenes.append(maker())
            except KsdError as reason:
                scenes.append(reason)
        found: list[Any] = [s if isinstance(s, KsdError) else None for s in scenes]
        for key, group in self._alike(scenes).items():
            self._refilled(key, group, scenes, found)
        for d, scene in enumerate(scenes):
            if found[d] is None:
                found[d] = self._fresh(scene)
        return found

    def _fresh(self, scene: Any) -> Any:
        try:
            return Prepared(Solver(scene, **self.more), **self.ways)(self.values)
        except KsdError as reason:
            return reason

    def _alike(self, scenes: Sequence[Any]) -> dict[tuple[Any, ...], list[tuple[int, Drawing]]]:
        """Groups of (design, drawing) of equal topology."""
        groups: dict[tuple[Any, ...], list[tuple[int, Drawing]]] = {}
        if self.ways["tabulated"] or not isinstance(self.mesh, Mesh):
            return groups
        for d, scene in enumerate(scenes):
            drawn = drawing(scene) if hasattr(scene, "fingerprint") else None
            if drawn is not None:
                groups.setdefault(drawn.words, []).append((d, drawn))
        return groups

    def _refilled(
        self, key: tuple[Any, ...], group: list[tuple[int, Drawing]], scenes: Sequence[Any], found: list[Any]
    ) -> None:
        """Solve those of a group that fit the storage of the first of their kind; leaves the others None."""
        kept: dict[Any, tuple[Prepared, Refill] | None] = self._own.__dict__
        if key not in kept:
            if len(group) < ALIKE:
                return
            kept[key] = self._storage(scenes[group[0][0]], group[0][1])
        storage = kept[key]
        if storage is None:
            return
        prepared, refill = storage
        ready = refill.ready([drawn for _, drawn in group])
        targets = prepared.targets(self.values)
        for k, (d, _) in enumerate(group):
            if ready.fits[k]:
                try:
                    if refill.put(ready, k):
                        found[d] = prepared.solved(targets, ready.motion_scale[k])
                except KsdError as reason:
                    found[d] = reason

    def _storage(self, scene: Any, drawn: Drawing) -> tuple[Prepared, Refill] | None:
        """A prepared design and how others get into its storage; None where they cannot."""
        try:
            prepared = Prepared(Solver(scene, **self.more), **self.ways)
            prepared.targets(self.values)
        except KsdError:
            return None
        refill = Refill(prepared.five, drawn)
        return (prepared, refill) if refill.works else None


def makers_of(mechanism: Any, designs: Sequence[Mapping[str, Any]]) -> list[Maker]:
    """What makes each design."""
    return [lambda d=d: scene_of(mechanism, d) for d in designs]  # type: ignore[misc]


def _elsewhere(said: tuple[Any, ...], designs: list[Mapping[str, Any]]) -> list[Any]:
    """Some designs in a worker of an executor."""
    mechanism, *words = said
    return Designs(*words).solve(makers_of(mechanism, designs), 1)
