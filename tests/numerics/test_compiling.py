"""How kernels are compiled: for callers without machine code of their own, and once by processes that share a cache."""

import gc
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from numba.core.errors import NumbaError
from numba.core.types.functions import BaseFunction

from ksd.numerics import cache
from ksd.numerics.kernel import kernel


@kernel(cache=False)
def _part(x, y, out):
    for i in range(len(x)):
        out[i] = x[i] * y + len(x)


@kernel(cache=False)
def _whole(x):
    out = np.zeros(len(x))
    _part(x, 2.0, out)
    return out.sum()


@kernel(cache=False)
def _sum_of_two(x, y):
    return x + y


def test_a_kernel_called_by_a_kernel_has_no_machine_code_of_its_own():
    assert _whole(np.arange(3.0)) == 15.0
    (inside,) = _part.within.overloads.values()
    assert inside.library.get_pointer_to_function("anything") == 0
    # from Python it gets some
    out = np.zeros(2)
    _part(np.ones(2), 3.0, out)
    assert out.tolist() == [5.0, 5.0]
    assert _part.outside.signatures
    assert gc.isenabled()


def test_calls_are_remembered_by_type_and_only_while_a_kernel_compiles():
    numbas = BaseFunction.get_call_type
    assert _sum_of_two(1, 2) == 3 and isinstance(_sum_of_two(1, 2), int)
    assert _sum_of_two(1.5, 2) == 3.5 and _sum_of_two(1, 2j) == 1 + 2j
    with pytest.raises(NumbaError):
        _sum_of_two("word", 1.0)
    assert BaseFunction.get_call_type is numbas


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "FOLDER", tmp_path)
    return tmp_path


def test_the_first_to_ask_compiles_and_the_others_wait(folder):
    said = []

    def other():
        with cache.turn("entry"):
            said.append("other")

    with cache.turn("entry"):
        beside = threading.Thread(target=other)
        beside.start()
        time.sleep(0.2)
        said.append("first")
    beside.join(10)
    assert said == ["first", "other"]
    assert [p.name for p in folder.iterdir()] == ["entry.done"]


def test_a_compiler_that_died_holds_nobody_up(folder):
    gone = subprocess.run(
        [sys.executable, "-c", "import os; print(os.getpid())"], capture_output=True, text=True
    )
    (folder / "entry.compiling").write_text(gone.stdout.strip())
    begin = time.monotonic()
    with cache.turn("entry"):
        pass
    assert time.monotonic() - begin < 60
    assert (folder / "entry.done").exists()


def test_a_failure_leaves_the_entry_to_the_next(folder):
    with pytest.raises(ZeroDivisionError), cache.turn("entry"):
        raise ZeroDivisionError
    assert not list(folder.iterdir())
    assert cache.take("entry") and not cache.take("entry")
