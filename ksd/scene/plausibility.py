"""Warnings about unusual values in a scene: lengths and moduli in a wrong unit, leaf springs too stout for beam theory.

Nothing is refused here, since rubber, silicon and very large structures exist. The warnings are part of the doctor's report
and of every answer.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np

from ksd.checks import Vector, show
from ksd.scene.curve import Arc, CurvePart, cached_deviation
from ksd.scene.effects import Spring, TurnSpring
from ksd.scene.hinges import PLANES, plane_normal
from ksd.scene.leaf import Leaf
from ksd.scene.material import Material
from ksd.scene.scene import Scene
from ksd.section import Section
from ksd.section.section import thickness_and_width

MIN_SLENDERNESS = 5.0
"""Length over thickness of a leaf below which plane sections and rigid clamps are poor assumptions."""
LENGTH_RANGE = (1e-6, 5.0)
"""Usual lengths of leaf springs [m], from micromachined ones on."""
MODULUS_RANGE = (1e6, 1.3e12)
"""Usual Young's and shear moduli [Pa], from rubber to diamond."""
MIN_METAL_DENSITY, MIN_METAL_MODULUS = 2500.0, 5e9
"""Density [kg/m^3] above which a solid is a metal or a ceramic, and the smallest Young's modulus [Pa] of those."""
METAL_NAME_PARTS = (
    "steel",
    "alumin",
    "titan",
    "brass",
    "bronze",
    "copper",
    "invar",
    "nickel",
    "tungsten",
    "magnesium",
)
"""Parts of names of metals."""
MAX_THICKNESS_RATIO = 5.0
"""Thickness of a leaf over its width above which the two were probably exchanged."""
IN_PLANE_TOLERANCE = 1e-6
"""Component out of a plane, over the whole, that counts as rounding."""
MAX_MECHANISM_SIZE = 10.0
"""Usual limit of the distance [m] between parts of one mechanism."""
DENSITY_RANGE = (10.0, 23e3)
"""Usual densities [kg/m^3], from foam to osmium."""
MAX_CURVE_DEVIATION = 1e-3
"""Deviation [rad] of a leaf from its drawn shape, root mean square, above which answers say so."""
MAX_ACCELERATION, MAX_MASS = 1e3, 100.0
"""Usual limits of accelerations [m/s^2] (a hundred g) and masses [kg]; larger plain numbers are probably in another unit."""
STRENGTH_RATIO_RANGE = (1e-5, 0.5)
"""Usual yield stresses and fatigue limits over Young's modulus."""
MOST_FRICTION = 3.0
"""Coefficient of friction above which a warning is given."""


def likely_unit(value: float, dimension: str, key: str) -> str:
    """The unit that was probably meant by a plain number of a scene file, when it is unusual in SI; else ""."""
    size = abs(value)
    if dimension == "length":
        return "mm" if size > LENGTH_RANGE[1] else ""
    if dimension == "angle":
        return "deg" if size > 2 * math.pi else ""
    if dimension == "stress" and key != "pressure" and 0.0 < size < MODULUS_RANGE[0]:
        return "GPa" if size < 1e3 and key in ("E", "G") else "MPa"
    if dimension == "density":
        return "g/cm^3" if 0.0 < size < DENSITY_RANGE[0] else ""
    if dimension == "acceleration":
        return "mm/s^2" if size > MAX_ACCELERATION else ""
    if dimension == "mass":
        return "g" if size > MAX_MASS else ""
    return ""


def drive_value_warnings(scene: Scene, values: Mapping[str, float], size: float) -> tuple[str, ...]:
    """A warning for every drive value [m or rad] that was probably meant in another unit.

    Those are displacements over twice the `size` [m] of the mechanism, and rotations over a full turn.
    """
    warnings = []
    for drive in scene.drives:
        value, (limit, si, unit) = values.get(drive.name, 0.0), {
            "length": (2.0 * size, "m", "mm"), "angle": (2.0 * math.pi, "rad", "deg"), "number": (math.inf, "", ""),
        }[drive.dimension]  # fmt: skip
        if abs(value) > limit:
            mechanism = f" and the mechanism {size:.3g} m large" if unit == "mm" else ""
            warnings.append(
                f"{drive.name} = {value:g} is {value:g} {si}{mechanism}: did you mean {value:g} {unit} "
                f"({value:g} * ksd.units.{unit} in Python)?"
            )
    return tuple(warnings)


