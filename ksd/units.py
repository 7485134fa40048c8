"""Factors from the engineer's units to SI, and back: ``300*mm`` is 0.3, ``angle/deg`` is in degrees.

>>> print(f"{300 * ksd.units.mm:g} m, {0.5 / ksd.units.deg:.3f} deg")
0.3 m, 28.648 deg
"""

from math import pi

m, cm, mm, um, nm = 1.0, 1e-2, 1e-3, 1e-6, 1e-9
inch, ft = 0.0254, 0.3048
rad, mrad, urad, deg = 1.0, 1e-3, 1e-6, pi / 180
Pa, kPa, MPa, GPa = 1.0, 1e3, 1e6, 1e9
N, mN, kN, MN = 1.0, 1e-3, 1e3, 1e6
lb = 0.45359237
lbf = 9.80665 * lb
psi, ksi = lbf / inch**2, 1e3 * lbf / inch**2
Nm, mNm, Nmm = 1.0, 1e-3, 1e-3
kg, g, tonne = 1.0, 1e-3, 1e3
s, ms = 1.0, 1e-3
Hz = 2 * pi
"""One hertz as an angular frequency in rad/s."""

DIMENSIONS: dict[str, dict[str, float]] = {
    "length": {"m": m, "cm": cm, "mm": mm, "um": um, "nm": nm, "inch": inch, "in": inch, "ft": ft},
    "angle": {"rad": rad, "mrad": mrad, "urad": urad, "deg": deg},
    "stress": {
        "Pa": Pa, "kPa": kPa, "MPa": MPa, "GPa": GPa, "N/m^2": 1.0, "N/mm^2": MPa, "kN/mm^2": GPa, "psi": psi, "ksi": ksi,
        "bar": 1e5, "mbar": 1e2,
    },
    "force": {"N": N, "mN": mN, "kN": kN, "MN": MN, "lbf": lbf},
    "moment": {
        "Nm": Nm, "mNm": mNm, "Nmm": Nmm, "kNm": kN, "lbf in": lbf * inch, "in lbf": lbf * inch, "lbf ft": lbf * ft,
        "ft lbf": lbf * ft,
    },
    "moment per length": {
        "Nm/m": 1.0, "Nmm/mm": 1.0, "mNm/m": 1e-3, "mNm/mm": 1.0, "Nmm/m": 1e-3, "kNm/m": 1e3, "lbf in/in": lbf,
    },
    "mass": {"kg": kg, "g": g, "tonne": tonne, "lb": lb},
    "density": {"kg/m^3": 1.0, "g/cm^3": 1e3, "lb/in^3": lb / inch**3, "lb/ft^3": lb / ft**3},
    "acceleration": {"m/s^2": 1.0, "mm/s^2": mm, "ft/s^2": ft, "in/s^2": inch},
    "stiffness": {"N/m": 1.0, "N/mm": 1e3, "mN/mm": 1.0, "kN/m": 1e3, "lbf/in": lbf / inch, "lbf/ft": lbf / ft},
    "torsional stiffness": {
        "Nm/rad": 1.0, "Nmm/rad": 1e-3, "mNm/rad": 1e-3, "Nm/deg": 1 / deg, "Nmm/deg": 1e-3 / deg,
        "lbf in/rad": lbf * inch, "in lbf/rad": lbf * inch, "lbf in/deg": lbf * inch / deg, "in lbf/deg": lbf * inch / deg,
    },
    "softness": {"m/N": 1.0, "mm/N": mm, "um/N": um},
    "torsional softness": {"rad/Nm": 1.0, "rad/Nmm": 1e3, "mrad/Nm": mrad, "deg/Nm": deg, "deg/Nmm": 1e3 * deg},
    "damping": {"N s/m": 1.0, "N s/mm": 1e3, "mN s/mm": 1.0},
    "torsional damping": {"Nm s/rad": 1.0, "Nmm s/rad": 1e-3, "mNm s/rad": 1e-3},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0},
    "frequency": {"Hz": 1.0, "kHz": 1e3, "mHz": 1e-3},
    "inertia": {"kg m^2": 1.0, "kg mm^2": 1e-6, "g cm^2": 1e-7, "g mm^2": 1e-9, "lb in^2": lb * inch**2},
    "temperature": {"K": 1.0},
    "expansion": {"1/K": 1.0, "um/m/K": 1e-6},
    "area": {"m^2": 1.0, "cm^2": cm**2, "mm^2": mm**2, "um^2": um**2, "in^2": inch**2},
    "second moment": {"m^4": 1.0, "cm^4": cm**4, "mm^4": mm**4, "um^4": um**4, "in^4": inch**4},
    "warping constant": {"m^6": 1.0, "mm^6": mm**6},
}  # fmt: skip
"""Units a scene file may use, with their SI factors, by dimension; the first is the SI unit, in which plain numbers are."""
