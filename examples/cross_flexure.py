"""Which moment turns a cross flexure by 45 degrees, and which stress does that cause?

At small angles every leaf spring bends to a circle: M = EI angle/L, stress E t angle/(2 L) (paper 1, eq. 4.3 without its
factor 2, see errata). At 45 degrees both are larger; the tests compare them with exact rods.
"""

import ksd
from ksd.units import GPa, MPa, deg, mm

L, t, inner, outer, turn = 100 * mm, 0.5 * mm, 40 * mm, 20 * mm, 45 * deg

steel = ksd.Material(E=200 * GPa, nu=0.3, density=7800, yield_stress=1400 * MPa)
joint = ksd.CrossFlexure(steel, length=L, angle=45 * deg, thickness=t, widths=(inner, outer), gap=1 * mm)

scene = ksd.Mechanism("cross flexure")
arm = scene.link("arm")
placed = scene.join(scene.ground, arm, joint, at=(0, 0, 0), axis="z", toward="x", name="hinge")
scene.actuate_joint(placed, name="turn")

pose = ksd.solve(scene, turn=turn)
at_rest = ksd.solve(scene, turn=0.0)
stiffness, moment = at_rest.drive_stiffness()["turn"], pose.forces["turn"]
stress = pose.stress().largest_Pa
used = pose.strength.yield_share
middle = (joint.length_AB / 2, 0, 0)
axial = pose.stiffness(arm, at=middle).support("x")
axial_at_rest = at_rest.stiffness(arm, at=middle).support("x")


def picture(path=None):
    """The turned flexure, leaf springs coloured by stress."""
    return pose.plot(path, color="stress")


print(f"{stiffness:.5f} Nm/rad at rest")
print(f"at {turn / deg:g} degrees {moment:.5f} Nm, {stress / MPa:.2f} MPa, {100 * used:.1f} % of yield")
print(f"stiffness along AB {axial / 1e6:.4f} N/um, {100 * axial / axial_at_rest:.3f} % of that at rest")

if __name__ == "__main__":
    picture("cross_flexure.png")
