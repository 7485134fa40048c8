"""What the reference says of public names: every word that can be said is explained, errors that are raised are named."""

import inspect
import pkgutil
import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

import ksd

DOCS = Path(__file__).resolve().parents[2] / "docs"
sys.path.insert(0, str(DOCS))
REFERENCE = runpy.run_path(str(DOCS / "tables.py"))["REFERENCE"]
NAMES = [name for _, names in REFERENCE.values() for name in names.split()]
ALIKE = {"name", "path", "material", "elements", "orders", "configuration", "pose", "mechanism"}
"""Words that mean the same wherever they can be said: of joints they stand at the top of their page."""


def documented(name):
    """The docstring of a public name, those of its bases, and of what it refers to in backticks."""
    thing = pkgutil.resolve_name(f"ksd.{name}")
    said = (
        [inspect.getdoc(t) or "" for t in inspect.getmro(thing)]
        if isinstance(thing, type)
        else [inspect.getdoc(thing)]
    )
    for other in set(re.findall(r"`(?:ksd\.)?(\w+)", " ".join(said))) & set(ksd.__all__) - {name}:
        said.append(inspect.getdoc(getattr(ksd, other)) or "")
    return " ".join(" ".join(said).split())


def words(name):
    """What can be said to a public name, or read from it."""
    thing = pkgutil.resolve_name(f"ksd.{name}")
    if isinstance(thing, type) and issubclass(thing, BaseException):
        return []
    given = inspect.signature(thing).parameters.values()
    return [w.name for w in given if w.kind not in (w.VAR_KEYWORD, w.VAR_POSITIONAL) and w.name not in ALIKE]


@pytest.mark.parametrize("name", NAMES)
def test_every_word_and_field_is_explained(name):
    said = documented(name).lower()
    missing = [word for word in words(name) if not re.search(rf"\b{word.lower().rstrip('_')}", said)]
    assert not missing, f"the docstring of ksd.{name} says nothing of {', '.join(missing)}"


STEEL = ksd.Material(E=200e9, nu=0.3)


def guide():
    m = ksd.Mechanism("guide")
    stage, sheet = m.link("stage"), ksd.rectangle(5e-4, 0.02)
    for x in (0.0, 0.05):
        m.leaf(
            m.ground, stage, start=(x, 0, 0), end=(x, 0.1, 0), section=sheet, material=STEEL, width_axis="z"
        )
    m.actuate(stage, along="x", at=(0.025, 0.1, 0), name="push")
    return m


@pytest.fixture(scope="module")
def pose():
    return ksd.solve(guide(), push=1e-3)


