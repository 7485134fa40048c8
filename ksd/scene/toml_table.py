"""Reading of one table of a scene file by a schema, with all mistakes of the file collected."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from typing import Any, TypeVar

from ksd.checks import NUMBER_PATTERN, direction, name_hint, number, show, similar_name_hint
from ksd.errors import SceneError
from ksd.scene.material import Material
from ksd.scene.plausibility import likely_unit
from ksd.section import rectangle
from ksd.units import DIMENSIONS

T = TypeVar("T")
_EXAMPLES = {
    "length": "1 mm", "angle": "45 deg", "stress": "200 GPa", "force": "10 N", "moment": "2 Nm", "mass": "5 g",
    "density": "7800 kg/m^3", "acceleration": "9.81 m/s^2", "stiffness": "200 N/m", "torsional stiffness": "0.2 Nm/rad",
    "softness": "0.01 mm/N", "torsional softness": "0.1 deg/Nm",
    "damping": "2 N s/m", "torsional damping": "0.1 Nm s/rad", "time": "50 ms",
    "frequency": "20 Hz", "moment per length": "0.5 Nm/m",
    "inertia": "3 kg mm^2", "temperature": "20 K", "expansion": "12e-6 1/K", "area": "40 mm^2",
    "second moment": "3 mm^4", "warping constant": "2 mm^6",
}  # fmt: skip
_SIGNS = str.maketrans(
    dict.fromkeys("−–‒﹣－", "-") | {"＋": "+"} | dict.fromkeys("\u00a0\u2002\u2003\u2007\u2009\u202f", " ")
)
"""Typographic signs and spaces, and those of a keyboard that they stand for."""
_SUPERSCRIPTS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻", "0123456789+-")
POWER_PATTERN = r"\s*[×·⋅∙*]\s*10(?:\^?([+-]\d+)|\^(\d+)|([⁺⁻]?[⁰¹²³⁴⁵⁶⁷⁸⁹]+))"
"""Regular expression of a power of ten behind a number: "12·10⁻⁶" or "2 × 10^5"."""
_POWER = re.compile(r"(?<=\d)" + POWER_PATTERN)
_GROUPS = re.compile(r"\s*[+-]?\d{1,3}(?:[ '’]\d{3})+(?!\d)")
_QUANTITY = re.compile(rf"\s*({NUMBER_PATTERN})\s*(.*?)\s*", re.DOTALL)
ANY_NAME = ""
"""Name that stands for any name, where a mistake makes it unknown which names a file defines."""
_STAND_INS = {
    "material": Material(E=2e11, nu=0.3, density=7.8e3, expansion=1e-5, yield_stress=1e9, fatigue_limit=1e9),
    "section": rectangle(1e-6, 1e-6),
}
"""Parts in the place of those with mistakes, so that the mistakes of what is made of them are found as well."""
Parts = Mapping[str, Mapping[str, Any]]
"""Materials, sections and joints of a file by kind and name."""


_UNIT_SPELLINGS = {
    " ": r"\s*[- *·⋅∙•]\s*", "_": r"\s*[*·⋅∙•]?\s*", "1/": "1?/", "/": r"\s*[/∕⁄]\s*", "^2": "(?:\\^?2|²)",
    "^3": "(?:\\^?3|³)", "^4": "(?:\\^?4|⁴)", "^6": "(?:\\^?6|⁶)", "deg": "(?:deg|[°º˚])", "um": "[uµμ]m",
}  # fmt: skip
"""Regular expressions of the ways to write parts of a unit; "_" stands between force and length of a moment."""


def unit_pattern(unit: str) -> str:
    """Regular expression, valid in JavaScript too, of the ways to write a unit: "Nm" or "N m", "kg/m^3" or "kg/m3"."""
    pattern = re.sub(r"N(?=m)", "N_", unit)
    for part, spellings in _UNIT_SPELLINGS.items():
        pattern = pattern.replace(part, spellings)
    return pattern


def plain_signs(text: str) -> str:
    """A number with a unit in the signs of a keyboard: "−5 mm" as "-5 mm", "12·10⁻⁶ 1/K" as "12e-6 1/K", "1 000 mm" as
    "1000 mm"."""
    ungrouped = _GROUPS.sub(lambda m: re.sub("[ '’]", "", m[0]), text.translate(_SIGNS))
    return _POWER.sub(lambda m: "e" + next(filter(None, m.groups())).translate(_SUPERSCRIPTS), ungrouped)


@cache
def find_unit(text: str, dimension: str = "") -> str | None:
    """The unit of `DIMENSIONS` written as `text`, None if there is none.

    In letters of another case only where one unit can be meant, of `dimension` where it is given: "MM" is mm, but neither
    "mPa" nor "Mm" another prefix.
    """
    exact = (
        unit for units in DIMENSIONS.values() for unit in units if re.fullmatch(unit_pattern(unit), text)
    )
    if found := next(exact, None):
        return found
    meant = {
        (name, factor): unit
        for name, units in DIMENSIONS.items()
        for unit, factor in units.items()
        if name == (dimension or name)
        and re.fullmatch(unit_pattern(unit), text, re.IGNORECASE)
        and not _is_other_prefix(text, unit)
    }
    return next(iter(meant.values())) if len(meant) == 1 else None


def has_exact_prefix(unit: str) -> bool:
    """Whether milli of a unit can be confused with mega in capitals, as of mN, MN and mHz, so that only m and M tell."""
    return unit[0] in "mM" and (unit[1:2] == "N" or (unit[0].islower() and unit[1:2].isupper()))


def _is_other_prefix(text: str, unit: str) -> bool:
    """Whether text that spells a unit in another case has mega for milli, or milli for mega."""
    if text[0] + unit[0] not in ("mM", "Mm") or not unit[1:2].isalpha():
        return False
    return has_exact_prefix(unit) or re.fullmatch(unit_pattern(unit[1:]), text[1:]) is not None


def quantity(value: Any, dimension: str, what: str) -> float:
    """A number in SI units from a plain number (already in SI) or text such as "100 mm".

    dimension: a key of `DIMENSIONS`, or "number" for plain numbers only; what: its name in messages. Raises SceneError for
    a wrong type, an unknown unit (with the nearest), a unit of another dimension, or a number that is not finite.
    """
    if not isinstance(value, str):
        si_unit = next(iter(DIMENSIONS[dimension])) if dimension in DIMENSIONS else ""
        return number(value, what, unit=si_unit)
    if dimension == "number":
        raise SceneError(f"{what} = {show(value)}: a plain number is expected, without quotes.")
    article = "an" if dimension[0] in "aei" else "a"
    expected = f"{article} {dimension} is expected, e.g. '{_EXAMPLES[dimension]}'"
    match = _QUANTITY.fullmatch(plain_signs(value))
    if match is None or not match[2]:
        raise SceneError(f"{what} = {show(value)}: {expected}.")
    if re.match(r",\s*\d", match[2]):
        raise SceneError(f"{what} = {show(value)}: write a decimal point; {expected}.")
    if fraction := re.match(r"/\s*([1-9]\d*)\s*", match[2]):
        amount, rest = float(match[1]) / int(fraction[1]), match[2][fraction.end() :]
        raise SceneError(
            f"{what} = {show(value)}: write a decimal number, not a fraction: '{amount:.6g} {rest}'."
        )
    unit, units = find_unit(match[2], dimension), DIMENSIONS[dimension]
    if unit is None:
        alike = [u for u in units if re.fullmatch(unit_pattern(u), match[2], re.IGNORECASE)]
        hint = (
            f"may be {' or '.join(alike)}; write the one you mean." if alike
            else f"is unknown{name_hint(match[2], units)}"
        )  # fmt: skip
        raise SceneError(f"{what} = {show(value)}: the unit '{match[2]}' {hint}")
    if unit not in units:
        raise SceneError(f"{what} = {show(value)}: {expected}.")
    return number(float(match[1]) * units[unit], what)


def parse_quantity(text: str) -> tuple[float, str] | None:
    """The number (SI) and the dimension of text such as "100 mm"; None for other text."""
    match = _QUANTITY.fullmatch(plain_signs(text))
    unit = find_unit(match[2]) if match else None
    if match is None or unit is None:
        return None
    dimension = next(name for name, units in DIMENSIONS.items() if unit in units)
    return float(match[1]) * DIMENSIONS[dimension][unit], dimension


def written_unit(text: str) -> tuple[str, float] | None:
    """The unit of text such as "100 mm", and its factor to SI; None for other text."""
    match = _QUANTITY.fullmatch(plain_signs(text))
    unit = find_unit(match[2]) if match else None
    return None if unit is None else (unit, next(u[unit] for u in DIMENSIONS.values() if unit in u))


@contextmanager
def error_location(where: str) -> Iterator[None]:
    """Context that puts `where` (file and table) before the message of a SceneError."""
    try:
        yield
    except SceneError as error:
        raise type(error)(f"{where}: {error}") from None


class InvalidTable(SceneError):
    """Raised for a table that cannot be used because of mistakes that are collected already."""


@dataclass
class FileMistakes:
    """Mistakes of a file, one message each, and (table, message) of plain numbers that are probably in another unit."""

    mistakes: list[str] = field(default_factory=list)
    unit_doubts: list[tuple[str, str]] = field(default_factory=list)


class Table:
    """One table of a scene file, and its location for messages (`where`), e.g. "fourbar.toml, [joint.cross]".

    `read` reads the keys of a schema; `note_unknown_keys` then reports all others. file_mistakes: collects mistakes, and
    `is_valid` is False once this table has one; without it the first mistake is raised as SceneError. has_gaps: whether a
    value is missing because of one, so that the part that the table describes cannot be tried.
    """

    def __init__(
        self,
        values: Any,
        file: str,
        path: str = "",
        row: int = 0,
        *,
        file_mistakes: FileMistakes | None = None,
    ) -> None:
        self.where = f"{file}, [[{path}]] {row}" if row else f"{file}, [{path}]" if path else file
        self.is_valid, self.has_gaps = True, False
        self._file_mistakes, self._unit_doubts = file_mistakes, list[str]()
        self.values: dict[str, Any] = values if isinstance(values, dict) else {}
        self._file, self._path, self._row = file, path, row
        self._known_keys: set[str] = set()
        self._is_table = isinstance(values, dict)
        if not self._is_table:
            self.note_mistake(f"{self.where} = {show(values)} must be a table.")

    def _path_of(self, key: str) -> str:
        return f"{self._path}.{key}" if self._path else key

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def note_mistake(self, mistake: str) -> None:
        """Collect a mistake of this table, a full message. Raises SceneError if mistakes are not collected."""
        if self._file_mistakes is None:
            raise SceneError(mistake)
        self.is_valid, self.has_gaps = False, True
        if mistake not in self._file_mistakes.mistakes:
            self._file_mistakes.mistakes.append(mistake)

    @contextmanager
    def collect_errors(self, *, with_unit_doubts: bool = True) -> Iterator[None]:
        """Context that collects a SceneError as a mistake of this table.

        with_unit_doubts: its message also names the plain numbers that are probably in another unit.
        """
        try:
            yield
        except InvalidTable:
            self.is_valid, self.has_gaps = False, True
        except SceneError as error:
            doubts = " ".join(self._unit_doubts if with_unit_doubts else ())
            self.note_mistake(
                f"{self.where}: {error}{' Plain numbers are in SI: ' if doubts else ''}{doubts}"
            )

    def read(
        self, schema: Mapping[str, str], parts: Parts | None = None, *, known: Iterable[str] = ()
    ) -> dict[str, Any]:
        """The values of the given keys, converted by the kinds of a schema (see `ksd.scene.toml_schema`).

        parts: by "material", "section" and "joint" those of the file by name, None for parts with mistakes; ANY_NAME is
        among the names when there may be more. known: possible values of a missing key, for its message. A key that is
        missing, or has a wrong type, unit or name, is collected as a mistake.
        """
        self._known_keys |= schema.keys()
        values = {}
        for key, kind in schema.items():
            if key in self.values:
                had_gaps = self.has_gaps
                with self.collect_errors(with_unit_doubts=False):
                    values[key] = _value(self.values[key], kind.rstrip("!"), key, parts or {})
                    self._note_unit_doubt(key, kind, self.values[key])
                if key not in values and kind.rstrip("!") in _STAND_INS:
                    values[key], self.has_gaps = _STAND_INS[kind.rstrip("!")], had_gaps
            elif kind.endswith("!") and self._is_table:
                # a given key of a similar name is probably this one misspelt: one mistake, not two
                meant = [k for k in self.unread_keys() if similar_name_hint(key, [k], cutoff=0.7) != "."][:1]
                self._known_keys |= set(meant)
                mistake = (
                    f"key '{meant[0]}' is unknown; did you mean \"{key}\"?"
                    if meant
                    else f"key '{key}' is missing{': one of ' if known else ''}{', '.join(known)}."
                )
                self.note_mistake(f"{self.where}: {mistake}")
        return values

    def _note_unit_doubt(self, key: str, kind: str, value: Any) -> None:
        """Record a plain number that is probably in another unit."""
        dimension = kind.rstrip("!").partition("[")[0]
        for plain in _plain_numbers(value) if dimension in DIMENSIONS else ():
            unit = likely_unit(plain, dimension, key)
            if unit:
                si = next(iter(DIMENSIONS[dimension]))
                doubt = f"{key} = {plain:g} is {plain:g} {si}: did you mean '{plain:g} {unit}'?"
                self._unit_doubts.append(doubt)
                if self._file_mistakes is not None:
                    self._file_mistakes.unit_doubts.append((self.where, doubt))
                return

    def call(self, statement: Callable[..., T], words: Mapping[str, Any]) -> T:
        """The result of `statement(**words)`. Raises InvalidTable if this table has unknown keys or other mistakes.

        A SceneError of the statement is collected as a mistake of this table. It is also called for its mistakes alone,
        where only the material or section is not known.
        """
        self.note_unknown_keys()
        if not self.has_gaps:
            with self.collect_errors():
                made = statement(**words)
                if self.is_valid:
                    return made
        raise InvalidTable(f"{self.where}: see above")

    def table(self, key: str) -> Table:
        """A table inside this one, empty when absent."""
        child = self._child(self._read_key(key, {}), self._path_of(key))
        if self._row:
            # the row of the array this table is in belongs to its location
            child.where = f"{self.where}, [{self._path_of(key)}]"
        return child

    def tables(self, key: str) -> list[Table]:
        """The tables of an array [[key]], empty when absent."""
        values = self._read_key(key, [])
        if not isinstance(values, list):
            self.note_mistake(f"{self.where}: {key} = {show(values)} must be written as [[{key}]] tables.")
            return []
        return [self._child(v, self._path_of(key), i + 1) for i, v in enumerate(values)]

    def children(self) -> dict[str, Table]:
        """The tables inside this one by name, when it holds nothing else."""
        return {key: self._child(value, self._path_of(key)) for key, value in self.values.items()}

    def _child(self, values: Any, path: str, row: int = 0) -> Table:
        return Table(values, self._file, path, row, file_mistakes=self._file_mistakes)

    def unread_keys(self) -> list[str]:
        """Keys that were not read yet."""
        return [key for key in self.values if key not in self._known_keys]

    def note_unknown_keys(self) -> None:
        """Collect every key that was not read as a mistake, with the nearest known key."""
        for key in self.unread_keys():
            self.note_mistake(f"{self.where}: key '{key}' is unknown{name_hint(key, self._known_keys)}")

    def _read_key(self, key: str, default: Any) -> Any:
        self._known_keys.add(key)
        return self.values.get(key, default)


def make_each(make: Callable[[Any], T], tables: Iterable[Any]) -> list[T]:
    """`make(table)` for every table; an InvalidTable of one is raised after all tables were read."""
    made, invalid = [], None
    for table in tables:
        try:
            made.append(make(table))
        except InvalidTable as error:
            invalid = error
    if invalid is not None:
        raise invalid
    return made


def _plain_numbers(value: Any) -> Iterator[float]:
    """All plain numbers in a value or nested list."""
    if isinstance(value, list):
        for item in value:
            yield from _plain_numbers(item)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield float(value)


def _value(value: Any, kind: str, key: str, parts: Parts) -> Any:
    """One value converted by its kind; messages do not contain the location. Raises SceneError."""
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
    part = known.get(value) or _STAND_INS.get(kind)
    if part is None:
        raise InvalidTable(f"the {kind} '{value}' has a mistake of its own")
    return part


def in_unit_of(old: Any, value: float, unit: str = "", *, digits: int = 12) -> str | float:
    """A number [SI] as it is written in place of `old`: in the unit of a text, plain for a plain number, else in `unit`."""
    if isinstance(old, str) and parse_quantity(old):
        name = re.sub(r"^[-+.\deE ]+", "", plain_signs(old))
        unit = find_unit(name) or ""
        shown = name
    elif (isinstance(old, int | float) and old != 0) or not unit:
        return rounded(value, digits)
    else:
        shown = unit
    factor = next(units[unit] for units in DIMENSIONS.values() if unit in units)
    return f"{rounded(value / factor, digits):.{digits}g} {shown}"


def rounded(value: float, digits: int = 12) -> float:
    """A number without the rounding of its last digits."""
    return float(f"{value:.{digits}g}") + 0.0
