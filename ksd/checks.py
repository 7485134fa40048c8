"""Checks of numbers a user gives: each returns a clean value or raises SceneError with one sentence.

`what` names the parameter ("thickness"), `owner` the thing it belongs to ("CrossFlexure"), `unit` its SI
unit.
"""

from __future__ import annotations

import difflib
import inspect
import math
import os
import re
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import lru_cache, wraps
from numbers import Real
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ksd import units
from ksd.errors import SceneError, SceneWarning

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")
Vector = tuple[float, float, float]
Axis = str | ArrayLike
"""A direction: "x", "-y", ... or three numbers of any length."""
MAX_MAGNITUDE = 1e30
"""Largest absolute value of a number in SI units."""
MIN_POSITIVE = 1e-90
"""The smallest number above zero (the warping constant of a micrometre leaf is 1e-50 m^6)."""
NUMBER_PATTERN = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
"""Regular expression of a number in text."""


_checked = ContextVar("checked", default=True)


@contextmanager
def without_whole_checks() -> Iterator[None]:
    """Context in which checks of a whole scene (such as clearance) are skipped, for designs next to one that passed them."""
    before = _checked.set(False)
    try:
        yield
    finally:
        _checked.reset(before)


def whole_checks_enabled() -> bool:
    """Whether checks of a whole scene are made, see `without_whole_checks`."""
    return _checked.get()


@lru_cache(maxsize=256)
def _signature_without_self(method: Any) -> inspect.Signature:
    """The signature of a method without `self`."""
    whole = inspect.signature(method)
    return whole.replace(parameters=list(whole.parameters.values())[1:])


class ClearArgumentErrors(type):
    """Metaclass: an unknown or missing argument of the constructor raises SceneError with one sentence, not TypeError."""

    if not TYPE_CHECKING:  # hidden, so that checkers and editors go on reading the constructors

        @property
        def __signature__(cls):
            """The signature of the constructor, as `inspect.signature` and help texts show it."""
            return _signature_without_self(cls.__init__)

        def __call__(cls, *args, **kwargs):
            try:
                return type.__call__(cls, *args, **kwargs)
            except TypeError:
                try:
                    cls.__signature__.bind(*args, **kwargs)
                except TypeError as reason:
                    raise SceneError(_argument_error(cls, kwargs, str(reason))) from None
                raise


def clear_argument_errors_of_methods(cls: type[T]) -> type[T]:
    """Class decorator: `clear_argument_errors` for every public method."""
    for name, method in list(vars(cls).items()):
        if inspect.isfunction(method) and not name.startswith("_"):
            setattr(cls, name, clear_argument_errors(method))
    return cls


