"""Names, options and help texts of every command. Nothing heavy is imported to print the help."""

from __future__ import annotations

import argparse
from typing import Any

from ksd.version import __version__

DEMO_PICTURE = "ksd-demo.png"
"""Default file of the picture of `ksd demo`."""
DEFAULT_POSES = 31
"""Default number of poses of a stroke."""


_SHARED_OPTIONS: dict[str, dict[str, Any]] = {
    "scene": {"metavar": "SCENE.toml"},
    "--set": {
        "action": "append",
        "default": [],
        "metavar": "DRIVE=VALUE",
        "help": "a drive value, such as top=300mm or hinge=45deg; may be repeated",
    },
    "--method": {
        "help": "kinematic, reduced, full, conventional, modal or constant; by default the cheapest that is accurate enough"
    },
    "--accuracy": {
        "type": float,
        "metavar": "A",
        "help": "relative error allowed when no method is given (1e-3)",
    },
    "--elements": {
        "type": int,
        "metavar": "N",
        "help": "N Appendix A elements per leaf, not strain-mode leaves",
    },
    "--relinearisations": {
        "type": int,
        "metavar": "K",
        "help": "extra relinearisation steps of reduced or full",
    },
    "--extrapolate": {
        "action": "store_true",
        "default": None,
        "help": "use joint records beyond their range",
    },
    "--effects": {"metavar": "E", "help": "auto (what the scene mentions), all, or names: shear,gravity"},
    "--with": {"metavar": "E", "help": "effects to simulate besides, such as warping,plate"},
    "--without": {"metavar": "E", "help": "effects to leave out, such as shear"},
    "--order": {
        "metavar": "FIRST",
        "help": "what acts first, where that decides: loads (then drives), drives, or together",
    },
    "--json": {"metavar": "FILE", "help": "write every number; - is stdout, without tables"},
    "--plot": {"metavar": "FILE", "help": "write a picture (.png, .pdf, .svg) or a ParaView file (.vtu)"},
    "--quiet": {"action": "store_true", "help": "no progress bar"},
    "--out": {"metavar": "FILE", "help": "write the table: .csv, .h5 or .mat"},
}
"""Options that several commands share, with the arguments of `add_argument`."""
_SOLVER_OPTIONS = tuple(_SHARED_OPTIONS)[2:11]
"""Names of the options that control a solve."""


def _add_shared(parser: argparse.ArgumentParser, *words: str, **changes: str) -> None:
    """Add shared options `words` to a command; changes: arguments that differ for this command."""
    for word in words:
        parser.add_argument(word, **{**_SHARED_OPTIONS[word], **changes})


def _add_texts(parser: argparse.ArgumentParser, *options: tuple[str, str, str], **words: Any) -> None:
    """Add options that take a text: word, metavar and help of each; words: arguments of `add_argument` for all."""
    for word, name, text in options:
        parser.add_argument(word, metavar=name, help=text, **words)


_REPEATED: dict[str, Any] = {"action": "append", "default": []}


def _add_point(parser: argparse.ArgumentParser) -> None:
    """Add the options that say what is asked about, which [report] of a scene file may hold."""
    _add_texts(
        parser,
        (
            "--link",
            "LINK",
            "the link of support_stiffness and parasitic; that of the first drive if left out",
        ),
        (
            "--at",
            "X,Y,Z",
            "its point, undeformed, such as 0,80mm,0; if left out the reference point of LINK, without --link "
            "the place of the first drive",
        ),
        (
            "--along",
            "DIRECTION",
            "the wanted direction of parasitic, x, y, z or three numbers, such as 1,1,0",
        ),
    )
    help_text = "a drive or support that is let go for frequencies (all drives); may be repeated"
    _add_texts(parser, ("--freed", "DRIVE", help_text), **_REPEATED)


def _add_demo(commands: Any) -> None:
    parser = commands.add_parser(
        "demo",
        help="solve a fourbar by every method",
        description="Solve the fourbar of Dwarshuis et al. (2020), moved 300 mm sideways, by every method.",
    )
    parser.add_argument(
        "--plot", metavar="FILE", default=DEMO_PICTURE, help=f"file of the picture ({DEMO_PICTURE})"
    )
    parser.add_argument("--json", metavar="FILE", help="write the table; - is stdout, without the table")


