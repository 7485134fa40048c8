"""A frequency over the whole stroke from three configurations, with its error.

The frequencies of a mechanism that is symmetric about its undeformed configuration are even functions of the drive value d,
and 1/omega^2, a compliance times a mass, is smooth and monotonic where omega itself has a peak. The curve is therefore
1/omega^2 = c0 + c2 d^2 + c4 d^4 through zero, half and full stroke. Additional configurations give its error; those at
negative drive values show how symmetric the mechanism is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ksd.answers.printing import PrintableAnswer, format_number, format_table
from ksd.checks import clear_argument_errors
from ksd.errors import SceneError
from ksd.model.compile import Model
from ksd.numerics.threads import small_matrices
from ksd.scene import Mechanism, Scene
from ksd.solvers.error import refined_configuration
from ksd.solvers.solver import Method, Solver
from ksd.study.tracking import SPARE_MODES, Tracks, follow_with_bisection, start_tracks


@dataclass(frozen=True, repr=False)
class FrequencyCurve(PrintableAnswer):
    """A frequency over the stroke from three configurations: 1/omega^2 = c0 + c2 d^2 + c4 d^4.

    drive: name; values (3,) [m or rad] and frequency_Hz (3,): of the three configurations; coefficients (3,): c0, c2, c4.
    checked: (computed frequency [Hz], relative error of the curve) by drive value, of additional configurations.
    solved_error: largest relative error of the computed frequencies, due to method and mesh.
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
        title = f"Frequency over drive '{self.drive}' [m or rad], from three configurations"
        return format_table(("drive", "[Hz]", "<"), rows, title)

    @property
    def error(self) -> float:
        """Largest relative error at the checked configurations of positive drive value, the side of the curve."""
        return max((abs(e) for d, (_, e) in self.checked.items() if d > 0.0), default=float("nan"))

    @property
    def asymmetry(self) -> float:
        """Largest relative error at the checked configurations of negative drive value.

        It is large where the mechanism is not symmetric, such as a cross flexure with one inner and two outer leaf springs
        out of its plane; the curve then holds on one side only.
        """
        return max((abs(e) for d, (_, e) in self.checked.items() if d < 0.0), default=float("nan"))

    def __call__(self, d: Any) -> Any:
        """Frequency [Hz] at drive values `d` [m or rad]; nan where the polynomial for 1/omega^2 is not positive."""
        x = np.asarray(d, float) ** 2
        c0, c2, c4 = self.coefficients
        inverse = c0 + c2 * x + c4 * x * x
        return 1.0 / (2 * np.pi * np.sqrt(np.where(inverse > 0, inverse, np.nan)))


def even_curve(drive: str, values: Any, frequency_Hz: Any, checks: dict[float, float]) -> FrequencyCurve:
    """The curve through frequencies (3,) [Hz] at drive values (3,) [m or rad], 1/omega^2 = c0 + c2 d^2 + c4 d^4.

    checks: further frequencies [Hz] by drive value, whose errors the curve reports.
    """
    d, f = np.asarray(values, float), np.asarray(frequency_Hz, float)
    size = np.abs(d).max()
    powers = np.stack([(d / size) ** n for n in (0, 2, 4)], axis=1)
    c = np.linalg.solve(powers, 1.0 / (2 * np.pi * f) ** 2) / size ** np.array([0, 2, 4])
    curve = FrequencyCurve(drive, tuple(d.tolist()), tuple(f.tolist()), tuple(c.tolist()), {})
    return replace(curve, checked={v: (g, float(curve(v)) / g - 1.0) for v, g in checks.items()})


TRACKING_POSES = 24
"""Number of poses over one side of the stroke at which a mode is followed by MAC."""


@clear_argument_errors
@small_matrices
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

    mechanism: Mechanism, Scene, Model or `Solver`. drive: name; stroke [m or rad]. mode: "intended", "first_parasitic", or
    "parasitic_1", ... as numbered at rest and followed by MAC, which needs more solves. checks: fractions of the stroke at
    which the error is computed. held: values of the other drives [m or rad]; method: as in `ksd.solve`. Raises SceneError
    for wrong names, ConvergenceError where a configuration is not found.

    >>> guide, _, _ = ksd.load_scene("guide")
    >>> curve = ksd.frequency_curve(guide, "table", 5 * mm, method="conventional")
    >>> print([f"{frequency:.2f} Hz" for frequency in curve.frequency_Hz])
    ['140.20 Hz', '97.24 Hz', '60.83 Hz']
    """
    solver = mechanism if isinstance(mechanism, Solver) else Solver(mechanism)
    if drive not in solver.model.drive_names:
        raise SceneError(
            f"'{drive}' is not a drive; the drives are {', '.join(solver.model.drive_names) or 'none'}"
        )
    if not stroke > 0.0:
        raise SceneError(f"stroke = {stroke}: a positive drive value [m or rad] is needed")
    used = (0.0, 0.5, 1.0)
    fractions = sorted({*used, *(float(c) for c in checks)})
    values = [stroke * fraction for fraction in fractions]
    frequencies = _frequencies(solver, drive, values, held or {}, mode, method)
    by_fraction = dict(zip(fractions, frequencies, strict=True))
    curve = even_curve(
        drive, [stroke * u for u in used], [by_fraction[u] for u in used],
        {stroke * fraction: f for fraction, f in by_fraction.items() if fraction not in used},
    )  # fmt: skip
    refined = np.array(_frequencies(solver, drive, values, held or {}, mode, method, refine=True))
    return replace(curve, solved_error=float(np.abs(refined / np.array(frequencies) - 1.0).max()))


def _frequencies(
    solver: Solver,
    drive: str,
    values: list[float],
    held: dict[str, float],
    mode: str,
    method: Method,
    *,
    refine: bool = False,
) -> list[float]:
    """Frequency [Hz] of the mode at each of `values` (ascending); refine: of the equilibrium on a finer mesh."""
    freed = solver.model.drive_names

    def modes_at(d: float, additional: int = 0) -> Any:
        pose = solver({**held, drive: d}, method=method, estimate=False)
        pose = refined_configuration(pose) if refine else pose
        return pose.frequencies(count=4 + len(freed) + SPARE_MODES + additional, freed=freed)

    if mode in ("intended", "first_parasitic"):
        tracks = [start_tracks(modes_at(d), 1) for d in values]
        return [t.frequency_Hz(_track(t, mode)) for t in tracks]
    largest = max(abs(d) for d in values)
    start = start_tracks(modes_at(0.0), 4)
    if mode not in start.names:
        raise SceneError(f"mode = {mode!r}: choose first_parasitic or one of {', '.join(start.names)}")
    frequency_at: dict[float, float] = {}
    for sign in (1.0, -1.0):
        tracks_here: Tracks = start
        distances = sorted(
            {abs(d) for d in values if d * sign >= 0.0}
            | set(np.linspace(0, largest, TRACKING_POSES).tolist())
        )
        last = 0.0
        for d in distances if any(v * sign > 0.0 for v in values) else [0.0]:

            def modes_between(
                share: float, additional: int, a: float = sign * last, b: float = sign * d
            ) -> Any:
                return modes_at((1.0 - share) * a + share * b, additional)

            tracks_here = follow_with_bisection(tracks_here, modes_at(sign * d), 4, modes_between)
            frequency_at[sign * d], last = tracks_here.frequency_Hz(start.names.index(mode)), d
    return [frequency_at[d] for d in values]


def _track(tracks: Tracks, mode: str) -> int:
    """Index of the track of the lowest intended mode, or of the first parasitic one. Raises SceneError without one."""
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
