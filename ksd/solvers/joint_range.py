"""Checks of the joints of a result: inside their trained ranges, and near their intended motions."""

from __future__ import annotations

import numpy as np

from ksd.numerics.kernel import kernel

MAX_UNINTENDED_ROTATION = np.deg2rad(30.0)
"""Unintended rotation of a joint [rad] beyond which its state is not the one that its record describes."""
MAX_UNINTENDED_DISPLACEMENT = 0.3
"""Unintended displacement of a joint, over its length, beyond which the same holds."""
MAX_EXTRAPOLATION = 1.0
"""Distance from the middle of a trained range, over its width, beyond which the record's polynomials are meaningless."""
RANGE_TOLERANCE = 1e-5
"""Fraction of a trained range by which a motion may exceed it without counting as extrapolation. A joint driven to the very
end of its range is found there to within the error of its interface functions, at most 2.2e-6 of the range in the shipped
records; a residual of degree 12 grows by at most 2 * 12^2 * 1e-5 = 0.3 % over that excess (Markov's inequality)."""


def motion_limits(motion_range: np.ndarray) -> np.ndarray:
    """Limits (q, 4) of the motions: trained range widened by its tolerance, range in which polynomials mean anything.

    motion_range (q, 2): trained ranges.
    """
    low, high = motion_range.T
    tolerance, middle = RANGE_TOLERANCE * (high - low), 0.5 * (low + high)
    radius = MAX_EXTRAPOLATION * (high - low)
    return np.column_stack([low - tolerance, high + tolerance, middle - radius, middle + radius])


@kernel(inline="always")
def is_outside(theta, limits, first):
    """Whether any motion theta (q,) is outside its limits, columns first and first + 1 of limits (q, ..)."""
    # any() of a generator does not compile
    for q in range(len(theta)):  # noqa: SIM110
        if not limits[q, first] <= theta[q] <= limits[q, first + 1]:
            return True
    return False


@kernel(inline="always")
def is_far_off(unintended, length, count_unknown):
    """Whether a joint is further off its intended motion than its record describes.

    unintended (J, 6): displacement [m] and rotation [rad] off the intended pose; length (J,) [m]. The motion of a joint off
    by more than its length is not known: such a joint counts only where `count_unknown` is 1.
    """
    for j in range(len(unintended)):
        shift, turn = 0.0, 0.0
        for r in range(3):
            shift += unintended[j, r] ** 2
            turn += unintended[j, 3 + r] ** 2
        near = shift <= (MAX_UNINTENDED_DISPLACEMENT * length[j]) ** 2 and turn <= MAX_UNINTENDED_ROTATION**2
        if not near and (count_unknown == 1 or shift < length[j] ** 2):
            return True
    return False


@kernel(inline="always")
def check_joints(theta, answer_theta, unintended, is_known, limits, length, checks):
    """Check the motions theta (q,) of step 1 and answer_theta (q,) of the result; writes 1 or 0 into checks (2,).

    checks[0]: theta is in the trained ranges; checks[1]: answer_theta is known and every joint is near its intended motion.
    limits (q, 4): see `motion_limits`; unintended, length: see `is_far_off`; is_known (J,).
    """
    # variables, because literals would compile these functions again
    first = 0 * len(theta)
    checks[0] = 0 if is_outside(theta, limits, first) else 1
    checks[1] = (
        0 if is_outside(answer_theta, limits, first + 2) or is_far_off(unintended, length, first + 1) else 1
    )
    for j in range(len(is_known)):
        if is_known[j] != 1:
            checks[1] = 0
