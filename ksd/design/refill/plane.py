"""The arrays of many planar designs at once, from the spatial ones: what `ksd.model.planar_pack` and
`ksd.bodies.planar_bodies` make of one design.

Arrays are named by where they stand in the storage of the planar five steps (`ksd.solve.planar_steps.PlanarSet`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ksd.bodies.joints import JointBodies
from ksd.bodies.planar_bodies import SMALL, inner_functions, monomial_reach, near_functions
from ksd.design.refill.drawing import Numbers
from ksd.design.refill.scales import Table, inner_table, scales, value_table
from ksd.design.refill.space import Filled, Space
from ksd.model.arrays import ROTATION, Arrays
from ksd.model.planar_lift import inner_copies
from ksd.model.plane import PARALLEL, Plane
from ksd.solve.five import FiveSteps
from ksd.solve.planar_steps import PlanarSteps

TWIN = 1e-11
"""Difference, over the size and in angle, below which members coincide in the plane."""
LOCAL = np.array([np.eye(3), np.diag([1.0, -1.0, -1.0])])
"""Axes i, j, k of the plane in the axes of a joint whose z is k, or -k."""


@dataclass(frozen=True)
class Side:
    """The members of one mechanism in the plane: axes (m, 3, 3) as columns, sense (m,) of their e3, alike (m,): equal for
    equal constants and nodes; first (p,): the spatial member each planar one is made of, twin (m,): the reverse;
    times (p,)."""

    axes: np.ndarray
    sense: np.ndarray
    alike: np.ndarray
    first: np.ndarray
    twin: np.ndarray
    times: np.ndarray

    def seen(self, offset: np.ndarray, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Offsets (D, m, 2, 2) and angles (D, m, 2) of members (D, m, 2, 3), (D, m, 2, 3, 3) in the plane."""
        e1 = frame[..., 0] @ self.axes
        return offset @ self.axes[:, :, :2], np.arctan2(e1[..., 1], e1[..., 0])

    def fits(self, offset: np.ndarray, frame: np.ndarray, size: np.ndarray) -> np.ndarray:
        """(D,): whether the widths are along the normal, on the same side, and the same members coincide."""
        e3 = frame[..., 2] @ self.axes
        good = (np.linalg.norm(e3[..., :2], axis=-1) <= PARALLEL).all(axis=(1, 2))
        good &= (e3[:, :, 0, 2] * self.sense > 0.0).all(axis=1)
        place, angle = self.seen(offset, frame)
        i, h = np.triu_indices(len(self.alike), 1)
        same = self.alike[i] == self.alike[h]
        i, h = i[same], h[same]
        off = np.abs(place[:, i] - place[:, h]).max(axis=(2, 3)) / size[:, None]
        near = (off < TWIN) & (np.abs(angle[:, i] - angle[:, h]).max(axis=2) < TWIN)
        return good & (near == (self.twin[i] == self.twin[h])).all(axis=1)


def side_of(arrays: Arrays, axes: np.ndarray) -> Side:
    """How the members of `arrays` are seen in planes of axes (m, 3, 3)."""
    members = arrays.members
    table: dict[tuple, int] = {}
    sense = np.sign(np.einsum("mr,mr->m", members.frame[:, 0, :, 2], axes[:, :, 2]))
    alike = []
    for i in range(len(sense)):
        key = (int(members.kind[i]), *members.node[i].tolist(), int(members.value_at[i]), float(sense[i]))
        alike.append(table.setdefault(key, len(table)))
    blank = Side(axes, sense, np.array(alike), np.zeros(0), np.zeros(0), np.zeros(0))
    place, angle = blank.seen(members.offset[None], members.frame[None])
    first: list[int] = []
    twin: list[int] = []
    for i in range(len(sense)):
        for p, h in enumerate(first):
            close = np.abs(place[0, i] - place[0, h]).max() / arrays.size < TWIN
            if alike[i] == alike[h] and close and np.abs(angle[0, i] - angle[0, h]).max() < TWIN:
                twin.append(p)
                break
        else:
            twin.append(len(first))
            first.append(i)
    return replace(blank, first=np.array(first), twin=np.array(twin), times=np.bincount(twin).astype(float))


