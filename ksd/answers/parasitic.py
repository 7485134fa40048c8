"""Parasitic motion of a point, and the pivot shift of a joint."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.answers.nonconservative import cross_matrix
from ksd.answers.printing import PrintableAnswer, format_number
from ksd.answers.shape import point_position
from ksd.answers.stiffness import drive_coupling, node_of, point_motion
from ksd.answers.tangent import ROW_SHARE_TOLERANCE, remove_row_components, row_gradients
from ksd.checks import direction
from ksd.errors import KinematicsError, SceneError
from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.numerics.rotations import rotation_exp, rotation_log
from ksd.scene.drive import GROUND
from ksd.scene.scene import connected_links

Array = NDArray[np.float64]
CROSSING_TOLERANCE = 1e-6
"""Distance, relative to the length of the leaf springs, up to which they count as crossing in one point."""
SAME_POINT_DISTANCE = 1e-6
"""Largest distance of the point of a drive from an interface that counts as the same point, relative to that of the
interfaces."""


@dataclass(frozen=True, repr=False)
class Parasitic(PrintableAnswer):
    """Motion of a point of a link from rest that its drives do not prescribe.

    shift (3,) [m], turn (3,) [rad]: displacement and rotation vector, global axes, at `point` (3,) [m] at rest. drives:
    names of the drives whose motion is removed; linear: those of them that act on other links, whose motion of this link to
    first order at rest is removed. along (3,): the direction of the wanted displacement where the caller named it, which
    alone is removed then.
    """

    link: str
    point: Array
    shift: Array
    turn: Array
    drives: tuple[str, ...]
    linear: tuple[str, ...] = ()
    along: Array | None = None

    def _line(self) -> str:
        wanted = (
            [f"what {', '.join(self.drives)} prescribe{'s' * (len(self.drives) == 1)}"] if self.drives else []
        )
        if self.linear:
            wanted.append(f"what {', '.join(self.linear)} would move in proportion, as at rest")
        if self.along is not None:
            wanted.append(wanted_motion(self.along))
        whole = "all of its motion: no drive moves it"
        size = f"{_format_vector(self.shift, 1e3)} mm, {_format_vector(self.turn, 1e3)} mrad (x y z)"
        return f"'{self.link}' {size}, {'in addition to ' + ' and to '.join(wanted) if wanted else whole}"

    def __str__(self) -> str:
        return f"Parasitic motion: {self._line()}"


@dataclass(frozen=True, repr=False)
class PivotShift(PrintableAnswer):
    """Displacement of the pivot of a joint.

    shift (3,) [m]: of the point of interface B that is at `pivot` (3,) [m] at rest, relative to interface A, in joint axes;
    turn (3,) [rad]: rotation vector of B relative to A.
    """

    joint: str
    pivot: Array
    shift: Array
    turn: Array

    def _line(self) -> str:
        turn = _format_vector(self.turn, 180 / np.pi)
        return f"'{self.joint}' {_format_vector(self.shift, 1e3)} mm along its axes at a turn of {turn} deg"

    def __str__(self) -> str:
        return f"Pivot shift: {self._line()}"


def wanted_motion(along: Iterable[float]) -> str:
    """The wanted displacement in words; along (3,): its direction."""
    return "the wanted displacement along ({:.4g} {:.4g} {:.4g})".format(*along)


def _format_vector(values: Array, factor: float) -> str:
    """Format the components of a vector times `factor`."""
    return "(" + " ".join(format_number(factor * float(v), 4, zero=1e-9) for v in values) + ")"


def default_point(scene: Any) -> tuple[str, Any]:
    """Default link and point (3,) of questions: those of the first drive, for a joint rotation the middle of its interfaces.

    Raises SceneError where the scene has no drive.
    """
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
            and math.dist(j.place(j.joint.pose_B), term.point) < SAME_POINT_DISTANCE * j.joint.length_AB
        ):
            return j
    return None


def _middle(joint: Any) -> tuple[float, ...]:
    """The point (3,) at rest in the middle between the interfaces of a placed joint."""
    return tuple(joint.place(0.5 * np.asarray(joint.joint.pose_B, float)).tolist())


def parasitic(
    model: Model,
    motion: State,
    targets: Mapping[str, float],
    link: Any = None,
    *,
    at: Any = None,
    along: Any = None,
) -> Parasitic:
    """Motion of the point of `link` at `at` (3,) [m] at rest, without the motion that drives and supports prescribe.

    Prescribed are rotations about axes and displacements along directions, by single drives or by several together (three
    along z prescribe a lift and both tilts). The prescribed motion of a link that carries this one is removed too, as a
    rigid motion: a rotation is about the pivot of the driven joint (where its leaf springs cross, or else the middle between
    its interfaces), or about the point of the drive. Drives of legs, which hold this link together with others, prescribe
    nothing of it: removed is the motion that they, at `targets` by name [m or rad], would cause if it stayed in proportion
    to them as at rest. along: direction of the wanted displacement, "x", "y", "z" or a vector, global; then the displacement
    along it alone is removed. Default: link and point of the first drive. Raises SceneError for an unknown link or a wrong
    direction, or where there is neither a link nor a drive.
    """
    if link is None:
        link, point = default_point(model.scene)
        at = point if at is None else at
    node = node_of(model, link)
    here, _ = point_motion(model, motion, node, at)
    point = model.rest.x[node] if at is None else np.asarray(at, float)
    if along is not None:
        wanted, turned = np.asarray(direction(along, "along")), np.empty(3)
        rotation_log(motion.R[node], turned)
        moved = here - point
        shift = moved - wanted * (wanted @ moved)
        return Parasitic(model.node_names[node], point, shift, turned, (), along=wanted)
    cuts = _carrying_links(model.scene, model.node_names[node])
    driven = {name for d in model.scene.drives for t in d.terms for name in (t.base, t.link)}
    carriers = [model.node_names.index(name) for name in cuts if name in driven]
    frames = [0, *carriers, node]
    drives: set[str] = set()
    linear: set[str] = set()
    shift, turn, before = np.zeros(3), np.zeros(3), point
    for base, end in pairwise(frames):
        now = point_position(model, motion, end, point)
        moved, turned = now - before, np.empty(3)
        rotation_log(motion.R[end] @ motion.R[base].T, turned)
        axes, about, acting = _prescribed_motion(model, motion, base, end, now)
        own = about @ (about.T @ turned)
        pivot = _pivot(model.scene, acting, carried=end != node)
        if pivot is not None:
            arm = before - point_position(model, motion, base, pivot)
            Q = np.empty((3, 3))
            rotation_exp(own, Q)
            moved -= Q @ arm - arm
        moved, turned, before = moved - axes @ (axes.T @ moved), turned - own, now
        drives.update(acting)
        legs = _leg_drives(model.scene, cuts, model.node_names[node]) - drives
        if legs and end == node and not acting:
            # where a motion has no stiffness at rest, there is no first-order motion
            with suppress(KinematicsError):
                shifted, tilted = _motion_in_proportion(model, node, point, targets, legs)
                shifted, tilted = motion.R[base] @ shifted, motion.R[base] @ tilted
                moved, turned = moved - shifted, turned - tilted
                linear = legs
                drives.update(legs)
        shift, turn = shift + moved, turn + turned
    if carriers:
        axes, about, acting = _prescribed_motion(model, motion, 0, node, here)
        shift, turn = shift - axes @ (axes.T @ shift), turn - about @ (about.T @ turn)
        drives.update(acting)
    named, proportional = (tuple(n for n in model.drive_names if n in names) for names in (drives, linear))
    return Parasitic(model.node_names[node], point, shift, turn, named, proportional)


def _carrying_links(scene: Any, link: str) -> list[str]:
    """Links without which `link` would not be connected to ground, in order from ground."""
    # a link connected on both sides, also through a slider, is carried by neither
    next_to, after = scene.neighbours(hinges=True), {}
    for one in set(scene.links) - {GROUND, link}:
        found = connected_links(next_to, GROUND, [one])
        if link in next_to and link not in found:
            # the fewer links stay connected to ground without it, the nearer to ground it is
            after[one] = len(found)
    return sorted(after, key=lambda name: after[name])


def _leg_drives(scene: Any, cuts: list[str], link: str) -> set[str]:
    """Drives of links between `link` and its carriers that stay connected to ground without `link`."""
    next_to = scene.neighbours(hinges=True)
    legs = connected_links(next_to, link, [GROUND, *cuts]) & connected_links(next_to, GROUND, [link])
    return {d.name for d in scene.drives if any({t.base, t.link} & legs for t in d.terms)}


def _motion_in_proportion(
    model: Model, node: int, point: Array, targets: Mapping[str, float], drives: set[str]
) -> tuple[Array, Array]:
    """Displacement and rotation vector (3,) of a point of a node by `drives` at `targets`, to first order at rest."""
    motions = drive_coupling(model, model.rest, model.node_names[node], at=point, load_factor=0.0)
    total = sum((targets[n] * w for n, w in motions.items() if n in drives), np.zeros(6))
    return total[:3], total[3:]


def _prescribed_motion(
    model: Model, motion: State, base: int, end: int, position: Array
) -> tuple[Array, Array, tuple[str, ...]]:
    """Directions and axes of the prescribed motion of a point of node `end`, at `position` (3,), relative to node `base`.

    Returns orthonormal columns (3, k) of prescribed displacements, of prescribed rotations, and the names of the drives.
    """
    loads = np.zeros((model.arrays.plan.unknowns, 6))
    for node, sign in ((end, 1.0), (base, -1.0)):
        if node:
            s, start = position - motion.x[node], int(model.arrays.start[node])
            loads[start : start + 6] = sign * np.eye(6)
            loads[start + 3 : start + 6, :3] = sign * cross_matrix(s)
    rows = len(model.drive_names) + len(model.support_names)
    scale = np.array([1.0] * 3 + [1.0 / model.arrays.size] * 3)
    gradients = row_gradients(model.arrays, motion, range(rows))
    rest, share = remove_row_components(model.arrays, model.arrays.size, gradients, loads * scale)
    # combinations of forces and moments carried entirely by rows: the corresponding motion is prescribed
    _, size, axes = np.linalg.svd(rest / np.linalg.norm(loads * scale, axis=0).max())
    taken = axes[np.append(size, np.zeros(6 - len(size))) < ROW_SHARE_TOLERANCE].T
    acts = np.abs(share @ taken).max(axis=1, initial=0.0)
    drives = tuple(
        n for n, a in zip(model.drive_names, acts, strict=False) if a > ROW_SHARE_TOLERANCE * acts.max()
    )
    return _column_space(taken[:3]), _column_space(taken[3:] @ _null_space(taken[:3])), drives


def _pivot(scene: Any, drives: tuple[str, ...], *, carried: bool) -> Array | None:
    """Point (3,) at rest about which `drives` rotate a link; None for the point in question itself.

    carried: they rotate a link that carries the one in question.
    """
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
    """Shift of the pivot of a joint: of the point of B that is at `at` (3,) [m, global, at rest], relative to A.

    Default: the point where its leaves, or their extensions, cross as seen along the axis; where they do not all cross in
    one point, the middle between the interfaces. Raises SceneError for an unknown joint or one without intended rotation.
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
    """Pivot (3,) at rest of a placed joint, global axes, see `_leaf_crossing`."""
    return np.asarray(placed.place(_leaf_crossing(placed)))


