"""Where the joints of an answer are: inside their trained ranges, and near their intended motions. Looked at compiled."""

from __future__ import annotations

import numpy as np

from ksd.numerics.kernel import kernel

MAX_UNINTENDED_ROTATION = np.deg2rad(30.0)
"""Unintended rotation of a joint [rad] beyond which its state is not the one its record describes."""
MAX_UNINTENDED_DISPLACEMENT = 0.3
"""Unintended displacement of a joint, over its length, beyond which the same holds."""
MAX_EXTRAPOLATION = 1.0
"""Distance from the middle of a trained range, over its width, beyond which its polynomials mean nothing."""
RANGE_TOLERANCE = 1e-5
"""Fraction of a trained range by which a motion may be over its end: rounding, not extrapolation. A joint driven to the very
end is found there to within the error of its interface functions, 2.2e-6 of the range at most in the shipped records; and a
residual of degree 12 grows by no more than 2 * 12^2 * 1e-5 = 0.3 % on that much more (Markov's inequality)."""


def motion_limits(motion_range: np.ndarray) -> np.ndarray:
    """(q, 4): trained ranges with their slack, and where the polynomials cease to mean anything; of ranges (q, 2)."""
    low, high = motion_range.T
    slack, middle, reach = (
        RANGE_TOLERANCE * (high - low),
        0.5 * (low + high),
        MAX_EXTRAPOLATION * (high - low),
    )
    return np.column_stack([low - slack, high + slack, middle - reach, middle + reach])


@kernel(inline="always")
def is_outside(theta, limits, first):
    """Whether a motion (q,) is outside columns first and first + 1 of limits (q, ..)."""
    # any() of a generator does not compile
    for q in range(len(theta)):  # noqa: SIM110
        if not limits[q, first] <= theta[q] <= limits[q, first + 1]:
            return True
    return False


@kernel(inline="always")
def is_far_off(off, turn_at, length, unknown):
    """Whether a joint is further off its intended motion, off (J, ..), than its record describes; length (J,).

    Beyond a whole length nothing is known of a joint, and it counts as far only when `unknown` is 1.
    """
    for j in range(len(off)):
        shift, turn = 0.0, 0.0
        for r in range(off.shape[1]):
            if r < turn_at:
                shift += off[j, r] ** 2
            else:
                turn += off[j, r] ** 2
        close = shift <= (MAX_UNINTENDED_DISPLACEMENT * length[j]) ** 2 and turn <= MAX_UNINTENDED_ROTATION**2
        if not close and (unknown == 1 or shift < length[j] ** 2):
            return True
    return False


@kernel(inline="always")
def check_joints(theta, found, off, known, turn_at, limits, length, seen):
    """seen[0]: whether the motions theta (q,) of step 1 are in their trained ranges; seen[1]: whether those of the answer,
    found (q,), are known and every joint is near its own. limits (q, 4): see `motion_limits`; off, known: what is left."""
    first = 0 * turn_at
    seen[0] = 0 if is_outside(theta, limits, first) else 1
    seen[1] = 0 if is_outside(found, limits, first + 2) or is_far_off(off, turn_at, length, first + 1) else 1
    for j in range(len(known)):
        if known[j] != 1:
            seen[1] = 0
