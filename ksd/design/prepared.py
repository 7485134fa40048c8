"""One design prepared for batches of poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ksd.errors import SceneError
from ksd.solve.five import FiveSteps
from ksd.solve.many import Poses, space_many, tabulated_many
from ksd.solve.solver import Solver
from ksd.solve.space_steps import KINEMATIC, REDUCED
from ksd.solve.steps import CAP, RTOL
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
        if solver.model.mesh.plate:
            raise SceneError(
                "plate stiffening depends on how much each leaf is bent, and is not settled pose by pose in batches: use "
                "ksd.sweep, or leave 'plate' out of what the scene considers"
            )
        self.solver, self.five = solver, solver.five_steps
        self.method, self.passes = method, passes
        if method == KINEMATIC:
            self.five.insist_on_motions()
        self.tables = joint_tables(self.five.bench.parts, self.five.bench.bodies) if tabulated else None
        b = self.five.bench
        limits = np.column_stack([b.lowest, b.highest])
        self._limits = limits + (np.array([-np.inf, np.inf]) if solver.extrapolate else 0.0)

    def __call__(self, values: Mapping[str, np.ndarray]) -> Found:
        """All poses, from rest each."""
        return self.solved(self.targets(values), self.five.bench.bodies.motion_scale)

    def targets(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """Right-hand sides (N, c) of all rows. Raises SceneError for drives that are not there."""
        model = self.solver.model
        model.targets({n: float(v[0]) for n, v in values.items()})
        count, rows = len(next(iter(values.values()))), len(model.drive_names) + len(model.support_names)
        targets = np.zeros((count, rows))
        for k, name in enumerate(model.drive_names):
            targets[:, k] = values[name]
        return targets

    def solved(self, targets: np.ndarray, scale: np.ndarray) -> Found:
        """All poses of the design in the storage; scale (q,): of the intended motions."""
        model, b, (count, rows) = self.solver.model, self.five.bench, targets.shape
        links = len(model.scene.links)
        motion, status = np.zeros((count, len(b.theta))), np.zeros(count, np.int64)
        force, x, R = np.zeros((count, rows)), np.zeros((count, links, 3)), np.zeros((count, links, 3, 3))
        put = Poses(force, x, R, motion, status)
        if self.tables is None:
            space_many(b.parts, targets, rows, self.method, self.passes, _ways(self.five), self._limits, put)
        else:
            t = self.tables
            limits = np.column_stack([self._limits, t.limits])
            tabulated_many(b.parts, t.cubic, t.which, targets, rows, _ways(self.five), limits, put)
        names = (model.scene.links, model.drive_names, b.bodies.motion_names)
        return Found(
            *names, force, x, R, motion * scale, status, self.tables.error if self.tables else np.nan
        )


def _ways(five: FiveSteps) -> np.ndarray:
    """Tolerances of the steps: residual, turn per iteration, gap of the loops."""
    return np.array([RTOL, CAP, five.gap])
