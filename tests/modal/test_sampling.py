"""Energy-conserving sampling: fewer elements, the same answers."""

import numpy as np
import pytest
from scenes import single_joint

import ksd
from ksd.modal import ModalBasis, with_modal_bodies
from ksd.modal.sampling import element_shares, with_samples
from ksd.model.compile import compile_scene
from ksd.model.mesh import Mesh
from ksd.solve.conventional import conventional
from ksd.units import deg

BASIS = ModalBasis(elements=40, plane=True)


@pytest.fixture(scope="module")
def model():
    return with_modal_bodies(compile_scene(single_joint(), mesh=Mesh("corotational", elements=40)), BASIS)


def test_sampled_bodies(model):
    """Trained at four angles on each side, asked between them: moment and support stiffness within 1e-4."""
    states = [conventional(model, {"turn": a * deg}, planar=False).motion for a in (-40, -20, 0.1, 20, 40)]
    sampled = with_samples(model, states, tolerance=1e-4)
    count = sampled.arrays.members.number[:, 0]
    assert np.all(count < 30) and np.all(count > 8)
    a, b = (conventional(m, {"turn": 31 * deg}, planar=False) for m in (model, sampled))
    assert b.forces["turn"] == pytest.approx(a.forces["turn"], rel=1e-4)
    stiff = [c.stiffness("tip", at=(0.035, 0, 0)).supports for c in (a, b)]
    assert [stiff[1][d] for d in "xy"] == pytest.approx([stiff[0][d] for d in "xy"], rel=1e-4)


def test_shares_sum_to_the_energy(model):
    body = model.bodies[0]
    d, Q = np.array([0.0995, 0.004, 0.0]), np.eye(3)
    force, tangent = element_shares(body, d, Q, np.zeros(body.inner.shape[1]))
    step = 1e-7 * np.eye(body.inner.shape[1])[0]
    near = [element_shares(body, d, Q, s * step)[0].sum(axis=1) for s in (1, -1)]
    slope = (near[0] - near[1]) / 2e-7
    at = len(body.b0)
    assert tangent.sum(axis=2)[:, at] == pytest.approx(slope, abs=1e-5 * np.abs(slope).max())
    assert force.shape == (at + body.inner.shape[1], 40)


def test_training_is_needed(model):
    with pytest.raises(ksd.SceneError, match="no training states"):
        with_samples(model, [])
