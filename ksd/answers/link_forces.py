"""Forces inside every leaf spring and at every link of a mechanism, in one table (Lan, 2005, chapter 5)."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ksd.answers.forces import (
    ROUNDING_TOLERANCE,
    InterfaceForce,
    SectionForces,
    interface_forces,
    leaf_end_forces,
)
from ksd.answers.printing import PrintableAnswer, format_number, format_table
from ksd.errors import SceneError
from ksd.files import write_csv
from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.scene.hinges import PLANES

Array = NDArray[np.float64]
COLUMNS = ("part", "of", "at", "Fx_N", "Fy_N", "Fz_N", "Mx_Nm", "My_Nm", "Mz_Nm", "x_m", "y_m", "z_m")
"""Columns of the file of `LinkForces.to_csv`."""


@dataclass(frozen=True)
class LinkForce:
    """Force (3,) [N], and moment (3,) [Nm] about the deformed position `point` (3,) [m]; global axes.

    part "inside": force in leaf `of` at its start or end, which `at` names with the link there, exerted by the part beyond
    on the part before. part "link": force on link `at`, exerted by the joint, leaf, spring, pin or slider `of`, or by
    "applied": loads, drives, supports and weight together, about the reference point, which balance the others.
    """

    part: str
    of: str
    at: str
    force: Array
    moment: Array
    point: Array


@dataclass(frozen=True, repr=False)
class LinkForces(PrintableAnswer):
    """Forces inside all leaf springs in the order of the model, then on all links, ground first.

    rows: one per force; plane: whose components are printed, None for all; size [m]: length by which moments are compared
    with forces.
    """

    rows: tuple[LinkForce, ...]
    plane: str | None
    size: float

    def _line(self) -> str:
        inside = [r for r in self.rows if r.part == "inside"]
        most = max(inside, key=lambda r: float(np.linalg.norm(r.force)), default=None)
        if most is None:
            return "no leaf springs"
        largest = format_number(float(np.linalg.norm(most.force)))
        return f"{len(inside) // 2} leaf springs, at most {largest} N, in '{most.of}'"

    def inside(self, leaf: str) -> tuple[LinkForce, LinkForce]:
        """Forces inside a leaf, by full name, at its start and at its end; raises SceneError for an unknown leaf."""
        found = [r for r in self.rows if r.part == "inside" and r.of == leaf]
        if not found:
            known = dict.fromkeys(r.of for r in self.rows if r.part == "inside")
            raise SceneError(f"there is no leaf '{leaf}'; there are {', '.join(known)}")
        return found[0], found[1]

    def __str__(self) -> str:
        noise = ROUNDING_TOLERANCE * max((float(np.abs(r.force).max()) for r in self.rows), default=0.0)
        normal = None if self.plane is None else PLANES[self.plane]
        forces = [k for k in range(3) if k != normal]
        moments = [k for k in range(3) if normal is None or k == normal]
        rows = [
            (
                f"in '{r.of}'" if r.part == "inside" else f"on '{r.at}'",
                r.at if r.part == "inside" else r.of if r.of == "applied" else f"of '{r.of}'",
                *(format_number(float(r.force[k]), 5, zero=noise) for k in forces),
                *(format_number(float(r.moment[k]), 5, zero=noise * self.size) for k in moments),
            )
            for r in self.rows
        ]
        columns = (*(f"F{'xyz'[k]} [N]" for k in forces), *(f"M{'xyz'[k]} [Nm]" for k in moments))
        title = "Forces in every leaf spring, of the part beyond on the part before, and on every link; global axes"
        return format_table(("", "<", *columns), rows, title)

    def to_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write comma-separated values (UTF-8, full precision) with header COLUMNS; returns the path."""
        rows = (
            (r.part, r.of, r.at, *np.concatenate([r.force, r.moment, r.point]).tolist()) for r in self.rows
        )
        return write_csv(path, COLUMNS, rows)


def link_forces(
    model: Model,
    motion: State,
    *,
    load_factor: float = 1.0,
    sections: Mapping[str, SectionForces] | None = None,
) -> LinkForces:
    """Forces inside all leaves and on all links of `model` at `motion`; load_factor, sections: as in `interface_forces`."""
    rows = []
    for k, end in enumerate(leaf_end_forces(model, motion, load_factor, sections)):
        # the force on the node is the inner force at the start of a leaf, and its opposite at the end
        sign, word = (1.0, "start") if k % 2 == 0 else (-1.0, "end")
        at = f"{word}, at '{end.link}'"
        rows.append(LinkForce("inside", end.name, at, sign * end.force, sign * end.moment, end.point))
    found = interface_forces(model, motion, load_factor=load_factor, sections=sections)
    for link in model.scene.links:
        mine = [r for r in found.rows if r.link == link]
        if not mine:
            continue
        rows += [LinkForce("link", r.name, link, r.force, r.moment, r.point) for r in mine]
        rows.append(_applied_force(mine, link, motion.x[model.node_names.index(link)].copy()))
    return LinkForces(tuple(rows), model.scene.plane, float(model.arrays.size))


def _applied_force(rows: list[InterfaceForce], link: str, about: Array) -> LinkForce:
    """Force and moment about a point (3,) that balance the `rows` of a link."""
    force = -np.sum([r.force for r in rows], axis=0)
    moment = -np.sum([r.moment + np.cross(r.point - about, r.force) for r in rows], axis=0)
    return LinkForce("link", "applied", link, force, moment, about)


__all__ = ["LinkForce", "LinkForces", "link_forces"]