def _add_solve(commands: Any) -> None:
    parser = commands.add_parser(
        "solve",
        help="solve a scene file",
        description="Solve one configuration of a scene; drive values come from the file or from --set.",
    )
    _add_shared(parser, "scene", "--set", *_SOLVER_OPTIONS, "--json", "--plot")
    parser.add_argument(
        "--side", metavar="N", type=float, help="1 or -1: side of a symmetric, unstable state that is taken"
    )


def _add_new(commands: Any) -> None:
    parser = commands.add_parser(
        "new",
        help="write a scene file to start from",
        description="Write NAME.toml, a commented scene that solves as it is, and ksd.schema.json next to it, with which "
        "editors complete and check its words. Existing files are not overwritten.",
    )
    parser.add_argument(
        "name",
        metavar="NAME",
        nargs="?",
        help="of the mechanism; NAME.toml is written (with --from: that of FILE)",
    )
    parser.add_argument(
        "--like",
        metavar="SCENE",
        help="pivot, guide, fourbar, gripper, arm ..., or pivot_job, a job for `ksd optimise` (pivot)",
    )
    help_text = "centre lines of a drawing (.dxf), or input of SPACAR Light (.mat)"
    parser.add_argument("--from", dest="from_", metavar="FILE", help=help_text)
    _add_texts(
        parser,
        (
            "--layers",
            "leaf=NAME,...",
            "layers of the drawing with leaf, link and pin, where they have other names",
        ),
        ("--unit", "UNIT", "of the drawing, where it does not say it: mm, in ..."),
        ("--join", "LENGTH", "distance within which ends in the drawing meet (0.05mm)"),
        ("--thickness", "LENGTH", "of leaf springs of which the drawing does not tell it (0.5mm)"),
        ("--width", "LENGTH", "the same (10mm)"),
    )


def _add_export(commands: Any) -> None:
    parser = commands.add_parser(
        "export",
        help="write a scene for other programs: DXF, STL, 3MF, STEP, CalculiX",
        description="A drawing with flat patterns of the sheets (dxf), or leaf springs and links as bodies (stl, 3mf, "
        "step), deformed as the drive values of the scene say; in mm.",
    )
    _add_shared(parser, "scene")
    parser.add_argument(
        "--to", metavar="KIND", help="dxf, stl, 3mf, step, vtu or calculix; the ending of --out when left out"
    )
    parser.add_argument("--out", metavar="FILE", help="the file; beside the scene when left out")
    parser.add_argument("--undeformed", action="store_true", help="bodies as they are at rest")
    _add_texts(
        parser,
        ("--view", "PLANE", "of the drawing: xy, xz or yz"),
        ("--margin", "LENGTH", "by which sheets go on in their clamps (10mm)"),
        ("--hole", "LENGTH", "diameter of holes in the margins (none)"),
        ("--tolerance", "LENGTH", "largest distance of a free curve from its polyline (0.001mm)"),
    )
    _add_shared(parser, "--set", *_SOLVER_OPTIONS)


def _add_confirm(commands: Any) -> None:
    parser = commands.add_parser(
        "confirm",
        help="solve a scene again by CalculiX, with solids",
        description="Solve the pose of a scene, solve it again with solids by CalculiX (ccx must be installed), and show "
        "forces and positions of both, their difference, and what of it effects explain that the model leaves out.",
    )
    _add_shared(parser, "scene", "--set", *_SOLVER_OPTIONS)
    parser.add_argument(
        "--refine", action="store_true", help="also on a mesh twice as fine; it takes many times as long"
    )


def _add_schema(commands: Any) -> None:
    parser = commands.add_parser(
        "schema",
        help="print the JSON schema of scene or job files",
        description="The JSON schema by which editors complete and check scene files; the first line '#:schema ./FILE' of a "
        "scene names it.",
    )
    parser.add_argument("--job", action="store_true", help="that of the job files of `ksd optimise`")
    parser.add_argument("--out", metavar="FILE", help="write it here; stdout when left out")


