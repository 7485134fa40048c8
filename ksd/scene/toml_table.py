"""Reading one table of a scene file: keys by a schema, unknown ones refused by name, all mistakes noted together."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from typing import Any, TypeVar

from ksd.checks import NUMBER_PATTERN, direction, name_hint, number, show, similar_name_hint
from ksd.errors import SceneError
from ksd.scene.plausibility import likely_unit
from ksd.units import DIMENSIONS

T = TypeVar("T")
_EXAMPLES = {
    "length": "1 mm", "angle": "45 deg", "stress": "200 GPa", "force": "10 N", "moment": "2 Nm", "mass": "5 g",
    "density": "7800 kg/m^3", "acceleration": "9.81 m/s^2", "stiffness": "200 N/m", "torsional stiffness": "0.2 Nm/rad",
    "inertia": "3 kg mm^2", "temperature": "20 K", "expansion": "12e-6 1/K", "area": "40 mm^2",
    "second moment": "3 mm^4", "warping constant": "2 mm^6",
}  # fmt: skip
_QUANTITY = re.compile(rf"\s*({NUMBER_PATTERN})\s*(.*?)\s*", re.DOTALL)
ANY_NAME = ""
"""Stands for all names where it is not known which are wrong."""
Parts = Mapping[str, Mapping[str, Any]]


_UNIT_SPELLINGS = {
    " ": r"\s*[ *·]\s*", "_": r"\s*[*·]?\s*", "1/": "1?/", "/": r"\s*/\s*", "^2": "(?:\\^?2|²)", "^3": "(?:\\^?3|³)",
    "^4": "\\^?4", "^6": "\\^?6", "deg": "(?:deg|°)", "um": "[uµμ]m",
}  # fmt: skip
"""How parts of a unit may be written; "_" stands between force and length of a moment."""


def unit_pattern(unit: str) -> str:
    """Regular expression, as of JavaScript too, of the ways to write a unit: Nm is "N m" too, kg/m^3 is "kg/m3"."""
    said = re.sub(r"N(?=m)", "N_", unit)
    for plain, ways in _UNIT_SPELLINGS.items():
        said = said.replace(plain, ways)
    return said


@cache
def find_unit(said: str) -> str | None:
    """The unit of `DIMENSIONS` that is meant by what stands behind a number; None where none is."""
    units = (unit for units in DIMENSIONS.values() for unit in units)
    return next((unit for unit in units if re.fullmatch(unit_pattern(unit), said)), None)


def quantity(value: Any, dimension: str, what: str) -> float:
    """A number in SI units from a plain number (already SI) or text such as "100 mm".

    dimension: a key of `DIMENSIONS`, or "number" for plain numbers only. Raises SceneError for a wrong type,
    an unknown unit (with the nearest), a unit of another dimension, or a number that is not finite.
    """
    if not isinstance(value, str):
        unit = next(iter(DIMENSIONS[dimension])) if dimension in DIMENSIONS else ""
        return number(value, what, unit=unit)
    if dimension == "number":
        raise SceneError(f"{what} = {show(value)}: a plain number is expected, without quotes.")
    article = "an" if dimension[0] in "aei" else "a"
    expected = f"{article} {dimension} is expected, e.g. '{_EXAMPLES[dimension]}'"
    match = _QUANTITY.fullmatch(value)
    if match is None or not match[2]:
        raise SceneError(f"{what} = {show(value)}: {expected}.")
    if re.match(r",\s*\d", match[2]):
        raise SceneError(f"{what} = {show(value)}: write a decimal point; {expected}.")
    found, units = find_unit(match[2]), DIMENSIONS[dimension]
    if found is None:
        raise SceneError(
            f"{what} = {show(value)}: the unit '{match[2]}' is unknown{name_hint(match[2], units)}"
        )
    if found not in units:
        raise SceneError(f"{what} = {show(value)}: {expected}.")
    return number(float(match[1]) * units[found], what)


def parse_quantity(said: str) -> tuple[float, str] | None:
    """The number (SI) that text such as "100 mm" tells, and its dimension; None for other text."""
    match = _QUANTITY.fullmatch(said)
    unit = find_unit(match[2]) if match else None
    if match is None or unit is None:
        return None
    dimension = next(name for name, units in DIMENSIONS.items() if unit in units)
    return float(match[1]) * DIMENSIONS[dimension][unit], dimension


@contextmanager
def error_location(where: str) -> Iterator[None]:
    """Put file and table before the message of any SceneError raised inside."""
    try:
        yield
    except SceneError as error:
        raise type(error)(f"{where}: {error}") from None


class InvalidTable(SceneError):
    """A table that cannot be said, or a mistake that only follows from another: why stands among the mistakes noted."""


@dataclass
class FileMistakes:
    """What is wrong in a file, a sentence each, and plain numbers that were probably meant otherwise: where and what."""

    mistakes: list[str] = field(default_factory=list)
    doubts: list[tuple[str, str]] = field(default_factory=list)


class Table:
    """One table of a scene file and the place to name in messages, e.g. "fourbar.toml, [joint.cross]".

    `read` takes the keys of a schema, `finish` then refuses those nobody took. Messages start with place and key. noted:
    where mistakes are gathered, `sound` then tells whether this table has none; without it the first one is raised.
    """

    def __init__(
        self, values: Any, file: str, path: str = "", row: int = 0, *, noted: FileMistakes | None = None
    ) -> None:
        self.where = f"{file}, [[{path}]] {row}" if row else f"{file}, [{path}]" if path else file
        self.sound, self._noted, self._doubts = True, noted, list[str]()
        self.values: dict[str, Any] = values if isinstance(values, dict) else {}
        self._file, self._path, self._row = file, path, row
        self._known: set[str] = set()
        self._is_table = isinstance(values, dict)
        if not self._is_table:
            self.note(f"{self.where} = {show(values)} must be a table.")

    def _inside(self, key: str) -> str:
        return f"{self._path}.{key}" if self._path else key

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def note(self, mistake: str) -> None:
        """A mistake of this table, as a sentence that names it; raises SceneError where mistakes are not gathered."""
        if self._noted is None:
            raise SceneError(mistake)
        self.sound = False
        if mistake not in self._noted.mistakes:
            self._noted.mistakes.append(mistake)

    @contextmanager
    def judged(self, *, doubting: bool = True) -> Iterator[None]:
        """Note what is refused inside as a mistake of this table; doubting: with the plain numbers that may be why."""
        try:
            yield
        except InvalidTable:
            self.sound = False
        except SceneError as error:
            doubts = " ".join(self._doubts if doubting else ())
            self.note(f"{self.where}: {error}{' Plain numbers are in SI: ' if doubts else ''}{doubts}")

    def read(
        self, schema: Mapping[str, str], parts: Parts | None = None, *, known: Iterable[str] = ()
    ) -> dict[str, Any]:
        """The values of the keys that are given, as the kinds of a schema say (see `ksd.scene.toml_schema`).

        parts: the "material"s, "section"s and "joint"s of the file by name, None for those that are wrong themselves; ANY
        among them where there may be more; known: the words that a key which is missing may be.
        Notes a key that is missing, or of a wrong type, unit or name.
        """
        self._known |= schema.keys()
        found = {}
        for key, kind in schema.items():
            if key in self.values:
                with self.judged(doubting=False):
                    found[key] = _value(self.values[key], kind.rstrip("!"), key, parts or {})
                    self._doubt(key, kind, self.values[key])
            elif kind.endswith("!") and self._is_table:
                # a present key of a similar name is probably this one misspelt: one mistake, not two
                meant = [k for k in self.unknown() if similar_name_hint(key, [k], cutoff=0.7) != "."][:1]
                self._known |= set(meant)
                wrong = (
                    f"key '{meant[0]}' is unknown; did you mean \"{key}\"?"
                    if meant
                    else f"key '{key}' is missing{': one of ' if known else ''}{', '.join(known)}."
                )
                self.note(f"{self.where}: {wrong}")
        return found

    def _doubt(self, key: str, kind: str, value: Any) -> None:
        """Keep in mind that a plain number was probably meant in another unit."""
        dimension = kind.rstrip("!").partition("[")[0]
        for plain in _plain_numbers(value) if dimension in DIMENSIONS else ():
            unit = likely_unit(plain, dimension, key)
            if unit:
                si = next(iter(DIMENSIONS[dimension]))
                said = f"{key} = {plain:g} is {plain:g} {si}: did you mean '{plain:g} {unit}'?"
                self._doubts.append(said)
                if self._noted is not None:
                    self._noted.doubts.append((self.where, said))
                return

    def say(self, sentence: Callable[..., T], words: Mapping[str, Any]) -> T:
        """Refuse unknown keys, then say the sentence; its errors get file and table in front. Raises Unsaid where there is
        a mistake."""
        self.finish()
        if self.sound:
            with self.judged():
                return sentence(**words)
        raise InvalidTable(f"{self.where}: see above")

    def table(self, key: str) -> Table:
        """A table inside this one, empty when absent."""
        found = self._child(self._taken(key, {}), self._inside(key))
        if self._row:
            # of which of several it is the part
            found.where = f"{self.where}, [{self._inside(key)}]"
        return found

    def tables(self, key: str) -> list[Table]:
        """The tables of an array [[key]], empty when absent."""
        found = self._taken(key, [])
        if not isinstance(found, list):
            self.note(f"{self.where}: {key} = {show(found)} must be written as [[{key}]] tables.")
            return []
        return [self._child(v, self._inside(key), i + 1) for i, v in enumerate(found)]

    def children(self) -> dict[str, Table]:
        """The tables of which this one consists, by name."""
        return {key: self._child(value, self._inside(key)) for key, value in self.values.items()}

    def _child(self, values: Any, path: str, row: int = 0) -> Table:
        return Table(values, self._file, path, row, noted=self._noted)

    def unknown(self) -> list[str]:
        """Keys that were never taken."""
        return [key for key in self.values if key not in self._known]

    def finish(self) -> None:
        """Note every key that was never taken, with the nearest known one."""
        for key in self.unknown():
            self.note(f"{self.where}: key '{key}' is unknown{name_hint(key, self._known)}")

    def _taken(self, key: str, default: Any) -> Any:
        self._known.add(key)
        return self.values.get(key, default)


def make_each(make: Callable[[Any], T], tables: Iterable[Any]) -> list[T]:
    """What is made of every table; raises Unsaid once all were read, where one of them cannot be said."""
    found, unsaid = [], None
    for table in tables:
        try:
            found.append(make(table))
        except InvalidTable as error:
            unsaid = error
    if unsaid is not None:
        raise unsaid
    return found


def _plain_numbers(value: Any) -> Iterator[float]:
    """All plain numbers in a value."""
    if isinstance(value, list):
        for item in value:
            yield from _plain_numbers(item)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield float(value)


def _value(value: Any, kind: str, key: str, parts: Parts) -> Any:
    """One value as its kind says, without the place."""
    kind, several, count = kind.removesuffix("]").partition("[")
    if count and (not isinstance(value, list) or len(value) != int(count)):
        raise SceneError(f"{key} = {show(value)} must be a list of {count} numbers.")
    if several and isinstance(value, list):
        inner = kind if count else f"{kind}[]"
        return tuple(_value(v, inner, f"{key}[{i}]", parts) for i, v in enumerate(value))
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
    if kind == "names":
        if not isinstance(value, list):
            raise SceneError(f"{key} = {show(value)} must be a list of names.")
        return value
    if not isinstance(value, str):
        name = "" if kind == "text" else f", the name of a [{kind}.NAME]"
        raise SceneError(f"{key} = {show(value)} must be text in quotes{name}.")
    if kind == "text":
        return value
    known = parts[kind]
    if value not in known and ANY_NAME not in known:
        raise SceneError(f"{key} = {show(value)}: there is no {kind} of that name{name_hint(value, known)}")
    if known.get(value) is None:
        raise InvalidTable(f"the {kind} '{value}' has a mistake of its own")
    return known[value]
