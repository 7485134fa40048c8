"""One leaf spring in the plane: from its deformed line to its undeformed one, without iteration over forces.

Given is the centreline under load: its angle phi and position r along its length. With force n and moment about the origin
that the leaf transmits from its end to its start, every section turns against the line by its shear, is stretched, and bends
by M, so that for the undeformed line
    theta = phi - atan((V/GA)/(1 + N/EA)),    dsigma/ds = |1 + N/EA, V/GA|,    dtheta0/ds = dtheta/ds - M/EI
(s along the undeformed line, sigma along the loaded one; Lan, 2005, chapter 5, without stretch). Weight adds to the
transmitted force. Everything is analytic in the wrench: derivatives are those of complex steps.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from ksd.answers.centrelines import curvature, member_arrays, member_ends
from ksd.errors import SceneError
from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.model.leaves import line_mass, rod_compliances
from ksd.model.mesh import Mesh
from ksd.scene.hinges import PLANES
from ksd.scene.leaf import Leaf
from ksd.scene.plane_curves import Legendre

Array = NDArray[np.float64]
PANELS, POINTS_PER_PANEL = 8, 10
"""Panels along a leaf, more where its profile has breaks, and Gauss points in each."""
MAX_ITERATIONS = 60
"""Largest number of iterations for stretch and shear, which both depend on the section angle that they change."""
CHORD_TOLERANCE = 1e-3
"""Relative difference allowed between the distance of the ends of a leaf and the chord of its curve."""
COMPLEX_STEP = 1e-30
"""Complex step of the derivatives."""


class _PanelRule(NamedTuple):
    """Gauss points of a panel [-1, 1] and matrices that act on values there.

    points, weights (p,); coefficients (p, p): values to Legendre coefficients; integral (p, p): values to integrals from -1;
    slope (p, p): values to derivatives.
    """

    points: Any
    weights: Any
    coefficients: Any
    integral: Any
    slope: Any


@lru_cache(maxsize=1)
def _panel_rule() -> _PanelRule:
    x, w = legendre.leggauss(POINTS_PER_PANEL)
    coefficients = np.linalg.inv(legendre.legvander(x, POINTS_PER_PANEL - 1))
    ones = np.eye(POINTS_PER_PANEL)
    integral = legendre.legvander(x, POINTS_PER_PANEL) @ legendre.legint(ones, lbnd=-1) @ coefficients
    slope = legendre.legvander(x, POINTS_PER_PANEL - 2) @ legendre.legder(ones) @ coefficients
    return _PanelRule(x, w, coefficients, integral, slope)


class Stations:
    """Points u (panels, points) along a line from 0 to 1, and operations on functions (..., panels, points) given there."""

    def __init__(self, breaks: tuple[float, ...] = ()) -> None:
        self.edges = np.unique([*np.linspace(0.0, 1.0, PANELS + 1), *breaks])
        self.half = 0.5 * np.diff(self.edges)[:, None]
        self.u = self.edges[:-1, None] + self.half * (1.0 + _panel_rule().points)

    def total(self, f: Any) -> Any:
        """Integral (...) from 0 to 1."""
        return ((f @ _panel_rule().weights) * self.half[:, 0]).sum(axis=-1)

    def integral(self, f: Any) -> Any:
        """Integral from 0 to every point, in the shape of f."""
        rule = _panel_rule()
        panels = (f @ rule.weights) * self.half[:, 0]
        before = np.cumsum(panels, axis=-1) - panels
        return before[..., None] + (f @ rule.integral.T) * self.half

    def slope(self, f: Any) -> Any:
        """Derivative at every point, in the shape of f."""
        return (f @ _panel_rule().slope.T) / self.half

    def evaluate(self, f: Array, u: Any) -> Any:
        """Values (..., *u.shape) of functions f (..., panels, points) at u, which may be complex."""
        panel = np.clip(np.searchsorted(self.edges, np.real(u), side="right") - 1, 0, len(self.half) - 1)
        t = (u - self.edges[panel]) / self.half[panel, 0] - 1.0
        coefficients = (f @ _panel_rule().coefficients.T)[..., panel, :]
        return (coefficients * legendre.legvander(t, POINTS_PER_PANEL - 1)).sum(axis=-1)

    def curve(self, length: float, curvature: Array) -> Legendre:
        """The curve of this length [m] with curvature about e3 [1/m] (panels, points)."""
        pieces = (length * curvature @ _panel_rule().coefficients.T).tolist()
        return Legendre(tuple(map(tuple, pieces)), length, tuple(self.edges[1:-1].tolist()))


class PlaneAxes(NamedTuple):
    """The plane of a mechanism: index of its normal, and of its two axes, first x second = normal."""

    normal: int
    in_plane: tuple[int, int]

    def project(self, v: Any) -> Array:
        """The two components in the plane of vectors (..., 3)."""
        return np.asarray(np.asarray(v, float)[..., list(self.in_plane)])


def plane_axes(plane: str) -> PlaneAxes:
    """Axes of "xy", "yz" or "xz"."""
    k = PLANES[plane]
    return PlaneAxes(k, ((k + 1) % 3, (k + 2) % 3))


def rotation_matrix(angle: Any) -> Any:
    """Rotation matrix (2, 2) of an angle [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


class UndeformedLeaf(NamedTuple):
    """A leaf without its loads, for k wrenches, with its first section oriented as under load.

    displacement (k, 2) [m] from start to end; turn (k,) [rad] of the end against its angle under load; start_wrench (k, 3)
    [N, Nm] that the leaf transmits at its start; curvature (k, panels, points) [1/m]; length (k,) [m].
    """

    displacement: Any
    turn: Any
    start_wrench: Any
    curvature: Any
    length: Any


class LeafDerivatives(NamedTuple):
    """Derivatives of displacement, turn and start wrench of an `UndeformedLeaf`: (2, 3), (3,) and (3, 3) by the wrench at
    the end, (2,), () and (3,) by the load fraction."""

    displacement: Any
    turn: Any
    start_wrench: Any


class LeafCompliances:
    """Compliances bending = 1/EI, stretch = 1/EA, shear = 1/GA and mass per length [kg/m] of a leaf in its plane, at its
    stations (panels, points)."""

    def __init__(self, leaf: Leaf, mesh: Mesh) -> None:
        profile = leaf.profile
        self.stations = Stations(
            tuple(b for part in (profile, leaf.curve) if part is not None for b in part.breaks)
        )
        shape = self.stations.u.shape
        places = self.stations.u.ravel()
        bending, soft = (
            np.broadcast_to(part, (3, len(places))) for part in rod_compliances(leaf, mesh, places)
        )
        self.bending, self.stretch, self.shear = (
            part.reshape(shape) for part in (bending[2], soft[0], soft[1])
        )
        self.mass = line_mass(leaf, places).reshape(shape)


class DeformedLeaf:
    """A leaf spring, or its piece between points, as drawn under load, from link `a` to link `b`.

    r (2, panels, points) [m]: positions of its line from `origin` (2,) in the plane; phi [rad] and kappa [1/m] (panels,
    points): angle and curvature of the line; start, end (2,) [m]: its ends. Raises SceneError for a leaf that leaves the
    plane and for a curve that does not fit between its ends.
    """

    def __init__(
        self, name: str, links: tuple[str, str], leaf: Leaf, axes: PlaneAxes, origin: Array, mesh: Mesh
    ) -> None:
        self.name, (self.a, self.b), self.leaf = name, links, leaf
        normal = float(np.asarray(leaf.width_axis)[axes.normal])
        if abs(normal) < 1.0 - 1e-9:
            raise SceneError(
                f"rest_shape: leaf '{name}' has no width normal to the plane of the mechanism; it leaves the plane."
            )
        # sign of rotations about the width axis in the plane
        self.side = np.sign(normal)
        own = LeafCompliances(leaf, mesh)
        self.stations, self.mass = own.stations, own.mass
        self.bending, self.stretch, self.shear = own.bending, own.stretch, own.shear
        self._draw(leaf, axes, origin)

    def _draw(self, leaf: Leaf, axes: PlaneAxes, origin: Array) -> None:
        """Set length, kappa, phi, r, start and end from the drawing of `leaf`. Raises SceneError, see the class."""
        s, chord = self.stations, axes.project(leaf.end) - axes.project(leaf.start)
        distance = float(np.hypot(*chord))
        self.length = leaf.length
        kappa = np.zeros(s.u.shape)
        if leaf.curve is not None:
            bends = leaf.curve.curvatures(s.u.ravel()).reshape(*s.u.shape, 3)
            if np.abs(bends[..., :2]).max() * self.length > 1e-9:
                raise SceneError(
                    f"rest_shape: the wanted curve of leaf '{self.name}' leaves the plane of the mechanism."
                )
            kappa = self.side * bends[..., 2]
        phi = self.length * s.integral(kappa)
        end = self.length * np.array([s.total(np.cos(phi)), s.total(np.sin(phi))])
        span = float(np.hypot(*end))
        if abs(span - distance) > CHORD_TOLERANCE * distance:
            raise SceneError(
                f"rest_shape: the wanted curve of leaf '{self.name}' turns to and fro too often for {s.u.size} stations; "
                "put points on it, between which each part has its own."
            )
        start_angle = np.arctan2(chord[1], chord[0]) - np.arctan2(end[1], end[0])
        self.kappa, self.phi = kappa, phi + start_angle
        self.start = axes.project(leaf.start) - origin
        line = self.length * np.array([s.integral(np.cos(self.phi)), s.integral(np.sin(self.phi))])
        self.r = self.start[:, None, None] + line
        self.end = self.start + rotation_matrix(start_angle) @ end

    def undeformed(self, wrench: Any, gravity: Any) -> UndeformedLeaf:
        """The leaf without its loads, from wrenches (k, 3) that it transmits at its end under load.

        wrench: force [N], and moment [Nm] about the origin. gravity (2,) [m/s^2]: acts on its mass. Raises SceneError
        beyond small strains.
        """
        s, k = self.stations, len(wrench)
        h, v, m = (wrench[:, c, None, None] for c in range(3))
        sigma = np.broadcast_to(s.u, (k, *s.u.shape))
        shear, length = np.zeros(1), np.full(k, self.length)
        line = np.array([self.phi, *self.r])
        has_weight = bool(np.any(gravity)) and bool(self.mass.any())
        for _ in range(MAX_ITERATIONS):
            phi, x, y = s.evaluate(line, sigma)
            fx, fy, mo = h, v, m
            if has_weight:
                # mass and moment of weight beyond each point
                beyond = [
                    length[:, None, None] * (s.total(f)[:, None, None] - s.integral(f))
                    for f in (self.mass + 0.0 * phi, self.mass * (x * gravity[1] - y * gravity[0]))
                ]
                fx, fy, mo = h + gravity[0] * beyond[0], v + gravity[1] * beyond[0], m + beyond[1]
            theta = phi - shear
            along = 1.0 + self.stretch * (fx * np.cos(theta) + fy * np.sin(theta))
            across = self.shear * (fy * np.cos(theta) - fx * np.sin(theta))
            rate = np.sqrt(along**2 + across**2)
            total, before = s.total(rate), (sigma, shear)
            with np.errstate(all="ignore"):
                shear = np.arctan(across / along)
            sigma, length = s.integral(rate) / total[:, None, None], self.length / total
            if max(np.abs(sigma - before[0]).max(), np.abs(shear - before[1]).max()) < 1e-15:
                break
        else:
            force, limit = np.abs(wrench[:, :2]).max(), 0.1 / max(self.stretch.max(), self.shear.max())
            raise SceneError(
                f"rest_shape: {force:.4g} N stretch or shear leaf '{self.name}' beyond small strains; up to {limit:.4g} N, "
                "a tenth of its EA or GA, would do."
            )
        bend = self.bending * (mo - x * fy + y * fx)
        bend_angle = length[:, None, None] * s.integral(bend)
        theta0 = phi - shear - bend_angle
        displacement = length[:, None] * np.stack([s.total(np.cos(theta0)), s.total(np.sin(theta0))], axis=1)
        section_curvature = rate * s.evaluate(self.kappa, sigma) - s.slope(shear) / length[:, None, None]
        start = wrench
        if has_weight:
            start = wrench + length[:, None] * np.stack(
                [s.total(self.mass * g + 0.0 * phi) for g in gravity]
                + [s.total(self.mass * (x * gravity[1] - y * gravity[0]))], axis=1,
            )  # fmt: skip
        return UndeformedLeaf(displacement, -length * s.total(bend), start, section_curvature - bend, length)

    def with_derivatives(self, wrench: Array, gravity: Any) -> tuple[UndeformedLeaf, LeafDerivatives]:
        """`undeformed` for one wrench (3,), and its derivatives by that wrench."""
        leaf = self.undeformed(np.vstack([wrench, wrench + 1j * COMPLEX_STEP * np.eye(3)]), gravity)
        derivatives = (np.imag(part[1:]).T / COMPLEX_STEP for part in leaf[:3])
        return UndeformedLeaf(*(np.real(part[0]) for part in leaf)), LeafDerivatives(*derivatives)

    def derivatives_by_fraction(self, wrench: Array, gravity: Array, fraction: float) -> LeafDerivatives:
        """Derivatives of `undeformed` by the load fraction of gravity (2,), at a constant wrench (3,)."""
        if not gravity.any():
            return LeafDerivatives(0.0, 0.0, 0.0)
        leaf = self.undeformed(wrench[None], (fraction + 1j * COMPLEX_STEP) * gravity)
        return LeafDerivatives(*(np.imag(part[0]) / COMPLEX_STEP for part in leaf[:3]))

    def undeformed_curve(self, leaf: UndeformedLeaf) -> Legendre:
        """Curve of the undeformed leaf for its first wrench."""
        return self.stations.curve(float(leaf.length[0]), self.side * leaf.curvature[0])


def deformed_curve(
    leaf: Leaf, mesh: Mesh, axes: PlaneAxes, state: tuple[Model, State, int], gravity: Array
) -> Legendre:
    """Curve of the line of a leaf that is member i of a solved state (model, state, i); gravity (2,) [m/s^2]."""
    model, motion, i = state
    own, ends = LeafCompliances(leaf, mesh), member_ends(model, motion, i)
    value, number, inner = member_arrays(model, motion, i)
    s, length = own.stations, leaf.length
    side = np.sign(float(np.asarray(leaf.width_axis)[axes.normal]))
    kappa = side * curvature(value, number, inner, s.u.ravel())[:, 2].reshape(s.u.shape)
    first = axes.project(ends.frame[:, 0])
    theta = np.arctan2(first[1], first[0]) + length * s.integral(kappa)
    modes = int(number[:3].sum())
    weight = length * (s.total(own.mass) - s.integral(own.mass))
    force = axes.project(ends.frame @ inner[modes : modes + 3])
    fx, fy = (f + g * weight for f, g in zip(force, gravity, strict=True))
    along = 1.0 + own.stretch * (fx * np.cos(theta) + fy * np.sin(theta))
    across = own.shear * (fy * np.cos(theta) - fx * np.sin(theta))
    rate, shear = np.hypot(along, across), np.arctan(across / along)
    line_curvature = (kappa + s.slope(shear) / length) / rate
    total = float(s.total(rate))
    sigma, u = s.integral(rate) / total, s.u.copy()
    for _ in range(8):
        # Newton steps to the points whose position along the deformed line is that of the stations
        u = np.clip(u - (s.evaluate(sigma, u) - s.u) * total / s.evaluate(rate, u), 0.0, 1.0)
    return s.curve(length * total, side * s.evaluate(line_curvature, u))
