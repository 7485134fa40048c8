"""Models of many designs in one call are those of the same designs one by one; equal words make one template."""

import numpy as np
import pytest
from hard_scenes import STEEL

import ksd
from ksd.joints.joints import joint_bodies, joint_bodies_of_design, joint_layout
from ksd.model.arrays import Arrays
from ksd.model.compile import compile_as_is
from ksd.model.scene_layout import split_scene
from ksd.model.template import Template, state_of_design, template_of
from ksd.units import deg, mm

DENSE = ksd.Material(E=200e9, G=76.9e9, density=7800, expansion=1.2e-5)


def _fourbar(rng, material=STEEL):
    sizes = {"length": rng.uniform(0.09, 0.11), "thickness": rng.uniform(5e-4, 1e-3)}
    joint = ksd.CrossFlexure(material, angle=45 * deg, widths=(40 * mm, 20 * mm), **sizes)
    scene, high = ksd.Mechanism("fourbar"), rng.uniform(0.25, 0.35)
    left, top, right = scene.links("left", "top", "right")
    scene.join(scene.ground, left, joint, at=(-0.2, 0, 0), axis="z", toward="y", name="lower left")
    scene.join(left, top, joint, at=(-0.2, high, 0), axis="z", toward="y")
    scene.join(right, top, joint, at=(0.2, high, 0), axis="z", toward="y")
    scene.join(scene.ground, right, joint, at=(0.2, 0, 0), axis="z", toward="y")
    scene.actuate(top, along="x", at=(0, high + joint.length_AB, 0))
    return scene


def _arm(rng):
    hinge = ksd.TripleInfinityHinge(STEEL, thickness=rng.uniform(4e-4, 5e-4), length=rng.uniform(0.05, 0.07))
    scene = ksd.Mechanism("arm")
    first, second = scene.links("first", "second")
    scene.actuate_joint(scene.join(scene.ground, first, hinge, at=(0, 0, 0), axis="z", toward="x"))
    scene.actuate_joint(scene.join(first, second, hinge, at=(0.15, 0, 0.05), axis="y", toward=(1, 0, 1)))
    return scene


def _leaves(rng):
    """A stage on two free leaf springs, tied to a hinge by a spring."""
    L, t = rng.uniform(0.05, 0.07), rng.uniform(3e-4, 5e-4)
    scene = ksd.Mechanism("leaves")
    stage, arm = scene.links("stage", "arm")
    for x in (0.0, 0.04):
        scene.leaf(
            scene.ground, stage, start=(x, 0, 0), end=(x, L, 0), width_axis="z", material=STEEL,
            section=ksd.rectangle(t, 15 * mm),
        )  # fmt: skip
    joint = ksd.CrossedPivot(STEEL, length=40 * mm, angle=45 * deg, thickness=t, width=10 * mm)
    scene.actuate_joint(
        scene.join(scene.ground, arm, joint, at=(0.1, 0, 0), axis="z", toward="y"), name="turn"
    )
    scene.spring(stage, arm, start=(0.04, L, 0), end=(0.1, L, 0), stiffness=rng.uniform(50, 100))
    scene.load(stage, force=(rng.uniform(0, 1), 0, 0), at=(0, L, 0))
    return scene


def _heavy(rng):
    scene = _fourbar(rng, DENSE)
    scene.gravity = (0, -rng.uniform(5, 9.81), 0)
    scene.mass("top", mass=rng.uniform(0.5, 1), at=(0, 0.3, 0))
    return scene


def _warm(rng):
    scene = _heavy(rng)
    scene.heat(rng.uniform(5, 10), leaves=["lower left/inner"])
    return scene


def _notch(rng):
    joint = ksd.CircularNotchHinge(
        STEEL, radius=rng.uniform(4, 5) * mm, minimum=rng.uniform(0.4, 0.5) * mm, width=8 * mm
    )
    scene = ksd.Mechanism("notch")
    arm = scene.link("arm")
    scene.actuate_joint(scene.join(scene.ground, arm, joint, at=(0, 0, 0), axis="z", toward="x"), name="turn")
    return scene


SCENES = {
    "fourbar": _fourbar,
    "arm": _arm,
    "leaves": _leaves,
    "heavy": _heavy,
    "warm": _warm,
    "notch": _notch,
}
MESHES = {
    "strain": ksd.Mesh(),
    "finer": ksd.Mesh().refined(),
    "chains": ksd.Mesh("corotational", elements=2),
    "long chains": ksd.Mesh("corotational", elements=7),
    "nodal": ksd.Mesh("corotational", elements=3, nodal=True),
}


