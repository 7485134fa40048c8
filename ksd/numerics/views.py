"""Other shapes of an array inside a compiled kernel, without numba's `reshape`, which is a call and counts users."""

from __future__ import annotations

from typing import Any

from numba.core import cgutils, types
from numba.core.extending import intrinsic as kernel_code


def array_over(context: Any, builder: Any, kind: Any, data: Any, sizes: Any, *, width: int = 8) -> Any:
    """An array of type `kind` over `data`, of `sizes` (whole numbers of the compiled code) and entries of `width` bytes."""
    made = context.make_array(kind)(context, builder)
    whole = context.get_value_type(types.intp)
    entry = context.get_constant(types.intp, width)
    steps = [entry]
    for n in reversed(sizes[1:]):
        steps.insert(0, builder.mul(steps[0], n))
    shape, strides = (cgutils.pack_array(builder, list(row), ty=whole) for row in (sizes, steps))
    context.populate_array(made, data=data, shape=shape, strides=strides, itemsize=entry, meminfo=None)
    return made._getvalue()


@kernel_code
def _flat(_: Any, array: Any) -> Any:
    if not (isinstance(array, types.Array) and array.layout == "C"):
        return None
    kind = types.Array(array.dtype, 1, "C")

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        found = context.make_array(array)(context, builder, args[0])
        return array_over(context, builder, kind, found.data, [found.nitems])

    return kind(array), generate


@kernel_code
def _matrix_at(_: Any, array: Any, at: Any, n: Any, m: Any) -> Any:
    if not (isinstance(array, types.Array) and array.ndim == 1 and array.layout == "C"):
        return None
    kind = types.Array(array.dtype, 2, "C")

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        found = context.make_array(array)(context, builder, args[0])
        return array_over(context, builder, kind, builder.gep(found.data, [args[1]]), args[2:])

    return kind(array, *[types.int64] * 3), generate


flat: Any = _flat
"""flat(array): all numbers of a contiguous array of eight-byte numbers in a row."""
matrix_at: Any = _matrix_at
"""matrix_at(array, at, n, m): a matrix (n, m) over a flat array, from `at` on."""
