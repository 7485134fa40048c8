"""Frequencies against a dense eigensolution of the uncondensed matrices, rigid-body masses, and the modes'
algebra."""

import numpy as np
import pytest
import scipy.linalg
from scenes import STEEL, cross_flexure, fourbar, single_joint
from uncondensed import uncondensed

import ksd
from ksd.answers.frequencies import frequencies
from ksd.answers.leaf_groups import leaf_groups
from ksd.answers.mass import _leaf_mass_roots, assemble_inertia, member_leaves
from ksd.errors import SceneError
from ksd.model.compile import compile_scene
from ksd.model.leaves import mass_density
from ksd.model.mesh import Mesh
from ksd.section import rectangle
from ksd.solvers.conventional import solve_conventional


def heavy_fourbar():
    scene = fourbar()
    scene.mass("top", mass=2.0, inertia=(4e-3, 2e-3, 5e-3), at=(0.01, 0.4, 0.02))
    scene.load("top", force=(0, -20.0, 5.0), at=(0, 0.35, 0))
    return scene


@pytest.fixture(scope="module")
def bent():
    return solve_conventional(compile_scene(heavy_fourbar()), {"top": 0.15})


@pytest.mark.parametrize("freed", [(), ("top",)], ids=("held", "freed"))
@pytest.mark.parametrize("dense", [True, False], ids=("dense", "iterated"))
def test_against_a_dense_eigensolution_of_the_same_matrices(bent, freed, dense):
    K, M = uncondensed(bent.model, bent.motion, freed)
    values = scipy.linalg.eigvals(np.linalg.solve(K, M))
    expected = np.sqrt(1 / np.sort(values.real)[::-1][:5]) / (2 * np.pi)
    found = frequencies(bent.model, bent.motion, count=5, freed=freed, dense=dense)
    assert found.frequency_Hz == pytest.approx(expected, rel=1e-7)


def test_both_routes_agree_and_modes_are_orthonormal(bent):
    dense, sparse = (frequencies(bent.model, bent.motion, count=6, dense=d) for d in (True, False))
    assert dense.frequency_Hz == pytest.approx(sparse.frequency_Hz, rel=1e-8)
    assert dense.vector @ dense.mass.matrix.toarray() @ dense.vector.T == pytest.approx(np.eye(6), abs=1e-7)
    assert np.diag(dense.mac(sparse)) == pytest.approx(np.ones(6), abs=1e-6)
    assert len(dense) == 6


def test_equal_frequencies_are_all_found():
    """Seven like leaf springs, each with a like block: single vectors of an iteration see one of seven equal modes only."""
    scene = ksd.Mechanism("comb")
    for k in range(7):
        block = scene.link(f"block {k}", mass=0.1, inertia=(1e-5, 1e-5, 1e-5), at=(0.1, 0, k))
        scene.leaf(
            scene.ground, block, start=(0, 0, k), end=(0.1, 0, k), section=rectangle(1e-3, 0.02), material=STEEL,
            width_axis=(0, 0, 1),
        )  # fmt: skip
    model = compile_scene(scene)
    one, other = (
        frequencies(model, model.rest, count=10, dense=dense).frequency_Hz for dense in (True, False)
    )
    assert one[:7] == pytest.approx(np.full(7, one[0]), rel=1e-9) and one[7] > 2 * one[0]
    assert other == pytest.approx(one, rel=1e-7)


def test_every_unstable_mode_is_found():
    """Three columns beyond their critical load, two of them alike."""
    scene = ksd.Mechanism("columns")
    for k, share in enumerate((1.05, 1.05, 1.2, 0.9)):
        tip = scene.link(f"tip {k}", mass=0.1, inertia=(1e-5, 1e-5, 1e-5), at=(0.1, 0, k))
        scene.leaf(
            scene.ground, tip, start=(0, 0, k), end=(0.1, 0, k), section=rectangle(0.5e-3, 0.02), material=STEEL,
            width_axis=(0, 0, 1),
        )  # fmt: skip
        critical = np.pi**2 * 200e9 * 0.02 * 0.5e-3**3 / 12 / (4 * 0.1**2)
        scene.load(tip, force=(-share * critical, 0, 0), at=(0.1, 0, k))
    state = solve_conventional(compile_scene(scene), {})
    assert not state.stable
    one, other = (state.frequencies(count=6, dense=dense).frequency_Hz for dense in (True, False))
    assert np.sum(one < 0) == 3 and other == pytest.approx(one, rel=1e-7)


