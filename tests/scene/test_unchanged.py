"""An unchanged mechanism is the same value again, so that nothing of it is hashed twice; every change is seen."""

import copy
import dataclasses
import pickle

import pytest
from scenes import STEEL, cross_flexure, fourbar

import ksd
from ksd.units import mm


def heavy():
    scene = fourbar()
    scene.gravity = (0, -9.81, 0)
    return scene


CHANGES = {
    "name": lambda s: setattr(s, "name", "other"),
    "link": lambda s: s.join("top", s.link("arm"), cross_flexure(), at=(0, 0.5, 0), axis="z", toward="y"),
    "leaf": lambda s: s.wire(
        "ground", "top", start=(0, 0, 0), end=(0, 0.4, 0), diameter=1 * mm, material=STEEL, name="wire"
    ),
    "drive": lambda s: s.actuate("left", about="z", name="turn"),
    "support": lambda s: s.support("left", about="z"),
    "load": lambda s: s.load("top", force=(0, -1, 0), at=(0, 0.4, 0)),
    "mass": lambda s: s.mass("top", mass=1.0, at=(0, 0.4, 0)),
    "gravity": lambda s: setattr(s, "gravity", (0, 0, -9.81)),
    "no gravity": lambda s: setattr(s, "gravity", None),
    "spring": lambda s: s.spring("ground", "top", start=(0, 0, 0), end=(0, 0.4, 0), stiffness=10.0),
    "consider": lambda s: s.consider("plate"),
}


def test_an_unchanged_mechanism_is_the_same_scene():
    mechanism = heavy()
    scene = mechanism.scene()
    assert mechanism.scene() is scene
    assert scene == heavy().scene() and scene.fingerprint() == heavy().scene().fingerprint()
    assert pickle.loads(pickle.dumps(scene)).fingerprint() == scene.fingerprint()
    assert copy.deepcopy(mechanism).scene() == scene
    assert dataclasses.replace(scene, name="other").fingerprint() != scene.fingerprint()


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_every_change_is_another_scene(change):
    mechanism = heavy()
    before = mechanism.scene()
    change(mechanism)
    after = mechanism.scene()
    assert after is not before and after != before
    assert after.fingerprint() != before.fingerprint()
    assert mechanism.scene() is after


def test_a_solve_after_a_change_is_that_of_the_new_scene():
    mechanism = fourbar()
    before = ksd.solve(mechanism, top=0.1).forces["top"]
    mechanism.load("top", force=(3.0, 0, 0), at=(0, 0.4, 0))
    after = ksd.solve(mechanism, top=0.1).forces["top"]
    assert before - after == pytest.approx(3.0, rel=1e-3)
    assert after == ksd.prepare(mechanism)(top=0.1).forces["top"]


def test_a_function_of_the_users_is_asked_every_time():
    """What it answers may change: such a scene is hashed anew at every call."""
    width = [10 * mm]
    mechanism = ksd.Mechanism("tapered")
    section = ksd.rectangle(thickness=1 * mm, width=10 * mm)
    mechanism.leaf(
        "ground", mechanism.link("tip"), start=(0, 0, 0), end=(0.1, 0, 0), section=section, material=STEEL,
        width_axis="z", profile=ksd.Varying(lambda s: ksd.rectangle(thickness=1 * mm, width=width[0])),
    )  # fmt: skip
    mechanism.actuate("tip", along="y", at=(0.1, 0, 0))
    scene = mechanism.scene()
    before = scene.fingerprint()
    width[0] = 8 * mm
    assert not scene.is_immutable
    assert scene.fingerprint() != before


class Altered:
    """A joint family of the user's own whose numbers can be changed."""

    def leaves(self):
        return cross_flexure().leaves()


def test_a_joint_that_can_be_altered_is_hashed_every_time():
    scene = fourbar().scene()
    assert scene.is_immutable
    placed = dataclasses.replace(scene.joints[0], joint=Altered())
    assert not dataclasses.replace(scene, joints=(placed, *scene.joints[1:])).is_immutable
