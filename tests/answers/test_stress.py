"""Stress of leaf springs against beam formulas, and strain energy against the work of the drives."""

import math

import numpy as np
import pytest
from scenes import STEEL, fourbar, single_joint

import ksd
from ksd.answers import stress as stresses
from ksd.answers.centrelines import scene_leaves
from ksd.answers.state_batch import group_states
from ksd.answers.stress import stress_points, torsion_factors
from ksd.model.compile import compile_scene
from ksd.model.mesh import Mesh
from ksd.section import circle, numbers, polygon, rectangle
from ksd.solvers.conventional import solve_conventional

L, T, W = 0.1, 1e-3, 0.02


def tip_loaded(section=None, **load):
    scene = ksd.Mechanism("cantilever")
    tip = scene.link("tip")
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(L, 0, 0), section=section or rectangle(T, W), material=STEEL,
        width_axis=(0, 0, 1), name="leaf",
    )  # fmt: skip
    scene.load(tip, at=(L, 0, 0), **load)
    return solve_conventional(compile_scene(scene), {})


@pytest.mark.parametrize("mesh", [Mesh(), Mesh("corotational", elements=8)], ids=("strain", "chain"))
def test_cross_flexure_bends_as_circles(mesh):
    """Symmetric cross flexure: sigma = E t theta / (2 L), exact for small angles (acceptance and paper 1,
    4.1)."""
    theta = 1e-4
    found = solve_conventional(compile_scene(single_joint(), mesh=mesh), {"turn": theta}).stress()
    expected = STEEL.E * 1e-3 * theta / (2 * 0.1)
    for leaf in found.leaves.values():
        assert leaf.largest_Pa == pytest.approx(expected, rel=1e-4)
        assert leaf.bending_Pa == pytest.approx(np.full(len(leaf.s), expected), rel=1e-4)
    assert found.largest_Pa == pytest.approx(expected, rel=1e-4)


def test_each_part_by_its_formula():
    A, Iz, Iy = T * W, W * T**3 / 12, T * W**3 / 12
    pulled = tip_loaded(force=(100, 0, 0)).stress()["leaf"]
    assert pulled.axial_Pa == pytest.approx(np.full(25, 100 / A))
    assert pulled.von_mises_Pa == pytest.approx(np.full((25, 9), 100 / A))
    small = tip_loaded(force=(0, 1e-4, 0)).stress()["leaf"]
    assert small.bending_Pa == pytest.approx(
        1e-4 * (L - small.s) * T / 2 / Iz, abs=1e-4 * L * T / 2 / Iz * 1e-5
    )
    assert small.transverse_Pa[-1] == pytest.approx(1.5e-4 / A, rel=1e-5)
    assert small.where[0] == 0.0 and small.where[1].startswith("corner")
    wide = tip_loaded(force=(0, 0, 1e-2)).stress()["leaf"]
    assert wide.bending_Pa[0] == pytest.approx(1e-2 * L * W / 2 / Iy, rel=1e-5)
    twisted = tip_loaded(moment=(1e-4, 0, 0)).stress()["leaf"]
    # Timoshenko and Goodier, table of section 109: tau = T / (k2 w t^2), k2 = .2817 at 10:1 scaled to 20:1 by .3138
    assert twisted.torsion_Pa[0] == pytest.approx(1e-4 / (0.3228 * W * T**2), rel=2e-3)
    assert twisted.where[1].startswith("face")


def test_sign_of_bending_and_axial_stress():
    """A tip pushed towards +y pulls the -y face at the clamp; one pushed towards +z pulls the -z edge."""
    up = tip_loaded(force=(0, 1e-3, 0)).stress()["leaf"]
    assert up.normal_Pa[0][up.y[0] < 0].min() > 0 > up.normal_Pa[0][up.y[0] > 0].max()
    side = tip_loaded(force=(0, 0, 1e-3)).stress()["leaf"]
    assert side.normal_Pa[0][side.z[0] < 0].min() > 0 > side.normal_Pa[0][side.z[0] > 0].max()


