"""The answer of the five steps beside that of load steps, where loads do much of the work.

The five steps start from the unloaded kinematic state, near which a heavily loaded mechanism may have several minima. The
one meant is that of the loads put on gradually. Where loads do much of the work and an equilibrium step did not come in
easily (`ksd.solve.load_steps.laden`), load steps are walked and the two states compared.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ksd.errors import ConvergenceError
from ksd.model.arrays import carries_load
from ksd.solve.configuration import Configuration
from ksd.solve.load_steps import difference, laden
from ksd.solve.steps import ErrorEstimate
from ksd.solve.trust import solved_well

EXACT, NEAR = 1e-5, 0.02
"""Largest difference (of positions over the size, of rotations as they are) of equal states: exact, or reduced."""


def needs_walk(found: Configuration) -> bool:
    """Whether an answer of the five steps is compared with load steps."""
    if found.method not in ("reduced", "full") or not carries_load(found.model.arrays):
        return False
    longest = max((s.iterations for s in found.steps if s.name[0] in "35"), default=0)
    return laden(found.model, found.motion, found.model.targets(found.targets), longest)


def beside(found: Configuration, walk: Callable[[], Configuration]) -> tuple[str, Configuration | None]:
    """What load steps say against `found`, nothing if they end in the same state; and their answer where it is trusted."""
    try:
        other = walk()
    except ConvergenceError as reason:
        return f"loads do much of the work, and load steps do not confirm it: {reason}", None
    verdict = solved_well(other)
    if not verdict:
        return f"loads do much of the work, and load steps do not confirm it: {verdict}", None
    far = difference(found.model, found.motion, other.motion)
    error, size = found.method_error, found.model.arrays.size
    own = 0.0 if error is None else 3.0 * max(error.displacement / size, error.rotation)
    own = own if own < math.inf else 0.0
    if far <= (EXACT if error is None else max(NEAR, own)):
        return "", other
    energy, theirs = (sum(c.strain_energy().values()) for c in (found, other))
    return (
        f"loads do much of the work, and load steps end in another minimum (strain energy {theirs:.4g} J, here "
        f"{energy:.4g} J)"
    ), other


def measured(found: Configuration, other: Configuration | None) -> ErrorEstimate | None:
    """The error of a fast answer: its distance to the exact state `other` where there is one, else its estimate."""
    error = found.method_error
    if error is None or other is None:
        return error
    links, drives = found.model.links, len(found.model.drive_names)
    one, exact = found.motion, other.motion
    force = np.abs(one.multiplier - exact.multiplier)[:drives]
    shift = float(np.linalg.norm((one.x - exact.x)[:links], axis=1).max())
    turn = max(float(np.linalg.norm(found.rotation(k) - other.rotation(k))) for k in found.links)
    moved = float(np.abs(exact.x - found.model.rest.x)[:links].max())
    largest = max(float(np.abs(exact.multiplier[:drives]).max(initial=0.0)), 1e-300)
    relative = max(float(force.max(initial=0.0)) / largest, shift / max(moved, 1e-300))
    return ErrorEstimate(force, shift, turn, relative)
