"""Errors by the mesh and effects left out of poses in contact, against the same walks on other models."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import ksd
from ksd.solvers.leaf_contact import cut_at, node_poses, places_of
from ksd.solvers.near_contact import equilibrium_in_contact
from ksd.solvers.touching import cut_model
from ksd.units import mm

STEEL = ksd.Material(E=200e9, nu=0.3, density=7800)
BLADE = ksd.rectangle(0.3 * mm, 10 * mm)
COARSE, FINE = ksd.Mesh(orders=(3, 2, 4)), ksd.Mesh(orders=(5, 4, 12), points=20)
DOWN = [{"y": -8 * mm}, {"y": -7.9 * mm}, {"y": -6 * mm}]


def jaw(friction):
    """A jaw on a parallel guide under the disc of a driven block on a leaf spring."""
    scene = ksd.Mechanism("jaw", plane="xy")
    block, pad = scene.links("block", "pad")
    words = {"section": BLADE, "material": STEEL}
    scene.leaf("ground", block, start=(-0.1, 0.05, 0), end=(0, 0.05, 0), name="blade", **words)
    scene.actuate(block, along="y", at=(0.07, 0.05, 0), name="y")
    for y in (0.0, -20 * mm):
        scene.leaf("ground", pad, start=(0, y, 0), end=(0.06, y, 0), name=f"l{y}", **words)
    face = scene.surface(pad, ksd.shapes.wall(), at=(0.07, 5 * mm, 0), axis="y")
    disc = scene.surface(block, ksd.shapes.disc(5 * mm), at=(0.07, 10 * mm, 0))
    scene.contact(face, disc, friction=friction, name="c")
    return scene


def finger(friction):
    """A leaf spring under the disc of a block on a leaf spring that is driven."""
    scene = ksd.Mechanism("finger", plane="xy")
    tip, block = scene.links("tip", "block")
    words = {"section": ksd.rectangle(0.5 * mm, 10 * mm), "material": STEEL}
    scene.leaf("ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), name="leaf", **words)
    scene.leaf("ground", block, start=(0, 0.1, 0), end=(0.06, 0.1, 0), name="other", **words)
    scene.actuate(block, along="y", at=(0.06, 20.25 * mm, 0), name="y")
    scene.contact(
        "leaf",
        scene.surface(block, ksd.shapes.disc(20 * mm), at=(0.06, 20.25 * mm, 0)),
        friction=friction,
        name="c",
    )
    return scene


def stopped(_):
    """A jaw alone that is pressed on a stop."""
    scene = jaw(0.0)
    scene.stop("pad", along="y", at=(0.06, 0, 0), low=-3 * mm, name="end")
    return scene


CASES = [(jaw, 0.0), (jaw, 0.3), (jaw, 0.8), (finger, 0.0), (finger, 0.05), (finger, 0.3), (stopped, 0.0)]


def walks(scene, **words):
    """The poses of the walk DOWN on a mesh or with an effect."""
    return list(ksd.walk(ksd.prepare(scene, **words), DOWN))


@pytest.mark.parametrize(("make", "friction"), CASES)
def test_the_error_is_the_distance_to_the_last_step_on_a_finer_mesh(make, friction):
    scene = make(friction)
    for step, (pose, exact) in enumerate(
        zip(walks(scene, mesh=COARSE), walks(scene, mesh=FINE), strict=True)
    ):
        assert pose.touched.closed and pose.error.mesh == pose.error.relative < 3e-4
        # of the steps before it tells nothing, where friction keeps their error
        share = 0.5 if step and friction else 0.05
        true = abs(pose.forces["y"] - exact.forces["y"])
        assert pose.error.force[0] == pytest.approx(true, rel=share, abs=5e-8)
        N, error = pose.with_error(lambda p: p.contacts["c"].N)
        assert error == pytest.approx(abs(N - exact.contacts["c"].N), rel=share, abs=5e-8)
        assert pose.trusted and "estimated error" in pose.trust.trusted.sentence


@pytest.mark.parametrize(("make", "friction"), CASES)
def test_effects_left_out_are_those_of_the_walk_with_them(make, friction):
    scene = make(friction)
    for pose, plates in zip(walks(scene), walks(scene, with_="plate"), strict=True):
        told = pose.left_out["plate"]
        change = abs(plates.forces["y"]) / abs(pose.forces["y"]) - 1.0
        assert abs(change) > 0.01 and told["force"] == pytest.approx(change, rel=0.05)


def test_a_contact_held_at_the_pose_has_its_stiffness_compared():
    pose = ksd.solve(jaw(0.0), y=-8 * mm)
    plates = ksd.solve(jaw(0.0), y=-8 * mm, with_="plate")
    soft, stiff = (p.stiffness("block").worst[0] for p in (pose, plates))
    assert pose.left_out["plate"]["support_stiffness"] == pytest.approx(stiff / soft - 1.0, rel=1e-3)


def test_the_printed_pose_tells_its_error():
    text = " ".join(str(ksd.solve(jaw(0.3), y=-8 * mm)).split())
    assert "Estimated error: 4" in text and "plate stiffening (force +4" in text
    assert np.isfinite(ksd.solve(jaw(0.3), y=-8 * mm).uncertainty.relative)


def test_a_pose_whose_contacts_have_opened_tells_its_error():
    """With nothing that loads it, its residual is rounding."""
    scene = ksd.Mechanism("opened", plane="xy")
    tip, block = scene.links("tip", "block")
    scene.leaf("ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), section=BLADE, material=STEEL, name="leaf")
    scene.actuate(block, along="y", at=(0.06, 20.15 * mm, 0), name="y")
    scene.support(block, along="x", at=(0.06, 20.15 * mm, 0))
    scene.support(block, about="z")
    scene.contact("leaf", scene.surface(block, ksd.shapes.disc(20 * mm), at=(0.06, 20.15 * mm, 0)), name="c")
    _, pose = ksd.walk(scene, [{"y": -5 * mm}, {"y": 1 * mm}])
    assert not pose.touched.closed and pose.error.relative < 1e-9 and pose.trusted
    assert pose.with_error(lambda p: p.contacts["c"].gap)[1] < 1e-12
    assert pose.left_out["plate"]["force"] == 0.0


def test_walks_of_one_prepared_solver_in_several_threads():
    """Their solves share its storage, one after the other."""
    solver, strokes = ksd.prepare(finger(0.1)), [{"y": -y * mm} for y in (8, 7, 6, 5)]
    alone = [ksd.walk(solver, [stroke])[-1].forces["y"] for stroke in strokes]
    with ThreadPoolExecutor(4) as threads:
        together = list(threads.map(lambda stroke: ksd.walk(solver, [stroke])[-1].forces["y"], 8 * strokes))
    assert together == 8 * alone


def test_slip_is_measured_from_where_it_was_though_the_cut_moves():
    """From the state of another pose, whose leaf spring is cut and turned otherwise, the iterations find the same pose."""
    walk = ksd.walk(finger(0.8), [{"y": -8 * mm}, {"y": -12 * mm}, {"y": -14 * mm}])
    before, pose, other = walk
    assert pose.contacts["c"].state == "stick"
    places = places_of(other.model)
    (name, (x, R)), *_ = node_poses(before.model, before.motion, places).items()
    node = list(pose.touched.what.nodes).index(pose.model.node_names.index(name))
    last = tuple(a.copy() for a in pose.touched.before)
    last[0][node], last[1][node] = x, R
    begun = replace(pose, touched=replace(pose.touched, before=last))
    model, state = (
        cut_at(cut_model(ksd.compile_scene(finger(0.8), one_sided=True)), places),
        other.motion.copy(),
    )
    _, found, touched = equilibrium_in_contact(begun, model, state)
    assert abs(places[name] - places_of(pose.model)[name]) > 0.3 * mm
    assert touched.forces == pytest.approx(pose.touched.forces, rel=2e-5)
    assert found.x[:3] == pytest.approx(pose.motion.x[:3], abs=1e-7)
