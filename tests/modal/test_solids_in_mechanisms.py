"""Mechanisms with reduced solids judge themselves: error of forces and poses, range, refusal, questions."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ksd
from ksd.modal import with_modal_bodies
from ksd.modal.solid import block
from ksd.modal.solid_basis import reduce_solid, with_solids
from ksd.section import rectangle
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.validity import most_bent_body

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
from reduced_solids import load_face

STEEL = ksd.Material(E=200e9, G=76.9e9, density=7800)
LENGTH, THICK, WIDTH = 0.1, 0.01, 0.02
EI = STEEL.E * WIDTH * THICK**3 / 12
END = (LENGTH, 0.0, 0.0)


def spring(*, load=0.0, flat=False, driven=False):
    """A thick leaf along x with a load [EI/L^2] across its end, or driven there."""
    scene = ksd.Mechanism("thick leaf")
    tip = scene.link("tip")
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=END, section=rectangle(THICK, WIDTH), material=STEEL, width_axis="z",
        name="spring",
    )  # fmt: skip
    if load:
        scene.load(tip, force=(0, load * EI / LENGTH**2, 0), at=END)
    if driven:
        scene.actuate(tip, along="y", at=END, name="across")
    if flat:
        scene.support(tip, along="z", at=END)
        scene.support(tip, about="x")
        scene.support(tip, about="y")
    return scene


@pytest.fixture(scope="module")
def plane():
    return block(STEEL, LENGTH, THICK, width=WIDTH, cells=(8, 1))


@pytest.fixture(scope="module")
def coarse(plane):
    """Without derivatives and internal modes: per cent off at a tenth of the length."""
    return reduce_solid(plane, order=1, internal=0)


@pytest.fixture(scope="module")
def fine(plane):
    return reduce_solid(plane)


def moved(pose):
    return pose.displacement("tip", END)


@pytest.mark.parametrize("load", [0.03, 0.1])
def test_the_error_told_is_that_against_the_full_solid(plane, coarse, load):
    """Against the solid pressed on its own, 0.3 and 3 %."""
    pose = ksd.solve(spring(load=load, flat=True), basis={"spring": coarse}, strict=False)
    full = load_face(plane, np.array([0.0, load * EI / LENGTH**2, 0.0]), np.zeros(3))
    true = np.linalg.norm(full.shift - moved(pose)) / np.linalg.norm(full.shift)
    assert 1e-3 < true < 0.05
    assert pose.method_error.relative == pytest.approx(true, rel=0.1)
    assert "error estimate" in [s.name for s in pose.steps]
    assert f"{100 * pose.error.relative:.2g} %" in str(pose.trust.trusted)


NOTCH = {"outline": lambda u: 1 - 0.6 * np.sin(np.pi * u) ** 4}


@pytest.mark.parametrize(
    ("cells", "load", "shape", "best", "large"),
    [
        ((8, 1), 0.1, {}, (64, 8), False),
        ((4, 1), 0.3, {}, (64, 8), False),
        ((12, 2), 0.01, NOTCH, (64, 8), False),
        ((4, 1, 1), 0.1, {}, (12, 2, 2), False),
        ((16, 2), 0.1, {}, (64, 8), True),
        ((24, 4), 0.01, NOTCH, (64, 8), True),
    ],
    ids=["flat", "coarse", "notch", "in space", "large", "large notch"],
)
def test_the_error_told_includes_the_mesh_of_the_solid(monkeypatch, cells, load, shape, best, large):
    """Against the solid pressed on its own on a much finer mesh; of a large solid estimated on a coarser one."""
    if large:
        monkeypatch.setattr("ksd.solvers.error.MAX_REFINED_SOLID", 0)
    bodies = [block(STEEL, LENGTH, THICK, width=WIDTH, cells=c, **shape) for c in (cells, best)]
    words = {"basis": {"spring": reduce_solid(bodies[0])}, "strict": False}
    pose = ksd.solve(spring(load=load, flat=len(cells) == 2), **words)
    full = load_face(bodies[1], np.array([0.0, load * EI / LENGTH**2, 0.0]), np.zeros(3))
    true = np.linalg.norm(full.shift - moved(pose)) / np.linalg.norm(full.shift)
    assert true > 100 * pose.method_error.relative and true > 1e-3
    near = 2.0 if large else 1.3
    assert true / near < pose.error.relative < near * true
    assert pose.error.mesh == pytest.approx(pose.error.relative, rel=0.01)
    share = 100 * pose.error.mesh
    assert f"of which mesh {share:.2g} %" in str(pose)
    assert pose.error.displacement == pytest.approx(np.linalg.norm(full.shift - moved(pose)), rel=1.0)
    if not large:
        size = lambda p: float(np.linalg.norm(moved(p)))  # noqa: E731
        value, told = pose.with_error(size)
        # what cells of half the size change: they leave a quarter, a half where they are few
        assert 0.45 < told / (np.linalg.norm(full.shift) - value) < 1.0


def test_of_a_solid_that_cannot_be_meshed_again_the_method_alone_is_told(plane):
    body = reduce_solid(replace(plane, refine=None))
    pose = ksd.solve(spring(load=0.1, flat=True), basis={"spring": body})
    assert np.isnan(pose.error.mesh) and pose.error.relative == pose.method_error.relative
    assert "that of its mesh is not known" in str(pose)


def test_a_driven_solid_tells_the_error_of_its_force(plane, coarse, fine):
    """Drive force and drive stiffness of the coarse basis, with their errors, against those of the fine one."""
    scene = spring(flat=True, driven=True)
    poor, good = (
        ksd.solve(scene, across=0.1 * LENGTH, basis={"spring": b}, strict=False) for b in (coarse, fine)
    )
    off = abs(poor.forces["across"] - good.forces["across"])
    assert good.method_error.relative < 1e-4 < off / good.forces["across"]
    assert poor.method_error.force[0] == pytest.approx(off, rel=0.02)
    value, error = poor.with_error(lambda p: p.drive_stiffness()["across"])
    finer = reduce_solid(plane.refine(2))
    best = ksd.solve(scene, across=0.1 * LENGTH, basis={"spring": finer}, strict=False)
    true = abs(value - best.drive_stiffness()["across"])
    assert error == pytest.approx(true, rel=0.1) and error > 1e-3 * value


def test_beyond_its_range_it_is_refused(coarse):
    """By `ksd.solve`, from a scene and from a model, and by a prepared solver; `strict` and `estimate` switch."""
    scene = spring(load=0.5, flat=True)
    model = with_solids(ksd.compile_scene(scene), {"spring": coarse})
    refused = pytest.raises(ksd.TrustError, match=r"basis no longer successful.*solid 'spring' is within 1 %")
    with refused:
        ksd.solve(scene, basis={"spring": coarse})
    with refused:
        ksd.solve(model)
    with refused:
        ksd.prepare(model)()
    assert not ksd.solve(model, strict=False).trusted
    unknown = ksd.solve(model, estimate=False)
    assert unknown.error is None and "not estimated" in str(unknown.trust.trusted)
    assert "not estimated" in str(solve_conventional(model, {}).trust.trusted)
    name, stroke, turn = most_bent_body(model, unknown.motion)
    assert name == "spring" and 0.05 < stroke < 0.3 and 0.1 < turn < 0.4


def test_a_range_is_told(coarse):
    pose = ksd.solve(spring(load=0.02, flat=True), basis={"spring": coarse})
    found = pose.validity()
    assert found.leaf == "spring" and found.word == "solid" and 0.0 < min(found.stroke.values()) < 0.2
    with pytest.raises(ksd.SceneError, match="there is no solid 'beam'"):
        pose.validity(leaf="beam")


def test_beside_joints_and_leaves():
    """A 3D solid behind a cross flexure, with a leaf: near the same mechanism of leaves, and every question is answered or
    refused with its reason."""
    thin = {"section": rectangle(3e-4, WIDTH), "material": STEEL, "width_axis": "z"}
    scene = ksd.Mechanism("mixed")
    middle, tip = scene.links("middle", "tip")
    hinge = ksd.CrossFlexure(STEEL, length=0.03, angle=np.pi / 4, thickness=4e-4, widths=(0.012, 0.006))
    at = hinge.length_AB
    scene.join(scene.ground, middle, hinge, at=(0, 0, 0), axis="z", toward="x", name="hinge")
    scene.leaf(middle, tip, start=(at, 0, 0), end=(at + LENGTH, 0, 0), **{**thin, "section": rectangle(THICK, WIDTH)},
               name="spring")  # fmt: skip
    scene.leaf(scene.ground, tip, start=(at + 0.2, 0, 0), end=(at + LENGTH, 0, 0), **thin, name="strut")
    scene.actuate(tip, along="y", at=(at + LENGTH, 0, 0), name="lift")
    body = reduce_solid(block(STEEL, LENGTH, THICK, width=WIDTH, cells=(4, 1, 1)), order=1, internal=0)
    mesh = ksd.Mesh(orders=(4, 3, 9), points=12)
    pose = ksd.solve(scene, lift=0.008, basis={"spring": body}, mesh=mesh)
    leaves = ksd.solve(scene, lift=0.008, method="conventional", mesh=mesh)
    assert pose.forces["lift"] == pytest.approx(leaves.forces["lift"], rel=0.03)
    assert pose.strain_energy() == pytest.approx(leaves.strain_energy(), rel=0.15, abs=1e-3)
    assert pose.section_forces()["spring"].end == pytest.approx(
        leaves.section_forces()["spring"].end, abs=0.05 * abs(leaves.section_forces()["spring"].end).max()
    )
    line = next(leaf for leaf in pose.shape().leaves if leaf.name == "spring")
    assert line.place[-1] == pytest.approx(
        np.array([at + LENGTH, 0, 0]) + pose.displacement("tip", (at + LENGTH, 0, 0)), abs=1e-12
    )
    C, error = pose.with_error(lambda p: p.stiffness("tip", at=(at + LENGTH, 0, 0)).compliance)
    assert 0 < error.max() < 0.2 * np.abs(C).max()
    assert "reduced solids (spring)" in str(pose)
    for question in ("stress", "frequencies", "buckling", "internal_stress"):
        with pytest.raises(ksd.SceneError, match=r"not available for reduced solids \(spring\)"):
            getattr(pose, question)()


def test_beside_condensed_joints():
    """By "modal" the other joints are condensed by their records; the error told is that against their leaves in full."""
    body = reduce_solid(block(STEEL, LENGTH, THICK, width=WIDTH, cells=(4, 1, 1)), order=1, internal=0)
    hinge = ksd.CrossFlexure(STEEL, length=0.1, angle=np.pi / 4, thickness=1e-3, widths=(0.04, 0.02))
    scene = ksd.Mechanism("mixed")
    arm, far, tip = scene.links("arm", "far", "tip")
    scene.join(scene.ground, arm, hinge, at=(0, 0, 0), axis="z", toward="x", name="base")
    scene.join(arm, far, hinge, at=(0.2, 0, 0), axis="z", toward="x", name="elbow")
    scene.leaf(far, tip, start=(0.35, 0, 0), end=(0.45, 0, 0), section=rectangle(THICK, WIDTH), material=STEEL,
               width_axis="z", name="spring")  # fmt: skip
    scene.actuate_joint("base", name="a")
    scene.actuate_joint("elbow", name="b")
    scene.load(tip, force=(0, 0.05 * EI / LENGTH**2, 0), at=(0.45, 0, 0))
    values = {"a": 0.2, "b": -0.3}
    solver = ksd.prepare(scene, basis={"spring": body})
    pose = solver(values, method="modal", relinearisations=1)
    whole = ksd.solve(scene, values, basis={"spring": body})
    off = np.array([pose.forces[d] - whole.forces[d] for d in values])
    assert 1e-6 < np.abs(off).max() / abs(whole.forces["a"]) < 1e-3
    # what the solid misses is in the error of both
    assert pose.method_error.force == pytest.approx(np.abs(off), abs=1.1 * whole.method_error.force.max())
    assert whole.method_error.force.max() < 0.1 * np.abs(off).max()
    assert pose.error.mesh == pytest.approx(whole.error.mesh, rel=0.05) and pose.error.mesh > 1e-4
    assert [s.name for s in pose.steps][:2] == ["1 close loops", "2 joint stiffness"]
    assert pose.motions == pytest.approx({"base": 0.2, "elbow": -0.3}, abs=1e-3)
    assert pose.trusted and pose.links["tip"][0] == pytest.approx(whole.links["tip"][0], abs=1e-4)
    again = solver(values, method="modal", relinearisations=1)
    assert again.forces == pytest.approx(pose.forces, rel=1e-9)
    blind = solver(values, method="modal", estimate=False)
    assert blind.error is None and "not estimated" in str(blind.trust.trusted)


def test_support_stiffness_of_a_flat_solid(fine):
    """What supports alone hold is held; in its plane it is as stiff as pressed on its own."""
    pose = ksd.solve(spring(load=0.3, flat=True), basis={"spring": fine})
    found = pose.stiffness("tip", at=END)
    assert all(np.isinf(found.support(d)) for d in ("z", "rx", "ry"))
    full = load_face(fine.solid, np.array([0.0, 0.3 * EI / LENGTH**2, 0.0]), np.zeros(3))
    free = [0, 1, 5]
    flexible = np.linalg.inv(full.stiffness[np.ix_(free, free)])
    assert found.compliance[np.ix_(free, free)] == pytest.approx(flexible, abs=1e-3 * np.abs(flexible).max())


def test_no_method_leaves_a_solid_out(coarse):
    """By name it is there with "conventional" as without a method."""
    scene, basis = spring(load=0.1, flat=True), {"spring": coarse}
    one, other = (ksd.solve(scene, method=m, basis=basis, strict=False) for m in (None, "conventional"))
    assert moved(other) == pytest.approx(moved(one), rel=1e-12)
    assert np.linalg.norm(moved(ksd.solve(scene)) - moved(one)) > 1e-3 * np.linalg.norm(moved(one))


def test_what_is_not_possible_is_said(coarse):
    scene = spring(load=0.02, flat=True)
    model = with_solids(ksd.compile_scene(scene), {"spring": coarse})
    for method in ("reduced", "full", "kinematic"):
        with pytest.raises(ksd.SceneError, match="solved in load steps"):
            ksd.solve(model, method=method)
    with pytest.raises(ksd.SceneError, match=r"give what ksd\.modal\.solid_basis\.reduce_solid returns"):
        with_solids(model, {"spring": 3})
    with pytest.raises(ksd.SceneError, match="solids and modal bodies cannot be combined"):
        ksd.solve(scene, method="modal", basis={"spring": coarse, "other": ksd.ModalBasis()})
    for method in ("reduced", "full", "kinematic"):
        with pytest.raises(ksd.SceneError, match="solved in load steps"):
            ksd.solve(scene, method=method, basis={"spring": coarse})
    both = spring(load=0.02, flat=True)
    both.leaf(
        both.ground, "tip", start=(0, 0.1, 0), end=(LENGTH, 0.1, 0), section=rectangle(1e-3, WIDTH), material=STEEL,
        width_axis="z", name="other",
    )  # fmt: skip
    modal = with_modal_bodies(
        ksd.compile_scene(both, mesh=ksd.Mesh("corotational", elements=10)), ksd.ModalBasis(), only=["other"]
    )
    with pytest.raises(ksd.SceneError, match="solids and modal bodies cannot be combined"):
        with_solids(modal, {"spring": coarse})
    with pytest.raises(ksd.ConvergenceError, match="resists nothing out of its plane: hold that by supports"):
        ksd.solve(spring(driven=True), across=0.001, basis={"spring": coarse})
