"""Section forces of leaf springs in motion: those of statics, and the inertia of the leaf beyond every station."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ksd.answers.centrelines import cross_rows, leaf_members, strain_curves
from ksd.answers.forces import SectionForces, section_forces
from ksd.answers.leaf_groups import end_frames, leaf_groups
from ksd.answers.mass import leaf_line_mass, member_leaves
from ksd.answers.printing import NamedAnswerTable
from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.model.leaves import mass_density

Array = NDArray[np.float64]
STATIONS = 24
"""Least number of parts along a leaf over which its inertia is summed."""


def moving_section_forces(
    model: Model, states: tuple[State, State, State], step: float, *, points: int
) -> NamedAnswerTable[SectionForces]:
    """Section forces of all leaves by full name at the middle of three states `step` [s] apart.

    The force on a part of the leaf is that of d'Alembert, -mu r'', its acceleration from the three shapes.
    """
    found = section_forces(model, states[1], points=points)
    added: dict[int, tuple[Array, Array]] = {}
    stations = max(points, STATIONS + 1)
    for group in leaf_groups(model):
        lines = []
        for state in states:
            ends = end_frames(model, state, group.members)
            s, r, R = strain_curves(group.value, group.number, state.inner[group.inner_index], stations)
            lines.append(ends.start[:, None] + r @ ends.frame.swapaxes(1, 2))
            if state is states[1]:
                axes = ends.frame[:, None] @ R
        before, x, after = lines
        push = -(after - 2.0 * x + before) / step**2 * _line_masses(model, group.members, s)[..., None]
        force = _beyond(s, push)
        # about every station
        moment = _beyond(s, cross_rows(x, push)) - cross_rows(x, force)
        turned = np.concatenate([force, moment], axis=2).reshape(*x.shape[:2], 2, 3) @ axes
        added |= {i: (s[k], turned[k].reshape(-1, 6)) for k, i in enumerate(group.members.tolist())}
    for name, members in leaf_members(model).items():
        at, values = 0.0, found[name].values.copy()
        # members follow one another, each with its own stations
        starts = np.flatnonzero(np.diff(found[name].s, prepend=-1.0) <= 0.0).tolist()
        for i, part in zip(members, np.split(np.arange(len(values)), starts), strict=True):
            if i in added:
                s, more = added[i]
                for c in range(6):
                    values[part, c] += np.interp(found[name].s[part] - at, s, more[:, c])
            at = float(found[name].s[part[-1]])
        found[name] = replace(found[name], values=values)
    return found


def _line_masses(model: Model, members: NDArray[np.int64], s: Array) -> Array:
    """Mass per length (m, k) [kg/m] of members at their stations s (m, k) [m]."""
    leaves = member_leaves(model)
    found = np.empty(s.shape)
    for k, i in enumerate(members.tolist()):
        leaf, own = leaves[i]
        found[k] = mass_density(leaf) * own[:, 0].mean()
        if leaf.profile is not None:
            found[k] = mass_density(leaf) * leaf_line_mass(leaf, s[k] / s[k, -1])[:, 0]
    return found


def _beyond(s: Array, density: Array) -> Array:
    """Integrals (m, k, 3) of densities (m, k, 3) from every station to the last one, by the trapezoidal rule."""
    parts = 0.5 * (density[:, 1:] + density[:, :-1]) * np.diff(s, axis=1)[..., None]
    whole = np.zeros_like(density)
    whole[:, :-1] = np.cumsum(parts[:, ::-1], axis=1)[:, ::-1]
    return whole
