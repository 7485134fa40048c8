"""The answer of the five steps beside that of load steps, where loads do much of the work.

The five steps start from the unloaded kinematic state, near which a heavily loaded mechanism may have several minima. The
one meant is that of the loads put on gradually. Where loads do much of the work and an equilibrium step did not come in
easily (`ksd.solve.confirm.laden`), load steps are walked and the two states compared.
"""

from __future__ import annotations

from collections.abc import Callable

from ksd.errors import ConvergenceError
from ksd.solve.configuration import Configuration
from ksd.solve.confirm import difference, laden

EXACT, NEAR = 1e-5, 0.02
"""Largest difference (of positions over the size, of rotations as they are) of equal states: exact, or reduced."""


def needs_walk(found: Configuration) -> bool:
    """Whether an answer of the five steps is compared with load steps."""
    if found.method not in ("reduced", "full"):
        return False
    longest = max((s.iterations for s in found.steps if s.name[0] in "35"), default=0)
    return laden(found.model, found.motion, found.model.targets(found.targets), longest)


def beside(found: Configuration, walk: Callable[[], Configuration]) -> tuple[str, Configuration | None]:
    """What load steps say against `found`, nothing if they end in the same state; and their answer where it is trusted."""
    try:
        other = walk()
    except ConvergenceError as reason:
        return f"loads do much of the work, and load steps do not confirm it: {reason}", None
    if not other.trusted:
        return f"loads do much of the work, and load steps do not confirm it: {other.trust.trusted}", None
    far = difference(found.model, found.motion, other.motion)
    error, size = found.error, found.model.arrays.size
    own = 0.0 if error is None else 3.0 * max(error.displacement / size, error.rotation)
    if far <= (EXACT if error is None else max(NEAR, own)):
        return "", other
    energy, theirs = (sum(c.strain_energy().values()) for c in (found, other))
    return (
        f"loads do much of the work, and load steps end in another minimum (strain energy {theirs:.4g} J, here "
        f"{energy:.4g} J)"
    ), other
