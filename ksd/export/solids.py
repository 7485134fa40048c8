"""Bodies in STL, 3MF and STEP (mm): leaf springs as solids with their thickness, links as the bodies that pictures show.

A leaf spring is what its section sweeps between its stations; a round one has `ROUND_CORNERS` corners, and the area
of the circle. A link is not known but for what is clamped to it: its body is an idea, and its name says so.
"""

from __future__ import annotations

import ctypes
import io
import math
import os
import signal
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from ksd.answers.shape import BlockShape, LeafShape, Shape, mechanism_shape
from ksd.checks import boolean, clear_argument_errors, whole_number
from ksd.errors import SceneError
from ksd.extras import cad_package
from ksd.files import check_target, write_file
from ksd.view.bodies import PAD_HALF_THICKNESS, clamp_pads, convex_parts, mechanism_size, thickened
from ksd.view.drawable import Drawable

Array = NDArray[np.float64]
MM = 1e3
SUFFIXES = (".stl", ".3mf", ".step", ".stp")
ROUND_CORNERS = 32
"""Corners of the section of a wire."""
STATIONS, STEP_STATIONS = 97, 13
"""Default number of stations of a leaf spring in meshes, and in STEP, where smooth surfaces go through them."""
SAME_PLANE = 1e-9
"""Largest difference of the planes of two triangles of one face."""


class Body(NamedTuple):
    """A closed surface: points (k, 3) [m] and triangles (n, 3), counterclockwise seen from outside. name: of its leaf or
    link; sections: points of each section of a leaf spring (stations, corners, 3), None of a link."""

    name: str
    points: Array
    triangles: NDArray[np.int64]
    sections: Array | None = None

    @property
    def volume(self) -> float:
        """Volume [m^3]."""
        a, b, c = (self.points[self.triangles[:, k]] - self.points[0] for k in range(3))
        return float((a * np.cross(b, c)).sum() / 6.0)


@clear_argument_errors
def write_bodies(
    configuration: Drawable,
    path: str | os.PathLike[str],
    *,
    deformed: bool = True,
    points: int | None = None,
) -> Path:
    """Write leaf springs and links as bodies: .stl (text), .3mf or .step (needs gmsh; fused), in mm. Returns
    the path.

    configuration: a pose; deformed: in this pose, else undeformed; points: stations along each leaf spring (97; 13 in STEP).
    Raises SceneError.

    Example: `ksd.export.write_bodies(pose, "pivot.step", deformed=False)`.
    """
    target = Path(path)
    kind = target.suffix.lower()
    if kind not in SUFFIXES:
        raise SceneError(f"'{target}': bodies are written to {', '.join(SUFFIXES)}")
    check_target(target, what="bodies")
    default = STATIONS if kind in (".stl", ".3mf") else STEP_STATIONS
    count = default if points is None else whole_number(points, "points", least=2, owner="write_bodies")
    bodies = list(bodies_of(configuration, boolean(deformed, "deformed", owner="write_bodies"), count))
    if kind == ".stl":
        return write_file(target, stl_text(bodies), what="bodies")
    return write_file(target, mf_archive(bodies) if kind == ".3mf" else _as_step(bodies), what="bodies")


def bodies_of(configuration: Drawable, deformed: bool, points: int) -> Iterator[Body]:
    """The bodies of all leaf springs and links of a configuration."""
    model = configuration.model
    at_rest = mechanism_shape(model, model.rest, points=points, load_factor=0.0)
    shape = configuration.shape(points=points) if deformed else at_rest
    for leaf in shape.leaves:
        yield _leaf_body(leaf)
    for moved, block in zip(shape.blocks, at_rest.blocks, strict=True):
        yield from _block_bodies(moved, block, at_rest)


def _leaf_body(leaf: LeafShape) -> Body:
    """The body of a leaf spring."""
    if leaf.is_round:
        angle = 2.0 * math.pi * np.arange(ROUND_CORNERS) / ROUND_CORNERS
        # as large as the circle
        grown = math.sqrt(2.0 * math.pi / (ROUND_CORNERS * math.sin(2.0 * math.pi / ROUND_CORNERS)))
        corners = 0.5 * grown * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    else:
        corners = 0.5 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    k, n = len(leaf.s), len(corners)
    second, third = (leaf.axes[:, :, c] * size[:, None] for c, size in ((1, leaf.thickness), (2, leaf.width)))
    sections = leaf.place[:, None] + corners[:, :1] * second[:, None] + corners[:, 1:] * third[:, None]
    i, j = np.meshgrid(np.arange(k - 1), np.arange(n), indexing="ij")
    a, b = (i * n + j).ravel(), (i * n + (j + 1) % n).ravel()
    sides = np.concatenate([np.stack([a, b, b + n], axis=1), np.stack([a, b + n, a + n], axis=1)])
    fan = np.stack([np.zeros(n - 2, int), np.arange(1, n - 1), np.arange(2, n)], axis=1)
    triangles = np.concatenate([sides, fan[:, ::-1], fan + (k - 1) * n])
    return Body(leaf.name, sections.reshape(-1, 3), triangles, sections)


