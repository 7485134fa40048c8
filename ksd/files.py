"""Atomic writing and bounded reading of files; every file of the package goes through here.

Writing goes to a temporary file in the target's folder, is flushed to disk (fsync) and then renamed onto the target, so that
a crash or a full disk leaves either the old file or the new one. Only regular files of limited size are read, so that a pipe
without a writer, an endless device or a file of 80 GB raises an error at once.
"""

from __future__ import annotations

import contextlib
import csv
import io
import os
import secrets
import stat
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ksd.errors import KsdError, SceneError

MAX_READ_BYTES = 1 << 28
"""Largest file that is read [bytes], 256 MiB; the same limit holds for its unpacked content."""
Name = str | os.PathLike[str]


def named_file(path: Name, what: str) -> Path:
    """`path` as a Path. Raises SceneError, calling the file `what`, for anything but a file name."""
    if not isinstance(path, str | os.PathLike):
        raise SceneError(f"{what}: {' '.join(repr(path).split())[:80]} is no name of a file.")
    return Path(path)


def write_file(
    path: Name, content: bytes | str, *, what: str = "file", error: type[KsdError] = SceneError
) -> Path:
    """Put `content` (text as UTF-8) at `path`, whole or not at all; returns the path.

    A file that is there keeps its permissions, and a link to one stays a link. Raises `error`, calling the file `what`,
    where that is not possible.
    """
    place = check_target(path, what=what, error=error)
    data = content.encode() if isinstance(content, str) else content
    # a name of its own: two threads may write the same target, and the target's name may be as long as names can be
    partial = place.with_name(f".ksd-{secrets.token_hex(8)}.partial")
    try:
        with open(partial, "xb") as file:
            with contextlib.suppress(FileNotFoundError):
                os.chmod(partial, stat.S_IMODE(place.stat().st_mode))
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(partial, place)
    except OSError as reason:
        raise error(_cannot_write(what, path, reason.strerror or str(reason))) from reason
    finally:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)
    return Path(path)


def check_target(path: Name, *, what: str = "file", error: type[KsdError] = SceneError) -> Path:
    """Where `write_file` will write, links followed: a regular file, or a new name in a folder that is there.

    Raises `error`, calling the file `what`, for a device, a pipe or a folder, for the file that standard output goes to,
    and for a missing folder.
    """
    try:
        place = Path(os.path.realpath(path))
        status = place.stat()
    except FileNotFoundError:
        if not place.parent.is_dir():
            folder = Path(path).parent
            raise error(
                f"{what} {_named(path)}: folder {_named(folder)} does not exist; make it first."
            ) from None
        _check_folder(place.parent, path, what, error)
        return place
    except (OSError, ValueError, TypeError) as reason:
        # a null character, half a character, or no name at all
        raise error(_cannot_write(what, path, getattr(reason, "strerror", None) or str(reason))) from None
    if _is_output(status):
        raise error(_cannot_write(what, path, "it is where standard output goes"))
    if not stat.S_ISREG(status.st_mode):
        raise error(_cannot_write(what, path, f"it is {_kind(status.st_mode)}, no file"))
    if not os.access(place, os.W_OK):
        raise error(_cannot_write(what, path, "Permission denied"))
    _check_folder(place.parent, path, what, error)
    return place


def _check_folder(folder: Path, path: Name, what: str, error: type[KsdError]) -> None:
    """Raise `error` where no file can be made in the folder of `path`, before anything is computed for that file."""
    if not os.access(folder, os.W_OK | os.X_OK):
        raise error(_cannot_write(what, path, "Permission denied, its folder is read-only"))


def _cannot_write(what: str, path: Name, reason: str) -> str:
    return f"{what} {_named(path)} cannot be written: {reason}; give a file in a folder with room."


def _named(path: Name) -> str:
    """A path as quoted in a one-line message."""
    text = str(path)
    return f"'{text}'" if text.isprintable() else repr(text)


def _is_output(status: os.stat_result) -> bool:
    """Whether a regular file is the one standard output is redirected to; replacing it would lose the output."""
    try:
        return os.path.samestat(status, os.fstat(sys.stdout.fileno())) and stat.S_ISREG(status.st_mode)
    except (OSError, ValueError, AttributeError):
        return False


def read_file(
    path: Name,
    *,
    what: str = "file",
    most: int = MAX_READ_BYTES,
    error: type[KsdError] = SceneError,
    hint: str = "",
) -> bytes:
    """All bytes of a regular file of at most `most` bytes.

    Raises `error`, calling the file `what` and ending with `hint`, for a file that is missing, no regular file, larger, or
    not readable.
    """
    try:
        with open(os.fspath(path), "rb", opener=_without_waiting) as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):
                reason = f"it is {_kind(status.st_mode)}, no file"
            elif status.st_size > most or len(content := file.read(most + 1)) > most:
                reason = f"it is larger than the {most >> 20} MiB that are read"
            else:
                return content
    except FileNotFoundError:
        reason = "it does not exist"
    except (OSError, ValueError, TypeError, MemoryError) as failure:
        # a path with a null character is a ValueError, none at all a TypeError
        reason = getattr(failure, "strerror", None) or str(failure) or type(failure).__name__
    raise error(f"{what} {_named(path)} cannot be read: {reason}; {hint or 'check the name of the file'}.")


def _without_waiting(path: str, flags: int) -> int:
    """Opener that does not block on a pipe without a writer; the pipe is refused afterwards."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def _kind(mode: int) -> str:
    """What is there instead of a regular file, from the mode of its status: "a folder", "a pipe", ..."""
    kinds = ((stat.S_ISDIR, "a folder"), (stat.S_ISFIFO, "a pipe"), (stat.S_ISSOCK, "a socket"))
    return next((name for test, name in kinds if test(mode)), "a device")


def write_csv(path: str | os.PathLike[str], header: Iterable[str], rows: Iterable[Iterable[Any]]) -> Path:
    """Write a table of comma-separated values (UTF-8, full precision, one header line) as `write_file` does."""
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(header)
    # -0.0 is 0.0 in a table
    writer.writerows([v + 0.0 if isinstance(v, float) else v for v in row] for row in rows)
    return write_file(path, text.getvalue(), what="table")
