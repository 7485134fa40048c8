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
        if mac[i, k] >= LOST:
            rank[alive[i]], sure[alive[i]] = k, float(mac[i, k])
    names = list(before.names)
    for k in (k for k in range(len(modes)) if k not in rank):
        if sum(r >= 0 for r in rank) >= min(count, len(modes)):
            break
        name = f"parasitic_{1 + sum(n != 'intended' for n in names)}"
        names.append("intended" if k == modes.intended and "intended" not in names else name)
        rank.append(k)
        sure.append(1.0)
    return Tracks(modes, tuple(rank), tuple(names), tuple(sure))
