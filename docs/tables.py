"""Pages of the site made from the package and from results of the benchmarks, so that no number is typed by hand."""

from __future__ import annotations

import argparse
import inspect
import pkgutil
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import numpy as np
from docstrings import START, by_parameter, run_example
from figures import css_width
from measured import write_measured

import ksd
import ksd.view
from ksd.answers.printing import PrintableAnswer
from ksd.cli.commands import parser
from ksd.cli.solve import OPTIONS
from ksd.optimisation import job_file
from ksd.scene import toml_schema as schema
from ksd.scene.toml_schema import SHAPE_CLASSES
from ksd.solvers.configuration import INSIDE
from ksd.training.family_description import closed_form, describe_family
from ksd.units import DIMENSIONS

REFERENCE = {
    "Scenes": (
        "What a mechanism is made of.",
        "Mechanism Material Leaf wire Section rectangle circle tube polygon numbers Arc FreeCurve Taper Varying "
        "CircularNotch FilletedNotch StiffenedMiddle LinkMatrix link_matrix Scene load_scene save_scene",
    ),
    "Joints": (
        "Families of flexure joints, and joints of your own. All take a `Material`, and as `elements` or `orders` a mesh of "
        "every leaf spring of theirs (see `Leaf`); left out, `accuracy` decides.",
        "Joint CrossFlexure CrossedPivot BalancedCrossedPivot Cartwheel Butterfly InfinityHinge TripleInfinityHinge "
        "ParallelGuide StiffenedGuide CircularNotchHinge FilletedNotchHinge ArcHinge UniversalJoint FoldedLeaf "
        "WireFlexure DrawnJoint Motion joint_families",
    ),
    "Solving": (
        "From a scene to its deformed configuration.",
        "solve compare prepare Solver Configuration follow Path walk Walk pull_out required_loads "
        "RequiredLoads rest_shape RestShape Mesh ModalBasis compile_scene Model "
        "doctor",
    ),
    "Moving": (
        "Motion in time, and the functions of time that drives, loads and the base follow.",
        "simulate History stepper Stepper MovingState Ramp Cycloid Trapezoid HalfSine Sine Step TimeTable Shake Event "
        "Simulation",
    ),
    "Designing": (
        "Over strokes and designs: tables, gradients, optimum, tolerances.",
        "sweep Table batch Batch gradient Gradient "
        "Job JobFile load_job optimise Optimum pareto Front choose Choice tolerance Tolerance "
        "frequency_curve state_space SweepInterrupted",
    ),
    "Answers": (
        "What questions to a `Configuration` return: each prints as a table and holds arrays in SI units.",
        "answers.stiffness.PointStiffness answers.stiffness.DriveStiffness answers.frequencies.Modes "
        "answers.buckling.Buckling answers.stress.Stress answers.stress.LeafStress answers.strength.Strength "
        "answers.parasitic.Parasitic answers.parasitic.PivotShift answers.forces.SectionForces "
        "answers.forces.InterfaceForces answers.forces.InterfaceForce answers.link_forces.LinkForces "
        "answers.link_forces.LinkForce answers.internal_stress.Misplaced answers.extent.Clearance "
        "answers.verify.Verification answers.doctor.Diagnosis answers.plant.Plant solvers.response.Response "
        "solvers.random_vibration.RandomVibration solvers.shock.Shock solvers.grasp.Grasp "
        "study.frequency_curve.FrequencyCurve study.state_space.StateSpace study.history.Spectrum",
    ),
    "Pictures": (
        "Drawn with matplotlib, without a display; `Configuration.plot`, `Table.plot` and `Configuration.view` call them.",
        "view.plot_mechanism view.plot_mode view.plot_stroke view.animate_stroke view.animate_mode "
        "view.save_figure view.show_mechanism view.write_vtu view.write_pvd view.write_page live",
    ),
    "Exchange": (
        "Files of other programs: `Configuration.export`, `ksd export` and `ksd new --from` call them.",
        "export.export export.write_dxf export.write_bodies importing.read_dxf importing.read_spacar",
    ),
    "Joint database": (
        "Training and reading joint records.",
        "train Design Parameter Record find_record read_result",
    ),
    "Errors": (
        "What is raised, each with one sentence that says what to do.",
        "KsdError SceneError RangeError RecordError ResumeError SceneFileError UnknownNameError UnknownWordError "
        "KinematicsError ConvergenceError TrustError SceneWarning",
    ),
}
"""Page of the reference: what it is about, and the public names on it."""
CALLED = {"solve": "ksd.solvers.solver.solve", "train": "ksd.training.run.train"}
"""Packages that can be called: the function that answers."""