def test_torsion_factors():
    # square: tau_max = T / (.208 a^3), J = .1406 a^4 (Timoshenko and Goodier, section 109)
    wide, narrow = torsion_factors(1.0)
    assert wide / 0.1406 == pytest.approx(1 / 0.208, rel=2e-3)
    assert narrow == pytest.approx(wide, rel=1e-4)
    thin = torsion_factors(100.0)
    assert thin[0] == pytest.approx(1.0, abs=1e-3)
    # 8/pi^2 times Catalan's constant
    assert thin[1] == pytest.approx(0.7425, abs=1e-3)


def test_other_sections():
    wire = tip_loaded(section=circle(2e-3), moment=(1e-3, 0, 0)).stress()["leaf"]
    assert wire.torsion_Pa[0] == pytest.approx(16e-3 / (np.pi * 8e-9), rel=1e-6)
    drawn = polygon([(-T / 2, -W / 2), (T / 2, -W / 2), (T / 2, W / 2), (-T / 2, W / 2)])
    same = tip_loaded(section=drawn, force=(0, 1e-4, 0)).stress()["leaf"]
    assert same.bending_Pa[0] == pytest.approx(1e-4 * L * 6 / (W * T**2), rel=1e-3)
    q = rectangle(T, W)
    bare = stress_points(numbers(A=q.A, J=q.J, Iy=q.Iy, Iz=q.Iz))
    assert np.ptp(bare.y) == pytest.approx(T) and np.ptp(bare.z) == pytest.approx(W)


@pytest.mark.parametrize("mesh", [Mesh(), Mesh("corotational", elements=4)], ids=("strain", "chain"))
def test_energy_is_the_work_of_the_drive(mesh):
    model = compile_scene(fourbar(), mesh=mesh)
    x, w = np.polynomial.legendre.leggauss(8)
    stroke, last, work = 0.2, None, 0.0
    for at, weight in zip(0.5 * stroke * (1 + x), 0.5 * stroke * w, strict=True):
        last = solve_conventional(model, {"top": float(at)}, start=last)
        work += weight * last.forces["top"]
    stored = solve_conventional(model, {"top": stroke}, start=last).strain_energy()
    assert len(stored) == 12
    assert sum(stored.values()) == pytest.approx(work, rel=1e-6)


def test_it_reads_as_a_sentence():
    text = str(solve_conventional(compile_scene(single_joint()), {"turn": 0.2}).stress())
    assert "hinge/inner:" in text and "MPa at s =" in text


