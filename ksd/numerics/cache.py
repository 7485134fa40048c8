"""The cache folder of compiled kernels, which is named after a hash of their sources and shared by processes.

The cache of numba does not notice a changed callee in another file. So the name of the folder contains a hash of all sources
of this package with kernels, and a changed kernel means a new folder and a new compilation. The files in it are executed, so
the folder must be private: mode 0700, and nobody else can replace it or a folder above it. `KSD_CACHE_DIR` is tried first,
then the cache folder of the user, then one in the temporary folder; where none of them is private, kernels are compiled in
memory at every start.
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


def _reason_not_private(folder: Path) -> str:
    """Make `folder` (mode 0700) if it is missing, and return why it is not private and writable; empty when it is."""
    try:
        for made in (folder.parent, folder):
            made.mkdir(mode=0o700, parents=True, exist_ok=True)
        if os.name != "nt":
            real = folder.resolve()
            path_folders = dict.fromkeys((folder, *folder.parents, real, *real.parents))
            reason = next(filter(None, map(_reason_open_to_others, path_folders)), "")
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


def _reason_open_to_others(path: Path) -> str:
    """Why a user other than root could replace `path` or write into it; empty when none could."""
    entry = path.lstat()
    if entry.st_uid not in (0, os.geteuid()):
        return f"{path} belongs to another user"
    if stat.S_ISLNK(entry.st_mode):
        return ""
    # who can write into a folder without sticky bit can replace what is in it
    others = stat.S_IWOTH | (0 if _is_only_member(entry.st_gid) else stat.S_IWGRP)
    if entry.st_mode & others and not entry.st_mode & stat.S_ISVTX:
        return f"{path} can be written by other users"
    return ""


def _is_only_member(group: int) -> bool:
    """Whether this user is the only member of a group, as where every user has a group of the same name."""
    import grp
    import pwd

    try:
        me, found = pwd.getpwuid(os.geteuid()), grp.getgrgid(group)
    except KeyError:
        return False
    return me.pw_gid == group and found.gr_name == me.pw_name and set(found.gr_mem) <= {me.pw_name}


def _candidates() -> list[Path]:
    """Candidate folders, in the order in which they are tried."""
    places = []
    if os.environ.get("KSD_CACHE_DIR"):
        places.append(Path(os.environ["KSD_CACHE_DIR"]))
    home = os.environ.get("XDG_CACHE_HOME") or (Path.home() / ".cache" if os.environ.get("HOME") else None)
    if home:
        places.append(Path(home) / "ksd")
    places.append(Path(tempfile.gettempdir()) / f"ksd-{os.geteuid() if hasattr(os, 'geteuid') else 'user'}")
    return [Path(os.path.abspath(place)) for place in places]


def cache_folder() -> Path | None:
    """The cache folder, made if needed; None where no candidate is private.

    A warning is logged where the folder named by `KSD_CACHE_DIR` is not used, and where there is no cache.
    """
    key, reasons, found = f"kernels-{source_hash()}", [], None
    for place in _candidates():
        reason = _reason_not_private(place / key)
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


def compiled_before(kernel: str = "") -> bool:
    """Whether the cache already has compiled kernels of these sources, or this one, "module.name"."""
    return CACHE_FOLDER is None or any(CACHE_FOLDER.rglob(f"{kernel}*.nbi"))
