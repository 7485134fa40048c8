"""`ksd info`: what the joint database holds."""

from __future__ import annotations

import argparse
import math
from typing import Any

from ksd.cli.output import console
from ksd.errors import RecordError

_PER_RADIAN = 180 / math.pi
_UNITS = {
    "interface": "rad and joint lengths",
    "blocks": "rad and joint lengths",
    "rotations": "rad",
    "amplitudes": "1/leaf length",
    "wrench": "EI/L^2 and EI/L of the leaf",
}


def add(commands: Any) -> argparse.ArgumentParser:
    """The parser of this command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "info",
        help="what the joint database holds",
        description="List the joint records: trained ranges, errors on fresh shapes, age, checksum.",
    )
    return parser


def run(options: argparse.Namespace) -> int:
    """Print all records. Raises RecordError when there are none or one is damaged."""
    import ksd
    from ksd.library import describe_database, record_folders

    screen = console()
    folders = [f"{f}" + ("" if f.is_dir() else " (none)") for f in record_folders()]
    screen.print(
        f"ksd {ksd.__version__}; joint records are looked for in: {', '.join(folders)}", soft_wrap=True
    )
    listings = describe_database()
    if not listings:
        raise RecordError("there are no joint records; run `ksd train cross_flexure`")
    for listing in listings:
        screen.print()
        screen.print(_entry(listing))
    damaged = [entry.family for entry in listings if entry.problem]
    if damaged:
        raise RecordError(
            f"record '{damaged[0]}' cannot be used; run `ksd train {damaged[0]}` or restore the file"
        )
    return 0


def _entry(listing: Any) -> Any:
    """One record as a borderless table of two columns."""
    from rich.table import Table
    from rich.text import Text

    table = Table(
        box=None,
        show_header=False,
        pad_edge=False,
        title=listing.family,
        title_justify="left",
        title_style="bold",
    )
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    for name, value in _rows(listing):
        table.add_row(name, Text(value))
    return table


def _rows(listing: Any) -> list[tuple[str, str]]:
    file = [("file", f"{listing.path}, {listing.size / 1024:.0f} kB"), ("sha256", listing.checksum)]
    if listing.problem:
        return [*file, ("problem", listing.problem)]
    age = "" if math.isnan(listing.age) else f", {listing.age:.0f} days ago"
    return [
        *file,
        *[(f"motion {m.name}", _stroke(m)) for m in listing.motions],
        *[(f"shape {p.name}", _range(p)) for p in listing.parameters],
        ("meshes", ", ".join(str(m) for m in listing.meshes) + " (numbers: Appendix A elements per leaf)"),
        *[
            (f"error {group}", f"{worst:.2g} at most on fresh shapes, in {_UNITS.get(group, '1')}")
            for group, worst in listing.worst
        ],
        ("trained", f"{listing.trained}{age}, by ksd {listing.version}, format {listing.format}"),
    ]


def _stroke(motion: Any) -> str:
    if motion.kind == "rotation":
        return f"{motion.low * _PER_RADIAN:.4g} to {motion.high * _PER_RADIAN:.4g} deg"
    return f"{motion.low:.4g} to {motion.high:.4g} joint lengths"


def _range(parameter: Any) -> str:
    if "angle" in parameter.name:
        return f"{parameter.low * _PER_RADIAN:.4g} to {parameter.high * _PER_RADIAN:.4g} deg"
    return f"{parameter.low:.4g} to {parameter.high:.4g}"
