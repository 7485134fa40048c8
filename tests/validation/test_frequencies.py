"""Frequencies beside the numbers of `published_vibrations` and `published_joints`: chains, finer leaves, drives let go."""

import pytest
from published_joints import PARASITIC, payload
from published_vibrations import CLAMPED, FREE, beam, nearest

from ksd.model.compile import compile_scene
from ksd.model.mesh import Mesh
from ksd.solvers.conventional import solve_conventional
from ksd.units import deg


def test_chain_converges_to_the_same():
    for held, roots in (("yzabc", CLAMPED), ("", FREE)):
        error = []
        for n in (6, 12):
            found, unit = beam(held, Mesh("corotational", elements=n))
            error.append(max(abs(q - 1) for q in nearest(found, [unit * r**2 for r in roots])))
        assert error[1] < 0.3 * error[0] < 3e-3


@pytest.mark.parametrize("angle", list(PARASITIC))
def test_parasitic_frequencies_with_the_drive_held_and_freed(angle):
    state = solve_conventional(payload(), {"turn": angle * deg})
    held = state.frequencies(count=3)
    # with the drive freed the intended motion comes first and is known as such
    free = state.frequencies(count=3, freed="turn")
    assert free.intended.tolist() == [0]
    assert free.frequency_Hz[0] < 0.3 * held.first_parasitic_Hz
    assert free.first_parasitic_Hz <= held.first_parasitic_Hz * (1 + 1e-9)


def test_a_finer_leaf_does_not_move_them():
    fine = compile_scene(payload().scene, mesh=Mesh(orders=(6, 5, 8), points=11))
    pair = [
        solve_conventional(m, {"turn": -45 * deg}).frequencies(count=3).frequency_Hz
        for m in (payload(), fine)
    ]
    assert pair[0] == pytest.approx(pair[1], rel=2e-4)
