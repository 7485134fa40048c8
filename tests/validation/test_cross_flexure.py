"""Cross flexure of paper 1, table 1, beside the numbers of `published_joints`."""

import numpy as np
import pytest
from published_joints import MOMENTS, chain
from scenes import cross_flexure, single_joint

import ksd
from ksd.model.compile import compile_scene
from ksd.model.mesh import Mesh
from ksd.solvers.conventional import solve_conventional
from ksd.units import deg


@pytest.fixture(scope="module", params=list(MOMENTS), ids=str)
def states(request):
    model = compile_scene(single_joint(), mesh=chain(request.param))
    found, last = {}, None
    for angle in (15, 30, 45, 60, 75):
        last = solve_conventional(model, {"turn": angle * deg}, start=last)
        found[angle] = last
    return request.param, found


def test_line_of_interfaces_turns_by_half(states):
    _, found = states
    for angle, c in found.items():
        x = c.motion.x[1]
        assert np.arctan2(x[1], x[0]) == pytest.approx(0.5 * angle * deg, abs=1e-9)
        assert abs(x[2]) < 1e-12


def test_every_state_is_stable_and_on_the_branch(states):
    _, found = states
    assert all(c.stable and c.converged for c in found.values())
    moments = [found[a].forces["turn"] for a in (15, 30, 45, 60, 75)]
    assert np.all(np.diff(moments) > 0)


def test_both_signs_are_equal_in_plane():
    model = compile_scene(single_joint())
    plus, minus = (solve_conventional(model, {"turn": s * 60 * deg}) for s in (1, -1))
    assert plus.forces["turn"] == pytest.approx(-minus.forces["turn"], rel=1e-9)
    assert np.linalg.norm(plus.motion.x[1]) == pytest.approx(np.linalg.norm(minus.motion.x[1]), rel=1e-9)


def test_chord_rotations_of_crossing_leaves_sum_to_theta():
    model = compile_scene(single_joint(), mesh=Mesh("corotational", elements=6))
    found = solve_conventional(model, {"turn": 60 * deg}, steps=4)
    members = model.arrays.members

    def chords(i):
        inner = found.motion.inner[members.inner_at[i] : members.inner_at[i + 1]]
        R = members.frame[i, 0]
        tip = found.motion.x[1] + found.motion.R[1] @ members.offset[i, 1] - members.offset[i, 0]
        points = [np.zeros(3), *(inner[12 * k : 12 * k + 3] for k in range(5)), R.T @ tip]
        return np.array([np.arctan2(d[1], d[0]) for d in np.diff(points, axis=0)])

    # beta(leaf 1, k) + beta(leaf 2, n + 1 - k) = theta
    assert chords(0) + chords(1)[::-1] == pytest.approx(60 * deg, abs=1e-8)


@pytest.mark.parametrize("thickness", [1e-3, 3e-4, 1e-4, 3e-5])
def test_four_iterations_per_step_at_any_thickness(thickness):
    """Acceptance F: cross flexure n = 5, 15 degree steps, MIP 4 per step for t = 1 to .03 mm."""
    model = compile_scene(
        single_joint(cross_flexure(thickness=thickness)), mesh=Mesh("corotational", elements=5)
    )
    last = None
    for angle in (15, 30, 45, 60, 75):
        last = solve_conventional(model, {"turn": angle * deg}, start=last)
        assert last.steps[0].note.startswith("1 load step,")
        assert last.iterations <= 4


def test_sixty_random_jumps_end_on_the_right_branch(rng):
    """Issue of the strain-mode leaf: one-step jumps to +-75 degrees under 20 N rms side force."""
    for _ in range(60):
        turn = rng.uniform(-75, 75) * deg
        force = rng.normal(size=3) * 20 / np.sqrt(3)
        scene = single_joint()
        scene.load("tip", force=tuple(force), at=cross_flexure().pose_B)
        model = compile_scene(scene)
        jump = solve_conventional(model, {"turn": turn})
        walk = solve_conventional(model, {"turn": turn}, steps=12)
        assert jump.stable
        assert jump.forces["turn"] == pytest.approx(walk.forces["turn"], rel=1e-6, abs=1e-6)
        assert jump.motion.x == pytest.approx(walk.motion.x, abs=1e-9)


def test_names_are_public():
    assert ksd.Mesh is Mesh


def test_published_fit_of_the_length():
    """Acceptance B: D/D0 over 0..75 degrees in (theta^2, theta^4, theta^6), n = 4: coefficients and residual 1.4e-5."""
    model = compile_scene(single_joint(), mesh=Mesh("corotational", elements=4))
    angles = np.arange(0, 80, 5) * deg
    last, lengths = None, []
    for angle in angles:
        last = solve_conventional(model, {"turn": angle}, start=last)
        lengths.append(np.linalg.norm(last.motion.x[1]) / cross_flexure().length_AB)
    basis = np.array([angles**2, angles**4, angles**6]).T
    found = np.linalg.lstsq(basis, np.array(lengths) - 1, rcond=None)[0]
    assert found == pytest.approx([0.0467077, -0.0124473, 0.0010880], rel=2e-3)
    assert np.abs(basis @ found - (np.array(lengths) - 1)).max() < 1.5e-5


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 6])
def test_moment_of_the_element_orientation_body(n):
    """Acceptance B: EOB moment against the finite element model <= 2.5e-5 for n = 1..6, both signs."""
    solve = ksd.prepare(single_joint(), mesh=Mesh("corotational", elements=n))
    for angle in (15, -40, 60, -75, 75):
        reduced = solve(turn=angle * deg, method="reduced", estimate=False).forces["turn"]
        assert reduced == pytest.approx(
            solve_conventional(solve.model, {"turn": angle * deg}, steps=5).forces["turn"], rel=2.5e-5
        )


def test_half_turn_relation_of_the_length():
    """D/D0 = cos(theta/2) + |shift|/(L cos alpha), even, leading coefficient 1/24 at 45 degrees (thin leaf springs)."""
    model = compile_scene(single_joint(cross_flexure(thickness=1e-4)))
    angle = 4 * deg
    length = [
        np.linalg.norm(solve_conventional(model, {"turn": s * angle}).motion.x[1]) / cross_flexure().length_AB
        for s in (1, -1)
    ]
    assert length[0] == pytest.approx(length[1], abs=1e-12)
    assert (length[0] - 1) / angle**2 == pytest.approx(1 / 24, rel=2e-3)
