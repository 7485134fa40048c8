"""Sizes, docstrings and words the house asks for."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FILES = sorted((ROOT / "ksd").rglob("*.py"))


def code_lines(source: str) -> set[int]:
    """Lines that are code: no blanks, comments or docstrings."""
    prose = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node):
            prose.update(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    lines = source.splitlines()
    return {i for i, s in enumerate(lines, 1) if s.strip() and not s.strip().startswith("#")} - prose


def is_kernel(node: ast.FunctionDef) -> bool:
    return any(word in ast.unparse(d) for d in node.decorator_list for word in ("kernel", "isolated", "late"))


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_sizes(path):
    source = path.read_text()
    live = code_lines(source)
    assert len(live) <= 300, f"{len(live)} code lines"
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef) and not is_kernel(node):
            size = len([i for i in live if node.lineno <= i <= node.end_lineno])
            assert size <= 40, f"{node.name} has {size} code lines"
            positional = len(node.args.posonlyargs) + len(node.args.args)
            assert positional <= 6, f"{node.name} has {positional} positional arguments"


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_public_things_are_documented(path):
    tree = ast.parse(path.read_text())
    assert not path.read_text().strip() or ast.get_docstring(tree), "module docstring missing"
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            assert ast.get_docstring(node), f"{node.name} has no docstring"
            for word in ("Manager", "Utils", "Helper"):
                assert word not in node.name


def test_nothing_unfinished_is_left():
    words = [a + b for a, b in (("TO", "DO"), ("FIX", "ME"), ("HA", "CK"))]
    for path in FILES:
        for word in words:
            assert word not in path.read_text(), f"{path}: {word}"


@pytest.mark.parametrize("command", [["check"], ["format", "--check"]], ids=["lint", "format"])
def test_ruff(command):
    done = subprocess.run([sys.executable, "-m", "ruff", *command, str(ROOT)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_types():
    done = subprocess.run([sys.executable, "-m", "mypy"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_import_is_light():
    code = (
        "import sys, ksd; heavy = {'numba', 'scipy', 'h5py', 'skfem', 'matplotlib', 'rich'} & set(sys.modules);"
        "assert not heavy, heavy; from ksd import Mechanism, CrossFlexure;"
        "heavy = {'numba', 'scipy', 'h5py', 'skfem', 'matplotlib'} & set(sys.modules); assert not heavy, heavy"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