def _arrays(part):
    if isinstance(part, Arrays):
        part = part.ints, part.size, part.members, part.terms, part.loads, part.springs, part.weight
    if isinstance(part, tuple):
        return [a for field in part for a in _arrays(field)]
    return [np.asarray(part)]


def _same(one, other):
    for a, b in zip(_arrays(one), _arrays(other), strict=True):
        assert a.shape == b.shape and a.dtype == b.dtype
        np.testing.assert_allclose(b, a, rtol=1e-14, atol=1e-15 * np.abs(a).max(initial=1e-300))


def _drawings(name, mesh, rng, count):
    scenes = [SCENES[name](rng).scene() for _ in range(count)]
    return scenes, [split_scene(scene, mesh) for scene in scenes]


@pytest.mark.parametrize("mesh", MESHES)
@pytest.mark.parametrize("name", SCENES)
def test_designs_in_one_call_are_those_made_one_by_one(name, mesh, rng):
    if mesh == "nodal" and name in ("notch", "warm"):
        pytest.skip("nodal meshes are for straight uniform leaf springs without heat")
    mesh = MESHES[mesh]
    scenes, drawings = _drawings(name, mesh, rng, 5)
    assert len({d.layout for d in drawings}) == 1
    template = template_of(drawings[0].layout, mesh)
    numbers = template.numbers([d.numbers for d in drawings])
    filled = template(numbers)
    for d, scene in enumerate(scenes):
        model = compile_as_is(scene, mesh)
        several = filled.arrays.design(d), state_of_design(filled.rest, d)
        _same((model.arrays, model.rest), several)
    if mesh.nodal or not drawings[0].joints:
        return
    layout = joint_layout(template, drawings[0].joints, ksd.find_record)
    shapes = [[d.joints[u].shape() for d in drawings] for u in range(len(drawings[0].joints))]
    bodies = layout(numbers, filled, shapes, extrapolate=True)
    for d, scene in enumerate(scenes):
        alone = joint_bodies(compile_as_is(scene, mesh), ksd.find_record, extrapolate=True)
        several = joint_bodies_of_design(layout, bodies, d)
        for field in (
            "kinematics",
            "interior",
            "substructures",
            "substructure_rest",
            "reduced",
            "reduced_rest",
            "joint_weights",
            "motion_scale",
        ):
            _same(getattr(alone, field), getattr(several, field))


def test_numbers_make_no_new_template_and_words_do(rng):
    mesh = ksd.Mesh()
    _, (one, two) = _drawings("arm", mesh, rng, 2)
    assert template_of(one.layout, mesh) is template_of(two.layout, mesh)
    scene = _arm(rng)
    scene.load("second", force=(1, 0, 0), at=(0.3, 0, 0.1))
    other = split_scene(scene.scene(), mesh)
    assert isinstance(template_of(other.layout, mesh), Template)
    assert template_of(other.layout, mesh) is not template_of(one.layout, mesh)


def test_one_of_several_equal_joints_changes_without_another_template():
    def layout(*thicknesses):
        scene = ksd.Mechanism("line")
        links = [scene.ground, *scene.links("one", "two")]
        for k, thickness in enumerate(thicknesses):
            joint = ksd.CrossedPivot(STEEL, length=0.06, angle=0.7, thickness=thickness, width=0.02)
            scene.join(links[k], links[k + 1], joint, at=(0.1 * k, 0, 0), axis="z", toward="x")
        return split_scene(scene.scene(), ksd.Mesh()).layout

    assert layout(4e-4, 4e-4) == layout(4e-4, 5e-4)


def test_leaves_drawn_alike_share_their_constants_at_every_scale(rng):
    for _ in range(20):
        members = compile_as_is(_arm(rng).scene(), ksd.Mesh()).arrays.members
        assert len(np.unique(members.value_at)) == 4


def test_a_chain_is_laid_out_once_for_all_its_lengths(monkeypatch):
    made = []
    original = Template.__init__
    monkeypatch.setattr(
        Template, "__init__", lambda self, *said: (made.append(said), original(self, *said))[1]
    )
    for thickness in (0.41, 0.43, 0.47):
        joint = ksd.CrossedPivot(STEEL, length=0.061, angle=0.7, thickness=thickness * mm, width=0.02)
        scene = ksd.Mechanism("of its own")
        link = scene.link("alone")
        scene.actuate_joint(
            scene.join(scene.ground, link, joint, at=(0, 0, 0), axis="z", toward="x"), name="it"
        )
        ksd.prepare(scene)
    assert len(made) == 1
