"""Threads of BLAS are limited while small matrices are worked on, and set back to what they were."""

import threading

import pytest
from scenes import cross_flexure, single_joint
from threadpoolctl import ThreadpoolController, threadpool_limits

import ksd
from ksd.numerics.threads import MANY_LEAVES, one_blas_thread, small_matrices


def counts():
    """Threads of every BLAS that is loaded."""
    return {x["filepath"]: x["num_threads"] for x in ThreadpoolController().info() if x["user_api"] == "blas"}


@pytest.fixture
def two():
    """Two threads of BLAS, as a user has them."""
    with threadpool_limits(2, user_api="blas"):
        yield counts()


def test_tasks_run_in_one_thread_and_set_back_what_was(two):
    inside = []

    @small_matrices
    def task(mechanism):
        inside.append(counts())
        with one_blas_thread():
            inside.append(counts())
        raise ValueError

    with pytest.raises(ValueError):
        task(single_joint(cross_flexure()))
    assert all(set(one.values()) == {1} for one in inside) and counts() == two
    ksd.sweep(single_joint(cross_flexure()), turn=[0.0, 0.1], questions=["frequencies"], progress=False)
    assert counts() == two


def test_tasks_in_several_threads_set_back_what_the_user_has(two):
    begun, go_on = threading.Event(), threading.Event()

    def other():
        with one_blas_thread():
            begun.set()
            go_on.wait(10)

    thread = threading.Thread(target=other)
    with one_blas_thread():
        assert set(counts().values()) == {1}
        thread.start()
        begun.wait(10)
    go_on.set()
    thread.join()
    assert counts() == two


def test_many_leaf_springs_keep_their_threads(two):
    class Large:
        def leaf_names(self):
            return range(MANY_LEAVES)

    assert small_matrices(lambda mechanism: counts())(Large()) == two
