"""The process that compiles kernels beside the first one."""

import os
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


FRESH = """
import sys
from ksd.numerics import cache
with cache.turn("something"):
    pass
with cache.turn("something else"):
    pass
"""


def test_a_process_says_once_that_it_compiles_or_waits_and_helpers_say_nothing(tmp_path):
    """A second process finds kernels in the cache and still has to wait for one that is being compiled."""

    def said(**environment):
        environment = {**os.environ, "KSD_CACHE_DIR": str(tmp_path), **environment}
        done = subprocess.run(
            [sys.executable, "-c", FRESH], capture_output=True, text=True, env=environment, timeout=60
        )
        assert done.returncode == 0
        return done.stderr

    assert said() == "ksd: compiling kernels not used before on this machine (once) ...\n"
    assert said() == ""
    (folder,) = tmp_path.iterdir()
    (folder / "something.done").unlink()
    assert said(KSD_COMPILE_ALONE="1") == ""
    (folder / "something.done").unlink()
    # a process of this number does not run any more: it is waited for as long as it takes to see that
    (folder / "something.compiling").write_text("99999999")
    assert said() == "ksd: waiting for kernels that are being compiled ...\n"
