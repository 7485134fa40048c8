"""Dynamics: from frequency to response to motion

A stage on two leaf springs, pushed by a voice coil. Its frequency and its response to small forces are linear answers about
one pose; its motion in time is not limited to small strokes. This tutorial goes from one to the next, and ends in a film.
"""

# %%
# The stage
# ---------
#
# In a plane, with a load of 1 N, the coil, and a sensor. The loss factor is that of leaf springs with a damping tape.

import tempfile
from pathlib import Path

import numpy as np

import ksd
from ksd.units import GPa, mm, ms

steel = ksd.Material(E=200 * GPa, nu=0.3, density=7800, loss_factor=0.06)
length, centre = 60 * mm, (25 * mm, 60 * mm, 0)
scene = ksd.Mechanism("stage", plane="xy")
stage = scene.link("stage", mass=0.5, inertia=(1e-4, 1e-4, 1e-4), at=centre)
for x in (0, 50 * mm):
    leaf = ksd.rectangle(thickness=0.3 * mm, width=20 * mm)
    scene.leaf("ground", stage, start=(x, 0, 0), end=(x, length, 0), section=leaf, material=steel)
scene.load(stage, force=(1, 0, 0), at=centre, name="coil")
scene.sensor(stage, along="x", at=centre, name="place")

# %%
# Frequency
# ---------
#
# The second mode is that of a leaf spring between its ends, far above the first.

rest = ksd.solve(scene)
modes = rest.frequencies(count=2)
frequency = float(modes.frequency_Hz[0])
print(modes)

# %%
# Response
# --------
#
# Amplitude of the stage per newton of the coil, with the damping of the material.

sweep = rest.response(np.geomspace(1, 50, 300), inputs="coil", outputs="place")
print(sweep)
sweep.plot()

# %%
# Motion
# ------
#
# A force that swings at 4 Hz from one moment to the next: at first the stage rings at its own frequency as well, later it
# follows the force. The last of many periods has the amplitude of the linear response. A material has its loss factor at
# one frequency in time, `damping_at`: that of the mode, as in the response.

small = ksd.simulate(
    scene, "8 s", dt="1 ms", loads={"coil": ksd.Sine(0.01, frequency_Hz=4)}, damping_at=frequency
)
late = small.t > 7.0
amplitude = float(np.ptp(small.sensors["place"][late])) / 2 / 0.01
linear = float(abs(rest.response(4.0, inputs="coil", outputs="place").value[0, 0, 0]))
print(f"{amplitude / mm:.4f} mm/N in time, {linear / mm:.4f} mm/N by the response")
small.plot("place")

# %%
# Large strokes
# -------------
#
# 8 N from one moment to the next move the stage by a quarter of the length of the leaf springs. Bent leaf springs are
# shorter, so the stage sinks; and it rings at another frequency than at small strokes. `accuracy` makes two runs of
# different steps, which tell the error.

pushed = ksd.simulate(scene, "1 s", accuracy=1e-3, loads={"coil": ksd.Step(8.0)}, damping_at=frequency)
ring, _ = pushed.spectrum("place").peaks[0]
sink = float(np.ptp(pushed["stage"].position[:, 1]))
print(pushed)
print(
    f"{frequency:.2f} Hz for small strokes, {ring:.2f} Hz here; it sinks by {sink / mm:.2f} mm; error {pushed.error:.0e}"
)

# %%
# The pose at any instant is a :class:`ksd.Configuration`: here the largest stress, where the stroke is largest.

turn = float(pushed.t[np.argmax(pushed.sensors["place"])])
stress = pushed[turn].strength.stress_Pa / 1e6
print(f"{stress:.0f} MPa at {turn / ms:.0f} ms")
pushed.plot("place", "kinetic energy", "strain energy", "damped energy")

# %%
# A film
# ------
#
# The first periods, slowed down.

start = ksd.simulate(scene, "0.2 s", dt="1 ms", loads={"coil": ksd.Step(8.0)}, damping_at=frequency)
start.animate(Path(tempfile.mkdtemp()) / "stage.gif", slower=8)
