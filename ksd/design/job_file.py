"""Jobs in TOML files, in the words of `ksd.Job` and `ksd.optimise` and those of the scene.

    [job]              scene = "pivot.toml" (left out where the scene is in this file), link, at, maximise, minimise, limits,
                       rules = ["70 mm - joint.cross.widths[0]"], freed, modes, method, extrapolate, together
    [job.vary]         joint.cross.thickness = ["0.2 mm", "1 mm"]: least and most of a key of the scene; in a list of every
                       item that varies: joint.cross.widths = [["10 mm", "60 mm"], "20 mm"]
    [job.drives]       turn = ["0 deg", "15 deg", "30 deg"], or "0deg:30deg:3"; the values of the scene where it is left out
    [[job.loads.CASE]] link, force, moment, at, ...: as [[load]] of a scene
    [optimise]         start, starts, method, robust, seed, and [optimise.spread] joint.cross.thickness = "4 um"

Where the scene says "= formula" a number follows from others of it: at = ["= -0.5 * joint.cross.length", 0, 0]. Limits of
which one side is free say inf.
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
from ksd.design.bounds import first_buildable
from ksd.design.job import Job
from ksd.errors import SceneError
from ksd.files import named_file
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
from ksd.scene.toml_table import Table, error_location, quantity

JOB_KEYS = {
    "scene": "text", "link": "text", "at": "length[3]", "maximise": "any", "minimise": "any", "limits": "any",
    "rules": "any", "freed": "any", "modes": "any", "method": "text", "extrapolate": "flag", "together": "flag",
}  # fmt: skip
"""Keys of [job], beside its tables vary, drives and loads."""
OPTIMISE_KEYS = {"starts": "any", "method": "text", "robust": "number", "seed": "any"}
"""Keys of [optimise], beside its tables start and spread."""
MOST_POSES = 1000


class JobFile(NamedTuple):
    """A job, and the words of `ksd.optimise` that stand beside it."""

    job: Job
    words: dict[str, Any]


@dataclass(frozen=True, eq=False)
class VariedScene:
    """A function of parameters, numbers of a scene file by name, that returns its mechanism; known to other processes."""

    tables: Mapping[str, Any]
    file: Path
    varied: tuple[tuple[str, Keys], ...]
    formulas: tuple[Keys, ...]

    @property
    def __name__(self) -> str:
        return self.file.name

    def __call__(self, **parameters: float) -> Mechanism:
        return scene_from_tables(self.filled(parameters), self.file)[0]

    def filled(self, parameters: Mapping[str, float]) -> dict[str, Any]:
        """The tables with these numbers, formulas worked out."""
        tables: dict[str, Any] = _copied(self.tables)
        for name, keys in self.varied:
            _put(tables, keys, parameters[name])
        worked = [(keys, value_at(tables, keys, self.file.name)) for keys in self.formulas]
        with error_location(self.file.name):
            for keys, value in [(k, evaluate_formula(v.lstrip()[1:], tables)) for k, v in worked]:
                _put(tables, keys, value)
        return tables


@dataclass(frozen=True, eq=False)
class WrittenRule:
    """A formula of the numbers of a scene that must not be negative."""

    scene: VariedScene
    formula: str

    @property
    def __name__(self) -> str:
        return self.formula

    def __call__(self, parameters: Mapping[str, float]) -> float:
        return evaluate_formula(self.formula, self.scene.filled(parameters))


def load_job(path: str | os.PathLike[str], *, drives: Mapping[str, str] | None = None) -> JobFile:
    """Read a job file: the `ksd.Job`, and the words for `ksd.optimise(job, **words)`.

    drives: drive values in place of those of the file, by name, as text such as "0deg:30deg:3". Raises SceneError, naming
    file, table and key, for what is wrong in it, and what `ksd.Job` raises.
    """
    file = named_file(path, "job file")
    tables = read_tables(file)
    top = Table({k: tables.pop(k) for k in ("job", "optimise") if k in tables}, file.name)
    said, optimise = top.table("job"), top.table("optimise")
    if "job" not in top:
        raise SceneError(
            f"{file.name}: [job] is missing: say there what to vary, and what to maximise or to limit"
        )
    words = said.read(JOB_KEYS)
    tables, place = _scene_tables(tables, file, words.pop("scene", None))
    varied, bounds, fixed = _varied(said.table("vary"), tables)
    for keys, value in fixed:
        _put(tables, keys, value)
    formulas = tuple(keys for keys in _formulas(tables, ()) if keys not in varied.values())
    function = VariedScene(tables, place, tuple(varied.items()), formulas)

    def built(**parameters: float) -> tuple[Mechanism, dict[str, float]]:
        mechanism, targets, *_ = scene_from_tables(function.filled(parameters), place)
        mechanism.scene()
        return mechanism, targets

    mechanism, targets = first_buildable(built, bounds)
    for key in ("effects", "with", "without", "elements"):
        if key in tables.get("options", {}):
            raise SceneError(
                f"{place.name}, [options]: {key} = {show(tables['options'][key])} changes what is simulated, and a job "
                "takes none of it: say consider = ['warping', 'plate'] in the scene, elements in its leaves, or leave it out"
            )
    found = {d.name: d for d in mechanism.scene().drives}
    values = _drive_values(said.table("drives"), found, targets, drives or {})
    loads = _loads(said.table("loads"))
    said.note_unknown_keys()
    words |= {
        "rules": tuple(WrittenRule(function, rule) for rule in _texts(words.get("rules", []), said.where))
    }
    words |= {"limits": _limits(words.get("limits")), "loads": loads}
    with error_location(file.name):
        job = Job(function, vary=bounds, targets=values, **words)
    return JobFile(job, _optimise_words(optimise, varied))


def _copied(values: Any) -> Any:
    """Tables and lists anew; what they hold cannot change."""
    if isinstance(values, Mapping):
        return {k: _copied(v) for k, v in values.items()}
    return [_copied(v) for v in values] if isinstance(values, list) else values


def _scene_tables(tables: dict[str, Any], file: Path, name: str | None) -> tuple[dict[str, Any], Path]:
    """The tables of the scene, and the file they stand in."""
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


def _varied(
    vary: Table, tables: dict[str, Any]
) -> tuple[dict[str, Keys], dict[str, tuple[float, float]], list[tuple[Keys, float]]]:
    """Keys and bounds of every parameter by name, and keys of list items that [job.vary] fixes."""
    keys: dict[str, Keys] = {}
    bounds: dict[str, tuple[float, float]] = {}
    fixed: list[tuple[Keys, float]] = []
    for way, given in _leaves(vary.values, ()):
        with error_location(vary.where):
            place = _place(tables, way)
            here = _there(tables, place)
            if not isinstance(here, list):
                keys[format_keys(place)], bounds[format_keys(place)] = (
                    place,
                    _range(given, format_keys(place), here),
                )
                continue
            if (
                not isinstance(given, list)
                or len(given) != len(here)
                or not any(isinstance(g, list) for g in given)
            ):
                raise SceneError(
                    f"{format_keys(place)} = {show(given)}: it is a list of {len(here)} in the scene; give least and most "
                    'of every item that varies and a value of the others, such as [["10 mm", "60 mm"], "20 mm"]'
                )
            for k, (item, old) in enumerate(zip(given, here, strict=True)):
                name = format_keys((*place, k))
                if isinstance(item, list):
                    keys[name], bounds[name] = (*place, k), _range(item, name, old)
                else:
                    fixed.append(((*place, k), si_value(item, name)))
    if not keys:
        raise SceneError(
            f"{vary.where}: give least and most of what varies, joint.cross.thickness = ['0.2 mm', '1 mm']"
        )
    return keys, bounds, fixed


def _leaves(values: Mapping[str, Any], way: tuple[str, ...]) -> list[tuple[tuple[str, ...], Any]]:
    """What stands at the ends of nested tables, with its keys."""
    found = []
    for key, value in values.items():
        found += _leaves(value, (*way, key)) if isinstance(value, dict) else [((*way, key), value)]
    return found


def _place(tables: Any, way: Sequence[str]) -> Keys:
    """Keys of a place in the scene; the last one may be new to its table."""
    place: Keys = ()
    here = tables
    for k, key in enumerate(way):
        at = index_of(here, key)
        new = k == len(way) - 1 and isinstance(here, dict)
        if at is None or (isinstance(here, dict) and at not in here and not new):
            inside = f" in {format_keys(place)}" if place else ""
            raise SceneError(
                f"{'.'.join(way)}: there is no '{key}'{inside} in the scene{name_hint(key, known_keys(here))}"
            )
        # arrays of tables are counted from 1
        place = (*place, key if isinstance(at, str) or not key.isdecimal() else int(key))
        here = None if new and at not in here else here[at]
    return place


def _there(tables: Any, place: Keys) -> Any:
    """What stands at a place, None where it is new."""
    parent = value_at(tables, place[:-1], "")
    return parent.get(place[-1]) if isinstance(parent, dict) else value_at(tables, place, "")


def _range(given: Any, name: str, old: Any) -> tuple[float, float]:
    """Least and most of a parameter that is `old` in the scene."""
    if not isinstance(given, list) or len(given) != 2:
        raise SceneError(f"{name} = {show(given)}: give least and most, such as ['0.2 mm', '1 mm']")
    wanted = dimension_of(old)
    for end in given:
        if wanted is not None and isinstance(end, str):
            quantity(end, wanted, name)
    low, high = (si_value(end, name) for end in given)
    return low, high


def _put(tables: Any, keys: Keys, value: float) -> None:
    """Write a number at its place."""
    parent = value_at(tables, keys[:-1], "")
    parent[index_of(parent, keys[-1])] = value


def _formulas(values: Any, way: Keys) -> list[Keys]:
    """Keys of every text that begins with "="."""
    if isinstance(values, dict):
        pairs: list[tuple[str | int, Any]] = list(values.items())
    elif isinstance(values, list):
        of_tables = bool(values) and all(isinstance(v, dict) for v in values)
        pairs = [(n + of_tables, v) for n, v in enumerate(values)]
    else:
        return [way] if isinstance(values, str) and values.lstrip().startswith("=") else []
    return [keys for key, value in pairs for keys in _formulas(value, (*way, key))]


def _drive_values(
    drives: Table, known: Mapping[str, Drive], targets: Mapping[str, float], given: Mapping[str, str]
) -> dict[str, Any]:
    """Drive values (n,) by name."""
    said = drives.values | dict(given) if drives.values or given else dict(targets)
    if not said:
        raise SceneError(
            f"{drives.where}: the scene names no drive values; give them, such as turn = ['0 deg', '30 deg']"
        )
    found = {}
    for name, value in said.items():
        with error_location(drives.where):
            if name not in known:
                raise SceneError(f"there is no drive '{name}'{name_hint(name, known)}")
            found[name] = _stroke(value, known[name].dimension, name)
    return {**targets, **found}


def _stroke(value: Any, dimension: str, name: str) -> Any:
    """Values of a drive: one, several, or text FROM:TO:POSES."""
    if isinstance(value, str) and ":" in value:
        low, _, rest = value.partition(":")
        high, _, count = rest.partition(":")
        if not count.strip().isdecimal() or not 2 <= int(count) <= MOST_POSES:
            raise SceneError(
                f"{name} = {show(value)}: write a range as FROM:TO:POSES, such as '0deg:30deg:3'"
            )
        return np.linspace(quantity(low, dimension, name), quantity(high, dimension, name), int(count))
    items = value if isinstance(value, list) else [value]
    return np.array([quantity(_number(v), dimension, name) for v in items])


def _number(value: Any) -> Any:
    """Text that is a plain number, as on a command line, as that number."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def _loads(table: Table) -> dict[str, list[dict[str, Any]]] | None:
    """Loads by case."""
    cases: dict[str, list[dict[str, Any]]] = {}
    for case in table.values:
        cases[case] = []
        for one in table.tables(case):
            cases[case].append(one.read(schema.STATEMENTS["load"]))
            one.note_unknown_keys()
    return cases or None


