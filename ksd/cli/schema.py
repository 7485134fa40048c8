"""`ksd schema`: the JSON schema of scene and job files, for editors."""

from __future__ import annotations

import argparse
import json
import sys

from ksd.cli.solve import OPTIONS
from ksd.files import write_file
from ksd.optimisation.job_file import JOB_KEYS, OPTIMISE_KEYS
from ksd.scene.json_schema import json_schema


def run(options: argparse.Namespace) -> int:
    """Print the schema, or write it to a file."""
    text = schema_text(jobs=options.job)
    if options.out is None:
        sys.stdout.write(text)
    else:
        write_file(options.out, text, what="--out")
    return 0


def schema_text(*, jobs: bool = False) -> str:
    """The schema of scene files with the options of the command line, or of job files."""
    tree = json_schema(OPTIONS, (JOB_KEYS, OPTIMISE_KEYS) if jobs else None)
    return json.dumps(tree, indent=1, ensure_ascii=False) + "\n"
