"""Stiffness and compliance by formula against finite differences of loads and drives, and their algebra."""

from fractions import Fraction

import numpy as np
import pytest
from scenes import STEEL, cross_flexure, fourbar, single_joint
from scipy.spatial.transform import Rotation

import ksd
from ksd.answers.finer_model import finer_state
from ksd.answers.state_batch import group_states
from ksd.answers.stiffness import (
    batch_stiffness,
    drive_coupling,
    drive_stiffness,
    point_stiffness,
    principal_stiffness,
    support_stiffness,
)
from ksd.answers.stress import batch_peak_stress
from ksd.answers.tangent import DenseTangent
from ksd.errors import KinematicsError, SceneError
from ksd.model.compile import compile_scene
from ksd.model.mesh import Mesh
from ksd.numerics.indefinite import equilibration, solve_scaled
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.error import find_equilibrium

AT = (0.02, 0.31, 0.01)
MESHES = [Mesh(), Mesh("corotational", elements=3), Mesh("corotational", elements=3, nodal=True)]


def state(mesh=None, force=None, moment=None):
    scene = fourbar()
    scene.load("top", force=(30.0, -20.0, 10.0), at=(0, 0.3, 0.02))
    if force is not None:
        scene.load("top", force=force, moment=moment, at=AT)
    return solve_conventional(compile_scene(scene, mesh=mesh), {"top": 0.12}, steps=4)


@pytest.mark.parametrize("mesh", MESHES, ids=("strain", "chain", "nodal"))
def test_compliance_is_the_derivative_of_the_motion_by_the_load(mesh):
    base = state(mesh)
    found = point_stiffness(base.model, base.motion, "top", at=AT)
    # columns by central differences of the motion of the point
    for column, load in (
        (0, ((1, 0, 0), (0, 0, 0))),
        (2, ((0, 0, 1), (0, 0, 0))),
        (3, ((0, 0, 0), (0.1, 0, 0))),
    ):
        both = [state(mesh, *(tuple(s * np.array(part)) for part in load)) for s in (1, -1)]
        size = 2 * max(np.abs(load[0]).max(), np.abs(load[1]).max())
        moved = (both[0].displacement("top", AT) - both[1].displacement("top", AT)) / size
        # rotations are spatial: log(R+ R-^T), not the difference of rotation vectors
        R = [c.links["top"][1] for c in both]
        turned = Rotation.from_matrix(R[0] @ R[1].T).as_rotvec() / size
        expected = np.concatenate([moved, turned])
        scale = np.array([1, 1, 1, 0.3, 0.3, 0.3])
        error = np.abs((found.compliance[:, column] - expected) * scale).max()
        assert error < 2e-4 * np.abs(expected * scale).max()


def test_drive_stiffness_is_the_derivative_of_the_drive_force():
    model = compile_scene(fourbar())
    base = solve_conventional(model, {"top": 0.12})
    step = 1e-5
    force = [solve_conventional(model, {"top": 0.12 + s * step}, start=base).forces["top"] for s in (1, -1)]
    found = drive_stiffness(model, base.motion)
    assert found.units == ("N/m",)
    assert found["top"] == pytest.approx((force[0] - force[1]) / (2 * step), rel=1e-6)
    moved = [
        solve_conventional(model, {"top": 0.12 + s * step}, start=base).displacement("top", AT)
        for s in (1, -1)
    ]
    along = drive_coupling(model, base.motion, "top", at=AT)["top"]
    assert along[:3] == pytest.approx((moved[0] - moved[1]) / (2 * step), abs=1e-5)


def test_matrices_are_symmetric_and_inverse_to_each_other():
    base = state()
    found = point_stiffness(base.model, base.motion, "top", at=AT, freed="top")
    K = found.matrix()
    assert K @ found.compliance == pytest.approx(np.eye(6), abs=1e-6)
    assert np.linalg.eigvalsh(K).min() > 0.0
    assert found.support("x") == pytest.approx(1 / found.compliance[0, 0])
    held = found.support("x", held=("y", "z", "rx", "ry", "rz"))
    assert held == pytest.approx(K[0, 0], rel=1e-6)
    for own, part in zip(found.principal, (found.compliance[:3, :3], found.compliance[3:, 3:]), strict=True):
        assert own == pytest.approx(1.0 / np.linalg.eigvalsh(part)[::-1], rel=1e-9)


