"""Questions to a state of modal bodies: the answers of the chains they stand for, and an error figure that is the truth."""

import numpy as np
import pytest
from scenes import cross_flexure, single_joint

import ksd
from ksd.model.mesh import Mesh

TURN = 0.3


@pytest.fixture(scope="module")
def pair():
    """The cross flexure by modal bodies, by the chains of ten elements they reduce, and by leaf springs of many modes."""
    scene = single_joint(cross_flexure())
    modal = ksd.prepare(scene)(turn=TURN, method="modal")
    meshes = Mesh("corotational", elements=10), Mesh(orders=(6, 5, 9), points=11)
    return modal, *(ksd.prepare(scene, mesh=mesh)(turn=TURN, method="conventional") for mesh in meshes)


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
    """Within half a percent of the chains, and the error told is the difference to the truth."""
    modal, chains, truth = pair
    told, off = modal.with_error(QUESTIONS[name])
    assert told == pytest.approx(QUESTIONS[name](chains), rel=5e-3)
    exact = QUESTIONS[name](truth)
    assert off == pytest.approx(np.abs(told - exact), rel=1e-3, abs=1e-7 * np.max(np.abs(exact)))


def test_sensitivity_to_a_load(pair):
    modal, chains, _ = pair
    load = {"at": (0, 0.1, 0), "moment": (0, 0, 1.0)}
    found = [c.sensitivity(lambda p: p.drive_stiffness()["turn"], "tip", **load) for c in pair[:2]]
    assert found[0] == pytest.approx(found[1], rel=1e-3, abs=1e-6)
    assert (
        modal.unreduced_equilibrium[0] is modal.model.full and chains.unreduced_equilibrium[0] is chains.model
    )


def test_a_sweep_with_errors(pair):
    """Every standard question over a stroke, each with its error, that of the ten elements included; none fails."""
    table = ksd.sweep(
        single_joint(cross_flexure()), method="modal", turn=[0.1, 0.3], errors=True, progress=False
    )
    assert not table.failures
    for name, most in (
        ("drive_stiffness", 1),
        ("support_stiffness", 4),
        ("frequencies", 1),
        ("stress", 1),
        ("energy", 1),
    ):
        assert all(0.0 < e < most for e in table[f"{name}_error_percent"]), name
    middle = 0.5 * np.asarray(cross_flexure().pose_B)
    directions = ("x", "y", "z", "rx", "ry")
    stiff = [np.array([c.stiffness("tip", at=middle).support(d) for d in directions]) for c in pair]
    true = np.max(np.abs(stiff[0] / stiff[2] - 1))
    assert table["support_stiffness_error_percent"][1] == pytest.approx(100 * true, rel=0.1)
