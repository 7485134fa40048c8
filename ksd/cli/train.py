"""`ksd train FAMILY`: make the record of a joint family."""

from __future__ import annotations

import argparse
import time
from typing import Any

from ksd.cli.output import console


def add(commands: Any) -> argparse.ArgumentParser:
    """The parser of this command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "train",
        help="train the record of a joint family",
        description="Sweep a joint's own finite element model over stroke and shape; write its record.",
    )
    parser.add_argument("family", metavar="FAMILY", help="for example cross_flexure")
    parser.add_argument(
        "--out", metavar="FOLDER", help="where the record goes; $KSD_DATABASE or ./database when left out"
    )
    parser.add_argument("--restart", action="store_true", help="forget what an interrupted run has finished")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    return parser


def run(options: argparse.Namespace) -> int:
    """Train and say how good the record is. SceneError for an unknown family."""
    from ksd.train import train

    begin = time.perf_counter()
    try:
        record = train(
            options.family, out=options.out, resume=not options.restart, progress=not options.quiet
        )
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            "interrupted; the finished shapes are kept, run the same command again to go on"
        ) from None
    screen = console()
    screen.print(
        f"{record.family}: trained in {time.perf_counter() - begin:.0f} s on {record.samples[0]} shapes"
    )
    for group in sorted({r.group for r in record.residuals}):
        rows = [r for r in record.residuals if r.group == group]
        worst = max(rows, key=lambda r: r.fresh_max)
        screen.print(f"  {group}: largest error {worst.fresh_max:.2g} on fresh shapes, mesh {worst.mesh}")
    return 0
