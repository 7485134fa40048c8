"""Interface forces: what joints, free leafs and springs exert on the links they are clamped to, ground included.

A leaf passes on the wrench at its ends; those of a joint are summed about its interface. On every link they balance
loads, drives, supports and weight.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.errors import SceneError
from ksd.model.arrays import Motion
from ksd.model.compile import Model
from ksd.numerics.rotations import rotation_exp
from ksd.properties.section_forces import end_wrenches, section_forces
from ksd.properties.shape import member_ends, members_of_leafs
from ksd.properties.springs import energy_of_spring
from ksd.properties.words import Shown, listed, number

Array = NDArray[np.float64]
STEP = 1e-4
"""Step of the differences that give spring forces, over the length of a spring."""
NOISE = 1e-9
"""Amounts below this fraction of the largest force are rounding."""
LIGHT = 1e-6
"""Change of the force along a leaf, over the force, up to which it counts as one without weight."""


@dataclass(frozen=True, repr=False)
class InterfaceForce(Shown):
    """What one joint, leaf or spring exerts on one link: force (3,) [N], moment (3,) [Nm] about `point` (3,) [m], the
    place of the interface or end now; global axes."""

    name: str
    link: str
    point: Array
    force: Array
    moment: Array

    def _line(self) -> str:
        force, moment = (
            " ".join(number(float(v), 4, zero=NOISE * float(np.abs(part).max())) for v in part)
            for part in (self.force, self.moment)
        )
        return f"'{self.name}' on '{self.link}': {force} N, {moment} Nm"


@dataclass(frozen=True, repr=False)
class InterfaceForces(Shown):
    """All of them, in the order of the scene: joints, free leafs, springs; two rows each.

    size [m]: length by which moments and forces are compared.
    """

    rows: tuple[InterfaceForce, ...]
    size: float

    def _line(self) -> str:
        most = max(self.rows, key=lambda row: float(np.linalg.norm(row.force)))
        return f"{len(self.rows)} interfaces, at most {number(float(np.linalg.norm(most.force)))} N, of '{most.name}'"

    @property
    def listing(self) -> list[tuple[str, str, list[float]]]:
        """Name, link, and force and moment (6) of every row, amounts that are rounding as zero."""
        noise = NOISE * max((float(np.abs(r.force).max()) for r in self.rows), default=0.0)
        bounds = np.repeat([noise, noise * self.size], 3)
        wrenches = (np.concatenate([r.force, r.moment]) for r in self.rows)
        cleaned = (np.where(np.abs(w) > bounds, w, 0.0).tolist() for w in wrenches)
        return [(r.name, r.link, wrench) for r, wrench in zip(self.rows, cleaned, strict=True)]

    def __str__(self) -> str:
        rows = [(name, link, *(number(v, 4) for v in wrench)) for name, link, wrench in self.listing]
        columns = (*(f"F{a} [N]" for a in "xyz"), *(f"M{a} [Nm]" for a in "xyz"))
        said = "Interface forces: on the link, moments about the interface, global axes"
        return listed(("of", "<on link", *columns), rows, said)

    def of(self, name: str, link: str) -> InterfaceForce:
        """What one joint, leaf or spring exerts on one of its links. Raises SceneError for names without a row."""
        for row in self.rows:
            if (row.name, row.link) == (name, link):
                return row
        known = ", ".join(f"'{r.name}' on '{r.link}'" for r in self.rows)
        raise SceneError(f"'{name}' is not clamped to link '{link}'; there are {known}")

    def on(self, link: str, *, about: Any = (0.0, 0.0, 0.0)) -> Array:
        """Sum of all on a link, "ground" too: force [N] and moment [Nm] (6,) about a global point [m]. Raises SceneError
        for a link nothing is clamped to."""
        mine = [r for r in self.rows if r.link == link]
        if not mine:
            known = ", ".join(f"'{name}'" for name in dict.fromkeys(r.link for r in self.rows))
            raise SceneError(f"no joint, leaf or spring is clamped to link '{link}'; there are {known}")
        moments = [r.moment + np.cross(r.point - np.asarray(about, float), r.force) for r in mine]
        return np.concatenate([sum(r.force for r in mine), sum(moments)])


def interface_forces(model: Model, motion: Motion, *, load_factor: float = 1.0) -> InterfaceForces:
    """What every joint, free leaf and spring of `model` exerts on its links at `motion`, weight times load_factor."""
    ends = _leaf_ends(model, motion, load_factor)
    rows = []
    for placed in model.scene.joints:
        mine = [e for e in ends if e.name.startswith(f"{placed.name}/")]
        for link, point in ((placed.a, placed.origin), (placed.b, placed.place(placed.joint.pose_B))):
            node = model.node_names.index(link)
            here = motion.x[node] + motion.R[node] @ (np.asarray(point) - model.rest.x[node])
            theirs = [e for e in mine if e.link == link]
            force = sum((e.force for e in theirs), np.zeros(3))
            moment = sum((e.moment + np.cross(e.point - here, e.force) for e in theirs), np.zeros(3))
            rows.append(InterfaceForce(placed.name, link, here, force, moment))
    names = {placed.name for placed in model.scene.leafs}
    rows += [e for e in ends if e.name in names]
    for i, name in enumerate(model.spring_names):
        rows += _spring(model, motion, i, name)
    return InterfaceForces(tuple(rows), model.arrays.size)


def _leaf_ends(model: Model, motion: Motion, load_factor: float) -> list[InterfaceForce]:
    """What every leaf exerts at its start and at its end on the nodes there."""
    found, members = [], model.arrays.members
    forces = section_forces(model, motion, load_factor=load_factor)
    wrenches = end_wrenches(model, motion, load_factor=load_factor)
    for name, parts in members_of_leafs(model).items():
        first, last = member_ends(model, motion, parts[0]), member_ends(model, motion, parts[-1])
        n, m = wrenches[parts[0], :3], wrenches[parts[0], 3:]
        force, moment = n, m + np.cross(first.d, n)
        if np.abs(forces[name].start[:3] - n).max() > LIGHT * np.abs(n).max():
            # a leaf with weight hands it on at its start
            force, moment = forces[name].start[:3], forces[name].start[3:]
        node = model.node_names[members.node[parts[0], 0]]
        found.append(InterfaceForce(name, node, first.start, first.frame @ force, first.frame @ moment))
        n, m = wrenches[parts[-1], :3], wrenches[parts[-1], 3:]
        node, end = model.node_names[members.node[parts[-1], 1]], last.start + last.frame @ last.d
        found.append(InterfaceForce(name, node, end, -(last.frame @ n), -(last.frame @ m)))
    return found


def _spring(model: Model, motion: Motion, i: int, name: str) -> list[InterfaceForce]:
    """What a spring exerts on the nodes at its ends: minus the gradient of its energy, by central differences."""
    springs, found = model.arrays.springs, []
    h = STEP * float(springs.length[i])
    for end in range(2):
        node = int(springs.node[i, end])
        point = motion.x[node] + motion.R[node] @ springs.offset[i, end]
        gradient = np.zeros(6)
        for c in range(6):
            step = np.zeros(6)
            step[c] = h if c < 3 else STEP
            for factor, weight in ((1.0, 8.0), (-1.0, -8.0), (2.0, -1.0), (-2.0, 1.0)):
                moved = _moved(motion, node, point, factor * step)
                gradient[c] += weight * energy_of_spring(model, moved, i) / (12.0 * step[c])
        found.append(InterfaceForce(name, model.node_names[node], point, -gradient[:3], -gradient[3:]))
    return found


def _moved(motion: Motion, node: int, point: Array, step: Array) -> Motion:
    """The state with one node moved by step (6,) [m, rad] about `point`."""
    x, R, turn = motion.x.copy(), motion.R.copy(), np.empty((3, 3))
    rotation_exp(step[3:], turn)
    x[node] = point + step[:3] + turn @ (x[node] - point)
    R[node] = turn @ R[node]
    return motion._replace(x=x, R=R)
