"""`ksd.model.fours` behind C entry points, so that mechanisms without chains on their bench do not compile it."""

from __future__ import annotations

from ksd.model.blank import blank_system
from ksd.model.fours import move_of_four, take_four
from ksd.numerics.held import Kind, found_at
from ksd.numerics.kernel import carray, late

_SYSTEM = Kind(blank_system())


@late("void(int64, float64, int64, CPointer(float64), CPointer(float64))")
def condense_four(address, factor, i, found, told):
    """`take_four` on the `System` at `address`; found (4, 13, 12), told (4,)."""
    s = found_at(address, _SYSTEM)
    take_four(
        s.arrays.members, s.motion.x, s.motion.R, s.motion.inner, s.work, factor, i, carray(found, (4, 13, 12)),
        carray(told, (4,)),
    )  # fmt: skip


@late("void(int64, int64, CPointer(float64), float64)")
def move_four(address, i, xi, scale):
    """`move_of_four` on the `System` at `address`; xi (6,)."""
    s = found_at(address, _SYSTEM)
    move_of_four(s.arrays.members, s.motion.inner, s.work, i, carray(xi, (6,)), scale)
