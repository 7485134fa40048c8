"""Modal bodies beside condensed KSD joints and full leaf springs, by name: against the full model, and what is refused."""

import numpy as np
import pytest
from scenes import STEEL, fourbar, slider

import ksd
from ksd.modal.choices import ModalBasis
from ksd.model.arrays import LINEAR, MODAL, STRAIN
from ksd.model.mesh import Mesh
from ksd.units import mm

TRAINED = ModalBasis(expansion="trained", internal=0, frame="node")


def hung():
    """The fourbar with a light arm on a leaf at its top link, which a weight bends far."""
    scene = fourbar()
    arm = scene.link("arm")
    scene.leaf(
        "top", arm, start=(0, 0.4, 0), end=(0.15, 0.4, 0), section=ksd.rectangle(0.3 * mm, 10 * mm), material=STEEL,
        width_axis="z", name="spring",
    )  # fmt: skip
    scene.load(arm, force=(0, -0.3, 0), at=(0.15, 0.4, 0))
    return scene


@pytest.mark.parametrize(
    "basis",
    [
        {"lower left": ModalBasis()},
        {"upper left": ModalBasis(), "lower right": TRAINED},
        {"lower left/inner": ModalBasis(elements=16)},
    ],
    ids=["a joint", "two joints, one trained", "a leaf of a joint"],
)
@pytest.mark.parametrize("d", [0.1, 0.3])
def test_fourbar_of_both(basis, d):
    """To 70 degrees: no further from the full answer than the condensed joints are, and the estimate says how far."""
    scene = fourbar()
    full = ksd.solve(scene, top=d, method="full")
    reduced = ksd.prepare(scene)(top=d, method="reduced", estimate=False)
    found = ksd.solve(scene, top=d, method="modal", basis=basis)
    assert found.method == "modal" and found.trusted
    off = abs(found.forces["top"] / full.forces["top"] - 1)
    # a chain of ten elements is 0.1 % off at most
    assert off < abs(reduced.forces["top"] / full.forces["top"] - 1) < 0.01
    assert off == pytest.approx(found.error.relative, abs=1.5e-3)
    assert set(found.motions) == set(full.motions)
    passed = ksd.solve(scene, top=d, method="modal", basis=basis, relinearisations=1)
    assert passed.forces["top"] == pytest.approx(full.forces["top"], rel=2e-3)


def test_what_the_mechanism_is_made_of():
    """Condensed joints are linear bodies, the leaf springs named modal ones, all others are what the mesh makes them; rows
    and loads are those of the scene."""
    scene = hung()
    scene.load("top", force=(0, -0.1, 0), at=(0.02, 0.4, 0), moment=(0, 0, 0.01))
    basis = {"lower left/inner": ModalBasis(), "spring": ModalBasis(elements=12)}
    solver = ksd.prepare(scene, basis=basis)
    found = solver(top=0.05, method="modal")
    mix = solver._reduced[True].placed.at_rest.mix
    for part in ("terms", "loads"):
        for own, given in zip(getattr(mix.arrays, part), getattr(solver.model.arrays, part), strict=True):
            assert np.array_equal(own, given)
    kinds = mix.arrays.members.kind.tolist()
    assert kinds == [LINEAR, LINEAR, LINEAR, MODAL, STRAIN, STRAIN, MODAL]
    assert found.model.full.arrays.members.number[[0, -1], 0].tolist() == [10, 12]
    assert list(found.model.bodies) == ["lower left/inner", "spring"]
    assert "spring: director coordinates" in str(found)
    assert "12 elements per leaf" in str(found)


def test_questions_to_a_mixture():
    """Stroke, stiffness, frequencies, stress and energy beside those of the full model of strain-mode leaves."""
    scene = hung()
    full = ksd.solve(scene, top=0.05, method="full")
    found = ksd.solve(
        scene, top=0.05, method="modal", basis={"lower left": ModalBasis(), "spring": ModalBasis()}
    )
    assert found.displacement("arm", (0.15, 0.4, 0)) == pytest.approx(
        full.displacement("arm", (0.15, 0.4, 0)), abs=5e-5
    )
    a, b = (c.stiffness("top", at=(0, 0.3, 0)).supports for c in (found, full))
    assert [a[k] for k in ("x", "y", "z", "rx")] == pytest.approx(
        [b[k] for k in ("x", "y", "z", "rx")], rel=0.03
    )
    assert found.frequencies(count=1).frequency_Hz == pytest.approx(
        full.frequencies(count=1).frequency_Hz, rel=5e-3
    )
    assert found.stress().largest_Pa == pytest.approx(full.stress().largest_Pa, rel=0.01)
    assert found.strain_energy() == pytest.approx(full.strain_energy(), rel=5e-3)
    stiff, off = found.with_error(lambda p: p.drive_stiffness()["top"])
    assert off == pytest.approx(abs(stiff - full.drive_stiffness()["top"]), rel=1.0, abs=0.3)


