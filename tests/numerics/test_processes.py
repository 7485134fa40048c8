"""Processes started from a script without a guard do not run it again, leave Ctrl-C to it and end with it."""

import math
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import active_children

import pytest

import ksd
from ksd.numerics.processes import process_pool, spawn_context

PLAIN = """
import math
from concurrent.futures import ProcessPoolExecutor
from ksd.numerics.processes import spawn_context

print("the script runs")
with ProcessPoolExecutor(1, mp_context=spawn_context(math.sqrt)) as pool:
    print(pool.submit(math.sqrt, 4.0).result())
"""
OWN = """
from concurrent.futures import ProcessPoolExecutor
from ksd.numerics.processes import spawn_context

def own(x):
    return 2 * x

if __name__ == "__main__":
    with ProcessPoolExecutor(1, mp_context=spawn_context(own)) as pool:
        print(pool.submit(own, 2.0).result(), __file__ is not None)
"""
GIVEN_UP = """
import sys, time
from ksd.numerics.processes import process_pool, spawn_context

for wait in (0.0, 0.01, 0.02):
    try:
        with process_pool(spawn_context(bytes), 1) as pool:
            pending = [pool.submit(bytes, 100_000_000) for _ in range(20)]
            pending[0].result()
            time.sleep(wait)
            raise KeyboardInterrupt
    except KeyboardInterrupt:
        print(sum(future.done() for future in pending) == 20, flush=True)
"""
KILLED = """
import os, signal, time
from concurrent.futures import ProcessPoolExecutor
from ksd.numerics.processes import end_with_parent, spawn_context

pool = ProcessPoolExecutor(1, mp_context=spawn_context(time.sleep), initializer=end_with_parent)
print(pool.submit(abs, -1).result(), flush=True)
pool.submit(time.sleep, 3600)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.parametrize(
    ("script", "expected"), [(PLAIN, ["the script runs", "2.0"]), (OWN, ["4.0 True"])], ids=["plain", "own"]
)
def test_a_script_runs_once(tmp_path, script, expected):
    """Without a guard where only imported things are sent; what the script defines is found by running it, as ever."""
    file = tmp_path / "script.py"
    file.write_text(script)
    done = subprocess.run([sys.executable, file], capture_output=True, text=True, timeout=120)
    assert done.stdout.split("\n")[:-1] == expected, done.stderr
    assert done.returncode == 0


def test_from_standard_input():
    """A script that is no file: what it defines cannot be sent."""
    text = "from ksd.numerics.processes import spawn_context\nclass Own: pass\nimport math\n"
    text += "print(spawn_context(Own()), spawn_context(lambda: 0), spawn_context(math.pi) is not None)"
    done = subprocess.run([sys.executable], input=text, capture_output=True, text=True, timeout=60)
    assert done.stdout.split() == ["None", "None", "True"], done.stderr


def nothing():
    """What is sent."""


def test_a_pool_that_is_given_up_ends_its_processes():
    """They would be waited for for an hour."""
    before = active_children()
    with pytest.raises(KeyboardInterrupt), process_pool(spawn_context(nothing), 2) as pool:
        assert pool.submit(abs, -1).result() == 1
        own = [child for child in active_children() if child not in before]
        given_up = [pool.submit(time.sleep, 3600) for _ in range(3)]
        raise KeyboardInterrupt
    assert len(own) == 2 and not any(child.is_alive() for child in own)
    assert given_up[2].cancelled()
    with pytest.raises(BrokenProcessPool):
        given_up[0].result()


@pytest.mark.skipif(os.name == "nt", reason="kills as POSIX does")
def test_a_process_that_ends_while_it_writes_a_result_is_not_waited_for():
    """Interrupted within results of 100 MB; fifty interrupted training runs: benchmarks/interrupts.py."""
    done = subprocess.run([sys.executable, "-c", GIVEN_UP], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout.split()) == (0, ["True"] * 3), done.stderr


def test_what_a_process_answers_instead_of_a_result():
    """The error of the task, with where it was raised; that of what cannot be sent back; the end of the process."""
    with process_pool(spawn_context(nothing), 1) as pool:
        with pytest.raises(ValueError, match="math domain error") as told:
            pool.submit(math.sqrt, -1.0).result()
        assert "_run_tasks" in told.value.__notes__[0]
        with pytest.raises(ksd.SceneError, match="scene file 'no' cannot be read") as told:
            pool.submit(ksd.load_scene, "no").result()
        assert not hasattr(told.value, "__notes__")
        with pytest.raises(TypeError, match=r"cannot pickle '_thread\.lock'"):
            pool.submit(threading.Lock).result()
        with pytest.raises((AttributeError, pickle.PicklingError), match="local object"):
            pool.submit(lambda: 0).result()
        assert pool.submit(math.sqrt, 4.0).result() == 2.0
        with pytest.raises(BrokenProcessPool, match="ended while it worked on a task"):
            pool.submit(os._exit, 3).result()


def handler_of_a_new_process():
    """What it does with Ctrl-C before anything of ours has run in it."""
    with ProcessPoolExecutor(1, mp_context=spawn_context(nothing)) as pool:
        return pool.submit(signal.getsignal, signal.SIGINT).result()


@pytest.mark.skipif(os.name == "nt", reason="handlers are inherited where processes are of POSIX")
def test_a_new_process_leaves_interrupts_while_it_imports():
    before = signal.getsignal(signal.SIGINT)
    assert handler_of_a_new_process() == signal.SIG_IGN
    assert signal.getsignal(signal.SIGINT) is before
    with ThreadPoolExecutor(1) as thread:
        # only the main thread can
        assert thread.submit(handler_of_a_new_process).result() == signal.default_int_handler


@pytest.mark.skipif(os.name == "nt", reason="kills as POSIX does")
def test_a_process_ends_with_a_parent_that_is_killed():
    """Otherwise it would keep what the parent writes to open, here for an hour."""
    done = subprocess.run([sys.executable, "-c", KILLED], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout) == (-signal.SIGKILL, "1\n"), done.stderr
