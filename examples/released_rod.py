"""Where is the end of a bent rod .3 s after it was let go, and is its energy still there?

The rod of 1.11 m of Lan 2005, example 4.I.1, is bent by 7.187 N until its end is .41 m off. The force goes away
within 40 ms; the numbers are those of finite elements, extrapolated in step and mesh.
"""

import numpy as np

import ksd
from ksd.units import GPa, mm

steel = ksd.Material(E=200 * GPa, G=80 * GPa, density=7850)
rod = ksd.Mechanism("rod", plane="xy")
tip = rod.link("tip")
section = ksd.rectangle(thickness=3.2 * mm, width=12.7 * mm)
rod.leaf("ground", tip, start=(0, 0, 0), end=(1.11, 0, 0), section=section, material=steel)
rod.load(tip, force=(0, 7.187, 0), at=(1.11, 0, 0), name="pull")

history = ksd.simulate(rod, until="0.5 s", dt="1 ms", loads={"pull": ksd.Ramp("40 ms", start=1, end=0)})
x, y, _ = history["tip"].at((1.11, 0, 0)).position[np.searchsorted(history.t, 0.3 - 1e-9)]
energy = history.energy.kinetic + history.energy.strain
released = history.t > 0.05
kept = float(energy[released].min() / energy[released].max())
stress = history[0.3].strength.stress_Pa / 1e6  # MPa


def picture(path=None):
    """The rod .3 s after."""
    return history[0.3].plot(path, color="stress")


print(history)
print(
    f"at .3 s the end is at ({x:.5f}, {y:.5f}) m, stress {stress:.0f} MPa; {100 * kept:.3f} % of the energy are left"
)

if __name__ == "__main__":
    picture("released_rod.png")
