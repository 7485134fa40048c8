"""`ksd train FAMILY`: make the record of a joint family, of all, or check that a record is what the sources give."""

from __future__ import annotations

import argparse
import time
import warnings
from dataclasses import fields
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ksd.cli.output import console, interrupt_message
from ksd.errors import RecordError
from ksd.library import find_record
from ksd.library.record_files import RECORD_SUFFIX, find_record_file, lookup_hint
from ksd.training import known_designs, train, up_to_date
from ksd.training.run import record_path

ROUNDING = 1e-8
"""Largest difference of coefficients (ten decimals) that rounding on another machine may cause: 3e-9 has been seen."""


def run(options: argparse.Namespace) -> int:
    """Train and print the errors of the record, or check it. Raises SceneError for an unknown family, RecordError where a
    check finds more than rounding between the record in use and the trained one."""
    begin = time.perf_counter()
    families = known_designs() if options.family == "all" else (options.family,)
    unlike = []
    for family in families:
        if not options.check:
            _train(family, options)
            continue
        try:
            _check(family, options)
        except RecordError as reason:
            if len(families) == 1:
                raise
            console().print(str(reason), soft_wrap=True)
            unlike.append(family)
    if unlike:
        raise RecordError(
            f"{len(unlike)} of {len(families)} records are not what the sources give: {', '.join(unlike)}; "
            "run `ksd train` with each name"
        )
    if len(families) > 1:
        console().print(f"{len(families)} families in {time.perf_counter() - begin:.0f} s")
    return 0


def _train(family: str, options: argparse.Namespace) -> None:
    """Train one family unless its record is up to date, and print the largest errors of the record."""
    begin = time.perf_counter()
    screen = console()
    if not options.restart and (words := up_to_date(family, out=options.out)):
        screen.print(f"{family}: up to date; {words} (--restart trains all the same)", soft_wrap=True)
        return
    again = "interrupted; the finished shapes are kept, run the same command again to go on"
    with interrupt_message(again), warnings.catch_warnings(record=True) as messages:
        warnings.simplefilter("always", UserWarning)
        record = train(family, out=options.out, resume=not options.restart, progress=not options.quiet)
    screen.print(
        f"{record.family}: trained in {time.perf_counter() - begin:.0f} s on {record.samples[0]} shapes"
    )
    for group in sorted({r.group for r in record.residuals}):
        rows = [r for r in record.residuals if r.group == group]
        worst = max(rows, key=lambda r: r.fresh_max)
        screen.print(f"  {group}: largest error {worst.fresh_max:.2g} on fresh shapes, mesh {worst.mesh}")
    for message in messages:
        screen.print(f"  warning: {message.message}", soft_wrap=True)
    if unused := lookup_hint(record_path(family, options.out), family):
        screen.print(f"  {unused}", soft_wrap=True)


def _check(family: str, options: argparse.Namespace) -> None:
    """Train into a temporary folder and compare with the record in use."""
    kept = find_record(family)
    with TemporaryDirectory() as folder:
        made = train(family, out=Path(folder), trained=kept.trained, resume=False, progress=not options.quiet)
        file = Path(folder) / f"{family}{RECORD_SUFFIX}"
        in_use = find_record_file(family)
        same = in_use is not None and file.read_bytes() == Path(in_use[0]).read_bytes()
    text = "the record is, byte for byte, what the sources give" if same else _describe_difference(kept, made)
    console().print(f"{family}: {text}", soft_wrap=True)


def _describe_difference(kept: Any, made: Any) -> str:
    """How the record in use differs from one just made, in words; RecordError where it is more than rounding."""
    unlike = [
        f.name
        for f in fields(kept)
        if f.name not in ("functions", "powers", "probes", "residuals", "evidence")
        and getattr(kept, f.name) != getattr(made, f.name)
    ]
    if unlike or not np.array_equal(kept.powers, made.powers):
        raise RecordError(
            f"record '{kept.family}' is not what the sources give: {', '.join(unlike) or 'its terms'} differ; "
            f"run `ksd train {kept.family}`"
        )
    most = max(
        float(np.abs(table - made.functions[mesh].groups()[group]).max(initial=0.0))
        for mesh, functions in kept.functions.items()
        for group, table in functions.groups().items()
    )
    if most > ROUNDING:
        raise RecordError(
            f"record '{kept.family}' is not what the sources give: its coefficients differ by up to {most:.2g}; "
            f"run `ksd train {kept.family}`"
        )
    return f"the record is what the sources give, coefficients within {most:.2g}"
