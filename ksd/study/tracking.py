"""Modes followed along a stroke by the modal assurance criterion (MAC), so that a name stays with its mode.

Modes of neighbouring poses are paired so that the sum of their MAC (mass-weighted, in 0..1) is largest (Allemang and Brown
1982; the assignment problem is solved exactly). Crossing frequencies then swap rank and keep their name. Where one of the
lowest tracks has no partner of at least RELIABLE_MAC, the interval between the poses is bisected, repeatedly: modes that
veer exchange their shapes within a small part of the stroke. Modes of nearly equal frequency (undeformed leaf springs of
equal size vibrate alike, and any combination of their modes is a mode) are finally compared by the space they span. A track
without a partner of at least MIN_MAC even then ends. Each of the lowest modes without a track starts a new one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from ksd.answers.frequencies import Modes
from ksd.errors import KsdError

SPARE_MODES = 2
"""Modes computed in addition to those followed, so that one that rises in rank is still among them."""
MIN_MAC = 0.5
"""MAC below which two modes are different."""
RELIABLE_MAC = 0.8
"""MAC below which the interval between two poses is bisected."""
EQUAL_FREQUENCY_TOLERANCE = 0.01
"""Relative difference of neighbouring frequencies below which modes are compared by the space they span."""
ADDITIONAL_MODES = 10
"""Modes computed in addition where a track has no partner: so many may be nearly equal."""
MAX_BISECTIONS = 5
"""Largest number of nested bisections between two poses."""


IntermediateModes = Callable[[float, int], Modes]
"""Modes at a fraction 0..1 between two poses, and the number of modes in addition to the usual ones."""


@dataclass(frozen=True)
class Tracks:
    """Modes at one pose, by track: rank (t,) of each track among the modes of this pose (-1: lost), names (t,), mac (t,)
    with its mode at the previous pose or the last intermediate one (1 where the track starts)."""

    modes: Modes
    rank: tuple[int, ...]
    names: tuple[str, ...]
    mac: tuple[float, ...]

    def frequency_Hz(self, track: int) -> float:
        """Frequency [Hz] of a track, nan where it is lost."""
        k = self.rank[track]
        return float(self.modes.frequency_Hz[k]) if k >= 0 else float("nan")

    @property
    def first_parasitic(self) -> int | None:
        """The track of the lowest mode that is not intended."""
        first = self.modes.first_parasitic
        return self.rank.index(first) if first in self.rank else None

    @property
    def second_parasitic(self) -> int | None:
        """The track of the lowest mode but one that is not intended."""
        ranks = sorted(k for k in self.rank if k >= 0 and k not in self.modes.intended)
        return self.rank.index(ranks[1]) if len(ranks) > 1 else None


def start_tracks(modes: Modes, count: int) -> Tracks:
    """Tracks of the intended motions and of the `count` lowest other modes, named as in `Modes.names`."""
    parasitic = [k for k in range(len(modes)) if k not in modes.intended][:count]
    ranks = sorted([*modes.intended.tolist(), *parasitic])
    return Tracks(modes, tuple(ranks), tuple(modes.names[k] for k in ranks), (1.0,) * len(ranks))


def continue_tracks(previous: Tracks | None, modes: Modes, count: int, *, by_span: bool = False) -> Tracks:
    """Tracks of the previous pose continued with the `modes` of this one; new ones without a previous pose, and where other
    contacts are closed.

    by_span: modes of nearly equal frequency are compared by the space they span.
    """
    if previous is None or not modes.has_unknowns_of(previous.modes):
        return start_tracks(modes, count)
    alive = [t for t, k in enumerate(previous.rank) if k >= 0]
    ranks = [previous.rank[t] for t in alive]
    single = previous.modes.mac(modes)
    mac = (_group_mac(single, previous.modes, modes) if by_span else single)[ranks]
    # among modes that span the same space, the most similar one
    rows, columns = linear_sum_assignment(mac + single[ranks] if by_span else mac, maximize=True)
    rank, track_mac = [-1] * len(previous.rank), [0.0] * len(previous.rank)
    for i, k in zip(rows.tolist(), columns.tolist(), strict=True):
        if mac[i, k] >= MIN_MAC:
            rank[alive[i]], track_mac[alive[i]] = k, float(mac[i, k])
    names = list(previous.names)
    _assign_intended(names, rank, track_mac, modes.intended.tolist())
    # the lowest modes are always followed, also those that no track continues to
    for k in (k for k in range(min(len(modes.intended) + count, len(modes))) if k not in rank):
        names.append(f"parasitic_{1 + sum(not n.startswith('intended') for n in names)}")
        rank.append(k)
        track_mac.append(1.0)
    return Tracks(modes, tuple(rank), tuple(names), tuple(track_mac))


def _assign_intended(names: list[str], rank: list[int], track_mac: list[float], intended: list[int]) -> None:
    """Put the intended tracks on the modes that are intended at this pose, in place.

    Where modes exchange their shapes, the intended motion is identified by what it does; a track found on its mode gets the
    other mode in exchange.
    """
    own = [t for t, n in enumerate(names) if n.startswith("intended")]
    left = [k for k in intended if k not in [rank[t] for t in own]]
    for t in own:
        if rank[t] in intended:
            continue
        k = left.pop(0) if left else -1
        if k in rank:
            other = rank.index(k)
            rank[other], track_mac[other] = rank[t], track_mac[t]
        rank[t], track_mac[t] = k, 1.0 if k >= 0 else 0.0
    for number, k in enumerate(left, len(own) + 1):
        if k in rank:
            rank[rank.index(k)] = -1
        names.append(f"intended_{number}")
        rank.append(k)
        track_mac.append(1.0)


def _group_mac(mac: np.ndarray, one: Modes, two: Modes) -> np.ndarray:
    """MAC of groups of nearly equal frequency, in the shape of `mac`: the share of the smaller span in the other one."""
    grouped = mac.copy()
    for rows in _frequency_groups(one):
        for columns in _frequency_groups(two):
            share = mac[np.ix_(rows, columns)].sum() / min(len(rows), len(columns))
            grouped[np.ix_(rows, columns)] = min(1.0, share)
    return grouped


def _frequency_groups(modes: Modes) -> list[np.ndarray]:
    """Indices of the modes, ascending, in groups of nearly equal frequency."""
    f = modes.frequency_Hz
    starts = np.flatnonzero(np.diff(f) > EQUAL_FREQUENCY_TOLERANCE * np.abs(f[1:])) + 1
    return np.split(np.arange(len(f)), starts)


def follow_with_bisection(
    previous: Tracks | None, modes: Modes, count: int, modes_at: IntermediateModes | None
) -> Tracks:
    """As `continue_tracks`, and by way of intermediate poses where one of the lowest tracks has no reliable partner.

    modes_at: modes between the previous pose (0) and this one (1); None where there are none.
    """
    tracks = continue_tracks(previous, modes, count)
    if previous is None or modes_at is None or not _is_unreliable(previous, tracks, count):
        return tracks
    try:
        return _bisect(previous, modes, count, modes_at, interval=(0.0, 1.0), bisections=MAX_BISECTIONS)
    except (KsdError, ArithmeticError, np.linalg.LinAlgError):
        return tracks


def _bisect(
    previous: Tracks,
    modes: Modes,
    count: int,
    modes_at: IntermediateModes,
    *,
    interval: tuple[float, float],
    bisections: int,
) -> Tracks:
    """Tracks at the end of an interval from those at its start, with at most so many nested bisections."""
    tracks = continue_tracks(previous, modes, count)
    if not _is_unreliable(previous, tracks, count):
        return tracks
    start, end = interval
    if bisections == 0:
        if not _is_unreliable(previous, tracks, count, min_mac=MIN_MAC):
            return tracks
        # the first of more modes are the same modes
        previous = replace(previous, modes=modes_at(start, ADDITIONAL_MODES))
        return continue_tracks(previous, modes_at(end, ADDITIONAL_MODES), count, by_span=True)
    middle = 0.5 * (start + end)
    half = _bisect(
        previous, modes_at(middle, 0), count, modes_at, interval=(start, middle), bisections=bisections - 1
    )
    return _bisect(half, modes, count, modes_at, interval=(middle, end), bisections=bisections - 1)


def _is_unreliable(previous: Tracks, tracks: Tracks, count: int, *, min_mac: float = RELIABLE_MAC) -> bool:
    """Whether one of the lowest tracks of the previous pose has a MAC below `min_mac` at this one; not where all are new."""
    if not tracks.modes.has_unknowns_of(previous.modes):
        return False
    lowest = count + sum(n.startswith("intended") for n in previous.names)
    return any(0 <= k < lowest and tracks.mac[t] < min_mac for t, k in enumerate(previous.rank))
