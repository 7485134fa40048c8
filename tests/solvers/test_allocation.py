"""The iterations of a solve are one call, and prepared storage is one of a thread."""

import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scenes import fourbar, single_joint

from ksd.model.arrays import make_workspace
from ksd.model.compile import compile_scene
from ksd.model.newton import solve_equilibrium
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.storage import MAX_STORAGES, thread_storage

TARGET = np.array([0.05])


def newton(space, model):
    """The compiled Newton of a model and what it takes, in space or in its plane: call(iterations)."""
    arrays = model.arrays if space else model.plane.arrays
    work = make_workspace(arrays)

    def call(most):
        motion = model.rest.copy()
        return lambda: solve_equilibrium(arrays, motion, TARGET, 1.0, work, 1e-8, most, 0.3, np.inf)

    return call


@pytest.mark.parametrize("space", [True, False], ids=["space", "plane"])
def test_no_python_runs_inside_the_iteration(space):
    def calls(run):
        found = []
        sys.setprofile(lambda frame, event, arg: found.append(event) if event == "call" else None)
        try:
            run()
        finally:
            sys.setprofile(None)
        return len(found)

    call = newton(space, compile_scene(fourbar()))
    call(3)()
    assert calls(call(4)) == calls(call(0))


def test_bare_calls_keep_their_storage_in_each_thread():
    """The second bare call prepares nothing, threads do not share, and answers are not overwritten by later ones."""
    model = compile_scene(fourbar())
    first = solve_conventional(model, {"top": 0.1})
    before, mine = first.motion.copy(), thread_storage(model)
    second = solve_conventional(model, {"top": 0.2})
    assert thread_storage(model) is mine
    np.testing.assert_array_equal(first.motion.x, before.x)
    np.testing.assert_array_equal(first.motion.inner, before.inner)
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(thread_storage, model).result() is not mine
        others = pool.submit(solve_conventional, model, {"top": 0.2}).result()
    np.testing.assert_array_equal(others.motion.x, second.motion.x)


def test_only_the_last_few_storages_are_kept():
    models = [compile_scene(single_joint()) for _ in range(MAX_STORAGES + 1)]
    kept = [thread_storage(m) for m in models]
    assert [thread_storage(m) for m in models[1:]] == kept[1:]
    assert thread_storage(models[0]) is not kept[0]
