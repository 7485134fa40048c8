"""Formulas such as "70 mm - 2 * joint.cross.widths[1]" over the numbers of tables read from a file.

Names in a formula are keys of the file separated by points. Items of lists of numbers are [0], [1], ...; items of arrays of
tables are given by their name, or by their number from 1 on; names with spaces stand in brackets and quotes:
join["lower left"].at[0].
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Mapping
from typing import Any

from ksd.checks import name_hint, number, show
from ksd.errors import SceneError
from ksd.scene.toml_table import parse_quantity

Keys = tuple[str | int, ...]
"""Path to a value in nested tables and lists."""
FUNCTIONS: Mapping[str, Callable[..., float]] = {
    "sin": math.sin, "cos": math.cos, "tan": math.tan, "atan": math.atan, "sqrt": math.sqrt, "exp": math.exp,
    "log": math.log, "abs": abs, "min": min, "max": max,
}  # fmt: skip
OPERATORS: Mapping[type, Callable[..., float]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv, ast.Pow: operator.pow,
    ast.USub: operator.neg, ast.UAdd: operator.pos,
}  # fmt: skip
MAX_FORMULA_LENGTH = 1000
"""Limit of the number of characters of a formula."""
_NUMBER_WITH_UNIT = re.compile(r"(?<![\w.\"'])((?>\d+\.?\d*(?:[eE][+-]?\d+)?))\s*([A-Za-z]+)(?![\w(\[])")


def si_value(value: Any, what: str) -> float:
    """A number in SI, from a plain number or from text with a unit of any dimension; `what` names it. Raises SceneError."""
    if not isinstance(value, str):
        return number(value, what)
    quantity = parse_quantity(value)
    if quantity is None:
        raise SceneError(f"{what} = {show(value)}: give a number in SI, or text with a unit such as '100 mm'")
    return number(quantity[0], what)


def dimension_of(value: Any) -> str | None:
    """The dimension of text with a unit; None for plain numbers and other text."""
    quantity = parse_quantity(value) if isinstance(value, str) else None
    return None if quantity is None else quantity[1]


class Formula:
    """A formula, read once; called with tables it returns its value (SI) over the numbers in them.

    Raises SceneError for text that is no formula; when called, for one without a value, and unknown names (with the
    nearest).
    """

    def __init__(self, text: str) -> None:
        self._where = f"formula '{text.strip()}'"
        if len(text) > MAX_FORMULA_LENGTH:
            raise SceneError(f"formula '{text[:40]}...' is longer than {MAX_FORMULA_LENGTH} letters")
        in_si = _NUMBER_WITH_UNIT.sub(lambda m: repr(si_value(f"{m[1]} {m[2]}", self._where)), text.strip())
        try:
            self._tree = ast.parse(in_si, mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            raise SceneError(
                f"{self._where} cannot be read: write it as '70 mm - 2 * joint.cross.thickness'"
            ) from None

    def __call__(self, tables: Mapping[str, Any]) -> float:
        try:
            value = _evaluate_node(self._tree, tables, self._where)
        except ArithmeticError as error:
            raise SceneError(f"{self._where} has no value: {error}") from None
        if isinstance(value, complex) or not math.isfinite(value):
            raise SceneError(f"{self._where} has no value")
        return float(value)


def evaluate_formula(formula: str, tables: Mapping[str, Any]) -> float:
    """The value (SI) of a formula over the numbers in `tables`; raises what `Formula` raises."""
    return Formula(formula)(tables)


def _evaluate_node(node: ast.expr, tables: Mapping[str, Any], where: str) -> float:
    """The value of a syntax node; `where` starts messages. Raises SceneError."""
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return float(node.value)
    if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        left, right = (_evaluate_node(side, tables, where) for side in (node.left, node.right))
        return OPERATORS[type(node.op)](left, right)
    if isinstance(node, ast.UnaryOp) and type(node.op) in OPERATORS:
        return OPERATORS[type(node.op)](_evaluate_node(node.operand, tables, where))
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords and node.args:
        if node.func.id not in FUNCTIONS:
            raise SceneError(
                f"{where}: there is no function {node.func.id}{name_hint(node.func.id, FUNCTIONS)}"
            )
        try:
            return FUNCTIONS[node.func.id](*(_evaluate_node(a, tables, where) for a in node.args))
        except TypeError:
            raise SceneError(f"{where}: {node.func.id} of {len(node.args)} numbers is none") from None
    if isinstance(node, ast.Name) and node.id == "pi":
        return math.pi
    keys = _node_keys(node, where)
    value = value_at(tables, keys, where)
    if isinstance(value, str) and value.lstrip().startswith("="):
        raise SceneError(f"{where}: {format_keys(keys)} is a formula itself; write out what it stands for")
    return si_value(value, f"{where}: {format_keys(keys)}")


def _node_keys(node: ast.expr, where: str) -> Keys:
    """The keys of a name in a formula. Raises SceneError for any other node."""
    if isinstance(node, ast.Name):
        return (node.id,)
    if isinstance(node, ast.Attribute):
        return (*_node_keys(node.value, where), node.attr)
    if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant):
        key = node.slice.value
        if isinstance(key, str) or (isinstance(key, int) and not isinstance(key, bool)):
            return (*_node_keys(node.value, where), key)
    raise SceneError(f"{where}: '{ast.unparse(node)}' is no number, name or sum of them")


def format_keys(keys: Keys) -> str:
    """Keys as written in formulas: joint.cross.widths[1]."""
    text = ""
    for key in keys:
        if isinstance(key, int):
            text += f"[{key}]"
        elif key.isidentifier():
            text += f".{key}" if text else key
        else:
            text += f'["{key}"]'
    return text


def value_at(tables: Any, keys: Keys, where: str) -> Any:
    """The value at `keys`. Raises SceneError, with `where` and the nearest key, when there is none."""
    value = tables
    for k, key in enumerate(keys):
        index = index_of(value, key)
        if index is None or (isinstance(value, dict) and index not in value):
            known = known_keys(value)
            inside = f" in {format_keys(keys[:k])}" if k else ""
            raise SceneError(f"{where}: there is no {format_keys(keys[k:])}{inside}{name_hint(key, known)}")
        value = value[index]
    return value


def index_of(values: Any, key: str | int) -> Any:
    """Index of a key in a table, a list of numbers, or an array of tables; None when it has no such key."""
    if isinstance(values, dict):
        return key if isinstance(key, str) else None
    if not isinstance(values, list):
        return None
    of_tables = bool(values) and all(isinstance(v, dict) for v in values)
    if of_tables:
        named = [n for n, v in enumerate(values) if v.get("name") == key]
        if named:
            return named[0]
    if isinstance(key, str):
        if not key.isdecimal():
            return None
        key = int(key)
    index = key - of_tables
    return index if 0 <= index < len(values) else None


def known_keys(values: Any) -> list[str]:
    """The keys of the parts of a table or list."""
    if isinstance(values, dict):
        return list(values)
    if isinstance(values, list):
        tables = [v for v in values if isinstance(v, dict)]
        return [str(v.get("name", n + 1)) for n, v in enumerate(tables)] or [
            str(n) for n in range(len(values))
        ]
    return []