def clear_argument_errors(function: Callable[P, R]) -> Callable[P, R]:
    """Decorator: an unknown or missing argument raises SceneError with one sentence, not TypeError."""

    @wraps(function)
    def called(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return function(*args, **kwargs)
        except TypeError:
            try:
                inspect.signature(function).bind(*args, **kwargs)
            except TypeError as reason:
                raise SceneError(_argument_error(function, kwargs, str(reason))) from None
            raise

    return called


def _argument_error(called: Callable[..., Any], given: dict[str, Any], reason: str) -> str:
    """The sentence for arguments that do not match the signature of a function or constructor."""
    known = [name for name in inspect.signature(called).parameters if name != "self"]
    name_of = called.__name__
    what = "parameter" if isinstance(called, type) else "option"
    for name in given:
        if name not in known:
            meant = _MISPLACED_ARGUMENTS.get((name_of, name))
            return f"{name_of}: it has no {what} '{name}'{f'; {meant}.' if meant else name_hint(name, known)}"
    if "too many positional" in reason:
        # what must have its name, or what there is
        kinds = {n: p.kind for n, p in inspect.signature(called).parameters.items() if n != "self"}
        named = [n for n, kind in kinds.items() if kind is inspect.Parameter.KEYWORD_ONLY]
        any_name = inspect.Parameter.VAR_KEYWORD in kinds.values() and len(kinds) == 1
        how = f"name them: {'=, '.join(named or known)}=." if known and not any_name else ""
        how = how or ("write name=value." if any_name else "it takes none.")
        return f"{name_of}: more values than it takes without a name; {how}"
    # Python 3.13 says of what kind the argument is
    return f"{name_of}: {reason.replace('keyword-only ', '')}; it takes {', '.join(known)}."


_SECTION = "give section=ksd.rectangle(thickness, width)"
_MISPLACED_ARGUMENTS = {
    ("leaf", "thickness"): _SECTION,
    ("leaf", "width"): _SECTION,
    ("actuate", "value"): "its value is given when it is solved, ksd.solve(mechanism, name=value)",
    ("actuate_joint", "value"): "its value is given when it is solved, ksd.solve(mechanism, name=value)",
    ("Mechanism", "gravity"): "say mechanism.gravity = (0, 0, -9.81)",
}
"""What to do instead of giving an argument that belongs elsewhere, by function and argument."""


def as_given(value: object) -> Any:
    """The value itself, typed as Any: the constructor that receives it checks it."""
    return value


def label(what: str, owner: str) -> str:
    """'owner: what', or just 'what'."""
    return f"{owner}: {what}" if owner else what


def show(value: Any) -> str:
    """A value as the user would write it, cut to a readable length."""
    try:
        text = repr(value.item() if isinstance(value, np.generic) else value)
    except ValueError:
        # Python refuses to print integers of many thousand digits
        text = "a number too long to print"
    text = " ".join(text.split())
    return text if len(text) <= 80 else text[:77] + "..."


def number(value: Any, what: str, *, owner: str = "", unit: str = "") -> float:
    """Any finite real number as float. Raises SceneError for NaN, infinity, text, booleans, arrays."""
    if type(value) is float and -MAX_MAGNITUDE <= value <= MAX_MAGNITUDE:
        return value
    in_unit = f" in {unit}" if unit else ""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if isinstance(value, bool | np.bool_) or not isinstance(value, Real):
        meant = python_unit_hint(value, unit) or f"give one number{in_unit}"
        raise SceneError(f"{label(what, owner)} = {show(value)} is not a number; {meant}.")
    result = _as_float(value)
    if not math.isfinite(result):
        raise SceneError(
            f"{label(what, owner)} = {show(value)} is not finite; give a finite number{in_unit}."
        )
    if abs(result) > MAX_MAGNITUDE:
        # powers of it would leave the range of floating point numbers
        raise SceneError(
            f"{label(what, owner)} = {show(value)} is too large; at most {MAX_MAGNITUDE:g} can be used."
        )
    return result


def python_unit_hint(given: Any, unit: str = "") -> str:
    """How a number with its unit, as scene files have it, is written in Python: "50 mm" is 50 * ksd.units.mm; "" for
    anything else, and for a unit that is not one of the SI unit `unit`, where that is known."""
    match = re.fullmatch(rf"\s*({NUMBER_PATTERN})\s*(.*?)\s*", given) if isinstance(given, str) else None
    if match is None:
        return ""
    value, name = match.groups()
    if not name:
        return f"write {value} without quotes"
    kin = next((known for known in units.DIMENSIONS.values() if name in known), {})
    if not kin or (unit and next(iter(kin)) not in unit.split(" or ")):
        return ""
    if all(hasattr(units, word) for word in re.findall(r"[A-Za-z]+", name)):
        product = re.sub(r"[A-Za-z]+", r"ksd.units.\g<0>", name).replace("^", "**").replace(" ", " * ")
        return f"units are factors in Python: {value} * {product.replace('/', ' / ')}"
    return f"write {float(value) * kin[name]:g}, in {next(iter(kin))}"


def _as_float(value: Any) -> float:
    """A number as float; inf where it is too large for one."""
    try:
        return float(value)
    except OverflowError:
        return math.inf


def positive(value: Any, what: str, *, owner: str = "", unit: str = "") -> float:
    """A finite number above zero, as float."""
    result = number(value, what, owner=owner, unit=unit)
    if result <= 0.0:
        in_unit = f" {unit}" if unit else ""
        raise SceneError(f"{label(what, owner)} = {show(value)}{in_unit} must be positive.")
    if result < MIN_POSITIVE:
        raise SceneError(
            f"{label(what, owner)} = {show(value)} is too small; at least {MIN_POSITIVE:g} can be used."
        )
    return result


def boolean(value: Any, what: str, *, owner: str = "") -> bool:
    """True or False, and nothing that merely counts as one of them."""
    if value is not True and value is not False and not isinstance(value, np.bool_):
        raise SceneError(f"{label(what, owner)} = {show(value)} must be True or False.")
    return bool(value)


def not_negative(value: Any, what: str, *, owner: str = "", unit: str = "") -> float:
    """A finite number, zero or above, as float."""
    result = number(value, what, owner=owner, unit=unit)
    if result < 0.0:
        in_unit = f" {unit}" if unit else ""
        raise SceneError(f"{label(what, owner)} = {show(value)}{in_unit} must be zero or positive.")
    return result


def between(
    value: Any, what: str, low: float, high: float, *, owner: str = "", unit: str = "", scale: float = 1.0
) -> float:
    """A finite number with low < value < high; `scale` converts the three numbers to the `unit` shown."""
    result = number(value, what, owner=owner)
    if not low < result < high:
        in_unit = f" {unit}" if unit else ""
        # degrees given as radians
        meant = unit == "deg" and abs(result) > 2 * math.pi and low < result * scale < high
        hint = f"; did you mean {result:g} * ksd.units.{unit}?" if meant else "."
        raise SceneError(
            f"{label(what, owner)} = {result / scale:.6g}{in_unit} must lie between "
            f"{low / scale:.6g} and {high / scale:.6g}{in_unit}{hint}"
        )
    return result


def vector(value: Any, what: str, *, owner: str = "", unit: str = "") -> Vector:
    """Three finite numbers as a tuple of floats."""
    if type(value) is tuple and len(value) == 3:
        x, y, z = value
        plain = type(x) is type(y) is type(z) is float
        if (
            plain
            and -MAX_MAGNITUDE <= x <= MAX_MAGNITUDE
            and -MAX_MAGNITUDE <= y <= MAX_MAGNITUDE
            and -MAX_MAGNITUDE <= z <= MAX_MAGNITUDE
        ):
            return value
        if all(type(v) in (int, float) and -MAX_MAGNITUDE <= v <= MAX_MAGNITUDE for v in value):
            return float(x), float(y), float(z)
    in_unit = f" in {unit}" if unit else ""
    is_array = isinstance(value, np.ndarray) and value.ndim == 1
    is_list = isinstance(value, Sequence) and not isinstance(value, str | bytes)
    if not (is_array or is_list) or len(value) != 3:
        raise SceneError(f"{label(what, owner)} = {show(value)} must be three numbers (x, y, z){in_unit}.")
    x, y, z = (number(v, f"{what}[{i}]", owner=owner, unit=unit) for i, v in enumerate(value))
    return x, y, z


def wrench_of(force: Any, moment: Any, owner: str) -> np.ndarray:
    """Force (3,) [N] and moment (3,) [Nm] together (6,), not all zero."""
    wrench = np.array(
        [*vector(force, "force", owner=owner, unit="N"), *vector(moment, "moment", owner=owner, unit="Nm")]
    )
    if not wrench.any():
        raise SceneError(f"{owner}: force and moment are zero; give one that is not zero.")
    return wrench


def checked_question(question: Any) -> Callable[[Any], Any]:
    """A function of a pose, checked to be one."""
    if not callable(question):
        raise SceneError(
            f"question = {show(question)}: give a function of a pose, such as lambda pose: pose.forces['top']."
        )
    found: Callable[[Any], Any] = question
    return found


PERPENDICULAR, EXACTLY_PERPENDICULAR = 1e-5, 1e-6
"""Cosine of the angle of two directions up to which coordinates of six digits may mean a right angle, and up to which no
word is lost about it."""


def warn_user(message: str, category: type[Warning]) -> None:
    """Warn at the line of the user that called the package, whatever lies between: this package, installed libraries that
    call it back, and files of no name, which dataclasses have."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_NOT_THE_USERS):
        frame, level = frame.f_back, level + 1
    warnings.warn(message, category, stacklevel=level)


_NOT_THE_USERS = (
    *(
        os.path.dirname(os.path.abspath(f)) + os.sep
        for f in (__file__, os.__file__, os.path.dirname(np.__file__))
    ),
    "<string>",
    "<frozen ",
)


def made_perpendicular(axis: Vector, to: Vector, what: str, owner: str) -> Vector | None:
    """The unit vector `axis` perpendicular to the unit vector `to`, if it nearly is; None if it is not.

    One that is off by more than `EXACTLY_PERPENDICULAR` is turned, with a warning; one that is nearer stays as it is.
    """
    cosine = dot(axis, to)
    if abs(cosine) <= EXACTLY_PERPENDICULAR:
        return axis
    if abs(cosine) > PERPENDICULAR:
        return None
    x, y, z = (a - cosine * b for a, b in zip(axis, to, strict=True))
    warn_user(
        f"{owner}: {what} is {abs(cosine):.1g} rad off a right angle, as coordinates of few digits are; it was made "
        f"perpendicular, ({x:.9g}, {y:.9g}, {z:.9g}).",
        SceneWarning,
    )
    return unit((x, y, z))


_AXES: dict[str, Vector] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def direction(value: Any, what: str, *, owner: str = "") -> Vector:
    """A unit vector from "x", "-y", "+z" or three numbers of any length above zero."""
    if isinstance(value, str):
        sign, name = (value[0], value[1:]) if value[:1] in ("-", "+") else ("+", value)
        if name not in _AXES:
            raise SceneError(
                f'{label(what, owner)} = {show(value)} is not a direction; give "x", "y", "z", "-x", '
                '"-y", "-z" or three numbers.'
            )
        x, y, z = _AXES[name]
        return (x, y, z) if sign == "+" else (0.0 - x, 0.0 - y, 0.0 - z)
    parts = vector(value, what, owner=owner)
    if abs(math.hypot(*parts) - 1.0) <= 1e-15:
        # a unit vector stays as it is, so that reading back what was written changes no digit
        return parts
    size = max(abs(c) for c in parts)
    if size == 0.0:
        raise SceneError(
            f'{label(what, owner)} = {show(value)} has no length, so it is no direction; give one, such as {what}="x".'
        )
    # scaled first, so that very small or large components neither vanish nor overflow
    x, y, z = (c / size for c in parts)
    length = math.hypot(x, y, z)
    return x / length, y / length, z / length


def as_vector(values: Iterable[Any]) -> Vector:
    """Three numbers as plain floats."""
    x, y, z = (float(v) for v in values)
    return x, y, z


def dot(a: Vector, b: Vector) -> float:
    """Scalar product of three numbers each."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Vector product of three numbers each."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def unit(a: Any) -> Vector:
    """Three numbers, not all zero, scaled to length one."""
    length = math.hypot(*a)
    return a[0] / length, a[1] / length, a[2] / length


def word(value: Any, what: str, *, owner: str = "") -> str:
    """A name: text that is not empty."""
    if not isinstance(value, str) or not value.strip():
        raise SceneError(f"{label(what, owner)} = {show(value)} must be a name (text that is not empty).")
    if not value.isprintable():
        raise SceneError(f"{label(what, owner)} = {show(value)} must be a name of printable characters.")
    return value


def names_of(given: Any, what: str) -> tuple[str, ...]:
    """A name, or several, as a tuple; objects with a name stand for it."""
    if isinstance(given, str):
        return (given,)
    if not isinstance(given, Iterable):
        raise SceneError(f"{what} = {show(given)}: give a name, or several in a list")
    return tuple(word(getattr(name, "name", name), what) for name in given)


def unused_name(default: str, used: set[str]) -> str:
    """`default`, or default.2, default.3 ... whichever is free first."""
    name, count = default, 1
    while name in used:
        count += 1
        name = f"{default}.{count}"
    return name


def whole_number(value: Any, what: str, *, least: int = 1, owner: str = "") -> int:
    """A whole number of at least `least`."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise SceneError(f"{label(what, owner)} = {show(value)} must be a whole number of at least {least}.")
    return int(value)


def similar_name_hint(name: Any, known: Iterable[str], *, cutoff: float = 0.6) -> str:
    """'; did you mean "..."?' with the known name that is nearest, whole or in a word of it, or '.' when none is near."""
    names = sorted(known)
    words = {part: whole for whole in reversed(names) for part in whole.split("_")} | {n: n for n in names}
    close = difflib.get_close_matches(str(name), words, n=1, cutoff=cutoff)
    return f'; did you mean "{words[close[0]]}"?' if close else "."


def name_hint(name: Any, known: Iterable[str]) -> str:
    """'; did you mean "..."?' with the nearest known name, else the list of all known names."""
    names = sorted(known)
    hint = similar_name_hint(name, names)
    if hint != ".":
        return hint
    return f"; known: {', '.join(names)}." if names else "; none is known."
