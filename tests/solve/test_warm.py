"""The process that compiles kernels beside the first one."""

import os
import subprocess
import sys
from pathlib import Path

import ksd
from ksd.numerics import kernel

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


def test_the_second_compiler_has_the_package_of_the_first(tmp_path, monkeypatch):
    """Also in a folder with a package of that name, as a checkout has: numba keeps kernels by the place of their source."""
    (tmp_path / "ksd").mkdir()
    (tmp_path / "ksd" / "__init__.py").write_text("raise RuntimeError('the wrong one')")
    started = []
    with monkeypatch.context() as here:
        here.chdir(tmp_path)
        here.setattr(kernel, "FOLDER", Path("cache") / "kernels-of-now")
        here.setattr(kernel, "take", lambda name: True)
        here.setattr(kernel.os, "cpu_count", lambda: 2)
        here.setattr(kernel.subprocess, "Popen", lambda *args, **words: started.append((args, words)))
        kernel._start_beside()
    (((command,), words),) = started
    assert (
        words["env"]["KSD_CACHE_DIR"] == str(tmp_path / "cache") and words["env"]["KSD_COMPILE_ALONE"] == "1"
    )
    asked = [*command[:1], "-m", "ksd", "--version"]
    where = "import ksd; print(ksd.__file__)"
    for call in (asked, [*command[:1], "-c", where]):
        done = subprocess.run(
            call, cwd=words["cwd"], env=words["env"], capture_output=True, text=True, timeout=60
        )
        assert done.returncode == 0, done.stderr
    assert Path(done.stdout.strip()) == Path(ksd.__file__)
