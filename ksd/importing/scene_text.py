"""The text of a scene file made from another file: comments, tables, and the check that it can be read."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ksd.checks import unused_name
from ksd.errors import SceneError
from ksd.scene.toml_file import scene_from_tables
from ksd.scene.toml_writer import toml_tree_lines

STEEL = {"E": "210 GPa", "nu": 0.3, "density": "7800 kg/m^3"}
"""The material of leaf springs of which a file says nothing."""


class Parts:
    """Materials and sections of a scene file by name, each once."""

    def __init__(self) -> None:
        self.tables: dict[str, dict[str, Any]] = {"material": {}, "section": {}}

    def name_of(self, kind: str, preferred: str, table: Mapping[str, Any]) -> str:
        """The name of a material or section of this `kind`, which is added if it is new."""
        known = self.tables[kind]
        found = next((name for name, other in known.items() if other == table), None)
        if found is None:
            found = unused_name(preferred, set(known))
            known[found] = dict(table)
        return found


def scene_text(
    source: Path, tree: dict[str, Any], head: Sequence[str], before: Mapping[str, Sequence[str]]
) -> str:
    """The text of a scene file: comments `head`, then the tables of `tree`, each line of which that is a key of `before`
    follows these comments. Raises SceneError where the scene cannot be read back.
    """
    lines = [f"# {line}".rstrip() for line in head]
    for line in toml_tree_lines(tree, ""):
        lines += [f"# {comment}" for comment in before.get(line, ())]
        lines.append(line)
    text = "\n".join(lines) + "\n"
    try:
        scene_from_tables(tomllib.loads(text), source)
    except (SceneError, tomllib.TOMLDecodeError) as reason:
        raise SceneError(f"{source.name} gives no scene: {reason}") from None
    return text
