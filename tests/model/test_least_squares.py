"""The normal equations of step 1, in a skyline, beside those of numpy."""

import numpy as np
import pytest

from ksd.joints.kinematics import least_squares, least_squares_scratch


@pytest.mark.parametrize("share", [1.0, 0.5, 0.15])
@pytest.mark.parametrize("rows, motions", [(1, 1), (7, 4), (9, 9), (40, 25), (12, 3)])
def test_steps_are_those_of_numpy(rows, motions, share, rng):
    for _ in range(20):
        J = rng.normal(size=(rows, motions)) * (rng.random((rows, motions)) < share)
        # whole rank: every motion has a row of its own
        J[:motions] += 3.0 * np.eye(motions)
        residual, step = rng.normal(size=rows), np.full(motions, np.nan)
        pivot = least_squares(J, residual, step, np.full_like(least_squares_scratch(rows, motions), np.nan))
        assert 0.0 < pivot <= 1.0
        assert step == pytest.approx(np.linalg.lstsq(J, -residual, rcond=None)[0], rel=1e-7, abs=1e-9)


def test_a_motion_that_nothing_holds_has_no_pivot():
    J, step = np.zeros((3, 2)), np.zeros(2)
    J[:, 0] = 1.0
    assert least_squares(J, np.ones(3), step, least_squares_scratch(3, 2)) == 0.0


def test_entries_of_one_are_entries():
    J, step = np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 1.0], [1.0, 0.0, 1.0]]), np.zeros(3)
    assert least_squares(J, np.array([1.0, 2.0, 5.0]), step, least_squares_scratch(3, 3)) > 0.1
    assert step == pytest.approx([-2.0, 1.0, -3.0])
