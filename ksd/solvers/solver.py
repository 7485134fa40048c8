"""`solve` and `prepare`: one call for all methods, which chooses the fastest that meets the requested accuracy."""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import cached_property
from inspect import signature
from typing import Any, Literal, NamedTuple

from numpy.typing import ArrayLike

from ksd.checks import boolean, clear_argument_errors, name_hint, number, show, whole_number
from ksd.errors import ConvergenceError, KinematicsError, RangeError, RecordError, SceneError
from ksd.joints.joints import joint_bodies
from ksd.library import Record, find_record
from ksd.library.record_files import find_record_file
from ksd.modal.choices import ModalBasis
from ksd.modal.solid_basis import SolidBasis
from ksd.model.compile import Model, compile_scene
from ksd.model.constant_leaves import with_constant_leaves
from ksd.model.mesh import DEFAULT_MESH, Mesh
from ksd.model.orders import mesh_for_accuracy, raise_order
from ksd.model.plane import Plane
from ksd.numerics.stopwatch import Stopwatch
from ksd.scene.mechanism import Mechanism
from ksd.scene.obstacle import contact_drives, has_contacts, refuse_loose
from ksd.scene.scene import Scene
from ksd.solvers.actuation import Actuation, RequiredForces
from ksd.solvers.configuration import Configuration
from ksd.solvers.contact_solve import (
    MAX_ONE_STEP_ITERATIONS,
    act_at_once,
    exchange_contacts,
    solve_with_contact,
    split_values,
    without_contact_forces,
)
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.either_side import take_side
from ksd.solvers.five_step_solver import FiveStepSolver
from ksd.solvers.full_bodies import error_indicator
from ksd.solvers.joint_motions import JointMotionReader
from ksd.solvers.loading_order import Order, check_order, settle_order, solve_in_order
from ksd.solvers.method_choice import (
    FIVE_STEPS,
    LOAD_STEPS,
    ONE_STEP,
    TRIALS,
    MethodChoice,
)
from ksd.solvers.method_error import relative_error
from ksd.solvers.plate_stiffening import solve_with_secants
from ksd.solvers.precompile import start_precompiling
from ksd.solvers.reduced_solve import (
    ReducedBodySolver,
    has_solids,
    solve_bodies_by_load_steps,
    with_error_indicator,
    with_plane_check,
)
from ksd.solvers.steps import DEFAULT_ACCURACY
from ksd.solvers.storage import NewtonStorage
from ksd.solvers.verdict import (
    compare_with_load_steps,
    is_solved,
    needs_load_step_check,
    require_solved,
    solved_verdict,
    with_mesh_check,
)

Basis = ModalBasis | Mapping[str, ModalBasis | SolidBasis]
"""The basis of modal bodies: one for all leaf springs, or several by the name of a joint, leaf or solid."""
Method = Literal["kinematic", "reduced", "full", "conventional", "modal", "constant"]
METHODS = ("kinematic", "reduced", "full", "conventional", "modal", "constant")
MAX_REPEATED = 100
"""Iterations of a first solve up to which it is repeated to tell its times."""
_LOADED: set[tuple[str, frozenset[int], bool]] = set()
"""Methods and kinds of members by which this process has solved, so that their kernels are loaded."""
MAX_RISES = 5
"""How often `solve` raises the orders of strain-mode leaves whose highest modes are not negligible, at most."""
COMPILED_MODEL_MESSAGE = (
    "mesh and effects are chosen when a model is compiled: pass them to ksd.compile_scene"
)
MAX_SOLVERS = 16
"""Solvers that `solve` caches."""
_cached_solvers: OrderedDict[tuple[Any, ...], Solver] = OrderedDict()
_cache_lock = threading.Lock()


