"""Answers whose leafs have too few curvature modes say so."""

from __future__ import annotations

from dataclasses import replace

from ksd.properties.resolution import look_at_modes
from ksd.solve.configuration import Configuration, note_turn

BLIND = 0.05
"""Share of the energy of a leaf in its highest mode beyond which its curvature is not resolved at all."""
SLIGHT = 1e-3
"""Share of that mode in the energy of the whole mechanism below which it does not matter."""
MOST_ORDER = 12
"""Curvature modes about an axis that a mesh has at most, see `ksd.model.mesh.Mesh`."""
_AXIS = ("torsion", "strong bending", "weak bending")


def resolved(found: Configuration, wanted: float) -> Configuration:
    """The answer, with a warning where a leaf has more than `wanted` of its energy in its highest modes, and a doubt where
    that is much and matters."""
    share, where, axis, turned = look_at_modes(found.model, found.motion)
    note_turn(found, turned)
    if share <= wanted:
        return found
    more = "raise the orders of the mesh"
    if found.model.mesh.orders[axis] >= MOST_ORDER:
        more = "more are not possible; a chain is finer, ksd.Mesh(leaf='corotational', elements=80)"
    note = (
        f"leaf '{where}' has {100 * share:.2g} % of its energy in its highest {_AXIS[axis]} mode; "
        f"the curvature modes {found.model.mesh.orders} are few for this state: {more}"
    )
    found = replace(found, notes=(*found.notes, note))
    if share > BLIND:
        energy = found.strain_energy()
        if share * energy[where] > SLIGHT * sum(energy.values()):
            found = replace(found, doubts=(*found.doubts, note))
    return found
