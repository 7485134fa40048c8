"""What a scene says that hardly any flexure has: lengths and moduli in another unit, leaf springs that are no beams.

Nothing here is refused: rubber, silicon and giant antennas exist. The sentences go with the doctor and with every answer.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from ksd.checks import show
from ksd.scene.leaf import Leaf
from ksd.scene.material import Material
from ksd.scene.scene import Scene
from ksd.section import Section
from ksd.section.section import thickness_and_width

MIN_SLENDERNESS = 5.0
"""Length over thickness below which a leaf is a block: plane sections and clamps without compliance do not hold."""
LENGTH_RANGE = (1e-6, 5.0)
"""Leaf springs [m] from micromachined to as long as a room."""
MODULUS_RANGE = (1e6, 1.3e12)
"""Young's and shear moduli [Pa] from rubber to diamond."""
MIN_METAL_DENSITY, MIN_METAL_MODULUS = 2500.0, 5e9
"""Density [kg/m^3] from which a solid is a metal or a ceramic, and Young's modulus [Pa] that each of those has at least."""
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
"""What is in the names of metals."""
MAX_MECHANISM_SIZE = 10.0
"""Distance [m] of parts of one mechanism."""
DENSITY_RANGE = (10.0, 23e3)
"""Densities [kg/m^3] from foam to osmium."""
MAX_ACCELERATION, MAX_MASS = 1e3, 100.0
"""Weight of a hundred g [m/s^2], and a mass [kg] that no flexure carries; a plain number above was probably meant in another
unit."""
STRENGTH_RATIO_RANGE = (1e-5, 0.5)
"""Stress limits over Young's modulus."""


def likely_unit(value: float, dimension: str, key: str) -> str:
    """The unit in which a plain number of a scene file was probably meant, where in SI it is that of no flexure; else ""."""
    size = abs(value)
    if dimension == "length":
        return "mm" if size > LENGTH_RANGE[1] else ""
    if dimension == "angle":
        return "deg" if size > 2 * math.pi else ""
    if dimension == "stress" and 0.0 < size < MODULUS_RANGE[0]:
        return "GPa" if size < 1e3 and key in ("E", "G") else "MPa"
    if dimension == "density":
        return "g/cm^3" if 0.0 < size < DENSITY_RANGE[0] else ""
    if dimension == "acceleration":
        return "mm/s^2" if size > MAX_ACCELERATION else ""
    if dimension == "mass":
        return "g" if size > MAX_MASS else ""
    return ""


def drive_value_warnings(scene: Scene, values: Mapping[str, float], size: float) -> tuple[str, ...]:
    """A sentence for every drive value [m or rad] that was probably meant in another unit: over twice the size [m] of the
    mechanism, or more than a turn."""
    found = []
    for drive in scene.drives:
        value, (most, si, unit) = values.get(drive.name, 0.0), {
            "length": (2.0 * size, "m", "mm"), "angle": (2.0 * math.pi, "rad", "deg"), "number": (math.inf, "", ""),
        }[drive.dimension]  # fmt: skip
        if abs(value) > most:
            across = f" and the mechanism {size:.3g} m large" if unit == "mm" else ""
            found.append(
                f"{drive.name} = {value:g} is {value:g} {si}{across}: did you mean {value:g} {unit} "
                f"({value:g} * ksd.units.{unit} in Python)?"
            )
    return tuple(found)


def plausibility_warnings(scene: Scene) -> tuple[str, ...]:
    """One sentence for everything that is unusual, equal leaf springs together; nothing where all is as flexures are."""
    leaves = scene.leaf_names()
    materials = dict.fromkeys(leaf.material for leaf in leaves.values())
    found = [said for material in materials for said in _material_warnings(material)]
    for judge in (_length_warning, _thickness_warning, _width_warning):
        found += _grouped_warnings(leaves, judge)
    return (*found, *_size_warnings(scene))


def _size_warnings(scene: Scene) -> Iterator[str]:
    """Of the sizes of joints (the leaf springs in them are judged each), and of how far all parts are apart."""
    for placed in scene.joints:
        for key, dimension in placed.joint.quantities.items():
            said = getattr(placed.joint, key, None)
            if (
                dimension == "length"
                and key != "length"
                and said is not None
                and np.max(said) > LENGTH_RANGE[1]
            ):
                yield f"joint '{placed.name}': {key} = {show(said)} is in m, and that of no flexure; did you mean mm?"
    places = [j.origin for j in scene.joints] + [
        end for f in scene.leaves for end in (f.leaf.start, f.leaf.end)
    ]
    apart = np.ptp([*places, *(m.at for m in scene.masses)] or [(0.0, 0.0, 0.0)], axis=0)
    k = int(np.argmax(apart))
    if apart[k] > MAX_MECHANISM_SIZE:
        yield f"its joints, leaf springs and masses are {apart[k]:g} m apart along {'xyz'[k]}; lengths are in m"


