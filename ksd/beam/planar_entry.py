"""C entry points of the planar leaf kernels, as `ksd.beam.entry` has for the spatial ones.

`size` holds the lengths of value, inner and store; `out` (4,) receives negative pivots, error force [N], error moment
[Nm], status; see `ksd.beam.planar_strain` and `ksd.beam.planar_corotational` for the meaning.
"""

from __future__ import annotations

from ksd.beam import planar_across, planar_corotational, planar_near, planar_strain
from ksd.beam.strain_values import DEFAULT_ORDERS, DEFAULT_POINTS
from ksd.numerics.kernel import carray, late

DEFAULT = (DEFAULT_ORDERS[2], DEFAULT_POINTS)
"""Modes and points for which the compiler has a planar leaf of its own."""
LENGTHS = planar_strain.sizes(DEFAULT[0])
"""Lengths of its inner state and store."""
_P = "CPointer(float64)"
_I = "CPointer(int64)"
_CONDENSE = f"void({_P}, {_I}, {_P}, {_P}, {_P}, {_P}, {_P}, {_P}, {_I})"
_RECOVER = f"void({_P}, {_I}, {_P}, {_P}, {_P}, float64, {_I})"


@late(_CONDENSE)
def planar_strain_condense(value, number, inner, store, pose, lam, K, out, size):
    """Force, moment and tangent of a planar strain-mode leaf."""
    back, force, moment, status = planar_strain.condense(
        carray(value, (size[0],)), carray(number, (4,)), carray(inner, (size[1],)), carray(store, (size[2],)),
        carray(pose, (3,)), carray(lam, (6,)), carray(K, (3, 3)),
    )  # fmt: skip
    out[0], out[1], out[2], out[3] = back, force, moment, status


@late(_CONDENSE)
def planar_strain_condense_default(value, number, inner, store, pose, lam, K, out, size):
    """The same for a leaf without weight of the default modes and points, which the compiler knows."""
    back, force, moment, status = planar_strain.condense(
        carray(value, (size[0],)), DEFAULT, carray(inner, (LENGTHS[0],)), carray(store, (LENGTHS[1],)),
        carray(pose, (3,)), carray(lam, (6,)), carray(K, (3, 3)),
    )  # fmt: skip
    out[0], out[1], out[2], out[3] = back, force, moment, status


@late(_RECOVER)
def planar_strain_recover(value, number, inner, store, xi, scale, size):
    """Inner update of a planar strain-mode leaf."""
    planar_strain.recover(
        carray(value, (size[0],)), carray(number, (4,)), carray(inner, (size[1],)), carray(store, (size[2],)),
        carray(xi, (3,)), scale,
    )  # fmt: skip


@late(_CONDENSE)
def planar_chain_condense(value, number, inner, store, pose, lam, K, out, size):
    """Force, moment and tangent of a planar chain."""
    back, force, moment, status = planar_corotational.condense(
        carray(value, (size[0],)), carray(number, (4,)), carray(inner, (size[1],)), carray(store, (size[2],)),
        carray(pose, (3,)), carray(lam, (6,)), carray(K, (3, 3)),
    )  # fmt: skip
    out[0], out[1], out[2], out[3] = back, force, moment, status


@late(_RECOVER)
def planar_chain_recover(value, number, inner, store, xi, scale, size):
    """Inner update of a planar chain."""
    planar_corotational.recover(
        carray(value, (size[0],)), carray(number, (4,)), carray(inner, (size[1],)), carray(store, (size[2],)),
        carray(xi, (3,)), scale,
    )  # fmt: skip


@late(f"void({_P}, {_I}, {_P}, {_P}, {_P}, {_P}, {_P}, {_P}, {_P}, {_I})")
def planar_chain_near(value, number, inner, store, near, pose, lam, K, out, size):
    """A planar chain linearised about the element orientations `near`; size[3] is the length of near."""
    back, force, moment, status = planar_near.near_condense(
        carray(value, (size[0],)), carray(number, (4,)), carray(inner, (size[1],)), carray(store, (size[2],)),
        carray(near, (size[3],)), carray(pose, (3,)), carray(lam, (6,)), carray(K, (3, 3)),
    )  # fmt: skip
    out[0], out[1], out[2], out[3] = back, force, moment, status


@late(f"void({_P}, {_I}, {_P}, float64, {_P}, {_P}, {_P}, int64, int64, int64)")
def planar_strain_across(value, number, inner, share, scratch, K, out, values, inners, room):
    """Stiffness of a strain-mode leaf across the plane, see `ksd.beam.planar_across`; out (2,): negative pivots, 1 where
    these can be told."""
    negatives, sound = planar_across.across(
        carray(value, (values,)), carray(number, (4,)), carray(inner, (inners,)), share, carray(scratch, (room,)),
        carray(K, (3, 3)),
    )  # fmt: skip
    out[0], out[1] = negatives, 1.0 if sound else 0.0
