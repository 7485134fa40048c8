"""Every effect: rigid motions leave it alone, its tangent is exact, it vanishes with its parameter, and plane and space
agree. Sources of closed forms stand beside them."""

from dataclasses import replace

import numpy as np
import pytest
from effect_scenes import free_beam
from scenes import fourbar
from scipy.spatial.transform import Rotation

import ksd
from ksd.answers.tangent import assemble_and_factor
from ksd.model.arrays import make_workspace
from ksd.model.chosen_effects import EFFECT_MEANINGS
from ksd.model.compile import compile_as_is, compile_scene
from ksd.model.newton import assemble
from ksd.solvers.conventional import solve_conventional

HOT = ksd.Material(E=200e9, G=76.9e9, density=7800, expansion=12e-6, name="hot steel")
BLADE = ksd.rectangle(0.5e-3, 20e-3)
TURNED = Rotation.from_rotvec([0.4, -1.1, 0.7])


def hinge(effect, amount=1.0, *, turned=None, wide=1.0):
    """Two crossed leaves that are not in one plane, a link held in all six directions, and one effect of size `amount`."""
    spin = turned or Rotation.identity()
    shift = np.zeros(3) if turned is None else np.array([0.3, -0.2, 0.5])

    def at(*p):
        return tuple(shift + spin.apply(np.array(p, float)))

    def along(*v):
        return tuple(spin.apply(np.array(v, float)))

    scene = ksd.Mechanism(effect or "plain")
    tip = scene.link("tip")
    stiff = HOT if effect != "shear" else ksd.Material(E=200e9, G=76.9e9 / amount, density=7800)
    words = {"section": ksd.rectangle(0.5e-3, 20e-3 * wide), "material": stiff}
    width = along(0, 0, 1)
    scene.leaf("ground", tip, start=at(0, 0, 0), end=at(0.07, 0.07, 0), width_axis=width, name="one", **words)
    scene.leaf(
        "ground", tip, start=at(0, 0.07, 0.03), end=at(0.07, 0, 0.03), width_axis=width, name="two", **words
    )
    for name, axis in zip("xyz", np.eye(3), strict=True):
        scene.actuate(tip, along=along(*axis), at=at(0.035, 0.035, 0.015), name=name)
    for name, axis in zip(("a", "b", "c"), np.eye(3), strict=True):
        scene.actuate(tip, about=along(*axis), name=name)
    say(scene, effect, amount, at, along)
    return scene


def say(scene, effect, amount, at, along):
    """The sentence that brings the effect, of size `amount`."""
    if effect == "gravity":
        scene.mass("tip", mass=2.0, at=at(0.1, 0.05, 0.02))
        scene.gravity = along(0, -9.81 * amount, 3.0 * amount)
    elif effect == "following":
        scene.load("tip", force=along(0, 5 * amount, 2 * amount), at=at(0.1, 0.05, 0.02), following=True)
    elif effect == "springs":
        scene.spring(
            "ground",
            "tip",
            start=at(-0.05, 0.1, 0.02),
            end=at(0.1, 0.05, 0),
            stiffness=900 * amount,
            free_length=0.07,
        )
        scene.spring(
            "ground",
            "tip",
            start=at(0, 0.1, 0.02),
            end=at(0.1, 0.07, 0),
            stiffness=500 * amount,
            free_length=0,
        )
        scene.turn_spring(
            "ground", "tip", at=at(0, 0, 0), axis=along(0, 0.3, 1), stiffness=3 * amount, rest_angle=0.2
        )
    elif effect == "heat":
        scene.heat(-20 * amount, through=5 * amount)
    elif effect == "fit":
        scene.fit("one", natural_length=np.hypot(0.07, 0.07) * (1 - 2e-5 * amount))
        scene.fit(
            "two", shift=(1e-5 * amount, 2e-4 * amount, 3e-5 * amount), turn=(1e-3 * amount, 0, 2e-3 * amount)
        )
    elif effect == "compliance":
        soft = ksd.Material(E=200e9 / amount, G=76.9e9 / amount)
        section = ksd.rectangle(4e-3, 9e-3)
        scene.compliance(
            "tip", section=section, material=soft, hub=at(0.1, 0.035, 0.01), width_axis=along(0, 0, 1)
        )
    elif effect == "matrix":
        points = (at(0.07, 0.07, 0), at(0.07, 0, 0.03))
        scene.compliance(
            "tip", matrix=ksd.LinkMatrix(points, free_beam(points, amount)), width_axis=along(0, 0, 1)
        )


