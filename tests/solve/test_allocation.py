"""An iteration of a prepared solver allocates nothing: counted in the run-time library of the compiled code.

Every array made in a compiled kernel (``np.empty``) goes through that library, which can count them; so does the wrapper of
every array handed over by Python, which is why two calls of unequal length are compared. Python's side: the whole
iteration is one call, so no Python function may run in it.
"""

import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scenes import fourbar, single_joint

import ksd
from ksd.model.arrays import make_work
from ksd.model.compile import compile_scene
from ksd.model.plane import plane_of
from ksd.numerics.kernel import kernel
from ksd.solve.conventional import conventional
from ksd.solve.newton import iterate
from ksd.solve.storage import KEPT, storage_of

MESHES = {
    "modes": ksd.Mesh(),
    "chain": ksd.Mesh("corotational", elements=3),
    "plain Newton": ksd.Mesh("corotational", elements=2, mip=False, nodal=True),
}
TARGET = np.array([0.05])


@pytest.fixture
def arrays_made():
    """Runs a call and returns how many arrays compiled code made on the heap in it."""
    from numba.core.runtime import _nrt_python, rtsys

    _nrt_python.memsys_enable_stats()

    def count(call):
        before = rtsys.get_allocation_stats()
        call()
        after = rtsys.get_allocation_stats()
        return after.mi_alloc - before.mi_alloc, after.alloc - before.alloc

    yield count
    _nrt_python.memsys_disable_stats()


@kernel
def _three_arrays(n):
    total = 0.0
    for k in range(3):
        x = np.empty(n + k)
        x[:] = k
        total += x.sum()
    return total


def loaded_fourbar():
    """With a dead and a following load."""
    scene = fourbar()
    scene.load("top", force=(3.0, -8.0, 0.0), moment=(0, 0, 0.2), at=(0.05, 0.4, 0.0))
    scene.load("left", force=(-2.0, 1.5, 0.0), at=(-0.25, 0.2, 0.0), following=True)
    return scene


SCENES = {"bare": fourbar, "loaded": loaded_fourbar}


def newton(space, model):
    """The compiled Newton of a model and what it takes, in space or in its plane: call(iterations)."""
    arrays = model.arrays if space else plane_of(model).arrays
    work = make_work(arrays)

    def call(most):
        motion = model.rest.copy()
        return lambda: iterate(arrays, motion, TARGET, 1.0, work, 1e-8, most, 0.3, np.inf)

    return call


def test_the_counter_counts(arrays_made):
    _three_arrays(4)
    assert arrays_made(lambda: _three_arrays(4)) == (3, 3)


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("space", [True, False], ids=["space", "plane"])
@pytest.mark.parametrize("mesh", MESHES)
def test_an_iteration_allocates_nothing(mesh, space, scene, arrays_made):
    call = newton(space, compile_scene(SCENES[scene](), mesh=MESHES[mesh]))
    assert call(3)()[1] == 3, "three iterations were not needed"
    assert arrays_made(call(3)) == arrays_made(call(0))


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
    first = conventional(model, {"top": 0.1})
    before, mine = first.motion.copy(), storage_of(model)
    second = conventional(model, {"top": 0.2})
    assert storage_of(model) is mine
    np.testing.assert_array_equal(first.motion.x, before.x)
    np.testing.assert_array_equal(first.motion.inner, before.inner)
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(storage_of, model).result() is not mine
        others = pool.submit(conventional, model, {"top": 0.2}).result()
    np.testing.assert_array_equal(others.motion.x, second.motion.x)


def test_only_the_last_few_storages_are_kept():
    models = [compile_scene(single_joint()) for _ in range(KEPT + 1)]
    kept = [storage_of(m) for m in models]
    assert [storage_of(m) for m in models[1:]] == kept[1:]
    assert storage_of(models[0]) is not kept[0]
