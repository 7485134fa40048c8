"""Where results go: terminal, JSON file, picture; checked before the work begins."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from ksd.errors import RecordError, SceneError

STDOUT = "-"


def console() -> Any:
    """The terminal, or plain text of 100 columns when the output is read by a program."""
    from rich.console import Console

    from ksd.solve.report import WIDTH

    class Screen(Console):
        """Leaves a broken pipe to the caller, who knows the exit code."""

        def on_broken_pipe(self) -> None:
            raise BrokenPipeError

    screen = Screen(highlight=False)
    return screen if screen.is_terminal else Screen(highlight=False, width=WIDTH)


def check_json(path: str | None) -> None:
    """Raises SceneError when the folder of a JSON file does not exist."""
    if path not in (None, STDOUT) and not Path(str(path)).parent.is_dir():
        raise SceneError(f"--json {path}: folder '{Path(str(path)).parent}' does not exist; make it first")


def check_plot(path: str | None, *, kinds: tuple[str, ...] = ()) -> None:
    """Raises SceneError for a picture type nobody can write or a missing folder; `kinds` are fine too."""
    if path is None:
        return
    if Path(path).suffix.lower() in kinds:
        if not Path(path).parent.is_dir():
            raise SceneError(f"--plot {path}: folder '{Path(path).parent}' does not exist; make it first")
        return
    from ksd.view.figure import check_picture

    check_picture(path)


def write_json(numbers: dict[str, Any], path: str) -> None:
    """Write strict JSON to `path`, sealed (`ksd.read_result` reads it), or to stdout for "-".

    Raises SceneError when it cannot be written.
    """
    if path == STDOUT:
        sys.stdout.write(json.dumps(numbers, indent=1, allow_nan=False) + "\n")
        return
    from ksd.library.tables import write_answer

    try:
        write_answer(numbers, path)
    except RecordError as error:
        raise SceneError(f"--json {path} cannot be written: {error}") from error
