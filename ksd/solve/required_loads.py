"""The inverse problem: which loads hold the links of a mechanism in wanted poses, and which of it its actuators can give.

With all poses given every leaf is a wrench that can be evaluated, without iteration where its stiffness is constant; what is
missing to equilibrium on a link is the load it needs. Fewer actuators than motions give it in the least-squares sense.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ksd.checks import clear_argument_errors, name_hint, show
from ksd.checks import number as checked
from ksd.errors import ConvergenceError, KsdError, SceneError, TrustError
from ksd.model.arrays import Motion
from ksd.model.compile import Model, compile_chosen, compile_given
from ksd.model.effects import with_conditions
from ksd.model.mesh import Mesh
from ksd.model.orders import raised
from ksd.model.plane import Plane, plane_of
from ksd.numerics.rotations import rotation_exp
from ksd.properties.printing import PrintableAnswer, format_number, format_table
from ksd.scene.drive import GROUND, Drive, DriveTerm
from ksd.scene.hinges import plane_normal
from ksd.scene.link import Link, link_name
from ksd.scene.mechanism import Mechanism
from ksd.scene.scene import Scene
from ksd.solve.actuation import Actuation
from ksd.solve.configuration import Configuration
from ksd.solve.solver import DEFAULT_ACCURACY, MAX_RISES, Solver, prepare
from ksd.solve.verdict import is_solved, solved_verdict

Array = NDArray[np.float64]
Wanted = dict[int, tuple[Array, Array]]
"""Place (3,) [m] of the reference point and rotation (3, 3) by node."""
HALVINGS = 12
"""Parts of the way to wanted poses that are tried where the whole is not possible."""
DEAD = 0.03
"""Least singular value of what holds links, over the largest, below which they can move all the same: the twelfth half of a
way ends a sixtieth of the last angle before its dead centre."""
FLAT = 1e-6
"""Displacement over the size, and rotation [rad], across a plane that a pose in it may have."""
STRETCH = 1.05
"""Chord of a leaf over its length from which on no leaf can take it."""


@dataclass(frozen=True, repr=False)
class RequiredLoads(PrintableAnswer):
    """What holds a mechanism in wanted poses, global axes.

    loads: force and moment (6,) [N, Nm] that every link needs beside the loads of the scene, about its reference point;
    forces: of them the drives give, [N or Nm] by name; reactions: and the supports; unbalanced: force and moment (6,) on
    every link that neither can give, zero where there are enough drives; points: where the reference points of the links are
    now (3,) [m]. size [m]: what moments are divided by to be compared with forces.
    """

    loads: dict[str, Array]
    forces: dict[str, float]
    reactions: dict[str, float]
    unbalanced: dict[str, Array]
    points: dict[str, Array]
    size: float

    @property
    def balanced(self) -> bool:
        """Whether the drives hold the poses, nothing being left over."""
        return not any(w.any() for w in self.unbalanced.values())

    def _amount(self, wrench: Array) -> float:
        return float(max(np.linalg.norm(wrench[:3]), np.linalg.norm(wrench[3:]) / self.size))

    def _line(self) -> str:
        said = ", ".join(f"{n} {format_number(v)}" for n, v in self.forces.items()) or "no drives"
        return f"{said}; {'balanced' if self.balanced else 'not balanced by them'} [N, Nm]"

    def __str__(self) -> str:
        columns = (*(f"F{a} [N]" for a in "xyz"), *(f"M{a} [Nm]" for a in "xyz"))
        most = max((self._amount(w) for w in self.loads.values()), default=0.0)
        rows = [
            (what, n, *(format_number(float(v), 4, zero=1e-9 * most) for v in wrench))
            for n in self.loads
            for what, wrench in (("needs", self.loads[n]), ("unbalanced", self.unbalanced[n]))
        ]
        said = f"Required loads, about the reference points; drives: {self._line()}"
        return format_table(("", "<link", *columns), rows, said)


@clear_argument_errors
def required_loads(
    mechanism: Mechanism | Scene | Solver,
    poses: Mapping[str, Any],
    *,
    method: Literal["constant", "conventional"] | None = None,
    mesh: Mesh | None = None,
) -> RequiredLoads:
    """The loads, and of them the drive forces, that hold links in wanted poses.

    poses: by link, (displacement (3,) [m], rotation) of its reference point, as `pose.links` gives them, or (displacement,
    rotation, at) of the point that is at `at` (3,) [m] at rest; rotation: matrix (3, 3), rotation vector (3,) [rad], or in
    a mechanism with a plane the angle [rad]. Links without a pose find their own, without actuation. method: "constant"
    takes leaf springs of constant stiffness, one evaluation where all poses are given; without it they are exact. The
    drives of the scene are the actuators: their forces, and those of the supports, balance the rest in the least-squares
    sense, moments over the size of the mechanism. The equilibrium is the one found with the
    links led straight to their poses: where a leaf spring can snap, it may be another than that of the pose they were taken
    from. mesh: as in `ksd.solve`. Raises SceneError for poses that no leaf can take, ConvergenceError for those not
    reached, TrustError where what is found there is not stable.
    """
    if method not in (None, "constant", "conventional"):
        raise SceneError(f"method = {show(method)}: give 'constant', or nothing for exact leaf springs")
    solver = mechanism if isinstance(mechanism, Solver) else prepare(mechanism, mesh=mesh)
    model = solver.constant[0] if method == "constant" else solver.model
    wanted = _wanted(model, poses)
    _check_lengths(model, wanted)
    if method == "constant" and len(wanted) == len(model.node_names) - 1:
        state = model.rest.copy()
        for i, (x, R) in wanted.items():
            state.x[i], state.R[i] = x, R
    else:
        pose = _held_pose(solver, model, wanted, method or "conventional")
        # as finely as `solve` would
        for _ in range(MAX_RISES):
            share, _, axis, _ = pose.mesh_adequacy
            if share <= DEFAULT_ACCURACY or mesh is not None or isinstance(mechanism, Solver):
                break
            solver = prepare(mechanism, mesh=raised(model.mesh, axis))
            model = solver.constant[0] if method == "constant" else solver.model
            pose = _held_pose(solver, model, wanted, method or "conventional")
        if not is_solved(pose):
            raise TrustError(
                f"poses: what is found there is {solved_verdict(pose)}", reached=1.0, result=pose
            )
        if method != "constant" and model.mesh.plate:
            # the plate factors belong to how much the leaf springs are bent there
            bent = {n: leaf.condition for n, leaf in pose.model.scene.leaf_names().items() if leaf.condition}
            scene = with_conditions(model.scene, bent)
            model = compile_given(scene, model.mesh, model.said, model.choice)
        state = model.rest.copy()
        state.x[:], state.R[:], state.inner[:] = pose.motion.x, pose.motion.R, pose.motion.inner
    state.multiplier[:] = 0.0
    with solver.lock:
        actuation = solver.actuation if method == "constant" else Actuation(model)
        return _balance(model, state, actuation)


def _wanted(model: Model, poses: Mapping[str, Any]) -> Wanted:
    """Place (3,) of the reference point and rotation (3, 3) of every link with a pose, by its node."""
    if not isinstance(poses, Mapping):
        raise SceneError(f"poses = {show(poses)}: give (displacement, rotation) by link, as in pose.links")
    found, links = {}, model.scene.links
    for link, said in poses.items():
        name = link_name(link) if isinstance(link, Link) else link
        if name not in links:
            raise SceneError(f"poses: link {show(name)} does not exist{name_hint(name, links)}")
        if name == GROUND:
            continue
        try:
            displacement, rotation, *at = said
            i, shift = links.index(name), np.asarray(displacement, float).reshape(3)
            R = _rotation(model, rotation)
            rest = model.rest.x[i]
            point = np.asarray(at[0], float).reshape(3) if at else rest
        except (TypeError, ValueError):
            raise SceneError(
                f"poses: {show(name)}: {show(said)} must be (displacement (3,), rotation), or (displacement, rotation, at)."
            ) from None
        if model.scene.plane is not None:
            normal = np.asarray(plane_normal(model.scene.plane))
            if abs(normal @ shift) > FLAT * model.arrays.size or np.abs(R @ normal - normal).max() > FLAT:
                raise SceneError(
                    f"poses: {show(name)}: {show(said)} leaves the plane {model.scene.plane} of the mechanism; give a "
                    "displacement in it and an angle about its normal."
                )
        found[i] = point + shift + R @ (rest - point), R
    return found


def _rotation(model: Model, said: Any) -> Array:
    """Matrix (3, 3) of a rotation matrix, a rotation vector, or an angle in the plane."""
    given = np.asarray(said, float)
    if given.shape == (3, 3):
        return given
    if given.shape == () and model.scene.plane is not None:
        given = float(given) * np.asarray(plane_normal(model.scene.plane))
    R = np.empty((3, 3))
    rotation_exp(given.reshape(3), R)
    return R


def _check_lengths(model: Model, wanted: Wanted) -> None:
    """SceneError for ends of a leaf further apart than it is long."""
    members, known = model.arrays.members, np.zeros(len(model.node_names), bool)
    known[[0, *wanted]] = True
    x, R = model.rest.x.copy(), model.rest.R.copy()
    for i, pose in wanted.items():
        x[i], R[i] = pose
    ends = x[members.node] + (R[members.node] @ members.offset[..., None])[..., 0]
    chord = ends[:, 1] - ends[:, 0]
    apart, among = np.sqrt((chord * chord).sum(axis=1)), known[members.node]
    beyond = among[:, 0] & among[:, 1] & (apart > STRETCH * members.length)
    if beyond.any():
        i = int(np.argmax(beyond))
        raise SceneError(
            f"poses: the ends of leaf '{model.member_names[i]}' would be {1e3 * apart[i]:.4g} mm apart, but it is "
            f"{1e3 * members.length[i]:.4g} mm long; bring them within that."
        )


def prescribed_pose(solver: Solver, poses: Mapping[str, Any]) -> Configuration:
    """The equilibrium of a mechanism with links held in wanted poses, said as in `required_loads`. Raises SceneError for
    poses that no leaf can take."""
    wanted = _wanted(solver.model, poses)
    _check_lengths(solver.model, wanted)
    return _held_pose(solver, solver.model, wanted, "conventional")


def _held_pose(solver: Solver, model: Model, wanted: Wanted, method: Any) -> Configuration:
    """That equilibrium, of the mechanism whose drives are these poses. Raises ConvergenceError that says how far it gets,
    and which links are at a dead centre there."""
    holding, targets = _holding(solver, model, wanted)

    def at(share: float) -> Configuration:
        part = {name: share * value for name, value in targets.items()}
        return holding(part, method=method, estimate=False, strict=False)

    try:
        return at(1.0)
    except ConvergenceError as reason:
        low, said = _obstacle(holding, at, targets)
        said = said if "dead centre" in said else f"{said}; {reason}"
        raise ConvergenceError(f"poses: {said}", reached=low, result=reason.result) from None


def _obstacle(
    holding: Solver, at: Callable[[float], Configuration], targets: Mapping[str, float]
) -> tuple[float, str]:
    """How far the wanted poses are reached, and whether links are at a dead centre there, in words."""
    low, high, state = 0.0, 1.0, holding.model.rest
    for _ in range(HALVINGS):
        try:
            state = at(0.5 * (low + high)).motion
            low = 0.5 * (low + high)
        except KsdError:
            high = 0.5 * (low + high)
    name = max(
        targets, key=lambda n: abs(targets[n]) if ": r" in n else abs(targets[n]) / holding.model.arrays.size
    )
    link, _, way = name.partition(": ")
    amount = low * targets[name] + 0.0
    far = f"{amount:.4g} rad" if way[0] == "r" else f"{1e3 * amount:.4g} mm along {way}"
    said = f"link '{link}' is led no further than {100 * low:.3g} % of its way, {far}"
    stuck = _dead_centre(holding.model, state)
    if not stuck:
        return low, said
    names = " and ".join(f"'{n}'" for n in stuck)
    return low, (
        f"{said}: there {names} are at a dead centre, where '{link}' cannot move them on; ask for less, or give the pose of "
        f"'{stuck[0]}' instead"
    )


def _dead_centre(model: Model, state: Motion) -> tuple[str, ...]:
    """The links without a pose that can move at a state though hinges, supports and poses hold them, the first one most;
    empty where none can."""
    still, hung = state.copy(), {n for h in (model.said or model.scene).hinges for n in (h.a, h.b)}
    still.multiplier[:] = 0.0
    actuation = Actuation(model)
    actuation(still)
    ways = actuation.ways.reshape(model.links - 1, 6, -1).copy()
    ways[:, 3:] /= model.arrays.size
    driven = {t.link for d in (model.said or model.scene).drives for t in d.terms}
    names = model.scene.links[1:]
    free = [k for k, name in enumerate(names) if name in hung and name not in driven]
    if not free:
        return ()
    own = np.ones(6, bool)
    if model.scene.plane is not None:
        normal = np.asarray(plane_normal(model.scene.plane)) != 0.0
        own = np.append(~normal, normal)
    held = ways[free][:, own].reshape(len(free) * int(own.sum()), -1).T
    _, sizes, motions = np.linalg.svd(held)
    if len(sizes) == held.shape[1] and sizes[-1] > DEAD * sizes[0]:
        return ()
    moved = np.linalg.norm(motions[-1].reshape(len(free), -1), axis=1)
    return tuple(names[free[k]] for k in np.argsort(-moved) if moved[k] > 0.05)


def _holding(solver: Solver, model: Model, wanted: Wanted) -> tuple[Solver, dict[str, float]]:
    """The mechanism whose drives are these poses, and their values."""
    scene, found = model.said or model.scene, plane_of(model)
    axis = found.axis if isinstance(found, Plane) else None
    names = {model.node_names[i] for i in wanted} | {GROUND}
    drives, targets = [], {}
    for i, (x, R) in wanted.items():
        link, rest = model.node_names[i], tuple(model.rest.x[i].tolist())
        # a drive tells the twist about its axis, which is no component of the rotation vector
        *q, q0 = Rotation.from_matrix(R).as_quat().tolist()
        turn = np.array([2.0 * math.atan2(math.copysign(1.0, q0) * own, abs(q0)) for own in q])
        for kind, values in (("translation", x - model.rest.x[i]), ("rotation", turn)):
            for k, value in enumerate(values.tolist()):
                if axis is not None and (k == axis) != (kind == "rotation"):
                    continue
                name = f"{link}: {'r' * (kind == 'rotation')}{'xyz'[k]}"
                way = tuple(np.eye(3)[k].tolist())
                drives.append(Drive(name, (DriveTerm(1.0, kind, GROUND, link, way, rest),)))
                targets[name] = checked(value, f"pose of '{link}'")
    free = tuple(s for s in scene.supports if {n for t in s.terms for n in (t.base, t.link)} - names)
    hinges = tuple(h for h in scene.hinges if {h.a, h.b} - names)
    held = replace(scene, drives=tuple(drives), supports=free, hinges=hinges)
    made = (
        compile_given(held, model.mesh)
        if model.choice is None
        else compile_chosen(held, model.mesh, model.choice)
    )
    return Solver(made, planar=solver.planar), targets


def _balance(model: Model, state: Motion, actuation: Actuation) -> RequiredLoads:
    """What the links need at a state, and how drives and supports share it."""
    names, found = model.scene.links[1:], actuation(state)
    supports = (model.said or model.scene).supports
    return RequiredLoads(
        dict(zip(names, found.needed, strict=True)),
        dict(zip(model.drive_names, found.forces.tolist(), strict=True)),
        {s.name: f for s, f in zip(supports, found.reactions.tolist(), strict=True)},
        dict(zip(names, found.unbalanced, strict=True)),
        {name: state.x[i + 1].copy() for i, name in enumerate(names)},
        float(model.arrays.size),
    )


__all__ = ["RequiredLoads", "prescribed_pose", "required_loads"]