def test_largest_stresses_of_many_states_together_are_those_one_by_one():
    def wired(section, material=STEEL):
        scene = ksd.Mechanism("wired")
        tip = scene.link("tip")
        scene.leaf(scene.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), section=section, material=material,
                   width_axis="z", name="leaf")  # fmt: skip
        scene.actuate(tip, about="z", at=(0.1, 0, 0), name="turn")
        scene.load(tip, force=(1.0, 2.0, 3.0), moment=(0.01, 0.02, 0), at=(0.12, 0.01, 0.01))
        return scene

    def sections_of(pose):
        return [leaf.section for leaf in scene_leaves(pose.model).values()]

    scenes = [single_joint(), wired(ksd.circle(2e-3)), wired(ksd.rectangle(1e-3, 8e-3)), wired(ksd.rectangle(9e-3, 3e-3)),
              wired(ksd.polygon([(0, 0), (2e-3, 0), (2e-3, 3e-3)]))]  # fmt: skip
    poses = [
        ksd.solve(s, turn=t, method="full" if s is scenes[0] else None) for s in scenes for t in (0.1, 0.2)
    ]
    groups = group_states([(*p.unreduced_equilibrium, p.load_factor) for p in poses])
    assert sorted(k for those, _ in groups for k in those) == list(range(len(poses)))
    found = {
        k: own
        for those, group in groups
        for k, own in zip(those, stresses.batch_peak_stress(group), strict=True)
    }
    for k, pose in enumerate(poses):
        one, own = pose.stress(), found[k]
        assert list(own) == list(one.leaves)
        for name, peak in own.items():
            assert peak.largest_Pa == pytest.approx(one[name].largest_Pa, rel=1e-12)
            assert (peak.s, peak.point) == one[name].where
    for those, group in groups:
        mixed = len({len(stress_points(q).names) for k in those for q in sections_of(poses[k])}) > 1
        together = stresses.batch_stress_at_peaks(group, np.zeros(len(those), int))
        assert (together is None) == mixed, "unlike sections have unlike points"
        for name, followed in (together or {}).items():
            every = [poses[k].stress()[name].von_mises_Pa for k in those]
            mark = np.unravel_index(np.argmax(every[0]), every[0].shape)
            assert followed == pytest.approx([own[mark] for own in every], rel=1e-12)
        alone = stresses.batch_stress_at_peaks(group, np.arange(len(those)))
        for k, own in enumerate(stresses.batch_peak_stress(group)):
            assert {n: v[k] for n, v in alone.items()} == pytest.approx(
                {n: p.largest_Pa for n, p in own.items()}
            )
    chain = ksd.solve(single_joint(), turn=0.1, mesh=ksd.Mesh("corotational", elements=3))
    assert not group_states([(*chain.unreduced_equilibrium, 1.0)])


@pytest.mark.parametrize("inner", [0.0, 6e-3, 9.8e-3])
def test_circles_and_tubes(inner):
    """T R/J, M R/I about an oblique axis, and the shear of a force, to 2 V/A of a thin tube; a circle has a centre."""
    outer, straight = 10e-3, np.zeros((1, 1, 6))
    q = ksd.tube(outer, inner) if inner else ksd.circle(outer)
    points, stations = stress_points(q), stresses._section_tables((q,))
    assert ("centre" in points.names) == (inner == 0.0)

    def most(**forces):
        values = straight.copy()
        for name, value in forces.items():
            values[0, 0, ("N", "Vy", "Vz", "T", "My", "Mz").index(name)] = value
        return float(stresses._stresses(values, stations, outlined=False)[2].max())

    assert most(T=3.0) == pytest.approx(math.sqrt(3) * 3.0 * outer / 2 / q.J)
    assert most(My=2.0, Mz=-2.0) == pytest.approx(2.0 * math.sqrt(2) * outer / 2 / q.Iz)
    m = inner / outer
    assert most(Vz=5.0) == pytest.approx(
        math.sqrt(3) * 4 / 3 * 5.0 / q.A * (1 + m + m * m) / (1 + m * m), rel=1e-9
    )
    assert most(N=7.0) == pytest.approx(7.0 / q.A)


THICK, THIN = ksd.rectangle(2e-3, 0.01), ksd.rectangle(1e-3, 0.01)


@pytest.mark.parametrize(
    ("profile", "step"),
    [
        (ksd.Varying(lambda s: THICK if s <= 0.5 else THIN, breaks=(0.5,)), 0.5),
        (ksd.Varying(lambda s: THICK if s < 0.5 else THIN, breaks=(0.5,)), 0.5),
        (ksd.StiffenedMiddle(thickness=2e-3, width=0.01, middle=1e-3, part=0.4), 0.3),
    ],
)
def test_stress_at_a_step_is_that_of_the_thin_side(profile, step):
    """It took a side by rounding: stress 8 % too low, and the size of the leaf springs off by half their thickness."""
    scene = ksd.Mechanism("step")
    tip, at = scene.link("tip"), (0.1, 0, 0)
    scene.leaf(
        "ground", tip, start=(0, 0, 0), end=at, section=THICK, material=STEEL, width_axis="z", profile=profile
    )
    scene.load(tip, force=(0, 0.1, 0), at=at)
    pose = ksd.solve(scene)
    peak = pose.stress()["leaf"]
    # source: bending of a beam, 6 M / (w t^2)
    assert peak.largest_Pa == pytest.approx(6 * 0.1 * 0.1 * (1 - step) / (0.01 * 1e-3**2), rel=1e-4)
    assert peak.where[0] == pytest.approx(0.1 * step)
    shape = pose.shape().leaves[0]
    on_step = np.abs(shape.s - 0.1 * step) < 1e-9
    assert on_step.any() and shape.thickness[on_step] == pytest.approx(2e-3)


