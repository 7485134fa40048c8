"""Parasitic motion of a point, and the pivot shift of a joint."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.errors import KinematicsError, SceneError
from ksd.model.arrays import ROTATION, State
from ksd.model.compile import Model
from ksd.numerics.rotations import rotation_exp, rotation_log
from ksd.properties.nonconservative import cross_matrix
from ksd.properties.printing import PrintableAnswer, format_number
from ksd.properties.shape import point_position
from ksd.properties.stiffness import drive_coupling, node_of, point_motion
from ksd.properties.tangent import ROW_SHARE_TOLERANCE, remove_row_components, row_gradients
from ksd.scene.drive import GROUND
from ksd.scene.scene import connected_links

Array = NDArray[np.float64]
MIN_DRIVEN_MOTION = 1e-2
"""Motion, over the largest that a drive brings a link, below which drives only strain what holds it."""
CROSSING_TOLERANCE = 1e-6
"""Distance, over the size of a joint, up to which its leaf springs count as crossing in one point."""
SAME_POINT_DISTANCE = 1e-7
"""Distance [m] of the point of a drive from an interface, up to which it is that interface."""


@dataclass(frozen=True, repr=False)
class Parasitic(PrintableAnswer):
    """Motion of a point of a link from rest that its drives do not prescribe: shift (3,) [m] and turn (3,) [rad, rotation
    vector], global axes, at `point` (3,) [m] at rest. drives: what they prescribe is taken out."""

    link: str
    point: Array
    shift: Array
    turn: Array
    drives: tuple[str, ...]

    def _line(self) -> str:
        beside = f"beside what {', '.join(self.drives)} prescribe{'s' * (len(self.drives) == 1)}"
        size = f"{_format_vector(self.shift, 1e3)} mm, {_format_vector(self.turn, 1e3)} mrad (x y z)"
        return f"'{self.link}' {size}, {beside if self.drives else 'all of its motion: no drive acts on it alone'}"

    def __str__(self) -> str:
        return f"Parasitic motion: {self._line()}"


@dataclass(frozen=True, repr=False)
class PivotShift(PrintableAnswer):
    """How far the pivot of a joint has moved: shift (3,) [m] of the point of interface B that is at `pivot` (3,) [m] at
    rest, seen from interface A, in joint axes; turn (3,) [rad], rotation vector of B in A."""

    joint: str
    pivot: Array
    shift: Array
    turn: Array

    def _line(self) -> str:
        turn = _format_vector(self.turn, 180 / np.pi)
        return f"'{self.joint}' {_format_vector(self.shift, 1e3)} mm along its axes at a turn of {turn} deg"

    def __str__(self) -> str:
        return f"Pivot shift: {self._line()}"


def _format_vector(values: Array, factor: float) -> str:
    return "(" + " ".join(format_number(factor * float(v), 4, zero=1e-9) for v in values) + ")"


def default_point(scene: Any) -> tuple[str, Any]:
    """Link and point (3,) asked about where none is named: those of the first drive; for the turn of a joint the middle
    between its interfaces. Raises SceneError when the scene has no drive to take them from."""
    if not scene.drives:
        raise SceneError("name a link: this mechanism has no drive whose point could be asked about")
    term = scene.drives[0].terms[0]
    joint = _turned_joint(scene, term)
    return term.link, term.point if joint is None else _middle(joint)


def _turned_joint(scene: Any, term: Any) -> Any:
    """The joint whose rotation a drive term prescribes, or None."""
    for j in scene.joints:
        pair = {j.a, j.b} == {term.base, term.link}
        if (
            pair
            and term.kind == "rotation"
            and math.dist(j.place(j.joint.pose_B), term.point) < SAME_POINT_DISTANCE
        ):
            return j
    return None


def _middle(joint: Any) -> tuple[float, ...]:
    """The point (3,) at rest in the middle between the interfaces of a placed joint."""
    return tuple(joint.place(0.5 * np.asarray(joint.joint.pose_B, float)).tolist())


def parasitic(model: Model, motion: State, link: Any = None, *, at: Any = None) -> Parasitic:
    """Motion of the point of `link` at `at` (3,) [m] at rest, less what drives and supports prescribe there: rotations about
    prescribed axes, displacements along prescribed directions, each by one drive or by several together (three along z
    prescribe a lift and both tilts). What drives prescribe of a link that carries this one is taken out too: it moves this
    one along rigidly; a rotation turns it about the pivot of the joint driven, where its leaf springs cross or else the
    middle between its interfaces, or about the point of the drive. Where none
    acts on this link, but on legs that hold it beside others, the motions they bring it to first order, from rest, are
    taken out, rotations times the size. By default link and point of the first drive.

    Raises SceneError for an unknown link, or where there is no drive and none is named.
    """
    if link is None:
        link, point = default_point(model.scene)
        at = point if at is None else at
    node = node_of(model, link)
    here, _ = point_motion(model, motion, node, at)
    point = model.rest.x[node] if at is None else np.asarray(at, float)
    cuts = _carrying_links(model.scene, model.node_names[node])
    driven = {name for d in model.scene.drives for t in d.terms for name in (t.base, t.link)}
    carriers = [model.node_names.index(name) for name in cuts if name in driven]
    frames = [0, *carriers, node]
    drives: set[str] = set()
    shift, turn, before = np.zeros(3), np.zeros(3), point
    for base, end in pairwise(frames):
        now = point_position(model, motion, end, point)
        moved, turned = now - before, np.empty(3)
        rotation_log(motion.R[end] @ motion.R[base].T, turned)
        along, about, acting = _prescribed_motion(model, motion, base, end, now)
        own = about @ (about.T @ turned)
        pivot = _pivot(model.scene, acting, carried=end != node)
        if pivot is not None:
            arm = before - point_position(model, motion, base, pivot)
            Q = np.empty((3, 3))
            rotation_exp(own, Q)
            moved -= Q @ arm - arm
        moved, turned, before = moved - along @ (along.T @ moved), turned - own, now
        drives.update(acting)
        legs = _leg_drives(model.scene, cuts, model.node_names[node]) - drives
        if legs and end == node and not acting:
            # where nothing resists a motion at rest, nothing is known to first order
            with suppress(KinematicsError):
                moved, turned = _remove_leg_motion(model, node, point, motion.R[base], legs, (moved, turned))
                drives.update(legs)
        shift, turn = shift + moved, turn + turned
    if carriers:
        along, about, acting = _prescribed_motion(model, motion, 0, node, here)
        shift, turn = shift - along @ (along.T @ shift), turn - about @ (about.T @ turn)
        drives.update(acting)
    named = tuple(n for n in model.drive_names if n in drives)
    return Parasitic(model.node_names[node], point, shift, turn, named)


def _carrying_links(scene: Any, link: str) -> list[str]:
    """Links without which `link` would not hang on ground, in order from ground."""
    # what hangs on both sides, through a slider too, is carried by neither
    next_to, after = scene.neighbours(hinges=True), {}
    for one in set(scene.links) - {GROUND, link}:
        found = connected_links(next_to, GROUND, [one])
        if link in next_to and link not in found:
            # the fewer links are left without it, the farther out it is
            after[one] = len(found)
    return sorted(after, key=lambda name: after[name])


def _leg_drives(scene: Any, cuts: list[str], link: str) -> set[str]:
    """Drives of links between `link` and what carries it that hang there without it too."""
    next_to = scene.neighbours(hinges=True)
    legs = connected_links(next_to, link, [GROUND, *cuts]) & connected_links(next_to, GROUND, [link])
    return {d.name for d in scene.drives if any({t.base, t.link} & legs for t in d.terms)}


def _remove_leg_motion(
    model: Model, node: int, point: Array, R: Array, legs: set[str], moved: tuple[Array, Array]
) -> tuple[Array, Array]:
    """A displacement and a rotation (3,) of a node less their part in the motions that the drives in `legs` bring its
    `point` from rest, turned by R (3, 3)."""
    arrays, ways = (
        model.arrays,
        drive_coupling(model, model.rest, model.node_names[node], at=point, load_factor=0.0),
    )
    size = np.repeat([1.0, arrays.size], 3)
    turns = arrays.terms.kind[arrays.terms.first[:-1]] == ROTATION
    columns = np.stack([
        size * np.concatenate([R @ w[:3], R @ w[3:]]) / (arrays.size if turn else 1.0)
        for (n, w), turn in zip(ways.items(), turns, strict=False) if n in legs
    ], axis=1)  # fmt: skip
    axes, share, _ = np.linalg.svd(columns, full_matrices=False)
    axes = axes[:, share > MIN_DRIVEN_MOTION * share[0]]
    whole = np.concatenate(moved) * size
    left = (whole - axes @ (axes.T @ whole)) / size
    return left[:3], left[3:]


def _prescribed_motion(
    model: Model, motion: State, base: int, end: int, place: Array
) -> tuple[Array, Array, tuple[str, ...]]:
    """Orthonormal columns (3, k) along which, and about which, rows prescribe the motion of the point of node `end` that is
    at `place` (3,) over node `base`, and the drives that do."""
    loads = np.zeros((model.arrays.plan.unknowns, 6))
    for node, sign in ((end, 1.0), (base, -1.0)):
        if node:
            s, start = place - motion.x[node], int(model.arrays.start[node])
            loads[start : start + 6] = sign * np.eye(6)
            loads[start + 3 : start + 6, :3] = sign * cross_matrix(s)
    rows = len(model.drive_names) + len(model.support_names)
    scale = np.array([1.0] * 3 + [1.0 / model.arrays.size] * 3)
    gradients = row_gradients(model.arrays, motion, range(rows))
    left, share = remove_row_components(model.arrays, model.arrays.size, gradients, loads * scale)
    # combinations of forces and moments that rows take whole: their motion is prescribed
    _, size, axes = np.linalg.svd(left / np.linalg.norm(loads * scale, axis=0).max())
    taken = axes[np.append(size, np.zeros(6 - len(size))) < ROW_SHARE_TOLERANCE].T
    acts = np.abs(share @ taken).max(axis=1, initial=0.0)
    drives = tuple(
        n for n, a in zip(model.drive_names, acts, strict=False) if a > ROW_SHARE_TOLERANCE * acts.max()
    )
    return _column_space(taken[:3]), _column_space(taken[3:] @ _null_space(taken[:3])), drives


def _pivot(scene: Any, drives: tuple[str, ...], *, carried: bool) -> Array | None:
    """The point (3,) at rest that what drives turn turns about; None: the point asked about. carried: they turn a link
    that carries the one asked about."""
    terms = [t for d in scene.drives if d.name in drives for t in d.terms]
    if carried and terms and all(t.kind == "translation" for t in terms):
        return np.mean([t.point for t in terms], axis=0)
    joints = [(t, _turned_joint(scene, t)) for t in terms if t.kind == "rotation"]
    points = [t.point if j is None else _pivot_at_rest(j) for t, j in joints if carried or j is not None]
    return np.mean(points, axis=0) if points else None


def _null_space(A: Array) -> Array:
    """Orthonormal columns of the null space of A (3, k)."""
    _, size, axes = np.linalg.svd(A)
    return axes[int(np.sum(size > ROW_SHARE_TOLERANCE)) :].T


def _column_space(A: Array) -> Array:
    """Orthonormal columns of the span of the columns of A (3, k)."""
    axes, size, _ = np.linalg.svd(A)
    return np.asarray(axes[:, : int(np.sum(size > ROW_SHARE_TOLERANCE))])


def pivot_shift(model: Model, motion: State, joint: Any, *, at: Any = None) -> PivotShift:
    """Shift of the pivot of a joint that turns: of the point of B that is at `at` (3,) [m, global, at rest], seen from A,
    in joint axes. By default the point its leaves, or their extensions, cross in, seen along the axis; where they do not
    all cross in one, the middle between the interfaces.

    Raises SceneError for an unknown joint or one whose intended motion is not a rotation.
    """
    name = getattr(joint, "name", joint)
    placed = next((j for j in model.scene.joints if j.name == name), None)
    if placed is None:
        known = ", ".join(j.name for j in model.scene.joints) or "none"
        raise SceneError(f"joint '{name}' is not part of this mechanism; its joints are {known}")
    if not any(m.kind == "rotation" for m in placed.joint.motions):
        raise SceneError(
            f"joint '{name}' has no intended rotation, so no pivot; ask `parasitic` for its motion"
        )
    turned = np.asarray(placed.rotation)
    rest = _pivot_at_rest(placed) if at is None else np.asarray(at, float)
    a, b = (model.node_names.index(link) for link in (placed.a, placed.b))
    moved = [point_position(model, motion, k, rest) for k in (a, b)]
    turn = np.empty(3)
    rotation_log(motion.R[a].T @ motion.R[b], turn)
    shift = turned.T @ motion.R[a].T @ (moved[1] - moved[0])
    return PivotShift(placed.name, rest, shift, turned.T @ turn)


def _pivot_at_rest(placed: Any) -> Array:
    """The point (3,) at rest that a placed joint turns about: where its leaf springs cross."""
    return np.asarray(placed.place(_leaf_crossing(placed)))


def _leaf_crossing(placed: Any) -> Array:
    """The point (3,), in joint axes, that the lines of all leaves pass seen along the axis of the (first) rotation, at the
    height of the middle between the interfaces; that middle where they do not."""
    middle = 0.5 * np.asarray(placed.joint.pose_B, float)
    axis = next(np.asarray(m.axis) for m in placed.joint.motions if m.kind == "rotation")
    across = np.linalg.svd(axis[None])[2][1:]
    lines = [(across @ np.asarray(f.start), across @ np.asarray(f.end)) for f in placed.joint.leaves()]
    lines = [(p, q) for p, q in lines if np.linalg.norm(q - p) > 0.0]
    if not lines:
        return middle
    normals = np.array([np.array([p[1] - q[1], q[0] - p[0]]) / np.linalg.norm(q - p) for p, q in lines])
    wanted = np.einsum("ki,ki->k", normals, np.array([p for p, _ in lines]))
    point, _, rank, _ = np.linalg.lstsq(normals, wanted, rcond=1e-6)
    size = max(float(np.linalg.norm(q - p)) for p, q in lines)
    if rank < 2 or np.abs(normals @ point - wanted).max() > CROSSING_TOLERANCE * size:
        return middle
    return np.asarray(across.T @ point + axis * (axis @ middle))
