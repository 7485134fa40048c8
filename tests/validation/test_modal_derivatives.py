"""Paper 2 and section E of the acceptance numbers: planar leaves, t/L = 1/200; in 3D the tangent basis."""

from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from scenes import cross_flexure, single_joint

import ksd
from ksd.answers.stiffness import point_stiffness
from ksd.modal import with_modal_bodies
from ksd.model.compile import compile_scene
from ksd.model.mesh import Mesh
from ksd.solvers.conventional import solve_conventional
from ksd.units import deg


@pytest.fixture(scope="module")
def cases():
    patch = pytest.MonkeyPatch()
    patch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "benchmarks"))
    yield import_module("paper2_cases")
    patch.undo()


@pytest.mark.parametrize(
    ("case", "stroke", "slack", "order", "width"),
    [
        ("cantilever", 0.097, 0.005, 4.0, 0.3),
        ("cross flexure", 9.6, 0.5, 4.0, 0.3),
        ("parallel guide", 0.129, 0.006, 4.0, 0.3),
    ],
)
def test_as_printed(cases, case, stroke, slack, order, width):
    """Acceptance E, row 1: where the stroke is 1 % short, and with which power the error grows."""
    found, power = cases.one_percent(case, cases.PRINTED)
    assert found == pytest.approx(stroke, abs=slack)
    assert power == pytest.approx(order, abs=width)
    assert (
        cases.basis_errors(case, 1.0 if case == "parallel guide" else 0.2, cases.PRINTED)["stroke_error"] < 0
    )


def test_the_order_depends_on_the_distance_of_the_leaves(cases):
    """Why the guide of the tables has its leaves a length apart: at 50 mm the stroke of 1 % error is as asked, the order
    at it is not, while near rest it is about 4 there too; with the shuttle kept from turning it is 4 throughout."""
    assert cases.LEAF_DISTANCE == cases.L
    early = import_module("paper2").early_order
    for words, stroke, order in (({"spread": 0.05}, 0.128, 3.4), ({"held": True}, 0.136, 3.9)):
        found, power = cases.one_percent("parallel guide", cases.PRINTED, **words)
        assert found == pytest.approx(stroke, abs=1e-3)
        assert power == pytest.approx(order, abs=0.05)
        assert early(**words) == pytest.approx(3.87, abs=0.2)


def test_support_is_asked_at_the_end_of_the_leaf(cases):
    """At the driven end itself, wherever it is: held across there, a cantilever is compliant along by its bent shape."""
    found = cases.solve_loads(cases.full_model("cantilever", 0.6, 10), planar=True)
    C = found.stiffness("tip", at=(cases.L, 0, 0)).compliance
    expected = C[0, 0] - C[0, 1] ** 2 / C[1, 1]
    assert cases.support_compliance(found, (cases.L, 0.0, 0.0)) == pytest.approx(expected, rel=1e-9)


def test_as_printed_a_finer_mesh_makes_it_worse(cases):
    """Errata, paper 2, point 2: -1.1 % with 10 elements, -24 % with 160, cantilever at 0.1 L."""
    assert cases.basis_errors("cantilever", 0.3, cases.PRINTED)["stroke_error"] == pytest.approx(
        -0.011, abs=0.001
    )
    fine = cases.basis_errors("cantilever", 0.3, replace(cases.PRINTED, elements=160))
    assert fine["stroke_error"] == pytest.approx(-0.24, abs=0.01)


@pytest.mark.parametrize(
    ("case", "load"), [("cantilever", 2.1), ("parallel guide", 16.0), ("cross flexure", 2.45)]
)
def test_director_coordinates(cases, case, load):
    """Row 2, up to 0.5 L and 60 degrees: stroke 0.02 %, support compliance 0.5 %, and 160 elements no worse."""
    found = cases.basis_errors(case, load, cases.DEFAULT)
    assert found["stroke"] > (59.0 if case == "cross flexure" else 0.49)
    assert abs(found["stroke_error"]) < 2e-4
    assert abs(found["support_error"]) < 5e-3
    if case != "cross flexure":
        fine = cases.basis_errors(case, load, replace(cases.DEFAULT, elements=160))
        assert abs(fine["stroke_error"]) < 2 * abs(found["stroke_error"]) + 1e-6
        assert abs(fine["support_error"]) < 2 * abs(found["support_error"]) + 1e-6


@pytest.mark.parametrize(("order", "stroke", "support"), [(4, 1e-4, 1.5e-2), (6, 2e-5, 1e-4)])
def test_strain_modes_beside(cases, order, stroke, support):
    """Row 3: the measure a modal basis must beat."""
    reference = Mesh(orders=(6, 4, 12), points=15)
    for case, load in (("cantilever", 2.1), ("parallel guide", 16.0), ("cross flexure", 2.45)):
        found = cases.strain_mode_errors(case, load, order, reference)
        assert abs(found["stroke_error"]) < stroke
        assert abs(found["support_error"]) < support


