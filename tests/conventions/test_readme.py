"""The README is short, its script runs as printed, its commands exist, and its pictures are there."""

import argparse
import re
import subprocess
import sys
from pathlib import Path

import ksd
from ksd.cli.commands import parser

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "README.md").read_text()
PAGES = "".join(
    path.read_text() for folder in ("docs", "docs/how_to") for path in sorted((ROOT / folder).glob("*.md"))
)


def test_it_is_read_in_five_minutes():
    assert len(TEXT.splitlines()) <= 150


def test_the_script_runs_as_printed(tmp_path, monkeypatch, capsys):
    (script,) = re.findall(r"```python\n(.*?)```", TEXT, re.S)
    assert len([s for s in script.splitlines() if s.strip()]) <= 16
    script += "print(pose.stiffness('top'))\n"
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.chdir(tmp_path)
    exec(compile(script, "README.md", "exec"), {"__name__": "__main__"})
    printed = capsys.readouterr().out
    assert "521" in printed
    (shown,) = re.findall(r"```text\n(.*?)```", TEXT, re.S)
    assert shown.split() == printed[printed.index("Stiffness of link") :].split()


def test_the_two_commands_are_there():
    assert "pip install . && ksd demo" in TEXT
    assert "pip install '.[test]' && pytest" in TEXT


def test_pictures_exist():
    for path in re.findall(r"!\[.*?\]\((.*?)\)", TEXT):
        assert (ROOT / path).exists(), path


def test_one_version():
    for name, pattern in {"CITATION.cff": r"^version: (\S+)$", "CHANGELOG.md": r"^## (\S+) \("}.items():
        assert re.findall(pattern, (ROOT / name).read_text(), re.M)[0] == ksd.__version__, name


def test_every_command_line_named_exists():
    """Commands and their options in the README and in the changelog of this version."""
    newest = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text(), flags=re.M)[1]
    commands = next(a.choices for a in parser()._actions if isinstance(a, argparse._SubParsersAction))
    named = re.findall(r"`ksd\s+(\w+)([^`]*)`", TEXT + newest)
    assert len(named) > 20
    for word, rest in named:
        assert word in commands, word
        for option in re.findall(r"--[\w-]+", rest):
            assert option in commands[word].format_help(), f"ksd {word} {option}"


def test_every_name_of_the_package_is_reached_by_one_import(tmp_path):
    """`ksd.view.write_pvd` as printed, after `import ksd` alone; each in a process that has imported nothing else."""
    names = sorted(set(re.findall(r"\bksd(?:\.[A-Za-z_]\w*)+", TEXT + PAGES)))
    assert len(names) > 10 and "ksd.Mechanism" in names
    code = "import sys, ksd\nfor n in sys.argv[1:]:\n eval(n, {'ksd': ksd})"
    for group in ([n for n in names if n.startswith(f"ksd.{room}.")] for room in ("view", "modal")):
        done = subprocess.run([sys.executable, "-c", code, *group], capture_output=True, text=True, cwd=ROOT)
        assert done.returncode == 0, done.stderr
    done = subprocess.run([sys.executable, "-c", code, *names], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
