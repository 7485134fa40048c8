"""A frequency over the whole stroke from three configurations, with its error.

A mechanism that is symmetric about its rest state has frequencies even in the drive value, and 1/omega^2 is a compliance
times a mass: smooth and monotonic where omega itself is peaked. So 1/omega^2 = c0 + c2 d^2 + c4 d^4 through rest, half
and full stroke; configurations solved besides tell the error, the negative end how symmetric the mechanism is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ksd.checks import clear_argument_errors
from ksd.design.tracking import SPARE_MODES, Tracks, follow_with_bisection, start_tracks
from ksd.errors import SceneError
from ksd.model.compile import Model
from ksd.properties.printing import PrintableAnswer, format_number, format_table
from ksd.scene import Mechanism, Scene
from ksd.solve.error import refined_configuration
from ksd.solve.solver import Method, Solver


@dataclass(frozen=True, repr=False)
class FrequencyCurve(PrintableAnswer):
    """A frequency over the stroke from three configurations: 1/omega^2 = c0 + c2 d^2 + c4 d^4.

    drive: name; values (3,) [m or rad] and frequency_Hz (3,): the configurations; coefficients (3,); stroke [m or
    rad]: largest |d|. checked: drive value -> (frequency solved for, relative error) of configurations not used.
    solved_error: largest relative error of the frequencies solved for, that of method and mesh.
    """

    drive: str
    values: tuple[float, ...]
    frequency_Hz: tuple[float, ...]
    coefficients: tuple[float, ...]
    checked: dict[float, tuple[float, float]]
    solved_error: float = 0.0

    def _line(self) -> str:
        return f"{format_number(self.frequency_Hz[0])} to {format_number(self.frequency_Hz[-1])} Hz over '{self.drive}'"

    def __str__(self) -> str:
        rows = [
            (format_number(d, 6), format_number(f, 6), "used")
            for d, f in zip(self.values, self.frequency_Hz, strict=True)
        ]
        rows += [
            (format_number(d, 6), format_number(f, 6), f"curve {100 * e:+.2g} % off")
            for d, (f, e) in self.checked.items()
        ]
        said = f"Frequency over drive '{self.drive}' [m or rad], from three configurations"
        return format_table(("drive", "[Hz]", "<"), rows, said)

    @property
    def error(self) -> float:
        """Largest relative error at the configurations checked on the side of the stroke the curve was made on."""
        return max((abs(e) for d, (_, e) in self.checked.items() if d > 0.0), default=float("nan"))

    @property
    def asymmetry(self) -> float:
        """Largest relative error on the other side: large where the mechanism is no mirror image of itself, as a
        cross flexure with one inner and two outer leaf springs out of its plane; the curve then holds on one side only."""
        return max((abs(e) for d, (_, e) in self.checked.items() if d < 0.0), default=float("nan"))

    def __call__(self, d: Any) -> Any:
        """Frequency [Hz] at drive values `d` [m or rad]; nan where the polynomial says 1/omega^2 <= 0."""
        x = np.asarray(d, float) ** 2
        c0, c2, c4 = self.coefficients
        inverse = c0 + c2 * x + c4 * x * x
        return 1.0 / (2 * np.pi * np.sqrt(np.where(inverse > 0, inverse, np.nan)))


def even_curve(drive: str, values: Any, frequency_Hz: Any, checks: dict[float, float]) -> FrequencyCurve:
    """The even polynomial in 1/omega^2 through three (value, frequency) pairs; `checks`: value -> frequency."""
    d, f = np.asarray(values, float), np.asarray(frequency_Hz, float)
    size = np.abs(d).max()
    powers = np.stack([(d / size) ** n for n in (0, 2, 4)], axis=1)
    c = np.linalg.solve(powers, 1.0 / (2 * np.pi * f) ** 2) / size ** np.array([0, 2, 4])
    bare = FrequencyCurve(drive, tuple(d.tolist()), tuple(f.tolist()), tuple(c.tolist()), {})
    checked = {v: (g, float(bare(v)) / g - 1.0) for v, g in checks.items()}
    return FrequencyCurve(drive, bare.values, bare.frequency_Hz, bare.coefficients, checked)


STEPS = 24
"""Poses over half the stroke walked to keep the mode in sight from one configuration to the next."""


@clear_argument_errors
def frequency_curve(
    mechanism: Mechanism | Scene | Model | Solver,
    drive: str,
    stroke: float,
    *,
    mode: str = "first_parasitic",
    checks: Sequence[float] = (0.25, 0.75, -0.5, -1.0),
    method: Method = "full",
    held: dict[str, float] | None = None,
) -> FrequencyCurve:
    """The frequency of a mode over drive values -stroke..stroke from three configurations: 0, 1/2 and 1 times stroke.

    mechanism: Mechanism, Scene, Model or `Solver`. drive: name; stroke [m or rad]. mode: "intended", "first_parasitic",
    or "parasitic_1", ... as counted at rest and followed by MAC (the walk in between costs more solves; the first two
    need none). checks: fractions of the stroke solved besides to tell the error. held: values of the other drives [m or
    rad]; method: as in `ksd.solve`. Raises SceneError for names, ConvergenceError where a configuration is not found.
    """
    solver = mechanism if isinstance(mechanism, Solver) else Solver(mechanism)
    if drive not in solver.model.drive_names:
        raise SceneError(
            f"'{drive}' is not a drive; the drives are {', '.join(solver.model.drive_names) or 'none'}"
        )
    if not stroke > 0.0:
        raise SceneError(f"stroke = {stroke}: a positive drive value [m or rad] is needed")
    wanted = sorted({0.0, 0.5, 1.0, *(float(c) for c in checks)})
    how = (drive, held or {}, mode, method)
    values = [stroke * w for w in wanted]
    found = _frequencies(solver, values, how)
    by = dict(zip(wanted, found, strict=True))
    used = (0.0, 0.5, 1.0)
    curve = even_curve(
        drive, [stroke * u for u in used], [by[u] for u in used],
        {stroke * w: f for w, f in by.items() if w not in used},
    )  # fmt: skip
    better = np.array(_frequencies(solver, values, how, better=True))
    return replace(curve, solved_error=float(np.abs(better / np.array(found) - 1.0).max()))


def _frequencies(
    solver: Solver,
    values: list[float],
    how: tuple[str, dict[str, float], str, Method],
    *,
    better: bool = False,
) -> list[float]:
    """Frequency [Hz] of the mode at each of `values`, ascending; better: of the equilibrium on a finer mesh."""
    drive, held, mode, method = how
    freed = solver.model.drive_names

    def modes(d: float, more: int = 0) -> Any:
        pose = solver({**held, drive: d}, method=method, estimate=False)
        pose = refined_configuration(pose) if better else pose
        return pose.frequencies(count=4 + len(freed) + SPARE_MODES + more, freed=freed)

    if mode in ("intended", "first_parasitic"):
        tracks = [start_tracks(modes(d), 1) for d in values]
        return [t.frequency_Hz(_track(t, mode)) for t in tracks]
    largest = max(abs(d) for d in values)
    start = start_tracks(modes(0.0), 4)
    if mode not in start.names:
        raise SceneError(f"mode = {mode!r}: choose first_parasitic or one of {', '.join(start.names)}")
    by: dict[float, float] = {}
    for sign in (1.0, -1.0):
        now: Tracks = start
        way = sorted(
            {abs(d) for d in values if d * sign >= 0.0} | set(np.linspace(0, largest, STEPS).tolist())
        )
        last = 0.0
        for d in way if any(v * sign > 0.0 for v in values) else [0.0]:

            def between(share: float, more: int, a: float = sign * last, b: float = sign * d) -> Any:
                return modes((1.0 - share) * a + share * b, more)

            now = follow_with_bisection(now, modes(sign * d), 4, between)
            by[sign * d], last = now.frequency_Hz(start.names.index(mode)), d
    return [by[d] for d in values]


def _track(tracks: Tracks, mode: str) -> int:
    """The track of the (lowest) intended or the first parasitic motion."""
    if mode == "intended":
        own = [t for t, n in enumerate(tracks.names) if n.startswith("intended")]
        if not own:
            raise SceneError(
                "no mode among the lowest is the intended motion of a drive; ask for 'first_parasitic'"
            )
        return own[0]
    first = tracks.first_parasitic
    if first is None:
        raise SceneError("this mechanism has no mode besides its intended ones")
    return first