class Flat:
    """How the planar arrays of a model come from the spatial ones."""

    def __init__(self, five: FiveSteps, plane: Plane, steps: PlanarSteps, space: Space, own: Numbers) -> None:
        model, bodies = five.model, five.bench.bodies
        self.axes, self.row, self.top = plane.lifting.axes, plane.lifting.row, space.top
        self.kinds = model.arrays.terms.kind
        made, inside = steps.bodies, bodies.inside
        across = bodies.loops.frame.transpose(0, 2, 1) @ self.axes[:, 2]
        self.flip = np.sign(across[:, 2])
        self.owner = inside.block_joint
        joint = self.top.member[:, 0]
        count = len(joint)
        self.full = side_of(model.arrays, np.broadcast_to(self.axes, (count, 3, 3)))
        self.bench = side_of(bodies.bench, LOCAL[(self.flip[joint] < 0).astype(int)])
        scale = scales(own.leaf, model.mesh, space.counts)[0]
        self._tables(made.full, made.bench, (steps.start.full.inner, steps.start.bench.inner), scale)
        self._functions(bodies, made.bench)
        first = model.arrays.terms.first
        spans = [range(int(first[r]), int(first[r + 1])) for r in range(len(first) - 1)]
        self.inside_rows = np.array([t for r in self.row for t in spans[r]], np.int64)
        self.outside_rows = np.setdiff1d(np.arange(first[-1]), self.inside_rows)

    def _tables(
        self, full: Arrays, bench: Arrays, inner: tuple[np.ndarray, np.ndarray], scale: np.ndarray
    ) -> None:
        self.values: dict[str, Table] = {}
        self.inners: dict[str, Table] = {}
        for name, arrays, side, rest in (
            ("full", full, self.full, inner[0]),
            ("bench", bench, self.bench, inner[1]),
        ):
            leafs = self.top.member[side.first, 1]
            self.values[name] = value_table(arrays.members, leafs, scale, side.times, flat=True)
            self.inners[name] = inner_table(arrays.members, leafs, rest, scale, flat=True)

    def _functions(self, bodies: JointBodies, bench: Arrays) -> None:
        """Which spatial function every planar one is, and its factor: read off unit functions."""
        inside, side = bodies.inside, self.bench
        copies = inner_copies(bodies.bench.members, bench.members, side.twin, side.sense)
        marked = inside._replace(
            coefficient=np.eye(len(inside.coefficient)), near_coefficient=np.eye(len(inside.near_coefficient))
        )
        unit = replace(bodies, inside=marked)
        self.maps = {
            "coefficient": inner_functions(unit, copies)[2],
            "near_coefficient": near_functions(unit, bench, side.twin, side.sense)[2],
        }
        self.reach = monomial_reach(bodies)

    def fits(self, n: Numbers, filled: Filled) -> np.ndarray:
        """(D,): whether a design lies in the same plane in the same way; others are prepared afresh."""
        k = self.axes[:, 2]
        good = np.ones(len(n.origin), bool)
        for name, side in (("full", self.full), ("bench", self.bench)):
            head = f"bodies.{name}"
            parts = (
                filled[f"{head}.members.offset"],
                filled[f"{head}.members.frame"],
                filled[f"{head}.size"],
            )
            good &= side.fits(*parts)
        across = np.swapaxes(n.rotation, 2, 3) @ k
        good &= (np.abs(across[..., :2]).max(axis=(1, 2)) <= 1e-9) & (across[..., 2] * self.flip > 0.0).all(
            axis=1
        )
        along, beside = _shares(n.terms[..., 1:4], k)
        turning = self.kinds == ROTATION
        inside = np.where(turning, beside, along) <= PARALLEL
        outside = np.where(turning, along, beside) <= PARALLEL
        good &= inside[:, self.inside_rows].all(axis=1) & outside[:, self.outside_rows].all(axis=1)
        loads = n.loads[:, self.top.load_kept]
        push, turn = loads[..., 3:6], loads[..., 6:9]
        good &= (np.abs(push @ k) <= PARALLEL * np.linalg.norm(push, axis=2)).all(axis=1)
        aside = np.linalg.norm(np.cross(turn, k), axis=2)
        good &= (aside <= PARALLEL * np.linalg.norm(turn, axis=2)).all(axis=1)
        poses = (
            (filled["bodies.loops.pose"], self.reach),
            (filled["bodies.inside.block_pose"], self.reach[self.owner]),
        )
        for functions, reach in poses:
            leaving = np.abs(functions[:, :, [0, 1, 5]] * reach[:, None]).sum(axis=3)
            good &= leaving.reshape(len(good), -1).max(axis=1, initial=0.0) <= SMALL
        return good

    def __call__(self, filled: Filled, scale: np.ndarray) -> Filled:
        """The planar arrays by their place, each with D first; "height" besides, the nodes' along the normal."""
        ij, x = self.axes[:, :2], filled["rest.full.x"]
        pose = np.concatenate([x @ ij, np.zeros((*x.shape[:2], 1))], axis=2)
        links = len(self.top.attached)
        found: Filled = {
            "height": x @ self.axes[:, 2],
            "rest.full.pose": pose,
            "rest.reduced.pose": pose[:, :links],
        }
        for name, side in (("full", self.full), ("bench", self.bench)):
            found |= self._side(name, side, filled, scale)
        found |= self._links(filled)
        found["rest.bench.pose"] = self._bench_pose(filled["rest.bench.x"])
        for name, matrix in self.maps.items():
            found[f"bodies.inside.{name}"] = np.einsum("ts,dsm->dtm", matrix, filled[f"bodies.inside.{name}"])
        blocks = filled["bodies.inside.block_pose"]
        found["bodies.inside.block_pose"] = _turned_poses(blocks, self.flip[self.owner])
        return found

    def _side(self, name: str, side: Side, filled: Filled, scale: np.ndarray) -> Filled:
        head = f"bodies.{name}.members"
        offset, angle = side.seen(filled[f"{head}.offset"], filled[f"{head}.frame"])
        return {
            f"{head}.offset": offset[:, side.first],
            f"{head}.frame": angle[:, side.first],
            f"{head}.length": filled[f"{head}.length"][:, side.first],
            f"{head}.floor": filled[f"{head}.floor"][:, side.first] * side.times,
            f"{head}.value": self.values[name](scale),
            f"bodies.{name}.size": filled[f"bodies.{name}.size"],
            f"rest.{name}.inner": self.inners[name](scale),
        }

    def _links(self, filled: Filled) -> Filled:
        """Condensed joints, rows and loads in the plane."""
        ij, loops = self.axes[:, :2], filled["bodies.loops.frame"]
        e1 = loops[..., 0] @ self.axes
        angle = np.arctan2(e1[..., 1], e1[..., 0])
        offset = filled["bodies.loops.anchor"] @ ij
        found = {
            "bodies.loops.anchor": offset,
            "bodies.loops.frame": angle,
            "bodies.loops.length": filled["bodies.loops.length"],
            "bodies.loops.pose": _turned_poses(filled["bodies.loops.pose"], self.flip),
            "bodies.reduced.size": filled["bodies.reduced.size"],
            "bodies.reduced.members.offset": offset,
            "bodies.reduced.members.frame": np.stack([angle, angle], axis=2),
        }
        for name in ("length", "floor"):
            found[f"bodies.reduced.members.{name}"] = filled[f"bodies.reduced.members.{name}"]
        for which in ("full", "reduced"):
            found |= self._rows(f"bodies.{which}", filled)
        return found

    def _rows(self, head: str, filled: Filled) -> Filled:
        keep, ij, k = self.inside_rows, self.axes[:, :2], self.axes[:, 2]
        along = filled[f"{head}.terms.direction"][:, keep] @ self.axes
        turning = np.stack([along[..., 2], 0.0 * along[..., 2]], axis=-1)
        direction = np.where((self.kinds[keep] == ROTATION)[:, None], turning, along[..., :2])
        return {
            f"{head}.terms.coefficient": filled[f"{head}.terms.coefficient"][:, keep],
            f"{head}.terms.direction": direction,
            f"{head}.terms.point": filled[f"{head}.terms.point"][:, keep] @ ij,
            f"{head}.loads.point": filled[f"{head}.loads.point"] @ ij,
            f"{head}.loads.force": filled[f"{head}.loads.force"] @ ij,
            f"{head}.loads.moment": filled[f"{head}.loads.moment"] @ k,
        }

    def _bench_pose(self, x: np.ndarray) -> np.ndarray:
        """Interfaces and blocks at rest in the plane of their joint."""
        flipped = np.concatenate([[1.0], self.flip[self.top.block[:, 0]], self.flip])
        return np.stack([x[..., 0], flipped * x[..., 1], 0.0 * x[..., 0]], axis=-1)