@clear_argument_errors
def prepare(
    mechanism: Mechanism | Scene | Model,
    *,
    mesh: Mesh | None = None,
    extrapolate: bool = False,
    effects: str | Iterable[str] = "auto",
    with_: str | Iterable[str] = (),
    without: str | Iterable[str] = (),
    accuracy: float | None = None,
    planar: bool = True,
    basis: Basis | None = None,
    order: Order = "loads",
) -> Solver:
    """A `Solver` of this mechanism for many solves: everything that does not depend on the drive values is done once.

    mesh: leaf model and its fineness (strain-mode leaves when None). extrapolate: use joint records beyond their trained
    range, with a warning in the result. effects, with_, without: what is simulated (see `ksd.model.chosen_effects`).
    accuracy: for solves without an accuracy of their own. planar: False solves in space, by every method, even where the
    scene stays in its plane. basis: for method "modal", order: of loads and drives, see `solve`. Raises SceneError for a
    scene that cannot be compiled.

    >>> guide, _, _ = ksd.load_scene("guide")
    >>> solver = ksd.prepare(guide)
    >>> [round(solver(table=x).forces["table"], 3) for x in (1 * mm, 2 * mm)]
    [1.0, 2.002]
    """
    return Solver(
        mechanism, mesh=mesh, extrapolate=extrapolate, planar=planar, basis=basis, effects=effects, with_=with_,
        without=without, accuracy=accuracy, order=order,
    )  # fmt: skip


@clear_argument_errors
def solve(
    mechanism: Mechanism | Scene | Model,
    targets: Mapping[str, float] | None = None,
    *,
    method: Method | None = None,
    accuracy: float | None = None,
    mesh: Mesh | None = None,
    relinearisations: int = 0,
    extrapolate: bool = False,
    strict: bool = True,
    effects: str | Iterable[str] = "auto",
    with_: str | Iterable[str] = (),
    without: str | Iterable[str] = (),
    basis: Basis | None = None,
    estimate: bool = True,
    planar: bool = True,
    order: Order = "loads",
    start: Configuration | None = None,
    side: float = 0.0,
    **drives: float,
) -> Configuration:
    """Solve one configuration of a mechanism at drive values [m or rad] by name, as keywords or in a mapping, `targets`.

    method: "kinematic", "reduced", "full", "conventional", "constant" (leaf springs of constant stiffness, that at rest:
    `ksd.model.constant_leaves`) or "modal" (leaf springs as modal bodies); when None, the fastest whose estimated error is
    within `accuracy` (relative, 1e-3 by default). relinearisations: relinearisation steps of "reduced". estimate: False
    leaves out the error estimate of a fast method, and its cost; that of "reduced" is a Newton step, which the answer then
    lacks. mesh: leaf model; when None, strain-mode leaves of orders
    that suit `accuracy`, raised when their highest modes carry too much energy. extrapolate, planar: see `prepare`. strict:
    raise TrustError where the result is unstable or on a doubtful branch; False returns it with its verdicts (`trust`).
    start: a pose of this mechanism, solved or loaded, from which load steps continue on its mesh; they count whole turns on,
    so that rotation drives may go beyond half a turn, at most half a turn from `start`.

    basis: of method "modal": a `ksd.ModalBasis` for all leaf springs, or several by joint or leaf, {"hinge":
    ksd.ModalBasis()}: then joints not named are condensed as in "reduced", and other leaf springs computed in full; or
    reduced solids by leaf, {"spring": reduce_solid(...)}, see `ksd.modal.solid_basis`: with method "modal" together with
    condensed joints, without a method together with leaf springs in full.

    effects: "auto" simulates what the scene mentions, "all" also all that a leaf can have, a list of names just these;
    with_="warping", without="shear" override single ones (`ksd.model.chosen_effects`; print(pose.model) lists what was
    simulated).

    order: what acts first where that decides the equilibrium, because leaf springs buckle on the way: "loads" (then the
    drives, as in a machine), "drives" (then the loads), or "together"; a warning says so where the ends differ. side: where
    the state is unstable, as one that is symmetric, 1 or -1 takes the stable one on a side of it, with 1 the one to
    which what moves most at the first bifurcation goes along its positive axis.

    Raises SceneError (bad input), RangeError (outside a trained range), RecordError (joint record missing or damaged),
    KinematicsError (indeterminate or over-driven), ConvergenceError (with the fraction reached).

    >>> guide, _, _ = ksd.load_scene("guide")
    >>> pose = ksd.solve(guide, table=5 * mm)
    >>> print(f"{pose.forces['table']:.3f} N by the {pose.method} method")
    5.036 N by the conventional method
    """
    values = given_values(targets, drives)
    for word, given in (
        ("extrapolate", extrapolate),
        ("strict", strict),
        ("estimate", estimate),
        ("planar", planar),
    ):
        boolean(given, word)
    options: dict[str, Any] = {
        "extrapolate": extrapolate, "effects": effects, "with_": with_, "without": without, "basis": basis,
        "planar": planar, "order": order,
    }  # fmt: skip
    if isinstance(mechanism, Model):
        refuse_unknown_drives(drives, mechanism.drive_names, solve)
        return Solver(mechanism, mesh=mesh, **options)(
            values,
            method=method,
            accuracy=accuracy,
            relinearisations=relinearisations,
            strict=strict,
            estimate=estimate,
            start=start,
        )
    scene = mechanism.scene() if hasattr(mechanism, "scene") else mechanism
    if hasattr(scene, "drives"):
        refuse_unknown_drives(drives, (*(d.name for d in scene.drives), *contact_drives(scene)), solve)
    wanted = DEFAULT_ACCURACY if accuracy is None else checked_accuracy(accuracy)
    if mesh is None and isinstance(start, Configuration):
        mesh = start.model.mesh
    grid = mesh if mesh is not None else (DEFAULT_MESH if accuracy is None else mesh_for_accuracy(wanted))
    how: dict[str, Any] = {"method": method, "relinearisations": relinearisations, "estimate": estimate}
    rises = MAX_RISES if mesh is None else 0
    found = solve_on_adequate_mesh(
        lambda grid: _cached_solver(scene, grid, options),
        grid,
        values,
        accuracy=wanted,
        rises=rises,
        start=start,
        **how,
    )
    if number(side, "side"):
        found = take_side(found, side)
    found = with_mesh_check(found, wanted)
    return require_solved(found) if strict else found


