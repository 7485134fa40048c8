"""What solving many different scenes leaves behind."""

import gc
import weakref

from scenes import cross_flexure, fourbar

import ksd
from ksd.solve import choose


def test_models_of_scenes_solved_before_are_freed():
    """All but those of the few solvers that are kept; what is asked of a pose keeps its model no longer either."""
    choose._recent.clear()
    models = []
    for k in range(40):
        scene = fourbar(joint=cross_flexure(thickness=1e-3 + 1e-6 * k))
        mesh = (None, ksd.Mesh("corotational", elements=2))[k % 2]
        pose = ksd.solve(scene, top=0.1, mesh=mesh, method="full")
        pose.drive_stiffness()
        if k % 8 == 0:
            pose.frequencies()
        models.append(weakref.ref(pose.model))
    del pose
    gc.collect()
    # one model more where questions have a finer one
    assert sum(found() is not None for found in models) <= choose.KEPT
    choose._recent.clear()
    gc.collect()
    # storage of the last questions asked
    assert sum(found() is not None for found in models) <= 4