def _transfer(w, L, EA, GA, EI, mass, rotary):
    """Transfer matrix (6, 6) of (u, v, theta, N, Q, M) along a Timoshenko beam that vibrates at w [rad/s]."""
    A = np.zeros((6, 6))
    A[0, 3], A[1, 4], A[2, 5], A[1, 2], A[5, 4] = 1 / EA, 1 / GA, 1 / EI, 1.0, -1.0
    A[3, 0], A[4, 1], A[5, 2] = -mass * w**2, -mass * w**2, -rotary * w**2
    units = np.array([L, L, 1.0, EI / L**2, EI / L**2, EI / L])
    return scipy.linalg.expm(A * L * units / units[:, None])


@pytest.mark.parametrize("thickness, in_plane", [(0.3e-3, [0, 1, 2, 3, 6]), (1e-3, [0, 1, 2, 3, 4])])
def test_modes_of_leaf_springs_between_their_ends_are_those_of_beams(thickness, in_plane):
    """A guide, by the exact dynamic stiffness of its two beams: it changes its sign within 1e-5 of every frequency.

    Shear by the inertia between the ends of the leaf springs lowers their modes, by 1.6e-4 to 1.6e-3.
    """
    L, width, m, inertia, far = 0.06, 0.02, 1.0, 2e-3, 0.025
    scene = ksd.Mechanism("guide", plane="xy")
    stage = scene.link("stage", mass=m, inertia=(inertia,) * 3, at=(L, 0, 0))
    section = rectangle(thickness, width)
    for y in (-far, far):
        scene.leaf("ground", stage, start=(0, y, 0), end=(L, y, 0), section=section, material=STEEL)
    area, second = thickness * width, width * thickness**3 / 12
    beam = {
        "EA": STEEL.E * area, "GA": STEEL.G * area * section.ky, "EI": STEEL.E * second,
        "mass": STEEL.density * area, "rotary": STEEL.density * second,
    }  # fmt: skip
    units = np.array([L, L, 1.0])

    def stiffness(f):
        w = 2 * np.pi * f
        T = _transfer(w, L, **beam)
        own = np.linalg.solve(T[:3, 3:].T, T[3:, 3:].T).T * beam["EI"] / L
        whole = -(w**2) * np.diag([m, m, inertia]) * np.outer(units, units)
        for y in (-far, far):
            levers = np.array([[1, 0, -y / L], [0, 1, 0], [0, 0, 1]])
            whole = whole + levers.T @ own @ levers
        return np.linalg.det(whole) * np.linalg.det(T[:3, 3:]) ** 2

    modes = ksd.solve(scene).frequencies(count=12)
    near = [bool(stiffness(f * (1 - 1e-5)) * stiffness(f * (1 + 1e-5)) < 0) for f in modes.frequency_Hz]
    assert np.flatnonzero(near).tolist() == in_plane


def test_chain_of_elements_converges_to_the_strain_leaf(bent):
    exact = bent.frequencies(count=3).frequency_Hz
    error = []
    for n in (6, 12):
        chain = solve_conventional(
            compile_scene(heavy_fourbar(), mesh=Mesh("corotational", elements=n)), {"top": 0.15}
        )
        found = chain.frequencies(count=3)
        assert len(found.model.node_names) == 1 + 3 + 12 * (n - 1)
        error.append(np.abs(found.frequency_Hz / exact - 1).max())
    assert error[1] < 0.35 * error[0] < 0.01


def test_nodal_and_condensed_chains_are_the_same():
    pair = [
        solve_conventional(
            compile_scene(heavy_fourbar(), mesh=Mesh("corotational", elements=4, nodal=n)),
            {"top": 0.1},
            steps=4,
        )
        for n in (True, False)
    ]
    found = [c.frequencies(count=4).frequency_Hz for c in pair]
    assert found[0] == pytest.approx(found[1], rel=1e-6)


def test_rigid_mass_is_that_of_the_leaves():
    """A uniform velocity and a uniform spin of all nodes see the total mass and inertia, in any
    configuration."""
    model = compile_scene(single_joint())
    state = solve_conventional(model, {"turn": 0.7}).motion
    lines, total, energy = member_leaves(model), 0.0, 0.0
    spin = np.array([0.3, -0.2, 0.5])
    for group, leaf in zip(leaf_groups(model), assemble_inertia(model, state).leaves, strict=True):
        # ground is fixed: the whole of every leaf, both ends moving
        roots = _leaf_mass_roots(
            leaf, np.stack([mass_density(lines[i][0]) * lines[i][1] for i in group.members])
        )
        for root, i in zip(roots, group.members, strict=True):
            nodes, still = model.arrays.members.node[i], np.zeros(root.shape[1] - 12)
            move = np.concatenate([np.tile([1.0, 0, 0, 0, 0, 0], 2), still])
            total += np.sum((root @ move) ** 2)
            turn = [np.concatenate([np.cross(spin, state.x[k]), spin]) for k in nodes]
            energy += 0.5 * np.sum((root @ np.concatenate([*turn, still])) ** 2)
    assert total == pytest.approx(7800 * 0.1 * 1e-3 * 0.08, rel=1e-9)
    assert energy > 0.0


