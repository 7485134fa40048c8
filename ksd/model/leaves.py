"""Leaf springs of a scene as members: strain-mode bodies or chains of Appendix A elements.

A leaf is straight or curved in the undeformed configuration, uniform or with a profile. A tapered strain-mode leaf has
curvature modes weighted by its bending compliance, so that a moment that is linear along it needs two modes however deep the
notch is.
"""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ksd.elements import corotational_values as chains
from ksd.elements.plate_energy import POINT_NUMBERS, curl_loss, plate_point
from ksd.elements.pressure import GIVEN_MODES
from ksd.elements.strain import fill_leaf_fields, leaf_fields
from ksd.elements.strain_values import (
    Modes,
    load_tables,
    make_modes,
    strain_sizes,
    strain_values,
    uniform_modes,
)
from ksd.errors import SceneError
from ksd.model.arrays import COROTATIONAL, STRAIN
from ksd.model.mesh import Mesh
from ksd.model.pack import Member
from ksd.model.warping_runs import clamped_twist
from ksd.scene.curve import MAX_CURVE_MODES, Curve, CurvePart, cached_line, projection_error
from ksd.scene.leaf import CHORD_FIT, LeafCondition
from ksd.scene.line_load import forces_along, loads_between
from ksd.scene.profile import ProfilePart
from ksd.section import Section
from ksd.section.along_leaf import AlongLeaf
from ksd.section.section import SectionArrays
from ksd.section.warping import RestrainedTwist

LOCAL_DEGREE = 6
"""Degree of the polynomial that represents a compliance that clamps change along a leaf, on every mesh, which converges as
for a smooth one; constant and linear moments need 2."""
PLATE_POINTS = 16
"""Gauss points of the energy of plate stiffening of a uniform leaf; more where it has more than 14 modes."""
SECANT_STEPS = 8
"""Newton steps to the curvature of a leaf with plate stiffening at a moment, to rounding."""
PANELS = 8
"""Number of equal quadrature panels of a leaf with a profile, further divided at its breaks."""


_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
"""For every axis the next two in cyclic order, for cross products."""


