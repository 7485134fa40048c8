"""The fourbar measured once for all tests of the benchmark."""

import pytest

from ksd.bench import SUITE, measure


@pytest.fixture(scope="session")
def reading_1():
    return next(c for c in SUITE if "reading 1" in c.name)


@pytest.fixture(scope="session")
def fourbar(reading_1):
    return measure(reading_1, quick=True, repeats=2)
