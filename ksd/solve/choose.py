"""`solve` and `prepare`: one call for all methods, choosing the cheapest that meets the accuracy asked for."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Iterable, Mapping
from typing import Any

from ksd.errors import SceneError
from ksd.library.files import record_in_use
from ksd.model.compile import Model
from ksd.model.mesh import Mesh
from ksd.model.orders import mesh_for, raised
from ksd.scene.contents import Scene
from ksd.scene.mechanism import Mechanism
from ksd.section.checks import truth, worded
from ksd.solve.configuration import Configuration
from ksd.solve.solver import METHODS, Basis, Method, Solver, asked_values, refuse_unknown, wanted_accuracy
from ksd.solve.steps import ErrorEstimate
from ksd.solve.verdict import insist, mesh_check

KEPT = 16
"""Solvers that `solve` keeps."""
_recent: OrderedDict[tuple[Any, ...], Solver] = OrderedDict()
_turn = threading.Lock()


@worded
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
) -> Solver:
    """A `Solver` of this mechanism for many solves: everything that does not depend on the drive values is done once.

    mesh: leaf model and its fineness (strain-mode leafs when None). extrapolate: use joint records beyond their trained
    range, with a warning in the result. effects, with_, without: what is simulated (see `ksd.model.effects`). accuracy: of
    solves that say none. planar: False solves in space, by every method, even where the scene stays in its plane. basis:
    for method "modal", see `solve`. Raises SceneError for a scene that cannot be compiled.
    """
    return Solver(
        mechanism, mesh=mesh, extrapolate=extrapolate, planar=planar, basis=basis, effects=effects, with_=with_,
        without=without, accuracy=accuracy,
    )  # fmt: skip


def solve(
    mechanism: Mechanism | Scene | Model,
    targets: Mapping[str, float] | None = None,
    *,
    method: Method | None = None,
    accuracy: float | None = None,
    mesh: Mesh | None = None,
    passes: int = 0,
    extrapolate: bool = False,
    strict: bool = True,
    effects: str | Iterable[str] = "auto",
    with_: str | Iterable[str] = (),
    without: str | Iterable[str] = (),
    basis: Basis | None = None,
    estimate: bool = True,
    planar: bool = True,
    **drives: float,
) -> Configuration:
    """Solve one configuration of a mechanism at drive values given by name [m or rad].

    method: "kinematic", "reduced", "full", "conventional" or "modal" (leafs as modal bodies; `basis`: a
    `ksd.ModalBasis` for all, or several by joint or leaf, {"hinge": ksd.ModalBasis()}: then joints not named are condensed
    as in "reduced", and other leafs computed in full; or reduced solids by leaf, {"spring": reduce_solid(...)}, see
    `ksd.modal.solid_basis`: by "modal" beside condensed joints, without a method beside leafs in full); without one, the
    cheapest whose estimated error is within `accuracy` (relative, 1e-3 by default).
    estimate: False leaves out the error figure of a fast method, and its cost. passes: extra relinearised passes of
    `reduced`. mesh: leaf model; without one, strain-mode leafs of orders fit for
    `accuracy`, raised when their highest modes carry too much energy. extrapolate, planar:
    see `prepare`. strict: raise TrustError where the answer is unstable or on a doubtful branch; False returns it with its
    verdicts (`trust`). effects: "auto" simulates what the scene mentions, "all" also all a leaf can have,
    a list of names just these; with_="warping", without="shear" override single ones (`ksd.model.effects`; print(pose.model)
    says what was simulated). Raises SceneError (bad input), RangeError (outside a trained range), RecordError (joint record
    missing or damaged), KinematicsError (indeterminate or over-driven), ConvergenceError (says how far it got).
    """
    values = asked_values(targets, drives)
    for word, given in (
        ("extrapolate", extrapolate),
        ("strict", strict),
        ("estimate", estimate),
        ("planar", planar),
    ):
        truth(given, word)
    if isinstance(mechanism, Model):
        if effects != "auto" or with_ or without:
            raise SceneError("effects are chosen when a model is compiled: pass them to ksd.compile_scene")
        refuse_unknown(drives, mechanism.drive_names, solve)
        return Solver(mechanism, extrapolate=extrapolate, basis=basis, planar=planar)(
            values, method=method, accuracy=accuracy, passes=passes, strict=strict, estimate=estimate
        )
    scene = mechanism.scene() if hasattr(mechanism, "scene") else mechanism
    if hasattr(scene, "drives"):
        refuse_unknown(drives, (d.name for d in scene.drives), solve)
    said = {"effects": effects, "with_": with_, "without": without, "basis": basis, "planar": planar}
    ways = {"method": method, "accuracy": accuracy, "passes": passes, "estimate": estimate}
    found = _with_enough_modes(scene, mesh, extrapolate, said, (values, ways, strict))
    return insist(found) if strict else found


def _with_enough_modes(
    scene: Any, mesh: Mesh | None, extrapolate: bool, said: dict[str, Any], asked: tuple[Any, ...]
) -> Configuration:
    """The answer, without a mesh asked for on one whose orders are raised until they are enough; asked: drive values,
    options of `Solver.on_mesh`, whether to insist on trust."""
    values, ways, strict = asked
    accuracy = ways["accuracy"]
    wanted = wanted_accuracy(accuracy)
    chosen = mesh if mesh is not None else (Mesh() if accuracy is None else mesh_for(wanted))
    for rise in range(MOST_RISES + 1):
        solver = _recent_solver(scene, chosen, extrapolate, said)
        found = solver.on_mesh(values, **ways)
        found = insist(found) if strict else found
        share, _, axis, _ = found.resolution
        if share <= wanted or mesh is not None or rise == MOST_RISES:
            break
        chosen = raised(chosen, axis)
    return mesh_check(found, wanted)


MOST_RISES = 5
"""How often `solve` raises the orders of the strain-mode leafs when their highest modes are not negligible."""


def _records_in_use(scene: Any) -> tuple[Any, ...]:
    """What tells whether a joint record of this scene has been replaced since."""
    return tuple(record_in_use(family) for family in sorted({placed.joint.family for placed in scene.joints}))


def _recent_solver(scene: Any, mesh: Mesh, extrapolate: bool, said: dict[str, Any]) -> Solver:
    """A prepared solver of this scene and its records, mesh, choice of effects and thread; the last few are kept."""
    if not hasattr(scene, "fingerprint") or not isinstance(mesh, Mesh):
        return Solver(scene, mesh=mesh, extrapolate=extrapolate)  # says what is wrong
    key = (
        threading.get_ident(), scene.fingerprint(), _records_in_use(scene), mesh, extrapolate, repr(said)
    )  # fmt: skip
    with _turn:
        if key in _recent:
            _recent.move_to_end(key)
            return _recent[key]
    made = Solver(scene, mesh=mesh, extrapolate=extrapolate, **said)
    with _turn:
        _recent[key] = made
        while len(_recent) > KEPT:
            _recent.popitem(last=False)
    return made


__all__ = ["METHODS", "ErrorEstimate", "Solver", "prepare", "solve"]
