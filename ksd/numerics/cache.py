"""Where compiled kernels are kept: a folder keyed by a hash of every kernel's source, shared by processes.

Numba's own cache does not notice a changed callee in another file, so the folder name carries a hash of all
sources of this package that contain kernels; a changed kernel means a new folder and a fresh compilation.
What lies in it is run, so it must be the user's own: mode 0700, and nobody else able to replace it or a folder above it.
`KSD_CACHE_DIR` is tried first, then the user's cache folder, then one in the temporary folder; where none of them is
the user's own, kernels are compiled in memory at every start.
"""

from __future__ import annotations

import hashlib
import logging
import os
import stat
import sys
import tempfile
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent.parent


def source_hash() -> str:
    """Hash (16 hex digits) of all sources that contain kernels, the numba version and this Python."""
    import numba

    digest = hashlib.sha256(f"{numba.__version__} {sys.version_info[:2]}".encode())
    for path in sorted(_PACKAGE.rglob("*.py")):
        text = path.read_bytes()
        if b"@kernel" in text or b"kernel(" in text:
            digest.update(path.relative_to(_PACKAGE).as_posix().encode() + b"\0" + text)
    return digest.hexdigest()[:16]


def _own(folder: Path) -> str:
    """Make `folder` (mode 0700) where it is missing; why it is not this user's own, or nothing."""
    try:
        for made in (folder.parent, folder):
            made.mkdir(mode=0o700, parents=True, exist_ok=True)
        if os.name != "nt":
            real = folder.resolve()
            on_the_way = dict.fromkeys((folder, *folder.parents, real, *real.parents))
            reason = next(filter(None, map(_open_to_others, on_the_way)), "")
            if reason:
                return reason
            if real.stat().st_uid != os.geteuid():
                return f"{folder} belongs to another user"
            real.chmod(0o700)
        probe = folder / f".probe-{os.getpid()}"
        probe.touch()
        probe.unlink()
    except OSError as reason:
        return f"{folder} cannot be written ({reason.strerror or reason})"
    return ""


def _open_to_others(path: Path) -> str:
    """Why somebody else (root apart) could put something of theirs in the place of `path` or into it, or nothing."""
    entry = path.lstat()
    if entry.st_uid not in (0, os.geteuid()):
        return f"{path} belongs to another user"
    if stat.S_ISLNK(entry.st_mode):
        return ""
    # whoever may write into a folder may replace what lies in it, but for the sticky bit
    others = stat.S_IWOTH | (0 if _alone_in(entry.st_gid) else stat.S_IWGRP)
    if entry.st_mode & others and not entry.st_mode & stat.S_ISVTX:
        return f"{path} can be written by other users"
    return ""


def _alone_in(group: int) -> bool:
    """Whether this user is the only one of a group, as where every user has a group of the same name."""
    import grp
    import pwd

    try:
        me, found = pwd.getpwuid(os.geteuid()), grp.getgrgid(group)
    except KeyError:
        return False
    return me.pw_gid == group and found.gr_name == me.pw_name and set(found.gr_mem) <= {me.pw_name}


def _candidates() -> list[Path]:
    """Folders for caches, in the order they are tried."""
    places = []
    if os.environ.get("KSD_CACHE_DIR"):
        places.append(Path(os.environ["KSD_CACHE_DIR"]))
    home = os.environ.get("XDG_CACHE_HOME") or (Path.home() / ".cache" if os.environ.get("HOME") else None)
    if home:
        places.append(Path(home) / "ksd")
    places.append(Path(tempfile.gettempdir()) / f"ksd-{os.geteuid() if hasattr(os, 'geteuid') else 'user'}")
    return [Path(os.path.abspath(place)) for place in places]


def cache_folder() -> Path | None:
    """The folder kernels are cached in, made if needed; None where no place is the user's own. The user is told where a
    place named by `KSD_CACHE_DIR` is not used, and where there is none."""
    key, reasons, found = f"kernels-{source_hash()}", [], None
    for place in _candidates():
        reason = _own(place / key)
        if not reason:
            found = (place / key).resolve()
            break
        reasons.append(reason)
    if reasons and (found is None or os.environ.get("KSD_CACHE_DIR")):
        instead = "kernels are compiled in memory, at every start" if found is None else f"{found} is used"
        logging.getLogger("ksd").warning(
            "ksd: no cache for compiled kernels: %s; %s", "; ".join(reasons), instead
        )
    return found


CACHE_FOLDER: Path | None = cache_folder()


def compiled_before() -> bool:
    """Whether this machine's cache already holds kernels of these sources."""
    return CACHE_FOLDER is None or any(CACHE_FOLDER.rglob("*.nbi"))
