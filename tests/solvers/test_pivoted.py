"""Newton with pivoting: links held by supports alone, following loads, and the inertia it counts."""

import numpy as np
import pytest
from scenes import STEEL

import ksd
from ksd.answers.tangent import stored_matrix
from ksd.model.arrays import make_workspace
from ksd.model.compile import compile_scene
from ksd.model.newton import assemble
from ksd.numerics.indefinite import equilibration, negative_inertia, solve_scaled
from ksd.section import rectangle
from ksd.solvers.conventional import solve_conventional

L, SECTION = 0.1, rectangle(0.5e-3, 0.02)
EI = STEEL.E * SECTION.Iz


def cantilever(*, held, mesh=None, **load):
    """A leaf along x from link 'root' to link 'tip'; the root held by supports alone, or ground itself."""
    scene = ksd.Mechanism("cantilever")
    root = scene.link("root") if held else scene.ground
    tip = scene.link("tip")
    scene.leaf(
        root, tip, start=(0, 0, 0), end=(L, 0, 0), section=SECTION, material=STEEL, width_axis=(0, 0, 1)
    )
    for word in ("along", "about") if held else ():
        for axis in "xyz":
            scene.support(root, at=(0, 0, 0), **{word: axis})
    scene.load(tip, at=(L, 0, 0), **load)
    return compile_scene(scene, mesh=mesh)


def test_a_root_held_by_supports_alone_is_the_same_as_ground():
    load = {"force": (0.0, 2 * EI / L**2, 0.1)}
    free, fixed = (solve_conventional(cantilever(held=h, **load), {}) for h in (True, False))
    assert free.motion.x[2] - free.motion.x[1] == pytest.approx(fixed.motion.x[1], abs=1e-11)
    assert free.stable and fixed.stable
    assert free.expected_negatives == 6
    assert free.reactions["root.held"] == pytest.approx(0.0, abs=1e-6)
    # rows hold a node before it is eliminated
    assert not any("pivoting" in found.steps[0].note for found in (free, fixed))


def test_a_link_carried_by_three_wires_between_held_links():
    """Nothing elastic leads to ground: the middle hangs on wires whose far ends are held by supports."""
    scene = ksd.Mechanism("platform")
    middle = scene.link("middle")
    scene.load(middle, force=(0, 0, -5), at=(0, 0, 0))
    for k in range(3):
        c, s = np.cos(2 * np.pi * k / 3), np.sin(2 * np.pi * k / 3)
        end = scene.link(f"end {k}")
        scene.wire(middle, end, diameter=1e-3, material=STEEL, start=(0.01 * c, 0.01 * s, 0),
                   end=(0.11 * c, 0.11 * s, 0))  # fmt: skip
        for word in ("along", "about"):
            for axis in "xyz":
                scene.support(end, at=(0.11 * c, 0.11 * s, 0), name=f"{k} {word} {axis}", **{word: axis})
    found = solve_conventional(compile_scene(scene), {})
    assert found.stable
    assert sum(found.reactions[f"{k} along z"] for k in range(3)) == pytest.approx(5.0, rel=1e-9)


def test_a_mechanism_that_can_move_freely_is_refused():
    scene = ksd.Mechanism("loose")
    a, b = scene.links("a", "b")
    scene.leaf(a, b, start=(0, 0, 0), end=(L, 0, 0), section=SECTION, material=STEEL, width_axis=(0, 0, 1))
    for axis in "xyz":
        scene.support(a, at=(0, 0, 0), along=axis)
    scene.load(b, force=(0, 1.0, 0), at=(L, 0, 0))
    # its pivot is zero but for rounding: rounded up it swung round, until it hung along the force
    with pytest.raises(ksd.ConvergenceError, match="singular"):
        solve_conventional(compile_scene(scene), {})
    with pytest.raises(ksd.ConvergenceError, match=r"at 0 % of the drive motion.*singular"):
        ksd.solve(scene)


def test_following_tip_force():
    """A force that stays normal to the tip of a cantilever: independent integration of the inextensible rod.

    From the tip, in its axes: psi'' = -p cos psi with psi = psi' = 0 there; the clamp is met at s = 1.
    """
    from scipy.integrate import solve_ivp

    p = 20.0
    rod = solve_ivp(lambda s, y: [y[1], -p * np.cos(y[0])], (0, 1), [0.0, 0.0], rtol=1e-11, atol=1e-12)
    found = solve_conventional(
        cantilever(
            held=False,
            force=(0, p * EI / L**2, 0),
            following=True,
            mesh=ksd.Mesh(orders=(3, 2, 10), points=14),
        ),
        {},
        planar=False,
    )
    turn = np.arctan2(found.motion.R[1, 1, 0], found.motion.R[1, 0, 0])
    assert np.exp(1j * turn) == pytest.approx(np.exp(-1j * rod.y[0, -1]), abs=1e-4)
    assert "pivoting" not in found.steps[0].note and found.stable


def test_inertia_and_solution_of_indefinite_matrices(rng):
    for n, count in ((6, 2), (40, 17), (41, 0)):
        Q = np.linalg.qr(rng.normal(size=(n, n)))[0]
        values = np.concatenate([-rng.uniform(0.1, 9, count), rng.uniform(0.1, 9, n - count)])
        units = np.diag(10.0 ** rng.uniform(-5, 5, n))
        K = units @ (Q * values @ Q.T) @ units
        K = 0.5 * (K + K.T)
        assert negative_inertia(K) == count
        b = rng.normal(size=(n, 2))
        x, condition = solve_scaled(K, K @ b, equilibration(K))
        assert condition > 1e-6
        assert units @ x == pytest.approx(units @ b, rel=1e-6, abs=1e-6)


def test_a_saddle_without_stiffness_on_its_diagonal():
    K = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 2.0], [0.0, 2.0, 3.0]])
    assert negative_inertia(K) == int((np.linalg.eigvalsh(K) < 0).sum())


def test_negatives_of_a_state_agree_with_the_block_factorisation():
    found = solve_conventional(cantilever(held=False, force=(0, 1.0, 0)), {})
    arrays, work = found.model.arrays, make_workspace(found.model.arrays)
    _, _, inside, _ = assemble(arrays, found.motion, np.zeros(0), 1.0, work, 1e-8, 0, 10.0)
    assert negative_inertia(stored_matrix(arrays, work.matrix)) + inside == found.negatives
