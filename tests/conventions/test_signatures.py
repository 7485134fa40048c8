"""What users call: names that completion shows, documented, every parameter and answer with its type."""

import inspect
from dataclasses import is_dataclass
from importlib import import_module

import numpy as np
import pytest

import ksd
from ksd.solvers.configuration import Configuration
from ksd.solvers.solver import Solver

ROOMS = ("library", "modal", "scene", "section", "study", "training", "view")
BY_NAME = {"drives", "labels", "parameters"}
"""What may stand for words of the user's own: drive values, columns of a table, parameters of a joint family."""


def callables():
    """(name, function) of every public function, constructor and method of what the package and its rooms hold."""
    found = {f"ksd.{n}": getattr(ksd, n) for n in ksd.__all__}
    for room in ROOMS:
        module = import_module(f"ksd.{room}")
        found |= {f"ksd.{room}.{n}": getattr(module, n) for n in module.__all__}
    seen = set()
    for name, thing in found.items():
        if id(thing) in seen or (inspect.ismodule(thing) and not callable(thing)) or not callable(thing):
            continue
        seen.add(id(thing))
        yield name, thing
        if isinstance(thing, type) and thing.__module__.startswith("ksd"):
            for method in dir(thing):
                own = inspect.getattr_static(thing, method)
                theirs = any(method in vars(c) for c in thing.__mro__ if c.__module__.startswith("ksd"))
                if not method.startswith("_") and theirs:
                    yield f"{name}.{method}", own


CALLABLES = dict(callables())


def plain(thing):
    """The function of a method or property, None for what has none (constants of a class)."""
    for kind, word in ((property, "fget"), (staticmethod, "__func__"), (classmethod, "__func__")):
        if isinstance(thing, kind):
            return getattr(thing, word)
    return getattr(thing, "func", thing) if callable(getattr(thing, "func", thing)) else None


@pytest.mark.parametrize("name", CALLABLES)
def test_documented_with_types_and_real_parameters(name):
    function = plain(CALLABLES[name])
    if function is None:
        return
    assert inspect.getdoc(CALLABLES[name]) or inspect.getdoc(function), f"{name} has no docstring"
    if isinstance(function, type):
        if issubclass(function, Exception) or function.__init__ is object.__init__:
            return
        function = function.__init__
        if not inspect.isfunction(function):
            return
    elif inspect.signature(function).return_annotation is inspect.Signature.empty:
        raise AssertionError(f"{name} does not say what it returns")
    for word, parameter in inspect.signature(function).parameters.items():
        if word in ("self", "cls"):
            continue
        assert parameter.annotation is not parameter.empty, f"{name}: {word} has no type"
        assert word not in ("kwargs", "args"), f"{name}: {word} hides what may be said"
        if parameter.kind is parameter.VAR_KEYWORD:
            assert word in BY_NAME, f"{name}: **{word} hides what may be said"


NUMBERS = {"float", "int", "float | None", "int | None"}
ALIKE = {
    "ksd.rectangle": "thickness times width, as every drawing has it; exchanged ones are doubted by their size",
    "ksd.tube": "two diameters, the outer one being the larger",
    "ksd.Parameter": "two bounds, which must rise",
    "ksd.Batch.why": "the two indices of the arrays of a batch, in their order",
}
"""Functions with numbers by position, and why they may be."""
MADE_BY_KSD = {"Optimum", "Gradient", "Batch", "Tolerance", "Case", "CaseResult", "Measurement"}
MADE_BY_KSD |= {"FrequencyCurve", "Evidence", "Residual", "Stroke", "Listing"}
"""Answers, which users read and never make."""


@pytest.mark.parametrize("name", CALLABLES)
def test_numbers_of_unlike_meaning_have_names(name):
    """`Material(200 * GPa, 0.3)` took .3 for a shear modulus: of two numbers only the first has a meaning by its place."""
    function = plain(CALLABLES[name])
    if function is None or name in ALIKE or name.rpartition(".")[2] in MADE_BY_KSD:
        return
    if isinstance(function, type) and issubclass(function, Exception):
        return
    parameters = [p for p in inspect.signature(function).parameters.values() if p.name != "self"]
    by_place = [
        p.name
        for p in parameters
        if p.kind is p.POSITIONAL_OR_KEYWORD
        and (p.annotation in NUMBERS or p.annotation in (float, int, "tuple[float, float]"))
    ]
    assert len(by_place) < 2, f"{name} takes {' and '.join(by_place)} by position"


def test_what_completion_shows_of_the_package():
    shown = {n for n in dir(ksd) if not n.startswith("_")}
    assert shown == set(ksd.__all__)
    assert all(getattr(ksd, room) for room in ksd._ROOMS)
    held = set(ksd._HOME) | {kept.__name__.rpartition(".")[2] for kept in (*errors(), ksd.errors, ksd.units)}
    assert set(ksd.__all__) == held
    assert len(ksd.__all__) == len(held)
    for name in shown:
        assert getattr(ksd, name) is not None


def errors():
    return [e for e in vars(ksd.errors).values() if isinstance(e, type) and issubclass(e, Exception)]


def test_what_completion_shows_of_an_answer():
    shown = {n for n in dir(Configuration) if not n.startswith("_")}
    own = {n for n in shown if n in ("stiffness", "frequencies", "buckling", "stress", "forces", "trust")}
    assert len(own) == 6
    pose = object.__new__(Configuration)
    inside = {
        "unreduced_state",
        "unreduced_equilibrium",
        "refinement_start",
        "equilibrium",
        "joint_motions",
        "joints_near_intended",
    }
    assert not inside & set(dir(pose)) and not inside & set(dir(Configuration))
    assert not hasattr(Configuration, "__getattr__")
    for name in ("motions", "unintended", *own):
        assert name in dir(pose)
    with pytest.raises(AttributeError, match="stifness"):
        pose.stifness  # noqa: B018


def test_answers_are_documented_dataclasses():
    module = vars(import_module("ksd.solvers.configuration"))
    for question in ("stiffness", "drive_stiffness", "frequencies", "buckling", "stress", "internal_stress",
                     "interface_forces", "parasitic", "pivot_shift", "shape"):  # fmt: skip
        said = inspect.signature(getattr(Configuration, question)).return_annotation
        answer = module[said]
        assert is_dataclass(answer) and inspect.getdoc(answer), question


def test_solver_takes_the_words_of_prepare():
    said = inspect.signature(ksd.prepare).parameters
    mine = inspect.signature(Solver).parameters
    assert set(said) | {"records"} == set(mine)
    for word in set(said) - {"accuracy"}:
        assert said[word].default == mine[word].default or said[word].default is mine[word].default


def test_wire_refuses_words_it_does_not_know():
    with pytest.raises(ksd.SceneError, match=r"wire: it has no option 'diametre'; did you mean \"diameter\""):
        ksd.wire(diametre=1e-3, material=None, start=(0, 0, 0), end=(1, 0, 0))
    with pytest.raises(ksd.SceneError, match="wire: missing a required argument: 'end'"):
        ksd.Mechanism().wire("ground", "arm", diameter=1e-3, material=None, start=np.zeros(3))
