"""A mechanism prepared for repeated solves, by any method, choosing the cheapest that meets the accuracy asked for."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from inspect import signature
from typing import Any, Literal

import numpy as np

from ksd.bodies.joints import JointBodies, joint_bodies
from ksd.errors import ConvergenceError, KinematicsError, KsdError, RangeError, RecordError, SceneError
from ksd.library import Record, find_record
from ksd.modal.choices import ModalBasis
from ksd.modal.solid_body import SolidBasis
from ksd.model.arrays import carries_load
from ksd.model.compile import Model, compile_scene
from ksd.model.mesh import Mesh
from ksd.model.plane import Plane, plane_of
from ksd.scene.contents import Scene
from ksd.scene.mechanism import Mechanism
from ksd.section.checks import nearest, number, show, truth, whole
from ksd.solve import pipeline
from ksd.solve.configuration import Configuration, with_reading
from ksd.solve.conventional import bare, by_load_steps, conventional
from ksd.solve.five import FiveSteps
from ksd.solve.pipeline import Bench
from ksd.solve.plates import settled
from ksd.solve.storage import Storage
from ksd.solve.verdict import (
    error_by_load_steps,
    insist,
    load_step_check,
    mesh_check,
    needs_load_step_check,
    solved,
)

Basis = ModalBasis | Mapping[str, ModalBasis | SolidBasis]
"""The basis of modal bodies: one for all leafs, or several by the name of a joint, leaf or solid."""
Method = Literal["kinematic", "reduced", "full", "conventional", "modal"]
METHODS = ("kinematic", "reduced", "full", "conventional", "modal")
DEFAULT_ACCURACY = 1e-3


class Solver:
    """A mechanism prepared for repeated solves: compiled model, joint bodies, and storage used again each time.

    Options as in `ksd.prepare`; records: who finds the record of a joint family by its name. A compiled `Model` has its mesh
    and effects already: mesh, effects, with_, without, accuracy and targets are for what is compiled here.
    Call it with drive values by name: ``solver(top=0.3)``. Threads that share one take turns, since all solves write into
    the same storage; to solve in parallel make one for each.
    """

    def __init__(
        self,
        mechanism: Mechanism | Scene | Model,
        *,
        mesh: Mesh | None = None,
        records: Callable[[str], Record] = find_record,
        extrapolate: bool = False,
        planar: bool = True,
        basis: Basis | None = None,
        effects: str | Iterable[str] = "auto",
        with_: str | Iterable[str] = (),
        without: str | Iterable[str] = (),
        accuracy: float | None = None,
    ) -> None:
        if not isinstance(mechanism, Model):
            mechanism = compile_scene(mechanism, mesh=mesh, effects=effects, with_=with_, without=without)
        self.model: Model = mechanism
        self.records, self.extrapolate, self.planar = records, extrapolate, truth(planar, "planar")
        self.basis, self.accuracy = basis, wanted_accuracy(accuracy)
        self.modal: Any = None  # prepared for `basis`
        self.mixed: Any = None  # the same beside condensed joints, where the bodies are solids
        self._five: FiveSteps | None = None
        self._storage: Storage | None = None
        self._plain: dict[tuple[Any, ...], float] = {}
        self._turn = threading.RLock()

    @property
    def five_steps(self) -> FiveSteps:
        """The five steps, prepared on first use. Raises RecordError, RangeError, KinematicsError, SceneError."""
        if self._five is None:
            if self.model.mesh.nodal:
                raise RecordError(
                    "mesh nodal=True makes every element a part of its own, which joints are not condensed from; use "
                    "method='conventional', or leave nodal out"
                )
            bodies: JointBodies = joint_bodies(self.model, self.records, extrapolate=self.extrapolate)
            self._five = FiveSteps(self.model, bodies, extrapolate=self.extrapolate)
        return self._five

    @property
    def bench(self) -> Bench:
        """Storage of the five steps in space; raises what `five_steps` does."""
        return self.five_steps.bench

    @property
    def in_plane(self) -> Literal["auto", False]:
        """Word `planar` of `conventional`: "auto", or never."""
        return "auto" if self.planar else False

    def __repr__(self) -> str:
        return f"<Solver of {self.model!r}>"

    @property
    def storage(self) -> Storage:
        """Storage of the conventional solver, prepared on first use."""
        if self._storage is None:
            self._storage = Storage(self.model)
        return self._storage

    def of(self, model: Model) -> Solver:
        """A solver of another model of the same scene, with the options of this one."""
        return type(self)(
            model, records=self.records, extrapolate=self.extrapolate, planar=self.planar, basis=self.basis,
            accuracy=self.accuracy,
        )  # fmt: skip

    def __call__(
        self,
        targets: Mapping[str, float] | None = None,
        *,
        method: Method | None = None,
        accuracy: float | None = None,
        passes: int = 0,
        estimate: bool = True,
        strict: bool = True,
        **drives: float,
    ) -> Configuration:
        """Solve at drive values given by name [m or rad]; see `ksd.solve` for the options.

        The mesh stays as prepared: where its curvature modes are few for the state a warning says so, and strictly a
        leaf that is not resolved at all is refused.
        """
        if not drives.keys() <= set(self.model.drive_names):
            refuse_unknown(drives, self.model.drive_names, self.__call__)
        values = drives if targets is None else asked_values(targets, drives)
        truth(strict, "strict")
        ways = method, accuracy, passes, estimate
        with self._turn:
            wanted = self._wanted(ways)
            if wanted > 0.0:
                found = self._plainly(values, method, passes=passes, estimate=estimate, accuracy=wanted)
            else:
                found = self.on_mesh(
                    values, method=method, accuracy=accuracy, passes=passes, estimate=estimate
                )
                wanted = self._or_own(accuracy)
                if self._is_plain(method):
                    self._plain[ways] = wanted
        found = mesh_check(found, wanted)
        return insist(found) if strict else found

    def _wanted(self, ways: tuple[Any, ...]) -> float:
        """The accuracy wanted in calls like these, where they were seen to be plain; else 0."""
        try:
            return self._plain.get(ways, 0.0)
        except TypeError:
            return 0.0

    def _or_own(self, accuracy: float | None) -> float:
        """The accuracy of one call, that of the solver where it says none."""
        return self.accuracy if accuracy is None else wanted_accuracy(accuracy)

    def _is_plain(self, method: str | None) -> bool:
        """Whether calls like this one need nothing of what `on_mesh` does around a solve: plates, solids, load steps
        beside the answer."""
        model = self.model
        return (
            not model.mesh.plate
            and method != "modal"
            and self._with_solids(method) is None
            and not carries_load(model.arrays)
        )

    def _plainly(
        self, values: Mapping[str, float], method: str | None, *, passes: int, estimate: bool, accuracy: float
    ) -> Configuration:
        """What `on_mesh` comes to where nothing else is called for."""
        if method == "conventional":
            return self._told(conventional(self.model, values, storage=self.storage, planar=self.in_plane))
        target = self.model.targets(values)
        if method is None:
            return self._cheapest(values, target, accuracy)
        return self.five_steps(values, target, method=method, passes=passes, estimate=estimate)

    def on_mesh(
        self,
        values: Mapping[str, float],
        *,
        method: str | None = None,
        accuracy: float | None = None,
        passes: int = 0,
        estimate: bool = True,
    ) -> Configuration:
        """The answer as it is, whether the mesh resolves it or not, trusted or not."""
        with self._turn:
            return self._on_mesh(values, method=method, accuracy=accuracy, passes=passes, estimate=estimate)

    def _on_mesh(
        self,
        values: Mapping[str, float],
        *,
        method: str | None,
        accuracy: float | None,
        passes: int,
        estimate: bool,
    ) -> Configuration:
        ways: dict[str, Any] = {
            "method": method,
            "accuracy": accuracy,
            "passes": passes,
            "estimate": estimate,
        }
        solids = self._with_solids(method)
        if solids is not None:
            from ksd.solve.solids import by_solids

            return by_solids(solids, values, method=method, estimate=estimate, passes=passes, solver=self)
        bound = 0.1 * self._or_own(accuracy)
        found, used = settled(self, lambda solver: solver._solve(values, **ways), bound)
        if method is not None and needs_load_step_check(found):
            against, other = load_step_check(found, lambda: used._by_load_steps(values))
            doubts = (*found.doubts, *filter(None, [against]))
            found = with_changes(found, doubts=doubts, method_error=error_by_load_steps(found, other))
        return found

    def _with_solids(self, method: str | None) -> Any:
        """The model with its reduced solids, None where there are none."""
        if hasattr(self.model, "solids"):
            return self.model
        if not isinstance(self.basis, Mapping) or method not in (None, "modal"):
            return None
        from ksd.solve.solids import holds_solids, solid_model

        if holds_solids(self.basis) and self.modal is None:
            self.modal = solid_model(self.model, self.basis)
        return self.modal if hasattr(self.modal, "solids") else None

    def _solve(
        self,
        values: Mapping[str, float],
        *,
        method: str | None,
        accuracy: float | None,
        passes: int,
        estimate: bool,
    ) -> Configuration:
        target = self.model.targets(values)
        if method is None:
            return self._cheapest(values, target, self._or_own(accuracy))
        if not isinstance(method, str) or method not in METHODS:
            raise SceneError(f"method = {show(method)}: choose one of {', '.join(METHODS)}")
        if method == "conventional":
            return self._by_load_steps(values)
        if whole(passes, "passes", least=0) > 50:
            raise SceneError(f"passes = {passes}: between 0 and 50 relinearised passes are possible")
        if method == "modal":
            from ksd.solve.modal import by_modal_bodies

            return by_modal_bodies(self, values, estimate=estimate, passes=passes)
        return self.five_steps(values, target, method=method, passes=passes, estimate=estimate)

    def _cheapest(self, values: Mapping[str, float], target: np.ndarray, accuracy: float) -> Configuration:
        """The first that meets `accuracy`, in the order of measured cost.

        In the plane that is the conventional solver with three unknowns per node, if it gets there in one step; in
        space reduced, reduced with a pass, full, and the conventional solver last.
        """
        try:
            if self.planar and isinstance(plane_of(self.model), Plane):
                found = conventional(
                    self.model, values, planar=True, most=10, smallest=1.0, storage=self.storage
                )
                if found.stable and not found.doubts:
                    return self._told(found)
        except (ConvergenceError, SceneError):
            # not in one step, or not in this plane after all: the kinematic start is what helps
            pass
        try:
            for passes in range(2):
                result = self.five_steps(values, target, method="reduced", passes=passes, estimate=True)
                own = result.method_error
                if own is not None and own.relative <= accuracy and solved(result):
                    return self._beside(with_changes(result, chosen=True), values)
            found = self.five_steps(values, target, method="full", passes=1, estimate=False)
            verdict = solved(found)
            if verdict:
                return self._beside(found, values)
            raise ConvergenceError(str(verdict))
        except (RecordError, KinematicsError, ConvergenceError, RangeError) as reason:
            if isinstance(reason, KinematicsError) and "same freedom" in str(reason):
                raise
            return self._load_steps(values, f"conventional solver used: {reason}")
        except SceneError:
            if self.model.scene.joints:
                raise
            return self._load_steps(values, "")

    def _beside(self, found: Configuration, values: Mapping[str, float]) -> Configuration:
        """An answer of the five steps, or that of load steps where loads are large and it is another."""
        if not needs_load_step_check(found):
            return found
        against, other = load_step_check(found, lambda: self._by_load_steps(values))
        if not against:
            return found
        if other is None:
            return with_changes(found, doubts=(*found.doubts, against))
        return with_changes(
            other, notes=(*other.notes, f"load steps used: the five steps led elsewhere: {against}")
        )

    def _by_load_steps(self, values: Mapping[str, float]) -> Configuration:
        """The conventional solver, in the fixed order of its ways."""

        def unloaded() -> Configuration:
            model = bare(self.model)
            bodies = joint_bodies(model, self.records, extrapolate=self.extrapolate)
            five = FiveSteps(model, bodies, extrapolate=self.extrapolate)
            return five(values, model.targets(values), method="full", passes=0, estimate=False)

        # the storage of leafs with weight is another one
        light = self.model.scene.joints and not len(self.model.arrays.weight)
        kinematic = unloaded if light else None
        return by_load_steps(
            self.model, values, self._told, storage=self.storage, kinematic=kinematic, planar=self.in_plane
        )

    def _load_steps(self, values: Mapping[str, float], note: str) -> Configuration:
        """The conventional solver in all its ways."""
        result = self._by_load_steps(values)
        return with_changes(result, notes=(*result.notes, note)) if note else result

    def _told(self, result: Configuration) -> Configuration:
        """A conventional result with the joints' intended and unintended motions, where their records are there."""
        try:
            reading, unknown = pipeline.joint_motions(self.bench, result.motion)
        except KsdError:
            return result
        return with_reading(result, reading, unknown, near=bool(self.bench.seen[1]))


