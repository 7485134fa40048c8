"""Batches of mechanisms with stops, cables and contacts: every pose is that of a prepared solve."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import ksd
from ksd.model.mesh import DEFAULT_MESH
from ksd.solvers.pose_batch import NOT_SOLVED, REFUSED
from ksd.study.batch import NOT_BUILT
from ksd.units import GPa, deg, mm

STEEL = ksd.Material(E=200 * GPa, nu=0.3, density=7800)
BLADE = ksd.rectangle(0.3 * mm, 10 * mm)
STROKES = np.array([-2.0, -1.0, 1.0]) * mm


def jaw(friction=0.3, x=70 * mm, softness=0.0):
    """A jaw on a parallel guide under a disc over `x` on a driven block."""
    scene = ksd.Mechanism("jaw", plane="xy")
    block, finger = scene.links("block", "finger")
    scene.leaf("ground", block, start=(-0.1, 0.05, 0), end=(0, 0.05, 0), section=BLADE, material=STEEL)
    scene.actuate(block, along="y", at=(0.07, 0.05, 0), name="y")
    for y in (0.0, -20 * mm):
        scene.leaf("ground", finger, start=(0, y, 0), end=(0.06, y, 0), section=BLADE, material=STEEL)
    face = scene.surface(finger, ksd.shapes.wall(), at=(70 * mm, 5 * mm, 0), axis="y")
    disc = scene.surface(block, ksd.shapes.disc(5 * mm), at=(x, 10 * mm, 0))
    scene.contact(face, disc, friction=friction, softness=softness, name="grip")
    return scene


def finger(x=60 * mm):
    """A leaf spring under a disc over `x` that a drive presses down."""
    scene = ksd.Mechanism("finger", plane="xy")
    tip, held = scene.links("tip", "held")
    for link, y in ((tip, 0.0), (held, 0.1)):
        end = (0.1 if link is tip else x, y, 0)
        name = "leaf" if link is tip else "other"
        scene.leaf("ground", link, start=(0, y, 0), end=end, section=BLADE, material=STEEL, name=name)
    scene.actuate(held, along="y", at=(x, 20.15 * mm, 0), name="y")
    scene.contact("leaf", scene.surface(held, ksd.shapes.disc(20 * mm), at=(x, 20.15 * mm, 0)), name="grip")
    return scene


def pivot(high=1 * deg, thickness=0.3 * mm):
    """A crossed pivot of the catalogue with an end stop, turned by a force drive on its arm."""
    scene = ksd.Mechanism("pivot")
    arm = scene.link("arm")
    joint = ksd.CrossedPivot(STEEL, length=50 * mm, angle=45 * deg, thickness=thickness, width=15 * mm)
    scene.join(scene.ground, arm, joint, at=(0, 0, 0), axis="z", toward="y", name="pivot")
    scene.leaf(
        arm,
        feeler := scene.link("feeler"),
        start=(0, 0.1, 0),
        end=(0, 0.16, 0),
        section=BLADE,
        material=STEEL,
    )
    scene.actuate_joint("pivot", name="turn")
    scene.stop(feeler, along="x", at=(0, 0.16, 0), low=-high * 0.1, high=high * 0.1, name="end")
    return scene


def cable(stiffness=1e3):
    """A leaf spring pushed across against a cable."""
    scene = ksd.Mechanism("tendon", plane="xy")
    tip = scene.link("tip")
    scene.leaf("ground", tip, start=(0, 0, 0), end=(60 * mm, 0, 0), section=BLADE, material=STEEL)
    scene.actuate(tip, along="y", at=(60 * mm, 0, 0), name="y")
    scene.cable("ground", tip, start=(0, 40 * mm, 0), end=(60 * mm, 0, 0), stiffness=stiffness, name="tendon")
    return scene


CASES = {
    "friction": (jaw, {"friction": [0.0, 0.1, 0.5]}, {"y": STROKES}),
    "places": (jaw, {"x": [65 * mm, 70 * mm, 75 * mm]}, {"y": STROKES}),
    "places along a leaf": (finger, {"x": [50 * mm, 60 * mm]}, {"y": STROKES}),
    "limits of a stop": (pivot, {"high": [0.5 * deg, 1 * deg, 30 * deg]}, {"turn": [1 * deg, 5 * deg]}),
    "other leaf springs": (pivot, {"thickness": [0.3 * mm, 0.4 * mm]}, {"turn": [5 * deg]}),
    "cables": (cable, {"stiffness": [1e3, 2e3]}, {"y": STROKES}),
}


@pytest.mark.parametrize("case", CASES)
def test_poses_are_those_of_prepared_solves(case):
    build, designs, values = CASES[case]
    found = ksd.batch(build, designs=designs, questions="force", mesh=DEFAULT_MESH, threads=2, **values)
    assert found.solved == found.status.size, str(found)
    ((name, parameters),) = designs.items()
    closed = 0
    for d, parameter in enumerate(parameters):
        solver = ksd.prepare(build(**{name: parameter}))
        for n in range(found.status.shape[1]):
            pose = solver({drive: float(v[n]) for drive, v in values.items()})
            assert [found.forces[k][d, n] for k in found.forces] == pytest.approx(
                list(pose.forces.values()), rel=1e-12
            )
            for k, link in enumerate(found.links):
                moved, R = pose.links[link]
                rest = solver.model.rest.x[k]
                assert found.positions[d, n, k] == pytest.approx(rest + moved, abs=1e-14)
                assert found.rotations[d, n, k] == pytest.approx(R, abs=1e-13)
            row = {c: found[c][d, n] for c in found.answers}
            parts = {f"{k}_normal_N": c.N for k, c in pose.contacts.items()}
            parts |= {f"{k}_friction_N": np.linalg.norm(c.T) for k, c in pose.contacts.items()}
            parts |= {f"{k}_tension_N": c.force for k, c in pose.cables.items()}
            parts |= {f"{k}_force_N": c.force for k, c in pose.stops.items()}
            assert parts and {k: row[k] for k in parts} == pytest.approx(parts, rel=1e-12, abs=1e-12)
            closed += any(v > 0.0 for v in parts.values())
            assert case != "limits of a stop" or found.motions["pivot"][d, n] == pytest.approx(
                values["turn"][n], rel=1e-3
            )
    assert closed > 0
    if "friction" in designs:
        assert len(set(found["grip_friction_N"][:, 0])) == len(parameters)


def test_questions_hold_closed_contacts():
    asked = ("force", "stress", "support_stiffness", "energy")
    found = ksd.batch(jaw, designs={"friction": [0.0, 0.3]}, y=STROKES, questions=asked, link="finger")
    for d, friction in enumerate((0.0, 0.3)):
        for n, y in enumerate(STROKES):
            pose = ksd.solve(jaw(friction), y=y)
            held = pose.stiffness("finger")
            assert found["support_x_N_per_m"][d, n] == pytest.approx(held.supports["x"], rel=1e-6)
            assert found.compliance[d, n] == pytest.approx(held.compliance, rel=1e-6, abs=1e-15)
            assert found["stress_MPa"][d, n] == pytest.approx(1e-6 * pose.stress().largest_Pa, rel=1e-9)
    soft = ksd.batch(jaw(softness=1e-4), y=STROKES, questions=("force", "stress"))
    assert "'grip' acts here and is soft" in soft.why(0, 0) and soft.status[0, 2] == 0
    assert soft["grip_normal_N"][0, 0] > 0.0 and np.isnan(soft["stress_MPa"][0, 0])


def test_refused_rows_carry_the_sentence_of_a_solve():
    # over another height the disc overlaps with the jaw at rest, and 40 mm cannot be reached
    found = ksd.batch(
        lambda at, **more: moved(at, **more), designs={"at": [0.0, 6 * mm, 0.0]}, y=[-1 * mm, -40 * mm]
    )
    assert (found.status[1] == NOT_BUILT).all() and "overlap at rest by" in found.why(1, 0)
    with pytest.raises(ksd.KsdError) as reason:
        ksd.solve(moved(0.0), y=-40 * mm)
    assert found.status[0].tolist() == found.status[2].tolist() and found.status[0, 0] == 0
    assert found.status[0, 1] in (NOT_SOLVED, REFUSED)
    assert str(reason.value)[:60] in found.why(0, 1) and np.isnan(found.forces["y"][0, 1])
    loose = ksd.batch(moved(0.0), y=[-1 * mm, -40 * mm], strict=False)
    assert np.isnan(loose.forces["y"][0, 1]) == (loose.status[0, 1] == NOT_SOLVED)


def moved(at):
    """A jaw with its disc lower by `at`, and a stop that its block meets."""
    scene = jaw()
    scene.surface("block", ksd.shapes.disc(5 * mm), at=(70 * mm, 11 * mm - at, 0), name="more")
    scene.contact(
        scene.surface("finger", ksd.shapes.wall(), at=(0.07, 5 * mm, 0), axis="y"), "more", name="second"
    )
    scene.stop("block", along="y", at=(70 * mm, 50 * mm, 0), low=-3 * mm, name="floor")
    return scene


def test_the_fast_methods_and_tables_are_refused_where_contacts_act():
    found = ksd.batch(jaw(), y=STROKES, method="full")
    assert found.solved == 0 or "only load steps on all leaf springs know" in found.why(0, 0)
    with pytest.raises(ksd.SceneError, match="tables know no stops, cables and contacts"):
        ksd.batch(jaw(), y=STROKES, tabulated=True)


def test_workers_of_an_executor_give_the_same():
    designs = {"friction": np.linspace(0.0, 0.5, 5)}
    own = ksd.batch(jaw, designs=designs, y=STROKES, questions="force", threads=1)
    with ThreadPoolExecutor(2) as pool:
        other = ksd.batch(jaw, designs=designs, y=STROKES, questions="force", executor=pool)
    for column in own.answers:
        assert np.array_equal(own[column], other[column])
