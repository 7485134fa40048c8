"""Jobs in TOML files, with the arguments of `ksd.Job` and `ksd.optimise` and the keys of the scene.

    [job]              scene = "pivot.toml" (left out where the scene is in this file), link, at, along, maximise, minimise,
                       limits, rules = ["70 mm - joint.cross.widths[0]"], freed, modes, damping, method, extrapolate,
                       together
    [job.vary]         joint.cross.thickness = ["0.2 mm", "1 mm"]: least and most of a key of the scene; of a list, those of
                       every item that varies: joint.cross.widths = [["10 mm", "60 mm"], "20 mm"]
    [job.drives]       turn = ["0 deg", "15 deg", "30 deg"], or "0deg:30deg:3"; by default the values of the scene
    [job.psd]          "base y" = [["1 Hz", 1e-3], ["200 Hz", 1e-3]]: spectra of rms values
    [[job.loads.CASE]] link, force, moment, at, ...: as [[load]] of a scene
    [optimise]         start, starts, method, robust, seed, and [optimise.spread] joint.cross.thickness = "4 um"

A text "= formula" in the scene is a number that follows from others: at = ["= -0.5 * joint.cross.length", 0, 0]. The side of
a limit that is free is inf.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ksd.checks import name_hint, show
from ksd.errors import SceneError
from ksd.files import named_file
from ksd.optimisation.bounds import first_buildable
from ksd.optimisation.job import Job
from ksd.scene import toml_schema as schema
from ksd.scene.drive import Drive
from ksd.scene.formula import (
    Keys,
    dimension_of,
    evaluate_formula,
    format_keys,
    index_of,
    known_keys,
    si_value,
    value_at,
)
from ksd.scene.mechanism import Mechanism
from ksd.scene.toml_file import read_tables, scene_from_tables
from ksd.scene.toml_table import Table, error_location, in_unit_of, quantity
from ksd.scene.toml_writer import toml_tree_lines

JOB_KEYS = {
    "scene": "text", "link": "text", "at": "length[3]", "along": "direction", "maximise": "any", "minimise": "any",
    "limits": "any", "rules": "any", "freed": "any", "modes": "any", "damping": "any", "psd": "any", "method": "text",
    "extrapolate": "flag", "together": "flag",
}  # fmt: skip
"""Keys of [job] with their kinds, without its tables vary, drives and loads."""
OPTIMISE_KEYS = {"starts": "any", "method": "text", "robust": "number", "seed": "any"}
"""Keys of [optimise] with their kinds, without its tables start and spread."""
DIGITS = 7
"""Digits of numbers of an optimum that are written to a scene file."""
MAX_POSES = 1000
"""Largest number of poses of a range FROM:TO:POSES."""


class JobFile(NamedTuple):
    """A job, and the keyword arguments `words` of `ksd.optimise` from the same file.

    >>> file = ksd.load_job("pivot_job")
    >>> file.job.vary["joint.cross.length"], file.words["starts"]
    ((0.04, 0.08), 2)
    """

    job: Job
    words: dict[str, Any]


@dataclass(frozen=True, eq=False)
class VariedScene:
    """A function of parameters, which are numbers of a scene file, that returns its mechanism; it can be pickled.

    tables: of the scene; file: that they are from; varied: parameter names and their keys; formulas: keys of formulas.
    """

    tables: Mapping[str, Any]
    file: Path
    varied: tuple[tuple[str, Keys], ...]
    formulas: tuple[Keys, ...]

    @property
    def __name__(self) -> str:
        return self.file.name

    def __call__(self, **parameters: float) -> Mechanism:
        return scene_from_tables(self.filled_tables(parameters), self.file)[0]

    def filled_tables(self, parameters: Mapping[str, float]) -> dict[str, Any]:
        """The tables with values of the parameters and of all formulas."""
        tables: dict[str, Any] = _copy_tables(self.tables)
        for name, keys in self.varied:
            _set_value(tables, keys, parameters[name])
        formulas = [(keys, value_at(tables, keys, self.file.name)) for keys in self.formulas]
        with error_location(self.file.name):
            # all formulas are evaluated before the first value is set
            for keys, value in [(k, evaluate_formula(v.lstrip()[1:], tables)) for k, v in formulas]:
                _set_value(tables, keys, value)
        return tables

    def written(self, parameters: Mapping[str, float], values: Mapping[str, float]) -> str:
        """Text of a scene file with these parameters and drive values, in the units of what they replace."""
        tables = self.filled_tables(parameters)
        for keys in (*self.formulas, *(keys for _, keys in self.varied)):
            new = in_unit_of(_value_or_none(self.tables, keys), _value_or_none(tables, keys), digits=DIGITS)
            _set_value(tables, keys, new)
        drives = self(**parameters).scene().drives
        for drive, table in zip(drives, tables.get("actuate", ()), strict=True):
            if drive.name in values:
                unit = {"length": "mm", "angle": "deg"}.get(drive.dimension, "")
                table["value"] = in_unit_of(table.get("value"), values[drive.name], unit, digits=DIGITS)
        return "\n".join(toml_tree_lines(tables, "")) + "\n"


@dataclass(frozen=True, eq=False)
class FormulaRule:
    """A rule of a job: a formula of the numbers of a scene that must not be negative."""

    scene: VariedScene
    formula: str

    @property
    def __name__(self) -> str:
        return self.formula

    def __call__(self, parameters: Mapping[str, float]) -> float:
        return evaluate_formula(self.formula, self.scene.filled_tables(parameters))


class _Varied(NamedTuple):
    """Keys, bounds (SI, and as written) of the parameters by name; keys and values of list items that [job.vary] fixes."""

    keys: dict[str, Keys]
    bounds: dict[str, tuple[float, float]]
    written: dict[str, tuple[float | str, float | str]]
    fixed: list[tuple[Keys, float]]


def load_job(path: str | os.PathLike[str], *, drives: Mapping[str, str] | None = None) -> JobFile:
    """Read a job file: a `ksd.Job`, and the keyword arguments for `ksd.optimise(job, **words)`.

    path: of the file, or the name alone of a shipped job, where no file has it. drives: drive values by name that replace
    those of the file, as text such as "0deg:30deg:3". Raises SceneError with
    file, table and key for what is wrong in the file, and what `ksd.Job` raises.

    >>> job, words = ksd.load_job("pivot_job", drives={"turn": "0deg:30deg:3"})
    >>> job.vary["joint.cross.length"], words["starts"]
    ((0.04, 0.08), 2)
    """
    file = named_file(path, "job file")
    tables = read_tables(file)
    top = Table({k: tables.pop(k) for k in ("job", "optimise") if k in tables}, file.name)
    job_table, optimise_table = top.table("job"), top.table("optimise")
    if "job" not in top:
        raise SceneError(
            f"{file.name}: [job] is missing: say there what to vary, and what to maximise or to limit"
        )
    words = job_table.read(JOB_KEYS)
    tables, scene_file = _scene_tables(tables, file, words.pop("scene", None))
    varied = _parse_vary(job_table.table("vary"), tables)
    for keys, value in varied.fixed:
        _set_value(tables, keys, value)
    formulas = tuple(keys for keys in _formula_keys(tables, ()) if keys not in varied.keys.values())
    function = VariedScene(tables, scene_file, tuple(varied.keys.items()), formulas)

    def build(**parameters: float) -> tuple[Mechanism, dict[str, float]]:
        mechanism, targets, *_ = scene_from_tables(function.filled_tables(parameters), scene_file)
        mechanism.scene()
        return mechanism, targets

    mechanism, targets = first_buildable(build, varied.bounds)
    for key in ("effects", "with", "without", "elements"):
        if key in tables.get("options", {}):
            raise SceneError(
                f"{scene_file.name}, [options]: {key} = {show(tables['options'][key])} changes what is simulated, and a job "
                "takes none of it: say consider = ['warping', 'plate'] in the scene, elements in its leaves, or leave it out"
            )
    known_drives = {d.name: d for d in mechanism.scene().drives}
    values = _drive_values(job_table.table("drives"), known_drives, targets, drives or {})
    loads = _load_cases(job_table.table("loads"))
    job_table.note_unknown_keys()
    formulas_of_rules = _formula_texts(words.get("rules", []), job_table.where)
    words["rules"] = tuple(FormulaRule(function, formula) for formula in formulas_of_rules)
    words |= {"limits": _limits(words.get("limits")), "loads": loads}
    if isinstance(words.get("psd"), dict):
        with error_location(job_table.where):
            words["psd"] = {name: _spectrum(knots, name) for name, knots in words["psd"].items()}
    with error_location(file.name):
        job = Job(function, vary=varied.written, targets=values, **words)
    return JobFile(job, _optimise_words(optimise_table, varied.keys))


def _copy_tables(values: Any) -> Any:
    """Copy of nested tables and lists; other values are immutable."""
    if isinstance(values, Mapping):
        return {k: _copy_tables(v) for k, v in values.items()}
    return [_copy_tables(v) for v in values] if isinstance(values, list) else values


def _scene_tables(tables: dict[str, Any], file: Path, name: str | None) -> tuple[dict[str, Any], Path]:
    """The tables of the scene, and the file they are from; name: of a scene file in [job]. Raises SceneError."""
    if name is None:
        if not tables:
            raise SceneError(
                f"{file.name}, [job]: name a scene file, scene = 'pivot.toml', or write the scene here"
            )
        return tables, file
    if tables:
        raise SceneError(
            f"{file.name}: [job] names the scene file '{name}', but '{next(iter(tables))}' stands here too; keep one of them"
        )
    return read_tables(file.parent / name), file.parent / name


def _parse_vary(vary: Table, tables: dict[str, Any]) -> _Varied:
    """The parameters of [job.vary]; tables: of the scene. Raises SceneError."""
    varied = _Varied({}, {}, {}, [])
    for path, given in _values_with_paths(vary.values, ()):
        with error_location(vary.where):
            # a quoted key with dots is meant as without quotation marks: no table of a scene has dots
            keys = _resolve_keys(tables, [*path[0].split("."), *path[1:]])
            value = _value_or_none(tables, keys)
            name = format_keys(keys)
            if not isinstance(value, list):
                varied.keys[name], varied.bounds[name] = keys, _parse_range(given, name, value)
                varied.written[name] = tuple(given)
                continue
            if (
                not isinstance(given, list)
                or len(given) != len(value)
                or not any(isinstance(g, list) for g in given)
            ):
                raise SceneError(
                    f"{name} = {show(given)}: it is a list of {len(value)} in the scene; give least and most "
                    'of every item that varies and a value of the others, such as [["10 mm", "60 mm"], "20 mm"]'
                )
            for k, (item, old) in enumerate(zip(given, value, strict=True)):
                item_keys = (*keys, k)
                name = format_keys(item_keys)
                if isinstance(item, list):
                    varied.keys[name], varied.bounds[name] = item_keys, _parse_range(item, name, old)
                    varied.written[name] = tuple(item)
                else:
                    varied.fixed.append((item_keys, si_value(item, name)))
    if not varied.keys:
        raise SceneError(
            f"{vary.where}: give least and most of what varies, joint.cross.thickness = ['0.2 mm', '1 mm']"
        )
    return varied


def _values_with_paths(values: Mapping[str, Any], path: tuple[str, ...]) -> list[tuple[tuple[str, ...], Any]]:
    """Values of nested tables that are no tables, each with its path of keys, which begins with `path`."""
    pairs = []
    for key, value in values.items():
        own = (*path, key)
        pairs += _values_with_paths(value, own) if isinstance(value, dict) else [(own, value)]
    return pairs


def _resolve_keys(tables: Any, path: Sequence[str]) -> Keys:
    """Keys in the scene of a path written in [job.vary]; the last key may be new to its table. Raises SceneError."""
    keys: Keys = ()
    values = tables
    for k, key in enumerate(path):
        index = index_of(values, key)
        may_be_new = k == len(path) - 1 and isinstance(values, dict)
        if index is None or (isinstance(values, dict) and index not in values and not may_be_new):
            inside = f" in {format_keys(keys)}" if keys else ""
            raise SceneError(
                f"{'.'.join(path)}: there is no '{key}'{inside} in the scene{name_hint(key, known_keys(values))}"
            )
        # arrays of tables are counted from 1
        keys = (*keys, key if isinstance(index, str) or not key.isdecimal() else int(key))
        values = None if may_be_new and index not in values else values[index]
    return keys


def _value_or_none(tables: Any, keys: Keys) -> Any:
    """The value at keys, None where the last key is new to its table."""
    parent = value_at(tables, keys[:-1], "")
    return parent.get(keys[-1]) if isinstance(parent, dict) else value_at(tables, keys, "")


def _parse_range(given: Any, name: str, old: Any) -> tuple[float, float]:
    """Least and most of a parameter, SI; old: its value in the scene, whose dimension it has. Raises SceneError."""
    if not isinstance(given, list) or len(given) != 2:
        raise SceneError(f"{name} = {show(given)}: give least and most, such as ['0.2 mm', '1 mm']")
    dimension = dimension_of(old)
    for end in given:
        if dimension is not None and isinstance(end, str):
            quantity(end, dimension, name)
    low, high = (si_value(end, name) for end in given)
    return low, high


def _set_value(tables: Any, keys: Keys, value: float | str) -> None:
    """Set the number at keys, or its text, in place."""
    parent = value_at(tables, keys[:-1], "")
    parent[index_of(parent, keys[-1])] = value


def _formula_keys(values: Any, keys: Keys) -> list[Keys]:
    """Keys of every text that begins with "=" in values, which are at `keys`."""
    if isinstance(values, dict):
        pairs: list[tuple[str | int, Any]] = list(values.items())
    elif isinstance(values, list):
        of_tables = bool(values) and all(isinstance(v, dict) for v in values)
        pairs = [(n + of_tables, v) for n, v in enumerate(values)]
    else:
        return [keys] if isinstance(values, str) and values.lstrip().startswith("=") else []
    return [found for key, value in pairs for found in _formula_keys(value, (*keys, key))]


def _drive_values(
    table: Table, known: Mapping[str, Drive], targets: Mapping[str, float], given: Mapping[str, str]
) -> dict[str, Any]:
    """Drive values (n,) by name: `targets` of the scene, replaced by those of [job.drives] and by `given`.

    known: drives of the scene by name. Raises SceneError.
    """
    texts = table.values | dict(given) if table.values or given else dict(targets)
    if not texts:
        raise SceneError(
            f"{table.where}: the scene names no drive values; give them, such as turn = ['0 deg', '30 deg']"
        )
    values = {}
    for name, text in texts.items():
        with error_location(table.where):
            if name not in known:
                raise SceneError(f"there is no drive '{name}'{name_hint(name, known)}")
            values[name] = _parse_drive_values(text, known[name].dimension, name)
    return {**targets, **values}


def _parse_drive_values(value: Any, dimension: str, name: str) -> Any:
    """Values (n,) of a drive from one value, several, or text FROM:TO:POSES. Raises SceneError."""
    if isinstance(value, str) and ":" in value:
        low, _, rest = value.partition(":")
        high, _, count = rest.partition(":")
        if not count.strip().isdecimal() or not 2 <= int(count) <= MAX_POSES:
            raise SceneError(
                f"{name} = {show(value)}: write a range as FROM:TO:POSES, such as '0deg:30deg:3'"
            )
        return np.linspace(quantity(low, dimension, name), quantity(high, dimension, name), int(count))
    items = value if isinstance(value, list) else [value]
    return np.array([quantity(_plain_number(v), dimension, name) for v in items])


def _plain_number(value: Any) -> Any:
    """The number in text without a unit, as from a command line; other values unchanged."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def _load_cases(table: Table) -> dict[str, list[dict[str, Any]]] | None:
    """Loads by load case; None without any."""
    cases: dict[str, list[dict[str, Any]]] = {}
    for case in table.values:
        cases[case] = []
        for load in table.tables(case):
            cases[case].append(load.read(schema.STATEMENTS["load"]))
            load.note_unknown_keys()
    return cases or None