@pytest.mark.parametrize("count", [1, 2, 12])
def test_the_intended_mode_does_not_hang_on_how_many_are_asked_for(count):
    """A drive that gets .49, .16 and .34 of its compliance from three modes: one asked for alone does not tell that the
    others have less."""
    scene = ksd.Mechanism("rod")
    E, G, L, b, h = STEEL.E, STEEL.G, 0.1, 1e-3, 1.3e-3
    tip = scene.link("tip", mass=0.2, inertia=(1e-5, 1e-5, 1e-5), at=(L, 0, 0))
    rod = {"section": rectangle(b, h), "material": STEEL, "width_axis": "z"}
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=(L, 0, 0), **rod)
    moved = [scene.displacement(tip, axis, at=(L, 0, 0)) for axis in "yz"]
    scene.actuate(terms=1.6 * moved[0] + 1.2 * moved[1] + 0.07 * scene.rotation(tip, "x"), name="drive")
    # by beam theory, torsion of a rectangle with Saint-Venant's factor
    weak, strong, torsion = h * b**3 / 12, b * h**3 / 12, 0.178 * h * b**3
    share = [1.6**2 * L**3 / (3 * E * weak), 1.2**2 * L**3 / (3 * E * strong), 0.07**2 * L / (G * torsion)]
    assert share[2] < share[0] < share[1] + share[2]
    modes = ksd.solve(scene, drive=0.0).frequencies(count=count, freed="drive")
    assert modes.names == ("intended", *(f"parasitic_{k}" for k in range(1, count)))


def test_a_rigid_payload_on_a_soft_leaf_is_a_pendulum_of_one_freedom():
    """omega^2 = k/m for a heavy block guided by two leaf springs; leaf springs without density carry no mass and are
    named."""
    light = ksd.Material(E=200e9, nu=0.3, name="light steel")
    scene = ksd.Mechanism("guide")
    table = scene.link("table", mass=5.0, inertia=(0.01, 0.01, 0.01), at=(0.1, 0, 0))
    for k, y in enumerate((-0.03, 0.03)):
        scene.leaf(
            scene.ground, table, start=(0, y, 0), end=(0.1, y, 0), section=rectangle(0.5e-3, 0.03),
            material=light, width_axis=(0, 0, 1), name=f"leaf {k}",
        )  # fmt: skip
    scene.actuate(table, along="y", at=(0.1, 0, 0), name="stroke")
    model = compile_scene(scene)
    rest = solve_conventional(model, {"stroke": 0.0})
    found = rest.frequencies(freed="stroke")
    k = rest.drive_stiffness()["stroke"]
    # the block turns a little as it moves, so its own stiffness is met to that order
    assert (2 * np.pi * found.frequency_Hz[0]) ** 2 == pytest.approx(k / 5.0, rel=1e-4)
    assert found.intended.tolist() == [0]
    assert found.first_parasitic_Hz == found.frequency_Hz[1]
    assert found.massless == ("light steel",)
    held = rest.frequencies()
    assert len(held.intended) == 0 and np.all(held.drive_motion[:, 0] < 1e-9)


def test_buckled_state_has_a_negative_frequency():
    scene = ksd.Mechanism("column")
    tip = scene.link("tip", mass=0.1, inertia=(1e-5, 1e-5, 1e-5), at=(0.1, 0, 0))
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), section=rectangle(0.5e-3, 0.02), material=STEEL,
        width_axis=(0, 0, 1), name="leaf",
    )  # fmt: skip
    critical = np.pi**2 * 200e9 * 0.02 * 0.5e-3**3 / 12 / (4 * 0.1**2)
    for share, unstable in ((0.98, False), (1.02, True)):
        scene_loaded = solve_conventional(compile_scene(_loaded(scene, -share * critical)), {})
        found = scene_loaded.frequencies(count=2)
        assert (found.frequency_Hz[0] < 0) == unstable
        assert scene_loaded.stable != unstable


def _loaded(scene, force):
    from dataclasses import replace

    from ksd.scene.load import Load

    frozen = scene.scene()
    return replace(frozen, loads=(Load("push", "tip", (force, 0.0, 0.0), (0.0, 0.0, 0.0), (0.1, 0.0, 0.0)),))


def test_no_mass_no_frequencies():
    bare = ksd.CrossFlexure(
        ksd.Material(E=200e9, nu=0.3), length=0.1, angle=np.pi / 4, thickness=1e-3, widths=(0.04, 0.02)
    )
    model = compile_scene(single_joint(bare))
    with pytest.raises(SceneError, match="nothing in this scene has mass"):
        frequencies(model, model.rest)


