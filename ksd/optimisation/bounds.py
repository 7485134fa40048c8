"""Bounds of the parameters of a job: as given, and within the trained ranges of its joints."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import brentq

from ksd.answers.printing import format_number
from ksd.checks import show
from ksd.errors import SceneError
from ksd.library import find_record
from ksd.scene import Joint, Scene
from ksd.scene.formula import si_value
from ksd.scene.toml_table import written_unit
from ksd.study.design_scene import build_scene

Array = np.ndarray
Bounds = Mapping[str, tuple[float, float]]
"""Least and most of every parameter by name, SI."""
PROBE_FRACTION = 0.37
"""Fraction of the bounds at which parameters are held while one of them is varied."""


def parse_bounds(vary: Any) -> dict[str, tuple[float, float]]:
    """Bounds from the argument `vary` of a job. Raises SceneError."""
    if not isinstance(vary, Mapping) or not vary:
        raise SceneError(
            "vary: give least and most of every parameter by name, vary={'thickness': (2e-4, 1e-3)}"
        )
    bounds = {}
    for name, given in vary.items():
        if isinstance(given, str) or not isinstance(given, Sequence | np.ndarray) or len(given) != 2:
            raise SceneError(f"vary: {name} = {show(given)}: give (least, most)")
        low, high = (si_value(v, f"vary: {name}") for v in given)
        if not low < high:
            raise SceneError(
                f"vary: {name} = {show(given)} holds no design: the least must be below the most"
            )
        bounds[str(name)] = (low, high)
    return bounds


def bound_units(vary: Mapping[str, Any]) -> dict[str, tuple[str, float]]:
    """Unit and its factor of the parameters whose bounds are text, such as "0.2 mm", by name."""
    last = {str(name): tuple(given)[-1] for name, given in vary.items()}
    found = {name: written_unit(text) for name, text in last.items() if isinstance(text, str)}
    return {name: unit for name, unit in found.items() if unit is not None}


def parameters_between(bounds: Bounds, fractions: Array) -> dict[str, float]:
    """Parameters by name at fractions (P,) in 0..1 of their bounds."""
    return {
        n: low + fraction * (high - low)
        for (n, (low, high)), fraction in zip(bounds.items(), fractions.tolist(), strict=True)
    }


def first_buildable(function: Callable[..., Any], bounds: Bounds) -> Any:
    """Result of `function` at the parameters in the middle of the bounds, or elsewhere within them.

    Raises SceneError where it raises one at all designs that are tried.
    """
    first_reason: SceneError | None = None
    middle = np.full(len(bounds), 0.5)
    for fractions in (middle, *np.random.default_rng(0).uniform(size=(40, len(bounds)))):
        try:
            return function(**parameters_between(bounds, fractions))
        except SceneError as reason:
            first_reason = first_reason or reason
    raise SceneError(
        f"no design within the bounds could be built; the one in the middle: {first_reason}"
    ) from first_reason


def joints_between(function: Callable[..., Any], bounds: Bounds, fractions: Array) -> list[Joint]:
    """Joints of the design at fractions (P,) in 0..1 of the bounds; none where it cannot be built."""
    try:
        return [p.joint for p in build_scene(function, parameters_between(bounds, fractions)).joints]
    except SceneError:
        return []


@dataclass(frozen=True)
class TrainedRange:
    """Trained range of a shape parameter of one joint.

    joint: index of the joint in the scene; shape: the `ksd.Parameter` of its record; text: its name in messages.
    """

    joint: int
    shape: Any
    text: str

    def value(self, shapes: Sequence[Mapping[str, float]]) -> float:
        """The shape parameter; shapes: those of all joints. nan where the design has no such joint."""
        own = shapes[self.joint] if self.joint < len(shapes) else {}
        return float(own.get(self.shape.name, np.nan))

    def margin(self, shapes: Sequence[Mapping[str, float]]) -> float:
        """Distance to the ends of the range: 1 in its middle, 0 at its ends, negative outside, -1 without a value."""
        value = self.value(shapes)
        has_position = np.isfinite(value) and (self.shape.scale != "log" or value > 0.0)
        return 1.0 - abs(self.shape.place(value)) if has_position else -1.0


class TrainedBounds(NamedTuple):
    """Bounds within the trained ranges of the joints.

    bounds (P, 2): of the parameters, SI; reasons: why a bound is tighter than given, by parameter and side ("least" or
    "most"); coupled: ranges of shape parameters that depend on several parameters, which are no bounds.
    """

    bounds: Array
    reasons: dict[tuple[str, str], str]
    coupled: tuple[TrainedRange, ...]


def trained_bounds(function: Callable[..., Any], given: Bounds, scene: Scene) -> TrainedBounds:
    """Bounds of the parameters of a design function within the trained ranges; scene: one of its designs.

    Raises SceneError for a parameter that is outside a trained range everywhere within its bounds.
    """
    bounds = np.array(list(given.values()))
    reasons: dict[tuple[str, str], str] = {}
    ranges = [
        TrainedRange(k, shape, f"{shape.name} of {placed.joint.family} '{placed.name}'")
        for k, placed in enumerate(scene.joints)
        for shape in find_record(placed.joint.family).parameters
    ]
    coupled = []
    for r, changed_by in zip(ranges, _dependencies(function, given, ranges), strict=True):
        if len(changed_by) != 1:
            coupled += [r] if changed_by else []
            continue
        i = changed_by.pop()
        name, (low, high) = list(given)[i], _interval_within(function, given, r, i)
        text = f"the trained range {format_number(r.shape.low)} to {format_number(r.shape.high)} of {r.text}"
        if not low < high:
            raise SceneError(
                f"vary: {name} = {show(given[name])} lies outside {text}; vary it within, or give "
                "method='conventional' or extrapolate=True"
            )
        for side, end, tighter in (("least", 0, low > bounds[i, 0]), ("most", 1, high < bounds[i, 1])):
            if tighter:
                bounds[i, end] = (low, high)[end]
                reasons[name, side] = f"{side} by {text}"
    return TrainedBounds(bounds, reasons, tuple(coupled))


def _shapes_between(
    function: Callable[..., Any], bounds: Bounds, fractions: Array
) -> list[Mapping[str, float]]:
    """Shape parameters of every joint of the design at fractions (P,) in 0..1 of the bounds."""
    return [joint.shape() for joint in joints_between(function, bounds, fractions)]


def _dependencies(
    function: Callable[..., Any], bounds: Bounds, ranges: Sequence[TrainedRange]
) -> list[set[int]]:
    """Indices of the parameters that change the shape parameter of each range, from differences at two designs."""
    changed_by: list[set[int]] = [set() for _ in ranges]
    for base in (PROBE_FRACTION, 0.71):
        shapes = _shapes_between(function, bounds, np.full(len(bounds), base))
        for i in range(len(bounds)):
            changed = _shapes_between(function, bounds, base + 0.13 * (np.arange(len(bounds)) == i))
            for own, r in zip(changed_by, ranges, strict=True):
                a, b = r.value(shapes), r.value(changed)
                own |= {i} if abs(a - b) > 1e-9 * max(abs(a), abs(b)) else set()
    return changed_by


def _interval_within(
    function: Callable[..., Any], bounds: Bounds, own: TrainedRange, i: int
) -> tuple[float, float]:
    """The part of the bounds of parameter i where a shape parameter is within its range; (high, low) where it never is."""
    low, high = list(bounds.values())[i]

    def margin(fraction: float) -> float:
        fractions = np.full(len(bounds), PROBE_FRACTION)
        fractions[i] = fraction
        # records accept a value that is beyond an end by rounding
        return own.margin(_shapes_between(function, bounds, fractions)) + 5e-10

    good = [f for f in np.linspace(0.0, 1.0, 9).tolist() if margin(f) >= 0.0]
    if not good:
        return high, low
    ends = ((good[0], good[0] - 0.125), (good[-1], good[-1] + 0.125))
    least, most = (brentq(margin, a, b, xtol=1e-15) if 0.0 <= b <= 1.0 else a for a, b in ends)
    return low + least * (high - low), low + most * (high - low)