def _formula_texts(value: Any, where: str) -> list[str]:
    """The list of formulas of the rules. Raises SceneError."""
    if not isinstance(value, list) or not all(isinstance(v, str) for v in value):
        raise SceneError(
            f"{where}: rules = {show(value)}: give formulas that must not be negative, ['70 mm - joint.cross.length']"
        )
    return value


def _spectrum(knots: Any, name: str) -> Any:
    """Points of a spectrum with their frequencies [Hz] as numbers; what is no list of pairs unchanged."""
    if not isinstance(knots, list) or not all(isinstance(k, list) and len(k) == 2 for k in knots):
        return knots
    return [(quantity(f, "frequency", f"psd of '{name}'"), density) for f, density in knots]


def _limits(given: Any) -> Any:
    """Limits with None in place of inf; anything but a table unchanged."""
    if not isinstance(given, dict):
        return given

    def none_for_infinite(value: Any) -> Any:
        return None if isinstance(value, float) and math.isinf(value) else value

    return {
        k: tuple(none_for_infinite(v) for v in value) if isinstance(value, list) else value
        for k, value in given.items()
    }


def _optimise_words(table: Table, varied: Mapping[str, Keys]) -> dict[str, Any]:
    """The keyword arguments of `ksd.optimise` in [optimise]; varied: keys of the parameters by name."""
    words = table.read(OPTIMISE_KEYS)
    for key in ("start", "spread"):
        subtable = table.table(key)
        own: dict[str, float] = {}
        for path, value in _values_with_paths(subtable.values, ()):
            same_path = (name for name, keys in varied.items() if tuple(map(str, keys)) == path)
            name = next(same_path, format_keys(path))
            with error_location(subtable.where):
                if isinstance(value, list):
                    # of a list, items that do not vary are ignored
                    items = {f"{name}[{k}]": v for k, v in enumerate(value)}
                    own |= {n: si_value(v, n) for n, v in items.items() if n in varied}
                else:
                    own[name] = si_value(value, name)
        if own:
            words[key] = own
    table.note_unknown_keys()
    return words
