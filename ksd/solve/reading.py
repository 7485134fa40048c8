"""Where the joints of an answer are, as numbers that are put under their names when somebody asks."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Reading(NamedTuple):
    """Intended motions theta (q,) [rad, or stroke over joint length] and what is left, off (J, 6) [m, rad], of all joints.

    motions, joints: their names; scale (q,): from theta to rad or m.
    """

    motions: tuple[str, ...]
    joints: tuple[str, ...]
    scale: np.ndarray
    theta: np.ndarray
    off: np.ndarray

    def by_motion(self) -> dict[str, float]:
        """Intended motion [rad or m] by name."""
        return dict(zip(self.motions, (self.theta * self.scale).tolist(), strict=True))

    def by_joint(self) -> dict[str, np.ndarray]:
        """(6,) displacement [m] and rotation [rad] of interface B off its intended pose, by joint."""
        return dict(zip(self.joints, self.off, strict=True))