def leaf_axes(start: np.ndarray, end: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Axes (..., 3, 3) of straight leaves, in columns: e1 along the leaf, e2 along its thickness, e3 along its width."""
    along = end - start
    # ufunc methods, as np.cross and np.linalg.norm take five times as long on the small arrays of one design
    e1 = along / np.sqrt(np.add.reduce(along * along, axis=-1, keepdims=True))
    e3 = width - np.add.reduce(width * e1, axis=-1, keepdims=True) * e1
    e3 = e3 / np.sqrt(np.add.reduce(e3 * e3, axis=-1, keepdims=True))
    axes = np.empty((*start.shape, 3))
    axes[..., 0], axes[..., 2] = e1, e3
    axes[..., 1] = e3.take(_NEXT, -1) * e1.take(_LAST, -1) - e3.take(_LAST, -1) * e1.take(_NEXT, -1)
    return axes


def restrained_twist(leaf: Any, mesh: Mesh) -> RestrainedTwist | None:
    """Twist of a leaf with restrained warping; None where its mesh or its section has none."""
    if not (mesh.warping and leaf.section.Iw > 0.0):
        return None
    return (leaf.condition and leaf.condition.twist) or _own_twist(leaf)


def rigidities(section: Section | SectionArrays, leaf: Any, mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """(GJ, EIy, EIz) [N m^2] and (1/EA, 1/(ky GA), 1/(kz GA)) [1/N] of one section of a leaf; (3, k) each of many.

    With the factor of restrained warping, without plate stiffening: how both vary along the leaf is not local to a section
    (`LeafCondition`).
    """
    E, G = leaf.material.E, leaf.material.G
    twist = restrained_twist(leaf, mesh)
    torsion = 1.0 if twist is None else twist.factor
    stiff = np.array([torsion * G * section.J, E * section.Iy, E * section.Iz])
    shear = np.array([1.0 / (section.ky * G * section.A), 1.0 / (section.kz * G * section.A)])
    return stiff, np.concatenate([[1.0 / (E * section.A)], shear if mesh.shear else 0.0 * shear])


def rod_compliances(leaf: Any, mesh: Mesh, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(1/GJ, 1/EIy, 1/EIz) [1/(N m^2)] and (1/EA, 1/(ky GA), 1/(kz GA)) [1/N] of a leaf at fractions s (k,), (3, k) or
    (3, 1) each, with restrained warping, and with plate stiffening at small curvature."""
    if leaf.profile is None:
        stiff, soft = (a[:, None] for a in rigidities(leaf.section, leaf, mesh))
    else:
        stiff, soft = rigidities(leaf.profile.sections(s), leaf, mesh)
    bending, twist = 1.0 / stiff, restrained_twist(leaf, mesh)
    plate = None if leaf.condition is None else leaf.condition.plate
    if twist is not None or plate is not None:
        bending = bending * np.stack([
            np.ones(len(s)) if twist is None else twist.compliance(s), np.ones(len(s)),
            np.ones(len(s)) if plate is None else plate(s).compliance,
        ])  # fmt: skip
    return bending, soft


_cached_twist = lru_cache(maxsize=256)(clamped_twist)


def _own_twist(leaf: Any) -> RestrainedTwist:
    """Twist of a single leaf, cached because it is needed at every station along the leaf."""
    try:
        return _cached_twist(leaf)
    except TypeError:
        # a profile of the user may not be hashable
        return clamped_twist(leaf)


@dataclass(frozen=True)
class _StressFreeCurve(Curve):
    """The stress-free shape of a leaf in its condition: its own curve stretched, and bowed about e3."""

    leaf: Any
    length: float

    def __post_init__(self) -> None:
        if self.leaf.curve is not None:
            object.__setattr__(self, "breaks", self.leaf.curve.breaks)

    def curvature(self, s: float) -> np.ndarray:
        """(3,) 1/m at fraction s of the arc length."""
        own = np.zeros(3) if self.leaf.curve is None else self.leaf.curve.curvature(s)
        return own / self.leaf.condition.stretch + np.array([0.0, 0.0, self.leaf.condition.natural_curvature])

    def curvatures(self, s: Any) -> np.ndarray:
        """(k, 3) 1/m at fractions s (k,)."""
        own = np.zeros((len(s), 3)) if self.leaf.curve is None else self.leaf.curve.curvatures(s)
        return own / self.leaf.condition.stretch + np.array([0.0, 0.0, self.leaf.condition.natural_curvature])


def stress_free_leaf(leaf: Any) -> Any:
    """The leaf with its stress-free shape, which differs from that described by heat and prestress."""
    state = leaf.condition
    if state is None or (state.stretch == 1.0 and state.natural_curvature == 0.0):
        return leaf
    if state.natural_curvature == 0.0 and leaf.curve is None:
        end = np.asarray(leaf.start) + state.stretch * np.subtract(leaf.end, leaf.start)
        return replace(leaf, end=tuple(end.tolist()))
    return replace(leaf, curve=_StressFreeCurve(leaf, leaf.length * state.stretch))


@dataclass(frozen=True)
class _Body:
    """A leaf as a member without a position.

    kind, value, number: kind, constants and settings of the member; inner: undeformed inner state; store: count of its
    stored numbers; d (3,), Q (3, 3): pose of the undeformed end q in the frame of end p; mass [kg].
    """

    kind: int
    value: np.ndarray
    number: np.ndarray
    inner: np.ndarray
    store: int
    d: np.ndarray
    Q: np.ndarray
    mass: float = 0.0


CURVE_TURN_TOLERANCE = 1e-4
"""Rotation [rad], root mean square over a leaf, by which its modes may deviate from its curve."""
MIN_FOLLOWED_TURN = 5.0
"""Total rotation [rad] of a wavy curve that the modes of one leaf can always represent."""


def leaf_orders(leaf: Any, mesh: Mesh) -> tuple[tuple[int, int, int], int]:
    """Curvature modes and quadrature points of a leaf: those of the mesh, more for a curved leaf.

    A moment that is constant in space varies like a sine along an arc. One more mode per 30 degrees of total rotation keeps
    the error of the compliance at 1e-7 (circular arcs of up to 330 degrees, against meshes of 16 modes). A wavy curve needs
    as many modes as represent it to `CURVE_TURN_TOLERANCE`, however small its total rotation: with fewer modes its in-plane
    stiffness was 3 % wrong, and so was its out-of-plane stiffness with fewer torsion modes.
    """
    # curvature by heat is small; equal modes with and without it keep their error out of the difference
    curve = leaf.curve.leaf.curve if isinstance(leaf.curve, _StressFreeCurve) else leaf.curve
    if curve is None or leaf.orders is not None:
        return _orders(leaf.orders or mesh.orders, mesh)
    return _curved_orders(leaf.length, curve, mesh)


@lru_cache(maxsize=64)
def _orders(orders: tuple[int, int, int], mesh: Mesh) -> tuple[tuple[int, int, int], int]:
    """`leaf_orders` of a straight leaf with these orders."""
    return mesh.modes(orders, max(mesh.points, max(orders) + 1))


@lru_cache(maxsize=512)
def _curved_orders(length: float, curve: Any, mesh: Mesh) -> tuple[tuple[int, int, int], int]:
    """`leaf_orders` of a leaf of this length and curve."""
    orders, points = mesh.orders, max(mesh.points, max(mesh.orders) + 1)
    kappa = length * curve.curvatures(np.linspace(0.0, 1.0, 65))
    more = int(np.ceil(np.rad2deg(np.sqrt((kappa**2).sum(axis=1)).mean()) / 30.0))
    tolerance = (
        CURVE_TURN_TOLERANCE / max(np.sqrt((kappa**2).mean(axis=0).sum()), CURVE_TURN_TOLERANCE)
    ) ** 2
    needed = min(1 + int((projection_error(curve) > tolerance).sum()), MAX_CURVE_MODES)
    # a bend turns moments into torsion, a twist mixes all axes
    is_curved = kappa.any(axis=0)
    least = np.where([is_curved.any(), *(is_curved[1:] | is_curved[0])], needed, 0).tolist()
    orders = tuple(max(n, min(max(n + more, m), MAX_CURVE_MODES)) for n, m in zip(orders, least, strict=True))
    return mesh.modes(orders, max(points, max(orders) + 3))


def _curve_amplitudes(leaf: Any, modes: Modes, orders: tuple[int, int, int]) -> np.ndarray:
    """Amplitudes (N,) of the stress-free curvature, by weighted least squares at the quadrature points."""
    kappa = leaf.curve.curvatures(modes.s).T
    amplitudes = np.zeros(sum(orders))
    for axis, end in enumerate(np.cumsum(orders).tolist()):
        if kappa[axis].any():
            own = slice(end - orders[axis], end)
            weighted = modes.basis[own] * modes.weight
            amplitudes[own] = np.linalg.solve(weighted @ modes.basis[own].T, weighted @ kappa[axis])
    return amplitudes


def leaf_modes(leaf: Any, mesh: Mesh) -> Modes:
    """Tables of the curvature modes of a strain-mode leaf: Legendre, or weighted by its compliance if it has a profile."""
    orders, points = leaf_orders(leaf, mesh)
    if leaf.profile is None:
        return uniform_modes(orders, points)
    inner = sorted({*np.linspace(0, 1, PANELS + 1)[1:-1].tolist(), *leaf.profile.breaks})
    nominal, _ = rigidities(leaf.section, leaf, mesh)

    def softness(s: np.ndarray) -> np.ndarray:
        return np.asarray(nominal[:, None] / rigidities(leaf.profile.sections(s), leaf, mesh)[0])

    return make_modes(orders, max(6, max(orders) // 2), breaks=(0.0, *inner, 1.0), shape=softness)


def _with_plate(modes: Modes, leaf: Any, mesh: Mesh) -> Modes:
    """Modes of a leaf with plate stiffening: those of the leaf with its own stiffness about e3, and its plate numbers.

    The amplitudes are those of the modes with which moments have the same work, so that constant and linear moments bend
    the leaf exactly, however steep its compliance is near a clamp.
    """
    own, soft = _soft_modes(leaf, mesh, 2, leaf.condition.plate, LOCAL_DEGREE)
    energy = modes.energy.copy()
    stiff = energy[own, own] @ np.linalg.solve(soft, energy[own, own])
    energy[own, own] = 0.5 * (stiff + stiff.T)
    return modes._replace(energy=energy, plate=_plate_numbers(modes, leaf, own))


def _with_twist(modes: Modes, leaf: Any, mesh: Mesh, twist: RestrainedTwist) -> Modes:
    """Modes of a leaf with restrained warping: the rates of twist by constant, linear, ... torques, as far as its modes have
    these, so that smooth torques need few of them."""
    # n modes have positive energies with moments to 2 (n - 1) of a compliance that vanishes at clamps
    degree = max(LOCAL_DEGREE, 2 * leaf_orders(leaf, mesh)[0][0] - 2)
    own, soft = _soft_modes(leaf, mesh, 0, twist, degree)
    energy, basis, moments = modes.energy.copy(), modes.basis.copy(), modes.moments.copy()
    share = np.linalg.solve(energy[own, own], soft).T
    energy[own, own], basis[own], moments[..., own] = soft, share @ basis[own], moments[..., own] @ share.T
    return modes._replace(energy=energy, basis=basis, moments=moments)


def _soft_modes(leaf: Any, mesh: Mesh, axis: int, along: AlongLeaf, degree: int) -> tuple[slice, np.ndarray]:
    """The modes about an axis, and the work (n, n) of their moments P_i on the curvatures c P_j; along: the compliance over
    that of the section, its first row. Of c the moments up to a degree count, as if it were smooth."""
    orders, _ = leaf_orders(leaf, mesh)
    cuts = np.unique([*along.breaks, *(leaf.profile.breaks if leaf.profile is not None else ())])
    # exact for two modes and a moment up to the degree, where a short piece has no breaks
    x, weight = np.polynomial.legendre.leggauss(max(12, orders[axis] + degree // 2))
    s = (cuts[:-1, None] + np.diff(cuts)[:, None] * 0.5 * (1.0 + x)).ravel()
    weight = (np.diff(cuts)[:, None] * 0.5 * weight).ravel()
    compliance = along.rows(s)[0]
    if leaf.profile is not None:
        nominal = rigidities(leaf.section, leaf, mesh)[0][axis]
        compliance = compliance * nominal / rigidities(leaf.profile.sections(s), leaf, mesh)[0][axis]
    low = np.polynomial.legendre.legvander(2.0 * s - 1.0, degree)
    weight = weight * (low @ ((2 * np.arange(degree + 1) + 1) * (low.T @ (weight * compliance))))
    P = np.polynomial.legendre.legvander(2.0 * s - 1.0, orders[axis] - 1).T
    return slice(sum(orders[:axis]), sum(orders[: axis + 1])), (weight * P) @ P.T


def secant_compliances(
    leaf: Any, s: np.ndarray, moments: np.ndarray, compliance: np.ndarray, own: np.ndarray
) -> np.ndarray:
    """Curvature by moment (k,) [1/(N m^2)] of a leaf with plate stiffening at fractions s (k,) under these moments [Nm].

    compliance: at small curvature; own: curvature at rest [1/m].
    """
    _, loss, rate = leaf.condition.plate(s)
    numbers = _point_numbers(leaf, s, loss, rate, own)
    found = compliance.copy()
    for k in np.flatnonzero(moments).tolist():
        bend = moments[k] * compliance[k]
        for _ in range(SECANT_STEPS):
            moment, stiffness = plate_point(numbers[k], 0, own[k] + bend, bend)
            bend -= (bend / compliance[k] + moment - moments[k]) / (1.0 / compliance[k] + stiffness)
        found[k] = bend / moments[k]
    return found


def _plate_numbers(modes: Modes, leaf: Any, z: slice) -> np.ndarray:
    """Numbers of `ksd.elements.plate_energy` and modes about e3 at the plate points (k, POINT_NUMBERS + nz) of a leaf.

    The points of a uniform leaf are the same on most meshes, so that the error of the mesh is that of the modes.
    """
    plate, s, share, basis = leaf.condition.plate, modes.s, modes.weight, modes.basis[z].T
    if leaf.profile is None:
        points = max(PLATE_POINTS, basis.shape[1] + 2)
        x, share = np.polynomial.legendre.leggauss(points)
        s, share = 0.5 * (1.0 + x), 0.5 * share
        basis = np.polynomial.legendre.legvander(x, basis.shape[1] - 1)
        # with these weights the sum over the points is exact for polynomials, however steep chi is near a clamp
        cuts = np.array(plate.breaks)
        y, weight = np.polynomial.legendre.leggauss(12)
        fine = (cuts[:-1, None] + np.diff(cuts)[:, None] * 0.5 * (1.0 + y)).ravel()
        weight = (np.diff(cuts)[:, None] * 0.5 * weight).ravel()
        at, all_ = (np.polynomial.legendre.legvander(2.0 * v - 1.0, points - 1) for v in (s, fine))
        interpolated = (at * (2 * np.arange(points) + 1)) @ (all_.T * weight)
        loss, rate = (interpolated @ values for values in plate(fine)[1:])
    else:
        # of the part of the leaf that a point stands for
        loss, rate = plate.means(np.concatenate([[0.0], np.cumsum(share)]))[1:]
    own = np.zeros(len(s)) if leaf.curve is None else leaf.curve.curvatures(s)[:, 2]
    numbers = _point_numbers(leaf, s, loss, rate, own)
    numbers[:, 0] *= leaf.length * share
    return np.column_stack([numbers, basis])


def _point_numbers(
    leaf: Any, s: np.ndarray, loss: np.ndarray, rate: np.ndarray, own: np.ndarray
) -> np.ndarray:
    """Numbers (k, POINT_NUMBERS) of `ksd.elements.plate_energy` per length at fractions s (k,) of a leaf."""
    nu, section = leaf.material.nu, leaf.section if leaf.profile is None else leaf.profile.sections(s)
    width, thickness, Iz = (
        np.broadcast_to(getattr(section, n), len(s)) for n in ("width", "thickness", "Iz")
    )
    wide = width > thickness
    found = np.zeros((len(s), POINT_NUMBERS))
    found[:, 0] = wide * nu**2 / (1.0 - nu**2) * leaf.material.E * Iz
    found[wide, 1] = 3.0 * (1.0 - nu**2) * (width**2 / thickness)[wide] ** 2
    found[:, 2], found[:, 3] = loss, np.maximum(rate, 0.0)
    if own.any():
        phi = np.array([curl_loss(z)[0] for z in (found[:, 1] * own**2).tolist()])
        found[:, 4] = found[:, 2] * phi / (1.0 + found[:, 3] * phi)
    return found


def mass_density(leaf: Any) -> float:
    """Density [kg/m^3] by which sections and natural length of a leaf have its mass: less where heat has stretched it; zero
    for a material without density."""
    expansion: float = 1.0 if leaf.condition is None else leaf.condition.expansion
    return (leaf.material.density or 0.0) / expansion


def line_mass(leaf: Any, s: np.ndarray) -> np.ndarray:
    """Mass per natural length (len(s),) [kg/m] of a leaf at fractions s of it; zero for a material without density."""
    density = mass_density(leaf)
    if leaf.profile is None:
        return np.full(len(s), density * leaf.section.A)
    return np.asarray(density * leaf.profile.sections(s).A)


@lru_cache(maxsize=512)
def _strain_body(leaf: Any, mesh: Mesh, heavy: bool, load_modes: int = 0) -> _Body:
    # cached as the full model, the substructures and equal joints have the same leaf; arrays are copied when packed
    orders, points = leaf_orders(leaf, mesh)
    stiff, soft = rigidities(leaf.section, leaf, mesh)
    words: dict[str, Any] = {"length": leaf.length, "orders": orders, "points": points}
    modes = leaf_modes(leaf, mesh)
    if leaf.profile is not None:
        soft = rigidities(leaf.profile.sections(modes.s), leaf, mesh)[1].T
    if leaf.condition is not None and leaf.condition.plate is not None:
        modes = _with_plate(modes, leaf, mesh)
    if (twist := restrained_twist(leaf, mesh)) is not None:
        modes = _with_twist(modes, leaf, mesh, twist)
    if leaf.curve is not None:
        words["amplitudes"] = _curve_amplitudes(leaf, modes, orders)
    mass = 0.0
    if heavy:
        words["line_mass"] = line_mass(leaf, modes.s)
        mass = leaf.length * float(modes.weight @ words["line_mass"])
    if load_modes:
        line = words.pop("line_mass", None)
    value, number = strain_values(rigidity=stiff, compliance=soft, modes=modes, **words)
    if load_modes:
        value = np.concatenate([value, _load_tables(leaf, modes, line, load_modes)])
        number[5] = load_modes
    size, store = strain_sizes(number, has_weight=heavy or load_modes > 0)
    inner = np.zeros(size)
    if leaf.curve is None:
        return _Body(STRAIN, value, number, inner, store, np.array([leaf.length, 0, 0]), np.eye(3), mass)
    inner[: len(words["amplitudes"])] = words["amplitudes"]
    # without loads
    d, Q = _undeformed_end(value, np.append(number[:5], [0, 0]), inner[: sum(orders) + 6])
    return _Body(STRAIN, value, number, inner, store, d, Q, mass)


def _load_tables(leaf: Any, modes: Modes, line_mass: np.ndarray | None, load_modes: int) -> np.ndarray:
    """`ksd.elements.strain_values.load_tables` of a leaf with so many load modes."""
    width, L = None, leaf.length
    if load_modes > GIVEN_MODES:
        width = leaf.section.width if leaf.profile is None else leaf.profile.sections(modes.s).width
        width = np.broadcast_to(width, len(modes.s))
    line = np.zeros(len(modes.s)) if line_mass is None else line_mass
    return load_tables(modes.s, L * modes.weight, L * modes.integral, line, width)


def _undeformed_end(
    value: np.ndarray, number: np.ndarray, inner: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pose of end q integrated like the leaf itself, so that a curved leaf is exactly stress-free when undeformed."""
    fields = leaf_fields(number)
    fill_leaf_fields(value, number, inner, np.zeros(0), fields)
    return fields.end.copy(), fields.R[-1].copy()


def _element_section(
    section: Section, leaf: Any, mesh: Mesh, compliance: float = 1.0, twist: float = 1.0
) -> chains.ElementSection:
    """Section and material numbers of an element of a chain; compliance, twist: of its plate stiffening and restraint."""
    E, G = leaf.material.E, leaf.material.G
    stiff, _ = rigidities(section, leaf, mesh)
    shear_factor = 1.0 if mesh.shear else math.inf
    return chains.ElementSection(
        E,
        G,
        section.A,
        stiff[0] / G / twist,
        section.Iy,
        stiff[2] / E / compliance,
        shear_factor * section.ky,
        shear_factor * section.kz,
    )


def _chain_body(leaf: Any, mesh: Mesh, heavy: bool) -> _Body:
    count = leaf.elements or mesh.elements
    curve = None
    if leaf.curve is not None:
        nodes = [cached_line(leaf.curve, k / count) for k in range(count + 1)]
        curve = np.array([place for place, _ in nodes]), np.array([axes for _, axes in nodes])
    value = chains.chain_values(_element_section(leaf.section, leaf, mesh), leaf.length, count, curve)
    plate = None if leaf.condition is None else leaf.condition.plate
    cuts, twist = np.linspace(0.0, 1.0, count + 1), restrained_twist(leaf, mesh)
    soft = np.ones(count) if plate is None else plate.means(cuts).compliance
    turns = np.ones(count) if twist is None else twist.mean_rows(cuts)[0]
    if leaf.profile is not None or plate is not None or twist is not None:
        for k in range(count):
            # each element has the section of its middle
            section = leaf.section if leaf.profile is None else leaf.profile.section((k + 0.5) / count)
            at = 16 * k
            value[at + 1 : at + 7] = chains.stiffness_numbers(
                _element_section(section, leaf, mesh, soft[k], turns[k]), value[at]
            )
    number = np.array([count, int(mesh.mip)], np.int64)
    d, Q = chains.undeformed_end(value, number)
    inner, store, mass = (
        chains.undeformed_inner(value, number),
        chains.sizes(count, has_weight=heavy).store,
        0.0,
    )
    if heavy:
        lumps = chains.lumped_masses(value, count, line_mass(leaf, (np.arange(count) + 0.5) / count))
        value, mass = np.concatenate([value, lumps]), float(lumps[: count + 1].sum())
    return _Body(COROTATIONAL, value, number, inner, store, d, Q, mass)


def _check_shape_kept(leaf: Any, d: np.ndarray, name: str) -> None:
    """Check that the modes of a leaf represent its curve: their end q is at d (3,) in the frame of end p.

    Raises SceneError where their chord differs from that of the curve by more than `CHORD_FIT` of it.
    """
    exact, _ = cached_line(leaf.curve, 1.0)
    if abs(np.linalg.norm(d) - np.linalg.norm(exact)) <= CHORD_FIT * np.linalg.norm(exact):
        return
    curve, first, last = leaf.curve, 0.0, 1.0
    if isinstance(curve, CurvePart):
        # between two points of the leaf that was drawn
        (first, last), curve, name = curve.part, curve.whole, name.rpartition(":")[0]
    where = f"leaf '{name}'"
    if last - first < 1.0:
        where += f", from s = {1e3 * first * curve.length:.4g} to {1e3 * last * curve.length:.4g} mm,"
    inside = [1e3 * b * curve.length for b in curve.breaks if first < b < last]
    if inside:
        places = ", ".join(f"{b:.4g}" for b in inside[:6]) + ", ..." * (len(inside) > 6)
        raise SceneError(
            f"{where} has breaks of its curvature at s = {places} mm, which curvature modes do not follow; put a point at "
            f"each, mechanism.point('{name}', s), and each piece has modes of its own"
        )
    turning = leaf.length * np.abs(leaf.curve.curvatures(np.linspace(0.0, 1.0, 65))).sum(axis=1).mean()
    pieces = max(2, math.ceil(turning / MIN_FOLLOWED_TURN))
    pieces = next(
        (n for n in range(pieces, pieces + 64) if projection_error(leaf.curve, n)[11] < 1e-6), pieces
    )
    raise SceneError(
        f"{where}: its curve bends to and fro more often than the curvature modes of a leaf; put points on it, "
        f"mechanism.point('{name}', s) every {1e3 * leaf.length / pieces:.3g} mm, and each piece has modes of its own"
    )


def _place_leaf(leaf: Any, d: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Axes (3, 3) of end p such that end q, at d (3,) in them, lies in the direction of the given end, and its position
    (3,).

    Raises SceneError for a curve that the modes of the leaf do not represent.
    """
    if leaf.curve is not None:
        _check_shape_kept(leaf, d, name)
    start, end, width = (np.asarray(v, float) for v in (leaf.start, leaf.end, leaf.width_axis))
    axes = leaf_axes(start, end, width) @ leaf_axes(np.zeros(3), d, np.array([0.0, 0.0, 1.0])).T
    return axes, start + axes @ d


def leaf_ends(leaf: Any, d: np.ndarray, Q: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Positions (2, 3) and axes (2, 3, 3) of the clamped ends of a leaf, with its assembly error.

    d (3,), Q (3, 3): pose of the undeformed end q in the frame of end p.
    """
    axes, tip = _place_leaf(leaf, d, name)
    clamp = axes @ Q
    if leaf.condition is not None:
        tip, clamp = _displaced_clamp(leaf.condition, axes, tip, clamp)
    return np.array([leaf.start, tip]), np.array([axes, clamp])


def _displaced_clamp(
    state: LeafCondition, axes: np.ndarray, tip: np.ndarray, clamp: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Position and axes of the clamp of end q, displaced and rotated by the assembly error."""
    tip = tip + axes @ np.asarray(state.shift)
    if any(state.turn):
        clamp = Rotation.from_rotvec(axes @ np.asarray(state.turn)).as_matrix() @ clamp
    return tip, clamp


def leaf_member(leaf: Any, mesh: Mesh, *, name: str, heavy: bool = False, load_modes: int = 0) -> Member:
    """The member of a leaf with the given ends; heavy: with its weight, where its material has a density; load_modes: number
    of modes of its distributed loads, where there are more than its weight.

    Orders and elements of the leaf itself take precedence over those of `mesh`.
    """

    def make_body(leaf: Any) -> _Body:
        return (
            _strain_body(leaf, mesh, heavy, load_modes)
            if mesh.leaf == "strain"
            else _chain_body(leaf, mesh, heavy)
        )

    described = make_body(leaf)
    offset, frame = leaf_ends(leaf, described.d, described.Q, name)
    stress_free = stress_free_leaf(leaf)
    body = described if stress_free is leaf else make_body(stress_free)
    if leaf.condition is not None:
        strained = body is not described or any(leaf.condition.shift) or any(leaf.condition.turn)
        if body.kind == COROTATIONAL and strained:
            end = frame[0].T @ (offset[1] - offset[0]), frame[0].T @ frame[1]
            body = replace(body, inner=chains.stretched_inner(body.value, body.number, *end))
    return Member(
        name=name,
        kind=body.kind,
        nodes=(0, 0),
        offset=offset,
        frame=frame,
        value=body.value,
        number=body.number,
        inner=body.inner,
        store=body.store,
        length=leaf.length,
        stiffness_scale=1.0 / (rigidities(leaf.section, leaf, mesh)[1][0] * leaf.length),
        mass=body.mass,
    )


def piece_name(leaf: str, k: int) -> str:
    """Name of piece k of a leaf, and of the node at its end; "leaf.2" is a second leaf."""
    return f"{leaf}:{k + 1}"


def whole_leaf_name(piece: str, leaves: Container[str]) -> str:
    """Name of the leaf of `leaves` that a piece belongs to, or of a whole leaf; else the name without its last ":k"."""
    name = piece
    while name not in leaves and ":" in name:
        name = name.rpartition(":")[0]
    return name if name in leaves else piece.rpartition(":")[0] or piece


def split_leaf(leaf: Any, cuts: Sequence[float]) -> list[Any]:
    """The pieces of a leaf cut at these fractions of its length, each a leaf; together they are equivalent to the whole.

    Raises SceneError for a curved leaf with an assembly error, which refers to the axes of the whole leaf.
    """
    state = leaf.condition or LeafCondition()
    misplaced = any(state.shift) or any(state.turn)
    if misplaced and leaf.curve is not None:
        raise SceneError(
            f"leaf '{leaf.name}' is curved, has an assembly error (mechanism.fit) and points on it; leave one of them out"
        )
    twist = state.twist or (_own_twist(leaf) if leaf.section.Iw > 0.0 else None)
    marks = (0.0, *cuts, 1.0)
    sections = [leaf.section_at(s) for s in marks]
    pieces = []
    for k, part in enumerate(pairwise(marks)):
        (start, axes), (end, _) = sections[k], sections[k + 1]
        along = (end - start) / np.linalg.norm(end - start)
        width = axes[:, 2] - (axes[:, 2] @ along) * along
        if not np.linalg.norm(width) > 1e-6:
            first, last = (1e3 * s * leaf.length for s in part)
            raise SceneError(
                f"leaf '{leaf.name}': its curve ends straight along the width of its start from s = {first:.4g} to "
                f"{last:.4g} mm, so that its width there cannot be said; move a point, or put one between"
            )
        plate = None if state.plate is None else state.plate.of_part(*part)
        own = replace(state, twist=None if twist is None else twist.of_part(*part), plate=plate)
        if misplaced and part[1] < 1.0:
            own = replace(own, shift=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0))
        pieces.append(
            replace(
                leaf,
                start=tuple(start.tolist()),
                end=tuple(end.tolist()),
                width_axis=tuple((width / np.linalg.norm(width)).tolist()),
                name=piece_name(leaf.name, k),
                condition=None if own == LeafCondition() else own,
                curve=None if leaf.curve is None else CurvePart(leaf.curve, part),
                profile=None if leaf.profile is None else ProfilePart(leaf.profile, part),
            )
        )
    return pieces


def element_leaves(leaf: Any, elements: int) -> list[Any]:
    """The elements of a leaf of a nodal mesh, each a leaf of one element."""
    if leaf.curve is not None or leaf.profile is not None:
        raise SceneError(
            f"leaf '{leaf.name}': nodal meshes are for straight uniform leaf springs; leave nodal out"
        )
    state = replace(leaf.condition or LeafCondition(), twist=None, plate=None)
    if state != LeafCondition():
        raise SceneError(
            f"leaf '{leaf.name}': nodal meshes are for leaves without heat, prestress and assembly error; leave nodal out"
        )
    cuts = [k / elements for k in range(1, elements)]
    return [replace(piece, elements=1) for piece in split_leaf(leaf, cuts)]


def loads_of_pieces(scene: Any) -> dict[str, tuple[float, ...]]:
    """Line load at the start and its change to the end (3 each) [N/m], and pressure [Pa], of the leaves and pieces of
    `cut_leaves` that have loads along them, by name."""
    found: dict[str, tuple[float, ...]] = {}
    along = forces_along(scene)
    loaded = {load.leaf for load in along}
    for placed in scene.leaves if loaded else ():
        if placed.name not in loaded:
            continue
        own = [x for x in along if x.leaf == placed.name]
        length, cuts = placed.leaf.length, sorted(p.s for p in scene.points if p.leaf == placed.name)
        for k, (first, last) in enumerate(pairwise((0.0, *cuts, length))):
            force, change, pressure = loads_between(own, length, first, last)
            if any(force) or any(change) or pressure or any(x.start <= first for x in own):
                found[piece_name(placed.name, k) if cuts else placed.name] = (*force, *change, pressure)
    return found


def cut_leaves(scene: Any) -> list[tuple[str, str, str, Any]]:
    """(name, link at start, link at end, leaf) of the free leaves of a scene, cut where links are points of them."""
    pieces_of_all: list[tuple[str, str, str, Any]] = []
    for placed in scene.leaves:
        on = sorted((p.s, p.name) for p in scene.points if p.leaf == placed.name)
        if not on:
            pieces_of_all.append((placed.name, placed.a, placed.b, placed.leaf))
            continue
        whole = replace(placed.leaf, name=placed.name)
        links = [placed.a, *(name for _, name in on), placed.b]
        pieces = split_leaf(whole, [s / whole.length for s, _ in on])
        pieces_of_all += [(p.name, *pair, p) for p, pair in zip(pieces, pairwise(links), strict=True)]
    return pieces_of_all
