"""Internal stress of overconstrained layouts by misplaced ends of leaf springs.

A leaf that is overconstrained (see `ksd.answers.doctor`) is strained by a misplacement of its end; one that is exactly
constrained moves along. The change of the state is the linear response of the exact tangent, at any pose; for chains of
elements (also those that modal bodies reduce) it is a Newton step after a small part of the misplacement.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ksd.answers.centrelines import leaf_members, member_ends
from ksd.answers.forces import SectionForces, section_forces
from ksd.answers.leaf_groups import LeafFlexibility, inner_unknowns, leaf_flexibilities, leaf_groups
from ksd.answers.printing import PrintableAnswer
from ksd.answers.stress import stress_from_forces
from ksd.answers.tangent import Tangent, assemble_and_factor, exact_tangent_arrays, row_values
from ksd.checks import positive, show
from ksd.errors import SceneError
from ksd.model.arrays import State, make_workspace
from ksd.model.compile import Model
from ksd.model.newton import take_newton_step

Array = NDArray[np.float64]
DIRECTIONS = ("along", "across", "sideways", "twist", "tilt", "yaw")
"""Misplacement of a leaf's end in its axes at that end: along e1, e2 (thickness), e3 (width); about e1, e3 and e2."""


class _Misplacements(dict[tuple[str, str], Any]):
    """Values by (leaf, direction); raises SceneError for an unknown key."""

    def __missing__(self, key: object) -> Any:
        leaves = ", ".join(f"'{name}'" for name in dict.fromkeys(leaf for leaf, _ in self))
        raise SceneError(
            f"there is no misplacement {show(key)}: give a leaf, of {leaves}, and a direction, of {', '.join(DIRECTIONS)}, "
            f"such as {next(iter(self))}"
        )


@dataclass(frozen=True, repr=False)
class Misplaced(PrintableAnswer):
    """Effect of misplaced leaf ends.

    offset [m], rotation [rad]: the misplacements. stress_Pa: largest von Mises stress of the change anywhere, by (leaf,
    direction); worst_leaf: the leaf in which it occurs.
    """

    offset: float
    rotation: float
    stress_Pa: dict[tuple[str, str], float]
    worst_leaf: dict[tuple[str, str], str]

    @property
    def worst(self) -> tuple[str, str]:
        """The (leaf, direction) whose misplacement causes the largest stress."""
        return max(self.stress_Pa, key=self.stress_Pa.__getitem__)

    @property
    def largest_Pa(self) -> float:
        """Largest internal stress by a single misplacement."""
        return self.stress_Pa[self.worst]

    def _line(self) -> str:
        return str(self)

    def __str__(self) -> str:
        leaf, direction = self.worst
        size = (
            f"{1e6 * self.offset:g} um"
            if DIRECTIONS.index(direction) < 3
            else f"{1e3 * self.rotation:g} mrad"
        )
        return (
            f"worst misplacement: the end of '{leaf}' by {size} ({direction}): {1e-6 * self.largest_Pa:.4g} MPa of internal "
            f"stress in '{self.worst_leaf[self.worst]}'"
        )


def internal_stress(
    model: Model,
    motion: State,
    *,
    offset: float = 1e-5,
    rotation: float = 1e-4,
    leaves: Iterable[str] = (),
    load_factor: float = 1.0,
    points: int = 13,
) -> Misplaced:
    """Internal stress by a misplaced end of a leaf, one leaf and direction at a time.

    offset [m], rotation [rad]: misplacement of the end in the axes of the leaf there, see DIRECTIONS (`fit` takes those at
    the start); results are linear in both.
    leaves: full names, all where empty. Raises SceneError for unknown names or misplacements that are not positive.
    """
    names = leaf_members(model)
    requested = tuple(leaves) or tuple(names)
    for name in requested:
        if name not in names:
            raise SceneError(
                f"leaf {show(name)} is not part of this mechanism; its leaf springs are {', '.join(names)}"
            )
    offset, rotation = positive(offset, "offset", unit="m"), positive(rotation, "rotation", unit="rad")
    forces = (_strain_mode_change if model.has_strain_leaves_only else _chain_change)(
        model, motion, load_factor, points
    )
    largest, worst_leaf = _Misplacements(), _Misplacements()
    for name in requested:
        for k, direction in enumerate(DIRECTIONS):
            misplaced = np.zeros(6)
            misplaced[(0, 1, 2, 3, 5, 4)[k]] = offset if k < 3 else rotation
            extra = stress_from_forces(model, forces(names[name][-1], misplaced))
            largest[name, direction], worst_leaf[name, direction] = extra.largest_Pa, extra.where[0]
    return Misplaced(offset, rotation, largest, worst_leaf)


