"""One design prepared for batches of poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ksd.errors import SceneError
from ksd.solve.five import FiveSteps
from ksd.solve.many import Poses, space_many, tabulated_many
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
        self, five: FiveSteps, *, method: int = REDUCED, relinearisations: int = 0, tabulated: bool = False
    ) -> None:
        if five.model.mesh.plate:
            raise SceneError(
                "plate stiffening depends on how much each leaf is bent, and is not settled pose by pose in batches: use "
                "ksd.sweep, or leave 'plate' out of what the scene considers"
            )
        self.five, self.method, self.relinearisations = five, method, relinearisations
        if method == KINEMATIC:
            five.insist_on_motions()
        b = five.bench
        self.tables = joint_tables(b.parts, b.bodies) if tabulated else None
        limits = np.column_stack([b.lowest, b.highest])
        self._limits = limits + (np.array([-np.inf, np.inf]) if five.extrapolate else 0.0)

    def __call__(self, values: Mapping[str, np.ndarray]) -> Found:
        """All poses, from rest each. Raises SceneError for drives that are not there."""
        model, b = self.five.model, self.five.bench
        model.targets({n: float(v[0]) for n, v in values.items()})
        count, rows = len(next(iter(values.values()))), len(model.drive_names) + len(model.support_names)
        targets, links = np.zeros((count, rows)), len(model.scene.links)
        for k, name in enumerate(model.drive_names):
            targets[:, k] = values[name]
        motion, status = np.zeros((count, len(b.theta))), np.zeros(count, np.int64)
        force, x, R = np.zeros((count, rows)), np.zeros((count, links, 3)), np.zeros((count, links, 3, 3))
        put = Poses(force, x, R, motion, status)
        if self.tables is None:
            space_many(
                b.parts,
                targets,
                rows,
                self.method,
                self.relinearisations,
                _ways(self.five),
                self._limits,
                put,
            )
        else:
            t = self.tables
            limits = np.column_stack([self._limits, t.limits])
            tabulated_many(b.parts, t.cubic, t.which, targets, rows, _ways(self.five), limits, put)
        names = (model.scene.links, model.drive_names, b.bodies.motion_names)
        error = self.tables.error if self.tables else np.nan
        return Found(*names, force, x, R, motion * b.bodies.motion_scale, status, error)


def _ways(five: FiveSteps) -> np.ndarray:
    """Tolerances of the steps: residual, turn per iteration, gap of the loops."""
    return np.array([RTOL, CAP, five.gap])
