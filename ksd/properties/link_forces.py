"""Forces inside every leaf spring and at every link of a mechanism, in one table (Lan, 2005, chapter 5)."""

from __future__ import annotations

import csv
import io
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ksd.errors import SceneError
from ksd.files import write_file
from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.properties.forces import ROUNDING_TOLERANCE, InterfaceForce, interface_forces, leaf_end_forces
from ksd.properties.printing import PrintableAnswer, format_number, format_table
from ksd.scene.hinges import PLANES

Array = NDArray[np.float64]
COLUMNS = ("part", "of", "at", "Fx_N", "Fy_N", "Fz_N", "Mx_Nm", "My_Nm", "Mz_Nm", "x_m", "y_m", "z_m")
"""Of the file."""


@dataclass(frozen=True)
class LinkForce:
    """A row: force (3,) [N], and moment (3,) [Nm] about `point` (3,) [m], its place now; global axes.

    part "inside": in leaf `of` at its "start" or "end" (at says which, and the link there), exerted by the part beyond on
    the part before. part "link": on link `at`, exerted by the joint, leaf, spring, pin or slider `of`, or "applied": loads,
    drives, supports and weight together, which balance the others, about the reference point.
    """

    part: str
    of: str
    at: str
    force: Array
    moment: Array
    point: Array


@dataclass(frozen=True, repr=False)
class LinkForces(PrintableAnswer):
    """All of them in `rows`: leaf springs in the order of the model, then link by link, ground first. plane: the one whose
    components are printed, None for all; size [m]: by which moments and forces are compared."""

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
        """What a leaf, by full name, hands on at its start and at its end. Raises SceneError for an unknown leaf."""
        found = [r for r in self.rows if r.part == "inside" and r.of == leaf]
        if not found:
            known = dict.fromkeys(r.of for r in self.rows if r.part == "inside")
            raise SceneError(f"there is no leaf '{leaf}'; there are {', '.join(known)}")
        return found[0], found[1]

    def __str__(self) -> str:
        noise = ROUNDING_TOLERANCE * max((float(np.abs(r.force).max()) for r in self.rows), default=0.0)
        across = None if self.plane is None else PLANES[self.plane]
        shown = [(k, k != across, k in (across, k if across is None else -1)) for k in range(3)]
        forces, moments = [k for k, own, _ in shown if own], [k for k, _, own in shown if own]
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
        said = "Forces in every leaf spring, of the part beyond on the part before, and on every link; global axes"
        return format_table(("", "<", *columns), rows, said)

    def to_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write comma-separated values (UTF-8, full precision, one header line, COLUMNS). Returns the path."""
        text = io.StringIO(newline="")
        writer = csv.writer(text)
        writer.writerow(COLUMNS)
        for r in self.rows:
            values = np.concatenate([r.force, r.moment, r.point]).tolist()
            writer.writerow((r.part, r.of, r.at, *values))
        return write_file(path, text.getvalue(), what="table")


def link_forces(model: Model, motion: State, *, load_factor: float = 1.0) -> LinkForces:
    """Forces inside every leaf and on every link of `model` at `motion`, their weight times load_factor."""
    rows = []
    for k, end in enumerate(leaf_end_forces(model, motion, load_factor)):
        # a leaf pulls at its start with what it hands on there, at its end against it
        sign, word = (1.0, "start") if k % 2 == 0 else (-1.0, "end")
        at = f"{word}, at '{end.link}'"
        rows.append(LinkForce("inside", end.name, at, sign * end.force, sign * end.moment, end.point))
    found = interface_forces(model, motion, load_factor=load_factor)
    for link in model.scene.links:
        mine = [r for r in found.rows if r.link == link]
        if not mine:
            continue
        rows += [LinkForce("link", r.name, link, r.force, r.moment, r.point) for r in mine]
        rows.append(_applied_force(mine, link, motion.x[model.node_names.index(link)].copy()))
    return LinkForces(tuple(rows), model.scene.plane, float(model.arrays.size))


def _applied_force(rows: list[InterfaceForce], link: str, about: Array) -> LinkForce:
    """What balances everything that is clamped to a link."""
    force = -np.sum([r.force for r in rows], axis=0)
    moment = -np.sum([r.moment + np.cross(r.point - about, r.force) for r in rows], axis=0)
    return LinkForce("link", "applied", link, force, moment, about)


__all__ = ["LinkForce", "LinkForces", "link_forces"]
