"""A link of a mechanism, known by its name."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from ksd.checks import Vector


@dataclass(frozen=True)
class Link:
    """A link of the mechanism `owner`; at (3,) [m]: undeformed position of a link that is a point of a leaf, else None."""

    name: str
    owner: Any = field(compare=False, repr=False)
    at: Vector | None = field(default=None, compare=False, repr=False)

    def __str__(self) -> str:
        return self.name


def link_name(link: Any) -> str:
    """The name of a link given as `Link` or as text."""
    return link.name if isinstance(link, Link) else str(link)
