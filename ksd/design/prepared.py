"""One design prepared for batches of poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ksd.errors import KinematicsError, SceneError
from ksd.properties.stiffness import node_of, point_motion, point_stiffness
from ksd.solve.error import settle
from ksd.solve.five import FiveSteps
from ksd.solve.many import UNSTABLE, Poses, space_many, tabulated_many
from ksd.solve.space_steps import KINEMATIC, REDUCED
from ksd.solve.steps import CAP, RTOL, Stop
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
    compliance: np.ndarray | None = None


class Prepared:
    """One design prepared for batches: call it with drive values, arrays of one length by name.

    stiffness: link, and point at rest or None, whose compliance is asked.
    """

    def __init__(
        self,
        five: FiveSteps,
        *,
        method: int = REDUCED,
        relinearisations: int = 0,
        tabulated: bool = False,
        stiffness: tuple[str, Any] | None = None,
    ) -> None:
        if five.model.mesh.plate:
            raise SceneError(
                "plate stiffening depends on how much each leaf is bent, and is not settled pose by pose in batches: use "
                "ksd.sweep, or leave 'plate' out of what the scene considers"
            )
        self.five, self.method, self.relinearisations = five, method, relinearisations
        self.stiffness = stiffness
        if stiffness is not None:
            # what is wrong with it is told before anything is solved
            model = five.model
            point_motion(model, model.rest, node_of(model, stiffness[0]), stiffness[1])
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
        compliance = None if self.stiffness is None else np.full((count, 6, 6), np.nan)

        def ask(n: int) -> int:
            assert compliance is not None
            return self._compliance(targets[n], compliance[n])

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
                None if compliance is None else ask,
            )
        else:
            t = self.tables
            limits = np.column_stack([self._limits, t.limits])
            tabulated_many(b.parts, t.cubic, t.which, targets, rows, _ways(self.five), limits, put)
        names = (model.scene.links, model.drive_names, b.bodies.motion_names)
        error = self.tables.error if self.tables else np.nan
        return Found(*names, force, x, R, motion * b.bodies.motion_scale, status, error, compliance)

    def _compliance(self, target: np.ndarray, found: np.ndarray) -> int:
        """Compliance (6, 6) of the state in storage into `found`, of the equilibrium next to it where the method leads to
        none; returns the status."""
        model, b = self.five.model, self.five.bench
        assert self.stiffness is not None
        if self.method == REDUCED:
            stop, negatives = settle(model.arrays, b.full, target, 1.0)
            if stop is not Stop.CONVERGED:
                return int(stop)
            if negatives != len(target):
                return UNSTABLE
        link, at = self.stiffness
        try:
            found[:] = point_stiffness(model, b.full, link, at=at).compliance
        except KinematicsError:
            return int(Stop.SINGULAR)
        return 0


def _ways(five: FiveSteps) -> np.ndarray:
    """Tolerances of the steps: residual, turn per iteration, gap of the loops."""
    return np.array([RTOL, CAP, five.gap])