def _add_compare(commands: Any) -> None:
    parser = commands.add_parser(
        "compare",
        help="one pose of a scene by every method: answer, time, error",
        description="Solve the pose of a scene by every method, and show each answer beside its time and its error against "
        "finer leaf springs. Methods that cannot do it say why.",
    )
    _add_shared(parser, "scene", "--set")
    parser.add_argument("--method", action="append", metavar="M", help="only this one; may be repeated")
    _add_shared(parser, "--elements", help="elements per leaf in the rows that have such (5)")
    _add_shared(parser, "--extrapolate", "--effects", "--with", "--without", "--out")
    _add_shared(parser, "--plot", help="write time against error (.png, .pdf, .svg)")
    _add_shared(parser, "--quiet")


def _add_effects(commands: Any) -> None:
    parser = commands.add_parser(
        "effects",
        help="what every effect of a scene changes and costs",
        description="Solve a scene with and without every effect it can have, and show what each changes in the drive "
        "forces, displacements, support stiffness and first frequency, and what it costs in time and unknowns.",
    )
    _add_shared(parser, "scene", "--set")
    _add_shared(parser, "--accuracy", help="line drawn in the picture (1e-3)")
    _add_shared(parser, "--json")
    _add_shared(parser, "--plot", help="write the bars (.png, .pdf, .svg)")


def _add_doctor(commands: Any) -> None:
    parser = commands.add_parser(
        "doctor",
        help="count freedoms and constraints of a scene",
        description="Say what is under-constrained, what is redundant, and which release would make the mechanism exact.",
    )
    _add_shared(parser, "scene")
    _add_shared(parser, "--json", help="write counts and sentences; - is stdout, without text")


def _add_live(commands: Any) -> None:
    parser = commands.add_parser(
        "live",
        help="move and draw a mechanism in the browser",
        description="Serve a page on this machine with the mechanism in three dimensions and in a plane view to draw in, "
        "sliders for drives and loads, and the numbers that follow them. A file that is not there is drawn from nothing.",
    )
    _add_shared(parser, "scene", "--set", *_SOLVER_OPTIONS)
    port_help = "first port that is tried (8160); 0 is any free one"
    parser.add_argument("--port", type=int, default=8160, metavar="N", help=port_help)
    parser.add_argument(
        "--host", default="127.0.0.1", help="address to serve on (127.0.0.1, this machine alone)"
    )
    parser.add_argument(
        "--shared", action="store_true", help="let other machines see and change it, with --host"
    )
    parser.add_argument("--no-browser", action="store_true", help="print the address only")


def _add_vibration(parser: argparse.ArgumentParser) -> None:
    """Words of random vibration and of damping."""
    help_text = "a spectrum [unit^2/Hz], such as 'base y=1:1e-3,200:1e-3'; may be repeated"
    _add_texts(parser, ("--psd", "INPUT=HZ:DENSITY,...", help_text), **_REPEATED)
    help_text = "of all modes (0.01), of each (0.01,0.02), Rayleigh's (5:0.01,100:0.02, by Hz), or materials"
    parser.add_argument("--damping", metavar="RATIO", help=help_text)


def _add_sweep(commands: Any) -> None:
    parser = commands.add_parser(
        "sweep",
        help="answer all questions over the stroke",
        description="Everything that the scene has an answer to, or the questions named, at every pose of a "
        "stroke. Several drives with a range are combined, the last one moving along the stroke.",
    )
    _add_shared(parser, "scene")
    help_text = (
        f"a range FROM:TO or FROM:TO:POSES ({DEFAULT_POSES} poses), such as top=0mm:300mm:31, or one value; "
        "may be repeated"
    )
    _add_shared(parser, "--set", metavar="DRIVE=RANGE", help=help_text)
    help_text = (
        "force, drive_stiffness, support_stiffness, frequencies, vibration, stress, parasitic, energy, buckling, size, "
        "clearance or distance; may be repeated"
    )
    _add_texts(parser, ("--question", "Q", help_text), **_REPEATED)
    _add_vibration(parser)
    _add_point(parser)
    _add_shared(parser, *_SOLVER_OPTIONS, "--out")
    _add_shared(parser, "--plot", help="write a picture of the answers (.png, .pdf, .svg)")
    parser.add_argument(
        "--resume", metavar="FILE", help="save finished poses in this file; run again with it to continue"
    )
    _add_shared(parser, "--quiet")


