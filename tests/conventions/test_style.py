"""Lint (docstrings of all that is public among it), types, words the house does without, and a light import."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TEXTS = {".py", ".md", ".toml", ".txt", ".json", ".csv", ".cff", ".svg", ""}


@pytest.mark.parametrize(
    "command",
    [["ruff", "check", "."], ["ruff", "format", "--check", "."], ["mypy"]],
    ids=["lint", "format", "types"],
)
def test_checked_by_tools(command):
    done = subprocess.run([sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_modules_held_to_strict_types_exist():
    config = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["mypy"]["overrides"]
    named = [name.removesuffix(".*") for override in config for name in override["module"]]
    assert len(named) > 10
    for name in named:
        path = ROOT.joinpath(*name.split("."))
        assert path.is_dir() or path.with_suffix(".py").is_file(), name


def test_no_vague_names():
    for path in (ROOT / "ksd").rglob("*.py"):
        vague = re.findall(r"^(?:class|def) (\w*(?:Manager|Utils|Helper)\w*)", path.read_text(), re.M)
        assert not vague, f"{path}: {vague}"


def test_no_file_names_a_path_of_one_machine():
    own = re.compile(r"(?<![\w.\]}])/(?:home|Users|root|work|tmp|mnt)/\w+")
    files = [path for path in ROOT.glob("*.*") if path.suffix]
    files += [
        path
        for room in ("ksd", "tests", "benchmarks", "examples", "docs", ".ci")
        for path in (ROOT / room).rglob("*")
    ]
    texts = [path for path in files if path.is_file() and path.suffix in TEXTS]
    assert len(texts) > 300
    for path in texts:
        found = own.findall(path.read_text())
        assert not found, f"{path}: {found}"
    assert own.findall("see " + "/ho" + "me/someone")


def test_import_is_light():
    code = (
        "import sys, ksd; heavy = {'numba', 'scipy', 'h5py', 'skfem', 'matplotlib', 'rich'} & set(sys.modules);"
        "assert not heavy, heavy; from ksd import Mechanism, CrossFlexure;"
        "heavy = {'numba', 'scipy', 'h5py', 'skfem', 'matplotlib'} & set(sys.modules); assert not heavy, heavy"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
