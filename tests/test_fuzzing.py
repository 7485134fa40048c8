"""Two thousand random scenes, calls and files: answered or refused in one sentence. 50,000: `benchmarks/fuzz.py`."""

import fuzzing
import pytest
import strategies
from hypothesis import HealthCheck, given, settings
from scenes import single_joint

import ksd

QUIET = [HealthCheck.too_slow, HealthCheck.function_scoped_fixture, HealthCheck.data_too_large]


def examples(count):
    """The same examples in every run."""
    return settings(
        max_examples=count, deadline=None, database=None, derandomize=True, suppress_health_check=QUIET
    )


@examples(100)
@given(strategies.leaf_scenes())
def test_leaves_in_any_arrangement(case):
    fuzzing.solved(*case)


@examples(60)
@given(strategies.joint_scenes())
def test_a_joint_of_any_shape(case):
    fuzzing.solved(*case)


@examples(600)
@given(strategies.broken_calls())
def test_calls_with_a_wrong_word(case):
    fuzzing.called(*case)


@pytest.fixture(scope="module")
def joint():
    return single_joint().scene()


@examples(250)
@given(strategies.broken_questions())
def test_solving_with_a_wrong_word(joint, words):
    with fuzzing.strictly():
        try:
            found = ksd.solve(joint, **{"turn": 0.3, **words})
        except ksd.KsdError as error:
            fuzzing.is_sentence(error)
        else:
            fuzzing.check_answer(found)


@examples(800)
@given(strategies.scene_files)
def test_scene_files_of_any_bytes(tmp_path, content):
    fuzzing.loaded(content, tmp_path / "scene.toml")


def test_the_undamaged_file_is_accepted(tmp_path):
    assert fuzzing.loaded(strategies.STORED.encode(), tmp_path / "scene.toml")


@pytest.mark.parametrize("name", strategies.CALLS)
def test_the_right_words_are_accepted(name):
    started = strategies._started()
    strategies.CALLS[name](started, {})
