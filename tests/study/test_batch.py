"""Batches answer as designs prepared one by one, whatever they differ in."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scenes import STEEL, cross_flexure, fourbar, single_joint

import ksd
from ksd.model.mesh import Mesh
from ksd.solvers.pose_batch import UNSTABLE
from ksd.solvers.solver import Solver
from ksd.study import prepared_design
from ksd.study.batch import NOT_BUILT
from ksd.study.prepared_design import PreparedDesign
from ksd.study.questions import ALL_QUESTIONS
from ksd.units import GPa, deg, mm

MESHES = {"strain": Mesh(), "chain": Mesh("corotational", elements=3)}


def bar(length=100 * mm, angle=45 * deg, thickness=1 * mm, inner=40 * mm, high=0.3, E=200.0, **_):
    """The fourbar with upper joints of another material."""
    joint = ksd.CrossFlexure(STEEL, length=length, angle=angle, thickness=thickness, widths=(inner, 20 * mm))
    other = ksd.CrossFlexure(
        ksd.Material(E=E * GPa, G=0.4 * E * GPa),
        length=length,
        angle=angle,
        thickness=thickness,
        widths=(inner, 20 * mm),
    )
    scene = ksd.Mechanism("fourbar")
    left, top, right = scene.links("left", "top", "right")
    scene.join(scene.ground, left, joint, at=(-0.2, 0, 0), axis="z", toward="y")
    scene.join(left, top, other, at=(-0.2, high, 0), axis="z", toward="y")
    scene.join(right, top, other, at=(0.2, high, 0), axis="-z", toward="y")
    scene.join(scene.ground, right, joint, at=(0.2, 0, 0), axis="z", toward="y")
    scene.actuate(top, along="x", at=(0, high + joint.length_AB, 0), name="drive")
    scene.load(left, force=(3.0 * E / 200, -5.0, 0), moment=(0, 0, 0.1), at=(-0.2, 0.5 * high, 0))
    return scene


def slider(length=100 * mm, thickness=0.5 * mm, wheel=80 * mm, aside=0.0, **_):
    """A guide carrying a cartwheel seen from behind: a sliding motion, internal blocks, two drives, a support."""
    scene = ksd.Mechanism("slider")
    stage, arm = scene.links("stage", "arm")
    guide = ksd.ParallelGuide(STEEL, length=length, thickness=thickness, width=30 * mm, spacing=60 * mm)
    pivot = ksd.Cartwheel(STEEL, length=wheel, angle=45 * deg, thickness=0.6 * mm, width=20 * mm)
    scene.join(scene.ground, stage, guide, at=(0, 0, 0), axis="z", toward="x", name="guide")
    scene.join(stage, arm, pivot, at=(0.1, aside, 0), axis="-z", toward="x", name="wheel")
    scene.actuate_joint("guide", name="drive")
    scene.actuate_joint("wheel", name="turn")
    scene.load(arm, force=(0.5, 1.0, 0), at=(0.15, 0.02, 0))
    return scene


def arm(length=100 * mm, angle=45 * deg, thickness=1 * mm, high=0.3, **_):
    """Two cross flexures about z and y: nothing planar."""
    joint, scene = cross_flexure(length=length, angle=angle, thickness=thickness), ksd.Mechanism("arm")
    one, two = scene.links("one", "two")
    scene.actuate_joint(
        scene.join(scene.ground, one, joint, at=(0, 0, 0), axis="z", toward="x"), name="drive"
    )
    scene.actuate_joint(scene.join(one, two, joint, at=(0.1, 0, high), axis="y", toward="x"), name="second")
    scene.load(two, force=(0, 2.0, -3.0), at=(0.3, 0, high))
    return scene


SCENES = {"bar": (bar, {}), "slider": (slider, {"turn": 0.1}), "arm": (arm, {"second": 0.2})}
RANGES = {
    "length": (90 * mm, 110 * mm), "angle": (40 * deg, 50 * deg), "thickness": (0.4 * mm, 1.2 * mm),
    "inner": (30 * mm, 45 * mm), "high": (0.28, 0.32), "E": (70.0, 210.0), "wheel": (70 * mm, 90 * mm),
    "aside": (0.0, 0.02),
}  # fmt: skip


def drawn(count, seed=1):
    rng = np.random.default_rng(seed)
    return [{n: float(rng.uniform(*r)) for n, r in RANGES.items()} for _ in range(count)]


@pytest.mark.parametrize("name", SCENES)
def test_batches_answer_as_designs_prepared_one_by_one(name):
    maker, more = SCENES[name]
    stroke, sizes = np.linspace(0.0, 0.01 if name == "slider" else 0.15, 3), drawn(6)
    for mesh, ways in ((None, {}), (MESHES["chain"], {"method": "full"})):
        found = ksd.batch(maker, designs=sizes, drive=stroke, threads=1, mesh=mesh, **ways, **more)
        assert found.solved >= 15
        for d, size in enumerate(sizes):
            five = Solver(maker(**size), mesh=mesh).five_steps
            alone = PreparedDesign(five, **ways)(
                {"drive": stroke, **{n: np.full(3, v) for n, v in more.items()}}
            )
            assert found.status[d].tolist() == alone.status.tolist()
            good = alone.status == 0
            for k, drive in enumerate(alone.drives):
                assert found.forces[drive][d, good] == pytest.approx(alone.force[good, k], rel=1e-9, abs=1e-9)
            for k, joint in enumerate(alone.joints):
                assert found.motions[joint][d, good] == pytest.approx(
                    alone.motion[good, k], rel=1e-10, abs=1e-12
                )
            assert np.abs(found.positions[d, good] - alone.x[good]).max(initial=0.0) <= 1e-13
            assert np.abs(found.rotations[d, good] - alone.R[good]).max(initial=0.0) <= 1e-12


def test_joints_with_weight_in_one_storage_answer_as_alone():
    def heavy(share):
        scene = fourbar(joint=ksd.CrossFlexure(
            ksd.Material(E=200e9, G=76.9e9, density=7800 * share), length=100 * mm, angle=45 * deg, thickness=1 * mm,
            widths=(40 * mm, 20 * mm),
        ))  # fmt: skip
        scene.gravity = (0, -9.81 * share, 0)
        return scene

    # none so heavy that its poses are walked in load steps
    shares = [1.0, 12.0, 0.5, 10.0]
    found = ksd.batch(heavy, designs=[{"share": s} for s in shares], top=[0.05, 0.1], threads=1)
    for d, share in enumerate(shares):
        alone = PreparedDesign(Solver(heavy(share)).five_steps)({"top": np.array([0.05, 0.1])})
        assert found.forces["top"][d] == pytest.approx(alone.force[:, 0], rel=1e-10)
    assert found.forces["top"][0] != pytest.approx(found.forces["top"][1], rel=1e-6)


def odd(kind, thickness=1 * mm):
    """Fourbars that differ in more than numbers, or cannot be solved."""
    if kind == "steep":
        return fourbar(joint=cross_flexure(thickness=thickness, angle=5 * deg))
    if kind == "refused":
        return fourbar(joint=cross_flexure(thickness=-thickness))
    scene = fourbar(joint=cross_flexure(thickness=thickness))
    if kind == "taller":
        scene = fourbar(joint=cross_flexure(thickness=thickness), reading=2)
    if kind == "heavy":
        scene.gravity = (0, -9.81, 0)
        scene.mass("top", mass=1.0, at=(0, 0.3, 0))
    if kind == "pushed":
        scene.load("top", force=(0, 1.0, 0), at=(0, 0.3, 0))
    return scene


def test_designs_of_other_kinds_in_one_batch_and_failures_told():
    kinds = ["plain", "steep", "pushed", "plain", "refused", "taller", "plain", "heavy", "plain"]
    sizes = [{"kind": k, "thickness": (0.8 + 0.05 * i) * mm} for i, k in enumerate(kinds)]
    found = ksd.batch(odd, designs=[sizes[0], *sizes], top=[0.05, 0.1], threads=1)
    for d, size in enumerate(sizes, start=1):
        if size["kind"] in ("steep", "refused"):
            assert (found.status[d] == NOT_BUILT).all()
            assert ("angle" if size["kind"] == "steep" else "thickness") in found.why(d, 0)
            continue
        single = PreparedDesign(Solver(odd(**size)).five_steps)({"top": np.array([0.05, 0.1])})
        assert found.forces["top"][d] == pytest.approx(single.force[:, 0], rel=1e-12)
    assert len(found.failures) == 4


def test_a_design_that_locks_or_leaves_its_plane_is_seen():
    def pushed(shift):
        """A load that pushes out of the plane, or is none."""
        scene = fourbar()
        scene.load("top", force=(0, 0, shift), at=(0, 0.3, 0))
        return scene

    flat = ksd.batch(pushed, designs=[{"shift": 0.0}] * 4 + [{"shift": 5.0}] * 2, top=[0.1], threads=1)
    assert flat.solved == 6
    assert flat.positions[5, 0, 2, 2] != pytest.approx(0.0, abs=1e-9)
    assert flat.positions[3, 0, 2, 2] == pytest.approx(0.0, abs=1e-12)

    def driven(turn):
        """Two joints in a row; across the row the end moves, along it nothing does."""
        scene = ksd.Mechanism("driven")
        one, two = scene.links("one", "two")
        first = scene.join(scene.ground, one, cross_flexure(), at=(0, 0, 0), axis="z", toward="x")
        scene.join(one, two, cross_flexure(), at=(0.2, 0, 0), axis="z", toward="x")
        scene.actuate_joint(first, name="turn")
        scene.actuate(two, along=(np.cos(turn), np.sin(turn), 0), at=(0.4, 0, 0), name="end")
        return scene

    turns = [{"turn": t * deg} for t in (90, 80, 70, 60, 0)]
    found = ksd.batch(driven, designs=turns, turn=0.0, end=0.001, threads=1)
    assert found.status[:, 0].tolist() == [0, 0, 0, 0, NOT_BUILT]
    assert "moves nothing" in found.why(4, 0)


def test_shear_is_there_in_every_design_however_little_it_is():
    def thin(width):
        return fourbar(joint=cross_flexure(thickness=0.05 * mm, widths=(width, 0.5 * width)))

    sizes = [{"width": w * mm} for w in (0.5, 0.52, 0.54, 0.6, 0.62, 0.64)]
    assert all(Solver(thin(**s)).model.mesh.shear for s in sizes)
    found = ksd.batch(thin, designs=[sizes[0], *sizes], top=0.05, threads=1)
    for d, size in enumerate(sizes, start=1):
        single = PreparedDesign(Solver(thin(**size)).five_steps)({"top": np.array([0.05])})
        assert found.forces["top"][d] == pytest.approx(single.force[:, 0], rel=1e-12)


def test_designs_go_to_any_executor():
    sizes = drawn(5)
    here = ksd.batch(bar, designs=sizes, drive=[0.05, 0.1], threads=1)
    with ThreadPoolExecutor(2) as pool:
        there = ksd.batch(bar, designs=sizes, drive=[0.05, 0.1], executor=pool)
    assert there.forces["drive"] == pytest.approx(here.forces["drive"], rel=1e-12)


@pytest.mark.parametrize("method", ["reduced", "full"])
@pytest.mark.parametrize("name", SCENES)
def test_the_compliance_is_that_of_poses_one_by_one(name, method):
    make, held = SCENES[name]
    designs, link = drawn(3), {"bar": "top", "slider": "arm", "arm": "two"}[name]
    values = {"drive": [0.0, 0.01], **held}
    at = (0.02, 0.1, 0.03)
    found = ksd.batch(
        make,
        values,
        designs=designs,
        method=method,
        questions="support_stiffness",
        link=link,
        at=at,
        threads=1,
    )
    assert found.solved == 6 and found.compliance.shape == (3, 2, 6, 6)
    for d, design in enumerate(designs):
        for n, drive in enumerate(values["drive"]):
            pose = ksd.prepare(make(**design), planar=False)({"drive": drive, **held})
            wanted = pose.stiffness(link, at=at).compliance
            assert found.compliance[d, n] == pytest.approx(wanted, rel=1e-6, abs=1e-8 * np.abs(wanted).max())


@pytest.mark.parametrize("method", ["reduced", "full"])
@pytest.mark.parametrize("name", SCENES)
def test_questions_are_answered_as_of_poses_one_by_one(name, method):
    make, held = SCENES[name]
    designs, values = drawn(3), {"drive": [0.01, 0.02], **held}
    known = tuple(q for q in ALL_QUESTIONS if q not in ("force", "clearance"))
    found = ksd.batch(make, values, designs=designs, method=method, questions=known, modes=2, threads=1)
    assert found.solved == 6
    # without a method, as of "reduced" here, questions are asked of the equilibrium next to what was found
    how = None if method == "reduced" else method
    for d, n in np.ndindex(3, 2):
        alone = {**values, "drive": values["drive"][n]}
        one = ksd.sweep(make, alone, designs=[designs[d]], method=how, questions=known, modes=2, progress=False,
                        mesh=Mesh())  # fmt: skip
        answered = set(one.columns) - set(one.labels) - {"status", "stable", "method", "warnings", "mac"}
        assert answered <= {*found.answers}
        for column in sorted(answered):
            if found[column].dtype == object:
                assert found[column][d, n] == one[column][0], column
            else:
                # where links are is of the method itself
                moved = method == "reduced" and column.startswith(
                    ("parasitic_", "size_", "lowest_", "highest_")
                )
                near = (
                    {"rel": 1e-3, "abs": 1e-3} if moved and "Hz" not in column else {"rel": 2e-6, "abs": 1e-7}
                )
                assert found[column][d, n] == pytest.approx(one[column][0], nan_ok=True, **near), column


def test_a_question_without_an_answer_says_why_and_leaves_the_pose():
    found = ksd.batch(
        single_joint, designs=[{}], turn=[0.1, 0.2], questions=("clearance", "stress"), threads=1
    )
    assert found.solved == 0 and "clearance: every two leaf springs" in found.failures[0][2]
    assert np.isfinite(found.forces["turn"]).all() and np.isfinite(found["stress_MPa"]).all()
    with pytest.raises(ksd.SceneError, match=r"no answer 'stress_Mpa'.*did you mean \"stress_MPa\""):
        found["stress_Mpa"]


def test_a_compliance_of_an_unstable_equilibrium_is_refused(monkeypatch):
    """Next to a reduced state that is stable."""
    honest = prepared_design.converge_fast_state

    def one_more(*words):
        stop, negatives = honest(*words)
        return stop, negatives + 1

    monkeypatch.setattr(prepared_design, "converge_fast_state", one_more)
    found = ksd.batch(bar(), drive=0.01, questions="support_stiffness", threads=1)
    assert found.solved == 0 and np.isnan(found.compliance).all()
    assert "not a minimum of energy" in str(found.failures)


def test_a_stiffness_is_that_of_a_settled_stable_state(monkeypatch):
    """By one Newton step to the finer mesh where that was the last; else by way of the equilibrium next to the answer, with
    the same numbers, and refused where that is unstable."""

    def drawn_anew(thickness):
        return fourbar(joint=cross_flexure(thickness=thickness))

    calls, honest, usual = [], prepared_design.converge_fast_state, prepared_design.MAX_UNINTENDED_MOTION

    def counted(model, motion, *words):
        calls.append(motion)
        return honest(model, motion, *words)

    def asked(along):
        calls.clear()
        monkeypatch.setattr(prepared_design, "MAX_UNINTENDED_MOTION", along)
        found = ksd.batch(
            drawn_anew, top=[1e-3, 0.02, 0.1, 0.25], designs={"thickness": [1 * mm, 1.1 * mm]}, threads=1,
            questions=("support_stiffness", "drive_stiffness"),
        )  # fmt: skip
        return found, len(calls)

    monkeypatch.setattr(prepared_design, "converge_fast_state", counted)
    wanted, all_settled = asked(-1.0)
    near, fewer = asked(usual)
    hasty, turned_back = asked(np.inf)
    # the far ones are settled in any case
    assert (all_settled, fewer, turned_back) == (8, 4, 2)
    for found in (near, hasty):
        assert found.status.tolist() == wanted.status.tolist() == [[0] * 4] * 2
        assert np.abs(found.compliance - wanted.compliance).max() < 1e-8 * np.abs(wanted.compliance).max()
        for column, value in wanted.answers.items():
            assert found[column] == pytest.approx(value, rel=1e-7, nan_ok=True), column
    monkeypatch.setattr(prepared_design, "converge_fast_state", lambda *words: (honest(*words)[0], 99))
    unstable, _ = asked(np.inf)
    assert unstable.status[0, 3] == UNSTABLE and np.isnan(unstable.compliance[0, 3]).all()
    assert not any(np.isfinite(value[0, 3]) for value in unstable.answers.values())


def test_a_compliance_is_asked_of_a_link_that_is_there():
    assert ksd.batch(bar, drive=0.01, designs=drawn(2), threads=1).compliance is None
    with pytest.raises(ksd.SceneError, match="'roof' is not part of this mechanism"):
        ksd.batch(bar(), drive=0.01, questions="support_stiffness", link="roof", threads=1)
    with pytest.raises(ksd.SceneError, match="answer no questions"):
        ksd.batch(bar(), drive=0.01, questions="stress", tabulated=True)


def test_leaf_springs_without_joints_are_sent_to_a_sweep():
    def strip(length):
        scene = ksd.Mechanism("strip")
        end = scene.link("end")
        scene.leaf(
            scene.ground, end, start=(0, 0, 0), end=(length, 0, 0), section=ksd.rectangle(2e-4, 0.015),
            material=ksd.Material(200e9, nu=0.3), width_axis="z",
        )  # fmt: skip
        scene.actuate(end, about="z", name="turn")
        return scene

    with pytest.raises(ksd.SceneError, match=r"nothing to reduce.*; ksd\.sweep takes every mechanism"):
        ksd.batch(strip, designs=[{"length": 0.04}], turn=0.05)


def test_a_design_without_a_scene_is_named_and_no_sweep_is_offered_for_it():
    def forgotten(length):
        if length < 0.1:
            return bar(length=length)
        return None

    def short(length):
        return bar(length="50 mm" if length else length)

    with pytest.raises(ksd.SceneError, match="its function returned None; end it with a return") as told:
        ksd.batch(forgotten, designs=[{"length": 0.1}], turn=0.05)
    assert "ksd.sweep" not in str(told.value)
    with pytest.raises(ksd.SceneError, match=r"cannot be built.*50 \* ksd\.units\.mm$"):
        ksd.batch(short, designs=[{"length": 0.1}], turn=0.05)
    table = ksd.sweep(forgotten, designs=[{"length": 0.1}], turn=[0.05], questions=("force",), progress=False)
    assert "its function returned None" in table["status"][0]


def pair(first):
    """Two hinges side by side, in one order or the other."""
    scene = ksd.Mechanism("pair")
    for k in (0, 1) if first else (1, 0):
        tip, joint = scene.link(f"tip{k}"), cross_flexure(thickness=(k + 1) * 0.5 * mm)
        placed = scene.join(scene.ground, tip, joint, at=(0, k, 0), axis="z", toward="x", name=f"hinge{k}")
        scene.actuate_joint(placed, name=f"turn{k}")
    return scene


def test_designs_with_links_in_another_order_are_told_apart():
    """Their forces would stand under the names of the first."""
    found = ksd.batch(pair, turn0=0.1, turn1=0.1, designs=[{"first": True}, {"first": False}])
    assert found.solved == 1 and "other links, drives or joints than the first" in found.why(1, 0)
    assert found.forces["turn1"][0, 0] == pytest.approx(8 * found.forces["turn0"][0, 0], rel=0.01)
    assert np.isnan(found.forces["turn1"][1]).all()


def test_a_batch_has_the_curvature_modes_that_a_solve_has():
    """A leaf spring beside trained joints bends next to its clamps: its stress was 25 % off, in silence."""

    def beside(thickness):
        scene = fourbar()
        scene.leaf("ground", "top", start=(0, 0, 0), end=(0, 0.37, 0), section=ksd.rectangle(thickness, 0.01),
                   material=STEEL, width_axis="z")  # fmt: skip
        return scene

    words = {"method": "full", "designs": {"thickness": [2e-4]}, "questions": "stress", "top": [0.01, 0.1]}
    found, coarse = ksd.batch(beside, **words), ksd.batch(beside, mesh=ksd.Mesh(), **words)
    stress = 1e-6 * ksd.solve(beside(2e-4), top=0.1, method="full").stress().largest_Pa
    assert found["stress_MPa"][0, 1] == pytest.approx(stress, rel=1e-6)
    assert coarse["stress_MPa"][0, 1] > 1.2 * stress
