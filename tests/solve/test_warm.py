"""The process that compiles kernels beside the first one."""

import subprocess
import sys

CHILD = """
import os
from ksd.solve.warm import leave_with
parent = os.getppid()
print("here", flush=True)
leave_with(parent)
"""
PARENT = f"""
import subprocess, sys
child = subprocess.Popen([sys.executable, "-c", {CHILD!r}], stdout=subprocess.PIPE, text=True)
child.stdout.readline()
sys.stderr.write("gone")
"""


def test_the_second_compiler_leaves_with_its_parent():
    # stderr is shared with the child: `run` returns only when both have closed it
    done = subprocess.run([sys.executable, "-c", PARENT], stderr=subprocess.PIPE, text=True, timeout=120)
    assert done.stderr.endswith("gone")
