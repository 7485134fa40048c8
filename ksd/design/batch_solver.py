"""Many designs in threads: those of equal words are packed together, and solved one after the other in one storage.

What is done in Python is done step by step, each of all designs before the next: a tenth faster, as its code is then in the
cache of the processor.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ksd.bodies.joints import check_proportions, joint_bodies_of_design, joint_layout
from ksd.bodies.mobility import check_mobility
from ksd.design.arguments import submit_task
from ksd.design.design_scene import build_scene
from ksd.design.prepared_design import DesignResult, PreparedDesign, answer_deferred
from ksd.errors import KsdError
from ksd.library import Record, find_record
from ksd.model.compile import model_of_design
from ksd.model.effects import EffectChoice, apply_effects, choose_effects
from ksd.model.mesh import DEFAULT_MESH, Mesh
from ksd.model.scene_layout import SplitScene, split_scene
from ksd.model.template import Template, template_of
from ksd.scene import Scene
from ksd.solve.five_step_solver import FiveStepSolver

S = TypeVar("S")
T = TypeVar("T")
SceneFactory = Callable[[], Scene]
CHUNK = 64
"""Designs whose numbers are computed together."""


class _Design(NamedTuple):
    """A design as it was described, which effects are simulated, the scene with them, drawing, its template, and shape
    parameters of its different joints."""

    said: Scene
    choice: EffectChoice
    scene: Scene
    drawing: SplitScene
    template: Template
    shapes: list[Mapping[str, float]]


def _each(step: Callable[[S], T], numbered: Iterable[tuple[int, S]], found: list[Any]) -> list[tuple[int, T]]:
    """What `step` makes of everything numbered; `found` takes the KsdErrors of what it stops at."""
    made = []
    for number, item in numbered:
        try:
            made.append((number, step(item)))
        except KsdError as reason:
            found[number] = reason
    return made


class BatchSolver:
    """Solves designs at drive values.

    options: keyword arguments of `PreparedDesign`; mesh: `DEFAULT_MESH` when None.
    """

    def __init__(
        self,
        values: Mapping[str, np.ndarray],
        options: Mapping[str, Any],
        mesh: Mesh | None,
        extrapolate: bool,
    ) -> None:
        self.values, self.options, self.mesh, self.extrapolate = (
            values,
            options,
            mesh or DEFAULT_MESH,
            extrapolate,
        )
        self._own = threading.local()
        self._records: dict[str, Record] = {}

    def solve(self, makers: Sequence[SceneFactory], threads: int) -> list[Any]:
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
        said = (mechanism, self.values, self.options, self.mesh, self.extrapolate)
        return run_in_blocks(executor, designs, CHUNK, _elsewhere, said)

    def _chunk(self, makers: Sequence[SceneFactory]) -> list[Any]:
        """Some designs in one thread."""
        found: list[Any] = [None] * len(makers)
        scenes = _each(lambda maker: maker(), enumerate(makers), found)
        alike: dict[Template, list[tuple[int, _Design]]] = {}
        for number, design in _each(self._drawn, scenes, found):
            alike.setdefault(design.template, []).append((number, design))
        for template, designs in alike.items():
            self._solve_alike(template, designs, found)
        return found

    def _drawn(self, said: Scene) -> _Design:
        """A scene with its effects, drawn."""
        choice = choose_effects(said, self.mesh)
        scene, mesh = apply_effects(said, self.mesh, choice)
        drawing = split_scene(scene, mesh)
        return _Design(said, choice, scene, drawing, template_of(drawing.layout, mesh), self._shapes(drawing))

    def _shapes(self, drawing: SplitScene) -> list[Mapping[str, float]]:
        """Shape parameters of the different joints; RangeError outside their trained ranges, RecordError for a joint drawn
        otherwise than that of its record."""
        found = []
        for joint in drawing.joints:
            record = self._record(joint.family)
            check_proportions(joint, record)
            found.append(joint.shape())
            record.places(found[-1], extrapolate=self.extrapolate)
        return found

    def _record(self, family: str) -> Record:
        """The record of a joint family, looked for once."""
        if family not in self._records:
            self._records[family] = find_record(family)
        return self._records[family]

    def _solve_alike(self, template: Template, numbered: list[tuple[int, _Design]], found: list[Any]) -> None:
        """Designs of one template: their numbers together, then one after the other."""
        designs = [one for _, one in numbered]
        try:
            layout = joint_layout(template, designs[0].drawing.joints, self._record)
        except KsdError as reason:
            for number, _ in numbered:
                found[number] = reason
            return
        numbers = template.numbers([one.drawing.numbers for one in designs])
        filled = template(numbers)
        shapes = list(zip(*(one.shapes for one in designs), strict=True))
        together = layout(numbers, filled, shapes, extrapolate=self.extrapolate)
        models = [
            model_of_design(one.scene, template, filled, numbers, d, said=one.said, choice=one.choice)
            for d, one in enumerate(designs)
        ]
        bodies = [joint_bodies_of_design(layout, together, d) for d in range(len(designs))]
        places = [(number, d) for d, (number, _) in enumerate(numbered)]
        fits = _each(lambda d: (d, check_mobility(models[d], bodies[d])), places, found)
        mine = self._own.__dict__
        storage = mine["storage"] if mine.get("layout") is layout else None
        for number, (d, fit) in fits:
            try:
                five = FiveStepSolver(
                    models[d], bodies[d], extrapolate=self.extrapolate, storage=storage, fit=fit
                )
                storage = five.storage
                found[number] = PreparedDesign(five, **self.options)(self.values)
            except KsdError as reason:
                found[number] = reason
        mine.update(layout=layout, storage=storage)
        if self.options.get("questions") is not None:
            good = [found[number] for number, _ in fits if isinstance(found[number], DesignResult)]
            answer_deferred(good, self.options["questions"])


def run_in_blocks(
    executor: Any,
    designs: Sequence[Mapping[str, Any]],
    least: int,
    function: Callable[..., list[Any]],
    *said: Any,
) -> list[Any]:
    """What function(*said, block) finds of every design, in blocks of at least so many for the workers of an executor."""
    workers = int(getattr(executor, "_max_workers", None) or os.cpu_count() or 1)
    size = max(least, -(-len(designs) // (2 * workers)))
    parts = [list(designs[k : k + size]) for k in range(0, len(designs), size)]
    waiting = [submit_task(executor, function, *said, part) for part in parts]
    return [found for job in waiting for found in job.result()]


def scene_factories(mechanism: Any, designs: Sequence[Mapping[str, Any]]) -> list[SceneFactory]:
    """What makes each design."""
    return [lambda d=d: build_scene(mechanism, d) for d in designs]  # type: ignore[misc]


def _elsewhere(said: tuple[Any, ...], designs: list[Mapping[str, Any]]) -> list[Any]:
    """Some designs in a worker of an executor."""
    mechanism, *words = said
    return BatchSolver(*words).solve(scene_factories(mechanism, designs), 1)
