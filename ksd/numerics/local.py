"""Small arrays of fixed size on the stack of a compiled kernel: scratch that is never allocated.

``np.empty`` inside a ``@kernel`` costs a heap allocation per call; these cost nothing and may end up in registers. The
sizes must be literal numbers, the contents are not cleared, and the array must not outlive the call that made it: pass
it down, never return or store it. Arrays whose size depends on the model belong in prepared storage
(`ksd.model.arrays.Work`).
"""

from __future__ import annotations

import math
from typing import Any

from numba.core import cgutils, types
from numba.core.extending import intrinsic


def _on_stack(dtype: Any, *sizes: Any) -> Any:
    """Signature and code generator of an array of literal `sizes`, or None for sizes that are not literal."""
    if not all(isinstance(n, types.IntegerLiteral) for n in sizes):
        return None
    shape = [n.literal_value for n in sizes]
    kind = types.Array(dtype, len(shape), "C")

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        # in the entry block, so that a loop around it uses the same place again
        data = cgutils.alloca_once(builder, context.get_data_type(dtype), size=math.prod(shape))
        whole = context.get_value_type(types.intp)
        steps = [8 * math.prod(shape[k + 1 :]) for k in range(len(shape))]
        made = context.make_array(kind)(context, builder)
        numbers = [
            cgutils.pack_array(builder, [context.get_constant(types.intp, n) for n in row], ty=whole)
            for row in (shape, steps)
        ]
        size = context.get_constant(types.intp, 8)
        context.populate_array(
            made, data=data, shape=numbers[0], strides=numbers[1], itemsize=size, meminfo=None
        )
        return made._getvalue()

    return kind(*sizes), generate


@intrinsic(prefer_literal=True)
def _vector(_: Any, n: Any) -> Any:
    return _on_stack(types.float64, n)


@intrinsic(prefer_literal=True)
def _matrix(_: Any, n: Any, m: Any) -> Any:
    return _on_stack(types.float64, n, m)


@intrinsic(prefer_literal=True)
def _counts(_: Any, n: Any) -> Any:
    return _on_stack(types.int64, n)


local_vector: Any = _vector
"""local_vector(n): an array (n,) of floats."""
local_matrix: Any = _matrix
"""local_matrix(n, m): an array (n, m) of floats."""
local_counts: Any = _counts
"""local_counts(n): an array (n,) of whole numbers (int64)."""
