"""Factors from the engineer's units to SI, and back: ``300*mm`` is 0.3, ``angle/deg`` is in degrees."""

from math import pi

m, mm, um, nm = 1.0, 1e-3, 1e-6, 1e-9
rad, mrad, urad, deg = 1.0, 1e-3, 1e-6, pi / 180
Pa, kPa, MPa, GPa = 1.0, 1e3, 1e6, 1e9
N, mN, kN = 1.0, 1e-3, 1e3
Nm, mNm = 1.0, 1e-3
kg, g, tonne = 1.0, 1e-3, 1e3
s, ms = 1.0, 1e-3
Hz = 2 * pi
"""One hertz as an angular frequency in rad/s."""

NAMES = {
    "m": m, "mm": mm, "um": um, "nm": nm,
    "rad": rad, "mrad": mrad, "urad": urad, "deg": deg,
    "Pa": Pa, "kPa": kPa, "MPa": MPa, "GPa": GPa,
    "N": N, "mN": mN, "kN": kN, "Nm": Nm, "mNm": mNm,
    "kg": kg, "g": g, "tonne": tonne, "kg/m3": 1.0,
}  # fmt: skip
"""Unit names a TOML scene may use, with their SI factors."""
