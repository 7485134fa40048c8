"""Whether a model is planar, and the same model in its plane with three unknowns per node.

Looked at here: the leafs' width axes, drives and supports, loads. Symmetry about the plane is not asked for; whether
the leafs balance across it is seen when a planar state is lifted to space and its spatial residual is evaluated
(`imbalance`). A planar scene is thus checked, never trusted (design section 4).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ksd.model.arrays import LINEAR, MODAL, ROTATION, SOLID, Arrays, Motion, Work
from ksd.model.compile import Model
from ksd.model.planar_arrays import PlanarMotion
from ksd.model.planar_flat import Flat
from ksd.model.planar_lift import Lifting, lift_inner, lift_nodes
from ksd.model.planar_pack import flat_member, flatten
from ksd.model.planar_springs import flat_spring

PARALLEL = 1e-9
"""Sine of the angle below which two directions count as parallel."""


@dataclass(frozen=True)
class Plane:
    """A spatial model in its plane: `space` the spatial arrays, `arrays` the planar ones, `rest` the planar state."""

    space: Arrays
    arrays: Arrays
    lifting: Lifting
    rest: PlanarMotion

    @property
    def normal(self) -> np.ndarray:
        """Unit normal k (3,) of the plane, global axes."""
        return self.lifting.axes[:, 2].copy()

    def lift(self, flat: PlanarMotion, motion: Motion) -> None:
        """Write the spatial state `motion` of the planar one `flat`, inner states and multipliers included."""
        axes, height, *copies, row = self.lifting
        lift_nodes(axes, height, flat.pose, motion.x, motion.R)
        lift_inner(*copies, flat.inner, motion.inner)
        motion.multiplier[:] = 0.0
        motion.multiplier[row] = flat.multiplier

    def flatten(self, motion: Motion) -> PlanarMotion | None:
        """The planar state of a spatial one, None when that is not in the plane."""
        flat, back = _flatten(self.lifting, motion, len(self.rest.inner)), motion.copy()
        self.lift(flat, back)
        bounds = (1e-9 * self.space.size, 1e-9, 1e-7 * np.abs(motion.inner).max(initial=0.0))
        for mine, theirs, bound in zip(back[:3], motion[:3], bounds, strict=True):
            if np.abs(mine - theirs).max(initial=0.0) > bound:
                return None
        return flat

    def imbalance(self, work: Work) -> tuple[float, int, float, float]:
        """Residual across the plane in `work`, as assembled by `ksd.model.system.assemble` at a lifted state.

        Returns (the largest over its bound, the node it acts on, its force [N] along k, its moment [Nm] across k).
        """
        at = self.space.start[1:, None]
        k = self.normal
        force = np.abs(work.rhs[at + np.arange(3)] @ k)
        turn = work.rhs[at + np.arange(3, 6)]
        moment = np.linalg.norm(turn - np.outer(turn @ k, k), axis=1)
        share = np.maximum(force / (work.scale[1:, 0] + 1e-300), moment / (work.scale[1:, 1] + 1e-300))
        worst = int(np.argmax(share))
        return float(share[worst]), worst + 1, float(force[worst]), float(moment[worst])


def _flatten(lifting: Lifting, motion: Motion, inner: int) -> PlanarMotion:
    """The planar part of a spatial state; `inner`: length of the planar inner states."""
    axes, _, to, of, factor, turn_to, turn_of, sense, row = lifting
    i, j = axes[:, 0], axes[:, 1]
    turned = motion.R @ i
    flat = PlanarMotion(np.empty((len(motion.x), 3)), np.zeros(inner), motion.multiplier[row])
    flat.pose[:, :2] = motion.x @ axes[:, :2]
    flat.pose[:, 2] = np.arctan2(turned @ j, turned @ i)
    flat.inner[of] = motion.inner[to] / factor
    flat.inner[turn_of] = sense * np.arctan2(motion.inner[turn_to + 3], motion.inner[turn_to])
    return flat


def _normal(arrays: Arrays) -> np.ndarray:
    """Direction (3,) of the first leaf's width, its largest component positive."""
    k = arrays.members.frame[0, 0, :, 2]
    k = k / np.linalg.norm(k)
    return k * np.sign(k[np.argmax(np.abs(k))])


def _axes(k: np.ndarray) -> np.ndarray:
    """Columns i, j, k: i the global axis furthest from k, turned across it."""
    e = np.eye(3)[int(np.argmin(np.abs(k)))]
    i = e - (e @ k) * k
    i /= np.linalg.norm(i)
    return np.column_stack([i, np.cross(k, i), k])


def _spoken(v: np.ndarray) -> str:
    return f"({', '.join(f'{c + 0.0:.4g}' for c in v)})"


