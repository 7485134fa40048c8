"""Every Python block of the documentation's pages runs, and the commands the pages name exist."""

import argparse
import pkgutil
import re
import runpy
import sys
from pathlib import Path

import pytest

import ksd
from ksd.cli.commands import parser

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGES = sorted(
    path for path in DOCS.rglob("*.md") if not {"_made", "gallery", "tutorial", "build"} & set(path.parts)
)
NAMES = [str(path.relative_to(DOCS)) for path in PAGES]
sys.path.insert(0, str(DOCS))
without_page = runpy.run_path(str(DOCS / "tables.py"))["without_page"]
run_blocks = runpy.run_path(str(DOCS / "blocks.py"))["run_blocks"]


@pytest.mark.parametrize("page", [n for n in NAMES if "```python\n" in (DOCS / n).read_text()])
def test_blocks_of_a_page_run_in_order(page, monkeypatch, tmp_path):
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.chdir(tmp_path)
    shown = list(run_blocks(page, (DOCS / page).read_text()))
    assert any(printed or figure for printed, figure in shown), "the page shows no answer"


@pytest.mark.parametrize("page", NAMES)
def test_commands_of_a_page_exist(page):
    commands = next(
        a.choices for a in parser(ksd.__version__)._actions if isinstance(a, argparse._SubParsersAction)
    )
    text = (DOCS / page).read_text()
    named = re.findall(r"`ksd +([a-z]\w*)([^`]*)`", text) + re.findall(
        r"^(?:\$ )?ksd ([a-z]\w*)(.*)$", text, re.M
    )
    for word, rest in named:
        assert word in commands, f"{page}: ksd {word}"
        for option in re.findall(r"(?<!\S)--[\w-]+", rest):
            assert option in commands[word].format_help(), f"{page}: ksd {word} {option}"


@pytest.mark.parametrize("page", NAMES)
def test_what_a_page_points_at_exists(page):
    """Tests by file and name, files of the repository, and modules or names of the package."""
    text = (DOCS / page).read_text()
    for file, name in re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", text):
        source = (DOCS.parent / file).read_text()
        assert not name or f"def {name}(" in source, f"{page}: {file}::{name}"
    for path in re.findall(r"`((?:benchmarks|examples|ksd)/[\w./]+)`", text):
        assert (DOCS.parent / path).exists(), f"{page}: {path}"
    for name in re.findall(r"`(ksd(?:\.\w+)+)", text):
        pkgutil.resolve_name(name)


def test_a_block_that_fails_is_found_with_its_line():
    text = "# page\n\n```python\na = 1\nprint(a)\n```\n\n```python\nprint(a)\na / 0\n```\n"
    shown = run_blocks("page.md", text)
    assert next(shown) == ("1\n", None)
    with pytest.raises(ZeroDivisionError) as caught:
        next(shown)
    assert caught.traceback[-1].lineno + 1 == 10


def test_every_public_name_is_on_a_page_of_the_reference():
    assert not without_page(), "name them in docs/tables.py"
