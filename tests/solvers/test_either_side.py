"""Symmetric states are refused with what to do, and a side of them is taken."""

from dataclasses import replace

import numpy as np
import pytest
from hard_scenes import bow
from scenes import STEEL
from scipy.spatial.transform import Rotation

import ksd
from ksd.cli import main
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.either_side import nearby_minimum, take_side
from ksd.solvers.loading_order import _down_the_energy
from ksd.solvers.undeformed_stability import unstable_shape
from ksd.units import mm


def beam(*, pushed):
    """A clamped beam in two leaf springs, its end driven in; its middle, where pushed, driven across."""
    scene = ksd.Mechanism("pressed beam", plane="xy")
    middle, end = scene.links("middle", "end")
    for a, b, x in (("ground", middle, 0.0), (middle, end, 0.1)):
        scene.leaf(a, b, start=(x, 0, 0), end=(x + 0.1, 0, 0), section=ksd.rectangle(0.5 * mm, 10 * mm),
                   material=STEEL, width_axis="z")  # fmt: skip
    scene.actuate(end, along="x", at=(0.2, 0, 0), name="press")
    scene.support(end, along="y", at=(0.2, 0, 0))
    scene.support(end, about="z")
    if pushed:
        scene.actuate(middle, along="y", at=(0.1, 0, 0), name="push")
    return scene


def refusal(scene, **drives):
    with pytest.raises(ksd.TrustError) as refused:
        ksd.solve(scene, **drives)
    return str(refused.value)


def test_a_pressed_beam_goes_to_the_side_that_is_asked_for():
    """Its middle goes out by the clamped Euler mode: rise^2 = (2 / pi)^2 L times the stroke beyond the critical one."""
    said = refusal(beam(pushed=False), press=-0.1 * mm)
    assert "where it is symmetric, a small push picks the side: ksd.solve(..., side=1) or side=-1" in said
    high, low = (ksd.solve(beam(pushed=False), press=-0.1 * mm, side=side) for side in (1, -1))
    for pose, sign in ((high, 1), (low, -1)):
        assert pose.trusted and pose.stable
        critical = 4 * np.pi**2 / 12 * (0.5 * mm) ** 2 / 0.2
        rise = 2 / np.pi * np.sqrt(0.2 * (0.1 * mm - critical))
        assert pose.displacement("middle")[1] == pytest.approx(sign * rise, rel=2e-3)
        assert any(f"on the side {sign:+d} of one that is unstable" in note for note in pose.notes)


def test_a_precompressed_beam_pushed_exactly_in_its_middle():
    """It turns over to either side; what the push needs is the same. A push beside its middle is the judge."""
    drives = {"press": -0.1 * mm, "push": 0.5 * mm}
    assert "a small push picks the side" in refusal(beam(pushed=True), **drives)
    one, other = (ksd.solve(beam(pushed=True), drives, side=side) for side in (1, -1))
    turned = [Rotation.from_matrix(p.motion.R[1]).as_rotvec()[2] for p in (one, other)]
    assert turned[0] == pytest.approx(-turned[1], rel=1e-6) and turned[0] > 0.01
    assert one.forces["push"] == pytest.approx(other.forces["push"], rel=1e-6)
    seeded = beam(pushed=True)
    seeded.load("middle", moment=(0, 0, 1e-5))
    path = ksd.follow(seeded, drives, control="drives")
    assert path.states[-1].stable
    assert path.states[-1].forces["push"] == pytest.approx(one.forces["push"], rel=1e-3)


def test_downhill_from_the_unstable_state_is_where_its_branch_ends():
    """The second way, which needs no bifurcation on the way from rest."""
    scene = beam(pushed=False)
    still = ksd.solve(scene, press=-0.1 * mm, strict=False)
    _, shape = unstable_shape(still.model, still.motion, 1.0)
    state, _ = nearby_minimum(still.model, still, shape)
    branch = [ksd.solve(scene, press=-0.1 * mm, side=side).motion.x for side in (1, -1)]
    assert min(np.abs(state.x - x).max() for x in branch) < 1e-8
    # what is stable already is left as it is
    stable = ksd.solve(scene, press=-1e-7)
    assert take_side(stable, 1.0) is stable


def test_a_state_unstable_within_a_leaf_spring_has_no_side():
    scene = ksd.Mechanism("column", plane="xy")
    end = scene.link("end")
    scene.leaf("ground", end, start=(0, 0, 0), end=(0.1, 0, 0), section=ksd.rectangle(0.5 * mm, 10 * mm),
               material=STEEL, width_axis="z")  # fmt: skip
    scene.actuate(end, along="x", at=(0.1, 0, 0), name="press")
    scene.support(end, along="y", at=(0.1, 0, 0))
    scene.support(end, about="z")
    with pytest.raises(ksd.ConvergenceError, match="draw a point on them"):
        ksd.solve(scene, press=-0.1 * mm, side=1)


