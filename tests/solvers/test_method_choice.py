"""The method that a prepared solver takes by itself: what it learns from its last poses; answers do not depend on it."""

import math
from copy import deepcopy

import numpy as np
import pytest
from scenes import cross_flexure, fourbar, single_joint

import ksd
from ksd.solvers.method_choice import FIVE_STEPS, LAST_RETRY, LOAD_STEPS, ONE_STEP, MethodChoice
from ksd.solvers.steps import Step, Stop


def told(choice, *poses, iterations=4):
    """A choice like this one after poses by ways that took a time; of load steps all with so many iterations."""
    choice = deepcopy(choice)
    for way, time in poses:
        if way == ONE_STEP:
            steps = [Step("equilibrium", iterations, time, 0.0, Stop.CONVERGED)]
        else:
            steps = [
                Step(n, 1, time / 3.0, 0.0, Stop.CONVERGED) for n in ("2 joint stiffness", "error estimate")
            ]
        choice.told(way, time, steps if time < math.inf else ())
    return choice


def test_both_ways_are_tried_and_the_faster_one_is_taken():
    choice = MethodChoice(FIVE_STEPS)
    way, why = choice.next
    assert way == FIVE_STEPS and why == "chosen first, for joints in space"
    choice, taken = told(choice, (FIVE_STEPS, 5.0), (ONE_STEP, 2.0)), [FIVE_STEPS, ONE_STEP]
    for _ in range(20):
        way, why = choice.next
        taken.append(way)
        choice = told(choice, (way, 1.0 if way == FIVE_STEPS else 2.0))
    assert sorted(taken[:4]) == sorted(2 * [FIVE_STEPS, ONE_STEP])
    # a pose that took long beside other programs is forgotten
    assert taken[10:].count(ONE_STEP) == 1 and why == "chosen as the fastest on the last poses"


def test_a_way_that_cannot_be_faster_is_not_tried():
    """A load step of four iterations at least, beside five steps that take as long as three."""
    choice = told(MethodChoice(FIVE_STEPS), *(2 * [(FIVE_STEPS, 1.0)]))
    assert choice.next[0] == FIVE_STEPS
    assert told(choice, *(2 * LAST_RETRY * [(FIVE_STEPS, 1.0)])).next[0] == FIVE_STEPS
    # where load steps take more iterations, the five steps are tried
    choice = MethodChoice(ONE_STEP)
    assert told(choice, *(2 * [(ONE_STEP, 1.0)]), iterations=3).next[0] == ONE_STEP
    assert told(choice, *(2 * [(ONE_STEP, 1.0)]), iterations=4).next[0] == FIVE_STEPS


def test_the_slower_way_is_tried_again_after_many_poses():
    choice, tried = told(MethodChoice(ONE_STEP), *(2 * [(ONE_STEP, 1.0)]), *(2 * [(FIVE_STEPS, 1.5)])), []
    assert choice.next[0] == ONE_STEP
    for n in range(300):
        way, why = choice.next
        if way == FIVE_STEPS:
            assert why == "chosen to see whether it is faster by now"
            tried.append(n)
            assert told(choice, (FIVE_STEPS, 0.5)).next[0] == FIVE_STEPS
        choice = told(choice, (way, 1.0 if way == ONE_STEP else 1.5))
    # after twice as many poses each time
    assert np.diff(tried).tolist() == [9, 17, 33, 65, 65, 65]


def test_more_work_takes_more_time():
    """Though the last poses took less."""
    choice = told(MethodChoice(ONE_STEP), *(4 * [(ONE_STEP, 1.0)]), *(2 * [(FIVE_STEPS, 1.5)]))
    assert choice.next[0] == ONE_STEP
    assert told(choice, (ONE_STEP, 2.0), iterations=10).faster == FIVE_STEPS


def test_full_at_once_where_the_reduced_state_was_too_far_off():
    choice, asked = MethodChoice(FIVE_STEPS), []
    for _ in range(25):
        asked.append(choice.needs_full)
        choice.told(FIVE_STEPS, 1.0, by_full=True)
    assert asked == [False, False, *(9 * [True]), False, *(9 * [True]), False, *(3 * [True])]
    assert not told(choice, (FIVE_STEPS, 1.0)).needs_full
    scene, targets = arm()
    solver = ksd.prepare(scene, accuracy=1e-6)
    solver(targets)
    solver._choice = told(choice, *(2 * [(ONE_STEP, 2.0)]))
    found = solver(targets)
    assert found.method == "full" and "error estimate" not in [s.name for s in found.steps]
    assert found.forces == pytest.approx(solver(targets, method="full").forces, rel=1e-12)


def test_a_way_that_fails_is_left():
    choice = told(MethodChoice(ONE_STEP), (ONE_STEP, 1.0), (FIVE_STEPS, 2.0), (ONE_STEP, math.inf))
    assert choice.ways[ONE_STEP].time == math.inf
    assert choice.next[0] == FIVE_STEPS and told(choice, (FIVE_STEPS, 2.0)).next[0] == ONE_STEP
    choice = told(choice, (FIVE_STEPS, math.inf))
    assert choice.next[0] == LOAD_STEPS
    for _ in range(2 * LAST_RETRY):
        choice.by_neither()
    assert choice.next[0] == FIVE_STEPS


