"""The command line, `ksd COMMAND ...`: options are defined in `ksd.cli.commands`, every command is a module with `run`.

Exit codes: 0 solved, 2 bad input (also wrong options), 3 not converged, 4 joint record missing or damaged,
130 interrupted. What went wrong is one sentence on stderr; a traceback is a bug of ours.
"""

from __future__ import annotations

import contextlib
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

from ksd.cli.commands import parser
from ksd.errors import KsdError, SceneWarning

INTERRUPTED = 130
BAD_INPUT = 2
BROKEN_PIPE = 141


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; `argv` without the program name, sys.argv when None. Returns the exit code."""
    if sys.stderr is None:
        # closed by the caller
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115
    if sys.stdout is None:
        return _fail("standard output is closed; send it to a file or to /dev/null", BAD_INPUT)
    commands = parser()
    options, unknown = commands.parse_known_args(argv)
    if unknown:
        options.refuse(f"unrecognized arguments: {' '.join(unknown)}")
    if options.command is None:
        commands.print_help(sys.stderr)
        return _fail("give a command", BAD_INPUT)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _scene_warnings_as_sentences(warnings.showwarning)
            # only the command that was given is loaded, with the solvers and pictures it needs
            code: int = import_module(f"ksd.cli.{options.command}").run(options)
        sys.stdout.flush()
        return code
    except KsdError as error:
        return _fail(str(error), error.exit_code)
    except KeyboardInterrupt as stop:
        return _fail(str(stop) or "interrupted; nothing more was written", INTERRUPTED)
    except BrokenPipeError:
        # the reader (head, less) has left
        _discard_output()
        return BROKEN_PIPE
    except OSError as error:
        _discard_output()
        place = f" '{error.filename}'" if error.filename else ""
        return _fail(f"cannot read or write{place}: {error.strerror or error}", BAD_INPUT)


def _scene_warnings_as_sentences(otherwise: Callable[..., None]) -> Callable[..., None]:
    """A `warnings.showwarning` that prints warnings about scenes as a sentence on stderr and passes others on."""

    def show(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:
        if issubclass(category, SceneWarning):
            print(f"ksd: {message}", file=sys.stderr)
        else:
            otherwise(message, category, *where, **more)

    return show


def _discard_output() -> None:
    """Redirect standard output to the null device, so that flushing it at exit raises no error."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _fail(sentence: str, code: int) -> int:
    print(f"ksd: {sentence if sentence.endswith(('.', '!', '?')) else sentence + '.'}", file=sys.stderr)
    return code
