"""Reading of HDF5 files from memory without trusting what they declare; every HDF5 file is read here.

A file may declare 80 GB of numbers in a kilobyte, data stored in other files, or filters that load foreign code. All of it
is refused before anything is read. HDF5 verifies Fletcher32 checksums where present.
"""

from __future__ import annotations

import io
import math
import zlib
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ksd.files import MAX_READ_BYTES

T = TypeVar("T")
GZIP, SHUFFLE, FLETCHER32 = 1, 2, 3
CHECKSUM_BYTES = 4
"""Bytes of a Fletcher32 checksum."""
TEXTS_PER_READ = 256
"""Texts read at once."""

_PLAIN_TYPES = [f"IEEE_F{n}{order}" for n in (32, 64) for order in ("LE", "BE")]
_PLAIN_TYPES += [f"STD_{i}{n}{order}" for i in "IU" for n in (8, 16, 32, 64) for order in ("LE", "BE")]


class BoundedReader:
    """A file in memory: `items` of a group, `numbers` and `texts` of datasets, `text` and `whole` of attributes.

    All raise ValueError for malformed content or more than MAX_READ_BYTES bytes, and whatever h5py raises.
    """

    def __init__(self, file: Any, h5py: Any) -> None:
        self.file, self._h5py = file, h5py
        self._left = MAX_READ_BYTES

    def items(self, group: Any) -> dict[str, Any]:
        """Datasets and groups by name. Links that may lead elsewhere are refused."""
        if not isinstance(group, self._h5py.Group):
            raise ValueError(f"'{getattr(group, 'name', group)}' is no group")
        for name in group:
            if not isinstance(group.get(name, getlink=True), self._h5py.HardLink):
                raise ValueError(f"'{name}' is a link to another place or file")
        return dict(group.items())

    def numbers(self, data: Any) -> NDArray[np.float64]:
        """A dataset of real numbers."""
        self._take(data)
        kind = data.id.get_type()
        # a float of another exponent, which one damaged byte declares, is read as a float all the same
        if not any(kind.equal(getattr(self._h5py.h5t, known)) for known in _PLAIN_TYPES):
            raise ValueError(f"'{data.name}' holds {data.dtype}, no plain numbers")
        found: NDArray[np.float64] = np.asarray(data[()], float)
        return found

    def texts(self, data: Any) -> list[str]:
        """A one-dimensional dataset of texts."""
        self._take(data)
        if self._h5py.check_string_dtype(data.dtype) is None or data.ndim != 1:
            raise ValueError(f"'{data.name}' holds no texts")
        result: list[str] = []
        for first in range(0, len(data), TEXTS_PER_READ):
            # many entries may point at one long text
            result += data.asstr()[first : first + TEXTS_PER_READ].tolist()
            self._spend(sum(map(len, result[first:])))
        return result

    def text(self, attributes: Any, name: str) -> str:
        """A scalar text attribute."""
        if attributes.get_id(name).shape != ():
            raise ValueError(f"attribute '{name}' is no text")
        value = attributes[name]
        if not isinstance(value, str):
            raise ValueError(f"attribute '{name}' is no text")
        return value

    def whole(self, attributes: Any, name: str) -> int:
        """A scalar integer attribute."""
        attribute = attributes.get_id(name)
        if attribute.shape != () or attribute.dtype.kind not in "iu":
            raise ValueError(f"attribute '{name}' is no whole number")
        return int(attributes[name])

    def _spend(self, size: int) -> None:
        self._left -= size
        if self._left < 0:
            raise ValueError(f"it holds more than the {MAX_READ_BYTES >> 20} MiB that are read")

    def _take(self, data: Any) -> None:
        """Raise ValueError unless the dataset can be read within bounds from this file alone."""
        if not isinstance(data, self._h5py.Dataset) or data.shape is None:
            raise ValueError(f"'{getattr(data, 'name', data)}' is no dataset")
        if data.is_virtual or data.external:
            raise ValueError(f"the numbers of '{data.name}' are in other files")
        self._spend(data.size * data.dtype.itemsize)
        plan = data.id.get_create_plist()
        filters = [plan.get_filter(k)[0] for k in range(plan.get_nfilters())]
        if not {GZIP, SHUFFLE, FLETCHER32}.issuperset(filters) or len(set(filters)) < len(filters):
            raise ValueError(f"'{data.name}' uses filters {filters} that are not read")
        if data.chunks is not None:
            size = math.prod(data.chunks) * data.dtype.itemsize
            if size > MAX_READ_BYTES:
                raise ValueError(f"'{data.name}' is in pieces of {size} bytes")
            data.id.chunk_iter(lambda piece: self._fits(data, piece, size, filters))

    def _fits(self, data: Any, piece: Any, size: int, filters: list[int]) -> None:
        """Raise ValueError for a chunk that does not unpack to its size: HDF5 would overrun its buffer with a larger one and
        read beyond the end of a smaller one."""
        mask, packed = data.id.read_direct_chunk(piece.chunk_offset)
        if GZIP in filters:
            unpacking = zlib.decompressobj()
            try:
                length = len(unpacking.decompress(packed, size + CHECKSUM_BYTES + 1))
            except zlib.error as error:
                raise ValueError(f"a piece of '{data.name}' cannot be unpacked") from error
            sums = CHECKSUM_BYTES if FLETCHER32 in filters[: filters.index(GZIP)] else 0
        else:
            length, sums = len(packed), CHECKSUM_BYTES if FLETCHER32 in filters else 0
        if mask or length != size + sums:
            raise ValueError(f"a piece of '{data.name}' does not unpack to its {size} bytes")


def read_hdf5(content: bytes, read: Callable[[BoundedReader], T]) -> T:
    """The result of `read` for the bytes of an HDF5 file. Raises what h5py raises for anything else."""
    import h5py

    with h5py.File(io.BytesIO(content), "r") as file:
        return read(BoundedReader(file, h5py))
