"""Four numbers side by side, for compiled code that does the same to many points: one operation for all four.

Numba leaves such loops to the compiler, which takes them number by number when they are long bodies over few points. In
a ``@kernel``, `load4` gives a value that adds, subtracts, multiplies and divides like a float, with floats too;
products and sums are fused where the processor can. Arrays of such values: `ksd.numerics.fours`.
"""

from __future__ import annotations

import operator
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel.models import PrimitiveModel
from numba.core.extending import intrinsic as kernel_code
from numba.core.extending import lower_builtin, lower_cast, register_model
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature

_NUMBER, _PLACE = ir.DoubleType(), ir.IntType(32)
VECTOR = ir.VectorType(_NUMBER, 4)


class _Four(types.Type):  # type: ignore[misc]
    """Type of four floats."""

    def __init__(self) -> None:
        super().__init__(name="four")

    def can_convert_from(self, _context: Any, other: Any) -> Any:
        return Conversion.safe if isinstance(other, types.Float) else None

    def unify(self, _context: Any, other: Any) -> Any:
        return self if isinstance(other, types.Float) else None


FOUR = _Four()


@register_model(_Four)
class _FourModel(PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, VECTOR)


def spread_number(builder: Any, x: Any) -> Any:
    """x in all lanes."""
    none = ir.Constant(VECTOR, ir.Undefined)
    one = builder.insert_element(none, x, ir.Constant(_PLACE, 0))
    return builder.shuffle_vector(one, none, ir.Constant(ir.VectorType(_PLACE, 4), [0] * 4))


@lower_cast(types.Float, FOUR)
def _from_float(context: Any, builder: Any, kind: Any, _to: Any, x: Any) -> Any:
    return spread_number(builder, context.cast(builder, x, kind, types.float64))


@infer_global(operator.neg)
class _Negative(AbstractTemplate):  # type: ignore[misc]
    def generic(self, args: Any, kws: Any) -> Any:
        return signature(FOUR, FOUR) if args == (FOUR,) else None


@lower_builtin(operator.neg, FOUR)
def _negate(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
    return builder.fneg(args[0])


def _operator(symbol: Any, name: str) -> None:
    """Let `symbol` work on fours, and on a four and a float."""

    @infer_global(symbol)
    class _Typed(AbstractTemplate):  # type: ignore[misc]
        def generic(self, args: Any, kws: Any) -> Any:
            if FOUR in args and all(a is FOUR or isinstance(a, types.Float) for a in args):
                kinds = [FOUR if a is FOUR else types.float64 for a in args]
                return signature(FOUR, *kinds)
            return None

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        numbers = [
            x if kind is FOUR else spread_number(builder, x) for kind, x in zip(sig.args, args, strict=True)
        ]
        return getattr(builder, name)(*numbers, flags=("contract",))

    for kinds in ((FOUR, FOUR), (FOUR, types.float64), (types.float64, FOUR)):
        lower_builtin(symbol, *kinds)(lower)


for _symbol, _name in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
    (operator.iadd, "fadd"),
    (operator.isub, "fsub"),
    (operator.imul, "fmul"),
):
    _operator(_symbol, _name)


def _pointer(context: Any, builder: Any, kind: Any, array: Any, at: Any) -> Any:
    made = context.make_array(kind)(context, builder, array)
    return builder.gep(made.data, [at])


def _flat(array: Any) -> bool:
    return isinstance(array, types.Array) and array.ndim == 1


@kernel_code
def _load4(_: Any, array: Any, at: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        place = _pointer(context, builder, sig.args[0], *args)
        found = builder.load(builder.bitcast(place, VECTOR.as_pointer()))
        found.align = 8
        return found

    return (FOUR(array, types.int64), generate) if _flat(array) else None


@kernel_code
def _pick4(_: Any, array: Any, at: Any, step: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        found, place = ir.Constant(VECTOR, ir.Undefined), args[1]
        for k in range(4):
            number = builder.load(_pointer(context, builder, sig.args[0], args[0], place))
            found = builder.insert_element(found, number, ir.Constant(_PLACE, k))
            place = builder.add(place, args[2])
        return found

    return (FOUR(array, types.int64, types.int64), generate) if _flat(array) else None


@kernel_code
def _store4(_: Any, array: Any, at: Any, four: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        place = _pointer(context, builder, sig.args[0], args[0], args[1])
        builder.store(args[2], builder.bitcast(place, VECTOR.as_pointer())).align = 8
        return context.get_dummy_value()

    return (types.none(array, types.int64, FOUR), generate) if _flat(array) and four is FOUR else None


@kernel_code
def _put4(_: Any, array: Any, at: Any, step: Any, four: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        place = args[1]
        for k in range(4):
            number = builder.extract_element(args[3], ir.Constant(_PLACE, k))
            builder.store(number, _pointer(context, builder, sig.args[0], args[0], place))
            place = builder.add(place, args[2])
        return context.get_dummy_value()

    fits = _flat(array) and four is FOUR
    return (types.none(array, types.int64, types.int64, FOUR), generate) if fits else None


@kernel_code
def _spread(_: Any, x: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return spread_number(builder, args[0])

    return FOUR(types.float64), generate


@kernel_code
def _whole4(_: Any, x: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(VECTOR, [VECTOR])
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, "llvm.rint.v4f64"), args)

    return (FOUR(FOUR), generate) if x is FOUR else None


@kernel_code
def _where4(_: Any, x: Any, a: Any, b: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">", args[0], ir.Constant(VECTOR, [0.0] * 4)), *args[1:])

    return (FOUR(FOUR, FOUR, FOUR), generate) if x is FOUR else None


@kernel_code
def _transpose4(_: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        def mix(x: Any, y: Any, places: list[int]) -> Any:
            return builder.shuffle_vector(x, y, ir.Constant(ir.VectorType(_PLACE, 4), places))

        a, b, c, d = args
        low, high = (
            [mix(a, b, [0, 4, 2, 6]), mix(a, b, [1, 5, 3, 7])],
            [
                mix(c, d, [0, 4, 2, 6]),
                mix(c, d, [1, 5, 3, 7]),
            ],
        )
        rows = [mix(low[k], high[k], places) for places in ([0, 1, 4, 5], [2, 3, 6, 7]) for k in (0, 1)]
        return cgutils.pack_array(builder, rows)

    return (types.UniTuple(FOUR, 4)(FOUR, FOUR, FOUR, FOUR), generate) if a is FOUR else None


load4: Any = _load4
"""load4(array, at): the four numbers of a flat array from `at` on."""
pick4: Any = _pick4
"""pick4(array, at, step): four numbers of a flat array, `step` apart."""
store4: Any = _store4
"""store4(array, at, four): write four numbers of a flat array from `at` on."""
put4: Any = _put4
"""put4(array, at, step, four): write four numbers of a flat array, `step` apart, from `at` on."""
transpose4: Any = _transpose4
"""transpose4(a, b, c, d): the columns of four rows, as a tuple of four."""
whole4: Any = _whole4
"""whole4(x): the nearest whole numbers."""
where4: Any = _where4
"""where4(x, a, b): a in the lanes where x > 0, else b."""
spread: Any = _spread
"""spread(x): x four times."""
