"""Questions to a state of modal bodies: the answers of the chains they stand for, and an error figure that is the truth."""

import numpy as np
import pytest
from scenes import cross_flexure, single_joint

import ksd
from ksd.model.mesh import Mesh

TURN = 0.3


@pytest.fixture(scope="module")
def pair():
    """The cross flexure by modal bodies and by the chains of ten elements they reduce."""
    scene = single_joint(cross_flexure())
    modal = ksd.prepare(scene)(turn=TURN, method="modal")
    return modal, ksd.prepare(scene, mesh=Mesh("corotational", elements=10))(turn=TURN, method="conventional")


QUESTIONS = {
    "drive stiffness": lambda c: c.drive_stiffness()["turn"],
    "support stiffness": lambda c: np.array(
        [c.stiffness("tip").support(d) for d in ("x", "y", "z", "rx", "ry")]
    ),
    "frequencies": lambda c: c.frequencies(count=3, freed="turn").frequency_Hz,
    "stress": lambda c: c.stress().largest_Pa,
    "strain energy": lambda c: sum(c.strain_energy().values()),
    "internal stress": lambda c: np.array(list(c.internal_stress().stress_Pa.values())),
    "buckling": lambda c: np.array([c.buckling().negative, c.buckling().positive]),
}


@pytest.mark.parametrize("name", QUESTIONS)
def test_answers_and_their_error(pair, name):
    """Within half a percent of the chains, and the error told is the difference."""
    modal, chains = pair
    told, off = modal.with_error(QUESTIONS[name])
    exact = QUESTIONS[name](chains)
    assert told == pytest.approx(exact, rel=5e-3)
    assert off == pytest.approx(np.abs(told - exact), rel=1e-3, abs=1e-7 * np.max(np.abs(exact)))


def test_sensitivity_to_a_load(pair):
    modal, chains = pair
    load = {"at": (0, 0.1, 0), "moment": (0, 0, 1.0)}
    found = [c.sensitivity(lambda p: p.drive_stiffness()["turn"], "tip", **load) for c in pair]
    assert found[0] == pytest.approx(found[1], rel=1e-3, abs=1e-6)
    assert modal.unreduced[0] is modal.model.full and chains.unreduced[0] is chains.model


def test_a_sweep_with_errors():
    """Every standard question over a stroke, each with its error; none fails."""
    table = ksd.sweep(
        single_joint(cross_flexure()), method="modal", turn=[0.1, 0.3], errors=True, progress=False
    )
    assert not table.failures
    for name in ("drive_stiffness", "support_stiffness", "frequencies", "stress", "energy"):
        assert all(0.0 < e < 1.0 for e in table[f"{name}_error_percent"]), name