def test_axes_turn_the_matrix():
    base = state()
    plain = point_stiffness(base.model, base.motion, "top", at=AT, freed="top").compliance
    turn = base.motion.R[base.model.node_names.index("top")]
    both = np.kron(np.eye(2), turn)
    link = point_stiffness(base.model, base.motion, "top", at=AT, freed="top", axes="link").compliance
    given = point_stiffness(base.model, base.motion, "top", at=AT, freed="top", axes=turn).compliance
    assert link == pytest.approx(both.T @ plain @ both, abs=1e-15)
    assert given == pytest.approx(link, abs=1e-18)


def test_a_held_drive_is_rigid_and_says_so():
    base = solve_conventional(compile_scene(single_joint()), {"turn": 0.3})
    found = point_stiffness(base.model, base.motion, "tip", at=(0.035, 0, 0))
    assert found.support("rz") == np.inf
    with pytest.raises(KinematicsError, match="cannot move along rz"):
        found.matrix()
    assert found.matrix(("x", "y", "z", "rx", "ry")).shape == (5, 5)
    free = point_stiffness(base.model, base.motion, "tip", at=(0.035, 0, 0), freed=["turn"])
    turn = drive_stiffness(base.model, base.motion)["turn"]
    assert free.support("rz") == pytest.approx(turn, rel=1e-8)


def test_freeing_a_drive_adds_its_compliance():
    """C_free = C_held + u u^T / k, u the motion of the point per unit of the drive, k the drive's
    stiffness."""
    base = state()
    held = point_stiffness(base.model, base.motion, "top", at=AT).compliance
    free = point_stiffness(base.model, base.motion, "top", at=AT, freed="top").compliance
    u = drive_coupling(base.model, base.motion, "top", at=AT)["top"]
    k = drive_stiffness(base.model, base.motion)["top"]
    assert free == pytest.approx(held + np.outer(u, u) / k, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize(
    "ask, words",
    [
        ({"link": "middle"}, "'middle' is not part of this mechanism"),
        ({"link": "ground"}, "'ground' is not part"),
        ({"link": "tip", "freed": "hinge"}, "'hinge' cannot be freed"),
        ({"link": "tip", "axes": "local"}, "axes = 'local'"),
        ({"link": "tip", "axes": np.ones((3, 3))}, "orthonormal"),
        ({"link": "tip", "at": (0, np.nan, 0)}, "finite coordinates"),
    ],
)
def test_wrong_words_are_refused(ask, words):
    model = compile_scene(single_joint())
    with pytest.raises(SceneError, match=words):
        point_stiffness(model, model.rest, **ask)
    with pytest.raises(SceneError, match="direction 'w'"):
        point_stiffness(model, model.rest, "tip").support("w")
    with pytest.raises(SceneError, match="drive 'left' is not held"):
        drive_stiffness(model, model.rest)["left"]


def test_methods_of_the_configuration():
    base = solve_conventional(compile_scene(single_joint()), {"turn": 0.3})
    at = (0.5 * cross_flexure().length_AB, 0, 0)
    assert base.stiffness("tip", at=at).supports["x"] > 1e6
    assert base.drive_stiffness()["turn"] > 13.3
    assert base.frequencies(count=2).frequency_Hz[0] > 0
    assert base.stress().largest_Pa > 1e8
    # the two smallest, and one of the other sign
    assert np.sign(base.buckling(count=2).factor).tolist() == [-1, -1, 1]
    assert sum(base.strain_energy().values()) > 0.0


@pytest.mark.parametrize("gravity", [None, (0.0, -9.81, 2.0)], ids=("light", "heavy"))
def test_many_states_together_have_the_stiffness_of_each(gravity):
    """Designs and poses of equal words, with and without weight, at points of their own; others are left out."""
    states, at = [], []
    for length, turn in ((0.1, 0.1), (0.1, 0.3), (0.12, 0.2)):
        scene = single_joint(cross_flexure(length=length))
        scene.load("tip", force=(3.0, 2.0, 40.0), at=(length, 0.01, 0.02))
        scene.gravity = gravity
        pose = solve_conventional(compile_scene(scene), {"turn": turn}, steps=2)
        states.append((pose.model, pose.motion, 1.0))
        at.append((length, 0.0, 0.03))
    chain = compile_scene(single_joint(), mesh=MESHES[1])
    ((numbers, group),) = group_states([*states, (chain, chain.rest, 1.0)])
    assert numbers == [0, 1, 2]
    assert (len(states[0][0].arrays.weight) > 0) == (gravity is not None)
    found = batch_stiffness(group, "tip", at=at, drives=True)
    assert found.valid.all()
    for (model, motion, _), point, C, K in zip(states, at, found.compliance, found.drives, strict=True):
        alone = point_stiffness(model, motion, "tip", at=point)
        size = np.sqrt(np.diagonal(alone.compliance))
        held = np.where(size > 0.0, size, 1.0)
        assert (C - alone.compliance) / np.outer(held, held) == pytest.approx(np.zeros((6, 6)), abs=1e-9)
        assert pytest.approx(drive_stiffness(model, motion).matrix, rel=1e-9) == K
    supports = support_stiffness(found.compliance, group.sizes)
    principal = principal_stiffness(found.compliance, group.sizes)
    for row, own, C in zip(supports, principal, found.compliance, strict=True):
        # the turn about z is held
        assert row[5] > 1e9
        assert row[:5] == pytest.approx(1.0 / np.diagonal(C)[:5])
        assert own[0] == pytest.approx(1.0 / np.linalg.eigvalsh(C[:3, :3])[::-1])
        assert own[1, :2] == pytest.approx(1.0 / np.linalg.eigvalsh(C[3:, 3:])[:0:-1]) and own[1, 2] > 1e9


def test_it_is_told_where_many_states_are_at_a_stable_equilibrium():
    """Not on the straight way of a buckled strut, nor where a Newton step is left to take."""
    scene = ksd.Mechanism("strut")
    tip = scene.link("tip")
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), section=ksd.rectangle(1e-3, 1e-2), material=STEEL,
               width_axis="z")  # fmt: skip
    scene.actuate(tip, along="z", at=(0.1, 0, 0), name="d")
    critical = np.pi**2 * STEEL.E * (1e-2 * 1e-9 / 12) / (4 * 0.1**2)
    scene.load(tip, force=(-critical, 0, 0), at=(0.1, 0, 0))
    model = compile_scene(scene)
    states = []
    for factor in (0.9, 1.1):
        straight = model.rest.copy()
        find_equilibrium(model.arrays, straight, model.targets({"d": 0.0}), factor)
        states.append((model, straight, factor))
    turned = states[0][1].copy()
    turned.R[1] = Rotation.from_rotvec([0.0, 0.0, 0.5]).as_matrix() @ turned.R[1]
    ((_, group),) = group_states([*states, (model, turned, 0.9)])
    found = batch_stiffness(group, "tip", at=[None])
    assert found.valid.all() and found.stable.tolist() == [True, False, False]
    assert found.compliance[0, 1, 1] > 0 > found.compliance[1, 1, 1]


