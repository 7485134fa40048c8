"""The fourbar measured once for all tests of the benchmark."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).resolve().parents[2] / "benchmarks"))

from bench_measure import measure
from bench_scenes import SUITE


@pytest.fixture(scope="session")
def reading_1():
    return next(c for c in SUITE if "reading 1" in c.name)


@pytest.fixture(scope="session")
def fourbar(reading_1):
    return measure(reading_1, quick=True, repeats=2)