def _leaf_crossing(placed: Any) -> Array:
    """Point (3,), in joint axes, where the lines of all leaves cross as seen along the axis of the (first) rotation.

    Its coordinate along the axis is that of the middle between the interfaces, which is returned where they do not cross.
    """
    middle = 0.5 * np.asarray(placed.joint.pose_B, float)
    axis = next(np.asarray(m.axis) for m in placed.joint.motions if m.kind == "rotation")
    plane = np.linalg.svd(axis[None])[2][1:]
    lines = [(plane @ np.asarray(f.start), plane @ np.asarray(f.end)) for f in placed.joint.leaves()]
    lines = [(p, q) for p, q in lines if np.linalg.norm(q - p) > 0.0]
    if not lines:
        return middle
    normals = np.array([np.array([p[1] - q[1], q[0] - p[0]]) / np.linalg.norm(q - p) for p, q in lines])
    offsets = np.einsum("ki,ki->k", normals, np.array([p for p, _ in lines]))
    point, _, rank, _ = np.linalg.lstsq(normals, offsets, rcond=1e-6)
    size = max(float(np.linalg.norm(q - p)) for p, q in lines)
    if rank < 2 or np.abs(normals @ point - offsets).max() > CROSSING_TOLERANCE * size:
        return middle
    return np.asarray(plane.T @ point + axis * (axis @ middle))
