"""How far the joints reach by their intended motions: step 1 with its fallback, and the trained ranges."""

from __future__ import annotations

import numpy as np

from ksd.errors import ConvergenceError, RangeError
from ksd.solve import pipeline
from ksd.solve.pipeline import Bench
from ksd.solve.steps import Step
from ksd.solve.stops import Stop


def closed(b: Bench, target: np.ndarray, gap: float) -> Step:
    """Step 1, in one go or, failing that, along the drive; ConvergenceError says how far it got. gap: as GAP."""
    b.restart()
    step = pipeline.close(b, target)
    if step.stop is Stop.CONVERGED and step.residual < gap * b.bodies.reduced.size:
        return step
    b.restart()
    done, size, count, spent = 0.0, 0.25, step.iterations, step.time
    while done < 1.0 and size > 1e-3:
        theta, safe = b.theta.copy(), b.reduced.copy()
        goal = min(1.0, done + size)
        step = pipeline.close(b, goal * target)
        count, spent = count + step.iterations, spent + step.time
        if step.stop is Stop.CONVERGED and step.residual < gap * b.bodies.reduced.size:
            done = goal
            continue
        b.theta[:] = theta
        b.reduced.assign(safe)
        size *= 0.5
    if done < 1.0:
        raise ConvergenceError(
            f"the joints cannot reach this pose by their intended motions: the drives got to {100 * done:.3g} % of "
            "the way, where the linkage locks; ask for less, or use method='conventional'",
            reached=done,
        )
    return Step(step.name, count, spent, step.residual, step.stop, "in steps along the drive")


def in_range(b: Bench, theta: np.ndarray, *, extrapolate: bool) -> list[str]:
    """Refuse motions theta (q,) outside the trained range, or warn when extrapolation was asked for."""
    if np.all((theta >= b.lowest) & (theta <= b.highest)):
        return []
    warnings = []
    for k, (name, value, scale) in enumerate(
        zip(b.bodies.motion_names, theta, b.bodies.motion_scale, strict=True)
    ):
        if b.lowest[k] <= value <= b.highest[k]:
            continue
        said = _spoken_range(name, value, *b.bodies.motion_range[k], scale=scale)
        if not extrapolate:
            raise RangeError(
                f"{said}; ask for less, or pass extrapolate=True (--extrapolate) to use the functions beyond it"
            )
        warnings.append(f"{said}; extrapolated")
    return warnings


def _spoken_range(name: str, value: float, low: float, high: float, *, scale: float) -> str:
    if scale == 1.0:
        v, a, b = np.rad2deg([value, low, high])
        return f"joint '{name}' would turn {v:.6g} degrees, outside its trained range of {a:.4g} to {b:.4g} degrees"
    v, a, b = 1e3 * scale * np.array([value, low, high])
    return f"joint '{name}' would move {v:.6g} mm, outside its trained range of {a:.4g} to {b:.4g} mm"
