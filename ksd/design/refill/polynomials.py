"""Joint records contracted at many designs at once: `ksd.library.record.Record.contract` for all shapes of a batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ksd.design.refill.scales import FORCE, INVERSE, MOMENT, ONE
from ksd.library.functions import legendre_products
from ksd.library.record import EDGE, Record
from ksd.scene.joint import leafs_of


@dataclass(frozen=True)
class Stacked:
    """The functions of one joint, stacked: rows (X, M) over the terms of its record, and where the groups begin."""

    record: Record
    rows: np.ndarray
    reach: np.ndarray
    merged: list[np.ndarray]
    blocks: int
    insides: int

    def __call__(self, shapes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(D, X, P) at shapes (D, s), and whether a shape is within the trained range (D,)."""
        places = np.empty(shapes.shape)
        known = np.ones(len(shapes), bool)
        with np.errstate(invalid="ignore", divide="ignore"):
            for s, parameter in enumerate(self.record.parameters):
                places[:, s] = [_place(parameter, v) for v in shapes[:, s]]
                known &= np.abs(places[:, s]) <= 1 + EDGE
        motions = len(self.record.motions)
        weight = legendre_products(self.record.powers[:, motions:], places) * self.reach
        # a sum over the terms with one power of the motions, as the contraction of one design does it
        parts = [weight[:, m] @ self.rows[:, m].T for m in self.merged]
        return np.stack(parts, axis=2), known


def _place(parameter: Any, value: float) -> float:
    """nan where the trained map knows no place."""
    if not np.isfinite(value) or (parameter.scale == "log" and value <= 0):
        return float("nan")
    return float(parameter.place(float(value)))


def stacked(record: Record, mesh: str | int) -> Stacked | None:
    """The functions of a record for "strain" or a trained chain; None for a chain it was not trained for."""
    if mesh not in record.functions:
        return None
    found, m = record.functions[mesh], len(record.motions)
    inside = [found.rotations] if found.rotations is not None else [found.amplitudes, found.wrench]
    terms = len(record.powers)
    parts = [found.interface.reshape(-1, terms), found.blocks.reshape(-1, terms)]
    parts += [group.reshape(-1, terms) for group in inside if group is not None]
    reach = np.array([motion.reach for motion in record.motions])
    powers, merged = np.unique(record.powers[:, :m], axis=0, return_inverse=True)
    groups = [np.flatnonzero(merged.ravel() == p) for p in range(len(powers))]
    return Stacked(
        record,
        np.concatenate(parts),
        np.prod(reach ** -record.powers[:, :m], axis=1),
        groups,
        6,
        6 + len(parts[1]),
    )


class Polynomials:
    """All functions of the joints of a model: which stacked row, times which scale of which leaf, goes where.

    pose (J, 6), block_pose (K, 6), coefficient (T,), near (T,): rows of the stack of all different joints; the scales of
    the latter two are kind and leaf (T,).
    """

    def __init__(self, joints: Sequence[Any], records: Sequence[Record], mesh: Any) -> None:
        name = "strain" if mesh.leaf == "strain" else mesh.elements
        found = [stacked(r, name) for r in records]
        self.known = all(f is not None for f in found)
        self.parts = [f for f in found if f is not None]
        self.joints, self.mesh = joints, mesh
        self.names = [r.shape_names for r in records]
        if self.known:
            self.first = np.cumsum([0] + [len(f.rows) for f in self.parts])
            self.size = max(len(f.merged) for f in self.parts)

    def shapes(self, joints: Sequence[Any]) -> list[list[float]]:
        """Shape parameters of each different joint, in the order of its record; raises KeyError for other ones."""
        found = []
        for joint, names in zip(joints, self.names, strict=True):
            shape = joint.shape()
            if len(shape) != len(names):
                raise KeyError("shape parameters")
            found.append([shape[n] for n in names])
        return found

    def __call__(self, shapes: list[list[list[float]]]) -> tuple[np.ndarray, np.ndarray]:
        """(D, X, M) of all joints at the shapes of D designs, and which are within the trained ranges (D,)."""
        stack, known = np.zeros((len(shapes), int(self.first[-1]), self.size)), np.ones(len(shapes), bool)
        for u, part in enumerate(self.parts):
            table, inside = part(np.array([s[u] for s in shapes], float).reshape(len(shapes), -1))
            stack[:, self.first[u] : self.first[u + 1], : table.shape[2]] = table
            known &= inside
        return stack, known

    def pose(self, u: int) -> list[int]:
        """Rows of interface B of joint u."""
        return [int(self.first[u]) + r for r in range(6)]

    def block(self, u: int, k: int) -> list[int]:
        """Rows of internal block k of joint u."""
        return [int(self.first[u]) + 6 + 6 * k + r for r in range(6)]

    def inner(self, u: int, n: int, wanted: Sequence[int]) -> list[tuple[int, int]]:
        """(row, scale kind) of the inner states of strain-mode leaf n of joint u that has `wanted` curvature modes.

        As `ksd.bodies.joints` places them: amplitudes present in both, then the six of the wrench.
        """
        part, theirs = self.parts[u], self.parts[u].record.orders
        leafs, total = len(leafs_of(self.joints[u])), sum(theirs)
        at = int(self.first[u]) + part.insides
        found, given = [], 0
        for axis in range(3):
            found += [(at + n * total + given + k, INVERSE) for k in range(min(theirs[axis], wanted[axis]))]
            given += theirs[axis]
        wrench = at + leafs * total + 6 * n
        return found + [(wrench + r, FORCE if r < 3 else MOMENT) for r in range(6)]

    def near(self, u: int, n: int) -> list[tuple[int, int]]:
        """(row, scale kind) of the near rotations of chain n of joint u."""
        count = 3 * (2 * int(self.mesh.elements) - 1)
        at = int(self.first[u]) + self.parts[u].insides + count * n
        return [(at + r, ONE) for r in range(count)]