def thinnest_section(leaf: Leaf) -> Section:
    """The section of a leaf, of one with a profile where it is thinnest (at 33 stations)."""
    if leaf.profile is None:
        return leaf.section
    return min((leaf.profile.section(k / 32) for k in range(33)), key=lambda q: q.Iz)


def _material_warnings(m: Material) -> Iterator[str]:
    name = f"material '{m.name}'" if m.name else "a material"
    # a shear modulus that follows from E needs no sentence of its own
    key, value = ("E", m.E) if not MODULUS_RANGE[0] <= m.E <= MODULUS_RANGE[1] else ("G", m.G)
    if value < MODULUS_RANGE[0]:
        yield (
            f"{name}: {key} = {value:g} Pa is softer than rubber; if it is meant in MPa, write {value:g}e6 in Python or "
            f"'{value:g} MPa' in a scene file"
        )
    elif m.E < MIN_METAL_MODULUS and (
        (m.density or 0.0) > MIN_METAL_DENSITY or any(metal in m.name.lower() for metal in METAL_NAME_PARTS)
    ):
        thousand = f": did you mean {m.E / 1e6:g} GPa?" if m.E < 1e9 else "; moduli are in Pa"
        why = f" of {m.density:g} kg/m^3" if (m.density or 0.0) > MIN_METAL_DENSITY else ""
        yield f"{name}: E = {m.E:g} Pa is softer than any metal{why}{thousand}"
    elif value > MODULUS_RANGE[1]:
        yield f"{name}: {key} = {value:g} Pa is stiffer than diamond (1.2e12 Pa); moduli are in Pa"
    if m.density is not None and not DENSITY_RANGE[0] <= m.density <= DENSITY_RANGE[1]:
        yield f"{name}: density = {m.density:g} kg/m^3 is that of no solid; steel has 7800"
    for key in ("yield_stress", "fatigue_limit"):
        limit = getattr(m, key)
        if limit is not None and not STRENGTH_RATIO_RANGE[0] <= limit / m.E <= STRENGTH_RATIO_RANGE[1]:
            yield f"{name}: {key} = {limit:g} Pa is {100 * limit / m.E:.2g} % of E; stresses are in Pa"


def _length_warning(leaf: Leaf) -> str:
    if LENGTH_RANGE[0] <= leaf.length <= LENGTH_RANGE[1]:
        return ""
    return f"length {leaf.length:g} m is that of no flexure; lengths are in m"


def _thickness_warning(leaf: Leaf) -> str:
    thickness = thickness_and_width(thinnest_section(leaf))[0]
    if leaf.length >= MIN_SLENDERNESS * thickness:
        return ""
    return (
        f"length {1e3 * leaf.length:.4g} mm is only {leaf.length / thickness:.2g} thicknesses; below {MIN_SLENDERNESS:g} a "
        "beam clamped in rigid blocks is a poor model, and the real one is softer"
    )


def _width_warning(leaf: Leaf) -> str:
    width, nu = thickness_and_width(leaf.section)[1], leaf.material.nu
    if leaf.length >= width or leaf.profile is not None:
        return ""
    more = f"by up to {100 * nu * nu / (1 - nu * nu):.2g} %, " if -1.0 < nu < 1.0 else ""
    return (
        f"width {1e3 * width:.4g} mm is more than its length {1e3 * leaf.length:.4g} mm; it bends as a plate, stiffer {more}"
        "and twists stiffer with its warping restrained: see the effects 'plate' and 'warping'"
    )


def _grouped_warnings(leaves: dict[str, Leaf], judge: Callable[[Leaf], str]) -> list[str]:
    """The sentences of all leaf springs, each once, with the names of those it holds for."""
    said: dict[str, list[str]] = {}
    for name, leaf in leaves.items():
        sentence = judge(leaf)
        if sentence:
            said.setdefault(sentence, []).append(name)
    return [f"{_leaf_list(names)}: {sentence}" for sentence, names in said.items()]


def _leaf_list(names: Sequence[str]) -> str:
    shown = ", ".join(f"'{name}'" for name in names[:3])
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return f"{'leaf springs' if len(names) > 1 else 'leaf'} {shown}{more}"