def _turned_poses(functions: np.ndarray, flip: np.ndarray) -> np.ndarray:
    """(D, J, 3, M): rotation and chord in the plane of functions (D, J, 6, M)."""
    found = functions[:, :, [2, 3, 4]].copy()
    found[:, :, [0, 2]] *= flip[:, None, None]
    return found


def _shares(direction: np.ndarray, k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Parts of unit directions (D, t, 3) along k and across it."""
    return np.abs(direction @ k), np.linalg.norm(np.cross(direction, k), axis=-1)


def stays_in_plane(
    n: Numbers, frames: np.ndarray, kinds: np.ndarray, drives: Sequence[int], kept: np.ndarray
) -> np.ndarray:
    """(D,): whether widths, rows and loads of a design lie in one plane, so that it might have planar five steps.

    frames (D, m, 2, 3, 3): axes of all leafs; kinds (t,) of the terms; drives: terms of drives; kept: loads that act.
    """
    k = frames[:, 0, 0, :, 2]
    good = (np.linalg.norm(np.cross(frames[..., 2], k[:, None, None]), axis=-1) <= PARALLEL).all(axis=(1, 2))
    along = np.abs(np.einsum("dtr,dr->dt", n.terms[..., 1:4], k))
    beside = np.linalg.norm(np.cross(n.terms[..., 1:4], k[:, None]), axis=-1)
    inside = np.where(kinds == ROTATION, beside, along) <= PARALLEL
    outside = np.where(kinds == ROTATION, along, beside) <= PARALLEL
    good &= inside[:, list(drives)].all(axis=1) & (inside | outside).all(axis=1)
    push, turn = n.loads[:, kept, 3:6], n.loads[:, kept, 6:9]
    good &= (np.abs(np.einsum("dlr,dr->dl", push, k)) <= PARALLEL * np.linalg.norm(push, axis=2)).all(axis=1)
    aside = np.linalg.norm(np.cross(turn, k[:, None]), axis=2)
    return np.asarray(good & (aside <= PARALLEL * np.linalg.norm(turn, axis=2)).all(axis=1))
