"""What processes have that tests start: the ksd that is tested, wherever it is, and so the kernels compiled for it.

Another one in the working folder or named by a path would have all its kernels compiled once more.
"""

import os
from pathlib import Path

import ksd


def environment(*folders, **more):
    """Variables of such a process; `folders` are searched for imports besides."""
    home = Path(ksd.__file__).parents[1]
    paths = os.pathsep.join(map(str, (home, *folders)))
    return {**os.environ, "PYTHONPATH": paths, "PYTHONSAFEPATH": "1", **more}
