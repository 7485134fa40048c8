"""Kernels that work on one leaf or on four at a time, as the type of their arrays says.

An array of fours (`ksd.numerics.lanes`) is a view of floats, number by number of all four: entry k of leaf j is float
4 k + j. A ``@kernel`` that only adds, multiplies, divides and stores numbers takes arrays of either kind as it is. For
what else it needs, the functions here take a float or a four; where it has to decide, it decides for all four.
"""

from __future__ import annotations

import math
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.extending import intrinsic as kernel_code

from ksd.numerics.lanes import FOUR, VECTOR
from ksd.numerics.views import array_over

_FLOAT, _WHOLE = types.float64, types.int64


def _kind(*found: Any) -> Any:
    """The type that numbers of these types have in common, or None where one is no number."""
    if not all(k is FOUR or isinstance(k, types.Float) for k in found):
        return None
    return FOUR if FOUR in found else _FLOAT


def _bits(builder: Any, found: Any) -> Any:
    """The truth values of a comparison as a whole number, a bit each."""
    if isinstance(found.type, ir.VectorType):
        found = builder.bitcast(found, ir.IntType(4))
    return builder.zext(found, ir.IntType(64))


def _any(builder: Any, found: Any) -> Any:
    return builder.icmp_unsigned("!=", _bits(builder, found), ir.Constant(ir.IntType(64), 0))


def _named(builder: Any, name: str, kind: Any, *args: Any) -> Any:
    """A call of the compiler's own function `name` of numbers of a type."""
    vector = kind is FOUR
    value = VECTOR if vector else ir.DoubleType()
    symbol = f"llvm.{name}.{'v4f64' if vector else 'f64'}"
    made = ir.FunctionType(value, [value] * len(args))
    return builder.call(cgutils.get_or_insert_function(builder.module, made, symbol), args)


@kernel_code
def _root(_: Any, x: Any) -> Any:
    kind = _kind(x)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _named(builder, "sqrt", kind, *args)

    return kind and (kind(kind), generate)


@kernel_code
def _larger(_: Any, a: Any, b: Any) -> Any:
    kind = _kind(a, b)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">", args[1], args[0]), args[1], args[0])

    return kind and (kind(kind, kind), generate)


@kernel_code
def _above(_: Any, a: Any, b: Any) -> Any:
    kind = _kind(a, b)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _any(builder, builder.fcmp_unordered(">", *args))

    return kind and (types.boolean(kind, kind), generate)


@kernel_code
def _vanishes(_: Any, x: Any, least: Any) -> Any:
    kind = _kind(x, least)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        found, bound = (_named(builder, "fabs", kind, a) for a in args)
        return _any(builder, builder.fcmp_unordered("<=", found, bound))

    return kind and (types.boolean(kind, kind), generate)


@kernel_code
def _below_zero(_: Any, x: Any) -> Any:
    kind = _kind(x)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        zero = ir.Constant(args[0].type, [0.0] * 4 if kind is FOUR else 0.0)
        found = _bits(builder, builder.fcmp_ordered("<", args[0], zero))
        made = ir.FunctionType(ir.IntType(64), [ir.IntType(64)])
        return builder.call(cgutils.get_or_insert_function(builder.module, made, "llvm.ctpop.i64"), [found])

    return kind and (_WHOLE(kind), generate)


def _of(dtype: Any, dimensions: int) -> Any:
    # floats may begin anywhere: the compiler is not to count on the alignment of a whole vector
    return types.Array(dtype, dimensions, "C", aligned=dtype is not FOUR)


def _view(array: Any, sizes: int) -> Any:
    if not (isinstance(array, types.Array) and array.ndim == 1 and array.dtype is _FLOAT):
        return None
    kind = _of(FOUR, sizes)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        found = context.make_array(sig.args[0])(context, builder, args[0])
        data = builder.bitcast(builder.gep(found.data, [args[1]]), VECTOR.as_pointer())
        return array_over(context, builder, kind, data, args[2:], width=32)

    return kind(array, _WHOLE, *[_WHOLE] * sizes), generate


@kernel_code
def _fours(_: Any, array: Any, at: Any, n: Any) -> Any:
    return _view(array, 1)


@kernel_code
def _four_matrix(_: Any, array: Any, at: Any, n: Any, m: Any) -> Any:
    return _view(array, 2)


def _on_stack(example: Any, *sizes: Any) -> Any:
    if not all(isinstance(n, types.IntegerLiteral) for n in sizes):
        return None
    kind = _of(example.dtype, len(sizes))
    shape = [n.literal_value for n in sizes]

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = cgutils.alloca_once(builder, context.get_data_type(kind.dtype), size=math.prod(shape))
        whole = [context.get_constant(types.intp, n) for n in shape]
        width = 32 if kind.dtype is FOUR else 8
        return array_over(context, builder, kind, data, whole, width=width)

    return kind(example, *sizes), generate


@kernel_code(prefer_literal=True)
def _vector_like(_: Any, example: Any, n: Any) -> Any:
    return _on_stack(example, n)


@kernel_code(prefer_literal=True)
def _matrix_like(_: Any, example: Any, n: Any, m: Any) -> Any:
    return _on_stack(example, n, m)


@kernel_code
def _number_like(_: Any, example: Any, x: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return context.cast(builder, args[1], _FLOAT, sig.return_type)

    return example.dtype(example, _FLOAT), generate


root: Any = _root
"""root(x): square root."""
larger: Any = _larger
"""larger(a, b): the larger one, of each."""
above: Any = _above
"""above(a, b): whether any a is above its b, or not a number."""
vanishes: Any = _vanishes
"""vanishes(x, least): whether any |x| is not above its |least|."""
below_zero: Any = _below_zero
"""below_zero(x): how many are."""
fours: Any = _fours
"""fours(array, at, n): n fours of a flat array of floats, from `at` on."""
four_matrix: Any = _four_matrix
"""four_matrix(array, at, n, m): the same as a matrix (n, m)."""
vector_like: Any = _vector_like
"""vector_like(example, n): a vector (n,) on the stack (`ksd.numerics.local`), of floats or fours as `example`."""
matrix_like: Any = _matrix_like
"""matrix_like(example, n, m): a matrix (n, m) on the stack, of floats or fours as `example`."""
number_like: Any = _number_like
"""number_like(example, x): the float x as an entry of `example`."""
