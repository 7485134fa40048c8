"""Modes followed along a stroke by the modal assurance criterion (MAC), so that a name stays with its mode.

Between neighbouring poses the modes are paired so that the sum of their assurances (mass-weighted, in 0..1) is largest
(Allemang and Brown 1982; the assignment is solved exactly). Crossing frequencies then swap rank and keep their name. A
track without a partner of assurance LOST or more ends, and the lowest mode without a track begins a new one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ksd.properties.frequencies import Modes

SPARE = 2
"""Modes computed beyond those followed, so that one which rises in rank is still there."""


LOST = 0.5
"""Assurance below which two modes are not the same one."""


@dataclass(frozen=True)
class Tracks:
    """Modes at one pose, by track: rank (t,) of each track among the modes of this pose (-1: lost), names (t,),
    assurance (t,) with its mode at the pose before (1 where the track begins)."""

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
        known = [t for t, n in enumerate(self.names) if not n.startswith("intended") and self.rank[t] >= 0]
        return min(known, key=self.frequency_Hz) if known else None


def intended_modes(modes: Modes) -> list[int]:
    """Ranks of the intended motions, one per freed drive, ascending: the pairing of drives and modes in which the modes
    carry most of the drives' compliances (drive motion / omega)^2, each drive counted by its own total."""
    from scipy.optimize import linear_sum_assignment

    if not modes.freed or not modes.drive_motion.size:
        return []
    share = modes.drive_motion**2 / np.abs(modes.omega_squared)[:, None]
    total = share.sum(axis=0)
    free = total > 0.0
    rows, _ = linear_sum_assignment(share[:, free] / total[free], maximize=True)
    return sorted(rows.tolist())


def first_tracks(modes: Modes, count: int) -> Tracks:
    """Tracks of the intended motions and of the `count` lowest modes besides: "intended" ("intended_1", ... where several
    drives are let go), "parasitic_1", ... in the order of their frequencies."""
    own = intended_modes(modes)
    others = [k for k in range(len(modes)) if k not in own][:count]
    named = {k: "intended" if len(own) == 1 else f"intended_{n + 1}" for n, k in enumerate(own)}
    named |= {k: f"parasitic_{n + 1}" for n, k in enumerate(others)}
    ranks = sorted(named)
    return Tracks(modes, tuple(ranks), tuple(named[k] for k in ranks), (1.0,) * len(ranks))


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
        if mac[i, k] >= LOST:
            rank[alive[i]], sure[alive[i]] = k, float(mac[i, k])
    names = list(before.names)
    own = intended_modes(modes)
    for t, n in enumerate(names):
        # an intended motion is known by what it does, should the chain of assurances break
        left = [k for k in own if k not in rank]
        if n.startswith("intended") and rank[t] < 0 and left:
            rank[t], sure[t] = left[0], 1.0
    for k in (k for k in range(len(modes)) if k not in rank):
        alive_now = sum(r >= 0 and not n.startswith("intended") for r, n in zip(rank, names, strict=True))
        if alive_now >= count:
            break
        names.append(f"parasitic_{1 + sum(not n.startswith('intended') for n in names)}")
        rank.append(k)
        sure.append(1.0)
    return Tracks(modes, tuple(rank), tuple(names), tuple(sure))