def _block_bodies(moved: BlockShape, block: BlockShape, at_rest: Shape) -> Iterator[Body]:
    """The convex bodies that make up a link as pictures show it, moved as it is."""
    size = mechanism_size(at_rest)
    for part in convex_parts(block, clamp_pads(at_rest, block), size):
        around = thickened(part, PAD_HALF_THICKNESS * size)
        hull = ConvexHull(around)
        corners = around[hull.simplices]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        inward = (normals * hull.equations[:, :3]).sum(axis=1) < 0.0
        triangles = np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices)
        used, numbers = np.unique(triangles, return_inverse=True)
        points = around[used] @ moved.rotation.T + moved.position
        yield Body(f"{block.name} (its form is an idea)", points, numbers.reshape(-1, 3))


def stl_text(bodies: list[Body]) -> str:
    """Bodies as text in the format STL, mm, one `solid` each."""
    lines = []
    for body in bodies:
        # a name ends with its line
        name = " ".join(body.name.split())
        lines.append(f"solid {name}")
        corners = MM * body.points[body.triangles]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        for normal, triangle in zip(normals.tolist(), corners.tolist(), strict=True):
            lines.append("facet normal {:.6g} {:.6g} {:.6g}\nouter loop".format(*normal))
            lines += ["vertex {:.12g} {:.12g} {:.12g}".format(*corner) for corner in triangle]
            lines.append("endloop\nendfacet")
        lines.append(f"endsolid {name}")
    return "\n".join(lines) + "\n"


def mf_archive(bodies: list[Body]) -> bytes:
    """Bodies as an archive in the format 3MF (core specification 1.3), mm, one object each."""
    namespace = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
    model = [
        f'<?xml version="1.0" encoding="UTF-8"?>\n<model unit="millimeter" xmlns="{namespace}"><resources>'
    ]
    for number, body in enumerate(bodies, 1):
        model.append(f'<object id="{number}" type="model" name={quoteattr(body.name)}><mesh><vertices>')
        model += [
            '<vertex x="{:.12g}" y="{:.12g}" z="{:.12g}"/>'.format(*p) for p in (MM * body.points).tolist()
        ]
        model.append("</vertices><triangles>")
        model += ['<triangle v1="{}" v2="{}" v3="{}"/>'.format(*t) for t in body.triangles.tolist()]
        model.append("</triangles></mesh></object>")
    model.append("</resources><build>")
    model += [f'<item objectid="{number}"/>' for number in range(1, len(bodies) + 1)]
    model.append("</build></model>\n")
    package = "http://schemas.openxmlformats.org/package/2006"
    kinds = (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<Types xmlns="{package}/content-types"><Default Extension="rels" '
        'ContentType="application/vnd.openxmlformats-package.relationships+xml"/><Default Extension="model" '
        'ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>\n'
    )
    start = (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<Relationships xmlns="{package}/relationships"><Relationship Id="model" '
        f'Target="/3D/3dmodel.model" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>\n'
    )
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in (
            ("[Content_Types].xml", kinds), ("_rels/.rels", start), ("3D/3dmodel.model", "\n".join(model))
        ):  # fmt: skip
            # with the same date always, so that equal bodies make equal files
            archive.writestr(zipfile.ZipInfo(name), text, zipfile.ZIP_DEFLATED)
    return content.getvalue()


def start_gmsh(gmsh: Any) -> None:
    """Start gmsh, and have a broken pipe stay an exception of Python: gmsh would have it end the process without a word."""
    broken_pipe = getattr(signal, "SIGPIPE", None)
    get, put = ctypes.pythonapi.PyOS_getsig, ctypes.pythonapi.PyOS_setsig
    get.argtypes, put.argtypes = [ctypes.c_int], [ctypes.c_int, ctypes.c_void_p]
    get.restype = put.restype = ctypes.c_void_p
    # not `signal.signal`, which only the main thread may call
    before = None if broken_pipe is None else get(broken_pipe)
    gmsh.initialize([], False, False, False)
    if broken_pipe is not None:
        put(broken_pipe, before)


