"""Solution of many designs in threads or worker processes.

Designs whose scenes differ in numbers only share a template: their numbers are computed together, and they are solved one
after the other in one storage. Each step written in Python is done for all designs before the next step: 10 % faster, as
its code then stays in the cache of the processor. Designs with stops, cables or contacts have a prepared solver each, or
one together where only these differ (`ksd.study.contact_designs`).
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ksd.errors import KsdError, SceneError
from ksd.joints.joints import joint_bodies_of_design, joint_layout
from ksd.joints.mobility import check_mobility
from ksd.joints.record_match import check_proportions
from ksd.library import Record, find_record
from ksd.model.chosen_effects import EffectChoice, apply_effects, choose_effects
from ksd.model.compile import model_of_design
from ksd.model.mesh import DEFAULT_MESH, Mesh
from ksd.model.scene_layout import SplitScene, split_scene
from ksd.model.template import Template, template_of
from ksd.scene import Scene
from ksd.scene.obstacle import has_contacts
from ksd.solvers.five_step_solver import FiveStepSolver
from ksd.study.arguments import submit_task
from ksd.study.contact_designs import solve_design, solver_of_design
from ksd.study.design_scene import build_scene
from ksd.study.prepared_design import DesignResult, PreparedDesign, answer_deferred

S = TypeVar("S")
T = TypeVar("T")
SceneFactory = Callable[[], Scene]
CHUNK = 64
"""Designs whose numbers are computed together."""


class _Design(NamedTuple):
    """A design: the scene as described, the effects that are simulated, the scene with them and its split into layout and
    numbers, the template, and the shape parameters of its different joints."""

    described: Scene
    choice: EffectChoice
    scene: Scene
    split: SplitScene
    template: Template
    shapes: list[Mapping[str, float]]


def _apply_to_each(
    function: Callable[[S], T], numbered: Iterable[tuple[int, S]], results: list[Any]
) -> list[tuple[int, T]]:
    """Numbered values of `function` at numbered items; a KsdError it raises goes into `results` instead."""
    values = []
    for number, item in numbered:
        try:
            values.append((number, function(item)))
        except KsdError as reason:
            results[number] = reason
    return values


class BatchSolver:
    """Solves designs at arrays of drive values [m or rad] by drive name.

    options: keyword arguments of `PreparedDesign`; mesh: `DEFAULT_MESH` when None.
    """

    def __init__(
        self,
        values: Mapping[str, np.ndarray],
        options: Mapping[str, Any],
        mesh: Mesh | None,
        extrapolate: bool,
    ) -> None:
        self.values, self.options = values, options
        self.mesh, self.extrapolate = mesh or DEFAULT_MESH, extrapolate
        self._thread_local = threading.local()
        self._records: dict[str, Record] = {}

    def solve(self, factories: Sequence[SceneFactory], threads: int) -> list[Any]:
        """Results of every design: a `DesignResult`, or the KsdError that prevented it."""
        # the first one alone, so that kernels are compiled once
        results = self._solve_chunk(factories[:1])
        size = max(1, min(CHUNK, -(-len(factories) // (4 * threads))))
        chunks = [factories[k : k + size] for k in range(1, len(factories), size)]
        with ThreadPoolExecutor(threads) as pool:
            for part in pool.map(self._solve_chunk, chunks):
                results += part
        return results

    def solve_in(self, executor: Any, mechanism: Any, designs: Sequence[Mapping[str, Any]]) -> list[Any]:
        """As `solve`, in the workers of a concurrent.futures executor; worker processes must be able to import
        `mechanism`."""
        arguments = (self.values, self.options, self.mesh, self.extrapolate)
        return run_in_blocks(executor, designs, CHUNK, _solve_in_worker, mechanism, arguments)

    def _solve_chunk(self, factories: Sequence[SceneFactory]) -> list[Any]:
        """Results of some designs, in one thread."""
        results: list[Any] = [None] * len(factories)
        scenes = _apply_to_each(lambda factory: factory(), enumerate(factories), results)
        groups: dict[Template, list[tuple[int, _Design]]] = {}
        for number, result in _apply_to_each(
            self._solve_with_contacts, [(n, s) for n, s in scenes if has_contacts(s)], results
        ):
            results[number] = result
        scenes = [(n, s) for n, s in scenes if not has_contacts(s)]
        for number, design in _apply_to_each(self._design, scenes, results):
            groups.setdefault(design.template, []).append((number, design))
        for template, designs in groups.items():
            self._solve_group(template, designs, results)
        return results

    def _solve_with_contacts(self, scene: Scene) -> DesignResult:
        """Results of a design with stops, cables or contacts. Raises KsdError where it cannot be prepared."""
        own, options = self._thread_local.__dict__, dict(self.options)
        if options.pop("tabulated", False):
            raise SceneError("tabulated = True: tables know no stops, cables and contacts; leave it out.")
        words = {"mesh": self.mesh, "extrapolate": self.extrapolate}
        solver = own["solver"] = solver_of_design(scene, own.pop("solver", None), words)
        return solve_design(solver, self.values, **options)

    def _design(self, described: Scene) -> _Design:
        """A design from its scene. Raises RecordError and RangeError of its joints."""
        choice = choose_effects(described, self.mesh)
        scene, mesh = apply_effects(described, self.mesh, choice)
        split = split_scene(scene, mesh)
        return _Design(described, choice, scene, split, template_of(split.layout, mesh), self._shapes(split))

    def _shapes(self, split: SplitScene) -> list[Mapping[str, float]]:
        """Shape parameters of the different joints.

        Raises RangeError outside their trained ranges, RecordError for a joint of other proportions than its record.
        """
        shapes = []
        for joint in split.joints:
            record = self._record(joint.family)
            check_proportions(joint, record)
            shapes.append(joint.shape())
            record.places(shapes[-1], extrapolate=self.extrapolate)
        return shapes

    def _record(self, family: str) -> Record:
        """The record of a joint family, cached."""
        if family not in self._records:
            self._records[family] = find_record(family)
        return self._records[family]

    def _solve_group(
        self, template: Template, numbered: list[tuple[int, _Design]], results: list[Any]
    ) -> None:
        """Solve numbered designs of one template into `results`."""
        designs = [design for _, design in numbered]
        try:
            layout = joint_layout(template, designs[0].split.joints, self._record)
        except KsdError as reason:
            for number, _ in numbered:
                results[number] = reason
            return
        numbers = template.numbers([design.split.numbers for design in designs])
        filled = template(numbers)
        shapes = list(zip(*(design.shapes for design in designs), strict=True))
        all_bodies = layout(numbers, filled, shapes, extrapolate=self.extrapolate)
        models = [
            model_of_design(
                design.scene,
                template,
                filled,
                numbers,
                d,
                original_scene=design.described,
                choice=design.choice,
            )
            for d, design in enumerate(designs)
        ]
        bodies = [joint_bodies_of_design(layout, all_bodies, d) for d in range(len(designs))]
        indices = [(number, d) for d, (number, _) in enumerate(numbered)]
        mobile = _apply_to_each(lambda d: (d, check_mobility(models[d], bodies[d])), indices, results)
        own = self._thread_local.__dict__
        storage = own["storage"] if own.get("layout") is layout else None
        for number, (d, fit) in mobile:
            try:
                solver = FiveStepSolver(
                    models[d], bodies[d], extrapolate=self.extrapolate, storage=storage, compatibility=fit
                )
                storage = solver.storage
                results[number] = PreparedDesign(solver, **self.options)(self.values)
            except KsdError as reason:
                results[number] = reason
        own.update(layout=layout, storage=storage)
        if self.options.get("questions") is not None:
            solved = [results[number] for number, _ in mobile if isinstance(results[number], DesignResult)]
            answer_deferred(solved, self.options["questions"])


def run_in_blocks(
    executor: Any,
    designs: Sequence[Mapping[str, Any]],
    min_size: int,
    function: Callable[..., list[Any]],
    *arguments: Any,
) -> list[Any]:
    """Values of function(*arguments, block) for all designs, in blocks of at least `min_size` for the workers of an
    executor."""
    workers = int(getattr(executor, "_max_workers", None) or os.cpu_count() or 1)
    size = max(min_size, -(-len(designs) // (2 * workers)))
    blocks = [list(designs[k : k + size]) for k in range(0, len(designs), size)]
    futures = [submit_task(executor, function, *arguments, block) for block in blocks]
    return [value for future in futures for value in future.result()]


def scene_factories(mechanism: Any, designs: Sequence[Mapping[str, Any]]) -> list[SceneFactory]:
    """Functions without arguments that return the scene of each design."""
    return [lambda d=d: build_scene(mechanism, d) for d in designs]  # type: ignore[misc]


def _solve_in_worker(
    mechanism: Any, arguments: tuple[Any, ...], designs: list[Mapping[str, Any]]
) -> list[Any]:
    """Results of some designs in a worker of an executor; arguments: of `BatchSolver`."""
    return BatchSolver(*arguments).solve(scene_factories(mechanism, designs), 1)
