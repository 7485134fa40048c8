"""Where compiled kernels are kept: a folder keyed by a hash of every kernel's source, shared by processes.

Numba's own cache does not notice a changed callee in another file, so the folder name carries a hash of all
sources of this package that contain kernels; a changed kernel means a new folder and a fresh compilation.
A read-only installation falls back to the user's cache folder, then to a temporary one, then to no cache.

Processes that find it cold share the work: each entry is compiled by the one that asks first, the others wait for it.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

ALONE = "KSD_COMPILE_ALONE"
"""Set in the environment of the processes that compile beside the first, which must not start more and say nothing."""
_PACKAGE = Path(__file__).resolve().parent.parent
_SAID: list[str] = []


def source_hash() -> str:
    """Hash (16 hex digits) of all sources that contain kernels, the numba version and this Python."""
    import numba

    digest = hashlib.sha256(f"{numba.__version__} {sys.version_info[:2]}".encode())
    for path in sorted(_PACKAGE.rglob("*.py")):
        text = path.read_bytes()
        if b"@kernel" in text or b"@late" in text or b"intrinsic(" in text:
            digest.update(path.relative_to(_PACKAGE).as_posix().encode() + b"\0" + text)
    return digest.hexdigest()[:16]


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".probe-{os.getpid()}"
        probe.touch()
        probe.unlink()
    except OSError:
        return False
    return True


def _candidates() -> list[Path]:
    places = []
    if os.environ.get("KSD_CACHE_DIR"):
        places.append(Path(os.environ["KSD_CACHE_DIR"]))
    home = os.environ.get("XDG_CACHE_HOME") or (Path.home() / ".cache" if os.environ.get("HOME") else None)
    if home:
        places.append(Path(home) / "ksd")
    places.append(Path(tempfile.gettempdir()) / f"ksd-{os.getuid() if hasattr(os, 'getuid') else 'user'}")
    return places


def cache_folder() -> Path | None:
    """The folder kernels are cached in, made if needed; None when nothing is writable."""
    key = source_hash()
    for place in _candidates():
        folder = place / f"kernels-{key}"
        if _writable(folder):
            return folder
    return None


FOLDER: Path | None = cache_folder()


def compiled_before() -> bool:
    """Whether this machine's cache already holds kernels of these sources."""
    return FOLDER is None or any(FOLDER.rglob("*.nbi"))


def say(message: str) -> None:
    """Tell the user, once per process, that compiling is what takes the time."""
    if not _SAID and not os.environ.get(ALONE):
        _SAID.append(message)
        print(f"ksd: {message} ...", file=sys.stderr)


def take(name: str) -> bool:
    """Whether this process is the first of all that share the folder to ask for `name`."""
    if FOLDER is None:
        return True
    try:
        place = os.open(FOLDER / name, os.O_CREAT | os.O_EXCL | os.O_WRONLY)
    except FileExistsError:
        return False
    except OSError:
        return True
    os.write(place, str(os.getpid()).encode())
    os.close(place)
    return True


@contextlib.contextmanager
def turn(name: str, *, longest: float = 180.0) -> Iterator[None]:
    """Compile `name` inside: at once when no other process is at it, else when that one is done, has died, or after
    `longest` seconds (then the cache holds it, or it is compiled twice)."""
    if FOLDER is None or (FOLDER / f"{name}.done").exists():
        yield
        return
    mark = FOLDER / f"{name}.compiling"
    mine, until = take(mark.name), time.monotonic() + longest
    say(
        "compiling kernels not used before on this machine (once)"
        if mine
        else "waiting for kernels that are being compiled"
    )
    while not mine and time.monotonic() < until and _at_work(mark):
        time.sleep(0.02)
    try:
        yield
        (FOLDER / f"{name}.done").touch()
    finally:
        mark.unlink(missing_ok=True)


def _at_work(mark: Path) -> bool:
    """Whether the process that wrote its number into `mark` still compiles."""
    if os.name == "nt":
        return mark.exists()
    try:
        number = mark.read_text()
        if number:
            os.kill(int(number), 0)
    except (FileNotFoundError, ProcessLookupError, ValueError):
        return False
    except OSError:
        return mark.exists()
    return True
