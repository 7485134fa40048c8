"""Records on disk: one HDF5 file per family, sealed, replaced atomically, read in one go.

The first 512 bytes (the HDF5 user block) hold a signature, the format number and the SHA-256 of both and of
all that follows, so any altered or missing bit is found, also in space HDF5 itself does not use. Datasets
carry Fletcher32 besides, for programs that read the file without us. Same record, same bytes.
"""

from __future__ import annotations

import datetime
import hashlib
import io
import json
import math
import os
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ksd.errors import RecordError
from ksd.files import read_file, write_file
from ksd.hdf5 import BoundedReader, read_hdf5
from ksd.library.functions import Functions, Mesh
from ksd.library.record import Evidence, Parameter, Probes, Record, Residual, Stroke
from ksd.library.record_checks import check_record
from ksd.scene.families import joint_families

FORMAT = 3
"""Format this version writes, and the newest it reads."""
SIGNATURE = b"ksd joint record\n"
HEADER_BYTES = 512
RECORD_SUFFIX = ".h5"
_UNITS = {
    "interface": "rad (0:3), joint length (3:6)",
    "blocks": "rad (0:3), joint length (3:6)",
    "amplitudes": "1/leaf length",
    "wrench": "EIz/leaf length^2 (0:3), EIz/leaf length (3:6)",
    "rotations": "rad",
}
_PROBE_UNITS = {
    "shapes": "SI, as the parameters",
    "motions": "rad, or joint lengths",
    "values": "as the functions, side by side",
}
_TEXT_FIELDS = ("family", "trained", "version")
_LIST_FIELDS = ("leaves", "blocks", "orders", "samples", "history")
_TABLE_FIELDS = {"motions": Stroke, "parameters": Parameter, "residuals": Residual, "evidence": Evidence}
_record_cache: dict[str, tuple[tuple[int, ...], Record]] = {}


def sealed_header(body: bytes, number: int, signature: bytes = SIGNATURE) -> bytes:
    """The 512 bytes in front of `body`."""
    first = signature + f"format {number}\n".encode()
    return (first + f"sha256 {hashlib.sha256(first + body).hexdigest()}\n".encode()).ljust(
        HEADER_BYTES, b"\0"
    )


def write_record(record: Record, path: str | os.PathLike[str]) -> Path:
    """Write `record` to `path`, whole or not at all, its folder made where it is missing. Returns the path.

    Raises RecordError when it cannot be written.
    """
    return write_file(make_parent_folder(path), record_bytes(record), what="joint record", error=RecordError)


def make_parent_folder(path: str | os.PathLike[str]) -> Path:
    """The path, its folder made where it is missing. Raises RecordError when that is not possible."""
    target = Path(path)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordError(
            f"folder '{target.parent}' cannot be made: {error.strerror}; choose a folder that can be written."
        ) from error
    return target


def record_bytes(record: Record) -> bytes:
    """The file of `record`, byte for byte: the same record gives the same bytes."""
    body = _hdf5_image(record)[HEADER_BYTES:]
    return sealed_header(body, FORMAT) + body


def _hdf5_image(record: Record) -> bytes:
    """The HDF5 image of a record, with an empty user block."""
    import h5py

    buffer = io.BytesIO()
    with h5py.File(buffer, "w", libver=("v110", "v110"), userblock_size=HEADER_BYTES) as file:
        file.attrs["format"] = FORMAT
        file.attrs["creator"] = f"ksd {record.version}"
        for name in _TEXT_FIELDS:
            file.attrs[name] = getattr(record, name)
        for name in _LIST_FIELDS:
            file.attrs[name] = json.dumps(list(getattr(record, name)))
        file.attrs["design"] = json.dumps(dict(sorted(record.design.items())))
        for name in _TABLE_FIELDS:
            file.attrs[name] = json.dumps([asdict(item) for item in getattr(record, name)])
        _store_array(file, "powers", np.asarray(record.powers, np.int16), "1")
        # in the order they are read back, so that a record read and written is the same file
        for mesh, functions in sorted(record.functions.items(), key=lambda item: str(item[0])):
            for group, array in sorted(functions.groups().items()):
                if array.size == 0:
                    continue
                _store_array(file, f"functions/{mesh}/{group}", np.asarray(array, float), _UNITS[group])
        if record.probes is not None:
            for name, units in _PROBE_UNITS.items():
                _store_array(file, f"probes/{name}", np.asarray(getattr(record.probes, name), float), units)
    return buffer.getvalue()


