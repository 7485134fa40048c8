"""Reduced solids: tensors against scikit-fem, finite rotations, the full model beside them, and use in a mechanism."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

import ksd
from ksd.elements.polynomial_solid import quartic
from ksd.modal.solid import block
from ksd.modal.solid_basis import reduce_solid, with_solids
from ksd.modal.solid_solve import FullSolid
from ksd.modal.symmetry import mirror_planes, split_by_parity
from ksd.model.compile import compile_scene
from ksd.model.mesh import Mesh
from ksd.section import rectangle
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.full_bodies import error_indicator
from ksd.solvers.validity import validity

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
from reduced_solids import load_face, press_reduced

STEEL = ksd.Material(E=200e9, G=76.9e9, density=7800)
LENGTH, THICK, WIDTH = 0.1, 0.01, 0.02
EI = STEEL.E * WIDTH * THICK**3 / 12


@pytest.fixture(scope="module")
def flat():
    return block(STEEL, LENGTH, THICK, width=WIDTH, cells=(10, 1))


@pytest.fixture(scope="module")
def reduced(flat):
    return reduce_solid(flat)


@pytest.fixture(scope="module")
def spatial():
    return block(STEEL, LENGTH, THICK, width=WIDTH, cells=(3, 1, 1))


def projected(body, y):
    """Gradient and tangent by the coordinates y from the finite element model."""
    columns = np.hstack([body.patterns, body.inner])
    u = columns @ y
    force, tangent = body.solid.force_and_tangent(u)
    return columns.T @ force, columns.T @ (tangent @ columns)


@pytest.mark.parametrize("which", ["reduced", "spatial"])
def test_tensors_are_the_energy(which, request):
    """Gradient and tangent of the quartic equal the projected ones of scikit-fem, at large displacements."""
    body = request.getfixturevalue(which)
    if which == "spatial":
        body = reduce_solid(body, internal=1, order=1)
    M = body.unknowns
    y = (
        np.random.default_rng(2).normal(size=M)
        * 0.1
        / np.abs(np.hstack([body.patterns, body.inner])).max(axis=0)
    )
    y *= 0.1 * LENGTH
    g, G = np.empty(M), np.empty((M, M))
    quartic(body.value[2 * len(body.pose_indices) :], M, y, g, G)
    near, tangent = projected(body, y)
    assert g == pytest.approx(near, abs=1e-9 * np.abs(near).max())
    assert np.tril(G) == pytest.approx(np.tril(tangent), abs=1e-9 * np.abs(tangent).max())


def test_products_that_do_not_meet_are_kept_apart(spatial, reduced, monkeypatch):
    """Half of the largest tensor is left with one plane of symmetry; without it the same energy stands in one family."""
    assert len(mirror_planes(spatial)) == 2
    assert len(mirror_planes(replace(spatial, position=spatial.position + np.array([0.0, 1e-4, 0.0])))) == 1
    force = np.array([0.0, 0.5 * EI / LENGTH**2, 0.0])
    fast = press_reduced(reduced, force, np.zeros(3))
    monkeypatch.setattr("ksd.modal.solid_basis.mirror_planes", lambda solid: [])
    whole = reduce_solid(reduced.solid)
    assert whole.unknowns == reduced.unknowns
    assert len(reduced.value) < 0.6 * len(whole.value)
    slow = press_reduced(whole, force, np.zeros(3))
    assert fast.shift == pytest.approx(slow.shift, abs=1e-9 * LENGTH)
    assert fast.stiffness == pytest.approx(slow.stiffness, abs=1e-6 * np.abs(slow.stiffness).max())


def test_a_square_rod_keeps_its_planes():
    """Two bending modes of one frequency: made even and odd, whatever mixture the eigenvalues come with."""
    rod = block(STEEL, LENGTH, THICK, width=THICK, cells=(3, 1, 1))
    body = reduce_solid(rod, internal=2, order=1)
    planes = mirror_planes(rod)
    found = split_by_parity(np.hstack([body.patterns, body.inner]), planes)[0]
    assert found.shape[1] == body.unknowns
    both = [
        press_reduced(body, f * EI / LENGTH**2, np.zeros(3)).shift
        for f in np.array([[0, 0.1, 0], [0, 0, 0.1]])
    ]
    assert both[0][1] == pytest.approx(both[1][2], rel=1e-9)


def test_small_load_is_beam_theory(flat):
    """F L^3 / 3 EI + F L / kGA, plane stress, clamped face."""
    force = 1e-4 * EI / LENGTH**2
    found = load_face(flat, np.array([0.0, force, 0.0]), np.zeros(3), steps=1)
    shear = 1.2 * LENGTH / (STEEL.G * THICK * WIDTH)
    assert found.shift[1] == pytest.approx(force * (LENGTH**3 / (3 * EI) + shear), rel=1e-2)


@pytest.mark.parametrize("frame", ["chord", "node"])
def test_reduced_beside_full(flat, frame):
    """0.2 L: tip within 0.01 % in the chord frame, within 0.1 % in the node frame; axial compliance at that stroke."""
    body = reduce_solid(flat, frame=frame)
    force = np.array([0.0, 0.63 * EI / LENGTH**2, 0.0])
    full, fast = load_face(flat, force, np.zeros(3)), press_reduced(body, force, np.zeros(3))
    assert full.shift[1] > 0.19 * LENGTH
    off = np.linalg.norm(fast.shift - full.shift) / np.linalg.norm(full.shift)
    assert off < (1e-4 if frame == "chord" else 1e-3)
    assert np.abs(fast.R - full.R).max() < 5e-4
    free = [0, 1, 5]
    a, b = (np.linalg.inv(p.stiffness[np.ix_(free, free)]) for p in (full, fast))
    assert b == pytest.approx(a, abs=(3e-4 if frame == "chord" else 3e-3) * np.abs(a).max())


def test_without_derivatives_it_is_too_stiff(flat):
    """The linear modes alone."""
    force = np.array([0.0, 0.3 * EI / LENGTH**2, 0.0])
    full = load_face(flat, force, np.zeros(3))
    stiff = reduce_solid(flat, order=1)
    linear = press_reduced(stiff, force, np.zeros(3))
    assert linear.shift[1] < 0.95 * full.shift[1]
    assert linear.error > 0.02


@pytest.mark.parametrize("frame", ["chord", "node"])
def test_the_error_told_is_the_true_one(flat, frame):
    """From a hundred thousandth to a fifth, by basis and load."""
    errors = []
    for words in ({}, {"order": 1}):
        body = reduce_solid(flat, frame=frame, **words)
        for load in (0.1, 3.0) if words == {} else (0.05,):
            force = np.array([0.2, 1.0, 0.0]) * load * EI / LENGTH**2
            full = load_face(flat, force, np.zeros(3))
            fast = press_reduced(body, force, np.zeros(3))
            errors.append(np.linalg.norm(fast.shift - full.shift) / np.linalg.norm(fast.shift))
            assert fast.error == pytest.approx(errors[-1], rel=0.05)
    assert min(errors) < 1e-7 and max(errors) > 5e-3


def test_range_of_a_solid(spatial):
    """The default goes as far as is tried, driven across and turned; linear modes alone do not."""
    model = compile_scene(leaf_scene(1.0), mesh=Mesh())
    far, near = (
        validity(with_solids(model, {"spring": reduce_solid(spatial, internal=i, order=o)}))
        for i, o in ((2, 2), (0, 1))
    )
    assert far.beyond == ("across", "turned")
    assert min(far.stroke.values()) > 0.3 and min(far.turn.values()) > 0.7
    assert max(near.stroke.values()) < 0.1


def leaf_scene(load):
    scene = ksd.Mechanism("solid leaf")
    tip = scene.link("tip")
    scene.leaf(
        scene.ground, tip, start=(0.1, 0.2, 0), end=(0.1, 0.2 + LENGTH, 0), section=rectangle(THICK, WIDTH),
        material=STEEL, width_axis="z", name="spring",
    )  # fmt: skip
    # the leaf points along y, its thickness along -x
    scene.load(tip, force=(-load, 0.0, 0.0), at=(0.1, 0.2 + LENGTH, 0))
    return scene


def test_a_solid_in_a_mechanism(spatial):
    """A 3D solid where a leaf was, turned by 90 degrees: the same as pressed alone; out of plane it is stiff, not loose."""
    body = reduce_solid(spatial, internal=0)
    load = 0.3 * EI / LENGTH**2
    model = with_solids(compile_scene(leaf_scene(load), mesh=Mesh()), {"spring": body})
    found = solve_conventional(model, {}, planar=False)
    alone = press_reduced(body, np.array([0.0, load, 0.0]), np.zeros(3))
    moved = found.displacement("tip", (0.1, 0.2 + LENGTH, 0))
    assert moved == pytest.approx([-alone.shift[1], alone.shift[0], 0.0], abs=1e-9)
    assert found.stable
    full = load_face(spatial, np.array([0.0, load, 0.0]), np.zeros(3))
    told = error_indicator(found.model, found.motion, np.zeros(0))[0].relative
    true = np.linalg.norm(alone.shift - full.shift) / np.linalg.norm(alone.shift)
    assert told == pytest.approx(true, rel=0.05) and 1e-6 < true < 2e-3
    assert alone.shift == pytest.approx(full.shift, rel=2e-3, abs=1e-9)


def test_solids_are_checked(flat, reduced):
    model = compile_scene(leaf_scene(1.0), mesh=Mesh())
    with pytest.raises(ksd.SceneError, match="there is no leaf 'beam'"):
        with_solids(model, {"beam": reduced})
    with pytest.raises(ksd.SceneError, match="make them equal"):
        short = block(STEEL, 0.5 * LENGTH, THICK, width=WIDTH, cells=(4, 1))
        with_solids(model, {"spring": reduce_solid(short, order=1)})
    with pytest.raises(ksd.SceneError, match=r"cells = \(3,\)"):
        block(STEEL, LENGTH, THICK, width=WIDTH, cells=(3,))
    with pytest.raises(ksd.SceneError, match="thickness = -1"):
        block(STEEL, LENGTH, -1.0, width=WIDTH, cells=(3, 3))
    with pytest.raises(ksd.SceneError, match=r"cells = 2\.5 must be a whole number"):
        block(STEEL, LENGTH, THICK, width=WIDTH, cells=(2.5, 3))
    with pytest.raises(ksd.SceneError, match="material = 'steel' must be a Material"):
        block("steel", LENGTH, THICK, width=WIDTH, cells=(3, 3))
    with pytest.raises(ksd.SceneError, match=r"Poisson's ratio of 0\.5; in space it must lie"):
        block(ksd.Material(E=1e6, nu=0.5), LENGTH, THICK, width=WIDTH, cells=(3, 1, 1))

    with pytest.raises(ksd.SceneError, match="choose one of chord, node"):
        reduce_solid(flat, frame="middle")


def test_a_solid_needs_no_density():
    """It ended in a TypeError; which modes are lowest is all the mass decides."""
    light, heavy = (
        reduce_solid(block(ksd.Material(200e9, nu=0.3, density=d), LENGTH, THICK, width=WIDTH, cells=(4, 1)))
        for d in (None, 7800)
    )
    assert np.array_equal(light.value, heavy.value)


def test_the_unit_of_length_changes_nothing_in_a_basis():
    """Of micrometres, what follows turns to second order was dropped beside what follows shifts: 26 % off."""
    made = [
        reduce_solid(block(STEEL, s * LENGTH, s * THICK, width=s * WIDTH, cells=(4, 1)))
        for s in (1.0, 1e-6, 1e4)
    ]
    assert len({b.unknowns for b in made}) == 1
    assert [b.condition for b in made[1:]] == pytest.approx([made[0].condition] * 2, rel=1e-6)


def test_a_square_solid_bends_about_both_axes_alike():
    """With y and z exchanged its basis spans the same displacements."""
    solid = block(STEEL, LENGTH, THICK, width=THICK, cells=(3, 1, 1))
    reduced = reduce_solid(solid, internal=0, order=2)
    columns = np.hstack([reduced.patterns, reduced.inner])
    points = np.column_stack([solid.position, 10 * LENGTH * solid.component])
    other = np.column_stack(
        [solid.position[:, [0, 2, 1]], 10 * LENGTH * np.array([0, 2, 1])[solid.component]]
    )
    distance, image = cKDTree(points).query(other)
    assert distance.max() < 1e-9
    columns = columns / np.linalg.norm(columns, axis=0)
    left = columns[image] - columns @ np.linalg.lstsq(columns, columns[image], rcond=None)[0]
    assert np.abs(left).max() < 1e-7


@pytest.mark.parametrize("which", ["flat", "spatial"])
def test_displacements_on_a_finer_mesh_are_interpolated(which, request, rng):
    solid = request.getfixturevalue(which)
    fine, slope = solid.refine(2.0), rng.normal(size=(solid.position.shape[1],) * 2)
    one, other = (np.einsum("ki,ki->k", slope[s.component], s.position) for s in (solid, fine))
    found = FullSolid(solid, one, np.zeros(3), np.eye(3)).on_mesh(fine)
    assert len(other) > 2 * len(one) and found.u == pytest.approx(other, abs=1e-12)