def _add_optimise(commands: Any) -> None:
    parser = commands.add_parser(
        "optimise",
        help="find the best design of a job",
        description="The design whose worst target is best under limits and rules. A job file names a scene file, or holds "
        "the scene, and says in its [job] what to vary, maximise or minimise, and limit.",
    )
    parser.add_argument("job", metavar="JOB.toml")
    _add_shared(
        parser,
        "--set",
        metavar="DRIVE=RANGE",
        help="drive values, such as turn=0deg:30deg:3; may be repeated",
    )
    help_text = "where to start, such as joint.cross.thickness=0.4mm; all that varies, or none for the middle of the bounds"
    parser.add_argument("--start", action="append", default=[], metavar="NAME=VALUE", help=help_text)
    parser.add_argument("--starts", type=int, metavar="N", help="starts, the others random (1)")
    _add_shared(
        parser,
        "--method",
        help="gradient (the default), trust-constr, cobyla, or cma, which needs the package cma",
    )
    help_text = "move limits in by K standard deviations of the [optimise.spread] of the file"
    parser.add_argument("--robust", type=float, metavar="K", help=help_text)
    parser.add_argument("--seed", type=int, metavar="S", help="of the random starts (0)")
    parser.add_argument(
        "--resume", metavar="FILE", help="save every design in this file; run again with it to continue"
    )
    _add_shared(parser, "--out", help="write every design that was tried: .csv, .h5 or .mat")
    _add_shared(parser, "--json")
    _add_shared(parser, "--plot", help="write a picture of the search (.png, .pdf, .svg)")
    parser.add_argument("--report", metavar="FILE", help="write an HTML page")
    parser.add_argument("--save", metavar="FILE", help="write the optimum as a scene file")
    _add_shared(parser, "--quiet")


def _add_respond(commands: Any) -> None:
    parser = commands.add_parser(
        "respond",
        help="what sensors see when a scene is driven or shaken",
        description="Frequency responses about a pose, from drive forces, loads and a shaken base to sensors and drive "
        "motions; with --psd root mean squares under random vibration.",
    )
    _add_shared(parser, "scene", "--set", *_SOLVER_OPTIONS)
    freed = "a drive or support that is let go, by default those of [report], else drives that are inputs or outputs"
    _add_texts(
        parser,
        ("--input", "NAME", "a drive (its force) or a load of the scene; may be repeated"),
        ("--base", "AXIS", "shake the base along x, y, z or about rx, ry, rz; may be repeated"),
        ("--output", "NAME", "a sensor or a drive; may be repeated"),
        ("--freed", "DRIVE", f"{freed}; may be repeated"),
        **_REPEATED,
    )
    help_text = "FROM:TO or FROM:TO:POINTS, such as 1Hz:2kHz:500; around the modes if left out"
    parser.add_argument("--frequencies", metavar="RANGE", help=help_text)
    _add_vibration(parser)
    help_text = "number of modes; chosen by the frequencies if left out"
    parser.add_argument("--modes", type=int, metavar="N", help=help_text)
    _add_shared(parser, "--out", help="write gain, phase and error: .csv")
    _add_shared(parser, "--json")
    _add_shared(parser, "--plot", help="write a Bode plot (.png, .pdf, .svg)")


def _add_simulate(commands: Any) -> None:
    parser = commands.add_parser(
        "simulate",
        help="how a scene moves in time",
        description="The motion that [simulate] of a scene says: places, forces, sensors and energies over time.",
    )
    _add_shared(parser, "scene")
    _add_shared(
        parser, "--set", help="a drive value, or a word of [simulate], such as until=2s; may be repeated"
    )
    _add_shared(parser, "--out", help="write all signals: .csv, .h5 or .mat")
    parser.add_argument(
        "--film",
        metavar="FILE",
        help="write the motion as an animation, .gif, or as a page to turn by hand, .html",
    )
    _add_shared(parser, "--json")
    _add_shared(parser, "--plot", help="write a plot over time (.png, .pdf, .svg)")
    _add_shared(parser, "--quiet")


