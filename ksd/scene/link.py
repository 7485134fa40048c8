"""The links of a mechanism by name."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from ksd.checks import Vector


@dataclass(frozen=True)
class Link:
    """A link of the mechanism `owner`, known by its name; at (3,) [m]: where it is, of a point of a leaf."""

    name: str
    owner: Any = field(compare=False, repr=False)
    at: Vector | None = field(default=None, compare=False, repr=False)

    def __str__(self) -> str:
        return self.name


def link_name(link: Any) -> str:
    """A link's name for messages and default names."""
    return link.name if isinstance(link, Link) else str(link)
