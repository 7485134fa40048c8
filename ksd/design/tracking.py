"""Modes followed along a stroke by the modal assurance criterion (MAC), so that a name stays with its mode.

Between neighbouring poses the modes are paired so that the sum of their assurances (mass-weighted, in 0..1) is largest
(Allemang and Brown 1982; the assignment is solved exactly). Crossing frequencies then swap rank and keep their name.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ksd.properties.frequencies import Modes

SPARE = 2
"""Modes computed beyond those followed, so that one which rises in rank is still there."""


@dataclass(frozen=True)
class Tracks:
    """Modes at one pose, by track: rank (t,) of each track among the modes of this pose (-1: not found), names (t,),
    assurance (t,) with its mode at the pose before (1 at the first)."""

    modes: Modes
    rank: tuple[int, ...]
    names: tuple[str, ...]
    assurance: tuple[float, ...]

    def frequency_Hz(self, track: int) -> float:
        """Frequency [Hz] of a track, nan where it was not found."""
        k = self.rank[track]
        return float(self.modes.frequency_Hz[k]) if k >= 0 else float("nan")

    @property
    def first_parasitic(self) -> int | None:
        """The track of lowest frequency that is not the intended motion."""
        known = [t for t, n in enumerate(self.names) if n != "intended" and self.rank[t] >= 0]
        return min(known, key=self.frequency_Hz) if known else None


def first_tracks(modes: Modes, count: int) -> Tracks:
    """Tracks of the `count` lowest modes, named: "intended" (drives freed) and "parasitic_1", ... in their order."""
    ranks = list(range(min(count, len(modes))))
    intended = modes.intended
    if intended is not None and intended not in ranks:
        ranks[-1] = intended
    names, n = [], 0
    for k in ranks:
        n += k != intended
        names.append("intended" if k == intended else f"parasitic_{n}")
    return Tracks(modes, tuple(ranks), tuple(names), (1.0,) * len(ranks))


def follow(before: Tracks | None, modes: Modes, count: int) -> Tracks:
    """The tracks of the pose before, found again among the `modes` of this one; new ones when there was none."""
    from scipy.optimize import linear_sum_assignment

    if before is None:
        return first_tracks(modes, count)
    alive = [t for t, k in enumerate(before.rank) if k >= 0]
    mac = before.modes.assurance(modes)[[before.rank[t] for t in alive]]
    rows, columns = linear_sum_assignment(mac, maximize=True)
    rank, sure = [-1] * len(before.rank), [0.0] * len(before.rank)
    for i, k in zip(rows.tolist(), columns.tolist(), strict=True):
        rank[alive[i]], sure[alive[i]] = k, float(mac[i, k])
    return Tracks(modes, tuple(rank), before.names, tuple(sure))


@dataclass(frozen=True)
class FrequencyCurve:
    """A frequency over the stroke from three configurations: 1/omega^2 = c0 + c2 d^2 + c4 d^4.

    drive: name; values (3,) [m or rad] and frequency_Hz (3,): the configurations; coefficients (3,); stroke [m or
    rad]: largest |d|. checked: drive value -> (frequency solved for, relative error) of configurations not used.
    """

    drive: str
    values: tuple[float, ...]
    frequency_Hz: tuple[float, ...]
    coefficients: tuple[float, ...]
    checked: dict[float, tuple[float, float]]

    @property
    def error(self) -> float:
        """Largest relative error at the configurations checked."""
        return max((abs(e) for _, e in self.checked.values()), default=float("nan"))

    def __call__(self, d: Any) -> Any:
        """Frequency [Hz] at drive values `d` [m or rad]; nan where the polynomial says 1/omega^2 <= 0."""
        x = np.asarray(d, float) ** 2
        c0, c2, c4 = self.coefficients
        inverse = c0 + c2 * x + c4 * x * x
        return 1.0 / (2 * np.pi * np.sqrt(np.where(inverse > 0, inverse, np.nan)))


def even_curve(drive: str, values: Any, frequency_Hz: Any, checks: dict[float, float]) -> FrequencyCurve:
    """The even polynomial in 1/omega^2 through three (value, frequency) pairs; `checks`: value -> frequency."""
    d, f = np.asarray(values, float), np.asarray(frequency_Hz, float)
    size = np.abs(d).max()
    powers = np.stack([(d / size) ** n for n in (0, 2, 4)], axis=1)
    c = np.linalg.solve(powers, 1.0 / (2 * np.pi * f) ** 2) / size ** np.array([0, 2, 4])
    bare = FrequencyCurve(drive, tuple(d.tolist()), tuple(f.tolist()), tuple(c.tolist()), {})
    checked = {v: (g, float(bare(v)) / g - 1.0) for v, g in checks.items()}
    return FrequencyCurve(drive, bare.values, bare.frequency_Hz, bare.coefficients, checked)
