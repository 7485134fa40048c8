"""Reading one table of a scene file: keys by a schema, unknown ones refused by name."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
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
Parts = Mapping[str, Mapping[str, Any]]


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

    `read` takes the keys of a schema, `finish` then refuses those nobody took. Messages start with place and key.
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

    def read(self, schema: Mapping[str, str], parts: Parts | None = None) -> dict[str, Any]:
        """The values of the keys that are given, as the kinds of a schema say (see `ksd.scene.toml_schema`).

        parts: the "material"s, "section"s and "joint"s of the file by name. Raises SceneError for a key that is missing, or
        of a wrong type, unit or name.
        """
        self._known |= schema.keys()
        found = {}
        for key, kind in schema.items():
            if key in self.values:
                with placed_at(self.where):
                    found[key] = _value(self.values[key], kind.rstrip("!"), key, parts or {})
            elif kind.endswith("!"):
                # a present key of a similar name is probably a misspelling of the missing one
                hint = similar(key, self.values, cutoff=0.7)
                raise SceneError(f"{self.where}: key '{key}' is missing{hint}")
        return found

    def say(self, sentence: Callable[..., Any], words: Mapping[str, Any]) -> Any:
        """Refuse unknown keys, then say the sentence; its errors get file and table in front."""
        self.finish()
        with placed_at(self.where):
            return sentence(**words)

    def table(self, key: str) -> Table:
        """A table inside this one, empty when absent."""
        return Table(self._taken(key, {}), self._file, self._inside(key))

    def tables(self, key: str) -> list[Table]:
        """The tables of an array [[key]], empty when absent."""
        found = self._taken(key, [])
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

    def _taken(self, key: str, default: Any) -> Any:
        self._known.add(key)
        return self.values.get(key, default)


def _value(value: Any, kind: str, key: str, parts: Parts) -> Any:
    """One value as its kind says, without the place."""
    kind, several, count = kind.removesuffix("]").partition("[")
    if count or (several and isinstance(value, list)):
        if not isinstance(value, list) or (count and len(value) != int(count)):
            raise SceneError(f"{key} = {show(value)} must be a list of {count} numbers.")
        return tuple(quantity(v, kind, f"{key}[{i}]") for i, v in enumerate(value))
    if kind in DIMENSIONS or kind == "number":
        return quantity(value, kind, key)
    if kind == "any":
        return value
    if kind == "direction":
        return direction(value, key)
    if kind == "flag":
        if not isinstance(value, bool):
            raise SceneError(f"{key} = {show(value)} must be true or false.")
        return value
    if not isinstance(value, str):
        raise SceneError(f"{key} = {show(value)} must be text in quotes.")
    if kind == "text":
        return value
    if value not in parts[kind]:
        raise SceneError(
            f"{key} = {show(value)}: there is no {kind} of that name{nearest(value, parts[kind])}"
        )
    return parts[kind][value]
