"""The stroke of the fourbar, swept once for all tests of pictures."""

import numpy as np
import pytest
from scenes import fourbar

import ksd
from ksd.study.questions import ALL_QUESTIONS


@pytest.fixture(scope="session")
def table():
    """Nine poses of the fourbar, the last out of reach."""
    values = [*np.linspace(0, 0.3, 8), 0.6]
    return ksd.sweep(fourbar(), method="full", questions=ALL_QUESTIONS, top=values, progress=False)
