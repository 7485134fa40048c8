"""Text of a scene file kept as it is but for what has changed: comments, order and units; and the same in Python.

Tables are those of `tomllib`: text with units stays text. A number that replaces one with a unit is written in that unit.
"""

from __future__ import annotations

import re
from typing import Any

from ksd.errors import SceneError
from ksd.extras import live_package
from ksd.scene.families import joint_families
from ksd.scene.toml_schema import STATEMENTS
from ksd.scene.toml_table import find_unit, parse_quantity, plain_signs, rounded
from ksd.units import DIMENSIONS


def rewritten(text: str, tables: dict[str, Any]) -> str:
    """The text of a scene file with these tables; what has not changed stays as it was written."""
    toml = live_package("tomlkit")
    document = toml.parse(text)
    _merge(document, tables)
    written: str = toml.dumps(document)
    return written if written.endswith("\n") or not written else written + "\n"


def _merge(node: Any, tables: dict[str, Any]) -> None:
    """Change a table of tomlkit to have these contents."""
    for key in [k for k in node if k not in tables]:
        del node[key]
    for key, value in tables.items():
        if key not in node:
            node[key] = _item(value)
        elif isinstance(value, dict) and isinstance(node[key], dict):
            _merge(node[key], value)
        elif _is_array_of_tables(value) and _is_array_of_tables(node[key]):
            _merge_array(node, key, value)
        elif isinstance(value, list) and isinstance(node[key], list) and len(value) == len(node[key]):
            for k, one in enumerate(value):
                if node[key][k] != one or type(node[key][k].unwrap()) is not type(one):
                    node[key][k] = one
        elif node[key] != value:
            node[key] = _item(value)


def _is_array_of_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(v, dict) for v in value)


def _merge_array(node: Any, key: str, rows: list[dict[str, Any]]) -> None:
    """Change the array of tables `key`; rows are known by their names, those without by their place."""
    old = list(node[key])
    if len(rows) < len(old):
        names = [r.get("name") for r in rows]
        gone = [
            k
            for k, r in enumerate(old)
            if r not in rows and (r.get("name") is None or r.get("name") not in names)
        ]
        for k in reversed(gone[len(rows) - len(old) :]):
            del node[key][k]
    for table, row in zip(list(node[key]), rows, strict=False):
        _merge(table, row)
    for row in rows[len(list(node[key])) :]:
        node[key].append(_item(row))


def _item(value: Any) -> Any:
    """An item of tomlkit, nested tables as tables of their own."""
    toml = live_package("tomlkit")
    if isinstance(value, dict):
        table = toml.table()
        for key, one in value.items():
            table[key] = _item(one)
        return table
    if _is_array_of_tables(value):
        array = toml.aot()
        for row in value:
            array.append(_item(row))
        return array
    return toml.item(value)


_CLASSES = {"material": "ksd.Material", "rectangle": "ksd.section.rectangle", "circle": "ksd.section.circle",
            "tube": "ksd.section.tube", "polygon": "ksd.section.polygon", "numbers": "ksd.section.numbers",
            "arc": "ksd.Arc", "sine": "ksd.FreeCurve.sine", "legendre": "ksd.FreeCurve.legendre",
            "spline": "ksd.FreeCurve.spline", "taper": "ksd.Taper", "circular_notch": "ksd.CircularNotch",
            "filleted_notch": "ksd.FilletedNotch", "stiffened_middle": "ksd.StiffenedMiddle"}  # fmt: skip
"""Python of a part by its kind in a scene file."""