def _add_report(commands: Any) -> None:
    parser = commands.add_parser(
        "report",
        help="write an HTML report of a scene",
        description="Solve a scene and its stroke, and write one HTML page that needs no network: scene, what was "
        "simulated, pictures, tables, convergence and error.",
    )
    _add_shared(parser, "scene")
    parser.add_argument("--out", metavar="FILE", help="the page; SCENE.html beside the scene when left out")
    _add_shared(
        parser, "--set", help="a drive value at the end of the stroke, such as top=300mm; may be repeated"
    )
    _add_point(parser)
    _add_shared(parser, "--method", "--effects", "--with", "--without", "--order")
    parser.add_argument(
        "--poses", type=int, default=DEFAULT_POSES, metavar="N", help=f"poses of the stroke ({DEFAULT_POSES})"
    )
    parser.add_argument("--both", action="store_true", help="stroke from minus to plus the drive values")
    _add_shared(parser, "--quiet")
    parser.set_defaults(accuracy=None, elements=None, relinearisations=None, extrapolate=None)


def _add_train(commands: Any) -> None:
    parser = commands.add_parser(
        "train",
        help="train the record of a joint family",
        description="Sweep a joint's own finite element model over stroke and shape; write its record.",
    )
    parser.add_argument("family", metavar="FAMILY", help="for example cross_flexure, or all")
    parser.add_argument(
        "--out", metavar="FOLDER", help="where the record goes; $KSD_DATABASE or ./database when left out"
    )
    parser.add_argument(
        "--restart", action="store_true", help="train also where the record is up to date, and from the start"
    )
    parser.add_argument(
        "--check", action="store_true", help="train, compare with the record in use, and write nothing"
    )
    _add_shared(parser, "--quiet")


def _add_info(commands: Any) -> None:
    parser = commands.add_parser(
        "info",
        help="what the joint database holds",
        description="List the joint records: trained ranges, errors on fresh shapes, age, checksum. With a FAMILY all that "
        "is known of it: source, symmetry, closed-form stiffness, evidence of what matters, errors mesh by mesh.",
    )
    parser.add_argument("family", nargs="?", metavar="FAMILY", help="name of a joint family")
    parser.add_argument(
        "--check", action="store_true", help="solve the probe states of the record again and compare"
    )


def _add_bench(commands: Any) -> None:
    parser = commands.add_parser(
        "bench",
        help="measure time and error of every method",
        description="Compare every method on the shipped scenes, interleaved, each as `ksd compare` does.",
    )
    parser.add_argument("--quick", action="store_true", help="fewer calls of each method")
    parser.add_argument("--case", metavar="WORD", action="append", help="only scenes whose name holds WORD")
    _add_shared(parser, "--json")


COMMANDS = {
    "demo": _add_demo, "new": _add_new, "solve": _add_solve, "compare": _add_compare, "effects": _add_effects,
    "doctor": _add_doctor, "live": _add_live, "sweep": _add_sweep, "respond": _add_respond, "simulate": _add_simulate,
    "optimise": _add_optimise, "report": _add_report, "export": _add_export, "confirm": _add_confirm, "train": _add_train,
    "info": _add_info, "bench": _add_bench, "schema": _add_schema,
}  # fmt: skip
"""Function that adds the parser of each command, in the order of the help; the module `ksd.cli.<name>` runs it."""


def parser() -> argparse.ArgumentParser:
    """The parser of all commands; `options.command` is the one that was given, None without, and `options.refuse` prints its
    usage with a sentence and exits."""
    top = argparse.ArgumentParser(
        prog="ksd",
        description="Deformed configurations of flexure mechanisms in large deflection, from fast to exact.",
        epilog="To begin: `ksd new mine`, then `ksd solve mine.toml`; `ksd COMMAND --help` explains one. "
        "Exit codes: 0 solved, 2 bad input, 3 not converged, 4 joint record missing or damaged, 130 interrupted.",
    )
    top.add_argument("--version", action="version", version=f"ksd {__version__}")
    commands = top.add_subparsers(title="commands", metavar="COMMAND", dest="command")
    for add in COMMANDS.values():
        add(commands)
    # an unknown argument is refused by its command, with the usage of that command
    for command in (top, *commands.choices.values()):
        command.set_defaults(refuse=command.error)
    return top
