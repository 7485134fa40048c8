"""Joint families by name; the modules of this package define one or more `Joint` classes each."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from functools import cache

from ksd.checks import name_hint, show
from ksd.errors import SceneError
from ksd.scene.joint import Joint


@cache
def joint_families() -> dict[str, type[Joint]]:
    """All joint families {name: class} in the modules of this package, in order of name.

    >>> families = ksd.joint_families()
    >>> families["cross_flexure"].__name__
    'CrossFlexure'
    """
    families = {}
    for info in pkgutil.iter_modules(__path__):
        module = importlib.import_module(f"{__name__}.{info.name}")
        for value in vars(module).values():
            is_own_class = inspect.isclass(value) and value.__module__ == module.__name__
            # base classes of families have no family name
            if is_own_class and issubclass(value, Joint) and hasattr(value, "family"):
                families[value.family] = value
    return dict(sorted(families.items()))


def joint_family(name: str) -> type[Joint]:
    """The class of a family by its name, e.g. "cross_flexure".

    Raises SceneError for an unknown name, with the nearest known one.
    """
    families = joint_families()
    if not isinstance(name, str) or name not in families:
        raise SceneError(f"joint family {show(name)} is unknown{name_hint(name, families)}")
    return families[name]


def make_joint(family: str, /, **parameters: object) -> Joint:
    """A joint of a family by its name and parameters, in SI units.

    Raises SceneError for an unknown family or parameter (with the nearest), a missing parameter, or a wrong value.
    """
    kind = joint_family(family)
    known = inspect.signature(kind).parameters
    for key in parameters:
        if key not in known:
            raise SceneError(f"{family}: parameter '{key}' is unknown{name_hint(key, known)}")
    for key, parameter in known.items():
        if parameter.default is parameter.empty and key not in parameters:
            raise SceneError(f"{family}: parameter '{key}' is missing.")
    return kind(**parameters)
