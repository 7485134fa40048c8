"""Modal bodies as members: kernels against differences, rigid motion, mixing, the method and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import STEEL, cross_flexure, fourbar, single_joint
from scipy.spatial.transform import Rotation

import ksd
from ksd.elements.corotational_values import ElementSection, chain_values, sizes
from ksd.elements.modal import (
    ELEMENT_SCRATCH_SIZE,
    modal_condense,
    modal_gradient_and_tangent,
    modal_recover,
    modal_sizes,
)
from ksd.elements.modal_jets import JET, _log_factor, boundary_jets
from ksd.elements.modal_nodes import _angle_curvature, _director_curvature, _director_node, element_values
from ksd.modal import with_modal_bodies
from ksd.modal.leaf_basis import chain_element_constants, rotation_without_roll, undeformed_basis
from ksd.model.compile import compile_scene
from ksd.model.mesh import Mesh
from ksd.solvers.conventional import solve_conventional
from ksd.units import deg

CHAINS = Mesh("corotational", elements=6)
SECTION = ElementSection(E=1e6, G=4e5, A=0.01, J=8e-6, Iy=3.3e-5, Iz=2.1e-6)
TURN = Rotation.from_rotvec


def differences(function, size, step=1e-6):
    """Central differences (.., size) of an array function."""
    unit = step * np.eye(size)
    return np.stack([(function(e) - function(-e)) / (2 * step) for e in unit], axis=-1)


@pytest.mark.parametrize(("frame", "angle"), [(0, 0), (0, 1), (1, 0), (1, 1)])
def test_boundary_values_and_their_derivatives(frame, angle):
    """First and second derivatives in the chart Q <- exp(psi) Q."""
    d, Q = np.array([1.0, 0.2, -0.1]), TURN([0.2, 0.3, -0.4]).as_matrix()
    reference = np.concatenate([TURN(v).as_matrix().T.ravel() for v in ([0, 0.1, 0.2], [0.1, 0.1, -0.2])])
    count = {(0, 0): 9, (0, 1): 6, (1, 0): 13, (1, 1): 7}[frame, angle]

    def jets(xi):
        out = np.empty((count, JET))
        boundary_jets(frame, angle, reference, d + xi[:3], TURN(xi[3:]).as_matrix() @ Q, out)
        return out

    def rotation(A, end):
        """Values of the end with axes A: columns, or the rotation vector from the reference."""
        start = reference.reshape(2, 3, 3)[end].T
        return Rotation.from_matrix(A @ start.T).as_rotvec() if angle else A[:, :2].T.ravel()

    found, F = jets(np.zeros(6)), rotation_without_roll(d)
    values = (
        [d, rotation(Q, 1)] if frame == 0 else [[np.linalg.norm(d)], rotation(F.T, 0), rotation(F.T @ Q, 1)]
    )
    assert found[:, 0] == pytest.approx(np.concatenate(values), abs=1e-13)
    assert found[:, 1:7] == pytest.approx(differences(lambda e: jets(e)[:, 0], 6), abs=1e-8)
    upper = np.triu_indices(6)
    h = 1e-4
    E = h * np.eye(6)
    for k, (i, j) in enumerate(zip(*upper, strict=True)):
        second = jets(E[i] + E[j]) - jets(E[i] - E[j]) - jets(E[j] - E[i]) + jets(-E[i] - E[j])
        assert found[:, 7 + k] == pytest.approx(second[:, 0] / (4 * h * h), abs=1e-6)


@pytest.mark.parametrize("turn", [1e-3, 0.03, 0.04472, 0.04473, 0.3, 1.5, 3.0])
def test_factor_of_the_rotation_vector(turn):
    """Angle over sine by the cosine, with derivatives: h' = (c h - 1)/s^2, h'' = (3 c h' + h)/s^2."""
    c, s2 = np.cos(turn), np.sin(turn) ** 2
    # 1 - c is known to rounding only
    off = 3e-16 / s2
    h, h1, h2 = _log_factor(c)
    assert h == pytest.approx(turn / np.sin(turn), rel=4 * off + 1e-15)
    assert h1 == pytest.approx((c * h - 1.0) / s2, rel=1e-15 + 4 * off)
    # its series ends earlier
    assert h2 == pytest.approx((3.0 * c * h1 + h) / s2, rel=2e-9 + 20 * off)


def test_curvature_of_rotations_in_node_values(rng):
    """Second derivatives of m . phi by rotation vectors and by directors, phi the rotation vector of the increment."""
    m, v, z = rng.normal(size=3), rng.normal(size=3), rng.normal(size=6)
    H, R, W = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 6))
    _angle_curvature(v, m, H)

    def by_angle(e):
        return m @ (TURN(v + e) * TURN(v).inv()).as_rotvec()

    def twice(function, size, h=2e-3):
        return differences(lambda x: differences(lambda y: function(x + y), size, h), size, h)

    assert pytest.approx(twice(by_angle, 3), abs=2e-5) == H
    norms = _director_node(z, R, W)
    start, C = R.copy(), np.empty((6, 6))
    _director_curvature(*norms, R.copy(), m, C)

    def by_directors(e):
        _director_node(z + e, R, W)
        return m @ Rotation.from_matrix(R @ start.T).as_rotvec()

    exact = twice(by_directors, 6)
    assert pytest.approx(exact, abs=1e-4 * np.abs(exact).max()) == C


@pytest.mark.parametrize("angle", [0, 1])
def test_element_in_node_values(angle):
    """Gradient and tangent by directors that are neither unit nor orthogonal, and by rotation vectors."""
    rng, q = np.random.default_rng(0), 6 if angle else 9
    Ra, Rb = TURN([0.1, 0.2, 0.3]).as_matrix(), TURN([0.2, 0.05, 0.4]).as_matrix()
    xb = Ra @ np.array([1.02, 0.05, 0.03])
    z = np.concatenate([np.zeros(3), 0.25 * rng.normal(size=3), xb, 0.25 * rng.normal(size=3)])
    if not angle:
        tilted = Rb[:, 1] * 1.1 - 0.07 * Rb[:, 0]
        z = np.concatenate([np.zeros(3), 1.1 * Ra[:, 0], 0.95 * Ra[:, 1], xb, 0.95 * Rb[:, 0], tilted])
    orientation = np.concatenate([Ra.T.ravel(), Rb.T.ravel()])
    record = chain_values(SECTION, 1.0, 1)

    def both(v):
        g, H = np.zeros(2 * q), np.zeros((2 * q, 2 * q))
        assert element_values(record, np.zeros(6 + sizes(1).store), v, orientation, angle, g, H) == 0
        return g, H

    H = both(z)[1]
    near = differences(lambda e: both(z + e)[0], 2 * q)
    assert near == pytest.approx(H, abs=1e-6 * np.abs(H).max())
    assert pytest.approx(H.T, abs=1e-10 * np.abs(H).max()) == H


@pytest.mark.parametrize(
    "basis",
    [
        ksd.ModalBasis(elements=6),
        ksd.ModalBasis(coordinates="angle", frame="node", internal=0, elements=6),
        ksd.ModalBasis(coordinates="angle", derivatives="tied", elements=6),
    ],
    ids=["default", "printed", "manifold"],
)
def test_condensed_body(basis):
    """Energy, its pose and its condensation at a bent state, against differences and plain linear algebra."""
    body = undeformed_basis(chain_element_constants(chain_values(SECTION, 1.0, 6), 6), basis)
    value, number = body.constants()
    size, nb = len(body.b0) + body.inner.shape[1], len(body.b0)
    d, Q = np.array([0.995, 0.08, 0.02]), TURN([0.05, -0.02, 0.15]).as_matrix()
    jets, eta = np.empty((nb, JET)), 0.01 * np.random.default_rng(1).normal(size=size - nb)
    boundary_jets(int(number[3]) % 2, int(number[3]) // 2, value[:18], d, Q, jets)
    y = np.concatenate([jets[:, 0] - body.b0, eta])

    def energy(v):
        g, G = np.empty(size), np.empty((size, size))
        assert modal_gradient_and_tangent(value, number, v, np.empty(ELEMENT_SCRATCH_SIZE), g, G) == 0
        return g, np.tril(G) + np.tril(G, -1).T

    g, G = energy(y)
    near = differences(lambda e: energy(y + e)[0], size, 1e-7)
    assert near == pytest.approx(G, abs=1e-6 * np.abs(G).max())
    J, H = jets[:, 1:7], np.zeros((nb, 6, 6))
    H[:, *np.triu_indices(6)] = jets[:, 7:]
    H = H + np.triu(H, 1).transpose(0, 2, 1)
    T = np.block([[J, np.zeros((nb, size - nb))], [np.zeros((size - nb, 6)), np.eye(size - nb)]])
    force, whole = T.T @ g, T.T @ G @ T
    whole[:6, :6] += np.einsum("b,bij->ij", g[:nb], H)
    across = np.linalg.solve(whole[6:, 6:], np.column_stack([whole[6:, :6], force[6:]]))
    lam, K, store = np.empty(12), np.empty((6, 6)), np.zeros(modal_sizes(size - nb)[1])
    negatives, *_, status = modal_condense(value, number, eta, store, d, Q, lam, K)
    assert status == 0 and negatives == np.sum(np.linalg.eigvalsh(whole[6:, 6:]) < 0)
    exact = whole[:6, :6] - whole[:6, 6:] @ across[:, :6]
    assert pytest.approx(exact, abs=1e-8 * np.abs(exact).max()) == K
    assert lam[6:] == pytest.approx(force[:6], abs=1e-9 * np.abs(force).max())
    assert lam[:6] == pytest.approx(force[:6] - whole[:6, 6:] @ across[:, 6], abs=1e-7 * np.abs(force).max())
    xi, before = np.array([1e-3, 2e-3, 0, 0, 1e-3, -2e-3]), eta.copy()
    modal_recover(value, number, eta, store, xi, 0.5)
    step = before - 0.5 * (across[:, :6] @ xi + across[:, 6])
    assert eta == pytest.approx(step, abs=1e-8 * np.abs(step).max())


@pytest.fixture(scope="module")
def chains():
    return compile_scene(single_joint(), mesh=CHAINS)


def test_rigid_motion_costs_nothing(chains):
    """A mechanism turned at random gives the same moment and the same links, turned."""
    model = with_modal_bodies(chains, ksd.ModalBasis(elements=6))
    found = solve_conventional(model, {"turn": 25 * deg}, planar=False)
    scene = ksd.Mechanism("turned")
    tip, turn = scene.link("tip"), TURN([0.4, -1.0, 0.7]).as_matrix()
    placed = scene.join(
        scene.ground,
        tip,
        cross_flexure(),
        at=(0.3, 0.1, -0.2),
        axis=turn[:, 2],
        toward=turn[:, 0],
        name="hinge",
    )
    scene.actuate_joint(placed, name="turn")
    other = with_modal_bodies(compile_scene(scene, mesh=CHAINS), ksd.ModalBasis(elements=6))
    moved = solve_conventional(other, {"turn": 25 * deg}, planar=False)
    assert moved.forces["turn"] == pytest.approx(found.forces["turn"], rel=1e-8)
    assert turn.T @ moved.links["tip"][0] == pytest.approx(found.links["tip"][0], abs=1e-10)


def test_nothing_happens_without_load():
    """A guide whose places and elements are exact in binary: no force, no iteration."""
    scene = ksd.Mechanism("guide")
    tip = scene.link("tip")
    for y in (-0.0625, 0.0625):
        scene.leaf(
            scene.ground, tip, start=(0, y, 0), end=(0.125, y, 0), section=ksd.rectangle(5e-4, 0.02), material=STEEL,
            width_axis="z",
        )  # fmt: skip
    scene.actuate(tip, along="y", at=(0.125, 0, 0), name="across")
    chains = compile_scene(scene, mesh=Mesh("corotational", elements=4))
    model = with_modal_bodies(chains, ksd.ModalBasis(elements=4))
    found = solve_conventional(model, {"across": 0.0}, planar=False)
    assert found.forces["across"] == pytest.approx(0.0, abs=1e-12)
    assert found.iterations == 0


def test_inside_places_the_nodes_of_the_full_model(chains):
    """The recovered nodes are those of the full model; stress and shape are asked of them."""
    reduced = solve_conventional(
        with_modal_bodies(chains, ksd.ModalBasis(elements=6)), {"turn": 30 * deg}, planar=False
    )
    full = solve_conventional(chains, {"turn": 30 * deg}, planar=False)
    _, state = reduced.unreduced_state
    for i in range(3):
        at = chains.arrays.members.inner_at[i]
        mine, theirs = (m.inner[at : at + 60].reshape(5, 12) for m in (state, full.motion))
        assert mine[:, :3] == pytest.approx(theirs[:, :3], abs=1e-8)
        assert mine[:, 3:] == pytest.approx(theirs[:, 3:], abs=1e-5)
    a, b = (c.strain_energy() for c in (reduced, full))
    assert a == pytest.approx(b, rel=1e-4)


def test_modal_bodies_beside_chains(chains):
    """One leaf reduced, the others as they are."""
    names = chains.member_names
    mixed = with_modal_bodies(chains, ksd.ModalBasis(elements=6), only=[names[0]])
    assert list(mixed.bodies) == [names[0]]
    full = solve_conventional(chains, {"turn": 30 * deg}, planar=False)
    found = solve_conventional(mixed, {"turn": 30 * deg}, planar=False)
    assert found.forces["turn"] == pytest.approx(full.forces["turn"], rel=1e-5)
    with pytest.raises(ksd.SceneError, match="there is no leaf 'spring'"):
        with_modal_bodies(chains, ksd.ModalBasis(), only=["spring"])


def test_method_modal_on_the_fourbar():
    """In every mechanism: 12 bodies, 70 degrees; by both expansions, with an honest error and stiffness."""
    scene = fourbar()
    exact = ksd.solve(scene, top=0.2, method="conventional", mesh=Mesh("corotational", elements=10))
    for basis in (ksd.ModalBasis(), ksd.ModalBasis(expansion="trained", internal=0, frame="node")):
        found = ksd.solve(scene, top=0.2, method="modal", basis=basis)
        assert found.method == "modal" and found.stable
        assert found.forces["top"] == pytest.approx(exact.forces["top"], rel=2e-5)
        # next to the chain it stands for; its elements are .03 % off
        assert found.method_error.relative < 1e-4 < found.error.relative < 4e-4
        a, b = (c.stiffness("top", at=(0, 0.3, 0)).supports for c in (found, exact))
        assert [a[d] for d in "yz"] == pytest.approx([b[d] for d in "yz"], rel=0.03)
        assert "modal bodies" in str(found)


def test_basis_no_longer_successful():
    """As printed it fails at 30 degrees, and says so; strict=False gives the state with its verdict."""
    printed = ksd.ModalBasis(coordinates="angle", frame="node", internal=0, plane=True)
    scene = single_joint(cross_flexure(thickness=0.5e-3))
    with pytest.raises(ksd.KsdError, match="basis no longer successful"):
        ksd.solve(scene, turn=30 * deg, method="modal", basis=printed)
    try:
        found = ksd.solve(scene, turn=30 * deg, method="modal", basis=printed, strict=False)
    except ksd.ConvergenceError:
        return
    assert not found.trusted and found.error.relative > 0.05


def test_validity_range():
    """As printed the leaf is good to about the strokes of acceptance E, row 1; the default goes as far as is tried."""
    printed = ksd.ModalBasis(coordinates="angle", frame="node", internal=0, plane=True)
    scene = single_joint(cross_flexure(thickness=0.5e-3))
    found = ksd.solve(scene, turn=5 * deg, method="modal", basis=printed).validity()
    assert 0.05 < found.stroke["across"] < 0.15 and found.beyond == ()
    assert 4 * deg < found.turn["turned"] < 12 * deg
    assert "to a stroke of" in found.sentence
    far = ksd.solve(scene, turn=5 * deg, method="modal").validity()
    assert set(far.beyond) == {"across", "guided", "turned"} and far.stroke["across"] > 0.55
    with pytest.raises(ksd.SceneError, match="belongs to modal bodies"):
        ksd.solve(scene, turn=5 * deg, method="conventional").validity()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"coordinates": "quaternion"}, "coordinates = 'quaternion': choose one of director, angle"),
        ({"frame": "mean"}, "choose one of chord, node"),
        ({"order": 4}, "order = 4"),
        ({"internal": -1}, "internal = -1"),
        ({"elements": 1}, "elements = 1"),
        ({"expansion": "now"}, "choose one of rest, trained"),
        ({"derivatives": "bound"}, "choose one of free, tied"),
        ({"derivatives": "tied"}, "the quadratic manifold is one of coordinates='angle'"),
    ],
)
def test_choices_are_checked(words, said):
    with pytest.raises(ksd.SceneError, match=said):
        ksd.ModalBasis(**words)


def test_a_basis_is_asked_for_by_name():
    with pytest.raises(ksd.SceneError, match=r"give a ksd\.ModalBasis"):
        ksd.solve(single_joint(), turn=0.1, method="modal", basis="director")
    assert replace(ksd.ModalBasis(), order=3).order == 3


def test_the_shortest_turn_takes_x_there_without_roll(rng):
    for d in rng.normal(size=(4, 3)):
        axis = np.cross([1.0, 0.0, 0.0], d)
        turn = np.arctan2(np.linalg.norm(axis), d[0]) * axis / np.linalg.norm(axis)
        assert rotation_without_roll(d) == pytest.approx(Rotation.from_rotvec(turn).as_matrix(), abs=1e-12)