def python_text(tables: dict[str, Any]) -> str:
    """A Python program that makes and solves the mechanism of these tables. Raises SceneError for words that only files
    have."""
    units: set[str] = set()
    name = str(tables.get("name", "mechanism"))
    plane = f", plane={tables['plane']!r}" if tables.get("plane") else ""
    lines, parts = [f"m = ksd.Mechanism({name!r}{plane})"], dict[tuple[str, str], str]()
    lines += [f"m.link({link!r})" for link in tables.get("links", ())]
    if tables.get("gravity"):
        lines.append(f"m.gravity = {_python(tables['gravity'], units)}")
    if tables.get("consider"):
        lines.append(f"m.consider({', '.join(map(repr, tables['consider']))})")
    used: set[str] = {"m", "ksd"}
    for kind in ("material", "section", "joint"):
        for label, table in tables.get(kind, {}).items():
            words = {k: v for k, v in table.items() if k not in ("kind", "family")}
            if table.get("family") == "drawn" or "blocks" in table:
                raise SceneError(
                    f"joint '{label}' is drawn in the file: ksd.load_scene reads it, no Python is made of it."
                )
            made = (
                _CLASSES.get(table.get("kind", kind)) or f"ksd.{joint_families()[table['family']].__name__}"
            )
            words = words | {"name": words.get("name", label)} if kind == "material" else words
            variable = re.sub(r"\W|^(?=\d)", "_", label)
            while variable in used:
                variable += "_"
            used.add(variable)
            parts[kind, label] = variable
            lines.append(f"{variable} = {made}({_words(words, units, parts)})")
    targets: dict[str, Any] = {}
    for statement in STATEMENTS:
        for table in tables.get(statement, ()):
            words = dict(table)
            if statement == "actuate" and "value" in words:
                targets[f"{len(targets)}"] = words.pop("value")
            if statement == "leaf" and "section" not in words and "thickness" in words:
                size = ", ".join(_python(words.pop(k), units) for k in ("thickness", "width"))
                words["section"] = _Code(f"ksd.section.rectangle({size})")
            for key in ("curve", "profile"):
                if isinstance(words.get(key), dict):
                    own = dict(words[key])
                    words[key] = _Code(f"{_CLASSES[own.pop('kind')]}({_words(own, units, parts)})")
            if "terms" in words:
                words["terms"] = [_Code(f"{_python(t.get('coefficient', 1), units)} * m.component("
                                        f"{_words({k: v for k, v in t.items() if k != 'coefficient'}, units, parts)})")
                                  for t in words["terms"]]  # fmt: skip
            call = f"m.{statement}({_words(words, units, parts)})"
            lines.append(
                f"drive{len(targets)} = {call}" if statement == "actuate" and "value" in table else call
            )
    values = ", ".join(f"drive{int(k) + 1}.name: {_python(v, units)}" for k, v in targets.items())
    lines.append(f"print(ksd.solve(m{', {' + values + '}' if values else ''}))")
    head = ["import ksd"]
    if units:
        head.append(f"from ksd.units import {', '.join(sorted(units))}")
    return "\n".join([*head, "", *lines, ""])


class _Code(str):
    """Text that is Python already."""


def _words(words: dict[str, Any], units: set[str], parts: dict[tuple[str, str], str]) -> str:
    """Keyword arguments, names of parts as their variables."""
    return ", ".join(f"{k}={parts.get((k, v)) if isinstance(v, str) and (k, v) in parts else _python(v, units)}"
                     for k, v in words.items())  # fmt: skip


def _python(value: Any, units: set[str]) -> str:
    """A value in Python, text with a unit as a product with `ksd.units`."""
    if isinstance(value, _Code):
        return str(value)
    if isinstance(value, list):
        return f"[{', '.join(_python(v, units) for v in value)}]"
    parsed = parse_quantity(value) if isinstance(value, str) else None
    if parsed is None:
        return repr(value)
    from ksd import units as known

    match = re.fullmatch(r"([-+.\deE]+)\s*(.*)", plain_signs(value))
    unit = find_unit(match[2]) if match else None
    if (
        match is None
        or unit is None
        or not hasattr(known, unit)
        or getattr(known, unit) != DIMENSIONS[parsed[1]][unit]
    ):
        return repr(rounded(parsed[0]))
    units.add(unit)
    return f"{match[1]} * {unit}"
