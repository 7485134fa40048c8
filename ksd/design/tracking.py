"""Modes followed along a stroke by the modal assurance criterion (MAC), so that a name stays with its mode.

IntermediateModes neighbouring poses the modes are paired so that the sum of their MAC (mass-weighted, in 0..1) is largest
(Allemang and Brown 1982; the assignment is solved exactly). Crossing frequencies then swap rank and keep their name. Where
one of the lowest tracks has no partner of MAC RELIABLE_MAC or more, the way between the poses is halved, and halved again:
modes that veer exchange their shapes within a small part of the stroke. Modes of nearly equal frequency (at rest all leaves
of one size vibrate alike, and any mixture of them is a mode) are in the end compared by what they span together. A track
without a partner of MAC MIN_MAC or more even so ends. Of the lowest modes every one without a track begins a new one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ksd.errors import KsdError
from ksd.properties.frequencies import Modes

SPARE_MODES = 2
"""Modes computed beyond those followed, so that one which rises in rank is still there."""
MIN_MAC = 0.5
"""MAC below which two modes are not the same one."""
RELIABLE_MAC = 0.8
"""MAC below which poses in between are looked at."""
EQUAL_FREQUENCY_TOLERANCE = 0.01
"""Relative distance of neighbouring frequencies below which modes are compared by what they span together."""
ADDITIONAL_MODES = 10
"""Modes computed besides where a track is lost: as many may be nearly equal."""
MAX_BISECTIONS = 5
"""How often the way between two poses is halved at the most."""


IntermediateModes = Callable[[float, int], Modes]
"""Modes at a share 0..1 of the way between two poses, and so many more than usual."""


@dataclass(frozen=True)
class Tracks:
    """Modes at one pose, by track: rank (t,) of each track among the modes of this pose (-1: lost), names (t,),
    mac (t,) with its mode at the pose before, or the last one in between (1 where the track begins)."""

    modes: Modes
    rank: tuple[int, ...]
    names: tuple[str, ...]
    mac: tuple[float, ...]

    def frequency_Hz(self, track: int) -> float:
        """Frequency [Hz] of a track, nan where it was not found."""
        k = self.rank[track]
        return float(self.modes.frequency_Hz[k]) if k >= 0 else float("nan")

    @property
    def first_parasitic(self) -> int | None:
        """The track of the lowest mode that is not intended."""
        first = self.modes.first_parasitic
        return self.rank.index(first) if first in self.rank else None


def start_tracks(modes: Modes, count: int) -> Tracks:
    """Tracks of the intended motions and of the `count` lowest modes besides, named as `Modes.names`."""
    others = [k for k in range(len(modes)) if k not in modes.intended][:count]
    ranks = sorted([*modes.intended.tolist(), *others])
    return Tracks(modes, tuple(ranks), tuple(modes.names[k] for k in ranks), (1.0,) * len(ranks))


def follow(before: Tracks | None, modes: Modes, count: int, *, together: bool = False) -> Tracks:
    """The tracks of the pose before, found again among the `modes` of this one; new ones when there was none.

    together: modes of nearly equal frequency are compared by what they span.
    """
    from scipy.optimize import linear_sum_assignment

    if before is None:
        return start_tracks(modes, count)
    alive = [t for t, k in enumerate(before.rank) if k >= 0]
    ranks = [before.rank[t] for t in alive]
    own = before.modes.mac(modes)
    mac = (_spanned(own, before.modes, modes) if together else own)[ranks]
    # of modes that span the same, the one most alike
    rows, columns = linear_sum_assignment(mac + own[ranks] if together else mac, maximize=True)
    rank, sure = [-1] * len(before.rank), [0.0] * len(before.rank)
    for i, k in zip(rows.tolist(), columns.tolist(), strict=True):
        if mac[i, k] >= MIN_MAC:
            rank[alive[i]], sure[alive[i]] = k, float(mac[i, k])
    names = list(before.names)
    _settle_intended(names, rank, sure, modes.intended.tolist())
    # whatever comes from above, the lowest are followed
    for k in (k for k in range(min(len(modes.intended) + count, len(modes))) if k not in rank):
        names.append(f"parasitic_{1 + sum(not n.startswith('intended') for n in names)}")
        rank.append(k)
        sure.append(1.0)
    return Tracks(modes, tuple(rank), tuple(names), tuple(sure))


def _settle_intended(names: list[str], rank: list[int], sure: list[float], intended: list[int]) -> None:
    """Put the intended tracks on the modes that are intended at this pose, in place.

    Where shapes are exchanged along the way, a motion is known by what it does; the track found there takes the mode left.
    """
    mine = [t for t, n in enumerate(names) if n.startswith("intended")]
    left = [k for k in intended if k not in [rank[t] for t in mine]]
    for t in mine:
        if rank[t] in intended:
            continue
        k = left.pop(0) if left else -1
        if k in rank:
            other = rank.index(k)
            rank[other], sure[other] = rank[t], sure[t]
        rank[t], sure[t] = k, 1.0 if k >= 0 else 0.0
    for number, k in enumerate(left, len(mine) + 1):
        if k in rank:
            rank[rank.index(k)] = -1
        names.append(f"intended_{number}")
        rank.append(k)
        sure.append(1.0)


def _spanned(mac: np.ndarray, one: Modes, two: Modes) -> np.ndarray:
    """MAC of groups of nearly equal frequency, in the shape of `mac`: the share of the smaller span in the other."""
    found = mac.copy()
    for rows in _groups(one):
        for columns in _groups(two):
            share = mac[np.ix_(rows, columns)].sum() / min(len(rows), len(columns))
            found[np.ix_(rows, columns)] = min(1.0, share)
    return found


def _groups(modes: Modes) -> list[np.ndarray]:
    """Numbers of modes, ascending, in groups of nearly equal frequency."""
    f = modes.frequency_Hz
    apart = np.flatnonzero(np.diff(f) > EQUAL_FREQUENCY_TOLERANCE * np.abs(f[1:])) + 1
    return np.split(np.arange(len(f)), apart)


def follow_with_bisection(
    before: Tracks | None, modes: Modes, count: int, between: IntermediateModes | None
) -> Tracks:
    """As `follow`; where one of the lowest tracks is in doubt, by the modes of poses in between.

    between(share, more) (None where there is no way): modes at a share 0..1 of the way from the pose before to this one,
    `more` than usual.
    """
    found = follow(before, modes, count)
    if before is None or between is None or not _in_doubt(before, found, count):
        return found
    try:
        return _halved(before, modes, count, between, way=(0.0, 1.0, MAX_BISECTIONS))
    except (KsdError, ArithmeticError, np.linalg.LinAlgError):
        return found


def _halved(
    before: Tracks, modes: Modes, count: int, between: IntermediateModes, *, way: tuple[float, float, int]
) -> Tracks:
    """Modes named from those before; where a partner is in doubt from a pose half way, `left` more times. way: pose before,
    pose, left."""
    start, end, left = way
    found = follow(before, modes, count)
    if not _in_doubt(before, found, count):
        return found
    if left == 0:
        if not _in_doubt(before, found, count, sure=MIN_MAC):
            return found
        # the same modes come first among more of them
        return follow(
            replace(before, modes=between(start, ADDITIONAL_MODES)),
            between(end, ADDITIONAL_MODES),
            count,
            together=True,
        )
    middle = 0.5 * (start + end)
    half = _halved(before, between(middle, 0), count, between, way=(start, middle, left - 1))
    return _halved(half, modes, count, between, way=(middle, end, left - 1))


def _in_doubt(before: Tracks, found: Tracks, count: int, *, sure: float = RELIABLE_MAC) -> bool:
    """Whether one of the lowest tracks of the pose before has no partner, or none that is `sure`."""
    lowest = count + sum(n.startswith("intended") for n in before.names)
    return any(0 <= k < lowest and found.mac[t] < sure for t, k in enumerate(before.rank))