def test_many_states_tell_a_leaf_that_buckles_between_its_ends():
    """Both ends are held but for the way along: all that is unstable is inside the leaf."""
    scene = ksd.Mechanism("strut")
    tip = scene.link("tip")
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), section=ksd.rectangle(1e-3, 1e-2), material=STEEL,
               width_axis="z")  # fmt: skip
    scene.actuate(tip, along="y", at=(0.1, 0, 0), name="d")
    scene.support(tip, about="z")
    critical = 4 * np.pi**2 * STEEL.E * (1e-2 * 1e-9 / 12) / 0.1**2
    scene.load(tip, force=(-critical, 0, 0), at=(0.1, 0, 0))
    model, states = compile_scene(scene), []
    for factor in (0.9, 1.1):
        straight = model.rest.copy()
        find_equilibrium(model.arrays, straight, model.targets({"d": 0.0}), factor)
        states.append((model, straight, factor))
    ((_, group),) = group_states(states)
    assert batch_stiffness(group, "tip", at=[None]).stable.tolist() == [True, False]


def test_what_a_drive_holds_is_held_to_the_last_digit(rng):
    """A stage that turns in space while a point of it is driven: asked alone, and with others."""
    scene = ksd.Mechanism("three leaves")
    stage, end, section = scene.link("stage"), np.array([0.02, 0.1, 0.0]), ksd.rectangle(5e-4, 1e-2)
    for start in rng.uniform(-0.04, 0.04, (3, 3)):
        scene.leaf(scene.ground, stage, start=start, end=end + 0.5 * start, section=section, material=STEEL,
                   width_axis=np.cross(end - 0.5 * start, rng.normal(size=3)))  # fmt: skip
    scene.actuate(stage, along="z", at=end, name="d")
    pose = solve_conventional(compile_scene(scene), {"d": 3e-3})
    C = pose.stiffness("stage", at=end).compliance
    assert not C[2].any() and not C[:, 2].any()
    ((_, group),) = group_states([(pose.model, pose.motion, 1.0)])
    together = batch_stiffness(group, "stage", at=[end]).compliance[0]
    assert abs(together[2, 2]) < 1e-20 * C[1, 1] and together == pytest.approx(C, rel=1e-9, abs=1e-18)