def asked_values(targets: Any, drives: Mapping[str, float]) -> dict[str, float]:
    """Drive values by name, from a mapping and from words; SceneError for what is no mapping."""
    if targets is not None and not isinstance(targets, Mapping):
        raise SceneError(
            f"targets = {show(targets)}: give drive values by name, for example top=0.1 or {{'top': 0.1}}"
        )
    return {**(targets or {}), **drives} if drives else dict(targets or {})


def refuse_unknown(given: Iterable[str], drives: Iterable[str], call: Callable[..., Any]) -> None:
    """Raise SceneError for the first word `given` that is neither a drive nor an option of `call`, with the nearest ones."""
    known = tuple(drives)
    if set(given) <= set(known):
        return
    options = [n for n, p in signature(call).parameters.items() if p.kind is p.KEYWORD_ONLY]
    for name in given:
        if name not in known:
            raise SceneError(
                f"drive '{name}' is not in this mechanism; its drives are: {', '.join(known) or 'none'}; nor is it an "
                f"option{nearest(name, (*known, *options))}"
            )


def with_changes(result: Configuration, **changes: Any) -> Configuration:
    """The same configuration with these fields changed."""
    from dataclasses import replace

    return replace(result, **changes)


def wanted_accuracy(value: float | None) -> float:
    """The relative accuracy asked for, DEFAULT_ACCURACY where none is. Raises SceneError for what is none."""
    accuracy = DEFAULT_ACCURACY if value is None else number(value, "accuracy")
    if not 0.0 < accuracy < 1.0:
        raise SceneError(f"accuracy = {value}: give a relative error between 0 and 1, for example 1e-3")
    return accuracy