def test_a_sliding_joint_under_loads():
    """Internal blocks and two motions: the guide by modal bodies carries a condensed cartwheel, and the other way round."""
    targets = {"stroke": 0.01, "turn": 0.3}
    full = ksd.solve(slider(), targets, method="full")
    for name in ("guide", "wheel"):
        found = ksd.solve(slider(), targets, method="modal", basis={name: ModalBasis()})
        assert found.forces["stroke"] == pytest.approx(full.forces["stroke"], rel=2e-3)
        assert found.displacement("arm", (0.15, 0, 0)) == pytest.approx(
            full.displacement("arm", (0.15, 0, 0)), abs=2e-5
        )


def test_loads_across_come_in_parts():
    """200 N out of the plane, where the whole of it at once does not converge; the estimate owns up to the distance."""
    scene = fourbar()
    scene.load("top", force=(0, 0, 200.0), at=(0, 0.3, 0))
    full = ksd.solve(scene, top=0.3, method="full")
    found = ksd.solve(scene, top=0.3, method="modal", basis={"lower left": ModalBasis()}, strict=False)
    off = abs(found.forces["top"] / full.forces["top"] - 1)
    assert found.error.relative == pytest.approx(off, rel=0.3, abs=2e-3)


def test_all_named_is_all_modal():
    """With no joint left to condense the answer is that of one basis for all."""
    scene, basis = fourbar(), ModalBasis()
    one = ksd.solve(scene, top=0.1, method="modal", basis=basis)
    names = [p.name for p in scene.scene().joints]
    each = ksd.solve(scene, top=0.1, method="modal", basis=dict.fromkeys(names, basis))
    assert each.forces["top"] == pytest.approx(one.forces["top"], rel=1e-9)
    assert np.abs(each.motion.x - one.motion.x).max() < 1e-12


@pytest.mark.parametrize(
    ("basis", "said"),
    [
        ({}, "name at least one joint or leaf"),
        ({"hinge": ModalBasis()}, "there is no joint or leaf 'hinge'; there are: lower left, upper left"),
        ({"lower left": "director"}, r"basis\['lower left'\] = 'director': give a ksd.ModalBasis"),
    ],
)
def test_names_are_checked(basis, said):
    with pytest.raises(ksd.SceneError, match=said):
        ksd.solve(fourbar(), top=0.1, method="modal", basis=basis)


def test_weight_is_refused():
    scene = fourbar()
    scene.gravity = (0, -9.81, 0)
    with pytest.raises(ksd.SceneError, match="with weight"):
        ksd.solve(scene, top=0.1, method="modal", basis={"lower left": ModalBasis()}, effects=["gravity"])


def test_chains_beside_condensed_chains():
    """The mesh of what is not named is free: condensed chains of five elements beside modal bodies of ten."""
    mesh = Mesh("corotational", elements=5)
    exact = ksd.solve(fourbar(), top=0.2, method="full", mesh=mesh)
    found = ksd.solve(
        fourbar(), top=0.2, method="modal", mesh=mesh, basis={"lower left": ModalBasis()}, relinearisations=1
    )
    assert found.forces["top"] == pytest.approx(exact.forces["top"], rel=2e-3)
    assert found.model.full.arrays.members.number[:, 0].tolist() == [10] * 3 + [5] * 9


@pytest.mark.parametrize(
    "basis", [ModalBasis(order=3), ModalBasis(internal=4)], ids=["third order", "four internal modes"]
)
def test_large_bases_start_from_smaller_ones(basis):
    """Hundreds of iterations from rest; from the state of the default basis a few, and closer to the chain they reduce."""
    scene = fourbar()
    found = ksd.solve(scene, top=0.3, method="modal", basis=basis)
    assert found.trusted and found.method_error.relative < 3e-6
    full = ksd.solve(scene, top=0.3, method="full", mesh=Mesh("corotational", elements=10))
    assert found.forces["top"] == pytest.approx(full.forces["top"], rel=3e-6)
    step = next(s for s in found.steps if s.name.startswith("3"))
    assert 0 < step.iterations < 20


def test_plate_factors_settle_with_modal_leaves():
    """Plate stiffening is 4.3 % of the force here, a basis of the lower left joint 0.1 %, of all leaf springs 0.03 %."""
    scene = fourbar()
    scene.consider("plate")
    right = ksd.solve(scene, top=0.2, method="conventional").forces["top"]
    one = ksd.solve(scene, top=0.2, method="modal", basis={"lower left": ksd.ModalBasis()})
    every = ksd.solve(scene, top=0.2, method="modal")
    assert one.forces["top"] == pytest.approx(right, rel=2e-3)
    assert every.forces["top"] == pytest.approx(right, rel=5e-4)