EFFECTS = ("shear", "gravity", "following", "springs", "heat", "fit", "compliance", "matrix")
AIM = {"x": 1e-5, "y": 1e-5, "z": 3e-5, "a": 2e-4, "b": -1e-4, "c": 0.15}


def forces(scene, aim=AIM, *, mesh=None, **options):
    model = ksd.compile_scene(scene, mesh=mesh, **options)
    found = solve_conventional(model, aim, rtol=1e-11)
    return np.array([found.forces[name] for name in "xyzabc"]), found


def with_word(effect):
    return "compliance" if effect == "matrix" else effect


@pytest.mark.parametrize("effect", [*EFFECTS, "warping", "plate"])
def test_rigid_motions_change_nothing(effect):
    words = {"effects": "all"} if effect in ("warping", "plate") else {}
    here, _ = forces(hinge(effect), **words)
    there, _ = forces(hinge(effect, turned=TURNED), **words)
    # the gap a drive may leave, 1e-11 of the size, is worth 1e-7 of the force in the stiff directions
    assert there == pytest.approx(here, rel=1e-7, abs=1e-7 * np.abs(here).max())


@pytest.mark.parametrize("effect", EFFECTS)
def test_the_tangent_is_the_derivative_of_the_forces(effect):
    model = ksd.compile_scene(hinge(effect), with_=with_word(effect))
    at = model.arrays.terms.start
    pull = np.zeros((model.arrays.plan.unknowns, 6))
    pull[at, range(6)] = 1.0
    found = solve_conventional(model, AIM, rtol=1e-11)
    exact = -assemble_and_factor(model, found.motion).solve(pull)[at]
    columns = []
    for name in "xyzabc":
        step = 1e-6 if name in "xyz" else 1e-5
        pair = [
            solve_conventional(model, AIM | {name: AIM[name] + s * step}, rtol=1e-11).forces for s in (1, -1)
        ]
        columns.append([(pair[0][n] - pair[1][n]) / (2 * step) for n in "xyzabc"])
    measured = np.array(columns).T
    size = np.sqrt(np.abs(np.diag(measured)))
    assert np.abs((measured - exact) / np.outer(size, size)).max() < 5e-5


@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_vanishes_with_its_parameter(effect):
    name, most = with_word(effect), {}
    for amount in (1e-2, 1e-3):
        off, _ = forces(hinge(effect, amount), without=name)
        on, _ = forces(hinge(effect, amount), with_=name)
        most[amount] = np.max(np.abs(on - off) / np.abs(off).max())
    # linear in its parameter, and there at all
    assert most[1e-2] > 1e-9 and most[1e-3] < 0.2 * most[1e-2]


FLAT = {
    "gravity": lambda s: (s.mass("top", mass=3.0, at=(0.05, 0.4, 0)), setattr(s, "gravity", (3.0, -9.81, 0))),
    "following": lambda s: s.load("top", force=(3, 20, 0), at=(0.1, 0.37, 0), following=True),
    "springs": lambda s: (
        s.spring("ground", "top", start=(0, -0.1, 0), end=(0, 0.37, 0), stiffness=300.0, free_length=0.2),
        s.spring("left", "right", start=(-0.2, 0.2, 0), end=(0.2, 0.1, 0), stiffness=80.0, free_length=0.0),
        s.joint_spring("lower left", stiffness=2.0, rest_angle=0.1),
        s.joint_spring("upper right", stiffness=1.0),
    ),
    "heat": lambda s: s.heat(30.0, through=4.0),
    "fit": lambda s: s.fit("lower left/inner", natural_length=0.09999, turn=(0, 0, 2e-3)),
    "compliance": lambda s: s.compliance("top", section=ksd.rectangle(10e-3, 30e-3), material=HOT),
    "plate": lambda s: s.consider("plate"),
    "shear": lambda s: None,
}


