"""Centrelines against known curves, ends against clamps, both leaf models, nodal meshes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import ksd
from ksd.answers.centrelines import (
    centrelines,
    curvature,
    member_arrays,
    member_ends,
    poses_along,
    strain_curves,
)
from ksd.answers.leaf_groups import chain_groups, leaf_groups
from ksd.answers.shape import mechanism_shape
from ksd.model.compile import compile_scene
from ksd.model.mesh import Mesh
from ksd.solvers.conventional import solve_conventional
from ksd.units import GPa, mm

MESHES = [Mesh(), Mesh(leaf="corotational", elements=6), Mesh(leaf="corotational", elements=6, nodal=True)]
IDS = ["strain", "chain", "nodal"]
LENGTH, TURN = 0.1, 0.9
STEEL = ksd.Material(E=200 * GPa, nu=0.3)
BLADE = {
    "start": (0, 0, 0), "end": (LENGTH, 0, 0), "width_axis": "z", "name": "blade", "material": STEEL,
    "section": ksd.rectangle(0.5 * mm, 20 * mm),
}  # fmt: skip


def bent_leaf(mesh, *, turn=TURN):
    """One leaf from ground to a link turned by `turn` about z: pure bending, so a circular arc."""
    scene = ksd.Mechanism("leaf")
    tip = scene.link("tip")
    scene.leaf(scene.ground, tip, **BLADE)
    scene.actuate(tip, about="z", name="turn")
    return solve_conventional(compile_scene(scene, mesh=mesh), {"turn": turn}, steps=3)


@pytest.mark.parametrize("mesh", MESHES, ids=IDS)
def test_pure_bending_is_a_circular_arc(mesh):
    c = bent_leaf(mesh)
    (leaf,) = mechanism_shape(c.model, c.motion, points=25).leaves
    radius = LENGTH / TURN
    distance = np.linalg.norm(leaf.place - [0, radius, 0], axis=1)
    # the chords of a chain lie inside the arc by h^2/(8 R) at most; the cubics take most of that back
    assert distance == pytest.approx(radius, rel=1e-8 if mesh.leaf == "strain" else 2e-3)
    angle = TURN * leaf.s / LENGTH
    assert leaf.axes[:, :, 0] == pytest.approx(
        np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1), abs=2e-3
    )


@pytest.mark.parametrize("mesh", MESHES, ids=IDS)
def test_leaf_meets_its_clamps_and_is_straight_at_rest(mesh):
    c = bent_leaf(mesh)
    shape = mechanism_shape(c.model, c.motion, points=12)
    (leaf,) = shape.leaves
    blocks = {b.name: b for b in shape.blocks}
    assert leaf.name == "blade" and len(leaf.s) >= 12
    assert leaf.place[0] == pytest.approx(blocks["ground"].place[0], abs=1e-15)
    assert leaf.place[-1] == pytest.approx(blocks["tip"].place[0], abs=1e-12)
    assert leaf.rest == pytest.approx(np.outer(leaf.s, [1, 0, 0]), abs=1e-15)
    for axes in (leaf.axes, leaf.rest_axes):
        assert np.einsum("kji,kjl->kil", axes, axes) == pytest.approx(
            np.tile(np.eye(3), (len(axes), 1, 1)), abs=1e-12
        )
    assert leaf.width == pytest.approx(0.02) and leaf.thickness == pytest.approx(0.0005)
    tip = blocks["tip"]
    assert tip.place == pytest.approx(tip.position + tip.rest @ tip.rotation.T, abs=1e-15)
    assert Rotation.from_matrix(tip.rotation).as_rotvec() == pytest.approx([0, 0, TURN])


def test_both_leaf_models_draw_the_same_curve():
    curves = []
    for mesh in (Mesh(), Mesh(leaf="corotational", elements=12)):
        c = bent_leaf(mesh, turn=0.6)
        (leaf,) = mechanism_shape(c.model, c.motion, points=25).leaves
        curves.append(leaf.place)
    assert curves[0] == pytest.approx(curves[1], abs=2e-4 * LENGTH)


def test_twist_turns_the_width_axis_evenly():
    scene = ksd.Mechanism("twist")
    tip = scene.link("tip")
    scene.leaf(scene.ground, tip, **BLADE)
    scene.actuate(tip, about="x", name="turn")
    c = solve_conventional(compile_scene(scene), {"turn": 0.8})
    (leaf,) = mechanism_shape(c.model, c.motion).leaves
    angle = 0.8 * leaf.s / LENGTH
    assert leaf.axes[:, :, 2] == pytest.approx(
        np.stack([0 * angle, -np.sin(angle), np.cos(angle)], axis=1), abs=1e-8
    )


def test_driven_point_moves_as_prescribed():
    scene = ksd.Mechanism("guide")
    table = scene.link("table")
    steel = ksd.Material(E=200 * GPa, nu=0.3)
    for y in (-0.03, 0.03):
        scene.leaf(scene.ground, table, start=(0, y, 0), end=(LENGTH, y, 0), width_axis="z",
                   section=ksd.rectangle(0.5 * mm, 20 * mm), material=steel)  # fmt: skip
    scene.actuate(table, along="y", at=(LENGTH, 0, 0), name="stroke")
    c = solve_conventional(compile_scene(scene), {"stroke": 0.01})
    shape = mechanism_shape(c.model, c.motion)
    (driven,) = shape.driven
    assert driven.place[1] - driven.rest[1] == pytest.approx(0.01, abs=1e-12)
    assert [leaf.name for leaf in shape.leaves] == ["leaf", "leaf.2"]


@pytest.mark.parametrize("mesh", MESHES[:2], ids=IDS[:2])
def test_a_curved_leaf_is_drawn_curved_at_rest(mesh):
    arc = ksd.Arc(radius=0.05, angle=1.2)
    scene = ksd.Mechanism("arc")
    tip = scene.link("tip")
    scene.leaf(scene.ground, tip, curve=arc, **{**BLADE, "end": (arc.chord, 0, 0)})
    scene.actuate(tip, about="z", name="turn")
    c = solve_conventional(compile_scene(scene, mesh=mesh), {"turn": 0.1})
    (leaf,) = mechanism_shape(c.model, c.motion).leaves
    centre = np.array([0.5 * arc.chord, 0.05 * np.cos(0.6), 0])
    assert np.linalg.norm(leaf.rest - centre, axis=1) == pytest.approx(
        0.05, rel=1e-7 if mesh.leaf == "strain" else 1e-3
    )
    assert leaf.rest[-1] == pytest.approx([arc.chord, 0, 0], abs=1e-9)


def test_a_tapered_leaf_meets_its_clamp_and_shows_its_width():
    taper = ksd.Taper(thickness=(0.5 * mm, 0.3 * mm), width=(20 * mm, 10 * mm))
    scene = ksd.Mechanism("taper")
    tip = scene.link("tip")
    scene.leaf(scene.ground, tip, profile=taper, **{**BLADE, "section": ksd.rectangle(0.4 * mm, 15 * mm)})
    scene.actuate(tip, about="z", name="turn")
    c = solve_conventional(compile_scene(scene), {"turn": 0.5})
    value, number, inner = member_arrays(c.model, c.motion, 0)
    _, (r,), (R,) = strain_curves(value[None], number, inner[None], 25)
    ends = member_ends(c.model, c.motion, 0)
    assert r[-1] == pytest.approx(ends.d, abs=1e-6 * LENGTH) and R[-1] == pytest.approx(ends.Q, abs=1e-5)
    (leaf,) = mechanism_shape(c.model, c.motion).leaves
    assert leaf.width == pytest.approx(0.02 - 0.01 * leaf.s / LENGTH)
    # the moment is constant, so the curvature follows the compliance
    kappa = curvature(value, number, inner, np.array([0.1, 0.9]))[:, 2]
    stiff = [taper.section(x).Iz for x in (0.1, 0.9)]
    assert kappa[0] / kappa[1] == pytest.approx(stiff[1] / stiff[0], rel=1e-4)


@pytest.mark.parametrize("mesh", MESHES[:2], ids=IDS[:2])
def test_places_along_leaf_springs_are_those_of_their_lines(mesh):
    scene = ksd.Mechanism("two leaf springs")
    tip = scene.link("tip")
    scene.leaf(scene.ground, tip, **BLADE)
    scene.leaf(scene.ground, tip, **{**BLADE, "start": (0, 0.02, 0), "name": "oblique"})
    scene.actuate(tip, about="z", name="turn")
    scene.load(tip, force=(0, 0, 2.0), at=(LENGTH, 0, 0))
    pose = ksd.solve(scene, turn=0.5, mesh=mesh)
    (group,) = (leaf_groups if mesh.leaf == "strain" else chain_groups)(pose.model)
    which, share = np.array([0, 1, 1]), np.array([0.25, 0.5, 0.7])
    place, axes = poses_along(pose.model, pose.motion, group, which, share, 200, 1.0)
    lines = centrelines(pose.model, pose.motion, group, slice(None), 2401, 1.0)
    for i, x, r, R in zip(which, share, place, axes, strict=True):
        s, line, turns = (along[i] for along in lines)
        k = int(np.argmin(np.abs(s - x * s[-1])))
        assert s[k] == pytest.approx(x * s[-1], rel=1e-9)
        assert r == pytest.approx(line[k], abs=1e-5 * LENGTH)
        assert turns[k] == pytest.approx(R, abs=1e-5)


@pytest.mark.parametrize("following", [False, True])
def test_elements_of_a_leaf_are_not_taken_for_a_second_one(following):
    """Two leaves without a name are "leaf" and "leaf.2", as the second element of the first once was: their stresses, forces
    and modes are the same with the nodes of the elements in the open as condensed."""
    scene, steel = ksd.Mechanism("row"), ksd.Material(E=200 * GPa, nu=0.3, density=7850.0)
    middle, tip = scene.links("middle", "tip")
    for a, b, x in ((scene.ground, middle, 0.0), (middle, tip, 0.1)):
        scene.leaf(
            a, b, start=(x, 0, 0), end=(x + 0.1, 0, 0), section=ksd.rectangle(1e-3, 0.02), material=steel
        )
    scene.load(tip, force=(0, 0.5, 0), at=(0.2, 0, 0), following=following)
    poses = [
        ksd.solve(scene, mesh=ksd.Mesh("corotational", elements=3, nodal=nodal)) for nodal in (False, True)
    ]
    assert [leaf.name for leaf in poses[1].shape().leaves] == ["leaf", "leaf.2"]
    one, other = (pose.strain_energy() for pose in poses)
    assert other == pytest.approx(one, rel=1e-6) and one["leaf"] > 2 * one["leaf.2"]
    one, other = (pose.frequencies(count=3).frequency_Hz for pose in poses)
    assert other == pytest.approx(one, rel=1e-6)


@pytest.mark.parametrize("following", [False, True])
def test_loads_are_drawn_as_they_act(following):
    scene = ksd.Mechanism("leaf")
    tip = scene.link("tip")
    scene.leaf(scene.ground, tip, **BLADE)
    scene.actuate(tip, about="z", name="turn")
    scene.load(tip, force=(0, 0.2, 0), at=(LENGTH, 0, 0), following=following)
    pose = ksd.solve(scene, turn=TURN)
    (load,) = pose.shape().loads
    angle = TURN if following else 0.0
    assert load.value == pytest.approx([-0.2 * np.sin(angle), 0.2 * np.cos(angle), 0], abs=1e-9)
    assert load.place == pytest.approx(np.array([LENGTH, 0, 0]) + pose.displacement("tip", (LENGTH, 0, 0)))


def test_leaves_drawn_together_are_those_drawn_alone():
    """Of one scene with leaves of two groups, one of them in two members."""
    scene = ksd.Mechanism("row")
    middle, tip = scene.links("middle", "tip")
    whole = scene.leaf(scene.ground, middle, **BLADE)
    scene.leaf(scene.ground, middle, **{**BLADE, "start": (0, 0.02, 0), "name": "other"})
    arc = ksd.Arc(radius=0.05, angle=1.2)
    end = (LENGTH + arc.chord, 0, 0)
    scene.leaf(middle, tip, curve=arc, **{**BLADE, "start": (LENGTH, 0, 0), "end": end, "name": "arc"})
    scene.point(whole, s=0.4 * LENGTH)
    scene.actuate(tip, along="y", at=end, name="push")
    pose = ksd.solve(scene, push=0.02)
    for leaf in pose.shape(points=17).leaves:
        own = [i for i, n in enumerate(pose.model.member_names) if n.startswith(leaf.name)]
        lines = []
        for group in leaf_groups(pose.model):
            for k in np.flatnonzero(np.isin(group.members, own)):
                points = 17 if len(own) == 1 else 9
                lines.append(centrelines(pose.model, pose.motion, group, np.array([k]), points, 1.0)[1][0])
        assert np.array_equal(leaf.place, np.concatenate([lines[0], *(line[1:] for line in lines[1:])]))
        assert np.ptp(np.diff(leaf.s)) < 0.3 * leaf.s[-1] / 8


def test_a_soft_leaf_spring_is_drawn_stretched_by_its_weight():
    """Hanging: u = rho g (L s - s^2 / 2) / E; it was drawn stretched evenly. A cable under its weight is drawn alike on both
    sides, and verified, which starts from that shape."""
    rubber = ksd.Material(E=1e5, nu=0.5, density=1000)
    scene = ksd.Mechanism("hanging", plane="xy")
    scene.gravity = (0, -9.81, 0)
    scene.leaf(
        "ground",
        scene.link("end"),
        start=(0, 0, 0),
        end=(0, -1, 0),
        section=ksd.rectangle(0.02, 0.02),
        material=rubber,
    )
    (leaf,) = ksd.solve(scene).shape().leaves
    assert leaf.place[:, 1] == pytest.approx(-leaf.s - 1000 * 9.81 / 1e5 * (leaf.s - leaf.s**2 / 2), abs=1e-9)
    scene = ksd.Mechanism("cable", plane="xz")
    scene.gravity = (0, 0, -9.81)
    end = scene.link("end")
    section = ksd.circle(10 * mm)
    scene.leaf("ground", end, start=(0, 0, 0), end=(1, 0, 0), section=section, material=rubber)
    scene.actuate(end, along="x", at=(1, 0, 0), name="in")
    scene.support(end, along="z", at=(1, 0, 0))
    scene.support(end, about="y")
    pose = ksd.solve(scene, {"in": -0.1})
    (leaf,) = pose.shape().leaves
    assert leaf.place[:, 2] == pytest.approx(leaf.place[::-1, 2], abs=1e-4)
    assert pose.verify().relative < 1e-2