def test_without_internal_modes_the_support_is_wrong(cases):
    """Errata, paper 2, point 4: 2 to 100 times too stiff beyond 0.1 L, whatever the stroke says."""
    bare = replace(cases.DEFAULT, internal=0)
    found = cases.basis_errors("parallel guide", 4.0, bare)
    assert abs(found["stroke_error"]) < 5e-3
    assert 2 < 1 / (1 + found["support_error"]) < 100


def test_third_order_cures_the_angles(cases):
    """Errata, paper 2, point 2."""
    third = replace(cases.PRINTED, order=3)
    two, three = (cases.basis_errors("cantilever", 0.3, b) for b in (cases.PRINTED, third))
    assert abs(three["stroke_error"]) < 0.05 * abs(two["stroke_error"])


@pytest.fixture(scope="module")
def hinge():
    return compile_scene(single_joint(cross_flexure(thickness=5e-4)), mesh=Mesh("corotational", elements=10))


def test_tangent_basis(cases, hinge):
    """Row 4 in 3D: support stiffness exact at the trained state, moment within 0.02 % five degrees away."""
    basis, cases_tangent = (
        ksd.ModalBasis(frame="node", internal=0),
        import_module("paper2_tangent").tangent_solve,
    )
    about = solve_conventional(hinge, {"turn": 30 * deg}, planar=False)
    for angle in (25, 30, 35):
        full = solve_conventional(hinge, {"turn": angle * deg}, planar=False)
        found = cases_tangent(hinge, basis, {"turn": angle * deg}, about)
        assert found.forces["turn"] == pytest.approx(full.forces["turn"], rel=2e-4)
        a, b = (point_stiffness(c.model, c.motion, "tip", at=(0.035, 0, 0)).supports for c in (found, full))
        near = 1e-6 if angle == 30 else 2e-4
        for d in ("x", "y", "z", "rx", "ry"):
            assert a[d] == pytest.approx(b[d], rel=near)


@pytest.mark.parametrize("case", ["cantilever", "parallel guide", "cross flexure"])
def test_tangent_basis_in_the_plane(cases, case):
    """Row 4: load within 0.02 % to +-0.05 L or +-5 degrees of the trained configuration, support stiffness exact at it."""
    rows = import_module("paper2_tangent").errors_around(case)
    for row in rows:
        assert abs(row["value"]) < (1e-6 if "support" in row["what"] else 2e-4), row


def test_quadratic_manifold_is_locked(cases):
    """The choice for comparison: right for infinitesimal strokes, eight times too short at 0.1 L, with 6 unknowns."""
    tied = replace(cases.PRINTED, derivatives="tied")
    little, far = (cases.basis_errors("cantilever", load, tied) for load in (3e-4, 0.3))
    assert abs(little["stroke_error"]) < 1e-4
    assert little["unknowns"] == 6
    assert far["stroke_error"] == pytest.approx(-0.873, abs=0.005)


def test_trained_basis_in_space():
    """Cross flexure, 0 to 45 degrees: moment 0.3 %, first parasitic frequency 0.5 %, from joint records alone."""
    scene = single_joint()
    scene.mass("tip", mass=1.0, at=(0.09, 0, 0), inertia=np.diag([1.2e-3, 8e-4, 1.2e-3]))
    chains, trained = (
        Mesh("corotational", elements=10),
        ksd.ModalBasis(expansion="trained", frame="node", internal=0),
    )
    for angle in (0, 20, 45):
        full = ksd.solve(scene, turn=angle * deg, method="conventional", mesh=chains)
        for basis in (trained, ksd.ModalBasis()):
            found = ksd.solve(scene, turn=angle * deg, method="modal", basis=basis)
            assert found.forces["turn"] == pytest.approx(full.forces["turn"], rel=3e-3, abs=1e-9)
            a, b = (c.frequencies(count=1).frequency_Hz[0] for c in (found, full))
            assert a == pytest.approx(b, rel=5e-3)


def test_reduced_stiffness_of_the_default_in_space(hinge):
    """Undeformed expansion, 45 degrees: within 4 % out of the plane, where it is worst, and 0.01 % in it."""
    full = solve_conventional(hinge, {"turn": 45 * deg}, planar=False)
    found = solve_conventional(with_modal_bodies(hinge, ksd.ModalBasis()), {"turn": 45 * deg}, planar=False)
    a, b = (c.stiffness("tip", at=(0.035, 0, 0)).supports for c in (found, full))
    assert [a["x"], a["y"]] == pytest.approx([b["x"], b["y"]], rel=1e-4)
    assert a["z"] == pytest.approx(b["z"], rel=0.04)
