"""Fixtures shared by all tests; the scenes are in `scenes.py`."""

import numpy as np
import pytest


@pytest.fixture
def rng():
    """A seeded random generator."""
    return np.random.default_rng(20240607)