def _store_array(file: Any, name: str, array: np.ndarray, units: str) -> None:
    filters = {"compression": "gzip", "compression_opts": 6, "shuffle": True, "fletcher32": True}
    made = file.create_dataset(name, data=array, **filters)
    made.attrs["units"] = units


def read_record(path: str | os.PathLike[str]) -> Record:
    """The record in file `path`; unchanged files are read once per process.

    Raises RecordError when the file is missing, foreign, truncated, altered in any bit, or of a newer format.
    """
    place = Path(path)
    key, stamp = str(place.resolve()), file_stamp(place)
    if stamp is not None and key in _record_cache and _record_cache[key][0] == stamp:
        return _record_cache[key][1]
    again = training_hint(place.stem)
    body = _check_seal(read_file(place, what="joint record", error=RecordError, hint=again), place)
    try:
        record = read_hdf5(body, _record_of_hdf5)
        check_record(record)
    except Exception as error:
        # a seal says that nothing was altered since, not that it was right: h5py, json and numpy raise what they like
        said = " ".join(str(error).split()).rstrip(".") or type(error).__name__
        raise RecordError(f"{place} is sealed but not a readable joint record ({said}); {again}.") from error
    if stamp is not None:
        _record_cache[key] = (stamp, record)
    return record


def file_stamp(path: str | os.PathLike[str]) -> tuple[int, ...] | None:
    """What changes when a file is replaced or altered; None where there is none."""
    try:
        status = os.stat(path)
    except (OSError, ValueError):
        return None
    # the inode too: clocks of file systems are too coarse to tell two writes within milliseconds
    return status.st_mtime_ns, status.st_ctime_ns, status.st_size, status.st_ino


def training_hint(family: str) -> str:
    """What to do about a record that is missing or damaged, in words."""
    if family in joint_families():
        return f"run `ksd train {family}`"
    return f"make it with ksd.train(joint), or ksd.train(ksd.Design({family!r}, ...)) for a family with ranges of shape"


def _check_seal(content: bytes, place: Path) -> bytes:
    """The HDF5 image, after every byte was checked."""
    again = training_hint(place.stem)
    head, body = content[:HEADER_BYTES], content[HEADER_BYTES:]
    if not head.startswith(SIGNATURE):
        raise RecordError(f"{place} is not a ksd joint record; remove it, or {again}.")
    number = _format_number(head)
    if head != sealed_header(body, number):
        raise RecordError(
            f"{place} is damaged (its content does not match its checksum: truncated or altered); "
            f"restore it, or {again}."
        )
    if number > FORMAT:
        raise RecordError(
            f"{place} has record format {number}, newer than the {FORMAT} this version of ksd reads; "
            f"update ksd, or {again}."
        )
    return content


def _format_number(head: bytes) -> int:
    """The format number a seal states; -1, which no seal matches, when it states none."""
    word = head[len(SIGNATURE) :].split(b"\n", 1)[0].removeprefix(b"format ")
    return int(word) if word.isdigit() and len(word) < 10 else -1


def _record_of_hdf5(found: BoundedReader) -> Record:
    """A record as the file says it, its numbers in float64; see `check_record` for whether it makes sense."""
    items, attributes = found.items(found.file), found.file.attrs
    # before format 3 the leaves were called leafs
    named = {k: "leafs" if k == "leaves" and k not in attributes else k for k in _LIST_FIELDS}
    words: dict[str, Any] = {k: tuple(json.loads(found.text(attributes, name))) for k, name in named.items()}
    words |= {k: found.text(attributes, k) for k in _TEXT_FIELDS}
    for name, kind in _TABLE_FIELDS.items():
        words[name] = tuple(kind(**item) for item in json.loads(found.text(attributes, name)))
    words["design"] = json.loads(found.text(attributes, "design"))
    powers = found.numbers(items["powers"]).astype(np.int64)
    none = {"blocks": np.zeros((0, 6, len(powers)))}
    functions: dict[Mesh, Functions] = {}
    for name, group in found.items(items["functions"]).items():
        stored = {part: found.numbers(data) for part, data in found.items(group).items()}
        functions[int(name) if name.isdigit() else name] = Functions(**{**none, **stored})
    if "probes" in items:
        probes = found.items(items["probes"])
        words["probes"] = Probes(*(found.numbers(probes[name]) for name in _PROBE_UNITS))
    return Record(powers=powers, functions=functions, **words)