def _texts(value: Any, where: str) -> list[str]:
    if not isinstance(value, list) or not all(isinstance(v, str) for v in value):
        raise SceneError(
            f"{where}: rules = {show(value)}: give formulas that must not be negative, ['70 mm - joint.cross.length']"
        )
    return value


def _limits(given: Any) -> Any:
    """Limits with None for a side that is free."""
    if not isinstance(given, dict):
        return given

    def free(value: Any) -> Any:
        return None if isinstance(value, float) and math.isinf(value) else value

    return {
        k: tuple(free(v) for v in value) if isinstance(value, list) else value for k, value in given.items()
    }


def _optimise_words(table: Table, varied: Mapping[str, Keys]) -> dict[str, Any]:
    """The words of `ksd.optimise` in [optimise]."""
    words = table.read(OPTIMISE_KEYS)
    for key in ("start", "spread"):
        inside = table.table(key)
        own: dict[str, float] = {}
        for way, value in _leaves(inside.values, ()):
            name = next((n for n, keys in varied.items() if _same(keys, way)), format_keys(way))
            with error_location(inside.where):
                if isinstance(value, list):
                    # items that do not vary have a place in the list, and nothing to be said of
                    items = {f"{name}[{k}]": v for k, v in enumerate(value)}
                    own |= {n: si_value(v, n) for n, v in items.items() if n in varied}
                else:
                    own[name] = si_value(value, name)
        if own:
            words[key] = own
    table.note_unknown_keys()
    return words


def _same(keys: Keys, way: Sequence[str]) -> bool:
    return [str(k) for k in keys] == list(way)
