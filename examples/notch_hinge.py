"""How stiff is a circular notch hinge, and when does it yield?

Closed forms of Paros and Weisbord (Machine Design 37, 1965) for thin necks: K = 2 E b t^2.5/(9 pi sqrt(R)), and stress
6 M/(b t^2) in the middle, without stress concentration.
"""

import ksd
from ksd.units import GPa, MPa, deg, mm

R, t, b = 5 * mm, 0.1 * mm, 10 * mm

aluminium = ksd.Material(E=70 * GPa, nu=0.33, yield_stress=500 * MPa)
joint = ksd.CircularNotchHinge(aluminium, radius=R, minimum=t, width=b)

scene = ksd.Mechanism("notch hinge")
arm = scene.link("arm")
placed = scene.join(scene.ground, arm, joint, at=(0, 0, 0), axis="z", toward="x", name="notch")
scene.actuate_joint(placed, name="turn")

turn = 1 * deg
pose = ksd.solve(scene, turn=turn)
stiffness = pose.forces["turn"] / turn
stress = pose.stress().largest_Pa
may_turn = turn / pose.strength.yield_share


def picture(path=None):
    """The hinge turned by a degree, coloured by stress."""
    return pose.plot(path, color="stress")


print(f"stiffness {stiffness:.5f} Nm/rad; at {turn / deg:g} degree {stress / MPa:.1f} MPa")
print(f"it yields at {may_turn / deg:.2f} degrees")

if __name__ == "__main__":
    picture("notch_hinge.png")
