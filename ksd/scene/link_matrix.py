"""Stiffness matrices of elastic links from files in numpy's format or in HDF5."""

from __future__ import annotations

import io
import math
import os
import zipfile

import numpy as np

from ksd.checks import clear_argument_errors
from ksd.errors import SceneError
from ksd.files import MAX_READ_BYTES, named_file, read_file
from ksd.hdf5 import BoundedReader, read_hdf5
from ksd.scene.effects import LinkMatrix

KEYS = ("points", "K")
"""Names of the arrays in a file."""


def _arrays_of_npz(content: bytes) -> dict[str, np.ndarray]:
    """The arrays KEYS of a numpy file, as far as they exist."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        names = {f"{key}.npy" for key in KEYS} & set(archive.namelist())
        return {name.removesuffix(".npy"): _array(archive, name) for name in names}


def _array(archive: zipfile.ZipFile, name: str) -> np.ndarray:
    """One array of a numpy file. Raises ValueError unless its size is that declared in its header, and within the limit."""
    if archive.getinfo(name).file_size > MAX_READ_BYTES:
        raise ValueError(f"{name} is larger than the {MAX_READ_BYTES >> 20} MiB that are read")
    with archive.open(name) as member:
        content = io.BytesIO(member.read(MAX_READ_BYTES + 1))
    version = np.lib.format.read_magic(content)
    header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, kind = header(content)
    if (
        kind.kind not in "fiu"
        or math.prod(shape) * kind.itemsize != content.getbuffer().nbytes - content.tell()
    ):
        raise ValueError(f"{name} is not the array of numbers it declares")
    content.seek(0)
    array: np.ndarray = np.load(content, allow_pickle=False)
    return array


def _arrays_of_hdf5(content: bytes) -> dict[str, np.ndarray]:
    """The arrays KEYS of an HDF5 file, as far as they exist."""

    def arrays(reader: BoundedReader) -> dict[str, np.ndarray]:
        items = reader.items(reader.file)
        return {name: reader.numbers(items[name]) for name in KEYS if name in items}

    return read_hdf5(content, arrays)


READERS = {".npz": _arrays_of_npz, ".h5": _arrays_of_hdf5}
"""Reader of a file content by the suffix of the file name."""


@clear_argument_errors
def link_matrix(path: str | os.PathLike[str]) -> LinkMatrix:
    """The stiffness of an elastic link from the file `path`, `.npz` or `.h5`.

    Its arrays: `points` (2, 3) [m], the interfaces, global, undeformed; `K` (12 + m, 12 + m), the stiffness (N/m, N, Nm)
    with the six displacements and rotations of each interface first and m internal modes last, which are condensed
    statically. Raises SceneError for a file that is missing, of another kind, damaged, or without these arrays.

    >>> K = np.zeros((12, 12))
    >>> K[np.ix_([0, 6], [0, 6])] = 1e5 * np.array([[1, -1], [-1, 1]])
    >>> np.savez("rod.npz", points=[(0, 0, 0), (0.1, 0, 0)], K=K)
    >>> ksd.link_matrix("rod.npz").stiffness[0][6]
    -100000.0
    """
    file = named_file(path, "link matrix")
    read = READERS.get(file.suffix.lower())
    if read is None:
        raise SceneError(f"link matrix '{file}': a file of kind {' or '.join(READERS)} is needed.")
    content = read_file(file, what="link matrix")
    try:
        arrays = read(content)
    except Exception as reason:
        # the readers of foreign formats do not document what they raise
        message = " ".join(str(reason).split()) or type(reason).__name__
        raise SceneError(
            f"link matrix '{file}' cannot be read: {message.rstrip('.')}; export it again, numpy or HDF5."
        ) from None
    for key in KEYS:
        if key not in arrays:
            raise SceneError(
                f"link matrix '{file}': array '{key}' is missing; write K and points (see ksd.link_matrix)."
            )
    points, K = np.asarray(arrays["points"], float), np.asarray(arrays["K"], float)
    if points.ndim != 2 or points.shape[1] != 3 or K.ndim != 2 or K.shape[0] != K.shape[1] or len(K) < 12:
        raise SceneError(
            f"link matrix '{file}': points {points.shape} must be (2, 3), K {K.shape} square, 12 or more."
        )
    if not np.all(np.isfinite(K)):
        raise SceneError(f"link matrix '{file}': K holds numbers that are not finite; export it again.")
    n = 6 * len(points)
    inner = K[n:, n:]
    if len(inner):
        try:
            K = K[:n, :n] - K[:n, n:] @ np.linalg.solve(inner, K[n:, :n])
        except np.linalg.LinAlgError:
            raise SceneError(
                f"link matrix '{file}': the stiffness of its internal modes is singular."
            ) from None
    return LinkMatrix(tuple(map(tuple, points.tolist())), tuple(map(tuple, K.tolist())))  # type: ignore[arg-type]