def plausibility_warnings(scene: Scene) -> tuple[str, ...]:
    """Warnings about all unusual values of a scene; one for all leaf springs with the same problem."""
    leaves = scene.leaf_names()
    materials = dict.fromkeys(leaf.material for leaf in leaves.values())
    warnings = [warning for material in materials for warning in _material_warnings(material)]
    for leaf_warning in (_length_warning, _exchange_warning, _thickness_warning, _width_warning):
        warnings += _grouped_warnings(leaves, leaf_warning)
    warnings += _curve_warnings(scene, leaves)
    warnings += [
        f"contact '{c.name}': friction = {c.friction:g} is that of no dry surfaces; rubber on concrete has about 1"
        for c in scene.contacts
        if c.friction > MOST_FRICTION
    ]
    return (*warnings, *_size_warnings(scene), *_plane_warnings(scene))


def _plane_warnings(scene: Scene) -> Iterator[str]:
    """A warning about all that acts out of the plane of a scene, which holds every link in it."""
    if scene.plane is None:
        return
    normal, axis = np.array(plane_normal(scene.plane)), "xyz"[PLANES[scene.plane]]
    held = list(_efforts_out_of_plane(scene, normal, axis))
    if held:
        yield (
            f"the plane {scene.plane} holds what acts out of it, {'; '.join(held)}: forces, stress and motion by that are "
            f"not in the answer; leave plane='{scene.plane}' out to simulate them"
        )


def _efforts_out_of_plane(scene: Scene, normal: np.ndarray, axis: str) -> Iterator[str]:
    """Every load, weight and spring that acts out of the plane with this normal, and with how much at rest."""

    def effort(
        owner: str, force: Sequence[float] | np.ndarray, moment: Sequence[float] | np.ndarray
    ) -> Iterator[str]:
        out = float(np.dot(force, normal))
        tilting = float(np.linalg.norm(np.asarray(moment) - np.dot(moment, normal) * normal))
        parts = [f"{out:.4g} N along {axis}"] * (abs(out) > IN_PLANE_TOLERANCE * float(np.linalg.norm(force)))
        tilts = tilting > IN_PLANE_TOLERANCE * float(np.linalg.norm(moment))
        parts += [f"{tilting:.4g} Nm about axes in it"] * tilts
        if parts:
            yield f"{' and '.join(parts)} of {owner}"

    for load in scene.loads:
        yield from effort(f"load '{load.name}'", load.force, load.moment)
    leaves = scene.leaf_names()
    for along in scene.line_loads:
        half = 0.5 * ((leaves[along.leaf].length if along.end is None else along.end) - along.start)
        force, turn = np.add(along.force, along.end_force), np.add(along.moment, along.end_moment)
        yield from effort(f"line load '{along.name}'", half * force, half * turn)
    if scene.gravity is not None:
        mass = sum(m.mass for m in scene.masses) + sum(map(_leaf_mass, scene.leaf_names().values()))
        yield from effort(f"gravity on {mass:.4g} kg", mass * np.asarray(scene.gravity), (0.0, 0.0, 0.0))
    for spring in scene.springs:
        if isinstance(spring, Spring):
            line = np.subtract(spring.end, spring.start)
            length = float(np.linalg.norm(line))
            tension = spring.stiffness * (length - spring.free_length)
            if length > 0.0 and abs(line @ normal) > IN_PLANE_TOLERANCE * length:
                yield from effort(f"spring '{spring.name}'", tension * line / length, (0.0, 0.0, 0.0))
        elif isinstance(spring, TurnSpring) and abs(np.dot(spring.axis, normal)) < 1.0 - IN_PLANE_TOLERANCE:
            moment = spring.stiffness * spring.rest_angle * np.asarray(spring.axis)
            held = list(effort(f"torsion spring '{spring.name}'", (0.0, 0.0, 0.0), moment))
            yield from held or [f"torsion spring '{spring.name}', whose axis is not normal to it"]


def _leaf_mass(leaf: Leaf) -> float:
    """Mass [kg] of a leaf spring, 0 where its material has no density."""
    areas = [leaf.section.A] if leaf.profile is None else [leaf.profile.section(k / 32).A for k in range(33)]
    return float(np.mean(areas)) * leaf.length * (leaf.material.density or 0.0)


