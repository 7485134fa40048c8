"""`ksd respond SCENE.toml`: what sensors see when a scene is driven or shaken at its pose."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from ksd.cli.output import check_json, check_plot, show
from ksd.cli.solve import load_with_options, merged_options, number_or_text, solve_warm
from ksd.errors import SceneError
from ksd.files import check_target
from ksd.scene.toml_table import quantity


def run(options: argparse.Namespace) -> int:
    """Solve, respond, print, write. Errors as in `ksd.solve`, `ksd.load_scene` and `Configuration.response`."""
    check_json(options.json)
    check_plot(options.plot)
    if options.out is not None:
        if Path(options.out).suffix.lower() != ".csv":
            raise SceneError(f"--out {options.out}: the ending must be .csv")
        check_target(options.out, what="--out")
    if options.plot and options.psd:
        raise SceneError("--plot draws frequency responses; leave --psd out for it")
    scene, targets, written = load_with_options(options.scene, options.set)
    pose = solve_warm(scene, targets, merged_options(written, options))
    inputs = [*options.input, *(f"base {direction}" for direction in options.base)]
    words = {
        "outputs": options.output or None, "damping": damping_value(options.damping), "modes": options.modes,
        "freed": options.freed or written["report"].get("freed"),
    }  # fmt: skip
    if options.psd:
        found = pose.random_vibration(spectra(options.psd), **words)
    else:
        found = pose.response(_frequencies(options.frequencies), inputs=inputs or None, **words)
        if options.out:
            found.to_csv(options.out)
        if options.plot:
            found.plot(options.plot)
    show(options.json, lambda: (_random_numbers if options.psd else _response_numbers)(found), str(found))
    return 0


def damping_value(text: str | None) -> Any:
    """The damping of "0.01", "0.01,0.02" (of each mode), "5:0.01,100:0.02" (pairs of frequency and ratio) or "materials";
    None where not given."""
    if text is None:
        return None
    parts = [tuple(map(number_or_text, part.split(":"))) for part in text.split(",")]
    if len(parts) == 1 and len(parts[0]) == 1:
        return parts[0][0]
    return [part[0] if len(part) == 1 else part for part in parts]


def _frequencies(text: str | None) -> Any:
    """Frequencies [Hz] of "FROM:TO" or "FROM:TO:POINTS", even on a logarithmic axis; None where not given."""
    if text is None:
        return None
    parts = text.split(":")
    if len(parts) not in (2, 3) or (len(parts) == 3 and not parts[2].strip().isdecimal()):
        raise SceneError(f"--frequencies {text}: write FROM:TO or FROM:TO:POINTS, such as 1Hz:2kHz:500")
    low, high = (quantity(number_or_text(p.strip()), "frequency", "--frequencies") for p in parts[:2])
    points = 500 if len(parts) == 2 else int(parts[2])
    if not 0.0 < low < high or not 2 <= points <= 100_000:
        raise SceneError(f"--frequencies {text}: from above 0 up, at 2 to 100000 points")
    return np.geomspace(low, high, points)


def spectra(texts: list[str]) -> dict[str, list[tuple[float, float]]]:
    """Knots, in Hz and unit^2/Hz, of the inputs in texts such as "base y=1:1e-3,200:1e-3". Raises SceneError."""
    return dict(map(_spectrum, texts))


def _spectrum(text: str) -> tuple[str, list[tuple[float, float]]]:
    name, equals, knots = text.rpartition("=")
    rows = [tuple(number_or_text(word.strip()) for word in knot.split(":")) for knot in knots.split(",")]
    if not equals or any(len(row) != 2 or isinstance(row[1], str) for row in rows):
        raise SceneError(
            f"--psd {text}: write INPUT=HZ:DENSITY,HZ:DENSITY, such as --psd 'base y=1:1e-3,200:1e-3', density in the unit"
            " of the input squared per Hz"
        )
    return name.strip(), [
        (quantity(hz, "frequency", f"--psd {text}"), float(density)) for hz, density in rows
    ]


def _response_numbers(found: Any) -> dict[str, Any]:
    """A `Response` for JSON."""
    pairs = [(o, i) for o in range(len(found.outputs)) for i in range(len(found.inputs))]
    phase = found.phase_deg
    return {
        "frequency_Hz": found.frequency_Hz.tolist(), "damping": found.plant.damping_text,
        "modes_Hz": found.plant.frequency_Hz.tolist(), "freed": list(found.plant.freed),
        "responses": [
            {
                "output": found.outputs[o], "input": found.inputs[i], "unit": found.units[o][i],
                "gain": found.gain[:, o, i].tolist(), "phase_deg": phase[:, o, i].tolist(),
                "error": [e if np.isfinite(e) else None for e in found.error[:, o, i].tolist()],
                "peaks": [{"frequency_Hz": f, "gain": g} for f, g in found.peaks[found.outputs[o], found.inputs[i]]],
            }
            for o, i in pairs
        ],
    }  # fmt: skip


def _random_numbers(found: Any) -> dict[str, Any]:
    """A `RandomVibration` for JSON."""
    return {
        "damping": found.damping_text, "modes_Hz": found.frequency_Hz.tolist(), "range_Hz": list(found.range_Hz),
        "outputs": [
            {"output": n, "unit": u, "rms": float(r), "share_of_modes": s[:-1].tolist(), "share_above": float(s[-1])}
            for n, u, r, s in zip(found.outputs, found.units, found.rms, found.share, strict=True)
        ],
        "three_sigma_stress_MPa": dict(found.stress_MPa),
    }  # fmt: skip
