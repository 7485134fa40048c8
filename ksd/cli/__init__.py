"""The command line, `ksd COMMAND ...`. Every command is a module of this package with `add` and `run`.

Exit codes: 0 solved, 2 bad input (also wrong options), 3 not converged, 4 joint record missing or damaged,
130 interrupted. What went wrong is one sentence on stderr; a traceback is a bug of ours.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
from collections.abc import Sequence
from importlib import import_module

from ksd.errors import KsdError

COMMANDS = ("demo", "solve", "effects", "doctor", "sweep", "report", "train", "info", "bench")
"""Modules of this package, in the order of the help; each has `add(subparsers)` and `run(options) -> int`."""
INTERRUPTED = 130
BAD_INPUT = 2
BROKEN_PIPE = 141


def parser() -> argparse.ArgumentParser:
    """The parser of all commands; their heavy imports wait until one is run."""
    import ksd

    top = argparse.ArgumentParser(
        prog="ksd",
        description="Deformed configurations of flexure mechanisms in large deflection, from fast to exact.",
        epilog="exit codes: 0 solved, 2 bad input, 3 not converged, 4 joint record missing or damaged",
    )
    top.add_argument("--version", action="version", version=f"ksd {ksd.__version__}")
    commands = top.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for name in COMMANDS:
        module = import_module(f"ksd.cli.{name}")
        module.add(commands).set_defaults(run=module.run)
    return top


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; `argv` without the program name, sys.argv when None. Returns the exit code."""
    if sys.stderr is None:
        # closed by the caller: nobody wants to read it
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115
    if sys.stdout is None:
        return _fail("standard output is closed; send it to a file or to /dev/null", BAD_INPUT)
    options = parser().parse_args(argv)
    try:
        code: int = options.run(options)
        sys.stdout.flush()
        return code
    except KsdError as error:
        return _fail(str(error), error.exit_code)
    except KeyboardInterrupt as stop:
        return _fail(str(stop) or "interrupted; nothing more was written", INTERRUPTED)
    except BrokenPipeError:
        # the reader (head, less) has left
        _say_no_more()
        return BROKEN_PIPE
    except OSError as error:
        _say_no_more()
        place = f" '{error.filename}'" if error.filename else ""
        return _fail(f"cannot read or write{place}: {error.strerror or error}", BAD_INPUT)


def _say_no_more() -> None:
    """What is still to be printed goes nowhere, or the interpreter would complain of it at its exit."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _fail(sentence: str, code: int) -> int:
    print(f"ksd: {sentence if sentence.endswith(('.', '!', '?')) else sentence + '.'}", file=sys.stderr)
    return code