def _curve_warnings(scene: Scene, leaves: Mapping[str, Leaf]) -> Iterator[str]:
    """Warnings about curves that the curvature modes of a leaf, between its points, do not follow as drawn."""
    for name, leaf in leaves.items():
        if leaf.curve is None or isinstance(leaf.curve, Arc):
            continue
        cuts = sorted(p.s / leaf.length for p in scene.points if p.leaf == name)
        parts = (
            [CurvePart(leaf.curve, part) for part in pairwise((0.0, *cuts, 1.0))] if cuts else [leaf.curve]
        )
        largest = max(map(cached_deviation, parts))
        if largest > MAX_CURVE_DEVIATION:
            inside = [b for b in leaf.curve.breaks if all(abs(b - cut) > 1e-9 for cut in cuts)]
            where = ", ".join(f"{b * leaf.length:.6g}" for b in inside[:6]) + ", ..." * (len(inside) > 6)
            at = (
                f"at the breaks of its curvature, s = {where} m"
                if inside
                else "where its curvature varies fast"
            )
            yield (
                f"leaf '{name}': curvature modes follow its drawn shape to {largest:.1g} rad only, which no error figure "
                f"holds; put points on it {at} (mechanism.point('{name}', s)), between which it is kept"
            )


def _size_warnings(scene: Scene) -> Iterator[str]:
    """Warnings about the dimensions of joints, their leaf springs excepted, and about distances between parts."""
    for placed in scene.joints:
        for key, dimension in placed.joint.quantities.items():
            value = getattr(placed.joint, key, None)
            if key == "length" or dimension != "length" or value is None:
                continue
            if np.max(value) > LENGTH_RANGE[1]:
                yield f"joint '{placed.name}': {key} = {show(value)} is in m, and that of no flexure; did you mean mm?"
    named = list(_placed_points(scene))
    points = np.array([point for _, point in named] or [(0.0, 0.0, 0.0)])
    axis = int(np.argmax(np.ptp(points, axis=0)))
    along = points[:, axis]
    extent = float(np.ptp(along))
    if extent > MAX_MECHANISM_SIZE:
        farthest, _ = named[int(np.argmax(np.abs(along - np.median(along))))]
        yield f"its parts are {extent:g} m apart along {'xyz'[axis]}, {farthest} farthest off; lengths are in m"


def _placed_points(scene: Scene) -> Iterator[tuple[str, Vector]]:
    """Points (3,) [m] of all parts of a scene, global, undeformed, with their names; joints last."""
    for load in scene.loads:
        # a moment acts on its link, wherever `at` is
        if any(load.force):
            yield f"load '{load.name}'", load.at
    for spring in scene.springs:
        if isinstance(spring, Spring):
            yield from ((f"an end of spring '{spring.name}'", end) for end in (spring.start, spring.end))
    for drive in scene.drives:
        moves = (term for term in drive.terms if term.kind == "translation")
        yield from ((f"the point of drive '{drive.name}'", term.point) for term in moves)
    for hinge in scene.hinges:
        yield f"{hinge.kind} '{hinge.name}'", hinge.at
    for mass in scene.masses:
        yield f"a mass on '{mass.link}'", mass.at
    for free in scene.leaves:
        yield from ((f"an end of leaf '{free.name}'", end) for end in (free.leaf.start, free.leaf.end))
    for placed in scene.joints:
        yield f"joint '{placed.name}'", placed.origin


def thinnest_section(leaf: Leaf) -> Section:
    """The section of a leaf; with a profile the one of smallest Iz among 33 stations."""
    if leaf.profile is None:
        return leaf.section
    return min((leaf.profile.section(k / 32) for k in range(33)), key=lambda q: q.Iz)


