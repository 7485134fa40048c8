"""One design prepared for batches: all its poses in one compiled call."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ksd.errors import KsdError
from ksd.model.plane import Plane, plane_of
from ksd.solve.driving import CAP, RTOL
from ksd.solve.five import FiveSteps
from ksd.solve.many import planar_many, space_many, tabulated_many
from ksd.solve.planar_steps import PlanarSteps
from ksd.solve.solver import Solver
from ksd.solve.space_steps import KINEMATIC, REDUCED
from ksd.solve.tables import joint_tables


@dataclass
class Found:
    """Numbers of one design."""

    links: tuple[str, ...]
    drives: tuple[str, ...]
    joints: tuple[str, ...]
    force: np.ndarray
    x: np.ndarray
    R: np.ndarray
    motion: np.ndarray
    status: np.ndarray
    error: float = np.nan


class Prepared:
    """One design prepared for batches: call it with drive values, arrays of one length by name."""

    def __init__(
        self, solver: Solver, *, method: int = REDUCED, passes: int = 0, tabulated: bool = False
    ) -> None:
        self.solver, self.five = solver, solver.five_steps
        self.method, self.passes = method, passes
        if method == KINEMATIC:
            self.five.insist_on_motions()
        self.tables = joint_tables(self.five.bench.held, self.five.bench.bodies) if tabulated else None
        b = self.five.bench
        limits = np.column_stack([b.lowest, b.highest])
        self._limits = limits + (np.array([-np.inf, np.inf]) if solver.extrapolate else 0.0)

    def __call__(self, values: Mapping[str, np.ndarray]) -> Found:
        """All poses, from rest each."""
        targets = self.targets(values)
        flat = None if self.tables else _balanced(self.five, values, targets)
        return self.solved(targets, flat, self.five.bench.bodies.motion_scale)

    @property
    def plane(self) -> Plane | None:
        """The plane of the model, None without one or where the design it was made of does not balance in it."""
        found = plane_of(self.solver.model)
        return found if isinstance(found, Plane) else None

    def targets(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """Right-hand sides (N, c) of all rows. Raises SceneError for drives that are not there."""
        model = self.solver.model
        model.targets({n: float(v[0]) for n, v in values.items()})
        count, rows = len(next(iter(values.values()))), len(model.drive_names) + len(model.support_names)
        targets = np.zeros((count, rows))
        for k, name in enumerate(model.drive_names):
            targets[:, k] = values[name]
        return targets

    def solved(self, targets: np.ndarray, flat: PlanarSteps | None, scale: np.ndarray) -> Found:
        """All poses of the design in the storage, in the plane or not; scale (q,): of the intended motions."""
        model, b, count = self.solver.model, self.five.bench, len(targets)
        motion, status = np.zeros((count, len(b.theta))), np.zeros(count, np.int64)
        if flat is not None:
            ways = (self.method, self.passes, self._limits)
            force, x, R = _in_plane(self.five, flat, targets, ways, (motion, status))
        else:
            force, x, R = self._in_space(targets, motion, status)
        names = (model.scene.links, model.drive_names, b.bodies.motion_names)
        error = self.tables.error if self.tables else np.nan
        return Found(*names, force, x, R, motion * scale, status, error)

    def _in_space(
        self, targets: np.ndarray, motion: np.ndarray, status: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Forces (N, rows), positions and rotations of the links."""
        b, (count, rows) = self.five.bench, targets.shape
        links = len(self.solver.model.scene.links)
        force, x, R = np.zeros((count, rows)), np.zeros((count, links, 3)), np.zeros((count, links, 3, 3))
        put = (force, x, R, motion, status)
        if self.tables is None:
            space_many(b.held, targets, rows, self.method, self.passes, _ways(self.five), self._limits, *put)
        else:
            t = self.tables
            limits = np.column_stack([self._limits, t.limits])
            tabulated_many(b.held, t.cubic, t.which, targets, rows, _ways(self.five), limits, *put)
        return force, x, R


def _ways(five: FiveSteps) -> np.ndarray:
    """Tolerances of the compiled steps: residual, turn per iteration, gap of the loops."""
    return np.array([RTOL, CAP, five.gap])


def _balanced(five: FiveSteps, values: Mapping[str, np.ndarray], targets: np.ndarray) -> PlanarSteps | None:
    """The planar five steps, if one pose shows that leafs and loads balance across the plane."""
    widest = int(np.argmax(np.abs(targets).sum(axis=1)))
    if isinstance(five.flat, PlanarSteps):
        with contextlib.suppress(KsdError):
            at = {n: float(v[widest]) for n, v in values.items()}
            five(at, targets[widest], method="reduced", passes=0, estimate=False)
    flat = five.flat
    return flat if isinstance(flat, PlanarSteps) and isinstance(plane_of(five.model), Plane) else None


def _in_plane(
    five: FiveSteps, flat: PlanarSteps, targets: np.ndarray, ways: tuple, put: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Forces (N, rows), positions and rotations of the links, from the planar solves."""
    method, passes, limits = ways
    lifting = plane_of(five.model).lifting  # type: ignore[union-attr]
    count, links = len(targets), len(five.model.scene.links)
    inside = np.ascontiguousarray(targets[:, lifting.row])
    force, pose = np.zeros((count, len(lifting.row))), np.zeros((count, links, 3))
    planar_many(flat.held, inside, len(lifting.row), method, passes, _ways(five), limits, force, pose, *put)
    all_rows = np.zeros(targets.shape)
    all_rows[:, lifting.row] = force
    i, j, k = lifting.axes.T
    x = pose[..., :1] * i + pose[..., 1:2] * j + lifting.height[:links, None] * k
    c, s = np.cos(pose[..., 2])[..., None, None], np.sin(pose[..., 2])[..., None, None]
    R = c * (np.outer(i, i) + np.outer(j, j)) + s * (np.outer(j, i) - np.outer(i, j)) + np.outer(k, k)
    return all_rows, x, R
