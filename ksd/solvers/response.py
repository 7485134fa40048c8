"""Frequency responses about a pose, from drive forces, loads and a shaken base to sensors and drive motions."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ksd.answers.plant import Plant
from ksd.answers.printing import PrintableAnswer, format_number, format_table
from ksd.checks import number, show
from ksd.errors import SceneError
from ksd.files import write_file
from ksd.view import save_figure
from ksd.view.bode import phase_in_degrees, plot_bode

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
POINTS_PER_DECADE = 60
"""Frequencies per decade where none are given; more are added around every mode."""
HALF_WIDTHS = (-8.0, -4.0, -2.0, -1.0, -0.5, -0.25, 0.0, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
"""Frequencies added around every mode, in half widths of its peak."""
MIN_PEAK_RATIO = 1.02
"""Gain at a peak over that between it and its neighbours."""


@dataclass(frozen=True, repr=False)
class Response(PrintableAnswer):
    """Frequency response of every output to every input.

    frequency_Hz (n,); value (n, outputs, inputs): complex amplitude of an output per unit amplitude of an input, e^(i w t);
    inputs, outputs: their names; units (outputs, inputs). error (n, outputs, inputs): bound of what the modes left out of
    `plant` would change. drives hold but for those in plant.freed.
    """

    frequency_Hz: Array
    value: NDArray[np.complex128]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    units: tuple[tuple[str, ...], ...]
    error: Array
    plant: Plant

    @property
    def gain(self) -> Array:
        """Magnitude (n, outputs, inputs)."""
        return np.abs(self.value)

    @property
    def phase_deg(self) -> Array:
        """Phase (n, outputs, inputs) [deg], without jumps along the frequencies."""
        columns = self.value.reshape(len(self.value), -1).T
        return np.array([phase_in_degrees(v) for v in columns]).T.reshape(self.value.shape)

    def of(self, output: str, source: str | None = None) -> NDArray[np.complex128]:
        """Response (n,) of one output to one input; `source` may be left out where there is one input."""
        if output not in self.outputs:
            raise SceneError(f"output {show(output)} is not among {', '.join(self.outputs)}")
        if source is None and len(self.inputs) > 1:
            raise SceneError(f"there are several inputs: name one of {', '.join(self.inputs)}")
        source = self.inputs[0] if source is None else source
        if source not in self.inputs:
            raise SceneError(f"input {show(source)} is not among {', '.join(self.inputs)}")
        return np.asarray(self.value[:, self.outputs.index(output), self.inputs.index(source)])

    @cached_property
    def peaks(self) -> dict[tuple[str, str], tuple[tuple[float, float], ...]]:
        """Frequency [Hz] and gain of every resonance, by output and input, in the order of frequency.

        The gain is evaluated again around every mode, so that it does not hang on the frequencies of the answer.
        """
        found = {}
        frequencies = np.unique(np.concatenate([self.frequency_Hz, _around_modes(self.plant, steps=81)]))
        inside = (frequencies >= self.frequency_Hz[0]) & (frequencies <= self.frequency_Hz[-1])
        frequencies = frequencies[inside]
        gain = np.abs(self.plant.transfer(frequencies))
        for o, output in enumerate(self.outputs):
            for i, source in enumerate(self.inputs):
                found[output, source] = tuple(_peaks(frequencies, gain[:, o, i]))
        return found

    def _line(self) -> str:
        return (
            f"{', '.join(self.inputs)} to {', '.join(self.outputs)} at {len(self.frequency_Hz)} frequencies"
        )

    def __str__(self) -> str:
        rows = []
        first = self.gain[0]
        for o, output in enumerate(self.outputs):
            for i, source in enumerate(self.inputs):
                peaks = self.peaks[output, source]
                highest = sorted(sorted(peaks, key=lambda p: -p[1])[:3])
                text = ", ".join(f"{format_number(g)} at {format_number(f)} Hz" for f, g in highest)
                rows.append(
                    (output, source, self.units[o][i], format_number(float(first[o, i])), text or "none")
                )
        low, high = (format_number(float(f)) for f in self.frequency_Hz[[0, -1]])
        return format_table(
            ("output", "<from", "<unit", f"gain at {low} Hz", "<peaks"),
            rows,
            f"Frequency response, {low} to {high} Hz; damping: {self.plant.damping_text}"
            f"{_dashpots_text(self.plant)}; {len(self.plant.omega_squared)} modes, {self._error_text()}"
            f"{self.plant.held_text}",
        )

    def _error_text(self) -> str:
        """What the modes left out change, relative to the largest gain of each curve."""
        if not np.isfinite(self.plant.left_out_Hz):
            return "all there are"
        with np.errstate(divide="ignore", invalid="ignore"):
            share = self.error / self.gain.max(axis=0)
        worst = float(np.nanmax(np.where(np.isnan(share), 0.0, share)))
        if worst > 1.0:
            left_out = format_number(self.plant.left_out_Hz)
            return f"the next at {left_out} Hz, within the frequencies asked for: take more modes"
        return f"those left out change curves by less than {format_number(100 * worst, 2)} % of their largest gain"

    def plot(self, path: str | os.PathLike[str] | None = None) -> Figure:
        """Bode plot of all curves, a panel of gains for every unit; written to `path` (.png, .pdf, .svg ...) if given."""
        pairs = [(o, i) for o in range(len(self.outputs)) for i in range(len(self.inputs))]
        figure = plot_bode(
            self.frequency_Hz,
            np.column_stack([self.value[:, o, i] for o, i in pairs]),
            [f"{self.outputs[o]} / {self.inputs[i]}" for o, i in pairs],
            [self.units[o][i] for o, i in pairs],
        )
        return figure if path is None else save_figure(figure, path)

    def to_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write frequency, and gain, phase [deg] and error of every pair as a CSV file. Returns the path."""
        phase, header, columns = self.phase_deg, ["frequency_Hz"], [self.frequency_Hz]
        for o, output in enumerate(self.outputs):
            for i, source in enumerate(self.inputs):
                name = f"{output} per {source} [{self.units[o][i]}]"
                header += [name, f"{name} phase_deg", f"{name} error"]
                columns += [self.gain[:, o, i], phase[:, o, i], self.error[:, o, i]]
        quoted = [f'"{name}"' if "," in name else name for name in header]
        lines = [",".join(quoted), *(",".join(f"{v:.12g}" for v in row) for row in np.column_stack(columns))]
        return write_file(path, "\n".join(lines) + "\n", what="CSV file")


