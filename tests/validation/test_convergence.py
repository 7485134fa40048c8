"""The Appendix A chains converge to the strain-mode leaf, at their own order, in every quantity."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
import convergence

# quantities in which the error of second order cancels or is not yet reached with 16 elements: (lowest, highest) order
ORDERS = {
    "guide_x": (3.3, 4.3), "frequency": (3.3, 4.8), "second_frequency": (3.3, 4.8), "support_x": (1.8, 2.6),
    "fourbar_rotation": (1.8, 2.6), "strip": (1.7, 2.3), "notch": (3.8, 4.8),
}  # fmt: skip


@pytest.mark.parametrize("quantity", convergence.QUANTITIES, ids=lambda q: q.__name__)
def test_order(quantity):
    found = convergence.errors(quantity, (8, 16))
    low, high = ORDERS.get(quantity.__name__, (1.8, 2.2))
    assert low < convergence.observed_order(found) < high
    assert found[-1] < 0.02
