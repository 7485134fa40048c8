"""`ksd info`: what the joint database holds."""

from __future__ import annotations

import argparse
import math
from typing import Any

from rich.table import Table
from rich.text import Text

import ksd
from ksd.checks import name_hint
from ksd.cli.output import console
from ksd.errors import RecordError, SceneError
from ksd.library import describe_database, read_record, record_folders
from ksd.scene import joint_families
from ksd.training import check_probes, design_of, known_designs
from ksd.training.family_description import count_function_parities, describe_family

_PER_RADIAN = 180 / math.pi
PAYING_LEAVES = 24
"""Leaf springs of a mechanism in space from which records pay by a fifth of the time or more (`benchmarks/pays.py`)."""
_UNITS = {
    "interface": "rad and joint lengths",
    "blocks": "rad and joint lengths",
    "rotations": "rad",
    "amplitudes": "1/leaf length",
    "wrench": "EI/L^2 and EI/L of the leaf",
}


def run(options: argparse.Namespace) -> int:
    """Print all records. Raises RecordError when there are none or one is damaged."""
    if options.family is not None:
        return _print_family(options.family, check=options.check)
    if options.check:
        raise SceneError("ksd info --check needs the name of a family")
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
        screen.print(_two_columns(listing.family, _listing_rows(listing)))
    damaged = [entry.family for entry in listings if entry.problem]
    if damaged:
        raise RecordError(
            f"record '{damaged[0]}' cannot be used; run `ksd train {damaged[0]}` or restore the file"
        )
    return 0


def _print_family(family: str, *, check: bool) -> int:
    """Print all that is known of one family. Raises SceneError for an unknown name, RecordError for a damaged record and,
    with `check`, for one that does not agree with the solver.
    """
    listings = {entry.family: entry for entry in describe_database()}
    known = sorted({*listings, *joint_families()})
    if family not in known:
        raise SceneError(f"joint family {family!r} is unknown{name_hint(family, known)}")
    screen, rows = console(), describe_family(family)
    listing = listings.get(family)
    if listing is None:
        none = "none, and none needed: a flexible constraint, added by Mechanism.constrain"
        rows.append(("record", f"none; run `ksd train {family}`" if family in known_designs() else none))
        screen.print(_two_columns(family, rows))
        return 0
    if listing.problem:
        raise RecordError(listing.problem)
    record = read_record(listing.path)
    signs = ", ".join(f"{n} {word}" for word, n in count_function_parities(record).items())
    rows.append(("functions", f"in the (first) motion {signs}"))
    fitted, fresh = record.samples
    rows.append(("shapes", f"{fitted} fitted, {fresh} others to check the fit"))
    rows += [("history", sentence) for sentence in record.history]
    if check:
        design = design_of(family) if family in known_designs() else None
        # a single joint trained under the name of a family has numbers of its own
        drawn = design is not None and dict(design.numbers) == dict(record.design)
        rows.append(("checked", check_probes(record, design if drawn else None)))
    screen.print(_two_columns(family, [*rows, *_listing_rows(listing)]))
    screen.print()
    screen.print(_evidence_table(record))
    screen.print()
    screen.print(_residual_table(record))
    return 0


def _evidence_table(record: Any) -> Any:
    """Table of the change of the record's functions with each input."""
    table = _headed_table(
        "What matters: largest change of the functions in the middle of the shapes",
        *("<input", "<changed to", "poses [rad, joint lengths]", "leaf springs [rad]", "<in the record"),
    )
    free = {p.name for p in record.parameters}
    for e in record.evidence:
        kept = "yes" if e.parameter in free else ""
        table.add_row(e.parameter, e.change, f"{e.interface:.2g}", f"{e.rotations:.2g}", kept)
    return table


def _residual_table(record: Any) -> Any:
    """Errors of the fit, by mesh and group."""
    table = _headed_table(
        "Errors of the fit, largest and root mean square",
        *("<mesh", "<functions", "fitted shapes", "rms", "fresh shapes", "rms", "<unit"),
    )
    for r in record.residuals:
        numbers = (f"{v:.2g}" for v in (r.fit_max, r.fit_rms, r.fresh_max, r.fresh_rms))
        table.add_row(str(r.mesh), r.group, *numbers, _UNITS.get(r.group, "1"))
    return table


_TABLE_STYLE: dict[str, Any] = {
    "box": None,
    "pad_edge": False,
    "title_justify": "left",
    "title_style": "bold",
}


def _headed_table(title: str, *columns: str) -> Any:
    """A table without borders; columns marked by "<" hold text."""
    table = Table(title=title, header_style="dim", **_TABLE_STYLE)
    for column in columns:
        table.add_column(column.removeprefix("<"), justify="left" if column[0] == "<" else "right")
    return table


def _two_columns(title: str, rows: list[tuple[str, str]]) -> Any:
    """A borderless table of two columns."""
    table = Table(title=title, show_header=False, **_TABLE_STYLE)
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    for name, value in rows:
        table.add_row(name, Text(value))
    return table


def _listing_rows(listing: Any) -> list[tuple[str, str]]:
    """(name, text) rows about a record file."""
    file = [("file", f"{listing.path}, {listing.size / 1024:.0f} kB"), ("sha256", listing.checksum)]
    if listing.problem:
        return [*file, ("problem", listing.problem)]
    age = "" if math.isnan(listing.age) else f", {listing.age:.0f} days ago"
    return [
        *file,
        *[(f"motion {m.name}", m.range_text) for m in listing.motions],
        *[(f"shape {p.name}", _format_range(p)) for p in listing.parameters],
        ("meshes", ", ".join(str(m) for m in listing.meshes) + " (numbers: Appendix A elements per leaf)"),
        *[
            (f"error {group}", f"{worst:.2g} at most on fresh shapes, in {_UNITS.get(group, '1')}")
            for group, worst in listing.worst
        ],
        *_speed_rows(listing),
        ("trained", f"{listing.trained}{age}, by ksd {listing.version}, format {listing.format}"),
    ]


def _speed_rows(listing: Any) -> list[tuple[str, str]]:
    """(name, text) rows: where methods with this record are faster than `conventional`, and where not."""
    if not listing.leaves:
        return []
    count, coarse = max(2, math.ceil(PAYING_LEAVES / listing.leaves)), dict(listing.worst)["interface"]
    return [
        (
            "fast",
            f"about {count} such joints or more in space ({listing.leaves} leaf spring{'s' * (listing.leaves > 1)} each)",
        ),
        (
            "not faster",
            f"one joint, joints in a plane; to an accuracy below {coarse:.1g} the full model is solved at once",
        ),
    ]


def _format_range(parameter: Any) -> str:
    if "angle" in parameter.name:
        return f"{parameter.low * _PER_RADIAN:.4g} to {parameter.high * _PER_RADIAN:.4g} deg"
    return f"{parameter.low:.4g} to {parameter.high:.4g}"
