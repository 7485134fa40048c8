"""What solving many different scenes leaves behind."""

import gc
import weakref

from scenes import cross_flexure, fourbar

import ksd
from ksd.solvers import solver as choose


def _model_of(number, *, asked):
    """The model of a new scene that was solved, and asked."""
    scene = fourbar(joint=cross_flexure(thickness=1e-3 + 1e-6 * number))
    mesh = (None, ksd.Mesh("corotational", elements=2))[number % 2]
    pose = ksd.solve(scene, top=0.1, mesh=mesh, method="full")
    pose.drive_stiffness()
    if asked:
        pose.frequencies()
    return weakref.ref(pose.model)


def _alive(models):
    gc.collect()
    return sum(found() is not None for found in models)


def test_models_of_scenes_solved_before_are_freed():
    """All but those of the few solvers, and of the storage of questions, that are kept."""
    # what is alive while kernels are compiled may stay: compile first
    for number in range(2):
        _model_of(number, asked=True)
    choose._cached_solvers.clear()
    models = [_model_of(number, asked=number % 8 == 0) for number in range(2, 42)]
    assert _alive(models) <= choose.MAX_SOLVERS
    choose._cached_solvers.clear()
    assert _alive(models) <= 4