@cache
def shipped_folder() -> Path:
    """The records that ship: `database` inside an installed package, beside the package in a source tree."""
    package = Path(__file__).resolve().parent.parent
    installed = package / "database"
    return installed if installed.is_dir() else package.parent / "database"


def _folder_names() -> list[str]:
    """`record_folders` as text: asked by every solve, and paths are slow to make and join."""
    named = os.environ.get("KSD_DATABASE")
    return [*([named] if named else []), "database", str(shipped_folder())]


def record_folders() -> list[Path]:
    """Where records are looked for, first hit wins: $KSD_DATABASE, ./database, those shipped with the
    package.
    """
    return [Path(folder) for folder in _folder_names()]


def find_record_file(family: str) -> tuple[str, tuple[int, ...]] | None:
    """Path and stamp of the record `find_record` takes for `family`; another one once that is replaced. None for none."""
    for folder in _folder_names():
        path = f"{folder}{os.sep}{family}{RECORD_SUFFIX}"
        stamp = file_stamp(path)
        if stamp is not None:
            return path, stamp
    return None


def find_record(family: str) -> Record:
    """The trained record of a joint family by its name, the first found in `record_folders`.

    Raises RecordError when there is none or the first found is damaged.
    """
    found = find_record_file(family)
    if found is None:
        places = ", ".join(str(f) for f in record_folders())
        raise RecordError(
            f"No joint record of family {family!r} in {places}; {training_hint(family)}, or name the folder it was trained "
            "into by the environment variable KSD_DATABASE."
        )
    record = read_record(found[0])
    if record.family != family:
        raise RecordError(f"{found[0]} holds the record of {record.family!r}; {training_hint(family)}.")
    return record


def lookup_hint(path: Path, family: str) -> str:
    """How to make `find_record` use the record of `family` at `path`, in words; empty where it does."""
    if path.name != f"{family}{RECORD_SUFFIX}":
        return f"a record is looked for by the name of its family: rename it {family}{RECORD_SUFFIX}"
    found = find_record_file(family)
    if found is not None and Path(found[0]).resolve() == path.resolve():
        return ""
    return f"it is used where the environment variable KSD_DATABASE names its folder: KSD_DATABASE={path.parent.resolve()}"


@dataclass(frozen=True)
class Listing:
    """One record file as `ksd info` prints it.

    problem: why it cannot be used, in a sentence; then only path, size and checksum are filled in. checksum:
    SHA-256 of the file; size [bytes]; worst: largest error on fresh shapes by group, over all meshes; age
    [days], nan when the date is unknown.
    """

    family: str
    path: Path
    size: int
    checksum: str
    format: int = 0
    motions: tuple[Stroke, ...] = ()
    parameters: tuple[Parameter, ...] = ()
    meshes: tuple[Mesh, ...] = ()
    worst: tuple[tuple[str, float], ...] = ()
    trained: str = ""
    age: float = math.nan
    version: str = ""
    problem: str = ""


def describe_database(today: datetime.date | None = None) -> list[Listing]:
    """All records that `find_record` would use, by family; damaged ones are listed with their problem."""
    seen: dict[str, Listing] = {}
    for folder in record_folders():
        for path in sorted(folder.glob(f"*{RECORD_SUFFIX}")):
            seen.setdefault(path.stem, _describe(path, today or datetime.date.today()))
    return [seen[name] for name in sorted(seen)]


def _describe(path: Path, today: datetime.date) -> Listing:
    """What is listed of a record file, or why it cannot be read."""
    size, checksum = 0, ""
    try:
        content = read_file(path, what="joint record", error=RecordError, hint=training_hint(path.stem))
        size, checksum = len(content), hashlib.sha256(content).hexdigest()
        record = read_record(path)
    except RecordError as error:
        return Listing(path.stem, path, size, checksum, problem=str(error))
    groups = sorted({r.group for r in record.residuals})
    worst = tuple((g, max(r.fresh_max for r in record.residuals if r.group == g)) for g in groups)
    try:
        age = float((today - datetime.date.fromisoformat(record.trained)).days)
    except ValueError:
        age = math.nan
    return Listing(
        record.family, path, size, checksum, FORMAT, record.motions, record.parameters,
        tuple(record.functions), worst, record.trained, age, record.version,
    )  # fmt: skip
