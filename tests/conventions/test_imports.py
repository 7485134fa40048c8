"""Imports go down the layers of the house, in no circle; heavy packages have one home each.

Counted are imports anywhere in a file, inside functions too, and modules named in strings to be loaded later. Those for type
checkers go down the layers as well and in no circle. The package itself
(`ksd/__init__.py`) loads everything on its first use and is left out.
"""

import ast
import re
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / "ksd"
LAYER = {
    "errors": 0, "units": 0, "checks": 0, "files": 0, "hdf5": 0, "html": 0, "version": 0, "extras": 0, "numerics": 1,
    "section": 2, "elements": 2, "scene": 3, "model": 4, "library": 4, "importing": 4, "joints": 5, "modal": 5,
    "answers": 5, "view": 6, "export": 7, "solvers": 8, "training": 9, "study": 9, "rest_shapes": 9, "pages": 10,
    "optimisation": 11, "interactive": 11, "cli": 12, "__main__": 13,
}  # fmt: skip
HOME = {
    "h5py": {"hdf5", "library"}, "skfem": {"section", "modal"}, "matplotlib": {"view"}, "pyvista": {"view"}, "vtk": {"view"},
    "numba": {"numerics"}, "nicegui": {"interactive"}, "tomlkit": {"interactive"},
}  # fmt: skip
NUMPY_ALONE = {"errors", "units", "checks", "files", "html", "scene"}


@cache
def named_in(source: str, *, types: bool = False) -> frozenset[str]:
    """The full names a file imports, or gives as a string like "ksd.room.file" or "ksd.room.file:function".

    types: those for type checkers too.
    """
    names, nodes = set[str](), [ast.parse(source)]
    while nodes:
        node = nodes.pop()
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {f"{'.' * node.level}{node.module or ''}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            names |= set(re.findall(r"^(ksd(?:\.\w+)+)(?::\w+)?$", node.value))
        for_types = isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        nodes += node.orelse if for_types and not types else ast.iter_child_nodes(node)
    return frozenset(names)


def module_name(path: Path) -> str:
    return ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__")


SOURCES = {module_name(path): path.read_text() for path in sorted(PACKAGE.rglob("*.py"))}
del SOURCES["ksd"]
NAMED = {module: named_in(source) for module, source in SOURCES.items()}


def module_of(name: str) -> str | None:
    """The module of the package in which a full name is, e.g. "ksd.scene.leaf" of "ksd.scene.leaf.Leaf"."""
    while name not in NAMED and "." in name:
        name = name.rpartition(".")[0]
    return name if name in NAMED else None


def room(module: str) -> str:
    return module.split(".")[1]


def goes_up(edge: tuple[str, str]) -> bool:
    here, there = map(room, edge)
    return here != there and (LAYER[here] <= LAYER[there] != 0)


def circle(edges: set[tuple[str, str]]) -> list[str]:
    """The modules of one circle, the first one again at the end; none where there is no circle."""
    sorter: TopologicalSorter[str] = TopologicalSorter()
    for here, there in edges:
        sorter.add(here, there)
    try:
        sorter.prepare()
    except CycleError as error:
        return error.args[1]
    return []


def edges_of(named: dict[str, frozenset[str]]) -> set[tuple[str, str]]:
    return {
        (here, there)
        for here, names in named.items()
        for there in map(module_of, names)
        if there is not None and there != here
    }


EDGES = edges_of(NAMED)


@cache
def typed_edges() -> set[tuple[str, str]]:
    """The edges of imports for type checkers too."""
    return edges_of({m: named_in(s, types=True) for m, s in SOURCES.items()})


def test_imports_go_down_and_in_no_circle():
    assert not [name for names in NAMED.values() for name in names if name.startswith(".")], "relative import"
    assert not sorted(filter(goes_up, EDGES))
    assert not circle(EDGES)


def test_types_come_from_the_layers_below_too():
    assert not sorted(filter(goes_up, typed_edges()))


def test_types_are_in_no_circle():
    assert not circle(typed_edges())


def test_kernels_are_plain_numba():
    """Nothing of the inside of the compiler, nothing handed over by its address."""
    for path in PACKAGE.rglob("*.py"):
        source = path.read_text()
        inside = [
            n for n in named_in(source) if re.match(r"llvmlite|numba\.(core|extending|np|typed|types)\b", n)
        ]
        assert not inside and ".ctypes" not in source, f"{path.name}: {inside or '.ctypes'}"


def test_heavy_packages_have_one_home_and_a_scene_needs_numpy_alone():
    heavy = {*HOME, "scipy", "rich"}
    for module, names in NAMED.items():
        for top in heavy & {name.split(".")[0] for name in names}:
            assert room(module) in HOME.get(top, {room(module)}), f"{module}: {top} belongs in {HOME[top]}"
            assert room(module) not in NUMPY_ALONE, f"{module}: {top}"


@pytest.mark.parametrize(
    "source",
    [
        "from ksd.model.newton import solve_equilibrium",
        "from ksd.model import newton",
        "def later():\n    import ksd.model.newton",
        "HOME = 'ksd.model.newton:solve_equilibrium'",
    ],
)
def test_the_check_itself_sees_an_import(source):
    assert {module_of(name) for name in named_in(source)} == {"ksd.model.newton"}
    assert goes_up(("ksd.elements.strain", "ksd.model.newton")) and not goes_up(
        ("ksd.model.newton", "ksd.elements.strain")
    )
    assert circle({("a", "b"), ("b", "c"), ("c", "a")}) and not circle({("a", "b"), ("b", "c"), ("a", "c")})
    assert not named_in("if TYPE_CHECKING:\n    from ksd.model.newton import solve_equilibrium")
