"""Record files: one HDF5 file per joint family, with a checksum and written atomically; and the folders they are found in.

The header of 512 bytes (the HDF5 user block) holds a signature, the format number and the SHA-256 of both and of all that
follows, so that any altered or missing bit is detected, also in space HDF5 itself does not use. Datasets also have
Fletcher32 checksums, for other programs. Equal records give equal bytes.
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
"""Format that this version writes, and the newest that it reads."""
SIGNATURE = b"ksd joint record\n"
HEADER_BYTES = 512
RECORD_SUFFIX = ".h5"
_FUNCTION_UNITS = {
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
"""Fields of `Record` that are stored as attributes: text, JSON lists, and JSON lists of dataclasses."""
_record_cache: dict[str, tuple[tuple[int, ...], Record]] = {}
"""`file_stamp` and record by resolved path."""


def sealed_header(body: bytes, number: int, signature: bytes = SIGNATURE) -> bytes:
    """The header (HEADER_BYTES) of a file with the HDF5 image `body`, of format `number`."""
    first = signature + f"format {number}\n".encode()
    return (first + f"sha256 {hashlib.sha256(first + body).hexdigest()}\n".encode()).ljust(
        HEADER_BYTES, b"\0"
    )


def write_record(record: Record, path: str | os.PathLike[str]) -> Path:
    """Write `record` to `path` atomically, and make its folder if it is missing. Returns the path.

    Raises RecordError when it cannot be written.
    """
    return write_file(make_parent_folder(path), record_bytes(record), what="joint record", error=RecordError)


def make_parent_folder(path: str | os.PathLike[str]) -> Path:
    """Make the folder of `path` if it is missing, and return the path. Raises RecordError."""
    target = Path(path)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordError(
            f"folder '{target.parent}' cannot be made: {error.strerror}; choose a folder that can be written."
        ) from error
    return target


def record_bytes(record: Record) -> bytes:
    """The content of the file of `record`; equal records give equal bytes."""
    body = _hdf5_image(record)[HEADER_BYTES:]
    return sealed_header(body, FORMAT) + body


def _hdf5_image(record: Record) -> bytes:
    """The HDF5 file of a record as bytes, with an empty header."""
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
        # in the order in which they are read, so that a record that is read and written gives the same file
        for mesh, functions in sorted(record.functions.items(), key=lambda item: str(item[0])):
            for group, array in sorted(functions.groups().items()):
                if array.size == 0:
                    continue
                _store_array(
                    file, f"functions/{mesh}/{group}", np.asarray(array, float), _FUNCTION_UNITS[group]
                )
        if record.probes is not None:
            for name, units in _PROBE_UNITS.items():
                _store_array(file, f"probes/{name}", np.asarray(getattr(record.probes, name), float), units)
    return buffer.getvalue()


def _store_array(file: Any, name: str, array: np.ndarray, units: str) -> None:
    """Add a compressed dataset with its units as attribute."""
    filters = {"compression": "gzip", "compression_opts": 6, "shuffle": True, "fletcher32": True}
    dataset = file.create_dataset(name, data=array, **filters)
    dataset.attrs["units"] = units


def read_record(path: str | os.PathLike[str]) -> Record:
    """The record in file `path`; unchanged files are read once per process.

    Raises RecordError when the file is missing, no record, truncated, altered in any bit, or of a newer format.
    """
    file = Path(path)
    key, stamp = str(file.resolve()), file_stamp(file)
    if stamp is not None and key in _record_cache and _record_cache[key][0] == stamp:
        return _record_cache[key][1]
    again = training_hint(file.stem)
    content = read_file(file, what="joint record", error=RecordError, hint=again)
    _check_seal(content, file)
    try:
        record = read_hdf5(content, _record_of_hdf5)
        check_record(record)
    except Exception as error:
        # a correct checksum does not mean that the content is correct: h5py, json and numpy raise any exception
        message = " ".join(str(error).split()).rstrip(".") or type(error).__name__
        raise RecordError(
            f"{file} is sealed but not a readable joint record ({message}); {again}."
        ) from error
    if stamp is not None:
        _record_cache[key] = (stamp, record)
    return record


def file_stamp(path: str | os.PathLike[str]) -> tuple[int, ...] | None:
    """Times, size and inode of a file, which change when it is replaced or altered; None if there is none."""
    try:
        status = os.stat(path)
    except (OSError, ValueError):
        return None
    # with the inode, since the clocks of file systems do not resolve two writes within milliseconds
    return status.st_mtime_ns, status.st_ctime_ns, status.st_size, status.st_ino


def training_hint(family: str) -> str:
    """Advice for a record that is missing or damaged, for messages."""
    if family in joint_families():
        return f"run `ksd train {family}`"
    return f"make it with ksd.train(joint), or ksd.train(ksd.Design({family!r}, ...)) for a family with ranges of shape"


def _check_seal(content: bytes, file: Path) -> None:
    """Raise RecordError unless signature, checksum and format of a record file are right."""
    again = training_hint(file.stem)
    head, body = content[:HEADER_BYTES], content[HEADER_BYTES:]
    if not head.startswith(SIGNATURE):
        raise RecordError(f"{file} is not a ksd joint record; remove it, or {again}.")
    number = _format_number(head)
    if head != sealed_header(body, number):
        raise RecordError(
            f"{file} is damaged (its content does not match its checksum: truncated or altered); "
            f"restore it, or {again}."
        )
    if number > FORMAT:
        raise RecordError(
            f"{file} has record format {number}, newer than the {FORMAT} this version of ksd reads; "
            f"update ksd, or {again}."
        )


def _format_number(head: bytes) -> int:
    """The format number in a header; -1, which matches no header, if there is none."""
    digits = head[len(SIGNATURE) :].split(b"\n", 1)[0].removeprefix(b"format ")
    return int(digits) if digits.isdigit() and len(digits) < 10 else -1


def _record_of_hdf5(reader: BoundedReader) -> Record:
    """The record in an HDF5 file, its numbers as float64; `check_record` checks its consistency."""
    items, attributes = reader.items(reader.file), reader.file.attrs
    # before format 3 the attribute "leaves" was named "leafs"
    names = {k: "leafs" if k == "leaves" and k not in attributes else k for k in _LIST_FIELDS}
    fields: dict[str, Any] = {k: tuple(json.loads(reader.text(attributes, n))) for k, n in names.items()}
    fields |= {k: reader.text(attributes, k) for k in _TEXT_FIELDS}
    for name, row_class in _TABLE_FIELDS.items():
        fields[name] = tuple(row_class(**row) for row in json.loads(reader.text(attributes, name)))
    fields["design"] = json.loads(reader.text(attributes, "design"))
    powers = reader.numbers(items["powers"]).astype(np.int64)
    no_blocks = {"blocks": np.zeros((0, 6, len(powers)))}
    functions: dict[Mesh, Functions] = {}
    for name, group in reader.items(items["functions"]).items():
        arrays = {part: reader.numbers(dataset) for part, dataset in reader.items(group).items()}
        functions[int(name) if name.isdigit() else name] = Functions(**{**no_blocks, **arrays})
    if "probes" in items:
        probes = reader.items(items["probes"])
        fields["probes"] = Probes(*(reader.numbers(probes[name]) for name in _PROBE_UNITS))
    return Record(powers=powers, functions=functions, **fields)


@cache
def shipped_folder() -> Path:
    """The folder of shipped records: `database` in an installed package, next to the package in a source tree."""
    package = Path(__file__).resolve().parent.parent
    installed = package / "database"
    return installed if installed.is_dir() else package.parent / "database"


def _folder_names() -> list[str]:
    """`record_folders` as text, since every solve needs them and Path objects are slow."""
    from_environment = os.environ.get("KSD_DATABASE")
    return [*([from_environment] if from_environment else []), "database", str(shipped_folder())]


def record_folders() -> list[Path]:
    """The folders in which records are searched, in this order: $KSD_DATABASE, ./database, those of the package."""
    return [Path(folder) for folder in _folder_names()]


def find_record_file(family: str) -> tuple[str, tuple[int, ...]] | None:
    """Path and `file_stamp` of the record file of `family`, the first in `record_folders`; None if there is none."""
    for folder in _folder_names():
        path = f"{folder}{os.sep}{family}{RECORD_SUFFIX}"
        stamp = file_stamp(path)
        if stamp is not None:
            return path, stamp
    return None


def find_record(family: str) -> Record:
    """The trained record of a joint family by its name, from the first of the `record_folders` that has one.

    Raises RecordError when there is none, or that one is damaged.

    >>> record = ksd.find_record("cross_flexure")
    >>> print(f"{record.motions[0].name} up to {record.motions[0].high / deg:.0f} degrees")
    angle up to 75 degrees
    """
    found = find_record_file(family)
    if found is None:
        folders = ", ".join(str(f) for f in record_folders())
        raise RecordError(
            f"No joint record of family {family!r} in {folders}; {training_hint(family)}, or name the folder it was trained "
            "into by the environment variable KSD_DATABASE."
        )
    path, _ = found
    record = read_record(path)
    if record.family != family:
        raise RecordError(f"{path} holds the record of {record.family!r}; {training_hint(family)}.")
    return record


def lookup_hint(path: Path, family: str) -> str:
    """Advice how to make `find_record` use the record of `family` at `path`, for messages; "" if it does."""
    if path.name != f"{family}{RECORD_SUFFIX}":
        return f"a record is looked for by the name of its family: rename it {family}{RECORD_SUFFIX}"
    found = find_record_file(family)
    if found is not None and Path(found[0]).resolve() == path.resolve():
        return ""
    return f"it is used where the environment variable KSD_DATABASE names its folder: KSD_DATABASE={path.parent.resolve()}"


@dataclass(frozen=True)
class Listing:
    """Facts about one record file, as printed by `ksd info`.

    problem: the reason why it cannot be used; then only path, size and checksum are given. checksum: SHA-256 of the file;
    size [bytes]; worst: (group, largest error on fresh shapes over all meshes); age [days], nan for an unknown date; leaves:
    number of leaf springs, 0 where only chains were trained.
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
    leaves: int = 0
    problem: str = ""


def describe_database(today: datetime.date | None = None) -> list[Listing]:
    """The records that `find_record` uses, sorted by family; damaged ones with their problem."""
    by_family: dict[str, Listing] = {}
    for folder in record_folders():
        for path in sorted(folder.glob(f"*{RECORD_SUFFIX}")):
            by_family.setdefault(path.stem, _describe(path, today or datetime.date.today()))
    return [by_family[name] for name in sorted(by_family)]


def _describe(path: Path, today: datetime.date) -> Listing:
    """The listing of a record file."""
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
    strain = record.functions.get("strain")
    leaves = 0 if strain is None or strain.amplitudes is None else len(strain.amplitudes)
    return Listing(
        record.family, path, size, checksum, FORMAT, record.motions, record.parameters,
        tuple(record.functions), worst, record.trained, age, record.version, leaves,
    )  # fmt: skip
