"""Frequencies against closed forms of beams and independent values of the loaded cross flexure."""

import numpy as np
import pytest
from published_joints import PARASITIC, payload

import ksd
from ksd.model.compile import compile_scene
from ksd.model.leaves import Mesh
from ksd.section import rectangle
from ksd.solve.conventional import conventional
from ksd.units import deg

STEEL = ksd.Material(E=200e9, nu=0.3, density=7800)
# roots of cos x cosh x = 1 and cos x cosh x = -1
CLAMPED = (4.730040744862704, 7.853204624095838)
FREE = (1.8751040687119611, 4.694091132974175)


def beam(clamped, mesh=None, length=1.0, thickness=2e-3, width=20e-3):
    """(frequencies [Hz], unit sqrt(EI/rho A)/(2 pi L^2)) of a slender leaf."""
    scene = ksd.Mechanism("beam")
    tip = scene.link("tip")
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(length, 0, 0), section=rectangle(thickness, width), material=STEEL,
        width_axis=(0, 0, 1), name="leaf",
    )  # fmt: skip
    scene.actuate(tip, along="x", at=(length, 0, 0), name="pull")
    if clamped:
        for axis in "yz":
            scene.support(tip, along=axis, at=(length, 0, 0))
        for axis in "xyz":
            scene.support(tip, about=axis)
    rest = conventional(compile_scene(scene, mesh=mesh), {"pull": 0.0})
    unit = np.sqrt(STEEL.E * thickness**2 / 12 / STEEL.density) / length**2 / (2 * np.pi)
    return rest.frequencies(count=8, freed=() if clamped else ["pull"]).frequency_Hz, unit


def nearest(found, values):
    return [found[np.argmin(np.abs(found - v))] / v for v in values]


@pytest.mark.parametrize(
    "clamped, roots", [(True, CLAMPED), (False, FREE)], ids=("clamped-clamped", "cantilever")
)
def test_leaf_with_default_orders(clamped, roots):
    found, unit = beam(clamped)
    first, second = nearest(found, [unit * r**2 for r in roots])
    assert first == pytest.approx(1.0, abs=1e-4)
    # one mode more than in statics: 2 % without it, 2.3e-4 with it
    assert second == pytest.approx(1.0, abs=1e-3)


def test_axial_mode_of_a_clamped_free_bar():
    """Stretch is one linear field per leaf: omega = sqrt(3) c/L, 10 % above pi c/(2 L); three leaf springs in a row:
    1.2 %."""
    scene = ksd.Mechanism("bar")
    links, step = [scene.ground, *scene.links("a", "b", "c")], 0.02
    for k in range(3):
        scene.leaf(
            links[k], links[k + 1], start=(k * step, 0, 0), end=((k + 1) * step, 0, 0), section=rectangle(2e-3, 2e-3),
            material=STEEL, width_axis=(0, 0, 1), name=f"part {k}",
        )  # fmt: skip
    found = conventional(compile_scene(scene), {}).frequencies(count=30)
    along = found.shape[:, 3, 0] ** 2 / np.maximum((found.shape[:, 3, :3] ** 2).sum(axis=1), 1e-300)
    axial = found.frequency_Hz[np.argmax(along > 0.999)]
    exact = np.sqrt(STEEL.E / STEEL.density) / (4 * 3 * step)
    assert axial / exact == pytest.approx(1.0115, abs=1e-3)


def test_chain_converges_to_the_same():
    for clamped, roots in ((True, CLAMPED), (False, FREE)):
        error = []
        for n in (6, 12):
            found, unit = beam(clamped, Mesh("corotational", elements=n))
            error.append(max(abs(q - 1) for q in nearest(found, [unit * r**2 for r in roots])))
        assert error[1] < 0.3 * error[0] < 3e-3


@pytest.mark.parametrize("angle", list(PARASITIC))
def test_parasitic_frequencies_with_the_drive_held_and_freed(angle):
    state = conventional(payload(), {"turn": angle * deg})
    held = state.frequencies(count=3)
    # with the drive freed the intended motion comes first and is known as such
    free = state.frequencies(count=3, freed="turn")
    assert free.intended.tolist() == [0]
    assert free.frequency_Hz[0] < 0.3 * held.first_parasitic_Hz
    assert free.first_parasitic_Hz <= held.first_parasitic_Hz * (1 + 1e-9)


def test_a_finer_leaf_does_not_move_them():
    fine = compile_scene(payload().scene, mesh=Mesh(orders=(6, 5, 8), points=11))
    pair = [conventional(m, {"turn": -45 * deg}).frequencies(count=3).frequency_Hz for m in (payload(), fine)]
    assert pair[0] == pytest.approx(pair[1], rel=2e-4)
