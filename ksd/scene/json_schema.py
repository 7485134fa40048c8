"""The JSON schema (draft 7) of scene and job files for completion and checks in editors, from `ksd.scene.toml_schema`."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from ksd import section
from ksd.checks import NUMBER_PATTERN
from ksd.scene import toml_schema as schema
from ksd.scene.effects import OPTIONAL_EFFECTS
from ksd.scene.families import joint_families
from ksd.scene.functions_of_time import KINDS as FUNCTION_KINDS
from ksd.scene.hinges import PLANES
from ksd.scene.joint import DrawnJoint
from ksd.scene.material import Material
from ksd.scene.mechanism import Mechanism
from ksd.scene.simulation import Event, Shake, Simulation
from ksd.scene.toml_schema import SHAPE_CLASSES
from ksd.scene.toml_table import POWER_PATTERN, has_exact_prefix, unit_pattern
from ksd.units import DIMENSIONS

Tree = dict[str, Any]
"""A JSON schema, or part of one."""
_JSON_TYPES = {str: "string", float: "number", int: "integer", bool: "boolean"}
_NAMED_KINDS = ("material", "section", "joint")
_JSON_TYPE_OF_KIND = {"number": "number", "text": "string", "flag": "boolean"} | dict.fromkeys(
    _NAMED_KINDS, "string"
)


def json_schema(
    options: Mapping[str, type] | None = None, jobs: tuple[schema.Schema, schema.Schema] | None = None
) -> Tree:
    """The schema as a tree of dictionaries and lists.

    options: keys of [options] with their types, any when None; jobs: keys of [job] and of [optimise], for the schema of job
    files. It covers tables, keys, types, units and required keys; names and values are checked by the reader.
    """
    statements = {name: {"type": "array", "items": _statement_schema(name)} for name in schema.STATEMENTS}
    top = _table_schema(
        schema.TOP,
        plane={"enum": list(PLANES)},
        consider={"type": "array", "items": {"enum": list(OPTIONAL_EFFECTS)}},
        material=_tables_by_name(_table_schema(schema.MATERIAL, about=Material)),
        section=_tables_by_name(
            _one_of("kind", {k: (getattr(section, k), keys) for k, keys in schema.SECTIONS.items()})
        ),
        joint=_tables_by_name(_joint_schema()),
        options=_options_schema(options),
        simulate=_simulate_schema(),
        report=_table_schema(schema.REPORT),
        **statements,
    )
    scenes = {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "Scene file of ksd",
        **top,
        "definitions": _definitions(),
    }
    return scenes if jobs is None else _job_schema(scenes, *jobs)


def _job_schema(scenes: Tree, job: schema.Schema, optimise: schema.Schema) -> Tree:
    """The schema of job files from that of scenes: the scene may be in another file, and its numbers may be formulas."""
    schema_of_jobs: Tree = _with_formulas(scenes) | {"title": "Job file of ksd", "required": ["job"]}
    by_name: Tree = {"type": "object"}
    cases = _tables_by_name({"type": "array", "items": _table_schema(schema.STATEMENTS["load"])})
    schema_of_jobs["properties"] |= {
        "job": _table_schema(job, vary=by_name, drives=by_name, loads=cases),
        "optimise": _table_schema(optimise, start=by_name, spread=by_name),
    }
    return schema_of_jobs


def _with_formulas(tree: Any) -> Any:
    """The schema `tree` with "= formula" allowed for every number."""
    if isinstance(tree, list):
        return [_with_formulas(item) for item in tree]
    if not isinstance(tree, dict):
        return tree
    if tree == {"type": "number"}:
        return {"anyOf": [tree, {"type": "string", "pattern": r"^\s*="}]}
    return {key: _with_formulas(value) for key, value in tree.items()}


_NUMBER = (
    r"(?:[+−–-]?\d{1,3}(?:[\s'’]\d{3})+(?:\.\d*)?"
    f"|{NUMBER_PATTERN.replace('[+-]', '[+−–-]')})(?:{POWER_PATTERN.replace('[+-]', '[+−–-]')})?"
)
"""A number with typographic signs."""


def _in_any_case(unit: str) -> str:
    """`unit_pattern` in upper and lower case, without other prefixes, as `ksd.scene.toml_table.find_unit` reads it."""

    def both(part: re.Match[str]) -> str:
        letter = part[0]
        return letter.replace("u", "uU") if len(letter) > 1 else f"[{letter.lower()}{letter.upper()}]"

    pattern = re.sub(r"\\.|\[[^]]*\]|[A-Za-z]", both, unit_pattern(unit))
    if unit[0] not in "mM" or not unit[1:2].isalpha():
        return pattern
    other = unit[0].swapcase()
    return f"(?!{other}{'' if has_exact_prefix(unit) else rf'{unit_pattern(unit[1:])}{chr(92)}s*$'}){pattern}"


def _definitions() -> Tree:
    """Definitions of quantities by dimension, single or in lists of any depth, and of directions."""
    definitions: Tree = {}
    for dimension, units in DIMENSIONS.items():
        units_pattern = "|".join(map(_in_any_case, units))
        si, *others = units
        definitions[dimension] = {
            "description": f"{dimension}: a number in {si}, or text with a unit: {', '.join([si, *others])}",
            "anyOf": [
                {"type": "number"},
                {"type": "string", "pattern": rf"^\s*{_NUMBER}\s*(?:{units_pattern})\s*$"},
            ],
        }
        lists = {"type": "array", "items": {"$ref": f"#/definitions/{dimension}[]"}}
        definitions[f"{dimension}[]"] = {"anyOf": [{"$ref": f"#/definitions/{dimension}"}, lists]}
    axes = {"enum": [f"{sign}{axis}" for axis in "xyz" for sign in ("", "+", "-")]}
    three = {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}
    definitions["direction"] = {
        "description": 'a direction: "x", "-z" or three numbers',
        "anyOf": [axes, three],
    }
    return definitions


def _value_schema(kind: str) -> Tree:
    """Schema of the values of a kind, see `ksd.scene.toml_schema`."""
    kind, several, count = kind.rstrip("!").removesuffix("]").partition("[")
    if kind == "any":
        return {}
    if kind == "names":
        return {"type": "array", "items": {"type": "string"}}
    one: Tree = (
        {"type": _JSON_TYPE_OF_KIND[kind]}
        if kind in _JSON_TYPE_OF_KIND
        else {"$ref": f"#/definitions/{kind}"}
    )
    if kind in _NAMED_KINDS:
        one["description"] = f"the name of a [{kind}.NAME] of this file"
    if count:
        return {"type": "array", "items": one, "minItems": int(count), "maxItems": int(count)}
    if several:
        return {"$ref": f"#/definitions/{kind}[]"} if kind in DIMENSIONS else {}
    return one


def _table_schema(keys: schema.Schema, *, about: Any = None, **more: Tree) -> Tree:
    """Schema of a table with these keys and no others; about: object whose docstring begins with the description."""
    table: Tree = {"type": "object", "additionalProperties": False}
    if about is not None:
        table["description"] = " ".join((inspect.getdoc(about) or "").split("\n\n")[0].split())
    table["properties"] = {key: _value_schema(kind) for key, kind in keys.items()} | more
    required = [key for key, kind in keys.items() if kind.endswith("!")]
    return table | ({"required": required} if required else {})


def _tables_by_name(table: Tree) -> Tree:
    """Schema of tables by name, each like `table`."""
    return {"type": "object", "additionalProperties": table}


def _one_of(key: str, tables: Mapping[str, tuple[Any, schema.Schema]], **more: Tree) -> Tree:
    """Schema of a table whose `key` has one of several values, each with keys of its own."""
    variants = []
    for word, (about, keys) in tables.items():
        table = _table_schema({key: "text!"} | keys, about=about)
        table["properties"][key] = {"const": word}
        variants.append(table)
    return {"oneOf": [*variants, *more.values()]}


def _leaf_or_wire_schema(kind: str, keys: schema.Schema, about: Any, **more: Tree) -> Tree:
    """Schema of a wire with its diameter, or a leaf with its section or thickness and width; with curve and profile."""
    more |= {
        key: _one_of("kind", {word: (SHAPE_CLASSES[key][word][1], own) for word, own in shapes.items()})
        for key, shapes in schema.SHAPES.items()
    }
    if kind == "wire":
        return _table_schema(keys | schema.SIZES["wire"], about=about, **more)
    sizes = [schema.SIZES["leaf"], schema.SIZES["rectangle"]]
    table = _table_schema(
        keys, about=about, **{k: _value_schema(v) for size in sizes for k, v in size.items()}, **more
    )
    return table | {"anyOf": [{"required": list(size)} for size in sizes]}


def _statement_schema(name: str) -> Tree:
    """Schema of an item of the array [[name]]."""
    keys, about = schema.STATEMENTS[name], getattr(Mechanism, name)
    if name in ("leaf", "wire"):
        return _leaf_or_wire_schema(name, keys, about)
    more: Tree = {}
    if name in ("actuate", "support", "stop"):
        more["terms"] = {"type": "array", "items": _table_schema(schema.TERM)}
    if name == "actuate":
        more["value"] = {"anyOf": [_value_schema("length"), _value_schema("angle")]}
    if name == "stop":
        kinds = schema.LIMITS.values()
        more |= {
            key: {"anyOf": [_value_schema(k[key]) for k in kinds]} for key in ("low", "high", "softness")
        }
    if name == "cable":
        more["via"] = {"type": "array", "items": _table_schema(schema.VIA)}
    if name == "damper":
        more["damping"] = {"anyOf": [_value_schema("damping"), _value_schema("torsional damping")]}
    return _table_schema(keys, about=about, **more)


def _joint_schema() -> Tree:
    """Schema of a [joint.NAME] of any family, or drawn leaf by leaf."""
    families = {name: (family, schema.family_schema(family)) for name, family in joint_families().items()}
    leaves = {
        kind: {"type": "array", "items": _leaf_or_wire_schema(kind, schema.LEAF | schema.BLOCKS, None)}
        for kind in ("leaf", "wire")
    }
    motions = [_table_schema(keys, kind={"const": kind}) for kind, keys in schema.MOTIONS.items()]
    drawn = _table_schema(
        schema.DRAWN, about=DrawnJoint, family={"const": "drawn"},
        blocks=_tables_by_name(_value_schema("length[3]")), shape=_tables_by_name(_value_schema("number")),
        motion={"type": "array", "items": {"oneOf": motions}}, **leaves,
    )  # fmt: skip
    return _one_of("family", families, drawn=drawn | {"required": ["family"]})


def _simulate_schema() -> Tree:
    """Schema of [simulate]."""
    kinds = []
    for kind, (made, parameter) in FUNCTION_KINDS.items():
        keys = [kind, *(f.name for f in fields(made) if f.name != parameter)]  # type: ignore[arg-type]
        kinds.append(_table_schema(dict.fromkeys(keys, "any"), about=made) | {"required": [kind]})
    kinds += [_table_schema({"formula": "text!"}), _table_schema({"value": "any!"})]
    one = {"anyOf": [{"oneOf": kinds}, {"type": "array", "items": {"oneOf": kinds}}]}
    let_go = _table_schema({}, let_go={"const": True}) | {"required": ["let_go"]}
    event = _table_schema({"of": "text!", "above": "any", "below": "any"}, about=Event)
    return _table_schema(
        schema.SIMULATE, about=Simulation, drives=_tables_by_name({"anyOf": [*one["anyOf"], let_go]}),
        loads=_tables_by_name(one), base=_table_schema({"along": "direction!"}, acceleration=one, about=Shake),
        speeds=_tables_by_name({"type": "array", "items": {"type": "number"}}),
        stop={"anyOf": [event, {"type": "array", "items": event}]}, every={"type": "integer"},
    )  # fmt: skip


def _options_schema(types: Mapping[str, type] | None) -> Tree:
    """Schema of [options]; types: type of every key, any keys when None."""
    if types is None:
        return {"type": "object"}
    keys = {key: {"type": _JSON_TYPES[kind]} for key, kind in types.items()}
    return {"type": "object", "additionalProperties": False, "properties": keys}
