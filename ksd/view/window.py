"""The mechanism in a window of its own, to be turned by hand, or rendered without a display; needs the `view` extra."""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import Any

import numpy as np

from ksd.errors import SceneError
from ksd.files import write_file
from ksd.view.bodies import (
    PAD_HALF_THICKNESS,
    Polygon,
    block_colors,
    clamp_pads,
    convex_parts,
    edge_lines,
    hull_faces,
    mechanism_size,
)
from ksd.view.camera import Camera, camera_of
from ksd.view.drawable import Drawable
from ksd.view.figure import TEXT_COLOR, UNDEFORMED_COLOR, Array, blended, check_picture, color_map
from ksd.view.stress_colors import STRESS_LABEL
from ksd.view.vtk import collect_cells


def show_mechanism(configuration: Drawable, path: str | os.PathLike[str] | None = None) -> Path | None:
    """Show leaf springs coloured by von Mises stress, links and ground as bodies, and the undeformed leaf springs in grey.

    path: a .png rendered off-screen in place of a window; returned. Raises SceneError where pyvista is not installed,
    and for another file type.
    """
    try:
        import pyvista as library
    except ImportError:
        raise SceneError(
            "a three-dimensional window needs pyvista: pip install 'ksd[view]'; pose.plot() and .vtu files do without"
        ) from None
    target = None if path is None else Path(path)
    if target is not None and check_picture(target).suffix.lower() != ".png":
        raise SceneError(f"picture '{target}': give a .png")
    # its signatures are generated at run time, so type checkers cannot use them
    pyvista: Any = library
    plotter = pyvista.Plotter(off_screen=target is not None, window_size=(1200, 900))
    plotter.set_background("white")
    _add_deformed(pyvista, plotter, configuration)
    _add_undeformed(plotter, configuration)
    _add_axes(plotter, camera_of(configuration.shape(), "3d", plane=None))
    if target is None:
        plotter.show()
        return None
    content = io.BytesIO()
    plotter.screenshot(content)
    plotter.close()
    return write_file(target, content.getvalue(), what="picture")


def _add_deformed(pyvista: Any, plotter: Any, configuration: Drawable) -> None:
    """Add leaf springs coloured by stress and blocks as bodies."""
    grid = collect_cells(configuration)
    cells = np.concatenate([np.concatenate([[len(c)], c]) for c in grid.cells])
    mesh = pyvista.UnstructuredGrid(cells, np.array(grid.kinds), 1e3 * np.concatenate(grid.points))
    mesh[STRESS_LABEL] = np.concatenate(grid.stress)
    rigid = np.array(grid.kinds) == pyvista.CellType.LINE
    # vertical, at the side, where it does not cover the mechanism
    bar = {
        "title": f"{STRESS_LABEL}\n",
        "color": TEXT_COLOR,
        "vertical": True,
        "position_x": 0.86,
        "position_y": 0.25,
    }
    bar |= {
        "width": 0.08,
        "height": 0.5,
        "title_font_size": 18,
        "label_font_size": 16,
        "fmt": "%.4g",
        "n_labels": 4,
    }
    scale = [0.0, max(float(mesh[STRESS_LABEL].max()), 1e-9)]
    # lighting would change colours that show a value
    plotter.add_mesh(
        mesh.extract_cells(~rigid),
        scalars=STRESS_LABEL,
        cmap=color_map(),
        clim=scale,
        lighting=False,
        scalar_bar_args=bar,
    )
    shape = configuration.shape()
    size, colors = mechanism_size(shape), block_colors(shape)
    for block in shape.blocks:
        for points in convex_parts(block, clamp_pads(shape, block), size):
            faces = [
                p for p in hull_faces(points, PAD_HALF_THICKNESS * size, "", edge="") if len(p.corners) == 3
            ]
            corners = 1e3 * np.concatenate([_outward_corners(p) for p in faces])
            cells = np.insert(np.arange(len(corners)).reshape(-1, 3), 0, 3, axis=1)
            plotter.add_mesh(pyvista.PolyData(corners, cells), color=blended(colors[block.name], 0.45))


def _outward_corners(polygon: Polygon) -> Array:
    """Corners (3, 3) of a triangle, counterclockwise seen from outside."""
    a, b, c = polygon.corners
    return polygon.corners if np.cross(b - a, c - a) @ polygon.normal > 0.0 else polygon.corners[::-1]


def _add_undeformed(plotter: Any, configuration: Drawable) -> None:
    """Add the outlines of the undeformed leaf springs."""
    for leaf in configuration.shape().leaves:
        low, high = (1e3 * e for e in edge_lines(leaf.rest, leaf.rest_axes, leaf.width))
        plotter.add_lines(
            np.vstack([low, high[::-1], low[:1]]), color=UNDEFORMED_COLOR, width=1, connected=True
        )


def _add_axes(plotter: Any, camera: Camera) -> None:
    """Add axes with labels [mm], and set the viewing direction."""
    plotter.show_axes()
    spans = np.ptp(np.reshape(plotter.bounds, (3, 2)), axis=1)
    titles = {"xtitle": "x [mm]", "ytitle": "y [mm]", "ztitle": "z [mm]"}
    counts = {f"n_{a}labels": 4 if s > 0.3 * spans.max() else 2 for a, s in zip("xyz", spans, strict=True)}
    flat = {"color": TEXT_COLOR, "location": "outer", "font_size": 12, "fmt": "%.0f", "use_3d_text": False}
    plotter.show_bounds(**flat, padding=0.05, **titles, **counts)
    plotter.view_vector(camera.toward, viewup=camera.up)
    plotter.camera.zoom(0.85)
