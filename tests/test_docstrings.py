"""Every public name has an example in its docstring; it runs, and gives what it says.

Examples begin after the imports that the reference names.
"""

import doctest
import runpy
import sys
from pathlib import Path

import pytest

import ksd

DOCS = Path(__file__).resolve().parents[1] / "docs"
sys.path.insert(0, str(DOCS))
DOCSTRINGS = runpy.run_path(str(DOCS / "docstrings.py"))
START = {}
exec(DOCSTRINGS["START"], START)
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
NOT_RUN = {"live"}
"""Names whose examples cannot run here; `live` waits for a browser: tests/interactive."""


def example(name):
    """The example of a public name as a doctest."""
    finder = doctest.DocTestFinder(recurse=False, exclude_empty=False)
    (found,) = finder.find(getattr(ksd, name), f"ksd.{name}", module=False, globs=START)
    return found


def says_something(test):
    """Whether a part of an example that runs has an answer to be compared, or asserts one."""
    skipped = doctest.SKIP
    parts = [part for part in test.examples if not part.options.get(skipped)]
    return any(part.want or part.exc_msg or part.source.startswith("assert ") for part in parts)


# what earlier tests left open is none of theirs
@pytest.mark.filterwarnings("error", "ignore::ResourceWarning")
@pytest.mark.parametrize("name", ksd.__all__)
def test_the_example_of_a_name_runs(name, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    test = example(name)
    assert test.examples, f"the docstring of ksd.{name} has no example"
    skipped = any(part.options.get(doctest.SKIP) for part in test.examples)
    assert skipped == (name in NOT_RUN), f"the example of ksd.{name} is skipped"
    assert skipped or says_something(test), f"the example of ksd.{name} prints and asserts nothing"
    said = []
    failed, _ = doctest.DocTestRunner(optionflags=FLAGS).run(test, out=said.append)
    assert not failed, "".join(said)


@pytest.mark.parametrize(
    "text, expected",
    [
        (">>> x = 1\n", False),
        (">>> x = 1\n>>> x\n1\n", True),
        (">>> assert True\n", True),
        (">>> 1  # doctest: +SKIP\n1\n", False),
    ],
)
def test_an_example_that_shows_nothing_is_found(text, expected):
    test = doctest.DocTestParser().get_doctest(text, {}, "x", None, None)
    assert says_something(test) is expected


def test_the_pose_of_an_example_is_drawn_on_the_site(tmp_path):
    text = ksd.CrossedPivot.__doc__
    lines = DOCSTRINGS["drawn_pose"](tmp_path / "ksd.CrossedPivot.png", text[text.index(">>>") :])
    assert (tmp_path / "ksd.CrossedPivot.png").stat().st_size > 5000
    assert lines[0] == ".. image:: /_made/poses/ksd.CrossedPivot.png"
