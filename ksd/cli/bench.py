"""`ksd bench`: every method on the same scenes in one run, time beside error.

Layout of the JSON file: "machine" (date, processor, versions), "times" (what the triples mean), "cases": by name
"repeats" and "rows", each with method, leaf springs, size, iterations, call and steps (lower quartile, median and upper
quartile of the thread time in us), passes (over all leaf springs), first_us (the first call, not counted), force_error,
displacement_error, stiffness_error (relative; null where unknown), stable, note, failed (why, where it did not
converge).
"""

from __future__ import annotations

import argparse

from ksd.bench import SUITE, measure
from ksd.bench.measure import json_results, summary, table
from ksd.cli.output import STDOUT, check_json, console, write_json
from ksd.errors import SceneError

QUICK_REPEATS, DEFAULT_REPEATS = 5, 15
"""Measurements per case."""


def run(options: argparse.Namespace) -> int:
    """Measure, print, write. Raises SceneError for a WORD no case holds."""
    check_json(options.json)
    words = options.case or [""]
    cases = [c for c in SUITE if any(w.lower() in c.name.lower() for w in words)]
    if not cases:
        known = "; ".join(c.name for c in SUITE)
        raise SceneError(f"--case {' '.join(words)}: no such case of the benchmark; there are: {known}")
    screen, quiet = console(), options.json == STDOUT
    results = []
    for case in cases:
        measured = measure(
            case, quick=options.quick, repeats=QUICK_REPEATS if options.quick else DEFAULT_REPEATS
        )
        results.append(measured)
        if not quiet:
            screen.print(table(measured))
            for line in summary(measured):
                screen.print(line)
            for row in measured.rows:
                if row.failed:
                    screen.print(f"{row.method}, {row.leaves}: {row.failed}")
            screen.print()
    if options.json:
        write_json(json_results(results), options.json)
    return 0