def test_curved_leaves_together_have_the_stiffness_and_stress_of_each():
    """Arcs of several radii, and one of them twice; stress of a leaf with a profile is asked alone."""

    def arc(radius, **words):
        scene = ksd.Mechanism("arc")
        tip, end = scene.link("tip"), 2 * radius * np.sin(0.4)
        scene.leaf(scene.ground, tip, start=(0, 0, 0), end=(end, 0, 0), section=ksd.rectangle(5e-4, 1e-2), width_axis="z",
                   material=ksd.Material(E=200e9, nu=0.3), curve=ksd.Arc(radius=radius, angle=0.8),
                   name="leaf", **words)  # fmt: skip
        scene.actuate(tip, along="y", at=(end, 0, 0), name="d")
        return scene

    poses = [ksd.solve(arc(r), d=d) for r, d in ((0.05, 2e-3), (0.06, -3e-3))]
    poses.append(ksd.prepare(poses[0].model)(d=1e-3))
    ((numbers, group),) = group_states([(p.model, p.motion, 1.0) for p in poses])
    found, peak = batch_stiffness(group, "tip", at=[None] * 3, drives=True), batch_peak_stress(group)
    assert numbers == [0, 1, 2] and found.valid.all()
    for k, pose in enumerate(poses):
        assert found.compliance[k] == pytest.approx(pose.stiffness("tip").compliance, rel=1e-9, abs=1e-12)
        assert found.drives[k] == pytest.approx(pose.drive_stiffness().matrix, rel=1e-9)
        assert peak[k]["leaf"].largest_Pa == pytest.approx(pose.stress().largest_Pa, rel=1e-12)
    profile = ksd.Taper(thickness=(5e-4, 4e-4), width=(1e-2, 1e-2))
    tapered = [ksd.solve(arc(r, profile=profile), d=d) for r, d in ((0.05, 1e-3), (0.06, -3e-3))]
    ((_, group),) = group_states([(p.model, p.motion, 1.0) for p in tapered])
    found = batch_stiffness(group, "tip", at=[None] * 2, drives=True)
    assert batch_peak_stress(group) is None and found.valid.all()
    for k, pose in enumerate(tapered):
        assert found.compliance[k] == pytest.approx(pose.stiffness("tip").compliance, rel=1e-9, abs=1e-12)
        assert found.drives[k] == pytest.approx(pose.drive_stiffness().matrix, rel=1e-9)


@pytest.mark.parametrize("points", [(), (0.04,)])
def test_a_wavy_leaf_keeps_its_shape_on_the_finer_mesh(points):
    """A moment turns its end by M L / EI whatever its shape; a shape drawn anew would be under stress there. The same of its
    pieces, and on the mesh of buckling, which has two modes more."""
    wavy, section = ksd.FreeCurve.sine((0.5, 0.3, 0.2), chord=0.1), ksd.rectangle(5e-4, 1e-2)
    scene = ksd.Mechanism("wavy")
    tip, steel = scene.link("tip"), ksd.Material(E=200e9, nu=0.3)
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), section=section, width_axis="z", material=steel,
               curve=wavy, name="leaf")  # fmt: skip
    for s in points:
        scene.point("leaf", s)
    pose = ksd.solve(scene)
    _, finer = finer_state(*finer_state(pose.model, pose.motion))
    assert np.abs(finer.inner).max() == pytest.approx(np.abs(pose.model.rest.inner).max(), rel=1e-12)
    turned = pose.stiffness("tip").compliance[5, 5]
    assert turned == pytest.approx(wavy.length / (steel.E * section.Iz), rel=1e-10)


