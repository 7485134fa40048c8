"""Many arrays handed to compiled code as one: what a call costs no longer grows with their number.

Numba unpacks every array of an argument at every call, about 0.15 us each, 30 us for the two hundred of a mechanism.
`Held` looks them up once and keeps them alive; `part` gives one back inside compiled code. `address_of` and `found_at`
hand a named tuple from one compiled function to another that was compiled apart (`ksd.numerics.kernel.late`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import typeof, types
from numba.core import cgutils
from numba.core.imputils import lower_constant
from numba.extending import NativeValue, intrinsic, models, register_model, typeof_impl, unbox
from numba.np.arrayobj import make_array, populate_array


class Held:
    """Nested named tuples of arrays and numbers, held for compiled code; the arrays must not be replaced afterwards."""

    def __init__(self, parts: Any) -> None:
        self.parts = parts
        words: list[int] = []
        made: list[Any] = []
        _collect(parts, words, made)
        self.table = np.array(words, np.int64)
        self.address = int(self.table.ctypes.data)
        kind = tuple(made)
        if kind not in _TYPES:
            _TYPES[kind] = HeldType(typeof(parts))
        self._numba_type_ = _TYPES[kind]


_TYPES: dict[tuple[Any, ...], HeldType] = {}
"""Types by what they are made of: numba takes 10 ms to find that of a mechanism."""


def _collect(part: Any, words: list[int], made: list[Any]) -> None:
    """Addresses and shapes of arrays, bits of numbers, in the order of the fields; and what tells their types."""
    if isinstance(part, tuple):
        made += [type(part), len(part)]
        for field in part:
            _collect(field, words, made)
    elif isinstance(part, np.ndarray):
        if not part.flags.c_contiguous or part.dtype not in (np.dtype(np.float64), np.dtype(np.int64)):
            raise TypeError(f"only contiguous arrays of float64 and int64 can be held, not {part.dtype}")
        words += [int(part.ctypes.data), *part.shape]
        made += [part.dtype.char, part.ndim, part.flags.writeable, part.flags.aligned]
    elif isinstance(part, float):
        words.append(int(np.float64(part).view(np.int64)))
        made.append(float)
    else:
        words.append(int(part))
        made.append(type(part))


class HeldType(types.Type):
    """Numba's type of `Held`; inner: that of the named tuple it holds."""

    def __init__(self, inner: Any) -> None:
        self.inner = inner
        super().__init__(name=f"Held({inner.name})")


@typeof_impl.register(Held)
def _typeof(value: Held, _context: Any) -> HeldType:
    return value._numba_type_


@register_model(HeldType)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: HeldType) -> None:
        super().__init__(manager, kind, ir.IntType(64))


@unbox(HeldType)
def _unbox(_kind: HeldType, value: Any, c: Any) -> NativeValue:
    address = c.pyapi.object_getattr_string(value, "address")
    number = c.pyapi.long_as_longlong(address)
    c.pyapi.decref(address)
    return NativeValue(number, is_error=cgutils.is_not_null(c.builder, c.pyapi.err_occurred()))


def _words(kind: Any) -> int:
    """How many words of the table a value of type `kind` takes."""
    if isinstance(kind, types.BaseTuple):
        return sum(_words(field) for field in _fields(kind))
    return 1 + kind.ndim if isinstance(kind, types.Array) else 1


def _part(_context, held, path):
    """One field in `held`, such as "state.theta", and nothing besides.

    A named tuple of two hundred arrays carried through a kernel as a whole takes the compiler half a minute.
    """
    if not isinstance(path, types.StringLiteral):
        return None
    kind, skip = held.inner, 0
    for name in path.literal_value.split("."):
        before = kind.fields.index(name)
        skip += sum(_words(field) for field in _fields(kind)[:before])
        kind = _fields(kind)[before]

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        table = builder.inttoptr(arguments[0], ir.IntType(64).as_pointer())
        return _build(context, builder, (table, skip), kind)[0]

    return kind(held, path), generate


part: Any = intrinsic(prefer_literal=True)(_part)


def _build(context: Any, builder: Any, place: tuple[Any, int], kind: Any) -> tuple[Any, int]:
    """The value of type `kind` from word `at` of the table on, and the next word."""
    table, at = place

    def word(k: int) -> Any:
        return builder.load(builder.gep(table, [ir.Constant(ir.IntType(32), at + k)]))

    if isinstance(kind, types.BaseTuple):
        fields = []
        for field in _fields(kind):
            value, at = _build(context, builder, (table, at), field)
            fields.append(value)
        return context.make_tuple(builder, kind, fields), at
    if isinstance(kind, types.Array):
        array = make_array(kind)(context, builder)
        size = context.get_abi_sizeof(context.get_data_type(kind.dtype))
        shape = [word(1 + k) for k in range(kind.ndim)]
        step = context.get_constant(types.intp, size)
        strides: list[Any] = []
        for length in reversed(shape):
            strides.insert(0, step)
            step = builder.mul(step, length)
        populate_array(
            array,
            data=builder.inttoptr(word(0), array.data.type),
            shape=cgutils.pack_array(builder, shape, ir.IntType(64)),
            strides=cgutils.pack_array(builder, strides, ir.IntType(64)),
            itemsize=context.get_constant(types.intp, size),
            meminfo=None,
        )
        return array._getvalue(), at + 1 + kind.ndim
    if kind == types.float64:
        return builder.bitcast(word(0), ir.DoubleType()), at + 1
    return word(0), at + 1


class Kind(Held):
    """Stands for the type of named tuples like `parts` in compiled code; holds nothing."""

    def __init__(self, parts: Any) -> None:
        self._numba_type_ = HeldType(typeof(parts))


@lower_constant(HeldType)
def _constant(_context: Any, _builder: Any, _kind: Any, _value: Any) -> Any:
    return ir.Constant(ir.IntType(64), 0)


def _address_of(_context, parts, kind):
    """Address of a named tuple's value, for as long as the calling function runs; its type must be that of `kind`."""
    if parts != kind.inner:
        # numba says that no such function is known
        return None

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.ptrtoint(cgutils.alloca_once_value(builder, arguments[0]), ir.IntType(64))

    return types.int64(parts, kind), generate


def _found_at(_context, address, kind):
    """The named tuple whose value is at `address`, of the type that `kind` stands for."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        inner = signature.return_type
        place = builder.inttoptr(arguments[0], context.get_value_type(inner).as_pointer())
        return _unowned(context, builder, inner, builder.load(place))

    return kind.inner(address, kind), generate


def _fields(kind: Any) -> list[Any]:
    """Types of the fields of a tuple type."""
    return list(kind)


def _unowned(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """`value` with arrays that do not count their users."""
    if isinstance(kind, types.BaseTuple):
        fields = [
            _unowned(context, builder, field, builder.extract_value(value, i))
            for i, field in enumerate(_fields(kind))
        ]
        return context.make_tuple(builder, kind, fields)
    if isinstance(kind, types.Array):
        array = make_array(kind)(context, builder, value=value)
        for name in ("meminfo", "parent"):
            setattr(array, name, cgutils.get_null_value(getattr(array, name).type))
        return array._getvalue()
    return value


address_of: Any = intrinsic(_address_of)
found_at: Any = intrinsic(_found_at)
