"""A second process compiles for the first answer what the first comes to late; the answer never hangs on it."""

import os
import subprocess
import sys
from multiprocessing import current_process
from pathlib import Path

import pytest
from processes import environment

from ksd.errors import RecordError
from ksd.solvers import precompile

TESTS = Path(__file__).parents[1]
SECOND = "from ksd.solvers.precompile import precompile_kernels; precompile_kernels()"
FIRST = """
from scenes import fourbar
import ksd
print(ksd.solve(fourbar(), top=0.1, method="full").forces["top"])
"""
STARTED = """
import multiprocessing, sys
from ksd.solvers import precompile

print("the script runs")
precompile.COMPILES_KERNELS = precompile.HAS_SPARE_CORE = True
for _ in range(2):
    precompile.start_precompiling()
(child,) = multiprocessing.active_children()
if sys.argv[1] == "wait":
    child.join()
print(child.pid, child.exitcode)
"""


def started(way, tmp_path):
    script = tmp_path / "script.py"
    script.write_text(STARTED)
    done = subprocess.run([sys.executable, script, way], env=environment(), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    # of the two the first alone says that it compiles
    assert "Error" not in done.stderr
    assert done.stderr.count("\n") == done.stderr.count("ksd: compiling its kernels") <= 1
    begun, (pid, code) = done.stdout.split("\n")[0], done.stdout.split("\n")[1].split()
    assert begun == "the script runs"
    assert done.stdout.count(begun) == 1
    return int(pid), code


def test_it_runs_once_beside_a_script_without_a_guard(tmp_path):
    assert started("wait", tmp_path)[1] == "0"


@pytest.mark.skipif(os.name == "nt", reason="processes of POSIX")
def test_it_ends_with_the_first(tmp_path):
    pid, code = started("go", tmp_path)
    assert code == "None"
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


@pytest.mark.parametrize(
    "where", ["wanted", "compiled", "one core", "a pool", "inside", "unknown", "refused"]
)
def test_it_is_not_started_where_it_does_not_belong(where, monkeypatch):
    begun = []

    class Context:
        class Process:
            def __init__(self, target, daemon):
                assert daemon
                self.target = target

            def start(self):
                if where == "refused":
                    raise BlockingIOError
                begun.append(self.target)

    monkeypatch.setattr(precompile, "spawn_context", lambda *_: Context)
    monkeypatch.setattr(precompile, "COMPILES_KERNELS", where != "compiled")
    monkeypatch.setattr(precompile, "HAS_SPARE_CORE", where != "one core")
    monkeypatch.setattr(
        current_process(), "name", "SpawnPoolWorker-1" if where == "a pool" else "MainProcess"
    )
    program = {"inside": "/opt/drawing/bin/draw", "unknown": None}.get(where, sys.executable)
    monkeypatch.setattr(sys, "executable", program)
    precompile.start_precompiling.__wrapped__()
    assert begun == ([precompile.precompile_kernels] if where == "wanted" else [])


def test_it_says_nothing_of_records_that_are_not_there(monkeypatch):
    """They are the business of the first process; the second would print a traceback."""
    asked = []

    def missing(family):
        asked.append(family)
        raise RecordError("no record")

    monkeypatch.setattr(precompile, "end_with_parent", lambda: None)
    monkeypatch.setattr(precompile, "find_record", missing)
    precompile.precompile_kernels()
    assert asked == ["cross_flexure", "cross_flexure"]


@pytest.mark.parametrize(("interpreted", "kept"), [("0", True), ("1", True), ("0", False)])
def test_nothing_is_compiled_in_the_interpreter_or_kept_without_a_folder(tmp_path, interpreted, kept):
    (tmp_path / "file").touch()
    place = str(tmp_path if kept else tmp_path / "file")
    program = (
        f"import tempfile; tempfile.tempdir = {place!r}\n"
        "from ksd.solvers.precompile import COMPILES_KERNELS, HAS_SPARE_CORE; print(COMPILES_KERNELS, HAS_SPARE_CORE)"
    )
    given = environment(
        KSD_CACHE_DIR=place, XDG_CACHE_HOME=place, NUMBA_DISABLE_JIT=interpreted, NUMBA_NUM_THREADS="1"
    )
    done = subprocess.run([sys.executable, "-c", program], env=given, capture_output=True, text=True)
    assert done.stdout.split() == [str(interpreted == "0" and kept), "False"], done.stderr
