"""The cache folder of compiled kernels: below it one folder per source, named after a hash of all it imports.

The cache of numba does not notice a changed callee in another file. So the folder of a source is named after a hash of the
source and of those of this package that it imports, in turn where these have kernels: a changed kernel means new folders,
and compiling, for it and for those that call it. The files are executed, so the cache folder must be private: mode 0700, and
nobody else can replace it or a folder above it. `KSD_CACHE_DIR` is tried first, then the cache folder of the user, then one
in the temporary folder; where none of them is private, kernels are compiled in memory at every start.
"""

from __future__ import annotations

import hashlib
import logging
import os
import re
import stat
import sys
import tempfile
from functools import cache
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent.parent


_IMPORT = re.compile(rb"^(?:from (ksd[.\w]*) import (\([^)]*\)|.*)|import (ksd[.\w]*))", re.MULTILINE)


def cache_name() -> str:
    """Name of the cache folder, with the version of numba and of this Python."""
    import numba

    return f"kernels-{numba.__version__}-{sys.version_info.major}.{sys.version_info.minor}"


@cache
def _imported(path: Path) -> frozenset[Path]:
    """The sources of this package that a source imports itself."""
    found = set()
    for module, names, whole in _IMPORT.findall(path.read_bytes()):
        place = _PACKAGE.parent.joinpath(*(module or whole).decode().split("."))
        found |= {place.with_suffix(".py"), place / "__init__.py"}
        found |= (
            {place / f"{name}.py" for name in re.findall(r"\w+", names.decode())} if place.is_dir() else set()
        )
    return frozenset(found & _sources())


@cache
def _sources() -> frozenset[Path]:
    """All sources of this package."""
    return frozenset(_PACKAGE.rglob("*.py"))


@cache
def _leads_to_kernels(path: Path) -> bool:
    return path.name == "__init__.py" or b"kernel(" in (text := path.read_bytes()) or b"@kernel" in text


@cache
def _digest(path: Path) -> bytes:
    return hashlib.sha256(path.name.encode() + b"\0" + path.read_bytes()).digest()


@cache
def source_hash(path: Path) -> str:
    """Hash (16 hex digits) of a source and of those of this package that it imports, in turn where these have kernels."""
    known, new = set(), {path}
    while new:
        known |= new
        new = {
            found for one in new if one == path or _leads_to_kernels(one) for found in _imported(one)
        } - known
    return hashlib.sha256(b"".join(sorted(map(_digest, known)))).hexdigest()[:16]


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
    key, reasons, found = cache_name(), [], None
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


def kernel_folder(path: Path) -> Path | None:
    """The folder of the kernels of a source; None where there is no cache."""
    return None if CACHE_FOLDER is None else CACHE_FOLDER / source_hash(path)


def compiled_before(module: str, kernel: str) -> bool:
    """Whether the cache has a kernel, as it is in the sources, of the module `module` ("ksd.model.newton")."""
    folder = kernel_folder(_PACKAGE.parent.joinpath(*module.split(".")).with_suffix(".py"))
    return folder is None or any(folder.rglob(f"*{kernel}*.nbi"))
