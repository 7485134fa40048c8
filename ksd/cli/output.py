"""Where results go: terminal, JSON file, picture; checked before the work begins."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from ksd.errors import SceneError

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
    """Write strict JSON to `path`, or to stdout for "-". Raises SceneError when it cannot be written."""
    text = json.dumps(numbers, indent=1, allow_nan=False) + "\n"
    if path == STDOUT:
        sys.stdout.write(text)
        return
    try:
        Path(path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise SceneError(f"--json {path} cannot be written: {error.strerror}") from error
