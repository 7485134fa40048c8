"""The inverse problem: loads that hold the links of a mechanism in given poses, and the part its drives can exert.

Where all poses are given, the wrench of every leaf spring follows from its end poses, without iteration where its stiffness
is constant; the load that a link needs is the one missing for its equilibrium. Fewer drives than motions balance these
loads in the least-squares sense.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ksd.answers.printing import PrintableAnswer, format_number, format_table
from ksd.answers.tangent import row_values
from ksd.checks import clear_argument_errors, name_hint, show
from ksd.checks import number as checked
from ksd.errors import ConvergenceError, KsdError, SceneError, TrustError
from ksd.model.arrays import State
from ksd.model.compile import Model, compile_as_is, compile_with_effects
from ksd.model.mesh import Mesh
from ksd.model.orders import raise_order
from ksd.model.plane import Plane
from ksd.model.turns import count_from_links, node_rotations, relative_angles
from ksd.numerics.rotations import rotation_exp, rotation_log
from ksd.numerics.threads import small_matrices
from ksd.scene.drive import GROUND, Drive, DriveTerm
from ksd.scene.hinges import plane_normal
from ksd.scene.link import Link, link_name
from ksd.scene.mechanism import Mechanism
from ksd.scene.scene import Scene
from ksd.solvers.actuation import Actuation
from ksd.solvers.configuration import Configuration
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.error import refined_configuration, refined_model
from ksd.solvers.solver import MAX_RISES, Solver, prepare
from ksd.solvers.steps import DEFAULT_ACCURACY, percent
from ksd.solvers.verdict import is_solved, solved_verdict

Array = NDArray[np.float64]
LinkPoses = dict[int, tuple[Array, Array]]
"""Position (3,) [m] of the reference point and rotation (3, 3), by node."""
BISECTIONS = 12
"""Bisections of the motion to the given poses where the whole of it is not possible."""
DEAD_CENTRE_RATIO = 0.03
"""Smallest singular value of the constraints on links, over the largest, below which the links are at a dead centre: the
last bisection ends a sixtieth of the last angle before it."""
PLANE_TOLERANCE = 1e-6
"""Displacement over the size of the mechanism, and rotation [rad], out of a plane up to which a pose is in it."""
MAX_CHORD_RATIO = 1.05
"""Largest distance of the ends of a leaf over its length."""


@dataclass(frozen=True, repr=False)
class RequiredLoads(PrintableAnswer):
    """Loads that hold a mechanism in given poses, global axes.

    loads: force and moment (6,) [N, Nm] that every link needs in addition to the loads of the scene, about its reference
    point; forces: of the drives that balance them, [N or Nm] by name; reactions: of the supports, likewise; unbalanced:
    force and moment (6,) on every link that neither can balance, zero where there are enough drives; points: displaced
    reference points of the links (3,) [m]. size [m]: by which moments are divided to compare them with forces. warnings:
    sentences about the strain and stress of the leaf springs in the poses; none by method "constant". refined: makes the
    same on a finer mesh, of exact leaf springs.

    >>> guide, stroke, _ = ksd.load_scene("guide")
    >>> held = ksd.required_loads(guide, ksd.solve(guide, stroke).links)
    >>> round(held.forces["table"], 3)
    5.036
    """

    loads: dict[str, Array]
    forces: dict[str, float]
    reactions: dict[str, float]
    unbalanced: dict[str, Array]
    points: dict[str, Array]
    size: float
    warnings: tuple[str, ...] = ()
    refined: Callable[[], RequiredLoads] | None = field(default=None, compare=False)

    @cached_property
    def errors(self) -> RequiredLoads:
        """Error of every number: its absolute change on a finer mesh; inf where there is no equilibrium on it."""
        try:
            fine = self if self.refined is None else self.refined()
        except KsdError:
            fine = None

        def change(name: str) -> dict[str, Any]:
            own, other = getattr(self, name), {} if fine is None else getattr(fine, name)
            return {n: abs(v - other[n]) if other else np.full_like(v, np.inf)[()] for n, v in own.items()}

        return RequiredLoads(
            change("loads"), change("forces"), change("reactions"), change("unbalanced"), change("points"),
            self.size,
        )  # fmt: skip

    @property
    def error(self) -> float:
        """Largest error of a required load over the largest required load."""
        largest = max((self._magnitude(w) for w in self.loads.values()), default=0.0)
        error = max((self._magnitude(w) for w in self.errors.loads.values()), default=0.0)
        return error / largest if largest else error

    @property
    def balanced(self) -> bool:
        """Whether the drives and supports balance all loads."""
        return not any(w.any() for w in self.unbalanced.values())

    def _magnitude(self, wrench: Array) -> float:
        """The larger of force [N] and moment over `size` [N]."""
        return float(max(np.linalg.norm(wrench[:3]), np.linalg.norm(wrench[3:]) / self.size))

    def _line(self) -> str:
        forces = ", ".join(f"{n} {format_number(v)}" for n, v in self.forces.items()) or "no drives"
        error = f"estimated error {percent(self.error)} %" if math.isfinite(self.error) else "error not known"
        return f"{forces}; {'balanced' if self.balanced else 'not balanced by them'} [N, Nm]; {error}"

    def __str__(self) -> str:
        columns = (*(f"F{a} [N]" for a in "xyz"), *(f"M{a} [Nm]" for a in "xyz"))
        largest = max((self._magnitude(w) for w in self.loads.values()), default=0.0)
        rows = [
            (what, n, *(format_number(float(v), 4, zero=1e-9 * largest) for v in wrench))
            for n in self.loads
            for what, wrench in (("needs", self.loads[n]), ("unbalanced", self.unbalanced[n]))
        ]
        title = f"Required loads, about the reference points; drives: {self._line()}"
        warnings = "".join(f"\nWarning: {sentence}." for sentence in self.warnings)
        return format_table(("", "<link", *columns), rows, title) + warnings


@clear_argument_errors
@small_matrices
def required_loads(
    mechanism: Mechanism | Scene | Solver,
    poses: Mapping[str, Any],
    *,
    method: Literal["constant", "conventional"] | None = None,
    mesh: Mesh | None = None,
) -> RequiredLoads:
    """Loads, and the drive forces that balance them, that hold links in given poses.

    poses: by link, (displacement (3,) [m], rotation) of its reference point, as `pose.links` gives them, or (displacement,
    rotation, at) of the point that is at `at` (3,) [m] at rest; rotation: matrix (3, 3), rotation vector (3,) [rad], or in
    a mechanism with a plane the angle [rad], up to half a turn. Links without a pose take their equilibrium without
    actuation. method: "constant" uses leaf springs of constant stiffness, one evaluation where all poses are given; by
    default they are exact. The drives of the scene are the actuators: their forces, and those of the supports, balance the
    required loads in the least-squares sense, moments over the size of the mechanism. The links are moved straight to
    their poses, or, where leaf springs cannot follow, first by the drives to the drive values which the poses imply; where
    a leaf spring can snap, the equilibrium found may differ from the one the poses were taken from. mesh: as in
    `ksd.solve`. The answer tells its error, computed when it is read or printed. Raises SceneError for poses that no leaf
    can take, ConvergenceError for poses that are not reached, TrustError where the equilibrium there is not stable.

    >>> guide, stroke, _ = ksd.load_scene("guide")
    >>> held = ksd.required_loads(guide, ksd.solve(guide, stroke).links)
    >>> round(held.forces["table"], 3)
    5.036
    """
    if method not in (None, "constant", "conventional"):
        raise SceneError(f"method = {show(method)}: give 'constant', or nothing for exact leaf springs")
    solver = mechanism if isinstance(mechanism, Solver) else prepare(mechanism, mesh=mesh)
    model = solver.constant[0] if method == "constant" else solver.model
    poses_by_node = _link_poses(model, poses)
    _check_leaf_lengths(model, poses_by_node)
    if method == "constant" and len(poses_by_node) == len(model.node_names) - 1:
        state = _state_in_poses(model, poses_by_node)
    else:
        pose = _prescribed_pose(solver, model, poses_by_node, method or "conventional")
        # refine the mesh as `solve` would
        for _ in range(MAX_RISES):
            share, _, axis, _ = pose.mesh_adequacy
            if share <= DEFAULT_ACCURACY or mesh is not None or isinstance(mechanism, Solver):
                break
            solver = prepare(mechanism, mesh=raise_order(model.mesh, axis))
            model = solver.constant[0] if method == "constant" else solver.model
            pose = _prescribed_pose(solver, model, poses_by_node, method or "conventional")
        if not is_solved(pose):
            raise TrustError(
                f"poses: what is found there is {solved_verdict(pose)}", reached=1.0, result=pose
            )
        if method != "constant":
            strained = () if pose.strength is None else pose.strength.warnings
            found = _loads_at(model, pose)
            return replace(
                found, warnings=(*strained, *found.warnings), refined=partial(_refined_loads, model, pose)
            )
        state = _state_of(model, pose)
    state.multiplier[:] = 0.0
    with solver.lock:
        return replace(
            _balance(model, state, solver.actuation),
            refined=partial(_refined_exact_loads, solver, dict(poses)),
        )


def _loads_at(model: Model, pose: Configuration) -> RequiredLoads:
    """The loads that the links of a model need in a pose."""
    return _balance(model, _state_of(model, pose), Actuation(model))


def _refined_loads(model: Model, pose: Configuration) -> RequiredLoads:
    """`_loads_at` on the refined mesh. Raises ConvergenceError."""
    return _loads_at(refined_model(model), refined_configuration(pose))


def _refined_exact_loads(solver: Solver, poses: Mapping[str, Any]) -> RequiredLoads:
    """Loads of exact leaf springs on the refined mesh. Raises what `required_loads` raises."""
    exact = required_loads(solver, poses)
    assert exact.refined is not None
    return exact.refined()


def _state_of(model: Model, pose: Configuration) -> State:
    """The links and leaf springs of a pose as a state of a model without drives and supports that act."""
    state = model.rest.copy()
    state.x[:], state.R[:], state.inner[:] = pose.motion.x, pose.motion.R, pose.motion.inner
    count_from_links(model.arrays, state, node_rotations(pose.model.arrays, pose.motion))
    state.multiplier[:] = 0.0
    return state


def _link_poses(model: Model, poses: Mapping[str, Any]) -> LinkPoses:
    """Poses of the links from the argument of `required_loads`. Raises SceneError for wrong names and values."""
    if not isinstance(poses, Mapping):
        raise SceneError(f"poses = {show(poses)}: give (displacement, rotation) by link, as in pose.links")
    found, links = {}, model.scene.links
    for link, pose in poses.items():
        name = link_name(link) if isinstance(link, Link) else link
        if name not in links:
            raise SceneError(f"poses: link {show(name)} does not exist{name_hint(name, links)}")
        try:
            displacement, rotation, *at = pose
            i, shift = links.index(name), np.asarray(displacement, float).reshape(3)
            turn = np.asarray(rotation, float)
            if turn.shape == () and model.scene.plane is not None:
                turn = float(turn) * np.asarray(plane_normal(model.scene.plane))
            turn = turn if turn.shape == (3, 3) else turn.reshape(3)
            rest = model.rest.x[i]
            point = np.asarray(at[0], float).reshape(3) if at else rest
        except (TypeError, ValueError):
            raise SceneError(
                f"poses: {show(name)}: {show(pose)} must be (displacement (3,), rotation), or (displacement, rotation, at)."
            ) from None
        if not (np.isfinite([shift, point]).all() and np.isfinite(turn).all()):
            raise SceneError(
                f"poses: {show(name)}: {show(pose)} is not finite; give finite numbers in m and rad."
            )
        R = _rotation_matrix(name, turn, rotation)
        if name == GROUND:
            if shift.any() or np.abs(R - np.eye(3)).max() > PLANE_TOLERANCE:
                raise SceneError(
                    f"poses: '{GROUND}': {show(pose)}: ground does not move; leave it out, or give it zero."
                )
            continue
        if model.scene.plane is not None:
            normal = np.asarray(plane_normal(model.scene.plane))
            if (
                abs(normal @ shift) > PLANE_TOLERANCE * model.arrays.size
                or np.abs(R @ normal - normal).max() > PLANE_TOLERANCE
            ):
                raise SceneError(
                    f"poses: {show(name)}: {show(pose)} leaves the plane {model.scene.plane} of the mechanism; give a "
                    "displacement in it and an angle about its normal."
                )
        found[i] = point + shift + R @ (rest - point), R
    return found


def _rotation_matrix(link: str, turn: Array, rotation: Any) -> Array:
    """Rotation matrix (3, 3) of a link from a matrix or a rotation vector (3,) `turn`, given as `rotation`.

    Raises SceneError for a matrix that is no rotation, and for more than half a turn.
    """
    if turn.shape == (3, 3):
        if np.abs(turn.T @ turn - np.eye(3)).max() > PLANE_TOLERANCE or np.linalg.det(turn) < 0.0:
            raise SceneError(
                f"poses: '{link}': {show(rotation)} is no rotation matrix; give one, or the rotation vector in rad."
            )
        return turn
    angle, R = float(np.linalg.norm(turn)), np.empty((3, 3))
    if angle > math.pi * (1.0 + PLANE_TOLERANCE):
        same = math.remainder(angle, 2.0 * math.pi) / angle * np.asarray(rotation, float)
        raise SceneError(
            f"poses: '{link}': a pose tells its rotation within {math.pi:.5g} rad either way, not {show(rotation)}; "
            f"{show(np.round(same, 5).tolist())} is the same pose; further turns are followed by drives (ksd.follow)."
        )
    rotation_exp(turn, R)
    return R


def _check_leaf_lengths(model: Model, poses_by_node: LinkPoses) -> None:
    """Raises SceneError where the ends of a leaf would be further apart than it is long."""
    members, known = model.arrays.members, np.zeros(len(model.node_names), bool)
    known[[0, *poses_by_node]] = True
    x, R = model.rest.x.copy(), model.rest.R.copy()
    for i, pose in poses_by_node.items():
        x[i], R[i] = pose
    ends = x[members.node] + (R[members.node] @ members.offset[..., None])[..., 0]
    chord = ends[:, 1] - ends[:, 0]
    apart, among = np.sqrt((chord * chord).sum(axis=1)), known[members.node]
    beyond = among[:, 0] & among[:, 1] & (apart > MAX_CHORD_RATIO * members.length)
    if beyond.any():
        i = int(np.argmax(beyond))
        raise SceneError(
            f"poses: the ends of leaf '{model.member_names[i]}' would be {1e3 * apart[i]:.4g} mm apart, but it is "
            f"{1e3 * members.length[i]:.4g} mm long; bring them within that."
        )


def prescribed_pose(solver: Solver, poses: Mapping[str, Any]) -> Configuration:
    """The equilibrium of a mechanism with links constrained to poses, given as in `required_loads`.

    Raises SceneError for poses that no leaf can take, ConvergenceError for poses that are not reached.
    """
    poses_by_node = _link_poses(solver.model, poses)
    _check_leaf_lengths(solver.model, poses_by_node)
    return _prescribed_pose(solver, solver.model, poses_by_node, "conventional")


def _prescribed_pose(solver: Solver, model: Model, poses_by_node: LinkPoses, method: Any) -> Configuration:
    """See `prescribed_pose`; the ConvergenceError says how far the links get, and which ones are at a dead centre there."""
    posing, targets = _pose_solver(solver, model, poses_by_node)

    def at(share: float) -> Configuration:
        part = {name: share * value for name, value in targets.items()}
        return posing(part, method=method, estimate=False, strict=False)

    straight, failure = None, None
    try:
        straight = at(1.0)
    except ConvergenceError as reason:
        failure = reason
    if straight is not None and is_solved(straight):
        return straight
    if method != "constant":
        other = _pose_from_drives(solver, posing.model, targets, poses_by_node)
        if other is not None and (straight is None or is_solved(other)):
            return other
    if straight is not None:
        return straight
    assert failure is not None
    low, obstacle = _obstacle(posing, at, targets)
    obstacle = obstacle if "dead centre" in obstacle else f"{obstacle}; {failure}"
    raise ConvergenceError(f"poses: {obstacle}", reached=low, result=failure.result) from None


def _uncertain_turns(model: Model, state: State) -> Iterator[str]:
    """A sentence per torsion spring that the poses of its links, within half a turn each, turn by half a turn or more."""
    angles = relative_angles(model.arrays, state)[len(model.arrays.terms.node) :]
    for name, angle in zip(model.spring_names, angles.tolist(), strict=True):
        if abs(angle) > math.pi * (1.0 - PLANE_TOLERANCE):
            other = angle - math.copysign(2.0 * math.pi, angle)
            yield (
                f"poses: {name} counts as turned by {math.degrees(angle):.4g} deg, as its links turn by at most half a turn "
                f"each; in the same poses it may be turned by {math.degrees(other):.4g} deg: follow the path there "
                "(ksd.follow) to know"
            )


def _state_in_poses(model: Model, poses_by_node: LinkPoses) -> State:
    """The undeformed state with links in poses, whose rotations from rest are at most half a turn."""
    state, rotations = model.rest.copy(), np.zeros((len(model.node_names), 3))
    for i, (x, R) in poses_by_node.items():
        state.x[i], state.R[i] = x, R
        rotation_log(R, rotations[i])
    count_from_links(model.arrays, state, rotations)
    return state


def _pose_from_drives(
    solver: Solver, posed: Model, targets: Mapping[str, float], poses_by_node: LinkPoses
) -> Configuration | None:
    """The equilibrium in the poses, reached from that of the mechanism at the drive values which the poses imply.

    posed: the model with drives that prescribe the poses, targets: their values. None where a drive acts on a link without a
    pose, and where one of the equilibria is not found.
    """
    model = solver.model
    names = {GROUND, *(model.node_names[i] for i in poses_by_node)}
    links = {n for d in model.original_scene.drives for t in d.terms for n in (t.base, t.link)}
    if not links or links - names:
        return None
    state = _state_in_poses(model, poses_by_node)
    values = dict(zip(model.drive_names, row_values(model, state).tolist(), strict=False))
    try:
        motion = solver(values, method="conventional", estimate=False, strict=False).motion
        begin = posed.rest.copy()
        begin.x[:], begin.R[:], begin.inner[:] = motion.x, motion.R, motion.inner
        count_from_links(posed.arrays, begin, node_rotations(model.arrays, motion))
        rows = dict(zip(posed.drive_names, row_values(posed, begin).tolist(), strict=False))
        near = Configuration(
            posed, begin, "conventional", rows, (), negatives=0, expected_negatives=0, load_factor=1.0
        )
        return solve_conventional(posed, targets, start=near, planar="auto" if solver.planar else False)
    except KsdError:
        return None


def _obstacle(
    posing: Solver, at: Callable[[float], Configuration], targets: Mapping[str, float]
) -> tuple[float, str]:
    """Possible fraction of the motion to the poses, and its obstacle in words, with links at a dead centre."""
    low, high, state = 0.0, 1.0, posing.model.rest
    for _ in range(BISECTIONS):
        try:
            state = at(0.5 * (low + high)).motion
            low = 0.5 * (low + high)
        except KsdError:
            high = 0.5 * (low + high)
    name = max(
        targets, key=lambda n: abs(targets[n]) if ": r" in n else abs(targets[n]) / posing.model.arrays.size
    )
    link, _, axis = name.partition(": ")
    amount = low * targets[name] + 0.0
    distance = f"{amount:.4g} rad" if axis[0] == "r" else f"{1e3 * amount:.4g} mm along {axis}"
    limit = f"link '{link}' is led no further than {100 * low:.3g} % of its way, {distance}"
    stuck = _dead_centre(posing.model, state)
    if not stuck:
        return low, limit
    names = " and ".join(f"'{n}'" for n in stuck)
    return low, (
        f"{limit}: there {names} are at a dead centre, where '{link}' cannot move them on; ask for less, or give the pose "
        f"of '{stuck[0]}' instead"
    )


def _dead_centre(model: Model, state: State) -> tuple[str, ...]:
    """Links without a pose that can move at a state although hinges, supports and poses constrain them.

    The one that moves most comes first; empty where none can.
    """
    hinged = {n for h in model.original_scene.hinges for n in (h.a, h.b)}
    unactuated = state.copy()
    unactuated.multiplier[:] = 0.0
    actuation = Actuation(model)
    actuation(unactuated)
    gradients = actuation.gradients.reshape(model.links - 1, 6, -1).copy()
    gradients[:, 3:] /= model.arrays.size
    driven = {t.link for d in model.original_scene.drives for t in d.terms}
    names = model.scene.links[1:]
    free = [k for k, name in enumerate(names) if name in hinged and name not in driven]
    if not free:
        return ()
    axes = np.ones(6, bool)
    if model.scene.plane is not None:
        normal = np.asarray(plane_normal(model.scene.plane)) != 0.0
        axes = np.append(~normal, normal)
    constraints = gradients[free][:, axes].reshape(len(free) * int(axes.sum()), -1).T
    _, sizes, motions = np.linalg.svd(constraints)
    if len(sizes) == constraints.shape[1] and sizes[-1] > DEAD_CENTRE_RATIO * sizes[0]:
        return ()
    moved = np.linalg.norm(motions[-1].reshape(len(free), -1), axis=1)
    return tuple(names[free[k]] for k in np.argsort(-moved) if moved[k] > 0.05)


def _pose_solver(solver: Solver, model: Model, poses_by_node: LinkPoses) -> tuple[Solver, dict[str, float]]:
    """A solver of the mechanism with drives that prescribe these poses, and the drive values."""
    scene, found = model.original_scene, model.plane
    axis = found.axis if isinstance(found, Plane) else None
    names = {model.node_names[i] for i in poses_by_node} | {GROUND}
    drives, targets = [], {}
    for i, (x, R) in poses_by_node.items():
        link, rest = model.node_names[i], tuple(model.rest.x[i].tolist())
        # the value of a drive is the twist about its axis, which is no component of the rotation vector
        *q, q0 = Rotation.from_matrix(R).as_quat().tolist()
        turn = np.array([2.0 * math.atan2(math.copysign(1.0, q0) * part, abs(q0)) for part in q])
        for kind, values in (("translation", x - model.rest.x[i]), ("rotation", turn)):
            for k, value in enumerate(values.tolist()):
                if axis is not None and (k == axis) != (kind == "rotation"):
                    continue
                name = f"{link}: {'r' * (kind == 'rotation')}{'xyz'[k]}"
                direction = tuple(np.eye(3)[k].tolist())
                drives.append(Drive(name, (DriveTerm(1.0, kind, GROUND, link, direction, rest),)))
                targets[name] = checked(value, f"pose of '{link}'")
    supports = tuple(s for s in scene.supports if {n for t in s.terms for n in (t.base, t.link)} - names)
    hinges = tuple(h for h in scene.hinges if {h.a, h.b} - names)
    driven = replace(scene, drives=tuple(drives), supports=supports, hinges=hinges)
    driven_model = (
        compile_as_is(driven, model.mesh)
        if model.choice is None
        else compile_with_effects(driven, model.mesh, model.choice)
    )
    return Solver(driven_model, planar=solver.planar), targets


def _balance(model: Model, state: State, actuation: Actuation) -> RequiredLoads:
    """Loads that the links need at a state, and the drive and support forces that balance them."""
    names, found = model.scene.links[1:], actuation(state)
    supports = model.original_scene.supports
    return RequiredLoads(
        dict(zip(names, found.needed, strict=True)),
        dict(zip(model.drive_names, found.forces.tolist(), strict=True)),
        {s.name: f for s, f in zip(supports, found.reactions.tolist(), strict=True)},
        dict(zip(names, found.unbalanced, strict=True)),
        {name: state.x[i + 1].copy() for i, name in enumerate(names)},
        float(model.arrays.size),
        tuple(_uncertain_turns(model, state)),
    )
