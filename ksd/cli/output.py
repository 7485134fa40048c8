"""Output of commands to terminal, JSON file and picture; targets are checked before the work begins."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console

from ksd.answers.printing import TABLE_WIDTH
from ksd.errors import ConvergenceError, SceneError
from ksd.files import check_target
from ksd.library.result_files import write_result
from ksd.view.figure import check_picture

STDOUT = "-"
TABLE_WRITERS = {".csv": "to_csv", ".h5": "to_hdf5", ".hdf5": "to_hdf5", ".mat": "to_mat"}
"""Method of `ksd.Table` and `ksd.History` that writes a file, by its ending."""


def console() -> Any:
    """The terminal, or plain text of 100 columns when the output is read by a program."""

    class Screen(Console):
        """Console that raises BrokenPipeError instead of exiting."""

        def on_broken_pipe(self) -> None:
            raise BrokenPipeError

    # brackets in names of the user are not markup
    plain: dict[str, Any] = {"highlight": False, "markup": False, "emoji": False}
    screen = Screen(**plain)
    return screen if screen.is_terminal else Screen(**plain, width=TABLE_WIDTH)


@contextmanager
def interrupt_message(sentence: str, kept: str = "", resume: str | None = None) -> Iterator[None]:
    """Context in which Ctrl-C ends the command with this sentence; kept: what the file `resume` holds, or would hold."""
    if kept and resume is None:
        sentence += f", with --resume FILE {kept} are kept"
    elif kept:
        sentence += f", {kept} are in {resume}, give the same command again to go on"
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(sentence) from None


def check_json(path: str | None) -> None:
    """Raises SceneError when a JSON file cannot be written there."""
    if path is not None and path != STDOUT:
        check_target(path, what="--json")


def check_plot(path: str | None, *, kinds: tuple[str, ...] = ()) -> None:
    """Raises SceneError for an unknown picture type or a missing folder; file endings `kinds` are allowed too."""
    if path is None:
        return
    if Path(path).suffix.lower() in kinds:
        check_target(path, what="--plot")
        return
    check_picture(path)


def check_table(path: str | None) -> None:
    """Raises SceneError for a table file of an unknown ending, or in a missing folder."""
    if path is None:
        return
    if Path(path).suffix.lower() not in TABLE_WRITERS:
        raise SceneError(f"--out {path}: the ending must be one of {', '.join(TABLE_WRITERS)}")
    check_target(path, what="--out")


def write_table(table: Any, path: str | None) -> None:
    """Write a `ksd.Table` or `ksd.History` to `path`, if there is one."""
    if path is not None:
        getattr(table, TABLE_WRITERS[Path(path).suffix.lower()])(path)


def require_answers(table: Any) -> None:
    """Raise ConvergenceError where poses of a `ksd.Table` failed or are refused."""
    failures = table.failures
    if failures:
        first = failures[0]["status"]
        raise ConvergenceError(
            f"{len(failures)} of {len(table)} poses have no full answer; the first: {first}"
        )


def show(
    path: str | None, numbers: Callable[[], dict[str, Any]], *parts: Any, soft_wrap: bool = True
) -> None:
    """Write the numbers as JSON to `path`, if there is one, and print the parts unless stdout has the JSON."""
    if path:
        write_json(numbers(), path)
    if path != STDOUT:
        screen = console()
        for part in parts:
            screen.print(part, soft_wrap=soft_wrap)


def write_json(numbers: dict[str, Any], path: str) -> None:
    """Write strict JSON to `path`, sealed (`ksd.read_result` reads it), or to stdout for "-".

    Raises SceneError when it cannot be written.
    """
    if path == STDOUT:
        sys.stdout.write(json.dumps(numbers, indent=1, allow_nan=False) + "\n")
        return
    write_result(numbers, path)
