"""Reading one table of a scene file: every key with its type and unit, unknown keys refused by name."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from typing import Any

from ksd.errors import SceneError
from ksd.section.checks import direction, nearest, number, show, similar
from ksd.units import NAMES

DIMENSIONS = {
    "length": ("m", "mm", "um", "nm"),
    "angle": ("rad", "mrad", "urad", "deg"),
    "stress": ("Pa", "kPa", "MPa", "GPa"),
    "force": ("N", "mN", "kN"),
    "moment": ("Nm", "mNm"),
    "mass": ("kg", "g", "tonne"),
    "density": ("kg/m3",),
}
"""Units by dimension; the first is the SI unit in which plain numbers are read."""

_EXAMPLES = {
    "length": "1 mm",
    "angle": "45 deg",
    "stress": "200 GPa",
    "force": "10 N",
    "moment": "2 Nm",
    "mass": "5 g",
    "density": "7800 kg/m3",
}
_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([A-Za-z][A-Za-z0-9/]*)\s*")
_REQUIRED = object()


def quantity(value: Any, dimension: str, what: str) -> float:
    """A number in SI units from a plain number (already SI) or text such as "100 mm".

    dimension: a key of `DIMENSIONS`, or "number" for plain numbers only. Raises SceneError for a wrong type,
    an unknown unit (with the nearest), a unit of another dimension, or a number that is not finite.
    """
    if not isinstance(value, str):
        unit = DIMENSIONS[dimension][0] if dimension in DIMENSIONS else ""
        return number(value, what, unit=unit)
    if dimension == "number":
        raise SceneError(f"{what} = '{value}': a plain number is expected, without quotes.")
    article = "an" if dimension == "angle" else "a"
    expected = f"{article} {dimension} is expected, e.g. '{_EXAMPLES[dimension]}'"
    match = _QUANTITY.fullmatch(value)
    if match is None:
        raise SceneError(f"{what} = {show(value)}: {expected}.")
    amount, unit = match.groups()
    if unit not in NAMES:
        raise SceneError(
            f"{what} = {show(value)}: the unit '{unit}' is unknown{nearest(unit, DIMENSIONS[dimension])}"
        )
    if unit not in DIMENSIONS[dimension]:
        raise SceneError(f"{what} = {show(value)}: {expected}.")
    return number(float(amount) * NAMES[unit], what)


@contextmanager
def placed_at(where: str) -> Iterator[None]:
    """Put file and table before the message of any SceneError raised inside."""
    try:
        yield
    except SceneError as error:
        raise SceneError(f"{where}: {error}") from None


class Table:
    """One table of a scene file and the place to name in messages, e.g. "fourbar.toml, [joint.cross]".

    Every key is taken once with the type it must have; `finish` then refuses the keys nobody knows. A key
    without a default is required. Messages start with the place and the key.
    """

    def __init__(self, values: Any, file: str, path: str = "", row: int = 0) -> None:
        self.where = f"{file}, [[{path}]] {row}" if row else f"{file}, [{path}]" if path else file
        if not isinstance(values, dict):
            raise SceneError(f"{self.where} = {show(values)} must be a table.")
        self.values, self._file, self._path = values, file, path
        self._known: set[str] = set()

    def _inside(self, key: str) -> str:
        return f"{self._path}.{key}" if self._path else key

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def take(self, key: str, default: Any = _REQUIRED) -> Any:
        """The raw value of a key."""
        self._known.add(key)
        if key in self.values:
            return self.values[key]
        if default is _REQUIRED:
            # a present key of a similar name is probably a misspelling of the missing one
            hint = similar(key, self.values, cutoff=0.7)
            raise SceneError(f"{self.where}: key '{key}' is missing{hint}")
        return default

    def _typed(self, key: str, default: Any, read: Callable[[Any], Any]) -> Any:
        value = self.take(key, default)
        if key not in self.values:
            return value
        with placed_at(self.where):
            return read(value)

    def quantity(self, key: str, dimension: str, default: Any = _REQUIRED) -> Any:
        """A number in SI, see `quantity`."""
        return self._typed(key, default, lambda v: quantity(v, dimension, key))

    def quantities(self, key: str, dimension: str, default: Any = _REQUIRED, *, count: int = 3) -> Any:
        """A tuple of `count` numbers in SI."""

        def read(value: Any) -> tuple[float, ...]:
            if not isinstance(value, list) or len(value) != count:
                raise SceneError(f"{key} = {show(value)} must be a list of {count} numbers.")
            return tuple(quantity(v, dimension, f"{key}[{i}]") for i, v in enumerate(value))

        return self._typed(key, default, read)

    def direction(self, key: str, default: Any = _REQUIRED) -> Any:
        """A unit vector from "x", "-z" or three numbers."""
        return self._typed(key, default, lambda v: direction(v, key))

    def text(self, key: str, default: Any = _REQUIRED) -> Any:
        """Text."""
        return self._typed(key, default, lambda v: _text(v, key))

    def name_of(self, key: str, known: Collection[str], kind: str, default: Any = _REQUIRED) -> Any:
        """The name of a material, section or joint defined in this file."""

        def read(value: Any) -> str:
            if _text(value, key) not in known:
                raise SceneError(
                    f"{key} = {show(value)}: there is no {kind} of that name{nearest(value, known)}"
                )
            return value

        return self._typed(key, default, read)

    def yes_or_no(self, key: str, default: bool) -> bool:
        """true or false."""

        def read(value: Any) -> bool:
            if not isinstance(value, bool):
                raise SceneError(f"{key} = {show(value)} must be true or false.")
            return value

        return self._typed(key, default, read)

    def table(self, key: str) -> Table:
        """A table inside this one, empty when absent."""
        return Table(self.take(key, {}), self._file, self._inside(key))

    def tables(self, key: str) -> list[Table]:
        """The tables of an array [[key]], empty when absent."""
        found = self.take(key, [])
        if not isinstance(found, list):
            raise SceneError(f"{self.where}: {key} = {show(found)} must be written as [[{key}]] tables.")
        return [Table(v, self._file, self._inside(key), i + 1) for i, v in enumerate(found)]

    def named(self, key: str) -> dict[str, Table]:
        """The tables [key.NAME] by name."""
        inside = self.table(key)
        return {k: Table(v, self._file, inside._inside(k)) for k, v in inside.values.items()}

    def finish(self) -> None:
        """Raise SceneError for a key that was never taken, with the nearest known one."""
        for key in self.values:
            if key not in self._known:
                raise SceneError(f"{self.where}: key '{key}' is unknown{nearest(key, self._known)}")


def _text(value: Any, key: str) -> str:
    if not isinstance(value, str):
        raise SceneError(f"{key} = {show(value)} must be text in quotes.")
    return value