def directive(name: str) -> str:
    """What autodoc is asked of a public name."""
    found = pkgutil.resolve_name(f"ksd.{name}")
    kind = "class" if isinstance(found, type) else "function"
    if isinstance(found, type) and issubclass(found, Exception):
        kind = "exception"
    members = "\n   :members:\n   :inherited-members: tuple, Exception" if kind == "class" else ""
    if found is ksd.Configuration:
        members += f"\n   :exclude-members: {', '.join(sorted(INSIDE))}"
    return f".. auto{kind}:: ksd.{name}{members}\n"


def without_page() -> set[str]:
    """Public names that are on no page of the reference: those of `ksd` and `ksd.view`, and every class of answers."""
    named = {name for _, names in REFERENCE.values() for name in names.split()}
    for module in pkgutil.walk_packages(ksd.__path__, "ksd."):
        if module.name.startswith(
            ("ksd.answers", "ksd.study", "ksd.optimisation", "ksd.rest_shapes", "ksd.solvers")
        ):
            import_module(module.name)
    own = {pkgutil.resolve_name(f"ksd.{name}") for name in named}
    answers = {
        f"{kind.__module__}.{kind.__name__}" for kind in PrintableAnswer.__subclasses__() if kind not in own
    }
    pictures = {f"view.{name}" for name in ksd.view.__all__}
    return ((set(ksd.__all__) | pictures) - named - {"errors", "units"}) | answers


def reference(folder: Path) -> None:
    """A page for every group of public names."""
    folder.mkdir(exist_ok=True)
    pages = []
    for title, (about, names) in REFERENCE.items():
        page = title.lower().replace(" ", "_")
        pages.append(page)
        body = "\n".join(directive(name) for name in names.split())
        start = f"Examples begin after ``{START.strip().replace(chr(10), '; ')}``."
        (folder / f"{page}.rst").write_text(f"{title}\n{'=' * len(title)}\n\n{about} {start}\n\n{body}")
    pages.append("units")
    factors = "\n".join(f"   ``{name}``, {value:g}" for name, value in unit_factors().items())
    (folder / "units.rst").write_text(
        f"Units\n=====\n\n{inspect.getdoc(ksd.units)}\n\n"
        f".. csv-table:: Names of ``ksd.units``, and what they are in SI\n\n{factors}\n"
    )
    listed = "\n".join(f"   {page}" for page in pages)
    (folder / "index.rst").write_text(f"Reference\n=========\n\n.. toctree::\n\n{listed}\n")


def range_text(motion: ksd.Motion) -> str:
    """The range of an intended motion of a joint in words."""
    if motion.kind == "rotation":
        low, high = np.degrees(motion.range)
        return f"{motion.name}: {low:.3g} to {high:.3g} degrees"
    return f"{motion.name}: {1e3 * motion.range[0]:.3g} to {1e3 * motion.range[1]:.3g} mm"


