"""Fixtures shared by all tests; the scenes are in `scenes.py`."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

# before numpy is loaded: last digits of the steps of scipy's SLSQP hang on how many threads its linear algebra finds free,
# and what threads and processes find is compared bit for bit
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# a shell's job in the background ignores interrupts, and so would all that it starts
if threading.current_thread() is threading.main_thread():
    signal.signal(signal.SIGINT, signal.default_int_handler)

import numpy as np
import pytest
from processes import environment


def pytest_configure(config):
    """Compile the kernels once, before the workers of pytest-xdist start: each of them then finds them in the cache."""
    if hasattr(config, "workerinput") or not getattr(config.option, "numprocesses", None):
        return
    tests = Path(__file__).parent
    parts = [[sys.executable, tests / "kernels.py", part] for part in ("equilibrium", "joints")]
    # these two are enough (`ksd.solvers.precompile`)
    given = environment(tests, NUMBA_NUM_THREADS="1")
    for process in [subprocess.Popen(part, env=given) for part in parts]:
        assert process.wait() == 0, "kernels.py does not run"


# files whose tests take longest: were they the last, one worker would wait for the other. Those in a browser come later,
# when what their servers need is compiled.
LONGEST = ("test_style.py", "test_benchmarks.py", "test_docs.py", "test_examples.py")


def pytest_collection_modifyitems(items):
    """The longest files first; the order of all others stays."""
    items.sort(key=lambda item: item.path.name not in LONGEST)


@pytest.fixture
def rng():
    """A seeded random generator."""
    return np.random.default_rng(20240607)