def _material_warnings(m: Material) -> Iterator[str]:
    """Warnings about moduli, density and strength of a material."""
    name = f"material '{m.name}'" if m.name else "a material"
    # an unusual shear modulus that follows from E needs no warning of its own
    key, value = ("E", m.E) if not MODULUS_RANGE[0] <= m.E <= MODULUS_RANGE[1] else ("G", m.G)
    if value < MODULUS_RANGE[0]:
        yield (
            f"{name}: {key} = {value:g} Pa is softer than rubber; if it is meant in MPa, write {value:g}e6 in Python or "
            f"'{value:g} MPa' in a scene file"
        )
    elif m.E < MIN_METAL_MODULUS and (
        (m.density or 0.0) > MIN_METAL_DENSITY or any(metal in m.name.lower() for metal in METAL_NAME_PARTS)
    ):
        hint = f": did you mean {m.E / 1e6:g} GPa?" if m.E < 1e9 else "; moduli are in Pa"
        why = f" of {m.density:g} kg/m^3" if (m.density or 0.0) > MIN_METAL_DENSITY else ""
        yield f"{name}: E = {m.E:g} Pa is softer than any metal{why}{hint}"
    elif value > MODULUS_RANGE[1]:
        yield f"{name}: {key} = {value:g} Pa is stiffer than diamond (1.2e12 Pa); moduli are in Pa"
    if m.density is not None and not DENSITY_RANGE[0] <= m.density <= DENSITY_RANGE[1]:
        yield f"{name}: density = {m.density:g} kg/m^3 is that of no solid; steel has 7800"
    for key in ("yield_stress", "fatigue_limit"):
        limit = getattr(m, key)
        if limit is not None and not STRENGTH_RATIO_RANGE[0] <= limit / m.E <= STRENGTH_RATIO_RANGE[1]:
            yield f"{name}: {key} = {limit:g} Pa is {100 * limit / m.E:.2g} % of E; stresses are in Pa"


def _length_warning(leaf: Leaf) -> str:
    """Warning about an unusual length; "" when it is usual."""
    if LENGTH_RANGE[0] <= leaf.length <= LENGTH_RANGE[1]:
        return ""
    return f"length {leaf.length:g} m is that of no flexure; lengths are in m"


def _thickness_warning(leaf: Leaf) -> str:
    """Warning about a leaf too stout for a beam; "" when it is slender."""
    thickness = thickness_and_width(thinnest_section(leaf))[0]
    if leaf.length >= MIN_SLENDERNESS * thickness:
        return ""
    return (
        f"length {1e3 * leaf.length:.4g} mm is only {leaf.length / thickness:.2g} thicknesses; below {MIN_SLENDERNESS:g} a "
        "beam clamped in rigid blocks is a poor model, and the real one is softer"
    )


def _exchange_warning(leaf: Leaf) -> str:
    """Warning about a leaf that is much thicker than wide; "" when it is not."""
    thickness, width = thickness_and_width(leaf.section)
    if not leaf.section.thickness or thickness <= MAX_THICKNESS_RATIO * width:
        return ""
    return (
        f"thickness {1e3 * thickness:.4g} mm is more than its width {1e3 * width:.4g} mm, so that it bends most "
        "easily along its width_axis; were the two exchanged? A rectangle takes thickness, then width"
    )


def _width_warning(leaf: Leaf) -> str:
    """Warning about a leaf wider than long; "" when it is not."""
    width, nu = thickness_and_width(leaf.section)[1], leaf.material.nu
    if leaf.length >= width or leaf.profile is not None:
        return ""
    more = f"by up to {100 * nu * nu / (1 - nu * nu):.2g} %, " if -1.0 < nu < 1.0 else ""
    return (
        f"width {1e3 * width:.4g} mm is more than its length {1e3 * leaf.length:.4g} mm; it bends as a plate, stiffer {more}"
        "and twists stiffer with its warping restrained: see the effects 'plate' and 'warping'"
    )


def _grouped_warnings(leaves: dict[str, Leaf], leaf_warning: Callable[[Leaf], str]) -> list[str]:
    """The warnings of all leaf springs, each once, with the names of the leaf springs it applies to."""
    names_by_warning: dict[str, list[str]] = {}
    for name, leaf in leaves.items():
        warning = leaf_warning(leaf)
        if warning:
            names_by_warning.setdefault(warning, []).append(name)
    return [f"{_leaf_list(names)}: {warning}" for warning, names in names_by_warning.items()]


def _leaf_list(names: Sequence[str]) -> str:
    """The first three names of leaf springs, and how many more there are."""
    shown = ", ".join(f"'{name}'" for name in names[:3])
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return f"{'leaf springs' if len(names) > 1 else 'leaf'} {shown}{more}"
