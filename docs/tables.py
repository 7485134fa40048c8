"""Pages of the site made from the package and from results of the benchmarks, so that no number is typed by hand."""

from __future__ import annotations

from pathlib import Path

import ksd

RESULTS = Path(__file__).resolve().parents[1] / "benchmarks" / "results"

REFERENCE = {
    "Scenes": (
        "What a mechanism is made of.",
        "Mechanism Material Leaf wire Section rectangle circle tube polygon numbers Arc FreeCurve Taper Varying "
        "CircularNotch FilletedNotch StiffenedMiddle LinkMatrix link_matrix Scene load_scene save_scene",
    ),
    "Joints": (
        "Families of flexure joints, and joints of your own.",
        "Joint CrossFlexure CrossedPivot BalancedCrossedPivot Cartwheel Butterfly InfinityHinge TripleInfinityHinge "
        "ParallelGuide StiffenedGuide CircularNotchHinge FilletedNotchHinge ArcHinge UniversalJoint FoldedLeaf "
        "WireFlexure DrawnJoint Motion joint_families",
    ),
    "Solving": (
        "From a scene to its deformed configuration.",
        "solve prepare Solver Configuration follow Path required_loads RequiredLoads Mesh ModalBasis compile_scene Model "
        "doctor",
    ),
    "Designing": (
        "Over strokes and designs: tables, gradients, optimum, tolerances.",
        "sweep Table batch Batch gradient Gradient Job optimise Optimum pareto Front choose Choice tolerance Tolerance "
        "frequency_curve state_space SweepInterrupted",
    ),
    "Joint database": ("Training and reading joint records.", "train Design Parameter Record find_record read_result"),
    "Errors": (
        "What is raised, each with one sentence that says what to do.",
        "KsdError SceneError RangeError RecordError KinematicsError ConvergenceError TrustError",
    ),
}
"""Page of the reference: what it is about, and the public names on it."""
CALLED = {"solve": "ksd.solve.solver.solve", "train": "ksd.train.run.train"}
"""Packages that can be called: the function that answers."""


def directive(name: str) -> str:
    """What autodoc is asked of a public name."""
    found = getattr(ksd, name)
    kind = "class" if isinstance(found, type) else "function"
    if isinstance(found, type) and issubclass(found, Exception):
        kind = "exception"
    members = "\n   :members:\n   :inherited-members: tuple, Exception" if kind == "class" else ""
    return f".. auto{kind}:: ksd.{name}{members}\n"


def reference(folder: Path) -> None:
    """A page for every group of public names; a public name without a page stops the build."""
    named = {name for _, names in REFERENCE.values() for name in names.split()}
    if missing := {name for name in ksd.__all__ if not hasattr(ksd, name) or name not in named} - {"errors", "units"}:
        raise ValueError(f"docs/tables.py has no page for {', '.join(sorted(missing))}")
    folder.mkdir(exist_ok=True)
    pages = []
    for title, (about, names) in REFERENCE.items():
        page = title.lower().replace(" ", "_")
        pages.append(page)
        body = "\n".join(directive(name) for name in names.split())
        (folder / f"{page}.rst").write_text(f"{title}\n{'=' * len(title)}\n\n{about}\n\n{body}")
    listed = "\n".join(f"   {page}" for page in pages)
    (folder / "index.rst").write_text(f"Reference\n=========\n\n.. toctree::\n\n{listed}\n")


def write_tables(folder: Path) -> None:
    """Write the pages of `folder` that are made when the site is built."""
    folder.mkdir(exist_ok=True)
    reference(folder / "reference")