def joints(folder: Path) -> None:
    """The catalogue of joints: a picture of each, its closed-form stiffness beside the solved one, and its range."""
    said = "Pictures, and numbers of the closed forms, are those of the examples in the [reference](reference/joints.rst)."
    lines = ["# Joints", "", said, ""]
    (folder / "joints").mkdir(exist_ok=True)
    for family, kind in ksd.joint_families().items():
        said = inspect.getdoc(kind) or ""
        made = run_example(said[said.index(">>>") :])
        joint, pose = made["joint"], made["pose"]
        path = folder / "joints" / f"{family}.png"
        pose.plot().savefig(path, dpi=110)
        rows = [("range", range_text(motion)) for motion in joint.motions]
        about = dict(describe_family(family)) | dict(closed_form(joint) if joint.motions else [])
        rows += [(word, about[word]) for word in ("closed form", "typical ranges", "source") if word in about]
        rows += [("shape", ", ".join(joint.shape())), ("in a scene file", f'`family = "{family}"`')]
        lines += [f"## {kind.__name__}", "", " ".join(said.split("\n\n")[0].split()), ""]
        lines += [
            f"```{{image}} joints/{family}.png",
            f":alt: {kind.__name__}",
            f":width: {css_width(path)}",
            "```",
            "",
        ]
        lines += ["| | |", "|---|---|", *(f"| {label} | {text} |" for label, text in rows if text), ""]
    (folder / "joints.md").write_text("\n".join(lines))


def unit_factors() -> dict[str, float]:
    """The names of `ksd.units` and their factors."""
    return {name: value for name, value in vars(ksd.units).items() if isinstance(value, float)}


def command_line(folder: Path) -> None:
    """The help of every command."""
    words = parser()
    words.prog = "ksd"
    commands = next(a.choices for a in words._actions if isinstance(a, argparse._SubParsersAction))
    lines = []
    for name, command in commands.items():
        command.prog = f"ksd {name}"
        lines += [f"## ksd {name}", "", "```text", command.format_help().rstrip(), "```", ""]
    (folder / "commands.md").write_text("\n".join(lines))


KINDS = {
    "length": "length", "angle": "angle", "stress": "stress", "number": "number", "text": "text", "flag": "true or false",
    "direction": '`"x"`, `"-z"` or three numbers', "material": "name of a material", "section": "name of a section",
    "joint": "name of a joint", "any": "as said above", "value": "length or angle",
    "names": "a list of names", "terms": "a list of tables, see there", "parts": "tables of their own, see there",
}  # fmt: skip
"""What a kind of `ksd.scene.toml_schema` is called."""


OPTION = {str: "text", float: "number", int: "number", bool: "flag"}
"""The same of the types of [options]."""
PARTS = ("blocks", "shape", "leaf", "wire", "motion")
"""Tables of a drawn joint."""


def kind_of(kind: str) -> str:
    """A kind of the schema in words: "length[3]!" is "3 x length, required"."""
    name, _, size = kind.removesuffix("!").partition("[")
    size = size.removesuffix("]")
    many = f"{size} x " if size else "one or a list: " if kind.removesuffix("!").endswith("[]") else ""
    return many + KINDS.get(name, name) + (", **required**" if kind.endswith("!") else "")


def of_family(family: type[ksd.Joint]) -> schema.Schema:
    """Keys of a joint; a list only where it takes one."""
    given = inspect.signature(family).parameters
    return {
        key: kind.replace("[]", "") if str(given[key].annotation).startswith("float") else kind
        for key, kind in schema.family_schema(family).items()
    }


def keys(title: str, table: schema.Schema, *sources: object) -> list[str]:
    """What the docstrings of `sources` say of a table of a scene file, and its keys with their kinds."""
    lines = [f"### {title}", ""]
    for source in sources:
        names = set(table) | set(inspect.signature(source).parameters)  # type: ignore[arg-type]
        for paragraph in (inspect.getdoc(source) or "").partition("\n>>>")[0].split("\n\n"):
            said = " ".join(paragraph.split()).partition("Raises ")[0].strip()
            lines += by_parameter(said, names) if said else []
    rows = [f"| `{key}` | {kind_of(kind)} |" for key, kind in table.items()]
    return [*lines, "| key | kind |", "|---|---|", *rows, ""]


