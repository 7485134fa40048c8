"""Largest strain and stress of all leaf springs, relative to the limits of their materials.

Strain is the largest principal strain of beam theory, from normal strain e = sigma/E and shear strain g = tau/G:
(1 - nu) e/2 + sqrt(((1 + nu) e)^2 + g^2)/2. Stress is von Mises, see `ksd.answers.stress`. Section forces belong to a
linear law between force and engineering strain; forces by other laws with the same modulus (Green-Lagrange, logarithmic)
differ by about 1.5 times the strain, so above one per cent of strain the law is a larger error than that of any mesh.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ksd.answers.centrelines import scene_leaves
from ksd.answers.derived import cached_per_model
from ksd.answers.forces import section_forces
from ksd.answers.printing import ROUNDING, PrintableAnswer, format_number
from ksd.answers.stress import LeafStress, stress_from_forces
from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.scene.material import Material
from ksd.scene.plausibility import plausibility_warnings

WARNING_STRAIN = 0.01
"""Strain above which a warning says that the linear law is no longer a small error."""
MAX_STRAIN = 0.05
"""Strain above which results of the linear law are not trusted: metals fracture, and forces by other laws differ by 7 %."""
LAW_ERROR_PER_STRAIN = 1.5
"""Relative difference of a force between common laws of elasticity, divided by the strain."""


@dataclass(frozen=True, repr=False)
class Strength(PrintableAnswer):
    """Largest strain and stress of a state.

    strain: largest of all leaves, in strain_leaf; stress_Pa: largest of all leaves, in stress_leaf at s [m] and point.
    yield_share, fatigue_share: largest ratio of stress to the limit of the material, in yield_leaf and fatigue_leaf; None
    (and an empty name) where no material has the limit.
    """

    strain: float
    strain_leaf: str
    stress_Pa: float
    stress_leaf: str
    s: float
    point: str
    yield_share: float | None
    yield_leaf: str
    fatigue_share: float | None
    fatigue_leaf: str

    @property
    def beyond(self) -> str:
        """Why the state is beyond the limits of a linear elastic beam of its material, in words; empty where it is not."""
        if not self.strain <= MAX_STRAIN:
            return (
                f"leaf '{self.strain_leaf}' is strained by {100 * self.strain:.3g} %, where a linear elastic beam is "
                f"trusted to {100 * MAX_STRAIN:g} %"
            )
        if self.yield_share is not None and self.yield_share > 1.0:
            return f"leaf '{self.yield_leaf}' yields: its stress is {self.yield_share:.3g} times its yield stress"
        return ""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences about the limits that are exceeded."""
        found = []
        if self.strain > WARNING_STRAIN:
            found.append(
                f"leaf '{self.strain_leaf}' is strained by {100 * self.strain:.3g} %; forces then depend on the law of "
                f"elasticity by about {100 * LAW_ERROR_PER_STRAIN * self.strain:.2g} %, and few materials stay elastic"
            )
        for share, leaf, what in (
            (self.yield_share, self.yield_leaf, "yield stress"),
            (self.fatigue_share, self.fatigue_leaf, "fatigue limit"),
        ):
            if share is not None and share > 1.0:
                found.append(f"the stress in leaf '{leaf}' is {share:.4g} times the {what} of its material")
        return tuple(found)

    def _line(self) -> str:
        return str(self)

    def __str__(self) -> str:
        shares = [
            f"{format_number(100 * share, 3, zero=ROUNDING)} % of the {what}"
            + f" in '{leaf}'" * (leaf != self.stress_leaf)
            for share, leaf, what in (
                (self.yield_share, self.yield_leaf, "yield stress"),
                (self.fatigue_share, self.fatigue_leaf, "fatigue limit"),
            )
            if share is not None
        ]
        limits = ", ".join(shares) or "the material gives no yield_stress or fatigue_limit"
        where = f"'{self.stress_leaf}' at s = {format_number(1e3 * self.s, 4, zero=1e-9)} mm, {self.point}"
        strained = "" if self.strain_leaf == self.stress_leaf else f" in '{self.strain_leaf}'"
        stress = f"{format_number(1e-6 * self.stress_Pa, 4, zero=ROUNDING)} MPa in {where}"
        return f"strain at most {format_number(100 * self.strain, 3, zero=ROUNDING)} %{strained}, stress {stress}: {limits}"


def strength(model: Model, motion: State, *, load_factor: float = 1.0) -> Strength | None:
    """Largest strain and stress of a state, and their ratios to the limits; None where there are no leaf springs."""
    return strength_of(
        model, stress_from_forces(model, section_forces(model, motion, load_factor=load_factor)).leaves
    )


def strength_of(model: Model, found: Mapping[str, LeafStress]) -> Strength | None:
    """`strength` from the stress of all leaves."""
    leaves = scene_leaves(model)
    if not found:
        return None
    strains = {name: _largest_strain(stress, leaves[name].material) for name, stress in found.items()}
    stresses = {name: stress.largest_Pa for name, stress in found.items()}
    strained, stressed = (max(by, key=lambda n: by[n]) for by in (strains, stresses))
    shares: list[tuple[float | None, str]] = []
    for limit in ("yield_stress", "fatigue_limit"):
        known = {
            n: v / most
            for n, v in stresses.items()
            if (most := getattr(leaves[n].material, limit)) is not None
        }
        worst = max(known, key=lambda n: known[n]) if known else ""
        shares.append((known.get(worst), worst))
    return Strength(
        strains[strained],
        strained,
        stresses[stressed],
        stressed,
        *found[stressed].where,
        *shares[0],
        *shares[1],
    )


def _largest_strain(stress: LeafStress, material: Material) -> float:
    """Largest principal strain of a leaf; Poisson's ratio follows from the moduli and is limited to 0..0.5."""
    nu = min(max(material.E / (2 * material.G) - 1, 0.0), 0.5)
    e, g = np.abs(stress.normal_Pa) / material.E, stress.shear_Pa / material.G
    return float(np.max(0.5 * ((1 - nu) * e + np.hypot((1 + nu) * e, g))))


@cached_per_model
def unusual_values(model: Model) -> tuple[str, ...]:
    """Sentences about unusual values in the scene of a model, see `ksd.scene.plausibility`."""
    return plausibility_warnings(model.original_scene)


__all__ = ["Strength", "strength", "unusual_values"]
