"""One leaf spring from its deformed line to its undeformed one, in the plane, without iteration over forces.

Drawn is the centreline under load: its angle phi and place r over its length. With force n and moment about the origin that
the leaf hands on from its end to its start, every section turns against the line by its shear, is stretched, and bends by M,
so that at rest
    theta = phi - atan((V/GA)/(1 + N/EA)),    dsigma/ds = |1 + N/EA, V/GA|,    dtheta0/ds = dtheta/ds - M/EI
(s at rest, sigma along the drawn line; Lan, 2005, chapter 5, without stretch). Weight is handed on alike. All of it is
analytic in the wrench: derivatives are those of complex steps.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from ksd.errors import SceneError
from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.model.leaves import line_mass, rigidities
from ksd.model.mesh import Mesh
from ksd.properties.shape import curvature, member_arrays, member_ends
from ksd.scene.hinges import PLANES
from ksd.scene.leaf import Leaf
from ksd.scene.plane_curves import Legendre

Array = NDArray[np.float64]
PANELS, POINTS = 8, 10
"""Panels along a leaf, more where its profile has breaks, and points in each."""
ROUNDS = 60
"""Most rounds of stretch and shear, which both depend on the angle they change."""
SLACK = 1e-3
"""By how much, over it, a drawn chord may differ from that of its curve."""
STEP = 1e-30
"""Complex step of derivatives by a wrench."""


@lru_cache(maxsize=1)
def _rule() -> tuple[Any, Any, Any, Any, Any]:
    """Of the points in a panel [-1, 1]: themselves, weights, and from values there to coefficients, integrals from -1 and
    slopes."""
    x, w = legendre.leggauss(POINTS)
    coefficients = np.linalg.inv(legendre.legvander(x, POINTS - 1))
    ones = np.eye(POINTS)
    integral = legendre.legvander(x, POINTS) @ legendre.legint(ones, lbnd=-1) @ coefficients
    slope = legendre.legvander(x, POINTS - 2) @ legendre.legder(ones) @ coefficients
    return x, w, coefficients, integral, slope


class Stations:
    """Points u (panels, points) along a line from 0 to 1, and functions (..., panels, points) known there."""

    def __init__(self, breaks: tuple[float, ...] = ()) -> None:
        self.edges = np.unique([*np.linspace(0.0, 1.0, PANELS + 1), *breaks])
        self.half = 0.5 * np.diff(self.edges)[:, None]
        self.u = self.edges[:-1, None] + self.half * (1.0 + _rule()[0])

    def total(self, f: Any) -> Any:
        """Integral (...) from 0 to 1."""
        return ((f @ _rule()[1]) * self.half[:, 0]).sum(axis=-1)

    def integral(self, f: Any) -> Any:
        """Integral from 0 to every point, as f."""
        _, w, _, integral, _ = _rule()
        panels = (f @ w) * self.half[:, 0]
        before = np.cumsum(panels, axis=-1) - panels
        return before[..., None] + (f @ integral.T) * self.half

    def slope(self, f: Any) -> Any:
        """Derivative at every point, as f."""
        return (f @ _rule()[4].T) / self.half

    def at(self, f: Array, u: Any) -> Any:
        """Values at u, of any shape, complex too, of functions (..., panels, points); those of the functions first."""
        home = np.clip(np.searchsorted(self.edges, np.real(u), side="right") - 1, 0, len(self.half) - 1)
        t = (u - self.edges[home]) / self.half[home, 0] - 1.0
        return ((f @ _rule()[2].T)[..., home, :] * legendre.legvander(t, POINTS - 1)).sum(axis=-1)

    def curve(self, length: float, curvature: Array) -> Legendre:
        """The curve of this length with curvature about e3 [1/m] (panels, points)."""
        pieces = (length * curvature @ _rule()[2].T).tolist()
        return Legendre(tuple(map(tuple, pieces)), length, tuple(self.edges[1:-1].tolist()))


class Axes(NamedTuple):
    """The plane: number of its normal, and its two axes, first x second = normal."""

    normal: int
    own: tuple[int, int]

    def of(self, v: Any) -> Array:
        """The two components in the plane of vectors (..., 3)."""
        return np.asarray(np.asarray(v, float)[..., list(self.own)])


def axes_of(plane: str) -> Axes:
    """Axes of "xy", "yz" or "xz"."""
    k = PLANES[plane]
    return Axes(k, ((k + 1) % 3, (k + 2) % 3))


def rotated(angle: Any) -> Any:
    """Rotation matrix (2, 2)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