def scene_tables() -> Iterator[tuple[str, schema.Schema, tuple[object, ...]]]:
    """Every table of a scene file: title, its keys, and what says about it."""
    sizes = {"leaf": {**schema.SIZES["leaf"], **schema.SIZES["rectangle"]}, "wire": schema.SIZES["wire"]}
    # one way or the other
    sizes["leaf"] = {key: kind.rstrip("!") for key, kind in sizes["leaf"].items()}
    more = sizes | {"actuate": {"terms": "terms", "value": "value"}, "support": {"terms": "terms"}}
    more["stop"] = {"terms": "terms", "low": "value", "high": "value", "softness": "softness"}
    more["cable"] = {"via": "terms"}
    about = {"leaf": (ksd.Leaf,), "wire": (ksd.Leaf,), "support": (ksd.Mechanism.actuate,)}
    yield "Top of the file", schema.TOP, (ksd.Mechanism,)
    yield "[material.NAME]", schema.MATERIAL, (ksd.Material,)
    for kind, table in schema.SECTIONS.items():
        yield (
            f'[section.NAME], kind = "{kind}"',
            table,
            (getattr(ksd, kind), *[ksd.Section] * (kind == "numbers")),
        )
    for word, table in schema.STATEMENTS.items():
        yield f"[[{word}]]", table | more.get(word, {}), (getattr(ksd.Mechanism, word), *about.get(word, ()))
        if word == "wire":
            for key, shapes in schema.SHAPES.items():
                for kind, own in shapes.items():
                    yield (
                        f'[leaf.{key}] or [wire.{key}], kind = "{kind}"',
                        own,
                        (SHAPE_CLASSES[key][kind][1],),
                    )
        if word == "cable":
            yield "[[cable.via]]", schema.VIA, ()
        if word == "support":
            yield (
                "[[actuate.terms]] or [[support.terms]] or [[stop.terms]]",
                schema.TERM,
                (ksd.Mechanism.displacement,),
            )
    for name, family in sorted(ksd.joint_families().items()):
        yield f'[joint.NAME], family = "{name}"', of_family(family), (family,)
    yield '[joint.NAME], family = "drawn"', schema.DRAWN | dict.fromkeys(PARTS, "parts"), (ksd.DrawnJoint,)
    for kind in ("leaf", "wire"):
        yield f"[[joint.NAME.{kind}]]", schema.LEAF | schema.BLOCKS | sizes[kind], (ksd.Leaf,)
    for kind, table in schema.MOTIONS.items():
        own = {key: said for key, said in table.items() if key != "kind"}
        yield f'[[joint.NAME.motion]], kind = "{kind}"', own, (ksd.Motion,)
    yield "[simulate]", schema.SIMULATE, (ksd.Simulation,)
    yield "[simulate.base]", {"along": "direction!", "acceleration": "any!"}, (ksd.Shake,)
    yield "[report]", schema.REPORT, ()
    yield "[options]", {key: OPTION[kind] for key, kind in OPTIONS.items()}, ()


def scene_format(folder: Path) -> None:
    """Every table of a scene file with its keys, from the schema that reads it."""
    lines = [line for title, table, about in scene_tables() for line in keys(title, table, *about)]
    said = (inspect.getdoc(job_file) or "").partition("\n")[2].strip("\n")
    jobs = [
        "```text",
        inspect.cleandoc(said.rpartition("\n\n")[0]),
        "```",
        "",
        said.rpartition("\n\n")[2],
        "",
    ]
    jobs += keys("[job]", job_file.JOB_KEYS) + keys("[optimise]", job_file.OPTIMISE_KEYS)
    (folder / "job_tables.md").write_text("\n".join(jobs))
    units = ["| quantity | units |", "|---|---|"]
    units += [
        f"| {name} | {', '.join(f'`{unit}`' for unit in found)} |" for name, found in DIMENSIONS.items()
    ]
    (folder / "units.md").write_text("\n".join(units) + "\n")
    (folder / "scene_tables.md").write_text("\n".join(lines))


def write_tables(folder: Path) -> None:
    """Write the pages of `folder` that are made when the site is built."""
    folder.mkdir(exist_ok=True)
    command_line(folder)
    scene_format(folder)
    write_measured(folder / "measured")
    reference(folder / "reference")
    joints(folder)