def _as_step(bodies: list[Body]) -> bytes:
    """Bodies in the format STEP, mm, fused; the list of their names is in the header."""
    gmsh = cad_package("gmsh", "STEP")
    if gmsh.isInitialized():
        raise SceneError("STEP: gmsh is in use in this process; call gmsh.finalize() first.")
    start_gmsh(gmsh)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        tags = [_step_solid(gmsh.model.occ, body) for body in bodies]
        if len(tags) > 1:
            gmsh.model.occ.fuse([(3, tags[0])], [(3, tag) for tag in tags[1:]])
        gmsh.model.occ.synchronize()
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "bodies.step"
            with _without_output():
                gmsh.write(str(file))
            text = file.read_text(encoding="ascii", errors="replace")
    except SceneError:
        raise
    except Exception as reason:
        # gmsh raises plain exceptions
        raise SceneError(
            f"STEP: the bodies cannot be fused ({' '.join(str(reason).split())[:120]}); write .stl, which keeps them apart."
        ) from None
    finally:
        gmsh.finalize()
    names = "; ".join(dict.fromkeys(body.name for body in bodies))
    quoted = names.encode("ascii", "replace").decode().replace("'", "''").replace("\\", "/")
    return text.replace("'Open CASCADE Model'", f"'ksd, mm: {quoted}'", 1).encode("ascii", "replace")


@contextmanager
def _without_output() -> Iterator[None]:
    """Send to the null device what libraries write to standard output past Python, as Open CASCADE does."""
    sys.stdout.flush()
    kept, null = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(null, 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(null)


def _step_solid(occ: Any, body: Body) -> int:
    """Add a body to a model of gmsh, in mm; returns its tag."""
    if body.sections is not None:
        straight = len(body.sections) == 2 or _is_straight(body.sections)
        loops = [_wire(occ, MM * ring) for ring in (body.sections[[0, -1]] if straight else body.sections)]
        made = occ.addThruSections(loops, makeSolid=True, makeRuled=straight)
        return int(next(tag for dim, tag in made if dim == 3))
    points = [occ.addPoint(*p) for p in (MM * body.points).tolist()]
    lines: dict[tuple[int, int], int] = {}
    faces = []
    for ring in _face_rings(body):
        edges = []
        for i, j in zip(ring, [*ring[1:], ring[0]], strict=True):
            if (j, i) in lines:
                edges.append(-lines[j, i])
            else:
                lines[i, j] = occ.addLine(points[i], points[j])
                edges.append(lines[i, j])
        faces.append(occ.addPlaneSurface([occ.addCurveLoop(edges)]))
    return int(occ.addVolume([occ.addSurfaceLoop(faces)]))


def _wire(occ: Any, ring: Array) -> int:
    """A closed wire through the corners of a section (k, 3) [mm]."""
    points = [occ.addPoint(*p) for p in ring.tolist()]
    lines = [occ.addLine(p, q) for p, q in zip(points, [*points[1:], points[0]], strict=True)]
    return int(occ.addCurveLoop(lines))


def _is_straight(sections: Array) -> bool:
    """Whether sections (stations, corners, 3) are those between the first and the last in equal steps along lines."""
    share = np.linspace(0.0, 1.0, len(sections))[:, None, None]
    between = (1.0 - share) * sections[0] + share * sections[-1]
    return bool(np.abs(between - sections).max() < 1e-9 * np.ptp(sections, axis=(0, 1)).max())


def _face_rings(body: Body) -> Iterator[list[int]]:
    """Corners of the flat faces of a convex body, counterclockwise seen from outside: triangles of one plane are one."""
    corners = body.points[body.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    size = float(np.ptp(body.points, axis=0).max())
    left = np.argsort(-areas).tolist()
    while left:
        k = left[0]
        normal = normals[k] / areas[k]
        off = np.abs((body.points - corners[k, 0]) @ normal)
        on = off < 1e3 * SAME_PLANE * size
        same = [t for t in left if on[body.triangles[t]].all()]
        edges = {(int(t[i]), int(t[i - 2])) for t in body.triangles[same] for i in range(3)}
        after = {i: j for i, j in edges if (j, i) not in edges}
        ring = [next(iter(after))]
        while after[ring[-1]] != ring[0]:
            ring.append(after[ring[-1]])
        yield ring
        left = [t for t in left if t not in set(same)]
