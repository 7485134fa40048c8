"""Files for ParaView: leaf springs as ribbons of quadrilaterals, rigid blocks as lines, in VTK's XML format (.vtu).

Positions in m. Point arrays: displacement [m] and von_mises_MPa, the largest stress over the section of a leaf, 0 on
blocks. Cell arrays: body (number in the list of the file's comment, leaves first) and rigid (0 leaf, 1 block). A stroke is
one file per pose and a .pvd that lists them. No VTK library is needed to write them.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from ksd.errors import SceneError
from ksd.files import write_file
from ksd.view.bodies import edge_lines
from ksd.view.drawable import Drawable
from ksd.view.figure import Array
from ksd.view.stress_colors import stress_along

_LINE, _QUAD = 3, 9


class _Grid:
    """Points, cells and their numbers, collected part by part."""

    def __init__(self) -> None:
        self.points: list[Array] = []
        self.displacement: list[Array] = []
        self.stress: list[Array] = []
        self.cells: list[np.ndarray] = []
        self.kinds: list[int] = []
        self.body: list[int] = []
        self.names: list[str] = []
        self.count = 0

    def add(
        self, name: str, rest: Array, place: Array, cells: np.ndarray, *, stress: Array | None = None
    ) -> None:
        """A body of points (k, 3) and cells (n, corners) of its own point numbers; stress (k,) [MPa], none when None."""
        self.points.append(place)
        self.stress.append(np.zeros(len(place)) if stress is None else stress)
        self.displacement.append(place - rest)
        self.cells += list(cells + self.count)
        self.kinds += [_QUAD if cells.shape[1] == 4 else _LINE] * len(cells)
        self.body += [len(self.names)] * len(cells)
        self.names.append(name)
        self.count += len(place)


def collect_cells(configuration: Drawable) -> _Grid:
    """Cells of the leaf springs and blocks of a configuration."""
    shape, grid = configuration.shape(), _Grid()
    # beam theory gives no stress in a solid
    known = not configuration.model.solids
    stress = stress_along(configuration, shape) if known else {}
    for leaf in shape.leaves:
        k = len(leaf.s)
        rest = np.vstack(edge_lines(leaf.rest, leaf.rest_axes, leaf.width))
        place = np.vstack(edge_lines(leaf.place, leaf.axes, leaf.width))
        i = np.arange(k - 1)
        cells = np.stack([i, i + 1, i + 1 + k, i + k], axis=1)
        grid.add(leaf.name, rest, place, cells, stress=np.tile(stress.get(leaf.name, np.full(k, np.nan)), 2))
    for block in shape.blocks:
        k = len(block.rest)
        rest = np.vstack([block.rest.mean(axis=0), block.rest])
        place = np.vstack([block.place.mean(axis=0), block.place])
        grid.add(block.name, rest, place, np.stack([np.zeros(k, int), np.arange(1, k + 1)], axis=1))
    return grid


def _array(kind: str, name: str, values: Any, parts: int = 1) -> str:
    """One ASCII data array."""
    flat = np.asarray(values).ravel()
    text = " ".join(f"{v:.9g}" for v in flat) if kind == "Float64" else " ".join(map(str, flat.tolist()))
    head = f'<DataArray type="{kind}" Name={quoteattr(name)} NumberOfComponents="{parts}" format="ascii">'
    return f"{head}{text}</DataArray>"


def vtu_text(configuration: Drawable) -> str:
    """Content of a .vtu file (XML) of a configuration, lengths in m."""
    grid = collect_cells(configuration)
    offsets = np.cumsum([len(c) for c in grid.cells])
    rigid = [int(k == _LINE) for k in grid.kinds]
    names = escape("\n".join(f"{i} {name}" for i, name in enumerate(grid.names)).replace("--", "- -"))
    return "\n".join(
        [
            '<?xml version="1.0"?>',
            f"<!-- lengths in m; bodies by number:\n{names}\n-->",
            '<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian"><UnstructuredGrid>',
            f'<Piece NumberOfPoints="{grid.count}" NumberOfCells="{len(grid.cells)}">',
            '<PointData Vectors="displacement" Scalars="von_mises_MPa">',
            _array("Float64", "displacement", np.concatenate(grid.displacement), 3),
            _array("Float64", "von_mises_MPa", np.concatenate(grid.stress)),
            "</PointData>",
            "<CellData>",
            _array("Int32", "body", grid.body),
            _array("Int32", "rigid", rigid),
            "</CellData>",
            "<Points>",
            _array("Float64", "Points", np.concatenate(grid.points), 3),
            "</Points>",
            "<Cells>",
            _array("Int32", "connectivity", np.concatenate(grid.cells)),
            _array("Int32", "offsets", offsets),
            _array("UInt8", "types", grid.kinds),
            "</Cells>",
            "</Piece></UnstructuredGrid></VTKFile>",
            "",
        ]
    )


def write_vtu(configuration: Drawable, path: str | os.PathLike[str]) -> Path:
    """Write a `Configuration` for ParaView to `path` (.vtu), which it returns. SceneError if not .vtu or not writable."""
    target = Path(path)
    if target.suffix.lower() != ".vtu":
        raise SceneError(f"'{target}': VTK files of this kind end in .vtu")
    return write_file(target, vtu_text(configuration), what="VTK file")


def write_pvd(configurations: Sequence[Drawable], path: str | os.PathLike[str]) -> Path:
    """Write a stroke for ParaView: one .vtu per configuration next to `path`, a .pvd file that lists them in order, with the
    value of the first drive [m or rad] as their time, or their number where it does not rise. Returns the path. Raises
    SceneError for no configurations, another file type, or what cannot be written.
    """
    target = Path(path)
    if target.suffix.lower() != ".pvd":
        raise SceneError(f"'{target}': lists of VTK files end in .pvd")
    if not configurations:
        raise SceneError(f"'{target}': there are no configurations to write")
    times = [next(iter(c.targets.values()), 0.0) for c in configurations]
    if np.any(np.diff(times) <= 0.0):
        times = list(range(len(configurations)))
    digits = len(str(len(configurations) - 1))
    names = [f"{target.stem}_{k:0{digits}d}.vtu" for k in range(len(configurations))]
    for configuration, name in zip(configurations, names, strict=True):
        write_vtu(configuration, target.with_name(name))
    listed = [
        f'<DataSet timestep="{time:.9g}" part="0" file={quoteattr(name)}/>'
        for time, name in zip(times, names, strict=True)
    ]
    head = '<VTKFile type="Collection" version="0.1" byte_order="LittleEndian"><Collection>'
    text = "\n".join(['<?xml version="1.0"?>', head, *listed, "</Collection></VTKFile>", ""])
    return write_file(target, text, what="VTK file")