def test_states_under_loads_that_are_not_conservative_are_asked_alone():
    scene = single_joint()
    scene.load("tip", force=(0.0, 2.0, 0.0), at=(0.1, 0, 0), following=True)
    pose = solve_conventional(compile_scene(scene), {"turn": 0.1})
    ((_, group),) = group_states([(pose.model, pose.motion, 1.0)])
    assert not batch_stiffness(group, "tip", at=[None]).valid.any()


def test_freed_drives_by_a_generator():
    """Names that can be read once only let go what the same names in a list do."""
    pose = ksd.solve(single_joint(), turn=0.1)
    names = lambda: (name for name in ["turn"])  # noqa: E731
    assert pose.stiffness("tip", freed=names()).compliance == pytest.approx(
        pose.stiffness("tip", freed=["turn"]).compliance
    )
    assert pose.drive_stiffness(freed=names()).names == ()
    assert pose.buckling("tip", force=(0, -1, 0), freed=names()).factor == pytest.approx(
        pose.buckling("tip", force=(0, -1, 0), freed="turn").factor
    )


@pytest.mark.parametrize("top", [0.0, 1e-9])
def test_at_rest_leaf_springs_of_constant_stiffness_are_the_others(top):
    """Forces inside them are rounding there."""
    found, exact = (ksd.solve(fourbar(), top=top, method=m) for m in ("constant", "full"))
    assert found.drive_stiffness()["top"] == pytest.approx(exact.drive_stiffness()["top"], rel=1e-6)
    lowest = exact.frequencies(count=1).frequency_Hz
    assert found.frequencies(count=1).frequency_Hz == pytest.approx(lowest, rel=1e-6)


def test_what_a_direction_is_most_coupled_with():
    """C_ij / sqrt(C_ii C_jj) of a slender leaf spring's end: L^2 / 2 over the root of L^3 / 3 times L."""
    scene = ksd.Mechanism("cantilever")
    scene.leaf(
        scene.ground, scene.link("tip"), start=(0, 0, 0), end=(0.1, 0, 0), section=ksd.rectangle(5e-4, 0.01), material=STEEL,
        width_axis="z", name="leaf",
    )  # fmt: skip
    said = [line.split() for line in str(ksd.solve(scene).stiffness("tip", at=(0.1, 0, 0))).splitlines()]
    assert [line[-2:] for line in said if line[:1] == ["y"]] == [["rz", f"({0.75**0.5:.2f})"]]
    assert [line[-1] for line in said if line[:1] == ["rx"]] == ["rad/Nm"]


def by_fractions(K, loads):
    """K^-1 loads without rounding."""
    rows = [[Fraction(v) for v in row] for row in np.column_stack([K, loads]).tolist()]
    for c in range(len(K)):
        rows[c:] = sorted(rows[c:], key=lambda row, c=c: -abs(row[c]))
        rows[c] = [v / rows[c][c] for v in rows[c]]
        rows = [
            row if i == c else [v - row[c] * w for v, w in zip(row, rows[c], strict=True)]
            for i, row in enumerate(rows)
        ]
    return np.array([[float(v) for v in row[len(K) :]] for row in rows])


def test_a_dense_tangent_tells_the_digits_it_lost(rng):
    """Of an almost singular matrix, beside the exact solution: the change by one refinement bounds the error before it."""
    turned = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    loads, unit = rng.normal(size=(6, 2)), 10.0 ** np.arange(-3, 3)
    for smallest, most in ((1.0, 1e-14), (1e-9, 1e-6)):
        K = unit[:, None] * (turned * [1.0, -2.0, 3.0, 2.0, -1.0, smallest]) @ turned.T * unit
        K = 0.5 * (K + K.T)
        tangent = DenseTangent(None, None, None, None, None, None, 0, matrix=K)
        found, error = tangent._symmetric(loads)
        exact = by_fractions(K, loads)
        first = solve_scaled(K, loads, equilibration(K))[0]
        off, size = (
            np.linalg.norm(part * tangent.weight()[:, None], axis=0) for part in (first - exact, exact)
        )
        assert 0.1 * (off / size).max() < error < most
        assert found * unit[:, None] == pytest.approx(exact * unit[:, None], rel=1e-6 * most**0.1)
        assert tangent._residual(loads, found) == pytest.approx(loads - K @ found)
