"""Fixtures shared by all tests; the scenes are in `scenes.py`."""

import numpy as np
import pytest


def pytest_configure(config):
    """Compile the kernels once, before the workers of pytest-xdist start: each of them then finds them in the cache."""
    if hasattr(config, "workerinput") or not getattr(config.option, "numprocesses", None):
        return
    from scenes import fourbar

    import ksd

    for mesh in (None, ksd.Mesh("corotational", elements=2)):
        for planar in (True, False):
            ksd.prepare(fourbar(), mesh=mesh, planar=planar)(top=0.1, method="full")


@pytest.fixture
def rng():
    """A seeded random generator."""
    return np.random.default_rng(20240607)
