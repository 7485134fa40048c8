"""Scenes shared by all tests: the cross flexure and the fourbar of paper 1, a guide that carries a cartwheel."""

import numpy as np

import ksd
from ksd.units import GPa, deg, mm

STEEL = ksd.Material(E=200 * GPa, G=76.9 * GPa, density=7800)


def cross_flexure(**changes):
    """Table 1 of paper 1, with changes."""
    sizes = {
        "length": 100 * mm,
        "angle": 45 * deg,
        "thickness": 1 * mm,
        "widths": (40 * mm, 20 * mm),
        **changes,
    }
    return ksd.CrossFlexure(STEEL, **sizes)


def single_joint(joint=None):
    """One joint from ground to link 'tip', driven by its relative angle 'turn'; joint axes are global axes."""
    scene = ksd.Mechanism("one joint")
    tip = scene.link("tip")
    placed = scene.join(
        scene.ground, tip, joint or cross_flexure(), at=(0, 0, 0), axis="z", toward="x", name="hinge"
    )
    scene.actuate_joint(placed, name="turn")
    return scene


def fourbar(*, reading=1, joint=None):
    """Section 4.3 of paper 1. Reading 1: H = 0.3 m between joint centres; reading 2: H is the side link."""
    joint = joint or cross_flexure()
    high = 0.3 if reading == 1 else 0.3 + joint.length_AB
    scene = ksd.Mechanism("fourbar")
    left, top, right = scene.links("left", "top", "right")
    scene.join(scene.ground, left, joint, at=(-0.2, 0, 0), axis="z", toward="y", name="lower left")
    scene.join(left, top, joint, at=(-0.2, high, 0), axis="z", toward="y", name="upper left")
    scene.join(right, top, joint, at=(0.2, high, 0), axis="z", toward="y", name="upper right")
    scene.join(scene.ground, right, joint, at=(0.2, 0, 0), axis="z", toward="y", name="lower right")
    scene.actuate(top, along="x", at=(0, high + joint.length_AB, 0))
    return scene


def slider(axis="z", toward="x"):
    """A stiffened guide carrying a cartwheel: internal blocks, a sliding motion, joints seen from both sides."""
    scene = ksd.Mechanism("slider")
    stage, arm = scene.links("stage", "arm")
    guide = ksd.ParallelGuide(STEEL, length=100 * mm, thickness=0.5 * mm, width=30 * mm, spacing=60 * mm)
    wheel = ksd.Cartwheel(STEEL, length=80 * mm, angle=45 * deg, thickness=0.6 * mm, width=20 * mm)
    scene.join(scene.ground, stage, guide, at=(0, 0, 0), axis="z", toward="x", name="guide")
    scene.join(stage, arm, wheel, at=(0.1, 0, 0), axis=axis, toward=toward, name="wheel")
    scene.actuate(stage, along="y", at=(0.1, 0, 0), name="stroke")
    scene.actuate_joint("wheel", name="turn")
    scene.load(arm, force=(0.5, 1.0, 0), at=(0.15, 0.02, 0))
    return scene


def guided_leaf(slenderness, *, taut):
    """A leaf of .1 m whose end moves across and does not turn: drawn where it must also keep its distance (`taut`), else
    free to come nearer, half of its deflection and more being shear where it is thick."""
    scene = ksd.Mechanism("taut leaf" if taut else "thick leaf")
    tip = scene.link("tip", at=(0.1, 0, 0))
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), section=ksd.rectangle(0.1 / slenderness, 0.02), material=STEEL,
        width_axis="z", name="leaf",
    )  # fmt: skip
    scene.actuate(tip, along="y", at=(0.1, 0, 0), name="drive")
    if taut:
        scene.support(tip, along="x", at=(0.1, 0, 0))
    scene.support(tip, about="z")
    return scene


def dense(arrays, work):
    """The assembled matrix (n, n), in elimination order."""
    plan = arrays.plan
    found = np.zeros((plan.unknowns, plan.unknowns))
    for k in range(len(plan.size)):
        places = [(k, plan.diagonal[k])]
        places += [(plan.row[e], plan.place[e]) for e in range(plan.first[k], plan.first[k + 1])]
        for i, at in places:
            block = work.matrix[at : at + plan.size[i] * plan.size[k]].reshape(plan.size[i], plan.size[k])
            rows, columns = (slice(plan.start[b], plan.start[b] + plan.size[b]) for b in (i, k))
            found[rows, columns] = block
            found[columns, rows] = block.T
    return found