def _dashpots_text(plant: Plant) -> str:
    """Words for the dashpots of a plant."""
    count = len(plant.dashpots)
    return f", and {count} damper{'s' * (count > 1)}" * bool(count)


def frequency_grid(frequency_Hz: Any) -> Array:
    """Frequencies (n,) [Hz] given by the user, ascending; raises SceneError."""
    given = np.atleast_1d(np.asarray(frequency_Hz, dtype=object)).ravel()
    if not len(given):
        raise SceneError("frequency_Hz is empty; give frequencies in Hz")
    values = np.array([number(f, "frequency_Hz", unit="Hz") for f in given.tolist()])
    if not np.all(values > 0.0):
        wrong = values[values <= 0.0][0]
        raise SceneError(
            f"frequency_Hz: {wrong:g} Hz is not positive; the gain at 0 Hz is the static compliance"
        )
    return np.unique(values)


def default_grid(plant: Plant) -> Array:
    """Frequencies (n,) [Hz] that show the modes of a plant: from a tenth of the lowest to beyond the sixth."""
    f = plant.frequency_Hz[plant.frequency_Hz > 0.0]
    low, high = (0.1 * f[0], 1.2 * f[min(len(f), 6) - 1]) if len(f) else (0.1, 1000.0)
    count = max(2, int(POINTS_PER_DECADE * np.log10(high / low)))
    grid = np.concatenate([np.geomspace(low, high, count), _around_modes(plant)])
    return np.unique(grid[(grid >= low) & (grid <= high)])


def _around_modes(plant: Plant, steps: int = 0) -> Array:
    """Frequencies [Hz] around every mode, at HALF_WIDTHS or at `steps` equal ones up to 4 half widths."""
    f = plant.frequency_Hz
    width = np.maximum(plant.ratio, 1e-6) * f
    at = np.linspace(-4.0, 4.0, steps) if steps else np.array(HALF_WIDTHS)
    around: Array = (f[:, None] + width[:, None] * at).ravel()
    return around[around > 0.0]


def _peaks(frequency_Hz: Array, gain: Array) -> list[tuple[float, float]]:
    """Frequency and gain of the local maxima of a curve that stand out from both sides by MIN_PEAK_RATIO."""
    found: list[tuple[float, float]] = []
    low = gain[0]
    for k in range(1, len(gain) - 1):
        low = min(low, gain[k])
        if gain[k] >= gain[k - 1] and gain[k] > gain[k + 1] and gain[k] > MIN_PEAK_RATIO * low:
            found.append((float(frequency_Hz[k]), float(gain[k])))
            low = gain[k]
    return found


def respond(plant: Plant, grid: Array | None = None) -> Response:
    """Response of a plant at frequencies (n,) [Hz] of `frequency_grid`; around its modes where None."""
    grid = default_grid(plant) if grid is None else grid
    units = tuple(
        tuple(o if i == "1" else f"{o} per {i}" for i in plant.input_units) for o in plant.output_units
    )
    return Response(
        grid, plant.transfer(grid), plant.inputs, plant.outputs, units, plant.truncation_error(grid), plant
    )
