"""How much does the stiffness of a pivot scatter with its thickness, length and width?

K is the sum of EI/L of all leaf springs: one percent of thickness changes it by three percent, one percent of length or
width by one percent. Variances of independent parameters add.
"""

import numpy as np

import ksd
from ksd.units import GPa, deg, mm, um

design = {"length": 60 * mm, "thickness": 0.3 * mm, "width": 20 * mm}
spread = {"length": 20 * um, "thickness": 5 * um, "width": 20 * um}  # standard deviations

steel = ksd.Material(E=200 * GPa, nu=0.3)


def pivot(length, thickness, width):
    """A cross flexure between ground and an arm; the outer leaf springs are half as wide as the inner one."""
    joint = ksd.CrossFlexure(
        steel, length=length, angle=45 * deg, thickness=thickness, widths=(width, width / 2), spacing=20 * mm
    )
    scene = ksd.Mechanism("pivot")
    arm = scene.link("arm")
    placed = scene.join(scene.ground, arm, joint, at=(0, 0, 0), axis="z", toward="x")
    scene.actuate_joint(placed, name="turn")
    return scene


slopes = ksd.gradient(pivot, design, turn=10 * deg, questions=("force", "stress"))
percent = {name: float(slopes.relative["turn_moment_Nm", name][0]) for name in design}
thickness, length, width = percent["thickness"], percent["length"], percent["width"]
parts = {name: percent[name] * spread[name] / design[name] for name in design}
scatter = float(np.sqrt(sum(part**2 for part in parts.values())))
worst = max(parts, key=lambda name: abs(parts[name]))


def picture(path=None):
    """The nominal pivot at 10 degrees."""
    return ksd.solve(pivot(**design), turn=10 * deg).plot(path)


for name, value in percent.items():
    print(f"one percent of {name}: {value:+.4f} percent of moment")
share = parts[worst] ** 2 / scatter**2
print(
    f"standard deviation of the moment {100 * scatter:.3f} %, {100 * share:.2f} % of its variance by {worst}"
)

if __name__ == "__main__":
    picture("pivot_tolerance.png")