class Rested(NamedTuple):
    """What wrenches (k, 3) make of a leaf: at rest, its first section as it stands under load, displacement (k, 2) [m] from
    start to end and turn (k,) of the end against that under load; wrench (k, 3) at its start; curvature (k, panels, points)
    [1/m] and length (k,) [m] at rest; angle (k,) of its first section."""

    way: Any
    turn: Any
    start: Any
    curvature: Any
    length: Any
    angle: Any


Slopes = tuple[Rested, tuple[Array, Array, Array]]
"""At rest, and how way (2, 3), turn (3,) and start (3, 3) change with the wrench."""


class Sections:
    """Compliances 1/EI, 1/EA, 1/GA and mass per length [kg/m] of a leaf at its stations, in its plane."""

    def __init__(self, leaf: Leaf, mesh: Mesh) -> None:
        profile = leaf.profile
        self.stations = Stations(() if profile is None else profile.breaks)
        shape = self.stations.u.shape
        places = self.stations.u.ravel().tolist()
        sections = [leaf.section] if profile is None else [profile.section(s) for s in places]
        found = [rigidities(section, leaf, mesh) for section in sections]
        stiff, soft = (
            np.broadcast_to(np.array(part), (len(places), 3)).reshape(*shape, 3)
            for part in zip(*found, strict=True)
        )
        self.bending, self.stretch, self.shear = 1.0 / stiff[..., 2], soft[..., 0], soft[..., 1]
        self.mass = line_mass(leaf, np.array(places)).reshape(shape)


class DrawnLeaf:
    """A leaf spring, or its piece between points, as drawn under load: from link `a` to link `b`, places r (2, panels,
    points) [m] and angles phi of its line, seen from `origin` (2,) in the plane."""

    def __init__(
        self, name: str, links: tuple[str, str], leaf: Leaf, axes: Axes, origin: Array, mesh: Mesh
    ) -> None:
        self.name, (self.a, self.b), self.leaf = name, links, leaf
        across = float(np.asarray(leaf.width_axis)[axes.normal])
        if abs(across) < 1.0 - 1e-9:
            raise SceneError(
                f"rest_shape: leaf '{name}' has no width across the plane of the mechanism; it leaves the plane."
            )
        self.side = np.sign(across)
        own = Sections(leaf, mesh)
        self.stations, self.mass = own.stations, own.mass
        self.bending, self.stretch, self.shear = own.bending, own.stretch, own.shear
        self._draw(leaf, axes, origin)

    def _draw(self, leaf: Leaf, axes: Axes, origin: Array) -> None:
        s, chord = self.stations, axes.of(leaf.end) - axes.of(leaf.start)
        apart = float(np.hypot(*chord))
        self.long = leaf.length
        kappa = np.zeros(s.u.shape)
        if leaf.curve is not None:
            bends = leaf.curve.curvatures(s.u.ravel()).reshape(*s.u.shape, 3)
            if np.abs(bends[..., :2]).max() * self.long > 1e-9:
                raise SceneError(
                    f"rest_shape: the wanted curve of leaf '{self.name}' leaves the plane of the mechanism."
                )
            kappa = self.side * bends[..., 2]
        if apart > (1.0 + SLACK) * self.long:
            raise SceneError(
                f"rest_shape: the ends of leaf '{self.name}' are wanted {1e3 * apart:.4g} mm apart, but its curve is "
                f"{1e3 * self.long:.4g} mm long; bring them within that, or make the curve longer."
            )
        phi = self.long * s.integral(kappa)
        end = self.long * np.array([s.total(np.cos(phi)), s.total(np.sin(phi))])
        span = float(np.hypot(*end))
        if abs(span - apart) > SLACK * apart:
            raise SceneError(
                f"rest_shape: the wanted curve of leaf '{self.name}' spans {1e3 * span:.6g} mm, but its ends are drawn "
                f"{1e3 * apart:.6g} mm apart; give it an end at {1e3 * span:.6g} mm."
            )
        lean = np.arctan2(chord[1], chord[0]) - np.arctan2(end[1], end[0])
        self.kappa, self.phi = kappa, phi + lean
        self.first = axes.of(leaf.start) - origin
        line = self.long * np.array([s.integral(np.cos(self.phi)), s.integral(np.sin(self.phi))])
        self.r = self.first[:, None, None] + line
        self.last = self.first + rotated(lean) @ end

    def rest(self, wrench: Any, gravity: Any) -> Rested:
        """At rest under wrenches (k, 3): force [N], and moment [Nm] about the origin, that it hands on from its end; gravity
        (2,) [m/s^2] on its mass."""
        s, k = self.stations, len(wrench)
        h, v, m = (wrench[:, c, None, None] for c in range(3))
        sigma = np.broadcast_to(s.u, (k, *s.u.shape))
        shear, length = np.zeros(1), np.full(k, self.long)
        line = np.array([self.phi, *self.r])
        weighed = bool(np.any(gravity)) and bool(self.mass.any())
        for _ in range(ROUNDS):
            phi, x, y = s.at(line, sigma)
            fx, fy, mo = h, v, m
            if weighed:
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
            sigma, length = s.integral(rate) / total[:, None, None], self.long / total
            if max(np.abs(sigma - before[0]).max(), np.abs(shear - before[1]).max()) < 1e-15:
                break
        else:
            force, limit = np.abs(wrench[:, :2]).max(), 0.1 / max(self.stretch.max(), self.shear.max())
            raise SceneError(
                f"rest_shape: {force:.4g} N stretch or shear leaf '{self.name}' beyond small strains; up to {limit:.4g} N, "
                "a tenth of its EA or GA, would do."
            )
        bend = self.bending * (mo - x * fy + y * fx)
        lost = length[:, None, None] * s.integral(bend)
        theta0 = phi - shear - lost
        way = length[:, None] * np.stack([s.total(np.cos(theta0)), s.total(np.sin(theta0))], axis=1)
        turned = rate * s.at(self.kappa, sigma) - s.slope(shear) / length[:, None, None]
        start = wrench
        if weighed:
            start = wrench + length[:, None] * np.stack(
                [s.total(self.mass * g + 0.0 * phi) for g in gravity]
                + [s.total(self.mass * (x * gravity[1] - y * gravity[0]))], axis=1,
            )  # fmt: skip
        angle = _edge(s, phi - shear)
        return Rested(way, -length * s.total(bend), start, turned - bend, length, angle)

    def slopes(self, wrench: Array, gravity: Any) -> Slopes:
        """At rest under one wrench (3,), and how that changes with it."""
        found = self.rest(np.vstack([wrench, wrench + 1j * STEP * np.eye(3)]), gravity)
        way, turn, start = (np.imag(part[1:]).T / STEP for part in found[:3])
        return Rested(*(np.real(part[0]) for part in found)), (way, turn, start)

    def by_weight(self, wrench: Array, gravity: Array, share: float) -> tuple[Any, Any, Any]:
        """How way (2,), turn and start (3,) change with the share of gravity (2,)."""
        if not gravity.any():
            return 0.0, 0.0, 0.0
        found = self.rest(wrench[None], (share + 1j * STEP) * gravity)
        way, turn, start = (np.imag(part[0]) / STEP for part in found[:3])
        return way, turn, start

    def curve(self, rested: Rested) -> Legendre:
        """Its undeformed curve, of the first wrench."""
        return self.stations.curve(float(rested.length[0]), self.side * rested.curvature[0])


