"""Scenes of designs: parameters of a function that returns a mechanism, and the loads of a load case added."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from ksd.checks import show
from ksd.errors import DESIGN_ERRORS, SceneError, reason_text
from ksd.scene import Mechanism, Scene
from ksd.scene.load import Load
from ksd.scene.scene import MECHANISM_HINT
from ksd.study.arguments import check_design_parameters

MechanismLike = Mechanism | Scene | Callable[..., Mechanism | Scene]
"""A mechanism, or a function of parameters that returns one."""
DesignsLike = Mapping[str, Sequence[Any] | np.ndarray] | Sequence[Mapping[str, Any]]
"""Parameters of such a function: values by name for all their combinations, or one mapping per design."""

CANNOT_BE_BUILT = "this design cannot be built: "
"""Start of the message of a SceneError from the function that returns the mechanism."""


def design_parameters(mechanism: Any, designs: Any) -> list[dict[str, Any]]:
    """Parameters by name of every design; designs: see `DesignsLike`. Raises SceneError."""
    if designs is None:
        return [{}]
    if not callable(mechanism):
        raise SceneError(
            "designs = ... needs a function of these parameters that returns a mechanism in place of the mechanism"
        )
    points = _combinations(designs) if isinstance(designs, Mapping) else designs
    if isinstance(points, str) or not isinstance(points, Sequence):
        raise SceneError(
            f"designs = {show(designs)}: give sets of parameters by name, [{{'thickness': 1e-3}}, ...]"
        )
    if not len(points):
        raise SceneError("designs is empty: give at least one set of parameters")
    check_design_parameters(mechanism, points)
    return [dict(d) for d in points]


def _combinations(designs: Mapping[str, Any]) -> list[dict[str, Any]]:
    """All combinations of the values of every parameter."""
    rows = []
    for name, values in designs.items():
        try:
            rows.append(np.atleast_1d(np.asarray(values)).tolist())
        except ValueError:
            raise SceneError(f"designs: {name} = {show(values)}: give the values in one row") from None
    return [dict(zip(designs, row, strict=True)) for row in product(*rows)]


class NotAMechanism(SceneError):
    """The object given is neither a mechanism nor a function that returns one."""


def build_scene(mechanism: Any, parameters: Mapping[str, Any]) -> Scene:
    """The scene of a design. Raises SceneError where it cannot be built, NotAMechanism for other objects."""
    if not callable(mechanism):
        scene = mechanism.scene() if isinstance(mechanism, Mechanism) else mechanism
    elif not parameters and _needs_arguments(mechanism):
        raise NotAMechanism("the mechanism is a function of parameters: give their values with designs={...}")
    else:
        try:
            scene = mechanism(**parameters)
            scene = scene.scene() if isinstance(scene, Mechanism) else scene
        except DESIGN_ERRORS as reason:
            raise SceneError(
                f"{CANNOT_BE_BUILT}{reason_text(reason).removeprefix(CANNOT_BE_BUILT)}"
            ) from reason
    if scene is None and parameters and callable(mechanism):
        raise SceneError(
            f"{CANNOT_BE_BUILT}its function returned None; end it with a return of its ksd.Mechanism"
        )
    if not isinstance(scene, Scene):
        raise NotAMechanism(
            f"{show(scene)} is not a mechanism: give a function returning a mechanism, or {MECHANISM_HINT}."
        )
    return scene


def scene_or_reason(mechanism: Any, parameters: Mapping[str, Any]) -> tuple[Scene | None, str]:
    """The scene of a design, or None and the reason why its function cannot build it. Raises SceneError otherwise."""
    try:
        return build_scene(mechanism, parameters), ""
    except NotAMechanism:
        raise
    except SceneError as reason:
        if not callable(mechanism):
            raise
        return None, str(reason)


def _needs_arguments(function: Callable[..., Any]) -> bool:
    """Whether a function has parameters without default."""
    kinds = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    return any(
        p.default is p.empty and p.kind not in kinds for p in inspect.signature(function).parameters.values()
    )


def load_cases(loads: Any) -> dict[str, tuple[Load, ...]]:
    """Loads by load case from {"payload": [dict(link="top", force=(0, 0, -5), at=...)], "none": []}, or `Load` objects.

    Raises SceneError.
    """
    if loads is None:
        return {"": ()}
    if not isinstance(loads, Mapping) or not loads:
        raise SceneError(
            "loads: give the load cases by name, such as {'payload': [dict(link='top', force=...)]}"
        )
    return {
        str(case): tuple(_load(entry, f"{case} {k + 1}") for k, entry in enumerate(_load_list(entries)))
        for case, entries in loads.items()
    }


def _load_list(entries: Any) -> Sequence[Any]:
    """The loads of a load case, a single one in a list. Raises SceneError."""
    if isinstance(entries, Mapping | Load):
        return [entries]
    if isinstance(entries, str) or not isinstance(entries, Sequence):
        raise SceneError(f"a load case is a list such as [dict(link='top', force=...)], not {show(entries)}")
    return entries


def _load(entry: Any, name: str) -> Any:
    """A `Load` from one, or from a mapping of its arguments. Raises SceneError."""
    if isinstance(entry, Load):
        return entry
    if not isinstance(entry, Mapping):
        raise SceneError(f"load case '{name}': {show(entry)} is no load; give dict(link=, force=, at=)")
    defaults = {
        "force": (0.0, 0.0, 0.0),
        "moment": (0.0, 0.0, 0.0),
        "at": None,
        "name": name,
        "following": False,
    }
    unknown = set(entry) - {*defaults, "link"}
    if unknown or "link" not in entry:
        raise SceneError(
            f"load case '{name}': give link, force, moment, at, following; not {sorted(unknown)}"
        )
    given = {**defaults, **entry}
    link = getattr(given["link"], "name", given["link"])
    if given["at"] is None:
        if "force" in entry:
            raise SceneError(
                f"load case '{name}': give at, the point (3,) [m] of link '{link}' where the force acts"
            )
        # a moment alone acts on the link as a whole
        given["at"] = (0.0, 0.0, 0.0)
    return Load(given["name"], link, given["force"], given["moment"], given["at"], given["following"])


def add_loads(scene: Scene | None, extra: tuple[Load, ...]) -> tuple[Scene | None, str]:
    """The scene with additional loads, or None and the reason: the design has no scene, or a link of a load is not part
    of it."""
    if scene is None or not extra:
        return scene, ""
    for load in extra:
        if load.link not in scene.links:
            return None, f"load '{load.name}' acts on link '{load.link}', which is not part of '{scene.name}'"
    return replace(scene, loads=(*scene.loads, *extra)), ""