def test_the_side_in_files_and_on_the_command_line(tmp_path, capsys):
    file = tmp_path / "beam.toml"
    ksd.save_scene(beam(pushed=False), file)
    assert main(["solve", str(file), "--set", "press=-0.1 mm", "--side", "1", "--json", "-"]) == 0
    assert "on the side +1" in capsys.readouterr().out
    file.write_text("options.side = -1\n" + file.read_text())
    assert main(["solve", str(file), "--set", "press=-0.1 mm", "--json", "-"]) == 0
    assert "on the side -1" in capsys.readouterr().out
    assert main(["report", str(file), "--out", str(tmp_path / "page.html")]) == 2
    assert "only ksd solve takes a side" in capsys.readouterr().err


@pytest.mark.parametrize("seed", [0, 1, 9, 16])
def test_a_bow_is_braced(seed):
    """Limbs drawn straight and a string too short by 2 to 9 %: refused as unstable, or without equilibrium at all. Both
    limbs bend alike, on a fine mesh too."""
    rng = np.random.default_rng(seed)
    length, thickness, short = rng.uniform(0.4, 0.7), rng.uniform(4, 8) * mm, rng.uniform(0.02, 0.09)
    scene = ksd.Mechanism("bow", plane="xy")
    up, down = scene.links("up", "down")
    glass, string = ksd.Material(E=40e9, nu=0.3), ksd.Material(E=10e9, nu=0.3)
    tips = {link: (-0.01, sign * (0.1 + length), 0) for link, sign in ((up, 1), (down, -1))}
    for link, tip in tips.items():
        scene.leaf("ground", link, start=(0, np.sign(tip[1]) * 0.1, 0), end=tip,
                   section=ksd.rectangle(thickness, 30 * mm), material=glass, width_axis="z")  # fmt: skip
    scene.leaf(down, up, start=tips[down], end=tips[up], section=ksd.rectangle(2 * mm, 2 * mm), material=string,
               width_axis="z", name="string")  # fmt: skip
    scene.fit("string", natural_length=(1 - short) * 2 * (0.1 + length))
    pose = ksd.solve(scene)
    assert pose.stable and pose.negatives == pose.expected_negatives
    high, low = pose.displacement("up"), pose.displacement("down")
    assert high[0] == pytest.approx(low[0], abs=1e-6 * length) and high[1] == pytest.approx(
        -low[1], abs=1e-6 * length
    )
    assert abs(high[0]) > 0.05 * length
    # either side of the straight one may be taken, as far out within .6 %
    fine = ksd.solve(scene, mesh=ksd.Mesh(orders=(8, 4, 12), points=20))
    assert abs(fine.displacement("up")[0]) == pytest.approx(abs(high[0]), rel=1e-2)


def test_a_bow_whose_draw_snaps_on_its_way_is_found_beyond():
    """Its limbs, of unequal length, give way one after the other; load steps from the braced pose stop there."""
    scene, drives = bow(np.random.default_rng(6))
    pose = ksd.solve(scene, drives, mesh=ksd.Mesh(orders=(4, 3, 14), points=17))
    assert pose.stable and pose.negatives == pose.expected_negatives
    assert "past a limit point at 32" in pose.notes[0] and "snaps or buckles" in pose.notes[0]
    # by the way in sixty steps of benchmarks/bows.py, on a mesh of its own
    assert pose.displacement("up")[:2] == pytest.approx([0.24882, -0.07027], abs=2e-3)
    assert pose.forces["draw"] == pytest.approx(-66.14, rel=1e-2)


def test_a_bow_that_does_not_go_down_the_energy_at_once_is_braced_in_steps():
    """Its string buckles on the way down. The minimum is that of a string made shorter bit by bit."""
    scene, drives = bow(np.random.default_rng(4))
    model, still = ksd.compile_scene(scene), dict.fromkeys(drives, 0.0)
    rest = solve_conventional(ksd.compile_scene(bow(np.random.default_rng(4), share=0.0)[0]), still)
    rest = replace(rest, model=model)
    assert nearby_minimum(model, rest, np.zeros((len(model.node_names), 6)))[0] is None
    found, _ = _down_the_energy(model, rest)
    way = rest
    for k in range(1, 31):
        own = ksd.compile_scene(bow(np.random.default_rng(4), share=k / 30)[0])
        way = solve_conventional(own, still, start=replace(way, model=own))
    assert way.stable
    assert found.x == pytest.approx(way.motion.x, abs=1e-6 * model.arrays.size)