@pytest.mark.parametrize("effect", FLAT)
def test_plane_and_space_agree(effect):
    joint = ksd.CrossFlexure(HOT, length=0.1, angle=np.pi / 4, thickness=1e-3, widths=(0.04, 0.02))
    scene = fourbar(joint=joint)
    FLAT[effect](scene)
    how = {"method": "conventional", "effects": "auto", "with_": effect}
    flat = ksd.solve(scene, top=0.15, **how)
    assert "planar" in flat.steps[0].note
    space = ksd.solve(scene, top=0.15, **{**how, "with_": (effect, "spatial")})
    assert "spatial" in space.steps[0].note
    assert flat.forces["top"] == pytest.approx(space.forces["top"], rel=1e-10)
    assert np.abs(flat.motion.x - space.motion.x).max() < 1e-10 * 0.4
    without = ksd.solve(scene, top=0.15, method="conventional", without=effect)
    assert abs(without.forces["top"] / flat.forces["top"] - 1) > 1e-6


def test_a_matrix_stays_in_the_plane_too():
    scene = fourbar()
    points = ((-0.2, 0.3 + 0.1 * np.sqrt(0.5), 0), (0.2, 0.3 + 0.1 * np.sqrt(0.5), 0))
    scene.compliance("top", matrix=ksd.LinkMatrix(points, free_beam(points, 1.0)))
    flat = ksd.solve(scene, top=0.1, method="conventional", with_="compliance")
    space = ksd.solve(scene, top=0.1, method="conventional", with_=("compliance", "spatial"))
    assert "planar" in flat.steps[0].note and "spatial" in space.steps[0].note
    assert flat.forces["top"] == pytest.approx(space.forces["top"], rel=1e-10)


def test_a_spring_across_the_plane_is_seen():
    scene = fourbar()
    scene.spring("ground", "top", start=(0, 0, 0.1), end=(0, 0.37, 0), stiffness=10.0, name="slanted")
    with pytest.raises(ksd.SceneError, match=r"slanted.*out of the plane"):
        solve_conventional(ksd.compile_scene(scene), {"top": 0.1}, planar=True)


def test_every_word_is_there():
    assert set(EFFECT_MEANINGS) >= {with_word(e) for e in EFFECTS} | {"warping", "plate", "spatial"}
    given = compile_as_is(replace(fourbar().scene(), gravity=(0, -1.0, 0)), ksd.Mesh())
    assert given.choice is None and "shear: as the mesh says" in str(given)


@pytest.mark.parametrize(("away", "expected"), [(1.0, 2), (0.9, 0)])
def test_a_spring_whose_ends_meet_is_told(away, expected):
    """It has no direction there; half a decimetre apart it has one."""
    scene, start, end = fourbar(), np.array([0, -0.1, 0]), np.array([0, 0.37, 0])
    scene.spring("ground", "top", start=start, end=end, stiffness=300.0, free_length=0.2)
    model = compile_scene(scene)
    motion = model.rest.copy()
    motion.x[model.node_names.index("top")] += away * (start - end)
    worst, *_, status = assemble(
        model.arrays,
        motion,
        np.zeros(1),
        1.0,
        make_workspace(model.arrays),
        rtol=1e-10,
        linearise=0,
        rounding=10.0,
    )
    assert (status, np.isinf(worst)) == (expected, expected == 2)


def test_a_link_of_which_nothing_bends_is_refused():
    guide = ksd.ParallelGuide(HOT, length=0.08, thickness=0.4e-3, width=0.025, spacing=0.06)
    scene = ksd.Mechanism("guide")
    stage = scene.link("stage")
    placed = scene.join("ground", stage, guide, at=(0, 0, 0), axis="z", toward="y")
    scene.actuate_joint(placed, name="push")
    scene.compliance("stage", section=ksd.rectangle(6e-3, 25e-3), material=HOT)
    with pytest.raises(ksd.SceneError, match=r"'stage': nothing of it can bend.*give hub="):
        ksd.solve(scene, push=5e-3)
