"""Random vibration about a pose: rms values of sensors, and of stress, under stationary excitations of given spectra.

rms^2 = int |H(f)|^2 S(f) df over the range of the spectrum, by Gauss points between its knots and points that close in on
every resonance geometrically: an even grid misses the peak of a mode with a damping ratio of .001. Spectra are one-sided
[unit^2/Hz] and straight between their knots on logarithmic axes, as standards give them; several inputs are uncorrelated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.answers.modal_stress import ModalStress
from ksd.answers.plant import Plant
from ksd.answers.printing import PrintableAnswer, format_number, format_table
from ksd.checks import number, show
from ksd.errors import SceneError

Array = NDArray[np.float64]
Spectrum = Sequence[tuple[float, float]]
GAUSS_POINTS = 8
"""Points of every part of the integral."""
CLOSING_STEPS = 2.0 ** np.arange(-2, 16)
"""Ends of the parts on both sides of a resonance, in half widths of its peak."""
MIN_PART = 1e-12
"""Length of a part, relative to its frequency, below which it is left out."""


@dataclass(frozen=True, repr=False)
class RandomVibration(PrintableAnswer):
    """Root mean squares of outputs under random excitation.

    outputs, units (o,): names and units; rms (o,); share (o, k + 1): of each mode in rms^2, and of the response of the modes
    left out, which sum to 1 (a share may be negative, where a mode works against others). frequency_Hz (k,): of the modes.
    range_Hz: of the spectra. stress_MPa: three times the rms of the von Mises stress by leaf spring, about the stress of the
    pose. damping_text: what the damping is, and which drives hold.
    """

    outputs: tuple[str, ...]
    units: tuple[str, ...]
    rms: Array
    share: Array
    frequency_Hz: Array
    range_Hz: tuple[float, float]
    stress_MPa: Mapping[str, float]
    damping_text: str

    def _line(self) -> str:
        rows = zip(self.outputs, self.rms, self.units, strict=True)
        return ", ".join(f"{o} {format_number(float(v))} {u} rms" for o, v, u in rows)

    def __str__(self) -> str:
        rows = []
        for o, name in enumerate(self.outputs):
            largest = np.argsort(-np.abs(self.share[o]))[:3]
            text = ", ".join(self._share_text(o, int(k)) for k in largest if abs(self.share[o, k]) >= 0.005)
            rms = float(self.rms[o])
            rows.append((name, format_number(rms), format_number(3 * rms), self.units[o], text))
        worst = max(self.stress_MPa.items(), key=lambda item: item[1])
        low, high = (format_number(f) for f in self.range_Hz)
        return format_table(
            ("output", "rms", "3 sigma", "<unit", "<by mode"),
            rows,
            f"Random vibration, {low} to {high} Hz; damping: {self.damping_text}",
            f"Stress: 3 sigma of the von Mises stress at most {format_number(worst[1])} MPa, in '{worst[0]}', about "
            "that of the pose",
        )

    def _share_text(self, o: int, k: int) -> str:
        percent = f"{100.0 * self.share[o, k]:.3g} %"
        if k == len(self.frequency_Hz):
            return f"{percent} above"
        return f"{percent} at {format_number(float(self.frequency_Hz[k]))} Hz"


def check_spectra(psd: Any, inputs: Sequence[str] | None = None) -> dict[str, Array]:
    """Knots (n, 2) of frequency [Hz] and power spectral density [unit^2/Hz] by input. Raises SceneError."""
    if not isinstance(psd, Mapping) or not psd:
        raise SceneError(f"psd = {show(psd)}: give spectra by input, {{'base y': [(1, 1e-3), (200, 1e-3)]}}")
    found = {}
    for name, knots in psd.items():
        owner = f"psd of '{name}'"
        if inputs is not None and name not in inputs:
            raise SceneError(f"{owner}: there is no such input; the inputs are {', '.join(inputs)}")
        rows = knots.tolist() if isinstance(knots, np.ndarray) else knots
        if not isinstance(rows, list | tuple) or any(
            not isinstance(row, list | tuple) or len(row) != 2 for row in rows
        ):
            raise SceneError(
                f"{owner} = {show(knots)}: points (frequency [Hz], density [unit^2/Hz]) are needed"
            )
        if len(rows) < 2:
            raise SceneError(f"{owner}: one point is no spectrum; give two at least, the ends of its range")
        f = np.array([number(row[0], f"{owner}: frequency", unit="Hz") for row in rows])
        S = np.array([number(row[1], f"{owner}: density") for row in rows])
        if not np.all(f > 0.0) or not np.all(np.diff(f) > 0.0):
            raise SceneError(f"{owner}: frequencies {show(f.tolist())} must be positive and rise")
        if S.min() < 0.0:
            raise SceneError(f"{owner}: a density of {S.min():g} is negative")
        found[name] = np.column_stack([f, S])
    return found


def _density(knots: Array, f: Array) -> Array:
    """Density (n,) at frequencies, straight between knots on logarithmic axes, or on plain ones where a knot is zero."""
    if np.all(knots[:, 1] > 0.0):
        inside = np.exp(np.interp(np.log(f), np.log(knots[:, 0]), np.log(knots[:, 1])))
    else:
        inside = np.interp(f, *knots.T)
    return np.where((f >= knots[0, 0]) & (f <= knots[-1, 0]), inside, 0.0)


def _gauss_grid(plant: Plant, knots: Array) -> tuple[Array, Array]:
    """Frequencies and weights (n,) of the integral between the first and the last knot."""
    width = np.maximum(plant.ratio, 1e-5) * plant.frequency_Hz
    near = np.concatenate([-CLOSING_STEPS[::-1], [0.0], CLOSING_STEPS])
    ends = np.unique(np.concatenate([knots, (plant.frequency_Hz[:, None] + width[:, None] * near).ravel()]))
    ends = ends[(ends >= knots[0]) & (ends <= knots[-1])]
    x, w = np.polynomial.legendre.leggauss(GAUSS_POINTS)
    low, high = (np.array(part) for part in zip(*pairwise(ends.tolist()), strict=True))
    kept = high - low > MIN_PART * high
    # parts far from resonances span octaves: the points are even in the logarithm of frequency
    middle, half = 0.5 * np.log(low * high)[kept], 0.5 * np.log(high / low)[kept]
    f = np.exp(middle[:, None] + half[:, None] * x)
    return f.ravel(), (f * half[:, None] * w).ravel()


def rms_values(plant: Plant, psd: Mapping[str, Array]) -> Array:
    """Root mean squares (o,) of the outputs alone, as in `vibrate`."""
    f, power = _power(plant, psd)
    return np.asarray(np.sqrt(np.einsum("noi,ni->o", np.abs(plant.transfer(f)) ** 2, power)))


def _power(plant: Plant, psd: Mapping[str, Array]) -> tuple[Array, Array]:
    """Frequencies (n,) and power (n, i) of every input at them: its density times the weight of the integral."""
    f, weight = _gauss_grid(plant, np.unique(np.concatenate([rows[:, 0] for rows in psd.values()])))
    S = np.zeros((len(f), len(plant.inputs)))
    for name, rows in psd.items():
        S[:, plant.inputs.index(name)] = _density(rows, f)
    return f, weight[:, None] * S


def vibrate(plant: Plant, psd: Mapping[str, Array], stress: ModalStress) -> RandomVibration:
    """Root mean squares under the spectra of `check_spectra`."""
    f, power = _power(plant, psd)
    ends = [rows[[0, -1], 0] for rows in psd.values()]
    response, modal = plant.transfer(f), plant.modal(f)
    rate = (2j * np.pi * f)[:, None, None, None] ** plant.derivatives[None, :, None, None]
    # of every mode alone (n, o, k, i)
    by_mode = rate * (plant.motion[None, :, :, None] * modal[:, None])
    squared = np.einsum("noi,ni->o", np.abs(response) ** 2, power)
    shares = np.einsum("noki,noi,ni->ok", by_mode, response.conj(), power).real
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.where(squared[:, None] > 0.0, shares / squared[:, None], 0.0)
    rest = np.where(squared > 0.0, 1.0 - shares.sum(axis=1), 0.0)
    covariance = np.einsum("nki,nli,ni->kl", modal, modal.conj(), power).real
    three_sigma = {name: 3e-6 * value for name, value in stress.rms(covariance).items()}
    return RandomVibration(
        plant.outputs, plant.output_units, np.sqrt(squared), np.column_stack([shares, rest]), plant.frequency_Hz,
        (float(np.min(ends)), float(np.max(ends))), three_sigma, plant.damping_text + plant.held_text,
    )  # fmt: skip
