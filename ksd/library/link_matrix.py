"""Read and write the stiffness matrix of a flexible link as HDF5 (`K` and `points`, see `ksd.link_matrix`)."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np


def read_hdf5(path: Path) -> dict[str, np.ndarray]:
    """The datasets at the root of an HDF5 file; OSError where it is none."""
    with h5py.File(path, "r") as file:
        return {key: np.asarray(value) for key, value in file.items() if isinstance(value, h5py.Dataset)}
