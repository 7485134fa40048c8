"""How kernels are compiled: what makes numba compile them in half the time, without changing what they do.

- A kernel for other kernels to call is lowered and simplified, but neither optimised nor assembled. Numba optimises and
  assembles every function with all it calls, and again inside every caller; with kernels ten deep that was three quarters
  of the compile time. What is only called by compiled code is optimised once, as part of what Python or a C pointer calls.
- The passes of numba that look for what no kernel has (closures, array expressions, loops over literals) are left out.
- Kernels that own no array do not count users (`ksd.numerics.borrowed`).
- What a call of a built-in function is, is found once per types of its arguments (`remembering`).

Numba's documented way to the first two is a compiler pipeline of one's own.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import numba
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder, Flags
from numba.core.compiler_machinery import register_pass
from numba.core.extending import typeof_impl
from numba.core.typed_passes import NativeLowering
from numba.core.types.functions import BaseFunction

from ksd.numerics.borrowed import borrows, uncounted


class _NoEnvironment:
    """Stands for the code generator where numba would tell assembled code its environment."""

    def set_env(self, name: str, environment: Any) -> None:
        """Nothing is assembled, so there is nobody to tell."""


class _Unassembled(JITCodeLibrary):  # type: ignore[misc]
    """Code to be linked into callers."""

    @property
    def codegen(self) -> Any:
        return _NoEnvironment() if self._finalized else self._codegen

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout
        passes, builder = self._codegen._function_pass_manager()
        for function in ll_module.functions:
            if not function.is_declaration:
                passes.run(function, builder)

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """0: no such code. Also what closes the library, as in numba."""
        self._ensure_finalized()
        return 0


@register_pass(mutates_CFG=True, analysis_only=False)
class _Lowering(NativeLowering):  # type: ignore[misc]
    """Numba's lowering into a library that is not assembled."""

    _name = "ksd_lowering"

    def run_pass(self, state: Any) -> bool:
        _count_no_borrower(state)
        state.library = _Unassembled(state.targetctx.codegen(), state.func_id.func_qualname)
        return bool(super().run_pass(state))


@register_pass(mutates_CFG=True, analysis_only=False)
class _EntryLowering(NativeLowering):  # type: ignore[misc]
    """Numba's lowering of what Python or a C pointer calls."""

    _name = "ksd_entry_lowering"

    def run_pass(self, state: Any) -> bool:
        # what Python calls counts the arrays that it is given
        if state.flags.no_cpython_wrapper:
            _count_no_borrower(state)
        return bool(super().run_pass(state))


def _count_no_borrower(state: Any) -> None:
    """Leave the counting of users out of a kernel that owns no array."""
    if borrows(state):
        state.targetctx = uncounted(state.targetctx)


class _Flags(Flags):  # type: ignore[misc]
    """Numba's compiler flags, compared by what is set: it compares all of them whenever it types a call."""

    __slots__ = ()

    def __hash__(self) -> int:
        return _HASH

    def __eq__(self, other: object) -> bool:
        if isinstance(other, Flags) and self._values == other._values:
            return True
        return bool(super().__eq__(other))


_HASH = hash(Flags())
"""Numba hashes the names of the flags, which all flags share."""


_NOT_NEEDED = {
    "with_lifting",
    "inline_closure_likes",
    "make_function_op_code_to_jit_function",
    "find_literally",
    "literal_unroll",
    "LiteralPropagation",
    "inline_overloads",
    "nopython_rewrites",
    "dump_parfor_diagnostics",
}
"""Passes, by numba's names, that find nothing to do in a kernel: they cost a tenth of the time."""


class Outside(CompilerBase):  # type: ignore[misc]
    """Numba's passes as far as kernels need them, with our flags."""

    def __init__(self, *given: Any) -> None:
        # typing and target contexts, library, argument and return types, then the flags
        super().__init__(*given[:5], _Flags(given[5]), *given[6:])  # type: ignore[call-arg]

    def define_pipelines(self) -> list[Any]:
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.passes = [
            (_EntryLowering if found is NativeLowering else found, words)
            for found, words in passes.passes
            if found.name() not in _NOT_NEEDED
        ]
        passes.finalize()
        return [passes]

    def compile_extra(self, function: Any) -> Any:
        """As numba, under its lock, with calls remembered."""
        with remembering():
            return super().compile_extra(function)


class _Within(Outside):
    """The same with our lowering."""

    def define_pipelines(self) -> list[Any]:
        (passes,) = super().define_pipelines()
        passes.passes = [
            (_Lowering if found is _EntryLowering else found, words) for found, words in passes.passes
        ]
        passes.finalize()
        return [passes]


def within(function: Any, settings: dict[str, Any]) -> Any:
    """The compiled function for callers that are compiled themselves."""
    plain = {**settings, "cache": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return numba.njit(pipeline_class=_Within, **plain)(function)


def answers_as(kind: type) -> None:
    """Let compiled code that names an object of class `kind` call its attribute `within`."""

    @typeof_impl.register(kind)
    def found(value: Any, _context: Any) -> Any:
        return numba.types.Dispatcher(value.within)


_NAME = "get_call_type"
_find_call: Any = getattr(BaseFunction, _NAME)
_FOUND: dict[tuple[Any, ...], tuple[Any, Any]] = {}
"""What numba found, by function type and types of the arguments; with the function type, so that it stays alive."""


def _find_call_once(function: Any, context: Any, arguments: Any, named: Any) -> Any:
    """As `_find_call`, which tries a dozen templates, one by one, for every `a * b`."""
    if named:
        return _find_call(function, context, arguments, named)
    key = id(function), id(context), tuple(arguments)
    found = _FOUND.get(key)
    if found is None:
        found = _FOUND[key] = _find_call(function, context, arguments, named), function
    return found[0]


@contextlib.contextmanager
def remembering() -> Iterator[None]:
    """Find once, inside, what a call of a built-in is; what else the process compiles with numba is left alone."""
    before = getattr(BaseFunction, _NAME)
    setattr(BaseFunction, _NAME, _find_call_once)
    try:
        yield
    finally:
        setattr(BaseFunction, _NAME, before)