def _edge(s: Stations, f: Any) -> Any:
    """Value (k,) at 0 of functions (k, panels, points)."""
    ends = legendre.legvander(np.array([-1.0]), POINTS - 1)[0] @ _rule()[2]
    return f[..., 0, :] @ ends


def deformed_curve(
    leaf: Leaf, mesh: Mesh, axes: Axes, state: tuple[Model, State, int], gravity: Array
) -> Legendre:
    """The line that a leaf has as member i of a state (model, motion, i), as the curve of one drawn there; gravity (2,)."""
    model, motion, i = state
    own, ends = Sections(leaf, mesh), member_ends(model, motion, i)
    value, number, inner = member_arrays(model, motion, i)
    s, length = own.stations, leaf.length
    side = np.sign(float(np.asarray(leaf.width_axis)[axes.normal]))
    kappa = side * curvature(value, number, inner, s.u.ravel())[:, 2].reshape(s.u.shape)
    first = axes.of(ends.frame[:, 0])
    theta = np.arctan2(first[1], first[0]) + length * s.integral(kappa)
    modes = int(number[:3].sum())
    weight = length * (s.total(own.mass) - s.integral(own.mass))
    fx, fy = (
        f + g * weight for f, g in zip(axes.of(ends.frame @ inner[modes : modes + 3]), gravity, strict=True)
    )
    along = 1.0 + own.stretch * (fx * np.cos(theta) + fy * np.sin(theta))
    across = own.shear * (fy * np.cos(theta) - fx * np.sin(theta))
    rate, shear = np.hypot(along, across), np.arctan(across / along)
    bends = (kappa + s.slope(shear) / length) / rate
    total = float(s.total(rate))
    sigma, u = s.integral(rate) / total, s.u.copy()
    for _ in range(8):
        # where the drawn line is at its own stations
        u = np.clip(u - (s.at(sigma, u) - s.u) * total / s.at(rate, u), 0.0, 1.0)
    return s.curve(length * total, side * s.at(bends, u))


__all__ = ["Axes", "DrawnLeaf", "Slopes", "axes_of", "deformed_curve", "rotated"]