def test_modes_follow_each_other_along_a_stroke():
    model = compile_scene(single_joint(cross_flexure()))
    last, before = None, None
    for turn in np.linspace(0.05, 0.6, 8):
        last = solve_conventional(model, {"turn": float(turn)}, start=last)
        now = last.frequencies(count=4)
        if before is not None:
            assert before.mac(now)[0].max() > 0.8
        before = now


def row(pieces, **leaf):
    """Free leaf springs in a row from ground, `pieces` of (start, end, words); the last link is free."""
    scene = ksd.Mechanism("row")
    links = [scene.ground, *scene.links(*(f"n{k}" for k in range(len(pieces))))]
    for k, (start, end, words) in enumerate(pieces):
        scene.leaf(
            links[k], links[k + 1], start=start, end=end, material=STEEL, width_axis=(0, 0, 1), name=f"p{k}",
            **{"section": rectangle(1e-3, 0.02), **leaf, **words},
        )  # fmt: skip
    model = compile_scene(scene)
    return frequencies(model, model.rest, count=3).frequency_Hz


def test_a_tapered_leaf_vibrates_as_many_short_ones():
    thick = (2e-3, 1e-3)
    one = row(
        [
            (
                (0, 0, 0),
                (0.1, 0, 0),
                {"profile": ksd.Taper(thickness=thick, width=(0.02, 0.02)), "section": rectangle(1e-3, 0.02)},
            )
        ]
    )
    error = []
    for n in (6, 12):
        cuts = np.linspace(0, 0.1, n + 1)
        sections = [rectangle(np.interp((k + 0.5) / n, (0, 1), thick), 0.02) for k in range(n)]
        many = row(
            [
                ((a, 0, 0), (b, 0, 0), {"section": q})
                for a, b, q in zip(cuts, cuts[1:], sections, strict=False)
            ]
        )
        error.append(np.abs(many / one - 1).max())
    assert error[1] < 0.35 * error[0] < 1e-2


def test_a_curved_leaf_vibrates_as_its_two_halves():
    radius, angle = 0.1, 1.0
    end = radius * np.array([np.sin(angle), 1 - np.cos(angle), 0])
    middle = radius * np.array([np.sin(angle / 2), 1 - np.cos(angle / 2), 0])
    one = row([((0, 0, 0), tuple(end), {"curve": ksd.Arc(radius=radius, angle=angle)})])
    half = ksd.Arc(radius=radius, angle=angle / 2)
    two = row([((0, 0, 0), tuple(middle), {"curve": half}), (tuple(middle), tuple(end), {"curve": half})])
    assert one == pytest.approx(two, rel=2e-3)


def test_chains_of_a_tapered_leaf_say_what_to_do():
    scene = ksd.Mechanism("taper")
    scene.leaf(
        scene.ground, scene.link("tip"), start=(0, 0, 0), end=(0.1, 0, 0), section=rectangle(1e-3, 0.02),
        material=STEEL, width_axis=(0, 0, 1), name="wedge", profile=ksd.Taper(thickness=(2e-3, 1e-3), width=(0.02, 0.02)),
    )  # fmt: skip
    model = compile_scene(scene, mesh=Mesh("corotational", elements=4))
    with pytest.raises(SceneError, match="leaf 'wedge' is curved or has a profile"):
        frequencies(model, model.rest)


def test_a_rigid_spin_of_a_thick_leaf_has_the_inertia_of_a_box():
    """Rotary inertia of its sections about all three axes, those of a block of the same density."""
    scene, (L, t, w) = ksd.Mechanism("block"), (0.05, 0.02, 0.03)
    tip = scene.link("tip")
    stuff = ksd.Material(E=200e9, nu=0.3, density=7800)
    scene.leaf(
        scene.ground, tip, start=(-L / 2, 0, 0), end=(L / 2, 0, 0), section=rectangle(t, w), width_axis="z",
        material=stuff, name="block",
    )  # fmt: skip
    model = compile_scene(scene)
    (group,), (leaf,) = leaf_groups(model), assemble_inertia(model, model.rest).leaves
    (root,) = _leaf_mass_roots(leaf, np.stack([7800 * member_leaves(model)[i][1] for i in group.members]))
    ends = model.rest.x[model.arrays.members.node[0]] + model.arrays.members.offset[0]
    assert ends[:, 0] == pytest.approx([-L / 2, L / 2])
    inertia = np.array([t**2 + w**2, L**2 + w**2, L**2 + t**2]) * 7800 * L * t * w / 12
    for axis in range(3):
        spin = np.eye(3)[axis]
        turn = [np.concatenate([np.cross(spin, model.rest.x[k]), spin]) for k in model.arrays.members.node[0]]
        moved = root @ np.concatenate([*turn, np.zeros(root.shape[1] - 12)])
        assert np.sum(moved**2) == pytest.approx(inertia[axis], rel=1e-9)
