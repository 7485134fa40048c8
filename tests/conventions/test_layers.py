"""Imports go down the layers of the house only, never between siblings; heavy packages have one home each."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / "ksd"
LAYER = {
    "errors": 0, "units": 0, "files": 0, "numerics": 0, "section": 1, "beam": 1, "scene": 2, "model": 3, "library": 3,
    "bodies": 4, "modal": 4, "properties": 4, "view": 4, "solve": 5, "train": 6, "design": 6, "bench": 6.5, "cli": 7,
    "__main__": 8,
}  # fmt: skip
BASE = {"errors", "units", "files"}
HOME = {
    "h5py": {"library"},
    "skfem": {"section", "modal"},
    "matplotlib": {"view"},
    "pyvista": {"view"},
    "vtk": {"view"},
    "numba": {"numerics"},
}
FILES = sorted(PACKAGE.rglob("*.py"))


def room(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported(path: Path):
    """(module, line, at top level) of every import in a file, type-checking blocks left out."""
    tree = ast.parse(path.read_text())
    typing_only = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    for node in ast.walk(tree):
        if id(node) in typing_only:
            continue
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield ("." * node.level + (node.module or ""), node.lineno)


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_go_down(path):
    here = room(path)
    if here == "__init__":
        return
    for module, line in imported(path):
        assert not module.startswith("."), f"{path}:{line}: relative import"
        parts = module.split(".")
        if parts[0] != "ksd" or len(parts) == 1:
            continue
        there = parts[1]
        if there == here or there in BASE:
            continue
        assert LAYER[there] < LAYER[here], (
            f"{path.name}:{line}: {here} (L{LAYER[here]}) imports {there} (L{LAYER[there]})"
        )


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_heavy_packages_have_one_home(path):
    for module, line in imported(path):
        top = module.split(".")[0]
        if top in HOME:
            assert room(path) in HOME[top], f"{path.name}:{line}: {top} belongs in {HOME[top]}"


def test_scene_needs_numpy_alone():
    for path in FILES:
        if room(path) in ("scene", "units", "errors", "files"):
            for module, line in imported(path):
                top = module.split(".")[0]
                assert top not in {"scipy", "numba", "skfem", "h5py", "matplotlib", "rich"}, f"{path}:{line}"


def test_the_check_itself_sees_an_upward_import(tmp_path):
    bad = tmp_path / "bad.py"
    bad.write_text("from ksd.solve.newton import iterate\n")
    assert [m for m, _ in imported(bad)] == ["ksd.solve.newton"]
    assert LAYER["solve"] > LAYER["beam"]
