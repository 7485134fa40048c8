"""Energy-conserving sampling: fewer elements, the same answers."""

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from scenes import single_joint

import ksd
from ksd.modal import ModalBasis, with_modal_bodies
from ksd.model.compile import compile_scene
from ksd.model.mesh import Mesh
from ksd.solvers.conventional import solve_conventional
from ksd.units import deg

BASIS = ModalBasis(elements=40, plane=True)


@pytest.fixture(scope="module")
def sampling():
    patch = pytest.MonkeyPatch()
    patch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "benchmarks"))
    yield import_module("sampling")
    patch.undo()


@pytest.fixture(scope="module")
def model():
    return with_modal_bodies(compile_scene(single_joint(), mesh=Mesh("corotational", elements=40)), BASIS)


def test_sampled_bodies(sampling, model):
    """Trained at four angles on each side, asked between them: moment and support stiffness within 1e-4."""
    states = [
        solve_conventional(model, {"turn": a * deg}, planar=False).motion for a in (-40, -20, 0.1, 20, 40)
    ]
    sampled = sampling.with_samples(model, states, tolerance=1e-4)
    count = sampled.arrays.members.number[:, 0]
    assert np.all(count < 30) and np.all(count > 8)
    a, b = (solve_conventional(m, {"turn": 31 * deg}, planar=False) for m in (model, sampled))
    assert b.forces["turn"] == pytest.approx(a.forces["turn"], rel=1e-4)
    stiff = [c.stiffness("tip", at=(0.035, 0, 0)).supports for c in (a, b)]
    assert [stiff[1][d] for d in "xy"] == pytest.approx([stiff[0][d] for d in "xy"], rel=1e-4)


def test_shares_sum_to_the_energy(sampling, model):
    body = next(iter(model.bodies.values()))
    d, Q = np.array([0.0995, 0.004, 0.0]), np.eye(3)
    force, tangent = sampling.element_shares(body, d, Q, np.zeros(body.inner.shape[1]))
    step = 1e-6 * np.eye(body.inner.shape[1])[0]
    near = [sampling.element_shares(body, d, Q, s * step)[0].sum(axis=1) for s in (1, -1)]
    slope = (near[0] - near[1]) / 2e-6
    at = len(body.b0)
    assert tangent.sum(axis=2)[:, at] == pytest.approx(slope, abs=1e-5 * np.abs(slope).max())
    assert force.shape == (at + body.inner.shape[1], 40)


def test_training_is_needed(sampling, model):
    with pytest.raises(ksd.SceneError, match="no training states"):
        sampling.with_samples(model, [])


def test_sampled_elements_carry_the_whole_force(sampling):
    rng = np.random.default_rng(3)
    field = np.cumsum(rng.normal(size=(12, 3)) @ rng.normal(size=(3, 60)), axis=1)
    weights = sampling.sampled_weights(field, field.sum(axis=1), tolerance=1e-3)
    assert weights.min() >= 0 and np.count_nonzero(weights) <= 12
    assert field @ weights == pytest.approx(field.sum(axis=1), abs=1.1e-3 * np.linalg.norm(field.sum(axis=1)))