Change = Callable[[int, Array], dict[str, SectionForces]]
"""Function that returns the change of the section forces by a misplacement (6,) of end q of a member, in its axes."""


def _strain_mode_change(model: Model, motion: State, load_factor: float, points: int) -> Change:
    """`Change` for strain-mode leaves."""
    options: dict[str, Any] = {"points": points, "load_factor": load_factor}
    tangent = assemble_and_factor(model, motion, load_factor=load_factor)
    flexible = leaf_flexibilities(model, motion, load_factor=load_factor)
    before = section_forces(model, motion, **options)

    def change(member: int, misplaced: Array) -> dict[str, SectionForces]:
        after = section_forces(
            model, _state_after_misplacement(tangent, flexible, member, misplaced), **options
        )
        return {n: replace(f, values=f.values - before[n].values) for n, f in after.items()}

    return change


CHAIN_STEP = 1e-3
"""Step of the central difference for chains, relative to the misplacement.

The error by curvature is 1e-8 of the result. Smaller steps suffer from rounding: a one-sided 1e-4 has an error of 1e-5 of
the result that differs between processors.
"""


def _chain_change(model: Model, motion: State, load_factor: float, points: int) -> Change:
    """`Change` for chains."""
    arrays, options = exact_tangent_arrays(model), {"points": points, "load_factor": load_factor}
    target = row_values(model, motion)

    def forces(member: int, misplaced: Array) -> dict[str, SectionForces]:
        moved = arrays.copy()
        offset, frame = moved.members.offset, moved.members.frame
        offset[member, 1] += frame[member, 1] @ misplaced[:3]
        frame[member, 1] = frame[member, 1] @ Rotation.from_rotvec(misplaced[3:]).as_matrix()
        state = motion.copy()
        take_newton_step(moved, state, target, load_factor, make_workspace(moved))
        return section_forces(replace(model, arrays=moved), state, **options)  # type: ignore[arg-type]

    # the step to the equilibrium of the chains, where the state is not quite one, cancels in the difference
    def change(member: int, misplaced: Array) -> dict[str, SectionForces]:
        forward, backward = forces(member, CHAIN_STEP * misplaced), forces(member, -CHAIN_STEP * misplaced)
        return {
            n: replace(f, values=(f.values - backward[n].values) / (2 * CHAIN_STEP))
            for n, f in forward.items()
        }

    return change


def _state_after_misplacement(
    tangent: Tangent, flexible: list[LeafFlexibility], member: int, misplaced: Array
) -> State:
    """State with the linear response of the leaf springs to end q of `member` moved (6,) in its axes.

    The nodes of the returned state are not moved.
    """
    model, motion = tangent.model, tangent.motion
    loads = np.zeros(model.arrays.plan.unknowns + 1)
    R = member_ends(model, motion, member).Q
    moved = []
    for group, leaf, unknowns in zip(leaf_groups(model), flexible, inner_unknowns(model), strict=True):
        # xi in frame p is the misplacement in the axes of q at this state
        xi = np.zeros((len(group.members), 6))
        xi[group.members == member] = np.concatenate([R @ misplaced[:3], R @ misplaced[3:]])
        pull = leaf.relative.swapaxes(1, 2) @ (leaf.ends @ xi[..., None])
        at = np.where(unknowns[:, :12] < 0, len(loads) - 1, unknowns[:, :12])
        np.add.at(loads, at, -pull[..., 0])
        moved.append((group, leaf, at, xi))
    nodes = np.append(tangent.solve(loads[:-1, None])[:, 0], 0.0)
    state = motion.copy()
    for group, leaf, at, xi in moved:
        total = xi + (leaf.relative @ nodes[at][..., None])[..., 0]
        bent, wrench = (leaf.P @ total[..., None])[..., 0], (leaf.ends @ total[..., None])[..., 0]
        state.inner[group.inner_index] += np.hstack([bent, wrench])
    return state