def arm(count=3):
    """Joints about z and y in turns, each driven, a force at the end."""
    scene, x = ksd.Mechanism("arm"), 0.0
    before = scene.ground
    for k in range(count):
        link = scene.link(f"link {k}")
        placed = scene.join(
            before, link, cross_flexure(), at=(x, 0, 0), axis="zy"[k % 2], toward="x", name=f"j{k}"
        )
        scene.actuate_joint(placed, name=f"turn {k}")
        before, x = link, x + 0.2
    scene.load(before, force=(0, 2, -3), at=(x, 0, 0))
    return scene, {f"turn {k}": 0.3 for k in range(count)}


@pytest.mark.parametrize("accuracy", [1e-2, 1e-3, 1e-6])
def test_answers_are_within_the_accuracy_whatever_was_learned(accuracy):
    scene, targets = arm()
    solver, methods = ksd.prepare(scene, accuracy=accuracy), set()
    # the same answer by either way
    for choice in (
        None,
        told(MethodChoice(ONE_STEP), *(2 * [(ONE_STEP, 1.0)]), *(2 * [(FIVE_STEPS, 2.0)])),
        MethodChoice(FIVE_STEPS),
    ):
        for share in (0.1, 0.5, 1.0):
            values = {n: share * v for n, v in targets.items()}
            exact = np.array(list(solver(values, method="full").forces.values()))
            solver._choice = choice
            found = solver(values)
            forces = np.array(list(found.forces.values()))
            assert np.abs(forces - exact).max() <= accuracy * np.abs(exact).max()
            assert found.trusted and found.steps[-1].chosen.startswith("chosen ")
            methods.add(found.method)
    wanted = {1e-2: {"reduced"}, 1e-3: {"reduced", "full"}, 1e-6: {"full"}}[accuracy]
    assert methods == {"conventional", *wanted}


def test_a_rejected_estimate_goes_on_as_full():
    """From the state that its step leads to, with as many factorisations as `full` takes."""
    scene, targets = arm()
    solver = ksd.prepare(scene, accuracy=1e-5)
    found, full = solver(targets), solver(targets, method="full")
    assert found.method == "full" and found.method_error is None
    assert [s.name for s in found.steps[-2:]] == ["error estimate", "5 full equilibrium"]
    assert sum(s.iterations for s in found.steps) <= full.iterations
    assert np.abs(found.motion.x - full.motion.x).max() < 1e-12


def test_the_first_method_is_by_size_and_the_answer_says_why():
    for scene, targets in ((single_joint(), {"turn": 0.3}), (fourbar(), {"top": 0.1})):
        found = ksd.prepare(scene)(targets)
        assert found.method == "conventional"
        assert found.steps[-1].chosen == "chosen first, for a mechanism of one joint or in a plane"
        assert (
            "chosen first, for a mechanism of one joint or in a plane" in found.as_dict()["steps"][-1]["note"]
        )
        assert "chosen" not in found.branch
    scene, targets = arm()
    assert ksd.prepare(scene)(targets).steps[-1].chosen == "chosen first, for joints in space"
    assert ksd.prepare(scene)(targets, method="full").steps[-1].chosen == ""


def test_a_record_fitted_worse_than_the_accuracy_needs_the_full_model():
    scene, targets = arm()
    worst = ksd.find_record("cross_flexure").worst("strain")
    assert 1e-9 < worst < 1e-4
    for accuracy, names in ((1e-3, True), (1e-9, False)):
        found = ksd.prepare(scene, accuracy=accuracy)(targets)
        assert ("error estimate" in [s.name for s in found.steps]) == names


def test_a_pose_outside_the_trained_range_is_solved_and_says_why():
    """And the next ones take the five steps again, where those are faster."""
    scene, targets = arm()
    solver = ksd.prepare(scene)
    found = solver({**targets, "turn 0": 1.4})
    assert found.method == "conventional"
    assert any(w.startswith("conventional solver used: joint 'j0' would turn 80") for w in found.warnings)
    solver._choice = told(solver._choice, *(2 * [(ONE_STEP, 1.0)]))
    assert {solver(targets).method for _ in range(3)} & {"reduced", "full"}


def test_the_reason_without_a_record_is_said_every_time():
    scene, targets = arm()
    drawn = ksd.DrawnJoint(
        "no record", blocks={"A": (0, 0, 0), "B": (0.1, 0, 0)}, leaves=cross_flexure().leaves(),
        motions=[ksd.Motion("turn", "rotation", (0, 0, 1), (-0.5, 0.5))],
    )  # fmt: skip
    last = scene.link("last")
    scene.actuate_joint(
        scene.join("link 2", last, drawn, at=(0.6, 0, 0), axis="z", toward="x"), name="turn 3"
    )
    solver = ksd.prepare(scene)
    for _ in range(2):
        found = solver({**targets, "turn 3": 0.1})
        assert found.method == "conventional"
        assert any("conventional solver used: " in w and "no record" in w for w in found.warnings)
