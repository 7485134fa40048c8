"""What is refused says what it is, and what has a path without a turn on it is not refused."""

import numpy as np
import pytest
from hard_scenes import bistable
from scenes import STEEL, single_joint

import ksd
from ksd.model.compile import compile_scene
from ksd.section import rectangle
from ksd.solvers.conventional import solve_conventional


@pytest.mark.parametrize("degrees", [185.0, -270.0])
def test_a_turn_beyond_half_a_turn_is_named(degrees):
    """It was refused as an iteration limit at 97 % and 67 % of the way: a single solve would have to guess the turn."""
    scene = ksd.Mechanism("leaf")
    tip = scene.link("tip")
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), section=rectangle(0.5e-3, 0.02), material=STEEL,
               width_axis="z")  # fmt: skip
    scene.actuate(tip, about="z", name="turn")
    with pytest.raises(
        ksd.SceneError, match=rf"'turn' = {degrees:g} deg.*have to guess.*at most 180 deg apart"
    ):
        ksd.solve(scene, turn=np.deg2rad(degrees))
    assert ksd.solve(scene, turn=np.deg2rad(175.0)).trusted


def test_a_limit_point_on_the_way_is_named():
    """A cross flexure of four elements pressed by 4.3 kN was refused for an element turned by more than 60 degrees, that of
    the last attempt beyond the limit point of its path."""
    scene, direction = single_joint(), np.deg2rad(260.0)
    scene.load("tip", force=(4300 * np.cos(direction), 4300 * np.sin(direction), 0), at=(0.07071, 0, 0))
    mesh = ksd.Mesh("corotational", elements=4)
    with pytest.raises(ksd.ConvergenceError, match=r"limit point at 98\.4 % of the way") as refused:
        ksd.solve(scene, turn=np.deg2rad(45.0), mesh=mesh, method="conventional")
    assert refused.value.reached == pytest.approx(0.984, abs=1e-3)


def test_a_path_that_goes_on_is_gone_along():
    """A bistable beam: load steps ended at 95.7 % of the way, where the beam changes its shape fast."""
    scene, unit, rise = bistable(Q=10.0)
    found = ksd.solve(scene, push=-1.95 * rise)
    # what plates add to the force is above what is trusted; the state itself is sound
    assert found.stable and found.uncertainty.effect == "plate" and "by arc length" in found.steps[-1].note
    # from the state before, and by chains
    before = ksd.solve(scene, push=-1.8 * rise)
    model = compile_scene(scene, mesh=ksd.Mesh("corotational", elements=40))
    near = solve_conventional(model, {"push": -1.8 * rise})
    assert near.forces["push"] == pytest.approx(before.forces["push"], rel=5e-3)
    chains = solve_conventional(model, {"push": -1.95 * rise}, start=near, steps=8)
    assert found.forces["push"] == pytest.approx(chains.forces["push"], rel=5e-3)
    assert abs(found.forces["push"]) > unit
