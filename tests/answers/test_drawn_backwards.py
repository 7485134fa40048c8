"""Leaf springs drawn from their other end: start and end swapped, curve, profile and heat turned round."""

import numpy as np
import pytest
from scenes import STEEL

import ksd

HEATED = ksd.Material(E=STEEL.E, G=STEEL.G, density=7800, expansion=1.2e-5)


def stage(*, backwards):
    """A loaded stage on an arc, a tapered arc, and a straight leaf heated at one face, with both optional effects."""
    scene = ksd.Mechanism("stage")
    link, turned = scene.link("stage"), -1.0 if backwards else 1.0
    shapes = (
        ("arc", 0.9, (0, 0, 0)),
        ("tapered", -0.6, (0, 0, 0.03)),
        ("straight", 0.0, (0.01, -0.05, 0.01)),
    )
    for name, angle, start in shapes:
        end = np.add(start, (0.1, 0.01, 0.0))
        chord = float(np.linalg.norm(end - start))
        curve = ksd.Arc(radius=chord / (2 * np.sin(abs(angle) / 2)), angle=turned * angle) if angle else None
        thickness, width = (
            ((0.6e-3, 0.9e-3), (0.02, 0.01)) if name == "tapered" else ((0.7e-3,) * 2, (0.015,) * 2)
        )
        order = -1 if backwards else 1
        profile = ksd.Taper(thickness=thickness[::order], width=width[::order])
        (a, p), (b, q) = ((scene.ground, start), (link, end))[::order]
        scene.leaf(a, b, start=p, end=q, width_axis="z", section=ksd.rectangle(0.7e-3, 0.015), material=HEATED,
                   curve=curve, profile=profile if name == "tapered" else None, name=name)  # fmt: skip
    scene.heat(10.0, through=turned * 15.0, leaves=["straight"])
    scene.consider("warping", "plate")
    scene.load(link, force=(20.0, -10.0, 5.0), at=(0.1, 0.0, 0.02))
    return ksd.solve(scene, method="conventional")


def test_answers_do_not_depend_on_the_end_from_which_leaf_springs_are_drawn():
    one, other = stage(backwards=False), stage(backwards=True)
    at = (0.1, 0.0, 0.02)
    for what in (
        lambda pose: pose.displacement("stage", at),
        lambda pose: pose.stiffness("stage", at=at).compliance,
        lambda pose: pose.frequencies().frequency_Hz,
        lambda pose: pose.stress().largest_Pa,
        lambda pose: list(pose.strain_energy().values()),
    ):
        expected = np.asarray(what(one))
        assert what(other) == pytest.approx(expected, rel=1e-5, abs=1e-7 * np.abs(expected).max())


def test_critical_load_factors_depend_on_it_in_second_order():
    one, other = (
        stage(backwards=backwards).buckling("stage", force=(0, 0, 300.0), at=(0.1, 0.0, 0.02))
        for backwards in (False, True)
    )
    assert len(one.factor) == len(other.factor) > 0
    share = one.factor / one.linear_up_to
    assert (np.abs(other.factor / one.factor - 1.0) < 0.1 * share**2 + 1e-3).all()
