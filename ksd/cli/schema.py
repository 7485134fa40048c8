"""`ksd schema`: the JSON schema of scene files, for editors."""

from __future__ import annotations

import argparse
import json
import sys

from ksd.cli.solve import OPTIONS
from ksd.files import write_file
from ksd.scene.json_schema import json_schema


def run(options: argparse.Namespace) -> int:
    """Print or write it."""
    if options.out is None:
        sys.stdout.write(schema_text())
    else:
        write_file(options.out, schema_text(), what="--out")
    return 0


def schema_text() -> str:
    """The schema with the options of the command line."""
    return json.dumps(json_schema(OPTIONS), indent=1, ensure_ascii=False) + "\n"