def solve_on_adequate_mesh(
    solver_of: Callable[[Mesh], Solver],
    mesh: Mesh,
    values: Mapping[str, float],
    *,
    accuracy: float,
    rises: int,
    start: Configuration | None = None,
    **how: Any,
) -> Configuration:
    """The result on `mesh`, or where its highest modes are not negligible on finer ones, `rises` times at most.

    solver_of: the solver of a mesh; how: options of `Solver.answer`.
    """  # fmt: skip
    for rise in range(rises + 1):
        solver = solver_of(mesh)
        found = solver.answer(values, accuracy=accuracy, start=start, **how)
        # verdicts only on the final mesh: on a coarse one a state may falsely seem unstable or on another branch
        if found.mesh_adequacy.missed_share <= accuracy or rise == rises:
            found = solver.settled(found, start)
        share, _, axis, _ = found.mesh_adequacy
        if share <= accuracy:
            break
        mesh = raise_order(mesh, axis)
    return found


class Asked(NamedTuple):
    """Drive values, and how to solve at them; see `ksd.solve`."""

    values: Mapping[str, float]
    method: str | None
    accuracy: float
    relinearisations: int
    estimate: bool
    start: Configuration | None


class Solver:
    """A mechanism prepared for repeated solves: compiled model, joint bodies, and storage that all solves reuse.

    Call it with drive values by name: ``solver(top=0.3)``. Options as in `ksd.prepare`; records: function that finds the
    record of a joint family by its name. A compiled `Model` has its mesh and effects already: SceneError where it is given
    with others. Threads that share a solver take turns, since all solves write into the same storage; make one for each
    thread to solve in parallel.

    >>> guide, _, _ = ksd.load_scene("guide")
    >>> solver = ksd.prepare(guide)
    >>> [round(solver(table=x).forces["table"], 3) for x in (1 * mm, 2 * mm)]
    [1.0, 2.002]
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
        order: Order = "loads",
    ) -> None:
        start_precompiling()
        if not isinstance(mechanism, Model):
            mechanism = compile_scene(
                mechanism, mesh=mesh, effects=effects, with_=with_, without=without, one_sided=True
            )  # fmt: skip
        elif mesh is not None or effects != "auto" or with_ or without:
            raise SceneError(COMPILED_MODEL_MESSAGE)
        self.model: Model = mechanism
        self.records, self.extrapolate, self.planar = records, extrapolate, boolean(planar, "planar")
        self.basis, self.accuracy, self.order = basis, checked_accuracy(accuracy), check_order(order)
        self._choice: MethodChoice | None = None
        self._drives = frozenset((*mechanism.drive_names, *contact_drives(mechanism.original_scene)))
        self._reduced: dict[bool, ReducedBodySolver] = {}
        self._free: dict[Any, Configuration] | None = None
        # whether a stop, cable or contact acted in the last pose: then it is likely to act again
        self._acted = False
        self.joint_motions = JointMotionReader(mechanism, records, extrapolate)
        self.lock = threading.RLock()

    @cached_property
    def five_steps(self) -> FiveStepSolver:
        """The five steps, prepared on first use. Raises RecordError, RangeError, KinematicsError, SceneError."""
        bodies = joint_bodies(self.model, self.records, extrapolate=self.extrapolate)
        return FiveStepSolver(self.model, bodies, extrapolate=self.extrapolate)

    @property
    def in_plane(self) -> Literal["auto", False]:
        """Option `planar` of `solve_conventional`: "auto", or False where all solves are in space."""
        return "auto" if self.planar else False

    def __repr__(self) -> str:
        return f"<Solver of {self.model!r}>"

    @cached_property
    def storage(self) -> NewtonStorage:
        """Storage of the conventional solver, prepared on first use."""
        return NewtonStorage(self.model)

    def exchange_contacts(self, scene: Scene) -> None:
        """Go over to a scene with other stops, cables and contacts, which is the same in all else."""
        before, self.model = self.model, replace(self.model, original_scene=scene)
        self.model.derived["plane"] = before.plane
        self._drives = frozenset((*self.model.drive_names, *contact_drives(scene)))
        for name in ("five_steps", "constant", "actuation"):
            self.__dict__.pop(name, None)
        self._reduced.clear()
        self._free = self._free or {}
        if "storage" in self.__dict__:
            exchange_contacts(self.storage, self.model)

    def of(self, model: Model) -> Solver:
        """A solver of another model of the same scene with the options of this one."""
        return type(self)(
            model, records=self.records, extrapolate=self.extrapolate, planar=self.planar, basis=self.basis,
            accuracy=self.accuracy, order=self.order,
        )  # fmt: skip

    def __call__(
        self,
        targets: Mapping[str, float] | None = None,
        *,
        method: Method | None = None,
        accuracy: float | None = None,
        relinearisations: int = 0,
        estimate: bool = True,
        strict: bool = True,
        start: Configuration | None = None,
        **drives: float,
    ) -> Configuration:
        """Solve at drive values given by name [m or rad]; see `ksd.solve` for the options.

        The mesh stays as prepared: the result has a warning where its curvature modes are few for the state, and raises
        TrustError, where `strict`, if a leaf is not resolved at all.
        """
        if not drives.keys() <= self._drives:
            refuse_unknown_drives(drives, sorted(self._drives), self.__call__)
        values = drives if targets is None else given_values(targets, drives)
        boolean(strict, "strict")
        wanted = self.accuracy if accuracy is None else checked_accuracy(accuracy)
        found = self.answer(
            values,
            method=method,
            accuracy=wanted,
            relinearisations=relinearisations,
            estimate=estimate,
            start=start,
        )
        found = with_mesh_check(self.settled(found, start), wanted)
        return require_solved(found) if strict else found

    def answer(
        self,
        values: Mapping[str, float],
        *,
        method: str | None,
        accuracy: float,
        relinearisations: int = 0,
        estimate: bool = True,
        start: Configuration | None = None,
    ) -> Configuration:
        """The result without checks of loading order, mesh and trust; options as in `ksd.solve`.

        A first solve also loads kernels, or compiles them, so it is repeated for its own times; the rest is
        `Configuration.kernel_time`.
        """
        asked = Asked(values, method, accuracy, relinearisations, estimate, start)
        with self.lock:
            clock = Stopwatch()
            found, first = self._answer(asked), clock()
            self._acted = found.touched is not None and found.touched.closed
            kind = self._kind(found)
            if kind not in _LOADED:
                _LOADED.add(kind)
                if found.iterations <= MAX_REPEATED:
                    found = self._answer(asked)
                    found = replace(found, kernel_time=max(first - clock(), 0.0))
            return found

    def _answer(self, asked: Asked) -> Configuration:
        method, start = asked.method, asked.start
        _check_method(method, asked.relinearisations)
        if not has_contacts(self.model.original_scene):
            return self._without_contacts(asked)
        drives, own = split_values(self.model, asked.values)
        free: Configuration | None = None
        reason: Exception | None = None
        at_once = (
            self._acted
            and start is None
            and method in (None, "conventional")
            and self._free is None
            and self._is_planar
            and not self._has_bodies()
            and act_at_once(self.model, drives, own, self.storage)
        )
        if not at_once and (start is None or start.touched is None or not start.touched.closed):
            try:
                found = self._free_pose(asked._replace(values=drives))
                free = without_contact_forces(found, own, self.storage)
                if free is not None and free.stable and not free.doubts:
                    return free
            except (ConvergenceError, KinematicsError) as error:
                reason = error
        if method not in (None, "conventional") or self._has_bodies():
            if free is not None:
                return free
            raise SceneError(
                f"method = {show(method)}: a stop or cable acts here, which only load steps on all leaf springs know; give "
                "no method, or 'conventional', and no reduced bodies."
            ) from reason
        try:
            held = solve_with_contact(
                self.model, drives, own, start=start, planar=self.planar, storage=self.storage
            )
        except ConvergenceError as error:
            if isinstance(error.result, Configuration):
                _refuse_loose(error.result)
            if free is None:
                raise
            return free
        closed = held.touched is not None and held.touched.closed
        found = held if free is None or closed or (held.stable and not free.stable) else free
        if not found.stable:
            _refuse_loose(found)
        return found

    def _free_pose(self, asked: Asked) -> Configuration:
        """`_without_contacts`, solved once for all contacts that are exchanged."""
        if self._free is None or asked.start is not None:
            return self._without_contacts(asked)
        key = (*asked.values.items(), *asked[1:])
        if key not in self._free:
            self._free[key] = self._without_contacts(asked)
        return replace(self._free[key], model=self.model)

    def _without_contacts(self, asked: Asked) -> Configuration:
        """Solve by a method, stops and cables left aside."""
        values, method, start = asked.values, asked.method, asked.start
        try:
            self._check_turns(values, start, method)
            if method == "constant":
                return self._by_constant_leaves(values, asked.estimate, start)
            if self._has_bodies():
                return self._with_reduced_bodies(asked)
            found, plate_solver = solve_with_secants(
                self, lambda s: s._solve(asked), 0.1 * asked.accuracy, modal=method == "modal"
            )
            if start is not None or method is None or not needs_load_step_check(found):
                return found
            doubt, other = compare_with_load_steps(found, lambda: plate_solver.by_load_steps(values))
            error = found.method_error
            if error is not None and other is not None:
                # the exact state is known now, so that the error need not be estimated
                error = relative_error(found.model, found.motion, other.motion)
            return replace(found, doubts=(*found.doubts, *filter(None, [doubt])), method_error=error)
        except (ConvergenceError, RangeError) as error:
            # the drive values were probably given in another unit
            units = "; ".join(self.model.far_drives(values))
            if units:
                error.args = (f"{units} As it is: {error}",)
            raise

    def _check_turns(
        self, values: Mapping[str, float], start: Configuration | None, method: str | None
    ) -> None:
        """Raise SceneError for a start of another mechanism, and where a rotation drive turns too far in one solve."""
        begin = None
        if start is not None:
            if method == "modal" or self._has_bodies():
                raise SceneError(
                    "start: load steps of reduced bodies begin at rest; leave it out, or solve with method='conventional'"
                )
            constant = method == "constant" == getattr(start, "method", None)
            require_start_of(self.constant[0] if constant else self.model, start)
            begin = self.model.targets(start.targets)
        self.model.refuse_turns(self.model.targets(values), begin)

    def settled(self, found: Configuration, start: Configuration | None) -> Configuration:
        """The result in which the loading order of this solver ends, see `settle_order`; a start has a path of its own."""
        if start is not None or (found.touched is not None and found.touched.closed):
            return found
        with self.lock:
            return settle_order(found, self.order, self.joint_motions)

    @cached_property
    def constant(self) -> tuple[Model, NewtonStorage]:
        """The model with leaf springs of constant stiffness, and the storage of its solves."""
        model = with_constant_leaves(self.model)
        return model, NewtonStorage(model)

    def required_forces(self, displacement: ArrayLike, *, rotation: ArrayLike) -> RequiredForces:
        """The forces of drives and supports that hold all links in given poses, with leaf springs of constant stiffness.

        The inverse problem of a control loop, in one evaluation without iteration. displacement (links, 3) [m] of their
        reference points; rotation: matrices (links, 3, 3), rotation vectors (links, 3) [rad], or in a mechanism with a plane
        angles (links,) [rad]; links in the order of the scene, without ground. Where drives are too few they balance the
        links in the least-squares sense, moments over the size of the mechanism. `ksd.required_loads` does the same by
        names, also for exact leaf springs, and checks the poses. Raises SceneError for arrays of another shape, and for
        joints with internal blocks, whose poses are not given.
        """
        with self.lock:
            return self.actuation.at_poses(displacement, rotation)

    @cached_property
    def actuation(self) -> Actuation:
        """Inverse statics of the model with leaf springs of constant stiffness, for `required_forces`."""
        return Actuation(self.constant[0])

    def _by_constant_leaves(
        self, values: Mapping[str, float], estimate: bool, start: Configuration | None
    ) -> Configuration:
        """Solve with leaf springs of constant stiffness; the error is estimated by corrector steps of the full model."""
        model, storage = self.constant
        words: dict[str, Any] = {
            "storage": storage,
            "planar": self.in_plane,
            "joints": self.joint_motions,
            "method": "constant",
        }
        if start is not None and start.method == "constant":
            found = solve_conventional(model, values, start=start, **words)
        else:
            found = solve_in_order(model, values, order=self.order, **words)
        if not estimate:
            return found
        error, step = error_indicator(
            model, found.motion, model.targets(found.targets), found.load_factor, negatives=found.negatives
        )
        return replace(found, method_error=error, steps=(*found.steps[:-1], step, found.steps[-1]))

    def _has_bodies(self) -> bool:
        """Whether the mechanism has reduced bodies, whatever the method."""
        return bool(self.model.bodies) or (self.basis is not None and has_solids(self.basis))

    def _with_reduced_bodies(self, asked: Asked) -> Configuration:
        """Solve with reduced bodies; method "modal" condenses the joints, None or "conventional" solves in load steps."""
        values, method = asked.values, asked.method
        if method not in (None, "conventional", "modal"):
            raise SceneError(
                f"method = {show(method)}: a mechanism with reduced solids is solved in load steps; give no method, or "
                "'conventional'"
            )
        if self.model.bodies:
            found = solve_bodies_by_load_steps(self.model, values, self.order)
        else:
            for load in self.model.scene.loads_along:
                raise SceneError(
                    f"'{load.name}': reduced bodies know no loads along leaf springs; use another method"
                )
            condense_joints = method == "modal"
            if condense_joints not in self._reduced:
                self._reduced[condense_joints] = ReducedBodySolver(
                    self.model, self.basis, condense_joints=condense_joints, records=self.records,
                    extrapolate=self.extrapolate,
                )  # fmt: skip
            found = self._reduced[condense_joints](
                values, relinearisations=asked.relinearisations, order=self.order
            )
        found = with_plane_check(replace(found, method=method or "conventional"))
        return with_error_indicator(found) if asked.estimate else found

    def _solve(self, asked: Asked) -> Configuration:
        """Solve by a method, or when None by the fastest one."""
        values, method, start = asked.values, asked.method, asked.start
        if start is not None and method in (None, "conventional"):
            return solve_conventional(
                self.model,
                values,
                start=start,
                planar=self.in_plane,
                storage=self.storage,
                joints=self.joint_motions,
            )
        if method is None:
            return self._fastest(values, asked.accuracy)
        if method == "conventional":
            return self.by_load_steps(values)
        if method == "modal":
            return self._with_reduced_bodies(asked)
        target = self.model.targets(values)
        return self.five_steps(
            values, target, method=method, relinearisations=asked.relinearisations, estimate=asked.estimate
        )

    @cached_property
    def _refused(self) -> str | None:
        """Why there are no five steps, whatever the drive values; None where there are, empty without joints."""
        try:
            self.five_steps  # noqa: B018
        except (RecordError, KinematicsError, ConvergenceError, RangeError) as reason:
            if "same freedom" in str(reason):
                raise
            return str(reason)
        except SceneError:
            if self.model.scene.joints:
                raise
            return ""
        return None

    @cached_property
    def _record_error(self) -> float:
        """Largest error of fit of the interfaces of the joints [rad, or joint lengths], as their records tell."""
        records = (self.records(family) for family in {p.joint.family for p in self.model.scene.joints})
        errors = (r.fresh_max for record in records for r in record.residuals if r.group == "interface")
        return max(errors, default=0.0)

    @cached_property
    def _is_planar(self) -> bool:
        """Whether the conventional solver has three unknowns per node."""
        return self.planar and isinstance(self.model.plane, Plane)

    def _fastest(self, values: Mapping[str, float], accuracy: float) -> Configuration:
        """Solve by the faster way (`ksd.solvers.method_choice`) to `accuracy`, by the other one where it fails, and by the
        conventional solver last."""
        choice, is_planar = self._choice, self._is_planar
        if choice is None:
            few = len(self.model.scene.joints) == 1 or is_planar
            coarse = self._refused is None and self._record_error > accuracy
            choice = MethodChoice(
                ONE_STEP if few else FIVE_STEPS, in_plane=is_planar, rejected=TRIALS * coarse
            )
            self._choice = choice
        way, why = choice.next
        clock, reason = Stopwatch(), self._refused or ""
        if way == ONE_STEP and (is_planar or self._refused is None):
            found = self._in_one_step(values, why)
            if found is not None:
                self._tell(choice, ONE_STEP, clock(), found)
                return found
            choice.told(ONE_STEP, math.inf)
            why = "chosen because one load step failed"
        if way == LOAD_STEPS:
            choice.by_neither()
        elif self._refused is None:
            clock()
            try:
                found = self._by_five_steps(values, accuracy, choice.needs_full, why)
                self._tell(choice, FIVE_STEPS, clock(), found)
                return found
            except (ConvergenceError, RangeError) as refused:
                choice.told(FIVE_STEPS, math.inf)
                reason = str(refused)
        found = self.by_load_steps(values)
        return (
            replace(found, notes=(*found.notes, f"conventional solver used: {reason}")) if reason else found
        )

    def _tell(self, choice: MethodChoice, way: str, time: float, found: Configuration) -> None:
        """Tell the choice what a pose took, unless kernels were loaded in it, which tells nothing about the methods."""
        if self._kind(found) in _LOADED:
            choice.told(way, time, found.steps, by_full=found.method != "reduced")

    def _kind(self, found: Configuration) -> tuple[str, frozenset[int], bool]:
        """What decides which kernels a result needs."""
        return found.method, self.model.kinds, self.planar

    def _in_one_step(self, values: Mapping[str, float], chosen: str) -> Configuration | None:
        """The conventional result in one load step of few iterations; None where that does not end in a minimum. chosen: see
        `Step`."""
        try:
            found = solve_conventional(
                self.model, values, planar=self.in_plane, max_iterations=MAX_ONE_STEP_ITERATIONS, smallest_step=1.0,
                storage=self.storage, joints=self.joint_motions, chosen=chosen,
            )  # fmt: skip
        except (ConvergenceError, SceneError):
            return None
        return found if found.stable and not found.doubts else None

    def _by_five_steps(
        self, values: Mapping[str, float], accuracy: float, needs_full: bool, chosen: str
    ) -> Configuration:
        """The reduced result, corrected, or where its error is above `accuracy` the full one (needs_full: at once); or that
        of load steps where loads are large and the two differ. chosen: see `Step`. Raises ConvergenceError, RangeError."""
        target, method = self.model.targets(values), "full" if needs_full else "reduced"
        words: dict[str, Any] = {"accuracy": accuracy, "chosen": chosen}
        found = self.five_steps(
            values, target, method=method, relinearisations=0, estimate=not needs_full, **words
        )
        error = found.method_error
        if (error is not None and not error.relative <= accuracy) or not is_solved(found):
            found = self.five_steps(
                values, target, method="full", relinearisations=1, estimate=False, **words
            )
            verdict = solved_verdict(found)
            if not verdict:
                raise ConvergenceError(str(verdict))
        return self._with_load_step_check(found, values)

    def _with_load_step_check(self, found: Configuration, values: Mapping[str, float]) -> Configuration:
        """The result of the five steps, or that of load steps where loads are large and the two differ."""
        if not needs_load_step_check(found):
            return found
        doubt, other = compare_with_load_steps(found, lambda: self.by_load_steps(values))
        if not doubt:
            return found
        if other is None:
            return replace(found, doubts=(*found.doubts, doubt))
        return replace(other, notes=(*other.notes, f"load steps used: the five steps led elsewhere: {doubt}"))

    def by_load_steps(self, values: Mapping[str, float]) -> Configuration:
        """Solve by the conventional solver."""
        return solve_in_order(
            self.model, values, order=self.order, storage=self.storage, planar=self.in_plane, joints=self.joint_motions
        )  # fmt: skip


def _refuse_loose(found: Configuration) -> None:
    """Raise SceneError where nothing holds an object in a pose."""
    closed = [name.split(",")[0] for name, c in found.contacts.items() if c.N > 0.0]
    refuse_loose(found.model.original_scene, closed)


def _check_method(method: object, relinearisations: object) -> None:
    """Raise SceneError for an unknown method, and for a wrong number of relinearisation steps."""
    if method is None:
        return
    if not isinstance(method, str) or method not in METHODS:
        raise SceneError(f"method = {show(method)}: choose one of {', '.join(METHODS)}")
    if method != "conventional" and whole_number(relinearisations, "relinearisations", least=0) > 50:
        raise SceneError(
            f"relinearisations = {relinearisations}: between 0 and 50 relinearisation steps are possible"
        )


def require_start_of(model: Model, start: Any) -> None:
    """Raise SceneError unless `start` is a configuration whose state has the layout of the model."""
    if not isinstance(start, Configuration):
        raise SceneError(f"start = {show(start)}: give a pose, as ksd.solve returns it")
    own, other = model, start.model
    sizes = [tuple(len(field) for field in m.rest) for m in (own, other)]
    if own.node_names != other.node_names or own.drive_names != other.drive_names or sizes[0] != sizes[1]:
        raise SceneError(
            f"start: this pose of '{other.scene.name}' by {start.method}, with {other.leaf_models}, is not one of "
            f"'{own.scene.name}' with {own.leaf_models}; give a pose of this mechanism on this mesh"
        )


def given_values(targets: Any, drives: Mapping[str, float]) -> dict[str, float]:
    """Drive values by name, from a mapping and from keywords. Raises SceneError for what is no mapping, and for a drive in
    both."""
    if targets is not None and not isinstance(targets, Mapping):
        raise SceneError(
            f"targets = {show(targets)}: give drive values by name, for example top=0.1 or {{'top': 0.1}}"
        )
    mapped = targets or {}
    for name, value in drives.items():
        if name in mapped:
            raise SceneError(
                f"drive '{name}' has two values, {show(mapped[name])} in targets and {show(value)}; give it one"
            )
    return {**mapped, **drives}


def refuse_unknown_drives(given: Iterable[str], drives: Iterable[str], call: Callable[..., Any]) -> None:
    """Raise SceneError, with similar names, for the first keyword that is neither a drive nor an option of `call`."""
    known = tuple(drives)
    if set(given) <= set(known):
        return
    options = [n for n, p in signature(call).parameters.items() if p.kind is p.KEYWORD_ONLY]
    for name in given:
        if name not in known:
            raise SceneError(
                f"drive '{name}' is not in this mechanism; its drives are: {', '.join(known) or 'none'}; nor is it an "
                f"option{name_hint(name, (*known, *options))}"
            )


def checked_accuracy(value: float | None) -> float:
    """The requested relative accuracy, DEFAULT_ACCURACY when None. Raises SceneError for what is no accuracy."""
    accuracy = DEFAULT_ACCURACY if value is None else number(value, "accuracy")
    if not 0.0 < accuracy < 1.0:
        raise SceneError(f"accuracy = {value}: give a relative error between 0 and 1, for example 1e-3")
    return accuracy


def _cached_solver(scene: Any, mesh: Mesh, options: dict[str, Any]) -> Solver:
    """A solver of this scene, mesh, options and the records in use, for this thread; the last few are cached."""
    if not hasattr(scene, "fingerprint") or not isinstance(mesh, Mesh):
        # raises SceneError with the reason
        return Solver(scene, mesh=mesh)
    # a record that replaces another makes another solver
    records = tuple(find_record_file(f) for f in sorted({placed.joint.family for placed in scene.joints}))
    key = threading.get_ident(), scene.fingerprint(), records, mesh, repr(options)
    with _cache_lock:
        if key in _cached_solvers:
            _cached_solvers.move_to_end(key)
            return _cached_solvers[key]
    solver = Solver(scene, mesh=mesh, **options)
    with _cache_lock:
        _cached_solvers[key] = solver
        while len(_cached_solvers) > MAX_SOLVERS:
            _cached_solvers.popitem(last=False)
    return solver