NOWHERE = "/no folder/of this name"
JOINTS = {
    "CrossFlexure": {"length": -1, "angle": 1, "thickness": 1e-3, "widths": (1, 1)},
    "CrossedPivot": {"length": -1, "angle": 1, "thickness": 1e-3, "width": 1},
    "BalancedCrossedPivot": {"length": -1, "angle": 1, "thickness": 1e-3, "inner_width": 1, "outer_width": 1},
    "Cartwheel": {"length": -1, "angle": 1, "thickness": 1e-3, "width": 1},
    "Butterfly": {"length": -1, "inner": 1, "half_angle": 1, "thickness": 1e-3, "width": 1},
    "InfinityHinge": {"length": -1, "thickness": 1e-3, "width": 1},
    "TripleInfinityHinge": {"length": -1},
    "ParallelGuide": {"length": -1, "thickness": 1e-3, "width": 1, "spacing": 1},
    "StiffenedGuide": {"length": -1, "flexible": 0.3, "thickness": 1e-3, "width": 1, "spacing": 1},
    "CircularNotchHinge": {"radius": -1, "minimum": 1e-3, "width": 1},
    "FilletedNotchHinge": {"length": -1, "radius": 1, "minimum": 1e-3, "width": 1},
    "ArcHinge": {"radius": -1, "angle": 1, "thickness": 1e-3, "width": 1},
    "UniversalJoint": {"length": -1, "thickness": 1e-3, "width": 1},
    "FoldedLeaf": {"length": -1, "thickness": 1e-3, "width": 1},
    "WireFlexure": {"length": -1, "diameter": 1},
}
WRONG = {name: (lambda _, n=name, w=sizes: getattr(ksd, n)(STEEL, **w)) for name, sizes in JOINTS.items()} | {
    "Mechanism": lambda _: ksd.Mechanism("m", plane="xw"),
    "Material": lambda _: ksd.Material(E=-1.0, nu=0.3),
    "Leaf": lambda _: ksd.Leaf(
        start=(0, 0, 0), end=(0, 0, 0), width_axis=None, section=ksd.circle(1), material=STEEL
    ),
    "wire": lambda _: ksd.wire(diameter=-1, material=STEEL, start=(0, 0, 0), end=(1, 0, 0)),
    "Section": lambda _: ksd.Section(A=1, J=1, Iy=1, Iz=-1, ky=1, kz=1),
    "rectangle": lambda _: ksd.rectangle(1, -1),
    "circle": lambda _: ksd.circle(-1),
    "tube": lambda _: ksd.tube(1, 2),
    "polygon": lambda _: ksd.polygon([(0, 0)]),
    "numbers": lambda _: ksd.numbers(A=1, J=1, Iy=1, Iz=-1),
    "Arc": lambda _: ksd.Arc(radius=0, angle=1),
    "FreeCurve": lambda _: ksd.FreeCurve(-1, lambda s: 0),
    "Taper": lambda _: ksd.Taper(thickness=(0, 1), width=(1, 1)),
    "Varying": lambda _: ksd.Varying(3),
    "CircularNotch": lambda _: ksd.CircularNotch(radius=1, minimum=-1, width=1),
    "FilletedNotch": lambda _: ksd.FilletedNotch(length=1, radius=1, minimum=1, width=1),
    "StiffenedMiddle": lambda _: ksd.StiffenedMiddle(thickness=1, width=1, middle=1, part=2),
    "LinkMatrix": lambda _: ksd.LinkMatrix(((0, 0, 0), (1, 0, 0)), np.ones((12, 12)).tolist()),
    "link_matrix": lambda _: ksd.link_matrix(NOWHERE),
    "load_scene": lambda _: ksd.load_scene(NOWHERE),
    "save_scene": lambda _: ksd.save_scene(guide(), NOWHERE),
    "DrawnJoint": lambda _: ksd.DrawnJoint("j", blocks={"A": (0, 0, 0)}, leaves=[], motions=[]),
    "Motion": lambda _: ksd.Motion("m", "twist", (0, 0, 1), (0, 1)),
    "solve": lambda _: ksd.solve(guide(), pull=1),
    "compare": lambda _: ksd.compare(guide(), pull=1),
    "prepare": lambda _: ksd.prepare(3),
    "Solver": lambda _: ksd.Solver(ksd.compile_scene(guide()), mesh=ksd.Mesh()),
    "follow": lambda _: ksd.follow(guide(), {"push": 0.0}),
    "required_loads": lambda _: ksd.required_loads(guide(), {"table": 3}),
    "rest_shape": lambda _: ksd.rest_shape(guide()),
    "Mesh": lambda _: ksd.Mesh(orders=(1, 1, 1)),
    "ModalBasis": lambda _: ksd.ModalBasis(frame=np.zeros(3)),
    "compile_scene": lambda _: ksd.compile_scene(3),
    "doctor": lambda _: ksd.doctor(3),
    "live": lambda _: ksd.live(guide(), {"length": (1, 2)}),
    "sweep": lambda _: ksd.sweep(guide(), pull=1),
    "walk": lambda _: ksd.walk(guide(), []),
    "pull_out": lambda _: ksd.pull_out(ksd.solve(guide(), push=1e-3), "stage", along="x"),
    "batch": lambda _: ksd.batch(guide(), pull=1),
    "gradient": lambda _: ksd.gradient(guide(), pull=1),
    "Job": lambda _: ksd.Job(3, vary={}),
    "load_job": lambda _: ksd.load_job(NOWHERE),
    "optimise": lambda _: ksd.optimise(3),
    "pareto": lambda _: ksd.pareto(3, against="stress_MPa"),
    "choose": lambda _: ksd.choose(3),
    "tolerance": lambda _: ksd.tolerance(3, {}, spread={}),
    "frequency_curve": lambda _: ksd.frequency_curve(guide(), "pull", 1),
    "state_space": lambda pose: ksd.state_space(pose, modes=-1),
    "view.plot_mechanism": lambda pose: ksd.view.plot_mechanism(pose, view="xw"),
    "view.plot_mode": lambda pose: ksd.view.plot_mode(pose, mode=99),
    "view.plot_stroke": lambda _: ksd.sweep(guide(), push=0.0, questions="force").plot("stress"),
    "view.animate_stroke": lambda _: ksd.view.animate_stroke([], "a.gif"),
    "view.animate_mode": lambda pose: ksd.view.animate_mode(pose, "a.png"),
    "view.save_figure": lambda pose: ksd.view.save_figure(pose.plot(), NOWHERE),
    "view.show_mechanism": lambda pose: ksd.view.show_mechanism(pose, "a.txt"),
    "export.export": lambda pose: ksd.export.export(pose, "a.txt"),
    "export.write_dxf": lambda pose: ksd.export.write_dxf(pose, "a.txt"),
    "export.write_deck": lambda pose: ksd.export.write_deck(pose, "a.txt"),
    "export.confirm": lambda pose: ksd.export.confirm(pose, refine=0),
    "export.write_bodies": lambda pose: ksd.export.write_bodies(pose, "a.txt"),
    "importing.read_dxf": lambda _: ksd.importing.read_dxf(f"{NOWHERE}.dxf"),
    "importing.read_spacar": lambda _: ksd.importing.read_spacar(f"{NOWHERE}.mat"),
    "view.write_vtu": lambda pose: ksd.view.write_vtu(pose, "a.txt"),
    "view.write_page": lambda pose: ksd.view.write_page(pose, "a.txt"),
    "view.write_pvd": lambda _: ksd.view.write_pvd([], "a.pvd"),
    "train": lambda _: ksd.train("none of this name"),
    "find_record": lambda _: ksd.find_record("none of this name"),
    "read_result": lambda _: ksd.read_result(3),
    "simulate": lambda _: ksd.simulate(ksd.Mechanism("m"), -1.0),
    "stepper": lambda _: ksd.stepper(ksd.Mechanism("m")),
}
"""A call with something wrong, by name; all but what the package makes and what cannot go wrong."""


@pytest.mark.parametrize("name", WRONG)
def test_the_error_raised_is_named(name, pose):
    with pytest.raises(ksd.KsdError) as caught:
        WRONG[name](pose)
    kinds = [kind.__name__ for kind in type(caught.value).__mro__ if issubclass(kind, ksd.KsdError)][:-1]
    assert any(kind in documented(name) for kind in kinds), f"ksd.{name} says nothing of {kinds[0]}"
    assert "\n" not in str(caught.value).strip() and str(caught.value)[0] != "<"


def test_whatever_can_be_called_has_a_wrong_call():
    functions = {n for n in NAMES if not isinstance(pkgutil.resolve_name(f"ksd.{n}"), type)}
    assert functions - set(WRONG) == {"joint_families"}
