"""Kernels that own no array: compiled without the counting of users, half the code of a kernel that takes a mechanism.

Numba counts the users of every array that a variable holds, also of the two hundred in the named tuple of a mechanism,
wherever such a variable is set or left. A kernel that only works on arrays of its caller can do without: they outlive it.
"""

from __future__ import annotations

from typing import Any

from numba import types
from numba.core import ir
from numba.core.runtime.context import NRTContext

_LENT = {
    "_vector", "_matrix", "_counts", "_part", "_found_at", "_address_of", "carray",
}  # fmt: skip
"""Names of functions whose arrays belong to somebody else."""
_VIEWS = {"static_getitem", "getattr", "cast", "phi", "build_tuple", "exhaust_iter"}
"""Expressions, by numba's names, that make no new array of arrays."""
_PLAIN = types.Number, types.NoneType, types.Boolean, types.RangeType, types.SliceType, types.NumberClass


class _Uncounted(NRTContext):  # type: ignore[misc]
    """Numba's code generator for memory, which lets users come and go."""

    def incref(self, builder: Any, typ: Any, value: Any) -> None:
        """Nothing to count."""

    def decref(self, builder: Any, typ: Any, value: Any) -> None:
        """Nothing to count."""


def uncounted(context: Any) -> Any:
    """The target `context` without counting."""
    # what it compiles for itself must not get into kernels that do count
    return context.subtarget(nrt=_Uncounted(context, True), cached_internal_func={})


def borrows(state: Any) -> bool:
    """Whether every array in the typed function of a compiler's `state` is its caller's, or on the stack."""
    if _has_arrays(state.return_type):
        return False
    kinds = state.typemap
    for block in state.func_ir.blocks.values():
        for stmt in block.body:
            if isinstance(stmt, (ir.SetItem, ir.StaticSetItem)) and _has_arrays(kinds[stmt.value.name]):
                return False
            if not isinstance(stmt, ir.Assign) or not isinstance(stmt.value, ir.Expr):
                continue
            made, expression = kinds[stmt.target.name], stmt.value
            if expression.op == "call":
                if not _call_borrows(kinds[expression.func.name], made):
                    return False
            elif _has_arrays(made) and not _is_view(expression, kinds):
                return False
    return True


def _call_borrows(function: Any, made: Any) -> bool:
    """Whether a call of `function` that gives `made` takes and leaves no array."""
    if isinstance(function, (types.NamedTupleClass, types.ExternalFunction)):
        return True
    key = getattr(function, "typing_key", function)
    module, name = (str(getattr(key, word, "")) for word in ("__module__", "__name__"))
    if name in _LENT:
        return True
    if isinstance(function, types.Dispatcher) or module.startswith("ksd."):
        return not _has_arrays(made)
    return _is_plain(made) and (isinstance(function, types.NumberClass) or module in ("builtins", "math"))


def _is_view(expression: Any, kinds: Any) -> bool:
    """Whether the arrays of the expression are there already: an index that is an array makes a new one."""
    if expression.op == "getitem":
        return not _has_arrays(kinds[expression.index.name])
    return expression.op in _VIEWS


def _is_plain(kind: Any) -> bool:
    if isinstance(kind, types.BaseTuple):
        return all(_is_plain(field) for field in _fields(kind))
    return isinstance(kind, _PLAIN)


def _has_arrays(kind: Any) -> bool:
    if isinstance(kind, types.BaseTuple):
        return any(_has_arrays(field) for field in _fields(kind))
    return isinstance(kind, types.Buffer)


def _fields(kind: Any) -> list[Any]:
    """Types of the fields of a tuple type."""
    return list(kind)
