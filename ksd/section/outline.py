"""Section numbers of any polygon: Saint-Venant torsion, flexure and warping by finite elements.

Sources: W. Pilkey, Analysis and Design of Elastic Beams (2002), chapters 5 and 6. In principal axes (y, z)
through the centroid, with the warping function omega and the flexure functions Psi_y, Psi_z:

    lap omega = 0, d omega/dn = z n_y - y n_z,   J = int y^2 + z^2 - |grad omega|^2
    lap Psi_y = -2 y, d Psi_y/dn = d . n, d = nu ((y^2 - z^2)/2, y z)
    stress of a unit shear force along y: tau = (grad Psi_y - d) / (2 (1 + nu) int y^2)
    energy: 1/(ky A) = int |tau|^2, the force acting through the shear centre
    shear centre (-int omega z / int z^2, int omega y / int y^2), Iw = int omega_s^2 about it

Elements of degree 4: on the same mesh as quadratic ones they take as long and are 500 times more accurate
(square, 4 elements across: torsion constant off by 1e-5 instead of 6e-3).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ksd.checks import MAX_MAGNITUDE, between, clear_argument_errors, label, positive, show
from ksd.errors import SceneError
from ksd.section.outline_mesh import edges_of, points_inside, triangulate
from ksd.section.section import Section


@clear_argument_errors
def polygon(
    points: Sequence[Any],
    holes: Sequence[Sequence[Any]] = (),
    *,
    mesh_size: float | None = None,
    nu: float = 0.0,
    name: str = "polygon",
) -> Section:
    """A section of any polygonal outline, with holes, by finite elements.

    points: corners (n, 2) of the outline as (y, z) [m], in order, either way round; holes: the same for each
    hole. Results are about the centroid and the principal axes; y is the principal axis within 45 degrees of
    the y axis drawn in, and `tilt` the angle between the two. mesh_size [m]: wanted element size, a quarter
    of the local thickness when None. nu: Poisson's ratio of the energy shear coefficients; at nu = 0 a strip
    loaded along its thin side has 5/6, at nu = 0.3 a 10:1 strip 0.18, so the default stays comparable with
    `rectangle`. Raises SceneError for fewer than three corners, numbers that are not finite, crossing edges,
    or a hole that leaves the outline.

    >>> corner = ksd.polygon([(0, 0), (1 * mm, 0), (1 * mm, 8 * mm), (0, 8 * mm)])
    >>> print(f"A = {corner.A / mm**2:.3f} mm^2, Iy = {corner.Iy / mm**4:.2f} mm^4")
    A = 8.000 mm^2, Iy = 42.67 mm^4
    """
    nu = between(nu, "nu (Poisson's ratio)", -1.0, 0.500001, owner=name)
    if mesh_size is not None:
        mesh_size = positive(mesh_size, "mesh_size", owner=name, unit="m")
    rings = _rings(points, holes, name)
    # unit size about the origin, so that tolerances and conditioning do not depend on the unit of length or the position
    scale, origin = float(np.ptp(rings[0], axis=0).max()), rings[0].mean(axis=0)
    rings = [(r - origin) / scale for r in rings]
    corners, triangles = triangulate(rings, None if mesh_size is None else mesh_size / scale)
    centre, tilt = _centroid_and_tilt(corners, triangles)
    c, s = np.cos(tilt), np.sin(tilt)
    rotation = np.array([[c, -s], [s, c]])
    found = _finite_elements((corners - centre) @ rotation, triangles, nu)
    principal_rings = [(r - centre) @ rotation * scale for r in rings]
    thickness, width = np.ptp(principal_rings[0], axis=0)
    units = {"A": 2, "J": 4, "Iy": 4, "Iz": 4, "ky": 0, "kz": 0, "Iw": 6}
    numbers = {key: float(found[key]) * scale**power for key, power in units.items()}
    return Section(
        **numbers,
        width=float(width),
        thickness=float(thickness),
        outline=tuple(tuple((float(y), float(z)) for y, z in ring) for ring in principal_rings),
        name=name,
        shear_centre=(float(found["ys"]) * scale, float(found["zs"]) * scale),
        tilt=float(tilt),
    )


def _centroid_and_tilt(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, float]:
    """Centroid (2,) and angle [rad] of the principal axis nearest to y; zero when all axes are principal."""
    corner = points[triangles]
    a, b = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    area = 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    centre = area @ corner.mean(axis=1) / area.sum()
    # the midpoints of the sides integrate quadratic functions exactly
    middle = 0.5 * (corner + np.roll(corner, 1, axis=1)) - centre
    moment = np.einsum("t,tki,tkj->ij", area / 3, middle, middle)
    difference, product = moment[0, 0] - moment[1, 1], moment[0, 1]
    if np.hypot(difference, 2 * product) < 1e-9 * np.trace(moment):
        return centre, 0.0
    # of the two principal axes, the one within 45 degrees of y
    tilt = 0.5 * np.arctan2(2 * product, difference)
    if tilt > 0.25 * np.pi + 1e-9:
        tilt -= 0.5 * np.pi
    elif tilt <= -0.25 * np.pi + 1e-9:
        tilt += 0.5 * np.pi
    return centre, 0.0 if abs(tilt) < 1e-12 else float(tilt)


def _finite_elements(points: np.ndarray, triangles: np.ndarray, nu: float) -> dict[str, float]:
    """All numbers of a section meshed in its principal axes, by the formulas at the top of this file."""
    from scipy.sparse.linalg import splu
    from skfem import Basis, BilinearForm, ElementTriP4, LinearForm, MeshTri
    from skfem.helpers import dot, grad

    basis = Basis(MeshTri(points.T.copy(), triangles.T.copy()), ElementTriP4(), intorder=8)
    y, z = np.asarray(basis.global_coordinates())
    dx = basis.dx

    def d_field(along: int) -> np.ndarray:
        half, cross = 0.5 * nu * (y**2 - z**2), nu * y * z
        return np.array([half, cross]) if along == 0 else np.array([cross, -half])

    def load(source: np.ndarray, flux: np.ndarray) -> np.ndarray:
        form = LinearForm(lambda v, w: w["q"] * v + dot(w["f"], grad(v)))
        return form.assemble(basis, q=source, f=flux)

    loads = [load(0 * y, np.array([z, -y]))]
    loads += [load(2 * (1 + nu) * x, d_field(k)) for k, x in enumerate((y, z))]
    stiffness = BilinearForm(lambda u, v, _: dot(grad(u), grad(v))).assemble(basis).tocsc()
    # the functions are determined up to a constant: the last unknown is zero
    factor = splu(stiffness[:-1, :-1])
    fields = [basis.interpolate(np.append(factor.solve(f[:-1]), 0.0)) for f in loads]

    A, yy, zz = (float((q * dx).sum()) for q in (1.0 + 0 * y, y * y, z * z))
    omega, slope = np.asarray(fields[0]), np.asarray(fields[0].grad)
    omega = omega - (omega * dx).sum() / A
    torsion = slope + np.array([-z, y])
    J = float((torsion**2 * dx).sum())
    ys, zs = float(-(omega * z * dx).sum() / zz), float((omega * y * dx).sum() / yy)
    found = {"A": A, "J": J, "Iy": zz, "Iz": yy, "ys": ys, "zs": zs}
    found["Iw"] = float(((omega - zs * y + ys * z) ** 2 * dx).sum())
    for key, field, k, second in (("ky", fields[1], 0, yy), ("kz", fields[2], 1, zz)):
        tau = (np.asarray(field.grad) - d_field(k)) / (2 * (1 + nu) * second)
        # a force through the shear centre causes no torsion: subtract its part (zero at nu = 0)
        tau = tau - torsion * ((torsion * tau * dx).sum() / J)
        found[key] = float(1.0 / (A * (tau**2 * dx).sum()))
    return found


def _rings(points: Sequence[Any], holes: Sequence[Any], name: str) -> list[np.ndarray]:
    """Checked rings (n, 2) [m]: the outline anticlockwise, holes clockwise. Raises SceneError."""
    if not isinstance(holes, Sequence | np.ndarray):
        raise SceneError(
            f"{name}: holes = {show(holes)} must be a list of holes, each of points (y, z) in m."
        )
    rings = [_ring(points, "points", name)]
    rings += [_ring(hole, f"holes[{i}]", name) for i, hole in enumerate(holes)]
    for i, ring in enumerate(rings):
        y, z = ring.T
        area = 0.5 * float(y @ np.roll(z, -1) - z @ np.roll(y, -1))
        if abs(area) < 1e-9 * float(np.ptp(ring, axis=0).max()) ** 2:
            raise SceneError(f"{name}: {'holes' if i else 'points'} enclose no area.")
        if (area > 0) == (i > 0):
            rings[i] = ring[::-1].copy()
    _refuse_crossings(rings, name)
    outline = edges_of(rings[:1])
    for i, hole in enumerate(rings[1:]):
        if not points_inside(hole, outline).all():
            raise SceneError(f"{name}: holes[{i}] must lie inside the outline.")
        for j, other in enumerate(rings[1:]):
            if i != j and points_inside(hole[:1], edges_of([other])).any():
                raise SceneError(f"{name}: holes[{i}] lies inside holes[{j}]; draw only the larger one.")
    return rings


def _ring(points: Sequence[Any], what: str, name: str) -> np.ndarray:
    """One checked ring (n, 2) [m] without repeated corners. Raises SceneError."""
    try:
        ring = np.array([[float(y), float(z)] for y, z in points])
    except (TypeError, ValueError, OverflowError):
        raise SceneError(f"{label(what, name)} = {show(points)} must be points (y, z) in m.") from None
    if len(ring) and not np.isfinite(ring).all():
        raise SceneError(
            f"{label(what, name)} has a coordinate that is not finite; give finite numbers in m."
        )
    if len(ring) and np.abs(ring).max() > MAX_MAGNITUDE:
        raise SceneError(
            f"{label(what, name)} has a coordinate that is too large; at most {MAX_MAGNITUDE:g} can be used."
        )
    if len(ring):
        ring = ring[np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1) > 1e-12 * np.abs(ring).max()]
    if len(ring) < 3:
        raise SceneError(f"{label(what, name)} has {len(ring)} different corners; at least three are needed.")
    return ring


def _refuse_crossings(rings: list[np.ndarray], name: str) -> None:
    """Raises SceneError where an edge crosses or touches another one, except neighbours at their common corner."""
    edges = edges_of(rings)
    p, q = edges.tail, edges.head

    def side(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
        """Sign of the area of the triangles a_i b_i c_j."""
        u, v = (b - a)[:, None], c[None] - a[:, None]
        area = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
        size = np.linalg.norm(u, axis=2) * np.linalg.norm(v, axis=2)
        return np.where(np.abs(area) > 1e-12 * size, np.sign(area), 0)

    first, second = side(p, q, p), side(p, q, q)
    crossing = (first * second < 0) & ((first * second < 0).T)
    # a corner on an edge it does not belong to
    along = (q - p)[:, None]
    s = ((p[None] - p[:, None]) * along).sum(axis=2) / (along**2).sum(axis=2)
    touching = (first == 0) & (s > 1e-12) & (s < 1 - 1e-12)
    # coincident corners: the edges that start there meet
    touching |= np.triu(np.linalg.norm(p[None] - p[:, None], axis=2) < 1e-12 * np.abs(p).max(), 1)
    if crossing.any() or touching.any():
        i, j = (int(k[0]) for k in np.nonzero(crossing | touching))
        raise SceneError(
            f"{name}: the edge from {tuple(p[i].tolist())} to {tuple(q[i].tolist())} meets the edge from "
            f"{tuple(p[j].tolist())} to {tuple(q[j].tolist())}; outlines must not cross or touch."
        )
