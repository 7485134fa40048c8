"""The JSON schema (draft 7) of scene and job files, made from the tables the readers go by: for editors that complete and
check."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any

from ksd import section
from ksd.checks import NUMBER_PATTERN
from ksd.scene import toml_schema as schema
from ksd.scene.effects import OPTIONAL_EFFECTS
from ksd.scene.families import joint_families
from ksd.scene.hinges import PLANES
from ksd.scene.joint import DrawnJoint
from ksd.scene.material import Material
from ksd.scene.mechanism import Mechanism
from ksd.scene.toml_schema import SHAPE_CLASSES
from ksd.scene.toml_table import unit_pattern
from ksd.units import DIMENSIONS

Tree = dict[str, Any]
_TYPES = {str: "string", float: "number", int: "integer", bool: "boolean"}
_NAMED = ("material", "section", "joint")
_PLAIN = {"number": "number", "text": "string", "flag": "boolean"} | dict.fromkeys(_NAMED, "string")


def json_schema(
    options: Mapping[str, type] | None = None, jobs: tuple[schema.Schema, schema.Schema] | None = None
) -> Tree:
    """The schema as a tree of dictionaries and lists; options: keys of [options] with their types, any when None; jobs: keys
    of [job] and of [optimise], for the schema of job files.

    It knows tables, keys, types, units and what is required; whether names are known and numbers possible, the reader tells.
    """
    sentences = {name: {"type": "array", "items": _sentence(name)} for name in schema.SENTENCES}
    top = _table(
        schema.TOP,
        plane={"enum": list(PLANES)},
        consider={"type": "array", "items": {"enum": list(OPTIONAL_EFFECTS)}},
        material=_by_name(_table(schema.MATERIAL, about=Material)),
        section=_by_name(
            _one_of("kind", {k: (getattr(section, k), keys) for k, keys in schema.SECTIONS.items()})
        ),
        joint=_by_name(_joints()),
        options=_options(options),
        **sentences,
    )
    found = {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "Scene file of ksd",
        **top,
        "definitions": _definitions(),
    }
    return found if jobs is None else _of_jobs(found, *jobs)


def _of_jobs(scenes: Tree, job: schema.Schema, optimise: schema.Schema) -> Tree:
    """The schema of job files: the scene may stand elsewhere, and its numbers may be formulas."""
    found: Tree = _with_formulas(scenes) | {"title": "Job file of ksd", "required": ["job"]}
    by_name: Tree = {"type": "object"}
    cases = _by_name({"type": "array", "items": _table(schema.SENTENCES["load"])})
    found["properties"] |= {
        "job": _table(job, vary=by_name, drives=by_name, loads=cases),
        "optimise": _table(optimise, start=by_name, spread=by_name),
    }
    return found


def _with_formulas(tree: Any) -> Any:
    """The same with "= formula" wherever a number may stand."""
    if isinstance(tree, list):
        return [_with_formulas(item) for item in tree]
    if not isinstance(tree, dict):
        return tree
    if tree == {"type": "number"}:
        return {"anyOf": [tree, {"type": "string", "pattern": r"^\s*="}]}
    return {key: _with_formulas(value) for key, value in tree.items()}


def _definitions() -> Tree:
    """Quantities by dimension, one of each or lists of any depth, and directions."""
    found: Tree = {}
    for dimension, units in DIMENSIONS.items():
        ways = "|".join(unit_pattern(unit) for unit in units)
        si, *others = units
        found[dimension] = {
            "description": f"{dimension}: a number in {si}, or text with a unit: {', '.join([si, *others])}",
            "anyOf": [
                {"type": "number"},
                {"type": "string", "pattern": rf"^\s*{NUMBER_PATTERN}\s*(?:{ways})\s*$"},
            ],
        }
        lists = {"type": "array", "items": {"$ref": f"#/definitions/{dimension}[]"}}
        found[f"{dimension}[]"] = {"anyOf": [{"$ref": f"#/definitions/{dimension}"}, lists]}
    axes = {"enum": [f"{sign}{axis}" for axis in "xyz" for sign in ("", "+", "-")]}
    three = {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}
    found["direction"] = {"description": 'a direction: "x", "-z" or three numbers', "anyOf": [axes, three]}
    return found


def _value(kind: str) -> Tree:
    """What a key of a kind (see `ksd.scene.toml_schema`) may hold."""
    kind, several, count = kind.rstrip("!").removesuffix("]").partition("[")
    if kind == "any":
        return {}
    if kind == "names":
        return {"type": "array", "items": {"type": "string"}}
    one: Tree = {"type": _PLAIN[kind]} if kind in _PLAIN else {"$ref": f"#/definitions/{kind}"}
    if kind in _NAMED:
        one["description"] = f"the name of a [{kind}.NAME] of this file"
    if count:
        return {"type": "array", "items": one, "minItems": int(count), "maxItems": int(count)}
    if several:
        return {"$ref": f"#/definitions/{kind}[]"} if kind in DIMENSIONS else {}
    return one


def _table(keys: schema.Schema, *, about: Any = None, **more: Tree) -> Tree:
    """A table with these keys and no others; about: what it says, whose first sentence describes it."""
    found: Tree = {"type": "object", "additionalProperties": False}
    if about is not None:
        found["description"] = " ".join((inspect.getdoc(about) or "").split("\n\n")[0].split())
    found["properties"] = {key: _value(kind) for key, kind in keys.items()} | more
    required = [key for key, kind in keys.items() if kind.endswith("!")]
    return found | ({"required": required} if required else {})


def _by_name(table: Tree) -> Tree:
    return {"type": "object", "additionalProperties": table}


def _one_of(key: str, tables: Mapping[str, tuple[Any, schema.Schema]], **more: Tree) -> Tree:
    """A table whose `key` says which one it is."""
    found = []
    for word, (about, keys) in tables.items():
        table = _table({key: "text!"} | keys, about=about)
        table["properties"][key] = {"const": word}
        found.append(table)
    return {"oneOf": [*found, *more.values()]}


def _sized(kind: str, keys: schema.Schema, about: Any, **more: Tree) -> Tree:
    """A wire with its diameter, or a leaf with its section or thickness and width; either with its curve and profile."""
    more |= {
        key: _one_of("kind", {word: (SHAPE_CLASSES[key][word][1], own) for word, own in shapes.items()})
        for key, shapes in schema.SHAPES.items()
    }
    if kind == "wire":
        return _table(keys | schema.SIZES["wire"], about=about, **more)
    sizes = [schema.SIZES["leaf"], schema.SIZES["rectangle"]]
    table = _table(keys, about=about, **{k: _value(v) for size in sizes for k, v in size.items()}, **more)
    return table | {"anyOf": [{"required": list(size)} for size in sizes]}


def _sentence(name: str) -> Tree:
    """An item of the array [[name]]."""
    keys, about = schema.SENTENCES[name], getattr(Mechanism, name)
    if name in ("leaf", "wire"):
        return _sized(name, keys, about)
    more: Tree = {}
    if name in ("actuate", "support"):
        more["terms"] = {"type": "array", "items": _table(schema.TERM)}
    if name == "actuate":
        more["value"] = {"anyOf": [_value("length"), _value("angle")]}
    return _table(keys, about=about, **more)


def _joints() -> Tree:
    """A [joint.NAME] of any family, and one that is drawn leaf by leaf."""
    families = {name: (family, schema.family_schema(family)) for name, family in joint_families().items()}
    leaves = {
        kind: {"type": "array", "items": _sized(kind, schema.LEAF | schema.BLOCKS, None)}
        for kind in ("leaf", "wire")
    }
    motions = [_table(keys, kind={"const": kind}) for kind, keys in schema.MOTIONS.items()]
    drawn = _table(
        schema.DRAWN, about=DrawnJoint, family={"const": "drawn"},
        blocks=_by_name(_value("length[3]")), shape=_by_name(_value("number")),
        motion={"type": "array", "items": {"oneOf": motions}}, **leaves,
    )  # fmt: skip
    return _one_of("family", families, drawn=drawn | {"required": ["family"]})


def _options(types: Mapping[str, type] | None) -> Tree:
    if types is None:
        return {"type": "object"}
    keys = {key: {"type": _TYPES[kind]} for key, kind in types.items()}
    return {"type": "object", "additionalProperties": False, "properties": keys}