def test_a_profile_of_unlike_sections():
    """A wire, a tube and a rail one after the other: each part has the stress it has in a leaf of its own section."""
    rail = polygon([(-1e-3, -2e-3), (1e-3, -2e-3), (1e-3, 2e-3), (0, 3e-3), (-1e-3, 2e-3)])
    parts = ksd.circle(2e-3), ksd.tube(4e-3, 3e-3), rail
    scene = ksd.Mechanism("three rods")
    tip = scene.link("tip")
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=(0.09, 0, 0), section=parts[0], material=STEEL, width_axis="z",
               profile=ksd.Varying(lambda s: parts[min(int(3 * s), 2)], breaks=(1 / 3, 2 / 3)), name="leaf")  # fmt: skip
    scene.load(tip, force=(3.0, 0.4, -0.2), at=(0.09, 0.01, 0.02))
    pose = ksd.solve(scene)
    found, forces = pose.stress()["leaf"], pose.section_forces()["leaf"]
    assert found.points[0] == "rim 0 deg or corner 1" and pose.strength is not None
    for k in np.flatnonzero(np.abs(3 * found.s / 0.09 % 1 - 0.5) < 0.4):
        q = parts[int(3 * found.s[k] / 0.09)]
        want = stresses._stresses(
            forces.values[None, k : k + 1], stresses._section_tables((q,)), outlined=True
        )[2].max()
        assert found.von_mises_Pa[k].max() == pytest.approx(float(want), rel=1e-12)


@pytest.mark.parametrize(("t", "w"), [(1e-3, 4e-3), (4e-3, 1e-3)])
def test_stress_points_of_a_rectangle_are_its_corners_sides_and_centre(t, w):
    """Their names say on which side they are; shear flows around as the twist does."""
    points = stress_points(ksd.rectangle(t, w))
    for name, y, z in zip(points.names, points.y.tolist(), points.z.tolist(), strict=True):
        sides = [
            0.5 * size * (f"+{axis}" in name) - 0.5 * size * (f"-{axis}" in name)
            for axis, size in (("y", t), ("z", w))
        ]
        assert (y, z) == pytest.approx(tuple(sides))
    # the moment of the torsional shear about the centre is positive at every point of the rim
    turning = points.y * points.torsion[:, 1] - points.z * points.torsion[:, 0]
    assert (turning[4:8] > 0.0).all() and np.allclose(points.torsion[[0, 1, 2, 3, 8]], 0.0)
    # a parabola across the section: half more than the mean where it is largest
    assert points.along_y[8, 0] == points.along_z[8, 1] == pytest.approx(1.5 / (t * w))


def test_an_outline_bears_no_less_than_the_rectangle_it_is():
    drawn = stress_points(ksd.polygon([(0, 0), (1e-3, 0), (1e-3, 4e-3), (0, 4e-3)]))
    exact = stress_points(ksd.rectangle(1e-3, 4e-3))
    for name in ("along_y", "along_z"):
        assert np.abs(getattr(drawn, name)).max() == pytest.approx(
            np.abs(getattr(exact, name)).max(), rel=1e-9
        )
    assert np.abs(exact.torsion).max() < np.abs(drawn.torsion).max() < 1.25 * np.abs(exact.torsion).max()