def _flat_members(model: Model, axes: np.ndarray) -> tuple[list[Flat], np.ndarray] | str:
    """Every member in the plane and the sense of its e3 about k, or why one is not."""
    members, k = model.arrays.members, axes[:, 2]
    flats, senses = [], np.ones(len(members.kind))
    made: dict[Any, np.ndarray | str] = {}
    for i, name in enumerate(model.member_names):
        if members.kind[i] == LINEAR:
            return f"'{name}' is a condensed joint, which has no planar form"
        if members.kind[i] in (MODAL, SOLID):
            return f"'{name}' is a reduced body, which has no planar form"
        for e3 in members.frame[i, :, :, 2]:
            if np.linalg.norm(np.cross(e3, k)) > PARALLEL:
                return f"the width of leaf '{name}' is along {_spoken(e3)}, that of the others along {_spoken(k)}"
        senses[i] = math.copysign(1.0, members.frame[i, 0, :, 2] @ k)
        flat = flat_member(model.arrays, i, axes, senses[i], made)
        if isinstance(flat, str):
            return f"leaf '{name}' {flat}"
        flats.append(flat)
    return flats, senses


def _flat_springs(model: Model, axes: np.ndarray) -> list[Flat] | str:
    """Every spring in the plane, or why one is not."""
    found = []
    for i, name in enumerate(model.spring_names):
        flat = flat_spring(model.arrays.springs, i, axes, model.rest.x)
        if isinstance(flat, str):
            return f"{name} {flat}"
        found.append(flat)
    return found


def _planar_rows(model: Model, k: np.ndarray) -> np.ndarray | str:
    """Constraint rows (c,) that act in the plane; supports that only hold the mechanism in it are left out."""
    terms, drives = model.arrays.terms, len(model.drive_names)
    rows = []
    for i, name in enumerate((*model.drive_names, *model.support_names)):
        span = slice(terms.first[i], terms.first[i + 1])
        turning = terms.kind[span] == ROTATION
        along = np.abs(terms.direction[span] @ k)
        across = np.linalg.norm(np.cross(terms.direction[span], k), axis=1)
        inside = np.where(turning, across, along) <= PARALLEL
        outside = np.where(turning, along, across) <= PARALLEL
        if np.all(inside):
            rows.append(i)
        elif i < drives or not np.all(outside):
            what = "rotates about" if turning[np.argmin(inside)] else "moves along"
            direction = terms.direction[span][np.argmin(inside)]
            word = "drive" if i < drives else "support"
            return f"{word} '{name}' {what} {_spoken(direction)}, out of the plane across {_spoken(k)}"
    return np.array(rows, np.int64)


def _load_name(model: Model, i: int) -> str:
    """Name of load i: those on links that move, in the order of the scene, then the weights."""
    names = [f"load '{load.name}'" for load in model.scene.loads if load.link != model.scene.links[0]]
    names += [f"the weight of link '{mass.link}'" for mass in model.scene.masses]
    return names[i] if i < len(names) else f"load {i + 1}"


def _leaving_load(model: Model, k: np.ndarray) -> str:
    """The first load that pushes or turns the mechanism out of the plane, in words; empty when none does."""
    loads = model.arrays.loads
    for i in range(len(loads.node)):
        force, moment = loads.force[i], loads.moment[i]
        if abs(force @ k) > PARALLEL * np.linalg.norm(force):
            return f"{_load_name(model, i)} pushes along {_spoken(force)} N, out of the plane across {_spoken(k)}"
        if np.linalg.norm(np.cross(moment, k)) > PARALLEL * np.linalg.norm(moment):
            return f"{_load_name(model, i)} turns about {_spoken(moment)} Nm, out of the plane across {_spoken(k)}"
    gravity = model.arrays.weight[:1, 1:].ravel()
    if len(gravity) and abs(gravity @ k) > PARALLEL * np.linalg.norm(gravity):
        return f"the weight of the leafs pulls along {_spoken(gravity)} m/s^2, out of the plane across {_spoken(k)}"
    return ""


def _find_plane(model: Model) -> Plane | str:
    """See `plane_of`; this one looks every time."""
    if not len(model.arrays.members.kind):
        return "it has no leafs to show a plane"
    axes = _axes(_normal(model.arrays))
    found = _flat_members(model, axes)
    if isinstance(found, str):
        return found
    rows = _planar_rows(model, axes[:, 2])
    if isinstance(rows, str):
        return rows
    reason = _leaving_load(model, axes[:, 2])
    if reason:
        return reason
    springs = _flat_springs(model, axes)
    if isinstance(springs, str):
        return springs
    flats, senses = found
    arrays, lifting = flatten(
        model.arrays, flats, senses, axes=axes, rows=rows, rest=model.rest.x, springs=springs
    )
    rest = _flatten(lifting, model.rest, int(arrays.members.inner_at[-1]))
    return Plane(model.arrays, arrays, lifting, rest)


def plane_of(model: Model) -> Plane | str:
    """The model in its plane, or the reason (a clause naming leaf, drive, support or load) why it is not planar.

    Planar means: the widths e3 of all leafs parallel to one direction k, drives and supports acting across k (rotations
    about k), forces across k and moments about k. Supports that hold the mechanism in the plane are allowed and left
    out. The answer is remembered for as long as the model lives.
    """
    found: Plane | str | None = model.derived.get("plane")
    if found is None:
        found = model.derived["plane"] = _find_plane(model)
    return found


def refuse_plane(model: Model, reason: str) -> None:
    """Remember that the leafs of `model` do not balance across its plane, so that it is not tried again."""
    model.derived["plane"] = reason
